"""Fieller's interval against its definition, root by root, and by how often it covers."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from jointstiff.solver.errors import RequestError
from jointstiff.solver.paired.ratio import (
    GaussianEstimate,
    difference_p_value,
    ratio_interval,
    two_sided_quantile,
)

T95 = 1.959963984540054


def allowed(ratio, first, second, t=T95):
    """The definition, at one ratio."""
    spread = np.hypot(first.standard_uncertainty, ratio * second.standard_uncertainty)
    return np.abs(first.value - ratio * second.value) <= t * spread


def holds(interval, ratio):
    """Whether an interval holds a ratio; one that was cut out does not count."""
    if interval is None:
        return False
    above = interval.lower is None or ratio >= interval.lower
    below = interval.upper is None or ratio <= interval.upper
    out = interval.excluded is not None and interval.excluded[0] < ratio < interval.excluded[1]
    return above and below and not out


VALUES = st.floats(-10, 10).map(lambda x: 1e-7 * x)
SPREADS = st.floats(0.05, 5).map(lambda x: 1e-7 * x)


@given(VALUES, SPREADS, VALUES, SPREADS, st.floats(-20, 20))
def test_every_ratio_is_in_or_out_as_the_definition_says(c1, s1, c2, s2, ratio):
    first, second = GaussianEstimate(c1, s1), GaussianEstimate(c2, s2)
    margin = np.abs(c1 - ratio * c2) / np.hypot(s1, ratio * s2) - T95
    assume(abs(margin) > 1e-6)
    free = ratio_interval(first, second, 0.95, positive=False)
    assert holds(free, ratio) == (margin < 0)
    positive = ratio_interval(first, second, 0.95, positive=True)
    assert holds(positive, ratio) == (margin < 0 and ratio >= 0)


@given(VALUES, SPREADS, VALUES, SPREADS)
def test_swapping_the_estimates_inverts_the_ratio(c1, s1, c2, s2):
    first, second = GaussianEstimate(c1, s1), GaussianEstimate(c2, s2)
    there = ratio_interval(first, second, 0.9, positive=True)
    back = ratio_interval(second, first, 0.9, positive=True)
    if there is None or there.excluded is not None:
        return
    inverse_low = inf if there.upper is None else there.upper
    if back.lower > 1e-9:
        assert 1.0 / back.lower == pytest.approx(inverse_low, rel=1e-6)


def test_published_form_where_both_are_significant():
    """The textbook solution of the quadratic (Fieller 1954)."""
    c1, s1, c2, s2 = 4e-7, 3e-8, 2e-7, 2e-8
    g = (T95 * s2 / c2) ** 2
    centre = c1 / c2 / (1 - g)
    half = T95 / (c2 * (1 - g)) * np.sqrt(s1**2 * (1 - g) + (c1 / c2) ** 2 * s2**2)
    found = ratio_interval(GaussianEstimate(c1, s1), GaussianEstimate(c2, s2), 0.95, positive=True)
    assert (found.lower, found.upper) == pytest.approx((centre - half, centre + half), rel=1e-12)


def test_no_upper_limit_where_the_second_may_be_rigid():
    found = ratio_interval(GaussianEstimate(4e-7, 1e-8), GaussianEstimate(1e-8, 1e-8), 0.95, positive=True)
    assert found.upper is None
    assert found.lower > 10.0


def test_no_limits_where_neither_is_significant():
    found = ratio_interval(GaussianEstimate(1e-8, 1e-8), GaussianEstimate(1e-8, 1e-8), 0.95, positive=True)
    assert (found.lower, found.upper) == (0.0, None)
    free = ratio_interval(GaussianEstimate(1e-8, 1e-8), GaussianEstimate(1e-8, 1e-8), 0.95, positive=False)
    assert (free.lower, free.upper) == (None, None)


def test_signs_that_contradict_leave_no_positive_ratio():
    found = ratio_interval(GaussianEstimate(-1e-7, 1e-8), GaussianEstimate(1e-7, 1e-8), 0.95, positive=True)
    assert found is None


@pytest.mark.parametrize("c2", [2e-7, 4e-8, 1e-8, 0.0], ids=["clear", "poor", "hidden", "rigid"])
def test_coverage_is_exact(c2):
    """40,000 pairs of estimates: the share that covers is the confidence, to 4.5 standard deviations."""
    count, confidence, c1, s1, s2 = 40_000, 0.9, 3e-7, 5e-8, 3e-8
    rng = np.random.default_rng(7)
    one, two = rng.normal(c1, s1, count), rng.normal(c2, s2, count)
    covered = 0
    for a, b in zip(one, two, strict=True):
        found = ratio_interval(GaussianEstimate(a, s1), GaussianEstimate(b, s2), confidence, positive=True)
        if c2 > 0:
            covered += holds(found, c1 / c2)
        else:  # the ratio is infinite
            covered += found is not None and found.upper is None
    deviation = np.sqrt(confidence * (1 - confidence) / count)
    assert abs(covered / count - confidence) < 4.5 * deviation


def test_estimated_sigma_takes_the_quantile_of_student():
    few = GaussianEstimate(4e-7, 3e-8, 5.0), GaussianEstimate(2e-7, 2e-8, 9.0)
    found = ratio_interval(*few, 0.95, positive=True)
    t = 2.570581835636314  # Student, 5 degrees of freedom, 97.5 % (any table)
    assert two_sided_quantile(0.95, 5.0) == pytest.approx(t)
    for end in (found.lower, found.upper):
        assert allowed(end * (1 + 1e-9 * (1 if end == found.lower else -1)), *few, t)
        assert not allowed(end * (1 - 1e-6 * (1 if end == found.lower else -1)), *few, t)


def test_p_value_of_a_difference():
    first, second = GaussianEstimate(3e-7, 3e-8), GaussianEstimate(3e-7 + T95 * 5e-8, 4e-8)
    assert difference_p_value(first, second) == pytest.approx(0.05)
    assert difference_p_value(first, first) == 1.0
    assert difference_p_value(
        GaussianEstimate(0.0, 3e-8, 5.0), GaussianEstimate(2.570581835636314 * 5e-8, 4e-8, 8.0)
    ) == pytest.approx(0.05)


@pytest.mark.parametrize("wrong", [(1.0, 0.0), (1.0, inf), (np.nan, 1.0), (1.0, 1.0, 0.0)])
def test_estimates_without_uncertainty_are_refused(wrong):
    with pytest.raises(RequestError, match="uncertainty"):
        GaussianEstimate(*wrong)
