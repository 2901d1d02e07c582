"""Jobs of every kind as resources. Every job ends; if it fails, its problem is stored as its outcome."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from functools import lru_cache, partial
from types import MappingProxyType
from typing import Any, Final, Protocol

from pydantic import ValidationError
from sqlalchemy import Connection

from jointstiff.schemas.fields import Message, Page
from jointstiff.schemas.finding import ResultSummary
from jointstiff.schemas.job import Job, JobState, JobSummary, Result
from jointstiff.schemas.query import JobQuery
from jointstiff.schemas.run import Run
from jointstiff.schemas.trend import Trend, TrendQuery
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.retired import RETIRED
from jointstiff.service.kinds.width import CancelledWorkError
from jointstiff.service.kinds.work import (
    Span,
    Work,
    carry_out,
    compute_outcome,
    final_state,
    new_job,
    pack_arrays,
    unexpected_failure,
    unpack_arrays,
    watching,
)
from jointstiff.service.live.bridges import TrackerBridges
from jointstiff.service.live.stored import OpenSets
from jointstiff.service.problems import (
    NotFoundError,
    StoreUnavailableError,
    TooManyJobsError,
    WorkerLostError,
    problem_from_error,
)
from jointstiff.service.process import jointstiff_version, versions
from jointstiff.service.resources.stored import Resources
from jointstiff.service.runs.numbers import extract_numbers
from jointstiff.service.runs.trend import Trends, extract_trend_json
from jointstiff.service.store.database import BUSY_SECONDS
from jointstiff.service.store.jobs import JOB, JobStatus
from jointstiff.service.store.layouts import BASELINE, SCHEMA, number_of
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import OPEN_STATES, AccessKey, IdempotencyKey, JobEntry, JobRecord
from jointstiff.solver.comparison.campaigns import check_same_cell, check_same_load
from jointstiff.solver.errors import JointstiffError, RequestError

MAX_OPEN: Final = 1_000
"""Maximum number of unfinished jobs of a kind; concurrent posts may exceed it by a few."""
_BEGUN_ANEW: Final = ", begun anew by version "
"""Words between the activity of a job and the newer version that began the job again."""
_COLUMNS: Final = (
    "measurement_set_id",
    "second_set_id",
    "name",
    "method",
    "weighting",
    "elasticity",
    "verdict",
)
"""Columns of a job's record whose values are fields of its summary with the same names."""
_ROW_FIELDS: Final = frozenset(field.name for field in fields(JobEntry)) - {"summary"}
"""Fields of `JobEntry` that are columns of their own; the others are in its column `summary`."""
_CHANGING_COLUMNS: Final = (
    "state",
    "summary",
    "numbers",
    "schema",
    "key_name",
    "trend",
    "document",
    "elasticity",
    "verdict",
)
"""Columns of a job's record that change until the job ends."""
STEPS_OF_A_PART: Final = 12
"""Number of steps that a worker carries out before it checks whether another part has priority."""
PART_SECONDS: Final = 1.25
"""Time after which a worker leaves the other steps of a part, if other jobs wait for a worker [s]."""
PARTS_AT_ONCE: Final = 8
"""Number of parts of a job in the queue at a time; a part that ends puts a further part into the queue."""
OTHER_VERSION_SECONDS: Final = 2.0
"""Time after which a part is offered again that a newer version of the program has to carry out [s]."""
CANCEL_SECONDS: Final = 2.0
"""Time that a request to cancel a job waits for a worker that has locked the job; the worker may hang [s]."""
_NO_CHANGES: Final[Mapping[str, object]] = MappingProxyType({})

_logger = logging.getLogger(__name__)

Enqueue = Callable[[Connection, str], object]
"""Function that puts a job, given its id, into the queue of workers, in the transaction that stores it."""


@dataclass(frozen=True, slots=True)
class Part:
    """A group of consecutive steps of a job that one worker carries out."""

    job_id: str
    number: int  # number of the part within the job, from 0
    kept: int  # number of the part's steps that had a stored result when the part was put into the queue
    # Number of times that a worker handed the part back, as a lock was not available
    delays: int = field(default=0, compare=False)


class PartQueue(Protocol):
    """Queue in which parts of jobs (groups of steps) wait for workers."""

    def add_following_parts(self, job_id: str, parts: Iterable[Part]) -> object:
        """Add parts of a running job to the queue, except parts that are in the queue already."""

    def offer_again(self, parts: Iterable[Part], delay_seconds: float = 0.0) -> object:
        """Offer parts to all workers after a time, even parts that were carried out before."""

    def others_wait(self, job_id: str) -> bool:
        """Return whether parts of jobs other than this job wait for a worker."""
        ...


class Jobs:
    """The jobs of one kind in a store. Quick jobs are computed at once; workers may compute long jobs."""

    def __init__(self, kind: AnyKind, resources: Resources, enqueue: Enqueue | None = None) -> None:
        """Serve the jobs of a store.

        Args:
            kind: kind of the jobs.
            resources: robots, measurement sets and jobs of the store.
            enqueue: function that leaves a long job to workers; None to compute every job at once.
        """
        self.kind = kind
        self.records = resources.store.jobs(kind.resource)
        # Function: id of a stored job → its work; cached, as each part of a job needs the work.
        self.work: Callable[[str], Any] = lru_cache(maxsize=4)(self._load_work)
        self._inputs = resources
        self._enqueue = enqueue

    def create(
        self, request: Message, key: IdempotencyKey | None, requester_key: AccessKey | None = None
    ) -> JobRecord:
        """Store a new job and return its record; if there are workers, a long job is left to them.

        Args:
            request: request of the work.
            key: idempotency key; if it was used before with the same body, the job created then is returned.
            requester_key: access key of the requester; None if access is open.

        Raises:
            RequestError: a requested resource does not exist, or the readings cannot support the request.
                Nothing is stored then.
            IdempotencyConflictError: the key was used before with another body.
            TooManyJobsError: `MAX_OPEN` jobs of this kind have not ended.
        """
        if key is not None and (earlier_record := self.records.find(key)) is not None:
            return earlier_record
        work = self.kind.prepare_work(self._inputs, request)
        job = new_job(self.kind.message, request, work, requester_key)
        enqueue = self._enqueue
        is_long = job.progress is not None  # only jobs that are cut into steps have a progress
        if not is_long or enqueue is None:
            ended_job = carry_out(job, work)
            return self.records.add(make_record(self.kind, ended_job, work.robot_id), key)
        if len(self.records.open_jobs()) >= MAX_OPEN:
            raise TooManyJobsError(self.kind.resource, MAX_OPEN)
        return self.records.add(
            make_record(self.kind, job, work.robot_id),
            key,
            lambda connection: enqueue(connection, job.id),
        )

    def current(self, job_id: str) -> Job:
        """Return the present state of a job; a job that has not ended has its progress.

        Raises:
            NotFoundError: no job has this id.
        """
        return self._with_progress(self.records.get(job_id))

    def to_answer_json(self, record: JobRecord) -> str:
        """Return a stored job as the JSON of the API; a job that has not ended has its progress."""
        is_active = record.state in OPEN_STATES
        return self.kind.to_answer(
            self._with_progress(record).model_dump_json() if is_active else record.document
        )

    def cancel(self, job_id: str) -> Job:
        """Cancel a job and return the job; nothing changes if the job has ended.

        Raises:
            NotFoundError: no job has this id.
            StoreUnavailableError: a worker keeps the job locked; cancel the job again.
        """
        job = self.current(job_id)
        if job.state in OPEN_STATES:
            self._end_job(job_id, "cancelled", lock_timeout=CANCEL_SECONDS)
        return self.current(job_id)

    def mark_running(self, job_id: str) -> None:
        """Set the state of a queued job to running, and its start to the present time."""
        record = self.records.get(job_id)
        job = self._read_job(record)
        # The clock of this machine may be behind the clock of the machine that created the job.
        start = max(datetime.now(UTC), job.provenance.created_at)
        provenance = job.provenance.model_copy(update={"started_at": start})
        job = job.model_copy(update={"state": "running", "provenance": provenance})
        self.records.start(job_id, self._changing_columns(job, record.robot_id))

    def carry_out(self, part: Part, queue: PartQueue) -> None:
        """Carry out the steps of a part of a job, and store the result of each step.

        A part is a group of `STEPS_OF_A_PART` steps, so that several workers share a job. A part may be
        carried out again: steps with a stored result are skipped. The part after which all steps of the job
        have results ends the job.

        Args:
            part: the part that a worker claimed.
            queue: queue to which later parts are added, and the rest of this part if other jobs wait.

        Raises:
            JointstiffError: a step cannot be computed; the caller lets the job fail.
            NotFoundError: the job was removed.
        """
        if not self.records.is_active(part.job_id):
            return
        steps = self.work(part.job_id).steps()
        part_count = -(-len(steps) // STEPS_OF_A_PART)  # rounded up
        is_first_attempt = part.number == part.kept == 0
        if is_first_attempt:
            self.mark_running(part.job_id)
            self._add_first_parts(part.job_id, part_count, queue)
        if not self._settle_version(part, part_count, queue):
            return
        first = part.number * STEPS_OF_A_PART
        if not self._compute_steps(part, steps[first : first + STEPS_OF_A_PART], queue):
            return
        next_number = part.number + PARTS_AT_ONCE
        if next_number < part_count:
            queue.add_following_parts(part.job_id, [Part(part.job_id, next_number, 0)])
        self._conclude_if_complete(part.job_id, len(steps))

    def _add_first_parts(self, job_id: str, part_count: int, queue: PartQueue) -> None:
        """Add the parts that may be computed at once to the queue, which has only part 0 of a new job."""
        numbers = range(1, min(PARTS_AT_ONCE, part_count))
        queue.add_following_parts(job_id, [Part(job_id, number, 0) for number in numbers])

    def _compute_steps(self, part: Part, steps: Sequence[Span], queue: PartQueue) -> bool:
        """Compute and store the steps of a part that have no stored result; return whether all have one now.

        A step is a span (first unit, one past the last); its first unit identifies the stored result. The
        rest of the part is put back into the queue if other jobs have waited long enough.

        If an earlier worker stored results of this part and then died, the rest becomes a new entry of the
        queue, too: the queue gives up an entry after a number of dead workers, and counts them anew for a new
        entry.
        """
        stored_steps = self._inputs.store.steps
        stored_starts = stored_steps.done_starts(part.job_id)
        remaining = [span for span in steps if span[0] not in stored_starts]
        stored_count = len(steps) - len(remaining)
        deadline = time.monotonic() + PART_SECONDS
        for span in remaining:
            must_yield = time.monotonic() >= deadline and queue.others_wait(part.job_id)
            if stored_count > part.kept and (span is remaining[0] or must_yield):
                queue.add_following_parts(part.job_id, [Part(part.job_id, part.number, stored_count)])
                return False
            result = pack_arrays(self.work(part.job_id).compute(span))
            if not stored_steps.store_result(part.job_id, span, result):
                self._leave_to_one_version(part, queue)
                return False
            stored_count += 1
        return True

    def _settle_version(self, part: Part, part_count: int, queue: PartQueue) -> bool:
        """Let one version compute all steps of a job: the newest of those that work on the job.

        The newer version removes the results of an older version, and offers all parts again.

        Returns:
            False if a newer version works on the job: the part is offered again, for its workers to take.
        """
        steps, version = self._inputs.store.steps, jointstiff_version()
        others = steps.list_versions(part.job_id) - {version}
        if any(_order_version(other) > _order_version(version) for other in others):
            queue.offer_again([part], OTHER_VERSION_SECONDS)
            return False
        if others:
            steps.keep_version(part.job_id, version)
            self._note_restart(part.job_id, version)
            numbers = [number for number in range(part_count) if number != part.number]
            queue.offer_again([Part(part.job_id, number, 0) for number in numbers])
        return True

    def _note_restart(self, job_id: str, version: str) -> None:
        """Let the activity of a job say why its progress has fallen."""
        record = self.records.get(job_id)
        job = self._read_job(record)
        if job.progress is None:
            return
        activity, _, _ = job.progress.activity.partition(_BEGUN_ANEW)  # of an earlier restart
        progress = job.progress.model_copy(update={"activity": f"{activity}{_BEGUN_ANEW}{version}"})
        changed = job.model_copy(update={"progress": progress})
        self.records.note(job_id, self._changing_columns(changed, record.robot_id))

    def _note_activity(self, job_id: str, activity: str) -> None:
        """Let the progress of a job say what is done."""
        record = self.records.get(job_id)
        job = self._read_job(record)
        if job.progress is not None:
            progress = job.progress.model_copy(update={"activity": activity})
            changed = job.model_copy(update={"progress": progress})
            self.records.note(job_id, self._changing_columns(changed, record.robot_id))

    def _leave_to_one_version(self, part: Part, queue: PartQueue) -> None:
        """Offer a part again whose step was not stored; do nothing if the job has ended."""
        if self.records.is_active(part.job_id):  # another version has stored steps meanwhile
            queue.offer_again([part])

    def _conclude_if_complete(self, job_id: str, step_count: int) -> None:
        """End a job if all its steps have stored results."""
        stored_steps = self._inputs.store.steps
        if len(stored_steps.done_starts(job_id)) < step_count:
            return
        results = stored_steps.results(job_id)
        # Another worker may have ended the job meanwhile, which removes the results: then some are missing.
        if len(results) == step_count:
            self.conclude(job_id, results)

    def conclude(self, job_id: str, computed: Sequence[bytes]) -> None:
        """Compute the result of a job from the results of its steps, and end the job.

        `computed` are the packed results of all steps, in the order of the steps.

        Raises:
            MemoryError: this process has too little memory; another worker may have enough.
        """
        work = self.work(job_id)

        def compute() -> Message:
            """Compute the result, and note each part of the conclusion that begins."""
            with watching(partial(self._note_part_of_conclusion, job_id)):
                concluded: Message = work.conclude([unpack_arrays(content) for content in computed])
            return concluded

        try:
            passed = (RequestError, MemoryError, StoreUnavailableError)
            result, error = compute_outcome(compute, passed)
        except CancelledWorkError:
            return  # the job has ended as cancelled
        provenance = {"versions": dict(versions())}
        self._end_job(job_id, final_state(error), {"result": result, "error": error}, provenance)

    def _note_part_of_conclusion(self, job_id: str, activity: str) -> None:
        """Let the progress of a job state the part of the conclusion that begins.

        Raises:
            CancelledWorkError: the job has ended.
        """
        if not self.records.is_active(job_id):
            raise CancelledWorkError
        self._note_activity(job_id, activity)

    def fail(self, job_id: str, failure: Exception) -> None:
        """End a job as failed, with the problem details of an exception; do nothing if the job has ended."""
        if not self.records.is_active(job_id):
            return
        if isinstance(failure, JointstiffError | WorkerLostError):
            error = problem_from_error(failure)
        else:
            _logger.error("a %s failed unexpectedly", self.kind.name, exc_info=failure)
            error = unexpected_failure()
        self._end_job(job_id, "failed", {"error": error})

    def _with_progress(self, record: JobRecord) -> Job:
        """Return the job of a record; the progress of a running job is counted from its stored steps."""
        job = self._read_job(record)
        if record.state not in OPEN_STATES or job.progress is None:
            return job
        status = self.records.status(record.id)
        if status is None or not status.is_active:  # the job has ended meanwhile, which removed its steps
            return self._read_job(self.records.get(record.id, include_deleted=True))
        return self.update_progress(job, status)

    def update_progress(self, job: Job, status: JobStatus) -> Job:
        """Return a job with the state and the progress of a newer status, and why it does not move."""
        waits = self._inputs.find_reason(job.id) if status.is_active else None
        progress = job.progress and job.progress.model_copy(update={"done": status.done, "waits": waits})
        return job.model_copy(update={"state": status.state, "progress": progress})

    def _read_job(self, record: JobRecord) -> Job:
        """Return the job that the JSON of its record describes."""
        job: Job = self.kind.message.model_validate_json(record.document)
        return job

    def _load_work(self, job_id: str) -> Work:
        """Prepare the work of a stored job from its request."""
        return self.kind.prepare_work(self._inputs, self.current(job_id).request)

    def _changing_columns(self, job: Job, robot_id: str | None) -> dict[str, Any]:
        """Return the columns of a job's record that change until the job ends, with their values."""
        record = make_record(self.kind, job, robot_id)
        return {name: getattr(record, name) for name in _CHANGING_COLUMNS}

    def _end_job(
        self,
        job_id: str,
        state: JobState,
        changes: Mapping[str, object] = _NO_CHANGES,
        provenance: Mapping[str, object] = _NO_CHANGES,
        lock_timeout: float = BUSY_SECONDS,
    ) -> None:
        """End a job in a final state, and store the end in its record.

        Args:
            job_id: id of the job.
            state: final state.
            changes: fields of the job to set.
            provenance: fields of the job's provenance to set, in addition to the time of the end.
            lock_timeout: time to wait for a worker that has locked the job [s].
        """

        def final_columns(before: JobRecord, done_units: int) -> dict[str, Any]:
            """Return column → new value of the record of the job, given the record and the units done."""
            try:
                job = self._read_job(before)
            except ValidationError:
                # The document is damaged; the job ends without it, so that no worker tries it again.
                return {"state": state}
            start = job.provenance.started_at or job.provenance.created_at
            # The clock may have been set back since the job began: a job must not end before its start.
            provenance_changes = {"ended_at": max(datetime.now(UTC), start), **provenance}
            fields_of_end = {
                "state": state,
                "progress": job.progress and job.progress.model_copy(update={"done": done_units}),
                "provenance": job.provenance.model_copy(update=provenance_changes),
            }
            ended_job = job.model_copy(update={**changes, **fields_of_end})
            return self._changing_columns(ended_job, before.robot_id)

        self.records.end(job_id, state, final_columns, lock_timeout)


_VERSION: Final = re.compile(r"(?P<release>\d+(\.\d+)*)(?P<stage>a|b|rc|\.dev)?", re.ASCII)
_STAGES: Final = {".dev": 0, "a": 1, "b": 2, "rc": 3, None: 4}
"""Stage of a version (PEP 440) → its place: a release is newer than its candidates."""


@dataclass(frozen=True, order=True)
class _Age:
    """Key that orders versions from the oldest to the newest.

    Two different versions never have equal keys: each would begin a job again that the other began.
    """

    release: tuple[int, ...] = ()
    stage: int = 0
    numbers: tuple[int, ...] = ()  # all numbers of the version, which order versions of one stage
    text: str = ""


def _order_version(version: str | None) -> _Age:
    """Return the key of a version; None is the oldest version."""
    found = _VERSION.match(version or "")
    if version is None or found is None:
        return _Age(text=version or "")
    release = tuple(map(int, found["release"].split(".")))
    numbers = tuple(map(int, re.findall(r"[0-9]+", version)))
    return _Age(release, _STAGES[found["stage"]], numbers, version)


def make_record(kind: AnyKind, job: Job, robot_id: str | None) -> JobRecord:
    """Return the record of a job: its message as JSON, and the columns that listings search and show."""
    summary = summarize_job(job, robot_id)
    return JobRecord(
        id=job.id,
        kind=kind.name,
        state=job.state,
        created_at=job.provenance.created_at,
        summary=summary.model_dump(mode="json", exclude_defaults=True, exclude=set(_ROW_FIELDS)),
        robot_id=robot_id,
        # An older program may end a job that has not ended, and would store the document in its own form.
        schema=number_of(BASELINE) if job.state in OPEN_STATES else SCHEMA,
        key_name=job.key_name,
        numbers=extract_numbers(job) if isinstance(job, Run) else None,
        trend=extract_trend_json(job) if isinstance(job, Run) else None,
        document=job.model_dump_json(),
        **{name: getattr(summary, name) for name in _COLUMNS},
    )


def summarize_job(job: Job, robot_id: str | None) -> JobSummary:
    """Return the summary of a job for listings, without the names of its robot and its measurement set.

    Each field is taken from the first object that has the field: job, request, provenance, or the
    summary of the result.
    """
    result = job.result.summary if isinstance(job.result, Result) else ResultSummary()
    sources = (job, job.request, job.provenance, result)
    fields = {
        name: next(getattr(source, name) for source in sources if hasattr(source, name))
        for name in JobSummary.model_fields
        if any(hasattr(source, name) for source in sources)
    }
    return JobSummary.model_validate(fields | {"robot_id": robot_id})


def summary_from_row(entry: JobEntry) -> JobSummary:
    """Return the summary of a job, made from its row in a listing."""
    columns = {name: getattr(entry, name) for name in _ROW_FIELDS}
    return JobSummary.model_validate(entry.summary | columns)


class Parts(Resources):
    """All that the application serves from one store: resources, jobs, trends and live measurement sets."""

    def __init__(self, store: Store, enqueue: Enqueue | None = None) -> None:
        """Serve from a store; if `enqueue` is None, every job is computed at once."""
        super().__init__(store)
        self.jobs = {kind.name: Jobs(kind, self, enqueue) for kind in (*KINDS, *RETIRED)}  # by name
        self._records = store.jobs(JOB)
        self.trends = Trends(store)  # trends of the robots
        # The live campaigns: closing a campaign creates a run.
        self.live = OpenSets(self, lambda *run: self.jobs["run"].create(*run).id)
        self.bridges = TrackerBridges(store, self.live.is_open)  # from trackers to pages

    def trend(self, robot_id: str, query: TrendQuery) -> Trend:
        """Return the trend of a robot.

        Raises:
            NotFoundError: there is no such robot.
            RequestError: the campaigns cannot have the same load point or the same cell.
        """
        trend = self.trends.trend(robot_id, query)
        is_same = query.same_load or query.same_cell
        if is_same and trend.campaigns:
            sets = [self.sets.prepared(each.measurement_set_id) for each in trend.campaigns]
            measured = [each.measurements for each in sets]
            if query.same_load:
                check_same_load(measured)
            if query.same_cell:
                check_same_cell(measured)
        return trend

    def jobs_of(self, job_id: str) -> Jobs:
        """Return the jobs of the kind of a job, given its id; the job may be deleted.

        Raises:
            NotFoundError: no job has this id.
        """
        kind = self.store.kind_of_job(job_id)
        if kind is None:
            raise NotFoundError(JOB, job_id)
        return self.jobs[kind]

    def job(self, job_id: str, *, hidden: bool = False) -> str:
        """Return a job of any kind as the JSON of the API; with `hidden` also a deleted job.

        Raises:
            NotFoundError: no job has this id.
        """
        record = self._records.get(job_id, include_deleted=hidden)
        return self.jobs[record.kind].to_answer_json(record)

    def page(self, query: JobQuery) -> Page[JobSummary]:
        """Return one page of the jobs of all kinds, in the order of the query.

        Raises:
            CursorError: the cursor of the query was not returned by an earlier page.
        """
        page = self._records.page(**query.listing_arguments())
        return Page(
            items=[summary_from_row(entry) for entry in page.records], next=page.next, total=page.total
        )
