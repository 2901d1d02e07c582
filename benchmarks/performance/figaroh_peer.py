"""FIGAROH's optimisers of postures, run as released in an environment of their own.

As a program, `python figaroh_peer.py ROWS.npy READINGS OUT.json`, it imports nothing of ours.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jointstiff.solver.arrays import FloatArray

__all__ = ["PACKAGES", "run_figaroh"]

_MOST_LOOKS = 4_000
"""Evaluations of the criterion after which Detmax is taken to cycle."""
PACKAGES = ("figaroh==1.0.2", "cvxopt")


def run_figaroh(rows: FloatArray, readings: int) -> dict[str, Any] | None:
    """Return weights, a list and the seconds that they took; None where the packages cannot be installed.

    Args:
        rows: (N, m, p) whitened.
        readings: in the list of Detmax.
    """
    import numpy as np

    python = _python()
    if python is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder, "rows.npy"), Path(folder, "out.json")
        np.save(given, rows)
        command = [str(python), __file__, str(given), str(readings), str(found)]
        subprocess.run(command, check=True, capture_output=True)
        answer: dict[str, Any] = json.loads(found.read_text(encoding="utf-8"))
    return answer


def _python() -> Path | None:
    """Return the interpreter of the environment, which is made where there is none."""
    home = Path(tempfile.gettempdir(), "jointstiff-figaroh")
    python = home / "bin" / "python"
    if (home / "complete").is_file():
        return python
    venv.create(home, with_pip=True, clear=True)
    done = subprocess.run([python, "-m", "pip", "install", "-q", *PACKAGES], check=False, capture_output=True)
    if done.returncode != 0:
        return None
    (home / "complete").touch()
    return python


def _main(given: str, readings: str, out: str) -> None:
    import numpy as np
    from figaroh.optimal.base_optimal_calibration import (  # type: ignore[import-not-found]
        Detmax,
        SOCPOptimizer,
    )

    rows = np.load(given)
    pool = {i: A.T @ A for i, A in enumerate(rows)}
    start = time.perf_counter()
    weights, _ = SOCPOptimizer(pool, {"NbSample": len(rows)}).solve()
    answer: dict[str, Any] = {"seconds": time.perf_counter() - start, "weights": weights}
    kept = dict(list(pool.items())[:200])
    start = time.perf_counter()
    try:
        search = _mended(Detmax)(kept, int(readings))
        search.main_algo()
        answer |= {"detmax_list": search.found}
    except Exception as error:  # noqa: BLE001  # whatever the peer does, its other figures count
        answer |= {"detmax_error": repr(error), "detmax_list": getattr(search, "found", None)}
    answer["detmax_seconds"] = time.perf_counter() - start
    Path(out).write_text(json.dumps(answer), encoding="utf-8")


def _mended(base: type) -> type:
    """Return Detmax that keeps its best list, which `cur_set` never holds, and ends where it cycles."""

    class Mended(base):  # type: ignore[misc]
        def get_critD(self, set: list[int]) -> float:  # noqa: A002, N802
            self.looks = getattr(self, "looks", 0) + 1
            if self.looks > _MOST_LOOKS:
                raise TimeoutError("it cycles")
            value = float(super().get_critD(set))
            if len(set) == self.nd and value >= getattr(self, "best", 0.0):
                self.best, self.found = value, list(set)
            return value

    return Mended


if __name__ == "__main__":
    _main(*sys.argv[1:4])
