"""Mistakes of a whole set of readings that the places of targets on the flange show.

Each mistake is a correction of the measurements; `explain` chooses the one after which the targets keep their
places. Frames and lengths are fitted in closed form (method.md §17).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding, Verdict
from jointstiff.solver.integrity.explain import Correction, explain
from jointstiff.solver.integrity.frames import list_frames, list_scales
from jointstiff.solver.integrity.joints import (
    list_joint_maps,
    list_joint_mistakes,
    list_missing_signs,
    list_zeros,
)
from jointstiff.solver.integrity.orders import list_orders, list_orders_of_states
from jointstiff.solver.integrity.parts import list_left_out, list_parts, list_states
from jointstiff.solver.integrity.places import (
    LARGEST_MODEL_ERROR,
    Places,
)
from jointstiff.solver.integrity.robots import inspect_other_robots
from jointstiff.solver.integrity.units import find_mixed_units, list_units
from jointstiff.solver.integrity.values import View
from jointstiff.solver.meaning.decision import USUAL_RESIDUAL
from jointstiff.solver.mechanics.robot import KnownRobot
from jointstiff.solver.text import PAST_CARE, PAST_DO_NOT_USE, length_text

_ROUNDING: Final = 2e-4
"""Difference of distances [m] that tells nothing."""
_LARGEST_SET: Final = 1000
"""Greatest number of rows that are searched for a mistake of the whole set."""
_BY_ZERO: Final = 1.0 / 3.0


def find_mistakes(view: View, others: Iterable[KnownRobot]) -> list[Finding]:
    """Return the finding about the mistake for which targets do not keep their places; none without one.

    Other robots that explain the places are a finding each.
    """
    part = _take_part(view)
    given = _score(part, Correction("target_off_model", part.measurements, "", "", ""))
    if len(given.distances) < 2 or given.near.all():
        return []
    if found := find_mixed_units(part):
        return [found]
    if given.unexplained <= LARGEST_MODEL_ERROR:
        small = find_small_mistake(part)
        return [small] if small else []
    if found := _find(part, given, _list_simple(part)):
        return [found]
    if robots := list(inspect_other_robots(part, others)):
        return robots
    found = _find(part, given, _list_fitted(part))
    return [found] if found else []


def find_small_mistake(view: View) -> Finding | None:
    """Return the finding about a scale, or the zero of a joint, that moves all targets by millimetres."""
    part = _take_part(view)
    given = _score(part, Correction("target_off_model", part.measurements, "", "", ""))
    if given.typical <= USUAL_RESIDUAL:
        return None
    scales = (replace(each, limit=1.0) for each in list_scales(part))
    zeros = [replace(each, limit=_BY_ZERO) for each in list_zeros(part)]
    found = explain(given, (scales, zeros), lambda each: _score(part, each), LARGEST_MODEL_ERROR, 0.0)
    return None if found is None else _report(view, given, *found, weight="use_with_care")


def _take_part(view: View) -> View:
    """Return a set with at most `_LARGEST_SET` rows, in runs, so that most rows keep their neighbours."""
    rows = np.flatnonzero(view.measured.any(axis=1))
    if len(rows) > _LARGEST_SET:
        runs = np.array_split(rows, 10)
        rows = np.concatenate([run[: _LARGEST_SET // 10] for run in runs])
    return (
        view
        if len(rows) in (0, len(view.measurements))
        else replace(view, measurements=view.measurements[rows])
    )


def _score(view: View, correction: Correction) -> Places:
    """Return how well the targets keep their places after a correction."""
    given, corrected = view.measurements, correction.corrected
    postures = view.postures if correction.robot is None and corrected.joints is given.joints else None
    lost = len(given) - len(corrected)
    return Places.of(correction.robot or view.robot, corrected, lost=lost, postures=postures)


def _find(view: View, given: Places, groups: Iterable[Iterable[Correction]]) -> Finding | None:
    """Return the finding about the correction that explains a set; None without one."""
    found = explain(given, groups, lambda each: _score(view, each), LARGEST_MODEL_ERROR, _ROUNDING)
    return None if found is None else _report(view, given, *found)


def _report(
    view: View, given: Places, correction: Correction, found: Places, weight: Verdict = "do_not_use"
) -> Finding:
    """Build the finding that a correction explains a set."""
    effect = (
        "with the data as given, the targets keep their positions on the flange (up to "
        f"{length_text(LARGEST_MODEL_ERROR)} is plausible) in only {given.near.sum()} of {len(given.near)} "
        f"observations; with {correction.change}, in {found.near.sum()} of {len(found.near)}, within "
        f"{length_text(float(found.distances[found.near].max()))}"
    )
    if weight != "do_not_use":
        effect = (
            f"the targets are {length_text(given.typical)} from their places on the flange in the median; "
            "with "
            f"{correction.change}, {length_text(found.typical)}"
        )
    if correction.units:
        return view.suspect_other_units(correction.units, effect)
    message = f"{correction.cause}: {effect}" if correction.cause else effect
    past = PAST_DO_NOT_USE if weight == "do_not_use" else PAST_CARE
    remedy = f"{correction.remedy}; {past}"
    return view.build_finding(correction.code, message, remedy, weight, correction.action)


def _list_simple(view: View) -> Iterator[Iterable[Correction]]:
    """Yield the corrections that no fit of frames or lengths makes, by groups; the simplest first."""
    of_the_set = (list_units(view), list_joint_mistakes(view.robot, view.measurements))
    yield chain(*of_the_set, list_parts(view), list_states(view), list_orders_of_states(view))
    yield list_left_out(view)
    yield list_joint_maps(view.robot, view.measurements)
    yield list_orders(view)


def _list_fitted(view: View) -> Iterator[Iterable[Correction]]:
    """Yield corrections that are fitted to the positions, by groups."""
    yield list_frames(view)
    yield list_scales(view)
    yield list_missing_signs(view)
    yield list_zeros(view)
