"""The three methods of the paper as accumulators of rows, and the fits they end in (METHOD.md §4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from solver.characteristic_length import least_condition_length
from solver.compression import Compression
from solver.exceptions import UnsupportedMethodError
from solver.identifiability import Exposure, Identifiability, Spectrum, analyse
from solver.pose import fit_displacement
from solver.problem import Bounds, IdentificationProblem
from solver.readings import (
    Stage,
    pose_readings,
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
        self._names = robot.joint_names
        self._seen_from_centre = Exposure(robot.joint_names)
        weight = np.ones(3) if uniform else None
        self.judged = Stage(robot.n, None)
        self._arm = Stage(self._arm_joints, weight)
        self._targets = Stage(robot.n, weight)
        self._uniform = uniform
        self._cross: FloatArray = np.zeros((WRIST_JOINTS, self._arm_joints))

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations with at least three targets each."""
        centre, carried, jacobian = wrist_centre_readings(block, fit_displacement(block), self._centre)
        self._seen_from_centre.add_seen_from(block, jacobian, np.ones((len(jacobian), 1), dtype=bool))
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
            UnsupportedMethodError: if the wrist centre does not show an arm joint that the targets see, or
                determines arm joints only in combination, so that the arm's share of the targets'
                deflection is unknown.
        """
        n = len(null)
        visible = np.flatnonzero(~null)
        arm, wrist = visible[visible < self._arm_joints], visible[visible >= self._arm_joints]
        _refuse_unseen_arm(arm[self._seen_from_centre.visibility().null[arm]], self._names)
        first = _fit_stage(self._arm.rows.matrix[:, arm], self._arm.rows.rhs, arm, bounds, n)
        _refuse_undetermined_arm(first, self._names)
        R, z = self._targets.rows.matrix, self._targets.rows.rhs
        explained = R[:, WRIST_JOINTS + arm] @ first.solution.compliance if first else 0.0
        second = _fit_stage(R[:, wrist - self._arm_joints], z - explained, wrist, bounds, n)
        return _combined(n, [stage for stage in (first, second) if stage], self._covariance(first, second, n))

    def _covariance(self, arm: _StageFit | None, wrist: _StageFit | None, n: int) -> FloatArray:
        """Exact covariance of both stages: ĉ = H d, hence H Σ Hᵀ (METHOD.md §4).

        With ĉ_w = L (d − A_a ĉ_a) it is, for the wrist, L Σ Lᵀ less the correlation of the two
        stages, plus L A_a cov(ĉ_a) (L A_a)ᵀ.
        """
        covariance = np.zeros((n, n))
        if arm:
            covariance[np.ix_(arm.joints, arm.joints)] = self._arm.covariance(
                arm.joints, arm.spectrum.inverse
            )
        if wrist:
            columns, inverse = wrist.joints - self._arm_joints, wrist.spectrum.inverse
            covariance[np.ix_(wrist.joints, wrist.joints)] = self._targets.covariance(columns, inverse)
        if arm and wrist:
            self._add_leak(covariance, arm, wrist)
        return covariance

    def _add_leak(self, covariance: FloatArray, arm: _StageFit, wrist: _StageFit) -> None:
        """Add what the wrist inherits from the arm."""
        columns, inverse = wrist.joints - self._arm_joints, wrist.spectrum.inverse
        leak = inverse @ self._targets.rows.matrix[:, WRIST_JOINTS + arm.joints]  # L A_a
        shared = (inverse @ inverse.T) @ self._cross[np.ix_(columns, arm.joints)]
        shared = shared @ (arm.spectrum.inverse @ arm.spectrum.inverse.T)  # cov(L d, ĉ_a)
        arm_covariance = covariance[np.ix_(arm.joints, arm.joints)]
        both = shared @ leak.T
        covariance[np.ix_(wrist.joints, wrist.joints)] += leak @ arm_covariance @ leak.T - both - both.T
        covariance[np.ix_(wrist.joints, arm.joints)] = shared - leak @ arm_covariance
        covariance[np.ix_(arm.joints, wrist.joints)] = covariance[np.ix_(wrist.joints, arm.joints)].T


@dataclass(frozen=True, eq=False)
class _StageFit:
    """One stage solved: `joints` (p,) are those of its columns."""

    joints: npt.NDArray[np.intp]
    spectrum: Spectrum
    analysis: Identifiability
    solution: Solution


def _fit_stage(
    R: FloatArray, z: FloatArray, joints: npt.NDArray[np.intp], bounds: Bounds, n: int
) -> _StageFit | None:
    """Solve for the given joints; None if there are none."""
    if not len(joints):
        return None
    spectrum = Spectrum(R)
    solution = solve(IdentificationProblem(spectrum.determined, z, bounds.select(joints)))
    return _StageFit(joints, spectrum, analyse(spectrum, joints, n), solution)


def _combined(n: int, stages: list[_StageFit], covariance: FloatArray) -> Fit:
    compliance, active = np.zeros(n), np.zeros(n, dtype=np.int8)
    for stage in stages:
        compliance[stage.joints] = stage.solution.compliance
        active[stage.joints] = stage.solution.active
    return Fit(
        compliance,
        active,
        covariance,
        tuple(stage.analysis for stage in stages),
        tuple(stage.solution.certificate for stage in stages),
    )


def _single_stage_fit(rows: Stage, null: BoolArray, bounds: Bounds) -> Fit:
    joints = np.flatnonzero(~null)
    stage = _fit_stage(rows.rows.matrix[:, joints], rows.rows.rhs, joints, bounds, len(null))
    covariance = np.zeros((len(null), len(null)))
    if stage:
        covariance[np.ix_(joints, joints)] = rows.covariance(joints, stage.spectrum.inverse)
    return _combined(len(null), [stage] if stage else [], covariance)


def _refuse_undetermined_arm(arm: _StageFit | None, names: tuple[str, ...]) -> None:
    if arm and arm.analysis.combinations:
        joints = ", ".join(names[j] for j in sorted(arm.analysis.combined))
        raise UnsupportedMethodError(
            f"the wrist centre determines {joints} only together, so the arm's share of the "
            "deflection is unknown",
            where="method",
            remedy="use method partial_pose, or add postures and load directions",
        )


def _refuse_unseen_arm(unseen: npt.NDArray[np.intp], names: tuple[str, ...]) -> None:
    if len(unseen):
        joints = ", ".join(names[j] for j in unseen)
        raise UnsupportedMethodError(
            f"the wrist centre does not move when {joints} turns, so it cannot show how that joint bends",
            where="method",
            remedy="use method partial_pose",
        )
