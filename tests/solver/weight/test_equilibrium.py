"""Sag under own weight: the solver's balance beside the minimum of the potential energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.sagging import LOAD_POINT, POINTS, burden_of, campaign, robot_of

from jointstiff.simulator import default_arm, random_configurations
from jointstiff.simulator.own_weight import Balancer, default_bodies, energy, sag
from jointstiff.solver.geometry.poses import PoseState, chain_axes
from jointstiff.solver.predict.models import OwnWeight
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Body
from jointstiff.solver.weight.bodies import Balancer as StatedBalancer
from jointstiff.solver.weight.bodies import Burden, rows_at

ARM, BODIES = default_arm(), default_bodies()
ROBOT = robot_of(ARM)
SPRING = Balancer(3e4, 0.3, np.array([-0.2, 0.0, 0.5]), 1, np.array([-0.3, 0.0, 0.2]))
SPRING_STATED = StatedBalancer(1, (-0.2, 0.0, 0.5), (-0.3, 0.0, 0.2), (3e4, 3e4), (9e3, 9e3))


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
