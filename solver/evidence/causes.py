"""Causes of deflections that joints alone do not explain (method.md §7, §13).

A load point elsewhere, a forgotten force, a load cell's zero, some loads heavier than others, play in the
gears, a tracker or base that moved: each is a term in addition to the joints, which are fitted with K_c to
the targets' rows, without bounds. Causes with a significant test are fitted by Gauss-Newton, and compared by
the Bayesian information criterion (Schwarz 1978), with bending links among them; causes that explain the
readings together are selected one after the other. Mistakes are tested before links: added to columns of
links, their tests accuse clean campaigns of elastic arms, and without these tests a load point elsewhere
looks like links.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.schemas.options import ElasticModel
from jointstiff.schemas.run import CauseTest
from jointstiff.solver.errors import SolverError
from jointstiff.solver.evidence.selection import Cause, Step, select_causes
from jointstiff.solver.evidence.suspects import MOST_TESTED_OBSERVATIONS
from jointstiff.solver.evidence.term_tests import LINKS_LEVEL, MISTAKE_LEVEL, TermTests
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.block import fitted_errors
from jointstiff.solver.mechanics.springs import DIAGONAL_BASE, DIAGONAL_LINKS, FULL_BASE
from jointstiff.solver.messages import build_messages

CLEAR_GAIN: Final = 2.0
"""Gain of a model with links, in paired standard errors, above which joints alone do not fit."""


@dataclass(frozen=True)
class HeldOutGain:
    """Result of a cross-validation: mean residuals of held-out postures, by two models.

    The models are the best one with links or coupling, and joints alone.
    """

    model: ElasticModel
    error: float  #: mean length of the residuals of that model [m]
    error_of_joints: float  #: mean length of the residuals of joints alone [m]
    standard_error: float  #: of the difference, paired by posture [m]

    @property
    def is_clear(self) -> bool:
        """True if joints alone predict worse by more than `CLEAR_GAIN` standard errors."""
        return self.error_of_joints - self.error > CLEAR_GAIN * self.standard_error


@dataclass(frozen=True, eq=False)
class Screening:
    """Outcome of the tests for causes, links and base in addition to the joints."""

    links_p_value: float  #: of the test of links added to the joints; 1 where the readings cannot decide
    #: tests of all causes, the most significant first; empty where no test was possible
    tests: tuple[CauseTest, ...]
    #: causes that explain the readings together, step by step; causes of one step explain them equally well
    causes: tuple[Cause, ...]
    gain: HeldOutGain | None = None  #: gain of the cross-validation; None where none was run
    base_p_value: float = 1.0  #: p-value of the test of a base added to the joints
    #: p-value of links added to joints and base, then of a base added to joints and links; 1 if the test of
    #: the base alone is not significant
    links_p_value_with_base: float = 1.0
    base_p_value_with_links: float = 1.0
    wrong: tuple[str, ...] = ()  #: labels of single postures whose readings are wrong, left out of the tests
    comparable: bool = True  #: whether the options allow a comparison of joints alone with elastic links

    @property
    def makes_links_unnecessary(self) -> bool:
        """True if causes were found, and nothing is left for links to explain when all are fitted."""
        if not self.causes:
            return False
        last_step = self.causes[-1].step
        return all(cause.makes_links_unnecessary for cause in self.causes if cause.step == last_step)

    @property
    def lack_of_fit(self) -> bool:
        """True if a model with links explains the readings better than joints alone.

        The F test of links must suggest links, which no cause makes unnecessary. Then the cross-validation
        decides if one was run; else the F test at a stricter level.
        """
        if not self.links_need_validation:
            return False
        if self.gain is None:
            return self.links_p_value < MISTAKE_LEVEL
        return self.gain.is_clear

    @property
    def links_need_validation(self) -> bool:
        """True if models with links should be cross-validated.

        The F test of links is then significant, and no cause explains what the links would explain.
        """
        return self.links_p_value < LINKS_LEVEL and not self.makes_links_unnecessary

    @property
    def base_needs_validation(self) -> bool:
        """True if models with a bending base should be cross-validated.

        The test of the base is then significant, and no cause explains what links or base would explain.
        """
        return self.base_p_value < MISTAKE_LEVEL and not self.makes_links_unnecessary

    @property
    def links_may_be_base(self) -> bool:
        """True if a base is suspected, but the tests do not distinguish bending links from a bending base.

        Neither explains anything more after the other one is fitted. Held-out postures do not decide, because
        a pedestal that yields equally about x and y moves targets exactly as link 1 does.
        """
        links_are_unnecessary = self.links_p_value_with_base >= LINKS_LEVEL
        base_is_unnecessary = self.base_p_value_with_links >= LINKS_LEVEL
        return self.base_needs_validation and links_are_unnecessary and base_is_unnecessary


def screen_estimate(rows: Rows, estimate: Estimate, scattered: bool = False) -> Screening:
    """Test for causes, links and a base that explain what joints alone leave unexplained.

    If the load has no balance or there are no degrees of freedom, no test is significant. Causes that were
    fitted to these measurements before remain in every fit.

    Args:
        rows: N observations, with the scatter that was stated.
        estimate: estimate by joints alone.
        scattered: whether the residuals show a scatter of the joints, which tests must account for.
    """
    compliance = np.maximum(estimate.compliance, 0.0)
    balanced = compliance if estimate.balanced is None else np.maximum(estimate.balanced, 0.0)
    tested = rows.select_evenly(MOST_TESTED_OBSERVATIONS).at(balanced)
    visible = ~estimate.observability.null
    try:
        tests_of_all = Step.test(tested, rows.measurements, compliance, visible, scattered=scattered)
    except SolverError:  # no balance under the load: the assessment reports that elsewhere
        return Screening(1.0, (), ())
    selection = select_causes(tested, rows.measurements, tests_of_all, scattered=scattered)
    # Links and base must show with and without the postures that were left out.
    tests_of_kept = selection.start
    screening = Screening(
        links_p_value=max(tests_of_all.links_p_value, tests_of_kept.links_p_value),
        tests=_list_cause_tests(tests_of_kept),
        causes=selection.causes,
        wrong=selection.wrong,
        base_p_value=max(tests_of_all.base_p_value, tests_of_kept.base_p_value),
    )
    if screening.base_p_value >= MISTAKE_LEVEL:
        return screening
    return _distinguish_links_from_base(screening, tests_of_kept.tests, scattered=scattered)


def _list_cause_tests(step: Step) -> tuple[CauseTest, ...]:
    """Return the tests of all suspected causes as messages, the most significant first."""
    p_values = step.p_values
    suspects = sorted(p_values, key=lambda suspect: p_values[suspect])
    messages = build_messages(
        CauseTest,
        name=[suspect.name for suspect in suspects],
        first=[suspect.first for suspect in suspects],
        p_value=[p_values[suspect] for suspect in suspects],
    )
    return tuple(messages)


def _distinguish_links_from_base(screening: Screening, tests: TermTests, *, scattered: bool) -> Screening:
    """Test whether links explain more than a base that bends, and a base more than links that bend.

    Args:
        screening: tests of links alone and of a base alone, both added to the joints.
        tests: compressed rows of these tests.
        scattered: whether the residuals show a scatter of the joints, which tests must account for.

    Returns:
        The screening with the p-values of the two further tests.
    """
    known = fitted_errors(tests.rows.measurements).terms
    with_base = TermTests(
        tests.rows, tests.compliance, tests.visible, known, [FULL_BASE], scattered=scattered
    )
    (base_p_value_with_links,) = tests.p_values([DIAGONAL_BASE.name], DIAGONAL_LINKS.name)
    return replace(
        screening,
        links_p_value_with_base=with_base.links_p_value(FULL_BASE.name),
        base_p_value_with_links=base_p_value_with_links,
    )
