"""Read a URDF from a stranger into a `KinematicChain`, and write a chain as a URDF.

A document is refused with the place of the fault and its remedy. What kinematics do not need
(inertial, visual, collision, mesh, transmission, gazebo) is ignored and never opened. Branches off the
chain are cut away: they must be sound (names, types, finite numbers, one tree), but their joints may
be of any type.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.chain import UNLIMITED_ANGLE, ChainJoint, KinematicChain, check_name
from jointstiff.solver.robot.urdf_tree import Edge, path_down
from jointstiff.solver.robot.xml import XmlElement, parse_xml, quoted, read_numbers

MAX_DOCUMENT_JOINTS = 1_000
"""Maximum number of joints in a document, before the chain is extracted; a tree has one link more."""

AXIS_TOLERANCE = 1e-3
"""Largest deviation from 1 of the norm of an <axis>; within it, the axis is normalised."""

_TYPES = ("revolute", "continuous", "fixed", "prismatic", "floating", "planar")
_ORIGIN = {"xyz": 100.0, "rpy": 1e3}  # largest magnitudes [m], [rad]
_AXIS = {"xyz": 1e6}  # its norm is judged on the chain only: exporters leave odd axes on fixed joints
_LARGEST_LIMIT = 1e300  # some documents write ±1e16 for no limit
_ZERO = (0.0, 0.0, 0.0)
_DEFAULT_AXIS = (1.0, 0.0, 0.0)  # of the URDF standard


@dataclass(frozen=True)
class _Joint:
    """A joint as the document has it, its numbers read but not yet judged."""

    edge: Edge
    kind: str
    xyz: tuple[float, ...]  # origin of the joint's frame in the parent link's frame [m]
    rpy: tuple[float, ...]  # about the parent link's fixed axes [rad]
    axis: tuple[float, ...]  # in the joint's frame
    limit: dict[str, float]  # numbers of <limit> by name [rad]
    mimics: bool

    @property
    def place(self) -> str:
        return f"joint '{self.edge.joint}'"


def read_urdf(text: str, base: str, flange: str) -> KinematicChain:
    """Read the chain from the base link to the flange link.

    An axis is normalised if its norm is within `AXIS_TOLERANCE` of 1. A `continuous` joint becomes a
    revolute joint without limits, as does one with limits of ±`chain.UNLIMITED_ANGLE` or beyond.

    Args:
        text: the document, xacro expanded.
        base: link whose frame is R0; what is above it is cut away.
        flange: link whose frame is the flange frame; what is below it is cut away.

    Returns:
        The chain, with 1 to `chain.MAX_MOVING_JOINTS` moving joints.

    Raises:
        RobotError: the document is not a robot that can be used, with the place and the remedy.
    """
    robot = parse_xml(text)
    _check_robot(robot)
    links = _named(robot, "link", MAX_DOCUMENT_JOINTS + 1)
    if not links:
        raise RobotError("the robot has no link", remedy="add links and joints", where="<robot>")
    elements = _named(robot, "joint", MAX_DOCUMENT_JOINTS)
    joints = {name: _read_joint(element, name) for name, element in elements.items()}
    path = path_down(links, [joint.edge for joint in joints.values()], base, flange)
    chain = tuple(_chain_joint(joints[name]) for name in path)
    return KinematicChain(name=robot.attributes["name"], base=base, flange=flange, joints=chain)


def write_urdf(chain: KinematicChain) -> str:
    """Write a chain as a URDF that `read_urdf` reads back.

    Links come without inertia, visual or mesh. Numbers keep every digit, except that a rotation
    becomes roll, pitch and yaw (to a few units in the last place). A joint without limits becomes
    `revolute` with limits ±`UNLIMITED_ANGLE`, so that each joint has exactly one coordinate.
    """
    robot = ElementTree.Element("robot", name=chain.name)
    links = (chain.base, *(joint.child for joint in chain.joints))
    for link in links:
        ElementTree.SubElement(robot, "link", name=link)
    for joint, parent in zip(chain.joints, links[:-1], strict=True):
        element = ElementTree.SubElement(robot, "joint", name=joint.name, type=joint.kind)
        ElementTree.SubElement(element, "parent", link=parent)
        ElementTree.SubElement(element, "child", link=joint.child)
        xyz, rpy = _numbers(joint.translation), _numbers(joint.roll_pitch_yaw)
        ElementTree.SubElement(element, "origin", xyz=xyz, rpy=rpy)
        if joint.is_moving:
            lower, upper = joint.limits or (-UNLIMITED_ANGLE, UNLIMITED_ANGLE)
            ElementTree.SubElement(element, "axis", xyz=_numbers(joint.axis))
            bounds = {"lower": _numbers([lower]), "upper": _numbers([upper])}
            ElementTree.SubElement(element, "limit", bounds, effort="0", velocity="0")
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode")


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _check_robot(robot: XmlElement) -> None:
    for element in robot.walk():
        # Refuse xacro that is not expanded; the xmlns:xacro that it leaves behind is harmless
        in_names = any(name.startswith("xacro:") for name in (element.tag, *element.attributes))
        in_values = any("${" in text or "$(" in text for text in element.attributes.values())
        if in_names or in_values:
            raise RobotError(
                f"unexpanded xacro in <{element.tag[:40]}>",
                remedy="expand it first: xacro robot.urdf.xacro > robot.urdf",
                where=f"line {element.line}",
            )
    if robot.tag != "robot":
        raise RobotError(
            f"the root element is <{robot.tag[:40]}>, not <robot>",
            remedy="send a URDF document, not SDF or MJCF",
            where=f"line {robot.line}",
        )
    if nested := robot.named("robot"):
        raise RobotError(
            "there is a second <robot> within the first",
            remedy="send one robot per document",
            where=f"line {nested[0].line}",
        )
    check_name(robot.attributes.get("name", ""), "<robot>")


def _named(robot: XmlElement, tag: str, most: int) -> dict[str, XmlElement]:
    """Return all links or joints by name, unless they are many or a name is empty, unfit or taken."""
    elements = robot.named(tag)
    if len(elements) > most:
        remedy = f"at most {most} are supported: send only the arm"
        raise RobotError(f"the robot has {len(elements)} {tag}s", remedy=remedy, where="<robot>")
    named: dict[str, XmlElement] = {}
    for element in elements:
        name = element.attributes.get("name", "")
        check_name(name, f"<{tag}> on line {element.line}")
        if name in named:
            raise RobotError(
                f"there is a second {tag} of this name, on line {element.line}",
                remedy=f"give each {tag} a unique name",
                where=f"{tag} '{name}'",
            )
        named[name] = element
    return named


def _read_joint(element: XmlElement, name: str) -> _Joint:
    """Read a joint of any of the six types, on the chain or off it."""
    place = f"joint '{name}'"
    kind = element.attributes.get("type", "")
    if kind not in _TYPES:
        remedy = f"use one of {', '.join(_TYPES)}"
        raise RobotError(f"unknown joint type {quoted(kind)}", remedy=remedy, where=place)
    origin = _triples(element, "origin", _ORIGIN, place)
    axis = _triples(element, "axis", _AXIS, place)
    if not axis and element.named("axis"):
        raise RobotError(
            "the <axis> has no attribute xyz", remedy="add the attribute xyz", where=f"{place} <axis>"
        )
    limit = element.only("limit", place)
    limits: dict[str, float] = {
        key: read_numbers(limit.attributes[key], 1, _LARGEST_LIMIT, f"{place} <limit> {key}")[0]
        for key in ("lower", "upper", "effort", "velocity")
        if limit is not None and key in limit.attributes
    }
    return _Joint(
        edge=Edge(name, _link(element, "parent", place), _link(element, "child", place)),
        kind=kind,
        xyz=origin.get("xyz", _ZERO),
        rpy=origin.get("rpy", _ZERO),
        axis=axis.get("xyz", _DEFAULT_AXIS),
        limit=limits,
        mimics=bool(element.named("mimic")),
    )


def _link(joint: XmlElement, role: str, place: str) -> str:
    element = joint.only(role, place)
    name = element.attributes.get("link", "") if element else ""
    check_name(name, f"{place} <{role}>")
    return name


def _triples(
    parent: XmlElement, tag: str, largest: Mapping[str, float], place: str
) -> dict[str, tuple[float, ...]]:
    """Read the attributes of a child, three numbers each; nothing if there is no such child."""
    element = parent.only(tag, place)
    if element is None:
        return {}
    if unknown := element.attributes.keys() - largest.keys():
        remedy = f"use only {' and '.join(largest)}"
        raise RobotError(f"unknown attribute {quoted(min(unknown))}", remedy=remedy, where=f"{place} <{tag}>")
    return {
        name: read_numbers(text, 3, largest[name], f"{place} <{tag}> {name}")
        for name, text in element.attributes.items()
    }


def _chain_joint(joint: _Joint) -> ChainJoint:
    """Turn a joint between base and flange into one that the solver can move."""
    if joint.mimics:
        raise RobotError(
            "there is a mimic joint between base and flange",
            remedy="remove <mimic>, and describe the coupling in `joint_map`",
            where=f"{joint.place} <mimic>",
        )
    if joint.kind not in ("revolute", "continuous", "fixed"):
        raise RobotError(
            f"there is a {joint.kind} joint between base and flange",
            remedy="only revolute, continuous and fixed joints are supported there: fix it at its position, "
            "or choose another base or flange",
            where=joint.place,
        )
    moves = joint.kind != "fixed"
    return ChainJoint(
        name=joint.edge.joint,
        kind="revolute" if moves else "fixed",
        rotation=pin.rpy.rpyToMatrix(*joint.rpy),
        translation=np.array(joint.xyz),
        axis=_unit_axis(joint) if moves else np.array(_DEFAULT_AXIS),
        limits=_limits(joint) if joint.kind == "revolute" else None,
        child=joint.edge.child,
    )


def _unit_axis(joint: _Joint) -> FloatArray:
    axis = np.array(joint.axis)
    norm = float(np.linalg.norm(axis))
    if abs(norm - 1.0) > AXIS_TOLERANCE:
        raise RobotError(
            f"the axis has norm {norm:.6g}, not 1" if axis.any() else "the axis is zero",
            remedy="give a unit vector, such as 0 0 1",
            where=f"{joint.place} <axis>",
        )
    unit: FloatArray = axis / norm
    return unit


def _limits(joint: _Joint) -> tuple[float, float] | None:
    if not joint.limit.keys() & {"lower", "upper"}:
        raise RobotError(
            "a revolute joint needs <limit> with lower and upper",
            remedy="give the limits in rad, or make the joint continuous",
            where=f"{joint.place} <limit>",
        )
    lower, upper = joint.limit.get("lower", 0.0), joint.limit.get("upper", 0.0)
    if lower > upper:
        raise RobotError(
            f"the lower limit {lower:g} is above the upper limit {upper:g}",
            remedy="exchange the limits, or correct a sign; an absent limit counts as 0",
            where=f"{joint.place} <limit>",
        )
    unlimited = lower <= -UNLIMITED_ANGLE and upper >= UNLIMITED_ANGLE
    return None if unlimited else (lower, upper)
