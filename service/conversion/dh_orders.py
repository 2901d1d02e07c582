"""The order of the columns of a Denavit-Hartenberg table without names, checked by the numbers.

Tables print a, alpha, d and theta in many orders. Lengths in a column of angles are beyond a turn, and angles
in a column of lengths are multiples of a right angle, or have a sign of degrees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.solver.errors import RobotError

_PRINTED: Final = (
    "theta d a alpha",
    "a alpha d theta",
    "alpha a theta d",
    "alpha a d theta",
    "d theta a alpha",
    "a alpha theta d",
    "a d alpha theta",
    "d a alpha theta",
    "theta alpha a d",
    "theta alpha d a",
    "theta d alpha a",
    "alpha theta a d",
    "alpha theta d a",
    "d a theta alpha",
    "a d theta alpha",
    "theta a d alpha",
    "d theta alpha a",
    "alpha d a theta",
    "d alpha a theta",
    "a theta d alpha",
    "d alpha theta a",
    "a theta alpha d",
    "theta a alpha d",
    "alpha d theta a",
)
"""All orders of the four columns; those that textbooks and makers print are first."""
_ANGLES: Final = frozenset(("alpha", "theta"))
_TURN: Final = 2.0 * math.pi * (1.0 + 1e-9)
"""Greatest angle of a table [rad], with rounding."""
_CLOSE: Final = 2e-3
"""Greatest distance of an angle [rad] from a multiple of 15° or 90° that counts as the multiple."""
_CALIBRATED: Final = math.radians(3.0)
"""Greatest change of an angle by a calibration [rad]."""
_SHORTEST, _LONGEST = 0.05, 100.0
"""Least length of all links together, and greatest length of a link, that a table may have [m]."""
_FEWEST: Final = 2
"""Least number of multiples of a right angle in a column that is taken for angles."""

Parse = Callable[[Any, float, bool], float | None]
"""Function that reads a cell: cell, size of its unit [m or rad], and whether it is a length → m or rad."""


@dataclass(frozen=True)
class _Cells:
    """Numbers of a column of a table, as lengths and as angles."""

    texts: Sequence[str]  # cells as they are written
    lengths: Sequence[float | None]  # [m]; None for a cell that is no length
    angles: Sequence[float | None]  # [rad]; None for a cell that is no angle
    #: numbers of the cells as an angle in the unit of the table [rad], whatever they are
    in_angle_unit: Sequence[float | None]

    def count_nonzero_angles(self) -> int:
        """Return the number of cells that are not zero, as angles."""
        return sum(1 for angle in self.angles if angle)

    def are_right_angles(self) -> bool:
        """Return whether several cells are not zero, and each of these is a multiple of a right angle."""
        nonzero = [angle for angle in self.in_angle_unit if angle is None or abs(angle) > _CLOSE]
        return len(nonzero) >= _FEWEST and all(_is_multiple(angle, 90.0) for angle in nonzero)


def refuse_wrong_order(
    rows: Sequence[Sequence[Any]], names: Sequence[str], units: Mapping[str, str], parse: Parse
) -> None:
    """Refuse a table whose columns seem to be in another order, or in other units, than is stated.

    Args:
        rows: cells of the table.
        names: names of the columns; only a, alpha, d and theta are checked, if all of them are there.
        units: units of the table by `length` and `angle`.
        parse: function that reads a cell.

    Raises:
        RobotError: names the cell that does not fit, and the order that fits.
    """
    positions = [place for place, name in enumerate(names) if name in {"a", "d"} | _ANGLES]
    stated = [names[place] for place in positions]
    if sorted(stated) != sorted({"a", "d"} | _ANGLES):
        return
    columns = [_read_column([row[place] for row in rows], units, parse) for place in positions]
    fault = next(_list_faults(stated, columns, units), None)
    fitting = _find_fitting_order(columns)
    if fault is None:
        # Lengths may be multiples of 90 by chance: another order must be without a doubt.
        if fitting is None or _fits(stated, columns):
            return
        fault = _find_angles_among_lengths(stated, columns) or _find_odd_twists(stated, columns, units)
    if fault is not None:
        other_unit = "deg" if units["angle"] == "rad" else "rad"
        in_other_unit = [
            _read_column([row[place] for row in rows], {**units, "angle": other_unit}, parse)
            for place in positions
        ]
        if _fits(stated, in_other_unit):
            remedy = f"state units='{units['length']}, {other_unit}', which fits every angle"
        elif fitting is not None and fitting != stated:
            remedy = (
                f"compare the order with the head of the table: columns='{' '.join(fitting)}' fits, as "
                f"{_describe_columns(fitting, positions)}"
            )
        else:
            remedy = (
                "check the number, the order of the columns and the units: js.robot(rows, columns="
                f"'{' '.join(stated)}', units='{units['length']}, {units['angle']}', convention=…)"
            )
        raise RobotError(fault, where="columns", remedy=remedy)


def _read_column(cells: Sequence[Any], units: Mapping[str, str], parse: Parse) -> _Cells:
    """Return the numbers of a column."""
    length, angle = LENGTH[units["length"]], ANGLE[units["angle"]]
    lengths = [parse(cell, length, True) for cell in cells]
    return _Cells(
        texts=[str(cell) for cell in cells],
        lengths=lengths,
        angles=[parse(cell, angle, False) for cell in cells],
        in_angle_unit=[None if each is None else each / length * angle for each in lengths],
    )


def _list_faults(stated: Sequence[str], columns: Sequence[_Cells], units: Mapping[str, str]) -> Iterator[str]:
    """Yield the cells that cannot be in the column of the stated name: long angles, and angles as lengths."""
    size, unit = ANGLE[units["angle"]], "°" if units["angle"] == "deg" else " rad"
    for name, column in zip(stated, columns, strict=True):
        for row, (length, angle) in enumerate(zip(column.lengths, column.angles, strict=True), 1):
            if name in _ANGLES and angle is not None and _TURN < abs(angle) < math.inf:
                yield f"{name} of row {row} is {angle / size:.6g}{unit}, beyond a turn"
            elif name not in _ANGLES and length is None and angle is not None:
                yield f"{name} of row {row}: '{column.texts[row - 1][:40]}' is not a number: it is an angle"


def _find_angles_among_lengths(stated: Sequence[str], columns: Sequence[_Cells]) -> str | None:
    """Return the fault of a column of lengths whose numbers are right angles; None without one."""
    for name, column in zip(stated, columns, strict=True):
        if name not in _ANGLES and column.are_right_angles():
            return f"the numbers of the column {name}, {', '.join(column.texts[:8])}, seem to be angles"
    return None


def _find_odd_twists(
    stated: Sequence[str], columns: Sequence[_Cells], units: Mapping[str, str]
) -> str | None:
    """Return the fault of a column alpha with several odd angles, as no arm has; None without them."""
    column = columns[stated.index("alpha")]
    size, unit = ANGLE[units["angle"]], "°" if units["angle"] == "deg" else " rad"
    odd = [
        (row, angle)
        for row, angle in enumerate(column.angles, 1)
        if angle is not None and not _is_multiple(angle, 15.0, _CALIBRATED)
    ]
    if len(odd) < _FEWEST:
        return None
    row, angle = odd[0]
    return f"alpha of row {row} is {angle / size:.6g}{unit}, which is no angle between axes of an arm"


def _find_fitting_order(columns: Sequence[_Cells]) -> list[str] | None:
    """Return the order of names that fits the columns best; None if no order fits.

    Of two columns of angles, that with more right angles is rather alpha: each axis but the parallel ones is
    turned.
    """
    fitting = [order.split() for order in _PRINTED if _fits(order.split(), columns)]
    if not fitting:
        return None

    def has_more_thetas(order: Sequence[str]) -> bool:
        """Return whether fewer cells of alpha than of theta are not zero."""
        counts = {name: column.count_nonzero_angles() for name, column in zip(order, columns, strict=True)}
        return counts["alpha"] < counts["theta"]

    return min(fitting, key=has_more_thetas)


def _fits(order: Sequence[str], columns: Sequence[_Cells]) -> bool:
    """Return whether the columns are plausible in an order: angles of whole 15°, and lengths of an arm."""
    total = 0.0
    for name, column in zip(order, columns, strict=True):
        if name in _ANGLES:
            if not all(_is_multiple(angle, 15.0) for angle in column.angles):
                return False
            continue
        lengths = [abs(math.inf if length is None else length) for length in column.lengths]
        if column.are_right_angles() or max(lengths) > _LONGEST:
            return False
        total += sum(lengths)
    return total > _SHORTEST


def _is_multiple(angle: float | None, degrees: float, close: float = _CLOSE) -> bool:
    """Return whether an angle [rad] is within a turn, and a multiple of so many degrees to within `close`."""
    if angle is None or not abs(angle) <= _TURN:
        return False
    return abs(math.remainder(angle, math.radians(degrees))) <= close


def _describe_columns(order: Sequence[str], positions: Sequence[int]) -> str:
    """Return which columns of a table look like angles, and which like lengths."""
    numbers: dict[bool, list[str]] = {True: [], False: []}
    for name, place in zip(order, positions, strict=True):
        numbers[name in _ANGLES].append(str(place + 1))
    return (
        f"columns {' and '.join(numbers[False])} look like lengths, {' and '.join(numbers[True])} like angles"
    )
