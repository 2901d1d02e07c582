"""Anomalies of a sweep: a tracker that was bumped, a position or a reading that is off.

Each suspicion is a hypothesis with columns of its own: from position s on, the tracker sees everything
displaced by one rigid motion; one position is displaced; one reading is. What a hypothesis would take
off the sum of squares, with the fit repeated (to first order) beside it, is tested by F against what it
would leave. That needs no sigma and blames no neighbour: a bump in the middle also spoils the readings
around it, but a bump explains them all with six numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.geometry.gauss_newton import LinearFit
from jointstiff.solver.geometry.sweeps.sweep import Sweep
from jointstiff.solver.robot.configuration import skew

AnomalyKind = Literal["bump", "position", "reading"]

FALSE_ALARM = 1e-6
"""Probability that a clean sweep gets any finding (significance level)."""

MOST_ANOMALIES = 5
"""Maximum number of findings of one sweep; with more, the whole sweep is wrong."""

_HIDDEN = 1e-8
"""Share of a hypothesis that remains in the residuals (squared), below which it cannot be told from the
fit."""

_CLEAR = 3.0
"""Number of standard uncertainties by which a component of a displacement must differ from zero to be
stated."""

_EDGE = 2  # a bump has at least two positions on either side; else it is one position


@dataclass(frozen=True, eq=False)
class Anomaly:
    """A suspicion about one sweep."""

    #: `bump` displaces all readings from `position` on, `position` those there, `reading` one
    kind: AnomalyKind
    position: int  #: index of the (first) position
    target: int | None  #: index of the target of a reading; None for the others
    #: (3,) estimated displacement of these readings, tracker's frame [m], without components that the fit
    #: could as well take for another axis or angle
    displacement: FloatArray
    probability: float  #: probability that chance alone does this to any of the hypotheses tested


@dataclass(frozen=True, eq=False)
class _Hypothesis:
    kind: AnomalyKind
    position: int
    target: int | None
    readings: BoolArray  # (K, T)


@dataclass(frozen=True, eq=False)
class _Test:
    log_probability: float  # log probability by chance, of this hypothesis alone
    displacement: FloatArray  # (3,)
    directions: FloatArray  # (columns of the hypothesis, rank), orthonormal once projected


@dataclass(frozen=True, eq=False)
class _Fit:
    """Explained part so far: an orthonormal basis (K, T, 3, p), and the residual (K, T, 3) normal to it."""

    basis: FloatArray
    residual: FloatArray
    dof: int

    def with_columns(self, columns: FloatArray) -> _Fit:
        """The fit beside further orthonormal columns (K, T, 3, rank), normal to the basis."""
        explained = np.einsum("ktip,kti->p", columns, self.residual)
        basis = np.concatenate([self.basis, columns], axis=-1)
        return _Fit(basis, self.residual - columns @ explained, self.dof - columns.shape[-1])


def find_anomalies(linear: LinearFit, sweep: Sweep, typical: float = 0.0) -> tuple[Anomaly, ...]:
    """Find what does not fit, one after the other, the likeliest first.

    Args:
        linear: the fit of the sweep at its minimum; rows are (K, T, 3) in order.
        sweep: its readings.
        typical: variance of a residual elsewhere, in the units of the fit's; smaller ones in this sweep are
            chance.

    Returns:
        At most `MOST_ANOMALIES`.
    """
    present = sweep.present
    points, weight = sweep.whitened()
    normal = linear.residual - linear.left @ (linear.left.T @ linear.residual)
    fit = _Fit(
        linear.left.reshape(*points.shape, -1),
        normal.reshape(points.shape),
        3 * int(present.sum()) - linear.rank,
    )
    count, targets = present.shape
    position, target = np.arange(count)[:, None], np.arange(targets)[None, :]
    hypotheses = [
        _Hypothesis("bump", s, None, present & (position >= s)) for s in range(_EDGE, count - _EDGE + 1)
    ]
    for k in range(count):
        if present[k].sum() > 1:
            hypotheses.append(_Hypothesis("position", k, None, present & (position == k)))
        hypotheses.extend(
            _Hypothesis("reading", k, int(t), present & (position == k) & (target == t))
            for t in np.flatnonzero(present[k])
        )
    anomalies: list[Anomaly] = []
    while hypotheses and len(anomalies) < MOST_ANOMALIES:
        tests = [_test(h, fit, weight, points, typical) for h in hypotheses]
        best = min(range(len(tests)), key=lambda index: tests[index].log_probability)
        log_probability = tests[best].log_probability + np.log(len(tests))
        if log_probability > np.log(FALSE_ALARM):
            break
        h = hypotheses.pop(best)
        displacement = tests[best].displacement
        anomalies.append(Anomaly(h.kind, h.position, h.target, displacement, float(np.exp(log_probability))))
        # orthonormal columns (K, T, 3, rank) of the hypothesis, normal to the fit's basis
        test = tests[best]
        raw = np.zeros((*points.shape, test.directions.shape[1]))
        raw[h.readings] = _columns(h, weight, points) @ test.directions
        fit = fit.with_columns(raw - fit.basis @ np.einsum("ktip,ktiq->pq", fit.basis, raw))
    return tuple(anomalies)


def _columns(h: _Hypothesis, weight: FloatArray, points: FloatArray) -> FloatArray:
    """Whitened displacement of the hypothesis's M readings by its motion (M, 3, 3 or 6).

    A translation, for positions with a rotation about the readings' mean, in units of their spread, too.
    """
    W = weight[h.readings]
    if h.kind == "reading":
        return W
    arms = points[h.readings] - points[h.readings].mean(axis=0)
    spread = max(float(np.sqrt(np.mean(arms**2))), 1e-9)
    return np.concatenate([W, -W @ skew(arms) / spread], axis=-1)


def _test(h: _Hypothesis, fit: _Fit, weight: FloatArray, points: FloatArray, typical: float) -> _Test:
    """F-test of a hypothesis by its normal equations, which only its own readings enter."""
    columns = _columns(h, weight, points)
    seen = np.einsum("mip,miq->pq", fit.basis[h.readings], columns)
    square = np.einsum("mip,miq->pq", columns, columns)
    values, vectors = np.linalg.eigh(square - seen.T @ seen)
    kept = values > _HIDDEN * np.trace(square)
    directions = vectors[:, kept] / np.sqrt(values[kept])
    explained = directions.T @ np.einsum("mip,mi->p", columns, fit.residual[h.readings])
    rank, left = int(kept.sum()), fit.dof - int(kept.sum())
    if rank == 0 or left < 1:
        return _Test(0.0, np.zeros(3), directions)
    gain = float(explained @ explained)
    remaining = max(float(np.sum(fit.residual**2)) - gain, 1e-300)
    variance = max(remaining / left, typical)
    probability = float(
        special.fdtrc(rank, left, gain / rank / variance)
    )  # stats.f takes fifty times as long
    log_probability = math.log(probability) if probability > 0.0 else -math.inf
    return _Test(log_probability, _translation(h, fit, weight, variance), directions)


def _translation(h: _Hypothesis, fit: _Fit, weight: FloatArray, variance: float) -> FloatArray:
    """Displacement (3,) of the hypothesis's readings by a translation, of what stands out from noise only."""
    W, residual, basis = weight[h.readings], fit.residual[h.readings], fit.basis[h.readings]
    seen = np.einsum("mip,miq->pq", basis, W)
    square = np.einsum("mip,miq->pq", W, W)
    values, vectors = np.linalg.eigh(square - seen.T @ seen)
    explained = vectors.T @ np.einsum("mip,mi->p", W, residual)
    clear = (values > _HIDDEN * np.trace(square)) & (explained**2 > _CLEAR**2 * variance * values)
    return np.asarray(vectors[:, clear] @ (explained[clear] / values[clear]))
