"""Robust fit of one reading: a rotation of the frame, a unit of length, and the targets on the flange."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.meaning.kinematics import build_cross_matrix
from jointstiff.solver.meaning.table import METRES, LengthUnit

_STEPS: Final = 20
_LARGEST_TURN: Final = 0.5  # [rad] in one step
_FAR: Final = 6.0
"""Residual in medians from which a row counts almost nothing."""
_FAR_WEIGHT: Final = 1e-2
_CAP: Final = 0.1
"""Residual [m] with which a row that does not fit counts, however far it is."""
_CONVERGED: Final = 1e-7
"""Step [m or rad] that ends the fit."""
_FLAT: Final = 0.05
"""Ratio of singular values below which positions are in a plane, and cannot show a mirrored frame."""


@dataclass(frozen=True, eq=False)
class FramePlacement:
    """Frame of the positions in R0: p [m] in R0 is s W p + c."""

    rotation: FloatArray  #: W (3, 3); with determinant −1 in a mirrored frame
    origin: FloatArray  #: c (3,) [m]
    scale: float  #: s [m per unit of the file]

    @property
    def is_mirrored(self) -> bool:
        """Return whether the frame is left-handed."""
        return bool(np.linalg.det(self.rotation) < 0.0)

    def to_base(self, points: FloatArray) -> FloatArray:
        """Return positions (..., 3) of the file in R0 [m]."""
        return self.scale * points @ self.rotation.T + self.origin


@dataclass(frozen=True, eq=False)
class RigidFit:
    """Fit of the positions of K targets in N postures."""

    frame: FramePlacement
    unit: LengthUnit
    targets: FloatArray  #: t (K, 3) places of the targets on the flange [m]
    distances: FloatArray  #: (N, K) distances of the positions from their places by the robot [m]
    free_scale: float  #: s / unit, if s is fitted, too

    @property
    def typical(self) -> float:
        """Median distance [m]."""
        return float(np.nanmedian(self.distances))

    @property
    def degrees_of_freedom(self) -> int:
        """Numbers of the positions beyond the unknowns."""
        return int(3 * np.isfinite(self.distances).sum()) - 6 - self.targets.size

    @property
    def residual(self) -> float:
        """Root mean square of the distances [m], with regard to the degrees of freedom.

        A distance counts at most `_CAP`.
        """
        known = self.distances[np.isfinite(self.distances)]
        square = float((np.minimum(known, _CAP) ** 2).sum())
        return float(np.sqrt(3.0 * square / max(self.degrees_of_freedom, 1)) / np.sqrt(3.0))


@dataclass(frozen=True, eq=False)
class _State:
    """Unknowns of the fit, for positions about their mean."""

    rotation: FloatArray
    middle: FloatArray  #: place of the mean position in R0 [m]
    targets: FloatArray
    scale: float


def fit_frame(
    rotation: FloatArray, place: FloatArray, points: FloatArray, matrix: FloatArray, targets: FloatArray
) -> RigidFit:
    """Fit the frame of positions to a flange, with the unit nearest to the scale of a linear fit.

    Args:
        rotation: R (N, 3, 3) of the flange.
        place: d (N, 3) of the flange [m].
        points: p (N, K, 3) in the unit of the file; NaN for a missing position.
        matrix: M (3, 3) of the linear fit.
        targets: t (K, 3) of the linear fit [m].
    """
    left, size, right = np.linalg.svd(matrix)
    if size[2] < _FLAT * size[0]:
        left[:, 2] *= np.sign(np.linalg.det(left @ right))
    turn = left @ right
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(turn))])
    seen = points @ mirror
    known: BoolArray = np.asarray(np.isfinite(seen).all(axis=2))
    mean = seen[known].mean(axis=0)
    centred = np.where(known[..., None], seen - mean, 0.0)
    unit = _find_nearest_unit(float(np.median(size)))
    start = _State(turn @ mirror, np.zeros(3), targets, METRES[unit])
    start = _settle_middle(start, rotation, place, centred, known)
    fitted = _iterate(start, rotation, place, centred, known, scale_is_free=False)
    free = _iterate(fitted, rotation, place, centred, known, scale_is_free=True)
    distance = np.linalg.norm(_compute_misfit(fitted, rotation, place, centred), axis=2)
    origin = fitted.middle - fitted.scale * fitted.rotation @ mean
    frame = FramePlacement(fitted.rotation @ mirror, origin, fitted.scale)
    distances = np.where(known, distance, np.nan)
    return RigidFit(frame, unit, fitted.targets, distances, free.scale / METRES[unit])


def fit_targets(
    rotation: FloatArray, place: FloatArray, positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Fit places t (K, 3) of targets whose positions (N, K, 3) are in R0; return t and distances (N, K) [m].

    Each place is the median over the postures, in the flange frame.
    """
    in_flange = np.einsum("nji,nkj->nki", rotation, positions - place[:, None])
    targets = np.nanmedian(in_flange, axis=0)
    return targets, np.linalg.norm(in_flange - targets, axis=2)


def _find_nearest_unit(scale: float) -> LengthUnit:
    """Return the unit of length that is nearest to a scale [m per unit of the file]."""
    return min(METRES, key=lambda unit: abs(np.log(METRES[unit] / scale)))


def _compute_misfit(
    state: _State, rotation: FloatArray, place: FloatArray, centred: FloatArray
) -> FloatArray:
    """Return s W p + c − R t − d (N, K, 3) [m]."""
    seen = state.scale * centred @ state.rotation.T + state.middle
    carried = np.einsum("nij,kj->nki", rotation, state.targets)
    return np.asarray(seen - carried - place[:, None])


def _settle_middle(
    state: _State, rotation: FloatArray, place: FloatArray, centred: FloatArray, known: BoolArray
) -> _State:
    """Return the state with the median of all origins that single positions give."""
    misfit = _compute_misfit(state, rotation, place, centred)
    middle = -np.median(misfit[known], axis=0)
    return _State(state.rotation, middle, state.targets, state.scale)


def _iterate(
    state: _State,
    rotation: FloatArray,
    place: FloatArray,
    centred: FloatArray,
    known: BoolArray,
    *,
    scale_is_free: bool,
) -> _State:
    """Return the state after Gauss–Newton steps with weights that suppress rows that do not fit."""
    count = len(state.targets)
    for _ in range(_STEPS):
        misfit = _compute_misfit(state, rotation, place, centred)
        weights = _weigh(misfit, known)
        derivative = _build_derivative(state, rotation, centred, scale_is_free=scale_is_free)
        matrix = (derivative * weights[..., None, None]).reshape(-1, derivative.shape[-1])
        right = -(misfit * weights[..., None]).reshape(-1)
        step = _solve_step(matrix, right)
        turn = _turn_by(step[:3])
        scale = state.scale
        if scale_is_free:
            scale = scale * float(np.exp(np.clip(step[-1], -_LARGEST_TURN, _LARGEST_TURN)))
        targets = state.targets + step[6 : 6 + 3 * count].reshape(count, 3)
        state = _State(turn @ state.rotation, state.middle + step[3:6], targets, scale)
        if np.abs(step).max() < _CONVERGED:
            break
    return state


def _solve_step(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve the least-squares problem of a step by its normal equations, with a small ridge."""
    gram = matrix.T @ matrix
    ridge = 1e-10 * np.trace(gram) / len(gram) + 1e-300
    return np.asarray(np.linalg.solve(gram + ridge * np.eye(len(gram)), matrix.T @ right))


def _weigh(misfit: FloatArray, known: BoolArray) -> FloatArray:
    """Return the square roots of weights (N, K): 1 up to the median distance, then falling."""
    distance = np.linalg.norm(misfit, axis=2)
    ratio = distance / (np.median(distance[known]) + 1e-9)
    weight = 1.0 / np.maximum(ratio, 1.0)
    weight = np.where(ratio > _FAR, _FAR_WEIGHT * weight, weight)
    return np.sqrt(np.where(known, weight, 0.0))


def _build_derivative(
    state: _State, rotation: FloatArray, centred: FloatArray, *, scale_is_free: bool
) -> FloatArray:
    """Return the derivative (N, K, 3, 6 + 3K [+ 1]) of the misfit.

    Its columns are turn, origin and targets, and the logarithm of the scale if it is free.
    """
    postures, count = centred.shape[:2]
    turned = state.scale * centred @ state.rotation.T
    derivative = np.zeros((postures, count, 3, 6 + 3 * count + scale_is_free))
    x, y, z = turned[..., 0], turned[..., 1], turned[..., 2]
    derivative[..., 0, 1], derivative[..., 0, 2] = z, -y
    derivative[..., 1, 0], derivative[..., 1, 2] = -z, x
    derivative[..., 2, 0], derivative[..., 2, 1] = y, -x
    derivative[..., 3:6] = np.eye(3)
    for k in range(count):
        derivative[:, k, :, 6 + 3 * k : 9 + 3 * k] = -rotation
    if scale_is_free:
        derivative[..., -1] = turned
    return derivative


def _turn_by(vector: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) by a rotation vector [rad], at most `_LARGEST_TURN`."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    cross = build_cross_matrix(vector / angle)
    angle = min(angle, _LARGEST_TURN)
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross))
