"""Hypotheses of the meaning of tables: which columns are joints, and which are positions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.meaning.table import (
    AngleUnit,
    JointColumns,
    JointCounting,
    PointColumns,
    RowGroups,
    Table,
    find_moving_columns,
)
from jointstiff.solver.mechanics.robot import Robot

_MOST_GROUPED: Final = 16
"""Most rows of a table for each posture."""
_LARGEST_RADIANS: Final = 6.6
_LARGEST_DEGREES: Final = 720.0
_LARGEST_SLIDE: Final = 20.0
"""Position of a prismatic joint from which the position is in mm; smaller positions are in m."""
_STEPS: Final = (1, 2, 4)
"""Distances of the columns of x, y and z: next to each other, with deviations between, in a 4 × 4 matrix."""
_LEAST_KNOWN: Final = 0.5
"""Least fraction of the rows in which a triple has numbers."""
_ROUNDING: Final = 1e-9
_FIRST_POSTURES: Final = 4
"""Postures that are compared before all are: most joints do not repeat."""
_ORDINARY: Final = 90.0
"""Percentile of absolute numbers that counts as their size: damaged cells may be larger."""


@dataclass(frozen=True, eq=False)
class JointHypothesis:
    """Columns of joints, and the positions of the model that they give."""

    columns: JointColumns
    q: FloatArray  #: (N, n) positions of the model's joints [rad or m]


@dataclass(frozen=True, eq=False)
class PointHypothesis:
    """Columns of positions, and the positions of K targets in N postures."""

    columns: PointColumns
    points: FloatArray  #: (N, K, 3) in the unit of the file; NaN for a missing position


def list_countings(robot: Robot) -> list[JointCounting]:
    """Return the ways in which controllers count joints: the maker's own, then those of other makers."""
    own, offset, n = robot.joint_map.matrix, robot.joint_map.offset, robot.n
    countings = [JointCounting("as the maker counts", own, offset, is_own=True)]
    countings.append(JointCounting("as the model counts", np.eye(n), np.zeros(n)))
    if n == 6:
        coupled, reverse = np.eye(6), np.eye(6)
        coupled[2, 1], reverse[2, 1] = 1.0, -1.0
        kuka, yaskawa = np.diag([-1.0, 1, 1, -1, 1, -1]), np.diag([1.0, 1, -1, -1, -1, -1])
        fanuc = np.diag([1.0, 1, -1, -1, -1, -1])
        fanuc[2, 1] = -1.0
        countings += [
            JointCounting("with J3 from the horizontal (J3 + J2)", own @ coupled, offset),
            JointCounting("with J3 from the horizontal (J3 − J2)", own @ reverse, offset),
            JointCounting("with J1, J4, J6 reversed, as KUKA", own @ kuka, offset),
            JointCounting("with J3 to J6 reversed, as Yaskawa", own @ yaskawa, offset),
            JointCounting("as FANUC counts", fanuc, np.zeros(6)),
        ]
    different: list[JointCounting] = []
    for each in countings:
        if not any(_are_equal(each, earlier) for earlier in different):
            different.append(each)
    return different


def _are_equal(first: JointCounting, second: JointCounting) -> bool:
    """Return whether two ways of counting give the same positions."""
    same_matrix = np.allclose(first.matrix, second.matrix)
    return bool(same_matrix and np.allclose(first.offset, second.offset))


def find_windows(table: Table, n: int) -> list[tuple[int, ...]]:
    """Return the columns that can be n joints, from base to flange or in reverse order."""
    if len(table.joints) == n:
        return [table.joints]
    moving = find_moving_columns(table.numbers)
    known = np.isfinite(table.numbers).all(axis=0)
    size = np.nanpercentile(np.abs(np.nan_to_num(table.numbers)), _ORDINARY, axis=0)
    can_be_angles: list[bool] = (known & (size <= _LARGEST_DEGREES)).tolist()
    fits = [can_be and column not in table.others for column, can_be in enumerate(can_be_angles)]
    windows: list[tuple[int, ...]] = []
    for first in range(len(fits) - n + 1):
        window = tuple(range(first, first + n))
        if all(fits[c] for c in window) and sum(moving[c] for c in window) >= min(3, n):
            windows += [window, window[::-1]]
    return windows


def find_repeats(table: Table, window: Sequence[int]) -> list[RowGroups]:
    """Return how the rows repeat their joints, such as three rows for each posture; ungrouped rows first."""
    joints = table.numbers[:, list(window)]
    rows, groups = len(joints), [RowGroups()]
    for count in range(2, _MOST_GROUPED + 1):
        if rows % count or rows // count < 3:
            continue
        for order in ("in turn", "in blocks"):
            group = RowGroups(order, count)
            split = group.split(joints)
            if _repeats(split[:_FIRST_POSTURES]) and _repeats(split):
                groups.append(group)
    return groups


def _repeats(joints: FloatArray) -> bool:
    """Return whether the joints (N, count, n) of each posture are equal."""
    return bool(np.abs(joints - joints[:, :1]).max() < _ROUNDING)


def build_joints(
    table: Table,
    window: tuple[int, ...],
    groups: RowGroups,
    rows: IndexArray,
    robot: Robot,
    countings: Sequence[JointCounting],
) -> Iterator[JointHypothesis]:
    """Yield the joints of a window of columns, in chosen postures, each unit and each way of counting."""
    numbers = groups.split(table.numbers[:, list(window)])[rows, 0]
    for unit in _find_angle_units(numbers[:, ~robot.prismatic]):
        angles = np.radians(numbers) if unit == "deg" else numbers
        slide = np.percentile(np.abs(numbers), _ORDINARY, axis=0) > _LARGEST_SLIDE
        lengths = np.where(slide, 1e-3 * numbers, numbers)
        controller = np.where(robot.prismatic, lengths, angles)
        for counting in countings:
            columns = JointColumns(table.name, window, unit, counting, groups)
            yield JointHypothesis(columns, controller @ counting.matrix.T + counting.offset)


def _find_angle_units(angles: FloatArray) -> list[AngleUnit]:
    """Return the units in which numbers can be angles."""
    if not angles.size:
        return ["rad"]
    largest = float(np.percentile(np.abs(angles), 100.0 if len(angles) < 8 else 98.0))
    if largest <= _LARGEST_RADIANS:
        return ["rad", "deg"]
    return ["deg"]


def find_triples(table: Table) -> list[tuple[int, int, int]]:
    """Return the columns that can be x, y and z."""
    moving = find_moving_columns(table.numbers)
    known = np.isfinite(table.numbers).mean(axis=0) > _LEAST_KNOWN
    excluded = table.others | set(table.joints)
    triples = []
    for step in _STEPS:
        for first in range(table.size[1] - 2 * step):
            triple = (first, first + step, first + 2 * step)
            is_free = not excluded & set(triple)
            if is_free and all(known[c] for c in triple) and sum(moving[c] for c in triple) >= 2:
                triples.append(triple)
    return triples


def list_groups(rows: int, postures: int) -> list[RowGroups]:
    """Return the ways in which rows of positions belong to postures."""
    if rows == postures:
        return [RowGroups()]
    count = rows // postures
    if rows % postures or count > _MOST_GROUPED:
        return []
    return [RowGroups("in turn", count), RowGroups("in blocks", count)]


def build_points(
    tables: Sequence[Table], joint_table: Table, joint_groups: RowGroups, rows: IndexArray
) -> Iterator[PointHypothesis]:
    """Yield the positions of all tables that can belong to the postures of a table of joints.

    Positions are those of chosen postures, the rows of `RowGroups.split`.
    """
    postures = joint_table.size[0] // joint_groups.count
    for table in tables:
        is_same = table is joint_table
        groups = [joint_groups] if is_same else list_groups(table.size[0], postures)
        for triple in find_triples(table):
            for group in groups:
                points = group.split(table.numbers[:, list(triple)])[rows]
                yield PointHypothesis(PointColumns(table.name, triple, group), points)
