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
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from scipy import special

from jointstiff.schemas.finding import AdvisedAction, Finding
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.fit.triangle import Triangle
from jointstiff.solver.integrity.by_places import find_small_mistake
from jointstiff.solver.integrity.by_springs import find_correction
from jointstiff.solver.integrity.explain import BETTER
from jointstiff.solver.integrity.places import (
    LARGEST_MODEL_ERROR,
    compute_median_places,
    find_consensus_places,
    greatest_distances,
    see_from_flange,
)
from jointstiff.solver.integrity.response import UNEXPLAINED, Springs, compute_observation_norms
from jointstiff.solver.integrity.values import (
    FALSE_ALARM,
    MEDIAN_SIZE,
    MODEL_ALLOWANCE,
    SAME_ANGLE,
    View,
    compute_norm_quantile,
    estimate_coordinate_scale,
    median,
    transform_to_flange,
)
from jointstiff.solver.meaning.decision import USUAL_RESIDUAL
from jointstiff.solver.mechanics.block import RegressorBlock, get_whole_block, regressor_blocks
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.text import PAST_CARE, PAST_DO_NOT_USE, figure, length_text

OUTLIER: Final = 10.0
"""Greatest ratio of a distance from the median place to the median of these distances: errors of the model
vary less with the posture."""
SMALLEST_OUTLIER: Final = 2e-3
"""Distance from the median place [m] below which nothing is reported: an error of 0.05° at 2 m."""
_SEARCHED: Final = 300
"""Greatest number of rows for which the posture that matches their readings is searched."""

_FEW: Final = 10
"""Greatest number of disagreeing rows in which a mistyped angle is searched."""
_CLEARLY_NEARER: Final = 3.0
"""Least ratio of the distances by another mistyped joint and by the one that is named."""
_REFINEMENTS: Final = 3
"""Rounds in which the position of a joint is searched: whole degrees, tenths, hundredths."""

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


def inspect_places(view: View) -> tuple[list[Finding], BoolArray]:
    """Check row by row that the targets are at their places on the flange.

    Returns:
        The findings; and a mask (N,) of rows that may be checked further: their targets are at their usual
        places, or no position was measured.
    """
    seen, _ = see_from_flange(view.postures, view.measurements)
    seen = seen[:, 0]  # without load
    rows = np.flatnonzero(np.isfinite(seen).any(axis=(1, 2)))
    may_be_checked = np.ones(len(seen), dtype=np.bool_)
    if len(rows) < 2:
        return [], may_be_checked
    places = compute_median_places(seen[rows])
    distances = greatest_distances(seen[rows], places)
    if distances.max() <= LARGEST_MODEL_ERROR:
        small = find_small_mistake(view) if median(distances) > USUAL_RESIDUAL else None
        findings = [*([small] if small else []), *_report_mistyped_rows(view, rows, seen[rows], places)]
    else:
        findings, places = [], find_consensus_places(seen[rows])
    agrees = greatest_distances(seen[rows], places) <= LARGEST_MODEL_ERROR
    if not agrees.all():
        findings = list(_inspect_disagreeing_rows(view, rows[~agrees], seen[rows[~agrees]], places))
    exchanged, under_load = _find_exchanges_under_load(view, rows[agrees], places)
    may_be_checked[[*rows[~agrees], *exchanged]] = False
    # If less than half of the rows agree, no row may be checked further.
    return [*findings, *under_load], may_be_checked & (agrees.sum() >= max(2, len(rows) // 2))


def _inspect_disagreeing_rows(
    view: View, rows: IndexArray, seen_from_flange: FloatArray, places: FloatArray
) -> Iterator[Finding]:
    """Report why each row disagrees: exchanged names, readings of another posture, or an unknown cause.

    Args:
        view: measurement set.
        rows: (K,) indices of the rows that disagree with the others.
        seen_from_flange: (K, T, 3) targets of these rows in the flange frame [m].
        places: (T, 3) places on the flange where the other rows have the targets [m].
    """
    # Row → row in whose posture its readings were taken
    true_rows: dict[int, int] = {}
    are_few = len(rows) <= _FEW  # many mistaken rows have another cause than typing errors
    for i, targets in zip(rows.tolist(), seen_from_flange, strict=True):
        exchange = _match_targets_to_places(targets, places)
        if exchange is not None:
            exchange_under_load = None
            if _was_read_under_load(view, i):
                exchange_under_load = _match_targets_to_places(_place_loaded_targets(view, i), places)
            yield from _report_exchanged_targets(view, i, exchange, exchange_under_load)
        elif len(true_rows) < _SEARCHED and (j := _find_posture_of_readings(view, i, places)) is not None:
            true_rows[i] = j
        else:
            mistyped = find_mistyped_joint(view, i, places) if are_few else None
            yield _report_target_off_model(view, i, targets - places, mistyped)
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
            "shift the readings of these rows by one: each reading belongs to the angles of the row "
            f"{neighbour}",
            "do_not_use",
            row=shifted[0],
        )
        true_rows = {i: j for i, j in true_rows.items() if i not in shifted}
    for i, j in true_rows.items():
        yield view.build_finding(
            "observations_out_of_order",
            f"the readings of this observation match the angles of observations[{j}]",
            "match readings and angles again; check the order of the readings and of the angles",
            "do_not_use",
            row=i,
        )


def _was_read_under_load(view: View, row: int) -> bool:
    """Return whether any target of a row was read under load, too."""
    measurements = view.measurements
    if measurements.unloaded_only is None:
        return True
    return bool((measurements.present[row] & ~measurements.unloaded_only[row]).any())


def _report_target_off_model(
    view: View, row: int, offsets: FloatArray, mistyped: MistypedJoint | None
) -> Finding:
    """Build the finding that targets of a row are far from their places, with the angle that explains it.

    Args:
        view: measurement set.
        row: index of the row.
        offsets: (T, 3) of the targets from their places on the flange [m]; NaN where not measured.
        mistyped: joint whose position alone explains the readings; None without one.
    """
    distances = np.nan_to_num(np.linalg.norm(offsets, axis=1))
    farthest = int(distances.argmax())
    message = (
        f"target '{view.measurements.targets[farthest]}' is {length_text(distances[farthest])} away from its "
        f"median position on the flange; up to {length_text(LARGEST_MODEL_ERROR)} is plausible"
    )
    remedy = (
        "check the angles and their order, the joint map and the robot's model; check that positions are in "
        "R0 and in `units.length`"
    )
    if mistyped is not None:
        name, unit = view.robot.joint_names[mistyped.joint], "°" if view.degrees else " rad"
        given, fitting = (
            figure(np.degrees(angle) if view.degrees else angle, ".4g")
            for angle in (mistyped.given, mistyped.fitting)
        )
        distance = length_text(mistyped.distance)
        message += f"; with {name} at {fitting}{unit} instead of {given}{unit}, {distance}"
        remedy = f"check the angle of {name} for a typing error, and correct it, or repeat the observation"
    return view.build_finding(
        "target_off_model", message, f"{remedy}; {PAST_DO_NOT_USE}", "do_not_use", row=row
    )


@dataclass(frozen=True)
class MistypedJoint:
    """Joint of one observation whose position alone explains the readings."""

    joint: int  #: index of the joint
    given: float  #: position by the controller as posted [rad]
    fitting: float  #: position with which the targets are at their places [rad]
    distance: float  #: greatest distance of a target from its place with this position [m]


def find_mistyped_joint(view: View, row: int, places: FloatArray) -> MistypedJoint | None:
    """Find the revolute joint of a row whose position alone brings the targets to their places.

    Every joint is tried at each degree of a turn, and then near the best one. The joint must bring the
    targets far nearer than any other joint does; otherwise, or without a revolute joint, None is returned.

    Args:
        view: measurement set.
        row: index of the row.
        places: (T, 3) places of the targets on the flange [m].
    """
    joints = np.flatnonzero(~view.robot.prismatic)
    if not len(joints):
        return None
    given = view.measurements.joints[row, joints]
    fitting, step = given, np.radians(1.0)
    offsets = np.arange(-180, 180) * step
    for _ in range(_REFINEMENTS):
        tried = fitting[:, None] + offsets  # (joints, positions)
        distances = _try_joints(view, row, places, joints, tried)
        best = distances.argmin(axis=1)
        fitting = np.take_along_axis(tried, best[:, None], axis=1)[:, 0]
        offsets = np.linspace(-step, step, 21)
        step /= 10.0
    least = distances.min(axis=1)
    nearest, *others = np.argsort(least).tolist()
    explains = least[nearest] <= LARGEST_MODEL_ERROR
    is_clear = all(least[other] >= _CLEARLY_NEARER * least[nearest] for other in others)
    if not (explains and is_clear):
        return None
    return MistypedJoint(
        int(joints[nearest]), float(given[nearest]), float(fitting[nearest]), float(least[nearest])
    )


def _try_joints(
    view: View, row: int, places: FloatArray, joints: IndexArray, tried: FloatArray
) -> FloatArray:
    """Return the greatest distance (J, P) [m] of a target of a row from its place, for positions of joints.

    Args:
        view: measurement set.
        row: index of the row.
        places: (T, 3) places of the targets on the flange [m].
        joints: (J,) indices of the joints; one joint at a time is moved.
        tried: (J, P) positions of these joints by the controller [rad].
    """
    q = np.broadcast_to(view.measurements.joints[row], (*tried.shape, view.robot.n)).copy()
    for number, joint in enumerate(joints.tolist()):
        q[number, :, joint] = tried[number]
    postures = Postures(view.robot, view.robot.joint_map.model_angles(q.reshape(-1, view.robot.n)))
    measured = np.broadcast_to(view.measured[row], (len(postures), len(places)))
    position = np.broadcast_to(view.measurements.position[row], (len(postures), *places.shape))
    in_flange = transform_to_flange(postures, position, measured)
    return greatest_distances(in_flange, places).reshape(tried.shape)


def _find_posture_of_readings(view: View, row: int, places: FloatArray) -> int | None:
    """Return the row in whose posture the readings of a row were taken; None if they fit no posture.

    If several postures fit, the row nearest in the table is returned.

    Args:
        view: measurement set.
        row: index of the row with the readings.
        places: (T, 3) places of the targets on the flange [m].
    """
    postures = view.postures
    expected = postures.to_base(np.broadcast_to(np.nan_to_num(places), (len(postures), *places.shape)))
    is_comparable = view.measured[row] & ~np.isnan(places[:, 0])
    if not is_comparable.any():
        return None
    greatest_distance = np.linalg.norm(
        expected[:, is_comparable] - view.measurements.position[row, is_comparable], axis=2
    ).max(axis=1)
    fitting_rows = np.flatnonzero(greatest_distance <= LARGEST_MODEL_ERROR)
    return int(fitting_rows[np.abs(fitting_rows - row).argmin()]) if len(fitting_rows) else None


def _place_loaded_targets(view: View, i: int) -> FloatArray:
    """Return the loaded targets (T, 3) of row i in the flange frame [m], as if the arm did not bend."""
    deflection = view.measurements.deflection[i] @ view.postures.flange_rotation[i]
    return np.asarray(view.places[i] + deflection)


def _report_exchanged_targets(
    view: View, row: int, unloaded: IndexArray | None, loaded: IndexArray | None
) -> Iterator[Finding]:
    """Report targets of row i whose names are exchanged; one finding if both states have the same exchange.

    Args:
        view: measurement set.
        row: index of the row.
        unloaded: (T,) index of the true target of each unloaded reading; None without an exchange.
        loaded: (T,) index of the true target of each loaded reading; None without an exchange.
    """
    # If both states have the same exchange, one finding covers both.
    same_exchange = unloaded is not None and loaded is not None and np.array_equal(unloaded, loaded)
    states = [("unloaded", unloaded), ("loaded", loaded)]
    for state, true_targets in [("unloaded and loaded", unloaded)] if same_exchange else states:
        if true_targets is None:
            continue
        renamed, label = _list_wrong_names(true_targets), view.measurements.labels[row]
        *names, last = (f"'{view.measurements.targets[t]}'" for t in renamed)
        names_in_words = f"{', '.join(names)} and {last}" if names else last
        if sorted(true_targets[renamed]) == renamed:  # the wrong names are exchanged among each other
            message = f"{names_in_words} are exchanged in the {state} readings of '{label}'"
            message += (
                f": the target named {_describe_true_names(view, true_targets)}" if len(renamed) > 2 else ""
            )
            remedy = (
                f"exchange {'' if same_exchange else 'only '}the {state} values of "
                f"{names_in_words} in '{label}'"
            )
        else:  # one of the exchanged targets was not read
            message = (
                f"in the {state} readings of '{label}' the target named "
                f"{_describe_true_names(view, true_targets)}"
            )
            remedy = f"repeat the observation, or remove these readings of {names_in_words}"
        yield view.build_finding("targets_swapped", message, remedy, "do_not_use", row=row)


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
    view: View, rows: IndexArray, seen_from_flange: FloatArray, usual_places: FloatArray
) -> Iterator[Finding]:
    """Report rows in which all targets are far from their usual places, as after a mistyped angle.

    Args:
        view: measurement set.
        rows: (M,) indices of the rows.
        seen_from_flange: (M, T, 3) targets of these rows in the flange frame [m].
        usual_places: (T, 3) median places of the targets on the flange [m].
    """
    with np.errstate(invalid="ignore"):
        nearest_distance = np.fmin.reduce(np.linalg.norm(seen_from_flange - usual_places, axis=2), axis=1)
    typical = median(nearest_distance)
    greatest = max(OUTLIER * typical, SMALLEST_OUTLIER)
    for k in np.flatnonzero(nearest_distance > greatest):
        yield view.build_finding(
            "target_off_model",
            f"all targets are at least {length_text(nearest_distance[k])} away from their median positions "
            f"on the flange; the typical distance is {length_text(typical)}, and up to "
            f"{length_text(greatest)} is plausible",
            "check the angles of this observation for a typing error, and whether the robot stood still; "
            f"{PAST_CARE}",
            row=int(rows[k]),
        )


def _find_exchanges_under_load(
    view: View, rows: IndexArray, places: FloatArray
) -> tuple[list[int], list[Finding]]:
    """Find rows whose loaded readings are at the places of other targets, as after exchanged names.

    Args:
        view: measurement set.
        rows: (M,) rows whose unloaded targets are at their usual places.
        places: (T, 3) places of the targets on the flange [m].

    Returns:
        Indices of the rows with exchanged loaded readings; and the findings about them.
    """
    deflection = np.linalg.norm(view.measurements.deflection[rows], axis=2)
    is_far = (deflection > LARGEST_MODEL_ERROR).any(axis=1)
    exchanges: dict[int, IndexArray] = {}
    for row in rows[is_far].tolist():
        exchange = _match_targets_to_places(_place_loaded_targets(view, row), places)
        if exchange is not None:
            exchanges[row] = exchange
    findings: list[Finding] = []
    for row, exchange in exchanges.items():
        findings += _report_exchanged_targets(view, row, None, exchange)
    return list(exchanges), findings


def _match_targets_to_places(seen_from_flange: FloatArray, places: FloatArray) -> IndexArray | None:
    """Find which target each reading of one row shows, in case the names of targets are exchanged.

    Args:
        seen_from_flange: (T, 3) targets of one row in the flange frame [m]; NaN where not measured.
        places: (T, 3) places of the targets on the flange [m].

    Returns:
        (T,) index of the true target of each reading; None if no exchange explains the readings.
    """
    true_targets = np.arange(len(places))
    read_targets = np.flatnonzero(~np.isnan(seen_from_flange[:, 0]))
    distance = np.linalg.norm(seen_from_flange[read_targets, None] - places, axis=2)
    distance = np.where(np.isnan(distance), np.inf, distance)
    true_targets[read_targets] = distance.argmin(axis=1)
    matched = true_targets[read_targets]
    is_far = distance.min(axis=1).max() > LARGEST_MODEL_ERROR
    # A match counts only if every target has another place and at least two targets change places.
    if is_far or len(np.unique(matched)) < len(matched) or np.array_equal(matched, read_targets):
        return None
    return true_targets


@dataclass(frozen=True)
class Step:
    """Lasting displacement of one target on the flange."""

    target: int  #: index of the target
    row: int  #: index of the first observation after the displacement
    size: float  #: size of the displacement [m]
    ratio: float  #: displacement over the greatest displacement that chance allows


def inspect_rigidity(view: View, good: BoolArray) -> Iterator[Finding]:
    """Report targets that moved on the flange, and stated noise that the distances of targets contradict.

    Args:
        view: measurement set.
        good: (N,) mask of rows whose angles and names are right as far as known.
    """
    measured = view.measured & good[:, None]
    places = np.where(measured[..., None], view.places, np.nan)
    step = find_step(places, view.measurements.joints, limit_factor=_ORDERED if view.in_order else 1.0)
    if step is not None:
        yield view.build_finding(
            "target_moved",
            f"from this observation on, target '{view.measurements.targets[step.target]}' is displaced "
            f"by {length_text(step.size)} on the flange relative to the other targets, "
            f"{figure(step.ratio, '.3g')} times the limit for chance",
            "check that the target is attached firmly; give the target another name from this observation "
            "on, or repeat the observations",
            "do_not_use",
            row=step.row,
        )
    # All pairs of targets that were read together at least once
    first, second = np.triu_indices(measured.shape[1], k=1)
    usable = (measured[:, first] & measured[:, second]).any(axis=0)
    first, second = first[usable], second[usable]
    if not len(first):
        return
    both_measured = measured[:, first] & measured[:, second]
    changes = _compute_pair_changes(view, first, second, both_measured, step)
    scatter = median(np.abs(changes[:, both_measured])) / MEDIAN_SIZE
    pair_sigma = np.hypot(view.reading_sigma[:, first], view.reading_sigma[:, second])
    sigma = np.where(both_measured, pair_sigma, 0.0)
    typical_sigma = median(sigma[both_measured])
    if typical_sigma > 0.0 and both_measured.sum() >= _ENOUGH and scatter >= OVERSTATED * typical_sigma:
        yield view.build_finding(
            "sigma_suspect",
            f"distances between targets scatter by {length_text(scatter)}, but the stated noise "
            f"gives {length_text(typical_sigma)}",
            "check the stated noise and its unit; or omit `noise` so that sigma is estimated from the "
            "residuals",
        )
    # `limits` (N, P) are the greatest changes [m] that noise explains: stated noise, or the scatter of
    # distances. The factor 4 is two states (unloaded, loaded) times two signs.
    quantile = -special.ndtri(FALSE_ALARM / (4.0 * both_measured.sum()))
    scatter_limit = MODEL_ALLOWANCE * quantile * max(np.sqrt(2.0) * LEAST_SIGMA, scatter)
    limits = np.maximum(quantile * sigma, 0.5 * scatter_limit if sigma.any() else scatter_limit)
    for row in np.flatnonzero((np.abs(changes).max(axis=0) > limits).any(axis=1)).tolist():
        pairs = np.array([first, second])
        yield _report_changed_distance(
            view, row, pairs, both_measured[row], np.abs(changes[:, row]), limits[row], scatter
        )


def _compute_pair_changes(
    view: View, first: IndexArray, second: IndexArray, both_measured: BoolArray, step: Step | None
) -> FloatArray:
    """Return the distance of each pair of targets, less its median over the rows (2, N, P) [m].

    The first axis is the state: unloaded, loaded. Distances to a target that moved are compared before and
    after its step separately.

    Args:
        view: measurement set.
        first: (P,) index of the first target of each pair.
        second: (P,) index of the second target of each pair.
        both_measured: (N, P) mask of the pairs whose two targets were measured.
        step: lasting displacement of a target; None if no target moved.
    """
    measurements = view.measurements
    states = (measurements.position, measurements.position + measurements.deflection)
    distances = np.stack([np.linalg.norm(at[:, first] - at[:, second], axis=2) for at in states])
    changes = _subtract_pair_medians(distances, both_measured)
    if step is not None:
        with_moved_target = (first == step.target) | (second == step.target)
        for rows in (slice(None, step.row), slice(step.row, None)):
            changes[:, rows, with_moved_target] = _subtract_pair_medians(
                distances[:, rows, with_moved_target], both_measured[rows, with_moved_target]
            )
    return changes


def _report_changed_distance(
    view: View,
    row: int,
    pairs: IndexArray,
    both_measured: BoolArray,
    change: FloatArray,
    limit: FloatArray,
    scatter: float,
) -> Finding:
    """Return the finding that distances between targets changed in a row, with the suspected targets.

    Args:
        view: measurement set.
        row: index of the row.
        pairs: (2, P) indices of the two targets of each pair.
        both_measured: (P,) mask of the pairs whose two targets were measured in this row.
        change: (2, P) amounts by which the distances differ from their medians, unloaded and loaded [m].
        limit: (P,) greatest changes that noise explains [m].
        scatter: standard deviation of a distance [m].
    """
    names = view.measurements.targets
    worst = int((change.max(axis=0) / limit).argmax())
    # Suspect the target without which the other distances change least, and targets nearly as suspicious.
    squares = (change**2).sum(axis=0)
    present = np.unique(pairs[:, both_measured])
    remaining = np.array([squares[(pairs != target).all(axis=0)].sum() for target in present])
    suspects = present[remaining <= _CLEARER * (remaining.min() + (scatter + 1e-9) ** 2)]
    suspects_text = " or ".join(f"'{names[target]}'" for target in suspects)
    return view.build_finding(
        "targets_not_rigid",
        f"the distance between '{names[pairs[0, worst]]}' and '{names[pairs[1, worst]]}' "
        f"({'loaded' if change[1, worst] > change[0, worst] else 'unloaded'}) differs by "
        f"{length_text(change[:, worst].max())} from its median (limit {length_text(limit[worst])}): "
        f"{suspects_text} moved",
        f"check {suspects_text} for a bump, a turned reflector or a wrong name; repeat the observation, or "
        "remove that reading",
        "do_not_use",
        row=row,
    )


def _subtract_pair_medians(distances: FloatArray, both_measured: BoolArray) -> FloatArray:
    """Return distances of pairs of targets less the median distance of each pair (2, N, P) [m].

    The result is zero where a target of the pair was not measured.

    Args:
        distances: (2, N, P) distances of the P pairs in N rows, unloaded and loaded [m].
        both_measured: (N, P) mask of the pairs whose two targets were measured.
    """
    if both_measured.all():
        return np.asarray(distances - np.median(distances, axis=(0, 1)))
    differences = np.zeros(distances.shape)
    for pair in np.flatnonzero(both_measured.any(axis=0)):
        pair_lengths = distances[:, both_measured[:, pair], pair]
        differences[:, both_measured[:, pair], pair] = pair_lengths - np.median(pair_lengths)
    return differences


def find_step(places: FloatArray, joints: FloatArray, limit_factor: float = 1.0) -> Step | None:
    """Find the most significant lasting displacement of a target relative to the mean of the other targets.

    Errors of the modelled flange position cancel in a difference to other targets. An error of the modelled
    flange orientation rotates all targets together and keeps their distances. A step is therefore accepted
    only if a distance between targets changes by more than `SMALLEST_MOTION`.

    The displacement is compared with the scatter: the median change from row to row, or the scatter about the
    means before and after the step if greater. A step needs two postures before and two after.

    Args:
        places: (N, T, 3) places in the flange frame [m]; NaN where a target was not measured.
        joints: (N, n) angles [rad].
        limit_factor: factor on the greatest displacement that chance allows.

    Returns:
        The step; None if no displacement is beyond chance.
    """
    series = _list_series_relative_to_others(places)
    if not series:
        return None
    changes = np.concatenate([np.diff(relative_place, axis=0) for _, _, relative_place in series])
    usual_scatter = estimate_coordinate_scale(np.linalg.norm(changes, axis=1)) / np.sqrt(2.0)
    degrees_of_freedom = 3.0 * len(changes) * (len(series) - 1) / len(series)
    limit = limit_factor * MODEL_ALLOWANCE * compute_norm_quantile(len(changes), degrees_of_freedom)
    best = None
    for target, rows, relative_place in series:
        rows_before, shift = _find_most_significant_shift(relative_place)
        deviations = np.concatenate(
            [
                relative_place[:rows_before] - relative_place[:rows_before].mean(axis=0),
                relative_place[rows_before:] - relative_place[rows_before:].mean(axis=0),
            ]
        )
        scatter = max(usual_scatter, estimate_coordinate_scale(np.linalg.norm(deviations, axis=1)), 1e-9)
        displacement = float(np.linalg.norm(shift))
        ratio = displacement / (
            limit * scatter * np.sqrt(1.0 / rows_before + 1.0 / (len(relative_place) - rows_before))
        )
        if not ratio > (best.ratio if best else 1.0):
            continue
        # Within one posture, a step might be an error of the model in this posture.
        if any(_is_within_one_posture(joints[part]) for part in (rows[:rows_before], rows[rows_before:])):
            continue
        if _find_greatest_change_of_distance(places[rows], target, rows_before) > SMALLEST_MOTION:
            best = Step(target, int(rows[rows_before]), displacement, ratio)
    return best


def _list_series_relative_to_others(places: FloatArray) -> list[tuple[int, IndexArray, FloatArray]]:
    """Return a series for each target: its index, rows (k,), and places (k, 3) relative to the other targets.

    A target that was read in too few rows has no series.

    Args:
        places: (N, T, 3) places in the flange frame [m]; NaN where a target was not measured.
    """
    was_read = ~np.isnan(places[..., 0])
    target_count = was_read.sum(axis=1)
    if len(places) < LEAST_ROWS or target_count.max() < 2:
        return []
    most_targets = target_count.max()
    filled = np.where(was_read[..., None], places, 0.0)
    # Only rows in which the greatest number of targets was read, so that the mean of the others is comparable
    rows_of_target = [
        np.flatnonzero(was_target_read & (target_count == most_targets)) for was_target_read in was_read.T
    ]
    # For each target: index, rows, and place relative to the mean of the other targets in these rows
    return [
        (
            target,
            rows,
            filled[rows, target] - (filled[rows].sum(axis=1) - filled[rows, target]) / (most_targets - 1),
        )
        for target, rows in enumerate(rows_of_target)
        if len(rows) >= LEAST_ROWS
    ]


def _is_within_one_posture(joints: FloatArray) -> bool:
    """Return whether all rows (k, n) of joint angles [rad] are the same posture."""
    return len(np.unique(np.round(joints / SAME_ANGLE), axis=0)) < 2


def _find_greatest_change_of_distance(places: FloatArray, target: int, rows_before: int) -> float:
    """Return the greatest change of a distance to another target from before a step to after it [m].

    Args:
        places: (k, T, 3) places in the flange frame [m]; NaN where a target was not measured.
        target: index of the target.
        rows_before: number of rows before the step.
    """
    lengths = np.linalg.norm(np.delete(places, target, axis=1) - places[:, target, None], axis=2)
    lengths = lengths[:, ~np.isnan(lengths).any(axis=0)]
    change = np.abs(np.median(lengths[rows_before:], axis=0) - np.median(lengths[:rows_before], axis=0))
    return float(change.max(initial=0.0))


def _find_most_significant_shift(places: FloatArray) -> tuple[int, FloatArray]:
    """Return the number k of places before the most significant step of their mean, and the step (3,) [m].

    `places` (N, 3) [m] are in the order in which they were measured.
    """
    before = np.arange(1, len(places))
    after = len(places) - before
    sums = np.cumsum(places, axis=0)
    shifts = (sums[-1] - sums[:-1]) / after[:, None] - sums[:-1] / before[:, None]
    rows_before = 1 + int((before * after * (shifts**2).sum(axis=1)).argmax())
    return rows_before, shifts[rows_before - 1]


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
    target_counts = measured.sum(axis=1)
    # Rows with the same targets as the first row with most targets have the same barycentre.
    targets = measured[target_counts.argmax()]
    rows = np.flatnonzero((measured == targets).all(axis=1))
    _, first_of_reading = np.unique(view.measurements.number_unloaded_readings()[rows], return_index=True)
    rows = rows[np.sort(first_of_reading)]  # an unloaded reading that loads share counts once
    if target_counts.max() == 0 or len(rows) < LEAST_ROWS_OF_DRIFT or view.in_order:
        return
    triangle = _compress_drift_rows(view, rows, targets)
    degrees_of_freedom = triangle.rows - view.robot.n - 9
    if degrees_of_freedom < LEAST_FREEDOM:
        return
    squares_without_drift, squares_with_drift = (
        triangle.residual_squares(names) for names in (["model"], ["model", "motion"])
    )
    variance = max(squares_with_drift / degrees_of_freedom, _EXACT)
    ratio = (squares_without_drift - squares_with_drift) / 3.0 / variance / MODEL_ALLOWANCE**2
    p_value = float(special.fdtrc(3.0, degrees_of_freedom, max(0.0, ratio)))
    drift = triangle.fit_with(["motion"], "model").unknowns
    drift_length = float(np.linalg.norm(drift))
    if p_value < FALSE_ALARM and drift_length > SMALLEST_MOTION:
        yield view.build_finding(
            "drift_in_time",
            f"over the whole set, the unloaded targets drifted by {length_text(drift_length)} relative to "
            f"the robot's model (x {length_text(drift[0])}, y {length_text(drift[1])}, z "
            f"{length_text(drift[2])}; p = {p_value:.1g})",
            "check the tracker's stand, warm-up and temperature; a deflection is affected only by "
            "drift between its two readings",
        )


def _compress_drift_rows(view: View, rows: IndexArray, targets: BoolArray) -> Triangle:
    """Return the rows of the fit of a drift, as a triangle with the terms "model" and "motion" (the drift).

    Columns of "model" are motions of the targets' barycentre in R0 due to joint offsets, its place on the
    flange, and the position of the base.

    Args:
        view: measurement set of N rows.
        rows: (K,) indices of rows in which the same targets were measured.
        targets: (T,) mask of these targets.
    """
    postures = view.postures
    barycentres = np.zeros((len(postures), 1, 3))
    barycentres[rows, 0] = view.measurements.position[rows][:, targets].mean(axis=1)
    joint_columns = postures.jacobian_at(barycentres)[rows, 0]
    rotation = postures.flange_rotation[rows]
    base_columns = np.broadcast_to(np.eye(3), rotation.shape)
    time = (rows - rows.mean()) / np.ptp(rows)
    drift_columns = time[:, None, None] * np.eye(3)
    # Right-hand side: distance of the barycentre from its median place on the flange, axes of R0 [m]
    barycentre_on_flange = view.places[rows][:, targets].mean(axis=1)
    from_median = barycentre_on_flange - np.median(barycentre_on_flange, axis=0)
    distance = np.einsum("nij,nj->ni", rotation, from_median)
    triangle = Triangle(model=view.robot.n + 6, motion=3)
    triangle.add(
        np.concatenate([joint_columns, rotation, base_columns, drift_columns, distance[..., None]], axis=2)
    )
    return triangle


FLIPPED: Final = 0.5
"""Ratio of the residual with the load reversed to that with the load as posted, below which the load is
reported as reversed. The ratio is near 0 for a wrong sign."""
UNEXPLAINED_REVERSED: Final = 0.5
"""Greatest residual with the load reversed, relative to the predicted motion, of a load with the wrong sign:
what bends besides the joints remains. A load that belongs to another observation leaves more."""
_MORE_THAN_OTHERS: Final = 3.0
"""Residual with the load reversed, relative to the median residual of the observations, that is usual."""
_SEEN_IN_NOISE: Final = 2.0
"""Predicted motion, relative to the median residual, above which noise does not turn a deflection."""
BEYOND_NOISE: Final = 5.0
"""Deflection, in standard deviations of its noise, above which it is not noise."""
AGAINST_SIGMAS: Final = 5.0
"""Deflection of a joint opposite to its torque, in standard deviations, above which it is not noise."""
LARGEST_ENCODER_DEFLECTION: Final = 0.02
"""Largest plausible deflection of a joint [rad]: more is a mistake in a unit, or a robot that moved."""
_NOISE_OF_A_TRACKER: Final = 4e-5
"""Standard deviation of a coordinate [m] up to which a tracker may be the cause of residuals."""
SMALLEST_RESIDUAL: Final = 5e-6
"""Smallest deflection that a tracker can see [m]."""
_LEAST_SHIFTED: Final = 3
"""Least number of successive rows that a shift must explain: one row may match its neighbour by chance, and
two rows may be exchanged."""
_ROWS_PER_JOINT: Final = 3


def inspect_response(view: View, good: BoolArray) -> Iterator[Finding]:
    """Fit joint compliances to the deflections, and report mistakes that the residuals show.

    Args:
        view: measurement set.
        good: (N,) mask of rows whose angles and names are right as far as known.
    """
    rows = np.flatnonzero(good & view.loaded)
    measurements = view.measurements
    if int(measurements.coordinates[rows].sum()) < _ROWS_PER_JOINT * view.robot.n:
        return
    checked = measurements if len(rows) == len(measurements) else measurements[rows]
    noise_limit = BEYOND_NOISE * np.sqrt(2.0) * (measurements.sigma or 0.0)
    if median(np.linalg.norm(checked.deflection, axis=2)[checked.present]) <= noise_limit:
        return
    block = get_whole_block(view.robot, checked)
    springs = Springs.fit(block)
    whole_set_finding = _find_mistake_of_the_set(view, rows, block, springs)
    if whole_set_finding is not None:
        yield whole_set_finding
        return
    # `against` (M,) marks observations that are explained much better with the load reversed.
    predicted = compute_observation_norms(springs.predicted)
    residual = compute_observation_norms(springs.residual)
    reversed_residual = compute_observation_norms(springs.residual + 2.0 * springs.predicted)
    least = max(noise_limit, _MORE_THAN_OTHERS * median(residual))  # what few observations leave, too
    may_remain = np.maximum(UNEXPLAINED_REVERSED * predicted, least)
    is_explained = reversed_residual < np.minimum(FLIPPED * residual, may_remain)
    # Where the load's sign is wrong, the residual with the load reversed is the noise.
    noise = median(np.minimum(residual, reversed_residual))
    is_against_load = np.asarray(is_explained & (predicted > max(noise_limit, _SEEN_IN_NOISE * noise)))
    for position in np.flatnonzero(is_against_load):
        yield view.build_finding(
            "deflection_against_force",
            f"the other observations predict a motion of {length_text(predicted[position])} under "
            f"{figure(float(np.linalg.norm(checked.force[position])))} N, but the targets moved in the "
            "opposite direction; with the load reversed, only "
            f"{length_text(reversed_residual[position])} remains unexplained",
            "change the sign of this force, or exchange the unloaded and the loaded readings",
            "do_not_use",
            row=int(rows[position]),
        )
    # Readings of one coordinate and of three coordinates have different distributions: compare them
    # separately.
    for coordinates in (1, 3):
        compared = (checked.coordinates == coordinates) & ~is_against_load[:, None]
        yield from _report_residual_outliers(view, rows, checked, springs, compared)


def _build_unexplained_finding(view: View, measurements: Measurements, springs: Springs) -> Finding:
    """Return the finding that joints do not explain the deflections, which noise as large would hide, too."""
    typical_deflection = median(np.linalg.norm(measurements.deflection, axis=2)[measurements.present])
    noise = float(np.sqrt(0.5 * np.mean(springs.residual[measurements.present] ** 2)))  # of a coordinate
    remedy = "check the frame and signs of the forces, the joint map, and the order of angles and rows"
    if noise < _NOISE_OF_A_TRACKER:
        remedy += f"; noise of {length_text(noise)} in a coordinate does the same: if so, load the arm more"
    return view.build_finding(
        "deflections_unexplained",
        "joint compliances do not explain the deflections (median "
        f"{length_text(typical_deflection)}): {100.0 * springs.unexplained:.3g} % remain unexplained",
        remedy,
        "use",
    )


def _find_mistake_of_the_set(
    view: View, rows: IndexArray, block: RegressorBlock, springs: Springs
) -> Finding | None:
    """Return the finding about a mistake in all or many rows; None if no such mistake is found.

    Shifted rows are searched only if no positions were measured: with positions, other checks have searched
    them.

    Args:
        view: measurement set.
        rows: (M,) indices of the rows that are checked.
        block: regressor and deflections of these rows.
        springs: fit of these rows.
    """
    measurements = block.measurements
    if mistake := find_correction(view, measurements, springs):
        return mistake
    if not view.measured.any() and (shifted := _find_shifted_rows(view, rows, block, springs)):
        return shifted
    if springs.unexplained > UNEXPLAINED:
        return _build_unexplained_finding(view, measurements, springs)
    if springs.work >= 0.0:
        return None
    against_force = np.einsum("ntj,nj->n", measurements.deflection, measurements.force) < 0.0
    return view.build_finding(
        "force_sign_suspect",
        f"the work of the load on the joints is {springs.work:.3g} J, but must be positive; the "
        f"targets moved against the force in {int(against_force.sum())} of {len(against_force)} observations",
        "change the sign of every force, because forces are those on the robot; or exchange the "
        "unloaded and the loaded readings",
        "do_not_use",
        AdvisedAction.of("exchange_readings"),
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
        for shift, neighbour_name in ((-1, "before"), (1, "after")):
            shifted_residual = compute_observation_norms(deflection - np.roll(fit.predicted, -shift, axis=0))
            fits_neighbour_better = shifted_residual < BETTER * residual
            fits_neighbour_better[0 if shift < 0 else -1] = (
                False  # `roll` gives the first or last row a wrong neighbour
            )
            marked_rows = np.flatnonzero(fits_neighbour_better)
            # Split the marked rows into runs of successive rows, and take the longest.
            run = max(np.split(marked_rows, np.flatnonzero(np.diff(marked_rows) > 1) + 1), key=len)
            if len(run) >= _LEAST_SHIFTED and len(run) > len(longest):
                longest, neighbour = run, neighbour_name
    if not len(longest):
        return None
    first, last = rows[longest[[0, -1]]].tolist()
    return view.build_finding(
        "observations_out_of_order",
        f"the deflections of {len(longest)} observations, observations[{first}] to [{last}], "
        f"match the load and posture of the row {neighbour}, not their own",
        f"shift the readings of these rows by one: each reading belongs to the angles of the row {neighbour}",
        "do_not_use",
        row=first,
    )


def _report_residual_outliers(
    view: View, rows: IndexArray, measurements: Measurements, springs: Springs, compared: BoolArray
) -> Iterator[Finding]:
    """Yield a finding for each reading whose residual is far above the typical residual.

    A residual is an outlier if it exceeds the typical residual by a factor, `SMALLEST_RESIDUAL` and the
    stated noise; and if it is also an unusual share of the deflection. Two targets of an observation whose
    names look exchanged give a single finding.

    Args:
        view: measurement set.
        rows: (M,) indices of the rows that are compared.
        measurements: measurements of these rows.
        springs: fit of these rows.
        compared: (M, T) mask of the readings to compare, all with the same number of coordinates.
    """
    residual_norm, targets = np.linalg.norm(springs.residual, axis=2), measurements.targets
    reading_count = int(compared.sum())
    coordinate_count = int(measurements.coordinates[compared].max(initial=0))
    degrees_of_freedom = coordinate_count * reading_count - springs.parameter_count
    if degrees_of_freedom < springs.parameter_count:  # too few readings for a typical residual
        return
    typical_residual = estimate_coordinate_scale(residual_norm[compared], coordinate_count) * np.sqrt(
        coordinate_count * reading_count / degrees_of_freedom
    )
    limit = MODEL_ALLOWANCE * typical_residual
    limit *= compute_norm_quantile(reading_count, degrees_of_freedom, coordinate_count)
    # Limit from the stated noise, which is known: its degrees of freedom are practically infinite.
    noise_quantile = compute_norm_quantile(reading_count, 1e6, coordinate_count)
    noise_limit = noise_quantile * np.sqrt(2.0) * view.reading_sigma[rows]
    is_outlier = compared & (residual_norm > np.maximum(max(limit, SMALLEST_RESIDUAL), noise_limit))
    is_outlier &= _have_unusual_shares(residual_norm, measurements, springs, compared, coordinate_count)
    for position in np.flatnonzero(is_outlier.any(axis=1)):
        worst_target = int(np.where(compared[position], residual_norm[position], 0.0).argmax())
        pair = find_exchanged_pair(
            measurements.deflection[position], springs.predicted[position], measurements.present[position]
        )
        if pair is not None:
            yield view.build_finding(
                "targets_swapped",
                "joint compliances explain the deflections twice as well if those of "
                f"'{targets[pair[0]]}' and '{targets[pair[1]]}' are exchanged",
                f"exchange the names of the two targets in '{measurements.labels[position]}'",
                "do_not_use",
                row=int(rows[position]),
            )
            continue
        yield view.build_finding(
            "residual_outlier",
            f"the deflection of target '{targets[worst_target]}' differs by "
            f"{length_text(residual_norm[position, worst_target])} from the fit to all observations; "
            f"the typical difference is {length_text(typical_residual)}",
            "check this reading and its load; repeat the reading"
            + (", or identify with loss huber" if coordinate_count == 3 else ""),
            row=int(rows[position]),
        )


def _have_unusual_shares(
    residual_norm: FloatArray,
    measurements: Measurements,
    springs: Springs,
    compared: BoolArray,
    coordinate_count: int,
) -> BoolArray:
    """Return a mask (M, T) of residuals that are an unusual share of the deflection.

    Parts other than joints bend with the load, so that residuals grow with the deflection.

    Args:
        residual_norm: (M, T) norms of the residuals [m].
        measurements: measurements of M rows.
        springs: fit of these rows.
        compared: (M, T) mask of the readings to compare.
        coordinate_count: number of coordinates of each of these readings.
    """
    deflection = np.maximum(
        np.linalg.norm(measurements.deflection, axis=2), np.linalg.norm(springs.predicted, axis=2)
    )
    share = residual_norm / np.maximum(deflection, 1e-300)
    reading_count = int(compared.sum())
    limit = MODEL_ALLOWANCE * compute_norm_quantile(
        reading_count, coordinate_count * reading_count, coordinate_count
    )
    limit *= estimate_coordinate_scale(share[compared], coordinate_count)
    return np.asarray(share > min(limit, UNEXPLAINED))


def find_exchanged_pair(
    deflection: FloatArray, predicted: FloatArray, present: BoolArray
) -> tuple[int, int] | None:
    """Return the indices of two targets whose deflections fit far better if exchanged; else None.

    Args:
        deflection: (T, 3) measured deflections [m].
        predicted: (T, 3) predicted deflections [m].
        present: (T,) mask of the targets that were read.
    """
    read_targets = np.flatnonzero(present)
    best_pair = None
    least_distance = BETTER * float(np.linalg.norm(deflection[read_targets] - predicted[read_targets]))
    for first, second in combinations(read_targets.tolist(), 2):
        order = np.arange(len(present))
        order[[first, second]] = second, first
        distance = float(np.linalg.norm(deflection[order][read_targets] - predicted[read_targets]))
        if distance < least_distance:
            best_pair, least_distance = (first, second), distance
    return best_pair


def inspect_encoders(view: View) -> Iterator[Finding]:
    """Report encoders that show a deflection opposite to the load's torque, or an implausibly large one.

    A spring yields in the direction of its torque, so only noise makes the work ``τ_j δθ_j`` negative.

    Yields:
        At most one finding of each kind for each joint.
    """
    joint_names, encoders = view.robot.joint_names, view.measurements.encoders  # only of rotary joints
    if encoders is None:
        return
    torque = np.concatenate([block.torque for block in regressor_blocks(view.robot, view.measurements)])
    work = encoders.deflection * np.sign(torque)
    is_against_torque = encoders.present & (-work > AGAINST_SIGMAS * np.sqrt(2.0) * encoders.sigma)
    size = np.abs(encoders.deflection)
    for joint in np.flatnonzero(is_against_torque.any(axis=0)):
        rows = np.flatnonzero(is_against_torque[:, joint])
        worst = int(rows[size[rows, joint].argmax()])
        yield view.build_finding(
            "encoder_against_torque",
            f"the encoder of {joint_names[joint]} shows {1e6 * encoders.deflection[worst, joint]:.3g} "
            f"µrad, opposite to the torque of {figure(torque[worst, joint])} N.m, in {len(rows)} of "
            f"{int(encoders.present[:, joint].sum())} readings",
            "check that the encoder has the sign of the model's joint, not of the controller's; check "
            "the signs of the force; check that unloaded and loaded readings are not exchanged",
            row=worst if len(rows) == 1 else None,
        )
    for joint in np.flatnonzero(size.max(axis=0) > LARGEST_ENCODER_DEFLECTION):
        worst = int(size[:, joint].argmax())
        yield view.build_finding(
            "encoder_deflection_implausibly_large",
            f"the encoder of {joint_names[joint]} shows a deflection of {1e3 * size[worst, joint]:.3g} "
            f"mrad; up to {1e3 * LARGEST_ENCODER_DEFLECTION:g} mrad is plausible",
            "check `units.angle`, and that unloaded and loaded readings are of the same posture; "
            f"{PAST_CARE}",
            row=worst,
        )
