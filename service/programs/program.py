"""A robot program: its targets with where their numbers stand, and the same program with other numbers."""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import chain
from typing import TypeAlias

import numpy as np

from jointstiff.service.programs.notation import Notation
from jointstiff.solver.arrays import FloatArray, IndexArray

MOST_BLANKS = 32
"""Blanks before a number that a column is kept with."""
Edit: TypeAlias = tuple[int, int, str]
"""First and last + 1 character, and the text in their place."""
_LINE_END = re.compile(r"\r\n|\n|\r")


class Motion(Enum):
    """Motion of the robot to a target."""

    JOINT = "joint"
    LINEAR = "linear"
    CIRCULAR = "circular"
    SPLINE = "spline"


@dataclass(frozen=True, slots=True)
class Source:
    """A file of a program."""

    name: str  # name of the file
    text: str  # its bytes as Latin-1, which gives every byte back
    starts: tuple[int, ...]  # offset of the first character of each line

    @classmethod
    def of(cls, name: str, content: bytes) -> Source:
        """Take the bytes of a file; lines end as they do in it."""
        text = content.decode("latin-1")
        return cls(name, text, (0, *(end.end() for end in _LINE_END.finditer(text))))

    def lines(self) -> Iterator[tuple[int, int, str]]:
        """Yield the lines: number from 1, offset of the first character, text without its end."""
        for i, start in enumerate(self.starts):
            end = self.starts[i + 1] if i + 1 < len(self.starts) else len(self.text)
            yield i + 1, start, self.text[start:end].rstrip("\r\n")

    def line(self, offset: int) -> int:
        """Return the line of an offset, from 1."""
        return bisect.bisect_right(self.starts, offset)


@dataclass(frozen=True, slots=True, eq=False)
class FrameName:
    """A frame that a program uses: the base of its targets or the tool."""

    name: str  # as the program calls it, `BASE_DATA[2]` or `wobj1`
    # (4, 4) [m] where the program states it: base in R0, tool in the flange; else None
    pose: FloatArray | None = None

    def same(self, other: FrameName) -> bool:
        """Compare name and pose."""
        if self.pose is None or other.pose is None:
            return self.name == other.name and self.pose is other.pose
        return self.name == other.name and bool(np.array_equal(self.pose, other.pose))


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A target: numbers that the program states, of one notation."""

    name: str  # as the program calls it, `P[3]` or `p10`; empty where it has no name
    source: int  # index of its file
    line: int  # line on which its numbers begin, from 1
    notation: Notation  # what the numbers mean
    values: tuple[float, ...]  # the numbers, as written
    spans: tuple[int, ...]  # first and last + 1 character of each number, one after the other
    base: FrameName  # frame of the numbers
    tool: FrameName  # frame that is brought there
    # what is said of the arm's configuration: a name, first and last + 1 character of its number
    words: tuple[tuple[str, int, int], ...] = ()
    letters: str = ""  # what is said of it in letters: FANUC's `NUT`

    def at(self, text: str, spans: tuple[int, ...]) -> Target:
        """Return the target with the numbers that stand at spans of a text."""
        values = tuple([float(text[start:end]) for start, end in zip(spans[::2], spans[1::2], strict=True)])
        return Target(
            self.name,
            self.source,
            self.line,
            self.notation,
            values,
            spans,
            self.base,
            self.tool,
            (),
            self.letters,
        )


@dataclass(frozen=True, slots=True)
class Move:
    """An instruction that moves the robot."""

    line: int  # its line in the first file, from 1
    motion: Motion  # how
    targets: tuple[int, ...]  # indices of its targets, the last one where it ends


@dataclass(frozen=True, slots=True)
class Remark:
    """Something that was left as it is: a line and why."""

    line: int
    text: str


@dataclass(frozen=True, slots=True)
class Program:
    """A program that was understood as a whole."""

    format: str  # name of its format
    sources: tuple[Source, ...]  # its files
    targets: tuple[Target, ...]  # each once, in the order of the files
    moves: tuple[Move, ...]  # in the order of the program's text
    left_alone: tuple[Remark, ...]  # moves and calls that nothing is changed in

    def by_notation(self) -> Mapping[Notation, list[int]]:
        """Return indices of targets by how they are written."""
        by_object: dict[int, list[int]] = {}  # notations are few objects, whose hash costs more than their id
        for i, target in enumerate(self.targets):
            by_object.setdefault(id(target.notation), []).append(i)
        groups: dict[Notation, list[int]] = {}
        for indices in by_object.values():
            groups.setdefault(self.targets[indices[0]].notation, []).extend(indices)
        return groups

    def numbers(self, indices: Sequence[int]) -> FloatArray:
        """Return the numbers (m, k) of targets of one notation, as written."""
        return np.array([self.targets[i].values for i in indices], dtype=float)

    def rewritten(
        self,
        values: Mapping[int, Sequence[float]],
        *,
        aligned: bool = False,
        words: Sequence[tuple[int, Edit]] = (),
    ) -> Program:
        """Return the program with other numbers in targets, by index; every other byte is as it was.

        A number that is the same to the digits it would get keeps its characters. The numbers of the answer
        are read from its text, where they stand now.

        Args:
            values: numbers of targets.
            aligned: take blanks before a number that grows and give them to one that shrinks, so that columns
                stay.
            words: further texts in place of characters, by the index of a target.
        """
        edits: list[list[Edit]] = [[] for _ in self.sources]
        for i, edit in words:
            edits[self.targets[i].source].append(edit)
        for i, new in values.items():
            target = self.targets[i]
            text, of_source, spans = self.sources[target.source].text, edits[target.source], target.spans
            numbers = zip(new, target.values, spans[::2], spans[1::2], target.notation.decimals, strict=True)
            for value, before, start, end, decimals in numbers:
                if value == before:
                    continue
                old = text[start:end]
                number = written(value, before, old, decimals)
                if number != old:
                    of_source.append(_padded(text, start, end, number) if aligned else (start, end, number))
        edited = [_Edited.of(source, changes) for source, changes in zip(self.sources, edits, strict=True)]
        targets = list(self.targets)
        for index, part in enumerate(edited):
            places = [i for i, target in enumerate(self.targets) if target.source == index]
            found = part.places([self.targets[i].spans for i in places])
            for i, spans in zip(places, found, strict=True):
                targets[i] = self.targets[i].at(part.source.text, spans)
        sources = tuple(part.source for part in edited)
        return Program(self.format, sources, tuple(targets), self.moves, self.left_alone)

    @property
    def files(self) -> tuple[bytes, ...]:
        """Bytes of its files."""
        return tuple(source.text.encode("latin-1") for source in self.sources)


def written(value: float, old: float, text: str, decimals: int) -> str:
    """Return a number as text: `text` itself, where `value` is `old` to the digits that it would get."""
    mantissa = text.lower().partition("e")[0]
    decimals = max(decimals, len(mantissa.partition(".")[2]))
    new = f"{value:.{decimals}f}"
    if abs(value - old) < 2.0 * 10.0**-decimals:  # it may be the same to these digits
        usual = f"{old:.{decimals}f}"
        if new == usual or float(new) == float(usual) == 0.0:
            return text
    if new[0] == "-" and float(new) == 0.0:
        new = new.removeprefix("-")
    return f"+{new}" if text[0] == "+" and new[0] != "-" else new


def _padded(text: str, start: int, end: int, number: str) -> tuple[int, int, str]:
    """Keep the last column of a number where it is, as far as the blanks before it allow."""
    blanks = 0
    while blanks < MOST_BLANKS and text[start - blanks - 1 : start - blanks] == " ":
        blanks += 1
    longer = len(number) - (end - start)
    if longer > 0:
        return start - min(longer, max(blanks - 1, 0)), end, number
    return start, end, " " * -longer + number if blanks else number


@dataclass(frozen=True, slots=True, eq=False)
class _Edited:
    """A source after edits, and where its characters went."""

    source: Source  # with the new text
    ends: IndexArray  # (e,) ends of the edits in the old text, ascending
    shift: IndexArray  # (e + 1,) by which characters move that have as many edits before them
    lengths: IndexArray  # (e,) characters of each edit's number

    @classmethod
    def of(cls, source: Source, changes: Sequence[Edit]) -> _Edited:
        """Carry out edits."""
        edits = sorted(changes)
        pieces, done = [], 0
        for start, end, number in edits:
            pieces += [source.text[done:start], number]
            done = end
        pieces.append(source.text[done:])
        grown = [len(number) - (end - start) for start, end, number in edits]
        ends = np.array([end for _, end, _ in edits], dtype=np.intp)
        shift = np.concatenate([[0], np.cumsum(grown)]).astype(np.intp)
        lengths = np.array([len(number.lstrip(" ")) for _, _, number in edits], dtype=np.intp)
        starts = np.array(source.starts, dtype=np.intp)
        starts += shift[np.searchsorted(ends, starts, side="right")]
        return cls(Source(source.name, "".join(pieces), tuple(starts.tolist())), ends, shift, lengths)

    def places(self, spans: Sequence[tuple[int, ...]]) -> Iterator[tuple[int, ...]]:
        """Yield where the numbers of targets went, by the spans of the old text."""
        old = np.fromiter(chain.from_iterable(spans), dtype=np.intp).reshape(-1, 2)
        before = np.searchsorted(self.ends, old[:, 1], side="right")
        length = old[:, 1] - old[:, 0]
        if len(self.ends):
            last = np.maximum(before - 1, 0)
            length = np.where((before > 0) & (self.ends[last] == old[:, 1]), self.lengths[last], length)
        ends = old[:, 1] + self.shift[before]
        flat = np.stack([ends - length, ends], axis=1).ravel().tolist()
        at = 0
        for span in spans:
            yield tuple(flat[at : at + len(span)])
            at += len(span)
