"""What all jobs have in common, of whatever kind: state, progress and provenance."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from jointstiff.schemas.fields import Message, Timestamp

__all__ = ["JobState", "Progress", "Provenance"]

JobState = Literal["queued", "running", "succeeded", "failed", "cancelled"]


class Provenance(Message):
    """What it takes to repeat a job and get the same numbers."""

    versions: dict[str, str] = Field(description="Of this software and of what it computes with.")
    input_hash: str = Field(description="SHA-256 of robot, readings and request.")
    created_at: Timestamp
    started_at: Timestamp | None
    ended_at: Timestamp | None


class Progress(Message):
    """How far a job came."""

    done: int
    total: int
    unit: str = Field(description="Of both numbers.", examples=["resamples"])
    activity: str = Field(description="What the job is doing.", examples=["resampling"])
