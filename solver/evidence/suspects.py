"""Causes that may have moved the targets in addition to the joints (method.md §13)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
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
    loads, block = group_distinct_loads(measurements), tested.block
    turn = build_turn_term(block.points[block.measurements.present].mean(axis=0))
    by_load = [build_load_scale_term(loads)] if len(loads) > 1 else []
    curve = build_curve_term(np.abs(block.torque).max(axis=0))
    return [term for term in (*TERMS.values(), turn, *by_load, curve) if term.suspected]


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
    tried_count = len(tested) - 2 * _LEAST_PART + 1
    terms_of_set = list_suspected_terms(measurements, tested)
    turn = next(term for term in terms_of_set if term.name == "turn")
    # Causes that may set in at a later observation.
    later = {SHIFT.name: SHIFT, turn.name: turn, FORCE_SCALE.name: build_load_scale_term([labels])}
    suspects = [Suspect(term.name, term) for term in terms_of_set]
    if firsts is not None:
        known_firsts = [first for first in firsts if first in labels]
        suspects += [
            Suspect(t.name, limit_to_later(t, labels, first), first)
            for t in later.values()
            for first in known_firsts
        ]
    else:  # fit each term with each observation as the onset, to find the best onset
        fitted_names = [term.name for term in (JOINTS, *always_fitted)]
        others = [term for term in (*terms_of_set, FORCE_SCALE) if term.name not in fitted_names]
        stack = tested.stack([JOINTS, *always_fitted, *others], compliance)
        shown = list_shown_terms(stack, fitted_names, [term.name for term in terms_of_set])
        suspects = [each for each in suspects if each.name in shown]
        terms = [*(each.term for each in suspects), FORCE_SCALE]
        fits = _OnsetFits(stack, [term.name for term in terms], fitted_names)
        least_p_values = fits.compute_p_values_without_best_observation(np.zeros(len(terms), np.intp))
        suspects = [
            replace(each, least_p=p) for each, p in zip(suspects, least_p_values.tolist(), strict=False)
        ]
        if tried_count > 0:
            onsets = fits.find_onsets()
            for each, onset, p in zip(
                terms,
                onsets.tolist(),
                fits.compute_p_values_without_best_observation(onsets).tolist(),
                strict=True,
            ):
                if each.name in later:
                    term, first = later[each.name], tested.measurements.labels[onset]
                    suspects.append(
                        Suspect(term.name, limit_to_later(term, labels, first), first, tried_count, p)
                    )
    return [suspect for suspect in suspects if suspect.term.name not in {term.name for term in always_fitted}]


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
    basis = orthonormal_basis(unit_columns(stack.flat[:, fitted_columns])[0])
    shown = []
    for name in names:
        if name in fitted:
            continue
        columns = unit_columns(stack.flat[:, stack.span[name]])[0]
        remaining_columns = columns - basis @ (basis.T @ columns)
        if np.linalg.norm(remaining_columns, ord=2) > DISTINCT:
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
    load_size = np.hypot(
        np.linalg.norm(measurements.force, axis=1), np.linalg.norm(measurements.moment, axis=1)
    )
    ascending = np.argsort(load_size, kind="stable")
    steps = 1 + np.flatnonzero(np.diff(load_size[ascending]) > _DISTINCT * load_size[ascending][1:])
    groups = [group for group in np.split(ascending, steps) if len(group) >= _LEAST_PART]
    if len(groups) > _MOST_LOADS:
        return ()
    return tuple(tuple(measurements.labels[i] for i in group.tolist()) for group in groups)


class _OnsetFits:
    """Fits of S terms that act only from some observation on, for each of N observations as the onset.

    Each term is fitted together with the joints and other terms. Columns have unit length over all
    observations.
    """

    def __init__(self, stack: Stack, names: Sequence[str], known: Sequence[str]) -> None:
        """Fit each term for each observation as its onset.

        Args:
            stack: N observations.
            names: names of the S terms.
            known: names of terms that are fitted in any case.
        """
        flat = stack.scale_to_unit_columns()[0].flat
        basis = orthonormal_basis(flat[:, np.concatenate([stack.span[name] for name in known])])
        residual = stack.flat[:, -1] - basis @ (basis.T @ stack.flat[:, -1])
        columns = [flat[:, stack.span[name]] for name in names]
        q, self._width = basis.shape[1], np.array([each.shape[1] for each in columns])
        X = stack_padded(columns)  # (S, N m, k)
        shape, k = (len(stack), -1), X.shape[-1]
        rows = np.concatenate([basis, residual[:, None], *X], axis=1).reshape(*shape, q + 1 + len(names) * k)
        trailing = Stack(
            rows, stack.read, {"known": q, "residual": 1, "terms": len(names) * k}
        ).trailing_gram_sums
        # Sums of Gram matrices from each observation to the last give the fits for all onsets at once.
        columns_of_term = (q + 1 + np.arange(len(names) * k)).reshape(len(names), k)
        overlap = trailing[:, :q][:, :, columns_of_term].transpose(2, 0, 1, 3)  # (S, N, q, k)
        # Gram matrix of each term after the known terms have been projected out.
        grams = trailing[:, columns_of_term[:, :, None], columns_of_term[:, None]].transpose(1, 0, 2, 3)
        projected = grams - overlap.mT @ overlap
        self._moment = trailing[:, columns_of_term, q, None].transpose(1, 0, 2, 3)  # (S, N, k, 1)
        self._unknowns = np.linalg.solve(projected + INDEPENDENT * np.eye(k), self._moment)
        self._read, self._X = stack.read, X.reshape(len(names), *shape, k)
        self._known, self._left = basis.reshape(*shape, q), residual.reshape(*shape, 1)

    def find_onsets(self) -> IndexArray:
        """Return the best onset (S,) of each of S terms: the index of the first observation that it moves.

        Enough observations lie before and after the onset.
        """
        gain = (self._moment * self._unknowns).sum(axis=(2, 3))
        allowed = gain[:, _LEAST_PART : gain.shape[1] - _LEAST_PART + 1]
        return np.asarray(_LEAST_PART + np.argmax(allowed, axis=1))

    def compute_p_values_without_best_observation(self, first: IndexArray) -> FloatArray:
        """Return the p-values (S,) of S terms that begin at given onsets, each without one observation.

        For each term the observation that the term explains best is left out, as the observation may be a
        single wrong reading. `first` (S,) are the indices of the onsets.
        """
        count = len(self._read)
        motion = self._X @ self._unknowns[np.arange(len(first)), first][:, None]
        motion = np.where(np.arange(count)[:, None, None] >= first[:, None, None, None], motion, 0.0)
        # The known terms absorb part of the motion by the term.
        absorbed = self._known @ np.einsum("brk,sbrl->skl", self._known, motion)[:, None]
        squares = np.square(self._left)
        squares_with_term = np.square(self._left - motion + absorbed)
        squares, gain = squares.sum(axis=(1, 2)), (squares - squares_with_term).sum(axis=(2, 3))
        others = np.arange(count) != np.argmax(gain, axis=1)[:, None]
        freedom = (others * self._read).sum(axis=1) - self._known.shape[-1] - self._width
        explained = np.maximum((others * gain).sum(axis=1), 0.0)
        residual = np.maximum((others * squares).sum(axis=1) - explained, 1e-300)
        divisor = np.maximum(freedom, 1)  # without freedom the p-value is 1, see below
        p = special.fdtrc(self._width, divisor, explained / self._width / (residual / divisor))
        return np.where(freedom < 1, 1.0, p)
