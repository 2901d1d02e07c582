"""Search of the readings of tables that a robot fits, best first."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.meaning.hypotheses import (
    JointHypothesis,
    PointHypothesis,
    build_joints,
    build_points,
    find_repeats,
    find_triples,
    find_windows,
    list_countings,
)
from jointstiff.solver.meaning.kinematics import FlangeModel
from jointstiff.solver.meaning.refinement import RigidFit, fit_frame
from jointstiff.solver.meaning.screening import FlangePlaces, LinearFit, fit_all
from jointstiff.solver.meaning.table import JointColumns, PointColumns, RowGroups, Table
from jointstiff.solver.mechanics.robot import KnownRobot

_SCREENED_ROWS: Final = 48
_REFINED_ROWS: Final = 150
_SCREENED_TARGETS: Final = 3
"""Targets of a posture with which readings are screened."""
_REFINED: Final = 20
"""Readings of a table that are fitted with a rotation of the frame."""
_REFINED_OF_ALL: Final = 48
"""Readings of all tables and robots that are fitted with a rotation of the frame."""
_REFINED_OF_WORDS: Final = 6
"""Of these, the readings with the same columns of joints, unit and way of counting."""
_GOOD: Final = 8e-3
"""Residual [m] of a linear fit that needs no search without rows that may be damaged."""
_SUBSETS: Final = 8
MOST_READINGS: Final = 1_500_000
"""Readings that are compared at most, in some ten seconds."""
_LEAST_SUBSET: Final = 7
_LEAST_POSTURES: Final = 3
_READINGS_OF_PAIR: Final = 14
"""Readings of columns of joints and of positions: units and ways of counting."""
_ORDINARY_MOVEMENT: Final = 0.3
"""Movement [m] of the targets below which a small residual says less."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Meaning of the columns of joints and of one triple of positions, with the fit of a robot."""

    known: KnownRobot  #: robot that fits
    joints: JointColumns
    points: PointColumns
    fit: RigidFit
    movement: float  #: largest standard deviation of a coordinate [m]


@dataclass(frozen=True, eq=False)
class _Candidate:
    """Reading that was screened."""

    joints: JointHypothesis
    points: PointHypothesis
    linear: LinearFit

    @property
    def rank(self) -> float:
        """Residual [m], larger if the targets hardly move."""
        return self.linear.residual * max(1.0, _ORDINARY_MOVEMENT / self.linear.movement)


def find_readings(tables: Sequence[Table], robots: Iterable[KnownRobot]) -> list[Reading]:
    """Return the readings of tables that are worth a comparison, the smallest residual first.

    If no robot has a good reading in all rows, subsets of the rows are tried: one damaged position moves a
    fit by least squares, and a subset without damaged positions fits.
    """
    searches = [search for known in robots for search in _list_searches(tables, known)]
    screened = [(search, search.screen_all_rows()) for search in searches]
    if not any(_is_good(candidates) for _, candidates in screened):
        count = sum(len(search.joints) * len(search.points) for search in searches)
        subsets = min(_SUBSETS, MOST_READINGS // max(count, 1))
        screened = [(search, [*found, *search.screen_subsets(subsets)]) for search, found in screened]
    kept = [(search, each) for search, found in screened for each in _keep_best(found)]
    kept.sort(key=lambda pair: pair[1].rank)
    readings = [search.refine(each) for search, each in kept[:_REFINED_OF_ALL]]
    readings.sort(key=lambda reading: reading.fit.residual)
    return readings


def _is_good(candidates: Sequence[_Candidate]) -> bool:
    """Return whether a reading fits so well that no rows can be damaged."""
    return any(candidate.rank < _GOOD for candidate in candidates)


def _list_searches(tables: Sequence[Table], known: KnownRobot) -> Iterator[_Search]:
    """Yield the searches of a robot: one for each table of joints, and for each grouping of its rows."""
    model, countings = FlangeModel.of(known.robot), list_countings(known.robot)
    for table in tables:
        by_groups: dict[RowGroups, list[tuple[int, ...]]] = defaultdict(list)
        for window in find_windows(table, known.robot.n):
            for groups in find_repeats(table, window):
                by_groups[groups].append(window)
        for groups, windows in by_groups.items():
            rows = choose_rows(table.size[0] // groups.count, _REFINED_ROWS)
            joints = [
                hypothesis
                for window in windows
                for hypothesis in build_joints(table, window, groups, rows, known.robot, countings)
            ]
            points = list(build_points(tables, table, groups, rows))
            if joints and points and len(rows) >= _LEAST_POSTURES:
                yield _Search(known, model, joints, points)


def count_hypotheses(tables: Sequence[Table], robots: Sequence[KnownRobot]) -> int:
    """Return how many readings a search would compare, at most."""
    triples = sum(len(find_triples(table)) for table in tables)
    sizes = Counter(known.robot.n for known in robots)
    windows = sum(len(find_windows(table, n)) * count for table in tables for n, count in sizes.items())
    return windows * triples * _READINGS_OF_PAIR


@dataclass(frozen=True, eq=False)
class _Search:
    """Hypotheses of the joints of one robot in one table, with the positions of all tables."""

    known: KnownRobot
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
        """Return the readings that fit in the screened rows, by their linear fits."""
        chosen = np.arange(len(self.rows))
        return list(_fit_rows(self.places, self.joints, self.points, self.rows, chosen))

    def screen_subsets(self, subsets: int) -> Iterator[_Candidate]:
        """Yield the readings that fit in one of some random halves of the screened rows."""
        count = len(self.rows)
        size = max(_LEAST_SUBSET, count // 2)
        generator = np.random.default_rng(0)
        for _ in range(subsets if size < count else 0):
            chosen = np.sort(generator.choice(count, size, replace=False))
            yield from _fit_rows(self.places, self.joints, self.points, self.rows, chosen)

    def refine(self, candidate: _Candidate) -> Reading:
        """Fit the frame of a screened reading in more rows."""
        rotation, place = self.model.place_flange(candidate.joints.q)
        points = candidate.points.points
        targets = candidate.linear.targets
        missing = points.shape[1] - len(targets)
        start = np.concatenate([targets, np.repeat(targets[:1], missing, axis=0)])
        fit = fit_frame(rotation, place, points, candidate.linear.matrix, start)
        spread = np.nanstd(points - np.nanmean(points, axis=0), axis=0)
        movement = fit.frame.scale * float(np.nanmax(spread))
        return Reading(self.known, candidate.joints.columns, candidate.points.columns, fit, movement)


def choose_rows(count: int, most: int) -> IndexArray:
    """Return at most `most` indices of `count` rows, evenly spread."""
    if count <= most:
        return np.arange(count)
    return np.linspace(0, count - 1, most).astype(np.intp)


def _fit_rows(
    places: FlangePlaces,
    joints: Sequence[JointHypothesis],
    points: Sequence[PointHypothesis],
    rows: IndexArray,
    chosen: IndexArray,
) -> Iterator[_Candidate]:
    """Yield the readings that fit in chosen rows of the screened rows."""
    part = FlangePlaces(places.rotation[:, chosen], places.place[:, chosen])
    columns: dict[int, FloatArray] = {}
    for hypothesis in points:
        seen = hypothesis.points[rows[chosen], :_SCREENED_TARGETS]
        count = seen.shape[1]
        if count not in columns:
            columns[count] = part.stack_columns(count)
        for linear in fit_all(columns[count], seen):
            joint = joints[linear.hypothesis]
            if not _share_columns(joint.columns, hypothesis.columns):
                yield _Candidate(joint, hypothesis, linear)


def _share_columns(joints: JointColumns, points: PointColumns) -> bool:
    """Return whether a column is a joint and a coordinate."""
    return joints.table == points.table and bool(set(joints.columns) & set(points.columns))


def _keep_best(candidates: list[_Candidate]) -> list[_Candidate]:
    """Return the best candidates, each reading once, not all with the same columns of joints."""
    candidates.sort(key=lambda candidate: candidate.rank)
    kept: list[_Candidate] = []
    seen: set[tuple[int, int]] = set()
    of_words: Counter[int] = Counter()
    for candidate in candidates:
        words = id(candidate.joints)
        key = (words, id(candidate.points))
        if key in seen or of_words[words] >= _REFINED_OF_WORDS:
            continue
        seen.add(key)
        of_words[words] += 1
        kept.append(candidate)
        if len(kept) == _REFINED:
            break
    return kept
