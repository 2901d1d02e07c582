"""Prismatic joints against springs that balance loads exactly, an energy, and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import estimate
from support.slides import arm_on_rail, scara
from support.springs import SIGMA, SpringCampaign, load_cases, robot_of

from jointstiff.simulator import equilibrium, torques
from jointstiff.simulator.own_weight import Bodies, sag
from jointstiff.solver.estimation.solution import Bounds, Constraints
from jointstiff.solver.mechanics.block import OwnWeight, whole_block
from jointstiff.solver.mechanics.configuration import Configurations, find_wrist, joint_frames
from jointstiff.solver.mechanics.springs import complementary_stiffness
from jointstiff.solver.predict.models import JointModel

ROBOTS = {"SCARA": scara(), "arm on a rail": arm_on_rail()}
every_robot = pytest.mark.parametrize("arm", ROBOTS.values(), ids=ROBOTS.keys())


def exact_readings(arm, *, configurations=24, seed=1, force=1500.0):
    campaign = SpringCampaign.of(arm, configurations=configurations, seed=seed, force=force)
    return robot_of(arm), campaign.measurements(campaign.unloaded, campaign.loaded, sigma=SIGMA)


def model_of(arm, weight=None):
    n = len(arm.stiffnesses)
    return JointModel(robot_of(arm), arm.compliances, None, Constraints(Bounds.positive(n)), weight=weight)


@every_robot
def test_columns_and_efforts_are_those_of_the_simulator(arm):
    robot, load = robot_of(arm), load_cases(arm)
    at = Configurations(robot, load.joints)
    posture = arm.posture(load.joints)
    point = posture.point_to_base(load.load_point)
    columns, effort = at.load(load.load_point, load.force, load.moment)
    np.testing.assert_allclose(columns, posture.velocities(point).transpose(0, 2, 1), atol=1e-14)
    np.testing.assert_allclose(
        effort, torques(arm, load.joints, load.force, load.moment, load.load_point), atol=1e-10
    )
    (slide,) = arm.prismatic
    along = np.einsum("bi,bi->b", posture.axis_directions[:, slide], load.force)
    np.testing.assert_allclose(effort[:, slide], along, atol=1e-10)
    assert not at.angular_jacobian[:, :, slide].any()


@every_robot
def test_complementary_stiffness_is_the_derivative_of_the_efforts(arm):
    robot, measurements = exact_readings(arm, configurations=5)
    plan, step = SpringCampaign.of(arm, configurations=5, seed=1).experiment, 1e-6
    measurements = replace(measurements, moment=np.tile([40.0, -60.0, 90.0], (5, 1)))
    wrench = (measurements.force, measurements.moment, measurements.load_point)
    expected = np.stack(
        [
            (torques(arm, plan.joints + h, *wrench) - torques(arm, plan.joints - h, *wrench)) / (2 * step)
            for h in step * np.eye(len(arm.stiffnesses))
        ],
        axis=-1,
    )
    found = complementary_stiffness(whole_block(robot, measurements))
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@every_robot
@pytest.mark.parametrize("method", ["partial_pose", "complete_pose"])
def test_identification_is_exact(arm, method):
    """K_c is included up to the third order of the deflection: the error falls with the load's square."""
    options = {"method": method, "complementary_stiffness": "included"}
    errors = []
    for force in (500.0, 50.0, 10.0):
        found = estimate(*exact_readings(arm, force=force), **options)
        errors.append(np.abs(found.compliance * arm.stiffnesses - 1.0).max())
    assert errors[0] < 2e-6
    assert errors[1] < 0.02 * errors[0]
    assert errors[2] < 1e-9


@every_robot
@pytest.mark.parametrize("moment", [0.0, 60.0])
def test_predictions_are_those_of_the_exact_balance(arm, moment):
    load = load_cases(arm, moment=moment)
    found = model_of(arm).deflect(load)
    bent = load.joints + equilibrium(arm, load.joints, load.force, load.moment, load.load_point)
    before, after = (arm.posture(q).point_to_base(load.place) for q in (load.joints, bent))
    np.testing.assert_allclose(found.displacement, after - before, rtol=0, atol=5e-14)


def bodies_of(arm, seed=7):
    generator = np.random.default_rng(seed)
    n = len(arm.stiffnesses)
    return Bodies(
        generator.uniform(5.0, 60.0, n), generator.uniform(-0.2, 0.2, (n, 3)), np.array([1.0, 2.0, -9.0])
    )


@every_robot
def test_own_weight_of_a_prismatic_joint_is_the_weight_along_its_axis(arm):
    robot, bodies = robot_of(arm), bodies_of(arm)
    frames, origins = joint_frames(robot, np.zeros((1, robot.n)))
    centre = np.einsum("jki,jk->ji", frames[0], arm.axis_points + bodies.centres - origins[0])
    weight = OwnWeight(bodies.masses, centre, bodies.gravity)
    q = load_cases(arm).joints
    effort, slope = weight.torque_and_stiffness(robot, Configurations(robot, q))
    (slide,) = arm.prismatic
    along = arm.posture(q).axis_directions[:, slide] @ bodies.gravity
    np.testing.assert_allclose(effort[:, slide], along * bodies.masses[slide:].sum(), rtol=1e-12)
    step = 1e-6
    for k, h in enumerate(step * np.eye(robot.n)):
        ahead, behind = (weight.torque_and_stiffness(robot, Configurations(robot, q + s))[0] for s in (h, -h))
        np.testing.assert_allclose(slope[:, :, k], (ahead - behind) / (2 * step), atol=1e-5)
    # The springs' sag by the energy's minimum: relative to the posture that the weight alone takes.
    load = load_cases(arm, force=300.0, moment=0.0)
    at_rest = load.joints + sag(arm, bodies, load.joints)
    loaded = load.joints + sag(arm, bodies, load.joints, force=load.force, load_point=load.load_point)
    before, after = (arm.posture(each).point_to_base(load.place) for each in (at_rest, loaded))
    found = model_of(arm, weight).deflect(replace(load, joints=at_rest))
    np.testing.assert_allclose(found.displacement, after - before, rtol=0, atol=5e-12)


def test_a_wrist_turns():
    assert find_wrist(robot_of(scara())) is None
    assert find_wrist(robot_of(arm_on_rail())).spherical
