"""Loads of a program: one for all moves, by lines, or by a table of points."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.program import LoadSegment, ProcessLoad, ProgramOptions
from jointstiff.service.conversion.units import FORCE, MOMENT
from jointstiff.service.kinds.deflection.models import moment_factor
from jointstiff.service.problems.errors import FilesError
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import RequestError

_COLUMN: Final = re.compile(r"([FM])([xyz])\s*+\[\s*+([^\[\]\s]*+)\s*+\]")
_MORE_LINES: Final = 1_000
"""Lines of a table beside two for each point. Each costs a hundred bytes and more, blank ones too."""
_REMEDY: Final = "write `point`, then Fx [N], Fy [N], Fz [N], and, if there are moments, Mx [N.m] …"


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads (k, 6) [N, N·m] along the axes of the request, and which of them each move of a program has."""

    values: FloatArray  # (k, 6) force, then moment; the first one is no load
    of_visit: IndexArray  # (v,) index of each visit's load


def loads_of(options: ProgramOptions, table: bytes | None, lines: IndexArray, points: IndexArray) -> Loads:
    """Return the loads.

    Args:
        options: that state them.
        table: CSV of points, if there is one.
        lines: (v,) line of each visit's move.
        points: (v,) number of each visit's point, from 1.

    Raises:
        RequestError: segments overlap, or a moment has no unit.
        FilesError: the table is not understood.
    """
    if table is not None:
        return _from_table(table, points)
    if options.load is not None:
        return Loads(_in_si(options, [options.load]), np.ones(len(lines), dtype=np.intp))
    if not options.segments:
        return Loads(np.zeros((1, 6)), np.zeros(len(lines), dtype=np.intp))
    return Loads(_in_si(options, options.segments), _segment_of(options.segments, lines))


def _in_si(options: ProgramOptions, loads: Sequence[ProcessLoad]) -> FloatArray:
    moments = np.array([load.moment for load in loads])
    values = np.zeros((len(loads) + 1, 6))
    values[1:, :3] = FORCE[options.units.force] * np.array([load.force for load in loads])
    values[1:, 3:] = moment_factor(options.units, moments) * moments
    return values


def _segment_of(segments: Sequence[LoadSegment], lines: IndexArray) -> IndexArray:
    order = sorted(range(len(segments)), key=lambda i: segments[i].first_line)
    first = np.array([segments[i].first_line for i in order])
    last = np.array([segments[i].last_line for i in order])
    overlap = np.flatnonzero(first[1:] <= last[:-1])
    if len(overlap):
        raise RequestError(
            f"line {first[overlap[0] + 1]} has two loads",
            where=f"segments[{order[overlap[0] + 1]}]",
            remedy="let segments end before the next ones begin",
        )
    segment = np.searchsorted(first, lines, side="right") - 1
    inside = (segment >= 0) & (lines <= last[segment])
    return np.where(inside, np.array(order)[segment] + 1, 0)


def _from_table(content: bytes, points: IndexArray) -> Loads:
    most = int(points.max(initial=0))
    text = content.decode("utf-8-sig", errors="replace")
    lines = 2 * most + _MORE_LINES
    if any(text.count(sign) > lines for sign in "\n\r") or any(
        text.count(sign) > 8 * lines for sign in ",;\t"
    ):
        raise _fault(
            1, "the table has more lines or cells than the program has points", f"number them 1 to {most}"
        )
    delimiter = next((sign for sign in ";\t" if sign in text.partition("\n")[0]), ",")
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(io.StringIO(text), delimiter=delimiter)]
    except csv.Error:
        raise _fault(1, "this is not a table", _REMEDY) from None
    columns = _columns(rows[0] if rows else [])
    values, number = [np.zeros(6)], np.zeros(most + 1, dtype=np.intp)
    for line, row in enumerate(rows[1:], 2):
        if any(row):
            point, load = _row(line, row, columns)
            if not 1 <= point <= most or number[point]:
                raise _fault(
                    line, f"point {point} occurs twice, or is not in the program", f"number them 1 to {most}"
                )
            number[point] = len(values)
            values.append(load)
    return Loads(np.array(values), number[points])


def _columns(header: Sequence[str]) -> list[tuple[int, float]]:
    """Return the place of each column behind the first among force and moment, and its factor to SI units."""
    columns = []
    for cell in header[1:]:
        column = _COLUMN.fullmatch(cell)
        units = {} if column is None else FORCE if column[1] == "F" else MOMENT
        if column is None or column[3] not in units:
            raise _fault(1, f"the header {cell[:40]!r} is not known", _REMEDY)
        columns.append((3 * (column[1] == "M") + "xyz".index(column[2]), units[column[3]]))
    places = [place for place, _ in columns]
    if header[:1] != ["point"] or len(set(places)) < len(places) or not {0, 1, 2} <= set(places):
        raise _fault(1, "a column is missing, or occurs twice", _REMEDY)
    return columns


def _row(line: int, row: Sequence[str], columns: Sequence[tuple[int, float]]) -> tuple[int, FloatArray]:
    load = np.zeros(6)
    try:
        point, numbers = int(row[0]), [float(cell) for cell in row[1:]]
    except ValueError:
        raise _fault(line, "a cell is not a number", "write numbers with decimal points") from None
    if len(numbers) != len(columns) or not np.isfinite(numbers).all() or max(map(abs, numbers)) > 1e9:
        raise _fault(line, "cells are missing, or out of range", "give a finite number in each column")
    for (place, factor), number in zip(columns, numbers, strict=True):
        load[place] = factor * number
    return point, load


def _fault(line: int, reason: str, remedy: str) -> FilesError:
    return FilesError(reason, remedy=remedy, where=f"loads:{line}")
