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

Encoders behind the gearboxes see the same turns δ_i: their rows are further rows of J_i. The noise of each
encoder, r_j times the stated noise with r_j ≥ 1, maximises the same likelihood, with and without shared
errors: a gear's play or an eccentric encoder is no part of what a data sheet states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy import special
from scipy.optimize import Bounds, minimize

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
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
    Term,
    fitted_errors,
)
from jointstiff.solver.mechanics.measurements import Measurements, Scatter
from jointstiff.solver.mechanics.springs import JOINTS

SCATTER_LEVEL: Final = 0.01
"""Significance level of the test for shared errors: of campaigns without any, one in a hundred gets wider
intervals for nothing."""
LARGEST_REPEATABILITY: Final = 2e-4
"""Motion of a target by shared errors [m] beyond that of any industrial robot in order: larger residuals are
a mistake, or something besides the joints bends."""
_LARGEST_ENCODER_NOISE: Final = 1e-4
"""Noise of an encoder's angle [rad] beyond that of gears and encoders in order: larger residuals are a
mistake, and the noise is as stated."""
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
_AT_BOUND: Final = 1e-3
"""Relative distance from the greatest logarithm within which a noise is that of a mistake."""
_STEP: Final = 1e-8
"""Step of the differences of the likelihood, relative to a variance or to the noise of the readings."""


def find_scatter(rows: Rows, estimate: Estimate) -> Scatter:
    """Return the errors that all targets of a posture share: as stated, or as the residuals show them.

    The stated errors are returned if the residuals do not show more significantly, or if they show more
    than a robot in order has. The noise of each encoder is at least the stated noise. The decoupled method
    fits joints apart whose readings would depend on each other, so that it has no turns that encoders see.

    Args:
        rows: N observations, which may state the repeatability.
        estimate: estimate by joints alone, fitted to these observations.
    """
    measurements = rows.measurements
    by_stages = measurements.encoders is not None and len(estimate.compressed.method.stages) > 1
    if by_stages and measurements.scatter:
        return measurements.scatter
    tested = rows.select_evenly(_MOST_OBSERVATIONS).at(estimate.balanced)
    terms = [JOINTS, *fitted_errors(measurements).terms, *list_stated_terms(measurements)]
    try:
        stack = tested.stack(terms, np.maximum(estimate.compliance, 0.0))
    except SolverError:  # no balance under the load: the assessment reports that elsewhere
        return measurements.scatter
    joints, *other_spans = stack.span.values()
    fitted = np.concatenate([joints[~estimate.observability.null], *other_spans])
    likelihood = RestrictedLikelihood(tested.block, stack, fitted, finds_turns=not by_stages)
    scatter = likelihood.find_believable(tested.block)
    if scatter is not None:
        return scatter
    if measurements.encoders is not None:
        return likelihood.without_further_errors
    if measurements.repeatability and measurements.sigma is None:
        # The likelihood tells how large sigma is next to the repeatability that is stated.
        return Scatter(joints=likelihood.fit_shared_errors()[0].joints)
    return measurements.scatter


def find_most_likely_scatter(
    rows: Rows, terms: Sequence[Term], compliance: FloatArray, list_columns: Callable[[int], IndexArray]
) -> Scatter:
    """Return the shared errors and the noise of the encoders that residuals of some terms show.

    Args:
        rows: N observations with readings of encoders.
        terms: terms that are fitted.
        compliance: (n,) compliances at which the columns of errors are computed [rad/(N·m)].
        list_columns: function of the number of all columns that returns those that are fitted.

    Raises:
        SolverError: a load has no balance.
    """
    tested = rows.select_evenly(_MOST_OBSERVATIONS)
    stack = tested.stack(terms, compliance)
    likelihood = RestrictedLikelihood(tested.block, stack, list_columns(stack.rows.shape[-1] - 1))
    return likelihood.find_believable(tested.block) or likelihood.without_further_errors


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

    def __init__(
        self, block: RegressorBlock, stack: Stack, fitted: IndexArray, *, finds_turns: bool = True
    ) -> None:
        """Choose the observations and columns.

        Args:
            block: the observations.
            stack: rows of these observations, whitened by the readings' own noise; those of encoders last.
            fitted: columns of the unknowns that are fitted.
            finds_turns: whether turns of the joints are sought, or are as stated.
        """
        self._finds_turns = finds_turns
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
        rows, of_encoders = rows[:, : motion.shape[1]], rows[:, motion.shape[1] :]
        self._motion_products = motion.mT @ motion
        self._motion_rows = motion.mT @ rows
        self._row_products = (rows.mT @ rows).sum(axis=0)
        self._encoders = _EncoderRows.of(block.measurements, of_encoders, used)
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
        if self._measurements.repeatability is not None or not self._finds_turns:
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

    def find_believable(self, block: RegressorBlock) -> Scatter | None:
        """Return the most likely shared errors; None if chance explains them, or no robot in order has them.

        Args:
            block: the observations.
        """
        scatter, p_value = self.find_significant()
        sigma = self._measurements.sigma or self.sigma(scatter)
        motion = compute_target_motion(block, scatter, sigma)
        return scatter if p_value < SCATTER_LEVEL and motion <= LARGEST_REPEATABILITY else None

    def fit_shared_errors(self) -> tuple[Scatter, float]:
        """Fit the errors that all targets of a posture share; return (errors, likelihood ratio statistic).

        The statistic is 2 (log L − log L₀): L is the greatest likelihood of the residuals, L₀ the greatest
        without shared errors, but with a stated repeatability.
        """
        if self._degrees_of_freedom < _LEAST_DEGREES_OF_FREEDOM:
            return self._measurements.scatter, 0.0
        without = self._without_further_errors
        starts = [
            np.array([joints, station, *noise])
            for joints in self._list_start_variances()
            for station in (_START_VARIANCES if self._can_show_station else (0.0,))
            for noise in self._encoders.list_starts(without[2:])
        ]
        start = starts[int(self._minus_log_likelihoods(np.array(starts)).argmin())]
        lower, upper = self._bounds()
        candidates = np.array([self._minimise(start, lower, upper), start, without])
        values = self._minus_log_likelihoods(candidates)
        best_variances = candidates[int(values[:2].argmin())]
        gain = 2.0 * float(values[2] - values[:2].min())
        return self._scatter(best_variances), max(gain, 0.0)

    @property
    def without_further_errors(self) -> Scatter:
        """Shared errors as stated, with the noise of the encoders that is most likely then."""
        if self._degrees_of_freedom < _LEAST_DEGREES_OF_FREEDOM:
            return self._measurements.scatter
        return self._scatter(self._without_further_errors)

    @cached_property
    def _without_further_errors(self) -> FloatArray:
        """Variances without shared errors, but with a stated repeatability and noise of the encoders."""
        lower, upper = self._bounds()
        upper[:2] = lower[0], 0.0
        first = np.array([lower[0], 0.0, *self._encoders.list_starts()[0]])
        return self._minimise(first, lower, upper) if len(first) > 2 else first

    @property
    def _stated_joint_variance(self) -> float | None:
        """Variance of the joints' turns, where it is known; None where the residuals have to show it."""
        repeatability, sigma = self._measurements.repeatability, self._measurements.sigma
        if not self._finds_turns:
            return 0.0
        if repeatability is not None and (sigma is not None or repeatability == 0.0):
            return float((repeatability / (sigma or 1.0) / self._turns_like_noise) ** 2)
        return None

    def _list_start_variances(self) -> tuple[float, ...]:
        """Return the variances of the joints' turns from which the search starts."""
        stated = self._stated_joint_variance
        return _START_VARIANCES if stated is None else (stated,)

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the least and the greatest variances (2 + m,) of joints, station, and m encoders."""
        stated = self._stated_joint_variance
        joints = (0.0, _MOST_VARIANCE) if stated is None else (stated, stated)
        station = (0.0, _MOST_VARIANCE if self._can_show_station else 0.0)
        lower, upper = np.transpose([joints, station, *self._encoders.bounds])
        return lower, upper

    def _minimise(self, start: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Return the variances of the greatest likelihood within bounds, from a start."""
        optimum = minimize(
            self._value_and_gradient,
            start,
            args=(lower, upper),
            jac=True,
            method="L-BFGS-B",
            bounds=Bounds(lower, upper),
        )
        return np.asarray(optimum.x)

    def sigma(self, scatter: Scatter) -> float:
        """Return sigma of the readings [m], estimated from the residuals for given shared errors."""
        fit = self._fit(np.array([self._variances(scatter)]))
        return float(np.sqrt(fit.squares[0] / max(self._degrees_of_freedom, 1)))

    def _variances(self, scatter: Scatter) -> tuple[float, ...]:
        """Return the variances (joints, station, encoders), relative to the noise of the readings."""
        of_encoders = self._encoders.logarithms(scatter)
        return (scatter.joints / self._turns_like_noise) ** 2, scatter.station**2, *of_encoders

    def _minus_log_likelihood_at_free_sigma(self) -> float:
        """Return −log L without shared errors, maximised over sigma, up to the same constant."""
        fit = self._fit(np.zeros((1, 2 + len(self._encoders.joints))))
        squares = self._degrees_of_freedom * (np.log(fit.squares[0] / self._degrees_of_freedom) + 1.0)
        return float(fit.half_log_determinant[0] + 0.5 * squares)

    def _scatter(self, variances: FloatArray) -> Scatter:
        """Return the errors of given variances (2 + m,), relative to the readings' noise."""
        joints, station = np.sqrt(variances[:2]).tolist()
        turns = self._turns_like_noise * joints
        if self._stated_joint_variance is not None:  # as stated, without the rounding of a root
            turns = (self._measurements.repeatability or 0.0) / (self._measurements.sigma or 1.0)
        return Scatter(turns, station, self._encoders.list_noise(variances[2:]))

    def _value_and_gradient(
        self, variances: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> tuple[float, list[float]]:
        """Return −log L at variances (2 + m,) and its gradient by differences within the bounds."""
        step = _STEP * np.maximum(1.0, np.abs(variances))
        step = np.where((lower < upper) & (variances + step > upper), -step, step)
        values = self._minus_log_likelihoods(np.vstack([variances, variances + np.diag(step)]))
        gradient = np.where(lower == upper, 0.0, (values[1:] - values[0]) / step)
        return float(values[0]), gradient.tolist()

    def _minus_log_likelihoods(self, variances: FloatArray) -> FloatArray:
        """Return −log L (K,) of errors of variances (K, 2 + m): joints, station, encoders; up to constants.

        L is the likelihood of the residuals; variances are relative to the noise of the readings, those of
        encoders as logarithms.
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
        """Fit the unknowns to rows that are whitened by noise and shared errors of variances (K, 2 + m).

        The shared errors of a posture have n + 3 directions G_i. By ``V_i⁻¹ = I − G_i (I + G_iᵀ G_i)⁻¹ G_iᵀ``
        a posture with many targets costs no more than a posture with one.
        """
        scale = np.sqrt(variances[:, :2]) * (self._turns_like_noise, 1.0)
        scale = np.repeat(scale, (self._joint_count, 3), axis=1)[:, None, :, None]
        motion_products, motion_rows, row_products, log_noise = self._encoders.add(
            variances[:, 2:], self._motion_products, self._motion_rows, self._row_products
        )
        covariance = np.eye(scale.shape[2]) + scale * motion_products * scale.mT
        root = np.linalg.cholesky(covariance)
        shared = np.linalg.solve(root, scale * motion_rows)
        products = row_products - (shared.mT @ shared).sum(axis=1)
        factor = np.linalg.cholesky(products[:, :-1, :-1])
        explained = np.square(np.linalg.solve(factor, products[:, :-1, -1:])).sum(axis=(1, 2))
        return _Fit(
            squares=np.maximum(products[:, -1, -1] - explained, 0.0)
            + self._degrees_of_freedom * _RESOLUTION**2,
            half_log_determinant=np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1),
            log_variance=log_noise + 2.0 * np.log(np.diagonal(root, axis1=2, axis2=3)).sum(axis=(1, 2)),
        )


@dataclass(frozen=True, eq=False)
class _EncoderRows:
    """Rows of the encoders of m joints in B postures, whitened by the stated noise; m may be zero."""

    joints: IndexArray  # (m,) joints with an encoder
    count: int  # n, number of joints
    present: FloatArray  # (B, m) 1 where the encoder was read, else 0
    rows: FloatArray  # (B, m, k + 1) fitted columns, then the residual
    by_turn: float  # motion of a whitened row by a turn of its joint [sigma per rad]
    most: float  # greatest logarithm of a noise's variance, relative to the stated one

    @classmethod
    def of(cls, measurements: Measurements, rows: FloatArray, used: BoolArray) -> _EncoderRows:
        """Choose the joints whose encoders were read; `rows` (B, n, k + 1) are those of the postures used."""
        encoders, n = measurements.encoders, measurements.joints.shape[-1]
        if encoders is None:
            none = np.zeros(0, dtype=np.intp)
            return cls(none, n, np.zeros((len(rows), 0)), np.zeros((len(rows), 0, rows.shape[-1])), 0.0, 0.0)
        present = encoders.present[used]
        joints = np.flatnonzero(present.any(axis=0))
        most = 2.0 * np.log(max(_LARGEST_ENCODER_NOISE / encoders.sigma, 1.0))
        by_turn = measurements.encoder_lever / np.sqrt(2.0)
        return cls(joints, n, present[:, joints].astype(float), rows[:, joints], by_turn, float(most))

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Bounds of the logarithm of each variance: a stated noise is the least."""
        return [(0.0, self.most)] * len(self.joints)

    def list_starts(self, further: FloatArray | None = None) -> list[FloatArray]:
        """Return the logarithms (m,) of variances from which a search starts: residuals', further, stated."""
        squares = np.square(self.rows[..., -1]).sum(axis=0) / np.maximum(self.present.sum(axis=0), 1.0)
        of_residuals = np.clip(np.log(np.maximum(squares, 1.0)), 0.0, self.most)
        starts = [of_residuals, np.zeros(len(self.joints))] if len(self.joints) else [of_residuals]
        return starts if further is None or not len(self.joints) else [*starts, further]

    def logarithms(self, scatter: Scatter) -> list[float]:
        """Return the logarithms (m,) of the variances of given errors."""
        noise = np.array(scatter.encoders or (1.0,) * self.count)
        logarithms: list[float] = (2.0 * np.log(noise[self.joints])).tolist()
        return logarithms

    def list_noise(self, logarithms: FloatArray) -> tuple[float, ...]:
        """Return the noise of each of n encoders, relative to the stated noise; empty without encoders.

        The noise of an encoder whose residuals are those of a mistake is as stated.
        """
        if not len(self.joints):
            return ()
        noise = np.ones(self.count)
        is_believable = logarithms < self.most * (1.0 - _AT_BOUND)
        noise[self.joints] = np.where(is_believable, np.exp(0.5 * logarithms), 1.0)
        return tuple(noise.tolist())

    def add(
        self,
        logarithms: FloatArray,
        motion_products: FloatArray,
        motion_rows: FloatArray,
        row_products: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Add the rows of the encoders, with K noises, to products of the rows of the targets.

        Args:
            logarithms: (K, m) logarithms of the variances of the encoders' noise.
            motion_products: (B, q, q) ``GᵀG`` of the motion G by shared errors, of joints first.
            motion_rows: (B, q, k + 1) Gᵀ times the rows.
            row_products: (k + 1, k + 1) products of the rows.

        Returns:
            The three products for each of the K noises, and the sum (K,) of the logarithms of all variances.
        """
        weight = np.exp(-logarithms)
        products, by_rows = (
            np.repeat(each[None], len(weight), axis=0) for each in (motion_products, motion_rows)
        )
        products[:, :, self.joints, self.joints] += self.by_turn**2 * weight[:, None] * self.present
        by_rows[:, :, self.joints] += self.by_turn * weight[:, None, :, None] * self.rows
        of_encoders = np.einsum("bmi,bmj->mij", self.rows, self.rows)
        row_products = row_products + np.einsum("km,mij->kij", weight, of_encoders)
        return products, by_rows, row_products, logarithms @ self.present.sum(axis=0)


class _Fit(NamedTuple):
    """Fit of the unknowns for each of K pairs of variances."""

    squares: FloatArray  #: (K,) sum of squared residuals, with an allowance for rounding
    half_log_determinant: FloatArray  #: (K,) ½ log|Σ A_iᵀ V_i⁻¹ A_i|
    log_variance: FloatArray  #: (K,) Σ log|V_i|
