"""Lengths or angles in another unit, of a whole set or of some rows."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding, Unit
from jointstiff.solver.arrays import BoolArray
from jointstiff.solver.integrity.explain import Correction
from jointstiff.solver.integrity.places import (
    EXPLAINED,
    LARGEST_MODEL_ERROR,
    Places,
    change_positions,
    greatest_distances,
    see_from_flange,
)
from jointstiff.solver.integrity.values import OTHER_UNITS, View
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.text import length_text, list_labels

_FACTORS: Final[dict[Unit, tuple[float, str]]] = {
    "mm": (1e-3, "all lengths divided by 1000"),
    "m": (1e3, "all lengths multiplied by 1000"),
    "deg": (np.pi / 180.0, "all angles taken as degrees"),
    "rad": (180.0 / np.pi, "all angles taken as radians"),
}
"""True unit → factor on the numbers, and this change in words."""
_FOREIGN: Final = (
    ("cm", "mm", 10.0),
    ("cm", "m", 0.01),
    ("inch", "mm", 25.4),
    ("inch", "m", 0.0254),
)
"""True unit that a set cannot declare, declared unit, and factor on the numbers."""


def list_units(view: View) -> Iterator[Correction]:
    """Yield all lengths, all angles or both in another unit."""
    lengths: tuple[Unit, ...] = ("mm", "m")
    angles: tuple[Unit, ...] = ("deg", "rad")
    single = ((unit,) for unit in (*lengths, *angles))
    for units in (*single, *product(lengths, angles)):
        length = next((_FACTORS[unit][0] for unit in units if unit in lengths), 1.0)
        angle = next((_FACTORS[unit][0] for unit in units if unit in angles), 1.0)
        change = " and ".join(_FACTORS[unit][1] for unit in units)
        corrected = _scale(view, length, angle)
        yield Correction(OTHER_UNITS[units[0]].code, corrected, "", change, "", units=units)
    for true, declared, factor in _FOREIGN:
        yield Correction(
            "length_unit_suspect",
            _scale(view, factor),
            f"the lengths seem to be in {true}, not in {declared} as declared",
            f"all lengths multiplied by {factor:g}",
            f"multiply all lengths by {factor:g}: {true} to {declared}",
        )


def _scale(view: View, length: float, angle: float = 1.0) -> Measurements:
    """Return the measurements with all lengths and all angles multiplied by factors."""
    given = view.measurements
    return change_positions(
        given,
        length * given.position,
        length * (given.position + given.deflection),
        joints=given.joints * np.where(view.robot.prismatic, length, angle),
    )


def find_mixed_units(view: View) -> Finding | None:
    """Return the finding that some rows have another unit; None unless one change explains the set."""
    given, count = view.measurements, len(view.measurements)
    seen, moves = see_from_flange(view.postures, given)
    if not moves:
        return None
    splits: list[tuple[int, Correction, Places, BoolArray]] = []
    for each in list_units(view):
        postures = Postures(view.robot, view.robot.joint_map.model_angles(each.corrected.joints))
        other, _ = see_from_flange(postures, each.corrected)
        found = Places.agreeing(seen, other=other)
        changed = found.near & (greatest_distances(seen, found.flange) > LARGEST_MODEL_ERROR)
        if changed.any() and (found.near & ~changed).sum() >= 2 and len(each.units) < 2:
            splits.append((int(found.near.sum()), each, found, changed))
    if not splits:
        return None
    most, each, found, changed = max(splits, key=lambda split: split[0])
    if most < EXPLAINED * count:
        return None
    labels = list_labels(given.labels, np.flatnonzero(changed).tolist())
    where = f"{changed.sum()} of {count} observations ({labels})"
    cause = f"in {where}, {each.cause}"
    if each.units:
        quantity, other_unit, _ = OTHER_UNITS[each.units[0]]
        true_unit = each.units[0]
        cause = (
            f"the {quantity}s of {where} seem to be in {true_unit}, and those of all others in {other_unit}"
        )
    return view.build_finding(
        each.code,
        f"{cause}: with {each.change} in these rows alone, the targets keep their positions on the flange "
        f"in {most} "
        f"of {count} observations, within {length_text(float(found.distances[changed].max()))}",
        f"correct these observations alone: {each.change}",
        "do_not_use",
    )
