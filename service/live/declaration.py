"""Declaration of a live campaign: a goal in words, and equipment taken over from a campaign."""

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
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot

_DOWN: Final = -0.999
"""Part along z of R0 of a force's direction from which on it counts as a weight."""
SI: Final = Units(length="m", angle="rad", force="N")
"""Units of a campaign that begins with a robot."""


def read_goal(goal: str | Goal | Mapping[str, Any], force: Vector3 | None = None) -> Goal:
    """Return a goal as a message, read from words, from a document or from a message.

    Args:
        goal: words: `15 %` (of each stiffness), `6 um` (of the deflection) or `below 0.5 mm`; or a document,
            or a message, which is returned unchanged.
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
    """Sizes of a measurement set's units in SI units; a number in SI units is divided by the size."""

    length: float  # [m]
    force: float  # [N]
    joints: tuple[float, ...]  # size of the unit of each joint [rad or m]

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
    """Return the declaration of a live campaign for a goal; its `robot_id` is only the placeholder `robot`.

    Args:
        robot: robot to measure.
        campaign: earlier campaign; its loads, targets, noise and load point are used where `options` state
            none, and for a goal about deflections the box around its load points is the work area. Its
            readings are not used otherwise.
        goal: goal of the live campaign.
        options: fields of `LiveOptions` in SI units; `sigma` is the noise of the readings [m].
        weight: own weight with which the campaign was identified; None if it was measured with loads.

    Raises:
        MeasurementError: the campaign cannot be used.
        RequestError: the options are not complete.
    """
    stated = {name: value for name, value in options.items() if value is not None}
    header: dict[str, Any] = {"units": SI, "encoders": "motor"}
    if campaign is not None:
        kept = set(MeasurementSetHeader.model_fields) & campaign.model_fields_set
        header = {name: getattr(campaign, name) for name in kept}
        measurements = prepare_set(campaign, robot, "robot").measurements
        stated = _derive_live_options(robot.robot, measurements, goal, weight) | stated
    sigma = stated.get("sigma")
    noise: Noise | None = header.get("noise")
    if sigma is not None:
        unit = LENGTH[header["units"].length]
        own = {} if noise is None else noise.model_dump(exclude={"sigma", "instrument"}, exclude_unset=True)
        header["noise"] = {**own, "sigma": sigma / unit}
    if not isinstance(stated.get("load"), OwnWeight):
        stated.setdefault("load_point", (0.0, 0.0, 0.0))
        header.pop("load_point", None)  # the load point of the options is used
    header["name"] = f"measured live: {robot.document.name}"[:200]
    options_of_set = LiveOptions.model_validate({**stated, "goal": goal})
    post = OpenPost.model_validate({**header, "robot_id": "robot", "open": options_of_set})
    return complete_targets_and_load_point(post, options_of_set)


def complete_targets_and_load_point(post: OpenPost, options: LiveOptions) -> OpenPost:
    """Return the declaration of a live campaign with targets and load point in both of their places.

    Args:
        post: declaration, in units of its own; its `flange_targets` and `load_point` are copied to the
            options [m] if they have none.
        options: live options of the declaration; their load point [m] is copied to `post` if it has none.
    """
    length = LENGTH[post.units.length]
    missing = dict[str, Any]()
    if not options.targets:
        missing["targets"] = {
            name: (length * x, length * y, length * z) for name, (x, y, z) in post.flange_targets.items()
        }
    point = post.load_point
    if options.load_point is None and point is not None:
        missing["load_point"] = (length * point[0], length * point[1], length * point[2])
    elif options.load_point is not None and point is None:
        x, y, z = options.load_point
        point = (x / length, y / length, z / length)
    return post.model_copy(update={"load_point": point, "open": options.model_copy(update=missing)})


def _derive_live_options(
    robot: Robot, measurements: Measurements, goal: Goal, weight: OwnWeight | None
) -> dict[str, Any]:
    """Derive live options from an earlier campaign: load, targets, load point and work area.

    The load is a dead weight if all forces point down, and the own weight if all forces are zero. Targets
    nearer than 1 µm to each other are one target. Goals for joints need no work area.
    """
    m = measurements
    size = np.linalg.norm(measurements.force, axis=1)  # (N,) [N]
    places = targets_in_flange(robot, m)
    unique = np.sort(np.unique(np.round(places, 6), axis=0, return_index=True)[1])
    options: dict[str, Any] = {"targets": {m.targets[t]: tuple(places[t].tolist()) for t in unique}}
    strongest = float(size.max())
    if strongest == 0.0:
        return options | {"load": weight or OwnWeight()}
    down = bool((m.force[:, 2] <= _DOWN * size).all())
    load: PlannedLoad = AnyDirection(kind="any_direction", force=strongest)
    if down:
        load = DeadWeight(kind="dead_weight", force=strongest)
    options |= {"load": load, "load_point": tuple(m.load_point[int(np.argmax(size))].tolist())}
    if not isinstance(goal, JointsGoal):
        loaded = m.load_point[size > 0.0][:, None]
        loaded_postures = Postures(robot, robot.joint_map.model_angles(m.joints[size > 0.0]))
        load_places: FloatArray = loaded_postures.to_base(loaded)[:, 0]
        options["work_area"] = (
            tuple(load_places.min(axis=0).tolist()),
            tuple(load_places.max(axis=0).tolist()),
        )
    return options
