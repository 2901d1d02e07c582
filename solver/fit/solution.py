"""Solutions of convex problems: Clarabel proposes, a certificate decides.

The steps over scalars are those of method.md §5. Columns and right-hand side are brought to unit norm, so
that neither units nor twelve decades between the joints matter. The program stated in `programs` is solved by
Clarabel. From Clarabel's answer follow the active bounds and inequalities, and least squares with these held
exactly gives the point. The point is accepted only if the conditions of Karush, Kuhn and Tucker hold in the
data. Where Clarabel's interior point does not show which constraints are active, an active-set method takes
over. The problems are convex, so a certified point is the optimum, whichever algorithm proposed it.

Many small problems with bounds alone are solved at once from their Gram matrices (`solve_batch`). Problems
over other cones are solved by `solver.fit.conic`, and certified in the same way.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Final, NamedTuple, overload

import numpy as np

from jointstiff.schemas.run import Certificate as StagesCertificate
from jointstiff.schemas.run import SupportFinder
from jointstiff.solver.arrays import ActiveBounds, BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.cone import Matrices, Scalars, WithMasses
from jointstiff.solver.fit.constraints import FREE, LOWER, TOLERANCE, UPPER, Bounds
from jointstiff.solver.fit.problem import Certificate, Equilibrated, LeastSquares, Problem, Solution, Witness

GAP: Final = 1e-8
"""Greatest gap of a certificate that is accepted by default, for a cone of matrices or of masses."""
MOST_PIVOTS: Final = 8
"""Maximum rounds of pivoting; nearly all problems settle in two or three."""
_NO_DIRECTION: Final = 1e-13
"""Relative singular value that counts as zero."""
LEAST_EIGENVALUE: Final = 1e-6
"""Least eigenvalue of an equilibrated Gram matrix: rounding of 1e-16 in the entries grows to 1e-10 in the
answer."""
_ROUNDING: Final = 64 * np.finfo(float).eps
"""Rounding of a gradient, relative to the largest variable."""
_ACTIVE_SLACK: Final = 1e-6
"""Largest slack of an interior point at a row that is active at the optimum."""


def greatest_violations(stages: Sequence[Certificate]) -> StagesCertificate:
    """Return one certificate for all stages (at least one) of a method, with their greatest violations."""
    return StagesCertificate(
        primal=max(stage.primal for stage in stages),
        dual=max(stage.dual for stage in stages),
        complementarity=max(stage.gap for stage in stages),
        solved_by=[stage.solved_by for stage in stages],
        solver_distance=find_solver_distance(stages),
    )


def find_solver_distance(stages: Sequence[Certificate]) -> float | None:
    """Return the greatest distance of Clarabel's own answers from the certified optima.

    None if Clarabel was not called, or gave no answer.
    """
    distances = [stage.witness.distance for stage in stages if stage.witness is not None]
    if not distances or not np.isfinite(distances).all():
        return None
    return max(distances)


def certify(problem: Problem[Scalars], x: FloatArray, solved_by: SupportFinder) -> Certificate:
    """Return the certificate of a point: by how much it violates the conditions of an optimum.

    With bounds alone, the conditions of Karush, Kuhn and Tucker for each variable x and the gradient g of the
    objective are:

        primal    lower ≤ x ≤ upper
        dual      g = 0 between the bounds, g ≥ 0 at the lower bound, g ≤ 0 at the upper bound
        gap       min(g⁺, x − lower) = 0 and min(g⁻, upper − x) = 0

    g⁺ and g⁻ are the positive and the negative part of g, which are the multipliers of the lower and upper
    bound. The terms of g cancel in it, so a violation up to the rounding error of these terms counts as zero.

    Args:
        problem: the equilibrated problem.
        x: (n,) the point, in equilibrated variables.
        solved_by: algorithm that found the point; recorded in the certificate.
    """
    if problem.cone.inequality_count:
        return _certify_under_inequalities(problem, x, solved_by)
    bounds = problem.cone.bounds
    lower, upper = bounds.lower, bounds.upper
    gradient = problem.squares.gradient(x)
    distance_outside_bounds = float(np.maximum(lower - x, x - upper).max())
    unbalanced_gradient = float(bounds.gradient_violation(x, gradient).max())
    greatest_gap = _find_greatest_gap(bounds, x, gradient)
    rounding = _ROUNDING * max(1.0, float(np.abs(x).max()))
    is_at_bound = (x <= lower) | (x >= upper)
    return Certificate(
        primal=max(0.0, distance_outside_bounds),
        dual=max(0.0, unbalanced_gradient - rounding),
        gap=max(0.0, greatest_gap - rounding),
        multipliers=np.where(is_at_bound, gradient, 0.0),
        solved_by=solved_by,
    )


def _find_greatest_gap(bounds: Bounds, x: FloatArray, gradient: FloatArray) -> float:
    """Return the greatest min(multiplier, slack) over the bounds of all variables, which is 0 at an optimum.

    The slack is the distance of a variable from its bound. At an optimum a bound with a slack has no
    multiplier: it does not keep the variable from moving on (complementarity).

    Args:
        bounds: bounds of the n variables.
        x: (n,) point.
        gradient: (n,) gradient of the objective at x. A positive entry is the multiplier of the lower bound;
            a negative entry is minus that of the upper bound.
    """
    gap_at_lower = np.minimum(np.maximum(gradient, 0.0), x - bounds.lower)
    gap_at_upper = np.minimum(np.maximum(-gradient, 0.0), bounds.upper - x)
    return float(np.maximum(gap_at_lower, gap_at_upper).max())


def _certify_under_inequalities(
    problem: Problem[Scalars], x: FloatArray, solved_by: SupportFinder
) -> Certificate:
    """Return the certificate of a point of a problem with constraints ``G x ≥ h``, the bounds among them.

    The arguments are those of `certify`. With the gradient g of the objective and multipliers μ ≥ 0 of the
    constraints, the conditions of an optimum are:

        primal    G x ≥ h
        dual      g = Gᵀμ
        gap       μ = 0 for each constraint that does not hold with equality

    Multipliers are computed only for the constraints that hold with equality at the point. So there is no
    gap by construction, and rows of G may be linearly dependent.
    """
    G, h = problem.cone.rows
    multipliers = _balance_gradient(problem, x)
    greatest_violation = float((h - G @ x).max(initial=0.0))
    unbalanced_gradient = float(np.abs(problem.squares.gradient(x) - G.T @ multipliers).max())
    # The rounding error of the difference is that of its largest terms: nearly parallel rows, such as those
    # of a joint that the readings hardly show, have multipliers far larger than the gradient.
    greatest_value = max(1.0, float(np.abs(x).max()))
    greatest_term = max(greatest_value, float((np.abs(G.T) @ multipliers).max(initial=0.0)))
    return Certificate(
        primal=max(0.0, greatest_violation - _ROUNDING * greatest_value),
        dual=max(0.0, unbalanced_gradient - _ROUNDING * greatest_term),
        gap=0.0,
        multipliers=_join_multipliers_of_bounds(problem.cone, multipliers),
        solved_by=solved_by,
    )


def _join_multipliers_of_bounds(cone: Scalars, multipliers: FloatArray) -> FloatArray:
    """Return one multiplier for both bounds of each variable (n,), then those of the k inequalities.

    Args:
        cone: scalars, whose constraints ``G x ≥ h`` are the bounds, then the inequalities.
        multipliers: multipliers of these constraints, zero or positive.
    """
    G, h = cone.rows
    bound_count = len(h) - cone.inequality_count
    # The row of a lower bound is a unit vector, that of an upper bound a negative one.
    of_variables = G[:bound_count].T @ multipliers[:bound_count]
    return np.concatenate([of_variables, multipliers[bound_count:]])


@dataclass(frozen=True, eq=False)
class SolutionOfScalars(Solution):
    """The optimum of a problem over scalars."""

    active: ActiveBounds  #: (p,) -1 at the lower bound, 1 at the upper bound, else 0
    #: (k,) inequalities that hold with equality up to rounding; None where the problem has none
    tight: BoolArray | None = None


_Proposal = tuple[FloatArray, SupportFinder]
"""A point (n,) in equilibrated variables, and the algorithm that found its active bounds."""


@overload
def solve(problem: Problem[Scalars], *, witnessed: bool = ...) -> SolutionOfScalars: ...


@overload
def solve(
    problem: Problem[Matrices] | Problem[WithMasses], *, gap: float = ..., accepted: float | None = ...
) -> Solution: ...


def solve(
    problem: Problem[Any], *, witnessed: bool = True, gap: float = GAP, accepted: float | None = None
) -> Solution:
    """Solve a problem, and certify the optimum; the shape of the cone decides how.

    Args:
        problem: least squares over a cone.
        witnessed: for scalars: True to solve by Clarabel, whose own answer is a witness of the optimum, and
            to refine this answer by exact least squares. False to solve by pivoting, and by Clarabel only
            where pivoting fails: this is faster, and meant for problems solved many times, as in iterations.
        gap: for other cones: the search ends when a certificate has at most this gap, for readings of unit
            norm. Scalars have no gap beyond rounding.
        accepted: for a cone of matrices: greatest gap that is accepted if no answer reaches `gap`; None for
            `gap`.

    Returns:
        The optimum with its certificate. Where R is rank deficient, the fitted R x is unique, but x is one of
        many optima; see `solver.fit.observability`.

    Raises:
        SolverError: no answer is certified as the optimum.
    """
    if isinstance(problem.cone, Scalars):
        return _solve_scalars(problem, witnessed=witnessed)
    from jointstiff.solver.fit import conic  # joints alone do not need it

    if isinstance(problem.cone, Matrices):
        return conic.solve_matrices(problem, gap, accepted)
    return conic.solve_with_masses(problem, gap)


def _solve_scalars(problem: Problem[Scalars], *, witnessed: bool) -> SolutionOfScalars:
    """Solve a problem over scalars by Clarabel with a witness, or by pivoting; see `solve`.

    Raises:
        SolverError: no candidate satisfies the optimality conditions.
    """
    scaled = problem.equilibrated
    if not witnessed:
        return _select_first_certified(problem, scaled, _propose_fast(scaled.problem))
    from jointstiff.solver.fit import programs  # takes a second to import

    clarabel_point = programs.solve_least_squares(scaled.problem)
    # The proposals are generators: the fallback runs only if no point near Clarabel's answer is certified.
    near_clarabel: Iterator[_Proposal] = iter(())
    if clarabel_point is not None:
        near_clarabel = _propose_near(scaled.problem, clarabel_point)
    proposals = chain(near_clarabel, _propose_without_clarabel(scaled.problem))
    solution = _select_first_certified(problem, scaled, proposals)
    squares = scaled.problem.squares
    witness = compare_answers(squares.R, clarabel_point, solution.x / scaled.unit, squares.z)
    return replace(solution, certificate=replace(solution.certificate, witness=witness))


def compare_answers(
    rows: FloatArray, clarabel_point: FloatArray | None, optimum: FloatArray, readings: FloatArray
) -> Witness:
    """Compare Clarabel's own answer with the certified optimum: how far their fitted readings differ.

    Args:
        rows: (m, p) regressor.
        clarabel_point: (p,) Clarabel's answer; None if Clarabel gave none.
        optimum: (p,) the certified optimum.
        readings: (m,) right-hand side.
    """
    if clarabel_point is None:
        return Witness(float("inf"))
    size_of_readings = float(np.linalg.norm(readings)) or 1.0
    difference = float(np.linalg.norm(rows @ (clarabel_point - optimum)))
    return Witness(difference / size_of_readings)


def _propose_fast(problem: Problem[Scalars]) -> Iterator[_Proposal]:
    """Yield points that may be the optimum, the fastest method first.

    Inequalities: least-distance programming, then Clarabel. Bounds alone: pivoting, which starts from least
    squares without bounds, then Clarabel, and last an active-set method.
    """
    if problem.cone.inequality_count:
        yield from _propose_by_least_distance(problem)
        yield from _propose_by_clarabel(problem)
        return
    bounds = problem.cone.bounds
    all_free = np.full(len(bounds.lower), FREE, dtype=np.int8)
    x = _solve_by_pivoting(problem, all_free)
    is_inside_bounds = (x > bounds.lower) & (x < bounds.upper)
    yield x, "least_squares" if is_inside_bounds.all() else "pivoting"
    yield from _propose_by_clarabel(problem)
    yield from _propose_by_active_set(problem)


def _propose_without_clarabel(problem: Problem[Scalars]) -> Iterator[_Proposal]:
    """Yield points found by an active-set method: of least distance where there are inequalities."""
    if problem.cone.inequality_count:
        yield from _propose_by_least_distance(problem)
    else:
        yield from _propose_by_active_set(problem)


def _select_first_certified(
    problem: Problem[Scalars], scaled: Equilibrated, proposals: Iterable[_Proposal]
) -> SolutionOfScalars:
    """Return the first proposed point that is certified as the optimum.

    Args:
        problem: the problem in its own units.
        scaled: the same problem in equilibrated variables.
        proposals: points that are tried in turn, in equilibrated variables.

    Raises:
        SolverError: if no proposal satisfies the optimality conditions.
    """
    certificate = Certificate(np.inf, np.inf, 0.0, np.zeros(0), "clarabel")  # in case of no proposal
    for point, solved_by in proposals:
        x = scaled.problem.cone.bounds.snap(point)
        certificate = certify(scaled.problem, x, solved_by)
        if certificate.is_optimal():
            return _build_solution(problem, scaled, x, certificate)
    raise SolverError(
        f"no solution satisfies the optimality conditions to {TOLERANCE:g} (primal "
        f"{certificate.primal:.1e}, dual {certificate.dual:.1e})"
    )


def _build_solution(
    problem: Problem[Scalars], scaled: Equilibrated, x: FloatArray, certificate: Certificate
) -> SolutionOfScalars:
    """Return the solution at a certified point x (n,), in the problem's own units.

    Args:
        problem: the problem in its own units.
        scaled: the same problem in equilibrated variables.
        x: (n,) the optimum, in equilibrated variables.
        certificate: evidence of optimality.
    """
    cone = scaled.problem.cone
    active = cone.bounds.active_bounds_at(x)
    in_own_units = problem.cone.bounds.hold_exactly(x * scaled.unit, active)
    tight_inequalities: BoolArray | None = None
    if cone.inequality_count:
        # The rows of the cone are the bounds, then the inequalities.
        tight_inequalities = cone.find_tight_rows(x)[-cone.inequality_count :]
    return SolutionOfScalars(in_own_units, certificate, active, tight_inequalities)


def _propose_by_clarabel(problem: Problem[Scalars]) -> Iterator[_Proposal]:
    """Yield exact least-squares points near Clarabel's answer; nothing if Clarabel fails."""
    from jointstiff.solver.fit import programs  # takes a second to import

    near = programs.solve_least_squares(problem)
    if near is not None:
        yield from _propose_near(problem, near)


def _propose_near(problem: Problem[Scalars], near: FloatArray) -> Iterator[_Proposal]:
    """Yield exact least-squares points on the constraints that are active in Clarabel's answer (n,).

    Clarabel's answer is an interior point: it only nearly touches the constraints that are active at the
    optimum. An inequality counts as active if it is nearly tight and has a positive multiplier. Without an
    active inequality, only bounds can be active.
    """
    inequality_count = problem.cone.inequality_count
    if inequality_count:
        # The rows of the cone are the bounds, then the inequalities.
        multipliers = _balance_gradient(
            problem, near, _ACTIVE_SLACK
        )  # zero at constraints that are not tight
        is_active = multipliers > 0
        has_active_inequality = is_active[-inequality_count:].any()
        if has_active_inequality:
            yield from _propose_on_rows(problem, is_active, near, "clarabel")
            return
    yield from _propose_on_bounds(problem, near)


def _propose_on_bounds(problem: Problem[Scalars], near: FloatArray) -> Iterator[_Proposal]:
    """Yield exact least-squares points at the bounds that are active in Clarabel's answer (n,).

    A bound is active if its multiplier exceeds its slack. Where the optimum is not unique, pivoting ends at
    the shortest optimum, which may violate a bound that Clarabel's point satisfies: so the second proposal is
    the optimum nearest to Clarabel's point.
    """
    gradient = problem.squares.gradient(near)
    active = np.full(len(near), FREE, dtype=np.int8)
    active[gradient > near - problem.cone.bounds.lower] = LOWER
    active[-gradient > problem.cone.bounds.upper - near] = UPPER
    yield _solve_by_pivoting(problem, active), "clarabel"
    yield _solve_with_active_bounds(problem, active, near), "clarabel"


def _propose_by_active_set(problem: Problem[Scalars]) -> Iterator[_Proposal]:
    """Yield the optimum under bounds alone, by bounded-variable least squares (Stark & Parker 1995)."""
    from scipy.optimize import lsq_linear

    bounds = problem.cone.bounds.lower, problem.cone.bounds.upper
    outcome = lsq_linear(problem.squares.R, problem.squares.z, bounds=bounds, method="bvls", tol=1e-15)
    active = np.asarray(outcome.active_mask, dtype=np.int8)
    yield _solve_with_active_bounds(problem, active), "active_set"


def _propose_by_least_distance(problem: Problem[Scalars]) -> Iterator[_Proposal]:
    """Yield the optimum under inequalities by least-distance programming; nothing if A lacks full rank.

    The problem ``minimise ‖A x − b‖² subject to G x ≥ h`` is turned into one of least distance, whose dual is
    to fit (0, …, 0, 1) by multipliers u ≥ 0 of the columns of a matrix E (Lawson & Hanson 1974, chapter 23).
    The constraints with positive multipliers are active at the optimum, which is then found by exact least
    squares. Nothing is proposed, too, if the multipliers do not converge.
    """
    from scipy.optimize import nnls

    E = _build_dual_of_least_distance(problem)
    if E is None:
        return
    column_norms = np.linalg.norm(E, axis=0)
    target = np.zeros(len(E))
    target[-1] = 1.0
    try:
        multipliers, _ = nnls(E / column_norms, target)
    except RuntimeError:
        return
    is_active = multipliers > 0
    origin = np.zeros(problem.squares.R.shape[1])
    yield from _propose_on_rows(problem, is_active, origin, "least_distance")


def _build_dual_of_least_distance(problem: Problem[Scalars]) -> FloatArray | None:
    """Return the matrix ``E = [(G R⁻¹)ᵀ; gᵀ]`` (n + 1, k) of the least-distance problem; None without it.

    With A = Q R and w = R x − Qᵀb, the problem ``minimise ‖A x − b‖² subject to G x ≥ h`` is ``minimise ‖w‖
    subject to G R⁻¹ w ≥ g`` with ``g = h − G R⁻¹ Qᵀ b``. There is no such problem if A lacks full rank.
    """
    Q, R = np.linalg.qr(problem.squares.R)
    has_full_rank = len(R) == R.shape[1] and np.abs(np.diagonal(R)).min() > 1e-9
    if not has_full_rank:
        return None
    G, h = problem.cone.rows
    transformed_G = np.linalg.solve(R.T, G.T).T  # G R⁻¹
    g = h - transformed_G @ (Q.T @ problem.squares.z)
    return np.vstack([transformed_G.T, g])


def _propose_on_rows(
    problem: Problem[Scalars], active: BoolArray, near: FloatArray, solved_by: SupportFinder
) -> Iterator[_Proposal]:
    """Yield two candidates for the optimum: least-squares points on some constraints, held with equality.

    The second candidate holds the constraints `active`. The first candidate holds those whose multipliers are
    positive at the second: these include active constraints that rounding hid from the caller, but may be too
    many where variables differ very much in size.

    Args:
        problem: the equilibrated problem.
        active: (k,) mask of the constraints that seem to be active.
        near: (n,) point; where a least-squares point is not unique, the nearest to this point is taken.
        solved_by: algorithm that found the active constraints; recorded with the candidates.
    """
    second = _solve_on_rows(problem, active, near)
    has_positive_multiplier = _balance_gradient(problem, second) > 0
    first = _solve_on_rows(problem, has_positive_multiplier, second)
    yield first, solved_by
    yield second, solved_by


def _balance_gradient(problem: Problem[Scalars], x: FloatArray, slack: float = TOLERANCE) -> FloatArray:
    """Return multipliers μ (k,) ≥ 0 of the constraints ``G x ≥ h`` that best balance the gradient at x.

    They minimise ‖Gᵀ μ − gradient‖ by non-negative least squares. If that does not converge, they are
    zero: the point then gets no certificate, as it should.

    Args:
        problem: the equilibrated problem.
        x: (n,) a point.
        slack: constraints with more slack, relative to max(1, ‖x‖∞), have the multiplier zero.
    """
    from scipy.optimize import nnls

    G, h = problem.cone.rows
    multipliers = np.zeros(len(h))
    is_tight = problem.cone.find_tight_rows(x, slack)
    if is_tight.any():
        with suppress(RuntimeError):
            multipliers[is_tight], _ = nnls(G[is_tight].T, problem.squares.gradient(x))
    return multipliers


def _solve_with_active_bounds(
    problem: Problem[Scalars], active: ActiveBounds, near: FloatArray | None = None
) -> FloatArray:
    """Return the least-squares point (n,) with all active variables fixed at their bounds.

    If several points minimise ‖A x − b‖², the minimum nearest to `near` is returned, or the minimum of
    least norm if `near` is None.
    """
    is_free = active == FREE
    x = problem.cone.bounds.values_at_bounds(active)
    if near is not None:
        x[is_free] = near[is_free]
    if is_free.any():
        # lstsq returns the shortest step, so that the point is the nearest to the start.
        residual = problem.squares.z - problem.squares.R @ x
        step, *_ = np.linalg.lstsq(problem.squares.R[:, is_free], residual, rcond=_NO_DIRECTION)
        x[is_free] += step
    return x


def _solve_by_pivoting(problem: Problem[Scalars], active: ActiveBounds) -> FloatArray:
    """Return the least-squares point (n,) reached by pivoting from given active bounds.

    Each round of pivoting exchanges the bounds that are wrongly active or wrongly inactive. Pivoting ends
    when the active bounds no longer change, or after `MOST_PIVOTS` rounds. The point may not be optimal:
    the caller must check it.
    """
    x = _solve_with_active_bounds(problem, active)
    for _ in range(MOST_PIVOTS):
        pivoted = problem.cone.bounds.pivot(active, x, problem.squares.gradient(x))
        if (pivoted == active).all():
            break
        active = pivoted
        x = _solve_with_active_bounds(problem, active)
    return x


def _solve_on_rows(problem: Problem[Scalars], active: BoolArray, near: FloatArray) -> FloatArray:
    """Minimise ‖A x − b‖² with equality ``G_a x = h_a`` in the active rows of the constraints.

    The shortest step to ``G_a x = h_a`` is followed by a least-squares step in the null space of G_a, in
    which G_a x does not change.

    Args:
        problem: the equilibrated problem.
        active: (k,) whether each row of the constraints holds with equality.
        near: (n,) point; where the optimum is not unique, the optimum nearest to this point is returned.

    Returns:
        The point x (n,).
    """
    G, h = problem.cone.rows
    G_a, h_a = G[active], h[active]
    x = near
    null_space = np.eye(len(x))  # directions as columns
    if active.any():
        U, singular_values, Vt = np.linalg.svd(G_a, full_matrices=True)
        rank = int((singular_values > _NO_DIRECTION * singular_values[0]).sum())
        coefficients = (U[:, :rank].T @ (h_a - G_a @ x)) / singular_values[:rank]
        x = x + Vt[:rank].T @ coefficients
        null_space = Vt[rank:].T
    is_fixed_by_rows = null_space.shape[1] == 0
    if is_fixed_by_rows:
        return np.asarray(x, dtype=np.float64)
    # Nearly parallel rows may have moved x far away: a second step removes the rounding error of the
    # first step.
    for _ in range(2):
        residual = problem.squares.z - problem.squares.R @ x
        step, *_ = np.linalg.lstsq(problem.squares.R @ null_space, residual, rcond=_NO_DIRECTION)
        x = x + null_space @ step
    return np.asarray(x, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class BatchSolution:
    """The optima of K problems over n parameters."""

    compliance: FloatArray  #: (K, n) [rad/(N·m)]; NaN where not certified
    active: ActiveBounds  #: (K, n) -1 at the lower bound, 1 at the upper bound, else 0
    #: (K,) whether the optimality conditions hold to `TOLERANCE`; False where the Gram matrix is singular or
    #: too ill-conditioned to solve
    certified: BoolArray


def solve_batch(gram: FloatArray, moment: FloatArray, bounds: Bounds) -> BatchSolution:
    """Solve K problems ``minimise cᵀ G c − 2 hᵀ c subject to lower ≤ c ≤ upper``, with G = AᵀA and h = Aᵀd.

    A Gram matrix squares the condition number, so only problems that keep about nine digits are solved; the
    caller solves the others from their rows. Every answer is certified. The numbers of a problem do not
    depend, to the last bit, on the other problems in the batch.

    Args:
        gram: (K, n, n) G, symmetric, in any unit.
        moment: (K, n) h.
        bounds: bounds of the n parameters, the same for all problems.

    Returns:
        The optima of all K problems; the optima of ill-conditioned problems are marked as not certified.

    Raises:
        SolverError: if a number is not finite, or an optimum could not be certified.
    """
    if not (np.isfinite(gram).all() and np.isfinite(moment).all()):
        raise SolverError(
            "the numbers of the readings are too large to be squared",
            remedy="check the units and magnitudes of the readings",
        )
    problems, units = _equilibrate(gram, moment, bounds)
    is_solvable = problems.well_conditioned()
    solvable = problems.select(np.flatnonzero(is_solvable))
    optima = solvable.find_optima()
    x = np.full(moment.shape, np.nan)
    x[is_solvable] = optima
    active = np.full(moment.shape, FREE, dtype=np.int8)
    active[is_solvable] = solvable.bounds.active_bounds_at(optima)
    compliance = bounds.hold_exactly(x * units, active)
    return BatchSolution(compliance, active, certified=is_solvable)


class _Equilibrated(NamedTuple):
    """Problems in variables x without unit; the parameters are ``c = units · x``."""

    problems: GramProblems
    units: FloatArray  # (K, n)


def _equilibrate(gram: FloatArray, moment: FloatArray, bounds: Bounds) -> _Equilibrated:
    """Return K problems in variables in which the columns of A have norm 1, and the greatest |h| is 1.

    Then neither units nor decades between the parameters matter. A column of zeros is divided by 1.

    Args:
        gram: (K, n, n) Gram matrices G = AᵀA.
        moment: (K, n) h = Aᵀd.
        bounds: bounds of the n parameters.
    """
    squared_norms = np.diagonal(gram, axis1=1, axis2=2)
    norms = np.sqrt(np.where(squared_norms > 0, squared_norms, 1.0))  # of the columns of A
    scaled_gram = gram / (norms[:, :, None] * norms[:, None, :])
    scaled_moment = moment / norms
    greatest_moment = np.abs(scaled_moment).max(axis=1, keepdims=True, initial=0.0)
    problem_size = np.where(greatest_moment > 0, greatest_moment, 1.0)  # (K, 1)
    units = problem_size / norms
    problems = GramProblems(scaled_gram, scaled_moment / problem_size, bounds.in_units(units))
    return _Equilibrated(problems, units)


@dataclass(frozen=True, eq=False)
class GramProblems:
    """K least-squares problems given by Gram matrices A, in variables in which A has a unit diagonal.

    The largest |b_i| of each problem is 1.
    """

    A: FloatArray  #: (K, n, n) Gram matrices
    b: FloatArray  #: (K, n) right-hand sides of ``A x = b``, the conditions without bounds
    bounds: Bounds  #: (K, n) bounds of the variables

    def select(self, which: IndexArray) -> GramProblems:
        """Return the problems with some indices."""
        return GramProblems(self.A[which], self.b[which], self.bounds.select(which))

    def well_conditioned(self) -> BoolArray:
        """Return a mask (K,) of Gram matrices whose eigenvalues are all at least `LEAST_EIGENVALUE`.

        For most matrices the cheap determinant decides. The diagonal entries are one at most, so the mean of
        all eigenvalues but the least, λ, is at most n/(n − 1), and ``det A ≤ λ (n/(n − 1))ⁿ⁻¹``.
        """
        n = self.A.shape[1]
        proven_least = np.linalg.det(self.A) * (1.0 - 1.0 / n) ** (n - 1)  # λ is at least this
        is_well_conditioned = np.asarray(proven_least >= LEAST_EIGENVALUE)
        undecided = ~is_well_conditioned
        least_eigenvalue = np.linalg.eigvalsh(self.A[undecided])[:, 0]
        is_well_conditioned[undecided] = least_eigenvalue >= LEAST_EIGENVALUE
        return is_well_conditioned

    def find_optima(self) -> FloatArray:
        """Return the optima (K, n) of well-conditioned problems, by pivoting or else by `solve`.

        A point within its bounds is the optimum if the gradient is zero off the bounds, not negative at a
        lower bound and not positive at an upper bound. The gradient has the rounding error of the terms that
        cancel in it.
        """
        x = self.bounds.snap(self.solve_by_pivoting())
        violation = self.bounds.gradient_violation(x, self.gradient(x))
        rounding = _ROUNDING * np.maximum(1.0, np.abs(x).max(axis=1))
        is_optimal: BoolArray = violation.max(axis=1) <= TOLERANCE + rounding
        for k in np.flatnonzero(~is_optimal).tolist():
            x[k] = self._solve_by_rows(k)
        return x

    def _solve_by_rows(self, k: int) -> FloatArray:
        """Return the optimum (n,) of problem k from rows ``R x ≈ z`` with RᵀR = A and Rᵀz = b."""
        L = np.linalg.cholesky(self.A[k])  # A = L Lᵀ, so that R = Lᵀ
        z = np.linalg.solve(L, self.b[k])
        bounds = Bounds(self.bounds.lower[k], self.bounds.upper[k])
        return solve(Problem(LeastSquares(L.T, z), Scalars(bounds)), witnessed=False).x

    def solve_by_pivoting(self) -> FloatArray:
        """Return the least-squares points (K, n) at which pivoting ends; they are not certified.

        A pivot fixes variables beyond a bound at the bound, and frees those whose gradient points inside.
        Pivoting ends when no variable changes between free and bound, or after `MOST_PIVOTS` rounds.
        """
        points = np.empty(self.b.shape)
        active = np.full(self.b.shape, FREE, dtype=np.int8)
        unsettled = np.arange(len(active))  # problems whose active bounds still change
        for _ in range(MOST_PIVOTS):
            problems, before = self.select(unsettled), active[unsettled]
            x = problems.solve_with_active_bounds(before)
            points[unsettled] = x
            pivoted = problems.bounds.pivot(before, x, problems.gradient(x))
            has_changed = (pivoted != before).any(axis=1)
            unsettled = unsettled[has_changed]
            active[unsettled] = pivoted[has_changed]
            if not len(unsettled):
                return points
        points[unsettled] = self.select(unsettled).solve_with_active_bounds(active[unsettled])
        return points

    def solve_with_active_bounds(self, active: ActiveBounds) -> FloatArray:
        """Return the least-squares points (K, n) with the variables of active bounds fixed at their bounds.

        `active` (K, n) states the bound at which each variable is fixed, or that it is free. In each system
        ``A x = b`` the rows and columns of fixed variables become those of the unit matrix. The eigenvalues
        of the other rows and columns are between those of A, so no system is singular.
        """
        is_free = active == FREE
        at_bounds = self.bounds.values_at_bounds(active)  # (K, n), zero for free variables
        both_free = is_free[:, :, None] & is_free[:, None, :]  # (K, n, n)
        systems = np.where(both_free, self.A, np.eye(is_free.shape[1]))
        right_sides = np.where(is_free, -self.gradient(at_bounds), at_bounds)
        x = np.linalg.solve(systems, right_sides[:, :, None])[:, :, 0]
        return np.where(is_free, x, at_bounds)

    def gradient(self, x: FloatArray) -> FloatArray:
        """Return the gradients A x − b (K, n) without BLAS, whose order of summation depends on threads."""
        return np.asarray((self.A * x[:, None, :]).sum(axis=2) - self.b)
