"""Batches against exact arithmetic and against one problem at a time; nothing wrong is certified."""

from __future__ import annotations

from collections import defaultdict
from functools import partial

import numpy as np
import pytest
from reference.exact_nnls import exact_nnls
from reference.exact_problems import Problem, random_problem, tied_problem

from jointstiff.solver.convex import solution as module
from jointstiff.solver.convex.problem import Bounds, IdentificationProblem
from jointstiff.solver.convex.solution import LEAST_EIGENVALUE, GramProblems, solve, solve_batch
from jointstiff.solver.errors import SolverError


def batches(make, count: int) -> dict[int, list[Problem]]:
    """Problems by number of parameters."""
    found = defaultdict(list)
    for seed in range(count):
        problem = make(seed)
        found[problem.A.shape[1]].append(problem)
    return found


def solved(problems: list[Problem], bounds: Bounds):
    gram = np.array([p.A.T @ p.A for p in problems])
    moment = np.array([p.A.T @ p.b for p in problems])
    return solve_batch(gram, moment, bounds)


def correlated(rng: np.random.Generator, count: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Gram matrices and right-hand sides of random columns over six decades."""
    A = rng.standard_normal((count, 3 * n, n)) @ (np.eye(n) + rng.uniform(-1, 1, (count, n, n)) / n)
    A = A * 10.0 ** rng.uniform(-3, 3, (count, 1, n))
    b = rng.standard_normal((count, 3 * n, 1))
    At = np.swapaxes(A, 1, 2)
    return At @ A, (At @ b)[..., 0]


@pytest.mark.parametrize("finder", ["pivoting", "alone"])
def test_random_problems_against_exact_arithmetic(monkeypatch, finder):
    """Columns over twelve decades, condition up to 1e3, any number of zeros: all certified and exact."""
    if finder == "alone":
        monkeypatch.setattr(module, "MOST_PIVOTS", 0)
    worst, zeros = 0.0, 0
    for n, problems in batches(random_problem, 1500 if finder == "pivoting" else 200).items():
        found = solved(problems, Bounds.positive(n))
        exact = np.array([[float(x) for x in exact_nnls(p.A, p.b)] for p in problems])
        assert found.certified.all()
        np.testing.assert_array_equal(found.compliance == 0, exact == 0)
        np.testing.assert_array_equal(found.active == -1, exact == 0)
        free = exact > 0
        worst = max(worst, np.abs(found.compliance[free] / exact[free] - 1).max(initial=0.0))
        zeros += int((~free).sum())
    assert worst <= 1e-8
    assert zeros > 200


def test_ties_against_exact_arithmetic():
    """Zeros with multipliers of exactly zero: the error is that of the greatest parameter's rounding."""
    for n, problems in batches(tied_problem, 300).items():
        found = solved(problems, Bounds.positive(n))
        for problem, c in zip(problems, found.compliance[found.certified], strict=True):
            exact = np.array([float(x) for x in exact_nnls(problem.A, problem.b)])
            norms = np.linalg.norm(problem.A, axis=0)
            assert np.abs((c - exact) * norms).max() <= 1e-8 * ((exact * norms).max() or 1.0)


@pytest.mark.parametrize("n", [1, 4, 6, 12])
def test_bounds_of_every_kind_as_one_at_a_time(n):
    rng = np.random.default_rng(n)
    gram, moment = correlated(rng, 200, n)
    free = np.linalg.solve(gram, moment[..., None])[..., 0]
    middle, spread = np.median(free, axis=0), free.std(axis=0)
    lower = np.where(rng.random(n) < 0.7, middle - 0.5 * spread, -np.inf)
    upper = np.where(rng.random(n) < 0.7, middle + 0.5 * spread, np.inf)
    found = solve_batch(gram, moment, Bounds(lower, upper))
    assert found.certified.all()
    assert ((lower <= found.compliance) & (found.compliance <= upper)).all()
    for G, h, c, active in zip(gram, moment, found.compliance, found.active, strict=True):
        factor = np.linalg.cholesky(G)
        alone = solve(IdentificationProblem(factor.T, np.linalg.solve(factor, h), Bounds(lower, upper)))
        size = np.sqrt(G.diagonal())
        np.testing.assert_allclose(c * size, alone.compliance * size, atol=1e-9 * np.abs(c * size).max())
        np.testing.assert_array_equal(active, alone.active)
    at_lower, at_upper = found.active == -1, found.active == 1
    np.testing.assert_array_equal(found.compliance[at_lower], np.broadcast_to(lower, (200, n))[at_lower])
    np.testing.assert_array_equal(found.compliance[at_upper], np.broadcast_to(upper, (200, n))[at_upper])


def test_numbers_do_not_depend_on_the_company():
    gram, moment = correlated(np.random.default_rng(0), 100, 6)
    whole = solve_batch(gram, moment, Bounds.positive(6)).compliance
    for part in (slice(0, 1), slice(3, 4), slice(5, 40), slice(None, None, -1)):
        found = solve_batch(gram[part], moment[part], Bounds.positive(6)).compliance
        assert found.tobytes() == whole[part].tobytes()
    assert len(solve_batch(gram[:0], moment[:0], Bounds.positive(6)).compliance) == 0


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5])
def test_what_a_gram_matrix_cannot_answer_has_no_number(angle):
    """Two columns that nearly coincide, or one of zeros, among sound problems."""
    rng = np.random.default_rng(1)
    A = rng.standard_normal((3, 20, 4))
    A[1, :, 1] = 1e3 * (A[1, :, 0] + angle * A[1, :, 1])
    A[2, :, 2] *= angle > 1e-6
    found = solve_batch(np.swapaxes(A, 1, 2) @ A, np.einsum("kri,r->ki", A, A[0, :, 3]), Bounds.positive(4))
    np.testing.assert_array_equal(found.certified, [True, False, angle > 1e-6])
    assert np.isnan(found.compliance[~found.certified]).all()
    assert (found.active[~found.certified] == 0).all()
    assert np.isfinite(found.compliance[found.certified]).all()


def test_threshold_is_on_the_equilibrated_matrix():
    """Condition that units make is none; condition that angles make is."""
    cosine = 1.0 - np.array([2.0, 0.5]) * LEAST_EIGENVALUE  # the eigenvalues are 1 ± cosine
    gram = np.array([[[1.0, 1e6 * c], [1e6 * c, 1e12]] for c in cosine])
    found = solve_batch(gram, np.ones((2, 2)), Bounds.unconstrained(2))
    np.testing.assert_array_equal(found.certified, [True, False])


def test_a_wrong_support_is_never_certified(monkeypatch):
    """Whatever pivoting says, only G and h decide; then the exact path does it."""
    gram, moment = correlated(np.random.default_rng(2), 50, 5)
    expected = solve_batch(gram, moment, Bounds.positive(5))
    assert (expected.active != 0).any(axis=1).mean() > 0.5
    for wrong in (0, -1):
        support = partial(np.full, fill_value=wrong, dtype=np.int8)
        monkeypatch.setattr(
            GramProblems, "pivoted", lambda self, support=support: self.polished(support(self.b.shape))
        )
        found = solve_batch(gram, moment, Bounds.positive(5))
        np.testing.assert_array_equal(found.active, expected.active)
        np.testing.assert_allclose(found.compliance, expected.compliance, rtol=1e-9)


def test_nothing_moved_gives_zero():
    found = solve_batch(np.eye(3)[None], np.zeros((1, 3)), Bounds.positive(3))
    np.testing.assert_array_equal(found.compliance, 0.0)
    assert found.certified.all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_data_that_are_not_finite_are_refused(bad):
    with pytest.raises(SolverError, match="overflow"):
        solve_batch(np.full((1, 2, 2), bad), np.ones((1, 2)), Bounds.positive(2))
