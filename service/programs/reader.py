"""The reading of a program: statements in order, what they give, and all that is not understood."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import pairwise
from typing import Any, Final

import numpy as np

from jointstiff.service.programs.errors import MAX_FAULTS, Fault, ProgramError, shown
from jointstiff.service.programs.numerals import Numerals
from jointstiff.service.programs.program import (
    BLOCK,
    NUMBERS,
    WORDS,
    FrameName,
    Literal,
    Motion,
    Moves,
    Program,
    Remark,
    Source,
    Targets,
)
from jointstiff.service.programs.scanner import Cursor, Lexicon, Misread, Used
from jointstiff.solver.arrays import FloatArray, IndexArray

MAX_TARGETS: Final = 200_000
MAX_VISITS: Final = 400_000
"""Targets of all moves together: each is an inverse kinematics, also where moves share a target."""
MAX_REMARKS: Final = 400_000
"""Lines that are left as they are."""
MAX_COUNTED: Final = 10_000
"""Faults after which nothing more is read."""
MAX_VALUE: Final = 1e6
"""Magnitude of a number of a target: a kilometre in mm, 2,777 turns in degrees."""
NO_TARGET: Final = "write its numbers, or omit it"
_MAX_SHAPES: Final = 10_000
"""Shapes of statements that are remembered."""
_STANDS: Final = 2e-3
"""Difference of an external axis [mm, °] that is rounding."""
_MAX_STATEMENT: Final = 16_384
ALL: Final = -1_000_000
"""Depth of a statement that ends all branches and loops."""
_NO_NAMES: Final[frozenset[str]] = frozenset()
_NOT_WHOLE: Final = "the target is not a whole pose or a whole set of angles in numbers"
_WRITE_ANEW: Final = "write all of its numbers anew, or split the program"
_NO_AXIS: Final = 8e9
"""Value of an external axis that is none, and more."""
_MAX_AXES: Final = 10
"""Most external axes that are looked at."""
_MOTIONS: Final = {motion: i for i, motion in enumerate(Motion)}
_WIDTH: Final = 7
"""Columns of a target."""
_STATED: Final = NUMBERS + WORDS
Frames = tuple[FrameName, FrameName]
"""Base and tool."""


def words(text: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(text.split())


@dataclass(frozen=True, slots=True)
class Statement:
    """Content of a statement; nothing of it depends on its numbers."""

    act: Callable[[Any, Place], object] | None = None  # called with the script, in the order of the text
    gives: tuple[str, Literal] | None = None  # a name and the numbers that it gets
    changes: frozenset[str] = _NO_NAMES  # names that may get other numbers
    calls: frozenset[str] = _NO_NAMES  # routines that it calls
    defines: str = ""  # the routine that begins here
    depth: int = 0  # 1 where a branch or a loop begins, -1 where one ends
    turns: bool = False  # whether another branch begins here: ELSE, CASE
    jumps: bool = False  # whether it is a jump, or a place to jump to
    line: int = 0  # lines below the begin of its text
    repeats: bool = False  # whether it is a move to numbers of its own, and says nothing else


def used_in(used: Used, *changed: str, act: Callable[[Any, Place], object] | None = None) -> Statement:
    """Return a statement that uses names in expressions, and changes some."""
    return Statement(act, calls=frozenset(used.calls), changes=frozenset(used.passed.union(changed)))


@dataclass(slots=True)
class Place:
    """Place of a statement, and its numbers."""

    source: int  # index of the file
    line: int  # from 1
    start: int  # first character of the statement
    first: int  # place of its first number among those of the file
    numerals: Numerals  # numerals of the file

    def value(self, ordinal: int) -> float:
        """Return a number."""
        return float(self.numerals.values[self.first + ordinal])

    def values(self, literal: Literal) -> FloatArray:
        """Return the numbers of a target."""
        return self.numerals.values[self.first + np.array(literal.numbers, dtype=np.intp)]


class Reader:
    """Parts of a program that were read so far."""

    def __init__(self, kind: str, sources: tuple[Source, ...], allowed: Collection[str] = ()) -> None:
        """Begin with nothing; the user says that no `allowed` routine moves the robot or changes frames."""
        self.format, self.sources, self.allowed = kind, sources, allowed
        self.numerals: list[Numerals] = []  # of each file, once a language has found them
        self.faults: list[Fault] = []
        self._count = 0
        self._remarks: list[Remark] = []
        self._names: dict[str, int] = {}  # targets by name
        self._literals: dict[Literal, int] = {}
        self._seen: dict[int, tuple[int, Literal]] = {}  # literals by identity, with their places
        self._frames: dict[FrameName, int] = {}  # with their places
        self._targets = array("q")  # rows of the columns of `_columns`
        self._target_names: list[str] = []
        self.moves = array("q")  # rows of line, motion, count of visits up to the end
        self._visits = array("q")

    def refuse(self, line: int | None, reason: str, remedy: str = "", source: int = 0) -> None:
        """Note what was not understood; the program is refused when all of it was read.

        Raises:
            ProgramError: so much was not understood that nothing more is read.
        """
        self._count += 1
        if len(self.faults) < MAX_FAULTS:
            self.faults.append(Fault(self.sources[source].name, line, reason, remedy or NO_TARGET))
        if self._count >= MAX_COUNTED:
            raise ProgramError(tuple(self.faults), self._count)

    def leave(self, line: int, text: str) -> None:
        """Note what is left as it is."""
        if len(self._remarks) < MAX_REMARKS:
            self._remarks.append(Remark(line, text))
        else:
            self.refuse(line, f"more than {MAX_REMARKS} lines cannot be corrected", "split the program")

    def call(self, line: int, name: str, source: int = 0) -> None:
        """Take a call of a routine that the user vouched for; refuse any other."""
        if name.upper() in self.allowed:
            self.leave(
                line,
                f"{name} is called; the request states that it neither moves the robot nor changes its "
                "frames",
            )
            return
        self.refuse(
            line,
            f"{shown(name)} is unknown: it may move the robot or change its frames",
            f"if it does neither, name it in `leave_alone`: [{shown(name)}]",
            source,
        )

    def target(self, name: str, place: Place, literal: Literal, frames: Frames, used: int) -> int | None:
        """Add a target that a line has used, or find it by its name; None where it was refused.

        It has no name where its numbers stand in the move.
        """
        index = len(self._target_names)
        if name and self._names.setdefault(name, index) != index:
            return self._again(name, used, frames)
        if literal.notation is None or index >= MAX_TARGETS:
            fault = f"more than {MAX_TARGETS} targets" if literal.notation else _NOT_WHOLE
            self.refuse(place.line, fault, _WRITE_ANEW, place.source)
            return None
        if id(literal) not in self._seen:
            self._seen[id(literal)] = self._literals.setdefault(literal, len(self._literals)), literal
        known = self._seen[id(literal)][0]
        base, tool = (self._frames.setdefault(frame, len(self._frames)) for frame in frames)
        self._targets.extend((place.source, place.line, place.first, used, known, base, tool))
        self._target_names.append(name)
        return index

    def _again(self, name: str, line: int, frames: Frames) -> int | None:
        index, known = self._names[name], list(self._frames)
        stated = [known[self._targets[_WIDTH * index + column]] for column in (5, 6)]
        if all(one.same(other) for one, other in zip(stated, frames, strict=True)):
            return index
        self.refuse(
            line,
            f"target {shown(name)} is used with another base or tool than on an earlier line",
            "use a separate target for each base and tool: one correction cannot suit both",
        )
        return None

    def move(self, line: int, motion: Motion, targets: Sequence[int | None]) -> None:
        """Add a move, if all its targets were understood."""
        if len(self._visits) + len(targets) > MAX_VISITS:
            self.refuse(line, f"more than {MAX_VISITS} targets of moves", "split the program")
        elif None not in targets:
            self._visits.extend(targets)  # type: ignore[arg-type]
            self.moves.extend((line, _MOTIONS[motion], len(self._visits)))

    def repeat(self, lines: IndexArray, first: IndexArray) -> bool:
        """Do the last move, which has targets of its own, again; False if there is no room for all of them.

        Args:
            lines: (k,) its line, then those of the others.
            first: (k,) the places of their first numbers.
        """
        more, end = len(lines) - 1, len(self._visits)
        targets = end - (self.moves[-4] if len(self.moves) > 3 else 0)
        if end + more * targets > min(MAX_TARGETS, MAX_VISITS):
            return False
        rows = np.tile(np.array(self._targets[-_WIDTH * targets :]).reshape(targets, _WIDTH), (more, 1, 1))
        rows[:, :, 2] += (first[1:] - first[0])[:, None]
        rows[:, :, [1, 3]] += (lines[1:] - lines[0])[:, None, None]
        ends = end + targets * np.arange(1, more + 1)
        moves = np.stack([lines[1:], np.full(more, self.moves[-2]), ends], axis=1)
        self._targets.frombytes(rows.tobytes())
        self.moves.frombytes(moves.tobytes())
        self._visits.extend(range(len(self._target_names), len(self._target_names) + more * targets))
        self._target_names += [""] * (more * targets)
        return True

    def program(self) -> Program:
        """Return the program.

        Raises:
            ProgramError: any of it was not understood, or it has no target.
        """
        targets = self._columns()
        if not len(targets) and not self.faults:
            self.refuse(
                None, "the program has no target", "send a program with moves to targets given by numbers"
            )
        if self.faults:
            raise ProgramError(tuple(self.faults), self._count)
        moves = Moves(*_as_columns(self.moves, 3), *_as_columns(self._visits, 1))
        return Program(self.format, self.sources, targets, moves, tuple(self._remarks))

    def _columns(self) -> Targets:
        """Return the targets; refuse those whose numbers are none of a target, or that move external axes."""
        source, line, first, used, known, base, tool = _as_columns(self._targets, _WIDTH)
        literals, count = list(self._literals), len(line)
        ordinals = np.full((len(literals), _STATED + _MAX_AXES), -1)
        for row, each in zip(ordinals, literals, strict=True):
            row[: len(each.numbers)] = each.numbers
            row[NUMBERS : NUMBERS + len(each.words)] = [ordinal for _, ordinal in each.words]
            row[_STATED : _STATED + len(each.external)] = each.external
        targets = Targets(
            self._target_names, source, line, known, literals, base, tool, list(self._frames),
            np.full((count, _STATED), np.nan), np.full((count, _STATED, 2), -1, dtype=np.int32),
        )  # fmt: skip
        out, unlike, moved = np.zeros((3, count), dtype=np.bool_)
        still: FloatArray | None = None
        for file, rows in _blocks(source):
            numerals, at = self.numerals[file], ordinals[known[rows]]
            stands, at = at >= 0, at + first[rows, None]
            at[~stands] = 0
            read = np.where(stands, numerals.values[at], np.nan)
            targets.values[rows] = read[:, :_STATED]
            for i, ends in enumerate((numerals.starts, numerals.ends)):
                targets.spans[rows, :, i] = np.where(stands, ends[at], -1)[:, :_STATED]
            out[rows] = (stands & ~(np.abs(read) <= MAX_VALUE))[:, :NUMBERS].any(axis=1)
            for notation, own in targets.by_notation(rows):
                unlike[rows[own]] = ~notation.states(read[own])
            axes = read[:, _STATED:]
            axes = np.where(np.isnan(axes) | (axes > _NO_AXIS), 0.0, axes)
            still = axes[0] if still is None else still
            moved[rows] = (~(np.abs(axes - still) <= _STANDS)).any(axis=1)
        for faults, lines, reason, remedy in (
            (out, line, f"a number of a target is out of range, beyond {MAX_VALUE:g}", _WRITE_ANEW),
            (unlike, line, "a quaternion or an axis is not of unit length", _WRITE_ANEW),
            (moved, used, "an external axis moves",
             "only programs that do not move the external axes can be corrected"),
        ):  # fmt: skip
            for i in np.flatnonzero(faults).tolist():
                self.refuse(int(lines[i]), reason, remedy, 0 if lines is used else int(source[i]))
        return targets


def _blocks(source: IndexArray) -> Iterator[tuple[int, IndexArray]]:
    """Yield files, that of the first target before the others, and indices of some of their targets."""
    for file in dict.fromkeys(source.tolist()):
        rows = np.flatnonzero(source == file)
        for start in range(0, len(rows), BLOCK):
            yield file, rows[start : start + BLOCK]


def _as_columns(rows: array[int], width: int) -> IndexArray:
    return np.asarray(memoryview(rows), dtype=np.intp).reshape(-1, width).T


@dataclass
class Script:
    """A program as it is carried out, line by line: what holds whatever its language."""

    reader: Reader
    lexicon: Lexicon
    parse: Callable[[Cursor], Iterable[Statement]]
    remedy: str = NO_TARGET  # what to do where a target is not understood
    ordered: bool = True  # whether a name has no numbers before the line that gives them
    given: dict[str, tuple[Place, Literal]] = field(default_factory=dict)  # names of numbers
    changed: set[str] = field(default_factory=set)  # names that do not keep them
    branched: set[str] = field(default_factory=set)  # names that get them in a branch or a loop
    inner: list[tuple[int, str]] = field(default_factory=list)  # those of open ones, with their depths
    left: set[str] = field(default_factory=set)  # those of branches that have ended, or that a jump may skip
    parameters: set[str] = field(default_factory=set)  # parameters of routines
    routines: set[str] = field(default_factory=set)
    jumps: bool = False  # whether the program jumps, or calls its own routines
    calls: int = 0  # calls of its own routines
    depth: int = 0  # branches and loops that are open
    routine: int = 0  # routines that have begun
    moved: bool = False  # whether the robot has moved, or may have
    jumped: bool = False  # whether a place to jump to, or a jump, came before
    _known: dict[str, tuple[Statement, ...]] = field(default_factory=dict)
    _placed: list[_Placed] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Find the numbers of all files."""
        sources, pattern = self.reader.sources, self.lexicon.number
        self.reader.numerals = [Numerals.of(source.text, pattern) for source in sources]

    def add(self, source: int, starts: IndexArray, ends: IndexArray) -> None:
        """Parse parts of a file from `starts` to `ends`."""
        numerals, file = self.reader.numerals[source], self.reader.sources[source]
        lines = np.searchsorted(file.starts, starts, side="right")
        shapes, first = numerals.shapes(starts, ends)
        long = (ends - starts > _MAX_STATEMENT).tolist()
        content: list[tuple[Statement, ...]] = []
        for i, shape in enumerate(shapes):
            statements = self._known.get(shape)
            if statements is None:
                line, text = int(lines[i]), file.text[starts[i] : ends[i]]
                if long[i]:
                    reason = f"a statement of more than {_MAX_STATEMENT} characters"
                    self.reader.refuse(line, reason, "split it", source)
                    statements = ()
                else:
                    statements = self._parsed(source, int(starts[i]), text)
                    if len(self._known) < _MAX_SHAPES and statements is not None:
                        self._known[shape] = statements
            content.append(statements or ())
        rows = np.flatnonzero(np.fromiter(map(bool, content), dtype=np.bool_, count=len(content)))
        kept = [content[i] for i in rows]
        self._placed.append(_Placed(source, lines[rows], starts[rows], first[rows], kept))

    def _parsed(self, source: int, start: int, text: str) -> tuple[Statement, ...] | None:
        """Parse a statement; refuse it by line, and return None, where it is not understood."""
        cursor = Cursor(self.lexicon, text)
        try:
            return tuple(self.parse(cursor))
        except Misread as fault:
            where = self.reader.sources[source].line(start + (fault.offset or cursor.begin))
            rest = f": {shown(fault.quoted)}" if fault.quoted.strip() else ""
            reason = f"{shown(text[cursor.begin :])}: {fault.reason}{rest}"
            self.reader.refuse(where, reason, fault.remedy or self.remedy, source)
            return None

    def run(self) -> None:
        """Collect what all statements say of names and routines, then carry them out in order."""
        self._collect()
        for part in self._placed:
            for i, end in part.runs():
                while i < end:
                    known = len(self.reader.moves)
                    for place, statement in self._at(part, i):
                        self._carry_out(place, statement)
                    again, i = part.statements[i][0].repeats and len(self.reader.moves) > known, i + 1
                    if again and self.reader.repeat(part.lines[i - 1 : end], part.first[i - 1 : end]):
                        break

    def _carry_out(self, place: Place, statement: Statement) -> None:
        self.depth = max(self.depth + min(statement.depth, 0), 0)
        self.routine += bool(statement.defines)
        self.jumped |= statement.jumps
        while self.inner and self.inner[-1][0] > self.depth - statement.turns:
            self.left.add(self.inner.pop()[1])
        if statement.gives is not None and self.jumped:
            self.left.add(statement.gives[0])
        elif statement.gives is not None and self.depth:
            self.inner.append((self.depth, statement.gives[0]))
        for name in sorted(statement.calls):
            if name in self.routines:
                self.moved = True
            else:
                self.reader.call(place.line, name, place.source)
        if statement.act is not None:
            statement.act(self, place)
        self.depth += max(statement.depth, 0)

    def _at(self, part: _Placed, i: int) -> Iterator[tuple[Place, Statement]]:
        """Yield the statements of a place, and where they stand."""
        line, start, first = int(part.lines[i]), int(part.starts[i]), int(part.first[i])
        numerals = self.reader.numerals[part.source]
        for statement in part.statements[i]:
            yield Place(part.source, line + statement.line, start, first, numerals), statement

    def _collect(self) -> None:
        times: Counter[str] = Counter()
        called: Counter[str] = Counter()
        depth = 0
        saying = (
            said
            for part in self._placed
            for begin, end in part.runs()
            if any(map(_says, part.statements[begin]))
            for i in range(begin, end)
            for said in self._at(part, i)
        )
        for place, statement in saying:
            depth = max(depth + statement.depth, 0)
            self.changed |= statement.changes
            self.jumps |= statement.jumps
            if depth:
                self.branched |= statement.changes | ({statement.gives[0]} if statement.gives else set())
            called.update(statement.calls)
            if statement.defines:
                self.routines.add(statement.defines)
                self.parameters |= statement.changes
            if statement.gives is not None:
                name, literal = statement.gives
                times[name] += 1
                self.given.setdefault(name, (place, literal))
        self.changed |= {name for name, count in times.items() if count > 1}
        self.calls = sum(count for name, count in called.items() if name in self.routines)
        last = next((part.statements[-1] for part in reversed(self._placed) if part.statements), None)
        if self.calls == 1 and last and last[-1].calls & self.routines:
            self.calls = 0  # the last line starts the program

    def refuse(self, place: Place, reason: str, remedy: str = "") -> None:
        """Note what was not understood."""
        self.reader.refuse(place.line, reason, remedy or self.remedy, place.source)

    def settable(self, place: Place, what: str) -> bool:
        """Refuse a frame that depends on the way that the program takes."""
        again = self.moved or self.routine > 1
        if self.depth or (again and (self.jumps or self.calls or len(self.routines) > 1)) or self.jumped:
            reason = f"{what} changes in a branch, a loop or another routine, or near a jump or a call"
            self.refuse(place, reason, "set it once, in the first routine, before its moves, jumps and calls")
            return False
        return True

    def constant(self, name: str, place: Place) -> tuple[Place, Literal] | None:
        """Return where the numbers of a name stand; None if it has none that it keeps, or none yet."""
        known = None if name in self.changed else self.given.get(name)
        if known is None or not self.ordered:
            return known
        late = known[0].source == place.source and known[0].start >= place.start
        return None if late or name in self.left else known

    def targeted(
        self, place: Place, motion: Motion, targets: Sequence[Literal | str], frames: Sequence[Frames]
    ) -> None:
        """Take a move to targets: literals of the statement, or names of numbers given elsewhere."""
        self.moved = True
        indices: list[int | None] = []
        for target, frame in zip(targets, frames, strict=True):
            if isinstance(target, Literal):
                indices.append(self.reader.target("", place, target, frame, place.line))
            elif known := self.constant(target, place):
                indices.append(self.reader.target(target, *known, frame, place.line))
            else:
                self.refuse(place, f"the target {shown(target)} is not given by constant numbers")
                return
        self.reader.move(place.line, motion, indices)


def _says(statement: Statement) -> bool:
    """Return whether a statement says something of names, routines or the program's way."""
    effect = statement.gives or statement.changes or statement.calls or statement.defines
    return bool(effect or statement.depth or statement.jumps)


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """The k statements of a file that are understood, one after the other."""

    source: int  # index of the file
    lines: IndexArray  # (k,)
    starts: IndexArray  # (k,) first characters
    first: IndexArray  # (k,) places of their first numbers among those of the file
    statements: list[tuple[Statement, ...]]

    def runs(self) -> Iterator[tuple[int, int]]:
        """Yield first and last + 1 of those that are the same, one after the other."""
        return runs(np.fromiter(map(id, self.statements), dtype=np.int64, count=len(self.statements)))


def runs(numbers: IndexArray) -> Iterator[tuple[int, int]]:
    """Yield first and last + 1 of equal numbers, one after the other."""
    return pairwise(np.flatnonzero(np.diff(numbers, prepend=np.nan, append=np.nan)).tolist())


def pose_of(place: Place, literal: Literal | None) -> FloatArray | None:
    """Return the pose (4, 4) [m] of a literal, the product of several; None if it is none in numbers."""
    notation = None if literal is None else literal.notation
    if literal is None or notation is None or not notation.has_pose:
        return None
    values = place.values(literal).reshape(-1, 3 + notation.count)
    if not (np.abs(values) <= MAX_VALUE).all() or not notation.states(values).all():
        return None
    return np.asarray(reduce(np.matmul, notation.poses(values)))
