"""Damped Gauss-Newton for small non-linear least squares on a curved space of states.

The state may be anything with a `stepped` function (an axis has no global coordinates); the Jacobian is
taken in the chart at the state itself. At the minimum the linearised fit is kept: it carries
covariance, rank and what each reading does to each unknown. Unknowns that belong to one group of readings
each, such as the angle of one position, are eliminated group by group: their number costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import MeasurementError

State = TypeVar("State")

MOST_STEPS = 60
_MOST_TRIALS = 25
_LEAST_DAMPING, _FACTOR = 1e-12, 10.0
"""Least damping beside the squares of singular values of columns of unit norm; factor from trial to trial."""
_ROUNDING = 2e-16
_EXACT = 1e-8
"""Residual [m rms] that no tracker sees: exact readings of a joint that hardly moved end there slowly."""
_CONVERGED = 1e-9
_RANK_TOLERANCE = 1e-10
"""Singular value of the column-scaled Jacobian, relative to the largest, that counts as zero."""
_UNDETERMINED = 1e-6
"""Share of an unknown in an unobservable direction above which it is not determined."""


@dataclass(frozen=True, eq=False)
class LinearFit:
    """The linearised least squares problem ``min ‖r − J δ‖`` by its singular value decomposition.

    Columns are scaled to unit norm first, so that metres and radians do not decide the rank.
    """

    residual: FloatArray  #: (m,) r
    left: FloatArray  #: (m, k) orthonormal basis U of the range of J, k the rank
    #: (p, k) with δ = inverse Uᵀ r; of minimum norm in scaled unknowns where J is deficient
    inverse: FloatArray
    unseen: FloatArray  #: (p, p - k) orthonormal combinations of scaled unknowns that r does not determine
    scale: FloatArray  #: (p,) norms of the columns of J; 1 for a null column
    #: the unknowns of single groups of readings, if there are any; they are no part of the others
    own: OwnUnknowns | None = None

    @classmethod
    def of(cls, residual: FloatArray, jacobian: FloatArray, by_own: FloatArray | None = None) -> LinearFit:
        """Decompose, by QR first: it is cheaper for many readings.

        Args:
            residual: (m,) whitened.
            jacobian: (m, p) of the prediction, whitened.
            by_own: (G, m / G) derivative of each group of readings by its own unknown, whitened.
        """
        if by_own is not None:
            own = OwnUnknowns.of(residual, jacobian, by_own)
            return replace(cls.of(own.without(residual), own.without(jacobian)), own=own)
        norms = np.linalg.norm(jacobian, axis=0)
        scale = np.where(norms > 0.0, norms, 1.0)
        Q, R = np.linalg.qr(jacobian / scale)
        U, s, Vt = np.linalg.svd(R, full_matrices=False)
        rank = int((s > _RANK_TOLERANCE * s[0]).sum()) if s.size and s[0] > 0.0 else 0
        seen = Vt[:rank].T
        unseen = np.linalg.svd(seen)[0][:, rank:] if rank < len(scale) else np.zeros((rank, 0))
        return cls(residual, Q @ U[:, :rank], seen / s[:rank] / scale[:, None], unseen, scale)

    @property
    def pseudo_inverse(self) -> FloatArray:
        """Derivative (p, m) of the unknowns by the whitened readings."""
        return np.asarray(self.inverse @ self.left.T)

    @property
    def rank(self) -> int:
        """Number of combinations of unknowns that are determined."""
        return int(self.left.shape[1])

    @property
    def unknowns(self) -> int:
        """Number of combinations of all unknowns that are determined, those of single groups included."""
        return self.rank + (0 if self.own is None else self.own.count)

    def step(self, damping: float = 0.0) -> FloatArray:
        """Return the least squares step δ (p,), then that of the groups' own unknowns (G,).

        Args:
            damping: λ of Levenberg's step, beside the squares of the singular values of scaled columns.
        """
        inverse_squares = np.square(self.inverse * self.scale[:, None]).sum(axis=0)
        step = self.inverse @ (self.left.T @ self.residual / (1.0 + damping * inverse_squares))
        return np.asarray(step if self.own is None else np.concatenate([step, self.own.step(step)]))

    @property
    def explained(self) -> float:
        """Norm of the part of the residual that the step would explain."""
        part = float(np.linalg.norm(self.left.T @ self.residual))
        return part if self.own is None else float(np.hypot(part, np.linalg.norm(self.own.along)))

    @property
    def covariance(self) -> FloatArray:
        """(p, p) in units of sigma²; of undetermined unknowns it tells only the determined part."""
        return np.asarray(self.inverse @ self.inverse.T)

    @property
    def determined(self) -> BoolArray:
        """Return which unknowns (p,) the readings determine one by one."""
        share = np.linalg.norm(self.unseen, axis=1) if self.unseen.size else np.zeros(len(self.scale))
        return np.asarray(share < _UNDETERMINED)

    def determines(self, unknowns: slice) -> bool:
        """Return whether all of these unknowns are determined."""
        return bool(self.determined[unknowns].all())


@dataclass(frozen=True, eq=False)
class OwnUnknowns:
    """Unknowns of which each moves the readings of one group only."""

    directions: FloatArray  #: (G, m / G) unit vectors of the readings' derivatives; null where there is none
    norms: FloatArray  #: (G,) norms of these derivatives; 1 for a null one
    along: FloatArray  #: (G,) residual along the directions
    others: FloatArray  #: (G, p) the same part of the derivative by the other unknowns

    @classmethod
    def of(cls, residual: FloatArray, jacobian: FloatArray, by_own: FloatArray) -> OwnUnknowns:
        """Take the derivatives of `LinearFit.of`."""
        norms = np.linalg.norm(by_own, axis=1)
        norms = np.where(norms > 0.0, norms, 1.0)
        directions = by_own / norms[:, None]
        grouped = jacobian.reshape(*by_own.shape, -1)
        along = np.einsum("gi,gi->g", directions, residual.reshape(by_own.shape))
        return cls(directions, norms, along, np.einsum("gi,gip->gp", directions, grouped))

    @property
    def count(self) -> int:
        """Number of unknowns that the readings determine."""
        return int(self.directions.any(axis=1).sum())

    def without(self, rows: FloatArray) -> FloatArray:
        """Project rows (m,) or (m, p) on what the own unknowns do not explain."""
        grouped = rows.reshape(*self.directions.shape, -1)
        along = np.einsum("gi,gip->gp", self.directions, grouped)
        return np.asarray((grouped - self.directions[..., None] * along[:, None]).reshape(rows.shape))

    def step(self, others: FloatArray) -> FloatArray:
        """Their step (G,), beside a step (p,) of the others."""
        return np.asarray((self.along - self.others @ others) / self.norms)


def minimise(
    state: State,
    residual: Callable[[State], FloatArray],
    jacobian: Callable[[State], FloatArray],
    stepped: Callable[[State, FloatArray], State],
    *,
    where: str,
    by_own: Callable[[State], FloatArray] | None = None,
    size: float = 0.0,
    enough: float = 0.0,
) -> tuple[State, LinearFit]:
    """Minimise ``‖residual(state)‖²``, damping steps that go too far (Levenberg and Marquardt).

    It ends where a step would change the prediction by less than 1e-9 of the residual, or than rounding, or
    where rounding lets no step lower the residual any more.

    Args:
        state: to start from.
        residual: whitened readings minus prediction (m,).
        jacobian: derivative of the prediction (m, p) in the chart at the state.
        stepped: the state after a step (p,), with `by_own` (p + G,).
        where: for the message.
        by_own: derivative (G, m / G) of each group of readings by its own unknown, if there are such.
        size: norm of the whitened readings, whose rounding no fit explains.
        enough: residual [rms] below which a fit that goes on slowly has converged.

    Raises:
        MeasurementError: no convergence.
    """
    r = residual(state)
    for _ in range(MOST_STEPS):
        linear = LinearFit.of(r, jacobian(state), None if by_own is None else by_own(state))
        if linear.explained <= max(_CONVERGED * float(np.linalg.norm(r)), _ROUNDING * size):
            return state, linear
        damping = 0.0
        for _ in range(_MOST_TRIALS):
            trial = stepped(state, linear.step(damping))
            shorter = residual(trial)
            if shorter @ shorter < r @ r:
                break
            damping = max(_LEAST_DAMPING, _FACTOR * damping)
        else:
            return state, linear
        state, r = trial, shorter
    rms = float(np.sqrt(np.mean(r**2)))
    if rms < max(_EXACT, enough):
        return state, linear
    raise MeasurementError(
        f"the fit did not converge in {MOST_STEPS} steps; the residual is {rms:.2g} m rms",
        where=where,
        remedy="check the unit and the sign of the angles, the joint map, and the order of the rows",
    )
