"""The trend against arithmetic that shares no code with it: fractions, dense matrices, quadrature."""

from __future__ import annotations

from fractions import Fraction
from math import exp, log, sqrt

import numpy as np
import pytest
from scipy import stats

from jointstiff.solver.compare.campaigns import (
    FALSE_ALARMS,
    LIFE,
    Baseline,
    Chart,
    Series,
    alarm_level,
    charts_of,
    log_stiffness,
    monitor,
    pooled_excess,
)
from jointstiff.solver.errors import RequestError

_AGREED = np.zeros(())


def _series(values: list[float], u: float | list[float] = 0.02) -> Series:
    return Series(np.array(values), np.broadcast_to(np.asarray(u, dtype=float), len(values)).copy())


def _chart(*values: float) -> Chart:
    """Return the chart of a joint alone, after a baseline of three campaigns."""
    (chart,) = charts_of([_series(list(values))], 3)
    assert chart is not None
    return chart


def test_the_scatter_between_campaigns_is_dersimonian_and_lairds_in_fractions() -> None:
    values, u = [Fraction(1), Fraction(3), Fraction(8)], [Fraction(1), Fraction(2), Fraction(1)]
    w = [1 / one**2 for one in u]
    centre = sum(a * b for a, b in zip(w, values, strict=True)) / sum(w)
    q = sum(a * (b - centre) ** 2 for a, b in zip(w, values, strict=True))
    tau2 = (q - 2) / (sum(w) - sum(a**2 for a in w) / sum(w))
    new = [1 / (one**2 + tau2) for one in u]
    mean = sum(a * b for a, b in zip(new, values, strict=True)) / sum(new)
    found = Baseline.of(np.array(values, dtype=float), np.array(u, dtype=float))
    assert float(found.scatter) == pytest.approx(float(q), rel=1e-14)
    assert float(found.between) ** 2 == pytest.approx(float(tau2), rel=1e-13)
    assert float(found.mean) == pytest.approx(float(mean), rel=1e-14)
    agreeing = Baseline.of(np.array([1.0, 1.01, 0.99]), np.full(3, 0.05))
    assert float(agreeing.between) == 0.0


def test_the_deviation_has_the_variance_of_a_dense_matrix() -> None:
    """z_t - mean is a linear map of all campaigns: its rows come from unit vectors, with unequal noise."""
    rng = np.random.default_rng(3)
    before, after = np.array([0.02, 0.03, 0.025]), rng.uniform(0.015, 0.06, size=9)
    flat = Baseline.of(np.zeros(3), before)
    values = rng.normal(0.0, 0.02, size=9)
    found = monitor(flat, _AGREED, values, after, 1e-3)
    reading2 = 3 / (before**-2.0).sum()
    share = 0.2 * reading2 / after**2 / (0.2 * reading2 / after**2 + 0.8)
    weight = before**-2.0 / (before**-2.0).sum()
    noise2 = np.concatenate([before**2, after**2])
    row = np.concatenate([weight, np.zeros(9)])
    for t in range(9):
        row = (1 - share[t]) * row + share[t] * np.eye(12)[3 + t]
        minus_mean = row - np.concatenate([weight, np.zeros(9)])
        assert found.deviation[t] == pytest.approx(float(minus_mean[3:] @ values), rel=1e-12)
        assert found.readings[t] == pytest.approx(float(minus_mean**2 @ noise2), rel=1e-12)
        assert found.between[t] == pytest.approx(float(minus_mean @ minus_mean), rel=1e-12)


def test_scatters_are_as_plausible_as_their_likelihood_integrated_over_the_mean() -> None:
    """By quadrature over the unknown mean; what is left is a half-normal prior of τ."""
    values, u = np.array([0.0, 0.05, -0.02]), np.array([0.02, 0.03, 0.01])
    tau, weight = Baseline.of(values, u).plausible_between(np.zeros(()))
    mu = np.linspace(-1.0, 1.0, 2_001)
    spread = np.sqrt(u**2 + tau[:, None] ** 2)
    likelihood = stats.norm.pdf(values[:, None], mu, spread[:, :, None]).prod(axis=1).sum(axis=1)
    prior = np.log(weight / likelihood)
    line = np.polyfit(tau**2, prior, 1)
    np.testing.assert_allclose(prior, np.polyval(line, tau**2), atol=1e-6)
    assert line[0] < 0.0


def test_scatter_is_pooled_and_false_alarms_add_up_over_all_joints() -> None:
    assert float(pooled_excess(12.0, 12)) == 0.0
    assert float(pooled_excess(60.0, 12)) == pytest.approx(60.0 / stats.chi2.ppf(0.8, 12) - 1.0, rel=1e-12)
    assert alarm_level(6) * 6 * LIFE == pytest.approx(FALSE_ALARMS)


def test_false_alarms_of_six_joints_are_below_the_rate() -> None:
    """500 robots in control; the settled study had 20,000, and more scatter between campaigns."""
    for rho in (0.0, 0.5):
        rng = np.random.default_rng(7)
        values = 0.02 * sqrt(1 + rho**2) * rng.standard_normal((500, 6, 23))
        baseline = Baseline.of(values[..., :3], np.full((500, 6, 3), 0.02))
        excess = pooled_excess(baseline.scatter.sum(-1), 12)[:, None] * np.ones(6)
        after = values[..., 3:]
        found = monitor(baseline, excess, after, np.full_like(after, 0.02), alarm_level(6))
        assert found.exceeded.any(axis=(1, 2)).mean() <= 0.05


def test_an_alarm_that_goes_away_is_closed_and_the_next_is_another() -> None:
    values = [0.0, 0.0, 0.0, 0.5, *[0.0] * 12, -0.5]
    first, second = _chart(*values).alarms
    assert (first.first, first.is_open) == (3, False)
    assert (second.first, second.is_open) == (len(values) - 1, True)


def test_a_change_of_one_campaign_has_the_uncertainty_of_both() -> None:
    change = _chart(0.0, 0.0, 0.0, -0.1).change(3)
    assert change.difference == pytest.approx(-0.1)
    assert change.standard_uncertainty >= 0.02 * sqrt(1 + 1 / 3)
    assert change.relative == pytest.approx(exp(-0.1) - 1)


def test_joints_with_too_few_campaigns_have_no_chart_and_count_for_none() -> None:
    short, whole = _series([0.0, 0.1]), [0.0, 0.0, 0.0, 0.01]
    assert charts_of([short], 3) == [None]
    none, both = charts_of([short, _series(whole)], 3)
    assert none is None
    assert both is not None
    assert both.monitored.limits == pytest.approx(_chart(*whole).monitored.limits)
    wide = _chart(0.0, 0.1, -0.1)
    excess = pooled_excess(wide.baseline.scatter, 2)
    assert np.array_equal(wide.monitored.tau, wide.baseline.plausible_between(excess)[0])


def test_two_campaigns_are_compared_as_a_pair() -> None:
    change = _series([10.0, 10.1], [0.03, 0.04]).change(0, 1)
    assert change.standard_uncertainty == pytest.approx(0.05)
    assert change.p_value == pytest.approx(2 * stats.norm.sf(2.0))


def test_only_joints_with_a_closed_interval_enter() -> None:
    assert log_stiffness(1e-6, 1e-7) == pytest.approx((-log(1e-6), 0.1))
    assert log_stiffness(1e-6, 1e-7, 6e-8) == pytest.approx((-log(1e-6), 0.08))
    assert log_stiffness(1e-6, 1e-7, 1e-7)[1] > 0.0
    for compliance, u in ((0.0, 1e-8), (-1e-7, 1e-8), (1e-6, 3e-7), (None, 1e-8), (1e-6, None), (1e-6, 0.0)):
        assert log_stiffness(compliance, u) is None


def test_a_baseline_of_two_is_refused() -> None:
    with pytest.raises(RequestError, match="baseline of 2"):
        charts_of([_series([0.0, 0.0, 0.0])], 2)


def test_the_uncertainty_of_an_even_baseline_is_that_of_a_mean() -> None:
    """Campaigns of one uncertainty have one weight: (u² + τ²) / n, and those after it add their own."""
    u = 0.02
    chart = _chart(0.0, 0.15, -0.12, 0.05, 0.02)
    tau2 = float(chart.monitored.tau_square)
    assert tau2 > u**2
    assert chart.baseline_uncertainty**2 == pytest.approx((u**2 + tau2) / 3.0, rel=1e-9)
    for campaign in (3, 4):
        change = chart.change(campaign)
        assert change.difference == pytest.approx(chart.series.values[campaign] - 0.01, rel=1e-9)
        variance = u**2 + tau2 + (u**2 + tau2) / 3.0
        assert change.standard_uncertainty**2 == pytest.approx(variance, rel=1e-9)
