"""Rows to records: what each row says of one observation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from jointstiff.schemas.importing import DecimalMark, ImportOptions, State
from jointstiff.service.importing.columns import Quantity
from jointstiff.service.importing.errors import Fault, Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grid import Grid, Row
from jointstiff.service.importing.header import DIMENSIONS, Kind
from jointstiff.service.importing.layout import Layout
from jointstiff.service.importing.naming import Naming, check_name
from jointstiff.service.importing.numbers import MarkedCell, decide_mark, read_number
from jointstiff.service.importing.row_names import Names
from jointstiff.service.importing.row_order import is_whole
from jointstiff.service.importing.units import INCH, Dimension

COVERAGE_FACTOR: Final = 2.0
"""Of the expanded uncertainties that trackers write, U(95)."""

Vector = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Point:
    """Three numbers of one target in one state."""

    target: str  # its name
    state: State  # of the robot, or `deflection` for the difference
    vector: Vector | None  # x, y, z in the unit of length; None if the cells are empty
    place: Place  # where it stands
    # standard uncertainty of a coordinate, in the unit of length, if the file has it
    sigma: float | None = None


@dataclass(frozen=True, slots=True)
class Record:
    """Content of one row."""

    label: str  # of the observation
    place: Place  # where it stands
    values: Mapping[Kind, Vector]  # joint angles, force, moment, load point, in the file's units
    points: tuple[Point, ...]  # readings
    whole: bool  # whether the row claims to be the only one of its observation in this file


def read_mark(grid: Grid, layout: Layout, options: ImportOptions) -> tuple[DecimalMark, str | None]:
    """The decimal mark of a file, and what was assumed for it; that of a sheet is always a point.

    Raises:
        ImportFileError: the file does not decide it.
    """
    if grid.format == "xlsx":
        return "point", None
    columns = [column for columns in layout.columns.quantities.values() for column in columns]
    cells = (
        MarkedCell(row.cells[column], row.line, column + 1)
        for row in layout.rows
        for column in columns
        if "." in row.cells[column] or "," in row.cells[column]
    )
    return decide_mark(grid.file, cells, options.decimal_mark)


def read_records(
    grid: Grid,
    layout: Layout,
    mark: DecimalMark,
    options: ImportOptions,
    labels: Sequence[str],
    notes: list[str],
    faults: Faults,
) -> Iterator[Record]:
    """Read all rows.

    Args:
        grid: the file.
        layout: its columns.
        mark: its decimal mark.
        options: of the caller.
        labels: of the observations by row, for a file without names.
        notes: where to tell what was assumed.
        faults: where to tell of cells that are not what their columns say, and of unclear names.
    """
    with faults.collected():
        rows = _Rows(layout, mark, labels, Names(grid, layout, options, notes), grid)
        for number, row in enumerate(layout.rows):
            if faults.full:
                return
            with faults.collected():
                yield rows.record(number, row, faults)


class _Rows:
    """The rows of a file, read by the meanings of its columns."""

    def __init__(
        self, layout: Layout, mark: DecimalMark, labels: Sequence[str], names: Names, grid: Grid
    ) -> None:
        self._grid, self._columns, self._mark, self._labels = grid, layout.columns, mark, labels
        self._names = names
        self._named = "name" in layout.columns.texts
        self._whole = is_whole(layout) and self._named
        self._expanded = {
            replace(quantity, kind="position"): indices
            for quantity, indices in layout.columns.quantities.items()
            if quantity.kind == "uncertainty"
        }
        units = layout.columns.units
        self._length = INCH if units.get("length") == "in" else 1.0
        self._targets: set[str] = set()

    def record(self, number: int, row: Row, faults: Faults) -> Record:
        """Read one row; faults in its cells are told, all of them."""
        naming = self._names.of(row)
        values: dict[Kind, Vector] = {}
        points: list[Point] = []
        for quantity, indices in self._columns.quantities.items():
            if quantity.kind == "uncertainty":
                continue
            vector = self._vector(row, indices, faults, DIMENSIONS[quantity.kind])
            place = self._grid.place(row, indices[0])
            if quantity.kind == "position":
                points.append(self._point(row, quantity, naming, vector, faults))
            elif vector is None:
                fault = ImportFileError(place, f"this row has no {quantity.kind}", "fill in the cells")
                faults.add(fault)
            else:
                values[quantity.kind] = vector
        label = (naming.label or "") if self._named else self._labels[number]
        return Record(label, self._grid.place(row), values, tuple(points), self._whole)

    def _point(
        self, row: Row, quantity: Quantity, naming: Naming, vector: Vector | None, faults: Faults
    ) -> Point:
        place = self._grid.place(row, self._columns.quantities[quantity][0])
        target, state = quantity.target or naming.target, quantity.state or naming.state
        if target is None or state is None:  # excluded by _Names
            raise ImportFileError(place, "the position has no target or no state", "give `point_name`")
        if target not in self._targets:
            _check_target(target, place)
            self._targets.add(target)
        expanded = self._expanded.get(quantity)
        sigma = None if expanded is None or vector is None else self._sigma(row, expanded, state, faults)
        return Point(target, state, vector, place, sigma)

    def _sigma(self, row: Row, indices: tuple[int, ...], state: State, faults: Faults) -> float | None:
        """Half of an expanded uncertainty, which has the coverage factor 2."""
        found = self._vector(row, indices, faults, "length")
        reason = ""
        if state == "deflection":
            reason = "an uncertainty of a deflection is not taken: those of its two positions are needed"
        elif found is None or (found and found[0] <= 0.0):
            reason = "an uncertainty must be positive"
        if reason:
            at = self._grid.place(row, indices[0])
            faults.add(ImportFileError(at, reason, "correct it, or skip the column with `ignore`"))
        return found[0] / COVERAGE_FACTOR if found else None

    def _vector(
        self, row: Row, indices: tuple[int, ...], faults: Faults, dimension: Dimension
    ) -> Vector | None:
        """The numbers of some columns; None if all of their cells are empty, () if one is faulty."""
        if not any(row.cells[index] for index in indices):
            return None
        try:
            numbers = [self._number(row, index) for index in indices]
        except ImportFileError:
            for index in indices:
                with faults.collected():
                    self._number(row, index)
            return ()
        if dimension == "length" and self._length != 1.0:
            return tuple(self._length * number for number in numbers)
        return tuple(numbers)

    def _number(self, row: Row, index: int) -> float:
        kind = "number" if row.kinds is None or not row.cells[index] else row.kinds[index]
        if kind != "number":
            raise ImportFileError(
                self._grid.place(row, index),
                f"a number is needed, but the cell has type {kind}: {shown(row.cells[index])}",
                "enter a number, and format the cell as a number; replace a formula without a stored value "
                "by its value",
            )
        try:
            return read_number(row.cells[index], self._mark)
        except Fault as fault:
            raise fault.at(self._grid.place(row, index)) from None


def _check_target(target: str, place: Place) -> None:
    try:
        check_name(target)
    except Fault as fault:
        raise fault.at(place) from None
