"""Readings of one target that were shifted by a row in one state, such as by cells inserted in a sheet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.integrity.mistakes import EXPLAINED
from jointstiff.solver.integrity.one_state import keep_places
from jointstiff.solver.integrity.values import LARGEST_DEFLECTION, View
from jointstiff.solver.text import length_text

_LEAST_ROWS: Final = 3
"""Least number of rows that show a shift: fewer may agree by chance."""
_CLEARER: Final = 5.0
"""Least ratio of the distance from the own row to that from the other row: less proves no shift."""


@dataclass(frozen=True, eq=False)
class _Shift:
    """Rows in which the loaded readings of a target belong to the unloaded readings of a neighbouring row."""

    target: int  #: index of the target
    rows: IndexArray  #: (M,) indices of the rows, from the first to the last one
    step: int  #: −1 if the loaded readings belong to the row before, 1 for the row after
    distance: float  #: greatest distance of the readings that belong together [m]
    distance_as_given: float  #: greatest distance as given [m]


def find_shifted_targets(view: View) -> list[Finding]:
    """Find targets whose readings of one state were shifted by a row, while other targets move as usual."""
    if view.measurements.direction is not None:  # readings along one direction are no positions
        return []
    unloaded = np.where(view.measured[..., None], view.measurements.position, np.nan)
    loaded = unloaded + view.measurements.deflection
    is_far = np.linalg.norm(loaded - unloaded, axis=2) > LARGEST_DEFLECTION
    counts = view.measured.sum(axis=0)
    is_usual = (counts >= _LEAST_ROWS) & (is_far.sum(axis=0) <= (1.0 - EXPLAINED) * counts)
    if not is_usual.any():
        return []
    shifts = [
        shift
        for target in np.flatnonzero(is_far.sum(axis=0) >= _LEAST_ROWS).tolist()
        for shift in _list_shifts(unloaded[:, target], loaded[:, target], target)
    ]
    return [_report_shift(view, shift, unloaded, loaded) for shift in shifts]


def _list_shifts(unloaded: FloatArray, loaded: FloatArray, target: int) -> Iterator[_Shift]:
    """Yield the shift by one row that explains the readings (N, 3) of a target, if any."""
    as_given = np.linalg.norm(loaded - unloaded, axis=1)
    far = np.flatnonzero(as_given > LARGEST_DEFLECTION)
    rows = np.arange(far[0], far[-1] + 1)
    rows = rows[np.isfinite(as_given[rows])]
    # A constant shift, as of a target that was moved, may lead from one row to another by chance.
    if np.ptp((loaded - unloaded)[far], axis=0).max() <= LARGEST_DEFLECTION:
        return
    for step in (-1, 1):
        distances = np.linalg.norm(loaded - np.roll(unloaded, -step, axis=0), axis=1)
        belongs = distances <= np.minimum(LARGEST_DEFLECTION, as_given / _CLEARER)
        count = int(belongs[rows].sum())
        # One reading is lost at the edge of a shift.
        if count >= max(_LEAST_ROWS, min(EXPLAINED * len(rows), len(rows) - 1)):
            greatest = float(distances[rows][belongs[rows]].max())
            yield _Shift(target, rows, step, greatest, float(as_given[far].max()))
            return


def _report_shift(view: View, shift: _Shift, unloaded: FloatArray, loaded: FloatArray) -> Finding:
    """Build the finding that the readings of a target in one state were shifted by a row.

    The places on the flange decide which state was shifted.

    Args:
        view: measurement set.
        shift: rows and direction of the shift.
        unloaded: (N, T, 3) positions without load in R0 [m].
        loaded: (N, T, 3) positions under load in R0 [m].
    """
    name = f"'{view.measurements.targets[shift.target]}'"
    labels, rows = view.measurements.labels, shift.rows
    where = f"from {labels[rows[0]]} on"
    if rows[-1] < len(labels) - 1:
        where = f"from {labels[rows[0]]} to {labels[rows[-1]]}"
    elif rows[0] == 0:
        where = "in all observations"
    is_shifted = np.isin(np.arange(len(labels)), rows)[:, None, None]
    unloaded_fits, loaded_fits = (
        keep_places(view, view.as_read(np.where(is_shifted, positions[:, shift.target, None], np.nan)))
        for positions in (unloaded, loaded)
    )
    state, step = ("unloaded", -shift.step) if loaded_fits and not unloaded_fits else ("loaded", shift.step)
    side, other_side = ("before", "after") if step < 0 else ("after", "before")
    message = (
        f"{where}, the {state} readings of {name} are those of the row {side}: as given, {name} moves by up "
        f"to {length_text(shift.distance_as_given)} under load, and with the {state} readings of the row "
        f"{other_side}, by up to {length_text(shift.distance)}; other targets move as usual"
    )
    remedy = (
        f"shift the {state} readings of {name} back by one row {where}: each observation has the reading of "
        f"the row {other_side}; where none is left, leave the reading out"
    )
    if unloaded_fits == loaded_fits:
        remedy += f"; or, if the {state} readings are right, shift the other readings of {name}"
    return view.build_finding("observations_out_of_order", message, remedy, "do_not_use")
