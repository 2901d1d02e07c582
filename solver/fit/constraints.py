"""Constraints on compliances: bounds, and an order of the joints by their stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import ActiveBounds, BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError

FREE, LOWER, UPPER = 0, -1, 1

TOLERANCE: Final = 1e-12
"""Largest violation of an optimality condition, in equilibrated variables, that counts as rounding."""

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
