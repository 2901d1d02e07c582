"""Loads that are stated in another way than measurement sets have them.

Forces along the axes of the flange turn with the flange. Moments about the origin of R0 or of the flange
contain the moment of the force, which its load point adds again. Load points in R0 move with the robot.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.integrity.mistakes import LARGEST_MODEL_ERROR
from jointstiff.solver.integrity.values import View, median
from jointstiff.solver.mechanics.block import unloaded_postures
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import PAST_DO_NOT_USE, length_text

_EQUAL: Final = 0.02
"""Greatest difference of a given moment from that of the force, relative to the median moment."""
_LEAST_LEVER: Final = 0.01
"""Least lever [m] of the force about a point that a moment of the force shows."""
_LEAST_ROWS: Final = 4
"""Least number of observations that show how their loads were stated."""
_ROUNDED: Final = 1e-6
"""Least distance [m] that a sentence states."""
_SAME_DIGITS: Final = 1e-9
"""Greatest difference of numbers that are equal but for their unit, relative to the greatest of them."""
_FACTORS_OF_UNITS: Final = np.multiply.outer([1.0, 180.0 / np.pi], [1e-3, 1.0, 1e3, 1e6]).ravel()
"""Ratios of the same number as a force in N or kN, and as an angle in degrees or a length in m or mm."""
_DISTINCT: Final = 0.8
"""Least fraction of different numbers in a column that shows a mistaken choice of columns."""
_ELSEWHERE: Final = 0.1
"""Least distance [m] between the load points of a set if they may be places in R0."""


@dataclass(frozen=True, eq=False)
class OtherLoads:
    """Measurements with loads that were perhaps meant, and the mistake in words."""

    measurements: Measurements
    cause: str  #: sentence on the loads as they were given
    change: str  #: what was changed, after "with"
    remedy: str


def turn_forces_with_flange(robot: Robot, measurements: Measurements) -> Iterator[OtherLoads]:
    """Yield the loads turned from the axes of the flange to R0, and turned the other way.

    Args:
        robot: n joints.
        measurements: N observations.
    """
    rotation = unloaded_postures(robot, measurements).flange_rotation
    ways = (
        (
            rotation,
            "the forces are in the axes of the flange, not of R0",
            "with the flange's orientation, F in R0 = R F",
        ),
        (
            rotation.transpose(0, 2, 1),
            "the forces seem to be turned the wrong way from the axes of the flange to R0",
            "twice with the flange's orientation R: once undoes the turn, and once more gives F in R0",
        ),
    )
    for turn, cause, words in ways:
        turned = replace(
            measurements,
            force=np.einsum("nij,nj->ni", turn, measurements.force),
            moment=np.einsum("nij,nj->ni", turn, measurements.moment),
        )
        remedy = f"give forces and moments in the axes of R0: turn those of each observation {words}"
        yield OtherLoads(turned, cause, "with all forces turned with the flange", remedy)


def move_moments(robot: Robot, measurements: Measurements) -> Iterator[OtherLoads]:
    """Yield the loads without the moment of the force about the origin of R0, and of the flange.

    Nothing is yielded without moments, or if the load point is at the origin.

    Args:
        robot: n joints.
        measurements: N observations.
    """
    if not measurements.moment.any():
        return
    postures = unloaded_postures(robot, measurements)
    lever = np.einsum("nij,nj->ni", postures.flange_rotation, measurements.load_point)
    points = {
        "R0": (postures.flange_translation + lever, "R0"),
        "the flange frame": (lever, "R0, from the flange"),
    }
    for origin, (point, axes) in points.items():
        if np.linalg.norm(point, axis=1).max() < _LEAST_LEVER:
            continue
        moment = measurements.moment - np.cross(point, measurements.force)
        yield OtherLoads(
            replace(measurements, moment=moment),
            f"the moments are about the origin of {origin}, not about the load point",
            "with the moment of the force at the load point subtracted",
            "give the moments about the load point: subtract from each moment the cross product of load "
            f"point and force, with the load point in the axes of {axes}",
        )


def find_other_columns(view: View) -> Finding | None:
    """Return the finding that forces are the numbers of a joint or a target; None without it.

    Such columns were chosen by mistake, as by a slice of a table that begins one column early.

    Args:
        view: measurement set.
    """
    measurements = view.measurements
    if len(measurements) < _LEAST_ROWS:
        return None
    columns = {
        f"the angles of {name}": measurements.joints[:, joint]
        for joint, name in enumerate(view.robot.joint_names)
    }
    as_read = view.as_read(measurements.position)
    for target in np.flatnonzero(view.measured.all(axis=0)).tolist():
        for axis, name in enumerate("xyz"):
            columns[f"{name} of target '{measurements.targets[target]}'"] = as_read[:, target, axis]
    for direction, force in zip("xyz", measurements.force.T, strict=True):
        for what, numbers in columns.items():
            if not _are_equal_but_for_unit(force, numbers):
                continue
            return view.build_finding(
                "repeated_readings",
                f"the forces along {direction} are {what} in all observations, digit by digit: the columns "
                "of the forces are others",
                "give the columns of Fx, Fy and Fz as forces: in arrays check where the slices of joints, "
                f"forces and targets begin; {PAST_DO_NOT_USE}",
                "do_not_use",
            )
    return None


def _are_equal_but_for_unit(numbers: FloatArray, others: FloatArray) -> bool:
    """Return whether numbers (N,) are others (N,) in some unit.

    Designed loads may be proportional to an angle, so the factor must be one of units, and most of the
    numbers must differ from each other.
    """
    size = float(np.abs(others).max())
    has_few_values = len(np.unique(others)) < _DISTINCT * len(others)
    if has_few_values or not size or not numbers.any():
        return False
    factor = float(numbers @ others) / float(others @ others)
    is_factor_of_unit = bool(np.isclose(np.abs(factor), _FACTORS_OF_UNITS, rtol=_SAME_DIGITS, atol=0.0).any())
    difference = np.abs(numbers - factor * others).max()
    return is_factor_of_unit and bool(difference <= _SAME_DIGITS * np.abs(numbers).max())


def find_moments_of_forces(view: View) -> Finding | None:
    """Return the finding that the moments are those of the forces at the load point; None without it.

    No fit is needed: such moments vanish with the moment of the force about that origin subtracted.

    Args:
        view: measurement set.
    """
    given = view.measurements
    has_moment = given.moment.any(axis=1)
    if has_moment.sum() < _LEAST_ROWS:
        return None
    sizes = np.linalg.norm(given.moment[has_moment], axis=1)
    for other in move_moments(view.robot, given):
        remaining = np.linalg.norm(other.measurements.moment, axis=1)
        if remaining.max() > _EQUAL * median(sizes):
            continue
        return view.build_finding(
            "frame_mistaken",
            f"{other.cause}: in all observations the moment is that of the force at the load point, within "
            f"{100 * _EQUAL:g} % of the median moment, so that it would count twice",
            "give the moments about the load point: here they are zero, so leave out the moments; "
            f"{PAST_DO_NOT_USE}",
            "do_not_use",
        )
    return None


def find_load_points_in_base(view: View) -> Finding | None:
    """Return the finding that load points of several observations are places in R0; None without it.

    They are at one place of the flange after a transform to the flange frame.

    Args:
        view: measurement set.
    """
    points = view.measurements.load_point
    if len(points) < _LEAST_ROWS or np.ptp(points, axis=0).max() < _ELSEWHERE:
        return None
    on_flange = view.postures.to_flange(points[:, None])[:, 0]
    usual = np.median(on_flange, axis=0)
    distances = np.linalg.norm(on_flange - usual, axis=1)
    if distances.max() > LARGEST_MODEL_ERROR:
        return None
    text = ", ".join(f"{1e3 * value:.1f}" for value in usual)
    return view.build_finding(
        "frame_mistaken",
        f"the load points are places in R0, not in the flange frame: as given they are up to "
        f"{length_text(_measure_spread(points))} apart, and after the transform to the flange frame of each "
        f"observation at one place within {length_text(max(float(distances.max()), _ROUNDED))}",
        f"give the load point in the flange frame: ({text}) mm; {PAST_DO_NOT_USE}",
        "do_not_use",
    )


def _measure_spread(points: FloatArray) -> float:
    """Return the diagonal [m] of the box around points (N, 3)."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))
