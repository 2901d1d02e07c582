"""Maps of a work area: how far the tool bends at each place (method.md §11)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.deflection.forward import ForwardModel, unit_vectors
from jointstiff.solver.deflection.map_task import MapTask, postures_within_limits
from jointstiff.solver.deflection.model_error import ModelError
from jointstiff.solver.robot.inverse import InverseKinematics

PlaceStatus = Literal["reached", "out_of_reach", "joint_limits", "unseen_joint", "overloaded", "not_followed"]
STATUSES: Final[tuple[PlaceStatus, ...]] = get_args(PlaceStatus)

_REACHED, _OUT_OF_REACH, _JOINT_LIMITS, _UNSEEN, _OVERLOADED, _NOT_FOLLOWED = range(6)
_TIE: Final = 1e-9
"""Relative difference of two deflections that is rounding: wrists turned over bend alike."""


@dataclass(frozen=True, eq=False)
class DeflectionMap:
    """P places of a map. Numbers are NaN where a place is not `reached`."""

    status: IndexArray  #: (P,) index into `STATUSES`
    orientation: IndexArray  #: (P,) index of the fan
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

    @classmethod
    def joined(cls, parts: list[DeflectionMap]) -> DeflectionMap:
        """Return the places of all parts, in order."""
        return cls(
            *(
                np.concatenate(columns)
                for columns in zip(*(vars(part).values() for part in parts), strict=True)
            )
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
        orientation: (P,) index of the fan.
        joints: (P, n) controller's angles [rad].
    """
    result = DeflectionMap.empty(len(joints), model.robot.n)
    result.orientation[:], result.joints[:] = orientation, joints
    cases = task.cases(orientation, joints)
    unloaded = model.unloaded(cases)
    overloaded = model.overloaded(cases, unloaded)
    if overloaded.any():
        result.status[overloaded] = _OVERLOADED
        orientation, joints = orientation[~overloaded], joints[~overloaded]
        if not len(joints):
            return result
        cases = task.cases(orientation, joints)
        unloaded = model.unloaded(cases)
    bent = model.deflect(cases, unloaded)
    unseen, direction = bent.unseen.any(axis=1), task.fan.direction[orientation]
    result.status[~overloaded] = np.where(unseen, _UNSEEN, _REACHED)
    translation = bent.compliance.translation
    known_along, known_across = bent.compliance_known(direction)
    along = np.einsum("bi,bij,bj->b", direction, translation, direction)
    length = np.linalg.norm(bent.displacement, axis=1)
    readings = bent.interval_along(unit_vectors(bent.displacement), task.confidence)
    readings = np.maximum(readings, 0.0)
    with_model_error, extrapolation = np.full((len(joints), 2), np.nan), np.full(len(joints), np.nan)
    if error is not None:
        bound = error.bound(cases, bent.leverage, task.confidence)
        half = np.where(np.isfinite(bound.radius), bound.radius, np.nan)
        held = np.where(np.isnan(half)[:, None], np.nan, readings)
        with_model_error[:, 0] = np.fmin(np.maximum(length - half, 0.0), held[:, 0])
        with_model_error[:, 1] = np.fmax(length + half, held[:, 1])
        extrapolation = np.maximum(bound.load_ratio, bound.leverage_ratio)
        extrapolation = np.where(np.isfinite(extrapolation), extrapolation, np.inf)
    reached = result.reached
    for column, value in (
        (result.displacement, bent.displacement),
        (result.along, np.where(known_along, along, np.nan)),
        (result.across, np.where(known_across, _greatest_across(translation, direction), np.nan)),
        (result.readings, readings),
        (result.with_model_error, with_model_error),
        (result.extrapolation, extrapolation),
    ):
        column[reached] = value[~unseen]
    return result


def _greatest_across(translation: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the greatest eigenvalue (R,) of C_tt (R, 3, 3) in the plane across unit vectors (R, 3) [m/N]."""
    helper = np.where(np.abs(direction[:, :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = np.cross(direction, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    plane = np.stack([first, np.cross(direction, first)], axis=1)  # (R, 2, 3)
    form = plane @ translation @ plane.transpose(0, 2, 1)
    mean, half = 0.5 * (form[:, 0, 0] + form[:, 1, 1]), 0.5 * (form[:, 0, 0] - form[:, 1, 1])
    return np.asarray(mean + np.hypot(half, 0.5 * (form[:, 0, 1] + form[:, 1, 0])))
