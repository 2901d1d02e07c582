"""Readings in another order than the joint positions, or than the readings of the other state."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray, wrap
from jointstiff.solver.integrity.explain import LEAST_ROWS_OF_MANY, Correction
from jointstiff.solver.integrity.parts import STATES, change_part
from jointstiff.solver.integrity.places import (
    EXPLAINED,
)
from jointstiff.solver.integrity.values import View

_SAME_PLACE: Final = 0.02
"""Greatest distance [m] of a reading from the place of another row that it is compared with."""
_CLEARER: Final = 5.0
"""Least ratio of the distance from the own row to that from the other row: less proves no order."""
_LEAST_MOVED: Final = 3
"""Least number of readings of other rows that show an order: fewer may agree by chance."""
_TRIED: Final = 30
"""Number of rows whose postures are tried for a reading: the nearest in the table, or all of a small set."""
_SAME_TURN: Final = 0.02
"""Greatest difference [rad or m] of joint offsets that count as the same offset."""


def list_orders_of_states(view: View) -> Iterator[Correction]:
    """Yield the order of the readings of one state, or of a target in it, that fits the other state."""
    given, count = view.measurements, len(view.measurements)
    if given.direction is not None or not given.deflection.any():
        return
    read, rows, targets = view.measured[..., None], np.arange(count), np.arange(len(given.targets))
    states = [np.where(read, each, np.nan) for each in (given.position, given.position + given.deflection)]
    groups = [(targets, "")] + [
        (targets[[t]], f" of '{name}'") for t, name in enumerate(given.targets) if len(targets) > 1
    ]
    for (group, whose), number in product(groups, (1, 0)):
        true = _match_rows(states[number][:, group], states[1 - number][:, group], rows)
        moved = np.flatnonzero((true >= 0) & (true != rows))
        if len(moved) < _LEAST_MOVED or not _is_order(true):
            continue
        order = rows.copy()
        order[true[true >= 0]] = rows[true >= 0]
        mask = np.isin(targets, group) & (np.arange(2) == number)[:, None]
        yield Correction(
            "observations_out_of_order",
            change_part(view, mask, np.eye(3), order),
            f"the {STATES[number]} readings{whose} of {len(moved)} of {count} observations are at the "
            f"{STATES[1 - number]} positions of {_describe_order(moved, true[moved], count)}, from "
            f"{given.labels[moved[0]]} to {given.labels[moved[-1]]}",
            "each in its own row",
            f"match the rows of the {STATES[number]} readings{whose} with those of the others again; "
            "where none is "
            "left, leave the reading out",
        )


def list_orders(view: View) -> Iterator[Correction]:
    """Yield the order of all readings in which they fit the joint angles."""
    given, count = view.measurements, len(view.measurements)
    if count < LEAST_ROWS_OF_MANY:
        return
    readings, rows = np.where(view.measured[..., None], given.position, np.nan), np.arange(count)
    true = _match_rows(readings, view.postures.to_base(_spread(_find_places(view, readings), count)), rows)
    moved = np.flatnonzero((true >= 0) & (true != rows))
    if not _is_order(true) or 2 * len(moved) < count:
        return
    offsets = given.joints[true[moved]] - given.joints[moved]
    # A constant offset of the joints, as of a turned frame, would explain the readings equally well.
    if np.ptp(np.where(view.robot.prismatic, offsets, wrap(offsets)), axis=0).max() <= _SAME_TURN:
        return
    yield Correction(
        "observations_out_of_order",
        replace(given[np.flatnonzero(true >= 0)], joints=given.joints[true[true >= 0]]),
        f"the readings of {len(moved)} of {count} observations are in another order than the joint "
        "angles: each fits "
        f"the angles of {_describe_order(moved, true[moved], count)}",
        "each at these angles",
        "match the rows of the readings with those of the joint angles again",
    )


def _spread(places: FloatArray, count: int) -> FloatArray:
    return np.broadcast_to(places, (count, *places.shape))


def _find_places(view: View, readings: FloatArray) -> FloatArray:
    """Return the places (T, 3) on the flange [m] with which most readings (N, T, 3) fit any posture."""
    postures, count = view.postures, len(readings)
    tried, few = (
        max(30_000 // count, 1),
        readings[np.unique(np.linspace(0, count - 1, _TRIED).round().astype(int))],
    )
    best, best_places = -1, readings[0]
    for anchor in (0, count // 2, count - 1):
        nearest = np.argsort(np.abs(np.arange(count) - anchor), kind="stable")[:tried]
        for places in postures.to_flange(_spread(readings[anchor], count))[nearest]:
            expected = postures.to_base(_spread(places, count))
            fitting = int((_find_greatest(expected[None] - few[:, None]).min(axis=1) <= _SAME_PLACE).sum())
            if fitting > best:
                best, best_places = fitting, places
            if fitting == len(few):
                return np.asarray(places)
    return np.asarray(best_places)


def _find_greatest(vectors: FloatArray) -> FloatArray:
    """Return the greatest length (...) of vectors (..., T, 3) of T targets; infinite if none was measured."""
    lengths = np.linalg.norm(vectors, axis=-1)
    is_measured = ~np.isnan(lengths)
    return np.where(is_measured.any(axis=-1), np.where(is_measured, lengths, 0.0).max(axis=-1), np.inf)


def _match_rows(readings: FloatArray, expected: FloatArray, rows: IndexArray) -> IndexArray:
    """Return for each reading (N, T, 3) the row whose positions (N, T, 3) it has; −1 without a clear one."""
    true = np.full(len(rows), -1)
    for row in rows.tolist():
        distances = _find_greatest(expected - readings[row])
        # Of rows that repeat a posture, the nearest in the table is meant.
        fitting = np.flatnonzero(distances <= max(_SAME_PLACE / _CLEARER, distances.min()))
        nearest = int(fitting[np.abs(fitting - row).argmin()])
        is_clear = nearest == row or distances[row] >= _CLEARER * distances[nearest]
        if distances[nearest] <= _SAME_PLACE and is_clear:
            true[row] = nearest
    return true


def _is_order(true: IndexArray) -> bool:
    """Return whether most readings belong to some row, and to different rows."""
    found = true[true >= 0]
    return len(found) >= EXPLAINED * len(true) and len(np.unique(found)) >= EXPLAINED * len(found)


def _describe_order(rows: IndexArray, true: IndexArray, count: int) -> str:
    """Return in words to which rows the readings of some rows belong; `count` is the number of all rows."""
    shift, size = Counter(((true - rows) % count).tolist()).most_common(1)[0]
    if size < EXPLAINED * len(rows):
        return f"other rows (observations[{rows[0]}] of observations[{true[0]}])"
    steps = min(shift, count - shift)
    side = "after" if shift <= count - shift else "before"
    return f"the row {side}" if steps == 1 else f"the row that is {steps} rows {side}"
