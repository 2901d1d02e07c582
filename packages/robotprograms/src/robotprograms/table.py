"""Targets in a table (CSV): a header names the columns and their units, each row is a target."""

from __future__ import annotations

import re
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
    source, masked_texts = (
        sources[0],
        statements.numerals[0].masked_texts(sources[0].starts, sources[0].ends)[0],
    )
    rows = ((i, masked) for i, masked in enumerate(masked_texts) if _is_row(masked))
    (head, _), (_, first) = next(rows, (0, "")), next(rows, (0, ""))  # header, and first row of targets
    if first:
        header = show_text(source.text[source.starts[head] : source.ends[head]])
        translate = partial(_translate_row, _parse_header(statements, head + 1, header, first))
        statements.add_statements(0, source.starts[head + 1 :], source.ends[head + 1 :], translate=translate)


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
    """Return the operations of a row, each with its number of lines below the row's line, which is 0.

    A row is one move; an empty line gives no move. If a cell is not a number or the tool changes, the move
    has a reason and is not corrected. `masked` is the row's text with NUL in place of each number.
    """
    if not _is_row(masked):
        return []
    cells, reason, remedy = masked.split(columns.delimiter), "", ""
    ends = [0, *accumulate(cell.count("\0") for cell in cells)]  # count of numbers before each cell
    wrong = next((k for k in columns.places if k < len(cells) and not _NUMBER.fullmatch(cells[k])), None)
    if len(cells) != columns.width:
        reason = f"the row has {len(cells)} columns instead of {columns.width}"
        remedy = "give every row as many columns as the header"
    elif wrong is not None:
        cell = ir.quote_statement(cells[wrong], range(ends[wrong], ends[-1]))
        reason = f"{cell} in column {wrong + 1} is not a number"
        remedy = "write numbers with decimal points" if "," in cell else "write a number"
    elif any(cells[k].strip() != text for k, text in columns.frame_columns.items()):
        reason, remedy = (
            "the tool or the base changes within the table",
            "send one table for each tool and base",
        )
    numbers = () if reason else tuple(ends[k] for k in columns.places)
    external, common = (
        () if reason else tuple(i for k in column_indices for i in range(ends[k], ends[k + 1]))
        for column_indices in (columns.external, columns.frame_columns)
    )
    target = Literal(columns.notation, numbers, external, common=common)
    motion, base = (Motion.JOINT, "base") if columns.notation.is_joints else (Motion.LINEAR, "part")
    bases, tools = (ir.Named(base),), (ir.Named("tool"),)
    return [(0, ir.Move(motion, (target,), bases, tools, reason=reason, remedy=remedy))]


def _parse_header(statements: Statements, line: int, header: str, first: str) -> _TableColumns:
    """Return the columns of a table; `first` is the first row with NUL in place of each number.

    Raises:
        ProgramError: the header does not name coordinates with their units, on its line `line`.
    """
    delimiter = max(";\t,", key=header.count)
    texts = header.split(delimiter)
    cells = [cell.strip().strip('"').strip().removeprefix("\xef\xbb\xbf") for cell in texts]
    matches = [_COLUMN_NAME.fullmatch(cell) for cell in cells]
    column_of_name = {m[1].lower(): i for i, m in enumerate(matches) if m}
    units = {m[1].lower(): (m[2] or "").lower() for m in matches if m}
    if len(column_of_name) < sum(map(bool, matches)):
        statements.refuse(line, "two columns have the same name", _REMEDY)
    fitting = [each for each in _TARGET_COLUMNS if column_of_name.keys() >= set(each.split())]
    if len({_TARGET_COLUMNS[each][0] is Orientation.JOINTS for each in fitting}) > 1:
        statements.refuse(
            line, "the table has both poses and joint angles", "omit the poses or the joint angles"
        )
    if not fitting:
        reason = f"the header {quote_text(header)} does not name the coordinates of the targets"
        statements.refuse(line, reason, _REMEDY)
    names = fitting[0].split()  # the first fit has the most columns: x, y, z alone come last
    notation = _choose_notation(*_TARGET_COLUMNS[fitting[0]], [units[name] for name in names])
    if notation is None:
        reason = "the columns of the targets have no units, different units, or units of another quantity"
        statements.refuse(line, reason, _REMEDY)
    first_row = dict(enumerate(cell.strip() for cell in first.split(delimiter)))
    frame_columns = {k: first_row.get(k, "") for k, text in enumerate(texts) if _FRAME_COLUMN.match(text)}
    external = [k for k, text in enumerate(texts) if _EXTERNAL.match(text)]
    places = [column_of_name[name] for name in names]
    return _TableColumns(delimiter, len(cells), notation, places, frame_columns, external)


def _choose_notation(orientation: Orientation, quantities: str, units: list[str]) -> Notation | None:
    """Return the notation of columns with these units; None if the units do not fit the quantities.

    `quantities` has one letter for each column: l for length, a for angle, 1 for a ratio.
    """
    pairs = list(zip(quantities, units, strict=True))
    lengths, angles, ratios = ({unit for quantity, unit in pairs if quantity == each} for each in "la1")
    if not (lengths <= _LENGTHS.keys() and angles <= _ANGLES.keys() and ratios <= {""}):
        return None
    if len(lengths) > 1 or len(angles) > 1:
        return None
    # Each set has one unit at most; the default is without effect, as then no column has the quantity.
    length, angle = _LENGTHS[[*lengths, "mm"][0]], _ANGLES[[*angles, "rad"][0]]
    return Notation(orientation, length, angle, 6 if lengths == {"mm"} else 9, 9)


LANGUAGE: Final = ir.Language(
    comment=r"(?!)", suffixes=".csv", read=read_table, constants={"base": np.eye(4)}
)
DECIMAL_COMMAS: Final = replace(LANGUAGE, number=ir.NUMBER.replace(r"\.", ",").replace("-.", "-,"))
