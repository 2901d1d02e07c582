"""The three methods of the paper as accumulators of rows, and the fits they end in (METHOD.md §4)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from solver.characteristic_length import least_condition_length
from solver.combination import Combination
from solver.compression import Compression
from solver.constraints import Constraints
from solver.exceptions import UnsupportedMethodError
from solver.identifiability import Exposure, Identifiability, Spectrum, analyse
from solver.likelihood import Likelihood, rows_of
from solver.pose import fit_displacement
from solver.prior import PriorRows
from solver.problem import IdentificationProblem
from solver.readings import (
    Stage,
    encoder_readings,
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
        tied: (n,) joints whose compliance an order makes equal to another's.
        covariance: (n, n) of the unconstrained estimate in units of sigma²; zero for null columns.
        likelihood: of the compliances that the readings see, before any constraint.
        parameters: how many the readings were asked for: the rank, less what a prior answered instead.
        undetermined: groups of joints that neither the readings nor a prior tell apart.
        identifiability: of each stage, by the readings alone.
        certificates: of each stage.
        alone: where a prior takes part, the fit of the readings alone.
    """

    compliance: FloatArray
    active: npt.NDArray[np.int8]
    tied: BoolArray
    covariance: FloatArray
    likelihood: Likelihood
    parameters: float
    undetermined: tuple[Combination, ...]
    identifiability: tuple[Identifiability, ...]
    certificates: tuple[Certificate, ...]
    alone: Fit | None = None

    def inflated(self, factor: float) -> Fit:
        """The same estimate, its variance greater by a factor."""
        if factor == 1.0:
            return self
        return replace(
            self, covariance=factor * self.covariance, likelihood=self.likelihood.inflated(factor)
        )


class MethodAccumulator(Protocol):
    """What each method offers: take in blocks, then fit.

    Attributes:
        judged: the rows of all targets, weighted by covariance. Whatever a method fits, it is judged on
            these: residuals, sigma and degrees of freedom are those of the same readings.
    """

    judged: Stage

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations."""

    def response(
        self, block: RegressorBlock, joints: npt.NDArray[np.intp], prior: PriorRows | None = None
    ) -> FloatArray:
        """What other readings would have added to the estimate, bounds apart: the estimator is linear.

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
        self, block: RegressorBlock, joints: npt.NDArray[np.intp], prior: PriorRows | None = None
    ) -> FloatArray:
        """What other readings would have added; see `MethodAccumulator`."""
        moment = self._stage.moment(target_readings(block))
        moment += _encoder_moment(self._stage, block, self._joints)
        out = np.zeros(len(moment))
        out[joints] = _solved(self._stage, moment, joints, joints, prior)
        return out

    def fit(self, null: BoolArray, constraints: Constraints, prior: PriorRows | None = None) -> Fit:
        """Solve; see `MethodAccumulator`."""
        return _single_stage_fit(self._stage, null, constraints, prior)


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
        self, block: RegressorBlock, joints: npt.NDArray[np.intp], prior: PriorRows | None = None
    ) -> FloatArray:
        """What other readings would have added; see `MethodAccumulator`."""
        moment = self._stage.moment(pose_readings(block, fit_displacement(block)))
        moment += _encoder_moment(self._stage, block, self._joints)
        out = np.zeros(len(moment))
        out[joints] = _solved(self._stage, moment, joints, joints, prior)
        return out

    def fit(self, null: BoolArray, constraints: Constraints, prior: PriorRows | None = None) -> Fit:
        """Solve; see `MethodAccumulator`."""
        return _single_stage_fit(self._stage, null, constraints, prior)


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
        self._add_encoders(block)
        # Covariance between the readings of both stages, weighted: A_wᵀ Ω₂ Σ Eᵀ Ω₁ A_a.
        if self._uniform:
            left = targets.spread(np.ones(3))[..., :WRIST_JOINTS]
            right = arm.influence
        else:
            left = targets.whitened()[..., :WRIST_JOINTS]
            right = arm.whitener.transpose(0, 2, 1) @ (arm.whitener @ arm.A)
        met = carried @ left.reshape(len(block.torque), -1, WRIST_JOINTS)
        self._cross += met.reshape(-1, WRIST_JOINTS).T @ right.reshape(-1, self._arm_joints)

    def _add_encoders(self, block: RegressorBlock) -> None:
        """The arm's encoders to the first stage, the wrist's to the second: no reading is used twice.

        Their noise is their own, so they add nothing to the covariance between the stages' readings.
        """
        joints = np.arange(len(self._order))
        arm, wrist = joints[: self._arm_joints], joints[self._arm_joints :]
        self.judged.add_encoders(block, joints, joints)
        self._arm.add_encoders(block, arm, arm)
        self._targets.add_encoders(block, wrist, self._order)

    def response(
        self, block: RegressorBlock, joints: npt.NDArray[np.intp], prior: PriorRows | None = None
    ) -> FloatArray:
        """What other readings would have added; see `MethodAccumulator`."""
        out = np.zeros(len(self._order))
        arm, wrist = joints[joints < self._arm_joints], joints[joints >= self._arm_joints]
        first, second = self._arm, self._targets
        if len(arm):
            centre, *_ = wrist_centre_readings(block, fit_displacement(block), self._centre)
            moment = first.moment(centre.select(np.arange(self._arm_joints)))
            moment += _encoder_moment(first, block, np.arange(self._arm_joints))
            out[arm] = _solved(first, moment, arm, arm, prior)
        if len(wrist):
            columns, R = wrist - self._arm_joints, second.rows.matrix
            moment = second.moment(target_readings(block).select(self._order))
            encoders = encoder_readings(block, self._order[:WRIST_JOINTS])
            moment += second.moment(None if encoders is None else encoders.select(self._order))
            explained = R[:, columns].T @ (R[:, WRIST_JOINTS + arm] @ out[arm])
            moment[columns] -= explained
            out[wrist] = _solved(second, moment, columns, wrist, prior)
        return out

    def fit(self, null: BoolArray, constraints: Constraints, prior: PriorRows | None = None) -> Fit:
        """Solve both stages; see `MethodAccumulator`.

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
        _refuse_unseen_arm(arm[self._seen_from_centre.visibility().null[arm]], self._names)
        R, z = self._arm.rows.matrix[:, arm], self._arm.rows.rhs
        first = _fit_stage(R, z, arm, constraints.select(arm), prior, n)
        _refuse_undetermined_arm(first, self._names)
        R, z = self._targets.rows.matrix, self._targets.rows.rhs
        known, free = np.zeros(len(arm)), np.zeros(len(arm))
        if first:
            known, free = first.solution.compliance, first.unconstrained
        by_arm, by_wrist = R[:, WRIST_JOINTS + arm], R[:, wrist - self._arm_joints]
        told = constraints.given(arm, known, wrist)
        second = _fit_stage(by_wrist, z - by_arm @ known, wrist, told, prior, n)
        centre = np.zeros(n)
        centre[arm] = free
        if second:
            centre[wrist] = second.unconstrained_given(z - by_arm @ free)
        stages = [stage for stage in (first, second) if stage]
        return _combined(n, stages, centre, self._covariance(first, second, n))

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
        rows = self._targets.rows.matrix[:, WRIST_JOINTS + arm.joints]
        leak = inverse[:, : len(rows)] @ rows  # L A_a; what a prior says of the wrist leaks nothing
        shared = (inverse @ inverse.T) @ self._cross[np.ix_(columns, arm.joints)]
        shared = shared @ (arm.spectrum.inverse @ arm.spectrum.inverse.T)  # cov(L d, ĉ_a)
        arm_covariance = covariance[np.ix_(arm.joints, arm.joints)]
        both = shared @ leak.T
        covariance[np.ix_(wrist.joints, wrist.joints)] += leak @ arm_covariance @ leak.T - both - both.T
        covariance[np.ix_(wrist.joints, arm.joints)] = shared - leak @ arm_covariance
        covariance[np.ix_(arm.joints, wrist.joints)] = covariance[np.ix_(wrist.joints, arm.joints)].T


@dataclass(frozen=True, eq=False)
class _StageFit:
    """One stage solved.

    Attributes:
        joints: (p,) of its columns.
        spectrum: of its rows, with those of the prior.
        analysis: of its rows, the readings' alone.
        undetermined: what neither readings nor prior tell apart.
        parameters: how many the readings were asked for.
        prior: (k,) right-hand side of the prior's rows, which come last.
        rhs: (m,) right-hand side of the readings' rows.
        solution: under the constraints.
        tied: (p,) whether an order holds it.
    """

    joints: npt.NDArray[np.intp]
    spectrum: Spectrum
    analysis: Identifiability
    undetermined: tuple[Combination, ...]
    parameters: float
    prior: FloatArray
    rhs: FloatArray
    solution: Solution
    tied: BoolArray

    @property
    def unconstrained(self) -> FloatArray:
        """(p,) the estimate without constraints; where it is not unique, one of them."""
        return self.unconstrained_given(self.rhs)

    def unconstrained_given(self, rhs: FloatArray) -> FloatArray:
        """(p,) the estimate without constraints had the readings been others (m,)."""
        if not self.solution.constrained and np.array_equal(rhs, self.rhs):
            return self.solution.compliance
        estimate: FloatArray = self.spectrum.inverse @ np.concatenate([rhs, self.prior])
        return estimate


def _fit_stage(
    R: FloatArray,
    z: FloatArray,
    joints: npt.NDArray[np.intp],
    constraints: Constraints,
    prior: PriorRows | None,
    n: int,
) -> _StageFit | None:
    """Solve for the given joints, on which the constraints are; None if there are none."""
    if not len(joints):
        return None
    readings = spectrum = Spectrum(R)
    analysis = analyse(readings, joints, n)
    undetermined, parameters, known = analysis.combinations, float(readings.rank), np.zeros(0)
    if prior is not None:
        rows, known = prior.select(joints)
        spectrum = Spectrum(np.vstack([R, rows]))
        undetermined = analyse(spectrum, joints, n).combinations
        parameters = float(np.sum(spectrum.inverse[:, : len(R)].T * R))
    solution = solve(
        IdentificationProblem(
            spectrum.determined,
            np.concatenate([z, known]),
            constraints.bounds,
            constraints.inequalities,
        )
    )
    tied = np.zeros(len(joints), dtype=np.bool_)
    if solution.tight is not None:
        level = constraints.level(solution.compliance, solution.tight)
        solution = replace(solution, compliance=level)
        tied[np.array(constraints.order)[solution.tight].ravel()] = True
    return _StageFit(joints, spectrum, analysis, undetermined, parameters, known, z, solution, tied)


def _combined(
    n: int,
    stages: list[_StageFit],
    centre: FloatArray,
    covariance: FloatArray,
    rows: FloatArray | None = None,
) -> Fit:
    """The fit of all n joints.

    Args:
        n: number of joints.
        stages: of the method.
        centre: (n,) the unconstrained estimate.
        covariance: (n, n) its covariance.
        rows: (k, p) of the likelihood over all joints of the stages, where the stage's own are.
    """
    compliance, active, tied = np.zeros(n), np.zeros(n, dtype=np.int8), np.zeros(n, dtype=np.bool_)
    for stage in stages:
        tied[stage.joints] = stage.tied
        compliance[stage.joints] = stage.solution.compliance
        active[stage.joints] = stage.solution.active
    joints = np.concatenate([stage.joints for stage in stages]) if stages else np.zeros(0, dtype=np.intp)
    part = covariance[np.ix_(joints, joints)]
    undetermined = tuple(group for stage in stages for group in stage.undetermined)
    if rows is None and undetermined:
        rows = _determined_rows(stages, part)
    return Fit(
        compliance,
        active,
        tied,
        covariance,
        Likelihood(joints, centre[joints], part, rows),
        sum(stage.parameters for stage in stages),
        undetermined,
        tuple(stage.analysis for stage in stages),
        tuple(stage.solution.certificate for stage in stages),
    )


def _determined_rows(stages: list[_StageFit], covariance: FloatArray) -> FloatArray:
    """Rows (r, p) of the likelihood where the stages determine r combinations of p compliances only."""
    blocks = [stage.spectrum.seen for stage in stages]
    seen = np.zeros((sum(len(block) for block in blocks), covariance.shape[0]))
    row = column = 0
    for block in blocks:
        seen[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return rows_of(seen @ covariance @ seen.T) @ seen


def _single_stage_fit(rows: Stage, null: BoolArray, constraints: Constraints, prior: PriorRows | None) -> Fit:
    n, joints = len(null), np.flatnonzero(~null)
    stage = _fit_stage(
        rows.rows.matrix[:, joints], rows.rows.rhs, joints, constraints.select(joints), prior, n
    )
    covariance, centre = np.zeros((n, n)), np.zeros(n)
    if stage is None:
        return _combined(n, [], centre, covariance)
    covariance[np.ix_(joints, joints)] = rows.covariance(joints, stage.spectrum.inverse)
    centre[joints] = stage.unconstrained
    own = stage.spectrum.determined if rows.by_covariance else None
    return _combined(n, [stage], centre, covariance, own)


def _solved(
    stage: Stage,
    moment: FloatArray,
    columns: npt.NDArray[np.intp],
    joints: npt.NDArray[np.intp],
    prior: PriorRows | None,
) -> FloatArray:
    """(p,) a stage's estimate of some joints in its columns, the others being known.

    Args:
        stage: with its readings.
        moment: AᵀΩ y over all columns, of other readings y.
        columns: (p,) of the stage.
        joints: (p,) in these columns.
        prior: as in the fit; the other readings change nothing in what it says.
    """
    if not len(columns):
        return np.zeros(0)
    rows = stage.rows.matrix[:, columns]
    inverse = Spectrum(rows if prior is None else np.vstack([rows, prior.select(joints)[0]])).inverse
    solved: FloatArray = inverse @ (inverse.T @ moment[columns])
    return solved


def _encoder_moment(stage: Stage, block: RegressorBlock, joints: npt.NDArray[np.intp]) -> FloatArray:
    """Of the encoders of the first joints, which are the stage's parameters."""
    readings = encoder_readings(block, joints)
    return stage.moment(None if readings is None else readings.select(joints))


def _refuse_undetermined_arm(arm: _StageFit | None, names: tuple[str, ...]) -> None:
    if arm and arm.undetermined:
        joints = ", ".join(names[j] for j in sorted(j for group in arm.undetermined for j in group.joints))
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
