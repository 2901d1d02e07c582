"""Targets of the rows of a table: points that keep their distances, as the flange is rigid."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Final

import numpy as np

from jointstiff.service.importing.grammar import is_cycle_header
from jointstiff.service.proposals.names.labels import COUNTED, LEAST_LABELS, MOST_CODES
from jointstiff.service.proposals.tables.lengths import find_units_of_coordinates
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.service.proposals.tables.row_name import RowName

LEAST_BETWEEN_TARGETS: Final = 2e-3
"""Least distance [m] of two targets along an axis of coordinates; repeats of a reading are nearer."""
_LARGEST_DEFLECTION: Final = 0.02
"""Distance [m] along an axis beyond which two positions of a posture are no states of one target."""
_MOST_CHANGE: Final = 1e-3
"""Most change [m] of the distance of two targets from posture to posture; the flange is rigid."""


def add_targets(table: NumberTable, names: list[RowName]) -> list[RowName]:
    """Return names with the targets in the one column that distinguishes rows of a posture in one state.

    The column has few texts or numbers, which most postures have; the points that numbers name keep their
    distances. Rows that lie together are repeats of a reading, and keep their names, as do those of several
    such columns. Rows with positions in two states are in no state. Other columns may tell repeats or loads
    of these points, if the points are farther from each other than any load moves one.
    """
    rows_of_name: dict[RowName, list[int]] = {}
    for row, name in enumerate(names):
        rows_of_name.setdefault(name, []).append(row)
    groups = list(rows_of_name.values())
    have_labels = all(name.label is not None and name.target is None for name in names)
    have_states = all(name.state is not None for name in names) or _has_columns_of_states(table)
    least = LEAST_BETWEEN_TARGETS if have_states else _LARGEST_DEFLECTION
    if not have_labels:
        return names
    if table.has_repeats or not are_far_apart(table, groups, least):
        return _add_distant_targets(table, names, groups)
    labels = [name.label or "" for name in names]
    columns = [
        column
        for column in range(len(table.headers))
        if _distinguishes(table, column, groups)
        and (table.has_words(column) or are_targets(table, labels, table.list_texts(column)))
    ]
    if len(columns) != 1:
        return names
    return _add_texts(names, table.list_texts(columns[0]))


def _add_texts(names: Sequence[RowName], targets: Sequence[str]) -> list[RowName]:
    """Return names with the target of each row."""
    return [name._replace(target=target) for name, target in zip(names, targets, strict=True)]


def _add_distant_targets(
    table: NumberTable, names: list[RowName], groups: Sequence[Sequence[int]]
) -> list[RowName]:
    """Return names with the targets in the one column whose points keep distances that no load makes.

    Most rows with the same names are several readings of these points.
    """
    labels = [name.label or "" for name in names]
    are_several = 2 * sum(len(group) > 1 for group in groups) > len(groups)
    columns = [
        column
        for column in range(len(table.headers))
        if table.may_name(column)
        and are_targets(table, labels, table.list_texts(column), _LARGEST_DEFLECTION)
    ]
    if not are_several or len(columns) != 1:
        return names
    return _add_texts(names, table.list_texts(columns[0]))


def _has_columns_of_states(table: NumberTable) -> bool:
    """Return whether headers name positions without load, and positions under load."""
    positions = (each.quantity for each in table.meanings if each is not None and each.kind == "position")
    return {"unloaded", "loaded"} <= {position.state for position in positions}


def are_far_apart(table: NumberTable, groups: Sequence[Sequence[int]], least: float) -> bool:
    """Return whether rows with the same names are positions of several targets: each is far from the others.

    A table without coordinates has no positions. A few groups may lack rows, or readings of their rows.

    Args:
        table: numbers of a file.
        groups: indices of the rows with the same names.
        least: least distance [m] of two targets along an axis of coordinates.
    """
    sizes_of_units = find_units_of_coordinates(table)
    if not sizes_of_units or max(map(len, groups)) > MOST_CODES:
        return False
    numbers = table.table.numbers
    is_known = np.isfinite(numbers[:, list(sizes_of_units)])
    known = set(np.flatnonzero(is_known.any(axis=1)).tolist())
    read = [[row for row in group if row in known] for group in groups]
    several = [group for group in read if len(group) > 1]
    if 2 * len(several) <= len(groups):
        return False
    for group in several:
        positions = np.array([size * numbers[group, column] for column, size in sizes_of_units.items()])
        distances = [
            float(np.fmax.reduce(np.abs(positions[:, first] - positions[:, second]), initial=0.0))
            for first, second in combinations(range(len(group)), 2)
        ]
        if min(distances) < least:
            return False
    return True


def _distinguishes(table: NumberTable, column: int, groups: Sequence[Sequence[int]]) -> bool:
    """Return whether a column has the same few names in most groups of rows, and no name twice in a group."""
    texts = table.list_texts(column)
    words = set(texts)
    are_names = table.has_words(column) or all(map(COUNTED.fullmatch, words))
    if not table.may_name(column) or not 1 < len(words) <= MOST_CODES or not are_names:
        return False
    own = [[texts[row] for row in group] for group in groups]
    complete_count = sum(len(each) == len(words) for each in own)
    return 2 * complete_count > len(groups) and all(len(set(each)) == len(each) for each in own)


def are_targets(
    table: NumberTable, postures: Sequence[str], points: Sequence[str], least: float = 0.0
) -> bool:
    """Return whether points are targets on one flange: most keep their distances, and move with the postures.

    Points that repeats or loads tell apart do not move so far. A point of a posture is the mean of its rows.

    Args:
        table: numbers of a file.
        postures: name of the posture of each row.
        points: name of the point of each row.
        least: least distance [m] of two targets.
    """
    sizes_of_units = find_units_of_coordinates(table)
    labels, targets = list(dict.fromkeys(postures)), list(dict.fromkeys(points))
    if not sizes_of_units or len(labels) < LEAST_LABELS or not 1 < len(targets) <= MOST_CODES:
        return False
    number_of_label = {label: number for number, label in enumerate(labels)}
    number_of_target = {target: number for number, target in enumerate(targets)}
    place = (
        [number_of_label[label] for label in postures],
        [number_of_target[target] for target in points],
    )
    coordinates = table.table.numbers[:, list(sizes_of_units)] * list(sizes_of_units.values())
    sums = np.zeros((len(labels), len(targets), len(sizes_of_units)))
    counts = np.zeros((len(labels), len(targets), 1))
    np.add.at(sums, place, coordinates)
    np.add.at(counts, place, 1.0)
    positions = np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0.0)
    first, second = np.triu_indices(len(targets), 1)
    distances = np.linalg.norm(positions[:, first] - positions[:, second], axis=2)
    moved = np.linalg.norm(np.diff(positions, axis=0), axis=2)
    if 2 * np.isfinite(distances).sum() <= distances.size or not np.isfinite(moved).any():
        return False
    distances = distances[:, np.isfinite(distances).any(axis=0)]
    usual = np.nanmedian(distances, axis=0)
    changes = np.abs(distances - usual)
    are_apart = bool((usual >= least).all())
    return are_apart and bool(
        np.nanmedian(changes) <= _MOST_CHANGE and np.nanmedian(moved) > _LARGEST_DEFLECTION
    )


def find_target_column(table: NumberTable, others: tuple[int | None, int | None]) -> int | None:
    """Return the column of names of targets; None without one, or if there is a single name.

    It is the first one if another column counts the postures, and the column of names of points if another
    one names the postures. `others` are the columns of labels and states.
    """
    column = table.find_column("target")
    label_column, _ = others
    if column is None and label_column and is_cycle_header(table.headers[label_column]):
        column = 0
    if column is None and label_column is not None:
        column = table.find_column("name")
    if column is None or column in others:
        return None
    count = len(set(table.list_texts(column)))
    return column if 1 < count <= MOST_CODES else None
