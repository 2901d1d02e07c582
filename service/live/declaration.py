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
from jointstiff.solver.arrays import FloatArray
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
    document = dict(goal) if isinstance(goal, Mapping) else parse_goal_text(goal)
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
    noise: Noise | None = header.get("noise")
    if sigma is not None:
        # The stated sigma replaces sigma and instrument of the earlier campaign; its other noise remains.
        unit = LENGTH[header["units"].length]
        other_noise = (
            {} if noise is None else noise.model_dump(exclude={"sigma", "instrument"}, exclude_unset=True)
        )
        header["noise"] = {**other_noise, "sigma": sigma / unit}
    if not isinstance(option_fields.get("load"), OwnWeight):
        option_fields.setdefault("load_point", (0.0, 0.0, 0.0))
        header.pop("load_point", None)  # the load point of the options replaces that of the campaign
    header["name"] = f"measured live: {robot.document.name}"[:200]
    live_options = LiveOptions.model_validate({**option_fields, "goal": goal})
    post = OpenPost.model_validate({**header, "robot_id": "robot", "open": live_options})
    return complete_declaration(post, live_options)


def complete_declaration(post: OpenPost, options: LiveOptions) -> OpenPost:
    """Return the declaration of a live campaign, with missing targets, load points and drift filled in.

    The readings of a live campaign come in the order of time: a drift is assumed if none is stated.

    Args:
        post: declaration. Its `flange_targets` and `load_point`, in its own unit of length, are copied to
            `options` [m] where the options state none.
        options: live options of the declaration. Their load point [m] is copied to `post` if `post` has
            none.
    """
    length = LENGTH[post.units.length]
    added_options = dict[str, Any]()
    if not options.targets:
        added_options["targets"] = {
            name: (length * x, length * y, length * z) for name, (x, y, z) in post.flange_targets.items()
        }
    point = post.load_point
    if options.load_point is None and point is not None:
        added_options["load_point"] = (length * point[0], length * point[1], length * point[2])
    elif options.load_point is not None and point is None:
        x, y, z = options.load_point
        point = (x / length, y / length, z / length)
    noise = post.noise
    if not isinstance(options.load, OwnWeight) and (noise is None or noise.drift is None):
        drift = ASSUMED_LIVE_DRIFT / length
        noise = Noise(drift=drift) if noise is None else noise.model_copy(update={"drift": drift})
    completed_options = options.model_copy(update=added_options)
    return post.model_copy(update={"load_point": point, "noise": noise, "open": completed_options})


def _derive_live_options(
    robot: Robot, measurements: Measurements, goal: Goal, weight: OwnWeight | None
) -> dict[str, Any]:
    """Derive live options from an earlier campaign: targets, load, load point and work area.

    The load is a dead weight if all forces point down, and the own weight if all forces are zero. Targets
    whose positions agree to 1 µm become one target. A `JointsGoal` needs no work area.
    """
    m = measurements
    force_size = np.linalg.norm(m.force, axis=1)  # (N,) [N]
    places = targets_in_flange(robot, m)
    # Indices of the targets at different positions
    distinct = np.sort(np.unique(np.round(places, 6), axis=0, return_index=True)[1])
    options: dict[str, Any] = {"targets": {m.targets[t]: tuple(places[t].tolist()) for t in distinct}}
    greatest_force = float(force_size.max())
    if greatest_force == 0.0:
        return options | {"load": weight or OwnWeight()}
    load: PlannedLoad = AnyDirection(kind="any_direction", force=greatest_force)
    if bool((m.force[:, 2] <= _DOWN * force_size).all()):
        load = DeadWeight(kind="dead_weight", force=greatest_force)
    options |= {"load": load, "load_point": tuple(m.load_point[int(np.argmax(force_size))].tolist())}
    if not isinstance(goal, JointsGoal):
        is_loaded = force_size > 0.0
        loaded_postures = Postures(robot, robot.joint_map.model_angles(m.joints[is_loaded]))
        load_places: FloatArray = loaded_postures.to_base(m.load_point[is_loaded][:, None])[:, 0]  # in R0 [m]
        options["work_area"] = (
            tuple(load_places.min(axis=0).tolist()),
            tuple(load_places.max(axis=0).tolist()),
        )
    return options
