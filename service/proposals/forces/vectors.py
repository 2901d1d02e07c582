"""Parts of vectors that look like forces, such as those of a controller: which columns belong together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from jointstiff.service.importing.errors import quote
from jointstiff.service.importing.grammar import (
    collapse_blanks,
    find_force_at_end,
    fits_header,
    looks_like_a_force,
    split_unit,
)
from jointstiff.service.importing.grid import COORDINATES
from jointstiff.service.importing.loads import find_newtons
from jointstiff.service.proposals.columns.left import ColumnsLeft
from jointstiff.service.proposals.tables.load_columns import PART
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray

_SAME_SIZE: Final = 0.1
"""Largest difference of a stated force and the change of a vector under load, as a part of the force."""
_NUMBERS_OF_PARTS: Final = (COORDINATES, 2 * COORDINATES)
"""Parts of a force, and of a force with the moment behind it."""


class ForceVector(NamedTuple):
    """Columns of a table that are the parts of one vector, by their headers."""

    table: NumberTable
    columns: tuple[int, ...]

    @property
    def pattern(self) -> str:
        """Text that names exactly these columns for `ignore`: their common beginning, else all headers."""
        own = [collapse_blanks(self.table.headers[column]) for column in self.columns]
        first, _ = split_unit(own[0])
        beginning = first.rstrip("xyzXYZ0123456[]")
        pattern = f"{beginning}*"
        found = [header for header in self.table.headers if fits_header(pattern, header)]
        return quote(pattern) if len(found) == len(own) else ", ".join(map(quote, own))

    def measure_changes(self) -> FloatArray | None:
        """Return the size (N,) [N] of the change of the force under load in each posture.

        Numbers without a unit are read in N. None if names do not tell the states of the rows, or numbers are
        missing.
        """
        states = [name.state for name in self.table.turn]
        if not {"unloaded", "loaded"} <= set(states):
            return None
        numbers = self.table.table.numbers[:, list(self.columns[:COORDINATES])]
        of_postures = numbers.reshape(-1, len(states), COORDINATES)
        loaded, unloaded = (of_postures[:, states.index(state)] for state in ("loaded", "unloaded"))
        unit = find_force_at_end(self.table.headers[self.columns[0]])
        changes = find_newtons(unit or "N") * np.linalg.norm(loaded - unloaded, axis=1)
        return changes if np.isfinite(changes).all() else None

    def confirms(self, newtons: float) -> bool:
        """Return whether the vector changes under load by the size [N] of a force in each posture."""
        changes = self.measure_changes()
        return changes is not None and bool((np.abs(changes - newtons) <= _SAME_SIZE * newtons).all())


def list_vectors(left: Iterable[ColumnsLeft]) -> Iterator[ForceVector]:
    """Yield the vectors of columns that are left, without a known meaning, and that look like forces."""
    for each in left:
        table = each.table
        parts: dict[str, list[int]] = {}
        for column in each.columns:
            header = table.headers[column]
            stem, count = PART.subn("", split_unit(header)[0])
            if count and table.is_unknown(column) and looks_like_a_force(header):
                parts.setdefault(stem, []).append(column)
        for columns in parts.values():
            if len(columns) in _NUMBERS_OF_PARTS:
                yield ForceVector(table, tuple(columns))


def complete_vectors(left: ColumnsLeft, columns: Sequence[int]) -> tuple[list[int], str]:
    """Return columns of a table with the other parts of their vectors, and what to state in `ignore`."""
    vectors = [each for each in list_vectors([left]) if not set(each.columns).isdisjoint(columns)]
    of_vectors = {column for each in vectors for column in each.columns}
    others = [quote(left.table.headers[column]) for column in columns if column not in of_vectors]
    return sorted(of_vectors.union(columns)), ", ".join([*(each.pattern for each in vectors), *others])
