"""Causes selected one after the other, and single wrong postures among them (method.md §13).

In each step every suspected cause is tested together with the joints and the causes selected before. The
cause with the least information criterion joins the fit, until no test is significant. A single posture whose
readings are wrong competes with the causes: it is left out where this explains more than any cause, and the
selection begins anew. At the end each cause is exchanged for one that explains more together with the others,
and is dropped if the others make it unnecessary.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
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
from jointstiff.solver.fit.triangle import DISTINCT, orthonormal_basis
from jointstiff.solver.mechanics.block import CorrectedMeasurements, FittedErrors, Term, fitted_errors
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.springs import DIAGONAL_BASE

EQUALLY_GOOD: Final = 6.0
"""Difference of the information criterion up to which two causes explain the readings equally well."""
_ALIKE: Final = 0.1
"""Largest part of a motion that another motion leaves unexplained, up to which the two are the same."""
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
        single_p_values = tests.p_values([term.name for term in terms]) if terms else []
        p_values = {}
        for suspect, single_p_value in zip(suspects, single_p_values, strict=True):
            p_value = max(suspect.least_p_value, single_p_value)
            # A cause sought by its onset is tested once for each onset that was tried (Bonferroni).
            p_values[suspect] = min(1.0, suspect.onsets_tried * p_value)
        return cls(p_values, tests)

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

        Links and base compete only where their tests are significant.

        Args:
            criterion: Bayesian information criterion of the fit.
            unknowns: number of unknowns of the causes that were selected before. The criterion of the fit
                counts these unknowns, so that they are added to the criteria of links and base.
        """
        penalty_of_unknowns = self.tests.criterion(1.0, unknowns)
        least_criterion = np.inf
        if self.links_p_value < LINKS_LEVEL:
            least_criterion = self.tests.links_criterion()
        if self.base_p_value < MISTAKE_LEVEL:
            least_criterion = min(least_criterion, self.tests.base_criterion())
        return criterion < least_criterion + penalty_of_unknowns

    @property
    def significant(self) -> list[Suspect]:
        """Suspects whose tests are significant, the most significant first."""
        level_of_each_test = MISTAKE_LEVEL / max(1, len(self.p_values))
        significant = [suspect for suspect, p in self.p_values.items() if p < level_of_each_test]
        return sorted(significant, key=lambda suspect: self.p_values[suspect])


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


@dataclass(frozen=True, eq=False)
class _Selected:
    """Causes that were selected one after the other."""

    fits: list[_Fit]  # after each step, each with one cause more
    pool: dict[str, Suspect]  # the suspects that were significant in a step, by the name of their term
    wrong_label: str | None = None  # posture whose wrong readings explain more than the next cause


def _find_wrong_label(tests: Step, best_fit: _Fit | None, fits: Sequence[_Fit]) -> str | None:
    """Return the label of the posture with wrong readings that explains more than a further cause.

    None if no posture is wrong, or if a further cause, links or a base explain more than the posture.

    Args:
        tests: tests of a step.
        best_fit: best fit of one more cause; None if there is none.
        fits: fits of the steps before.
    """
    unknown_count = fits[-1].unknowns if fits else 0
    wrong_posture = tests.tests.find_wrong_posture(unknown_count)
    if wrong_posture is None:
        return None
    if best_fit is not None and best_fit.criterion <= wrong_posture.criterion:
        return None
    if not tests.is_explained_better(wrong_posture.criterion, unknown_count):
        return None
    return wrong_posture.label


def _has_wrong_sign(errors: FittedErrors, *, except_for: Collection[str]) -> bool:
    """Return whether a cause that can only be positive, such as play, was fitted with a negative size.

    Of several unknowns of a cause, the one counts that is largest in its standard uncertainties.

    Args:
        errors: fitted causes.
        except_for: names of terms whose sign does not matter.
    """
    uncertainties = np.linalg.norm(errors.root, axis=1)  # of the unknowns of all terms in turn
    start = 0
    for term, unknowns in zip(errors.terms, errors.unknowns, strict=True):
        uncertainty = uncertainties[start : start + len(unknowns)]
        start += len(unknowns)
        if term.nonnegative and term.name not in except_for:
            standardised = unknowns / uncertainty
            best_known = standardised[np.abs(standardised).argmax()]
            if best_known < 0.0:
                return True
    return False


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
        self._part = part
        self._measurements = measurements
        self._start = start
        self._scattered = scattered
        # Terms that were fitted to these measurements before remain in every fit.
        self._always: tuple[Term, ...] = fitted_errors(part.measurements).terms
        self._fits: dict[tuple[Suspect, ...], _Fit | None] = {}  # by combination; None if no explanation
        self._p_values: dict[Suspect, float] = {}  # of the latest step in which a suspect was significant

    def fit(self, suspects: Sequence[Suspect]) -> _Fit | None:
        """Fit causes together with the joints until convergence; return None if they are no explanation.

        Causes are no explanation if they imply loads without a balance, or if a cause that can only be
        positive gets a negative size. The fit of each combination of causes is computed once.
        """
        key = tuple(suspects)
        if key not in self._fits:
            try:
                self._fits[key] = self._fit_anew(key)
            except SolverError:  # loads without a balance
                self._fits[key] = None
        return self._fits[key]

    def _fit_anew(self, suspects: tuple[Suspect, ...]) -> _Fit | None:
        """Fit causes together with the joints; return None if a size has the wrong sign.

        Raises:
            SolverError: the causes imply loads without a balance.
        """
        terms = [*self._always, *(suspect.term for suspect in suspects)]
        fitted = fit_causes_with_joints(self._part, terms, self._start.tests.compliance)
        fitted_before = {term.name for term in self._always}
        if _has_wrong_sign(fitted.errors, except_for=fitted_before):
            return None
        residual_squares = fitted.tests.residual_squares()
        # The onset of a cause that sets in later counts as one more unknown.
        onset_count = sum(suspect.first is not None for suspect in suspects)
        unknown_count = fitted.errors.determined + onset_count
        criterion = fitted.tests.criterion(residual_squares, unknown_count)
        return _Fit(suspects, fitted, residual_squares, unknown_count, criterion)

    def test_others(self, fit: _Fit) -> Step:
        """Test all other causes, added to the joints and to fitted causes.

        Raises:
            SolverError: a load has no balance.
        """
        fitted = fit.fitted
        at_fitted = self._part.at(fitted.compliance)
        without_causes = subtract_errors(at_fitted, fitted.errors)
        corrected = CorrectedMeasurements.from_measurements(without_causes, fitted.errors)
        return Step.test(
            at_fitted.of(corrected),
            self._measurements,
            fitted.compliance,
            fitted.visible,
            scattered=self._scattered,
        )

    def run(self, *, seek_wrong: bool) -> _Selected:
        """Select causes one after the other, until none is significant or a wrong posture explains more.

        Args:
            seek_wrong: whether single wrong postures compete with the causes.
        """
        fits: list[_Fit] = []  # after each step, each with one cause more
        pool: dict[str, Suspect] = {}
        tests: Step | None = self._start
        while tests is not None:
            significant = self._note_significant(tests)
            # A suspect of an earlier step stays where a later one has the same name.
            pool = {suspect.term.name: suspect for suspect in significant} | pool
            best_fit = self._fit_next(fits, significant)
            if seek_wrong:
                wrong_label = _find_wrong_label(tests, best_fit, fits)
                if wrong_label is not None:
                    return _Selected(fits, pool, wrong_label)
            if best_fit is None:
                break
            fits.append(best_fit)
            tests = self._test_others_if_balanced(best_fit)
        return _Selected(fits, pool)

    def _note_significant(self, tests: Step) -> list[Suspect]:
        """Return the significant suspects of a step, and remember their p-values as the latest ones."""
        significant = tests.significant
        for suspect in significant:
            self._p_values[suspect] = tests.p_values[suspect]
        return significant

    def _test_others_if_balanced(self, fit: _Fit) -> Step | None:
        """Return the tests of all other causes; None if the fitted causes imply loads without a balance."""
        try:
            return self.test_others(fit)
        except SolverError:
            return None

    def _fit_next(self, fits: Sequence[_Fit], significant: Sequence[Suspect]) -> _Fit | None:
        """Return the best fit of one more cause, or None if no further cause is to be selected.

        `fits` are the fits of the steps before; `significant` are the causes to choose from.
        """
        if len(fits) == _MOST_STEPS:
            return None
        selected = fits[-1].suspects if fits else ()
        fits_or_none = [self.fit((*selected, suspect)) for suspect in significant]
        candidates = [fit for fit in fits_or_none if fit is not None]
        return min(candidates, key=_by_criterion, default=None)

    def exchange(self, chosen: _Fit, pool: Iterable[Suspect]) -> _Fit:
        """Exchange selected causes for other causes of the pool, as long as the fit improves.

        `chosen` is the fit of the selected causes; the best fit found is returned.
        """
        for _ in range(_MOST_EXCHANGES):
            before = chosen
            for position in range(len(chosen.suspects)):
                replacements = self._list_replacements(chosen, position, pool)
                chosen = min([chosen, *replacements], key=_by_criterion)
            if chosen is before:
                break
        return chosen

    def _list_replacements(self, chosen: _Fit, position: int, pool: Iterable[Suspect]) -> list[_Fit]:
        """Return the fits in which one selected cause is replaced by each other cause of the pool.

        `position` is the index of the replaced cause among the selected causes.
        """
        names = {suspect.term.name for suspect in chosen.suspects}
        before, after = chosen.suspects[:position], chosen.suspects[position + 1 :]
        fits = [self.fit((*before, other, *after)) for other in pool if other.term.name not in names]
        return [fit for fit in fits if fit is not None]

    def drop_unnecessary(self, chosen: _Fit) -> _Fit:
        """Drop each cause that is no longer significant when the others are fitted without it."""
        for suspect in reversed(chosen.suspects):
            others = tuple(other for other in chosen.suspects if other is not suspect)
            fit_of_others = self.fit(others) if others else None
            if fit_of_others is None:
                continue
            try:
                significant = self.test_others(fit_of_others).significant
            except SolverError:  # a load has no balance: keep the cause
                continue
            if suspect.name not in {other.name for other in significant}:
                chosen = fit_of_others
        return chosen

    def describe(self, chosen: _Fit, pool: Iterable[Suspect]) -> tuple[Cause, ...]:
        """Return the selected causes in order.

        Each cause is followed by the other causes that explain the readings about equally well in its place.
        """
        causes = []
        for position, suspect in enumerate(chosen.suspects):
            causes.append(self._describe_one(chosen, position))
            replacements = sorted(self._list_replacements(chosen, position, pool), key=_by_criterion)
            described_names = {suspect.name}
            for fit in replacements:
                name = fit.suspects[position].name
                # The best fit comes first; other onsets of the same cause are not described again.
                is_new = name not in described_names
                if is_new and self._is_tie(fit, chosen, position):
                    described_names.add(name)
                    causes.append(self._describe_one(fit, position))
        return tuple(causes)

    def _is_tie(self, other: _Fit, chosen: _Fit, position: int) -> bool:
        """Return whether two causes, each at one position of its fit, explain the readings equally well.

        The criterion decides, unless the other cause contains the chosen one: causes with the same columns
        are a tie, a cause with more columns is none. Scales of two loads are the same as a force along the
        rope, but scales of three loads contain this force.
        """
        columns_of_chosen = self._find_own_columns(chosen.suspects[position])
        columns_of_other = self._find_own_columns(other.suspects[position])
        overlap = columns_of_other.T @ columns_of_chosen
        unexplained = columns_of_chosen - columns_of_other @ overlap
        contains_chosen = np.linalg.norm(unexplained, ord=2) < _ALIKE
        if contains_chosen and columns_of_chosen.size:
            return len(columns_of_other.T) == len(columns_of_chosen.T)
        return other.criterion <= chosen.criterion + EQUALLY_GOOD

    def _find_own_columns(self, suspect: Suspect) -> FloatArray:
        """Return a basis (K, k) of the motion by a cause that joints do not explain; empty if unknown."""
        tests = self._start.tests
        triangle = tests.triangle
        if suspect.term.name not in triangle.span:
            return np.zeros((len(triangle.rhs), 0))
        of_joints = orthonormal_basis(triangle.unit_columns(tests.fitted))
        columns = triangle.unit_columns([suspect.term.name])
        unexplained = columns - of_joints @ (of_joints.T @ columns)
        return orthonormal_basis(unexplained, DISTINCT)

    def _describe_one(self, fit: _Fit, position: int) -> Cause:
        """Return the cause at a position of a fit, with its unknowns, tests and effect on the residuals."""
        suspect, fitted = fit.suspects[position], fit.fitted
        position_among_terms = len(self._always) + position  # terms that are always fitted come first
        squares_without_causes = self._start.tests.residual_squares()
        return Cause(
            suspect=suspect,
            unknowns=fitted.errors.unknowns[position_among_terms],
            p_value=self._p_values[suspect],
            links_p_value=fitted.tests.links_p_value(),
            compliance=fitted.compliance,
            ratio=fit.squares / squares_without_causes,
            criterion=fit.criterion,
            step=position,
        )


def select_causes(tested: Rows, measurements: Measurements, start: Step, *, scattered: bool) -> Selection:
    """Select the causes that together explain the readings, and the postures whose readings are wrong.

    A posture with wrong readings is left out, and the selection begins anew. If more postures are wrong than
    single mistakes explain, they have a cause in common: all postures are kept. If links or a base explain
    the readings better, only causes that make links unnecessary are returned.

    Args:
        tested: observations that are tested.
        measurements: all N observations.
        start: tests of each cause added to the joints.
        scattered: whether the residuals show a scatter of the joints.
    """
    most_wrong = max(1, int(_MOST_WRONG * len(tested)))
    wrong_labels: list[str] = []
    remaining, tests = tested, start
    while len(wrong_labels) <= most_wrong:
        if wrong_labels:
            remaining = _leave_out_posture(remaining, wrong_labels[-1])
            tests = Step.test(
                remaining, measurements, start.tests.compliance, start.tests.visible, scattered=scattered
            )
        search = _Search(remaining, measurements, tests, scattered=scattered)
        selected = search.run(seek_wrong=True)
        if selected.wrong_label is None:
            return Selection(_describe_selected(search, selected, tests), tuple(wrong_labels), tests)
        wrong_labels.append(selected.wrong_label)
    search = _Search(tested, measurements, start, scattered=scattered)
    selected = search.run(seek_wrong=False)
    return Selection(_describe_selected(search, selected, start), (), start)


def _leave_out_posture(rows: Rows, label: str) -> Rows:
    """Return the rows of all observations but those with a label."""
    is_kept = np.array([other != label for other in rows.measurements.labels])
    return rows[np.flatnonzero(is_kept)]


def _describe_selected(search: _Search, selected: _Selected, tests: Step) -> tuple[Cause, ...]:
    """Return the selected causes that explain the readings better than links, or as well as links.

    If several causes together do not explain the readings better than links, only the first step counts.

    Args:
        search: the search that selected the causes.
        selected: fits of the causes, step by step.
        tests: tests of each cause added to the joints.
    """
    fits, pool = selected.fits, selected.pool.values()
    if not fits:
        return ()
    if len(fits) > 1:
        best_fit = search.drop_unnecessary(search.exchange(fits[-1], pool))
        causes = search.describe(best_fit, pool)
        if _explain_better_than_links(causes, tests):
            return causes
    causes = search.describe(fits[0], tests.significant)
    links_are_significant = tests.links_p_value < LINKS_LEVEL
    if links_are_significant and tests.tests.links_criterion() < fits[0].criterion - EQUALLY_GOOD:
        return tuple(cause for cause in causes if cause.makes_links_unnecessary)
    return causes


def _explain_better_than_links(causes: Sequence[Cause], start: Step) -> bool:
    """Return whether causes explain the readings better than bending links or a bending base.

    With all causes fitted, the test of links must also find nothing. `start` are the tests of links and base
    added to the joints alone.
    """
    last_step = causes[-1].step
    causes_of_last_step = [cause for cause in causes if cause.step == last_step]
    best_criterion = min(cause.criterion for cause in causes)
    links_explain_nothing_more = all(cause.makes_links_unnecessary for cause in causes_of_last_step)
    return links_explain_nothing_more and start.is_explained_better(best_criterion)
