"""Drift between tracker and robot over a set, seen on the unloaded targets."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.finding import Finding, length_text
from jointstiff.solver.integrity.view import FALSE_ALARM, MODEL_ALLOWANCE, View

LEAST_ROWS: Final = 8
SMALLEST_DRIFT: Final = 1e-4
"""Least drift over the whole set [m]: less does not matter for deflections, differences within minutes."""
LEAST_FREEDOM: Final = 3
_RANK: Final = 1e-10
_EXACT: Final = 1e-18
"""Variance [m²] of exact readings: rounding is no drift."""


def inspect_drift(view: View, good: BoolArray) -> Iterator[Finding]:
    """Fit a steady motion of the barycentre of the targets, beside what may be wrong of the model.

    Joint offsets, the base's place and the barycentre's place on the flange are fitted together with it.
    F-test of its three components. Nothing is said where the postures themselves were measured in order.

    Args:
        view: of the set.
        good: (N,) rows whose angles and names are not in doubt.
    """
    measured = view.measured & good[:, None]
    most = measured.sum(axis=1).max()
    rows = np.flatnonzero((measured == measured[measured.sum(axis=1).argmax()]).all(axis=1))
    if most == 0 or len(rows) < LEAST_ROWS or view.in_order:
        return
    nuisance, off = _model_errors(view, rows, measured[rows[0]])
    freedom = 3 * len(rows) - nuisance.shape[2] - 3
    if freedom < LEAST_FREEDOM:
        return
    time = (rows - rows.mean()) / np.ptp(rows)
    motion = time[:, None, None] * np.eye(3)
    without, _ = _least_squares(nuisance, off)
    left, motions = _least_squares(np.concatenate([nuisance, motion], axis=2), off)
    ratio = (without - left) / 3.0 / max(left / freedom, _EXACT) / MODEL_ALLOWANCE**2
    chance = float(special.fdtrc(3.0, freedom, max(0.0, ratio)))
    drift, size = motions[-3:], float(np.linalg.norm(motions[-3:]))
    if chance < FALSE_ALARM and size > SMALLEST_DRIFT:
        yield Finding(
            "drift_in_time",
            None,
            f"over the whole set, the unloaded targets drifted by {length_text(size)} relative to the "
            f"robot's model (x {length_text(drift[0])}, y {length_text(drift[1])}, z "
            f"{length_text(drift[2])}; p = {chance:.1g})",
            "check the tracker's stand, warm-up and temperature; a deflection is affected only by "
            "drift between its two readings",
        )


def _model_errors(view: View, rows: IndexArray, which: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return regressors of model errors, and the barycentre's offset from its median place on the flange.

    Args:
        view: of the set.
        rows: (M,) of its observations, which measured the same targets.
        which: (T,) those targets.

    Returns:
        (M, 3, n + 6) motion of the barycentre for offsets of the joints, of its place on the flange and of
        the base; and (M, 3) the departures, axes of R0 [m].
    """
    at = view.configurations
    points = np.zeros((len(at), 1, 3))
    points[rows, 0] = view.measurements.position[rows][:, which].mean(axis=1)
    place = view.places[rows][:, which].mean(axis=1)
    rotation = at.flange_rotation[rows]
    off = np.einsum("nij,nj->ni", rotation, place - np.median(place, axis=0))
    base = np.broadcast_to(np.eye(3), rotation.shape)
    return np.concatenate([at.jacobian_at(points)[rows, 0], rotation, base], axis=2), off


def _least_squares(A: FloatArray, b: FloatArray) -> tuple[float, FloatArray]:
    """Residual sum of squares and solution of ``A_n x = b_n``, (N, 3, p) and (N, 3)."""
    flat, right = A.reshape(-1, A.shape[2]), b.reshape(-1)
    unit = np.maximum(np.linalg.norm(flat, axis=0), 1e-300)
    flat = flat / unit
    x = np.linalg.pinv(flat.T @ flat, rcond=_RANK, hermitian=True) @ (flat.T @ right)
    return float(((right - flat @ x) ** 2).sum()), x / unit
