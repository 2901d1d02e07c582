"""A target that sits elsewhere from some observation on: a step in where it is beside the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.integrity.thresholds import MODEL_ALLOWANCE, vector_quantile, vector_scale

LEAST_ROWS: Final = 4
SMALLEST_STEP: Final = 1e-4
"""Step of a target [m] that is always reported."""

LARGEST_TURN: Final = 1e-3
"""Displacement of a target [m] by the model's error of the flange's direction: 0.2° at 0.3 m."""
_RANK: Final = 1e-6


@dataclass(frozen=True)
class Step:
    """A lasting displacement of one target."""

    target: int  #: its index
    row: int  #: the first observation in which it sits elsewhere
    size: float  #: of the displacement [m]
    ratio: float  #: of the displacement to what chance allows


def find_step(places: FloatArray, allowance: float = 1.0) -> Step | None:
    """The most significant lasting displacement of a target beside the barycentre of the others.

    The others take away what the model has wrong of the flange's position; what it has wrong of its
    direction, a fraction of a millimetre on the targets' triangle, varies with the posture and is part of the
    scatter. The scale is that of the changes from row to row, by their median, which a single step does not
    touch, or that of the rows about the means of both sides, whichever is greater. A step is that of a target
    only if its distances to the others change by `SMALLEST_STEP`, too, or if they cannot tell: the model's
    error of the flange's direction moves it beside the others, and changes no distance.

    Args:
        places: (N, T, 3) in the flange frame [m]; nan where a target was not measured.
        allowance: factor on what chance allows.

    Returns:
        None if there is none beyond chance.
    """
    count = places.shape[1]
    if len(places) < LEAST_ROWS or count < 2:
        return None
    read = ~np.isnan(places[..., 0])
    filled = np.where(read[..., None], places, 0.0)
    series = []
    for t in range(count):
        rows = np.flatnonzero(read[:, t] & (read.sum(axis=1) == read.sum(axis=1).max()))
        if len(rows) >= LEAST_ROWS:
            others = (filled[rows].sum(axis=1) - filled[rows, t]) / max(1, read[rows].sum(axis=1)[0] - 1)
            series.append((t, rows, filled[rows, t] - others))
    return _most_significant(series, allowance, places)


def _most_significant(
    series: list[tuple[int, IndexArray, FloatArray]], allowance: float, places: FloatArray
) -> Step | None:
    if not series:
        return None
    changes = np.concatenate([np.diff(y, axis=0) for _, _, y in series])
    scale = vector_scale(np.linalg.norm(changes, axis=1)) / np.sqrt(2.0)
    freedom = 3.0 * len(changes) * (len(series) - 1) / len(series)
    limit = allowance * MODEL_ALLOWANCE * vector_quantile(len(changes), freedom)
    best: Step | None = None
    for t, rows, y in series:
        k, shift = _split(y)
        sides = np.concatenate([y[:k] - y[:k].mean(axis=0), y[k:] - y[k:].mean(axis=0)])
        within = max(scale, vector_scale(np.linalg.norm(sides, axis=1)), 1e-9)
        size = float(np.linalg.norm(shift))
        ratio = size / (limit * within * np.sqrt(1.0 / k + 1.0 / (len(y) - k)))
        likelier = ratio > (best.ratio if best else 1.0) and size > SMALLEST_STEP
        if likelier and _apart_from_others(places[rows], t, k, shift):
            best = Step(t, int(rows[k]), size, ratio)
    return best


def _apart_from_others(places: FloatArray, target: int, k: int, shift: FloatArray) -> bool:
    """Return whether distances agree that a target moved by a shift (3,) [m] after the first k rows."""
    arms = np.delete(places, target, axis=1) - places[:, target, None]
    arms = arms[:, ~np.isnan(arms).any(axis=(0, 2))]
    lengths = np.linalg.norm(arms, axis=2)
    change = np.abs(np.median(lengths[k:], axis=0) - np.median(lengths[:k], axis=0))
    if change.max(initial=0.0) > SMALLEST_STEP:
        return True
    unit = np.median(arms, axis=0) / np.median(lengths, axis=0)[:, None]
    seen = np.linalg.lstsq(unit.T, shift, rcond=_RANK)[0] @ unit if len(unit) else np.zeros(3)
    return float(np.linalg.norm(shift - seen)) > LARGEST_TURN


def _split(y: FloatArray) -> tuple[int, FloatArray]:
    """Number of rows (M, 3) before the most significant step, and the step (3,)."""
    before = np.arange(1, len(y))
    sums = np.cumsum(y, axis=0)
    shift = (sums[-1] - sums[:-1]) / (len(y) - before)[:, None] - sums[:-1] / before[:, None]
    weight = before * (len(y) - before) / len(y)
    k = int((weight * (shift**2).sum(axis=1)).argmax())
    return k + 1, shift[k]
