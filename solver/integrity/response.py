"""Whether the deflections are what springs in the joints make of the loads.

No stiffness is assumed: any springs will do. They give way to the load, so that its work is positive; and what
no springs explain is a mistake in angles, order or load, or something else that bends.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from solver.configuration import Configurations
from solver.finding import Finding, length_text
from solver.integrity.hypotheses import Hypothesis, angle_hypotheses
from solver.integrity.springs import Springs, fit_springs
from solver.integrity.thresholds import MODEL_ALLOWANCE, vector_quantile, vector_scale
from solver.integrity.view import View
from solver.measurements import Measurements

__all__ = ["inspect_response"]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.intp]

UNEXPLAINED: Final = 0.5
"""Of the median deflection. Joints explain four fifths of a real robot's, the paper's worst method a half."""
WORTH_A_SEARCH: Final = 0.05
"""Unexplained share from which a mistake of the whole set is looked for where no position was read."""
BETTER: Final = 0.5
"""Ratio of what a corrected mistake leaves unexplained: what bends beside the joints bends as posted, too."""
FLIPPED: Final = 0.5
"""Ratio of the residuals with the load reversed and as posted: 2 for a perfect fit, 0 for a wrong sign."""
BEYOND_NOISE: Final = 5.0
_ROWS_PER_JOINT: Final = 3


def inspect_response(view: View, good: BoolArray) -> Iterator[Finding]:
    """Fit any springs to the deflections and look at what is left.

    Args:
        view: of the set.
        good: (N,) rows whose angles and names are not in doubt.
    """
    rows = np.flatnonzero(good & view.loaded)
    m = view.measurements
    if 3 * int(m.present[rows].sum()) < _ROWS_PER_JOINT * view.robot.n:
        return
    part = m if len(rows) == len(m) else m[rows]
    at = (
        view.configurations
        if len(rows) == len(m)
        else Configurations(view.robot, view.robot.joint_map.model_angles(part.joints))
    )
    springs = fit_springs(at, part)
    noise = BEYOND_NOISE * np.sqrt(2.0) * (m.sigma or 0.0)
    deflection = np.linalg.norm(part.deflection, axis=2)[part.present]
    if np.median(deflection) <= noise:
        return
    if not view.measured.any() and springs.unexplained > WORTH_A_SEARCH:
        mistake = _mistake(view, part, springs)
        if mistake is not None:
            yield mistake
            return
    if springs.unexplained > UNEXPLAINED:
        yield _unexplained(springs, deflection)
        return
    if springs.work < 0.0:
        yield _force_sign(part, springs)
        return
    against = _against_force(springs, noise)
    yield from (_turned(int(rows[k]), part, springs, int(k)) for k in np.flatnonzero(against))
    yield from _outliers(view, rows, part, springs, ~against)


def _unexplained(springs: Springs, deflection: FloatArray) -> Finding:
    return Finding(
        "deflections_unexplained",
        None,
        f"no springs in the joints explain the deflections: of {length_text(float(np.median(deflection)))} in the "
        f"median, {100.0 * springs.unexplained:.3g} % remain",
        "check the frame and signs of the forces, the joint map, the order of angles and of rows",
    )


def _force_sign(part: Measurements, springs: Springs) -> Finding:
    moved = np.einsum("ntj,nj->n", part.deflection, part.force) < 0.0
    return Finding(
        "force_sign_suspect",
        None,
        f"the load's work on the joints comes out at {springs.work:.3g} J, and springs make it positive; the targets "
        f"moved against the force in {int(moved.sum())} of {len(moved)} observations",
        "change the sign of every force, which is the one on the robot; or exchange unloaded and loaded",
        "error",
    )


def _against_force(springs: Springs, noise: float) -> BoolArray:
    """(M,) observations that are explained much better with the load reversed."""
    predicted, residual = _norms(springs.predicted), _norms(springs.residual)
    turned = _norms(springs.residual + 2.0 * springs.predicted)
    return np.asarray((turned < FLIPPED * residual) & (predicted > noise))


def _turned(i: int, part: Measurements, springs: Springs, k: int) -> Finding:
    size, other = _norms(springs.predicted)[k], _norms(springs.residual + 2.0 * springs.predicted)[k]
    force = float(np.linalg.norm(part.force[k]))
    return Finding(
        "deflection_against_force",
        i,
        f"under {force:.4g} N the targets moved against what the other observations say, by {length_text(size)}; with "
        f"the load reversed only {length_text(other)} remain",
        "change the sign of this force, or exchange unloaded and loaded",
        "error",
    )


def _outliers(
    view: View, rows: Rows, part: Measurements, springs: Springs, usual: BoolArray
) -> Iterator[Finding]:
    """Readings far beyond the others' residuals; a robust fit leaves them where they are."""
    norm = np.linalg.norm(springs.residual, axis=2)
    judged = part.present & usual[:, None]
    count = int(judged.sum())
    freedom = 3 * count - springs.parameters
    if freedom < 3 * springs.parameters:
        return
    scale = vector_scale(norm[judged]) * np.sqrt(3.0 * count / freedom)
    limit = MODEL_ALLOWANCE * vector_quantile(count, freedom) * scale
    stated = vector_quantile(count, 1e6) * np.sqrt(2.0) * view.reading_sigma[rows]
    beyond = judged & (norm > np.maximum(limit, stated))
    for k in np.flatnonzero(beyond.any(axis=1)):
        t = int(np.where(judged[k], norm[k], 0.0).argmax())
        yield Finding(
            "residual_outlier",
            int(rows[k]),
            f"target '{view.targets[t]}' moved by {length_text(norm[k, t])} other than springs fitted to all make it, "
            f"and such residuals are {length_text(scale)} mostly",
            "check this reading and its load; repeat it, or identify with loss huber",
        )


def _mistake(view: View, part: Measurements, springs: Springs) -> Finding | None:
    """A mistake of the whole set whose correction leaves less than half of what is unexplained."""
    robot, every = view.robot, np.arange(len(part))
    judged = []
    for hypothesis in angle_hypotheses(part.joints, every, robot.joint_names):
        kept = hypothesis.rows
        corrected = replace(part if len(kept) == len(part) else part[kept], joints=hypothesis.joints)
        at = Configurations(robot, robot.joint_map.model_angles(corrected.joints))
        judged.append((fit_springs(at, corrected).unexplained, hypothesis))
    left, best = min(judged, key=lambda pair: pair[0])
    if left >= BETTER * springs.unexplained or left > UNEXPLAINED:
        return None
    return _corrected(best, left, springs)


def _corrected(best: Hypothesis, left: float, springs: Springs) -> Finding:
    return Finding(
        best.code,
        None,
        f"springs leave {100.0 * springs.unexplained:.3g} % of the deflections unexplained; with {best.figure}, "
        f"{100.0 * left:.3g} %",
        best.remedy,
        "error",
    )


def _norms(rows: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(rows.reshape(len(rows), -1), axis=1))
