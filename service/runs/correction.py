"""Correction of poses by the model of a run or by a prior: tables in, and tables out. Nothing is stored."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.schemas.correction import (
    CorrectionOptions,
    CorrectionRequest,
    CorrectionResult,
    CorrectionStatus,
)
from jointstiff.schemas.finding import Assessment, Finding
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.robots import (
    joint_factors,
    joint_kinds_by_name,
    refuse_far_point,
    refuse_wrong_joint_count,
)
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT
from jointstiff.service.runs.deflection import parse_unit_factor
from jointstiff.service.runs.verdicts import (
    PriorModel,
    RunModel,
    assess_with_run,
    find_beyond_campaign,
    find_far_points,
    find_implausible_deflection,
    find_missing_numbers,
    make_reason,
    moment_factor,
)
from jointstiff.service.tables.files import split_table_rows
from jointstiff.service.tables.table import Sheet
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import InputError, RequestError
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.forward import CorrectionLimits
from jointstiff.solver.predict.models import EXTRAPOLATED
from jointstiff.solver.process.correct import (
    CorrectedRows,
    CorrectionSettings,
    RowStatus,
    Waypoints,
    correct,
    turn_loads,
)

_POSITION: Final = ("x", "y", "z")
_ROTATION_VECTOR: Final = ("rx", "ry", "rz")
_EULER_ANGLES: Final = ("a", "b", "c")
_QUATERNION: Final = ("q1", "q2", "q3", "q4")
_FORCE: Final = ("fx", "fy", "fz")
_MOMENT: Final = ("mx", "my", "mz")
_ORIENTATIONS: Final = (_ROTATION_VECTOR, _EULER_ANGLES, _QUATERNION)
_LENGTHS: Final = (*_POSITION, "dx", "dy", "dz", "readings", "model_error", "residual")
_FACTORS: Final = {"length": LENGTH, "angle": ANGLE, "force": FORCE, "moment": MOMENT}
"""Quantity → unit of its headers → factor to SI units."""
REASONS: Final[Mapping[CorrectionStatus, tuple[str, str]]] = MappingProxyType(
    {
        "capped": ("the limits reduce the correction", "check the load, then raise the limits"),
        "uncertain": ("the deflection is less than its uncertainty", "measure more if it matters"),
        "beyond_limits": ("a joint would leave its limits", "move the part"),
        "not_reached": ("the robot does not reach the pose", "check tool, base and units"),
        "ambiguous": ("the posture is not certain from here on", "give joints, or `start` for the first row"),
        "contradictory": ("pose and joints differ", "correct the pose or the joints"),
        "unseen_joint": (
            "the load twists a joint that the readings do not determine",
            "choose a run that determines this joint",
        ),
        "overloaded": ("the load is too great for the model", "check the units of force and length"),
        "no_direction": ("the tool does not move, so the load has no direction", "state other `axes`"),
    }
)
"""Status → reason and remedy, for statuses of rows that are not corrected in full."""


@dataclass(frozen=True, eq=False)
class PoseTable:
    """Columns of a table of N poses, in SI units."""

    poses: FloatArray  # (N, 4, 4) poses of the tool in the base [m]
    orientation: tuple[str, ...]  # names of the columns with the orientation
    joints: FloatArray | None  # (N, n) controller's joints [rad or m]; None if there are none
    loads: FloatArray | None  # (N, 6) force [N] and moment [N·m]; None if there are none

    @classmethod
    def from_columns(cls, columns: Mapping[str, Any], units: Units, robot: Robot) -> PoseTable:
        """Read the columns of a request.

        Raises:
            RequestError: columns are missing, unknown, have different lengths, or a number is not finite.
        """
        names = {name.lower(): name for name in columns}
        joint_names = [f"j{number}" for number in range(1, robot.n + 1)]
        known = {*_POSITION, *_FORCE, *_MOMENT, *joint_names, *sum(_ORIENTATIONS, ())}
        for name in names:
            if name not in known:
                raise RequestError(
                    f"the column {name[:40]!r} is not known",
                    where="columns",
                    remedy=f"use x, y, z, rx, ry, rz, j1 to j{robot.n}, fx, fy, fz, mx, my, mz",
                )
        orientation = _choose_orientation(names)
        required = [*_POSITION, *orientation]
        for group in (joint_names, _FORCE, _MOMENT):
            required += group if names.keys() & {*group} else ()
        if missing := [each for each in required if each not in names]:
            raise RequestError(
                f"the column {missing[0]} is missing", where="columns", remedy="give all columns of a group"
            )
        _refuse_bad_numbers(columns)

        def stack(group: Sequence[str]) -> FloatArray:
            return np.array([columns[names[each]] for each in group], dtype=np.float64).T

        poses = np.tile(np.eye(4), (len(columns[names["x"]]), 1, 1))
        poses[:, :3, 3] = LENGTH[units.length] * stack(_POSITION)
        poses[:, :3, :3] = _read_orientation(orientation, stack(orientation), units)
        joints = joint_factors(robot, units) * stack(joint_names) if "j1" in names else None
        loads = None
        if "fx" in names or "mx" in names:
            force = FORCE[units.force] * stack(_FORCE) if "fx" in names else np.zeros((len(poses), 3))
            moment = stack(_MOMENT) if "mx" in names else np.zeros((len(poses), 3))
            loads = np.concatenate([force, moment_factor(units, moment) * moment], axis=1)
        return cls(poses, orientation, joints, loads)


def _refuse_bad_numbers(columns: Mapping[str, Any]) -> None:
    """Refuse columns of different lengths, and numbers that are not finite.

    Raises:
        RequestError: names the column.
    """
    if len({len(each) for each in columns.values()}) > 1:
        raise RequestError(
            "the columns have different lengths", where="columns", remedy="give each row in each column"
        )
    for name, column in columns.items():
        is_number = np.isfinite(np.asarray(column, dtype=np.float64))
        if not is_number.all():
            raise RequestError(
                f"row {int(np.argmin(is_number)) + 1} of column {name} has no finite number",
                where="columns",
                remedy="give a number in each row, or leave the row out",
            )


def _choose_orientation(names: Collection[str]) -> tuple[str, ...]:
    """Return the columns that state the orientation.

    Raises:
        RequestError: columns of two forms are stated.
    """
    stated = [each for each in _ORIENTATIONS if {*each} & {*names}]
    if len(stated) > 1:
        raise RequestError(
            "the orientation is stated twice",
            where="columns",
            remedy="give either rx, ry, rz, or a, b, c, or q1 to q4",
        )
    return stated[0] if stated else _ROTATION_VECTOR


def _read_orientation(names: tuple[str, ...], numbers: FloatArray, units: Units) -> FloatArray:
    """Return rotations (N, 3, 3) from columns of numbers.

    Raises:
        RequestError: a quaternion is zero.
    """
    if names == _QUATERNION:
        if not np.linalg.norm(numbers, axis=1).all():
            raise RequestError("a quaternion is zero", where="columns.q1", remedy="give unit quaternions")
        return np.asarray(Rotation.from_quat(numbers, scalar_first=True).as_matrix())
    radians = ANGLE[units.angle] * numbers
    if names == _EULER_ANGLES:
        return np.asarray(Rotation.from_euler("ZYX", radians).as_matrix())
    return np.asarray(Rotation.from_rotvec(radians).as_matrix())


def _write_orientation(names: tuple[str, ...], rotations: FloatArray, units: Units) -> FloatArray:
    """Return the numbers (N, 3 or 4) of rotations (N, 3, 3) for columns; NaN where a rotation is NaN."""
    known = np.isfinite(rotations[:, 0, 0])
    numbers = np.full((len(rotations), len(names)), np.nan)
    rotation = Rotation.from_matrix(rotations[known])
    if names == _QUATERNION:
        numbers[known] = rotation.as_quat(canonical=True, scalar_first=True)
    elif names == _EULER_ANGLES:
        numbers[known] = rotation.as_euler("ZYX") / ANGLE[units.angle]
    else:
        numbers[known] = rotation.as_rotvec() / ANGLE[units.angle]
    return numbers


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
        names = [each.name.lower() for each in RowStatus]
        return [names[each] for each in self.rows.status.tolist()]

    @property
    def counts(self) -> dict[str, int]:
        """Number of rows by status, in order of the statuses."""
        counts = np.bincount(self.rows.status, minlength=len(RowStatus)).tolist()
        return {each.name.lower(): counts[each] for each in RowStatus if counts[each]}

    @property
    def first(self) -> dict[str, int]:
        """First row of each status, from 1."""
        return {name: int(np.argmax(self.rows.status == RowStatus[name.upper()])) + 1 for name in self.counts}

    def describe_rows(self) -> list[str]:
        """Return a line for each status of rows that are not corrected in full: count, reason, remedy."""
        total, lines = len(self.rows.status), []
        for name, count in self.counts.items():
            if name in REASONS:
                reason, remedy = REASONS[name]  # type: ignore[index]
                lines.append(f"{count} of {total} rows, first row {self.first[name]}: {reason}; {remedy}")
        return lines

    def list_columns(self, table: PoseTable, units: Units, robot: Robot) -> dict[str, Any]:
        """Return the columns of the answer by name, in the units of the request; NaN without a number."""
        rows, length = self.rows, LENGTH[units.length]
        columns: dict[str, Any] = {"status": self.statuses}
        columns |= dict(zip(_POSITION, (rows.poses[:, :3, 3] / length).T, strict=True))
        orientation = _write_orientation(table.orientation, rows.poses[:, :3, :3], units)
        columns |= dict(zip(table.orientation, orientation.T, strict=True))
        joints = rows.joints / joint_factors(robot, units)
        columns |= {f"j{number}": column for number, column in enumerate(joints.T, 1)}
        columns |= dict(zip(("dx", "dy", "dz"), (rows.deflection / length).T, strict=True))
        columns["readings"] = rows.readings / length
        columns["model_error"] = rows.with_model_error / length
        columns["residual"] = rows.residual / length
        columns["joint_speed"] = rows.joint_speed / ANGLE[units.angle]
        return columns


def correct_table(
    robot: Robot, run: Run | None, options: CorrectionOptions, table: PoseTable
) -> CorrectedTable:
    """Correct a table of poses with the model of a run, or with the prior of the robot without one.

    Raises:
        RequestError: the run has no model, the options contradict each other, or poses and joints do.
    """
    if options.accuracy_option == "compensates_load":
        raise RequestError(
            "the controller already compensates the deflection under load",
            where="accuracy_option",
            remedy="switch the controller's accuracy option off, and measure again",
        )
    units, length = options.units, LENGTH[options.units.length]
    model = _build_model(robot, run, options)
    tool, base = (_read_frame(each, units) for each in (options.tool, options.base))
    refuse_far_point(options.load_point, "load_point", length=length)
    point = None if options.load_point is None else length * np.array(options.load_point)
    start = None
    if options.start is not None:
        refuse_wrong_joint_count(robot, options.start, "start")
        start = joint_factors(robot, units) * np.array(options.start)
    waypoints = Waypoints(table.poses, tool, base, table.joints, start)
    loads = turn_loads(waypoints.find_axes(options.axes), _state_loads(options, table))
    fixed = start if table.joints is None else table.joints[0]
    try:
        inverse = InverseKinematics(robot, fixed)
    except InputError as error:
        raise RequestError(error.reason, remedy=error.remedy, where=error.where) from error
    usual = CorrectionLimits()
    limits = CorrectionLimits(
        usual.displacement if options.max_displacement is None else length * options.max_displacement,
        usual.rotation if options.max_rotation is None else ANGLE[units.angle] * options.max_rotation,
    )
    rows = correct(
        model.model,
        model.error,
        inverse,
        waypoints,
        loads,
        CorrectionSettings(limits, options.confidence),
        load_point=point,
        feed=None if options.feed is None else length * options.feed,
    )
    points = [each.tolist() for each in (tool[:3, 3], point) if each is not None]
    reasons = _find_reasons(rows, points, model)
    assessment = assess_with_run("correction", reasons, model.assessment)
    return CorrectedTable(rows, assessment, model.remarks(options.confidence), options.confidence)


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


def _state_loads(options: CorrectionOptions, table: PoseTable) -> FloatArray:
    """Return the loads (N, 6) [N, N·m] of the rows along the axes of the options.

    Raises:
        RequestError: there is no load, or there are two.
    """
    if (options.force is None) == (table.loads is None) and not (options.absolute and table.loads is None):
        raise RequestError(
            "the load is stated twice" if table.loads is not None else "the load is missing",
            where="force",
            remedy="give `force`, or columns fx, fy, fz",
        )
    if table.loads is not None:
        return table.loads
    force = np.zeros(3) if options.force is None else FORCE[options.units.force] * np.array(options.force)
    return np.tile(np.concatenate([force, np.zeros(3)]), (len(table.poses), 1))


def _find_reasons(
    rows: CorrectedRows, points: Sequence[Sequence[float]], model: RunModel | PriorModel
) -> list[Finding]:
    """Return reasons to doubt a correction, in addition to those of its run."""
    count = len(rows.status)
    has_numbers = rows.status <= RowStatus.UNCERTAIN
    lengths = np.linalg.norm(rows.deflection[has_numbers], axis=1)
    extrapolated = int((rows.extrapolation[has_numbers] > EXTRAPOLATED).sum())
    unseen = bool((rows.status == RowStatus.UNSEEN_JOINT).any())
    reasons = [
        *find_missing_numbers(count - int(has_numbers.sum()), count, "rows", unseen=unseen),
        *find_implausible_deflection(float(lengths.max(initial=0.0)), model.result),
        *find_far_points(points),
        *find_beyond_campaign(extrapolated, count, "rows"),
    ]
    if capped := int((rows.status == RowStatus.CAPPED).sum()):
        reason, remedy = REASONS["capped"]
        message = f"{reason} in {capped} of {count} rows"
        reasons.append(make_reason("corrections_capped", "use_with_care", message, remedy))
    if not ((rows.status == RowStatus.CORRECTED) | (rows.status == RowStatus.CAPPED)).any():
        message, remedy = "no row is corrected", "read the status of the rows"
        reasons.append(make_reason("nothing_corrected", "use_with_care", message, remedy))
    return reasons


def correct_request(robot: Robot, run: Run | None, request: CorrectionRequest) -> CorrectionResult:
    """Correct the columns of a request; return the answer, with null where a row has no number.

    Raises:
        RequestError: the request cannot be carried out.
    """
    table = PoseTable.from_columns(request.columns, request.units, robot)
    done = correct_table(robot, run, request, table)
    columns = {
        name: list(column) if name == "status" else _without_nan(column)
        for name, column in done.list_columns(table, request.units, robot).items()
    }
    return CorrectionResult.model_validate(
        {
            "joint_kinds": joint_kinds_by_name(robot),
            "assessment": done.assessment,
            "confidence": done.confidence,
            "counts": done.counts,
            "first": done.first,
            "remarks": [*done.describe_rows(), *done.remarks],
            "columns": columns,
        }
    )


def _without_nan(column: FloatArray) -> list[float | None]:
    """Return the numbers of a column; None where a number is not finite."""
    return [
        number if finite else None
        for number, finite in zip(column.tolist(), np.isfinite(column), strict=True)
    ]


def make_sheet(columns: Mapping[str, Any], units: Units, prismatic: Sequence[bool]) -> Sheet:
    """Return the columns of an answer as a sheet whose headers have units.

    `prismatic` tells for each joint whether it is prismatic.
    """
    headers = {}
    for name, column in columns.items():
        is_joint = re.fullmatch(r"j\d+", name) is not None
        unit = ""
        if name in _LENGTHS or (is_joint and prismatic[int(name[1:]) - 1]):
            unit = units.length
        elif is_joint or name in {*_ROTATION_VECTOR, *_EULER_ANGLES}:
            unit = units.angle
        elif name == "joint_speed":
            unit = f"{units.angle}/s"
        title = name.upper() if is_joint else name.replace("_", " ")
        headers[f"{title} [{unit}]" if unit else title] = column
    return Sheet(headers, texts=frozenset({"status"}), digits=".10g")


def read_table(text: str) -> dict[str, FloatArray]:
    """Read a CSV table of poses; return its columns by header.

    Raises:
        RequestError: a cell is no number.
    """
    cells, has_comma_separators = split_table_rows(text)
    lines = [each for each in cells[1:] if any(each)]
    if not lines:
        raise RequestError("the table has no rows", where="line 1", remedy="give a header and a row a pose")
    numbers: list[list[float]] = []
    for line, row in enumerate(lines, 2):
        try:
            texts = row if has_comma_separators else [cell.replace(",", ".") for cell in row]
            numbers.append([float(cell) for cell in texts])
        except ValueError:
            raise RequestError(
                "a cell is not a number", where=f"line {line}", remedy="write numbers"
            ) from None
        if len(row) != len(cells[0]):
            raise RequestError(
                "the row has another number of cells than the header",
                where=f"line {line}",
                remedy="give a cell for each header",
            )
    return dict(zip(cells[0], np.array(numbers).T, strict=True))


def convert_headers(columns: Mapping[str, Any], units: Units, robot: Robot) -> dict[str, FloatArray]:
    """Return columns by their names in the API and in `units`, from columns with units in their headers.

    Raises:
        RequestError: a header has no unit, or another quantity's.
    """
    converted = dict[str, FloatArray]()
    own = {"length": LENGTH[units.length], "angle": ANGLE[units.angle], "force": FORCE[units.force]}
    for header, column in columns.items():
        name = header.partition("[")[0].strip().lower()
        numbers = np.asarray(column, dtype=np.float64)
        quantity = _find_quantity(name, robot)
        if quantity == "moment":
            own[quantity] = moment_factor(units, numbers)
        if quantity is not None:
            numbers = numbers * (parse_unit_factor(header, _FACTORS[quantity]) / own[quantity])
        converted[name] = numbers
    return converted


def _find_quantity(name: str, robot: Robot) -> str | None:
    """Return the quantity in a column; None if its numbers have no unit."""
    joint = re.fullmatch(r"j(\d+)", name)
    if joint is not None:
        number = int(joint[1])
        is_prismatic = 1 <= number <= robot.n and robot.prismatic[number - 1]
        return "length" if is_prismatic else "angle"
    groups = {
        "length": _POSITION,
        "angle": (*_ROTATION_VECTOR, *_EULER_ANGLES),
        "force": _FORCE,
        "moment": _MOMENT,
    }
    return next((quantity for quantity, names in groups.items() if name in names), None)
