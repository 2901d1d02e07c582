"""Exactness against rational arithmetic, and certificates that cannot be had by cheating."""

from __future__ import annotations

from collections import Counter

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchmarks.exact_nnls import exact_nnls
from solver import solve as module
from solver.exceptions import RequestError, SolverError
from solver.problem import Bounds, IdentificationProblem
from solver.solve import CERTIFICATE_TOLERANCE, solve


def random_problem(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Random columns, half of them correlated, over twelve decades."""
    n = int(rng.integers(1, 9))
    A = rng.standard_normal((n + 1, n))
    if rng.random() < 0.5:
        A = A @ (np.eye(n) + rng.uniform(-0.6, 0.6, (n, n)))
    return A * 10.0 ** rng.uniform(-6, 6, n), rng.standard_normal(n + 1)


def test_ten_thousand_problems_against_exact_arithmetic():
    rng = np.random.default_rng(20171)
    worst, active, finders = 0.0, Counter(), Counter()
    for _ in range(10_000):
        A, b = random_problem(rng)
        exact = np.array([float(x.p) / float(x.q) if x else 0.0 for x in exact_nnls(A, b)])
        found = solve(IdentificationProblem(A, b, Bounds.positive(len(exact))))
        free = exact > 0
        assert (found.compliance[~free] == 0).all(), "the support differs"
        if free.any():
            worst = max(worst, np.abs(found.compliance[free] / exact[free] - 1).max())
        assert found.certificate.holds
        active[int((~free).sum())] += 1
        finders[found.certificate.solved_by] += 1
    assert worst <= 1e-8
    assert all(active[k] > 100 for k in range(5)), active
    assert {"least_squares", "pivoting", "clarabel"} <= set(finders), finders


@pytest.mark.parametrize("wrong", [0, -1, 1])
def test_a_wrong_support_is_never_certified(monkeypatch, wrong):
    """Whatever the finders say, only the data decide: without a right one the solve must fail."""

    def fixed(scaled):
        return np.full(len(scaled.lower), wrong, dtype=np.int8)

    # Optimum (1, 0), which is neither at all bounds nor at none, nor the projection of least squares.
    A, b = np.array([[1.0, 0.8], [0.0, 0.6]]), np.array([1.0, -1.0])
    for name in ("_support_without_bounds", "_support_from_pivoting", "_support_from_clarabel"):
        monkeypatch.setattr(module, name, fixed)
    bounds = Bounds(np.zeros(2), np.full(2, 10.0))
    found = solve(IdentificationProblem(A, b, bounds))
    assert found.certificate.solved_by == "active_set"
    np.testing.assert_allclose(found.compliance, [1.0, 0.0], rtol=1e-15)
    monkeypatch.setattr(module, "_support_from_active_set", fixed)
    with pytest.raises(SolverError, match="no solution satisfies the optimality conditions"):
        solve(IdentificationProblem(A, b, bounds))


def test_clarabel_that_does_not_say_optimal_is_not_believed(monkeypatch):
    monkeypatch.setitem(module._CLARABEL, "max_iter", 1)
    for name in ("_support_without_bounds", "_support_from_pivoting"):
        monkeypatch.setattr(module, name, lambda _: None)
    rng = np.random.default_rng(0)
    for _ in range(20):
        A, b = random_problem(rng)
        found = solve(IdentificationProblem(A, b, Bounds.positive(len(A[0]))))
        assert found.certificate.solved_by == "active_set"


@pytest.mark.parametrize("finder", ["clarabel", "active_set"])
def test_each_finder_alone_solves(monkeypatch, finder):
    """The cheap proposals aside, Clarabel and the active set agree with exact arithmetic."""
    names = ["_support_without_bounds", "_support_from_pivoting"]
    names += ["_support_from_clarabel"] if finder == "active_set" else []
    for name in names:
        monkeypatch.setattr(module, name, lambda _: None)
    rng = np.random.default_rng(3)
    for _ in range(200):
        A, b = random_problem(rng)
        exact = np.array([float(x.p) / float(x.q) if x else 0.0 for x in exact_nnls(A, b)])
        found = solve(IdentificationProblem(A, b, Bounds.positive(len(exact))))
        np.testing.assert_allclose(found.compliance, exact, rtol=1e-8)


numbers = st.integers(-1000, 1000).map(float)


@settings(max_examples=150, deadline=None)
@given(
    A=arrays(np.float64, (6, 4), elements=numbers),
    b=arrays(np.float64, 6, elements=numbers),
    lower=arrays(np.float64, 4, elements=st.sampled_from([-np.inf, -1.0, 0.0, 0.5])),
    width=arrays(np.float64, 4, elements=st.sampled_from([0.25, 2.0, np.inf])),
)
def test_bounds_of_every_kind(A, b, lower, width):
    """Ties, dependent columns and bounds on both sides: certified, and as good as the cone program."""
    A = A + np.eye(6, 4)  # no zero column
    if not (np.abs(A).max(axis=0) > 0).all():
        return
    upper = np.maximum(lower, -2.0) + width
    found = solve(IdentificationProblem(A, b, Bounds(lower, upper)))
    assert ((lower <= found.compliance) & (found.compliance <= upper)).all()
    assert found.certificate.holds
    x = cp.Variable(4)
    below, above = np.isfinite(lower), np.isfinite(upper)
    constraints = [x[below] >= lower[below], x[above] <= upper[above]]
    problem = cp.Problem(cp.Minimize(cp.sum_squares(A @ x - b)), constraints)
    problem.solve(solver=cp.CLARABEL)
    ours = float(np.sum((A @ found.compliance - b) ** 2))
    assert ours <= problem.value * (1 + 1e-6) + 1e-3


def test_bounds_that_cross_are_refused():
    with pytest.raises(RequestError, match="not below"):
        Bounds(np.array([1.0]), np.array([1.0]))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_data_that_are_not_finite_are_refused(bad):
    A = np.eye(2)
    A[0, 1] = bad
    with pytest.raises(SolverError, match="overflows"):
        IdentificationProblem(A, np.ones(2), Bounds.positive(2))


def test_a_zero_column_is_refused():
    with pytest.raises(SolverError, match="no effect"):
        IdentificationProblem(np.array([[1.0, 0.0]]), np.ones(1), Bounds.positive(2))


def test_zero_right_hand_side_gives_zero():
    found = solve(IdentificationProblem(np.eye(3), np.zeros(3), Bounds.positive(3)))
    np.testing.assert_array_equal(found.compliance, 0.0)
    assert CERTIFICATE_TOLERANCE <= 1e-12


@pytest.mark.parametrize("epsilon", [1e-9, 1e-8, 1e-7, 1e-6, 1e-3])
def test_nearly_dependent_columns_are_solved_or_refused_never_certified_wrong(epsilon):
    """What is certified is what is returned: no clipping after the proof, no slack that grows with x."""
    e = np.eye(4)
    A = np.column_stack([e[0], -e[0] + epsilon * e[1], e[2], (e[2] + e[3]) / np.sqrt(2)])
    b = e[1] - 5e-4 * A[:, 2] + 1e-3 * A[:, 3]
    exact = np.array([float(x.p) / float(x.q) if x else 0.0 for x in exact_nnls(A, b)])
    try:
        found = solve(IdentificationProblem(A, b, Bounds.positive(4)))
    except SolverError:
        return
    np.testing.assert_allclose(found.compliance[2:], exact[2:], rtol=1e-8, atol=1e-12)
