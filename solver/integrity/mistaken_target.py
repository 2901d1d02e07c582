"""Mistakes in all readings of one target, while the other targets keep their places on the flange."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, permutations
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.integrity.mistakes import (
    EXPLAINED,
    LARGEST_MODEL_ERROR,
    find_consensus_places,
    greatest_distances,
    sample_rows,
)
from jointstiff.solver.integrity.values import LENGTH_UNITS, View, transform_to_flange
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.text import PAST_DO_NOT_USE, length_text

_LEAST_ROWS: Final = 4
"""Least number of observations of a target that show a mistake in all its readings."""


def inspect_equal_targets(view: View) -> Iterator[Finding]:
    """Report pairs of targets whose readings are equal in every digit in all observations of both."""
    measurements = view.measurements
    readings = np.concatenate([measurements.position, measurements.deflection], axis=2)
    for first, second in combinations(range(len(measurements.targets)), 2):
        both = measurements.present[:, first] & measurements.present[:, second]
        are_few = int(both.sum()) < _LEAST_ROWS
        if are_few or not np.array_equal(readings[both, first], readings[both, second]):
            continue
        names = [measurements.targets[target] for target in (first, second)]
        yield view.build_finding(
            "repeated_readings",
            f"the targets '{names[0]}' and '{names[1]}' have the same readings to the last digit in "
            f"{both.sum()} observations: they count as two targets, and were read once",
            f"give '{names[1]}' its own readings, or leave out this target; {PAST_DO_NOT_USE}",
            "do_not_use",
        )


def find_mistaken_target(view: View, rows: IndexArray) -> Finding | None:
    """Return the finding that one target alone has no place on the flange; None unless one is alone.

    Exchanged or reversed coordinates of the target are tried, and named if they explain its readings.

    Args:
        view: measurement set.
        rows: (M,) indices of rows with positions.
    """
    sample = sample_rows(rows)
    measured = view.measured[sample]
    seen_from_flange = np.where(measured[..., None], view.places[sample], np.nan)
    for target in np.flatnonzero(measured.sum(axis=0) >= _LEAST_ROWS).tolist():
        others = np.delete(seen_from_flange, target, axis=1)
        has_others = np.isfinite(others[..., 0]).any(axis=1)
        of_others = _measure_distances(others[has_others])
        of_target = _measure_distances(seen_from_flange[measured[:, target], target, None])
        if _agree(of_others) and not _agree(of_target):
            return _report_mistaken_target(view, sample[measured[:, target]], target, of_others, of_target)
    return None


def _measure_distances(seen_from_flange: FloatArray) -> FloatArray:
    """Return for each row (M,) the greatest distance of its targets (M, T, 3) from their usual places [m]."""
    if len(seen_from_flange) < _LEAST_ROWS:
        return np.full(len(seen_from_flange), np.inf)
    return greatest_distances(seen_from_flange, find_consensus_places(seen_from_flange))


def _agree(distances: FloatArray) -> bool:
    """Return whether most rows have their targets at the same places on the flange."""
    return bool(np.mean(distances <= LARGEST_MODEL_ERROR) >= EXPLAINED) if len(distances) else False


def _report_mistaken_target(
    view: View, rows: IndexArray, target: int, of_others: FloatArray, of_target: FloatArray
) -> Finding:
    """Build the finding that a target has no place on the flange, with the coordinates that explain it.

    Args:
        view: measurement set.
        rows: (M,) indices of the rows that were compared, in which the target was read.
        target: index of the target.
        of_others: distances of the other targets from their places, for each row [m].
        of_target: (M,) distances of the target from its usual place [m].
    """
    name = view.measurements.targets[target]
    agreeing: BoolArray = of_others <= LARGEST_MODEL_ERROR
    message = (
        f"target '{name}' is at one place on the flange in only {(of_target <= LARGEST_MODEL_ERROR).sum()} "
        f"of {len(rows)} observations; the other targets keep theirs within "
        f"{length_text(float(of_others[agreeing].max()))}"
    )
    remedy = f"check which point was read as '{name}', and its columns; or leave out this target"
    axes, units = _find_axes(view, rows, target), _find_units(view, rows, target)
    if axes is not None:
        message += f". With {axes} of its readings as x, y, z, the target keeps its place"
        remedy = f"give {axes} of '{name}' as x, y, z"
    elif units is not None:
        its_unit, unit_of_others = units
        message += (
            f". If its readings are in {its_unit} where the others are in {unit_of_others}, the target keeps "
            "its place"
        )
        remedy = f"convert the readings of '{name}' from {its_unit} to {unit_of_others}"
    return view.build_finding("target_off_model", message, f"{remedy}; {PAST_DO_NOT_USE}", "do_not_use")


def _find_axes(view: View, rows: IndexArray, target: int) -> str | None:
    """Return the coordinates of a target, such as `y, −x, z`, that give it a place; None without any."""
    position = view.measurements.position[rows, target]
    for order in permutations(range(3)):
        for signs in np.ndindex(2, 2, 2):
            factors = 1.0 - 2.0 * np.array(signs)
            if _have_one_place(view, rows, factors * position[:, list(order)]):
                names = zip(factors, order, strict=True)
                return ", ".join(("−" if factor < 0.0 else "") + "xyz"[axis] for factor, axis in names)
    return None


def _find_units(view: View, rows: IndexArray, target: int) -> tuple[str, str] | None:
    """Return the unit of a target's readings, and that of the others, that give it a place.

    None if no unit gives the target a place.
    """
    as_read = view.as_read(view.measurements.position[rows, target])
    for greater, smaller, ratio in LENGTH_UNITS:  # such as mm, m and 1000
        if _have_one_place(view, rows, view.to_base(ratio * as_read)):
            return smaller, greater
        if _have_one_place(view, rows, view.to_base(as_read / ratio)):
            return greater, smaller
    return None


def _have_one_place(view: View, rows: IndexArray, positions: FloatArray) -> bool:
    """Return whether positions (M, 3) in R0 [m], read in M rows, have one place on the flange."""
    postures = Postures(view.robot, view.robot.joint_map.model_angles(view.measurements.joints[rows]))
    was_read = np.ones((len(rows), 1), dtype=np.bool_)
    return _agree(_measure_distances(transform_to_flange(postures, positions[:, None], was_read)))
