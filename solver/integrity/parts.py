"""Readings of one state or of one target in other axes or in another unit, or that are deflections."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations, product
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.integrity.explain import Correction
from jointstiff.solver.integrity.places import (
    change_positions,
)
from jointstiff.solver.integrity.values import LENGTH_UNITS, View
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.text import figure

LEAST_ROWS: Final = 4
"""Least number of rows that show a mistake of one state or one target, or another robot."""


STATES: Final = ("unloaded", "loaded")


def list_states(view: View) -> Iterator[Correction]:
    """Yield loaded readings that are deflections."""
    given = view.measurements
    if given.direction is not None or not (given.deflection != 0.0).any() or len(given) < LEAST_ROWS:
        return
    yield Correction(
        "deflection_implausibly_large",
        change_positions(given, given.position, 2.0 * given.position + given.deflection),
        "the loaded readings seem to be deflections, loaded minus unloaded",
        "the unloaded positions added to the loaded readings",
        "add the unloaded positions to the loaded readings",
    )


def _list_factors() -> Iterator[tuple[str, str, float]]:
    """Yield true unit, declared unit, and factor on the numbers."""
    for greater, smaller, ratio in LENGTH_UNITS:  # such as mm, m and 1000
        yield greater, smaller, 1.0 / ratio
        yield smaller, greater, ratio


def list_parts(view: View) -> Iterator[Correction]:
    """Yield the readings of one state, or of one target, in other axes or another unit."""
    given = view.measurements
    whole = np.ones((2, len(given.targets)), dtype=np.bool_)
    parts = []
    if given.direction is None and given.deflection.any():
        for number, name in enumerate(STATES):
            parts.append((whole & (np.arange(2) == number)[:, None], f"all {name} readings"))
    for target, name in enumerate(given.targets if len(given.targets) > 1 else ()):
        if view.measured[:, target].sum() >= LEAST_ROWS:
            own = whole & (np.arange(len(given.targets)) == target)
            parts.append((own, f"all readings of '{name}'"))
    for mask, whose in parts:
        cause = f"{whose} disagree with the others, which have their places on the flange"
        for axes, words in list_axes():
            yield Correction(
                "target_off_model",
                change_part(view, mask, axes),
                f"{cause}. With {words} of its readings as x, y, z, they agree",
                "these axes",
                f"give {words} of {whose} as x, y, z, and leave the others as they are",
            )
        for true, declared, factor in _list_factors():
            yield Correction(
                "length_unit_suspect" if mask.all(axis=1).any() else "target_off_model",
                change_part(view, mask, factor * np.eye(3)),
                f"{cause}: they seem to be in {true} where the others are in {declared}",
                "this unit",
                f"convert {whose} from {true} to {declared}: multiply them by {figure(factor)}",
            )


def change_part(
    view: View, mask: BoolArray, axes: FloatArray, order: IndexArray | None = None
) -> Measurements:
    """Return measurements in which the readings r of some states and targets (2, T) are ``axes r``.

    With `order` (N,), row i has the reading of row `order[i]`.
    """
    given = view.measurements
    states = (given.position, given.position + given.deflection)
    changed = []
    for own, positions in zip(mask, states, strict=True):
        read = view.as_read(positions if order is None else positions[order]) @ axes.T
        changed.append(np.where(own[:, None], view.to_base(read), positions))
    return change_positions(given, *changed)


def list_left_out(view: View) -> Iterator[Correction]:
    """Yield the set without one target, whose mistake is not known."""
    given = view.measurements
    for target, name in enumerate(given.targets if len(given.targets) > 1 else ()):
        present = given.present.copy()
        present[:, target] = False
        without = replace(given, present=present)
        yield Correction(
            "target_off_model",
            change_positions(without, given.position, given.position + given.deflection),
            f"target '{name}' is at no place on the flange; the other targets keep theirs",
            "the other targets alone",
            f"check which point was read as '{name}', and its columns; or leave out this target",
        )


def list_axes() -> Iterator[tuple[FloatArray, str]]:
    """Yield exchanged and reversed axes (3, 3) and their names, fewest reversals first."""
    for signs in sorted(product((1.0, -1.0), repeat=3), key=lambda each: -sum(each)):
        for order in permutations(range(3)):
            axes = np.array(signs)[:, None] * np.eye(3)[list(order)]
            if not np.array_equal(axes, np.eye(3)):
                yield axes, name_axes(axes)


def name_axes(axes: FloatArray) -> str:
    """Return the coordinates that axes (3, 3) take as x, y and z, such as `z, y, −x`."""
    return ", ".join(
        ("−" if row.min() < 0.0 else "") + "xyz"[int(np.abs(row).argmax())] for row in axes.round()
    )
