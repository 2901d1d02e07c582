"""Both DH conventions, against homogeneous matrices written out here from the textbooks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.shared_data import shared

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.chain import UNLIMITED_ANGLE, DhRow, dh_chain
from jointstiff.solver.robot.configuration import joint_frames
from jointstiff.solver.robot.inverse import flange_poses
from jointstiff.solver.robot.model import Robot


def standard(row: DhRow, q: float) -> np.ndarray:
    """Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, eq. 3.10."""
    ct, st_ = math.cos(q + row.theta), math.sin(q + row.theta)
    ca, sa = math.cos(row.alpha), math.sin(row.alpha)
    return np.array(
        [
            [ct, -st_ * ca, st_ * sa, row.a * ct],
            [st_, ct * ca, -ct * sa, row.a * st_],
            [0.0, sa, ca, row.d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def modified(row: DhRow, q: float) -> np.ndarray:
    """Craig, Introduction to Robotics, eq. 3.6."""
    ct, st_ = math.cos(q + row.theta), math.sin(q + row.theta)
    ca, sa = math.cos(row.alpha), math.sin(row.alpha)
    return np.array(
        [
            [ct, -st_, 0.0, row.a],
            [st_ * ca, ct * ca, -sa, -sa * row.d],
            [st_ * sa, ct * sa, ca, ca * row.d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


TEXTBOOK = {"standard": standard, "modified": modified}


def flange_by_textbook(rows: list[DhRow], convention: str, q: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    for row, angle in zip(rows, q, strict=True):
        pose = pose @ TEXTBOOK[convention](row, angle)
    return pose


LENGTHS = st.floats(-2.0, 2.0)
ANGLES = st.floats(-6.0, 6.0) | st.sampled_from([-1.0, -0.5, 0.0, 0.5, 1.0]).map(lambda half: half * math.pi)
ROWS = st.lists(st.builds(DhRow, a=LENGTHS, alpha=ANGLES, d=LENGTHS, theta=ANGLES), min_size=1, max_size=8)


@pytest.mark.parametrize("convention", ["standard", "modified"])
@settings(deadline=None)
@given(rows=ROWS, seed=st.integers(0, 2**32 - 1))
def test_flange_is_the_last_frame_of_the_table(convention: str, rows: list[DhRow], seed: int) -> None:
    robot = Robot(dh_chain(rows, convention, "any"))
    q = np.random.default_rng(seed).uniform(-4.0, 4.0, len(rows))

    expected = flange_by_textbook(rows, convention, q)

    np.testing.assert_allclose(flange_poses(robot, q[None])[0], expected, atol=1e-13)


def test_fanuc_as_modified_dh() -> None:
    campaign = shared("fanuc_r2000ic/campaign")
    model = campaign["robot"]["model"]
    rows = [DhRow(**row) for row in model["rows"]]
    robot = Robot(dh_chain(rows, model["convention"], campaign["robot"]["name"]))

    assert robot.joint_names == tuple(f"joint_{i}" for i in range(1, 7))
    assert robot.chain.name == "FANUC R-2000iC"
    for q in np.random.default_rng(1).uniform(-3.0, 3.0, (50, 6)):
        expected = flange_by_textbook(rows, "modified", q)
        np.testing.assert_allclose(flange_poses(robot, q[None])[0], expected, atol=1e-13)


def test_joint_frames_of_the_modified_convention_are_the_frames_of_the_table() -> None:
    rows = [DhRow(0.1 * i, 0.3 * i, 0.2, 0.1) for i in range(4)]
    robot = Robot(dh_chain(rows, "modified", "any"))
    q = np.array([0.4, -1.0, 2.0, 0.3])
    rotation, origin = joint_frames(robot, q[None])
    for count in range(1, 5):
        expected = flange_by_textbook(rows[:count], "modified", q[:count])
        np.testing.assert_allclose(rotation[0, count - 1], expected[:3, :3], atol=1e-14)
        np.testing.assert_allclose(origin[0, count - 1], expected[:3, 3], atol=1e-14)


def test_links_and_limits() -> None:
    rows = [DhRow(0, 0, 1, 0), DhRow(0, 0, 1, 0, -1.0, 2.0), DhRow(0, 0, 1, 0, upper=3.0)]
    chain = dh_chain(rows, "standard", "any")

    assert (chain.base, chain.flange) == ("base", "flange")
    assert [joint.child for joint in chain.joints] == ["link_1", "link_2", "link_3", "flange"]
    limits = [joint.limits for joint in chain.revolute]
    assert limits == [None, (-1.0, 2.0), (-UNLIMITED_ANGLE, 3.0)]


def row(**changes: float) -> DhRow:
    return DhRow(**({"a": 0.1, "alpha": 0.0, "d": 0.2, "theta": 0.0} | changes))


@pytest.mark.parametrize(
    ("rows", "where"),
    [
        ([], "model.rows"),
        ([row()] * 33, "model.rows"),
        ([row(), row(a=math.nan)], "model.rows[1].a"),
        ([row(a=101.0)], "model.rows[0].a"),
        ([row(d=-math.inf)], "model.rows[0].d"),
        ([row(alpha=1001.0)], "model.rows[0].alpha"),
        ([row(theta=-90_000.0)], "model.rows[0].theta"),
        ([row(lower=math.nan)], "model.rows[0].lower"),
        ([row(upper=1e300)], "model.rows[0].upper"),
        ([row(lower=1.0, upper=-1.0)], "joint 'joint_1' limits"),
    ],
)
@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_refusals_name_the_place(rows: list[DhRow], where: str, convention: str) -> None:
    with pytest.raises(RobotError) as refusal:
        dh_chain(rows, convention, "any")
    assert refusal.value.where == where


def test_the_largest_table() -> None:
    assert Robot(dh_chain([row()] * 32, "modified", "snake")).n == 32
