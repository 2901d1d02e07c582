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
    Characters,
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
        is_line_feed = characters == ord("\n")
        is_line_end = characters == ord("\r")
        is_line_end[:-1] &= ~is_line_feed[1:]  # CR LF is one end of a line
        is_line_end |= is_line_feed
        first_line, further_lines = [0], np.flatnonzero(is_line_end) + 1
        return cls(name, decode_text(content), np.concatenate([first_line, further_lines]))

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
        """Yield each notation, and which targets have it.

        `rows` (m,) are indices of targets. Those with a notation are given by their positions in `rows`.
        """
        notation_of_row = self.notation[rows]
        for index, notation in enumerate(self.notations):
            yield notation, np.flatnonzero(notation_of_row == index)

    @cached_property
    def given_as_joints(self) -> BoolArray:
        """Mask (t,) of the targets whose numbers are joint angles."""
        return np.array([each.is_joints for each in self.notations], dtype=np.bool_)[self.notation]

    @property
    def angle_unit(self) -> FloatArray:
        """Factors (t,) from the units of the targets' angles to rad."""
        return np.array([each.angle for each in self.notations])[self.notation]

    @classmethod
    def from_rows(cls, numbers: FloatArray, notation: Notation) -> Targets:
        """Build the targets of a table that has no text: one for each row of numbers.

        Args:
            numbers: (N, 3 + count) numbers of the poses of the tool `tool` in the base `part`.
            notation: meaning of the numbers.
        """
        count, number_count = numbers.shape
        values = np.full((count, NUMBERS + WORDS), np.nan)
        values[:, :number_count] = numbers
        first_line = 2  # line 1 of a table is its header
        only_index = np.zeros(count, dtype=np.intp)  # of the only file, literal and base
        return cls(
            names=[""] * count,
            source=only_index,
            line=first_line + np.arange(count),
            literal=only_index,
            literals=(Literal(notation, tuple(range(number_count))),),
            base=only_index,
            tool=np.ones(count, dtype=np.intp),
            frames=(FrameName("part"), FrameName("tool")),
            values=values,
            spans=np.full((*values.shape, 2), -1, dtype=np.int32),
        )

    def select(self, rows: IndexArray) -> Targets:
        """Return the targets of these indices (n,), in their order, with the literals and frames of all."""
        return replace(
            self,
            names=[self.names[row] for row in rows.tolist()],
            source=self.source[rows],
            line=self.line[rows],
            literal=self.literal[rows],
            base=self.base[rows],
            tool=self.tool[rows],
            values=self.values[rows],
            spans=self.spans[rows],
        )

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
        return np.repeat(np.arange(len(self.ends)), self.visit_counts)

    @property
    def visit_counts(self) -> IndexArray:
        """Count (k,) of the targets that each move visits."""
        return np.diff(self.ends, prepend=0)

    def sort_by_line(self) -> Moves:
        """Return the moves in order of their lines, with their visits; moves of one line keep their order.

        `CIRC P1,P2` on line 9 and `PTP P3` on line 4, with the visits P1, P2, P3, become the moves on the
        lines 4 and 9 with the visits P3, P1, P2.
        """
        order = np.argsort(self.line, kind="stable")  # old index of each move, in the new order
        new_index = np.empty_like(order)  # new index of each move, in the old order
        new_index[order] = np.arange(len(order))
        order_of_visits = np.argsort(new_index[self.move_of_visit], kind="stable")
        return Moves(
            line=self.line[order],
            motion=self.motion[order],
            ends=np.cumsum(self.visit_counts[order]),
            visits=self.visits[order_of_visits],
            feed=self.feed[order],
        )

    def select(self, selected: BoolArray) -> Moves:
        """Return the moves in a mask (k,); their visits keep the indices of the targets."""
        return Moves(
            line=self.line[selected],
            motion=self.motion[selected],
            ends=np.cumsum(self.visit_counts[selected]),
            visits=self.visits[selected[self.move_of_visit]],
            feed=self.feed[selected],
        )

    @property
    def is_visit_of_joint_move(self) -> BoolArray:
        """Mask (v,) of the visits of targets that belong to a joint move."""
        return np.asarray(self.motion == _MOTIONS.index(Motion.JOINT))[self.move_of_visit]

    @property
    def is_middle_of_arc(self) -> BoolArray:
        """Mask (v,) of the visits at which a circular move passes a target on its way to its end.

        For `PTP P1` and `CIRC P2,P3`, with the visits P1, P2 and P3, these are false, true and false.
        """
        is_circular_move = np.asarray(self.motion == _MOTIONS.index(Motion.CIRCULAR))
        # A move without visits ends where the move before it does; before the first visit, no move ends.
        counts_up_to_end = self.ends[self.ends > 0]
        is_end_of_move = np.zeros(len(self.visits), dtype=np.bool_)
        is_end_of_move[counts_up_to_end - 1] = True
        return is_circular_move[self.move_of_visit] & ~is_end_of_move

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

    @classmethod
    def from_rows(cls, name: str, numbers: FloatArray, notation: Notation) -> Program:
        """Build the program of a table that has no text: a linear move to each row of numbers.

        Args:
            name: name of the table.
            numbers: (N, 3 + count) numbers of the poses of the tool `tool` in the base `part`.
            notation: meaning of the numbers.
        """
        targets = Targets.from_rows(numbers, notation)
        count = len(numbers)
        moves = Moves(
            line=targets.line,
            motion=np.full(count, _MOTIONS.index(Motion.LINEAR)),
            ends=np.arange(count) + 1,
            visits=np.arange(count),
            feed=np.full(count, np.nan),
        )
        return cls("csv", (Source.from_bytes(name, b""),), targets, moves, ())

    @property
    def common_names(self) -> frozenset[str]:
        """Names in capitals that several targets have because they are own numbers of one declared target.

        Own numbers are numbers that a move gets in place of the name of a declared target. If two moves to p1
        have them, both of their targets are named p1, and P1 is in the set. A name is left out if it is that
        of two declared targets (of different routines), or if further targets have the name, too.
        """
        labels_of_name: dict[str, set[str]] = {}  # declared targets by their names in capitals
        for own in self.own_numbers:
            labels_of_name.setdefault(own.name.upper(), set()).add(own.label)
        count_of_own = Counter(own.name.upper() for own in self.own_numbers)
        count_of_targets = Counter(name.upper() for name in self.targets.names)
        common = set[str]()
        for name, labels in labels_of_name.items():
            has_other_targets = count_of_targets[name] > count_of_own[name]
            if len(labels) == 1 and not has_other_targets:
                common.add(name)
        return frozenset(common)

    @property
    def files(self) -> tuple[bytes, ...]:
        """Bytes of the program's files."""
        return tuple(encode_text(source.text) for source in self.sources)


class _Text(NamedTuple):
    """Part of a file that is rewritten at once."""

    of_file: Characters  # characters of the whole file
    begin: int  # first character of the part
    end: int  # last character + 1 of the part

    @property
    def characters(self) -> Characters:
        """Characters of the part."""
        return self.of_file[self.begin : self.end]

    def move_edit(self, edit: Edit) -> Edit:
        """Return an edit whose places in the file are counted from the beginning of the part instead."""
        start, end, text = edit
        return start - self.begin, end - self.begin, text


class _ChangedNumbers(NamedTuple):
    """The c numbers of m targets that get other values."""

    row: IndexArray  # (c,) which of the m targets a number belongs to
    column: IndexArray  # (c,) column of the number, such as 0 for X
    target: IndexArray  # (c,) index of the target in the program
    old: FloatArray  # (c,) values in the text
    new: FloatArray  # (c,) other values, which are not rounded yet


class _NewNumbers(NamedTuple):
    """Texts of changed numbers, as they are written; n of the c changed numbers differ from the old text."""

    differ: BoolArray  # (c,) mask of those that differ after they were rounded
    values: FloatArray  # (n,) their rounded values
    spans: Places  # (n, 2) first and last + 1 character of each of them in the old text
    texts: list[str]  # their texts


class Rewriting:
    """Files of a program while numbers are replaced, block by block in the order of the text.

    A number whose new value is equal to the digits written keeps its characters. Where none of the numbers
    that took the place of a name is replaced, the name comes back. In FANUC's programs, blanks
    before a number are removed or added as the number grows or shrinks, so that columns stay aligned.
    """

    def __init__(self, program: Program) -> None:
        """Prepare to rewrite a program from the beginning of its files."""
        self._targets = program.targets
        self._keeps_columns = program.format == "fanuc"
        self._has_decimal_commas = program.format == "csv" and has_decimal_commas(program.sources[0].text)
        self._characters = [np.frombuffer(content, dtype=np.uint8) for content in program.files]
        # Own numbers stand in the first file in place of names of declared targets.
        self._own = program.own_numbers
        self._own_spans = np.array([(own.start, own.end) for own in self._own]).reshape(-1, 2)
        self._is_own_replaced = np.zeros(len(self._own), dtype=np.bool_)  # whether a number of them changed
        self._rewritten = [0] * len(self._characters)  # count of characters of each file that are rewritten
        self._pieces: list[list[bytes]] = [[] for _ in self._characters]  # rewritten text of each file
        self._digits = _list_decimals(self._targets.notations)

    def blocks(self, indices: IndexArray) -> Iterator[IndexArray]:
        """Divide targets into blocks of at most `BLOCK` that `replace` can write one after the other.

        The targets of a block are in one file, and in the order of the file's text.

        Args:
            indices: (m,) indices of targets of the program.

        Yields:
            (b,) positions in `indices` of the targets of a block.
        """
        file_of_target = self._targets.source[indices]
        first_numbers = self._targets.spans[indices, 0]  # (m, 2) first and last + 1 character
        begin_in_text = first_numbers[:, 0]
        for file in range(len(self._characters)):
            in_file = np.flatnonzero(file_of_target == file)
            in_order = in_file[np.argsort(begin_in_text[in_file], kind="stable")]
            for start in range(0, len(in_order), BLOCK):
                yield in_order[start : start + BLOCK]

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
        text = _Text(self._characters[source], self._rewritten[source], self._find_end(source, rows))
        changed = self._find_changed_numbers(rows, values)
        new = self._format_numbers(text, changed)
        edits = [text.move_edit(edit) for _, edit in words]
        starts = [*new.spans[:, 0].tolist(), *(start for start, _, _ in edits)]
        self._keep_own_numbers(source, text.begin + np.array(starts, dtype=np.intp))
        edits += self._restore_names(source, text.begin, text.end)
        self._pieces[source].append(self._splice(text, new, edits))
        self._rewritten[source] = text.end
        return self._update_numbers(rows, changed, new)

    def _splice(self, text: _Text, new: _NewNumbers, edits: list[Edit]) -> bytes:
        """Return a text with new numbers and with further edits, all counted from the text's beginning.

        Where columns of numbers stay aligned, blanks before a number are removed or added.
        """
        if not self._keeps_columns:
            return splice_texts(text.characters, *_merge_edits(new.spans, new.texts, edits))
        padded = []
        for (start, end), number in zip(new.spans.tolist(), new.texts, strict=True):
            padded.append(pad_number(text.characters, start, end, number))
        no_spans = new.spans[:0]
        return splice_texts(text.characters, *_merge_edits(no_spans, [], [*edits, *padded]))

    def _find_changed_numbers(self, rows: IndexArray, values: FloatArray) -> _ChangedNumbers:
        """Find the numbers of m targets whose new values (m, 7) differ from those in the file.

        `rows` (m,) are the indices of the targets. NaN in place of a value means that the text stays.
        """
        old = self._targets.values[rows, :NUMBERS]
        row, column = np.nonzero(np.isfinite(values) & (values != old))
        return _ChangedNumbers(row, column, target=rows[row], old=old[row, column], new=values[row, column])

    def _format_numbers(self, text: _Text, changed: _ChangedNumbers) -> _NewNumbers:
        """Format changed numbers like the numbers in the text whose places they take."""
        spans = self._targets.spans[changed.target, changed.column] - text.begin
        notation = self._targets.notation[changed.target]
        texts, differ = format_new_numbers(
            text.characters,
            spans,
            new=changed.new,
            old=changed.old,
            digits=self._digits[notation, changed.column],
        )
        changed_texts = list(compress(texts, differ))
        values = np.fromiter(map(float, changed_texts), np.float64, count=len(changed_texts))
        if self._has_decimal_commas:
            changed_texts = [number.replace(".", ",") for number in changed_texts]
        return _NewNumbers(differ, values, spans[differ], changed_texts)

    def _update_numbers(self, rows: IndexArray, changed: _ChangedNumbers, new: _NewNumbers) -> FloatArray:
        """Return the numbers (m, 7) of targets, by index, as they are written now: old ones and new ones."""
        written = self._targets.values[rows, :NUMBERS]
        differ = new.differ
        written[changed.row[differ], changed.column[differ]] = new.values
        return written

    def _keep_own_numbers(self, source: int, places: IndexArray) -> None:
        """Note that the own numbers around some characters of a file stay, because a part of them is new.

        In place of all other own numbers, the name that they replaced comes back.
        """
        self._is_own_replaced[self._find_own(source, places)] = True

    def _find_end(self, source: int, rows: IndexArray) -> int:
        """Return the index of the character behind the last number of some targets of a file.

        If own numbers, which take the place of a name, contain that number, return the index behind them.
        `rows` (m,) are the indices of the targets.
        """
        end = int(self._targets.spans[rows].max())
        own_at_end = self._find_own(source, np.array([end - 1]))
        ends_of_own: list[int] = self._own_spans[own_at_end, 1].tolist()
        return max([end, *ends_of_own])

    def _find_own(self, source: int, places: IndexArray) -> IndexArray:
        """Return the indices of the own numbers that contain some of the characters at `places` of a file.

        Own numbers, in place of the name of a declared target, are in the first file only.
        """
        if source > 0 or len(self._own) == 0:
            return np.zeros(0, dtype=np.intp)
        starts, ends = self._own_spans.T
        index = np.searchsorted(starts, places, side="right") - 1  # the last own numbers that begin before
        is_inside = (index >= 0) & (places < ends[index])
        return np.unique(index[is_inside])

    def _restore_names(self, source: int, begin: int, end: int) -> list[Edit]:
        """Return the edits that put the names of declared targets back in place of unchanged own numbers.

        Own numbers are a copy of a declared target's numbers, which took the place of its name at a move.

        Args:
            source: index of the file.
            begin: first character of the text in the file; the edits count characters from there.
            end: last character + 1 of the text.
        """
        if source > 0:  # own numbers are in the first file only
            return []
        starts = self._own_spans[:, 0]
        is_in_text = (starts >= begin) & (starts < end)
        edits: list[Edit] = []
        for index in np.flatnonzero(is_in_text & ~self._is_own_replaced).tolist():
            start, stop = self._own_spans[index].tolist()
            edits.append((start - begin, stop - begin, self._own[index].name))
        return edits

    def files(self) -> list[bytes]:
        """Return the bytes of all files, with the numbers that were replaced so far.

        The rest of each file, behind the last target that was replaced, keeps its text; own numbers in it,
        which took the place of a name, become the name again.
        """
        files = list[bytes]()
        for source, characters in enumerate(self._characters):
            begin_of_rest = self._rewritten[source]
            names = self._restore_names(source, begin_of_rest, len(characters))
            spans = np.array([(start, stop) for start, stop, _ in names], dtype=np.int32).reshape(-1, 2)
            rest = splice_texts(characters[begin_of_rest:], spans, [name for _, _, name in names])
            files.append(b"".join([*self._pieces[source], rest]))
        return files


def _list_decimals(notations: Sequence[Notation]) -> IndexArray:
    """Return the fewest decimals (notations, 7) of each number of a target; 0 behind the last number."""
    decimals = np.zeros((len(notations), NUMBERS), dtype=np.intp)
    for row, notation in zip(decimals, notations, strict=True):
        row[: len(notation.decimals)] = notation.decimals
    return decimals


def _merge_edits(spans: Places, texts: list[str], edits: list[Edit]) -> tuple[Places, list[str]]:
    """Return spans (n, 2) of characters and their new texts, with further edits, in order of their places.

    New texts at the characters 3–5 and 20–22, and an edit at 8–9, become texts at 3–5, 8–9 and 20–22.

    Args:
        spans: (m, 2) first and last + 1 character of each text that is replaced.
        texts: m new texts.
        edits: further edits, each with its first and last + 1 character and its new text.
    """
    if edits:
        spans_of_edits = np.array([(start, stop) for start, stop, _ in edits], dtype=np.int32)
        spans = np.vstack([spans, spans_of_edits])
        texts = [*texts, *(text for _, _, text in edits)]
    starts = spans[:, 0]
    is_sorted = bool((np.diff(starts) >= 0).all())
    if is_sorted:
        return spans, texts
    order = np.argsort(starts, kind="stable")
    return spans[order], [texts[index] for index in order.tolist()]
