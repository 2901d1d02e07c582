"""Columns of nominal positions that were measured: those without load, in a report of deviations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grammar import find_planned_axis
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.meaning.proposal import Proposal, propose
from jointstiff.solver.meaning.table import METRES

_LARGEST_DEFLECTION: Final = 0.02
"""Largest median distance [m] of the positions in two states."""


def refuse_measured_nominals(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable]
) -> None:
    """Refuse positions in one state next to nominal ones that fit the robot as readings do, and not exactly.

    Such nominal positions may be the readings without load. Coarser numbers are planned positions.

    Raises:
        ImportFileError: a table has such nominal positions.
    """
    if len({each.state for each in named}) > 1:
        return
    for table in tables:
        read = {each.reading.points.columns for each in named if each.reading.points.table == table.name}
        if len(read) != 1:
            continue
        (measured,) = read
        for word, columns in _list_nominals(table):
            distance = METRES[proposal.unit] * _measure_distance(table, columns, measured)
            are_fine = _count_decimals(table, columns) >= _count_decimals(table, measured)
            is_near = 0.0 < distance <= _LARGEST_DEFLECTION
            if is_near and are_fine and _fit_as_readings(proposal, tables, table, columns, measured):
                raise _build_error(table, word, columns, 1e3 * distance)


def _measure_distance(table: NumberTable, columns: Sequence[int], measured: Sequence[int]) -> float:
    """Return the median distance of the positions in two triples of columns, in their unit."""
    numbers = table.table.numbers
    shifts = numbers[:, list(columns)] - numbers[:, list(measured)]
    return float(np.nanmedian(np.linalg.norm(shifts, axis=1)))


def _fit_as_readings(
    proposal: Proposal,
    tables: Sequence[NumberTable],
    table: NumberTable,
    columns: Sequence[int],
    measured: Sequence[int],
) -> bool:
    """Return whether positions in the place of the measured ones are readings for the proposal's robots."""
    numbers = table.table.numbers[:, list(columns)]
    nominal = table.replace_numbers(dict(zip(measured, numbers.T, strict=True)))
    best = propose([(nominal if each is table else each).table for each in tables], proposal.robots).best
    return best is not None and any(each.points.columns == tuple(measured) for each in best.readings)


def _list_nominals(table: NumberTable) -> Iterator[tuple[str, tuple[int, int, int]]]:
    """Yield word and columns x, y and z of the nominal positions of a table."""
    columns_of_word: dict[str, dict[str, int]] = {}
    for column, header in enumerate(table.headers):
        found = find_planned_axis(header)
        if found is not None and column in table.table.others - table.ignored:
            columns_of_word.setdefault(found[0], {})[found[1]] = column
    for word, columns in columns_of_word.items():
        if columns.keys() == set("xyz"):
            yield word, (columns["x"], columns["y"], columns["z"])


def _count_decimals(table: NumberTable, columns: Sequence[int]) -> int:
    """Return the most decimals of the numbers in some columns."""
    mark = "," if table.mark == "comma" else "."
    return max(
        len(row.cells[column].partition(mark)[2].rstrip("0")) for row in table.rows for column in columns
    )


def _build_error(table: NumberTable, word: str, columns: Sequence[int], distance: float) -> ImportFileError:
    """Return the error that nominal positions, at a distance [mm] from the measured ones, may be readings."""
    listed = ", ".join(quote(table.headers[column]) for column in columns)
    reason = (
        f"the {word} positions are no exact ones, and are {distance:.2g} mm from the measured ones, so that "
        "they may be the readings without load"
    )
    remedy = f"state by `state_words` {quote(word)} as `unloaded` if so, or leave out {listed} by `ignore`"
    return ImportFileError(Place(table.grid.file), reason, remedy, "state_words", (word,))
