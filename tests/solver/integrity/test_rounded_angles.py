"""Angles of a description that were rounded are remarked, and change no verdict."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

from jointstiff.solver.integrity import inspect_measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.urdf import read_urdf

ARM = next(known.robot for known in build_nominal_robots() if "UR5e" in known.name)
READINGS = readings_on(ARM, 1)


def urdf(turns):
    """Return six joints in a row, with the roll, pitch and yaw of each."""
    joints = "".join(
        f'<joint name="j{i}" type="continuous"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0 0.1 0.5" rpy="{turn}"/><axis xyz="0 0 1"/></joint>'
        for i, turn in enumerate(turns)
    )
    links = "".join(f'<link name="l{i}"/>' for i in range(len(turns) + 1))
    return f"<robot>{links}{joints}</robot>"


def remarks(*turns):
    turns = (*turns, *["0 0 0"] * (6 - len(turns)))
    robot = Robot(read_urdf(urdf(turns), "l0", "l6").model())
    return [f for f in inspect_measurements(robot, READINGS, degrees=False) if f.code == "angle_rounded"]


@pytest.mark.parametrize(
    ("turn", "words"),
    [
        ("1.57 0 0", "the roll of j0 is 1.57 rad, -0.8 mrad off 90°"),
        ("0 0 -1.571", "the yaw of j0 is -1.571 rad, -0.2 mrad off -90°"),
        ("0 0 3.1415", "the yaw of j0 is 3.1415 rad, -0.093 mrad off 180°"),
        ("0 -1.57 0", "the pitch of j0 is -1.57 rad, 0.8 mrad off -90°"),
    ],
)
def test_a_rounded_right_angle_is_remarked(turn, words):
    (remark,) = remarks(turn)
    assert (remark.message, remark.weight) == (words, "use")
    assert "is meant, write" in remark.remedy


@pytest.mark.parametrize(
    "turn",
    ["1.5708 0 0", "1.5707963 0 0", f"{np.pi} 0 0", "1.5702345 0 0", "0.785 0 0", "0.0005 0 0", "1.5 0 0"],
)
def test_exact_calibrated_and_other_angles_are_not(turn):
    assert remarks(turn) == []
