"""Errors of the service, and the problem documents that tell them (RFC 9457)."""

from __future__ import annotations

from jointstiff.service.problems.errors import (
    AuthorisedError,
    CursorError,
    DeletedError,
    FilesError,
    IdempotencyConflictError,
    KeyRefusedError,
    NotEndedError,
    NotFoundError,
    OtherVersionError,
    QuotaError,
    ReferencedError,
    Resource,
    RoleError,
    StoreError,
    StoreUnavailableError,
    TooManyJobsError,
    WorkerLostError,
    WrongKeysError,
)
from jointstiff.service.problems.table import (
    MAX_ITEMS,
    MAX_PROBLEM_BYTES,
    http_problem,
    invalid_request,
    problem_of,
)
from jointstiff.service.problems.wording import reworded

__all__ = [
    "MAX_ITEMS",
    "MAX_PROBLEM_BYTES",
    "AuthorisedError",
    "CursorError",
    "DeletedError",
    "FilesError",
    "IdempotencyConflictError",
    "KeyRefusedError",
    "NotEndedError",
    "NotFoundError",
    "OtherVersionError",
    "QuotaError",
    "ReferencedError",
    "Resource",
    "RoleError",
    "StoreError",
    "StoreUnavailableError",
    "TooManyJobsError",
    "WorkerLostError",
    "WrongKeysError",
    "http_problem",
    "invalid_request",
    "problem_of",
    "reworded",
]
