"""Messages of a small kind of work: how many readings a measurement set has."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from jointstiff.schemas.fields import Identifier, Message, Timestamp
from jointstiff.schemas.job import Job, JobState


class SmallOptions(Message):
    """Options of a count."""

    least: int = Field(default=0, description="Least number of targets of an observation that counts.")


class SmallRequest(SmallOptions):
    """A count as it is posted."""

    measurement_set_id: Identifier


class SmallResult(Message):
    """A count."""

    observations: int
    readings: int


class SmallSummary(Message):
    """A count in a listing."""

    id: Identifier
    robot_id: Identifier
    measurement_set_id: Identifier
    state: JobState
    created_at: Timestamp


class Small(Job):
    """A stored count."""

    kind: ClassVar[str] = "small"
    collection: ClassVar[str] = "smalls"

    request: SmallRequest
    result: SmallResult | None = Field(description="Present if the count succeeded.")
