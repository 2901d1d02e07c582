"""Runs of one campaign in tables of their own, such as the sheets `Run 1` and `Run 2`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.service.importing.errors import quote
from jointstiff.service.importing.grammar import is_run
from jointstiff.service.proposals.tables.lengths import find_units_of_coordinates
from jointstiff.service.proposals.tables.numbers import NumberTable

_NUMBER: Final = re.compile(r"\d+")
_PART: Final = re.compile(r"\d+|[^\W\d_]+")
"""A number or a word of a title."""
_LEAST_COORDINATES: Final = 6
"""Coordinates of a row, at least: one position of a row may be under one of several loads."""


def stack_runs(tables: Sequence[NumberTable]) -> tuple[list[NumberTable], list[str]]:
    """Return the tables, those of several runs as one table with the rows of all, and notes.

    The titles of runs have a word such as `run`, and differ by a number only. Each run has joints, and
    several positions of a posture.
    """
    runs_of_form: dict[tuple[object, ...], list[NumberTable]] = {}
    for table in tables:
        form = (table.headers, table.meanings, _NUMBER.sub("0", table.title))
        runs_of_form.setdefault(form, []).append(table)
    stacked, notes = list[NumberTable](), list[str]()
    for runs in runs_of_form.values():
        if len(runs) > 1 and _are_runs(runs):
            stacked.append(_stack(runs))
            notes.append(f"the rows of {' and '.join(quote(each.title) for each in runs)} are one table")
        else:
            stacked.extend(runs)
    return stacked, notes


def _are_runs(runs: Sequence[NumberTable]) -> bool:
    """Return whether tables of one form are runs by their titles, their joints and positions."""
    have_joints = all(each.table.joints for each in runs)
    return (
        _are_counted([each.title for each in runs])
        and have_joints
        and len(find_units_of_coordinates(runs[0])) >= _LEAST_COORDINATES
    )


def _are_counted(titles: Sequence[str]) -> bool:
    """Return whether titles differ by one number only, next to a word such as `run`."""
    columns = list(zip(*map(_PART.findall, titles), strict=True))
    differ = [number for number, parts in enumerate(columns) if len(set(parts)) > 1]
    if len(differ) != 1 or len(set(columns[differ[0]])) < len(titles):
        return False
    neighbours = columns[max(differ[0] - 1, 0) : differ[0] + 2]
    return any(is_run(parts[0]) for parts in neighbours)


def _stack(runs: Sequence[NumberTable]) -> NumberTable:
    """Return the first of several tables with the rows of all."""
    numbers = np.vstack([each.table.numbers for each in runs])
    rows = tuple(row for each in runs for row in each.rows)
    return replace(runs[0], rows=rows, table=replace(runs[0].table, numbers=numbers))
