"""Identification problems as data: bounds, an order of the compliances, and equilibrated least squares."""

from __future__ import annotations

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
        return np.where(x == self.lower, LOWER, np.where(x == self.upper, UPPER, FREE)).astype(np.int8)

    def values_at_bounds(self, active: ActiveBounds) -> FloatArray:
        """Return the value of each parameter that is at a bound, and zero for each free parameter."""
        return np.where(active == LOWER, self.lower, np.where(active == UPPER, self.upper, 0.0))

    def snap(self, x: FloatArray) -> FloatArray:
        """Return x clipped to the bounds; a value within rounding of a bound becomes the bound."""
        x = np.where(x - self.lower <= TOLERANCE, self.lower, x)
        return np.where(self.upper - x <= TOLERANCE, self.upper, x)

    def hold_exactly(self, c: FloatArray, active: ActiveBounds) -> FloatArray:
        """Return compliances that satisfy the bounds exactly, after the rounding of a change of units.

        Args:
            c: (n,) or (K, n) compliances [rad/(N·m)]; NaN stays NaN.
            active: (n,) or (K, n): -1 at the lower bound, 1 at the upper bound, else 0.
        """
        return np.clip(np.where(active == FREE, c, self.values_at_bounds(active)), self.lower, self.upper)

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
        # The multiplier of a free parameter is set to 1, so that the parameter stays free.
        multiplier = np.where(active == LOWER, gradient, np.where(active == UPPER, -gradient, 1.0))
        after_freeing = np.where(multiplier < 0, FREE, active)
        return np.where(x < self.lower, LOWER, np.where(x > self.upper, UPPER, after_freeing)).astype(np.int8)

    def gradient_violation(self, x: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return by how much each entry of the gradient violates optimality at x; negative for no violation.

        Off the bounds the gradient should vanish; at a bound only the wrong sign is a violation.
        """
        at_upper_or_free = np.where(x >= self.upper, gradient, np.abs(gradient))
        return np.asarray(np.where(x <= self.lower, -gradient, at_upper_or_free), dtype=np.float64)


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
        if not self.order:
            return
        below = self._implied_order()  # (n, n) table: true where c_i ≤ c_j
        if below.diagonal().any():
            raise RequestError(
                "`stiffness_order` contradicts itself: the chains of joints form a cycle",
                where="stiffness_order",
                remedy="name each joint only once in a chain, and remove chains that contradict each other",
            )
        below_or_same = below | np.eye(len(below), dtype=np.bool_)
        lower = np.where(below_or_same, self.bounds.lower[:, None], -np.inf).max(axis=0)
        upper = np.where(below_or_same, self.bounds.upper, np.inf).min(axis=1)
        if not (lower < upper).all():
            raise RequestError(
                "the stiffness bounds contradict `stiffness_order`",
                where="stiffness_order",
                remedy="widen the bounds, or omit `stiffness_order`",
            )
        object.__setattr__(self, "bounds", Bounds(lower, upper))

    @property
    def inequalities(self) -> Inequalities | None:
        """The order as inequalities ``c_j − c_i ≥ 0``; None if no order was given."""
        if not self.order:
            return None
        pairs = np.array(self.order)
        identity = np.eye(len(self.bounds.lower))
        return Inequalities(identity[pairs[:, 1]] - identity[pairs[:, 0]], np.zeros(len(pairs)))

    def select(self, columns: IndexArray) -> Constraints:
        """Return the constraints on the joints with indices `columns` (p,), which are ascending."""
        is_below = self._implied_order()[np.ix_(columns, columns)]
        is_below &= ~(is_below @ is_below)  # drop pairs that follow from two other pairs (i, k) and (k, j)
        order = tuple((int(lower), int(upper)) for lower, upper in np.argwhere(is_below))
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
        is_below = self._implied_order()
        lower, upper = self.bounds.lower.copy(), self.bounds.upper.copy()
        for joint, value in zip(joints.tolist(), compliance.tolist(), strict=True):
            lower[is_below[joint]] = np.maximum(lower[is_below[joint]], value)
            upper[is_below[:, joint]] = np.minimum(upper[is_below[:, joint]], value)
        if not (lower[others] < upper[others]).all():
            raise RequestError(
                "the decoupled method fits the arm joints first; with their compliances, no compliance of a "
                "wrist joint satisfies both its bounds and `stiffness_order`",
                where="stiffness_order",
                remedy="use method partial_pose, which fits all joints at once",
            )
        return Constraints(Bounds(lower, upper), self.order).select(others)

    def are_satisfied_by(self, compliance: FloatArray) -> BoolArray:
        """Return a mask (...) of compliances (..., n) that satisfy all constraints."""
        inside = ((self.bounds.lower <= compliance) & (compliance <= self.bounds.upper)).all(axis=-1)
        for i, j in self.order:
            inside &= compliance[..., i] <= compliance[..., j]
        return np.asarray(inside)

    def equalise_tied(self, compliance: FloatArray, tied: BoolArray) -> FloatArray:
        """Return the compliances (n,) with tied pairs made exactly equal.

        Args:
            compliance: (n,) compliances; those of tied pairs are equal up to rounding [rad/(N·m)].
            tied: (k,) whether the joints of each pair of the order are tied to equality.
        """
        value = compliance.copy()
        pairs = [pair for pair, equal in zip(self.order, tied.tolist(), strict=True) if equal]
        for _ in pairs:  # each round carries the least value of a chain of ties at least one tie further
            for i, j in pairs:
                value[i] = value[j] = min(value[i], value[j])
        return np.clip(value, self.bounds.lower, self.bounds.upper)

    def _implied_order(self) -> BoolArray:
        """Return a table (n, n): whether c_i ≤ c_j follows from the order (its transitive closure)."""
        n = len(self.bounds.lower)
        below = np.zeros((n, n), dtype=np.bool_)
        for i, j in self.order:
            below[i, j] = True
        for k in range(n if self.order else 0):
            below |= below[:, k, None] & below[k]
        return below


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
            norms = np.linalg.norm(B, axis=1)
            B, d = B / norms[:, None], problem.inequalities.least / norms
        return cls(
            problem.R / problem.column_norms,
            problem.z / rhs_norm,
            problem.bounds.in_units(units),
            B,
            d,
            units,
        )

    @cached_property
    def constraints(self) -> tuple[FloatArray, FloatArray]:
        """All constraints as ``G x ≥ h``: G (k, n), rows of bounds before inequalities, and h (k,)."""
        lower, upper = self.bounds.lower, self.bounds.upper
        has_lower, has_upper = np.isfinite(lower), np.isfinite(upper)
        identity = np.eye(len(lower))
        return (
            np.vstack([identity[has_lower], -identity[has_upper], self.B]),
            np.concatenate([lower[has_lower], -upper[has_upper], self.d]),
        )

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
        return np.asarray(G @ x - h <= slack * max(1.0, float(np.abs(x).max())))

    def multipliers_at(self, x: FloatArray, slack: float = TOLERANCE) -> FloatArray:
        """Return the multipliers (k,) ≥ 0 of the constraints that best balance the gradient at x.

        Args:
            x: (n,) a point.
            slack: rows with more slack than this, relative to the variables, have multiplier zero.
        """
        from scipy.optimize import nnls

        G, h = self.constraints
        multipliers = np.zeros(len(h))
        tight = self.find_tight_constraints(x, slack)
        if tight.any():
            try:
                multipliers[tight] = nnls(G[tight].T, self.gradient(x))[0]
            except RuntimeError:  # no convergence: zero multipliers make the certificate fail, as it should
                return multipliers
        return multipliers

    def solve_with_active_bounds(self, active: ActiveBounds, near: FloatArray | None = None) -> FloatArray:
        """Return the least-squares point (n,) with all active variables fixed at their bounds.

        If several points minimise ‖A x − b‖², the minimum nearest to `near` is returned, or the minimum of
        least norm if `near` is None.
        """
        free = active == FREE
        x = self.bounds.values_at_bounds(active)
        if near is not None:
            x[free] = near[free]
        if free.any():
            rhs = self.b - self.A @ x
            x[free] += np.linalg.lstsq(self.A[:, free], rhs, rcond=_NO_DIRECTION)[0]
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
        """Return the least-squares point (n,) at which the active rows of the constraints hold with equality.

        Args:
            active: (k,) whether each row holds with equality.
            near: (n,) point; where the optimum is not unique, the optimum nearest to this point is returned.
        """
        G, h = self.constraints
        rows, values = G[active], h[active]
        x = near
        free_directions = np.eye(len(x))  # directions in which the active rows do not change
        if len(rows):
            U, singular_values, Vt = np.linalg.svd(rows, full_matrices=True)
            rank = int((singular_values > _NO_DIRECTION * singular_values[0]).sum())
            x = x + Vt[:rank].T @ ((U[:, :rank].T @ (values - rows @ x)) / singular_values[:rank])
            free_directions = Vt[rank:].T
        # Two steps: nearly parallel rows may have moved x far away; the second step removes the rounding
        # error of the first step.
        for _ in range(2 if free_directions.shape[1] else 0):
            step = np.linalg.lstsq(self.A @ free_directions, self.b - self.A @ x, rcond=_NO_DIRECTION)[0]
            x = x + free_directions @ step
        return np.asarray(x, dtype=np.float64)
