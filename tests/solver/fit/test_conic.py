"""Conic programs beside others' solvers, and robust losses by them."""

from dataclasses import replace
from functools import partial

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from reference.optima import huber_by_clarabel, huber_objective
from scipy import stats
from scipy.optimize import minimize
from support.campaigns import (
    ARM,
    METHODS_AND_WEIGHTS,
    SIGMA,
    estimate,
    held,
    simulated,
    spring_columns,
    wrench_of,
)
from support.examples import examples
from support.springs import readings_of

from jointstiff.simulator.equilibrium import torques
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit import conic, programs
from jointstiff.solver.fit import stages as robust
from jointstiff.solver.fit.cone import Block, Matrices, WithMasses, lift_diagonal, to_matrix, to_vector
from jointstiff.solver.fit.conic import (
    Face,
    NormSum,
    RobustProgram,
    bound_compliances,
    certify_cone,
    certify_robust,
    compute_effective_freedom,
    compute_penalised_range,
    solve_robust,
)
from jointstiff.solver.fit.method import DEFAULT_THRESHOLD
from jointstiff.solver.fit.problem import LeastSquares, Problem
from jointstiff.solver.fit.solution import solve
from jointstiff.solver.mechanics.chain import ChainJoint, KinematicChain
from jointstiff.solver.mechanics.measurements import EncoderReadings
from jointstiff.solver.mechanics.robot import JointMap, Robot

GAP = 1e-6


def random_program(seed, *, cone=None, weight=None, rows=40):
    rng = np.random.default_rng([seed, 50])
    cone = cone or Matrices(int(rng.integers(0, 4)), tuple(rng.integers(1, 5, rng.integers(1, 4)).tolist()))
    R = rng.standard_normal((rows, cone.dimension)) * 10.0 ** rng.uniform(-1.5, 0.0, cone.dimension)
    R[:, : cone.nonnegative] /= np.linalg.norm(R[:, : cone.nonnegative], axis=0)
    z = rng.standard_normal(rows)
    weight = weight or 10.0 ** rng.uniform(-4.0, 0.0)
    fit = LeastSquares(R, z / np.linalg.norm(z))
    return Problem(fit, cone, weight)


def robust_program(seed, threshold, stated=0):
    rng = np.random.default_rng([seed, 51])
    cone = Matrices(2, (3, 2), penalised=1)
    A, d = rng.standard_normal((15, 3, cone.dimension)), rng.standard_normal((15, 3))
    total, B = np.linalg.norm(d, axis=1).sum(), rng.standard_normal((15, 3, stated))
    loss = NormSum(A / total, d / total, cone, B / total, statement=0.4 / total)
    return RobustProgram(loss, 10.0 ** rng.uniform(-3.0, -1.0), threshold)


ROBUST = [
    partial(robust_program, seed, threshold, stated)
    for seed in range(3)
    for threshold in (1e-4, 0.03, 10.0)
    for stated in (0, 2)
]


def cone_of(program):
    return program.cone if isinstance(program, Problem) else program.loss.cone


def solved(program):
    """The solution, and by how much its certificate lets the objective exceed the optimum."""
    if isinstance(program, Problem):
        solution = solve(program, gap=GAP)
        return solution, solution.certificate.gap**2
    solution = solve_robust(program, wanted_gap=1e-7)
    return solution, solution.certificate.gap


def objective(program, x, errors=()):
    """From residuals and matrices themselves."""
    cone = cone_of(program)
    if isinstance(program, Problem):
        loss = np.square(program.squares.R @ x - program.squares.z).sum()
    else:
        h, of_targets, errors = program.threshold, program.loss, np.array(errors, dtype=float)
        norms = np.linalg.norm(of_targets.A @ x + of_targets.B @ errors - of_targets.d, axis=1)
        loss = np.where(norms > h, norms - 0.5 * h, np.square(norms) / (2.0 * h)).sum()
        loss += np.square(of_targets.statement * errors).sum() / (2.0 * h)
    traces = sum(np.trace(to_matrix(x[place], size)) for size, place in cone.blocks())
    return float(loss + program.weight * (traces + x[cone.unpenalised : cone.nonnegative].sum()))


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
    lifted = lift_diagonal(block, size)
    assert np.linalg.eigvalsh(to_matrix(lifted, size)).min() >= 0.0
    np.testing.assert_allclose(lifted, block, atol=1e-13 * np.abs(block).max())


@pytest.mark.parametrize("program", [partial(random_program, seed) for seed in range(25)] + ROBUST)
def test_multipliers_prove_a_bound_below_the_optimum_by_themselves(program):
    """The dual problem, written down anew, each ν_i of a robust loss in the unit ball."""
    program = program()
    solution, gap = solved(program)
    assert solution.certificate.primal == 0.0
    assert cone_of(program).least_value(solution.x) >= 0.0
    nu = solution.certificate.multipliers
    if isinstance(program, Problem):
        pull, proven = program.squares.R.T @ nu, -nu @ nu / 4.0 - nu @ program.squares.z
    else:
        assert np.linalg.norm(nu, axis=1).max() <= 1.0 + 1e-14
        pull = np.einsum("kip,ki->p", program.loss.A, nu)
        h, of_targets = program.threshold, program.loss
        pull_of_errors = np.einsum("kiq,ki->q", of_targets.B, nu)
        proven = -(nu * of_targets.d).sum() - 0.5 * h * np.square(nu).sum()
        proven -= 0.5 * h * np.square(pull_of_errors / of_targets.statement).sum()
    assert cone_of(program).least_value(cone_of(program).penalty(program.weight) + pull) >= -1e-12
    errors = getattr(solution, "errors", ())
    assert abs(objective(program, solution.x, errors) - proven) <= gap + 1e-14


def test_a_single_matrix_has_the_known_optimum():
    """R the identity: nearest to a matrix with a trace penalty is soft thresholding of its eigenvalues."""
    rng = np.random.default_rng(3)
    vectors = np.linalg.qr(rng.standard_normal((5, 5)))[0]
    values = np.array([0.8, 0.4, 0.11, 0.05, -0.6])
    z = to_vector((vectors * values) @ vectors.T)
    size = float(np.linalg.norm(z))
    weight = 0.2 / size
    program = Problem(LeastSquares(np.eye(15), z / size), Matrices(0, (5,)), weight)
    found = solve(program, gap=1e-7).x * size
    expected = (vectors * np.maximum(values - 0.1, 0.0)) @ vectors.T
    np.testing.assert_allclose(to_matrix(found, 5), expected, atol=1e-6)


@pytest.mark.parametrize("spoil", ["shifted", "shrunk", "zero"])
def test_a_wrong_answer_gets_no_certificate(monkeypatch, spoil):
    """Whatever the solver says: an answer with status Solved that is wrong is refused."""
    program = random_program(2, cone=Matrices(2, (3, 2)), weight=1e-2)
    right = solve(program, gap=GAP).x
    wrong = {"shifted": right + 1e-2, "shrunk": 0.9 * right, "zero": 0.0 * right}[spoil]
    wrong = program.cone.project(wrong)
    excess = objective(program, wrong) - objective(program, right)
    assert certify_cone(program, wrong).gap >= 0.99 * np.sqrt(excess)
    monkeypatch.setattr(conic, "find_interior_point", lambda *_: wrong)
    monkeypatch.setattr(Face, "take_newton_step", lambda *_: None)
    with pytest.raises(SolverError, match=r"the gap to the optimum is \S+, above"):
        solve(program, gap=GAP)


def test_of_answers_that_do_not_do_the_best_is_kept(monkeypatch):
    """They are sought in the unit of the readings and in that of their residual: nothing here, so 1e-9."""
    program = random_program(2, cone=Matrices(2, (3, 2)), weight=1e-2)
    right, asked = solve(program, gap=GAP).x, []

    def proposed(_, tolerance, unit):
        asked.append(unit)
        return program.cone.project(right + 1e-3 * len(asked))

    monkeypatch.setattr(conic, "find_interior_point", proposed)
    monkeypatch.setattr(Face, "take_newton_step", lambda *_: None)
    found = solve(program, gap=1e-12, accepted=10.0)
    np.testing.assert_allclose(found.x, program.cone.project(right + 1e-3), rtol=1e-12)
    assert set(asked) == {1.0, 1e-9}


def test_a_robust_certificate_bounds_any_point_by_any_dual():
    """Truth from outside: the excess of a point's objective, whatever multipliers are proposed."""
    program, rng = robust_program(7, 0.02, stated=2), np.random.default_rng(7)
    optimum = solve_robust(program, wanted_gap=1e-8)
    best = objective(program, optimum.x, optimum.errors)
    for _ in range(20):
        x = program.loss.cone.project(rng.standard_normal(program.loss.cone.dimension))
        errors = rng.standard_normal(2)
        gap = certify_robust(program, x, errors, 3.0 * rng.standard_normal((15, 3))).gap
        assert gap >= objective(program, x, errors) - best - 1e-8


BLOCKS = (Block(2, ((1, 0.3), (-1, 0.0))), Block(0), Block(1))
CONES = WithMasses(BLOCKS, np.array([50.0, 40.0, 60.0]))
SIZE = sum(block.size for block in BLOCKS)


def test_cones_are_left_by_no_point_and_bounded_by_hand():
    x = np.array([60.0, -70.0, 10.0, 100.0, 0.0, 0.0, 0.0, 30.0, 0.0, -1.0, 5.0, 9.0])
    drawn_in = [50.0, -50.0, 10.0, 53.0, 0.0, 0.0, 0.0, 30.0, 0.0, 0.0, 5.0, 5.0]
    np.testing.assert_allclose(CONES.move_into_set(x), drawn_in)
    # 50 (10 - 1 - |-2 - 0.3 · 5| - 5 - 2) + 40 (-2) + 60 (1 - 3); nothing where such a sum is positive
    s = np.array([10.0, 1.0, -2.0, 3.0, 0.0, 4.0, 0.0, 2.0, 0.0, -2.0, 1.0, -3.0])
    for c, least in ((10.0, -275.0), (11.4, -205.0), (11.6, -200.0)):
        s[0] = c
        assert CONES.minimise_linear_function(s) == pytest.approx(least)


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
    program = Problem(LeastSquares(A, b), CONES)
    found = solve(program)
    start = inside(rng, 1)[0] + 1e-3
    assert found.certificate.gap <= 1e-8
    assert program.squares.loss(found.x) <= reference(A, b, start) + 1e-6
    assert (CONES.move_into_set(found.x) == found.x).all()


def test_a_point_that_is_not_the_optimum_is_not_certified(monkeypatch):
    A, b, _ = problem(2)
    by_clarabel = programs.Program.solve
    monkeypatch.setattr(
        programs.Program, "solve", lambda self, data, tolerance: 1.001 * by_clarabel(self, data, tolerance)
    )
    for rows, right, cones in (
        (A, b, CONES),
        (np.eye(1), np.ones(1), WithMasses((Block(0),), np.full(1, 10.0))),
    ):
        with pytest.raises(SolverError, match="the gap to the optimum is"):
            solve(Problem(LeastSquares(rows, right), cones))


@pytest.mark.parametrize("seed", [1, 4, 7, 11])
def test_columns_that_depend_on_each_other_are_certified_if_the_residual_is_small(seed):
    """In units of the readings, Clarabel's answers have gaps of 5e-8 to 1e-6 for these problems."""
    rng = np.random.default_rng(seed)
    blocks = (Block(3),) * 5
    cones, size = WithMasses(blocks, np.full(5, 60.0)), sum(block.size for block in blocks)
    U, V = (np.linalg.qr(rng.standard_normal((size, size)))[0] for _ in range(2))
    singular_values = np.concatenate([10.0 ** -np.linspace(0, 8, size - 5), np.zeros(5)])
    A = U * singular_values @ V.T
    b = A @ cones.move_into_set(rng.standard_normal(size))
    b = b / np.linalg.norm(b) + 0.02 * rng.standard_normal(size) / np.sqrt(size)
    assert solve(Problem(LeastSquares(A, b), cones)).certificate.gap <= 1e-8


@pytest.mark.parametrize("seed", range(2))
def test_effective_freedom_is_the_divergence_of_the_fit(seed):
    """Against differences of refits: what changes of the readings come through."""
    program = random_program(seed, cone=Matrices(3, (4, 3)), weight=0.03)
    step = 1e-3

    def fitted(z):
        return (
            program.squares.R
            @ solve(replace(program, squares=LeastSquares(program.squares.R, z)), gap=1e-7).x
        )

    divergence = 0.0
    for k, unit in enumerate(np.eye(len(program.squares.z))):
        ends = [fitted(program.squares.z + sign * step * unit)[k] for sign in (1, -1)]
        divergence += (ends[0] - ends[1]) / (2 * step)
    freedom = compute_effective_freedom(program, solve(program, gap=1e-7).x)
    assert freedom.sum() == pytest.approx(divergence, abs=1e-2)
    assert 0.0 < freedom.sum() < program.cone.dimension


@pytest.mark.parametrize("seed", range(4))
def test_ends_hold_all_points_near_the_optimum_and_no_more(seed):
    A, b, rng = problem(seed)
    squares = LeastSquares(A, b)
    convex = Problem(squares, CONES)
    optimum = solve(convex)
    found = bound_compliances(convex, optimum.x, 0.5)
    radius = np.sqrt(squares.loss(optimum.x) + 0.5)
    program = programs.state_mass_cone_end(SIZE, BLOCKS)
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
    cone = Matrices(3, (2,), penalised=1)
    truth = np.array([3.0, 4.0, 5.0, 6.0, 0.1, 7.0])
    R = rng.standard_normal((30, 6))
    size = np.linalg.norm(R @ truth)
    fit = LeastSquares(R, R @ truth / size)
    program = Problem(fit, cone, 1e-4)
    np.testing.assert_array_equal(program.penalty, 1e-4 * np.array([0.0, 0.0, 1.0, 1.0, 0.0, 1.0]))
    x = np.linalg.lstsq(R, fit.z, rcond=None)[0] - 0.5 * np.linalg.solve(R.T @ R, program.penalty)
    rise, functions = 1e-6, rng.standard_normal((4, 6))
    half = np.sqrt(rise * np.einsum("ki,ij,kj->k", functions, np.linalg.inv(R.T @ R), functions))
    found = compute_penalised_range(program, x, rise, functions)
    expected = (functions @ x)[:, None] + half[:, None] * [-1.0, 1.0]
    np.testing.assert_allclose(found, expected, atol=1e-3 * half.max())
    assert np.isnan(compute_penalised_range(program, x, rise, np.zeros((1, 6)))).all()


def test_a_semidefinite_program_finds_the_nearest_point_of_its_cone():
    """T the identity: y brings near + y to the projection of near + z - p / 2, by eigenvalues."""
    near, z, p = np.random.default_rng(1).standard_normal((3, 7))
    data = {"T": np.eye(7), "z": z, "p": p, "near": near}
    wanted = near + z - 0.5 * p
    values, vectors = np.linalg.eigh(to_matrix(wanted[1:], 3))
    nearest = to_vector((vectors * np.maximum(values, 0.0)) @ vectors.T)
    found = programs.state_semidefinite(7, Matrices(1, (3,))).solve(data, 1e-9)
    np.testing.assert_allclose(near + found, [max(wanted[0], 0.0), *nearest], atol=1e-6)


def test_the_design_for_the_worst_direction_is_solved_by_hand():
    """Two parameters, informed by 1 and 4 a reading: shares 0.8 and 0.2, none of what tells little."""
    K = np.array([np.diag([1.0, 0.0]), np.diag([0.0, 4.0]), 0.1 * np.eye(2)])
    weights, dual = programs.solve_e_optimal_design(np.zeros((2, 2)), K, np.ones(2))
    np.testing.assert_allclose(weights, [0.8, 0.2, 0.0], atol=1e-6)
    assert weights[2] == 0.0
    np.testing.assert_allclose(dual, np.diag([0.8, 0.2]), atol=1e-6)


@pytest.fixture(scope="module")
def pulls():
    """Deflections of the linear model, exactly: what is estimated from them has no bias of its own."""
    robot, measurements = simulated(load="pull", configurations=15, sigma=0.0, seed=6)
    deflection = spring_columns(measurements) @ ARM.compliances
    return robot, replace(measurements, deflection=deflection, sigma=SIGMA)


@pytest.fixture(scope="module")
def bad(pulls):
    """The same with noise, a tenth of the readings 20 sigma off."""
    robot, exact = pulls
    return robot, spoilt(noisy(exact, 2), 2)[0]


def noisy(measurements, seed):
    noise = np.random.default_rng([seed, 1]).standard_normal(measurements.deflection.shape)
    return replace(measurements, deflection=measurements.deflection + SIGMA * np.sqrt(2.0) * noise)


def spoilt(measurements, seed, *, share=0.1, size=20.0):
    """Add errors of so many sigma, in directions of their own, to a share of the readings."""
    rng = np.random.default_rng([seed, 2])
    count, targets = measurements.present.shape
    bad = rng.permutation(count * targets)[: round(share * count * targets)]
    directions = rng.standard_normal((len(bad), 3))
    directions *= size * np.sqrt(2.0) * SIGMA / np.linalg.norm(directions, axis=1, keepdims=True)
    deflection = measurements.deflection.copy()
    deflection.reshape(-1, 3)[bad] += directions
    places = {divmod(int(i), targets) for i in bad}
    return replace(measurements, deflection=deflection), places


def rows_of(robot, measurements):
    """(K, 3, n) and (K, 3) whitened rows, by the simulator: a column is the deflection by one soft joint."""
    A = spring_columns(measurements)[measurements.present]
    return A / np.sqrt(2.0), measurements.deflection[measurements.present] / np.sqrt(2.0)


class TestAgainstConePrograms:
    @pytest.mark.parametrize(("seed", "threshold"), [(0, 0.3), (1, 2.8), (2, 10.0)])
    def test_partial_pose_is_the_huber_estimate(self, pulls, threshold, seed):
        robot, measurements = pulls
        measurements, _ = spoilt(noisy(measurements, seed), seed)
        found = estimate(robot, measurements, loss="huber", huber_threshold=threshold)
        A, d = rows_of(robot, measurements)
        expected, value = huber_by_clarabel(A, d, threshold)
        uncertainty = np.sqrt(np.diag(found.covariance))
        np.testing.assert_allclose((found.compliance - expected) / uncertainty, 0.0, atol=2e-4)
        # To the objective, which it is sharper in, ours is no worse than the cone program's.
        assert huber_objective(A, d, found.compliance, threshold) <= value * (1 + 1e-9)

    @pytest.mark.parametrize(
        ("options", "program", "at_bound"),
        [
            (
                {"stiffness_bounds": {"joint_2": (3.3e6, None), "joint_5": (None, 0.2e6)}},
                {"limits": lambda c: [c[1] <= 1 / 3.3, c[4] >= 1 / 0.2]},
                [1, 4],
            ),
            ({"stiffness_order": [["joint_6", "joint_5"]]}, {"limits": lambda c: [c[5] <= c[4]]}, [4, 5]),
            (
                {"priors": {"joint_4": {"stiffness": 1e6 / 3.0, "standard_uncertainty": 1e5 / 9.0}}},
                {"extra": lambda c: cp.square((c[3] - 3.0) / 0.1) / 2},
                [],
            ),
        ],
    )
    def test_with_what_is_known_of_the_joints(self, bad, options, program, at_bound):
        found = estimate(*bad, loss="huber", **options)
        expected, _ = huber_by_clarabel(*rows_of(*bad), 2.8, **program)
        np.testing.assert_allclose(found.compliance, expected, rtol=1e-4)
        assert [j for j in range(6) if found.joints[j].status == "at_bound"] == at_bound
        assert (found.compliance[4] == found.compliance[5]) == ("stiffness_order" in options)

    def test_encoders_keep_the_squared_loss(self, bad):
        robot, measurements = bad
        torque = torques(ARM, measurements.joints, *wrench_of(measurements))
        deflection = 1.01 * ARM.compliances * torque + np.random.default_rng(0).normal(0.0, 1e-5, (15, 6))
        present = np.zeros((15, 6), dtype=bool)
        present[:, 1] = True
        encoders = EncoderReadings(np.where(present, deflection, 0.0), present, 5e-6)
        found = estimate(robot, replace(measurements, encoders=encoders), loss="huber")

        def squared(c):
            residual = (deflection[:, 1] - torque[:, 1] * c[1] * 1e-6) / (np.sqrt(2.0) * 5e-6)
            return cp.sum_squares(residual) / 2

        expected, _ = huber_by_clarabel(*rows_of(*bad), 2.8, extra=squared)
        np.testing.assert_allclose(found.compliance, expected, rtol=1e-4)


def one_joint(deflections, sigma=1e-5):
    """A joint about z that 1000 N·m twist, and a target 1 m away that moves along y [m]."""
    z = np.array([0.0, 0.0, 1.0])
    joint = ChainJoint("joint_1", "revolute", np.eye(3), np.zeros(3), z, None, "flange")
    robot = Robot(KinematicChain("one", "base", "flange", (joint,)).model(), JointMap.identity(1))
    count = len(deflections)
    moved = np.zeros((count, 1, 3))
    moved[:, 0, 1] = deflections
    tip = [1.0, 0.0, 0.0]
    everywhere = np.ones((count, 1), dtype=bool)
    loads = (np.zeros((count, 1)), [0.0, 1000.0, 0.0], tip, tip)
    return robot, readings_of(*loads, moved, in_flange=everywhere, sigma=sigma)


class TestByHand:
    """One joint: the deflection of the target is 1000 c, and k = threshold √2 sigma is a length."""

    @pytest.mark.parametrize(
        ("readings", "expected"),
        [
            ([1.0, 1.0, 1.0, 21.0], 1.0 + 1 / 3),  # 3 (x - 1) = k
            ([1.0, 1.0, 1.0, 21.0, 31.0], 1.0 + 2 / 3),  # 3 (x - 1) = 2 k
            ([-20.0, 1.0, 2.0, 40.0], 1.5),  # the outliers cancel
            ([1.0, 1.5, 2.0], 1.5),  # all within: the mean
            ([-50.0, 3.0, 100.0], 3.0),  # the median
        ],
    )
    def test_conditions_solved_on_paper(self, readings, expected):
        k = 2.0 * np.sqrt(2.0) * 1e-5
        robot, measurements = one_joint([k * reading for reading in readings])
        found = estimate(robot, measurements, loss="huber", huber_threshold=2.0, positive=False)
        assert 1000.0 * found.compliance[0] / k == pytest.approx(expected, rel=1e-12)

    def test_weights_are_threshold_over_norm(self):
        k = 2.0 * np.sqrt(2.0) * 1e-5
        robot, measurements = one_joint([k, k, k, 21.0 * k])
        found = estimate(robot, measurements, loss="huber", huber_threshold=2.0, positive=False)
        far = 21.0 - 4.0 / 3.0
        np.testing.assert_allclose(found.robust.weight[:, 0], [1, 1, 1, 1 / far], rtol=1e-12)
        np.testing.assert_allclose(found.robust.residual_norm[3, 0], 2.0 * far, rtol=1e-12)
        assert found.robust.suspicious.tolist() == [[3, 0]]
        # Huber's a / b² beside weighted least squares: mean of 3 w² t² / 3 over its slope, squared.
        norm = stats.chi(3)
        good = norm.expect(lambda x: x**2, ub=2.0) / norm.cdf(2.0) / 3.0
        a, b = (3 * good + 2.0**2 / 3.0) / 4.0, (3.0 + 2.0 / 3.0 / far) / 4.0
        expected = 2.0 * 1e-10 / 1000.0**2 / 4.0 * a / b**2
        assert found.covariance[0, 0] / expected == pytest.approx(1.0, rel=1e-9)

    def test_a_tie_has_a_whole_interval_of_optima(self):
        k = 0.1 * np.sqrt(2.0) * 1e-5
        robot, measurements = one_joint([0.0, 0.0, 100 * k, 100 * k])
        found = estimate(robot, measurements, loss="huber", huber_threshold=0.1, positive=False)
        assert k <= 1000.0 * found.compliance[0] <= 99.0 * k
        assert found.certificates[0].is_optimal()


class TestGrossErrors:
    @pytest.mark.parametrize(
        ("method", "weighting", "sigma"),
        [
            ("partial_pose", "covariance", None),
            ("complete_pose", "characteristic_length", SIGMA),
            ("decoupled_partial_pose", "covariance", SIGMA),
            *(pytest.param(*chosen, SIGMA, marks=pytest.mark.slow) for chosen in METHODS_AND_WEIGHTS[:-1]),
        ],
    )
    def test_bias_stays_below_a_standard_uncertainty_where_the_squared_loss_fails(
        self, pulls, method, weighting, sigma
    ):
        robot, exact = pulls
        options = {"method": method, "weighting": weighting}
        if weighting == "characteristic_length":
            options["characteristic_length"] = 0.6
        changes = {"huber": [], "squared": []}
        for seed in range(10):
            clean = noisy(replace(exact, sigma=sigma), seed)
            bad, _ = spoilt(clean, seed)
            expected = estimate(robot, clean, **options)
            uncertainty = np.sqrt(np.diag(expected.covariance))
            for loss, found in changes.items():
                result = estimate(robot, bad, loss=loss, **options)
                found.append((result.compliance - expected.compliance) / uncertainty)
        bias = {loss: np.abs(np.mean(found, axis=0)).max() for loss, found in changes.items()}
        deviation = {loss: np.sqrt(np.mean(np.square(found), axis=0)) for loss, found in changes.items()}
        # Gross errors in random directions bias no loss much on average; they ruin each squared fit.
        assert bias["huber"] < 1.0
        assert (deviation["huber"] < 1.5).all()
        assert (deviation["squared"] > 2.0).all()

    def test_constants_are_quantiles_of_the_norm_of_a_good_residual(self):
        norm = stats.chi(3)
        assert norm.cdf(DEFAULT_THRESHOLD) == pytest.approx(0.95, abs=1e-3)
        assert norm.cdf(robust.SUSPICIOUS_NORM) == pytest.approx(0.999)


@examples(25)
@given(
    seed=st.integers(0, 2**32 - 1),
    threshold=st.floats(0.1, 100.0),
    share=st.floats(0.0, 0.6),
    size=st.floats(0.0, 6.0),
    positive=st.booleans(),
    known=st.booleans(),
    count=st.integers(3, 15),
)
def test_a_robust_fit_is_always_certified(pulls, seed, threshold, share, size, positive, known, count):
    robot, exact = pulls
    bad, _ = spoilt(noisy(exact[:count], seed), seed, share=share, size=10.0**size)
    bad = replace(bad, sigma=SIGMA if known else None)
    found = estimate(robot, bad, loss="huber", huber_threshold=threshold, positive=positive)
    assert all(certificate.is_optimal() for certificate in found.certificates)
    assert len(found.certificates) == 2
    assert ((found.robust.weight > 0) & (found.robust.weight <= 1)).all()
    assert _stationary(robot, bad, found, threshold) < 1e-7


def _stationary(robot, measurements, found, threshold):
    """Largest gradient of the free joints, as a cosine; the rows are the simulator's."""
    A, d = rows_of(robot, measurements)
    residual = d - A @ found.compliance
    norm = np.linalg.norm(residual, axis=1)
    pull = residual * np.minimum(1.0, threshold * found.sigma / np.maximum(norm, 1e-300))[:, None]
    root = np.sqrt(found.robust.weight[measurements.present])[:, None]
    columns = np.linalg.norm(root[..., None] * A, axis=(0, 1))
    cosine = np.einsum("kij,ki->j", A, pull) / (columns * np.linalg.norm(root * d))
    free = found.compliance != 0.0  # a joint at its bound may also be hidden by the noise
    return float(np.abs(cosine[free]).max(initial=0.0))


class TestRefusals:
    def test_an_optimum_without_a_certificate_is_none(self, bad, monkeypatch):
        monkeypatch.setattr(robust, "MOST_ROUNDS", 2)
        monkeypatch.setattr(robust, "MOST_STATED", 0)
        with pytest.raises(SolverError, match="did not converge to an optimum"):
            estimate(*bad, loss="huber")


@pytest.mark.parametrize("count", [20, pytest.param(60, marks=pytest.mark.slow)])
def test_intervals_cover_the_truth_although_a_tenth_of_the_readings_is_wrong(pulls, count):
    robot, exact = pulls
    covered = []
    for seed in range(count):
        found = estimate(robot, spoilt(noisy(exact, seed), seed)[0], loss="huber")
        covered += held(found.joints, ARM.compliances)
    # Six intervals of 95 % a campaign, which are correlated: half as good as independent ones at least.
    assert abs(np.mean(covered) - 0.95) < 2.5 * np.sqrt(0.95 * 0.05 / (3 * count))
