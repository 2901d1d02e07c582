"""Targets whose unloaded and loaded readings are exchanged in all observations.

The flange is rigid: distances between targets are the same in both states. If the readings of one target are
exchanged, its distances to the others change by the motion under load: the score is what is left of these
changes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from scipy import special

from jointstiff.schemas.finding import AdvisedAction, Finding
from jointstiff.solver.arrays import BoolArray
from jointstiff.solver.integrity.explain import Correction, explain
from jointstiff.solver.integrity.response import Springs
from jointstiff.solver.integrity.values import FALSE_ALARM, MEDIAN_EFFICIENCY, MEDIAN_SIZE, View, median
from jointstiff.solver.mechanics.block import get_whole_block
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.text import length_text

_LEAST_ROWS: Final = 4
_LEAST_SCATTER: Final = 1e-9
"""Least scatter [m] of distances, so that rounding of exact readings proves nothing."""
_MOST: Final = 3
"""Most targets that are exchanged together, or half of the targets."""


@dataclass(frozen=True)
class Rigid:
    """Scatter of the distances between targets over observations and states [m]."""

    unexplained: float

    @classmethod
    def of(cls, view: View, given: Measurements) -> Rigid:
        """Measure the scatter by medians, so that some mistaken rows do not change it."""
        loaded, squares = given.position + given.deflection, []
        for i, j in combinations(range(len(given.targets)), 2):
            rows = view.measured[:, i] & view.measured[:, j]
            if rows.sum() >= _LEAST_ROWS:
                pair = np.concatenate([state[rows, i] - state[rows, j] for state in (given.position, loaded)])
                distances = np.linalg.norm(pair, axis=1)
                scatter = median(np.abs(distances - median(distances))) / MEDIAN_SIZE
                squares.append(max(scatter, _LEAST_SCATTER) ** 2)
        return cls(float(np.sqrt(np.mean(squares))) if squares else 0.0)


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


def list_exchanges(given: Measurements, most: int, limit: float) -> Iterator[Correction]:
    """Yield the exchanges of the two states of some targets, of few targets first."""
    count = len(given.targets)
    for size in range(1, most + 1):
        for chosen in combinations(range(count), size):
            names = [given.targets[target] for target in chosen]
            words = ", ".join(f"'{name}'" for name in names)
            yield Correction(
                "deflection_against_force",
                exchange_targets(given, np.isin(np.arange(count), chosen)),
                f"the unloaded and the loaded readings of {words} are exchanged in all observations",
                "after the exchange",
                f"exchange the unloaded and the loaded readings of {words}",
                AdvisedAction.of("exchange_readings", targets=names),
                limit=limit,
                may_reverse=False,  # the other targets are exchanged instead
            )


def exchange_proved_targets(view: View) -> tuple[list[Finding], View]:
    """Report targets whose unloaded and loaded readings are exchanged, as distances between targets prove.

    Distances show which targets differ from the others, not which of the two groups is exchanged: springs
    yield to the load in one of the two cases only.

    Returns:
        The finding, if any; and the set without the exchange.
    """
    given, count = view.measurements, len(view.measurements.targets)
    as_given = Rigid.of(view, given)
    # A variance from a median has fewer degrees of freedom than values: two distances in each row.
    freedom = 2.0 * MEDIAN_EFFICIENCY * max(int(view.measured.all(axis=1).sum()), _LEAST_ROWS)
    limit = float(special.fdtri(freedom, freedom, 1.0 - FALSE_ALARM / count)) ** -0.5
    few = list_exchanges(given, min(_MOST, count // 2), limit)
    found = explain(as_given, [few], lambda each: Rigid.of(view, each.corrected), np.inf, 0.0)
    if found is None:
        return [], view
    correction, mended = found
    rows = np.flatnonzero(view.loaded)
    both = [
        correction,
        *(each for each in list_exchanges(given, count - 1, limit) if _are_others(each, correction, count)),
    ]
    evidence = (
        f"distances to the other targets scatter by {length_text(as_given.unexplained)}, and after the "
        "exchange by "
        f"{length_text(mended.unexplained)}"
    )
    if int(given.coordinates[rows].sum()) < 6 * view.robot.n:
        remedy = f"find out which readings are without load; {both[0].remedy} or those of the other targets"
        cause = f"{both[0].cause}, or those of the other targets"
        finding = view.build_finding(correction.code, f"{cause}: {evidence}", remedy, "do_not_use")
        return [finding], replace(view, measurements=correction.corrected)
    works = [Springs.fit(get_whole_block(view.robot, each.corrected[rows])).work for each in both]
    chosen = both[int(np.argmax(works))]
    finding = view.build_finding(
        chosen.code, f"{chosen.cause}: {evidence}", chosen.remedy, "do_not_use", chosen.action
    )
    return [finding], replace(view, measurements=chosen.corrected)


def _are_others(first: Correction, second: Correction, count: int) -> bool:
    """Return whether two corrections exchange all targets, each target once."""
    names = (
        [*(first.action.targets or ()), *(second.action.targets or ())]
        if first.action and second.action
        else []
    )
    return len(names) == count == len(set(names))
