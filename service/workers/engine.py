"""Durable execution of long jobs on DBOS Transact: enqueued by the service, carried out by workers.

A job is a workflow; its steps are shared out to workflows of their own, its parts, so that any number of
workers can take part, and none is kept from other jobs for long. What a step computed is kept before the
next one begins. Steps may be carried out twice: they only compute, what they report of a job is safe to
repeat, and the end of a job is written once. Who goes on with what a dead worker left is
`jointstiff.service.workers.worker`'s to see to.

The engine's tables are its own, beside the store's in the same database; only its public client is asked.
Data in them are JSON, and never an object that would run code when it is read: the engine pickles unless it
is told otherwise, and reads what a row calls a pickle whatever serializer it was given, so that who can write
the database, or hands over a backup, could run code in the workers.
"""

from __future__ import annotations

import json
import logging
import os
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from functools import wraps
from itertools import chain
from math import ceil
from typing import Any, Final, NoReturn, ParamSpec, TypeVar

from dbos import DBOS, DBOSClient, DBOSConfig, EnqueueOptions, Serializer, SetEnqueueOptions, WorkflowStatus
from dbos._serialization import DefaultSerializer
from sqlalchemy import Connection, make_url
from sqlalchemy.exc import InterfaceError, OperationalError, SQLAlchemyError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from jointstiff.service.jobs import Jobs
from jointstiff.service.kinds.work import Span, pack
from jointstiff.service.problems import FilesError, ItemsError, StoreError, StoreUnavailableError
from jointstiff.service.store.database import Database
from jointstiff.service.store.store import Store
from jointstiff.solver.errors import JointstiffError

QUEUES: Final = {"job": "jointstiff-jobs", "part": "jointstiff-parts"}  # of each kind of workflow
APPLICATION: Final = "jointstiff"
APPLICATION_VERSION: Final = "1"
"""The engine's own word for who may carry on what: all workers of a database, which has one version."""
_ASKED: Final = 10_000  # jobs asked for in one query: databases take no number of parameters
_ENDED: Final = ["SUCCESS", "ERROR", "MAX_RECOVERY_ATTEMPTS_EXCEEDED", "CANCELLED"]
_PARTS: Final = 8  # of a job at least, as long as it has so many steps: work for as many workers
_STEPS: Final = 20  # of a part at most, five seconds: only between two does a worker turn to another job
_FIRST: Final = 8  # parts of a job that go before what is left of longer ones: small jobs do not wait for it
_AT_ONCE: Final = {"job": 16, "part": 1}
"""A worker waits for some jobs, and computes one part: work for one processor."""
_ATTEMPTS: Final = 10_000
"""Times that the engine begins a workflow: it counts every restart, the recovery those without progress."""
_POLL_SECONDS: Final = {"job": 0.4, "part": 0.2}
"""Between two looks into a queue, each a few milliseconds that the computing has less."""
_WAIT_SECONDS: Final = 0.2  # between two looks at a part that a job waits for
_FIRST_PAUSE: Final = 0.1
_LONGEST_PAUSE: Final = 5.0
_DATABASE_ERRORS: Final = (OperationalError, InterfaceError, PoolTimeoutError)
_RAISED: Final = "raised"

P = ParamSpec("P")
R = TypeVar("R")

# The engine says on each start that a cloud service could be had, and on each retry what it does.
logging.getLogger("dbos").setLevel(logging.CRITICAL)


class JobQueue:
    """Records that the engine keeps of the jobs of a store."""

    def __init__(self, store: Store, database: str) -> None:
        """Connect to the engine's tables, making them if need be.

        Raises:
            StoreError: the engine's tables cannot be made or used.
        """
        url, schema = engine_url(database), schema_of(store)
        refuse_pickles()
        with as_store_errors():
            DBOS.migrate(url, schema=schema)
            self._client = DBOSClient(
                system_database_url=url,
                dbos_system_schema=schema,
                application_name=APPLICATION,
                serializer=JsonSerializer(),
            )

    def close(self) -> None:
        """Disconnect."""
        self._client.destroy()

    def _workflows(self, **which: Any) -> list[WorkflowStatus]:  # noqa: ANN401 - what the client takes
        return self._client.list_workflows(**which, load_input=False, load_output=False)

    def enqueue(self, connection: Connection, kind: str, job_id: str) -> None:
        """Enqueue a job in the transaction that stores it: both are there, or neither is."""
        announcement: EnqueueOptions = {
            "queue_name": QUEUES["job"],
            "workflow_name": "job",
            "workflow_id": job_id,
            "app_version": APPLICATION_VERSION,
        }
        self._client.enqueue_in_transaction(connection, announcement, kind, job_id)

    def pending(self) -> dict[str, tuple[str, str]]:
        """Workflows that a worker has taken and not ended: id → kind, executor."""
        workflows = self._workflows(status="PENDING")
        return {each.workflow_id: (each.name, str(each.executor_id)) for each in workflows}

    def has_parts(self, job_id: str) -> bool:
        """Return whether a job was shared out to parts."""
        some = self._workflows(workflow_id_prefix=f"{job_id}-", limit=1)
        return bool(some)

    def resume(self, workflows: Iterable[tuple[str, str]]) -> None:
        """Put workflows (id, kind) back into their queues; whoever still carries one out, loses it."""
        for identifier, kind in workflows:
            self._client.resume_workflows([identifier], queue_name=QUEUES[kind])

    def statuses(self, job_ids: list[str]) -> dict[str, str]:
        """Return the engine's status of the workflows of some jobs; those that are not there are left out."""
        states = {}
        for first in range(0, len(job_ids), _ASKED):
            some = job_ids[first : first + _ASKED]
            for each in self._workflows(workflow_ids=some):
                states[each.workflow_id] = str(each.status)
        return states

    def forget_ended(self, age: timedelta, limit: int) -> list[str]:
        """Remove what the steps of ended jobs computed.

        Args:
            age: how long ago their workflow ended, at least.
            limit: jobs at most.

        Returns:
            Ids of the jobs.
        """
        workflows = self._workflows(
            name="job",
            status=_ENDED,
            completed_before=(datetime.now(UTC) - age).isoformat(),
            limit=limit,
        )
        identifiers = [each.workflow_id for each in workflows]
        if identifiers:
            self._client.delete_workflows(identifiers, delete_children=True)
        return identifiers


def is_ended(status: str) -> bool:
    """Return whether a workflow of that status goes on no more."""
    return status in _ENDED


def job_of(workflow_id: str) -> str:
    """The job that a workflow, of the job or of one of its parts, belongs to."""
    return workflow_id.partition("-")[0]


def engine_url(database: str) -> str:
    """The store's URL as the engine reads it.

    Raises:
        StoreError: the database is in the memory of one process, and workers are others.
    """
    url = make_url(database)
    if url.get_backend_name() == "sqlite" and url.database in {None, "", ":memory:"}:
        raise StoreError(
            "an in-memory database cannot be shared with workers",
            "use a file: --database sqlite:///jointstiff.db",
        )
    if url.get_backend_name() == "postgresql":
        url = url.set(drivername="postgresql")
    return url.render_as_string(hide_password=False)


def schema_of(store: Store | Database) -> str:
    """The engine's schema on PostgreSQL: one for each schema of a store, as jobs have no other namespace."""
    schema = store.schema()
    return "dbos" if schema in {None, "public"} else f"dbos_{schema}"


@contextmanager
def as_store_errors() -> Iterator[None]:
    """Turn a fault of the engine's tables into an error of the store."""
    try:
        yield
    except SQLAlchemyError as error:
        cause = str(getattr(error, "orig", None) or error).strip().splitlines()[0]
        raise StoreError(
            f"the tables for long jobs cannot be created or used ({cause[:200]})",
            "give the database user the privilege to create a schema",
        ) from error


class _Interruption(BaseException):
    """The engine's tables could not be used: no result of a workflow, whatever is done with exceptions.

    It is not recorded, so that the workflow counts as begun; the recovery sees that nobody carries it out.
    """


class Engine:
    """A worker's side: carries out jobs until closed. One a process."""

    def __init__(self, store: Store, jobs: Mapping[str, Jobs], database: str, executor: str) -> None:
        """Prepare to work, as a context manager does.

        Raises:
            StoreError: the engine's tables cannot be made or used.
        """
        self.queue = JobQueue(store, database)  # of the jobs
        # ids of the workflows that this process is carrying out, one for each time
        self.active: list[str] = []
        pending = self.queue.pending()
        # workflows that an earlier process of the same name was carrying out when it ended
        self.inherited = {name: each for name, each in pending.items() if each[1] == executor}
        config: DBOSConfig = {
            "name": APPLICATION,
            "system_database_url": engine_url(database),
            "dbos_system_schema": schema_of(store),
            "application_version": APPLICATION_VERSION,
            "executor_id": executor,
            "serializer": JsonSerializer(),
            "log_level": "CRITICAL",
            "console_log_level": "CRITICAL",
        }
        DBOS(config=config)
        _register(_Steps(jobs), self.active)
        DBOS.listen_queues(list(QUEUES.values()))

    def __enter__(self) -> Engine:
        """Start to work.

        Raises:
            StoreError: the engine's tables cannot be made or used.
        """
        with as_store_errors():
            DBOS.launch()
            for kind, queue in QUEUES.items():
                DBOS.register_queue(
                    queue,
                    worker_concurrency=_AT_ONCE[kind],
                    polling_interval_sec=_POLL_SECONDS[kind],
                    on_conflict="always_update",
                )
        return self

    def __exit__(self, *_: object) -> None:
        DBOS.destroy(workflow_completion_timeout_sec=0)


class _Steps:
    """Steps of a job, each kept by the engine. A finished job computes nothing more."""

    def __init__(self, jobs: Mapping[str, Jobs]) -> None:
        @DBOS.step(name="plan")
        @_patient
        def plan(kind: str, job_id: str) -> list[list[Span]]:
            if not jobs[kind].records.goes_on(job_id):  # cancelled, or deleted since
                return []
            jobs[kind].start(job_id)
            steps = jobs[kind].work(job_id).steps()
            count = min(len(steps), max(_PARTS, ceil(len(steps) / _STEPS)))
            return [list(steps[part::count]) for part in range(count)]

        @DBOS.step(name="compute")
        @_patient
        def compute(kind: str, job_id: str, span: Span) -> str:
            if not jobs[kind].records.goes_on(job_id):
                return ""
            computed = pack(jobs[kind].work(job_id).compute(span))
            jobs[kind].records.report(job_id, *span)
            return computed

        @DBOS.step(name="conclude")
        @_patient
        def conclude(kind: str, job_id: str, computed: list[str]) -> None:
            if jobs[kind].records.goes_on(job_id):
                jobs[kind].conclude(job_id, computed)

        @DBOS.step(name="fail")
        @_patient
        def fail(kind: str, job_id: str, failure: Exception) -> None:
            jobs[kind].fail(job_id, failure)

        self.plan, self.compute, self.conclude, self.fail = plan, compute, conclude, fail


def _until_ended(compute: Callable[[Span], str], spans: Sequence[Span]) -> list[str]:
    """Return what the steps of a part compute; none is carried out after one that found the job ended.

    Of a job that is cancelled at its first step, thousands would keep the worker from other jobs.
    """
    computed = []
    for span in spans:
        computed.append(compute(span))
        if not computed[-1]:
            break
    return computed


def _patient(step: Callable[P, R]) -> Callable[P, R]:
    """Wait for a database that does not answer, as the engine does: an outage is no result of a step.

    A process without memory ends, as the system would end it: others go on, and count its death.
    """

    @wraps(step)
    def carry_out(*args: P.args, **kwargs: P.kwargs) -> R:
        pause = _FIRST_PAUSE
        while True:
            try:
                return step(*args, **kwargs)
            except MemoryError:  # no result of a step: where there is more memory, it is carried out
                os.kill(os.getpid(), signal.SIGKILL)
            except StoreUnavailableError:
                time.sleep(pause)
                pause = min(2 * pause, _LONGEST_PAUSE)

    return carry_out


def _noting(active: list[str]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator that notes which workflows are carried out, and lets no fault of the database end one."""

    def noted(workflow: Callable[P, R]) -> Callable[P, R]:
        @wraps(workflow)
        def carry_out(*args: P.args, **kwargs: P.kwargs) -> R:
            identifier = str(DBOS.workflow_id)
            active.append(identifier)
            try:
                return workflow(*args, **kwargs)
            except _DATABASE_ERRORS as error:
                raise _Interruption from error
            finally:
                active.remove(identifier)

        return carry_out

    return noted


def _register(steps: _Steps, active: list[str]) -> None:
    """Make workflows of the steps."""
    noted = _noting(active)

    @DBOS.workflow(name="part", max_recovery_attempts=_ATTEMPTS)
    @noted
    def carry_out_part(kind: str, job_id: str, spans: list[Span]) -> list[str]:
        return _until_ended(lambda span: steps.compute(kind, job_id, span), spans)

    @DBOS.workflow(name="job", max_recovery_attempts=_ATTEMPTS)
    @noted
    def carry_out_job(kind: str, job_id: str) -> None:
        try:
            parts = steps.plan(kind, job_id)
            handles: list[Any] = []
            for number, spans in enumerate(parts):
                with SetEnqueueOptions(priority=1 + min(number, _FIRST)):  # the least goes first
                    handles.append(DBOS.enqueue_workflow(QUEUES["part"], carry_out_part, kind, job_id, spans))
            computed = [handle.get_result(polling_interval_sec=_WAIT_SECONDS) for handle in handles]
            if list(map(len, computed)) != list(map(len, parts)):
                return  # the job was ended
            count = len(parts)
            in_order = [computed[i % count][i // count] for i in range(sum(map(len, parts)))]
            steps.conclude(kind, job_id, in_order)
        except _DATABASE_ERRORS:
            raise
        except Exception as failure:  # noqa: BLE001 - the boundary of a job
            steps.fail(kind, job_id, failure)


class EngineDataError(Exception):
    """Data of a step cannot be used, or a step failed unexpectedly."""


class JsonSerializer(Serializer):
    """JSON values, and exceptions as data: the refusals of the numerical core come back as what they were."""

    def name(self) -> str:
        """Return the name that marks our rows."""
        return "jointstiff_json"

    def serialize(self, data: Any) -> str:  # noqa: ANN401 - whatever a step returns or raises
        """Return arguments, a result or an exception as JSON."""
        if not isinstance(data, BaseException):
            return json.dumps(data, allow_nan=False)
        described: dict[str, Any] = {"reason": f"{type(data).__name__}: {data}"}
        if isinstance(data, JointstiffError):
            described = {"reason": data.reason, "remedy": data.remedy, "where": data.where}
        if isinstance(data, ItemsError):
            described["items"] = data.items
        # Files are refused by several classes, whose constructors take something else.
        kind = FilesError if isinstance(data, FilesError) else type(data)
        return json.dumps({_RAISED: {"kind": kind.__name__, **described}}, allow_nan=False)

    def deserialize(self, serialized_data: str) -> Any:  # noqa: ANN401
        """Return what `serialize` was given; an exception as one to raise."""
        data = json.loads(serialized_data)
        if not (isinstance(data, dict) and _RAISED in data):
            return data
        kind, described = _refusals().get(data[_RAISED].pop("kind")), data[_RAISED]
        if kind is None or "remedy" not in described:
            return EngineDataError(described["reason"])
        return kind(**described)


def refuse_pickles() -> None:
    """Let the engine read no pickle in this process; it has no setting for it."""
    DefaultSerializer.deserialize = _refuse  # type: ignore[method-assign]


def _refuse(cls: DefaultSerializer, serialized_data: str) -> NoReturn:  # noqa: ARG001 - the engine's names
    raise EngineDataError("the engine's tables have a pickled object, which is not read")


def _refusals(kind: type[JointstiffError] = JointstiffError) -> dict[str, type[JointstiffError]]:
    """Return a class of errors, and all below it, by name."""
    below = (_refusals(each).items() for each in kind.__subclasses__())
    return {kind.__name__: kind, **dict(chain.from_iterable(below))}
