"""Rotation matrices by their definitions, which share no code with the readers."""

import numpy as np


def rotation_about(vector):
    """Return the matrix (3, 3) of a rotation vector [rad], by the series of the exponential."""
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    power = total = np.eye(3)
    for order in range(1, 30):
        power = power @ cross / order
        total = total + power
    return total


def rotation_of_angles(angles):
    """Return the matrix (3, 3) of angles [°] about Z, Y', X''."""
    z, y, x = np.radians(angles)
    return rotation_about([0, 0, z]) @ rotation_about([0, y, 0]) @ rotation_about([x, 0, 0])
