"""Cones of products: optimum, ends and their bounds, against a solver that shares no code and by sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from jointstiff.solver.convex import programs
from jointstiff.solver.convex.conic import Block, Cones, solve_weighed, weighed_ends
from jointstiff.solver.errors import SolverError

BLOCKS = (Block(2, ((1, 0.3), (-1, 0.0))), Block(0), Block(1))
CONES = Cones(BLOCKS, np.array([50.0, 40.0, 60.0]))
SIZE = sum(block.size for block in BLOCKS)


def inside(rng, count):
    """Points of the set, drawn one by one from its definition."""
    points = np.zeros((count, SIZE))
    for x in points:
        for start, block in zip(CONES.first, BLOCKS, strict=True):
            c = x[start] = rng.choice([0.0, rng.exponential(1.0)], p=[0.1, 0.9])
            zeta = x[start + 1 : start + 1 + block.boxes] = c * rng.uniform(-1.0, 1.0, block.boxes)
            for ball, (own, ratio) in enumerate(block.balls):
                first = start + 1 + block.boxes + 3 * ball
                direction = rng.standard_normal(3)
                reach = c + (ratio * zeta[own] if own >= 0 else 0.0)
                x[first : first + 3] = rng.uniform() * reach * direction / np.linalg.norm(direction)
    return points


def problem(seed, rows=SIZE):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((rows, SIZE))
    return A, A @ inside(rng, 1)[0] + 0.3 * rng.standard_normal(rows), rng


def reference(A, b, start):
    """The optimum by sequential quadratic programming, which knows nothing of cones."""

    def slack(x):
        c1, z1, z2, c3, z3 = x[0], x[1], x[2], x[10], x[11]
        balls = [(c1 + 0.3 * z2) - np.linalg.norm(x[3:6]), c1 - np.linalg.norm(x[6:9])]
        return np.array([c1, x[9], c3, c1 - z1, c1 + z1, c1 - z2, c1 + z2, c3 - z3, c3 + z3, *balls])

    found = minimize(
        lambda x: np.sum((A @ x - b) ** 2),
        start,
        jac=lambda x: 2.0 * A.T @ (A @ x - b),
        constraints={"type": "ineq", "fun": slack},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 1000},
    )
    return found.fun


@pytest.mark.parametrize("seed", range(8))
def test_the_optimum_is_that_of_another_solver(seed):
    A, b, rng = problem(seed)
    found = solve_weighed(A, b, CONES)
    start = inside(rng, 1)[0] + 1e-3
    assert found.certificate.gap <= 1e-8
    assert found.loss <= reference(A, b, start) + 1e-6


@pytest.mark.parametrize("rows", [SIZE, 5])
def test_no_point_of_the_set_is_better_than_the_gap_says(rows):
    A, b, rng = problem(3, rows)
    found = solve_weighed(A, b, CONES)
    losses = np.square(inside(rng, 2000) @ A.T - b).sum(axis=1)
    assert losses.min() >= found.loss - found.certificate.gap * (b @ b)
    assert (CONES.projected(found.x) == found.x).all()


@pytest.mark.parametrize("seed", range(4))
def test_ends_hold_all_points_near_the_optimum_and_no_more(seed):
    A, b, rng = problem(seed)
    optimum = solve_weighed(A, b, CONES)
    found = weighed_ends(A, b, optimum, 0.5, CONES)
    program, radius = programs.weighed_end(SIZE, BLOCKS), np.sqrt(optimum.loss + 0.5)
    near, cap = optimum.x / radius, CONES.cap / radius
    ball = {"A": A, "b": b / radius - A @ near, "near": near, "cap": cap}
    for (j, side), end in np.ndenumerate(found):  # a point of the set is there, all but
        a = (1.0 - 2.0 * side) * np.eye(SIZE)[CONES.first[j]]
        c = radius * (near + program.solve({"a": a, **ball}))[CONES.first[j]]
        assert abs(max(c, 0.0) - end) <= 1e-6 * np.ptp(found[j])
    for start in inside(rng, 200):  # towards each point, as far as the level set allows
        step = start - optimum.x
        near, slope = A @ optimum.x - b, A @ step
        reach = np.roots([slope @ slope, 2 * near @ slope, -0.5]).real.max()
        x = optimum.x + min(1.0, reach) * step
        c = x[CONES.first]
        assert (c >= found[:, 0] - 1e-9).all()
        assert (c <= found[:, 1] + 1e-9).all()


def test_a_lower_bound_holds_for_any_function():
    rng = np.random.default_rng(5)
    points = inside(rng, 500)
    for s in rng.standard_normal((200, SIZE)):
        assert (points @ s).min() >= CONES.least(s) - 1e-9


def test_a_multiplier_that_is_wrong_only_widens_an_end(monkeypatch):
    A, b, _ = problem(1)
    optimum = solve_weighed(A, b, CONES)
    right = weighed_ends(A, b, optimum, 0.5, CONES)
    solve = programs.Program.solve_with_duals

    def wrong(self, data, tolerance=programs.TOLERANCE):
        x, dual = solve(self, data, tolerance)
        return x, dual * 1.05

    monkeypatch.setattr(programs.Program, "solve_with_duals", wrong)
    widened = weighed_ends(A, b, optimum, 0.5, CONES)
    assert (widened[:, 0] <= right[:, 0] + 1e-12).all()
    assert (widened[:, 1] >= right[:, 1] - 1e-12).all()
    assert (widened != right).any()


def test_an_answer_that_is_almost_solved_is_none(monkeypatch):
    A, b, _ = problem(2)
    monkeypatch.setattr(programs, "SETTINGS", {**programs.SETTINGS, "max_iter": 3})
    with pytest.raises(SolverError, match="could not be certified"):
        solve_weighed(A, b, CONES)


def test_a_point_that_is_not_the_optimum_is_not_certified(monkeypatch):
    A, b, _ = problem(2)
    solve = programs.Program.solve
    monkeypatch.setattr(
        programs.Program, "solve", lambda self, data, tolerance: 1.001 * solve(self, data, tolerance)
    )
    with pytest.raises(SolverError, match="its gap is"):
        solve_weighed(A, b, CONES)
