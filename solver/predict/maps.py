"""Maps of a work area: how far the tool bends at each place (method.md §11).

A task states tool, orientations, process wrench and limits, and so the postures that a place allows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.predict.forward import ForwardModel, LoadCases, unit_vectors
from jointstiff.solver.predict.model_error import ModelError
from jointstiff.solver.robot.inverse import InverseKinematics
from jointstiff.solver.robot.model import Robot

PlaceStatus = Literal["reached", "out_of_reach", "joint_limits", "unseen_joint", "overloaded", "not_followed"]
STATUSES: Final[tuple[PlaceStatus, ...]] = get_args(PlaceStatus)

_REACHED, _OUT_OF_REACH, _JOINT_LIMITS, _UNSEEN, _OVERLOADED, _NOT_FOLLOWED = range(6)
_TIE: Final = 1e-9
"""Relative difference of two deflections that is rounding: wrists turned over bend alike."""
_FULL_TURN: Final = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class MapTask:
    """Everything that a map asks of each place, which chooses among O orientations of the flange."""

    rotation: FloatArray  #: (O, 3, 3) axes of the flange in R0
    force: FloatArray  #: (O, 3) on the robot, axes of R0 [N]
    moment: FloatArray  #: (O, 3) about the load point, axes of R0 [N·m]
    direction: FloatArray  #: (O, 3) unit vectors along which compliance is asked for, axes of R0
    place: FloatArray  #: (3,) place of the tool, flange frame [m]: it is brought to the places
    load_point: FloatArray  #: (3,) where the force acts, flange frame [m]
    limits: FloatArray  #: (n, 2) least and greatest angles as the controller shows them [rad]; ∓inf for none
    #: (n,) controller's angles [rad] that each place stays nearest to; None: it is the stiffest
    near: FloatArray | None
    confidence: float  #: level of the intervals

    def cases(self, orientation: IndexArray, joints: FloatArray) -> LoadCases:
        """Return the load cases of postures (R, n) in orientations (R,)."""
        count = len(joints)
        return LoadCases(
            joints=joints.copy(),
            force=self.force[orientation],
            moment=self.moment[orientation],
            load_point=np.tile(self.load_point, (count, 1)),
            place=np.tile(self.place, (count, 1)),
        )


def tool_rotations(tool_axis: FloatArray, directions: FloatArray, turns: int) -> FloatArray:
    """Return the orientations of the flange that point a tool along directions.

    At angle zero the flange's x axis, as far as it is across the tool, points along x of R0, as far as that
    is across the direction; y takes the place of an x that is along. Angles follow about the tool axis.

    Args:
        tool_axis: (3,) unit vector in the flange frame.
        directions: (D, 3) unit vectors in R0.
        turns: number A of angles about the tool axis, evenly over a full turn.

    Returns:
        (D·A, 3, 3) axes of the flange in R0, the angles of a direction together.
    """
    about = Rotation.from_euler("z", _FULL_TURN * np.arange(turns)[:, None] / turns).as_matrix()
    tool = _frame_about(tool_axis)
    return np.concatenate([_frame_about(direction) @ about @ tool.T for direction in directions])


def _frame_about(axis: FloatArray) -> FloatArray:
    """Return right-handed axes (3, 3), the last of them given; the first is nearest to x, or else to y."""
    x, y = np.eye(3)[:2] - np.outer(axis[:2], axis)
    across = x if np.linalg.norm(x) > 1e-6 else y
    first = across / np.linalg.norm(across)
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def postures_within_limits(
    robot: Robot, task: MapTask, inverse: InverseKinematics, places: FloatArray
) -> tuple[IndexArray, IndexArray, FloatArray, IndexArray, IndexArray]:
    """Return place, orientation and angles (K,), (K,), (K, n) of all postures within limits.

    Last come the places (S,) that some posture reaches, limits or not, and those (L,) of which a posture is
    not known: a map that keeps near to a posture follows its branch where solutions may be missing, near a
    singularity, as programs follow theirs, and takes what it finds if no other solution is nearer.
    """
    count = len(task.rotation)
    poses = np.zeros((len(places), count, 4, 4))
    poses[..., 3, 3] = 1.0
    poses[..., :3, :3] = task.rotation
    poses[..., :3, 3] = places[:, None] - task.rotation @ task.place
    goals = poses.reshape(-1, 4, 4)
    solutions, complete = inverse.solutions(goals)
    lost = np.zeros(0, dtype=np.intp)
    arm, of_arm = inverse.arm, None if task.near is None else inverse.of_arm(task.near)
    if of_arm is not None:
        rows = np.flatnonzero(~complete)
        near = np.tile(arm.joint_map.model_angles(of_arm[None]), (len(rows), 1))
        followed, known = inverse.followed(goals[rows], near)
        known &= _far(followed, near) <= np.fmin.reduce(
            _far(solutions[rows], near[:, None]), axis=1, initial=np.inf
        )
        solutions[rows] = np.nan
        solutions[rows[known], 0] = followed[known]
        lost = np.unique(rows[~known] // count)
    angles = arm.joint_map.controller_angles(solutions)
    pose, branch = np.nonzero(np.isfinite(angles).all(axis=2))
    joints = inverse.whole(_turned(angles[pose, branch], arm, of_arm))
    place, orientation = np.divmod(pose, count)
    kept = ((joints >= task.limits[:, 0]) & (joints <= task.limits[:, 1])).all(axis=1)
    model_angles = robot.joint_map.model_angles(joints)
    kept &= ((model_angles >= robot.limits[:, 0]) & (model_angles <= robot.limits[:, 1])).all(axis=1)
    return place[kept], orientation[kept], joints[kept], np.unique(place), lost


def _far(angles: FloatArray, near: FloatArray) -> FloatArray:
    """Return the greatest difference of an angle, full turns aside, rounded [rad]."""
    apart = angles - near
    apart = np.abs(apart - _FULL_TURN * np.round(apart / _FULL_TURN)).max(axis=-1)
    return np.asarray(np.round(apart, 6))


def _turned(angles: FloatArray, arm: Robot, posture: FloatArray | None) -> FloatArray:
    """Return controller's angles (K, 6), model's angles turned fully towards the limits or a posture (6,).

    A joint that the map couples to others is turned in the model, where a full turn is one.
    """
    joint_map, limits = arm.joint_map, arm.limits
    q = joint_map.model_angles(angles)
    near = np.clip(0.0, *limits.T) if posture is None else joint_map.model_angles(posture[None])[0]
    q = q + _FULL_TURN * np.round((near - q) / _FULL_TURN)
    with np.errstate(invalid="ignore"):
        up = np.where(q < limits[:, 0], np.ceil((limits[:, 0] - q) / _FULL_TURN), 0.0)
        down = np.where(q > limits[:, 1], np.ceil((q - limits[:, 1]) / _FULL_TURN), 0.0)
    return joint_map.controller_angles(q + _FULL_TURN * (up - down))


@dataclass(frozen=True, eq=False)
class DeflectionMap:
    """P places of a map. Numbers are NaN where a place is not `reached`."""

    status: IndexArray  #: (P,) index into `STATUSES`
    orientation: IndexArray  #: (P,) index of the orientation
    #: (P, n) posture without the load, controller's angles [rad]; given where limits are kept
    joints: FloatArray
    displacement: FloatArray  #: (P, 3) displacement of the place, loaded minus unloaded, axes of R0 [m]
    along: FloatArray  #: (P,) compliance along the direction, uᵀ C_tt u [m/N]
    across: FloatArray  #: (P,) greatest compliance across it [m/N]
    #: (P, 2) interval of the displacement's length from the readings alone [m]; NaN if unknown
    readings: FloatArray
    with_model_error: FloatArray  #: (P, 2) with the model error, too [m]; NaN where there is no bound
    #: (P,) load, or what the readings say of the place, beyond the campaign's: above 1 it extrapolates; NaN
    #: without a model error
    extrapolation: FloatArray

    @classmethod
    def empty(cls, count: int, joints: int) -> DeflectionMap:
        """Return places out of reach."""
        return cls(
            np.full(count, _OUT_OF_REACH, dtype=np.intp),
            np.zeros(count, dtype=np.intp),
            *(np.full((count, *shape), np.nan) for shape in ((joints,), (3,), (), (), (2,), (2,), ())),
        )

    @property
    def reached(self) -> BoolArray:
        """(P,) whether a place has numbers."""
        return np.asarray(self.status == _REACHED)

    @property
    def length(self) -> FloatArray:
        """(P,) length of the displacement [m]."""
        return np.asarray(np.linalg.norm(self.displacement, axis=1))

    def __len__(self) -> int:
        return len(self.status)


def map_places(
    model: ForwardModel,
    error: ModelError | None,
    task: MapTask,
    inverse: InverseKinematics,
    places: FloatArray,
) -> DeflectionMap:
    """Map some places.

    The posture is chosen by the deflection that is linear in the load; all numbers of the chosen posture are
    the forward model's, as predictions are.

    Args:
        model: model of the loaded robot.
        error: of the model; None where it has none.
        task: tool, wrench and limits.
        inverse: kinematics of the same robot.
        places: (P, 3) in R0 [m].
    """
    robot, result = model.robot, DeflectionMap.empty(len(places), model.robot.n)
    place, orientation, joints, solved, lost = postures_within_limits(robot, task, inverse, places)
    result.status[solved] = _JOINT_LIMITS
    result.status[lost] = _NOT_FOLLOWED
    if not len(joints):
        return result
    home = np.zeros(robot.n) if task.near is None else task.near
    size = far = np.abs(joints - home).max(axis=1, initial=0.0)
    if task.near is None:
        cases = task.cases(orientation, joints)
        size = np.linalg.norm(model.linear_displacement(cases, model.unloaded(cases)), axis=1)
    with np.errstate(divide="ignore"):
        rank = np.round(np.log(size) / _TIE)  # what differs by rounding is a tie
    order = np.lexsort((orientation, far, rank, place))
    best = order[np.unique(place[order], return_index=True)[1]]  # one posture of each place
    loaded = map_postures(model, error, task, orientation[best], joints[best])
    for name, column in vars(loaded).items():
        getattr(result, name)[place[best]] = column
    return result


def map_postures(
    model: ForwardModel,
    error: ModelError | None,
    task: MapTask,
    orientation: IndexArray,
    joints: FloatArray,
) -> DeflectionMap:
    """Return what a map says of postures.

    Args:
        model: model of the loaded robot.
        error: of the model; None where it has none.
        task: tool and wrench.
        orientation: (P,) index of the orientation.
        joints: (P, n) controller's angles [rad].
    """
    result = DeflectionMap.empty(len(joints), model.robot.n)
    result.orientation[:], result.joints[:] = orientation, joints
    cases = task.cases(orientation, joints)
    unloaded = model.unloaded(cases)
    overloaded = model.overloaded(cases, unloaded)
    result.status[overloaded] = _OVERLOADED
    bearable = np.flatnonzero(~overloaded)
    if not len(bearable):
        return result
    cases = cases[bearable] if overloaded.any() else cases
    bent = model.deflect(cases, None if overloaded.any() else unloaded)
    unseen, direction = bent.unseen.any(axis=1), task.direction[orientation[bearable]]
    result.status[bearable] = np.where(unseen, _UNSEEN, _REACHED)
    compliance = bent.compliance
    known_along, known_across = bent.compliance_known(direction)
    readings = bent.interval_along(unit_vectors(bent.displacement), task.confidence)
    columns = {
        "displacement": bent.displacement,
        "along": np.where(known_along, compliance.along(direction), np.nan),
        "across": np.where(known_across, compliance.across(direction), np.nan),
        "readings": np.maximum(readings, 0.0),
    }
    if error is not None:
        bound = error.bound(cases, bent.leverage, task.confidence)
        length = np.linalg.norm(bent.displacement, axis=1)
        half = np.where(np.isfinite(bound.radius), bound.radius, np.nan)
        held = np.where(np.isnan(half)[:, None], np.nan, columns["readings"])
        ends = np.fmin(np.maximum(length - half, 0.0), held[:, 0]), np.fmax(length + half, held[:, 1])
        columns["with_model_error"] = np.stack(ends, axis=1)
        beyond = np.maximum(bound.load_ratio, bound.leverage_ratio)
        columns["extrapolation"] = np.where(np.isfinite(beyond), beyond, np.inf)
    for name, column in columns.items():
        getattr(result, name)[bearable[~unseen]] = column[~unseen]
    return result
