"""Whether the service can do its work."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from jointstiff.schemas.fields import Message


class Health(Message):
    """Answer of the health endpoint."""

    status: Literal["ok"]
    version: str = Field(description="Version of Jointstiff.")
    workers: int = Field(description="Workers heard of within 30 s; without one, long jobs wait.")
    database: Literal["sqlite", "postgresql"]
