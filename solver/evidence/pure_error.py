"""Pure error: noise of the tracker, from coordinates that no motion of the flange touches (method.md §3).

A rigid displacement of the flange has six coordinates. Of the 3 T coordinates of a posture with T ≥ 3 targets
3 T − 6 remain the same whatever bends, turns or shifts: their residuals show the noise of the readings alone.
An F test compares the residuals in the other six with that noise (lack of fit; Draper & Smith, *Applied
Regression Analysis*, ch. 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fit.method import MIN_TARGETS, factorise_displacement
from jointstiff.solver.fit.rows import Rows

PURE_ERROR_LEVEL: Final = 1e-3
"""p-value of the F test below which residuals are more than noise: chance does that in one of a thousand
campaigns."""
_RIGID: Final = 6
"""Number of coordinates of a rigid displacement."""
_RESOLUTION: Final = 1e-8
"""Residual of a coordinate [m] that is taken for rounding."""


@dataclass(frozen=True)
class PureError:
    """Noise of the readings, and what a model leaves unexplained of the flange's motion."""

    sigma: float  #: standard deviation of a coordinate of a reading, whatever the model [m]
    left: float  #: the same from the residuals that a motion of the flange could explain [m]
    p_value: float  #: of the F test that both are the same

    @property
    def shows_motion(self) -> bool:
        """True if the model leaves more of the flange's motion unexplained than the noise allows."""
        return self.p_value < PURE_ERROR_LEVEL


def compute_pure_error(rows: Rows, residual: FloatArray, unknowns: float) -> PureError | None:
    """Separate the residuals of a model into noise and unexplained motion of the flange.

    Args:
        rows: N observations; errors that targets share are part of what may move the flange.
        residual: (N, T, 3) residuals of the model, axes of R0 [m].
        unknowns: number of unknowns that were fitted.

    Returns:
        None without postures of three targets that form a triangle, or without degrees of freedom.
    """
    measurements = rows.measurements
    has_triangle = (measurements.coordinates == 3).sum(axis=1) >= MIN_TARGETS
    if measurements.direction is not None or not has_triangle.any():
        return None
    usable = np.flatnonzero(has_triangle)
    part = rows.at(None)[usable]
    try:
        squares = _split_residual_squares(part, residual[usable])
    except UnsupportedMethodError:  # targets on a line do not show the whole motion
        return None
    # All unknowns are subtracted from the motion's, also those that observations with few targets determine.
    freedom = _SplitFreedom(
        motion=_RIGID * len(part) - unknowns,
        noise=float(part.measurements.coordinates.sum()) - _RIGID * len(part),
    )
    return _compare_variances(squares, freedom)


class _SplitSquares(NamedTuple):
    """Sums of squared residuals [m²]."""

    motion: float  # of the part that a rigid motion of the flange could cause
    noise: float  # of the rest


class _SplitFreedom(NamedTuple):
    """Degrees of freedom of the two parts of the residuals.

    For example ten postures of four targets have 120 coordinates: 60 of motion, and 60 of noise alone.
    """

    motion: float
    noise: float


def _compare_variances(squares: _SplitSquares, freedom: _SplitFreedom) -> PureError | None:
    """Compare the variances of the two parts by an F test; None where one has no degree of freedom."""
    if freedom.noise < 1.0 or freedom.motion < 1.0:
        return None
    noise_variance = max(squares.noise, 0.0) / freedom.noise + _RESOLUTION**2
    motion_variance = squares.motion / freedom.motion + _RESOLUTION**2
    variance_ratio = motion_variance / noise_variance
    return PureError(
        sigma=float(np.sqrt(noise_variance)),
        left=float(np.sqrt(motion_variance)),
        p_value=float(special.fdtrc(freedom.motion, freedom.noise, variance_ratio)),
    )


def _split_residual_squares(rows: Rows, residual: FloatArray) -> _SplitSquares:
    """Return the sum of squared residuals that a rigid motion of the flange could cause, and the other sum.

    The residuals of an observation are projected on the six directions in which a rigid motion moves its
    targets.

    Args:
        rows: N observations of at least three targets.
        residual: (N, T, 3) residuals of the model, axes of R0 [m].

    Raises:
        UnsupportedMethodError: the targets of an observation are on a line.
    """
    motion_squares = noise_squares = 0.0
    start = 0
    for block in rows.generate_blocks():
        stop = start + len(block.torque)
        # Scale the residuals so that their noise is uncorrelated, with variance sigma².
        whitened = block.whiten(residual[start:stop, ..., None])
        whitened = whitened.reshape(stop - start, -1)  # (b, 3 T)
        motion_directions = factorise_displacement(block).Q  # (b, 3 T, 6) orthonormal columns
        motion_part = np.einsum("bri,br->bi", motion_directions, whitened)  # (b, 6)
        squares_along_motion = float(np.square(motion_part).sum())
        motion_squares += squares_along_motion
        noise_squares += float(np.square(whitened).sum()) - squares_along_motion
        start = stop
    return _SplitSquares(motion_squares, noise_squares)
