"""Correction of arrays and tables of poses: in this process, or by a service."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict

import numpy as np

from jointstiff.schemas.correction import CorrectionOptions, CorrectionResult
from jointstiff.schemas.finding import Assessment
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.arguments import complete_units
from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.service.problems import as_campaign_error
from jointstiff.service.resources.documents import parse_document
from jointstiff.service.runs.correction import (
    PoseTable,
    convert_headers,
    correct_table,
    make_sheet,
    read_table,
)
from jointstiff.service.tables.files import make_data_frame, parquet_bytes, read_parquet, write_sheet
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.process.correct import place_forces

if TYPE_CHECKING:
    from jointstiff.schemas.deflection import LinkMass
    from jointstiff.service.conversion.arguments import AnyUnits
    from jointstiff.service.kinds.verb import Matrix, Vector
    from jointstiff.solver.mechanics.robot import Robot

AnyPoses = Any
"""Poses of the tool in the base: an array (N, 4, 4), an array (N, 6) of X, Y, Z and rotation vector, or a CSV
or Parquet file."""
AnyJoints = Any
"""Controller's joints of the poses: an array (N, n), or None if they are not known."""


class CorrectFields(TypedDict, total=False):
    """Options of `correct`."""

    tool: Vector | Matrix | None
    base: Vector | Matrix | None
    forces: Vector | Matrix | None
    axes: Literal["robot", "base", "tool", "feed"]
    feed: float | None
    start: Vector | None
    load_point: Vector | None
    units: AnyUnits
    accuracy_option: Literal["off", "same_as_measured", "compensates_load"]
    max_displacement: float | None
    max_rotation: float | None
    absolute: bool
    masses: Sequence[LinkMass | Mapping[str, Any]]
    confidence: float
    accept_verdict: Literal["do_not_use"] | None


@dataclass(frozen=True, eq=False)
class Correction:
    """Corrected poses; arrays have a row for each of N poses, NaN where a row has no numbers."""

    poses: FloatArray  # (N, 4, 4) corrected poses of the tool in the base [m]
    joints: FloatArray  # (N, n) corrected controller's joints [rad or m]
    deflection: FloatArray  # (N, 3) deflection without a correction, axes of the base [m]
    readings: FloatArray  # (N,) half-width of the interval of the deflection's length, from the readings [m]
    with_model_error: FloatArray  # (N,) the same with the model error [m]
    residual: FloatArray  # (N,) predicted distance of the loaded tool from its pose [m]
    joint_speed: FloatArray  # (N,) greatest speed of a joint at the feed [rad/s]; NaN without a feed
    status: list[str]  # (N,) status of each row, such as `corrected`
    counts: dict[str, int]  # number of rows by status
    first: dict[str, int]  # first row of each status, from 1
    assessment: Assessment
    remarks: list[str]
    _columns: dict[str, Any]  # columns of a file, in the units of the call
    _units: Units
    _prismatic: list[bool]

    def __repr__(self) -> str:
        """Return the number of rows by status, and the headline of the assessment."""
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        return f"<Correction: {counts}; {self.assessment.headline}>"

    def summary(self) -> str:
        """Return headline, reasons with remedies, counts and remarks as text."""
        reasons = [f"{each.message}; {each.remedy}" for each in self.assessment.reasons]
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        return "\n".join([self.assessment.headline or "", f"rows: {counts}", *reasons, *self.remarks])

    def to_frame(self) -> Any:  # noqa: ANN401 - of pandas or polars
        """Return the rows as a data frame of pandas or polars, in the units of the call.

        Raises:
            MissingExtraError: neither pandas nor polars is installed.
        """
        return make_data_frame(make_sheet(self._columns, self._units, self._prismatic))

    def save(self, path: str | PathLike[str]) -> None:
        """Write the rows to a `.csv` or `.parquet` file, in the units of the call.

        Raises:
            ValueError: the path has another ending.
            MissingExtraError: the library for Parquet is not installed.
        """
        target = Path(path)
        sheet = make_sheet(self._columns, self._units, self._prismatic)
        if target.suffix == ".csv":
            target.write_bytes(write_sheet(sheet, "csv"))
        elif target.suffix == ".parquet":
            target.write_bytes(parquet_bytes(sheet))
        else:
            raise ValueError(f"'{target}' must end in .csv or .parquet")


@dataclass(frozen=True, eq=False)
class CorrectionCall:
    """A call of `correct`, with numbers in the units of the call."""

    options: CorrectionOptions
    columns: dict[str, FloatArray]  # columns of a request

    @classmethod
    def read(
        cls,
        robot: Robot,
        poses: AnyPoses,
        joints: AnyJoints,
        fields: Mapping[str, Any],
    ) -> CorrectionCall:
        """Read the arguments of a call: arrays or a file, and options.

        Raises:
            RequestError: an array has another shape, or a file is not understood.
            CampaignError: an option cannot be used.
        """
        stated = {name: value for name, value in fields.items() if value is not None}
        stated["units"] = complete_units(stated.get("units"))
        units = parse_document(stated["units"], Units)
        for name in stated.keys() & {"tool", "base"}:
            frame = np.asarray(stated[name], dtype=np.float64)[None]
            stated[name] = _read_poses(frame, units)[0].tolist()
        for name in stated.keys() & {"start", "load_point", "force"}:
            stated[name] = np.asarray(stated[name], dtype=np.float64).tolist()
        if isinstance(poses, str | PathLike):
            columns = convert_headers(read_columns(Path(poses)), units, robot)
        else:
            rows = _read_poses(np.asarray(poses, dtype=np.float64), units)
            columns = dict(zip(("x", "y", "z", "rx", "ry", "rz"), rows.T, strict=True))
        columns |= _name_joints(joints, len(next(iter(columns.values()))), robot)
        forces = np.asarray(stated.pop("forces", ()), dtype=np.float64)
        if forces.shape == (3,):
            stated["force"] = forces.tolist()
        elif forces.size:
            columns |= _place_forces(forces, columns)
        return cls(parse_document(stated, CorrectionOptions), columns)

    def correct(self, robot: Robot, run: Run | None) -> Correction:
        """Correct the rows in this process.

        Raises:
            RequestError: the rows cannot be corrected.
        """
        units = self.options.units
        table = PoseTable.from_columns(self.columns, units, robot)
        done = correct_table(robot, run, self.options, table)
        rows = done.rows
        return Correction(
            poses=rows.poses,
            joints=rows.joints,
            deflection=rows.deflection,
            readings=rows.readings,
            with_model_error=rows.with_model_error,
            residual=rows.residual,
            joint_speed=rows.joint_speed,
            status=done.statuses,
            counts=done.counts,
            first=done.first,
            assessment=done.assessment,
            remarks=[*done.describe_rows(), *done.remarks],
            _columns=done.list_columns(table, units, robot),
            _units=units,
            _prismatic=robot.prismatic.tolist(),
        )

    def read_answer(self, robot: Robot, result: CorrectionResult) -> Correction:
        """Return the correction in a service's answer to this call."""
        units = self.options.units
        columns: dict[str, Any] = {
            name: column if name == "status" else np.array(column, dtype=np.float64)
            for name, column in result.columns.items()
        }
        sent = {name for name in columns if name not in _NOT_SENT}
        known = np.isfinite(columns["x"])
        table = PoseTable.from_columns({name: columns[name][known] for name in sent}, units, robot)
        poses = np.full((len(known), 4, 4), np.nan)
        joints = np.full((len(known), robot.n), np.nan)
        if known.any() and table.joints is not None:
            poses[known], joints[known] = table.poses, table.joints
        length = LENGTH[units.length]
        return Correction(
            poses=poses,
            joints=joints,
            deflection=length * np.stack([columns[name] for name in ("dx", "dy", "dz")], axis=1),
            readings=length * columns["readings"],
            with_model_error=length * columns["model_error"],
            residual=length * columns["residual"],
            joint_speed=ANGLE[units.angle] * columns["joint_speed"],
            status=columns["status"],
            counts={str(name): count for name, count in result.counts.items()},
            first={str(name): row for name, row in result.first.items()},
            assessment=result.assessment,
            remarks=result.remarks,
            _columns=columns,
            _units=units,
            _prismatic=robot.prismatic.tolist(),
        )


_NOT_SENT = frozenset({"status", "dx", "dy", "dz", "readings", "model_error", "residual", "joint_speed"})
"""Columns of an answer that a request does not have."""


def _name_joints(joints: AnyJoints, count: int, robot: Robot) -> dict[str, FloatArray]:
    """Return the columns of stated joints (N, n) by name; none if no joints are stated.

    Raises:
        RequestError: the array has another shape.
    """
    if joints is None:
        return {}
    array = np.asarray(joints, dtype=np.float64)
    if array.shape != (count, robot.n):
        raise RequestError(
            f"the joints have shape {array.shape}",
            where="joints",
            remedy=f"give the controller's joints of each pose, ({count}, {robot.n})",
        )
    return {f"j{number}": column for number, column in enumerate(array.T, 1)}


def _place_forces(forces: FloatArray, columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the columns of forces (N, 3) of the rows, or of rows (K, 4) of path length and force.

    Raises:
        RequestError: the array has another shape.
    """
    places = np.stack([columns[axis] for axis in "xyz"], axis=1)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    rows = place_forces(forces, np.append(0.0, np.cumsum(steps)), len(places))
    return dict(zip(("fx", "fy", "fz"), rows.T, strict=True))


def read_columns(path: Path) -> Mapping[str, Any]:
    """Read the columns of a CSV or Parquet file by header.

    Raises:
        RequestError: the file is not understood.
        MissingExtraError: the library for Parquet is not installed.
        OSError: the file cannot be read.
    """
    if path.suffix.lower() != ".parquet":
        return read_table(path.read_text(encoding="utf-8-sig", errors="replace"))
    return read_parquet(path)


def _read_poses(array: FloatArray, units: Units) -> FloatArray:
    """Return poses (N, 6), X, Y, Z and rotation vector in the units of the call, from (N, 6) or (N, 4, 4).

    Raises:
        RequestError: the array has another shape, or a rotation has a number that is not finite.
    """
    from scipy.spatial.transform import Rotation

    if array.shape[1:] == (6,):
        return array
    if array.shape[1:] != (4, 4):
        raise RequestError(
            f"the poses have shape {array.shape}",
            where="poses",
            remedy="give poses (N, 4, 4), or (N, 6) with X, Y, Z and rotation vector",
        )
    is_known = np.isfinite(array[:, :3, :3]).all(axis=(1, 2))
    if not is_known.all():
        raise RequestError(
            f"the rotation of row {int(np.argmin(is_known)) + 1} has no finite number",
            where="poses",
            remedy="give a number in each row, or leave the row out",
        )
    rotation = Rotation.from_matrix(array[:, :3, :3]).as_rotvec() / ANGLE[units.angle]
    return np.concatenate([array[:, :3, 3], rotation], axis=1)


def correct(
    source: Any,  # noqa: ANN401 - a run, a campaign, or a robot
    poses: AnyPoses,
    /,
    joints: Matrix | None = None,
    **options: Any,  # noqa: ANN401 - of CorrectFields
) -> Correction:
    """Correct poses of a tool, so that the loaded tool is where each of them says.

    Args:
        source: run that `identify` returned, or a campaign, which is identified first; or an arm that was not
            measured: a robot document, or the name of an arm of the catalogue.
        poses: poses of the tool in the base: an array (N, 4, 4), an array (N, 6) of X, Y, Z and rotation
            vector, or a CSV or Parquet file with units in its headers.
        joints: (N, n) controller's joints of the poses, if they are known: a wrong tool, base, world or unit
            is then refused, and frames that fit are proposed.
        options: `tool` in the flange frame and `base` in R0, as (4, 4) or six numbers; `forces` (3,), (N, 3)
            or rows (K, 4) of path length and force, along `axes` (`robot`, `base`, `tool`, `feed`); `feed`,
            for the speed of the joints; `start`, joints near the first pose; and fields of
            `CorrectionOptions`. All numbers of the call are in mm, deg, N and N.m unless `units` states
            others.

    Raises:
        CampaignError: source, poses or options cannot be used. A single row never raises an error: see
            `status`.
    """
    from jointstiff.service.library.here import Here

    return Here().correct(source, poses, joints, **options)


def prepare_call(
    robot: Robot,
    poses: AnyPoses,
    joints: AnyJoints,
    options: Mapping[str, Any],
) -> CorrectionCall:
    """Read the arguments of a call, with errors of the library.

    Raises:
        CampaignError: an argument cannot be used.
    """
    with as_campaign_error("correction"):
        return CorrectionCall.read(robot, poses, joints, options)
