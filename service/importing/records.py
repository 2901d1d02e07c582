"""Rows to observations: what each row says of one observation, and of when and where it was measured."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from math import sqrt
from typing import Final, Literal

from jointstiff.schemas.imports import DecimalMark, State
from jointstiff.service.importing import grammar
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grammar import DIMENSIONS, INCH, Dimension, Kind, Quantity, along_axis
from jointstiff.service.importing.grid import Row, read_number
from jointstiff.service.importing.layout import Layout
from jointstiff.service.importing.names import Names, Naming, check_name, is_whole

_COVERAGE_FACTOR: Final = 1.96
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


@dataclass(slots=True)
class Gathered:
    """Values of one observation: those of a row, then of all rows with its label."""

    label: str  # its label
    place: Place  # where it is first spoken of
    whole: bool = False  # whether the row claims to be the only one of its observation in this file
    held_out: bool = False  # whether a column says that it is held out from the fit
    # joint angles, force, moment, load point, in the file's units, and where they stand
    values: dict[Kind, tuple[Vector, Place]] = field(default_factory=dict)
    points: dict[str, dict[State, Point]] = field(default_factory=dict)  # points by target, then state

    @property
    def all_points(self) -> list[Point]:
        """Return the points of all targets and states."""
        return [point for states in self.points.values() for point in states.values()]


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

    def records(self, faults: Faults) -> Iterator[Gathered]:
        """Yield what each row says; unclear names and cells that do not fit their columns are faults.

        Names that are unclear for the same reason are one fault.
        """
        unnamed: dict[str, ImportFileError] = {}  # the first of each reason
        count: Counter[str] = Counter()
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
        for remedy, first in unnamed.items():
            others = count[remedy] - 1 if first.place.line else 0  # of the file's name there is one only
            more = f", and {others} other names are not clear either" if others else ""
            faults.report(first.place, first.reason + more, remedy, first.option, first.words)
        times = [i for i, meaning in enumerate(self._columns.meanings) if meaning.kind == "time"]
        self._surroundings.add_times([[row.cells[column] for column in times] for row in self._rows if times])

    def _record(self, number: int, row: Row, naming: Naming, faults: Faults) -> Gathered:
        """Read one row; faults in its cells are told, all of them."""
        place = self._grid.place(row)
        label = (naming.label or "") if self._named else self._labels[number]
        record = Gathered(label, place, self._whole)
        for quantity, indices in self._columns.quantities.items():
            if quantity.kind in ("addition", "uncertainty", "point uncertainty"):
                continue
            vector = self._vector(row, indices, faults, DIMENSIONS[quantity.kind])
            if quantity.kind == "along" and vector is None:
                continue  # a gauge reads one direction in a posture, and another in the next
            if quantity.kind in grammar.POINTS:
                vector = self._with_addition(row, quantity, vector, faults)
                point = self._point(row, quantity, naming, vector, faults)
                record.points.setdefault(point.target, {})[point.state] = point
            elif vector is None:
                reason = f"this row has no {quantity.kind}"
                faults.report(self._grid.place(row, indices[0]), reason, "fill in the cells")
            else:
                record.values[quantity.kind] = vector, place
        self._take_texts(row, record, faults)
        return record

    def _take_texts(self, row: Row, record: Gathered, faults: Faults) -> None:
        """Take the temperature, and whether the row is held out."""
        texts = self._columns.texts
        if "temperature" in texts:
            index = texts["temperature"]
            unit = self._columns.meanings[index].unit or ""
            self._surroundings.add_temperature(row.cells[index], unit, self._mark)
        if "validation" in texts:
            held = row.cells[texts["validation"]].strip() or "0"
            record.held_out = held == "1"
            if held not in ("0", "1"):
                at, reason = self._grid.place(row, texts["validation"]), f"{shown(held)} is neither 0 nor 1"
                faults.report(at, reason, "write 1 to hold it out from the fit")

    def _with_addition(
        self, row: Row, position: Quantity, vector: Vector | None, faults: Faults
    ) -> Vector | None:
        """Return a position with the deviation that columns `plus x` add to it, if there are any."""
        indices = self._columns.quantities.get(position.of("addition"))
        if indices is None or not vector:
            return vector
        added = self._vector(row, indices, faults, "length")
        if added is None:
            place = self._grid.place(row, indices[0])
            faults.report(place, "the deviation to be added is empty", "fill it in")
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
            except ImportFileError as fault:
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
        columns: tuple[int, ...] = ()
        expanded: Vector | None = None
        kinds: tuple[Kind, ...] = ("uncertainty", "point uncertainty")
        for of_kind in (self._columns.quantities.get(position.of(kind), ()) for kind in kinds):
            columns = columns or of_kind
            if expanded is None and of_kind:
                expanded = self._vector(row, of_kind, faults, "length")
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
        sigma = tuple((value or self._least) / _COVERAGE_FACTOR for value in expanded)
        return sigma if len(sigma) > 1 else (sigma[0] / sqrt(3.0),) * 3, len(sigma) == 1

    def _vector(
        self, row: Row, indices: tuple[int, ...], faults: Faults, dimension: Dimension
    ) -> Vector | None:
        """The numbers of some columns; None if all of their cells are empty, () if one is faulty."""
        if not any(row.cells[index] for index in indices):
            return None
        factor = self._length if dimension == "length" else 1.0
        try:
            return tuple(factor * self._number(row, index) for index in indices)
        except ImportFileError:
            for index in indices:
                with faults.collected():
                    self._number(row, index)
            return ()

    def _number(self, row: Row, index: int) -> float:
        text = row.cells[index]
        if row.kinds is not None and text and row.kinds[index] != "number":
            reason = f"a number is needed, but the cell has type {row.kinds[index]}: {shown(text)}"
            remedy = (
                "enter a number, and format the cell as a number; replace a formula without a stored value "
            )
            raise ImportFileError(self._grid.place(row, index), reason, f"{remedy}by its value")
        try:
            return read_number(text, self._mark)
        except ImportFileError as fault:
            raise fault.at(self._grid.place(row, index)) from None


# ---- when and at which temperature readings were taken, as far as their files say it for certain

_YEARS: Final = range(1980, 2201)
_STAMP: Final = re.compile(
    r"(?P<first>\d{1,4})(?P<mark>[-./])(?P<second>\d{1,2})(?P=mark)(?P<third>\d{1,4})[ T,]+"
    r"(?P<hours>\d{1,2}):(?P<minutes>\d{2})(?::(?P<seconds>\d{2}(?:[.,]\d+)?))?"
    r"(?: ?(?P<half>[AP])\.?M\.?)?(?: ?(?P<zone>Z|[+-]\d{2}:?\d{2}))?",
    re.IGNORECASE,
)
"""A date and a time of day."""


@dataclass
class Surroundings:
    """Times and temperatures of all points of all files."""

    times: list[datetime] = field(default_factory=list)
    temperatures: dict[str, list[float]] = field(default_factory=dict)  # by unit as it is written
    # texts that are no times or temperatures for certain
    unclear: dict[Literal["times", "temperatures"], list[str]] = field(default_factory=dict)
    rounded: int = 0  # expanded uncertainties of 0

    def add_times(self, rows: Sequence[Sequence[str]]) -> None:
        """Note the times of one file: a cell of each row, or one for the date and one for the time.

        `5/11/2026` is the day of the month that the other rows tell, or none.
        """
        texts = [text for row in rows if (text := _joined(row))]
        matches = [_STAMP.fullmatch(text) for text in texts]
        day_first = {match["mark"]: True for match in matches if match and match["mark"] == "."}
        for match in matches:
            if match and match["mark"] != "." and len(match["first"]) < 3:
                late = int(match["first"]) > 12, int(match["second"]) > 12
                if late[0] != late[1] and day_first.setdefault(match["mark"], late[0]) != late[0]:
                    day_first[match["mark"]] = True  # days and months are mixed: one of them is refused
        for text, match in zip(texts, matches, strict=True):
            time = None if match is None else _time_of(match, day_first.get(match["mark"]))
            if time is None:
                self.unclear.setdefault("times", []).append(text)
            else:
                self.times.append(time)

    def add_temperature(self, text: str, unit: str, mark: DecimalMark) -> None:
        """Note a temperature."""
        try:
            self.temperatures.setdefault(unit, []).append(read_number(text, mark))
        except ImportFileError:
            if any(map(str.isdigit, text)):
                self.unclear.setdefault("temperatures", []).append(text)

    @property
    def measured_at(self) -> datetime | None:
        """Time of the first reading, without a zone as UTC; None if one of the times is not clear."""
        return None if "times" in self.unclear else min(self.times, default=None)

    @property
    def conditions(self) -> str | None:
        """Range of the temperature in each unit, in words."""
        ranges = []
        for unit, values in self.temperatures.items():
            if values:
                low, high = min(values), max(values)
                ranges.append(f"{low:g}{f' to {high:g}' if high > low else ''} {unit}".strip())
        return f"temperature {', '.join(ranges)}" if ranges else None

    @property
    def notes(self) -> list[str]:
        """Account of what was taken from the files, in words."""
        notes = []
        if self.measured_at is not None:
            time = self.measured_at.isoformat(" ", "seconds")
            notes.append(f"time of the measurement, of the first reading, UTC if it names no zone: {time}")
        if self.conditions is not None:
            notes.append(f"conditions of the measurement: {self.conditions}")
        for kind, texts in self.unclear.items():
            example = f"such as {shown(texts[0])} ({len(texts)} rows)"
            mended = f"give them with `{'measured_at' if kind == 'times' else 'conditions'}`"
            notes.append(f"{kind} were not understood and not used, {example}: {mended}")
        if self.rounded:
            notes.append(f"U(95) of 0 is rounded to 1 µm, and was read as 0.5 µm ({self.rounded} cells)")
        return notes


def _joined(cells: Sequence[str]) -> str:
    """Return the first of some cells that has a date and a time, else all of them with the date first."""
    texts = [text for cell in cells if any(map(str.isdigit, text := cell.strip("' ")))]
    whole = (text for text in texts if _STAMP.fullmatch(text))
    return next(whole, " ".join(sorted(texts, key=lambda text: ":" in text)))


def _time_of(match: re.Match[str], day_first: bool | None) -> datetime | None:
    """Return the time; None if there is no such time, or if day and month may be exchanged."""
    year, month, day = int(match["first"]), int(match["second"]), int(match["third"])
    if len(match["first"]) < 3:
        year, day = day, year
        if day_first is None and day != month:
            return None
        if day_first is False:
            day, month = month, day
    hours, seconds = int(match["hours"]), (match["seconds"] or "00").replace(",", ".")
    if match["half"]:
        if not 1 <= hours <= 12:
            return None
        hours = hours % 12 + 12 * (match["half"].upper() == "P")
    text = f"{year:04}-{month:02}-{day:02}T{hours:02}:{match['minutes']}:{seconds}{match['zone'] or 'Z'}"
    try:
        return datetime.fromisoformat(text.upper()) if year in _YEARS else None
    except ValueError:
        return None
