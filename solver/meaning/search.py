"""Search of the interpretations of tables that a robot fits, best first."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from operator import itemgetter
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.meaning.budget import FITS_OF_REFINEMENT, Budget
from jointstiff.solver.meaning.hypotheses import (
    JointHypothesis,
    PointHypothesis,
    build_joints,
    build_points,
    find_repeats,
    find_windows,
    list_countings,
)
from jointstiff.solver.meaning.kinematics import FlangeModel
from jointstiff.solver.meaning.refinement import RigidFit, fit_frame
from jointstiff.solver.meaning.screening import FlangePlaces, LinearFit, choose_subsets, fit_all
from jointstiff.solver.meaning.table import JointColumns, PointColumns, RowGroups, Table, find_rounding
from jointstiff.solver.mechanics.robot import Robot

_SCREENED_ROWS: Final = 48
REFINED_ROWS: Final = 150
_SCREENED_TARGETS: Final = 3
"""Targets of a posture with which interpretations are screened."""
_REFINED: Final = 20
"""Interpretations of a table that are fitted with a rotation of the frame."""
_REFINED_OF_ALL: Final = 48
"""Interpretations of all tables that are fitted with a rotation of the frame."""
_REFINED_OF_WORDS: Final = 6
"""Of these, the interpretations with the same columns of joints, unit and way of counting."""
_GOOD: Final = 8e-3
"""Residual [m] of a linear fit that needs no search without rows that may be damaged."""
_FITS_OF_SUBSETS: Final = 1_500_000
"""Fits of subsets of the rows at most: a budget of their own."""
_LEAST_POSTURES: Final = 3
_SAME_JOINTS: Final = 1e-4
"""Difference of joints in two tables, as a part of their movement, up to which the joints are the same."""


NEAR_MODEL: Final = 1.5e-4
"""Median distance [m] up to which positions may have been computed by a controller from rounded joints."""
_MARGIN: Final = 1.1
"""Factor on the largest distance that rounding explains: the fit of frame and targets moves positions."""


@dataclass(frozen=True, eq=False)
class Interpretation:
    """Meaning of the columns of joints and of one triple of positions, with the fit of a robot."""

    robot: Robot
    joints: JointColumns
    points: PointColumns
    fit: RigidFit
    movement: float  #: largest standard deviation of a coordinate [m]
    joint_rounding: float  #: typical distance by which rounding of the joints moves a position [m]
    point_rounding: float  #: typical distance by which rounding of the positions moves a position [m]
    #: fraction of the positions that rounding may have moved so far; 1 if farther off, or not in R0
    share_by_rounding: float = 1.0


@dataclass(frozen=True, eq=False)
class _Candidate:
    """Interpretation that was screened."""

    joints: JointHypothesis
    points: PointHypothesis
    linear: LinearFit

    @property
    def rank(self) -> float:
        """Residual [m] of the linear fit, larger if the targets hardly move."""
        return self.linear.rank


def find_interpretations(tables: Sequence[Table], robot: Robot, budget: Budget) -> list[Interpretation]:
    """Return the interpretations of tables that are worth a comparison, the smallest residual first.

    All interpretations are screened by linear fits; the best of these are refined.

    Raises:
        BudgetExceeded: too many columns may be joints or positions.
    """
    searches = list(_list_searches(tables, robot))
    kept = []
    for search, candidates in zip(searches, _screen(searches, budget), strict=True):
        kept += [(candidate.rank, search, candidate) for candidate in _keep_best(candidates)]
    kept.sort(key=itemgetter(0))
    interpretations = []
    for _, search, candidate in kept[:_REFINED_OF_ALL]:
        budget.spend(FITS_OF_REFINEMENT)
        interpretations.append(search.refine(candidate))
    interpretations.sort(key=lambda interpretation: interpretation.fit.residual)
    return interpretations


def _screen(searches: Sequence[_Search], budget: Budget) -> list[list[_Candidate]]:
    """Return for each search the interpretations that fit by a linear fit.

    If the robot has no good interpretation in all rows, subsets of the rows are tried: one damaged position
    moves a fit by least squares, and a subset without damaged positions fits.
    """
    hypothesis_count = sum(len(search.joints) * len(search.points) for search in searches)
    budget.spend(hypothesis_count)
    candidates_of_searches = [search.screen_all_rows() for search in searches]
    all_candidates = chain.from_iterable(candidates_of_searches)
    if any(candidate.rank < _GOOD for candidate in all_candidates):
        return candidates_of_searches
    most_subsets = _FITS_OF_SUBSETS // max(hypothesis_count, 1)
    for search, candidates in zip(searches, candidates_of_searches, strict=True):
        budget.spend()
        candidates.extend(search.screen_subsets(most_subsets))
    return candidates_of_searches


def _list_searches(tables: Sequence[Table], robot: Robot) -> Iterator[_Search]:
    """Yield the searches of a robot: one for each table of joints, and for each grouping of its rows.

    A grouping tells which rows belong to one posture, such as three rows in turn.
    """
    model, countings = FlangeModel.of(robot), list_countings(robot)
    table_of_name = {table.name: table for table in tables}
    joints_of_earlier_tables: list[FloatArray] = []
    for table in tables:
        windows = find_windows(table, robot.prismatic)
        new_windows = _leave_out_repeated(table, windows, joints_of_earlier_tables)
        for groups, windows_of_groups in _group_windows(table, new_windows).items():
            rows = choose_rows(table.size[0] // groups.count, REFINED_ROWS)
            joints: list[JointHypothesis] = []
            for window in windows_of_groups:
                joints += build_joints(table, window, groups, rows, robot, countings)
            points = list(build_points(tables, table, groups, rows))
            if joints and points and len(rows) >= _LEAST_POSTURES:
                yield _Search(table_of_name, robot, model, joints, points)
        joints_of_earlier_tables += [table.numbers[:, list(window)] for window in windows]


def _leave_out_repeated(
    table: Table, windows: Sequence[tuple[int, ...]], joints_of_earlier_tables: Sequence[FloatArray]
) -> list[tuple[int, ...]]:
    """Return the columns that can be joints, without those whose numbers another table has already.

    A file for each state, such as loaded and unloaded, often has the same joints again.
    """
    new_windows = []
    for window in windows:
        numbers = table.numbers[:, list(window)]
        if not any(_are_same_joints(numbers, earlier) for earlier in joints_of_earlier_tables):
            new_windows.append(window)
    return new_windows


def _group_windows(
    table: Table, windows: Sequence[tuple[int, ...]]
) -> dict[RowGroups, list[tuple[int, ...]]]:
    """Return grouping of rows → the runs of columns that repeat their joints in this way.

    For example nine rows in groups of three "in turn" are three postures.
    """
    windows_of_groups: dict[RowGroups, list[tuple[int, ...]]] = defaultdict(list)
    for window in windows:
        for groups in find_repeats(table, window):
            windows_of_groups[groups].append(window)
    return windows_of_groups


def _are_same_joints(first: FloatArray, second: FloatArray) -> bool:
    """Return whether two tables have the same numbers (N, n) up to a small part of their movement."""
    if first.shape != second.shape:
        return False
    largest = _SAME_JOINTS * np.ptp(first)
    first_rows_differ = np.abs(first[0] - second[0]).max() > largest  # spares most comparisons of all rows
    return not first_rows_differ and bool(np.abs(first - second).max() <= largest)


@dataclass(frozen=True, eq=False)
class _Search:
    """Hypotheses of the joints of one robot in one table, with the positions of all tables."""

    tables: Mapping[str, Table]  #: by name
    robot: Robot
    model: FlangeModel
    joints: Sequence[JointHypothesis]
    points: Sequence[PointHypothesis]

    @cached_property
    def rows(self) -> IndexArray:
        """Rows that are screened, of the rows of the hypotheses."""
        return choose_rows(len(self.joints[0].q), _SCREENED_ROWS)

    @cached_property
    def places(self) -> FlangePlaces:
        """Flange in the screened rows, by each hypothesis of the joints."""
        q = np.stack([hypothesis.q[self.rows] for hypothesis in self.joints])
        return FlangePlaces(*self.model.place_flange(q))

    def screen_all_rows(self) -> list[_Candidate]:
        """Return the interpretations that fit in the screened rows, by their linear fits."""
        all_rows = np.arange(len(self.rows))
        return list(self._fit_rows(all_rows))

    def screen_subsets(self, most: int) -> Iterator[_Candidate]:
        """Yield the interpretations that fit in a subset of the screened rows, of at most so many subsets."""
        for chosen in choose_subsets(len(self.rows))[:most]:
            yield from self._fit_rows(chosen)

    def _fit_rows(self, chosen: IndexArray) -> Iterator[_Candidate]:
        """Yield the interpretations that fit in some of the screened rows, given by their indices.

        Each hypothesis of the joints is fitted to each hypothesis of the positions, unless the two share a
        column. The columns of all hypotheses of the joints are stacked once for each number of targets.
        """
        places = FlangePlaces(self.places.rotation[:, chosen], self.places.place[:, chosen])
        rows = self.rows[chosen]
        columns_by_target_count: dict[int, FloatArray] = {}
        for points in self.points:
            positions = points.points[rows, :_SCREENED_TARGETS]  # (N, K, 3)
            target_count = positions.shape[1]
            if target_count not in columns_by_target_count:
                columns_by_target_count[target_count] = places.stack_columns(target_count)
            for linear_fit in fit_all(columns_by_target_count[target_count], positions):
                joints = self.joints[linear_fit.hypothesis]
                if not _share_columns(joints.columns, points.columns):
                    yield _Candidate(joints, points, linear_fit)

    def refine(self, candidate: _Candidate) -> Interpretation:
        """Fit the frame of a screened interpretation in more rows, and with all K targets.

        The fit starts with the targets that were not screened at the place of the first one.
        """
        rotation, place = self.model.place_flange(candidate.joints.q)
        points = candidate.points.points  # (N, K, 3)
        targets = _complete_targets(candidate.linear.targets, count=points.shape[1])
        fit = fit_frame(rotation, place, points, candidate.linear.matrix, targets)
        reach = float(np.median(np.linalg.norm(place, axis=1)))
        rounding = self._find_rounding(candidate, fit.frame.scale)
        return Interpretation(
            robot=self.robot,
            joints=candidate.joints.columns,
            points=candidate.points.columns,
            fit=fit,
            movement=fit.frame.scale * _measure_largest_deviation(points),
            joint_rounding=rounding.move_by_joints(reach),
            point_rounding=rounding.move_by_coordinates(),
            share_by_rounding=self._measure_share(candidate, fit, rounding),
        )

    def _measure_share(self, candidate: _Candidate, fit: RigidFit, rounding: _Rounding) -> float:
        """Return the fraction of the positions whose deviations rounding of joints and coordinates explains.

        Joints that are off by half a step at most move a position along its deviation r by at most
        Σ |∂x/∂q_j · r/|r|| step/2. Noise of the same size moves many positions farther.
        """
        if not fit.frame.is_base or fit.typical > NEAR_MODEL:
            return 1.0
        matrix = candidate.joints.columns.counting.matrix
        written_steps = 0.5 * rounding.angle * np.abs(matrix).sum(axis=1)  # (n,) [rad]
        places = self._place_targets(candidate.joints.q, fit.targets)  # (N, K, 3)
        deviations = fit.frame.to_base(candidate.points.points) - places
        sizes = np.linalg.norm(deviations, axis=2)
        directions = deviations / np.maximum(sizes, 1e-12)[..., None]
        farthest = np.sqrt(3.0) * rounding.length
        for joint, step in enumerate(written_steps):
            moved = candidate.joints.q.copy()
            moved[:, joint] += step
            shifts = self._place_targets(moved, fit.targets) - places
            farthest = farthest + np.abs(np.einsum("nki,nki->nk", shifts, directions))
        is_known = np.isfinite(sizes)
        return float(np.mean((sizes <= _MARGIN * farthest)[is_known]))

    def _place_targets(self, q: FloatArray, targets: FloatArray) -> FloatArray:
        """Return the positions (N, K, 3) in R0 [m] of targets (K, 3) on the flange, in postures q (N, n)."""
        rotation, place = self.model.place_flange(q)
        return np.asarray(place[:, None] + np.einsum("nij,kj->nki", rotation, targets))

    def _find_rounding(self, candidate: _Candidate, metres: float) -> _Rounding:
        """Return the steps to which a file's numbers were rounded; `metres` is its unit of length [m]."""
        joints, points = candidate.joints.columns, candidate.points.columns
        angle = find_rounding(self.tables[joints.table].numbers[:, list(joints.columns)])
        length = find_rounding(self.tables[points.table].numbers[:, list(points.columns)])
        if joints.unit == "deg":
            angle = np.radians(angle)
        return _Rounding(angle, length * metres)


@dataclass(frozen=True)
class _Rounding:
    """Steps to which angles and coordinates were rounded; 0 for steps too small to be seen."""

    angle: float  # [rad]
    length: float  # [m]

    def move_by_joints(self, reach: float) -> float:
        """Return the typical distance [m] by which rounded joints move the flange of an arm of a reach [m].

        A number rounded to steps of s is off by s / √12. The three joints of the arm move the flange by about
        the reach, those of the wrist by much less.
        """
        return float(np.sqrt(3.0 / 12.0) * reach * self.angle)

    def move_by_coordinates(self) -> float:
        """Return the typical distance [m] by which rounding of three coordinates moves a position."""
        return float(np.sqrt(3.0 / 12.0) * self.length)


def _complete_targets(screened: FloatArray, *, count: int) -> FloatArray:
    """Return places (K, 3) of `count` targets on the flange: the screened ones, then copies of the first."""
    copies = np.repeat(screened[:1], count - len(screened), axis=0)
    return np.concatenate([screened, copies])


def _measure_largest_deviation(points: FloatArray) -> float:
    """Return the largest standard deviation of a coordinate of positions (N, K, 3), in their unit."""
    deviations = np.nanstd(points - np.nanmean(points, axis=0), axis=0)
    return float(np.nanmax(deviations))


def choose_rows(count: int, most: int) -> IndexArray:
    """Return at most `most` indices of `count` rows, evenly spread."""
    if count <= most:
        return np.arange(count)
    return np.linspace(0, count - 1, most).astype(np.intp)


def _share_columns(joints: JointColumns, points: PointColumns) -> bool:
    """Return whether a column is both a joint and a coordinate, which is impossible."""
    return joints.table == points.table and bool(set(joints.columns) & set(points.columns))


def _keep_best(candidates: list[_Candidate]) -> list[_Candidate]:
    """Return up to `_REFINED` of the best candidates, each pair of hypotheses once.

    Subsets of the rows give the same pair of joints and positions again. At most `_REFINED_OF_WORDS` of the
    candidates have the same hypothesis of the joints. A hypothesis is identified by its object.
    """
    kept: list[_Candidate] = []
    kept_pairs: set[tuple[int, int]] = set()
    kept_of_joints: Counter[int] = Counter()
    for candidate in sorted(candidates, key=lambda candidate: candidate.rank):
        joints, points = id(candidate.joints), id(candidate.points)
        if (joints, points) in kept_pairs or kept_of_joints[joints] >= _REFINED_OF_WORDS:
            continue
        kept_pairs.add((joints, points))
        kept_of_joints[joints] += 1
        kept.append(candidate)
        if len(kept) == _REFINED:
            break
    return kept
