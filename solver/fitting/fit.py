"""Fit of a method: its stages, solved one after the other, and their likelihood (method.md §4-§6)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy import special
from scipy.linalg import block_diag

from jointstiff.schemas.run import SigmaTest
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, Support
from jointstiff.solver.convex.solution import Certificate, Constraints, IdentificationProblem, Solution, solve
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fitting.method import MethodTriangles, PriorRows
from jointstiff.solver.fitting.observability import Combination, Identifiability, Spectrum, analyse
from jointstiff.solver.triangle import Triangle

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

    def interval(self, wanted: IndexArray, radii: FloatArray) -> FloatArray:
        """Ends (q, w, 2) of unconstrained intervals [rad/(N·m)].

        Args:
            wanted: (w,) which of the p.
            radii: (q,) half-widths in standard uncertainties, times sigma.
        """
        half = radii[:, None] * np.sqrt(np.diagonal(self.covariance)[wanted])
        ends: FloatArray = self.centre[wanted, None] + half[..., None] * np.array([-1.0, 1.0])
        return ends


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
    parameters: float  #: how many the readings were asked for: the rank, less what a prior answered instead
    #: groups of joints that neither the readings nor a prior tell apart
    undetermined: tuple[Combination, ...]
    identifiability: tuple[Identifiability, ...]  #: identifiability of each stage, by the readings alone
    certificates: tuple[Certificate, ...]  #: certificates of each stage
    alone: Fit | None = None  #: where a prior takes part, the fit of the readings alone

    def inflated(self, factor: float) -> Fit:
        """The same estimate, its variance greater by a factor."""
        if factor == 1.0:
            return self
        return replace(self, covariance=factor * self.covariance, likelihood=self.likelihood.inflated(factor))

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


@dataclass(frozen=True, eq=False)
class StageFit:
    """One stage solved."""

    joints: IndexArray  #: (p,) joints of its columns
    spectrum: Spectrum  #: spectrum of its rows, with those of the prior
    analysis: Identifiability  #: analysis of its rows, the readings' alone
    undetermined: tuple[Combination, ...]  #: what neither readings nor prior tell apart
    parameters: float  #: how many the readings were asked for
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
        prior: PriorRows | None,
        n: int,
    ) -> StageFit:
        """Solve ``‖R c − z‖²`` for p of n joints, on which the constraints are."""
        readings = spectrum = Spectrum(R)
        analysis = analyse(readings, joints, n)
        undetermined, parameters, known = analysis.combinations, float(readings.rank), np.zeros(0)
        if prior is not None:
            rows, known = prior.select(joints)
            spectrum = Spectrum(np.vstack([R, rows]))
            undetermined = analyse(spectrum, joints, n).combinations
            parameters = float(np.sum(spectrum.inverse[:, : len(R)].T * R))
        solution = solve(
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
    triangles: MethodTriangles, null: BoolArray, constraints: Constraints, prior: PriorRows | None = None
) -> Fit:
    """Solve the stages of a method, leaving out the null columns.

    To a later stage the compliances of an earlier one are known: an order between a joint of the arm and one
    of the wrist is a constraint on both to the likelihood, but here a bound on the wrist alone.

    Args:
        triangles: of all observations.
        null: (n,) joints that the readings do not see.
        constraints: on all n compliances.
        prior: of the n compliances, in units of sigma; with weighting by covariance only.

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
        fitted = StageFit.of(R, z - by_known @ compliance[known], joints, remaining, prior, n)
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
    return _combined(triangles, fits, compliance, free)


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


def _combined(
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
    part, p is the number of parameters that the readings were asked for, and the expectation is over it.

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


def sigma_test(chi_square: float, degrees_of_freedom: float) -> SigmaTest | None:
    """Test a stated sigma against the residuals, two-sided; None where there are no degrees of freedom."""
    if degrees_of_freedom < _LEAST_FREEDOM:
        return None
    tails = special.chdtr(degrees_of_freedom, chi_square), special.chdtrc(degrees_of_freedom, chi_square)
    p_value = min(1.0, 2.0 * float(min(tails)))
    if p_value >= SIGMA_TEST_LEVEL:
        return SigmaTest(p_value=p_value, verdict="consistent")
    large = tails[1] < tails[0]
    return SigmaTest(p_value=p_value, verdict="residuals_too_large" if large else "residuals_too_small")
