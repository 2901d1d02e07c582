"""Free turn about the spindle: the turns and postures along a path with the least deflection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.predict.forward import ForwardModel
from jointstiff.solver.process.between import LimitsBetween
from jointstiff.solver.process.candidates import Candidates, list_candidates
from jointstiff.solver.process.path import ProcessPath
from jointstiff.solver.process.sequence import Motion, Trellis

NO_GAIN: Final = 0.02
"""Relative difference of the fixed turns' deflections up to which turning gains nothing."""
_ZERO: Final = 1e-9
"""Turn that counts as zero [rad]."""
_MOST_CHECKS: Final = 50
"""Sequences whose motions between points are checked."""
_MOST_LINKS_CHECKED: Final = 50_000
"""Motions between two points that are checked at once."""
_EQUAL: Final = 1e-12
"""Relative difference of deflections that is rounding."""
_DIGITS: Final = 10
"""Decimal places of squares relative to their mean that are compared."""


@dataclass(frozen=True, eq=False)
class TurnTask:
    """Turns to choose from, and how the robot may move."""

    angles: FloatArray  #: (T,) turns about the spindle axis [rad]
    clearance: float  #: least singular value of the flange's Jacobian, in m and rad
    motion: Motion

    @classmethod
    def free(cls, turns: int, clearance: float, motion: Motion) -> TurnTask:
        """Return the task of a free turn, with turns evenly spread over a full turn."""
        return cls(2.0 * np.pi * np.arange(turns) / turns, clearance, motion)

    @classmethod
    def within(cls, low: float, high: float, turns: int, clearance: float, motion: Motion) -> TurnTask:
        """Return the task of turns from `low` to `high` [rad], zero included; `turns` make a full turn."""
        count = max(2, 1 + int(np.ceil((high - low) / (2.0 * np.pi) * turns)))
        angles = np.linspace(low, high, count)
        if low < 0.0 < high:  # the turn of the path itself is one of the choices
            angles = np.union1d(angles[np.abs(angles) > 1e-6], [0.0])
        return cls(angles, clearance, motion)


@dataclass(frozen=True, eq=False)
class TurnChoice:
    """Chosen postures along a path of m points, and what fixed turns would give."""

    joints: FloatArray  #: (m, n) controller's joints [rad or m]
    turn: FloatArray  #: (m,) turn about the spindle axis [rad]; NaN where the posture was given
    size: float  #: root mean square, or greatest, of the exact deflections under load [m]
    #: (T,) the same for each fixed turn along the whole path, with its best branch [m]; inf where no posture
    #: or motion is allowed
    fixed: FloatArray
    best_fixed: FloatArray | None  #: (m, n) controller's joints of the best fixed turn; None if there is none
    unturned: FloatArray | None  #: (m, n) controller's joints at turn zero; None if it is not allowed

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

    Limits and step are kept between the points, too, where the controller interpolates a line. Candidates are
    compared by their deflections to first order in the load. The chosen sequence and all fixed
    turns are then compared by their exact deflections, so that the choice is never worse than a fixed turn.

    Args:
        model: model of the loaded robot.
        inverse: inverse kinematics of the same robot.
        path: path of m points.
        task: turns, clearance and motion.
        first: (m,) index of the first point that is the same target, for each point; None if all differ.

    Raises:
        RequestError: a point has no posture, or no sequence keeps step and limits.
    """
    first = np.arange(len(path)) if first is None else first
    trellis, value, weight = _prepare(model, inverse, path, task)
    candidates, limits = trellis.candidates, LimitsBetween(inverse, path, task.motion.step)
    sequences: list[IndexArray] = []
    if (free := _find_followed(trellis, value, first, task.motion, limits)) is not None:
        sequences.append(free)
    fixed_at = dict[int, int]()
    for k in range(len(task.angles)):
        kept = (candidates.turn == k) | (candidates.turn < 0)
        found = _find_followed(trellis.restrict(kept), value[kept], first, task.motion, limits)
        if found is not None:
            fixed_at[k] = len(sequences)
            sequences.append(np.flatnonzero(kept)[found])
    if not sequences:
        raise RequestError(
            "no sequence of postures follows the path within the limits of the joints and the step",
            where="step",
            remedy="raise `step`, lower `clearance`, add points, or use separate targets for returns",
        )
    sizes = _compute_exact_sizes(model, path, candidates, sequences, weight, greatest=task.motion.greatest)
    fixed = np.full(len(task.angles), np.inf)
    for k, row in fixed_at.items():
        fixed[k] = sizes[row]
    # The free sequence is the first: it is kept unless a fixed turn is better to all digits.
    best, zero = int(np.argmin(sizes)), int(np.argmin(np.abs(task.angles)))
    at_zero = fixed_at.get(zero) if abs(task.angles[zero]) < _ZERO else None
    if at_zero is not None and sizes[at_zero] <= (1.0 + _EQUAL) * sizes[best]:
        best = at_zero  # a tool that gains nothing is not turned
    chosen = candidates.joints[sequences[best]]
    turn = candidates.turn[sequences[best]]
    joints_of = {k: candidates.joints[sequences[row]] for k, row in fixed_at.items()}
    best_fixed = joints_of[int(np.argmin(fixed))] if fixed_at else None
    unturned = None if at_zero is None else joints_of[zero]
    angles = np.where(turn < 0, np.nan, task.angles[turn])
    return TurnChoice(chosen, angles, float(sizes[best]), fixed, best_fixed, unturned)


def estimate_least(
    model: ForwardModel,
    inverse: InverseKinematics,
    path: ProcessPath,
    task: TurnTask,
    first: IndexArray | None = None,
) -> float:
    """Return the deflection of the sequence that `choose_turns` chooses, to first order in the load [m].

    Fixed turns are not evaluated, which takes half of the time.

    Raises:
        RequestError: a point has no posture, or no sequence keeps step and limits.
    """
    first = np.arange(len(path)) if first is None else first
    trellis, value, weight = _prepare(model, inverse, path, task)
    found = _find_least(trellis, value, first, task.motion)
    if found is None:
        raise RequestError("no sequence of postures follows the path", where="step", remedy="raise `step`")
    sizes = trellis.candidates.size[found][weight]
    return float(sizes.max() if task.motion.greatest else np.sqrt(np.mean(np.square(sizes))))


def _prepare(
    model: ForwardModel, inverse: InverseKinematics, path: ProcessPath, task: TurnTask
) -> tuple[Trellis, FloatArray, BoolArray]:
    """Return candidates with their motions, their values (K,), and a mask (m,) of points that count.

    Raises:
        RequestError: a point has no posture, or no motion leads to it.
    """
    candidates = list_candidates(model, inverse, path, task.angles, task.clearance)
    trellis = Trellis.link(candidates, task.angles, path.continuous, task.motion)
    counted = path.loaded if path.loaded.any() else np.ones(len(path), dtype=np.bool_)
    return trellis, _compute_values(candidates, counted[candidates.point]), counted


def _compute_values(candidates: Candidates, loaded: BoolArray) -> FloatArray:
    """Return the squares of the candidates' deflections (K,), relative to their mean; zero without a load.

    A wrist on either side gives the same deflection: squares that differ by rounding alone are made equal, so
    that the choice is the same on every machine.
    """
    square = np.where(loaded, np.square(candidates.size), 0.0)
    mean = float(square[loaded].mean()) if loaded.any() else 0.0
    return np.asarray(np.round(square / mean, _DIGITS) if mean > 0.0 else square)


def _find_followed(
    trellis: Trellis, value: FloatArray, first: IndexArray, motion: Motion, limits: LimitsBetween
) -> IndexArray | None:
    """Return the candidates (m,) of the best sequence that keeps the limits between points; None if none."""
    joints = trellis.candidates.joints
    for _ in range(_MOST_CHECKS):
        found = _find_least(trellis, value, first, motion)
        if found is None:
            return None
        beyond = np.flatnonzero(limits.find_beyond(joints[found]))
        if not len(beyond):
            return found
        for point in beyond.tolist():
            links, before, here = trellis.links[point - 1], *trellis.rows[point - 1 : point + 1]
            if links is None:
                continue
            rows = links.first + before.start, links.last + here.start
            left = (rows[0] == found[point - 1]) & (rows[1] == found[point])
            if len(left) <= _MOST_LINKS_CHECKED:  # motions like the one that was found leave the limits, too
                left = limits.are_beyond(np.full(len(left), point), joints[rows[0]], joints[rows[1]])
            trellis = trellis.leave_out(point, left)
    return None


def _find_least(trellis: Trellis, value: FloatArray, first: IndexArray, motion: Motion) -> IndexArray | None:
    """Return the candidates (m,) of the sequence with the least deflection; None if there is none."""
    if not motion.greatest:
        return trellis.find_consistent(value, first)
    bottleneck = trellis.find_consistent(value, first, greatest=True)
    if bottleneck is None:
        return None
    # Of all sequences with the least greatest deflection, that with the least sum of squares
    kept = np.asarray(value <= value[bottleneck].max() * (1.0 + 1e-12))
    found = trellis.restrict(kept).find_consistent(value[kept], first)
    return bottleneck if found is None else np.flatnonzero(kept)[found]


def _compute_exact_sizes(
    model: ForwardModel,
    path: ProcessPath,
    candidates: Candidates,
    sequences: list[IndexArray],
    counted: BoolArray,
    *,
    greatest: bool,
) -> FloatArray:
    """Return the size (s,) of the exact deflections of each sequence at the points that count [m]."""
    unique, number = np.unique(np.concatenate(sequences), return_inverse=True)
    at = candidates.point[unique]
    exact = np.zeros(len(unique))
    rows = np.flatnonzero(counted[at])
    cases = path.cases(at[rows], candidates.joints[unique[rows]])
    exact[rows] = np.linalg.norm(model.deflect(cases).displacement, axis=1)
    of_sequence = exact[number.reshape(len(sequences), -1)][:, counted]
    return np.asarray(
        of_sequence.max(axis=1) if greatest else np.sqrt(np.mean(np.square(of_sequence), axis=1))
    )
