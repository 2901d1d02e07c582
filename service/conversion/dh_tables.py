"""Tables of Denavit and Hartenberg as papers and programs have them, for the model of a robot document."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from jointstiff.schemas.fields import Message
from jointstiff.service.conversion.dh_orders import refuse_wrong_order
from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.chain import LARGEST_LENGTH, LARGEST_OFFSET, LARGEST_TWIST

_CONVENTIONS: Final = {
    "mdh": "modified",
    "craig": "modified",
    "khalil": "modified",
    "proximal": "modified",
    "mod": "modified",
    "dh": "standard",
    "sdh": "standard",
    "classic": "standard",
    "classical": "standard",
    "distal": "standard",
    "spong": "standard",
}
"""Word for a convention in books and other packages, in lower case → our word."""
_COLUMNS: Final = ("a", "alpha", "d", "theta", "lower", "upper", "speed")
_LENGTHS: Final = frozenset("ad")
_LARGEST: Final = {
    "a": LARGEST_LENGTH,
    "alpha": LARGEST_TWIST,
    "d": LARGEST_OFFSET,
    "theta": LARGEST_TWIST,
}
"""Column → greatest number that a robot may have [m or rad]."""
_NAMES: Final = {
    "a": "a",
    "alpha": "alpha",
    "α": "alpha",
    "d": "d",
    "r": "r",
    "theta": "theta",
    "θ": "theta",
    "offset": "theta",
    "lower": "lower",
    "upper": "upper",
    "min": "lower",
    "max": "upper",
    "speed": "speed",
    "velocity": "speed",
    "kind": "kind",
    "type": "kind",
}
"""Names of columns, without their index such as in `a_i`, `alpha_{i-1}` or `θ1`."""
_NUMBERS: Final = frozenset(("i", "j", "joint", "link", "axis", "no", "nr", "#", "name", ""))
"""Names of columns that number or name the rows."""
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
_SHORTEST: Final = 0.05
"""Links of all rows together [m] below which the unit of a table is in doubt, unless it is stated."""
_RIGHT_ANGLE_DIGITS: Final = 2e-3
"""Distance from multiples of π/2 [rad] within which an angle counts as one of them."""


@dataclass(frozen=True)
class _Row:
    """Cells of a row by the names of their columns, and the units that its headers state."""

    cells: Mapping[str, Any]
    units: Mapping[str, str]
    names_joint_before: bool = False  # whether names are those of the modified convention, as `a_{i-1}`


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
        convention: `standard` or `modified`. With the latter, columns d and r without a are Khalil's: r is
            the length along z.
        columns: names of the columns of rows without names, such as "theta d a alpha".
        units: units of the rows by `length` and `angle`.
        units_are_stated: whether the caller stated these units; columns with names need this, or units in
            their names.

    Raises:
        RobotError: the convention is missing, a row is not understood, or its units are in doubt.
    """
    if convention not in {"standard", "modified"}:
        fault = "is not stated" if convention is None else f"is {convention!r}, which is not known"
        meant = _CONVENTIONS.get(str(convention).lower())
        choice = f"convention={meant!r}" if meant else "convention='standard' or 'modified' (Craig)"
        raise RobotError(
            f"the convention of the Denavit-Hartenberg table {fault}",
            where="convention",
            remedy=f"state {choice}: js.robot(rows, convention={meant or 'modified'!r})",
        )
    model = {"format": "dh", "convention": convention}
    are_messages = isinstance(rows, Sequence) and rows and all(isinstance(row, Message) for row in rows)
    if are_messages and columns is None:
        return model | {"rows": [row.model_dump() for row in rows]}
    table = _read_table(rows, columns, convention)
    names_state_units = any(row.units for row in table.rows)
    if (table.has_names or names_state_units) and not units_are_stated:
        _refuse_names_without_units(table.rows)
    _refuse_names_of_joint_before(table.rows, convention)
    if not (table.has_names or names_state_units):
        _refuse_wrong_order(rows, columns or (), units)
    converted = [_convert_row(row, units, number) for number, row in enumerate(table.rows)]
    _refuse_impossible_numbers(converted, table.rows, units)
    if not (table.has_names or names_state_units or units_are_stated):
        _refuse_doubtful_units(converted, units)
    return model | {"rows": converted}


def _refuse_wrong_order(
    rows: Any,  # noqa: ANN401 - rows of a table
    columns: str | Sequence[str],
    units: Mapping[str, str],
) -> None:
    """Raise a `RobotError` if rows without names seem to have their columns in another order than stated."""
    names = [_read_column(name) for name in _split_columns(columns)]
    stated = ["" if name is None else name.name for name in names]
    if "r" not in stated:  # the letter of Khalil's tables, whose d is our a
        refuse_wrong_order(_list_cells(rows), stated, units, _parse_any_cell)


def _parse_any_cell(cell: object, size: float, is_length: bool) -> float | None:
    """Return the value of a cell in m or rad, zero for an empty cell; None if the cell has no number."""
    return 0.0 if _is_missing(cell, is_limit=False) else _parse_cell(cell, size, is_length=is_length)


def _refuse_impossible_numbers(
    converted: Sequence[Mapping[str, Any]], rows: Sequence[_Row], units: Mapping[str, str]
) -> None:
    """Refuse a length or an angle that no arm has, in the unit in which it was stated.

    Raises:
        RobotError: names the number.
    """
    for number, (values, row) in enumerate(zip(converted, rows, strict=True)):
        for name, largest in _LARGEST.items():
            quantity = "length" if name in _LENGTHS else "angle"
            unit = row.units.get(name, units[quantity])
            value = values.get(name, 0.0) / (LENGTH | ANGLE)[unit]
            most = largest / (LENGTH | ANGLE)[unit]
            if most * (1.0 + 1e-9) < abs(value) < math.inf:
                other = "m, rad" if unit in {"mm", "deg"} else "mm, deg"
                raise RobotError(
                    f"{name} of row {number + 1} is {value:.6g} {unit}, beyond ±{most:.6g} {unit}",
                    where=f"rows[{number}].{name}",
                    remedy="check the number, the name of its column and its unit: js.robot(rows, "
                    f"convention=…, units='{other}')",
                )


class _Table(NamedTuple):
    """Rows of a Denavit-Hartenberg table."""

    rows: list[_Row]
    has_names: bool  # whether the table names its columns itself


def _read_table(
    rows: Any,  # noqa: ANN401 - rows of a table
    columns: str | Sequence[str] | None,
    convention: str,
) -> _Table:
    """Return the rows of a table with the names of their columns, which the table or `columns` has.

    Raises:
        RobotError: names are given twice or not at all, or a row is not understood.
    """
    named = _read_named_rows(rows, convention)
    if not named:
        return _Table(_read_plain_rows(rows, columns, convention), has_names=False)
    if columns is not None:
        raise RobotError(
            "names of the columns are given twice: by `columns` and by the table",
            where="columns",
            remedy="omit `columns`, or give the rows without names",
        )
    return _Table(named, has_names=True)


def _refuse_names_of_joint_before(rows: Sequence[_Row], convention: str) -> None:
    """Raise a `RobotError` if a table of the standard convention has names as `a_{i-1}`."""
    if convention == "standard" and any(row.names_joint_before for row in rows):
        raise RobotError(
            "the names a_{i-1} or alpha_{i-1} of columns belong to the modified convention, but the stated "
            "convention is standard",
            where="convention",
            remedy="state convention='modified', or rename the columns to a and alpha",
        )


def _read_plain_rows(
    rows: Any,  # noqa: ANN401 - rows of a table
    columns: str | Sequence[str] | None,
    convention: str,
) -> list[_Row]:
    """Return rows without names, by the names that `columns` states.

    Raises:
        RobotError: `columns` is missing, a name is unknown, occurs twice or is missing, or a row has another
            number of cells.
    """
    cells = _list_cells(rows)
    widths = {len(row) for row in cells}
    if len(widths) == 1 and columns is None:
        raise RobotError(
            "the columns of the table have no names, and their order is unknown, because tables print a, "
            "alpha, d and theta in many orders",
            where="columns",
            remedy="state the order, such as js.robot(rows, columns='theta d a alpha', convention=…), or "
            "give a data frame or mappings with these names",
        )
    names = _split_columns(columns or ())
    if widths != {len(names)}:
        shape = f"({len(cells)}, {'/'.join(map(str, sorted(widths)))})"
        raise RobotError(
            f"the table has the shape {shape}, but `columns` has {len(names)} names",
            where="robot",
            remedy="give rows with one cell for each of a, alpha, d, theta, and of lower, upper, speed and "
            "kind if they are known",
        )
    return [_name_cells(list(zip(names, row, strict=True)), convention) for row in cells]


def _list_cells(rows: Any) -> list[list[Any]]:  # noqa: ANN401 - rows of a table
    """Return the rows of an array, a data frame or nested lists as lists of cells; [] for anything else."""
    plain = rows.tolist() if hasattr(rows, "tolist") else rows
    plain = plain.to_numpy().tolist() if hasattr(plain, "to_numpy") else plain
    try:
        return [list(row) for row in plain]
    except TypeError:
        return []


def _split_columns(columns: str | Sequence[str]) -> list[str]:
    """Return the names of columns in a text, separated by commas or else by blanks, or in a list."""
    if not isinstance(columns, str):
        return [str(name) for name in columns]
    return [name.strip() for name in columns.split(",")] if "," in columns else columns.split()


def _read_named_rows(rows: Any, convention: str) -> list[_Row] | None:  # noqa: ANN401
    """Return the rows of a table whose columns have names; None if they have none.

    Raises:
        RobotError: a name is unknown, occurs twice or is missing.
    """
    cells = _list_named_cells(rows)
    return None if cells is None else [_name_cells(row, convention) for row in cells]


def _list_named_cells(rows: Any) -> list[list[tuple[Any, Any]]] | None:  # noqa: ANN401 - rows of a table
    """Return (name of the column, cell) for each cell of each row; None if the columns have no names.

    A data frame of pandas has whole numbers as names if the caller gave none, one of polars `column_0` and
    so on.
    """
    is_frame = hasattr(rows, "columns")
    if is_frame and hasattr(rows, "itertuples"):  # of pandas
        names = list(rows.columns)
        if not all(isinstance(name, str) for name in names):
            return None
        return [list(zip(names, row, strict=True)) for row in rows.itertuples(index=False, name=None)]
    if is_frame and hasattr(rows, "to_dicts"):  # of polars
        automatic = [f"column_{place}" for place in range(len(rows.columns))]
        return None if list(rows.columns) == automatic else [list(row.items()) for row in rows.to_dicts()]
    if getattr(getattr(rows, "dtype", None), "names", None):  # an array with names
        return [list(zip(rows.dtype.names, row, strict=True)) for row in rows.tolist()]
    if isinstance(rows, Sequence) and rows and all(isinstance(row, Mapping | Message) for row in rows):
        return [list(dict(row).items()) for row in rows]
    return None


def _name_cells(row: Sequence[tuple[Any, Any]], convention: str) -> _Row:
    """Return a row, given as pairs of a column's name and a cell, with the cells under our names.

    Raises:
        RobotError: a name is unknown, occurs twice, is missing, or has two meanings.
    """
    cells: dict[str, Any] = {}
    units: dict[str, str] = {}
    names_joint_before = False
    for header, cell in row:
        column = _read_column(str(header))
        if column is not None and column.is_number_of_row:
            continue
        if column is None or column.name in cells:
            fault = "is unknown" if column is None else "occurs twice"
            raise RobotError(
                f"the column '{header}' of the table {fault}",
                where="robot",
                remedy="name the columns a, alpha, d, theta, and lower, upper, speed, kind if they are known",
            )
        cells[column.name] = cell
        names_joint_before |= column.is_of_joint_before
        if column.unit is not None:
            units[column.name] = column.unit
    _translate_length_along_z(cells, units, convention)
    if missing := {"a", "alpha", "d", "theta"} - cells.keys():
        raise RobotError(
            f"the table has no column {' and no column '.join(sorted(missing))}",
            where="robot",
            remedy="give a, alpha, d and theta in every row; theta and d of the joint itself are constants",
        )
    return _Row(cells, units, names_joint_before)


class _Column(NamedTuple):
    """Name of a column: `alpha_{i-1} [deg]` is `alpha` of the joint before, in `deg`."""

    name: str
    unit: str | None  # None without a unit
    is_of_joint_before: bool = False  # whether it is named as in the modified convention
    is_number_of_row: bool = False  # whether the column numbers or names the rows


def _read_column(header: str) -> _Column | None:
    """Return the name of a column without its index, and its unit; None if it is unknown."""
    text = " ".join(header.casefold().split())
    match = _HEADER.fullmatch(text) if len(text) <= _MOST_CHARACTERS else None
    if match is None:
        return None
    name = _NAMES.get(match[1])
    if name is None:
        return _Column(match[1], None, is_number_of_row=True) if match[1] in _NUMBERS else None
    unit: str | None = None
    if match[3]:
        unit = match[3].strip()
        unit = unit.removesuffix("/s") if name == "speed" else unit
        unit = "deg" if unit in {"°", "degrees", "degree"} else unit
    return _Column(name, unit, is_of_joint_before=bool(match[2]))


def _translate_length_along_z(cells: dict[str, Any], units: dict[str, str], convention: str) -> None:
    """Rename the columns of a table with the length r: Khalil's d and r are a and d here.

    Raises:
        RobotError: r may be the length along x or along z.
    """
    if "r" not in cells:
        return
    is_khalils = convention == "modified" and "a" not in cells
    replaces_d = "a" in cells and "d" not in cells
    if not (is_khalils or replaces_d):
        raise RobotError(
            "the column r is ambiguous: in some tables r is the length along x, in other tables the length "
            "along z",
            where="columns",
            remedy="name the length along x a, and the length along z d",
        )
    renamed = {"d": "a", "r": "d"} if is_khalils else {"r": "d"}
    for old, new in renamed.items():
        for column in (cells, units):
            if old in column:
                column[new] = column.pop(old)


def _convert_row(row: _Row, units: Mapping[str, str], number: int) -> dict[str, Any]:
    """Return a row in m and rad; a limit without a number is omitted.

    Raises:
        RobotError: a cell is not a number, or a unit is unknown.
    """
    kind = str(row.cells.get("kind") or "revolute").casefold()
    kind = {"p": "prismatic", "r": "revolute"}.get(kind, kind)
    converted: dict[str, Any] = {"kind": kind} if "kind" in row.cells else {}
    for name in _COLUMNS:
        cell = row.cells.get(name)
        is_limit = name in {"lower", "upper", "speed"}
        if _is_missing(cell, is_limit=is_limit):
            continue
        is_length = name in _LENGTHS or (kind == "prismatic" and is_limit)
        unit = row.units.get(name, units["length" if is_length else "angle"])
        size = (LENGTH if is_length else ANGLE).get(unit)
        value = None if size is None else _parse_cell(cell, size, is_length=is_length)
        if value is None:
            fault = f"'{unit}' is not a known unit" if size is None else f"'{cell}' is not a number"
            raise RobotError(
                f"{name} of row {number + 1}: {fault}",
                where=f"rows[{number}].{name}",
                remedy="write a number, or an angle as -90°, pi/2 or θ2 - 90; units are m or mm, rad or deg",
            )
        converted[name] = value
    return converted


def _is_missing(cell: object, *, is_limit: bool) -> bool:
    """Return whether a cell is None or NaN, or is an infinite limit of a joint: the joint has no limit."""
    if not isinstance(cell, float):
        return cell is None
    return math.isnan(cell) or (is_limit and math.isinf(cell))


def _parse_cell(cell: object, size: float, *, is_length: bool) -> float | None:
    """Return the value of a cell in m or rad; None if the cell has no number.

    Args:
        cell: number, or a text such as `-90`, `−90°`, `pi/2`, `θ2 - 90` or `q3`.
        size: size of the unit of the column [m or rad].
        is_length: whether the cell is a length, in which only numbers are read.
    """
    if not isinstance(cell, str):
        try:
            return float(cell) * size  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            return None
    if len(cell) > _MOST_CHARACTERS:
        return None
    text = cell.strip().casefold().replace("\u2212", "-").replace("π", "pi")
    joint = None if is_length else _JOINT_ANGLE.match(text)
    rest = text[joint.end() :].strip() if joint else text
    if joint and not rest:
        return 0.0
    return _parse_term(rest, size, is_length=is_length)


def _parse_term(text: str, size: float, *, is_length: bool) -> float | None:
    """Return a number such as `-90`, `1.5e2`, `90°`, `-pi/2` or `3 pi / 4` in m or rad; None for other texts.

    A term with pi is in rad, one with a sign of degrees in degrees, any other in the unit of size `size`
    [m or rad]. A length has neither pi, nor divisor, nor degrees.
    """
    match = _CELL.fullmatch(text)
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


def _refuse_names_without_units(rows: Sequence[_Row]) -> None:
    """Refuse columns with names but without units.

    Raises:
        RobotError: a column has no unit in its name.
    """
    lacking = {name for row in rows for name in row.cells.keys() - row.units.keys() - {"kind"}}
    if lacking:
        raise RobotError(
            f"the columns {', '.join(sorted(lacking))} of the table have no units",
            where="units",
            remedy="state units='mm, deg, N' or units='m, rad, N'",
        )


def _refuse_doubtful_units(rows: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> None:
    """Refuse a table whose lengths seem to be in m, or whose angles in rad, although no unit was stated.

    Raises:
        RobotError: the links are shorter together than any robot's, or angles are π/2 in the unit of degrees.
    """
    length = sum(abs(row.get(name, 0.0)) for row in rows for name in _LENGTHS)
    believed = []
    if 0.0 < length < _SHORTEST:
        believed.append(f"the links are {1e3 * length:.3g} mm long together")
    right_angle = _find_right_angle_in_rad(rows) if units["angle"] == "deg" else None
    if right_angle is not None:
        believed.append(f"an angle is {right_angle:.5g}°, as π/2 or π in rad")
    if believed:
        raise RobotError(
            f"the units of the table are in doubt: {', and '.join(believed)}",
            where="units",
            remedy="state the units: js.robot(rows, convention=…, units='m, rad, N') or units='mm, deg, N'",
        )


def _find_right_angle_in_rad(rows: Sequence[Mapping[str, Any]]) -> float | None:
    """Return the first angle of 1.5708° or a multiple, which is π/2 or π if it was meant in rad.

    None without such an angle, and if an angle is more than a turn, 2.1 π, in rad: then degrees were meant.
    """
    angles = [row.get(name, 0.0) for row in rows for name in ("alpha", "theta")]
    degrees = np.abs(np.array(angles)) / ANGLE["deg"]
    quarters = degrees / (0.5 * np.pi)
    are_right = (degrees > 1.0) & (np.abs(quarters - np.round(quarters)) < _RIGHT_ANGLE_DIGITS)
    exceed_turn = degrees > 2.1 * np.pi
    return None if exceed_turn.any() or not are_right.any() else float(degrees[are_right][0])
