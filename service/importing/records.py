"""Rows to records: what each row says of one observation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

from jointstiff.schemas.importing import State
from jointstiff.service.importing.errors import Fault, Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grid import Row
from jointstiff.service.importing.header import DIMENSIONS, POINTS, Quantity, along_axis
from jointstiff.service.importing.layout import Layout
from jointstiff.service.importing.names import Names, Naming, check_name, is_whole
from jointstiff.service.importing.numbers import read_number
from jointstiff.service.importing.surroundings import Surroundings
from jointstiff.service.importing.words import INCH, Dimension, Kind

COVERAGE_FACTOR: Final = 1.96
"""Of the expanded uncertainties that trackers write, U(95)."""
_LEAST: Final = 5e-4
"""Greatest expanded uncertainty that is rounded to 0, in mm: trackers write whole micrometres."""

Vector = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Point:
    """Three numbers of one target in one state, or one along an axis."""

    target: str  # its name
    state: State  # state of the robot, or `deflection` for the difference
    vector: Vector | None  # x, y, z in the unit of length; None if the cells are empty
    place: Place  # where it stands
    # standard uncertainty of each coordinate, in the unit of length, if the file has it
    sigma: Vector | None = None
    along: tuple[str, int] | None = None  # target and axis of R0 that one number was read along
    by_point: bool = False  # whether it is that of the point, shared by its coordinates


@dataclass(frozen=True, slots=True)
class Record:
    """Content of one row."""

    label: str  # label of the observation
    place: Place  # where it stands
    values: Mapping[Kind, Vector]  # joint angles, force, moment, load point, in the file's units
    points: tuple[Point, ...]  # readings
    whole: bool  # whether the row claims to be the only one of its observation in this file
    held_out: bool  # whether a column says that the observation is held out from the fit


class RowReader:
    """Read the rows of a file by the meanings of its columns."""

    def __init__(
        self, layout: Layout, names: Names, labels: Sequence[str], surroundings: Surroundings
    ) -> None:
        self._grid, self._columns, self._labels = layout.grid, layout.columns, labels
        self._mark = layout.mark or "point"
        self._rows, self._names, self._surroundings = layout.rows, names, surroundings
        self._named = "name" in layout.columns.texts
        self._whole = is_whole(layout) and self._named
        self._length = INCH if layout.columns.units.get("length") == "in" else 1.0
        self._least = _LEAST / 1e3 if layout.columns.units.get("length") == "m" else _LEAST
        self._targets: set[str] = set()

    def records(self, faults: Faults) -> Iterator[Record]:
        """Yield what each row says; unclear names and cells that do not fit their columns are faults.

        Names that are unclear for the same reason are one fault.
        """
        unnamed: dict[str, ImportFileError] = {}  # the first of each reason
        count: Counter[str] = Counter()
        times = [i for i, meaning in enumerate(self._columns.meanings) if meaning.kind == "time"]
        for number, row in enumerate(self._rows):
            if faults.full:
                break
            try:
                naming = self._names.of(row)
            except ImportFileError as fault:
                unnamed.setdefault(fault.remedy, fault)
                count[fault.remedy] += 1
                continue
            with faults.collected():
                yield self._record(number, row, naming, faults)
        for first in unnamed.values():
            others = (
                count[first.remedy] - 1 if first.place.line else 0
            )  # of the file's name there is one only
            more = f", and {others} other names are not clear either" if others else ""
            faults.report(first.place, first.reason + more, first.remedy, first.option, first.words)
        self._surroundings.add_times([[row.cells[column] for column in times] for row in self._rows if times])

    def _record(self, number: int, row: Row, naming: Naming, faults: Faults) -> Record:
        """Read one row; faults in its cells are told, all of them."""
        values: dict[Kind, Vector] = {}
        points: list[Point] = []
        for quantity, indices in self._columns.quantities.items():
            if quantity.kind in POINTS - {"position", "along"}:
                continue
            vector = self._vector(row, indices, faults, DIMENSIONS[quantity.kind])
            if quantity.kind == "along" and vector is None:
                continue  # a gauge reads one direction in a posture, and another in the next
            if quantity.kind in POINTS:
                vector = self._with_addition(row, quantity, vector, faults)
                points.append(self._point(row, quantity, naming, vector, faults))
            elif vector is None:
                place = self._grid.place(row, indices[0])
                faults.report(place, f"this row has no {quantity.kind}", "fill in the cells")
            else:
                values[quantity.kind] = vector
        temperature = self._columns.texts.get("temperature")
        if temperature is not None:
            unit = self._columns.meanings[temperature].unit or ""
            self._surroundings.add_temperature(row.cells[temperature], unit, self._mark)
        validation = self._columns.texts.get("validation")
        held = "0" if validation is None else row.cells[validation].strip() or "0"
        if validation is not None and held not in ("0", "1"):
            place = self._grid.place(row, validation)
            faults.report(place, f"{shown(held)} is neither 0 nor 1", "write 1 to hold it out from the fit")
        label = (naming.label or "") if self._named else self._labels[number]
        return Record(label, self._grid.place(row), values, tuple(points), self._whole, held == "1")

    def _with_addition(
        self, row: Row, position: Quantity, vector: Vector | None, faults: Faults
    ) -> Vector | None:
        """Return a position with the deviation that columns `plus x` add to it, if there are any."""
        indices = self._columns.quantities.get(replace(position, kind="addition"))
        if indices is None or not vector:
            return vector
        added = self._vector(row, indices, faults, "length")
        if added is None:
            faults.report(
                self._grid.place(row, indices[0]), "the deviation to be added is empty", "fill it in"
            )
        return tuple(map(sum, zip(vector, added or (), strict=False)))

    def _point(
        self, row: Row, quantity: Quantity, naming: Naming, vector: Vector | None, faults: Faults
    ) -> Point:
        place = self._grid.place(row, self._columns.quantities[quantity][0])
        target, state = quantity.target or naming.target, quantity.state or naming.state
        if target is None or state is None:  # excluded by Names
            raise ImportFileError(place, "the position has no target or no state", "give `point_name`")
        if target not in self._targets:
            try:
                check_name(target)
            except Fault as fault:
                raise fault.at(place) from None
            self._targets.add(target)
        sigma, by_point = None, False
        if vector is not None:
            sigma, by_point = self._sigma(row, quantity, state, faults)
        along = along_axis(target) if quantity.kind == "along" else None
        return Point(target, state, vector, place, sigma, along, by_point)

    def _sigma(
        self, row: Row, position: Quantity, state: State, faults: Faults
    ) -> tuple[Vector | None, bool]:
        """Standard uncertainties of x, y and z, and whether they are the point's, shared by them.

        By U(95) X, Y, Z: U/1.96; only where these are missing by the point's U(95): U/(1.96 √3).
        """
        quantities = self._columns.quantities
        columns: tuple[int, ...] = ()
        for kind in ("uncertainty", "point uncertainty"):
            of_kind = quantities.get(replace(position, kind=kind))
            expanded = None if of_kind is None else self._vector(row, of_kind, faults, "length")
            columns = columns or of_kind or ()
            if expanded is not None:
                break
        if not columns:
            return None, False
        reason = ""
        if state == "deflection":
            reason = "an uncertainty of a deflection cannot be used: give those of its two positions"
        elif expanded is None or min(expanded, default=0.0) < 0.0:
            reason = "an uncertainty must be positive"
        if reason:
            at = self._grid.place(row, columns[0])
            faults.report(at, reason, "correct it, or skip the column with `ignore`")
        if not expanded:
            return None, False
        self._surroundings.rounded += sum(value == 0.0 for value in expanded)
        sigma = tuple((value or self._least) / COVERAGE_FACTOR for value in expanded)
        return sigma if len(sigma) > 1 else (sigma[0] / sqrt(3.0),) * 3, len(sigma) == 1

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
        factor = self._length if dimension == "length" else 1.0
        return tuple(factor * number for number in numbers)

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
