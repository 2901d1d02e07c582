"""Durable execution of long runs on DBOS Transact: announced by the service, carried out by workers.

A run is a workflow; its steps are shared out to at most `PARTS` workflows of their own, so that any number of
workers can take part. What a step computed is kept before the next one begins. A worker that dies is
replaced by one of the same name, which goes on where it stopped, or, if none comes, by any other.

Steps may be carried out twice. They only compute; what they report of a run is safe to repeat, and the
end of a run is written once.
"""

from __future__ import annotations

import logging
from types import TracebackType
from typing import Any, Final

from dbos import DBOS, DBOSClient, DBOSConfig
from sqlalchemy import Connection, make_url

from service.resample import Span, decode, encode
from service.runs import Runs
from service.store import Store

__all__ = ["Announcer", "Engine"]

VERSION: Final = "1"
"""Of the layout of workflows and steps: workers only carry on what has the same."""
PARTS: Final = 8
RUN_QUEUE: Final = "jointstiff-runs"
PART_QUEUE: Final = "jointstiff-parts"
_RUNS_AT_ONCE: Final = 4
"""Runs that a worker waits for; each of its parts is work for one processor."""
_POLL_SECONDS: Final = 0.1
_APPLICATION: Final = "jointstiff"

# The engine says on each start that a cloud service could be had, and on each retry what it does.
logging.getLogger("dbos").setLevel(logging.ERROR)


class Announcer:
    """The service's side: announces runs, and tells the engine of those that are cancelled."""

    def __init__(self, database: str) -> None:
        """Connect to the engine's tables, making them if need be.

        Args:
            database: URL of the store; the engine keeps its tables beside the store's.
        """
        url = _engine_url(database)
        DBOS.migrate(url)
        self._client = DBOSClient(system_database_url=url, application_name=_APPLICATION)

    def announce(self, connection: Connection, run_id: str) -> None:
        """Announce a run in the transaction that stores it: both are there, or neither is."""
        self._client.enqueue_in_transaction(
            connection,
            {
                "queue_name": RUN_QUEUE,
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
    """A worker's side: carries out runs until closed. One a process."""

    def __init__(self, store: Store, runs: Runs, database: str, executor: str) -> None:
        """Start to work.

        Args:
            store: of the runs.
            runs: of that store.
            database: its URL.
            executor: name of this worker; another one of the same name takes over what it leaves.
        """
        config: DBOSConfig = {
            "name": _APPLICATION,
            "system_database_url": _engine_url(database),
            "application_version": VERSION,
            "executor_id": executor,
            "log_level": "ERROR",
            "console_log_level": "ERROR",
            "notification_listener_polling_interval_sec": _POLL_SECONDS,
        }
        DBOS(config=config)
        _register(_Steps(store, runs))
        DBOS.listen_queues([RUN_QUEUE, PART_QUEUE])
        DBOS.launch()
        for queue, at_once in ((RUN_QUEUE, _RUNS_AT_ONCE), (PART_QUEUE, 1)):
            DBOS.register_queue(
                queue,
                worker_concurrency=at_once,
                polling_interval_sec=_POLL_SECONDS,
                on_conflict="always_update",
            )

    def __enter__(self) -> Engine:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        DBOS.destroy(workflow_completion_timeout_sec=0)

    def adopt(self, executor: str) -> int:
        """Let all workers share what an executor left unfinished.

        Returns:
            How many workflows.
        """
        left = DBOS.list_workflows(
            executor_id=executor, status="PENDING", load_input=False, load_output=False
        )
        if left:
            DBOS.resume_workflows([workflow.workflow_id for workflow in left])
        return len(left)


class _Steps:
    """What a run consists of, each step kept by the engine. A cancelled run computes nothing more."""

    def __init__(self, store: Store, runs: Runs) -> None:
        def cancelled(run_id: str) -> bool:
            return store.run_log.state(run_id) == "cancelled"

        @DBOS.step(name="plan")
        def plan(run_id: str) -> list[list[Span]]:
            store.run_log.start(run_id)
            steps = runs.work(run_id).steps()
            return [list(steps[part::PARTS]) for part in range(min(PARTS, len(steps)))]

        @DBOS.step(name="resample")
        def compute(run_id: str, span: Span) -> str:
            if cancelled(run_id):
                return ""
            computed = encode(runs.work(run_id).compute(span))
            store.run_log.report(run_id, *span)
            return computed

        @DBOS.step(name="conclude")
        def conclude(run_id: str, computed: list[str]) -> None:
            if not cancelled(run_id):
                runs.conclude(run_id, [decode(text) for text in computed])

        @DBOS.step(name="fail")
        def fail(run_id: str, failure: Exception) -> None:
            runs.fail(run_id, failure)

        self.plan, self.compute, self.conclude, self.fail = plan, compute, conclude, fail


def _register(steps: _Steps) -> None:
    """Make workflows of the steps."""

    @DBOS.workflow(name="part")
    def carry_out_part(run_id: str, spans: list[Span]) -> list[str]:
        return [steps.compute(run_id, span) for span in spans]

    @DBOS.workflow(name="run")
    def carry_out(run_id: str) -> None:
        try:
            parts = steps.plan(run_id)
            handles: list[Any] = [
                DBOS.enqueue_workflow(PART_QUEUE, carry_out_part, run_id, spans) for spans in parts
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
