"""Jobs as resources, of whatever kind: every job ends, and a failure is a stored result."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final, Generic
from uuid import uuid4

from pydantic import BaseModel
from sqlalchemy import Connection

from jointstiff.schemas.job import JobState, Progress, Provenance
from jointstiff.schemas.problem import Problem
from jointstiff.service.jobs.kinds import Kind, Message, Opening, Request
from jointstiff.service.jobs.work import Part, Work
from jointstiff.service.problems import http_problem, problem_of
from jointstiff.service.store import (
    OPEN_STATES,
    IdempotencyKey,
    JobRecord,
    NotFoundError,
    Standing,
    Store,
    TooManyJobsError,
)
from jointstiff.service.versions import versions
from jointstiff.solver.errors import JointstiffError, RequestError

__all__ = ["Announce", "AnyJobs", "Jobs"]

MAX_OPEN: Final = 1_000
"""Jobs of a kind that wait or are carried out; as many look at the same time and a few more may get in."""

_NONE: Final[Mapping[str, object]] = MappingProxyType({})

_logger = logging.getLogger(__name__)

Announce = Callable[[Connection, str, str], object]
"""Announces a job (kind, id) to those who carry it out, in the transaction that stores it."""


class Jobs(Generic[Request, Message, JobRecord]):
    """The jobs of one kind in a store. Quick ones are carried out at once, others may be left to workers.

    Attributes:
        kind: what they are.
        log: what changes about them until they end.
        deletions: how they are deleted and brought back.
        work: what a stored job takes, for those who carry it out.
    """

    def __init__(
        self,
        kind: Kind[Request, Message, JobRecord],
        store: Store,
        announce: Announce | None = None,
        tell: Callable[[Progress], object] | None = None,
    ) -> None:
        """Serve the jobs of a store.

        Args:
            kind: what they are.
            store: where they are kept.
            announce: announces long ones to workers; without it every job is carried out at once.
            tell: told of the progress of a job while it is carried out here.
        """
        self.kind: Kind[Request, Message, JobRecord] = kind
        self.log = store.job_log(kind.record)
        self.deletions = store.deletions(kind.record)
        self.work = lru_cache(maxsize=4)(self._work)
        self._store = store
        self._announce = announce
        self._tell = tell

    def create(self, request: Request, key: IdempotencyKey | None) -> JobRecord:
        """Store a job: carried out, or announced if it takes long and there are workers.

        Raises:
            RequestError: what is asked for does not exist, or the readings cannot support it.
                Nothing is stored then.
            IdempotencyConflictError: the key came before with another body.
            TooManyJobsError: `MAX_OPEN` of them go on.
        """
        if key is not None and (before := self._store.find(self.kind.record, key)) is not None:
            return before
        work = self.kind.work(request)
        job = self._queued(request, work)
        if job.progress is None or self._announce is None:
            ended = self._carried_out(job, work)
            return self._store.add(self.kind.row(ended, work.robot_id), key)
        if len(self.log.open_jobs()) >= MAX_OPEN:
            raise TooManyJobsError(self.kind.record, MAX_OPEN)
        announce = self._announce
        return self._store.add(
            self.kind.row(job, work.robot_id),
            key,
            lambda connection: announce(connection, self.kind.name, job.id),
        )

    def current(self, job_id: str) -> Message:
        """A job as it is now, with its progress while it goes on.

        Raises:
            NotFoundError: there is no such job.
        """
        return self._as_now(self._store.get(self.kind.record, job_id))

    def document(self, job_id: str) -> str:
        """The same as JSON: that of a job that has ended, as it was stored.

        Raises:
            NotFoundError: there is no such job.
        """
        record = self._store.get(self.kind.record, job_id)
        if record.state in OPEN_STATES:
            return self._as_now(record).model_dump_json()
        return record.document

    def standing(self, job_id: str) -> Standing:
        """State and progress of a job, without a look at its document.

        Raises:
            NotFoundError: there is no such job.
        """
        self._refuse_odd(job_id)
        found = self.log.standing(job_id)
        if found is None:
            raise NotFoundError(self.kind.record, job_id)
        return found

    def standings(self, job_ids: Collection[str]) -> Mapping[str, Standing]:
        """Return state and progress of those of some jobs that exist, by id."""
        return self.log.standings(job_ids)

    def cancel(self, job_id: str) -> Message:
        """End a job where it stands; a job that has ended stays as it is.

        Raises:
            NotFoundError: there is no such job.
        """
        job = self.current(job_id)
        if job.state in OPEN_STATES:
            self._end(job_id, "cancelled")
        return self.current(job_id)

    def delete(self, job_id: str) -> None:
        """Hide a job that has ended from all who ask for it; to do so again changes nothing.

        Raises:
            NotFoundError: there is no such job.
            NotEndedError: it goes on.
        """
        self._refuse_odd(job_id)
        self.deletions.delete(job_id, datetime.now(UTC))

    def restore(self, job_id: str) -> str:
        """Bring a deleted job back; to do so again changes nothing.

        Returns:
            The job as JSON.

        Raises:
            NotFoundError: there is no such job, or it has been removed for good.
        """
        self._refuse_odd(job_id)
        self.deletions.restore(job_id)
        return self.document(job_id)

    def goes_on(self, job_id: str) -> bool:
        """Whether a job has not ended."""
        return self.log.state(job_id) in OPEN_STATES

    def start(self, job_id: str) -> None:
        """A job is being carried out from now on."""
        job = self.current(job_id)
        started = job.provenance.model_copy(update={"started_at": datetime.now(UTC)})
        job = job.model_copy(update={"state": "running", "provenance": started})
        self.log.start(job_id, job.model_dump_json())

    def conclude(self, job_id: str, computed: Sequence[str]) -> None:
        """Put a job together from the encoded results of all its steps, in order, and end it."""
        work = self.work(job_id)
        result, error = _outcome(lambda: work.conclude([work.decode(text) for text in computed]))
        self._end(job_id, _final(error), {"result": result, "error": error}, {"versions": dict(versions())})

    def fail(self, job_id: str, failure: Exception) -> None:
        """End a job whose steps failed; one that has ended, and may be deleted, stays as it is."""
        if not self.goes_on(job_id):
            return
        if isinstance(failure, JointstiffError):
            error = problem_of(failure)
        else:
            _logger.error("a %s failed unexpectedly", self.kind.name, exc_info=failure)
            error = _unexpected()
        self._end(job_id, "failed", {"error": error})

    def is_computed(self, job_id: str) -> bool:
        """Whether all steps of a job that goes on are done, and its result is being put together."""
        progress = self.current(job_id).progress
        return progress is not None and progress.done >= progress.total

    def _as_now(self, record: JobRecord) -> Message:
        job = self.kind.read(record.document)
        if record.state not in OPEN_STATES or job.progress is None:
            return job
        progress = job.progress.model_copy(update={"done": self.log.done(record.id)})
        return job.model_copy(update={"state": record.state, "progress": progress})

    def _refuse_odd(self, job_id: str) -> None:
        """Ids are ours: what a database may not even take as a text is none."""
        if not (job_id.isascii() and job_id.isprintable()):
            raise NotFoundError(self.kind.record, job_id)

    def _work(self, job_id: str) -> Work[Any]:
        return self.kind.work(self.current(job_id).request)

    def _queued(self, request: Request, work: Work[Any]) -> Message:
        steps = work.steps()
        progress = None
        if steps:
            unit, activity = work.unit or self.kind.unit, work.activity or self.kind.activity
            progress = Progress(done=0, total=steps[-1][1], unit=unit, activity=activity)
        provenance = Provenance(
            versions=dict(versions()),
            input_hash=work.input_hash(request),
            created_at=datetime.now(UTC),
            started_at=None,
            ended_at=None,
        )
        return self.kind.queued(Opening(uuid4().hex, progress, provenance), request)

    def _carried_out(self, job: Message, work: Work[Any]) -> Message:
        """The job, carried out here and now."""
        result, error = _outcome(lambda: work.conclude(list(self._computed(job, work))))
        progress = job.progress.model_copy(update={"done": job.progress.total}) if job.progress else None
        times = {"started_at": job.provenance.created_at, "ended_at": datetime.now(UTC)}
        return job.model_copy(
            update={
                "state": _final(error),
                "progress": progress,
                "result": result,
                "error": error,
                "provenance": job.provenance.model_copy(update=times),
            }
        )

    def _computed(self, job: Message, work: Work[Part]) -> Iterator[Part]:
        for span in work.steps():
            yield work.compute(span)
            if self._tell is not None and job.progress is not None:
                self._tell(job.progress.model_copy(update={"done": span[1]}))

    def _end(
        self,
        job_id: str,
        state: JobState,
        changes: Mapping[str, object] = _NONE,
        provenance: Mapping[str, object] = _NONE,
    ) -> None:
        """End a job as it is then: what others wrote of it meanwhile is kept."""
        last = {"ended_at": datetime.now(UTC), **provenance}

        def document(before: str, done: int) -> str:
            job = self.kind.read(before)
            always = {
                "state": state,
                "progress": job.progress and job.progress.model_copy(update={"done": done}),
                "provenance": job.provenance.model_copy(update=last),
            }
            return job.model_copy(update={**changes, **always}).model_dump_json()

        self.log.end(job_id, state, document)


AnyJobs = Jobs[Any, Any, Any]


def _outcome(conclude: Callable[[], BaseModel]) -> tuple[BaseModel | None, Problem | None]:
    """The one boundary of a job: whatever happens beyond a refused request becomes its result."""
    try:
        return conclude(), None
    except RequestError:
        raise
    except JointstiffError as error:
        return None, problem_of(error)
    except Exception:
        _logger.exception("a job failed unexpectedly")
        return None, _unexpected()


def _final(error: Problem | None) -> JobState:
    return "succeeded" if error is None else "failed"


def _unexpected() -> Problem:
    return http_problem(500, "the computation failed unexpectedly", "report it with the data")
