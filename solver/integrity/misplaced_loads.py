"""Loads that are stated in another way than measurement sets have them.

Forces along the axes of the flange turn with the flange. Moments about the origin of R0 or of the flange
contain the moment of the force, which its load point adds again. Load points in R0 move with the robot.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.integrity.places import LARGEST_MODEL_ERROR
from jointstiff.solver.integrity.values import View
from jointstiff.solver.text import PAST_DO_NOT_USE, length_text

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
