"""A correction where the force turns at once: slow enough for the joints, and nothing elsewhere changes."""

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.catalogue_arms import build_nominal_robots

from jointstiff.solver.correct.correct import RowStatus, Waypoints, correct, turn_loads
from jointstiff.solver.correct.prior import build_prior_model
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import Postures

FEED = 0.5
FORCE = (-150.0, 350.0, -120.0, 0.0, 0.0, 0.0)
"""Along feed, normal and tool axis [N, N·m]."""
LANES, WIDTH, PITCH = 4, 0.06, 0.012
TOOL, BASE = np.eye(4), np.eye(4)
TOOL[:3, 3] = [0.1, 0.0, 0.3]


@lru_cache
def arm():
    """An arm of the catalogue that is twice as soft as its payload suggests, and a start."""
    robot = next(each.robot for each in build_nominal_robots() if each.name == "ABB IRB 6640-185/2.8")
    model = build_prior_model(robot)
    soft = replace(model, compliance=2.0 * model.compliance)
    start = np.radians([10.0, 35.0, 10.0, 20.0, 60.0, 30.0])
    return soft, InverseKinematics(robot), start


def pocket(spacing):
    """A pocket of lanes with square corners, about the pose of the start: waypoints, corners."""
    model, _, start = arm()
    corners = [(WIDTH * ((lane + side) % 2), PITCH * lane) for lane in range(LANES) for side in range(2)]
    places, at_corner = [corners[0]], [True]
    for begin, end in pairwise(corners):
        count = round(float(np.linalg.norm(np.subtract(end, begin))) / spacing)
        line = np.linspace(begin, end, count + 1)[1:]
        places += [tuple(each) for each in line]
        at_corner += [False] * (count - 1) + [True]
    q = model.robot.joint_map.model_angles(start[None])
    first = Postures(model.robot, q).flange_pose[0] @ TOOL
    poses = np.tile(first, (len(places), 1, 1))
    poses[:, :3, 3] += np.pad(np.array(places), ((0, 0), (0, 1))) @ first[:3, :3].T
    return Waypoints(poses, TOOL, BASE, start=start), np.array(at_corner)


def corrected(spacing, feed):
    points, at_corner = pocket(spacing)
    model, inverse, _ = arm()
    loads = turn_loads(points.find_axes("feed"), np.tile(FORCE, (len(points), 1)))
    return correct(model, None, inverse, points, loads, feed=feed), points, at_corner


def needed_shares(rows):
    """Greatest part (N − 1,) of a joint's speed on each line, at the feed along the corrected path."""
    robot = arm()[0].robot
    steps = np.linalg.norm(np.diff(rows.poses[:, :3, 3], axis=0), axis=1)
    turns = np.abs(np.diff(robot.joint_map.model_angles(rows.joints), axis=0))
    return (FEED * turns / steps[:, None] / robot.speeds).max(axis=1)


def lengths_from_corner(points, at_corner):
    lengths = points.lengths
    return np.abs(lengths[:, None] - lengths[at_corner][1:-1]).min(axis=1)


def test_joints_keep_half_of_their_speed_at_the_corners_of_a_pocket():
    at_once, _, _ = corrected(1e-3, None)
    rows, points, at_corner = corrected(1e-3, FEED)
    assert needed_shares(at_once).max() > 0.6
    assert needed_shares(rows).max() <= 0.5
    is_blended = np.isfinite(rows.blend_length)
    assert is_blended.sum() < 0.2 * len(rows)
    far = lengths_from_corner(points, at_corner) > 0.5 * rows.blend_length[is_blended].max() + 2e-3
    for blended, other in ((rows.joints, at_once.joints), (rows.residual, at_once.residual)):
        assert np.array_equal(blended[far], other[far])
    assert not is_blended[far].any()


def test_what_is_left_at_a_corner_is_stated():
    rows, points, _ = corrected(1e-3, FEED)
    is_blended = np.isfinite(rows.blend_length)
    assert rows.residual[~is_blended].max() < 1e-9
    deflection = np.linalg.norm(rows.deflection, axis=1)
    assert 1e-5 < rows.residual[is_blended].max() < deflection.max()
    # The predicted place of the loaded tool, by the model: the residual is its distance from the pose.
    model, _, _ = arm()
    loads = turn_loads(points.find_axes("feed"), np.tile(FORCE, (len(points), 1)))
    q = model.robot.joint_map.model_angles(rows.joints)
    for _ in range(6):
        at = Postures(model.robot, q)
        torque = at.load(np.tile(TOOL[:3, 3], (len(q), 1)), loads[:, :3], loads[:, 3:])[1]
        q = model.robot.joint_map.model_angles(rows.joints) + model.compliance * torque
    reached = Postures(model.robot, q).to_base(np.tile(TOOL[:3, 3], (len(q), 1, 1)))[:, 0]
    left = np.linalg.norm(reached - points.poses[:, :3, 3], axis=1)
    assert rows.residual == pytest.approx(left, abs=1e-9)


def test_points_far_apart_and_a_force_that_does_not_turn_are_corrected_in_full():
    rows, _, _ = corrected(10e-3, FEED)
    assert np.isnan(rows.blend_length).all()
    assert rows.residual.max() < 1e-9
    points, _ = pocket(1e-3)
    model, inverse, _ = arm()
    steady = np.tile([100.0, 300.0, -100.0, 0.0, 0.0, 0.0], (len(points), 1))
    rows = correct(model, None, inverse, points, steady, feed=FEED)
    assert np.isnan(rows.blend_length).all()


def test_a_turning_tool_does_not_matter_where_the_force_follows_it_smoothly():
    points, _ = pocket(1e-3)
    model, inverse, _ = arm()
    turn = Rotation.from_rotvec(np.linspace(0.0, 0.5, len(points))[:, None] * [0.0, 0.0, 1.0])
    forces = turn.apply([100.0, 300.0, -100.0])
    rows = correct(model, None, inverse, points, np.pad(forces, ((0, 0), (0, 3))), feed=FEED)
    assert np.isnan(rows.blend_length).all()


def test_a_row_whose_load_is_too_great_does_not_bend_its_neighbours():
    points, _ = pocket(1e-3)
    model, inverse, _ = arm()
    forces = np.tile(FORCE, (len(points), 1))
    forces[30] *= 3e4  # in the middle of the first lane
    loads = turn_loads(points.find_axes("feed"), forces)
    rows = correct(model, None, inverse, points, loads, feed=FEED)
    without = correct(model, None, inverse, points, loads)
    overloaded = rows.status == RowStatus.OVERLOADED
    assert overloaded.sum() == 1
    near = np.abs(np.arange(len(points)) - 30) <= 5
    np.testing.assert_allclose(rows.joints[near & ~overloaded], without.joints[near & ~overloaded], atol=1e-9)
    assert np.isfinite(rows.blend_length).any()  # the corners are still blended
