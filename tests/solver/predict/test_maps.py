"""Maps against springs that balance loads exactly, by code that shares nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import estimate
from support.springs import SpringCampaign, robot_of

from jointstiff.simulator import default_arm, equilibrium
from jointstiff.solver.convex.problem import Bounds, Constraints
from jointstiff.solver.predict.forward import LoadCases
from jointstiff.solver.predict.maps import (
    STATUSES,
    DeflectionMap,
    MapTask,
    map_places,
    tool_rotations,
)
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.robot.chain import DhRow, dh_chain
from jointstiff.solver.robot.inverse import InverseKinematics, flange_poses
from jointstiff.solver.robot.model import Robot

ARM = default_arm()
ROBOT = robot_of(ARM)
INVERSE = InverseKinematics(ROBOT)
POSITIVE = Constraints(Bounds.positive(6))
MODEL = JointModel(ROBOT, ARM.compliances, None, POSITIVE)
TOOL = np.array([0.0, 0.0, 0.25])
AREA = np.stack(np.meshgrid([1.2, 1.6, 2.0], [-0.6, 0.0, 0.6], [0.4, 0.9], indexing="ij"), axis=-1).reshape(
    -1, 3
)
FREE = np.tile([-np.inf, np.inf], (6, 1))


def task(*, directions=((0.0, 0.0, -1.0),), turns=1, force=(0.0, 800.0, 300.0), near=None, limits=FREE):
    rotation = tool_rotations(np.array([0.0, 0.0, 1.0]), np.array(directions, dtype=float), turns)
    unit = np.array(force) / np.linalg.norm(force)
    ones = np.ones((len(rotation), 1))
    wrench = ones * force, np.zeros((len(rotation), 3)), ones * unit
    return MapTask(rotation, *wrench, TOOL, np.array([0.0, 0.0, 0.1]), limits, near, 0.95)


def tool_pose(joints):
    posture = ARM.posture(joints)
    return posture.point_to_base(np.tile(TOOL, (len(joints), 1))), posture.flange_rotation


def exact_displacement(asked, joints, force):
    loads = np.tile(force, (len(joints), 1)), np.zeros((len(joints), 3))
    turn = equilibrium(ARM, joints, *loads, np.tile(asked.load_point, (len(joints), 1)))
    return tool_pose(joints + turn)[0] - tool_pose(joints)[0]


def test_the_tool_stands_where_it_was_asked_to_and_bends_as_springs_do():
    asked = task(turns=4)
    found = map_places(MODEL, None, asked, INVERSE, AREA)
    assert found.reached.all()
    place, axes = tool_pose(found.joints)
    np.testing.assert_allclose(place, AREA, rtol=0, atol=1e-12)
    np.testing.assert_allclose(axes, asked.rotation[found.orientation], rtol=0, atol=1e-12)
    np.testing.assert_allclose(axes[:, :, 2], np.tile([0.0, 0.0, -1.0], (len(AREA), 1)), rtol=0, atol=1e-12)
    exact = exact_displacement(asked, found.joints, [0.0, 800.0, 300.0])
    np.testing.assert_allclose(found.displacement, exact, rtol=0, atol=1e-13)
    assert np.isnan(found.readings).all()
    assert np.isnan(found.with_model_error).all()


def test_the_stiffest_posture_is_no_softer_than_any_other():
    asked = task(turns=3)
    found = map_places(MODEL, None, asked, INVERSE, AREA[:4])
    for place, length in zip(AREA, found.length, strict=False):
        poses = np.tile(np.eye(4), (3, 1, 1))
        poses[:, :3, :3] = asked.rotation
        poses[:, :3, 3] = place - asked.rotation @ TOOL
        joints = INVERSE.solutions(poses)[0].reshape(-1, 6)
        joints = joints[np.isfinite(joints).all(axis=1)]
        joints = joints[((joints >= ROBOT.limits[:, 0]) & (joints <= ROBOT.limits[:, 1])).all(axis=1)]
        others = np.linalg.norm(exact_displacement(asked, joints, [0.0, 800.0, 300.0]), axis=1)
        assert length <= others.min() * (1 + 5e-3)  # it is chosen to first order


def test_the_nearest_posture_and_its_full_turns():
    home = map_places(MODEL, None, task(), INVERSE, AREA[:1]).joints[0]
    turned = home + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2 * np.pi])
    unlimited = replace_limits(ROBOT)
    model = JointModel(unlimited, ARM.compliances, None, POSITIVE)
    found = map_places(model, None, task(near=turned), InverseKinematics(unlimited), AREA[:1])
    np.testing.assert_allclose(found.joints[0], turned, rtol=0, atol=1e-9)


def replace_limits(robot):
    joints = tuple(replace(joint, limits=None) for joint in robot.chain.joints)
    return type(robot)(replace(robot.chain, joints=joints), robot.joint_map)


def test_why_a_place_has_no_numbers():
    far = np.array([[9.0, 0.0, 0.0], [1.6, 0.0, 0.9]])
    found = map_places(MODEL, None, task(), INVERSE, far)
    assert [STATUSES[s] for s in found.status] == ["out_of_reach", "reached"]
    narrow = np.where(np.arange(6)[:, None] == 1, [2.0, 2.1], FREE)
    assert named(map_places(MODEL, None, task(limits=narrow), INVERSE, far[1:])) == ["joint_limits"]
    heavy = map_places(MODEL, None, task(force=(0.0, 9e6, 0.0)), INVERSE, far[1:])
    assert named(heavy) == ["overloaded"]
    assert np.isnan(heavy.displacement).all()
    assert np.isfinite(heavy.joints).all()
    blind = measured_model(load="dead_weight")
    assert named(map_places(blind, None, task(), INVERSE, far[1:])) == ["unseen_joint"]
    down = map_places(blind, None, task(force=(0.0, 0.0, -900.0)), INVERSE, far[1:])
    assert named(down) == ["reached"]
    assert np.isfinite(down.along).all()
    assert np.isnan(down.across).all()  # a force to the side would twist joint 1


def named(found: DeflectionMap):
    return [STATUSES[s] for s in found.status]


def measured_model(load="pull"):
    campaign = SpringCampaign.of(ARM, configurations=15)
    measurements = next(campaign.measured(1, seed=4))
    if load == "dead_weight":
        down = np.zeros_like(measurements.force)
        down[:, 2] = -1500.0
        measurements = replace(measurements, force=down)
    return JointModel.of(ROBOT, estimate(ROBOT, measurements), POSITIVE)


def test_compliance_and_intervals_are_those_of_a_prediction():
    model, asked = measured_model(), task(directions=((0.0, 0.0, -1.0), (0.5, 0.0, -(0.75**0.5))), turns=2)
    found = map_places(model, None, asked, INVERSE, AREA)
    every = np.ones((len(AREA), 1))
    force = asked.force[found.orientation]
    cases = LoadCases(found.joints, force, 0.0 * force, every * asked.load_point, every * TOOL)
    predicted = model.deflect(cases)
    np.testing.assert_allclose(found.displacement, predicted.displacement, rtol=1e-9)
    direction = asked.direction[found.orientation]
    np.testing.assert_allclose(found.along, predicted.compliance.along(direction), rtol=1e-9)
    worst = [
        max(v @ C @ v for v in circle(u))
        for u, C in zip(direction, predicted.compliance.translation, strict=True)
    ]
    np.testing.assert_allclose(found.across, worst, rtol=1e-3)
    unit = found.displacement / found.length[:, None]
    deviation = predicted.deviation_along(unit)
    np.testing.assert_allclose(np.ptp(found.readings, axis=1), 2 * 1.959964 * deviation, rtol=0.02)
    assert (found.readings[:, 0] < found.length).all()
    assert (found.length < found.readings[:, 1]).all()


def circle(u):
    """Unit vectors across u."""
    first = np.linalg.svd(u[None])[2][1]
    second = np.cross(u, first)
    return [np.cos(a) * first + np.sin(a) * second for a in np.linspace(0, np.pi, 200)]


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.6, 0.0, 0.8)])
def test_orientations_point_the_tool_along_its_direction(direction):
    axis = np.array([0.0, -0.6, 0.8])
    rotations = tool_rotations(axis, np.array([direction]), 4)
    np.testing.assert_allclose(rotations @ axis, np.tile(direction, (4, 1)), atol=1e-15)
    np.testing.assert_allclose(
        rotations @ rotations.transpose(0, 2, 1), np.tile(np.eye(3), (4, 1, 1)), atol=1e-15
    )
    step = rotations[1] @ rotations[0].T
    assert np.trace(step) == pytest.approx(1.0)  # a quarter turn
    np.testing.assert_allclose(step @ direction, direction, atol=1e-15)


def identified_arm():
    """An arm whose wrist axes miss each other by 1 mm and 1 mrad, as calibration finds them."""
    draw, half = np.random.default_rng(3), np.pi / 2
    rows = [(0, 0, 0.67, 0), (0.312, -half, 0, -half), (1.075, 0, 0, 0), (0.225, -half, 1.28, 0),
            (0, half, 0, 0), (0, -half, 0.215, 0)]  # fmt: skip
    exact = [DhRow(*(value + 1e-3 * draw.standard_normal() for value in row)) for row in rows]
    return Robot(dh_chain(exact, "modified", "identified"))


def test_near_singularities_a_map_keeps_the_branch_or_refuses_the_place():
    """Near its wrist's singularity the closed form of an identified arm loses branches."""
    robot, draw = identified_arm(), np.random.default_rng(2)
    inverse = InverseKinematics(robot)
    model = JointModel(robot, ARM.compliances, None, POSITIVE)
    statuses = []
    for _ in range(60):
        joints = draw.uniform([-2.5, -0.5, -0.5, -2.5, -0.02, -2.5], [2.5, 0.8, 0.8, 2.5, 0.02, 2.5])
        near = robot.joint_map.controller_angles((joints + 0.02 * draw.choice([-1.0, 1.0], 6))[None])[0]
        pose = flange_poses(robot, joints[None])[0]
        wrench = np.tile([0.0, 0.0, -1.0], (3, 1, 1))
        asked = MapTask(pose[None, :3, :3], *wrench, np.zeros(3), np.zeros(3), FREE, near, 0.95)
        found = map_places(model, None, asked, inverse, pose[None, :3, 3])
        statuses.append(STATUSES[found.status[0]])
        if found.reached[0]:
            apart = robot.joint_map.model_angles(found.joints)[0] - joints
            assert np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))).max() < 1e-6
    assert set(statuses) == {"reached", "not_followed"}
    assert statuses.count("reached") >= 20
