"""The same posture measured again: what the readings themselves say of their noise."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.finding import Finding, length_text
from jointstiff.solver.integrity.view import FALSE_ALARM, View

SAME_ANGLE: Final = 1e-5
"""Tolerance of angles [rad] of the same posture: 20 µm at 2 m."""


def inspect_repeats(view: View) -> Iterator[Finding]:
    """Pool the scatter of repeated deflections and of repeated unloaded positions."""
    m = view.measurements
    posture = np.round(m.joints / SAME_ANGLE)
    groups = _groups(posture)
    if groups is None:
        return
    load = np.concatenate([m.force, m.moment, m.load_point], axis=1)
    along = np.zeros((len(m), 0)) if m.direction is None else np.round(m.direction.reshape(len(m), -1), 4)
    alike = _groups(np.concatenate([posture, load, m.present, along], axis=1))
    if alike is not None:
        yield from _deflections(view, alike)
    placed = _groups(np.concatenate([posture, view.measured], axis=1))
    if placed is not None and view.measured.any():
        yield from _positions(view, placed)


def _deflections(view: View, group: IndexArray) -> Iterator[Finding]:
    """Repeated deflections hold the tracker's noise alone: where the robot stands cancels."""
    m = view.measurements
    squares, freedom, count = _scatter(m.deflection, m.coordinates, group)
    if not freedom or not squares:
        return
    sigma = float(np.sqrt(squares / freedom / 2.0))
    stated, worse = "no noise is stated", False
    if m.sigma is not None:
        stated = f"the stated sigma is {length_text(m.sigma)}"
        worse = float(special.chdtrc(freedom, squares / (2.0 * m.sigma**2))) < FALSE_ALARM
    yield Finding(
        "repeated_readings",
        None,
        f"{count} observations repeat the posture and load of others; their deflections give sigma "
        f"= {length_text(sigma)} ({freedom} degrees of freedom), and {stated}",
        "state a noise that agrees with the repetitions, and find the cause of the scatter between them"
        if worse
        else "keep the repetitions in the set: they are used like all other observations",
        "warning" if worse else "note",
    )


def _positions(view: View, group: IndexArray) -> Iterator[Finding]:
    squares, freedom, count = _scatter(view.measurements.position, 3 * view.measured, group)
    if not freedom or not squares:
        return
    yield Finding(
        "repeated_readings",
        None,
        f"in {count} repeated postures the unloaded targets scatter by "
        f"{length_text(float(np.sqrt(squares / freedom)))} per coordinate ({freedom} degrees of "
        "freedom): tracker and robot together",
        "compare with the stated noise: the excess is the repeatability of the robot",
        "note",
    )


def _groups(keys: FloatArray) -> IndexArray | None:
    """(N,) number of the group of equal keys (N, k); None if all differ."""
    first: dict[bytes, int] = {}
    group = [first.setdefault(row.tobytes(), i) for i, row in enumerate(keys + 0.0)]
    return np.array(group) if len(first) < len(group) else None


def _scatter(values: FloatArray, coordinates: IndexArray, group: IndexArray) -> tuple[float, int, int]:
    """Sum of squares about the groups' means, its degrees of freedom, and how many rows repeat others."""
    squares, freedom, count = 0.0, 0, 0
    numbers, sizes = np.unique(group, return_counts=True)
    for number in numbers[sizes > 1]:
        rows = np.flatnonzero(group == number)
        some = values[rows][:, coordinates[rows[0]] > 0]
        squares += float(((some - some.mean(axis=0)) ** 2).sum())
        freedom += (len(rows) - 1) * int(coordinates[rows[0]].sum())
        count += len(rows) - 1
    return squares, freedom, count
