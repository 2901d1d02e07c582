"""The rows of all targets one by one, which a robust loss needs: nothing of them is compressed."""

from __future__ import annotations

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.regression.compression import Compression
from jointstiff.solver.regression.regressor import RegressorBlock
from jointstiff.solver.regression.stage_rows import Stage, target_readings


class TargetRows:
    """The whitened rows of all targets: 24 (n + 1) bytes a reading."""

    def __init__(self, parameters: int) -> None:
        self._joints = np.arange(parameters)
        self._rows: list[FloatArray] = []
        self._present: list[BoolArray] = []
        self._squared = Stage(parameters, None)

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations, with their encoders, whose loss stays squared."""
        present = block.measurements.present
        self._rows.append(target_readings(block).whitened()[present.ravel()])
        self._present.append(present)
        self._squared.add_encoders(block, self._joints, self._joints)

    @property
    def rows(self) -> FloatArray:
        """(K, 3, n + 1) [A d] of the K readings, in units of sigma."""
        return np.concatenate(self._rows)

    @property
    def present(self) -> BoolArray:
        """(N, T) which targets were read: where the K readings belong."""
        return np.concatenate(self._present)

    @property
    def squared(self) -> Compression:
        """Compressed rows [A d] of squared loss."""
        return self._squared.rows

    def chi_square(self, compliance: FloatArray, *, sigma: float, threshold: float) -> float:
        """Chi-square of an estimate, each target's residual cut at the threshold so that none decides it.

        ``Σ min(‖r‖/σ, k)² / b``, with ``3 b = E[min(t, k)²]`` and t the norm of three standard normal
        coordinates, so that its expectation for good readings is that of the plain chi-square.

        Args:
            compliance: (n,) [rad/(N·m)].
            sigma: [m].
            threshold: k, in units of sigma.
        """
        norm = np.linalg.norm(self.rows[..., -1] - self.rows[..., :-1] @ compliance, axis=1) / sigma
        half = 0.5 * threshold**2
        share = special.gammainc(2.5, half) + threshold**2 / 3.0 * special.gammaincc(1.5, half)
        squared = (self.squared.matrix @ compliance - self.squared.rhs) / sigma
        return float(np.sum(np.minimum(norm, threshold) ** 2) / share + squared @ squared)
