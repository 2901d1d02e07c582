"""Parallel computation: calls carried out by any `concurrent.futures.Executor`, with results in order.

An executor of processes or of a cluster sends calls and answers as pickles: the numbers have the same bits as
numbers computed in this process.
"""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import partial
from itertools import islice
from queue import Empty, SimpleQueue
from typing import Any, Final, Generic, TypeVar

from jointstiff.service.problems import ExecutorError
from jointstiff.service.process import one_thread

IN_FLIGHT: Final = 256
"""Greatest number of calls that an executor has at once: enough for a cluster, and not too much memory."""
MOST_WAITING: Final = 1_024
"""Greatest number of submitted calls whose answers were not yielded yet, while the first call takes long."""
_CHECK_SECONDS: Final = 0.1
"""Longest time between two checks whether the caller has cancelled the work [s]."""
_First = TypeVar("_First")
_Answer = TypeVar("_Answer")
_Outcome = tuple[_Answer | None, Exception | None]


class CancelledWorkError(BaseException):
    """Exception that ends work which the caller has cancelled."""


def refuse_no_executor(executor: object) -> None:
    """Raise a TypeError if an argument `executor`, such as a number of processes, is no executor."""
    if executor is not None and not hasattr(executor, "submit"):
        raise TypeError(
            f"executor is {executor!r}, but must be an executor: give "
            "`concurrent.futures.ProcessPoolExecutor()`, or leave it out"
        )


def map_in_order(
    executor: Executor,
    function: Callable[[_First], _Answer],
    arguments: Iterable[_First],
    cancelled: Callable[[], object],
) -> Generator[_Answer]:
    """Call a function in an executor for each argument, and yield its answers in the order of the arguments.

    Up to `IN_FLIGHT` calls are submitted ahead of the last answer, and up to `MOST_WAITING` while the call
    whose answer comes next takes longer than others. At the end, calls that have not begun are cancelled.

    Raises:
        CancelledWorkError: `cancelled` returned true.
        ExecutorError: the executor itself failed, not the function.
        Exception: an error that the function raised.
    """
    calls = _Calls(executor, function, cancelled)
    remaining = iter(arguments)
    try:
        while True:
            calls.submit(remaining, IN_FLIGHT)
            if not calls.waiting:
                return
            while not calls.next_has_ended():
                calls.wait()
                calls.submit(remaining, MOST_WAITING)
            answer, error = _call_executor(calls.waiting.popleft().result)
            if error is not None:
                raise error
            yield answer
    finally:
        for call in calls.waiting:
            call.cancel()


class _Calls(Generic[_First, _Answer]):
    """Calls that were submitted to an executor and whose answers were not yielded yet, in order."""

    def __init__(
        self, executor: Executor, function: Callable[[_First], _Answer], cancelled: Callable[[], object]
    ) -> None:
        self._executor, self._function, self._cancelled = executor, function, cancelled
        self.waiting: deque[Future[_Outcome[_Answer]]] = deque()
        # Calls that have ended, but are still counted in `_running`
        self._ended = SimpleQueue[Future[_Outcome[_Answer]]]()
        self._running = 0  # number of calls that were submitted and have not ended

    def submit(self, remaining: Iterator[_First], most_waiting: int) -> None:
        """Submit calls for the next arguments, as far as the executor and the queue of answers have room.

        `IN_FLIGHT` calls may run at once, and `most_waiting` answers may wait to be yielded. Stop as soon as
        the next answer is available: to produce an argument may be slow, and must not delay the answer.
        """
        while not self._ended.empty():
            self.wait()
        free_places = min(IN_FLIGHT - self._running, most_waiting - len(self.waiting))
        for argument in islice(remaining, max(0, free_places)):
            call = _call_executor(
                partial(self._executor.submit, _return_answer_or_error, self._function, argument)
            )
            self.waiting.append(call)
            self._running += 1
            call.add_done_callback(self._ended.put)
            if self.next_has_ended():
                return

    def wait(self) -> None:
        """Wait until any call has ended, but at most `_CHECK_SECONDS`, and count the ended call."""
        with suppress(Empty):
            self._ended.get(timeout=_CHECK_SECONDS)
            self._running -= 1

    def next_has_ended(self) -> bool:
        """Return whether the first waiting call has ended; its answer is yielded next.

        Raises:
            CancelledWorkError: the caller has cancelled the work, even if the call has ended.
        """
        if self._cancelled():
            raise CancelledWorkError
        return self.waiting[0].done()


def _return_answer_or_error(function: Callable[[_First], _Answer], argument: _First) -> _Outcome[_Answer]:
    """Call a function with an argument; return (answer, None), or (None, error) if the function raises.

    Runs in a worker process, so that the error reaches the caller as a value.
    """
    try:
        with one_thread():
            return function(argument), None
    except Exception as error:  # noqa: BLE001 - raised by `map_in_order`
        error.add_note(traceback.format_exc())
        return None, error


def _call_executor(call: Callable[[], Any]) -> Any:  # noqa: ANN401 - of the executor
    """Call a method of the executor and return its answer; raise its errors as an `ExecutorError`."""
    try:
        return call()
    except Exception as error:
        raise ExecutorError(error) from error
