"""A measurement set ready for computation."""

from __future__ import annotations

from dataclasses import dataclass

from jointstiff.schemas.measurement import QualityWarning
from jointstiff.service.conversion import ReadingArrays
from jointstiff.solver.readings import Measurements
from jointstiff.solver.robot import Robot

__all__ = ["PreparedSet"]


@dataclass(frozen=True, eq=False)
class PreparedSet:
    """A measurement set ready for computation, however many runs it gets.

    Attributes:
        robot: the robot that was measured.
        measurements: the readings in SI units.
        readings: the same as they are stored, for labels and names of targets.
        warnings: what was noticed when the set was stored.
        robot_id: of the stored robot.
        content: hash of robot and readings.
    """

    robot: Robot
    measurements: Measurements
    readings: ReadingArrays
    warnings: list[QualityWarning]
    robot_id: str
    content: str
