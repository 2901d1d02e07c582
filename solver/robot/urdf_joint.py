"""The joints of a URDF: what the document says of them, and which of them a chain may hold.

Two steps, because a joint off the chain (a finger of a gripper) must be sound but may move in any
way: `read_joint` reads any joint, `chain_joint` takes only those that the solver can move.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.chain import UNLIMITED_ANGLE, ChainJoint, FloatArray, check_name
from jointstiff.solver.robot.rotation import rotation_from_rpy
from jointstiff.solver.robot.urdf_tree import TreeJoint
from jointstiff.solver.robot.xml_guard import XmlElement
from jointstiff.solver.robot.xml_values import ORIGIN, quoted, read_numbers, read_triples, single

__all__ = [
    "AXIS_TOLERANCE",
    "UrdfJoint",
    "chain_joint",
    "read_joint",
]

AXIS_TOLERANCE = 1e-3
"""How far the norm of an <axis> may be from 1 before it is refused; below, it is normalised."""

_TYPES = ("revolute", "continuous", "fixed", "prismatic", "floating", "planar")
_AXIS = {"xyz": 1e6}  # its norm is judged on the chain only: exporters leave odd axes on fixed joints
_ZERO = (0.0, 0.0, 0.0)
_DEFAULT_AXIS = (1.0, 0.0, 0.0)  # of the URDF standard
_LARGEST_LIMIT = 1e300  # some documents write ±1e16 for no limit


@dataclass(frozen=True)
class UrdfJoint:
    """A joint as the document has it, its numbers read.

    Attributes:
        edge: its name and its links.
        kind: one of the six types of the URDF standard.
        xyz: origin of the joint's frame in the parent link's frame [m].
        rpy: roll, pitch, yaw of the joint's frame about the parent link's fixed axes [rad].
        axis: in the joint's frame, not yet normalised.
        limit: numbers of <limit> by name [rad], None without <limit>.
        mimics: whether it follows another joint.
    """

    edge: TreeJoint
    kind: str
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]
    axis: tuple[float, ...]
    limit: dict[str, float] | None
    mimics: bool

    @property
    def place(self) -> str:
        """The joint, for a message."""
        return f"joint '{self.edge.name}'"


def read_joint(element: XmlElement, name: str) -> UrdfJoint:
    """Read a joint of any of the six types, on the chain or off it.

    Args:
        element: the <joint> element.
        name: its name, already checked.

    Raises:
        RobotError: an unknown type, a link that is missing or has no proper name, numbers that are
            not finite decimals or not as many as needed, an attribute that others would silently
            ignore.
    """
    place = f"joint '{name}'"
    kind = element.attributes.get("type", "")
    if kind not in _TYPES:
        raise RobotError(
            f"unknown joint type {quoted(kind)}",
            remedy=f"use one of {', '.join(_TYPES)}",
            where=place,
        )
    parent, child = (_link_of(element, role, place) for role in ("parent", "child"))
    origin = read_triples(element, "origin", ORIGIN, place)
    return UrdfJoint(
        edge=TreeJoint(name, parent, child),
        kind=kind,
        xyz=origin.get("xyz", _ZERO),
        rpy=origin.get("rpy", _ZERO),
        axis=_axis(element, place),
        limit=_limit(element, place),
        mimics=bool(element.named("mimic")),
    )


def chain_joint(joint: UrdfJoint) -> ChainJoint:
    """Turn a joint between base and flange into one that the solver can move.

    Raises:
        RobotError: a mimic, prismatic, floating or planar joint, an axis that is zero or not a unit
            vector, a revolute joint without limits or with a lower one above the upper one.
    """
    _check_supported(joint)
    moves = joint.kind != "fixed"
    return ChainJoint(
        name=joint.edge.name,
        kind="revolute" if moves else "fixed",
        rotation=rotation_from_rpy(*joint.rpy),
        translation=np.array(joint.xyz),
        axis=_unit_axis(joint) if moves else np.array(_DEFAULT_AXIS),
        limits=_limits(joint) if joint.kind == "revolute" else None,
        child=joint.edge.child,
    )


def _check_supported(joint: UrdfJoint) -> None:
    if joint.mimics:
        raise RobotError(
            "a mimic joint between base and flange",
            remedy="remove <mimic>, and state the coupling in joint_map",
            where=f"{joint.place} <mimic>",
        )
    if joint.kind not in ("revolute", "continuous", "fixed"):
        raise RobotError(
            f"a {joint.kind} joint between base and flange",
            remedy="only revolute, continuous and fixed joints are supported there: "
            "make it fixed at its place, or choose another base or flange",
            where=joint.place,
        )


def _unit_axis(joint: UrdfJoint) -> FloatArray:
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


def _limits(joint: UrdfJoint) -> tuple[float, float] | None:
    limit = joint.limit or {}
    if not limit.keys() & {"lower", "upper"}:
        raise RobotError(
            "a revolute joint needs <limit> with lower and upper",
            remedy="give the limits in rad, or make the joint continuous",
            where=f"{joint.place} <limit>",
        )
    lower, upper = limit.get("lower", 0.0), limit.get("upper", 0.0)
    if lower > upper:
        raise RobotError(
            f"the lower limit {lower:g} is above the upper limit {upper:g}",
            remedy="exchange them, or correct a sign; an absent limit counts as 0",
            where=f"{joint.place} <limit>",
        )
    unlimited = lower <= -UNLIMITED_ANGLE and upper >= UNLIMITED_ANGLE
    return None if unlimited else (lower, upper)


def _axis(joint: XmlElement, place: str) -> tuple[float, ...]:
    element = single(joint, "axis", place)
    if element is not None and "xyz" not in element.attributes:
        raise RobotError("the axis has no xyz", remedy="give it xyz", where=f"{place} <axis>")
    return read_triples(joint, "axis", _AXIS, place).get("xyz", _DEFAULT_AXIS)


def _limit(joint: XmlElement, place: str) -> dict[str, float] | None:
    limit = single(joint, "limit", place)
    if limit is None:
        return None
    return {
        name: read_numbers(limit.attributes[name], 1, _LARGEST_LIMIT, f"{place} <limit> {name}")[0]
        for name in ("lower", "upper", "effort", "velocity")
        if name in limit.attributes
    }


def _link_of(joint: XmlElement, role: str, place: str) -> str:
    element = single(joint, role, place)
    name = element.attributes.get("link", "") if element else ""
    check_name(name, f"{place} <{role}>")
    return name
