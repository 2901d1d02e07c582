"""Frames that two axes define, and what a nominal model says about them.

The *perpendicular frame* of a main axis and another one, both with a sense: z along the main axis; x along
the product of the other's direction with it, which is the direction of their common perpendicular; the
origin at the foot of that perpendicular on the main axis. It depends on the axes alone, also where they
meet (there x still is well defined, a vector from foot to foot is not).
"""

from __future__ import annotations

import numpy as np

from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.frames.rigid_transform import RigidTransform
from jointstiff.solver.geometry.sweeps.axis import Axis
from jointstiff.solver.robot.chain import KinematicChain

LEAST_SINE = 0.1
"""Sine of the angle between two axes below which the foot of their common perpendicular is unreliable."""


def common_feet(first: Axis, second: Axis) -> tuple[float, float]:
    """Return the feet of the common perpendicular of two axes: distances [m] from their points."""
    a, b = first.direction, second.direction
    between = second.point - first.point
    cosine = float(a @ b)
    sine2 = float(np.sum(np.cross(a, b) ** 2))
    along, back = float(between @ a), float(between @ b)
    return (along - back * cosine) / sine2, (along * cosine - back) / sine2


def perpendicular_frame(main: Axis, other: Axis) -> RigidTransform:
    """From the perpendicular frame of two axes to the frame in which they are given.

    Raises:
        MeasurementError: the axes are nearly parallel.
    """
    x = np.cross(other.direction, main.direction)
    sine = float(np.linalg.norm(x))
    if sine < LEAST_SINE:
        raise MeasurementError(
            "the two axes that should define the frame are nearly parallel "
            f"({np.degrees(np.arcsin(sine)):.2g}°)",
            where="sweeps",
            remedy="give the transform explicitly; parallel axes do not define a frame",
        )
    x = x / sine
    z = main.direction
    foot, _ = common_feet(main, other)
    return RigidTransform(np.column_stack([x, np.cross(z, x), z]), main.at(foot))


def chain_axes(chain: KinematicChain) -> tuple[tuple[Axis, ...], RigidTransform]:
    """Axes of a chain in R0 at angle zero, their points at the joints' origins, and flange to R0 there."""
    R, t = np.eye(3), np.zeros(3)
    axes = []
    for joint in chain.joints:
        t = t + R @ joint.translation
        R = R @ joint.rotation
        if joint.is_moving:
            axes.append(Axis.through(t, R @ joint.axis))
    return tuple(axes), RigidTransform(R, t)
