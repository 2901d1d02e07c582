"""Robots with prismatic joints: a SCARA with its z, a six-axis arm on a rail, and a gantry."""

import numpy as np

from jointstiff.simulator import SpringArm, default_arm


def scara(reach: tuple[float, float] = (0.45, 0.40)) -> SpringArm:
    """A SCARA of the 10 kg class: two vertical axes, the spindle's z downwards, and its rotation."""
    z = np.array([0.0, 0.0, 1.0])
    first, second = reach
    points = np.array(
        [[0.0, 0.0, 0.0], [first, 0.0, 0.3], [first + second, 0.0, 0.3], [first + second, 0.0, 0.3]]
    )
    return SpringArm(
        axis_points=points,
        axis_directions=np.array([z, z, -z, -z]),
        flange_rotation=np.diag([1.0, -1.0, -1.0]),
        flange_translation=np.array([first + second, 0.0, 0.2]),
        stiffnesses=np.array([0.6e6, 0.25e6, 4.0e6, 0.03e6]),
        limits=np.array([[-2.4, 2.4], [-2.6, 2.6], [0.0, 0.42], [-6.0, 6.0]]),
        prismatic=(2,),
    )


def arm_on_rail() -> SpringArm:
    """The default arm, carried along y of R0 by a rail of 6 m."""
    arm = default_arm()
    return SpringArm(
        axis_points=np.vstack([np.zeros(3), arm.axis_points]),
        axis_directions=np.vstack([[0.0, 1.0, 0.0], arm.axis_directions]),
        flange_rotation=arm.flange_rotation,
        flange_translation=arm.flange_translation,
        stiffnesses=np.concatenate([[20e6], arm.stiffnesses]),
        limits=np.vstack([[-1.0, 5.0], arm.limits]),
        prismatic=(0,),
    )


def gantry() -> SpringArm:
    """Three linear axes along x, y and z of R0, with a flange that points downwards."""
    return SpringArm(
        axis_points=np.zeros((3, 3)),
        axis_directions=np.eye(3),
        flange_rotation=np.diag([1.0, -1.0, -1.0]),
        flange_translation=np.array([0.0, 0.0, 0.5]),
        stiffnesses=np.array([20e6, 20e6, 10e6]),
        limits=np.array([[0.0, 3.0], [0.0, 2.0], [0.0, 1.0]]),
        prismatic=(0, 1, 2),
    )
