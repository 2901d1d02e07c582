"""Repeatability of the joints: a turn of each joint that is new in every posture, and common to its targets.

Robots return to 30 to 60 µm, and the error of a tracker's station is the same for all targets of a posture:
three targets with one error are one reading. The deflections of a posture are ``d_i = A_i c + J_i δ_i + ε_i``
with turns ``δ_i ~ N(0, s² I)`` of the joints. The ratio ρ = s/σ maximises the restricted likelihood, which
accounts for the residuals that the fit of c takes away (Patterson & Thompson, *Biometrika* 58, 1971):

    −log L = ½ (Σ log|V_i| + Σ r_iᵀ V_i⁻¹ r_i / σ² + log|Σ A_iᵀ V_i⁻¹ A_i|),   V_i = Σ_i + ρ² J_i J_iᵀ.

ρ cannot be negative. It is zero unless a likelihood ratio test is significant; zero is a bound, so that half
of all campaigns without scatter have their maximum there (Self & Liang, *J. Am. Stat. Assoc.* 82, 1987).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy import special
from scipy.optimize import minimize_scalar

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.estimation.estimate import Estimate
from jointstiff.solver.estimation.stack import Stack
from jointstiff.solver.estimation.triangle import INDEPENDENT, compute_triangular_factor, unit_columns
from jointstiff.solver.mechanics.block import RegressorBlock, whole_block
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import JOINTS

REPEATABILITY_LEVEL: Final = 0.01
"""Significance level of the test that the joints repeat exactly: of campaigns whose joints do, one in a
hundred gets wider intervals for nothing."""
LARGEST_REPEATABILITY: Final = 2e-4
"""Motion of a target by the scatter of the joints [m] beyond that of any industrial robot in order: larger
residuals are a mistake, or something besides the joints bends."""
_DECADES: Final = (-1.5, 2.5)
"""Range of ρ that is searched, as decimal logarithms relative to the ρ that moves targets as far as noise."""
_GRID: Final = 17
_RESOLUTION: Final = 1e-7
"""Residual of a coordinate [m] that is taken for rounding."""
_MOST_OBSERVATIONS: Final = 500
"""Number of observations that suffice to estimate the scatter."""
_LEAST_FREEDOM: Final = 2
_GROSS: Final = 10.0
"""Mean square of a posture's residuals, relative to the median posture's, above which the posture is left
out: a single wrong reading must not widen all intervals."""


def find_joint_scatter(robot: Robot, measurements: Measurements, estimate: Estimate) -> float:
    """Return the standard deviation of each joint's angle from posture to posture, in units of sigma [rad/m].

    The scatter is the one stated, or else the one that the residuals show; 0 if they show none, or more than
    a robot in order has.

    Args:
        robot: n joints.
        measurements: N observations, which may state the repeatability.
        estimate: estimate by joints alone, fitted to these measurements.
    """
    stated = measurements.repeatability
    if stated == 0.0 or (stated is not None and measurements.sigma is not None):
        return stated / (measurements.sigma or 1.0)
    part = measurements.select_evenly(_MOST_OBSERVATIONS)
    try:
        block = whole_block(robot, part, estimate.balanced)
    except SolverError:  # no balance under the load: the assessment reports that elsewhere
        return 0.0
    stack = Stack.from_blocks([block], [JOINTS], estimate.compliance)
    likelihood = RestrictedLikelihood(block, stack, np.flatnonzero(~estimate.observability.null))
    ratio, gain = likelihood.maximise()
    if stated is not None:
        return ratio
    significant = 0.5 * special.chdtrc(1, gain) < REPEATABILITY_LEVEL
    motion = ratio * (measurements.sigma or likelihood.sigma(ratio)) * reach_of_scatter(block)
    return ratio if significant and motion <= LARGEST_REPEATABILITY else 0.0


@dataclass(frozen=True)
class Repeatability:
    """Repeatability of a robot, as stated or as the residuals show it."""

    joint: float  #: standard deviation of a joint's angle from one posture to the next [rad]
    targets: float  #: root mean square motion of the targets by that scatter of all joints [m]
    source: Literal["given", "residuals"]

    @classmethod
    def from_measurements(
        cls, robot: Robot, measurements: Measurements, sigma: float | None
    ) -> Repeatability | None:
        """Return the repeatability that a fit accounted for; None if there is none.

        Args:
            robot: n joints.
            measurements: N observations, with the joint scatter of the fit.
            sigma: standard uncertainty of a coordinate of a reading [m], as stated or estimated by the fit.
        """
        if not (measurements.joint_scatter and sigma):
            return None
        joint = measurements.joint_scatter * sigma
        block = whole_block(robot, measurements.select_evenly(_MOST_OBSERVATIONS))
        source: Literal["given", "residuals"] = "residuals" if measurements.repeatability is None else "given"
        return cls(joint, joint * reach_of_scatter(block), source)


def reach_of_scatter(block: RegressorBlock) -> float:
    """Return the root mean square motion of a target for a scatter of the joints of one radian [m/rad]."""
    motion = block.jacobian[block.measurements.present]
    return float(np.sqrt(np.square(motion).sum(axis=(1, 2)).mean()))


class RestrictedLikelihood:
    """Restricted likelihood of the ratio ρ of a campaign, given sigma or maximised over sigma."""

    def __init__(self, block: RegressorBlock, stack: Stack, fitted: IndexArray) -> None:
        """Choose the observations and columns.

        Args:
            block: the observations, whose measurements have no joint scatter.
            stack: rows of these observations, whitened by the readings' own noise.
            fitted: columns of the unknowns that are fitted.
        """
        columns, last = stack.rows[..., fitted], stack.rows[..., -1:]
        unit = unit_columns(columns.reshape(-1, columns.shape[-1]))[0]
        # Residuals of a first fit: the likelihood does not depend on it, but the logarithm of squares does.
        fit = np.linalg.lstsq(unit, last.reshape(-1), rcond=INDEPENDENT)[0]
        residual = last[..., 0] - (unit @ fit).reshape(last.shape[:2])
        squares = np.square(residual).sum(axis=1) / np.maximum(stack.read, 1)
        used = squares <= _GROSS * np.median(squares)
        directions, lengths = block.scatter
        self._rows = np.concatenate([unit.reshape(columns.shape), residual[..., None]], axis=-1)[used]
        self._directions, self._lengths = directions[used], lengths[used]
        self._along = self._directions.mT @ self._rows
        measurements = block.measurements
        self._sigma, self._repeatability = measurements.sigma, measurements.repeatability
        self._freedom: int = int(stack.read[used].sum()) - columns.shape[-1]
        # Ratio at which turns of the joints move the targets as far as the readings' noise.
        self._unit: float = 1.0 / max(float(np.sqrt(np.mean(np.square(self._lengths)))), 1e-12)

    def maximise(self) -> tuple[float, float]:
        """Return the most likely ratio ρ [rad/m], and twice the gain of log L over that of ρ = 0."""
        if self._freedom < _LEAST_FREEDOM:
            return 0.0, 0.0
        decades = np.linspace(*_DECADES, _GRID)
        best, step = int(np.argmin([self._at_decade(each) for each in decades])), decades[1] - decades[0]
        bounds = (decades[best] - step, decades[best] + step)
        refined = minimize_scalar(self._at_decade, bounds=bounds, method="bounded")
        gain = 2.0 * (self._at(0.0) - float(refined.fun))
        return (float(self._unit * 10.0**refined.x), gain) if gain > 0.0 else (0.0, 0.0)

    def sigma(self, ratio: float) -> float:
        """Return sigma of the readings as the residuals show it for a ratio [m]."""
        return float(np.sqrt(self._squares(self._whiten(ratio)) / max(self._freedom, 1)))

    def _at_decade(self, decade: float) -> float:
        """Return −log L of the ratio ``unit · 10**decade``, less a constant."""
        return self._at(float(self._unit * 10.0**decade))

    def _at(self, ratio: float) -> float:
        """Return −log L of a ratio [rad/m], less a constant."""
        R = self._whiten(ratio)
        singular = np.linalg.svd(R[:, :-1], compute_uv=False)
        determined = np.log(singular[singular > INDEPENDENT * singular.max(initial=0.0)]).sum()
        squares = self._squares(R)
        sigma = self._repeatability / ratio if self._repeatability and ratio else self._sigma
        if sigma is None:
            fit = self._freedom * np.log(squares)
        else:
            fit = squares / sigma**2 + 2.0 * self._freedom * np.log(sigma)
        variance = np.log1p(np.square(ratio * self._lengths)).sum()
        return float(0.5 * variance + determined + 0.5 * fit)

    def _whiten(self, ratio: float) -> FloatArray:
        """Return the triangular factor of the rows, whitened with a ratio [rad/m]."""
        less = 1.0 - 1.0 / np.sqrt(1.0 + np.square(ratio * self._lengths))
        rows = self._rows - self._directions @ (less[..., None] * self._along)
        return compute_triangular_factor(rows.reshape(-1, rows.shape[-1]))

    def _squares(self, R: FloatArray) -> float:
        """Return the sum of squared residuals of a triangular factor; rounding counts as a residual."""
        return float(R[-1, -1] ** 2) + self._freedom * _RESOLUTION**2
