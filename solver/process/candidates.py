"""Postures that bring the tool to the points of a path: all turns about the spindle, and all branches."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, are_regular
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import Postures, find_wrist
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.forward import ForwardModel
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.process.path import ProcessPath

_FULL_TURNS: Final = 2.0 * np.pi * np.array([0, 1, -1, 2, -2])
"""Full turns that are added to a joint's angle [rad], the nearest to zero first."""
_MOST_VARIANTS: Final = 8
"""Mean number of postures that differ by full turns; beyond it further joints keep one angle each."""
ROOM: Final = float(np.radians(0.3))
"""Distance that is kept from the limits of the joints [rad]."""
CLEARANCE_ROOM: Final = 1.05
"""Least singular value that is chosen, relative to the clearance: corrected postures keep the clearance."""
_PARALLEL: Final = 1e-2
"""Sine of the angle between axes that count as parallel in all postures."""
_MOST_TURNING: Final = (5, 3, 0, 4, 2, 1)
"""Joints of the arm in the order in which their full turns matter: those with the widest limits first."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """K postures for the points of a path, within the limits of the joints; sorted by point.

    Postures whose joints differ by full turns have the same deflection.
    """

    point: IndexArray  #: (K,) index of the point
    turn: IndexArray  #: (K,) index of the turn about the spindle axis; −1 for a given posture
    joints: FloatArray  #: (K, n) controller's joints [rad or m]
    angles: FloatArray  #: (K, n) the model's joints [rad or m]
    shift: FloatArray  #: (K, n) motion of the joints by the correction [rad or m]; zero for models with links
    size: FloatArray  #: (K,) length of the deflection, to first order in the load [m]; zero without a load
    #: (K,) sign of the determinant of the flange's Jacobian: the arm crosses a singularity between two
    #: postures of different signs
    side: FloatArray

    def select(self, kept: BoolArray) -> Candidates:
        """Return those candidates only that a mask (K,) keeps."""
        return Candidates(*(each[kept] for each in vars(self).values()))

    def rows(self, points: int) -> list[slice]:
        """Return the rows of each of the path's points."""
        ends = np.searchsorted(self.point, np.arange(points + 1))
        return [slice(first, last) for first, last in pairwise(ends.tolist())]


def list_candidates(
    model: ForwardModel,
    inverse: InverseKinematics,
    path: ProcessPath,
    turns: FloatArray,
    clearance: float,
) -> Candidates:
    """List the postures for all points and turns that keep the limits of the joints and the clearance.

    Args:
        model: model of the loaded robot.
        inverse: inverse kinematics of the same robot.
        path: path of m points.
        turns: (T,) turns about the spindle axis, from the posture of the path [rad].
        clearance: least singular value of the flange's Jacobian that a posture may have, in m and rad.

    Raises:
        RequestError: a point has no posture.
    """
    robot = model.robot
    free = np.flatnonzero(np.isnan(path.given[:, 0]))
    point, turn = np.repeat(free, len(turns)), np.tile(np.arange(len(turns)), len(free))
    solutions, _ = inverse.solve(path.turn(point, turns[turn])) if len(point) else (np.zeros((0, 8, 6)), None)
    row, branch = np.nonzero(np.isfinite(solutions[:, :, 0]))
    solved = point[row]
    within = _find_within_limits(inverse, solutions[row, branch])
    row, branch = row[within], branch[within]
    point, turn = point[row], turn[row]
    model_angles = inverse.insert_held_joints(solutions[row, branch], of_model=True)
    given = np.flatnonzero(~np.isnan(path.given[:, 0]))
    point = np.concatenate([point, given])
    turn = np.concatenate([turn, np.full(len(given), -1, dtype=np.intp)])
    model_angles = np.concatenate([model_angles, robot.joint_map.model_angles(path.given[given])])
    postures = Postures(robot, model_angles)
    size, shift = _compute_sizes(model, path, point, postures)
    side, usable = find_sides(inverse, postures, clearance)
    if path.near is not None:
        near = Postures(robot, robot.joint_map.model_angles(path.near))
        usable &= find_branches(inverse, postures) == find_branches(inverse, near)[point]
    usable |= turn < 0
    index, angles = _add_full_turns(inverse, robot, model_angles, usable, turn)
    joints = robot.joint_map.controller_angles(angles)
    if path.near is not None:
        apart = np.abs(joints - path.near[point[index]])[:, inverse.revolute].max(axis=1, initial=0.0)
        kept = path.continuous[point[index]] | (apart <= np.pi) | (turn[index] < 0)
        index, joints, angles = index[kept], joints[kept], angles[kept]
    order = np.argsort(point[index], kind="stable")
    index, joints = index[order], joints[order]
    found = Candidates(
        point[index], turn[index], joints, angles[order], shift[index], size[index], side[index]
    )
    _refuse_unreached(found, path, solved, point)
    return found


def keep_room(robot: Robot, path: ProcessPath, candidates: Candidates, *, corrects: bool) -> Candidates:
    """Return the candidates that keep `ROOM` to the limits of the joints, also once they are corrected.

    Room for links that bend is within `ROOM`.

    Raises:
        RequestError: all postures at a point are too near the limits.
    """
    low, high = robot.limits.T
    commanded = candidates.angles + (candidates.shift if corrects else 0.0)
    least = np.minimum(candidates.angles, commanded)
    greatest = np.maximum(candidates.angles, commanded)
    has_room = ((least >= low + ROOM) & (greatest <= high - ROOM)).all(axis=1)
    kept = candidates.select(has_room | (candidates.turn < 0))
    counts = np.bincount(kept.point, minlength=len(path))
    if not counts.all():
        raise RequestError(
            f"point {int(np.argmin(counts)) + 1} of the path: all postures are within 0.3° of the joints' "
            "limits, or beyond them once the deflection is corrected",
            where="turn",
            remedy="move the workpiece, or state `correct: false`",
        )
    return kept


def _find_within_limits(inverse: InverseKinematics, angles: FloatArray) -> BoolArray:
    """Return a mask (K,) of angles (K, 6) [rad] that are within the limits, if full turns are added."""
    low, high = inverse.arm.limits.T
    wrapped = angles - 2.0 * np.pi * np.round(angles / (2.0 * np.pi))
    shifted = wrapped[:, :, None] + _FULL_TURNS
    inside = (shifted >= low[:, None]) & (shifted <= high[:, None])
    return np.asarray(inside.any(axis=2).all(axis=1))


def _compute_sizes(
    model: ForwardModel, path: ProcessPath, point: IndexArray, postures: Postures
) -> tuple[FloatArray, FloatArray]:
    """Return the lengths (K,) of the deflections of postures at points, and their corrections (K, n).

    Deflections are to first order in the load [m]; corrections are motions of the joints [rad or m].
    """
    size, shift = np.zeros(len(point)), np.zeros_like(postures.q)
    if len(point):
        joints = model.robot.joint_map.controller_angles(postures.q)
        cases = path.cases(point, joints)
        size = np.linalg.norm(model.linear_displacement(cases, postures), axis=1)
        if isinstance(model, JointModel):
            shift = model.compute_commands(cases, postures, np.ones(len(point))) - postures.q
    return size, shift


def find_sides(
    inverse: InverseKinematics, postures: Postures, clearance: float
) -> tuple[FloatArray, BoolArray]:
    """Return on which side of its singularities the arm is, and where the arm keeps its clearance.

    Args:
        inverse: inverse kinematics of the arm.
        postures: K postures of the robot.
        clearance: least singular value of the flange's Jacobian that is wanted, in m and rad.

    Returns:
        (K,) signs of the determinant of the flange's Jacobian of the arm's joints, and a mask (K,) of the
        postures whose least singular value is at least the clearance.
    """
    if not len(postures):
        return np.zeros(0), np.zeros(0, dtype=np.bool_)
    jacobian = postures.flange_jacobian[:, :, inverse.revolute]
    return np.sign(np.linalg.det(jacobian)), are_regular(jacobian, clearance)


def find_branches(inverse: InverseKinematics, postures: Postures) -> IndexArray:
    """Return numbers (K,) of the branches of the arm: postures of one number need cross no singularity.

    The bits of a number are the signs of three functions; where one is zero, the arm is singular:
    ``(a_4 × a_5) · a_6`` of the wrist, ``a_2 · ((o_3 − o_2) × (w − o_3))`` of the elbow, and the determinant
    of the Jacobian. a_j and o_j are direction and a point of axis j; w is the centre of the wrist, or a point
    of axis 4 if that is parallel to axis 2.
    """
    jacobian = postures.jacobian[:, :, inverse.revolute]
    moment, axis = jacobian[:, :3].transpose(2, 0, 1), jacobian[:, 3:].transpose(2, 0, 1)
    foot = np.cross(axis, moment)  # the point of each axis that is nearest to the origin of R0
    wrist, centre = find_wrist(inverse.arm), foot[3]
    parallel = np.linalg.norm(np.cross(axis[1], axis[3]), axis=1).max(initial=0.0) < _PARALLEL
    if wrist is not None and not parallel:
        centre = postures.to_base(np.broadcast_to(wrist.centre, (len(postures), 1, 3)))[:, 0]
    of_wrist = np.einsum("ki,ki->k", np.cross(axis[3], axis[4]), axis[5])
    of_elbow = np.einsum("ki,ki->k", axis[1], np.cross(foot[2] - foot[1], centre - foot[2]))
    full = postures.flange_jacobian[:, :, inverse.revolute]
    signs = (of_wrist > 0.0, of_elbow > 0.0, np.linalg.det(full) > 0.0)
    return np.asarray(sum(sign.astype(np.intp) << bit for bit, sign in enumerate(signs)))


def _add_full_turns(
    inverse: InverseKinematics,
    robot: Robot,
    angles: FloatArray,
    usable: BoolArray,
    turn: IndexArray,
) -> tuple[IndexArray, FloatArray]:
    """Return all postures within the limits that differ from usable ones by full turns of joints.

    Given postures (`turn` −1) stay as they are. Full turns of further joints are left out if each posture
    would have more than `_MOST_VARIANTS` variants.

    Returns:
        (S,) indices of the postures, and (S, n) the model's joints [rad or m].
    """
    fixed = np.flatnonzero(turn < 0)
    index = np.flatnonzero(usable & (turn >= 0))
    states, count = angles[index], len(index)
    for j in inverse.revolute[list(_MOST_TURNING)].tolist():
        low, high = robot.limits[j]
        wrapped = states[:, j] - 2.0 * np.pi * np.round(states[:, j] / (2.0 * np.pi))
        shifted = wrapped[:, None] + _FULL_TURNS
        inside = (shifted >= low) & (shifted <= high)
        if inside.sum() > _MOST_VARIANTS * count:  # keep only the angle nearest to zero
            inside &= np.cumsum(inside, axis=1) == 1
        row, column = np.nonzero(inside)
        states, index = states[row], index[row]
        states[:, j] = shifted[row, column]
    return np.concatenate([index, fixed]), np.concatenate([states, angles[fixed]])


def _refuse_unreached(found: Candidates, path: ProcessPath, solved: IndexArray, within: IndexArray) -> None:
    """Raise a `RequestError` for the first point of a path that has no posture.

    Args:
        found: postures that may be used.
        path: path of m points.
        solved: (S,) points of all solutions of the inverse kinematics.
        within: (K,) points of those solutions that are within the limits.
    """
    counts = np.bincount(found.point, minlength=len(path))
    if counts.all():
        return
    point = int(np.argmin(counts))
    reason, remedy = (
        "the robot does not reach the point at any turn of the tool",
        "check tool, base and place of the workpiece",
    )
    if (solved == point).any():
        reason, remedy = "all postures at this point exceed the joints' limits", "move the workpiece"
        if (within == point).any():
            reason, remedy = (
                "all postures at this point are too near a singularity, or on another branch",
                "lower `clearance`, state `branches: free`, or move the workpiece",
            )
    raise RequestError(f"point {point + 1} of the path: {reason}", where="turn", remedy=remedy)
