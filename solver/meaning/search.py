"""Search of the readings of tables that a robot fits, best first."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
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
from jointstiff.solver.meaning.screening import FlangePlaces, LinearFit, fit_all
from jointstiff.solver.meaning.table import JointColumns, PointColumns, RowGroups, Table
from jointstiff.solver.mechanics.robot import KnownRobot

_SCREENED_ROWS: Final = 48
_REFINED_ROWS: Final = 150
_SCREENED_TARGETS: Final = 3
"""Targets of a posture with which readings are screened."""
_REFINED: Final = 20
"""Readings of a table that are fitted with a rotation of the frame."""
_REFINED_OF_WORDS: Final = 6
"""Of these, the readings with the same columns of joints, unit and way of counting."""
_GOOD: Final = 8e-3
"""Residual [m] of a linear fit that needs no search without rows that may be damaged."""
_SUBSETS: Final = 8
_LEAST_SUBSET: Final = 7
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
    """Return the readings of tables that are worth a comparison, the smallest residual first."""
    readings: list[Reading] = []
    for known in robots:
        model = FlangeModel.of(known.robot)
        for table in tables:
            readings += _search_table(tables, table, known, model)
    readings.sort(key=lambda reading: reading.fit.residual)
    return readings


def _search_table(
    tables: Sequence[Table], table: Table, known: KnownRobot, model: FlangeModel
) -> Iterator[Reading]:
    """Yield the readings in which a table has the joints."""
    windows = find_windows(table, known.robot.n)
    by_groups: dict[RowGroups, list[tuple[int, ...]]] = defaultdict(list)
    for window in windows:
        for groups in find_repeats(table, window):
            by_groups[groups].append(window)
    countings = list_countings(known.robot)
    for groups, grouped_windows in by_groups.items():
        joints = [
            hypothesis
            for window in grouped_windows
            for hypothesis in build_joints(table, window, groups, known.robot, countings)
        ]
        postures = table.size[0] // groups.count
        points = list(build_points(tables, table, groups, postures))
        for candidate in _screen(model, joints, points, postures):
            yield _refine(candidate, known, model, postures)


def choose_rows(count: int, most: int) -> IndexArray:
    """Return at most `most` indices of `count` rows, evenly spread."""
    if count <= most:
        return np.arange(count)
    return np.linspace(0, count - 1, most).astype(np.intp)


def _screen(
    model: FlangeModel, joints: Sequence[JointHypothesis], points: Sequence[PointHypothesis], postures: int
) -> list[_Candidate]:
    """Return the best readings by their linear fits; without a good one, also by subsets of the rows.

    One damaged position moves a fit by least squares. A subset without damaged positions fits.
    """
    if not joints or not points or postures < 3:
        return []
    rows = choose_rows(postures, _SCREENED_ROWS)
    q = np.stack([hypothesis.q[rows] for hypothesis in joints])
    rotation, place = model.place_flange(q)
    places = FlangePlaces(rotation, place)
    candidates = list(_fit_rows(places, joints, points, rows, np.arange(len(rows))))
    size = max(_LEAST_SUBSET, len(rows) // 2)
    is_settled = any(candidate.rank < _GOOD for candidate in candidates)
    if not is_settled and size < len(rows):
        generator = np.random.default_rng(0)
        for _ in range(_SUBSETS):
            chosen = np.sort(generator.choice(len(rows), size, replace=False))
            candidates += _fit_rows(places, joints, points, rows, chosen)
    return _keep_best(candidates)


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


def _refine(candidate: _Candidate, known: KnownRobot, model: FlangeModel, postures: int) -> Reading:
    """Fit the frame of a screened reading in more rows."""
    rows = choose_rows(postures, _REFINED_ROWS)
    rotation, place = model.place_flange(candidate.joints.q[rows])
    points = candidate.points.points[rows]
    targets = candidate.linear.targets
    missing = points.shape[1] - len(targets)
    start = np.concatenate([targets, np.repeat(targets[:1], missing, axis=0)])
    fit = fit_frame(rotation, place, points, candidate.linear.matrix, start)
    spread = np.nanstd(points - np.nanmean(points, axis=0), axis=0)
    movement = fit.frame.scale * float(np.nanmax(spread))
    return Reading(known, candidate.joints.columns, candidate.points.columns, fit, movement)
