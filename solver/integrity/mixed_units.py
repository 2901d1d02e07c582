"""Rows whose angles or lengths have another unit than those of the other rows of the set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.integrity.mistakes import (
    EXPLAINED,
    LARGEST_MODEL_ERROR,
    Hypothesis,
    find_consensus_places,
    greatest_distances,
    propose_unit_mistakes,
)
from jointstiff.solver.integrity.values import OTHER_UNITS, View, transform_to_flange
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.text import length_text, list_labels

_LEAST_RIGHT: Final = 2
"""Least number of rows that fit only as given, so that not the whole set has another unit."""
_CONVERSIONS: Final = {
    "mm": "divide them by 1000",
    "m": "multiply them by 1000",
    "deg": "convert them from deg to rad",
    "rad": "convert them from rad to deg",
}
"""Unit that numbers of some rows have → remedy that gives them the unit of all other rows."""


@dataclass(frozen=True, eq=False)
class _MixedRows:
    """Rows that fit as given, and rows that fit after a change of their unit."""

    hypothesis: Hypothesis
    fits_as_given: BoolArray  #: (M,)
    fits_changed: BoolArray  #: (M,) mask of the rows that fit only after the change
    farthest: float  #: greatest distance of a target from its place in these rows [m]

    @property
    def explained(self) -> int:
        """Return the number of rows that fit in either unit."""
        return int((self.fits_as_given | self.fits_changed).sum())


def find_mixed_units(view: View, rows: IndexArray, seen_from_flange: FloatArray) -> Finding | None:
    """Return the finding that some rows have another unit; None unless one change of them explains the set.

    Args:
        view: measurement set.
        rows: (M,) indices of rows with positions.
        seen_from_flange: (M, T, 3) targets of these rows in the flange frame, as given [m].
    """
    position = view.measurements.position[rows][np.isfinite(seen_from_flange[..., 0])]
    if position.std(axis=0).max() <= LARGEST_MODEL_ERROR:
        return None  # targets that hardly move keep their places under any angles
    trials = []
    for hypothesis in propose_unit_mistakes(view.measurements.joints[rows], view.robot.prismatic):
        trial = _split_rows(view, rows, seen_from_flange, hypothesis)
        if trial.fits_as_given.sum() >= _LEAST_RIGHT and trial.fits_changed.any():
            trials.append(trial)
    best = max(trials, key=lambda trial: trial.explained, default=None)
    if best is None or best.explained < EXPLAINED * len(rows):
        return None
    hypothesis, changed = best.hypothesis, rows[best.fits_changed]
    names = list_labels(view.measurements.labels, changed.tolist())
    message_of_fit = (
        f"with {hypothesis.change} in these rows alone, the targets keep their positions on the flange in "
        f"{best.explained} of {len(rows)} observations, within {length_text(best.farthest)}"
    )
    count = f"{len(changed)} of {len(rows)} observations ({names})"
    if not hypothesis.units:
        return view.build_finding(
            hypothesis.code,
            f"in {count}, {hypothesis.cause}: {message_of_fit}",
            f"multiply the lengths of these observations alone by {hypothesis.length:g}",
            "do_not_use",
        )
    (unit,) = hypothesis.units
    quantity, other, code = OTHER_UNITS[unit]
    return view.build_finding(
        code,
        f"the {quantity}s of {count} seem to be in {unit}, and those of all others in {other}: "
        f"{message_of_fit}",
        f"correct the {quantity}s of these observations alone: {_CONVERSIONS[unit]}",
        "do_not_use",
    )


def _split_rows(
    view: View, rows: IndexArray, seen_from_flange: FloatArray, hypothesis: Hypothesis
) -> _MixedRows:
    """Find the places on the flange on which most rows agree, as given or after the change of their unit."""
    postures = Postures(view.robot, view.robot.joint_map.model_angles(hypothesis.joints))
    position = hypothesis.length * view.measurements.position[rows]
    measured = np.isfinite(seen_from_flange[..., 0])
    changed = transform_to_flange(postures, position, measured)
    places = find_consensus_places(np.concatenate([seen_from_flange, changed]))
    distances = greatest_distances(changed, places)
    fits_as_given = greatest_distances(seen_from_flange, places) <= LARGEST_MODEL_ERROR
    fits_changed = (distances <= LARGEST_MODEL_ERROR) & ~fits_as_given
    farthest = float(distances[fits_changed].max(initial=0.0))
    return _MixedRows(hypothesis, fits_as_given, fits_changed, farthest)
