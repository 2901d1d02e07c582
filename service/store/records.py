"""What the store takes and returns: one frozen dataclass a table, documents as JSON text.

An *entry* is what a listing shows; a *record* is an entry with its contents. The names and the
order of the fields are those of the columns in `jointstiff.service.store.tables`.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import ClassVar, Generic, TypeVar

__all__ = [
    "AnyJobRecord",
    "AnyRecord",
    "ComparisonEntry",
    "ComparisonRecord",
    "Entry",
    "GeometryEntry",
    "GeometryRecord",
    "IdempotencyKey",
    "JobRecord",
    "MeasurementSetEntry",
    "MeasurementSetRecord",
    "PairEntry",
    "PairRecord",
    "Record",
    "RecordPage",
    "RobotRecord",
    "RunEntry",
    "RunRecord",
]


@dataclass(frozen=True, slots=True)
class RobotRecord:
    """A robot. Its document is small, so that a listing shows the record itself."""

    title: ClassVar[str] = "robot"

    id: str
    name: str
    created_at: datetime
    """Aware, UTC, to the microsecond; so are all times of this module."""
    content_hash: str
    document: str
    """JSON text of `jointstiff.schemas.robot.Robot`."""


@dataclass(frozen=True, slots=True)
class MeasurementSetEntry:
    """A measurement set in a listing."""

    title: ClassVar[str] = "measurement set"

    id: str
    robot_id: str
    name: str
    encoders: str
    observation_count: int
    warning_count: int
    created_at: datetime


@dataclass(frozen=True, slots=True)
class MeasurementSetRecord(MeasurementSetEntry):
    """A measurement set with its readings."""

    content_hash: str
    document: str
    """JSON text of everything but the observations."""
    arrays: bytes
    """The observations' numbers (npz), which the store does not look into."""


@dataclass(frozen=True, slots=True)
class RunEntry:
    """A run in a listing."""

    title: ClassVar[str] = "run"

    id: str
    measurement_set_id: str
    robot_id: str
    method: str
    weighting: str
    positive: bool
    elasticity: str
    state: str
    created_at: datetime


@dataclass(frozen=True, slots=True)
class RunRecord(RunEntry):
    """A run with its result."""

    document: str
    """JSON text of `jointstiff.schemas.run.run.Run`."""


@dataclass(frozen=True, slots=True)
class ComparisonEntry:
    """A comparison in a listing."""

    title: ClassVar[str] = "comparison"

    id: str
    measurement_set_id: str
    robot_id: str
    state: str
    created_at: datetime


@dataclass(frozen=True, slots=True)
class ComparisonRecord(ComparisonEntry):
    """A comparison with its result."""

    document: str
    """JSON text of `jointstiff.schemas.comparison.Comparison`."""


@dataclass(frozen=True, slots=True)
class PairEntry:
    """A pair in a listing."""

    title: ClassVar[str] = "pair"

    id: str
    first_set_id: str
    second_set_id: str
    robot_id: str
    state: str
    created_at: datetime


@dataclass(frozen=True, slots=True)
class PairRecord(PairEntry):
    """A pair with its result."""

    document: str
    """JSON text of `jointstiff.schemas.pair.Pair`."""


@dataclass(frozen=True, slots=True)
class GeometryEntry:
    """A geometry in a listing."""

    title: ClassVar[str] = "geometry"

    id: str
    robot_id: str | None
    name: str
    state: str
    created_at: datetime


@dataclass(frozen=True, slots=True)
class GeometryRecord(GeometryEntry):
    """A geometry with its readings and its result."""

    document: str
    """JSON text of `jointstiff.schemas.geometry.message.Geometry`."""


@dataclass(frozen=True, slots=True)
class IdempotencyKey:
    """What a client sent to make a repeated post harmless."""

    key: str
    """The header as it came, any text; the store keeps its hash only."""
    body_hash: str
    """Hash of the body that came with it."""


AnyRecord = RobotRecord | MeasurementSetRecord | RunRecord | ComparisonRecord | PairRecord | GeometryRecord
AnyJobRecord = RunRecord | ComparisonRecord | PairRecord | GeometryRecord

Record = TypeVar(
    "Record", RobotRecord, MeasurementSetRecord, RunRecord, ComparisonRecord, PairRecord, GeometryRecord
)
JobRecord = TypeVar("JobRecord", RunRecord, ComparisonRecord, PairRecord, GeometryRecord)
Entry = TypeVar(
    "Entry", RobotRecord, MeasurementSetEntry, RunEntry, ComparisonEntry, PairEntry, GeometryEntry
)


@dataclass(frozen=True, slots=True)
class RecordPage(Generic[Entry]):
    """One page of a listing, newest first."""

    records: tuple[Entry, ...]
    next: str | None
    """Cursor of the following page; none on the last one."""
