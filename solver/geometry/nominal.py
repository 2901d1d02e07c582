"""Readings compared with the nominal model: another unit, another sign of a joint, another arm.

A nominal model is within millimetres of the robot that was measured. If the model, placed as well as
possible, is farther off the readings, a mistake is looked for that explains the readings within millimetres:
one unit of all lengths, reversed joints, or another robot. A fit of the geometry does not show such a
mistake, because its axes are free: it finds a link of 17 mm where 425 mm were meant.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from jointstiff.schemas.finding import AdvisedAction, Finding
from jointstiff.schemas.geometry import LinkComparison
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.geometry.poses import LARGEST_RESIDUAL, Axis, Placement, list_chain_axes, place_arm
from jointstiff.solver.mechanics.chain import KinematicChain
from jointstiff.solver.mechanics.robot import JointMap, KnownRobot
from jointstiff.solver.text import figure, length_text

LARGEST_NOMINAL_RMS: Final = 5e-3
"""Residual of a coordinate [m rms] by the nominal model of the robot that was measured, at most."""
CLEARLY: Final = 1.0 / 3.0
"""Ratio of residuals below which another explanation is better than the chosen model."""
LARGEST_LENGTH_DIFFERENCE: Final = 20e-3
"""Difference of a length from its nominal value [m] that no making of an arm explains."""
LARGEST_ANGLE_DIFFERENCE: Final = 0.1
"""Difference of an angle of a link from its nominal value [rad] that no making of an arm explains."""

_UNITS: Final = {"mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "ft": 0.3048, "m": 1.0}  # sizes [m]
_DECLARED: Final = ("mm", "m")
_UNKNOWN_RATIO: Final = (
    "no unit has this ratio",
    "check units.length, the unit of the nominal model, and the size of the arm that was measured",
)
"""Meaning of a ratio of lengths that no unit explains, and the remedy."""
_SAME_RATIO: Final = 0.02  # relative difference of two ratios of lengths that count as equal
_LEAST_SCALE_ERROR: Final = 0.1  # least difference of a scale from 1 that is reported
_MOST_POSES: Final = 100  # that are compared with each model
_MOST_REVERSED: Final = 7  # joints of an arm for which all combinations of signs are tried
_ALIKE: Final = 1.5  # ratio of residuals up to which readings do not distinguish two robots
_CLEAR_UNCERTAINTIES: Final = 4.0
_OF_ANOTHER_ARM: Final = {"m": 0.1, "rad": 0.5}  # differences that no arm has from its own nominal model


@dataclass(frozen=True, eq=False)
class ComparedReadings:
    """Some of the readings of sweeps or poses, for the comparison with models."""

    angles: FloatArray  # (N, n) angles of the controller [rad]
    points: FloatArray  # (N, T, 3) readings, tracker's frame [m]
    present: BoolArray  # (N, T) mask of the targets that were read

    @classmethod
    def sample(cls, angles: FloatArray, points: FloatArray, present: BoolArray) -> ComparedReadings:
        """Choose at most `_MOST_POSES` positions, evenly among all."""
        rows = np.unique(np.linspace(0, len(angles) - 1, _MOST_POSES).astype(int))
        return cls(angles[rows], points[rows], present[rows])

    def place(
        self,
        axes: Sequence[Axis],
        joint_map: JointMap,
        *,
        reversed_joints: Sequence[int] = (),
        fits_scale: bool = False,
    ) -> Placement:
        """Place an arm among the readings, with the angles of some joints of the controller reversed."""
        signs = np.ones(self.angles.shape[1])
        signs[list(reversed_joints)] = -1.0
        angles = joint_map.model_angles(signs * self.angles)
        return place_arm(axes, angles, self.points, self.present, fits_scale=fits_scale)


def inspect_nominal(
    nominal: KinematicChain, joint_map: JointMap, readings: ComparedReadings, others: Iterable[KnownRobot]
) -> Iterator[Finding]:
    """Report the mistake that explains readings which the nominal model does not explain, if there is one.

    Args:
        nominal: model of the robot, with n revolute joints.
        joint_map: map of the robot's n joints.
        readings: readings with n angles each.
        others: robots that may have been measured, tried last.
    """
    axes, _ = list_chain_axes(nominal)
    chosen = readings.place(axes, joint_map)
    if chosen.rms <= LARGEST_NOMINAL_RMS:
        return
    scaled = readings.place(axes, joint_map, fits_scale=True)
    is_scaled = _explains(scaled, chosen) and abs(np.log(scaled.scale)) > _LEAST_SCALE_ERROR
    unit = _explain_ratio(scaled.scale)
    if is_scaled and unit is not None:
        yield _report_ratio(scaled, *unit)
        return
    for joints in _list_reversals(len(axes)):
        turned = readings.place(axes, joint_map, reversed_joints=joints)
        if _explains(turned, chosen):
            yield _report_reversal([nominal.joint_names[joint] for joint in joints], turned, chosen)
            return
    fitting = list(_report_other_robots(readings, chosen, others))
    yield from fitting
    if is_scaled and not fitting:
        yield _report_ratio(scaled, *_UNKNOWN_RATIO)


def _explains(placed: Placement, chosen: Placement) -> bool:
    """Return whether a placement explains readings that the chosen model does not explain."""
    return placed.rms <= min(LARGEST_NOMINAL_RMS, CLEARLY * chosen.rms)


def _list_reversals(n: int) -> Iterator[tuple[int, ...]]:
    """Yield the sets of joints that may be reversed, the smallest first; single joints of a long chain."""
    most = n if n <= _MOST_REVERSED else 1
    for count in range(1, most + 1):
        yield from combinations(range(n), count)


def _report_ratio(scaled: Placement, meaning: str, remedy: str) -> Finding:
    """Report one ratio of all lengths of the readings to those of the nominal model, and what it means."""
    ratio = figure(scaled.scale)
    return Finding(
        code="length_unit_suspect",
        weight="do_not_use",
        where="units.length",
        message=f"the lengths of the readings are {ratio} times those of the nominal model, all alike within "
        f"{length_text(scaled.rms)}: {meaning}",
        remedy=remedy,
    )


def _explain_ratio(ratio: float) -> tuple[str, str] | None:
    """Return which unit a ratio of lengths, readings to model, means, and the remedy; None if no unit."""
    pairs = [(declared, unit) for declared in _DECLARED for unit in _UNITS if unit != declared]
    for declared, unit in pairs:
        if abs(ratio * _UNITS[unit] / _UNITS[declared] - 1.0) < _SAME_RATIO:
            factor = figure(_UNITS[unit] / _UNITS[declared])
            remedy = f"multiply all lengths of the readings, sigma included, by {factor}"
            if unit in _DECLARED:
                remedy = f"set units.length to {unit}"
            return f"the readings seem to be in {unit}, not in {declared}", remedy
    for declared, unit in pairs:
        if abs(ratio * _UNITS[declared] / _UNITS[unit] - 1.0) < _SAME_RATIO:
            factor = figure(_UNITS[unit] / _UNITS[declared])
            return (
                f"the nominal model seems to be in {unit}, not in {declared}",
                f"multiply all lengths of the nominal model by {factor}",
            )
    return None


def _report_reversal(names: Sequence[str], turned: Placement, chosen: Placement) -> Finding:
    """Report that the nominal model fits with some joints reversed; `names` are the joints'."""
    joints = ", ".join(names)
    return Finding(
        code="joint_sign_suspect",
        weight="do_not_use",
        where=joints,
        message=f"with {joints} reversed, the nominal model fits the readings within "
        f"{length_text(turned.rms)} rms, as given only within {length_text(chosen.rms)} rms",
        remedy=f"check the joint map: if the controller counts the other way, reverse the column of {joints}",
    )


def _report_other_robots(
    readings: ComparedReadings, chosen: Placement, others: Iterable[KnownRobot]
) -> Iterator[Finding]:
    """Report the other robot that fits best, and the robots that fit as well."""
    n = readings.angles.shape[1]
    fits: list[tuple[float, KnownRobot]] = []
    for known in others:
        if known.robot.n != n or known.robot.prismatic.any():
            continue
        placed = readings.place(list_chain_axes(known.robot.chain)[0], known.robot.joint_map)
        if _explains(placed, chosen):
            fits.append((placed.rms, known))
    if not fits:
        return
    rms, best = min(fits, key=lambda fit: fit[0])
    equals = [f"'{known.name}'" for other, known in fits if known is not best and other <= _ALIKE * rms]
    tie = f"; {' and '.join(equals)} fit{'s' if len(equals) == 1 else ''} as well" if equals else ""
    yield Finding(
        code="another_robot_fits",
        weight="do_not_use",
        where="robot",
        message=f"the robot '{best.name}' fits the readings within {length_text(rms)} rms, the chosen robot "
        f"only within {length_text(chosen.rms)} rms{tie}",
        remedy=f"check which robot was measured; if '{best.name}' was measured, choose this robot",
        action=AdvisedAction.of("choose_robot", robot=best.name, robot_id=best.identifier),
    )


def report_misfit(rms: float, links: Sequence[LinkComparison]) -> Iterator[Finding]:
    """Report residuals that no geometry explains, and links that are far from their nominal sizes.

    Args:
        rms: residual of a coordinate after the fit [m].
        links: lengths and angles, nominal and identified.
    """
    if rms > LARGEST_RESIDUAL:
        yield Finding(
            code="target_off_model",
            weight="do_not_use",
            where=None,
            message=f"the fitted geometry leaves a residual of {length_text(rms)} rms at the tracker; up to "
            f"{length_text(LARGEST_RESIDUAL)} is plausible",
            remedy="check which robot was measured, the unit and the sign of the angles, the joint map, and "
            "the order of the rows",
        )
    far = [link for link in links if _is_far_from_nominal(link)]
    if far:
        quantities = ", ".join(
            f"{link.quantity} after {link.joint} ({_describe_sizes(link)})" for link in far
        )
        is_other_arm = any(abs(link.difference) > _OF_ANOTHER_ARM[link.unit] for link in far)
        yield Finding(
            code="target_off_model",
            weight="do_not_use" if is_other_arm else "use_with_care",
            where="links",
            message="links differ from the nominal model by more than "
            f"{length_text(LARGEST_LENGTH_DIFFERENCE)} or {LARGEST_ANGLE_DIFFERENCE:g} rad: {quantities}",
            remedy="check which robot was measured, the zeros and signs of its joints, and the nominal "
            "model, which places R0 and the flange frame",
        )


def _is_far_from_nominal(link: LinkComparison) -> bool:
    """Return whether a link that the readings determine is far from its nominal size."""
    if link.standard_uncertainty is None:
        return False
    largest = LARGEST_LENGTH_DIFFERENCE if link.unit == "m" else LARGEST_ANGLE_DIFFERENCE
    return abs(link.difference) > largest + _CLEAR_UNCERTAINTIES * link.standard_uncertainty


def _describe_sizes(link: LinkComparison) -> str:
    """Describe the nominal and the identified size of a link."""
    if link.unit == "m":
        return f"{figure(1e3 * link.nominal)} mm nominal, {figure(1e3 * link.identified)} mm identified"
    nominal, identified = np.degrees(link.nominal), np.degrees(link.identified)
    return f"{figure(nominal)}° nominal, {figure(identified)}° identified"
