"""Order and claims of jobs' parts, kept by DBOS Transact in the store's database.

DBOS knows which worker has which part of a job, which part is next, and how often each part began. DBOS gets
only ids and numbers; requests and results are in the store. All functions of this module may be repeated
safely.

No other module imports `dbos`. Two of its names that are used here are not public: `pyproject.toml` caps its
minor version.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import suppress
from typing import Any, Final, NoReturn

from dbos import DBOS, DBOSClient, DBOSConfig, EnqueueOptions
from dbos._serialization import DBOSPortableJSONSerializer, DefaultSerializer
from sqlalchemy import Connection
from sqlalchemy.exc import SQLAlchemyError

from jointstiff.service.jobs import PARTS_AT_ONCE, Part
from jointstiff.service.problems import StoreError
from jointstiff.service.process import jointstiff_version
from jointstiff.service.store.database import dispose, make_engine
from jointstiff.service.store.store import Store
from jointstiff.service.store.waiting import DELAYS_SIGN, name_queue_schema, read_delays
from jointstiff.service.workers.queue_tables import move_tables

ATTEMPTS: Final = 5
"""Number of workers that die over one part of a job, without a finished step, before the job is given up."""
LATER_SECONDS: Final = 60.0
"""Time [s] after which a part is offered again that only another version of the program can carry out."""
FIRST_DELAY_SECONDS: Final = 10.0
"""Time [s] after which a part is offered again whose rows were locked; doubles to `LATER_SECONDS`."""
_APPLICATION: Final = "jointstiff"
_QUEUE: Final = "jointstiff-jobs"
_VERSION: Final = "1"  # the same for all workers, because DBOS hands parts only to workers of one version
_POLL_SECONDS: Final = 0.2  # time between two queries for a part
_PATIENCE_SECONDS: Final = 10  # time for which newer jobs take precedence over a job that has begun
_EPOCH: Final = 1_760_000_000  # Unix time of priority 0 [s]: DBOS takes priorities below 2³¹
_CONNECTIONS: Final = 6
_PAGE_SIZE: Final = 1_000  # rows of DBOS in one query
_MAX_PAGES: Final = 20  # most pages in one call: parts of unfinished jobs remain, and may fill some pages
_GIVEN_UP_STATES: Final = ["MAX_RECOVERY_ATTEMPTS_EXCEEDED", "ERROR", "CANCELLED"]


def _refuse_pickle(cls: DefaultSerializer, serialized_data: str) -> NoReturn:  # noqa: ARG001 - DBOS's names
    """Refuse to read a pickled object, because unpickling runs code of the object."""
    raise ValueError("a row of the queue has a pickled object; pickled objects are not read")


# Whatever serializer is chosen, DBOS uses this class to read rows that are marked as pickles. Unchanged, it
# would let anyone who can write to the database run code in the workers.
DefaultSerializer.deserialize = _refuse_pickle  # type: ignore[method-assign]
# DBOS logs every retry, and at each start an advertisement of its cloud service.
logging.getLogger("dbos").setLevel(logging.CRITICAL)
_logger = logging.getLogger(__name__)


class Queue:
    """Queue of the parts of jobs that workers carry out. Safe to use from several threads and processes."""

    def __init__(self, store: Store, database: str) -> None:
        """Open the queue of a store; create its tables in the store's database if they are missing.

        Args:
            store: store of the jobs; the caller closes it.
            database: URL of the store.

        Raises:
            StoreError: the tables cannot be created or used.
        """
        self._store = store
        store_schema = store.schema()
        # SQLite has no schemas: DBOS ignores the name.
        self._schema = "dbos" if store_schema is None else name_queue_schema(store_schema)
        self._engine = make_engine(database, _CONNECTIONS)
        try:
            DBOS.migrate(self._engine.url.render_as_string(hide_password=False), schema=self._schema)
            if store_schema is not None:
                move_tables(store, store_schema, self._schema)
            self._client = DBOSClient(
                system_database_engine=self._engine,
                dbos_system_schema=self._schema,
                application_name=_APPLICATION,
                serializer=DBOSPortableJSONSerializer(),
                retry_connection_errors=False,
                lazy=True,
            )
        except SQLAlchemyError as error:
            dispose(self._engine)
            cause = str(getattr(error, "orig", None) or error).strip().splitlines()[0]
            raise StoreError(
                f"the tables of the queue cannot be created or used ({cause[:200]})",
                "give the user of the database the right to create schemas, tables and functions",
            ) from error

    def close(self) -> None:
        """Disconnect from the database."""
        self._client.destroy()
        dispose(self._engine)

    def enqueue(self, connection: Connection, job_id: str) -> None:
        """Add the first part of a new job, in the transaction that stores the job."""
        self._add_part(connection, Part(job_id, 0, 0), priority=_compute_priority_now())

    def add_following_parts(self, job_id: str, parts: Iterable[Part]) -> None:
        """Add parts of a job that has begun, except parts that were added before.

        Newer jobs take precedence for a time that is proportional to the number of jobs that have begun. So
        small jobs are not delayed by large jobs, and large jobs continue however many small jobs arrive.
        """
        priority = _compute_priority_now() + _PATIENCE_SECONDS * (
            1 + self._store.steps.count_other_begun_jobs(job_id)
        )
        with self._store.transaction() as connection:
            for part in parts:
                self._add_part(
                    connection,
                    part,
                    priority=priority,
                    part_id=f"{_make_part_id(part)}-{jointstiff_version()}",
                )

    def offer_again(self, parts: Iterable[Part], delay_seconds: float = 0.0) -> None:
        """Offer parts to all workers after a time [s], even parts that were carried out before."""
        for part in parts:
            self._add_later(part, f"{_make_part_id(part)}-{time.time_ns()}", delay_seconds)

    def hand_back(self, part: Part) -> None:
        """Offer a part whose rows are locked to all workers again; the time until then doubles each time."""
        new_id = f"{_make_part_id(part)}-{time.time_ns()}{DELAYS_SIGN}{part.delays + 1}"
        self._add_later(part, new_id, min(FIRST_DELAY_SECONDS * 2.0**part.delays, LATER_SECONDS))

    def others_wait(self, job_id: str) -> bool:
        """Return whether parts of jobs other than `job_id` are queued; True if the database fails."""
        try:
            waiting_rows = self._list_rows(limit=PARTS_AT_ONCE + 1, status="ENQUEUED")
        except SQLAlchemyError:
            return True
        return any(extract_job_id(row.workflow_id) != job_id for row in waiting_rows)

    def claimed_parts(self) -> dict[str, str]:
        """Return part's id → name of the worker, for the parts that are claimed and not finished."""
        return {row.workflow_id: str(row.executor_id) for row in self._list_rows(status="PENDING")}

    def put_back(self, parts: Iterable[str]) -> None:
        """Put claimed parts back into the queue, for any worker to take; DBOS counts no failed attempt.

        `parts` are the ids of the parts.
        """
        if part_ids := list(parts):
            self._client.resume_workflows(part_ids, queue_name=_QUEUE)

    def find_given_up_jobs(self) -> dict[str, bool]:
        """Return the jobs with a part that DBOS has given up, as a dict: job's id → whether workers died.

        The value is True if too many workers died over the part, and False for another failure.
        """
        pages = self._list_pages(status=_GIVEN_UP_STATES)
        return {
            extract_job_id(row.workflow_id): row.status == _GIVEN_UP_STATES[0]
            for page in pages
            for row in page
        }

    def find_unknown_jobs(self, job_ids: Collection[str]) -> set[str]:
        """Return those of `job_ids` whose first part is not in the queue: never added, or removed by hand."""
        if not job_ids:
            return set()
        first_part_ids = [_make_part_id(Part(job_id, 0, 0)) for job_id in job_ids]
        rows = self._list_rows(workflow_ids=first_part_ids, limit=len(first_part_ids))
        return set(job_ids) - {extract_job_id(row.workflow_id) for row in rows}

    def remove_ended_parts(self, find_unfinished: Callable[[Collection[str]], set[str]]) -> None:
        """Remove the finished parts of finished jobs from the queue.

        Args:
            find_unfinished: function that takes ids of jobs, and returns the ids of the unfinished jobs.
        """
        # All pages are read first, because a removal shifts the rows of the pages behind.
        for page in list(self._list_pages(status=["SUCCESS", *_GIVEN_UP_STATES])):
            ended_part_ids = [row.workflow_id for row in page]
            unfinished_jobs = find_unfinished({extract_job_id(part_id) for part_id in ended_part_ids})
            if removable_part_ids := [
                part_id for part_id in ended_part_ids if extract_job_id(part_id) not in unfinished_jobs
            ]:
                self._client.delete_workflows(removable_part_ids)

    def _add_later(self, part: Part, part_id: str, seconds: float) -> None:
        """Add a part under an id, to be offered after a time [s]; at once if the time is 0."""
        delay, priority = seconds or None, _compute_priority_now()
        with self._store.transaction() as connection:
            self._add_part(connection, part, priority=priority, part_id=part_id, delay_seconds=delay)

    def _add_part(
        self,
        connection: Connection,
        part: Part,
        *,
        priority: int,
        part_id: str | None = None,
        delay_seconds: float | None = None,
    ) -> None:
        """Add a part to the queue.

        Args:
            connection: connection of a transaction of the store.
            part: part to add; DBOS ignores a part whose id is already in the queue.
            priority: the part with the least number comes first; of equal numbers, the part added first.
            part_id: id in the queue; None for that of the part.
            delay_seconds: time until the part is offered [s]; None to offer it at once.
        """
        options: EnqueueOptions = {
            "queue_name": _QUEUE,
            "workflow_name": "carry_out",
            "workflow_id": part_id or _make_part_id(part),
            "app_version": _VERSION,
            "priority": priority,
        }
        if delay_seconds is not None:
            options["delay_seconds"] = delay_seconds
        self._client.enqueue_in_transaction(connection, options, part.job_id, part.number, part.kept)

    def _list_pages(self, **filters: Any) -> Iterator[list[Any]]:  # noqa: ANN401 - what DBOS takes
        """Yield pages of the rows of DBOS that match filters, oldest first, at most `_MAX_PAGES` pages."""
        for number in range(_MAX_PAGES):
            page = self._list_rows(offset=number * _PAGE_SIZE, **filters)
            yield page
            if len(page) < _PAGE_SIZE:
                return

    def _list_rows(self, limit: int = _PAGE_SIZE, **filters: Any) -> list[Any]:  # noqa: ANN401 - what DBOS takes
        """Return the rows of DBOS that match filters, oldest first; each row is a part of a job."""
        return self._client.list_workflows(limit=limit, load_input=False, load_output=False, **filters)


class Engine(Queue):
    """Queue of a worker, which carries out one part after the other. A process has at most one engine."""

    def __init__(
        self, store: Store, database: str, executor: str, carry_out: Callable[[Part], object]
    ) -> None:
        """Begin to carry out parts.

        Args:
            store: store of the jobs; the caller closes it.
            database: URL of the store.
            executor: name of this worker process; no other process has or had this name.
            carry_out: function that carries out a part, and handles all errors itself.

        Raises:
            StoreError: the tables cannot be created or used.
        """
        super().__init__(store, database)
        self._executor = executor
        self._is_stopping, self._is_closed = threading.Event(), threading.Event()
        # Processor clocks of the threads that carry out a part, by the part's id.
        self._clocks: dict[str, int | None] = {}
        config: DBOSConfig = {
            "name": _APPLICATION,
            "system_database_engine": self._engine,
            "dbos_system_schema": self._schema,
            "application_version": _VERSION,
            "executor_id": executor,
            "serializer": DBOSPortableJSONSerializer(),
            "run_migrations": False,
            "log_level": "CRITICAL",
            "console_log_level": "CRITICAL",
        }
        DBOS(config=config)

        @DBOS.workflow(name="carry_out", max_recovery_attempts=ATTEMPTS - 1)
        def carry_out_part(job_id: str, number: int, kept: int) -> None:
            """Carry out a part that DBOS has claimed for this process."""
            name = str(DBOS.workflow_id)
            part = Part(job_id, number, kept, read_delays(name))
            if self._is_stopping.is_set():
                # `stop` offers this part to others. DBOS claims no further part while this thread waits.
                self._is_closed.wait()
                return
            self._clocks[name] = _find_thread_clock()
            try:
                carry_out(part)
            except Exception:
                _logger.exception("a part of job %s cannot be carried out", job_id)
                raise
            finally:
                del self._clocks[name]

        DBOS.listen_queues([_QUEUE])
        DBOS.launch()
        DBOS.register_queue(
            _QUEUE, worker_concurrency=1, polling_interval_sec=_POLL_SECONDS, on_conflict="always_update"
        )

    def stop(self) -> None:
        """Begin no further part, and offer the parts that this process claimed to other workers.

        This function does not wait for the end of a running part. DBOS itself would take seconds to stop.
        """
        self._is_stopping.set()
        for _ in range(2):  # a part may be claimed while other parts are put back: repeat once
            pending = self.claimed_parts().items()
            self.put_back(part for part, executor in pending if executor == self._executor)
            self._is_closed.wait(2.0 * _POLL_SECONDS)

    def close(self) -> None:
        """End DBOS in this process without waiting for a running part, and disconnect from the database."""
        DBOS.destroy(workflow_completion_timeout_sec=0)
        self._is_closed.set()
        super().close()

    def seconds_of_running_parts(self) -> dict[str, float]:
        """Return the processor time [s] of each part of a job that runs in this process, by the part's id.

        Without a clock of the thread, the elapsed time is returned, so that the part never seems idle.
        """
        seconds_by_part = {}
        for part_id, clock in list(self._clocks.items()):
            with suppress(OSError):  # the thread has ended meanwhile
                seconds_by_part[part_id] = time.monotonic() if clock is None else time.clock_gettime(clock)
        return seconds_by_part

    def recover(self, lost_workers: Iterable[str]) -> None:
        """Put the parts of jobs that lost workers had claimed back into the queue, for any worker to take.

        DBOS counts one failed attempt for each of these parts.

        Args:
            lost_workers: names of the lost workers.
        """
        if worker_names := list(lost_workers):
            # This function is not public; the cloud service of DBOS itself calls it.
            DBOS._recover_pending_workflows(worker_names)


def _find_thread_clock() -> int | None:
    """Return the id of the clock of this thread's processor time; None if the system has no such clock."""
    clock = getattr(time, "pthread_getcpuclockid", None)
    return None if clock is None else int(clock(threading.get_ident()))


def extract_job_id(part_id: str) -> str:
    """Return the id of a part's job: the beginning of the part's id."""
    return part_id.partition("-")[0]


def _make_part_id(part: Part) -> str:
    """Return a part's id, which changes with each stored step: DBOS counts the starts of each id anew."""
    return f"{part.job_id}-{part.number:06}-{part.kept}"


def _compute_priority_now() -> int:
    """Return the priority of a part that is added now: seconds since `_EPOCH`."""
    return int(time.time()) - _EPOCH
