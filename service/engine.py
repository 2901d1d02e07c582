"""Durable execution of long runs on DBOS Transact: announced by the service, carried out by workers.

A run is a workflow; its steps are shared out to at most `PARTS` workflows of their own, so that any number of
workers can take part. What a step computed is kept before the next one begins. Steps may be carried out
twice: they only compute, what they report of a run is safe to repeat, and the end of a run is written once.
Who goes on with what a dead worker left is `service.janitor`'s to see to.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from types import TracebackType
from typing import Any, Final, ParamSpec, TypeVar

from dbos import DBOS, DBOSClient, DBOSConfig
from sqlalchemy import Connection, make_url
from sqlalchemy.exc import SQLAlchemyError

from service.resample import Span, decode, encode
from service.run_log import OPEN_STATES
from service.runs import Runs
from service.store import Store
from service.store_errors import StoreError, StoreUnavailableError

__all__ = ["ENDED_BADLY", "PARTS", "Announcer", "Engine"]

VERSION: Final = "1"
"""Of the layout of workflows and steps: workers only carry on what has the same."""
PARTS: Final = 8
QUEUES: Final = {"run": "jointstiff-runs", "part": "jointstiff-parts"}
"""Queue of each kind of workflow."""
ENDED_BADLY: Final = ("ERROR", "MAX_RECOVERY_ATTEMPTS_EXCEEDED", "CANCELLED")
_AT_ONCE: Final = {"run": 4, "part": 1}
"""A worker waits for a few runs, and computes one part: work for one processor."""
_ATTEMPTS: Final = 50
"""Deaths of workers over one workflow, after which it is given up."""
_POLL_SECONDS: Final = 0.1
_LONGEST_PAUSE: Final = 5.0
_APPLICATION: Final = "jointstiff"

P = ParamSpec("P")
R = TypeVar("R")

# The engine says on each start that a cloud service could be had, and on each retry what it does.
logging.getLogger("dbos").setLevel(logging.CRITICAL)


class Announcer:
    """The service's side: announces runs to the workers."""

    def __init__(self, store: Store, database: str) -> None:
        """Connect to the engine's tables, making them if need be.

        Args:
            store: of the runs.
            database: its URL; the engine keeps its tables beside the store's.

        Raises:
            StoreError: the engine's tables cannot be made or used.
        """
        url, schema = _engine_url(database), _schema(store)
        with _as_store_errors():
            DBOS.migrate(url, schema=schema)
            self._client = DBOSClient(
                system_database_url=url, dbos_system_schema=schema, application_name=_APPLICATION
            )

    def announce(self, connection: Connection, run_id: str) -> None:
        """Announce a run in the transaction that stores it: both are there, or neither is."""
        self._client.enqueue_in_transaction(
            connection,
            {
                "queue_name": QUEUES["run"],
                "workflow_name": "run",
                "workflow_id": run_id,
                "app_version": VERSION,
            },
            run_id,
        )

    def close(self) -> None:
        """Disconnect."""
        self._client.destroy()


class Engine:
    """A worker's side: carries out runs until closed. One a process.

    Attributes:
        active: ids of the workflows that this process is carrying out.
    """

    def __init__(self, store: Store, runs: Runs, database: str, executor: str) -> None:
        """Start to work.

        Args:
            store: of the runs.
            runs: of that store.
            database: its URL.
            executor: name of this worker.

        Raises:
            StoreError: the engine's tables cannot be made or used.
        """
        url, schema = _engine_url(database), _schema(store)
        self.active: set[str] = set()
        config: DBOSConfig = {
            "name": _APPLICATION,
            "system_database_url": url,
            "dbos_system_schema": schema,
            "application_version": VERSION,
            "executor_id": executor,
            "log_level": "CRITICAL",
            "console_log_level": "CRITICAL",
            "notification_listener_polling_interval_sec": _POLL_SECONDS,
        }
        DBOS(config=config)
        _register(_Steps(store, runs), self.active)
        DBOS.listen_queues(list(QUEUES.values()))
        with _as_store_errors():
            DBOS.launch()
            for kind, queue in QUEUES.items():
                DBOS.register_queue(
                    queue,
                    worker_concurrency=_AT_ONCE[kind],
                    polling_interval_sec=_POLL_SECONDS,
                    on_conflict="always_update",
                )
            self._client = DBOSClient(
                system_database_url=url, dbos_system_schema=schema, application_name=_APPLICATION
            )

    def __enter__(self) -> Engine:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        DBOS.destroy(workflow_completion_timeout_sec=0)

    def pending(self) -> dict[str, tuple[str, str]]:
        """Workflows that a worker has taken and not ended: id → kind, executor."""
        found = self._client.list_workflows(status="PENDING", load_input=False, load_output=False)
        return {each.workflow_id: (each.name, str(each.executor_id)) for each in found}

    def resume(self, workflows: Iterable[tuple[str, str]]) -> None:
        """Put workflows (id, kind) back into their queues; whoever still carries one out, loses it."""
        for identifier, kind in workflows:
            self._client.resume_workflows([identifier], queue_name=QUEUES[kind])

    def outcomes(self, run_ids: list[str]) -> dict[str, str]:
        """Status of the workflows of some runs."""
        found = self._client.list_workflows(workflow_ids=run_ids, load_input=False, load_output=False)
        return {each.workflow_id: str(each.status) for each in found}


class _Steps:
    """What a run consists of, each step kept by the engine. A run that has ended computes nothing more."""

    def __init__(self, store: Store, runs: Runs) -> None:
        def goes_on(run_id: str) -> bool:
            return store.run_log.state(run_id) in OPEN_STATES

        @DBOS.step(name="plan")
        @_patient
        def plan(run_id: str) -> list[list[Span]]:
            runs.start(run_id)
            steps = runs.work(run_id).steps()
            return [list(steps[part::PARTS]) for part in range(min(PARTS, len(steps)))]

        @DBOS.step(name="resample")
        @_patient
        def compute(run_id: str, span: Span) -> str:
            if not goes_on(run_id):
                return ""
            computed = encode(runs.work(run_id).compute(span))
            store.run_log.report(run_id, *span)
            return computed

        @DBOS.step(name="conclude")
        @_patient
        def conclude(run_id: str, computed: list[str]) -> None:
            if goes_on(run_id):
                runs.conclude(run_id, [decode(text) for text in computed])

        @DBOS.step(name="fail")
        @_patient
        def fail(run_id: str, failure: Exception) -> None:
            runs.fail(run_id, failure)

        self.plan, self.compute, self.conclude, self.fail = plan, compute, conclude, fail


def _patient(step: Callable[P, R]) -> Callable[P, R]:
    """Wait for a database that does not answer, as the engine does: an outage is no result of a step."""

    @wraps(step)
    def carry_out(*args: P.args, **kwargs: P.kwargs) -> R:
        pause = _POLL_SECONDS
        while True:
            try:
                return step(*args, **kwargs)
            except StoreUnavailableError:
                time.sleep(pause)
                pause = min(2 * pause, _LONGEST_PAUSE)

    return carry_out


def _register(steps: _Steps, active: set[str]) -> None:
    """Make workflows of the steps."""

    def noted(workflow: Callable[P, R]) -> Callable[P, R]:
        @wraps(workflow)
        def carry_out(*args: P.args, **kwargs: P.kwargs) -> R:
            identifier = str(DBOS.workflow_id)
            active.add(identifier)
            try:
                return workflow(*args, **kwargs)
            finally:
                active.discard(identifier)

        return carry_out

    @DBOS.workflow(name="part", max_recovery_attempts=_ATTEMPTS)
    @noted
    def carry_out_part(run_id: str, spans: list[Span]) -> list[str]:
        return [steps.compute(run_id, span) for span in spans]

    @DBOS.workflow(name="run", max_recovery_attempts=_ATTEMPTS)
    @noted
    def carry_out_run(run_id: str) -> None:
        try:
            parts = steps.plan(run_id)
            handles: list[Any] = [
                DBOS.enqueue_workflow(QUEUES["part"], carry_out_part, run_id, spans) for spans in parts
            ]
            computed = [handle.get_result(polling_interval_sec=_POLL_SECONDS) for handle in handles]
            in_order = [computed[i % PARTS][i // PARTS] for i in range(sum(map(len, parts)))]
            steps.conclude(run_id, in_order)
        except Exception as failure:  # noqa: BLE001 - the boundary of a run
            steps.fail(run_id, failure)


def _engine_url(database: str) -> str:
    """The store's URL as the engine reads it."""
    url = make_url(database)
    if url.get_backend_name() == "postgresql":
        url = url.set(drivername="postgresql")
    return url.render_as_string(hide_password=False)


def _schema(store: Store) -> str:
    """The engine's schema on PostgreSQL: one for each schema of a store, as runs have no other namespace."""
    schema = store.schema()
    return "dbos" if schema in {None, "public"} else f"dbos_{schema}"


@contextmanager
def _as_store_errors() -> Iterator[None]:
    try:
        yield
    except SQLAlchemyError as error:
        cause = str(getattr(error, "orig", None) or error).strip().splitlines()[0]
        raise StoreError(
            f"the tables for long runs cannot be made or used ({cause[:200]})",
            "give the database's user the right to create a schema in it",
        ) from error
