"""Stiffness without a load: a fast version of the benchmark `own_weight`."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import nnls
from scipy.stats import binom

from benchmarks.studies.own_weight import (
    BOTH,
    KNOWN,
    WITHIN,
    WRONG,
    estimates,
    harmful,
    summary,
)
from jointstiff.solver.estimation.conic import GAP, Block, Cones, solve_weighed

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


def false_certificates(seeds):
    """Count certified optima that exceed the true one, and return the greatest gap.

    A block of c and ζ in a box is the cone of the box's corners, so that the true optimum is a least
    squares problem with zero or positive shares of corners, which Lawson and Hanson solve without Clarabel.
    """
    false, gaps = 0, []
    for seed in seeds:
        draws = np.random.default_rng([seed, 43])
        boxes = draws.integers(1, 4, draws.integers(1, 5))
        cones = Cones(tuple(Block(int(count)) for count in boxes), np.full(len(boxes), 100.0))
        corners = [
            np.insert(np.array(list(product((-1.0, 1.0), repeat=count))), 0, 1.0, axis=1).T
            for count in boxes.tolist()
        ]
        size = sum(block.size for block in cones.blocks)
        A = draws.standard_normal((size, size)) * 10.0 ** draws.uniform(-2.0, 0.0, size)
        A[:, cones.first] /= np.linalg.norm(A[:, cones.first], axis=0)  # as the fit scales them
        b = draws.standard_normal(size)
        found = solve_weighed(A, b, cones)
        truth = nnls(A @ block_diag(*corners), b)[1] ** 2
        gaps.append(found.certificate.gap)
        false += bool(found.loss > truth + GAP * float(b @ b))
    return false, max(gaps)


def test_no_certificate_is_false():
    false, gap = false_certificates(range(100))
    assert false == 0
    assert gap <= 1e-8
