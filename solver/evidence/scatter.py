"""Errors that are new in every posture and that its targets share: repeatability, and the tracker's station.

Robots return to 30 to 60 µm, and the error of a tracker's station is the same for all targets of a posture:
three targets with one error are one reading. The deflections of a posture are
``d_i = A_i c + J_i δ_i + t_i + ε_i`` with turns ``δ_i ~ N(0, s² I)`` of the joints and a shift
``t_i ~ N(0, u² I)`` of all targets. The ratios ρ = s/σ and τ = u/σ maximise the restricted likelihood, which
accounts for the residuals that the fit of c takes away (Patterson & Thompson, *Biometrika* 58, 1971):

    −log L = ½ (Σ log|V_i| + Σ r_iᵀ V_i⁻¹ r_i / σ² + log|Σ A_iᵀ V_i⁻¹ A_i|)
    V_i = Σ_i + ρ² J_i J_iᵀ + τ² 1 1ᵀ.

A ρ that is not stated, and τ, are zero unless a likelihood ratio test is significant. Zero is a bound of
each ratio, so that the statistic has the distribution ¼ χ²₀ + ½ χ²₁ + ¼ χ²₂ (Self & Liang, *J. Am. Stat.
Assoc.* 82, 1987).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy import special
from scipy.optimize import Bounds, minimize

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.fit.statements import list_stated_terms
from jointstiff.solver.fit.triangle import (
    INDEPENDENT,
    orthonormal_basis,
    unit_columns,
)
from jointstiff.solver.mechanics.block import (
    RegressorBlock,
    fitted_errors,
)
from jointstiff.solver.mechanics.measurements import Scatter
from jointstiff.solver.mechanics.springs import JOINTS

SCATTER_LEVEL: Final = 0.01
"""Significance level of the test for shared errors: of campaigns without any, one in a hundred gets wider
intervals for nothing."""
LARGEST_REPEATABILITY: Final = 2e-4
"""Motion of a target by shared errors [m] beyond that of any industrial robot in order: larger residuals are
a mistake, or something besides the joints bends."""
_START_VARIANCES: Final = (0.0, 0.1, 1.0, 10.0, 1e3)
"""Variances of the shared errors from which the search starts, relative to the noise of the readings."""
_MOST_VARIANCE: Final = 1e5
_RESOLUTION: Final = 1e-7
"""Residual of a coordinate [m] that is taken for rounding."""
_MOST_OBSERVATIONS: Final = 100
"""Number of observations that suffice to estimate shared errors."""
_LEAST_DEGREES_OF_FREEDOM: Final = 3
_GROSS: Final = 10.0
"""Mean square of a posture's residuals, relative to the median posture's, above which the posture is left
out: a single wrong reading must not widen all intervals."""
_BY_CHANCE: Final = 1e-5
"""Probability with which noise alone exceeds the limit where a posture has so few coordinates that the limit
is raised."""
_STEP: Final = 1e-8
"""Step of the differences of the likelihood, relative to a variance or to the noise of the readings."""


def find_scatter(rows: Rows, estimate: Estimate) -> Scatter:
    """Return the errors that all targets of a posture share: as stated, or as the residuals show them.

    The stated errors are returned if the residuals do not show more significantly, or if they show more
    than a robot in order has. Encoders see the same turns of the joints, which their rows do not account for:
    with encoders nothing is estimated.

    Args:
        rows: N observations, which may state the repeatability.
        estimate: estimate by joints alone, fitted to these observations.
    """
    measurements = rows.measurements
    if measurements.encoders is not None:
        return measurements.scatter
    tested = rows.select_evenly(_MOST_OBSERVATIONS).at(estimate.balanced)
    terms = [JOINTS, *fitted_errors(measurements).terms, *list_stated_terms(measurements)]
    try:
        stack = tested.stack(terms, np.maximum(estimate.compliance, 0.0))
    except SolverError:  # no balance under the load: the assessment reports that elsewhere
        return measurements.scatter
    joints, *other_spans = stack.span.values()
    fitted = np.concatenate([joints[~estimate.observability.null], *other_spans])
    likelihood = RestrictedLikelihood(tested.block, stack, fitted)
    scatter, p_value = likelihood.find_significant()
    motion = compute_target_motion(tested.block, scatter, measurements.sigma or likelihood.sigma(scatter))
    if p_value < SCATTER_LEVEL and motion <= LARGEST_REPEATABILITY:
        return scatter
    if measurements.repeatability and measurements.sigma is None:
        # The likelihood tells how large sigma is next to the repeatability that is stated.
        return Scatter(joints=scatter.joints)
    return measurements.scatter


def compute_target_motion(block: RegressorBlock, scatter: Scatter, sigma: float) -> float:
    """Return the root mean square length [m] by which errors that targets share move the targets.

    Args:
        block: observations of the targets.
        scatter: standard deviations of the shared errors, in units of sigma.
        sigma: standard uncertainty of a coordinate of a reading [m].
    """
    squared_motion_by_joints = np.square(block.jacobian[block.measurements.present]).sum(axis=(1, 2)).mean()
    return sigma * float(np.sqrt(scatter.joints**2 * squared_motion_by_joints + 3.0 * scatter.station**2))


@dataclass(frozen=True)
class Repeatability:
    """Shared errors of a posture's targets, as stated or as the residuals show them."""

    joint: float  #: standard deviation of a joint's angle from one posture to the next [rad]
    targets: float  #: root mean square motion of the targets by all shared errors [m]
    source: Literal["given", "residuals"]

    @classmethod
    def from_rows(cls, rows: Rows, sigma: float | None) -> Repeatability | None:
        """Return the repeatability that a fit accounted for; None if there is none.

        Args:
            rows: N observations, with the scatter of the fit.
            sigma: standard uncertainty of a coordinate of a reading [m], as stated or estimated by the fit.
        """
        scatter = rows.measurements.scatter
        if not (scatter and sigma):
            return None
        block = rows.at(None).select_evenly(_MOST_OBSERVATIONS).block
        stated = rows.measurements.repeatability
        return cls(
            joint=scatter.joints * sigma if stated is None else stated,
            targets=compute_target_motion(block, scatter, sigma),
            source="residuals" if stated is None else "given",
        )


class RestrictedLikelihood:
    """Restricted likelihood of the shared errors of a campaign, given sigma or maximised over sigma."""

    def __init__(self, block: RegressorBlock, stack: Stack, fitted: IndexArray) -> None:
        """Choose the observations and columns.

        Args:
            block: the observations.
            stack: rows of these observations, whitened by the readings' own noise.
            fitted: columns of the unknowns that are fitted.
        """
        columns, last = stack.rows[..., fitted], stack.rows[..., -1:]
        # The likelihood depends on the columns' span alone; dependent columns would make it rounding.
        unit = orthonormal_basis(unit_columns(columns.reshape(-1, columns.shape[-1]))[0])
        # Residuals of a first fit: they change no likelihood, but avoid the rounding of large deflections.
        fit = np.linalg.lstsq(unit, last.reshape(-1), rcond=INDEPENDENT)[0]
        residual = last[..., 0] - (unit @ fit).reshape(last.shape[:2])
        squares = np.square(residual).sum(axis=1) / np.maximum(stack.read, 1)
        # The fewer coordinates a posture has, the further its mean square spreads by chance.
        freedom = np.maximum(stack.read, 1)
        typical = special.chdtri(freedom, 0.5) / freedom
        beyond = np.maximum(_GROSS, special.chdtri(freedom, _BY_CHANCE) / special.chdtri(freedom, 0.5))
        used = squares / typical <= beyond * np.median(squares / typical)
        by_joints, by_station = block.shared_motion
        motion = np.concatenate([by_joints, by_station], axis=-1)[used]
        rows = np.concatenate([unit.reshape(*columns.shape[:2], -1), residual[..., None]], axis=-1)[used]
        self._joint_count: int = by_joints.shape[-1]
        self._motion_products = motion.mT @ motion
        self._motion_rows = motion.mT @ rows
        self._row_products = (rows.mT @ rows).sum(axis=0)
        self._measurements = block.measurements
        self._degrees_of_freedom: int = int(stack.read[used].sum()) - unit.shape[-1]
        # Ratio ρ with which turns of the joints move the targets as far as the noise of the readings does.
        self._turns_like_noise: float = 1.0 / max(
            float(np.linalg.norm(by_joints) / np.sqrt(by_joints[..., 0].size)), 1e-12
        )
        # With one target, a shift of all targets cannot be distinguished from the noise of this target.
        self._can_show_station = bool((self._measurements.present.sum(axis=1) > 1).any())

    def find_significant(self) -> tuple[Scatter, float]:
        """Return (most likely shared errors, p-value of the test that there are none).

        A repeatability that is stated is not tested. With one target the turns of the joints hardly differ
        from noise, so that they also have to explain more than a larger sigma does.
        """
        scatter, likelihood_gain = self.fit_shared_errors()
        if likelihood_gain <= 0.0:
            return scatter, 1.0
        if self._measurements.repeatability is not None:
            return scatter, 0.5 * float(special.chdtrc(1, likelihood_gain))
        p_value = 0.5 * float(special.chdtrc(1, likelihood_gain)) + 0.25 * float(
            special.chdtrc(2, likelihood_gain)
        )
        if not self._can_show_station and self._measurements.sigma is not None:
            likelihood_gain = 2.0 * (
                self._minus_log_likelihood_at_free_sigma()
                - float(self._minus_log_likelihoods(np.array([self._variances(scatter)]))[0])
            )
            p_value = max(p_value, 0.5 * float(special.chdtrc(1, max(likelihood_gain, 0.0))))
        return scatter, p_value

    def fit_shared_errors(self) -> tuple[Scatter, float]:
        """Fit the errors that all targets of a posture share; return (errors, likelihood ratio statistic).

        The statistic is 2 (log L − log L₀): L is the greatest likelihood of the residuals, L₀ the likelihood
        without shared errors, but with a stated repeatability.
        """
        if self._degrees_of_freedom < _LEAST_DEGREES_OF_FREEDOM:
            return self._measurements.scatter, 0.0
        stated_repeatability, sigma = self._measurements.repeatability, self._measurements.sigma
        start_joint_variances: tuple[float, ...] = _START_VARIANCES
        bounds = [(0.0, _MOST_VARIANCE), (0.0, _MOST_VARIANCE if self._can_show_station else 0.0)]
        if stated_repeatability is not None and (sigma is not None or stated_repeatability == 0.0):
            start_joint_variances = ((stated_repeatability / (sigma or 1.0) / self._turns_like_noise) ** 2,)
            bounds[0] = start_joint_variances[0], start_joint_variances[0]
        start_station_variances = _START_VARIANCES if self._can_show_station else (0.0,)
        starts = np.array([*product(start_joint_variances, start_station_variances)])
        start = starts[int(self._minus_log_likelihoods(starts).argmin())]
        lower, upper = np.transpose(bounds)
        optimum = minimize(
            self._value_and_gradient,
            start,
            args=(lower, upper),
            jac=True,
            method="L-BFGS-B",
            bounds=Bounds(lower, upper),
        )
        candidates = np.array([optimum.x, start, (lower[0], 0.0)])
        values = self._minus_log_likelihoods(candidates)
        best_variances = candidates[int(values[:2].argmin())]
        gain = 2.0 * float(values[2] - values[:2].min())
        scatter = self._scatter(best_variances)
        if len(start_joint_variances) == 1:  # as stated, without the rounding of a root
            scatter = replace(
                scatter, joints=0.0 if stated_repeatability is None else stated_repeatability / (sigma or 1.0)
            )
        return scatter, max(gain, 0.0)

    def sigma(self, scatter: Scatter) -> float:
        """Return sigma of the readings [m], estimated from the residuals for given shared errors."""
        fit = self._fit(np.array([self._variances(scatter)]))
        return float(np.sqrt(fit.squares[0] / max(self._degrees_of_freedom, 1)))

    def _variances(self, scatter: Scatter) -> tuple[float, float]:
        """Return the variances (joints, station) of shared errors, relative to the noise of the readings."""
        return (scatter.joints / self._turns_like_noise) ** 2, scatter.station**2

    def _minus_log_likelihood_at_free_sigma(self) -> float:
        """Return −log L without shared errors, maximised over sigma, up to the same constant."""
        fit = self._fit(np.zeros((1, 2)))
        squares = self._degrees_of_freedom * (np.log(fit.squares[0] / self._degrees_of_freedom) + 1.0)
        return float(fit.half_log_determinant[0] + 0.5 * squares)

    def _scatter(self, variances: tuple[float, ...] | FloatArray) -> Scatter:
        """Return the shared errors of given variances (joints, station), relative to the readings' noise."""
        joints, station = np.sqrt(np.asarray(variances)).tolist()
        return Scatter(self._turns_like_noise * joints, station)

    def _value_and_gradient(
        self, variances: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> tuple[float, list[float]]:
        """Return −log L at variances (2,) and its gradient (2,) by differences within the bounds."""
        step = _STEP * np.maximum(1.0, np.abs(variances))
        step = np.where((lower < upper) & (variances + step > upper), -step, step)
        values = self._minus_log_likelihoods(np.vstack([variances, variances + np.diag(step)]))
        gradient = np.where(lower == upper, 0.0, (values[1:] - values[0]) / step)
        return float(values[0]), gradient.tolist()

    def _minus_log_likelihoods(self, variances: FloatArray) -> FloatArray:
        """Return −log L (K,) of shared errors with variances (K, 2) of joints and station, up to a constant.

        L is the likelihood of the residuals; variances are relative to the noise of the readings.
        """
        fit = self._fit(variances)
        free = self._degrees_of_freedom * np.log(fit.squares)
        sigma = self._stated_sigma(variances)
        is_free = np.isnan(sigma)
        sigma = np.where(is_free, 1.0, sigma)
        stated = fit.squares / sigma**2 + 2.0 * self._degrees_of_freedom * np.log(sigma)
        return fit.half_log_determinant + 0.5 * (fit.log_variance + np.where(is_free, free, stated))

    def _stated_sigma(self, variances: FloatArray) -> FloatArray:
        """Return sigma (K,) [m] as stated, or from the stated repeatability; NaN where sigma is free."""
        sigma, repeatability = self._measurements.sigma, self._measurements.repeatability
        if sigma is not None or not repeatability:
            return np.full(len(variances), np.nan if sigma is None else sigma)
        joints = self._turns_like_noise * np.sqrt(variances[:, 0])
        return np.where(joints > 0.0, repeatability / np.where(joints > 0.0, joints, 1.0), np.nan)

    def _fit(self, variances: FloatArray) -> _Fit:
        """Fit the unknowns to rows that are whitened by noise and shared errors of variances (K, 2).

        The shared errors of a posture have n + 3 directions G_i. By ``V_i⁻¹ = I − G_i (I + G_iᵀ G_i)⁻¹ G_iᵀ``
        a posture with many targets costs no more than a posture with one.
        """
        scale = np.sqrt(variances) * (self._turns_like_noise, 1.0)
        scale = np.repeat(scale, (self._joint_count, 3), axis=1)[:, None, :, None]
        covariance = np.eye(scale.shape[2]) + scale * self._motion_products * scale.mT
        root = np.linalg.cholesky(covariance)
        shared = np.linalg.solve(root, scale * self._motion_rows)
        products = self._row_products - (shared.mT @ shared).sum(axis=1)
        factor = np.linalg.cholesky(products[:, :-1, :-1])
        explained = np.square(np.linalg.solve(factor, products[:, :-1, -1:])).sum(axis=(1, 2))
        return _Fit(
            squares=np.maximum(products[:, -1, -1] - explained, 0.0)
            + self._degrees_of_freedom * _RESOLUTION**2,
            half_log_determinant=np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1),
            log_variance=2.0 * np.log(np.diagonal(root, axis1=2, axis2=3)).sum(axis=(1, 2)),
        )


class _Fit(NamedTuple):
    """Fit of the unknowns for each of K pairs of variances."""

    squares: FloatArray  #: (K,) sum of squared residuals, with an allowance for rounding
    half_log_determinant: FloatArray  #: (K,) ½ log|Σ A_iᵀ V_i⁻¹ A_i|
    log_variance: FloatArray  #: (K,) Σ log|V_i|
