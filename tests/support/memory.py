"""Memory of what is done in a fork."""

import json
import os
from collections.abc import Callable
from pathlib import Path


def peak_of(act: Callable[[], object]) -> tuple[float, str]:
    """Return how much the resident size grows while something is done in a fork [MB], and how it ended."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        Path("/proc/self/clear_refs").write_text("5")  # forget the peak so far
        before = _status("VmRSS")
        try:
            act()
            outcome = "taken"
        except BaseException as error:  # noqa: BLE001 - refusals are what is expected
            outcome = type(error).__name__
        os.write(writing, json.dumps([(_status("VmHWM") - before) / 1000.0, outcome]).encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        grown, outcome = json.load(pipe)
    os.waitpid(child, 0)
    return float(grown), str(outcome)


def _status(name: str) -> int:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name))
