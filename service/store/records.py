"""Records of the store: one frozen dataclass a table, documents as JSON text.

An *entry* is what a listing shows; a *record* is an entry with its contents. The fields are the columns of
the tables, which `jointstiff.service.store.tables` makes of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Final, Generic, TypeVar


@dataclass(frozen=True, slots=True)
class RobotRecord:
    """A robot. Its document is small, so that a listing shows the record itself."""

    id: str
    name: str
    created_at: datetime  # aware, UTC, to the microsecond; so are all times of this module
    content_hash: str
    document: str
    """JSON text of `jointstiff.schemas.robot.Robot`; `name` and `archived` are those of the columns."""
    archived: bool = field(default=False, kw_only=True)  # whether listings leave it out; nothing else changes


@dataclass(frozen=True, slots=True)
class MeasurementSetEntry:
    """A measurement set in a listing."""

    id: str
    robot_id: str
    name: str
    encoders: str
    observation_count: int
    warning_count: int
    created_at: datetime
    content_hash: str
    archived: bool = field(default=False, kw_only=True)  # whether listings leave it out; nothing else changes
    measured_at: datetime | None = field(default=None, kw_only=True)
    operator: str | None = field(default=None, kw_only=True)
    instrument: str | None = field(default=None, kw_only=True)
    serial_number: str | None = field(default=None, kw_only=True)
    item_condition: str | None = field(default=None, kw_only=True)
    conditions: str | None = field(default=None, kw_only=True)
    notes: str | None = field(default=None, kw_only=True)


@dataclass(frozen=True, slots=True)
class MeasurementSetRecord(MeasurementSetEntry):
    """A measurement set with its readings."""

    document: str
    """JSON text of everything but the observations; what is a column, too, is that of the column."""
    arrays: bytes  # the observations' numbers (npz), which the store does not look into


@dataclass(frozen=True, slots=True)
class JobEntry:
    """A job of any kind in a listing."""

    id: str
    kind: str
    state: str
    created_at: datetime
    summary: dict[str, Any]
    """The message of the job in a listing; fields that are columns of the table stand there, too."""


@dataclass(frozen=True, slots=True)
class JobRecord(JobEntry):
    """A job with its result."""

    robot_id: str | None
    measurement_set_id: str | None
    first_set_id: str | None
    second_set_id: str | None
    name: str | None
    method: str | None
    weighting: str | None
    elasticity: str | None
    verdict: str | None
    document: str  # JSON text of the kind's message


@dataclass(frozen=True, slots=True)
class IdempotencyKey:
    """A client's key that makes a repeated post harmless."""

    key: str  # the header as it came, any text; the store keeps its hash only
    body_hash: str  # hash of the body that came with it


@dataclass(frozen=True, slots=True)
class AccessKey:
    """A key that lets its holder in. The key itself is known to its holder alone."""

    id: str
    name: str  # holder of the key, for people
    role: str  # `viewer`, `operator` or `admin`
    key_hash: str
    """SHA-256 of the key. A slow hash protects what people choose; nobody guesses 256 random bits."""
    created_at: datetime
    expires_at: datetime | None
    revoked_at: datetime | None
    last_used_at: datetime | None  # to the minute

    def is_live(self, now: datetime) -> bool:
        """Return whether it opens the service at a time."""
        return self.revoked_at is None and (self.expires_at is None or now < self.expires_at)


@dataclass(frozen=True, slots=True)
class SessionRecord:
    """A browser that signed in with a key. The token itself is in its cookie alone."""

    token_hash: str
    key_id: str
    created_at: datetime
    used_at: datetime  # to the minute


@dataclass(frozen=True, slots=True)
class AuditEntry:
    """An attempt to change something, and its outcome."""

    at: datetime
    key_id: str | None
    key_name: str | None
    address: str  # where it came from; `terminal` for commands on the database itself
    method: str
    operation: str | None  # name of the operation; none if the address has none of that method
    path: str
    status: int


@dataclass(frozen=True, slots=True)
class TrendNote:
    """Note in a trend: a new baseline, or that an alarm was seen."""

    robot_id: str
    kind: str  # `baseline` or `acknowledgement`
    noted_at: datetime
    key_id: str | None
    key_name: str | None
    document: str  # JSON text of the request, with what identifies the campaign


@dataclass(frozen=True, slots=True)
class AuthorisationRecord:
    """Authorisation of the report of a run."""

    run_id: str
    supersedes: str | None  # run whose report this one replaces
    authorised_at: datetime
    key_id: str
    key_name: str
    content_hash: str  # SHA-256 of what was authorised
    note: str | None
    number: int  # number of the report among those of its run, from 1
    stated: str  # JSON of what it states beside the run: names, metadata of the set, laboratory, logo
    pdf_sha256: str
    pdf: bytes  # the report as it was issued; so is the page
    page: bytes


@dataclass(frozen=True, slots=True)
class WebhookRecord:
    """An address that is told of events."""

    id: str
    url: str
    events: str  # JSON list of the types of events
    secret: str  # signs the messages, so that it is kept as it is
    address: str  # address of the service, as the admin reached it: links begin with it
    created_at: datetime


@dataclass(frozen=True, slots=True)
class DeliveryRecord:
    """A message to a webhook."""

    webhook_id: str
    message_id: str  # the same at each attempt, and for the same event
    type: str
    subject: str  # job or worker that it is about; messages about one go in order
    document: str  # JSON that is sent; empty for alarms that are yet to be derived from the trends
    created_at: datetime
    state: str  # `pending`, `delivered` or `dead`
    attempts: int
    due_at: datetime  # time of the next attempt, or while one is under way, when it is taken for lost
    error: str | None


OPEN_STATES: Final = ("queued", "running")
"""States of a job that has not ended; all others are final."""

AnyRecord = RobotRecord | MeasurementSetRecord | JobRecord

Record = TypeVar("Record", RobotRecord, MeasurementSetRecord, JobRecord)
Entry = TypeVar("Entry", RobotRecord, MeasurementSetEntry, JobEntry)


Row = TypeVar("Row")


@dataclass(frozen=True, slots=True)
class RecordPage(Generic[Row]):
    """One page of a listing, newest first."""

    records: tuple[Row, ...]
    next: str | None  # cursor of the following page; none on the last one
