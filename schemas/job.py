"""The message of a job of any kind: its state, its progress, its provenance."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from jointstiff.schemas.fields import Identifier, Message, Timestamp
from jointstiff.schemas.problem import Problem

JobState = Literal["queued", "running", "succeeded", "failed", "cancelled"]


class Provenance(Message):
    """What it takes to repeat a job and get the same numbers."""

    versions: dict[str, str] = Field(description="Versions of this software and of what it computes with.")
    input_hash: str = Field(description="SHA-256 of robot, readings and request.")
    created_at: Timestamp
    started_at: Timestamp | None
    ended_at: Timestamp | None


class Progress(Message):
    """Units of work that are done."""

    done: int
    total: int
    unit: str = Field(description="Unit of both numbers.", examples=["resamples"])
    activity: str = Field(description="What the job is doing.", examples=["resampling"])


class Job(Message):
    """A request, what came of it, and how. It never changes once it has ended.

    Attributes:
        kind: name of this kind of job.
        collection: name of all jobs of this kind in addresses.
    """

    kind: ClassVar[str]
    collection: ClassVar[str]

    id: Identifier
    state: JobState = Field(
        description="`queued` and `running` jobs have not ended: look again, or follow the address of the "
        "job, /events."
    )
    progress: Progress | None = Field(default=None, description="Null for a job that is carried out at once.")
    request: Message
    result: Message | None = Field(description="Present if the job succeeded.")
    error: Problem | None = Field(description="Present if the job failed.")
    provenance: Provenance
