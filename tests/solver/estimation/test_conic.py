"""Programs over cones: optimum, certificate, freedom and ends against outside truth and by sampling."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import minimize
from support.examples import examples

from jointstiff.solver.errors import SolverError
from jointstiff.solver.estimation import programs
from jointstiff.solver.estimation.conic import (
    Block,
    Cone,
    Cones,
    Face,
    LeastSquares,
    NormSum,
    RobustProgram,
    SemidefiniteProgram,
    certify_cone,
    certify_robust,
    effective_freedom,
    penalised_range,
    raised,
    solve_cone,
    solve_robust,
    solve_weighed,
    to_matrix,
    to_vector,
    weighed_ends,
)

GAP = 1e-6


def random_program(seed, *, cone=None, weight=None, rows=40):
    rng = np.random.default_rng([seed, 50])
    cone = cone or Cone(int(rng.integers(0, 4)), tuple(rng.integers(1, 5, rng.integers(1, 4)).tolist()))
    R = rng.standard_normal((rows, cone.dimension)) * 10.0 ** rng.uniform(-1.5, 0.0, cone.dimension)
    R[:, : cone.nonnegative] /= np.linalg.norm(R[:, : cone.nonnegative], axis=0)
    z = rng.standard_normal(rows)
    weight = weight or 10.0 ** rng.uniform(-4.0, 0.0)
    fit = LeastSquares(R, z / np.linalg.norm(z))
    return SemidefiniteProgram(fit, cone, weight)


def robust_program(seed, threshold):
    rng = np.random.default_rng([seed, 51])
    cone = Cone(2, (3, 2), penalised=1)
    A, d = rng.standard_normal((15, 3, cone.dimension)), rng.standard_normal((15, 3))
    total = np.linalg.norm(d, axis=1).sum()
    return RobustProgram(NormSum(A / total, d / total, cone), 10.0 ** rng.uniform(-3.0, -1.0), threshold)


ROBUST = [partial(robust_program, seed, threshold) for seed in range(3) for threshold in (0.0, 0.03, 10.0)]
SQUARED = [partial(random_program, seed) for seed in range(25)]


def cone_of(program):
    return program.cone if isinstance(program, SemidefiniteProgram) else program.loss.cone


def solved(program):
    """The solution, and by how much its certificate lets the objective exceed the optimum."""
    if isinstance(program, SemidefiniteProgram):
        solution = solve_cone(program, gap=GAP)
        return solution, solution.certificate.gap**2
    solution = solve_robust(program, gap=1e-7)
    return solution, solution.certificate.gap


def objective(program, x):
    """From residuals and matrices themselves."""
    cone = cone_of(program)
    if isinstance(program, SemidefiniteProgram):
        loss = np.square(program.fit.R @ x - program.fit.z).sum()
    else:
        h, norms = program.threshold, np.linalg.norm(program.loss.A @ x - program.loss.d, axis=1)
        loss = np.where(norms > h, norms - 0.5 * h, np.square(norms) / (2.0 * h or 1.0)).sum()
    traces = sum(np.trace(to_matrix(x[place], size)) for size, place in cone.blocks())
    return float(loss + program.weight * (traces + x[cone.free : cone.nonnegative].sum()))


@examples(30)
@given(arrays(float, (4, 4), elements=st.floats(-1e3, 1e3)), arrays(float, (4, 4), elements=st.floats(-1, 1)))
def test_vectors_have_the_inner_product_of_the_matrices(A, B):
    A, B = A + A.T, B + B.T
    np.testing.assert_allclose(to_vector(A) @ to_vector(B), np.trace(A @ B), atol=1e-9)
    np.testing.assert_allclose(to_matrix(to_vector(A), 4), A)


@examples(30)
@given(st.integers(0, 10**6), st.integers(1, 6), st.floats(-12, 3))
def test_a_raised_block_has_no_computed_eigenvalue_below_zero(seed, size, decade):
    half = np.random.default_rng(seed).standard_normal((size, 1)) * 10.0**decade
    block = to_vector(half @ half.T)
    lifted = raised(block, size)
    assert np.linalg.eigvalsh(to_matrix(lifted, size)).min() >= 0.0
    np.testing.assert_allclose(lifted, block, atol=1e-13 * np.abs(block).max())


@pytest.mark.parametrize("program", SQUARED + ROBUST)
def test_multipliers_prove_a_bound_below_the_optimum_by_themselves(program):
    """The dual problem, written down anew, each ν_i of a robust loss in the unit ball."""
    program = program()
    solution, gap = solved(program)
    assert solution.certificate.primal == 0.0
    assert cone_of(program).least(solution.x) >= 0.0
    nu = solution.certificate.multipliers
    if isinstance(program, SemidefiniteProgram):
        pull, proven = program.fit.R.T @ nu, -nu @ nu / 4.0 - nu @ program.fit.z
    else:
        assert np.linalg.norm(nu, axis=1).max() <= 1.0 + 1e-14
        pull = np.einsum("kip,ki->p", program.loss.A, nu)
        proven = -(nu * program.loss.d).sum() - 0.5 * program.threshold * np.square(nu).sum()
    assert cone_of(program).least(cone_of(program).penalty(program.weight) + pull) >= -1e-12
    assert abs(objective(program, solution.x) - proven) <= gap + 1e-14


def test_a_single_matrix_has_the_known_optimum():
    """R the identity: nearest to a matrix with a trace penalty is soft thresholding of its eigenvalues."""
    rng = np.random.default_rng(3)
    vectors = np.linalg.qr(rng.standard_normal((5, 5)))[0]
    values = np.array([0.8, 0.4, 0.11, 0.05, -0.6])
    z = to_vector((vectors * values) @ vectors.T)
    size = float(np.linalg.norm(z))
    weight = 0.2 / size
    program = SemidefiniteProgram(LeastSquares(np.eye(15), z / size), Cone(0, (5,)), weight)
    found = solve_cone(program, gap=1e-7).x * size
    expected = (vectors * np.maximum(values - 0.1, 0.0)) @ vectors.T
    np.testing.assert_allclose(to_matrix(found, 5), expected, atol=1e-6)


@pytest.mark.parametrize("spoil", ["shifted", "shrunk", "zero"])
def test_a_wrong_answer_gets_no_certificate(monkeypatch, spoil):
    """Whatever the solver says: an answer with status Solved that is wrong is refused."""
    program = random_program(2, cone=Cone(2, (3, 2)), weight=1e-2)
    right = solve_cone(program, gap=GAP).x
    wrong = {"shifted": right + 1e-2, "shrunk": 0.9 * right, "zero": 0.0 * right}[spoil]
    wrong = program.cone.project(wrong)
    excess = objective(program, wrong) - objective(program, right)
    assert certify_cone(program, wrong).gap >= 0.99 * np.sqrt(excess)
    monkeypatch.setattr(SemidefiniteProgram, "interior_point", lambda *_: wrong)
    monkeypatch.setattr(Face, "step", lambda *_: None)
    with pytest.raises(SolverError, match=r"its gap is \S+, above"):
        solve_cone(program, gap=GAP)


def test_of_answers_that_do_not_do_the_best_is_kept(monkeypatch):
    """They are sought in the unit of the readings and in that of their residual: nothing here, so 1e-9."""
    program = random_program(2, cone=Cone(2, (3, 2)), weight=1e-2)
    right, asked = solve_cone(program, gap=GAP).x, []

    def proposed(self, tolerance, unit):
        asked.append(unit)
        return program.cone.project(right + 1e-3 * len(asked))

    monkeypatch.setattr(SemidefiniteProgram, "interior_point", proposed)
    monkeypatch.setattr(Face, "step", lambda *_: None)
    found = solve_cone(program, gap=1e-12, accepted=10.0)
    np.testing.assert_allclose(found.x, program.cone.project(right + 1e-3), rtol=1e-12)
    assert set(asked) == {1.0, 1e-9}


def test_a_robust_certificate_bounds_any_point_by_any_dual():
    """Truth from outside: the excess of a point's objective, whatever multipliers are proposed."""
    program, rng = robust_program(7, 0.02), np.random.default_rng(7)
    best = objective(program, solve_robust(program, gap=1e-8).x)
    for _ in range(20):
        x = program.loss.cone.project(rng.standard_normal(program.loss.cone.dimension))
        gap = certify_robust(program, x, 3.0 * rng.standard_normal((15, 3))).gap
        assert gap >= objective(program, x) - best - 1e-8


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


@pytest.mark.parametrize(("seed", "rows"), [*((seed, SIZE) for seed in range(8)), (3, 5)])
def test_the_optimum_is_that_of_another_solver(seed, rows):
    A, b, rng = problem(seed, rows)
    found = solve_weighed(A, b, CONES)
    start = inside(rng, 1)[0] + 1e-3
    assert found.certificate.gap <= 1e-8
    assert found.loss <= reference(A, b, start) + 1e-6
    assert (CONES.projected(found.x) == found.x).all()


def test_a_point_that_is_not_the_optimum_is_not_certified(monkeypatch):
    A, b, _ = problem(2)
    solve = programs.Program.solve
    monkeypatch.setattr(
        programs.Program, "solve", lambda self, data, tolerance: 1.001 * solve(self, data, tolerance)
    )
    for rows, right, cones in ((A, b, CONES), (np.eye(1), np.ones(1), Cones((Block(0),), np.full(1, 10.0)))):
        with pytest.raises(SolverError, match="its gap is"):
            solve_weighed(rows, right, cones)


@pytest.mark.parametrize("seed", range(2))
def test_effective_freedom_is_the_divergence_of_the_fit(seed):
    """Against differences of refits: what changes of the readings come through."""
    program = random_program(seed, cone=Cone(3, (4, 3)), weight=0.03)
    step = 1e-3

    def fitted(z):
        return program.fit.R @ solve_cone(replace(program, fit=LeastSquares(program.fit.R, z)), gap=1e-7).x

    divergence = 0.0
    for k, unit in enumerate(np.eye(len(program.fit.z))):
        ends = [fitted(program.fit.z + sign * step * unit)[k] for sign in (1, -1)]
        divergence += (ends[0] - ends[1]) / (2 * step)
    freedom = effective_freedom(program, solve_cone(program, gap=1e-7).x)
    assert freedom.sum() == pytest.approx(divergence, abs=1e-2)
    assert 0.0 < freedom.sum() < program.cone.dimension


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
        c = radius * (near + program.solve({"a": a, **ball}, programs.TOLERANCE))[CONES.first[j]]
        assert abs(max(c, 0.0) - end) <= 1e-6 * np.ptp(found[j])
    for start in inside(rng, 200):  # towards each point, as far as the level set allows
        step = start - optimum.x
        near, slope = A @ optimum.x - b, A @ step
        reach = np.roots([slope @ slope, 2 * near @ slope, -0.5]).real.max()
        x = optimum.x + min(1.0, reach) * step
        c = x[CONES.first]
        assert (c >= found[:, 0] - 1e-9).all()
        assert (c <= found[:, 1] + 1e-9).all()


def test_the_range_far_from_all_bounds_is_that_of_an_ellipsoid():
    """Closed form: the objective is quadratic, its least where the gradient of the penalty is balanced."""
    rng = np.random.default_rng(3)
    cone = Cone(3, (2,), penalised=1)
    truth = np.array([3.0, 4.0, 5.0, 6.0, 0.1, 7.0])
    R = rng.standard_normal((30, 6))
    size = np.linalg.norm(R @ truth)
    fit = LeastSquares(R, R @ truth / size)
    program = SemidefiniteProgram(fit, cone, 1e-4)
    x = np.linalg.lstsq(R, fit.z, rcond=None)[0] - 0.5 * np.linalg.solve(R.T @ R, program.penalty)
    rise, functions = 1e-6, rng.standard_normal((4, 6))
    half = np.sqrt(rise * np.einsum("ki,ij,kj->k", functions, np.linalg.inv(R.T @ R), functions))
    found = penalised_range(program, x, rise, functions)
    expected = (functions @ x)[:, None] + half[:, None] * [-1.0, 1.0]
    np.testing.assert_allclose(found, expected, atol=1e-3 * half.max())
    assert np.isnan(penalised_range(program, x, rise, np.zeros((1, 6)))).all()


def test_the_design_for_the_worst_direction_is_solved_by_hand():
    """Two parameters, informed by 1 and 4 a reading: shares 0.8 and 0.2, none of what tells little."""
    K = np.array([np.diag([1.0, 0.0]), np.diag([0.0, 4.0]), 0.1 * np.eye(2)])
    weights, dual = programs.worst_direction(np.zeros((2, 2)), K, np.ones(2))
    np.testing.assert_allclose(weights, [0.8, 0.2, 0.0], atol=1e-6)
    assert weights[2] == 0.0
    np.testing.assert_allclose(dual, np.diag([0.8, 0.2]), atol=1e-6)
