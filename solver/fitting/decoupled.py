"""The decoupled partial pose: the arm from the wrist centre, then the wrist (method.md §4; the paper)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.constraints import Constraints
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fitting.fit import Fit
from jointstiff.solver.fitting.prior import PriorRows
from jointstiff.solver.fitting.stage import StageFit, combined, encoder_moment, fit_stage, solved
from jointstiff.solver.observability.identifiability import Excitation
from jointstiff.solver.regression.pose import fit_displacement
from jointstiff.solver.regression.regressor import RegressorBlock
from jointstiff.solver.regression.stage_rows import (
    Stage,
    encoder_readings,
    target_readings,
    wrist_centre_readings,
)
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.wrist import WRIST_JOINTS, Wrist


class DecoupledPartialPose:
    """The arm from the displacement of P_wrist, then the wrist from what is left at the targets."""

    def __init__(self, robot: Robot, wrist: Wrist, *, uniform: bool) -> None:
        self._arm_joints = robot.n - WRIST_JOINTS
        self._order = np.roll(np.arange(robot.n), WRIST_JOINTS)  # the wrist first, then the arm
        self._centre = wrist.centre
        self._names = robot.joint_names
        self._seen_from_centre = Excitation(robot.joint_names)
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
        # The arm's encoders to the first stage, the wrist's to the second: no reading is used twice. Their
        # noise is their own, so they add nothing to the covariance between the stages' readings.
        joints = np.arange(len(self._order))
        own, last = joints[: self._arm_joints], joints[self._arm_joints :]
        self.judged.add_encoders(block, joints, joints)
        self._arm.add_encoders(block, own, own)
        self._targets.add_encoders(block, last, self._order)
        # Covariance between the readings of both stages, weighted: A_wᵀ Ω₂ Σ Eᵀ Ω₁ A_a.
        if self._uniform:
            left = targets.spread(np.ones(3))[..., :WRIST_JOINTS]
            right = arm.influence
        else:
            left = targets.whitened()[..., :WRIST_JOINTS]
            right = arm.whitener.transpose(0, 2, 1) @ (arm.whitener @ arm.A)
        met = carried @ left.reshape(len(block.torque), -1, WRIST_JOINTS)
        self._cross += met.reshape(-1, WRIST_JOINTS).T @ right.reshape(-1, self._arm_joints)

    def responses(
        self, blocks: Sequence[RegressorBlock], joints: IndexArray, prior: PriorRows | None = None
    ) -> FloatArray:
        """Return the sums of other readings; see `jointstiff.solver.fitting.methods.MethodAccumulator`."""
        out = np.zeros((len(self._order), len(blocks)))
        arm, wrist = joints[joints < self._arm_joints], joints[joints >= self._arm_joints]
        first, second, own = self._arm, self._targets, np.arange(self._arm_joints)
        if len(arm):
            moments = []
            for block in blocks:
                centre, *_ = wrist_centre_readings(block, fit_displacement(block), self._centre)
                moments.append(first.moment(centre.select(own)) + encoder_moment(first, block, own))
            out[arm] = solved(first, np.transpose(moments), arm, arm, prior)
        if len(wrist):
            columns, R = wrist - self._arm_joints, second.rows.matrix
            moments = []
            for block in blocks:
                encoders = encoder_readings(block, self._order[:WRIST_JOINTS])
                read = second.moment(None if encoders is None else encoders.select(self._order))
                moments.append(read + second.moment(target_readings(block).select(self._order)))
            moment = np.transpose(moments)
            moment[columns] -= R[:, columns].T @ (R[:, WRIST_JOINTS + arm] @ out[arm])
            out[wrist] = solved(second, moment, columns, wrist, prior)
        return out

    def fit(self, null: BoolArray, constraints: Constraints, prior: PriorRows | None = None) -> Fit:
        """Solve both stages; see `jointstiff.solver.fitting.methods.MethodAccumulator`.

        To the second stage the arm's compliances are known: an order between a joint of the arm and one of
        the wrist is a constraint on both to the likelihood, but here a bound on the wrist alone.

        Raises:
            RequestError: if such a bound leaves a wrist joint no room.
            UnsupportedMethodError: if the wrist centre does not show an arm joint that the targets see, or
                determines arm joints only in combination, so that the arm's share of the targets'
                deflection is unknown.
        """
        n = len(null)
        visible = np.flatnonzero(~null)
        arm, wrist = visible[visible < self._arm_joints], visible[visible >= self._arm_joints]
        unseen = arm[self._seen_from_centre.observability().null[arm]]
        if len(unseen):
            raise UnsupportedMethodError(
                f"the wrist centre does not move when {', '.join(self._names[j] for j in unseen)} turns, so "
                "its displacement does not show the compliance of that joint",
                where="method",
                remedy="use method partial_pose",
            )
        R, z = self._arm.rows.matrix[:, arm], self._arm.rows.rhs
        first = fit_stage(R, z, arm, constraints.select(arm), prior, n)
        if first and first.undetermined:
            joints = sorted(j for group in first.undetermined for j in group.joints)
            raise UnsupportedMethodError(
                "the displacement of the wrist centre determines only a combination of "
                f"{', '.join(self._names[j] for j in joints)}, so the arm's share of the deflection is "
                "unknown",
                where="method",
                remedy="use method partial_pose, or add postures and load directions",
            )
        R, z = self._targets.rows.matrix, self._targets.rows.rhs
        known, free = np.zeros(len(arm)), np.zeros(len(arm))
        if first:
            known, free = first.solution.compliance, first.unconstrained
        by_arm, by_wrist = R[:, WRIST_JOINTS + arm], R[:, wrist - self._arm_joints]
        remaining = constraints.given(arm, known, wrist)
        second = fit_stage(by_wrist, z - by_arm @ known, wrist, remaining, prior, n)
        centre = np.zeros(n)
        centre[arm] = free
        if second:
            centre[wrist] = second.unconstrained_given(z - by_arm @ free)
        stages = [stage for stage in (first, second) if stage]
        return combined(n, stages, centre, self._covariance(first, second, n))

    def _covariance(self, arm: StageFit | None, wrist: StageFit | None, n: int) -> FloatArray:
        """Exact covariance of both stages: ĉ = H d, hence H Σ Hᵀ (method.md §4).

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

    def _add_leak(self, covariance: FloatArray, arm: StageFit, wrist: StageFit) -> None:
        """Add what the wrist inherits from the arm."""
        columns, inverse = wrist.joints - self._arm_joints, wrist.spectrum.inverse
        rows = self._targets.rows.matrix[:, WRIST_JOINTS + arm.joints]
        leak = inverse[:, : len(rows)] @ rows  # L A_a; what a prior says of the wrist leaks nothing
        shared = (inverse @ inverse.T) @ self._cross[np.ix_(columns, arm.joints)]
        shared = shared @ (arm.spectrum.inverse @ arm.spectrum.inverse.T)  # cov(L d, ĉ_a)
        arm_covariance = covariance[np.ix_(arm.joints, arm.joints)]
        both = shared @ leak.T
        covariance[np.ix_(wrist.joints, wrist.joints)] += leak @ arm_covariance @ leak.T - both - both.T
        covariance[np.ix_(wrist.joints, arm.joints)] = shared - leak @ arm_covariance
        covariance[np.ix_(arm.joints, wrist.joints)] = covariance[np.ix_(wrist.joints, arm.joints)].T
