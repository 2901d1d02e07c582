"""Ways to identify, what they say of each joint, and whether it is true."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.campaigns import default_robot
from benchmarks.designs import Design
from jointstiff.schemas.options import Method
from jointstiff.simulator import default_arm
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.convex.solution import Bounds
from jointstiff.solver.estimate import identify
from jointstiff.solver.evidence.estimate import Estimate, JointCompliance
from jointstiff.solver.fitting.method import Settings
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot

__all__ = ["CONFIDENCE", "METHODS", "Campaign", "Verdicts", "Way", "judge"]

Campaign = tuple[Design, Measurements]

CONFIDENCE = 0.95
METHODS: dict[str, Method] = {
    "complete pose": "complete_pose",
    "partial pose": "partial_pose",
    "decoupled": "decoupled_partial_pose",
}


@dataclass(frozen=True)
class Way:
    """One way to identify.

    Attributes:
        method: a key of `METHODS`; complete pose is weighted by covariance.
        complementary_stiffness: whether K_c is included.
        sigma_given: else it is estimated from the residuals.
    """

    method: str
    complementary_stiffness: bool = True
    sigma_given: bool = True

    def __str__(self) -> str:
        stiffness = "K_c included" if self.complementary_stiffness else "K_c neglected"
        return f"{self.method}, {stiffness}, sigma {'given' if self.sigma_given else 'estimated'}"

    def estimate(self, robot: Robot, measurements: Measurements) -> Estimate:
        """Identify with positive compliances."""
        settings = Settings(
            METHODS[self.method],
            "covariance",
            Bounds.positive(robot.n),
            confidence=CONFIDENCE,
            complementary_stiffness=self.complementary_stiffness,
        )
        if not self.sigma_given:
            measurements = replace(measurements, sigma=None)
        return identify(robot, measurements, settings)


@dataclass(frozen=True, eq=False)
class Verdicts:
    """Estimates of K campaigns of an arm of n joints, beside the truth.

    Attributes:
        truth: (K, n) compliances [rad/(N·m)].
        compliance: (K, n) estimates [rad/(N·m)].
        standard_uncertainty: (K, n) as reported [rad/(N·m)].
        interval: (K, n, 2) two-sided [rad/(N·m)].
        one_sided: (K, n, 2) at least, at most; each by itself [rad/(N·m)].
    """

    truth: FloatArray
    compliance: FloatArray
    standard_uncertainty: FloatArray
    interval: FloatArray
    one_sided: FloatArray

    @property
    def rigid(self) -> BoolArray:
        """(K, n) joints of no compliance at all."""
        rigid: BoolArray = self.truth == 0.0
        return rigid

    @property
    def covered(self) -> BoolArray:
        """(K, n) intervals that hold the truth; one that is not there, or NaN, does not."""
        held: BoolArray = (self.interval[..., 0] <= self.truth) & (self.truth <= self.interval[..., 1])
        return held

    @property
    def above(self) -> BoolArray:
        """(K, n) compliances as great as the one-sided bound says at least."""
        held: BoolArray = self.one_sided[..., 0] <= self.truth
        return held

    @property
    def below(self) -> BoolArray:
        """(K, n) joints as stiff as the one-sided bound says at least."""
        held: BoolArray = self.truth <= self.one_sided[..., 1]
        return held

    @property
    def unsound(self) -> int:
        """Return the number of values that are negative, NaN or infinite."""
        numbers = [self.compliance, self.standard_uncertainty, self.interval, self.one_sided]
        return sum(int((~(np.isfinite(array) & (array >= 0.0))).sum()) for array in numbers)


def judge(ways: Sequence[Way], campaigns: Iterable[Campaign]) -> dict[Way, Verdicts]:
    """Identify every campaign in every way; what is not observable is NaN."""
    robot = default_robot(default_arm())
    truth: list[FloatArray] = []
    found: dict[Way, list[list[tuple[float, ...]]]] = {way: [] for way in ways}
    for design, measurements in campaigns:
        truth.append(design.arm.compliances)
        for way in ways:
            found[way].append([_numbers(joint) for joint in way.estimate(robot, measurements).joints])
    numbers = {way: np.array(rows) for way, rows in found.items()}
    return {
        way: Verdicts(np.array(truth), each[..., 0], each[..., 1], each[..., 2:4], each[..., 4:])
        for way, each in numbers.items()
    }


def _numbers(joint: JointCompliance) -> tuple[float, ...]:
    """Return compliance, standard uncertainty, interval, and one-sided bounds."""
    nothing, bounds = float("nan"), joint.one_sided
    return (
        nothing if joint.compliance is None else joint.compliance,
        nothing if joint.standard_uncertainty is None else joint.standard_uncertainty,
        *(joint.compliance_interval or (nothing, nothing)),
        *((bounds.compliance_at_least, bounds.compliance_at_most) if bounds else (nothing, nothing)),
    )
