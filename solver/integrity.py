"""What is suspicious in a set though not impossible: the usual mistakes of a long day."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Final

import numpy as np
import numpy.typing as npt

from solver.configuration import Configurations
from solver.finding import Finding, length_text
from solver.measurements import Measurements
from solver.robot import Robot

__all__ = ["MAX_FINDINGS_PER_CODE", "inspect"]

FloatArray = npt.NDArray[np.float64]

MAX_FINDINGS_PER_CODE: Final = 10
"""Further findings of a kind are counted in its last message."""
RIGIDITY_SIGMAS: Final = 5.0
"""Change of a distance between two targets, in its standard deviations, that is not noise."""
NOISE_SIGMAS: Final = 3.0
"""A deflection shorter than this many of its standard deviations says little."""
LARGEST_DEFLECTION: Final = 0.02
"""Robots bend by millimetres; more than this [m] is a mistake in a unit or a label."""
SMALLEST_DEFLECTION: Final = 5e-6
"""No tracker sees less [m]; a set in which nothing moves more has its lengths in another unit."""
LARGEST_SIGMA: Final = 1e-3
"""No tracker is worse [m]."""
LARGEST_MODEL_ERROR: Final = 0.02
"""Robots stand where their model says within millimetres; more [m] is a wrong frame, map, unit or angle."""
RARE_TARGET: Final = 0.1
"""A target read in a smaller share of many observations is likely another one's name misspelt."""
_LIMIT_MARGIN: Final = 1e-3
_MANY_TURNS: Final = 4 * np.pi
_SMALL_DEGREES: Final = 2 * np.pi


def inspect(
    robot: Robot, measurements: Measurements, targets: tuple[str, ...], *, degrees: bool
) -> list[Finding]:
    """Look for the usual mistakes of a day of measurements.

    Args:
        robot: n joints.
        measurements: N observations of T targets.
        targets: the names of the targets.
        degrees: whether the angles were posted in degrees.

    Returns:
        The findings, at most `MAX_FINDINGS_PER_CODE` of each kind.
    """
    checks: tuple[Iterable[Finding], ...] = (
        _angle_unit(measurements, degrees=degrees),
        _limits(robot, measurements),
        _off_model(robot, measurements, targets),
        _rare_targets(measurements, targets),
        _sigma(measurements),
        _zero_load(measurements),
        _size(measurements, targets),
        _below_noise(measurements),
        _against_force(measurements),
        _rigidity(measurements, targets),
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


def _off_model(robot: Robot, measurements: Measurements, targets: tuple[str, ...]) -> Iterator[Finding]:
    """A target sits still on the flange: seen from there, its measured places must agree."""
    measured = measurements.present & ~measurements.in_flange
    configurations = Configurations(robot, robot.joint_map.model_angles(measurements.joints))
    arm = measurements.position - configurations.flange_translation[:, None]
    in_flange = np.where(measured[..., None], arm @ configurations.flange_rotation, np.nan)
    seen = np.flatnonzero(measured.sum(axis=0) > 1)
    if not len(seen):
        return
    places = in_flange[:, seen]
    apart = np.nan_to_num(np.linalg.norm(places - np.nanmedian(places, axis=0), axis=2))
    for i in np.flatnonzero(apart.max(axis=1) > LARGEST_MODEL_ERROR):
        t = int(apart[i].argmax())
        yield Finding(
            "target_off_model",
            int(i),
            f"target '{targets[seen[t]]}' sits {length_text(apart[i, t])} from its median place on the "
            "flange",
            "check that positions are in R0, units.length, the angles and their order, the joint map, and "
            "the robot's model",
        )


def _rare_targets(measurements: Measurements, targets: tuple[str, ...]) -> Iterator[Finding]:
    count = measurements.present.sum(axis=0)
    for t in np.flatnonzero(count < RARE_TARGET * len(measurements)):
        first = int(np.flatnonzero(measurements.present[:, t])[0])
        yield Finding(
            "target_name_suspect",
            first,
            f"target '{targets[t]}' is read in {count[t]} of {len(measurements)} observations",
            "check the spelling of its name",
        )


def _sigma(measurements: Measurements) -> Iterator[Finding]:
    if measurements.sigma is not None and measurements.sigma > LARGEST_SIGMA:
        yield Finding(
            "sigma_suspect",
            None,
            f"sigma is {length_text(measurements.sigma)}, more than any tracker's",
            "check noise.sigma: it is in units.length",
        )


def _zero_load(measurements: Measurements) -> Iterator[Finding]:
    for i in np.flatnonzero(~_loaded(measurements)):
        yield Finding(
            "zero_load",
            int(i),
            "force and moment are zero, so the observation says nothing about stiffness",
            "give the load, or remove the observation",
        )


def _loaded(measurements: Measurements) -> npt.NDArray[np.bool_]:
    return np.asarray(measurements.force.any(axis=1) | measurements.moment.any(axis=1))


def _size(measurements: Measurements, targets: tuple[str, ...]) -> Iterator[Finding]:
    length = np.linalg.norm(measurements.deflection, axis=2)
    for i in np.flatnonzero(length.max(axis=1) > LARGEST_DEFLECTION):
        t = int(length[i].argmax())
        yield Finding(
            "deflection_implausibly_large",
            int(i),
            f"target '{targets[t]}' moved by {length_text(length[i, t])}",
            "check units.length, and that unloaded and loaded readings belong together",
        )
    if length.max() < SMALLEST_DEFLECTION and _loaded(measurements).any():
        yield Finding(
            "deflection_implausibly_small",
            None,
            f"no target moved by more than {length_text(float(length.max()))}",
            "check units.length, and that the loaded readings were taken under load",
        )


def _below_noise(measurements: Measurements) -> Iterator[Finding]:
    noise = np.sqrt(2.0) * (measurements.sigma or 0.0)
    length = np.linalg.norm(measurements.deflection, axis=2).max(axis=1)
    for i in np.flatnonzero((length <= NOISE_SIGMAS * noise) & _loaded(measurements)):
        yield Finding(
            "deflection_below_noise",
            int(i),
            f"no target moved by more than {length_text(length[i])}, and the noise of a deflection is "
            f"{length_text(noise)}",
            "load the robot more, check that the loaded readings were taken under load, and noise.sigma",
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
            f"the targets moved by {length_text(-along[i])} against the force of {force[i]:.4g} N",
            "check the signs of the force, and whether unloaded and loaded readings are swapped",
        )


def _rigidity(measurements: Measurements, targets: tuple[str, ...]) -> Iterator[Finding]:
    """Distances between measured targets must be those of a rigid triangle, loaded or not."""
    measured = measurements.present & ~measurements.in_flange
    first, second = np.triu_indices(measured.shape[1], k=1)
    usable = (measured[:, first] & measured[:, second]).any(axis=0)
    first, second = first[usable], second[usable]
    if not len(first):
        return
    both = measured[:, first] & measured[:, second]
    change = _length_changes(measurements, first, second, both)
    limit = RIGIDITY_SIGMAS * np.sqrt(2.0) * _reading_sigma(measurements, change[both])
    for i in np.flatnonzero(change.max(axis=1) > limit):
        pair = int(change[i].argmax())
        yield Finding(
            "targets_not_rigid",
            int(i),
            f"the distance between '{targets[first[pair]]}' and '{targets[second[pair]]}' differs by "
            f"{length_text(change[i, pair])} from its median, more than {length_text(limit)}",
            "check for a moved target or swapped names, and repeat the observation if neither",
        )


def _length_changes(
    measurements: Measurements,
    first: npt.NDArray[np.intp],
    second: npt.NDArray[np.intp],
    both: npt.NDArray[np.bool_],
) -> FloatArray:
    """(N, pairs) greatest departure of each distance from its median, unloaded and loaded [m]."""
    states = (measurements.position, measurements.position + measurements.deflection)
    edges = np.stack([state[:, first] - state[:, second] for state in states])
    lengths = np.where(both, np.linalg.norm(edges, axis=3), np.nan)
    typical = np.nanmedian(lengths.reshape(-1, both.shape[1]), axis=0)
    change: FloatArray = np.nan_to_num(np.abs(lengths - typical)).max(axis=0)
    return change


def _reading_sigma(measurements: Measurements, change: FloatArray) -> float:
    """Sigma of a reading, from the scatter of the distances (robustly) where it is not given."""
    if measurements.sigma is not None:
        return measurements.sigma
    return max(1e-6, float(1.4826 * np.median(change) / np.sqrt(2.0)))
