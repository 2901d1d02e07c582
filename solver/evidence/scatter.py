"""Errors that are new in every posture and that its targets share: repeatability, and the tracker's station.

Robots return to 30 to 60 µm, and the error of a tracker's station is the same for all targets of a posture:
three targets with one error are one reading. The deflections of a posture are
``d_i = A_i c + J_i δ_i + t_i + ε_i`` with turns ``δ_i ~ N(0, s² I)`` of the joints and a shift
``t_i ~ N(0, u² I)`` of all targets. The restricted likelihood of the ratios ρ = s/σ and τ = u/σ accounts for
the residuals that the fit of c takes away (Patterson & Thompson, *Biometrika* 58, 1971):

    −log L = ½ (Σ log|V_i| + Σ r_iᵀ V_i⁻¹ r_i / σ² + log|Σ A_iᵀ V_i⁻¹ A_i|)
    V_i = Σ_i + ρ² J_i J_iᵀ + τ² 1 1ᵀ.

An s that is not significant is not zero: fits use the roots of the posterior means of s² and u²,
``p(s, u | readings) ∝ L(s, u) p(s) p(u)`` on a grid. The priors are half-Cauchy (Gelman, *Bayesian Anal.* 1,
2006): a heavy tail lets the readings decide, a lighter one takes a station's 50 µm for turns of the joints.
Larger scales widen the intervals of campaigns whose joints repeat or whose station does not move. A stated
repeatability s₀ gives the log-normal p(s) about s₀ with the factor 2; if it is zero, the joints repeat
exactly.

The residuals *show* shared errors, beyond those stated, if a likelihood ratio test is significant. Zero is a
bound of each ratio, so that the statistic has the distribution ¼ χ²₀ + ½ χ²₁ + ¼ χ²₂ (Self & Liang, *J. Am.
Stat. Assoc.* 82, 1987).

Encoders behind the gearboxes see the same turns δ_i: their rows are further rows of J_i. The noise of each
encoder, r_j times the stated noise with r_j ≥ 1, maximises the same likelihood, with and without shared
errors: a gear's play or an eccentric encoder is no part of what a data sheet states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy import special
from scipy.optimize import Bounds, minimize

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, unit_columns
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.identify import JointsFit
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.fit.triangle import INDEPENDENT, orthonormal_basis
from jointstiff.solver.mechanics.block import (
    RegressorBlock,
    Term,
    fitted_errors,
)
from jointstiff.solver.mechanics.measurements import NO_SCATTER, Measurements, Scatter
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.mechanics.terms import list_stated_terms

SCATTER_LEVEL: Final = 0.01
"""Significance level of the test for shared errors."""
ASSUMED_REPEATABILITY: Final = 1e-5
"""Scale of the prior of a joint's turns [rad] where nothing is stated: 0.02 mm at 2 m. It is the median."""
ASSUMED_STATION_ERROR: Final = 1e-6
"""Scale of the prior of a shift of all targets [m]."""
STATED_FACTOR: Final = 2.0
"""Factor of one standard deviation of the log-normal prior about a stated repeatability."""
LARGEST_REPEATABILITY: Final = 2e-4
"""Motion of a target by shared errors [m] beyond that of any industrial robot in order: larger residuals are
a mistake, or something besides the joints bends."""
_BELIEVABLE: Final = 0.05
"""Least probability that shared errors are those of a robot in order."""
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
_TURN_NODES: Final = 12
_STATION_NODES: Final = 9
_SIGMA_NODES: Final = np.linspace(-1.0, 1.0, 7)
_SIGMA_RANGE: Final = 3.0
"""Range of an unknown sigma, in standard deviations of its logarithm."""
_LEAST_RATIO: Final = 0.03
_GREATEST_RATIO: Final = 100.0
"""Least and greatest nodes of the first grid, in which 1 moves the targets as far as noise does."""
_NARROWINGS: Final = 2
_NEGLIGIBLE: Final = 3e-4
"""Density of a node, relative to the greatest, below which the node does not count."""
_STEP_OF_RATIO: Final = 1e-4
"""Step of the differences of log|V|, relative to the ratios of shared errors."""
_REFINED: Final = 6
"""Number of intervals between two nodes where a posterior of more readings is computed."""
_NO_TURN: Final = 1e-6
"""Least turn at which the logarithm of a turn is computed, relative to the stated one."""
_STEP: Final = 1e-8
"""Step of the differences of the likelihood, relative to a variance or to the noise of the readings."""


class FoundScatter(NamedTuple):
    """Errors that all targets of a posture share, as a fit accounts for them."""

    scatter: Scatter  #: roots of the posterior means of the variances
    without_assumed: Scatter  #: errors as stated, with the most likely noise of the encoders
    is_shown: bool  #: whether the residuals show such errors beyond those stated, by a test
    posterior: Posterior | None = None  #: None if the errors are as stated

    @classmethod
    def as_stated(cls, scatter: Scatter) -> FoundScatter:
        """Return the stated errors, beyond which nothing is assumed or shown."""
        return cls(scatter, scatter, is_shown=False)


def find_scatter(rows: Rows, fit: JointsFit) -> FoundScatter:
    """Find the errors that all targets of a posture share, from prior and residuals.

    The stated errors are returned if the residuals show more than a robot in order has. The noise of each
    encoder is at least the stated noise. The decoupled method fits joints apart whose readings would depend
    on each other, so that it has no turns that encoders see.

    Args:
        rows: N observations, which may state the repeatability.
        fit: fit of joints alone to these observations.
    """
    measurements = rows.measurements
    by_stages = measurements.encoders is not None and len(fit.method.stages) > 1
    if by_stages and measurements.scatter:
        return FoundScatter.as_stated(measurements.scatter)
    tested = rows.select_evenly(_MOST_OBSERVATIONS).at(fit.balanced)
    terms = [JOINTS, *fitted_errors(measurements).terms, *list_stated_terms(measurements)]
    compliance, visible = np.maximum(fit.compliance, 0.0), ~fit.observability.null
    try:
        likelihood = RestrictedLikelihood.from_rows(
            tested, terms, compliance, visible, finds_turns=not by_stages
        )
    except SolverError:  # no balance under the load: the assessment reports that elsewhere
        return FoundScatter.as_stated(measurements.scatter)
    return likelihood.find_believable(tested.block)


def find_most_likely_scatter(
    rows: Rows, terms: Sequence[Term], compliance: FloatArray, list_columns: Callable[[int], IndexArray]
) -> Scatter:
    """Compute the shared errors and the noise of the encoders, from prior and residuals of some terms.

    Args:
        rows: N observations with readings of encoders.
        terms: terms that are fitted.
        compliance: (n,) compliances at which the columns of errors are computed [rad/(N·m)].
        list_columns: function of the number of all columns that returns those that are fitted.

    Raises:
        SolverError: a load has no balance.
    """
    tested = rows.select_evenly(_MOST_OBSERVATIONS).with_scatter(NO_SCATTER)
    stack = tested.stack(terms, compliance)
    likelihood = RestrictedLikelihood(tested.block, stack, list_columns(stack.rows.shape[-1] - 1))
    return likelihood.find_believable(tested.block).scatter


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
        """Return the repeatability that is stated or that the residuals show; None if there is none.

        A scatter that is only assumed is no repeatability that was shown.

        Args:
            rows: N observations, with the scatter of the fit.
            sigma: standard uncertainty of a coordinate of a reading [m], as stated or estimated by the fit.
        """
        scatter = rows.measurements.scatter
        if not (scatter and sigma) or scatter.is_assumed:
            return None
        unloaded_rows = rows.at(None)
        block = unloaded_rows.select_evenly(_MOST_OBSERVATIONS).block
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
            stack: rows of these observations, whitened by the readings' own noise alone; those of encoders
                last.
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
        unit = unit.reshape(*columns.shape[:2], -1)[used]
        if not used.all():  # an unknown that only the other postures show is no unknown of these
            unit = orthonormal_basis(unit.reshape(-1, unit.shape[-1])).reshape(*unit.shape[:2], -1)
        rows = np.concatenate([unit, residual[used, :, None]], axis=-1)
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

    @classmethod
    def from_rows(
        cls,
        rows: Rows,
        terms: Sequence[Term],
        compliance: FloatArray,
        visible: BoolArray,
        *,
        finds_turns: bool = True,
    ) -> RestrictedLikelihood:
        """Build the likelihood of the residuals of some terms.

        Args:
            rows: the observations, with or without shared errors.
            terms: terms that are fitted, those of the joints first.
            compliance: (n,) compliances at which the columns of errors are computed [rad/(N·m)].
            visible: (n,) whether the readings see each joint; the columns of other joints are not fitted.
            finds_turns: whether turns of the joints are sought, or are as stated.

        Raises:
            SolverError: a load has no balance.
        """
        # The likelihood adds the shared errors itself, so that its rows must not be whitened by any.
        independent = rows.with_scatter(NO_SCATTER)
        stack = independent.stack(terms, compliance)
        columns_of_joints, *columns_of_others = stack.span.values()
        fitted = np.concatenate([columns_of_joints[visible], *columns_of_others])
        return cls(independent.block, stack, fitted, finds_turns=finds_turns)

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

    def find_believable(self, block: RegressorBlock) -> FoundScatter:
        """Find the shared errors from prior and residuals; as stated if no robot in order has such errors.

        Args:
            block: the observations.
        """
        most_likely, p_value = self.find_significant()
        without_assumed = self.without_further_errors
        if self._degrees_of_freedom < _LEAST_DEGREES_OF_FREEDOM:
            return FoundScatter.as_stated(without_assumed)
        posterior = self.compute_posterior(most_likely)
        motion_by_turn = compute_target_motion(block, Scatter(joints=1.0), 1.0)
        if posterior.probability_of_motion(LARGEST_REPEATABILITY, motion_by_turn) < _BELIEVABLE:
            return FoundScatter.as_stated(without_assumed)
        scatter = replace(posterior.scatter, encoders=most_likely.encoders)
        is_shown = p_value < SCATTER_LEVEL
        is_assumed = not is_shown and not self._measurements.repeatability
        scatter = replace(scatter, is_assumed=is_assumed)
        return FoundScatter(scatter, without_assumed, is_shown, posterior)

    def compute_posterior(self, most_likely: Scatter) -> Posterior:
        """Compute the posterior of turns and station, on a grid that is narrowed to where it counts.

        Where sigma is not stated, it is a further unknown. The noise of the encoders is the most likely one.

        Args:
            most_likely: shared errors of the greatest likelihood.
        """
        turns = self._list_nodes(_TURN_NODES) * self._turns_like_noise
        station = self._list_nodes(_STATION_NODES)
        if not self._finds_turns or self._measurements.repeatability == 0.0:
            turns = np.zeros(1)
        if not self._can_show_station:
            station = np.zeros(1)
        motions = self._decompose_motions(most_likely)
        for _ in range(_NARROWINGS):
            posterior = self._compute_posterior(turns, station, motions)
            turns = _narrow(turns, posterior.by_turns)
            station = _narrow(station, posterior.by_station)
        return self._compute_posterior(turns, station, motions)

    def _decompose_motions(self, scatter: Scatter) -> _Motions:
        """Return the motions by shared errors, with the noise of the encoders that the scatter has."""
        logarithms = np.array([self._encoders.logarithms(scatter)])
        motion_products, motion_rows, row_products, log_noise = self._encoders.add(
            logarithms, self._motion_products, self._motion_rows, self._row_products
        )
        return _Motions.decompose(
            motion_products[0],
            motion_rows[0],
            row_products.reshape(self._row_products.shape),
            self._joint_count,
            float(log_noise[0]),
            self._degrees_of_freedom,
        )

    @staticmethod
    def _list_nodes(count: int) -> FloatArray:
        """Return so many ratios from zero to the greatest, relative to the noise of the readings."""
        return np.concatenate([[0.0], np.geomspace(_LEAST_RATIO, _GREATEST_RATIO, count - 1)])

    def _compute_posterior(self, turns: FloatArray, station: FloatArray, motions: _Motions) -> Posterior:
        """Compute the posterior on a grid of ratios.

        Args:
            turns: (S,) ratios ρ of the joints' turns to sigma [rad/m].
            station: (U,) ratios τ of the station's shift to sigma.
            motions: motions of the targets by turns of the joints and by the station.
        """
        rho, tau = (each.ravel() for each in np.meshgrid(turns, station, indexing="ij"))  # (K,)
        fit = motions.fit(turns, station)
        freedom = self._degrees_of_freedom
        sigma = np.full((len(rho), 1), self._measurements.sigma or 0.0)  # (K, 1), or (K, Z) if not stated
        measure = np.zeros(1)  # logarithm of the volume ds du dσ/σ of a node, relative to dρ dτ
        if self._measurements.sigma is None:
            spread = _SIGMA_RANGE / np.sqrt(2.0 * freedom)
            sigma = np.sqrt(fit.squares / freedom)[:, None] * np.exp(spread * _SIGMA_NODES)
            unknowns = int(len(turns) > 1) + int(len(station) > 1)
            measure = unknowns * np.log(sigma)
        of_residuals = 0.5 * fit.squares[:, None] / sigma**2 + freedom * np.log(sigma)
        log_likelihood = -(fit.half_log_determinant + 0.5 * fit.log_variance)[:, None] - of_residuals
        log_prior = self._log_prior_of_turns(rho[:, None] * sigma)
        shift = tau[:, None] * sigma  # (K, Z) [m]
        log_prior = log_prior + _log_half_cauchy(shift / ASSUMED_STATION_ERROR)
        return Posterior(turns, station, sigma, log_likelihood, log_prior + measure, motions)

    def _log_prior_of_turns(self, turns: FloatArray) -> FloatArray:
        """Return the logarithm of the prior density of standard deviations [rad], up to a constant."""
        stated = self._measurements.repeatability
        if not stated:
            return _log_half_cauchy(turns / ASSUMED_REPEATABILITY)
        logarithm = np.log(np.maximum(turns, _NO_TURN * stated) / stated)
        return np.asarray(-0.5 * (logarithm / np.log(STATED_FACTOR)) ** 2 - logarithm)

    def fit_shared_errors(self) -> tuple[Scatter, float]:
        """Fit the errors that all targets of a posture share; return (errors, likelihood ratio statistic).

        The statistic is 2 (log L − log L₀): L is the greatest likelihood of the residuals, L₀ the greatest
        without shared errors, but with a stated repeatability.
        """
        if self._degrees_of_freedom < _LEAST_DEGREES_OF_FREEDOM:
            return self.without_further_errors, 0.0
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
            return self._stated
        return self._scatter(self._without_further_errors)

    @property
    def _stated(self) -> Scatter:
        """Shared errors as stated; none where sigma is unknown, or nothing is stated."""
        repeatability, sigma = self._measurements.repeatability, self._measurements.sigma
        return Scatter(joints=repeatability / sigma) if repeatability and sigma else NO_SCATTER

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
        log_variance = log_noise + 2.0 * np.log(np.diagonal(root, axis1=2, axis2=3)).sum(axis=(1, 2))
        return _Fit.solve(products, log_variance, self._degrees_of_freedom)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior density on a grid of S ratios of turns, U of a station, and Z values of sigma."""

    turns: FloatArray  # (S,) ratios ρ, ascending [rad/m]
    station: FloatArray  # (U,) ratios τ, ascending
    sigma: FloatArray  # (S U, Z) [m]
    log_likelihood: FloatArray  # (S U, Z)
    log_prior: FloatArray  # (S U, Z) per volume of a node
    motions: _Motions  # of the targets by shared errors

    @cached_property
    def density(self) -> FloatArray:
        """(S U, Z) density, relative to the greatest."""
        log_density = self.log_likelihood + self.log_prior
        return np.asarray(np.exp(log_density - log_density.max()))

    def expect(self, further: int) -> Posterior:
        """Return the posterior after a number of further postures that show no shared errors.

        The posterior becomes narrower than the distances between its nodes, so that it gets `_REFINED` times
        as many; logarithms are interpolated linearly.
        """
        turns, station = _refine(self.turns), _refine(self.station)

        def interpolate(values: FloatArray) -> FloatArray:
            of_nodes = values.reshape(len(self.turns), len(self.station), -1)
            by_turns = _interpolate(self.turns, of_nodes, turns)
            by_both = _interpolate(self.station, by_turns.swapaxes(0, 1), station).swapaxes(0, 1)
            return np.asarray(by_both.reshape(-1, values.shape[-1]))

        expected = self.log_likelihood + further * self._of_further[:, None]
        return Posterior(
            turns,
            station,
            interpolate(self.sigma),
            interpolate(expected),
            interpolate(self.log_prior),
            self.motions,
        )

    @cached_property
    def _of_further(self) -> FloatArray:
        """(S U,) expected log-likelihood of a further posture that shows no shared errors."""
        return self.motions.expect_without_shared_errors(self.turns, self.station)

    @property
    def _mass(self) -> FloatArray:
        """Mass (S, U, Z) of each node."""
        weight = _trapezoids(self.turns)[:, None, None] * _trapezoids(self.station)[:, None]
        return weight * self.density.reshape(len(self.turns), len(self.station), -1)

    @property
    def by_turns(self) -> FloatArray:
        """Density (S,) of the turns, whatever station and sigma."""
        return np.asarray(self._mass.sum(axis=(1, 2)) / _trapezoids(self.turns))

    @property
    def by_station(self) -> FloatArray:
        """Density (U,) of the station, whatever turns and sigma."""
        return np.asarray(self._mass.sum(axis=(0, 2)) / _trapezoids(self.station))

    @property
    def scatter(self) -> Scatter:
        """Roots of the posterior means of the variances, in units of sigma."""
        return Scatter(self.root_mean_square_of_turns, self.root_mean_square_of_station)

    @property
    def root_mean_square_of_turns(self) -> float:
        """√(E[s²] / E[σ²]) [rad/m]."""
        return self._root_mean_square(self.turns[:, None, None])

    @property
    def root_mean_square_of_station(self) -> float:
        """√(E[u²] / E[σ²])."""
        return self._root_mean_square(self.station[:, None])

    def probability_of_motion(self, most: float, by_turn: float) -> float:
        """Return the probability that shared errors move the targets by at most a length.

        Args:
            most: root mean square motion of a target [m].
            by_turn: motion of a target by turns of all joints [m/rad].
        """
        ratio = (by_turn * self.turns[:, None, None]) ** 2 + 3.0 * self.station[:, None] ** 2
        motion = np.sqrt(ratio) * self.sigma.reshape(len(self.turns), len(self.station), -1)
        mass = self._mass
        return float(mass[motion <= most].sum() / mass.sum())

    def _root_mean_square(self, ratio: FloatArray) -> float:
        variance = self.sigma.reshape(len(self.turns), len(self.station), -1) ** 2
        mass = self._mass * variance
        return float(np.sqrt((mass * ratio**2).sum() / mass.sum()))


def _log_half_cauchy(size: FloatArray) -> FloatArray:
    """Return the logarithm of the half-Cauchy density of sizes in units of their scale, up to a constant."""
    return np.asarray(-np.log1p(np.square(size)))


def _refine(nodes: FloatArray) -> FloatArray:
    """Return the nodes (K,) with evenly spaced nodes in between; a single node as it is."""
    places = np.linspace(0.0, len(nodes) - 1.0, _REFINED * (len(nodes) - 1) + 1)
    return np.asarray(np.interp(places, np.arange(len(nodes)), nodes))


def _interpolate(nodes: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate values (K, …) at nodes (K,), ascending, linearly at other nodes (L,)."""
    if len(nodes) == 1:
        return values
    left = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2)
    part = (at - nodes[left]) / (nodes[left + 1] - nodes[left])
    part = part.reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray((1.0 - part) * values[left] + part * values[left + 1])


def _trapezoids(nodes: FloatArray) -> FloatArray:
    """Return the weights (K,) of the trapezoidal rule; 1 for a single node."""
    if len(nodes) == 1:
        return np.ones(1)
    steps = np.diff(nodes)
    return np.asarray(0.5 * (np.append(steps, 0.0) + np.append(0.0, steps)))


def _narrow(nodes: FloatArray, density: FloatArray) -> FloatArray:
    """Return as many nodes (K,), evenly spread over those whose density counts, and one more on each side."""
    counts = np.flatnonzero(density >= _NEGLIGIBLE * density.max())
    first, last = max(int(counts[0]) - 1, 0), min(int(counts[-1]) + 1, len(nodes) - 1)
    return np.linspace(nodes[first], nodes[last], len(nodes))


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

    @classmethod
    def solve(cls, products: FloatArray, log_variance: FloatArray, degrees_of_freedom: int) -> _Fit:
        """Fit the k unknowns from products (K, k + 1, k + 1) of whitened rows, those of the residual last."""
        factor = np.linalg.cholesky(products[:, :-1, :-1])
        explained = np.square(np.linalg.solve(factor, products[:, :-1, -1:])).sum(axis=(1, 2))
        left = np.maximum(products[:, -1, -1] - explained, 0.0)
        return cls(
            squares=left + degrees_of_freedom * _RESOLUTION**2,
            half_log_determinant=np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1),
            log_variance=log_variance,
        )


@dataclass(frozen=True, eq=False)
class _Motions:
    """Motions of the targets by shared errors in B postures, for fits on a grid of ratios.

    The eigenvalues λ and eigenvectors of ``JᵀJ`` of each posture give the inverse of ``W = I + ρ² J Jᵀ`` for
    all ρ in closed form; those of ``1ᵀ W⁻¹ 1`` (3, 3) give the inverse of ``W + τ² 1 1ᵀ`` for all τ.
    """

    eigenvalues: FloatArray  # (B, n) λ of JᵀJ
    station_by_turns: FloatArray  # (B, n, 3) J along each eigenvector times the motion 1 of the station
    rows_by_turns: FloatArray  # (B, n, k + 1) J along each eigenvector times the rows
    station_products: FloatArray  # (B, 3, 3) 1ᵀ1
    rows_by_station: FloatArray  # (B, 3, k + 1) 1ᵀ times the rows
    row_products: FloatArray  # (k + 1, k + 1) products of the rows
    log_noise: float  # sum of the logarithms of the variances of the encoders' noise
    degrees_of_freedom: int

    @classmethod
    def decompose(
        cls,
        motion_products: FloatArray,
        motion_rows: FloatArray,
        row_products: FloatArray,
        joint_count: int,
        log_noise: float,
        degrees_of_freedom: int,
    ) -> _Motions:
        """Decompose the motion of each posture.

        Args:
            motion_products: (B, n + 3, n + 3) ``GᵀG`` of the motion G by shared errors, of joints first.
            motion_rows: (B, n + 3, k + 1) Gᵀ times the rows.
            row_products: (k + 1, k + 1) products of the rows.
            joint_count: number n of joints.
            log_noise: sum of the logarithms of the variances of the encoders' noise.
            degrees_of_freedom: of the residuals.
        """
        n = joint_count
        eigenvalues, vectors = np.linalg.eigh(motion_products[:, :n, :n])
        return cls(
            eigenvalues=np.maximum(eigenvalues, 0.0),
            station_by_turns=vectors.mT @ motion_products[:, :n, n:],
            rows_by_turns=vectors.mT @ motion_rows[:, :n],
            station_products=np.ascontiguousarray(motion_products[:, n:, n:]),
            rows_by_station=np.ascontiguousarray(motion_rows[:, n:]),
            row_products=row_products,
            log_noise=log_noise,
            degrees_of_freedom=degrees_of_freedom,
        )

    def fit(self, turns: FloatArray, station: FloatArray) -> _Fit:
        """Fit the unknowns for all pairs of S ratios of turns and U ratios of the station, S U fits."""
        k = len(self.row_products)
        by_turns = _reduce(turns, self.eigenvalues)  # (S, B, n)
        weighted = by_turns[..., None] * self.station_by_turns  # (S, B, n, 3)
        station_products = self.station_products - weighted.mT @ self.station_by_turns
        rows_by_station = self.rows_by_station - weighted.mT @ self.rows_by_turns  # (S, B, 3, k + 1)
        squares_by_turns = _square(self.rows_by_turns)  # (B n, (k + 1)²)
        row_products = self.row_products.ravel() - by_turns.reshape(len(turns), -1) @ squares_by_turns
        log_of_turns = np.log1p(np.square(turns)[:, None, None] * self.eigenvalues).sum(axis=(1, 2))
        products, log_variances = list[FloatArray](), list[FloatArray]()
        eigenvalues, vectors = np.linalg.eigh(station_products)  # (S, B, 3)
        eigenvalues = np.maximum(eigenvalues, 0.0)
        along_vectors = vectors.mT @ rows_by_station
        for s in range(len(turns)):
            by_station = _reduce(station, eigenvalues[s]).reshape(len(station), -1)  # (U, 3 B)
            products.append(row_products[s] - by_station @ _square(along_vectors[s]))
            log_of_station = np.log1p(np.square(station)[:, None, None] * eigenvalues[s]).sum(axis=(1, 2))
            log_variances.append(log_of_turns[s] + log_of_station)
        log_variance = self.log_noise + np.concatenate(log_variances)
        return _Fit.solve(np.concatenate(products).reshape(-1, k, k), log_variance, self.degrees_of_freedom)

    def expect_without_shared_errors(self, turns: FloatArray, station: FloatArray) -> FloatArray:
        """Compute the expected log-likelihood (S U,) of a further posture whose targets share no errors.

        The posture is the mean of those so far: ``−½ (log|V| + tr V⁻¹)`` up to a constant. The derivative of
        log|V| by the logarithm of all shared variances is ``tr V⁻¹(V − I)``.

        Args:
            turns: (S,) ratios ρ of the joints' turns to sigma [rad/m].
            station: (U,) ratios τ of the station's shift to sigma.
        """
        larger = 1.0 + _STEP_OF_RATIO
        log_variance = self.fit(turns, station).log_variance - self.log_noise
        of_larger = self.fit(larger * turns, larger * station).log_variance - self.log_noise
        derivative = (of_larger - log_variance) / (2.0 * np.log(larger))
        return np.asarray(-0.5 * (log_variance - derivative) / len(self.eigenvalues))


def _reduce(ratios: FloatArray, eigenvalues: FloatArray) -> FloatArray:
    """Return ``ρ² / (1 + ρ² λ)`` for each ratio ρ and each eigenvalue λ."""
    squared = np.square(ratios)[(slice(None), *(None,) * eigenvalues.ndim)]
    return np.asarray(squared / (1.0 + squared * eigenvalues))


def _square(rows: FloatArray) -> FloatArray:
    """Return the outer product of each of the rows (..., k + 1) with itself, as a row of (k + 1)² numbers."""
    return (rows[..., :, None] * rows[..., None, :]).reshape(-1, rows.shape[-1] ** 2)
