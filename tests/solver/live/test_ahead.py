"""A live campaign: the next reading, and whether the last one surprises."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support.campaigns import ARM, estimate, simulated
from support.springs import robot_of

from jointstiff.schemas.plan import DecisionGoal, DeflectionGoal, JointsGoal
from jointstiff.simulator.campaign import LOAD_POINT, TARGETS
from jointstiff.solver.design.candidates import Equipment, Loads, PlanRequest
from jointstiff.solver.errors import RequestError
from jointstiff.solver.live.ahead import CandidateReadings, KnownCompliances
from jointstiff.solver.live.innovation import Expectation, check_held_out_reading, compare_last_reading
from jointstiff.solver.mechanics.block import regressor_blocks

ROBOT, N = robot_of(ARM), 6


def ahead(kind="any_direction", force=None):
    loads = Loads(kind, 800.0, np.full(N, np.inf))
    equipment = Equipment(np.array(list(TARGETS.values())), np.array(LOAD_POINT), loads, 2e-5)
    request = PlanRequest(
        equipment,
        nominal=ARM.compliances,
        prior=np.full(N, np.inf),
        readings=6,
        candidates=60,
        work_area=np.array([[0.5, -2.0, 0.0], [3.0, 2.0, 2.5]]),
    )
    return CandidateReadings.from_request(ROBOT, request, None if force is None else np.array(force))


def known(seed=0, size=0.1):
    root = np.random.default_rng(seed).standard_normal((N, N)) * size / np.sqrt(N)
    return KnownCompliances(
        ARM.compliances, np.outer(ARM.compliances, ARM.compliances) * (root @ root.T), 2.0
    )


def draws(what, count=4000):
    rng = np.random.default_rng(1)
    return rng.multivariate_normal(what.compliance, what.covariance, count)


def test_a_share_of_the_joints_is_that_of_their_intervals():
    found = ahead().compare_with_goal(JointsGoal(kind="joints", relative=0.2), known())
    half = 2.0 * np.std(draws(known()), axis=0) / ARM.compliances
    np.testing.assert_allclose(found.ratios, half / 0.2, rtol=0.05)
    assert found.joint == half.argmax()
    assert found.allowed == 0.2
    nothing = ahead().compare_with_goal(
        JointsGoal(kind="joints", relative=0.2), KnownCompliances.before_any_reading(N)
    )
    assert np.isinf(nothing.ratios).all()


@pytest.mark.parametrize("force", [None, (0.0, 0.0, -500.0)])
def test_a_share_of_a_deflection_is_that_of_drawn_compliances(force):
    """Root mean square of a coordinate's deviation over places and forces."""
    here, what = ahead(force=force), known(2)
    found = here.compare_with_goal(DeflectionGoal(kind="deflection", uncertainty=1e-4), what)
    moved = here.work_area_deflections.reshape(-1, 3, N) @ draws(what, 1500).T
    rms = np.sqrt(moved.var(axis=-1).mean())
    assert found.uncertainty == pytest.approx(2.0 * rms, rel=0.05)
    assert found.ratios[0] == pytest.approx(found.uncertainty / 1e-4)
    assert found.greatest_share == found.ratios[0]


def test_a_force_of_one_s_own_takes_the_place_of_the_loads():
    goal = DeflectionGoal(kind="deflection", uncertainty=1e-4)
    down, own, twice = (
        ahead("dead_weight", force).compare_with_goal(goal, known(2)).uncertainty
        for force in (None, (0.0, 0.0, -800.0), (0.0, 0.0, -1600.0))
    )
    assert [own, twice] == pytest.approx([down, 2.0 * down])


@pytest.mark.parametrize("share", [0.5, 0.9, 1.2, 3.0])
def test_a_decision_leaves_the_distance_to_the_limit(share):
    """On either side of it; the greatest deflection is that of the place with its uncertainty."""
    here, what = ahead(force=(300.0, 0.0, -500.0)), known(3, 0.02)
    lengths = np.linalg.norm(here.work_area_deflections @ what.compliance, axis=-1)
    drawn = np.linalg.norm(here.work_area_deflections @ draws(what, 1500).T, axis=-2).std(axis=-1)
    most = np.unravel_index(np.argmax(lengths + 2.0 * drawn), lengths.shape)
    limit = float(share * lengths[most])
    found = here.compare_with_goal(DecisionGoal(kind="decision", limit=limit), what)
    assert found.greatest == pytest.approx(lengths[most], rel=0.02)
    assert found.uncertainty == pytest.approx(2.0 * drawn[most], rel=0.1)
    assert found.allowed == pytest.approx(abs(limit - found.greatest), rel=1e-6)
    assert found.ratios[0] == pytest.approx(found.uncertainty / found.allowed)


def test_a_force_that_twists_a_joint_of_which_the_load_says_nothing_is_refused():
    """A weight never twists joint 1, whose axis is vertical; a force to the side does."""
    weight = ahead("dead_weight")
    assert 0 not in weight.twisted_joints
    assert set(weight.twisted_joints) == {1, 2, 3, 4, 5}
    ahead("dead_weight", (0.0, 0.0, -300.0))
    with pytest.raises(RequestError, match="twist joint_1, but the loads of the readings do not"):
        ahead("dead_weight", (0.0, 300.0, 0.0))
    blind = known()
    unknown = replace(blind, compliance=np.where(np.arange(N) == 2, np.nan, blind.compliance))
    for goal in (
        DeflectionGoal(kind="deflection", uncertainty=1e-4),
        DecisionGoal(kind="decision", limit=1e-3),
    ):
        found = weight.compare_with_goal(goal, unknown)
        assert np.isinf(found.ratios).all()
        assert found.joint == 2


SIGMA = 2e-5
SPRINGS, EXACT = simulated(load="pull", configurations=12, seed=3, sigma=0.0)


def linear(measurements=EXACT):
    """The same readings of springs in first order, without noise."""
    (block,) = regressor_blocks(SPRINGS, measurements)
    return replace(measurements, deflection=block.A @ ARM.compliances, sigma=None)


def noisy(seed, *, sigma, measurements=None):
    measurements = measurements or linear()
    noise = np.random.default_rng(seed).normal(0.0, np.sqrt(2.0) * SIGMA, measurements.deflection.shape)
    return replace(measurements, deflection=measurements.deflection + noise, sigma=sigma)


def judged(measurements, compliance, row):
    """Compare one reading with all others, as if it were the last."""
    return compare_last_reading(SPRINGS, measurements[np.r_[np.delete(np.arange(12), row), row]], compliance)


@pytest.mark.parametrize("sigma", [SIGMA, None])
def test_probabilities_of_good_readings_are_evenly_spread(sigma):
    """By chi-square where the noise is stated, else by the ratio to the noise of the others."""
    found = [compare_last_reading(SPRINGS, noisy(seed, sigma=sigma), ARM.compliances) for seed in range(30)]
    assert stats.kstest([each.p_value for each in found], "uniform").pvalue > 0.01
    assert sum(each.doubtful for each in found) <= 1


@pytest.mark.parametrize("sigma", [SIGMA, None])
@pytest.mark.parametrize("count", [1, 3, 9])
def test_limits_and_probabilities_are_each_others_inverse(sigma, count):
    expected = Expectation.from_readings(SPRINGS, noisy(0, sigma=sigma), ARM.compliances)
    assert np.isinf(expected.freedom) == (sigma is not None)
    for probability in (0.5, 0.9, 0.999):
        limit = expected.compute_squared_distance_quantile(probability, count)
        assert expected.compute_exceedance_probability(limit, count) == pytest.approx(1.0 - probability)
        if sigma is None:
            assert limit == pytest.approx(count * stats.f.ppf(probability, count, expected.freedom))
        else:
            assert limit == pytest.approx(stats.chi2.ppf(probability, count))


@pytest.mark.parametrize(("sigma", "row"), [(SIGMA, 11), (None, 0)])
def test_one_wrong_reading_is_doubtful_and_no_other(sigma, row):
    """A force turned round, and a load of half the size; the other readings are judged without it."""
    good = noisy(1, sigma=sigma)
    for factor in (-1.0, 0.5):
        force = good.force.copy()
        force[row] *= factor
        wrong = replace(good, force=force)
        compliance = estimate(SPRINGS, good[np.delete(np.arange(12), row)]).compliance
        found = judged(wrong, compliance, row)
        assert found.doubtful
        assert found.causes
        assert check_held_out_reading(SPRINGS, wrong, compliance, row).ball_ratio > 1.0
        predicted = np.linalg.norm((1.0 - factor) * linear().deflection[row], axis=1).max()
        assert found.distance == pytest.approx(predicted, rel=0.1)
    for other in range(12):
        assert not judged(good, ARM.compliances, other).doubtful


@pytest.mark.parametrize(("stood", "row"), [(2, 11), (7, 4)])
def test_an_arm_that_was_not_moved_stood_as_for_an_earlier_reading(stood, row):
    """Joints of one posture beside what was read in another."""
    wrong = noisy(1, sigma=SIGMA)[np.where(np.arange(12) == row, stood, np.arange(12))]
    joints, labels = wrong.joints.copy(), list(wrong.labels)
    joints[row], labels[row] = EXACT.joints[row], "the last one"
    found = judged(replace(wrong, joints=joints, labels=tuple(labels)), ARM.compliances, row)
    assert found.doubtful
    assert f"the arm was in the posture of '{wrong.labels[stood]}'" in found.causes


def test_balls_hold_nine_of_ten():
    inside = [
        check_held_out_reading(SPRINGS, noisy(0, sigma=SIGMA), ARM.compliances, row).inside
        for row in range(12)
    ]
    assert sum(inside) >= stats.binom.ppf(1e-3, 12, 0.9)


@pytest.mark.parametrize("share", [0.15, pytest.param(0.05, marks=pytest.mark.slow)])
def test_what_the_model_lacks_in_all_readings_makes_none_doubtful(share):
    """Each deflection is off by a share of its own, as where links bend beside the joints."""
    doubtful = 0
    for seed in range(2):
        measurements = noisy(seed, sigma=SIGMA)
        lack = np.random.default_rng(100 + seed).normal(0.0, share, (12, 1, 3))
        bent = replace(measurements, deflection=measurements.deflection * (1.0 + lack))
        compliance = estimate(SPRINGS, bent).compliance
        doubtful += sum(judged(bent, compliance, row).doubtful for row in range(12))
    assert doubtful <= 1, "of 24"
