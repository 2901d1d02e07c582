"""The store on SQLite or PostgreSQL."""

from __future__ import annotations

from jointstiff.service.store.deletion import KEEP_DELETED
from jointstiff.service.store.errors import (
    CursorError,
    DeletedError,
    IdempotencyConflictError,
    NotEndedError,
    NotFoundError,
    StoreError,
    StoreUnavailableError,
    TooManyJobsError,
)
from jointstiff.service.store.heartbeats import SILENT_SECONDS, Heartbeats
from jointstiff.service.store.job_log import OPEN_STATES, Standing
from jointstiff.service.store.records import (
    ComparisonEntry,
    ComparisonRecord,
    GeometryEntry,
    GeometryRecord,
    IdempotencyKey,
    JobRecord,
    MeasurementSetEntry,
    MeasurementSetRecord,
    PairEntry,
    PairRecord,
    RobotRecord,
    RunEntry,
    RunRecord,
)
from jointstiff.service.store.store import Store

__all__ = [
    "KEEP_DELETED",
    "OPEN_STATES",
    "SILENT_SECONDS",
    "ComparisonEntry",
    "ComparisonRecord",
    "CursorError",
    "DeletedError",
    "GeometryEntry",
    "GeometryRecord",
    "Heartbeats",
    "IdempotencyConflictError",
    "IdempotencyKey",
    "JobRecord",
    "MeasurementSetEntry",
    "MeasurementSetRecord",
    "NotEndedError",
    "NotFoundError",
    "PairEntry",
    "PairRecord",
    "RobotRecord",
    "RunEntry",
    "RunRecord",
    "Standing",
    "Store",
    "StoreError",
    "StoreUnavailableError",
    "TooManyJobsError",
]
