"""Access to the service: keys, sessions, audit; and its health."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Literal

from pydantic import AwareDatetime, Field, SecretStr, StrictBool, field_validator

from jointstiff.schemas.fields import Dimensionless, Message, Name, Timestamp, require_exactly_one
from jointstiff.schemas.query import PageQuery

Role = Literal["viewer", "operator", "admin"]
Access = Literal["loopback", "keys", "none"]
KeyId = Annotated[str, Field(pattern=r"^[0-9a-f]{10}$")]

_ROLE = "`viewer` reads; `operator` also posts and deletes; `admin` also issues keys, reads the audit."


class KeyRequest(Message):
    """A request to create a key."""

    name: Name = Field(
        description="Holder of the key: a person, a machine or a program.", examples=["tablet hall 3"]
    )
    role: Role = Field(description=_ROLE)
    expires_at: AwareDatetime | None = Field(
        default=None,
        description="Expiry time of the key, with a time zone; null if the key never expires.",
    )

    @field_validator("expires_at")
    @classmethod
    def _convert_to_utc(cls, time: datetime | None) -> datetime | None:
        try:
            return None if time is None else time.astimezone(UTC)
        except OverflowError:
            raise ValueError("must be a time before the year 10000 in UTC") from None


class Key(Message):
    """A key of the service."""

    id: KeyId
    name: str = Field(description="Holder of the key.")
    role: Role
    source: Literal["database", "file"] = Field(
        description="Place where the key is stored. A key from `--keys-file` is revoked in the key file."
    )
    created_at: Timestamp
    expires_at: Timestamp | None
    revoked_at: Timestamp | None
    last_used_at: Timestamp | None = Field(
        description="Time of the last use of the key, to the minute; null if unused or stored in a file."
    )
    key: str | None = Field(
        default=None,
        description="Secret to send as `Authorization: Bearer …`; null except in the answer that creates "
        "the key.",
    )


class SessionRequest(Message):
    """Request of a browser to sign in, with a key or with the secret of a one-time link."""

    key: Annotated[SecretStr, Field(max_length=200)] | None = Field(default=None, description="A key.")
    link: Annotated[SecretStr, Field(max_length=200)] | None = Field(
        default=None, description="Secret of a one-time link."
    )

    _one = require_exactly_one("key", "link")


class Session(Message):
    """Identity and role of the caller."""

    access: Access = Field(
        description="Callers that the service accepts. `loopback`: programs on the same machine; `keys`: "
        "holders of a key; `none`: everyone."
    )
    key_id: str | None = Field(description="Id of the caller's key; null if the caller has no valid key.")
    key_name: str | None = Field(description="Name of the caller's key.")
    role: Role | None = Field(description="Role of the caller's key.")
    ends_at: Timestamp | None = Field(
        description="Time at which the session ends. A session also ends after 8 h without use."
    )


class AuditItem(Message):
    """Entry of the audit for one request to change something."""

    at: Timestamp
    key_id: str | None = Field(description="Id of the caller's key; null if the caller has no valid key.")
    key_name: str | None = Field(description="Name of the key.")
    address: str = Field(
        description="Address of the caller; `terminal` for a command on the machine of the database."
    )
    method: str = Field(description="HTTP method.")
    operation: str | None = Field(description="Name of the operation, as in OpenAPI.")
    path: str = Field(description="Requested path without the query string.")
    status: int = Field(description="Outcome of the request: the HTTP status of the answer.")


class AuditQuery(PageQuery):
    """Filters of the audit."""

    key_id: KeyId | None = Field(default=None, description="Filter by key.")
    format: Literal["json", "csv"] = Field(
        default="json", description="Format of the answer; `csv` has the whole audit without pages."
    )


class StuckJob(Message):
    """A job that does not move."""

    job: str
    still_s: float
    why: str


class PartsWaiting(Message):
    """Parts of jobs that wait for a worker."""

    waiting: int
    oldest_s: float


class SolverHealth(Message):
    """Outcome of a known program that the numerical solver solved when the service started."""

    name: Literal["clarabel"]
    version: str
    agrees: StrictBool
    distance: Dimensionless[float | None] = Field(
        description="Distance of the solver's answer from the exact answer, relative to the readings; null "
        "without an answer."
    )
    why: str | None = Field(
        description="Reason why the solver's answer differs from the exact answer, and what to do."
    )


class Health(Message):
    """Answer of the health endpoint."""

    status: Literal["ok", "degraded"] = Field(description="`degraded`: see `solver`.")
    version: str = Field(description="Version of Jointstiff.")
    workers: int = Field(description="Number of worker processes; long jobs wait while there is none.")
    failing_workers: int = Field(
        description="Workers that stop soon after each start; the service's log has the reason."
    )
    database: Literal["sqlite", "postgresql"]
    stored_bytes: int = Field(description="Size of the database in bytes.")
    quota_bytes: int | None = Field(
        description="Quota in bytes: the service refuses new resources (507) while the database is larger."
    )
    access: Access = Field(
        description="Callers that the service accepts, as in `Session`; `none` if a proxy authenticates the "
        "callers."
    )
    stuck: list[StuckJob]
    queue: PartsWaiting
    solver: SolverHealth | None = Field(description="Null until checked.")
