"""Interface of all methods, and the two that solve one problem for all joints (method.md §4).

The characteristic length is the baseline that the paper compares with (method.md §3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.constraints import Constraints
from jointstiff.solver.fitting.fit import Fit
from jointstiff.solver.fitting.prior import PriorRows
from jointstiff.solver.fitting.stage import encoder_moment, single_stage_fit, solved
from jointstiff.solver.regression.compression import Compression
from jointstiff.solver.regression.pose import fit_displacement
from jointstiff.solver.regression.regressor import RegressorBlock
from jointstiff.solver.regression.stage_rows import DerivedReadings, Stage, pose_readings, target_readings
from jointstiff.solver.robot.model import Robot

_DECADES = (-3.0, 3.0)


def least_condition_length(linear: FloatArray, angular: FloatArray) -> float:
    """The length L that minimises the condition number of the rows [A_v / L; A_ω] (Khan & Angeles).

    Columns are brought to unit norm first, as for the solve: otherwise the spread of the torques
    between arm and wrist decides, and the least condition number lies at an infinite length.

    Args:
        linear: (k, p) compressed regressor of the translations [m/(rad/(N·m))].
        angular: (k, p) compressed regressor of the rotations [rad/(rad/(N·m))].

    Returns:
        L between 1 mm and 1 km [m].
    """
    from scipy.optimize import minimize_scalar  # takes a second to import, which few processes need

    def log_condition(decade: float) -> float:
        stacked = np.concatenate([linear / 10.0**decade, angular])
        singular = np.linalg.svd(stacked / np.linalg.norm(stacked, axis=0), compute_uv=False)
        return float(np.log(singular[0] / max(singular[-1], np.finfo(float).tiny)))

    # The condition number has several local minima where singular values cross: scan, then refine.
    grid = np.linspace(*_DECADES, 121)
    best = int(np.argmin([log_condition(decade) for decade in grid]))
    step = grid[1] - grid[0]
    refined = minimize_scalar(
        log_condition,
        bounds=(grid[best] - step, grid[best] + step),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return float(10.0 ** np.clip(refined.x, *_DECADES))


class MethodAccumulator(Protocol):
    """Interface of a method: add readings in blocks, then fit."""

    #: the rows of all targets, weighted by covariance. Whatever a method fits, it is judged on these:
    #: residuals, sigma and degrees of freedom are those of the same readings.
    judged: Stage

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations."""

    def responses(
        self, blocks: Sequence[RegressorBlock], joints: IndexArray, prior: PriorRows | None = None
    ) -> FloatArray:
        """Return what other readings would have added to the estimate, bounds apart: the estimator is linear.

        Args:
            blocks: observations that were taken in, k times with other deflections.
            joints: (p,) which compliances are estimated.
            prior: as in the fit.

        Returns:
            (n, k) [rad/(N·m)]; zero for the other joints.
        """

    def fit(self, null: BoolArray, constraints: Constraints, prior: PriorRows | None = None) -> Fit:
        """Solve, leaving out the null columns.

        Args:
            null: (n,) joints that the readings do not see.
            constraints: on all n compliances.
            prior: of the n compliances, in units of sigma; with weighting by covariance only.
        """


class OneStage:
    """A method of one problem: partial pose or complete pose."""

    def __init__(
        self,
        parameters: int,
        readings: Callable[[RegressorBlock], DerivedReadings],
        root_weight: FloatArray | None,
    ) -> None:
        """Start without observations.

        Args:
            parameters: number of joints.
            readings: `target_readings`, three rows a target, or `displacement_readings`, six a configuration.
            root_weight: of these rows; None weights by their covariance.
        """
        self.judged = Stage(parameters, None)
        alike = readings is target_readings and root_weight is None
        self._stage = self.judged if alike else Stage(parameters, root_weight)
        self._readings = readings
        self._joints = np.arange(parameters)

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations."""
        self.judged.add(target_readings(block))
        self.judged.add_encoders(block, self._joints, self._joints)
        if self._stage is not self.judged:
            self._stage.add(self._readings(block))
            self._stage.add_encoders(block, self._joints, self._joints)

    def responses(
        self, blocks: Sequence[RegressorBlock], joints: IndexArray, prior: PriorRows | None = None
    ) -> FloatArray:
        """Return what other readings would have added; see `MethodAccumulator`."""
        moments = [
            self._stage.moment(self._readings(block)) + encoder_moment(self._stage, block, self._joints)
            for block in blocks
        ]
        out = np.zeros((len(self._joints), len(blocks)))
        out[joints] = solved(self._stage, np.transpose(moments), joints, joints, prior)
        return out

    def fit(self, null: BoolArray, constraints: Constraints, prior: PriorRows | None = None) -> Fit:
        """Solve; see `MethodAccumulator`."""
        return single_stage_fit(self._stage, null, constraints, prior)


def displacement_readings(block: RegressorBlock) -> DerivedReadings:
    """Complete pose: displacement of the targets' barycentre, and rotation; three targets each."""
    return pose_readings(block, fit_displacement(block))


class LengthOfLeastCondition:
    """First pass of the complete pose when the characteristic length is not given."""

    def __init__(self, robot: Robot) -> None:
        self._linear, self._angular = Compression(robot.n), Compression(robot.n)

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations with at least three targets each."""
        rows = displacement_readings(block).A
        self._linear.add(rows[:, :3])
        self._angular.add(rows[:, 3:])

    def length(self, null: BoolArray) -> float:
        """The length [m], over the joints that the readings see."""
        return least_condition_length(self._linear.triangle[:, ~null], self._angular.triangle[:, ~null])
