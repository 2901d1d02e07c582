"""Gearboxes and structure apart: compliances in front of encoders and behind them (method.md §18).

An encoder behind the gearbox of joint j sees the gearbox alone, targets see gearbox and structure, such as
bearings and housings:

    twist_j = c_gear,j τ_j        δp_X = Σ_j J_j (c_gear,j + c_rest,j) τ_j.

Both are unknowns of one fit, together with what is stated of the load. Noise, and turns that tracker and
encoders both see, are those of the residuals with both unknowns free: structure is not taken for noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Final

import numpy as np
from scipy import special
from scipy.optimize import nnls

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.evidence.scatter import find_scatter_of_terms
from jointstiff.solver.fit.estimate import Estimate, compute_interval_ends
from jointstiff.solver.fit.observability import Excitation
from jointstiff.solver.fit.problem import Bounds, Constraints, IdentificationProblem
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import solve
from jointstiff.solver.fit.stages import Likelihood, student_quantile
from jointstiff.solver.fit.statements import list_stated_terms
from jointstiff.solver.fit.triangle import Triangle
from jointstiff.solver.mechanics.block import BlockRows, Term, build_rows, fitted_errors
from jointstiff.solver.mechanics.springs import JOINTS, STRUCTURE
from jointstiff.solver.mechanics.terms import FORCE_SCALE

STRUCTURE_LEVEL: Final = 0.05
"""Significance level of the test for structure that bends: of joints whose encoders see all, one campaign in
twenty gets wider intervals for nothing."""
_AGAINST_LEVEL: Final = 1e-3
"""Significance level of the test whether encoders see more than the targets, which no structure explains."""


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


def take_apart(rows: Rows, of_targets: Estimate, confidence: float) -> Apart | None:
    """Return the compliances of gearboxes and of structure; None if no joint shows both.

    Args:
        rows: N observations with readings of encoders, with the scatter that was stated.
        of_targets: estimate from the targets alone.
        confidence: level of the intervals.
    """
    measurements = rows.measurements
    encoders, sigma = measurements.encoders, measurements.sigma
    if encoders is None or sigma is None:
        return None
    rows = rows.at(of_targets.balanced)
    # Readings of targets, and a torque on the gearbox, both show a compliance.
    is_seen = ~of_targets.observability.null
    is_apart = is_seen & ~Excitation.of(rows).observability().null & encoders.present.any(axis=0)
    joints = np.flatnonzero(is_apart)
    if not len(joints):
        return None
    try:
        problem = _Problem.of(rows, np.maximum(of_targets.compliance, 0.0), joints, is_seen, sigma)
        return problem.solve(confidence)
    except (SolverError, np.linalg.LinAlgError):
        return None


@dataclass(frozen=True, eq=False)
class _Problem:
    """Rows of all readings and statements; joints' compliances come first, then those of structure."""

    rows: Rows  # with the scatter of the fit
    triangle: Triangle  # of all readings and statements, in units of sigma
    columns: IndexArray  # (K,) fitted columns: joints that are seen, structure of m joints, errors
    joints: IndexArray  # (m,) joints that are taken apart
    of_gearboxes: IndexArray  # (m,) positions of their compliances among the fitted columns
    of_structure: IndexArray  # (m,) positions of the compliances of their structure
    sigma: float

    @classmethod
    def of(
        cls, rows: Rows, whole: FloatArray, joints: IndexArray, is_seen: BoolArray, sigma: float
    ) -> _Problem:
        """State the problem.

        Args:
            rows: N observations.
            whole: (n,) compliances as the targets show them, at which columns of errors are computed.
            joints: (m,) joints that are taken apart.
            is_seen: (n,) mask of the joints that the targets show.
            sigma: standard uncertainty of a coordinate of a reading [m].
        """
        measurements = rows.measurements
        errors = [*fitted_errors(measurements).terms, *list_stated_terms(measurements)]
        terms = [JOINTS, STRUCTURE, *errors]
        gear = _fit_gearboxes(rows, whole, joints)
        n, seen = rows.robot.n, np.flatnonzero(is_seen)
        first_error = 2 * n

        def list_columns(width: int) -> IndexArray:
            return np.concatenate([seen, n + joints, np.arange(first_error, width)])

        scatter = find_scatter_of_terms(rows, terms, whole, list_columns)
        rows = rows.with_scatter(scatter)
        generated = _generate(rows, terms, whole, gear)
        first = next(generated)
        triangle = Triangle(**first.widths)
        for of_block in chain([first], generated):
            triangle.add(of_block.flat, count=int(of_block.read.sum()))
        for term in list_stated_terms(measurements):
            uncertainty = np.resize(
                term.prior(measurements.common_uncertainty), len(triangle.span[term.name])
            )
            triangle = triangle.state(term.name, uncertainty, sigma)
        of_gearboxes = np.searchsorted(seen, joints)
        of_structure = len(seen) + np.arange(len(joints))
        columns = list_columns(triangle.matrix.shape[1])
        return cls(rows, triangle, columns, joints, of_gearboxes, of_structure, sigma)

    def solve(self, confidence: float) -> Apart:
        """Fit compliances of at least zero; return them with intervals at a confidence."""
        matrix = self.triangle.matrix[:, self.columns] / self.sigma
        rhs = self.triangle.rhs / self.sigma
        unit = 1.0 / np.linalg.norm(matrix, axis=0)
        compliances = np.concatenate([np.arange(self.of_structure[-1] + 1)])
        lower = np.full(len(unit), -np.inf)
        lower[compliances] = 0.0
        bounds = Bounds(lower, np.full(len(unit), np.inf))
        scaled = matrix * unit
        best = solve(IdentificationProblem(scaled, rhs, bounds)).compliance
        free = np.asarray(np.linalg.lstsq(scaled, rhs, rcond=None)[0])
        inverse = np.linalg.inv(np.linalg.qr(scaled)[1])
        covariance = inverse @ inverse.T
        structure = self.of_structure
        likelihood = Likelihood(np.arange(len(free)), free, covariance)
        # A scale of all loads changes all compliances alike, which no reading shows.
        scale = FORCE_SCALE.prior(self.rows.measurements.common_uncertainty)
        if any(scale):
            response = np.where(lower == 0.0, free, 0.0) * scale[0]
            likelihood = likelihood.add_common_errors(response[:, None])
        wanted = np.concatenate([self.of_gearboxes, structure])
        radius = np.array([student_quantile(0.5 * (1.0 + confidence), None)])
        functions = np.eye(len(free))[wanted]
        ends = compute_interval_ends(likelihood, Constraints(bounds), functions, radius, best[wanted])[0]
        deviation = np.sqrt(np.diagonal(likelihood.covariance)[wanted])
        shape = (2, len(self.joints))
        measurements = self.rows.measurements
        noise = np.array(measurements.scatter.encoders or (1.0,) * self.rows.robot.n)[self.joints]
        stated = 0.0 if measurements.encoders is None else measurements.encoders.sigma
        return Apart(
            joints=self.joints,
            compliance=(unit[wanted] * best[wanted]).reshape(shape),
            free_compliance=(unit[wanted] * free[wanted]).reshape(shape),
            uncertainty=(unit[wanted] * deviation).reshape(shape),
            interval=(unit[wanted][:, None] * ends).reshape(*shape, 2),
            noise=noise * stated,
            p_value=_test_for_structure(free[structure], covariance[np.ix_(structure, structure)]),
        )


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
