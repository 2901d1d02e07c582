"""Mistakes of a whole set that springs show: the correction after which joints explain the deflections.

Each correction is another set of measurements. The simplest one counts that leaves about as little
unexplained as the best one, and far less than the set as given.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
import pinocchio as pin
from scipy.optimize import linear_sum_assignment, minimize

from jointstiff.schemas.finding import AdvisedAction, Finding
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.integrity.exchanged import list_exchanges
from jointstiff.solver.integrity.explain import BETTER, Correction, explain
from jointstiff.solver.integrity.joints import list_joint_maps, list_joint_mistakes
from jointstiff.solver.integrity.parts import list_axes, name_axes
from jointstiff.solver.integrity.response import UNEXPLAINED, Springs
from jointstiff.solver.integrity.values import View, median
from jointstiff.solver.mechanics.block import get_whole_block, targets_in_flange, unloaded_postures
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import PAST_DO_NOT_USE

LEAST_OBSERVATIONS: Final = 6
"""Least number of observations that show a mistake of all loads: few fit well after some correction."""
_WORTH_A_SEARCH: Final = 0.02
"""Unexplained share above which a correction is searched."""
_WORTH_AN_ORDER: Final = 0.3
"""Unexplained share above which an order of the loads is searched: joints of real robots leave less."""
_ROUNDING: Final = 0.01
"""Difference of unexplained shares that tells nothing."""
_SAME_AXES: Final = 0.03
"""Largest difference of a turn from exchanged axes [rad]."""
_LEAST_TURN: Final = 0.05
"""Least turn of all forces [rad] that is reported: a rope is known to some degrees."""
_TURNS: Final = 24
"""Number of turns about the vertical axis that are tried: trackers stand upright."""
_MOST_SHIFTED: Final = 3
_MOST_EXCHANGED: Final = 5
"""Number of targets up to which all sets of targets with exchanged states are tried."""
_ROWS_OF_ORDER: Final = range(8, 101)
"""Numbers of observations whose order of loads is searched."""
_LEAST_LEVER: Final = 0.01
"""Least distance of a load point from an origin [m] that a moment about this origin shows."""
_SAME_STEP: Final = 0.01
_SUBTRACT: Final = "subtract the cross product of load point and force"
_BY_PLACE: Final = 0.15
"""Ratio of the unexplained share with a load point at a target: others may be near a target by chance."""
_BY_LOADS: Final = 0.75
"""Ratio of the unexplained share after a small change of the loads, which fits nothing, to that as given."""
_BY_ORDER: Final = 0.35
"""Ratio of the unexplained share in any order of the loads to that as given: some order fits by chance."""


def find_correction(view: View, measurements: Measurements, springs: Springs) -> Finding | None:
    """Return the finding about the simplest correction that explains the deflections; None without one."""
    if len(measurements) < LEAST_OBSERVATIONS:
        return None
    robot, found = view.robot, None
    if springs.unexplained > _WORTH_A_SEARCH:
        groups = [list_corrections(view, measurements)]
        found = explain(springs, groups, lambda each: _score(robot, each), UNEXPLAINED, _ROUNDING)
    if found is None and springs.by_all_rows.unexplained > _WORTH_AN_ORDER:
        springs = springs.by_all_rows
        rows = [[_exchange_states_of_rows(measurements, springs), *_search_order(robot, measurements)]]
        found = explain(springs, rows, lambda each: _score(robot, each).by_all_rows, _BY_ORDER, _ROUNDING)
    # Rows with exchanged states are reported one by one.
    return None if found is None or not found[0].remedy else _report(view, found[0], springs, found[1])


def _score(robot: Robot, correction: Correction) -> Springs:
    """Return how well springs explain the deflections after a correction."""
    fit = Springs.fit(get_whole_block(robot, correction.corrected))
    return replace(fit, unexplained=np.inf) if fit.work < 0.0 and not correction.may_reverse else fit


def _report(view: View, found: Correction, given: Springs, corrected: Springs) -> Finding:
    """Build the finding about a correction."""
    change, remedy = found.change, found.remedy
    if corrected.work < 0.0:
        change, remedy = f"{change} and reversed", f"{remedy}, and change the sign of every force"
    shares = [f"{100.0 * each.unexplained:.3g} %" for each in (given, corrected)]
    message = f"joint compliances leave {shares[0]} of the deflections unexplained, and {change} {shares[1]}"
    return view.build_finding(
        found.code,
        f"{found.cause}: {message}" if found.cause else message,
        f"{remedy}; {PAST_DO_NOT_USE}",
        "do_not_use",
        found.action,
    )


def list_corrections(view: View, given: Measurements) -> Iterator[Correction]:
    """Yield the corrections that are tried, the simplest first."""
    yield from _list_orders(given)
    yield from _list_series(given)
    yield from _list_frames(view.robot, given)
    yield from _list_exchanges(view.robot, given)
    if not view.measured.any():  # else the places of the targets show mistaken joints, far more exactly
        maps = list_joint_maps(view.robot, given)
        best_map = min(maps, key=lambda each: _score(view.robot, each).unexplained, default=None)
        for each in (*list_joint_mistakes(view.robot, given), *filter(None, [best_map])):
            yield replace(each, change=f"with {each.change}")
    yield from _list_axes(view.robot, given)


def _list_orders(given: Measurements) -> Iterator[Correction]:
    """Yield the orders of the loads that mistakes of bookkeeping make."""
    rows = np.arange(len(given))
    loads = np.hstack([given.force, given.moment])
    orders: dict[str, tuple[IndexArray, str]] = {}
    by_number = [[part.zfill(9) for part in re.split("([0-9]+)", label)] for label in given.labels]
    for keys, how in ((list(given.labels), "as text"), (by_number, "by their numbers")):
        ranks = np.empty_like(rows)
        ranks[sorted(rows.tolist(), key=keys.__getitem__)] = rows
        remedy = "match the forces with the observations by label, not by position (pandas: `sort=False`)"
        orders[f"in the order of the labels sorted {how}"] = ranks, remedy
    most = min(_MOST_SHIFTED, (len(rows) - 1) // 2)
    for shift in sorted(range(-most, most + 1), key=abs):
        count = "one row" if abs(shift) == 1 else f"{abs(shift)} rows"
        side = "after" if shift > 0 else "before"
        remedy = f"shift the forces by {count}: the force of each observation is {count} {side} its own row"
        orders[f"shifted by {count} against the readings, from the row {side}"] = (
            np.roll(rows, -shift),
            remedy,
        )
    orders["in reverse order"] = rows[::-1], "reverse the order of the forces"
    for what, (order, remedy) in orders.items():
        if not np.allclose(loads[order], loads):
            corrected = _reorder(given, order)
            cause = f"the forces are {what}"
            yield Correction("observations_out_of_order", corrected, cause, "in the other order", remedy)


def _reorder(given: Measurements, order: IndexArray) -> Measurements:
    """Return the measurements whose row i has the load of row `order[i]`."""
    return replace(given, force=given.force[order], moment=given.moment[order])


def _list_series(given: Measurements) -> Iterator[Correction]:
    """Yield one size of all forces if sizes grow by equal steps, as when a spreadsheet's cell is dragged."""
    sizes = np.linalg.norm(given.force, axis=1)
    steps = np.diff(sizes)
    if (
        not sizes.all()
        or not steps.any()
        or np.abs(steps - median(steps)).max() > _SAME_STEP * abs(median(steps))
    ):
        return
    yield Correction(
        "observations_out_of_order",
        replace(given, force=sizes[0] * given.force / sizes[:, None]),
        "the force changes by equal steps from row to row, as a spreadsheet fills a column by dragging "
        "its first cell",
        "with one size in all rows",
        f"if one weight hung in all rows, write {sizes[0]:.4g} N in each; else write the loads that were on",
        limit=_BY_LOADS,
    )


def _list_frames(robot: Robot, given: Measurements) -> Iterator[Correction]:
    """Yield forces turned with the flange, and moments about the load point instead of an origin."""
    postures = unloaded_postures(robot, given)
    R = postures.flange_rotation
    ways = (
        (
            R,
            "the forces are in the axes of the flange, not of R0",
            "turn those of each observation, F in R0 = R F",
        ),
        (R.mT, "the forces seem to be turned the wrong way from the flange to R0", "turn them twice with R"),
    )
    for turn, cause, remedy in ways:
        force, moment = (np.einsum("nij,nj->ni", turn, each) for each in (given.force, given.moment))
        turned = replace(given, force=force, moment=moment)
        remedy = f"give forces and moments in the axes of R0: {remedy}, with the flange's orientation R"
        yield Correction("frame_mistaken", turned, cause, "with all forces turned with the flange", remedy)
    lever = np.einsum("nij,nj->ni", R, given.load_point)
    origins = {"R0": postures.flange_translation + lever, "the flange frame": lever}
    for origin, point in origins.items():
        if given.moment.any() and np.linalg.norm(point, axis=1).max() > _LEAST_LEVER:
            moment = given.moment - np.cross(point, given.force)
            is_zero = np.linalg.norm(moment) < _SAME_STEP * np.linalg.norm(given.moment)
            here = "here they are zero, so leave out the moments" if is_zero else _SUBTRACT
            yield Correction(
                "frame_mistaken",
                replace(given, moment=moment),
                f"the moments are about the origin of {origin}, not about the load point",
                "with the moment of the force at the load point subtracted",
                f"give the moments about the load point: {here}",
                limit=_BY_LOADS,
            )


def _list_exchanges(robot: Robot, given: Measurements) -> Iterator[Correction]:
    """Yield targets whose states are exchanged, and targets that are exchanged with the load point."""
    count = len(given.targets)
    if count <= _MOST_EXCHANGED:
        yield from list_exchanges(given, count - 1, BETTER)
    places = np.where(given.in_flange[..., None], given.position, targets_in_flange(robot, given))
    for target, name in enumerate(given.targets):
        position = given.position.copy()
        in_flange = given.in_flange[:, target, None]
        position[:, target] = np.where(in_flange, given.load_point, given.position[:, target])
        yield Correction(
            "alternative_explains_better",
            replace(given, load_point=places[:, target], position=position),
            "",
            f"with the load point and target '{name}' exchanged",
            "exchange the load point and the place of the target",
            AdvisedAction.of("exchange_load_and_target", target=name),
            limit=_BY_PLACE,
        )


def _list_axes(robot: Robot, given: Measurements) -> Iterator[Correction]:
    """Yield the axes of the forces in which joints explain the deflections best: exchanged or turned ones."""
    A = _compute_regressors(robot, given)[:6].reshape(2, 3, len(given), -1, robot.n)
    deflection = given.deflection.ravel()

    def measure(axes: FloatArray) -> float:
        """Return what is left of the deflections [m] with forces and moments ``R F`` in axes R (3, 3)."""
        loads = np.stack([given.force, given.moment]) @ axes.T
        rows = np.einsum("sni,sinmj->nmj", loads, A).reshape(-1, robot.n)
        return float(np.linalg.norm(deflection - rows @ np.linalg.lstsq(rows, deflection, rcond=None)[0]))

    exchanged = [each for each, _ in list_axes() if not np.array_equal(each, -np.eye(3))]
    turned = [
        pin.exp3(np.array([0.0, 0.0, angle]))
        for angle in np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False)
    ]
    axes = min((np.eye(3), *exchanged, *turned), key=measure)
    if np.linalg.det(axes) > 0.0:
        simplex = 0.1 * np.vstack([np.zeros(3), np.eye(3)])
        nearest = axes

        def measure_turned(turn: FloatArray) -> float:
            """Return what is left of the deflections [m] after a further turn (3,) [rad]."""
            return measure(pin.exp3(turn) @ nearest)

        best = minimize(
            measure_turned,
            np.zeros(3),
            method="Nelder-Mead",
            options={"xatol": 1e-3, "initial_simplex": simplex},
        )
        axes = pin.exp3(best.x) @ nearest
        if np.linalg.norm(pin.log3(axes)) < _LEAST_TURN:
            return
    yield Correction(
        "frame_mistaken",
        replace(given, force=given.force @ axes.T, moment=given.moment @ axes.T),
        "the forces are not in the axes of R0",
        _describe_axes(axes),
        "give the forces in the axes of R0; forces in the axes of a tracker's frame that is stated need "
        "`forces` "
        "`tracker` in the `frame`",
    )


def _describe_axes(axes: FloatArray) -> str:
    """Return the axes of forces in words: exchanged axes such as `y, x, z`, or the angle of their turn."""
    if np.abs(axes - np.round(axes)).max() < _SAME_AXES:
        return f"with {name_axes(axes)} of the forces as x, y, z"
    turn = pin.log3(axes)
    angle = float(np.linalg.norm(turn))
    direction = ", ".join(f"{part:.2f}" for part in turn / angle)
    return f"with all forces turned by {np.degrees(angle):.3g}° about ({direction})"


def _exchange_states_of_rows(given: Measurements, springs: Springs) -> Correction:
    """Return the exchange of the states of all rows in which this explains more."""
    moves = given.deflection
    is_against = np.linalg.norm(moves + springs.predicted, axis=(1, 2)) < np.linalg.norm(
        moves - springs.predicted, axis=(1, 2)
    )
    corrected = replace(given, deflection=np.where(is_against[:, None, None], -moves, moves))
    return Correction("deflection_against_force", corrected, "", "with the states of some rows exchanged", "")


def _search_order(robot: Robot, given: Measurements) -> Iterator[Correction]:
    """Yield the order of the loads that joints explain best: order and compliances are found in turns."""
    if len(given) not in _ROWS_OF_ORDER or np.median(given.coordinates.sum(axis=1)) < 3:
        return
    loads, rows = np.hstack([given.force, given.moment]), np.arange(len(given))
    A = np.einsum("jk,kimn->ijmn", loads, _compute_regressors(robot, given), optimize=True)
    d = given.deflection.reshape(len(given), -1)

    def fit(order: IndexArray) -> tuple[float, FloatArray]:
        """Return what is left of the deflections [m], and the compliances (n,) that explain the rest."""
        own = A[rows, order].reshape(-1, robot.n)
        unit = np.linalg.norm(own, axis=0)
        unit[unit == 0.0] = 1.0  # of a joint that no load twists
        compliance = np.linalg.lstsq(own / unit, d.ravel(), rcond=None)[0] / unit
        return float(np.linalg.norm(d.ravel() - own @ compliance)), compliance

    def refine(compliance: FloatArray) -> IndexArray:
        """Return the order (N,) at which order and compliances no longer change."""
        order = -rows
        for _ in rows:
            cost = np.square(d[:, None] - A @ compliance).sum(axis=2)
            better = linear_sum_assignment(cost)[1]
            if np.array_equal(better, order):
                break
            order, compliance = better, fit(better)[1]
        return order

    size = np.sqrt(np.square(A).mean(axis=(0, 1, 2)))
    guesses = [np.divide(1.0, size**power, where=size > 0.0, out=np.zeros_like(size)) for power in (0, 1, 2)]
    own = A[rows, rows]
    scaled = (guess * np.linalg.norm(d) / np.linalg.norm(own @ guess) for guess in guesses)
    starts = [fit(rows)[1], *(scaled if own.any() else ())]
    order = min(map(refine, starts), key=lambda each: fit(each)[0])
    others = np.flatnonzero(np.abs(loads[order] - loads).max(axis=1) > 1e-6 * np.abs(loads).max())
    if len(others):
        shown = [
            f"'{given.labels[i]}' fits the force of '{given.labels[order[i]]}'" for i in others[:3].tolist()
        ]
        sizes = np.diff(np.linalg.norm(given.force, axis=1))
        is_sorted = (sizes >= 0.0).all() or (sizes <= 0.0).all()
        cause = (
            "the forces are sorted by size, but the readings are not"
            if is_sorted
            else "the forces belong to other rows"
        )
        yield Correction(
            "observations_out_of_order",
            _reorder(given, order),
            cause,
            f"with the forces of {len(others)} of {len(rows)} observations in another order "
            f"({', '.join(shown)})",
            "match the forces with the observations again, row by row",
            limit=_BY_ORDER,
        )


def _compute_regressors(robot: Robot, given: Measurements) -> FloatArray:
    """Return the regressors (6, N, 3 T, n) of unit components of forces, then of moments, in all rows."""
    count = len(given)
    of_units = [
        get_whole_block(
            robot, replace(given, force=np.tile(unit[:3], (count, 1)), moment=np.tile(unit[3:], (count, 1)))
        )
        for unit in np.eye(6)
    ]
    return np.array([block.A.reshape(count, -1, robot.n) for block in of_units])
