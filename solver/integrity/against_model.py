"""Readings compared with the robot's model: places of targets on the flange, deflections under the loads.

The flange is within millimetres of its position by the model, so that targets keep their places in the flange
frame, and their distances. A mistake in angles, order of rows, names or units moves these places by
centimetres; the mistake that was made is the one whose correction brings all rows to the same places. A
target whose place changes from some row on was bumped.

Deflections are compared with those of springs in the joints, of any stiffness. Springs yield, so that the
work of a load is positive. If no springs explain the deflections, angles, order or loads are mistaken, or
other parts than the joints bend.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from scipy import special

from jointstiff.schemas.finding import Action, Finding, FindingCode, Unit
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.estimation.triangle import Triangle
from jointstiff.solver.integrity.values import (
    FALSE_ALARM,
    MEDIAN_SIZE,
    MODEL_ALLOWANCE,
    OTHER_UNITS,
    SAME_ANGLE,
    View,
    compute_norm_quantile,
    estimate_coordinate_scale,
    median,
    transform_to_flange,
)
from jointstiff.solver.mechanics.block import RegressorBlock, regressor_blocks, whole_block
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.text import figure, length_text

LARGEST_MODEL_ERROR: Final = 0.02
"""Greatest plausible distance of a target from its place [m]: more means a wrong frame, joint map, unit or
angle."""
OUTLIER: Final = 10.0
"""Greatest ratio of a distance from the median place to the median of these distances: errors of the model
vary less with the posture."""
SMALLEST_OUTLIER: Final = 2e-3
"""Distance from the median place [m] below which nothing is reported: an error of 0.05° at 2 m."""
EXPLAINED: Final = 0.8
"""Fraction of the rows that a mistake of the whole set must explain; other rows may have mistakes of their
own."""
_ANCHORS: Final = 24
"""Number of rows whose targets are tried as the usual places."""
_ROWS: Final = 150
"""Number of rows that suffice to find a mistake of the whole set."""
_SEARCHED: Final = 300
"""Greatest number of rows for which the posture that matches their readings is searched."""

LEAST_SIGMA: Final = 1e-6
"""Least standard uncertainty of a reading [m] that is assumed if none is stated."""
OVERSTATED: Final = 2.0
"""Ratio of the scatter of distances to the stated noise above which the stated noise is reported."""
_ENOUGH: Final = 30
"""Least number of distances from which the stated noise is checked."""
_ORDERED: Final = 2.0
"""Factor on the limit of a step if postures were measured in order: errors of the model then look like
steps."""
_CLEARER: Final = 4.0
"""Ratio of sums of squares of the remaining changes up to which several targets are suspected."""
LEAST_ROWS: Final = 4
SMALLEST_MOTION: Final = 1e-4
"""Least displacement, change of a distance, or drift that is reported [m]: less hardly changes deflections,
whose two readings are minutes apart."""

LEAST_ROWS_OF_DRIFT: Final = 8
LEAST_FREEDOM: Final = 3
_EXACT: Final = 1e-18
"""Least variance [m²] of readings, so that rounding of exact readings is not reported as a drift."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Assumed mistake, with the joint positions of some rows corrected for it."""

    code: FindingCode  #: code of the finding if the mistake is confirmed
    joints: FloatArray  #: (M, n) joints as the controller shows them [rad or m]
    change: str  #: change that was tried, in words for a message, after "with"
    remedy: str  #: the proposed correction
    rows: IndexArray  #: (M,) positions of the corrected rows among the rows that are checked
    length: float = 1.0  #: factor on the positions
    unit: Unit | None = None  #: true unit of the numbers, for a mistaken unit


def propose_unit_mistakes(joints: FloatArray, prismatic: BoolArray) -> Iterator[Hypothesis]:
    """Yield the hypotheses that all lengths, or all angles, were given in another unit.

    Args:
        joints: (M, n) joint positions of the controller as posted [rad or m].
        prismatic: (n,) mask of the joints whose positions are lengths.
    """
    # Factors apply to prismatic joints only, conversions of angles to the other joints only.
    rows = np.arange(len(joints))
    shorter, longer = (joints * np.where(prismatic, factor, 1.0) for factor in (1e-3, 1e3))
    as_degrees, as_radians = (np.where(prismatic, joints, f(joints)) for f in (np.deg2rad, np.rad2deg))
    units: list[tuple[Unit, FloatArray, float, str]] = [
        ("mm", shorter, 1e-3, "all lengths divided by 1000"),
        ("m", longer, 1e3, "all lengths multiplied by 1000"),
        ("deg", as_degrees, 1.0, "all angles taken as degrees"),
        ("rad", as_radians, 1.0, "all angles taken as radians"),
    ]
    for unit, angles, length, change in units:
        yield Hypothesis(OTHER_UNITS[unit][2], angles, change, "", rows, length, unit)


def propose_angle_mistakes(
    joints: FloatArray, rows: IndexArray, names: tuple[str, ...]
) -> Iterator[Hypothesis]:
    """Yield the hypotheses of a wrong sign of a joint, two exchanged joints, and rows shifted by one row.

    Args:
        joints: (N, n) controller angles of the whole set [rad].
        rows: (M,) indices of the rows whose angles are corrected.
        names: names of the controller's joints.
    """
    angles, all_rows = joints[rows], np.arange(len(rows))
    for j, name in enumerate(names):
        sign = np.where(np.arange(len(names)) == j, -1.0, 1.0)
        change = f"the angle of {name} with the other sign"
        remedy = f"change the sign of {name} in every observation, or in the joint map"
        yield Hypothesis("joint_sign_suspect", angles * sign, change, remedy, all_rows)
    for j, k in combinations(range(len(names)), 2):
        order = np.arange(len(names))
        order[[j, k]] = k, j
        change = f"the angles of {names[j]} and {names[k]} exchanged"
        remedy = f"exchange the columns of {names[j]} and {names[k]} in every observation"
        yield Hypothesis("joints_swapped", angles[:, order], change, remedy, all_rows)
    for shift, neighbour in ((-1, "before"), (1, "after")):
        # Rows whose neighbour exists
        inside = np.flatnonzero((rows + shift >= 0) & (rows + shift < len(joints)))
        if len(inside):
            change = f"the angles of the row {neighbour}"
            remedy = f"shift the readings by one row: they belong to the angles of the row {neighbour}"
            shifted = joints[rows[inside] + shift]
            yield Hypothesis("observations_out_of_order", shifted, change, remedy, inside)


def inspect_places(view: View) -> tuple[list[Finding], BoolArray]:
    """Check that the targets are at the same places on the flange in every observation.

    Returns:
        The findings; and a mask (N,) of rows that may be checked further: their targets are at their usual
        places, or no position was measured. The mask is all False if the whole set is mistaken.
    """
    # A target that was read only once has no usual place.
    useful = view.measured & (view.measured.sum(axis=0) > 1)
    rows = np.flatnonzero(useful.any(axis=1))
    good = np.ones(len(useful), dtype=np.bool_)
    if len(rows) < 2:
        return [], good
    seen = np.where(useful[..., None], view.places, np.nan)[rows]
    place = _compute_median_places(seen)
    if greatest_distances(seen, place).max() <= LARGEST_MODEL_ERROR:
        exchanged, findings = _find_exchanges_under_load(view, rows, place)
        good[exchanged] = False
        return [*_report_mistyped_rows(view, rows, seen, place), *findings], good
    # Some targets are far from their usual places: find the mistake that explains this.
    place = find_consensus_places(seen)
    agree = greatest_distances(seen, place) <= LARGEST_MODEL_ERROR
    sample = sample_rows(rows)
    best, corrected_place, apart = _find_best_hypothesis(view, sample)
    near = apart <= LARGEST_MODEL_ERROR
    # `count` of the sampled rows are explained by the correction; `posted_share` is the fraction explained as
    # posted.
    count, posted_share = int(near.sum()), float(agree.mean())
    # The whole set is mistaken if the correction explains most rows, and clearly more than the posted values.
    if count >= EXPLAINED * len(sample) and count / len(sample) > posted_share + 0.1:
        effect = (
            f"as given, the targets keep one position on the flange in {agree.sum()} of {len(rows)} "
            f"observations; with {best.change}, in {count} of {len(near)}, within "
            f"{length_text(float(apart[near].max()))}"
        )
        if best.unit is not None:
            return [view.suspect_other_unit(best.unit, effect)], ~good  # no row may be checked further
        return [view.build_finding(best.code, effect, best.remedy, "do_not_use")], ~good
    # If many rows are shifted, the places of the corrected rows are right, not those of the posted rows.
    if best.code == "observations_out_of_order" and count / len(sample) > posted_share:
        place = corrected_place
        agree = greatest_distances(seen, place) <= LARGEST_MODEL_ERROR
    exchanged, under_load = _find_exchanges_under_load(view, rows[agree], place)
    good[[*rows[~agree], *exchanged]] = False
    findings = [*_inspect_disagreeing_rows(view, rows[~agree], seen[~agree], place), *under_load]
    # If less than half of the rows agree, no row may be checked further.
    return findings, good & (agree.sum() >= max(2, len(rows) // 2))


def _find_best_hypothesis(view: View, sample: IndexArray) -> tuple[Hypothesis, FloatArray, FloatArray]:
    """Find the mistake in units or angles whose correction brings most rows to the same places on the flange.

    Of several such mistakes, the one with the least median distance of the targets is returned.

    Args:
        view: measurement set.
        sample: indices of the rows that are corrected.

    Returns:
        The mistake; the places (T, 3) of the targets on the flange after the correction [m]; and the greatest
        distance (M,) of a target from its place in each corrected row [m].
    """
    joints, trials = view.measurements.joints, []
    units = propose_unit_mistakes(joints[sample], view.robot.prismatic)
    for h in (*units, *propose_angle_mistakes(joints, sample, view.robot.joint_names)):
        chosen = sample[h.rows]
        at = Postures(view.robot, view.robot.joint_map.model_angles(h.joints))
        corrected = transform_to_flange(
            at, h.length * view.measurements.position[chosen], view.measured[chosen]
        )
        place = find_consensus_places(corrected)
        trials.append((h, place, greatest_distances(corrected, place)))
    return max(trials, key=lambda each: (np.sum(each[2] <= LARGEST_MODEL_ERROR), -median(each[2])))


def _inspect_disagreeing_rows(
    view: View, rows: IndexArray, seen: FloatArray, place: FloatArray
) -> Iterator[Finding]:
    """Report the mistake of each disagreeing row: exchanged names, readings of another posture, or unknown.

    Args:
        view: measurement set.
        rows: (K,) indices of the rows that disagree with the others.
        seen: (K, T, 3) targets of these rows as seen from the flange [m].
        place: (T, 3) places on the flange where the other rows see the targets [m].
    """
    # Row → row in whose posture its readings were taken
    true_rows: dict[int, int] = {}
    for i, targets in zip(rows.tolist(), seen, strict=True):
        order = _match_targets_to_places(targets, place)
        if order is not None:
            yield from _report_exchanged_targets(
                view, i, order, _match_targets_to_places(_place_loaded_targets(view, i), place)
            )
        elif len(true_rows) < _SEARCHED and (j := _find_posture_of_readings(view, i, place)) is not None:
            true_rows[i] = j
        else:
            apart = np.nan_to_num(np.linalg.norm(targets - place, axis=1))
            t = int(apart.argmax())
            yield view.build_finding(
                "target_off_model",
                f"target '{view.measurements.targets[t]}' is {length_text(apart[t])} away from its median "
                "position on the flange",
                "check that positions are in R0 and in `units.length`, the angles and their order, the "
                "joint map, and the robot's model",
                "do_not_use",
                row=i,
            )
    for shift, neighbour in ((-1, "before"), (1, "after")):
        # Several rows with the same shift are reported together, unless two rows are exchanged with each
        # other.
        shifted = [i for i, j in true_rows.items() if j == i + shift]
        if len(shifted) < 2 or any(true_rows.get(true_rows[i]) == i for i in shifted):
            continue
        yield view.build_finding(
            "observations_out_of_order",
            f"the readings of {len(shifted)} observations, observations[{shifted[0]}] to [{shifted[-1]}], "
            f"were taken at the angles of the row {neighbour}",
            f"shift the readings of these rows by one: each belongs to the angles of the row {neighbour}",
            "do_not_use",
            row=shifted[0],
        )
        true_rows = {i: j for i, j in true_rows.items() if i not in shifted}
    for i, j in true_rows.items():
        yield view.build_finding(
            "observations_out_of_order",
            f"its readings match the angles of observations[{j}]",
            "match readings and angles again; check the order of both",
            "do_not_use",
            row=i,
        )


def _find_posture_of_readings(view: View, i: int, place: FloatArray) -> int | None:
    """Return the row in whose posture the readings of row i were taken; None if they fit no posture.

    If several rows fit, the row nearest to i is returned.

    Args:
        view: measurement set.
        i: index of the row with the readings.
        place: (T, 3) places of the targets on the flange [m].
    """
    at = view.postures
    expected = at.to_base(np.broadcast_to(np.nan_to_num(place), (len(at), *place.shape)))
    known = view.measured[i] & ~np.isnan(place[:, 0])
    if not known.any():
        return None
    apart = np.linalg.norm(expected[:, known] - view.measurements.position[i, known], axis=2).max(axis=1)
    fitting = np.flatnonzero(apart <= LARGEST_MODEL_ERROR)
    return int(fitting[np.abs(fitting - i).argmin()]) if len(fitting) else None


def _place_loaded_targets(view: View, i: int) -> FloatArray:
    """Return the loaded targets (T, 3) of row i in the flange frame [m], as if the arm did not bend."""
    deflection = view.measurements.deflection[i] @ view.postures.flange_rotation[i]
    return np.asarray(view.places[i] + deflection)


def _report_exchanged_targets(
    view: View, i: int, unloaded: IndexArray | None, loaded: IndexArray | None
) -> Iterator[Finding]:
    """Report targets of row i whose names are exchanged; one finding if both states have the same exchange.

    Args:
        view: measurement set.
        i: index of the row.
        unloaded: (T,) index of the true target of each unloaded reading; None without an exchange.
        loaded: (T,) index of the true target of each loaded reading; None without an exchange.
    """
    # `same` is true if both readings have the same exchange: one finding then covers both.
    same = unloaded is not None and loaded is not None and np.array_equal(unloaded, loaded)
    states = [("unloaded", unloaded), ("loaded", loaded)]
    for state, order in [("unloaded and loaded", unloaded)] if same else states:
        if order is None:
            continue
        renamed, label = _list_wrong_names(order), view.measurements.labels[i]
        *names, last = (f"'{view.measurements.targets[t]}'" for t in renamed)
        who = f"{', '.join(names)} and {last}" if names else last
        if sorted(order[renamed]) == renamed:  # the wrong names are exchanged among each other
            message = f"{who} are exchanged in the {state} readings of '{label}'"
            message += f": the target named {_describe_true_names(view, order)}" if len(renamed) > 2 else ""
            remedy = f"exchange {'' if same else 'only '}the {state} values of {who} in '{label}'"
        else:  # one of the exchanged targets was not read
            message = (
                f"in the {state} readings of '{label}' the target named {_describe_true_names(view, order)}"
            )
            remedy = f"repeat the observation, or remove these readings of {who}"
        yield view.build_finding("targets_swapped", message, remedy, "do_not_use", row=i)


def _describe_true_names(view: View, order: IndexArray) -> str:
    """Return in words which target each wrongly named target really is.

    Args:
        view: measurement set.
        order: (T,) index of the true target of each reading.
    """
    names = view.measurements.targets
    return ", ".join(f"'{names[t]}' is '{names[order[t]]}'" for t in _list_wrong_names(order))


def _list_wrong_names(order: IndexArray) -> list[int]:
    """Return the indices t of wrongly named targets, for which the true index `order[t]` is not t."""
    return [t for t, true_index in enumerate(order.tolist()) if true_index != t]


def _report_mistyped_rows(
    view: View, rows: IndexArray, seen: FloatArray, place: FloatArray
) -> Iterator[Finding]:
    """Report rows in which all targets are far from their usual places, as after a typing error in an angle.

    Args:
        view: measurement set.
        rows: (M,) indices of the rows.
        seen: (M, T, 3) targets of these rows as seen from the flange [m].
        place: (T, 3) median places of the targets on the flange [m].
    """
    with np.errstate(invalid="ignore"):
        nearest = np.fmin.reduce(np.linalg.norm(seen - place, axis=2), axis=1)
    typical = median(nearest)
    for b in np.flatnonzero(nearest > max(OUTLIER * typical, SMALLEST_OUTLIER)):
        yield view.build_finding(
            "target_off_model",
            f"all targets are at least {length_text(nearest[b])} away from their median positions on "
            f"the flange; typical is {length_text(typical)}",
            "check the angles of this observation for a typing error, and whether the robot stood still",
            row=int(rows[b]),
        )


def _find_exchanges_under_load(
    view: View, rows: IndexArray, place: FloatArray
) -> tuple[list[int], list[Finding]]:
    """Find rows whose loaded readings are at the places of other targets, as after exchanged names.

    Args:
        view: measurement set.
        rows: (M,) rows whose unloaded targets are in place.
        place: (T, 3) places of the targets on the flange [m].

    Returns:
        Indices of the rows with exchanged loaded readings; and the findings about them.
    """
    far = (np.linalg.norm(view.measurements.deflection[rows], axis=2) > LARGEST_MODEL_ERROR).any(axis=1)
    orders = {i: _match_targets_to_places(_place_loaded_targets(view, i), place) for i in rows[far].tolist()}
    found = {i: order for i, order in orders.items() if order is not None}
    return list(found), [
        each for i, order in found.items() for each in _report_exchanged_targets(view, i, None, order)
    ]


def sample_rows(rows: IndexArray) -> IndexArray:
    """Return at most `_ROWS` of the rows (M,), evenly spread, enough to find a mistake in the whole set."""
    return np.asarray(rows[np.unique(np.linspace(0, len(rows) - 1, _ROWS).round().astype(int))])


def greatest_distances(seen: FloatArray, place: FloatArray) -> FloatArray:
    """Return for each row (M,) the greatest distance [m] of a target from its place; 0 if none was measured.

    Args:
        seen: (M, T, 3) targets as seen from the flange [m]; NaN where not measured.
        place: (T, 3) places of the targets on the flange [m].
    """
    return np.asarray(np.nan_to_num(np.linalg.norm(seen - place, axis=2)).max(axis=1))


def find_consensus_places(seen: FloatArray) -> FloatArray:
    """Return the places (T, 3) of the targets on the flange [m] on which most rows (M, T, 3) agree.

    The targets of some rows, the anchors, are tried as places. The median over the rows near the best anchor
    is returned, as a median over all rows would lie between two places if half of the rows are wrong.
    """
    anchors = seen[np.unique(np.linspace(0, len(seen) - 1, _ANCHORS).round().astype(int))]
    support = [greatest_distances(seen, anchor) <= 2.0 * LARGEST_MODEL_ERROR for anchor in anchors]
    return _compute_median_places(seen[max(support, key=lambda near: int(near.sum()))])


def _compute_median_places(seen: FloatArray) -> FloatArray:
    """Return the median place (T, 3) of each target over rows (M, T, 3); NaN for a target never measured."""
    ordered, count = np.sort(seen, axis=0), np.maximum((~np.isnan(seen)).sum(axis=0), 1)
    middle = np.take_along_axis(ordered, np.stack([(count - 1) // 2, count // 2]), axis=0)
    return np.asarray(0.5 * middle.sum(axis=0))


def _match_targets_to_places(seen: FloatArray, place: FloatArray) -> IndexArray | None:
    """Match the targets of one row to places, in case their names are exchanged.

    Args:
        seen: (T, 3) targets of one row as seen from the flange [m]; NaN where not measured.
        place: (T, 3) places of the targets on the flange [m].

    Returns:
        (T,) index of the true target of each reading; None if no exchange explains the readings.
    """
    order = np.arange(len(place))
    read = np.flatnonzero(~np.isnan(seen[:, 0]))
    distance = np.linalg.norm(seen[read, None] - place, axis=2)
    distance = np.where(np.isnan(distance), np.inf, distance)
    order[read] = distance.argmin(axis=1)
    matched = order[read]
    is_far = distance.min(axis=1).max() > LARGEST_MODEL_ERROR
    # A match counts only if every target has another place and at least two targets change places.
    if is_far or len(np.unique(matched)) < len(matched) or np.array_equal(matched, read):
        return None
    return order


def inspect_rigidity(view: View, good: BoolArray) -> Iterator[Finding]:
    """Report targets that moved on the flange, and stated noise that the distances of targets contradict.

    Args:
        view: measurement set.
        good: (N,) mask of rows whose angles and names are right as far as known.
    """
    measured, names = view.measured & good[:, None], view.measurements.targets
    places = np.where(measured[..., None], view.places, np.nan)
    step = find_step(places, view.measurements.joints, limit_factor=_ORDERED if view.in_order else 1.0)
    if step is not None:
        yield view.build_finding(
            "target_moved",
            f"from here on, '{names[step.target]}' is displaced by {length_text(step.size)} on "
            f"the flange, relative to the other targets: {figure(step.ratio, '.3g')} times as far as chance "
            "allows",
            "check that the target is attached firmly; treat it as another target from here on "
            "(another name), or repeat",
            "do_not_use",
            row=step.row,
        )
    # Pairs of targets
    first, second = np.triu_indices(measured.shape[1], k=1)
    usable = (measured[:, first] & measured[:, second]).any(axis=0)
    first, second = first[usable], second[usable]
    if not len(first):
        return
    both = measured[:, first] & measured[:, second]
    # `change` (2, N, P) is the distance of each pair less its median [m], unloaded and loaded. Distances to a
    # target that moved are compared before and after the step separately.
    m = view.measurements
    states = (m.position, m.position + m.deflection)
    lengths = np.stack([np.linalg.norm(s[:, first] - s[:, second], axis=2) for s in states])
    change = _subtract_pair_medians(lengths, both)
    if step is not None:
        of_target = (first == step.target) | (second == step.target)
        for part in (slice(None, step.row), slice(step.row, None)):
            change[:, part, of_target] = _subtract_pair_medians(
                lengths[:, part, of_target], both[part, of_target]
            )
    scatter = median(np.abs(change[:, both])) / MEDIAN_SIZE
    sigma = np.where(both, np.hypot(view.reading_sigma[:, first], view.reading_sigma[:, second]), 0.0)
    typical = median(sigma[both])
    if typical > 0.0 and both.sum() >= _ENOUGH and scatter >= OVERSTATED * typical:
        yield view.build_finding(
            "sigma_suspect",
            f"distances between targets scatter by {length_text(scatter)}, but the stated noise "
            f"gives {length_text(typical)}",
            "check the stated noise and its unit; or omit `noise` so that sigma is estimated from the "
            "residuals",
        )
    # `limits` (N, P) are the greatest changes [m] that noise explains: stated noise, or the scatter of
    # distances. The factor 4 is two states (unloaded, loaded) times two signs.
    quantile = -special.ndtri(FALSE_ALARM / (4.0 * both.sum()))
    scatter_limit = MODEL_ALLOWANCE * quantile * max(np.sqrt(2.0) * LEAST_SIGMA, scatter)
    limits = np.maximum(quantile * sigma, 0.5 * scatter_limit if sigma.any() else scatter_limit)
    for i in np.flatnonzero((np.abs(change).max(axis=0) > limits).any(axis=1)).tolist():
        row_change = np.abs(change[:, i])
        p = int((row_change.max(axis=0) / limits[i]).argmax())
        # Suspect the target without which the other distances change least, and targets nearly as suspicious.
        squares, pairs = (row_change**2).sum(axis=0), np.array([first, second])
        present = np.unique(pairs[:, both[i]])
        remaining = np.array([squares[(pairs != t).all(axis=0)].sum() for t in present])
        suspects = present[remaining <= _CLEARER * (remaining.min() + (scatter + 1e-9) ** 2)]
        who = " or ".join(f"'{names[t]}'" for t in suspects)
        yield view.build_finding(
            "targets_not_rigid",
            f"the distance between '{names[first[p]]}' and '{names[second[p]]}' "
            f"({'loaded' if row_change[1, p] > row_change[0, p] else 'unloaded'}) differs by "
            f"{length_text(row_change[:, p].max())} from its median (limit {length_text(limits[i, p])}): "
            f"{who} moved",
            f"check {who} for a bump, a turned reflector or a wrong name; repeat the observation, or remove "
            "that reading",
            "do_not_use",
            row=i,
        )


@dataclass(frozen=True)
class Step:
    """Lasting displacement of one target on the flange."""

    target: int  #: index of the target
    row: int  #: index of the first observation after the displacement
    size: float  #: size of the displacement [m]
    ratio: float  #: displacement over the greatest displacement that chance allows


def _subtract_pair_medians(lengths: FloatArray, both: BoolArray) -> FloatArray:
    """Return distances (2, N, P) of P pairs less the median of each pair; zero where `both` is False.

    Args:
        lengths: (2, N, P) distances of the pairs of targets, unloaded and loaded [m].
        both: (N, P) mask of the pairs whose two targets were measured.
    """
    if both.all():
        return np.asarray(lengths - np.median(lengths, axis=(0, 1)))
    differences = np.zeros(lengths.shape)
    for p in np.flatnonzero(both.any(axis=0)):
        pair_lengths = lengths[:, both[:, p], p]
        differences[:, both[:, p], p] = pair_lengths - np.median(pair_lengths)
    return differences


def find_step(places: FloatArray, joints: FloatArray, limit_factor: float = 1.0) -> Step | None:
    """Find the most significant lasting displacement of a target relative to the mean of the other targets.

    Errors of the modelled flange position cancel in a difference to other targets. Errors of the modelled
    flange orientation do not cancel, but change no distance between targets, so that in a step a distance
    must change by `SMALLEST_MOTION`. The scatter is the greater of the median change from row to row, and the
    scatter about the means before and after the step. A step needs two postures before and two after.

    Args:
        places: (N, T, 3) places in the flange frame [m]; NaN where a target was not measured.
        joints: (N, n) angles [rad].
        limit_factor: factor on the greatest displacement that chance allows.

    Returns:
        The step; None if no displacement is beyond chance.
    """
    was_read = ~np.isnan(places[..., 0])
    target_count = was_read.sum(axis=1)
    if len(places) < LEAST_ROWS or target_count.max() < 2:
        return None
    most_targets = target_count.max()
    filled = np.where(was_read[..., None], places, 0.0)
    # Only rows in which the greatest number of targets was read, so that the mean of the others is comparable
    rows_of_target = [np.flatnonzero(target & (target_count == most_targets)) for target in was_read.T]
    # For each target: index, rows, and place relative to the mean of the other targets in these rows
    series = [
        (t, rows, filled[rows, t] - (filled[rows].sum(axis=1) - filled[rows, t]) / (most_targets - 1))
        for t, rows in enumerate(rows_of_target)
        if len(rows) >= LEAST_ROWS
    ]
    if not series:
        return None
    changes = np.concatenate([np.diff(y, axis=0) for _, _, y in series])
    scale = estimate_coordinate_scale(np.linalg.norm(changes, axis=1)) / np.sqrt(2.0)
    degrees_of_freedom = 3.0 * len(changes) * (len(series) - 1) / len(series)
    limit = limit_factor * MODEL_ALLOWANCE * compute_norm_quantile(len(changes), degrees_of_freedom)
    posture, best = np.round(joints / SAME_ANGLE), None
    for t, rows, y in series:
        # The most significant step (3,) [m], and the number k of rows before it
        before = np.arange(1, len(y))
        sums = np.cumsum(y, axis=0)
        shifts = (sums[-1] - sums[:-1]) / (len(y) - before)[:, None] - sums[:-1] / before[:, None]
        k = 1 + int((before * (len(y) - before) * (shifts**2).sum(axis=1)).argmax())
        deviations = np.concatenate([y[:k] - y[:k].mean(axis=0), y[k:] - y[k:].mean(axis=0)])
        scatter = max(scale, estimate_coordinate_scale(np.linalg.norm(deviations, axis=1)), 1e-9)
        size = float(np.linalg.norm(shifts[k - 1]))
        ratio = size / (limit * scatter * np.sqrt(1.0 / k + 1.0 / (len(y) - k)))
        if not ratio > (best.ratio if best else 1.0):
            continue
        # Within one posture, a step might be an error of the model in this posture.
        if any(len(np.unique(posture[part], axis=0)) < 2 for part in (rows[:k], rows[k:])):
            continue
        lengths = np.linalg.norm(np.delete(places[rows], t, axis=1) - places[rows, t, None], axis=2)
        lengths = lengths[:, ~np.isnan(lengths).any(axis=0)]
        change = np.abs(np.median(lengths[k:], axis=0) - np.median(lengths[:k], axis=0))
        if change.max(initial=0.0) > SMALLEST_MOTION:
            best = Step(t, int(rows[k]), size, ratio)
    return best


def inspect_drift(view: View, good: BoolArray) -> Iterator[Finding]:
    """Report a drift of the unloaded targets, proportional to time, by an F test of its three components.

    The drift of the targets' barycentre is fitted together with joint offsets, the position of the base, and
    the place of the barycentre on the flange. A set measured in the order of a joint's angle gives no
    finding, as model errors then look like a drift.

    Args:
        view: measurement set.
        good: (N,) mask of rows whose angles and names are right as far as known.
    """
    measured = view.measured & good[:, None]
    most_targets = measured.sum(axis=1).max()
    # Rows with the same targets as the first row with most targets have the same barycentre.
    rows = np.flatnonzero((measured == measured[measured.sum(axis=1).argmax()]).all(axis=1))
    if most_targets == 0 or len(rows) < LEAST_ROWS_OF_DRIFT or view.in_order:
        return
    # Columns of the fit, axes of R0 [m]: motion of the barycentre due to joint offsets, its place on the
    # flange, the base's position and the drift; then the distance of the barycentre from its median place.
    at, targets = view.postures, measured[rows[0]]
    points = np.zeros((len(at), 1, 3))
    points[rows, 0] = view.measurements.position[rows][:, targets].mean(axis=1)
    place = view.places[rows][:, targets].mean(axis=1)
    rotation = at.flange_rotation[rows]
    distance = np.einsum("nij,nj->ni", rotation, place - np.median(place, axis=0))
    base = np.broadcast_to(np.eye(3), rotation.shape)
    time = (rows - rows.mean()) / np.ptp(rows)
    motion = time[:, None, None] * np.eye(3)
    triangle = Triangle(model=view.robot.n + 6, motion=3)
    triangle.add(
        np.concatenate([at.jacobian_at(points)[rows, 0], rotation, base, motion, distance[..., None]], axis=2)
    )
    freedom = triangle.rows - view.robot.n - 9
    if freedom < LEAST_FREEDOM:
        return
    squares_without_drift, squares_with_drift = (
        triangle.residual_squares(names) for names in (["model"], ["model", "motion"])
    )
    variance = max(squares_with_drift / freedom, _EXACT)
    ratio = (squares_without_drift - squares_with_drift) / 3.0 / variance / MODEL_ALLOWANCE**2
    p_value = float(special.fdtrc(3.0, freedom, max(0.0, ratio)))
    drift = triangle.fit_with(["motion"], "model").unknowns
    size = float(np.linalg.norm(drift))
    if p_value < FALSE_ALARM and size > SMALLEST_MOTION:
        yield view.build_finding(
            "drift_in_time",
            f"over the whole set, the unloaded targets drifted by {length_text(size)} relative to the "
            f"robot's model (x {length_text(drift[0])}, y {length_text(drift[1])}, z "
            f"{length_text(drift[2])}; p = {p_value:.1g})",
            "check the tracker's stand, warm-up and temperature; a deflection is affected only by "
            "drift between its two readings",
        )


UNEXPLAINED: Final = 0.5
"""Greatest unexplained share of the median deflection: joints explain 80 % of the deflection of a real robot,
and half by the worst published method."""
WORTH_A_SEARCH: Final = 0.05
"""Unexplained share above which a mistake of the whole set is searched, if no position was read."""
BETTER: Final = 0.5
"""Ratio of the unexplained share after a correction to that before, below which a mistake is reported."""
FLIPPED: Final = 0.5
"""Ratio of the residual with the load reversed to that with the load as posted, below which the load is
reported as reversed. The ratio is near 0 for a wrong sign."""
BEYOND_NOISE: Final = 5.0
"""Deflection, in standard deviations of its noise, above which it is not noise."""
AGAINST_SIGMAS: Final = 5.0
"""Deflection of a joint opposite to its torque, in standard deviations, above which it is not noise."""
LARGEST_ENCODER_DEFLECTION: Final = 0.02
"""Largest plausible deflection of a joint [rad]: more is a mistake in a unit, or a robot that moved."""
SMALLEST_RESIDUAL: Final = 5e-6
"""Smallest deflection that a tracker can see [m]."""
_LEAST_SHIFTED: Final = 3
"""Least number of successive rows that a shift must explain: one row may match its neighbour by chance, and
two rows may be exchanged."""
_ROWS_PER_JOINT: Final = 3
_ROUNDS: Final = 8
_NULL: Final = 1e-9
"""Norm of a column, relative to the largest, below which no load twists its joint."""
_RIDGE: Final = 1e-9
"""Regularisation, relative to unit columns, that keeps undetermined combinations of compliances near zero."""
_SAMPLE: Final = 2000
"""Greatest number of observations in a fit, enough to determine a few compliances and check all
observations."""
_ALL: Final = slice(None)


@dataclass(frozen=True, eq=False)
class Springs:
    """Fit of joint compliances to the deflections of N observations of T targets."""

    predicted: FloatArray  #: (N, T, 3) deflections [m]; zero where not read
    residual: FloatArray  #: (N, T, 3) measured less predicted [m]
    work: float  #: predicted work of the load, summed over the observations [J]; positive for springs
    parameters: int  #: number of joints that were fitted
    unexplained: float  #: median residual of an observation over its median deflection

    @classmethod
    def fit(cls, block: RegressorBlock, rows: slice = _ALL, shift: int = 0) -> Springs:
        """Fit compliances of either sign that minimise the sum of the residuals' lengths, not of the squares.

        A few mistaken rows then hardly change the fit.

        Args:
            block: regressor and deflections of the whole set.
            rows: rows whose deflections are fitted; the deflections of all rows are predicted.
            shift: number of rows by which readings are shifted: the deflections of row i are fitted with load
                and posture of row i + shift.
        """
        deflection, count = block.measurements.deflection, len(block.A)
        chosen = np.arange(count)[rows]
        chosen = chosen[(chosen + shift >= 0) & (chosen + shift < count)]
        chosen = chosen[:: max(1, -(-len(chosen) // _SAMPLE))]
        A = block.A[chosen + shift].reshape(len(chosen), -1, block.A.shape[-1])
        compliance = _minimise_distances(A, deflection[chosen].reshape(len(chosen), -1))
        predicted = block.A @ compliance
        typical_deflection = median(compute_observation_norms(deflection))
        return cls(
            predicted=predicted,
            residual=deflection - predicted,
            work=float((block.torque**2).sum(axis=0) @ compliance),
            parameters=int(np.count_nonzero(compliance)),
            unexplained=float(median(compute_observation_norms(deflection - predicted)) / typical_deflection)
            if typical_deflection
            else 0.0,
        )


def _minimise_distances(A: FloatArray, d: FloatArray) -> FloatArray:
    """Return the compliances c (n,) that minimise Σ ‖d_i − A_i c‖ (iteratively reweighted least squares).

    Args:
        A: (K, m, n) regressors A_i.
        d: (K, m) deflections d_i [m].
    """
    norms = np.sqrt((A**2).sum(axis=(0, 1)))
    visible = np.flatnonzero(norms > _NULL * norms.max())
    compliance = np.zeros(A.shape[-1])
    if not len(visible):
        return compliance
    scaled = A[..., visible] / norms[visible]
    gram, moment = scaled.transpose(0, 2, 1) @ scaled, np.einsum("kij,ki->kj", scaled, d)
    weight, ridge = np.ones(len(d)), _RIDGE / len(d) * np.eye(len(visible))
    for _ in range(_ROUNDS):
        G = np.einsum("k,kij->ij", weight, gram) / weight.sum()
        x = np.linalg.solve(G + ridge, weight @ moment / weight.sum())
        distance = np.linalg.norm(d - scaled @ x, axis=1)
        weight = 1.0 / np.maximum(distance, max(1e-3 * median(distance), 1e-12))
    compliance[visible] = x / norms[visible]
    return compliance


def compute_observation_norms(rows: FloatArray) -> FloatArray:
    """Return the Euclidean norm (N,) of all components of each observation."""
    return np.asarray(np.linalg.norm(rows.reshape(len(rows), -1), axis=1))


def inspect_response(view: View, good: BoolArray) -> Iterator[Finding]:
    """Fit joint compliances to the deflections, and report mistakes that the residuals show.

    Args:
        view: measurement set.
        good: (N,) mask of rows whose angles and names are right as far as known.
    """
    rows = np.flatnonzero(good & view.loaded)
    m = view.measurements
    if int(m.coordinates[rows].sum()) < _ROWS_PER_JOINT * view.robot.n:
        return
    part = m if len(rows) == len(m) else m[rows]
    noise = BEYOND_NOISE * np.sqrt(2.0) * (m.sigma or 0.0)
    if median(np.linalg.norm(part.deflection, axis=2)[part.present]) <= noise:
        return
    block = whole_block(view.robot, part)
    springs = Springs.fit(block)
    whole_set_finding = _find_mistake_of_the_set(view, rows, block, springs)
    if whole_set_finding is not None:
        yield whole_set_finding
        return
    # `against` (M,) marks observations that are explained much better with the load reversed.
    predicted = compute_observation_norms(springs.predicted)
    residual = compute_observation_norms(springs.residual)
    reversed_residual = compute_observation_norms(springs.residual + 2.0 * springs.predicted)
    against = np.asarray((reversed_residual < FLIPPED * residual) & (predicted > noise))
    for k in np.flatnonzero(against):
        yield view.build_finding(
            "deflection_against_force",
            f"under {figure(float(np.linalg.norm(part.force[k])))} N the targets moved opposite to the "
            f"prediction from the other observations, by {length_text(predicted[k])}; with the load reversed "
            f"only {length_text(reversed_residual[k])} remain unexplained",
            "change the sign of this force, or exchange unloaded and loaded",
            "do_not_use",
            row=int(rows[k]),
        )
    # Readings of one coordinate and of three coordinates have different distributions: compare them
    # separately.
    for coordinates in (1, 3):
        compared = (part.coordinates == coordinates) & ~against[:, None]
        yield from _find_residual_outliers(view, rows, part, springs, compared)


def _find_mistake_of_the_set(
    view: View, rows: IndexArray, block: RegressorBlock, springs: Springs
) -> Finding | None:
    """Return the finding about a mistake in all or many rows; None if no such mistake is found.

    Mistaken angles and shifted rows are searched only if no positions were measured: with positions, other
    checks have searched them.

    Args:
        view: measurement set.
        rows: (M,) indices of the rows that are checked.
        block: regressor and deflections of these rows.
        springs: fit of these rows.
    """
    if not view.measured.any():
        if springs.unexplained > WORTH_A_SEARCH and (mistake := _find_mistaken_angles(view, block, springs)):
            return mistake
        if shifted := _find_shifted_rows(view, rows, block, springs):
            return shifted
    part = block.measurements
    if springs.unexplained > UNEXPLAINED:
        typical = median(np.linalg.norm(part.deflection, axis=2)[part.present])
        return view.build_finding(
            "deflections_unexplained",
            f"joint compliances do not explain the deflections: of {length_text(typical)} (median), "
            f"{100.0 * springs.unexplained:.3g} % remain unexplained",
            "check the frame and signs of the forces, the joint map, and the order of angles and rows",
            "use",
        )
    if springs.work >= 0.0:
        return None
    against_force = np.einsum("ntj,nj->n", part.deflection, part.force) < 0.0
    return view.build_finding(
        "force_sign_suspect",
        f"the work of the load on the joints is {springs.work:.3g} J, but must be positive; the "
        f"targets moved against the force in {int(against_force.sum())} of {len(against_force)} observations",
        "change the sign of every force (it is the force on the robot); or exchange unloaded and loaded",
        "do_not_use",
        Action.of("exchange_readings"),
    )


def _find_mistaken_angles(view: View, block: RegressorBlock, springs: Springs) -> Finding | None:
    """Return the finding about mistaken angles whose correction halves the unexplained share, or None."""
    part, trials = block.measurements, []
    for hypothesis in propose_angle_mistakes(part.joints, np.arange(len(part)), view.robot.joint_names):
        corrected = replace(part[hypothesis.rows], joints=hypothesis.joints)
        trials.append((Springs.fit(whole_block(view.robot, corrected)).unexplained, hypothesis))
    unexplained, best = min(trials, key=lambda pair: pair[0])
    if unexplained >= BETTER * springs.unexplained or unexplained > UNEXPLAINED:
        return None
    return view.build_finding(
        best.code,
        f"joint compliances leave {100.0 * springs.unexplained:.3g} % of the deflections "
        f"unexplained; with {best.change}, {100.0 * unexplained:.3g} %",
        best.remedy,
        "do_not_use",
    )


def _find_shifted_rows(
    view: View, rows: IndexArray, block: RegressorBlock, springs: Springs
) -> Finding | None:
    """Return the finding about the longest run of rows whose deflections fit a neighbouring row far better.

    If a large share is unexplained, springs are fitted to the first half of the rows as posted, and to the
    second half with a shift, because a fit to all rows would mix right and shifted rows. None is returned if
    no run has at least `_LEAST_SHIFTED` rows.
    """
    fits, deflection = [springs], block.measurements.deflection
    if springs.unexplained > UNEXPLAINED:
        half = len(block.A) // 2
        fits = [Springs.fit(block, slice(None, half))]
        fits += [Springs.fit(block, slice(half, None), shift) for shift in (-1, 1)]
    longest, neighbour = np.empty(0, np.intp), ""
    for fit in fits:
        residual = compute_observation_norms(fit.residual)
        for shift, name in ((-1, "before"), (1, "after")):
            shifted_residual = compute_observation_norms(deflection - np.roll(fit.predicted, -shift, axis=0))
            better = shifted_residual < BETTER * residual
            better[0 if shift < 0 else -1] = False  # `roll` gives the first or last row a wrong neighbour
            marked = np.flatnonzero(better)
            # Split the marked rows into runs of successive rows, and take the longest.
            run = max(np.split(marked, np.flatnonzero(np.diff(marked) > 1) + 1), key=len)
            if len(run) >= _LEAST_SHIFTED and len(run) > len(longest):
                longest, neighbour = run, name
    if not len(longest):
        return None
    first, last = rows[longest[[0, -1]]].tolist()
    return view.build_finding(
        "observations_out_of_order",
        f"the deflections of {len(longest)} observations, observations[{first}] to [{last}], "
        f"match the load and posture of the row {neighbour}, not their own",
        f"shift the readings of these rows by one: each belongs to the angles of the row {neighbour}",
        "do_not_use",
        row=first,
    )


def _find_residual_outliers(
    view: View, rows: IndexArray, part: Measurements, springs: Springs, compared: BoolArray
) -> Iterator[Finding]:
    """Yield a finding for each reading whose residual is far above the typical residual.

    Two targets of an observation whose names look exchanged give a single finding.

    Args:
        view: measurement set.
        rows: (M,) indices of the rows that are compared.
        part: measurements of these rows.
        springs: fit of these rows.
        compared: (M, T) mask of the readings to compare, all with the same number of coordinates.
    """
    norm, targets = np.linalg.norm(springs.residual, axis=2), part.targets
    count, coordinates = int(compared.sum()), int(part.coordinates[compared].max(initial=0))
    freedom = coordinates * count - springs.parameters
    if freedom < springs.parameters:  # too few readings for a typical residual
        return
    scale = estimate_coordinate_scale(norm[compared], coordinates) * np.sqrt(coordinates * count / freedom)
    limit = MODEL_ALLOWANCE * compute_norm_quantile(count, freedom, coordinates) * scale
    # Limit from the stated noise, which is known: its degrees of freedom are practically infinite.
    noise_limit = compute_norm_quantile(count, 1e6, coordinates) * np.sqrt(2.0) * view.reading_sigma[rows]
    # A residual has to be unusual relative to the deflection, too, as parts other than joints bend with the
    # load.
    deflection = np.maximum(
        np.linalg.norm(part.deflection, axis=2), np.linalg.norm(springs.predicted, axis=2)
    )
    share = norm / np.maximum(deflection, 1e-300)
    share_limit = MODEL_ALLOWANCE * compute_norm_quantile(count, coordinates * count, coordinates)
    share_limit *= estimate_coordinate_scale(share[compared], coordinates)
    beyond = compared & (norm > np.maximum(max(limit, SMALLEST_RESIDUAL), noise_limit))
    beyond &= share > min(share_limit, UNEXPLAINED)
    for k in np.flatnonzero(beyond.any(axis=1)):
        t = int(np.where(compared[k], norm[k], 0.0).argmax())
        pair = find_exchanged_pair(part.deflection[k], springs.predicted[k], part.present[k])
        if pair is not None:
            yield view.build_finding(
                "targets_swapped",
                f"with the deflections of '{targets[pair[0]]}' and '{targets[pair[1]]}' exchanged, joint "
                "compliances explain them twice as well",
                f"exchange their names in '{part.labels[k]}'",
                "do_not_use",
                row=int(rows[k]),
            )
            continue
        yield view.build_finding(
            "residual_outlier",
            f"the deflection of target '{targets[t]}' differs by {length_text(norm[k, t])} from "
            f"the fit to all observations; typical is {length_text(scale)}",
            "check this reading and its load; repeat the reading"
            + (", or identify with loss huber" if coordinates == 3 else ""),
            row=int(rows[k]),
        )


def find_exchanged_pair(
    deflection: FloatArray, predicted: FloatArray, present: BoolArray
) -> tuple[int, int] | None:
    """Return the indices of two targets whose deflections fit far better if exchanged; None for no such pair.

    Args:
        deflection: (T, 3) measured deflections [m].
        predicted: (T, 3) predicted deflections [m].
        present: (T,) mask of the targets that were read.
    """
    read = np.flatnonzero(present)
    best, least = None, BETTER * float(np.linalg.norm(deflection[read] - predicted[read]))
    for a, b in combinations(read.tolist(), 2):
        order = np.arange(len(present))
        order[[a, b]] = b, a
        distance = float(np.linalg.norm(deflection[order][read] - predicted[read]))
        if distance < least:
            best, least = (a, b), distance
    return best


def inspect_encoders(view: View) -> Iterator[Finding]:
    """Report encoders that show a deflection opposite to the load's torque, or an implausibly large one.

    A spring yields in the direction of its torque, so only noise makes the work ``τ_j δθ_j`` negative.

    Yields:
        At most one finding of each kind for each joint.
    """
    names, encoders = view.robot.joint_names, view.measurements.encoders  # only of rotary joints
    if encoders is None:
        return
    torque = np.concatenate([block.torque for block in regressor_blocks(view.robot, view.measurements)])
    work = encoders.deflection * np.sign(torque)
    against = encoders.present & (-work > AGAINST_SIGMAS * np.sqrt(2.0) * encoders.sigma)
    size = np.abs(encoders.deflection)
    for j in np.flatnonzero(against.any(axis=0)):
        rows = np.flatnonzero(against[:, j])
        worst = int(rows[size[rows, j].argmax()])
        yield view.build_finding(
            "encoder_against_torque",
            f"the encoder of {names[j]} shows {1e6 * encoders.deflection[worst, j]:.3g} µrad, opposite to "
            f"the torque of {figure(torque[worst, j])} N.m, in {len(rows)} of "
            f"{int(encoders.present[:, j].sum())} readings",
            "check the encoder's sign, which is that of the model's joint, not the controller's; that "
            "unloaded and loaded are not exchanged; and the signs of the force",
            row=worst if len(rows) == 1 else None,
        )
    for j in np.flatnonzero(size.max(axis=0) > LARGEST_ENCODER_DEFLECTION):
        worst = int(size[:, j].argmax())
        yield view.build_finding(
            "encoder_deflection_implausibly_large",
            f"the encoder of {names[j]} shows a deflection of {1e3 * size[worst, j]:.3g} mrad",
            "check `units.angle`, and that unloaded and loaded readings are of the same posture",
            row=worst,
        )
