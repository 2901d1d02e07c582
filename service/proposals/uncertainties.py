"""Expanded uncertainties of positions that a proposal explains, by columns such as `U95 [mm]`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.service.importing.grammar import Meaning, Vocabulary
from jointstiff.service.proposals.names.naming import NamedReading, Uncertainty
from jointstiff.service.proposals.tables.deflections import MICROMETRE, SIZES, split_micrometres
from jointstiff.service.proposals.tables.numbers import NumberTable, find_table
from jointstiff.solver.meaning.table import LengthUnit

_LEAST, _MOST = 1e-6, 2e-3
"""Expanded uncertainties of instruments that are plausible [m], by their median."""


class _Column(NamedTuple):
    """Column of an expanded uncertainty."""

    number: int
    meaning: Meaning
    unit: str | None


def add_uncertainties(
    named: Sequence[NamedReading], tables: Sequence[NumberTable], words: Vocabulary, unit: LengthUnit
) -> list[NamedReading]:
    """Return the readings with the columns of their expanded uncertainties, if all have such columns.

    A column that names target or state belongs to that reading, a column behind a position to this position,
    and the only one of a table to all of its positions.

    Args:
        named: readings of a proposal.
        tables: tables of the proposal.
        words: vocabulary of the headers.
        unit: unit of the positions.
    """
    columns_of_table = {table.name: list(_list_columns(table, words)) for table in tables}
    completed = []
    for each in named:
        table = find_table(tables, each.reading.points.table)
        own = [other for other in named if other.reading.points.table == table.name]
        columns = _choose_columns(each, own, columns_of_table[table.name])
        uncertainty = _build_uncertainty(table, columns, unit)
        if uncertainty is None:
            return list(named)
        completed.append(replace(each, uncertainty=uncertainty))
    return completed


def _list_columns(table: NumberTable, words: Vocabulary) -> Iterator[_Column]:
    """Yield the columns that headers name as expanded uncertainties, of coordinates or of points."""
    for number, header in enumerate(table.headers):
        name = split_micrometres(header)
        meaning = table.meanings[number] if name is None else words.find(name)
        is_free = number not in table.ignored and meaning is not None
        if is_free and meaning is not None and meaning.kind in _KINDS:
            yield _Column(number, meaning, meaning.unit if name is None else MICROMETRE)


_KINDS: Final = frozenset(("uncertainty", "point uncertainty"))


def _choose_columns(
    named: NamedReading, others: Sequence[NamedReading], columns: Sequence[_Column]
) -> list[_Column]:
    """Return the columns of the uncertainty of a reading: three of its coordinates, or one of the point.

    `others` are the readings of the same table.
    """
    suiting = [column for column in columns if _suits(column, named)]
    with_names = [column for column in suiting if any(column.meaning.quantity[1:])]
    chosen = with_names or suiting
    if _are_one(chosen):
        return chosen
    starts = sorted({other.reading.points.columns[0] for other in others})
    start = named.reading.points.columns[0]
    end = next((each for each in starts if each > start), np.inf)
    behind = [column for column in chosen if start < column.number < end]
    return behind if _are_one(behind) else []


def _suits(column: _Column, named: NamedReading) -> bool:
    """Return whether a column names no other target or state than that of a reading."""
    _, target, state = column.meaning.quantity
    return target in (None, named.target) and state in (None, named.state)


def _are_one(columns: Sequence[_Column]) -> bool:
    """Return whether columns are the uncertainty of one point: one column, or one along each axis."""
    if len(columns) == 1:
        return columns[0].meaning.kind == "point uncertainty"
    axes = {column.meaning.axis for column in columns if column.meaning.kind == "uncertainty"}
    return len(columns) == len(axes) == len("xyz")


def _build_uncertainty(
    table: NumberTable, columns: Sequence[_Column], unit: LengthUnit
) -> Uncertainty | None:
    """Return the uncertainty in some columns; None without columns, or if numbers or unit are not plausible.

    Without a unit in the header, the numbers are in the unit of the positions or in micrometres.
    """
    numbers = sorted(columns, key=lambda column: column.meaning.axis or 0)
    units = {column.unit for column in columns}
    if len(units) != 1:
        return None
    stated = units.pop()
    values = table.table.numbers[:, [column.number for column in numbers]]
    if not np.isfinite(values).all() or (values < 0.0).any():
        return None
    sizes = [SIZES[stated]] if stated is not None else [SIZES[unit], SIZES[MICROMETRE]]
    median = float(np.median(values))
    plausible = [metres for metres in sizes if stated is not None or _LEAST <= median * metres <= _MOST]
    if len(plausible) != 1:
        return None
    return Uncertainty(tuple(column.number for column in numbers), plausible[0])
