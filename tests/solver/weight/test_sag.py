"""Sag predicted from own weight: beside the minimum of the potential energy, and corrected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.sagging import LOAD_POINT, burden_of, campaign, robot_of

from jointstiff.simulator import default_arm, random_configurations
from jointstiff.simulator.own_weight import Balancer, default_bodies, sag
from jointstiff.solver.convex.problem import Bounds, Constraints
from jointstiff.solver.errors import RequestError
from jointstiff.solver.predict.forward import CorrectionLimits, LoadCases, compensate
from jointstiff.solver.predict.models import JointModel, OwnWeight
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.weight.bodies import Balancer as StatedBalancer
from jointstiff.solver.weight.identification import identify_weight

ARM, BODIES = default_arm(), default_bodies()
ROBOT = robot_of(ARM)
COUNT = 30


def cases(load=0.0):
    q, still, point = (
        random_configurations(ARM, COUNT, seed=91),
        np.zeros((COUNT, 3)),
        np.tile(LOAD_POINT, (COUNT, 1)),
    )
    return LoadCases(q, np.tile([0.0, 0.0, -load], (COUNT, 1)), still, point, point)


def model_of(estimate):
    return JointModel(ROBOT, estimate.fit.compliance, None, Constraints(Bounds.positive(6)), estimate.weight)


def displaced(bodies, asked):
    """Return the displacement from the arm that does not bend, by the simulator."""
    theta = sag(ARM, bodies, asked.joints, force=asked.force, load_point=asked.load_point)
    there, here = (ARM.posture(q).point_to_base(asked.place) for q in (asked.joints + theta, asked.joints))
    return there - here


@pytest.mark.parametrize("load", [0.0, 900.0])
def test_exact_readings_and_masses_give_the_sag_exactly(load):
    found = model_of(identify_weight(ROBOT, campaign(sigma=0.0))).deflect(cases(load))
    truth = displaced(BODIES, cases(load))
    assert np.linalg.norm(truth, axis=1).max() > 3e-3
    np.testing.assert_allclose(found.displacement, truth, rtol=0, atol=2e-8)


@pytest.fixture(scope="module")
def uncertain():
    """40 postures, true masses 8 % off, stated within ± 10 %."""
    signs = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    bodies = replace(BODIES, masses=BODIES.masses * (1.0 + 0.08 * signs))
    readings = campaign(bodies=bodies, stated=burden_of(BODIES, 0.1, 0.01), seed=4)
    return bodies, identify_weight(ROBOT, readings)


@pytest.mark.parametrize("load", [0.0, 900.0])
def test_positions_tell_the_sag_better_than_masses_and_compliances(uncertain, load):
    bodies, estimate = uncertain
    found, truth = model_of(estimate).deflect(cases(load)), displaced(bodies, cases(load))
    interval = found.interval(0.95)[:, :3]
    assert ((interval[..., 0] <= truth) & (truth <= interval[..., 1])).mean() >= 0.9
    along = found.interval_along(np.tile([0.0, 0.0, 1.0], (COUNT, 1)), 0.95)
    np.testing.assert_allclose(along, interval[:, 2], rtol=0, atol=1e-15)
    if not load:
        off = np.linalg.norm(found.displacement - truth, axis=1)
        assert np.median(off) < 0.03 * np.median(np.linalg.norm(truth, axis=1))
        wide = np.ptp(estimate.joints[1].joint.compliance_interval) / estimate.fit.compliance[1]
        assert np.median(np.ptp(interval[:, 2], axis=1)) < 0.5 * wide * np.abs(truth[:, 2]).max()


def test_a_corrected_command_brings_the_bent_arm_to_absolute_places(uncertain):
    bodies, estimate = uncertain
    wanted = cases(900.0)
    found = compensate(model_of(estimate), wanted, CorrectionLimits(displacement=1.0, rotation=1.0))
    assert np.abs(found.residual).max() < 1e-12
    reached = displaced(bodies, replace(wanted, joints=found.commanded))
    reached += ARM.posture(found.commanded).point_to_base(wanted.place)
    off = np.linalg.norm(reached - ARM.posture(wanted.joints).point_to_base(wanted.place), axis=1)
    before = np.linalg.norm(found.uncorrected[:, :3], axis=1)
    assert np.median(off) < 0.05 * np.median(before)


def test_a_joint_of_whose_sag_nothing_is_told_leaves_no_prediction(uncertain):
    _, estimate = uncertain
    assert not model_of(estimate).deflect(cases()).unseen.any()  # joint 1 carries no weight
    hidden = estimate.weight.root.reshape(-1, estimate.weight.root.shape[1]).copy()
    hidden[1] = 0.0
    hidden[6 + 24 : 6 + 48] = 0.0
    model = replace(model_of(estimate), weight=replace(estimate.weight, root=hidden))
    unseen = model.deflect(cases()).unseen
    assert unseen[:, 1].mean() > 0.9
    assert not np.delete(unseen, 1, axis=1).any()
    with pytest.raises(RequestError, match="do not determine"):
        compensate(model, cases())


def test_springs_leave_no_sag_to_predict():
    spring = Balancer(3e4, 0.3, np.array([-0.2, 0.0, 0.5]), 1, np.array([-0.3, 0.0, 0.2]))
    stated = StatedBalancer(1, (-0.2, 0.0, 0.5), (-0.3, 0.0, 0.2), (2.7e4, 3.3e4), (8e3, 1e4))
    readings = campaign(balancer=spring, stated=burden_of(BODIES, balancers=[stated]))
    assert identify_weight(ROBOT, readings).weight is None


def test_masses_that_joints_feel_differently_have_the_stiffness_of_their_torques():
    draws = np.random.default_rng(5)
    weight = OwnWeight(draws.uniform(10.0, 100.0, (6, 6)), draws.standard_normal((6, 6, 3)))
    q, step = cases().joints, 1e-6

    def torque(angles):
        return weight.torque_and_stiffness(ROBOT, Configurations(ROBOT, angles))[0]

    stiffness = weight.torque_and_stiffness(ROBOT, Configurations(ROBOT, q))[1]
    slopes = [(torque(q + step * e) - torque(q - step * e)) / (2.0 * step) for e in np.eye(6)]
    np.testing.assert_allclose(stiffness, np.stack(slopes, axis=-1), atol=1e-5)
