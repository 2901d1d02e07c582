"""Whether tracker and robot drift apart in the course of a day, as seen on the unloaded targets."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import special

from solver.finding import Finding, length_text
from solver.integrity.thresholds import FALSE_ALARM, MODEL_ALLOWANCE
from solver.integrity.view import View

__all__ = ["inspect_drift"]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

LEAST_ROWS: Final = 8
SMALLEST_DRIFT: Final = 1e-4
"""Over the whole set [m]: less is of no consequence to deflections, which are differences of minutes."""
_RANK: Final = 1e-10


def inspect_drift(view: View, good: BoolArray) -> Iterator[Finding]:
    """Fit a steady motion of the barycentre of the targets, beside what may be wrong of the model.

    Joint offsets and the barycentre's place on the flange are fitted together with it, so that postures that were
    measured in some order do not pass for a drift as far as those explain them. F-test of its three components.

    Args:
        view: of the set.
        good: (N,) rows whose angles and names are not in doubt.
    """
    measured = view.measured & good[:, None]
    most = measured.sum(axis=1).max()
    rows = np.flatnonzero((measured == measured[measured.sum(axis=1).argmax()]).all(axis=1))
    if most == 0 or len(rows) < LEAST_ROWS:
        return
    at, which = view.configurations, measured[rows[0]]
    mean = view.measurements.position[rows][:, which].mean(axis=1)
    place = view.places[rows][:, which].mean(axis=1)
    rotation = at.flange_rotation[rows]
    off = np.einsum("nij,nj->ni", rotation, place - np.median(place, axis=0))
    jacobian = at.jacobian_at(
        np.broadcast_to(mean[:, None], (len(at), 1, 3))
        if len(rows) == len(at)
        else _scattered(mean, rows, len(at))
    )[rows, 0]
    time = (rows - rows.mean()) / max(1, np.ptp(rows))
    nuisance = np.concatenate([jacobian, rotation], axis=2)
    motion = time[:, None, None] * np.eye(3)
    before = _least_squares(nuisance, off)
    after = _least_squares(np.concatenate([nuisance, motion], axis=2), off)
    freedom = 3 * len(rows) - nuisance.shape[2] - 3
    drift = after[1][-3:]
    ratio = (before[0] - after[0]) / 3.0 / (after[0] / freedom) / MODEL_ALLOWANCE**2
    chance = float(special.fdtrc(3.0, freedom, max(0.0, ratio)))
    if chance < FALSE_ALARM and np.linalg.norm(drift) > SMALLEST_DRIFT:
        yield Finding(
            "drift_in_time",
            None,
            f"in the course of the set the unloaded targets moved by {length_text(float(np.linalg.norm(drift)))} "
            f"beside the robot's model (x {length_text(drift[0])}, y {length_text(drift[1])}, z "
            f"{length_text(drift[2])}; probability by chance {chance:.1g})",
            "check the tracker's stand, warm-up and temperature; if the postures were measured in some order, "
            "it may be the model; deflections hold the drift only between their two readings",
        )


def _scattered(mean: FloatArray, rows: npt.NDArray[np.intp], count: int) -> FloatArray:
    """(N, 1, 3) the points of some rows in their places, zero in the others."""
    out = np.zeros((count, 1, 3))
    out[rows, 0] = mean
    return out


def _least_squares(A: FloatArray, b: FloatArray) -> tuple[float, FloatArray]:
    """Residual sum of squares and solution of ``A_n x = b_n``, (N, 3, p) and (N, 3)."""
    flat, right = A.reshape(-1, A.shape[2]), b.reshape(-1)
    unit = np.maximum(np.linalg.norm(flat, axis=0), 1e-300)
    flat = flat / unit
    x = np.linalg.pinv(flat.T @ flat, rcond=_RANK, hermitian=True) @ (flat.T @ right)
    return float(((right - flat @ x) ** 2).sum()), x / unit
