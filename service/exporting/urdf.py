"""A run as a URDF: kinematics and limits; URDF has no spring, so the stiffness stands in comments."""

from __future__ import annotations

from typing import Final
from xml.etree import ElementTree

from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.exporting.xml import add_remarks, comment, written
from jointstiff.solver.robot.urdf import write_urdf

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
    for joint, found, _ in model.springs():
        comment(by_name[joint.name], model.remark_on(found))
    return written(robot)
