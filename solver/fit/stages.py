"""Fit of a method: its stages, solved one after the other, and their likelihood (method.md §4-§6).

Huber's loss on the targets' residuals, and the weights of the readings at its optimum (method.md §5):

    minimise  Σ_i ρ(‖W_i (d_i − A_i c)‖) + ½ ‖rows of encoders and prior‖²  under the constraints,
    ρ(t) = t²/2 up to the threshold, linear beyond,

over the targets i, each with its three coordinates (Huber, *Robust estimation of a location parameter*,
1964; on norms, so that no frame is preferred). At the optimum reading i has the weight
``w_i = min(1, threshold/‖r_i‖)``, and weighted least squares with these weights has the same optimum. So the
methods use the weights as covariances Σ_i/w_i: partial pose, and complete pose by covariance on three
targets, then give exactly the Huber estimate; the weights make every other method and weighting robust, too.
Clarabel solves the problem that `programs` states; rounds of weighted least squares, damped between Newton's
step and reweighting, refine Clarabel's point, and the outcome is certified from the data. The rows of all
targets are kept until then: 24 (n + 1) bytes for each reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy import special
from scipy.linalg import block_diag

from jointstiff.schemas.run import SupportFinder
from jointstiff.solver.arrays import ActiveBounds, BoolArray, FloatArray, IndexArray, unit_columns
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.fit.cone import Scalars
from jointstiff.solver.fit.constraints import Constraints
from jointstiff.solver.fit.method import MethodRows, Stage
from jointstiff.solver.fit.observability import (
    Combination,
    Identifiability,
    Spectrum,
    analyse_spectrum,
)
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.problem import Certificate, LeastSquares, Problem
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import SolutionOfScalars, certify, compare_answers, solve
from jointstiff.solver.fit.triangle import INDEPENDENT, Triangle, compute_triangular_factor, orthonormal_basis
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.springs import JOINTS

SIGMA_TEST_LEVEL: Final = 0.01
"""Significance level: share of campaigns whose stated sigma is rejected although model and sigma are
right."""

_LEAST_FREEDOM = 0.5
"""Least degrees of freedom; they are integers, or nearly, for every method."""


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Gaussian likelihood L of p of the compliances c: ``−2 sigma² log L(c) = ‖R (c − ĉ)‖² + constant``.

    An unconstrained estimate ĉ = H d from deflections d of covariance sigma² Σ is Gaussian with covariance
    sigma² C, C = H Σ Hᵀ, so RᵀR = C⁻¹ in the directions that the readings determine. For weighting by
    covariance in one stage R is the compressed regressor.
    """

    joints: IndexArray  #: (p,) indices of the compliances, ascending
    centre: FloatArray  #: (p,) the unconstrained estimate ĉ [rad/(N·m)]
    covariance: FloatArray  #: (p, p) C, in units of sigma²
    given_rows: FloatArray | None = None  #: (k, p) R; None to compute R from C, which needs a unique ĉ

    @cached_property
    def rows(self) -> FloatArray:
        """Matrix R (k, p) of the likelihood: RᵀR is the inverse covariance of the p compliances."""
        return invert_to_root(self.covariance) if self.given_rows is None else self.given_rows

    def multiply_covariance(self, factor: float) -> Likelihood:
        """Return the likelihood with its covariance multiplied by a factor, and the same centre."""
        rows = None if self.given_rows is None else self.given_rows / np.sqrt(factor)
        return Likelihood(self.joints, self.centre, factor * self.covariance, rows)

    def add_common_errors(self, responses: FloatArray) -> Likelihood:
        """Return the likelihood with the covariance S Sᵀ of errors common to all observations added.

        The rows R become ``(I + (R S)(R S)ᵀ)^(−1/2) R``, computed from the singular values of R S.

        Args:
            responses: S (p, k), change of the estimate by one standard uncertainty of each of k errors, in
                units of sigma.
        """
        rows = self.given_rows
        if rows is not None:
            U, singular_values, _ = np.linalg.svd(rows @ responses, full_matrices=False)
            shrinkage = 1.0 / np.hypot(1.0, singular_values)  # of the rows along the columns of U
            rows = rows + U @ ((shrinkage - 1.0)[:, None] * (U.T @ rows))
        covariance = self.covariance + responses @ responses.T
        return Likelihood(self.joints, self.centre, covariance, rows)

    def leave_out(self, joints: IndexArray) -> Likelihood:
        """Return the likelihood of the other joints, where some joints (q,) may have any compliance.

        Args:
            joints: (q,) joints that are left out, as indices among the n joints of the robot.
        """
        kept = ~np.isin(self.joints, joints)
        if kept.all():
            return self
        rows = self.given_rows
        if rows is not None:
            # Project out of the rows what the free compliances can explain.
            columns_left_out, _ = unit_columns(rows[:, ~kept])
            basis = orthonormal_basis(columns_left_out, INDEPENDENT)
            projected = rows - basis @ (basis.T @ rows)
            rows = projected[:, kept]
        covariance = self.covariance[np.ix_(kept, kept)]
        return Likelihood(self.joints[kept], self.centre[kept], covariance, rows)


def invert_to_root(covariance: FloatArray) -> FloatArray:
    """Return a root R (p, p) of the inverse of a covariance (p, p): RᵀR is the inverse.

    Eigenvalues of the correlation matrix below rounding are raised to rounding, so that information is
    understated, never overstated.
    """
    deviation = np.sqrt(np.diagonal(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    eigenvalues, vectors = np.linalg.eigh(correlation)  # ascending
    rounding = len(eigenvalues) * np.finfo(float).eps * eigenvalues[-1]
    eigenvalues = np.maximum(eigenvalues, rounding)
    root: FloatArray = (vectors / np.sqrt(eigenvalues)).T / deviation
    return root


@dataclass(frozen=True, eq=False)
class MethodFit:
    """The estimate of a method, with covariances in units of sigma², before sigma is known."""

    compliance: FloatArray  #: (n,) optimum [rad/(N·m)]; zero for joints without effect
    active: ActiveBounds  #: (n,) -1 or 1 at a lower or upper bound, else 0
    tied: BoolArray  #: (n,) mask of joints whose compliance an order makes equal to that of another joint
    #: (n, n) covariance of the unconstrained estimate, in units of sigma²; zero for joints without effect
    covariance: FloatArray
    likelihood: Likelihood  #: likelihood of the compliances that the readings see, before any constraint
    #: number of parameters that the readings determine: the rank, less the part that a prior determines
    parameters: float
    #: groups of joints that neither the readings nor a prior tell apart
    undetermined: tuple[Combination, ...]
    identifiability: tuple[Identifiability, ...]  #: identifiability of each stage, by the readings alone
    certificates: tuple[Certificate, ...]  #: certificates of each stage
    without_prior: MethodFit | None = None  #: the fit without the prior; None if no prior was used

    def multiply_covariance(self, factor: float) -> MethodFit:
        """Return the fit with the covariance of the estimate multiplied by a factor."""
        likelihood = self.likelihood.multiply_covariance(factor)
        return replace(self, covariance=factor * self.covariance, likelihood=likelihood)

    def add_common_errors(self, responses: FloatArray) -> MethodFit:
        """Return the fit with the uncertainty of errors that all observations share added to its covariance.

        Args:
            responses: (n, k) change of the n compliances by one standard uncertainty of each of k errors, in
                units of sigma.
        """
        seen_joints = self.likelihood.joints
        return replace(
            self,
            covariance=self.covariance + responses @ responses.T,
            likelihood=self.likelihood.add_common_errors(responses[seen_joints]),
        )


@dataclass(frozen=True, eq=False)
class SolvedStage:
    """Optimum of one stage of a method: compliances c of p joints that minimise ‖R c − z‖² and a prior."""

    joints: IndexArray  #: (p,) joints of the stage's columns
    R: FloatArray  #: (m, p) compressed rows of the stage's readings
    readings: Spectrum  #: spectrum of R
    spectrum: Spectrum  #: spectrum of R and of the rows of a prior
    prior: FloatArray  #: (k,) right-hand side of the prior's rows, which come last
    solution: SolutionOfScalars  #: optimum under the constraints
    tied: BoolArray  #: (p,) mask of joints whose compliance an order makes equal to that of another joint
    problem: Problem[Scalars]  #: problem of this optimum
    constraints: Constraints  #: constraints on the p compliances

    @classmethod
    def solve(
        cls,
        R: FloatArray,
        z: FloatArray,
        joints: IndexArray,
        constraints: Constraints,
        prior: Prior | None = None,
    ) -> SolvedStage:
        """Solve one stage of a method: minimise ``‖R c − z‖²`` over p compliances c under constraints.

        Args:
            R: (m, p) compressed rows of the stage's readings.
            z: (m,) compressed deflections, less the deflections due to joints of an earlier stage.
            joints: (p,) joints of the columns.
            constraints: constraints on these p compliances.
            prior: prior of all compliances, in units of sigma, added as further rows.
        """
        readings = spectrum = Spectrum(R)
        prior_values = np.zeros(0)
        if prior is not None:
            prior_rows, prior_values = prior.rows(joints)
            spectrum = Spectrum(np.vstack([R, prior_rows]))
        rhs = np.concatenate([z, prior_values])
        problem = Problem(LeastSquares(spectrum.determined, rhs), Scalars.of(constraints))
        solution = solve(problem, witnessed=False)
        solution, is_tied = _equalise_tied_compliances(solution, constraints)
        return cls(joints, R, readings, spectrum, prior_values, solution, is_tied, problem, constraints)

    def certify(self) -> SolvedStage:
        """Return the stage, solved again by Clarabel, whose own answer is a witness of the optimum."""
        solution = solve(self.problem, witnessed=True)
        solution, is_tied = _equalise_tied_compliances(solution, self.constraints)
        return replace(self, solution=solution, tied=is_tied)

    def estimate_without_constraints(self, z: FloatArray) -> FloatArray:
        """Return the compliances (p,) of the fit without constraints; the shortest solution if not unique.

        Args:
            z: (m,) compressed deflections.
        """
        estimate: FloatArray = self.spectrum.inverse @ np.concatenate([z, self.prior])
        return estimate

    def analyse_readings(self) -> Identifiability:
        """Return what the readings alone determine, without the prior."""
        return analyse_spectrum(self.readings, self.joints)

    def list_undetermined(self) -> tuple[Combination, ...]:
        """Return the groups of joints that neither readings nor prior tell apart."""
        return analyse_spectrum(self.spectrum, self.joints).combinations

    def count_determined(self) -> float:
        """Return the number of parameters that the readings determine: the rank of R.

        With a prior, it is the trace of the matrix that turns z into the fitted R c: a parameter that the
        prior determines does not count.
        """
        has_prior = self.spectrum is not self.readings
        if not has_prior:
            return float(self.readings.rank)
        inverse_of_readings = self.spectrum.inverse[:, : len(self.R)]
        return float(np.sum(inverse_of_readings.T * self.R))  # the trace


def _equalise_tied_compliances(
    solution: SolutionOfScalars, constraints: Constraints
) -> tuple[SolutionOfScalars, BoolArray]:
    """Make compliances exactly equal that are equal up to rounding because of the stiffness order.

    Returns:
        The solution with p compliances, and a mask (p,) of those that equal another one.
    """
    is_tied = np.zeros(len(solution.x), dtype=np.bool_)
    if solution.tight is None:  # there is no order
        return solution, is_tied
    tied_pairs = np.array(constraints.order)[solution.tight]
    is_tied[tied_pairs.ravel()] = True
    equalised = constraints.equalise_tied(solution.x, solution.tight)
    return replace(solution, x=equalised), is_tied


@dataclass(frozen=True, eq=False)
class SolvedMethod:
    """Optimum of all stages of a method; `describe` has its covariance and what the readings determine."""

    compressed: MethodRows  #: compressed rows of all observations
    stages: dict[int, SolvedStage]  #: solved stages by their number; stages without joints are left out
    compliance: FloatArray  #: (n,) optimum [rad/(N·m)]; zero for joints without effect
    unconstrained: FloatArray  #: (n,) estimate without constraints [rad/(N·m)]

    @property
    def active(self) -> ActiveBounds:
        """Bound (n,) at which each compliance is: -1 at the lower, 1 at the upper bound, else 0."""
        active = np.zeros(len(self.compliance), dtype=np.int8)
        for stage in self.stages.values():
            active[stage.joints] = stage.solution.active
        return active

    @property
    def tied(self) -> BoolArray:
        """Mask (n,) of joints whose compliance an order makes equal to that of another joint."""
        tied = np.zeros(len(self.compliance), dtype=np.bool_)
        for stage in self.stages.values():
            tied[stage.joints] = stage.tied
        return tied

    def certify(self) -> SolvedMethod:
        """Return the optimum, with each stage solved again by Clarabel; see `SolvedStage.certify`."""
        stages = {number: stage.certify() for number, stage in self.stages.items()}
        compliance = self.compliance.copy()
        for stage in stages.values():
            compliance[stage.joints] = stage.solution.x
        return replace(self, stages=stages, compliance=compliance)

    def describe(self) -> MethodFit:
        """Return the fit of the whole method: optimum, covariance, and the evidence of optimality."""
        stages = list(self.stages.values())
        joints = np.concatenate([np.zeros(0, np.intp), *(stage.joints for stage in stages)])
        covariance = _compute_covariance(self.compressed, self.stages)
        covariance_of_joints = covariance[np.ix_(joints, joints)]
        undetermined = self._list_undetermined()
        rows = self._find_rows_of_likelihood(covariance_of_joints, undetermined)
        likelihood = Likelihood(joints, self.unconstrained[joints], covariance_of_joints, rows)
        return MethodFit(
            compliance=self.compliance,
            active=self.active,
            tied=self.tied,
            covariance=covariance,
            likelihood=likelihood,
            parameters=sum(stage.count_determined() for stage in stages),
            undetermined=undetermined,
            identifiability=tuple(stage.analyse_readings() for stage in stages),
            certificates=tuple(stage.solution.certificate for stage in stages),
        )

    def _list_undetermined(self) -> tuple[Combination, ...]:
        """Return the groups of joints that neither the readings nor a prior tell apart, of all stages."""
        undetermined = list[Combination]()
        for stage in self.stages.values():
            undetermined.extend(stage.list_undetermined())
        return tuple(undetermined)

    def _find_rows_of_likelihood(
        self, covariance_of_joints: FloatArray, undetermined: Sequence[Combination]
    ) -> FloatArray | None:
        """Return rows R of the likelihood, with RᵀR the inverse covariance of the p joints with an effect.

        None leaves the computation to `Likelihood`, which inverts the covariance.

        Args:
            covariance_of_joints: (p, p) covariance of the unconstrained estimate, in units of sigma².
            undetermined: groups of joints that neither the readings nor a prior tell apart.
        """
        stages = list(self.stages.values())
        is_by_covariance = self.compressed.spreads is None
        is_one_stage_by_covariance = is_by_covariance and len(self.compressed.triangles) == 1
        if is_one_stage_by_covariance and stages:
            return stages[0].spectrum.determined  # weighted by covariance, so RᵀR is the inverse already
        if not undetermined:
            return None
        # Only some sums of the compliances are determined: invert the covariance of these sums.
        sums = block_diag(*(stage.spectrum.seen for stage in stages))
        return invert_to_root(sums @ covariance_of_joints @ sums.T) @ sums


def solve_method(
    compressed: MethodRows,
    has_no_effect: BoolArray,
    constraints: Constraints,
    prior: Prior | None = None,
) -> SolvedMethod:
    """Solve the stages of a method in turn, without the joints that have no effect on the readings.

    A stage is a least-squares problem for some joints; a later stage takes the compliances of an earlier
    stage as known. The stage of the arm comes first, so a stiffness order between an arm joint and a wrist
    joint only bounds the wrist joint. A stage without joints that have an effect is left out.

    Args:
        compressed: compressed rows of all observations.
        has_no_effect: (n,) mask of joints that have no effect on the readings.
        constraints: constraints on all n compliances.
        prior: prior of the n compliances, in units of sigma; only for weighting by covariance.

    Raises:
        RequestError: if the bounds on a wrist joint from the stiffness order leave no feasible compliance.
        UnsupportedMethodError: if an arm joint moves the targets but not the wrist centre, or if the wrist
            centre determines arm joints only in combination, so that the arm's share of the targets'
            deflection is unknown.
    """
    stages, n = compressed.method.stages, len(has_no_effect)
    compliance, unconstrained = np.zeros(n), np.zeros(n)  # estimates with and without constraints
    solved_stages: dict[int, SolvedStage] = {}
    if len(stages) > 1:
        _refuse_joints_without_effect_on_centre(compressed, has_no_effect)
    for number, (stage, triangle) in enumerate(zip(stages, compressed.triangles, strict=True)):
        rows = _StageProblem.of(stage, triangle, has_no_effect)
        if not len(rows.joints):
            continue
        of_others = constraints.fix_joints(rows.known, compliance[rows.known], rows.joints)
        z = rows.subtract_known(compliance)
        solved = SolvedStage.solve(rows.R, z, rows.joints, of_others, prior)
        if stage is not stages[-1]:
            _refuse_combined_arm_joints(solved, compressed.method.joint_names)
        compliance[rows.joints] = solved.solution.x
        unconstrained[rows.joints] = _release_constraints(rows, solved, compliance, unconstrained)
        solved_stages[number] = solved
    return SolvedMethod(compressed, solved_stages, compliance, unconstrained)


class _StageProblem(NamedTuple):
    """Rows of one stage of a method: ``R c + R_known c_known ≈ z``, without joints that have no effect."""

    joints: IndexArray  # (p,) joints whose compliances c the stage fits
    known: IndexArray  # (k,) joints whose compliances c_known an earlier stage has fitted
    R: FloatArray  # (m, p)
    R_known: FloatArray  # (m, k)
    z: FloatArray  # (m,) deflections [m]

    @classmethod
    def of(cls, stage: Stage, triangle: Triangle, has_no_effect: BoolArray) -> _StageProblem:
        """Select the columns of the joints that have an effect from the rows of a stage.

        Args:
            stage: fitted and known joints.
            triangle: compressed rows of the stage, with a column for each of n joints.
            has_no_effect: (n,) mask of joints that have no effect on the readings.
        """
        joints = stage.joints[~has_no_effect[stage.joints]]
        known = stage.known[~has_no_effect[stage.known]]
        return cls(joints, known, triangle.matrix[:, joints], triangle.matrix[:, known], triangle.rhs)

    def subtract_known(self, compliance: FloatArray) -> FloatArray:
        """Return the deflections (m,) less those by the known joints, for compliances (n,) of all joints."""
        return np.asarray(self.z - self.R_known @ compliance[self.known])


def _release_constraints(
    rows: _StageProblem, solved: SolvedStage, compliance: FloatArray, unconstrained: FloatArray
) -> FloatArray:
    """Return the estimate (p,) of a stage without constraints, neither in this nor in an earlier stage.

    It is the optimum itself where no constraint acts.

    Args:
        rows: rows of the stage.
        solved: optimum of the stage under the constraints.
        compliance: (n,) optimum under the constraints.
        unconstrained: (n,) estimate without constraints; those of known joints are used.
    """
    constraint_acts_here = solved.solution.active.any() or solved.tied.any()
    constraint_acted_before = (unconstrained[rows.known] != compliance[rows.known]).any()
    if constraint_acts_here or constraint_acted_before:
        return solved.estimate_without_constraints(rows.subtract_known(unconstrained))
    return solved.solution.x


def _refuse_combined_arm_joints(arm: SolvedStage, joint_names: Sequence[str]) -> None:
    """Refuse a fit of the arm if the readings determine some joints only in combination.

    Raises:
        UnsupportedMethodError: names these joints.
    """
    combined_joints = sorted(j for group in arm.list_undetermined() for j in group.joints)
    if not combined_joints:
        return
    names = ", ".join(joint_names[j] for j in combined_joints)
    raise UnsupportedMethodError(
        f"the displacement of the wrist centre determines only a combination of {names}, so the arm's part "
        "of the deflection is unknown",
        where="method",
        remedy="use method partial_pose, or add postures and load directions",
    )


def _refuse_joints_without_effect_on_centre(compressed: MethodRows, has_no_effect: BoolArray) -> None:
    """Refuse a fit of arm and wrist if an arm joint moves the targets but not the wrist centre.

    Args:
        compressed: compressed rows of a method with two stages, the arm and the wrist.
        has_no_effect: (n,) mask of joints that have no effect on the readings of the targets.

    Raises:
        UnsupportedMethodError: names these joints.
    """
    arm = compressed.method.stages[0].joints
    does_not_move_centre = compressed.seen_from_centre.observability().null
    hidden_joints = [j for j in arm if does_not_move_centre[j] and not has_no_effect[j]]
    if hidden_joints:
        names = ", ".join(compressed.method.joint_names[j] for j in hidden_joints)
        raise UnsupportedMethodError(
            f"the wrist centre does not move when {names} turns, so "
            "the displacement of the wrist centre does not show the compliance of that joint",
            where="method",
            remedy="use method partial_pose",
        )


def _compute_covariance(compressed: MethodRows, fits: dict[int, SolvedStage]) -> FloatArray:
    """Return the exact covariance (n, n) of the unconstrained estimate, in units of sigma² (method.md §4).

    A stage maps the whitened deflections d, of covariance I, by a matrix N, and fits its rows N A to N d.
    With the pseudo-inverse P of these rows, its estimate is ĉ = P N d, of covariance (P N)(P N)ᵀ: that is
    P Pᵀ where N Nᵀ = I, as for weighting by covariance, and H Hᵀ with H = P Pᵀ (NᵀN A)ᵀ otherwise.

    Args:
        compressed: compressed rows of all observations.
        fits: solved stages by their number: one stage, or those of the arm and of the wrist.
    """
    n = len(compressed.cross)
    covariance = np.zeros((n, n))
    for number, stage in fits.items():
        P = H = stage.spectrum.inverse
        if compressed.spreads is not None:  # the rows were not weighted with the covariance of the readings
            compressed_NtN_A = compressed.spreads[number].matrix[:, stage.joints]
            H = P @ P.T @ compressed_NtN_A.T
        covariance[np.ix_(stage.joints, stage.joints)] = H @ H.T
    if len(fits) > 1:
        arm, wrist = fits.values()
        covariance = _propagate_error_of_arm(covariance, compressed, arm, wrist)
    return covariance


def _propagate_error_of_arm(
    covariance: FloatArray, compressed: MethodRows, arm: SolvedStage, wrist: SolvedStage
) -> FloatArray:
    """Return the covariance (n, n) of two stages, with the effect of the arm's error on the wrist's estimate.

    The wrist is fitted to what the arm leaves of the deflections d: ``ĉ_w = L (d − A_a ĉ_a)``, with the
    estimate ĉ_a of the arm, the arm's columns A_a in the rows of the wrist, and the pseudo-inverse L of these
    rows. With M = L A_a and K = cov(L d, ĉ_a):

        cov(ĉ_w) = L cov(d) Lᵀ + M cov(ĉ_a) Mᵀ − K Mᵀ − M Kᵀ,    cov(ĉ_w, ĉ_a) = K − M cov(ĉ_a)

    Args:
        covariance: (n, n) covariance of each stage alone: cov(ĉ_a), and L cov(d) Lᵀ for the wrist.
        compressed: compressed rows of both stages.
        arm: fit of the arm.
        wrist: fit of the wrist.
    """
    arm_block = np.ix_(arm.joints, arm.joints)
    wrist_block = np.ix_(wrist.joints, wrist.joints)
    wrist_and_arm = np.ix_(wrist.joints, arm.joints)
    arm_and_wrist = np.ix_(arm.joints, wrist.joints)
    L = wrist.spectrum.inverse
    A_a = compressed.triangles[1].matrix[:, arm.joints]
    M = L[:, : len(A_a)] @ A_a  # further columns of L belong to a prior, which does not depend on the arm
    # A stage's estimate is A⁺ z with (AᵀA)⁻¹ = A⁺ A⁺ᵀ, and `cross` the covariance of A_wᵀ z_w and A_aᵀ z_a.
    K = (L @ L.T) @ compressed.cross[wrist_and_arm]
    K = K @ (arm.spectrum.inverse @ arm.spectrum.inverse.T)
    K_M = K @ M.T
    propagated = covariance.copy()
    propagated[wrist_block] += M @ covariance[arm_block] @ M.T - K_M - K_M.T
    propagated[wrist_and_arm] = K - M @ covariance[arm_block]
    propagated[arm_and_wrist] = propagated[wrist_and_arm].T
    return propagated


def student_quantile(probability: float, degrees_of_freedom: float | None) -> float:
    """Return a quantile of Student's distribution, or of the normal one if `degrees_of_freedom` is None."""
    if degrees_of_freedom is None:
        return float(special.ndtri(probability))
    return float(special.stdtrit(degrees_of_freedom, probability))


@dataclass(frozen=True)
class Scale:
    """Sigma, and the chi-square of the residuals under this sigma."""

    #: standard uncertainty of one coordinate of one reading [m]; None where it was not given and there are
    #: no degrees of freedom to estimate it from
    sigma: float | None
    given: bool  #: whether sigma was stated with the readings
    chi_square: float  #: sum of the squared residuals of the targets over sigma²
    degrees_of_freedom: float  #: expectation of `chi_square` if model and sigma are right

    @property
    def freedom_of_sigma(self) -> float | None:
        """Degrees of freedom of a sigma from the residuals; None for a stated sigma."""
        return None if self.given else self.degrees_of_freedom

    def quantile(self, probability: float) -> float:
        """Return a quantile of the distribution of (estimate − true value) / standard uncertainty.

        The distribution is normal, or Student's where sigma was estimated from the residuals.
        """
        return student_quantile(probability, self.freedom_of_sigma)

    def list_quantiles(self, confidence: float) -> FloatArray:
        """Return the quantiles (2,) of two-sided intervals and of one-sided bounds, at a confidence level."""
        tail = 1.0 - confidence
        two_sided = self.quantile(1.0 - 0.5 * tail)  # half of the tail on each side
        one_sided = self.quantile(1.0 - tail)
        return np.array([two_sided, one_sided])


def estimate_scale(fit: MethodFit, readings: Triangle, sigma: float | None) -> Scale:
    """Return sigma, the chi-square of the targets' residuals, and the chi-square's degrees of freedom.

    For any linear unbiased ĉ of covariance C, ``E[χ²] = rows − 2 p + tr(AᵀΣ⁻¹A C)``, which is rows − p for
    weighted least squares. Here p is the number of parameters that the readings, not a prior, determine; A
    are the regressors and Σ the covariance of the readings. All methods get sigma from the same readings.
    A sigma from the residuals makes chi-square equal to its expectation; sigma is None without degrees of
    freedom.

    Args:
        fit: outcome of a method.
        readings: compressed rows of all readings, whitened in units of sigma.
        sigma: stated standard uncertainty of a coordinate [m]; None to estimate sigma from the residuals.
    """
    R = readings.matrix  # RᵀR = AᵀΣ⁻¹A
    sum_of_squares = float(np.sum((R @ fit.compliance - readings.rhs) ** 2))
    trace = float(np.sum((R @ fit.covariance) * R))  # tr(RᵀR C)
    freedom = readings.rows - 2 * fit.parameters + trace
    has_freedom = freedom >= _LEAST_FREEDOM
    freedom = freedom if has_freedom else 0.0
    if sigma is not None:
        with np.errstate(all="ignore"):  # the caller refuses numbers that overflow, with a remedy
            chi_square = float(np.float64(sum_of_squares) / np.float64(sigma) ** 2)
        return Scale(sigma, given=True, chi_square=chi_square, degrees_of_freedom=freedom)
    if not has_freedom:
        return Scale(sigma=None, given=False, chi_square=0.0, degrees_of_freedom=0.0)
    estimated_sigma = float(np.sqrt(sum_of_squares / freedom))
    return Scale(estimated_sigma, given=False, chi_square=freedom, degrees_of_freedom=freedom)


@dataclass(frozen=True)
class SigmaTest:
    """Two-sided chi-square test of a stated sigma against the residuals."""

    p_value: float
    result: Literal["consistent", "residuals_too_large", "residuals_too_small"]


def sigma_test(
    chi_square: float, degrees_of_freedom: float, from_stated_errors: float = 0.0
) -> SigmaTest | None:
    """Test a stated sigma against the residuals, two-sided; return None without degrees of freedom.

    Chi-square is too large if it exceeds what the stated errors allow, and too small if it is even below what
    exact stated values would give: so each side has its own degrees of freedom.

    Args:
        chi_square: sum of squared residuals over the squared sigma.
        degrees_of_freedom: expectation of `chi_square` if model, sigma and stated uncertainties are right.
        from_stated_errors: part of this expectation that stated errors cause, such as errors of masses; the
            expectation is lower by this part if the stated values are exact.
    """
    if degrees_of_freedom < _LEAST_FREEDOM:
        return None
    freedom_if_stated_values_exact = max(degrees_of_freedom - from_stated_errors, _LEAST_FREEDOM)
    probability_below = float(special.chdtr(freedom_if_stated_values_exact, chi_square))
    probability_above = float(special.chdtrc(degrees_of_freedom, chi_square))
    p_value = min(1.0, 2.0 * min(probability_below, probability_above))
    if p_value >= SIGMA_TEST_LEVEL:
        return SigmaTest(p_value, "consistent")
    if probability_above < probability_below:
        return SigmaTest(p_value, "residuals_too_large")
    return SigmaTest(p_value, "residuals_too_small")


SUSPICIOUS_NORM = float(np.sqrt(2.0 * special.gammaincinv(1.5, 0.999)))
"""Length of a residual above which a reading is suspicious, 4.03 sigma: of a thousand good readings of three
coordinates, one exceeds this length."""

MEDIAN_NORM = float(np.sqrt(2.0 * special.gammaincinv(1.5, 0.5)))
"""1.538: median of the norm of three standard normal coordinates."""
_LEAST_SCALE = 1e-6
"""Smallest scale of the residuals relative to the rms deflection: no tracker measures better, and exact
readings would give a scale of zero."""
_SCALE_TOLERANCE = 1e-6
_SCALE_ROUNDS = 100
MOST_ROUNDS = 200
"""Maximum rounds of reweighting."""
_LEAST_DAMPING = 1e-8
MOST_STATED = 500
"""Number of readings up to which Clarabel solves Huber's problem: 12 ms for 100, about 40 ms for 500."""
_NO_DESCENT = 1e-12
"""Relative increase of the objective that counts as rounding."""


@dataclass(frozen=True, eq=False)
class TargetRows:
    """Whitened rows of all readings, kept uncompressed for the Huber loss: 24 (n + 1) bytes a reading."""

    rows: FloatArray  #: (K, 3, n + 1) [A d] of the K readings, whitened, in units of sigma
    present: BoolArray  #: (N, T) mask of the targets that were read in each observation; K entries are true
    encoders: Triangle  #: rows of the encoders, whose loss stays squared

    @classmethod
    def of(cls, rows: Rows) -> TargetRows:
        """Collect the whitened rows of all readings, with the joints' columns and the deflections.

        The rows are computed for one block of observations after the other.
        """
        n = rows.robot.n
        targets, present, encoders = [], [], Triangle(joints=n)
        for block_rows in rows.generate([JOINTS], compliance=np.zeros(n)):
            is_read = block_rows.block.measurements.present  # (B, T)
            targets.append(block_rows.targets[is_read])  # (B, T, 3, n + 1) → (readings, 3, n + 1)
            present.append(is_read)
            if block_rows.encoders is not None:
                encoders.add(block_rows.encoders)
        return cls(np.concatenate(targets), np.concatenate(present), encoders)

    def chi_square(self, compliance: FloatArray, *, sigma: float, threshold: float) -> float:
        """Return the chi-square of an estimate, with each residual cut at the threshold to limit outliers.

        The targets add ``Σ min(‖r‖/σ, k)² / b``, with r the residual of a target, k the threshold, and b such
        that good readings have the expectation of a plain chi-square: ``3 b = E[min(t, k)²]``, t the norm of
        three standard normal coordinates.

        Args:
            compliance: (n,) the estimate [rad/(N·m)].
            sigma: standard uncertainty of one coordinate of one reading [m].
            threshold: k, in units of sigma.
        """
        A, d = self.rows[..., :-1], self.rows[..., -1]  # (K, 3, n), (K, 3)
        norms = np.linalg.norm(d - A @ compliance, axis=1) / sigma
        # 3 b is the sum of E[t²; t < k] and k² P(t > k), where t² has a χ² distribution.
        half_square = 0.5 * threshold**2
        part_below = special.gammainc(2.5, half_square)
        part_beyond = threshold**2 / 3.0 * special.gammaincc(1.5, half_square)
        b = part_below + part_beyond
        from_targets = np.sum(np.minimum(norms, threshold) ** 2) / b
        encoder_residuals = (self.encoders.matrix @ compliance - self.encoders.rhs) / sigma
        return float(from_targets + encoder_residuals @ encoder_residuals)


@dataclass(frozen=True, eq=False)
class RobustFit:
    """Result of a fit of N observations of T targets with the Huber loss."""

    threshold: float  #: norm beyond which a reading counts less, in units of sigma
    sigma: float  #: standard uncertainty of one coordinate of one reading [m]: as stated, or the robust scale
    weight: FloatArray  #: (N, T) weight of the readings; 1 where a target was not read
    #: (N, T) lengths of the whitened residuals of the Huber estimate, in units of sigma, whatever the method;
    #: 0 where a target was not read
    residual_norm: FloatArray
    certificate: Certificate  #: certificate of the optimum of the Huber problem

    @property
    def suspicious(self) -> IndexArray:
        """Indices (K, 2) of observation and target of the suspicious readings, worst first.

        A reading is suspicious if its weight is below 1 and its residual exceeds `SUSPICIOUS_NORM`.
        """
        is_suspicious = (self.weight < 1.0) & (self.residual_norm > SUSPICIOUS_NORM)
        indices = np.argwhere(is_suspicious)
        worst_first = np.argsort(-self.residual_norm[is_suspicious], kind="stable")
        return indices[worst_first]

    @property
    def inflation(self) -> float:
        """Factor ≥ 1 that turns the covariance of weighted least squares into that of the Huber estimate.

        The covariance is larger because the weights w are computed from the same readings. The factor is
        Huber's asymptotic ``a / b²`` over ``1 / mean(w)`` (*Robust Statistics*, 1981, §7.6), r the residual:

            a   mean of ``(w ‖r‖)²`` per coordinate: as expected below the threshold t, and t²/3 beyond
            b   mean derivative of ``w r``: 1 below the threshold; beyond, w across r and 0 along r

        The factor is 1.0 for good readings. A weight below 1 shows a residual beyond the threshold, and
        2 w / 3 is the mean of w, w and 0 over the three coordinates.
        """
        weights = self.weight[self.residual_norm > 0]  # weights of the targets that were read
        if not len(weights):
            return 1.0
        half_square = 0.5 * self.threshold**2
        # E[χ²₃ | χ²₃ ≤ t²] / 3: χ²₃ is the squared norm of three standard normal coordinates.
        expected_square_below = float(special.gammainc(2.5, half_square) / special.gammainc(1.5, half_square))
        is_beyond = weights < 1.0
        a = float(np.mean(np.where(is_beyond, self.threshold**2 / 3.0, expected_square_below)))
        b = float(np.mean(np.where(is_beyond, 2.0 * weights / 3.0, 1.0)))
        return max(1.0, a * float(np.mean(weights)) / b**2)

    def reweight(self, measurements: Measurements) -> Measurements:
        """Return the same readings with the weights of the robust fit.

        Weighted least squares of these readings gives the Huber estimate.
        """
        return replace(measurements, weight=self.weight)


@dataclass(frozen=True, eq=False)
class _HuberProblem:
    """Data of a fit with the Huber loss, in units of the threshold: the loss ρ is linear beyond 1."""

    target_rows: FloatArray  # (K, 3, p + 1) [A d] of the K readings of targets
    #: (q, p + 1) [S t] of encoders and of a prior, whose loss stays squared
    other_rows: FloatArray
    constraints: Constraints

    @classmethod
    def of(cls, targets: TargetRows, joints: IndexArray, constraints: Constraints) -> _HuberProblem:
        """Return the problem for p of n joints, with rows in metres and constraints on all n compliances."""
        joints_and_readings = [*joints, -1]  # the last column has the readings
        target_rows = targets.rows[..., joints_and_readings]  # (K, 3, p + 1)
        encoder_rows = targets.encoders.R[:, joints_and_readings]
        return cls(target_rows, encoder_rows, constraints.select(joints))

    def with_prior(self, prior: Prior, joints: IndexArray) -> _HuberProblem:
        """Return the problem with the rows of a prior of all n compliances, whose loss is squared.

        Args:
            prior: prior in units of sigma.
            joints: (p,) joints of the columns.
        """
        matrix, prior_values = prior.rows(joints)
        prior_rows = np.column_stack([matrix, prior_values])
        return replace(self, other_rows=np.vstack([self.other_rows, prior_rows]))

    def with_residuals_in(self, length: float) -> _HuberProblem:
        """Return the problem with all rows divided by a length [m], so that residuals are in this unit."""
        return replace(self, target_rows=self.target_rows / length, other_rows=self.other_rows / length)

    def residuals_at(self, c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals d − A c (K, 3) of the targets at compliances c (p,), and their norms (K,)."""
        A, d = self.target_rows[..., :-1], self.target_rows[..., -1]
        residual = d - A @ c
        return residual, np.linalg.norm(residual, axis=1)

    def compute_objective(self, c: FloatArray) -> float:
        """Return the Huber loss of the targets plus half the squares of the other rows, at c (p,)."""
        _, norm = self.residuals_at(c)
        huber_loss = np.where(norm <= 1.0, 0.5 * norm**2, norm - 0.5).sum()
        S, t = self.other_rows[:, :-1], self.other_rows[:, -1]
        other_residuals = S @ c - t
        return float(huber_loss + 0.5 * (other_residuals @ other_residuals))

    def state_problem(self, spectrum: Spectrum, z: FloatArray) -> Problem[Scalars]:
        """Return the problem to minimise ‖R c − z‖² under the constraints.

        R (m, p) is the matrix with the given spectrum, without what it does not determine; z is (m,).
        """
        R = spectrum.determined
        return Problem(LeastSquares(R, z), Scalars.of(self.constraints))

    def build_weighted_problem(self, weight: FloatArray) -> Problem[Scalars]:
        """Return the least-squares problem with weights (K,) of the targets, under the constraints."""
        weighted_rows = np.sqrt(weight)[:, None, None] * self.target_rows  # (K, 3, p + 1)
        flat_rows = weighted_rows.reshape(-1, self.target_rows.shape[2])
        factor = compute_triangular_factor(np.vstack([flat_rows, self.other_rows]))
        R, z = factor[:, :-1], factor[:, -1]
        return self.state_problem(Spectrum(R), z)

    def build_unweighted_problem(self) -> Problem[Scalars]:
        """Return the problem with squared instead of Huber loss: least squares with all weights 1."""
        return self.build_weighted_problem(np.ones(len(self.target_rows)))

    def minimise_quadratic_model(self, c: FloatArray, damping: float) -> tuple[FloatArray, Certificate]:
        """Minimise a quadratic model of the objective around compliances c (p,) under the constraints.

        A reading beyond the threshold adds the curvature ``w (I − (1 − damping) u uᵀ)``, with w its weight
        and u the direction of its residual: damping 0 gives Newton's step, and 1 a reweighted step, which
        never increases the objective.

        Returns:
            The minimiser (p,), and the certificate of the model's minimum.
        """
        A, S, t = self.target_rows[..., :-1], self.other_rows[:, :-1], self.other_rows[:, -1]
        residual, norm = self.residuals_at(c)
        w = _compute_huber_weights(norm)
        u = residual / np.maximum(norm, 1.0)[:, None]  # unit vectors beyond the threshold
        # With f = 1 − √damping, (I − f u uᵀ)² = I − (1 − damping) u uᵀ: the rows are √w (I − f u uᵀ) A.
        f = np.where(norm > 1.0, 1.0 - np.sqrt(damping), 0.0)
        A_along_u = u[..., None] * (u[:, None] @ A)  # (K, 3, p) u uᵀ A
        model_rows = np.sqrt(w)[:, None, None] * (A - f[:, None, None] * A_along_u)
        R = compute_triangular_factor(np.vstack([model_rows.reshape(-1, len(c)), S]))
        gradient = S.T @ (S @ c - t)
        gradient -= np.einsum("kij,ki->j", A, w[:, None] * residual)
        # With Rᵀh = gradient, ‖R x − (R c − h)‖² has the gradient and curvature of the model.
        spectrum = Spectrum(R)
        h = spectrum.inverse.T @ gradient
        solution = solve(self.state_problem(spectrum, R @ c - h), witnessed=False)
        return solution.x, solution.certificate

    def certify_point(self, c: FloatArray, solved_by: SupportFinder) -> Certificate:
        """Return the certificate that states how nearly a point c (p,) is the Huber optimum.

        The Huber optimum is also the optimum of weighted least squares with the weights at that optimum, so
        the certificate is computed for the weighted least-squares problem with the weights at c. It records
        the algorithm that found the active bounds, `solved_by`.
        """
        _, norm = self.residuals_at(c)
        problem = self.build_weighted_problem(_compute_huber_weights(norm))
        scaled = problem.equilibrated
        return certify(scaled.problem, c / scaled.unit, solved_by)


def fit_huber(
    targets: TargetRows,
    has_no_effect: BoolArray,
    constraints: Constraints,
    *,
    prior: Prior | None,
    sigma: float | None,
    threshold: float,
) -> RobustFit:
    """Fit the compliances with the Huber loss on all targets.

    Where sigma is unknown, a robust scale replaces it: the median norm of the whitened residuals over the
    median of χ with three degrees of freedom, times √(rows/(rows − parameters)), because a fit shrinks its
    residuals. Scale and fit are iterated to convergence; then the scale is fixed. The prior needs sigma as
    its unit, and so does not take part in the estimate of the scale.

    Args:
        targets: whitened rows of all readings.
        has_no_effect: (n,) mask of joints that have no effect on the readings.
        constraints: constraints on all n compliances.
        prior: prior of the n compliances; the loss of its rows stays squared.
        sigma: stated standard uncertainty of a coordinate [m]; None if it is unknown.
        threshold: length of a residual from which the loss is linear, in units of sigma.

    Returns:
        Weights and residuals of the readings, and the certificate of the optimum.

    Raises:
        UnsupportedMethodError: sigma is unknown, and there are too few readings to estimate it.
        SolverError: optimality could not be certified.
    """
    joints = np.flatnonzero(~has_no_effect)
    in_metres = _HuberProblem.of(targets, joints, constraints)
    if sigma is None:
        sigma = _estimate_robust_scale(in_metres, threshold)
    if prior is not None:
        in_metres = in_metres.with_prior(prior.in_units_of(sigma), joints)
    in_thresholds = in_metres.with_residuals_in(threshold * sigma)
    compliance, certificate = _minimise_huber_loss(in_thresholds)
    _, norms = in_thresholds.residuals_at(compliance)  # (K,)
    is_read = targets.present  # (N, T) with K entries true
    weight, residual_norm = np.ones(is_read.shape), np.zeros(is_read.shape)
    weight[is_read] = _compute_huber_weights(norms)
    residual_norm[is_read] = threshold * norms  # in units of sigma
    return RobustFit(threshold, sigma, weight, residual_norm, certificate)


def _compute_huber_weights(norm: FloatArray) -> FloatArray:
    """Return the weights (K,) of residuals with norms (K,) in units of the threshold: 1 or 1/norm."""
    return 1.0 / np.maximum(norm, 1.0)


class _HuberPoint(NamedTuple):
    """Point in the search for the optimum of a Huber problem."""

    compliance: FloatArray  # (p,)
    objective: float  # value of the objective at the point
    damping: float  # of the next step: near 0 for Newton's step, 1 for a step that always descends
    solved_by: SupportFinder | None = None  # algorithm that found the active bounds; None at the start

    @classmethod
    def start(cls, problem: _HuberProblem, clarabel_point: FloatArray | None) -> _HuberPoint:
        """Start at Clarabel's point (p,), which is near the optimum.

        Without such a point, start at the optimum of least squares, which may be far from Huber's.
        """
        if clarabel_point is None:
            compliance = solve(problem.build_unweighted_problem(), witnessed=False).x
            return cls(compliance, problem.compute_objective(compliance), damping=1.0)
        return cls(clarabel_point, problem.compute_objective(clarabel_point), _LEAST_DAMPING)

    def take_step(self, problem: _HuberProblem) -> _HuberPoint | None:
        """Return the next point; None if the step goes too far, so that the objective rises."""
        proposed, model_certificate = problem.minimise_quadratic_model(self.compliance, self.damping)
        objective = problem.compute_objective(proposed)
        has_risen = objective > self.objective * (1.0 + _NO_DESCENT)
        if has_risen and self.damping < 1.0:
            return None
        damping = max(0.1 * self.damping, _LEAST_DAMPING)
        return _HuberPoint(proposed, objective, damping, model_certificate.solved_by)


def _minimise_huber_loss(problem: _HuberProblem) -> tuple[FloatArray, Certificate]:
    """Return the optimum (p,) of the Huber problem and its certificate.

    Clarabel's point is refined by Newton's method. With more than `MOST_STATED` readings, least squares gives
    the start instead, with full damping, because that is faster than Clarabel. A step of Newton's method that
    goes too far is repeated from the same point with full damping, which always descends.

    Raises:
        SolverError: no certified optimum after `MOST_ROUNDS` rounds.
    """
    clarabel_point = _solve_by_clarabel(problem) if len(problem.target_rows) <= MOST_STATED else None
    point = _HuberPoint.start(problem, clarabel_point)
    certificate: Certificate | None = None
    for _ in range(MOST_ROUNDS):
        next_point = point.take_step(problem)
        if next_point is None:
            point = point._replace(damping=1.0)
            continue
        point = next_point
        certificate = _certify_huber_point(problem, point, clarabel_point)
        if certificate.is_optimal():
            return point.compliance, _add_witness(problem, certificate, clarabel_point, point.compliance)
    raise _build_no_huber_optimum_error(certificate)


def _certify_huber_point(
    problem: _HuberProblem, point: _HuberPoint, clarabel_point: FloatArray | None
) -> Certificate:
    """Return the certificate of a point after a step.

    Clarabel found the active bounds if the point has zeros at the same joints as Clarabel's own point (p,).
    """
    solved_by = point.solved_by or "clarabel"
    if clarabel_point is not None and np.array_equal(clarabel_point == 0.0, point.compliance == 0.0):
        solved_by = "clarabel"
    return problem.certify_point(point.compliance, solved_by)


def _build_no_huber_optimum_error(last: Certificate | None) -> SolverError:
    """Build the error for a search without an optimum; `last` is the certificate of its last point."""
    violations = "" if last is None else f" (primal {last.primal:.1e}, dual {last.dual:.1e})"
    return SolverError(
        f"the fit with the Huber loss did not converge to an optimum{violations}",
        where="loss",
        remedy="use loss squared, and report this problem with the data",
    )


def _solve_by_clarabel(problem: _HuberProblem) -> FloatArray | None:
    """Return Clarabel's optimum (p,) of the Huber problem; None if Clarabel fails.

    The loss of the targets' rows [A d] is Huber's, that of all other rows [S t] is squared.
    """
    from jointstiff.solver.fit import programs  # takes a second to import

    A, d = problem.target_rows[..., :-1], problem.target_rows[..., -1]
    S, t = problem.other_rows[..., :-1], problem.other_rows[..., -1]
    least_squares = problem.build_unweighted_problem()  # has the same constraints and units of variables
    return programs.solve_huber(A, d, S, t, least_squares)


def _add_witness(
    problem: _HuberProblem, certificate: Certificate, clarabel_point: FloatArray | None, optimum: FloatArray
) -> Certificate:
    """Return the certificate of an optimum (p,) with its distance from Clarabel's point, its witness.

    A problem of more than `MOST_STATED` readings has no witness, as Clarabel did not solve the problem.
    """
    if len(problem.target_rows) > MOST_STATED:
        return certificate
    rows = problem.target_rows.reshape(-1, problem.target_rows.shape[-1])
    A, d = rows[:, :-1], rows[:, -1]
    return replace(certificate, witness=compare_answers(A, clarabel_point, optimum, d))


def _estimate_robust_scale(problem: _HuberProblem, threshold: float) -> float:
    """Return the robust scale of the residuals [m]: their median norm, made a standard deviation.

    A fit with the Huber loss needs the scale, and the scale needs the residuals of the fit: both are
    repeated to convergence. The scale is at least `_LEAST_SCALE` times the root mean square of the readings.

    Args:
        problem: rows in metres.
        threshold: length of a residual from which the loss is linear, in units of the scale.

    Raises:
        UnsupportedMethodError: there are no more readings than parameters.
    """
    compliance = solve(problem.build_unweighted_problem(), witnessed=False).x
    deflections = problem.target_rows[..., -1]
    factor = _find_factor_of_median_norm(deflections.size, len(compliance))
    least_scale = _LEAST_SCALE * float(np.sqrt(np.mean(deflections**2)))
    scale = np.inf
    for _ in range(_SCALE_ROUNDS):
        _, norms = problem.residuals_at(compliance)
        previous_scale = scale
        scale = max(least_scale, factor * float(np.median(norms)))
        if abs(scale - previous_scale) <= _SCALE_TOLERANCE * scale:
            break
        in_thresholds = problem.with_residuals_in(threshold * scale)
        compliance, _ = in_thresholds.minimise_quadratic_model(compliance, damping=1.0)
    return scale


def _find_factor_of_median_norm(coordinates: int, parameters: int) -> float:
    """Return the factor from the median norm of the targets' residuals to sigma of one coordinate.

    A fit of p parameters to m coordinates shrinks the residuals by √((m − p)/m) on average.

    Raises:
        UnsupportedMethodError: there are no more coordinates than parameters.
    """
    degrees_of_freedom = coordinates - parameters
    if degrees_of_freedom < 1:
        raise UnsupportedMethodError(
            "the Huber loss needs sigma, but sigma cannot be estimated: there are no more readings than "
            "joints",
            where="loss",
            remedy="state `noise`, or add observations",
        )
    return float(np.sqrt(coordinates / degrees_of_freedom)) / MEDIAN_NORM
