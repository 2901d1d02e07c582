"""The header of a table: its place, and the meanings of the columns, each quantity in one unit."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final, Literal

from jointstiff.schemas.imports import ImportOptions
from jointstiff.schemas.robot import MAX_JOINTS
from jointstiff.service.importing import grammar, limits
from jointstiff.service.importing.errors import NOWHERE, Faults, ImportFileError, Place, quote, show_object
from jointstiff.service.importing.grammar import (
    POINTS,
    Dimension,
    Kind,
    Meaning,
    Quantity,
    Vocabulary,
    name_unit,
)
from jointstiff.service.importing.grid import (
    Grid,
    Remark,
    Row,
    count_numbers,
    is_plain_number,
    looks_like_a_number,
)

_MAX_TITLE_ROWS: Final = 20
"""Rows above a header."""
_MAX_HEADER_ROWS: Final = 3
"""Rows of a header: groups, axes, units."""
_MIN_NUMBERS: Final = 3
"""Numbers in a row of data: no table has fewer."""
_NO_UNIT: Final = frozenset("-–/")
"""Cell texts in a row of units that mean that the column has no unit."""
_HEADERLESS: Final = MappingProxyType(
    {
        4: ("name", "x", "y", "z"),
        5: ("group", "point", "x", "y", "z"),
        6: ("collection", "group", "point", "x", "y", "z"),
    }
)
_AXES_AND_WORDS: Final = re.compile(r"(?<![^\W_])(?:[xyz]|[^\W\d_]{2,})(?![^\W_])", re.IGNORECASE)
"""Names of axes, and words, in their order."""
_HEADER_SEPARATORS: Final = (r"\s*[;,\t]\s*", r"\s{2,}", r"\s+(?![\[(])")
"""What may stand between the headers in a comment."""
_DATE_OR_TIME: Final = re.compile(
    r"'?(?:\d{1,4}[./-]\d{1,2}[./-]\d{2,4}(?:[ T,]+\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?)?"
    r"|\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?|[AaPp]\.?[Mm]\.?)(?: ?[AaPp]\.?[Mm]\.?)?'?"
)
"""A date, a time of day, or both."""
_MAX_TIME_COLUMNS: Final = 3
"""Greatest number of columns of a date, a time and its half of the day."""
_LONG_BLANK: Final = re.compile(r"\s{3,}")
"""Three or more blanks, which mean as much as two; the patterns of gaps need quadratic time for them."""


@dataclass(frozen=True)
class Heading:
    """Header of a table: one text for each column, and where the header was found."""

    file: str
    texts: tuple[str, ...]  # text of each column; rows of a header are combined
    lines: tuple[int, ...] = ()  # lines of the header in the file; () if the header is stated or assumed
    start: int = 0  # index of the first row of data
    is_guess: bool = False  # whether the header was combined from rows, taken from a comment, or assumed
    notes: tuple[str, ...] = ()  # what was assumed, in words

    @property
    def columns_are_assumed(self) -> bool:
        """Return whether the file has no header, so that the meanings of its columns were assumed."""
        return self.is_guess and not self.lines

    def place(self, column: int | None = None) -> Place:
        """Return the place of the header in the file, or of its cell with an index."""
        line = self.lines[-1] if self.lines else None
        return Place(self.file, line, None if column is None else column + 1)


def find_heading(grid: Grid, words: Vocabulary, options: ImportOptions) -> Heading:
    """Find the header of a table: the caller's, else in the first rows, else in a comment before the data.

    A table without a header is read as a list of points: `name x y z`, with `group` or `collection group`
    in front.

    Raises:
        ImportFileError: the header is not found, or a text that may be one is not understood.
    """
    if options.header is not None and not _has_known_header(grid, words):
        return Heading(grid.file, tuple(options.header))
    if count_numbers(grid.rows[0]) < _MIN_NUMBERS:
        return _find_header_in_rows(grid, words)
    width = len(grid.rows[0].cells)  # without empty columns at the end
    while width > 1 and not any(any(row.cells[width - 1 :]) for row in grid.rows):
        width -= 1
    return _find_header_in_comments(grid, words, width) or _assume_columns(
        grid, width, by_order=options.by_order
    )


def _has_known_header(grid: Grid, words: Vocabulary) -> bool:
    """Return whether a table begins with a header of its own that is known as a whole."""
    if count_numbers(grid.rows[0]) >= _MIN_NUMBERS:
        return False
    with suppress(ImportFileError):
        texts = [text for text in _find_header_in_rows(grid, words).texts if text]
        return words.count_known(texts) == len(texts)
    return False


# ---- in comments


def _find_header_in_comments(grid: Grid, words: Vocabulary, width: int) -> Heading | None:
    """Return the header in the comments above the data: the last that has `width` known headers.

    None if no comment can be split into that many known headers.

    Raises:
        ImportFileError: a later comment looks like a header, but is not understood.
    """
    comments_above = [comment for comment in grid.comments if comment.line < grid.rows[0].line]
    for comment in reversed(comments_above):
        line, text = comment
        shortened = _LONG_BLANK.sub(lambda blank: "\t\t" if "\t" in blank[0] else "  ", text)
        splits = [tuple(re.split(separator, shortened)) for separator in _HEADER_SEPARATORS]
        for texts in splits:
            if len(texts) == width and words.count_known(texts) == width:
                note = f"the comment in line {line} was used as the header"
                return Heading(grid.file, texts, (line,), is_guess=True, notes=(note,))
        if _looks_like_header(
            comment, width, is_last=comment is comments_above[-1], cell_count=len(splits[0])
        ):
            reason = (
                f"the comment {quote(text)} looks like a header, but is not understood as the header of the "
            )
            remedy = "correct or remove the comment, or give `header`"
            raise ImportFileError(Place(grid.file, line), f"{reason}{width} columns", remedy, "header")
    return None


def _looks_like_header(comment: Remark, width: int, *, is_last: bool, cell_count: int) -> bool:
    """Return whether a comment may be a header that is not understood.

    Such a comment names axes in another order than x, y, z, or has about one word for each column.

    Args:
        comment: comment above the data.
        width: number of columns.
        is_last: whether no other comment follows above the data; only the last may be a mere list of words.
        cell_count: number of cells if the comment is split at delimiters.
    """
    axes_and_words = [word.casefold() for word in _AXES_AND_WORDS.findall(comment.text)]
    axes = "".join(word for word in axes_and_words if len(word) == 1)
    words_after_axes = axes_and_words[axes_and_words.index(axes[-1]) + 1 :] if axes else []
    # Axes in another order than x, y, z, or a column of texts behind the axes, would be read wrongly.
    if len(set(axes)) > 1 and (axes != "xyz" or any(map(grammar.is_key, words_after_axes))):
        return True
    words = re.findall(r"[^\W\d_]+", comment.text)
    has_fitting_words = _MIN_NUMBERS <= len(words) <= width and not any(map(str.isdigit, comment.text))
    return is_last and axes != "xyz" and (has_fitting_words or cell_count == width)


def _count_time_columns(grid: Grid, width: int) -> int:
    """Return how many of the last columns have dates and times, as SpatialAnalyzer writes behind points."""
    count = 0
    while count < _MAX_TIME_COLUMNS and all(
        _DATE_OR_TIME.fullmatch(row.cells[width - 1 - count]) for row in grid.rows if len(row.cells) >= width
    ):
        count += 1
    return count


def _assume_columns(grid: Grid, width: int, *, by_order: bool) -> Heading:
    """Return an assumed heading of a list of points that has no header, chosen by its number of columns.

    Raises:
        ImportFileError: lists of points have another number of columns, or a name looks like a number.
    """
    time_column_count = _count_time_columns(grid, width)
    headers = ("x", "y", "z") if by_order and width == 3 else _HEADERLESS.get(width - time_column_count)
    headers = headers and (*headers, *("time",) * time_column_count)
    if headers is None:
        reason = f"the rows have {width} cells, and there is no header"
        remedy = "add a header such as `name x y z`, or give `header`"
        raise ImportFileError(grid.place(grid.rows[0]), reason, remedy, "header")
    for row in grid.rows:
        for column, cell in enumerate(row.cells[: len(headers) - 3 - time_column_count]):
            is_number = looks_like_a_number(cell) and (column > 0 or not cell.isdigit())
            if grammar.is_key(cell) or is_number:
                reason = f"without a header, the name of a point must be where {quote(cell)} is"
                remedy = f"give rows of {' '.join(headers)}, add a header, or give `header`"
                raise ImportFileError(grid.place(row, column), reason, remedy, "header")
    note = f"no header found; assumed columns: {', '.join(headers)}"
    return Heading(grid.file, headers, is_guess=True, notes=(note,))


# ---- in rows


def _find_header_in_rows(grid: Grid, words: Vocabulary) -> Heading:
    """Return the header among the first rows of a file.

    The first header with known headers only is chosen, else the header with most known headers.

    Raises:
        ImportFileError: no row of data follows, or a row above the header looks like data.
    """
    first_header_row, header_row_count, texts = 0, 1, grid.rows[0].cells
    most_known = 0
    for first_row, row_count, column_texts in _yield_possible_headers(grid, words):
        known_count = words.count_known(column_texts)
        if known_count > most_known:
            first_header_row, header_row_count, texts = first_row, row_count, column_texts
            most_known = known_count
            if known_count == sum(map(bool, texts)) and first_header_row + header_row_count < len(grid.rows):
                break
    if first_header_row + header_row_count == len(grid.rows):
        place = grid.place(grid.rows[first_header_row])
        raise ImportFileError(
            place, "the file has a header but no row of data", "export the file again, with its rows"
        )
    lines = tuple(row.line for row in grid.rows[first_header_row : first_header_row + header_row_count])
    for row in grid.rows[:first_header_row]:
        # A title has at most one number, and few filled cells.
        if count_numbers(row) > 1 or sum(map(bool, row.cells)) > max(2, len(texts) // 2):
            reason = f"the row is above the header in line {lines[0]}, but looks like data"
            raise ImportFileError(grid.place(row), reason, "move the row below the header, or remove the row")
    notes = [f"rows above the header were read as titles: {first_header_row}"] if first_header_row else []
    if header_row_count > 1:
        notes.append(f"the header was combined from rows {', '.join(map(str, lines))}")
    return Heading(
        grid.file, texts, lines, first_header_row + header_row_count, header_row_count > 1, tuple(notes)
    )


def _yield_possible_headers(grid: Grid, words: Vocabulary) -> Iterator[tuple[int, int, tuple[str, ...]]]:
    """Yield (index of the first row, number of rows, text of each column) of each possible header.

    Of the headers that begin in the same row, those with more rows come first.
    """
    rows = grid.rows[: _MAX_TITLE_ROWS + _MAX_HEADER_ROWS + 1]
    for start in range(min(_MAX_TITLE_ROWS + 1, len(rows))):
        if start and count_numbers(rows[start - 1]) >= _MIN_NUMBERS:
            return
        for count in range(min(_MAX_HEADER_ROWS, len(rows) - start), 0, -1):
            texts = _merge_rows([row.cells for row in rows[start : start + count]], words)
            if texts is not None:
                yield start, count, texts


def _merge_rows(rows: Sequence[tuple[str, ...]], words: Vocabulary) -> tuple[str, ...] | None:
    """Combine the rows of a header into one text for each column; None if a row is not part of a header."""
    *above, lower = rows
    if not above:
        return lower
    upper = _merge_rows(above, words)
    if upper is None or sum(map(bool, lower)) < 2 or _is_title(rows[0], words):
        return None
    width = max(len(upper), len(lower))
    upper, lower = (cells + ("",) * (width - len(cells)) for cells in (upper, lower))
    # A lower row of nothing but units is appended to the names above.
    if all(cell in _NO_UNIT or grammar.find_any_unit(cell.strip("[]() ")) for cell in lower if cell):
        return tuple(_append_unit(name, unit) for name, unit in zip(upper, lower, strict=True))
    return _combine_with_groups(upper, lower, words)


def _is_title(row: tuple[str, ...], words: Vocabulary) -> bool:
    """Return whether a row is a title: a single text, in its first cell, that could be the name of a target.

    The text must have no word for a state or joint, and be understood as a target's name above `x`. A row
    with a text that ends in a colon, such as `Operator:`, is a title, too.
    """
    if any(cell.endswith(":") for cell in row):
        return True
    if sum(map(bool, row)) > 1 or not row[0]:
        return False
    parts = grammar.split_unit(row[0])[0].replace("_", " ").split()
    has_known_word = any(grammar.find_state(part, words.states) or grammar.is_joint(part) for part in parts)
    meaning_as_group = words.find(f"{row[0]} x")
    return (
        not has_known_word and meaning_as_group is not None and meaning_as_group.quantity.target is not None
    )


def _combine_with_groups(
    upper: Sequence[str], lower: Sequence[str], words: Vocabulary
) -> tuple[str, ...] | None:
    """Combine a row of groups with the row below it, cell by cell; None if a lower cell is a number.

    A group holds for its column and for the filled columns to its right: `P10 loaded [mm]` above `x`, `y`
    gives `P10 loaded x [mm]` and `P10 loaded y [mm]`. A cell that is a header by itself, such as `label`, is
    not combined with a group to its left.
    """
    texts, group = [], ""
    for upper_cell, lower_cell in zip(upper, lower, strict=True):
        group = upper_cell or (group if lower_cell else "")
        if looks_like_a_number(lower_cell) and not (lower_cell.isdigit() and grammar.is_joint(group)):
            return None
        if not group or not lower_cell:
            texts.append(upper_cell or lower_cell)
            group = group if lower_cell else ""
            continue
        name, unit = grammar.split_unit(group)
        joined = f"{group} {lower_cell}"
        if unit is not None and grammar.split_unit(lower_cell)[1] in (None, unit):
            joined = _append_unit(f"{name} {lower_cell}", unit)
        own_meaning = words.find(lower_cell)
        needs_group = own_meaning is None or (
            own_meaning.kind in POINTS and own_meaning.quantity.target is None
        )
        # A header above another, or its unit, may contradict it; other texts are titles of groups.
        own_unit = grammar.split_unit(lower_cell)[1]
        may_contradict = (
            (bool(upper_cell) and words.find(upper_cell) is not None)
            or grammar.find_any_unit(group) is not None
            or (unit is not None and own_unit is not None and not _are_same_unit(unit, own_unit))
            or (
                own_meaning is not None
                and own_meaning.kind in POINTS
                and grammar.contains_state_word(upper_cell, words.states)
            )
        )
        if may_contradict or needs_group or words.find(joined) is not None:
            texts.append(joined)
        else:  # the group is a title of its columns, perhaps with their unit
            texts.append(lower_cell if unit is None else _append_unit(lower_cell, unit))
    return tuple(texts)


def _are_same_unit(first: str, second: str) -> bool:
    """Return whether two texts are the same known unit."""
    known = grammar.find_any_unit(first)
    return known is not None and known == grammar.find_any_unit(second)


def _append_unit(name: str, unit: str) -> str:
    """Return a header with a unit in brackets; the unit is not added if it is empty or present already."""
    unit = unit.strip("[]() ")
    if not unit or unit in _NO_UNIT or grammar.split_unit(name)[1] == unit:
        return name
    return f"{name} [{unit}]"


# ---- columns of the header: each column alone, then all together

_MAY_REPEAT: Final[frozenset[Kind]] = frozenset(("time", "ignored"))
_MAX_SINGLE_FAULTS, _HEADERS_PER_FAULT = 3, 4
"""Number of unknown headers that are reported one by one; of more, headers in one message, which is cut
beyond 300 characters."""
_NAME_COLUMNS: Final = ("name", "collection", "group")
"""Columns whose texts may say a state."""
_QUATERNIONS: Final = (("q0", "q1", "q2", "q3"), ("q1", "q2", "q3", "q4"), ("q0", "qx", "qy", "qz"))
_UNIT_NORM: Final = 0.01
"""How far the squares of a rounded quaternion may add up from 1."""
_TARGET_AND_STATE: Final[tuple[Literal["target", "state"], ...]] = ("target", "state")
"""What headers of positions may name."""
_AXIS_LETTER: Final = re.compile(r"(?<![^\W_])[xyzXYZ](?![^\W_])")
_TARGET_WITH_WORD: Final = (
    re.compile(r"(?P<target>.*[^\s_-])[\s_-]+(?P<word>[^\s_-]+)"),
    re.compile(r"(?P<word>[^\s_-]+)[\s_-]+(?P<target>[^\s_-].*)"),
)
"""A target's name with a word behind it, or before it."""
_MOST_UNNAMED: Final = 3
"""Most headers that a message lists of columns that do not name their target or state."""
_EXAMPLE_UNITS: Final[Mapping[Dimension, str]] = {
    "length": "mm",
    "angle": "deg",
    "force": "N",
    "moment": "N.m",
}


@dataclass(frozen=True)
class Columns:
    """All columns of a table."""

    meanings: tuple[Meaning, ...]  # meaning of each column, with its unit
    texts: Mapping[Kind, int]  # index of the first column of each kind; used for kinds of texts only
    # indices of the columns of each quantity, in order of joints or axes
    quantities: Mapping[Quantity, tuple[int, ...]]
    # units by dimension, for all that occur; moments without a unit are in the unit of force times m
    units: Mapping[Dimension, str]
    notes: tuple[str, ...] = ()  # what was assumed, in words
    probe: bool = False  # whether `target` may be the instrument's reflector instead of a target
    faulty: bool = False  # whether a header is not understood, or the columns do not fit together

    @property
    def needed(self) -> frozenset[str]:
        """Kinds `target` or `state` that names of points must give, as neither headers nor columns do."""
        positions = [quantity for quantity in self.quantities if quantity.kind == "position"]
        not_in_headers = [
            kind
            for kind in _TARGET_AND_STATE
            if any(getattr(quantity, kind) is None for quantity in positions)
        ]
        return frozenset(not_in_headers) - self.texts.keys()

    @property
    def whole(self) -> bool:
        """Return whether each row holds a whole observation, with all targets and states."""
        return not self.needed and not {"target", "state"} & self.texts.keys()


def _find_state_words(points: Sequence[Quantity]) -> tuple[str, ...]:
    """Return the words in names of targets without a state, next to a name that occurs with a state.

    With `SMR1 leer x` and `SMR1 unloaded x` the word is `leer`.
    """
    with_state = {quantity.target for quantity in points if quantity.state is not None}
    words: dict[str, None] = {}  # an ordered set
    for quantity in points:
        if quantity.state is not None:
            continue
        for pattern in _TARGET_WITH_WORD:
            match = pattern.fullmatch(quantity.target or "")
            if match is not None and match["target"] in with_state:
                words[match["word"]] = None
    return tuple(words)


class ColumnReader:
    """Reader of the columns of a table; headers that are not understood are reported as faults."""

    def __init__(
        self, heading: Heading, rows: Sequence[Row], words: Vocabulary, options: ImportOptions, faults: Faults
    ) -> None:
        """Prepare to read columns; the rows of data are as long as the header."""
        self._heading, self._headers, self._rows = heading, heading.texts, rows
        self._words, self._options, self._faults = words, options, faults
        self._notes: list[str] = []

    def understand(self, axes_unit: str | None, *, state_in_name: bool) -> Columns:
        """Return the columns with their meanings, `unknown` for a header that is not understood.

        Args:
            axes_unit: unit of x, y and z that a comment of the file states; None without such a comment.
            state_in_name: whether the name of the file has a word for a state.
        """
        fault_count = len(self._faults.found)
        rotation = self._find_quaternion()
        meanings = self._understand_headers(rotation)
        kinds = {meaning.kind for meaning in meanings}
        if "name" not in kinds and kinds & {"collection", "group"}:  # a target of a group is a point
            meanings = [
                Meaning(Quantity("name")) if meaning.kind == "target" else meaning for meaning in meanings
            ]
        name_columns = [column for column, meaning in enumerate(meanings) if meaning.kind in _NAME_COLUMNS]
        cells = (row.cells[column] for row in self._rows for column in name_columns)
        template_gives_state = "{state}" in f"{self._options.point_name} {self._options.file_name}"
        names_give_state = state_in_name or any(
            grammar.contains_state_word(cell, self._words.states) for cell in cells
        )
        if not ("state" in kinds or template_gives_state or names_give_state):  # nothing else says the state
            meanings = self._recognise_states(meanings)
        meanings_with_units = self._resolve_units(meanings, axes_unit)
        text_columns: dict[Kind, int] = {}
        for index, meaning in enumerate(meanings):
            text_columns.setdefault(meaning.kind, index)
        quantities: dict[Quantity, tuple[int, ...]] = {}
        if "unknown" not in kinds:
            quantities = self._group_by_quantity(meanings)
            self._check_names_and_loads(text_columns, quantities)
            self._check_points(text_columns, quantities)
        with_numbers = [meaning for meaning in meanings_with_units if meaning.axis is not None]
        return Columns(
            tuple(meanings_with_units),
            text_columns,
            quantities,
            {
                meaning.dimension: meaning.unit
                for meaning in with_numbers
                if meaning.dimension and meaning.unit is not None
            },
            tuple(self._notes),
            probe=bool(rotation) or bool(kinds & {"deleted", "uncertainty"}),
            faulty="unknown" in kinds or len(self._faults.found) > fault_count,
        )

    def _find_quaternion(self) -> list[int]:
        """Return the indices of the columns of a quaternion, Q0 to Q3 or Q1 to Q4; [] without a quaternion.

        The squares of a quaternion add up to 1 in each row, or are all 0. Columns with a unit or a stated
        meaning are angles of joints. If Q1 to Q4 are 0 in all rows, they may be joints; Q0 cannot be a joint.
        """
        texts = map(grammar.collapse_blanks, self._headers)
        column_by_text = {
            text.casefold(): column for column, text in enumerate(texts) if text not in self._words.stated
        }
        joint_like_texts = {text for text in column_by_text if re.fullmatch(r"q\d+", text)}
        quaternion = next(
            (names for names in _QUATERNIONS if joint_like_texts <= {*names} <= column_by_text.keys()), ()
        )
        columns = [column_by_text[name] for name in quaternion]
        cells = [[row.cells[column].replace(",", ".") for column in columns] for row in self._rows]
        sums = [sum(float(cell) ** 2 for cell in row if is_plain_number(cell)) for row in cells]
        unit_sums = [total for total in sums if abs(total - 1.0) < _UNIT_NORM]
        if (
            not columns
            or len(unit_sums) + sums.count(0.0) < len(sums)
            or not (unit_sums or "q0" in quaternion)
        ):
            return []
        end_headers = self._headers[columns[0]], self._headers[columns[-1]]
        self._notes.append(f"{end_headers[0]} to {end_headers[1]} were ignored as the rotation of a probe")
        return columns

    def _understand_headers(self, rotation: Sequence[int]) -> list[Meaning]:
        """Return the meaning of each column; report headers that are unknown or repeat a meaning.

        `rotation` has the indices of the columns of a quaternion, which are ignored like empty columns.
        """
        meanings: list[Meaning] = []
        header_faults = Faults(limits.MAX_COLUMNS)
        for column, header in enumerate(self._headers):
            is_unused = column in rotation or not (header or any(row.cells[column] for row in self._rows))
            meaning = Meaning(Quantity("unknown"))  # remains if the block below raises an error
            with header_faults.collect(self._heading.place(column)):
                meaning = Meaning(Quantity("ignored"))
                if not is_unused:
                    meaning = Meaning(Quantity("unknown"))
                    meaning = self._words.meaning(header, guessed=self._heading.is_guess)
                meanings_before = [(other.quantity, other.axis) for other in meanings]
                if meaning.kind not in _MAY_REPEAT and (meaning.quantity, meaning.axis) in meanings_before:
                    reason = f"{quote(header)} is a second column for {meaning}"
                    remedy = "correct one of the two headers, or skip one column with `ignore`"
                    raise ImportFileError(self._heading.place(column), reason, remedy)
            meanings.append(meaning)
        self._report_faults(header_faults.found)
        return self._number_joints_from_one(meanings)

    def _number_joints_from_one(self, meanings: list[Meaning]) -> list[Meaning]:
        """Return the meanings with joints numbered from 1, also if the file numbers them from 0."""
        if not any(meaning.kind == "joint" and meaning.axis == -1 for meaning in meanings):
            return meanings
        self._notes.append("joints are numbered from 0 in the file: its joint 0 was read as joint 1")
        return [
            replace(meaning, axis=(meaning.axis or 0) + 1) if meaning.kind == "joint" else meaning
            for meaning in meanings
        ]

    def _report_faults(self, faults_found: Sequence[ImportFileError]) -> None:
        """Report faults of headers; many unknown headers share messages, to leave room for others."""
        unknown_headers = [fault for fault in faults_found if fault.option == grammar.UNKNOWN]
        single_faults = [fault for fault in faults_found if fault.option != grammar.UNKNOWN]
        if len(unknown_headers) <= _MAX_SINGLE_FAULTS:
            unknown_headers = []
            single_faults = list(faults_found)
        for start in range(0, len(unknown_headers), _HEADERS_PER_FAULT):
            group = unknown_headers[start : start + _HEADERS_PER_FAULT]
            # Columns of places are counted from 1.
            names = ", ".join(quote(self._headers[(fault.place.column or 1) - 1]) for fault in group)
            reason = f"unknown column headers {names}"
            self._faults.report(group[0].place, reason, group[0].remedy, grammar.UNKNOWN)
        for fault in single_faults:
            self._faults.add(fault)

    def _recognise_states(self, meanings: list[Meaning]) -> list[Meaning]:
        """Return the meanings with states that the names of targets contain, as in `P10 0 x` and `P10 1 x`.

        Each name must occur with the same two words. The words 0 and 1 mean `unloaded` and `loaded`. Two
        other words are reported as a fault, whose remedy is the option `state_words`.
        """
        points = {
            column: meaning.quantity for column, meaning in enumerate(meanings) if meaning.kind in POINTS
        }
        if any(quantity.target is None or quantity.state for quantity in points.values()):
            return meanings
        for pattern in _TARGET_WITH_WORD:
            names = {quantity.target or "" for quantity in points.values()}
            matches = {name: pattern.fullmatch(name) for name in names}
            split_names = {name: (match["target"], match["word"]) for name, match in matches.items() if match}
            targets = {target for target, _ in split_names.values()}
            state_words = {word for _, word in split_names.values()}
            # Every name must have a word, and every target must occur with both words.
            if (
                len(state_words) != 2
                or len(split_names) != len(matches)
                or len(split_names) != 2 * len(targets)
            ):
                continue
            if state_words == grammar.STATE_OF_DIGIT.keys():
                return self._apply_digit_states(meanings, points, split_names)
            if not all(word.isdigit() for word in state_words):
                # in the order in which the words first occur in the headers
                first, second = sorted(state_words, key=" ".join(map(str, meanings)).index)
                self._faults.report(
                    self._heading.place(min(points)),
                    f"{quote(first)} and {quote(second)} in the headers of positions may be states, but "
                    "their meaning is unknown",
                    "name the state of each, such as `state_words`: "
                    f"{show_object({first: 'unloaded', second: 'loaded'})}",
                    "state_words",
                    (first, second),
                )
                return meanings
        return meanings

    def _apply_digit_states(
        self,
        meanings: list[Meaning],
        points: Mapping[int, Quantity],
        split_names: Mapping[str, tuple[str, str]],
    ) -> list[Meaning]:
        """Return the meanings in which 0 and 1 in names of targets are states; add a note on that.

        Args:
            meanings: meanings of all columns.
            points: index of a column of positions → its quantity, whose target ends or begins with 0 or 1.
            split_names: name of such a target → (its name without the digit, the digit).
        """
        self._notes.append("0 and 1 in headers were read as `unloaded` and `loaded`")
        changed = list(meanings)
        for column, (kind, name, _) in points.items():
            target, digit = split_names[name or ""]
            quantity = Quantity(kind, target, grammar.STATE_OF_DIGIT[digit])
            changed[column] = replace(meanings[column], quantity=quantity, guessed=True)
        return changed

    def _group_by_quantity(self, meanings: Sequence[Meaning]) -> dict[Quantity, tuple[int, ...]]:
        """Return quantity → indices of its columns, in the order of joints or axes.

        A missing joint or axis, and axes in upper and lower case, are reported as faults.
        """
        quantities: dict[Quantity, dict[int, int]] = {}
        for index, meaning in enumerate(meanings):
            if meaning.axis is not None:
                quantities.setdefault(meaning.quantity, {})[meaning.axis] = index
        for quantity, axes in quantities.items():
            self._check_axes(quantity, axes)
        return {quantity: tuple(axes[axis] for axis in sorted(axes)) for quantity, axes in quantities.items()}

    def _check_axes(self, quantity: Quantity, axes: Mapping[int, int]) -> None:
        """Report faults if a joint or axis of a quantity is missing, or axes are in upper and lower case.

        `axes` is: number of the joint or axis, from 0 → index of its column.
        """
        place = self._heading.place(min(axes.values()))
        # Joints are numbered without gaps; a vector has three axes, a reading along an axis one number.
        count = {"joint": max(axes) + 1, "point uncertainty": 1, "along": 1, "mass": 1}.get(quantity.kind, 3)
        missing_axes = [axis for axis in range(count) if axis not in axes]
        headers = [self._headers[column] for column in axes.values()]
        texts = [text for text in headers if grammar.collapse_blanks(text) not in self._words.stated]
        letter_cases = {axis[0].isupper() for text in texts if (axis := _AXIS_LETTER.search(text))}
        if quantity.kind in POINTS and len(letter_cases) > 1:  # X and x may be different quantities
            reason = f"{' and '.join(map(quote, texts))} are not spelt alike"
            remedy = "write x, y and z alike, or give their meaning in `columns`"
            self._faults.report(place, reason, remedy, grammar.UNKNOWN)
        if missing_axes:
            reason = f"column {Meaning(quantity, missing_axes[0])} is missing"
            self._faults.report(place, reason, "add the column, or correct its header")
        elif count > MAX_JOINTS:
            self._faults.report(
                place, f"there are more than {MAX_JOINTS} joints", "correct the headers of the joints"
            )

    def _check_names_and_loads(
        self, texts: Mapping[Kind, int], quantities: Mapping[Quantity, tuple[int, ...]]
    ) -> None:
        """Report a fault unless there are columns of names and numbers, and one statement of the load."""
        place, report = self._heading.place(), self._faults.report
        if "name" not in texts and not self._options.by_order:
            remedy = (
                'add a column with the header "label" or "name", or use `by_order` to number the rows of '
                "each file"
            )
            report(place, "no column names the observations or points", remedy, "by_order")
        if not quantities:
            report(place, "no column with numbers is recognised", "correct the header, or give `columns`")
        mass_columns, force_columns = quantities.get(Quantity("mass")), quantities.get(Quantity("force"))
        if mass_columns:
            self._notes.append("the weight of each mass, 9.80665 N per kilogram, pulls along −z of R0")
            if force_columns:
                header = quote(self._headers[mass_columns[0]])
                reason = f"{header} states the load, but columns of forces state the load, too"
                report(
                    self._heading.place(mass_columns[0]), reason, "skip one of these columns with `ignore`"
                )

    def _check_points(
        self, texts: Mapping[Kind, int], quantities: Mapping[Quantity, tuple[int, ...]]
    ) -> None:
        """Report a fault unless all columns of positions state target and state in the same way."""
        report = self._faults.report
        points = [quantity for quantity in quantities if quantity.kind in POINTS]
        for quantity in points:
            if quantity.kind != "along" and quantity.with_kind("position") not in quantities:
                column = quantities[quantity][0]
                header = quote(self._headers[column])
                reason = f"{header} belongs to a position, but the table has no columns of this position"
                report(self._heading.place(column), reason, "correct the header, or use `ignore`")
        for kind in _TARGET_AND_STATE:
            is_named = {getattr(quantity, kind) is not None for quantity in points}
            if len(is_named) > 1:
                self._report_unnamed(kind, quantities)
            if kind in texts and True in is_named:
                reason = f"there is a column `{kind}`, but the headers of positions name the {kind}, too"
                report(
                    self._heading.place(texts[kind]),
                    reason,
                    "keep either the column or the names in the headers",
                )

    def _report_unnamed(self, kind: Kind, quantities: Mapping[Quantity, tuple[int, ...]]) -> None:
        """Report the columns of positions that do not name their target or state, as other columns do."""
        points = [quantity for quantity in quantities if quantity.kind in POINTS]
        unnamed = [quantity for quantity in points if getattr(quantity, kind) is None]
        columns = sorted(column for quantity in unnamed for column in quantities[quantity])
        names = ", ".join(quote(self._headers[column]) for column in columns[:_MOST_UNNAMED])
        others = len(columns) - _MOST_UNNAMED
        if others > 0:
            names += f" and {others} more"
        reason = f"some columns of positions name their {kind}, and other columns do not: {names}"
        remedy = f"name the {kind} in all columns of positions"
        words = _find_state_words(points) if kind == "state" else ()
        if not words:
            self._faults.report(self._heading.place(), reason, remedy)
            return
        word_list = " and ".join(map(quote, words))
        remedy += f"; if {word_list} means a state, say which, such as "
        remedy += f"`state_words`: {show_object({words[0]: 'unloaded'})}"
        self._faults.report(self._heading.place(columns[0]), reason, remedy, "state_words", words)

    def _resolve_units(self, meanings: Sequence[Meaning], axes_unit: str | None) -> list[Meaning]:
        """Return the meanings with the units of all numbers; report a fault for two units of one dimension.

        `axes_unit` is the unit of x, y and z that a comment of the file states, or None.
        """
        resolved = list(meanings)
        for dimension in dict.fromkeys(meaning.dimension for meaning in meanings if meaning.dimension):
            dimension_faults = Faults(1)  # One fault is enough, because others would say the same.
            # A hung mass is always in kg, so that its unit may differ from that of forces.
            have_dimension = [
                meaning.dimension == dimension and meaning.kind != "mass" for meaning in meanings
            ]
            columns = [index for index, has_dimension in enumerate(have_dimension) if has_dimension]
            without_unit: list[int] = []  # columns without a unit
            first_unit = ""
            for column in columns:
                with dimension_faults.collect(self._heading.place(column)):
                    meaning = meanings[column]
                    unit = self._decide_unit(meaning, axes_unit if meaning.kind == "position" else None)
                    resolved[column] = replace(meaning, unit=unit)
                    first_unit = first_unit or unit or ""
                    if unit is None:
                        without_unit.append(column)
                    elif unit != first_unit:
                        other_unit = name_unit(first_unit)
                        reason = f"{meaning} is in {name_unit(unit)}, but other columns are in {other_unit}"
                        remedy = f"use one unit for every {dimension}"
                        raise ImportFileError(self._heading.place(column), reason, remedy)
            for fault in dimension_faults.found:
                self._faults.add(fault)
            units = self._options.units
            force_times_m = dimension == "moment" and units is not None and units.length == "m"
            if without_unit and not force_times_m:
                self._report_missing_unit(dimension, meanings[without_unit[0]], without_unit)
        return resolved

    def _decide_unit(self, meaning: Meaning, axes_unit: str | None) -> str | None:
        """Return the unit of a column: from its header, else from a comment, else from the option `units`.

        Return None if no source states a unit. `axes_unit` is the unit of x, y and z in a comment.

        Raises:
            ImportFileError: two of these sources state different units.
        """
        units = self._options.units
        unit_of_option = None if units is None else getattr(units, meaning.dimension or "")
        sources = {"its header": meaning.unit, "the file's comment": axes_unit, "`units`": unit_of_option}
        (first_source, unit), *others = [(source, unit) for source, unit in sources.items() if unit] or [
            ("", None)
        ]
        for source, other in others:
            if unit is not None and other != unit:
                first_unit, other_unit = name_unit(unit), name_unit(other or "")
                reason = (
                    f"{meaning} is in {first_unit} according to {first_source}, "
                    f"but in {other_unit} according to {source}"
                )
                raise ImportFileError(NOWHERE, reason, "correct the file or `units`")
        return unit

    def _report_missing_unit(self, dimension: Dimension, meaning: Meaning, columns: Sequence[int]) -> None:
        """Report that columns of a dimension have no unit.

        Args:
            dimension: dimension of the columns, such as length.
            meaning: meaning of the first column.
            columns: indices of the columns.
        """
        header, others = self._headers[columns[0]], len(columns) - 1
        example = f"{header or meaning} [{_EXAMPLE_UNITS[dimension]}]"
        remedy = f"write the unit in the header, such as `{example}`, or give `units`"
        column_text = str(meaning)
        if (
            meaning.quantity.target is not None
        ):  # a header that is taken as a target's name may name another quantity
            column_text = f"{quote(header)}, read as {meaning},"
            remedy += f"; if the column means something else, give `columns`, such as {header}=x"
        place = self._heading.place(columns[0])
        reason = f"{column_text} has no unit"
        if others:
            reason = f"{column_text} and {others} other column{'s' * (others > 1)} have no unit"
        self._faults.report(place, reason, remedy, f"units.{dimension}")
