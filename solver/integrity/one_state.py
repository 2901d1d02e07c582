"""Mistakes in the readings of one state, without or with load: another unit, exchanged axes, missed readings.

Under load the targets are within millimetres of their unloaded positions. If one factor or one exchange of
axes brings the readings of one state to those of the other state, the places on the flange show which of the
two states is wrong. Coordinates are compared as they were read, in the axes of the instrument.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.integrity.values import LARGEST_DEFLECTION, View
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.text import length_text, list_labels

_LEAST_ROWS: Final = 4
"""Least number of observations that show a mistake in all readings of one state."""
_FAR: Final = 0.5
"""Fraction of the readings of a target that are far apart in the two states if one state is mistaken."""
_SAME_NUMBERS: Final = 0.01
"""Greatest relative difference of the positions of the two states after a change of the unit."""
_ZERO: Final = 1e-9
"""Greatest distance [m] from the origin of a reading that is stored as zeros."""
_LARGEST_COPIED_SHARE: Final = 0.5
"""Largest fraction of the readings under load that may be copies: others show that the load moves targets."""
_USUAL_LOAD: Final = 0.5
"""Least size of a load whose readings are compared, relative to the median size."""
_SHOWN: Final = 4
"""Greatest number of groups of targets, and of observations of a group, that a message lists."""
_LARGEST_SHARE_OF_ZEROS: Final = 0.05
"""Largest fraction of zeros among the coordinates of other deflections: where coarse digits make more of them
zero, all coordinates of a deflection may be zero by rounding."""


@dataclass(frozen=True, eq=False)
class _States:
    """Positions (N, T, 3) of the targets in both states, as they were read; NaN where not measured [m]."""

    unloaded: FloatArray
    loaded: FloatArray

    @classmethod
    def of(cls, view: View) -> _States:
        """Return the positions of a measurement set."""
        measurements = view.measurements
        measured = view.measured[..., None]
        unloaded = np.where(measured, measurements.position, np.nan)
        loaded = unloaded + measurements.deflection
        return cls(view.as_read(unloaded), view.as_read(loaded))


def leave_out_zeros(view: View) -> tuple[list[Finding], View]:
    """Report readings that are 0, 0, 0, as instruments store a point that they missed.

    Returns:
        The finding, if any; and the set without these readings.
    """
    states = _States.of(view)
    zero_unloaded, zero_loaded = (
        np.nan_to_num(np.linalg.norm(each, axis=2), nan=np.inf) <= _ZERO
        for each in (states.unloaded, states.loaded)
    )
    is_zero = zero_unloaded | zero_loaded
    if view.measurements.unloaded_only is not None:
        zero_loaded &= ~view.measurements.unloaded_only
    if not is_zero.any():
        return [], view
    if (finding := _find_deflections_as_loaded(view, states, zero_unloaded)) is not None:
        no_positions = replace(view.measurements, present=np.zeros_like(view.measurements.present))
        return [finding], replace(view, measurements=no_positions)
    labels = view.measurements.labels
    # State and observations in words → targets
    places: dict[tuple[str, str], list[str]] = {}
    for target in np.flatnonzero(is_zero.any(axis=0)).tolist():
        for state, zeros in (
            ("unloaded and loaded readings", zero_unloaded & zero_loaded),
            ("unloaded readings", zero_unloaded & ~zero_loaded),
            ("loaded readings", zero_loaded & ~zero_unloaded),
        ):
            rows = np.flatnonzero(zeros[:, target]).tolist()
            if rows:
                targets = places.setdefault((state, list_labels(labels, rows)), [])
                targets.append(f"'{view.measurements.targets[target]}'")
    texts = [f"the {state} of {', '.join(targets)} in {where}" for (state, where), targets in places.items()]
    message = f"{', and '.join(texts)} are 0, 0, 0, as instruments store a point that they did not read"
    remedy = (
        "leave out the readings of the target in these observations, unloaded and loaded: in an array give "
        "NaN, in a table leave the cells empty, in JSON remove the reading"
    )
    measurements, kept = view.measurements, ~is_zero[..., None]
    without = replace(
        measurements,
        present=measurements.present & ~is_zero,
        position=np.where(kept, measurements.position, 0.0),
        deflection=np.where(kept, measurements.deflection, 0.0),
    )
    finding = view.build_finding("target_off_model", message, remedy, "do_not_use")
    return [finding], replace(view, measurements=without)


def _find_deflections_as_loaded(view: View, states: _States, zero_unloaded: BoolArray) -> Finding | None:
    """Return the finding that deflections were given as loaded readings, with zeros as unloaded readings.

    None unless all unloaded readings are zero, and all loaded readings are as small as deflections. A set
    with unloaded readings alone has none.
    """
    if view.measurements.unloaded_only is not None:
        return None
    read = view.measured
    sizes = np.linalg.norm(states.loaded, axis=2)[read]
    if not (zero_unloaded[read].all() and 0.0 < sizes.max(initial=0.0) <= LARGEST_DEFLECTION):
        return None
    message = (
        "all unloaded readings are 0, 0, 0, and all loaded readings are within "
        f"{length_text(float(sizes.max()))} of the origin: the loaded readings seem to be deflections, "
        "loaded minus unloaded"
    )
    remedy = (
        "give these numbers as deflections, without unloaded and loaded readings: in arrays as "
        "`deflections`, in a table under headers such as `P10 dx [mm]`, in JSON as `deflection`; and state "
        "the targets' places in the flange frame"
    )
    return view.build_finding("deflection_implausibly_large", message, remedy, "do_not_use")


def leave_out_copied_states(view: View) -> tuple[list[Finding], View]:
    """Report targets whose readings with and without the load are equal in every digit.

    Such a load was not applied, or one reading was copied. A load much smaller than the others may move
    targets by less than the last digit, so that its readings are not compared. Where many coordinates of
    deflections are zero, rounding or a load that bends no joint explains equal readings.

    Returns:
        The finding, if any; and the set without these readings.
    """
    measurements = view.measurements
    under_load = view.measured & _find_usual_loads(measurements)[:, None]
    is_copied = under_load & (measurements.deflection == 0.0).all(axis=2)
    moved = measurements.deflection[under_load & ~is_copied]
    if not is_copied.any() or is_copied.sum() > _LARGEST_COPIED_SHARE * under_load.sum():
        return [], view
    share_of_zeros = float((moved == 0.0).mean())
    if share_of_zeros > _LARGEST_SHARE_OF_ZEROS:
        return [], view
    places = _list_copies(measurements, is_copied)
    typical = float(np.median(np.linalg.norm(moved, axis=1)))
    message = (
        f"the readings with and without the load are equal in every digit: {'; '.join(places)}; the other "
        f"readings moved by {length_text(typical)} in the median, so the load was not on, or a reading was "
        "copied"
    )
    remedy = "read these observations again, or leave them out"
    is_partly_copied = is_copied.any(axis=1) & (view.measured & ~is_copied).any(axis=1)
    if is_partly_copied.any():
        remedy = (
            "read these targets again, or leave out their readings: in an array give NaN, in a table leave "
            "the cells empty, in JSON remove the reading"
        )
    without = replace(
        measurements,
        present=measurements.present & ~is_copied,
        position=np.where(is_copied[..., None], 0.0, measurements.position),
    )
    finding = view.build_finding("deflection_implausibly_small", message, remedy, "do_not_use")
    return [finding], replace(view, measurements=without)


def _list_copies(measurements: Measurements, is_copied: BoolArray) -> list[str]:
    """Return in words the targets and observations with equal readings, by groups of equal targets.

    Args:
        measurements: Observations with the readings.
        is_copied: Mask (N, T) of the equal readings.
    """
    patterns = np.unique(is_copied[is_copied.any(axis=1)], axis=0)
    places = list[str]()
    for pattern in patterns[:_SHOWN]:
        rows = np.flatnonzero((is_copied == pattern).all(axis=1)).tolist()
        targets = [f"'{measurements.targets[target]}'" for target in np.flatnonzero(pattern).tolist()]
        places.append(f"{', '.join(targets)} in {list_labels(measurements.labels, rows[:_SHOWN])}")
    if is_copied.any(axis=1).sum() > _SHOWN:
        places.append(f"{is_copied.sum()} readings in all")
    return places


def _find_usual_loads(measurements: Measurements) -> BoolArray:
    """Return a mask (N,) of the observations whose force or moment is at least half of the median size."""
    is_usual = np.zeros(len(measurements), dtype=np.bool_)
    for vectors in (measurements.force, measurements.moment):
        sizes = np.linalg.norm(vectors, axis=1)
        if sizes.any():
            is_usual |= sizes >= _USUAL_LOAD * np.median(sizes[sizes > 0.0])
    return is_usual
