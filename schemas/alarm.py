"""Alarms of a robot's trend, for those who show them beside robots and runs."""

from __future__ import annotations

from pydantic import Field

from jointstiff.schemas.fields import Dimensionless, Identifier, Message, Name, Timestamp


class TrendChange(Message):
    """A change of stiffness with its standard uncertainty."""

    relative: Dimensionless[float] = Field(
        description="Relative change: -0.1 for a joint that is 10 % softer."
    )
    standard_uncertainty: Dimensionless[float] = Field(
        description="Standard uncertainty of the change: readings, reference campaigns, and scatter between "
        "campaigns."
    )


class OpenAlarm(Message):
    """An alarm that has not ended and is not acknowledged."""

    serial_number: str | None = Field(description="Serial number of the robot; null if the sets state none.")
    joint: Name
    change: TrendChange = Field(description="Change of the latest campaign against the reference campaigns.")
    since: Timestamp = Field(description="Time of the first campaign of the alarm.")
    run_id: Identifier = Field(
        description="Id to send when you acknowledge the alarm: the run of its first campaign."
    )
    measurement_set_id: Identifier = Field(description="Measurement set of that campaign.")
    message: str = Field(description="Alarm in words: joint, direction, size, limit and first campaign.")

    @property
    def line(self) -> str:
        """Joint, change and day in a few words."""
        return f"{self.joint} {100.0 * self.change.relative:+.0f} % since {self.since:%Y-%m-%d}"
