"""Fit of every reading of a table at once, in closed form (method.md §17).

A reading states which numbers are joints, and which are the positions p_ik of target k in posture i. The
robot then places its flange at (R_i, d_i), and ``M p_ik + c = R_i t_k + d_i`` holds for one matrix M (3 × 3),
one c, and the places t_k of the targets on the flange. M is the unit of length times the rotation of the
frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
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
_SMALL: Final = 1e-9
_MOVEMENT_SHARE: Final = 80.0
"""Percentile of the distances that counts as the movement of a target."""


@dataclass(frozen=True, eq=False)
class FlangePlaces:
    """Flange in N postures, for each of H hypotheses of the joints."""

    rotation: FloatArray  #: R (H, N, 3, 3)
    place: FloatArray  #: d (H, N, 3) [m]

    def stack_columns(self, count: int) -> FloatArray:
        """Return the columns of t_1 … t_K and of d for K targets, as an array (NK, 3, H, 3K + 1)."""
        hypotheses, postures = self.place.shape[:2]
        columns = np.zeros((postures, count, 3, hypotheses, 3 * count + 1))
        rotation = self.rotation.transpose(1, 2, 0, 3)
        for k in range(count):
            columns[:, k, :, :, 3 * k : 3 * k + 3] = rotation
            columns[:, k, :, :, -1] = self.place.transpose(1, 2, 0)
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


def fit_all(columns: FloatArray, points: FloatArray) -> list[LinearFit]:
    """Fit all hypotheses of the joints to positions (N, K, 3); return the fits that make sense.

    The matrix M and c are eliminated by a projection, t by the normal equations, so that each fit costs a few
    products of small matrices. Rows without a number are left out. `columns` are those of `FlangePlaces`.
    """
    basis = _Basis.of(points)
    count = points.shape[1]
    free = 3 * basis.row_count - 12 - 3 * count
    if free < 1:
        return []
    known = columns if basis.known.all() else columns[basis.known]
    by_hypothesis = known.transpose(2, 0, 1, 3).reshape(known.shape[2], -1, known.shape[3])
    whole = np.swapaxes(by_hypothesis, 1, 2) @ by_hypothesis
    parts = np.tensordot(basis.directions, known, axes=(0, 0)).transpose(2, 0, 1, 3)
    by_part = parts.reshape(len(parts), -1, parts.shape[3])
    normal = whole - np.swapaxes(by_part, 1, 2) @ by_part
    targets = _solve_targets(normal)
    solution = np.concatenate([targets, np.ones((len(targets), 1))], axis=1)
    square = np.einsum("hi,hij,hj->h", solution, normal, solution)
    residual = np.sqrt(np.maximum(square, 0.0) / free)
    small = np.flatnonzero(residual < WORST_SCREENED)
    coefficients = (parts[small] @ solution[small, None, :, None])[..., 0]
    coefficients = np.swapaxes(coefficients, 1, 2) @ basis.to_coefficients.T
    matrix = coefficients[..., :3] / basis.scale
    # Most matrices are far from a rotation times a unit: their norm shows that without singular values.
    near = _may_have_one_scale(matrix)
    small, coefficients, matrix = small[near], coefficients[near], matrix[near]
    if not len(small):
        return []
    origin = coefficients[..., 3] - matrix @ basis.mean
    movement = _measure_movement(matrix, points[np.isfinite(points).all(axis=2)])
    makes_sense = (movement >= LEAST_MOVEMENT) & _has_one_scale(matrix)
    return [
        LinearFit(
            hypothesis=int(small[i]),
            matrix=matrix[i],
            origin=origin[i],
            targets=targets[small[i]].reshape(count, 3),
            residual=float(residual[small[i]]),
            movement=float(movement[i]),
        )
        for i in _choose_smallest(residual[small], makes_sense)
    ]


def _choose_smallest(residual: FloatArray, makes_sense: BoolArray) -> list[int]:
    """Return the indices of the smallest residuals among fits that make sense."""
    order = np.argsort(residual)
    return [int(i) for i in order if makes_sense[i]][:_MOST_OF_TRIPLE]


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
        """Build the basis for positions (N, K, 3)."""
        rows = points.reshape(-1, 3)
        known: BoolArray = np.asarray(np.isfinite(rows).all(axis=1))
        if not known.any():
            return cls(np.zeros((len(rows), 1)), np.zeros((4, 1)), known, np.zeros(3), 1.0)
        mean = rows[known].mean(axis=0)
        scale = float(np.abs(rows[known] - mean).max()) or 1.0
        regressors = np.ones((int(known.sum()), 4))
        regressors[:, :3] = (rows[known] - mean) / scale
        left, size, right = np.linalg.svd(regressors, full_matrices=False)
        is_used = size > 1e-8 * size[0]
        to_coefficients = right[is_used].T / size[is_used]
        return cls(left[:, is_used], to_coefficients, known, mean, scale)


def _solve_targets(normal: FloatArray) -> FloatArray:
    """Return the places t (H, 3K) that minimise the residual, from normal matrices (H, 3K + 1, 3K + 1)."""
    gram, right = normal[:, :-1, :-1], normal[:, :-1, -1]
    size = gram.shape[1]
    ridge = _SMALL * (1.0 + np.trace(gram, axis1=1, axis2=2))
    solved = np.linalg.solve(gram + ridge[:, None, None] * np.eye(size), -right[..., None])
    return np.asarray(solved[..., 0])


def _measure_movement(matrix: FloatArray, rows: FloatArray) -> FloatArray:
    """Return for each matrix (H, 3, 3) the second largest movement of positions (R, 3) along an axis [m]."""
    centred = rows - np.median(rows, axis=0)
    moved = np.abs(centred @ np.swapaxes(matrix, 1, 2))
    along_axes = np.percentile(moved, _MOVEMENT_SHARE, axis=1)
    return np.asarray(np.sort(along_axes, axis=1)[:, 1])


def _may_have_one_scale(matrix: FloatArray) -> BoolArray:
    """Return which matrices (H, 3, 3) have a norm that two equal singular values near a unit allow."""
    norm = np.sqrt((matrix**2).sum(axis=(1, 2)))
    ratio = norm[:, None] / np.array(list(METRES.values()))
    least = np.sqrt(2.0) / _FACTOR_FROM_UNIT
    most = np.sqrt(2.0 + _LARGEST_RATIO**2) * _FACTOR_FROM_UNIT
    return np.asarray(((ratio >= least) & (ratio <= most)).any(axis=1))


def _has_one_scale(matrix: FloatArray) -> BoolArray:
    """Return which matrices (H, 3, 3) have two equal singular values that are near a unit of length."""
    size = np.linalg.svd(matrix, compute_uv=False)
    are_alike = size[:, 0] < _LARGEST_RATIO * size[:, 1]
    units = np.array(list(METRES.values()))
    factor = np.abs(np.log(size[:, 1:2] / units + 1e-300))
    is_near = factor.min(axis=1) < np.log(_FACTOR_FROM_UNIT)
    return np.asarray(are_alike & is_near)
