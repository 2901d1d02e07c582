"""Logs of a motion from messages to SI units."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.schemas.gearbox import GearboxRequest
from jointstiff.schemas.motion import CarriedLoad, GasSpring, Motion, MotionLog, MovingBody
from jointstiff.service.conversion.gearbox import find_joint
from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.gearboxes import motion as si
from jointstiff.solver.mechanics.robot import Robot

ASSUMED_PLACE: Final = 0.01
"""Radius of the ball that contains the load's centre where nothing is stated [m]."""
_LEAST_LENGTH: Final = 1e-3
"""Least length of a gas spring [m]."""
PAYLOAD: Final = "payload"
"""Name of the load among the bodies."""


def to_motion_campaign(request: GearboxRequest, motion: Motion, robot: Robot) -> si.MotionCampaign:
    """Return the logs of a request, in SI units, with the bodies that the motors carry.

    Raises:
        MeasurementError: a log lacks the motor's angles of a joint, or `start` has another number of joints.
        RequestError: the robot has no joint of a name, the joint slides, or no masses are known.
    """
    angle, length = ANGLE[request.units.angle], LENGTH[request.units.length]
    units = np.where(robot.prismatic, length, angle)
    start = _read_start(motion, robot, units)
    logs = [
        _read_log(log, robot, units, start, f"motion.logs[{number}]")
        for number, log in enumerate(motion.logs)
    ]
    bodies = tuple(_list_bodies(motion, robot))
    payload = _carry(motion.payload, robot, length)
    springs = [_read_spring(spring, robot, angle) for spring in motion.gas_springs]
    periods_by_joint = dict[int, tuple[float, ...]]()
    for name, periods in motion.gear_periods.items():
        periods_by_joint[find_joint(robot, name, "motion.gear_periods")] = tuple(periods)
    return si.MotionCampaign(
        robot=robot,
        logs=tuple(logs),
        links=bodies,
        payload=payload,
        springs=tuple(springs),
        gravity=np.array(request.gravity, dtype=np.float64),
        periods=periods_by_joint,
    )


def _read_start(motion: Motion, robot: Robot, units: FloatArray) -> FloatArray:
    """Return the joints (n,) [rad or m], as the controller shows them, where all angles are zero.

    Raises:
        MeasurementError: there is another number of joints.
    """
    if motion.start is None:
        return np.zeros(robot.n)
    if len(motion.start) != robot.n:
        raise MeasurementError(
            f"there are {len(motion.start)} joints, but the robot has {robot.n}",
            where="motion.start",
            remedy="give the position of each joint of the controller",
        )
    return np.asarray(units * np.array(motion.start))


def _read_log(log: MotionLog, robot: Robot, units: FloatArray, start: FloatArray, where: str) -> si.MotionLog:
    """Return a log in SI units.

    Raises:
        MeasurementError: the angles of a motor are missing.
        RequestError: the robot has no joint of a name, or the joint slides.
    """
    missing = [name for name in robot.joint_names if name not in log.motor]
    if missing:
        raise MeasurementError(
            f"the log '{log.label}' has no angles of the motors of {', '.join(missing)}",
            where=f"{where}.motor",
            remedy="give the motors of all joints: each moves the masses; constant for a joint that rests",
        )
    for name in log.motor:
        robot.joint_index(name, f"{where}.motor")
    motors = units * np.column_stack([log.motor[name] for name in robot.joint_names])
    shown = np.where(robot.prismatic, motors, np.unwrap(motors, axis=0)) + start
    link = {}
    for name, samples in log.link.items():
        joint = find_joint(robot, name, f"{where}.link")
        own = np.unwrap(units[joint] * np.array(samples)) + start[joint]
        # The map of a joint that is not coupled has one factor and one offset.
        link[joint] = robot.joint_map.matrix[joint, joint] * own + robot.joint_map.offset[joint]
    return si.MotionLog(log.label, log.period, robot.joint_map.model_angles(shown), link)


def _list_bodies(motion: Motion, robot: Robot) -> list[si.MovingBody]:
    """Return the bodies of the arm, as stated or of the robot.

    Raises:
        RequestError: neither states bodies, or a body names no joint of the robot.
    """
    if motion.bodies is not None:
        return [_read_body(body, robot, f"motion.bodies[{i}]") for i, body in enumerate(motion.bodies)]
    if not robot.bodies:
        raise RequestError(
            "the masses of the arm are not known",
            where="motion.bodies",
            remedy="give `bodies` with mass and centre of each link, or a URDF with inertials",
        )
    return [
        si.MovingBody(
            body.name,
            body.joint,
            body.mass,
            body.most / body.mass - 1.0,
            np.array(body.centre),
            body.radius,
            np.zeros((3, 3)),
        )
        for body in robot.bodies
    ]


def _read_body(body: MovingBody, robot: Robot, where: str) -> si.MovingBody:
    """Return a stated body.

    Raises:
        RequestError: the robot has no such joint, or no body has such an inertia.
    """
    joint = robot.joint_index(body.joint, f"{where}.joint")
    xx, xy, xz, yy, yz, zz = body.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    principal = np.linalg.eigvalsh(inertia)
    if principal[0] < 0.0 or principal[2] > (principal[0] + principal[1]) * (1.0 + _ROUNDING):
        raise RequestError(
            f"no body has the inertia of '{body.name}': one principal moment is negative, or greater "
            "than the sum of the others",
            where=f"{where}.inertia",
            remedy="give Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the centre of mass, in kg·m²",
        )
    return si.MovingBody(
        body.name,
        joint,
        body.mass,
        body.mass_uncertainty,
        np.array(body.centre),
        body.centre_uncertainty,
        inertia,
    )


_ROUNDING: Final = 0.01
"""Relative error of rounded principal moments."""


def _carry(load: CarriedLoad, robot: Robot, length: float) -> si.MovingBody:
    """Return the load as a body of the last joint."""
    stated = load.point_uncertainty
    in_flange = length * np.array(load.point, dtype=np.float64)
    return si.MovingBody(
        PAYLOAD,
        robot.n - 1,
        load.mass,
        load.mass_uncertainty,
        np.asarray(robot.flange_placement.act(in_flange)),
        ASSUMED_PLACE if stated is None else length * stated,
        np.zeros((3, 3)),
    )


def _read_spring(spring: GasSpring, robot: Robot, angle: float) -> si.GasSpring:
    """Return a gas spring in SI units.

    Raises:
        RequestError: the robot has no such joint, or the gas has no volume left at the greatest length.
    """
    joint = find_joint(robot, spring.joint, "motion.gas_springs.joint")
    if abs(spring.radius_before - spring.radius_behind) < _LEAST_LENGTH:
        raise RequestError(
            f"both ends of the gas spring of {spring.joint} have the same distance from the axis, so the "
            "ends would meet",
            where="motion.gas_springs.radius_behind",
            remedy="check both radii [m]",
        )
    stroke = 2.0 * min(spring.radius_before, spring.radius_behind)
    if spring.area * stroke >= spring.volume:
        raise RequestError(
            f"the gas spring of {spring.joint} moves {1e3 * stroke:.0f} mm, so that its piston takes all of "
            "its volume",
            where="motion.gas_springs.volume",
            remedy="check radii [m], area [m²] and greatest volume [m³]",
        )
    return si.GasSpring(
        joint,
        spring.radius_before,
        spring.radius_behind,
        angle * spring.angle,
        spring.area,
        spring.pressure,
        spring.volume,
        spring.pressure_uncertainty,
    )
