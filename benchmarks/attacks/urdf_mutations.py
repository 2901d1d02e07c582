"""URDFs of the example arms and of the catalogue, damaged; what is accepted is read again by Pinocchio."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Final

import numpy as np
import pinocchio as pin

from jointstiff.schemas.robot import RobotDocument, UrdfModel
from jointstiff.service.conversion.catalogue import catalogue
from jointstiff.service.conversion.prepared import build_robot, prepare_robot
from jointstiff.simulator import default_arm
from jointstiff.simulator.urdf import BASE_LINK, FLANGE_LINK, urdf_text
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.postures import flange_poses
from jointstiff.solver.mechanics.urdf import write_urdf

__all__ = ["corpus", "damaged", "judged", "model_of"]

Random = random.Random
_BRANCH: Final = """<link name="camera"><inertial><mass value="5"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<visual><geometry><mesh filename="camera.stl"/></geometry></visual></link>
<joint name="slide" type="prismatic"><parent link="{base}"/><child link="camera"/>
<origin xyz="0.1 0 1" rpy="0 0.2 0"/><axis xyz="1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>
</joint></robot>"""
_POSTURES: Final = 3
_TOLERANCE: Final = 1e-9
"""Largest difference of a pose's entries [m, 1]: both read the same decimal numbers."""
_NUMBER: Final = re.compile(r"(?<=[\" ])[-+]?\d[\d.e+-]*(?=[\" ])")
_NUMBERS: Final = (
    "0", "-0", "1e-3", "1E0", "nan", "inf", "1e400", "0x1p3", "1,5", "1_0", "", "１", "3 4", "1e4",
)  # fmt: skip
_TYPES: Final = ("revolute", "continuous", "fixed", "prismatic", "floating", "planar", "ball", "")
_PIECES: Final = (
    '"', "<", ">", "/", "&", "&amp;", "&x;", "\0", "\x1b", "é", "\u202e", "<!--", "]]>", "${x}", " ",
    "-",
)  # fmt: skip
_ADDED: Final = (
    '<mimic joint="slide"/>', '<axis xyz="0 0 1"/>', '<origin xyz="0 0 0"/>',
    '<!DOCTYPE r [<!ENTITY x "y">]>', '<xacro:include filename="x"/>', "<?pi x?>", "<!-- note -->",
    "<dynamics/>",
)  # fmt: skip


@cache
def corpus() -> list[UrdfModel]:
    """Return sound URDFs: the example arm, with and without a spherical wrist, and each of the catalogue."""
    texts = [(urdf_text(default_arm(wrist_offset=offset)), BASE_LINK, FLANGE_LINK) for offset in (0.0, 0.05)]
    for arm in catalogue().arms:
        chain = build_robot(RobotDocument(name=arm.name, model=arm.model)).chain
        texts.append((write_urdf(chain), chain.base, chain.flange))
    return [
        UrdfModel(
            format="urdf",
            urdf=text.replace("</robot>", _BRANCH.format(base=base)),
            base=base,
            flange=flange,
        )
        for text, base, flange in texts
    ]


def damaged(generator: Random, text: str) -> str:
    """Return a URDF after one to three changes."""
    for _ in range(generator.choice((1, 1, 2, 3))):
        text = generator.choice(_DAMAGES)(generator, text)
    return text


def _replaced(pattern: re.Pattern[str], values: tuple[str, ...]) -> Callable[[Random, str], str]:
    def change(generator: Random, text: str) -> str:
        places = list(pattern.finditer(text))
        if not places:
            return text
        place = generator.choice(places)
        return text[: place.start()] + generator.choice(values) + text[place.end() :]

    return change


def _scaled(generator: Random, text: str) -> str:
    """Write another number, which is legal and has to be read."""
    value = repr(round(generator.uniform(-2.0, 2.0), generator.randrange(6)))
    return _replaced(_NUMBER, (value, f"+{value.lstrip('-')}", f"{float(value):e}"))(generator, text)


def _piece(generator: Random, text: str) -> str:
    place = generator.randrange(len(text) + 1)
    return text[:place] + generator.choice(_PIECES) + text[place + generator.randrange(3) :]


def _line(generator: Random, text: str) -> str:
    """Lose a line, repeat it or move it."""
    lines = text.split("\n")
    line = lines.pop(generator.randrange(len(lines)))
    for _ in range(generator.randrange(3)):
        lines.insert(generator.randrange(len(lines) + 1), line)
    return "\n".join(lines)


def _cut(generator: Random, text: str) -> str:
    return text[: generator.randrange(len(text) + 1)]


def _renamed(generator: Random, text: str) -> str:
    """Give one mention of a link or joint the name of another."""
    names = tuple(re.findall(r'(?:name|link)="([^"]*)"', text)) or ("x",)
    return _replaced(re.compile(r'(?<=(?:name|link)=")[^"]*(?=")'), (*names, "", "é", "x" * 300))(
        generator, text
    )


_DAMAGES: Final[tuple[Callable[[Random, str], str], ...]] = (
    _scaled,
    _scaled,
    _replaced(_NUMBER, _NUMBERS),
    _replaced(re.compile(r'(?<=type=")\w*(?=")'), _TYPES),
    _replaced(re.compile(r"(?<=>)(?=<)|\n"), _ADDED),
    _replaced(re.compile(r'(?<= )\w+(?==")'), ("ryp", "xyz", "rpy", "name", "quat_xyzw")),
    _replaced(re.compile(r"(?<=</)\w+|(?<=<)\w+"), ("joint", "link", "Origin", "axis", "a:b", "robot")),
    _renamed,
    _piece,
    _line,
    _cut,
)


def model_of(model: UrdfModel, urdf: str) -> dict[str, str]:
    """Return the model of a robot's body, with another document."""
    return {"format": "urdf", "urdf": urdf, "base": model.base, "flange": model.flange}


def judged(generator: Random, model: Mapping[str, str]) -> str:
    """Return how a document was taken: `refused`, `same` or `WRONG` beside Pinocchio's reader, or `alone`.

    `alone` is a document that the service accepts and Pinocchio's reader does not. It is told as such.
    """
    try:
        robot = prepare_robot(RobotDocument.model_validate({"name": "r", "model": model})).robot
    except (RobotError, ValueError):
        return "refused"
    rng = np.random.default_rng(generator.getrandbits(32))
    q = rng.uniform(-3.0, 3.0, (_POSTURES, robot.n))
    try:
        expected = _poses(model, robot.joint_names, q)
    except (ValueError, RuntimeError, LookupError):
        return "alone"
    close = np.allclose(flange_poses(robot, q), expected, rtol=0.0, atol=_TOLERANCE)
    return "same" if close else "WRONG"


def _poses(model: Mapping[str, str], names: tuple[str, ...], q: FloatArray) -> FloatArray:
    """Return poses (m, 4, 4) [m] of the flange in the base, by Pinocchio's reader of URDFs."""
    arm = pin.buildModelFromXML(model["urdf"])
    data, poses = arm.createData(), []
    for angles in q:
        found = pin.neutral(arm)
        for name, angle in zip(names, angles, strict=True):
            joint = arm.joints[_known(arm.existJointName(name), arm.getJointId(name))]
            value = [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
            found[joint.idx_q : joint.idx_q + joint.nq] = value
        pin.framesForwardKinematics(arm, data, found)
        links = (model["base"], model["flange"])
        base, flange = (
            data.oMf[_known(arm.existFrame(link, pin.BODY), arm.getFrameId(link, pin.BODY))] for link in links
        )
        poses.append((base.inverse() * flange).homogeneous)
    return np.array(poses)


def _known(exists: bool, index: int) -> int:
    if not exists:
        raise LookupError
    return index
