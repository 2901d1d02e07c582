"""Pure error: noise of the tracker, from coordinates that no motion of the flange touches (method.md §3).

A rigid displacement of the flange has six coordinates. Of the 3 T coordinates of a posture with T ≥ 3 targets
3 T − 6 remain the same whatever bends, turns or shifts: their residuals show the noise of the readings alone.
An F test compares the residuals in the other six with that noise (lack of fit; Draper & Smith, *Applied
Regression Analysis*, ch. 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

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
    usable = np.flatnonzero((measurements.coordinates == 3).sum(axis=1) >= MIN_TARGETS)
    if measurements.direction is not None or not len(usable):
        return None
    part, residual = rows.at(None)[usable], residual[usable]
    pure = rigid = 0.0
    start = 0
    try:
        for block in part.generate_blocks():
            stop = start + len(block.torque)
            white = block.whiten(residual[start:stop, ..., None]).reshape(stop - start, -1)
            along = np.einsum("bri,br->bi", factorise_displacement(block)[0], white)
            rigid += float(np.square(along).sum())
            pure += float(np.square(white).sum() - np.square(along).sum())
            start = stop
    except UnsupportedMethodError:  # targets on a line do not show the whole motion
        return None
    freedom = float(part.measurements.coordinates.sum()) - _RIGID * len(part)
    # The unknowns take away only from what moves the flange; those of few targets count here as well.
    freedom_of_motion = _RIGID * len(part) - unknowns
    if freedom < 1.0 or freedom_of_motion < 1.0:
        return None
    noise = max(pure, 0.0) / freedom + _RESOLUTION**2
    left = rigid / freedom_of_motion + _RESOLUTION**2
    return PureError(
        sigma=float(np.sqrt(noise)),
        left=float(np.sqrt(left)),
        p_value=float(special.fdtrc(freedom_of_motion, freedom, left / noise)),
    )
