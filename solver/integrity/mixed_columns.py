"""Columns of readings that are copies of other columns, or that were read in another order.

A coordinate of a target that has the same digits with and without the load in nearly all rows, while the
other targets move along this axis, is a copied column. If all targets are far away under load, but near after
the axes of states and targets are exchanged, an array was reshaped in another order than that of its columns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.integrity.mistakes import EXPLAINED
from jointstiff.solver.integrity.values import LARGEST_DEFLECTION, View, median
from jointstiff.solver.text import length_text

_LEAST_ROWS: Final = 4
"""Least number of rows that show a copied column, or another order of the columns."""
_SAME: Final = 1e-12
"""Greatest difference [m] of a coordinate that has the same digits in two states, after a change of axes."""
_MOST_ZEROS: Final = 0.05
"""Largest fraction of the other targets' readings that do not move along the axis of a copied column: coarse
digits, or an arm that cannot move along this axis, make more of them zero."""
_CLEARLY: Final = 3.0
"""Least ratio of the scatters of distances in two states that shows which of the two is wrong."""


def leave_out_copied_columns(view: View) -> tuple[list[Finding], View]:
    """Report coordinates of targets whose column in one state is a copy of the column in the other state.

    Returns:
        The finding, if any; and the set without the readings of these targets.
    """
    measurements = view.measurements
    if measurements.direction is not None:  # readings along one direction have no columns of coordinates
        return [], view
    copies = _Copies.find(view)
    has_copy = copies.is_copied.any(axis=1)
    if not has_copy.any():
        return [], view
    present = measurements.present & ~has_copy
    without = replace(
        measurements,
        present=present,
        position=np.where(present[..., None], measurements.position, 0.0),
        deflection=np.where(present[..., None], measurements.deflection, 0.0),
    )
    return [_report_copies(view, copies)], replace(view, measurements=without)


@dataclass(frozen=True, eq=False)
class _Copies:
    """Coordinates of targets that have the same digits in both states."""

    motion: FloatArray  # (N, T, 3) motion under load along the axes of the readings [m]
    is_read: BoolArray  # (N, T) mask of the readings under load
    is_copied: BoolArray  # (T, 3) mask of the coordinates that are copies in nearly all rows

    @classmethod
    def find(cls, view: View) -> _Copies:
        """Find the copied coordinates of a set."""
        position = view.measurements.position
        motion = view.as_read(position + view.measurements.deflection) - view.as_read(position)
        is_read = view.measured & view.loaded[:, None]
        counts = np.maximum(is_read.sum(axis=0), 1)[:, None]
        shares = ((np.abs(motion) <= _SAME) & is_read[..., None]).sum(axis=0) / counts
        is_copied = (shares >= EXPLAINED) & (counts >= _LEAST_ROWS)
        # Other targets must move along the axis: no arm moves one of the targets on its flange alone.
        moves = (shares <= _MOST_ZEROS) & (counts >= _LEAST_ROWS)
        return cls(motion, is_read, is_copied & moves.any(axis=0) & (is_copied | moves).all(axis=0))


def _report_copies(view: View, copies: _Copies) -> Finding:
    """Build the finding about copied columns."""
    counts = ((np.abs(copies.motion) <= _SAME) & copies.is_read[..., None]).sum(axis=0)
    state = _find_wrong_state(view, np.asarray(copies.is_copied.any(axis=1)))
    sentences, wrong, names = list[str](), list[str](), list[str]()
    for target, axis in np.argwhere(copies.is_copied).tolist():
        name, letter = view.measurements.targets[target], "xyz"[axis]
        loaded, unloaded = f"'{name} loaded {letter}'", f"'{name} unloaded {letter}'"
        where = f"{counts[target, axis]} of {copies.is_read[:, target].sum()} observations"
        sentences.append(f"{loaded} equals {unloaded} in {where}")
        wrong += {"loaded": [loaded], "unloaded": [unloaded], None: [unloaded, loaded]}[state]
        names.append(f"'{name}'")
    # Motions of the other targets along the axes of the copied columns
    is_other = copies.is_read[..., None] & ~copies.is_copied & copies.is_copied.any(axis=0)
    typical = length_text(median(np.abs(copies.motion[is_other])))
    message = (
        f"{', and '.join(sentences)}, digit by digit, but other targets move along the same axis by "
        f"{typical} in the median: a column was copied"
    )
    remedy = (
        f"copy the right column {', '.join(wrong)} from the readings of the instrument; without them, leave "
        f"out {', '.join(dict.fromkeys(names))}: remove all columns of the target, in JSON its readings"
    )
    return view.build_finding("deflection_implausibly_small", message, remedy, "do_not_use")


def _find_wrong_state(view: View, is_mistaken: BoolArray) -> Literal["unloaded", "loaded"] | None:
    """Return the state in which the distances of mistaken targets (T,) to others scatter; None if unclear."""
    position = view.measurements.position
    scatters = [
        _measure_scatter(view, positions, is_mistaken)
        for positions in (position, position + view.measurements.deflection)
    ]
    if scatters[0] > _CLEARLY * scatters[1]:
        return "unloaded"
    return "loaded" if scatters[1] > _CLEARLY * scatters[0] else None


def _measure_scatter(view: View, positions: FloatArray, is_mistaken: BoolArray) -> float:
    """Return the greatest standard deviation of a distance from a mistaken target to another target [m]."""
    scatter = 0.0
    for mistaken in np.flatnonzero(is_mistaken).tolist():
        for other in np.flatnonzero(~is_mistaken).tolist():
            rows = view.measured[:, mistaken] & view.measured[:, other]
            distances = np.linalg.norm(positions[rows, mistaken] - positions[rows, other], axis=1)
            scatter = max(scatter, float(distances.std()) if len(distances) else 0.0)
    return scatter


@dataclass(frozen=True, eq=False)
class _Order:
    """Order of the columns of an array, and the way in which the array was reshaped instead."""

    unloaded: FloatArray  # (N, T, 3) readings without load in the right order [m]
    loaded: FloatArray  # (N, T, 3) readings under load in the right order [m]
    words: str  # order of the columns
    shape: str  # axes of the right array
    slices: str  # readings of the right array


def find_mixed_axes(view: View) -> Finding | None:
    """Return the finding that states and targets are mixed alike in all rows; None without it.

    Args:
        view: measurement set.
    """
    measurements, count = view.measurements, len(view.measurements.targets)
    rows = np.flatnonzero(view.measured.all(axis=1))
    if count < 2 or len(rows) < _LEAST_ROWS or measurements.direction is not None:
        return None
    unloaded = measurements.position[rows]
    loaded = unloaded + measurements.deflection[rows]
    if not _are_far(unloaded, loaded).mean() >= EXPLAINED:
        return None
    for order in _list_orders(unloaded, loaded):
        are_near = ~_are_far(order.unloaded, order.loaded)
        if are_near.mean() < EXPLAINED:
            continue
        farthest = float(np.linalg.norm(loaded - unloaded, axis=2).max())
        message = (
            f"states and targets are mixed in all observations: as given, targets move by up to "
            f"{length_text(farthest)} under load; if the columns are {order.words}, all targets move by "
            f"less than {length_text(LARGEST_DEFLECTION)} in {are_near.sum()} of {len(rows)} observations"
        )
        remedy = (
            f"in an array, reshape these columns as ({order.shape}), and give {order.slices}; in a table, "
            "name the columns in that order"
        )
        return view.build_finding("targets_swapped", message, remedy, "do_not_use")
    return None


def _are_far(unloaded: FloatArray, loaded: FloatArray) -> BoolArray:
    """Return a mask (N,) of the rows in which a target is farther away under load than a deflection."""
    distances = np.linalg.norm(loaded - unloaded, axis=2)
    return np.asarray(distances.max(axis=1) > LARGEST_DEFLECTION)


def _list_orders(unloaded: FloatArray, loaded: FloatArray) -> Iterator[_Order]:
    """Yield the two orders of the columns that a reshaped array (N, T, 3) of each state may have had."""
    count = unloaded.shape[1]
    by_state = np.concatenate([unloaded, loaded], axis=1)  # columns that were cut into two states
    yield _Order(
        by_state[:, ::2],
        by_state[:, 1::2],
        "those of one target after the other, each unloaded and loaded",
        f"-1, {count}, 2, 3",
        "[:, :, 0] as unloaded and [:, :, 1] as loaded",
    )
    by_target = np.stack([unloaded, loaded], axis=2).reshape(len(unloaded), 2 * count, 3)
    yield _Order(
        by_target[:, :count],
        by_target[:, count:],
        "those of all targets unloaded, then of all targets loaded",
        f"-1, 2, {count}, 3",
        "[:, 0] as unloaded and [:, 1] as loaded",
    )
