"""A robot program: its targets, the places of their numbers in the text, and rewriting of the numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from itertools import compress
from typing import Final, NamedTuple

import numpy as np

from robotprograms.arrays import BoolArray, FloatArray, IndexArray
from robotprograms.errors import Fault, ReadMove, decode_text, encode_text
from robotprograms.notation import (
    Edit,
    Notation,
    Places,
    format_new_numbers,
    has_decimal_commas,
    pad_number,
    splice_texts,
)

NUMBERS: Final = 7
"""Largest count of numbers of a target; numbers of the arm's configuration follow them."""
WORDS: Final = 4
"""Largest count of numbers that state the arm's configuration at a target."""
BLOCK: Final = 4096
"""Number of targets that are processed together."""


class Motion(Enum):
    """Motion of the robot to a target."""

    JOINT = "joint"
    LINEAR = "linear"
    CIRCULAR = "circular"
    SPLINE = "spline"


_MOTIONS: Final = tuple(Motion)


class ExternalAxes(Enum):
    """Statement of the user about the external axes and other groups of a program."""

    MAY_CARRY = "may_carry"  # they may carry arm or part: an axis away from zero moves the target
    OF_ROBOT = "of_robot"  # they are joints of the robot's model, and do not move in the program
    CARRY_NOTHING = "carry_nothing"  # they carry neither the arm nor the part


@dataclass(frozen=True, slots=True)
class Source:
    """A file of a program."""

    name: str  # name of the file
    text: str  # its bytes, one character for each
    starts: IndexArray = field(compare=False)  # offset of the first character of each line

    @classmethod
    def from_bytes(cls, name: str, content: bytes) -> Source:
        """Build a source from the bytes of a file, whose lines may end with CR, LF or both."""
        characters = np.frombuffer(content, dtype=np.uint8)
        feed, back = characters == ord("\n"), characters == ord("\r")
        back[:-1] &= ~feed[1:]
        starts = np.concatenate([[0], np.flatnonzero(feed | back) + 1])
        return cls(name, decode_text(content), starts)

    @property
    def ends(self) -> IndexArray:
        """Offset behind the last character of each line, line break included."""
        return np.append(self.starts[1:], len(self.text))

    def find_line(self, offset: int) -> int:
        """Return the number of the line, from 1, that contains the character at an offset."""
        return int(np.searchsorted(self.starts, offset, side="right"))


@dataclass(frozen=True, slots=True, eq=False)
class FrameName:
    """A frame that a program uses: the base of its targets or the tool."""

    name: str  # as the program calls it, `BASE_DATA[2]` or `wobj1`
    # (4, 4) [m] where the program states it: base in R0, tool in the flange; else None
    pose: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Literal:
    """Target or frame written in numbers: indices of its numbers among those of their statement."""

    notation: Notation  # meaning of the numbers
    numbers: tuple[int, ...]  # numbers of the target
    external: tuple[int, ...] = ()  # external axes, and other groups; -1 for one that is not stated
    words: tuple[tuple[str, int], ...] = ()  # names and numbers that state the arm's configuration
    letters: str = ""  # letters of the configuration, such as those of FANUC
    common: tuple[int, ...] = ()  # numbers that all targets have to share, such as that of the tool
    axes_name: str = ""  # name of the variable that holds the external axes; empty if they are no variable


@dataclass(frozen=True, slots=True)
class OwnNumbers:
    """Numbers of a target that take the place of its name at a move, because its declaration has to stay."""

    start: int  # first character of the name, or of the numbers once they are inserted, in the first file
    end: int  # last character + 1
    name: str  # name as the program writes it
    numbers: str  # text of the numbers, as in the declaration
    line: int  # line of the move
    label: str  # name of the target in the intermediate language
    reason: str  # why the declaration has to stay
    remedy: str
    other_line: int  # line of another use of the numbers; 0 if it is not known


@dataclass(frozen=True, eq=False)
class Targets:
    """The t targets of a program as columns, each once, in the order of their first moves."""

    names: Sequence[str]  # names as the program writes them; empty for targets without a name
    source: IndexArray  # (t,) indices of their files
    line: IndexArray  # (t,) lines on which their numbers begin
    literal: IndexArray  # (t,) indices of their literals
    literals: Sequence[Literal]
    base: IndexArray  # (t,) indices of their bases among the frames
    tool: IndexArray  # (t,) indices of their tools among the frames
    frames: Sequence[FrameName]
    # (t, 11) numbers as written, then numbers of the configuration; NaN where the target has fewer numbers
    values: FloatArray
    spans: Places  # (t, 11, 2) first and last + 1 character of each number; −1 where `values` is NaN

    @cached_property
    def notations(self) -> tuple[Notation, ...]:
        """Notations of the targets, each once."""
        return tuple(dict.fromkeys(each.notation for each in self.literals))

    @cached_property
    def notation(self) -> IndexArray:
        """Indices (t,) of the targets' notations among `notations`."""
        notation_of_literal = [self.notations.index(each.notation) for each in self.literals]
        return np.array(notation_of_literal, dtype=np.intp)[self.literal]

    def group_by_notation(self, rows: IndexArray) -> Iterator[tuple[Notation, IndexArray]]:
        """Yield each notation, and the positions in `rows` (indices) of the targets with this notation."""
        notation_of_row = self.notation[rows]
        for i, notation in enumerate(self.notations):
            yield notation, np.flatnonzero(notation_of_row == i)

    @cached_property
    def given_as_joints(self) -> BoolArray:
        """Mask (t,) of the targets whose numbers are joint angles."""
        return np.array([each.is_joints for each in self.notations], dtype=np.bool_)[self.notation]

    @property
    def angle_unit(self) -> FloatArray:
        """Factors (t,) from the units of the targets' angles to rad."""
        return np.array([each.angle for each in self.notations])[self.notation]

    def select(self, rows: IndexArray) -> Targets:
        """Return the targets of these indices (n,), in their order."""
        columns = ("source", "line", "literal", "base", "tool", "values", "spans")
        selected = {name: getattr(self, name)[rows] for name in columns}
        return replace(self, names=[self.names[i] for i in rows.tolist()], **selected)

    def __len__(self) -> int:
        return len(self.line)


@dataclass(frozen=True, eq=False)
class Moves:
    """The k moves of a program as columns, in the order of its text, and the v targets that they visit."""

    line: IndexArray  # (k,) lines in the first file
    motion: IndexArray  # (k,) places among the members of `Motion`
    ends: IndexArray  # (k,) count of the visits up to the end of each move
    visits: IndexArray  # (v,) indices of targets
    # (k,) speeds of the tool's centre [mm/s] that the program states for each move; NaN where it states none,
    # where it is not the same on every path of execution, and for moves of the joints
    feed: FloatArray

    @cached_property
    def move_of_visit(self) -> IndexArray:
        """Index (v,) of the move to which each visit of a target belongs."""
        return np.repeat(np.arange(len(self.ends)), np.diff(self.ends, prepend=0))

    @property
    def is_visit_of_joint_move(self) -> BoolArray:
        """Mask (v,) of the visits of targets that belong to a joint move."""
        return np.asarray(self.motion == _MOTIONS.index(Motion.JOINT))[self.move_of_visit]

    @property
    def is_middle_of_arc(self) -> BoolArray:
        """Mask (v,) of the visits of targets between start and end of a circular move."""
        circular = np.asarray(self.motion == _MOTIONS.index(Motion.CIRCULAR))[self.move_of_visit]
        is_end = np.isin(np.arange(len(self.visits)), self.ends - 1)
        return circular & ~is_end

    def __len__(self) -> int:
        return len(self.line)


class At(NamedTuple):
    """Line of a file."""

    line: int = 0  # from 1; 0 if there is none
    source: int = 0  # index of the file


@dataclass(frozen=True, slots=True)
class Remark:
    """Statement that is not corrected, without need of a decision by the user."""

    line: int
    text: str  # why the statement is not corrected
    target: str = ""  # position stored in the controller, if the statement is a move to one
    source: int = 0  # index of the file


@dataclass(frozen=True, slots=True)
class Program:
    """Program with the moves that can be corrected, and the moves that are left without a correction."""

    format: str  # name of its format
    sources: tuple[Source, ...]  # its files
    targets: Targets
    moves: Moves
    left_alone: tuple[Remark, ...]  # moves and calls that are left without need of a confirmation
    left_moves: tuple[ReadMove, ...] = ()  # moves that cannot be corrected
    faults: tuple[Fault, ...] = ()  # why these moves cannot be corrected
    own_numbers: tuple[OwnNumbers, ...] = ()  # numbers in the first file that take the place of names

    @property
    def common_names(self) -> frozenset[str]:
        """Names in capitals that several targets have because they are own numbers of one declared target."""
        labels: dict[str, set[str]] = {}
        for own in self.own_numbers:
            labels.setdefault(own.name.upper(), set()).add(own.label)
        counts = Counter(each.name.upper() for each in self.own_numbers)
        found = Counter(name.upper() for name in self.targets.names if name.upper() in labels)
        return frozenset(
            name for name, own in labels.items() if len(own) == 1 and found[name] <= counts[name]
        )

    @property
    def files(self) -> tuple[bytes, ...]:
        """Bytes of the program's files."""
        return tuple(encode_text(source.text) for source in self.sources)


class Rewriting:
    """Files of a program while numbers are replaced, block by block in the order of the text.

    A number whose new value is equal to the digits written keeps its characters. Where none of the numbers
    that took the place of a name is replaced, the name comes back. In FANUC's programs, blanks
    before a number are removed or added as the number grows or shrinks, so that columns stay aligned.
    """

    def __init__(self, program: Program) -> None:
        """Prepare to rewrite a program from the beginning of its files."""
        self._targets, self._aligned = program.targets, program.format == "fanuc"
        self._commas = program.format == "csv" and has_decimal_commas(program.sources[0].text)
        self._characters = [np.frombuffer(content, dtype=np.uint8) for content in program.files]
        self._own = program.own_numbers
        # places of these numbers in the first file, and whether some of them are replaced
        self._own_spans = np.array([(each.start, each.end) for each in self._own]).reshape(-1, 2)
        self._is_own_replaced = np.zeros(len(self._own), dtype=np.bool_)
        self._rewritten = [0] * len(self._characters)  # count of characters of each file that are rewritten
        self._pieces: list[list[bytes]] = [[] for _ in self._characters]  # rewritten text of each file
        # fewest decimals of each number of a target, by the index of its notation; filled up with zeros
        digits = [(*each.decimals, 0, 0, 0, 0)[:NUMBERS] for each in self._targets.notations]
        self._digits = np.array(digits)

    def blocks(self, indices: IndexArray) -> Iterator[IndexArray]:
        """Divide targets into blocks that `replace` can write one after the other.

        `indices` are indices of targets. Each yielded array has positions in `indices`, of targets of one
        file in the order of the file's text.
        """
        for source in range(len(self._characters)):
            positions = np.flatnonzero(self._targets.source[indices] == source)
            positions = positions[np.argsort(self._targets.spans[indices[positions], 0, 0], kind="stable")]
            for start in range(0, len(positions), BLOCK):
                yield positions[start : start + BLOCK]

    def replace(
        self, rows: IndexArray, values: FloatArray, words: Sequence[tuple[int, Edit]] = ()
    ) -> FloatArray:
        """Write new numbers of targets into their file.

        Args:
            rows: indices of m targets of one file, behind those that were replaced before.
            values: (m, 7) new numbers; where they are NaN, the text stays as it is.
            words: further edits of the text of these targets, each with the index of its target: numbers of
                the configuration.

        Returns:
            (m, 7) the numbers as they are written.
        """
        source = int(self._targets.source[rows[0]])
        begin, end = self._rewritten[source], int(self._targets.spans[rows].max())
        end = max([end, *self._own_spans[self._find_own(source, np.array([end - 1])), 1].tolist()])
        characters = self._characters[source][begin:end]
        written = self._targets.values[rows, :NUMBERS]
        row, column = np.nonzero(np.isfinite(values) & (values != written))
        spans = self._targets.spans[rows[row], column] - begin
        least = self._digits[self._targets.notation[rows[row]], column]
        texts, differ = format_new_numbers(
            characters, spans, values[row, column], written[row, column], least
        )
        if not differ.all():
            texts, spans = list(compress(texts, differ)), spans[differ]
            row, column = row[differ], column[differ]
        written[row, column] = np.fromiter(map(float, texts), dtype=np.float64, count=len(texts))
        texts = [text.replace(".", ",") for text in texts] if self._commas else texts
        edits = [(start - begin, stop - begin, text) for _, (start, stop, text) in words]
        replaced = begin + np.array([*spans[:, 0].tolist(), *(edit[0] for edit in edits)], dtype=np.intp)
        self._is_own_replaced[self._find_own(source, replaced)] = True
        edits += self._restore_names(source, begin, end)
        if self._aligned:  # edits with blanks take the place of all new numbers
            edits += [pad_number(characters, *edit) for edit in zip(*spans.T.tolist(), texts, strict=True)]
            texts, spans = [], spans[:0]
        if edits:
            spans = np.vstack([spans, np.array([edit[:2] for edit in edits], dtype=np.int32)])
            texts += [edit[2] for edit in edits]
        if (np.diff(spans[:, 0]) < 0).any():
            order = np.argsort(spans[:, 0], kind="stable")
            texts, spans = [texts[i] for i in order.tolist()], spans[order]
        self._pieces[source].append(splice_texts(characters, spans, texts))
        self._rewritten[source] = end
        return written

    def _find_own(self, source: int, places: IndexArray) -> IndexArray:
        """Return the indices of the own numbers, in the first file, in which some places of a file are."""
        if source or not len(self._own):
            return np.zeros(0, dtype=np.intp)
        starts, ends = self._own_spans.T
        found = np.searchsorted(starts, places, side="right") - 1
        return np.unique(found[(found >= 0) & (places < ends[found])])

    def _restore_names(self, source: int, begin: int, end: int) -> list[Edit]:
        """Return the edits of the text between two indices that bring names back where no number changed."""
        if source:
            return []
        starts = self._own_spans[:, 0]
        kept = np.flatnonzero((starts >= begin) & (starts < end) & ~self._is_own_replaced)
        spans = (self._own_spans[kept] - begin).tolist()
        return [(start, stop, self._own[i].name) for (start, stop), i in zip(spans, kept, strict=True)]

    def files(self) -> list[bytes]:
        """Return the bytes of all files, with the numbers that were replaced so far."""
        files = list[bytes]()
        for source, (pieces, characters, count) in enumerate(
            zip(self._pieces, self._characters, self._rewritten, strict=True)
        ):
            names = self._restore_names(source, count, len(characters))
            spans = np.array([edit[:2] for edit in names], dtype=np.int32).reshape(-1, 2)
            rest = splice_texts(characters[count:], spans, [edit[2] for edit in names])
            files.append(b"".join([*pieces, rest]))
        return files
