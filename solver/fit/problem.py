"""Identification problems as data: bounds, an order of the compliances, and equilibrated least squares."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import ActiveBounds, BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError, SolverError

FREE, LOWER, UPPER = 0, -1, 1

TOLERANCE: Final = 1e-12
"""Largest violation of an optimality condition, in equilibrated variables, that counts as rounding."""
MOST_PIVOTS: Final = 8
"""Maximum rounds of pivoting; nearly all problems settle in two or three."""
_NO_DIRECTION: Final = 1e-13
"""Relative singular value that counts as zero."""

Order = tuple[tuple[int, int], ...]
"""Pairs (i, j) with c_i ≤ c_j: joint i is at least as stiff as joint j."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds on the compliances [rad/(N·m)]; -inf and inf mean that a compliance has no bound.

    Raises:
        RequestError: if a lower bound is not below its upper bound, or is NaN.
    """

    lower: FloatArray  #: (n,) least compliances
    upper: FloatArray  #: (n,) greatest compliances

    def __post_init__(self) -> None:
        if not (self.lower < self.upper).all():
            raise RequestError(
                "a lower bound is not less than its upper bound",
                where="stiffness_bounds",
                remedy="give the minimum stiffness first, then the maximum",
            )

    @classmethod
    def unconstrained(cls, n: int) -> Bounds:
        """Return bounds of ±∞ for n compliances, so that no compliance is constrained."""
        return cls(np.full(n, -np.inf), np.full(n, np.inf))

    @classmethod
    def positive(cls, n: int) -> Bounds:
        """Return bounds for n compliances that are zero or positive: no joint bends against its load."""
        return cls(np.zeros(n), np.full(n, np.inf))

    def select(self, columns: IndexArray) -> Bounds:
        """Return the bounds of some parameters, given their indices."""
        return Bounds(self.lower[columns], self.upper[columns])

    def in_units(self, unit: FloatArray) -> Bounds:
        """Return the bounds of the scaled variables ``x = c / unit``, for units (n,), or (K, n)."""
        return Bounds(self.lower / unit, self.upper / unit)

    def active_bounds_at(self, x: FloatArray) -> ActiveBounds:
        """Return for each entry of x: -1 if it is at its lower bound, 1 if at its upper bound, else 0."""
        upper_or_free = np.where(x == self.upper, UPPER, FREE)
        return np.where(x == self.lower, LOWER, upper_or_free).astype(np.int8)

    def values_at_bounds(self, active: ActiveBounds) -> FloatArray:
        """Return the value of each parameter that is at a bound, and zero for each free parameter."""
        upper_or_zero = np.where(active == UPPER, self.upper, 0.0)
        return np.where(active == LOWER, self.lower, upper_or_zero)

    def snap(self, x: FloatArray) -> FloatArray:
        """Return x clipped to the bounds; a value within rounding of a bound becomes the bound."""
        x = np.where(x - self.lower <= TOLERANCE, self.lower, x)
        return np.where(self.upper - x <= TOLERANCE, self.upper, x)

    def hold_exactly(self, c: FloatArray, active: ActiveBounds) -> FloatArray:
        """Return compliances that satisfy the bounds exactly, after the rounding of a change of units.

        Args:
            c: (n,) or (K, n) compliances [rad/(N·m)]; NaN remains NaN.
            active: (n,) or (K, n): -1 at the lower bound, 1 at the upper bound, else 0.
        """
        exact = np.where(active == FREE, c, self.values_at_bounds(active))
        return np.clip(exact, self.lower, self.upper)

    def pivot(self, active: ActiveBounds, x: FloatArray, gradient: FloatArray) -> ActiveBounds:
        """Return the active bounds after one round of block principal pivoting.

        Portugal, Júdice & Vicente (1994). A free parameter outside its bounds goes to the bound; a parameter
        at a bound is freed if the sign of its multiplier is wrong. Rounds may cycle; the certificate of the
        outcome then detects the failure.

        Args:
            active: bound at which each parameter is held, or free, before the round.
            x: parameters that are optimal with these active bounds.
            gradient: gradient of the objective at x.
        """
        # The multiplier of an active bound is negative if the objective decreases from the bound inwards.
        wrong_at_lower = (active == LOWER) & (gradient < 0)
        wrong_at_upper = (active == UPPER) & (gradient > 0)
        pivoted = np.where(wrong_at_lower | wrong_at_upper, FREE, active)
        pivoted = np.where(x > self.upper, UPPER, pivoted)
        pivoted = np.where(x < self.lower, LOWER, pivoted)
        return pivoted.astype(np.int8)

    def gradient_violation(self, x: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return by how much each entry of the gradient violates optimality at x; negative for no violation.

        Off the bounds the gradient should vanish. At a lower bound only a negative gradient is a violation,
        at an upper bound only a positive one.
        """
        violation = np.where(x >= self.upper, gradient, np.abs(gradient))
        violation = np.where(x <= self.lower, -gradient, violation)
        return np.asarray(violation, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Inequalities:
    """Linear inequalities ``matrix @ c ≥ least`` in addition to the bounds."""

    matrix: FloatArray  #: (k, n), no row of zeros
    least: FloatArray  #: (k,) right-hand sides


@dataclass(frozen=True, eq=False)
class Constraints:
    """Bounds on the compliances and an order among them.

    The constructor tightens the bounds: ``c_i ≤ c_j`` makes the lower bound of i a lower bound of j, and the
    upper bound of j an upper bound of i. Each bound is then reached by some c within all constraints.

    Raises:
        RequestError: if the order goes round in a circle, or contradicts the bounds.
    """

    bounds: Bounds  #: bounds of the n compliances [rad/(N·m)]
    order: Order = ()  #: pairs (i, j) with c_i ≤ c_j: joint i is at least as stiff as joint j

    def __post_init__(self) -> None:
        """Tighten the bounds by the order, and refuse contradictions."""
        if not self.order:
            return
        is_below = self._implied_order()  # (n, n): whether c_i ≤ c_j follows from the order
        if is_below.diagonal().any():  # c_i ≤ c_i by way of other joints
            raise RequestError(
                "`stiffness_order` contradicts itself: the chains of joints form a cycle",
                where="stiffness_order",
                remedy="name each joint only once in a chain, and remove chains that contradict each other",
            )
        below_or_same = is_below | np.eye(len(is_below), dtype=np.bool_)
        # c_j ≥ c_i ≥ lower_i for all i below j, and c_i ≤ c_j ≤ upper_j for all j above i.
        lower = np.where(below_or_same, self.bounds.lower[:, None], -np.inf).max(axis=0)
        upper = np.where(below_or_same, self.bounds.upper, np.inf).min(axis=1)
        if not (lower < upper).all():
            raise RequestError(
                "the stiffness bounds contradict `stiffness_order`",
                where="stiffness_order",
                remedy="widen the bounds, or omit `stiffness_order`",
            )
        object.__setattr__(self, "bounds", Bounds(lower, upper))  # as the class is frozen

    @property
    def inequalities(self) -> Inequalities | None:
        """The order as inequalities ``c_j − c_i ≥ 0``; None if no order was given."""
        if not self.order:
            return None
        matrix = np.zeros((len(self.order), len(self.bounds.lower)))
        for row, (i, j) in zip(matrix, self.order, strict=True):
            row[i], row[j] = -1.0, 1.0
        return Inequalities(matrix, least=np.zeros(len(matrix)))

    def select(self, columns: IndexArray) -> Constraints:
        """Return the constraints on the joints with indices `columns` (p,), which are ascending.

        The order keeps what it implies for these joints by way of the joints left out.
        """
        if not self.order:
            return Constraints(self.bounds.select(columns))
        is_below = self._implied_order()[np.ix_(columns, columns)]
        follows_from_others = is_below @ is_below  # c_i ≤ c_j follows from c_i ≤ c_k and c_k ≤ c_j
        pairs = np.argwhere(is_below & ~follows_from_others)
        order = tuple((int(i), int(j)) for i, j in pairs)
        return Constraints(self.bounds.select(columns), order)

    def fix_joints(self, joints: IndexArray, compliance: FloatArray, others: IndexArray) -> Constraints:
        """Return the constraints on the other joints when the compliances of some joints are fixed.

        An order between a fixed and another joint becomes a bound of the other joint.

        Args:
            joints: (q,) indices of the fixed joints.
            compliance: (q,) compliances of the fixed joints [rad/(N·m)].
            others: (p,) ascending indices of the other joints.

        Raises:
            RequestError: if no compliance of another joint satisfies all constraints.
        """
        if not self.order:  # no joint limits another one
            return self.select(others)
        is_below = self._implied_order()  # (n, n): whether c_i ≤ c_j follows from the order
        lower, upper = self.bounds.lower.copy(), self.bounds.upper.copy()
        for joint, value in zip(joints.tolist(), compliance.tolist(), strict=True):
            at_least_value = is_below[joint]
            at_most_value = is_below[:, joint]
            lower[at_least_value] = np.maximum(lower[at_least_value], value)
            upper[at_most_value] = np.minimum(upper[at_most_value], value)
        if not (lower[others] < upper[others]).all():
            raise _build_no_wrist_compliance_error()
        return Constraints(Bounds(lower, upper), self.order).select(others)

    def are_satisfied_by(self, compliance: FloatArray) -> BoolArray:
        """Return a mask (...) of compliances (..., n) that satisfy all constraints."""
        is_within_bounds = (self.bounds.lower <= compliance) & (compliance <= self.bounds.upper)
        satisfied = is_within_bounds.all(axis=-1)
        for i, j in self.order:
            satisfied &= compliance[..., i] <= compliance[..., j]
        return np.asarray(satisfied)

    def equalise_tied(self, compliance: FloatArray, tied: BoolArray) -> FloatArray:
        """Return the compliances (n,) with tied pairs made exactly equal: both get the smaller value.

        Args:
            compliance: (n,) compliances; those of tied pairs are equal up to rounding [rad/(N·m)].
            tied: (k,) whether each pair of the order holds with equality, c_i = c_j.
        """
        equalised = compliance.copy()
        tied_pairs = [pair for pair, is_tied in zip(self.order, tied.tolist(), strict=True) if is_tied]
        # Each round carries the least value of a chain of ties at least one tie further.
        for _ in range(len(tied_pairs)):
            for i, j in tied_pairs:
                smaller = min(equalised[i], equalised[j])
                equalised[i] = smaller
                equalised[j] = smaller
        return np.clip(equalised, self.bounds.lower, self.bounds.upper)

    def _implied_order(self) -> BoolArray:
        """Return a table (n, n): whether c_i ≤ c_j follows from the order.

        The table is the transitive closure of the stated pairs, by Warshall's algorithm.
        """
        n = len(self.bounds.lower)
        is_below = np.zeros((n, n), dtype=np.bool_)
        for i, j in self.order:
            is_below[i, j] = True
        if not self.order:
            return is_below
        for k in range(n):
            is_below |= is_below[:, k, None] & is_below[k]  # c_i ≤ c_k and c_k ≤ c_j
        return is_below


def _build_no_wrist_compliance_error() -> RequestError:
    """Build the error for wrist joints that no compliance suits, once those of the arm joints are fixed."""
    return RequestError(
        "the decoupled method fits the arm joints first; with their compliances, no compliance of a "
        "wrist joint satisfies both its bounds and `stiffness_order`",
        where="stiffness_order",
        remedy="use method partial_pose, which fits all joints at once",
    )


@dataclass(frozen=True, eq=False)
class IdentificationProblem:
    """minimise ‖R c − z‖² subject to lower ≤ c ≤ upper, and to linear inequalities if there are any.

    Raises:
        SolverError: if a number is not finite, or a column is zero.
    """

    R: FloatArray  #: (m, n) compressed, weighted regressor; every column has a positive norm
    z: FloatArray  #: (m,) compressed, weighted deflections
    bounds: Bounds  #: bounds of the n compliances
    inequalities: Inequalities | None = None  #: further inequalities, or None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.R).all() and np.isfinite(self.z).all()):
            raise SolverError(
                "the regressor contains numbers that are too large",
                remedy="check the units and the magnitudes of the readings",
            )
        if not (self.column_norms > 0).all():
            raise SolverError("a parameter has no effect on the readings")

    @cached_property
    def column_norms(self) -> FloatArray:
        """Norms (n,) of the columns of R, by which R is scaled to unit columns."""
        largest = np.abs(self.R).max(axis=0, initial=0.0)
        # Divide by the largest entry first: the squares of very small or large entries under- or overflow.
        divisor = np.where(largest > 0, largest, 1.0)
        return np.asarray(np.linalg.norm(self.R / divisor, axis=0) * largest)


@dataclass(frozen=True, eq=False)
class Scaled:
    """minimise ‖A x − b‖² subject to lower ≤ x ≤ upper and B x ≥ d, all rows and columns of unit norm."""

    A: FloatArray  #: (m, n) columns of unit norm
    b: FloatArray  #: (m,) unit norm, or zero
    bounds: Bounds  #: bounds of the n variables
    B: FloatArray  #: (k, n) rows of unit norm; k = 0 without inequalities
    d: FloatArray  #: (k,) right-hand sides of the inequalities
    unit: FloatArray  #: (n,) units of the variables, ``c = unit · x`` [rad/(N·m)]

    @classmethod
    def from_problem(cls, problem: IdentificationProblem) -> Scaled:
        """Return a problem scaled so that the columns of R, each inequality and z have unit norm."""
        rhs_norm = float(np.linalg.norm(problem.z)) or 1.0
        units = rhs_norm / problem.column_norms
        B, d = np.zeros((0, len(units))), np.zeros(0)
        if problem.inequalities is not None:
            B = problem.inequalities.matrix * units
            row_norms = np.linalg.norm(B, axis=1)
            B = B / row_norms[:, None]
            d = problem.inequalities.least / row_norms
        return cls(
            A=problem.R / problem.column_norms,
            b=problem.z / rhs_norm,
            bounds=problem.bounds.in_units(units),
            B=B,
            d=d,
            unit=units,
        )

    @cached_property
    def constraints(self) -> tuple[FloatArray, FloatArray]:
        """All constraints as ``G x ≥ h``: G (k, n), rows of bounds before inequalities, and h (k,)."""
        lower, upper = self.bounds.lower, self.bounds.upper
        has_lower, has_upper = np.isfinite(lower), np.isfinite(upper)
        identity = np.eye(len(lower))
        G = np.vstack([identity[has_lower], -identity[has_upper], self.B])
        h = np.concatenate([lower[has_lower], -upper[has_upper], self.d])
        return G, h

    def gradient(self, x: FloatArray) -> FloatArray:
        """Return ``Aᵀ(A x − b)`` (n,), half the gradient of ‖A x − b‖²."""
        return np.asarray(self.A.T @ (self.A @ x - self.b))

    def find_tight_constraints(self, x: FloatArray, slack: float = TOLERANCE) -> BoolArray:
        """Return a mask (k,) of the constraints ``G x ≥ h`` that hold with equality at a feasible x.

        Args:
            x: (n,) scaled parameters that satisfy the constraints.
            slack: largest ``G x − h`` that counts as equality, relative to max(1, ‖x‖∞).
        """
        G, h = self.constraints
        largest_slack = slack * max(1.0, float(np.abs(x).max()))
        return np.asarray(G @ x - h <= largest_slack)

    def multipliers_at(self, x: FloatArray, slack: float = TOLERANCE) -> FloatArray:
        """Return multipliers μ (k,) ≥ 0 of the constraints ``G x ≥ h`` that best balance the gradient at x.

        They minimise ‖Gᵀ μ − gradient‖ by non-negative least squares. If that does not converge, they are
        zero: the point then gets no certificate, as it should.

        Args:
            x: (n,) a point.
            slack: constraints with more slack, relative to max(1, ‖x‖∞), have the multiplier zero.
        """
        from scipy.optimize import nnls

        G, h = self.constraints
        multipliers = np.zeros(len(h))
        is_tight = self.find_tight_constraints(x, slack)
        if is_tight.any():
            with suppress(RuntimeError):
                multipliers[is_tight], _ = nnls(G[is_tight].T, self.gradient(x))
        return multipliers

    def solve_with_active_bounds(self, active: ActiveBounds, near: FloatArray | None = None) -> FloatArray:
        """Return the least-squares point (n,) with all active variables fixed at their bounds.

        If several points minimise ‖A x − b‖², the minimum nearest to `near` is returned, or the minimum of
        least norm if `near` is None.
        """
        is_free = active == FREE
        x = self.bounds.values_at_bounds(active)
        if near is not None:
            x[is_free] = near[is_free]
        if is_free.any():
            # lstsq returns the shortest step, so that the point is the nearest to the start.
            residual = self.b - self.A @ x
            step, *_ = np.linalg.lstsq(self.A[:, is_free], residual, rcond=_NO_DIRECTION)
            x[is_free] += step
        return x

    def solve_by_pivoting(self, active: ActiveBounds) -> FloatArray:
        """Return the least-squares point (n,) reached by pivoting from given active bounds.

        Each round of pivoting exchanges the bounds that are wrongly active or wrongly inactive. Pivoting ends
        when the active bounds no longer change, or after `MOST_PIVOTS` rounds. The point may not be optimal:
        the caller must check it.
        """
        x = self.solve_with_active_bounds(active)
        for _ in range(MOST_PIVOTS):
            pivoted = self.bounds.pivot(active, x, self.gradient(x))
            if (pivoted == active).all():
                break
            active = pivoted
            x = self.solve_with_active_bounds(active)
        return x

    def solve_on_rows(self, active: BoolArray, near: FloatArray) -> FloatArray:
        """Minimise ‖A x − b‖² with equality ``G_a x = h_a`` in the active rows of the constraints.

        The shortest step to ``G_a x = h_a`` is followed by a least-squares step in the null space of G_a, in
        which G_a x does not change.

        Args:
            active: (k,) whether each row of the constraints holds with equality.
            near: (n,) point; where the optimum is not unique, the optimum nearest to this point is returned.

        Returns:
            The point x (n,).
        """
        G, h = self.constraints
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
            residual = self.b - self.A @ x
            step, *_ = np.linalg.lstsq(self.A @ null_space, residual, rcond=_NO_DIRECTION)
            x = x + null_space @ step
        return np.asarray(x, dtype=np.float64)
