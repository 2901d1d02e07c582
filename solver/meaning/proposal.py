"""Proposal of a robot for the meaning of tables: columns, units, frame, targets and states, with a margin."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.decision import LARGEST_RESIDUAL, Decision, decide, find_doubt
from jointstiff.solver.meaning.hypotheses import build_joints, build_points
from jointstiff.solver.meaning.kinematics import FlangeModel
from jointstiff.solver.meaning.refinement import FramePlacement, fit_targets
from jointstiff.solver.meaning.search import (
    MOST_READINGS,
    Reading,
    choose_rows,
    count_hypotheses,
    find_readings,
)
from jointstiff.solver.meaning.table import JointColumns, LengthUnit, PointColumns, Table
from jointstiff.solver.mechanics.robot import KnownRobot

USUAL_RESIDUAL: Final = 2e-3
"""Median distance [m] up to which arms usually fit their nominal models."""
_SAME_PLACE: Final = 0.02
"""Distance [m] of places on the flange up to which two readings are states of one target."""
_LARGEST_PART: Final = 0.03
_LEAST_SHARE: Final = 0.7
_COMPUTED: Final = 1.5e-4
_BASE_ANGLE: Final = float(np.radians(1.0))
"""Angle [rad] of a frame against R0 from which positions are turned."""
_BASE_DISTANCE: Final = 0.02
"""Distance [m] of the origin of a frame from that of R0 from which positions are shifted."""


@dataclass(frozen=True, eq=False)
class TargetReading:
    """Positions of one target in one state."""

    points: PointColumns
    index: int  #: row of each posture, from 0
    target: int  #: number of the target, from 1
    state: int  #: number of the state in the order of the columns, from 0
    place: FloatArray  #: (3,) on the flange [m]
    distances: FloatArray  #: (N,) from the place by the robot [m]; NaN where no position is


@dataclass(frozen=True, eq=False)
class Proposal:
    """Meaning of tables by the robot that fits."""

    robots: tuple[KnownRobot, ...]  #: robots that fit alike; the first is proposed
    joints: JointColumns
    readings: tuple[TargetReading, ...]
    unit: LengthUnit  #: of the positions
    frame: FramePlacement  #: of the positions in R0
    residual: float  #: median distance of the positions from their places by the robot [m]
    next_residual: float  #: the same of the best reading that contradicts [m]; infinite without one
    fitting: int  #: number of positions that fit
    count: int  #: number of positions
    doubt: str = ""  #: question that the numbers cannot decide

    @property
    def margin(self) -> float:
        """Ratio of the next reading's median distance to that of this reading."""
        return self.next_residual / self.residual

    @property
    def is_in_base_frame(self) -> bool:
        """Return whether the positions are in R0 as they are written."""
        cosine = 0.5 * (float(np.trace(self.frame.rotation)) - 1.0)
        angle = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return angle < _BASE_ANGLE and float(np.linalg.norm(self.frame.origin)) < _BASE_DISTANCE

    @property
    def target_count(self) -> int:
        """Number of targets."""
        return max(reading.target for reading in self.readings)

    @property
    def is_usual(self) -> bool:
        """Return whether the robot fits as well as robots usually fit their nominal models."""
        return self.residual <= USUAL_RESIDUAL


@dataclass(frozen=True, eq=False)
class Proposals:
    """Answer of the robots: a proposal with a margin, or the reason why there is none."""

    best: Proposal | None  #: None without a margin
    reason: str  #: why there is no proposal; empty with one
    readings: tuple[Reading, ...]  #: all readings that were compared, the smallest residual first


def propose(tables: Sequence[Table], robots: Iterable[KnownRobot]) -> Proposals:
    """Find the meaning of tables: the robot whose joints move targets as the columns say (method.md §17).

    Args:
        tables: numbers of files, the joints in one of them.
        robots: robots that may have been measured.
    """
    known = list(robots)
    if count_hypotheses(tables, known) > MOST_READINGS:
        return Proposals(None, "too many columns may be joints or positions: name the joints", ())
    with np.errstate(invalid="ignore", divide="ignore"):
        readings = find_readings(tables, known)
        decision = decide(readings)
        if decision.best is None:
            return Proposals(None, decision.reason, tuple(readings))
        choices = [_complete(tables, each, decision, readings) for each in (decision.best, *decision.shifted)]
        best = max(choices, key=lambda each: each.count)
    return Proposals(best, "", tuple(readings))


def _complete(
    tables: Sequence[Table], reading: Reading, decision: Decision, readings: Sequence[Reading]
) -> Proposal:
    """Add the other targets and states that fit with the same joints and the same frame."""
    by_name = {table.name: table for table in tables}
    table = by_name[reading.joints.table]
    rotation, place = place_flange(table, reading)
    sets = list(_find_sets(tables, table, reading, rotation, place))
    distances = np.concatenate([each.distances for each in sets])
    distances = distances[np.isfinite(distances)]
    residual = float(np.median(distances))
    limit = min(2.0 * LARGEST_RESIDUAL, max(5.0 * residual, USUAL_RESIDUAL))
    rival = decision.next
    return Proposal(
        robots=(reading.known, *_list_equal_robots(reading, decision.equals)),
        joints=reading.joints,
        readings=tuple(_number_targets(sets)),
        unit=reading.fit.unit,
        frame=reading.fit.frame,
        residual=residual,
        next_residual=np.inf if rival is None else rival.fit.typical,
        fitting=int((distances < limit).sum()),
        count=len(distances),
        doubt=find_doubt(reading, readings),
    )


def place_flange(table: Table, reading: Reading) -> tuple[FloatArray, FloatArray]:
    """Return rotation (N, 3, 3) and place (N, 3) [m] of the flange in all postures of a reading."""
    joints, robot = reading.joints, reading.known.robot
    count = table.size[0] // joints.groups.count
    built = build_joints(
        table, joints.columns, joints.groups, choose_rows(count, count), robot, [joints.counting]
    )
    q = next(each.q for each in built if each.columns.unit == joints.unit)
    return FlangeModel.of(robot).place_flange(q)


def _list_equal_robots(reading: Reading, equals: Sequence[Reading]) -> list[KnownRobot]:
    """Return other robots that give the same places, each once."""
    robots: list[KnownRobot] = []
    for each in equals:
        if each.known is not reading.known and each.known not in robots:
            robots.append(each.known)
    return robots


def _find_sets(
    tables: Sequence[Table], table: Table, reading: Reading, rotation: FloatArray, place: FloatArray
) -> Iterator[TargetReading]:
    """Yield the positions that fit, in the order of tables and columns, none with a column of another."""
    chosen: list[PointColumns] = []
    found: list[_PointSet] = []
    for hypothesis in build_points(tables, table, reading.joints.groups, np.arange(len(place))):
        positions = reading.fit.frame.to_base(hypothesis.points)
        targets, distances = fit_targets(rotation, place, positions)
        is_chosen = hypothesis.columns == reading.points
        if is_chosen or _fit_as_targets(positions, distances):
            found.append(_PointSet(hypothesis.columns, targets, distances, is_chosen=is_chosen))
    found.sort(key=lambda each: each.rank)
    kept = []
    for each in found:
        if _is_free(each.columns, chosen, reading.joints):
            chosen.append(each.columns)
            kept.append(each)
    order = {each.name: number for number, each in enumerate(tables)}
    kept.sort(key=lambda each: (order[each.columns.table], each.columns.columns))
    for each in kept:
        for index in range(each.columns.groups.count):
            place_on_flange, distances = each.targets[index], each.distances[:, index]
            yield TargetReading(each.columns, index, 0, 0, place_on_flange, distances)


@dataclass(frozen=True, eq=False)
class _PointSet:
    """Positions of K targets that fit."""

    columns: PointColumns
    targets: FloatArray  #: (K, 3) places on the flange [m]
    distances: FloatArray  #: (N, K) [m]
    is_chosen: bool  #: whether the frame was fitted to these positions

    @property
    def rank(self) -> tuple[bool, float]:
        """Order in which positions are accepted: the chosen ones first, then by their median distance."""
        return not self.is_chosen, float(np.nanmedian(self.distances))


def _is_free(columns: PointColumns, chosen: Sequence[PointColumns], joints: JointColumns) -> bool:
    """Return whether columns of positions are neither joints nor other positions."""
    are_joints = columns.table == joints.table and bool(set(columns.columns) & set(joints.columns))
    return not are_joints and not any(columns.overlaps(each) for each in chosen)


def _fit_as_targets(positions: FloatArray, distances: FloatArray) -> bool:
    """Return whether positions (N, K, 3) [m] are those of measured targets, by distances (N, K) [m]."""
    known = np.isfinite(distances)
    if known.mean() < _LEAST_SHARE:
        return False
    typical = float(np.median(distances[known]))
    movement = float(np.nanstd(positions, axis=0).max())
    share = float(np.mean(distances[known] < min(2.0 * LARGEST_RESIDUAL, max(5.0 * typical, USUAL_RESIDUAL))))
    return _COMPUTED < typical < min(LARGEST_RESIDUAL, _LARGEST_PART * movement) and share >= _LEAST_SHARE


def _number_targets(sets: Sequence[TargetReading]) -> Iterator[TargetReading]:
    """Yield the sets with numbers of targets: sets whose places agree are states of one target."""
    places: list[FloatArray] = []
    states: list[int] = []
    for each in sets:
        gaps = [float(np.linalg.norm(each.place - place)) for place in places]
        target = int(np.argmin(gaps)) if gaps else -1
        if not gaps or gaps[target] > _SAME_PLACE:
            target = len(places)
            places.append(each.place)
            states.append(-1)
        states[target] += 1
        yield TargetReading(each.points, each.index, target + 1, states[target], each.place, each.distances)
