"""The reading of a program: statements in order, what they give, and all that is not understood."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, zip_longest
from typing import Any, Final

import numpy as np

from jointstiff.service.programs.errors import MAX_FAULTS, Fault, ProgramError, shown
from jointstiff.service.programs.notation import Notation
from jointstiff.service.programs.program import FrameName, Motion, Move, Program, Remark, Source, Target
from jointstiff.service.programs.scanner import Cursor, Lexicon, Misread
from jointstiff.solver.arrays import FloatArray

MAX_TARGETS: Final = 200_000
MAX_VISITS: Final = 400_000
"""Targets of all moves together: each is an inverse kinematics, also where moves share a target."""
MAX_REMARKS: Final = 400_000
"""Lines that are left as they are."""
MAX_COUNTED: Final = 10_000
"""Faults after which nothing more is read."""
MAX_VALUE: Final = 1e6
"""Magnitude of a number of a target: a kilometre in mm, 2,777 turns in degrees."""
NO_TARGET: Final = "write its numbers, or leave it out"
_MAX_SHAPES: Final = 10_000
"""Shapes of statements that are remembered."""
_STANDS: Final = 2e-3
"""Difference of an external axis [mm, °] that is rounding."""
_MAX_STATEMENT: Final = 16_384
ALL: Final = -1_000_000
"""Depth of a statement that ends all branches and loops."""
_NO_NAMES: Final[frozenset[str]] = frozenset()


def words(text: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(text.split())


@dataclass(frozen=True, slots=True)
class Literal:
    """Numbers that stand in the text: places among the numbers of their statement."""

    notation: Notation | None  # what they mean; None if they are no whole target
    numbers: tuple[int, ...] = ()  # those of the target
    external: tuple[int, ...] = ()  # external axes; -1 for one that is at zero
    words: tuple[tuple[str, int], ...] = ()  # what is said of the arm's configuration
    letters: str = ""  # the part of it that is said in letters
    fields: Mapping[str, int] = field(default_factory=dict)  # whole numbers by name
    texts: Mapping[str, str] = field(default_factory=dict)  # values that are no numbers, by name


@dataclass(frozen=True, slots=True)
class Statement:
    """Content of a statement; nothing of it depends on its numbers."""

    act: Callable[[Any, Place], object] | None = None  # called with the script, in the order of the text
    gives: tuple[str, Literal] | None = None  # a name and the numbers that it gets
    changes: frozenset[str] = _NO_NAMES  # names that may get other numbers
    calls: frozenset[str] = _NO_NAMES  # routines that it calls
    defines: str = ""  # the routine that begins here
    depth: int = 0  # 1 where a branch or a loop begins, -1 where one ends
    jumps: bool = False  # whether it is a jump, or a place to jump to
    line: int = 0  # lines below the begin of its text


@dataclass(frozen=True, slots=True)
class Place:
    """Place of a statement, and its numbers."""

    source: int  # index of the file
    line: int  # from 1
    text: str  # of the file
    start: int  # first character of the statement
    end: int
    spans: tuple[tuple[int, int], ...]  # of its numbers

    def value(self, ordinal: int) -> float:
        """Return a number."""
        start, end = self.spans[ordinal]
        return float(self.text[start:end])

    def values(self, literal: Literal) -> list[float]:
        """Return the numbers of a target."""
        return [self.value(ordinal) for ordinal in literal.numbers]

    @property
    def quoted(self) -> str:
        """The statement."""
        return self.text[self.start : self.end]


class Reader:
    """Parts of a program that were read so far."""

    def __init__(self, kind: str, sources: tuple[Source, ...], allowed: Collection[str] = ()) -> None:
        """Begin with nothing.

        Args:
            kind: name of the format.
            sources: files of the program.
            allowed: routines that the user says neither move the robot nor change frames, in capitals.
        """
        self.format, self.sources, self.allowed = kind, sources, allowed
        self.faults: list[Fault] = []
        self.moves: list[Move] = []
        self._targets: list[Target] = []
        self._names: dict[str, int] = {}
        self._remarks: list[Remark] = []
        self._count = self._visits = 0

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
            self.refuse(line, f"more than {MAX_REMARKS} lines that are left as they are", "split the program")

    def call(self, line: int, name: str, source: int = 0) -> None:
        """Take a call of a routine that the user vouched for; refuse any other."""
        if name.upper() in self.allowed:
            self.leave(
                line,
                f"{name} is called; the request says that it neither moves the robot nor changes its frames",
            )
            return
        self.refuse(
            line,
            f"{shown(name)} is not known: it may move the robot or change its frames",
            f"if it does neither, name it in `leave_alone`: [{shown(name)}]",
            source,
        )

    def target(
        self,
        name: str,
        place: Place,
        literal: Literal,
        frames: tuple[FrameName, FrameName],
        used: int | None = None,
    ) -> int | None:
        """Add a target, or find it by its name; None where it was refused.

        Args:
            name: as the program calls it; empty for numbers that stand in a move.
            place: where its numbers stand.
            literal: which numbers they are.
            frames: base and tool.
            used: line of the move that uses it, where it is not the target's own.
        """
        if name and name in self._names:
            return self._again(name, used or place.line, frames)
        spans, notation = [place.spans[i] for i in literal.numbers], literal.notation
        text = place.text
        values = tuple([float(text[start:end]) for start, end in spans])
        fault = ""
        if notation is None:
            fault = "the target is not a whole pose or a whole set of angles in numbers"
        elif not (
            min(values) >= -MAX_VALUE and max(values) <= MAX_VALUE
        ):  # nor NaN, which compares with none
            fault = f"a number of a target is out of range, beyond {MAX_VALUE:g}"
        elif not notation.states(values):
            fault = "a quaternion or an axis is not of unit length"
        elif len(self._targets) >= MAX_TARGETS:
            fault = f"more than {MAX_TARGETS} targets"
        if fault or notation is None:
            self.refuse(
                place.line, fault, "write all of its numbers anew, or split the program", place.source
            )
            return None
        words = tuple([(kind, *place.spans[i]) for kind, i in literal.words])
        flat = tuple(chain.from_iterable(spans))
        self._targets.append(
            Target(name, place.source, place.line, notation, values, flat, *frames, words, literal.letters)
        )
        if name:
            self._names[name] = len(self._targets) - 1
        return len(self._targets) - 1

    def _again(self, name: str, line: int, frames: tuple[FrameName, FrameName]) -> int | None:
        known = self._targets[self._names[name]]
        if known.base.same(frames[0]) and known.tool.same(frames[1]):
            return self._names[name]
        self.refuse(
            line,
            f"target {shown(name)} is used with another base or tool than on an earlier line",
            "use a target of its own for each base and tool: one correction cannot serve both",
        )
        return None

    def move(self, line: int, motion: Motion, targets: Sequence[int | None]) -> None:
        """Add a move, if all its targets were understood."""
        known = [t for t in targets if t is not None]
        self._visits += len(known)
        if self._visits > MAX_VISITS:
            self.refuse(line, f"more than {MAX_VISITS} targets of moves", "split the program")
        elif len(known) == len(targets):
            self.moves.append(Move(line, motion, tuple(known)))

    def program(self) -> Program:
        """Return the program.

        Raises:
            ProgramError: any of it was not understood, or it has no target.
        """
        if not self._targets and not self.faults:
            self.refuse(None, "no target was found", "send a program with moves to targets given by numbers")
        if self.faults:
            raise ProgramError(tuple(self.faults), self._count)
        return Program(
            self.format, self.sources, tuple(self._targets), tuple(self.moves), tuple(self._remarks)
        )


Frames = tuple[FrameName, FrameName]


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
    parameters: set[str] = field(default_factory=set)  # of routines
    routines: set[str] = field(default_factory=set)
    jumps: bool = False  # whether the program jumps, or calls its own routines
    calls: int = 0  # of its own routines
    depth: int = 0  # branches and loops that are open
    routine: int = 0  # routines that have begun
    moved: bool = False  # whether the robot has moved, or may have
    jumped: bool = False  # whether a place to jump to, or a jump, came before
    external: tuple[float, ...] | None = None  # where the external axes stand
    _known: dict[str, tuple[Statement, ...]] = field(default_factory=dict)
    _placed: list[tuple[int, int, int, int, tuple[Statement, ...]]] = field(default_factory=list)

    def add(self, source: int, line: int, start: int, end: int) -> None:
        """Parse the text from `start` to `end` of a file, which begins on a line."""
        if end - start > _MAX_STATEMENT:
            self.reader.refuse(
                line, f"a statement of more than {_MAX_STATEMENT} characters", "break it up", source
            )
            return
        text = self.reader.sources[source].text[start:end]
        shape = self.lexicon.shape(text)
        statements = self._known.get(shape)
        if statements is None:
            cursor = Cursor(self.lexicon, text)
            try:
                statements = tuple(self.parse(cursor))
            except Misread as fault:
                where = self.reader.sources[source].line(start + (fault.offset or cursor.begin))
                rest = f": {shown(fault.quoted)}" if fault.quoted.strip() else ""
                reason = f"{shown(text[cursor.begin :])}: {fault.reason}{rest}"
                self.reader.refuse(where, reason, fault.remedy or self.remedy, source)
                return
            if len(self._known) < _MAX_SHAPES:
                self._known[shape] = statements
        if statements:
            self._placed.append((source, line, start, end, statements))

    def run(self) -> None:
        """Collect what all statements say of names and routines, then carry them out in order."""
        self._collect()
        several = [each for each in self._placed if len(each[4]) > 1 or each[4][0].line]
        lines = {each[2] for each in several}
        finditer = self.lexicon.numbers.finditer
        for source, line, start, end, statements in self._placed:
            text = self.reader.sources[source].text
            spans: tuple[tuple[int, int], ...] = ()
            for statement in statements:
                self.depth = max(self.depth + min(statement.depth, 0), 0)
                self.routine += bool(statement.defines)
                self.jumped |= statement.jumps
                here = self.reader.sources[source].line(start) + statement.line if start in lines else line
                for name in sorted(statement.calls):
                    self._called(here, name, source)
                if statement.act is not None:
                    spans = spans or tuple([found.span() for found in finditer(text, start, end)])
                    statement.act(self, Place(source, here, text, start, end, spans))
                self.depth += max(statement.depth, 0)

    def _collect(self) -> None:
        times: Counter[str] = Counter()
        called: Counter[str] = Counter()
        depth = 0
        finditer = self.lexicon.numbers.finditer
        for source, line, start, end, statements in self._placed:
            for statement in statements:
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
                    text = self.reader.sources[source].text
                    spans = tuple([found.span() for found in finditer(text, start, end)])
                    if name not in self.given:
                        self.given[name] = Place(source, line, text, start, end, spans), literal
        self.changed |= {name for name, count in times.items() if count > 1}
        self.calls = sum(count for name, count in called.items() if name in self.routines)
        if self.calls == 1 and self._placed[-1][-1][-1].calls & self.routines:
            self.calls = 0  # the last line starts the program

    def _called(self, line: int, name: str, source: int) -> None:
        if name in self.routines:
            self.moved = True
        else:
            self.reader.call(line, name, source)

    def settable(self, place: Place, what: str) -> bool:
        """Refuse a frame that depends on the way that the program takes."""
        again = self.moved or self.routine > 1
        if self.depth or (again and (self.jumps or self.calls or len(self.routines) > 1)) or self.jumped:
            self.reader.refuse(
                place.line,
                f"{what} changes in a branch, a loop or another routine, or beside a jump or a call",
                "set it once, in the first routine, before its moves, jumps and calls",
                place.source,
            )
            return False
        return True

    def constant(self, name: str, place: Place) -> tuple[Place, Literal] | None:
        """Return where the numbers of a name stand; None if it has none that it keeps, or none yet."""
        known = None if name in self.changed else self.given.get(name)
        if known and self.ordered and known[0].source == place.source and known[0].start >= place.start:
            return None
        return known

    def stands(self, place: Place, line: int, literal: Literal) -> bool:
        """Refuse a target that moves an external axis."""
        values = [place.value(i) if i >= 0 else 0.0 for i in literal.external]
        values = [0.0 if value > _NO_AXIS else value for value in values]
        if self.external is None:
            self.external = tuple(values)
        if values != list(self.external) and any(
            not abs(a - b) <= _STANDS for a, b in zip_longest(values, self.external, fillvalue=0.0)
        ):
            self.reader.refuse(
                line,
                "an external axis moves",
                "only programs that keep the external axes where they are can be corrected",
            )
            return False
        return True

    def targeted(
        self, place: Place, motion: Motion, targets: Sequence[Literal | str], frames: Sequence[Frames]
    ) -> None:
        """Take a move to targets: literals of the statement, or names of numbers given elsewhere."""
        self.moved = True
        found = []
        for target, frame in zip(targets, frames, strict=True):
            name = target if isinstance(target, str) else ""
            known = self.constant(target, place) if isinstance(target, str) else (place, target)
            if known is None:
                self.reader.refuse(
                    place.line, f"the target {shown(name)} is not given by numbers that stay", self.remedy
                )
                return
            where, literal = known
            if not self.stands(where, place.line, literal):
                return
            found.append(self.reader.target(name, where, literal, frame, place.line))
        self.reader.move(place.line, motion, found)


_NO_AXIS: Final = 8e9


def pose_of(place: Place, literal: Literal) -> FloatArray | None:
    """Return the pose (4, 4) [m] of a literal; None if it is none."""
    if literal.notation is None or not literal.notation.has_pose:
        return None
    values = place.values(literal)
    if not (np.abs(values) <= MAX_VALUE).all() or not literal.notation.states(values):
        return None
    return literal.notation.pose(values)
