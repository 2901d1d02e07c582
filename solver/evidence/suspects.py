"""Causes that may have moved the targets in addition to the joints (method.md §13)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray, IndexArray, unit_columns
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.fit.triangle import DISTINCT, INDEPENDENT, orthonormal_basis, stack_padded
from jointstiff.solver.mechanics.block import Term, fitted_errors
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.mechanics.terms import (
    FORCE_SCALE,
    SHIFT,
    STIFFNESS,
    TERMS,
    build_curve_term,
    build_load_scale_term,
    build_turn_term,
    limit_to_later,
)

MOST_TESTED_OBSERVATIONS: Final = 500
"""Number of observations that suffice for the tests."""
_LEAST_PART: Final = 4
"""Least number of observations before and after the onset of a cause, or under one of several loads."""
_ONLY_LATER: Final = (FORCE_SCALE, STIFFNESS)
"""Terms that look like other compliances if they concern all observations: they can only set in later."""
_DISTINCT: Final = 0.03
"""Relative difference of two loads from which on they are distinct."""
_MOST_LOADS: Final = 6
"""Largest number of distinct loads of a set that may each have a scale of their own."""


@dataclass(frozen=True)
class Suspect:
    """Possible cause that may have moved the targets in addition to the joints, to be tested."""

    name: str  #: name of the cause
    term: Term  #: how the cause moves the targets
    first: str | None = None  #: label of the first observation that the cause concerns; None for all
    onsets_tried: int = 1  #: number of observations that were tried as the onset; multiplies the p-value
    least_p_value: float = 0.0  #: p-value without the observation that the cause explains most


def list_suspected_terms(measurements: Measurements, tested: Rows) -> list[Term]:
    """Return the terms that may have moved the targets of all observations.

    Args:
        measurements: N observations.
        tested: some of these observations.
    """
    block = tested.block
    centre_of_targets = block.points[block.measurements.present].mean(axis=0)
    largest_torques = np.abs(block.torque).max(axis=0)
    terms = [*TERMS.values(), build_turn_term(centre_of_targets)]
    loads = group_distinct_loads(measurements)
    if len(loads) > 1:
        terms.append(build_load_scale_term(loads))
    terms.append(build_curve_term(largest_torques))
    return [term for term in terms if term.suspected]


def list_suspects(
    measurements: Measurements,
    tested: Rows,
    compliance: FloatArray,
    always_fitted: Sequence[Term],
    onsets: Sequence[str] | None = None,
) -> list[Suspect]:
    """Return the causes that may have moved the targets and are to be tested.

    Each suspect has a lower limit of its p-value, so that a single wrong reading cannot make the suspect
    significant.

    Args:
        measurements: N observations.
        tested: some of these observations.
        compliance: (n,) of the joints [rad/(N·m)].
        always_fitted: terms that are fitted in any case; these terms are not suspected again.
        onsets: labels of the observations at which a cause may set in; None to search for the onset.
    """
    labels = measurements.labels
    terms_of_set = list_suspected_terms(measurements, tested)
    later = _list_later_terms(terms_of_set, labels)
    if onsets is None:
        suspects = _search_suspects(tested, compliance, always_fitted, terms_of_set, later, labels)
    else:
        of_all = [Suspect(term.name, term) for term in terms_of_set]
        suspects = of_all + _limit_to_onsets(later, onsets, labels)
    always_fitted_names = {term.name for term in always_fitted}
    return [suspect for suspect in suspects if suspect.term.name not in always_fitted_names]


def _list_later_terms(terms_of_set: Sequence[Term], labels: Sequence[str]) -> dict[str, Term]:
    """Return name → term of the causes that may set in at a later observation.

    For example a tracker that was bumped shifts all readings from then on.

    Args:
        terms_of_set: terms that may have moved the targets of all observations, among them a turn.
        labels: labels of all observations, which have one scale of the load in common.
    """
    turn = next(term for term in terms_of_set if term.name == "turn")
    return {
        SHIFT.name: SHIFT,
        turn.name: turn,
        FORCE_SCALE.name: build_load_scale_term([labels]),
        STIFFNESS.name: STIFFNESS,
    }


def _limit_to_onsets(
    later: Mapping[str, Term], onsets: Sequence[str], labels: Sequence[str]
) -> list[Suspect]:
    """Return each cause that may set in later, from each of the given onsets on.

    Args:
        later: name → term.
        onsets: labels of the onsets; labels of no observation are left out.
        labels: labels of all observations.
    """
    known_onsets = [first for first in onsets if first in labels]
    suspects = []
    for term in later.values():
        suspects += [Suspect(term.name, limit_to_later(term, labels, first), first) for first in known_onsets]
    return suspects


def _search_suspects(
    tested: Rows,
    compliance: FloatArray,
    always_fitted: Sequence[Term],
    terms_of_set: Sequence[Term],
    later: Mapping[str, Term],
    labels: Sequence[str],
) -> list[Suspect]:
    """Return suspects that concern all observations, and suspects that set in at a later observation.

    Args:
        tested: observations that are tested.
        compliance: (n,) of the joints [rad/(N·m)].
        always_fitted: terms that are fitted in any case.
        terms_of_set: terms that may have moved the targets of all observations.
        later: terms that may set in at a later observation, by name.
        labels: labels of all observations; some of these observations are tested.
    """
    fitted_names = [term.name for term in (JOINTS, *always_fitted)]
    other_terms = [term for term in (*terms_of_set, *_ONLY_LATER) if term.name not in fitted_names]
    stack = tested.stack([JOINTS, *always_fitted, *other_terms], compliance)
    shown_names = list_shown_terms(stack, fitted_names, [term.name for term in terms_of_set])
    sought_names = [*shown_names, *(term.name for term in _ONLY_LATER)]
    fits = _OnsetFits(stack, sought_names, fitted_names)
    term_of_name = {term.name: term for term in terms_of_set}
    suspects = _suspect_from_first(fits, [term_of_name[name] for name in shown_names])
    onset_count = len(tested) - 2 * _LEAST_PART + 1  # with enough observations before and after
    if onset_count >= 1:
        suspects += _suspect_from_best_onset(fits, later, tested.measurements.labels, labels)
    return suspects


def _suspect_from_first(fits: _OnsetFits, terms: Sequence[Term]) -> list[Suspect]:
    """Return the suspects that concern all observations.

    `terms` are the first of the terms of the fits: the others can only set in later.
    """
    first_observation = np.zeros(len(fits.names), np.intp)
    p_values = fits.compute_p_values_without_best_observation(first_observation).tolist()
    suspects = []
    for term, p_value in zip(terms, p_values[: len(terms)], strict=True):
        suspects.append(Suspect(term.name, term, least_p_value=p_value))
    return suspects


def _suspect_from_best_onset(
    fits: _OnsetFits, later: Mapping[str, Term], tested_labels: Sequence[str], labels: Sequence[str]
) -> list[Suspect]:
    """Return the suspects that set in at the observation from which on they explain the readings best.

    Args:
        fits: fits of all terms from each observation on.
        later: name → term of the causes that may set in later.
        tested_labels: labels of the observations of the fits; any observation may be the onset.
        labels: labels of all observations.
    """
    onsets = fits.find_onsets()
    p_values = fits.compute_p_values_without_best_observation(onsets)
    tried_count = len(tested_labels) - 2 * _LEAST_PART + 1
    suspects = []
    for name, onset, p_value in zip(fits.names, onsets.tolist(), p_values.tolist(), strict=True):
        if name in later:
            first = tested_labels[onset]
            term = limit_to_later(later[name], labels, first)
            suspects.append(
                Suspect(later[name].name, term, first, onsets_tried=tried_count, least_p_value=p_value)
            )
    return suspects


def list_shown_terms(stack: Stack, fitted: Sequence[str], names: Sequence[str]) -> list[str]:
    """Return the names of the terms that the readings of a set can show.

    The readings show a term if its motion differs from that of the joints and of the other fitted terms.
    A term that no reading shows is not tested: its test would cost the level of all others.

    Args:
        stack: rows of the observations.
        fitted: names of the joints and of terms that are fitted in any case; none of these is returned.
        names: names of the terms of interest.
    """
    fitted_columns = np.concatenate([stack.span[name] for name in fitted])
    fitted_unit_vectors, _ = unit_columns(stack.flat[:, fitted_columns])
    basis = orthonormal_basis(fitted_unit_vectors)
    shown = []
    for name in names:
        if name in fitted:
            continue
        unit_vectors, _ = unit_columns(stack.flat[:, stack.span[name]])
        unexplained = unit_vectors - basis @ (basis.T @ unit_vectors)
        if np.linalg.norm(unexplained, ord=2) > DISTINCT:
            shown.append(name)
    return shown


def group_distinct_loads(measurements: Measurements) -> tuple[tuple[str, ...], ...]:
    """Return the labels of the observations under each distinct load, from the smallest load to the largest.

    Loads of nearly the same size count as one load. A load with fewer than `_LEAST_PART` observations is left
    out, because they could not determine a scale of their own. If more than `_MOST_LOADS` loads remain, there
    are no groups.

    Measurements that were corrected for fitted errors keep the groups from before the correction: a fitted
    constant force would make loads of one size differ.
    """
    fitted = fitted_errors(measurements)
    is_corrected = len(fitted.terms) > 0
    if is_corrected:
        return fitted.labels_by_load
    force_size = np.linalg.norm(measurements.force, axis=1)
    moment_size = np.linalg.norm(measurements.moment, axis=1)
    load_size = np.hypot(force_size, moment_size)
    ascending = np.argsort(load_size, kind="stable")
    ascending_sizes = load_size[ascending]
    is_distinct = np.diff(ascending_sizes) > _DISTINCT * ascending_sizes[1:]  # from the next smaller load
    starts = 1 + np.flatnonzero(is_distinct)  # where the next group begins
    groups = []
    for group in np.split(ascending, starts):
        if len(group) >= _LEAST_PART:
            labels = tuple(measurements.labels[i] for i in group.tolist())
            groups.append(labels)
    return tuple(groups) if len(groups) <= _MOST_LOADS else ()


class _FitsFromOnsets(NamedTuple):
    """Least-squares fits of S terms of at most k unknowns, from each of N observations on."""

    moments: FloatArray  # (S, N, k, 1) products of the columns of a term with the residuals
    unknowns: FloatArray  # (S, N, k, 1)

    @property
    def gains(self) -> FloatArray:
        """(S, N) decrease of the sum of squared residuals by each fit."""
        return np.asarray((self.moments * self.unknowns).sum(axis=(2, 3)))


class _OnsetFits:
    """Fits of S terms that act only from some observation on, for each of N observations as the onset.

    Each term is fitted together with the joints and other known terms, whose columns were projected out of
    the readings. Columns have unit length over all observations; m rows for each observation, at most k
    columns for each term.

    Attributes:
        names: names of the S terms.
    """

    def __init__(self, stack: Stack, names: Sequence[str], known: Sequence[str]) -> None:
        """Fit each term for each observation as its onset.

        Args:
            stack: N observations.
            names: names of the S terms.
            known: names of terms that are fitted in any case.
        """
        self.names = list(names)
        unit_stack, _ = stack.scale_to_unit_columns()
        flat = unit_stack.flat
        basis = orthonormal_basis(flat[:, np.concatenate([stack.span[name] for name in known])])
        readings = stack.flat[:, -1]
        residual = readings - basis @ (basis.T @ readings)
        columns_of_terms = [flat[:, stack.span[name]] for name in names]
        columns = stack_padded(columns_of_terms)  # (S, N m, k)
        self._fits = _fit_from_each_onset(stack, basis, residual, columns)
        self._read = stack.read
        self._width = np.array([columns.shape[1] for columns in columns_of_terms])
        self._columns = columns.reshape(len(names), len(stack), -1, columns.shape[-1])
        self._known = basis.reshape(len(stack), -1, basis.shape[1])
        self._residual = residual.reshape(len(stack), -1, 1)

    def find_onsets(self) -> IndexArray:
        """Return the best onset (S,) of each of S terms: the index of the first observation that it moves.

        Enough observations lie before and after the onset.
        """
        gains = self._fits.gains
        observation_count = gains.shape[1]
        allowed = gains[:, _LEAST_PART : observation_count - _LEAST_PART + 1]
        return np.asarray(_LEAST_PART + np.argmax(allowed, axis=1))

    def compute_p_values_without_best_observation(self, first: IndexArray) -> FloatArray:
        """Return the p-values (S,) of F tests of S terms that begin at given onsets.

        For each term the observation that the term explains best is left out, as the observation may be a
        single wrong reading. `first` (S,) are the indices of the onsets.
        """
        squares = np.square(self._residual).sum(axis=(1, 2))  # (N,)
        gain = squares - self._compute_squares_with_term(first)  # (S, N)
        is_kept = np.arange(len(squares)) != np.argmax(gain, axis=1)[:, None]
        explained = np.maximum((is_kept * gain).sum(axis=1), 0.0)
        unexplained = np.maximum((is_kept * squares).sum(axis=1) - explained, 1e-300)
        freedom = (is_kept * self._read).sum(axis=1) - self._known.shape[-1] - self._width
        divisor = np.maximum(freedom, 1)
        f_ratio = (explained / self._width) / (unexplained / divisor)
        p_values = special.fdtrc(self._width, divisor, f_ratio)
        return np.where(freedom < 1, 1.0, p_values)

    def _compute_squares_with_term(self, first: IndexArray) -> FloatArray:
        """Return the squared residuals (S, N) of each observation after the fit of each term.

        The known terms absorb a part of the motion by a term. `first` (S,) are the indices of the onsets:
        earlier observations are not moved.
        """
        term_count = len(first)
        unknowns = self._fits.unknowns[np.arange(term_count), first]  # (S, k, 1)
        motion = self._columns @ unknowns[:, None]  # (S, N, m, 1)
        is_before = np.arange(len(self._read)) < first[:, None]
        motion[is_before] = 0.0
        # Share of known term q in the motion by term s, from rows r of observations b.
        absorbed_shares = np.einsum("brq,sbrl->sql", self._known, motion)
        absorbed = self._known @ absorbed_shares[:, None]
        return np.asarray(np.square(self._residual - motion + absorbed).sum(axis=(2, 3)))


def _fit_from_each_onset(
    stack: Stack, basis: FloatArray, residual: FloatArray, columns: FloatArray
) -> _FitsFromOnsets:
    """Fit each of S terms to the residuals, from each of N observations on.

    A term that begins at observation i has zero columns before i. Its normal equations are sums over the
    observations i to N − 1, so that sums from the last observation on give the fits for all onsets.

    Args:
        stack: N observations of m rows, with the number of coordinates that were read in each.
        basis: (N m, q) orthonormal basis of the known terms.
        residual: (N m,) readings that the known terms leave.
        columns: (S, N m, k) columns of the terms.
    """
    term_count, _, width = columns.shape
    known_count = basis.shape[1]
    rows = np.concatenate([basis, residual[:, None], *columns], axis=1)
    widths = {"known": known_count, "residual": 1, "terms": term_count * width}
    sums = Stack(rows.reshape(len(stack), -1, rows.shape[-1]), stack.read, widths).trailing_gram_sums
    moments, unknowns = [], []
    for term in range(term_count):
        start = known_count + 1 + term * width
        of_term = slice(start, start + width)
        overlap = sums[:, :known_count, of_term]  # (N, q, k) with the known terms
        gram = sums[:, of_term, of_term] - overlap.mT @ overlap
        moment = sums[:, of_term, known_count, None]  # (N, k, 1) with the residual
        moments.append(moment)
        unknowns.append(np.linalg.solve(gram + INDEPENDENT * np.eye(width), moment))
    return _FitsFromOnsets(np.array(moments), np.array(unknowns))
