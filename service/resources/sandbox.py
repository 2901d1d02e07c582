"""Vet an uploaded URDF in a child process: the second line of defence behind `jointstiff.solver.robot.urdf`.

Should a document get past the guard and make a parser hang, explode or crash, only the child does.
It limits itself (`service.resources.sandbox_child`); the parent limits how long it waits, how much it
believes, and how many children there are. What comes back is a document of our own making, which is
read again here.
"""

from __future__ import annotations

import json
import logging
import os
import selectors
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot import KinematicChain, check_size, read_urdf

__all__ = ["CHILD_COMMAND", "MAX_ANSWER_BYTES", "MAX_CHILDREN", "WALL_SECONDS", "vet_urdf"]

WALL_SECONDS = 20.0
"""How long the parent waits for the answer; a usual call takes 0.3 s."""

MAX_ANSWER_BYTES = 1024**2
"""Longest answer; a chain of 64 joints with the longest names stays below it."""

MAX_CHILDREN = 4
"""Children at a time; further calls wait their turn."""

CHILD_COMMAND = (sys.executable, "-P", "-s", "-B", "-m", "jointstiff.service.resources.sandbox_child")
"""Python, without the working directory on its path, user packages, or files that it writes."""

_LONGEST = 1_000  # characters of a reason or a remedy that the child gives
_REMEDY = "simplify the document: only links and joints between base and flange are needed"

_logger = logging.getLogger(__name__)
_turns = threading.BoundedSemaphore(MAX_CHILDREN)


def vet_urdf(
    text: str,
    base: str,
    flange: str,
    *,
    command: Sequence[str] = CHILD_COMMAND,
    wall_seconds: float = WALL_SECONDS,
) -> KinematicChain:
    """Read the chain from the base link to the flange link of a document that no one trusts.

    Args:
        text: the URDF as uploaded.
        base: link whose frame is R0.
        flange: link whose frame is the flange frame.
        command: the child; another one is for tests.
        wall_seconds: how long to wait for it.

    Returns:
        The chain; its `to_urdf()` is what deserves to be stored.

    Raises:
        RobotError: the document is refused, or the child crashed, hung, or answered nonsense over
            it.
        OSError: the child cannot be started, which is not the document's fault.
    """
    check_size(text)
    request = json.dumps({"urdf": text, "base": base, "flange": flange}).encode("ascii")
    with _turns:
        output = _run(command, request, wall_seconds)
    match _parsed(output):
        case {"urdf": str(vetted)}:
            return read_urdf(vetted, base, flange)
        case {"error": {"where": str() | None as where, "reason": str(why), "remedy": str(remedy)}}:
            raise RobotError(why[:_LONGEST], remedy=remedy[:_LONGEST], where=where)
        case _:
            raise _stopped("gave no answer that makes sense", output)


def _run(command: Sequence[str], request: bytes, wall_seconds: float) -> bytes:
    """Start the child, wait for its end, and return what it wrote."""
    deadline = time.monotonic() + wall_seconds
    with tempfile.TemporaryFile() as stdin:  # a pipe could fill while the child does not read
        stdin.write(request)
        stdin.seek(0)
        process = subprocess.Popen(  # noqa: S603 - the command is ours, the document is on stdin
            command,
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=_environment(),
            cwd="/",
            start_new_session=True,
        )
    try:
        output = _read(process, deadline)
        status = process.wait(max(0.0, deadline - time.monotonic()))
    except subprocess.TimeoutExpired:
        raise _stopped(f"was stopped after {wall_seconds:g} s") from None
    finally:
        _end(process)
    if status != 0:
        raise _stopped(_cause(status), output)
    return output


def _read(process: subprocess.Popen[bytes], deadline: float) -> bytes:
    """Read the child's output to its end, within the limits of time and size.

    Raises:
        subprocess.TimeoutExpired: the child still runs at the deadline.
        RobotError: the output is too long.
    """
    output = bytearray()
    with selectors.DefaultSelector() as selector:
        selector.register(_stdout(process), selectors.EVENT_READ)
        while selector.select(max(0.0, deadline - time.monotonic())):
            chunk = os.read(_stdout(process), 65_536)
            if not chunk:
                return bytes(output)
            output += chunk
            if len(output) > MAX_ANSWER_BYTES:
                raise _stopped(f"was stopped after {MAX_ANSWER_BYTES} bytes of output", output)
    raise subprocess.TimeoutExpired(process.args, deadline)


def _stdout(process: subprocess.Popen[bytes]) -> int:
    if process.stdout is None:
        raise TypeError("the process has no pipe for its output")
    return process.stdout.fileno()


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the child if it still runs, with whatever it may have started, and release its pipe."""
    if process.poll() is None:  # not reaped, so the number of its group is still its own
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    if process.stdout is not None:
        process.stdout.close()


def _environment() -> dict[str, str]:
    """Return only what Python needs: nothing of the service's settings or secrets."""
    kept = {name: os.environ[name] for name in ("LD_LIBRARY_PATH",) if name in os.environ}
    return kept | {
        "LANG": "C.UTF-8",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": str(Path(__file__).parents[3]),
    }


def _parsed(output: bytes) -> object:
    """Parse the last line; lines before it are warnings of libraries."""
    lines = output.strip().splitlines()
    try:
        return json.loads(lines[-1]) if lines else None
    except (ValueError, RecursionError):
        return None


def _cause(status: int) -> str:
    if status >= 0:
        return f"failed with exit status {status}"
    if -status in (signal.SIGKILL, signal.SIGXCPU):
        return f"was stopped for using too much time or memory (signal {-status})"
    return f"crashed (signal {-status})"


def _stopped(how: str, output: bytes | bytearray = b"") -> RobotError:
    _logger.warning("the child that parses URDFs %s; it wrote %r", how, bytes(output[-2_000:]))
    return RobotError(f"the parser {how}", remedy=_REMEDY, where="document")
