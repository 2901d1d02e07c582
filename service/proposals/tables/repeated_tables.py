"""Runs of one campaign in tables of their own, such as the sheets `Run 1` and `Run 2`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.service.importing.errors import quote
from jointstiff.service.importing.grammar import is_run
from jointstiff.service.proposals.tables.lengths import MOST_REPEAT, find_units_of_coordinates
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.meaning.table import find_rounding

_NUMBER: Final = re.compile(r"\d+")
_PART: Final = re.compile(r"\d+|[^\W\d_]+")
"""A number or a word of a title."""
_LEAST_POSITIONS: Final = 2
"""Positions of a row, at least: those of one state may be the readings under one of several loads."""


def average_runs(tables: Sequence[NumberTable]) -> tuple[list[NumberTable], list[str]]:
    """Return the tables, those of runs with the same joints as one table with their mean, and notes.

    The titles of runs have a word such as `run`, and differ by a number only. Repeated positions are near
    their mean, and each run has several positions of a posture.
    """
    runs_of_form: dict[tuple[object, ...], list[NumberTable]] = {}
    for table in tables:
        form = (table.headers, _NUMBER.sub("0", table.title), len(table.rows))
        runs_of_form.setdefault(form, []).append(table)
    averaged, notes = list[NumberTable](), list[str]()
    for runs in runs_of_form.values():
        if len(runs) > 1 and _are_runs(runs):
            averaged.append(_average(runs))
            notes.append(f"the mean of {' and '.join(quote(each.title) for each in runs)} is read")
        else:
            averaged.extend(runs)
    return averaged, notes


def _are_runs(runs: Sequence[NumberTable]) -> bool:
    """Return whether tables of one form are runs by a word of their titles, their joints and positions."""
    first = runs[0]
    coordinates = find_units_of_coordinates(first)
    joints = list(first.table.joints)
    if (
        not _are_counted([each.title for each in runs])
        or not joints
        or len(coordinates) < 3 * _LEAST_POSITIONS
    ):
        return False
    numbers = np.array([each.table.numbers for each in runs])
    rounding = max(find_rounding(first.table.numbers[:, column]) for column in joints)
    are_postures = bool((np.ptp(numbers[:, :, joints], axis=0) <= 1.5 * rounding).all())
    positions = numbers[:, :, list(coordinates)] * list(coordinates.values())
    distances = np.abs(positions - positions.mean(axis=0))
    return are_postures and bool((distances <= MOST_REPEAT).all())


def _are_counted(titles: Sequence[str]) -> bool:
    """Return whether titles differ by one number only, next to a word such as `run`."""
    columns = list(zip(*map(_PART.findall, titles), strict=True))
    differ = [number for number, parts in enumerate(columns) if len(set(parts)) > 1]
    if len(differ) != 1 or len(set(columns[differ[0]])) < len(titles):
        return False
    neighbours = columns[max(differ[0] - 1, 0) : differ[0] + 2]
    return any(is_run(parts[0]) for parts in neighbours)


def _average(runs: Sequence[NumberTable]) -> NumberTable:
    """Return the first of several runs, with the means of its numbers; the joints are those of the first."""
    numbers = np.array([each.table.numbers for each in runs])
    differ = np.isfinite(numbers).all(axis=(0, 1)) & (np.ptp(numbers, axis=0) > 0.0).any(axis=0)
    columns = [column for column in np.flatnonzero(differ).tolist() if column not in runs[0].table.joints]
    return runs[0].replace_numbers({column: numbers[:, :, column].mean(axis=0) for column in columns})
