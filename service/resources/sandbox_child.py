"""The child process of `jointstiff.service.resources.sandbox`: limit itself, read one URDF, answer, end.

Run as ``python -m service.sandbox_child``. One JSON object comes in on stdin, ``{"urdf", "base",
"flange"}``; one line of JSON goes out on stdout, ``{"urdf": …}`` with the chain's own URDF, or
``{"error": {"where", "reason", "remedy"}}``. Imports of this module are few on purpose: numpy and
Pinocchio come after the limits.
"""

from __future__ import annotations

import json
import resource
import sys

__all__ = ["CPU_SECONDS", "MEMORY_BYTES", "OPEN_FILES", "apply_limits", "main"]

CPU_SECONDS = 10
"""Processor time; a usual call takes 0.3 s, most of it to import Pinocchio."""

MEMORY_BYTES = 1024**3
"""Address space; Python, numpy and Pinocchio take 0.2 GB of it."""

OPEN_FILES = 64
"""Open files; importing Pinocchio needs a handful at a time."""


def apply_limits() -> None:
    """Limit this process for good: time, memory, files; no writes, no core, no new processes.

    A limit that is stricter already stays. Linux holds all of them, except that the superuser may
    still start processes; macOS does not hold that on memory.
    """
    limits = {
        resource.RLIMIT_CPU: CPU_SECONDS,
        resource.RLIMIT_FSIZE: 0,
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_NOFILE: OPEN_FILES,
        resource.RLIMIT_NPROC: 0,
    }
    if sys.platform == "linux":
        limits[resource.RLIMIT_AS] = MEMORY_BYTES
    for limit, wanted in limits.items():
        _, hard = resource.getrlimit(limit)
        value = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(limit, (value, value))


def main() -> None:
    """Serve one request."""
    apply_limits()
    request = json.load(sys.stdin)
    answer = _vet(request["urdf"], request["base"], request["flange"])
    sys.stdout.write("\n" + json.dumps(answer) + "\n")


def _vet(text: str, base: str, flange: str) -> dict[str, object]:
    """Read the document, build the robot, and return the answer."""
    from jointstiff.solver.errors import RobotError
    from jointstiff.solver.robot import Robot, read_urdf

    try:
        chain = read_urdf(text, base, flange)
        Robot(chain)
    except RobotError as error:
        refusal = {"where": error.where, "reason": error.reason, "remedy": error.remedy}
        return {"error": refusal}
    return {"urdf": chain.to_urdf()}


if __name__ == "__main__":
    main()
