"""The work of a compensated program: correct the targets by the model of a run, and write the program."""

from __future__ import annotations

import hashlib
import io
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jointstiff.schemas.finding import Assessment, Finding, Verdict
from jointstiff.schemas.process import Process, ProcessRequest
from jointstiff.schemas.program import (
    MAX_WORST,
    LeftAlone,
    Program,
    ProgramFile,
    ProgramFormat,
    ProgramOptions,
    ProgramPoint,
    ProgramRequest,
    ProgramResult,
    Spread,
    SpreadEnds,
)
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.readings import hash_texts
from jointstiff.service.conversion.robots import joint_kinds_by_name
from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.service.kinds.program.files import compress_file, decompress_file
from jointstiff.service.kinds.program.path import (
    ProgramPath,
    Visits,
    convert_start_joints,
    find_feeds,
    find_path,
    measure_lengths,
)
from jointstiff.service.kinds.program.rows import RowsWriting, find_rows
from jointstiff.service.kinds.program.text import FaultsError, insert_mark, read_program
from jointstiff.service.kinds.work import (
    Arrays,
    Span,
    Work,
    as_request_errors,
    concatenate_steps,
    cut_into_spans,
)
from jointstiff.service.problems import MovesLeftError, VerdictError
from jointstiff.service.resources.inputs import Inputs
from jointstiff.service.runs.verdicts import (
    PriorModel,
    RunModel,
    assess_with_run,
    find_accepted_run,
    find_beyond_campaign,
    find_far_points,
    find_implausible_deflection,
    make_reason,
)
from jointstiff.service.tables.table import Sheet
from jointstiff.solver import messages
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import CasesError, RequestError
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import Postures, flange_poses
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.forward import (
    CorrectionLimits,
    ForwardModel,
    compute_pose_residuals,
    compute_ramp_shares,
)
from jointstiff.solver.predict.models import EXTRAPOLATED
from jointstiff.solver.process.blend import Blend, blend_loads, describe_blend
from jointstiff.solver.process.correct import (
    CaseCorrections,
    CorrectionSettings,
    RowStatus,
    correct_cases,
)
from jointstiff.solver.process.pace import Pace
from robotprograms import BLOCK, NUMBERS, ExternalAxes, Rewriting, quote_text
from robotprograms import Program as ReadProgram

MAX_QUICK_POINTS: Final = 10_000
"""Greatest number of points of a program without steps; a point counts once for each move to it."""
STEP_POINTS: Final = 2_000
"""Number of points in a step of a program with more points."""
_MAX_REMARKS: Final = 50
_SHOWN_LINES: Final = 5
"""Greatest count of lines that a remark names."""
_SINGULAR_TURN: Final = 0.05
"""Turn of a joint by a correction [rad] that indicates a singularity: usual turns are a few milliradians."""
_POSTURE_COLUMNS: Final = (*(f"place {axis} [m]" for axis in "xyz"), *(f"J{j} [deg]" for j in range(1, 7)))
_LOADED_COLUMNS: Final = (
    *(f"deflection {axis} [mm]" for axis in "xyz"),
    "deflection [mm]",
    "deflection rotation [mrad]",
    *(f"correction {axis} [mm]" for axis in "xyz"),
    "correction [mm]",
    "correction rotation [mrad]",
    "deflection standard uncertainty [mm]",
    "deflection low, readings [mm]",
    "deflection high, readings [mm]",
    "deflection low, with model error [mm]",
    "deflection high, with model error [mm]",
    *(f"residual {axis} [mm]" for axis in "xyz"),
    "residual [mm]",
    "residual rotation [mrad]",
    "rounding [mm]",
    "share [1]",
)
_REMAINING_COLUMNS: Final = tuple(
    f"residual {end}, {by} [mm]" for by in ("readings", "with model error") for end in ("low", "high")
)
"""Columns that stored tables of older versions lack."""
_UNCERTAIN: Final = "uncertain: not corrected"
_REMARKS: Final = ("", "no load", "capped", _UNCERTAIN)
"""Remarks on a point in the table of points, stored there by index."""


@dataclass(frozen=True, eq=False)
class Corrections(CaseCorrections):
    """Corrections of the k points of a path that are under load."""

    points: IndexArray  # (k,) indices of points in the path


@dataclass(frozen=True, eq=False)
class WrittenPoints:
    """The m points of a path, and how well the written program corrects the k points under load."""

    path: ProgramPath  # path of the program
    corrections: Corrections  # corrections of the points under load
    # (k, 6) motion from the wanted pose to the pose that the loaded robot reaches if it moves to the written
    # numbers [m, rad]
    residual: FloatArray
    rounding: FloatArray  # (k,) length of the residual's part that is due to the program's rounded digits [m]
    changed: BoolArray  # (k,) whether a number of the target was changed
    place: FloatArray  # (m, 3) wanted position of the tool's centre point in R0 [m]
    arm: FloatArray  # (m, 6) wanted postures of the arm as the controller shows them [rad]
    quantile: float  # half width of the intervals in standard uncertainties

    @cached_property
    def counted(self) -> BoolArray:
        """Mask (k,) of the points whose deflections count in summaries.

        Usually only points under load are written, and all of them count. If the targets are turned to better
        postures (`path.programmed` is set), points without load are written, too, and do not count.
        """
        points = self.corrections.points
        all_points = np.ones(len(points), dtype=np.bool_)
        if len(points) == 0 or self.path.programmed is None:
            return all_points
        cases = self.path.cases[points]
        is_loaded = np.asarray(cases.force.any(axis=1) | cases.moment.any(axis=1))
        return is_loaded if is_loaded.any() else all_points

    def summarize_sizes(self, sizes: FloatArray) -> Spread | None:
        """Return median, 95 % quantile and maximum of lengths (k,) [m], one for each point under load.

        Only points that count in summaries are regarded; the result is None if there are none.
        """
        counted_sizes = sizes[self.counted]
        if len(counted_sizes) == 0:
            return None
        median, p95, greatest = np.quantile(counted_sizes, [0.5, 0.95, 1.0]).tolist()
        return Spread(median=median, p95=p95, greatest=greatest)

    @cached_property
    def _intervals(self) -> FloatArray:
        """Confidence intervals of each deflection (2, k, 2) [m]: from readings only, then with model error.

        NaN where an interval is unknown.
        """
        return self._make_intervals(self.corrections.uncorrected, self.corrections.uncertainty)

    @cached_property
    def _remaining_intervals(self) -> FloatArray:
        """Confidence intervals of each residual (2, k, 2) [m]: from readings only, then with model error.

        A correction by the prediction leaves the error of the prediction, whose direction is unknown. NaN
        where an interval is unknown.
        """
        return self._make_intervals(self.residual, self.corrections.scatter)

    def _make_intervals(self, motion: FloatArray, uncertainty: FloatArray) -> FloatArray:
        """Return intervals (2, k, 2) of the lengths of motions (k, 6) [m]: by readings, and with model error.

        `uncertainty` (k,) is the standard uncertainty of each length from the readings [m].
        """
        half_widths = np.stack([self.quantile * uncertainty, self.corrections.model_error])
        half_widths[~np.isfinite(half_widths)] = np.nan
        by_readings, with_model_error = half_widths
        # The interval with model error must not be narrower than the interval from readings only.
        wider = np.fmax(by_readings, with_model_error)
        half_widths[1] = np.where(np.isnan(with_model_error), np.nan, wider)
        length = _vector_lengths(motion[:, :3])
        low = np.maximum(length - half_widths, 0.0)
        high = length + half_widths
        return np.stack([low, high], axis=2)

    @cached_property
    def has_model_error(self) -> bool:
        """Tell whether the model error has a bound at all points whose deflections count."""
        return bool(np.isfinite(self._intervals[1, self.counted]).all())

    def summarize_intervals(self, of: Literal["deflection", "residual"]) -> SpreadEnds | None:
        """Return the spreads of the lower and of the upper ends of intervals, over the points that count.

        The intervals include the model error if its bound is known. Return None unless all of them are known.
        """
        intervals = self._intervals if of == "deflection" else self._remaining_intervals
        by_readings, with_model_error = intervals
        chosen = with_model_error if self.has_model_error else by_readings
        low, high = chosen.T
        are_all_known = np.isfinite(high[self.counted]).all()
        if not are_all_known:
            return None
        spread_of_low, spread_of_high = self.summarize_sizes(low), self.summarize_sizes(high)
        if spread_of_low is None or spread_of_high is None:
            return None
        return SpreadEnds(low=spread_of_low, high=spread_of_high)

    def list_worst_points(self) -> list[ProgramPoint]:
        """Return at most `MAX_WORST` points with the greatest deflections, greatest first."""
        corrections, targets = self.corrections, self.path.program.targets
        deflections = _vector_lengths(corrections.uncorrected[:, :3])
        # Of each worst point: its row among the corrections, its number on the path, its target.
        worst = np.argsort(-deflections, kind="stable")[:MAX_WORST]
        points = corrections.points[worst]
        target_indices = self.path.targets[points]
        uncorrected = corrections.uncorrected[worst]  # (w, 6) [m and rad]
        correction = corrections.correction[worst]
        residual = self.residual[worst]
        interval, interval_with_error = self._intervals[:, worst]
        residual_interval, residual_interval_with_error = self._remaining_intervals[:, worst]
        names = [_replace_unprintable(targets.names[index]) for index in target_indices.tolist()]
        return messages.build_messages(
            ProgramPoint,
            number=points + 1,
            name=names,
            line=targets.line[target_indices],
            place=self.place[points],
            deflection=_vector_lengths(uncorrected[:, :3]),
            deflection_rotation=_vector_lengths(uncorrected[:, 3:]),
            correction=_vector_lengths(correction[:, :3]),
            correction_rotation=_vector_lengths(correction[:, 3:]),
            standard_uncertainty=corrections.uncertainty[worst],
            interval=interval,
            interval_with_model_error=interval_with_error,
            residual=_vector_lengths(residual[:, :3]),
            residual_rotation=_vector_lengths(residual[:, 3:]),
            residual_interval=residual_interval,
            residual_interval_with_model_error=residual_interval_with_error,
            rounding=self.rounding[worst],
            share=corrections.share[worst],
            capped=corrections.capped[worst],
        )

    def _loaded_columns(self, block: slice) -> FloatArray:
        """Return the numbers (b, 22) of b points under load, in the order of the names `_LOADED_COLUMNS`.

        Lengths are in mm, rotations in mrad. `block` is the range of the points among the corrections.
        """
        corrections = self.corrections
        interval, interval_with_model_error = 1e3 * self._intervals[:, block]  # (b, 2) [mm]
        return np.column_stack(
            [
                *_motions_in_mm(corrections.uncorrected[block]),
                *_motions_in_mm(corrections.correction[block]),
                1e3 * corrections.uncertainty[block],
                interval,
                interval_with_model_error,
                *_motions_in_mm(self.residual[block]),
                1e3 * self.rounding[block],
                corrections.share[block],
            ]
        )

    def pack_table(self) -> bytes:
        """Return a table of all points, in the order of the path, as bytes that `points_sheet` reads.

        Points without load have NaN in the columns `_LOADED_COLUMNS`.
        """
        path = self.path
        targets = path.program.targets
        names = "\n".join([targets.names[i] for i in path.targets.tolist()]).encode("latin-1")
        content = io.BytesIO()
        for column in self._fill_columns():
            np.save(content, _split_differences(column), allow_pickle=False)
        for array in (
            self._number_remarks(),
            targets.source[path.targets].astype(np.uint8),
            targets.line[path.targets].astype(np.int32),
            np.array([source.name for source in path.program.sources]),
            np.frombuffer(names, dtype=np.uint8),
            self._pack_remaining(),
        ):
            np.save(content, array, allow_pickle=False)
        return content.getvalue()

    def _fill_columns(self) -> NDArray[np.float32]:
        """Return the columns `_POSTURE_COLUMNS`, then `_LOADED_COLUMNS`, of the m points of the path (c, m).

        Points without load have NaN in the latter.
        """
        first_loaded_column = len(_POSTURE_COLUMNS)
        column_count = first_loaded_column + len(_LOADED_COLUMNS)
        columns = np.full((column_count, len(self.path.targets)), np.nan, dtype=np.float32)
        columns[:3] = self.place.T
        columns[3:first_loaded_column] = np.degrees(self.arm).T
        loaded_points = self.corrections.points
        for start in range(0, len(loaded_points), BLOCK):
            block = slice(start, start + BLOCK)
            columns[first_loaded_column:, loaded_points[block]] = self._loaded_columns(block).T
        return columns

    def _number_remarks(self) -> NDArray[np.uint8]:
        """Return the remark on each point of the path (m,), as an index in `_REMARKS`; later ones win."""
        corrections = self.corrections
        remarks = np.full(len(self.path.targets), _REMARKS.index("no load"), dtype=np.uint8)
        remarks[corrections.points[self.counted]] = _REMARKS.index("")
        remarks[corrections.points[corrections.capped]] = _REMARKS.index("capped")
        remarks[corrections.points[corrections.uncertain]] = _REMARKS.index(_UNCERTAIN)
        return remarks

    def _pack_remaining(self) -> NDArray[np.float32]:
        """Return the columns `_REMAINING_COLUMNS` (4, m) [mm] of the points of the path; NaN without load.

        They are the lower and upper ends of two intervals of the residual: by readings, and with model error.
        """
        columns = np.full((len(_REMAINING_COLUMNS), len(self.path.targets)), np.nan, dtype=np.float32)
        by_readings, with_model_error = 1e3 * self._remaining_intervals  # (k, 2) low and high ends [mm]
        columns[:, self.corrections.points] = np.concatenate([by_readings.T, with_model_error.T])
        return columns


def points_sheet(content: bytes) -> Sheet:
    """Return the table of points from bytes of `WrittenPoints.pack_table`; NaN for an empty cell."""
    stored = io.BytesIO(content)
    numbers = dict[str, NDArray[np.float32]]()
    for name in _POSTURE_COLUMNS + _LOADED_COLUMNS:
        numbers[name] = _add_up_differences(np.load(stored, allow_pickle=False))
    remark, source, line, files, names = (np.load(stored, allow_pickle=False) for _ in range(5))
    columns: dict[str, Any] = {
        "point": np.arange(1, len(line) + 1),
        "name": names.tobytes().decode("latin-1").split("\n"),
        "file": files.astype(object)[source],
        "line": line,
    }
    columns |= numbers
    has_remaining_columns = stored.tell() < len(content)  # older tables have none
    if has_remaining_columns:
        columns |= dict(zip(_REMAINING_COLUMNS, np.load(stored, allow_pickle=False), strict=True))
    columns["remark"] = np.array(_REMARKS, dtype=object)[remark]
    return Sheet(columns, texts=frozenset({"name", "file", "remark"}), digits=".7g")


def _replace_unprintable(name: str) -> str:
    """Return a name with a question mark in place of each character that cannot be printed."""
    return "".join(character if character.isprintable() else "?" for character in name)


def _split_differences(column: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the bytes (4, m) of m numbers, arranged so that compression leaves a third of them.

    Neighbouring points differ little. So the differences of their bits, read as integers, are stored: the
    first bytes of all differences, then the second bytes, and so on.
    """
    differences = np.diff(column.view(np.uint32), prepend=np.uint32(0))
    bytes_of_each = differences.view(np.uint8).reshape(-1, 4)
    return np.ascontiguousarray(bytes_of_each.T)


def _add_up_differences(planes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the numbers (m,) whose bytes (4, m) `_split_differences` arranged."""
    differences = np.ascontiguousarray(planes.T).view(np.uint32)
    return np.cumsum(differences, dtype=np.uint32).view(np.float32)


def _motions_in_mm(motion: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return displacements (k, 3) [mm], their lengths (k,) [mm] and rotation angles (k,) [mrad] of motions.

    `motion` (k, 6) [m, rad] has displacements, then rotation vectors.
    """
    displacement, rotation = motion[:, :3], motion[:, 3:]
    return 1e3 * displacement, 1e3 * _vector_lengths(displacement), 1e3 * _vector_lengths(rotation)


def _vector_lengths(vectors: FloatArray) -> FloatArray:
    """Return the Euclidean length of each vector along the last axis."""
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def write_compensated_program(
    path: ProgramPath,
    corrections: Corrections,
    model: ForwardModel,
    inverse: InverseKinematics,
    quantile: float,
    rewriting: Rewriting | RowsWriting,
) -> WrittenPoints:
    """Write the compensated program, and check the written numbers with the model of the loaded robot.

    The residuals are computed from the numbers as written, so that rounded digits count. `rewriting` then has
    the program's files. Return the points with their residuals.

    Raises:
        FaultsError: a correction leads out of the joints' limits, or a corrected target is not reached.
    """
    robot, program = model.robot, path.program
    _refuse_out_of_limits(path, corrections)
    targets = path.targets[corrections.points]  # under load
    residual = np.empty((len(targets), 6))
    is_changed = np.zeros(len(targets), dtype=np.bool_)
    unreached: list[int] = []
    for rows in rewriting.blocks(targets):
        block_targets = targets[rows]
        corrected = Postures(robot, robot.joint_map.model_angles(corrections.commanded[rows]))
        written = _write_corrected_numbers(path, corrections, rows, corrected, inverse, rewriting)
        programmed = program.targets.values[block_targets, :NUMBERS]
        is_changed[rows] = (np.isfinite(programmed) & (programmed != written)).any(axis=1)
        cases = path.cases[corrections.points[rows]]
        residual[rows], reached = _compute_residuals(
            path, cases, block_targets, written, corrected, model, inverse
        )
        unreached += corrections.points[rows[~reached]].tolist()
    reason = "the robot does not reach the corrected target"
    _refuse_points(path, sorted(unreached), reason, "move the part away from the singularity")
    return WrittenPoints(
        path=path,
        corrections=corrections,
        residual=residual,
        rounding=_vector_lengths(residual[:, :3] - corrections.residual[:, :3]),
        changed=is_changed,
        place=_compute_programmed_positions(path, robot),
        arm=inverse.select_arm_joints(path.cases.joints),
        quantile=quantile,
    )


def _write_corrected_numbers(
    path: ProgramPath,
    corrections: Corrections,
    rows: IndexArray,
    corrected: Postures,
    inverse: InverseKinematics,
    rewriting: Rewriting | RowsWriting,
) -> FloatArray:
    """Write the corrected numbers of b targets into the program; return the numbers (b, 7) as written.

    Args:
        path: path of the program.
        corrections: corrections of all points under load.
        rows: (b,) indices in `corrections` of the points to write.
        corrected: corrected postures of these points.
        inverse: inverse kinematics, with the choice of the joints that belong to the arm.
        rewriting: text or rows of the program, in which the numbers are replaced.
    """
    targets = path.program.targets
    points = corrections.points[rows]
    block_targets = path.targets[points]
    is_joint_target = targets.given_as_joints[block_targets]
    corrected_arm = inverse.select_arm_joints(corrections.commanded[rows])
    numbers = path.frames.convert_poses_to_numbers(path.program, block_targets, corrected.flange_pose)
    arm_in_units_of_program = corrected_arm / targets.angle_unit[block_targets, None]
    numbers[is_joint_target, :6] = arm_in_units_of_program[is_joint_target]
    # A target without correction keeps its text, unless it is reached in another posture.
    is_written = corrections.share[rows] > 0.0
    if path.programmed is not None:
        is_written |= ~is_joint_target
    numbers[~is_written] = np.nan
    # Only targets that are poses state a configuration of the arm, which a correction can make wrong.
    programmed = path.cases.joints if path.programmed is None else path.programmed
    programmed_arm = inverse.select_arm_joints(programmed[points])
    written_poses = np.flatnonzero(~is_joint_target & is_written)
    edits_of_configuration = path.stated.list_word_edits(
        block_targets[written_poses], programmed_arm[written_poses], corrected_arm[written_poses]
    )
    return rewriting.replace(block_targets, numbers, edits_of_configuration)


def _compute_residuals(
    path: ProgramPath,
    cases: LoadCases,
    targets: IndexArray,
    written: FloatArray,
    corrected: Postures,
    model: ForwardModel,
    inverse: InverseKinematics,
) -> tuple[FloatArray, BoolArray]:
    """Compute how far the loaded robot is from the programmed poses, if it moves to the written numbers.

    Args:
        path: path of the program.
        cases: programmed postures of b targets, with loads.
        targets: (b,) indices of the targets.
        written: (b, 7) numbers of the targets in the compensated program.
        corrected: corrected postures before the numbers were rounded.
        model: model of the loaded robot.
        inverse: inverse kinematics of the robot.

    Returns:
        Residuals (b, 6) [m, rad], and a mask (b,) of the targets that the robot reaches.
    """
    robot, program, frames = model.robot, path.program, path.frames
    is_joint_target = program.targets.given_as_joints[targets]
    angle_unit = program.targets.angle_unit[targets, None]
    pose_rows = np.flatnonzero(~is_joint_target)
    # The numbers of a target in joint angles are the posture; for a pose, it is solved near the correction.
    written_angles = robot.joint_map.model_angles(inverse.insert_held_joints(written[:, :6] * angle_unit))
    written_poses = frames.flange_poses(program, targets[pose_rows], written[pose_rows])
    # If all targets are poses of a robot without linear axes, the kinematics are not computed again.
    can_start_from_corrected = inverse.arm is robot and len(pose_rows) == len(targets)
    if can_start_from_corrected:
        start = corrected
    else:
        start = Postures(inverse.arm, inverse.select_arm_joints(corrected.q)[pose_rows])
    arm_angles, pose_reached = inverse.refine_from(written_poses, start)
    written_angles[pose_rows] = inverse.insert_held_joints(arm_angles, of_model=True)
    reached = np.ones(len(targets), dtype=np.bool_)
    reached[pose_rows] = pose_reached
    wanted_angles = robot.joint_map.model_angles(cases.joints)
    if path.programmed is None:
        wanted_poses = frames.find_flange_poses(program, targets, robot, cases.joints)
    else:  # the program states other poses than the wanted ones
        wanted_poses = flange_poses(robot, wanted_angles)
    # The loaded robot is near the wanted posture, moved by the rounding of the written numbers.
    start_angles = wanted_angles + written_angles - corrected.q
    residuals = compute_pose_residuals(model, cases, wanted_poses, written_angles, start_angles)
    return residuals, reached


def _compute_programmed_positions(path: ProgramPath, robot: Robot) -> FloatArray:
    """Return the programmed positions (m, 3) of the tool's centre point, in R0 [m].

    The numbers of a pose are such a position; a target in joint angles needs the kinematics of the robot.
    """
    positions = path.frames.positions(path.program, path.targets)
    joint_targets = np.flatnonzero(path.program.targets.given_as_joints[path.targets])
    if len(joint_targets):
        angles = robot.joint_map.model_angles(path.cases.joints[joint_targets])
        centre_in_flange = path.cases.place[joint_targets, None]  # (j, 1, 3): one point for each posture
        positions[joint_targets] = Postures(robot, angles).to_base(centre_in_flange)[:, 0]
    return positions


def _refuse_out_of_limits(path: ProgramPath, corrections: Corrections) -> None:
    """Raise a `FaultsError` if a correction leads beyond the limits of a joint."""
    is_outside = corrections.status == RowStatus.BEYOND_LIMITS
    reason = "the corrected target is outside of the joints' limits"
    _refuse_points(path, corrections.points[is_outside].tolist(), reason, "move the part, or omit its load")


def _refuse_points(path: ProgramPath, points: Sequence[int], reason: str, remedy: str) -> None:
    """Raise a `FaultsError` with a fault at each of these points of a path; do nothing without points."""
    if points:
        raise FaultsError([path.make_fault(point, reason, remedy) for point in points])


def _read_program(
    files: Sequence[tuple[str, bytes]], request: ProgramRequest | ProcessRequest, external_axes: ExternalAxes
) -> ReadProgram:
    """Read the program of a request; some of its moves may be left without a correction.

    Args:
        files: name and content of each file of the program.
        request: request, which states what is known about routines, and whether moves may be left.
        external_axes: whether external axes may carry the arm or the part.

    Raises:
        FaultsError: the program is not understood, or no move can be corrected.
        MovesLeftError: some moves cannot be corrected, and the request does not leave them.
    """
    program = read_program(
        files,
        request.format,
        request.leave_alone,
        leave_others=True,
        trust_routines=request.trust_routines,
        external_axes=external_axes,
    )
    if request.leave_others or not program.faults:
        return program
    first_faults = FaultsError(program.faults)
    left_count, corrected_count = len(program.left_moves), len(program.moves)
    left_of_all = f"{left_count} of {left_count + corrected_count} moves"
    raise MovesLeftError(
        f"{left_of_all} cannot be corrected; {first_faults.reason}",
        where=first_faults.where,
        remedy=f"write {left_of_all} anew; or state `leave_others: true` to correct only "
        f"the other {corrected_count}",
        items=first_faults.items,
    )


def _interpret_external_axes(request: ProgramOptions, robot: Robot) -> ExternalAxes:
    """Return whether the program's external axes are joints of the robot, or may carry the arm or the part.

    If the request does not say, they are joints of the robot if its model has linear axes.
    """
    if request.external_axes is not None:
        return ExternalAxes(request.external_axes)
    has_linear_axes = robot.prismatic.any()
    return ExternalAxes.OF_ROBOT if has_linear_axes else ExternalAxes.MAY_CARRY


def _refuse_compensating_controller(request: ProgramRequest | ProcessRequest) -> None:
    """Refuse a program for a controller that compensates the deflection under load itself.

    Raises:
        RequestError: the request states this by `accuracy_option`.
    """
    if request.accuracy_option == "compensates_load":
        raise RequestError(
            "the controller already compensates the deflection under load, so a second compensation would "
            "be wrong",
            where="accuracy_option",
            remedy="switch the controller's accuracy option off, repeat the measurement, and set "
            "`accuracy_option` to `off`",
        )


class _RequestFiles(NamedTuple):
    """Files of a request, decompressed."""

    of_program: dict[str, bytes]  # content of each file by its name
    load_table: bytes | None  # content of the table of loads; None without


def _separate_load_table(request: ProgramRequest | ProcessRequest) -> _RequestFiles:
    """Return the files of the program, and the table of loads, which `loads` of the request names.

    Raises:
        RequestError: the table was not sent, or a file has no content.
    """
    contents = {file.name: decompress_file(file) for file in request.files}
    table = None if request.loads is None else contents.pop(request.loads, None)
    is_table_missing = request.loads is not None and table is None
    if is_table_missing:
        raise RequestError(
            "the table of loads was not sent",
            where="loads",
            remedy="send the table together with the files of the program",
        )
    return _RequestFiles(contents, table)


class ProgramWork(Work):
    """Work of a compensated program, whose units are points; postures are computed when first needed."""

    unit = "points"
    activity = "compensating"
    subject = "program"  # noun for the result, in its verdict
    corrects = True  # whether deflections are corrected
    cut_remark = (
        "the force of the cut is uncertain by 25 %, but the intervals of the points do not include this "
        "uncertainty"
    )

    def __init__(
        self,
        robot: Robot,
        robot_id: str,
        run: Run | None,
        request: ProgramRequest | ProcessRequest,
        content: str = "",
    ) -> None:
        """Read the program, and collect its loads.

        Without a run, the model is the prior of the robot, and `content` is the hash of the robot. The prior
        also depends on the payload.

        Raises:
            RequestError: fields of the request contradict each other, the run has no model, or the program
                is not understood.
        """
        _refuse_compensating_controller(request)
        self.robot_id, self._request = robot_id, request
        options = request.model_dump_json(exclude={"run_id", "robot_id", "files"})
        contents = [each.content or "" for each in request.files]
        model_hash = f"{content} {robot.payload!r}" if run is None else run.provenance.input_hash
        self.input_hash = hash_texts(model_hash, options, *contents)
        self._run_model: RunModel | PriorModel
        with as_request_errors():
            if run is None:
                self._run_model = PriorModel.from_robot(
                    robot, weighted=bool(request.masses) or request.absolute
                )
            else:
                self._run_model = RunModel.from_run(
                    robot,
                    run,
                    absolute=request.absolute,
                    masses=request.masses,
                    length=LENGTH[request.units.length],
                )
        files = _separate_load_table(request)
        self._external_axes = _interpret_external_axes(request, robot)
        self._rows = find_rows(files.of_program, request.units, robot)
        if self._rows is None:
            self._program = _read_program([*files.of_program.items()], request, self._external_axes)
        else:
            self._program = self._rows.program
        self._visits = Visits.collect(self._program, request, files.load_table, self._measure_lengths)
        feeds = find_feeds(self._program, request, self._visits)
        # (v, n) greatest motion of the model's joints for a length of the line to each visit [rad/m or m/m]
        self._joint_limits = Pace(feeds, robot.speeds, rate=np.inf).limits()

    def _measure_lengths(self) -> FloatArray:
        """Return the length (v,) of the path up to each visit of a target [m], for loads by length."""
        return measure_lengths(self._program, self._request, self._run_model.model.robot, self._inverse)

    @cached_property
    def _inverse(self) -> InverseKinematics:
        """Inverse kinematics of the robot, near the posture `start` of the request."""
        robot = self._run_model.model.robot
        with as_request_errors():
            return InverseKinematics(robot, convert_start_joints(self._request, robot))

    @cached_property
    def _path(self) -> ProgramPath:
        """Path of the program: wanted postures and loads of its points."""
        return find_path(
            self._program, self._request, self._run_model.model.robot, self._inverse, self._visits
        )

    @cached_property
    def _ramp(self) -> FloatArray:
        """Share (m,) of the full correction at each point, from 0 to 1.

        The correction rises from zero, where the load begins, and falls to zero, where it ends, along the
        length `ramp_length` of the request.
        """
        ramp_length = LENGTH[self._request.units.length] * self._request.ramp_length  # [m]
        return compute_ramp_shares(self._run_model.model.robot, self._path.cases, ramp_length)

    @cached_property
    def _blend(self) -> Blend | None:
        """Loads for the computation of corrections, changed so that corrections change slowly along the path.

        Where a load begins at once, the correction would begin at once, too, and joints would have to move
        faster than they can. The blended loads rise and fall over a length of the path instead. None if no
        joint has a limit of speed, or if corrections can follow the loads as they are.
        """
        has_limits = not np.isinf(self._joint_limits).all()
        if not self.corrects or not has_limits:
            return None
        visits = self._visits
        cases_of_visits = self._path.cases[visits.number]  # the cases of the points, once for each visit
        blend = blend_loads(self._run_model.model, cases_of_visits, visits.continuous, self._joint_limits)
        return None if blend is None else blend.select(visits.first)

    def steps(self) -> Sequence[Span]:
        """Return the steps of the work as spans of the points under load; no steps for a short program."""
        point_count = max(len(self._program.targets), len(self._program.moves.visits))
        is_short = point_count <= MAX_QUICK_POINTS
        return () if is_short else self._spans()

    def _spans(self) -> tuple[Span, ...]:
        """Return the points under load, cut into spans of `STEP_POINTS` points."""
        return cut_into_spans(len(self._points()), STEP_POINTS)

    def _points(self) -> IndexArray:
        """Return the indices of the path's points that are written: the points under load."""
        return self._visits.loaded

    def compute(self, span: Span) -> Arrays:
        """Compute the corrections of a step, which is a span of points; return `Corrections`' fields by name.

        Raises:
            RequestError: the load twists a joint whose stiffness is unknown, or the robot does not reach the
                path.
            FaultsError: the springs have no stable equilibrium under a load.
        """
        return self._correct(span)

    def _correct(self, span: Span) -> Arrays:
        """Compute the corrections of a span of points under load; return `Corrections`' fields by name.

        Raises:
            RequestError: the load twists a joint whose stiffness is unknown, or the robot does not reach the
                path.
            FaultsError: the springs have no stable equilibrium under a load.
        """
        points = self._points()[slice(*span)]
        settings = CorrectionSettings(self._correction_limits(), self._request.confidence)
        blended_cases = None if self._blend is None else self._blend.cases[points]
        corrections, faults, _ = correct_cases(
            self._run_model.model,
            self._run_model.error,
            self._inverse,
            self._path.cases[points],
            settings,
            self._ramp[points],
            blended_cases,
        )
        self._refuse_faults(faults, points)
        return {**vars(corrections), "points": points}

    def _refuse_faults(self, faults: Mapping[int, CasesError], points: IndexArray) -> None:
        """Refuse a program with points that cannot be corrected; `faults` has their rows in `points`.

        Raises:
            CasesError: the load twists a joint whose stiffness is unknown.
            FaultsError: a load has no stable equilibrium, or a corrected target is not reached.
        """
        for error in faults.values():
            if error.cause == "unseen_joint":  # more readings are needed, wherever the load acts
                raise error
        if faults:
            row, first_error = next(iter(faults.items()))
            point = int(points[row])
            raise FaultsError([self._path.make_fault(point, first_error.reason, first_error.remedy)])

    def conclude(self, parts: Sequence[Arrays]) -> ProgramResult:
        """Write the compensated program, and return it with the residuals of its points.

        Raises:
            RequestError: a load twists a joint of unknown stiffness, or the robot does not reach the path.
            FaultsError: the robot does not reach a corrected target.
        """
        computed_parts = parts or map(self._correct, self._spans())  # a short program has no steps
        corrections = Corrections(**concatenate_steps(computed_parts))
        del parts  # free the memory, as `corrections` is a copy
        quantile = self._run_model.model.quantile(self._request.confidence)
        rewriting = Rewriting(self._program) if self._rows is None else RowsWriting(self._rows)
        points = write_compensated_program(
            self._path, corrections, self._run_model.model, self._inverse, quantile, rewriting
        )
        contents = rewriting.files()
        self._check_written(rewriting, points)
        program, unchanged_moves = self._program, len(self._program.left_moves)
        assessment = self._assess_corrections(corrections)
        if self.must_mark(assessment, unchanged_moves) and points.changed.any():
            # The comment that marks the program as compensated goes into the first file.
            contents[0] = insert_mark(
                program.format,
                contents[0],
                self._run_model.name,
                assessment.verdict,
                datetime.now(UTC).date(),
                len(program.moves) + unchanged_moves,
                unchanged_moves,
            )
        names = [source.name for source in program.sources]
        files = [compress_file(name, content) for name, content in zip(names, contents, strict=True)]
        return self._make_result(points, files, assessment)

    def _check_written(self, rewriting: Rewriting | RowsWriting, points: WrittenPoints) -> None:
        """Check what was written; a compensated program needs no further check."""

    def must_mark(self, assessment: Assessment, unchanged_moves: int) -> bool:
        """Return whether the written program gets a comment that marks it as compensated."""
        return self._request.mark or assessment.verdict == "do_not_use" or bool(unchanged_moves)

    def _list_reasons(self) -> list[Finding]:
        """Return reasons of the result that do not concern its corrections, most important first."""
        return []

    def _assess_corrections(self, corrections: Corrections) -> Assessment:
        """Return the verdict on the compensated program, with its reasons and those of the run.

        Raises:
            VerdictError: limits reduce corrections, and the request has no `accept_verdict`.
        """
        run = self._run_model.result
        lengths = _vector_lengths(corrections.uncorrected[:, :3])
        extrapolated_count = int((corrections.extrapolation > EXTRAPOLATED).sum())
        reasons = [
            *self._list_reasons(),
            *find_implausible_deflection(float(lengths.max(initial=0.0)), run),
            *find_far_points([*np.unique(self._path.cases.load_point, axis=0).tolist()]),
            *find_beyond_campaign(extrapolated_count, len(corrections.points), "points"),
            *self._find_uncorrected(corrections),
            *_find_capped(corrections),
            *self._find_singular(corrections),
        ]
        if corrections.capped.any() and self._request.accept_verdict is None:
            items = [("the program", each.message, each.remedy) for each in reasons]
            raise VerdictError.for_result(
                "a program whose corrections exceed the limits", "max_displacement", items
            )
        return assess_with_run(self.subject, reasons, self._run_model.assessment)

    def _find_uncorrected(self, corrections: Corrections) -> Iterator[Finding]:
        """Report that no point is corrected, and that moves of the program were left unchanged."""
        if self.corrects and not corrections.correction.any():
            message = "nothing is corrected: no point is loaded, or each deflection is below its uncertainty"
            remedy = "state the load; measure more if the deflections matter"
            yield make_reason("nothing_corrected", "use_with_care", message, remedy)
        corrected_count, unchanged_count = len(self._program.moves), len(self._program.left_moves)
        if unchanged_count:
            message = (
                f"{corrected_count} of {corrected_count + unchanged_count} moves were corrected, "
                f"{unchanged_count} were left unchanged"
            )
            remedy = "check that the unchanged moves need no correction"
            yield make_reason("moves_left", "use_with_care", message, remedy)

    def _find_singular(self, corrections: Corrections) -> Iterator[Finding]:
        """Report how many points are near a singularity: corrections turn a joint there by a large angle."""
        wanted = self._path.cases.joints[corrections.points]
        greatest_turns = np.abs(corrections.commanded - wanted).max(axis=1, initial=0.0)
        count = int((greatest_turns > _SINGULAR_TURN).sum())
        if count:
            message = (
                f"{count} of {len(corrections.points)} points are near a singularity: joints turn by "
                f"over {_SINGULAR_TURN:g} rad"
            )
            remedy = "move the part away from the singularity"
            yield make_reason("near_singularity", "use_with_care", message, remedy)

    def _correction_limits(self) -> CorrectionLimits:
        """Return the limits of a correction in m and rad, from the request or the default limits."""
        request, limits = self._request, CorrectionLimits()
        displacement, rotation = limits.displacement, limits.rotation
        if request.max_displacement is not None:
            displacement = LENGTH[request.units.length] * request.max_displacement
        if request.max_rotation is not None:
            rotation = ANGLE[request.units.angle] * request.max_rotation
        return CorrectionLimits(displacement, rotation)

    def _make_result(
        self, points: WrittenPoints, files: list[ProgramFile], assessment: Assessment
    ) -> ProgramResult:
        """Return the result message of the corrected points and written files."""
        corrections, program = points.corrections, self._program
        deflections = _vector_lengths(corrections.uncorrected[:, :3])
        correction_sizes = _vector_lengths(corrections.correction[:, :3])
        residuals = _vector_lengths(points.residual[:, :3])
        remarks = [*self._describe_blend(points), *self.list_remarks()]
        kind: ProgramFormat = program.format  # type: ignore[assignment]
        return ProgramResult(
            joint_kinds=joint_kinds_by_name(self._run_model.model.robot),
            assessment=assessment,
            format=kind,
            points=len(program.targets),
            moves=len(program.moves) + len(program.left_moves),
            moves_left=len(program.left_moves),
            corrected=int(points.changed.sum()),
            capped=int(corrections.capped.sum()),
            left_alone=self._count_uncorrected_targets(points),
            deflection=points.summarize_sizes(deflections),
            correction=points.summarize_sizes(correction_sizes),
            residual=points.summarize_sizes(residuals),
            deflection_ends=points.summarize_intervals("deflection"),
            residual_ends=points.summarize_intervals("residual"),
            with_model_error=points.has_model_error,
            rounding=points.summarize_sizes(points.rounding),
            confidence=self._request.confidence,
            worst=points.list_worst_points(),
            remarks=remarks,
            files=files,
            table=compress_file("points", points.pack_table()),
        )

    def _count_uncorrected_targets(self, points: WrittenPoints) -> dict[LeftAlone, int]:
        """Return reason → number of the targets that are not corrected for this reason, if there are any."""
        path_length = len(points.path.targets)
        counts: dict[LeftAlone, int] = {
            "no_load": path_length - int(points.counted.sum()),
            "uncertain": int(points.corrections.uncertain.sum()),
            "not_used": len(self._program.targets) - path_length,
        }
        return {reason: count for reason, count in counts.items() if count}

    def _describe_blend(self, points: WrittenPoints) -> list[str]:
        """Return a remark on corrections that cannot follow the loads; none if all can.

        Where the load changes faster than joints can move, the correction changes over a length of the path.
        """
        blend = self._blend
        if blend is None:
            return []
        moves = self._program.moves
        is_blended = blend.lengths > 0.0  # (m,)
        first_blended_point = int(np.argmax(is_blended))
        first_visit = self._visits.first[first_blended_point]
        first_line = int(moves.line[moves.move_of_visit[first_visit]])
        residuals = points.residual[is_blended[points.corrections.points], :3]
        greatest_residual = float(np.linalg.norm(residuals, axis=1).max(initial=0.0))
        text = describe_blend(float(blend.lengths.max()), greatest_residual)
        return [f"{int(is_blended.sum())} points, the first in line {first_line}: {text}"]

    def list_remarks(self) -> list[str]:
        """Return remarks on the run's model, then a remark for each reason why lines were not corrected.

        After `_MAX_REMARKS` reasons, one remark counts the others.
        """
        lines_of = defaultdict[tuple[int, str], list[int]](list)  # by the index of the file, and the reason
        for remark in self._program.left_alone:
            lines_of[remark.source, remark.text].append(remark.line)
        for move in self._program.left_moves:
            lines_of[0, f"left unchanged: {move.reason}; {move.remedy}"].append(move.line)
        uncorrected = []
        for (source, reason), lines in lines_of.items():
            file = f" of {quote_text(self._program.sources[source].name)}" if source else ""
            uncorrected.append(f"{_line_numbers(lines)}{file}: {reason}")
        remarks = self._run_model.remarks(self._request.confidence)
        if self._request.cut is not None:
            remarks.append(self.cut_remark)
        remarks += uncorrected[:_MAX_REMARKS]
        hidden_count = len(uncorrected) - _MAX_REMARKS
        if hidden_count > 0:
            remarks.append(f"… and {hidden_count} more remarks")
        return remarks


def _line_numbers(lines: Sequence[int]) -> str:
    """Return line numbers as text, such as "lines 3, 7": the first five, and the number of further lines."""
    if len(lines) == 1:
        return f"line {lines[0]}"
    first = ", ".join(map(str, lines[:_SHOWN_LINES]))
    further_count = len(lines) - _SHOWN_LINES
    more = f" and {further_count} more" if further_count > 0 else ""
    return f"lines {first}{more}"


def _find_capped(corrections: Corrections) -> Iterator[Finding]:
    """Report how many points the limits reduce the correction of; if all, the program is not to be used."""
    capped_count, point_count = int(corrections.capped.sum()), len(corrections.points)
    if capped_count:
        verdict: Verdict = "do_not_use" if capped_count == point_count else "use_with_care"
        message = f"the limits reduce the correction of {capped_count} of {point_count} points"
        remedy = "check the load and its unit, then raise `max_displacement` or `max_rotation`"
        yield make_reason("corrections_capped", verdict, message, remedy)


def prepare_compensation(inputs: Inputs, request: ProgramRequest) -> ProgramWork:
    """Fetch the run of a request, and return the work that compensates the program.

    Raises:
        RequestError: the run does not exist or has no model for predictions; or the request has no files,
            does not fit the run, or has a program that was compensated already.
    """
    run = find_accepted_run(inputs, request.run_id, request.accept_verdict)
    refuse_corrected_files(inputs, request, run.prepared.robot_id)
    return ProgramWork(run.prepared.robot, run.prepared.robot_id, run.run, request)


def refuse_corrected_files(inputs: Inputs, request: ProgramRequest | ProcessRequest, robot_id: str) -> None:
    """Refuse a request without files, or with a file that was written by another job.

    Raises:
        RequestError: there is no file, or a program was compensated already.
    """
    if not request.files:
        raise RequestError("no file was sent", where="files", remedy="send the program")
    sent_digests = {hashlib.sha256(decompress_file(file)).hexdigest() for file in request.files}
    for kind in (Program, Process):
        for job in inputs.job_summaries(kind, robot_id):
            written_digests = job.get("outputs", ())
            was_written_by_job = sent_digests.intersection(written_digests)
            if was_written_by_job:
                raise RequestError(
                    f"a file of the request is the output of the compensated program '{job['id']}'",
                    where="files",
                    remedy="send the original program",
                )
