"""The path of a program: frames, loads and configurations of its targets, and the postures that they want."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from jointstiff.schemas.program import MAX_LINE, ProcessLoad, ProgramFrame, ProgramOptions
from jointstiff.service.conversion.robots import joint_factors, refuse_far_point, refuse_other_angles
from jointstiff.service.conversion.units import FORCE, LENGTH
from jointstiff.service.kinds.work import as_request_errors
from jointstiff.service.problems import FilesError
from jointstiff.service.programs.errors import Fault, ProgramError, shown
from jointstiff.service.programs.formats import frame_notation
from jointstiff.service.programs.notation import Edit, Notation, Orientation
from jointstiff.service.programs.program import BLOCK, NUMBERS, FrameName, Program
from jointstiff.service.runs.deflection import vector_column
from jointstiff.service.runs.verdicts import moment_factor
from jointstiff.service.tables.files import rows_of
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.inverse import InverseKinematics, Unreached, choose_postures
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot

_LEAST_SINE: Final = 1e-3
"""Sine of the angle between tool and x axis under which they count as parallel."""


@dataclass(frozen=True, eq=False)
class _Frames:
    """Frames, each once, and which of them each target has."""

    poses: FloatArray  # (k, 4, 4) [m]
    of_target: IndexArray  # (t,) places among them

    def of(self, targets: IndexArray) -> FloatArray:
        """Return the frames (m, 4, 4) of targets [m]."""
        return np.asarray(self.poses[self.of_target[targets]])

    def inverse(self, targets: IndexArray) -> FloatArray:
        """Return the inverses (m, 4, 4) of the frames of targets [m]."""
        inverse = np.tile(np.eye(4), (len(self.poses), 1, 1))
        inverse[:, :3, :3] = self.poses[:, :3, :3].transpose(0, 2, 1)
        inverse[:, :3, 3] = -(inverse[:, :3, :3] @ self.poses[:, :3, 3:])[..., 0]
        return np.asarray(inverse[self.of_target[targets]])


@dataclass(frozen=True, eq=False)
class ProgramFrames:
    """Frames of the targets of a program."""

    tool: _Frames  # in the model's flange frame
    base: _Frames  # in R0
    # (3,) direction that the tools' x axes follow, in the base; None if it is not stated
    x_axis: FloatArray | None

    @classmethod
    def of(cls, program: Program, options: ProgramOptions) -> ProgramFrames:
        """Find the numbers of all frames.

        Raises:
            RequestError: a frame has none, has them twice, is not in the program, or is no frame.
        """
        notation, targets = frame_notation(program), program.targets
        world = _stated_pose(notation, options.world, "world")
        flange = _stated_pose(notation, options.flange, "flange")
        unused = targets.by_joints & (options.axes != "base")
        bases = np.where(unused, -1, targets.base)
        tool = _place_targets(flange, notation, options.tools, targets.frames, targets.tool, "tools")
        base = _place_targets(world, notation, options.bases, targets.frames, bases, "bases")
        return cls(tool, base, None if options.tool_x is None else np.array(options.tool_x))

    def flange_poses(
        self, program: Program, indices: IndexArray, values: FloatArray | None = None
    ) -> FloatArray:
        """Return poses (m, 4, 4) of the flange in R0 [m]; NaN for joint targets.

        Args:
            program: the program.
            indices: m of its targets.
            values: (m, 7) their numbers; those of the program if None.

        Raises:
            RequestError: a target states no orientation about the tool's axis, and the request does not.
        """
        wanted = np.empty((len(indices), 4, 4))
        for start in range(0, len(indices), BLOCK):
            block = slice(start, start + BLOCK)
            own, poses = indices[block], np.full_like(wanted[block], np.nan)
            stated = program.targets.values[own] if values is None else values[block]
            for notation, rows in program.targets.by_notation(own):
                numbers = stated[rows, : 3 + notation.count]
                if notation.has_pose:
                    poses[rows] = notation.poses(numbers)
                elif not notation.is_joints:
                    poses[rows] = self._about_axis(notation, numbers)
            wanted[block] = self.base.of(own) @ poses @ self.tool.inverse(own)
        return wanted

    def places(self, program: Program, indices: IndexArray) -> FloatArray:
        """Return where targets are (m, 3), in R0 [m]; numbers without meaning for joint targets."""
        length = np.array([each.length for each in program.targets.notations])
        place = length[program.targets.notation[indices], None] * program.targets.values[indices, :3]
        base = self.base.of(indices)
        return np.asarray((base[:, :3, :3] @ place[..., None])[..., 0] + base[:, :3, 3])

    def numbers(self, program: Program, indices: IndexArray, flange: FloatArray) -> FloatArray:
        """Return the program's numbers (m, 7) of poses (m, 4, 4) of the flange in R0 [m]; NaN behind them."""
        poses = self.base.inverse(indices) @ flange @ self.tool.of(indices)
        numbers = np.full((len(indices), NUMBERS), np.nan)
        for notation, rows in program.targets.by_notation(indices):
            near = program.targets.values[indices[rows], : 3 + notation.count]
            if notation.is_joints:
                continue
            if notation.has_pose:
                new = notation.values(poses[rows], near)
            else:
                new = near.copy()
                new[:, :3] = poses[rows, :3, 3] / notation.length
                size = np.linalg.norm(near[:, 3:], axis=1, keepdims=True)
                new[:, 3:] = -size * poses[rows, :3, 2][:, : notation.count]
            numbers[rows, : new.shape[1]] = new
        return numbers

    def _about_axis(self, notation: Notation, numbers: FloatArray) -> FloatArray:
        """Return poses whose z axis points from spindle to tip, and whose x axis is nearest to `x_axis`."""
        if self.x_axis is None:
            raise RequestError(
                "the program gives the tool's axis, but no angle about it",
                where="tool_x",
                remedy="give `tool_x`, the direction of the tool's x axis in the base",
            )
        axis = np.tile([0.0, 0.0, 1.0], (len(numbers), 1))
        if notation.orientation is Orientation.TOOL_AXIS:
            axis = numbers[:, 3:]
        z = -axis / np.linalg.norm(axis, axis=1, keepdims=True)
        x = self.x_axis - (z @ self.x_axis)[:, None] * z
        size = np.linalg.norm(x, axis=1, keepdims=True)
        if not (size > _LEAST_SINE * np.linalg.norm(self.x_axis)).all():
            raise RequestError(
                "`tool_x` is parallel to the tool's axis", where="tool_x", remedy="give another direction"
            )
        x = x / size
        poses = np.tile(np.eye(4), (len(numbers), 1, 1))
        poses[:, :3, 0], poses[:, :3, 1], poses[:, :3, 2] = x, np.cross(z, x), z
        poses[:, :3, 3] = numbers[:, :3] * notation.length
        return poses


def _place_targets(
    outer: FloatArray,
    notation: Notation,
    stated: Sequence[ProgramFrame],
    frames: Sequence[FrameName],
    chosen: IndexArray,
    where: str,
) -> _Frames:
    """Return the frames of targets in R0 or the flange frame.

    Args:
        outer: (4, 4) in which they are; itself for −1.
        notation: of the numbers of frames.
        stated: by the request.
        frames: that the program names.
        chosen: (t,) place of each target's frame among them.
        where: field of the request.
    """
    given: dict[str | None, FloatArray] = {
        _key(frame.name): _stated_pose(notation, frame.values, f"{where}[{i}].values")
        for i, frame in enumerate(stated)
    }
    if len(given) < len(stated):
        raise RequestError("a frame is given twice", where=where, remedy="give each frame once")
    poses = np.tile(outer, (len(frames) + 1, 1, 1))
    used: set[str | None] = set()
    for place in np.unique(chosen[chosen >= 0]).tolist():
        frame = frames[place]
        if frame.pose is None:
            used.add(key := _key_of(frame, given, where))
            poses[place] = outer @ given[key]
        elif _key(frame.name) in given:
            reason = f"the program already has the numbers of {shown(frame.name)}"
            raise RequestError(reason, where=where, remedy="omit this frame")
        else:
            poses[place] = outer @ frame.pose
    for name in (frame.name for frame in stated if _key(frame.name) not in used):  # it may be misspelt
        all_known = "all frames of the program have numbers"
        reason = all_known if name is None else f"the program uses no {shown(name)}"
        raise RequestError(reason, where=where, remedy="omit this frame, or correct its name")
    return _Frames(poses, chosen)


def _key_of(frame: FrameName, given: Mapping[str | None, FloatArray], where: str) -> str | None:
    """Return the key of what the request gives for a frame: by its name, or for every frame."""
    for key in (_key(frame.name), None):
        if key in given:
            return key
    raise RequestError(
        f"the program names {shown(frame.name)}, but has no numbers for it",
        where=where,
        remedy=f"give them: {{'name': {frame.name!r}, 'values': [...]}}",
    )


def _key(name: str | None) -> str | None:
    return None if name is None else name.upper()


def _stated_pose(notation: Notation, values: Sequence[float] | None, where: str) -> FloatArray:
    if values is None:
        return np.eye(4)
    if len(values) != 3 + notation.count or not notation.states(np.array(values)):
        raise RequestError(
            f"a frame has {3 + notation.count} numbers",
            where=where,
            remedy=f"give the position, then {notation.orientation.value}, in the program's units",
        )
    return notation.pose(values)


_MORE_LINES: Final = 1_000
"""Lines of a table in addition to two for each point. Each costs a hundred bytes and more, blank ones too."""
_REMEDY: Final = "write `point`, then Fx [N], Fy [N], Fz [N], and, if there are moments, Mx [N.m] …"


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads (k, 6) [N, N·m] along the axes of the request, and which of them each move of a program has."""

    values: FloatArray  # (k, 6) force, then moment; the first one is no load
    of_visit: IndexArray  # (v,) index of each visit's load


def loads_of(options: ProgramOptions, table: bytes | None, lines: IndexArray, points: IndexArray) -> Loads:
    """Return the loads.

    Args:
        options: that state them.
        table: CSV of points, if there is one.
        lines: (v,) line of each visit's move.
        points: (v,) number of each visit's point, from 1.

    Raises:
        RequestError: segments overlap, or a moment has no unit.
        FilesError: the table is not understood.
    """
    if table is not None:
        return _from_table(table, points)
    stated: Sequence[ProcessLoad] = options.segments if options.load is None else [options.load]
    moments = np.array([load.moment for load in stated]).reshape(-1, 3)
    values = np.zeros((len(stated) + 1, 6))
    values[1:, :3] = FORCE[options.units.force] * np.array([load.force for load in stated]).reshape(-1, 3)
    values[1:, 3:] = moment_factor(options.units, moments) * moments
    if not stated:
        return Loads(values, np.zeros(len(lines), dtype=np.intp))
    return Loads(values, _segment_of(stated, lines))


def _segment_of(segments: Sequence[ProcessLoad], lines: IndexArray) -> IndexArray:
    order = sorted(range(len(segments)), key=lambda i: segments[i].first_line or 0)
    first = np.array([segments[i].first_line or 0 for i in order])
    last = np.array([segments[i].last_line or MAX_LINE for i in order])
    overlap = np.flatnonzero(first[1:] <= last[:-1])
    if len(overlap):
        raise RequestError(
            f"line {first[overlap[0] + 1]} has two loads",
            where=f"segments[{order[overlap[0] + 1]}]",
            remedy="let segments end before the next ones begin",
        )
    segment = np.searchsorted(first, lines, side="right") - 1
    inside = (segment >= 0) & (lines <= last[segment])
    return np.where(inside, np.array(order)[segment] + 1, 0)


def _from_table(content: bytes, points: IndexArray) -> Loads:
    most = int(points.max(initial=0))
    text = content.decode("utf-8-sig", errors="replace")
    lines, once = 2 * most + _MORE_LINES, f"number them 1 to {most}"
    if any(text.count(sign) > lines for sign in "\n\r") or any(
        text.count(sign) > 8 * lines for sign in ",;\t"
    ):
        raise _table_fault(1, "the table has more lines or cells than the program has points", once)
    try:
        rows, _ = rows_of(text)
    except csv.Error:
        raise _table_fault(1, "this is not a table", _REMEDY) from None
    columns = _columns(rows[0] if rows else [])
    values, number = [np.zeros(6)], np.zeros(most + 1, dtype=np.intp)
    for line, row in enumerate(rows[1:], 2):
        if any(row):
            point, load = _row(line, row, columns)
            if not 1 <= point <= most or number[point]:
                raise _table_fault(line, f"point {point} occurs twice, or is not in the program", once)
            number[point] = len(values)
            values.append(load)
    return Loads(np.array(values), number[points])


def _row(line: int, row: Sequence[str], columns: Sequence[tuple[int, float]]) -> tuple[int, FloatArray]:
    load = np.zeros(6)
    try:
        point, numbers = int(row[0]), [float(cell) for cell in row[1:]]
    except ValueError:
        raise _table_fault(line, "a cell is not a number", "write numbers with decimal points") from None
    if len(numbers) != len(columns) or not np.isfinite(numbers).all() or max(map(abs, numbers)) > 1e9:
        raise _table_fault(line, "cells are missing, or out of range", "give a finite number in each column")
    for (place, factor), size in zip(columns, numbers, strict=True):
        load[place] = factor * size
    return point, load


def _columns(header: Sequence[str]) -> list[tuple[int, float]]:
    """Return the place of each column behind the first among force and moment, and its factor to SI units."""
    columns = []
    for cell in header[1:]:
        try:
            column = vector_column(cell, ("force", "moment"))
        except RequestError:
            column = None
        if column is None:
            raise _table_fault(1, f"the header {cell[:40]!r} is not known", _REMEDY)
        columns.append((3 * (column[0] == "moment") + column[1], column[2]))
    places = [place for place, _ in columns]
    if header[:1] != ["point"] or len(set(places)) < len(places) or not {0, 1, 2} <= set(places):
        raise _table_fault(1, "a column is missing, or occurs twice", _REMEDY)
    return columns


def _table_fault(line: int, reason: str, remedy: str) -> FilesError:
    return FilesError(reason, remedy=remedy, where=f"loads:{line}")


_NEAR: Final = 1e-4
"""Angle from a boundary [rad] within which a program, which is rounded, may be on either side."""
_ROUNDING: Final = 1e-8
"""Angle from a boundary [rad] that is rounding: no word is changed for it."""
_MOST: Final = 1e9
"""Magnitude that no word has."""


@dataclass(frozen=True, slots=True)
class _Word:
    """A word on one joint: a number, or a bit of one, that means a range of angles."""

    joint: int  # index of the joint
    kind: Literal["sign", "quadrant", "turn"]
    bit: int | None = None  # bit of the number that is 1 below zero; None where the number is the word

    def ranges(self, numbers: FloatArray) -> FloatArray:
        """Return least and greatest angles (m, 2) [rad] that numbers (m,) mean; ∓inf for NaN."""
        if self.bit is not None:
            whole = np.nan_to_num(numbers).astype(np.int64)
            low, high = (
                np.where(whole >> self.bit & 1, -np.inf, 0.0),
                np.where(whole >> self.bit & 1, 0.0, np.inf),
            )
        elif self.kind == "quadrant":
            low, high = np.pi / 2 * numbers, np.pi / 2 * (numbers + 1)
        else:
            low, high = 2 * np.pi * numbers - np.pi, 2 * np.pi * numbers + np.pi
        unknown = np.isnan(numbers)
        return np.stack([np.where(unknown, -np.inf, low), np.where(unknown, np.inf, high)], axis=1)

    def rewritten(self, number: int, angle: float) -> int:
        """Return a number whose word means an angle [rad]."""
        if self.bit is not None:
            return number & ~(1 << self.bit) | int(angle < 0.0) << self.bit
        return int(
            np.floor(2 * angle / np.pi) if self.kind == "quadrant" else np.ceil(angle / (2 * np.pi) - 0.5)
        )


# Bit 2 of KUKA's S is 1 where A5 is below zero (beyond half a turn, which no wrist reaches, the reverse).
_WORDS: Final = {
    "T": tuple(_Word(joint, "sign", joint) for joint in range(6)),
    "S": (_Word(4, "sign", 2),),
    "cfx": (_Word(4, "sign", 0),),
    **{f"cf{joint + 1}": (_Word(joint, "quadrant"),) for joint in (0, 3, 5)},
    **{f"turn{joint + 1}": (_Word(joint, "turn"),) for joint in (0, 3, 5)},
}
_FREE_RAPID: Final = re.compile(r"\bConfJ\s*+\\\s*+Off\b", re.IGNORECASE)


class StatedConfigurations:
    """Read what the targets of a program say of the arm's configuration."""

    def __init__(self, program: Program) -> None:
        self._program = program
        # whether the controller takes a joint move to the configuration that is stated
        self.decides = program.format != "rapid" or not any(
            _FREE_RAPID.search(source.text) for source in program.sources
        )

    def ranges(self, indices: Sequence[int] | IndexArray) -> FloatArray:
        """Return least and greatest controller's angles (m, 6, 2) [rad]; ∓inf where nothing is stated."""
        rows = np.asarray(indices, dtype=np.intp)
        ranges = np.tile([-np.inf, np.inf], (len(rows), 6, 1))
        for word, column, members in self._words(rows):
            low, high = word.ranges(self._numbers(rows[members], column)).T
            stated = ranges[members, word.joint]
            ranges[members, word.joint] = np.stack(
                [np.maximum(stated[:, 0], low), np.minimum(stated[:, 1], high)], 1
            )
        return ranges

    def edits(self, indices: IndexArray, wanted: FloatArray, commanded: FloatArray) -> list[tuple[int, Edit]]:
        """Return the words to be rewritten, where an angle that agreed with its word no longer does.

        Args:
            indices: m targets.
            wanted: (m, 6) controller's angles [rad] of the targets before.
            commanded: (m, 6) after the correction.
        """
        changed: dict[tuple[int, int], int] = {}  # numbers by target and column
        for word, column, members in self._words(indices):
            numbers = self._numbers(indices[members], column)
            low, high = word.ranges(numbers).T
            before, after = wanted[members, word.joint], commanded[members, word.joint]
            agreed = (low - _NEAR <= before) & (before <= high + _NEAR)
            left = (after < low - _ROUNDING) | (after > high + _ROUNDING)
            for i in np.flatnonzero(agreed & left & np.isfinite(numbers)):
                place = int(indices[members[i]]), column
                changed[place] = word.rewritten(changed.get(place, int(numbers[i])), float(after[i]))
        return [
            (index, self._edit_number(index, column, number)) for (index, column), number in changed.items()
        ]

    def _edit_number(self, index: int, column: int, number: int) -> Edit:
        targets = self._program.targets
        start, end = targets.spans[index, column].tolist()
        binary = self._program.sources[targets.source[index]].text[start] == "'"  # KUKA's 'B010'
        return start, end, f"'B{number:0{end - start - 3}b}'" if binary else str(number)

    def _words(self, indices: IndexArray) -> Iterator[tuple[_Word, int, IndexArray]]:
        """Yield words, the columns of their numbers, and the places (k,) of the targets that have them."""
        targets = self._program.targets
        words = [tuple(name for name, _ in literal.words) for literal in targets.literals]
        different = list(dict.fromkeys(words))
        of_literal = np.array([different.index(names) for names in words], dtype=np.intp)
        of_target = of_literal[targets.literal[indices]]
        for which, names in enumerate(different):
            members = np.flatnonzero(of_target == which)
            for column, name in enumerate(names, NUMBERS):
                for word in _WORDS[name]:
                    yield word, column, members

    def _numbers(self, indices: IndexArray, column: int) -> FloatArray:
        """Return the numbers (m,) of words; NaN for one that is no usual whole number."""
        numbers = self._program.targets.values[indices, column]
        return np.where((numbers == np.round(numbers)) & (np.abs(numbers) < _MOST), numbers, np.nan)


_SAME: Final = 1e-6
"""Difference of two postures [rad] that is rounding."""
_REASONS: Final = {
    Unreached.OUT_OF_REACH: ("the robot does not reach it", "check tool, base, `world` and `flange`"),
    Unreached.OUT_OF_LIMITS: (
        "its posture is outside of the joints' limits",
        "check tool, base, `start`, and the limits of the robot's model",
    ),
    Unreached.NOT_AS_STATED: (
        "no posture within the limits has the stated configuration",
        "check tool and base, and that the joint map gives the controller's angles",
    ),
    Unreached.NOT_FOLLOWED: (
        "the arm is so near a singularity that the configuration of the arm is ambiguous",
        "move the part away from the singularity, or write the target as joint angles",
    ),
    Unreached.AMBIGUOUS: (
        "the arm's configuration is not stated here",
        "give `start`: the controller's angles near this target",
    ),
}


@dataclass(frozen=True, eq=False)
class ProgramPath:
    """The m targets that moves use, in the order of the path."""

    program: Program  # the program
    frames: ProgramFrames  # frames of its targets
    stated: StatedConfigurations  # what it says of the arm's configuration
    targets: IndexArray  # (m,) indices of the program's targets
    cases: LoadCases  # the wanted, loaded postures; the place is the tool's centre

    def fault(self, point: int, reason: str, remedy: str) -> Fault:
        """Return a fault at a point of the path."""
        return _fault(self.program, int(self.targets[point]), reason, remedy)


@dataclass(frozen=True, eq=False)
class Visits:
    """The v targets of all moves, one after the other, and their loads."""

    targets: IndexArray  # (v,) indices of the program's targets
    order: IndexArray  # (m,) targets that are visited, in the order of their first visits
    number: IndexArray  # (v,) place of each visit's target among them
    first: IndexArray  # (m,) first visit of each of them
    loads: Loads  # loads of the visits
    # (k,) places of the targets under load among those that are visited: all of them if own weight counts
    loaded: IndexArray

    @classmethod
    def of(cls, program: Program, options: ProgramOptions, table: bytes | None) -> Visits:
        """Collect the visits of a program.

        Raises:
            RequestError: no move is under load, or a load does not fit the program.
            ProgramError: there is no move, or a target has two loads.
        """
        visits = program.moves.visits
        if not len(visits):
            fault = Fault(
                program.sources[0].name, None, "the program has no move", "send a program with moves"
            )
            raise ProgramError([fault])
        unique, begin, place = np.unique(visits, return_index=True, return_inverse=True)
        by_visit = np.argsort(begin)
        rank = np.empty_like(by_visit)
        rank[by_visit] = np.arange(len(by_visit))
        first, number = begin[by_visit], rank[place]
        loads = loads_of(options, table, program.moves.line[program.moves.of_visit], number + 1)
        if not (loads.of_visit.any() or options.absolute):
            raise RequestError(
                "no move is under load",
                where="segments" if options.load is None else "load",
                remedy="give lines or points of moves for the loads",
            )
        load = loads.of_visit[first]
        reason = "a target is used under two loads"
        _refuse(
            program, visits[loads.of_visit != load[number]], reason, "use a separate target for each load"
        )
        loaded = np.flatnonzero((load > 0) | options.absolute)
        return cls(visits, unique[by_visit], number, first, loads, loaded)


def program_path(
    program: Program, options: ProgramOptions, robot: Robot, inverse: InverseKinematics, visits: Visits
) -> ProgramPath:
    """Return the path of a program.

    Raises:
        RequestError: something is not stated, or does not fit the program.
        ProgramError: targets are not reached, or their configurations are not known.
    """
    frames, stated = ProgramFrames.of(program, options), StatedConfigurations(program)
    joints = _wanted_postures(program, options, frames, stated, robot, inverse, visits.targets)
    apart = joints - joints[visits.first][visits.number]
    apart = np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))).max(axis=1)
    reason = "a target is reached in two configurations of the arm"
    remedy = "use a separate target for each configuration"
    _refuse(program, visits.targets[apart > _SAME], reason, remedy)
    load = visits.loads.of_visit[visits.first]
    with as_request_errors("program"):
        wanted = joints[visits.first]
        cases = _load_cases(options, frames, robot, visits.order, wanted, visits.loads.values[load])
    return ProgramPath(program, frames, stated, visits.order, cases)


def _refuse(program: Program, targets: IndexArray, reason: str, remedy: str) -> None:
    if len(targets):
        raise ProgramError([_fault(program, int(i), reason, remedy) for i in np.unique(targets)])


def _fault(program: Program, target: int, reason: str, remedy: str) -> Fault:
    targets = program.targets
    name = f"{shown(targets.names[target])}: " if targets.names[target] else ""
    return Fault(
        program.sources[targets.source[target]].name, int(targets.line[target]), name + reason, remedy
    )


def _wanted_postures(
    program: Program,
    options: ProgramOptions,
    frames: ProgramFrames,
    stated: StatedConfigurations,
    robot: Robot,
    inverse: InverseKinematics,
    visits: IndexArray,
) -> FloatArray:
    """Return the wanted posture (v, n) of each visit, as the controller shows it [rad or m]."""
    targets, unit = program.targets, program.targets.angle_unit[visits, None]
    by_joints = targets.by_joints[visits]
    given = np.where(by_joints[:, None], targets.values[visits, :6] * unit, np.nan)
    _refuse_new_letters(program, visits, by_joints)
    poses = frames.flange_poses(program, visits)
    ranges = stated.ranges(visits)
    says = np.isfinite(ranges).any(axis=(1, 2))
    start = start_of(options, robot)
    by_joint = program.moves.by_joint & says & stated.decides
    with as_request_errors("robot"):
        joints, unreached = choose_postures(inverse, poses, given, ranges, by_joint, start)
    faults = [
        _fault(program, int(visits[row]), *_REASONS[Unreached(unreached[row])])
        for row in np.flatnonzero(unreached)
    ]
    if faults:
        raise ProgramError(faults)
    return joints


def start_of(options: ProgramOptions, robot: Robot) -> FloatArray | None:
    """Return the joints (n,) near the first target, as the controller shows them [rad or m]; None for none.

    Raises:
        RequestError: they are those of another robot.
    """
    if options.start is None:
        return None
    refuse_other_angles(robot, options.start, "start")
    return np.asarray(joint_factors(robot, options.units) * np.array(options.start))


def _refuse_new_letters(program: Program, visits: IndexArray, by_joints: BoolArray) -> None:
    """Refuse a change of FANUC's N/F, U/D, T/B without a joint target between: no angles tell them."""
    literals, before, changed = program.targets.literals, "", []
    of_visit = program.targets.literal[visits].tolist() if any(each.letters for each in literals) else ()
    for target, literal, joints in zip(visits.tolist(), of_visit, by_joints.tolist(), strict=False):
        letters = "" if joints else literals[literal].letters
        if before and letters and letters != before:
            changed.append(target)
        before = "" if joints else letters or before
    remedy = "insert a move to joint angles before it, or split the program there"
    reason = "the arm changes its configuration (N/F, U/D, T/B)"
    _refuse(program, np.array(changed, dtype=np.intp), reason, remedy)


def _load_cases(
    options: ProgramOptions,
    frames: ProgramFrames,
    robot: Robot,
    targets: IndexArray,
    joints: FloatArray,
    loads: FloatArray,
) -> LoadCases:
    tool = frames.tool.of(targets)
    place = tool[:, :3, 3].copy()
    point = place
    if options.load_point is not None:
        length = LENGTH[options.units.length]
        refuse_far_point(options.load_point, "load_point", length=length)
        point = np.tile(length * np.array(options.load_point), (len(targets), 1))
    force, moment = loads[:, :3].copy(), loads[:, 3:].copy()
    if options.axes != "robot":
        if options.axes == "base":
            axes = frames.base.of(targets)[:, :3, :3]
        else:
            flange = Postures(robot, robot.joint_map.model_angles(joints)).flange_rotation
            axes = flange @ tool[:, :3, :3]
        force, moment = np.einsum("bij,bj->bi", axes, force), np.einsum("bij,bj->bi", axes, moment)
    return LoadCases(joints.copy(), force, moment, point.copy(), place)
