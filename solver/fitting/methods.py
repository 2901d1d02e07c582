"""Interface of all methods, and the two that solve one problem for all joints (method.md §4).

The characteristic length is the baseline that the paper compares with (method.md §3).
"""

from __future__ import annotations

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
from jointstiff.solver.regression.stage_rows import Stage, pose_readings, target_readings
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

    def response(
        self, block: RegressorBlock, joints: IndexArray, prior: PriorRows | None = None
    ) -> FloatArray:
        """Return what other readings would have added to the estimate, bounds apart: the estimator is linear.

        Args:
            block: observations that were taken in, with other deflections.
            joints: (p,) which compliances are estimated.
            prior: as in the fit.

        Returns:
            (n,) [rad/(N·m)]; zero for the other joints.
        """

    def fit(self, null: BoolArray, constraints: Constraints, prior: PriorRows | None = None) -> Fit:
        """Solve, leaving out the null columns.

        Args:
            null: (n,) joints that the readings do not see.
            constraints: on all n compliances.
            prior: of the n compliances, in units of sigma; with weighting by covariance only.
        """


class PartialPose:
    """Three rows a target, positions only."""

    def __init__(self, robot: Robot, *, uniform: bool) -> None:
        self.judged = Stage(robot.n, None)
        self._stage = Stage(robot.n, np.ones(3)) if uniform else self.judged
        self._joints = np.arange(robot.n)

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations."""
        readings = target_readings(block)
        self.judged.add(readings)
        self.judged.add_encoders(block, self._joints, self._joints)
        if self._stage is not self.judged:  # weighted otherwise, which encoders cannot be
            self._stage.add(readings)

    def response(
        self, block: RegressorBlock, joints: IndexArray, prior: PriorRows | None = None
    ) -> FloatArray:
        """Return what other readings would have added; see `MethodAccumulator`."""
        moment = self._stage.moment(target_readings(block))
        moment += encoder_moment(self._stage, block, self._joints)
        out = np.zeros(len(moment))
        out[joints] = solved(self._stage, moment, joints, joints, prior)
        return out

    def fit(self, null: BoolArray, constraints: Constraints, prior: PriorRows | None = None) -> Fit:
        """Solve; see `MethodAccumulator`."""
        return single_stage_fit(self._stage, null, constraints, prior)


class CompletePose:
    """Six rows a configuration: displacement of the targets' barycentre, and rotation.

    `length` divides the translations; None weights by the covariance of the displacement instead.
    """

    def __init__(self, robot: Robot, *, length: float | None) -> None:
        weight = None if length is None else np.repeat([1.0 / length, 1.0], 3)
        self.judged = Stage(robot.n, None)
        self._stage = Stage(robot.n, weight)
        self._joints = np.arange(robot.n)

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations with at least three targets each."""
        self.judged.add(target_readings(block))
        self._stage.add(pose_readings(block, fit_displacement(block)))
        for stage in (self.judged, self._stage):
            stage.add_encoders(block, self._joints, self._joints)

    def response(
        self, block: RegressorBlock, joints: IndexArray, prior: PriorRows | None = None
    ) -> FloatArray:
        """Return what other readings would have added; see `MethodAccumulator`."""
        moment = self._stage.moment(pose_readings(block, fit_displacement(block)))
        moment += encoder_moment(self._stage, block, self._joints)
        out = np.zeros(len(moment))
        out[joints] = solved(self._stage, moment, joints, joints, prior)
        return out

    def fit(self, null: BoolArray, constraints: Constraints, prior: PriorRows | None = None) -> Fit:
        """Solve; see `MethodAccumulator`."""
        return single_stage_fit(self._stage, null, constraints, prior)


class LengthOfLeastCondition:
    """First pass of the complete pose when the characteristic length is not given."""

    def __init__(self, robot: Robot) -> None:
        self._linear, self._angular = Compression(robot.n), Compression(robot.n)

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations with at least three targets each."""
        rows = pose_readings(block, fit_displacement(block)).A
        self._linear.add(rows[:, :3])
        self._angular.add(rows[:, 3:])

    def length(self, null: BoolArray) -> float:
        """The length [m], over the joints that the readings see."""
        return least_condition_length(self._linear.triangle[:, ~null], self._angular.triangle[:, ~null])
