"""What readings let expect of another one: honest probabilities, and mistakes among good readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support.campaigns import ARM, estimate, simulated

from jointstiff.solver.live.innovation import Expectation, held_out, innovation
from jointstiff.solver.mechanics.block import regressor_blocks

SIGMA = 2e-5
ROBOT, EXACT = simulated(load="pull", configurations=12, seed=3, sigma=0.0)


def linear(measurements=EXACT):
    """The same readings of springs in first order, without noise."""
    (block,) = regressor_blocks(ROBOT, measurements)
    return replace(measurements, deflection=block.A @ ARM.compliances, sigma=None)


def noisy(seed, *, sigma, measurements=None):
    measurements = measurements or linear()
    noise = np.random.default_rng(seed).normal(0.0, np.sqrt(2.0) * SIGMA, measurements.deflection.shape)
    return replace(measurements, deflection=measurements.deflection + noise, sigma=sigma)


def judged(measurements, compliance, row):
    """Compare one reading with all others, as if it were the last."""
    return innovation(ROBOT, measurements[np.r_[np.delete(np.arange(12), row), row]], compliance)


@pytest.mark.parametrize("sigma", [SIGMA, None])
def test_probabilities_of_good_readings_are_evenly_spread(sigma):
    """By chi-square where the noise is stated, else by the ratio to the noise of the others."""
    found = [innovation(ROBOT, noisy(seed, sigma=sigma), ARM.compliances) for seed in range(30)]
    assert stats.kstest([each.p_value for each in found], "uniform").pvalue > 0.01
    assert sum(each.doubtful for each in found) <= 1


@pytest.mark.parametrize("sigma", [SIGMA, None])
@pytest.mark.parametrize("count", [1, 3, 9])
def test_limits_and_probabilities_are_each_others_inverse(sigma, count):
    expected = Expectation.of(ROBOT, noisy(0, sigma=sigma), ARM.compliances)
    assert np.isinf(expected.freedom) == (sigma is not None)
    for probability in (0.5, 0.9, 0.999):
        limit = expected.limit(probability, count)
        assert expected.probability(limit, count) == pytest.approx(1.0 - probability)
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
        compliance = estimate(ROBOT, good[np.delete(np.arange(12), row)]).compliance
        found = judged(wrong, compliance, row)
        assert found.doubtful
        assert found.causes
        assert found.label == good.labels[row]
        assert held_out(ROBOT, wrong, compliance, row).share > 1.0
        off = np.linalg.norm((1.0 - 1.0 / factor) * linear().deflection[row], axis=1).max()
        predicted = np.linalg.norm((1.0 - factor) * linear().deflection[row], axis=1).max()
        assert found.distance == pytest.approx(predicted, rel=0.1), off
    for other in range(12):
        assert not judged(good, ARM.compliances, other).doubtful


def test_balls_hold_nine_of_ten():
    inside = [held_out(ROBOT, noisy(0, sigma=SIGMA), ARM.compliances, row).inside for row in range(12)]
    assert sum(inside) >= stats.binom.ppf(1e-3, 12, 0.9)


@pytest.mark.parametrize("share", [0.15, pytest.param(0.05, marks=pytest.mark.slow)])
def test_what_the_model_lacks_in_all_readings_makes_none_doubtful(share):
    """Each deflection is off by a share of its own, as where links bend beside the joints."""
    doubtful = 0
    for seed in range(2):
        measurements = noisy(seed, sigma=SIGMA)
        lack = np.random.default_rng(100 + seed).normal(0.0, share, (12, 1, 3))
        bent = replace(measurements, deflection=measurements.deflection * (1.0 + lack))
        compliance = estimate(ROBOT, bent).compliance
        doubtful += sum(judged(bent, compliance, row).doubtful for row in range(12))
    assert doubtful <= 1, "of 24"
