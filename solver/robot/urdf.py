"""Read a URDF from a stranger into a `KinematicChain`, or say where it is wrong and how to mend it.

The way in: `xml_guard` bounds the document, this module checks its frame and its names,
`urdf_joint` the joints, and `urdf_tree` finds the way from the base to
the flange. What kinematics do not need (inertial, visual, collision, mesh, transmission, gazebo) is ignored
and never opened. Branches off the chain are cut away: they must be sound (names, types, finite
numbers, one tree), but their joints may be of any type.
"""

from __future__ import annotations

from collections.abc import Collection

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.chain import KinematicChain, check_name
from jointstiff.solver.robot.urdf_joint import UrdfJoint, chain_joint, read_joint
from jointstiff.solver.robot.urdf_tree import path_down
from jointstiff.solver.robot.xml_guard import XmlElement, parse_xml

__all__ = ["MAX_DOCUMENT_JOINTS", "read_urdf"]

MAX_DOCUMENT_JOINTS = 1_000
"""Most joints in a document, before the chain is cut out; a tree of them has one link more."""


def read_urdf(text: str, base: str, flange: str) -> KinematicChain:
    """Read the chain from the base link to the flange link.

    An axis is normalised if its norm is within `urdf_joint.AXIS_TOLERANCE` of 1. A `continuous`
    joint becomes a revolute joint without limits, as does one with limits of
    ±`chain.UNLIMITED_ANGLE` or beyond.

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
    links = _read_links(robot)
    joints = _read_joints(robot)
    path = path_down(links, [joint.edge for joint in joints.values()], base, flange)
    return KinematicChain(
        name=robot.attributes["name"],
        base=base,
        flange=flange,
        joints=tuple(chain_joint(joints[edge.name]) for edge in path),
    )


def _check_robot(robot: XmlElement) -> None:
    for element in robot.walk():
        _check_expanded(element)
    if robot.tag != "robot":
        raise RobotError(
            f"the root element is <{robot.tag[:40]}>, not <robot>",
            remedy="send a URDF document, not SDF or MJCF",
            where=f"line {robot.line}",
        )
    if nested := robot.named("robot"):
        raise RobotError(
            "a second <robot> within the first",
            remedy="send one robot in each document",
            where=f"line {nested[0].line}",
        )
    check_name(robot.attributes.get("name", ""), "<robot>")


def _check_expanded(element: XmlElement) -> None:
    """Refuse what xacro has yet to replace; the xmlns:xacro that it leaves behind is harmless."""
    in_names = any(name.startswith("xacro:") for name in (element.tag, *element.attributes))
    in_values = any("${" in text or "$(" in text for text in element.attributes.values())
    if in_names or in_values:
        raise RobotError(
            f"unexpanded xacro in <{element.tag[:40]}>",
            remedy="expand it first: xacro robot.urdf.xacro > robot.urdf",
            where=f"line {element.line}",
        )


def _read_links(robot: XmlElement) -> dict[str, XmlElement]:
    """Read all links, by name."""
    links: dict[str, XmlElement] = {}
    for element in _few(robot, "link", MAX_DOCUMENT_JOINTS + 1):
        name = _new_name(element, links)
        links[name] = element
    if not links:
        raise RobotError("the robot has no link", remedy="give it links and joints", where="<robot>")
    return links


def _read_joints(robot: XmlElement) -> dict[str, UrdfJoint]:
    """Read all joints, by name."""
    joints: dict[str, UrdfJoint] = {}
    for element in _few(robot, "joint", MAX_DOCUMENT_JOINTS):
        name = _new_name(element, joints)
        joints[name] = read_joint(element, name)
    return joints


def _few(robot: XmlElement, tag: str, most: int) -> list[XmlElement]:
    elements = robot.named(tag)
    if len(elements) > most:
        raise RobotError(
            f"the robot has {len(elements)} {tag}s",
            remedy=f"at most {most} are read: send only the arm",
            where="<robot>",
        )
    return elements


def _new_name(element: XmlElement, taken: Collection[str]) -> str:
    """Return the name of a link or joint, unless it is empty, unfit or taken."""
    name = element.attributes.get("name", "")
    check_name(name, f"<{element.tag}> on line {element.line}")
    if name in taken:
        raise RobotError(
            f"a second {element.tag} of this name, on line {element.line}",
            remedy=f"give each {element.tag} a name of its own",
            where=f"{element.tag} '{name}'",
        )
    return name
