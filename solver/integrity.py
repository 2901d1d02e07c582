"""What is suspicious in a set though not impossible: noticed, said with figures, never mended silently."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from solver.measurements import Measurements
from solver.robot import Robot

__all__ = ["MAX_FINDINGS_PER_CODE", "Finding", "FindingCode", "inspect"]

FloatArray = npt.NDArray[np.float64]

FindingCode = Literal[
    "targets_not_rigid",
    "deflection_against_force",
    "joint_outside_limits",
    "angle_unit_suspect",
    "deflection_implausibly_large",
    "deflection_below_noise",
    "zero_load",
]

MAX_FINDINGS_PER_CODE: Final = 10
"""Further findings of a kind are counted in its last message."""
RIGIDITY_SIGMAS: Final = 5.0
"""Change of a distance between two targets, in its standard deviations, that is not noise."""
NOISE_SIGMAS: Final = 3.0
"""A deflection shorter than this many of its standard deviations says little."""
IMPLAUSIBLE_DEFLECTION: Final = 0.02
"""Robots bend by millimetres; more than this [m] is a mistake in a unit or a label."""
_LIMIT_MARGIN: Final = 1e-3
_MANY_TURNS: Final = 4 * np.pi
_SMALL_DEGREES: Final = 2 * np.pi


@dataclass(frozen=True)
class Finding:
    """One suspicion.

    Attributes:
        code: its kind.
        observation: index of the observation; None for the whole set.
        message: what was seen, with figure and unit.
        remedy: what to check.
    """

    code: FindingCode
    observation: int | None
    message: str
    remedy: str


def inspect(robot: Robot, measurements: Measurements, *, degrees: bool) -> list[Finding]:
    """Look for the usual mistakes of a day of measurements.

    Args:
        robot: n joints.
        measurements: N observations.
        degrees: whether the angles were posted in degrees.

    Returns:
        The findings, at most `MAX_FINDINGS_PER_CODE` of each kind.
    """
    checks: tuple[Iterable[Finding], ...] = (
        _angle_unit(measurements, degrees=degrees),
        _limits(robot, measurements),
        _zero_load(measurements),
        _size(measurements),
        _below_noise(measurements),
        _against_force(measurements),
        _rigidity(measurements),
    )
    return [finding for check in checks for finding in _shortened(check)]


def _shortened(findings: Iterable[Finding]) -> list[Finding]:
    rest = iter(findings)
    shown = list(islice(rest, MAX_FINDINGS_PER_CODE))
    more = sum(1 for _ in rest)
    if more:
        last = shown[-1]
        message = f"{last.message} (and {more} more of this kind)"
        shown[-1] = Finding(last.code, last.observation, message, last.remedy)
    return shown


def _angle_unit(measurements: Measurements, *, degrees: bool) -> Iterator[Finding]:
    largest = float(np.abs(measurements.joints).max())
    if not degrees and largest > _MANY_TURNS:
        yield Finding(
            "angle_unit_suspect",
            None,
            f"the largest joint angle is {largest:.4g} rad, more than two turns",
            "check units.angle: the angles look like degrees",
        )
    posted = float(np.rad2deg(largest))
    if degrees and 0 < posted <= _SMALL_DEGREES and len(measurements) > 1:
        yield Finding(
            "angle_unit_suspect",
            None,
            f"no joint turns by more than {posted:.3g}° in {len(measurements)} observations",
            "check units.angle: the angles look like radians",
        )


def _limits(robot: Robot, measurements: Measurements) -> Iterator[Finding]:
    q = robot.joint_map.model_angles(measurements.joints)
    lower, upper = robot.limits.T
    outside = (q < lower - _LIMIT_MARGIN) | (q > upper + _LIMIT_MARGIN)
    for i, j in zip(*np.nonzero(outside), strict=True):
        yield Finding(
            "joint_outside_limits",
            int(i),
            f"{robot.joint_names[j]} stands at {q[i, j]:.4g} rad (model angle), outside "
            f"[{lower[j]:.4g}, {upper[j]:.4g}] rad",
            "check units.angle, the joint map, and the order of the angles",
        )


def _zero_load(measurements: Measurements) -> Iterator[Finding]:
    unloaded = ~(measurements.force.any(axis=1) | measurements.moment.any(axis=1))
    for i in np.flatnonzero(unloaded):
        yield Finding(
            "zero_load",
            int(i),
            "force and moment are zero, so the observation says nothing about stiffness",
            "give the load, or remove the observation",
        )


def _size(measurements: Measurements) -> Iterator[Finding]:
    length = np.linalg.norm(measurements.deflection, axis=2).max(axis=1)
    for i in np.flatnonzero(length > IMPLAUSIBLE_DEFLECTION):
        yield Finding(
            "deflection_implausibly_large",
            int(i),
            f"a target moved by {1e3 * length[i]:.4g} mm, more than {1e3 * IMPLAUSIBLE_DEFLECTION:g} mm",
            "check units.length, and that unloaded and loaded readings belong together",
        )


def _below_noise(measurements: Measurements) -> Iterator[Finding]:
    if measurements.sigma is None:
        return
    noise = NOISE_SIGMAS * np.sqrt(2.0) * measurements.sigma
    length = np.linalg.norm(measurements.deflection, axis=2).max(axis=1)
    loaded = measurements.force.any(axis=1) | measurements.moment.any(axis=1)
    for i in np.flatnonzero((length < noise) & loaded):
        yield Finding(
            "deflection_below_noise",
            int(i),
            f"no target moved by more than {1e6 * length[i]:.3g} µm, and the noise of a deflection "
            f"is {1e6 * noise / NOISE_SIGMAS:.3g} µm",
            "load the robot more, or check that the loaded readings were taken under load",
        )


def _against_force(measurements: Measurements) -> Iterator[Finding]:
    """Work of the force along the mean deflection of the targets, beyond what noise explains."""
    force = np.linalg.norm(measurements.force, axis=1)
    direction = measurements.force / np.where(force > 0, force, 1.0)[:, None]
    read = measurements.present.sum(axis=1)
    mean = measurements.deflection.sum(axis=1) / np.maximum(read, 1)[:, None]
    along = np.einsum("ni,ni->n", mean, direction)
    sigma = measurements.sigma or 0.0
    noise = RIGIDITY_SIGMAS * np.sqrt(2.0) * sigma / np.sqrt(np.maximum(read, 1))
    for i in np.flatnonzero((along < -noise) & (force > 0)):
        yield Finding(
            "deflection_against_force",
            int(i),
            f"the targets moved by {1e6 * -along[i]:.4g} µm against the force of {force[i]:.4g} N",
            "check the signs of the force, and whether unloaded and loaded readings are swapped",
        )


def _rigidity(measurements: Measurements) -> Iterator[Finding]:
    """Distances between measured targets must be those of a rigid triangle, loaded or not."""
    measured = measurements.present & ~measurements.in_flange
    if measured.shape[1] < 2 or not measured.any():
        return
    first, second = np.triu_indices(measured.shape[1], k=1)
    loaded = measurements.position + measurements.deflection
    both = measured[:, first] & measured[:, second]
    lengths = np.stack([_distances(p, first, second) for p in (measurements.position, loaded)])
    lengths[:, ~both] = np.nan
    usable = both.any(axis=0)
    typical = np.nanmedian(lengths[:, :, usable].reshape(-1, int(usable.sum())), axis=0)
    change = np.abs(lengths[:, :, usable] - typical).max(axis=0)
    limit = RIGIDITY_SIGMAS * np.sqrt(2.0) * _distance_sigma(measurements, change)
    worst = np.where(np.isnan(change), 0.0, change).max(axis=1)
    for i in np.flatnonzero(worst > limit):
        yield Finding(
            "targets_not_rigid",
            int(i),
            f"the distance between two targets differs by {1e6 * worst[i]:.4g} µm from the others' "
            f"median, more than {1e6 * limit:.3g} µm",
            "check for a moved or swapped target, and repeat the observation",
        )


def _distances(
    positions: FloatArray, first: npt.NDArray[np.intp], second: npt.NDArray[np.intp]
) -> FloatArray:
    lengths: FloatArray = np.linalg.norm(positions[:, first] - positions[:, second], axis=2)
    return lengths


def _distance_sigma(measurements: Measurements, change: FloatArray) -> float:
    """Sigma of a reading, from the scatter of the distances (robustly) where it is not given."""
    if measurements.sigma is not None:
        return measurements.sigma
    return max(1e-6, float(1.4826 * np.nanmedian(change) / np.sqrt(2.0)))
