"""The engine's tables: which jobs are enqueued, who carries them out, what became of them.

They are DBOS's own, beside the store's in the same database; only its public client is asked.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from typing import Final

from dbos import DBOS, DBOSClient, EnqueueOptions
from sqlalchemy import Connection, make_url
from sqlalchemy.exc import SQLAlchemyError

from jointstiff.service.problems.errors import StoreError
from jointstiff.service.store.store import Store
from jointstiff.service.workers.serialization import JsonSerializer, refuse_pickles

QUEUES: Final = {"job": "jointstiff-jobs", "part": "jointstiff-parts"}
"""Queue of each kind of workflow."""
APPLICATION: Final = "jointstiff"
APPLICATION_VERSION: Final = "1"
"""The engine's own word for who may carry on what: all workers of a database, which has one version."""
_ASKED: Final = 10_000
"""Jobs asked for in one query: neither database takes one with any number of parameters."""
_ENDED: Final = ["SUCCESS", "ERROR", "MAX_RECOVERY_ATTEMPTS_EXCEEDED", "CANCELLED"]

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

    def enqueue(self, connection: Connection, kind: str, job_id: str) -> None:
        """Enqueue a job in the transaction that stores it: both are there, or neither is."""
        self._client.enqueue_in_transaction(connection, _announcement(job_id), kind, job_id)

    def pending(self) -> dict[str, tuple[str, str]]:
        """Workflows that a worker has taken and not ended: id → kind, executor."""
        workflows = self._client.list_workflows(status="PENDING", load_input=False, load_output=False)
        return {each.workflow_id: (each.name, str(each.executor_id)) for each in workflows}

    def has_parts(self, job_id: str) -> bool:
        """Return whether a job was shared out to parts."""
        some = self._client.list_workflows(
            workflow_id_prefix=f"{job_id}-", limit=1, load_input=False, load_output=False
        )
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
            for each in self._client.list_workflows(workflow_ids=some, load_input=False, load_output=False):
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
        workflows = self._client.list_workflows(
            name="job",
            status=_ENDED,
            completed_before=(datetime.now(UTC) - age).isoformat(),
            limit=limit,
            load_input=False,
            load_output=False,
        )
        identifiers = [each.workflow_id for each in workflows]
        if identifiers:
            self._client.delete_workflows(identifiers, delete_children=True)
        return identifiers


def _announcement(job_id: str) -> EnqueueOptions:
    return {
        "queue_name": QUEUES["job"],
        "workflow_name": "job",
        "workflow_id": job_id,
        "app_version": APPLICATION_VERSION,
    }


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


def schema_of(store: Store) -> str:
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
