"""Targets and moves of a program as columns, and the search for the moves that can be corrected."""

from __future__ import annotations

import re
from array import array
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from robotprograms.arrays import BoolArray, FloatArray, IndexArray
from robotprograms.errors import (
    WRITE_NUMBERS,
    Fault,
    ProgramError,
    ReadMove,
    quote_text,
    show_text,
)
from robotprograms.language import Language, Move
from robotprograms.notation import Numerals
from robotprograms.own_numbers import NamePlace, copy_numbers, find_name
from robotprograms.program import (
    BLOCK,
    NUMBERS,
    WORDS,
    At,
    ExternalAxes,
    FrameName,
    Literal,
    Motion,
    Moves,
    OwnNumbers,
    Program,
    Remark,
    Source,
    Targets,
)

MAX_TARGETS: Final = 200_000
MAX_VISITS: Final = 400_000
"""Largest number of visits of targets by moves; each visit needs an inverse kinematics."""
MAX_REMARKS: Final = 400_000
"""Largest number of remarks on lines that are not corrected."""
MAX_VALUE: Final = 1e6
"""Magnitude of a number of a target: a kilometre in mm, 2,777 turns in degrees."""
_OUT_OF_RANGE: Final = f"a number of a target is out of range, beyond {MAX_VALUE:g}"
OF_ROUTINE: Final = " of routine "
"""Text between the name of a local variable and the name of its routine."""
IN_MODULE: Final = "__MODULE"
"""Text between a name that modules of a program use for different data, and the number of the module."""
_SEARCHED_LENGTH: Final = 1000
"""Number of characters from the beginning of a line in which a name is looked for."""
_NAME_OR_TEXT: Final = re.compile(r"'[^']*'|\b(?![a-z\d])(?:(?![a-z])\w)+\b")
_ENDING: Final = re.compile(
    rf"(?:\.(?:BASE|TOOL|[UOT]FRAME|UF|UT))?{OF_ROUTINE}\w+|\.(?:BASE|TOOL|[UOT]FRAME|UF|UT)\b|{IN_MODULE}\d+"
)
_NO_ORIENTATION: Final = "a quaternion or an axis is not of unit length"
_TOOL_CHANGES: Final = "the tool or the base changes within the table"
_ONE_TABLE_EACH: Final = "send one table for each tool and base"
_WRITE_ANEW: Final = "write all of its numbers anew, or split the program"
_AXIS_ROUNDING: Final = 2e-3
"""Largest difference of an external axis [mm, °] that rounding explains."""
_NO_AXIS: Final = 8e9
"""Value above which a number means that there is no such external axis: ABB writes 9e9."""
_MAX_AXES: Final = 24
"""Largest count of external axes of a target; a target with more axes is not corrected."""
_AXIS_AWAY: Final = "an external axis or another group is away from zero, and may carry the arm or the part"
_AXIS_MOVES: Final = "an external axis or another group moves"
_CARRY_NOTHING: Final = (
    "if the axis or group carries neither the arm nor the part, state `external_axes: carry_nothing`; "
    "otherwise keep the axis at zero"
)
_MOTIONS: Final = {motion: i for i, motion in enumerate(Motion)}
_TARGET_WIDTH: Final = 7
"""Count of the numbers of a `_TargetRow`, which an array stores one after the other."""
_MOVE_WIDTH: Final = 3
"""Count of the numbers of a move in an array: line, motion, count of visits up to the end of the move."""
_UNKNOWN_FRAME: Final = -1
"""Index in place of that of a base or tool that is not known."""
_KEY_BITS: Final = 40
"""Bits of the index of a target's first number in the key by which the target is found again."""
_VALUES_END: Final = NUMBERS + WORDS
"""In a row of all numbers of a target, the place behind its position, orientation and configuration."""
_GROWTH: Final = 40
"""Characters by which the numbers of a target may grow when they are corrected."""
_MAX_COMMON: Final = 8
"""Largest count of numbers that all targets have to share, such as the number of the tool."""


class FullName(NamedTuple):
    """Name of a variable in two parts, as in `P[1] of routine main`."""

    variable: str  # name as the program writes it, with index and field
    owner: str  # routine or file to which the variable belongs; empty for a variable of the whole program


def split_full_name(name: str) -> FullName:
    """Return the variable and the owner of a full name, which `Scope.qualify` puts together."""
    variable, _, owner = name.partition(OF_ROUTINE)
    return FullName(variable, owner)


def get_array_name(name: str) -> str:
    """Return the full name of the array to which an element belongs: `P` for `P[1]`; else the name."""
    return _cut_name(name, "[")


def get_structure_name(name: str) -> str:
    """Return the full name of the structure to which a field belongs: `FP1` for `FP1.TOOL`; else the name."""
    return _cut_name(name, ".")


def get_variable(name: str) -> str:
    """Return the full name of the variable to which an element or a field belongs: `P` for `P[1].UF`."""
    return get_array_name(get_structure_name(name))


def _cut_name(name: str, sign: str) -> str:
    """Return a full name without the text from a sign on; the owner at the end of the name stays.

    `P[1] of routine main`, cut at `[`, becomes `P of routine main`.
    """
    if sign not in name:
        return name
    variable, separator, owner = name.partition(OF_ROUTINE)
    return variable.partition(sign)[0] + separator + owner


def is_without_axes(axes: FloatArray) -> bool:
    """Return whether positions (a,) of external axes are zero, or mean that there is no axis."""
    return bool(((axes > _NO_AXIS) | (np.abs(axes) <= _AXIS_ROUNDING)).all())


class Cause(NamedTuple):
    """Reason why a value is not known, with its line and a remedy."""

    line: int
    reason: str
    remedy: str = WRITE_NUMBERS
    source: int = 0
    shows: str = ""  # name of the frame whose numbers are not known; empty if the value is not a frame


class WrittenNumbers(NamedTuple):
    """Numbers in the text of a program that are the content of a name or the target of a move."""

    label: str  # name that holds the numbers; empty without a name
    source: int  # index of the file
    line: int  # line of the statement
    first: int  # index of the statement's first number among those of the file
    literal: Literal

    def read(self, numerals: Sequence[Numerals]) -> FloatArray:
        """Return the numbers (n,) themselves; `numerals` are all numbers of each file of the program."""
        numbers_of_file = numerals[self.source].values
        indices = self.first + np.array(self.literal.numbers)
        return np.asarray(numbers_of_file[indices])


Frames: TypeAlias = tuple[FrameName | Cause, FrameName | Cause]
"""Base and tool."""


class _TargetRow(NamedTuple):
    """A target as a row of a table."""

    source: int  # index of its file
    line: int  # line on which its numbers begin
    first: int  # index of the first number of its statement among those of the file
    line_of_use: int  # line on which the target is used first
    literal: int  # index of its literal: the meaning of its numbers
    base: int  # index of its base, or _UNKNOWN_FRAME
    tool: int  # index of its tool, or _UNKNOWN_FRAME


class _TargetColumns(NamedTuple):
    """The same numbers of t targets as columns."""

    source: IndexArray  # (t,) indices of their files
    line: IndexArray  # (t,) lines on which their numbers begin
    first: IndexArray  # (t,) index of the first number of each statement among those of the file
    line_of_use: IndexArray  # (t,) lines on which the targets are used first
    literal: IndexArray  # (t,) indices of their literals
    base: IndexArray  # (t,) indices of their bases
    tool: IndexArray  # (t,) indices of their tools


class _TargetTable:
    """Table of targets to which rows are added; an array has the numbers, because long programs have many."""

    def __init__(self) -> None:
        """Begin without targets."""
        self._numbers = array("q")  # rows, one after the other
        self.names: list[str] = []  # full name of each target; empty for a target without a name

    def __len__(self) -> int:
        return len(self.names)

    def append(self, row: _TargetRow, name: str) -> int:
        """Add a target, and return its index."""
        self._numbers.extend(row)
        self.names.append(name)
        return len(self.names) - 1

    def extend(self, columns: _TargetColumns) -> IndexArray:
        """Add k targets without names, and return their indices (k,)."""
        first_index, count = len(self.names), len(columns.line)
        self._numbers.frombytes(np.stack(columns, axis=1).tobytes())
        self.names += [""] * count
        return first_index + np.arange(count)

    def get(self, index: int) -> _TargetRow:
        """Return the row of the target with an index."""
        begin = _TARGET_WIDTH * index
        return _TargetRow(*self._numbers[begin : begin + _TARGET_WIDTH])

    def set_frames(self, index: int, base: int, tool: int) -> None:
        """Change the base and the tool of a target, which are given by their indices."""
        begin = _TARGET_WIDTH * index
        row = self.get(index)._replace(base=base, tool=tool)
        self._numbers[begin : begin + _TARGET_WIDTH] = array("q", row)

    def to_columns(self) -> _TargetColumns:
        """Return the table as columns."""
        return _TargetColumns(*_reshape_rows(self._numbers, _TARGET_WIDTH))


class _MoveTable:
    """Table of moves to which rows are added; arrays have the numbers, because long programs have many."""

    def __init__(self) -> None:
        """Begin without moves."""
        self._numbers = array("q")  # of each move: line, motion, count of visits up to its end
        self._visits = array("q")  # indices of the targets of all moves
        self._feeds = array("d")  # speeds of the tool's centre of all moves [mm/s]; NaN if not known

    @property
    def visit_count(self) -> int:
        """Count of the visits of all moves: a circular move visits two targets, any other move one."""
        return len(self._visits)

    def append(self, line: int, motion: Motion, targets: Sequence[int], feed: float) -> None:
        """Add a move to targets that are given by their indices."""
        self._visits.extend(targets)
        self._numbers.extend((line, _MOTIONS[motion], len(self._visits)))
        self._feeds.append(feed)

    def extend(self, lines: IndexArray, motion: Motion, targets: IndexArray, feeds: FloatArray) -> None:
        """Add k moves with one target each, given by its index; all arguments but the motion are (k,)."""
        ends = len(self._visits) + 1 + np.arange(len(lines))
        columns = np.broadcast_arrays(lines, _MOTIONS[motion], ends)
        self._numbers.frombytes(np.stack(columns, axis=1).tobytes())
        self._visits.frombytes(targets.tobytes())
        self._feeds.frombytes(feeds.tobytes())

    def to_moves(self) -> Moves:
        """Return the moves in the order in which they were added."""
        line, motion, ends = _reshape_rows(self._numbers, _MOVE_WIDTH)
        (visits,) = _reshape_rows(self._visits, 1)
        feeds = np.asarray(memoryview(self._feeds), dtype=np.float64)
        return Moves(line, motion, ends, visits, feeds)


class _FrameTable:
    """Bases and tools, each once, with the numbers by which targets refer to them."""

    def __init__(self) -> None:
        """Begin without frames."""
        # by its role (base or tool), and its name or the bytes of its pose
        self._indices: dict[tuple[str, str | bytes], int] = {}
        self.frames: list[FrameName] = []

    def index_frames(self, frames: Frames | None) -> _FrameIndices:
        """Return the indices of a base and a tool, which are added if they are new."""
        if frames is None:
            return _FrameIndices(_UNKNOWN_FRAME, _UNKNOWN_FRAME)
        base, tool = frames
        return _FrameIndices(self._index_frame("base", base), self._index_frame("tool", tool))

    def _index_frame(self, role: str, frame: FrameName | Cause) -> int:
        """Return the index of a frame, added if new; `_UNKNOWN_FRAME` if the frame is not known.

        `role` is `base` or `tool`. Frames with a pose are the same if their poses are equal, other frames if
        their names are.
        """
        if isinstance(frame, Cause):
            return _UNKNOWN_FRAME
        identity = frame.name if frame.pose is None else frame.pose.tobytes()
        index = self._indices.setdefault((role, identity), len(self.frames))
        is_new = index == len(self.frames)
        if is_new:
            self.frames.append(frame)
        return index


class _FrameIndices(NamedTuple):
    """Base and tool of a target by their numbers in a `_FrameTable`."""

    base: int  # index of the base, or _UNKNOWN_FRAME
    tool: int  # index of the tool, or _UNKNOWN_FRAME


class _LeftMove(NamedTuple):
    """A move that is not corrected."""

    move: ReadMove
    cause: Cause  # why it is not corrected


class _FurtherNumbers(NamedTuple):
    """Numbers of t targets besides position, orientation and configuration; NaN where there is none."""

    axes: FloatArray  # (t, a) positions of external axes and other groups
    common: FloatArray  # (t, c) numbers that all targets have to share, such as that of the tool


class _UncorrectedMoves(NamedTuple):
    """Moves that are not corrected because a target has to keep its numbers, and what others get instead."""

    is_uncorrected: BoolArray  # (k,) mask of the moves that are not corrected
    # by the index of a move, numbers that it may get in place of the names of its targets
    own_numbers: dict[int, list[OwnNumbers]]

    def add_own_numbers(self, of_moves: Mapping[int, OwnNumbers]) -> None:
        """Note numbers that moves may get in place of the name of one more target."""
        for move, own in of_moves.items():
            self.own_numbers[move].append(own)


class _MovesOfTargets:
    """Moves to each target, and targets of each move."""

    def __init__(self, moves: Moves, target_count: int) -> None:
        """Prepare to look up the moves to targets, which have the indices 0 to `target_count` - 1."""
        self._moves = moves
        self._begins = np.append(0, moves.ends[:-1])  # index of the first visit of each move
        # Visits in order of their targets: those of target t are the range from bound t to bound t + 1.
        self._visits_by_target = np.argsort(moves.visits, kind="stable")
        targets_in_order = moves.visits[self._visits_by_target]
        self._bounds = np.searchsorted(targets_in_order, np.arange(target_count + 1))

    def list_moves(self, target: int) -> list[int]:
        """Return the indices of the moves that visit a target, each once."""
        visits = self._visits_by_target[self._bounds[target] : self._bounds[target + 1]]
        return list(dict.fromkeys(self._moves.move_of_visit[visits].tolist()))

    def list_targets(self, move: int) -> list[int]:
        """Return the indices of the targets that a move visits, in its order."""
        targets: list[int] = self._moves.visits[self._begins[move] : self._moves.ends[move]].tolist()
        return targets

    def list_targets_of_moves(self, moves: Iterable[int]) -> Iterator[int]:
        """Yield the indices of the targets that moves visit, in the order of the moves."""
        for move in moves:
            yield from self.list_targets(move)


class Columns:
    """Targets and moves of a program while it is interpreted, and the moves that are left."""

    def __init__(
        self,
        kind: str,
        sources: tuple[Source, ...],
        numerals: Sequence[Numerals],
        language: Language,
        own: Sequence[OwnNumbers] = (),
    ) -> None:
        """Begin without targets and moves.

        Args:
            kind: name of the program's format.
            sources: files of the program.
            numerals: numbers of each file.
            language: language of the format.
            own: numbers that already stand in the first file in place of names of declared targets; the
                declarations stay as they are.
        """
        self._format, self._sources, self._numerals, self._language = kind, sources, numerals, language
        self._own = tuple(own)
        self._own_labels = {numbers.label for numbers in own}  # names of these declared targets
        self.spelled: dict[str, str] = {}  # names as the program writes them
        self._remarks: list[Remark] = []
        self._left: list[_LeftMove] = []  # moves that are not corrected apart from their targets
        self._targets, self._moves, self._frames = _TargetTable(), _MoveTable(), _FrameTable()
        self._target_indices: dict[int, int] = {}  # by the number that `_make_key` makes of a target
        self._literals: dict[Literal, int] = {}  # each with its index
        self._target_causes: dict[int, Cause] = {}  # targets whose numbers have to stay, and why
        self._unfit: set[int] = set()  # those of them whose numbers themselves are the cause
        # base and tool, by index of the target and line, of moves in other frames than the first move
        self._other_frames: dict[tuple[int, int], _FrameIndices] = {}

    def restore_spelling(self, text: str, source: int, line: int) -> str:
        """Return a text with names as the program spells them near a line; quotations are not changed.

        Names in the text may be in capitals, because the language ignores the case of letters.
        """

        def spell(match: re.Match[str]) -> str:
            name_or_quotation = match[0]
            is_quotation = name_or_quotation.startswith("'")
            if self._language.ignores_case and not is_quotation:
                self._find_spelling(name_or_quotation, source, line)
            return self.spelled.get(name_or_quotation, name_or_quotation)

        without_routines = _ENDING.sub("", text)
        return show_text(_NAME_OR_TEXT.sub(spell, without_routines))

    def _find_spelling(self, name: str, source: int, line: int) -> None:
        """Note in `spelled` how the program spells a name: the text of its first occurrence from a line on.

        For `BASE_DATA` and the line `$BASE=Base_Data[3]`, this is `Base_Data`. A name that does not occur
        keeps its letters; a name whose spelling is known already keeps this one.
        """
        if name in self.spelled:
            return
        start = self._sources[source].starts[max(line - 1, 0)]
        following_text = self._sources[source].text[start : start + _SEARCHED_LENGTH]
        spelling = re.search(rf"(?<!\w){name}(?!\w)", following_text, re.IGNORECASE)
        self.spelled[name] = spelling[0] if spelling else name

    def add_remark(self, at: At, text: str, target: str = "") -> None:
        """Note a remark about a statement that is not corrected, and about which the user need not decide.

        Args:
            at: place of the statement.
            text: why the statement is not corrected.
            target: position stored in the controller, if the statement is a move to one.

        Raises:
            ProgramError: the program has more than `MAX_REMARKS` remarks.
        """
        if len(self._remarks) >= MAX_REMARKS:
            reason = f"the program has more than {MAX_REMARKS} lines that cannot be corrected"
            self._refuse(at.line, reason, "split the program")
        self._remarks.append(Remark(at.line, text, target, at.source))

    def _refuse(self, line: int | None, reason: str, remedy: str) -> None:
        """Refuse the whole program.

        Raises:
            ProgramError: always, with this fault.
        """
        raise ProgramError([Fault(self._sources[0].name, line, reason, remedy)])

    def add_move(
        self,
        op: Move,
        line: int,
        targets: Sequence[WrittenNumbers],
        frames: Sequence[Frames],
        cause: Cause | None,
        feed: float,
    ) -> None:
        """Add a move with its targets; if there is a cause, note the move as one that cannot be corrected.

        Args:
            op: the move.
            line: line of the move.
            targets: targets whose numbers are known.
            frames: base and tool of each target.
            cause: why the move cannot be corrected; None if it can be.
            feed: speed of the tool's centre [mm/s]; NaN if it is not known.
        """
        has_too_many_visits = self._moves.visit_count + len(op.targets) > MAX_VISITS
        if has_too_many_visits or len(self._left) > MAX_VISITS:
            self._refuse_visits(line)
        if cause is not None:
            self._add_uncorrected_move(line, targets, frames, cause)
            return
        indices = []
        for target, frames_of_target in zip(targets, frames, strict=True):
            indices.append(self._index_target(target, frames_of_target, line))
        self._moves.append(line, op.motion, indices, feed)

    def _refuse_visits(self, line: int) -> None:
        """Refuse a program whose moves have too many targets; `line` is that of the first move too many.

        Raises:
            ProgramError: always.
        """
        reason = f"the moves of the program have more than {MAX_VISITS} targets"
        self._refuse(line, reason, "split the program")

    def _add_uncorrected_move(
        self, line: int, targets: Sequence[WrittenNumbers], frames: Sequence[Frames], cause: Cause
    ) -> None:
        """Note a move that cannot be corrected for a cause; the numbers of its named targets have to stay.

        Another move may have the target p1 of such a move, too. The declaration of p1 cannot get new numbers,
        because they would shift this move.

        Args:
            line: line of the move.
            targets: targets whose numbers are known.
            frames: base and tool of each target.
            cause: why the move cannot be corrected, with a remedy.
        """
        names = ", ".join(_get_plain_name(target.label) or "in numbers" for target in targets)
        base, tool = "", ""
        if frames:
            base_of_end, tool_of_end = frames[-1]
            base = self.restore_spelling(_get_frame_name(base_of_end), 0, line)
            tool = self.restore_spelling(_get_frame_name(tool_of_end), 0, line)
        reason = self.restore_spelling(cause.reason, cause.source, cause.line or line)
        self._left.append(_LeftMove(ReadMove(line, names, base, tool, reason, cause.remedy), cause))
        for target in targets:
            is_named = bool(target.label)
            if is_named:
                self.keep_numbers(target, cause, line)

    def add_offset(self, target: WrittenNumbers, frames: Frames, line: int) -> None:
        """Note a move that ends at an offset from a target, such as `MoveL Offs(p1,0,0,50),...`.

        The end of this move shifts with a correction of p1, in the same direction if both have the same base
        and tool. There are three cases:

        1. Base or tool of the move are unknown: p1 is not corrected.
        2. They are not those of p1: p1 is not corrected.
        3. They are those of p1: p1 is corrected, and a remark says that the end of the move shifts.

        There is no remark if the declaration of p1 stays as it is, because moves to p1 have copies of its
        numbers, and these are corrected.

        Args:
            target: target from which the offset counts.
            frames: base and tool of the move; a `Cause` in place of a frame says why the frame is unknown.
            line: line of the move.
        """
        for frame in frames:
            if isinstance(frame, Cause):
                self.keep_numbers(target, frame, line)
                return
        self._note_use(target, frames, line)
        declaration_stays = target.label in self._own_labels
        if not declaration_stays:
            self._remark_shift(target.label, line)

    def _note_use(self, target: WrittenNumbers, frames: Frames, line: int) -> None:
        """Note that a line uses a target; if it was used with another base or tool, it cannot be corrected.

        Args:
            target: the target.
            frames: base and tool of this use.
            line: the line.
        """
        self._index_target(target, frames, line)

    def _remark_shift(self, label: str, line: int) -> None:
        """Add a remark that the end of the move on a line shifts with the correction of another target.

        `label` is the full name of this target, from which the end is at an offset.
        """
        name = quote_text(_get_plain_name(label))
        place = f"the move ends at an offset from {name}"
        text = f"{place}, so the end of the move shifts with the correction of {name}"
        self.add_remark(At(line), self.restore_spelling(text, 0, line))

    def add_moves(
        self,
        op: Move,
        source: int,
        lines: IndexArray,
        first: IndexArray,
        frames: Frames,
        feeds: FloatArray,
    ) -> None:
        """Add k moves that differ only in the numbers of their single target, and k targets without names.

        Long programs are mostly such moves: they are added as whole columns, without a loop.

        Args:
            op: the move.
            source: index of their file.
            lines: (k,) lines of the moves.
            first: (k,) index of the first number of each statement among those of the file.
            frames: base and tool of all these moves.
            feeds: (k,) speeds of the tool's centre [mm/s]; NaN where they are not known.
        """
        if len(self._targets) + len(lines) > MAX_TARGETS:
            self._refuse_targets(int(lines[0]))
        if self._moves.visit_count + len(lines) > MAX_VISITS:
            self._refuse_visits(int(lines[0]))
        (literal,) = (target for target in op.targets if isinstance(target, Literal))
        base, tool = self._frames.index_frames(frames)
        # Single numbers are repeated for all targets.
        columns = np.broadcast_arrays(source, lines, first, lines, self._index_literal(literal), base, tool)
        targets = self._targets.extend(_TargetColumns(*columns))
        self._moves.extend(lines, op.motion, targets, feeds)

    def _refuse_targets(self, line: int) -> None:
        """Refuse a program with too many targets; `line` is that of the first target too many.

        Raises:
            ProgramError: always.
        """
        self._refuse(line, f"the program has more than {MAX_TARGETS} targets", _WRITE_ANEW)

    def _index_target(self, target: WrittenNumbers, frames: Frames | None, line_of_use: int) -> int:
        """Return the index of a target among all targets; add the target if its numbers are new.

        Two moves to p1 have one target, because p1 has its numbers once in the text. A target that is used
        with two bases or two tools gets a cause why it cannot be corrected.

        Args:
            target: the target.
            frames: base and tool with which the target is used; None if they are not known.
            line_of_use: line on which the target is used.
        """
        frame_indices = self._frames.index_frames(frames)
        literal = self._index_literal(target.literal)
        key = self._make_key(target, literal)
        index = self._target_indices.get(key)
        if index is None:
            index = self._add_target(target, literal, frame_indices, line_of_use)
            self._target_indices[key] = index
        elif frames is not None:
            self._note_further_use(target, index, frame_indices, line_of_use)
        return index

    def _index_literal(self, literal: Literal) -> int:
        """Return the index of a literal, the meaning of a target's numbers; add the literal if it is new."""
        return self._literals.setdefault(literal, len(self._literals))

    def _add_target(
        self, target: WrittenNumbers, literal: int, frames: _FrameIndices, line_of_use: int
    ) -> int:
        """Add a target at its first use, and return its index.

        Args:
            target: the target.
            literal: index of its literal.
            frames: indices of its base and tool.
            line_of_use: line of the first use.

        Raises:
            ProgramError: the program has too many targets.
        """
        if len(self._targets) >= MAX_TARGETS:
            self._refuse_targets(line_of_use)
        row = _TargetRow(target.source, target.line, target.first, line_of_use, literal, *frames)
        return self._targets.append(row, target.label)

    def _make_key(self, target: WrittenNumbers, literal: int) -> int:
        """Return a number that is the same for the same numbers in the text, read in the same way.

        It packs three indices into one integer, which takes less memory than a tuple: in the lower 40 bits
        that of the target's first number in its file; above them, those of the file and of the literal. In a
        program of 2 files, the number 7 of file 1, read by literal 3, has the key (3 · 2 + 1) · 2⁴⁰ + 7.

        Args:
            target: the target.
            literal: index of its literal, which says what its numbers mean.
        """
        file_and_literal = literal * len(self._sources) + target.source
        return file_and_literal << _KEY_BITS | target.first

    def _note_further_use(
        self, target: WrittenNumbers, index: int, frames: _FrameIndices, line_of_use: int
    ) -> None:
        """Note a further use of a target: with two bases or two tools, the target cannot be corrected.

        The frames become those of the target if they were not known at its first use.

        Args:
            target: the target.
            index: its index.
            frames: indices of the base and the tool of this use.
            line_of_use: line of this use.
        """
        first_use = self._targets.get(index)
        if first_use.base == _UNKNOWN_FRAME:
            self._targets.set_frames(index, frames.base, frames.tool)
        elif frames != (first_use.base, first_use.tool):
            name = quote_text(target.label)
            reason = f"target {name} is used with another base or tool on line {first_use.line_of_use}"
            remedy = "use a separate target for each base and tool: one correction cannot suit both"
            self._target_causes.setdefault(index, Cause(line_of_use, reason, remedy))
            self._other_frames[index, line_of_use] = frames

    def keep_numbers(self, target: WrittenNumbers, cause: Cause, line: int) -> None:
        """Note why the numbers of a target cannot be corrected, and stay as they are; the first cause counts.

        `line` is one on which the target is used.
        """
        index = self._index_target(target, None, line)
        self._target_causes.setdefault(index, cause)

    def settle_targets(self, used: Mapping[str, At], external_axes: ExternalAxes) -> None:
        """Note which targets cannot be corrected, fill the columns of targets and sort the moves.

        From here on no target and no move is added.

        Args:
            used: place of use of each name whose numbers are used for something else than moves.
            external_axes: what the user states on external axes and other groups.
        """
        self._target_indices.clear()  # its memory serves for the columns
        self._keep_used_targets(used)
        self._names = [_get_plain_name(label) if label else "" for label in self._targets.names]
        self._filled = self._fill_targets(external_axes)
        # Routines were interpreted one after the other, so that moves of nested routines are out of order.
        self._sorted = self._moves.to_moves().sort_by_line()
        self._moves_of_targets = _MovesOfTargets(self._sorted, len(self._filled))
        self._name_own_numbers()

    def _keep_used_targets(self, used: Mapping[str, At]) -> None:
        """Note the named targets whose numbers cannot be corrected, because something else uses them, too.

        The line `Grind p1;` uses the numbers of p1 in a way that is not known: corrected numbers might be
        wrong there.

        Args:
            used: by the full name of each variable that is used so, the place of the use.
        """
        copied = {own.label: own for own in self._own}  # by the names of targets
        for index, name in enumerate(self._targets.names):
            if not name:  # the target is numbers in a move: nothing else can use it
                continue
            cause = self._explain_kept_numbers(name, copied, used)
            if cause is not None:
                self._target_causes.setdefault(index, cause)

    def _explain_kept_numbers(
        self, name: str, copied: Mapping[str, OwnNumbers], used: Mapping[str, At]
    ) -> Cause | None:
        """Return why the numbers in the declaration of a target have to stay; None if moves alone use them.

        Args:
            name: full name of the target.
            copied: by the names of targets, a copy of the numbers that a move has in place of the name. Where
                there is one, the copies are corrected, and the declaration is not.
            used: by the names of variables, the place of a use by something else than a move.
        """
        own = copied.get(name)
        if own is not None:
            return Cause(own.line, own.reason, own.remedy)
        at = used.get(name) or used.get(get_array_name(name))
        return None if at is None else self._explain_use(name, at)

    def _explain_use(self, name: str, at: At) -> Cause:
        """Return the cause why a target cannot be corrected: its numbers are used for something else, too.

        The cause has no line: the line of the move to the target takes its place.

        Args:
            name: name of the target.
            at: place of the other use.
        """
        is_in_first_file = at.source == 0
        file = "" if is_in_first_file else f" of {quote_text(self._sources[at.source].name)}"
        use = f"the numbers of {quote_text(name)} are also used on line {at.line}{file}"
        reason = f"{use}, where their meaning is not certain"
        no_line = 0
        return Cause(no_line, reason, "use a separate target on that line")

    def list_own_numbers(self) -> tuple[OwnNumbers, ...]:
        """Return the numbers that moves need in place of the name of a target that cannot be corrected.

        If something else uses the point p1, too, the declaration of p1 has to stay. The move `MoveL p1,...`
        can still be corrected after the numbers of p1 take the place of its name, as in `MoveL
        [[100,0,50],...],...`. The program is then read once more with these numbers, and this reading returns
        no further ones. There are none either if the language cannot state numbers at a move, or if the
        program gets too long.
        """
        is_second_reading = bool(self._own)
        can_state_numbers = bool(self._language.opening)
        if is_second_reading or not can_state_numbers:
            return ()
        moves = self._find_uncorrected_moves(can_replace_names=True)
        found = list[OwnNumbers]()
        for move, own_numbers in moves.own_numbers.items():
            # A move that cannot be corrected for another reason keeps the names of its targets.
            if not moves.is_uncorrected[move]:
                found += own_numbers
        has_too_many_targets = len(self._filled) + len(found) > MAX_TARGETS
        has_too_many_remarks = len(self._remarks) + len(found) > MAX_REMARKS
        return () if has_too_many_targets or has_too_many_remarks else tuple(found)

    def _name_own_numbers(self) -> None:
        """Give each target that has numbers in place of a name this name again, and add a remark to it.

        In a second reading, `MoveL [[100,0,50],...],...` has the numbers of p1 in place of p1: the target is
        p1.
        """
        if not self._own:
            return
        own_of_begin = {own.start: own for own in self._own}  # by the first character in the first file
        for index in np.flatnonzero(self._filled.source == 0).tolist():
            own = own_of_begin.get(self._find_begin_of_target(index))
            if own is None:
                continue
            self._names[index] = own.name
            reason = _name_other_line(own)
            name = quote_text(own.name)
            self.add_remark(At(own.line), f"where the move is corrected, numbers replace {name}: {reason}")

    def _find_begin_of_target(self, index: int) -> int:
        """Return the first character of a target in the first file: that of `{` in `{X 1,Y 2,...}`.

        Only the place of its first number, `1`, is known. The language states which form the text before this
        number has, here `{X `. The result is -1 if the text before it has another form.
        """
        first_number = int(self._filled.spans[index, 0, 0])
        text_before = self._sources[0].text[max(first_number - 100, 0) : first_number]
        opening = re.search(rf"{self._language.opening}\Z", text_before)
        return first_number - len(opening[0]) if opening else -1

    def _find_uncorrected_moves(self, *, can_replace_names: bool) -> _UncorrectedMoves:
        """Find the moves that cannot be corrected because the numbers of a target have to stay.

        If `CIRC P1,P2` cannot be corrected because of P1, then P2 has to stay, too. So all other moves to P2
        cannot be corrected either, and so on.

        Args:
            can_replace_names: whether a move may get numbers in place of the name of a target that has to
                stay. Such a move can be corrected, and does not pass the cause on to its other targets.
        """
        found = _UncorrectedMoves(np.zeros(len(self._sorted), dtype=np.bool_), defaultdict(list))
        kept = set(self._target_causes)  # targets whose numbers have to stay
        to_visit = [*kept]
        while to_visit:
            target = to_visit.pop()
            moves = self._moves_of_targets.list_moves(target)
            copies = self._copy_numbers_to_moves(target, moves) if can_replace_names else {}
            found.add_own_numbers(copies)
            uncorrected = [move for move in moves if move not in copies]
            found.is_uncorrected[uncorrected] = True
            for other in self._moves_of_targets.list_targets_of_moves(uncorrected):
                if other not in kept:
                    kept.add(other)
                    to_visit.append(other)
        return found

    def _copy_numbers_to_moves(self, target: int, moves: Iterable[int]) -> dict[int, OwnNumbers]:
        """Return the numbers that moves get in place of a target's name, by the indices of these moves.

        A move is left out if the numbers cannot take the place of the name there.
        """
        copies = dict[int, OwnNumbers]()
        for move in moves:
            own = self._copy_numbers_to_move(target, move)
            if own is not None:
                copies[move] = own
        return copies

    def _copy_numbers_to_move(self, target: int, move: int) -> OwnNumbers | None:
        """Return the numbers that a move gets in place of a target's name, as the declaration has to stay.

        `MoveL p1,...` gets the numbers `[[100,0,50],...]` of the declaration of p1 in place of the name `p1`.
        Return None if the target has no name; if its numbers cannot be corrected in any place (they are out
        of range, for example); if the declaration or the place of the name in the line is not plain enough to
        copy or to replace; or if the line becomes too long for the controller.

        Args:
            target: index of the target.
            move: index of the move.
        """
        label = self._targets.names[target]
        is_named = bool(label)
        if not is_named or target in self._unfit:
            return None
        line = int(self._sorted.line[move])
        numbers = self._copy_declared_numbers(target)
        place = find_name(self._language, self._sources[0], line, _strip_name(label))
        if numbers is None or place is None or not self._fits_in_line(numbers, move):
            return None
        cause = self._target_causes.get(target, _explain_shared_target(line))
        return self._make_own_numbers(label, line, numbers, place, cause)

    def _copy_declared_numbers(self, target: int) -> str | None:
        """Return the text of the numbers, as in `[[100,0,50],...]`, in the declaration of a target.

        Return None if the text is more than constant numbers. `target` is an index.
        """
        declaring_file = self._sources[self._filled.source[target]]
        first_number = int(self._filled.spans[target, 0, 0])
        return copy_numbers(self._language, declaring_file, first_number)

    def _make_own_numbers(
        self, label: str, line: int, numbers: str, place: NamePlace, cause: Cause
    ) -> OwnNumbers:
        """Return numbers that take the place of a target's name.

        Args:
            label: full name of the target.
            line: line of the move, in the first file.
            numbers: text of the numbers.
            place: place of the name in the first file.
            cause: why the numbers of the declaration have to stay.
        """
        return OwnNumbers(
            start=place.begin,
            end=place.end,
            name=show_text(self._sources[0].text[place.begin : place.end]),
            numbers=numbers,
            line=line,
            label=label,
            reason=self.restore_spelling(cause.reason, cause.source, cause.line or line),
            remedy=cause.remedy,
            other_line=cause.line,
        )

    def _fits_in_line(self, numbers: str, move: int) -> bool:
        """Return whether the line of a move is short enough after numbers replaced the name of each target.

        A line of 40 characters with the targets of `CIRC P1,P2` may have 40 + 2 · (length of `numbers` + 40)
        characters then: the numbers grow, too, when they are corrected.

        Args:
            numbers: text of the numbers that replace a name.
            move: index of the move.
        """
        first_file = self._sources[0]
        line = int(self._sorted.line[move])
        begin_of_visits = self._sorted.ends[move - 1] if move > 0 else 0
        count_of_targets = int(self._sorted.ends[move] - begin_of_visits)
        line_length = int(first_file.ends[line - 1] - first_file.starts[line - 1])
        greatest_length = line_length + count_of_targets * (len(numbers) + _GROWTH)
        return greatest_length <= self._language.longest_line

    def build_program(self, causes: Sequence[Cause]) -> Program:
        """Return the program of the targets and moves, behind `settle_targets`.

        Args:
            causes: causes why statements are not understood.

        Raises:
            ProgramError: no move of the program can be corrected.
        """
        is_uncorrected = self._find_uncorrected_moves(can_replace_names=False).is_uncorrected
        left = self._list_left_moves(is_uncorrected)
        left_moves = tuple(each.move for each in left)
        faults = self._list_faults([each.cause for each in left])
        if is_uncorrected.all():  # or there is no move at all
            reasons = faults if left else self._explain_no_move(causes)
            raise ProgramError(reasons, left=left_moves)
        targets, moves = self._filled, self._sorted
        if left:
            moves, targets = _select_moves(moves, targets, ~is_uncorrected)
        remarks = tuple(sorted(self._remarks, key=lambda remark: remark.line))
        return Program(
            self._format, self._sources, targets, moves, remarks, left_moves, tuple(faults), self._own
        )

    def _explain_no_move(self, causes: Sequence[Cause]) -> list[Fault]:
        """Return why a program has no move: its statements are not understood, or it has no target.

        `causes` are those of statements that are not understood.
        """
        remedy = "send a program with moves to targets given by numbers"
        no_target = Fault(self._sources[0].name, None, "the program has no target", remedy)
        return self._list_faults(causes) or [no_target]

    def _list_faults(self, causes: Sequence[Cause]) -> list[Fault]:
        """Return causes as faults for the user, each fault once, in order of their lines."""
        each_fault_once = dict.fromkeys(map(self._build_fault, causes))
        return sorted(each_fault_once, key=lambda fault: fault.line or 0)

    def _build_fault(self, cause: Cause) -> Fault:
        """Return a cause as a fault for the user, with names as the program spells them."""
        reason = self.restore_spelling(cause.reason, cause.source, cause.line)
        return Fault(self._sources[cause.source].name, cause.line, reason, cause.remedy)

    def _list_left_moves(self, is_uncorrected: BoolArray) -> list[_LeftMove]:
        """Return all moves that are not corrected, in order of their lines.

        There are two kinds. The moves in `_left` were noted with a cause of their own, such as an unknown
        base, and are not among the k moves of the program. The others are those of the k moves with a target
        that has to keep its numbers: `is_uncorrected` (k,) is their mask.
        """
        because_of_targets = map(self._explain_left_move, np.flatnonzero(is_uncorrected).tolist())
        left = [*self._left, *because_of_targets]
        return sorted(left, key=lambda each: each.move.line)

    def _explain_left_move(self, index: int) -> _LeftMove:
        """Return a move that is not corrected because of its targets, with its frames and the cause."""
        line = int(self._sorted.line[index])
        visited = self._moves_of_targets.list_targets(index)
        cause = self._find_cause_of_move(visited, line)
        reason = self.restore_spelling(cause.reason, 0, line)
        if not cause.line:  # it is reported at the line of the move
            cause = Cause(line, reason, cause.remedy)
        end = visited[-1]  # the target at the end of the move
        base, tool = self._find_frames_of_use(end, line)
        move = ReadMove(line, self._filled.names[end], base.name, tool.name, reason, cause.remedy)
        return _LeftMove(move, cause)

    def _find_frames_of_use(self, target: int, line: int) -> tuple[FrameName, FrameName]:
        """Return the base and the tool with which the move on a line uses a target, given by its index."""
        targets = self._filled
        frames_of_target = _FrameIndices(int(targets.base[target]), int(targets.tool[target]))
        base, tool = self._other_frames.get((target, line), frames_of_target)
        return targets.frames[base], targets.frames[tool]

    def _find_cause_of_move(self, visited: Sequence[int], line: int) -> Cause:
        """Return why a move is not corrected: the cause of the first of its targets, by index, that has one.

        If none has a cause, a target of the move is also that of another move that is not corrected.
        """
        for target in visited:
            if target in self._target_causes:
                return self._target_causes[target]
        return _explain_shared_target(line)

    def _fill_targets(self, external_axes: ExternalAxes) -> Targets:
        """Return the targets with their numbers; note those that cannot be corrected because of them.

        `external_axes` is what the user states on external axes and other groups.
        """
        columns = self._targets.to_columns()
        targets = self._make_unread_targets(columns)
        further = self._read_numbers(targets, columns.first)
        self._keep_invalid_targets(targets)
        is_changed = _find_changed_numbers(further.common)
        self._keep_unfit_targets(is_changed, targets.line, _TOOL_CHANGES, _ONE_TABLE_EACH)
        self._keep_displaced_targets(targets, further.axes, external_axes)
        return targets

    def _make_unread_targets(self, columns: _TargetColumns) -> Targets:
        """Return the t targets, whose numbers are not read from the text yet: NaN, with the places −1."""
        count = len(columns.line)
        return Targets(
            names=self._names,
            source=columns.source,
            line=columns.line,
            literal=columns.literal,
            literals=list(self._literals),
            base=columns.base,
            tool=columns.tool,
            frames=self._frames.frames,
            values=np.full((count, _VALUES_END), np.nan),
            spans=np.full((count, _VALUES_END, 2), -1, dtype=np.int32),
        )

    def _read_numbers(self, targets: Targets, first: IndexArray) -> _FurtherNumbers:
        """Fill `values` and `spans` of all targets from the text, and return their further numbers.

        Args:
            targets: t targets, without numbers.
            first: (t,) index of the first number of each target's statement among those of its file.
        """
        literals, count = targets.literals, len(targets)
        of_values = _arrange_ordinals([_list_value_ordinals(each) for each in literals])
        of_axes = _arrange_ordinals([each.external[:_MAX_AXES] for each in literals])
        of_common = _arrange_ordinals([each.common[:_MAX_COMMON] for each in literals])
        axes = np.full((count, of_axes.shape[1]), np.nan)
        common = np.full((count, of_common.shape[1]), np.nan)
        for file, block in _divide_by_file(targets.source):
            statements = _NumbersOfStatements(self._numerals[file], first[block], targets.literal[block])
            targets.values[block] = statements.read(of_values)
            targets.spans[block] = statements.find_places(of_values)
            axes[block] = statements.read(of_axes)
            common[block] = statements.read(of_common)
        axes[axes > _NO_AXIS] = np.nan
        return _FurtherNumbers(axes, common)

    def _keep_invalid_targets(self, targets: Targets) -> None:
        """Note the targets with a number out of range, or an orientation that is not of unit length."""
        is_too_large = np.abs(targets.values[:, :NUMBERS]) > MAX_VALUE
        is_out_of_range = np.asarray(is_too_large.any(axis=1))
        self._keep_unfit_targets(is_out_of_range, targets.line, _OUT_OF_RANGE, _WRITE_ANEW)
        is_no_orientation = np.zeros(len(targets), dtype=np.bool_)
        for notation, indices in targets.group_by_notation(np.arange(len(targets))):
            is_no_orientation[indices] = ~notation.is_valid_orientation(targets.values[indices])
        self._keep_unfit_targets(is_no_orientation, targets.line, _NO_ORIENTATION, _WRITE_ANEW)

    def _keep_displaced_targets(
        self, targets: Targets, axes: FloatArray, external_axes: ExternalAxes
    ) -> None:
        """Note the targets that external axes or other groups of the controller may displace.

        Args:
            targets: t targets.
            axes: (t, a) positions of the external axes; NaN where a target states none.
            external_axes: what the user states on them.
        """
        is_away, is_moved = _find_external_axes(axes, external_axes)
        self._keep_unfit_targets(is_away, targets.line, _AXIS_AWAY, _CARRY_NOTHING)
        has_many_axes = np.array([len(each.external) > _MAX_AXES for each in targets.literals], np.bool_)
        is_moved = is_moved | has_many_axes[targets.literal]  # further axes are not read
        self._keep_unfit_targets(is_moved, targets.line, _AXIS_MOVES, _CARRY_NOTHING)

    def _keep_unfit_targets(self, is_unfit: BoolArray, line: IndexArray, reason: str, remedy: str) -> None:
        """Note the targets whose numbers cannot be corrected, for a reason in these numbers themselves.

        Copies of such numbers, in place of the name of the target, cannot be corrected either.

        Args:
            is_unfit: (t,) mask of the targets.
            line: (t,) line of each target.
            reason: why their numbers stay as they are.
            remedy: what the user can do.
        """
        for index in np.flatnonzero(is_unfit).tolist():
            self._unfit.add(index)
            self._target_causes.setdefault(index, Cause(int(line[index]), reason, remedy))


def _explain_shared_target(line: int) -> Cause:
    """Return the cause that a move, which is not corrected, shares a target with the move on a line."""
    return Cause(line, "a move that is not corrected uses the same target", "use a separate target")


def _divide_by_file(source: IndexArray) -> Iterator[tuple[int, IndexArray]]:
    """Divide targets into blocks of at most `BLOCK`, each of one file.

    Args:
        source: (t,) index of each target's file.

    Yields:
        Index of the file; indices (b,) of the targets in the block.
    """
    for start in range(0, len(source), BLOCK):
        source_of_block = source[start : start + BLOCK]
        for file in np.unique(source_of_block).tolist():
            yield file, start + np.flatnonzero(source_of_block == file)


class _NumbersOfStatements(NamedTuple):
    """Numbers in b statements of a file, to be read by the literals of these statements."""

    numerals: Numerals  # all numbers of the file
    first: IndexArray  # (b,) index of the first number of each statement among those of the file
    literal: IndexArray  # (b,) index of the literal of each statement: the meaning of its numbers

    def read(self, ordinals: IndexArray) -> FloatArray:
        """Return numbers (b, n); NaN for those that a statement does not have.

        `ordinals` (literals, n) say which numbers of a statement these are, by its literal; -1 for none.
        """
        indices = self._find_indices(ordinals)
        return np.where(indices >= 0, self.numerals.values[indices], np.nan)

    def find_places(self, ordinals: IndexArray) -> IndexArray:
        """Return the first and last + 1 character (b, n, 2) of the numbers of `read`; -1 for none."""
        indices = self._find_indices(ordinals)
        places = np.stack([self.numerals.starts[indices], self.numerals.ends[indices]], axis=2)
        return np.where(indices[:, :, None] >= 0, places, -1)

    def _find_indices(self, ordinals: IndexArray) -> IndexArray:
        """Return the index (b, n) of each number among those of the file; -1 for none."""
        ordinals_of_statements = ordinals[self.literal]
        is_written = ordinals_of_statements >= 0
        return np.where(is_written, ordinals_of_statements + self.first[:, None], -1)


def _list_value_ordinals(literal: Literal) -> list[int]:
    """Return the ordinals of position, orientation and configuration among the numbers of a statement.

    The ordinal is the place of a number in the statement, from 0; it is -1 where a target has no such number.
    `{X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 10}` gives 0 to 5 for the pose, then -1, because a pose has room for seven
    numbers (a quaternion needs them), then 6 and 7 for S and T, and -1 in the remaining places.
    """
    numbers = [*literal.numbers, *[-1] * NUMBERS][:NUMBERS]
    configuration = [ordinal for _, ordinal in literal.words]
    return [*numbers, *configuration, *[-1] * WORDS][:_VALUES_END]


def _arrange_ordinals(ordinals: Sequence[Sequence[int]]) -> IndexArray:
    """Return lists of ordinals as rows of an array (count, n), filled with -1 up to the longest list.

    The lists [0, 1, 2] and [4] give the rows [0, 1, 2] and [4, -1, -1]; -1 means that there is no number.
    """
    width = max(map(len, ordinals), default=0)
    rows = np.full((len(ordinals), width), -1)
    for row, ordinals_of_row in zip(rows, ordinals, strict=True):
        row[: len(ordinals_of_row)] = ordinals_of_row
    return rows


def _find_external_axes(axes: FloatArray, external_axes: ExternalAxes) -> tuple[BoolArray, BoolArray]:
    """Find the targets at which external axes may displace the target, from the positions of these axes.

    Which targets these are depends on what the user states:

    1. The axes carry nothing: no target.
    2. They are joints of the robot, whose positions are known: only targets at which they have moved.
    3. Nothing: also targets at which an axis is away from zero.

    Args:
        axes: (t, a) positions of the external axes [mm, °]; NaN where a target states none, which counts as
            away from zero if the axis is away from zero at any target.
        external_axes: what the user states on external axes.

    Returns:
        Mask (t,) of the targets with an axis away from zero; mask (t,) of the targets whose axes have other
        positions than at the first target.
    """
    no_target = np.zeros(len(axes), dtype=np.bool_)
    if external_axes is ExternalAxes.CARRY_NOTHING:
        return no_target, no_target
    positions = np.nan_to_num(axes)
    is_moved = _find_changed_numbers(positions)
    if external_axes is ExternalAxes.OF_ROBOT:
        return no_target, is_moved
    is_stated_away = np.abs(positions) > _AXIS_ROUNDING  # (t, a)
    is_away_anywhere = is_stated_away.any(axis=0)  # (a,)
    may_be_away = np.isnan(axes) & is_away_anywhere  # the target does not state the axis
    is_away = (is_stated_away | may_be_away).any(axis=1)
    return np.asarray(is_away), is_moved


def _find_changed_numbers(numbers: FloatArray) -> BoolArray:
    """Return a mask (t,) of the targets whose numbers (t, k) differ from those of the first target.

    The numbers of the rows 5, 5, 7 and NaN give false, false, true and true: NaN, for a number that a target
    does not state, counts as zero. Differences that rounding explains do not count.
    """
    numbers = np.nan_to_num(numbers)
    is_equal = np.abs(numbers - numbers[:1]) <= _AXIS_ROUNDING
    return np.asarray((~is_equal).any(axis=1), dtype=np.bool_)


def _select_moves(moves: Moves, targets: Targets, selected: BoolArray) -> tuple[Moves, Targets]:
    """Select moves, and the targets that they visit.

    Args:
        moves: k moves.
        targets: targets of all moves.
        selected: (k,) mask of the moves to select.

    Returns:
        The selected moves, whose visits have the new indices of the targets; the targets.
    """
    kept = moves.select(selected)
    used_targets, new_visits = np.unique(kept.visits, return_inverse=True)
    return replace(kept, visits=new_visits), targets.select(used_targets)


def _name_other_line(own: OwnNumbers) -> str:
    """Return why a declared target has to stay, for the remark on a move that has its own numbers instead.

    The reason may end with the line of this move itself, as in `target 'p1' is used with another base or tool
    on line 8` for the move on line 8. Such a remark tells nothing, so that the line of the other use, such as
    5, takes the place of 8.
    """
    names_own_line = own.reason.endswith(f" on line {own.line}")
    if not own.other_line or not names_own_line:
        return own.reason
    beginning = own.reason.removesuffix(str(own.line))
    return f"{beginning}{own.other_line}"


def _get_plain_name(label: str) -> str:
    """Return a name without its routine and its module, as users read it."""
    return show_text(_strip_name(label))


def _strip_name(label: str) -> str:
    """Return a name without its routine and its module."""
    name_in_module = split_full_name(label).variable
    return name_in_module.partition(IN_MODULE)[0]


def _get_frame_name(frame: FrameName | Cause) -> str:
    """Return the name of a frame; for a cause, the name of the frame whose numbers are not known."""
    return frame.shows if isinstance(frame, Cause) else frame.name


def _reshape_rows(rows: array[int], width: int) -> IndexArray:
    """Return the columns (width, count) of rows of `width` numbers that are stored one after the other."""
    return np.asarray(memoryview(rows), dtype=np.intp).reshape(-1, width).T
