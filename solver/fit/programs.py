"""Convex programs of the project, stated in cvxpy and solved by Clarabel; docs/method.md has the formulas.

    solve_least_squares  minimise ‖A x − b‖²                            identification (§5)
    solve_huber          minimise Σ_i ρ(‖d_i − A_i x‖) + ½ ‖S x − t‖²   identification with Huber's loss (§5)
    state_semidefinite   minimise ‖T y − z‖² + pᵀy                      elastic links (§7)
    state_sum_of_norms   minimise Σ_i ρ(‖A_i x + B_i v − d_i‖) + ‖v‖²/(2h) + pᵀx    links, robust losses (§7)
    state_penalised_end  minimise aᵀx subject to ‖T x − z‖² + pᵀx ≤ J   effective compliance's interval (§7)
    state_mass_cones     minimise ‖A x − b‖²                            stiffness without a load (§14)
    state_mass_cone_end  minimise aᵀx subject to ‖A x − b‖ ≤ 1          interval without a load (§14)
    solve_e_optimal_design  maximise t subject to M(w) − t diag(V⁻², 0) ⪰ 0         E-optimal design (§10)

The first two are subject to lower ≤ x ≤ upper and B x ≥ d, the next three to x_j ≥ 0 and Mat(x_b) ⪰ 0,
with x = near + y in the first of them, the next two to the cones of `cone.WithMasses`, and the last one to
M(w) = M0 + Σ w_i K_i, Σ w = 1 and w ≥ 0. Variables are equilibrated. A program is compiled once for a
shape, its data being parameters. `solve_huber`, `state_sum_of_norms`, `state_penalised_end` and designs are
stated with their data, as that compiles faster. Ends of joints' intervals are found in batches, by
`fit.estimate`.

The points returned are near an optimum, to Clarabel's tolerance: callers polish them, and certify the outcome
from the data. cvxpy takes a second to import: this module is imported where a program is needed first.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any, Final, NamedTuple

import clarabel
import cvxpy as cp
import numpy as np
from cvxpy.reductions.solvers.conic_solvers.clarabel_conif import dims_to_solver_cones
from scipy.sparse import csc_array, csr_array, triu

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.cone import Block, Matrices, Scalars, to_matrix
from jointstiff.solver.fit.problem import Problem

TOLERANCE: Final = 1e-10
"""Tolerance of Clarabel for least squares: the default, an absolute gap of 1e-8, bounds the residual only by
the root of the gap, 1e-4."""

_DESIGN_TOLERANCES: Final = (1e-9, 1e-7)
"""Tolerances for designs, tried in this order."""

SETTINGS: Final[Mapping[str, Any]] = {
    "verbose": False,
    "max_iter": 200,
    "max_threads": 1,
    "iterative_refinement_abstol": 1e-14,
    "iterative_refinement_reltol": 1e-14,
    "iterative_refinement_max_iter": 30,
}

COMPILING: Final = threading.RLock()
"""Lock that a thread acquires to state and compile a program, as threads share cvxpy's variable counter."""


class Answer(NamedTuple):
    """Clarabel's optimum of a program."""

    x: FloatArray  # of the variable that was named when the program was compiled
    multipliers: FloatArray  # of the second-order cones, one after the other


class Program:
    """A program that cvxpy has compiled: cone data ``minimise ½ vᵀP v + qᵀv, A v + s = b, s in a cone``.

    P is constant, and q, A and b are affine in the parameters, as cvxpy's `ParamConeProg` describes. Solving
    changes nothing in the program, so that threads may share a program.
    """

    def __init__(self, objective: cp.Minimize, constraints: Sequence[cp.Constraint], x: cp.Variable) -> None:
        """Compile a program.

        Args:
            objective: quadratic or linear, without parameters in the quadratic part.
            constraints: membership in cones, linear in the variables.
            x: the variable whose optimum `solve` returns.
        """
        problem = cp.Problem(objective, list(constraints))
        for parameter in problem.parameters():
            parameter.value = np.zeros(parameter.shape)
        data, _, _ = problem.get_problem_data(cp.CLARABEL)
        compiled = data[cp.settings.PARAM_PROB]
        self._q, self._A, self._b = data["c"], data["A"], data["b"]
        is_quadratic = data.get("P") is not None
        variables = len(self._q)
        self._P = triu(data["P"], format="csc") if is_quadratic else csc_array((variables, variables))

        # Rows of A: equations, inequalities, second-order cones, then other cones. Clarabel's own objects of
        # cones cannot be pickled, so that `solve` builds them from these numbers.
        self._dims = data["dims"]
        first_norm = int(self._dims.zero) + int(self._dims.nonneg)
        self._norms = slice(first_norm, first_norm + int(sum(self._dims.soc)))

        # q, A and b are a matrix times the vector of all parameters, in which each has its first column.
        self._columns = {each.name(): compiled.param_id_to_col[each.id] for each in problem.parameters()}
        self._maps: tuple[csr_array, csr_array, tuple[Any, ...]] | None = None
        if self._columns:
            reduced = compiled.reduced_A
            self._maps = compiled.q.tocsr(), reduced.reduced_mat, reduced.problem_data_index
        first_of_x = compiled.var_id_to_col[x.id]
        self._x = slice(first_of_x, first_of_x + x.size)

    def solve(self, data: Mapping[str, FloatArray], *tolerances: float) -> FloatArray | None:
        """Return Clarabel's optimum of x, for the first tolerance that is reached; None if none is reached.

        Args:
            data: value of each parameter, by the parameter's name.
            tolerances: tolerances of gap and feasibility, in the order in which they are tried.
        """
        answer = self.solve_with_duals(data, *tolerances)
        return None if answer is None else answer.x

    def solve_with_duals(self, data: Mapping[str, FloatArray], *tolerances: float) -> Answer | None:
        """Solve by Clarabel; try the tolerances in turn until Clarabel reports `Solved`.

        None if no tolerance is reached.

        Args:
            data: value of each parameter, by the parameter's name.
            tolerances: tolerances of gap and feasibility, in the order in which they are tried.
        """
        settings = clarabel.DefaultSettings()
        for name, value in SETTINGS.items():
            setattr(settings, name, value)
        q, A, b = self._cone_data(data)
        cones = dims_to_solver_cones(self._dims)
        for tolerance in tolerances:
            settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
            answer = clarabel.DefaultSolver(self._P, q, A, b, cones, settings).solve()
            x = np.asarray(answer.x[self._x], dtype=np.float64)
            is_solved = answer.status == clarabel.SolverStatus.Solved
            if is_solved and np.isfinite(x).all():
                multipliers = np.asarray(answer.z[self._norms], dtype=np.float64)
                return Answer(x, multipliers)
        return None

    def _cone_data(self, data: Mapping[str, FloatArray]) -> tuple[FloatArray, csc_array, FloatArray]:
        """Return q, A and b of the cone program ``minimise ½xᵀPx + qᵀx, b − A x in the cones``.

        `data` has the value of each parameter by the parameter's name; other entries are ignored.
        """
        if self._maps is None:
            return self._q, self._A, self._b
        to_q, to_entries, sparsity = self._maps
        values = np.zeros(to_entries.shape[1])  # of all parameters, flattened column by column
        values[-1] = 1.0  # multiplies the part of q, A and b that is constant
        for name, first in self._columns.items():
            value = data[name]
            values[first : first + value.size] = value.ravel(order="F")
        q = (to_q @ values)[:-1]  # without cvxpy's last entry, a constant of the objective

        # cvxpy gives the nonzero entries of the sparse matrix [−A b], column by column.
        entries = to_entries @ values
        row_of_entry, first_of_column, (row_count, column_count) = sparsity
        first_of_b = first_of_column[-2]
        A = csc_array(
            (-entries[:first_of_b], row_of_entry[:first_of_b], first_of_column[:-1]),
            shape=(row_count, column_count - 1),
        )
        b = np.zeros(row_count)
        b[row_of_entry[first_of_b:]] = entries[first_of_b:]
        return q, A, b


def solve_least_squares(problem: Problem[Scalars]) -> FloatArray | None:
    """Solve ``minimise ‖A x − b‖² subject to lower ≤ x ≤ upper, B x ≥ d`` by Clarabel.

    Returns a point x (n,) near the optimum; None if Clarabel fails.
    """
    shape = _find_shape(problem)
    program = _state_least_squares(shape)  # compiled once for each shape
    return program.solve(_collect_data(problem), TOLERANCE)


@lru_cache(maxsize=128)
def _state_least_squares(shape: _Shape) -> Program:
    """Compile ``minimise ‖A x − b‖² subject to lower ≤ x ≤ upper, B x ≥ d`` for a problem's shape.

    Returns:
        The program; its parameters are A, b, lower, upper, B and d.
    """
    with COMPILING:
        x, r = cp.Variable(shape.columns), cp.Variable(shape.rows)
        A = cp.Parameter((shape.rows, shape.columns), name="A")
        b = cp.Parameter(shape.rows, name="b")
        constraints = [r == A @ x - b, *_state_constraints(x, shape)]
        return Program(cp.Minimize(cp.sum_squares(r)), constraints, x)


def solve_huber(
    A: FloatArray, d: FloatArray, S: FloatArray, t: FloatArray, least_squares: Problem[Scalars]
) -> FloatArray | None:
    """Solve ``minimise Σ_i ρ(‖d_i − A_i c‖) + ½ ‖S c − t‖²`` under the constraints.

    ρ(u) is u²/2 up to 1, and u − ½ beyond (Huber 1964, on norms, so that no frame is preferred).

    Args:
        A: (K, 3, n) regressor of K targets, in units of the threshold.
        d: (K, 3) deflections of the targets, in units of the threshold.
        S: (q, n) regressor of the rows whose loss remains squared.
        t: (q,) readings of these rows.
        least_squares: problem with the same rows by squares: gives the constraints and the units of c.

    Returns:
        (n,) compliances [rad/(N·m)] to Clarabel's tolerance; None if Clarabel fails.
    """
    scaled = least_squares.equilibrated
    n = len(scaled.unit)
    with COMPILING:
        x = cp.Variable(n)  # c divided by its units
        residuals = d.ravel() - (A * scaled.unit).reshape(-1, n) @ x
        norms = cp.norm(cp.reshape(residuals, d.shape, order="C"), axis=1)
        robust = 0.5 * cp.sum(cp.huber(norms, 1.0))  # cvxpy's huber is u² up to 1, twice ρ
        squares = 0.5 * cp.sum_squares((S * scaled.unit) @ x - t)
        constraints = _state_constraints(x, _find_shape(scaled.problem))
        program = Program(cp.Minimize(robust + squares), constraints, x)
    point = program.solve(_collect_data(scaled.problem), TOLERANCE)
    if point is None:
        return None
    return scaled.problem.cone.bounds.snap(point) * scaled.unit


@lru_cache(maxsize=8)  # a program of 264 parameters takes 15 MB
def state_semidefinite(rows: int, cone: Matrices) -> Program:
    """Compile ``minimise ‖T y − z‖² + pᵀy subject to near_j + y_j ≥ 0, Mat(near_b + y_b) ⪰ 0``.

    Mat(x_b) is the symmetric matrix with the entries x_b. The residual r = T y − z is a variable of its own,
    so that TᵀT, whose condition number is the square of that of T, is never formed.

    Args:
        rows: number of rows of T.
        cone: cone in which near + y lies, with m parameters.

    Returns:
        The compiled program; its parameters are T (rows, m), z (rows,), p (m,) and near (m,).
    """
    with COMPILING:
        m = cone.dimension
        y, r = cp.Variable(m), cp.Variable(rows)
        T, z = cp.Parameter((rows, m), name="T"), cp.Parameter(rows, name="z")
        p, near = cp.Parameter(m, name="p"), cp.Parameter(m, name="near")
        constraints = [r == T @ y - z, *_state_cone(near + y, cone)]
        return Program(cp.Minimize(cp.sum_squares(r) + p @ y), constraints, y)


def state_sum_of_norms(A: FloatArray, d: FloatArray, cone: Matrices, B: FloatArray) -> Program:
    """Compile ``minimise Σ_i ρ(‖A_i x + B_i v − d_i‖) + ‖v‖²/(2h) + pᵀx, x_j ≥ 0, Mat(x_b) ⪰ 0``.

    ρ is Huber's loss: u²/(2h) up to h and u − h/2 beyond. For a residual r_i it is
    ``min ‖s_i‖²/2 + t_i`` over s_i and t_i with ``‖r_i − √h s_i‖ ≤ t_i``: one second-order cone for each
    target. Mat(x_b) is the symmetric matrix with the entries x_b.

    Args:
        A: (K, 3, m) regressor of K targets.
        d: (K, 3) deflections of the targets.
        cone: cone in which x lies: its first entries x_j are not negative, its matrices semidefinite.
        B: (K, 3, q) columns of the errors v, which have the prior 0 ± 1.

    Returns:
        The compiled program of (x, w) with w = v/√h; its parameters are p (m,) and root (1,), √h.
    """
    with COMPILING:
        K, _, m = A.shape
        q = B.shape[-1]
        unknowns, t, s = cp.Variable(m + q), cp.Variable(K), cp.Variable(3 * K)
        x, w = unknowns[:m], unknowns[m:]
        p, root = cp.Parameter(m, name="p"), cp.Parameter(1, name="root")
        loss = cp.sum(t) + 0.5 * cp.sum_squares(s)
        shift = root[0] * s
        if q:
            shift -= root[0] * (B.reshape(3 * K, -1) @ w)
            loss += 0.5 * cp.sum_squares(w)
        shifted_residuals = A.reshape(-1, m) @ x - d.ravel() - shift
        norms = cp.SOC(t, cp.reshape(shifted_residuals, (K, 3), order="C"), axis=1)
        return Program(cp.Minimize(loss + p @ x), [norms, *_state_cone(x, cone)], unknowns)


def state_penalised_end(T: FloatArray, z: FloatArray, p: FloatArray, limit: float, cone: Matrices) -> Program:
    """Compile ``minimise aᵀx subject to ‖T x − z‖² + pᵀx ≤ J, x_j ≥ 0, Mat(x_b) ⪰ 0``.

    Mat(x_b) is the symmetric matrix with the entries x_b.

    Args:
        T: (k, m) compressed regressor.
        z: (k,) compressed readings.
        p: (m,) gradient of the penalty.
        limit: J > 0, the greatest value of the objective.
        cone: cone in which x lies.

    Returns:
        The compiled program; its parameter is a (m,).
    """
    with COMPILING:
        x, a = cp.Variable(T.shape[1]), cp.Parameter(T.shape[1], name="a")
        # The limit divided by J is ‖u‖² ≤ v, as a second-order cone: ‖(2u, 1 − v)‖ ≤ 1 + v.
        twice_u = (2.0 / np.sqrt(limit)) * (T @ x - z)
        v = 1.0 - (p / limit) @ x
        ball = cp.SOC(1.0 + v, cp.hstack([twice_u, cp.reshape(1.0 - v, (1,), order="C")]))
        return Program(cp.Minimize(a @ x), [ball, *_state_cone(x, cone)], x)


@lru_cache(maxsize=32)
def state_mass_cones(rows: int, blocks: tuple[Block, ...]) -> Program:
    """Compile ``minimise ‖A y − b‖² subject to near + y in the cones of the blocks, c ≤ cap``.

    A joint's block of near + y has its compliance c, and c times unknown masses and moments, which c bounds;
    see `cone.WithMasses`.

    Args:
        rows: number of rows of A.
        blocks: layout of near + y, one block for each joint.

    Returns:
        The compiled program; its parameters are A (rows, p), b (rows,), near (p,), and cap with one entry for
        each block.
    """
    with COMPILING:
        p = sum(block.size for block in blocks)
        y, r, near = cp.Variable(p), cp.Variable(rows), cp.Parameter(p, name="near")
        A, b = cp.Parameter((rows, p), name="A"), cp.Parameter(rows, name="b")
        constraints = [r == A @ y - b, *_state_block_cones(near + y, blocks)]
        return Program(cp.Minimize(cp.sum_squares(r)), constraints, y)


@lru_cache(maxsize=32)
def state_mass_cone_end(rows: int, blocks: tuple[Block, ...]) -> Program:
    """Compile ``minimise aᵀy subject to ‖A y − b‖ ≤ 1, near + y in the cones of the blocks, c ≤ cap``.

    `near` is the optimum of `state_mass_cones` and y the deviation from it, in units in which the ball has
    radius 1, because Clarabel needs a well-scaled program. The ball is the first of the program's
    second-order cones.

    Args:
        rows: number of rows of A.
        blocks: layout of near + y, one block for each joint.

    Returns:
        The compiled program; its parameters are A (rows, p), b (rows,), a (p,), near (p,), and cap with one
        entry for each block.
    """
    with COMPILING:
        p = sum(block.size for block in blocks)
        y, a, near = cp.Variable(p), cp.Parameter(p, name="a"), cp.Parameter(p, name="near")
        A, b = cp.Parameter((rows, p), name="A"), cp.Parameter(rows, name="b")
        ball = cp.SOC(cp.Constant(1.0), A @ y - b)
        return Program(cp.Minimize(a @ y), [ball, *_state_block_cones(near + y, blocks)], y)


def _state_block_cones(x: cp.Expression, blocks: tuple[Block, ...]) -> list[cp.Constraint]:
    """Return the constraints of all blocks: ``0 ≤ c ≤ cap, |ζ_k| ≤ c, ‖ν‖ ≤ c + ratio ζ_k``.

    A block is a joint's part of x, in this order:
        c: the compliance of the joint.
        ζ: c times unknown masses, each between −c and c; `block.boxes` numbers.
        ν: vectors (3,), c times unknown moments of mass. `block.balls` has (k, ratio) for the limit of each
            ν; ``k = −1`` means the limit c.

    `cap`, with one entry for each block, is a parameter.
    """
    cap = cp.Parameter(len(blocks), name="cap")
    constraints = list[cp.Constraint]()
    first = 0  # index of the block's first entry of x
    for number, block in enumerate(blocks):
        first_of_zeta, first_of_nu = first + 1, first + 1 + block.boxes
        c = x[first]
        zeta = x[first_of_zeta:first_of_nu]
        constraints += [c >= 0, c <= cap[number]]
        if block.boxes:
            constraints += [zeta <= c, -zeta <= c]
        for k, ratio in block.balls:
            nu = x[first_of_nu : first_of_nu + 3]
            radius_depends_on_zeta = k >= 0
            radius = c + ratio * zeta[k] if radius_depends_on_zeta else c
            constraints.append(cp.SOC(radius, nu))
            first_of_nu += 3
        first += block.size
    return constraints


def _state_cone(x: cp.Expression, cone: Matrices) -> list[cp.Constraint]:
    """Return the constraints of a cone: x_j ≥ 0 for the scalars, and Mat(x_b) ⪰ 0 for each block x_b.

    Mat(x_b) is the symmetric matrix whose upper triangle has the entries x_b.
    """
    constraints = list[cp.Constraint]()
    if cone.nonnegative:
        constraints.append(x[: cone.nonnegative] >= 0)
    for size, place in cone.blocks():
        entries = x[place]
        if size == 1:
            constraints.append(entries >= 0)
            continue
        # Mat is linear: column k of its matrix is Mat of the k-th unit vector, flattened.
        matrices = to_matrix(np.eye(entries.size), size)  # (entries, size, size)
        linear_map = matrices.reshape(entries.size, -1).T
        constraints.append(cp.reshape(linear_map @ entries, (size, size), order="C") >> 0)
    return constraints


class _Shape(NamedTuple):
    """Shape of a least-squares problem: problems of the same shape share a compiled program."""

    rows: int  #: number of rows of A
    columns: int  #: number of variables x
    with_lower: tuple[int, ...]  #: indices of the variables that have a lower bound
    with_upper: tuple[int, ...]  #: indices of the variables that have an upper bound
    inequalities: int  #: number of rows of B


def _find_shape(problem: Problem[Scalars]) -> _Shape:
    """Return the shape of a problem; problems of the same shape share a compiled program."""
    bounds = problem.cone.bounds
    rows, columns = problem.squares.R.shape
    with_lower = np.flatnonzero(np.isfinite(bounds.lower))
    with_upper = np.flatnonzero(np.isfinite(bounds.upper))
    return _Shape(
        rows=rows,
        columns=columns,
        with_lower=tuple(with_lower.tolist()),
        with_upper=tuple(with_upper.tolist()),
        inequalities=problem.cone.inequality_count,
    )


def _state_constraints(x: cp.Variable, shape: _Shape) -> list[cp.Constraint]:
    """Return the constraints lower ≤ x ≤ upper and B x ≥ d, with parameters lower, upper, B and d.

    `lower` and `upper` have entries only for the variables with such a bound.
    """
    constraints = list[cp.Constraint]()
    if shape.with_lower:
        lower = cp.Parameter(len(shape.with_lower), name="lower")
        constraints.append(x[list(shape.with_lower)] >= lower)
    if shape.with_upper:
        upper = cp.Parameter(len(shape.with_upper), name="upper")
        constraints.append(x[list(shape.with_upper)] <= upper)
    if shape.inequalities:
        B = cp.Parameter((shape.inequalities, x.size), name="B")
        d = cp.Parameter(shape.inequalities, name="d")
        constraints.append(B @ x >= d)
    return constraints


def _collect_data(problem: Problem[Scalars]) -> dict[str, FloatArray]:
    """Return the values of the parameters A, b, lower, upper, B and d of a problem, by their names."""
    bounds = problem.cone.bounds
    lower = bounds.lower[np.isfinite(bounds.lower)]
    upper = bounds.upper[np.isfinite(bounds.upper)]
    data = {"A": problem.squares.R, "b": problem.squares.z, "lower": lower, "upper": upper}
    inequalities = problem.cone.inequalities
    if inequalities is not None:
        data |= {"B": inequalities.matrix, "d": inequalities.least}
    return data


def solve_e_optimal_design(
    base: FloatArray, K: FloatArray, metric: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Solve ``maximise t subject to M(w) − t diag(V⁻², 0) ⪰ 0``, the E-optimal design.

    M(w) = M0 + Σ w_i K_i is the information with weights w_i of the candidates. The optimal t is the least
    eigenvalue of V C V, with C the information on the first s parameters and V their units on the diagonal:
    the design gives as much information as possible on the combination of these parameters that is determined
    worst.

    Args:
        base: M0 (p, p) information before any candidate is measured.
        K: (k, p, p) information K_i of each candidate.
        metric: V (s,) units of the first s parameters.

    Returns:
        The weights w (k,) of the candidates, and the dual variable Z (s, s).

    Raises:
        SolverError: Clarabel does not solve the program.
    """
    s, p = len(metric), len(base)
    E = np.zeros(base.shape)  # diag(V⁻², 0)
    E[:s, :s] = np.diag(metric**-2.0)
    with COMPILING:
        w, t = cp.Variable(len(K)), cp.Variable()
        flat_M = K.reshape(len(K), -1).T @ w + base.ravel()
        M = cp.reshape(flat_M, (p, p), order="C")
        inequality = 0.5 * (M + M.T) - t * E >> 0
        problem = cp.Problem(cp.Maximize(t), [inequality, cp.sum(w) == 1, w >= 0])
        for tolerance in _DESIGN_TOLERANCES:
            settings = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), tolerance)
            with suppress(cp.SolverError), warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the status is checked below
                problem.solve(solver=cp.CLARABEL, max_threads=1, **settings)
            if problem.status == cp.OPTIMAL:
                break
        else:
            raise SolverError(f"Clarabel did not solve the E-optimal design: its status is {problem.status}")
    weights = np.clip(np.asarray(w.value, dtype=np.float64), 0.0, 1.0)
    weights[weights < 1e-7] = 0.0  # rounding
    Z = np.asarray(inequality.dual_value)[:s, :s] / np.outer(metric, metric)
    return np.asarray(weights / weights.sum()), Z
