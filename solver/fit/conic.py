"""Programs over cones: Clarabel proposes a point, and a certificate computed from the data accepts the point.

Semidefinite programs with a penalty on traces (method.md §7), of two losses:

    minimise ‖R x − z‖² + pᵀx           subject to   x_j ≥ 0 for the first parameters, Mat(x_b) ⪰ 0
    minimise Σ_i ρ(‖A_i x − d_i‖) + pᵀx     for the blocks that follow, p = λ on traces and some scalars

ρ(u) is u²/(2h) up to h and u − h/2 beyond. Then least squares over cones
of products c η of a compliance with unknowns in a box (method.md §14), see `WithMasses`.

Each proposed answer is made exactly feasible. So is a point of the dual program, which comes from the
residual of the answer or from Clarabel. The gap between the two is computed without cancellation, and only an
answer whose gap is small enough leaves this module.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.cone import Matrices, WithMasses, to_matrix, to_vector
from jointstiff.solver.fit.problem import Certificate, LeastSquares, Problem, Solution, Witness

if TYPE_CHECKING:
    from jointstiff.solver.fit.programs import Program  # takes a second to import

_CONE_TOLERANCES: Final = (1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
"""Tolerances of Clarabel, tried in this order: not every problem can be solved to the tightest."""
_NORMS_TOLERANCES: Final = (1e-7, 1e-8, 1e-9, 1e-10)
"""Tolerances of Clarabel for robust losses, tried in this order."""
_MASS_TOLERANCES: Final = (1e-10, 1e-9, 1e-8)
"""Tolerances of Clarabel for cones of masses and moments, tried in this order."""
_CONE_WITNESS: Final = 1e-4
"""Greatest distance of Clarabel's own answer from the optimum that its first tolerance, 1e-8, explains, with
‖z‖ = 1: the gap of an answer is a square of this distance."""
_END_TOLERANCES: Final = (1e-8, 1e-7, 1e-6)
"""Tolerances of Clarabel for ends of intervals; an end needs no more digits than the last tolerance gives."""
_LEAST_UNIT: Final = 1e-9
"""Least unit in which a program is stated, as a residual relative to the readings."""
_NEWTON_STEPS: Final = 4
"""Number of Newton steps; each doubles the correct digits once the face is the optimum's."""
_SLACK_ROUNDING: Final = 1e-13
"""Largest negative slack that counts as zero, in units of the column's norm and the readings'."""
_NORMS_SLACK_ROUNDING: Final = 1e-12
"""Largest negative slack that counts as zero, for a robust loss."""
_SMALL: Final = 1e-3
"""Compliance, in the program's units, that is negligible for explaining the readings."""
_ROUNDING: Final = 1e-12
"""Tolerance relative to the largest entry: a smaller eigenvalue counts as zero."""
_RIDGE: Final = 1e-13
"""Regularisation of the Hessian, relative to its largest diagonal entry: undetermined directions stay put."""
_NULL_SINGULAR_VALUE: Final = 1e-10
"""Singular value, relative to the greatest, that is rounding of columns that depend on each other."""
_OUTSIDE_SPAN: Final = 1e-6
"""Share of a function outside the span of the readings that is rounding."""
_LEAST: Final = 0
"""Column of the least values in ranges (K, 2)."""
_GREATEST: Final = 1
"""Column of the greatest values in ranges (K, 2)."""
_LEAST_RADIUS: Final = 1e-6
"""Radius of the ball of `bound_compliances`, relative to ‖b‖, below which Clarabel's rounding shows: exact
readings."""


@dataclass(frozen=True, eq=False)
class NormSum:
    """Sum of the losses Σ ρ(‖A_i x + B_i v − d_i‖) of targets, shared by programs with different penalties.

    Errors v that are stated as zero, in units of their standard uncertainties, add ``‖s v‖²/(2h)``: the loss
    of q more rows below the threshold h.
    """

    A: FloatArray  #: (K, 3, p) regressor of K targets
    d: FloatArray  #: (K, 3) deflections, scaled to ``Σ ‖d_i‖ = 1``
    cone: Matrices  #: cone of the parameters
    B: FloatArray  #: (K, 3, q) columns of the stated errors
    statement: float = 1.0  #: s, the standard uncertainty of a reading, in the unit of d

    @cached_property
    def program(self) -> Program:
        """Program that minimises the loss with a penalty, compiled once.

        Its parameters are the gradient p of the penalty and √h. Its unknowns are x and ``w = s v/√h`` for the
        errors v, so that their loss ``‖s v‖²/(2h)`` is ``‖w‖²/2``. The program multiplies its columns of
        errors by √h; the columns ``B / s`` then have the effect ``(B / s) √h w = B v``.
        """
        from jointstiff.solver.fit import programs  # takes a second to import

        return programs.state_sum_of_norms(self.A, self.d, self.cone, self.B / self.statement)


@dataclass(frozen=True, eq=False)
class RobustProgram:
    """Program with a robust loss: minimise Σ ρ(‖A_i x + B_i v − d_i‖) + ‖s v‖²/(2h) + pᵀx, x in a cone."""

    loss: NormSum  #: loss of the targets
    weight: float  #: λ > 0 of the penalty
    threshold: float  #: h > 0, in the unit of d


@dataclass(frozen=True, eq=False)
class RobustSolution(Solution):
    """Optimum of a program with a robust loss."""

    errors: FloatArray  #: (q,) stated errors v, in units of their standard uncertainties


_Solution = TypeVar("_Solution", bound=Solution)


def solve_matrices(problem: Problem[Matrices], gap: float, accepted: float | None) -> Solution:
    """Solve a problem over matrices: by Clarabel, refined by Newton's method, and certified.

    Args:
        problem: all numbers finite, readings of unit norm.
        gap: the search ends when a certificate has at most this gap, with ‖z‖ = 1.
        accepted: greatest gap that is accepted if no answer reaches `gap`; None for `gap`.

    Raises:
        SolverError: no answer has a gap that is accepted.
    """
    return _select_certified(_propose_cone_solutions(problem), gap, accepted)


def _propose_cone_solutions(problem: Problem[Matrices]) -> Iterator[Solution]:
    """Yield solutions with their certificates, with Clarabel's tolerance made tighter and tighter.

    At each tolerance the problem is solved in units of the readings, and then in units of the residual. Each
    point of Clarabel is followed by steps of Newton's method from this point.
    """
    T, z = problem.squares.compressed
    residual_size = max(float(np.linalg.norm(z - T @ problem.squares.origin)), _LEAST_UNIT)
    unit_of_readings = 1.0  # as z has unit norm
    witness: FloatArray | None = None  # of the optimum: Clarabel's first answer
    for tolerance in _CONE_TOLERANCES:
        for unit in (unit_of_readings, residual_size):
            point = find_interior_point(problem, tolerance, unit)
            if witness is None:
                witness = point
            yield from _refine_by_newton(problem, point, witness)


def find_interior_point(problem: Problem[Matrices], tolerance: float, unit: float) -> FloatArray | None:
    """Minimise ``‖T x − z‖² + penaltyᵀ x`` over a cone by Clarabel, in variables y = (x − origin) / unit.

    The origin is a point near the optimum. With a unit of the residual's size, Clarabel's absolute
    tolerances are relative to the residual, not to the much larger readings. With x = origin + unit · y the
    objective is, but for a constant, unit² times

        ``‖T y − (z − T origin) / unit‖² + (penalty / unit)ᵀ y``,

    and x is in the cone if origin / unit + y is.

    Args:
        problem: problem over matrices.
        tolerance: tolerance of Clarabel.
        unit: size of the residual, relative to the readings.

    Returns:
        A point x (p,) near the optimum; None if Clarabel fails.
    """
    from jointstiff.solver.fit import programs  # takes a second to import

    origin = problem.squares.origin
    T, z = problem.squares.compressed
    program_in_y = programs.state_semidefinite(len(T), problem.cone)
    data = {"T": T, "z": (z - T @ origin) / unit, "p": problem.penalty / unit, "near": origin / unit}
    y = program_in_y.solve(data, tolerance)
    return None if y is None else origin + unit * y


def _refine_by_newton(
    problem: Problem[Matrices], point: FloatArray | None, witness: FloatArray | None
) -> Iterator[Solution]:
    """Yield the solution at a point of Clarabel (p,), then those after each of several steps of Newton.

    The steps end early if one of them fails; without a point there is no solution.

    Args:
        problem: problem with squared residuals.
        point: (p,) answer of Clarabel; None if Clarabel failed.
        witness: (p,) Clarabel's first answer, with which each solution is compared; None without any.
    """
    for _ in range(1 + _NEWTON_STEPS):
        if point is None:
            return
        x = problem.cone.project(point)
        yield Solution(x, certify_cone(problem, x, witness))
        point = Face.near(problem, x).take_newton_step()


def solve_robust(
    program: RobustProgram, *, wanted_gap: float, accepted_gap: float | None = None
) -> RobustSolution:
    """Solve a program with a robust loss by Clarabel, and certify the optimum.

    Args:
        program: the fit to solve; all of its numbers must be finite.
        wanted_gap: the search ends when the objective exceeds the optimum by at most this.
        accepted_gap: greatest excess that is accepted if no answer reaches `wanted_gap`; None for
            `wanted_gap`.

    Raises:
        SolverError: no answer has an excess that is accepted.
    """
    return _select_certified(_propose_robust_solutions(program), wanted_gap, accepted_gap)


def _propose_robust_solutions(program: RobustProgram) -> Iterator[RobustSolution]:
    """Yield points with their certificates, with Clarabel's tolerance made tighter and tighter.

    The variables of the program are the parameters x in a cone, then w = s v/√h for the stated errors v, with
    the standard uncertainty s of a reading and Huber's threshold h: half of ‖w‖² is the loss of the errors.
    """
    loss, cone = program.loss, program.loss.cone
    root_of_threshold = np.sqrt(program.threshold)
    data = {"p": cone.penalty(program.weight), "root": np.array([root_of_threshold])}
    for tolerance in _NORMS_TOLERANCES:
        solution = loss.program.solve_with_duals(data, tolerance)
        if solution is None:  # Clarabel does not reach the tolerance
            continue
        x, w = cone.project(solution.x[: cone.dimension]), solution.x[cone.dimension :]
        errors = root_of_threshold / loss.statement * w
        # Each target has a cone with four multipliers: one of the norm, then −ν (3,).
        nu = -solution.multipliers.reshape(-1, 4)[:, 1:]
        yield RobustSolution(x, certify_robust(program, x, errors, nu), errors)


def _select_certified(
    proposals: Iterable[_Solution], wanted_gap: float, accepted_gap: float | None
) -> _Solution:
    """Return the first feasible proposal whose gap is small enough, else the proposal with the least gap.

    Args:
        proposals: solutions with their certificates, in the order in which they are tried.
        wanted_gap: gap at which the search ends.
        accepted_gap: greatest gap that is accepted after all proposals; None for `wanted_gap`.

    Raises:
        SolverError: no feasible proposal has a gap that is accepted.
    """
    best: _Solution | None = None
    for solution in proposals:
        is_feasible = solution.certificate.primal == 0.0
        has_less_gap = best is None or solution.certificate.gap < best.certificate.gap
        if is_feasible and has_less_gap:
            best = solution
        if best is not None and best.certificate.gap <= wanted_gap:
            return best
    limit = wanted_gap if accepted_gap is None else accepted_gap
    if best is not None and best.certificate.gap <= limit:
        return best
    reason = "the solver did not converge"
    if best is not None:
        reason = f"the gap to the optimum is {best.certificate.gap:.1e}, above the limit {limit:.1e}"
    raise SolverError(f"the optimum over cones could not be certified: {reason}")


def certify_cone(
    problem: Problem[Matrices], x: FloatArray, clarabel_point: FloatArray | None = None
) -> Certificate:
    """Return the certificate of a point x (p,): its duality gap proves how near x is to the optimum.

    For any ν with slack ``s = p + Rᵀν`` in the dual cone, ``−‖ν‖²/4 − νᵀz`` is a lower bound of the optimum.
    The objective at x exceeds this bound by ``‖ν/2 − r‖² + sᵀx`` with r = R x − z, a sum of terms that are
    not negative. Here ν = 2 r, changed so that the slack is in the dual cone.

    Args:
        problem: problem with squared residuals.
        x: (p,) point in the cone.
        clarabel_point: (p,) Clarabel's own answer, a witness of the optimum; None without a witness.
    """
    R, z, cone = problem.squares.R, problem.squares.z, problem.cone
    r = R @ x - z
    dual = _make_dual_feasible(cone, problem.weight, R, 2.0 * r)
    nu = dual.multipliers
    slack_times_x = _compute_complementarity(dual.slack, x, cone, _SLACK_ROUNDING)
    gap = float(np.sqrt(np.square(0.5 * nu - r).sum() + slack_times_x))
    witness = None
    if clarabel_point is not None:
        distance = float(np.linalg.norm(R @ (clarabel_point - x)))
        witness = Witness(distance, _CONE_WITNESS)
    primal_violation = max(0.0, -cone.least_value(x))
    return Certificate(primal_violation, dual.violation, gap, nu, "clarabel", witness)


def certify_robust(
    program: RobustProgram, x: FloatArray, errors: FloatArray, dual: FloatArray
) -> Certificate:
    """Bound how far the objective at a point (x, v) is above its optimum; return this gap as a certificate.

    ρ is Huber's loss with threshold h, r_i = A_i x + B_i v − d_i (3,) the residual of target i, p the
    gradient of the linear penalty, s the standard uncertainty of a reading. For any ν with ‖ν_i‖ ≤ 1 and the
    slack ``p + Aᵀν`` in the dual cone, ``−Σ (ν_iᵀd_i + h‖ν_i‖²/2) − h‖Bᵀν‖²/(2s²)`` is a lower bound of the
    optimum. The objective exceeds this bound by ``Σ [ρ(r_i) + h‖ν_i‖²/2 − ν_iᵀr_i] + (p + Aᵀν)ᵀx +
    ‖s v/√h + √h Bᵀν/s‖²/2``, a sum of terms that are not negative.

    Args:
        program: program with a robust loss.
        x: (p,) point in the cone.
        errors: (q,) stated errors v.
        dual: (K, 3) nearly feasible multipliers ν of the residuals.
    """
    loss, cone, h, s = program.loss, program.loss.cone, program.threshold, program.loss.statement
    flat_A = loss.A.reshape(-1, len(x))  # (3 K, p)
    feasible = _make_dual_feasible(cone, program.weight, flat_A, dual)
    nu = feasible.multipliers
    residual = loss.A @ x + loss.B @ errors - loss.d
    gap_of_targets = _compute_huber_gaps(residual, nu, h).sum()
    gap_of_cone = _compute_complementarity(feasible.slack, x, cone, _NORMS_SLACK_ROUNDING)
    root_h = np.sqrt(h)
    B_nu = np.einsum("kiq,ki->q", loss.B, nu)  # Bᵀν
    imbalance_of_errors = s / root_h * errors + root_h / s * B_nu  # zero at the optimum
    gap_of_errors = 0.5 * float(imbalance_of_errors @ imbalance_of_errors)
    gap = float(gap_of_targets + (gap_of_cone + gap_of_errors))
    primal_violation = max(0.0, -cone.least_value(x))
    return Certificate(primal_violation, feasible.violation, gap, nu, "clarabel")


def _compute_huber_gaps(residual: FloatArray, nu: FloatArray, h: float) -> FloatArray:
    """Return the excesses ``ρ(r) + h‖ν‖²/2 − νᵀr`` (K,) of residuals r and multipliers ν, both (K, 3).

    ρ is Huber's loss with threshold h: ‖r‖²/(2h) up to h, and ‖r‖ − h/2 beyond. For ‖ν‖ ≤ 1 an excess is not
    negative; it is computed without cancellation, with the unit vector u of r:

        up to h   ``‖r − h ν‖² / (2h)``
        beyond    ``h ‖ν − u‖² / 2 + (‖r‖ − h) (1 − νᵀu)``
    """
    norm = np.linalg.norm(residual, axis=1)
    is_beyond = norm > h
    u = residual / np.where(is_beyond, norm, 1.0)[:, None]  # unit vectors beyond the threshold
    misalignment = np.maximum(0.0, 1.0 - (nu * u).sum(axis=1))
    gap_beyond = 0.5 * h * np.square(nu - u).sum(axis=1) + (norm - h) * misalignment
    gap_within = np.square(residual - h * nu).sum(axis=1) / (2.0 * h)
    return np.asarray(np.where(is_beyond, gap_beyond, gap_within))


class _DualPoint(NamedTuple):
    """Feasible point of a dual program."""

    multipliers: FloatArray  # ν, (m,) for squared residuals, or (K, 3) with norms of at most one
    violation: float  # of the dual cone, before the multipliers were shrunk, divided by λ
    slack: FloatArray  # (p,) slack s = p + Aᵀν


def _make_dual_feasible(cone: Matrices, weight: float, rows: FloatArray, dual: FloatArray) -> _DualPoint:
    """Change multipliers ν of the residuals so that the slack ``s = p + Aᵀν`` is in the dual cone.

    A least-squares step makes the slacks of scalars without a penalty feasible: not negative. Multiplying ν
    by ``λ / (λ + violation)`` then makes the slacks of blocks and penalised scalars feasible, too; the
    violation is minus the least eigenvalue or slack. ν with norms of at most one stay within these norms.

    Args:
        cone: cone of the parameters.
        weight: λ > 0 of the penalty p.
        rows: A (m, p).
        dual: nearly feasible ν, (m,) for squared residuals, or (K, 3) with norms of at most one.
    """
    penalty = cone.penalty(weight)
    nu = _correct_slacks_without_penalty(cone, rows, dual.ravel())
    gradient = rows.T @ nu
    violation = _find_violation(cone, slack=gradient + penalty)
    factor = weight / (weight + violation)
    multipliers = nu.reshape(dual.shape)
    has_norms = multipliers.ndim > 1
    if has_norms:
        greatest_norm = float(np.linalg.norm(multipliers, axis=1).max(initial=0.0))
        factor = min(factor, 1.0 / max(greatest_norm, 1.0))
    return _DualPoint(factor * multipliers, violation / weight, penalty + factor * gradient)


def _correct_slacks_without_penalty(cone: Matrices, rows: FloatArray, nu: FloatArray) -> FloatArray:
    """Return multipliers (m,) near ν with which no scalar without a penalty has a negative slack.

    The slack of such a scalar is ``A_jᵀν`` with its column A_j. The shortest change of ν that raises the
    negative slacks to zero, and keeps the other slacks, is a least-squares solution.

    Args:
        cone: cone of the parameters.
        rows: A (m, p).
        nu: (m,) multipliers ν.
    """
    columns_without_penalty = rows[:, : cone.unpenalised].T
    shortfall = np.maximum(-(columns_without_penalty @ nu), 0.0)
    if not shortfall.any():
        return nu
    correction, *_ = np.linalg.lstsq(columns_without_penalty, shortfall, rcond=None)
    return np.asarray(nu + correction)


def _find_violation(cone: Matrices, slack: FloatArray) -> float:
    """Return how far the slack (p,) of penalised scalars and blocks is outside the dual cone; zero if inside.

    This is minus the least slack of a scalar or eigenvalue of a block's slack.
    """
    penalised_scalars = slice(cone.unpenalised, cone.nonnegative)
    must_not_be_negative = slack[penalised_scalars].tolist()
    for size, place in cone.blocks():
        eigenvalues = np.linalg.eigvalsh(to_matrix(slack[place], size))
        must_not_be_negative.append(float(eigenvalues.min()))
    return max(0.0, -min(must_not_be_negative, default=0.0))


def _compute_complementarity(slack: FloatArray, x: FloatArray, cone: Matrices, rounding: float) -> float:
    """Return the product ``sᵀx`` of the dual slack s and a point x, both (p,); it is zero at the optimum.

    The slacks of scalars without a penalty must not be negative. One that is negative within rounding counts
    with its absolute value, so that the product is not understated. The result is inf if such a slack is more
    negative.
    """
    slacks_without_penalty = slack[: cone.unpenalised]
    if not (slacks_without_penalty >= -rounding).all():
        return float("inf")
    safe_slack = np.concatenate([np.abs(slacks_without_penalty), slack[cone.unpenalised :]])
    return max(0.0, float(safe_slack @ x))


def compute_penalised_range(
    problem: Problem[Matrices], x: FloatArray, rise: float, functions: FloatArray
) -> FloatArray:
    """Return the ranges of linear functions over all points whose objective is near the optimum.

    Each range is ``min, max aᵀy subject to ‖R y − z‖² + pᵀy ≤ ‖R x − z‖² + pᵀx + rise``, y in the cone; p is
    the gradient of the penalty. A function that is zero has no range (NaN).

    Args:
        problem: problem with squared residuals.
        x: (p,) optimum of the problem.
        rise: allowed increase of the objective, positive.
        functions: (K, p) coefficients a of K functions.

    Returns:
        (K, 2) least and greatest values; NaN where Clarabel fails.
    """
    from jointstiff.solver.fit import programs  # takes a second to import

    T, z = problem.squares.compressed
    limit = float(np.square(T @ x - z).sum() + problem.penalty @ x) + rise
    clarabel_program = programs.state_penalised_end(T, z, problem.penalty, limit, problem.cone)
    ranges = np.full((len(functions), 2), np.nan)
    for number, a in enumerate(functions):
        norm = float(np.linalg.norm(a))
        if norm == 0.0:
            continue
        for side, sign in (_LEAST, 1.0), (_GREATEST, -1.0):  # minimise the function, then its negative
            point = clarabel_program.solve({"a": sign * a / norm}, *_END_TOLERANCES)
            if point is not None:
                ranges[number, side] = a @ point
    return ranges


def compute_unconstrained_range(squares: LeastSquares, functions: FloatArray, radius: float) -> FloatArray:
    """Return the ranges of linear functions over the ellipsoid ``‖R x − z‖² ≤ min + radius²``.

    min is the least value of ‖R x − z‖² over x; constraints on x are ignored. With R = U S Vᵀ a function aᵀx
    is aᵀV S⁻¹ y of y = S Vᵀx, and the ellipsoid is the ball ``‖y − Uᵀz‖ ≤ radius``.

    Args:
        squares: R and z, with p parameters.
        functions: (K, p) coefficients a of K functions.
        radius: root of the allowed excess of the squares.

    Returns:
        (K, 2) least and greatest values; NaN where the readings do not determine a function.
    """
    U, singular_values, Vt = np.linalg.svd(squares.R, full_matrices=False)
    is_determined = singular_values > _NULL_SINGULAR_VALUE * singular_values[0]
    U, singular_values, Vt = U[:, is_determined], singular_values[is_determined], Vt[is_determined]
    functions_of_y = functions @ (Vt.T / singular_values)  # (K, r) rows aᵀV S⁻¹
    centre = functions_of_y @ (U.T @ squares.z)  # values at the least squares, y = Uᵀz
    half_width = radius * np.linalg.norm(functions_of_y, axis=1)
    # A function has a range only if its coefficients are in the span of the determined directions V.
    outside_span = np.linalg.norm(functions - functions @ Vt.T @ Vt, axis=1)
    is_undetermined = outside_span > _OUTSIDE_SPAN * np.linalg.norm(functions, axis=1)
    half_width[is_undetermined] = np.nan
    return np.column_stack([centre - half_width, centre + half_width])


class _EigenSplit(NamedTuple):
    """Positive semidefinite matrix ``X = U diag(values) Uᵀ`` of rank r."""

    U: FloatArray  # (size, r) orthonormal basis of the range
    V: FloatArray  # (size, size − r) orthonormal basis of the null space
    values: FloatArray  # (r,) eigenvalues that are not zero

    @classmethod
    def of(cls, X: FloatArray, least_eigenvalue: float, scaled_slack: FloatArray) -> _EigenSplit:
        """Split a matrix X (size, size) into range and null space.

        At the optimum the null space of X has the range of the slack. So the rank is the number of
        eigenvalues of X that exceed rounding, and at most that of positive eigenvalues of X less the slack.

        Args:
            X: positive semidefinite matrix.
            least_eigenvalue: rounding, at and below which an eigenvalue counts as zero.
            scaled_slack: (size, size) slack in the units of X.
        """
        values, vectors = np.linalg.eigh(X)  # ascending
        above_rounding = int((values > least_eigenvalue).sum())
        above_slack = int((np.linalg.eigvalsh(X - scaled_slack) > 0.0).sum())
        null_size = len(values) - min(above_slack, above_rounding)
        return cls(vectors[:, null_size:], vectors[:, :null_size], values[null_size:])

    @property
    def matrix(self) -> FloatArray:
        """Matrix X (size, size)."""
        return (self.U * self.values) @ self.U.T


@dataclass(frozen=True, eq=False)
class _BlockFace:
    """Face of one block: the matrices X = U X_r Uᵀ of rank r near the optimum, with the slack V S_s Vᵀ.

    The slack is the gradient of the objective; at the optimum it is zero on the range U of X. A change of X
    along the face is ``U A Uᵀ + U B Vᵀ + V Bᵀ Uᵀ``: A (r, r) changes X within its range, B (r, size − r)
    turns the range. The entries of A and B are the block's tangent coordinates.
    """

    place: slice  # of the block in the p parameters
    first_coordinate: int  # index of the block's first tangent coordinate among those of the whole face
    U: FloatArray  # (size, r) range of X
    V: FloatArray  # (size, size − r) null space of X
    X_r: FloatArray  # (r, r) diagonal matrix of the eigenvalues of X that are not zero
    S_s: FloatArray  # (size − r, size − r) slack on the null space

    @classmethod
    def from_slack(
        cls, place: slice, first_coordinate: int, split: _EigenSplit, slack: FloatArray
    ) -> _BlockFace:
        """Return the face of a block X = U diag(values) Uᵀ, given the slack of the block.

        At the optimum the slack on the null space V of X is positive semidefinite: S_s is the positive
        semidefinite matrix nearest to it.

        Args:
            place: place of the block in the parameters.
            first_coordinate: number of tangent coordinates of the scalars and blocks before this one.
            split: range U and null space V of X, with its eigenvalues that are not zero.
            slack: (q,) gradient of the objective with respect to X, as the vector of a matrix.
        """
        slack_on_null_space = split.V.T @ to_matrix(slack, len(split.U)) @ split.V
        eigenvalues, vectors = np.linalg.eigh(slack_on_null_space)
        S_s = (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T
        return cls(place, first_coordinate, split.U, split.V, X_r=np.diag(split.values), S_s=S_s)

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal tangent vectors of the block's face (q, a + b), as columns; q is the length of a block.

        First those of the a = r (r + 1) / 2 entries of A, then those of the b = r (size − r) entries of B.
        """
        size, rank = self.U.shape
        entry_count = size * (size + 1) // 2  # q
        if not rank:
            return np.zeros((entry_count, 0))
        tangents = []
        for i in range(rank):
            for j in range(i + 1):
                u_i, u_j = self.U[:, i], self.U[:, j]
                norm = 2.0 if i == j else np.sqrt(2.0)
                tangents.append((np.outer(u_i, u_j) + np.outer(u_j, u_i)) / norm)
        for u in self.U.T:
            tangents += [(np.outer(u, v) + np.outer(v, u)) / np.sqrt(2.0) for v in self.V.T]
        return to_vector(np.array(tangents)).T

    @property
    def coordinates(self) -> slice:
        """Tangent coordinates of the block, A and B, among those of the whole face."""
        return slice(self.first_coordinate, self.first_coordinate + self.basis.shape[1])

    @property
    def coordinates_across(self) -> slice:
        """Tangent coordinates of B, across the range of X; they follow those of A."""
        rank = len(self.X_r)
        entries_of_A = rank * (rank + 1) // 2
        return slice(self.coordinates.start + entries_of_A, self.coordinates.stop)

    def compute_curvature(self) -> FloatArray:
        """Return the Hessian (b, b) that the curvature of the face adds to the objective, by those of B.

        X stays of rank r only if ``V Bᵀ X_r⁻¹ B Vᵀ`` is added to a change by B. The slack V S_s Vᵀ changes
        the objective by ``tr(S_s Bᵀ X_r⁻¹ B)`` for it. The tangent vectors have unit length, so that B is
        the coordinates over √2: the Hessian is ``X_r⁻¹ ⊗ S_s``.
        """
        return np.kron(np.linalg.inv(self.X_r), self.S_s)

    def take_step(self, step: FloatArray) -> FloatArray | None:
        """Return the block as a vector (q,) after a step that keeps its rank r; None if it leaves the cone.

        For a step Z in the tangent space, with C = X_r + Uᵀ Z U and the columns W = U C + V Vᵀ Z U, the new
        block is ``W C⁻¹ Wᵀ``: equal to X + Z to first order, and of rank r.

        Args:
            step: coordinates of Z in the tangent vectors `basis`.
        """
        if not len(self.X_r):
            return np.zeros(len(self.basis))
        Z = to_matrix(self.basis @ step, len(self.U))
        C = self.X_r + self.U.T @ Z @ self.U
        if np.linalg.eigvalsh(C)[0] <= 0.0:
            return None
        W = self.U @ C + self.V @ (self.V.T @ Z @ self.U)
        return to_vector(W @ np.linalg.solve(C, W.T))


@dataclass(frozen=True, eq=False)
class Face:
    """Face of a cone near the optimum: scalars and eigenvalues that exceed their slack count as not zero.

    On a face the problem is smooth. Matrices of rank r around ``X = U X_r Uᵀ`` are, to second order,
    ``X + U A Uᵀ + U B Vᵀ + V Bᵀ Uᵀ + V Bᵀ X_r⁻¹ B Vᵀ`` with any small symmetric A and any small B; the last
    term meets the slack ``V S_s Vᵀ`` and bends the objective by ``tr(S_s Bᵀ X_r⁻¹ B)`` (Shapiro,
    *Perturbation analysis of optimization problems in Banach spaces*, 1992). The Hessian serves Newton's
    method, which refines Clarabel's answer, and the derivative of the fit with respect to the readings.

    The d tangent coordinates are the changes of the scalars that are not zero, then those of each block.
    """

    problem: Problem[Matrices]  #: problem with squared residuals
    x: FloatArray  #: (p,) point on the face
    slack: FloatArray  #: (p,) gradient of the objective at x
    free: IndexArray  #: indices of the scalars that are not zero
    blocks: tuple[_BlockFace, ...]  #: face of each block

    @classmethod
    def near(cls, problem: Problem[Matrices], x: FloatArray) -> Face:
        """Determine the face near a feasible point x (p,): zero scalars, and the rank of each block.

        The point is moved onto the face: small scalars and eigenvalues become zero. At the optimum a scalar
        or its slack is zero. Near it the smaller one counts as zero; blocks: see `_split_blocks`.
        """
        slack = problem.slack(x)
        scalars = slice(0, problem.cone.nonnegative)
        free = np.flatnonzero(x[scalars] > slack[scalars])
        splits = _split_blocks(problem, x, slack)
        on_face = np.zeros(len(x))
        on_face[free] = x[free]
        for (_, place), split in zip(problem.cone.blocks(), splits, strict=True):
            on_face[place] = to_vector(split.matrix)
        slack_on_face = problem.slack(on_face)

        blocks = list[_BlockFace]()
        coordinate_count = len(free)  # so far
        for (_, place), split in zip(problem.cone.blocks(), splits, strict=True):
            block = _BlockFace.from_slack(place, coordinate_count, split, slack_on_face[place])
            coordinate_count = block.coordinates.stop
            blocks.append(block)
        return cls(problem, on_face, slack_on_face, free, tuple(blocks))

    @cached_property
    def basis(self) -> FloatArray:
        """Tangent vectors (p, d): a unit vector for each free scalar, then those of each block."""
        width = len(self.free) + sum(block.basis.shape[1] for block in self.blocks)
        basis = np.zeros((len(self.x), width))
        basis[self.free, np.arange(len(self.free))] = 1.0
        for block in self.blocks:
            basis[block.place, block.coordinates] = block.basis
        return basis

    @cached_property
    def information(self) -> FloatArray:
        """Gram matrix 2 RᵀR (d, d) of the readings in tangent coordinates."""
        R = self.problem.squares.R @ self.basis
        return 2.0 * R.T @ R

    @cached_property
    def hessian(self) -> FloatArray:
        """Hessian (d, d) of the objective on the face: the information, and the curvature of each block.

        A small ridge keeps the point where it is in directions without curvature.
        """
        hessian = self.information.copy()
        for block in self.blocks:
            of_B = block.coordinates_across
            hessian[of_B, of_B] += block.compute_curvature()
        diagonal = np.diag_indices_from(hessian)
        hessian[diagonal] += _RIDGE * hessian.diagonal().max(initial=0.0)
        return hessian

    def take_newton_step(self) -> FloatArray | None:
        """Return the point (p,) after one step of Newton's method on the face; None if the step fails.

        A step fails if the Hessian is singular or the step leaves the cone. The point may be worse than
        before, so it needs a certificate.
        """
        hessian, gradient = self.hessian, self.basis.T @ self.slack
        try:
            step = np.asarray(np.linalg.solve(hessian, -gradient), dtype=np.float64)
        except np.linalg.LinAlgError:
            return None
        new_x = np.zeros(len(self.x))
        step_of_scalars = step[: len(self.free)]
        new_x[self.free] = self.x[self.free] + step_of_scalars
        for block in self.blocks:
            new_block = block.take_step(step[block.coordinates])
            if new_block is None:
                return None
            new_x[block.place] = new_block
        is_in_cone = np.isfinite(new_x).all() and (new_x[self.free] >= 0.0).all()
        return new_x if is_in_cone else None


def _split_blocks(problem: Problem[Matrices], x: FloatArray, slack: FloatArray) -> tuple[_EigenSplit, ...]:
    """Split each block of x into its range and its null space, near the optimum.

    An eigenvalue counts as zero if it is smaller than the slack in its direction. The slack of blocks is as
    large as the weight λ of the penalty, which may be decades smaller than the blocks, so the slack is first
    multiplied by the greatest entry of the blocks over λ.

    Args:
        problem: problem with squared residuals.
        x: (p,) feasible point.
        slack: (p,) gradient of the objective at x.
    """
    cone = problem.cone
    entries_of_blocks = x[cone.nonnegative :]
    largest_entry = max(_SMALL, float(np.abs(entries_of_blocks).max(initial=0.0)))
    slack_to_x = largest_entry / problem.weight
    splits = []
    for size, place in cone.blocks():
        X, S = to_matrix(x[place], size), to_matrix(slack[place], size)
        splits.append(_EigenSplit.of(X, _ROUNDING * largest_entry, scaled_slack=slack_to_x * S))
    return tuple(splits)


def compute_effective_freedom(problem: Problem[Matrices], x: FloatArray) -> FloatArray:
    """Return the effective number of parameters of a penalised fit.

    This number is the divergence of the fitted readings (Stein 1981), ``Σ_k ∂(R x)_k / ∂z_k``, which equals
    ``tr(H⁻¹ 2 RᵀR)`` on the face of the optimum, with H the Hessian of the objective. The face is the part of
    the cone's boundary on which the same scalars and eigenvalues are zero.

    Args:
        problem: problem with squared residuals.
        x: (p,) optimum of the problem.

    Returns:
        An array (p,) whose sum is the effective number: each scalar's part of the number, and each block's
        part at the block's first entry; zero at the other entries.
    """
    face = Face.near(problem, x)
    # One part of the trace for each tangent vector of the face: the free scalars', then those of the blocks.
    parts = np.diagonal(np.linalg.solve(face.hessian, face.information))
    freedom = np.zeros(len(x))
    freedom[face.free] = parts[: len(face.free)]
    for block in face.blocks:
        first_entry = block.place.start
        freedom[first_entry] = parts[block.coordinates].sum()
    return freedom


def solve_with_masses(problem: Problem[WithMasses], gap: float) -> Solution:
    """Solve a problem over products of compliances with masses by Clarabel, and certify the optimum.

    Args:
        problem: x is in units in which it is about as large as ‖b‖; the caps of the compliances bound the
            set, so that a linear function has a least value on the set.
        gap: greatest excess of the loss over its least value that is accepted, for ‖b‖ = 1.

    Raises:
        SolverError: no answer is certified.
    """
    return _select_certified(_propose_solutions_with_masses(problem), gap, None)


def _propose_solutions_with_masses(problem: Problem[WithMasses]) -> Iterator[Solution]:
    """Yield solutions for each tolerance that Clarabel reaches.

    At each tolerance the program is solved in units of the readings, and then again from this solution in
    units of the residual: Clarabel's tolerances are then relative to the residual, which may be much smaller.
    """
    from jointstiff.solver.fit import programs  # takes a second to import

    A, b, cone = problem.squares.R, problem.squares.z, problem.cone
    b_norm = float(np.linalg.norm(b)) or 1.0
    program = programs.state_mass_cones(len(b), cone.blocks)
    witness: FloatArray | None = None  # of the optimum: Clarabel's first answer
    for tolerance in _MASS_TOLERANCES:
        near, unit = np.zeros(A.shape[1]), b_norm
        for _ in ("readings", "residual"):
            data = {"A": A, "b": (b - A @ near) / unit, "near": near / unit, "cap": cone.cap / unit}
            point = program.solve(data, tolerance)
            if point is None:
                break
            if witness is None:
                witness = near + unit * point
            x = cone.move_into_set(near + unit * point)
            yield Solution(x, _certify_with_masses(problem, x, witness))
            near, unit = x, max(float(np.sqrt(problem.squares.loss(x))), _LEAST_UNIT * b_norm)


def _certify_with_masses(
    problem: Problem[WithMasses], x: FloatArray, clarabel_point: FloatArray
) -> Certificate:
    """Return the certificate of a point x (p,) of the set, with A = R and b = z of the problem.

    For any x and y: ``‖A y − b‖² ≥ ‖A x − b‖² + 2 gᵀ(y − x)`` with g = Aᵀ(A x − b), so that the loss at x
    exceeds the least loss by ``2 (gᵀx − min gᵀy)`` at most, with the minimum over all y of the set. This
    bound, for ‖b‖ = 1, is the gap of the certificate.

    Args:
        problem: least squares over a set of cones.
        x: (p,) point of the set.
        clarabel_point: (p,) Clarabel's own answer, a witness of the optimum.
    """
    A, b = problem.squares.R, problem.squares.z
    b_norm = float(np.linalg.norm(b)) or 1.0
    residual = A @ x - b
    g = A.T @ residual
    # The violation is zero for g in the dual cone.
    dual_violation = -2.0 * problem.cone.minimise_linear_function(g) / b_norm**2
    gap = dual_violation + 2.0 * float(g @ x) / b_norm**2
    witness = Witness(float(np.linalg.norm(A @ (clarabel_point - x))) / b_norm)
    return Certificate(0.0, dual_violation, gap, residual / b_norm, "clarabel", witness)


def bound_compliances(problem: Problem[WithMasses], optimum: FloatArray, rise: float) -> FloatArray:
    """Return bounds of each joint's compliance over all x of the set with ``‖A x − b‖² ≤ loss + rise``.

    Clarabel finds where a compliance is least or greatest, and a bound that holds for any answer of Clarabel
    is computed from its multipliers (`_ComplianceEnd.bound_from_below`). A second round uses the upper bounds
    of the first round as caps of the compliances, which makes the set smaller and the bounds sharper.

    Args:
        problem: least squares ‖A x − b‖² over a set of x.
        optimum: (p,) optimum of the problem.
        rise: allowed increase of the loss, positive.

    Returns:
        (n, 2) outer bounds on the least and greatest compliance. Where Clarabel has no answer, they are zero
        and NaN: no compliance is negative.
    """
    squares, cone = problem.squares, problem.cone
    least_radius = _LEAST_RADIUS * float(np.linalg.norm(squares.z))
    r = max(float(np.sqrt(squares.loss(optimum) + rise)), least_radius)
    ends = _minimise_and_maximise_compliances(problem, optimum, r)
    lower, upper = np.full((2, len(cone.cap)), np.nan)
    for _ in range(2):
        capped = Problem(squares, WithMasses(cone.blocks, cap=np.fmin(cone.cap, upper)))
        for end in ends:
            least = end.bound_from_below(capped, r)
            if end.is_greatest:
                upper[end.joint] = -least  # the function is the negative of the compliance
            else:
                lower[end.joint] = least
    return np.column_stack([np.fmax(lower, 0.0), upper])


class _ComplianceEnd(NamedTuple):
    """Clarabel's answer for the least or greatest compliance of a joint in a ball."""

    joint: int
    is_greatest: bool
    function: FloatArray  # (p,) function aᵀy that is minimised: the compliance, or its negative
    multipliers: FloatArray  # (rows,) multipliers u of the ball's rows

    def bound_from_below(self, problem: Problem[WithMasses], radius: float) -> float:
        """Return a lower bound of aᵀy over all y of the set in the ball ``‖A y − b‖ ≤ radius``.

        For any vector u, ``aᵀy = uᵀA y + (a − Aᵀu)ᵀy`` is at least ``uᵀb − radius ‖u‖ + min (a − Aᵀu)ᵀy``,
        with the minimum over the set. A good u are Clarabel's multipliers where aᵀy is least.
        """
        A, b = problem.squares.R, problem.squares.z
        a, u = self.function, self.multipliers
        least_in_ball = u @ b - radius * float(np.linalg.norm(u))
        return float(least_in_ball + problem.cone.minimise_linear_function(a - A.T @ u))


def _minimise_and_maximise_compliances(
    problem: Problem[WithMasses], near: FloatArray, radius: float
) -> list[_ComplianceEnd]:
    """Find the least and greatest compliance of each joint in ``‖A y − b‖ ≤ radius``, y in a set of cones.

    Ends that Clarabel does not find are left out.

    Args:
        problem: A, b and the set of y.
        near: (p,) point near the ball, from which the program's variables are counted.
        radius: radius of the ball, the unit of the program's variables.
    """
    from jointstiff.solver.fit import programs  # takes a second to import

    A, b, cone = problem.squares.R, problem.squares.z, problem.cone
    program = programs.state_mass_cone_end(len(b), cone.blocks)
    data = {"A": A, "b": (b - A @ near) / radius, "near": near / radius, "cap": cone.cap / radius}
    ends = []
    for joint, place_in_y in enumerate(cone.first):
        for is_greatest in (False, True):
            function = np.zeros(len(near))
            function[place_in_y] = -1.0 if is_greatest else 1.0
            solution = program.solve_with_duals({"a": function, **data}, *_MASS_TOLERANCES)
            if solution is None:
                continue
            # The first multiplier belongs to the norm; the next are those of the rows.
            multipliers_of_rows = solution.multipliers[1 : 1 + len(b)]
            ends.append(_ComplianceEnd(joint, is_greatest, function, multipliers_of_rows))
    return ends
