"""Inverse kinematics: what forward kinematics maps back, on arms of published dimensions.

Branches of identified arms near singularities are continued, or refused; never lost without a word.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from support.calibrated_arms import ARMS, arm, chain_rows

from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.configuration import (
    InverseKinematics,
    Unreached,
    _between,
    choose_postures,
    flange_poses,
)
from jointstiff.solver.mechanics.robot import Robot, dh_chain


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


def test_arms_without_six_joints_are_refused():
    robot = Robot(dh_chain(chain_rows(ARMS["ur5"][1][:5]), "standard", "five"))
    with pytest.raises(RobotError, match="5 joints"):
        InverseKinematics(robot)


def off(angles, truth):
    """Greatest difference of an angle, full turns aside."""
    apart = angles - truth
    return np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))).max(axis=-1)


def paths(count, seed=7):
    draw = np.random.default_rng(seed)
    for _ in range(count):
        turn = draw.standard_normal(6)
        wave = np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, 40))[:, None]
        yield draw.uniform(-2.8, 2.8, 6) + np.radians(6.0) * wave * turn / np.abs(turn).max()


@pytest.mark.parametrize(("name", "count"), [("ur5", 40), ("r2000ic", 40), *(
    pytest.param(name, 600, marks=pytest.mark.slow) for name in ARMS)])  # fmt: skip
def test_paths_stay_on_their_branch_or_are_refused(name, count):
    robot, refused = arm(name, 1e-3), 0
    for q in paths(count):
        joints, unreached = chosen(robot, flange_poses(robot, q), robot.joint_map.controller_angles(q[:1])[0])
        if unreached.any():
            refused += 1
        else:
            assert off(robot.joint_map.model_angles(joints), q).max() < 1e-6
    assert refused < 0.2 * count


def test_a_halved_step_is_half_of_the_way_and_of_the_turn():
    """Beside an interpolation of SciPy's."""
    begin, end = flange_poses(arm("ur5"), np.random.default_rng(3).uniform(-1.0, 1.0, (2, 6)))
    share = np.array([0.0, 0.25, 0.5, 1.0])
    poses = _between(np.tile(begin, (4, 1, 1)), np.tile(end, (4, 1, 1)), share)
    turned = Slerp([0.0, 1.0], Rotation.from_matrix([begin[:3, :3], end[:3, :3]]))(share)
    np.testing.assert_allclose(poses[:, :3, :3], turned.as_matrix(), atol=1e-12)
    for k in range(3):
        np.testing.assert_allclose(
            poses[:, k, 3], np.interp(share, [0.0, 1.0], [begin[k, 3], end[k, 3]]), atol=1e-12
        )


def test_a_path_through_a_singularity_is_refused_where_it_is():
    robot = arm("r2000ic", 1e-3)
    q = np.tile([0.3, -0.2, 0.4, 0.2, 0.0, 0.5], (41, 1))
    q[:, 4] = np.linspace(-0.1, 0.1, 41)
    q[:, 3] += np.linspace(0.0, 0.05, 41)
    _, unreached = chosen(robot, flange_poses(robot, q), robot.joint_map.controller_angles(q[:1])[0])
    refused = np.flatnonzero(unreached == Unreached.NOT_FOLLOWED)
    assert len(refused)
    assert (np.abs(q[refused, 4]) < 0.06).all()
