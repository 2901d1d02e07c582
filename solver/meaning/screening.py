"""Fit of every reading of a table at once, in closed form (method.md §17).

A reading states which numbers are joints, and which are the positions p_ik of target k in posture i. The
robot then places its flange at (R_i, d_i), and ``M p_ik + c = R_i t_k + d_i`` holds for one matrix M (3 × 3),
one c, and the places t_k of the targets on the flange. M is the unit of length times the rotation of the
frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.meaning.table import METRES

LEAST_MOVEMENT: Final = 0.02
"""Least movement of a target [m]: a point at rest fits any joints with M = 0."""
WORST_SCREENED: Final = 0.3
"""Largest residual [m] of a reading that is looked at further."""
_LARGEST_RATIO: Final = 1.4
"""Largest ratio of the two largest singular values of M: a frame has one scale."""
_FACTOR_FROM_UNIT: Final = 1.35
"""Largest factor between a singular value of M and a unit of length."""
_MOST_OF_TRIPLE: Final = 16
"""Readings of one triple that are looked at further."""
_ORDINARY_MOVEMENT: Final = 0.3
"""Movement [m] of the targets below which a small residual says less."""
_LEAST_SUBSET: Final = 7
"""Least number of rows of a subset."""
_RANDOM_SUBSETS: Final = 8
_SMALL: Final = 1e-9
_MOVEMENT_SHARE: Final = 80.0
"""Percentile of the distances that counts as the movement of a target."""


def choose_subsets(row_count: int) -> list[IndexArray]:
    """Return subsets of the rows, one of them free of damaged rows if these are few.

    One damaged row moves a fit by least squares. The shuffled rows are cut into quarters, and each two
    quarters are a subset. Two damaged rows are in two quarters at most, so that a subset without them
    remains. If half of the rows are too few for a fit, the subsets are random; if all are, there are none.
    """
    generator = np.random.default_rng(0)
    quarters = np.array_split(generator.permutation(row_count), 4)
    if 2 * len(quarters[-1]) >= _LEAST_SUBSET:
        return [np.sort(np.concatenate(pair)) for pair in combinations(quarters, 2)]
    if row_count <= _LEAST_SUBSET:
        return []
    choices = [generator.choice(row_count, _LEAST_SUBSET, replace=False) for _ in range(_RANDOM_SUBSETS)]
    return [np.sort(choice) for choice in choices]


@dataclass(frozen=True, eq=False)
class FlangePlaces:
    """Flange in N postures, for each of H hypotheses of the joints."""

    rotation: FloatArray  #: R (H, N, 3, 3)
    place: FloatArray  #: d (H, N, 3) [m]

    def stack_columns(self, count: int) -> FloatArray:
        """Return the right side ``R_i t_k + d_i`` of all positions as columns: (N K, 3, H, 3K + 1).

        For each of K = `count` targets in each of N postures, and each axis, row h holds the coefficients of
        t_1 … t_K, and then d_i, by hypothesis h of the joints.
        """
        hypotheses, postures = self.place.shape[:2]
        columns = np.zeros((postures, count, 3, hypotheses, 3 * count + 1))
        # Hypotheses (axis 0) come after postures and axes of R0.
        rotation = self.rotation.transpose(1, 2, 0, 3)  # (N, 3, H, 3)
        place = self.place.transpose(1, 2, 0)  # (N, 3, H)
        for k in range(count):
            columns[:, k, :, :, 3 * k : 3 * k + 3] = rotation
            columns[:, k, :, :, -1] = place
        return columns.reshape(postures * count, 3, hypotheses, 3 * count + 1)


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Fit of one hypothesis of the joints to one hypothesis of the positions."""

    hypothesis: int  #: index of the joints
    matrix: FloatArray  #: M (3, 3) [m per unit of the file]
    origin: FloatArray  #: c (3,) [m]
    targets: FloatArray  #: t (K, 3) places of the targets on the flange [m]
    residual: float  #: root mean square with regard to the degrees of freedom [m]
    movement: float  #: second largest movement of the positions along axes of R0 [m]

    @property
    def rank(self) -> float:
        """Residual [m], larger if the targets hardly move."""
        return float(_rank(np.float64(self.residual), np.float64(self.movement)))


def fit_all(columns: FloatArray, points: FloatArray) -> list[LinearFit]:
    """Fit ``M p + c = R t + d`` to positions p, for each of H hypotheses of the joints.

    R and d are rotation and place of the flange by a hypothesis; the matrix M (3, 3), c (3,) and the places t
    of the targets on the flange are fitted. Fits that make no sense, such as with a scale that is no unit of
    length, are not returned. M and c are eliminated by a projection, t by the normal equations, so that each
    fit costs a few products of small matrices. Rows without a number are left out.

    Args:
        columns: (N K, 3, H, 3K + 1) of `FlangePlaces`.
        points: p (N, K, 3) in the unit of the file.
    """
    basis = _Basis.of(points)
    target_count = points.shape[1]
    degrees_of_freedom = 3 * basis.row_count - 12 - 3 * target_count
    if degrees_of_freedom < 1:
        return []
    known_columns = columns if basis.known.all() else columns[basis.known]
    projected = _project_on_positions(known_columns, basis)
    targets = _solve_targets(projected.normal)
    residual = projected.compute_residuals(targets, degrees_of_freedom)
    frames = _fit_frames(projected, targets, np.flatnonzero(residual < WORST_SCREENED), basis)
    if not len(frames.hypotheses):
        return []
    movement = _measure_movement(frames.matrix, points[np.isfinite(points).all(axis=2)])
    makes_sense = (movement >= LEAST_MOVEMENT) & _has_one_scale(frames.matrix)
    rank = _rank(residual[frames.hypotheses], movement)
    chosen = _choose_smallest(rank, makes_sense)
    return [frames.build_fit(i, targets, residual, float(movement[i])) for i in chosen]


class _Frames(NamedTuple):
    """Frames of the positions by F of the hypotheses of the joints: ``M p + c`` is a position in R0 [m]."""

    hypotheses: IndexArray  # (F,) indices
    matrix: FloatArray  # M (F, 3, 3) [m per unit of the file]
    origin: FloatArray  # c (F, 3) [m]

    def build_fit(self, i: int, targets: FloatArray, residual: FloatArray, movement: float) -> LinearFit:
        """Return the fit with frame i.

        Args:
            i: number of the frame, below F.
            targets: t (H, 3K) places of the targets on the flange, by all H hypotheses [m].
            residual: (H,) residual of each hypothesis [m].
            movement: second largest movement of the positions along axes of R0 [m].
        """
        hypothesis = int(self.hypotheses[i])
        return LinearFit(
            hypothesis=hypothesis,
            matrix=self.matrix[i],
            origin=self.origin[i],
            targets=targets[hypothesis].reshape(-1, 3),
            residual=float(residual[hypothesis]),
            movement=movement,
        )


def _fit_frames(
    projected: _ProjectedColumns, targets: FloatArray, hypotheses: IndexArray, basis: _Basis
) -> _Frames:
    """Return the frames by some hypotheses of the joints, without those whose scale cannot be a unit.

    Most matrices are far from a rotation times a unit: their norm shows that without singular values.

    Args:
        projected: columns of t and d, projected on the positions.
        targets: t (H, 3K) places of the targets on the flange, by all H hypotheses [m].
        hypotheses: indices of the hypotheses of interest.
        basis: basis of the positions.
    """
    t_and_1 = _append_one(targets[hypotheses])
    in_basis = np.einsum("hari,hi->har", projected.parts[hypotheses], t_and_1)  # R t + d for each axis a
    coefficients = in_basis @ basis.to_coefficients.T  # (H, 3, 4) of x, y, z and 1
    matrix = coefficients[..., :3] / basis.scale
    is_near = _may_have_one_scale(matrix)
    coefficients, matrix = coefficients[is_near], matrix[is_near]
    return _Frames(hypotheses[is_near], matrix, coefficients[..., 3] - matrix @ basis.mean)


def _append_one(targets: FloatArray) -> FloatArray:
    """Return the coefficients (H, 3K + 1) of the columns of t and d: places t (H, 3K), and 1 for d."""
    return np.concatenate([targets, np.ones((len(targets), 1))], axis=1)


class _ProjectedColumns(NamedTuple):
    """Columns C of t and d of H hypotheses: a part P in the basis of the positions, and the rest."""

    normal: FloatArray  # (H, 3K + 1, 3K + 1) products CᵀC − PᵀP of the columns of the rest
    parts: FloatArray  # (H, 3, r, 3K + 1) coordinates P in the r directions of the basis

    def compute_residuals(self, targets: FloatArray, degrees_of_freedom: int) -> FloatArray:
        """Return the residual (H,) of each fit [m], for places t (H, 3K) of the targets on the flange [m]."""
        t_and_1 = _append_one(targets)
        squares = np.einsum("hi,hij,hj->h", t_and_1, self.normal, t_and_1)
        return np.asarray(np.sqrt(np.maximum(squares, 0.0) / degrees_of_freedom))


def _project_on_positions(columns: FloatArray, basis: _Basis) -> _ProjectedColumns:
    """Project the columns (R, 3, H, 3K + 1) of t and d on the basis of R positions, for H hypotheses."""
    hypotheses, width = columns.shape[2:]
    of_hypothesis = columns.transpose(2, 0, 1, 3).reshape(hypotheses, -1, width)
    parts = np.tensordot(basis.directions, columns, axes=(0, 0))  # (r, 3, H, 3K + 1)
    parts = parts.transpose(2, 1, 0, 3)
    parts_as_rows = parts.reshape(hypotheses, -1, width)
    normal = of_hypothesis.mT @ of_hypothesis - parts_as_rows.mT @ parts_as_rows
    return _ProjectedColumns(normal, parts)


def _rank(residual: FloatArray | np.float64, movement: FloatArray | np.float64) -> FloatArray:
    """Return residuals [m] that are larger if the targets hardly move.

    Metres that are read as degrees hardly move the arm, so that any positions fit such joints well.
    """
    return np.asarray(residual * np.maximum(1.0, _ORDINARY_MOVEMENT / np.maximum(movement, LEAST_MOVEMENT)))


def _choose_smallest(rank: FloatArray, makes_sense: BoolArray) -> list[int]:
    """Return the indices of up to `_MOST_OF_TRIPLE` fits that make sense, the smallest rank first."""
    by_rank = np.argsort(rank)
    sensible = by_rank[makes_sense[by_rank]]
    return [int(i) for i in sensible[:_MOST_OF_TRIPLE]]


@dataclass(frozen=True, eq=False)
class _Basis:
    """Orthonormal basis of the columns x, y, z and 1 of the positions."""

    directions: FloatArray  #: (R, r) in the rows with numbers
    to_coefficients: FloatArray  #: (4, r) from coordinates in the basis to coefficients of x, y, z, 1
    known: BoolArray  #: (NK,) rows with numbers
    mean: FloatArray  #: (3,) of the positions
    scale: float  #: spread of the positions

    @property
    def row_count(self) -> int:
        """Number of positions."""
        return int(self.known.sum())

    @classmethod
    def of(cls, points: FloatArray) -> _Basis:
        """Build the basis for positions (N, K, 3).

        Positions in a plane have fewer directions than four; without a number in any row, the basis is zero.
        """
        rows = points.reshape(-1, 3)
        known: BoolArray = np.asarray(np.isfinite(rows).all(axis=1))
        if not known.any():
            return cls(np.zeros((len(rows), 1)), np.zeros((4, 1)), known, np.zeros(3), 1.0)
        known_rows = rows[known]
        mean = known_rows.mean(axis=0)
        scale = float(np.abs(known_rows - mean).max()) or 1.0
        regressors = np.ones((len(known_rows), 4))  # x, y, z and 1
        regressors[:, :3] = (known_rows - mean) / scale
        U, singular_values, Vt = np.linalg.svd(regressors, full_matrices=False)
        is_used = singular_values > 1e-8 * singular_values[0]
        to_coefficients = Vt[is_used].T / singular_values[is_used]
        return cls(U[:, is_used], to_coefficients, known, mean, scale)


def _solve_targets(normal: FloatArray) -> FloatArray:
    """Return the places t (H, 3K) that minimise the residual.

    The normal matrices (H, 3K + 1, 3K + 1) of the columns of t and d are ``[[G, g], [gᵀ, γ]]``, so that
    ``G t = −g``; a small ridge makes G regular.
    """
    gram, right_side = normal[:, :-1, :-1], -normal[:, :-1, -1]
    ridge = _SMALL * (1.0 + np.trace(gram, axis1=1, axis2=2))
    regular_gram = gram + ridge[:, None, None] * np.eye(gram.shape[1])
    return np.asarray(np.linalg.solve(regular_gram, right_side[..., None])[..., 0])


def _measure_movement(matrix: FloatArray, rows: FloatArray) -> FloatArray:
    """Return for each matrix (H, 3, 3) the second largest movement of positions (R, 3) along an axis [m]."""
    from_median = rows - np.median(rows, axis=0)
    distances = np.abs(from_median @ matrix.swapaxes(1, 2))  # (H, R, 3) along axes of R0
    movements = np.percentile(distances, _MOVEMENT_SHARE, axis=1)  # (H, 3)
    _, second_largest, _ = np.sort(movements, axis=1).T
    return np.asarray(second_largest)


def _may_have_one_scale(matrix: FloatArray) -> BoolArray:
    """Return which matrices (H, 3, 3) have a norm that two alike singular values near a unit allow.

    The third singular value may be anything from zero, for positions in a plane, to `_LARGEST_RATIO` times
    the unit. The squared norm is the sum of the squared singular values.
    """
    norm = np.linalg.norm(matrix, axis=(1, 2))
    units = np.array(list(METRES.values()))
    norm_in_units = norm[:, None] / units  # (H, units)
    least = np.sqrt(2.0) / _FACTOR_FROM_UNIT
    most = np.sqrt(2.0 + _LARGEST_RATIO**2) * _FACTOR_FROM_UNIT
    is_possible = (norm_in_units >= least) & (norm_in_units <= most)
    return np.asarray(is_possible.any(axis=1))


def _has_one_scale(matrix: FloatArray) -> BoolArray:
    """Return which matrices (H, 3, 3) have two alike singular values that are near a unit of length."""
    largest, second, _ = np.linalg.svd(matrix, compute_uv=False).T
    are_alike = largest < _LARGEST_RATIO * second
    units = np.array(list(METRES.values()))
    log_factors = np.abs(np.log(second[:, None] / units + 1e-300))  # the sum avoids log 0
    is_near_unit = log_factors.min(axis=1) < np.log(_FACTOR_FROM_UNIT)
    return np.asarray(are_alike & is_near_unit)
