"""Fit of joint springs to deflections, by which mistakes of a set are judged."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.integrity.values import median
from jointstiff.solver.mechanics.block import RegressorBlock

_ALL: Final = slice(None)
_SAMPLE: Final = 2000
"""Greatest number of observations in a fit, enough to determine a few compliances and check all
observations."""
_NULL: Final = 1e-9
"""Norm of a column, relative to the largest, below which no load twists its joint."""
_RIDGE: Final = 1e-9
"""Regularisation, relative to unit columns, that keeps undetermined combinations of compliances near zero."""
_ROUNDS: Final = 8
UNEXPLAINED: Final = 0.5
"""Greatest unexplained share of the median deflection: joints explain 80 % of the deflection of a real robot,
and half by the worst published method."""


@dataclass(frozen=True, eq=False)
class Springs:
    """Fit of joint compliances to the deflections of N observations of T targets."""

    predicted: FloatArray  #: (N, T, 3) deflections [m]; zero where not read
    residual: FloatArray  #: (N, T, 3) measured less predicted [m]
    work: float  #: predicted work of the load, summed over the observations [J]; positive for springs
    parameter_count: int  #: number of joints that were fitted
    unexplained: float  #: median residual of an observation over its median deflection

    @property
    def by_all_rows(self) -> Springs:
        """The same fit, whose unexplained share is by root mean squares: some rows alone count, too."""
        size = float(np.linalg.norm(self.predicted + self.residual))
        return replace(self, unexplained=float(np.linalg.norm(self.residual)) / size if size else 0.0)

    @classmethod
    def fit(cls, block: RegressorBlock, rows: slice = _ALL, shift: int = 0) -> Springs:
        """Fit compliances of either sign to deflections, so that the sum of the residuals' lengths is least.

        The sum of lengths, not of squares, keeps a few mistaken rows from changing the fit.

        Args:
            block: regressor and deflections of the whole set.
            rows: rows whose deflections are fitted; the deflections of all rows are predicted.
            shift: number of rows by which readings are shifted: the deflections of row i are fitted with load
                and posture of row i + shift.
        """
        deflection, count = block.measurements.deflection, len(block.A)
        fitted_rows = np.arange(count)[rows]
        fitted_rows = fitted_rows[(fitted_rows + shift >= 0) & (fitted_rows + shift < count)]
        fitted_rows = fitted_rows[:: max(1, -(-len(fitted_rows) // _SAMPLE))]
        regressor_rows = block.A[fitted_rows + shift].reshape(len(fitted_rows), -1, block.A.shape[-1])
        compliance = _minimise_distances(
            regressor_rows, deflection[fitted_rows].reshape(len(fitted_rows), -1)
        )
        predicted = block.A @ compliance
        typical_deflection = median(compute_observation_norms(deflection))
        return cls(
            predicted=predicted,
            residual=deflection - predicted,
            work=float((block.torque**2).sum(axis=0) @ compliance),
            parameter_count=int(np.count_nonzero(compliance)),
            unexplained=float(median(compute_observation_norms(deflection - predicted)) / typical_deflection)
            if typical_deflection
            else 0.0,
        )


def _minimise_distances(A: FloatArray, d: FloatArray) -> FloatArray:
    """Return the compliances c (n,) that minimise Σ ‖d_i − A_i c‖ (iteratively reweighted least squares).

    Args:
        A: (K, m, n) regressors A_i.
        d: (K, m) deflections d_i [m].
    """
    norms = np.sqrt((A**2).sum(axis=(0, 1)))
    visible = np.flatnonzero(norms > _NULL * norms.max())
    compliance = np.zeros(A.shape[-1])
    if not len(visible):
        return compliance
    scaled = A[..., visible] / norms[visible]
    gram, moment = scaled.transpose(0, 2, 1) @ scaled, np.einsum("kij,ki->kj", scaled, d)
    weight, ridge = np.ones(len(d)), _RIDGE / len(d) * np.eye(len(visible))
    for _ in range(_ROUNDS):
        weighted_gram = np.einsum("k,kij->ij", weight, gram) / weight.sum()
        scaled_compliance = np.linalg.solve(weighted_gram + ridge, weight @ moment / weight.sum())
        distance = np.linalg.norm(d - scaled @ scaled_compliance, axis=1)
        weight = 1.0 / np.maximum(distance, max(1e-3 * median(distance), 1e-12))
    compliance[visible] = scaled_compliance / norms[visible]
    return compliance


def compute_observation_norms(rows: FloatArray) -> FloatArray:
    """Return the Euclidean norm (N,) of all components of each observation."""
    return np.asarray(np.linalg.norm(rows.reshape(len(rows), -1), axis=1))
