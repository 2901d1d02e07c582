"""Shares of goals beside draws of compliances, which share no code with the algebra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import ARM
from support.springs import robot_of

from jointstiff.schemas.plan import DecisionGoal, DeflectionGoal, JointsGoal
from jointstiff.simulator.campaign import LOAD_POINT, TARGETS
from jointstiff.solver.design.candidates import Equipment, Loads, PlanRequest
from jointstiff.solver.errors import RequestError
from jointstiff.solver.live.ahead import Ahead, Known

ROBOT, N = robot_of(ARM), 6
AREA = np.array([[0.5, -2.0, 0.0], [3.0, 2.0, 2.5]])


def ahead(kind="any_direction", force=None):
    loads = Loads(kind, 800.0, np.full(N, np.inf))
    equipment = Equipment(np.array(list(TARGETS.values())), np.array(LOAD_POINT), loads, 2e-5)
    request = PlanRequest(
        equipment,
        nominal=ARM.compliances,
        prior=np.full(N, np.inf),
        readings=6,
        candidates=60,
        work_area=AREA,
    )
    return Ahead.of(ROBOT, request, None if force is None else np.array(force))


def known(seed=0, size=0.1):
    root = np.random.default_rng(seed).standard_normal((N, N)) * size / np.sqrt(N)
    return Known(ARM.compliances, np.outer(ARM.compliances, ARM.compliances) * (root @ root.T), 2.0)


def draws(what, count=4000):
    rng = np.random.default_rng(1)
    return rng.multivariate_normal(what.compliance, what.covariance, count)


def test_a_share_of_the_joints_is_that_of_their_intervals():
    found = ahead().reached(JointsGoal(kind="joints", relative=0.2), known())
    half = 2.0 * np.std(draws(known()), axis=0) / ARM.compliances
    np.testing.assert_allclose(found.each, half / 0.2, rtol=0.05)
    assert found.joint == half.argmax()
    assert found.allowed == 0.2
    nothing = ahead().reached(JointsGoal(kind="joints", relative=0.2), Known.nothing(N))
    assert np.isinf(nothing.each).all()


@pytest.mark.parametrize("force", [None, (0.0, 0.0, -500.0)])
def test_a_share_of_a_deflection_is_that_of_drawn_compliances(force):
    """Root mean square of a coordinate's deviation over places and forces."""
    here, what = ahead(force=force), known(2)
    found = here.reached(DeflectionGoal(kind="deflection", uncertainty=1e-4), what)
    moved = here.places.reshape(-1, 3, N) @ draws(what, 1500).T
    rms = np.sqrt(moved.var(axis=-1).mean())
    assert found.uncertainty == pytest.approx(2.0 * rms, rel=0.05)
    assert found.each[0] == pytest.approx(found.uncertainty / 1e-4)
    assert found.greatest_share == found.each[0]


def test_a_force_of_one_s_own_takes_the_place_of_the_loads():
    goal = DeflectionGoal(kind="deflection", uncertainty=1e-4)
    down, own, twice = (
        ahead("dead_weight", force).reached(goal, known(2)).uncertainty
        for force in (None, (0.0, 0.0, -800.0), (0.0, 0.0, -1600.0))
    )
    assert [own, twice] == pytest.approx([down, 2.0 * down])


@pytest.mark.parametrize("share", [0.5, 0.9, 1.2, 3.0])
def test_a_decision_leaves_the_distance_to_the_limit(share):
    """On either side of it; the greatest deflection is that of the place with its uncertainty."""
    here, what = ahead(force=(300.0, 0.0, -500.0)), known(3, 0.02)
    lengths = np.linalg.norm(here.places @ what.compliance, axis=-1)
    drawn = np.linalg.norm(here.places @ draws(what, 1500).T, axis=-2).std(axis=-1)
    most = np.unravel_index(np.argmax(lengths + 2.0 * drawn), lengths.shape)
    limit = float(share * lengths[most])
    found = here.reached(DecisionGoal(kind="decision", limit=limit), what)
    assert found.greatest == pytest.approx(lengths[most], rel=0.02)
    assert found.uncertainty == pytest.approx(2.0 * drawn[most], rel=0.1)
    assert found.allowed == pytest.approx(abs(limit - found.greatest), rel=1e-6)
    assert found.each[0] == pytest.approx(found.uncertainty / found.allowed)


def test_a_force_that_twists_a_joint_of_which_the_load_says_nothing_is_refused():
    """A weight never twists joint 1, whose axis is vertical; a force to the side does."""
    weight = ahead("dead_weight")
    assert 0 not in weight.wanted
    assert set(weight.wanted) == {1, 2, 3, 4, 5}
    ahead("dead_weight", (0.0, 0.0, -300.0))
    with pytest.raises(RequestError, match="do not twist joint_1, but"):
        ahead("dead_weight", (0.0, 300.0, 0.0))
    blind = known()
    unknown = replace(blind, compliance=np.where(np.arange(N) == 2, np.nan, blind.compliance))
    for goal in (
        DeflectionGoal(kind="deflection", uncertainty=1e-4),
        DecisionGoal(kind="decision", limit=1e-3),
    ):
        found = weight.reached(goal, unknown)
        assert np.isinf(found.each).all()
        assert found.joint == 2
