"""A weight step from messages to SI units."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.schemas.gearbox import GearboxRequest, HungLoad, TwistReading
from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.gearboxes.step import EncoderReadings, Load, WeightStep
from jointstiff.solver.mechanics.robot import Robot

ASSUMED_MASS: Final = 0.01
"""Standard uncertainty of a mass that is not weighed, relative to the mass."""
ASSUMED_PLACE: Final = 0.01
"""Standard uncertainty of each coordinate of the load's place where nothing is stated [m]."""
_FARTHEST: Final = 100.0
"""Position of a joint [rad or m] beyond which it is no position of an arm."""
_SENSE: Final = {"+": 1, "-": -1, None: 0}


def to_weight_step(request: GearboxRequest, load: HungLoad, robot: Robot) -> WeightStep:
    """Return the weight step of a request with its load, in SI units.

    Raises:
        MeasurementError: a posture has another number of joints than the robot.
        RequestError: the robot has no joint of a name, or the joint slides.
    """
    angle, length = ANGLE[request.units.angle], LENGTH[request.units.length]
    per_controller_unit = np.where(robot.prismatic, length, angle)
    _refuse_impossible_joints(request, robot, per_controller_unit)
    joints = np.array([posture.joints for posture in request.observations])
    encoder_sigma = 0.0 if request.encoder_sigma is None else angle * request.encoder_sigma
    return WeightStep(
        robot=robot,
        labels=tuple(posture.label for posture in request.observations),
        joints=per_controller_unit * joints,
        readings=_read_encoders(request, robot, angle),
        load=_read_load(load, length),
        gravity=np.array(request.gravity, dtype=np.float64),
        encoder_sigma=encoder_sigma,
    )


def _refuse_impossible_joints(request: GearboxRequest, robot: Robot, per_controller_unit: FloatArray) -> None:
    """Raise a `MeasurementError` if a posture has the joints of another robot, or in other units.

    `per_controller_unit` (n,) has the size of the unit of each joint [rad or m].
    """
    for index, posture in enumerate(request.observations):
        if len(posture.joints) != robot.n:
            raise MeasurementError(
                f"there are {len(posture.joints)} joint angles, but the robot has {robot.n} joints",
                where=f"observations[{index}].joints",
                remedy="give the positions of all controller joints in every posture",
            )
        distances = np.abs(np.array(posture.joints) * per_controller_unit)
        if (distances > _FARTHEST).any():
            raise MeasurementError(
                f"a position of a joint is more than {_FARTHEST:.0f} rad or m from zero",
                where=f"observations[{index}].joints",
                remedy="check the units of the joints",
            )


def _read_encoders(request: GearboxRequest, robot: Robot, angle: float) -> EncoderReadings:
    """Return the readings of the encoders of all postures in radians; `angle` is the size of their unit.

    Raises:
        RequestError: the robot has no joint of a name, or the joint slides.
    """
    postures, joints = list[int](), list[int]()
    readings = list[TwistReading]()
    for i, posture in enumerate(request.observations):
        for k, reading in enumerate(posture.encoder_readings):
            postures.append(i)
            joints.append(find_joint(robot, reading.joint, f"observations[{i}].encoder_readings[{k}].joint"))
            readings.append(reading)
    motor = [(each.unloaded.motor, each.loaded.motor) for each in readings]
    link = [(each.unloaded.link, each.loaded.link) for each in readings]
    return EncoderReadings(
        posture=np.array(postures),
        joint=np.array(joints),
        approach=np.array([_SENSE[each.approach] for each in readings]),
        motor=angle * np.array(motor, dtype=np.float64),
        link=angle * np.array(link, dtype=np.float64),
    )


def _read_load(load: HungLoad, length: float) -> Load:
    """Return a load with the uncertainties that are stated or assumed, in SI units.

    `length` is the size of the unit of length of the request [m].
    """
    is_weighed = load.mass_uncertainty is not None
    mass_uncertainty = ASSUMED_MASS * load.mass if load.mass_uncertainty is None else load.mass_uncertainty
    place_uncertainty = ASSUMED_PLACE
    if load.point_uncertainty is not None:
        place_uncertainty = length * load.point_uncertainty
    return Load(
        mass=load.mass,
        mass_uncertainty=mass_uncertainty,
        point=length * np.array(load.point, dtype=np.float64),
        point_uncertainty=place_uncertainty,
        is_weighed=is_weighed,
    )


def find_joint(robot: Robot, name: str, where: str) -> int:
    """Return the index of a joint that turns and is not coupled, by its name or its number from the base.

    Raises:
        RequestError: the robot has no such joint, or the joint slides or is coupled.
    """
    is_number = name not in robot.joint_names and name.isdecimal() and 1 <= int(name) <= robot.n
    joint = int(name) - 1 if is_number else robot.joint_index(name, where)
    if robot.prismatic[joint]:
        raise RequestError(
            f"{name} slides: a twist is an angle", where=where, remedy="omit the readings of this joint"
        )
    if _is_coupled(robot.joint_map.matrix, joint):
        raise RequestError(
            f"the joint map couples {name} with other joints, so that the motor of {name} also carries the "
            "torques of other joints",
            where=where,
            remedy="omit the readings of this joint",
        )
    return joint


def _is_coupled(joint_map: FloatArray, joint: int) -> bool:
    """Return whether a joint map (n, n) from controller to model angles mixes a joint with other joints.

    An arm with a parallelogram has numbers off the diagonal in the joint's row or column.
    """
    others = np.arange(len(joint_map)) != joint
    return bool(joint_map[joint, others].any() or joint_map[others, joint].any())
