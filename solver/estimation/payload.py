"""Check of the unit of forces: stiffness of a six-axis arm compared with its payload and reach.

Confused units scale all forces alike, so no reading shows the mistake. Makers build joints for the torque of
the payload at the reach, and therefore the ratio of stiffness to this torque differs little among arms.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.finding import AdvisedAction, Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.estimation.estimate import JointCompliance
from jointstiff.solver.mechanics.measurements import FORCE_UNITS, Measurements
from jointstiff.solver.mechanics.postures import measure_reach
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import figure


@dataclass(frozen=True)
class MeasuredArm:
    """Arm whose stiffness was measured with forces of known unit."""

    name: str
    payload: float  #: [kg]
    reach: float  #: of the wrist from axis 1 [m]
    stiffness: tuple[float, ...]  #: k2 to k6 [N·m/rad]

    def ratios(self) -> FloatArray:
        """Return the ratios (5,) of the stiffnesses k2 to k6 to the torque of payload and reach [rad⁻¹]."""
        return np.array(self.stiffness) / payload_torque(self.payload, self.reach)


MEASURED_ARMS: Final = (
    # Ambiehl, Garnier, Subrin, Furet, IROS 2017, Table II: decoupled partial pose, encoders inactive.
    MeasuredArm("KUKA KR 240", 240.0, 2.69, (3.2e6, 2.6e6, 0.42e6, 0.23e6, 0.089e6)),
    # Cable pulls of the repository breakthrough-surge-suppression-in-high-speed-robotic-drilling, commit
    # e5c2f79. It states no variant of the arm: 240 kg is the heaviest one of this reach.
    MeasuredArm("FANUC R-2000iC", 240.0, 2.687, (2.743e6, 2.070e6, 0.3592e6, 0.4442e6, 0.1380e6)),
)
"""Arms from which the plausible ratios are derived. There are only two."""
_PAST: Final = "omit a `payload` that is not known"
PLAUSIBLE_RATIOS: Final = (25.0, 400.0)
"""Plausible geometric mean of k2 to k6 over payload · g · reach [rad⁻¹]: a quarter and four times that of
the measured arms."""
LEAST_JOINTS: Final = 3
"""Number of the joints 2 to 6 that must be identified."""
_SIX: Final = 6
"""Number of joints; joint 1 is not compared, because it often sees no torque."""


def payload_torque(payload: float, reach: float) -> float:
    """Return payload · g · reach [N·m] of a payload [kg] and a reach [m]."""
    return payload * FORCE_UNITS["kgf"] * reach


def inspect_force_unit(
    robot: Robot, measurements: Measurements, joints: Sequence[JointCompliance]
) -> Iterator[Finding]:
    """Report stiffnesses that are implausible for the payload, as if forces had another unit than declared.

    Yield a finding for each unit that makes the stiffnesses plausible, the likeliest first; if no unit does,
    one finding without an action. Nothing is compared where the payload is unknown, the arm has
    other joints than six revolute ones, or fewer than `LEAST_JOINTS` of joints 2 to 6 are identified. If some
    of these joints are not identified, the means of the measured arms are those of the same joints.

    Args:
        robot: n joints.
        measurements: N observations, with the unit of force that was declared.
        joints: result for each joint, of a fit by joints alone.
    """
    if robot.payload is None or robot.n != _SIX or robot.prismatic.any() or not measurements.force.any():
        return
    stiffness_or_none = [
        joint.stiffness if joint.status == "identified" else None for joint in joints[1:_SIX]
    ]
    stiffness = np.array([np.nan if each is None else each for each in stiffness_or_none])
    has_stiffness = np.isfinite(stiffness)
    if has_stiffness.sum() < LEAST_JOINTS:
        return
    reach = measure_reach(robot)
    ratio = _geometric_mean(stiffness[has_stiffness]) / payload_torque(robot.payload, reach)
    ratios_of_arms = [_geometric_mean(arm.ratios()[has_stiffness]) for arm in MEASURED_ARMS]
    # The wrist is softer than joints 2 and 3, so the bounds move with the joints that are compared.
    usual_ratio = _geometric_mean(np.array(ratios_of_arms))
    shift = usual_ratio / _geometric_mean(np.array([arm.ratios() for arm in MEASURED_ARMS]))
    least, greatest = (shift * bound for bound in PLAUSIBLE_RATIOS)
    if least <= ratio <= greatest:
        return
    names = [joint.name for joint, is_known in zip(joints[1:_SIX], has_stiffness, strict=True) if is_known]
    joints_text = f"{names[0]} to {names[-1]}" if has_stiffness.all() else ", ".join(names)
    arms = [
        f"{figure(mean, '.3g')} ({arm.name})" for arm, mean in zip(MEASURED_ARMS, ratios_of_arms, strict=True)
    ]
    range_text = f"{figure(least, '.2g')} to {figure(greatest, '.2g')} rad⁻¹"
    message = (
        f"the geometric mean of the stiffnesses of {joints_text} over payload · g · reach "
        f"({figure(robot.payload)} kg, {figure(reach, '.3g')} m) is {figure(ratio, '.3g')} rad⁻¹; the only "
        f"two arms in our comparison have {' and '.join(arms)}, and {range_text} is plausible"
    )
    declared = measurements.force_unit
    newtons_of_declared = FORCE_UNITS["kgf" if declared == "kg" else declared]
    ratios = {unit: ratio * newtons / newtons_of_declared for unit, newtons in FORCE_UNITS.items()}
    plausible_units = [unit for unit in FORCE_UNITS if least <= ratios[unit] <= greatest]
    # The likeliest unit, whose ratio is nearest to the usual ratio, comes first.
    plausible_units.sort(key=lambda unit: abs(np.log(ratios[unit] / usual_ratio)))
    for number, unit in enumerate(plausible_units):
        comparison_text = (
            f"forces in {unit}, not in {declared} as declared, would give {figure(ratios[unit], '.3g')} rad⁻¹"
        )
        yield Finding(
            code="stiffness_against_payload",
            weight="use_with_care",
            message=f"{comparison_text}; {range_text} is plausible"
            if number
            else f"{message}; {comparison_text}",
            remedy=f"check in which unit the forces were read; if in {unit}, set `units.force` to {unit}; "
            f"{_PAST}",
            action=AdvisedAction.of("convert_units", unit=unit),
        )
    if not plausible_units:
        yield Finding(
            code="stiffness_against_payload",
            weight="use_with_care",
            message=f"{message}; no other unit of force would give that",
            remedy=f"check `units.force`, and the robot's `payload`; {_PAST}",
        )


def _geometric_mean(positive: FloatArray) -> float:
    """Return the geometric mean of positive numbers."""
    return float(np.exp(np.log(positive).mean()))
