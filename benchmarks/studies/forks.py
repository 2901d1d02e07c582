"""A plugin of pytest that judges changes of the sources: tests are collected once, and run in forks.

Each fork has one change in memory: the code of the functions that it is in is replaced. What a module
computes when it is imported stays as it was.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import signal
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

import pytest
from _pytest.main import pytest_runtestloop as run_tests

from benchmarks.studies.caches import forget

__all__ = ["CHANGES", "replace_code"]

CHANGES = "JOINTSTIFF_CHANGES"
"""Environment variable: the path of a JSON file with a list of changes.

A change has the name of its `module`, its `path` and the `source` of the whole module with it, and the
`tests` and whole `files` to be run; `noticed` and `seconds` are added to it.
"""
TIME_LIMIT = 900.0
"""Seconds for the tests of a change; one that lets them run on is noticed."""
_PASSED, _FAILED, _NO_CHANGE = range(3)


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session: pytest.Session) -> bool:
    """Judge all changes, in as many forks at a time as there are processors but one."""
    if session.testsfailed:
        raise session.Interrupted("tests cannot be collected")
    file = Path(os.environ[CHANGES])
    changes = json.loads(file.read_text(encoding="utf-8"))
    waiting, running = list(changes), dict[int, tuple[dict[str, Any], float]]()
    gc.unfreeze()  # else the functions are not listed
    while waiting or running:
        while waiting and len(running) < max(1, (os.cpu_count() or 1) - 1):
            change = waiting.pop(0)
            running[_fork(session, change)] = change, time.perf_counter()
        for pid, (change, start) in list(running.items()):
            seconds = time.perf_counter() - start
            ended, status = os.waitpid(pid, os.WNOHANG)
            if not ended and seconds < TIME_LIMIT:
                continue
            if not ended:
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
            del running[pid]
            if ended and os.waitstatus_to_exitcode(status) == _NO_CHANGE:
                raise RuntimeError(f"no function of {change['path']} has this change")
            change |= {"noticed": not ended or status != 0, "seconds": seconds}
            file.write_text(json.dumps(changes), encoding="utf-8")
        time.sleep(0.05)
    return True


def _fork(session: pytest.Session, change: dict[str, Any]) -> int:
    pid = os.fork()
    if pid:
        return pid
    code = _NO_CHANGE
    try:
        silence = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silence, 1)
        os.dup2(silence, 2)
        importlib.import_module(change["module"])  # some are imported when they are first needed
        replace_code(Path(change["path"]), change["source"])
        forget()  # what was computed while tests were collected
        gc.freeze()
        code = _FAILED
        session.items[:] = _in_order(session.items, change["tests"], set(change["files"]))
        session.config.option.maxfail = 1
        run_tests(session)
        code = _FAILED if session.testsfailed else _PASSED
    finally:
        os._exit(code)


def _in_order(items: Sequence[pytest.Item], tests: Sequence[str], files: set[str]) -> list[pytest.Item]:
    """Return the chosen items file by file, beginning with the file of the first test."""
    first = {test.partition("::")[0]: -number for number, test in enumerate(reversed(tests))}
    chosen = {*tests}
    known = [each for each in items if each.nodeid in chosen or each.nodeid.partition("::")[0] in files]
    return sorted(known, key=lambda item: first.get(item.nodeid.partition("::")[0], 1))


def replace_code(path: Path, source: str) -> None:
    """Give the functions of an imported module the code that they have in another source of it.

    Args:
        path: of the module.
        source: of the whole module, with as many functions in the same order.

    Raises:
        LookupError: no function of the module has other code there.
    """
    before = _functions(compile(path.read_text(encoding="utf-8"), str(path), "exec", dont_inherit=True))
    after = _functions(compile(source, str(path), "exec", dont_inherit=True))
    changed = {old: new for old, new in zip(before, after, strict=True) if old != new}
    functions = [
        each
        for each in gc.get_objects()
        if isinstance(each, FunctionType)
        and each.__code__ in changed
        and Path(each.__code__.co_filename).resolve() == path.resolve()
    ]
    if not functions:
        raise LookupError(path)
    for function in functions:
        function.__code__ = changed[function.__code__]


def _functions(code: CodeType) -> Iterator[CodeType]:
    """Yield the codes of all functions and classes of a module."""
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield each
            yield from _functions(each)
