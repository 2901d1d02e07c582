"""Robots: from messages to kinematics and back."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pinocchio as pin

from jointstiff.schemas import robot as robots
from jointstiff.schemas.fields import FAR_POINT
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.robot import Posture
from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError, RobotError
from jointstiff.solver.mechanics.chain import KinematicChain, chain_dh_rows
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Body, JointMap, Robot
from jointstiff.solver.mechanics.urdf import write_urdf
from jointstiff.solver.messages import build_messages, list_joint_kinds

if TYPE_CHECKING:  # geometry is no part of an identification
    from jointstiff.schemas.geometry import GeometryUnits


_LARGEST_OFFSET: Final = 4.0 * np.pi
"""Largest offset of a revolute joint in a joint map [rad]: two turns, which no map needs."""


def build_dh_chain(model: robots.DhModel, name: str) -> KinematicChain:
    """Build the kinematic chain of a DH table; `name` is that of the robot.

    Raises:
        RobotError: a row does not describe a joint.
    """
    return chain_dh_rows(model.rows, model.convention, name)


def build_chain_robot(
    chain: KinematicChain,
    joint_map: robots.JointMap | None,
    bodies: Sequence[robots.Body] = (),
    payload: float | None = None,
) -> Robot:
    """Build the robot of a checked chain, with the masses of bodies added to the joints that carry them.

    `payload` is the largest payload by the maker [kg]; None if unknown.

    Raises:
        RobotError: the joint map does not fit, or a body belongs to no joint.
    """
    solver_map = None
    if joint_map is not None:
        solver_map = JointMap.from_rows(joint_map.matrix, joint_map.offset)
        _refuse_large_offsets(joint_map, chain)
    solver_bodies = [_build_body(body, chain, f"bodies[{i}].joint") for i, body in enumerate(bodies)]
    model = chain.model()
    for each in solver_bodies:
        inertia = pin.Inertia(each.mass, np.array(each.centre), np.zeros((3, 3)))
        model.appendBodyToJoint(each.joint + 1, inertia, pin.SE3.Identity())
    robot = Robot(model, solver_map, tuple(solver_bodies), payload=payload)
    for index, each in enumerate(solver_bodies):
        _refuse_far_centre(each, f"bodies[{index}].centre", max(FAR_POINT, robot.reach_bound))
    return robot


def _refuse_far_centre(body: Body, where: str, farthest: float) -> None:
    """Raise a `RobotError` if a centre of mass is so far from its joint that it must be in mm.

    Args:
        body: body with its centre in m.
        where: field of the centre.
        farthest: greatest plausible distance of a centre from its joint [m].
    """
    distance = hypot(*body.centre)
    if distance > farthest:
        in_metres = ", ".join(f"{1e-3 * part:g}" for part in body.centre)
        raise RobotError(
            f"the centre of mass of '{body.name}' is {distance:.4g} m from its joint; up to {farthest:.3g} m "
            "is plausible, and the numbers seem to be in mm",
            where=where,
            remedy=f"give the centre in m, in the frame that moves with the joint: [{in_metres}]",
        )


def _refuse_large_offsets(joint_map: robots.JointMap, chain: KinematicChain) -> None:
    """Raise a `RobotError` if the offset of a revolute joint is so large that it must be in degrees."""
    kinds = [joint.kind for joint in chain.joints if joint.is_moving]
    for index, (kind, offset) in enumerate(zip(kinds, joint_map.offset, strict=False)):
        if kind == "revolute" and abs(offset) > _LARGEST_OFFSET:
            raise RobotError(
                f"the offset of joint {index + 1} is {offset:g} rad, but this number seems to be in degrees",
                where=f"joint_map.offset[{index}]",
                remedy="give offsets in rad, within two turns: whole turns change nothing",
            )


def _build_body(body: robots.Body, chain: KinematicChain, where: str) -> Body:
    """Return a body with its joint as an index, and its mass and centre with their uncertainties.

    Raises:
        RobotError: the chain has no joint of this name; `where` is the field of the name.
    """
    if body.joint not in chain.joint_names:
        raise RobotError(
            f"the robot has no joint '{body.joint}'",
            where=where,
            remedy=f"use one of {', '.join(chain.joint_names)}",
        )
    return Body.within(
        body.name,
        chain.joint_names.index(body.joint),
        body.mass,
        body.centre,
        relative=body.mass_uncertainty,
        radius=body.centre_uncertainty,
    )


def to_bodies(bodies: Sequence[Body], chain: KinematicChain) -> list[robots.Body] | None:
    """Return the bodies of a URDF as messages, each with the name of its joint; None without bodies."""
    return [
        robots.Body(name=body.name, joint=chain.joint_names[body.joint], mass=body.mass, centre=body.centre)
        for body in bodies
    ] or None


def describe_joints(robot: Robot) -> list[robots.Joint]:
    """Return the moving joints with their limits."""
    lower, upper = robot.limits.T
    return build_messages(
        robots.Joint,
        name=robot.joint_names,
        kind=robot.joint_kinds,
        lower=lower,
        upper=upper,
        speed=robot.speeds,
    )


def to_postures(robot: Robot, joints: list[list[float]]) -> list[Posture]:
    """Return the origins and axes of joints and flange in each configuration.

    `joints` has the controller positions [rad, m] of each configuration; if it is empty, all joints are at 0.

    Raises:
        RequestError: a configuration does not have as many angles as the robot has joints.
    """
    for number, angles in enumerate(joints):
        refuse_wrong_joint_count(robot, angles, f"joints[{number}]")
    controller = np.array(joints or [[0.0] * robot.n], dtype=np.float64)
    q = robot.joint_map.model_angles(controller)
    postures = Postures(robot, q)
    frames, origins = postures.joint_frames
    return build_messages(
        Posture,
        joint_names=[list(robot.joint_names)] * len(q),
        joint_origins=origins,
        joint_axes=np.einsum("bjik,jk->bji", frames, robot.axes),
        joint_kinds=[robot.joint_kinds] * len(q),
        flange_origin=postures.flange_translation,
        flange_axes=postures.flange_rotation.transpose(0, 2, 1),
    )


def refuse_far_point(point: Sequence[float] | None, where: str, *, length: float = 1.0) -> None:
    """Refuse a point on a tool that is too far from the flange, because its unit must be wrong.

    Args:
        point: coordinates in the flange frame; None is never refused.
        where: field of the point, for the message.
        length: unit of the coordinates in m.

    Raises:
        RequestError: the point is further than `FAR_POINT` from the flange.
    """
    distance = 0.0 if point is None else length * hypot(*point)
    if distance > FAR_POINT:
        raise RequestError(
            f"the point is {distance:g} m from the flange, where no tool reaches; up to {FAR_POINT:g} m is "
            "plausible",
            where=where,
            remedy="check the unit of the point; for a longer tool, put the flange of the robot's model on "
            "the tool",
        )


def joint_factors(robot: Robot, units: Units | GeometryUnits) -> FloatArray:
    """Return factors (n,) from the units of the joints' positions to rad, or to m for prismatic joints."""
    return robot.select_by_kind(ANGLE[units.angle], LENGTH[units.length])


def refuse_wrong_joint_count(robot: Robot, angles: Sequence[float], where: str) -> None:
    """Refuse a posture whose number of angles is not the number of joints.

    Raises:
        RequestError: the posture has more or fewer angles than the robot has joints.
    """
    if len(angles) != robot.n:
        raise RequestError(
            f"there are {len(angles)} joint angles, but the robot has {robot.n} joints",
            where=where,
            remedy=f"give the {robot.n} controller angles of {list_joint_names(robot)}",
        )


def joint_kinds_by_name(robot: Robot) -> dict[str, JointKind]:
    """Return the kind of each joint by name; empty if all joints are revolute."""
    return list_joint_kinds(robot.joint_names, robot.joint_kinds)


def list_joint_names(robot: Robot) -> str:
    """Return the names of the joints in one text, prismatic joints marked with `(length)`."""
    joints = zip(robot.joint_names, robot.joint_kinds, strict=True)
    return ", ".join(f"{name} (length)" if kind == "prismatic" else name for name, kind in joints)


def convert_pinocchio_model(model: Any, flange: str | None) -> tuple[dict[str, Any], list[dict[str, Any]]]:  # noqa: ANN401
    """Convert a Pinocchio model; return the model of a robot document, and documents of bodies with masses.

    Args:
        model: model whose joints form one chain, with one degree of freedom each.
        flange: name of the frame that is the flange; default: the only tip behind the last joint.

    Raises:
        RobotError: the model branches, a joint is of another kind, or the flange is not behind all joints.
    """
    chain = Robot(model, flange=flange).chain
    bodies = [
        {
            "name": f"body of {model.names[i]}",
            "joint": model.names[i],
            "mass": model.inertias[i].mass,
            "centre": model.inertias[i].lever.tolist(),
        }
        for i in range(1, model.njoints)
        if model.inertias[i].mass > 0.0
    ]
    urdf = write_urdf(chain)
    return {"format": "urdf", "urdf": urdf, "base": chain.base, "flange": chain.flange}, bodies
