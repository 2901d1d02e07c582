"""Constraints on the compliances: bounds, and order ("joint i is at least as stiff as joint j")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.problem import Bounds, Inequalities
from jointstiff.solver.errors import RequestError

JointIndices = IndexArray
Order = tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class Constraints:
    """Bounds on the compliances and an order among them.

    The bounds of what is constructed are tight: each is reached by some c that satisfies all constraints,
    as ``c_i ≤ c_j`` hands the lower bound of i on to j, and the upper one of j to i.

    Raises:
        RequestError: if the order goes round in a circle, or contradicts the bounds.
    """

    bounds: Bounds  #: bounds of the n compliances [rad/(N·m)]
    order: Order = ()  #: pairs (i, j) with c_i ≤ c_j: joint i is at least as stiff as joint j

    def __post_init__(self) -> None:
        if not self.order:
            return
        below = self._below()
        if below.diagonal().any():
            raise RequestError(
                "`stiffness_order` contradicts itself: the chains of joints form a cycle",
                where="stiffness_order",
                remedy="name each joint once per chain, and let no two chains contradict each other",
            )
        before = below | np.eye(len(below), dtype=np.bool_)
        lower = np.where(before, self.bounds.lower[:, None], -np.inf).max(axis=0)
        upper = np.where(before, self.bounds.upper, np.inf).min(axis=1)
        if not (lower < upper).all():
            raise RequestError(
                "the stiffness bounds contradict `stiffness_order`",
                where="stiffness_order",
                remedy="widen the bounds, or omit `stiffness_order`",
            )
        object.__setattr__(self, "bounds", Bounds(lower, upper))

    @property
    def inequalities(self) -> Inequalities | None:
        """The order as rows ``c_j − c_i ≥ 0``; None if there is none."""
        if not self.order:
            return None
        pairs = np.array(self.order)
        identity = np.eye(len(self.bounds.lower))
        return Inequalities(identity[pairs[:, 1]] - identity[pairs[:, 0]], np.zeros(len(pairs)))

    def select(self, columns: JointIndices) -> Constraints:
        """Return the constraints on some joints while the others are free.

        Args:
            columns: (p,) ascending.
        """
        bounds = self.bounds.select(columns)
        if not self.order:
            return Constraints(bounds)
        below = self._below()[np.ix_(columns, columns)]
        below &= ~(below @ below)  # what follows from others is left out
        return Constraints(bounds, tuple((int(i), int(j)) for i, j in np.argwhere(below)))

    def given(self, joints: JointIndices, compliance: FloatArray, others: JointIndices) -> Constraints:
        """Return the constraints on other joints once some are known: the order becomes a bound.

        Args:
            joints: (q,) that are known.
            compliance: (q,) of these joints [rad/(N·m)].
            others: (p,) ascending.

        Raises:
            RequestError: if the known joints leave another no room.
        """
        if not self.order:
            return self.select(others)
        below = self._below()
        lower, upper = self.bounds.lower.copy(), self.bounds.upper.copy()
        for joint, value in zip(joints.tolist(), compliance.tolist(), strict=True):
            lower[below[joint]] = np.maximum(lower[below[joint]], value)
            upper[below[:, joint]] = np.minimum(upper[below[:, joint]], value)
        if not (lower[others] < upper[others]).all():
            raise RequestError(
                "the decoupled method fits the arm first, which leaves no feasible compliance for a wrist "
                "joint between its bounds and the order",
                where="stiffness_order",
                remedy="use method partial_pose, which fits all joints at once",
            )
        return Constraints(Bounds(lower, upper), self.order).select(others)

    def hold(self, compliance: FloatArray) -> BoolArray:
        """Return whether compliances (..., n) satisfy them all: (...)."""
        inside = ((self.bounds.lower <= compliance) & (compliance <= self.bounds.upper)).all(axis=-1)
        for i, j in self.order:
            inside &= compliance[..., i] <= compliance[..., j]
        return np.asarray(inside)

    def level(self, compliance: FloatArray, tied: BoolArray) -> FloatArray:
        """Make the compliances of tied pairs equal to the last digit.

        Args:
            compliance: (n,) in which they are equal up to rounding [rad/(N·m)].
            tied: (k,) which pairs of the order are.
        """
        value = compliance.copy()
        pairs = [pair for pair, equal in zip(self.order, tied.tolist(), strict=True) if equal]
        for _ in pairs:  # the least value reaches all that are tied to it in as many rounds as there are ties
            for i, j in pairs:
                value[i] = value[j] = min(value[i], value[j])
        return np.clip(value, self.bounds.lower, self.bounds.upper)

    def _below(self) -> BoolArray:
        """(n, n) whether c_i ≤ c_j follows from the order."""
        n = len(self.bounds.lower)
        below = np.zeros((n, n), dtype=np.bool_)
        for i, j in self.order:
            below[i, j] = True
        for k in range(n):
            below |= below[:, k, None] & below[k]
        return below
