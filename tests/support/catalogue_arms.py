"""Arms of the catalogue as springs: what a tracker reads of them, by the controller's angles."""

from functools import cache

import numpy as np

from jointstiff.service.conversion.catalogue import catalogue, nominal_robot
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator import TARGETS, SpringArm, deflections
from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import KnownRobot, Robot

from .springs import SIGMA, readings_of

STIFFNESSES = np.array([3.8e6, 3.1e6, 2.5e6, 0.45e6, 0.25e6, 0.09e6])


@cache
def build_nominal_robots() -> tuple[KnownRobot, ...]:
    """Return all arms of the catalogue."""
    return tuple(KnownRobot(arm.name, prepare_robot(nominal_robot(arm)).robot) for arm in catalogue().arms)


def spring_arm(robot: Robot) -> SpringArm:
    """Return an arm of six springs with the axes of a robot."""
    at = Postures(robot, np.zeros((1, robot.n)))
    frames, origins = at.joint_frames
    axes = np.einsum("jik,jk->ji", frames[0], robot.axes)
    return SpringArm(origins[0], axes, at.flange_rotation[0], at.flange_translation[0], STIFFNESSES)


def readings_on(
    robot: Robot, seed: int, *, configurations: int = 8, length: float = 5e-4, angle: float = 4e-4
) -> Measurements:
    """Return noisy readings under pulls of 400 N on a real arm, whose links are off its model.

    Args:
        robot: nominal model and joint map of the arm.
        seed: of postures, forces, errors of links and noise.
        configurations: N.
        length, angle: errors of each link [m] and axis [rad].
    """
    draw = np.random.default_rng(seed)
    arm = spring_arm(robot)
    real = with_link_errors(arm, length=length, angle=angle, seed=seed)
    q = draw.uniform(-1.2, 1.2, (configurations, robot.n))
    force = draw.standard_normal((configurations, 3))
    force *= 400.0 / np.linalg.norm(force, axis=1)[:, None]
    load_point = np.broadcast_to([0.0, 0.0, 0.15], force.shape)
    states = deflections(real, q, force, 0.0 * force, load_point, np.array(list(TARGETS.values())))
    unloaded, loaded = (state + SIGMA * draw.standard_normal(state.shape) for state in states)
    joints = np.linalg.solve(robot.joint_map.matrix, (q - robot.joint_map.offset).T).T
    return readings_of(joints, force, load_point[0], unloaded, loaded - unloaded, sigma=SIGMA)
