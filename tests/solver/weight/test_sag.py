"""Sag under own weight, predicted and corrected, beside the minimum of the potential energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.sagging import (
    ARM,
    BODIES,
    LOAD_POINT,
    OFF,
    POINTS,
    ROBOT,
    SPRING,
    burden_of,
    campaign,
    stated_spring,
)

from jointstiff.simulator import random_configurations
from jointstiff.simulator.own_weight import energy, sag
from jointstiff.solver.convex.problem import Bounds, Constraints
from jointstiff.solver.errors import RequestError
from jointstiff.solver.geometry.poses import PoseState, chain_axes
from jointstiff.solver.predict.forward import CorrectionLimits, LoadCases, compensate
from jointstiff.solver.predict.models import JointModel, OwnWeight
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Body
from jointstiff.solver.weight.bodies import Burden, rows_at
from jointstiff.solver.weight.identification import identify_weight

SPRING_STATED = stated_spring((3e4, 3e4), (9e3, 9e3))
COUNT = 30


def test_the_sag_is_where_the_energy_has_its_minimum():
    q = random_configurations(ARM, 20)
    force, point = np.array([[300.0, -200.0, -900.0]] * 20), np.tile(LOAD_POINT, (20, 1))
    theta = sag(ARM, BODIES, q, force=force, load_point=point, balancer=SPRING)
    least = energy(ARM, BODIES, q, theta, force, point, SPRING)
    for step in 1e-5 * np.eye(6):
        for sign in (-1.0, 1.0):
            assert (energy(ARM, BODIES, q, theta + sign * step, force, point, SPRING) > least).all()


def rows_of(readings, theta=None):
    """Return the rows about the nominal geometry, at a sag of zero if None."""
    axes, flange = chain_axes(ROBOT.chain)
    theta = np.zeros(readings.poses.angles.shape) if theta is None else theta
    state = PoseState(axes, flange.apply(POINTS), np.zeros(len(theta)))
    return rows_at(ROBOT, readings, readings.poses.whitened, state, theta, theta[0])


@pytest.mark.parametrize("spring", [None, SPRING])
@pytest.mark.parametrize("payload", [0.0, 120.0])
def test_the_balance_of_the_solver_holds_where_the_simulator_rests(spring, payload):
    stated = burden_of(BODIES, balancers=[SPRING_STATED] if spring else [])
    readings = campaign(sigma=0.0, payload=payload, balancer=spring, stated=stated)
    q = readings.poses.angles
    theta = sag(ARM, BODIES, q, force=readings.force, load_point=readings.load_point, balancer=spring)
    flange_at = Configurations(ROBOT, q + ARM.compliances * rows_of(readings, theta).torques.known)
    places = flange_at.to_base(np.broadcast_to(POINTS, (len(q), *POINTS.shape)))
    np.testing.assert_allclose(places, ARM.posture(q + theta).targets_to_base(POINTS), rtol=0, atol=1e-12)


def test_torques_are_those_of_the_weights_in_predictions():
    readings = campaign(sigma=0.0)
    configurations = Configurations(ROBOT, readings.poses.angles)
    torque, _ = OwnWeight(BODIES.masses, BODIES.centres).torque_and_stiffness(ROBOT, configurations)
    np.testing.assert_allclose(rows_of(readings).torques.known, torque, atol=1e-9)


FOREARM = Body("forearm", 3, 80.0, 70.0, 90.0, (0.4, 0.1, 0.2), radius=0.1)
LOOSE = replace(SPRING_STATED, rate=(2e4, 4e4), pull=(8e3, 1e4))


@pytest.mark.parametrize(
    ("column", "size", "body", "spring"),
    [  # in half-widths: 10 kg, 0.1 m of 80 kg, 1e4 N/m, 1e3 N
        (0, 0.2, replace(FOREARM, mass=82.0, least=72.0, most=92.0), LOOSE),
        (2, 0.5, replace(FOREARM, centre=(0.4, 0.15, 0.2)), LOOSE),
        (4, 0.01, FOREARM, replace(LOOSE, rate=(2.01e4, 4.01e4))),
        (5, 0.01, FOREARM, replace(LOOSE, pull=(8.01e3, 1.001e4))),
    ],
    ids=["mass", "centre", "rate", "pull"],
)
def test_torques_of_the_unknowns_at_their_bounds_are_differences_of_known_torques(column, size, body, spring):
    burdens = Burden((FOREARM,), (LOOSE,)), Burden((body,), (spring,))
    before, after = (rows_of(campaign(sigma=0.0, stated=burden)).torques for burden in burdens)
    np.testing.assert_allclose(after.known - before.known, size * before.unit[..., column], atol=1e-8)
    assert np.abs(after.known - before.known).max() > 1.0


def cases(load=0.0):
    q, still = random_configurations(ARM, COUNT, seed=91), np.zeros((COUNT, 3))
    point = np.tile(LOAD_POINT, (COUNT, 1))
    return LoadCases(q, np.tile([0.0, 0.0, -load], (COUNT, 1)), still, point, point)


def model_of(found):
    return JointModel(ROBOT, found.fit.compliance, None, Constraints(Bounds.positive(6)), found.weight)


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
    return identify_weight(ROBOT, campaign(bodies=OFF, stated=burden_of(BODIES, 0.1, 0.01), seed=4))


@pytest.mark.parametrize("load", [0.0, 900.0])
def test_positions_tell_the_sag_better_than_masses_and_compliances(uncertain, load):
    found, truth = model_of(uncertain).deflect(cases(load)), displaced(OFF, cases(load))
    interval = found.interval(0.95)[:, :3]
    assert ((interval[..., 0] <= truth) & (truth <= interval[..., 1])).mean() >= 0.9
    along = found.interval_along(np.tile([0.0, 0.0, 1.0], (COUNT, 1)), 0.95)
    np.testing.assert_allclose(along, interval[:, 2], rtol=0, atol=1e-15)
    if not load:
        off = np.linalg.norm(found.displacement - truth, axis=1)
        assert np.median(off) < 0.03 * np.median(np.linalg.norm(truth, axis=1))
        wide = np.ptp(uncertain.joints[1].joint.compliance_interval) / uncertain.fit.compliance[1]
        assert np.median(np.ptp(interval[:, 2], axis=1)) < 0.5 * wide * np.abs(truth[:, 2]).max()


def test_a_corrected_command_brings_the_bent_arm_to_absolute_places(uncertain):
    wanted = cases(900.0)
    found = compensate(model_of(uncertain), wanted, CorrectionLimits(displacement=1.0, rotation=1.0))
    assert np.abs(found.residual).max() < 1e-12
    reached = displaced(OFF, replace(wanted, joints=found.commanded))
    reached += ARM.posture(found.commanded).point_to_base(wanted.place)
    off = np.linalg.norm(reached - ARM.posture(wanted.joints).point_to_base(wanted.place), axis=1)
    before = np.linalg.norm(found.uncorrected[:, :3], axis=1)
    assert np.median(off) < 0.05 * np.median(before)


def test_a_joint_of_whose_sag_nothing_is_told_leaves_no_prediction(uncertain):
    assert not model_of(uncertain).deflect(cases()).unseen.any()  # joint 1 carries no weight
    hidden = uncertain.weight.root.reshape(-1, uncertain.weight.root.shape[1]).copy()
    hidden[1] = 0.0
    hidden[6 + 24 : 6 + 48] = 0.0
    model = replace(model_of(uncertain), weight=replace(uncertain.weight, root=hidden))
    unseen = model.deflect(cases()).unseen
    assert unseen[:, 1].mean() > 0.9
    assert not np.delete(unseen, 1, axis=1).any()
    with pytest.raises(RequestError, match="do not determine"):
        compensate(model, cases())


def test_masses_that_joints_feel_differently_have_the_stiffness_of_their_torques():
    draws = np.random.default_rng(5)
    weight = OwnWeight(draws.uniform(10.0, 100.0, (6, 6)), draws.standard_normal((6, 6, 3)))
    q, step = cases().joints, 1e-6

    def torque(angles):
        return weight.torque_and_stiffness(ROBOT, Configurations(ROBOT, angles))[0]

    stiffness = weight.torque_and_stiffness(ROBOT, Configurations(ROBOT, q))[1]
    slopes = [(torque(q + step * e) - torque(q - step * e)) / (2.0 * step) for e in np.eye(6)]
    np.testing.assert_allclose(stiffness, np.stack(slopes, axis=-1), atol=1e-5)
