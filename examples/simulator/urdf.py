"""The arm as URDF, so that other programs can read its kinematics. URDF is in m and rad."""

from __future__ import annotations

import numpy as np

from jointstiff.simulator.arm import FloatArray, SpringArm

__all__ = ["BASE_LINK", "FLANGE_LINK", "urdf_text"]

BASE_LINK = "base_link"
FLANGE_LINK = "flange"

JOINT = """<link name="{child}"/>
<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>\
<origin xyz="{xyz}" rpy="0 0 0"/><axis xyz="{axis}"/>\
<limit lower="{lower}" upper="{upper}" effort="10000" velocity="3"/></joint>"""
FLANGE = """<link name="{child}"/>
<joint name="joint_flange" type="fixed"><parent link="{parent}"/><child link="{child}"/>\
<origin xyz="{xyz}" rpy="{rpy}"/></joint>"""


def urdf_text(arm: SpringArm, name: str = "arm") -> str:
    """URDF of the arm: base_link, joint_1 … joint_n, and the flange as a fixed link.

    At zero all link frames are parallel to R0, each with its origin at the point of its axis.

    Args:
        arm: The arm.
        name: The robot's name in the URDF.
    """
    lines = [f'<robot name="{name}">', f'<link name="{BASE_LINK}"/>']
    origin, parent = np.zeros(3), BASE_LINK
    for j, joint in enumerate(arm.joint_names):
        child = f"link_{j + 1}"
        lower, upper = arm.limits[j]
        lines.append(
            JOINT.format(
                name=joint,
                kind="prismatic" if j in arm.prismatic else "revolute",
                parent=parent,
                child=child,
                xyz=_numbers(arm.axis_points[j] - origin),
                axis=_numbers(arm.axis_directions[j]),
                lower=f"{lower:.15g}",
                upper=f"{upper:.15g}",
            )
        )
        origin, parent = arm.axis_points[j], child
    xyz = _numbers(arm.flange_translation - origin)
    rpy = _numbers(roll_pitch_yaw(arm.flange_rotation))
    lines.append(FLANGE.format(parent=parent, child=FLANGE_LINK, xyz=xyz, rpy=rpy))
    return "\n".join([*lines, "</robot>"])


def roll_pitch_yaw(rotation: FloatArray) -> FloatArray:
    """Angles [rad], (3,), of R = Rz(yaw) Ry(pitch) Rx(roll), also where they are not unique.

    Any yaw will do at pitch ±π/2, if the rest is then taken from Rz(yaw)ᵀ R = Ry(pitch) Rx(roll).

    Args:
        rotation: Rotation matrix, (3, 3).
    """
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    cosine, sine = np.cos(yaw), np.sin(yaw)
    rest = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ rotation
    pitch = np.arctan2(-rest[2, 0], rest[0, 0])
    roll = np.arctan2(-rest[1, 2], rest[1, 1])
    return np.array([roll, pitch, yaw])


def _numbers(values: FloatArray) -> str:
    return " ".join(f"{value + 0.0:.15g}" for value in values)
