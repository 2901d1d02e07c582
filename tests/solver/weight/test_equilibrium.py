"""Sag under own weight: the solver's balance beside the minimum of the potential energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.sagging import LOAD_POINT, POINTS, burden_of, campaign, robot_of

from jointstiff.simulator import default_arm, random_configurations
from jointstiff.simulator.own_weight import Balancer, default_bodies, energy, sag
from jointstiff.solver.geometry.charts import RigidTransform
from jointstiff.solver.geometry.poses import PoseState, chain_axes
from jointstiff.solver.predict.models import OwnWeight
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Body
from jointstiff.solver.weight import bodies as solver_bodies
from jointstiff.solver.weight.regressor import Frames, rows_at

ARM, BODIES = default_arm(), default_bodies()
ROBOT = robot_of(ARM)
SPRING = Balancer(3e4, 0.3, np.array([-0.2, 0.0, 0.5]), 1, np.array([-0.3, 0.0, 0.2]))
SPRING_STATED = solver_bodies.Balancer(1, (-0.2, 0.0, 0.5), (-0.3, 0.0, 0.2), (3e4, 3e4), (9e3, 9e3))


def test_the_sag_is_where_the_energy_has_its_minimum():
    q = random_configurations(ARM, 20)
    force, point = np.array([[300.0, -200.0, -900.0]] * 20), np.tile(LOAD_POINT, (20, 1))
    theta = sag(ARM, BODIES, q, force=force, load_point=point, balancer=SPRING)
    least = energy(ARM, BODIES, q, theta, force, point, SPRING)
    for step in 1e-5 * np.eye(6):
        for sign in (-1.0, 1.0):
            assert (energy(ARM, BODIES, q, theta + sign * step, force, point, SPRING) > least).all()


@pytest.mark.parametrize("spring", [None, SPRING])
@pytest.mark.parametrize("payload", [0.0, 120.0])
def test_the_balance_of_the_solver_holds_where_the_simulator_rests(spring, payload):
    stated = burden_of(BODIES, balancers=[SPRING_STATED] if spring else [])
    readings = campaign(sigma=0.0, payload=payload, balancer=spring, stated=stated)
    rest = ARM.posture(readings.poses.angles + _sag(readings, spring, payload)).targets_to_base(POINTS)

    axes, flange = chain_axes(ROBOT.chain)
    state = PoseState(axes, flange.apply(POINTS), np.zeros(len(readings.force)))
    exact = _sag(readings, spring, payload)
    whitened = readings.poses.whitened
    rows = rows_at(readings, whitened, Frames.of(ROBOT, RigidTransform.identity()), state, exact, exact[0])
    balanced = ARM.compliances * rows.torques.known
    flange_at = Configurations(ROBOT, readings.poses.angles + balanced)
    places = flange_at.to_base(np.broadcast_to(POINTS, (len(exact), *POINTS.shape)))
    assert np.abs(places - rest).max() <= 1e-12


def _sag(readings, spring, payload):
    q = readings.poses.angles[:40]
    loads = [np.zeros(3), payload * BODIES.gravity][: 2 if payload else 1]
    return np.concatenate(
        [sag(ARM, BODIES, q, force=force, load_point=LOAD_POINT, balancer=spring) for force in loads]
    )


def test_torques_are_those_of_the_weights_in_predictions():
    readings = campaign(sigma=0.0)
    axes, flange = chain_axes(ROBOT.chain)
    state = PoseState(axes, flange.apply(POINTS), np.zeros(40))
    none = np.zeros((40, 6))
    whitened = readings.poses.whitened
    rows = rows_at(readings, whitened, Frames.of(ROBOT, RigidTransform.identity()), state, none, none[0])
    weight = OwnWeight(BODIES.masses, BODIES.centres)
    configurations = Configurations(ROBOT, readings.poses.angles)
    torque, _ = weight.torque_and_stiffness(ROBOT, configurations)
    np.testing.assert_allclose(rows.torques.known, torque, atol=1e-9)


@pytest.mark.parametrize("what", ["mass", "centre", "rate", "pull"])
def test_torques_of_the_unknowns_at_their_bounds_are_differences_of_known_torques(what):
    body = Body("forearm", 3, 80.0, 70.0, 90.0, (0.4, 0.1, 0.2), radius=0.1)
    spring = replace(SPRING_STATED, rate=(2e4, 4e4), pull=(8e3, 1e4))
    burden = solver_bodies.Burden((body,), (spring,))
    # in half-widths: 10 kg, 0.1 m of 80 kg, 1e4 N/m, 1e3 N
    steps = {"mass": (0, 0.2), "centre": (2, 0.5), "rate": (4, 0.01), "pull": (5, 0.01)}
    column, size = steps[what]
    changed = {
        "mass": replace(burden, bodies=(replace(body, mass=82.0, least=72.0, most=92.0),)),
        "centre": replace(burden, bodies=(replace(body, centre=(0.4, 0.15, 0.2)),)),
        "rate": replace(burden, balancers=(replace(spring, rate=(2.01e4, 4.01e4)),)),
        "pull": replace(burden, balancers=(replace(spring, pull=(8.01e3, 1.001e4)),)),
    }[what]
    before, after = (_torques(each) for each in (burden, changed))
    np.testing.assert_allclose(after.known - before.known, size * before.unit[..., column], atol=1e-8)
    assert np.abs(after.known - before.known).max() > 1.0


def _torques(burden):
    readings = campaign(sigma=0.0, stated=burden)
    axes, flange = chain_axes(ROBOT.chain)
    state = PoseState(axes, flange.apply(POINTS), np.zeros(40))
    none = np.zeros((40, 6))
    whitened = readings.poses.whitened
    return rows_at(
        readings, whitened, Frames.of(ROBOT, RigidTransform.identity()), state, none, none[0]
    ).torques
