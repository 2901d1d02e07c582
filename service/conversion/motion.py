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
from jointstiff.solver.mechanics.robot import Body, Robot

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
    unit_of_joints = np.where(robot.prismatic, length, angle)  # (n,) in rad or m
    return si.MotionCampaign(
        robot=robot,
        logs=tuple(_read_logs(motion, robot, unit_of_joints)),
        links=tuple(_list_bodies(motion, robot)),
        payload=_carry(motion.payload, robot, length),
        springs=tuple(_read_spring(spring, robot, angle) for spring in motion.gas_springs),
        gravity=np.array(request.gravity, dtype=np.float64),
        periods=_read_gear_periods(motion, robot),
    )


def _read_logs(motion: Motion, robot: Robot, unit_of_joints: FloatArray) -> list[si.MotionLog]:
    """Return the logs in SI units; `unit_of_joints` (n,) is the unit of each joint in rad or m."""
    start = _read_start(motion, robot, unit_of_joints)
    return [
        _read_log(log, robot, unit_of_joints, start, f"motion.logs[{i}]") for i, log in enumerate(motion.logs)
    ]


def _read_gear_periods(motion: Motion, robot: Robot) -> dict[int, tuple[float, ...]]:
    """Return index of a joint → periods of the error of its gearbox per turn, for the joints that state them.

    Raises:
        RequestError: the robot has no joint of a name, or the joint slides.
    """
    periods_by_joint = dict[int, tuple[float, ...]]()
    for name, periods in motion.gear_periods.items():
        periods_by_joint[find_joint(robot, name, "motion.gear_periods")] = tuple(periods)
    return periods_by_joint


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


def _read_log(
    log: MotionLog, robot: Robot, unit_of_joints: FloatArray, start: FloatArray, where: str
) -> si.MotionLog:
    """Return a log of K samples in SI units.

    Args:
        log: angles of the motors of all joints, and of encoders behind the gearboxes of some joints.
        robot: robot with n joints.
        unit_of_joints: (n,) size of the unit of each joint [rad or m].
        start: (n,) joints [rad or m], as the controller shows them, where all angles of the log are zero.
        where: field of the request that has the log, for errors.

    Raises:
        MeasurementError: the angles of a motor are missing.
        RequestError: the robot has no joint of a name, or the joint slides.
    """
    _refuse_other_motors(log, robot, f"{where}.motor")
    motors = unit_of_joints * np.column_stack([log.motor[name] for name in robot.joint_names])  # (K, n)
    without_jumps = np.where(robot.prismatic, motors, np.unwrap(motors, axis=0))
    shown = without_jumps + start
    link = {}  # index of a joint → (K,) angles of the encoder behind its gearbox
    for name, samples in log.link.items():
        joint = find_joint(robot, name, f"{where}.link")
        shown_link = np.unwrap(unit_of_joints[joint] * np.array(samples)) + start[joint]
        link[joint] = _to_model_angles(robot, joint, shown_link)
    return si.MotionLog(log.label, log.period, robot.joint_map.model_angles(shown), link)


def _refuse_other_motors(log: MotionLog, robot: Robot, where: str) -> None:
    """Refuse a log whose motors are not those of all joints of the robot.

    Raises:
        MeasurementError: the angles of a motor are missing.
        RequestError: the robot has no joint of a name.
    """
    missing = [name for name in robot.joint_names if name not in log.motor]
    if missing:
        raise MeasurementError(
            f"the log '{log.label}' has no angles of the motors of {', '.join(missing)}",
            where=where,
            remedy="give the motors of all joints: each moves the masses; constant for a joint that rests",
        )
    for name in log.motor:
        robot.joint_index(name, where)


def _to_model_angles(robot: Robot, joint: int, shown: FloatArray) -> FloatArray:
    """Return the angles (K,) [rad] of a joint in the robot's model from those that the controller shows.

    The joint is not coupled with others: its map has one factor and one offset, q = factor · shown + offset.
    """
    factor, offset = robot.joint_map.matrix[joint, joint], robot.joint_map.offset[joint]
    return np.asarray(factor * shown + offset)


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
    return [_convert_body_of_robot(body) for body in robot.bodies]


def _convert_body_of_robot(body: Body) -> si.MovingBody:
    """Return a body of the robot, whose inertia about its centre is unknown, as a moving body.

    Its mass is within `body.mass` and `body.most` [kg].
    """
    return si.MovingBody(
        name=body.name,
        joint=body.joint,
        mass=body.mass,
        mass_tolerance=body.most / body.mass - 1.0,
        centre=np.array(body.centre),
        centre_tolerance=body.radius,
        inertia=np.zeros((3, 3)),
    )


def _read_body(body: MovingBody, robot: Robot, where: str) -> si.MovingBody:
    """Return a stated body; `where` is its field, for errors.

    Raises:
        RequestError: the robot has no such joint, or no body has such an inertia.
    """
    return si.MovingBody(
        name=body.name,
        joint=robot.joint_index(body.joint, f"{where}.joint"),
        mass=body.mass,
        mass_tolerance=body.mass_uncertainty,
        centre=np.array(body.centre),
        centre_tolerance=body.centre_uncertainty,
        inertia=_read_inertia(body, where),
    )


def _read_inertia(body: MovingBody, where: str) -> FloatArray:
    """Return the inertia (3, 3) of a stated body about its centre of mass [kg·m²].

    Of a body's three principal moments none is negative, and none is greater than the sum of the two others,
    because Ixx = ∫ (y² + z²) dm ≤ Iyy + Izz.

    Raises:
        RequestError: no body has such an inertia.
    """
    xx, xy, xz, yy, yz, zz = body.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    least, middle, greatest = np.linalg.eigvalsh(inertia)
    if least < 0.0 or greatest > (least + middle) * (1.0 + _ROUNDING):
        raise RequestError(
            f"no body has the inertia of '{body.name}': one principal moment is negative, or greater "
            "than the sum of the others",
            where=f"{where}.inertia",
            remedy="give Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the centre of mass, in kg·m²",
        )
    return inertia


_ROUNDING: Final = 0.01
"""Relative error of rounded principal moments."""


def _carry(load: CarriedLoad, robot: Robot, length: float) -> si.MovingBody:
    """Return the load as a body of the last joint; `length` is the request's unit of length in m."""
    in_flange = length * np.array(load.point, dtype=np.float64)
    centre_tolerance = ASSUMED_PLACE
    if load.point_uncertainty is not None:
        centre_tolerance = length * load.point_uncertainty
    return si.MovingBody(
        name=PAYLOAD,
        joint=robot.n - 1,
        mass=load.mass,
        mass_tolerance=load.mass_uncertainty,
        centre=np.asarray(robot.flange_placement.act(in_flange)),
        centre_tolerance=centre_tolerance,
        inertia=np.zeros((3, 3)),
    )


def _read_spring(spring: GasSpring, robot: Robot, angle: float) -> si.GasSpring:
    """Return a gas spring in SI units; `angle` is the request's unit of angles in rad.

    Raises:
        RequestError: the robot has no such joint, or the gas has no volume left at the greatest length.
    """
    joint = find_joint(robot, spring.joint, "motion.gas_springs.joint")
    _refuse_impossible_spring(spring)
    return si.GasSpring(
        joint=joint,
        radius_before=spring.radius_before,
        radius_behind=spring.radius_behind,
        angle=angle * spring.angle,
        area=spring.area,
        pressure=spring.pressure,
        volume=spring.volume,
        tolerance=spring.pressure_uncertainty,
    )


def _refuse_impossible_spring(spring: GasSpring) -> None:
    """Refuse a gas spring whose ends would meet, or whose piston would fill its cylinder.

    Both ends turn about the axis of a joint, at the radii r1 and r2. Their distance is |r1 − r2| to r1 + r2,
    so that the piston's stroke is 2 min(r1, r2).

    Raises:
        RequestError: names the field to be checked.
    """
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
