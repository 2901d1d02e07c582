"""Collect what a program says, and all that is not understood, while its text is read."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Final

from jointstiff.service.programs.errors import MAX_FAULTS, Fault, ProgramError, shown
from jointstiff.service.programs.notation import Notation
from jointstiff.service.programs.program import FrameName, Motion, Move, Program, Remark, Source, Target

NUMBER: Final = r"[+-]?(?:\d{1,15}(?:\.\d{0,20})?|\.\d{1,20})(?:[eE][+-]?\d{1,3})?"
NUMBER_PATTERN: Final = re.compile(NUMBER)
MAX_TARGETS: Final = 200_000
MAX_VISITS: Final = 400_000
"""Targets of all moves together: each is an inverse kinematics, also where moves share a target."""
MAX_REMARKS: Final = 400_000
"""Lines that are left as they are."""
MAX_VALUE: Final = 1e6
"""Magnitude of a number of a target: a kilometre in mm, 2,777 turns in degrees."""


def words(text: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(text.split())


def without_comment(text: str, mark: str) -> str:
    """Cut a line off at its comment mark, outside of quotes."""
    if '"' not in text:
        return text.partition(mark)[0]
    quoted = False
    for i, character in enumerate(text):
        quoted ^= character == '"'
        if character == mark and not quoted:
            return text[:i]
    return text


NO_TARGET: Final = "write its numbers, or leave it out"


@dataclass
class Reader:
    """Parts of a program that were read so far."""

    format: str  # name of the format
    sources: tuple[Source, ...]  # files of the program
    # routines that the user says neither move the robot nor change frames, upper case
    allowed: Collection[str] = ()
    _targets: list[Target] = field(default_factory=list)
    _names: dict[str, int] = field(default_factory=dict)
    _moves: list[Move] = field(default_factory=list)
    _remarks: list[Remark] = field(default_factory=list)
    _faults: list[Fault] = field(default_factory=list)
    _count: int = 0
    _visits: int = 0

    def refuse(self, line: int | None, reason: str, remedy: str, source: int = 0) -> None:
        """Note what was not understood; the program is refused when all of it was read."""
        self._count += 1
        if len(self._faults) < MAX_FAULTS:
            self._faults.append(Fault(self.sources[source].name, line, reason, remedy))

    def leave(self, line: int, text: str) -> None:
        """Note what is left as it is."""
        if len(self._remarks) < MAX_REMARKS:
            self._remarks.append(Remark(line, text))
        else:
            self.refuse(line, f"more than {MAX_REMARKS} lines that are left as they are", "split the program")

    def call(self, line: int, name: str) -> None:
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
        )

    def target(
        self,
        name: str,
        place: tuple[int, int],
        notation: Notation,
        numbers: Sequence[tuple[int, int]],
        frames: tuple[FrameName, FrameName],
        branch: str = "",
        used: int | None = None,
    ) -> int | None:
        """Add a target, or find it by its name; None where it was refused.

        Args:
            name: as the program calls it; empty for numbers that stand in a move.
            place: index of the source, and line.
            notation: what the numbers mean.
            numbers: first and last + 1 character of each number.
            frames: base and tool.
            branch: what the format says of the arm's configuration.
            used: line of the move that uses it, where it is not the target's own.
        """
        source, line = place
        if name and name in self._names:
            return self._again(name, used or line, frames)
        text = self.sources[source].text
        values = tuple([float(text[start:end]) for start, end in numbers])
        if not (min(values) >= -MAX_VALUE and max(values) <= MAX_VALUE):  # nor NaN, which compares with none
            self.refuse(
                line,
                "a number of a target is out of range",
                f"give finite numbers up to {MAX_VALUE:g}",
                source,
            )
            return None
        if not notation.states(values):
            self.refuse(
                line, "a quaternion or an axis is not of unit length", "write its numbers anew", source
            )
            return None
        if len(self._targets) >= MAX_TARGETS:
            self.refuse(line, f"more than {MAX_TARGETS} targets", "split the program", source)
            return None
        spans = tuple(chain.from_iterable(numbers))
        self._targets.append(Target(name, source, line, notation, values, spans, *frames, branch))
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
            self._moves.append(Move(line, motion, tuple(known)))

    def program(self) -> Program:
        """Return the program.

        Raises:
            ProgramError: any of it was not understood, or it has no target.
        """
        if not self._targets and not self._faults:
            self.refuse(None, "no target was found", "send a program with moves to targets given by numbers")
        if self._faults:
            raise ProgramError(tuple(self._faults), self._count)
        return Program(
            self.format, self.sources, tuple(self._targets), tuple(self._moves), tuple(self._remarks)
        )
