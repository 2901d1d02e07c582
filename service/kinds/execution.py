"""Execution of a request to the message of a finished job, with its provenance. No store."""

from __future__ import annotations

import logging
from collections.abc import Callable
from datetime import UTC, datetime
from typing import TypeVar
from uuid import uuid4

from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Job, JobState, Progress, Provenance, Requester
from jointstiff.schemas.problem import Problem
from jointstiff.service.kinds.work import QuickWork, Work
from jointstiff.service.problems.table import http_problem, problem_of
from jointstiff.service.versions import versions
from jointstiff.solver.errors import JointstiffError, RequestError

AnyJob = TypeVar("AnyJob", bound=Job)
OnProgress = Callable[[Progress], object]

_logger = logging.getLogger(__name__)


def new_job(
    message: type[AnyJob], request: Message, work: Work, requested_by: Requester | None = None
) -> AnyJob:
    """Return a queued job; without progress if it is carried out at once."""
    progress, details = None, {}
    if isinstance(work, QuickWork):
        details = dict(work.details)
    elif steps := work.steps():
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
            "requested_by": requested_by,
            **details,
        }
    )


def carry_out(job: AnyJob, work: Work, on_progress: OnProgress | None = None) -> AnyJob:
    """Return a job carried out here and now.

    Raises:
        RequestError: the request is refused.
    """

    def compute() -> Message:
        if isinstance(work, QuickWork):
            return work.compute()
        parts = []
        for span in work.steps():
            parts.append(work.compute(span))
            if on_progress is not None and job.progress is not None:
                on_progress(job.progress.model_copy(update={"done": span[1]}))
        return work.conclude(parts)

    result, error = outcome_of(compute)
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


def outcome_of(compute: Callable[[], Message]) -> tuple[Message | None, Problem | None]:
    """Return a result, or the problem in its place: the one boundary of a job.

    Raises:
        RequestError: the request is refused.
    """
    try:
        return compute(), None
    except RequestError:
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
