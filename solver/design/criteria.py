"""Criteria of a design: how much a set of readings says, as one number (method.md §10).

Each criterion is an *information* φ(M), concave and homogeneous of degree 1 in the information matrix M.
Hence any supporting matrix G ⪰ 0 bounds it everywhere, ``φ(M′) ≤ ⟨G, M′⟩``, and what any design reaches:

| criterion | φ(M) | G |
|---|---|---|
| D | det(C)^(1/s), C = (Lᵀ M⁻¹ L)⁻¹ | φ/s · M⁻¹ L C Lᵀ M⁻¹ |
| A, I | 1 / tr(W M⁻¹) | φ² · M⁻¹ W M⁻¹ |
| E | λ_min(V C V) | X V Z V Xᵀ, X = M⁻¹ L C, Z ⪰ 0, tr Z = 1 |
| G | 1 / max_r tr(W_r M⁻¹) | that of I for W = Σ π_r W_r, Σ π = 1 |

L selects the s parameters of interest, which are the first; the others are a nuisance. Each class has

* ``information(M)``, φ(M), zero where M is singular;
* ``support(M, dual)``, G at a positive definite M. For E the dual is Z, for G it is π; it is brought to what
  the proof asks of it, so that any is valid;
* ``scaled(unit)``, the same criterion of parameters measured in other units, M → diag(u) M diag(u);
* if Newton's method takes it, ``slope(M, K)``, −log φ at M with its derivatives along K (k, p, p).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from jointstiff.solver.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Slope:
    """Value and derivatives of −log φ along the weights of k atoms."""

    value: float  #: −log φ; inf where M is singular
    gradient: FloatArray  #: (k,)
    hessian: FloatArray  #: (k, k), positive semidefinite


@dataclass(frozen=True)
class DOptimality:
    """Volume of the uncertainty ellipsoid of the first parameters."""

    interest: int  #: s, how many

    def information(self, M: FloatArray) -> float:
        """Return det(C)^(1/s)."""
        value = -_log_det(M) + _log_det(M[self.interest :, self.interest :])
        return float(np.exp(-value / self.interest)) if np.isfinite(value) else 0.0

    def support(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:  # noqa: ARG002
        """Return φ/s · (M⁻¹ − M₂₂⁻¹)."""
        s = self.interest
        G = np.linalg.inv(M)
        G[s:, s:] -= np.linalg.inv(M[s:, s:])
        G = 0.5 * (G + G.T)
        return self.information(M) / s * G

    def slope(self, M: FloatArray, K: FloatArray) -> Slope:
        """Return −log det(C)/s with its derivatives."""
        s = self.interest
        value, gradient, hessian = _log_det_slope(M, K)
        rest, its_gradient, its_hessian = _log_det_slope(M[s:, s:], K[:, s:, s:])
        return Slope(-(value - rest) / s, -(gradient - its_gradient) / s, (hessian - its_hessian) / s)

    def scaled(self, unit: FloatArray) -> DOptimality:  # noqa: ARG002
        """Return the same: units change φ by a factor."""
        return self


@dataclass(frozen=True, eq=False)
class AOptimality:
    """Weighted mean of the variances.

    With W = diag(1/c²) it is that of the relative variances, with W the mean of AᵀA over places that of the
    variance of a predicted deflection (I-optimality).
    """

    W: FloatArray  #: (p, p) positive semidefinite

    def information(self, M: FloatArray) -> float:
        """Return 1 / tr(W M⁻¹)."""
        return 1.0 / float((self.W * np.linalg.inv(M)).sum()) if np.isfinite(_log_det(M)) else 0.0

    def support(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:  # noqa: ARG002
        """Return φ² · M⁻¹ W M⁻¹."""
        inverse = np.linalg.inv(M)
        G = inverse @ self.W @ inverse / float((self.W * inverse).sum()) ** 2
        return 0.5 * (G + G.T)

    def slope(self, M: FloatArray, K: FloatArray) -> Slope:
        """Return log tr(W M⁻¹) with its derivatives."""
        k = len(K)
        if not np.isfinite(_log_det(M)):
            return Slope(np.inf, np.zeros(k), np.zeros((k, k)))
        inverse = np.linalg.inv(M)
        S = inverse @ self.W @ inverse
        trace = float((self.W * inverse).sum())
        gradient = -(K.reshape(k, -1) @ S.ravel()) / trace
        second = (S @ K).transpose(0, 2, 1).reshape(k, -1) @ (K @ inverse).transpose(0, 2, 1).reshape(k, -1).T
        # tr(S K_i M⁻¹ K_j), symmetrised
        hessian = (second + second.T) / trace - np.outer(gradient, gradient)
        return Slope(float(np.log(trace)), gradient, hessian)

    def scaled(self, unit: FloatArray) -> AOptimality:
        """Return the same criterion in other units."""
        return AOptimality(self.W * np.outer(unit, unit))


@dataclass(frozen=True, eq=False)
class EOptimality:
    """Worst combination of the first parameters."""

    #: (s,) V, by which C is multiplied on both sides, as the criterion depends on the units
    metric: FloatArray

    def information(self, M: FloatArray) -> float:
        """Return λ_min(V C V)."""
        if not np.isfinite(_log_det(M)):
            return 0.0
        s = len(self.metric)
        covariance = np.linalg.inv(M)[:s, :s] / np.outer(self.metric, self.metric)
        return 1.0 / float(np.linalg.eigvalsh(covariance)[-1])

    def support(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:
        """Return X V Z V Xᵀ; without Z that of the worst combination."""
        s = len(self.metric)
        inverse = np.linalg.inv(M)[:, :s]
        covariance = inverse[:s] / np.outer(self.metric, self.metric)
        if dual is None:
            worst = np.linalg.eigh(covariance)[1][:, -1]
            dual = np.outer(worst, worst)
        values, vectors = np.linalg.eigh(0.5 * (dual + dual.T))
        values = np.maximum(values, 0.0)
        Z = (vectors * (values / values.sum())) @ vectors.T
        X = inverse / self.metric @ np.linalg.inv(covariance)
        G: FloatArray = X @ Z @ X.T
        return 0.5 * (G + G.T)

    def scaled(self, unit: FloatArray) -> EOptimality:
        """Return the same criterion in other units."""
        return EOptimality(self.metric / unit[: len(self.metric)])


@dataclass(frozen=True, eq=False)
class GOptimality:
    """Variance at the worst place."""

    places: FloatArray  #: (R, p, p) W_r of each place, positive semidefinite

    def information(self, M: FloatArray) -> float:
        """Return 1 / max_r tr(W_r M⁻¹)."""
        return 1.0 / float(self.variances(M).max()) if np.isfinite(_log_det(M)) else 0.0

    def variances(self, M: FloatArray) -> FloatArray:
        """Return tr(W_r M⁻¹) of each place (R,)."""
        return np.asarray(np.einsum("rij,ij->r", self.places, np.linalg.inv(M)))

    def mean(self, shares: FloatArray) -> AOptimality:
        """Return the criterion of the mean variance, places weighted by shares (R,)."""
        return AOptimality(np.tensordot(shares, self.places, axes=1))

    def support(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:
        """Return that of the mean variance with weights π; without π that of the worst place."""
        if dual is None:
            dual = np.zeros(len(self.places))
            dual[int(np.argmax(self.variances(M)))] = 1.0
        weights = np.maximum(dual, 0.0)
        return self.mean(weights / weights.sum()).support(M)

    def scaled(self, unit: FloatArray) -> GOptimality:
        """Return the same criterion in other units."""
        return GOptimality(self.places * np.outer(unit, unit))


SmoothCriterion: TypeAlias = DOptimality | AOptimality
Criterion: TypeAlias = SmoothCriterion | EOptimality | GOptimality


def uncertainty_of(M: FloatArray, s: int) -> FloatArray:
    """Return the standard uncertainties of the first parameters; inf where M does not determine them.

    Args:
        M: (..., p, p) information.
        s: how many.

    Returns:
        (..., s).
    """
    diagonal = np.diagonal(M, axis1=-2, axis2=-1)
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(M * (unit[..., :, None] * unit[..., None, :]))
    null = values <= 1e-12 * np.maximum(values[..., -1:], 1e-300)
    squares = np.square(vectors[..., :s, :])
    free = (squares * null[..., None, :]).sum(axis=-1) > 1e-9
    variance = (squares @ (1.0 / np.where(null, np.inf, values))[..., None])[..., 0]
    return np.where(free, np.inf, unit[..., :s] * np.sqrt(variance))


def _log_det(M: FloatArray) -> float:
    """Return log det M; −inf where M is not positive definite."""
    try:
        return 2.0 * float(np.log(np.linalg.cholesky(M).diagonal()).sum())
    except np.linalg.LinAlgError:
        return -np.inf


def _log_det_slope(M: FloatArray, K: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Return log det M, its gradient (k,), and minus its Hessian (k, k), along K (k, p, p)."""
    k, value = len(K), _log_det(M)
    if not np.isfinite(value):
        return value, np.zeros(k), np.zeros((k, k))
    X = np.linalg.inv(M) @ K
    flat = X.reshape(k, X.shape[1] ** 2)
    return value, np.einsum("kii->k", X), flat @ X.transpose(0, 2, 1).reshape(flat.shape).T
