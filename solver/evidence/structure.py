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
from typing import Final

import numpy as np
from scipy import special
from scipy.optimize import nnls

from jointstiff.schemas.run import JointResult
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.evidence.scatter import find_most_likely_scatter
from jointstiff.solver.fit.estimate import (
    Estimate,
    compute_interval_ends,
    invert_compliance,
    stiffness_interval,
)
from jointstiff.solver.fit.observability import Excitation
from jointstiff.solver.fit.problem import Bounds, Constraints, IdentificationProblem
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


@dataclass(frozen=True, eq=False)
class Apart:
    """Compliances of m joints in front of their encoders and behind them."""

    joints: IndexArray  #: (m,) indices of the joints
    compliance: FloatArray  #: (2, m) of gearboxes, then of structure, at least zero [rad/(N·m)]
    free_compliance: FloatArray  #: (2, m) without the constraint [rad/(N·m)]
    uncertainty: FloatArray  #: (2, m) standard uncertainties of the free compliances [rad/(N·m)]
    interval: FloatArray  #: (2, m, 2) intervals of the compliances [rad/(N·m)]
    noise: (
        FloatArray  #: (m,) standard uncertainty of an angle of each encoder, as the residuals show it [rad]
    )
    p_value: float  #: of the test that nothing behind the encoders bends
    #: (m,) by how much more an encoder shows than the difference of two runs, in standard uncertainties;
    #: zeros for a single run
    excess: FloatArray

    @property
    def shows_structure(self) -> bool:
        """True if encoders and targets do not see the same."""
        return self.p_value < STRUCTURE_LEVEL or bool(len(self.against))

    @cached_property
    def against(self) -> IndexArray:
        """Indices of the joints whose encoders see more than the targets, which no structure explains."""
        standardised = self.free_compliance[1] / self.uncertainty[1]
        p_values = len(self.joints) * special.ndtr(standardised)
        return np.asarray(self.joints[p_values < _AGAINST_LEVEL])

    @cached_property
    def differing(self) -> IndexArray:
        """Indices of the joints whose encoders see something else than the difference of two runs."""
        p_values = 2.0 * len(self.joints) * special.ndtr(-np.abs(self.excess))
        return np.asarray(self.joints[p_values < _AGAINST_LEVEL])


def build_parts(apart: Apart | None, part: int, names: Sequence[str]) -> list[JointResult]:
    """Build one message for each joint that is taken apart.

    Args:
        apart: gearboxes and structure; None without any.
        part: 0 for gearboxes, 1 for structure.
        names: names of the n joints.
    """
    if apart is None:
        return []
    messages = []
    for k, joint in enumerate(apart.joints.tolist()):
        compliance = float(apart.compliance[part, k])
        lower, upper = apart.interval[part, k].tolist()
        is_certain = lower > 0.0
        messages.append(
            JointResult(
                name=names[joint],
                status="identified" if is_certain else "uncertain" if compliance > 0.0 else "at_bound",
                verdict="use" if is_certain else "use_with_care",
                compliance=compliance,
                stiffness=invert_compliance(compliance),
                standard_uncertainty=float(apart.uncertainty[part, k]),
                compliance_interval=(lower, upper),
                stiffness_interval=stiffness_interval((lower, upper)),
                reason=None,
            )
        )
    return messages


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
    """Return the compliances of gearboxes and of structure; None if no joint shows both.

    Args:
        rows: N observations with readings of encoders, with the scatter that was stated.
        of_targets: estimate from the targets alone.
        confidence: level of the intervals.
    """
    measurements = rows.measurements
    if measurements.encoders is None or measurements.sigma is None:
        return None
    is_seen = ~of_targets.observability.null
    rows = rows.at(of_targets.balanced)
    run = TargetsEstimate(rows, of_targets.compliance, is_seen, measurements.sigma)
    joints = _find_joints(run, is_seen)
    if not len(joints):
        return None
    scale = FORCE_SCALE.prior(measurements.common_uncertainty)
    try:
        equations = _state_motor_run(run, joints, _list_errors(measurements))
        is_behind = np.isin(np.arange(rows.robot.n), joints)
        return _Problem.of(equations, joints, is_seen, is_behind).solve(confidence, sum(scale))
    except (SolverError, np.linalg.LinAlgError):
        return None


def take_two_runs_apart(
    motor: TargetsEstimate,
    secondary: TargetsEstimate,
    confidence: float,
    *,
    same_load: bool,
    same_cell: bool,
) -> Apart | None:
    """Return gearboxes and structure by one fit of two runs; None if no joint shows both.

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
    measured = [run.rows.measurements for run in (motor, secondary)]
    scale = measured[0].common_uncertainty.scale if same_cell else 0.0
    errors = [_list_errors(each, with_scale=not same_cell) for each in measured]
    shared = [LOAD_POINT.name] if same_load else []
    freedom = min(motor.degrees_of_freedom, secondary.degrees_of_freedom)
    try:
        first = _state_motor_run(motor, joints, errors[0])
        second = _state_secondary_run(secondary, errors[1], shared)
        problem = _Problem.of(first.join(second, shared), joints, motor.is_seen, secondary.is_seen)
        return problem.solve(confidence, scale, freedom)
    except (SolverError, np.linalg.LinAlgError):
        return None


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
        generated = iter(generated)
        first = next(generated)
        triangle = Triangle(**first.widths)
        for of_block in chain([first], generated):
            triangle.add(of_block.flat, count=int(of_block.read.sum()))
        unit = np.ones(triangle.matrix.shape[1])
        for term in errors:
            uncertainty = term.prior(measurements.common_uncertainty)
            if not any(uncertainty):
                continue  # fitted without a statement
            columns = triangle.span[term.name]
            if term.name in unstated:
                unit[columns] = np.resize(uncertainty, len(columns))
            else:
                triangle = triangle.state(term.name, np.resize(uncertainty, len(columns)), sigma)
        encoders = measurements.encoders
        stated_noise = 0.0 if encoders is None else encoders.sigma
        noise = stated_noise * np.array(measurements.scatter.encoders or (1.0,) * rows.robot.n)
        return cls(triangle.matrix * unit / sigma, triangle.rhs / sigma, triangle.span, noise)

    def join(self, second: _Equations, shared: Collection[str]) -> _Equations:
        """Return the equations of two runs; the joints of the second run are structure of the first.

        Args:
            second: equations of the second run.
            shared: names of errors that are the same in both runs.
        """
        height, width = self.matrix.shape
        places = np.full(second.matrix.shape[1], -1)
        places[second.span[JOINTS.name]] = self.span[STRUCTURE.name]
        for name in shared:
            places[second.span[name]] = self.span[name]
        is_own = places < 0
        places[is_own] = width + np.arange(is_own.sum())
        matrix = np.zeros((height + len(second.matrix), width + is_own.sum()))
        matrix[:height, :width] = self.matrix
        matrix[height:, places] = second.matrix
        of_second = np.zeros((len(matrix), len(self.noise)))
        of_second[height:] = second.matrix[:, second.span[JOINTS.name]]
        rhs = np.concatenate([self.rhs, second.rhs])
        return _Equations(matrix, rhs, self.span, self.noise, of_second)


def _state_motor_run(run: TargetsEstimate, joints: IndexArray, errors: Sequence[Term]) -> _Equations:
    """Return the equations of a run with readings of encoders.

    Args:
        run: the run.
        joints: (m,) joints that are taken apart.
        errors: terms of errors.
    """
    terms, whole, n = [JOINTS, STRUCTURE, *errors], run.linearisation, run.rows.robot.n
    gear = _fit_gearboxes(run.rows, whole, joints)
    seen = np.flatnonzero(run.is_seen)

    def list_columns(width: int) -> IndexArray:
        return np.concatenate([seen, n + joints, np.arange(2 * n, width)])

    rows = run.rows.with_scatter(find_most_likely_scatter(run.rows, terms, whole, list_columns))
    return _Equations.of(rows, _generate(rows, terms, whole, gear), errors)


def _state_secondary_run(
    run: TargetsEstimate, errors: Sequence[Term], unstated: Collection[str]
) -> _Equations:
    """Return the equations of a run without gearboxes; `unstated` are errors that the other run states."""
    terms, compliance, n = [JOINTS, *errors], run.linearisation, run.rows.robot.n
    rows = run.rows.of(replace(run.rows.measurements, sigma=run.sigma, encoders=None))
    seen = np.flatnonzero(run.is_seen)

    def list_columns(width: int) -> IndexArray:
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
        matrix, rhs = self.equations.matrix[:, self.columns], self.equations.rhs
        unit = 1.0 / np.linalg.norm(matrix, axis=0)
        is_compliance = np.arange(len(unit)) < self.compliance_count
        bounds = Bounds(np.where(is_compliance, 0.0, -np.inf), np.full(len(unit), np.inf))
        scaled = matrix * unit
        best = solve(IdentificationProblem(scaled, rhs, bounds)).compliance
        free, covariance = _fit_freely(scaled, rhs)
        # A scale of all loads changes all compliances alike, which no reading shows.
        response = np.where(is_compliance, free, 0.0) * scale
        likelihood = Likelihood(np.arange(len(free)), free, covariance).add_common_errors(response[:, None])
        wanted = np.concatenate([self.of_gearboxes, self.of_structure])
        freedom = degrees_of_freedom if isfinite(degrees_of_freedom) else None
        radius = np.array([student_quantile(0.5 * (1.0 + confidence), freedom)])
        functions = np.eye(len(free))[wanted]
        ends = compute_interval_ends(likelihood, Constraints(bounds), functions, radius, best[wanted])[0]
        deviation = np.sqrt(np.diagonal(likelihood.covariance)[wanted])
        shape = (2, len(self.joints))
        structure = self.of_structure
        return Apart(
            joints=self.joints,
            compliance=(unit[wanted] * best[wanted]).reshape(shape),
            free_compliance=(unit[wanted] * free[wanted]).reshape(shape),
            uncertainty=(unit[wanted] * deviation).reshape(shape),
            interval=(unit[wanted][:, None] * ends).reshape(*shape, 2),
            noise=self.equations.noise[self.joints],
            p_value=_test_for_structure(free[structure], covariance[np.ix_(structure, structure)]),
            excess=self._compare_runs(scaled),
        )

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
        free, covariance = _fit_freely(np.concatenate([further, scaled], axis=1), self.equations.rhs)
        return (free / np.sqrt(np.diagonal(covariance)))[: len(self.joints)]


def _fit_freely(matrix: FloatArray, rhs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the unknowns (K,) of equations without constraints, and their covariance (K, K)."""
    free = np.asarray(np.linalg.lstsq(matrix, rhs, rcond=None)[0])
    inverse = np.linalg.inv(np.linalg.qr(matrix)[1])
    return free, inverse @ inverse.T


def _test_for_structure(free: FloatArray, covariance: FloatArray) -> float:
    """Return the p-value of the hypothesis that no structure bends, against compliances of at least zero.

    The likelihood ratio statistic has the distribution ``Σ_k w_k χ²_k`` (Kudo, *Biometrika* 50, 1963); w_k is
    the probability that k of m compliances are positive, here of independent ones.

    Args:
        free: (m,) compliances of structure without the constraint.
        covariance: (m, m) of these compliances.
    """
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    _, distance = nnls(root, root @ free)
    statistic = float(np.square(root @ free).sum()) - distance**2
    if statistic <= 0.0:
        return 1.0
    number = np.arange(1, len(free) + 1)
    weights = special.comb(len(free), number) / 2.0 ** len(free)
    return float(weights @ special.chdtrc(number, statistic))


def _fit_gearboxes(rows: Rows, whole: FloatArray, joints: IndexArray) -> FloatArray:
    """Return compliances (n,) of gearboxes by the encoders alone, and of other joints by the targets."""
    products, squares = np.zeros(len(whole)), np.zeros(len(whole))
    for block in rows.generate_blocks():
        of_encoders = build_rows(block, [JOINTS], whole).encoders
        if of_encoders is not None:
            torque = np.diagonal(of_encoders, axis1=1, axis2=2)
            products += (torque * of_encoders[..., -1]).sum(axis=0)
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
