"""Check of the unit of forces: stiffness of a six-axis arm compared with its payload and reach.

Confused units scale all forces alike, so no reading shows the mistake. Makers build joints for the torque of
the payload at the reach, and therefore the ratio of stiffness to this torque differs little among arms.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.finding import AdvisedAction, Finding
from jointstiff.schemas.measurement import ConfusedForceUnit, ForceUnit
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.fit.estimate import JointCompliance
from jointstiff.solver.mechanics.measurements import FORCE_UNITS, Measurements
from jointstiff.solver.mechanics.postures import measure_reach
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import PAST_CARE, figure


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


R_2000IC: Final = (2.743e6, 2.070e6, 0.3592e6, 0.4442e6, 0.1380e6)
"""Stiffnesses k2 to k6 [N·m/rad] of a FANUC R-2000iC, by cable pulls of the repository
breakthrough-surge-suppression-in-high-speed-robotic-drilling, commit e5c2f79."""
MEASURED_ARMS: Final = (
    MeasuredArm("FANUC R-2000iC/165F", 165.0, 2.655, R_2000IC),
    MeasuredArm("FANUC R-2000iC/210F", 210.0, 2.655, R_2000IC),
)
"""Arms from which the plausible ratios are derived: measured ones whose payload and reach the catalogue of
arms states. There is one, whose source names no variant; the catalogue has two with its kinematics."""
FACTOR: Final = 3.0
"""Factor on the mean ratio of the measured arms within which a ratio is plausible.

Its square, 9, is less than a kgf in N. Therefore no ratio is plausible both with forces in N and in kgf."""
LEAST_JOINTS: Final = 3
"""Number of the joints 2 to 6 that must be identified."""
_SIX: Final = 6
"""Number of joints; joint 1 is not compared, because it often sees no torque."""
_TYPED_UNITS: Final[tuple[ConfusedForceUnit, ...]] = ("N", "kgf", "lbf")
"""Units of force that people type; kN is so far from N that the forces themselves show it."""


_UNITS_OF_PAYLOADS: Final = {"N": 1.0 / FORCE_UNITS["kgf"], "g": 1e-3, "t": 1e3}
"""Unit that a payload may be in by mistake → its size [kg]."""
_PAYLOAD_BY_REACH: Final = (0.1, 50.0)
"""Payloads that arms carry, divided by the third power of their reach [kg/m³]: 0.3 for arms that paint, 24
for the smallest arm of the catalogue, 44 for the strongest arms of data sheets."""
_ROUND: Final = 1e-3
"""Relative difference from a number of two digits up to which a number is round."""


def payload_torque(payload: float, reach: float) -> float:
    """Return payload · g · reach [N·m] of a payload [kg] and a reach [m]."""
    return payload * FORCE_UNITS["kgf"] * reach


def inspect_force_unit(
    robot: Robot, measurements: Measurements, joints: Sequence[JointCompliance]
) -> Iterator[Finding]:
    """Report stiffnesses that are implausible for the payload, as if forces had another unit than declared.

    Yield a finding for each unit that makes the stiffnesses plausible, the likeliest first; if no unit does,
    one finding without an action. For a robot without a payload, yield one finding that requests the payload.
    Nothing is compared where the arm has other joints than six revolute ones, or fewer than `LEAST_JOINTS` of
    joints 2 to 6 are identified.

    Args:
        robot: n joints.
        measurements: N observations, with the unit of force that was declared.
        joints: result for each joint, of a fit by joints alone.
    """
    is_six_axis_arm = robot.n == _SIX and not robot.prismatic.any()
    if not is_six_axis_arm or not measurements.force.any():
        return
    compared = _ComparedJoints.of(joints)
    if compared.is_known.sum() < LEAST_JOINTS:
        return
    reach = measure_reach(robot)
    if robot.payload is None:
        yield _request_payload(compared, reach, measurements.force_unit)
        return
    comparison = _Comparison(compared, robot.payload, reach, measurements.force_unit)
    if not comparison.is_plausible(1.0):
        yield from _report_implausible_ratio(comparison)


@dataclass(frozen=True)
class _ComparedJoints:
    """Identified joints among the joints 2 to 6, with the ratios of the measured arms for the same joints."""

    names: str  # of the identified joints, in words
    is_known: BoolArray  # (5,) which of joints 2 to 6 are identified
    stiffness: float  # geometric mean of the identified joints [N·m/rad]; NaN without any

    @classmethod
    def of(cls, joints: Sequence[JointCompliance]) -> _ComparedJoints:
        """Select the identified joints from the results for all six joints."""
        compared = joints[1:_SIX]
        stiffness = np.full(len(compared), np.nan)
        for i, joint in enumerate(compared):
            if joint.status == "identified" and joint.stiffness is not None:
                stiffness[i] = joint.stiffness
        is_known = stiffness > 0.0
        names = [compared[i].name for i in np.flatnonzero(is_known).tolist()]
        if not names:
            return cls("", is_known, np.nan)
        names_text = f"{names[0]} to {names[-1]}" if is_known.all() else ", ".join(names)
        return cls(names_text, is_known, _geometric_mean(stiffness[is_known]))

    @property
    def ratios_of_arms(self) -> list[float]:
        """Geometric mean of the ratios of each measured arm, over the identified joints [rad⁻¹]."""
        return [_geometric_mean(arm.ratios()[self.is_known]) for arm in MEASURED_ARMS]

    @property
    def usual_ratio(self) -> float:
        """Geometric mean of the ratios of all measured arms [rad⁻¹].

        The wrist is softer than joints 2 and 3, so the ratio depends on the joints that are identified.
        """
        return _geometric_mean(np.array(self.ratios_of_arms))

    @property
    def plausible_ratios(self) -> tuple[float, float]:
        """Least and greatest plausible ratio [rad⁻¹]."""
        return self.usual_ratio / FACTOR, self.usual_ratio * FACTOR


def _request_payload(compared: _ComparedJoints, reach: float, declared: ForceUnit) -> Finding:
    """Return the finding that the unit of forces is not checked, because the robot states no payload.

    The finding tells for which payloads the stiffnesses are plausible, in each unit that people type.

    Args:
        compared: identified joints.
        reach: of the wrist from axis 1 [m].
        declared: unit of the forces that was declared.
    """
    payload_texts = []
    for unit, size in _relative_units(declared).items():
        is_declared = size == 1.0
        if is_declared or unit in _TYPED_UNITS:
            payload_texts.append(f"{_describe_payloads(compared, size, reach)} with forces in {unit}")
    return Finding(
        code="payload_not_stated",
        weight="use",
        message=f"the robot states no payload, so the unit of the forces ({declared}) cannot "
        f"be checked; the stiffnesses of {compared.names} are plausible for a payload of "
        f"{', '.join(payload_texts)}",
        remedy="state `payload`, the largest payload of the robot by its maker, in kg",
        action=AdvisedAction.of("state_payload"),
    )


def _describe_payloads(compared: _ComparedJoints, size: float, reach: float) -> str:
    """Return the payloads for which stiffnesses are plausible, such as `110 to 990 kg`.

    A stiff arm for its payload has the greatest ratio of stiffness to torque, and so the least payload.

    Args:
        compared: identified joints, with their stiffness by the forces as declared.
        size: size of the unit of forces, relative to the declared one.
        reach: of the wrist from axis 1 [m].
    """
    torque_of_one_kg = payload_torque(1.0, reach)
    least_ratio, greatest_ratio = compared.plausible_ratios
    stiffness = size * compared.stiffness
    least = figure(stiffness / (greatest_ratio * torque_of_one_kg), ".2g")
    greatest = figure(stiffness / (least_ratio * torque_of_one_kg), ".2g")
    return f"{least} to {greatest} kg"


@dataclass(frozen=True)
class _Comparison:
    """Stiffness of an arm compared with its payload and reach."""

    compared: _ComparedJoints
    payload: float  # [kg]
    reach: float  # of the wrist from axis 1 [m]
    declared: ForceUnit  # unit of the forces as declared

    @property
    def ratio(self) -> float:
        """Ratio of the stiffness to the torque of payload and reach, with the forces as declared [rad⁻¹]."""
        return self.compared.stiffness / payload_torque(self.payload, self.reach)

    def is_plausible(self, size: float) -> bool:
        """Return whether the ratio is plausible with a unit of forces `size` times as large as declared."""
        least, greatest = self.compared.plausible_ratios
        return least <= self.ratio * size <= greatest

    def find_plausible_units(self) -> dict[ConfusedForceUnit, float]:
        """Return unit → ratio [rad⁻¹] of the units of force with a plausible ratio, the likeliest first.

        The likeliest unit is that whose ratio is nearest to the usual ratio.
        """
        sizes = _relative_units(self.declared)
        ratios = {unit: self.ratio * size for unit, size in sizes.items() if self.is_plausible(size)}
        usual = self.compared.usual_ratio
        likeliest_first = sorted(ratios, key=lambda unit: abs(np.log(ratios[unit] / usual)))
        return {unit: ratios[unit] for unit in likeliest_first}

    def find_mistaken_payload(self) -> str | None:
        """Return a statement that the payload is in another unit than kg; None if it seems to be in kg.

        A payload in another unit explains the ratio as well as forces in another unit do. It is named if no
        arm of this reach carries the payload as stated, or if the payload is a round number only in that
        unit, because data sheets state round numbers.
        """
        for unit, size in _UNITS_OF_PAYLOADS.items():
            payload = size * self.payload
            is_possible = self._is_carried(payload) and self.is_plausible(1.0 / size)
            is_only_round_in_unit = _is_round(payload) and not _is_round(self.payload)
            if is_possible and (is_only_round_in_unit or not self._is_carried(self.payload)):
                return f"the payload of {figure(self.payload)} kg is in {unit} ({figure(payload, '.3g')} kg)"
        return None

    def _is_carried(self, payload: float) -> bool:
        """Return whether arms of this reach carry a payload [kg]."""
        least, greatest = _PAYLOAD_BY_REACH
        return least <= payload / self.reach**3 <= greatest

    @property
    def plausible_range(self) -> str:
        """The plausible ratios in words."""
        least, greatest = self.compared.plausible_ratios
        return f"{figure(least, '.2g')} to {figure(greatest, '.2g')} rad⁻¹"

    def describe(self) -> str:
        """Return the ratio of the arm, those of the measured arms, and the plausible ones in words."""
        ratio_texts_of_arms = [
            f"{figure(mean, '.3g')} ({arm.name})"
            for arm, mean in zip(MEASURED_ARMS, self.compared.ratios_of_arms, strict=True)
        ]
        return (
            f"the geometric mean of the stiffnesses of {self.compared.names}, divided by payload · g · reach "
            f"({figure(self.payload)} kg, {figure(self.reach, '.3g')} m), is {figure(self.ratio, '.3g')} "
            f"rad⁻¹; the arm of our comparison has {' or '.join(ratio_texts_of_arms)}, and "
            f"{self.plausible_range} is plausible"
        )


def _report_implausible_ratio(comparison: _Comparison) -> Iterator[Finding]:
    """Yield a finding for each unit of force that makes the ratio plausible; one without a unit if none does.

    Only the first finding repeats the whole comparison.
    """
    units = comparison.find_plausible_units()
    if mistaken_payload := comparison.find_mistaken_payload():
        yield _report_mistaken_payload(comparison, mistaken_payload, units)
        return
    if not units:
        yield Finding(
            code="stiffness_against_payload",
            weight="use_with_care",
            message=f"{comparison.describe()}; no other unit of force would give a plausible value",
            remedy=f"check `units.force`, and the robot's `payload`; {PAST_CARE}",
        )
    for number, (unit, ratio) in enumerate(units.items()):
        effect = (
            f"forces in {unit}, not in {comparison.declared} as declared, would give "
            f"{figure(ratio, '.3g')} rad⁻¹"
        )
        message = f"{effect}; {comparison.plausible_range} is plausible"
        if number == 0:
            message = f"{comparison.describe()}; {effect}"
        yield _report_confused_unit(unit, message)


def _report_mistaken_payload(
    comparison: _Comparison, mistaken_payload: str, units: Iterable[ConfusedForceUnit]
) -> Finding:
    """Return the finding that the payload, or instead the forces, are in another unit; without an action.

    Args:
        comparison: stiffness compared with payload and reach.
        mistaken_payload: statement about the unit of the payload.
        units: units of force that explain the ratio as well.
    """
    declared, words = comparison.declared, " or ".join(units)
    cause, remedy = mistaken_payload, "state `payload` in kg, as the maker's data sheet states it"
    if words:
        cause = f"either {mistaken_payload}, or the forces are in {words}, not in {declared} as declared"
        remedy += f"; or, if the payload is right, set `units.force` to {words}"
    return Finding(
        code="stiffness_against_payload",
        weight="use_with_care",
        message=f"{cause}: {comparison.describe()}",
        remedy=f"{remedy}; {PAST_CARE}",
    )


def _is_round(number: float) -> bool:
    """Return whether a number has two digits only, within 0.1 %."""
    rounded = float(f"{number:.2g}")
    return abs(rounded / number - 1.0) < _ROUND


def _report_confused_unit(unit: ConfusedForceUnit, message: str) -> Finding:
    """Return the finding that forces may have been read in another unit than declared."""
    return Finding(
        code="stiffness_against_payload",
        weight="use_with_care",
        message=message,
        remedy=f"check in which unit the forces were read; {PAST_CARE}; if in {unit}, set `units.force` "
        f"to {unit}",
        action=AdvisedAction.of("convert_units", unit=unit),
    )


def _relative_units(declared: ForceUnit) -> dict[ConfusedForceUnit, float]:
    """Return the size of each unit of force relative to the unit that was declared."""
    newtons_of_declared = FORCE_UNITS["kgf" if declared == "kg" else declared]
    return {unit: newtons / newtons_of_declared for unit, newtons in FORCE_UNITS.items()}


def _geometric_mean(positive: FloatArray) -> float:
    """Return the geometric mean of positive numbers."""
    return float(np.exp(np.log(positive).mean()))
