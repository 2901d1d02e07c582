"""Inverse kinematics: what forward kinematics maps back, on arms of published dimensions."""

from __future__ import annotations

import numpy as np
import pytest

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.dh import DhRow, dh_chain
from jointstiff.solver.robot.inverse import InverseKinematics, Unreached, choose_postures, flange_poses
from jointstiff.solver.robot.model import Robot

HALF = np.pi / 2
UR5 = [
    DhRow(0.0, HALF, 0.089159, 0.0),
    DhRow(-0.425, 0.0, 0.0, 0.0),
    DhRow(-0.39225, 0.0, 0.0, 0.0),
    DhRow(0.0, HALF, 0.10915, 0.0),
    DhRow(0.0, -HALF, 0.09465, 0.0),
    DhRow(0.0, 0.0, 0.0823, 0.0),
]
"""Standard DH table that Universal Robots publishes."""
FANUC = [
    DhRow(0.0, 0.0, 0.67, 0.0),
    DhRow(0.312, -HALF, 0.0, -HALF),
    DhRow(1.075, 0.0, 0.0, 0.0),
    DhRow(0.225, -HALF, 1.28, 0.0),
    DhRow(0.0, HALF, 0.0, 0.0),
    DhRow(0.0, -HALF, 0.215, 0.0),
]
ARMS = {"ur5": ("standard", UR5), "r2000ic": ("modified", FANUC)}


def arm(name, crookedness=0.0):
    convention, rows = ARMS[name]
    rng = np.random.default_rng(3)
    crooked = [
        DhRow(
            *(value + crookedness * rng.standard_normal() for value in (row.a, row.alpha, row.d, row.theta))
        )
        for row in rows
    ]
    return Robot(dh_chain(crooked, convention, name))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("crookedness", [0.0, 1e-3])
def test_the_angles_come_back_among_the_branches(name, crookedness):
    robot = arm(name, crookedness)
    q = np.random.default_rng(1).uniform(-2.8, 2.8, (200, 6))
    poses = flange_poses(robot, q)
    inverse = InverseKinematics(robot)
    branches = inverse.solutions(poses)[0]
    turned = np.abs((branches - q[:, None] + np.pi) % (2 * np.pi) - np.pi).max(axis=2)
    far = np.nan_to_num(turned, nan=np.inf).min(axis=1)
    assert np.count_nonzero(far < 1e-8) >= 196  # a few postures are at a singularity
    case, branch = np.nonzero(np.isfinite(branches[:, :, 0]))
    np.testing.assert_allclose(flange_poses(robot, branches[case, branch]), poses[case], atol=1e-9)


def chosen(robot, poses, start):
    free = np.tile([-np.inf, np.inf], (len(poses), 6, 1))
    given, tested = np.full((len(poses), 6), np.nan), np.zeros(len(poses), dtype=bool)
    return choose_postures(InverseKinematics(robot), poses, given, free, tested, start)


def test_the_nearest_solution_has_full_turns_added():
    robot = arm("r2000ic")
    q = np.array([[0.3, -0.2, 0.4, 5.0, 1.1, -6.0]])
    found = chosen(robot, flange_poses(robot, q), q[0] + 0.1)
    assert found.unreached.tolist() == [Unreached.NO]
    np.testing.assert_allclose(found.joints, q, atol=1e-9)


def test_what_is_out_of_reach_is_said():
    robot = arm("ur5")
    pose = np.eye(4)[None].copy()
    pose[0, 0, 3] = 5.0
    assert chosen(robot, pose, np.zeros(6)).unreached.tolist() == [Unreached.OUT_OF_REACH]


def test_a_pose_half_a_turn_away_is_not_reached_where_the_flange_stands():
    robot = arm("ur5")
    q = np.array([[0.3, -0.9, 1.1, 0.2, 0.8, -0.4]])
    pose = flange_poses(robot, q)
    pose[0, :3, :3] = pose[0, :3, :3] @ np.diag([1.0, -1.0, -1.0])
    found, reached = InverseKinematics(robot).polished(pose, q)
    assert not reached[0] or np.allclose(flange_poses(robot, found), pose, atol=1e-8)


def test_arms_without_six_joints_are_refused():
    robot = Robot(dh_chain(UR5[:5], "standard", "five"))
    with pytest.raises(RobotError, match="5 joints"):
        InverseKinematics(robot)
