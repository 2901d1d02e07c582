"""Arm whose joints are springs, measured without and under forces, in R0 or in the frame of a tracker."""

import numpy as np
from scipy.spatial.transform import Rotation
from support.measured_arms import PLACES

from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.solver.mechanics.postures import Postures

ARM = "ABB IRB 4600-60/2.05"
POINT = np.array([0.0, 0.0, 0.12])
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}
TURN = Rotation.from_euler("zyx", [122.0, 3.0, -2.0], degrees=True)
PLACED = np.array([2.4, -1.1, 0.3])


def measure(forces, seed=5, error=1e-5, place=0):
    """Return joints [deg], and positions (N, 2) of one target [m] of an arm whose joints are springs.

    `error` is the standard deviation of a coordinate [m], and `place` the number of the target's place.
    """
    robot = next(each for each in catalogue_robots() if each.name == ARM).robot
    generator = np.random.default_rng(seed)
    q = generator.uniform(-1.1, 1.1, (len(forces), robot.n))
    postures = Postures(robot, q + np.radians(0.03) * generator.standard_normal(robot.n))
    target = postures.to_base(np.tile(PLACES[place], (len(forces), 1, 1)))
    load = postures.jacobian_at(postures.to_base(np.tile(POINT, (len(forces), 1, 1))))[:, 0]
    compliances = np.array([5.0, 4.0, 5.0, 20.0, 25.0, 40.0]) * 1e-7
    twist = compliances * np.einsum("nij,ni->nj", load, forces)
    shift = np.einsum("nij,nj->ni", postures.jacobian_at(target)[:, 0], twist)
    positions = np.stack([target[:, 0], target[:, 0] + shift], axis=1)
    noise = error * generator.standard_normal(positions.shape)
    return np.degrees(robot.joint_map.controller_angles(q)), positions + noise


def in_tracker(positions, turn=TURN):
    return turn.inv().apply((positions - PLACED).reshape(-1, 3)).reshape(positions.shape)
