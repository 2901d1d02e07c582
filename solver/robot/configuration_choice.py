"""Choose among the postures that reach the poses of a path: by what is stated of them, and by nearness."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.inverse import InverseKinematics
from jointstiff.solver.robot.model import Robot

_TURN: Final = 2.0 * np.pi
_TURNS: Final = np.arange(-2, 3) * _TURN
"""Full turns that are tried about an angle [rad]."""
_TOLERANCE: Final = 1e-4
"""Angle by which a stated range or a joint's limit may be missed [rad]: programs are rounded."""
_NEAR_SINGULAR: Final = 0.04
"""Least singular value up to which a solution may be taken for one that is missing."""
_AHEAD: Final = 4096
_LEAST_AHEAD: Final = 16
"""Most and fewest poses of a path that are looked at together."""


class Unreached(IntEnum):
    """Reasons why no posture was chosen for a pose."""

    NO = 0
    OUT_OF_REACH = 1
    OUT_OF_LIMITS = 2
    NOT_AS_STATED = 3
    AMBIGUOUS = 4
    NOT_FOLLOWED = 5


@dataclass(frozen=True, eq=False)
class ChosenPostures:
    """Postures along a path of m poses."""

    joints: FloatArray  #: (m, n) angles as the controller shows them [rad]
    unreached: IndexArray  #: (m,) values of `Unreached`


def choose_postures(
    inverse: InverseKinematics,
    poses: FloatArray,
    given: FloatArray,
    stated: FloatArray,
    tested: BoolArray,
    start: FloatArray | None = None,
) -> ChosenPostures:
    """Return a posture for each pose of a path.

    A joint target is its own posture. A pose that is tested takes the solution whose angles are in the stated
    ranges, the nearest to the posture before if several are; any other pose takes the nearest solution.

    Args:
        inverse: kinematics of the robot.
        poses: (m, 4, 4) of the flange in R0 [m], ignored where angles are given.
        given: (m, 6) controller's angles of joint targets [rad]; NaN for poses.
        stated: (m, 6, 2) least and greatest controller's angles [rad]; ∓inf where nothing is stated.
        tested: (m,) whether what is stated decides; where no posture came before, it does in any case.
        start: (6,) controller's angles near the first pose [rad].

    Raises:
        RobotError: the joint map lets a controller's angle depend on those of joints further out.
    """
    if np.triu(inverse.robot.joint_map.matrix, 1).any():
        raise RobotError(
            "a joint depends on the controller's angle of a joint further out",
            remedy="give a joint map without entries above the diagonal",
            where="joint_map.matrix",
        )
    joints, unreached = given.copy(), np.zeros(len(poses), dtype=np.intp)
    previous, ahead = start, _AHEAD
    for begin in range(0, len(poses), _AHEAD):
        block = slice(begin, begin + _AHEAD)
        choice = _Choice(inverse, poses[block], given[block], stated[block], tested[block])
        previous, ahead = choice.follow(joints[block], unreached[block], previous, ahead)
    return ChosenPostures(joints, _out_of_limits(inverse.robot, joints, unreached))


def _out_of_limits(robot: Robot, joints: FloatArray, unreached: IndexArray) -> IndexArray:
    known: BoolArray = np.asarray(np.isfinite(joints).all(axis=1))
    angles = robot.joint_map.model_angles(np.where(known[:, None], joints, 0.0))
    low, high = robot.limits.T
    excess: FloatArray = np.maximum(low - angles, angles - high)
    outside = excess.max(axis=1) > _TOLERANCE
    return np.where(known & outside & (unreached == Unreached.NO), int(Unreached.OUT_OF_LIMITS), unreached)


class _Choice:
    """A stretch of m poses with what is given and stated, and their solutions [rad]."""

    def __init__(
        self,
        inverse: InverseKinematics,
        poses: FloatArray,
        given: FloatArray,
        stated: FloatArray,
        tested: BoolArray,
    ) -> None:
        """Find the solutions (m, 8, 6) in angles of the model, NaN where there is none."""
        self._inverse, self._robot, self._poses = inverse, inverse.robot, poses
        self._posed, self._stated, self._tested = np.isnan(given[:, 0]), stated, tested
        self._branches, self._complete = np.full((len(poses), 8, 6), np.nan), np.ones(len(poses), np.bool_)
        self._branches[self._posed], self._complete[self._posed] = inverse.solutions(poses[self._posed])

    def follow(
        self, joints: FloatArray, unreached: IndexArray, previous: FloatArray | None, ahead: int
    ) -> tuple[FloatArray | None, int]:
        """Choose a posture for each pose, and note why there is none.

        Args:
            joints: (m, 6) controller's angles [rad] to be filled in.
            unreached: (m,) values of `Unreached` to be filled in.
            previous: (6,) the posture before, if there was one.
            ahead: how many poses to look at together.

        Returns:
            The last posture, and how many poses to look at next.
        """
        lost = self._posed & np.isnan(self._branches[:, :, 0]).all(axis=1)
        unreached[lost] = Unreached.OUT_OF_REACH
        path, at = np.flatnonzero(~lost), 0
        while at < len(path):
            i = path[at]
            if not self._posed[i]:
                at += 1
            elif self._tested[i] or previous is None:
                joints[i], unreached[i] = self.as_stated(i, previous)
                at += 1
            else:
                run = path[at : at + ahead]
                stop = np.flatnonzero(self._tested[run] | ~self._posed[run])
                run = run[: stop[0]] if len(stop) else run
                done, joints[run], unreached[run] = self.nearest(run, previous)
                if unreached[run[0]]:
                    at += 1
                    continue
                ahead = min(_AHEAD, 4 * ahead) if done == len(run) else max(_LEAST_AHEAD, 2 * done)
                at += done
                i = path[at - 1]
            previous = joints[i] if np.isfinite(joints[i]).all() else previous
        return previous, ahead

    def as_stated(self, i: int, previous: FloatArray | None) -> tuple[FloatArray, Unreached]:
        """Return the controller's angles (6,) of one pose, and why there are none."""
        fits, angles = _in_ranges(self._robot, self._branches[i], self._stated[i], previous)
        found = angles[fits]
        if not len(found):
            return np.full(6, np.nan), Unreached.NOT_AS_STATED
        if previous is None:
            spread = np.abs(found - found[0]).max()
            if spread > _TOLERANCE:
                return found[0], Unreached.AMBIGUOUS
        chosen = found[0 if previous is None else np.argmin(np.abs(found - previous).max(axis=1))]
        if not self._complete[i]:
            least = self._inverse.least_singular(self._robot.joint_map.model_angles(chosen[None]))
            return chosen, Unreached.NOT_FOLLOWED if least[0] < _NEAR_SINGULAR else Unreached.NO
        return chosen, Unreached.NO

    def nearest(self, run: IndexArray, previous: FloatArray) -> tuple[int, FloatArray, FloatArray]:
        """Follow the nearest solutions along poses, as long as one solution keeps its place in the list.

        Returns:
            How many were followed, at least one; controller's angles (m, 6), NaN behind; reasons (m,), of
            the first one where its branch is not known.
        """
        here = self._robot.joint_map.model_angles(previous[None])[0]
        b = int(np.nanargmin(_apart(self._branches[run[0]], here)))
        if not self._complete[run[0]] and not self._continues(self._branches[run[:1], b], here[None])[0]:
            return self._followed(run, here)
        kept = self._branches[run, b]  # (m, 6)
        step = _apart(kept[1:], kept[:-1])
        others = _apart(self._branches[run[1:]], kept[1:, None])
        others[:, b] = np.inf
        # By the triangle inequality nothing is nearer to the posture before than a solution that is this
        # far from all others.
        sure = 2.0 * step < np.where(np.isnan(others), np.inf, others).min(axis=1)
        few = np.flatnonzero(~self._complete[run[1:]])
        sure[few] &= self._continues(kept[1:][few], kept[:-1][few])
        breaks = np.flatnonzero(~sure)
        done = int(breaks[0]) + 1 if len(breaks) else len(run)
        angles = np.full((len(run), 6), np.nan)
        angles[:done] = np.unwrap(np.vstack([here, kept[:done]]), axis=0)[1:]
        angles[:done] = self._robot.joint_map.controller_angles(angles[:done])
        return done, angles, np.zeros(len(run))

    def _followed(self, run: IndexArray, here: FloatArray) -> tuple[int, FloatArray, FloatArray]:
        """Follow the branch to the first pose of a run, where it may be missing among the solutions."""
        angles, reasons = np.full((len(run), 6), np.nan), np.zeros(len(run))
        found, known = self._inverse.followed(self._poses[run[:1]], here[None])
        if known[0]:
            angles[0] = self._robot.joint_map.controller_angles(found)[0]
        else:
            reasons[0] = Unreached.NOT_FOLLOWED
        return 1, angles, reasons

    def _continues(self, angles: FloatArray, before: FloatArray) -> BoolArray:
        """Return whether solutions (k, 6) [rad], full turns aside, continue the branch of those before."""
        return self._inverse.continues(before + _wrapped(angles - before), before)


def _apart(angles: FloatArray, from_: FloatArray) -> FloatArray:
    """Return the greatest difference of an angle, full turns aside [rad]."""
    apart = np.moveaxis(_wrapped(angles - from_), -1, 0)
    return np.asarray(np.abs(apart, order="C").max(axis=0))  # joints first: a tenth of the time


def _wrapped(angle: FloatArray) -> FloatArray:
    return angle - _TURN * np.round(angle / _TURN)


def _in_ranges(
    robot: Robot, solutions: FloatArray, stated: FloatArray, previous: FloatArray | None
) -> tuple[BoolArray, FloatArray]:
    """Add full turns to solutions (b, 6), so that the controller's angles are in their ranges.

    Joint by joint from the base on, as a controller's angle depends on those before it at most.

    Returns:
        (b,) whether all are in them, and the controller's angles (b, 6) [rad].
    """
    matrix, offset, limits = robot.joint_map.matrix, robot.joint_map.offset, robot.limits
    shown = np.zeros_like(solutions)
    fits: BoolArray = np.asarray(np.isfinite(solutions).all(axis=1))
    near = np.zeros(len(offset)) if previous is None else previous
    for j in range(len(offset)):
        turned = solutions[:, j, None] + _TURNS  # (b, 5) of the model
        angle = (turned - offset[j] - (shown[:, :j] @ matrix[j, :j])[:, None]) / matrix[j, j]
        outside = (turned < limits[j, 0] - _TOLERANCE) | (turned > limits[j, 1] + _TOLERANCE)
        outside |= (angle < stated[j, 0] - _TOLERANCE) | (angle > stated[j, 1] + _TOLERANCE)
        cost = np.where(outside | np.isnan(angle), np.inf, np.abs(angle - near[j]))
        best = np.argmin(cost, axis=1)
        rows = np.arange(len(solutions))
        fits &= np.isfinite(cost[rows, best])
        shown[:, j] = angle[rows, best]
    return fits, shown
