"""Declaration of a live campaign: a goal in words, and equipment copied from an earlier campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jointstiff.schemas.fields import Message, Vector3
from jointstiff.schemas.live import LiveOptions
from jointstiff.schemas.live import MeasurementSetPost as OpenPost
from jointstiff.schemas.measurement import MeasurementSetDocument, MeasurementSetHeader, Noise, Units
from jointstiff.schemas.options import OwnWeight
from jointstiff.schemas.plan import (
    AnyDirection,
    DeadWeight,
    Goal,
    JointsGoal,
    PlannedLoad,
)
from jointstiff.service.conversion.prepared import PreparedRobot, prepare_set
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, parse_goal_text
from jointstiff.solver.arrays import BoolArray
from jointstiff.solver.mechanics.block import targets_in_flange
from jointstiff.solver.mechanics.measurements import ASSUMED_LIVE_DRIFT, Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot

_DOWN: Final = -0.999
"""Greatest z component (R0) of the direction of a force that counts as a weight: it points down."""
SI: Final = Units(length="m", angle="rad", force="N")
"""Units of a campaign that begins with a robot."""


def read_goal(goal: str | Goal | Mapping[str, Any], force: Vector3 | None = None) -> Goal:
    """Return a goal as a message, read from words, from a document or from a message.

    Args:
        goal: the goal as a text, as a document (mapping) or as a message; a message is returned unchanged.
            Texts: `15 %` (uncertainty of each stiffness), `6 um` (uncertainty of the deflection),
            `below 0.5 mm` (limit of the deflection).
        force: force for which the deflection is predicted, axes of R0 [N]; None for the force of the load.

    Raises:
        RequestError: the words state no known goal.
    """
    if isinstance(goal, Message):
        return goal
    document = dict(goal) if isinstance(goal, Mapping) else parse_goal_text(str(goal))
    if force is not None and document.get("kind") != "joints":
        document.setdefault("force", force)
    return LiveOptions.model_validate({"goal": document}).goal


@dataclass(frozen=True)
class Scales:
    """Sizes of a measurement set's units, in SI units.

    A number in SI units divided by the size of a unit is the number in that unit.
    """

    length: float  # size of the unit of length [m]
    force: float  # size of the unit of force [N]
    joints: tuple[float, ...]  # size of the unit of each joint's values [rad or m]

    @classmethod
    def from_units(cls, units: Units, robot: Robot) -> Scales:
        """Return the sizes of units for a robot; its prismatic joints have the unit of length."""
        length, angle = LENGTH[units.length], ANGLE[units.angle]
        return cls(length, FORCE[units.force], tuple(np.where(robot.prismatic, length, angle).tolist()))


def declare_set(
    robot: PreparedRobot,
    campaign: MeasurementSetDocument | None,
    goal: Goal,
    options: Mapping[str, Any],
    weight: OwnWeight | None = None,
) -> OpenPost:
    """Return the declaration of a live campaign for a goal; its `robot_id` is the placeholder "robot".

    Args:
        robot: robot to measure.
        campaign: earlier campaign, or None. Its loads, targets, noise and load point are used where
            `options` state none; for a goal about deflections the box around its load points is the work
            area. Its measured positions are not used.
        goal: goal of the live campaign.
        options: fields of `LiveOptions` in SI units; `sigma` is the noise of the readings [m].
        weight: own weight with which the campaign was identified; None if it was measured with loads.

    Raises:
        MeasurementError: the campaign cannot be used.
        RequestError: the options are not complete.
    """
    option_fields = {name: value for name, value in options.items() if value is not None}
    header: dict[str, Any] = {"units": SI, "encoders": "motor"}
    if campaign is not None:
        header_names = set(MeasurementSetHeader.model_fields) & campaign.model_fields_set
        header = {name: getattr(campaign, name) for name in header_names}
        measurements = prepare_set(campaign, robot, "robot").measurements
        option_fields = _derive_live_options(robot.robot, measurements, goal, weight) | option_fields
    sigma = option_fields.get("sigma")
    if sigma is not None:
        header["noise"] = _replace_sigma(header.get("noise"), sigma / LENGTH[header["units"].length])
    if not isinstance(option_fields.get("load"), OwnWeight):
        option_fields.setdefault("load_point", (0.0, 0.0, 0.0))
        header.pop("load_point", None)  # the load point of the options replaces that of the campaign
    header["name"] = f"measured live: {robot.document.name}"[:200]
    live_options = LiveOptions.model_validate({**option_fields, "goal": goal})
    post = OpenPost.model_validate({**header, "robot_id": "robot", "open": live_options})
    return complete_declaration(post, live_options)


def _replace_sigma(noise: Noise | None, sigma: float) -> dict[str, Any]:
    """Return the fields of a noise with another sigma, in the same unit of length.

    The sigma also replaces the instrument, from whose data sheet sigma would follow; other fields remain.
    """
    if noise is None:
        return {"sigma": sigma}
    return {**noise.model_dump(exclude={"sigma", "instrument"}, exclude_unset=True), "sigma": sigma}


def complete_declaration(post: OpenPost, options: LiveOptions) -> OpenPost:
    """Return the declaration of a live campaign, with missing targets, load points and drift filled in.

    Args:
        post: declaration. Its `flange_targets` and `load_point`, in its own unit of length, are copied to
            `options` [m] where the options state none.
        options: live options of the declaration. Their load point [m] is copied to `post` if `post` has
            none.
    """
    length = LENGTH[post.units.length]
    point, noise = post.load_point, post.noise
    added_options = dict[str, Any]()
    if not options.targets:
        places = {name: _scale(place, length) for name, place in post.flange_targets.items()}
        added_options["targets"] = places
    if options.load_point is None and point is not None:
        added_options["load_point"] = _scale(point, length)
    elif options.load_point is not None and point is None:
        x, y, z = options.load_point
        point = (x / length, y / length, z / length)
    if not isinstance(options.load, OwnWeight):
        noise = _state_drift(noise, length)
    completed_options = options.model_copy(update=added_options)
    return post.model_copy(update={"load_point": point, "noise": noise, "open": completed_options})


def _scale(place: Vector3, factor: float) -> Vector3:
    """Return a place with its coordinates multiplied by a factor."""
    x, y, z = place
    return factor * x, factor * y, factor * z


def _state_drift(noise: Noise | None, length: float) -> Noise:
    """Return a noise with the usual drift of a live campaign, if it states none; `length` is its unit [m].

    The readings of a live campaign come in the order of time, so that a drift moves each a little more.
    """
    if noise is not None and noise.drift is not None:
        return noise
    drift = ASSUMED_LIVE_DRIFT / length
    return Noise(drift=drift) if noise is None else noise.model_copy(update={"drift": drift})


def _derive_live_options(
    robot: Robot, measurements: Measurements, goal: Goal, weight: OwnWeight | None
) -> dict[str, Any]:
    """Derive live options from an earlier campaign: targets, load, load point and work area.

    The load is a dead weight if all forces point down, and the own weight if all forces are zero. A
    `JointsGoal` needs no work area.
    """
    options: dict[str, Any] = {"targets": _find_distinct_targets(robot, measurements)}
    sizes = np.linalg.norm(measurements.force, axis=1)  # (N,) [N]
    greatest = float(sizes.max())
    if greatest == 0.0:
        return options | {"load": weight or OwnWeight()}
    points_down = bool((measurements.force[:, 2] <= _DOWN * sizes).all())
    load: PlannedLoad = AnyDirection(kind="any_direction", force=greatest)
    if points_down:
        load = DeadWeight(kind="dead_weight", force=greatest)
    options["load"] = load
    options["load_point"] = tuple(measurements.load_point[int(np.argmax(sizes))].tolist())
    if not isinstance(goal, JointsGoal):
        options["work_area"] = _find_box_of_loads(robot, measurements, sizes > 0.0)
    return options


def _find_distinct_targets(robot: Robot, measurements: Measurements) -> dict[str, Vector3]:
    """Return target → place in the flange frame [m]; of targets that agree to 1 µm, the first one."""
    places = targets_in_flange(robot, measurements)
    _, first = np.unique(np.round(places, 6), axis=0, return_index=True)
    return {measurements.targets[t]: tuple(places[t].tolist()) for t in np.sort(first)}


def _find_box_of_loads(
    robot: Robot, measurements: Measurements, is_loaded: BoolArray
) -> tuple[Vector3, Vector3]:
    """Return the corners with least and greatest coordinates of a box around all load points, in R0 [m].

    `is_loaded` (N,) marks the observations with a load.
    """
    postures = Postures(robot, robot.joint_map.model_angles(measurements.joints[is_loaded]))
    places = postures.to_base(measurements.load_point[is_loaded][:, None])[:, 0]
    return tuple(places.min(axis=0).tolist()), tuple(places.max(axis=0).tolist())
