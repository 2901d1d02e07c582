"""Displacements that are differences of positions in the same files, and so state nothing more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.schemas.imports import State
from jointstiff.service.importing.rows import ObservationRecord
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.table import find_rounding

_MOST_DECIMALS: Final = 8
"""Decimals up to which rounding is found: 10 nm in metres."""
_NO_ROUNDING: Final = 1e-9
"""Difference by binary arithmetic."""
FACTORS: Final = (1.0, 1e-3, 1e-6)
"""Units of displacements in the unit of the positions, such as µm next to mm."""
_LEAST_ROWS: Final = 3
_LEAST_PART: Final = 0.5
"""Fraction of the displacements that must be compared."""
_MOST_ROUNDING: Final = 0.25
"""Greatest error by rounding, in the median displacement, with which numbers show a difference."""

_STATES: Final[Sequence[State]] = ("unloaded", "loaded", "deflection")

Vectors = tuple[FloatArray, FloatArray, FloatArray]


def omit_differences(
    observations: Sequence[ObservationRecord],
) -> tuple[list[ObservationRecord], list[str]]:
    """Return observations without the deflections that are differences of their positions, and notes."""
    omitted = [
        target
        for target, (unloaded, loaded, shifts) in _stack_vectors(observations).items()
        if are_differences(unloaded, loaded, shifts)
    ]
    if not omitted:
        return list(observations), []
    note = "the deflection is the difference of the positions, and is ignored"
    notes = [f"{target}: {note}" for target in omitted]
    return [_omit_deflections(observation, omitted) for observation in observations], notes


def _stack_vectors(observations: Sequence[ObservationRecord]) -> Mapping[str, Vectors]:
    """Return target → its positions without and under load and its deflections, each (N, 3).

    A target is left out unless each of its observations with a deflection has all three.
    """
    rows: dict[str, list[list[Sequence[float]]]] = {}
    for observation in observations:
        for target, states in observation.points.items():
            if "deflection" in states:
                present = [states[state] for state in _STATES if state in states]
                rows.setdefault(target, []).append([value.vector or () for value in present])
    stacked = dict[str, Vectors]()
    for target, own in rows.items():
        if all(list(map(len, vectors)) == [3, 3, 3] for vectors in own):
            unloaded, loaded, shifts = np.array(own, float).transpose(1, 0, 2)
            stacked[target] = (unloaded, loaded, shifts)
    return stacked


def _omit_deflections(observation: ObservationRecord, targets: Sequence[str]) -> ObservationRecord:
    """Return an observation without the deflections of some targets."""
    values = {
        quantity: value
        for quantity, value in observation.values.items()
        if quantity.state != "deflection" or quantity.target not in targets
    }
    return replace(observation, values=values)


def are_differences(first: FloatArray, second: FloatArray, shifts: FloatArray) -> bool:
    """Return whether displacements (N, 3) are differences of two positions (N, 3) but for rounding.

    The displacements may have the other sign, and a smaller unit.
    """
    differences = second - first
    known = np.isfinite(differences).all(axis=1) & np.isfinite(shifts).all(axis=1)
    stated = int(np.isfinite(shifts).all(axis=1).sum())
    if known.sum() < max(_LEAST_ROWS, _LEAST_PART * stated):
        return False
    differences, shifts = differences[known], shifts[known]
    typical = float(np.median(np.linalg.norm(differences, axis=1)))
    of_positions = 0.5 * (find_rounding(first, _MOST_DECIMALS) + find_rounding(second, _MOST_DECIMALS))
    for factor in FACTORS:
        rounding = of_positions + 0.5 * factor * find_rounding(shifts, _MOST_DECIMALS)
        deviation = min(np.abs(differences - sign * factor * shifts).max() for sign in (1.0, -1.0))
        if deviation <= rounding + _NO_ROUNDING and rounding <= _MOST_ROUNDING * typical:
            return True
    return False
