"""Readings that belong to other rows, and deflections that were given as positions under load.

Under load the targets are within millimetres of their unloaded positions. If the loaded readings of a row are
decimetres away, but at the unloaded positions of another row, the rows were shifted or mixed up. If the
unloaded readings are mixed up, one place of the targets on the flange brings each reading to the posture of
another row.
"""

from __future__ import annotations

from collections import Counter
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray, IndexArray, wrap
from jointstiff.solver.integrity.values import LARGEST_DEFLECTION, View
from jointstiff.solver.text import length_text

_SAME_PLACE: Final = 0.02
"""Greatest distance [m] of a reading from the place of another row that it is compared with."""
_CLEARER: Final = 5.0
"""Least ratio of the distance from the own row to that from the other row: less proves no exchange."""
_EXPLAINED: Final = 0.8
"""Fraction of the rows that another order of all rows must explain."""
_LEAST_ROWS: Final = 5
"""Least number of rows whose order is searched: few rows may agree by chance."""
_MOST_ROWS: Final = 1000
"""Greatest number of rows whose order is searched."""
_SAMPLE: Final = 30
"""Number of readings with which each place of the targets is tried."""
_MOST_STEPS: Final = 30_000
"""Greatest number of postures in which the tried places of one reading are computed, over all places."""
_SAME_TURN: Final = 0.02
"""Greatest difference [rad or m] of joint offsets that count as the same offset."""


def inspect_loaded(view: View) -> list[Finding]:
    """Find loaded readings that are deflections, or that belong to other rows; no finding without a proof."""
    unloaded = np.where(view.measured[..., None], view.measurements.position, np.nan)
    loaded = unloaded + view.measurements.deflection
    is_far = view.measured.any(axis=1) & (_find_greatest(loaded - unloaded) > LARGEST_DEFLECTION)
    if not is_far.any():
        return []
    greatest_loaded = float(np.nanmax(np.linalg.norm(loaded, axis=2)))
    nearest_unloaded = float(np.nanmin(np.linalg.norm(unloaded, axis=2)))
    if greatest_loaded <= LARGEST_DEFLECTION and nearest_unloaded > _CLEARER * LARGEST_DEFLECTION:
        message = (
            f"all loaded readings are within {length_text(greatest_loaded)} of the origin of R0, but the "
            f"unloaded readings are at least {length_text(nearest_unloaded)} away: the loaded readings seem "
            "to be deflections, loaded minus unloaded"
        )
        remedy = "add the unloaded positions to the loaded readings"
        return [view.build_finding("deflection_implausibly_large", message, remedy, "do_not_use")]
    rows = np.flatnonzero(is_far)
    true_rows = _match_rows(loaded[rows], unloaded, rows)
    shift = np.nanmean(loaded[rows] - unloaded[rows], axis=1)
    # A constant shift, as of a tracker that was moved, may lead from one row to another by chance.
    is_constant_shift = len(rows) > 1 and np.ptp(shift, axis=0).max() <= _SAME_PLACE
    if not _is_order(true_rows) or is_constant_shift:
        return []
    message = (
        f"the loaded readings of {len(rows)} of {len(loaded)} observations are at the unloaded positions of "
        f"{_describe_order(rows, true_rows, len(loaded))}, within {length_text(LARGEST_DEFLECTION)}"
    )
    remedy = "match the rows of the loaded readings with those of the unloaded readings again"
    return [view.build_finding("observations_out_of_order", message, remedy, "do_not_use")]


def inspect_order(view: View, rows: IndexArray) -> list[Finding]:
    """Find readings that are in another order than the joint angles; no finding without a proof.

    Args:
        view: measurement set.
        rows: (M,) indices of rows whose targets have no common places on the flange as posted.
    """
    count = len(view.postures)
    if not _LEAST_ROWS <= count <= _MOST_ROWS or len(rows) < _LEAST_ROWS:
        return []
    readings = np.where(view.measured[..., None], view.measurements.position, np.nan)[rows]
    places = _find_places(view, readings, rows)
    expected = view.postures.to_base(np.broadcast_to(places, (count, *places.shape)))
    true_rows = _match_rows(readings, expected, rows)
    is_found = true_rows >= 0
    is_other = is_found & (true_rows != rows)
    joints = view.measurements.joints
    offsets = joints[true_rows[is_other]] - joints[rows[is_other]]
    offsets = np.where(view.robot.prismatic, offsets, wrap(offsets))
    if not _is_order(true_rows) or 2 * is_other.sum() < len(rows):
        return []
    # A constant offset of the joints, as of a turned frame, would explain the readings equally well.
    if np.ptp(offsets, axis=0).max() <= _SAME_TURN:
        return []
    message = (
        f"the readings of {is_other.sum()} of {len(rows)} observations are in another order than the joint "
        f"angles: each fits the angles of {_describe_order(rows[is_other], true_rows[is_other], count)}, "
        f"within {length_text(_SAME_PLACE)}"
    )
    remedy = "match the rows of the readings with those of the joint angles again"
    return [view.build_finding("observations_out_of_order", message, remedy, "do_not_use")]


def _find_greatest(vectors: FloatArray) -> FloatArray:
    """Return the greatest length (...) of vectors (..., T, 3) of T targets; infinite if none was measured."""
    lengths = np.linalg.norm(vectors, axis=-1)
    is_measured = ~np.isnan(lengths)
    return np.where(is_measured.any(axis=-1), np.where(is_measured, lengths, 0.0).max(axis=-1), np.inf)


def _match_rows(readings: FloatArray, expected: FloatArray, rows: IndexArray) -> IndexArray:
    """Return for each reading (M,) the row whose positions it has; −1 without a row that is clearly nearer.

    Args:
        readings: (M, T, 3) positions of targets [m]; NaN where not measured.
        expected: (N, T, 3) positions in each row [m].
        rows: (M,) row of each reading.
    """
    true_rows = np.full(len(rows), -1)
    for i, row in enumerate(rows.tolist()):
        distances = _find_greatest(expected - readings[i])
        # Of rows that repeat a posture, the nearest in the table is meant.
        fitting = np.flatnonzero(distances <= max(_SAME_PLACE / _CLEARER, distances.min()))
        nearest = int(fitting[np.abs(fitting - row).argmin()])
        is_clear = nearest == row or distances[row] >= _CLEARER * distances[nearest]
        if distances[nearest] <= _SAME_PLACE and is_clear:
            true_rows[i] = nearest
    return true_rows


def _is_order(true_rows: IndexArray) -> bool:
    """Return whether most readings belong to some row, and to different rows.

    Readings that all belong to one row were read in one posture, and are in no order. `true_rows` (M,) are
    the rows of the readings, −1 where unknown.
    """
    found = true_rows[true_rows >= 0]
    return len(found) >= _EXPLAINED * len(true_rows) and len(np.unique(found)) >= _EXPLAINED * len(found)


def _find_places(view: View, readings: FloatArray, rows: IndexArray) -> FloatArray:
    """Return the places (T, 3) of the targets on the flange with which most readings fit any posture [m].

    Readings of three rows are tried with the posture of every row; of many rows, with those nearest in the
    table. `readings` are (M, T, 3) [m], those of `rows` (M,).
    """
    postures = view.postures
    tried = max(_MOST_STEPS // len(postures), 1)
    sample = readings[np.unique(np.linspace(0, len(readings) - 1, _SAMPLE).round().astype(int))]
    best, best_places = -1, readings[0]
    for anchor in (0, len(readings) // 2, len(readings) - 1):
        in_all_rows = np.broadcast_to(readings[anchor], (len(postures), *readings[anchor].shape))
        nearest = np.argsort(np.abs(np.arange(len(postures)) - rows[anchor]), kind="stable")[:tried]
        for places in postures.to_flange(in_all_rows)[nearest]:
            expected = postures.to_base(np.broadcast_to(places, (len(postures), *places.shape)))
            distances = _find_greatest(expected[None] - sample[:, None]).min(axis=1)
            fitting = int(np.sum(distances <= _SAME_PLACE))
            if fitting > best:
                best, best_places = fitting, places
            if fitting == len(sample):
                return np.asarray(places)
    return np.asarray(best_places)


def _describe_order(rows: IndexArray, true_rows: IndexArray, count: int) -> str:
    """Return in words to which rows the readings of some rows belong; `count` is the number of all rows."""
    found = true_rows >= 0
    shift, size = Counter(((true_rows - rows)[found] % count).tolist()).most_common(1)[0]
    if size < _EXPLAINED * len(rows):
        first = int(np.flatnonzero(found)[0])
        return f"other rows (observations[{rows[first]}] of observations[{true_rows[first]}])"
    steps = min(shift, count - shift)
    side = "after" if shift <= count - shift else "before"
    return f"the row {side}" if steps == 1 else f"the row that is {steps} rows {side}"
