"""Test of the deflections against those that joint compliances give under the loads.

No stiffness is assumed: any springs will do. They give way to the load, so that its work is positive; and
what no springs explain is a mistake in angles, order or load, or something else that bends.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, IndexArray
from jointstiff.solver.finding import Finding, length_text
from jointstiff.solver.integrity.hypotheses import angle_hypotheses
from jointstiff.solver.integrity.springs import Shift, SpringModel, Springs, exchanged_pair, find_shift, norms
from jointstiff.solver.integrity.view import MODEL_ALLOWANCE, View, median, vector_quantile, vector_scale
from jointstiff.solver.readings.measurements import Measurements

UNEXPLAINED: Final = 0.5
"""Unexplained share of the median deflection: joints explain 80 % of a real robot's, the paper's worst
method half."""
WORTH_A_SEARCH: Final = 0.05
"""Unexplained share above which a mistake of the whole set is searched where no position was read."""
BETTER: Final = 0.5
"""Ratio of the unexplained shares, corrected to as posted, below which a mistake is reported."""
FLIPPED: Final = 0.5
"""Ratio of the residuals with the load reversed and as posted: 2 for a perfect fit, 0 for a wrong sign."""
BEYOND_NOISE: Final = 5.0
SMALLEST_RESIDUAL: Final = 5e-6
"""Smallest deflection that a tracker can see [m]."""
_ROWS_PER_JOINT: Final = 3


def inspect_response(view: View, good: BoolArray) -> Iterator[Finding]:
    """Fit any springs to the deflections and look at what is left.

    Args:
        view: of the set.
        good: (N,) rows whose angles and names are not in doubt.
    """
    rows = np.flatnonzero(good & view.loaded)
    m = view.measurements
    if int(m.coordinates[rows].sum()) < _ROWS_PER_JOINT * view.robot.n:
        return
    part = m if len(rows) == len(m) else m[rows]
    noise = BEYOND_NOISE * np.sqrt(2.0) * (m.sigma or 0.0)
    if median(np.linalg.norm(part.deflection, axis=2)[part.present]) <= noise:
        return
    model = SpringModel.of(view.robot, part)
    springs = model.fit()
    of_the_set = _of_the_set(view, rows, part, model, springs)
    if of_the_set is not None:
        yield of_the_set
        return
    # (M,) observations that are explained much better with the load reversed
    predicted, residual = norms(springs.predicted), norms(springs.residual)
    turned = norms(springs.residual + 2.0 * springs.predicted)
    against = np.asarray((turned < FLIPPED * residual) & (predicted > noise))
    yield from (_turned(int(rows[k]), part, springs, int(k)) for k in np.flatnonzero(against))
    for coordinates in (1, 3):
        yield from _outliers(view, rows, part, springs, (part.coordinates == coordinates) & ~against[:, None])


def _of_the_set(
    view: View, rows: IndexArray, part: Measurements, model: SpringModel, springs: Springs
) -> Finding | None:
    """A mistake in all rows or many; where positions were read, they have told those in the angles."""
    if not view.measured.any():
        mistake = _mistake(view, part, springs) if springs.unexplained > WORTH_A_SEARCH else None
        shifted = None if mistake else _shift(model, springs)
        if mistake is not None or shifted is not None:
            return mistake or (_shifted(rows, shifted) if shifted else None)
    if springs.unexplained > UNEXPLAINED:
        deflection = np.linalg.norm(part.deflection, axis=2)[part.present]
        return Finding(
            "deflections_unexplained",
            None,
            "joint compliances do not explain the deflections: of "
            f"{length_text(median(deflection))} (median), {100.0 * springs.unexplained:.3g} % remain "
            "unexplained",
            "check the frame and signs of the forces, the joint map, and the order of angles and rows",
        )
    return _force_sign(part, springs) if springs.work < 0.0 else None


def _force_sign(part: Measurements, springs: Springs) -> Finding:
    moved = np.einsum("ntj,nj->n", part.deflection, part.force) < 0.0
    return Finding(
        "force_sign_suspect",
        None,
        f"the work of the load on the joints is {springs.work:.3g} J, but must be positive; the "
        f"targets moved against the force in {int(moved.sum())} of {len(moved)} observations",
        "change the sign of every force (it is the force on the robot); or exchange unloaded and loaded",
        "error",
    )


def _turned(i: int, part: Measurements, springs: Springs, k: int) -> Finding:
    size, other = norms(springs.predicted)[k], norms(springs.residual + 2.0 * springs.predicted)[k]
    force = float(np.linalg.norm(part.force[k]))
    return Finding(
        "deflection_against_force",
        i,
        f"under {force:.4g} N the targets moved opposite to the prediction from the other "
        f"observations, by {length_text(size)}; with the load reversed only {length_text(other)} "
        "remain",
        "change the sign of this force, or exchange unloaded and loaded",
        "error",
    )


def _outliers(
    view: View, rows: IndexArray, part: Measurements, springs: Springs, judged: BoolArray
) -> Iterator[Finding]:
    """Find readings far beyond the others' residuals; a robust fit leaves them where they are.

    Args:
        view: of the set.
        rows: (M,) the observations.
        part: of them.
        springs: fitted to them.
        judged: (M, T) the readings to compare, all of as many coordinates.
    """
    norm = np.linalg.norm(springs.residual, axis=2)
    count, each = int(judged.sum()), int(part.coordinates[judged].max(initial=0))
    freedom = each * count - springs.parameters
    if freedom < springs.parameters:
        return
    scale = vector_scale(norm[judged], each) * np.sqrt(each * count / freedom)
    limit = MODEL_ALLOWANCE * vector_quantile(count, freedom, each) * scale
    stated = vector_quantile(count, 1e6, each) * np.sqrt(2.0) * view.reading_sigma[rows]
    # (M, T) residuals that are as unusual beside the deflection: what else bends does so with the load
    moved = np.maximum(np.linalg.norm(part.deflection, axis=2), np.linalg.norm(springs.predicted, axis=2))
    share = norm / np.maximum(moved, 1e-300)
    share_limit = MODEL_ALLOWANCE * vector_quantile(count, each * count, each)
    share_limit *= vector_scale(share[judged], each)
    beyond = (
        judged
        & (norm > np.maximum(max(limit, SMALLEST_RESIDUAL), stated))
        & (share > min(share_limit, UNEXPLAINED))
    )
    for k in np.flatnonzero(beyond.any(axis=1)):
        t = int(np.where(judged[k], norm[k], 0.0).argmax())
        pair = exchanged_pair(part.deflection[k], springs.predicted[k], part.present[k])
        if pair is not None:
            one, other = (view.targets[t] for t in pair)
            yield Finding(
                "targets_swapped",
                int(rows[k]),
                f"with the deflections of '{one}' and '{other}' exchanged, joint compliances explain them "
                "twice as well",
                "exchange their names in this observation",
                "error",
            )
            continue
        yield Finding(
            "residual_outlier",
            int(rows[k]),
            f"the deflection of target '{view.targets[t]}' differs by {length_text(norm[k, t])} from "
            f"the fit to all observations; typical is {length_text(scale)}",
            "check this reading and its load; repeat it"
            + (", or identify with loss huber" if each == 3 else ""),
        )


def _shift(model: SpringModel, springs: Springs) -> Shift | None:
    """Rows shifted from some row on: with too many, the springs are those of what is surely alike."""
    if springs.unexplained <= UNEXPLAINED:
        return find_shift(model.deflection, springs)
    half = len(model.A) // 2
    fits = [model.fit(slice(None, half))]
    fits += [model.fit(slice(half, None), shift) for shift in (-1, 1)]
    shifts = [shift for fit in fits if (shift := find_shift(model.deflection, fit)) is not None]
    return max(shifts, key=lambda shift: len(shift.rows), default=None)


def _shifted(rows: IndexArray, shifted: Shift) -> Finding:
    neighbour = "before" if shifted.by < 0 else "after"
    first, last = int(rows[shifted.rows[0]]), int(rows[shifted.rows[-1]])
    return Finding(
        "observations_out_of_order",
        first,
        f"the deflections of {len(shifted.rows)} observations, observations[{first}] to [{last}], "
        f"match the load and posture of the row {neighbour}, not their own",
        f"shift the readings of these rows by one: each belongs to the angles of the row {neighbour}",
        "error",
    )


def _mistake(view: View, part: Measurements, springs: Springs) -> Finding | None:
    """A mistake of the whole set whose correction leaves less than half of what is unexplained."""
    robot, every = view.robot, np.arange(len(part))
    judged = []
    for hypothesis in angle_hypotheses(part.joints, every, robot.joint_names):
        kept = hypothesis.rows
        corrected = replace(part if len(kept) == len(part) else part[kept], joints=hypothesis.joints)
        judged.append((SpringModel.of(robot, corrected).fit().unexplained, hypothesis))
    left, best = min(judged, key=lambda pair: pair[0])
    if left >= BETTER * springs.unexplained or left > UNEXPLAINED:
        return None
    return Finding(
        best.code,
        None,
        f"joint compliances leave {100.0 * springs.unexplained:.3g} % of the deflections "
        f"unexplained; with {best.figure}, {100.0 * left:.3g} %",
        best.remedy,
        "error",
    )
