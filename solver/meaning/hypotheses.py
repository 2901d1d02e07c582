"""Hypotheses of the meaning of tables: which columns are joints, and which are positions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.meaning.table import (
    AngleUnit,
    JointColumns,
    JointCounting,
    PointColumns,
    RowGroups,
    Table,
    find_moving_columns,
    find_rounding,
)
from jointstiff.solver.mechanics.robot import Robot

_MOST_GROUPED: Final = 16
"""Most rows of a table for each posture."""
_LARGEST_RADIANS: Final = 6.6
_LARGEST_DEGREES: Final = 720.0
_LARGEST_MILLIMETRES: Final = 50_000.0
_LARGEST_SLIDE: Final = 20.0
"""Position of a prismatic joint from which the position is in mm; smaller positions are in m."""
_STEPS: Final = (1, 2, 4)
"""Distances of the columns of x, y and z: next to each other, with deviations between, in a 4 × 4 matrix."""
_LEAST_KNOWN: Final = 0.5
"""Least fraction of the rows in which a triple has numbers."""
_ENCODER_NOISE: Final = 1e-4
"""Greatest difference [rad] of a joint of rows of one posture: what encoders read of an arm at rest."""
_LARGEST_STEP: Final = 0.01
"""Step [°] of rounded joints, at most, by which the joints of one posture may differ."""
_ARITHMETIC: Final = 1e-9
_CELL: Final = 4.0
"""Size of a cell of joints in which rows are one posture, in the noise of joints."""
_HALVES: Final = (0.0, 0.5)
"""Shifts of the cells, as a part of a cell."""
_LEAST_POSTURES: Final = 3
"""Least number of postures of a table."""
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
    """Return the ways in which controllers count joints: the maker's own, then those of other makers.

    Each is a map ``q = M q_c + o`` from the controller's joints q_c to the model's joints q, with M and o in
    this order. Ways that are equal for this robot are returned once.
    """
    own, offset, n = robot.joint_map.matrix, robot.joint_map.offset, robot.n
    countings = [
        JointCounting("as the maker counts", own, offset, is_own=True),
        JointCounting("as the model counts", np.eye(n), np.zeros(n)),
    ]
    if n == 6:
        countings += _list_countings_of_makers(own, offset)
    different: list[JointCounting] = []
    for counting in countings:
        if not any(_are_equal(counting, earlier) for earlier in different):
            different.append(counting)
    return different


def _list_countings_of_makers(own: FloatArray, offset: FloatArray) -> list[JointCounting]:
    """Return the ways in which makers of six-axis arms count joints.

    Makers differ in the signs of joints, and in whether J3 is counted from the upper arm or from the
    horizontal: then the controller's J3 stays when J2 turns, and the model's J3 is J3 + J2 or J3 − J2.

    Args:
        own: M (6, 6) of the robot's own maker.
        offset: o (6,) of the robot's own maker [rad].
    """
    kuka = np.diag([-1.0, 1.0, 1.0, -1.0, 1.0, -1.0])
    yaskawa = np.diag([1.0, 1.0, -1.0, -1.0, -1.0, -1.0])
    fanuc = _add_j2_to_j3(yaskawa, -1.0)
    return [
        JointCounting("with J3 from the horizontal (J3 + J2)", own @ _add_j2_to_j3(np.eye(6), 1.0), offset),
        JointCounting("with J3 from the horizontal (J3 − J2)", own @ _add_j2_to_j3(np.eye(6), -1.0), offset),
        JointCounting("with J1, J4, J6 reversed, as KUKA", own @ kuka, offset),
        JointCounting("with J3 to J6 reversed, as Yaskawa", own @ yaskawa, offset),
        JointCounting("as FANUC counts", fanuc, np.zeros(6)),
    ]


def _add_j2_to_j3(matrix: FloatArray, factor: float) -> FloatArray:
    """Return a map (6, 6) of joints that adds `factor` times J2 to J3."""
    j2, j3 = 1, 2  # indices of the joints
    coupled = matrix.copy()
    coupled[j3, j2] = factor
    return coupled


def _are_equal(first: JointCounting, second: JointCounting) -> bool:
    """Return whether two ways of counting give the same positions."""
    same_matrix = np.allclose(first.matrix, second.matrix)
    return bool(same_matrix and np.allclose(first.offset, second.offset))


def find_windows(table: Table, prismatic: BoolArray) -> list[tuple[int, ...]]:
    """Return the runs of columns that can be the joints, from base to flange or in reverse order.

    A joint has a number in each row, none larger than an angle or a length; a few damaged numbers may be
    larger. At least three columns of a run must change, or all of fewer joints.

    Args:
        table: numbers of a file.
        prismatic: (n,) which joints of the robot slide.
    """
    n = len(prismatic)
    is_moving = np.array(find_moving_columns(table.numbers))
    is_complete = np.asarray(np.isfinite(table.numbers).all(axis=0))
    size = np.asarray(np.nanpercentile(np.abs(np.nan_to_num(table.numbers)), _ORDINARY, axis=0))
    largest = np.where(prismatic, _LARGEST_MILLIMETRES, _LARGEST_DEGREES)
    windows: list[tuple[int, ...]] = []
    for first in range(len(size) - n + 1):
        forward = tuple(range(first, first + n))
        columns = list(forward)
        if not is_complete[columns].all() or is_moving[columns].sum() < min(3, n):
            continue
        directions = (forward, forward[::-1])
        windows += [window for window in directions if bool((size[list(window)] <= largest).all())]
    return windows


def find_repeats(table: Table, window: Sequence[int]) -> list[RowGroups]:
    """Return how the rows repeat their joints, such as three rows for each posture; ungrouped rows first.

    The rows of a posture follow each other ("in turn"), or each block of rows has every posture once ("in
    blocks"). `window` are the columns of the joints.
    """
    joints = table.numbers[:, list(window)]
    bound = find_joint_noise(joints)
    ungrouped = RowGroups()
    groupings = [ungrouped]
    for rows_of_posture in range(2, _MOST_GROUPED + 1):
        posture_count, rest = divmod(len(joints), rows_of_posture)
        if rest or posture_count < _LEAST_POSTURES:
            continue
        for order in ("in turn", "in blocks"):
            grouping = RowGroups(order, rows_of_posture)
            joints_of_postures = grouping.split(joints)
            if _repeats(joints_of_postures[:_FIRST_POSTURES], bound) and _repeats(joints_of_postures, bound):
                groupings.append(grouping)
    return groupings


def find_joint_noise(joints: FloatArray) -> float:
    """Return how much joints (N, n) of one posture may differ, in the unit of the joints.

    Encoders of an arm at rest differ by 1e-4 rad at most, and rounded joints by a step of up to 0.01°.
    """
    is_in_degrees = np.nanpercentile(np.abs(joints), _ORDINARY) > _LARGEST_RADIANS
    radian = float(np.degrees(1.0)) if is_in_degrees else 1.0
    step, largest_step = find_rounding(joints), _LARGEST_STEP * radian / float(np.degrees(1.0))
    return max(_ENCODER_NOISE * radian, step if step <= largest_step else 0.0) + _ARITHMETIC


def number_postures(joints: FloatArray) -> IndexArray:
    """Return the number of the posture of each row of joints (N, n), in the order of appearance.

    Rows are one posture if their joints are in one cell of a grid. Noise crosses a border of one of two grids
    at most, so that the grid with fewer postures counts.
    """
    size = _CELL * find_joint_noise(joints)
    numbered = (np.unique(np.floor(joints / size + shift), axis=0, return_inverse=True) for shift in _HALVES)
    cells = min((inverse.reshape(-1) for _, inverse in numbered), key=lambda own: int(own.max()))
    _, first, postures = np.unique(cells, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[postures.reshape(-1)]


def _repeats(joints: FloatArray, bound: float) -> bool:
    """Return whether the joints (N, count, n) of each posture differ by no more than a bound."""
    return bool((joints.max(axis=1) - joints.min(axis=1)).max() <= bound)


def build_joints(
    table: Table,
    window: tuple[int, ...],
    groups: RowGroups,
    rows: IndexArray,
    robot: Robot,
    countings: Sequence[JointCounting],
) -> Iterator[JointHypothesis]:
    """Yield the model's joints by some columns of a table, for each possible unit and way of counting.

    Args:
        table: numbers of a file.
        window: columns of the joints, from base to flange.
        groups: which rows belong to one posture; the mean of their joints is read.
        rows: indices of the postures to read.
        robot: robot with as many joints as columns.
        countings: ways in which controllers count joints.
    """
    numbers_of_postures = groups.split(table.numbers[:, list(window)])
    numbers = numbers_of_postures[rows].mean(axis=1)
    is_in_mm = np.percentile(np.abs(numbers), _ORDINARY, axis=0) > _LARGEST_SLIDE
    lengths = np.where(is_in_mm, 1e-3 * numbers, numbers)
    for unit in _find_angle_units(numbers[:, ~robot.prismatic]):
        angles = np.radians(numbers) if unit == "deg" else numbers
        controller_joints = np.where(robot.prismatic, lengths, angles)
        for counting in countings:
            columns = JointColumns(table.name, window, unit, counting, groups)
            yield JointHypothesis(columns, controller_joints @ counting.matrix.T + counting.offset)


def _find_angle_units(angles: FloatArray) -> list[AngleUnit]:
    """Return the units in which numbers can be angles."""
    if not angles.size:
        return ["rad"]
    # In longer tables a few damaged numbers may be larger.
    percentile = 100.0 if len(angles) < 8 else 98.0
    largest = float(np.percentile(np.abs(angles), percentile))
    return ["rad", "deg"] if largest <= _LARGEST_RADIANS else ["deg"]


def find_triples(table: Table) -> list[tuple[int, int, int]]:
    """Return the columns that can be x, y and z: three columns at equal distances; two or more change."""
    is_moving = find_moving_columns(table.numbers)
    has_numbers = np.isfinite(table.numbers).mean(axis=0) > _LEAST_KNOWN
    _, column_count = table.size
    triples = []
    for step in _STEPS:
        for first in range(column_count - 2 * step):
            triple = (first, first + step, first + 2 * step)
            all_have_numbers = all(has_numbers[column] for column in triple)
            moving_count = sum(is_moving[column] for column in triple)
            if all_have_numbers and moving_count >= 2:
                triples.append(triple)
    return triples


def list_groups(rows: int, postures: int) -> list[RowGroups]:
    """Return the ways in which rows of positions belong to postures."""
    if rows == postures:
        return [RowGroups()]
    rows_of_posture, rest = divmod(rows, postures)
    if rest or rows_of_posture > _MOST_GROUPED:
        return []
    return [RowGroups("in turn", rows_of_posture), RowGroups("in blocks", rows_of_posture)]


def build_points(
    tables: Sequence[Table], joint_table: Table, joint_groups: RowGroups, rows: IndexArray
) -> Iterator[PointHypothesis]:
    """Yield the positions of all tables that can belong to the postures of a table of joints.

    Args:
        tables: numbers of files.
        joint_table: table with the joints.
        joint_groups: which rows of this table belong to one posture.
        rows: indices of the postures to read.
    """
    row_count, _ = joint_table.size
    posture_count = row_count // joint_groups.count
    for table in tables:
        groupings = [joint_groups] if table is joint_table else list_groups(table.size[0], posture_count)
        for triple in find_triples(table):
            for grouping in groupings:
                positions_of_postures = grouping.split(table.numbers[:, list(triple)])
                columns = PointColumns(table.name, triple, grouping)
                yield PointHypothesis(columns, positions_of_postures[rows])
