"""Whether the service can do its work."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from schemas.base import Message

__all__ = ["Health"]


class Health(Message):
    """Answer of the health endpoint."""

    status: Literal["ok"]
    version: str = Field(description="Version of Jointstiff.")
    database: Literal["sqlite", "postgresql"]
