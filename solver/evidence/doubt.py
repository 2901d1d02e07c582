"""Doubt about a load point that is stated more exactly than anybody can know it (method.md §13).

The fit uses at least the uncertainty of the statement's ground. A line of doubt tells a user, who insists on
less, that the readings disagree with the statement, and how much depends on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray, unit_columns
from jointstiff.solver.errors import SolverError
from jointstiff.solver.evidence.suspects import MOST_TESTED_OBSERVATIONS
from jointstiff.solver.evidence.term_tests import join_statements
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.triangle import Triangle
from jointstiff.solver.mechanics.block import fitted_errors
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.mechanics.terms import LOAD_POINT, list_stated_terms
from jointstiff.solver.text import figure, length_text

DOUBT_LEVEL: Final = 0.05
"""p-value of the stated load point below which the readings raise a doubt: in as many clean campaigns a
sentence has to be read in vain."""
USUAL_MISTAKE: Final = 0.02
"""Mistake of a load point that people make without noticing [m]: the wrong side of a ring or of a plate."""
HARMLESS: Final = 3.0
"""Number of standard uncertainties up to which a mistake may move a joint."""
HARMLESS_CHANGE: Final = 0.05
"""Relative change of a compliance up to which a mistake may move a joint."""


@dataclass(frozen=True)
class PointDoubt:
    """Joint that a mistake of the load point would move most, if the fit used the stated uncertainty."""

    stated: float  #: standard uncertainty of each coordinate of the load point, as stated [m]
    p_value: float  #: p-value of the stated load point
    joint: str  #: name of the joint
    moves: float  #: change of its compliance, in the standard uncertainties of a fit as stated
    change: float  #: the same change relative to the compliance

    def describe(self) -> str:
        """Return the doubt as a sentence, with what settles it."""
        return (
            f"The readings raise a doubt that the load point is known to ±{length_text(self.stated)} "
            f"(p = {figure(self.p_value, '.1g')}). With this statement in the fit, a mistake of "
            f"{length_text(USUAL_MISTAKE)} would change the compliance of {self.joint} by "
            f"{figure(self.moves, '.2g')} standard uncertainties ({figure(100 * self.change, '.2g')} %). "
            "Measure the load point on the hook with the tracker, and state so."
        )


@dataclass(frozen=True, eq=False)
class _StatedFit:
    """Least-squares fit of the joints and the load point, whose uncertainty is that of the statement."""

    responses: FloatArray  # (q, 3) change of q compliances per metre of a mistake of the load point
    uncertainties: FloatArray  # (q,) standard uncertainties of these compliances [rad/(N·m)]

    @classmethod
    def compute(
        cls, triangle: Triangle, fitted: IndexArray, joints: IndexArray, stated: float, sigma: float
    ) -> _StatedFit:
        """Compute the fit ``min ‖A x + B e − d‖² + (σ / u)² ‖e‖²`` from the triangle of A, B and d.

        Args:
            triangle: rows of joints, fitted errors and the load point.
            fitted: columns A of the triangle, those of the visible joints first.
            joints: positions in `fitted` of the q joints.
            stated: standard uncertainty u of each coordinate of the load point [m].
            sigma: standard uncertainty σ of a coordinate of a reading [m].
        """
        B = triangle.matrix[:, triangle.span[LOAD_POINT.name]]
        A = triangle.matrix[:, fitted]
        statement = np.hstack([np.zeros((3, A.shape[1])), sigma / stated * np.eye(3)])
        rows, lengths = unit_columns(np.vstack([np.hstack([A, B]), statement]))
        inverse = np.linalg.pinv(rows) / lengths[:, None]
        of_joints = inverse[joints]
        # A mistake moves the readings, and the row of the statement still says zero.
        responses = of_joints[:, : len(B)] @ B
        return cls(responses, sigma * np.linalg.norm(of_joints, axis=1))


def find_doubt(rows: Rows, estimate: Estimate) -> PointDoubt | None:
    """Return the doubt about a load point that is stated more exactly than its ground allows.

    None if the ground is strong enough, the readings agree with the statement, or no joint depends on it.

    Args:
        rows: N observations, with the scatter that tests count: what is stated or shown.
        estimate: estimate by joints alone, fitted to these measurements.
    """
    stated = rows.measurements.common_uncertainty.doubtful_load_point
    sigma = estimate.sigma
    if stated is None or not sigma or not _can_be_tested(rows.measurements):
        return None
    try:
        test = _PointTest.build(rows, estimate, sigma)
    except SolverError:  # no balance under the load: the assessment reports that elsewhere
        return None
    p_value = test.compute_p_value(stated)
    if p_value >= DOUBT_LEVEL or not len(test.known):
        return None
    moves = test.compute_moves(stated)
    worst = moves.find_worst()
    if worst is None:
        return None
    return PointDoubt(
        stated=stated,
        p_value=p_value,
        joint=rows.robot.joint_names[test.known[worst]],
        moves=float(moves.standardised[worst]),
        change=float(moves.relative[worst]),
    )


def _can_be_tested(measurements: Measurements) -> bool:
    """Return whether readings can show another load point: under a force, unless it was fitted already."""
    fitted_names = {term.name for term in fitted_errors(measurements).terms}
    return LOAD_POINT.name not in fitted_names and bool(measurements.force.any())


class _Moves(NamedTuple):
    """Changes of q compliances by a usual mistake of the load point."""

    standardised: FloatArray  # (q,) in standard uncertainties
    relative: FloatArray  # (q,) relative to the compliance

    def find_worst(self) -> int | None:
        """Return the index of the compliance that moves most; None if all moves are harmless."""
        is_harmful = (self.standardised > HARMLESS) & (self.relative > HARMLESS_CHANGE)
        if not is_harmful.any():
            return None
        return int(np.argmax(np.where(is_harmful, self.standardised, 0.0)))


@dataclass(frozen=True, eq=False)
class _PointTest:
    """Rows of the joints and the load point, by which the readings are compared with a stated load point."""

    triangle: Triangle  # rows of joints, errors that were fitted before, the load point and other statements
    fitted_names: list[str]  # names of the joints and of the errors that were fitted before
    visible: IndexArray  # joints that the readings see
    compliance: FloatArray  # (n,) at least zero [rad/(N·m)]
    scale: float  # relative standard uncertainty of all compliances, by that of the scale of the loads
    sigma: float  # standard uncertainty of a coordinate of a reading [m]

    @classmethod
    def build(cls, rows: Rows, estimate: Estimate, sigma: float) -> _PointTest:
        """Compress the rows of some observations, at the balance of the estimate.

        Raises:
            SolverError: a load has no balance.
        """
        measurements = rows.measurements
        compliance = np.maximum(estimate.compliance, 0.0)
        fitted_terms = fitted_errors(measurements).terms
        others = [term for term in list_stated_terms(measurements) if term.name != LOAD_POINT.name]
        tested = rows.select_evenly(MOST_TESTED_OBSERVATIONS).at(estimate.balanced)
        stack = tested.stack([JOINTS, *fitted_terms, LOAD_POINT, *others], compliance)
        triangle = join_statements(stack.triangle(), others, measurements, sigma)
        visible = np.flatnonzero(~estimate.observability.null)
        triangle.span[JOINTS.name] = visible
        fitted_names = [JOINTS.name, *(term.name for term in fitted_terms)]
        scale = measurements.common_uncertainty.scale
        return cls(triangle, fitted_names, visible, compliance, scale, sigma)

    @property
    def known(self) -> IndexArray:
        """(q,) joints with a positive compliance that the readings see."""
        is_visible = np.isin(np.arange(len(self.compliance)), self.visible)
        return np.flatnonzero((self.compliance > 0.0) & is_visible)

    def compute_p_value(self, stated: float) -> float:
        """Return the p-value of the load point with the standard uncertainty `stated` of a coordinate [m]."""
        return self.triangle.statement_p_value(LOAD_POINT.name, self.fitted_names, np.full(3, stated))

    def compute_moves(self, stated: float) -> _Moves:
        """Return how far a mistake of the load point by `USUAL_MISTAKE` moves the known compliances.

        `stated` is the standard uncertainty of each coordinate of the load point with which it is fitted [m].
        """
        columns = np.concatenate([self.triangle.span[name] for name in self.fitted_names])
        places = np.searchsorted(self.visible, self.known)
        fit = _StatedFit.compute(self.triangle, columns, places, stated, self.sigma)
        compliance = self.compliance[self.known]
        uncertainties = np.hypot(fit.uncertainties, self.scale * compliance)
        change = USUAL_MISTAKE * np.linalg.norm(fit.responses, axis=1)
        return _Moves(change / uncertainties, change / compliance)
