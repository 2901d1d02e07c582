"""The three methods of the paper as accumulators of rows, and the fits they end in (METHOD.md §4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from solver.characteristic_length import least_condition_length
from solver.compression import Compression
from solver.exceptions import UnsupportedMethodError
from solver.identifiability import Identifiability, analyse
from solver.pose import fit_displacement
from solver.problem import Bounds, IdentificationProblem
from solver.readings import (
    Stage,
    pose_readings,
    scaled_inverse,
    target_readings,
    wrist_centre_readings,
)
from solver.regressor import RegressorBlock
from solver.robot import Robot
from solver.solve import Certificate, Solution, solve
from solver.wrist import WRIST_JOINTS, Wrist

__all__ = [
    "CompletePose",
    "DecoupledPartialPose",
    "Fit",
    "LengthOfLeastCondition",
    "MethodAccumulator",
    "PartialPose",
]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Fit:
    """The outcome of a method before sigma is known.

    Attributes:
        compliance: (n,) optimum [rad/(N·m)]; zero for null columns.
        active: (n,) -1 or 1 at a lower or upper bound, else 0.
        covariance: (n, n) of the unconstrained estimate in units of sigma²; zero for null columns.
        identifiability: of each stage.
        certificates: of each stage.
    """

    compliance: FloatArray
    active: npt.NDArray[np.int8]
    covariance: FloatArray
    identifiability: tuple[Identifiability, ...]
    certificates: tuple[Certificate, ...]


class MethodAccumulator(Protocol):
    """What each method offers: take in blocks, then fit.

    Attributes:
        judged: the rows of all targets, weighted by covariance. Whatever a method fits, it is judged on
            these: residuals, sigma and degrees of freedom are those of the same readings.
    """

    judged: Stage

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations."""

    def fit(self, null: BoolArray, bounds: Bounds) -> Fit:
        """Solve, leaving out the null columns.

        Args:
            null: (n,) joints that the readings do not see.
            bounds: on all n compliances.
        """


class PartialPose:
    """Three rows a target, positions only."""

    def __init__(self, robot: Robot, *, uniform: bool) -> None:
        self.judged = Stage(robot.n, None)
        self._stage = Stage(robot.n, np.ones(3)) if uniform else self.judged

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations."""
        readings = target_readings(block)
        self.judged.add(readings)
        if self._stage is not self.judged:
            self._stage.add(readings)

    def fit(self, null: BoolArray, bounds: Bounds) -> Fit:
        """Solve; see `MethodAccumulator`."""
        return _single_stage_fit(self._stage, null, bounds)


class CompletePose:
    """Six rows a configuration: displacement of the targets' barycentre, and rotation.

    `length` divides the translations; None weights by the covariance of the displacement instead.
    """

    def __init__(self, robot: Robot, *, length: float | None) -> None:
        weight = None if length is None else np.repeat([1.0 / length, 1.0], 3)
        self.judged = Stage(robot.n, None)
        self._stage = Stage(robot.n, weight)

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations with at least three targets each."""
        self.judged.add(target_readings(block))
        self._stage.add(pose_readings(block, fit_displacement(block)))

    def fit(self, null: BoolArray, bounds: Bounds) -> Fit:
        """Solve; see `MethodAccumulator`."""
        return _single_stage_fit(self._stage, null, bounds)


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


class DecoupledPartialPose:
    """The arm from the displacement of P_wrist, then the wrist from what is left at the targets."""

    def __init__(self, robot: Robot, wrist: Wrist, *, uniform: bool) -> None:
        self._arm_joints = robot.n - WRIST_JOINTS
        self._order = np.roll(np.arange(robot.n), WRIST_JOINTS)  # the wrist first, then the arm
        self._centre = wrist.centre
        weight = np.ones(3) if uniform else None
        self.judged = Stage(robot.n, None)
        self._arm = Stage(self._arm_joints, weight)
        self._targets = Stage(robot.n, weight)
        self._uniform = uniform
        self._cross: FloatArray = np.zeros((WRIST_JOINTS, self._arm_joints))

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations with at least three targets each."""
        centre, carried = wrist_centre_readings(block, fit_displacement(block), self._centre)
        readings = target_readings(block)
        self.judged.add(readings)
        arm = centre.select(np.arange(self._arm_joints))
        targets = readings.select(self._order)
        self._arm.add(arm)
        self._targets.add(targets)
        # Covariance between the readings of both stages, weighted: A_wᵀ Ω₂ Σ Eᵀ Ω₁ A_a.
        if self._uniform:
            left = targets.spread(np.ones(3))[..., :WRIST_JOINTS]
            right = arm.A
        else:
            left = targets.whitened()[..., :WRIST_JOINTS]
            right = arm.whitener.transpose(0, 2, 1) @ (arm.whitener @ arm.A)
        left = left.reshape(len(block.torque), -1, WRIST_JOINTS)
        self._cross += np.einsum("bkw,bik,bia->wa", left, carried, right, optimize=True)

    def fit(self, null: BoolArray, bounds: Bounds) -> Fit:
        """Solve both stages; see `MethodAccumulator`.

        Raises:
            UnsupportedMethodError: if the wrist centre determines the arm joints only in combination,
                so that the arm's share of the targets' deflection is unknown.
        """
        n = len(null)
        visible = np.flatnonzero(~null)
        arm, wrist = visible[visible < self._arm_joints], visible[visible >= self._arm_joints]
        compliance, active = np.zeros(n), np.zeros(n, dtype=np.int8)
        analyses, certificates = [], []
        R, z = self._targets.rows.matrix, self._targets.rows.rhs
        R_wrist, R_arm = R[:, wrist - self._arm_joints], R[:, WRIST_JOINTS + arm]
        if len(arm):
            arm_rows = self._arm.rows
            analyses.append(analyse(arm_rows.matrix[:, arm], arm, n))
            _refuse_undetermined_arm(analyses[-1])
            solution = _solve(arm_rows.matrix[:, arm], arm_rows.rhs, bounds.select(arm))
            compliance[arm], active[arm] = solution.compliance, solution.active
            certificates.append(solution.certificate)
        if len(wrist):
            analyses.append(analyse(R_wrist, wrist, n))
            solution = _solve(R_wrist, z - R_arm @ compliance[arm], bounds.select(wrist))
            compliance[wrist], active[wrist] = solution.compliance, solution.active
            certificates.append(solution.certificate)
        covariance = self._covariance(arm, wrist, n)
        return Fit(compliance, active, covariance, tuple(analyses), tuple(certificates))

    def _covariance(self, arm: npt.NDArray[np.intp], wrist: npt.NDArray[np.intp], n: int) -> FloatArray:
        """Exact covariance of both stages: ĉ = H d, hence H Σ Hᵀ (METHOD.md §4).

        With ĉ_w = L (d − A_a ĉ_a) it is, for the wrist, L Σ Lᵀ less the correlation of the two
        stages, plus L A_a cov(ĉ_a) (L A_a)ᵀ.
        """
        covariance = np.zeros((n, n))
        if len(arm):
            covariance[np.ix_(arm, arm)] = self._arm.covariance(arm)
        if not len(wrist):
            return covariance
        columns = wrist - self._arm_joints
        covariance[np.ix_(wrist, wrist)] = self._targets.covariance(columns)
        if not len(arm):
            return covariance
        R = self._targets.rows.matrix
        inverse = scaled_inverse(R[:, columns])
        arm_inverse = scaled_inverse(self._arm.rows.matrix[:, arm])
        leak = inverse @ R[:, WRIST_JOINTS + arm]  # L A_a
        shared = (inverse @ inverse.T) @ self._cross[np.ix_(columns, arm)]
        shared = shared @ (arm_inverse @ arm_inverse.T)  # cov(L d, ĉ_a)
        arm_covariance = covariance[np.ix_(arm, arm)]
        both = shared @ leak.T
        covariance[np.ix_(wrist, wrist)] += leak @ arm_covariance @ leak.T - both - both.T
        covariance[np.ix_(wrist, arm)] = shared - leak @ arm_covariance
        covariance[np.ix_(arm, wrist)] = covariance[np.ix_(wrist, arm)].T
        return covariance


def _refuse_undetermined_arm(analysis: Identifiability) -> None:
    if analysis.combinations:
        joints = ", ".join(f"joint {j + 1}" for j in sorted(analysis.combined))
        raise UnsupportedMethodError(
            f"the wrist centre determines {joints} only together, so the arm's share of the "
            "deflection is unknown",
            remedy="use method partial_pose, or add postures and load directions",
        )


def _single_stage_fit(stage: Stage, null: BoolArray, bounds: Bounds) -> Fit:
    columns = np.flatnonzero(~null)
    R = stage.rows.matrix[:, columns]
    solution = _solve(R, stage.rows.rhs, bounds.select(columns))
    compliance, active = np.zeros(len(null)), np.zeros(len(null), dtype=np.int8)
    covariance = np.zeros((len(null), len(null)))
    compliance[columns], active[columns] = solution.compliance, solution.active
    covariance[np.ix_(columns, columns)] = stage.covariance(columns)
    analysis = analyse(R, columns, len(null))
    return Fit(compliance, active, covariance, (analysis,), (solution.certificate,))


def _solve(R: FloatArray, z: FloatArray, bounds: Bounds) -> Solution:
    return solve(IdentificationProblem(R, z, bounds))
