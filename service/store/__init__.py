"""The store on SQLite or PostgreSQL."""

from __future__ import annotations

from jointstiff.service.problems import (
    CursorError,
    DeletedError,
    IdempotencyConflictError,
    NotEndedError,
    NotFoundError,
    QuotaError,
    ReferencedError,
    StoreError,
    StoreUnavailableError,
    TooManyJobsError,
)
from jointstiff.service.store.access import KEY, MINUTE
from jointstiff.service.store.backups import Manifest, back_up, restore
from jointstiff.service.store.deletion import KEEP_DELETED, Deletions
from jointstiff.service.store.heartbeats import SILENT_SECONDS, Heartbeats
from jointstiff.service.store.inspection import Fault, Inspection
from jointstiff.service.store.job_log import OPEN_STATES, JobStatus
from jointstiff.service.store.records import (
    AccessKey,
    AuditEntry,
    AuthorisationRecord,
    IdempotencyKey,
    JobEntry,
    JobRecord,
    MeasurementSetEntry,
    MeasurementSetRecord,
    RobotRecord,
    SessionRecord,
    TrendNote,
)
from jointstiff.service.store.store import SESSION_IDLE, SESSION_LONGEST, Store

__all__ = [
    "KEEP_DELETED",
    "KEY",
    "MINUTE",
    "OPEN_STATES",
    "SESSION_IDLE",
    "SESSION_LONGEST",
    "SILENT_SECONDS",
    "AccessKey",
    "AuditEntry",
    "AuthorisationRecord",
    "CursorError",
    "DeletedError",
    "Deletions",
    "Fault",
    "Heartbeats",
    "IdempotencyConflictError",
    "IdempotencyKey",
    "Inspection",
    "JobEntry",
    "JobRecord",
    "JobStatus",
    "Manifest",
    "MeasurementSetEntry",
    "MeasurementSetRecord",
    "NotEndedError",
    "NotFoundError",
    "QuotaError",
    "ReferencedError",
    "RobotRecord",
    "SessionRecord",
    "Store",
    "StoreError",
    "StoreUnavailableError",
    "TooManyJobsError",
    "TrendNote",
    "back_up",
    "restore",
]
