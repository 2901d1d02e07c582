"""Solutions of identification problems: Clarabel proposes, a certificate decides.

The steps are those of method.md §5. Columns and right-hand side are brought to unit norm, so that
neither units nor twelve decades between the joints matter. The program stated in `programs` is solved by
Clarabel. From Clarabel's answer follow the active bounds and inequalities, and least squares with these held
exactly gives the point. The point is accepted only if the conditions of Karush, Kuhn and Tucker hold in the
data. Where Clarabel's interior point does not show which constraints are active, an active-set method takes
over. The problems are convex, so a certified point is the optimum, whichever algorithm proposed it.

Many small problems with bounds alone are solved at once from their Gram matrices (`solve_batch`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Final

import numpy as np

from jointstiff.schemas.run import Certificate as StagesCertificate
from jointstiff.schemas.run import SupportFinder
from jointstiff.solver.arrays import ActiveBounds, BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.problem import (
    FREE,
    LOWER,
    MOST_PIVOTS,
    TOLERANCE,
    UPPER,
    Bounds,
    IdentificationProblem,
    Scaled,
)

LEAST_EIGENVALUE: Final = 1e-6
"""Least eigenvalue of an equilibrated Gram matrix: rounding of 1e-16 in the entries grows to 1e-10 in the
answer."""
_ROUNDING: Final = 64 * np.finfo(float).eps
"""Rounding of a gradient, relative to the largest variable."""
_ACTIVE_SLACK: Final = 1e-6
"""Largest slack of an interior point at a row that is active at the optimum."""


@dataclass(frozen=True)
class Witness:
    """Agreement of Clarabel's own answer, before any refinement, with the certified optimum."""

    #: distance of the fitted readings of the two answers, relative to the readings; inf without an answer
    distance: float
    limit: float = 2e-5  #: greatest distance that Clarabel's tolerance explains, near the root of 1e-10

    @property
    def agrees(self) -> bool:
        """Return whether Clarabel found the optimum to its tolerance."""
        return self.distance <= self.limit


@dataclass(frozen=True, eq=False)
class Certificate:
    """Evidence that an answer is the optimum of a convex program, computed from the data at the answer.

    Violations are dimensionless, and beyond rounding. For least squares in equilibrated variables a gradient
    is the cosine between a column and the residual, times ‖residual‖/‖z‖.
    """

    primal: float  #: greatest violation of a constraint; for a cone, the most negative scalar or eigenvalue
    #: greatest part of the gradient that the multipliers do not balance. For a cone, distance of the slack
    #: from the dual cone before the multipliers were changed, over the weight of the penalty
    dual: float
    #: greatest min(multiplier, slack). For a cone, root of the objective's excess over the lower bound that
    #: the multipliers prove, with ‖z‖ = 1: the fitted readings differ from those of the optimum by no more.
    #: For a robust loss, the excess
    gap: float
    #: (n + k,) multipliers of the bounds, positive at a lower and negative at an upper bound, then of the
    #: inequalities. For a cone, (m,) or (K, 3) multipliers of the equations that define the residuals
    multipliers: FloatArray
    solved_by: SupportFinder  #: algorithm that found the active bounds
    #: comparison with Clarabel's own answer; None where Clarabel was not asked. The violations above prove
    #: the optimum, whichever algorithm found it
    witness: Witness | None = None

    def is_optimal(self) -> bool:
        """Return whether no violation exceeds `TOLERANCE`, so that the point is the optimum."""
        return max(self.primal, self.dual, self.gap) <= TOLERANCE


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
    """Return the greatest distance of Clarabel's own answers; None if not asked, or without an answer."""
    distances = [stage.witness.distance for stage in stages if stage.witness is not None]
    return max(distances) if distances and np.isfinite(distances).all() else None


def certify(scaled: Scaled, x: FloatArray, solved_by: SupportFinder) -> Certificate:
    """Return the certificate of a point: by how much it violates the conditions of an optimum.

    Args:
        scaled: the equilibrated problem.
        x: (n,) the point, in equilibrated variables.
        solved_by: algorithm that found the point; recorded in the certificate.
    """
    gradient, greatest_value = scaled.gradient(x), max(1.0, float(np.abs(x).max()))
    if len(scaled.d):
        # Non-negative multipliers are computed for the tight rows alone, so complementarity holds by
        # construction, and the rows may be linearly dependent.
        G, h = scaled.constraints
        multipliers = scaled.multipliers_at(x)
        unbalanced = np.abs(gradient - G.T @ multipliers)
        # The rounding error of the difference is that of its largest terms: nearly parallel rows, such as
        # those of a joint that the readings hardly show, have multipliers far larger than the gradient.
        largest = max(greatest_value, float((np.abs(G.T) @ multipliers).max(initial=0.0)))
        bound_count = len(h) - len(scaled.d)  # the rows of the bounds come first
        return Certificate(
            primal=max(0.0, float((h - G @ x).max(initial=0.0)) - _ROUNDING * greatest_value),
            dual=max(0.0, float(unbalanced.max()) - _ROUNDING * largest),
            gap=0.0,
            multipliers=np.concatenate(
                [G[:bound_count].T @ multipliers[:bound_count], multipliers[bound_count:]]
            ),
            solved_by=solved_by,
        )
    lower, upper = scaled.bounds.lower, scaled.bounds.upper
    lower_slack, upper_slack = x - lower, upper - x
    # The multiplier of a lower bound is the positive part of the gradient, that of an upper bound minus the
    # negative part. Either the multiplier or the slack must be zero.
    complementarity = np.maximum(
        np.minimum(np.maximum(gradient, 0.0), lower_slack),
        np.minimum(np.maximum(-gradient, 0.0), upper_slack),
    )
    # The rounding error of a gradient is that of the terms that cancel in it.
    violation = scaled.bounds.gradient_violation(x, gradient)
    return Certificate(
        primal=max(0.0, float(-np.minimum(lower_slack, upper_slack).min())),
        dual=max(0.0, float(violation.max()) - _ROUNDING * greatest_value),
        gap=max(0.0, float(complementarity.max()) - _ROUNDING * greatest_value),
        multipliers=np.where((x <= lower) | (x >= upper), gradient, 0.0),
        solved_by=solved_by,
    )


@dataclass(frozen=True, eq=False)
class Solution:
    """The optimum of an `IdentificationProblem`."""

    compliance: FloatArray  #: (n,) [rad/(N·m)]
    active: ActiveBounds  #: (n,) -1 at the lower bound, 1 at the upper bound, else 0
    certificate: Certificate  #: evidence of optimality
    #: (k,) inequalities that hold with equality up to rounding; None where the problem has none
    tight: BoolArray | None = None


_Proposal = tuple[FloatArray, SupportFinder]
"""A point (n,) in equilibrated variables, and the algorithm that found its active bounds."""


def solve(problem: IdentificationProblem) -> Solution:
    """Solve a problem by Clarabel, refine the answer by exact least squares, and certify the optimum.

    Returns:
        The optimum with its certificate. Where R is rank deficient, the fitted R c is unique, but c
        is one of many optima; see `solver.fit.observability`.

    Raises:
        SolverError: if no candidate satisfies the optimality conditions.
    """
    from jointstiff.solver.fit import programs  # takes a second to import

    scaled = Scaled.from_problem(problem)
    near = programs.solve_least_squares(scaled)
    of_clarabel = () if near is None else _propose_near(scaled, near)
    fallback = _propose_by_least_distance(scaled) if len(scaled.d) else _propose_by_active_set(scaled)
    solution = _select_first_certified(problem, scaled, chain(of_clarabel, fallback))
    witness = compare_answers(scaled.A, near, solution.compliance / scaled.unit, scaled.b)
    return replace(solution, certificate=replace(solution.certificate, witness=witness))


def compare_answers(
    rows: FloatArray, own: FloatArray | None, optimum: FloatArray, readings: FloatArray
) -> Witness:
    """Return the distance of Clarabel's own answer from the certified optimum.

    Args:
        rows: (m, p) regressor.
        own: (p,) Clarabel's answer; None if Clarabel gave none.
        optimum: (p,) the certified optimum.
        readings: (m,) right-hand side.
    """
    if own is None:
        return Witness(float("inf"))
    size = float(np.linalg.norm(readings)) or 1.0
    return Witness(float(np.linalg.norm(rows @ (own - optimum))) / size)


def solve_step(problem: IdentificationProblem) -> Solution:
    """Solve a problem by pivoting and certify the optimum; where pivoting fails, solve by Clarabel.

    This is faster than `solve`, and meant for problems solved many times, as in iterations. Pivoting starts
    from least squares without bounds. The optimum is certified by the same conditions as in `solve`.

    Raises:
        SolverError: if no candidate satisfies the optimality conditions.
    """
    scaled = Scaled.from_problem(problem)
    if len(scaled.d):
        return _select_first_certified(
            problem, scaled, chain(_propose_by_least_distance(scaled), _propose_by_clarabel(scaled))
        )
    x = scaled.solve_by_pivoting(np.zeros(len(scaled.unit), dtype=np.int8))
    no_bound_is_active = bool(((x > scaled.bounds.lower) & (x < scaled.bounds.upper)).all())
    pivoted: _Proposal = x, "least_squares" if no_bound_is_active else "pivoting"
    return _select_first_certified(
        problem, scaled, chain([pivoted], _propose_by_clarabel(scaled), _propose_by_active_set(scaled))
    )


def _select_first_certified(
    problem: IdentificationProblem, scaled: Scaled, proposals: Iterable[_Proposal]
) -> Solution:
    """Return the first proposed point that is certified as the optimum.

    Raises:
        SolverError: if no proposal satisfies the optimality conditions.
    """
    certificate = Certificate(np.inf, np.inf, 0.0, np.zeros(0), "clarabel")
    for point, solved_by in proposals:
        x = scaled.bounds.snap(point)
        certificate = certify(scaled, x, solved_by)
        if certificate.is_optimal():
            active = scaled.bounds.active_bounds_at(x)
            compliance = problem.bounds.hold_exactly(x * scaled.unit, active)
            tight = scaled.find_tight_constraints(x)[-len(scaled.d) :] if len(scaled.d) else None
            return Solution(compliance, active, certificate, tight)
    raise SolverError(
        f"no solution satisfies the optimality conditions to {TOLERANCE:g} (primal "
        f"{certificate.primal:.1e}, dual {certificate.dual:.1e})"
    )


def _propose_by_clarabel(scaled: Scaled) -> Iterator[_Proposal]:
    """Yield exact least-squares points near Clarabel's answer; nothing if Clarabel fails."""
    from jointstiff.solver.fit import programs  # takes a second to import

    near = programs.solve_least_squares(scaled)
    if near is not None:
        yield from _propose_near(scaled, near)


def _propose_near(scaled: Scaled, near: FloatArray) -> Iterator[_Proposal]:
    """Yield exact least-squares points on the constraints that are active in Clarabel's answer (n,)."""
    if len(scaled.d):  # active rows have a positive multiplier, and the answer nearly touches them
        rows = scaled.multipliers_at(near, _ACTIVE_SLACK) > 0
        if rows[-len(scaled.d) :].any():
            yield from _propose_on_rows(scaled, rows, near, "clarabel")
            return
        # All inequalities have slack, so only bounds can be active.
    gradient = scaled.gradient(near)
    active = np.zeros(len(near), dtype=np.int8)  # at a bound where the multiplier exceeds the slack
    active[gradient > near - scaled.bounds.lower] = LOWER
    active[-gradient > scaled.bounds.upper - near] = UPPER
    yield scaled.solve_by_pivoting(active), "clarabel"
    # Where the optimum is not unique, pivoting ends at the shortest optimum, which may violate a bound that
    # Clarabel's point satisfies: also propose the optimum nearest to Clarabel's point.
    yield scaled.solve_with_active_bounds(active, near), "clarabel"


def _propose_by_active_set(scaled: Scaled) -> Iterator[_Proposal]:
    """Yield the optimum under bounds alone, by bounded-variable least squares (Stark & Parker 1995)."""
    from scipy.optimize import lsq_linear

    bounds = scaled.bounds.lower, scaled.bounds.upper
    outcome = lsq_linear(scaled.A, scaled.b, bounds=bounds, method="bvls", tol=1e-15)
    yield scaled.solve_with_active_bounds(np.asarray(outcome.active_mask, dtype=np.int8)), "active_set"


def _propose_by_least_distance(scaled: Scaled) -> Iterator[_Proposal]:
    """Yield the optimum under inequalities by least-distance programming; nothing if A lacks full rank.

    The problem is turned into one of least distance, whose dual is a non-negative least-squares problem that
    ends after finitely many steps (Lawson & Hanson 1974, chapter 23). With A = Q R and w = R x − Qᵀb, the
    rows
    ``G x ≥ h`` of the constraints are ``G R⁻¹ w ≥ h − G R⁻¹ Qᵀ b =: g``, and the w of least length is sought.
    The
    solution of non-negative least squares on ``E = [(G R⁻¹)ᵀ; gᵀ]`` with right-hand side (0, …, 0, 1) gives
    the
    multipliers.
    """
    from scipy.optimize import nnls

    Q, R = np.linalg.qr(scaled.A)
    if len(R) < R.shape[1] or np.abs(np.diagonal(R)).min() <= 1e-9:
        return
    G, h = scaled.constraints
    transformed_rows = np.linalg.solve(R.T, G.T).T
    transformed_limits = h - transformed_rows @ (Q.T @ scaled.b)
    E = np.vstack([transformed_rows.T, transformed_limits])
    column_norms = np.linalg.norm(E, axis=0)
    right_side = np.zeros(len(E))
    right_side[-1] = 1.0
    try:
        multipliers, _ = nnls(E / column_norms, right_side)
    except RuntimeError:  # no convergence
        return
    yield from _propose_on_rows(scaled, multipliers > 0, np.zeros(len(scaled.unit)), "least_distance")


def _propose_on_rows(
    scaled: Scaled, active: BoolArray, near: FloatArray, solved_by: SupportFinder
) -> Iterator[_Proposal]:
    """Yield two least-squares points at which some rows of the constraints hold with equality.

    Args:
        scaled: the equilibrated problem.
        active: (k,) mask of the rows that hold with equality at the second point. At the first point the rows
            with a positive multiplier at the second point do: rounding may have hidden some active rows, but
            where variables differ very much in size, the first point may have too many rows.
        near: (n,) point; where a least-squares point is not unique, the nearest to this point is taken.
        solved_by: algorithm that found the active rows.
    """
    x = scaled.solve_on_rows(active, near)
    yield scaled.solve_on_rows(scaled.multipliers_at(x) > 0, x), solved_by
    yield x, solved_by


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
    caller solves the others from their rows. Every answer is certified; problems whose optimum pivoting does
    not find are solved one at a time by `solve_step`.

    The numbers of a problem do not depend, to the last bit, on the other problems in the batch.

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
    # Equilibrated variables x with c = unit · x (K, n); columns of zeros keep the unit 1.
    diagonal = np.diagonal(gram, axis1=1, axis2=2)
    norms = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scaled_moment = moment / norms
    greatest_moment = np.abs(scaled_moment).max(axis=1, keepdims=True, initial=0.0)
    problem_size = np.where(greatest_moment > 0, greatest_moment, 1.0)
    units = problem_size / norms
    A = gram / (norms[:, :, None] * norms[:, None, :])
    problems = GramProblems(A, scaled_moment / problem_size, bounds.in_units(units))
    is_certified = problems.well_conditioned()
    solvable = problems.select(np.flatnonzero(is_certified))
    solutions, active = np.full(moment.shape, np.nan), np.zeros(moment.shape, dtype=np.int8)
    solutions[is_certified] = optima = solvable.find_optima()
    active[is_certified] = solvable.bounds.active_bounds_at(optima)
    return BatchSolution(bounds.hold_exactly(solutions * units, active), active, is_certified)


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

        The diagonal entries are one at most, so the mean of all eigenvalues but the least, λ, is at most
        n/(n − 1), and ``det A ≤ λ (n/(n − 1))ⁿ⁻¹``: for most matrices the cheap determinant decides.
        """
        variable_count = self.A.shape[1]
        is_well_conditioned = np.asarray(
            np.linalg.det(self.A) * (1.0 - 1.0 / variable_count) ** (variable_count - 1) >= LEAST_EIGENVALUE
        )
        is_well_conditioned[~is_well_conditioned] = (
            np.linalg.eigvalsh(self.A[~is_well_conditioned])[:, 0] >= LEAST_EIGENVALUE
        )
        return is_well_conditioned

    def find_optima(self) -> FloatArray:
        """Return the optima (K, n) of well-conditioned problems, by pivoting or else by `solve_step`."""
        x = self.bounds.snap(self.solve_by_pivoting())
        # x is within its bounds; the other conditions of Karush, Kuhn and Tucker are that the gradient is
        # zero off the bounds, positive at a lower bound and negative at an upper bound. The gradient has the
        # rounding error of the terms that cancel in it.
        violation = self.bounds.gradient_violation(x, self.gradient(x))
        rounding = _ROUNDING * np.maximum(1.0, np.abs(x).max(axis=1))
        is_optimal: BoolArray = violation.max(axis=1) <= TOLERANCE + rounding
        for k in np.flatnonzero(~is_optimal):
            # The same problem as rows: a triangle R with RᵀR = A, and z with Rᵀz = b.
            factor = np.linalg.cholesky(self.A[k])
            z = np.linalg.solve(factor, self.b[k])
            bounds = Bounds(self.bounds.lower[k], self.bounds.upper[k])
            x[k] = solve_step(IdentificationProblem(factor.T, z, bounds)).compliance
        return x

    def solve_by_pivoting(self) -> FloatArray:
        """Return the least-squares points (K, n) at which pivoting ends; they are not certified.

        Pivoting ends when no variable changes between free and bound, or after `MOST_PIVOTS` rounds.
        """
        points, active = np.empty(self.b.shape), np.zeros(self.b.shape, dtype=np.int8)
        # Only the problems whose active bounds still change are solved again.
        unsettled, problems = np.arange(len(active)), self
        for _ in range(MOST_PIVOTS):
            before = active[unsettled]
            points[unsettled] = x = problems.solve_with_active_bounds(before)
            pivoted = problems.bounds.pivot(before, x, problems.gradient(x))
            changed = (pivoted != before).any(axis=1)
            unsettled = unsettled[changed]
            active[unsettled] = pivoted[changed]
            if not len(unsettled):
                return points
            problems = self.select(unsettled)
        points[unsettled] = problems.solve_with_active_bounds(active[unsettled])
        return points

    def solve_with_active_bounds(self, active: ActiveBounds) -> FloatArray:
        """Return the least-squares points (K, n) with the variables of active bounds fixed at their bounds.

        `active` (K, n) states the bound at which each variable is fixed, or that it is free. Rows and columns
        of fixed variables become those of the unit matrix. The eigenvalues of the other rows and columns lie
        between those of A, so no system is singular.
        """
        is_free = active == FREE
        at_bounds = self.bounds.values_at_bounds(active)
        system = np.where(is_free[:, :, None] & is_free[:, None, :], self.A, np.eye(is_free.shape[1]))
        right_side = np.where(is_free, -self.gradient(at_bounds), at_bounds)
        x = np.linalg.solve(system, right_side[:, :, None])[:, :, 0]
        return np.where(is_free, x, at_bounds)

    def gradient(self, x: FloatArray) -> FloatArray:
        """Return the gradients A x − b (K, n) without BLAS, whose order of summation depends on threads."""
        return np.asarray((self.A * x[:, None, :]).sum(axis=2) - self.b)
