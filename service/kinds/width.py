"""Width by executors: calls carried out by any `concurrent.futures.Executor`, and their results in order.

An executor of processes or of a cluster gets calls and answers as pickles: what it computes has the same
bits as here.
"""

from __future__ import annotations

import pickle
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import cache, lru_cache, partial
from itertools import islice
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar

from jointstiff.service.problems import ExecutorError
from jointstiff.service.process import one_thread

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Arrays, Span, Work

IN_FLIGHT: Final = 256
"""Calls that an executor has at the same time: enough for a cluster, and few enough for the memory."""
MOST_WAITING: Final = 1_024
"""Calls that wait behind one that takes long, those with an answer among them."""
_LOOK_SECONDS: Final = 0.1
"""Time between two questions whether the caller wants no more."""
_First = TypeVar("_First")
_Answer = TypeVar("_Answer")
_Outcome = tuple[_Answer | None, Exception | None]


class CancelledWorkError(BaseException):
    """The caller wants no result."""


def in_order(
    executor: Executor,
    function: Callable[[_First], _Answer],
    arguments: Iterable[_First],
    cancelled: Callable[[], object],
) -> Generator[_Answer]:
    """Yield what a function answers for each argument, in order.

    At most `IN_FLIGHT` arguments are taken beyond the answers, and up to `MOST_WAITING` while the call whose
    turn it is takes longer than others. Whatever ends the iteration cancels the calls that have not begun.

    Raises:
        CancelledWorkError: the caller wants no more.
        ExecutorError: the executor failed, rather than the function.
        Exception: what the function raised.
    """
    calls = _Calls(executor, function, cancelled)
    left = iter(arguments)
    try:
        while True:
            calls.submit(left, IN_FLIGHT)
            if not calls.waiting:
                return
            while not calls.next_has_ended():
                calls.wait()
                calls.submit(left, MOST_WAITING)
            answer, error = _by_executor(calls.waiting.popleft().result)
            if error is not None:
                raise error
            yield answer
    finally:
        for call in calls.waiting:
            call.cancel()


class _Calls(Generic[_First, _Answer]):
    """Calls of an executor that were submitted and not answered to the caller, in order."""

    def __init__(
        self, executor: Executor, function: Callable[[_First], _Answer], cancelled: Callable[[], object]
    ) -> None:
        self._executor, self._function, self._cancelled = executor, function, cancelled
        self.waiting: deque[Future[_Outcome[_Answer]]] = deque()
        self._ended = SimpleQueue[Future[_Outcome[_Answer]]]()  # calls that are counted as open yet
        self._open = 0

    def submit(self, left: Iterator[_First], most: int) -> None:
        """Keep the executor busy, with so many calls that wait; an answer that is due comes first."""
        while not self._ended.empty():
            self.wait()
        room = min(IN_FLIGHT - self._open, most - len(self.waiting))
        for argument in islice(left, max(0, room)):
            call = _by_executor(partial(self._executor.submit, _answer_or_error, self._function, argument))
            self.waiting.append(call)
            self._open += 1
            call.add_done_callback(self._ended.put)
            if self.next_has_ended():
                return

    def wait(self) -> None:
        """Wait until some call has ended, or for a moment."""
        with suppress(Empty):
            self._ended.get(timeout=_LOOK_SECONDS)
            self._open -= 1

    def next_has_ended(self) -> bool:
        """Return whether the call has ended whose turn it is.

        Raises:
            CancelledWorkError: the caller wants no more; also where the answer is there.
        """
        if self._cancelled():
            raise CancelledWorkError
        return self.waiting[0].done()


def _answer_or_error(function: Callable[[_First], _Answer], argument: _First) -> _Outcome[_Answer]:
    """Return an answer or an error, in another process: what is raised there is the executor's own error."""
    try:
        with one_thread():
            return function(argument), None
    except Exception as error:  # noqa: BLE001 - it is raised where it is wanted
        error.add_note(traceback.format_exc())
        return None, error


def _by_executor(call: Callable[[], Any]) -> Any:  # noqa: ANN401 - of the executor
    try:
        return call()
    except Exception as error:
        raise ExecutorError(error) from error


def computed(
    work: Work, spans: Sequence[Span], executor: Executor | None, cancelled: Callable[[], object]
) -> Generator[Arrays]:
    """Yield what the steps of work compute, in order: here, or by an executor.

    Raises:
        CancelledWorkError: the caller wants no more.
        ExecutorError: the executor failed.
        JointstiffError: as `Work.compute` does.
    """
    if executor is not None and spans:
        whole = cache(partial(pickle.dumps, work))

        def task(span: Span) -> tuple[bytes, Span]:
            part = work.alone(span)
            return whole() if part is work else pickle.dumps(part), span

        yield from in_order(executor, _compute, map(task, spans), cancelled)
        return
    for span in spans:
        if cancelled():
            raise CancelledWorkError
        yield work.compute(span)


def _compute(task: tuple[bytes, Span]) -> Arrays:
    content, span = task
    return _work_of_steps(content).compute(span)


@lru_cache(maxsize=1)
def _work_of_steps(content: bytes) -> Work:
    """Return the work of the steps that come one after the other: it keeps what all of them need."""
    work: Work = pickle.loads(content)  # noqa: S301 - `computed` wrote it
    return work
