"""Targets in a table (CSV): a header names the columns and their units, each row is a target."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Final, NamedTuple

import numpy as np

from robotprograms import language as ir
from robotprograms.errors import quote_text, show_text
from robotprograms.language import Misread, Op
from robotprograms.notation import DEGREE, MM, Notation, Orientation
from robotprograms.program import Literal, Motion, Source
from robotprograms.statements import Statements


class _Coordinates(NamedTuple):
    """Columns of a table that state a target."""

    names: tuple[str, ...]
    orientation: Orientation
    count_of_lengths: int  # of the first columns
    count_of_angles: int = 0  # of the columns behind the lengths; further columns are ratios without a unit

    def group_units(self, units: list[str]) -> _Units:
        """Group the units of these columns, such as mm, mm, mm, deg, deg, deg, by the quantity."""
        begin_of_angles = self.count_of_lengths
        begin_of_ratios = begin_of_angles + self.count_of_angles
        return _Units(
            of_lengths=set(units[:begin_of_angles]),
            of_angles=set(units[begin_of_angles:begin_of_ratios]),
            of_ratios=set(units[begin_of_ratios:]),
        )


class _Units(NamedTuple):
    """Different units of the columns that state a target; empty for a column without a unit."""

    of_lengths: set[str]
    of_angles: set[str]
    of_ratios: set[str]  # of numbers such as those of a quaternion

    @property
    def are_consistent(self) -> bool:
        """True if all lengths have one known unit, all angles have one, and ratios have none."""
        are_known = self.of_lengths <= _LENGTHS.keys() and self.of_angles <= _ANGLES.keys()
        are_equal = len(self.of_lengths) <= 1 and len(self.of_angles) <= 1
        have_ratios_no_unit = self.of_ratios <= {""}
        return are_known and are_equal and have_ratios_no_unit


_XYZ: Final = ("x", "y", "z")
_COORDINATES: Final = (
    _Coordinates((*_XYZ, "a", "b", "c"), Orientation.EULER_ZYX, 3, 3),
    _Coordinates((*_XYZ, "w", "p", "r"), Orientation.FIXED_XYZ, 3, 3),
    _Coordinates((*_XYZ, "qw", "qx", "qy", "qz"), Orientation.QUATERNION, 3),
    _Coordinates((*_XYZ, "rx", "ry", "rz"), Orientation.ROTATION_VECTOR, 3, 3),
    _Coordinates((*_XYZ, "i", "j", "k"), Orientation.TOOL_AXIS, 3),
    _Coordinates(("j1", "j2", "j3", "j4", "j5", "j6"), Orientation.JOINTS, 0, 6),
    _Coordinates(("a1", "a2", "a3", "a4", "a5", "a6"), Orientation.JOINTS, 0, 6),
    _Coordinates(("q1", "q2", "q3", "q4", "q5", "q6"), Orientation.JOINTS, 0, 6),
    _Coordinates(_XYZ, Orientation.NONE, 3),
)
"""Columns that state a target; those that are part of others come last."""
_COLUMN_NAME: Final = re.compile(
    r"(?P<name>[a-z]++\d?)\s*+(?:[\[(_]?\s*+(?P<unit>mm|m|degree|deg|rad|\xb0)\s*+[\])]?)?", re.IGNORECASE
)
_LENGTHS: Final = {"mm": MM, "m": 1.0}
_ANGLES: Final = {"deg": DEGREE, "degree": DEGREE, "\xb0": DEGREE, "rad": 1.0}
_FRAME_COLUMN: Final = re.compile(r"\W*+(?:u?tool|tcp|u?frame|base|wobj|uf|ut)\b", re.IGNORECASE)
"""Names of columns with the tool or the base of a target."""
_EXTERNAL: Final = re.compile(r"\W*+(?:e|ext)_?\d\b", re.IGNORECASE)
"""Names of columns of external axes."""
_NUMBER: Final = re.compile(r"\s*+\"?\s*+\0\s*+\"?\s*+")
"""A cell with a number."""
_REMEDY: Final = (
    "name columns x, y, z and a, b, c (or w, p, r; qw ... qz; rx, ry, rz; i, j, k), "
    "or j1 ... j6, with units as in `x [mm]`"
)


def read_table(statements: Statements, sources: tuple[Source, ...]) -> None:
    """Add each row of a table of targets as a move; a table without rows adds nothing.

    Raises:
        ProgramError: the header of the table does not name coordinates with their units.
    """
    source = sources[0]
    header = _find_header(statements, source)
    if header is None:
        return
    try:
        columns = _parse_header(header)
    except Misread as fault:
        statements.refuse(header.line, fault.reason, fault.remedy)
    translate_row = partial(_translate_row, columns)
    starts, ends = source.starts[header.line :], source.ends[header.line :]  # of the lines behind the header
    statements.add_statements(0, starts, ends, translate=translate_row)


class _Header(NamedTuple):
    """Header of a table, and the first row behind it."""

    line: int  # number of the line of the header; the first line of the file is 1
    text: str  # such as `x [mm];y [mm];z [mm]`
    first_row: str  # with NUL in place of each number


def _find_header(statements: Statements, source: Source) -> _Header | None:
    """Find the header of a table: its first line that is neither empty nor a comment.

    The header is None if no row of targets follows.
    """
    masked_lines, _ = statements.numerals[0].masked_texts(source.starts, source.ends)
    index_of_header: int | None = None
    for index, masked in enumerate(masked_lines):
        if not _is_row(masked):
            continue
        if index_of_header is None:
            index_of_header = index
        else:
            text = source.text[source.starts[index_of_header] : source.ends[index_of_header]]
            return _Header(index_of_header + 1, show_text(text), first_row=masked)
    return None


def _is_row(line: str) -> bool:
    """Return whether a line is a row of the table, neither empty nor a comment."""
    return bool(line.strip()) and not line.lstrip().startswith("#")


class _TableColumns(NamedTuple):
    """Columns of a table."""

    delimiter: str
    width: int  # count of the columns
    notation: Notation  # meaning of the numbers of a target
    places: list[int]  # indices of the columns that have these numbers, in their order
    frame_columns: dict[int, str]  # text in the first row of each column of tool or base, by its index
    external: list[int]  # indices of the columns of external axes


class _Cell(NamedTuple):
    """Cell of a row."""

    text: str  # with NUL in place of each number
    ordinals: range  # indices of its numbers among those of the row

    def quote(self) -> str:
        """Return the text in quotation marks for a message; the interpreter inserts its numbers."""
        return ir.quote_statement(self.text, self.ordinals)


def _split_row(masked: str, delimiter: str) -> list[_Cell]:
    """Split a row, whose text has NUL in place of each number, into its cells."""
    cells = list[_Cell]()
    passed_numbers = 0  # count of the numbers in the cells before
    for text in masked.split(delimiter):
        end = passed_numbers + text.count(ir.A_NUMBER)
        cells.append(_Cell(text, range(passed_numbers, end)))
        passed_numbers = end
    return cells


def _translate_row(columns: _TableColumns, masked: str) -> list[tuple[int, Op]]:
    """Translate a row of a table, such as `100;200;300`, into a move to the target that the row states.

    If a cell is not a number or the tool changes, the move has a reason and is not corrected. An empty line
    gives no move.

    Args:
        columns: columns of the table.
        masked: text of the row with NUL in place of each number.

    Returns:
        The move, with its number of lines below the line of the row, which is 0.
    """
    if not _is_row(masked):
        return []
    cells = _split_row(masked, columns.delimiter)
    fault = _find_fault_of_row(columns, cells)
    if fault is None:
        move = _make_move(_read_target(columns, cells))
    else:
        target_without_numbers = Literal(columns.notation, ())
        move = _make_move(target_without_numbers)._replace(reason=fault.reason, remedy=fault.remedy)
    line_offset = 0
    return [(line_offset, move)]


def _read_target(columns: _TableColumns, cells: list[_Cell]) -> Literal:
    """Return the target that a row states, as indices of its numbers among those of the row."""
    numbers = tuple(cells[k].ordinals[0] for k in columns.places)
    external_axes = _list_ordinals(cells, columns.external)
    numbers_of_frames = _list_ordinals(cells, columns.frame_columns)
    return Literal(columns.notation, numbers, external_axes, common=numbers_of_frames)


def _make_move(target: Literal) -> ir.Move:
    """Return the move to a target: joint angles by a motion of the joints, a pose on a line.

    A table names no frames: joint angles are in the frame `base`, poses in that of the part.
    """
    if target.notation.is_joints:
        motion, base = Motion.JOINT, "base"
    else:
        motion, base = Motion.LINEAR, "part"
    return ir.Move(motion, (target,), bases=(ir.Named(base),), tools=(ir.Named("tool"),))


def _list_ordinals(cells: list[_Cell], columns: Iterable[int]) -> tuple[int, ...]:
    """Return the ordinals of all numbers in the cells of some columns."""
    return tuple(chain.from_iterable(cells[k].ordinals for k in columns))


class _FaultOfRow(NamedTuple):
    """Reason why a row cannot be corrected, and what to do."""

    reason: str
    remedy: str


def _find_fault_of_row(columns: _TableColumns, cells: list[_Cell]) -> _FaultOfRow | None:
    """Return why a row cannot be corrected; None if it can be."""
    if len(cells) != columns.width:
        reason = f"the row has {len(cells)} columns instead of {columns.width}"
        return _FaultOfRow(reason, "give every row as many columns as the header")
    for k in columns.places:
        if not _NUMBER.fullmatch(cells[k].text):
            quoted = cells[k].quote()
            remedy = "write numbers with decimal points" if "," in quoted else "write a number"
            return _FaultOfRow(f"{quoted} in column {k + 1} is not a number", remedy)
    for k, text_in_first_row in columns.frame_columns.items():
        if cells[k].text.strip() != text_in_first_row:
            reason = "the tool or the base changes within the table"
            return _FaultOfRow(reason, "send one table for each tool and base")
    return None


def _parse_header(header: _Header) -> _TableColumns:
    """Parse the header of a table, such as `x [mm];y [mm];z [mm];tool`.

    Raises:
        Misread: the header does not name coordinates with their units.
    """
    delimiter = max(";\t,", key=header.text.count)  # the most frequent one
    titles = header.text.split(delimiter)
    columns = _parse_columns(titles)
    coordinates = _find_coordinates(header.text, columns)
    columns_of_target = [columns[name] for name in coordinates.names]
    units = coordinates.group_units([column.unit for column in columns_of_target])
    return _TableColumns(
        delimiter,
        width=len(titles),
        notation=_choose_notation(coordinates.orientation, units),
        places=[column.place for column in columns_of_target],
        frame_columns=_find_frame_columns(titles, header.first_row.split(delimiter)),
        external=[index for index, title in enumerate(titles) if _EXTERNAL.match(title)],
    )


def _find_frame_columns(titles: list[str], first_row: list[str]) -> dict[int, str]:
    """Return the columns of tool or base: the text in the cell of the first row, by the index of the column.

    The first row may have fewer cells than the header has titles; a missing cell has an empty text.
    """
    frame_columns = dict[int, str]()
    for index, title in enumerate(titles):
        if _FRAME_COLUMN.match(title):
            cell = first_row[index] if index < len(first_row) else ""
            frame_columns[index] = cell.strip()
    return frame_columns


class _Column(NamedTuple):
    """Column of a table."""

    place: int  # index of the column
    unit: str  # such as `mm`; empty if the header states none


def _parse_columns(titles: list[str]) -> dict[str, _Column]:
    """Return the columns of a table by their names, from titles such as `x [mm]` and `qw`.

    A title of another form, such as `weld seam 3`, is left out.

    Raises:
        Misread: two columns have the same name.
    """
    columns = dict[str, _Column]()
    for index, title in enumerate(titles):
        plain_title = title.strip().strip('"').strip().removeprefix("\xef\xbb\xbf")  # mark of UTF-8
        match = _COLUMN_NAME.fullmatch(plain_title)
        if match is None:
            continue
        name, unit = match["name"].lower(), match["unit"] or ""
        if name in columns:
            raise Misread("two columns have the same name", _REMEDY)
        columns[name] = _Column(index, unit.lower())
    return columns


def _find_coordinates(header: str, columns: Collection[str]) -> _Coordinates:
    """Return the coordinates of targets in a table, such as x, y, z and a, b, c.

    Args:
        header: text of the header, for the message.
        columns: names of the columns of the table.

    Raises:
        Misread: the table has no coordinates, or both poses and joint angles.
    """
    complete = [each for each in _COORDINATES if set(each.names) <= set(columns)]
    are_joints = {each.orientation is Orientation.JOINTS for each in complete}
    if len(are_joints) > 1:
        reason = "the table has both poses and joint angles"
        raise Misread(reason, "omit the poses or the joint angles")
    if not complete:
        reason = f"the header {quote_text(header)} does not name the coordinates of the targets"
        raise Misread(reason, _REMEDY)
    return complete[0]  # the first one has the most columns: x, y, z alone come last


def _choose_notation(orientation: Orientation, units: _Units) -> Notation:
    """Return the notation of targets whose columns have these units.

    Raises:
        Misread: a unit is unknown, missing or differs from the others.
    """
    if not units.are_consistent:
        reason = "the columns of the targets have no units, different units, or units of another quantity"
        raise Misread(reason, _REMEDY)
    # Where no column is a length, or an angle, any unit serves.
    length_unit = next(iter(units.of_lengths), "mm")
    angle_unit = next(iter(units.of_angles), "rad")
    return Notation(
        orientation,
        length=_LENGTHS[length_unit],
        angle=_ANGLES[angle_unit],
        length_decimals=6 if units.of_lengths == {"mm"} else 9,
        angle_decimals=9,
    )


LANGUAGE: Final = ir.Language(
    comment=r"(?!)", suffixes=".csv", read=read_table, constants={"base": np.eye(4)}
)
DECIMAL_COMMAS: Final = replace(LANGUAGE, number=ir.NUMBER.replace(r"\.", ",").replace("-.", "-,"))
