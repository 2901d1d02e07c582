"""A campaign file: everything an identification needs in one JSON document."""

from __future__ import annotations

from pydantic import Field

from schemas.base import Message
from schemas.measurement_set import MeasurementSetDocument
from schemas.robot import RobotDocument
from schemas.run_options import RunOptions

__all__ = ["Campaign"]


class Campaign(Message):
    """One robot, one measurement set of it, and how to identify."""

    robot: RobotDocument
    measurement_set: MeasurementSetDocument
    run: RunOptions = Field(default_factory=RunOptions)
