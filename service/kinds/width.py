"""Width by executors: calls carried out by any `concurrent.futures.Executor`, and their results in order.

An executor of processes or of a cluster gets calls and answers as pickles: what it computes has the same
bits as here.
"""

from __future__ import annotations

import pickle
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from functools import lru_cache, partial
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, TypeVar

from jointstiff.service.problems import ExecutorError
from jointstiff.service.process import one_thread

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Arrays, Span, Work

IN_FLIGHT: Final = 256
"""Calls that an executor has at the same time: enough for a cluster, and few enough for the memory."""
MOST_WAITING: Final = 4_096
"""Calls that wait for their turn, those with an answer among them: one that takes long holds up no other."""
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

    No more arguments are taken than are in flight, or wait behind a call that takes longer. Whatever ends the
    iteration cancels the calls that have not begun.

    Raises:
        CancelledWorkError: the caller wants no more.
        ExecutorError: the executor failed, rather than the function.
        Exception: what the function raised.
    """
    waiting: deque[Future[_Outcome[_Answer]]] = deque()
    left = iter(arguments)
    open_calls: list[Future[_Outcome[_Answer]]] = []

    def submit() -> None:
        open_calls[:] = [call for call in open_calls if not call.done()]
        for argument in islice(left, min(IN_FLIGHT - len(open_calls), MOST_WAITING - len(waiting))):
            call = _by_executor(partial(executor.submit, _outcome, function, argument))
            waiting.append(call)
            open_calls.append(call)

    try:
        while True:
            submit()
            if not waiting:
                return
            while not _has_ended(waiting[0], cancelled):
                wait(open_calls, _LOOK_SECONDS, return_when=FIRST_COMPLETED)
                submit()
            answer, error = _by_executor(waiting.popleft().result)
            if error is not None:
                raise error
            yield answer
    finally:
        for future in waiting:
            future.cancel()


def _has_ended(call: Future[Any], cancelled: Callable[[], object]) -> bool:
    """Return whether a call has ended.

    Raises:
        CancelledWorkError: the caller wants no more; also where the answer is there.
    """
    if cancelled():
        raise CancelledWorkError
    return call.done()


def _outcome(function: Callable[[_First], _Answer], argument: _First) -> _Outcome[_Answer]:
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
        content = pickle.dumps(work)
        yield from in_order(executor, partial(_compute, content), spans, cancelled)
        return
    for span in spans:
        if cancelled():
            raise CancelledWorkError
        yield work.compute(span)


def _compute(content: bytes, span: Span) -> Arrays:
    return _work(content).compute(span)


@lru_cache(maxsize=1)
def _work(content: bytes) -> Work:
    """Return the work of the steps that come one after the other: it keeps what all of them need."""
    work: Work = pickle.loads(content)  # noqa: S301 - `computed` wrote it
    return work
