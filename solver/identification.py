"""From measurements to joint stiffnesses with their evidence: the whole path of METHOD.md §2-§6."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from solver.estimate import Estimate, assemble
from solver.exceptions import NotObservableError, UnsupportedMethodError
from solver.identifiability import Exposure, Visibility
from solver.measurements import Measurements
from solver.methods import (
    CompletePose,
    DecoupledPartialPose,
    LengthOfLeastCondition,
    MethodAccumulator,
    PartialPose,
)
from solver.pose import refuse_unless_posed
from solver.prior import Prior
from solver.problem import Bounds
from solver.regressor import regressor_blocks
from solver.robot import Robot
from solver.wrist import WRIST_JOINTS, WRIST_TOLERANCE, Wrist, find_wrist

__all__ = ["Method", "Settings", "Weighting", "identify", "refuse_unsupported"]

Method = Literal["complete_pose", "partial_pose", "decoupled_partial_pose"]
Weighting = Literal["covariance", "characteristic_length", "uniform"]
Loss = Literal["squared", "huber"]


@dataclass(frozen=True, eq=False)
class Settings:
    """How to identify.

    Attributes:
        method: see METHOD.md §4.
        weighting: see METHOD.md §3; `characteristic_length` goes with the complete pose only.
        characteristic_length: [m]; None for the length of least condition number.
        bounds: on the compliances.
        confidence: level of the intervals, between 0 and 1.
        order: pairs (i, j) of joints with c_i ≤ c_j: joint i at least as stiff as joint j.
        prior: what is known of the compliances beforehand; with weighting by covariance only.
        loss: of the norm of each target's whitened residual.
        huber_threshold: for the loss `huber`, in units of sigma.
        complementary_stiffness: whether K_c is part of the model (METHOD.md §2).
    """

    method: Method
    weighting: Weighting
    bounds: Bounds
    characteristic_length: float | None = None
    confidence: float = 0.95
    order: tuple[tuple[int, int], ...] = ()
    prior: Prior | None = None
    loss: Loss = "squared"
    huber_threshold: float = 2.8
    complementary_stiffness: bool = False


def identify(robot: Robot, measurements: Measurements, settings: Settings) -> Estimate:
    """Identify the joint compliances.

    Args:
        robot: n joints.
        measurements: N observations.
        settings: method, weighting, bounds, confidence.

    Returns:
        The estimate, with a certificate of optimality.

    Raises:
        UnsupportedMethodError: the readings or the robot cannot support the method or weighting.
        NotObservableError: the readings determine no joint.
        MeasurementError: an array is not what it should be.
        SolverError: optimality could not be certified.
    """
    refuse_unsupported(robot, measurements, settings)
    length = _characteristic_length(robot, measurements, settings)
    method = _accumulator(robot, settings, length)
    exposure = Exposure(robot.joint_names)
    for block in regressor_blocks(robot, measurements):
        exposure.add(block)
        method.add(block)
    visibility = _visibility(exposure)
    fit = method.fit(visibility.null, settings.bounds)
    return assemble(
        fit,
        visibility,
        method.judged.rows,
        names=robot.joint_names,
        sigma=measurements.sigma,
        confidence=settings.confidence,
        bounds=settings.bounds,
        characteristic_length=length,
    )


def refuse_unsupported(robot: Robot, measurements: Measurements, settings: Settings) -> None:
    """Refuse what the readings or the robot cannot support, before any work is done.

    Args:
        robot: n joints.
        measurements: N observations.
        settings: what is asked for.

    Raises:
        UnsupportedMethodError: saying what is missing.
    """
    if settings.method != "partial_pose":
        refuse_unless_posed(measurements)
    if settings.method == "decoupled_partial_pose":
        spherical_wrist(robot)
    if settings.weighting == "characteristic_length" and settings.method != "complete_pose":
        raise UnsupportedMethodError(
            f"{settings.method} has no rotations to weigh against translations",
            where="weighting",
            remedy="use weighting covariance, or method complete_pose",
        )


def spherical_wrist(robot: Robot) -> Wrist:
    """The robot's wrist, which the decoupled method needs.

    Raises:
        UnsupportedMethodError: if the robot has none, with the miss distance.
    """
    wrist = find_wrist(robot)
    if wrist is None or robot.n == WRIST_JOINTS:
        raise UnsupportedMethodError(
            f"{robot.n} joints do not make an arm with a wrist of three axes that meet",
            where="method",
            remedy="use method partial_pose",
        )
    if not wrist.spherical:
        raise UnsupportedMethodError(
            f"the last three axes miss each other by {1e3 * wrist.miss_distance:.3g} mm, more than "
            f"{1e3 * WRIST_TOLERANCE:g} mm, so there is no wrist centre that stands still",
            where="method",
            remedy="use method partial_pose, or mend the robot's model",
        )
    return wrist


def _accumulator(robot: Robot, settings: Settings, length: float | None) -> MethodAccumulator:
    uniform = settings.weighting == "uniform"
    if settings.method == "partial_pose":
        return PartialPose(robot, uniform=uniform)
    if settings.method == "complete_pose":
        return CompletePose(robot, length=1.0 if uniform else length)
    return DecoupledPartialPose(robot, spherical_wrist(robot), uniform=uniform)


def _characteristic_length(robot: Robot, measurements: Measurements, settings: Settings) -> float | None:
    if settings.weighting != "characteristic_length" or settings.characteristic_length is not None:
        return settings.characteristic_length
    exposure, search = Exposure(robot.joint_names), LengthOfLeastCondition(robot)
    for block in regressor_blocks(robot, measurements):
        exposure.add(block)
        search.add(block)
    return search.length(_visibility(exposure).null)


def _visibility(exposure: Exposure) -> Visibility:
    visibility = exposure.visibility()
    if not exposure.anything_moved:
        raise NotObservableError(
            "no target moved at all, so nothing can be said of any joint",
            where="observations",
            remedy="check that the loaded readings were taken under load",
        )
    if visibility.null.all():
        reasons = "; ".join(str(reason).split(":")[0] for reason in visibility.reasons)
        raise NotObservableError(
            f"the readings determine no joint: {reasons}",
            where="observations",
            remedy="add loads that twist the joints, and targets away from their axes",
        )
    return visibility
