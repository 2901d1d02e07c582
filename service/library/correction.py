"""Correction of arrays and tables of poses: in this process, or by a service."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from jointstiff.schemas.correction import CorrectionOptions, CorrectionResult, CorrectionStatus
from jointstiff.schemas.finding import Assessment
from jointstiff.schemas.job import Progress
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.arrays import read_numbers
from jointstiff.service.conversion.poses import read_frame
from jointstiff.service.conversion.units import ANGLE, LENGTH, complete_units
from jointstiff.service.kinds.correction.work import CorrectionWork
from jointstiff.service.kinds.width import CancelledWorkError
from jointstiff.service.kinds.work import Arrays, compute_steps
from jointstiff.service.problems import (
    CampaignError,
    as_campaign_error,
    http_problem,
    naming_file,
    naming_missing_file,
    require_folder,
)
from jointstiff.service.resources.documents import parse_document
from jointstiff.service.runs.correction.columns import (
    ANSWERED,
    DEFLECTION,
    FORCES,
    POSITION,
    STATUS,
    convert_headers,
    make_sheet,
)
from jointstiff.service.runs.correction.poses import PoseTable, name_poses
from jointstiff.service.runs.correction.verdict import count_statuses, describe_rows, find_first_rows
from jointstiff.service.runs.verdicts import refuse_unaccepted
from jointstiff.service.tables.files import make_data_frame, write_sheet
from jointstiff.service.tables.reading import LABEL, read_number_table
from jointstiff.service.tables.report import OVERALL
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.correct.correct import place_forces
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from jointstiff.service.kinds.verb import JobMonitor
    from jointstiff.service.tables.table import Sheet
    from jointstiff.solver.mechanics.robot import Robot

CANCELLED: Final = http_problem(409, "the correction was cancelled", "correct the poses again")
"""Problem of a correction that the caller has cancelled."""
AnyPoses = Any
"""Poses of the tool in the base: an array (N, 4, 4), an array (N, 6) of X, Y, Z and rotation vector, or a CSV
or Parquet file."""
AnyJoints = Any
"""Controller's joints of the poses: an array (N, n), or None if they are not known."""


@dataclass(frozen=True, eq=False)
class Correction:
    """Corrected poses; arrays have a row for each of N poses, NaN where a row has no numbers.

    Arrays are in SI units (m, rad, rad/s), whatever the units of the call; files and data frames are in the
    units of the call.
    """

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
            CampaignError: the folder of the file is missing.
            MissingExtraError: the library for Parquet is not installed.
        """
        target = Path(path)
        if target.suffix not in {".csv", ".parquet"}:
            raise ValueError(f"'{target}' must end in .csv or .parquet")
        require_folder(target)
        sheet = make_sheet(self._columns, self._units, self._prismatic)
        target.write_bytes(write_sheet(sheet, target.suffix[1:]))


def _read_places(stated: Mapping[str, Any], units: Units) -> dict[str, Any]:
    """Return the stated frames, points, joints and force, of any array type, as lists of numbers.

    Raises:
        RequestError: an array has another shape, or elements that are not numbers.
    """
    places = dict[str, Any]()
    for name in stated.keys() & {"tool", "base"}:
        places[name] = read_frame(stated[name], name, units.angle).tolist()
    for name in stated.keys() & {"start", "load_point", "force"}:
        places[name] = read_numbers(stated[name], name).tolist()
    return places


def _read_columns(
    poses: AnyPoses, units: Units, robot: Robot
) -> tuple[dict[str, FloatArray], list[str] | None]:
    """Return the columns of a table of poses by name, and the texts of its column `label`, if it has one.

    `poses` is a CSV or Parquet file with units in its headers, or an array (N, 4, 4) or (N, 6).

    Raises:
        RequestError: the file is not understood, or the array has another shape.
    """
    if isinstance(poses, str | PathLike):
        path = Path(poses)
        with naming_file(path):
            file = read_number_table(path.read_bytes())
            return convert_headers(file.columns, units, robot), file.labels
    return name_poses(poses, "poses", units), None


def _refuse_second_joints(joints: AnyJoints, columns: Mapping[str, FloatArray]) -> None:
    """Refuse joints that are stated by an argument as well as by a file with the columns j1, j2, ….

    Raises:
        RequestError: the joints are stated twice.
    """
    if joints is not None and "j1" in columns:
        raise RequestError(
            "the joints are stated twice: by `joints` and by the column j1 of the file",
            where="joints",
            remedy="give one of both",
        )


def _compute_parts(work: CorrectionWork, monitor: JobMonitor) -> list[Arrays]:
    """Return the results of all steps of a correction, in order; notify the monitor after each step.

    Raises:
        CancelledWorkError: the caller has cancelled the correction.
    """
    parts, spans = list[Arrays](), work.spans()
    steps = compute_steps(work, spans, monitor.executor, lambda: monitor.cancelled)
    with closing(steps):
        for span, part in zip(spans, steps, strict=True):
            parts.append(part)
            monitor(Progress(done=span[1], total=len(work), unit=work.unit, activity=work.activity))
    return parts


class _CorrectedPoses(NamedTuple):
    """Corrected poses and joints of N rows; NaN for a row that is not corrected."""

    poses: FloatArray  # (N, 4, 4) poses of the tool in the base [m]
    joints: FloatArray  # (N, n) joints of the controller [rad or m]

    @classmethod
    def from_columns(cls, columns: Mapping[str, Any], units: Units, robot: Robot) -> _CorrectedPoses:
        """Read the columns of a service's answer, whose numbers are in the units of the call."""
        known = np.isfinite(columns["x"])
        sent = {name: column[known] for name, column in columns.items() if name not in ANSWERED}
        table = PoseTable.from_columns(sent, units, robot)
        corrected = cls(np.full((len(known), 4, 4), np.nan), np.full((len(known), robot.n), np.nan))
        if known.any() and table.joints is not None:
            corrected.poses[known], corrected.joints[known] = table.poses, table.joints
        return corrected


@dataclass(frozen=True, eq=False)
class CorrectionCall:
    """A call of `correct`, with numbers in the units of the call."""

    options: CorrectionOptions
    columns: dict[str, FloatArray]  # columns of a request
    labels: list[str] | None  # (N,) texts of a file's column `label`, which the answer repeats

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
        stated |= _read_places(stated, units)
        columns, labels = _read_columns(poses, units, robot)
        _refuse_second_joints(joints, columns)
        columns |= _name_joints(joints, len(next(iter(columns.values()))), robot)
        forces = read_numbers(stated.pop("forces", ()), "forces")
        if forces.size:
            _refuse_second_load(stated, columns)
        if forces.shape == (3,):
            stated["force"] = forces.tolist()
        elif forces.size:
            columns |= _place_forces(forces, columns)
        return cls(parse_document(stated, CorrectionOptions), columns, labels)

    def correct(self, robot: Robot, run: Run | None, monitor: JobMonitor) -> Correction:
        """Correct the rows in this process.

        Raises:
            RequestError: the rows cannot be corrected.
            CancelledWorkError: the caller has cancelled the correction.
        """
        work = CorrectionWork(robot, run, self.options, self.columns, self.labels)
        done = work.correct(_compute_parts(work, monitor))
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
            counts=_name_numbers(count_statuses(rows)),
            first=_name_numbers(find_first_rows(rows)),
            assessment=done.assessment,
            remarks=[*describe_rows(rows), *done.remarks],
            _columns=work.list_columns(done),
            _units=self.options.units,
            _prismatic=robot.prismatic.tolist(),
        )

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def make_file(self, robot: Robot) -> bytes:
        """Return the columns as a CSV file, with all digits."""
        sheet = make_sheet(self._list_labels() | self.columns, self.options.units, robot.prismatic.tolist())
        return write_sheet(replace(sheet, digits=""), "csv")

    def _list_labels(self) -> dict[str, Any]:
        """Return the column of labels by its name; nothing without labels."""
        return {} if self.labels is None else {LABEL: self.labels}

    def read_answer(self, robot: Robot, result: CorrectionResult) -> Correction:
        """Return the correction in a service's answer to this call."""
        units = self.options.units
        columns = dict[str, Any](result.columns)
        for name in columns.keys() - {STATUS}:
            columns[name] = np.array(columns[name], dtype=np.float64)
        corrected = _CorrectedPoses.from_columns(columns, units, robot)
        length = LENGTH[units.length]
        return Correction(
            poses=corrected.poses,
            joints=corrected.joints,
            deflection=length * np.stack([columns[name] for name in DEFLECTION], axis=1),
            readings=length * columns["readings"],
            with_model_error=length * columns["model_error"],
            residual=length * columns["residual"],
            joint_speed=ANGLE[units.angle] * columns["joint_speed"],
            status=columns[STATUS],
            counts=_name_numbers(result.counts),
            first=_name_numbers(result.first),
            assessment=result.assessment,
            remarks=result.remarks,
            _columns=self._list_labels() | columns,
            _units=units,
            _prismatic=robot.prismatic.tolist(),
        )


def name_columns(rows: Sheet) -> dict[str, list[Any]]:
    """Return the columns of a file of corrected rows by their names in the API."""
    headers = [header for header in rows.columns if header not in {LABEL, OVERALL}]
    names = [header.partition(" [")[0].lower().replace(" ", "_") for header in headers]
    return {name: list(rows.columns[header]) for name, header in zip(names, headers, strict=True)}


def _name_numbers(numbers: Mapping[CorrectionStatus, int]) -> dict[str, int]:
    """Return numbers by the names of statuses, as texts."""
    return {str(name): number for name, number in numbers.items()}


def _name_joints(joints: AnyJoints, count: int, robot: Robot) -> dict[str, FloatArray]:
    """Return the columns of stated joints (N, n) by name; none if no joints are stated.

    Raises:
        RequestError: the array has another shape.
    """
    if joints is None:
        return {}
    array = read_numbers(joints, "joints")
    if array.shape != (count, robot.n):
        raise RequestError(
            f"the joints have shape {array.shape}",
            where="joints",
            remedy=f"give the controller's joints of each pose, ({count}, {robot.n})",
        )
    return {f"j{number}": column for number, column in enumerate(array.T, 1)}


def _refuse_second_load(stated: Mapping[str, Any], columns: Mapping[str, FloatArray]) -> None:
    """Refuse an argument `force`, or columns of forces in a file, together with `forces`.

    Raises:
        RequestError: names what is stated, too.
    """
    in_file = [name for name in FORCES if name in columns]
    if "force" in stated or in_file:
        others = "`force`" if "force" in stated else f"the column {in_file[0]} of the file"
        raise RequestError(
            f"the load is stated twice: by `forces` and by {others}",
            where="forces",
            remedy="give one of both",
        )


def _place_forces(forces: FloatArray, columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the columns of forces (N, 3) of the rows, or of rows (K, 4) of path length and force.

    Raises:
        RequestError: the array has another shape.
    """
    places = np.stack([columns[axis] for axis in POSITION], axis=1)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    rows = place_forces(forces, np.append(0.0, np.cumsum(steps)))
    return dict(zip(FORCES, rows.T, strict=True))


@naming_missing_file()
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


def correct_here(
    robot: Robot,
    poses: AnyPoses,
    joints: AnyJoints,
    options: Mapping[str, Any],
    monitor: JobMonitor,
    run: Run | None = None,
) -> Correction:
    """Correct poses by the model of a robot's run; without a run, by the prior of the robot.

    Raises:
        CampaignError: an argument cannot be used, the verdict on the run is not accepted, or the caller has
            cancelled the correction.
    """
    call = prepare_call(robot, poses, joints, options)
    with as_campaign_error("correction"):
        if run is not None and run.result is not None:
            accepted = call.options.accept_verdict
            refuse_unaccepted(run.result.assessment, accepted, f"run '{run.id}'")
        try:
            return call.correct(robot, run, monitor)
        except CancelledWorkError:
            raise CampaignError(CANCELLED) from None
