"""Optimal weights of candidate readings, and proof of what they reach (method.md §10).

    maximise φ(M0 + n Σ w_i K_i)  subject to  Σ w_i = 1,  w_i ≥ 0

The weights of a few active candidates are optimised. One sweep computes the prices of all candidates; those
of the greatest prices become active, and active candidates of weight zero are dropped. The same sweep bounds
what any weights can reach, and so ends the search.

Candidate i is a posture with its load; reading it adds ``K_i = A_iᵀ Σ⁻¹ A_i``, p × p. Where a force may act
in any direction, A_i is linear in the force, ``A_i(F) = Σ_a F_a A_ia``, and so the price of the candidate,
``⟨G, K_i(F)⟩``, is a quadratic form of F: its greatest value over all directions is the greatest eigenvalue
of a 3 × 3 matrix.

Criteria say how much a set of readings tells, as one number.

Each criterion is an *information* φ(M), concave and homogeneous of degree 1 in the information matrix M.
Hence any supergradient G ⪰ 0 bounds it everywhere, ``φ(M′) ≤ ⟨G, M′⟩``, and what any design reaches:

| criterion | φ(M) | G |
|---|---|---|
| D | det(C)^(1/s), C = (Lᵀ M⁻¹ L)⁻¹ | φ/s · M⁻¹ L C Lᵀ M⁻¹ |
| A, I | 1 / tr(W M⁻¹) | φ² · M⁻¹ W M⁻¹ |
| E | λ_min(V C V) | X V Z V Xᵀ, X = M⁻¹ L C, Z ⪰ 0, tr Z = 1 |
| G | 1 / max_r tr(W_r M⁻¹) | that of I for W = Σ π_r W_r, Σ π = 1 |

L selects the s parameters of interest, which are the first; the others are a nuisance. Each class has

* ``information(M)``, φ(M) (...) of matrices (..., p, p), zero where M is singular;
* ``supergradient(M, dual)``, G at a positive definite M. For E the dual is Z, for G it is π; any dual is
  valid, as it is first made positive with trace (or sum) 1;
* ``scaled(unit)``, the same criterion of parameters measured in other units, M → diag(u) M diag(u);
* if the criterion is smooth (D, A, I), for Newton's method ``slope(M, K)``, −log φ at M with its derivatives
  along K (k, p, p).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from scipy.optimize import LinearConstraint, minimize, nnls

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, greatest_eigenvalue
from jointstiff.solver.errors import RequestError, SolverError


class Slope(NamedTuple):
    """Value of −log φ, and its derivatives with respect to the weights of k candidates."""

    value: float  #: −log φ; inf where M is singular
    gradient: FloatArray  #: (k,)
    hessian: FloatArray  #: (k, k), positive semidefinite


@dataclass(frozen=True)
class DOptimality:
    """D-optimality: volume of the uncertainty ellipsoid of the first s parameters."""

    interest_count: int  #: number s of the parameters of interest

    def information(self, M: FloatArray) -> FloatArray:
        """Return the information φ = det(C)^(1/s) (...) of matrices M (..., p, p); zero where M is singular.

        C is the inverse of the covariance (s, s) of the s parameters of interest, which come first in M.
        """
        # det(C) is the determinant of M over that of the block of the other (nuisance) parameters.
        s = self.interest_count
        nuisance_log_det = _log_det(M[..., s:, s:])
        regular = np.isfinite(nuisance_log_det)
        return np.asarray(regular * np.exp((_log_det(M) - np.where(regular, nuisance_log_det, 0.0)) / s))

    def supergradient(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:  # noqa: ARG002
        """Return the supergradient G = φ/s · (M⁻¹ − M₂₂⁻¹) at M, with φ(M′) ≤ ⟨G, M′⟩ for all M′.

        φ is the criterion, `information`; s is the number of parameters of interest; ⟨G, M⟩ = tr(GᵀM).
        M₂₂ is the block of the nuisance parameters; M₂₂⁻¹ is padded with zeros to (p, p). `dual` is ignored,
        as the criterion is smooth.
        """
        s = self.interest_count
        G = np.linalg.inv(M)
        G[s:, s:] -= np.linalg.inv(M[s:, s:])
        G = 0.5 * (G + G.T)
        return self.information(M) / s * G

    def slope(self, M: FloatArray, K: FloatArray) -> Slope:
        """Return −log φ = −log det(C)/s at M (p, p), and its derivatives along each of K (k, p, p).

        C is the inverse of the covariance of the s parameters of interest.
        """
        s = self.interest_count
        value, gradient, curvature = _log_det_slope(M, K)
        # log det C is log det M minus log det of the block 22 of the nuisance parameters.
        value_22, gradient_22, curvature_22 = _log_det_slope(M[s:, s:], K[:, s:, s:])
        return Slope(-(value - value_22) / s, -(gradient - gradient_22) / s, (curvature - curvature_22) / s)

    def scaled(self, unit: FloatArray) -> DOptimality:  # noqa: ARG002
        """Return this criterion unchanged: other units of the parameters only multiply φ by a factor.

        `unit` (p,), the size of each new unit measured in the old unit, is ignored.
        """
        return self


@dataclass(frozen=True, eq=False)
class AOptimality:
    """A-optimality: weighted mean tr(W M⁻¹) of the variances.

    With W = diag(1/c²) these are relative variances of compliances. With W the mean of AᵀA over places it is
    the variance of a predicted deflection (I-optimality).
    """

    W: FloatArray  #: (p, p) positive semidefinite

    def information(self, M: FloatArray) -> FloatArray:
        """Return the information 1 / tr(W M⁻¹) (...) of matrices M (..., p, p); zero where M is singular.

        W (p, p) weights the covariance M⁻¹ of the parameters.
        """
        inverse, regular = _invert_regular(M)
        return np.asarray(regular / (self.W * inverse).sum(axis=(-2, -1)))

    def supergradient(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:  # noqa: ARG002
        """Return the supergradient G = φ² · M⁻¹ W M⁻¹ at M, with φ(M′) ≤ ⟨G, M′⟩ for all M′.

        φ is the criterion, `information`, and ⟨G, M⟩ = tr(GᵀM). `dual` is ignored, as φ is smooth.
        """
        inverse = np.linalg.inv(M)
        G = inverse @ self.W @ inverse / float((self.W * inverse).sum()) ** 2
        return 0.5 * (G + G.T)

    def slope(self, M: FloatArray, K: FloatArray) -> Slope:
        """Return −log φ = log tr(W M⁻¹) at M (p, p), and its derivatives along each of K (k, p, p).

        W (p, p) weights the covariance M⁻¹ of the parameters.
        """
        count = len(K)
        if not np.isfinite(_log_det(M)):
            return Slope(np.inf, np.zeros(count), np.zeros((count, count)))
        inverse = np.linalg.inv(M)
        S = inverse @ self.W @ inverse
        trace = float((self.W * inverse).sum())
        gradient = -(K.reshape(count, -1) @ S.ravel()) / trace
        # Second derivatives are tr(S K_i M⁻¹ K_j), made symmetric in i and j below.
        mixed_traces = (S @ K).transpose(0, 2, 1).reshape(count, -1) @ (K @ inverse).transpose(
            0, 2, 1
        ).reshape(count, -1).T
        hessian = (mixed_traces + mixed_traces.T) / trace - np.outer(gradient, gradient)
        return Slope(float(np.log(trace)), gradient, hessian)

    def scaled(self, unit: FloatArray) -> AOptimality:
        """Return the same criterion for parameters measured in other units.

        `unit` (p,) is the size of each new unit, measured in the old unit of the parameter.
        """
        return AOptimality(self.W * np.outer(unit, unit))


@dataclass(frozen=True, eq=False)
class EOptimality:
    """E-optimality: greatest variance of any combination of the first s parameters."""

    #: (s,) diagonal of V in V C V: scales of the parameters, as the criterion depends on their units
    metric: FloatArray

    def information(self, M: FloatArray) -> FloatArray:
        """Return the information φ (...) of matrices M (..., p, p); zero where M is singular.

        φ is one over the greatest eigenvalue of the covariance of the first s parameters, in units of
        `metric`.
        """
        s = len(self.metric)
        inverse, regular = _invert_regular(M)
        covariance = inverse[..., :s, :s] / np.outer(self.metric, self.metric)
        return np.asarray(regular / np.linalg.eigvalsh(covariance)[..., -1])

    def supergradient(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:
        """Return the supergradient G = X V Z V Xᵀ at M, with φ(M′) ≤ ⟨G, M′⟩ for all M′.

        X = M⁻¹ L C: L (p, s) selects the first s parameters, C is the inverse of their covariance. V is the
        diagonal matrix of `metric`. Z is the dual (s, s), made positive semidefinite with trace 1. Without a
        dual, Z = v vᵀ with v the unit vector of the combination of parameters that has the greatest variance.
        """
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
        """Return the same criterion for parameters measured in other units.

        `unit` (p,) is the size of each new unit, measured in the old unit of the parameter.
        """
        return EOptimality(self.metric / unit[: len(self.metric)])


@dataclass(frozen=True, eq=False)
class GOptimality:
    """G-optimality: greatest variance of the deflection among the places of a work area."""

    places: FloatArray  #: (R, p, p) W_r of each place, positive semidefinite

    def information(self, M: FloatArray) -> FloatArray:
        """Return the information 1 / max_r tr(W_r M⁻¹) (...) of M (..., p, p); zero where M is singular.

        tr(W_r M⁻¹) is the variance of the deflection at place r, with M⁻¹ the covariance of the parameters.
        """
        inverse, is_regular = _invert_regular(M)
        return np.asarray(is_regular / np.einsum("rij,...ij->...r", self.places, inverse).max(axis=-1))

    def variances(self, M: FloatArray) -> FloatArray:
        """Return the variances tr(W_r M⁻¹) (R,) of the deflections at the R places of the criterion.

        M (p, p) is the information matrix of the parameters, so M⁻¹ is their covariance.
        """
        return np.asarray(np.einsum("rij,ij->r", self.places, np.linalg.inv(M)))

    def build_mean_criterion(self, shares: FloatArray) -> AOptimality:
        """Return the criterion of the mean variance over the places, weighted with shares (R,)."""
        return AOptimality(np.tensordot(shares, self.places, axes=1))

    def supergradient(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:
        """Return the supergradient G at M, with φ(M′) ≤ ⟨G, M′⟩ for all M′.

        G is the supergradient of the mean-variance criterion, in which place r has the share π_r. The dual
        is π (R,), scaled to sum 1; without a dual, the worst place has the share 1.
        """
        if dual is None:
            dual = np.zeros(len(self.places))
            dual[int(np.argmax(self.variances(M)))] = 1.0
        shares = np.maximum(dual, 0.0)
        return self.build_mean_criterion(shares / shares.sum()).supergradient(M)

    def scaled(self, unit: FloatArray) -> GOptimality:
        """Return the same criterion for parameters measured in other units.

        `unit` (p,) is the size of each new unit, measured in the old unit of the parameter.
        """
        return GOptimality(self.places * np.outer(unit, unit))


SmoothCriterion: TypeAlias = DOptimality | AOptimality
Criterion: TypeAlias = SmoothCriterion | EOptimality | GOptimality


def compute_uncertainties(M: FloatArray, s: int) -> FloatArray:
    """Compute the standard uncertainties (..., s) of the first s parameters; inf where not determined.

    Args:
        M: (..., p, p) information matrices.
        s: number of parameters.
    """
    diagonal = np.diagonal(M, axis1=-2, axis2=-1)
    units = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = M * (units[..., :, None] * units[..., None, :])
    variance = _compute_diagonals_of_inverses(scaled)
    # If no matrix is near-singular, eigenvalues are not needed, and the result comes ten times faster.
    if ((variance > 0.0) & (variance < _LARGEST_REGULAR_VARIANCE)).all():
        return np.asarray((units * np.sqrt(variance))[..., :s])
    values, vectors = np.linalg.eigh(scaled)
    # Eigenvalues at rounding count as zero; a parameter with a part along their eigenvectors is undetermined.
    is_null = values <= 1e-12 * np.maximum(values[..., -1:], 1e-300)
    squared_components = np.square(vectors[..., :s, :])
    undetermined = (squared_components * is_null[..., None, :]).sum(axis=-1) > 1e-9
    variance = (squared_components @ (1.0 / np.where(is_null, np.inf, values))[..., None])[..., 0]
    return np.where(undetermined, np.inf, units[..., :s] * np.sqrt(variance))


def _compute_diagonals_of_inverses(M: FloatArray) -> FloatArray:
    """Return the diagonals (..., p) of the inverses of positive definite matrices M (..., p, p).

    Gauss-Jordan elimination needs no pivoting for positive definite matrices, and runs along all matrices at
    once in a third of LAPACK's time. The result is arbitrary where M is singular.
    """
    A = np.moveaxis(M, (-2, -1), (0, 1)).copy()
    with np.errstate(all="ignore"):
        for k in range(len(A)):
            pivot = 1.0 / A[k, k]
            row, column = A[k] * pivot, A[:, k] * -pivot
            A -= A[:, k, None] * row
            A[k], A[:, k], A[k, k] = row, column, pivot
    return np.asarray(np.einsum("ii...->...i", A))


def _log_det(M: FloatArray) -> FloatArray:
    """Return log det M (...) of positive semidefinite matrices M (..., p, p).

    The logarithm is −∞ where M is singular, also if rounding errors alone make M regular.
    """
    if not M.shape[-1]:
        return np.zeros(M.shape[:-2])
    try:
        pivots = np.square(np.diagonal(np.linalg.cholesky(M), axis1=-2, axis2=-1))
    except np.linalg.LinAlgError:
        return np.array([_log_det(each) for each in M] if M.ndim > 2 else -np.inf)
    regular = (pivots > _ROUNDING * np.diagonal(M, axis1=-2, axis2=-1)).all(axis=-1)
    return np.where(regular, np.log(pivots).sum(axis=-1), -np.inf)


def _invert_regular(M: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the inverses (..., p, p) of M, and a mask (...) of regular M.

    Where M is singular, the identity is returned in place of the inverse.
    """
    regular = np.isfinite(_log_det(M))
    return np.linalg.inv(np.where(regular[..., None, None], M, np.eye(M.shape[-1]))), regular


def _log_det_slope(M: FloatArray, K: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Return log det M, its gradient (k,), and minus its Hessian (k, k), when M moves along K.

    M (p, p) is positive semidefinite; K (k, p, p) are the k directions. Gradient and Hessian are zero if M is
    singular.
    """
    count, value = len(K), float(_log_det(M))
    if not (M.size and np.isfinite(value)):
        return value, np.zeros(count), np.zeros((count, count))
    inverse_times_K = np.linalg.inv(M) @ K
    flat = inverse_times_K.reshape(count, inverse_times_K.shape[1] ** 2)
    return (
        value,
        np.einsum("kii->k", inverse_times_K),
        flat @ inverse_times_K.transpose(0, 2, 1).reshape(flat.shape).T,
    )


GAP: Final = 1e-9
"""Gap (1 − efficiency) at which the search ends if the criterion is smooth and every force has a
direction."""
LOOSE_GAP: Final = 1e-5
"""Gap at which the search ends for E and G, whose optima have a kink, and for forces of free direction."""

_LARGEST_REGULAR_VARIANCE: Final = 1e6
"""Greatest diagonal entry of the inverse of a matrix with diagonal 1 for which the matrix surely is
regular."""
_NO_INFORMATION: Final = 1e-12
"""Least ratio of eigenvalues of the information of all candidates and priors that is not due to rounding."""
_START_READINGS: Final = 12
"""Number of readings that are chosen greedily to start the search."""
_START_SAMPLE: Final = 2_000
"""Number of candidates among which the readings of the start are chosen."""
_BLOCK: Final = 1024
"""Candidates whose information is computed at once."""
_MOST_ENTERING: Final = 20
"""Greatest number of candidates that become active in a round."""
_ROUNDS: Final = 200
_PROGRESS: Final = 0.9
"""Ratio of the gap to the previous best gap below which a round counts as progress."""
_STALLED: Final = 4
"""Number of rounds without progress after which rounding is assumed to keep the gap from closing."""
_STALLED_GAP: Final = 1e-3
"""Gap that is accepted after rounds without progress; the bound states the gap that was reached."""
_NO_WEIGHT: Final = 1e-13
_SINGULAR: Final = 1e-11
"""Ratio of eigenvalues below which a combination of parameters counts as undetermined."""
_PROMISING_SHARE: Final = 0.999
"""Least price of a candidate that may become active, relative to the least price of the active candidates."""
_STEPS: Final = 60
_CONVERGED: Final = 1e-24
"""Newton's decrement of −log φ that is rounding; the gap of a design is of the order of its root."""
_ROUNDING: Final = 1e-13
"""A matrix counts as singular if a Cholesky pivot, divided by its diagonal entry, is below this ratio."""
_QUADRATIC: Final = 1e-8
"""Decrement below which a full step is taken, as values of −log φ then differ by rounding only."""
_RIDGE: Final = 1e-11
"""Ridge relative to the Hessian's mean diagonal: with more weights than entries of M, some directions have no
curvature."""
_SUM_ROW_WEIGHT: Final = 1e3
"""Weight of the row that states the sum of the weights, over the greatest entry of the Hessian's root."""
_DECREASE: Final = 1e-4
_HALVINGS: Final = 34
"""Number of times that a step is halved before the line search accepts the step as it is."""
_LEAST_SHARE: Final = 1e-9
"""Least share of a place in the dual problem of the worst place."""


@dataclass(frozen=True, eq=False)
class Atoms:
    """Candidate readings (k), each under one load; a design gives weights to these atoms."""

    index: IndexArray  #: (k,) indices of the candidates
    force: FloatArray  #: (k, 3) unit vectors along the forces; used only where the direction is free
    information: FloatArray  #: (k, p, p) information K_i of each reading

    def __len__(self) -> int:
        """Return the number k of atoms."""
        return len(self.index)

    def __getitem__(self, rows: IndexArray | BoolArray | slice) -> Atoms:
        """Return some of the atoms, in the given order."""
        return Atoms(self.index[rows], self.force[rows], self.information[rows])

    def map_indices(self, candidates: IndexArray) -> Atoms:
        """Return these atoms with indices that refer to all candidates instead of a subset.

        Args:
            candidates: indices of the subset of candidates to which the present indices refer.
        """
        return Atoms(candidates[self.index], self.force, self.information)

    def join(self, *others: Atoms) -> Atoms:
        """Return one set with these atoms, followed by the atoms of the others."""
        sets = (self, *others)
        return Atoms(
            np.concatenate([part.index for part in sets]),
            np.concatenate([part.force for part in sets]),
            np.concatenate([part.information for part in sets]),
        )


class Candidates:
    """N candidate readings of p parameters, with the information that each adds.

    Where the direction of the force F is free, a candidate has six matrices K_ab, one for each pair of axes:
    K(F) = Σ_ab F_a F_b K_ab.
    """

    def __init__(self, information: FloatArray, unit: FloatArray) -> None:
        """Store the information of each candidate.

        Args:
            information: (N, 1, p, p) K_i, or (N, 6, p, p) of (K_ab + K_ba) / 2 for the pairs of axes xx, xy,
                xz, yy, yz, zz under the greatest force.
            unit: (p,) factors by which the columns of the rows are multiplied.
        """
        self.free = information.shape[1] > 1  #: whether forces may act in all directions
        self._information, self._unit = information, unit
        self._squares = np.outer(unit, unit)

    @classmethod
    def from_rows(cls, rows: FloatArray) -> Candidates:
        """Compute the information of each candidate from its rows, block by block to save memory.

        The result has N p² numbers, or 6 N p² for forces of any direction.

        Args:
            rows: (N, m, p) whitened rows, each candidate under its own load; or, for forces of any direction,
                (N, 3, m, p) under the greatest force along each axis.

        Raises:
            RequestError: a number is not finite.
        """
        stack = rows[:, None] if rows.ndim == 3 else rows
        axis_pairs = list(zip(*np.triu_indices(stack.shape[1]), strict=True))
        information = np.empty((len(stack), len(axis_pairs), stack.shape[-1], stack.shape[-1]))
        for start in range(0, len(stack), _BLOCK):
            block_rows = stack[start : start + _BLOCK]
            block_information = information[start : start + _BLOCK]
            for k, (axis_a, axis_b) in enumerate(axis_pairs):
                # A contiguous left factor halves the time of the product.
                K = np.ascontiguousarray(block_rows[:, axis_a].transpose(0, 2, 1)) @ block_rows[:, axis_b]
                block_information[:, k] = 0.5 * (K + K.transpose(0, 2, 1))
            if not np.isfinite(block_information).all():
                raise RequestError(
                    "a number of a candidate posture or load is not finite",
                    where="candidates",
                    remedy="give postures and loads of plausible size",
                )
        return cls(information, np.ones(rows.shape[-1]))

    def scaled(self, unit: FloatArray) -> Candidates:
        """Return the same candidates for parameters measured in other units.

        `unit` (p,) is the size of each new unit, measured in the old unit of the parameter.
        """
        return Candidates(self._information, self._unit * unit)

    def __len__(self) -> int:
        """Return the number N of candidates."""
        return len(self._information)

    def __getitem__(self, rows: IndexArray | slice) -> Candidates:
        """Return some of the candidates, in the given order."""
        return Candidates(self._information[rows], self._unit)

    def prices(self, G: FloatArray) -> FloatArray:
        """Return the price (N,) of each candidate: the greatest ``⟨G, K_i⟩`` over its possible loads.

        Args:
            G: (p, p) symmetric supergradient of a criterion.
        """
        products = self._price_pairs_of_axes(slice(None), G)
        return greatest_eigenvalue(_arrange_symmetric(products)) if self.free else products[:, 0]

    def build_atoms(self, index: IndexArray, G: FloatArray) -> Atoms:
        """Return candidates as atoms, each under the load with the greatest price ``⟨G, K_i⟩``.

        Args:
            index: (k,) indices of the candidates.
            G: (p, p) symmetric supergradient of a criterion.
        """
        force = np.zeros((len(index), 3))
        if self.free:
            # The eigenvector of the greatest eigenvalue, the last one, is the direction of the greatest
            # price.
            forms = _arrange_symmetric(self._price_pairs_of_axes(index, G)).T
            force = np.linalg.eigh(forms)[1][:, :, -1]
        return self.build_atoms_under(index, force)

    def find_highest_priced(self, G: FloatArray, allowed: BoolArray | bool = True) -> Atoms:
        """Return the candidate with the greatest price ``⟨G, K_i⟩`` as one atom.

        Args:
            G: (p, p) symmetric supergradient of a criterion.
            allowed: (N,) mask of the candidates to choose from; True for all.
        """
        return self.build_atoms(np.array([np.argmax(np.where(allowed, self.prices(G), -np.inf))]), G)

    def build_atoms_under(self, index: IndexArray, force: FloatArray) -> Atoms:
        """Return candidates as atoms (candidates with a load), each under a force along a given unit vector.

        Where forces are not free, each candidate has its own load, and `force` is only stored.

        Args:
            index: (k,) indices of the candidates.
            force: (k, 3) unit vectors along the forces.
        """
        if not self.free:
            return Atoms(index, force, self._information[index, 0] * self._squares)
        # The six pairs of axes a ≤ b; a pair of different axes counts twice in the sum over all a and b.
        a, b = np.triu_indices(3)
        products = force[:, a] * force[:, b] * np.where(a == b, 1.0, 2.0)
        K = np.einsum("ie,iepq->ipq", products, self._information[index])
        return Atoms(index, force, K * self._squares)

    def sum_information(self) -> FloatArray:
        """Return the summed information (p, p) of all candidates.

        A candidate whose force has a free direction counts three times, under a force along each axis.
        """
        axes = [0, 3, 5] if self.free else [0]  # the pairs xx, yy and zz
        return np.asarray(self._information[:, axes].sum(axis=(0, 1)) * self._squares)

    def _price_pairs_of_axes(self, index: IndexArray | slice, G: FloatArray) -> FloatArray:
        """Return the price ``⟨G, K⟩`` of each of n candidates: its information K, weighted by G (p, p).

        The result is (n, 1); for forces of any direction (n, 6), one price for each pair of axes of the
        force.
        """
        K = self._information[index]
        return np.asarray(K.reshape(*K.shape[:2], -1) @ (self._squares * G).ravel())


def _arrange_symmetric(entries: FloatArray) -> FloatArray:
    """Arrange entries (N, 6), in the order xx, xy, xz, yy, yz, zz, as symmetric matrices (3, 3, N)."""
    return entries.T[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


@dataclass(frozen=True, eq=False)
class Bound:
    """Bound on the information of every design of a problem."""

    efficiency: float  #: φ of the design at hand over the bound on φ of any design
    supergradient: FloatArray  #: (p, p) G, with ``φ(M′) ≤ ⟨G, M′⟩`` for all M′, in the problem's units
    prices: FloatArray  #: (N,) greatest ``⟨G, K_i⟩`` of each candidate


class DesignProblem:
    """Problem to choose n readings among candidates, in units that bring the columns to comparable norms."""

    def __init__(self, candidates: Candidates, criterion: Criterion, readings: int, base: FloatArray) -> None:
        """Scale candidates, criterion and earlier information to comparable columns.

        Args:
            candidates: N candidate readings of p parameters.
            criterion: criterion that compares designs.
            readings: number n of readings to take.
            base: M0 (p, p), information of earlier readings and of priors; zeros if there are none.

        Raises:
            RequestError: candidates and priors together do not determine the parameters.
        """
        total = base + readings / len(candidates) * candidates.sum_information()
        diagonal = np.diagonal(total)
        unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        #: (p, p) factors of an information matrix: M * scale_squared is in the problem's units
        self.scale_squared = np.outer(unit, unit)
        values = np.linalg.eigvalsh(total * self.scale_squared)
        if values[0] < _NO_INFORMATION * values[-1]:
            unaffected = np.flatnonzero(diagonal <= 0.0).tolist()
            raise RequestError(
                "all candidates together determine only "
                f"{int((values > _NO_INFORMATION * values[-1]).sum())} of {len(values)} parameters"
                + (f"; no load changes parameter {unaffected}" if unaffected else ""),
                where="candidates",
                remedy="add loads or postures that change the missing parameters, "
                "or leave these parameters out",
            )
        self.readings = readings
        self.candidates = candidates.scaled(unit)
        self.criterion = criterion.scaled(unit)
        self.base = base * self.scale_squared

    def information_matrix(self, atoms: Atoms, weights: FloatArray) -> FloatArray:
        """Return M0 + n Σ w_i K_i (p, p) in the problem's units.

        M0 is the information before the design, n the number of readings, w_i (k,) and K_i the weight and the
        information of each atom.
        """
        return np.asarray(self.base + self.readings * np.tensordot(weights, atoms.information, axes=1))

    def bound(self, M: FloatArray, dual: FloatArray | None = None) -> Bound:
        """Bound the information φ that a design with any weights of the candidates can reach.

        For any weights w′ with information M′, ``φ(M′) ≤ ⟨G, M0⟩ + n Σ w′_i ⟨G, K_i⟩``, and the mean price Σ
        w′_i ⟨G, K_i⟩ is at most the greatest price ⟨G, K_i⟩ of a candidate. G is the supergradient of φ at M.
        The bound holds for any M; the nearer M is to the optimum, the tighter is the bound.

        Args:
            M: (p, p) positive definite, information of a design.
            dual: dual variable of a criterion with a kink (E or G); None for its default.
        """
        G = self.criterion.supergradient(M, dual)
        prices = self.candidates.prices(G)
        upper = self.upper_bound(G, float(prices.max()))
        return Bound(min(1.0, float(self.criterion.information(M)) / upper), G, prices)

    def upper_bound(self, G: FloatArray, mean_price: float) -> float:
        """Return the upper bound ⟨G, M0⟩ + n d on φ, with d the greatest mean price of n readings.

        Args:
            G: (p, p) supergradient of the criterion.
            mean_price: greatest possible mean price d.
        """
        return float((G * self.base).sum()) + self.readings * mean_price


@dataclass(frozen=True, eq=False)
class Design:
    """Weights of candidates, with a bound on φ of any other weights."""

    atoms: Atoms  #: (k,) candidates with a weight, and their loads, in the problem's units
    weights: FloatArray  #: (k,) shares of the readings; they sum to 1
    matrix: FloatArray  #: (p, p) information M of all readings, in the units of the parameters
    bound: Bound  #: bound on φ of any weights, from one sweep over all candidates


def optimise_design(problem: DesignProblem, tolerance: float | None = None) -> Design:
    """Find the optimal weights of candidate readings, with a bound that proves their efficiency.

    Args:
        problem: readings to choose from, and the criterion.
        tolerance: gap (1 − efficiency) at which the search ends; `GAP` or `LOOSE_GAP` if None.

    Raises:
        SolverError: the gap does not close, or rounding hides a parameter.
    """
    if tolerance is None:
        smooth = isinstance(problem.criterion, SmoothCriterion) and not problem.candidates.free
        tolerance = GAP if smooth else LOOSE_GAP
    active = _choose_start_atoms(problem)
    weights = np.full(len(active), 1.0 / len(active))
    efficiency, stalled_rounds = 0.0, 0  # best efficiency so far, and number of rounds without progress
    best_design: tuple[Atoms, FloatArray, Bound] | None = None
    for _ in range(_ROUNDS):
        weights, dual = _optimise_active_weights(problem, active, weights)
        bound = problem.bound(problem.information_matrix(active, weights), dual)
        active, weights = active[weights > _NO_WEIGHT], weights[weights > _NO_WEIGHT]
        stalled_rounds += 1
        if best_design is None or bound.efficiency > efficiency:
            stalled_rounds = 0 if 1.0 - bound.efficiency < _PROGRESS * (1.0 - efficiency) else stalled_rounds
            best_design, efficiency = (active, weights, bound), bound.efficiency
        if 1.0 - efficiency <= (tolerance if stalled_rounds < _STALLED else _STALLED_GAP):
            active, weights, bound = best_design
            M = problem.base / problem.scale_squared
            M = M + problem.readings * np.tensordot(
                weights, active.information / problem.scale_squared, axes=1
            )
            return Design(active, weights, M, bound)
        # Candidates of the greatest prices become active. With free directions, an active candidate may enter
        # once more under another force.
        promising = np.flatnonzero(bound.prices >= _PROMISING_SHARE * bound.prices[active.index].min())
        if not problem.candidates.free:
            promising = np.setdiff1d(promising, active.index)
        entering = promising[np.argsort(-bound.prices[promising])[:_MOST_ENTERING]]
        active = active.join(problem.candidates.build_atoms(entering, bound.supergradient))
        weights = np.concatenate([weights, np.zeros(len(entering))])
    raise SolverError(
        "the design did not converge: the information of the design may be a fraction "
        f"{1.0 - efficiency:.1e} below the optimum"
    )


def _choose_start_atoms(problem: DesignProblem) -> Atoms:
    """Choose the first active candidates: one by one, the candidate of the greatest price in a sample.

    The sample is spread evenly over all candidates. Candidates that make M regular are added at the end.
    """
    all_indices = np.arange(len(problem.candidates))
    start_count = max(_START_READINGS, len(problem.base))
    stride = max(1, len(all_indices) // _START_SAMPLE)
    sample = problem.candidates[::stride]
    # A little of all information and of the unit matrix makes M regular before any reading is chosen.
    M = problem.base + 0.01 * problem.readings / len(sample) * sample.sum_information()
    M = M + 1e-6 * np.trace(M) / len(M) * np.eye(len(M))
    is_available = np.ones(len(sample), dtype=np.bool_)
    chosen: list[Atoms] = []
    for _ in range(min(start_count, len(sample))):
        chosen.append(sample.find_highest_priced(problem.criterion.supergradient(M), is_available))
        is_available[chosen[-1].index] = False
        M = M + problem.readings / start_count * chosen[-1].information[0]
    active = chosen[0].join(*chosen[1:]).map_indices(all_indices[::stride])
    # The sample may lack the rare candidates that determine a parameter: add these until M is regular.
    for _ in range(len(problem.base)):
        M = problem.information_matrix(active, np.full(len(active), 1.0 / len(active)))
        values = np.linalg.eigvalsh(M)
        if values[0] > _SINGULAR * values[-1]:
            break
        undetermined = np.linalg.eigh(M)[1][:, 0]
        active = active.join(problem.candidates.find_highest_priced(np.outer(undetermined, undetermined)))
    return active


def _optimise_active_weights(
    problem: DesignProblem, active: Atoms, weights: FloatArray
) -> tuple[FloatArray, FloatArray | None]:
    """Optimise the weights of the active candidates.

    Args:
        problem: choice of readings.
        active: k candidates that may have a weight.
        weights: (k,) weights to start from.

    Returns:
        (k,) optimal weights; and the dual variable of a criterion with a kink (E or G), else None.
    """
    criterion, K = problem.criterion, problem.readings * active.information
    if isinstance(criterion, SmoothCriterion):
        return optimise_weights(criterion, problem.base, K, weights), None
    if isinstance(criterion, GOptimality):
        return optimise_worst_place(criterion, problem.base, K, weights)
    from jointstiff.solver.fit import programs  # takes a second to import

    return programs.solve_e_optimal_design(problem.base, K, criterion.metric)


def optimise_weights(
    criterion: SmoothCriterion, base: FloatArray, K: FloatArray, weights: FloatArray
) -> FloatArray:
    """Maximise φ(base + Σ w_i K_i) subject to Σ w = 1 and w ≥ 0, by Newton's method.

    Args:
        criterion: φ.
        base: (p, p) information of earlier readings and priors.
        K: (k, p, p) information of each candidate, times the number of readings.
        weights: (k,) feasible weights to start from.

    Returns:
        (k,) weights, exact to rounding.

    Raises:
        SolverError: rounding hides a parameter, so that φ has no curvature.
    """

    def compute_slope(w: FloatArray) -> Slope:
        """Return −log φ at weights w (k,), and its derivatives with respect to w."""
        return criterion.slope(base + (w @ K.reshape(len(K), -1)).reshape(base.shape), K)

    w, slope, last_decrement = weights, compute_slope(weights), np.inf
    for _ in range(_STEPS):
        step = _compute_newton_step(slope, w)
        # The step sums to zero, so the weighted mean of the gradient is subtracted to lessen rounding.
        newton_decrement = -float((slope.gradient - slope.gradient @ w) @ step)
        if newton_decrement <= _CONVERGED:
            break
        # Take the first of the points w + step, w + step/2, … that decreases −log φ enough.
        for step_fraction in 0.5 ** np.arange(_HALVINGS + 1):
            new_w = np.maximum(w + step_fraction * step, 0.0)
            new_w /= new_w.sum()
            new_slope = compute_slope(new_w)
            if (
                newton_decrement < _QUADRATIC
                or new_slope.value <= slope.value - _DECREASE * step_fraction * newton_decrement
            ):
                break
        if (
            newton_decrement < _QUADRATIC and last_decrement <= newton_decrement
        ):  # rounding keeps the decrement from shrinking
            break
        w, slope, last_decrement = new_w, new_slope, newton_decrement
    return w


def _compute_newton_step(slope: Slope, w: FloatArray) -> FloatArray:
    """Return the step (k,) from weights w to the minimum of the quadratic model subject to Σ w = 1, w ≥ 0.

    The step is solved by non-negative least squares with a heavy row for Σ x = 1 (Lawson & Hanson 1974,
    chapter 23). The weighted mean is subtracted from the gradient, so that at the optimum the heavy
    row has no effect.
    """
    ridge = _RIDGE * np.trace(slope.hessian) / len(w) * np.eye(len(w))
    try:
        root = np.linalg.cholesky(slope.hessian + ridge).T
    except np.linalg.LinAlgError:
        raise SolverError(
            "the readings of the plan determine some parameters so poorly that rounding errors hide these "
            "parameters",
            remedy="give loads and postures of plausible size, or name the joints to be determined",
            where="candidates",
        ) from None
    downhill = np.linalg.solve(root.T, slope.gradient @ w - slope.gradient)
    sum_weight = _SUM_ROW_WEIGHT * float(np.abs(root).max())
    x = nnls(np.vstack([root, np.full(len(w), sum_weight)]), np.append(root @ w + downhill, sum_weight))[0]
    return np.asarray(x / x.sum() - w)


def optimise_worst_place(
    criterion: GOptimality, base: FloatArray, K: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Minimise the variance of the deflection at the worst place, from the dual problem over shares π.

    The dual problem, in which place r has the share π_r, is ``max_π min_w Σ π_r tr(W_r M(w)⁻¹)``, concave in
    π; the gradient is the vector of variances at the best weights for π.

    Args:
        criterion: φ.
        base: (p, p) information of earlier readings and priors.
        K: (k, p, p) information of each candidate, times the number of readings.
        weights: (k,) feasible weights to start from.

    Returns:
        The optimal weights (k,), and the shares π (R,) of the places.
    """
    count, best_weights = len(criterion.places), weights  # best weights for the shares tried last

    def compute_negative_log_dual(shares: FloatArray) -> tuple[float, FloatArray]:
        """Return −log of the dual function at shares (R,), and its gradient; update `best_weights`."""
        nonlocal best_weights
        mean_criterion = criterion.build_mean_criterion(np.maximum(shares, 0.0))
        best_weights = optimise_weights(mean_criterion, base, K, best_weights)
        variances = criterion.variances(base + np.tensordot(best_weights, K, axes=1))
        mean_variance = float(shares @ variances)
        return -float(np.log(mean_variance)), -variances / mean_variance

    solution = minimize(
        compute_negative_log_dual,
        np.full(count, 1.0 / count),
        jac=True,
        method="SLSQP",
        bounds=[(_LEAST_SHARE, 1.0)] * count,
        constraints=LinearConstraint(np.ones((1, count)), 1.0, 1.0),
        options={"ftol": 1e-10, "maxiter": 100},
    )
    compute_negative_log_dual(solution.x)  # sets `best_weights` for the final shares
    return best_weights, solution.x
