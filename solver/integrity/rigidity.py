"""Targets on a flange keep their distances; one that does not was bumped, and stays where it was put."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.finding import Finding, length_text
from jointstiff.solver.integrity.repeats import SAME_ANGLE
from jointstiff.solver.integrity.view import (
    MODEL_ALLOWANCE,
    View,
    length_scale,
    median,
    normal_quantile,
    vector_quantile,
    vector_scale,
)

LEAST_SIGMA: Final = 1e-6
"""Standard uncertainty of a reading [m] that is assumed where none is stated and the distances show less."""
OVERSTATED: Final = 2.0
"""Scatter of distances relative to the stated noise above which it is reported."""
_ENOUGH: Final = 30
_ORDERED: Final = 2.0
"""Factor on a step where postures were measured in order: the model's errors then look like steps."""
_CLEARER: Final = 4.0
"""Ratio of the sums of squares above which another target is no explanation."""
LEAST_ROWS: Final = 4
SMALLEST_STEP: Final = 1e-4
"""Least displacement of a target, and least change of one of its distances, that is reported [m]."""


@dataclass(frozen=True)
class Step:
    """A lasting displacement of one target."""

    target: int  #: index of the target
    row: int  #: the first observation in which it sits elsewhere
    size: float  #: size of the displacement [m]
    ratio: float  #: ratio of the displacement to what chance allows


@dataclass(frozen=True, eq=False)
class _Edges:
    """Distances of P pairs of targets in both states of N observations."""

    first: IndexArray  #: (P,) one target of each pair
    second: IndexArray  #: (P,) the other
    both: BoolArray  #: (N, P) whether both were measured
    #: (2, N, P) distance less its median [m], unloaded and loaded; zero where not measured
    change: FloatArray
    sigma: FloatArray  #: (N, P) standard uncertainty of a distance as stated [m]; zero where nothing is

    def limits(self) -> FloatArray:
        """(N, P) changes beyond which it is not noise [m]: as stated, or as the distances scatter."""
        comparisons = 2 * int(self.both.sum())
        stated = normal_quantile(comparisons) * self.sigma
        scatter = (
            MODEL_ALLOWANCE * normal_quantile(comparisons) * max(np.sqrt(2.0) * LEAST_SIGMA, self.scatter)
        )
        limits: FloatArray = (
            np.maximum(stated, scatter) if not self.sigma.any() else np.maximum(stated, 0.5 * scatter)
        )
        return limits

    @property
    def scatter(self) -> float:
        """Standard deviation of a distance by medians [m]."""
        return length_scale(np.abs(self.change[:, self.both]))


def inspect_rigidity(view: View, good: BoolArray) -> Iterator[Finding]:
    """Look for targets that moved on the flange.

    Args:
        view: of the set.
        good: (N,) rows whose angles and names are not in doubt.
    """
    measured = view.measured & good[:, None]
    places = np.where(measured[..., None], view.places, np.nan)
    step = find_step(places, view.measurements.joints, allowance=_ORDERED if view.in_order else 1.0)
    if step is not None:
        yield Finding(
            "target_moved",
            step.row,
            f"from here on, '{view.targets[step.target]}' is displaced by {length_text(step.size)} on "
            f"the flange, relative to the other targets; {step.ratio:.3g} times the limit for chance",
            "check that the target is attached firmly; treat it as another target from here on "
            "(another name), or repeat",
            "error",
        )
    edges = _edges(view, measured, step)
    if edges is None:
        return
    yield from _understated(edges)
    limits = edges.limits()
    worst = np.abs(edges.change).max(axis=0)
    for i in np.flatnonzero((worst > limits).any(axis=1)):
        row, own_limits = int(i), limits[i]
        change = np.abs(edges.change[:, row]).max(axis=0)
        p = int((change / np.where(own_limits > 0.0, own_limits, np.inf)).argmax())
        state = "loaded" if abs(edges.change[1, row, p]) > abs(edges.change[0, row, p]) else "unloaded"
        # The target that leaves the least change to the others, and those that do nearly as well
        squares = (edges.change[:, row] ** 2).sum(axis=0)
        present = np.unique(np.concatenate([edges.first[edges.both[row]], edges.second[edges.both[row]]]))
        left = np.array([squares[(edges.first != t) & (edges.second != t)].sum() for t in present])
        least = left.min() + (edges.scatter + 1e-9) ** 2
        suspects = [int(t) for t in present[left <= _CLEARER * least]]
        who = " or ".join(f"'{view.targets[t]}'" for t in suspects)
        yield Finding(
            "targets_not_rigid",
            row,
            f"the distance between '{view.targets[edges.first[p]]}' and "
            f"'{view.targets[edges.second[p]]}' ({state}) differs by {length_text(change[p])} from its "
            f"median (limit {length_text(own_limits[p])}): {who} moved",
            f"check {who} for a bump, a turned reflector or a wrong name; repeat the observation, or remove "
            "that reading",
            "error",
        )


def _edges(view: View, measured: BoolArray, step: Step | None) -> _Edges | None:
    """Distances; those to a target that moved are compared with others of the same side of the step."""
    first, second = np.triu_indices(measured.shape[1], k=1)
    usable = (measured[:, first] & measured[:, second]).any(axis=0)
    first, second = first[usable], second[usable]
    if not len(first):
        return None
    m = view.measurements
    both = measured[:, first] & measured[:, second]
    states = (m.position, m.position + m.deflection)
    lengths = np.stack([np.linalg.norm(s[:, first] - s[:, second], axis=2) for s in states])
    change = _less_median(lengths, both)
    if step is not None:
        touched = (first == step.target) | (second == step.target)
        for side in (slice(None, step.row), slice(step.row, None)):
            change[:, side, touched] = _less_median(lengths[:, side, touched], both[side, touched])
    sigma = np.hypot(view.reading_sigma[:, first], view.reading_sigma[:, second])
    return _Edges(first, second, both, change, np.where(both, sigma, 0.0))


def _less_median(lengths: FloatArray, both: BoolArray) -> FloatArray:
    """(2, N, P) each distance less the median of its pair; zero where not measured."""
    if both.all():
        out: FloatArray = lengths - np.median(lengths, axis=(0, 1))
        return out
    out = np.zeros(lengths.shape)
    for p in np.flatnonzero(both.any(axis=0)):
        out[:, both[:, p], p] = lengths[:, both[:, p], p] - np.median(lengths[:, both[:, p], p])
    return out


def _understated(edges: _Edges) -> Iterator[Finding]:
    typical = median(edges.sigma[edges.both])
    if typical == 0.0 or edges.both.sum() < _ENOUGH or edges.scatter < OVERSTATED * typical:
        return
    yield Finding(
        "sigma_suspect",
        None,
        f"distances between targets scatter by {length_text(edges.scatter)}, but the stated noise "
        f"gives {length_text(typical)}",
        "check the stated noise and its unit; or omit `noise` so that sigma is estimated from the residuals",
    )


def find_step(places: FloatArray, joints: FloatArray, allowance: float = 1.0) -> Step | None:
    """Find the most significant lasting displacement of a target beside the barycentre of the others.

    The others take away what the model has wrong of the flange's position; what it has wrong of its
    direction, a fraction of a millimetre on the targets' triangle, varies with the posture and is part of the
    scatter. The scale is that of the changes from row to row, by their median, which a single step does not
    touch, or that of the rows about the means of both sides, whichever is greater. The model's error of the
    flange's direction moves a target beside the others, too, but changes no distance: a step needs a distance
    that changed by `SMALLEST_STEP`. And it needs two postures on each side, as one may be off the model.

    Args:
        places: (N, T, 3) in the flange frame [m]; nan where a target was not measured.
        joints: (N, n) angles [rad].
        allowance: factor on what chance allows.

    Returns:
        None if there is none beyond chance.
    """
    read = ~np.isnan(places[..., 0])
    together = read.sum(axis=1)
    if len(places) < LEAST_ROWS or together.max() < 2:
        return None
    filled = np.where(read[..., None], places, 0.0)
    rows_of = [np.flatnonzero(own & (together == together.max())) for own in read.T]
    series = [
        (t, rows, filled[rows, t] - (filled[rows].sum(axis=1) - filled[rows, t]) / (together.max() - 1))
        for t, rows in enumerate(rows_of)
        if len(rows) >= LEAST_ROWS
    ]
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
        if not ratio > (best.ratio if best else 1.0):
            continue
        if min(_postures(joints[rows[:k]]), _postures(joints[rows[k:]])) < 2:
            continue
        lengths = np.linalg.norm(np.delete(places[rows], t, axis=1) - places[rows, t, None], axis=2)
        lengths = lengths[:, ~np.isnan(lengths).any(axis=0)]
        change = np.abs(np.median(lengths[k:], axis=0) - np.median(lengths[:k], axis=0))
        if change.max(initial=0.0) > SMALLEST_STEP:
            best = Step(t, int(rows[k]), size, ratio)
    return best


def _split(y: FloatArray) -> tuple[int, FloatArray]:
    """Return the number of rows (M, 3) before the most significant step, and the step (3,)."""
    before = np.arange(1, len(y))
    sums = np.cumsum(y, axis=0)
    shift = (sums[-1] - sums[:-1]) / (len(y) - before)[:, None] - sums[:-1] / before[:, None]
    weight = before * (len(y) - before) / len(y)
    k = int((weight * (shift**2).sum(axis=1)).argmax())
    return k + 1, shift[k]


def _postures(joints: FloatArray) -> int:
    return len(np.unique(np.round(joints / SAME_ANGLE), axis=0))
