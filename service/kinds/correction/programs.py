"""The work of a corrected program: correct the targets by the model of a run, and write the program."""

from __future__ import annotations

import hashlib
import io
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from jointstiff.schemas.correction import (
    MAX_WORST,
    CorrectedProgram,
    CorrectionJob,
    CorrectionOptions,
    CorrectionRequest,
    CorrectionResult,
    LeftAlone,
    ProgramFile,
    ProgramFormat,
    ProgramPoint,
    Spread,
    SpreadEnds,
)
from jointstiff.schemas.finding import Assessment, Finding, Verdict
from jointstiff.schemas.retired import RetiredProcess, RetiredProgram
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.readings import hash_texts
from jointstiff.service.conversion.robots import joint_kinds_by_name
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.kinds.correction.files import compress_file, decompress_file
from jointstiff.service.kinds.correction.path import (
    ProgramPath,
    Visits,
    find_feeds,
    find_path,
    measure_lengths,
)
from jointstiff.service.kinds.correction.text import FaultsError, insert_mark, read_program
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
from jointstiff.service.runs.correction.answer import (
    read_limits,
    read_start,
    refuse_compensating_controller,
)
from jointstiff.service.runs.verdicts import (
    RunModel,
    assess_with_run,
    find_beyond_campaign,
    find_far_points,
    find_implausible_deflection,
    make_reason,
)
from jointstiff.service.tables.table import Sheet
from jointstiff.solver import messages
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.correct.blend import Blend, blend_loads, describe_blend, find_joint_limits
from jointstiff.solver.correct.correct import (
    CaseCorrections,
    CorrectionSettings,
    RowStatus,
    correct_cases,
)
from jointstiff.solver.errors import CasesError, RequestError
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.forward import (
    ForwardModel,
    compute_pose_residuals,
    compute_ramp_shares,
)
from jointstiff.solver.predict.models import EXTRAPOLATED
from robotprograms import BLOCK, NUMBERS, Edit, ExternalAxes, Rewriting, quote_text
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
    *(f"residual {end}, {by} [mm]" for by in ("readings", "with model error") for end in ("low", "high")),
)
_UNCERTAIN: Final = "uncertain: not corrected"
_REMARKS: Final = ("", "no load", "capped", _UNCERTAIN)
"""Remarks on a point in the table of points, stored there by index."""


_Columns: TypeAlias = dict[str, Sequence[Any] | NDArray[Any]]
"""Columns of a table by the names of fields: one value for each point."""


class _Motions(NamedTuple):
    """k motions of a rigid body, from one pose to another, along the axes of R0."""

    displacement: FloatArray  # (k, 3) [m]
    rotation: FloatArray  # (k, 3) rotation vectors [rad]

    @classmethod
    def from_rows(cls, rows: FloatArray) -> _Motions:
        """Return the motions in the rows (k, 6) of an array: displacement, then rotation vector."""
        return cls(rows[:, :3], rows[:, 3:])

    @property
    def lengths(self) -> FloatArray:
        """Lengths of the displacements (k,) [m]."""
        return _vector_lengths(self.displacement)

    @property
    def angles(self) -> FloatArray:
        """Angles of the rotations (k,) [rad]."""
        return _vector_lengths(self.rotation)

    def select(self, rows: IndexArray | slice) -> _Motions:
        """Return the motions in some of the rows."""
        return _Motions(self.displacement[rows], self.rotation[rows])

    def in_mm(self) -> FloatArray:
        """Return columns (k, 5): displacement [mm], its length [mm], angle of the rotation [mrad]."""
        return 1e3 * np.column_stack([self.displacement, self.lengths, self.angles])


@dataclass(frozen=True, eq=False)
class Corrections(CaseCorrections):
    """Corrections of the k points of a path that are under load."""

    points: IndexArray  # (k,) indices of points in the path

    @property
    def deflection_motions(self) -> _Motions:
        """Motions by which the load moves the k points without a correction."""
        return _Motions.from_rows(self.uncorrected)

    @property
    def correction_motions(self) -> _Motions:
        """Motions by which the corrections move the k targets."""
        return _Motions.from_rows(self.correction)


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

    @property
    def residual_motions(self) -> _Motions:
        """Motions (k) from the wanted pose to the pose that the loaded robot reaches."""
        return _Motions.from_rows(self.residual)

    def summarize_sizes(self, sizes: FloatArray) -> Spread | None:
        """Return median, 95 % quantile and maximum of lengths (k,) [m], one for each point under load.

        The result is None if there are none.
        """
        if len(sizes) == 0:
            return None
        median, p95, greatest = np.quantile(sizes, [0.5, 0.95, 1.0]).tolist()
        return Spread(median=median, p95=p95, greatest=greatest)

    @cached_property
    def _intervals(self) -> FloatArray:
        """Confidence intervals of each deflection (2, k, 2) [m]: from readings only, then with model error.

        NaN where an interval is unknown.
        """
        return self._make_intervals(self.corrections.deflection_motions, self.corrections.uncertainty)

    @cached_property
    def _remaining_intervals(self) -> FloatArray:
        """Confidence intervals of each residual (2, k, 2) [m]: from readings only, then with model error.

        A correction by the prediction leaves the error of the prediction, whose direction is unknown. NaN
        where an interval is unknown.
        """
        return self._make_intervals(self.residual_motions, self.corrections.scatter)

    def _make_intervals(self, motions: _Motions, uncertainty: FloatArray) -> FloatArray:
        """Return intervals (2, k, 2) of the lengths of k motions [m]: by readings, and with model error.

        `uncertainty` (k,) is the standard uncertainty of each length from the readings [m].
        """
        by_readings = _replace_infinite(self.quantile * uncertainty)
        with_model_error = _replace_infinite(self.corrections.model_error)
        # The interval with model error must not be narrower than the interval from readings only.
        wider = np.fmax(by_readings, with_model_error)
        with_model_error = np.where(np.isnan(with_model_error), np.nan, wider)
        half_widths = np.stack([by_readings, with_model_error])
        low = np.maximum(motions.lengths - half_widths, 0.0)
        high = motions.lengths + half_widths
        return np.stack([low, high], axis=2)

    @cached_property
    def has_model_error(self) -> bool:
        """Tell whether the model error has a bound at all points."""
        return bool(np.isfinite(self._intervals[1]).all())

    def summarize_intervals(self, of: Literal["deflection", "residual"]) -> SpreadEnds | None:
        """Return the spreads of the lower and of the upper ends of intervals, over the points that count.

        The intervals include the model error if its bound is known. Return None unless all of them are known.
        """
        intervals = self._intervals if of == "deflection" else self._remaining_intervals
        by_readings, with_model_error = intervals
        chosen = with_model_error if self.has_model_error else by_readings
        low, high = chosen.T
        are_all_known = np.isfinite(high).all()
        if not are_all_known:
            return None
        spread_of_low, spread_of_high = self.summarize_sizes(low), self.summarize_sizes(high)
        if spread_of_low is None or spread_of_high is None:
            return None
        return SpreadEnds(low=spread_of_low, high=spread_of_high)

    def list_worst_points(self) -> list[ProgramPoint]:
        """Return at most `MAX_WORST` points with the greatest deflections, greatest first."""
        deflections = self.corrections.deflection_motions.lengths
        worst = np.argsort(-deflections, kind="stable")[:MAX_WORST]  # rows among the corrections
        return messages.build_messages(
            ProgramPoint,
            **self._describe_points(self.corrections.points[worst]),
            **self._describe_motions(worst),
            **self._describe_intervals(worst),
        )

    def _describe_points(self, points: IndexArray) -> _Columns:
        """Return number, name, line and place of points (w,), given by their indices in the path.

        The keys are fields of `ProgramPoint`, a message about one point of the program.
        """
        targets = self.path.program.targets
        target_indices = self.path.targets[points]
        names = [_replace_unprintable(targets.names[index]) for index in target_indices.tolist()]
        return {
            "number": points + 1,
            "name": names,
            "line": targets.line[target_indices],
            "place": self.place[points],
        }

    def _describe_motions(self, rows: IndexArray) -> _Columns:
        """Return deflection, correction and residual of the points in rows (w,) of the corrections.

        The keys are fields of `ProgramPoint`, a message about one point of the program.
        """
        corrections = self.corrections
        deflection = corrections.deflection_motions.select(rows)
        correction = corrections.correction_motions.select(rows)
        residual = self.residual_motions.select(rows)
        return {
            "deflection": deflection.lengths,
            "deflection_rotation": deflection.angles,
            "correction": correction.lengths,
            "correction_rotation": correction.angles,
            "residual": residual.lengths,
            "residual_rotation": residual.angles,
            "rounding": self.rounding[rows],
            "share": corrections.share[rows],
            "capped": corrections.capped[rows],
        }

    def _describe_intervals(self, rows: IndexArray) -> _Columns:
        """Return uncertainty and intervals of deflection and residual in rows (w,) of the corrections.

        The keys are fields of `ProgramPoint`, a message about one point of the program.
        """
        interval, interval_with_model_error = self._intervals[:, rows]
        residual_interval, residual_interval_with_model_error = self._remaining_intervals[:, rows]
        return {
            "standard_uncertainty": self.corrections.uncertainty[rows],
            "interval": interval,
            "interval_with_model_error": interval_with_model_error,
            "residual_interval": residual_interval,
            "residual_interval_with_model_error": residual_interval_with_model_error,
        }

    def _loaded_columns(self, block: slice) -> FloatArray:
        """Return the numbers (b, 26) of b points under load, in the order of the names `_LOADED_COLUMNS`.

        Lengths are in mm, rotations in mrad. `block` is the range of the points among the corrections.
        """
        corrections = self.corrections
        interval, interval_with_model_error = 1e3 * self._intervals[:, block]  # (b, 2) [mm]
        of_residual, of_residual_with_model_error = 1e3 * self._remaining_intervals[:, block]
        return np.column_stack(
            [
                corrections.deflection_motions.select(block).in_mm(),
                corrections.correction_motions.select(block).in_mm(),
                1e3 * corrections.uncertainty[block],
                interval,
                interval_with_model_error,
                self.residual_motions.select(block).in_mm(),
                1e3 * self.rounding[block],
                corrections.share[block],
                of_residual,
                of_residual_with_model_error,
            ]
        )

    def pack_table(self) -> bytes:
        """Return a table of all points, in the order of the path, as bytes that `points_sheet` reads.

        Points without load have NaN in the columns `_LOADED_COLUMNS`.
        """
        program, targets = self.path.program, self.path.targets
        names = "\n".join([program.targets.names[i] for i in targets.tolist()])
        stored = _StoredTable(
            columns=[_split_differences(column) for column in self._fill_columns()],
            remark=self._number_remarks(),
            file=program.targets.source[targets].astype(np.uint8),
            line=program.targets.line[targets].astype(np.int32),
            file_names=np.array([source.name for source in program.sources]),
            names=np.frombuffer(names.encode("latin-1"), dtype=np.uint8),
        )
        return stored.to_bytes()

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
        remarks[corrections.points] = _REMARKS.index("")
        remarks[corrections.points[corrections.capped]] = _REMARKS.index("capped")
        remarks[corrections.points[corrections.uncertain]] = _REMARKS.index(_UNCERTAIN)
        return remarks


class _StoredTable(NamedTuple):
    """Table of the m points of a path, as arrays that are stored one after the other."""

    columns: list[NDArray[np.uint8]]  # (4, m) each: columns of numbers, as `_split_differences` arranges them
    remark: NDArray[np.uint8]  # (m,) index of each point's remark in `_REMARKS`
    file: NDArray[np.uint8]  # (m,) index of each point's file
    line: NDArray[np.int32]  # (m,) line of each point in its file
    file_names: NDArray[np.str_]  # names of the files
    names: NDArray[np.uint8]  # names of the points as bytes of Latin-1, one name a line

    def to_bytes(self) -> bytes:
        """Return the arrays in the order of the fields, each in NumPy's format `npy`."""
        stored = io.BytesIO()
        arrays: list[NDArray[Any]] = [*self.columns, self.remark, self.file, self.line]
        arrays += [self.file_names, self.names]
        for array in arrays:
            np.save(stored, array, allow_pickle=False)
        return stored.getvalue()

    @classmethod
    def from_bytes(cls, content: bytes) -> _StoredTable:
        """Read the arrays from bytes of `to_bytes`."""
        stored = io.BytesIO(content)
        column_count = len(_POSTURE_COLUMNS + _LOADED_COLUMNS)
        columns = [np.load(stored, allow_pickle=False) for _ in range(column_count)]
        remark, file, line, file_names, names = (np.load(stored, allow_pickle=False) for _ in range(5))
        return cls(columns, remark, file, line, file_names, names)

    def list_names(self) -> list[str]:
        """Return the name of each point."""
        return self.names.tobytes().decode("latin-1").split("\n")

    def name_columns(self) -> dict[str, NDArray[np.float32]]:
        """Return the columns of numbers (m,) by their headers, such as `deflection [mm]`."""
        headers = _POSTURE_COLUMNS + _LOADED_COLUMNS
        return dict(zip(headers, map(_add_up_differences, self.columns), strict=True))


def points_sheet(content: bytes) -> Sheet:
    """Return the table of points from bytes of `WrittenPoints.pack_table`; NaN for an empty cell."""
    stored = _StoredTable.from_bytes(content)
    names_of_files, remarks = stored.file_names.astype(object), np.array(_REMARKS, dtype=object)
    columns: dict[str, Any] = {
        "point": np.arange(1, len(stored.line) + 1),
        "name": stored.list_names(),
        "file": names_of_files[stored.file],
        "line": stored.line,
        **stored.name_columns(),
        "remark": remarks[stored.remark],
    }
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


def _replace_infinite(numbers: FloatArray) -> FloatArray:
    """Return numbers with NaN in place of infinity."""
    return np.where(np.isfinite(numbers), numbers, np.nan)


def _vector_lengths(vectors: FloatArray) -> FloatArray:
    """Return the Euclidean length of each vector along the last axis."""
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def write_corrected_program(
    path: ProgramPath,
    corrections: Corrections,
    model: ForwardModel,
    inverse: InverseKinematics,
    quantile: float,
    rewriting: Rewriting,
) -> WrittenPoints:
    """Write the corrected program, and check the written numbers with the model of the loaded robot.

    The residuals are computed from the numbers as written, so that rounded digits count. `rewriting` then has
    the program's files. Return the points with their residuals.

    Raises:
        FaultsError: a correction leads out of the joints' limits, or a corrected target is not reached.
    """
    _refuse_out_of_limits(path, corrections)
    written = _TargetWriter(path, corrections, model, inverse, rewriting).write()
    _refuse_unreached(path, corrections.points[~written.is_reached])
    return WrittenPoints(
        path=path,
        corrections=corrections,
        residual=written.residual,
        rounding=_vector_lengths(written.residual[:, :3] - corrections.residual[:, :3]),
        changed=written.is_changed,
        place=_compute_programmed_positions(path, model.robot),
        arm=inverse.select_arm_joints(path.cases.joints),
        quantile=quantile,
    )


class _WrittenTargets(NamedTuple):
    """Residuals of k targets with the numbers that were written, by the model of the loaded robot."""

    residual: FloatArray  # (k, 6) motion from the wanted to the reached pose [m, rad], axes of R0
    is_changed: BoolArray  # (k,) mask of the targets with a number that was changed
    is_reached: BoolArray  # (k,) mask of the targets that the robot reaches

    @classmethod
    def make_empty(cls, count: int) -> _WrittenTargets:
        """Return arrays for `count` targets, which `put` fills."""
        residual = np.empty((count, 6))
        return cls(residual, np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_))

    def put(self, rows: IndexArray, block: _WrittenTargets) -> None:
        """Store what is known of the targets of a block in the rows (b,) of these targets."""
        self.residual[rows] = block.residual
        self.is_changed[rows] = block.is_changed
        self.is_reached[rows] = block.is_reached


class _Block(NamedTuple):
    """b targets that are written at once."""

    rows: IndexArray  # (b,) row of each target among the corrections
    points: IndexArray  # (b,) index of each target's point in the path
    targets: IndexArray  # (b,) index of each target in the program
    is_joint_target: BoolArray  # (b,) mask of the targets in joint angles; the others are poses
    angle_unit: FloatArray  # (b, 1) unit of the angles of each target [rad]
    cases: LoadCases  # wanted postures, with loads
    corrected: Postures  # corrected postures, before their numbers are rounded


class _SolvedPostures(NamedTuple):
    """Postures of the robot at the written numbers of b targets."""

    angles: FloatArray  # (b, n) positions of the model's joints [rad or m]
    is_reached: BoolArray  # (b,) mask of the targets that the robot reaches


@dataclass(frozen=True, eq=False)
class _TargetWriter:
    """Writes corrected targets into a program, and computes what the loaded robot makes of them."""

    path: ProgramPath  # path of the program
    corrections: Corrections  # corrections of the k points under load
    model: ForwardModel  # model of the loaded robot
    inverse: InverseKinematics  # inverse kinematics, which knows the joints of the arm
    rewriting: Rewriting  # text of the program, in which numbers are replaced

    def write(self) -> _WrittenTargets:
        """Write the k targets under load, block by block, because all at once would need much memory."""
        targets = self.path.targets[self.corrections.points]
        written = _WrittenTargets.make_empty(len(targets))
        for rows in self.rewriting.blocks(targets):
            written.put(rows, self._write_block(self._make_block(rows)))
        return written

    def _make_block(self, rows: IndexArray) -> _Block:
        """Return the block of the targets in these rows (b,) of the corrections."""
        robot, targets_of_program = self.model.robot, self.path.program.targets
        points = self.corrections.points[rows]
        targets = self.path.targets[points]
        return _Block(
            rows=rows,
            points=points,
            targets=targets,
            is_joint_target=targets_of_program.given_as_joints[targets],
            angle_unit=targets_of_program.angle_unit[targets, None],
            cases=self.path.cases[points],
            corrected=Postures(robot, robot.joint_map.model_angles(self.corrections.commanded[rows])),
        )

    def _write_block(self, block: _Block) -> _WrittenTargets:
        """Write the numbers of b targets, and compute the poses that the loaded robot reaches by them."""
        numbers = self._write_numbers(block)
        programmed = self.path.program.targets.values[block.targets, :NUMBERS]
        is_changed_number = np.isfinite(programmed) & (programmed != numbers)  # (b, 7)
        postures = self._solve_postures(block, numbers)
        residual = self._compute_residuals(block, postures.angles)
        return _WrittenTargets(residual, is_changed_number.any(axis=1), postures.is_reached)

    def _write_numbers(self, block: _Block) -> FloatArray:
        """Write the corrected numbers of b targets into the program; return the numbers (b, 7) as written."""
        is_written = self.corrections.share[block.rows] > 0.0
        numbers = self._find_corrected_numbers(block)
        numbers[~is_written] = np.nan  # these targets keep their text
        edits = self._list_configuration_edits(block, is_written)
        return self.rewriting.replace(block.targets, numbers, edits)

    def _find_corrected_numbers(self, block: _Block) -> FloatArray:
        """Return the numbers (b, 7) that state corrected targets: those of a pose, or six joint angles."""
        numbers = self.path.frames.convert_poses_to_numbers(
            self.path.program, block.targets, block.corrected.flange_pose
        )
        corrected_arm = self.inverse.select_arm_joints(self.corrections.commanded[block.rows])  # (b, 6) [rad]
        angles_in_unit_of_program = corrected_arm / block.angle_unit
        numbers[block.is_joint_target, :6] = angles_in_unit_of_program[block.is_joint_target]
        return numbers

    def _list_configuration_edits(self, block: _Block, is_written: BoolArray) -> list[tuple[int, Edit]]:
        """Return edits of numbers that state the arm's configuration, each with the index of its target.

        Only targets that are poses state a configuration. A correction can make it wrong: it turns joint 1
        from 89.9° to 90.1°, for example, which is in another quadrant.

        Args:
            block: b targets.
            is_written: (b,) mask of the targets that get new numbers.
        """
        poses = np.flatnonzero(~block.is_joint_target & is_written)
        programmed_arm = self.inverse.select_arm_joints(self.path.cases.joints[block.points])
        corrected_arm = self.inverse.select_arm_joints(self.corrections.commanded[block.rows])
        return self.path.stated.list_word_edits(
            block.targets[poses], programmed_arm[poses], corrected_arm[poses]
        )

    def _solve_postures(self, block: _Block, numbers: FloatArray) -> _SolvedPostures:
        """Return the postures of the unloaded robot at the written numbers (b, 7) of targets.

        The numbers of a target in joint angles are the posture. For a pose, the posture is solved, beginning
        near the corrected one.
        """
        stated_arm = numbers[:, :6] * block.angle_unit
        angles = self.model.robot.joint_map.model_angles(self.inverse.insert_held_joints(stated_arm))
        is_reached = np.ones(len(numbers), dtype=np.bool_)
        pose_rows = np.flatnonzero(~block.is_joint_target)
        poses = self.path.frames.flange_poses(self.path.program, block.targets[pose_rows], numbers[pose_rows])
        arm_angles, pose_reached = self.inverse.refine_from(poses, self._choose_start(block, pose_rows))
        angles[pose_rows] = self.inverse.insert_held_joints(arm_angles, of_model=True)
        is_reached[pose_rows] = pose_reached
        return _SolvedPostures(angles, is_reached)

    def _choose_start(self, block: _Block, pose_rows: IndexArray) -> Postures:
        """Return the corrected postures of the arm at the targets in `pose_rows` of a block.

        If all targets are poses of a robot without linear axes, the kinematics are not computed again.
        """
        is_robot_the_arm = self.inverse.arm is self.model.robot
        if is_robot_the_arm and len(pose_rows) == len(block.targets):
            return block.corrected
        return Postures(self.inverse.arm, self.inverse.select_arm_joints(block.corrected.q)[pose_rows])

    def _compute_residuals(self, block: _Block, written_angles: FloatArray) -> FloatArray:
        """Return how far the loaded robot is from the wanted poses (b, 6) [m, rad], at the written targets.

        `written_angles` (b, n) are the postures of the unloaded robot at the written numbers [rad or m].
        """
        wanted_angles = self.model.robot.joint_map.model_angles(block.cases.joints)
        path = self.path
        wanted_poses = path.frames.find_flange_poses(
            path.program, block.targets, self.model.robot, block.cases.joints
        )
        # The loaded robot is near the wanted posture, moved by the rounding of the written numbers.
        start_angles = wanted_angles + written_angles - block.corrected.q
        return compute_pose_residuals(self.model, block.cases, wanted_poses, written_angles, start_angles)


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


def _refuse_unreached(path: ProgramPath, points: IndexArray) -> None:
    """Raise a `FaultsError` if there are points that the robot does not reach."""
    reason = "the robot does not reach the corrected target"
    _refuse_points(path, sorted(points.tolist()), reason, "move the part away from the singularity")


def _refuse_points(path: ProgramPath, points: Sequence[int], reason: str, remedy: str) -> None:
    """Raise a `FaultsError` with a fault at each of these points of a path; do nothing without points."""
    if points:
        raise FaultsError([path.make_fault(point, reason, remedy) for point in points])


def _read_program(
    files: Sequence[tuple[str, bytes]], request: CorrectionRequest, external_axes: ExternalAxes
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
    if not request.leave_others:
        _refuse_left_moves(program)
    return program


def _refuse_left_moves(program: ReadProgram) -> None:
    """Refuse a program with moves that cannot be corrected, because the request does not leave such moves.

    Raises:
        MovesLeftError: there are such moves; the error counts them, and lists why.
    """
    if not program.faults:
        return
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


def _interpret_external_axes(request: CorrectionOptions, robot: Robot) -> ExternalAxes:
    """Return whether the program's external axes are joints of the robot, or may carry the arm or the part.

    If the request does not say, they are joints of the robot if its model has linear axes.
    """
    if request.external_axes is not None:
        return ExternalAxes(request.external_axes)
    has_linear_axes = robot.prismatic.any()
    return ExternalAxes.OF_ROBOT if has_linear_axes else ExternalAxes.MAY_CARRY


class _RequestFiles(NamedTuple):
    """Files of a request, decompressed."""

    of_program: dict[str, bytes]  # content of each file by its name
    load_table: bytes | None  # content of the table of loads; None without


def _separate_load_table(request: CorrectionRequest) -> _RequestFiles:
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


def _hash_inputs(model_hash: str, request: CorrectionRequest) -> str:
    """Return the hash of all inputs of a program: the model's hash, the options, and the files."""
    options = request.model_dump_json(exclude={"run_id", "files"})
    contents = [file.content or "" for file in request.files]
    return hash_texts(model_hash, options, *contents)


class ProgramWork(Work):
    """Work of a corrected program, whose units are points; postures are computed when first needed."""

    unit = "points"
    activity = "correcting"

    def __init__(self, robot: Robot, robot_id: str, run: Run, request: CorrectionRequest) -> None:
        """Read the program, and collect its loads.

        Raises:
            RequestError: fields of the request contradict each other, the run has no model, or the program
                is not understood.
        """
        refuse_compensating_controller(request)
        self.robot_id, self._request = robot_id, request
        self.input_hash = _hash_inputs(run.provenance.input_hash, request)
        length_unit = LENGTH[request.units.length]
        with as_request_errors():
            self._run_model = RunModel.from_run(
                robot, run, absolute=request.absolute, masses=request.masses, length=length_unit
            )
        files = _separate_load_table(request)
        self._external_axes = _interpret_external_axes(request, robot)
        self._program = _read_program([*files.of_program.items()], request, self._external_axes)
        self._visits = Visits.collect(self._program, request, files.load_table, self._measure_lengths)
        feeds = find_feeds(self._program, request, self._visits)
        # (v, n) greatest motion of the model's joints for a length of the line to each visit [rad/m or m/m]
        self._joint_limits = find_joint_limits(feeds, robot.speeds)

    def _measure_lengths(self) -> FloatArray:
        """Return the length (v,) of the path up to each visit of a target [m], for loads by length."""
        return measure_lengths(self._program, self._request, self._run_model.model.robot, self._inverse)

    @cached_property
    def _inverse(self) -> InverseKinematics:
        """Inverse kinematics of the robot, near the posture `start` of the request."""
        robot = self._run_model.model.robot
        with as_request_errors():
            return InverseKinematics(robot, read_start(robot, self._request))

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
        if not has_limits:
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
        points = self._points()[slice(*span)]
        settings = CorrectionSettings(read_limits(self._request), self._request.confidence)
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

    def conclude(self, parts: Sequence[Arrays]) -> CorrectionResult:
        """Write the corrected program, and return it with the residuals of its points.

        Raises:
            RequestError: a load twists a joint of unknown stiffness, or the robot does not reach the path.
            FaultsError: the robot does not reach a corrected target.
        """
        computed_parts = parts or map(self.compute, self._spans())  # a short program has no steps
        corrections = Corrections(**concatenate_steps(computed_parts))
        del parts, computed_parts  # free the memory, as `corrections` is a copy
        rewriting = Rewriting(self._program)
        points = self._write_points(corrections, rewriting)
        contents = rewriting.files()
        assessment = self._assess_corrections(corrections)
        if points.changed.any() and self._must_mark(assessment, len(self._program.left_moves)):
            contents[0] = self._insert_mark(contents[0], assessment)
        names = [source.name for source in self._program.sources]
        files = [compress_file(name, content) for name, content in zip(names, contents, strict=True)]
        return self._make_result(points, files, assessment)

    def _write_points(self, corrections: Corrections, rewriting: Rewriting) -> WrittenPoints:
        """Write the corrected points into the program, and return them with their residuals.

        Raises:
            FaultsError: the robot does not reach a corrected target.
        """
        model = self._run_model.model
        quantile = model.quantile(self._request.confidence)
        return write_corrected_program(self._path, corrections, model, self._inverse, quantile, rewriting)

    def _insert_mark(self, content: bytes, assessment: Assessment) -> bytes:
        """Return the content of the first file with a comment that marks the program as corrected."""
        program, left_count = self._program, len(self._program.left_moves)
        return insert_mark(
            program.format,
            content,
            self._run_model.name,
            assessment.verdict,
            datetime.now(UTC).date(),
            len(program.moves) + left_count,
            left_count,
        )

    def _must_mark(self, assessment: Assessment, unchanged_moves: int) -> bool:
        """Return whether the written program gets a comment that marks it as corrected."""
        return self._request.mark or assessment.verdict == "do_not_use" or bool(unchanged_moves)

    def _assess_corrections(self, corrections: Corrections) -> Assessment:
        """Return the verdict on the corrected program, with its reasons and those of the run.

        Raises:
            VerdictError: limits reduce corrections, and the request has no `accept_verdict`.
        """
        reasons = [
            *self._find_doubtful_deflections(corrections),
            *self._find_uncorrected(corrections),
            *_find_capped(corrections),
            *self._find_singular(corrections),
        ]
        if corrections.capped.any() and self._request.accept_verdict is None:
            items = [("the program", each.message, each.remedy) for each in reasons]
            raise VerdictError.for_result(
                "a program whose corrections exceed the limits", "max_displacement", items
            )
        return assess_with_run("program", reasons, self._run_model.assessment)

    def _find_doubtful_deflections(self, corrections: Corrections) -> list[Finding]:
        """Return why predicted deflections are doubtful, most important first.

        A deflection is implausibly great, a load point is far from the flange, or loads exceed those of the
        campaign by which the model was identified.
        """
        greatest_deflection = float(corrections.deflection_motions.lengths.max(initial=0.0))
        load_points = np.unique(self._path.cases.load_point, axis=0)
        extrapolated_count = int((corrections.extrapolation > EXTRAPOLATED).sum())
        return [
            *find_implausible_deflection(greatest_deflection, self._run_model.result),
            *find_far_points([*load_points.tolist()]),
            *find_beyond_campaign(extrapolated_count, len(corrections.points), "points"),
        ]

    def _find_uncorrected(self, corrections: Corrections) -> Iterator[Finding]:
        """Report that no point is corrected, and that moves of the program were left unchanged."""
        if not corrections.correction.any():
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

    def _make_result(
        self, points: WrittenPoints, files: list[ProgramFile], assessment: Assessment
    ) -> CorrectionResult:
        """Return the result message of the corrected points and written files."""
        corrections, program = points.corrections, self._program
        kind: ProgramFormat = program.format  # type: ignore[assignment]
        corrected = CorrectedProgram(
            format=kind,
            points=len(program.targets),
            moves=len(program.moves) + len(program.left_moves),
            moves_left=len(program.left_moves),
            corrected=int(points.changed.sum()),
            capped=int(corrections.capped.sum()),
            left_alone=self._count_uncorrected_targets(points),
            deflection=points.summarize_sizes(corrections.deflection_motions.lengths),
            correction=points.summarize_sizes(corrections.correction_motions.lengths),
            residual=points.summarize_sizes(points.residual_motions.lengths),
            deflection_ends=points.summarize_intervals("deflection"),
            residual_ends=points.summarize_intervals("residual"),
            with_model_error=points.has_model_error,
            rounding=points.summarize_sizes(points.rounding),
            worst=points.list_worst_points(),
            files=files,
        )
        return CorrectionResult(
            joint_kinds=joint_kinds_by_name(self._run_model.model.robot),
            assessment=assessment,
            confidence=self._request.confidence,
            remarks=[*self._describe_blend(points), *self._list_remarks()],
            table=compress_file("points", points.pack_table()),
            program=corrected,
        )

    def _count_uncorrected_targets(self, points: WrittenPoints) -> dict[LeftAlone, int]:
        """Return reason → number of the targets that are not corrected for this reason, if there are any."""
        path_length = len(points.path.targets)
        counts: dict[LeftAlone, int] = {
            "no_load": path_length - len(points.corrections.points),
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

    def _list_remarks(self) -> list[str]:
        """Return remarks on the run's model, then a remark for each reason why lines were not corrected.

        After `_MAX_REMARKS` reasons, one remark counts the others.
        """
        remarks = self._run_model.remarks(self._request.confidence)
        if self._request.cut is not None:
            remarks.append(
                "the force of the cut is uncertain by 25 %, but the intervals of the points do not include "
                "this uncertainty"
            )
        uncorrected = self._describe_uncorrected_lines()
        remarks += uncorrected[:_MAX_REMARKS]
        hidden_count = len(uncorrected) - _MAX_REMARKS
        if hidden_count > 0:
            remarks.append(f"… and {hidden_count} more remarks")
        return remarks

    def _describe_uncorrected_lines(self) -> list[str]:
        """Return a sentence for each reason why lines are not corrected, with the lines and their file.

        The first file is not named: `lines 3, 7: left unchanged: …`, but `line 2 of 'sub.src': …`.
        """
        sentences = []
        for (source, reason), lines in self._group_uncorrected_lines().items():
            file = f" of {quote_text(self._program.sources[source].name)}" if source else ""
            sentences.append(f"{_line_numbers(lines)}{file}: {reason}")
        return sentences

    def _group_uncorrected_lines(self) -> dict[tuple[int, str], list[int]]:
        """Return the lines that are not corrected, by the index of their file and the reason."""
        lines_of = defaultdict[tuple[int, str], list[int]](list)
        for remark in self._program.left_alone:
            lines_of[remark.source, remark.text].append(remark.line)
        for move in self._program.left_moves:
            lines_of[0, f"left unchanged: {move.reason}; {move.remedy}"].append(move.line)
        return lines_of


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


def refuse_corrected_files(inputs: Inputs, request: CorrectionRequest, robot_id: str) -> None:
    """Refuse a request with a file that was written by another job.

    Raises:
        RequestError: a program was corrected already.
    """
    sent_digests = {hashlib.sha256(decompress_file(file)).hexdigest() for file in request.files}
    for kind in (CorrectionJob, RetiredProgram, RetiredProcess):
        for job in inputs.job_summaries(kind, robot_id):
            written_digests = job.get("outputs", ())
            was_written_by_job = sent_digests.intersection(written_digests)
            if was_written_by_job:
                raise RequestError(
                    f"a file of the request is the output of the correction '{job['id']}'",
                    where="files",
                    remedy="send the original program",
                )
