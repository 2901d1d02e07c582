"""Causes that may have moved the targets in addition to the joints (method.md §13)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.fit.triangle import (
    DISTINCT,
    INDEPENDENT,
    orthonormal_basis,
    stack_padded,
    unit_columns,
)
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
    tried: int = 1  #: number of observations that were tried as the onset; multiplies the p-value
    least_p: float = 0.0  #: lower limit of the p-value: without the observation that the cause explains most


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
    firsts: Sequence[str] | None = None,
) -> list[Suspect]:
    """Return the causes that may have moved the targets and are to be tested.

    Each suspect has a lower limit of its p-value, so that a single wrong reading cannot make the suspect
    significant.

    Args:
        measurements: N observations.
        tested: some of these observations.
        compliance: (n,) of the joints [rad/(N·m)].
        always_fitted: terms that are fitted in any case; these terms are not suspected again.
        firsts: labels of observations that may be the onset of a cause; None to search for the onset.
    """
    labels = measurements.labels
    terms_of_set = list_suspected_terms(measurements, tested)
    turn = next(term for term in terms_of_set if term.name == "turn")
    # Causes that may set in at a later observation.
    later = {
        SHIFT.name: SHIFT,
        turn.name: turn,
        FORCE_SCALE.name: build_load_scale_term([labels]),
        STIFFNESS.name: STIFFNESS,
    }
    if firsts is None:
        suspects = _search_suspects(tested, compliance, always_fitted, terms_of_set, later, labels)
    else:
        suspects = [Suspect(term.name, term) for term in terms_of_set]
        for term in later.values():
            for first in firsts:
                if first in labels:
                    suspects.append(Suspect(term.name, limit_to_later(term, labels, first), first))
    always_fitted_names = {term.name for term in always_fitted}
    return [suspect for suspect in suspects if suspect.term.name not in always_fitted_names]


def _search_suspects(
    tested: Rows,
    compliance: FloatArray,
    always_fitted: Sequence[Term],
    terms_of_set: Sequence[Term],
    later: Mapping[str, Term],
    labels: Sequence[str],
) -> list[Suspect]:
    """Return suspects that concern all observations, and suspects that set in at a later observation.

    A later suspect begins at its best onset: the observation from which on it explains the readings best.

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
    first_onsets = np.zeros(len(sought_names), np.intp)
    p_values = fits.compute_p_values_without_best_observation(first_onsets)[: len(shown_names)].tolist()
    term_of_name = {term.name: term for term in terms_of_set}
    suspects = [
        Suspect(name, term_of_name[name], least_p=p) for name, p in zip(shown_names, p_values, strict=True)
    ]
    tried_count = len(tested) - 2 * _LEAST_PART + 1
    if tried_count < 1:
        return suspects
    onsets = fits.find_onsets()
    p_values = fits.compute_p_values_without_best_observation(onsets).tolist()
    for name, onset, p in zip(sought_names, onsets.tolist(), p_values, strict=True):
        if name in later:
            term, first = later[name], tested.measurements.labels[onset]
            term_from_onset = limit_to_later(term, labels, first)
            suspects.append(Suspect(term.name, term_from_onset, first, tried=tried_count, least_p=p))
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

    Loads of nearly the same size count as one load. There are no groups for more than `_MOST_LOADS` loads.
    Loads count as they were stated: a constant force that was fitted makes loads of one size differ.
    """
    fitted = fitted_errors(measurements)
    if fitted.terms:
        return fitted.loads
    force_size = np.linalg.norm(measurements.force, axis=1)
    moment_size = np.linalg.norm(measurements.moment, axis=1)
    load_size = np.hypot(force_size, moment_size)
    ascending = np.argsort(load_size, kind="stable")
    ascending_sizes = load_size[ascending]
    is_distinct = np.diff(ascending_sizes) > _DISTINCT * ascending_sizes[1:]  # from the next smaller load
    starts = 1 + np.flatnonzero(is_distinct)  # where the next group begins
    groups = [group for group in np.split(ascending, starts) if len(group) >= _LEAST_PART]
    if len(groups) > _MOST_LOADS:
        return ()
    return tuple(tuple(measurements.labels[i] for i in group.tolist()) for group in groups)


class _OnsetFits:
    """Fits of S terms that act only from some observation on, for each of N observations as the onset.

    Each term is fitted together with the joints and other known terms, whose columns were projected out of
    the readings. Columns have unit length over all observations; m rows for each observation, at most k
    columns for each term.
    """

    def __init__(self, stack: Stack, names: Sequence[str], known: Sequence[str]) -> None:
        """Fit each term for each observation as its onset.

        A term that begins at observation i has zero columns before i. Its normal equations are sums over the
        observations i to N − 1, so that sums from the last observation on give the fits for all onsets.

        Args:
            stack: N observations.
            names: names of the S terms.
            known: names of terms that are fitted in any case.
        """
        unit_stack, _ = stack.scale_to_unit_columns()
        flat = unit_stack.flat
        basis = orthonormal_basis(flat[:, np.concatenate([stack.span[name] for name in known])])
        readings = stack.flat[:, -1]
        residual = readings - basis @ (basis.T @ readings)
        columns_of_terms = [flat[:, stack.span[name]] for name in names]
        padded_columns = stack_padded(columns_of_terms)  # (S, N m, k)
        q, k, term_count = basis.shape[1], padded_columns.shape[-1], len(names)
        # Columns: q of the known terms, 1 of the residual, S k of the terms. Sums (N, K, K) of Gram matrices.
        rows = np.concatenate([basis, residual[:, None], *padded_columns], axis=1)
        widths = {"known": q, "residual": 1, "terms": term_count * k}
        sums = Stack(rows.reshape(len(stack), -1, rows.shape[-1]), stack.read, widths).trailing_gram_sums
        moments, unknowns = [], []  # of each term
        for term in range(term_count):
            start = q + 1 + term * k
            of_term = slice(start, start + k)
            overlap = sums[:, :q, of_term]  # (N, q, k) with the known terms
            gram = sums[:, of_term, of_term] - overlap.mT @ overlap
            moment = sums[:, of_term, q, None]  # (N, k, 1) with the residual
            moments.append(moment)
            unknowns.append(np.linalg.solve(gram + INDEPENDENT * np.eye(k), moment))
        self._moment, self._unknowns = np.array(moments), np.array(unknowns)  # (S, N, k, 1)
        self._read = stack.read
        self._width = np.array([columns.shape[1] for columns in columns_of_terms])
        self._columns = padded_columns.reshape(term_count, len(stack), -1, k)
        self._known = basis.reshape(len(stack), -1, q)
        self._residual = residual.reshape(len(stack), -1, 1)

    def find_onsets(self) -> IndexArray:
        """Return the best onset (S,) of each of S terms: the index of the first observation that it moves.

        Enough observations lie before and after the onset.
        """
        gain = (self._moment * self._unknowns).sum(axis=(2, 3))  # (S, N) decrease of the residual sum
        observation_count = gain.shape[1]
        allowed = gain[:, _LEAST_PART : observation_count - _LEAST_PART + 1]
        return np.asarray(_LEAST_PART + np.argmax(allowed, axis=1))

    def compute_p_values_without_best_observation(self, first: IndexArray) -> FloatArray:
        """Return the p-values (S,) of F tests of S terms that begin at given onsets.

        For each term the observation that the term explains best is left out, as the observation may be a
        single wrong reading. `first` (S,) are the indices of the onsets.
        """
        term_count, observation_count = len(first), len(self._read)
        observations = np.arange(observation_count)
        unknowns = self._unknowns[np.arange(term_count), first]  # (S, k, 1)
        motion = self._columns @ unknowns[:, None]  # (S, N, m, 1)
        is_before = observations < first[:, None]
        motion[is_before] = 0.0
        # The known terms absorb part of the motion: their share q of term s, from rows r of observations b.
        absorbed_shares = np.einsum("brq,sbrl->sql", self._known, motion)
        absorbed = self._known @ absorbed_shares[:, None]
        squares = np.square(self._residual).sum(axis=(1, 2))  # (N,)
        squares_with_term = np.square(self._residual - motion + absorbed).sum(axis=(2, 3))  # (S, N)
        gain = squares - squares_with_term
        is_kept = observations != np.argmax(gain, axis=1)[:, None]
        freedom = (is_kept * self._read).sum(axis=1) - self._known.shape[-1] - self._width
        explained = np.maximum((is_kept * gain).sum(axis=1), 0.0)
        residual = np.maximum((is_kept * squares).sum(axis=1) - explained, 1e-300)
        divisor = np.maximum(freedom, 1)  # without freedom the p-value is 1, see below
        f_ratio = (explained / self._width) / (residual / divisor)
        p_values = special.fdtrc(self._width, divisor, f_ratio)
        return np.where(freedom < 1, 1.0, p_values)
