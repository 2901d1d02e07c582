"""Maps of a work area: how far the tool bends at each place (method.md §11)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.deflection.compensation import uncertainties
from jointstiff.solver.deflection.elastic import ElasticPredictor
from jointstiff.solver.deflection.joint_model import JointModel
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.deflection.loaded import LoadedPosture
from jointstiff.solver.deflection.map_postures import chosen_postures, postures_within_limits
from jointstiff.solver.deflection.map_task import MapTask
from jointstiff.solver.deflection.model_error import ModelError, ModelErrorBound
from jointstiff.solver.regression.complementary_stiffness import wrench_stiffness
from jointstiff.solver.regression.regressor import joint_torque
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.inverse import InverseKinematics

PlaceStatus = Literal["reached", "out_of_reach", "joint_limits", "unseen_joint", "overloaded"]
STATUSES: Final[tuple[PlaceStatus, ...]] = get_args(PlaceStatus)

_REACHED, _OUT_OF_REACH, _JOINT_LIMITS, _UNSEEN, _OVERLOADED = range(5)
_SOFTEST: Final = 0.5
"""Share of the joints' stiffness that the load may take away; more is no load of a process."""
_LARGEST_TURN: Final = 0.25
"""Greatest deflection of a joint [rad]; likewise."""


@dataclass(frozen=True, eq=False)
class DeflectionMap:
    """P places of a map. Numbers are NaN where a place is not `reached`."""

    status: IndexArray  #: (P,) index into `STATUSES`
    orientation: IndexArray  #: (P,) index of the fan
    #: (P, n) posture without the load, controller's angles [rad]; given where limits are kept
    joints: FloatArray
    displacement: FloatArray  #: (P, 3) of the place, loaded minus unloaded, axes of R0 [m]
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
    model: JointModel | ElasticPredictor,
    error: ModelError | None,
    task: MapTask,
    inverse: InverseKinematics,
    places: FloatArray,
) -> DeflectionMap:
    """Map some places.

    The posture is chosen by the deflection that is linear in the load, ``J diag(c) τ``; all numbers
    of the chosen posture are of the exact balance of springs and load, as predictions are. Where links bend,
    both are linear in the load.

    Args:
        model: elastic joints, or links as well.
        error: of the model; None where it has none.
        task: tool, wrench and limits.
        inverse: kinematics of the same robot.
        places: (P, 3) in R0 [m].
    """
    robot, found = model.robot, DeflectionMap.empty(len(places), model.robot.n)
    place, orientation, joints, solved = postures_within_limits(robot, task, inverse, places)
    found.status[solved] = _JOINT_LIMITS
    best = chosen_postures(model, task, place, orientation, joints)
    if len(best):
        loaded = map_postures(model, error, task, orientation[best], joints[best])
        for name, column in vars(loaded).items():
            getattr(found, name)[place[best]] = column
    return found


def map_postures(
    model: JointModel | ElasticPredictor,
    error: ModelError | None,
    task: MapTask,
    orientation: IndexArray,
    joints: FloatArray,
) -> DeflectionMap:
    """Return what a map says of postures, by the exact balance of springs and load, or the elastic model.

    Args:
        model: elastic joints, or links as well.
        error: of the model; None where it has none.
        task: tool and wrench.
        orientation: (P,) index of the fan.
        joints: (P, n) controller's angles [rad].
    """
    found = DeflectionMap.empty(len(joints), model.robot.n)
    found.orientation[:], found.joints[:] = orientation, joints
    if isinstance(model, ElasticPredictor):
        _fill_elastic(found, model, error, task)
        return found
    overloaded = _overloaded(model, task.cases(orientation, joints))
    found.status[:] = np.where(overloaded, _OVERLOADED, _REACHED)
    if not overloaded.all():
        calm = task.cases(orientation[~overloaded], joints[~overloaded])
        _fill(found, model, error, task, LoadedPosture.of(model.robot, model.compliance, calm))
    return found


def _overloaded(model: JointModel, cases: LoadCases) -> BoolArray:
    """Return the cases (R,) whose load is beyond what springs of joints are a model of."""
    here = Configurations(model.robot, model.robot.joint_map.model_angles(cases.joints))
    jacobian = here.jacobian_at(here.to_base(cases.load_point[:, None]))[:, 0]
    torque = joint_torque(here, jacobian, cases.force, cases.moment)
    stiffness = np.abs(wrench_stiffness(here, jacobian, cases.force, cases.moment))
    softening = model.compliance * np.einsum("bij->bi", stiffness)  # each row's sum, faster than `sum`
    soft, turned = softening > _SOFTEST, np.abs(model.compliance * torque) > _LARGEST_TURN
    return np.asarray((soft | turned).any(axis=1))


def _fill(
    found: DeflectionMap, model: JointModel, error: ModelError | None, task: MapTask, posture: LoadedPosture
) -> None:
    """Write the numbers of loaded postures (R,) into the places of a map that are reached."""
    where, moved = np.flatnonzero(found.reached), posture.displacement
    jacobian = posture.jacobian(posture.cases.place)[:, :3]
    answer = jacobian @ posture.softened
    rows = answer * posture.torque[:, None]  # ∂(displacement)/∂c
    translation = (answer * model.compliance) @ jacobian.transpose(0, 2, 1)  # C_tt
    seen = ~model.unseen(rows).any(axis=1)
    found.status[where[~seen]] = _UNSEEN
    length = np.linalg.norm(moved, axis=1)
    ends, with_error, extrapolation = _intervals(model, error, task, posture, rows, length)
    along, across = _along_and_across(
        model, translation, jacobian, task.fan.direction[found.orientation[where]]
    )
    for column, value in (
        (found.displacement, moved),
        (found.along, along),
        (found.across, across),
        (found.readings, ends),
        (found.with_model_error, with_error),
        (found.extrapolation, extrapolation),
    ):
        column[where[seen]] = value[seen]


def _fill_elastic(
    found: DeflectionMap, model: ElasticPredictor, error: ModelError | None, task: MapTask
) -> None:
    """Write the numbers of postures (P,) by the elastic model, to first order in the load."""
    robot, cases = model.robot, task.cases(found.orientation, found.joints)
    places = model.places(cases, Configurations(robot, robot.joint_map.model_angles(found.joints)))
    moved, translation = places.deflection(model.compliances), places.compliance(model.compliances)
    overloaded = np.linalg.norm(moved[:, 3:], axis=1) > _LARGEST_TURN
    unseen = model.unseen(places).any(axis=1)
    found.status[:] = np.where(overloaded, _OVERLOADED, np.where(unseen, _UNSEEN, _REACHED))
    found.displacement[:] = moved[:, :3]
    length = found.length
    direction = task.fan.direction[found.orientation]
    if model.seen.all():  # an unknown joint may answer to other forces than the load
        found.along[:] = np.einsum("bi,bij,bj->b", direction, translation[:, :3, :3], direction)
        found.across[:] = _greatest_across(translation[:, :3, :3], direction)
    half = model.half(places)
    uncertainty, leverage = uncertainties(None if half is None else half[:, :3], moved[:, :3])
    spread = model.quantile(task.confidence) * uncertainty[:, None] * np.array([-1.0, 1.0])
    found.readings[:] = np.maximum(length[:, None] + spread, 0.0)
    if error is not None:
        bound = error.bound_of(cases, leverage, task.confidence)
        found.with_model_error[:], found.extrapolation[:] = _with_model_error(bound, length, found.readings)
    for column in vars(found).values():
        if column.dtype.kind == "f" and column is not found.joints:
            column[~found.reached] = np.nan


def _intervals(
    model: JointModel,
    error: ModelError | None,
    task: MapTask,
    posture: LoadedPosture,
    rows: FloatArray,
    length: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return intervals (R, 2) of the length from readings and with model error [m]; extrapolation (R,)."""
    unknown = np.full((len(length), 2), np.nan)
    along = posture.displacement / np.where(length > 0.0, length, 1.0)[:, None]
    linear = np.einsum("bi,bij->bj", along, rows)
    free = model.free_ends(linear, task.confidence)
    ends = unknown if free is None else free + (length - linear @ model.compliance)[:, None]
    ends = np.maximum(ends, 0.0)
    if error is None:
        return ends, unknown, unknown[:, 0]
    return ends, *_with_model_error(error.bound(model, posture, task.confidence), length, ends)


def _with_model_error(
    bound: ModelErrorBound, length: FloatArray, ends: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return intervals (R, 2) of the length with model error [m], and extrapolation (R,)."""
    half = np.where(np.isfinite(bound.radius), bound.radius, np.nan)
    lower = np.fmin(np.maximum(length - half, 0.0), np.where(np.isnan(half), np.nan, ends[:, 0]))
    upper = np.fmax(length + half, np.where(np.isnan(half), np.nan, ends[:, 1]))
    extrapolation = np.maximum(bound.load_ratio, bound.leverage_ratio)
    return np.stack([lower, upper], axis=1), np.where(np.isfinite(extrapolation), extrapolation, np.inf)


def _along_and_across(
    model: JointModel, translation: FloatArray, jacobian: FloatArray, direction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return compliance along and across directions (R, 3), both (R,) [m/N].

    A joint of which the readings say nothing answers to other forces than the load: then they are unknown.
    """
    along = np.square(np.einsum("bi,bij->bj", direction, jacobian))
    across = np.maximum(np.einsum("bij,bij->bj", jacobian, jacobian) - along, 0.0)
    known = (~model.unseen(rows[:, None]).any(axis=1) for rows in (along, across))
    numbers = (
        np.einsum("bi,bij,bj->b", direction, translation, direction),
        _greatest_across(translation, direction),
    )
    first, second = (np.where(k, number, np.nan) for k, number in zip(known, numbers, strict=True))
    return first, second


def _greatest_across(translation: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the greatest eigenvalue (R,) of C_tt (R, 3, 3) in the plane across unit vectors (R, 3) [m/N]."""
    helper = np.where(np.abs(direction[:, :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = np.cross(direction, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    plane = np.stack([first, np.cross(direction, first)], axis=1)  # (R, 2, 3)
    form = plane @ translation @ plane.transpose(0, 2, 1)
    mean, half = 0.5 * (form[:, 0, 0] + form[:, 1, 1]), 0.5 * (form[:, 0, 0] - form[:, 1, 1])
    return np.asarray(mean + np.hypot(half, 0.5 * (form[:, 0, 1] + form[:, 1, 0])))
