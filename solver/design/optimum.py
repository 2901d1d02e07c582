"""Optimal weights of candidate readings, and proof of what they reach (method.md §10).

    maximise φ(M0 + n Σ w_i K_i)  subject to  Σ w_i = 1,  w_i ≥ 0

A few candidates are held and their weights are optimal. One sweep prices all candidates; the best ones join,
those of weight zero leave. The same sweep bounds what any weights can reach, and ends the search.

Candidate i is a posture with its load; reading it adds ``K_i = A_iᵀ Σ⁻¹ A_i``, p × p. Where a force may act
in any direction, A_i is linear in the force, ``A_i(F) = Σ_a F_a A_ia``, and so the price of the candidate,
``⟨G, K_i(F)⟩``, is a quadratic form of F: its greatest value over all directions is an eigenvalue of a 3 × 3.

Criteria say how much a set of readings tells, as one number.

Each criterion is an *information* φ(M), concave and homogeneous of degree 1 in the information matrix M.
Hence any supporting matrix G ⪰ 0 bounds it everywhere, ``φ(M′) ≤ ⟨G, M′⟩``, and what any design reaches:

| criterion | φ(M) | G |
|---|---|---|
| D | det(C)^(1/s), C = (Lᵀ M⁻¹ L)⁻¹ | φ/s · M⁻¹ L C Lᵀ M⁻¹ |
| A, I | 1 / tr(W M⁻¹) | φ² · M⁻¹ W M⁻¹ |
| E | λ_min(V C V) | X V Z V Xᵀ, X = M⁻¹ L C, Z ⪰ 0, tr Z = 1 |
| G | 1 / max_r tr(W_r M⁻¹) | that of I for W = Σ π_r W_r, Σ π = 1 |

L selects the s parameters of interest, which are the first; the others are a nuisance. Each class has

* ``information(M)``, φ(M) (...) of matrices (..., p, p), zero where M is singular;
* ``support(M, dual)``, G at a positive definite M. For E the dual is Z, for G it is π; it is brought to what
  the proof asks of it, so that any is valid;
* ``scaled(unit)``, the same criterion of parameters measured in other units, M → diag(u) M diag(u);
* if Newton's method takes it, ``slope(M, K)``, −log φ at M with its derivatives along K (k, p, p).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from scipy.optimize import LinearConstraint, minimize, nnls

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, greatest_eigenvalue
from jointstiff.solver.errors import RequestError, SolverError


class Slope(NamedTuple):
    """Value and derivatives of −log φ along the weights of k atoms."""

    value: float  #: −log φ; inf where M is singular
    gradient: FloatArray  #: (k,)
    hessian: FloatArray  #: (k, k), positive semidefinite


@dataclass(frozen=True)
class DOptimality:
    """D-optimality: volume of the uncertainty ellipsoid of the first s parameters."""

    interest: int  #: number s of the parameters of interest

    def information(self, M: FloatArray) -> FloatArray:
        """Return the information det(C)^(1/s) (...) of matrices M (..., p, p); zero where M is singular."""
        s = self.interest
        rest = _log_det(M[..., s:, s:])
        regular = np.isfinite(rest)
        return np.asarray(regular * np.exp((_log_det(M) - np.where(regular, rest, 0.0)) / s))

    def support(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:  # noqa: ARG002
        """Return the supporting matrix G = φ/s · (M⁻¹ − M₂₂⁻¹) at M, with φ(M′) ≤ ⟨G, M′⟩ for all M′.

        `dual` is ignored: the criterion is smooth.
        """
        s = self.interest
        G = np.linalg.inv(M)
        G[s:, s:] -= np.linalg.inv(M[s:, s:])
        G = 0.5 * (G + G.T)
        return self.information(M) / s * G

    def slope(self, M: FloatArray, K: FloatArray) -> Slope:
        """Return −log φ = −log det(C)/s, and its derivatives when M moves along each of K (k, p, p)."""
        s = self.interest
        value, gradient, hessian = _log_det_slope(M, K)
        rest, rest_gradient, rest_hessian = _log_det_slope(M[s:, s:], K[:, s:, s:])
        return Slope(-(value - rest) / s, -(gradient - rest_gradient) / s, (hessian - rest_hessian) / s)

    def scaled(self, unit: FloatArray) -> DOptimality:  # noqa: ARG002
        """Return this criterion unchanged: other units of the parameters (p,) change φ by a factor only."""
        return self


@dataclass(frozen=True, eq=False)
class AOptimality:
    """A-optimality: weighted mean tr(W M⁻¹) of the variances.

    With W = diag(1/c²) these are relative variances of compliances. With W the mean of AᵀA over places it is
    the variance of a predicted deflection (I-optimality).
    """

    W: FloatArray  #: (p, p) positive semidefinite

    def information(self, M: FloatArray) -> FloatArray:
        """Return the information 1 / tr(W M⁻¹) (...) of matrices M (..., p, p); zero where M is singular."""
        inverse, regular = _invert_regular(M)
        return np.asarray(regular / (self.W * inverse).sum(axis=(-2, -1)))

    def support(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:  # noqa: ARG002
        """Return the supporting matrix G = φ² · M⁻¹ W M⁻¹ at M, with φ(M′) ≤ ⟨G, M′⟩ for all M′.

        `dual` is ignored: the criterion is smooth.
        """
        inverse = np.linalg.inv(M)
        G = inverse @ self.W @ inverse / float((self.W * inverse).sum()) ** 2
        return 0.5 * (G + G.T)

    def slope(self, M: FloatArray, K: FloatArray) -> Slope:
        """Return −log φ = log tr(W M⁻¹), and its derivatives when M moves along each of K (k, p, p)."""
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
        """Return the criterion for parameters in units (p,), relative to the present ones."""
        return AOptimality(self.W * np.outer(unit, unit))


@dataclass(frozen=True, eq=False)
class EOptimality:
    """E-optimality: variance of the worst combination of the first s parameters."""

    #: (s,) V, by which C is multiplied on both sides, as the criterion depends on the units
    metric: FloatArray

    def information(self, M: FloatArray) -> FloatArray:
        """Return φ (...) of matrices M (..., p, p); zero where M is singular.

        φ is one over the greatest eigenvalue of the scaled covariance of the first s parameters.
        """
        s = len(self.metric)
        inverse, regular = _invert_regular(M)
        covariance = inverse[..., :s, :s] / np.outer(self.metric, self.metric)
        return np.asarray(regular / np.linalg.eigvalsh(covariance)[..., -1])

    def support(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:
        """Return the supporting matrix G = X V Z V Xᵀ at M, with φ(M′) ≤ ⟨G, M′⟩ for all M′.

        Z is the dual (s, s), made positive semidefinite with trace 1; without a dual, Z = v vᵀ of the worst
        combination v.
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
        """Return the criterion for parameters in units (p,), relative to the present ones."""
        return EOptimality(self.metric / unit[: len(self.metric)])


@dataclass(frozen=True, eq=False)
class GOptimality:
    """G-optimality: variance of the deflection at the worst place."""

    places: FloatArray  #: (R, p, p) W_r of each place, positive semidefinite

    def information(self, M: FloatArray) -> FloatArray:
        """Return the information 1 / max_r tr(W_r M⁻¹) (...) of matrices M (..., p, p); zero if singular."""
        inverse, regular = _invert_regular(M)
        return np.asarray(regular / np.einsum("rij,...ij->...r", self.places, inverse).max(axis=-1))

    def variances(self, M: FloatArray) -> FloatArray:
        """Return the variances tr(W_r M⁻¹) (R,) of the deflections at the R places."""
        return np.asarray(np.einsum("rij,ij->r", self.places, np.linalg.inv(M)))

    def build_mean_criterion(self, shares: FloatArray) -> AOptimality:
        """Return the criterion of the mean variance over the places, weighted by shares (R,)."""
        return AOptimality(np.tensordot(shares, self.places, axes=1))

    def support(self, M: FloatArray, dual: FloatArray | None = None) -> FloatArray:
        """Return the supporting matrix G at M, with φ(M′) ≤ ⟨G, M′⟩ for all M′.

        G is the supporting matrix of the mean variance, in which place r has the share π_r. The dual is
        π (R,), scaled to sum 1; without a dual, the worst place has the share 1.
        """
        if dual is None:
            dual = np.zeros(len(self.places))
            dual[int(np.argmax(self.variances(M)))] = 1.0
        weights = np.maximum(dual, 0.0)
        return self.build_mean_criterion(weights / weights.sum()).support(M)

    def scaled(self, unit: FloatArray) -> GOptimality:
        """Return the criterion for parameters in units (p,), relative to the present ones."""
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
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = M * (unit[..., :, None] * unit[..., None, :])
    variance = _invert_diagonals(scaled)
    if ((variance > 0.0) & (variance < _REGULAR)).all():  # no matrix is near-singular: ten times faster
        return np.asarray((unit * np.sqrt(variance))[..., :s])
    values, vectors = np.linalg.eigh(scaled)
    null = values <= 1e-12 * np.maximum(values[..., -1:], 1e-300)
    squares = np.square(vectors[..., :s, :])
    undetermined = (squares * null[..., None, :]).sum(axis=-1) > 1e-9
    variance = (squares @ (1.0 / np.where(null, np.inf, values))[..., None])[..., 0]
    return np.where(undetermined, np.inf, unit[..., :s] * np.sqrt(variance))


def _invert_diagonals(M: FloatArray) -> FloatArray:
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
    """Return log det M (...); −inf where M (..., p, p) is singular or only rounding makes it regular."""
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
    """Return log det M, its gradient (k,), and minus its Hessian (k, k), when M moves along K (k, p, p)."""
    k, value = len(K), float(_log_det(M))
    if not (M.size and np.isfinite(value)):
        return value, np.zeros(k), np.zeros((k, k))
    X = np.linalg.inv(M) @ K
    flat = X.reshape(k, X.shape[1] ** 2)
    return value, np.einsum("kii->k", X), flat @ X.transpose(0, 2, 1).reshape(flat.shape).T


GAP: Final = 1e-9
"""Gap at which the search ends where the criterion is smooth and loads are given."""
LOOSE_GAP: Final = 1e-5
"""The same for E and G, whose optima have a kink, and for forces whose direction is free."""

_REGULAR: Final = 1e6
"""Diagonal entry of the inverse of a matrix whose diagonal is 1, up to which rounding hides no rank."""
_NO_INFORMATION: Final = 1e-12
"""Least eigenvalue of the information of everything, with columns of unit norm, that is not rounding."""
_START: Final = 12
"""Readings chosen greedily to begin with."""
_SAMPLE: Final = 2_000
"""Candidates among which these are sought."""
_BLOCK: Final = 1024
"""Candidates whose information is computed at once."""
_ADDED: Final = 20
"""Candidates that join in a round."""
_ROUNDS: Final = 200
_PROGRESS: Final = 0.9
"""Ratio of gaps of two rounds that is progress."""
_STALLED: Final = 4
"""Rounds without progress after which rounding is taken to keep the gap open."""
_STALLED_GAP: Final = 1e-3
"""Gap that is then accepted; the bound says what it is."""
_NO_WEIGHT: Final = 1e-13
_SINGULAR: Final = 1e-11
"""Ratio of eigenvalues below which information is taken to determine fewer parameters."""
_PROMISING: Final = 0.999
"""Share of the least price among those held at which a candidate may join."""
_STEPS: Final = 60
_CONVERGED: Final = 1e-24
"""Newton's decrement of −log φ that is rounding; the gap of a design is of the order of its root."""
_ROUNDING: Final = 1e-13
"""Share of a diagonal entry that its pivot leaves where rounding alone makes a matrix positive definite."""
_QUADRATIC: Final = 1e-8
"""Decrement below which a full step is taken: values of −log φ no longer tell the points apart."""
_RIDGE: Final = 1e-11
"""Of the Hessian's mean diagonal: more weights than entries of M leave directions without curvature."""
_HEAVY: Final = 1e3
"""Row for the sum of the weights, over the greatest entry of the Hessian's root."""
_DECREASE: Final = 1e-4
_HALVINGS: Final = 34
"""Times that a step is halved before the line search gives in."""
_LEAST_SHARE: Final = 1e-9
"""Least share of a place in the dual of the worst one."""


@dataclass(frozen=True, eq=False)
class Atoms:
    """Some candidates, each under one load."""

    index: IndexArray  #: (k,) candidates
    force: FloatArray  #: (k, 3) unit direction of the force where it is free
    information: FloatArray  #: (k, p, p)

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
        parts = (self, *others)
        return Atoms(
            np.concatenate([part.index for part in parts]),
            np.concatenate([part.force for part in parts]),
            np.concatenate([part.information for part in parts]),
        )


class Candidates:
    """N candidate readings of p parameters, by their information.

    Where the force is free there are six matrices, of all pairs of axes: K(F) = Σ_ab F_a F_b K_ab.
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
        pairs = list(zip(*np.triu_indices(stack.shape[1]), strict=True))
        information = np.empty((len(stack), len(pairs), stack.shape[-1], stack.shape[-1]))
        for start in range(0, len(stack), _BLOCK):
            part, block = stack[start : start + _BLOCK], information[start : start + _BLOCK]
            for k, (a, b) in enumerate(pairs):
                K = (
                    np.ascontiguousarray(part[:, a].transpose(0, 2, 1)) @ part[:, b]
                )  # contiguous: half the time
                block[:, k] = 0.5 * (K + K.transpose(0, 2, 1))
            if not np.isfinite(block).all():
                raise RequestError(
                    "a candidate has a number that is not finite",
                    where="candidates",
                    remedy="give postures and loads of plausible size",
                )
        return cls(information, np.ones(rows.shape[-1]))

    def scaled(self, unit: FloatArray) -> Candidates:
        """Return the candidates for parameters in other units (p,), relative to the present units."""
        return Candidates(self._information, self._unit * unit)

    def __len__(self) -> int:
        """Return the number N of candidates."""
        return len(self._information)

    def __getitem__(self, rows: IndexArray | slice) -> Candidates:
        """Return some of the candidates, in the given order."""
        return Candidates(self._information[rows], self._unit)

    def prices(self, G: FloatArray) -> FloatArray:
        """Return the greatest ``⟨G, K_i⟩`` (N,) of each candidate over the loads that it may take.

        Args:
            G: (p, p) symmetric supporting matrix of a criterion.
        """
        products = self._price_by_axes(slice(None), G)
        return greatest_eigenvalue(_arrange_force_forms(products)) if self.free else products[:, 0]

    def atoms(self, index: IndexArray, G: FloatArray) -> Atoms:
        """Return candidates by index, each under the load by which its price ``⟨G, K_i⟩`` is greatest."""
        force = np.zeros((len(index), 3))
        if self.free:
            force = np.linalg.eigh(_arrange_force_forms(self._price_by_axes(index, G)).T)[1][:, :, -1]
        return self.build_atoms_under(index, force)

    def best(self, G: FloatArray, allowed: BoolArray | bool = True) -> Atoms:
        """Return the candidate of the greatest price ``⟨G, K_i⟩`` among those allowed (N,), as one atom."""
        return self.atoms(np.array([np.argmax(np.where(allowed, self.prices(G), -np.inf))]), G)

    def build_atoms_under(self, index: IndexArray, force: FloatArray) -> Atoms:
        """Return candidates (k,) as atoms, under forces along unit vectors (k, 3).

        Where forces are not free, each candidate has its own load, and `force` is only stored.
        """
        if not self.free:
            return Atoms(index, force, self._information[index, 0] * self._squares)
        a, b = np.triu_indices(3)
        squares = force[:, a] * force[:, b] * np.where(a == b, 1.0, 2.0)
        K = np.einsum("ie,iepq->ipq", squares, self._information[index])
        return Atoms(index, force, K * self._squares)

    def total(self) -> FloatArray:
        """Return the summed information (p, p) of all candidates; free forces count along all three axes."""
        axes = [0, 3, 5] if self.free else [0]
        return np.asarray(self._information[:, axes].sum(axis=(0, 1)) * self._squares)

    def _price_by_axes(self, index: IndexArray | slice, G: FloatArray) -> FloatArray:
        """Return the prices ``⟨G, K⟩`` of candidates (n, 1), or of pairs of axes of a free force (n, 6)."""
        K = self._information[index]
        return np.asarray(K.reshape(*K.shape[:2], -1) @ (self._squares * G).ravel())


def _arrange_force_forms(products: FloatArray) -> FloatArray:
    """Arrange prices (N, 6) of the pairs xx, xy, xz, yy, yz, zz as symmetric matrices (3, 3, N)."""
    return products.T[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


@dataclass(frozen=True, eq=False)
class Bound:
    """Bound on the information of every design of a problem."""

    efficiency: float  #: φ of the design at hand over the bound: its share of the greatest possible, at least
    support: FloatArray  #: (p, p) G, with ``φ(M′) ≤ ⟨G, M′⟩`` for all M′, in the problem's units
    prices: FloatArray  #: (N,) greatest ``⟨G, K_i⟩`` of each candidate


class DesignProblem:
    """Choice of n readings among candidates, in units that bring the columns to comparable norms."""

    def __init__(self, candidates: Candidates, criterion: Criterion, readings: int, base: FloatArray) -> None:
        """Scale candidates, criterion and earlier information to comparable columns.

        Args:
            candidates: N candidate readings of p parameters.
            criterion: criterion that compares designs.
            readings: number n of readings to take.
            base: M0 (p, p), information of earlier readings and of priors; zero for none.

        Raises:
            RequestError: candidates and priors together do not determine the parameters.
        """
        total = base + readings / len(candidates) * candidates.total()
        diagonal = np.diagonal(total)
        unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        #: (p, p) factors of an information matrix: M * squares is in the problem's units
        self.squares = np.outer(unit, unit)
        values = np.linalg.eigvalsh(total * self.squares)
        if values[0] < _NO_INFORMATION * values[-1]:
            missing = np.flatnonzero(diagonal <= 0.0).tolist()
            raise RequestError(
                f"all candidates together determine {int((values > _NO_INFORMATION * values[-1]).sum())} of "
                f"{len(values)} parameters" + (f"; no load changes parameter {missing}" if missing else ""),
                where="candidates",
                remedy="add loads or postures that change the missing parameters, or leave these out",
            )
        self.readings = readings
        self.candidates = candidates.scaled(unit)
        self.criterion = criterion.scaled(unit)
        self.base = base * self.squares

    def matrix(self, atoms: Atoms, weights: FloatArray) -> FloatArray:
        """Return M0 + n Σ w_i K_i (p, p) in the problem's units."""
        return np.asarray(self.base + self.readings * np.tensordot(weights, atoms.information, axes=1))

    def bound(self, M: FloatArray, dual: FloatArray | None = None) -> Bound:
        """Bound the information φ that any weights of the candidates can reach.

        ``φ(M′) ≤ ⟨G, M0⟩ + n Σ w′_i ⟨G, K_i⟩``, and the mean price Σ w′_i ⟨G, K_i⟩ is at most the greatest
        price. The bound holds for any M, and is sharper for a better M.

        Args:
            M: (p, p) positive definite, information of a design.
            dual: dual variable of a criterion with a kink (E or G); None for its default.
        """
        support = self.criterion.support(M, dual)
        prices = self.candidates.prices(support)
        upper = self.upper_bound(support, float(prices.max()))
        return Bound(min(1.0, float(self.criterion.information(M)) / upper), support, prices)

    def upper_bound(self, support: FloatArray, mean_price: float) -> float:
        """Return the upper bound ⟨G, M0⟩ + n d on φ; d is the greatest possible mean price of n readings."""
        return float((support * self.base).sum()) + self.readings * mean_price


@dataclass(frozen=True, eq=False)
class Design:
    """Weights of candidates, with a bound on what any others could reach."""

    atoms: Atoms  #: (k,) candidates with a weight, and their loads, in the problem's units
    weights: FloatArray  #: (k,) shares of the readings; they sum to 1
    matrix: FloatArray  #: (p, p) information M of all readings, in the units of the parameters
    bound: Bound  #: from one sweep over all candidates


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
    held = _choose_start(problem)
    weights = np.full(len(held), 1.0 / len(held))
    efficiency, stalled = 0.0, 0
    best: tuple[Atoms, FloatArray, Bound] | None = None
    for _ in range(_ROUNDS):
        weights, dual = _optimise_held_weights(problem, held, weights)
        bound = problem.bound(problem.matrix(held, weights), dual)
        held, weights = held[weights > _NO_WEIGHT], weights[weights > _NO_WEIGHT]
        stalled += 1
        if best is None or bound.efficiency > efficiency:
            stalled = 0 if 1.0 - bound.efficiency < _PROGRESS * (1.0 - efficiency) else stalled
            best, efficiency = (held, weights, bound), bound.efficiency
        if 1.0 - efficiency <= (tolerance if stalled < _STALLED else _STALLED_GAP):
            held, weights, bound = best
            M = problem.base / problem.squares
            M = M + problem.readings * np.tensordot(weights, held.information / problem.squares, axes=1)
            return Design(held, weights, M, bound)
        # Candidates of the best prices join; with free forces, also held ones under another force.
        promising = np.flatnonzero(bound.prices >= _PROMISING * bound.prices[held.index].min())
        if not problem.candidates.free:
            promising = np.setdiff1d(promising, held.index)
        entering = promising[np.argsort(-bound.prices[promising])[:_ADDED]]
        held = held.join(problem.candidates.atoms(entering, bound.support))
        weights = np.concatenate([weights, np.zeros(len(entering))])
    raise SolverError(f"the design did not converge: its gap is {1.0 - efficiency:.1e}")


def _choose_start(problem: DesignProblem) -> Atoms:
    """Choose candidates to start from: one by one by greatest price, from an evenly spread sample."""
    every = np.arange(len(problem.candidates))
    count = max(_START, len(problem.base))
    step = max(1, len(every) // _SAMPLE)
    sample = problem.candidates[::step]
    M = problem.base + 0.01 * problem.readings / len(sample) * sample.total()
    M = M + 1e-6 * np.trace(M) / len(M) * np.eye(len(M))
    allowed = np.ones(len(sample), dtype=np.bool_)
    chosen: list[Atoms] = []
    for _ in range(min(count, len(sample))):
        chosen.append(sample.best(problem.criterion.support(M), allowed))
        allowed[chosen[-1].index] = False
        M = M + problem.readings / count * chosen[-1].information[0]
    held = chosen[0].join(*chosen[1:]).map_indices(every[::step])
    # The sample may lack the rare candidate that determines a parameter: add from all until none is missing.
    for _ in range(len(problem.base)):
        M = problem.matrix(held, np.full(len(held), 1.0 / len(held)))
        values = np.linalg.eigvalsh(M)
        if values[0] > _SINGULAR * values[-1]:
            break
        unseen = np.linalg.eigh(M)[1][:, 0]
        held = held.join(problem.candidates.best(np.outer(unseen, unseen)))
    return held


def _optimise_held_weights(
    problem: DesignProblem, held: Atoms, weights: FloatArray
) -> tuple[FloatArray, FloatArray | None]:
    """Optimise the weights of the candidates held so far.

    Args:
        problem: choice of readings.
        held: k candidates that may have a weight.
        weights: (k,) weights to start from.

    Returns:
        (k,) optimal weights; and the dual variable of a criterion with a kink (E or G), else None.
    """
    criterion, K = problem.criterion, problem.readings * held.information
    if isinstance(criterion, SmoothCriterion):
        return optimise_weights(criterion, problem.base, K, weights), None
    if isinstance(criterion, GOptimality):
        return optimise_worst_place(criterion, problem.base, K, weights)
    from jointstiff.solver.estimation import convex  # takes a second to import

    return convex.solve_e_optimal_design(problem.base, K, criterion.metric)


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

    w, at, last = weights, compute_slope(weights), np.inf
    for _ in range(_STEPS):
        step = _compute_newton_step(at, w)
        # The step sums to zero, so the weighted mean of the gradient is subtracted to lessen rounding.
        decrement = -float((at.gradient - at.gradient @ w) @ step)
        if decrement <= _CONVERGED:
            break
        # The first of the points w + step, w + step/2, … that decreases −log φ enough
        for size in 0.5 ** np.arange(_HALVINGS + 1):
            moved = np.maximum(w + size * step, 0.0)
            moved /= moved.sum()
            after = compute_slope(moved)
            if decrement < _QUADRATIC or after.value <= at.value - _DECREASE * size * decrement:
                break
        if decrement < _QUADRATIC and last <= decrement:
            break
        w, at, last = moved, after, decrement
    return w


def _compute_newton_step(at: Slope, w: FloatArray) -> FloatArray:
    """Return the step (k,) from weights w to the minimum of the quadratic model on the simplex.

    The step is solved by non-negative least squares with a heavy row for Σ x = 1 (Lawson & Hanson 1974,
    chapter 23). The weighted mean is subtracted from the gradient, so that at the optimum the heavy
    row has no effect.
    """
    ridge = _RIDGE * np.trace(at.hessian) / len(w) * np.eye(len(w))
    try:
        root = np.linalg.cholesky(at.hessian + ridge).T
    except np.linalg.LinAlgError:
        raise SolverError(
            "the readings of the plan determine some parameters so badly that rounding hides them",
            remedy="give loads and postures of plausible size, or name the joints to be determined",
            where="candidates",
        ) from None
    downhill = np.linalg.solve(root.T, at.gradient @ w - at.gradient)
    heavy = _HEAVY * float(np.abs(root).max())
    x = nnls(np.vstack([root, np.full(len(w), heavy)]), np.append(root @ w + downhill, heavy))[0]
    return np.asarray(x / x.sum() - w)


def optimise_worst_place(
    criterion: GOptimality, base: FloatArray, K: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Minimise the variance at the worst place, by the dual problem over shares π of the places.

    The dual is ``max_π min_w Σ π_r tr(W_r M(w)⁻¹)``, concave in π; its gradient is the variances at the
    best weights.

    Args:
        criterion: φ.
        base: (p, p) information of earlier readings and priors.
        K: (k, p, p) information of each candidate, times the number of readings.
        weights: (k,) feasible weights to start from.

    Returns:
        (k,) weights; and (R,) the shares π of the places.
    """
    count, best = len(criterion.places), weights

    def negative_log_dual(shares: FloatArray) -> tuple[float, FloatArray]:
        """Return −log of the dual function at shares (R,), and its gradient; update `best` (the weights)."""
        nonlocal best
        best = optimise_weights(criterion.build_mean_criterion(np.maximum(shares, 0.0)), base, K, best)
        variances = criterion.variances(base + np.tensordot(best, K, axes=1))
        mean_variance = float(shares @ variances)
        return -float(np.log(mean_variance)), -variances / mean_variance

    solution = minimize(
        negative_log_dual,
        np.full(count, 1.0 / count),
        jac=True,
        method="SLSQP",
        bounds=[(_LEAST_SHARE, 1.0)] * count,
        constraints=LinearConstraint(np.ones((1, count)), 1.0, 1.0),
        options={"ftol": 1e-10, "maxiter": 100},
    )
    negative_log_dual(solution.x)  # sets the best weights for the final shares
    return best, solution.x
