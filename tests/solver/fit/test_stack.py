"""Stacks and triangles answer as the rows themselves do."""

import numpy as np
import pytest

from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.fit.triangle import INDEPENDENT

COUNT, ROWS, WIDTHS = 7, 9, {"joints": 3, "shift": 2}


@pytest.fixture
def stack():
    rows = np.random.default_rng(1).standard_normal((COUNT, ROWS, 6))
    rows[2, 6:] = 0.0  # a target that was not read
    return Stack(rows, np.array([9, 9, 6, 9, 9, 9, 9]), dict(WIDTHS))


def _least_squares(A, d):
    return np.linalg.lstsq(A, d, rcond=None)[0]


def test_the_triangle_of_a_stack_holds_all_that_its_rows_tell(stack):
    triangle = stack.triangle()
    np.testing.assert_allclose(triangle.R.T @ triangle.R, stack.flat.T @ stack.flat, rtol=1e-13, atol=1e-13)
    assert triangle.rows == 60
    np.testing.assert_array_equal(triangle.span["shift"], [3, 4])


def test_a_posture_left_out_is_a_fit_without_its_rows(stack):
    left = stack.without(2).triangle()
    rows = np.delete(stack.rows, 2, axis=0).reshape(-1, 6)
    np.testing.assert_allclose(
        _least_squares(left.matrix, left.rhs), _least_squares(rows[:, :-1], rows[:, -1]), rtol=1e-12
    )
    assert left.rows == 54


def test_sums_since_a_posture_are_those_of_the_rows_from_there_on(stack):
    for first in range(COUNT):
        rows = stack.rows[first:].reshape(-1, 6)
        np.testing.assert_allclose(stack.trailing_gram_sums[first], rows.T @ rows, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("whole", [True, False], ids=["stack", "triangle"])
def test_what_a_term_leaves_is_across_its_columns(stack, whole):
    left = stack.project_out(["shift"]) if whole else stack.triangle().project_out(["shift"], INDEPENDENT)
    known, others = stack.flat[:, 3:5], stack.flat[:, [0, 1, 2, 5]]
    expected = others - known @ _least_squares(known, others)
    found = left.flat if whole else left.R
    np.testing.assert_allclose(found.T @ found, expected.T @ expected, rtol=1e-12, atol=1e-12)


def test_terms_are_fitted_while_others_are_known(stack):
    others = np.array([0.3, -0.2, 0.1, 0.0, 0.0])
    found = stack.triangle().fit(["shift"], others, INDEPENDENT)
    left = stack.flat[:, -1] - stack.flat[:, :3] @ others[:3]
    np.testing.assert_allclose(found, _least_squares(stack.flat[:, 3:5], left), rtol=1e-12)


def test_a_prior_is_one_more_row_of_each_unknown(stack):
    """Gauss and Markov's estimate with normal priors, by its own formula; an exact unknown stays zero."""
    deviation, variance = np.array([0.5, 2.0, 0.0, 0.1, 1.0]), 0.3
    fit = stack.triangle().fit_with_prior(deviation, variance)
    free = deviation > 0.0
    A, d = stack.flat[:, :-1][:, free], stack.flat[:, -1]
    covariance = np.linalg.inv(A.T @ A / variance + np.diag(deviation[free] ** -2.0))
    np.testing.assert_allclose(fit.unknowns[free], covariance @ A.T @ d / variance, rtol=1e-11)
    np.testing.assert_allclose((fit.root @ fit.root.T)[np.ix_(free, free)], covariance, rtol=1e-11)
    assert fit.unknowns[2] == 0.0
    assert not fit.root[2].any()
    assert fit.squares == pytest.approx(np.square(A @ fit.unknowns[free] - d).sum(), rel=1e-12)
