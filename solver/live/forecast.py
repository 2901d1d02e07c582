"""Forecast of the uncertainty after further readings, as the fit of these readings will have it.

The fit estimates stated and assumed errors, such as a load point that is assumed to 10 mm, together with the
compliances (method.md §8). The fit then uses only what distinguishes a compliance from these errors, so that
a reading reduces the uncertainty by less than its information on the compliances alone suggests.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.design.optimum import AOptimality, compute_uncertainties
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.statements import Statements
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.terms import DRIFT, list_stated_terms


@dataclass(frozen=True, eq=False)
class FittedErrorColumns:
    """Columns of the K errors that the fit of a live campaign estimates with the compliances."""

    robot: Robot
    statements: Statements  #: the errors with their standard uncertainties
    assumed: BoolArray  #: (K,) mask of the errors whose uncertainty is assumed, not stated

    @classmethod
    def from_readings(
        cls, robot: Robot, readings: Measurements, compliance: FloatArray
    ) -> FittedErrorColumns:
        """List the errors of the readings so far.

        Args:
            robot: n joints.
            readings: readings so far.
            compliance: (n,) compliances, at which columns are computed [rad/(N·m)]; NaN if unknown.
        """
        # A drift is hardly known from one unloaded state, and its columns need the order of later readings.
        terms = tuple(term for term in list_stated_terms(readings) if term is not DRIFT)
        common, known = readings.common_uncertainty, np.nan_to_num(compliance)
        widths = Rows(robot, readings[:1]).stack(terms, known).widths
        assumed = np.array([name in common.assumed for name in widths], dtype=np.bool_)
        # The statements only scale columns, for which sigma does not matter.
        statements = Statements(terms, common, known, sigma=1.0)
        return cls(robot, statements, np.repeat(assumed, list(widths.values())))

    def build(self, measurements: Measurements, sigma: float) -> FloatArray:
        """Build the columns (m, K) of readings, for errors of one standard uncertainty, in units of sigma.

        `sigma` is the standard uncertainty of a coordinate of a reading [m].
        """
        of_blocks = self.statements.generate(Rows(self.robot, measurements))
        columns = [of_block.targets[..., :-1] for of_block in of_blocks]
        return np.concatenate([each.reshape(-1, each.shape[-1]) for each in columns]) / sigma


@dataclass(frozen=True, eq=False)
class Forecast:
    """Information of readings on p parameters, and on K errors that the fit estimates with them."""

    M: FloatArray  #: (p, p) information on the parameters
    cross: FloatArray  #: (p, K) information that parameters and errors share
    errors: FloatArray  #: (K, K) information on the errors, in units of their standard uncertainties
    #: (K,) mask of the errors that are assumed: a goal does not count their contribution to the uncertainty
    assumed: BoolArray

    @classmethod
    def begin(cls, M: FloatArray, assumed: BoolArray) -> Forecast:
        """Return the forecast before any reading, with what is known of the parameters, M (p, p)."""
        count = len(assumed)
        return cls(M, np.zeros((len(M), count)), np.eye(count), assumed)

    def add(self, rows: FloatArray, columns: FloatArray) -> Forecast:
        """Return the forecast with further readings.

        Args:
            rows: (m, p) rows of the parameters, in units of sigma.
            columns: (m, K) columns of the errors, in units of sigma.
        """
        return replace(
            self,
            M=self.M + rows.T @ rows,
            cross=self.cross + rows.T @ columns,
            errors=self.errors + columns.T @ columns,
        )

    @property
    def _whole(self) -> FloatArray:
        """(p + K, p + K) information on the parameters and the errors."""
        return np.block([[self.M, self.cross], [self.cross.T, self.errors]])

    def _compute_responses(self) -> FloatArray:
        """Return the changes (p, K') of the parameters by one standard uncertainty of each assumed error."""
        p = len(self.M)
        return np.asarray(np.linalg.inv(self._whole)[:p, p:][:, self.assumed])

    def uncertainties(self, count: int) -> FloatArray:
        """Return the standard uncertainties (count,) of the first parameters that a goal counts.

        The uncertainty of a parameter that is not determined is inf.
        """
        variances = np.square(compute_uncertainties(self._whole, count))
        if self.assumed.any() and np.isfinite(variances).all():
            variances = variances - np.square(self._compute_responses()[:count]).sum(axis=1)
        return np.sqrt(np.maximum(variances, 0.0))

    def weighted_variance(self, weights: FloatArray) -> float:
        """Return the weighted sum of variances tr(W C) that a goal counts; inf if it is not determined.

        `weights` (p, p) is W; C is the covariance of the parameters.
        """
        p = len(self.M)
        padded = np.zeros_like(self._whole)
        padded[:p, :p] = weights
        information = AOptimality(padded).information(self._whole)
        if not information > 0.0:
            return float("inf")
        if not np.isfinite(compute_uncertainties(self._whole, p)).all():
            return float(1.0 / information)
        responses = self._compute_responses()
        return float(max(1.0 / information - (responses * (weights @ responses)).sum(), 0.0))
