"""One identification, from a prepared measurement set to the numbers of a run. No store."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.measurement_set import QualityWarning
from schemas.run import RunOptions, RunResult
from service.conversion import ReadingArrays, to_result, to_settings, to_warnings
from solver.identification import identify
from solver.measurements import Measurements
from solver.plausibility import judge
from solver.prediction import predict
from solver.robot import Robot

__all__ = ["PreparedSet", "run_identification"]


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


def run_identification(prepared: PreparedSet, options: RunOptions) -> RunResult:
    """Identify, predict, and report.

    Raises:
        RequestError: the options do not fit the robot.
        UnsupportedMethodError: the readings cannot support the method.
        NotObservableError: the readings determine no joint.
        SolverError: optimality could not be certified.
    """
    settings = to_settings(options, prepared.robot)
    estimate = identify(prepared.robot, prepared.measurements, settings)
    prediction = predict(prepared.robot, prepared.measurements, estimate.compliance)
    warnings = prepared.warnings + to_warnings(judge(estimate, prediction), prepared.readings)
    return to_result(estimate, prediction, prepared.measurements, prepared.readings, warnings)
