"""A campaign file: everything an identification needs in one JSON document."""

from __future__ import annotations

from pydantic import Field

from jointstiff.schemas.fields import Message
from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import CampaignRun


class Campaign(Message):
    """One robot, one measurement set of it, and the options of the run."""

    robot: RobotDocument
    measurement_set: MeasurementSetDocument
    run: CampaignRun = Field(default_factory=CampaignRun)
