"""Causes selected one after the other, and single wrong postures among them (method.md §13).

In each step every suspected cause is tested together with the joints and the causes selected before. The
cause with the least information criterion joins the fit, until no test is significant. A single posture whose
readings are wrong competes with the causes: it is left out where this explains more than any cause, and the
selection begins anew. At the end each cause is exchanged for one that explains more together with the others,
and is dropped if the others make it unnecessary.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.evidence.fitted_causes import FittedCauses, fit_causes_with_joints, subtract_errors
from jointstiff.solver.evidence.suspects import Suspect, list_suspects
from jointstiff.solver.evidence.term_tests import LINKS_LEVEL, MISTAKE_LEVEL, TermTests
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.block import CorrectedMeasurements, Term, fitted_errors
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.springs import DIAGONAL_BASE

EQUALLY_GOOD: Final = 6.0
"""Difference of the information criterion up to which two causes explain the readings equally well."""
_MOST_STEPS: Final = 3
"""Largest number of causes that are selected one after the other."""
_MOST_EXCHANGES: Final = 2
"""Largest number of passes in which selected causes are exchanged for others."""
_MOST_WRONG: Final = 0.1
"""Largest share of postures whose readings are single mistakes: more have a cause in common."""


@dataclass(frozen=True, eq=False)
class Cause:
    """Significant cause, fitted together with the joints and with other causes until the fit converged."""

    suspect: Suspect
    unknowns: FloatArray  #: (k,) fitted values in the term's unit
    p_value: float  #: p-value of the F test of the cause
    links_p_value: float  #: p-value of the F test of links added to joints and all causes
    compliance: FloatArray  #: (n,) of the joints, fitted together with the causes [rad/(N·m)]
    ratio: float  #: sum of squared residuals with all causes, over the sum without any
    criterion: float  #: Bayesian information criterion; the least is preferred
    step: int = 0  #: number of causes that are fitted with this one; causes of one step are a tie

    @property
    def makes_links_unnecessary(self) -> bool:
        """True if, with all causes fitted, a test no longer finds that links bend (p ≥ `LINKS_LEVEL`)."""
        return self.links_p_value >= LINKS_LEVEL


@dataclass(frozen=True, eq=False)
class Step:
    """Tests of all suspected causes, added to the joints and to the causes that were selected before."""

    p_values: dict[Suspect, float]  #: p-value of each suspect, for all onsets that were tried
    tests: TermTests  #: compressed rows of joints, selected causes and suspects

    @classmethod
    def test(
        cls,
        tested: Rows,
        measurements: Measurements,
        compliance: FloatArray,
        visible: BoolArray,
        *,
        scattered: bool,
    ) -> Step:
        """Test all suspected causes.

        Args:
            tested: observations that are tested, from which the selected causes were subtracted.
            measurements: all N observations.
            compliance: (n,) compliances of the joints [rad/(N·m)].
            visible: (n,) whether the readings see each joint.
            scattered: whether the residuals show a scatter of the joints.

        Raises:
            SolverError: a load has no balance.
        """
        fitted_terms = fitted_errors(tested.measurements).terms
        suspects = list_suspects(measurements, tested, compliance, fitted_terms)
        terms = [suspect.term for suspect in suspects]
        tests = TermTests(tested, compliance, visible, fitted_terms, terms, scattered=scattered)
        p_values = tests.p_values([term.name for term in terms]) if terms else []
        # A cause sought by its onset is tested once for each onset that was tried (Bonferroni).
        return cls(
            {s: min(1.0, s.tried * max(s.least_p, p)) for s, p in zip(suspects, p_values, strict=True)}, tests
        )

    @cached_property
    def links_p_value(self) -> float:
        """p-value of links added to the joints."""
        return self.tests.links_p_value()

    @cached_property
    def base_p_value(self) -> float:
        """p-value of a base added to the joints."""
        return self.tests.p_values([DIAGONAL_BASE.name])[0]

    def is_explained_better(self, criterion: float, unknowns: int = 0) -> bool:
        """Return whether a fit explains the readings better than links that bend or a base that bends.

        Causes and postures that are left out have so many unknowns that they could take the place of links.

        Args:
            criterion: Bayesian information criterion of the fit.
            unknowns: number of unknowns of the causes that were selected before, which the criterion counts.
        """
        tests, criterion_of_unknowns = self.tests, self.tests.criterion(1.0, unknowns)
        links = tests.links_criterion() if self.links_p_value < LINKS_LEVEL else np.inf
        base = tests.base_criterion() if self.base_p_value < MISTAKE_LEVEL else np.inf
        return criterion < min(links, base) + criterion_of_unknowns

    @property
    def significant(self) -> list[Suspect]:
        """Suspects whose tests are significant, the most significant first."""
        level = MISTAKE_LEVEL / max(1, len(self.p_values))
        significant = [suspect for suspect, p_value in self.p_values.items() if p_value < level]
        return sorted(significant, key=self.p_values.__getitem__)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Causes fitted together with the joints: what they explain."""

    suspects: tuple[Suspect, ...]
    fitted: FittedCauses
    squares: float  # sum of squared residuals
    unknowns: int  # number of unknowns in addition to the joints
    criterion: float  # Bayesian information criterion


def _by_criterion(fit: _Fit) -> float:
    """Return the criterion of a fit, to find the best one."""
    return fit.criterion


@dataclass(frozen=True, eq=False)
class Selection:
    """Causes that together explain the readings, and postures whose readings are wrong."""

    causes: tuple[Cause, ...]  #: step by step; causes of one step explain the readings equally well
    wrong: tuple[str, ...]  #: labels of the postures that were left out
    start: Step  #: tests of each cause alone, without the postures that were left out


class _Search:
    """Forward selection of causes for some observations."""

    def __init__(self, part: Rows, measurements: Measurements, start: Step, *, scattered: bool) -> None:
        """Begin with the tests of each cause alone.

        Args:
            part: observations that are tested.
            measurements: all N observations.
            start: tests of each cause added to the joints, for these observations.
            scattered: whether the residuals show a scatter of the joints.
        """
        self._part, self._measurements = part, measurements
        self._start, self._scattered = start, scattered
        self._always: tuple[Term, ...] = fitted_errors(part.measurements).terms
        self._fits: dict[tuple[Suspect, ...], _Fit | None] = {}
        self._p_values: dict[Suspect, float] = {}

    def fit(self, suspects: Sequence[Suspect]) -> _Fit | None:
        """Fit causes together with the joints until convergence; return None if they are no explanation.

        Causes are no explanation if they imply loads without a balance, or if a cause that can only be
        positive gets a negative size.
        """
        key = tuple(suspects)
        if key not in self._fits:
            self._fits[key] = None
            with suppress(SolverError):
                self._fits[key] = self._fit_anew(key)
        return self._fits[key]

    def _fit_anew(self, suspects: tuple[Suspect, ...]) -> _Fit | None:
        """Fit causes together with the joints; return None if a size has the wrong sign.

        Raises:
            SolverError: the causes imply loads without a balance.
        """
        terms = [*self._always, *(suspect.term for suspect in suspects)]
        fitted = fit_causes_with_joints(self._part, terms, self._start.tests.compliance)
        errors, last = fitted.errors, len(fitted.errors.root)
        uncertainty = np.linalg.norm(errors.root, axis=1)
        for suspect, unknowns in zip(reversed(suspects), reversed(errors.unknowns), strict=False):
            standardised = unknowns / uncertainty[last - len(unknowns) : last]
            last -= len(unknowns)
            # The unknown that is known best decides on the sign.
            if suspect.term.nonnegative and standardised[np.abs(standardised).argmax()] < 0.0:
                return None
        residual_squares = fitted.tests.residual_squares()
        # The onset of a cause that sets in later counts as one more unknown.
        unknown_count = errors.determined + sum(suspect.first is not None for suspect in suspects)
        return _Fit(
            suspects,
            fitted,
            residual_squares,
            unknown_count,
            fitted.tests.criterion(residual_squares, unknown_count),
        )

    def test_others(self, fit: _Fit) -> Step:
        """Test all other causes, added to the joints and to fitted causes.

        Raises:
            SolverError: a load has no balance.
        """
        fitted = fit.fitted
        at_fitted = self._part.at(fitted.compliance)
        corrected = subtract_errors(at_fitted, fitted.errors)
        part = at_fitted.of(CorrectedMeasurements.from_measurements(corrected, fitted.errors))
        return Step.test(
            part, self._measurements, fitted.compliance, fitted.visible, scattered=self._scattered
        )

    def run(self, *, seek_wrong: bool) -> tuple[list[_Fit], dict[str, Suspect], str | None]:
        """Select causes one after the other.

        Args:
            seek_wrong: whether single wrong postures compete with the causes.

        Returns:
            The fits after each step; the suspects that were significant in a step, by the name of their term;
            and the label of a posture whose wrong readings explain more than the next cause, or None.
        """
        fits, tests, pool = list[_Fit](), self._start, dict[str, Suspect]()
        for _ in range(_MOST_STEPS + 1):
            significant = tests.significant
            self._p_values |= {each: tests.p_values[each] for each in significant}
            pool = {each.term.name: each for each in significant} | pool
            selected = fits[-1].suspects if fits else ()
            candidate_fits = (
                [self.fit((*selected, each)) for each in significant] if len(fits) < _MOST_STEPS else []
            )
            best_fit = min(
                (each for each in candidate_fits if each is not None), key=_by_criterion, default=None
            )
            unknowns = fits[-1].unknowns if fits else 0
            wrong_posture = tests.tests.find_wrong_posture(unknowns) if seek_wrong else None
            if (
                wrong_posture is not None
                and (best_fit is None or wrong_posture.criterion < best_fit.criterion)
                and tests.is_explained_better(wrong_posture.criterion, unknowns)
            ):
                return fits, pool, wrong_posture.label
            if best_fit is None:
                break
            fits.append(best_fit)
            try:
                tests = self.test_others(best_fit)
            except SolverError:  # the causes imply loads without a balance near these
                break
        return fits, pool, None

    def exchange(self, chosen: _Fit, pool: Iterable[Suspect]) -> _Fit:
        """Exchange selected causes for other causes of the pool, as long as the fit improves.

        `chosen` is the fit of the selected causes; the best fit found is returned.
        """
        for _ in range(_MOST_EXCHANGES):
            previous = chosen
            for position in range(len(chosen.suspects)):
                for fit in self._list_replacements(chosen, position, pool):
                    if fit.criterion < chosen.criterion:
                        chosen = fit
            if chosen is previous:
                break
        return chosen

    def _list_replacements(self, chosen: _Fit, position: int, pool: Iterable[Suspect]) -> list[_Fit]:
        """Return the fits in which one selected cause is replaced by each other cause of the pool.

        `position` is the index of the replaced cause among the selected causes.
        """
        names = {each.term.name for each in chosen.suspects}
        replacements = [each for each in pool if each.term.name not in names]
        fits = [
            self.fit((*chosen.suspects[:position], each, *chosen.suspects[position + 1 :]))
            for each in replacements
        ]
        return [each for each in fits if each is not None]

    def drop_unnecessary(self, chosen: _Fit) -> _Fit:
        """Drop the causes that the others make unnecessary."""
        for suspect in reversed(chosen.suspects):
            others = tuple(each for each in chosen.suspects if each is not suspect)
            fit = self.fit(others) if others else None
            if fit is None:
                continue
            with suppress(SolverError):
                if all(each.name != suspect.name for each in self.test_others(fit).significant):
                    chosen = fit
        return chosen

    def describe(self, chosen: _Fit, pool: Iterable[Suspect]) -> tuple[Cause, ...]:
        """Return the selected causes in order.

        Each cause is followed by the other causes that explain the readings about equally well in its place.
        """
        causes = []
        for position, suspect in enumerate(chosen.suspects):
            replaced = sorted(self._list_replacements(chosen, position, pool), key=_by_criterion)
            equally_good = [fit for fit in replaced if fit.criterion <= chosen.criterion + EQUALLY_GOOD]
            best_by_name: dict[str, _Fit] = {}  # the best fit for each name
            for fit in equally_good:
                if fit.suspects[position].name != suspect.name:
                    best_by_name.setdefault(fit.suspects[position].name, fit)
            causes += [self._describe_one(fit, position) for fit in (chosen, *best_by_name.values())]
        return tuple(causes)

    def _describe_one(self, fit: _Fit, position: int) -> Cause:
        """Return the cause at a position of a fit, with its unknowns, tests and effect on the residuals."""
        suspect, fitted = fit.suspects[position], fit.fitted
        return Cause(
            suspect,
            fitted.errors.unknowns[len(self._always) + position],
            self._p_values[suspect],
            fitted.tests.links_p_value(),
            fitted.compliance,
            fit.squares / self._start.tests.residual_squares(),
            fit.criterion,
            step=position,
        )


def select_causes(tested: Rows, measurements: Measurements, start: Step, *, scattered: bool) -> Selection:
    """Select the causes that together explain the readings, and the postures whose readings are wrong.

    If links or a base explain the readings better, only causes that make links unnecessary are returned.

    Args:
        tested: observations that are tested.
        measurements: all N observations.
        start: tests of each cause added to the joints.
        scattered: whether the residuals show a scatter of the joints.
    """
    wrong_labels = list[str]()
    remaining = tested
    most_wrong = max(1, int(_MOST_WRONG * len(tested)))
    tests = start
    while True:
        search = _Search(remaining, measurements, tests, scattered=scattered)
        fits, pool, wrong_label = search.run(seek_wrong=len(wrong_labels) <= most_wrong)
        if wrong_label is None:
            break
        wrong_labels.append(wrong_label)
        is_right = np.array([label != wrong_label for label in remaining.measurements.labels])
        remaining = remaining[np.flatnonzero(is_right)]
        if len(wrong_labels) > most_wrong:  # too many to be single mistakes
            remaining, tests = tested, start
            continue
        tests = Step.test(
            remaining, measurements, start.tests.compliance, start.tests.visible, scattered=scattered
        )
    left_out = () if len(wrong_labels) > most_wrong else tuple(wrong_labels)
    if not fits:
        return Selection((), left_out, tests)
    if len(fits) > 1:
        chosen = search.drop_unnecessary(search.exchange(fits[-1], pool.values()))
        causes = search.describe(chosen, pool.values())
        if _explain_better_than_links(causes, tests):
            return Selection(causes, left_out, tests)
    first_causes = search.describe(fits[0], tests.significant)
    links_explain_more = (
        tests.links_p_value < LINKS_LEVEL and tests.tests.links_criterion() < fits[0].criterion - EQUALLY_GOOD
    )
    kept_causes = [each for each in first_causes if each.makes_links_unnecessary or not links_explain_more]
    return Selection(tuple(kept_causes), left_out, tests)


def _explain_better_than_links(causes: Sequence[Cause], start: Step) -> bool:
    """Return whether several causes leave nothing for links, and explain more than links and a base do."""
    last = [cause for cause in causes if cause.step == causes[-1].step]
    return all(cause.makes_links_unnecessary for cause in last) and start.is_explained_better(
        min(cause.criterion for cause in causes)
    )
