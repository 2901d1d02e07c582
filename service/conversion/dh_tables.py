"""Tables of Denavit and Hartenberg as papers and programs have them, for the model of a robot document."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from jointstiff.schemas.fields import Message
from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.solver.errors import RobotError

_NAMES: Final = {
    **{name: name for name in ("a", "alpha", "d", "theta", "lower", "upper", "speed", "kind")},
    **{"α": "alpha", "θ": "theta", "offset": "theta", "min": "lower", "max": "upper", "velocity": "speed"},
    "type": "kind",
    **dict.fromkeys(("i", "j", "joint", "link", "axis", "no", "nr", "#", "name", ""), "number"),
}
"""Name of a column, without its index, → our name; `number` for a column that numbers or names the rows."""
_REQUIRED: Final = ("a", "alpha", "d", "theta")
_LIMITS: Final = ("lower", "upper", "speed")
_HEADER: Final = re.compile(
    r"([^\W\d_]+|#|)[ _]?(?:\{?(?:[ij]|\d+)?([-\u2212]1)?\}?)? ?(?:[\[(]([^][()]+)[\])])?"
)
"""Name of a column, `-1` if it is that of the joint before, as in `a_{i-1}`, and unit."""
_JOINT_ANGLE: Final = re.compile(r"(?:θ|theta|q)_?(?:i|\d*)\*?\s*(?=[-+]|\Z)")
"""A joint's angle at the beginning of a cell of theta, as in `θ2 - 90`: the constant is what follows."""
_CELL: Final = re.compile(
    r"([-+]?)\s*((?:\d+\.?\d*|\.\d+)(?:e[-+]?\d{1,3})?)?(?:\s*\*?\s*(pi))?\s*(?:/\s*(\d+\.?\d*))?\s*(deg|°)?"
)
"""Sign, number, pi, divisor, and degrees."""
_MOST_CHARACTERS: Final = 60
"""Longest name of a column or text of a cell."""


class _Column(NamedTuple):
    """Name of a column: `alpha_{i-1} [deg]` is `alpha` of the joint before, in `deg`."""

    name: str
    unit: str | None  # None without a unit
    is_of_joint_before: bool  # whether it is named as in the modified convention


def convert_dh_rows(
    rows: Any,  # noqa: ANN401 - rows of a table
    convention: str | None,
    units: Mapping[str, str],
    *,
    columns: str | Sequence[str] | None = None,
    units_are_stated: bool = False,
) -> dict[str, Any]:
    """Convert the rows of a Denavit–Hartenberg table to the model of a robot document, in m and rad.

    Args:
        rows: a data frame, an array with names, or mappings, whose columns are named a, alpha, d, theta, and
            lower, upper, speed and kind if they are known, in any order, with or without units; or rows of
            cells, which need `columns`. A speed is per second. Cells are numbers, or texts such as `-90°`,
            `pi/2` or `θ2 - 90`. `DhRow`s are in m and rad.
        convention: `standard` or `modified`.
        units: units of the rows by `length` and `angle`.
        columns: names of the columns of rows without names, such as "theta d a alpha".
        units_are_stated: whether the caller stated these units; otherwise each column needs one in its name.

    Raises:
        RobotError: convention, names or units are missing, or a cell is not a number.
    """
    if convention not in {"standard", "modified"}:
        raise RobotError(
            f"the convention of the table is {convention!r}, not 'standard' or 'modified' (Craig)",
            where="convention",
            remedy="state convention='standard' or convention='modified'",
        )
    if isinstance(rows, Sequence) and rows and all(isinstance(row, Message) for row in rows):
        rows = [row.model_dump() for row in rows]
        units, units_are_stated = {"length": "m", "angle": "rad"}, True

    names, cells = _read_cells(rows)
    if bool(names) == (columns is not None):
        fault = (
            "given twice: by `columns` and by the table" if names else "neither in the table nor in `columns`"
        )
        raise RobotError(
            f"names of the columns are {fault}",
            where="columns",
            remedy="omit `columns`" if names else "state the order, such as columns='theta d a alpha'",
        )
    heads = [_read_header(name) for name in names or _split_columns(columns or ())]
    if not cells or any(len(row) != len(heads) for row in cells):
        lengths = sorted({len(row) for row in cells})
        raise RobotError(
            f"the table has {len(cells)} rows of {lengths} cells, but {len(heads)} columns have names",
            where="robot",
            remedy="give rows with one cell for each name",
        )
    _refuse_uncertain_columns(heads, convention, units_are_stated=units_are_stated)
    converted = [_convert_row(heads, row, units, number) for number, row in enumerate(cells)]
    return {"format": "dh", "convention": convention, "rows": converted}


def _read_cells(rows: Any) -> tuple[list[str], list[list[Any]]]:  # noqa: ANN401 - rows of a table
    """Return the names of a table's columns, none if it has no names, and its rows of cells.

    A data frame of pandas has whole numbers as names if the caller gave none, one of polars `column_0` and
    so on.
    """
    if isinstance(rows, Sequence) and rows and all(isinstance(row, Mapping) for row in rows):
        names = list(dict.fromkeys(name for row in rows for name in row))
        return [str(name) for name in names], [[row.get(name) for name in names] for row in rows]
    names = list(getattr(rows, "columns", getattr(getattr(rows, "dtype", None), "names", None) or ()))
    if all(name in (place, f"column_{place}") for place, name in enumerate(names)):
        names = []
    plain = rows.to_numpy() if hasattr(rows, "to_numpy") else rows
    plain = plain.tolist() if isinstance(plain, np.ndarray) else plain
    is_table = isinstance(plain, list | tuple) and all(isinstance(row, list | tuple) for row in plain)
    return [str(name) for name in names], [list(row) for row in plain] if is_table else []


def _split_columns(columns: str | Sequence[str]) -> list[str]:
    """Return the names of columns in a text, separated by commas or else by blanks, or in a list."""
    if not isinstance(columns, str):
        return [str(name) for name in columns]
    return [name.strip() for name in columns.split(",")] if "," in columns else columns.split()


def _read_header(header: str) -> _Column:
    """Return the name of a column without its index, and its unit.

    Raises:
        RobotError: the name is unknown.
    """
    text = " ".join(header.casefold().split())
    match = _HEADER.fullmatch(text) if len(text) <= _MOST_CHARACTERS else None
    if match is None or match[1] not in _NAMES:
        raise RobotError(
            f"the column '{header[:_MOST_CHARACTERS]}' of the table is unknown",
            where="columns",
            remedy="name the columns a, alpha, d, theta, and lower, upper, speed, kind if they are known",
        )
    name, unit = _NAMES[match[1]], match[3]
    if unit is not None:
        unit = unit.strip().removesuffix("/s") if name == "speed" else unit.strip()
        unit = "deg" if unit in {"°", "degrees", "degree"} else unit
    return _Column(name, unit, is_of_joint_before=bool(match[2]))


def _refuse_uncertain_columns(heads: Sequence[_Column], convention: str, *, units_are_stated: bool) -> None:
    """Refuse columns that occur twice, are missing, have no unit, or belong to the other convention.

    Raises:
        RobotError: names the columns.
    """
    names = [head.name for head in heads if head.name != "number"]
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    missing = [name for name in _REQUIRED if name not in names]
    if twice or missing:
        fault = f"two columns {twice[0]}" if twice else f"no column {' and no column '.join(missing)}"
        raise RobotError(
            f"the table has {fault}",
            where="columns",
            remedy="give a, alpha, d and theta once in every row; theta and d of the joint are constants",
        )
    lacking = [head.name for head in heads if head.unit is None and head.name not in {"kind", "number"}]
    if lacking and not units_are_stated:
        raise RobotError(
            f"the columns {', '.join(lacking)} of the table have no units",
            where="units",
            remedy="state units='mm, deg' or units='m, rad'",
        )
    if convention == "standard" and any(head.is_of_joint_before for head in heads):
        raise RobotError(
            "the names a_{i-1} or alpha_{i-1} of columns belong to the modified convention",
            where="convention",
            remedy="state convention='modified', or rename the columns to a and alpha",
        )


def _convert_row(
    heads: Sequence[_Column], row: Sequence[Any], units: Mapping[str, str], number: int
) -> dict[str, Any]:
    """Return a row in m and rad; an empty cell, and an infinite limit of a joint, is omitted.

    Raises:
        RobotError: a cell is not a number, or a unit is unknown.
    """
    converted: dict[str, Any] = {}
    for head, cell in zip(heads, row, strict=True):
        if head.name == "kind" and cell is not None:
            word = str(cell).casefold()
            converted["kind"] = {"p": "prismatic", "r": "revolute"}.get(word, word)
    for head, cell in zip(heads, row, strict=True):
        is_limit = head.name in _LIMITS
        is_missing = cell is None or (isinstance(cell, float) and math.isnan(cell))
        is_unlimited = is_limit and isinstance(cell, float) and math.isinf(cell)
        if head.name in {"kind", "number"} or is_missing or is_unlimited:
            continue
        is_length = head.name in "ad" or (is_limit and converted.get("kind") == "prismatic")
        unit = head.unit or units["length" if is_length else "angle"]
        size = (LENGTH if is_length else ANGLE).get(unit)
        value = None if size is None else _parse_cell(cell, size, is_length=is_length)
        if value is None:
            raise RobotError(
                f"{head.name} of row {number + 1}: '{cell}' is not a number in {unit}",
                where=f"rows[{number}].{head.name}",
                remedy="write a number, or an angle as -90°, pi/2 or θ2 - 90; units are m or mm, rad or deg",
            )
        converted[head.name] = value
    return converted


def _parse_cell(cell: object, size: float, *, is_length: bool) -> float | None:
    """Return the value of a cell in m or rad; None if the cell has no number.

    A text has a number, and in an angle the joint's own angle before it, pi, a divisor or a sign of degrees:
    `-90`, `−90°`, `pi/2`, `θ2 - 90` or `q3`. `size` is that of the column's unit [m or rad].
    """
    if not isinstance(cell, str):
        try:
            return float(cell) * size  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            return None
    text = cell[: _MOST_CHARACTERS + 1].strip().casefold().replace("\u2212", "-").replace("π", "pi")
    joint = None if is_length else _JOINT_ANGLE.match(text)
    rest = text[joint.end() :].strip() if joint else text
    if joint and not rest:
        return 0.0
    match = _CELL.fullmatch(rest) if len(cell) <= _MOST_CHARACTERS else None
    if match is None:
        return None
    sign, digits, pi, divisor, degrees = match.groups()
    has_number = bool(digits or pi)
    is_angle = bool(pi or divisor or degrees)
    if not has_number or (is_length and is_angle) or (divisor and float(divisor) == 0.0):
        return None
    value = float(digits or 1.0) * (math.pi if pi else 1.0) / float(divisor or 1.0)
    value = -value if sign == "-" else value
    if pi:
        return value
    return math.radians(value) if degrees else value * size
