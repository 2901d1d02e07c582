"""Processes with limits of memory and time, in which libraries read files that may be hostile."""

from __future__ import annotations

import json
import resource
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from jointstiff.service.process import build_own_command

MAX_MEMORY: Final = 384 * 1024 * 1024
"""Memory of a process, in addition to that of its modules [bytes]."""
MAX_SECONDS: Final = 20
"""Processor time of a process [s]."""
MAX_WAIT: Final = 120.0
"""Time for which a process that reads one file is waited for [s]; its processor time has an own limit."""
_EXCEEDED: Final = -9
"""Status of a process that its limits have ended."""


@dataclass(frozen=True)
class ChildAnswer:
    """Answer of a process with limits."""

    document: dict[str, Any] | None  # its answer; None if its limits, or an error, have ended it
    error: str = ""  # name of the error of the library that has ended it


def ask_child(module: str, *arguments: str, content: bytes = b"") -> ChildAnswer:
    """Run a module of jointstiff in a process of its own, and return the JSON document that it writes.

    Args:
        module: full name of the module, which calls `limit_this_process`.
        arguments: its arguments.
        content: its standard input.
    """
    status, output, errors = _EXCEEDED, b"", b""
    with suppress(subprocess.TimeoutExpired):
        process = subprocess.run(  # noqa: S603 - the command is ours; no shell reads its arguments
            build_own_command(module, *arguments),
            input=content,
            capture_output=True,
            check=False,
            timeout=MAX_WAIT,
        )
        status, output, errors = process.returncode, process.stdout, process.stderr
    if status > 0:  # the name of the error is in the last line of its traceback
        last_line = errors.decode(errors="replace").strip().rpartition("\n")[2]
        return ChildAnswer(None, last_line.partition(":")[0])
    return ChildAnswer(_parse_answer(output) if status == 0 else None)


def _parse_answer(output: bytes) -> dict[str, Any] | None:
    """Return the answer that a process wrote; None if its output is no whole answer."""
    with suppress(ValueError):
        answer = json.loads(output)
        return answer if isinstance(answer, dict) else None
    return None


def limit_this_process(seconds: int = MAX_SECONDS, memory: int = MAX_MEMORY) -> None:
    """Limit memory [bytes] and processor time [s] of this process."""
    with suppress(OSError, ValueError):  # without /proc there is no limit of memory
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
        most = pages * resource.getpagesize() + memory
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
