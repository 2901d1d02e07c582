"""Formats of exports, by the end of a file's name: tables, and models for simulators with springs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal
from xml.etree import ElementTree

from jointstiff.service.exporting.model import PLACEHOLDERS, ExportedModel, joints_csv, workbook
from jointstiff.service.kinds.acceptance import refuse_unaccepted
from jointstiff.solver.robot.model import ChainJoint
from jointstiff.solver.robot.urdf import write_urdf

Element = ElementTree.Element


def add(parent: Element, tag: str, text: str | None = None, **attributes: str) -> Element:
    """Add an element and return it."""
    element = ElementTree.SubElement(parent, tag, attributes)
    element.text = text
    return element


def add_remarks(parent: Element, model: ExportedModel, *more: str) -> None:
    """Add what holds for all of the file, and what the file says of each joint."""
    joints = [model.remark_on(joint) for _, joint, _ in model.springs()]
    for line in (*model.remarks(), *more, *joints):
        comment(parent, line)


def comment(parent: Element, text: str) -> None:
    """Add a comment, in which XML forbids two dashes."""
    while "--" in text:
        text = text.replace("--", "- -")
    parent.append(ElementTree.Comment(f" {text} "))


def numbers(values: Iterable[float]) -> str:
    """Return numbers so that they read back the same."""
    return " ".join(repr(float(value)) for value in values)


def written(root: Element) -> bytes:
    """Return the document."""
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"


_VERSION: Final = "1.9"
_NO_LIMIT: Final = 1e16  # of the format
_SPRINGS: Final = (
    "Each spring pulls its joint to spring_reference: the angle that the controller commands, which is zero "
    "here. For another posture write its model angles there."
)
_FREE: Final = "A joint without a stiffness has no spring here and moves freely: hold it by a controller."


def sdf(model: ExportedModel) -> bytes:
    """Return a model whose joints have `spring_stiffness` and `spring_reference`.

    Links are placed relative to the link that carries them; each joint has its child's frame. SDFormat wants
    names unlike each other over links and joints: a link that is named as a joint is named `…_link`.
    """
    chain = model.chain
    root = ElementTree.Element("sdf", version=_VERSION)
    arm = add(root, "model", name=model.name)
    add_remarks(arm, model, _SPRINGS, _FREE, PLACEHOLDERS)
    taken = {joint.name for joint in chain.joints} | {"world"}
    springs = {joint.name: stiffness for joint, _, stiffness in model.springs()}
    parent = _link(arm, chain.base, taken)
    add_joint(arm, _unlike("base_to_world", taken), "fixed", "world", parent)
    for joint in chain.joints:
        child = _link(arm, joint.child, taken, joint, parent)
        element = add_joint(arm, joint.name, joint.kind, parent, child)
        if joint.is_moving:
            _axis(element, joint, springs[joint.name])
        parent = child
    for joint, result, _ in model.springs():
        element = next(each for each in arm.iter("joint") if each.get("name") == joint.name)
        comment(element, model.remark_on(result))
    return written(root)


def add_joint(arm: Element, name: str, kind: str, parent: str, child: str) -> Element:
    """Add a joint between two links."""
    element = add(arm, "joint", name=name, type=kind)
    add(element, "parent", parent)
    add(element, "child", child)
    return element


def _link(arm: Element, name: str, taken: set[str], joint: ChainJoint | None = None, parent: str = "") -> str:
    name = _unlike(name, taken)
    link = add(arm, "link", name=name)
    if joint is not None:
        add(link, "pose", numbers([*joint.translation, *joint.roll_pitch_yaw]), relative_to=parent)
    add(link, "gravity", "false")
    return name


def _unlike(name: str, taken: set[str]) -> str:
    while name in taken:
        name = f"{name}_link"
    taken.add(name)
    return name


def _axis(element: Element, joint: ChainJoint, stiffness: float | None) -> None:
    axis = add(element, "axis")
    add(axis, "xyz", numbers(joint.axis))
    limit = add(axis, "limit")
    lower, upper = joint.limits or (-_NO_LIMIT, _NO_LIMIT)
    add(limit, "lower", numbers([lower]))
    add(limit, "upper", numbers([upper]))
    if stiffness is not None:
        dynamics = add(axis, "dynamics")
        add(dynamics, "spring_reference", "0.0")
        add(dynamics, "spring_stiffness", numbers([stiffness]))


_ACTUATORS: Final = (
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
    add_remarks(root, model, _ACTUATORS, _HELD, PLACEHOLDERS)
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


_MISSING: Final = (
    "URDF describes kinematics, limits, damping and friction. It has no springs: each stiffness stands in a "
    "comment, and programs that read this file see rigid joints. The exports to SDF and MJCF have springs."
)


def urdf(model: ExportedModel) -> bytes:
    """Return the chain as `solver.robot.write_urdf` does, with the stiffness of each joint beside it."""
    robot = ElementTree.fromstring(write_urdf(model.chain))  # noqa: S314 - it was written here
    robot.set("name", model.name)
    remarks = ElementTree.Element("remarks")
    add_remarks(remarks, model, _MISSING)
    for place, remark in enumerate(remarks):
        robot.insert(place, remark)
    by_name = {joint.get("name"): joint for joint in robot.iter("joint")}
    for joint, result, _ in model.springs():
        comment(by_name[joint.name], model.remark_on(result))
    return written(robot)


ModelFormat = Literal["csv", "xlsx", "urdf", "sdf", "mjcf"]


@dataclass(frozen=True)
class Format:
    """A format."""

    write: Callable[[ExportedModel], bytes]  # writes a model
    media_type: str  # for HTTP


_XML: Final = "application/xml"
FORMATS: Final[Mapping[ModelFormat, Format]] = MappingProxyType(
    {
        "csv": Format(joints_csv, "text/csv"),
        "xlsx": Format(workbook, "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"),
        "urdf": Format(urdf, _XML),
        "sdf": Format(sdf, _XML),
        "mjcf": Format(mjcf, _XML),
    }
)


def export_model(model: ExportedModel, name: ModelFormat, accept_verdict: str | None = None) -> bytes:
    """Return a model as a file of a format.

    Raises:
        VerdictError: the run is not to be used, and that is not accepted.
    """
    refuse_unaccepted(model.result.assessment, accept_verdict, f"run '{model.run.id}'")
    return FORMATS[name].write(model)
