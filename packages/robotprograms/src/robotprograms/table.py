"""Targets in a table (CSV): a header names the columns and their units, each row is a target."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import accumulate
from typing import Final, NamedTuple

import numpy as np

from robotprograms import language as ir
from robotprograms.errors import quote_text, show_text
from robotprograms.language import Op
from robotprograms.notation import DEGREE, MM, Notation, Orientation
from robotprograms.program import Literal, Motion, Source
from robotprograms.statements import Statements

_TARGET_COLUMNS: Final = {
    "x y z a b c": (Orientation.EULER_ZYX, "lllaaa"),
    "x y z w p r": (Orientation.FIXED_XYZ, "lllaaa"),
    "x y z qw qx qy qz": (Orientation.QUATERNION, "lll1111"),
    "x y z rx ry rz": (Orientation.ROTATION_VECTOR, "lllaaa"),
    "x y z i j k": (Orientation.TOOL_AXIS, "lll111"),
    "j1 j2 j3 j4 j5 j6": (Orientation.JOINTS, "aaaaaa"),
    "a1 a2 a3 a4 a5 a6": (Orientation.JOINTS, "aaaaaa"),
    "q1 q2 q3 q4 q5 q6": (Orientation.JOINTS, "aaaaaa"),
    "x y z": (Orientation.NONE, "lll"),
}
"""Orientation that columns of these names state; and for each column, l (length), a (angle) or 1 (ratio)."""
_COLUMN_NAME: Final = re.compile(
    r"([a-z]++\d?)\s*+(?:[\[(_]?\s*+(mm|m|degree|deg|rad|\xb0)\s*+[\])]?)?", re.IGNORECASE
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
    """Add each row of a table of targets as a move; an empty table adds nothing."""
    source = sources[0]
    masked_texts, _ = statements.numerals[0].masked_texts(source.starts, source.ends)
    rows = ((index, masked) for index, masked in enumerate(masked_texts) if _is_row(masked))
    header_index, _ = next(rows, (0, ""))
    _, first_row = next(rows, (0, ""))
    if not first_row:
        return
    header = show_text(source.text[source.starts[header_index] : source.ends[header_index]])
    columns = _parse_header(statements, header_index + 1, header, first_row)
    behind_header = slice(header_index + 1, None)
    statements.add_statements(
        0,
        source.starts[behind_header],
        source.ends[behind_header],
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


def _translate_row(columns: _TableColumns, masked: str) -> list[tuple[int, Op]]:
    """Translate a row of a table into a move, with its number of lines below the row's line, which is 0.

    An empty line gives no move. If a cell is not a number or the tool changes, the move has a reason and is
    not corrected. `masked` is the row's text with NUL in place of each number.
    """
    if not _is_row(masked):
        return []
    cells = masked.split(columns.delimiter)
    # Ordinals of the numbers in cell k: from first_number[k] to first_number[k + 1]
    first_number = [0, *accumulate(cell.count("\0") for cell in cells)]
    reason, remedy = _find_fault_of_row(columns, cells, first_number)
    target = Literal(columns.notation, ())
    if not reason:
        numbers = tuple(first_number[k] for k in columns.places)
        external = [i for k in columns.external for i in range(first_number[k], first_number[k + 1])]
        common = [i for k in columns.frame_columns for i in range(first_number[k], first_number[k + 1])]
        target = Literal(columns.notation, numbers, tuple(external), common=tuple(common))
    tools = (ir.Named("tool"),)
    if columns.notation.is_joints:
        base = ir.Named("base")
        return [(0, ir.Move(Motion.JOINT, (target,), (base,), tools, reason=reason, remedy=remedy))]
    base = ir.Named("part")
    return [(0, ir.Move(Motion.LINEAR, (target,), (base,), tools, reason=reason, remedy=remedy))]


def _find_fault_of_row(columns: _TableColumns, cells: list[str], first_number: list[int]) -> tuple[str, str]:
    """Return why a row cannot be corrected, and the remedy; two empty texts if it can be.

    `first_number` is the ordinal of the first number in each cell, and the count of all numbers.
    """
    if len(cells) != columns.width:
        reason = f"the row has {len(cells)} columns instead of {columns.width}"
        return reason, "give every row as many columns as the header"
    for k in columns.places:
        if not _NUMBER.fullmatch(cells[k]):
            cell = ir.quote_statement(cells[k], range(first_number[k], first_number[-1]))
            remedy = "write numbers with decimal points" if "," in cell else "write a number"
            return f"{cell} in column {k + 1} is not a number", remedy
    for k, text_in_first_row in columns.frame_columns.items():
        if cells[k].strip() != text_in_first_row:
            return "the tool or the base changes within the table", "send one table for each tool and base"
    return "", ""


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
    column_of_name, unit_of_name = dict[str, int](), dict[str, str]()
    for column, text in enumerate(texts):
        cell = text.strip().strip('"').strip().removeprefix("\xef\xbb\xbf")  # mark of UTF-8
        if match := _COLUMN_NAME.fullmatch(cell):
            name, unit = match[1].lower(), (match[2] or "").lower()
            if name in column_of_name:
                statements.refuse(line, "two columns have the same name", _REMEDY)
            column_of_name[name], unit_of_name[name] = column, unit
    names = _find_coordinates(statements, line, header, column_of_name)
    orientation, quantities = _TARGET_COLUMNS[names]
    notation = _choose_notation(orientation, quantities, [unit_of_name[name] for name in names.split()])
    if notation is None:
        reason = "the columns of the targets have no units, different units, or units of another quantity"
        statements.refuse(line, reason, _REMEDY)
    first_row = dict(enumerate(cell.strip() for cell in first.split(delimiter)))
    frame_columns = {k: first_row.get(k, "") for k, text in enumerate(texts) if _FRAME_COLUMN.match(text)}
    external = [k for k, text in enumerate(texts) if _EXTERNAL.match(text)]
    places = [column_of_name[name] for name in names.split()]
    return _TableColumns(delimiter, len(texts), notation, places, frame_columns, external)


def _find_coordinates(
    statements: Statements, line: int, header: str, column_of_name: Mapping[str, int]
) -> str:
    """Return the names of the coordinates of targets in a table, as a key of `_TARGET_COLUMNS`.

    Raises:
        ProgramError: the table has no coordinates, or both poses and joint angles.
    """
    complete = [names for names in _TARGET_COLUMNS if column_of_name.keys() >= set(names.split())]
    are_joints = {_TARGET_COLUMNS[names][0] is Orientation.JOINTS for names in complete}
    if len(are_joints) > 1:
        reason = "the table has both poses and joint angles"
        statements.refuse(line, reason, "omit the poses or the joint angles")
    if not complete:
        reason = f"the header {quote_text(header)} does not name the coordinates of the targets"
        statements.refuse(line, reason, _REMEDY)
    return complete[0]  # the first one has the most columns: x, y, z alone come last


def _choose_notation(orientation: Orientation, quantities: str, units: list[str]) -> Notation | None:
    """Return the notation of columns with these units; None if the units do not fit the quantities.

    `quantities` has one letter for each column: l for length, a for angle, 1 for a ratio.
    """
    units_of: dict[str, set[str]] = {"l": set(), "a": set(), "1": set()}
    for quantity, unit in zip(quantities, units, strict=True):
        units_of[quantity].add(unit)
    lengths, angles, ratios = units_of.values()
    are_known = lengths <= _LENGTHS.keys() and angles <= _ANGLES.keys() and ratios <= {""}
    if not are_known or len(lengths) > 1 or len(angles) > 1:
        return None
    # Each set has one unit at most; without a unit no column has the quantity, and any unit serves.
    length_unit, angle_unit = next(iter(lengths), "mm"), next(iter(angles), "rad")
    length_decimals = 6 if lengths == {"mm"} else 9
    return Notation(orientation, _LENGTHS[length_unit], _ANGLES[angle_unit], length_decimals, 9)


LANGUAGE: Final = ir.Language(
    comment=r"(?!)", suffixes=".csv", read=read_table, constants={"base": np.eye(4)}
)
DECIMAL_COMMAS: Final = replace(LANGUAGE, number=ir.NUMBER.replace(r"\.", ",").replace("-.", "-,"))
