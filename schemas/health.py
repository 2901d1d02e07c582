"""Health of the service."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from jointstiff.schemas.access import Access
from jointstiff.schemas.fields import Message


class Health(Message):
    """Answer of the health endpoint."""

    status: Literal["ok"]
    version: str = Field(description="Version of Jointstiff.")
    workers: int = Field(
        description="Number of workers with a sign of life within 30 s; without workers, long jobs wait."
    )
    failing_workers: int = Field(
        description="Number of workers of this service that end soon after each start; its log has the "
        "reason."
    )
    database: Literal["sqlite", "postgresql"]
    stored_bytes: int = Field(
        description="Size of the database in bytes, without free pages of a SQLite file."
    )
    quota_bytes: int | None = Field(
        description="Quota: above this size the service refuses new resources (507); null: no quota "
        "(`--quota`)."
    )
    access: Access = Field(
        description="Callers that the service answers. `loopback`: programs of the service's own "
        "machine. `keys`: holders of a key. `none`: everyone who reaches its address "
        "(`--no-access-control`); a proxy in front must authenticate."
    )
