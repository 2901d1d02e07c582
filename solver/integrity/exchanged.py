"""Targets whose unloaded and loaded readings are exchanged in all observations.

All targets are fixed to one flange, so that their distances are equal without and with load. If the two
readings of a target are exchanged, its distances to the other targets change by parts of its deflection.
The test exchanges the readings again: the distances then scatter far less. Without a mistake, an exchange can
only increase the scatter, so that neither noise nor one inaccurate target gives a finding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from jointstiff.schemas.finding import AdvisedAction, Finding
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.integrity.values import FALSE_ALARM, MEDIAN_EFFICIENCY, MEDIAN_SIZE, View, median
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.text import length_text

_LEAST_ROWS = 4
"""Least number of observations in which both targets of a pair were read."""
_LEAST_SCATTER = 1e-6
"""Least scatter of a distance [m], so that rounding of exact readings is not a scatter."""


@dataclass(frozen=True, eq=False)
class ExchangedTargets:
    """Targets whose exchanged readings the distances of targets prove."""

    targets: BoolArray  #: (T,) mask; the distances fit the mask of all other targets equally well
    scatter: float  #: scatter of the distances between these targets and the others, as posted [m]
    mended_scatter: float  #: scatter of these distances after the exchange [m]


def exchange_targets(measurements: Measurements, targets: BoolArray) -> Measurements:
    """Return the measurements with unloaded and loaded readings of some targets exchanged.

    `targets` (T,) is a mask.
    """
    position, deflection = measurements.position, measurements.deflection
    exchanged = targets[:, None]
    measured = exchanged & ~measurements.in_flange[..., None]  # places that were stated stay as they are
    return replace(
        measurements,
        position=np.where(measured, position + deflection, position),
        deflection=np.where(exchanged, -deflection, deflection),
    )


def report_exchanged_targets(
    view: View, targets: BoolArray, evidence: str, others: BoolArray | None = None
) -> Finding:
    """Build the finding that unloaded and loaded readings of some targets are exchanged.

    Args:
        view: measurement set.
        targets: (T,) mask of the targets with exchanged readings.
        evidence: figures before and after the exchange, in words.
        others: (T,) mask of targets that may be exchanged instead; None if `targets` are certain.
    """
    names = np.array(view.measurements.targets)
    words = _quote(names[targets])
    if others is None:
        reason, remedy, action = (
            f"the unloaded and the loaded readings of {words} are exchanged in all observations",
            f"exchange the unloaded and the loaded readings of {words}",
            AdvisedAction.of("exchange_readings", targets=names[targets].tolist()),
        )
    else:
        either = f"either {words} or {_quote(names[others])}"
        reason, action = (
            f"the unloaded and the loaded readings of {either} are exchanged in all observations",
            None,
        )
        remedy = f"find out which readings are without load; exchange the readings of {either}"
    return view.build_finding(
        "deflection_against_force", f"{reason}: {evidence}", remedy, "do_not_use", action
    )


def _quote(names: Sequence[str] | FloatArray) -> str:
    """Return the names of targets in quotation marks, separated by commas."""
    return ", ".join(f"'{name}'" for name in names)


def describe_distances(exchanged: ExchangedTargets) -> str:
    """Return the scatter of the distances before and after the exchange, in words."""
    return (
        f"distances to the other targets scatter by {length_text(exchanged.scatter)}, and after the exchange "
        f"by {length_text(exchanged.mended_scatter)}"
    )


def find_exchanged_targets(view: View) -> ExchangedTargets | None:
    """Find the targets whose exchanged readings the distances of targets prove; None without a proof."""
    first, second = np.triu_indices(view.measured.shape[1], k=1)
    row_counts = (view.measured[:, first] & view.measured[:, second]).sum(axis=0)
    first, second, row_counts = (each[row_counts >= _LEAST_ROWS] for each in (first, second, row_counts))
    if not len(first):
        return None
    as_posted, exchanged = _compute_pair_variances(view, first, second)
    targets = _choose_targets(view.measured.shape[1], first, second, as_posted, exchanged)
    if 2 * targets.sum() > len(targets):
        targets = ~targets
    for target in np.flatnonzero(targets).tolist():
        is_crossing = (targets[first] != targets[second]) & ((first == target) | (second == target))
        # A variance from a median has fewer degrees of freedom than values: two distances in each row.
        freedom = 2.0 * MEDIAN_EFFICIENCY * float(row_counts[is_crossing].mean())
        limit = special.fdtri(freedom, freedom, 1.0 - FALSE_ALARM / len(targets))
        if not as_posted[is_crossing].sum() > limit * exchanged[is_crossing].sum():
            targets[target] = False
    is_crossing = targets[first] != targets[second]
    if not is_crossing.any():
        return None
    scatter, mended_scatter = (
        float(np.sqrt(variances[is_crossing].mean())) for variances in (as_posted, exchanged)
    )
    return ExchangedTargets(targets, scatter, mended_scatter)


def _compute_pair_variances(
    view: View, first: IndexArray, second: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Return the variance (P,) of the distance of each pair of targets [m²]: as posted, and exchanged.

    The variances are from medians, so that some mistaken rows do not change them. `first` and `second` (P,)
    are the indices of the targets of each pair; exchanged are the readings of one of the two targets.
    """
    measurements, variances = view.measurements, []
    unloaded, loaded = measurements.position, measurements.position + measurements.deflection
    for others in ((unloaded, loaded), (loaded, unloaded)):
        of_pairs = np.empty(len(first))
        for pair, (i, j) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
            rows = view.measured[:, i] & view.measured[:, j]
            distances = np.concatenate(
                [
                    np.linalg.norm(state[rows, i] - other[rows, j], axis=1)
                    for state, other in zip((unloaded, loaded), others, strict=True)
                ]
            )
            of_pairs[pair] = median(np.abs(distances - median(distances))) / MEDIAN_SIZE
        variances.append(np.maximum(of_pairs, _LEAST_SCATTER) ** 2)
    return variances[0], variances[1]


def _choose_targets(
    count: int, first: IndexArray, second: IndexArray, as_posted: FloatArray, exchanged: FloatArray
) -> BoolArray:
    """Return a mask (T,) of the targets whose exchange gives the least sum of variances of the distances.

    One target after the other is exchanged, or exchanged back, while the sum decreases.

    Args:
        count: number of targets T.
        first: (P,) index of the first target of each pair.
        second: (P,) index of the second target of each pair.
        as_posted: (P,) variance of each distance if both targets or no target are exchanged [m²].
        exchanged: (P,) variance of each distance if one of the two targets is exchanged [m²].
    """
    targets = np.zeros(count, dtype=np.bool_)
    while True:
        is_crossing = targets[first] != targets[second]
        gain = np.where(is_crossing, exchanged - as_posted, as_posted - exchanged)
        gains = np.bincount(first, gain, count) + np.bincount(second, gain, count)
        best = int(gains.argmax())
        # A gain of rounding would exchange targets for ever.
        if not gains[best] > 1e-9 * float(as_posted.sum()):
            return targets
        targets[best] = ~targets[best]
