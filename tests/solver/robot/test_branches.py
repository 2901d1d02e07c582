# ruff: noqa: E501
"""Branches of identified arms near singularities: continued, or refused; never lost without a word."""

from __future__ import annotations

import numpy as np
import pytest

from jointstiff.solver.robot.dh import DhRow, dh_chain
from jointstiff.solver.robot.inverse import InverseKinematics, Unreached, choose_postures, flange_poses
from jointstiff.solver.robot.model import Robot

HALF = np.pi / 2
ARMS = {
    "ur5": (
        "standard",
        [(0, HALF, 0.0892, 0), (-0.425, 0, 0, 0), (-0.392, 0, 0, 0), (0, HALF, 0.109, 0), (0, -HALF, 0.0947, 0), (0, 0, 0.0823, 0)],
    ),
    "r2000": (
        "modified",
        [(0, 0, 0.67, 0), (0.312, -HALF, 0, -HALF), (1.075, 0, 0, 0), (0.225, -HALF, 1.28, 0), (0, HALF, 0, 0), (0, -HALF, 0.215, 0)],
    ),
}  # fmt: skip


def identified(name, seed=3):
    """An arm whose axes are off by 1 mm and 1 mrad, as calibration finds them."""
    convention, rows = ARMS[name]
    draw = np.random.default_rng(seed)
    return Robot(
        dh_chain([DhRow(*(v + 1e-3 * draw.standard_normal() for v in row)) for row in rows], convention, name)
    )


LEAST = {0.005: 4_600, 0.02: 3_700, 0.1: 590}
"""Postures of 5,000 of which Newton's method is sure to find the branch, by how far it begins [rad]."""


def off(angles, truth):
    """Greatest difference of an angle, full turns aside."""
    apart = angles - truth
    return np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))).max(axis=-1)


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("beside", LEAST)
def test_what_continues_a_branch_is_the_branch_that_was_asked_for(name, beside):
    robot, draw = identified(name), np.random.default_rng(5)
    q = draw.uniform(-2.8, 2.8, (5_000, 6))
    inverse, near = InverseKinematics(robot), q + beside * draw.choice([-1.0, 1.0], q.shape)
    found, reached = inverse.polished(flange_poses(robot, q), near)
    sure = reached & inverse.continues(found, near)
    assert (off(found, q)[sure] < 1e-6).all()
    assert np.count_nonzero(sure) > LEAST[beside]


def follow(robot, q):
    poses, free = flange_poses(robot, q), np.tile([-np.inf, np.inf], (len(q), 6, 1))
    start = robot.joint_map.controller_angles(q[:1])[0]
    return choose_postures(
        InverseKinematics(robot), poses, np.full(q.shape, np.nan), free, np.zeros(len(q), bool), start
    )


def paths(count, seed=7):
    draw = np.random.default_rng(seed)
    for _ in range(count):
        turn = draw.standard_normal(6)
        wave = np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, 40))[:, None]
        yield draw.uniform(-2.8, 2.8, 6) + np.radians(6.0) * wave * turn / np.abs(turn).max()


@pytest.mark.parametrize(("name", "count"), [("ur5", 40), ("r2000", 40), *(
    pytest.param(name, 600, marks=pytest.mark.slow) for name in ARMS)])  # fmt: skip
def test_paths_stay_on_their_branch_or_are_refused(name, count):
    robot, refused = identified(name), 0
    for q in paths(count):
        found = follow(robot, q)
        if found.unreached.any():
            refused += 1
        else:
            assert off(robot.joint_map.model_angles(found.joints), q).max() < 1e-6
    assert refused < 0.2 * count


def test_a_path_through_a_singularity_is_refused_where_it_is():
    robot = identified("r2000")
    q = np.tile([0.3, -0.2, 0.4, 0.2, 0.0, 0.5], (41, 1))
    q[:, 4] = np.linspace(-0.1, 0.1, 41)
    q[:, 3] += np.linspace(0.0, 0.05, 41)
    found = follow(robot, q)
    refused = np.flatnonzero(found.unreached == Unreached.NOT_FOLLOWED)
    assert len(refused)
    assert (np.abs(q[refused, 4]) < 0.06).all()
