"""Loads of a process: one for all moves, one for each segment of lines, a milling cut, or a table."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas import correction as schemas
from jointstiff.schemas.correction import MAX_LINE, CorrectionOptions, ProcessLoad
from jointstiff.service.conversion.units import FORCE, LENGTH
from jointstiff.service.problems import FilesError
from jointstiff.service.runs.deflection import parse_vector_header
from jointstiff.service.runs.verdicts import moment_factor
from jointstiff.service.tables.files import split_table_rows
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.correct.cut import MATERIALS, Cut, Material
from jointstiff.solver.errors import RequestError
from robotprograms import quote_text

_MORE_LINES: Final = 1_000
"""Lines that a table of loads may have in addition to two lines for each point: blank lines take memory."""
_MOST_LENGTHS: Final = 100_000
"""Greatest number of lines of a table of loads by length."""
_SLACK: Final = 0.01
"""Part of the path's length by which a table by length may end before or beyond the path."""
_FEED: Final = 6
"""Index of the feed in a row of a load: force (0 to 2), moment (3 to 5), feed."""
_ROW_WIDTH: Final = 7
"""Count of the numbers in a row of a load."""
_TABLE_CELLS: Final = 8
"""Greatest count of columns of a table of loads: point or length, and the numbers of a load."""
_FIRST_ROW: Final = 2
"""Line of the first row of a table below its header."""
_GREATEST: Final = 1e9
"""Greatest magnitude of a number in a table of loads."""
_REMEDY: Final = (
    "write `point`, `label` or `length [mm]`, then Fx [N], Fy [N], Fz [N], and, if known, Mx [N.m] … and "
    "feed [mm/s]"
)


class _LoadColumn(NamedTuple):
    """Column of a table of loads."""

    component: int  # index in a row of a load: Fx, Fy, Fz, Mx, My, Mz, feed
    factor: float  # to N, N·m or m/s


class _LoadRow(NamedTuple):
    """Row of a table of loads."""

    key: float  # number of the point, or length along the path in the unit of the header
    load: FloatArray  # (7,) force [N], moment [N·m] and feed [m/s]; zero without a column


class _LoadsByLength(NamedTuple):
    """Rows of a table of loads by length along the path."""

    places: FloatArray  # (k,) lengths [m]
    loads: FloatArray  # (k, 7) loads in SI units
    lines: IndexArray  # (k,) lines of the rows, for errors


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads [N, N·m] along the axes that the request chooses, and the index of the load at each visit.

    A visit is the arrival of a move at a target.
    """

    values: FloatArray  # (k, 6) force, then moment; the first row is zero and means no load
    of_visit: IndexArray  # (v,) row of `values` for each visit of a target by a move
    feed: FloatArray | None = None  # (k,) feed of each row [m/s]; NaN where the table states none

    def at_visits(self, visits: IndexArray) -> FloatArray:
        """Return the loads (m, 6) at some of the visits, given by their indices."""
        return np.asarray(self.values[self.of_visit[visits]])

    def feed_at_visits(self) -> FloatArray | None:
        """Return the feed (v,) of all visits [m/s], NaN where the table states none; None without feeds."""
        return None if self.feed is None else self.feed[self.of_visit]


def collect_loads(
    options: CorrectionOptions,
    table: bytes | None,
    lines: IndexArray,
    points: IndexArray,
    names: Sequence[str],
    measure_lengths: Callable[[], FloatArray],
    common: Collection[str] = (),
) -> Loads:
    """Return the load at each visit of a target, from the table of loads or else from the options.

    A visit is the arrival of a move at a target. The options have a milling cut, one load for all moves, or
    loads for segments of lines of the program.

    Args:
        options: options with one load for the whole program, or with loads for segments of lines.
        table: CSV file with a load for each point or length; None if the loads are in the
            options.
        lines: (v,) line of the move at each visit.
        points: (v,) number of the point at each visit, from 1.
        names: names of the points in the program, for a table of labels; empty where a point has none.
        measure_lengths: function that returns the length (v,) of the path up to each visit [m], for a table
            by length.
        common: names in capitals that several points have because they are one declared target.

    Raises:
        RequestError: segments overlap, or the unit of a moment is missing.
        FilesError: the table has a mistake.
    """
    if table is not None:
        return read_load_table(table, points, names, measure_lengths, common)
    if options.cut is not None:
        no_load, no_moment = np.zeros(6), np.zeros(3)
        load_of_cut = np.append(convert_cut(options.cut).mean_force(), no_moment)
        return Loads(np.stack([no_load, load_of_cut]), _find_segments([options.cut], lines))
    return _convert_stated_loads(options, lines)


def _convert_stated_loads(options: CorrectionOptions, lines: IndexArray) -> Loads:
    """Convert the loads that the options state to N and N·m: one for all moves, or one for each segment.

    Row 0 of the loads is the zero load, for visits without a load; `lines` (v,) are those of the visits.

    Raises:
        RequestError: segments overlap, or the unit of a moment is missing.
    """
    stated = options.segments
    if options.force is not None:
        stated = [ProcessLoad(force=options.force)]
    forces = np.array([load.force for load in stated]).reshape(-1, 3)
    moments = np.array([load.moment for load in stated]).reshape(-1, 3)
    values = np.zeros((1 + len(stated), 6))
    values[1:, :3] = FORCE[options.units.force] * forces
    values[1:, 3:] = moment_factor(options.units, moments) * moments
    if not stated:
        return Loads(values, np.zeros(len(lines), dtype=np.intp))
    return Loads(values, _find_segments(stated, lines))


def convert_cut(cut: schemas.Cut) -> Cut:
    """Convert the message of a cut, whose mean force can then be computed.

    Raises:
        RequestError: the width exceeds the diameter.
    """
    if cut.material is not None:
        material = MATERIALS[cut.material]
    else:
        pressure = 1e-6 * (cut.pressure or 0.0)  # Pa to N/mm²
        material = Material(pressure, cut.exponent or 0.0, "as stated")
    fields = cut.model_dump(exclude={"material", "pressure", "exponent", "first_line", "last_line"})
    return Cut(material, **fields)


def _find_segments(segments: Sequence[ProcessLoad | schemas.Cut], lines: IndexArray) -> IndexArray:
    """Return, for each line (v,), the number of its segment from 1; 0 for a line outside of all segments.

    With segments of the lines 1–10 and 20–30, the lines 5, 15 and 20 give 1, 0 and 2.

    Args:
        segments: segments, each with its first and last line; one that states none has all lines.
        lines: (v,) lines of the program.

    Raises:
        RequestError: two segments overlap.
    """
    ranges = [_LineRange.from_segment(number, segment) for number, segment in enumerate(segments, start=1)]
    ranges.sort(key=lambda each: each.first)
    _refuse_overlap(ranges)
    first = np.array([each.first for each in ranges])
    last = np.array([each.last for each in ranges])
    number = np.array([each.number for each in ranges])
    before = np.searchsorted(first, lines, side="right") - 1  # last range that begins before the line
    is_inside = (before >= 0) & (lines <= last[before])
    return np.where(is_inside, number[before], 0)


class _LineRange(NamedTuple):
    """Lines of a program that a segment of loads has."""

    first: int
    last: int
    number: int  # number of the segment in the request, from 1

    @classmethod
    def from_segment(cls, number: int, segment: ProcessLoad | schemas.Cut) -> _LineRange:
        """Return the lines of a segment; one that states none has all lines."""
        return cls(segment.first_line or 0, segment.last_line or MAX_LINE, number)


def _refuse_overlap(ranges: Sequence[_LineRange]) -> None:
    """Refuse ranges of lines, in order of their first lines, if a range begins in the range before it.

    Raises:
        RequestError: names the line that two segments have.
    """
    for before, after in pairwise(ranges):
        if after.first <= before.last:
            raise RequestError(
                f"line {after.first} has two loads",
                where=f"segments[{after.number - 1}]",
                remedy="give segments of lines that do not overlap",
            )


def read_load_table(
    content: bytes,
    points: IndexArray,
    names: Sequence[str],
    measure_lengths: Callable[[], FloatArray],
    common: Collection[str] = (),
) -> Loads:
    """Read the CSV file of loads, such as `point, Fx [N], Fy [N], Fz [N]` with a row for each point.

    The first column has the number of a point, its label (the name of a target in the program), or a length
    along the path. Between the rows of a table by length, the loads are interpolated.

    Args:
        content: content of the file.
        points: (v,) number of the point at each visit, from 1.
        names: names of the points in the program, for labels.
        measure_lengths: function that returns the length (v,) of the path up to each visit [m].
        common: names in capitals that mean all of their points.

    Returns:
        The load of each visit; a point without a row has no load.

    Raises:
        FilesError: a line of the file has a mistake; the error has the line.
    """
    point_count = int(points.max(initial=0))
    header, *rows = _split_rows(content, point_count) or [[]]
    columns = _parse_header(header)
    key = _parse_key(header[0])
    if key == "length":
        return _interpolate_loads(_read_lengths(header, rows, columns), measure_lengths(), columns)
    points_of_label = _number_labels(names, common) if key == "label" else None
    table = _LoadsOfPoints(point_count, columns)
    for row in _iterate_filled_rows(rows):
        table.add(row, _list_points(row, points_of_label))
    return table.collect(points)


class _FilledRow(NamedTuple):
    """Row of a CSV table of loads that is not blank."""

    line: int  # line of the file
    key: str  # first cell: a length, or what names the point
    cells: Sequence[str]  # further cells, with the load


def _iterate_filled_rows(rows: Sequence[Sequence[str]]) -> Iterator[_FilledRow]:
    """Yield the rows below the header of a table that are not blank; `rows` are the cells of all of them."""
    for line, row in enumerate(rows, start=_FIRST_ROW):
        is_blank = not any(row)
        if not is_blank:
            key, *cells = row
            yield _FilledRow(line, key, cells)


def _list_points(row: _FilledRow, points_of_label: Mapping[str, list[str]] | None) -> list[str]:
    """Return the numbers, as texts, of the points that a row of a table of loads is for.

    In a table by `point`, the first cell of the row `3, 100, 0, 0` is the number of its only point. In a
    table by `label`, the first cell of `P7, 100, 0, 0` is the name of a target. This target may have several
    points: if moves to it have copies of its numbers in place of its name, each copy is a point. But a name
    that several targets of the program have is ambiguous.

    Args:
        row: row of the table.
        points_of_label: numbers of points by labels; None in a table by numbers.

    Raises:
        FilesError: the label means no target of the program, or more than one.
    """
    if points_of_label is None:
        return [row.key]
    return _find_label(row.line, row.key, points_of_label)


class _LoadsOfPoints:
    """Loads of the points of a program, while the rows of a table of loads are added."""

    def __init__(self, point_count: int, columns: Sequence[_LoadColumn]) -> None:
        """Begin without loads.

        Args:
            point_count: number of points of the program, which have the numbers 1 to `point_count`.
            columns: columns of the table after the first.
        """
        self._point_count, self._columns = point_count, columns
        self._loads = [np.zeros(_ROW_WIDTH)]  # row 0 is the zero load, for points without a row
        self._load_of_point = np.zeros(
            point_count + 1, dtype=np.intp
        )  # row of `_loads` by the point's number

    def add(self, row: _FilledRow, points: Sequence[str]) -> None:
        """Add the load of a row for one point, or for all points with the label of the row.

        `points` are the numbers of the points, as texts.

        Raises:
            FilesError: a point is not in the program, or has a load already; or a cell is no number.
        """
        for text in points:
            number, load = _parse_load_row(row._replace(key=text), self._columns)
            point = int(number) if number == int(number) else 0
            is_known = 1 <= point <= self._point_count
            if not is_known or self._load_of_point[point] != 0:
                reason = f"point {text} occurs twice, or is not in the program"
                raise _table_fault(row.line, reason, _advise_to_number(self._point_count))
            self._load_of_point[point] = len(self._loads)  # the row that `load` gets below
        self._loads.append(load)

    def collect(self, points: IndexArray) -> Loads:
        """Return the loads at the visits of points, whose numbers are `points` (v,)."""
        return _split_feed(np.array(self._loads), self._load_of_point[points], self._columns)


def _advise_to_number(point_count: int) -> str:
    """Return what the user has to do if a table by points does not fit the points of the program."""
    return f"number the points from 1 to {point_count}, and give each point at most once"


def _split_rows(content: bytes, point_count: int) -> Sequence[Sequence[str]]:
    """Return the cells of a table of loads, row by row.

    A table by points may have two lines for each point (one of them blank), and `_MORE_LINES` more.

    Args:
        content: content of the file.
        point_count: number of points of the program.

    Raises:
        FilesError: the table has more lines or cells than it may have, or is not readable.
    """
    text = content.decode("utf-8-sig", errors="replace")
    first_line = text.lstrip().partition("\n")[0][:40]
    is_by_length = first_line.lstrip('" ').lower().startswith("length")
    most_lines = _MOST_LENGTHS if is_by_length else 2 * point_count + _MORE_LINES
    # A huge file is refused before it is split into cells, which would take much memory.
    if _is_too_large(text, most_lines):
        too_many = "the table has too many lines or cells"
        if is_by_length:
            raise _table_fault(1, f"{too_many}: at most {most_lines:,} lines", "leave rows out")
        raise _table_fault(1, f"{too_many} for the program's points", _advise_to_number(point_count))
    try:
        rows, _ = split_table_rows(text)
    except csv.Error:
        raise _table_fault(1, "the file of loads is not a readable CSV table", _REMEDY) from None
    return rows


def _is_too_large(text: str, most_lines: int) -> bool:
    """Return whether a table has more than `most_lines` lines, or more cells than such a table may have."""
    most_cells = _TABLE_CELLS * most_lines
    has_too_many_lines = any(text.count(line_end) > most_lines for line_end in "\n\r")
    has_too_many_cells = any(text.count(separator) > most_cells for separator in ",;\t")
    return has_too_many_lines or has_too_many_cells


def _parse_key(header: str) -> str:
    """Return what the first column of a table of loads states: "point", "label" or "length".

    Raises:
        FilesError: the header is none of these, or has a unit where there is no quantity.
    """
    name, bracket, _ = header.partition("[")
    key = name.strip().lower()
    has_unit = bool(bracket)
    has_unit_without_quantity = has_unit and key != "length"
    if key not in {"point", "label", "length"} or has_unit_without_quantity:
        raise _table_fault(1, f"the first header {header[:40]!r} is not understood", _REMEDY)
    return key


def _interpolate_loads(table: _LoadsByLength, lengths: FloatArray, columns: Sequence[_LoadColumn]) -> Loads:
    """Return the loads at v visits, interpolated between the rows of a table by length along the path.

    Two rows of one length are a step: the second one holds from there on.

    Args:
        table: rows of the table.
        lengths: (v,) length of the path up to each visit [m].
        columns: columns of the table after the first.

    Raises:
        FilesError: lengths decrease, or the table leaves a part of the path out.
    """
    _refuse_unsorted(table.places, table.lines)
    _refuse_uncovered(table.places, table.lines, float(lengths[-1]))
    interpolated = _interpolate_rows(table, lengths)
    # Row 0 is the zero load. Equal loads share a row, so that a target that is visited twice may have one.
    distinct, index = np.unique(interpolated, axis=0, return_inverse=True)
    is_loaded = interpolated.any(axis=1)
    of_visit = np.where(is_loaded, index.reshape(-1) + 1, 0)
    zero_load = np.zeros((1, _ROW_WIDTH))
    return _split_feed(np.concatenate([zero_load, distinct]), of_visit, columns)


def _interpolate_rows(table: _LoadsByLength, lengths: FloatArray) -> FloatArray:
    """Return the loads (v, 7) at lengths (v,) along the path [m], linear between the rows of the table."""
    places, loads = table.places, table.loads
    # Each length is between two rows of the table, `before` and `after`.
    after = np.clip(np.searchsorted(places, lengths, side="right"), 1, len(places) - 1)
    before = after - 1
    distance = lengths - places[before]
    width = places[after] - places[before]
    fraction = np.divide(distance, width, out=np.ones(len(lengths)), where=width > 0.0)
    fraction = np.clip(fraction, 0.0, 1.0)[:, None]  # of the way from the row before to the row after
    return np.asarray((1.0 - fraction) * loads[before] + fraction * loads[after])


def _read_lengths(
    header: Sequence[str], rows: Sequence[Sequence[str]], columns: Sequence[_LoadColumn]
) -> _LoadsByLength:
    """Read the rows of a CSV table by length along the path.

    Args:
        header: cells of the header, such as `length [mm]`.
        rows: cells of the rows below the header.
        columns: columns of the table after the first.

    Raises:
        FilesError: a row has a mistake.
    """
    unit = _parse_length_unit(header[0])
    places, loads, lines = list[float](), list[FloatArray](), list[int]()
    for row in _iterate_filled_rows(rows):
        length, load = _parse_load_row(row, columns)
        places.append(unit * length)
        loads.append(load)
        lines.append(row.line)
    loads_of_rows = np.array(loads).reshape(-1, _ROW_WIDTH)
    return _LoadsByLength(np.array(places), loads_of_rows, np.array(lines, dtype=np.intp))


def _refuse_unsorted(places: FloatArray, lines: IndexArray) -> None:
    """Refuse lengths (k,) [m] that decrease, or occur three times; `lines` (k,) are for the error.

    Raises:
        FilesError: names the first such row.
    """
    is_wrong = np.diff(places, prepend=-np.inf) < 0.0
    is_wrong[2:] |= places[2:] == places[:-2]
    if is_wrong.any():
        row = int(np.argmax(is_wrong))
        length = f"{1e3 * places[row]:.6g} mm"
        raise _table_fault(
            int(lines[row]),
            f"the length {length} is less than that of the row before, or occurs three times",
            "sort the rows by length; two rows of one length are a step of the load",
        )


def _refuse_uncovered(places: FloatArray, lines: IndexArray, whole: float) -> None:
    """Refuse a table of lengths (k,) [m] that does not cover a path of length `whole` [m].

    Raises:
        FilesError: the table leaves a part of the path out, or the path has no length.
    """
    if not whole > 0.0:
        reason = "the path has no length, as all its moves are joint moves"
        raise _table_fault(1, reason, "number the points, or use labels")
    slack = _SLACK * whole
    covers_path = len(places) > 0 and places[0] <= slack and abs(places[-1] - whole) <= slack
    if not covers_path:
        covered = f"{1e3 * places[0]:.4g} to {1e3 * places[-1]:.4g} mm" if len(places) else "nothing"
        raise _table_fault(
            int(lines[-1]) if len(lines) else 1,
            f"the table covers {covered}, but the lines and arcs of the path have 0 to {1e3 * whole:.4g} mm",
            "give rows for the whole path, with zeros where there is no load",
        )


def _split_feed(values: FloatArray, of_visit: IndexArray, columns: Sequence[_LoadColumn]) -> Loads:
    """Return the loads of a table, whose last number is no load but the feed: the speed of the tool.

    A feed of zero in a row means that the row states none, and becomes NaN. Without a column of feeds, the
    loads have no feeds at all: None.

    Args:
        values: (k, 7) force [N], moment [N·m] and feed [m/s] of each row.
        of_visit: (v,) row of each visit.
        columns: columns of the table after the first.
    """
    loads, feed = values[:, :_FEED], values[:, _FEED]
    has_feed = any(column.component == _FEED for column in columns)
    stated_feed = np.where(feed > 0.0, feed, np.nan)
    return Loads(loads, of_visit, stated_feed if has_feed else None)


def _parse_length_unit(header: str) -> float:
    """Return the unit of a header such as `length [mm]` in metres: 0.001.

    Raises:
        FilesError: the header has no unit of length.
    """
    name, _, unit = header.partition("[")
    factor = LENGTH.get(unit.strip().removesuffix("]").strip())
    if name.strip().lower() != "length" or factor is None:
        raise _table_fault(1, f"the header {header[:40]!r} has no unit of length", "write `length [mm]`")
    return factor


def _number_labels(names: Sequence[str], common: Collection[str]) -> dict[str, list[str]]:
    """Return the numbers, as texts, of the points with each name in capitals.

    The names `p1`, `P2`, `p1` give P1 → 1 and 3, P2 → 2, if P1 is one declared target, which is in `common`.
    Else P1 is the name of two targets, and does not say which one is meant: its list is empty.

    Args:
        names: name of each point, from point 1 on; empty for a point without a name.
        common: names in capitals that several points have because they are one declared target.
    """
    numbers_of_name = defaultdict[str, list[str]](list)
    for number, name in enumerate(names, start=1):
        numbers_of_name[name.upper()].append(str(number))
    for name, numbers in numbers_of_name.items():
        is_ambiguous = len(numbers) > 1 and name not in common
        if is_ambiguous:
            numbers.clear()
    return numbers_of_name


def _find_label(line: int, label: str, points_of_label: Mapping[str, list[str]]) -> list[str]:
    """Return the numbers, as texts, of the points of the target that has a name.

    Args:
        line: line of the table, for the error.
        label: name as the table writes it.
        points_of_label: numbers of points by names in capitals; none for a name of several targets.

    Raises:
        FilesError: no target, or several targets, have the name.
    """
    numbers = points_of_label.get(label.upper(), []) if label else []
    if not numbers:
        reason = f"the label {quote_text(label)} is not the name of one target of the program"
        raise _table_fault(line, reason, "write names of targets as in the program, or number the points")
    return numbers


def _parse_load_row(row: _FilledRow, columns: Sequence[_LoadColumn]) -> _LoadRow:
    """Parse a row of a table of loads: its first cell, and the load in SI units.

    Args:
        row: the row; its first cell has the number of a point, or a length.
        columns: columns of the table after the first.

    Raises:
        FilesError: a cell is missing, is not a number, or is out of range.
    """
    try:
        key, *numbers = [float(cell) for cell in (row.key, *row.cells)]
    except ValueError:
        raise _table_fault(row.line, "a cell is not a number", "write numbers with decimal points") from None
    are_in_range = (np.abs([key, *numbers]) <= _GREATEST).all()
    if len(numbers) != len(columns) or not are_in_range:
        reason = "a cell is missing, or a number is out of range"
        raise _table_fault(row.line, reason, "give a finite number in each column")
    load = np.zeros(_ROW_WIDTH)
    for column, number in zip(columns, numbers, strict=True):
        load[column.component] = column.factor * number
    return _LoadRow(key, load)


def _parse_header(header: Sequence[str]) -> list[_LoadColumn]:
    """Return the columns of a table of loads after the first, from the cells of its header.

    Raises:
        FilesError: a header is unknown, or a column is missing or occurs twice.
    """
    columns = [_parse_column(cell) for cell in header[1:]]
    components = [column.component for column in columns]
    key = header[0].partition("[")[0].strip().lower() if header else ""
    has_key = key in {"point", "label", "length"}
    has_forces = {0, 1, 2} <= set(components)  # Fx, Fy and Fz; moments may be absent
    occurs_twice = len(set(components)) < len(components)
    if not has_key or not has_forces or occurs_twice:
        raise _table_fault(1, "a column is missing, or occurs twice", _REMEDY)
    return columns


def _parse_column(cell: str) -> _LoadColumn:
    """Return the column with a header such as `Fx [N]`, `My [N.m]` or `feed [mm/s]`.

    Raises:
        FilesError: the header is unknown.
    """
    name, _, unit = cell.partition("[")
    length_unit = LENGTH.get(unit.strip().removesuffix("/s]"))
    if name.strip().lower() == "feed" and length_unit:
        return _LoadColumn(_FEED, length_unit)
    try:
        parsed = parse_vector_header(cell, ("force", "moment"))
    except RequestError:
        parsed = None
    if parsed is None:
        raise _table_fault(1, f"the header {cell[:40]!r} is not understood", _REMEDY)
    quantity, axis, factor = parsed
    component_of_x = 3 if quantity == "moment" else 0
    return _LoadColumn(component_of_x + axis, factor)


def _table_fault(line: int, reason: str, remedy: str) -> FilesError:
    """Return an error at a line of the table of loads, for the caller to raise."""
    return FilesError(reason, remedy=remedy, where=f"loads:{line}")
