"""Fit of a method: its stages, solved one after the other, and their likelihood (method.md §4-§6).

Huber's loss on the targets' residuals, and the weights of the readings at its optimum (method.md §5):

    minimise  Σ_i ρ(‖W_i (d_i − A_i c)‖) + ½ ‖rows of encoders and prior‖²  under the constraints,
    ρ(t) = t²/2 up to the threshold, linear beyond,

over the targets i, each with its three coordinates (Huber, *Robust estimation of a location parameter*,
1964; on norms, so that no frame is preferred). At the optimum reading i has the weight
``w_i = min(1, threshold/‖r_i‖)``, and weighted least squares with these weights has the same optimum. So
they are handed on as covariances Σ_i/w_i: partial pose, and complete pose by covariance on three targets,
then *are* the Huber estimate, and every other method and weighting is as robust as they make it. Clarabel
solves the problem as `programs` states it; rounds of weighted least squares, damped between Newton's
step and reweighting, polish its point, and the outcome is certified from the data. All rows of all targets
are kept meanwhile: 24 (n + 1) bytes a reading.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np
from scipy import special
from scipy.linalg import block_diag

from jointstiff.schemas.run import SupportFinder
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, Support
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.estimation.method import MethodTriangles, Prior
from jointstiff.solver.estimation.observability import Combination, Identifiability, Spectrum, analyse
from jointstiff.solver.estimation.problem import Constraints, IdentificationProblem, Scaled
from jointstiff.solver.estimation.solution import Certificate, Solution, certify, solve, solve_step
from jointstiff.solver.estimation.triangle import Triangle, triangle_of
from jointstiff.solver.mechanics.block import RegressorBlock, whitened_rows
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.springs import JOINTS

SIGMA_TEST_LEVEL: Final = 0.01
"""Significance level: share of campaigns whose stated sigma is rejected although model and sigma are
right."""

_LEAST_FREEDOM = 0.5
"""Least degrees of freedom; they are integers, or nearly, for every method."""


@dataclass(frozen=True, eq=False)
class Likelihood:
    """``‖R (c − ĉ)‖²`` is −2 sigma² log L(c) but for a constant, over p of the compliances.

    An unconstrained estimate ĉ = H d is Gaussian with covariance sigma² C, C = H Σ Hᵀ, so RᵀR = C⁻¹ on what
    is determined. For weighting by covariance in one stage R is the compressed regressor itself.
    """

    joints: IndexArray  #: (p,) which compliances, ascending
    centre: FloatArray  #: (p,) the unconstrained estimate ĉ [rad/(N·m)]
    covariance: FloatArray  #: (p, p) C, in units of sigma²
    given_rows: FloatArray | None = None  #: (k, p) R if it is known; must be given where ĉ is not unique

    @cached_property
    def rows(self) -> FloatArray:
        """(k, p) R."""
        return rows_of(self.covariance) if self.given_rows is None else self.given_rows

    def inflated(self, factor: float) -> Likelihood:
        """The same centre, its variance greater by a factor."""
        rows = None if self.given_rows is None else self.given_rows / np.sqrt(factor)
        return Likelihood(self.joints, self.centre, factor * self.covariance, rows)

    def with_common(self, responses: FloatArray) -> Likelihood:
        """The same centre with covariance ``C + S Sᵀ``, which takes ``RᵀR`` to ``Rᵀ(I + (R S)(R S)ᵀ)⁻¹R``.

        Args:
            responses: S (p, k), in units of sigma.
        """
        rows = self.given_rows
        if rows is not None:
            U, s, _ = np.linalg.svd(rows @ responses, full_matrices=False)
            rows = rows + U @ ((1.0 / np.hypot(1.0, s) - 1.0)[:, None] * (U.T @ rows))
        return Likelihood(self.joints, self.centre, self.covariance + responses @ responses.T, rows)


def rows_of(covariance: FloatArray) -> FloatArray:
    """R (p, p) with RᵀR the inverse of a covariance (p, p).

    Eigenvalues of the correlations that are lost in rounding count as rounding: that information is
    understated, never overstated.
    """
    deviation = np.sqrt(np.diagonal(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(deviation, deviation))
    least = len(values) * np.finfo(float).eps * values[-1]
    rows: FloatArray = (vectors / np.sqrt(np.maximum(values, least))).T / deviation
    return rows


@dataclass(frozen=True, eq=False)
class Fit:
    """The outcome of a method before sigma is known."""

    compliance: FloatArray  #: (n,) optimum [rad/(N·m)]; zero for null columns
    active: Support  #: (n,) -1 or 1 at a lower or upper bound, else 0
    tied: BoolArray  #: (n,) joints whose compliance an order makes equal to another's
    covariance: FloatArray  #: (n, n) of the unconstrained estimate in units of sigma²; zero for null columns
    likelihood: Likelihood  #: likelihood of the compliances that the readings see, before any constraint
    parameters: float  #: how many the readings had to determine: the rank, less what a prior determined
    #: groups of joints that neither the readings nor a prior tell apart
    undetermined: tuple[Combination, ...]
    identifiability: tuple[Identifiability, ...]  #: identifiability of each stage, by the readings alone
    certificates: tuple[Certificate, ...]  #: certificates of each stage
    alone: Fit | None = None  #: where a prior takes part, the fit of the readings alone

    def inflated(self, factor: float) -> Fit:
        """The same estimate, its variance greater by a factor."""
        wider = self.likelihood.inflated(factor)
        return replace(self, covariance=factor * self.covariance, likelihood=wider)

    def with_common(self, responses: FloatArray) -> Fit:
        """The same estimate with the variance of errors that all observations share.

        Args:
            responses: (n, k) what a standard uncertainty of each moves, in units of sigma.
        """
        return replace(
            self,
            covariance=self.covariance + responses @ responses.T,
            likelihood=self.likelihood.with_common(responses[self.likelihood.joints]),
        )


Find = Callable[[IdentificationProblem], Solution]
"""Finds and certifies an optimum."""


@dataclass(frozen=True, eq=False)
class StageFit:
    """One stage solved."""

    joints: IndexArray  #: (p,) joints of its columns
    spectrum: Spectrum  #: spectrum of its rows, with those of the prior
    analysis: Identifiability  #: analysis of its rows, the readings' alone
    undetermined: tuple[Combination, ...]  #: what neither readings nor prior tell apart
    parameters: float  #: how many the readings had to determine
    prior: FloatArray  #: (k,) right-hand side of the prior's rows, which come last
    solution: Solution  #: under the constraints
    tied: BoolArray  #: (p,) whether an order holds it

    @classmethod
    def of(
        cls,
        R: FloatArray,
        z: FloatArray,
        joints: IndexArray,
        constraints: Constraints,
        prior: Prior | None = None,
        find: Find = solve,
    ) -> StageFit:
        """Solve ``‖R c − z‖²`` for p joints, on which the constraints are."""
        readings = spectrum = Spectrum(R)
        analysis = analyse(readings, joints)
        undetermined, parameters, known = analysis.combinations, float(readings.rank), np.zeros(0)
        if prior is not None:
            rows, known = prior.rows(joints)
            spectrum = Spectrum(np.vstack([R, rows]))
            undetermined = analyse(spectrum, joints).combinations
            parameters = float(np.sum(spectrum.inverse[:, : len(R)].T * R))
        solution = find(
            IdentificationProblem(
                spectrum.determined,
                np.concatenate([z, known]),
                constraints.bounds,
                constraints.inequalities,
            )
        )
        tied = np.zeros(len(joints), dtype=np.bool_)
        if solution.tight is not None:
            level = constraints.level(solution.compliance, solution.tight)
            solution = replace(solution, compliance=level)
            tied[np.array(constraints.order)[solution.tight].ravel()] = True
        return cls(joints, spectrum, analysis, undetermined, parameters, known, solution, tied)

    def unconstrained(self, z: FloatArray) -> FloatArray:
        """(p,) the estimate without constraints of readings z (m,); where it is not unique, one of them."""
        estimate: FloatArray = self.spectrum.inverse @ np.concatenate([z, self.prior])
        return estimate


def fit_method(
    triangles: MethodTriangles,
    null: BoolArray,
    constraints: Constraints,
    prior: Prior | None = None,
    find: Find = solve,
) -> Fit:
    """Solve the stages of a method, leaving out the null columns.

    To a later stage the compliances of an earlier one are known: an order between a joint of the arm and one
    of the wrist is a constraint on both to the likelihood, but here a bound on the wrist alone.

    Args:
        triangles: of all observations.
        null: (n,) joints that the readings do not see.
        constraints: on all n compliances.
        prior: of the n compliances, in units of sigma; with weighting by covariance only.
        find: `solve_step` where another fit follows.

    Raises:
        RequestError: if such a bound leaves a wrist joint no room.
        UnsupportedMethodError: if the wrist centre does not show an arm joint that the targets see, or
            determines arm joints only in combination, so that the arm's share of the targets' deflection is
            unknown.
    """
    n, method = len(null), triangles.method
    compliance, free = np.zeros(n), np.zeros(n)
    fits: dict[int, StageFit] = {}
    if len(method.stages) > 1:
        _refuse_unseen_from_centre(triangles, null)
    for number, (stage, triangle) in enumerate(zip(method.stages, triangles.stages, strict=True)):
        joints, known = stage.joints[~null[stage.joints]], stage.known[~null[stage.known]]
        if not len(joints):
            continue
        R, z, by_known = triangle.matrix[:, joints], triangle.rhs, triangle.matrix[:, known]
        remaining = constraints.given(known, compliance[known], joints)
        fitted = StageFit.of(R, z - by_known @ compliance[known], joints, remaining, prior, find)
        if fitted.undetermined and stage is not method.stages[-1]:
            combined = sorted(j for group in fitted.undetermined for j in group.joints)
            raise UnsupportedMethodError(
                "the displacement of the wrist centre determines only a combination of "
                f"{', '.join(method.joint_names[j] for j in combined)}, so the arm's share of the deflection "
                "is unknown",
                where="method",
                remedy="use method partial_pose, or add postures and load directions",
            )
        compliance[joints] = free[joints] = fitted.solution.compliance
        held = fitted.solution.active.any() or fitted.tied.any()
        if held or (free[known] != compliance[known]).any():
            free[joints] = fitted.unconstrained(z - by_known @ free[known])
        fits[number] = fitted
    return _combine_stages(triangles, fits, compliance, free)


def _refuse_unseen_from_centre(triangles: MethodTriangles, null: BoolArray) -> None:
    arm, names = triangles.method.stages[0].joints, triangles.method.joint_names
    unseen = [j for j in arm[triangles.seen_from_centre.observability().null[arm]] if not null[j]]
    if unseen:
        raise UnsupportedMethodError(
            f"the wrist centre does not move when {', '.join(names[j] for j in unseen)} turns, so "
            "its displacement does not show the compliance of that joint",
            where="method",
            remedy="use method partial_pose",
        )


def _combine_stages(
    triangles: MethodTriangles, fits: dict[int, StageFit], compliance: FloatArray, centre: FloatArray
) -> Fit:
    """Put the stages together."""
    stages = list(fits.values())
    active, tied = np.zeros(len(centre), dtype=np.int8), np.zeros(len(centre), dtype=np.bool_)
    for stage in stages:
        tied[stage.joints], active[stage.joints] = stage.tied, stage.solution.active
    joints = np.concatenate([np.zeros(0, np.intp), *(stage.joints for stage in stages)])
    covariance = _covariance(triangles, fits)
    part = covariance[np.ix_(joints, joints)]
    undetermined = tuple(group for stage in stages for group in stage.undetermined)
    rows = None
    if len(triangles.stages) == 1 and triangles.spreads is None and stages:
        rows = stages[0].spectrum.determined
    elif undetermined:
        seen = block_diag(*(stage.spectrum.seen for stage in stages))
        rows = rows_of(seen @ part @ seen.T) @ seen
    return Fit(
        compliance,
        active,
        tied,
        covariance,
        Likelihood(joints, centre[joints], part, rows),
        sum(stage.parameters for stage in stages),
        undetermined,
        tuple(stage.analysis for stage in stages),
        tuple(stage.solution.certificate for stage in stages),
    )


def _covariance(triangles: MethodTriangles, fits: dict[int, StageFit]) -> FloatArray:
    """Return the exact covariance (n, n) of all stages: ĉ = H d, hence H Σ Hᵀ (method.md §4).

    With ĉ_w = L (d − A_a ĉ_a) it is, for the wrist, L Σ Lᵀ less the correlation of the two stages, plus
    L A_a cov(ĉ_a) (L A_a)ᵀ.
    """
    n = len(triangles.cross)
    covariance = np.zeros((n, n))
    for number, stage in fits.items():
        half = stage.spectrum.inverse
        if triangles.spreads is not None:
            half = half @ half.T @ triangles.spreads[number].matrix[:, stage.joints].T
        covariance[np.ix_(stage.joints, stage.joints)] = half @ half.T
    if len(fits) > 1:
        arm, wrist = fits.values()
        inverse = wrist.spectrum.inverse
        rows = triangles.stages[1].matrix[:, arm.joints]
        leak = inverse[:, : len(rows)] @ rows  # L A_a; what a prior says of the wrist leaks nothing
        shared = (inverse @ inverse.T) @ triangles.cross[np.ix_(wrist.joints, arm.joints)]
        shared = shared @ (arm.spectrum.inverse @ arm.spectrum.inverse.T)  # cov(L d, ĉ_a)
        of_arm = covariance[np.ix_(arm.joints, arm.joints)]
        both = shared @ leak.T
        covariance[np.ix_(wrist.joints, wrist.joints)] += leak @ of_arm @ leak.T - both - both.T
        covariance[np.ix_(wrist.joints, arm.joints)] = shared - leak @ of_arm
        covariance[np.ix_(arm.joints, wrist.joints)] = covariance[np.ix_(wrist.joints, arm.joints)].T
    return covariance


def student_quantile(probability: float, degrees_of_freedom: float | None) -> float:
    """Return the quantile in standard uncertainties: Student's, or the normal one for None."""
    if degrees_of_freedom is None:
        return float(special.ndtri(probability))
    return float(special.stdtrit(degrees_of_freedom, probability))


@dataclass(frozen=True)
class Scale:
    """Sigma and the residuals under it."""

    #: standard uncertainty of one coordinate of one reading [m]; None where it was not given and there are
    #: no degrees of freedom to estimate it from
    sigma: float | None
    given: bool  #: whether it was stated with the readings
    chi_square: float  #: chi square of the targets' residuals, under sigma
    degrees_of_freedom: float  #: expectation of chi_square where model and sigma are right

    def quantile(self, probability: float) -> float:
        """Return the quantile in standard uncertainties: normal, or Student's where sigma is estimated."""
        return student_quantile(probability, None if self.given else self.degrees_of_freedom)


def scale_of(fit: Fit, readings: Triangle, sigma: float | None) -> Scale:
    """Chi-square of the targets' residuals, its degrees of freedom, and sigma.

    For any linear unbiased ĉ of covariance C, ``E[χ²] = rows − 2 p + tr(AᵀΣ⁻¹A C)``; for weighted least
    squares that is rows − p. It lets the three methods be judged on the same readings. Where a prior takes
    part, p is the number of parameters that the readings had to determine, and the expectation is over it.

    Args:
        fit: outcome of a method.
        readings: compressed rows of all readings, whitened in units of sigma.
        sigma: as stated with the readings [m], or None.
    """
    R = readings.matrix
    squares = float(np.sum((R @ fit.compliance - readings.rhs) ** 2))
    information = float(np.sum((R @ fit.covariance) * R))
    freedom = readings.rows - 2 * fit.parameters + information
    freedom = 0.0 if freedom < _LEAST_FREEDOM else freedom
    if sigma is not None:
        with np.errstate(all="ignore"):  # an overflow is refused later, with its remedy
            chi_square = float(np.float64(squares) / np.float64(sigma) ** 2)
        return Scale(sigma, True, chi_square, freedom)
    if freedom < _LEAST_FREEDOM:
        return Scale(None, False, 0.0, freedom)
    return Scale(float(np.sqrt(squares / freedom)), False, freedom, freedom)


@dataclass(frozen=True)
class SigmaTest:
    """Two-sided chi-square test of a stated sigma against the residuals."""

    p_value: float
    result: Literal["consistent", "residuals_too_large", "residuals_too_small"]


def sigma_test(chi_square: float, degrees_of_freedom: float) -> SigmaTest | None:
    """Test a stated sigma against the residuals, two-sided; None where there are no degrees of freedom."""
    if degrees_of_freedom < _LEAST_FREEDOM:
        return None
    tails = special.chdtr(degrees_of_freedom, chi_square), special.chdtrc(degrees_of_freedom, chi_square)
    p_value = min(1.0, 2.0 * float(min(tails)))
    if p_value >= SIGMA_TEST_LEVEL:
        return SigmaTest(p_value, "consistent")
    large = tails[1] < tails[0]
    return SigmaTest(p_value, "residuals_too_large" if large else "residuals_too_small")


SUSPICIOUS_NORM = float(np.sqrt(2.0 * special.gammaincinv(1.5, 0.999)))
"""Limit of a suspicious reading, 4.03 sigma: one good reading of three coordinates in a thousand exceeds
it."""

MEDIAN_NORM = float(np.sqrt(2.0 * special.gammaincinv(1.5, 0.5)))
"""1.538: median of the norm of three standard normal coordinates."""
_LEAST_SCALE = 1e-6
"""Smallest scale relative to the rms deflection: no tracker measures better, and exact readings have no
scale."""
_SCALE_TOLERANCE = 1e-6
_SCALE_ROUNDS = 100
MOST_ROUNDS = 200
"""Maximum rounds of reweighting."""
_LEAST_DAMPING = 1e-8
MOST_STATED = 500
"""Number of targets up to which Huber's problem is solved as stated: 12 ms for 100, about 40 ms for these."""
_NO_DESCENT = 1e-12
"""Relative increase of the objective that counts as rounding."""


class TargetRows:
    """Whitened rows of all targets, one by one: 24 (n + 1) bytes a reading."""

    def __init__(self, parameters: int) -> None:
        """Start without observations."""
        self._rows: list[FloatArray] = []
        self._present: list[BoolArray] = []
        self.squared = Triangle(joints=parameters)
        """Rows of squared loss: those of the encoders."""

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations."""
        rows = whitened_rows(block, [JOINTS], np.zeros(block.robot.n))
        self._rows.append(rows.targets[block.measurements.present])
        self._present.append(block.measurements.present)
        if rows.encoders is not None:
            self.squared.add(rows.encoders)

    @property
    def rows(self) -> FloatArray:
        """(K, 3, n + 1) [A d] of the K readings, in units of sigma."""
        return np.concatenate(self._rows)

    @property
    def present(self) -> BoolArray:
        """(N, T) which targets were read: where the K readings belong."""
        return np.concatenate(self._present)

    def chi_square(self, compliance: FloatArray, *, sigma: float, threshold: float) -> float:
        """Chi-square of an estimate, each target's residual cut at the threshold so that none decides it.

        ``Σ min(‖r‖/σ, k)² / b``, with ``3 b = E[min(t, k)²]`` and t the norm of three standard normal
        coordinates, so that its expectation for good readings is that of the plain chi-square.

        Args:
            compliance: (n,) [rad/(N·m)].
            sigma: [m].
            threshold: k, in units of sigma.
        """
        norm = np.linalg.norm(self.rows[..., -1] - self.rows[..., :-1] @ compliance, axis=1) / sigma
        half = 0.5 * threshold**2
        share = special.gammainc(2.5, half) + threshold**2 / 3.0 * special.gammaincc(1.5, half)
        squared = (self.squared.matrix @ compliance - self.squared.rhs) / sigma
        return float(np.sum(np.minimum(norm, threshold) ** 2) / share + squared @ squared)


@dataclass(frozen=True, eq=False)
class RobustFit:
    """Result of a fit of N observations of T targets with the Huber loss."""

    threshold: float  #: norm beyond which a reading counts less, in units of sigma
    sigma: float  #: standard uncertainty of one coordinate of one reading [m]: as stated, or the robust scale
    weight: FloatArray  #: (N, T) weight of the readings; 1 where a target was not read
    #: (N, T) of the whitened residuals in units of sigma; 0 where a target was not read. They are those of
    #: the Huber estimate, whatever the method.
    residual_norm: FloatArray
    certificate: Certificate  #: certificate of the optimum of the Huber problem

    @property
    def suspicious(self) -> IndexArray:
        """(K, 2) observation and target of the readings that are hardly good ones, worst first.

        Those of less than full weight whose residual exceeds `SUSPICIOUS_NORM`.
        """
        beyond = np.argwhere((self.weight < 1.0) & (self.residual_norm > SUSPICIOUS_NORM))
        order = np.argsort(-self.residual_norm[beyond[:, 0], beyond[:, 1]], kind="stable")
        return beyond[order]

    @property
    def inflation(self) -> float:
        """Variance of a Huber estimate over that of least squares with its weights taken as known.

        Huber's asymptotic ``a / b²`` relative to ``1 / mean(w)`` (*Robust Statistics*, 1981, §7.6), a the
        mean of ``(w ‖r‖)²`` a coordinate and b that of the derivative: 1 for a reading below the threshold;
        beyond it w across the residual's direction and 0 along it. Readings below the threshold count as
        their sigma says, not as they came out. It is 1.0 for good readings and 1.26 where a tenth are 20
        sigma off; never taken below 1.
        """
        half = 0.5 * self.threshold**2
        below = float(special.gammainc(2.5, half) / special.gammainc(1.5, half))  # E[χ²₃ | χ²₃ ≤ t²] / 3
        w = self.weight[self.residual_norm > 0]
        if not len(w):
            return 1.0
        a = float(np.mean(np.where(w < 1.0, self.threshold**2 / 3.0, below)))
        b = float(np.mean(np.where(w < 1.0, 2.0 * w / 3.0, 1.0)))
        return max(1.0, a * float(np.mean(w)) / b**2)

    def weigh(self, measurements: Measurements) -> Measurements:
        """The same readings with the covariances Σ/w that their weights stand for."""
        covariance = measurements.covariance / self.weight[..., None, None]
        return replace(measurements, covariance=covariance, weight=self.weight)


@dataclass(frozen=True, eq=False)
class _HuberProblem:
    """Lengths are in units of the threshold: ρ turns linear at 1."""

    rows: FloatArray  # (K, 3, p + 1) [A d] of the targets
    squared: FloatArray  # (q, p + 1) of squared loss
    constraints: Constraints

    def in_units_of(self, length: float) -> _HuberProblem:
        return replace(self, rows=self.rows / length, squared=self.squared / length)

    def residual(self, c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(K, 3) residuals and (K,) their norms."""
        residual = self.rows[..., -1] - self.rows[..., :-1] @ c
        return residual, np.linalg.norm(residual, axis=1)

    def objective(self, c: FloatArray) -> float:
        norm = self.residual(c)[1]
        squared = self.squared[:, :-1] @ c - self.squared[:, -1]
        return float(np.where(norm <= 1.0, 0.5 * norm**2, norm - 0.5).sum() + 0.5 * (squared @ squared))

    def posed(self, spectrum: Spectrum, z: FloatArray) -> IdentificationProblem:
        """Least squares under the constraints."""
        return IdentificationProblem(
            spectrum.determined, z, self.constraints.bounds, self.constraints.inequalities
        )

    def weighted(self, weight: FloatArray) -> IdentificationProblem:
        """Return least squares with weights (K,) of the targets."""
        rows = (np.sqrt(weight)[:, None, None] * self.rows).reshape(-1, self.rows.shape[2])
        R = triangle_of(np.vstack([rows, self.squared]))
        return self.posed(Spectrum(R[:, :-1]), R[:, -1])

    def least_squares(self) -> IdentificationProblem:
        """Return the same problem with the squared loss."""
        return self.weighted(np.ones(len(self.rows)))

    def step(self, c: FloatArray, damping: float) -> tuple[FloatArray, Certificate]:
        """Minimum under the bounds of a quadratic model of the objective at c.

        A reading beyond the threshold adds the curvature ``w (I − (1 − damping) u uᵀ)``, u the direction of
        its residual: Newton's for damping 0; for 1 that of reweighting, which never goes up.
        """
        A, S = self.rows[..., :-1], self.squared[:, :-1]
        residual, norm = self.residual(c)
        weight = _weight(norm)
        u = residual / np.maximum(norm, 1.0)[:, None]
        along = np.where(norm > 1.0, 1.0 - np.sqrt(damping), 0.0)
        curved = A - along[:, None, None] * u[..., None] * (u[:, None] @ A)
        weighted = (np.sqrt(weight)[:, None, None] * curved).reshape(-1, len(c))
        R = triangle_of(np.vstack([weighted, S]))
        gradient = S.T @ (S @ c - self.squared[:, -1])
        gradient -= np.einsum("kij,ki->j", A, weight[:, None] * residual)
        spectrum = Spectrum(R)
        solution = solve_step(self.posed(spectrum, R @ c - spectrum.inverse.T @ gradient))
        return solution.compliance, solution.certificate

    def certificate(self, c: FloatArray, solved_by: SupportFinder) -> Certificate:
        """Certify weighted least squares with the weights of the residuals at c: the Huber problem."""
        scaled = Scaled.of(self.weighted(_weight(self.residual(c)[1])))
        return certify(scaled, c / scaled.unit, solved_by)


def fit_huber(
    targets: TargetRows,
    null: BoolArray,
    constraints: Constraints,
    *,
    prior: Prior | None,
    sigma: float | None,
    threshold: float,
) -> RobustFit:
    """Solve the Huber problem of all targets.

    Where sigma is unknown a robust scale takes its place: the median norm of the whitened residuals over
    that of χ with three degrees of freedom, times √(rows/(rows − parameters)) because a fit shrinks its
    residuals, brought to convergence together with the fit, then fixed.

    Args:
        targets: the rows.
        null: (n,) joints that the readings do not see.
        constraints: on all n compliances.
        prior: of the n compliances; its loss stays squared.
        sigma: as stated with the readings [m], or None.
        threshold: in units of sigma.

    Returns:
        The weights of the readings, with the certificate of the optimum.

    Raises:
        UnsupportedMethodError: sigma is unknown, and too few readings are left to estimate it.
        SolverError: optimality could not be certified.
    """
    joints = np.flatnonzero(~null)
    columns = [*joints, -1]
    problem = _HuberProblem(
        targets.rows[..., columns], targets.squared.R[:, columns], constraints.select(joints)
    )
    if sigma is None:
        sigma = _robust_scale(problem, threshold)
    if prior is not None:
        rows, known = prior.in_units_of(sigma).rows(joints)
        problem = replace(problem, squared=np.vstack([problem.squared, np.column_stack([rows, known])]))
    problem = problem.in_units_of(threshold * sigma)
    compliance, certificate = _minimise(problem)
    norm = problem.residual(compliance)[1]
    present = targets.present
    weights, norms = np.ones(present.shape), np.zeros(present.shape)
    weights[present], norms[present] = _weight(norm), threshold * norm
    return RobustFit(threshold, sigma, weights, norms, certificate)


def _weight(norm: FloatArray) -> FloatArray:
    return 1.0 / np.maximum(norm, 1.0)


def _minimise(problem: _HuberProblem) -> tuple[FloatArray, Certificate]:
    """Return the optimum and its certificate: Clarabel's point, polished by Newton's steps.

    Of more than `MOST_STATED` targets the rounds start at least squares, with full damping, which is faster.
    """
    stated = None
    if len(problem.rows) <= MOST_STATED:
        from jointstiff.solver.estimation import convex  # takes a second to import

        (A, d), (S, t) = ((rows[..., :-1], rows[..., -1]) for rows in (problem.rows, problem.squared))
        stated = convex.huber(A, d, S, t, problem.least_squares())
    compliance = solve_step(problem.least_squares()).compliance if stated is None else stated
    damping = 1.0 if stated is None else _LEAST_DAMPING
    objective = problem.objective(compliance)
    for _ in range(MOST_ROUNDS):
        proposed, solver = problem.step(compliance, damping)
        value = problem.objective(proposed)
        if value > objective * (1.0 + _NO_DESCENT) and damping < 1.0:
            damping = 1.0
            continue
        compliance, objective = proposed, value
        damping = max(0.1 * damping, _LEAST_DAMPING)
        same = stated is not None and np.array_equal(stated == 0.0, compliance == 0.0)
        certificate = problem.certificate(compliance, "clarabel" if same else solver.solved_by)
        if certificate.is_optimal():
            return compliance, certificate
    raise SolverError(
        "the fit with the Huber loss did not converge to an optimum (primal "
        f"{certificate.primal:.1e}, dual {certificate.dual:.1e})",
        where="loss",
        remedy="use loss squared, and report this problem with the data",
    )


def _robust_scale(problem: _HuberProblem, threshold: float) -> float:
    """Scale of the residuals [m], brought to convergence round by round with the fit."""
    compliance = solve_step(problem.least_squares()).compliance
    rows = problem.rows[..., 0].size
    freedom = rows - len(compliance)
    if freedom < 1:
        raise UnsupportedMethodError(
            "the Huber loss needs sigma, which cannot be estimated: there are no more readings than joints",
            where="loss",
            remedy="state `noise`, or add observations",
        )
    unit = np.sqrt(rows / freedom) / MEDIAN_NORM
    least = _LEAST_SCALE * float(np.sqrt(np.mean(problem.rows[..., -1] ** 2)))
    scale = np.inf
    for _ in range(_SCALE_ROUNDS):
        before, scale = scale, max(least, unit * float(np.median(problem.residual(compliance)[1])))
        if abs(scale - before) <= _SCALE_TOLERANCE * scale:
            break
        compliance, _ = problem.in_units_of(threshold * scale).step(compliance, 1.0)
    return scale
