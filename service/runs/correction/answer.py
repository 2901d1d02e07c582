"""Correction of a table of poses: the options of a request read, the rows corrected, and the answer made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.schemas.correction import CorrectionOptions, CorrectionRequest, CorrectionResult
from jointstiff.schemas.finding import Assessment
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.robots import (
    joint_factors,
    joint_kinds_by_name,
    refuse_far_point,
    refuse_wrong_joint_count,
)
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH
from jointstiff.service.runs.correction.columns import DEFLECTION, POSITION, STATUS, name_joint_columns
from jointstiff.service.runs.correction.orientation import write_orientation
from jointstiff.service.runs.correction.poses import PoseTable
from jointstiff.service.runs.correction.verdict import (
    NAMES,
    count_statuses,
    describe_rows,
    find_first_rows,
    find_reasons,
)
from jointstiff.service.runs.verdicts import PriorModel, RunModel, assess_with_run
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.correct.correct import (
    CorrectedRows,
    CorrectionSettings,
    FoundPath,
    Waypoints,
    place_forces,
    turn_loads,
)
from jointstiff.solver.errors import InputError, RequestError
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.forward import CorrectionLimits


@dataclass(frozen=True, eq=False)
class CorrectedTable:
    """Corrected rows with their assessment."""

    rows: CorrectedRows
    assessment: Assessment
    remarks: list[str]
    confidence: float

    @property
    def statuses(self) -> list[str]:
        """(N,) names of the statuses of the rows."""
        return [NAMES[each] for each in self.rows.status.tolist()]

    def describe(self, robot: Robot) -> dict[str, Any]:
        """Return the fields of `CorrectionResult` by name, without the rows."""
        return {
            "joint_kinds": joint_kinds_by_name(robot),
            "assessment": self.assessment,
            "confidence": self.confidence,
            "counts": count_statuses(self.rows),
            "first": find_first_rows(self.rows),
            "remarks": [*describe_rows(self.rows), *self.remarks],
        }

    def list_columns(self, table: PoseTable, units: Units, robot: Robot) -> dict[str, Any]:
        """Return the columns of the answer by name, in the units of the request; NaN without a number."""
        rows, length = self.rows, LENGTH[units.length]
        columns: dict[str, Any] = {STATUS: self.statuses}
        columns |= dict(zip(POSITION, (rows.poses[:, :3, 3] / length).T, strict=True))
        orientation = write_orientation(table.orientation, rows.poses[:, :3, :3], units)
        columns |= dict(zip(table.orientation, orientation.T, strict=True))
        joints = rows.joints / joint_factors(robot, units)
        columns |= {f"j{number}": column for number, column in enumerate(joints.T, 1)}
        columns |= dict(zip(DEFLECTION, (rows.deflection / length).T, strict=True))
        columns["readings"] = rows.readings / length
        columns["model_error"] = rows.with_model_error / length
        columns["residual"] = rows.residual / length
        columns["joint_speed"] = rows.joint_speed / ANGLE[units.angle]
        return columns


@dataclass(frozen=True, eq=False)
class TableCorrection:
    """A table of poses with the postures of its rows, which are corrected block by block by `path`."""

    path: FoundPath
    options: CorrectionOptions
    _model: RunModel | PriorModel
    _points: list[list[float]]  # points that must not be far from the flange, flange frame [m]

    @classmethod
    def prepare(
        cls, robot: Robot, run: Run | None, options: CorrectionOptions, table: PoseTable
    ) -> TableCorrection:
        """Find the postures of a table, for the model of a run or, without one, for the prior of the robot.

        Raises:
            RequestError: the run has no model, the options contradict each other, or poses and joints do.
        """
        refuse_foreign_fields(options, is_program=False)
        refuse_compensating_controller(options)
        units, length = options.units, LENGTH[options.units.length]
        model = _build_model(robot, run, options)
        tool, base = _read_frame(options.tool, units), _read_frame(options.base, units)
        refuse_far_point(options.load_point, "load_point", length=length)
        load_point = None if options.load_point is None else length * np.array(options.load_point)
        waypoints = Waypoints(table.poses, tool, base, table.joints, read_start(robot, options))
        loads = turn_loads(waypoints.find_axes(options.axes), _state_loads(options, table, waypoints))
        path = FoundPath.find(
            model.model,
            model.error,
            _build_inverse(robot, waypoints),
            waypoints,
            loads,
            CorrectionSettings(read_limits(options), options.confidence),
            load_point=load_point,
            feed=None if options.feed is None else length * options.feed,
        )
        tool_point = tool[:3, 3]
        points = [tool_point] if load_point is None else [tool_point, load_point]
        return cls(path, options, model, [point.tolist() for point in points])

    def conclude(self, blocks: Sequence[CorrectedRows]) -> CorrectedTable:
        """Return the corrected table, from all corrected blocks of rows in order."""
        rows, confidence = self.path.join(blocks), self.options.confidence
        reasons = find_reasons(rows, self._points, self._model)
        assessment = assess_with_run("correction", reasons, self._model.assessment)
        return CorrectedTable(rows, assessment, self._model.remarks(confidence), confidence)


def refuse_foreign_fields(options: CorrectionOptions, *, is_program: bool) -> None:
    """Refuse options that concern only tables or, if `is_program` is false, only programs.

    Raises:
        RequestError: such an option is stated, or the controller's accuracy option of a program is missing.
    """
    for name in options.list_foreign_fields(is_program=is_program):
        reason = f"`{name}` does not concern a {'program' if is_program else 'table of poses'}"
        remedy = "omit it; state frames of a program in `tools` and `bases`" if is_program else "omit it"
        raise RequestError(reason, where=name, remedy=remedy)
    if is_program and options.accuracy_option is None:
        raise RequestError(
            "the accuracy option of the controller is missing",
            where="accuracy_option",
            remedy="give `accuracy_option`: one of off, same_as_measured",
        )


def refuse_compensating_controller(options: CorrectionOptions) -> None:
    """Refuse a correction for a controller that compensates the load, because the load would count twice.

    Raises:
        RequestError: the controller's accuracy option compensates the deflection under load.
    """
    if options.accuracy_option == "compensates_load":
        raise RequestError(
            "the controller already compensates the deflection under load, so a second compensation would "
            "be wrong",
            where="accuracy_option",
            remedy="switch the controller's accuracy option off, repeat the measurement, and set "
            "`accuracy_option` to `off`",
        )


def read_start(robot: Robot, options: CorrectionOptions) -> FloatArray | None:
    """Return the controller's joints (n,) near the first pose [rad or m]; None if they are not stated.

    Raises:
        RequestError: the number of joints does not fit the robot.
    """
    if options.start is None:
        return None
    refuse_wrong_joint_count(robot, options.start, "start")
    return np.asarray(joint_factors(robot, options.units) * np.array(options.start))


def _build_inverse(robot: Robot, waypoints: Waypoints) -> InverseKinematics:
    """Return the inverse kinematics, with prismatic joints where the first row or the start has them.

    Raises:
        RequestError: the robot has no known inverse kinematics, or prismatic joints of unknown position.
    """
    fixed = waypoints.start if waypoints.joints is None else waypoints.joints[0]
    try:
        return InverseKinematics(robot, fixed)
    except InputError as error:
        raise RequestError(error.reason, remedy=error.remedy, where=error.where) from error


def read_limits(options: CorrectionOptions) -> CorrectionLimits:
    """Return the limits of corrections [m, rad], the usual ones where the options state none."""
    limits = CorrectionLimits()
    if options.max_displacement is not None:
        limits = replace(limits, displacement=LENGTH[options.units.length] * options.max_displacement)
    if options.max_rotation is not None:
        limits = replace(limits, rotation=ANGLE[options.units.angle] * options.max_rotation)
    return limits


def _build_model(robot: Robot, run: Run | None, options: CorrectionOptions) -> RunModel | PriorModel:
    """Return the model of a run, or the prior of the robot.

    Raises:
        RequestError: the run has no model, or the robot no prior.
    """
    try:
        if run is None:
            return PriorModel.from_robot(robot, weighted=bool(options.masses) or options.absolute)
        length = LENGTH[options.units.length]
        return RunModel.from_run(robot, run, absolute=options.absolute, masses=options.masses, length=length)
    except InputError as error:
        raise RequestError(error.reason, remedy=error.remedy, where=error.where) from error


def _read_frame(numbers: Sequence[float] | None, units: Units) -> FloatArray:
    """Return the pose (4, 4) [m] of X, Y, Z and a rotation vector; the identity without numbers."""
    pose = np.eye(4)
    if numbers is not None:
        pose[:3, 3] = LENGTH[units.length] * np.array(numbers[:3])
        vector = ANGLE[units.angle] * np.array(numbers[3:])
        pose[:3, :3] = Rotation.from_rotvec(vector).as_matrix()
    return pose


def _state_loads(options: CorrectionOptions, table: PoseTable, waypoints: Waypoints) -> FloatArray:
    """Return the loads (N, 6) [N, N·m] of the rows along the axes of the options.

    Raises:
        RequestError: there is no load, or there are two.
    """
    if table.loads is not None:
        if options.force is not None:
            raise RequestError(
                "the load is stated twice", where="force", remedy="give `force`, or columns fx, fy, fz"
            )
        return table.loads
    if options.force is None and not options.absolute:
        raise RequestError("the load is missing", where="force", remedy="give `force`, or columns fx, fy, fz")
    force = np.zeros(3) if options.force is None else FORCE[options.units.force] * np.array(options.force)
    return np.pad(place_forces(force, waypoints.lengths), ((0, 0), (0, 3)))  # without moments


def correct_request(robot: Robot, run: Run | None, request: CorrectionRequest) -> CorrectionResult:
    """Correct the columns of a request at once; return the answer, with null where a row has no number.

    Raises:
        RequestError: the request cannot be carried out.
    """
    table = PoseTable.from_columns(name_joint_columns(request.columns, robot), request.units, robot)
    correction = TableCorrection.prepare(robot, run, request, table)
    done = correction.conclude([correction.path.correct(0, len(table.poses))])
    columns = {
        name: list(column) if name == STATUS else _without_nan(column)
        for name, column in done.list_columns(table, request.units, robot).items()
    }
    return CorrectionResult(**done.describe(robot), columns=columns)


def _without_nan(column: FloatArray) -> list[float | None]:
    """Return the numbers of a column; None where a number is not finite."""
    return [
        number if finite else None
        for number, finite in zip(column.tolist(), np.isfinite(column), strict=True)
    ]
