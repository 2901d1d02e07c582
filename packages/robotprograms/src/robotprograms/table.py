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
from robotprograms.language import Op
from robotprograms.notation import DEGREE, MM, Notation, Orientation
from robotprograms.program import Literal, Motion, Source
from robotprograms.statements import Statements


class _Coordinates(NamedTuple):
    """Columns of a table that state a target."""

    names: tuple[str, ...]
    orientation: Orientation
    count_of_lengths: int  # of the first columns
    count_of_angles: int = 0  # of the columns behind the lengths; further columns are ratios without a unit


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

    The first line that is neither empty nor a comment is the header.
    """
    source = sources[0]
    masked_lines, _ = statements.numerals[0].masked_texts(source.starts, source.ends)
    rows = ((index, masked) for index, masked in enumerate(masked_lines) if _is_row(masked))
    index_of_header, _ = next(rows, (0, ""))
    _, first_row = next(rows, (0, ""))
    if not first_row:
        return
    header = show_text(source.text[source.starts[index_of_header] : source.ends[index_of_header]])
    columns = _parse_header(statements, index_of_header + 1, header, first_row)
    lines_behind_header = slice(index_of_header + 1, None)
    statements.add_statements(
        0,
        source.starts[lines_behind_header],
        source.ends[lines_behind_header],
        translate=partial(_translate_row, columns),
    )


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
    """Translate a row of a table into a move, with its number of lines below the row's line, which is 0.

    An empty line gives no move. If a cell is not a number or the tool changes, the move has a reason and is
    not corrected. `masked` is the row's text with NUL in place of each number.
    """
    if not _is_row(masked):
        return []
    cells = _split_row(masked, columns.delimiter)
    fault = _find_fault_of_row(columns, cells)
    target = Literal(columns.notation, ())
    if fault is None:
        target = Literal(
            columns.notation,
            tuple(cells[k].ordinals[0] for k in columns.places),
            external=_list_ordinals(cells, columns.external),
            common=_list_ordinals(cells, columns.frame_columns),
        )
    is_joints = columns.notation.is_joints
    move = ir.Move(
        Motion.JOINT if is_joints else Motion.LINEAR,
        (target,),
        bases=(ir.Named("base" if is_joints else "part"),),
        tools=(ir.Named("tool"),),
        reason=fault.reason if fault else "",
        remedy=fault.remedy if fault else "",
    )
    return [(0, move)]


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


def _parse_header(statements: Statements, line: int, header: str, first: str) -> _TableColumns:
    """Parse the header of a table, such as `x [mm];y [mm];z [mm];tool`.

    Args:
        statements: statements of the program, which refuse it.
        line: line of the header.
        header: text of the header.
        first: first row of targets, with NUL in place of each number.

    Raises:
        ProgramError: the header does not name coordinates with their units.
    """
    delimiter = max(";\t,", key=header.count)  # the most frequent one
    texts = header.split(delimiter)
    columns = _parse_columns(statements, line, texts)
    coordinates = _find_coordinates(statements, line, header, columns)
    notation = _choose_notation(coordinates, [columns[name].unit for name in coordinates.names])
    if notation is None:
        reason = "the columns of the targets have no units, different units, or units of another quantity"
        statements.refuse(line, reason, _REMEDY)
    first_row = dict(enumerate(cell.strip() for cell in first.split(delimiter)))
    return _TableColumns(
        delimiter,
        width=len(texts),
        notation=notation,
        places=[columns[name].place for name in coordinates.names],
        frame_columns={k: first_row.get(k, "") for k, text in enumerate(texts) if _FRAME_COLUMN.match(text)},
        external=[k for k, text in enumerate(texts) if _EXTERNAL.match(text)],
    )


class _Column(NamedTuple):
    """Column of a table."""

    place: int  # index of the column
    unit: str  # such as `mm`; empty if the header states none


def _parse_columns(statements: Statements, line: int, texts: list[str]) -> dict[str, _Column]:
    """Return the columns whose texts in the header, on this line, are a name and perhaps a unit, by name.

    Raises:
        ProgramError: two columns have the same name.
    """
    columns = dict[str, _Column]()
    for index, text in enumerate(texts):
        cell = text.strip().strip('"').strip().removeprefix("\xef\xbb\xbf")  # mark of UTF-8
        match = _COLUMN_NAME.fullmatch(cell)
        if match is None:
            continue
        name, unit = match["name"].lower(), match["unit"] or ""
        if name in columns:
            statements.refuse(line, "two columns have the same name", _REMEDY)
        columns[name] = _Column(index, unit.lower())
    return columns


def _find_coordinates(
    statements: Statements, line: int, header: str, columns: Collection[str]
) -> _Coordinates:
    """Return the coordinates of targets in a table, which has columns of these names.

    Raises:
        ProgramError: the table has no coordinates, or both poses and joint angles.
    """
    complete = [each for each in _COORDINATES if set(each.names) <= set(columns)]
    are_joints = {each.orientation is Orientation.JOINTS for each in complete}
    if len(are_joints) > 1:
        reason = "the table has both poses and joint angles"
        statements.refuse(line, reason, "omit the poses or the joint angles")
    if not complete:
        reason = f"the header {quote_text(header)} does not name the coordinates of the targets"
        statements.refuse(line, reason, _REMEDY)
    return complete[0]  # the first one has the most columns: x, y, z alone come last


def _choose_notation(coordinates: _Coordinates, units: list[str]) -> Notation | None:
    """Return the notation of coordinates whose columns have these units; None if the units do not fit.

    All lengths have one unit, and so have all angles; ratios have none.
    """
    begin_of_angles = coordinates.count_of_lengths
    begin_of_ratios = begin_of_angles + coordinates.count_of_angles
    units_of_lengths = set(units[:begin_of_angles])
    units_of_angles = set(units[begin_of_angles:begin_of_ratios])
    units_of_ratios = set(units[begin_of_ratios:])
    are_known = units_of_lengths <= _LENGTHS.keys() and units_of_angles <= _ANGLES.keys()
    have_ratios_no_unit = units_of_ratios <= {""}
    are_equal = len(units_of_lengths) <= 1 and len(units_of_angles) <= 1
    if not (are_known and are_equal and have_ratios_no_unit):
        return None
    # Where no column is a length, or an angle, any unit serves.
    length_unit, angle_unit = next(iter(units_of_lengths), "mm"), next(iter(units_of_angles), "rad")
    return Notation(
        coordinates.orientation,
        length=_LENGTHS[length_unit],
        angle=_ANGLES[angle_unit],
        length_decimals=6 if units_of_lengths == {"mm"} else 9,
        angle_decimals=9,
    )


LANGUAGE: Final = ir.Language(
    comment=r"(?!)", suffixes=".csv", read=read_table, constants={"base": np.eye(4)}
)
DECIMAL_COMMAS: Final = replace(LANGUAGE, number=ir.NUMBER.replace(r"\.", ",").replace("-.", "-,"))
