"""Readings of targets that are missing or incomplete."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, quote
from jointstiff.service.importing.rows import ObservationRecord, Value


class _Gap(NamedTuple):
    """Reading of a target that is missing or incomplete."""

    target: str
    is_empty: bool  # whether nothing of the reading was found
    place: Place  # of a value of the reading, else of its observation
    sentence: str  # what the reading lacks, after the label of its observation


def drop_incomplete_readings(
    observations: list[ObservationRecord], targets: list[str], faults: Faults, options: ImportOptions
) -> tuple[list[ObservationRecord], list[str]]:
    """Return the observations without their incomplete readings, and a note on each omitted reading.

    Unless `allow_missing` is set, each omitted reading is also reported as a fault. The target at the hook
    needs a position in one observation only, and no load.
    """
    kept_observations, gaps, notes = list[ObservationRecord](), list[_Gap](), list[str]()
    required = _list_required_targets(observations, targets)
    for observation in observations:
        own_gaps = _find_gaps(observation, targets, required, options.load_point_target, faults)
        gaps += own_gaps
        omitted = {gap.target for gap in own_gaps}
        omitted.update(_list_unread_hook(observation.points, options.load_point_target))
        values = {key: value for key, value in observation.values.items() if key.target not in omitted}
        if any(quantity.target for quantity in values):
            kept_observations.append(replace(observation, values=values))
        else:
            notes.append(f"{observation.label}: no reading is complete; the observation was skipped")
    if not options.allow_missing:
        _report_gaps(gaps, faults)
    if not kept_observations:
        place = observations[0].place
        faults.report(place, "no observation has a reading", "correct the names of points and files")
    return kept_observations, [*(f"{gap.sentence}; skipped" for gap in gaps), *notes]


def _list_required_targets(observations: Iterable[ObservationRecord], targets: Iterable[str]) -> set[str]:
    """Return the targets that must have a reading in each observation: all except those of gauges.

    A gauge need not be read in each posture.
    """
    quantities = (quantity for observation in observations for quantity in observation.values)
    gauges = {quantity.target for quantity in quantities if quantity.kind == "along"}
    return set(targets) - gauges


def _find_gaps(
    observation: ObservationRecord,
    targets: Sequence[str],
    required: Collection[str],
    hook: str | None,
    faults: Faults,
) -> list[_Gap]:
    """Return the missing and incomplete readings of an observation; report contradictory readings.

    Args:
        observation: observation with its readings.
        targets: targets of the set, in the order of the gaps.
        required: targets that must have a reading in each observation.
        hook: target at the hook, which gives the load point; None if no target does.
        faults: faults of all files.
    """
    points = observation.points
    without_gap = [*_list_unread_hook(points, hook), *_list_targets_without_load(points, hook)]
    gaps = []
    for target in targets:
        is_expected = target in points or target in required
        if not is_expected or target in without_gap:
            continue
        states = points.get(target, {})
        with faults.collect():
            lack = _describe_gap(observation, target, states)
            if lack is not None:
                place = next((point.place for point in states.values()), observation.place)
                gaps.append(_Gap(target, not states, place, f"{observation.label}: {lack}"))
    return gaps


def _report_gaps(gaps: Sequence[_Gap], faults: Faults) -> None:
    """Report readings that are missing or incomplete.

    Readings with some of their values come first, because they show better what is wrong.
    """
    remedy = "add the reading, check the spelling of names, or use `allow_missing`"
    for gap in sorted(gaps, key=lambda each: each.is_empty):
        faults.report(gap.place, gap.sentence, remedy, "allow_missing")


def _list_states(states: dict[State, Value]) -> set[State]:
    """Return the states of a target that have numbers."""
    return {state for state, point in states.items() if point.vector is not None}


def _list_unread_hook(points: dict[str, dict[State, Value]], hook: str | None) -> list[str]:
    """Return the target at the hook if an observation has no reading of this target; else no target."""
    if hook is None:
        return []
    states = points.get(hook, {})
    is_partly_read = any(point.lacks_coordinate for point in states.values())
    return [] if is_partly_read or _list_states(states) else [hook]


def _list_targets_without_load(points: dict[str, dict[State, Value]], hook: str | None) -> list[str]:
    """Return the targets of an observation whose positions without load are complete readings.

    These are the target at the hook and, in an observation without any load, the targets read with it.

    Args:
        points: target → state → value of an observation.
        hook: target at the hook; None if no target gives the load point.
    """
    if hook is None or "unloaded" not in _list_states(points.get(hook, {})):
        return []
    states_of_others = [_list_states(states) for target, states in points.items() if target != hook]
    has_load = any(states & {"loaded", "deflection"} for states in states_of_others)
    if has_load:
        return [hook]
    return [target for target, states in points.items() if "unloaded" in _list_states(states)]


def _describe_gap(observation: ObservationRecord, target: str, states: dict[State, Value]) -> str | None:
    """Return in words what the reading of a target lacks; None if the reading is complete.

    Raises:
        ImportFileError: the target has both positions and a deflection.
    """
    if not states:
        return f"target {target} has no reading"
    partly_read = [state for state, point in states.items() if point.lacks_coordinate]
    if partly_read:
        return f"a coordinate of target {target} {_describe_states(partly_read)} has no number"
    present = _list_states(states)
    if "deflection" in present and len(present) > 1:
        reason = f"{quote(observation.label)}: target {target} has both positions and a deflection"
        remedy = "omit the positions or the deflection, for instance with `ignore`"
        raise ImportFileError(states["deflection"].place, reason, remedy)
    if present - {"unloaded_after"} in ({"deflection"}, {"unloaded", "loaded"}):
        return None
    if not present:
        return f"the cells of target {target} are empty"
    return f"target {target} was read only {_describe_states(present)}"


def _describe_states(states: Iterable[State]) -> str:
    """Return states in words, such as `loaded and unloaded after`."""
    return " and ".join(sorted(states)).replace("_", " ")


def report_skipped_points(observations: list[ObservationRecord]) -> list[str]:
    """Return a note on each point that is skipped because a coordinate has no number."""
    return [
        f"{observation.label}: a coordinate of target {target} has no number; skipped"
        for observation in observations
        for target, states in observation.points.items()
        if any(point.lacks_coordinate for point in states.values())
    ]
