"""Self check of the numerical solver, made once when a service starts, in a process of its own.

The service itself needs no numerics to start, and a solver that crashes ends only this process.
"""

from __future__ import annotations

import json
import math
import sys
import threading
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

from jointstiff.schemas.access import SolverHealth
from jointstiff.service.conversion.child import ask_child

_REMEDY = "results are still proved, or refused; install `clarabel` again, and restart the service"


def ask_solver() -> SolverHealth:
    """Let another process check the solver, and return what it found."""
    try:
        answer = ask_child(__name__)
    except OSError as error:  # the system starts no further process
        return describe_check(None, 0.0, type(error).__name__)
    if answer.document is None:
        return describe_check(None, 0.0, answer.error)
    return describe_check(answer.document["distance"], answer.document["limit"])


def describe_check(distance: float | None, limit: float, error: str = "") -> SolverHealth:
    """Return the outcome of a check as a message.

    Args:
        distance: distance of the solver's answer from the exact one, relative to the readings; None without
            an answer.
        limit: greatest distance that the solver's tolerance explains.
        error: name of the error that ended the check; empty if unknown.
    """
    agrees = distance is not None and distance <= limit
    why = None
    if distance is None:
        cause = f" ({error})" if error else ""
        why = f"Clarabel did not solve a known program{cause}: {_REMEDY}"
    elif not agrees:
        why = (
            f"Clarabel's answer to a known program is off by {distance:.1g}, more than {limit:.0e}: {_REMEDY}"
        )
    return SolverHealth(
        name="clarabel", version=version("clarabel"), agrees=agrees, distance=distance, why=why
    )


class SolverWatch:
    """Outcome of the check that a thread makes once."""

    def __init__(self, check: Callable[[], SolverHealth] = ask_solver) -> None:
        """Prepare a check, which `start` makes."""
        self._check = check
        self.found: SolverHealth | None = None  # None until the check has ended

    def start(self) -> threading.Thread:
        """Start the check, without waiting for its end."""
        thread = threading.Thread(target=self._run, name="solver check", daemon=True)
        thread.start()
        return thread

    def _run(self) -> None:
        self.found = self._check()


def main() -> dict[str, Any]:
    """Check the solver in this process; a distance that is not finite is None."""
    from jointstiff.solver.fit.self_check import check_solver

    witness = check_solver()
    distance = witness.distance if math.isfinite(witness.distance) else None
    return {"distance": distance, "limit": witness.limit}


if __name__ == "__main__":
    json.dump(main(), sys.stdout)
