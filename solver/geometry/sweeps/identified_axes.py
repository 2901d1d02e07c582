"""All axes of a robot in one configuration, with their joint covariance.

That is the robot's geometry. Base frame, wrist centre, link lengths and the kinematic model are functions of
it, and their uncertainties follow from its one covariance, correlations included.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry.sweeps.axis import CHART_SIZE, Axis, rotation_about

Geometry = Callable[[Sequence[Axis], FloatArray], FloatArray]
"""A quantity (k,) as a function of the n axes and the targets (T, 3), both at model angle zero."""

_HIDDEN = 1e-6  # share of a quantity in unseen combinations, above which it is not determined
_STEP = 1e-6  # of the difference quotients [m, rad]: both truncation and rounding are some 1e-10


@dataclass(frozen=True, eq=False)
class IdentifiedAxes:
    """Axes and targets at model angle zero, in the tracker's frame."""

    axes: tuple[Axis, ...]  #: n, base first
    targets: FloatArray  #: (T, 3) [m], carried by the last axis
    names: tuple[str, ...]  #: names of the targets
    covariance: FloatArray  #: (4 n + 3 T, 4 n + 3 T) covariance of the axes' charts, then the targets
    influence: FloatArray  #: (4 n + 3 T, m) derivative by all whitened readings in units of sigma
    sigma: float  #: standard uncertainty of a coordinate [m], stated or pooled from the residuals
    rss: float  #: sum of squares of the residuals, whitened in units of sigma² [m²]
    dof: int  #: degrees of freedom behind it
    #: (4 n + 3 T, r) combinations of charts and targets that the readings do not determine; they are as at
    #: the start of the fit, and the covariance is silent about them
    unseen: FloatArray = field(default_factory=lambda: np.zeros((0, 0)), kw_only=True)

    @property
    def n(self) -> int:
        """Number of axes."""
        return len(self.axes)

    @property
    def variance_factor(self) -> float:
        """χ²/dof: 1 on average if sigma was stated and is right; 1 if it was not stated."""
        return self.rss / (self.dof * self.sigma**2)

    def axis_covariance(self, joint: int) -> FloatArray:
        """Covariance (4, 4) of one axis's chart at model angle zero."""
        part = slice(CHART_SIZE * joint, CHART_SIZE * (joint + 1))
        return self.covariance[part, part]

    def jacobian_of(self, geometry: Geometry) -> FloatArray:
        """Derivative (k, 4 n + 3 T) of a quantity, by central differences."""
        return derivative(self.axes, self.targets, geometry)

    def covariance_of(self, geometry: Geometry) -> FloatArray:
        """Covariance (k, k) of a quantity."""
        J = self.jacobian_of(geometry)
        return np.asarray(J @ self.covariance @ J.T)

    def standard_uncertainties(self, jacobian: FloatArray) -> FloatArray:
        """Return those of quantities with this derivative (k, 4 n + 3 T): (k,), infinite if undetermined."""
        spread = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian))
        if not self.unseen.size:
            return np.asarray(spread)
        hidden = np.abs(jacobian @ self.unseen).max(axis=1)
        reach = np.linalg.norm(jacobian, axis=1) * np.linalg.norm(self.unseen, axis=0).max()
        return np.where(hidden > _HIDDEN * reach, np.inf, spread)


def posed(axes: Sequence[Axis], angles: npt.ArrayLike) -> tuple[tuple[Axis, ...], FloatArray, FloatArray]:
    """Axes in a posture, and the motion of what the last one carries.

    Args:
        axes: n at angle zero.
        angles: (n,) of the model [rad].

    Returns:
        The n axes, and the rotation (3, 3) and translation (3,) [m] with which a point of the flange
        moves from its place at angle zero.
    """
    R, t = np.eye(3), np.zeros(3)
    out = []
    for axis, angle in zip(axes, np.asarray(angles, dtype=np.float64), strict=True):
        out.append(axis.moved(R, t))
        turn, shift = rotation_about(axis, float(angle))
        t = R @ shift + t
        R = R @ turn
    return tuple(out), R, t


def derivative(axes: Sequence[Axis], targets: FloatArray, geometry: Geometry) -> FloatArray:
    """Derivative (k, 4 n + 3 T) of a quantity by charts and targets (T, 3), by central differences."""

    def at(step: FloatArray) -> FloatArray:
        charts = step[: CHART_SIZE * len(axes)].reshape(-1, CHART_SIZE)
        moved = [a.displaced(chart) if chart.any() else a for a, chart in zip(axes, charts, strict=True)]
        return geometry(moved, targets + step[CHART_SIZE * len(axes) :].reshape(targets.shape))

    steps = _STEP * np.eye(CHART_SIZE * len(axes) + targets.size)
    return np.stack([(at(step) - at(-step)) / (2.0 * _STEP) for step in steps], axis=1)
