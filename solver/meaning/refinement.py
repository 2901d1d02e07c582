"""Robust fit of one reading: a rotation of the frame, a unit of length, and the targets on the flange."""

from __future__ import annotations

from dataclasses import dataclass, replace
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


_BASE_ANGLE: Final = float(np.radians(1.0))
"""Angle [rad] of a frame against R0 from which positions are turned."""
_BASE_DISTANCE: Final = 0.02
"""Distance [m] of the origin of a frame from that of R0 from which positions are shifted."""


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

    @property
    def turn(self) -> float:
        """Angle [rad] of the axes against those of R0."""
        cosine_of_turn = 0.5 * (float(np.trace(self.rotation)) - 1.0)
        return float(np.arccos(np.clip(cosine_of_turn, -1.0, 1.0)))

    @property
    def is_base(self) -> bool:
        """Return whether the frame is R0, up to the errors of a model."""
        distance_of_origin = float(np.linalg.norm(self.origin))
        return self.turn < _BASE_ANGLE and distance_of_origin < _BASE_DISTANCE

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
        """Median distance [m]; infinite if no distance is a number."""
        known_distances = self.distances[np.isfinite(self.distances)]
        return float(np.median(known_distances)) if known_distances.size else float("inf")

    @property
    def degrees_of_freedom(self) -> int:
        """Numbers of the positions beyond the unknowns."""
        return int(3 * np.isfinite(self.distances).sum()) - 6 - self.targets.size

    @property
    def residual(self) -> float:
        """Root of the sum of squared distances over the degrees of freedom [m].

        A distance counts at most `_CAP`.
        """
        known_distances = self.distances[np.isfinite(self.distances)]
        square = float((np.minimum(known_distances, _CAP) ** 2).sum())
        return float(np.sqrt(square / max(self.degrees_of_freedom, 1)))


@dataclass(frozen=True, eq=False)
class _Data:
    """Positions of K targets in N postures, and the flange in these postures."""

    rotation: FloatArray  # R (N, 3, 3) of the flange
    place: FloatArray  # d (N, 3) of the flange [m]
    mean: FloatArray  # (3,) mean position, in the unit of the file
    centred: FloatArray  # p (N, K, 3) positions less their mean, in the unit of the file
    known: BoolArray  # (N, K) which positions were read

    @classmethod
    def of(cls, rotation: FloatArray, place: FloatArray, points: FloatArray) -> _Data:
        """Centre positions (N, K, 3) in a right-handed frame; a missing position, which is NaN, becomes zero.

        `rotation` (N, 3, 3) and `place` (N, 3) [m] are those of the flange.
        """
        known: BoolArray = np.asarray(np.isfinite(points).all(axis=2))
        mean = points[known].mean(axis=0)
        centred = np.where(known[..., None], points - mean, 0.0)
        return cls(rotation, place, mean, centred, known)


@dataclass(frozen=True, eq=False)
class _State:
    """Unknowns of the fit: ``s W p + c = R t + d`` for positions p about their mean."""

    rotation: FloatArray  # W (3, 3) of the frame of the positions
    middle: FloatArray  # c (3,) place of the mean position in R0 [m]
    targets: FloatArray  # t (K, 3) places of the targets on the flange [m]
    scale: float  # s [m per unit of the file]


def fit_frame(
    rotation: FloatArray, place: FloatArray, points: FloatArray, matrix: FloatArray, targets: FloatArray
) -> RigidFit:
    """Fit the frame of positions to a flange: ``s W p + c = R t + d``, with W a rotation.

    The scale s is the unit of length nearest to the scale of a linear fit ``M p + c = R t + d``. A second fit
    with a free scale shows by how much the lengths of the robot differ. A left-handed frame is fitted as a
    right-handed one whose z axis is reversed.

    Args:
        rotation: R (N, 3, 3) of the flange.
        place: d (N, 3) of the flange [m].
        points: p (N, K, 3) in the unit of the file; NaN for a missing position.
        matrix: M (3, 3) of the linear fit.
        targets: t (K, 3) of the linear fit [m].
    """
    nearest_rotation, scales = _find_nearest_rotation(matrix)
    mirror = _build_mirror(nearest_rotation)
    data = _Data.of(rotation, place, points @ mirror)
    unit = _find_nearest_unit(float(np.median(scales)))
    start = _State(nearest_rotation @ mirror, np.zeros(3), targets, METRES[unit])
    fitted = _fit_by_reweighting(_settle_middle(start, data), data, scale_is_free=False)
    with_free_scale = _fit_by_reweighting(fitted, data, scale_is_free=True)
    distances = np.linalg.norm(_compute_misfit(fitted, data), axis=2)
    origin = fitted.middle - fitted.scale * fitted.rotation @ data.mean
    return RigidFit(
        frame=FramePlacement(fitted.rotation @ mirror, origin, fitted.scale),
        unit=unit,
        targets=fitted.targets,
        distances=np.where(data.known, distances, np.nan),
        free_scale=with_free_scale.scale / METRES[unit],
    )


def _build_mirror(rotation: FloatArray) -> FloatArray:
    """Return the map (3, 3) that makes a frame right-handed: diag(1, 1, −1) if its rotation mirrors."""
    handedness = np.sign(np.linalg.det(rotation))
    return np.diag([1.0, 1.0, handedness])


def _find_nearest_rotation(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotation (3, 3) nearest to a matrix M, and the singular values (3,) of M.

    The rotation has the determinant −1 if M mirrors. Positions in a plane cannot show that: their rotation
    has the determinant 1.
    """
    U, singular_values, Vt = np.linalg.svd(matrix)
    are_in_plane = singular_values[2] < _FLAT * singular_values[0]
    if are_in_plane and np.linalg.det(U @ Vt) < 0.0:
        U[:, 2] *= -1.0
    return U @ Vt, singular_values


def fit_targets(
    rotation: FloatArray, place: FloatArray, positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Fit places t (K, 3) of targets whose positions (N, K, 3) are in R0; return t and distances (N, K) [m].

    Each place is the median over the postures, in the flange frame. `rotation` (N, 3, 3) and `place` (N, 3)
    [m] are those of the flange.
    """
    from_flange = positions - place[:, None]
    in_flange = from_flange @ rotation  # Rᵀ (p − d) of each posture, (N, K, 3)
    targets = np.nanmedian(in_flange, axis=0)
    return targets, np.linalg.norm(in_flange - targets, axis=2)


def _find_nearest_unit(scale: float) -> LengthUnit:
    """Return the unit of length that is nearest to a scale [m per unit of the file]."""
    return min(METRES, key=lambda unit: abs(np.log(METRES[unit] / scale)))


def _compute_misfit(state: _State, data: _Data) -> FloatArray:
    """Return s W p + c − R t − d (N, K, 3) [m]: the positions less where the robot would put the targets."""
    read = state.scale * data.centred @ state.rotation.T + state.middle
    carried = state.targets @ data.rotation.swapaxes(1, 2) + data.place[:, None]
    return np.asarray(read - carried)


def _settle_middle(state: _State, data: _Data) -> _State:
    """Return the state with c such that the median misfit of the positions is zero in each coordinate."""
    misfit = _compute_misfit(state, data)
    return replace(state, middle=state.middle - np.median(misfit[data.known], axis=0))


def _fit_by_reweighting(state: _State, data: _Data, *, scale_is_free: bool) -> _State:
    """Return the state after Gauss–Newton steps with weights that suppress rows that do not fit.

    The steps end when the last one is below `_CONVERGED`, or after `_STEPS` steps.
    """
    for _ in range(_STEPS):
        misfit = _compute_misfit(state, data)
        root_weights = _weigh(misfit, data.known)
        derivative = _build_derivative(state, data, scale_is_free=scale_is_free)
        matrix = (derivative * root_weights[..., None, None]).reshape(-1, derivative.shape[-1])
        right_side = -(misfit * root_weights[..., None]).reshape(-1)
        step = _solve_step(matrix, right_side)
        state = _take_step(state, step, scale_is_free=scale_is_free)
        if np.abs(step).max() < _CONVERGED:
            break
    return state


def _take_step(state: _State, step: FloatArray, *, scale_is_free: bool) -> _State:
    """Return the state after a step (6 + 3K [+ 1],): turn [rad], shift of c, shifts of all t [m].

    The last number, if the scale is free, is the logarithm of the factor of the scale, limited in size.
    """
    target_count = len(state.targets)
    turn, shift, shift_of_targets = np.split(step[: 6 + 3 * target_count], [3, 6])
    scale = state.scale
    if scale_is_free:
        log_factor = np.clip(step[-1], -_LARGEST_TURN, _LARGEST_TURN)
        scale = state.scale * float(np.exp(log_factor))
    return _State(
        rotation=_turn_by(turn) @ state.rotation,
        middle=state.middle + shift,
        targets=state.targets + shift_of_targets.reshape(target_count, 3),
        scale=scale,
    )


def _solve_step(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve the least-squares problem of a step by its normal equations, with a small ridge."""
    gram = matrix.T @ matrix
    ridge = 1e-10 * np.trace(gram) / len(gram) + 1e-300
    return np.asarray(np.linalg.solve(gram + ridge * np.eye(len(gram)), matrix.T @ right))


def _weigh(misfit: FloatArray, known: BoolArray) -> FloatArray:
    """Return the square roots of weights (N, K): 1 up to the median distance, then falling.

    A position beyond `_FAR` median distances has even less weight, and a missing position none. `misfit`
    (N, K, 3) are the positions less where the robot would put the targets [m].
    """
    distance = np.linalg.norm(misfit, axis=2)
    typical_distance = np.median(distance[known]) + 1e-9
    ratio = distance / typical_distance
    weight: FloatArray = 1.0 / np.maximum(ratio, 1.0)
    weight[ratio > _FAR] *= _FAR_WEIGHT
    weight[~known] = 0.0
    return np.asarray(np.sqrt(weight))


def _build_derivative(state: _State, data: _Data, *, scale_is_free: bool) -> FloatArray:
    """Return the derivative (N, K, 3, 6 + 3K [+ 1]) of the misfit s W p + c − R t − d.

    Its columns are turn of W [rad], c, all t, and the logarithm of the scale s if it is free.
    """
    posture_count, target_count, _ = data.centred.shape
    turned = state.scale * data.centred @ state.rotation.T  # s W p
    column_count = 6 + 3 * target_count + (1 if scale_is_free else 0)
    derivative = np.zeros((posture_count, target_count, 3, column_count))
    derivative[..., :3] = _derive_by_turn(turned)
    derivative[..., 3:6] = np.eye(3)  # by c
    for k in range(target_count):
        start = 6 + 3 * k
        derivative[:, k, :, start : start + 3] = -data.rotation  # by t of target k
    if scale_is_free:
        derivative[..., -1] = turned
    return derivative


def _derive_by_turn(positions: FloatArray) -> FloatArray:
    """Return the derivative (..., 3, 3) of positions (..., 3) by the rotation vector of a small turn.

    A small turn v moves the position a by v × a, which is minus the cross matrix of a times v.
    """
    x, y, z = positions[..., 0], positions[..., 1], positions[..., 2]
    derivative = np.zeros((*positions.shape, 3))
    derivative[..., 0, 1], derivative[..., 0, 2] = z, -y
    derivative[..., 1, 0], derivative[..., 1, 2] = -z, x
    derivative[..., 2, 0], derivative[..., 2, 1] = y, -x
    return derivative


def _turn_by(vector: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) by a rotation vector [rad], at most by the angle `_LARGEST_TURN`.

    Rodrigues' formula ``I + sin φ K + (1 − cos φ) K²``, with K the cross matrix of the unit vector.
    """
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    K = build_cross_matrix(vector / angle)
    angle = min(angle, _LARGEST_TURN)
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K))
