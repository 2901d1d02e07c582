"""The work of a job, done at once or cut into steps, and its execution to a finished job, without a store."""

from __future__ import annotations

import io
import logging
import pickle
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache, lru_cache, partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar
from uuid import uuid4

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.fields import Message
from jointstiff.schemas.finding import Problem
from jointstiff.schemas.job import Job, JobState, Progress, Provenance
from jointstiff.service.kinds.width import CancelledWorkError, map_in_order
from jointstiff.service.problems import ExecutorError, StoreUnavailableError, http_problem, problem_from_error
from jointstiff.service.process import versions
from jointstiff.solver.errors import InputError, JointstiffError, NotObservableError, RequestError

if TYPE_CHECKING:
    from jointstiff.service.store.tables import AccessKey

Span = tuple[int, int]
"""Indices of the first unit of work in a step, and of the first unit after the step."""
Arrays: TypeAlias = Mapping[str, npt.NDArray[Any]]
"""Result of a step: arrays by name, which a store can keep."""
AnyJob = TypeVar("AnyJob", bound=Job)
AnyResult = TypeVar("AnyResult", bound=Message)
OnProgress = Callable[[Progress], object]
_WATCH = ContextVar[Callable[[str], object] | None]("_WATCH", default=None)
_logger = logging.getLogger(__name__)


class Work:
    """Base class of the computation of one checked request, which may be cut into steps.

    A unit is a small part of the work, such as one place of a map; a step computes consecutive units.

    `steps` lists the steps, `compute` carries out one step, and `conclude` makes the job's result from the
    arrays of all steps. Work without steps is carried out by `conclude` alone.
    """

    input_hash: str  # SHA-256 of data and request; equal inputs have equal hashes in any store
    robot_id: str | None  # id of the stored robot; None if it is not stored
    details: Mapping[str, object] = MappingProxyType({})  # fields that only jobs of this kind have
    unit = ""  # noun for the units that progress counts, such as "places"
    activity = ""  # participle that the progress bar shows, such as "mapping"

    def steps(self) -> Sequence[Span]:
        """Return the steps of the work as spans of its units, in order; a step takes a fraction of a second.

        Every call returns equal spans, so that several workers can share the steps.
        """
        return ()

    def detach_for_step(self, _span: Span) -> Work:
        """Return work that can compute this step in another process, which has no access to the store."""
        return self

    def compute(self, span: Span) -> Arrays:
        """Carry out a step and return its arrays, by name; any worker computes the same arrays.

        Classes of work with steps override this method.

        Raises:
            JointstiffError: the computation fails, so that the job fails.
        """
        raise ValueError(f"this work has no step {span}")

    def conclude(self, parts: Sequence[Arrays]) -> Message:
        """Return the result of the job.

        Args:
            parts: arrays that `compute` returned for all steps, in order; empty for work without steps.

        Raises:
            RequestError: the request is refused, and the job is not stored.
            JointstiffError: the computation fails; the error says why.
        """
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class QuickWork(Work):
    """Work without steps, carried out by a function without arguments."""

    result: Callable[[], Message]  # computes the job's result; raises the errors of `Work.conclude`
    input_hash: str
    robot_id: str | None
    details: Mapping[str, object] = field(default_factory=dict)

    def conclude(self, parts: Sequence[Arrays]) -> Message:  # noqa: ARG002 - no steps
        """Compute and return the result of the job; `parts` is empty, as this work has no steps."""
        return self.result()


@contextmanager
def watching(watch: Callable[[str], object]) -> Iterator[None]:
    """Report the progress of work in the block: `watch` is called with the name of each part that begins.

    Work names its parts by `begin_part`, such as "find_joints".
    """
    token = _WATCH.set(watch)
    try:
        yield
    finally:
        _WATCH.reset(token)


def begin_part(activity: str) -> None:
    """Notify the caller of `conclude` of the part that begins, such as "turning at place 1".

    Raises:
        CancelledWorkError: the job was cancelled.
    """
    if (watch := _WATCH.get()) is not None:
        watch(activity)


def cut_into_spans(count: int, size: int) -> tuple[Span, ...]:
    """Cut `count` units into spans (first, one past the last) of `size` units; the last may be shorter."""
    return tuple((start, min(start + size, count)) for start in range(0, count, size))


def concatenate_steps(arrays_of_steps: Iterable[Arrays]) -> dict[str, npt.NDArray[Any]]:
    """Return name → array, concatenated along axis 0 from the arrays that the steps have under this name.

    `arrays_of_steps` has one step at least.
    """
    steps = list(arrays_of_steps)
    return {name: np.concatenate([step[name] for step in steps]) for name in steps[0]}


def pack_arrays(arrays: Arrays) -> bytes:
    """Return the arrays of a step as the bytes of an npz file, for the store; `unpack_arrays` reads them."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)  # not compressed: digits hardly compress
    return buffer.getvalue()


def unpack_arrays(content: bytes) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays, by name, from bytes that `pack_arrays` wrote."""
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return dict(archive)


def new_job(job_class: type[AnyJob], request: Message, work: Work, key: AccessKey | None = None) -> AnyJob:
    """Return a new job in state `queued`, with a new id; `progress` is None if the work has no steps.

    Args:
        job_class: class of the job.
        request: request as it was posted.
        work: work of the request.
        key: access key of the user who posts the job; None if the service has no keys.
    """
    provenance = Provenance(
        versions=dict(versions()),
        input_hash=work.input_hash,
        created_at=datetime.now(UTC),
        started_at=None,
        ended_at=None,
    )
    fields: dict[str, object] = {
        "id": uuid4().hex,
        "state": "queued",
        "progress": _begin_progress(work),
        "request": request,
        "result": None,
        "error": None,
        "provenance": provenance,
        "key_id": None if key is None else key.id,
        "key_name": None if key is None else key.name,
    }
    return job_class.model_validate({**fields, **work.details})


def _begin_progress(work: Work) -> Progress | None:
    """Return the progress of work that has not begun; None if it has no steps.

    A step is a span (first, one past the last) of units, so the end of the last span is their number.
    """
    steps = work.steps()
    if not steps:
        return None
    _, total = steps[-1]
    return Progress(done=0, total=total, unit=work.unit, activity=work.activity)


def make_failed_job(job_class: type[AnyJob], request: Message, error: Problem) -> AnyJob:
    """Return a job in state `failed` for a request that was refused, or that could not be read."""
    no_work = QuickWork(lambda: request, input_hash="", robot_id=None)  # nothing is computed
    failed: dict[str, object] = {"state": "failed", "error": error}
    return new_job(job_class, request, no_work).model_copy(update=failed)


def carry_out(
    job: AnyJob,
    work: Work,
    on_progress: OnProgress | None = None,
    cancelled: Callable[[], object] = lambda: False,
    executor: Executor | None = None,
    retried: tuple[type[Exception], ...] = (),
) -> AnyJob:
    """Carry out a queued job now, and return a copy of the job in its final state.

    Args:
        job: job to carry out; it is not changed.
        work: work of the job's request.
        on_progress: called after each step with the progress.
        cancelled: called between the steps; a true answer ends the job in state `cancelled`.
        executor: carries out the steps; None to carry them out in this process.
        retried: classes of further errors that the request did not cause; they are raised again.

    Raises:
        RequestError: the request is refused.
        ExecutorError: the executor failed.
        StoreUnavailableError: the database does not answer.
        Exception: an error of a class in `retried`.
    """
    watched = _WatchedWork(work, job.progress, on_progress, cancelled)
    try:
        passed = (RequestError, ExecutorError, StoreUnavailableError, *retried)
        result, error = compute_outcome(lambda: watched.compute(executor), passed)
    except CancelledWorkError:
        return job.model_copy(update={"state": "cancelled"})
    progress = job.progress and job.progress.model_copy(update={"done": job.progress.total})
    times = {
        "started_at": job.provenance.created_at,
        "ended_at": max(datetime.now(UTC), job.provenance.created_at),  # the clock may have been set back
    }
    return job.model_copy(
        update={
            "state": final_state(error),
            "progress": progress,
            "result": result,
            "error": error,
            "provenance": job.provenance.model_copy(update=times),
        }
    )


@dataclass(frozen=True, eq=False)
class _WatchedWork:
    """Work that is carried out in this thread, of whose progress a caller is notified."""

    work: Work
    progress: Progress | None  # of the queued job; None for work without steps
    on_progress: OnProgress | None
    cancelled: Callable[[], object]  # a true answer ends the work

    def compute(self, executor: Executor | None) -> Message:
        """Compute all steps, in an executor or in this process, and return the result.

        Raises:
            CancelledWorkError: the work was cancelled.
        """
        parts, steps = list[Arrays](), self.work.steps()
        with closing(compute_steps(self.work, steps, executor, self.cancelled)) as results:
            for (_, done), part in zip(steps, results, strict=True):
                parts.append(part)
                self._notify(done=done)
        with watching(self._begin_part):
            return self.work.conclude(parts)

    def _begin_part(self, activity: str) -> None:
        """Notify of a part of the conclusion that begins, unless the work was cancelled."""
        if self.cancelled():
            raise CancelledWorkError
        if self.progress is not None:
            self._notify(done=self.progress.total, activity=activity)

    def _notify(self, **changes: object) -> None:
        """Call the listener with the progress so changed; without a listener or progress, do nothing."""
        if self.on_progress is not None and self.progress is not None:
            self.on_progress(self.progress.model_copy(update=changes))


def compute_steps(
    work: Work, spans: Sequence[Span], executor: Executor | None, cancelled: Callable[[], object]
) -> Generator[Arrays]:
    """Compute the steps of a job's work, in this process or in an executor, and yield their arrays in order.

    Args:
        work: work whose steps are computed.
        spans: spans of units, one span for each step.
        executor: carries out the steps; None to carry them out in this process.
        cancelled: called between the steps; a true answer ends the computation.

    Raises:
        CancelledWorkError: `cancelled` returned true.
        ExecutorError: the executor failed.
        JointstiffError: a step fails.
    """
    if executor is not None and spans:
        pickle_whole = cache(partial(pickle.dumps, work))  # the whole work is pickled only once

        def make_task(span: Span) -> tuple[bytes, Span]:
            """Return the pickled work for a step, and the span of the step."""
            detached = work.detach_for_step(span)
            return pickle_whole() if detached is work else pickle.dumps(detached), span

        yield from map_in_order(executor, _compute_task, map(make_task, spans), cancelled)
        return
    for span in spans:
        if cancelled():
            raise CancelledWorkError
        yield work.compute(span)


def _compute_task(task: tuple[bytes, Span]) -> Arrays:
    """Compute a step in another process, from the pickled work and the step's span; return its arrays."""
    pickled_work, span = task
    return _unpickle_work(pickled_work).compute(span)


@lru_cache(maxsize=1)
def _unpickle_work(pickled_work: bytes) -> Work:
    """Return the unpickled work, cached because the next step in this process mostly needs the same work."""
    work: Work = pickle.loads(pickled_work)  # noqa: S301 - `compute_steps` wrote it
    return work


def compute_outcome(
    compute: Callable[[], AnyResult], passed: tuple[type[Exception], ...] = (RequestError,)
) -> tuple[AnyResult | None, Problem | None]:
    """Call the computation of a job; return (result, None), or (None, problem) if the computation fails.

    Errors of jobs are caught only here.

    Args:
        compute: computes and returns the result.
        passed: classes of errors that are raised again, not returned as a problem.

    Raises:
        Exception: an error of a class in `passed`.
    """
    try:
        return compute(), None
    except passed:
        raise
    except JointstiffError as error:
        return None, problem_from_error(error)
    except Exception:
        _logger.exception("a job failed unexpectedly")
        return None, unexpected_failure()


def final_state(error: Problem | None) -> JobState:
    """Return the state of a job that ended: `succeeded` without an error, else `failed`."""
    return "succeeded" if error is None else "failed"


def unexpected_failure() -> Problem:
    """Return the problem shown after an unexpected exception, a fault of the software: HTTP status 500."""
    return http_problem(
        500, "the computation failed with an internal error", "please report this problem, with the data"
    )


@contextmanager
def as_request_errors(section: str | None = None) -> Iterator[None]:
    """Raise errors about robot or readings in the block as a `RequestError`, which refuses the request.

    Otherwise such an error would be stored as the result of a failed job.

    Args:
        section: name of a part of the request, such as "robot", put before the place that the error names.

    Raises:
        RequestError: the block raised an `InputError` or a `NotObservableError`.
    """
    try:
        yield
    except (InputError, NotObservableError) as error:
        where = ".".join(part for part in (section, error.where) if part)
        raise RequestError(error.reason, remedy=error.remedy, where=where or None) from error
