"""Free turn about the spindle: the turns and postures along a path with the least deflection.

Turns and branches are chosen at knots by length, by dynamic programming with limits for each line; then the
turn becomes a smooth function of the path's length. Each motion is inspected at all points and between them.
The best turn that is the same along the whole path is the last resort (method.md §16).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.predict.forward import ForwardModel
from jointstiff.solver.process.blend import UNBLENDED, find_corners
from jointstiff.solver.process.candidates import CLEARANCE_ROOM, Candidates, keep_room, list_candidates
from jointstiff.solver.process.inspection import Inspection, Inspector
from jointstiff.solver.process.knots import find_knots, find_spacing
from jointstiff.solver.process.pace import Pace
from jointstiff.solver.process.path import ProcessPath
from jointstiff.solver.process.roll import steady_roll, wrap_turns
from jointstiff.solver.process.sequence import LineLimits, Trellis
from jointstiff.solver.process.smooth import ROUGHNESS, Parts, SmoothTurn, TurnSmoother

NO_GAIN: Final = 0.02
"""Relative difference of the fixed turns' deflections up to which turning gains nothing."""
MOST_POSES: Final = 200_000
"""Greatest number of knots times turns."""
_ZERO: Final = 1e-9
"""Turn that counts as zero [rad]."""
_EQUAL: Final = 1e-12
"""Relative difference of deflections that is rounding."""
_DIGITS: Final = 10
"""Decimal places of squares relative to their mean that are compared."""
_KEPT: Final = 1.0 + 1e-6
"""Part of a limit that counts as kept: rounding."""
_NEARLY_KEPT: Final = _KEPT + UNBLENDED
"""Need, relative to a limit, of a motion that would keep the limit without a correction."""
_DOUBT: Final = 1.01
"""Relative error of the deflection at the knots: fixed turns within it are compared at all points."""
_FAR: Final = float(np.radians(45.0))
"""Difference of two turns beyond which they belong to different routes [rad]."""
_NEAR_BEST: Final = 1.03
"""Deflection of another route at the knots, relative to the best one's, up to which smooth turns decide."""
_ATTEMPTS: Final = 4
"""Smooth turns of one roughness that are tried, each with lower limits where the one before exceeds them."""
_MOST_FIXED: Final = 8
"""Fixed turns worse than a smooth turn that are followed at all points, until one keeps all limits."""


@dataclass(frozen=True, eq=False)
class TurnTask:
    """Turns to choose from, and how the robot may move along a path of m points."""

    angles: FloatArray  #: (T,) turns about the spindle axis [rad]
    clearance: float  #: least singular value of the flange's Jacobian, in m and rad
    pace: Pace  #: feed and limits of the speeds at the m points
    greatest: bool = False  #: whether the greatest deflection is minimised, and not the root mean square
    corrects: bool = True  #: whether the corrected postures have to keep the limits of the joints, too
    closed: bool = True  #: whether the turns are a full turn, so that the last is next to the first

    @classmethod
    def free(
        cls, turns: int, clearance: float, pace: Pace, *, greatest: bool = False, corrects: bool = True
    ) -> TurnTask:
        """Return the task of a free turn, with turns evenly spread over a full turn."""
        return cls(2.0 * np.pi * np.arange(turns) / turns, clearance, pace, greatest, corrects)

    @classmethod
    def within(
        cls, low: float, high: float, turns: int, clearance: float, pace: Pace, *, greatest: bool = False
    ) -> TurnTask:
        """Return the task of turns from `low` to `high` [rad], zero included; `turns` make a full turn."""
        count = max(2, 1 + int(np.ceil((high - low) / (2.0 * np.pi) * turns)))
        angles = np.linspace(low, high, count)
        if low < 0.0 < high:  # the turn of the path itself is one of the choices
            angles = np.union1d(angles[np.abs(angles) > 1e-6], [0.0])
        return cls(angles, clearance, pace, greatest, closed=False)

    @property
    def step(self) -> float:
        """Least difference of two turns [rad]; a full turn if there is one turn."""
        return float(np.diff(self.angles).min()) if len(self.angles) > 1 else 2.0 * np.pi

    def steady(self, path: ProcessPath, first: IndexArray) -> tuple[ProcessPath, FloatArray]:
        """Return a path whose roll has no jumps, if the turn is free, and the turns (m,) to it [rad].

        `first` (m,) is the index of the first point that is the same target, for each point.
        """
        if not self.closed or len(self.angles) == 1:
            return path, np.zeros(len(path))
        roll = steady_roll(path, self.pace.rate, first)
        return (replace(path, poses=path.turn(np.arange(len(path)), roll)) if roll.any() else path), roll

    @property
    def range(self) -> tuple[float, float] | None:
        """Least and greatest turn [rad]; None for any turn."""
        return None if self.closed else (float(self.angles.min()), float(self.angles.max()))


@dataclass(frozen=True, eq=False)
class TurnedMotion:
    """A motion along a path of m points, and what it needs."""

    angles: FloatArray  #: (m, n) the model's joints [rad or m]
    turn: FloatArray  #: (m,) turn about the spindle axis [rad]
    size: float  #: root mean square, or greatest, of the exact deflections under load [m]
    inspection: Inspection
    excess: float  #: greatest need of speed or rate, also as corrected, relative to its limit


@dataclass(frozen=True, eq=False)
class TurnChoice:
    """Chosen postures along a path of m points, and what fixed turns would give."""

    joints: FloatArray  #: (m, n) controller's joints [rad or m]
    #: (m,) turn about the spindle axis from the programmed orientation [rad]; NaN where the posture was given
    turn: FloatArray
    size: float  #: root mean square, or greatest, of the exact deflections under load [m]
    #: (T,) the same for each fixed turn along the whole path, with its best branch, at the knots [m]; inf
    #: where no posture or motion is allowed
    fixed: FloatArray
    best_fixed: FloatArray | None  #: (m, n) controller's joints of the best fixed turn; None if there is none
    #: (m, n) controller's joints at turn zero; None if it is not allowed, or the programmed roll jumps
    unturned: FloatArray | None
    motion: FloatArray  #: (m, n) motion of the model's joints for a length of the line to each point [rad/m]

    @property
    def median_fixed(self) -> float:
        """Median of the fixed turns' deflections [m]; NaN if none is allowed."""
        allowed = self.fixed[np.isfinite(self.fixed)]
        return float(np.median(allowed)) if len(allowed) else float("nan")

    @property
    def gains(self) -> bool:
        """Return whether the turn matters: fixed turns differ, or the choice is better than their median."""
        allowed = self.fixed[np.isfinite(self.fixed)]
        if not len(allowed):
            return True
        spread = (allowed.max() - allowed.min()) / max(float(allowed.max()), np.finfo(float).tiny)
        return bool(spread > NO_GAIN or self.size < (1.0 - NO_GAIN) * allowed.min())


def choose_turns(
    model: ForwardModel,
    inverse: InverseKinematics,
    path: ProcessPath,
    task: TurnTask,
    first: IndexArray | None = None,
) -> TurnChoice:
    """Choose turns and branches along a path, so that its deflection is least.

    Candidates are compared by their deflections to first order in the load, at the knots. The smooth turn and
    the best fixed turns are then compared by their exact deflections at all points, so that the choice is
    never worse than a fixed turn. A free turn does not follow jumps of the programmed roll: fixed turns are
    those of a tool that is carried along without them.

    Args:
        model: model of the loaded robot.
        inverse: inverse kinematics of the same robot.
        path: path of m points.
        task: turns, clearance and pace.
        first: (m,) index of the first point that is the same target, for each point; None if all differ.

    Raises:
        RequestError: a point has no posture, or no motion keeps the limits of the joints.
    """
    first = np.arange(len(path)) if first is None else first
    path, roll = task.steady(path, first)
    if task.corrects:
        corners = find_corners(path.force, path.moment, path.continuous, path.lengths)
        task = replace(task, pace=task.pace.leave_room(corners))
    spacing = find_spacing(path, task.pace, task.step)
    lattice = Lattice.build(model, inverse, path, task, first, find_knots(path, spacing, first))
    choice = _Choice(model, inverse, path, task, first, spacing, lattice).find()
    if not roll.any():
        return choice
    return replace(choice, turn=wrap_turns(choice.turn + roll, roll, path), unturned=None)


def estimate_least(
    model: ForwardModel,
    inverse: InverseKinematics,
    path: ProcessPath,
    task: TurnTask,
    first: IndexArray | None = None,
) -> float:
    """Return the deflection of the best sequence of postures at all points, to first order in the load [m].

    Raises:
        RequestError: a point has no posture, or no sequence keeps the limits.
    """
    knots = np.arange(len(path))
    lattice = Lattice.build(model, inverse, path, task, knots if first is None else first, knots)
    found = lattice.find_free()
    if found is None:
        raise RequestError("no sequence of postures follows the path", where="path", remedy="add points")
    return lattice.measure(found)


@dataclass(frozen=True, eq=False)
class Lattice:
    """Postures at the knots of a path, and the motions between them."""

    path: ProcessPath  #: path of the k knots
    task: TurnTask
    knots: IndexArray  #: (k,) points of the whole path
    first: IndexArray  #: (k,) index of the first knot that is the same target, for each knot
    trellis: Trellis
    value: FloatArray  #: (K,) weighted squares of the deflections, relative to their mean

    @classmethod
    def build(
        cls,
        model: ForwardModel,
        inverse: InverseKinematics,
        path: ProcessPath,
        task: TurnTask,
        first: IndexArray,
        knots: IndexArray,
    ) -> Lattice:
        """List the postures at the knots (k,) of a path, and find the motions between them.

        Raises:
            RequestError: a knot has no posture, no motion leads to a knot, or there are too many postures.
        """
        if len(knots) * len(task.angles) > MOST_POSES:
            raise RequestError(
                f"{len(knots)} knots and {len(task.angles)} turns give more than {MOST_POSES:,} poses",
                where="turns",
                remedy="lower `turns`, or split the path",
            )
        part, pace = path.select(knots), task.pace.select(knots)
        clearance = CLEARANCE_ROOM * task.clearance if task.corrects else task.clearance
        candidates = list_candidates(model, inverse, part, task.angles, clearance)
        candidates = keep_room(model.robot, part, candidates, corrects=task.corrects)
        steps = part.steps
        limits = LineLimits(pace.limits() * steps[:, None], pace.rate * steps, steps, task.closed)
        trellis = Trellis.link(candidates, task.angles, part.continuous, limits)
        number = np.full(len(path), -1, dtype=np.intp)
        number[knots] = np.arange(len(knots))
        value = _compute_values(candidates, part.weights)
        return cls(part, task, knots, number[first[knots]], trellis, value)

    def find_free(self) -> IndexArray | None:
        """Return the candidates (k,) of the sequence with the least deflection; None if there is none."""
        return self._find(self.trellis, self.value)

    def find_other(self, sequence: IndexArray) -> IndexArray | None:
        """Return the best sequence (k,) whose turn halfway is far from that of another one; None without any.

        Sequences that lead round the spindle on different sides are nearly as good as each other. Which of
        them is the best at the knots depends on where the knots are.
        """
        candidates, lengths = self.trellis.candidates, self.path.lengths
        halfway = int(np.argmin(np.abs(lengths - 0.5 * lengths[-1])))
        turns = np.where(candidates.turn < 0, 0.0, self.task.angles[candidates.turn])
        difference = turns - turns[sequence[halfway]]
        if self.task.closed:
            difference = np.remainder(difference + np.pi, 2.0 * np.pi) - np.pi
        is_halfway = candidates.point == halfway
        is_far = np.abs(difference) > _FAR
        if not (is_halfway & is_far).any():
            return None
        kept = ~is_halfway | is_far
        found = self._find(self.trellis.restrict(kept), self.value[kept])
        return None if found is None else np.asarray(np.flatnonzero(kept)[found])

    def find_fixed(self) -> dict[int, IndexArray]:
        """Return the candidates (k,) of the best sequence of each fixed turn, by the turn's index."""
        candidates, found = self.trellis.candidates, dict[int, IndexArray]()
        is_simple = (candidates.turn >= 0).all() and (self.first == np.arange(len(self.first))).all()
        if is_simple and not self.task.greatest:
            return self.trellis.keep_turns().find_best_of_turns(self.value)
        for k in range(len(self.task.angles)):
            kept = (candidates.turn == k) | (candidates.turn < 0)
            if not np.bincount(candidates.point[kept], minlength=len(self.knots)).all():
                continue
            sequence = self._find(self.trellis.restrict(kept), self.value[kept])
            if sequence is not None:
                found[k] = np.flatnonzero(kept)[sequence]
        return found

    def measure(self, sequence: IndexArray) -> float:
        """Return the deflection of a sequence (k,) of candidates, to first order in the load [m]."""
        sizes, weights = self.trellis.candidates.size[sequence], self.path.weights
        if self.task.greatest:
            return float(sizes[weights > 0.0].max())
        return float(np.sqrt(weights @ np.square(sizes)))

    def turns(self, sequence: IndexArray) -> FloatArray:
        """Return the turns (k,) of a sequence of candidates, without jumps along a line [rad]."""
        index = self.trellis.candidates.turn[sequence]
        turns = np.where(index < 0, 0.0, self.task.angles[index])
        if self.task.closed:
            for part in self.path.stretches:
                turns[part] = np.unwrap(turns[part])
        return np.asarray(turns)

    def _find(self, trellis: Trellis, value: FloatArray) -> IndexArray | None:
        """Return the best sequence (k,) of the candidates of a trellis; None if there is none."""
        if not self.task.greatest:
            return trellis.find_consistent(value, self.first)
        weights = self.path.weights[trellis.candidates.point]
        size = np.where(weights > 0.0, trellis.candidates.size, 0.0)
        bottleneck = trellis.find_consistent(size, self.first, greatest=True)
        if bottleneck is None:
            return None
        # Of all sequences with the least greatest deflection, that with the least sum of squares
        kept = np.asarray(size <= size[bottleneck].max() * (1.0 + _EQUAL))
        found = trellis.restrict(kept).find_consistent(value[kept], self.first)
        return bottleneck if found is None else np.flatnonzero(kept)[found]


def _compute_values(candidates: Candidates, weights: FloatArray) -> FloatArray:
    """Return the weighted squares of the candidates' deflections (K,), relative to their mean.

    A wrist on either side gives the same deflection: squares that differ by rounding alone are made equal, so
    that the choice is the same on every machine.
    """
    value = weights[candidates.point] * np.square(candidates.size)
    counted = value[weights[candidates.point] > 0.0]
    mean = float(counted.mean()) if len(counted) else 0.0
    return np.asarray(np.round(value / mean, _DIGITS) if mean > 0.0 else value)


@dataclass(frozen=True, eq=False)
class _Start:
    """Start of a smooth turn along a path of m points."""

    turn: FloatArray  # (m,) turns, without jumps along a line [rad]
    angles: FloatArray  # (m, 6) the arm's joints there [rad]
    is_smooth: bool = False  # whether it is a smooth turn already


@dataclass(frozen=True, eq=False)
class _Choice:
    """The choice of a motion along a path, from the sequences of a lattice."""

    model: ForwardModel
    inverse: InverseKinematics
    path: ProcessPath
    task: TurnTask
    first: IndexArray
    spacing: float
    lattice: Lattice

    def find(self) -> TurnChoice:
        """Return the best motion that keeps all limits; if none does, the best that keeps those of position.

        Raises:
            RequestError: no motion keeps the limits of the joints.
        """
        fixed_sequences = self.lattice.find_fixed()
        sizes = {k: self.lattice.measure(each) for k, each in fixed_sequences.items()}
        free = self.lattice.find_free() if len(self.task.angles) > 1 else None
        motions = list[TurnedMotion]()
        for start in self._list_starts(free, sizes):
            motions += self._smooth(start)
            if motions:
                break
        best = min((each.size for each in motions if each.excess <= _KEPT), default=np.inf)
        followed = self._follow_fixed(fixed_sequences, sizes, best)
        nearly = [each for each in followed.values() if each.excess <= _NEARLY_KEPT]
        if not any(each.excess <= _KEPT for each in motions) and nearly and len(self.task.angles) > 1:
            best_fixed = min(nearly, key=lambda each: each.size)
            arm = self.inverse.select_arm_joints(best_fixed.angles)
            motions += self._smooth(_Start(best_fixed.turn, arm))
        motions += followed.values()
        if free is not None and not any(each.excess <= _KEPT for each in motions):
            motions += self._follow(*self._expand(self.lattice.turns(free), free))
        return self._conclude(motions, followed, sizes)

    def _conclude(
        self, motions: list[TurnedMotion], followed: dict[int, TurnedMotion], sizes: dict[int, float]
    ) -> TurnChoice:
        """Return the best of some motions, and what fixed turns give.

        Raises:
            RequestError: there is no motion.
        """
        if not motions:
            raise RequestError(
                "the joints cannot follow the path within their limits, either with programmed or with "
                "corrected positions",
                where="path",
                remedy="move the workpiece, lower `clearance`, or state another range of `turn`",
            )
        least = min(max(each.excess, _KEPT) for each in motions)
        motions = [each for each in motions if each.excess <= least]
        chosen = min(motions, key=lambda each: each.size)
        zero = int(np.argmin(np.abs(self.task.angles)))
        unturned = followed.get(zero) if abs(self.task.angles[zero]) < _ZERO else None
        is_equal = unturned is not None and unturned.size <= (1.0 + _EQUAL) * chosen.size
        if unturned is not None and is_equal and unturned.excess <= least:
            chosen = unturned  # a tool that gains nothing is not turned
        legal = {k: each for k, each in followed.items() if each.excess <= least}
        best_fixed = min(legal.values(), key=lambda each: each.size, default=None)
        ratio = _find_ratio(followed, sizes)
        fixed = np.full(len(self.task.angles), np.inf)
        for k, size in sizes.items():
            if k in legal:
                fixed[k] = legal[k].size
            elif k not in followed:  # one that is faster than its limits between the knots is not allowed
                fixed[k] = ratio * size
        given = ~np.isnan(self.path.given[:, 0])
        return TurnChoice(
            joints=self._controller_joints(chosen),
            turn=np.where(given, np.nan, chosen.turn),
            size=chosen.size,
            fixed=fixed,
            best_fixed=None if best_fixed is None else self._controller_joints(best_fixed),
            unturned=None if unturned is None else self._controller_joints(unturned),
            motion=chosen.inspection.motion,
        )

    def _controller_joints(self, motion: TurnedMotion) -> FloatArray:
        """Return the controller's joints (m, n) of a motion; given joints are returned as they are."""
        joints = self.model.robot.joint_map.controller_angles(motion.angles)
        given = ~np.isnan(self.path.given[:, 0])
        return np.where(given[:, None], self.path.given, joints)

    def _list_starts(self, free: IndexArray | None, sizes: dict[int, float]) -> list[_Start]:
        """List the starts of smooth turns: the best free sequence, or two routes, the better one first.

        Routes that are nearly as good as each other at the knots are compared by a beginning of their smooth
        turns. Without a free sequence, or with one that gains nothing, there is no start.
        """
        if free is None or not self._may_gain(free, sizes):
            return []
        routes = [free, *self._find_others(free, sizes)]
        starts = [_Start(*self._expand(self.lattice.turns(each), each)) for each in routes]
        if len(starts) == 1:
            return starts
        begun, not_begun = list[SmoothTurn](), list[_Start]()
        for start in starts:
            found = self._smoother.begin(start.turn, start.angles)
            if found is None:
                not_begun.append(start)
            else:
                begun.append(found)
        begun.sort(key=lambda each: each.size)
        return [*(_Start(each.turn, each.angles, is_smooth=True) for each in begun), *not_begun]

    def _find_others(self, free: IndexArray, sizes: dict[int, float]) -> list[IndexArray]:
        """Return another route (k,) that is nearly as good at the knots as the free sequence (k,), if any."""
        other = self.lattice.find_other(free)
        if other is None or not self._may_gain(other, sizes):
            return []
        is_near = self.lattice.measure(other) <= _NEAR_BEST * self.lattice.measure(free)
        return [other] if is_near else []

    def _may_gain(self, free: IndexArray, sizes: dict[int, float]) -> bool:
        """Return whether the free sequence is better at the knots than each fixed turn."""
        return self.lattice.measure(free) < (1.0 - 1e-6) * min(sizes.values(), default=np.inf)

    @cached_property
    def _raised(self) -> FloatArray:
        """(m,) factors by which the limits of the joints are raised on the line to each point."""
        knot = np.searchsorted(self.lattice.knots, np.arange(len(self.path)))
        return np.asarray(self.lattice.trellis.raised[np.minimum(knot, len(self.lattice.knots) - 1)])

    @cached_property
    def _limits(self) -> FloatArray:
        """(m, n) greatest motion of each of the model's joints for a length [rad/m or m/m]."""
        return self.task.pace.limits() * self._raised[:, None]

    @cached_property
    def _inspector(self) -> Inspector:
        """The inspector of motions along the path."""
        return Inspector(self.model, self.inverse, self.path, self.task.clearance, self.task.corrects)

    @cached_property
    def _smoother(self) -> TurnSmoother:
        """The smoother of turns along the path."""
        task = self.task
        return TurnSmoother(
            model=self.model,
            inverse=self.inverse,
            path=self.path,
            limits=self._limits,
            rate=task.pace.rate,
            clearance=task.clearance,
            spacing=self.spacing,
            knots=self.lattice.knots,
            first=self.first,
            range=task.range,
            corrects=task.corrects,
            greatest=task.greatest,
        )

    def _expand(self, turns: FloatArray, sequence: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return turns (m,) [rad] and the arm's joints (m, 6) [rad] at all points, from those at the knots.

        Between knots they are interpolated by the path's length, and by number where the tool rests.
        """
        path, knots = self.path, self.lattice.knots
        angles = self.inverse.select_arm_joints(self.lattice.trellis.candidates.angles[sequence])
        # Lines behind a motion of the joints are moved apart, so that nothing is interpolated across it.
        apart = 1.0 + float(path.lengths[-1])
        at = path.lengths + apart * np.cumsum(~path.continuous)
        columns = [np.interp(at, at[knots], each) for each in (turns, *angles.T)]
        return columns[0], np.stack(columns[1:], axis=1)

    def _smooth(self, start: _Start) -> list[TurnedMotion]:
        """Return the first smooth turn near a start that keeps all limits; [] if there is none."""
        turn, angles, is_smooth = start.turn, start.angles, start.is_smooth
        for roughness in ROUGHNESS:
            parts = Parts.full(len(self.path))
            for _ in range(_ATTEMPTS):
                found = self._smoother.smooth(turn, angles, roughness, parts, again=is_smooth)
                if found is None:
                    break
                turn, angles, is_smooth = found.turn, found.angles, True  # nearly legal is a good start
                motion = next(self._follow(found.turn, found.angles), None)
                if motion is None:
                    break
                if motion.excess <= _KEPT:
                    return [motion]
                parts = parts.lower(*self._find_needs(motion.inspection))
            is_smooth = False  # a rougher turn may be far from a smoother one
        return []

    def _find_needs(self, inspection: Inspection) -> tuple[FloatArray, FloatArray]:
        """Return what the lines (m,) of a motion need of the joints' speeds, and of the rate of turn.

        The joints need room for the correction, too: up to the part of their limits beyond which the
        correction is blended.
        """
        added = np.minimum(inspection.added, UNBLENDED * self._limits)
        with np.errstate(invalid="ignore"):
            speed = np.nan_to_num((inspection.motion + added) / self._limits).max(axis=1, initial=0.0)
        return speed, inspection.turn / self.task.pace.rate

    def _follow(self, turn: FloatArray, near: FloatArray) -> Iterator[TurnedMotion]:
        """Yield the motion with turns (m,) [rad] at all points, near the arm's joints (m, 6) [rad], if any.

        No motion is yielded if it leaves the limits of the joints, or comes near a singularity.
        """
        path, points = self.path, np.arange(len(self.path))
        arm, reached = self.inverse.refine(path.turn(points, turn), near)
        given = ~np.isnan(path.given[:, 0])
        if not (reached | given).all():
            return
        angles = self.inverse.insert_held_joints(arm, of_model=True)
        angles = np.where(given[:, None], self.model.robot.joint_map.model_angles(path.given), angles)
        again = (self.first != points) & (np.abs(angles - angles[self.first]).max(axis=1) < 1e-6)
        angles[again] = angles[self.first[again]]  # equal to the last bit, as the target is one
        if (np.abs(angles - angles[self.first]).max(axis=1) > 0.0).any():
            return
        inspection = self._inspector.inspect(angles, turn)
        if inspection.beyond.any():
            return
        excess = max(float(each.max(initial=0.0)) for each in self._find_needs(inspection))
        yield TurnedMotion(angles, turn, self._measure(angles), inspection, excess)

    def _measure(self, angles: FloatArray) -> float:
        """Return the root mean square, or the greatest, of the exact deflections of a motion [m]."""
        weights = self.path.weights
        rows = np.flatnonzero(weights)
        joints = self.model.robot.joint_map.controller_angles(angles[rows])
        bent = self.model.deflect(self.path.cases(rows, joints))
        sizes = np.linalg.norm(bent.displacement, axis=1)
        return float(sizes.max() if self.task.greatest else np.sqrt(weights[rows] @ np.square(sizes)))

    def _follow_fixed(
        self, sequences: dict[int, IndexArray], sizes: dict[int, float], best: float
    ) -> dict[int, TurnedMotion]:
        """Follow turn zero, and the fixed turns that may be the best motion or the best fixed turn.

        No other turn is then expected to be better than the best motion that keeps all limits. A turn that no
        motion can keep is removed from `sequences` and `sizes`.
        """
        followed = dict[int, TurnedMotion]()
        zero = int(np.argmin(np.abs(self.task.angles)))
        for tried, k in enumerate(sorted(sizes, key=lambda each: (each != zero, sizes[each]))):
            legal = [each.size for each in followed.values() if each.excess <= _KEPT]
            is_worse = _find_ratio(followed, sizes) * sizes[k] > _DOUBT * min([best, *legal])
            if k != zero and is_worse and (legal or tried >= _MOST_FIXED):
                break
            found = next(self._follow(*self._expand(self.lattice.turns(sequences[k]), sequences[k])), None)
            if found is None:
                del sizes[k]
            else:
                followed[k] = found
        return followed


def _find_ratio(followed: dict[int, TurnedMotion], sizes: dict[int, float]) -> float:
    """Return how much the exact deflections of fixed turns differ from those at the knots, to first order."""
    return float(np.median([each.size / sizes[k] for k, each in followed.items() if sizes[k]] or [1.0]))
