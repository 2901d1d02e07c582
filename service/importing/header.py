"""The header of a table: its place, and the meanings of the columns, each quantity in one unit."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType
from typing import Final, Literal, NamedTuple

from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.schemas.robot import MAX_JOINTS
from jointstiff.service.importing import grammar, limits
from jointstiff.service.importing.errors import NOWHERE, Faults, ImportFileError, Place, quote, show_object
from jointstiff.service.importing.grammar import (
    CONVERTED_UNITS,
    POINTS,
    Dimension,
    Kind,
    Meaning,
    Quantity,
    Vocabulary,
    name_unit,
)
from jointstiff.service.importing.grid import (
    LEAST_NUMBERS,
    Grid,
    Remark,
    Row,
    count_numbers,
    is_plain_number,
    looks_like_a_number,
)
from jointstiff.service.importing.loads import find_load

_MAX_TITLE_ROWS: Final = 20
"""Rows above a header."""
_MAX_HEADER_ROWS: Final = 3
"""Rows of a header: groups, axes, units."""
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
    if count_numbers(grid.rows[0]) < LEAST_NUMBERS:
        return _find_header_in_rows(grid, words)
    width = len(grid.rows[0].cells)  # without empty columns at the end
    while width > 1 and not any(any(row.cells[width - 1 :]) for row in grid.rows):
        width -= 1
    return _find_header_in_comments(grid, words, width) or _assume_columns(
        grid, width, by_order=options.by_order
    )


def _has_known_header(grid: Grid, words: Vocabulary) -> bool:
    """Return whether a table begins with a header of its own that is known as a whole."""
    if count_numbers(grid.rows[0]) >= LEAST_NUMBERS:
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
        splits = _split_comment(comment.text)
        for texts in splits:
            if len(texts) == width and words.count_known(texts) == width:
                note = f"the comment in line {comment.line} was used as the header"
                return Heading(grid.file, texts, (comment.line,), is_guess=True, notes=(note,))
        is_last = comment is comments_above[-1]
        if _looks_like_header(comment, width, is_last=is_last, cell_count=len(splits[0])):
            reason = (
                f"the comment {quote(comment.text)} looks like a header, but is not understood as the header "
                f"of the {width} columns"
            )
            remedy = "correct or remove the comment, or give `header`"
            raise ImportFileError(Place(grid.file, comment.line), reason, remedy, "header")
    return None


def find_names_in_comment(grid: Grid, words: Vocabulary, line: int, width: int) -> tuple[str, ...] | None:
    """Return the names of columns in the comment above the row of data in a line; None without such names.

    Unlike those of a header, some of these names may be unknown. Names of polar readings count as known.
    """
    above = [comment for comment in grid.comments if comment.line < line]
    splits = _split_comment(above[-1].text) if above else []
    for texts in splits:
        are_names = all(text[:1].isalpha() for text in texts) and len(set(texts)) == width
        are_polar = sum(grammar.parse_polar(text) is not None for text in texts) == LEAST_NUMBERS
        are_known = are_polar or words.count_known(texts) > 0
        if len(texts) == width and are_names and are_known:
            return texts
    return None


def _split_comment(text: str) -> list[tuple[str, ...]]:
    """Return the cells of a comment that may be a header, once for each separator of headers."""
    shortened = _LONG_BLANK.sub(lambda blank: "\t\t" if "\t" in blank[0] else "  ", text)
    return [tuple(re.split(separator, shortened)) for separator in _HEADER_SEPARATORS]


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
    has_fitting_words = LEAST_NUMBERS <= len(words) <= width and not any(map(str.isdigit, comment.text))
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


class _PossibleHeader(NamedTuple):
    """One or more rows of a table that may be its header."""

    start: int  # index of the first row
    row_count: int
    texts: tuple[str, ...]  # text of each column, combined from the rows

    @property
    def end(self) -> int:
        """Index of the row behind the header."""
        return self.start + self.row_count


def _find_header_in_rows(grid: Grid, words: Vocabulary) -> Heading:
    """Return the header among the first rows of a file.

    Raises:
        ImportFileError: no row of data follows, or a row above the header looks like data.
    """
    header = _choose_header(grid, words)
    if header.end == len(grid.rows):
        place = grid.place(grid.rows[header.start])
        remedy = "export the file again, with its rows"
        raise ImportFileError(place, "the file has a header but no row of data", remedy)
    lines = tuple(row.line for row in grid.rows[header.start : header.end])
    _refuse_data_above(grid, header, lines[0])
    is_combined = header.row_count > 1
    notes = []
    if header.start:
        notes.append(f"rows above the header were read as titles: {header.start}")
    if is_combined:
        notes.append(f"the header was combined from rows {', '.join(map(str, lines))}")
    return Heading(grid.file, header.texts, lines, header.end, is_combined, tuple(notes))


def _choose_header(grid: Grid, words: Vocabulary) -> _PossibleHeader:
    """Return the first header with known texts only, else that with most known texts, else the first row."""
    chosen, most_known = _PossibleHeader(0, 1, grid.rows[0].cells), 0
    for header in _yield_possible_headers(grid, words):
        known_count = words.count_known(map(_leave_out_foreign_unit, header.texts))
        if known_count > most_known:
            chosen, most_known = header, known_count
            is_known_as_a_whole = known_count == sum(map(bool, header.texts))
            if is_known_as_a_whole and header.end < len(grid.rows):
                break
    return chosen


def _leave_out_foreign_unit(text: str) -> str:
    """Return a header without a unit that is known but not accepted, such as µm: the name shows a header."""
    name, unit = grammar.split_unit(text)
    is_foreign = unit is not None and grammar.find_any_unit(unit) and not grammar.find_known_unit(unit)
    return name if is_foreign else text


def _refuse_data_above(grid: Grid, header: _PossibleHeader, line: int) -> None:
    """Raise an `ImportFileError` if a row above the header, in line `line`, looks like data and not a title.

    A title has at most one number, and few filled cells.
    """
    most_filled = max(2, len(header.texts) // 2)
    for row in grid.rows[: header.start]:
        if count_numbers(row) > 1 or sum(map(bool, row.cells)) > most_filled:
            reason = f"the row is above the header in line {line}, but looks like data"
            raise ImportFileError(grid.place(row), reason, "move the row below the header, or remove the row")


def _yield_possible_headers(grid: Grid, words: Vocabulary) -> Iterator[_PossibleHeader]:
    """Yield each possible header; of those that begin in the same row, those with more rows come first."""
    rows = grid.rows[: _MAX_TITLE_ROWS + _MAX_HEADER_ROWS + 1]
    usual_step = max(1, grid.rows[-1].line - grid.rows[-2].line) if len(grid.rows) > 1 else 1
    for start in range(min(_MAX_TITLE_ROWS + 1, len(rows))):
        if start and count_numbers(rows[start - 1]) >= LEAST_NUMBERS:
            return
        for count in range(min(_MAX_HEADER_ROWS, len(rows) - start), 0, -1):
            own = rows[start : start + count]
            if any(after.line - before.line > usual_step for before, after in pairwise(own)):
                continue  # an empty row is between a title and the header
            rows_of_cells = [row.cells for row in own]
            for texts in dict.fromkeys(
                (_merge_rows(rows_of_cells, words), _merge_upwards(rows_of_cells, words))
            ):
                if texts is not None:
                    yield _PossibleHeader(start, count, texts)


def _merge_upwards(rows: Sequence[tuple[str, ...]], words: Vocabulary) -> tuple[str, ...] | None:
    """Combine the rows of a header from the lowest on, as groups above groups require; None as `_merge_rows`.

    In `T1` above `unloaded` and `loaded`, above `X Y Z X Y Z`, the target holds for all six columns.
    """
    first, *others = rows
    lower = _merge_rows(others, words) if others else None
    return None if lower is None else _merge_rows([first, lower], words)


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
        units = _spread_units(upper, lower, words)
        return tuple(_append_unit(name, unit) for name, unit in zip(upper, units, strict=True))
    return _combine_with_groups(upper, lower, words)


def _spread_units(names: Sequence[str], units: Sequence[str], words: Vocabulary) -> list[str]:
    """Return the units of columns, with that of a merged cell also for the empty cells to its right.

    A unit holds as long as the columns are of one kind, such as joints.
    """
    spread, unit, kind_of_unit = list[str](), "", ""
    for name, own_unit in zip(names, units, strict=True):
        meaning = words.find(name) if name else None
        kind = "" if meaning is None or meaning.axis is None else meaning.kind
        if own_unit or not kind or kind != kind_of_unit:
            unit, kind_of_unit = own_unit, kind
        spread.append(unit)
    return spread


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
    not combined with a group to its left. Behind joints or coordinates, a group ends before other columns.
    """
    texts, group = [], ""
    kind = ""  # of the last column of the group, if the group is known with the cell below it
    for upper_cell, lower_cell in zip(upper, lower, strict=True):
        group = upper_cell or (group if lower_cell else "")
        meaning = words.find(f"{group} {lower_cell}") or words.find(lower_cell)
        own_kind = "" if meaning is None or meaning.axis is None else meaning.kind
        if not upper_cell and kind and not own_kind:
            group = ""
        kind = own_kind
        is_joint_number = lower_cell.isdigit() and grammar.is_joint(group)
        if looks_like_a_number(lower_cell) and not is_joint_number:
            return None
        if group and lower_cell:
            texts.append(_combine_with_group(group, upper_cell, lower_cell, words))
        else:
            texts.append(upper_cell or lower_cell)
            group = ""
    return tuple(texts)


def _combine_with_group(group: str, upper: str, lower: str, words: Vocabulary) -> str:
    """Return the header of a column: its lower cell, with the group above it if they belong together.

    Otherwise the group is a title of its columns, perhaps with their unit: `Coordinates [mm]` above `P10 x`
    gives `P10 x [mm]`.

    Args:
        group: group that holds for the column.
        upper: upper cell of the column: the group, or empty if the group begins to the left of the column.
        lower: lower cell of the column.
        words: words that headers may have.
    """
    name, unit = grammar.split_unit(group)
    joined = f"{group} {lower}"
    if unit is not None and grammar.split_unit(lower)[1] in (None, unit):
        joined = _append_unit(f"{name} {lower}", unit)
        if find_load(unit) is not None and words.find(lower) is not None and words.find(joined) is None:
            joined = f"{name} {unit} {lower}"  # a load in brackets, such as `con peso (20 kg)`, is no unit
    own_meaning = words.find(lower)
    is_point = own_meaning is not None and own_meaning.kind in POINTS
    needs_group = own_meaning is None or (is_point and own_meaning.quantity.target is None)
    contradicts_state = is_point and grammar.contains_state_word(upper, words.states)
    may_contradict = contradicts_state or _may_contradict(group, upper, lower, words)
    if needs_group or may_contradict or words.find(joined) is not None:
        return joined
    return lower if unit is None else _append_unit(lower, unit)


def _may_contradict(group: str, upper: str, lower: str, words: Vocabulary) -> bool:
    """Return whether a group is a header or a unit, or has a unit, which may contradict the cell below it.

    `upper` is the group, or empty if the group begins to the left of the cell `lower`.
    """
    is_header = bool(upper) and words.find(upper) is not None
    unit, own_unit = grammar.split_unit(group)[1], grammar.split_unit(lower)[1]
    have_units = unit is not None and own_unit is not None
    have_other_units = have_units and not _are_same_unit(unit or "", own_unit or "")
    return is_header or grammar.find_any_unit(group) is not None or have_other_units


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
    are_rows_numbered: bool = False  # whether the rows have no names, and their order is that of observations

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

    @property
    def are_all_named(self) -> bool:
        """Return whether the headers alone name all rows and numbers: only cells can be at fault.

        A load in the name of a target, such as `300 lb T1 x`, is not understood from headers alone.
        """
        has_load = any(find_load(quantity.target or "") is not None for quantity in self.quantities)
        return self.whole and not self.faulty and "name" in self.texts and not has_load


def _have_whole_rows(quantities: Collection[Quantity]) -> bool:
    """Return whether each row has the joints, and positions whose headers name target and state."""
    positions = [quantity for quantity in quantities if quantity.kind == "position"]
    has_joints = any(quantity.kind == "joint" for quantity in quantities)
    are_named = all(quantity.target is not None and quantity.state is not None for quantity in positions)
    return has_joints and bool(positions) and are_named


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


def _name_points_of_groups(meanings: list[Meaning]) -> list[Meaning]:
    """Return the meanings with a column of targets as that of names, if points are in groups or collections.

    In a table with a column `group` and without a column `name`, the target of a group is a point.
    """
    kinds = {meaning.kind for meaning in meanings}
    if "name" in kinds or not kinds & {"collection", "group"}:
        return meanings
    return [Meaning(Quantity("name")) if meaning.kind == "target" else meaning for meaning in meanings]


def _list_units(meanings: Sequence[Meaning]) -> dict[Dimension, str]:
    """Return dimension → unit of the columns with numbers, such as `length` → `mm`; without unknown units."""
    units: dict[Dimension, str] = {}
    for meaning in meanings:
        has_numbers = meaning.axis is not None
        if has_numbers and meaning.dimension and meaning.unit is not None:
            units[meaning.dimension] = meaning.unit
    return units


class _SplitName(NamedTuple):
    """Name of a target, split into the target and a word that may be its state: `P10 0` → `P10`, `0`."""

    target: str | None  # None if the name is the word alone
    word: str


def _split_into_two_states(names: set[str], pattern: re.Pattern[str]) -> dict[str, _SplitName] | None:
    """Return name → its parts, if each name has one of two words and each target occurs with both words.

    None if the names do not fit the pattern in this way: `P10 0`, `P10 1`, `P20 0` without `P20 1`.
    """
    split_names = {}
    for name in names:
        match = pattern.fullmatch(name)
        if match is None:
            return None
        split_names[name] = _SplitName(match["target"], match["word"])
    targets = {each.target for each in split_names.values()}
    words = {each.word for each in split_names.values()}
    is_complete = len(words) == 2 and len(split_names) == 2 * len(targets)
    return split_names if is_complete else None


class ColumnReader:
    """Reader of the columns of a table; headers that are not understood are reported as faults."""

    def __init__(
        self, heading: Heading, rows: Sequence[Row], words: Vocabulary, options: ImportOptions, faults: Faults
    ) -> None:
        """Prepare to read columns; the rows of data are as long as the header."""
        self._heading, self._headers, self._rows = heading, heading.texts, rows
        self._words, self._options, self._faults = words, options, faults
        self._notes: list[str] = []

    def understand(
        self, units_of_remarks: Mapping[Kind, str], *, state_in_name: bool, are_arrays: bool = False
    ) -> Columns:
        """Return the columns with their meanings, `unknown` for a header that is not understood.

        Args:
            units_of_remarks: units of positions and forces that comments of the file state.
            state_in_name: whether the name of the file has a word for a state.
            are_arrays: whether the columns are those of arrays, which have one row for each observation.
        """
        fault_count = len(self._faults.found)
        rotation = self._find_quaternion()
        meanings = _name_points_of_groups(self._understand_headers(rotation))
        kinds = {meaning.kind for meaning in meanings}
        if not state_in_name and not self._is_state_named(meanings):  # nothing else says the state
            meanings = self._recognise_states(meanings)
        meanings_with_units = self._resolve_units(meanings, units_of_remarks)
        text_columns: dict[Kind, int] = {}
        for index, meaning in enumerate(meanings):
            text_columns.setdefault(meaning.kind, index)
        quantities: dict[Quantity, tuple[int, ...]] = {}
        are_rows_numbered = self._options.by_order and "name" not in text_columns
        if "unknown" not in kinds:
            quantities = self._group_by_quantity(meanings)
            if are_arrays and "name" not in text_columns:
                are_rows_numbered = are_rows_numbered or _have_whole_rows(quantities)
            if "name" not in text_columns and not are_rows_numbered:
                self._report_missing_names()
            self._check_quantities(quantities)
            self._check_points(text_columns, quantities)
        return Columns(
            meanings=tuple(meanings_with_units),
            texts=text_columns,
            quantities=quantities,
            units=_list_units(meanings_with_units),
            notes=tuple(self._notes),
            probe=bool(rotation) or bool(kinds & {"deleted", "uncertainty"}),
            faulty="unknown" in kinds or len(self._faults.found) > fault_count,
            are_rows_numbered=are_rows_numbered,
        )

    def _is_state_named(self, meanings: Sequence[Meaning]) -> bool:
        """Return whether a column, a template of names, or names in rows say the state, such as `loaded`."""
        if any(meaning.kind == "state" for meaning in meanings):
            return True
        if "{state}" in f"{self._options.point_name} {self._options.file_name}":
            return True
        name_columns = [column for column, meaning in enumerate(meanings) if meaning.kind in _NAME_COLUMNS]
        cells = (row.cells[column] for row in self._rows for column in name_columns)
        return any(grammar.contains_state_word(cell, self._words.states) for cell in cells)

    def _find_quaternion(self) -> list[int]:
        """Return the indices of the columns of a quaternion, Q0 to Q3 or Q1 to Q4; [] without a quaternion.

        If Q1 to Q4 are 0 in all rows, they may be joints; Q0 cannot be a joint.
        """
        column_of_name = self._list_quaternion_columns()
        columns = list(column_of_name.values())
        if not columns or not self._are_rotations(columns, may_be_zero="q0" in column_of_name):
            return []
        first, last = self._headers[columns[0]], self._headers[columns[-1]]
        self._notes.append(f"{first} to {last} were ignored as the rotation of a probe")
        return columns

    def _list_quaternion_columns(self) -> dict[str, int]:
        """Return name → column for the four headers that may be a quaternion; {} without such headers.

        Columns with a unit or a stated meaning are angles of joints, and so are Q1 to Q4 next to a Q5.
        """
        column_by_text: dict[str, int] = {}
        for column, header in enumerate(self._headers):
            text = grammar.collapse_blanks(header)
            if text not in self._words.stated:
                column_by_text[text.casefold()] = column
        joint_like_texts = {text for text in column_by_text if re.fullmatch(r"q\d+", text)}
        for names in _QUATERNIONS:
            if joint_like_texts <= {*names} <= column_by_text.keys():
                return {name: column_by_text[name] for name in names}
        return {}

    def _are_rotations(self, columns: Sequence[int], *, may_be_zero: bool) -> bool:
        """Return whether the squares of four columns add up to 1 in each row, as of a rotation, or are all 0.

        Unless it `may_be_zero` in all rows, one row must be 1.
        """
        sums = []
        for row in self._rows:
            texts = [row.cells[column].replace(",", ".") for column in columns]
            sums.append(sum(float(text) ** 2 for text in texts if is_plain_number(text)))
        unit_count = sum(abs(total - 1.0) < _UNIT_NORM for total in sums)
        has_unit = may_be_zero or unit_count > 0
        return has_unit and unit_count + sums.count(0.0) >= len(sums)

    def _understand_headers(self, rotation: Sequence[int]) -> list[Meaning]:
        """Return the meaning of each column; report headers that are unknown or repeat a meaning.

        `rotation` has the indices of the columns of a quaternion, which are ignored like empty columns.
        """
        meanings: list[Meaning] = []
        header_faults = Faults(limits.MAX_COLUMNS)
        for column, header in enumerate(self._headers):
            is_empty = not header and not any(row.cells[column] for row in self._rows)
            meaning = Meaning(Quantity("unknown"))  # remains if the header is not understood
            with header_faults.collect(self._heading.place(column)):
                if is_empty or column in rotation:
                    meaning = Meaning(Quantity("ignored"))
                else:
                    meaning = self._words.meaning(header, guessed=self._heading.is_guess)
                self._refuse_repeated(column, meaning, meanings)
            meanings.append(meaning)
        self._report_faults(header_faults.found)
        return self._number_joints_from_one(meanings)

    def _refuse_repeated(self, column: int, meaning: Meaning, others: Sequence[Meaning]) -> None:
        """Raise an `ImportFileError` if a column repeats the meaning of one of the columns to its left."""
        if meaning.kind in _MAY_REPEAT:
            return
        if any((meaning.quantity, meaning.axis) == (other.quantity, other.axis) for other in others):
            reason = f"{quote(self._headers[column])} is a second column for {meaning}"
            remedy = "correct one of the two headers, or skip one column with `ignore`"
            raise ImportFileError(self._heading.place(column), reason, remedy)

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
        if len(unknown_headers) > _MAX_SINGLE_FAULTS:
            self._report_unknown_headers(unknown_headers)
        else:
            single_faults = list(faults_found)
        for fault in single_faults:
            self._faults.add(fault)

    def _report_unknown_headers(self, faults: Sequence[ImportFileError]) -> None:
        """Report unknown headers, four in one message; `faults` are the faults of the single headers."""
        for start in range(0, len(faults), _HEADERS_PER_FAULT):
            group = faults[start : start + _HEADERS_PER_FAULT]
            columns = [(fault.place.column or 1) - 1 for fault in group]  # columns of places count from 1
            names = ", ".join(quote(self._headers[column]) for column in columns)
            reason = f"unknown column headers {names}"
            self._faults.report(group[0].place, reason, group[0].remedy, grammar.UNKNOWN)

    def _recognise_states(self, meanings: list[Meaning]) -> list[Meaning]:
        """Return the meanings with states that the names of targets contain, as in `P10 0 x` and `P10 1 x`.

        Each name must occur with the same two words. The words 0 and 1 mean `unloaded` and `loaded`, as do
        words for `without` and `with` in one language, such as `sem` and `com`, which need no name. Two other
        words are reported as a fault, whose remedy is the option `state_words`.
        """
        points = {
            column: meaning.quantity for column, meaning in enumerate(meanings) if meaning.kind in POINTS
        }
        if any(quantity.target is None or quantity.state for quantity in points.values()):
            return meanings
        names = {quantity.target or "" for quantity in points.values()}
        states = grammar.find_opposites(names)
        if len(names) == 2 and states.keys() == names:
            unnamed = {name: _SplitName(None, name) for name in names}
            return self._apply_states(meanings, points, unnamed, states)
        for pattern in _TARGET_WITH_WORD:
            split_names = _split_into_two_states(names, pattern)
            if split_names is None:
                continue
            words = {each.word for each in split_names.values()}
            if words == grammar.STATE_OF_DIGIT.keys():
                return self._apply_states(meanings, points, split_names, grammar.STATE_OF_DIGIT)
            states = grammar.find_opposites(words)
            if states.keys() == words:
                return self._apply_states(meanings, points, split_names, states)
            if not all(word.isdigit() for word in words):
                self._report_unknown_states(words, meanings, min(points))
                return meanings
        return meanings

    def _report_unknown_states(self, words: set[str], meanings: Sequence[Meaning], column: int) -> None:
        """Report two words in the headers of positions, from the column `column` on, that may be states."""
        # in the order in which the words first occur in the headers
        first, second = sorted(words, key=" ".join(map(str, meanings)).index)
        example = show_object({first: "unloaded", second: "loaded"})
        self._faults.report(
            self._heading.place(column),
            f"{quote(first)} and {quote(second)} in the headers of positions may be states, but "
            "their meaning is unknown",
            f"name the state of each, such as `state_words`: {example}",
            "state_words",
            (first, second),
        )

    def _apply_states(
        self,
        meanings: list[Meaning],
        points: Mapping[int, Quantity],
        split_names: Mapping[str, _SplitName],
        states: Mapping[str, State],
    ) -> list[Meaning]:
        """Return the meanings in which words in names of targets are states; add a note on that.

        Args:
            meanings: meanings of all columns.
            points: index of a column of positions → its quantity, whose target ends or begins with a word.
            split_names: name of such a target → its name without the word, and the word.
            states: word → its state, `unloaded` or `loaded`.
        """
        loaded, unloaded = sorted(states, key=lambda word: states[word])
        self._notes.append(f"{unloaded} and {loaded} in headers were read as `unloaded` and `loaded`")
        changed = list(meanings)
        for column, quantity in points.items():
            target, word = split_names[quantity.target or ""]
            with_state = Quantity(quantity.kind, target, states[word])
            changed[column] = replace(meanings[column], quantity=with_state, guessed=True)
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
        if quantity.kind in POINTS:
            self._check_letter_cases([self._headers[column] for column in axes.values()], place)
        # Joints are numbered without gaps; a vector has three axes, a reading along an axis one number.
        count = {"joint": max(axes) + 1, "point uncertainty": 1, "along": 1, "mass": 1}.get(quantity.kind, 3)
        missing_axes = [axis for axis in range(count) if axis not in axes]
        if missing_axes:
            reason = f"column {Meaning(quantity, missing_axes[0])} is missing"
            self._faults.report(place, reason, "add the column, or correct its header")
        elif count > MAX_JOINTS:
            self._faults.report(
                place, f"there are more than {MAX_JOINTS} joints", "correct the headers of the joints"
            )

    def _check_letter_cases(self, headers: Sequence[str], place: Place) -> None:
        """Report headers of a position if some have X, others x: these may be different quantities.

        Headers whose meaning the caller states may differ. `place` is the place of the first header.
        """
        texts = [text for text in headers if grammar.collapse_blanks(text) not in self._words.stated]
        axes = [_AXIS_LETTER.search(text) for text in texts]
        if len({axis[0].isupper() for axis in axes if axis}) > 1:
            reason = f"{' and '.join(map(quote, texts))} are not spelt alike"
            remedy = "write x, y and z alike, or give their meaning in `columns`"
            self._faults.report(place, reason, remedy, grammar.UNKNOWN)

    def _report_missing_names(self) -> None:
        """Report that no column has names of the rows."""
        remedy = (
            'add a column with the header "label" or "name", or use `by_order` to number the rows of each '
            "file"
        )
        place = self._heading.place()
        self._faults.report(place, "no column names the observations or points", remedy, "by_order")

    def _check_quantities(self, quantities: Mapping[Quantity, tuple[int, ...]]) -> None:
        """Report a fault unless there are columns of numbers, and one statement of the load."""
        place = self._heading.place()
        if not quantities:
            remedy = "correct the header, or give `columns`"
            self._faults.report(place, "no column with numbers is recognised", remedy)
        mass_columns = quantities.get(Quantity("mass"))
        if mass_columns:
            self._notes.append("the weight of each mass, 9.80665 N per kilogram, pulls along −z of R0")
            if Quantity("force") in quantities:
                header = quote(self._headers[mass_columns[0]])
                reason = f"{header} states the load, but columns of forces state the load, too"
                remedy = "skip one of these columns with `ignore`"
                self._faults.report(self._heading.place(mass_columns[0]), reason, remedy)

    def _check_points(
        self, texts: Mapping[Kind, int], quantities: Mapping[Quantity, tuple[int, ...]]
    ) -> None:
        """Report a fault unless all columns of positions state target and state in the same way."""
        points = [quantity for quantity in quantities if quantity.kind in POINTS]
        for quantity in points:
            if quantity.kind != "along" and quantity.with_kind("position") not in quantities:
                column = quantities[quantity][0]
                header = quote(self._headers[column])
                reason = f"{header} belongs to a position, but the table has no columns of this position"
                remedy = "correct the header, or use `ignore`"
                self._faults.report(self._heading.place(column), reason, remedy)
        for kind in _TARGET_AND_STATE:
            are_named = {getattr(quantity, kind) is not None for quantity in points}
            if are_named == {True, False}:
                self._report_unnamed(kind, quantities)
            if kind in texts and True in are_named:
                reason = f"there is a column `{kind}`, but the headers of positions name the {kind}, too"
                remedy = "keep either the column or the names in the headers"
                self._faults.report(self._heading.place(texts[kind]), reason, remedy)

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

    def _resolve_units(
        self, meanings: Sequence[Meaning], units_of_remarks: Mapping[Kind, str]
    ) -> list[Meaning]:
        """Return the meanings with the units of all numbers; report a fault for two units of one dimension.

        `units_of_remarks` are those of positions and forces that comments of the file state.
        """
        resolved = list(meanings)
        for dimension in dict.fromkeys(meaning.dimension for meaning in meanings if meaning.dimension):
            units = self._decide_units(dimension, meanings, units_of_remarks)
            for column, unit in units.items():
                resolved[column] = replace(meanings[column], unit=unit)
            without_unit = [column for column, unit in units.items() if unit is None]
            if without_unit and not self._has_implied_unit(dimension, meanings):
                self._report_missing_unit(dimension, meanings[without_unit[0]], without_unit)
        return resolved

    def _has_implied_unit(self, dimension: Dimension, meanings: Sequence[Meaning]) -> bool:
        """Return whether a dimension needs no unit: with lengths in m, moments are in force times m.

        Moments next to forces in a unit that is converted need a unit.
        """
        units = self._options.units
        if dimension != "moment" or units is None or units.length != "m":
            return False
        units_of_force = {units.force, *(meaning.unit for meaning in meanings if meaning.kind == "force")}
        return CONVERTED_UNITS.keys().isdisjoint(units_of_force)

    def _decide_units(
        self, dimension: Dimension, meanings: Sequence[Meaning], units_of_remarks: Mapping[Kind, str]
    ) -> dict[int, str | None]:
        """Return column → unit for the columns of a dimension; None where nothing states the unit.

        The first fault is reported, because others would say the same; a column with two units is left out. A
        hung mass is always in kg, so that its unit may differ from that of forces.
        """
        faults = Faults(1)
        units: dict[int, str | None] = {}
        for column, meaning in enumerate(meanings):
            if meaning.dimension != dimension or meaning.kind == "mass":
                continue
            with faults.collect(self._heading.place(column)):
                unit_of_remark = units_of_remarks.get(meaning.kind)
                unit = units[column] = self._decide_unit(meaning, unit_of_remark)
                first = next(filter(None, units.values()), None)
                if unit is not None and unit != first:
                    others = name_unit(first or "")
                    reason = f"{meaning} is in {name_unit(unit)}, but other columns are in {others}"
                    raise ImportFileError(NOWHERE, reason, f"use one unit for every {dimension}")
        for fault in faults.found:
            self._faults.add(fault)
        return units

    def _decide_unit(self, meaning: Meaning, unit_of_remark: str | None) -> str | None:
        """Return the unit of a column: from its header, else from a comment, else from the option `units`.

        Return None if no source states a unit. `unit_of_remark` is the unit that a comment states.

        Raises:
            ImportFileError: two of these sources state different units.
        """
        units = self._options.units
        unit_of_option = None if units is None else getattr(units, meaning.dimension or "")
        sources = {
            "its header": meaning.unit,
            "the file's comment": unit_of_remark,
            "`units`": unit_of_option,
        }
        stated = {source: unit for source, unit in sources.items() if unit}
        if not stated:
            return None
        first_source, first = next(iter(stated.items()))
        for source, other in stated.items():
            if other != first:
                reason = (
                    f"{meaning} is in {name_unit(first)} according to {first_source}, "
                    f"but in {name_unit(other)} according to {source}"
                )
                raise ImportFileError(NOWHERE, reason, "correct the file or `units`")
        return first

    def _report_missing_unit(self, dimension: Dimension, meaning: Meaning, columns: Sequence[int]) -> None:
        """Report that columns of a dimension have no unit.

        Args:
            dimension: dimension of the columns, such as length.
            meaning: meaning of the first column.
            columns: indices of the columns.
        """
        header, others = self._headers[columns[0]], len(columns) - 1
        unit = _EXAMPLE_UNITS[dimension]
        remedy = (
            f"write the unit in the header, such as `{header or meaning} [{unit}]`, "
            f'or state the unit, such as `units`: {{"{dimension}": "{unit}"}}'
        )
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
