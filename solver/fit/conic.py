"""Programs over cones: Clarabel proposes a point, and a certificate computed from the data accepts the point.

Semidefinite programs with a penalty on traces (method.md §7), of two losses:

    minimise ‖R x − z‖² + pᵀx           subject to   x_j ≥ 0 for the first parameters, Mat(x_b) ⪰ 0
    minimise Σ_i ρ(‖A_i x − d_i‖) + pᵀx     for the blocks that follow, p = λ on traces and some scalars

ρ(u) is u²/(2h) up to h and u − h/2 beyond. Then least squares over cones
of products c η of a compliance with unknowns in a box (method.md §14), see `MassCones`.

Each proposed answer is made exactly feasible. So is a point of the dual program, which comes from the
residual of the answer or from Clarabel. The gap between the two is computed without cancellation, and only an
answer whose gap is small enough leaves this module.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.cone import Block, Cone, to_matrix, to_vector
from jointstiff.solver.fit.solution import Certificate, Witness
from jointstiff.solver.fit.triangle import compute_triangular_factor

if TYPE_CHECKING:
    from jointstiff.solver.fit.programs import Program  # takes a second to import

GAP: Final = 1e-8
"""Greatest excess of the loss over its optimum, with ‖b‖ = 1, that `solve_mass_cones` accepts."""
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
_ORIGIN_RCOND: Final = 1e-6
"""Singular values below this part of the first are ignored in the origin of a program."""
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
_LEAST_RADIUS: Final = 1e-6
"""Radius of the ball of `bound_compliances`, relative to ‖b‖, below which Clarabel's rounding shows: exact
readings."""


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Quadratic part ‖R x − z‖² of the objective, shared by programs with different penalties."""

    R: FloatArray  #: (m, p) regressor; columns of parameters without a penalty have unit norm
    z: FloatArray  #: (m,) readings of unit norm

    @cached_property
    def origin(self) -> FloatArray:
        """Origin (p,) of the variables of cone programs: an approximate least-squares solution.

        Small singular values are ignored, so that the origin is not huge.
        """
        return np.asarray(np.linalg.lstsq(self.R, self.z, rcond=_ORIGIN_RCOND)[0])

    @cached_property
    def compressed(self) -> tuple[FloatArray, FloatArray]:
        """Triangular matrix T (k, p) and readings y (k,): ‖T x − y‖² equals ‖R x − z‖² up to a constant."""
        parameter_count = self.R.shape[1]
        factor = compute_triangular_factor(np.column_stack([self.R, self.z]))
        return factor[:parameter_count, :parameter_count], factor[:parameter_count, parameter_count]


@dataclass(frozen=True, eq=False)
class SemidefiniteProgram:
    """Program with squared residuals: minimise ‖R x − z‖² + pᵀx for x in a cone."""

    fit: LeastSquares  #: quadratic part
    cone: Cone  #: cone of the parameters; columns of scalars without a penalty are independent
    weight: float  #: λ > 0 of the penalty

    @cached_property
    def penalty(self) -> FloatArray:
        """Gradient p (p,) of the penalty."""
        return self.cone.penalty(self.weight)

    def slack(self, x: FloatArray) -> FloatArray:
        """Return the gradient (p,) of the objective at x (p,), the slack of the dual program.

        At the optimum the slack is in the dual cone and orthogonal to x.
        """
        return np.asarray(2.0 * self.fit.R.T @ (self.fit.R @ x - self.fit.z) + self.penalty)

    def find_interior_point(self, tolerance: float, unit: float) -> FloatArray | None:
        """Solve the program by Clarabel in the scaled variables y = (x − origin) / unit.

        The origin is a point near the optimum. With a unit of the residual's size, Clarabel's absolute
        tolerances are relative to the residual, not to the much larger readings.

        Args:
            tolerance: tolerance of Clarabel.
            unit: size of the residual, relative to the readings.

        Returns:
            A point (p,) near the optimum; None if Clarabel fails.
        """
        from jointstiff.solver.fit import programs  # takes a second to import

        origin = self.fit.origin
        matrix, readings = self.fit.compressed
        clarabel_program = programs.state_semidefinite(len(matrix), self.cone)
        data = {
            "T": matrix,
            "z": (readings - matrix @ origin) / unit,
            "p": self.penalty / unit,
            "near": origin / unit,
        }
        solution = clarabel_program.solve(data, tolerance)
        return None if solution is None else origin + unit * solution


@dataclass(frozen=True, eq=False)
class NormSum:
    """Sum of the losses Σ ρ(‖A_i x + B_i v − d_i‖) of targets, shared by programs with different penalties.

    Errors v that are stated as zero, in units of their standard uncertainties, add ``‖s v‖²/(2h)``: the loss
    of q more rows below the threshold h.
    """

    A: FloatArray  #: (K, 3, p) regressor of K targets
    d: FloatArray  #: (K, 3) deflections, scaled to ``Σ ‖d_i‖ = 1``
    cone: Cone  #: cone of the parameters
    B: FloatArray  #: (K, 3, q) columns of the stated errors
    statement: float = 1.0  #: s, the standard uncertainty of a reading, in the unit of d

    @cached_property
    def program(self) -> Program:
        """Compiled program, whose parameters are penalty and threshold."""
        from jointstiff.solver.fit import programs  # takes a second to import

        return programs.state_sum_of_norms(self.A, self.d, self.cone, self.B / self.statement)


@dataclass(frozen=True, eq=False)
class RobustProgram:
    """Program with a robust loss: minimise Σ ρ(‖A_i x + B_i v − d_i‖) + ‖s v‖²/(2h) + pᵀx, x in a cone."""

    loss: NormSum  #: loss of the targets
    weight: float  #: λ > 0 of the penalty
    threshold: float  #: h > 0, in the unit of d


@dataclass(frozen=True, eq=False)
class ConeSolution:
    """Optimum of a program over a cone, with its certificate."""

    x: FloatArray  #: (p,) the optimum
    certificate: Certificate  #: evidence of optimality at x


@dataclass(frozen=True, eq=False)
class RobustSolution(ConeSolution):
    """Optimum of a program with a robust loss."""

    errors: FloatArray  #: (q,) stated errors v, in units of their standard uncertainties


_Solution = TypeVar("_Solution", bound=ConeSolution)


def solve_cone(
    program: SemidefiniteProgram, *, wanted_gap: float, accepted_gap: float | None = None
) -> ConeSolution:
    """Solve a program with squared residuals: by Clarabel, refined by Newton's method, and certified.

    Args:
        program: all numbers finite, readings of unit norm.
        wanted_gap: the search ends when a certificate has at most this gap, with ‖z‖ = 1.
        accepted_gap: greatest gap that is accepted if no answer reaches `wanted_gap`; None for `wanted_gap`.

    Raises:
        SolverError: no answer has a gap that is accepted.
    """

    def propose_solutions() -> Iterator[ConeSolution]:
        """Yield solutions with their certificates, with Clarabel's tolerance made tighter and tighter.

        At each tolerance the program is solved in units of the readings, and then in units of the residual.
        """
        first: FloatArray | None = None  # Clarabel's own first answer, the witness of the optimum
        T, z = program.fit.compressed
        residual_size = max(float(np.linalg.norm(z - T @ program.fit.origin)), _LEAST_UNIT)
        for tolerance in _CONE_TOLERANCES:
            for unit in (1.0, residual_size):
                proposed = program.find_interior_point(tolerance, unit)
                first = proposed if first is None else first
                for _ in range(1 + _NEWTON_STEPS):
                    if proposed is None:
                        break
                    x = program.cone.project(proposed)
                    yield ConeSolution(x, certify_cone(program, x, first))
                    proposed = Face(program, x).step()

    return _select_certified(propose_solutions(), wanted_gap, accepted_gap)


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

    def propose_solutions() -> Iterator[RobustSolution]:
        """Yield points with their certificates, with Clarabel's tolerance made tighter and tighter."""
        loss, root = program.loss, np.sqrt(program.threshold)
        data = {"p": loss.cone.penalty(program.weight), "root": np.array([root])}
        for tolerance in _NORMS_TOLERANCES:
            solution = loss.program.solve_with_duals(data, tolerance)
            if solution is not None:
                x, statement_loss = np.split(solution[0], [loss.cone.dimension])
                x, errors = loss.cone.project(x), root / loss.statement * statement_loss
                # Each cone has four multipliers; the last three are −ν
                dual = -solution[1].reshape(-1, 4)[:, 1:]
                yield RobustSolution(x, certify_robust(program, x, errors, dual), errors)

    return _select_certified(propose_solutions(), wanted_gap, accepted_gap)


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
        is_better = best is None or solution.certificate.gap < best.certificate.gap
        if is_better and solution.certificate.primal == 0.0:
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


def certify_cone(program: SemidefiniteProgram, x: FloatArray, own: FloatArray | None = None) -> Certificate:
    """Return the certificate of a point x (p,): its duality gap proves how near x is to the optimum.

    For any ν with slack ``s = p + Rᵀν`` in the dual cone, ``−‖ν‖²/4 − νᵀz`` is a lower bound of the optimum.
    The objective at x exceeds this bound by ``‖ν/2 − r‖² + sᵀx`` with r = R x − z, a sum of terms that are
    not negative. Here ν = 2 r, changed so that the slack is in the dual cone.

    Args:
        program: program with squared residuals.
        x: (p,) point in the cone.
        own: (p,) Clarabel's own answer, a witness of the optimum; None without a witness.
    """
    fit = program.fit
    residual = fit.R @ x - fit.z
    nu, violation, slack = _make_dual_feasible(program.cone, program.weight, fit.R, 2.0 * residual)
    excess = _compute_complementarity(slack, x, program.cone, _SLACK_ROUNDING)
    gap = float(np.sqrt(np.square(0.5 * nu - residual).sum() + excess))
    witness = None
    if own is not None:
        witness = Witness(float(np.linalg.norm(fit.R @ (own - x))), _CONE_WITNESS)
    return Certificate(max(0.0, -program.cone.least_value(x)), violation, gap, nu, "clarabel", witness)


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
    loss, threshold = program.loss, program.threshold
    rows = loss.A.reshape(-1, len(x))
    multipliers, violation, slack = _make_dual_feasible(loss.cone, program.weight, rows, dual)
    # ρ(r) + h‖ν‖²/2 − νᵀr as squares and products that are not negative
    residual = loss.A @ x + loss.B @ errors - loss.d
    residual_norm = np.linalg.norm(residual, axis=1)
    is_beyond = residual_norm > threshold
    direction = residual / np.where(is_beyond, residual_norm, 1.0)[:, None]
    misalignment = np.maximum(0.0, 1.0 - (multipliers * direction).sum(axis=1))
    gap_beyond_threshold = (
        0.5 * threshold * np.square(multipliers - direction).sum(axis=1)
        + (residual_norm - threshold) * misalignment
    )
    gap_within_threshold = np.square(residual - threshold * multipliers).sum(axis=1) / (2.0 * threshold)
    excess = _compute_complementarity(slack, x, loss.cone, _NORMS_SLACK_ROUNDING)
    root = np.sqrt(threshold)
    pull = np.einsum("kiq,ki->q", loss.B, multipliers)  # Bᵀν
    unbalanced = loss.statement / root * errors + root / loss.statement * pull
    excess += 0.5 * float(unbalanced @ unbalanced)
    gap = float(np.where(is_beyond, gap_beyond_threshold, gap_within_threshold).sum() + excess)
    return Certificate(max(0.0, -loss.cone.least_value(x)), violation, gap, multipliers, "clarabel")


def _make_dual_feasible(
    cone: Cone, weight: float, rows: FloatArray, dual: FloatArray
) -> tuple[FloatArray, float, FloatArray]:
    """Change multipliers ν of the residuals so that the slack ``s = p + Aᵀν`` is in the dual cone.

    A least-squares step makes the slacks of scalars without a penalty feasible. Multiplying ν by
    ``λ / (λ + violation)`` then makes the slacks of blocks and penalised scalars feasible.

    Args:
        cone: cone of the parameters.
        weight: λ > 0 of the penalty p.
        rows: A (m, p).
        dual: nearly feasible ν, (m,) for squared residuals, or (K, 3) with norms of at most one.

    Returns:
        Feasible ν in the shape of `dual`, the violation of the dual cone before the shrinking, divided by λ,
        and the slack s (p,).
    """
    penalty, multipliers = cone.penalty(weight), dual.ravel()
    free_rows = rows[:, : cone.free].T
    shortfall = np.maximum(-(free_rows @ multipliers), 0.0)
    if shortfall.any():
        multipliers = multipliers + np.linalg.lstsq(free_rows, shortfall, rcond=None)[0]
    gradient = rows.T @ multipliers
    slack = gradient + penalty
    # Slacks that must not be negative: eigenvalues of the blocks, and penalised scalars.
    least_slacks = [
        float(np.linalg.eigvalsh(to_matrix(slack[place], size)).min()) for size, place in cone.blocks()
    ]
    violation = max(0.0, -min(least_slacks + slack[cone.free : cone.nonnegative].tolist(), default=0.0))
    reshaped, factor = multipliers.reshape(dual.shape), weight / (weight + violation)
    if reshaped.ndim > 1:
        factor = min(factor, 1.0 / max(float(np.linalg.norm(reshaped, axis=1).max(initial=0.0)), 1.0))
    return factor * reshaped, violation / weight, penalty + factor * gradient


def _compute_complementarity(slack: FloatArray, x: FloatArray, cone: Cone, rounding: float) -> float:
    """Return the product ``sᵀx`` of slack and point; inf if a slack without penalty is too negative.

    The slack of a scalar without a penalty may be negative within rounding: it is then replaced by its
    absolute value, in place.
    """
    free = slice(cone.free)
    if not (slack[free] >= -rounding).all():
        return float("inf")
    slack[free] = np.abs(slack[free])  # counts rounding as positive slack, so the gap is not understated
    return max(0.0, float(slack @ x))


def compute_penalised_range(
    program: SemidefiniteProgram, x: FloatArray, rise: float, functions: FloatArray
) -> FloatArray:
    """Return the ranges of linear functions over all points whose objective is near the optimum.

    Each range is ``min, max aᵀy subject to ‖R y − z‖² + pᵀy ≤ ‖R x − z‖² + pᵀx + rise``, y in the cone; p is
    the gradient of the penalty.

    Args:
        program: program with squared residuals.
        x: (p,) optimum of the program.
        rise: allowed increase of the objective, positive.
        functions: (K, p) coefficients a of K functions.

    Returns:
        (K, 2) least and greatest values; NaN where Clarabel fails.
    """
    from jointstiff.solver.fit import programs  # takes a second to import

    matrix, z = program.fit.compressed
    limit = float(np.square(matrix @ x - z).sum() + program.penalty @ x) + rise
    clarabel_program = programs.state_penalised_end(matrix, z, program.penalty, limit, program.cone)
    ranges = np.full((len(functions), 2), np.nan)
    for number, side in np.ndindex(ranges.shape):
        function = functions[number]
        if norm := float(np.linalg.norm(function)):
            point = clarabel_program.solve({"a": (1.0, -1.0)[side] * function / norm}, *_END_TOLERANCES)
            ranges[number, side] = np.nan if point is None else function @ point
    return ranges


def compute_unconstrained_range(squares: LeastSquares, functions: FloatArray, radius: float) -> FloatArray:
    """Return the ranges of linear functions over the ellipsoid ``‖R x − z‖² ≤ min + radius²``.

    min is the least value of ‖R x − z‖² over x; constraints on x are ignored.

    Args:
        squares: R and z, with p parameters.
        functions: (K, p) coefficients of K functions.
        radius: root of the allowed excess of the squares.

    Returns:
        (K, 2) least and greatest values; NaN where the readings do not determine a function.
    """
    left_vectors, singular_values, directions = np.linalg.svd(squares.R, full_matrices=False)
    is_determined = singular_values > _NULL_SINGULAR_VALUE * singular_values[0]
    directions = directions[is_determined]
    scaled_functions = functions @ (directions.T / singular_values[is_determined])
    centre = scaled_functions @ (left_vectors[:, is_determined].T @ squares.z)
    half_width = radius * np.linalg.norm(scaled_functions, axis=1)
    undetermined = np.linalg.norm(functions - functions @ directions.T @ directions, axis=1)
    half_width[undetermined > _OUTSIDE_SPAN * np.linalg.norm(functions, axis=1)] = np.nan
    return np.column_stack([centre - half_width, centre + half_width])


@dataclass(frozen=True, eq=False)
class _BlockFace:
    """Face of one block: matrices X = U X_r Uᵀ of rank r, with slack V S_s Vᵀ."""

    place: slice  # of the block in the parameters
    U: FloatArray  # (size, r) range of X
    V: FloatArray  # (size, size − r) null space of X
    core: FloatArray  # (r, r) X_r
    slack: FloatArray  # (size − r, size − r) S_s

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal tangent vectors (q, d) of the face of a block, as columns.

        First the changes of the part of the matrix within the range U, then the changes between U and its
        complement V. q is the number of entries of the block as a vector.
        """
        U, V = self.U, self.V
        within = [
            (np.outer(U[:, i], U[:, j]) + np.outer(U[:, j], U[:, i])) / (2.0 if i == j else np.sqrt(2.0))
            for i in range(len(self.core))
            for j in range(i + 1)
        ]
        between = [(np.outer(u, v) + np.outer(v, u)) / np.sqrt(2.0) for u in self.U.T for v in V.T]
        matrices = [*within, *between]
        size = len(U) * (len(U) + 1) // 2  # entries of the symmetric block as a vector
        return to_vector(np.array(matrices)).T if matrices else np.zeros((size, 0))

    def take_step(self, step: FloatArray) -> FloatArray | None:
        """Return the block as a vector (q,) after a step that keeps its rank; None if it leaves the cone.

        `step` (d,) are coordinates in the tangent vectors of the face.
        """
        if not len(self.core):
            return np.zeros(len(self.basis))
        tangent = to_matrix(self.basis @ step, len(self.U))
        core = self.core + self.U.T @ tangent @ self.U
        if np.linalg.eigvalsh(core)[0] <= 0.0:
            return None
        root_columns = self.U @ core + self.V @ (self.V.T @ tangent @ self.U)
        return to_vector(root_columns @ np.linalg.solve(core, root_columns.T))


class Face:
    """Face of a cone near the optimum: scalars and eigenvalues that exceed their slack count as not zero.

    On a face the program is smooth. Matrices of rank r around ``X = U X_r Uᵀ`` are, to second order,
    ``X + U A Uᵀ + U B Vᵀ + V Bᵀ Uᵀ + V Bᵀ X_r⁻¹ B Vᵀ`` with any small symmetric A and any small B; the last
    term meets the slack ``V S_s Vᵀ`` and bends the objective by ``tr(S_s Bᵀ X_r⁻¹ B)`` (Shapiro,
    *Perturbation analysis of optimization problems in Banach spaces*, 1992). The Hessian serves Newton's
    method, which refines Clarabel's answer, and the derivative of the fit with respect to the readings.
    """

    x: FloatArray  #: (p,) point on the face
    free: IndexArray  #: indices of the scalars that are not zero
    #: face of each block, and the slice of its tangent coordinates
    blocks: tuple[tuple[_BlockFace, slice], ...]
    basis: FloatArray  #: (p, d) tangent vectors: the free scalars', then those of the blocks
    information: FloatArray  #: (d, d) Gram matrix 2 RᵀR of the readings in tangent coordinates
    hessian: FloatArray  #: (d, d) Hessian of the objective on the face

    def __init__(self, program: SemidefiniteProgram, x: FloatArray) -> None:
        """Determine the face at a feasible point x (p,): zero scalars, and the rank of each block."""
        slack, cone = program.slack(x), program.cone
        self.free = free = np.flatnonzero(x[: cone.nonnegative] > slack[: cone.nonnegative])
        largest = max(_SMALL, float(np.abs(x[cone.nonnegative :]).max(initial=0.0)))
        self.x, decomposed = np.zeros(len(x)), []
        self.x[free] = x[free]
        for size, place in cone.blocks():
            X, S = to_matrix(x[place], size), to_matrix(slack[place], size)
            values, vectors = np.linalg.eigh(X)
            # The rank counts the eigenvalues that exceed both their slack, in units of X, and rounding.
            exceeds = np.linalg.eigvalsh(X - largest / program.weight * S) > 0.0
            rank = min(int(exceeds.sum()), int((values > _ROUNDING * largest).sum()))
            values = values[size - rank :]
            U = vectors[:, size - rank :]
            V = vectors[:, : size - rank]
            self.x[place] = to_vector((U * values) @ U.T)
            decomposed.append((place, U, V, values))
        self._slack = program.slack(self.x)
        faces = []
        for place, U, V, values in decomposed:
            # At the optimum the slack is positive semidefinite: take the nearest such matrix.
            eigenvalues, vectors = np.linalg.eigh(V.T @ to_matrix(self._slack[place], len(U)) @ V)
            S_s = (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T
            faces.append(_BlockFace(place, U, V, np.diag(values), S_s))
        ends = np.cumsum([len(free), *(face.basis.shape[1] for face in faces)]).tolist()
        self.blocks = tuple(zip(faces, [slice(*each) for each in pairwise(ends)], strict=True))
        self.basis = np.zeros((len(x), ends[-1]))
        self.basis[free, np.arange(len(free))] = 1.0
        for face, coordinates in self.blocks:
            self.basis[face.place, coordinates] = face.basis
        R = program.fit.R @ self.basis
        self.information = 2.0 * R.T @ R
        self.hessian = self.information.copy()
        for face, coordinates in self.blocks:
            if rank := len(face.core):  # the slack adds curvature in the coordinates of B, the last ones
                between = slice(coordinates.start + rank * (rank + 1) // 2, coordinates.stop)
                self.hessian[between, between] += np.kron(np.linalg.inv(face.core), face.slack)
        self.hessian[np.diag_indices_from(self.hessian)] += _RIDGE * self.hessian.diagonal().max(initial=0.0)

    def step(self) -> FloatArray | None:
        """Return the point (p,) after one step of Newton's method on the face; None if the step fails.

        A step fails if it leaves the cone. The point may be worse than before, so it needs a certificate.
        """
        try:
            coordinates_step = np.asarray(
                np.linalg.solve(self.hessian, -(self.basis.T @ self._slack)), dtype=np.float64
            )
        except np.linalg.LinAlgError:
            return None
        new_point = np.zeros(len(self.x))
        new_point[self.free] = self.x[self.free] + coordinates_step[: len(self.free)]
        for face, coordinates in self.blocks:
            block = face.take_step(coordinates_step[coordinates])
            if block is None:
                return None
            new_point[face.place] = block
        is_in_cone = np.isfinite(new_point).all() and (new_point[self.free] >= 0.0).all()
        return new_point if is_in_cone else None


def compute_effective_freedom(program: SemidefiniteProgram, x: FloatArray) -> FloatArray:
    """Return the effective number of parameters of a penalised fit.

    This number is the divergence of the fitted readings (Stein 1981), ``Σ_k ∂(R x)_k / ∂z_k``, which equals
    ``tr(H⁻¹ 2 RᵀR)`` on the face of the optimum, with H the Hessian of the objective.

    Args:
        program: program with squared residuals.
        x: (p,) optimum of the program.

    Returns:
        An array (p,) whose sum is the effective number: each scalar's part of the number, and each block's
        part at the block's first entry; zero at the other entries.
    """
    face, freedom = Face(program, x), np.zeros(len(x))
    shares = np.diagonal(np.linalg.solve(face.hessian, face.information))
    freedom[face.free] = shares[: len(face.free)]
    for block, coordinates in face.blocks:
        freedom[block.place.start] = shares[coordinates].sum()
    return freedom


@dataclass(frozen=True, eq=False)
class MassCones:
    """Set of the products c π of compliances c and unknown masses and moments π, one block for each joint.

    Unknowns π in a box and in balls, each multiplied by its joint's own c ≥ 0, lie in a convex cone: the
    perspective of that set (Boyd & Vandenberghe 2004, §3.2.6). In units of the half-widths a block of x is

        (c, ζ, ν)   with   0 ≤ c ≤ cap,   |ζ_k| ≤ c,   ‖ν_g‖ ≤ c + ratio_g ζ_k(g)

    ζ_k is c times the deviation of a mass, or of a balancer's constant, from the middle of the bounds. ν_g
    (3,) is c times mass times displacement of a centre of mass. The radius of ball g grows with mass k(g).
    """

    blocks: tuple[Block, ...]  #: one for each joint
    cap: FloatArray  #: (n,) greatest c, in the unit of x

    @property
    def first(self) -> FloatArray:
        """Indices (n,) of each block's compliance c in x."""
        sizes = [block.size for block in self.blocks]
        return np.cumsum([0, *sizes[:-1]])

    def minimise_linear_function(self, s: FloatArray) -> float:
        """Return the least value of the linear function sᵀx over the set: zero or negative, in closed form.

        For each block the least value is ``cap · min(0, s_c − h(s))``, where s_c is the coefficient of c, and
        h the greatest value of −sᵀ(ζ, ν) in the block's set at c = 1.
        """
        total = 0.0
        for start, block, cap in zip(self.first.tolist(), self.blocks, self.cap.tolist(), strict=True):
            zeta = s[start + 1 : start + 1 + block.boxes].copy()
            nu = s[start + 1 + block.boxes : start + block.size].reshape(-1, 3)
            norms = np.linalg.norm(nu, axis=1)
            for (box, ratio), norm in zip(block.balls, norms.tolist(), strict=True):
                if box >= 0:  # the ball's radius grows with the mass `box`; −1 if the mass is exact
                    zeta[box] -= ratio * norm
            total += cap * min(0.0, float(s[start] - np.abs(zeta).sum() - norms.sum()))
        return total

    def move_into_set(self, x: FloatArray) -> FloatArray:
        """Return a point (p,) of the set near x (p,): entries beyond a limit are moved onto it."""
        x = x.copy()
        for start, block, cap in zip(self.first.tolist(), self.blocks, self.cap.tolist(), strict=True):
            compliance = x[start] = min(max(x[start], 0.0), cap)
            box_entries = slice(start + 1, start + 1 + block.boxes)
            x[box_entries] = np.clip(x[box_entries], -compliance, compliance)
            for ball, (box_number, ratio) in enumerate(block.balls):
                ball_entries = slice(box_entries.stop + 3 * ball, box_entries.stop + 3 * ball + 3)
                radius = compliance + (ratio * x[start + 1 + box_number] if box_number >= 0 else 0.0)
                x[ball_entries] *= min(1.0, radius / max(float(np.linalg.norm(x[ball_entries])), 1e-300))
        return x


@dataclass(frozen=True, eq=False)
class MassConeSolution(ConeSolution):
    """Optimum of least squares ‖A x − b‖² over the set of a `MassCones`.

    The gap of the certificate bounds the excess of the loss over its least value, for ‖b‖ = 1.
    """

    loss: float  #: ‖A x − b‖² at the optimum


def solve_mass_cones(A: FloatArray, b: FloatArray, cones: MassCones) -> MassConeSolution:
    """Solve ``minimise ‖A x − b‖²`` over cones of masses and moments by Clarabel, and certify the optimum.

    For any x and y: ``‖A y − b‖² ≥ ‖A x − b‖² + 2 gᵀ(y − x)`` with g = Aᵀ(A x − b), so that the loss at x
    exceeds the least loss by ``2 (gᵀx − min gᵀy)`` at most, with the minimum over all y of the set.

    Args:
        A: (rows, p) regressor.
        b: (rows,) readings.
        cones: set of x, in units in which x is about as large as ‖b‖; the caps of the compliances bound the
            set, so that the minimum of gᵀy exists.

    Raises:
        SolverError: no answer is certified.
    """
    from jointstiff.solver.fit import programs  # takes a second to import

    b_norm = float(np.linalg.norm(b)) or 1.0  # the program is stated for readings of unit norm
    program = programs.state_mass_cones(len(b), cones.blocks)

    def propose_solutions() -> Iterator[MassConeSolution]:
        """Yield a solution with its certificate for each tolerance that Clarabel reaches."""
        for tolerance in _MASS_TOLERANCES:
            point = program.solve({"A": A, "b": b / b_norm, "cap": cones.cap / b_norm}, tolerance)
            if point is not None:
                x = cones.move_into_set(b_norm * point)
                residual = A @ x - b
                gradient = A.T @ residual
                # gap = 2 (gᵀx − min gᵀy) / ‖b‖²; the second term is zero if g is in the dual cone.
                dual_infeasibility = -2.0 * cones.minimise_linear_function(gradient) / b_norm**2
                gap = dual_infeasibility + 2.0 * float(gradient @ x) / b_norm**2
                certificate = Certificate(0.0, dual_infeasibility, gap, residual / b_norm, "clarabel")
                yield MassConeSolution(x, certificate, float(residual @ residual))

    return _select_certified(propose_solutions(), GAP, None)


def bound_compliances(
    A: FloatArray, b: FloatArray, optimum: MassConeSolution, rise: float, cones: MassCones
) -> FloatArray:
    """Return bounds of each joint's compliance over all x of the set with ``‖A x − b‖² ≤ loss + rise``.

    For any u, all y with ‖A y − b‖ ≤ r satisfy ``aᵀy ≥ uᵀb − r ‖u‖ + min (a − Aᵀu)ᵀy``; a selects the
    compliance of a joint, and u are Clarabel's multipliers. A second round uses the upper bounds of the first
    round as caps of the compliances, which sharpens the bounds.

    Args:
        A: (rows, p) regressor.
        b: (rows,) readings.
        optimum: optimum of ‖A x − b‖² over the set, and its loss.
        rise: allowed increase of the loss, positive.
        cones: set of x.

    Returns:
        (n, 2) outer bounds on the least and greatest compliance; NaN where Clarabel has no answer.
    """
    from jointstiff.solver.fit import programs  # takes a second to import

    radius = max(float(np.sqrt(optimum.loss + rise)), _LEAST_RADIUS * float(np.linalg.norm(b)))
    program = programs.state_mass_cone_end(len(b), cones.blocks)
    data = {"A": A, "b": (b - A @ optimum.x) / radius, "near": optimum.x / radius, "cap": cones.cap / radius}
    bounds, multipliers = np.full((len(cones.cap), 2), np.nan), {}
    for joint, side in np.ndindex(
        bounds.shape
    ):  # side 0 minimises the compliance of block j, side 1 maximises
        function = np.zeros(len(optimum.x))
        function[cones.first[joint]] = (1.0, -1.0)[side]
        solution = program.solve_with_duals({"a": function, **data}, *_MASS_TOLERANCES)
        if solution is not None:
            # The first multiplier belongs to the norm; the next are those of the rows.
            multipliers[joint, side] = function, solution[1][1 : 1 + len(b)]
    cap = cones.cap
    for _ in range(2):  # the second round uses the caps that the first has lowered
        for (joint, side), (function, multiplier) in multipliers.items():
            least = (
                multiplier @ b
                - radius * float(np.linalg.norm(multiplier))
                + MassCones(cones.blocks, cap).minimise_linear_function(function - A.T @ multiplier)
            )
            bounds[joint, side] = least if side == 0 else -least
        cap = np.fmin(cap, bounds[:, 1])
    bounds[:, 0] = np.fmax(bounds[:, 0], 0.0)
    return bounds
