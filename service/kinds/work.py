"""The work of a job, done at once or cut into steps, and its execution to a finished job. No store."""

from __future__ import annotations

import io
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar
from uuid import uuid4

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.fields import Message
from jointstiff.schemas.finding import Problem
from jointstiff.schemas.job import Job, JobState, Progress, Provenance
from jointstiff.service.kinds.width import CancelledWorkError, computed
from jointstiff.service.problems import ExecutorError, StoreUnavailableError, http_problem, problem_of
from jointstiff.service.process import versions
from jointstiff.solver.errors import InputError, JointstiffError, NotObservableError, RequestError

if TYPE_CHECKING:
    from jointstiff.service.store.tables import AccessKey

Span = tuple[int, int]
"""First unit of a job's work, and one past the last."""
Arrays: TypeAlias = Mapping[str, npt.NDArray[Any]]
"""What a step computes: arrays by name, which a store can keep."""
AnyJob = TypeVar("AnyJob", bound=Job)
OnProgress = Callable[[Progress], object]
_logger = logging.getLogger(__name__)


class Work:
    """The work of one request, which was checked: a line of units, cut into steps, and what they come to.

    Work without steps is done at once, by `conclude` alone.
    """

    input_hash: str  # SHA-256 of data and request; equal inputs have equal hashes in any store
    robot_id: str | None  # id of the stored robot; None if it is not stored
    details: Mapping[str, object] = MappingProxyType({})  # fields of the job beyond those of every job
    unit = ""  # unit of its progress
    activity = ""  # name of what makes progress

    def steps(self) -> Sequence[Span]:
        """Return all units in order, cut into steps of a fraction of a second; the same for every caller."""
        return ()

    def alone(self, _span: Span) -> Work:
        """Return the work with what a step needs, for another process."""
        return self

    def compute(self, span: Span) -> Arrays:
        """Carry out a step; its numbers do not depend on the worker.

        Raises:
            JointstiffError: the job fails.
        """
        raise ValueError(f"there is no step {span}")

    def conclude(self, parts: Sequence[Arrays]) -> Message:
        """Return the result of the job, from those of all steps in order.

        Raises:
            RequestError: the request is refused rather than stored.
            JointstiffError: there is no result, and why.
        """
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class QuickWork(Work):
    """Work that is done at once."""

    result: Callable[[], Message]  # raises as `Work.conclude` does
    input_hash: str
    robot_id: str | None
    details: Mapping[str, object] = field(default_factory=dict)

    def conclude(self, parts: Sequence[Arrays]) -> Message:  # noqa: ARG002 - there are none
        """Return the result."""
        return self.result()


def spans(count: int, size: int) -> tuple[Span, ...]:
    """Return units in order, cut into steps of a size."""
    return tuple((start, min(start + size, count)) for start in range(0, count, size))


def joined(parts: Iterable[Arrays]) -> dict[str, npt.NDArray[Any]]:
    """Return what all steps computed, in their order; there is at least one."""
    listed = list(parts)
    return {name: np.concatenate([part[name] for part in listed]) for name in listed[0]}


def pack(arrays: Arrays) -> bytes:
    """Return what a step computed as the store keeps it."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)  # random digits: zlib costs more than it saves
    return buffer.getvalue()


def unpack(content: bytes) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays that `pack` wrote."""
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return dict(archive)


def new_job(message: type[AnyJob], request: Message, work: Work, key: AccessKey | None = None) -> AnyJob:
    """Return a queued job; without progress if it is carried out at once."""
    progress = None
    if steps := work.steps():
        progress = Progress(done=0, total=steps[-1][1], unit=work.unit, activity=work.activity)
    provenance = Provenance(
        versions=dict(versions()),
        input_hash=work.input_hash,
        created_at=datetime.now(UTC),
        started_at=None,
        ended_at=None,
    )
    return message.model_validate(
        {
            "id": uuid4().hex,
            "state": "queued",
            "progress": progress,
            "request": request,
            "result": None,
            "error": None,
            "provenance": provenance,
            "key_id": None if key is None else key.id,
            "key_name": None if key is None else key.name,
            **work.details,
        }
    )


def carry_out(
    job: AnyJob,
    work: Work,
    on_progress: OnProgress | None = None,
    cancelled: Callable[[], object] = lambda: False,
    executor: Executor | None = None,
) -> AnyJob:
    """Return a job carried out now; cancelled between two steps if the caller wants no more.

    Args:
        job: to be carried out.
        work: of its request.
        on_progress: called after each step.
        cancelled: called between the steps.
        executor: carries out the steps; without it they are carried out here.

    Raises:
        RequestError: the request is refused.
        ExecutorError: the executor failed.
        StoreUnavailableError: the database does not answer.
    """

    def compute() -> Message:
        parts, steps = [], work.steps()
        with closing(computed(work, steps, executor, cancelled)) as computing:
            for span, part in zip(steps, computing, strict=True):
                parts.append(part)
                if on_progress is not None and job.progress is not None:
                    on_progress(job.progress.model_copy(update={"done": span[1]}))
        return work.conclude(parts)

    try:
        result, error = outcome_of(compute, (RequestError, ExecutorError, StoreUnavailableError))
    except CancelledWorkError:
        return job.model_copy(update={"state": "cancelled"})
    progress = job.progress and job.progress.model_copy(update={"done": job.progress.total})
    times = {
        "started_at": job.provenance.created_at,
        "ended_at": max(datetime.now(UTC), job.provenance.created_at),
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


def outcome_of(
    compute: Callable[[], Message], passed: tuple[type[Exception], ...] = (RequestError,)
) -> tuple[Message | None, Problem | None]:
    """Return a result, or the problem in its place: the one boundary of a job.

    Args:
        compute: returns the result.
        passed: errors that are no outcome: the request is refused, or the work is done again elsewhere.

    Raises:
        RequestError: the request is refused.
    """
    try:
        return compute(), None
    except passed:
        raise
    except JointstiffError as error:
        return None, problem_of(error)
    except Exception:
        _logger.exception("a job failed unexpectedly")
        return None, unexpected_failure()


def final_state(error: Problem | None) -> JobState:
    """Return the state of a job that ends with this error, or none."""
    return "succeeded" if error is None else "failed"


def unexpected_failure() -> Problem:
    """Return the problem of a fault in the software."""
    return http_problem(
        500, "the computation failed with an internal error", "please report this problem, with the data"
    )


@contextmanager
def as_request_errors(section: str | None = None) -> Iterator[None]:
    """Refuse readings that determine no robot, which are not worth storing.

    Args:
        section: of the request, to which places in messages refer.

    Raises:
        RequestError: in place of errors of the input.
    """
    try:
        yield
    except (InputError, NotObservableError) as error:
        where = ".".join(part for part in (section, error.where) if part)
        raise RequestError(error.reason, remedy=error.remedy, where=where or None) from error
