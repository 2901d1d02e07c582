"""Stiffness without a load: a fast version of the benchmark `own_weight`."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from benchmarks.studies.own_weight import (
    BOTH,
    KNOWN,
    WITHIN,
    WRONG,
    estimates,
    false_certificates,
    harmful,
    summary,
)

pytestmark = pytest.mark.slow  # the studies of benchmarks/, each night

CAMPAIGNS = 30


def test_intervals_with_exact_masses_hold_the_truth_as_often_as_they_say():
    covered, _, gap = summary(estimates(KNOWN, range(CAMPAIGNS)))
    assert (np.round(covered * CAMPAIGNS) >= binom.ppf(1e-4, CAMPAIGNS, 0.95)).all()
    assert gap <= 1e-8


def test_uncertain_masses_leave_intervals_that_a_payload_narrows():
    covered, width, _ = summary(estimates(WITHIN, range(10)))
    assert (covered[:2] >= 0.9).all()
    assert width[0] <= 0.2
    assert (summary(estimates(BOTH, range(5)))[1] <= 0.5 * width).all()


def test_wrong_masses_and_geometry_harm_nobody_unsaid():
    assert not any(harmful(each) for each in estimates(WRONG, range(5)))


def test_no_certificate_is_false():
    false, gap = false_certificates(range(100))
    assert false == 0
    assert gap <= 1e-8
