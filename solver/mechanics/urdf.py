"""Read a URDF from an untrusted source into a `KinematicChain`, and write a chain as a URDF.

The XML parser is expat, in one pass. Each limit is checked as an element arrives, before anything is built
from the element. Document types, entities and processing instructions are refused, so that nothing is
expanded or fetched; text and comments are not kept.

A refusal names the place of the fault and a remedy. Elements that kinematics do not need (inertial, visual,
collision, mesh, transmission, gazebo) are ignored, and the files that they name are never opened. An element
of a link or joint on the chain that is none of the standard or of known programs is refused: it may be a
misspelt <origin>. Branches off the chain are cut away: their names, types and numbers must be valid, but
their joints may be of any type.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Final, Literal
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
import pinocchio as pin

from jointstiff.schemas.joints import JOINT_UNITS, JointKind
from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.chain import FASTEST, UNLIMITED, ChainJoint, KinematicChain, check_name
from jointstiff.solver.mechanics.robot import Body

MAX_BYTES: Final = 2 * 1024 * 1024
"""Largest document, in bytes of UTF-8; text and comments have no other limit."""
MAX_DEPTH: Final = 16
"""Maximum depth of elements; the root is at depth 1."""
MAX_ELEMENTS: Final = 20_000
"""Maximum number of elements in a document."""
MAX_ATTRIBUTES: Final = 64
"""Maximum number of attributes of one element."""
MAX_ATTRIBUTE_LENGTH: Final = 4_096
"""Maximum length of an attribute's value, or of the name of an element or attribute."""
MAX_DOCUMENT_JOINTS: Final = 1_000
"""Maximum number of joints in a document, before the chain is extracted; a tree has one link more."""
AXIS_TOLERANCE: Final = 1e-3
"""Largest deviation from 1 of the norm of an <axis>; within it, the axis is normalised."""

_UNFIT = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff]")
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_SPACE = re.compile(r"[ \t\r\n]+")
_TYPES = ("revolute", "continuous", "fixed", "prismatic", "floating", "planar")
_CHAIN_KINDS: Final[Mapping[str, JointKind | Literal["fixed"]]] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
}
_EXTENSIONS: Final = frozenset(
    (
        *(
            "gazebo",
            "transmission",
            "sensor",
            "plugin",
            "material",
            "contact",
            "physics",
            "property",
            "param",
        ),
        *("map", "verbose", "description", "self_collide", "self_collision_checking", "collision_checking"),
        *("hardwareInterface", "actuator", "motor", "controller", "command_interface", "state_interface"),
        *("implicitSpringDamper", "provideFeedback", "disableFixedJointLumping", "preserveFixedJoint"),
        *("joint_properties", "damping", "friction", "stiffness", "rotor_inertia", "gear_ratio", "gravity"),
        *("kinematic", "selfCollide", "turnGravityOff", "mu1", "mu2", "kp", "kd", "maxVel", "minDepth"),
        *("capsule", "sphere", "audio_source", "light", "camera", "surface", "dampingFactor"),
        *("springStiffness", "springReference", "stopCfm", "stopErp", "cfm_damping", "fudgeFactor", "fdir1"),
    )
)
"""Elements of Gazebo, ROS, Drake, PyBullet and older URDFs in links and joints, none of them kinematic."""
_KNOWN_ELEMENTS: Final = {
    "joint": _EXTENSIONS
    | {"origin", "parent", "child", "axis", "calibration", "dynamics", "limit", "mimic", "safety_controller"},
    "link": _EXTENSIONS | {"inertial", "visual", "collision"},
}
_SPELLED_ALIKE: Final = 0.7  # ratio of difflib from which an unknown name seems to be a misspelt one
_ORIGIN = {"xyz": 100.0, "rpy": 1e3}  # largest magnitudes [m], [rad]
# Largest magnitudes. The norm of an axis is checked on the chain only: exporters leave odd axes on fixed
# joints. An axis that is turned once more (rpy) is no URDF.
_AXIS = {"xyz": 1e6, "rpy": 1e-9}
_LARGEST_LIMIT = 1e300  # some documents write ±1e16 for no limit
_LARGEST_MASS = 1e6  # [kg]
_MANY_JOINTS = 3  # fewest revolute joints whose limits show that they are in degrees
_TWO_TURNS = 720.0  # [°]
_TEN_TURNS = 3600.0  # [°]
_STEP_OF_DEGREES = 5.0  # limits in degrees are multiples of it
_NO_RANGE = (0.0, 0.0)
_EIGHTH_TURN = np.pi / 4.0
_SAME_ANGLE = 1e-3  # largest difference of a rounded angle [rad]
_ZERO = (0.0, 0.0, 0.0)
_DEFAULT_AXIS = (1.0, 0.0, 0.0)  # of the URDF standard
_SHOWN = 8  # names listed in a message


def read_urdf(text: str, base: str, flange: str) -> KinematicChain:
    """Read the kinematic chain from the base link to the flange link of a URDF.

    An axis is normalised if its norm is within `AXIS_TOLERANCE` of 1. A `continuous` joint becomes a
    revolute joint without limits, as does a joint with limits of ±`UNLIMITED` or beyond. If the limits of all
    revolute joints are beyond two turns, they are taken as degrees.

    Args:
        text: the document, xacro expanded.
        base: link whose frame is R0; links above the base are cut away.
        flange: link whose frame is the flange frame; links below the flange are cut away.

    Returns:
        The chain, with 1 to `chain.MAX_MOVING_JOINTS` moving joints.

    Raises:
        RobotError: the document is no usable robot; the error names the place of the fault and the remedy.
    """
    robot = parse_xml(text)
    check_root(robot)
    links = _collect_named(robot, "link", MAX_DOCUMENT_JOINTS + 1)
    if not links:
        raise RobotError("the robot has no link", remedy="add links and joints", where="<robot>")
    elements = _collect_named(robot, "joint", MAX_DOCUMENT_JOINTS)
    joints = [UrdfJoint.read(element, name) for name, element in elements.items()]
    path = _find_path_down(links, joints, base, flange)
    for name in (base, *(joint.child for joint in path)):
        _refuse_unknown_elements(links[name], f"link '{name}'")
    for joint in path:
        _refuse_unknown_elements(elements[joint.name], f"joint '{joint.name}'")
    chain = tuple(joint.to_chain_joint() for joint in path)
    chain = _read_limits_in_degrees(chain)
    return KinematicChain(
        name=robot.attributes.get("name") or "robot", base=base, flange=flange, joints=chain
    )


def _read_limits_in_degrees(chain: tuple[ChainJoint, ...]) -> tuple[ChainJoint, ...]:
    """Return the joints with limits in rad if those of all revolute joints are in degrees.

    Limits are in degrees if each revolute joint has one beyond two turns in rad, none is beyond ten turns in
    degrees, and one joint is within two turns in degrees: no arm turns each of its joints by more than that.
    """
    limited = [joint for joint in chain if joint.kind == "revolute" and joint.limits]
    greatest = [max(map(abs, joint.limits or ())) for joint in limited]
    are_in_degrees = [4.0 * np.pi < each <= _TEN_TURNS for each in greatest]
    if len(limited) < _MANY_JOINTS or not all(are_in_degrees):
        _refuse_some_limits_in_degrees(limited)
        return chain
    if min(greatest) > _TWO_TURNS:  # no limits of a real arm; in rad they would be beyond two turns again
        return chain
    in_rad = {
        joint.name: (float(np.radians(joint.limits[0])), float(np.radians(joint.limits[1])))
        for joint in limited
        if joint.limits
    }
    return tuple(replace(joint, limits=in_rad.get(joint.name, joint.limits)) for joint in chain)


def _refuse_some_limits_in_degrees(limited: Sequence[ChainJoint]) -> None:
    """Refuse limits in degrees of some revolute joints if those of others are in rad.

    Limits beyond two turns of several joints, all in steps of 5° and none beyond two turns in degrees, are in
    degrees. One such joint may turn without end.

    Raises:
        RobotError: names the first joint whose limits seem to be in degrees.
    """
    suspects = list[ChainJoint]()
    for joint in limited:
        lower, upper = joint.limits or _NO_RANGE
        are_whole = lower % _STEP_OF_DEGREES == 0.0 and upper % _STEP_OF_DEGREES == 0.0
        if are_whole and 4.0 * np.pi < max(abs(lower), abs(upper)) <= _TWO_TURNS:
            suspects.append(joint)
    if not 2 <= len(suspects) < len(limited):
        return
    first = suspects[0]
    lower, upper = first.limits or _NO_RANGE
    names = ", ".join(joint.name for joint in suspects)
    raise RobotError(
        f"the limits of {names} are beyond two turns, here {lower:g} and {upper:g} rad, as if they were in "
        "degrees; a URDF is in radians, as the limits of the other joints are",
        remedy=f'write the limits of these joints in rad, here lower="{np.radians(lower):.10g}" '
        f'upper="{np.radians(upper):.10g}"; make a joint that turns without end continuous',
        where=f"joint '{first.name}' <limit>",
    )


def write_urdf(chain: KinematicChain) -> str:
    """Write a chain as a URDF that `read_urdf` reads back.

    Links come without inertia, visual or mesh. Numbers keep every digit, except that a rotation
    becomes roll, pitch and yaw (to a few units in the last place). A joint without limits gets limits of
    ±`UNLIMITED`, so that each joint has exactly one coordinate. A speed that is unknown is 0.
    """
    robot = ElementTree.Element("robot", name=chain.name)
    links = (chain.base, *(joint.child for joint in chain.joints))
    for link in links:
        ElementTree.SubElement(robot, "link", name=link)
    for joint, parent in zip(chain.joints, links[:-1], strict=True):
        element = ElementTree.SubElement(robot, "joint", name=joint.name, type=joint.kind)
        ElementTree.SubElement(element, "parent", link=parent)
        ElementTree.SubElement(element, "child", link=joint.child)
        xyz, rpy = _format_numbers(joint.translation), _format_numbers(joint.roll_pitch_yaw)
        ElementTree.SubElement(element, "origin", xyz=xyz, rpy=rpy)
        if joint.is_moving:
            lower, upper = joint.limits or (-UNLIMITED, UNLIMITED)
            ElementTree.SubElement(element, "axis", xyz=_format_numbers(joint.axis))
            bounds = {"lower": _format_numbers([lower]), "upper": _format_numbers([upper])}
            speed = "0" if joint.speed is None else _format_numbers([joint.speed])
            ElementTree.SubElement(element, "limit", bounds, effort="0", velocity=speed)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode")


def _format_numbers(values: Iterable[float]) -> str:
    """Return numbers as text with every digit, separated by spaces."""
    return " ".join(repr(float(value)) for value in values)


def read_inertials(text: str, chain: KinematicChain) -> tuple[Body, ...]:
    """Read masses and centres of mass of the links on a chain from its URDF.

    Links on other branches, or before the first moving joint, are omitted. If any <inertial> is not valid,
    the result is empty.

    Args:
        text: the URDF document.
        chain: the chain that `read_urdf` read from the document.
    """
    links = {link.attributes.get("name", ""): link for link in parse_xml(text).find_children("link")}
    bodies = []
    try:
        for frame in chain.model().frames:
            if frame.type != pin.FrameType.BODY or frame.parentJoint == 0:
                continue
            inertial = links[frame.name].find_only_child("inertial", frame.name)
            mass = None if inertial is None else inertial.find_only_child("mass", frame.name)
            if inertial is None or mass is None:
                continue
            origin = inertial.find_only_child("origin", frame.name)
            xyz = "0 0 0" if origin is None else origin.attributes.get("xyz", "0 0 0")
            (value,) = read_numbers(mass.attributes.get("value", ""), 1, _LARGEST_MASS, frame.name)
            centre = frame.placement * np.array(read_numbers(xyz, 3, _ORIGIN["xyz"], frame.name))
            if value < 0.0:
                return ()
            if value:  # a link of mass zero is no body
                bodies.append(Body.within(frame.name, frame.parentJoint - 1, value, tuple(centre.tolist())))
    except RobotError:
        return ()
    return tuple(bodies)


@dataclass(frozen=True)
class UrdfJoint:
    """Joint of a URDF document, with numbers that are read but not yet checked against the chain's rules."""

    name: str  #: name of the joint
    parent: str  #: link that carries the joint
    child: str  #: link that the joint carries
    kind: str  #: one of the six types of the URDF standard
    xyz: tuple[float, ...]  #: origin of the joint's frame in the parent link's frame [m]
    rpy: tuple[float, ...]  #: roll, pitch and yaw about the parent link's fixed axes [rad]
    axis: tuple[float, ...]  #: direction of the axis in the joint's frame
    limit: dict[str, float]  #: numbers of <limit> by attribute [rad, or m for a prismatic joint]
    mimics: bool  #: whether the joint follows another joint

    @classmethod
    def read(cls, element: XmlElement, name: str) -> UrdfJoint:
        """Read a joint of any of the six types, which need not be on the chain.

        Raises:
            RobotError: the type is unknown, a child element occurs twice, or a number or name is not valid.
        """
        place = f"joint '{name}'"
        kind = element.attributes.get("type", "")
        if kind not in _TYPES:
            remedy = f"use one of {', '.join(_TYPES)}"
            raise RobotError(f"unknown joint type {quote(kind)}", remedy=remedy, where=place)
        origin = _read_triples(element, "origin", _ORIGIN, place)
        axis = _read_triples(element, "axis", _AXIS, place)
        if not axis and element.find_children("axis"):
            remedy = "add the attribute xyz"
            raise RobotError("the <axis> has no attribute xyz", remedy=remedy, where=f"{place} <axis>")
        limit = element.find_only_child("limit", place)
        limits: dict[str, float] = {
            key: read_numbers(limit.attributes[key], 1, _LARGEST_LIMIT, f"{place} <limit> {key}")[0]
            for key in ("lower", "upper", "effort", "velocity")
            if limit is not None and key in limit.attributes
        }
        links = {}
        for role in ("parent", "child"):
            link = element.find_only_child(role, place)
            links[role] = link.attributes.get("link", "") if link else ""
            check_name(links[role], f"{place} <{role}>")
        return cls(
            name=name,
            parent=links["parent"],
            child=links["child"],
            kind=kind,
            xyz=origin.get("xyz", _ZERO),
            rpy=origin.get("rpy", _ZERO),
            axis=axis.get("xyz", _DEFAULT_AXIS),
            limit=limits,
            mimics=bool(element.find_children("mimic")),
        )

    def to_chain_joint(self) -> ChainJoint:
        """Return the joint as a joint of a kinematic chain, after checking kind, axis and limits.

        Raises:
            RobotError: the kind is not supported, the joint mimics another, or axis or limits are not valid.
        """
        place = f"joint '{self.name}'"
        if self.mimics:
            raise RobotError(
                "there is a mimic joint between base and flange",
                remedy="make this joint fixed, and describe the coupling of the others in `joint_map`",
                where=f"{place} <mimic>",
            )
        self._refuse_rotation_in_degrees(place)
        kind = _CHAIN_KINDS.get(self.kind)
        if kind is None:
            raise RobotError(
                f"there is a {self.kind} joint between base and flange",
                remedy="only revolute, continuous, prismatic and fixed joints are supported between base and "
                "flange: make this joint fixed at its position, or choose another base or flange",
                where=place,
            )
        if self.kind in JOINT_UNITS and not self.limit.keys() & {"lower", "upper"}:
            raise RobotError(
                f"a {self.kind} joint needs <limit> with lower and upper",
                remedy="give the limits in m"
                if self.kind == "prismatic"
                else "give the limits in rad, or make the joint continuous",
                where=f"{place} <limit>",
            )
        lower, upper = self.limit.get("lower", 0.0), self.limit.get("upper", 0.0)
        unlimited = lower <= -UNLIMITED and upper >= UNLIMITED
        axis = np.array(_DEFAULT_AXIS if kind == "fixed" else self.axis)
        norm = float(np.linalg.norm(axis))
        if abs(norm - 1.0) > AXIS_TOLERANCE:
            raise RobotError(
                f"the axis has norm {norm:.6g}, not 1" if axis.any() else "the axis is zero",
                remedy="give a unit vector, such as 0 0 1",
                where=f"{place} <axis>",
            )
        return ChainJoint(
            name=self.name,
            kind=kind,
            rotation=pin.rpy.rpyToMatrix(*self.rpy),
            translation=np.array(self.xyz),
            axis=axis / norm,
            limits=None if unlimited or self.kind not in JOINT_UNITS else (lower, upper),
            child=self.child,
            speed=self._speed,
        )

    def _refuse_rotation_in_degrees(self, place: str) -> None:
        """Refuse roll, pitch and yaw that are beyond a turn, but for multiples of 45° up to two turns.

        Raises:
            RobotError: an angle seems to be in degrees.
        """
        angles = np.abs(self.rpy)
        is_multiple = np.abs(angles - _EIGHTH_TURN * np.round(angles / _EIGHTH_TURN)) <= _SAME_ANGLE
        is_plausible = (angles <= 2.0 * np.pi + _SAME_ANGLE) | (
            is_multiple & (angles <= 4.0 * np.pi + _SAME_ANGLE)
        )
        if is_plausible.all():
            return
        given = " ".join(f"{angle:.10g}" for angle in self.rpy)
        in_rad = " ".join(f"{angle:.10g}" for angle in np.radians(self.rpy))
        raise RobotError(
            f"the angles {given} are beyond a turn, as if they were in degrees; a URDF is in radians",
            remedy=f'write these angles in rad: rpy="{in_rad}"',
            where=f"{place} <origin> rpy",
        )

    @property
    def _speed(self) -> float | None:
        """Greatest speed [rad/s or m/s]; None if the document states none, or one that no joint reaches."""
        speed = self.limit.get("velocity", 0.0)
        return speed if self.kind != "fixed" and 0.0 < speed < FASTEST else None


def check_root(robot: XmlElement) -> None:
    """Refuse a document whose root is not a single named <robot>, or that contains unexpanded xacro.

    Raises:
        RobotError: the document is refused; the error names the line.
    """
    for element in robot.walk():
        # Names and values of xacro are refused; the attribute xmlns:xacro of an expanded document is
        # harmless.
        in_names = any(name.startswith("xacro:") for name in (element.tag, *element.attributes))
        in_values = any("${" in text or "$(" in text for text in element.attributes.values())
        if in_names or in_values:
            raise RobotError(
                f"unexpanded xacro in <{element.tag[:40]}>",
                remedy="expand the document first: xacro robot.urdf.xacro > robot.urdf",
                where=f"line {element.line}",
            )
    if robot.tag != "robot":
        reason = f"the root element is <{robot.tag[:40]}>, not <robot>"
        remedy = "send a URDF document, not SDF or MJCF"
        raise RobotError(reason, remedy=remedy, where=f"line {robot.line}")
    if nested := robot.find_children("robot"):
        reason = "there is a second <robot> within the first"
        remedy = "send one robot per document"
        raise RobotError(reason, remedy=remedy, where=f"line {nested[0].line}")
    check_name(robot.attributes.get("name") or "robot", "<robot>")


def _collect_named(robot: XmlElement, tag: str, most: int) -> dict[str, XmlElement]:
    """Return all child elements of a robot with the tag `link` or `joint`, by name.

    Raises:
        RobotError: there are more than `most` elements, or a name is empty, invalid or used twice.
    """
    elements = robot.find_children(tag)
    if len(elements) > most:
        remedy = f"at most {most} are supported: send only the arm"
        raise RobotError(f"the robot has {len(elements)} {tag}s", remedy=remedy, where="<robot>")
    named: dict[str, XmlElement] = {}
    for element in elements:
        name = element.attributes.get("name", "")
        check_name(name, f"<{tag}> on line {element.line}")
        if name in named:
            reason = f"there is a second {tag} of this name, on line {element.line}"
            raise RobotError(reason, remedy=f"give each {tag} a unique name", where=f"{tag} '{name}'")
        named[name] = element
    return named


def _read_triples(
    parent: XmlElement, tag: str, largest: Mapping[str, float], place: str
) -> dict[str, tuple[float, ...]]:
    """Read the attributes of a child element, three numbers each; empty if there is no such child.

    Raises:
        RobotError: an attribute is not among those of `largest`, or a number is not valid or too large.
    """
    element = parent.find_only_child(tag, place)
    if element is None:
        return {}
    if unknown := element.attributes.keys() - largest.keys():
        remedy = f"use only {' and '.join(largest)}"
        raise RobotError(f"unknown attribute {quote(min(unknown))}", remedy=remedy, where=f"{place} <{tag}>")
    return {
        name: read_numbers(text, 3, largest[name], f"{place} <{tag}> {name}")
        for name, text in element.attributes.items()
    }


def _refuse_unknown_elements(element: XmlElement, place: str) -> None:
    """Refuse a link or joint with an element that is neither of the URDF standard nor of a known program.

    Elements with a prefix, such as <drake:gear_ratio>, are extensions of the program that owns the prefix.

    Raises:
        RobotError: an element is unknown; the error names it.
    """
    known = _KNOWN_ELEMENTS[element.tag]
    for child in element.children:
        if child.tag in known or ":" in child.tag:
            continue
        near = get_close_matches(child.tag, known - _EXTENSIONS, n=1, cutoff=_SPELLED_ALIKE)
        meant = f"write <{near[0]}> if this is meant, or " if near else ""
        raise RobotError(
            f"unknown element <{child.tag[:40]}>",
            remedy=f"{meant}remove the element",
            where=f"{place}, line {child.line}",
        )


def _find_path_down(
    links: Collection[str], joints: Iterable[UrdfJoint], base: str, flange: str
) -> list[UrdfJoint]:
    """Return the joints on the path from the base down to the flange, at least one.

    Args:
        links: names of all links, without repetition.
        joints: all joints, without repetition.
        base: link at which the path begins; it need not be the root.
        flange: link at which the path ends.

    Raises:
        RobotError: links and joints are not one tree, base or flange is not among them, or the
            flange is not below the base.
    """
    above = _map_joints_above(links, joints)
    for link, role in ((base, "base"), (flange, "flange")):
        refuse_unknown_link(links, link, role)
    if base == flange:
        raise RobotError(
            f"base and flange are the same link, '{base}'",
            remedy="choose a flange with moving joints between base and flange",
            where="flange",
        )
    path, link = [], flange
    while link != base:
        if link not in above:
            raise RobotError(
                f"the flange '{flange}' is not below the base '{base}'",
                remedy="choose a base on the way from the root to the flange",
                where="flange",
            )
        path.append(above[link])
        link = above[link].parent
    return path[::-1]


def _map_joints_above(links: Collection[str], joints: Iterable[UrdfJoint]) -> dict[str, UrdfJoint]:
    """Return the joint that carries each link; keys are names of links, without the root link.

    Raises:
        RobotError: links and joints are not one tree.
    """
    above: dict[str, UrdfJoint] = {}
    below = defaultdict(list)
    for joint in joints:
        for link, role in ((joint.parent, "parent"), (joint.child, "child")):
            if link not in links:
                remedy = f"use one of the links {_list_names(links)}"
                where = f"joint '{joint.name}' <{role}>"
                raise RobotError(f"there is no link '{link[:60]}'", remedy=remedy, where=where)
        if joint.child in above:
            raise RobotError(
                f"two joints have this link as child: '{above[joint.child].name}' and '{joint.name}'",
                remedy="a URDF is a tree: keep one of the two joints",
                where=f"link '{joint.child}'",
            )
        above[joint.child] = joint
        below[joint.parent].append(joint.child)
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        reason = f"{len(roots)} links have no parent: {_list_names(roots)}"
        raise RobotError(reason, remedy="join all links into one tree with one root", where="<robot>")
    # The list grows during the loop, until it holds the root and all links below.
    connected = roots[:]
    for link in connected:
        connected.extend(below[link])
    reached = set(connected)
    if cycle := [link for link in links if link not in reached]:
        raise RobotError(
            f"some links form a cycle that is not connected to the root: {_list_names(cycle)}",
            remedy="a URDF is a tree: give one of these links another parent",
            where=f"link '{cycle[0]}'",
        )
    return above


def refuse_unknown_link(links: Collection[str], link: str, role: str) -> None:
    """Refuse a link that is not among all links of a URDF; its `role` is base or flange.

    Raises:
        RobotError: there is no such link.
    """
    if link not in links:
        reason = f"there is no link {link[:60]!a} for the {role} frame"
        raise RobotError(reason, remedy=f"use one of the links {_list_names(links)}", where=role)


def _list_names(names: Collection[str]) -> str:
    """Return names as text for a message: the first few, and how many more there are."""
    shown = ", ".join(f"'{name[:40]}'" for name in list(names)[:_SHOWN])
    return shown + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")


@dataclass(frozen=True)
class XmlElement:
    """XML element with its attributes and children, but without text."""

    tag: str  #: name, including a prefix if there is one
    attributes: dict[str, str]  #: values of the attributes by name
    line: int  #: line of the document on which the element opens, from 1
    children: list[XmlElement] = field(default_factory=list)  #: elements directly within, in order

    def find_children(self, tag: str) -> list[XmlElement]:
        """Return the children with this tag, in order."""
        return [child for child in self.children if child.tag == tag]

    def find_only_child(self, tag: str, place: str) -> XmlElement | None:
        """Return the only child with this tag, or None.

        Raises:
            RobotError: there are several children with this tag; other programs silently use the first.
        """
        children = self.find_children(tag)
        if len(children) > 1:
            reason = f"<{tag}> is given {len(children)} times"
            raise RobotError(reason, remedy=f"keep one <{tag}>", where=f"{place} <{tag}>")
        return children[0] if children else None

    def walk(self) -> Iterator[XmlElement]:
        """Yield this element and all elements within, depth first; `MAX_DEPTH` makes recursion safe."""
        yield self
        for child in self.children:
            yield from child.walk()


def parse_xml(text: str) -> XmlElement:
    """Parse an XML document and return its root element.

    Raises:
        RobotError: the document is not well-formed, exceeds a limit of this module, or has a document type,
            an entity, a processing instruction or a control character.
    """
    beginning = text[: MAX_BYTES + 1].lstrip("\ufeff \t\r\n")
    if beginning and not beginning.startswith("<"):
        reason = f"this is not XML: it begins with {text[:40]!r}"
        raise RobotError(reason, remedy="send the document itself, not its file name", where="document")
    data = text.encode("utf-8", "surrogatepass")
    if len(data) > MAX_BYTES:
        raise RobotError(
            f"the document is too large: {len(data)} bytes",
            remedy=f"send at most {MAX_BYTES} bytes; only links and joints are needed",
            where="document",
        )
    if unfit := _UNFIT.search(text):
        raise RobotError(
            f"the document has a control character or half of a surrogate pair, {unfit.group()!a}",
            remedy="send plain text in UTF-8 without this character",
            where=f"line {text.count(chr(10), 0, unfit.start()) + 1}",
        )
    builder = _TreeBuilder()
    try:
        builder.parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = f"not well-formed XML: {expat.ErrorString(error.code)}"
        remedy = "check the document with an XML tool"
        if error.code == expat.errors.codes[expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT]:
            reason = "there is content after the end of the document, such as a second robot"
            remedy = "send one robot per document"
        raise RobotError(reason, remedy=remedy, where=f"line {error.lineno}") from None
    return builder.document.children[0]


class _TreeBuilder:
    """Builder of the tree of elements from expat's events, which checks the limits of this module.

    An exception in a handler stops expat at once.
    """

    def __init__(self) -> None:
        self.document = XmlElement("", {}, 0)  # its only child is the root
        self._open = [self.document]
        self._count = 0
        self.parser = expat.ParserCreate("utf-8")  # whatever encoding the document claims to have
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = lambda _tag: self._open.pop()
        self.parser.StartDoctypeDeclHandler = lambda *_declaration: self._refuse(
            "the document has a document type declaration (DTD), which can define entities",
            "remove <!DOCTYPE …> and write the entities out",
        )
        self.parser.ProcessingInstructionHandler = lambda target, _data: self._refuse(
            f"the document has a processing instruction <?{target[:40]} …?>", "remove the instruction"
        )

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        """Add an element whose start tag was read; raise a `RobotError` if a limit is exceeded."""
        self._count += 1
        longest = max(len(text) for text in (tag, *attributes, *attributes.values()))
        for count, most, counted_things in (
            (self._count, MAX_ELEMENTS, "elements"),
            (len(self._open), MAX_DEPTH, "levels of nesting"),
            (len(attributes), MAX_ATTRIBUTES, "attributes of one element"),
            (longest, MAX_ATTRIBUTE_LENGTH, "characters in one name or attribute"),
        ):
            if count > most:
                self._refuse(
                    f"the document has more than {most} {counted_things}", "send only links and joints"
                )
        element = XmlElement(tag, attributes, self.parser.CurrentLineNumber)
        self._open[-1].children.append(element)
        self._open.append(element)

    def _refuse(self, reason: str, remedy: str) -> None:
        """Raise a `RobotError` at the current line of the document."""
        raise RobotError(reason, remedy=remedy, where=f"line {self.parser.CurrentLineNumber}")


def read_numbers(text: str, count: int, largest: float, where: str) -> tuple[float, ...]:
    """Read text that has exactly `count` decimal numbers separated by spaces.

    Args:
        text: numbers as text, for instance ``"0 0.35 1e-3"``.
        count: required count of numbers.
        largest: largest allowed magnitude, in the unit of the numbers.
        where: place in the document, for the error.

    Raises:
        RobotError: the text has fewer or more numbers, a number is not decimal (hexadecimal, underscores,
            inf, nan, a comma), or a magnitude exceeds `largest`.
    """
    words = [word for word in _SPACE.split(text) if word]
    if len(words) != count:
        numbers = "number is" if count == 1 else "numbers are"
        reason = f"exactly {count} {numbers} needed here, but there are {len(words)}"
        raise RobotError(reason, remedy="write decimal numbers separated by spaces", where=where)
    for word in words:
        if not _NUMBER.fullmatch(word):
            reason = f"{quote(word)} is not a finite decimal number"
            raise RobotError(reason, remedy="write the number like 0.35 or -1.2e-3", where=where)
        if not abs(float(word)) <= largest:
            remedy = "check the number and its unit: lengths in m, angles in rad"
            raise RobotError(f"{quote(word)} is outside ±{largest:g}", remedy=remedy, where=where)
    return tuple(map(float, words))


def quote(text: str, length: int = 40) -> str:
    """Return text from a document quoted for a message: shortened, and with ASCII characters only."""
    return ascii(text[:length]) + ("…" if len(text) > length else "")
