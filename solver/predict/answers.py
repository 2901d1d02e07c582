"""Messages of results, built from arrays: stored models of runs, load cases, and maps.

A map states how far the tool is deflected at each place of a work area (method.md §11). The task of a map
states tool, orientations, process wrench and limits, and so which postures a place allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, isfinite
from typing import Any, Final, TypeVar, get_args

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from jointstiff.schemas import deflection as cases
from jointstiff.schemas import model as stored_as
from jointstiff.schemas.fields import Message
from jointstiff.schemas.run import Budget, JointResult
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, cross
from jointstiff.solver.errors import JointstiffError, RequestError
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.stages import Likelihood
from jointstiff.solver.mechanics.block import OwnWeight
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.inverse import InverseKinematics, compute_angle_gaps, fit_to_ranges
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.messages import build_messages, point
from jointstiff.solver.models import Columns
from jointstiff.solver.predict.forward import Deflection, ForwardModel, unit_vectors
from jointstiff.solver.predict.models import (
    EXTRAPOLATED,
    ElasticPredictor,
    IdentifiedWeight,
    JointModel,
    ModelError,
    ModelErrorBound,
)
from jointstiff.solver.text import figure

STATUSES: Final[tuple[cases.PlaceStatus, ...]] = get_args(cases.PlaceStatus)

_REACHED, _OUT_OF_REACH, _JOINT_LIMITS, _UNSEEN, _OVERLOADED, _NOT_FOLLOWED = range(6)
_TIE: Final = 1e-9
"""Relative difference of two deflections that counts as rounding, as for a wrist that is turned over."""
_FULL_TURN: Final = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class MapTask:
    """Task of a map: tool, loads and limits at each place, with O orientations to choose from."""

    rotation: FloatArray  #: (O, 3, 3) axes of the flange in R0
    force: FloatArray  #: (O, 3) on the robot, axes of R0 [N]
    moment: FloatArray  #: (O, 3) about the load point, axes of R0 [N·m]
    direction: FloatArray  #: (O, 3) unit vectors along which compliance is requested, axes of R0
    place: FloatArray  #: (3,) point of the tool that is brought to the places of the map, flange frame [m]
    load_point: FloatArray  #: (3,) where the force acts, flange frame [m]
    #: (n, 2) least and greatest angles as the controller shows them [rad]; ∓inf for no limit
    limits: FloatArray
    #: (n,) controller's angles [rad] to which the nearest posture is chosen; None to choose the stiffest
    #: posture
    near: FloatArray | None
    confidence: float  #: level of the intervals

    def cases(self, orientation: IndexArray, joints: FloatArray) -> LoadCases:
        """Build the load cases of R postures.

        Args:
            orientation: (R,) index of each posture's orientation of the flange.
            joints: (R, n) controller's angles [rad].
        """
        count = len(joints)
        return LoadCases(
            joints=joints.copy(),
            force=self.force[orientation],
            moment=self.moment[orientation],
            load_point=np.tile(self.load_point, (count, 1)),
            place=np.tile(self.place, (count, 1)),
        )


def compute_tool_rotations(tool_axis: FloatArray, directions: FloatArray, turns: int) -> FloatArray:
    """Compute the orientations of the flange in which a tool points along directions, at several turns.

    At turn zero, the flange's x axis and the x axis of R0 have the same projection on the plane perpendicular
    to the tool. If an x axis is parallel to the tool, the y axis is used instead.

    Args:
        tool_axis: (3,) unit vector in the flange frame.
        directions: (D, 3) unit vectors in R0.
        turns: number A of angles about the tool axis, evenly spread over a full turn.

    Returns:
        (D·A, 3, 3) axes of the flange in R0 as columns; the A angles of a direction follow each other.
    """
    about_z = Rotation.from_euler("z", _FULL_TURN * np.arange(turns)[:, None] / turns).as_matrix()
    tool = _build_frame_about(tool_axis)
    return np.concatenate([_build_frame_about(direction) @ about_z @ tool.T for direction in directions])


def _build_frame_about(axis: FloatArray) -> FloatArray:
    """Return right-handed orthonormal axes (3, 3) as columns, for a given last axis (3,).

    The first axis is as near to x as possible, or to y if the given axis is along x.
    """
    x_normal_part, y_normal_part = np.eye(3)[:2] - np.outer(axis[:2], axis)
    perpendicular = x_normal_part if np.linalg.norm(x_normal_part) > 1e-6 else y_normal_part
    first_axis = perpendicular / np.linalg.norm(perpendicular)
    return np.stack([first_axis, cross(axis, first_axis), axis], axis=1)


def find_postures_within_limits(
    robot: Robot, task: MapTask, inverse: InverseKinematics, places: FloatArray
) -> tuple[IndexArray, IndexArray, FloatArray, IndexArray, IndexArray]:
    """Find all postures within the limits of task and robot that bring the tool to given places.

    Near a singularity the inverse kinematics may miss solutions. If the task states a posture `near`,
    its branch of solutions is then followed, and the posture found is used if no other solution is nearer.

    Args:
        robot: n joints.
        task: tool, orientations and limits.
        inverse: inverse kinematics of the robot.
        places: (P, 3) in R0 [m].

    Returns:
        For K postures: (K,) index of the place, (K,) index of the orientation, and (K, n) controller's angles
        [rad]. Then (S,) indices of the places that a posture reaches, within the limits or not; and (L,)
        indices of the places at which the branch could not be followed.
    """
    orientation_count = len(task.rotation)
    # Pose of the flange at every place in every orientation
    poses = np.zeros((len(places), orientation_count, 4, 4))
    poses[..., 3, 3] = 1.0
    poses[..., :3, :3] = task.rotation
    poses[..., :3, 3] = places[:, None] - task.rotation @ task.place
    goals = poses.reshape(-1, 4, 4)
    solutions, complete = inverse.solve(goals)
    not_followed = np.zeros(0, dtype=np.intp)
    arm = inverse.arm
    near_angles = None if task.near is None else inverse.select_arm_joints(task.near)
    if near_angles is not None:
        incomplete = np.flatnonzero(~complete)
        start_angles = np.tile(arm.joint_map.model_angles(near_angles[None]), (len(incomplete), 1))
        followed, is_usable = inverse.follow_branches(goals[incomplete], start_angles)
        # The followed posture is used only if no other solution is nearer.
        other_gaps = np.round(compute_angle_gaps(solutions[incomplete], start_angles[:, None]), 6)
        least_gaps = np.fmin.reduce(other_gaps, axis=1, initial=np.inf)
        is_usable &= np.round(compute_angle_gaps(followed, start_angles), 6) <= least_gaps
        solutions[incomplete] = np.nan
        solutions[incomplete[is_usable], 0] = followed[is_usable]
        not_followed = np.unique(incomplete[~is_usable] // orientation_count)
    pose_index, solution_index = np.nonzero(np.isfinite(solutions).all(axis=2))
    limits = inverse.select_arm_joints(task.limits.T).T
    is_allowed, angles = fit_to_ranges(arm, solutions[pose_index, solution_index], limits, near_angles)
    joints = inverse.insert_held_joints(angles)
    place, orientation = np.divmod(pose_index, orientation_count)
    is_allowed &= ((joints >= task.limits[:, 0]) & (joints <= task.limits[:, 1])).all(axis=1)
    model_angles = robot.joint_map.model_angles(joints)
    is_allowed &= ((model_angles >= robot.limits[:, 0]) & (model_angles <= robot.limits[:, 1])).all(axis=1)
    return place[is_allowed], orientation[is_allowed], joints[is_allowed], np.unique(place), not_followed


@dataclass(frozen=True, eq=False)
class DeflectionMap:
    """Map of P places. The numbers of a place are NaN if the place is not `reached`."""

    status: IndexArray  #: (P,) index into `STATUSES`
    orientation: IndexArray  #: (P,) index of the orientation
    #: (P, n) posture without the load, controller's angles [rad]; NaN where no posture is within the limits
    joints: FloatArray
    displacement: FloatArray  #: (P, 3) displacement of the place, loaded minus unloaded, axes of R0 [m]
    along: FloatArray  #: (P,) compliance along the direction, uᵀ C_tt u [m/N]
    across: FloatArray  #: (P,) greatest compliance perpendicular to the direction [m/N]
    #: (P, 2) interval of the displacement's length from the readings alone [m]; NaN if unknown
    readings: FloatArray
    with_model_error: FloatArray  #: (P, 2) interval that includes the model error [m]; NaN if it has no bound
    #: (P,) greater ratio of load, or of leverage, to the campaign's greatest: above EXTRAPOLATED the place is
    #: extrapolated; NaN without a model error
    extrapolation: FloatArray

    @classmethod
    def all_out_of_reach(cls, count: int, joints: int) -> DeflectionMap:
        """Return a map of `count` places that are all out of reach, with NaN for every number.

        Args:
            count: number P of places.
            joints: number n of joints.
        """
        return cls(
            np.full(count, _OUT_OF_REACH, dtype=np.intp),
            np.zeros(count, dtype=np.intp),
            *(np.full((count, *shape), np.nan) for shape in ((joints,), (3,), (), (), (2,), (2,), ())),
        )

    @property
    def reached(self) -> BoolArray:
        """(P,) mask of the places that the tool reaches and whose numbers are known."""
        return np.asarray(self.status == _REACHED)

    @property
    def length(self) -> FloatArray:
        """(P,) length of the displacement [m]."""
        return np.asarray(np.linalg.norm(self.displacement, axis=1))

    def __len__(self) -> int:
        """Return the number P of places."""
        return len(self.status)


def map_places(
    model: ForwardModel,
    error: ModelError | None,
    task: MapTask,
    inverse: InverseKinematics,
    places: FloatArray,
) -> DeflectionMap:
    """Map places: choose a posture for each place and compute how far the tool bends there.

    The chosen posture has the least deflection to first order in the load, or is nearest to `task.near`. The
    numbers of the chosen posture are exact predictions of the forward model.

    Args:
        model: model of the loaded robot.
        error: error of the model; None if unknown.
        task: tool, wrench and limits.
        inverse: kinematics of the same robot.
        places: (P, 3) in R0 [m].
    """
    robot, result = model.robot, DeflectionMap.all_out_of_reach(len(places), model.robot.n)
    place_of_posture, orientation, joints, solved_places, not_followed = find_postures_within_limits(
        robot, task, inverse, places
    )
    # Places with a posture within the limits get another status below.
    result.status[solved_places] = _JOINT_LIMITS
    result.status[not_followed] = _NOT_FOLLOWED
    if not len(joints):
        return result
    home = np.zeros(robot.n) if task.near is None else task.near
    travel = np.abs(joints - home).max(axis=1, initial=0.0)
    minimised = travel  # quantity that the chosen posture has the least of
    if task.near is None:
        cases = task.cases(orientation, joints)
        minimised = np.linalg.norm(model.linear_displacement(cases, model.unloaded(cases)), axis=1)
    with np.errstate(divide="ignore"):
        rank = np.round(np.log(minimised) / _TIE)  # sizes that differ by rounding get the same rank
    # The last key sorts first: places, then rank, travel from home, and orientation.
    sorted_postures = np.lexsort((orientation, travel, rank, place_of_posture))
    # First posture of each place
    chosen = sorted_postures[np.unique(place_of_posture[sorted_postures], return_index=True)[1]]
    loaded = map_postures(model, error, task, orientation[chosen], joints[chosen])
    for name, column in vars(loaded).items():
        getattr(result, name)[place_of_posture[chosen]] = column
    return result


def map_postures(
    model: ForwardModel,
    error: ModelError | None,
    task: MapTask,
    orientation: IndexArray,
    joints: FloatArray,
) -> DeflectionMap:
    """Compute displacement, compliances, intervals and status of a map in P given postures.

    Args:
        model: model of the loaded robot.
        error: error of the model; None if unknown.
        task: tool and wrench.
        orientation: (P,) index of the tool's orientation in each posture.
        joints: (P, n) controller's angles [rad].
    """
    result = DeflectionMap.all_out_of_reach(len(joints), model.robot.n)
    result.orientation[:], result.joints[:] = orientation, joints
    cases = task.cases(orientation, joints)
    unloaded = model.unloaded(cases)
    overloaded = model.find_overloads(cases, unloaded)
    result.status[overloaded] = _OVERLOADED
    bearable = np.flatnonzero(~overloaded)
    if not len(bearable):
        return result
    # The kinematics without load are used again only if no case was removed.
    cases = cases[bearable] if overloaded.any() else cases
    deflection = model.deflect(cases, None if overloaded.any() else unloaded)
    is_undetermined = deflection.unseen.any(axis=1)
    direction = task.direction[orientation[bearable]]
    result.status[bearable] = np.where(is_undetermined, _UNSEEN, _REACHED)
    compliance = deflection.compliance
    known_along, known_across = deflection.compliance_known(direction)
    readings = deflection.interval_along(unit_vectors(deflection.displacement), task.confidence)
    columns = {
        "displacement": deflection.displacement,
        "along": np.where(known_along, compliance.compliance_along(direction), np.nan),
        "across": np.where(known_across, compliance.greatest_compliance_across(direction), np.nan),
        "readings": np.maximum(readings, 0.0),
    }
    if error is not None:
        bound = error.bound(cases, deflection.leverage, task.confidence)
        deflection_length = np.linalg.norm(deflection.displacement, axis=1)
        radius = np.where(np.isfinite(bound.radius), bound.radius, np.nan)
        # The interval contains that from the readings; it is NaN where the model error has no bound.
        readings_or_nan = np.where(np.isnan(radius)[:, None], np.nan, columns["readings"])
        interval = (
            np.fmin(np.maximum(deflection_length - radius, 0.0), readings_or_nan[:, 0]),
            np.fmax(deflection_length + radius, readings_or_nan[:, 1]),
        )
        columns["with_model_error"] = np.stack(interval, axis=1)
        extrapolation_ratio = np.maximum(bound.load_ratio, bound.leverage_ratio)
        columns["extrapolation"] = np.where(np.isfinite(extrapolation_ratio), extrapolation_ratio, np.inf)
    for name, column in columns.items():
        getattr(result, name)[bearable[~is_undetermined]] = column[~is_undetermined]
    return result


_PERCENTS: Final = (0, 5, 25, 50, 75, 95, 100)
_BLOCKS: Final = {
    f"{moved}_by_{load}": (slice(3 * i, 3 * i + 3), slice(3 * k, 3 * k + 3))
    for i, moved in enumerate(("translation", "rotation"))
    for k, load in enumerate(("force", "moment"))
}

Answer = TypeVar("Answer", bound=Message)


def build_messages_where(
    message_class: type[Answer],
    has_message: Sequence[bool] | BoolArray,
    **columns: npt.NDArray[Any] | Sequence[Any],
) -> list[Answer | None]:
    """Build one message for each row of columns where a mask is true; None for the other rows.

    Args:
        message_class: class of the messages.
        has_message: (N,) mask of the rows that get a message.
        columns: N values of each field of the messages, by the field's name.

    Returns:
        N messages or None, in the order of the rows.
    """
    rows = np.flatnonzero(has_message).tolist()
    messages: list[Answer | None] = [None] * len(has_message)
    built = build_messages(
        message_class, **{name: [column[i] for i in rows] for name, column in columns.items()}
    )
    for i, answer in zip(rows, built, strict=True):
        messages[i] = answer
    return messages


def _round_to_eight_digits(values: FloatArray) -> list[float]:
    """Return the values of an array rounded to eight significant digits."""
    return [float(f"{value:.8g}") for value in values.tolist()]


def build_stored_model(
    model: JointModel | ElasticPredictor, error: ModelError | JointstiffError
) -> stored_as.IdentifiedModel:
    """Build the message that stores an identified model with its run.

    Args:
        model: model of joints, or of joints and links.
        error: error of the model, or the exception that states why the model error is unknown.
    """
    stored = (
        _describe_elastic_model(model)
        if isinstance(model, ElasticPredictor)
        else _describe_joint_model(model)
    )
    stored |= {
        "joints": model.robot.joint_names,
        "degrees_of_freedom": model.degrees_of_freedom,
        "error": None,
    }
    if isinstance(error, ModelError):
        stored["error"] = stored_as.ModelError(
            postures=error.postures,
            steps=build_messages(stored_as.ScoreStep, score=error.score, share=error.share),
            force=error.force,
            moment=error.moment,
            least_load=error.least_load,
            leverage=error.leverage,
            noise=error.noise,
            load_point_leverage=error.load_point_leverage,
        )
    else:
        stored["no_error"] = error.reason
    return stored_as.IdentifiedModel.model_validate(stored)


def _describe_joint_model(model: JointModel) -> dict[str, Any]:
    """Return the fields of a stored model in which only joints bend.

    The fields `estimate` and `covariance` are without constraints, and only for the joints listed in `seen`.
    """
    names = model.robot.joint_names
    likelihood = model.likelihood
    bounds = model.constraints.bounds
    own_weight = None
    if isinstance(model.weight, IdentifiedWeight):
        own_weight = stored_as.WeightPart(
            gravity=point(model.weight.gravity),
            mass=model.weight.mass.tolist(),
            centre=model.weight.centre.tolist(),
            compliance=model.compliance.tolist(),
            covariance_root=[_round_to_eight_digits(row) for row in model.weight.root],
        )
    information_rows = None if likelihood is None else likelihood.given_rows
    return {
        "seen": [] if likelihood is None else [names[j] for j in likelihood.joints],
        "estimate": [] if likelihood is None else likelihood.centre.tolist(),
        "covariance": [] if likelihood is None else likelihood.covariance.tolist(),
        "information_root": None if information_rows is None else information_rows.tolist(),
        "lower": [value if isfinite(value) else None for value in bounds.lower.tolist()],
        "upper": [value if isfinite(value) else None for value in bounds.upper.tolist()],
        "order": model.constraints.order,
        "weight": own_weight,
    }


def _describe_elastic_model(model: ElasticPredictor) -> dict[str, Any]:
    """Return the fields of a stored model in which joints, links and base bend."""
    names, n = model.robot.joint_names, model.robot.n
    root = np.zeros(0) if model.root is None else model.root[np.triu_indices(len(model.kept))]
    return {
        "seen": [names[j] for j in np.flatnonzero(model.seen)],
        **dict.fromkeys(("estimate", "covariance", "order"), ()),
        "information_root": None,
        "lower": [0.0] * n,
        "upper": [None] * n,
        "elastic": {
            "links": [names[j] for j in model.columns.links],
            "columns": model.kept.tolist(),
            "entries": model.entries.tolist(),
            "covariance_root": _round_to_eight_digits(root),
        },
    }


def build_forward_model(
    robot: Robot,
    stored: stored_as.IdentifiedModel,
    joints: Sequence[JointResult],
    weight: OwnWeight | None = None,
) -> tuple[ForwardModel, ModelError | None]:
    """Build the forward model of a run, and its model error, from the stored messages.

    Args:
        robot: robot that was measured.
        stored: errors of the run's numbers, as stored.
        joints: joints of the run, whose compliances predict if only joints bend.
        weight: own weight of the links, ignored if links bend; None: no own weight.

    Returns:
        The forward model; and its model error, None if the run has no model error.

    Raises:
        RequestError: the stored model has other joints than the robot.
    """
    if list(robot.joint_names) != stored.joints:
        raise RequestError(
            f"the run was made with another robot, whose joints are {', '.join(stored.joints)}",
            where="run_id",
            remedy="give the robot that was measured",
        )
    error = None
    if stored.error is not None:
        score = _fill_missing_limits([step.score for step in stored.error.steps], np.inf)
        share = np.array([step.share for step in stored.error.steps], dtype=np.float64)
        error = ModelError(score=score, share=share, **stored.error.model_dump(exclude={"steps"}))
    if stored.elastic is None:
        return _build_joint_model(robot, stored, joints, weight), error
    return _build_elastic_model(robot, stored, stored.elastic), error


def _build_joint_model(
    robot: Robot,
    stored: stored_as.IdentifiedModel,
    joints: Sequence[JointResult],
    weight: OwnWeight | None,
) -> JointModel:
    """Return the forward model of a run in which only joints bend."""
    likelihood = None
    if stored.covariance:
        identified_joints = np.array([robot.joint_names.index(name) for name in stored.seen], dtype=np.intp)
        information_root = None if stored.information_root is None else np.array(stored.information_root)
        likelihood = Likelihood(
            identified_joints, np.array(stored.estimate), np.array(stored.covariance), information_root
        )
    bounds = Bounds(_fill_missing_limits(stored.lower, -np.inf), _fill_missing_limits(stored.upper, np.inf))
    if stored.weight is not None:  # joints without a published compliance sag, too
        compliance = np.array(stored.weight.compliance)
    else:
        compliance = _list_compliances(joints, likelihood, bounds)
    return JointModel(
        robot,
        compliance,
        likelihood,
        Constraints(bounds, tuple(stored.order)),
        weight,
        degrees_of_freedom=stored.degrees_of_freedom,
    )


def _list_compliances(
    joints: Sequence[JointResult], likelihood: Likelihood | None, bounds: Bounds
) -> FloatArray:
    """Return the compliance (n,) of each joint [rad/(N·m)] that predicts; zero where nothing is known.

    Joints that readings show only together have no published compliance, but their sum predicts: they have
    the most likely compliances given the published ones.
    """
    compliance = np.array([joint.compliance or 0.0 for joint in joints])
    if likelihood is None:
        return compliance
    seen, covariance = likelihood.joints, likelihood.covariance
    is_published = np.array([joints[j].compliance is not None for j in seen.tolist()])
    together = seen[~is_published]
    change = (compliance[seen] - likelihood.centre)[is_published]
    inverse = np.linalg.pinv(covariance[np.ix_(is_published, is_published)], hermitian=True)
    shift = covariance[np.ix_(~is_published, is_published)] @ inverse @ change
    most_likely = likelihood.centre[~is_published] + shift
    compliance[together] = np.clip(most_likely, bounds.lower[together], bounds.upper[together])
    return compliance


def _build_elastic_model(
    robot: Robot, stored: stored_as.IdentifiedModel, elastic: stored_as.ElasticPart
) -> ElasticPredictor:
    """Return the forward model of a run in which links or base bend."""
    covariance_root = None
    if elastic.covariance_root:
        covariance_root = np.zeros((len(elastic.columns), len(elastic.columns)))
        covariance_root[np.triu_indices(len(elastic.columns))] = elastic.covariance_root
    return ElasticPredictor(
        robot,
        Columns(robot.n, tuple(robot.joint_names.index(name) for name in elastic.links)),
        np.array(elastic.columns, dtype=np.intp),
        np.array(elastic.entries),
        covariance_root,
        np.isin(np.array(robot.joint_names), stored.seen),
        degrees_of_freedom=stored.degrees_of_freedom,
    )


def _fill_missing_limits(values: Sequence[float | None], limit: float) -> FloatArray:
    """Return values as an array (n,) with a limit in place of each None."""
    return np.array([limit if value is None else value for value in values], dtype=np.float64)


def build_case_results(
    deflection: Deflection,
    bound: ModelErrorBound | None,
    directions: FloatArray,
    confidence: float,
    labels: Sequence[str],
    budget: Budget | None,
) -> list[cases.CaseResult]:
    """Build the message of each load case's result.

    A case that twists a joint of unknown compliance has a remark instead of numbers.

    Args:
        deflection: deflections of B cases.
        bound: bounds of the model error of these displacements; None if the model error is unknown.
        directions: (B, 3) unit vectors along which stiffness is requested; NaN where no direction is
            requested.
        confidence: level of the intervals.
        labels: names of the cases.
        budget: uncertainty budget of the run; None if the run has none.
    """
    undetermined = deflection.unseen
    intervals = deflection.interval(confidence)
    joint_names = deflection.model.robot.joint_names
    is_valid = np.asarray(~undetermined.any(axis=1))
    with_error: Sequence[cases.ModelErrorInterval | None] = [None] * len(labels)
    radius = np.full(len(labels), np.inf)
    from_readings = np.full((len(labels), 6, 2), np.nan)
    if intervals is not None:
        from_readings = np.where(is_valid[:, None, None], intervals, np.nan)
    if bound is not None:
        radius = bound.radius
        with_error = build_messages_where(
            cases.ModelErrorInterval,
            is_valid & np.isfinite(radius),
            displacement=bound.interval(deflection.displacement, intervals),
            radius=radius,
            load_ratio=bound.load_ratio,
            leverage_ratio=bound.leverage_ratio,
        )
    remarks = [
        [] if bound is None else _list_extrapolation_remarks(bound, case) for case in range(len(labels))
    ]
    for case in np.flatnonzero(~is_valid).tolist():
        twisted = ", ".join(np.array(joint_names)[undetermined[case]])
        remarks[case] = [
            f"the load or own weight twists {twisted}, which the readings of the run do not determine: the "
            "prediction is not valid"
        ]
    budgets = _build_budget_messages(deflection, budget, radius, deflection.model.quantile(confidence))
    return build_messages(
        cases.CaseResult,
        label=labels,
        displacement=np.where(is_valid[:, None], deflection.displacement, np.nan),
        rotation=np.where(is_valid[:, None], deflection.rotation, np.nan),
        readings_only=from_readings[:, :3],
        rotation_interval=from_readings[:, 3:],
        with_model_error=with_error,
        compliance=_build_compliance_messages(deflection, directions, is_valid),
        remarks=remarks,
        budget=[message if valid else None for message, valid in zip(budgets, is_valid, strict=True)],
    )


def _list_extrapolation_remarks(bound: ModelErrorBound, case: int) -> list[str]:
    """Return remarks on how far a load case goes beyond what was measured; empty if it does not.

    `case` is the index of the load case in the bound.
    """
    load_ratio = float(bound.load_ratio[case])
    leverage_ratio = float(bound.leverage_ratio[case])
    remarks = []
    if np.isinf(load_ratio):
        remarks.append(f"extrapolated: the campaign has no {bound.unmeasured}, so the model error is unknown")
    elif load_ratio > EXTRAPOLATED:
        remarks.append(
            f"extrapolated: the load is {figure(load_ratio, '.3g')} times the greatest measured load"
        )
    if np.isfinite(load_ratio) and leverage_ratio > EXTRAPOLATED:
        remarks.append(
            f"extrapolated: the prediction is {figure(leverage_ratio, '.3g')} times as uncertain as that "
            "of the worst measured place"
        )
    return remarks


def _build_compliance_messages(
    deflection: Deflection, directions: FloatArray, valid: BoolArray
) -> list[cases.CartesianCompliance | None]:
    """Build the message of each load case's Cartesian compliance.

    Args:
        deflection: deflections of B load cases.
        directions: (B, 3) unit vectors along which stiffness is requested; NaN where no direction is
            requested.
        valid: (B,) mask of load cases that have numbers; the other cases get None.
    """
    compliance = deflection.compliance
    worst = deflection.compliance.worst
    is_requested = ~np.isnan(directions[:, 0])
    # Any direction where none is requested
    directions_or_x = np.where(is_requested[:, None], directions, [1.0, 0.0, 0.0])
    stiffness_messages = build_messages_where(
        cases.DirectionalStiffness,
        valid & is_requested,
        direction=directions_or_x,
        lateral_free=compliance.stiffness_lateral_free(directions_or_x),
        lateral_blocked=compliance.stiffness_lateral_blocked(directions_or_x),
        rotation_blocked=compliance.stiffness_rotation_blocked(directions_or_x),
        compliance=compliance.compliance_along(directions_or_x),
        standard_uncertainty=compliance.uncertainty_along(directions_or_x),
    )
    return build_messages_where(
        cases.CartesianCompliance,
        valid,
        **{name: compliance.matrix[:, moved, load] for name, (moved, load) in _BLOCKS.items()},
        symmetric=compliance.symmetric,
        along=stiffness_messages,
        worst=build_messages_where(cases.WorstDirection, valid, **vars(worst)),
    )


def _build_budget_messages(
    deflection: Deflection, budget: Budget | None, radius: FloatArray, coverage_factor: float
) -> Sequence[cases.DeflectionBudget | None]:
    """Build the message of the uncertainty budget of the length of each case's displacement.

    Args:
        deflection: deflections of B cases.
        budget: uncertainty budget of the run's compliances; without a budget all B messages are None.
        radius: (B,) model error [m]; inf where unknown.
        coverage_factor: coverage factor of the intervals.
    """
    if budget is None:
        return [None] * len(radius)
    joints = deflection.model.robot.joint_names
    in_budget = [joints.index(name) for name in budget.joints]
    covariances = np.zeros((len(budget.components), len(joints), len(joints)))
    for k, component in enumerate(budget.components):
        deviations = np.array(component.contributions)
        covariances[np.ix_([k], in_budget, in_budget)] = np.outer(deviations, deviations) * np.array(
            component.correlation
        )
    budgets = []
    for contributions, model_error in zip(
        deflection.length_uncertainties(covariances).tolist(), radius.tolist(), strict=True
    ):
        uncertainty_of_source = {
            component.source: size
            for component, size in zip(budget.components, contributions, strict=True)
            if component.source != "model_error"
        }
        included = [
            component.source
            for component in budget.components
            if component.included and component.source in uncertainty_of_source
        ]
        combined = hypot(*(uncertainty_of_source[source] for source in included))
        if isfinite(model_error):  # the radius is an expanded uncertainty
            uncertainty_of_source["model_error"] = model_error / coverage_factor
        budgets.append(
            cases.DeflectionBudget(
                contributions=uncertainty_of_source,
                included=included,
                standard_uncertainty=combined,
                coverage_factor=coverage_factor,
                expanded_uncertainty=coverage_factor * combined,
                expanded_with_model_error=coverage_factor * hypot(*uncertainty_of_source.values()),
            )
        )
    return budgets


def summarise_map(deflection_map: DeflectionMap, places: FloatArray, tool: FloatArray) -> dict[str, Any]:
    """Summarise a map in the fields of its message: counts, percentiles, the worst and the stiffest place.

    Args:
        deflection_map: map of P places.
        places: (P, 3) in R0 [m].
        tool: (O, 3) direction of the tool in each orientation, in R0.
    """
    reached, lengths = np.flatnonzero(deflection_map.reached), deflection_map.length
    worst_and_stiffest: Sequence[cases.MapPlace | None] = (None, None)
    percentiles: dict[str, float] = {}
    if len(reached):
        # Indices of the place with the greatest deflection, and of that with the least
        worst_and_stiffest_index = [
            reached[np.argmax(lengths[reached])],
            reached[np.argmin(lengths[reached])],
        ]
        worst_and_stiffest = build_messages(
            cases.MapPlace,
            position=places[worst_and_stiffest_index],
            joints=deflection_map.joints[worst_and_stiffest_index],
            tool_direction=tool[deflection_map.orientation[worst_and_stiffest_index]],
            displacement=deflection_map.displacement[worst_and_stiffest_index],
            deflection=lengths[worst_and_stiffest_index],
            readings_only=deflection_map.readings[worst_and_stiffest_index],
            with_model_error=deflection_map.with_model_error[worst_and_stiffest_index],
            compliance_along=deflection_map.along[worst_and_stiffest_index],
            compliance_across=deflection_map.across[worst_and_stiffest_index],
            extrapolation=deflection_map.extrapolation[worst_and_stiffest_index],
        )
        deflections = np.quantile(lengths[reached], [percent / 100.0 for percent in _PERCENTS]).tolist()
        percentiles = dict(zip(map(str, _PERCENTS), deflections, strict=True))
    return {
        "places": len(deflection_map),
        "counts": {name: int((deflection_map.status == i).sum()) for i, name in enumerate(STATUSES)},
        "percentiles": percentiles,
        "worst": worst_and_stiffest[0],
        "stiffest": worst_and_stiffest[1],
        "extrapolated": int((deflection_map.extrapolation[reached] > EXTRAPOLATED).sum()),
    }
