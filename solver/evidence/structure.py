"""Gearboxes and structure apart: compliances in front of encoders and behind them (method.md §18).

An encoder behind the gearbox of joint j sees the gearbox alone, targets see gearbox and structure, such as
bearings and housings. While the encoders behind the gearboxes close the position loop, gearboxes do
not move the targets:

    twist_j = c_gear,j τ_j      δp_X = Σ_j J_j (c_gear,j + c_rest,j) τ_j      δp_X' = Σ_j J_j c_rest,j τ_j.

All are unknowns of one fit, together with what is stated of the loads. Noise, and turns that tracker and
encoders both see, are those of the residuals with all unknowns free: structure is not taken for noise.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from math import isfinite
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy import special
from scipy.optimize import nnls

from jointstiff.schemas.finding import Verdict
from jointstiff.schemas.run import JointResult
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.evidence.scatter import find_most_likely_scatter
from jointstiff.solver.fit.cone import Scalars
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.estimate import (
    Estimate,
    compute_interval_ends,
    invert_compliance,
    stiffness_interval,
)
from jointstiff.solver.fit.observability import Excitation
from jointstiff.solver.fit.problem import LeastSquares, Problem
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import solve
from jointstiff.solver.fit.stages import Likelihood, student_quantile
from jointstiff.solver.fit.triangle import Triangle
from jointstiff.solver.mechanics.block import BlockRows, Term, build_rows, fitted_errors
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.springs import JOINTS, STRUCTURE
from jointstiff.solver.mechanics.terms import FORCE_SCALE, LOAD_POINT, list_stated_terms

STRUCTURE_LEVEL: Final = 0.05
"""Significance level of the test for structure that bends: of joints whose encoders see all, one campaign in
twenty gets wider intervals for nothing."""
_AGAINST_LEVEL: Final = 1e-3
"""Significance level of the tests whether encoders see more than the targets, which no structure explains,
and whether they see something else than the difference of two runs."""


JointStatus = Literal["identified", "uncertain", "at_bound"]
PartName = Literal["gearboxes", "structure"]
"""Part of a joint: its gearbox, or what bends behind it, such as bearings and housings."""


@dataclass(frozen=True, eq=False)
class PartOfJoints:
    """Compliances of one part of m joints."""

    joints: IndexArray  #: (m,) indices of the joints
    compliance: FloatArray  #: (m,) at least zero [rad/(N·m)]
    uncertainty: FloatArray  #: (m,) standard uncertainties of the free compliances [rad/(N·m)]
    interval: FloatArray  #: (m, 2) intervals of the compliances [rad/(N·m)]


@dataclass(frozen=True, eq=False)
class Apart:
    """Compliances of m joints in front of their encoders and behind them."""

    joints: IndexArray  #: (m,) indices of the joints
    compliance: FloatArray  #: (2, m) of gearboxes, then of structure, at least zero [rad/(N·m)]
    free_compliance: FloatArray  #: (2, m) without the constraint [rad/(N·m)]
    uncertainty: FloatArray  #: (2, m) standard uncertainties of the free compliances [rad/(N·m)]
    interval: FloatArray  #: (2, m, 2) intervals of the compliances [rad/(N·m)]
    #: (m,) standard uncertainty of an angle of each encoder, as the residuals show it [rad]
    noise: FloatArray
    p_value: float  #: of the test that nothing behind the encoders bends
    #: (m,) by how much more an encoder shows than the difference of two runs, in standard uncertainties;
    #: zeros for a single run
    excess: FloatArray

    def select_part(self, name: PartName) -> PartOfJoints:
        """Return the compliances of one part of all m joints."""
        part = 0 if name == "gearboxes" else 1  # row of the arrays
        return PartOfJoints(self.joints, self.compliance[part], self.uncertainty[part], self.interval[part])

    @property
    def shows_structure(self) -> bool:
        """True if encoders and targets do not see the same."""
        return self.p_value < STRUCTURE_LEVEL or bool(len(self.against))

    @cached_property
    def against(self) -> IndexArray:
        """Indices of the joints whose encoders see more than the targets, which no structure explains.

        The free compliance of the structure is then negative beyond chance.
        """
        standardised_structure = self.free_compliance[1] / self.uncertainty[1]
        p_values = len(self.joints) * special.ndtr(standardised_structure)  # Bonferroni
        return np.asarray(self.joints[p_values < _AGAINST_LEVEL])

    @cached_property
    def differing(self) -> IndexArray:
        """Indices of the joints whose encoders see something else than the difference of two runs."""
        p_values = 2.0 * len(self.joints) * special.ndtr(-np.abs(self.excess))  # two-sided, Bonferroni
        return np.asarray(self.joints[p_values < _AGAINST_LEVEL])


def build_parts(apart: Apart | None, name: PartName, names: Sequence[str]) -> list[JointResult]:
    """Build one message for each joint that is taken apart.

    Args:
        apart: gearboxes and structure; None without any.
        name: which of the two parts.
        names: names of the n joints.
    """
    if apart is None:
        return []
    part = apart.select_part(name)
    messages = []
    for k, joint in enumerate(part.joints.tolist()):
        compliance, uncertainty = float(part.compliance[k]), float(part.uncertainty[k])
        messages.append(_build_part(names[joint], compliance, uncertainty, part.interval[k]))
    return messages


def _build_part(name: str, compliance: float, uncertainty: float, interval: FloatArray) -> JointResult:
    """Build the message of one part of a joint.

    Args:
        name: name of the joint.
        compliance: of the part, at least zero [rad/(N·m)].
        uncertainty: standard uncertainty of the compliance [rad/(N·m)].
        interval: (2,) of the compliance [rad/(N·m)]; an interval with zero leaves open whether it bends.
    """
    lower, upper = interval.tolist()
    status: JointStatus = "uncertain" if compliance > 0.0 else "at_bound"
    verdict: Verdict = "use_with_care"
    if lower > 0.0:
        status, verdict = "identified", "use"
    return JointResult(
        name=name,
        status=status,
        verdict=verdict,
        compliance=compliance,
        stiffness=invert_compliance(compliance),
        standard_uncertainty=uncertainty,
        compliance_interval=(lower, upper),
        stiffness_interval=stiffness_interval((lower, upper)),
        reason=None,
    )


@dataclass(frozen=True, eq=False)
class TargetsEstimate:
    """Compliances of n joints by the targets of N observations."""

    rows: Rows  #: N observations
    compliance: FloatArray  #: (n,) at which the columns of errors are computed; NaN without one [rad/(N·m)]
    is_seen: BoolArray  #: (n,) mask of the joints that the targets show
    sigma: float  #: standard uncertainty of a coordinate of a reading [m]
    degrees_of_freedom: float = np.inf  #: degrees of freedom of sigma; inf if it was given

    @property
    def linearisation(self) -> FloatArray:
        """Compliances (n,) of at least zero, at which columns are computed [rad/(N·m)]."""
        return np.maximum(np.nan_to_num(self.compliance), 0.0)


def take_apart(rows: Rows, of_targets: Estimate, confidence: float) -> Apart | None:
    """Return the compliances of gearboxes and of structure, fitted to one run.

    None if no joint shows both, or if the fit of both fails: its optimum is not certified, or the readings do
    not determine all unknowns.

    Args:
        rows: N observations with readings of encoders, with the scatter that was stated.
        of_targets: estimate from the targets alone.
        confidence: level of the intervals.
    """
    measurements = rows.measurements
    if measurements.encoders is None or measurements.sigma is None:
        return None
    is_seen = ~of_targets.observability.null  # (n,) joints that have an effect on the targets
    bent_rows = rows.at(of_targets.balanced)  # of the robot as the loads bend it
    run = TargetsEstimate(bent_rows, of_targets.compliance, is_seen, measurements.sigma)
    joints = _find_joints(run, is_seen)  # joints that show gearbox and structure
    if not len(joints):
        return None
    try:
        return _fit_one_run(run, joints, confidence)
    except (SolverError, np.linalg.LinAlgError):
        return None


def _fit_one_run(run: TargetsEstimate, joints: IndexArray, confidence: float) -> Apart:
    """Fit gearboxes and structure of some joints (m,) to the targets and encoders of one run.

    Other joints have one compliance, because the targets show only the sum of both of their parts.

    Raises:
        SolverError: the fit has no certified optimum.
        LinAlgError: the readings do not determine all unknowns.
    """
    measurements = run.rows.measurements
    equations = _state_motor_run(run, joints, _list_errors(measurements))
    has_structure = np.isin(np.arange(run.rows.robot.n), joints)
    uncertainty_of_scale = sum(FORCE_SCALE.prior(measurements.common_uncertainty))
    problem = _Problem.of(equations, joints, run.is_seen, has_structure)
    return problem.solve(confidence, uncertainty_of_scale)


def take_two_runs_apart(
    motor: TargetsEstimate,
    secondary: TargetsEstimate,
    confidence: float,
    *,
    same_load: bool,
    same_cell: bool,
) -> Apart | None:
    """Return the compliances of gearboxes and of structure, by one fit of two runs.

    None if no joint shows both, or if the fit fails: its optimum is not certified, or the readings do not
    determine all unknowns.

    Args:
        motor: run with readings of encoders, in which the encoders of the motors close the position loop.
        secondary: run in which the encoders behind the gearboxes close the position loop.
        confidence: level of the intervals.
        same_load: whether the error of the load point is the same in both runs.
        same_cell: whether the error of the scale of all loads is the same in both runs.
    """
    joints = _find_joints(motor, motor.is_seen & secondary.is_seen)
    if not len(joints):
        return None
    # A scale that both runs share changes all compliances alike: it is no unknown, but widens the intervals.
    scale = motor.rows.measurements.common_uncertainty.scale if same_cell else 0.0
    freedom = min(motor.degrees_of_freedom, secondary.degrees_of_freedom)
    try:
        equations = _join_runs(motor, secondary, joints, same_load=same_load, same_cell=same_cell)
        problem = _Problem.of(equations, joints, motor.is_seen, secondary.is_seen)
        return problem.solve(confidence, scale, freedom)
    except (SolverError, np.linalg.LinAlgError):
        return None


def _join_runs(
    motor: TargetsEstimate,
    secondary: TargetsEstimate,
    joints: IndexArray,
    *,
    same_load: bool,
    same_cell: bool,
) -> _Equations:
    """Return the equations of two runs, in which errors that both runs share are one unknown.

    Args:
        motor: run in which the encoders of the motors close the position loop.
        secondary: run in which the encoders behind the gearboxes close the position loop.
        joints: (m,) joints that are taken apart.
        same_load: whether the error of the load point is the same in both runs.
        same_cell: whether the error of the scale of all loads is the same; then it is no unknown.
    """
    errors_of_motor = _list_errors(motor.rows.measurements, with_scale=not same_cell)
    errors_of_secondary = _list_errors(secondary.rows.measurements, with_scale=not same_cell)
    shared = [LOAD_POINT.name] if same_load else []
    of_motor = _state_motor_run(motor, joints, errors_of_motor)
    of_secondary = _state_secondary_run(secondary, errors_of_secondary, shared)
    return of_motor.join(of_secondary, shared)


def _find_joints(motor: TargetsEstimate, is_seen: BoolArray) -> IndexArray:
    """Return the joints (m,) whose compliance both the targets and an encoder under a torque show."""
    encoders = motor.rows.measurements.encoders
    if encoders is None:
        return np.zeros(0, np.intp)
    is_loaded = ~Excitation.of(motor.rows).observability().null
    return np.flatnonzero(is_seen & is_loaded & encoders.present.any(axis=0))


def _list_errors(measurements: Measurements, *, with_scale: bool = False) -> list[Term]:
    """Return the errors that are fitted; `with_scale` adds an uncertain scale of all loads."""
    errors = [*fitted_errors(measurements).terms, *list_stated_terms(measurements)]
    if with_scale and any(FORCE_SCALE.prior(measurements.common_uncertainty)):
        errors.append(FORCE_SCALE)
    return errors


@dataclass(frozen=True, eq=False)
class _Equations:
    """Rows of all readings and statements of a run, in units of their noise."""

    matrix: FloatArray  # (k, K) columns of joints, of structure, then of errors
    rhs: FloatArray  # (k,)
    span: dict[str, IndexArray]  # name of a term → its columns
    noise: FloatArray  # (n,) noise of the encoders, as the residuals show it [rad]
    #: (k, n) columns that only a second run has, of compliances behind the encoders; None for one run
    second: FloatArray | None = None

    @classmethod
    def of(
        cls,
        rows: Rows,
        generated: Iterable[BlockRows],
        errors: Sequence[Term],
        unstated: Collection[str] = (),
    ) -> _Equations:
        """Compress whitened rows, and add what is stated of errors.

        Args:
            rows: N observations, with the scatter of the fit and with sigma.
            generated: whitened rows of the blocks.
            errors: terms of errors.
            unstated: names of errors that are stated elsewhere.
        """
        measurements = rows.measurements
        sigma = measurements.sigma or 1.0
        triangle = _compress_blocks(generated)
        uncertainties = _list_uncertainties(errors, triangle, measurements)
        unit = np.ones(triangle.matrix.shape[1])
        for name, uncertainty in uncertainties.items():
            if name in unstated:
                unit[triangle.span[name]] = uncertainty
            else:
                triangle = triangle.state_as_zero(name, uncertainty, sigma)
        noise = _list_encoder_noise(measurements, rows.robot.n)
        return cls(triangle.matrix * unit / sigma, triangle.rhs / sigma, triangle.span, noise)

    def join(self, second: _Equations, shared: Collection[str]) -> _Equations:
        """Return the equations of two runs; the joints of the second run are structure of the first.

        Args:
            second: equations of the second run.
            shared: names of errors that are the same in both runs.
        """
        height, width = self.matrix.shape
        places = np.full(second.matrix.shape[1], -1)  # columns of the second run among those of both
        places[second.span[JOINTS.name]] = self.span[STRUCTURE.name]
        for name in shared:
            places[second.span[name]] = self.span[name]
        is_own = places < 0  # unknowns of the second run alone: further columns
        places[is_own] = width + np.arange(is_own.sum())
        matrix = np.zeros((height + len(second.matrix), width + is_own.sum()))
        matrix[:height, :width] = self.matrix
        matrix[height:, places] = second.matrix
        of_second = np.zeros((len(matrix), len(self.noise)))
        of_second[height:] = second.matrix[:, second.span[JOINTS.name]]
        rhs = np.concatenate([self.rhs, second.rhs])
        return _Equations(matrix, rhs, self.span, self.noise, of_second)


def _compress_blocks(generated: Iterable[BlockRows]) -> Triangle:
    """Return the triangular factor of the rows of all blocks: fits to it are fits to the rows."""
    remaining = iter(generated)
    first = next(remaining)
    triangle = Triangle(**first.widths)
    for of_block in chain([first], remaining):
        triangle.add(of_block.flat, count=int(of_block.read.sum()))
    return triangle


def _list_uncertainties(
    errors: Sequence[Term], triangle: Triangle, measurements: Measurements
) -> dict[str, FloatArray]:
    """Return name of an error → standard uncertainties (k,) of its k unknowns, as the measurements state.

    Errors without a stated size are left out: they are fitted freely.
    """
    uncertainties = {}
    for term in errors:
        stated = term.prior(measurements.common_uncertainty)
        if any(stated):
            uncertainties[term.name] = np.resize(stated, len(triangle.span[term.name]))
    return uncertainties


def _list_encoder_noise(measurements: Measurements, joint_count: int) -> FloatArray:
    """Return the noise (n,) of the encoders of n joints [rad]: the stated one times what residuals show."""
    stated_noise = 0.0 if measurements.encoders is None else measurements.encoders.sigma
    factors = measurements.scatter.encoders or (1.0,) * joint_count
    return stated_noise * np.array(factors)


def _state_motor_run(run: TargetsEstimate, joints: IndexArray, errors: Sequence[Term]) -> _Equations:
    """Return the equations of a run with readings of encoders.

    Args:
        run: the run.
        joints: (m,) joints that are taken apart.
        errors: terms of errors.
    """
    terms = [JOINTS, STRUCTURE, *errors]
    whole, n = run.linearisation, run.rows.robot.n
    gear = _fit_gearboxes(run.rows, whole, joints)
    seen = np.flatnonzero(run.is_seen)

    def list_columns(width: int) -> IndexArray:
        """Return the fitted columns: of joints that are seen, of structure, and of errors."""
        return np.concatenate([seen, n + joints, np.arange(2 * n, width)])

    rows = run.rows.with_scatter(find_most_likely_scatter(run.rows, terms, whole, list_columns))
    return _Equations.of(rows, _generate(rows, terms, whole, gear), errors)


def _state_secondary_run(
    run: TargetsEstimate, errors: Sequence[Term], unstated: Collection[str]
) -> _Equations:
    """Return the equations of a run without gearboxes; `unstated` are errors that the other run states."""
    terms = [JOINTS, *errors]
    compliance, n = run.linearisation, run.rows.robot.n
    rows = run.rows.of(replace(run.rows.measurements, sigma=run.sigma, encoders=None))
    seen = np.flatnonzero(run.is_seen)

    def list_columns(width: int) -> IndexArray:
        """Return the fitted columns: of joints that are seen, and of errors."""
        return np.concatenate([seen, np.arange(n, width)])

    rows = rows.with_scatter(find_most_likely_scatter(rows, terms, compliance, list_columns))
    return _Equations.of(rows, rows.generate(terms, compliance), errors, unstated)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Equations of the unknowns that the readings show: compliances come first, then errors."""

    equations: _Equations
    columns: IndexArray  # (K,) fitted columns
    joints: IndexArray  # (m,) joints that are taken apart
    compliance_count: int  # number of compliances among the unknowns
    of_gearboxes: IndexArray  # (m,) positions of their compliances among the fitted columns
    of_structure: IndexArray  # (m,) positions of the compliances of their structure

    @classmethod
    def of(
        cls, equations: _Equations, joints: IndexArray, is_seen: BoolArray, is_behind: BoolArray
    ) -> _Problem:
        """Choose the unknowns.

        Args:
            equations: rows of readings and statements.
            joints: (m,) joints that are taken apart.
            is_seen: (n,) mask of the joints that the run with encoders shows.
            is_behind: (n,) mask of the joints with structure behind encoders.
        """
        n = len(is_seen)
        seen, behind = np.flatnonzero(is_seen), np.flatnonzero(is_behind)
        errors = np.arange(2 * n, equations.matrix.shape[1])
        return cls(
            equations,
            np.concatenate([seen, n + behind, errors]),
            joints,
            len(seen) + len(behind),
            np.searchsorted(seen, joints),
            len(seen) + np.searchsorted(behind, joints),
        )

    def solve(self, confidence: float, scale: float, degrees_of_freedom: float = np.inf) -> Apart:
        """Fit compliances of at least zero; return them with intervals.

        Args:
            confidence: level of the intervals.
            scale: standard uncertainty of a scale of all loads, which is none of the unknowns.
            degrees_of_freedom: degrees of freedom of the noise; inf if it was given.
        """
        matrix = self.equations.matrix[:, self.columns]
        unit = 1.0 / np.linalg.norm(matrix, axis=0)  # columns are scaled to unit norm
        squares = LeastSquares(matrix * unit, self.equations.rhs)
        best = solve(Problem(squares, Scalars(self._bounds))).x
        free = _fit_freely(squares.R, squares.z)
        likelihood = self._add_scale_of_loads(free, scale)
        radius = _find_radius(confidence, degrees_of_freedom)
        return Apart(
            joints=self.joints,
            compliance=self._split_parts(unit * best),
            free_compliance=self._split_parts(unit * free.unknowns),
            uncertainty=self._split_parts(unit * np.sqrt(np.diagonal(likelihood.covariance))),
            interval=self._split_parts(unit)[..., None] * self._compute_intervals(likelihood, best, radius),
            noise=self.equations.noise[self.joints],
            p_value=_test_for_structure(free.select(self.of_structure)),
            excess=self._compare_runs(squares.R),
        )

    @property
    def _is_compliance(self) -> BoolArray:
        """(K,) mask of the compliances among the unknowns; the other unknowns are errors."""
        return np.arange(len(self.columns)) < self.compliance_count

    @property
    def _bounds(self) -> Bounds:
        """Bounds of the K unknowns: compliances are at least zero, and errors have any sign."""
        lower = np.where(self._is_compliance, 0.0, -np.inf)
        return Bounds(lower, np.full(len(self.columns), np.inf))

    @property
    def _places_of_parts(self) -> IndexArray:
        """(2, m) positions among the K unknowns: of m gearboxes, then of the structure behind them."""
        return np.stack([self.of_gearboxes, self.of_structure])

    def _split_parts(self, of_unknowns: FloatArray) -> FloatArray:
        """Return the values (2, m) of m gearboxes and of their structure, from those of all unknowns (K,)."""
        return of_unknowns[self._places_of_parts]

    def _add_scale_of_loads(self, free: _FreeFit, scale: float) -> Likelihood:
        """Return the likelihood of the K unknowns, widened by an error of the scale of all loads.

        Loads that are larger by one percent make all compliances smaller by one percent, which no reading
        shows. `scale` is the standard uncertainty of that factor; errors do not depend on it.
        """
        response = np.where(self._is_compliance, free.unknowns, 0.0) * scale
        unknowns = np.arange(len(free.unknowns))
        return Likelihood(unknowns, free.unknowns, free.covariance).add_common_errors(response[:, None])

    def _compute_intervals(self, likelihood: Likelihood, best: FloatArray, radius: float) -> FloatArray:
        """Return the intervals (2, m, 2) of the scaled compliances of m gearboxes and of their structure.

        Args:
            likelihood: likelihood of the K unknowns.
            best: (K,) estimates, with compliances of at least zero.
            radius: half-width of an interval, in standard uncertainties.
        """
        places = self._places_of_parts.ravel()
        selection = np.eye(len(best))[places]  # each row selects one compliance
        constraints = Constraints(self._bounds)
        (ends,) = compute_interval_ends(likelihood, constraints, selection, np.array([radius]), best[places])
        return np.reshape(ends, (2, len(self.joints), 2))

    def _compare_runs(self, scaled: FloatArray) -> FloatArray:
        """Return how much more than the difference of two runs the encoders show [standard uncertainties].

        Each joint may have another compliance behind its encoder in the second run: zero if both agree.

        Args:
            scaled: (k, K) columns of the unknowns, of unit norm.

        Returns:
            (m,) zeros for a single run.
        """
        second = self.equations.second
        if second is None:
            return np.zeros(len(self.joints))
        further = second[:, self.joints]
        further = further / np.linalg.norm(further, axis=0)
        free = _fit_freely(np.concatenate([further, scaled], axis=1), self.equations.rhs)
        return (free.unknowns / np.sqrt(np.diagonal(free.covariance)))[: len(self.joints)]


class _FreeFit(NamedTuple):
    """Least-squares fit without constraints."""

    unknowns: FloatArray  # (K,)
    covariance: FloatArray  # (K, K) of the unknowns

    def select(self, places: IndexArray) -> _FreeFit:
        """Return the fit of some of the unknowns, given by their positions."""
        return _FreeFit(self.unknowns[places], self.covariance[np.ix_(places, places)])


def _fit_freely(matrix: FloatArray, rhs: FloatArray) -> _FreeFit:
    """Fit the unknowns (K,) of equations ``matrix (k, K) · unknowns = rhs (k,)`` by least squares.

    The equations are in units of their noise, so that the covariance is the inverse of ``matrixᵀ matrix``.
    """
    unknowns = np.asarray(np.linalg.lstsq(matrix, rhs, rcond=None)[0])
    inverse = np.linalg.inv(np.linalg.qr(matrix)[1])
    return _FreeFit(unknowns, inverse @ inverse.T)


def _find_radius(confidence: float, degrees_of_freedom: float) -> float:
    """Return the half-width of an interval of some confidence, in standard uncertainties (Student's t)."""
    freedom = degrees_of_freedom if isfinite(degrees_of_freedom) else None
    return student_quantile(0.5 * (1.0 + confidence), freedom)


def _test_for_structure(free: _FreeFit) -> float:
    """Return the p-value of the hypothesis that no structure bends, against compliances of at least zero.

    The likelihood ratio statistic has the distribution ``Σ_k w_k χ²_k`` (Kudo, *Biometrika* 50, 1963); w_k is
    the probability that k of m compliances are positive, here of independent ones.

    Args:
        free: compliances of structure of m joints, fitted without the constraint.
    """
    count = len(free.unknowns)
    root = np.linalg.inv(np.linalg.cholesky(free.covariance))
    _, distance = nnls(root, root @ free.unknowns)
    statistic = float(np.square(root @ free.unknowns).sum()) - distance**2
    if statistic <= 0.0:
        return 1.0
    number = np.arange(1, count + 1)
    weights = special.comb(count, number) / 2.0**count
    return float(weights @ special.chdtrc(number, statistic))


def _fit_gearboxes(rows: Rows, whole: FloatArray, joints: IndexArray) -> FloatArray:
    """Return compliances (n,) of gearboxes by the encoders alone, and of other joints by the targets.

    A gearbox turns by its compliance times its torque: least squares give ``Σ torque · turn / Σ torque²``.

    Args:
        rows: N observations with encoders.
        whole: (n,) compliances by the targets, of gearboxes and the structure behind them [rad/(N·m)].
        joints: indices of the joints whose encoders are used.
    """
    products, squares = np.zeros(len(whole)), np.zeros(len(whole))
    for block in rows.generate_blocks():
        # (B, n, n + 1): for the encoder of each joint, the columns of n compliances, then the reading
        of_encoders = build_rows(block, [JOINTS], whole).encoders
        if of_encoders is not None:
            torque = np.diagonal(of_encoders, axis1=1, axis2=2)  # (B, n), the column of the joint itself
            turn = of_encoders[..., -1]
            products += (torque * turn).sum(axis=0)
            squares += np.square(torque).sum(axis=0)
    gear = whole.copy()
    gear[joints] = np.maximum(products[joints] / squares[joints], 0.0)
    return gear


def _generate(rows: Rows, terms: Sequence[Term], whole: FloatArray, gear: FloatArray) -> Iterator[BlockRows]:
    """Yield whitened rows, in which errors of loads bend gearboxes alone where encoders see them."""
    of_targets = rows.generate(terms, whole, whitened=False)
    of_encoders = rows.generate(terms, gear, whitened=False)
    for seen_by_targets, seen_by_encoders in zip(of_targets, of_encoders, strict=True):
        yield seen_by_targets._replace(encoders=seen_by_encoders.encoders).whiten()
