"""Tables laid out with a row for each posture, as the robot judges them, and where each column comes from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jointstiff.service.imports.structure import Pivot
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.proposal import TargetReading
from jointstiff.solver.meaning.table import JointColumns, PointColumns, Table


class Source(NamedTuple):
    """Origin of a column of a wide table."""

    pivot: int  # number of the table in the file
    column: str
    combo: int  # number of the words of the keys
    is_once: bool  # whether all rows of a posture have the same number


@dataclass(frozen=True, eq=False)
class Layout:
    """Wide tables of N postures, made of the tables of files."""

    pivots: Sequence[Pivot]
    tables: list[Table]
    sources: dict[str, list[Source]]  #: name of a wide table → source of each column

    @classmethod
    def of(cls, pivots: Sequence[Pivot]) -> Layout:
        """Lay out tables: those with labels are joined by common labels, others by the order of postures."""
        are_labelled = all(pivot.structure.label is not None for pivot in pivots)
        common = [name for name in pivots[0].labels if all(name in pivot.labels for pivot in pivots)]
        blocks = []
        for number, pivot in enumerate(pivots):
            rows = [pivot.labels.index(name) for name in common] if are_labelled else range(len(pivot.labels))
            blocks.append(_lay_side_by_side(pivot, number, list(rows)))
        if are_labelled and len(pivots) > 1:
            joined = np.hstack([block.numbers for block in blocks])
            blocks = [_Block(joined, [source for block in blocks for source in block.sources])]
        tables, sources = [], {}
        for number, block in enumerate(blocks):
            if block.numbers.size:
                name = f"table {number}"
                tables.append(Table(name, block.numbers))
                sources[name] = block.sources
        return cls(pivots, tables, sources)

    def get(self, name: str) -> Table:
        """Return a wide table by its name."""
        return next(table for table in self.tables if table.name == name)

    def find_sources(self, columns: JointColumns | PointColumns) -> list[Source]:
        """Return the sources of columns that are joints or a position."""
        own = self.sources[columns.table]
        return [own[column] for column in columns.columns]

    def find_pivot(self, reading: TargetReading) -> Pivot:
        """Return the table of a position."""
        return self.pivots[self.find_sources(reading.points)[0].pivot]

    def read_neighbours(self, reading: TargetReading, columns: Sequence[int]) -> FloatArray:
        """Return the numbers (N, m) of columns of the same table in the rows of a position."""
        source = self.find_sources(reading.points)[0]
        rows = self.pivots[source.pivot].numbers[:, source.combo, list(columns)]
        return reading.points.groups.split(rows)[:, reading.index]


class _Block(NamedTuple):
    """Numbers (N, m) of postures, with the sources of the columns."""

    numbers: FloatArray
    sources: list[Source]


def _lay_side_by_side(pivot: Pivot, number: int, rows: list[int]) -> _Block:
    """Return the columns of a posture once, then those of each combination of words.

    If words tell x, y and z apart, the three columns of a number follow each other.
    """
    numbers = pivot.numbers[rows]
    first = np.nanmax(numbers, axis=1, initial=-np.inf, keepdims=True)
    is_once = (np.isnan(numbers) | (numbers == first)).all(axis=(0, 1))
    columns = [first[:, 0, i] for i in np.flatnonzero(is_once)]
    sources = [Source(number, pivot.columns[i], 0, is_once=True) for i in np.flatnonzero(is_once)]
    pairs = [(combo, int(i)) for combo in range(len(pivot.combos)) for i in np.flatnonzero(~is_once)]
    if pivot.structure.axis is not None:
        place = pivot.structure.keys.index(pivot.structure.axis)
        words = [combo[:place] + combo[place + 1 :] for combo in pivot.combos]
        pairs.sort(key=lambda pair: (words.index(words[pair[0]]), pair[1]))
    for combo, i in pairs:
        columns.append(numbers[:, combo, i])
        sources.append(Source(number, pivot.columns[i], combo, is_once=False))
    table = np.column_stack(columns) if columns else np.empty((len(rows), 0))
    return _Block(np.where(np.isfinite(table), table, np.nan), sources)
