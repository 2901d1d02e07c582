"""Readings of arms of the catalogue whose joints have errors of zero, for files without names."""

import numpy as np

from jointstiff.solver.mechanics.postures import Postures

PLACES = np.array([[0.1, 0.0, 0.2], [-0.15, 0.1, 0.1], [0.0, -0.2, 0.25]])  # on the flange [m]
TRACKER = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])  # a frame that is turned


def measure(known, seed=1, postures=16):
    """Return joints [deg], and positions [mm] of three targets in R0 of an arm whose zeros are off."""
    generator = np.random.default_rng(seed)
    robot = known.robot
    model = generator.uniform(-1.1, 1.1, (postures, robot.n))
    off = model + np.radians(0.15) * generator.standard_normal(robot.n)
    true = Postures(robot, off)
    points = np.einsum("nij,kj->nki", true.flange_rotation, PLACES) + true.flange_translation[:, None]
    return np.degrees(robot.joint_map.controller_angles(model)), 1e3 * points


def wide(*blocks):
    """Return blocks of columns side by side."""
    return np.hstack([np.reshape(block, (len(block), -1)) for block in blocks])


def write_bare(path, numbers):
    """Write numbers as a text file without a header."""
    np.savetxt(path, numbers, fmt="%.4f")
    return path
