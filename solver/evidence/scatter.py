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
from itertools import product
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
from jointstiff.solver.mechanics.block import RegressorBlock, Term, fitted_errors
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
"""Greatest variance of the shared errors in the search, relative to the noise of the readings."""
_RESOLUTION: Final = 1e-7
"""Residual of a coordinate [m] that is taken for rounding."""
_MOST_OBSERVATIONS: Final = 100
"""Number of observations that suffice to estimate shared errors."""
_LEAST_DEGREES_OF_FREEDOM: Final = 3
"""Degrees of freedom of the residuals below which shared errors are as stated."""
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
"""Number of nodes of the posterior's grid, for the turns of the joints and for the station."""
_SIGMA_NODES: Final = np.linspace(-3.0, 3.0, 7)
"""Nodes of the logarithm of an unknown sigma, in standard deviations from its most likely value."""
_LEAST_RATIO: Final = 0.03
_GREATEST_RATIO: Final = 100.0
"""Least and greatest nodes of the first grid, in which 1 moves the targets as far as noise does."""
_NARROWINGS: Final = 2
"""Number of times that the grid is narrowed to the nodes whose density counts."""
_NEGLIGIBLE: Final = 3e-4
"""Density of a node, relative to the greatest, below which the node does not count."""
_STEP_OF_RATIO: Final = 1e-4
"""Step of the differences of log|V|, relative to the ratios of shared errors."""
_COMMON_FREEDOM: Final = 3.0
"""Degrees of freedom of the prior of a joint's own variance about the common one."""
_STEPS_OF_EM: Final = 40
"""Number of steps after which the deviations of the joints' turns rest to 1 %."""
_REFINED: Final = 6
"""Number of intervals between two nodes where a posterior of more readings is computed."""
_NO_TURN: Final = 1e-6
"""Least turn at which the logarithm of a turn is computed, relative to the stated one."""
_STEP: Final = 1e-8
"""Step of the differences of the likelihood, relative to a variance or to the noise of the readings."""


class FoundScatter(NamedTuple):
    """Errors that all targets of a posture share, as a fit accounts for them."""

    scatter: Scatter  #: roots of the posterior means of the variances
    as_stated: Scatter  #: errors as stated, none of them assumed, with the most likely noise of the encoders
    is_shown: bool  #: whether the residuals show such errors beyond those stated, by a test
    posterior: Posterior | None = None  #: None if the errors are as stated

    @classmethod
    def of_stated(cls, scatter: Scatter) -> FoundScatter:
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
    has_encoders_in_stages = measurements.encoders is not None and len(fit.method.stages) > 1
    if has_encoders_in_stages and measurements.scatter:
        return FoundScatter.of_stated(measurements.scatter)
    tested = rows.select_evenly(_MOST_OBSERVATIONS).at(fit.balanced)
    terms = [JOINTS, *fitted_errors(measurements).terms, *list_stated_terms(measurements)]
    compliance = np.maximum(fit.compliance, 0.0)
    visible = ~fit.observability.null
    try:
        likelihood = RestrictedLikelihood.from_rows(
            tested, terms, compliance, visible, finds_turns=not has_encoders_in_stages
        )
    except SolverError:  # no balance under the load: the assessment reports that elsewhere
        return FoundScatter.of_stated(measurements.scatter)
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
        if not scatter or scatter.is_assumed or not sigma:
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
    """Restricted likelihood of the shared errors of a campaign, given sigma or maximised over sigma.

    The search for its greatest value is over 2 + m `parameters`: the variance of the joints' turns and that
    of the station's shift, relative to the noise of the readings; and for each of m encoders the logarithm of
    the variance of its noise, relative to the stated noise. Turns of variance 1 move the targets as far as
    the noise does.
    """

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
        turned, by_noise = _separate_loads(block, stack.rows)
        columns, readings = turned[..., fitted], turned[..., -1]
        # The likelihood depends on the columns' span alone; dependent columns would make it rounding.
        scaled_columns, _ = unit_columns(columns.reshape(-1, columns.shape[-1]))
        basis = orthonormal_basis(scaled_columns)
        # Residuals of a first fit: they change no likelihood, but avoid the rounding of large deflections.
        coefficients = np.linalg.lstsq(basis, readings.reshape(-1), rcond=INDEPENDENT)[0]
        residual = readings - (basis @ coefficients).reshape(readings.shape)
        used = _find_postures_in_order(residual, stack.read)
        by_joints, by_station = block.shared_motion
        motion = (by_noise[:, None, None] * np.concatenate([by_joints, by_station], axis=-1))[used]
        basis = basis.reshape(*columns.shape[:2], -1)[used]
        if not used.all():  # an unknown that only the other postures show is no unknown of these
            basis = orthonormal_basis(basis.reshape(-1, basis.shape[-1])).reshape(*basis.shape[:2], -1)
        all_rows = np.concatenate([basis, residual[used, :, None]], axis=-1)
        target_row_count = motion.shape[1]  # of a posture; the rows of its encoders come last
        rows, rows_of_encoders = all_rows[:, :target_row_count], all_rows[:, target_row_count:]
        self._joint_count: int = by_joints.shape[-1]
        self._motion_products = motion.mT @ motion
        self._motion_rows = motion.mT @ rows
        self._row_products = (rows.mT @ rows).sum(axis=0)
        self._encoders = _EncoderRows.of(block.measurements, rows_of_encoders, used)
        self._measurements = block.measurements
        self._degrees_of_freedom: int = int(stack.read[used].sum()) - basis.shape[-1]
        # Ratio ρ with which turns of the joints move the targets as far as the noise of the readings does.
        motion_per_turn = float(np.linalg.norm(by_joints) / np.sqrt(by_joints[..., 0].size))
        self._unit_turn_ratio: float = 1.0 / max(motion_per_turn, 1e-12)
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

        The statistic of the likelihood ratio test has the distribution ½ χ²₀ + ½ χ²₁ if only the station's
        shift is tested, since turns that are stated are not; else ¼ χ²₀ + ½ χ²₁ + ¼ χ²₂.

        With one target the turns of the joints hardly differ from noise, so that they also have to explain
        more than a sigma larger than the stated one does.
        """
        scatter, statistic = self.fit_shared_errors()
        if statistic <= 0.0:
            return scatter, 1.0
        p_value = 0.5 * float(special.chdtrc(1, statistic))
        tests_station_only = self._measurements.repeatability is not None or not self._finds_turns
        if tests_station_only:
            return scatter, p_value
        p_value += 0.25 * float(special.chdtrc(2, statistic))
        if not self._can_show_station and self._measurements.sigma is not None:
            with_scatter = float(self._minus_log_likelihoods(np.array([self._parameters(scatter)]))[0])
            with_larger_sigma = self._minus_log_likelihood_at_free_sigma()
            statistic = max(2.0 * (with_larger_sigma - with_scatter), 0.0)
            p_value = max(p_value, 0.5 * float(special.chdtrc(1, statistic)))
        return scatter, p_value

    def find_believable(self, block: RegressorBlock) -> FoundScatter:
        """Find the shared errors from prior and residuals; as stated if no robot in order has such errors.

        Args:
            block: the observations.
        """
        most_likely, p_value = self.find_significant()
        as_stated = self.without_further_errors
        if self._degrees_of_freedom < _LEAST_DEGREES_OF_FREEDOM:
            return FoundScatter.of_stated(as_stated)
        posterior = self.compute_posterior(most_likely)
        motion_per_turn = compute_target_motion(block, Scatter(joints=1.0), sigma=1.0)
        probability_in_order = posterior.compute_probability_of_motion(LARGEST_REPEATABILITY, motion_per_turn)
        if probability_in_order < _BELIEVABLE:
            return FoundScatter.of_stated(as_stated)
        is_shown = p_value < SCATTER_LEVEL
        is_stated = bool(self._measurements.repeatability)
        scatter = replace(
            posterior.scatter, encoders=most_likely.encoders, is_assumed=not (is_shown or is_stated)
        )
        if scatter.joints and not scatter.encoders:  # encoders see the turns with one deviation for all
            scatter = replace(scatter, relative=self._find_relative_turns(scatter))
        return FoundScatter(scatter, as_stated, is_shown, posterior)

    def _find_relative_turns(self, scatter: Scatter) -> tuple[float, ...]:
        """Return the standard deviation of each joint's turns relative to the common one.

        The variance of a joint's turns has a scaled inverse χ² prior about the common variance. A step of the
        EM algorithm (Dempster et al., *J. R. Stat. Soc. B* 39, 1977) replaces it by its mean given the turns
        ``z_i ~ N(0, I)`` of each posture. With ``B_i = G_i diag(s)`` and ``M_i = (I + B_iᵀ B_i)⁻¹`` they have
        the mean ``M_i B_iᵀ (r_i − A_i x)`` and the covariance ``M_i + M_i B_iᵀ A_i C A_iᵀ B_i M_i``, where
        ``C = (Σ A_iᵀ V_i⁻¹ A_i)⁻¹`` is what the fit of x leaves open.
        """
        n = self._joint_count
        common = np.repeat([scatter.joints, scatter.station], (n, 3))
        variance = (self._measurements.sigma or self.sigma(scatter)) ** 2
        posture_count = len(self._motion_products)
        scale = common.copy()
        for _ in range(_STEPS_OF_EM):
            try:
                M = np.linalg.inv(np.eye(n + 3) + scale[:, None] * self._motion_products * scale)
            except np.linalg.LinAlgError:  # next to such turns the noise of the readings is zero
                return scatter.relative
            seen = scale[:, None] * self._motion_rows  # B_iᵀ (A_i, r_i)
            answered = M @ seen
            products = self._row_products - (seen.mT @ answered).sum(axis=0)
            C = np.linalg.pinv(products[:-1, :-1])
            x = C @ products[:-1, -1]
            mean = answered[..., -1] - answered[..., :-1] @ x
            spread = np.einsum("nij,jk,nik->ni", answered[..., :-1], C, answered[..., :-1])
            square = mean**2 / variance + np.diagonal(M, axis1=1, axis2=2) + spread
            turns = square.sum(axis=0)[:n] * scale[:n] ** 2
            freedom = _COMMON_FREEDOM + posture_count
            scale[:n] = np.sqrt((_COMMON_FREEDOM * common[:n] ** 2 + turns) / freedom)
        return tuple((scale[:n] / scatter.joints).tolist())

    def compute_posterior(self, most_likely: Scatter) -> Posterior:
        """Compute the posterior of turns and station, on a grid that is narrowed to where it counts.

        Where sigma is not stated, it is a further unknown. The noise of the encoders is the most likely one.

        Args:
            most_likely: shared errors of the greatest likelihood.
        """
        turns = self._list_nodes(_TURN_NODES) * self._unit_turn_ratio
        station = self._list_nodes(_STATION_NODES)
        if not self._finds_turns or self._measurements.repeatability == 0.0:
            turns = np.zeros(1)
        if not self._can_show_station:
            station = np.zeros(1)
        motions = self._decompose_motions(most_likely)
        for _ in range(_NARROWINGS):
            posterior = self._compute_posterior(turns, station, motions)
            turns = _narrow(turns, posterior.density_of_turns)
            station = _narrow(station, posterior.density_of_station)
        return self._compute_posterior(turns, station, motions)

    def _decompose_motions(self, scatter: Scatter) -> _Motions:
        """Return the motions by shared errors, with the noise of the encoders that the scatter has."""
        log_variances = np.array([self._encoders.list_log_variances(scatter)])
        motion_products, motion_rows, row_products, log_noise = self._encoders.add(
            log_variances, self._motion_products, self._motion_rows, self._row_products
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
        """Compute the posterior of turns, station and sigma at the nodes of a grid.

        Its unknowns are the standard deviations ``s = ρ σ`` and ``u = τ σ``, and log σ where σ is unknown. A
        node (ρ, τ) has Z values of σ: the stated one alone, or several about the one that its fit estimates.

        Args:
            turns: (S,) ratios ρ of the joints' turns to sigma [rad/m].
            station: (U,) ratios τ of the station's shift to sigma.
            motions: motions of the targets by turns of the joints and by the station.
        """
        fit = motions.fit(turns, station)
        sigma = self._list_nodes_of_sigma(fit)  # (S U, Z)
        s = np.repeat(turns, len(station))[:, None] * sigma  # [rad]
        u = np.tile(station, len(turns))[:, None] * sigma  # [m]
        log_prior = self._log_prior_of_turns(s) + _log_half_cauchy(u / ASSUMED_STATION_ERROR)
        if self._measurements.sigma is None:
            # The volume ds du of a node grows with σ: ds = σ dρ and du = σ dτ, where s and u are unknown.
            unknown_count = int(len(turns) > 1) + int(len(station) > 1)
            log_prior = log_prior + unknown_count * np.log(sigma)
        return Posterior(turns, station, sigma, fit.compute_log_likelihood(sigma), log_prior, motions)

    def _list_nodes_of_sigma(self, fit: _Fit) -> FloatArray:
        """Return the nodes of sigma [m] for each of K fits: (K, 1) as stated, or (K, Z) if sigma is unknown.

        The nodes of an unknown sigma are spread about the root mean square of the residuals. With ν degrees
        of freedom the logarithm of that estimate has the standard deviation 1/√(2ν).
        """
        stated_sigma = self._measurements.sigma
        if stated_sigma is not None:
            return np.full((len(fit.squares), 1), stated_sigma)
        estimates = np.sqrt(fit.squares / fit.degrees_of_freedom)[:, None]
        return np.asarray(estimates * np.exp(_SIGMA_NODES / np.sqrt(2.0 * fit.degrees_of_freedom)))

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
        without shared errors, but with a stated repeatability. With too few degrees of freedom the errors are
        as stated, and the statistic is 0.
        """
        if self._degrees_of_freedom < _LEAST_DEGREES_OF_FREEDOM:
            return self.without_further_errors, 0.0
        without = self._parameters_without_further_errors
        starts = np.array(self._list_starts(log_variances_without=without[2:]))
        best_start = starts[int(self._minus_log_likelihoods(starts).argmin())]
        lower, upper = self._bounds()
        # By rounding, the search may end at a worse point than its start.
        fitted = np.array([self._minimise(best_start, lower, upper), best_start])
        *values, value_without = self._minus_log_likelihoods(np.vstack([fitted, without])).tolist()
        best = int(np.argmin(values))
        statistic = 2.0 * (value_without - values[best])
        return self._scatter(fitted[best]), max(statistic, 0.0)

    def _list_starts(self, log_variances_without: FloatArray) -> list[FloatArray]:
        """Return parameters (2 + m,) from which the search starts: all combinations of a few of each.

        Args:
            log_variances_without: (m,) of the encoders' noise, most likely without shared errors.
        """
        stated = self._stated_joint_variance
        of_turns = _START_VARIANCES if stated is None else (stated,)
        of_station = _START_VARIANCES if self._can_show_station else (0.0,)
        of_encoders = self._encoders.list_starts(log_variances_without)
        return [
            np.array([turns, station, *encoders])
            for turns, station, encoders in product(of_turns, of_station, of_encoders)
        ]

    @property
    def without_further_errors(self) -> Scatter:
        """Shared errors as stated, with the noise of the encoders that is most likely then."""
        if self._degrees_of_freedom < _LEAST_DEGREES_OF_FREEDOM:
            return self._stated_scatter
        return self._scatter(self._parameters_without_further_errors)

    @property
    def _stated_scatter(self) -> Scatter:
        """Shared errors as stated; none where sigma is unknown, or nothing is stated."""
        repeatability, sigma = self._measurements.repeatability, self._measurements.sigma
        return Scatter(joints=repeatability / sigma) if repeatability and sigma else NO_SCATTER

    @cached_property
    def _parameters_without_further_errors(self) -> FloatArray:
        """Parameters (2 + m,) of the greatest likelihood without shared errors beyond those stated."""
        lower, upper = self._bounds()
        upper[:2] = lower[0], 0.0  # turns as stated, and no shift of the station
        start = np.array([lower[0], 0.0, *self._encoders.list_starts()[0]])
        has_encoders = len(start) > 2
        return self._minimise(start, lower, upper) if has_encoders else start

    @property
    def _stated_joint_variance(self) -> float | None:
        """Relative variance of the joints' turns as stated; None where the residuals have to show it.

        A stated repeatability other than 0 is a known ratio to the noise only if sigma is stated, too.
        """
        repeatability, sigma = self._measurements.repeatability, self._measurements.sigma
        if not self._finds_turns or repeatability == 0.0:
            return 0.0
        if repeatability is None or sigma is None:
            return None
        return float((repeatability / sigma / self._unit_turn_ratio) ** 2)

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the least and the greatest parameters (2 + m,): of joints, station, and m encoders."""
        stated = self._stated_joint_variance
        joints = (0.0, _MOST_VARIANCE) if stated is None else (stated, stated)
        station = (0.0, _MOST_VARIANCE if self._can_show_station else 0.0)
        lower, upper = np.transpose([joints, station, *self._encoders.bounds])
        return lower, upper

    def _minimise(self, start: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Search the parameters (2 + m,) of the greatest likelihood within bounds, from a start."""
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
        fit = self._fit(np.array([self._parameters(scatter)]))
        return float(np.sqrt(fit.squares[0] / max(self._degrees_of_freedom, 1)))

    def _parameters(self, scatter: Scatter) -> tuple[float, ...]:
        """Return the parameters (2 + m) of given shared errors and noise of the encoders."""
        of_encoders = self._encoders.list_log_variances(scatter)
        return (scatter.joints / self._unit_turn_ratio) ** 2, scatter.station**2, *of_encoders

    def _scatter(self, parameters: FloatArray) -> Scatter:
        """Return the shared errors and the noise of the encoders that parameters (2 + m,) mean."""
        joints, station = np.sqrt(parameters[:2]).tolist()
        turns = self._unit_turn_ratio * joints
        if self._stated_joint_variance is not None:  # as stated, without the rounding of a root
            turns = (self._measurements.repeatability or 0.0) / (self._measurements.sigma or 1.0)
        return Scatter(turns, station, self._encoders.list_noise(parameters[2:]))

    def _minus_log_likelihood_at_free_sigma(self) -> float:
        """Return −log L without shared errors, maximised over sigma, up to the same constant.

        With ν degrees of freedom the best sigma² is the sum of squared residuals over ν.
        """
        without_errors = np.zeros((1, 2 + len(self._encoders.joints)))
        fit = self._fit(without_errors)
        freedom = self._degrees_of_freedom
        of_residuals = freedom * (np.log(fit.squares[0] / freedom) + 1.0)
        return float(fit.half_log_determinant_of_unknowns[0] + 0.5 * of_residuals)

    def _value_and_gradient(
        self, parameters: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> tuple[float, list[float]]:
        """Return −log L at parameters (2 + m,) and its gradient by differences within the bounds.

        A parameter whose bounds are equal cannot change, and its derivative is 0.
        """
        is_variable = lower < upper
        step = _STEP * np.maximum(1.0, np.abs(parameters))
        step = np.where(is_variable & (parameters + step > upper), -step, step)
        values = self._minus_log_likelihoods(np.vstack([parameters, parameters + np.diag(step)]))
        gradient = np.where(is_variable, (values[1:] - values[0]) / step, 0.0)
        return float(values[0]), gradient.tolist()

    def _minus_log_likelihoods(self, parameters: FloatArray) -> FloatArray:
        """Return −log L (K,) of the residuals for each of K sets of parameters (K, 2 + m), up to a constant.

        Where sigma is unknown, L is the greatest over all values of sigma.
        """
        fit = self._fit(parameters)
        freedom = self._degrees_of_freedom
        sigma = self._find_stated_sigma(parameters)
        is_unknown = np.isnan(sigma)
        sigma = np.where(is_unknown, 1.0, sigma)
        with_stated_sigma = fit.squares / sigma**2 + 2.0 * freedom * np.log(sigma)
        with_best_sigma = freedom * np.log(fit.squares)
        of_residuals = np.where(is_unknown, with_best_sigma, with_stated_sigma)
        of_readings = fit.log_determinant_of_readings + of_residuals
        return fit.half_log_determinant_of_unknowns + 0.5 * of_readings

    def _find_stated_sigma(self, parameters: FloatArray) -> FloatArray:
        """Return sigma (K,) [m] as stated for each of K sets of parameters; NaN where sigma is unknown.

        A stated repeatability s₀ of the joints states sigma, too, where sigma itself is not stated:
        ``σ = s₀ / ρ``, with ρ the ratio of the joints' turns to sigma.

        Args:
            parameters: (K, 2 + m); the first of each set is the variance of the joints' turns, relative to
                turns with the ratio `_unit_turn_ratio`.
        """
        sigma, repeatability = self._measurements.sigma, self._measurements.repeatability
        if sigma is not None:
            return np.full(len(parameters), sigma)
        found = np.full(len(parameters), np.nan)
        if not repeatability:
            return found
        turn_ratio = self._unit_turn_ratio * np.sqrt(parameters[:, 0])  # ρ [rad/m]
        np.divide(repeatability, turn_ratio, out=found, where=turn_ratio > 0.0)
        return found

    def _fit(self, parameters: FloatArray) -> _Fit:
        """Fit the unknowns to whitened rows, for each of K sets of parameters (K, 2 + m).

        Rows are whitened by the noise and the shared errors. The shared errors of a posture have n + 3
        directions G_i. By ``V_i⁻¹ = I − G_i (I + G_iᵀ G_i)⁻¹ G_iᵀ`` a posture with many targets costs no more
        than a posture with one.
        """
        ratios = np.sqrt(parameters[:, :2]) * (self._unit_turn_ratio, 1.0)  # (K, 2) ρ and τ
        scale = np.repeat(ratios, (self._joint_count, 3), axis=1)[:, None, :, None]  # (K, 1, n + 3, 1)
        motion_products, motion_rows, row_products, log_noise = self._encoders.add(
            parameters[:, 2:], self._motion_products, self._motion_rows, self._row_products
        )
        inner = np.eye(scale.shape[2]) + scale * motion_products * scale.mT  # I + G_iᵀ G_i
        root = np.linalg.cholesky(inner)
        shared = np.linalg.solve(root, scale * motion_rows)
        products = row_products - (shared.mT @ shared).sum(axis=1)
        # log|V_i| = log|I + G_iᵀ G_i|, twice the logarithms of the diagonal of the root.
        log_determinant = log_noise + 2.0 * np.log(np.diagonal(root, axis1=2, axis2=3)).sum(axis=(1, 2))
        return _Fit.solve(products, log_determinant, self._degrees_of_freedom)


def _separate_loads(block: RegressorBlock, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn the rows of loads that share an unloaded reading to independent rows: their mean and contrasts.

    Args:
        block: N observations.
        rows: (N, rows, k) whitened rows.

    Returns:
        The turned rows; and (N,) by how much whitening enlarged the motion by shared errors in each.
    """
    turned, enlarged = rows.copy(), np.ones(len(rows))
    numbers = block.unloaded_readings
    for number in np.unique(numbers[block.load_counts > 1]):
        loads = np.flatnonzero(numbers == number)
        count = len(loads)
        mean_and_others = np.column_stack([np.ones(count), np.eye(count)[:, 1:]])
        Q, _ = np.linalg.qr(mean_and_others)
        turned[loads] = np.einsum("lp,lrk->prk", Q, rows[loads])
        enlarged[loads] = np.sqrt(2.0)  # contrasts have half of the noise
        enlarged[loads[0]] = np.sqrt(2.0 / (1.0 + count))
    return turned, enlarged


def _find_postures_in_order(residual: FloatArray, read_count: IndexArray) -> BoolArray:
    """Return which of N postures have no far larger residuals than most: the others have a wrong reading.

    The fewer coordinates a posture has, the further its mean square spreads by chance, and the larger is the
    limit.

    Args:
        residual: (N, rows) residuals of a fit; zero where nothing was read.
        read_count: (N,) number of coordinates that were read.
    """
    count = np.maximum(read_count, 1)
    mean_square = np.square(residual).sum(axis=1) / count
    median_by_chance = special.chdtri(count, 0.5)  # of χ²
    limit = np.maximum(_GROSS, special.chdtri(count, _BY_CHANCE) / median_by_chance)
    relative_square = mean_square / (median_by_chance / count)
    return np.asarray(relative_square <= limit * np.median(relative_square))


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior density on a grid of S ratios of turns, U of a station, and Z values of sigma."""

    turns: FloatArray  # (S,) ratios ρ, ascending [rad/m]
    station: FloatArray  # (U,) ratios τ, ascending
    sigma: FloatArray  # (S U, Z) [m]
    log_likelihood: FloatArray  # (S U, Z)
    log_prior: FloatArray  # (S U, Z) log of the prior density times the volume of a node
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

        expected = self.log_likelihood + further * self._log_likelihood_of_further_posture[:, None]
        return Posterior(
            turns,
            station,
            interpolate(self.sigma),
            interpolate(expected),
            interpolate(self.log_prior),
            self.motions,
        )

    @cached_property
    def _log_likelihood_of_further_posture(self) -> FloatArray:
        """(S U,) expected log-likelihood of a further posture that shows no shared errors."""
        return self.motions.expect_without_shared_errors(self.turns, self.station)

    @property
    def _mass(self) -> FloatArray:
        """Mass (S, U, Z) of each node."""
        weight = _trapezoids(self.turns)[:, None, None] * _trapezoids(self.station)[:, None]
        return weight * self.density.reshape(len(self.turns), len(self.station), -1)

    @property
    def density_of_turns(self) -> FloatArray:
        """Density (S,) of the turns, whatever station and sigma."""
        return np.asarray(self._mass.sum(axis=(1, 2)) / _trapezoids(self.turns))

    @property
    def density_of_station(self) -> FloatArray:
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

    def compute_probability_of_motion(self, most: float, motion_per_turn: float) -> float:
        """Return the probability that shared errors move the targets by at most a length.

        Args:
            most: root mean square motion of a target [m].
            motion_per_turn: motion of a target by turns of all joints [m/rad].
        """
        # A shift of the station moves all three coordinates of a target.
        squared_ratio = (motion_per_turn * self.turns[:, None, None]) ** 2 + 3.0 * self.station[:, None] ** 2
        motion = np.sqrt(squared_ratio) * self.sigma.reshape(len(self.turns), len(self.station), -1)
        mass = self._mass
        return float(mass[motion <= most].sum() / mass.sum())

    def _root_mean_square(self, ratio: FloatArray) -> float:
        """Return √(E[(ratio σ)²] / E[σ²]) for a ratio at each node, broadcast to (S, U, Z)."""
        variance = self.sigma.reshape(len(self.turns), len(self.station), -1) ** 2
        weight = self._mass * variance
        return float(np.sqrt((weight * ratio**2).sum() / weight.sum()))


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
    joint_count: int  # n
    present: FloatArray  # (B, m) 1 where the encoder was read, else 0
    rows: FloatArray  # (B, m, k + 1) fitted columns, then the residual
    motion_per_turn: float  # of a whitened row by a turn of its joint [m/rad]
    greatest_log_variance: float  # of a noise, relative to the stated noise

    @classmethod
    def of(cls, measurements: Measurements, rows: FloatArray, used: BoolArray) -> _EncoderRows:
        """Choose the joints whose encoders were read; `rows` (B, n, k + 1) are those of the postures used."""
        encoders, n = measurements.encoders, measurements.joints.shape[-1]
        if encoders is None:
            none = np.zeros(0, dtype=np.intp)
            return cls(none, n, np.zeros((len(rows), 0)), np.zeros((len(rows), 0, rows.shape[-1])), 0.0, 0.0)
        present = encoders.present[used]
        joints = np.flatnonzero(present.any(axis=0))
        greatest_noise = max(_LARGEST_ENCODER_NOISE / encoders.sigma, 1.0)  # relative to the stated noise
        return cls(
            joints,
            n,
            present[:, joints].astype(float),
            rows[:, joints],
            motion_per_turn=measurements.encoder_lever / np.sqrt(2.0),
            greatest_log_variance=float(2.0 * np.log(greatest_noise)),
        )

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Bounds of the logarithm of each variance: a stated noise is the least."""
        return [(0.0, self.greatest_log_variance)] * len(self.joints)

    def list_starts(self, further: FloatArray | None = None) -> list[FloatArray]:
        """Return logarithms (m,) of the encoders' variances from which a search starts.

        These are the mean squares of the residuals, the stated noise, and `further` ones if there are any.
        Without encoders the only start is empty.
        """
        if not len(self.joints):
            return [np.zeros(0)]
        read_count = np.maximum(self.present.sum(axis=0), 1.0)
        mean_squares = np.square(self.rows[..., -1]).sum(axis=0) / read_count
        of_residuals = np.clip(np.log(np.maximum(mean_squares, 1.0)), 0.0, self.greatest_log_variance)
        as_stated = np.zeros(len(self.joints))
        return [of_residuals, as_stated] if further is None else [of_residuals, as_stated, further]

    def list_log_variances(self, scatter: Scatter) -> list[float]:
        """Return for each of m encoders the logarithm of its noise's variance, relative to the stated noise.

        Without a noise of the encoders in `scatter` the noise is the stated one, whose logarithm is 0.
        """
        if not scatter.encoders:
            return [0.0] * len(self.joints)
        noise_of_joints = np.array(scatter.encoders)  # (n,), of joints without an encoder, too
        log_variances: list[float] = (2.0 * np.log(noise_of_joints[self.joints])).tolist()
        return log_variances

    def list_noise(self, log_variances: FloatArray) -> tuple[float, ...]:
        """Return the noise of each of n encoders, relative to the stated noise; empty without encoders.

        The noise of an encoder whose residuals are those of a mistake is as stated.
        """
        if not len(self.joints):
            return ()
        noise = np.ones(self.joint_count)
        is_believable = log_variances < self.greatest_log_variance * (1.0 - _AT_BOUND)
        noise[self.joints] = np.where(is_believable, np.exp(0.5 * log_variances), 1.0)
        return tuple(noise.tolist())

    def add(
        self,
        log_variances: FloatArray,
        motion_products: FloatArray,
        motion_rows: FloatArray,
        row_products: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Add the rows of the encoders, with K noises, to products of the rows of the targets.

        Args:
            log_variances: (K, m) logarithms of the variances of the encoders' noise.
            motion_products: (B, q, q) ``GᵀG`` of the motion G by shared errors, of joints first.
            motion_rows: (B, q, k + 1) Gᵀ times the rows.
            row_products: (k + 1, k + 1) products of the rows.

        Returns:
            The three products for each of the K noises, and the sum (K,) of the logarithms of all variances.
        """
        weight = np.exp(-log_variances)
        motion_products = np.repeat(motion_products[None], len(weight), axis=0)
        motion_rows = np.repeat(motion_rows[None], len(weight), axis=0)
        # A turn of a joint moves the row of its own encoder only.
        squared_motion = self.motion_per_turn**2 * weight[:, None] * self.present
        motion_products[:, :, self.joints, self.joints] += squared_motion
        motion_rows[:, :, self.joints] += self.motion_per_turn * weight[:, None, :, None] * self.rows
        products_of_encoders = np.einsum("bmi,bmj->mij", self.rows, self.rows)
        row_products = row_products + np.einsum("km,mij->kij", weight, products_of_encoders)
        return motion_products, motion_rows, row_products, log_variances @ self.present.sum(axis=0)


class _Fit(NamedTuple):
    """Fits of the unknowns, one for each of K covariances V_i of the readings in units of sigma²."""

    squares: FloatArray  #: (K,) sum Σ r_iᵀ V_i⁻¹ r_i of squared residuals, with an allowance for rounding
    half_log_determinant_of_unknowns: FloatArray  #: (K,) ½ log|Σ A_iᵀ V_i⁻¹ A_i|
    log_determinant_of_readings: FloatArray  #: (K,) Σ log|V_i|
    degrees_of_freedom: int  #: ν of the residuals

    @classmethod
    def solve(
        cls, products: FloatArray, log_determinant_of_readings: FloatArray, degrees_of_freedom: int
    ) -> _Fit:
        """Fit the k unknowns from products (K, k + 1, k + 1) of whitened rows, those of the residual last."""
        factor = np.linalg.cholesky(products[:, :-1, :-1])
        explained = np.square(np.linalg.solve(factor, products[:, :-1, -1:])).sum(axis=(1, 2))
        unexplained = np.maximum(products[:, -1, -1] - explained, 0.0)
        return cls(
            squares=unexplained + degrees_of_freedom * _RESOLUTION**2,
            half_log_determinant_of_unknowns=np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1),
            log_determinant_of_readings=log_determinant_of_readings,
            degrees_of_freedom=degrees_of_freedom,
        )

    def compute_log_likelihood(self, sigma: FloatArray) -> FloatArray:
        """Return the restricted log-likelihood (K, Z) of sigma (K, Z) for each fit, up to a constant.

        It is ``−½ (Σ log|V_i| + log|Σ A_iᵀ V_i⁻¹ A_i| + Σ r_iᵀ V_i⁻¹ r_i / σ²) − ν log σ``.
        """
        of_covariance = self.half_log_determinant_of_unknowns + 0.5 * self.log_determinant_of_readings
        of_residuals = 0.5 * self.squares[:, None] / sigma**2 + self.degrees_of_freedom * np.log(sigma)
        return np.asarray(-of_covariance[:, None] - of_residuals)


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
        products, log_determinants = list[FloatArray](), list[FloatArray]()
        eigenvalues, vectors = np.linalg.eigh(station_products)  # (S, B, 3)
        eigenvalues = np.maximum(eigenvalues, 0.0)
        along_vectors = vectors.mT @ rows_by_station
        for s in range(len(turns)):
            by_station = _reduce(station, eigenvalues[s]).reshape(len(station), -1)  # (U, 3 B)
            products.append(row_products[s] - by_station @ _square(along_vectors[s]))
            log_of_station = np.log1p(np.square(station)[:, None, None] * eigenvalues[s]).sum(axis=(1, 2))
            log_determinants.append(log_of_turns[s] + log_of_station)
        log_determinant = self.log_noise + np.concatenate(log_determinants)
        products_of_fits = np.concatenate(products).reshape(-1, k, k)
        return _Fit.solve(products_of_fits, log_determinant, self.degrees_of_freedom)

    def expect_without_shared_errors(self, turns: FloatArray, station: FloatArray) -> FloatArray:
        """Compute the expected log-likelihood (S U,) of a further posture whose targets share no errors.

        The posture is the mean of those so far: ``−½ (log|V| + tr V⁻¹)`` up to a constant. The derivative of
        log|V| by the logarithm of all shared variances is ``tr V⁻¹(V − I)``.

        Args:
            turns: (S,) ratios ρ of the joints' turns to sigma [rad/m].
            station: (U,) ratios τ of the station's shift to sigma.
        """
        larger = 1.0 + _STEP_OF_RATIO
        fit = self.fit(turns, station)
        fit_of_larger = self.fit(larger * turns, larger * station)
        log_determinant = fit.log_determinant_of_readings - self.log_noise
        of_larger = fit_of_larger.log_determinant_of_readings - self.log_noise
        derivative = (of_larger - log_determinant) / (2.0 * np.log(larger))
        return np.asarray(-0.5 * (log_determinant - derivative) / len(self.eigenvalues))


def _reduce(ratios: FloatArray, eigenvalues: FloatArray) -> FloatArray:
    """Return ``ρ² / (1 + ρ² λ)`` for each ratio ρ and each eigenvalue λ."""
    squared = np.square(ratios)[(slice(None), *(None,) * eigenvalues.ndim)]
    return np.asarray(squared / (1.0 + squared * eigenvalues))


def _square(rows: FloatArray) -> FloatArray:
    """Return the outer product of each of the rows (..., k + 1) with itself, as a row of (k + 1)² numbers."""
    return (rows[..., :, None] * rows[..., None, :]).reshape(-1, rows.shape[-1] ** 2)
