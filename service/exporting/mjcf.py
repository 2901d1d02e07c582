"""A run as an MJCF model: position actuators, whose kp is the stiffness, about the commanded angle."""

from __future__ import annotations

from typing import Final
from xml.etree import ElementTree

from jointstiff.service.exporting.model import PLACEHOLDERS, ExportedModel
from jointstiff.service.exporting.xml import Element, add, add_remarks, numbers, written
from jointstiff.solver.robot.chain import ChainJoint

_SPRINGS: Final = (
    "Each position actuator is the spring in series with a drive that holds its angle: kp is the stiffness, "
    "ctrl the commanded angle, and the joint's angle differs from it by torque over kp."
)
_HELD: Final = (
    "A joint without a stiffness has no actuator: an equality constraint, which is no spring of the robot, "
    "holds it at the angle that is the first number of polycoef."
)


def mjcf(model: ExportedModel) -> bytes:
    """Return a model of hinges and position actuators; the frame of the world is R0."""
    root = ElementTree.Element("mujoco", model=model.name)
    add_remarks(root, model, _SPRINGS, _HELD, PLACEHOLDERS)
    # Roll, pitch and yaw turn about fixed axes: capital letters. Bodies that move must have some mass.
    add(root, "compiler", angle="radian", eulerseq="XYZ", autolimits="true", boundmass="1", boundinertia="1")
    add(root, "option", gravity="0 0 0")
    body = add(add(root, "worldbody"), "body", name=model.chain.base)
    for joint in model.chain.joints:
        body = _body(body, joint)
    add(body, "site", name=model.chain.flange)
    actuators, constraints = add(root, "actuator"), add(root, "equality")
    for joint, _, stiffness in model.springs():
        if stiffness is None:
            name = f"{joint.name} held"
            add(constraints, "joint", name=name, joint1=joint.name, polycoef="0 0 0 0 0")
        else:
            add(actuators, "position", name=joint.name, joint=joint.name, kp=numbers([stiffness]))
    return written(root)


def _body(parent: Element, joint: ChainJoint) -> Element:
    place = {"pos": numbers(joint.translation), "euler": numbers(joint.roll_pitch_yaw)}
    body = add(parent, "body", name=joint.child, **place)
    if joint.is_moving:
        limits = {} if joint.limits is None else {"range": numbers(joint.limits)}
        add(body, "joint", name=joint.name, type="hinge", axis=numbers(joint.axis), **limits)
    return body
