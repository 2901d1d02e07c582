"""The tables. `jointstiff.service.store.migrations` builds them; a test holds the two together."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    DateTime,
    Dialect,
    ForeignKey,
    Identity,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    TypeDecorator,
)

from jointstiff.service.store.records import (
    AnyRecord,
    ComparisonEntry,
    ComparisonRecord,
    GeometryEntry,
    GeometryRecord,
    MeasurementSetEntry,
    MeasurementSetRecord,
    PairEntry,
    PairRecord,
    RobotRecord,
    RunEntry,
    RunRecord,
)

__all__ = [
    "FILTERS",
    "PARENTS",
    "TABLES",
    "heartbeats",
    "idempotency_keys",
    "job_deaths",
    "job_steps",
    "metadata",
]

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_N_name)s",
        "pk": "pk_%(table_name)s",
    }
)


class UtcDateTime(TypeDecorator[datetime]):
    """An aware time, UTC on both databases: SQLite has no time zones, PostgreSQL has its own."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, _: Dialect) -> datetime | None:
        """Turn an aware time into UTC."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError("a stored time must have a time zone")
        return value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, _: Dialect) -> datetime | None:
        """Read UTC back."""
        if value is None:
            return None
        return value.astimezone(UTC) if value.tzinfo else value.replace(tzinfo=UTC)


def _jobs(name: str, *columns: Column[Any], filters: tuple[str, ...]) -> Table:
    """A table of records that can be deleted: hidden from when `deleted_at` says, removed later."""
    table = _listed(name, *columns, Column("deleted_at", UtcDateTime, nullable=True), filters=filters)
    deleted = table.c.deleted_at.is_not(None)
    Index(None, table.c.deleted_at, sqlite_where=deleted, postgresql_where=deleted)
    return table


def _listed(name: str, *columns: Column[Any], filters: tuple[str, ...]) -> Table:
    """A table of records: listed by `sequence`, newest first, within any one filter's value."""
    return Table(
        name,
        metadata,
        Column(
            "sequence",
            BigInteger().with_variant(Integer, "sqlite"),
            Identity(always=True),
            primary_key=True,
        ),
        Column("id", String, nullable=False, unique=True),
        *columns,
        *(Index(None, column, "sequence") for column in filters),
    )


_robots = _listed(
    "robots",
    Column("name", String, nullable=False),
    Column("created_at", UtcDateTime, nullable=False),
    Column("content_hash", String, nullable=False),
    Column("document", Text, nullable=False),
    filters=("name",),
)

_measurement_sets = _listed(
    "measurement_sets",
    Column("robot_id", String, ForeignKey("robots.id"), nullable=False),
    Column("name", String, nullable=False),
    Column("encoders", String, nullable=False),
    Column("observation_count", Integer, nullable=False),
    Column("warning_count", Integer, nullable=False),
    Column("created_at", UtcDateTime, nullable=False),
    Column("content_hash", String, nullable=False),
    Column("document", Text, nullable=False),
    Column("arrays", LargeBinary, nullable=False),
    filters=("robot_id", "name", "encoders"),
)

_runs = _jobs(
    "runs",
    Column("measurement_set_id", String, ForeignKey("measurement_sets.id"), nullable=False),
    Column("robot_id", String, ForeignKey("robots.id"), nullable=False),
    Column("method", String, nullable=False),
    Column("weighting", String, nullable=False),
    Column("positive", Boolean, nullable=False),
    Column("elasticity", String, nullable=False, server_default="joints"),
    Column("state", String, nullable=False),
    Column("created_at", UtcDateTime, nullable=False),
    Column("document", Text, nullable=False),
    filters=("measurement_set_id", "robot_id", "method", "weighting", "elasticity", "state"),
)

_comparisons = _jobs(
    "comparisons",
    Column("measurement_set_id", String, ForeignKey("measurement_sets.id"), nullable=False),
    Column("robot_id", String, ForeignKey("robots.id"), nullable=False),
    Column("state", String, nullable=False),
    Column("created_at", UtcDateTime, nullable=False),
    Column("document", Text, nullable=False),
    filters=("measurement_set_id", "robot_id", "state"),
)

_pairs = _jobs(
    "pairs",
    Column("first_set_id", String, ForeignKey("measurement_sets.id"), nullable=False),
    Column("second_set_id", String, ForeignKey("measurement_sets.id"), nullable=False),
    Column("robot_id", String, ForeignKey("robots.id"), nullable=False),
    Column("state", String, nullable=False),
    Column("created_at", UtcDateTime, nullable=False),
    Column("document", Text, nullable=False),
    filters=("first_set_id", "second_set_id", "robot_id", "state"),
)

_geometries = _jobs(
    "geometries",
    Column("robot_id", String, ForeignKey("robots.id"), nullable=True),
    Column("name", String, nullable=False),
    Column("state", String, nullable=False),
    Column("created_at", UtcDateTime, nullable=False),
    Column("document", Text, nullable=False),
    filters=("robot_id", "name", "state"),
)

idempotency_keys = Table(
    "idempotency_keys",
    metadata,
    Column("resource", String, primary_key=True),  # name of the table of what the key created
    Column("key_hash", String, primary_key=True),  # SHA-256: a key may be any text of any length
    Column("body_hash", String, nullable=False),
    Column("resource_id", String, nullable=False),
    Column("created_at", UtcDateTime, nullable=False),
)

job_steps = Table(
    "job_steps",
    metadata,
    Column("job_id", String, primary_key=True),  # of a job of any kind
    Column("start", Integer, primary_key=True, autoincrement=False),
    Column("done", Integer, nullable=False),
)

job_deaths = Table(
    "job_deaths",
    metadata,
    Column("job_id", String, primary_key=True),  # of a job of any kind
    Column("deaths", Integer, nullable=False),
)

heartbeats = Table(
    "heartbeats",
    metadata,
    Column("executor", String, primary_key=True),
    Column("beat_at", UtcDateTime, nullable=False),
)

TABLES: Mapping[type, Table] = MappingProxyType(
    {
        RobotRecord: _robots,
        MeasurementSetEntry: _measurement_sets,
        MeasurementSetRecord: _measurement_sets,
        RunEntry: _runs,
        RunRecord: _runs,
        ComparisonEntry: _comparisons,
        ComparisonRecord: _comparisons,
        PairEntry: _pairs,
        PairRecord: _pairs,
        GeometryEntry: _geometries,
        GeometryRecord: _geometries,
    }
)
"""Where records and entries live."""

FILTERS: Mapping[type, frozenset[str]] = MappingProxyType(
    {
        kind: frozenset(index.columns[0].name for index in table.indexes if "sequence" in index.columns)
        for kind, table in TABLES.items()
    }
)
"""The columns by which a listing can be narrowed: those that have an index for it."""

PARENTS: Mapping[type, Mapping[str, type[AnyRecord]]] = MappingProxyType(
    {
        RobotRecord: {},
        MeasurementSetRecord: {"robot_id": RobotRecord},
        RunRecord: {"measurement_set_id": MeasurementSetRecord, "robot_id": RobotRecord},
        ComparisonRecord: {"measurement_set_id": MeasurementSetRecord, "robot_id": RobotRecord},
        PairRecord: {
            "first_set_id": MeasurementSetRecord,
            "second_set_id": MeasurementSetRecord,
            "robot_id": RobotRecord,
        },
        GeometryRecord: {},  # its robot need not be stored
    }
)
"""What must be there before a record can be added: column → kind."""
