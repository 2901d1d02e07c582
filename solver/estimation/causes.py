"""Causes of deflections that joints alone do not explain (method.md §7, §13).

A load point elsewhere, a forgotten force, a load cell's zero, some loads heavier than others, play in the
gears, a tracker or base that moved: each is a term in addition to the joints, which are fitted with K_c to
the targets' rows, without bounds. Causes with a significant test are fitted by Gauss-Newton, and compared by
the Bayesian information criterion (Schwarz 1978), with bending links among them; a difference of less than
`AS_WELL` is a tie. Mistakes are tested before links: added to columns of links, their tests accuse clean
campaigns of elastic arms, and without these tests a load point elsewhere looks like links.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.options import ElasticModel
from jointstiff.schemas.run import CauseTest
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.estimation.estimate import Estimate
from jointstiff.solver.estimation.fitted_causes import fit_causes_with_joints
from jointstiff.solver.estimation.suspects import MOST_TESTED_OBSERVATIONS, Suspect, list_suspects
from jointstiff.solver.estimation.term_tests import LINKS_LEVEL, MISTAKE_LEVEL, TermTests
from jointstiff.solver.mechanics.block import (
    fitted_errors,
    regressor_blocks,
)
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import DIAGONAL_BASE, DIAGONAL_LINKS, FULL_BASE

CLEAR_GAIN: Final = 2.0
"""Gain of a model with links, in paired standard errors, above which joints alone do not fit."""
AS_WELL: Final = 6.0
"""Difference of the information criterion below which neither of two causes is preferred."""


@dataclass(frozen=True, eq=False)
class Cause:
    """Significant cause, fitted together with the joints until the fit converged."""

    suspect: Suspect
    unknowns: FloatArray  #: (k,) fitted values in the term's unit
    p_value: float  #: p-value of the F test of the cause
    links_p_value: float  #: p-value of the F test of links added to joints and cause
    compliance: FloatArray  #: (n,) of the joints, fitted together with the cause [rad/(N·m)]
    ratio: float  #: sum of squared residuals with the cause, over the sum without the cause
    criterion: float  #: Bayesian information criterion; the least is preferred

    @property
    def makes_links_unnecessary(self) -> bool:
        """True if, with this cause fitted, a test no longer finds that links bend (p ≥ `LINKS_LEVEL`)."""
        return self.links_p_value >= LINKS_LEVEL


@dataclass(frozen=True)
class HeldOutGain:
    """Result of a cross-validation: mean residuals of held-out postures, by two models.

    The models are the best one with links or coupling, and joints alone.
    """

    model: ElasticModel
    error: float  #: mean length of the residuals of that model [m]
    error_of_joints: float  #: mean length of the residuals of joints alone [m]
    standard_error: float  #: of the difference, paired by posture [m]


@dataclass(frozen=True, eq=False)
class Screening:
    """Outcome of the tests for causes, links and base in addition to the joints."""

    links_p_value: float  #: of the test of links added to the joints; 1 where the readings cannot decide
    tests: tuple[
        CauseTest, ...
    ]  #: tests of all causes, the most significant first; empty where no test was possible
    causes: tuple[
        Cause, ...
    ]  #: the best cause and those that explain the readings equally well; may be empty
    gain: HeldOutGain | None = None  #: gain of the cross-validation; None where none was run
    base_p_value: float = 1.0  #: p-value of the test of a base added to the joints
    #: p-value of links added to joints and base, then of a base added to joints and links; 1 if the test of
    #: the base alone is not significant
    links_p_value_with_base: float = 1.0
    base_p_value_with_links: float = 1.0
    comparable: bool = True  #: whether the options allow a comparison of joints alone with elastic links

    @property
    def makes_links_unnecessary(self) -> bool:
        """True if causes were found, and each leaves nothing for links to explain."""
        return bool(self.causes) and all(cause.makes_links_unnecessary for cause in self.causes)

    @property
    def lack_of_fit(self) -> bool:
        """True if a model with links explains the readings better than joints alone.

        The cross-validation decides if one was run, else the F test of links.
        """
        significant, gain = self.links_p_value < MISTAKE_LEVEL, self.gain
        if gain is not None:
            significant = gain.error_of_joints - gain.error > CLEAR_GAIN * gain.standard_error
        return self.links_need_validation and significant

    @property
    def links_need_validation(self) -> bool:
        """True if models with links should be cross-validated.

        The test of links is then significant, and no cause explains what the links would explain.
        """
        return self.links_p_value < LINKS_LEVEL and not self.makes_links_unnecessary

    @property
    def base_needs_validation(self) -> bool:
        """True if models with a bending base should be cross-validated.

        The test of the base is then significant, and no cause explains what links or base would explain.
        """
        return self.base_p_value < MISTAKE_LEVEL and not self.makes_links_unnecessary


def screen_estimate(
    robot: Robot, measurements: Measurements, estimate: Estimate, scattered: bool = False
) -> Screening:
    """Test for causes, links and a base that explain what joints alone leave unexplained.

    Only readings of targets are used, not encoders. If the load has no balance or there are no degrees of
    freedom, no test is significant. Causes that were fitted to these measurements before stay in every fit.

    Args:
        robot: n joints.
        measurements: N observations, with the scatter that was stated.
        estimate: estimate by joints alone.
        scattered: whether the residuals show a scatter of the joints, which tests must account for.
    """
    tested, compliance = (
        measurements.select_evenly(MOST_TESTED_OBSERVATIONS),
        np.maximum(estimate.compliance, 0.0),
    )
    bending_compliance = compliance if estimate.balanced is None else np.maximum(estimate.balanced, 0.0)
    try:
        block = next(regressor_blocks(robot, tested, bending_compliance))
    except SolverError:  # no balance under the load: the assessment reports that elsewhere
        return Screening(1.0, (), ())
    always_fitted, visible = fitted_errors(measurements).terms, ~estimate.observability.null
    suspects = list_suspects(measurements, block, compliance, always_fitted)
    triangles = TermTests(
        block, compliance, visible, always_fitted, [suspect.term for suspect in suspects], scattered=scattered
    )
    links_p_value = triangles.links_p_value()
    # One p-value for each suspect, then that of the base.
    *p_values, base_p_value = triangles.p_values([*(s.term.name for s in suspects), DIAGONAL_BASE.name])
    # A cause sought by its onset is tested once for each onset that was tried (Bonferroni).
    tests = {s: min(1.0, s.tried * max(s.least_p, p)) for s, p in zip(suspects, p_values, strict=True)}
    ordered = sorted(suspects, key=tests.__getitem__)
    causes: list[Cause] = []
    for suspect in ordered:
        if tests[suspect] < MISTAKE_LEVEL / len(suspects):
            with suppress(SolverError):  # a cause that implies loads without a balance is no explanation
                causes.append(_fit_suspected_cause(robot, tested, triangles, suspect, tests[suspect]))
    preferred = _select_best_causes(causes, triangles, links_p_value)
    listed = tuple(CauseTest(name=each.name, first=each.first, p_value=tests[each]) for each in ordered)
    if base_p_value >= MISTAKE_LEVEL:
        return Screening(links_p_value, listed, preferred, base_p_value=base_p_value)
    with_base = TermTests(block, compliance, visible, always_fitted, [FULL_BASE], scattered=scattered)
    return Screening(
        links_p_value,
        listed,
        preferred,
        base_p_value=base_p_value,
        links_p_value_with_base=with_base.links_p_value(FULL_BASE.name),
        base_p_value_with_links=triangles.p_values([DIAGONAL_BASE.name], DIAGONAL_LINKS.name)[0],
    )


def _select_best_causes(causes: list[Cause], triangles: TermTests, links_p_value: float) -> tuple[Cause, ...]:
    """Return the best cause and the causes that explain the readings equally well, at most one of each name.

    If links explain the readings better than any cause, only causes that make links unnecessary are returned.
    """
    causes.sort(key=lambda cause: -cause.criterion)
    # The causes are in order of decreasing criterion, so the best cause of each name overwrites the others.
    best_by_name = {cause.suspect.name: cause for cause in causes}
    least = min((cause.criterion for cause in causes), default=np.inf)
    best = tuple(cause for cause in reversed(best_by_name.values()) if cause.criterion <= least + AS_WELL)
    if links_p_value < LINKS_LEVEL and triangles.links_criterion() < least - AS_WELL:
        best = tuple(cause for cause in best if cause.makes_links_unnecessary)
    return best


def _fit_suspected_cause(
    robot: Robot, part: Measurements, triangles: TermTests, suspect: Suspect, p_value: float
) -> Cause:
    """Fit a suspected cause together with the joints until convergence.

    Raises:
        SolverError: the cause implies loads without a balance, or its fitted size is negative although only
            positive sizes are possible.
    """
    fitted = fit_causes_with_joints(
        robot, part, [*fitted_errors(part).terms, suspect.term], triangles.compliance
    )
    unknowns = fitted.errors.unknowns[-1]
    uncertainty = np.linalg.norm(fitted.errors.root, axis=1)[-len(unknowns) :]
    standardised = unknowns / uncertainty  # the unknown that is known best decides on the sign
    if suspect.term.nonnegative and standardised[np.abs(standardised).argmax()] < 0.0:
        raise SolverError(
            f"{suspect.name} would be negative", where="causes", remedy="look for another cause"
        )
    squares = fitted.triangles.residual_squares()
    # The onset of a cause that sets in later counts as one more unknown.
    count = fitted.errors.determined + (suspect.first is not None)
    return Cause(
        suspect,
        unknowns,
        p_value,
        fitted.triangles.links_p_value(),
        fitted.compliance,
        squares / triangles.residual_squares(),
        fitted.triangles.criterion(squares, count),
    )
