"""The store: robots, measurement sets and jobs in SQLite or PostgreSQL."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from collections.abc import Collection as Ids
from contextlib import AbstractContextManager, suppress
from datetime import timedelta
from functools import cache
from typing import Final

import sqlalchemy as sa

from jointstiff.service.problems import Resource, StoreError
from jointstiff.service.store.access import AccessKeys, Sessions, WrongKeys
from jointstiff.service.store.bridges import Bridges
from jointstiff.service.store.collection import (
    MEASUREMENT_SET,
    Journal,
    LiveEntries,
    MeasurementSets,
    OpenSets,
    Robots,
)
from jointstiff.service.store.copies import name_left_copies
from jointstiff.service.store.database import Database, Dialect, Quota, sqlite_path_of
from jointstiff.service.store.jobs import Heartbeats, JobRecords, Steps, is_open
from jointstiff.service.store.layouts import can_upgrade
from jointstiff.service.store.listing import is_indexable
from jointstiff.service.store.rewriting import OldDocuments
from jointstiff.service.store.tables import (
    AuditEntry,
    LiveEntry,
    MeasurementSetEntry,
    MeasurementSetRecord,
    OpenSetRecord,
    TrendEntry,
    audit,
    jobs,
    live_entries,
    make_tables,
    measurement_sets,
    open_sets,
    read_layout,
    robots,
    select_fields_of,
)
from jointstiff.service.store.waiting import Waits

SESSION_IDLE: Final = timedelta(hours=8)
"""Time without use after which a session has ended."""
SESSION_LONGEST: Final = timedelta(days=7)
"""Time after which every session has ended."""

_IDS_AT_ONCE: Final = 500  # in one query
_PING = sa.select(robots.c.id).limit(1)
"""Query of a table of the store: a bare `SELECT 1` would not read the file of an SQLite database."""


class Store:
    """Store of robots, measurement sets and jobs in a database. Safe to use from several threads."""

    def __init__(self, database: Database, most_bytes: int | None = None) -> None:
        self._database = database
        self.quota = Quota(database, most_bytes)
        self.robots = Robots(database, self.quota)
        self.sets = MeasurementSets(
            database, MEASUREMENT_SET, measurement_sets, MeasurementSetRecord, MeasurementSetEntry, self.quota
        )
        # Declarations of live campaigns, and the entries of their readings and decisions
        self.open_sets = OpenSets(
            database, MEASUREMENT_SET, open_sets, OpenSetRecord, OpenSetRecord, self.quota
        )
        self.live_entries = LiveEntries(database, live_entries, LiveEntry, self.quota)
        self.bridges = Bridges(database)  # from trackers to the pages that show open sets
        # function that returns the jobs of a kind
        self.jobs: Callable[[Resource], JobRecords] = cache(
            lambda kind: JobRecords(database, kind, self.quota)
        )
        self.steps = Steps(database)  # results of the steps of jobs, until the jobs end
        self.heartbeats = Heartbeats(database)  # signs of life of the workers
        self.waits = Waits(database)  # what does not move, and why
        self.keys = AccessKeys(database)
        # sessions of browsers that signed in with a key
        self.sessions = Sessions(database, SESSION_IDLE, SESSION_LONGEST)
        self.wrong_keys = WrongKeys(database)  # counts of wrong keys for each network
        self.audit = Journal(database, audit, AuditEntry, None)  # all attempts to change something
        self.old_documents = OldDocuments(database)  # documents in a form of earlier layouts

    @classmethod
    def open(
        cls, url: str, most_bytes: int | None = None, upgrade: Callable[[str], object] | None = None
    ) -> Store:
        """Open the database at `url`; create the tables if it has none.

        Args:
            url: `sqlite:///path`, `postgresql://…`, or `sqlite://` for a database in memory, which one thread
                uses at a time, and whose content is lost when it is closed.
            most_bytes: size of the database at which new resources are refused [bytes]; None for no limit.
            upgrade: function that is called with a sentence for each step, if the tables are upgraded; None
                to refuse tables that must be upgraded.

        Raises:
            StoreError: The URL is not supported, or the tables are those of another version.
            StoreUnavailableError: The database does not answer.
        """
        database = Database.open(url)
        try:
            if upgrade is not None:
                _upgrade_if_due(database, url, upgrade)
            make_tables(database)
        except BaseException:
            database.close()
            raise
        return cls(database, most_bytes)

    def close(self) -> None:
        """Close all connections."""
        self._database.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def kind_of_job(self, job_id: str) -> str | None:
        """Return the kind of a job by name, even if the job was deleted; None if there is no such job."""
        if not is_indexable(job_id):  # no id that the database could store
            return None
        with self._database.reading() as connection:
            kind = connection.execute(sa.select(jobs.c.kind).where(jobs.c.id == job_id)).scalar_one_or_none()
        return None if kind is None else str(kind)

    def open_jobs(self, kinds: Ids[str]) -> dict[str, str]:
        """Return id of job → name of its kind, for the jobs of some kinds that have not ended."""
        unfinished = sa.select(jobs.c.id, jobs.c.kind).where(jobs.c.kind.in_(kinds), is_open)
        return {str(row.id): str(row.kind) for row in self._database.rows(unfinished)}

    def find_unfinished_jobs(self, job_ids: Ids[str]) -> set[str]:
        """Return the ids among `job_ids` whose jobs have not ended."""
        unfinished = sa.select(jobs.c.id).where(jobs.c.id.in_(job_ids), is_open)
        return {str(row.id) for row in self._database.rows(unfinished)}

    def runs_with_numbers(self, robot_id: str, limit: int) -> list[TrendEntry]:
        """Return the newest runs of a robot that have numbers for a trend, newest first."""
        conditions = [jobs.c.robot_id == robot_id, jobs.c.trend.is_not(None), jobs.c.deleted_at.is_(None)]
        newest = (
            select_fields_of(jobs, TrendEntry)
            .where(*conditions)
            .order_by(jobs.c.sequence.desc())
            .limit(limit)
        )
        return [TrendEntry(*row) for row in self._database.rows(newest)]

    def read_trend_numbers(self, run_ids: Sequence[str]) -> dict[str, str]:
        """Return id of a run → its numbers for a trend as JSON, for those of `run_ids` that are stored."""
        numbers: dict[str, str] = {}
        for start in range(0, len(run_ids), _IDS_AT_ONCE):
            ids = run_ids[start : start + _IDS_AT_ONCE]
            query = sa.select(jobs.c.id, jobs.c.trend).where(jobs.c.id.in_(ids), jobs.c.trend.is_not(None))
            numbers |= {str(row.id): str(row.trend) for row in self._database.rows(query)}
        return numbers

    def sets_of_robot(self, robot_id: str) -> list[MeasurementSetEntry]:
        """Return the entries of a robot's measurement sets, newest first; without deleted sets."""
        sets = measurement_sets.c
        query = select_fields_of(measurement_sets, MeasurementSetEntry).where(sets.robot_id == robot_id)
        shown = query.where(sets.deleted_at.is_(None)).order_by(sets.sequence.desc())
        names = [column.name for column in shown.selected_columns]
        # Not `row._mapping`, which takes three times as long: a robot may have thousands of sets.
        return [
            MeasurementSetEntry(**dict(zip(names, row, strict=True))) for row in self._database.rows(shown)
        ]

    def transaction(self) -> AbstractContextManager[sa.Connection]:
        """Return a context manager of a transaction, in which store and job queue can both write."""
        return self._database.writing()

    def schema(self) -> str | None:
        """Return the schema of the tables on PostgreSQL; None on SQLite."""
        if self._database.dialect == "sqlite":
            return None
        return str(self._database.rows(sa.select(sa.func.current_schema()))[0][0])

    def ping(self) -> Dialect:
        """Read from the database to check that it answers; return its dialect.

        Raises:
            StoreUnavailableError: The database does not answer.
        """
        with self._database.reading() as connection:
            connection.execute(_PING)
        return self._database.dialect


def _upgrade_if_due(database: Database, url: str, notify: Callable[[str], object]) -> None:
    """Carry out the expand steps that a database lacks; `notify` is called with a sentence for each step."""
    with database.reading() as connection:
        layout = read_layout(connection)
    if layout is None:
        return
    if database.dialect == "sqlite":
        with suppress(StoreError):  # a database in memory has no copies
            name_left_copies(sqlite_path_of(sa.make_url(url)), layout)
    if can_upgrade(layout):
        # Imported here, because a service rarely needs Alembic
        from jointstiff.service.store.upgrading import upgrade_by_expansion

        upgrade_by_expansion(url, notify)
