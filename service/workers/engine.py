"""Order and claims of jobs' parts, kept by DBOS Transact in the store's database.

DBOS knows which worker has which part of a job, which part is next, and how often each part began. It gets
ids and numbers, nothing else: requests and results are the store's. Everything here is safe to repeat.

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
from jointstiff.service.store.database import engine_of
from jointstiff.service.store.store import Store

ATTEMPTS: Final = 5
"""Deaths of workers over one part of a job, without a step that was kept, after which the job is given up."""
LATER_SECONDS: Final = 60.0
"""Time until a part of a job of a kind that only another version knows is offered again [s]."""
_APPLICATION: Final = "jointstiff"
_QUEUE: Final = "jointstiff-jobs"
_VERSION: Final = "1"  # DBOS's name for workers that may carry on what others began: all of one database
_POLL_SECONDS: Final = 0.2  # between two looks for a part
_PATIENCE_SECONDS: Final = 10  # for which newer jobs pass the next part of one that has begun
_EPOCH: Final = 1_760_000_000  # Unix time of priority 0 [s]: DBOS takes priorities below 2³¹
_CONNECTIONS: Final = 6
_LISTED: Final = 1_000  # rows of DBOS in a page
_PAGES: Final = 20  # pages at a look: parts of jobs that go on stay, and may fill some
_GIVEN_UP: Final = ["MAX_RECOVERY_ATTEMPTS_EXCEEDED", "ERROR", "CANCELLED"]


def _refuse_pickle(cls: DefaultSerializer, serialized_data: str) -> NoReturn:  # noqa: ARG001 - DBOS's names
    raise ValueError("a row of the queue has a pickled object; pickled objects are not read")


# DBOS reads what a row calls a pickle with this class, whatever serializer was chosen: who can write the
# database could run code in the workers.
DefaultSerializer.deserialize = _refuse_pickle  # type: ignore[method-assign]
# DBOS logs what it retries, and at each start that a cloud service exists.
logging.getLogger("dbos").setLevel(logging.CRITICAL)
_logger = logging.getLogger(__name__)


class Queue:
    """The parts of jobs that are left to workers. Safe to use from several threads and processes."""

    def __init__(self, store: Store, database: str) -> None:
        """Open the queue of a store; its tables are made in the store's database if they are not there.

        Args:
            store: which stays the caller's to close.
            database: its URL.

        Raises:
            StoreError: the tables cannot be made or used.
        """
        self._store = store
        self._schema = store.schema() or "dbos"  # SQLite has none, and DBOS leaves it out
        self._engine = engine_of(database, _CONNECTIONS)
        try:
            DBOS.migrate(self._engine.url.render_as_string(hide_password=False), schema=self._schema)
            self._client = DBOSClient(
                system_database_engine=self._engine,
                dbos_system_schema=self._schema,
                application_name=_APPLICATION,
                serializer=DBOSPortableJSONSerializer(),
                retry_connection_errors=False,
                lazy=True,
            )
        except SQLAlchemyError as error:
            self._engine.dispose()
            cause = str(getattr(error, "orig", None) or error).strip().splitlines()[0]
            raise StoreError(
                f"the tables of the queue cannot be created or used ({cause[:200]})",
                "give the user of the database the right to create tables and functions",
            ) from error

    def close(self) -> None:
        """Disconnect."""
        self._client.destroy()
        self._engine.dispose()

    def enqueue(self, connection: Connection, job_id: str) -> None:
        """Leave a new job to workers, in the transaction that stores the job."""
        self._add(connection, Part(job_id, 0, 0), turn=_now())

    def leave(self, job_id: str, parts: Iterable[Part]) -> None:
        """Leave parts of a job that has begun to workers; each once, however often it is left.

        Newer jobs go first for a while, the longer the more jobs have begun: so small jobs do not wait for
        large ones, and large ones go on however many small ones come.
        """
        turn = _now() + _PATIENCE_SECONDS * (1 + self._store.steps.others_begun(job_id))
        with self._store.transaction() as connection:
            for part in parts:
                self._add(connection, part, turn=turn)

    def offer_later(self, part: Part) -> None:
        """Leave a part of a job of another version's kind to whoever claims it after `LATER_SECONDS`."""
        with self._store.transaction() as connection:
            self._add(connection, part, turn=_now(), later=LATER_SECONDS)

    def others_wait(self, job_id: str) -> bool:
        """Return whether parts of other jobs than this one wait for a worker; true where nobody can say."""
        try:
            waiting = self._listed(limit=PARTS_AT_ONCE + 1, status="ENQUEUED")
        except SQLAlchemyError:
            return True
        return any(job_of(each.workflow_id) != job_id for each in waiting)

    def pending(self) -> dict[str, str]:
        """Return the parts that workers have claimed and not ended: id → name of the worker."""
        return {each.workflow_id: str(each.executor_id) for each in self._listed(status="PENDING")}

    def hand_over(self, parts: Iterable[str]) -> None:
        """Offer claimed parts to all workers again, and count no death; who carries one out may go on."""
        if some := list(parts):
            self._client.resume_workflows(some, queue_name=_QUEUE)

    def given_up(self) -> dict[str, bool]:
        """Return jobs that have a part which will not be offered again: id → whether workers died over it."""
        found = self._pages(status=_GIVEN_UP)
        return {job_of(each.workflow_id): each.status == _GIVEN_UP[0] for page in found for each in page}

    def unknown(self, job_ids: Collection[str]) -> set[str]:
        """Return those of some jobs that were never left to workers, or whose parts were removed by hand."""
        if not job_ids:
            return set()
        firsts = [_name(Part(job_id, 0, 0)) for job_id in job_ids]
        known = self._listed(workflow_ids=firsts, limit=len(firsts))
        return set(job_ids) - {job_of(each.workflow_id) for each in known}

    def forget(self, going_on: Callable[[Collection[str]], set[str]]) -> None:
        """Remove ended parts of jobs that have ended.

        Args:
            going_on: returns the ids of those of some jobs that have not ended.
        """
        for page in list(self._pages(status=["SUCCESS", *_GIVEN_UP])):
            ended = [each.workflow_id for each in page]
            open_jobs = going_on({job_of(part) for part in ended})
            if over := [part for part in ended if job_of(part) not in open_jobs]:
                self._client.delete_workflows(over)

    def _add(self, connection: Connection, part: Part, *, turn: int, later: float | None = None) -> None:
        """Add a part to the queue.

        Args:
            connection: of a transaction of the store.
            part: which is added once: DBOS knows its name.
            turn: the least goes first; of equal ones the first that was added.
            later: time until it is offered [s]; it is added once more then.
        """
        options: EnqueueOptions = {
            "queue_name": _QUEUE,
            "workflow_name": "carry_out",
            "workflow_id": _name(part),
            "app_version": _VERSION,
            "priority": turn,
        }
        if later is not None:
            options |= {"workflow_id": f"{_name(part)}-{time.time_ns()}", "delay_seconds": later}
        self._client.enqueue_in_transaction(connection, options, part.job_id, part.number, part.kept)

    def _pages(self, **which: Any) -> Iterator[list[Any]]:  # noqa: ANN401 - what DBOS takes
        """Yield rows of DBOS in pages, oldest first."""
        for number in range(_PAGES):
            page = self._listed(offset=number * _LISTED, **which)
            yield page
            if len(page) < _LISTED:
                return

    def _listed(self, limit: int = _LISTED, **which: Any) -> list[Any]:  # noqa: ANN401 - what DBOS takes
        """Return rows of DBOS, oldest first."""
        return self._client.list_workflows(limit=limit, load_input=False, load_output=False, **which)


class Engine(Queue):
    """A worker's queue: it carries out one part after the other. One a process."""

    def __init__(
        self, store: Store, database: str, executor: str, carry_out: Callable[[Part], object]
    ) -> None:
        """Begin to carry out parts.

        Args:
            store: which stays the caller's to close.
            database: its URL.
            executor: name of this worker, which no other process has or had.
            carry_out: carries out a part, and raises nothing.

        Raises:
            StoreError: the tables cannot be made or used.
        """
        super().__init__(store, database)
        self._executor = executor
        self._is_stopping, self._is_closed = threading.Event(), threading.Event()
        self._clocks: dict[str, int | None] = {}  # of the threads that carry out a part, by the part's name
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
            name, part = str(DBOS.workflow_id), Part(job_id, number, kept)
            if self._is_stopping.is_set():
                # `stop` hands it over. While this thread waits, DBOS claims no other part here.
                self._is_closed.wait()
                return
            self._clocks[name] = _clock_of_thread()
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
        """Begin no further part, and offer to the others what this process claimed.

        A part under way is not waited for. DBOS itself would take seconds to stop its threads.
        """
        self._is_stopping.set()
        for _ in range(2):  # one may have been claimed while the first one was handed over
            pending = self.pending().items()
            self.hand_over(part for part, executor in pending if executor == self._executor)
            self._is_closed.wait(2.0 * _POLL_SECONDS)

    def close(self) -> None:
        """End DBOS in this process, and disconnect; a part under way is not waited for."""
        DBOS.destroy(workflow_completion_timeout_sec=0)
        self._is_closed.set()
        super().close()

    def active(self) -> dict[str, float]:
        """Return the parts that this process carries out: id → processor time that their thread used [s]."""
        used = {}
        for name, clock in list(self._clocks.items()):
            with suppress(OSError):  # the thread has ended since
                used[name] = time.monotonic() if clock is None else time.clock_gettime(clock)
        return used

    def recover(self, executors: Iterable[str]) -> None:
        """Offer what dead workers had claimed to all workers, and count a death over each part."""
        if dead := list(executors):
            DBOS._recover_pending_workflows(dead)  # DBOS's own cloud service makes this call


def _clock_of_thread() -> int | None:
    """Return the clock of this thread's processor time; None where the system has none."""
    clock = getattr(time, "pthread_getcpuclockid", None)
    return None if clock is None else int(clock(threading.get_ident()))


def job_of(part: str) -> str:
    """Return the id of the job that a part belongs to, by the part's id."""
    return part.partition("-")[0]


def _name(part: Part) -> str:
    """Return the id of a part. DBOS counts starts by it: a step that is kept begins a new count."""
    return f"{part.job_id}-{part.number:06}-{part.kept}"


def _now() -> int:
    """Return the time as a priority [s]."""
    return int(time.time()) - _EPOCH
