"""The store on SQLite or PostgreSQL."""

from __future__ import annotations

from jointstiff.service.problems import (
    CursorError,
    DeletedError,
    IdempotencyConflictError,
    NotEndedError,
    NotFoundError,
    StoreError,
    StoreUnavailableError,
    TooManyJobsError,
)
from jointstiff.service.store.deletion import KEEP_DELETED
from jointstiff.service.store.heartbeats import SILENT_SECONDS, Heartbeats
from jointstiff.service.store.job_log import OPEN_STATES, JobStatus
from jointstiff.service.store.records import IdempotencyKey, JobRecord, MeasurementSetRecord, RobotRecord
from jointstiff.service.store.store import Store

__all__ = [
    "KEEP_DELETED",
    "OPEN_STATES",
    "SILENT_SECONDS",
    "CursorError",
    "DeletedError",
    "Heartbeats",
    "IdempotencyConflictError",
    "IdempotencyKey",
    "JobRecord",
    "JobStatus",
    "MeasurementSetRecord",
    "NotEndedError",
    "NotFoundError",
    "RobotRecord",
    "Store",
    "StoreError",
    "StoreUnavailableError",
    "TooManyJobsError",
]
