"""Test of the deflections against those that joint compliances give under the loads.

No stiffness is assumed: any springs will do. They give way to the load, so that its work is positive; and
what no springs explain is a mistake in angles, order or load, or something else that bends.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Action, Finding
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.integrity.places import angle_hypotheses
from jointstiff.solver.integrity.values import MODEL_ALLOWANCE, View, median, vector_quantile, vector_scale
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.terms.block import RegressorBlock, regressor_blocks, whole_block
from jointstiff.solver.text import length_text

UNEXPLAINED: Final = 0.5
"""Unexplained share of the median deflection: joints explain 80 % of a real robot's, the paper's worst
method half."""
WORTH_A_SEARCH: Final = 0.05
"""Unexplained share above which a mistake of the whole set is searched where no position was read."""
BETTER: Final = 0.5
"""Ratio of what is unexplained, corrected to as posted, below which a mistake is reported."""
FLIPPED: Final = 0.5
"""Ratio of the residuals with the load reversed and as posted: 2 for a perfect fit, 0 for a wrong sign."""
BEYOND_NOISE: Final = 5.0
AGAINST_SIGMAS: Final = 5.0
"""Deflection of a joint opposite to its torque, in standard deviations, above which it is not noise."""
LARGEST_ENCODER_DEFLECTION: Final = 0.02
"""Largest plausible deflection of a joint [rad]: more is a mistake in a unit, or a robot that moved."""
SMALLEST_RESIDUAL: Final = 5e-6
"""Smallest deflection that a tracker can see [m]."""
LEAST_ROWS: Final = 3
"""Least number of rows that one shift must explain: one may match its neighbour by chance, two may be
exchanged."""
_ROWS_PER_JOINT: Final = 3
_ROUNDS: Final = 8
_NULL: Final = 1e-9
"""Norm of a column, relative to the largest, below which no load twists its joint."""
_RIDGE: Final = 1e-9
"""Regularisation, relative to unit columns: combinations that no load shows stay near zero."""
_SAMPLE: Final = 2000
"""Number of observations that determine a few compliances well enough to judge all by them."""
_ALL: Final = slice(None)


@dataclass(frozen=True, eq=False)
class Springs:
    """A fit of N observations of T targets."""

    predicted: FloatArray  #: (N, T, 3) deflections [m]; zero where not read
    residual: FloatArray  #: (N, T, 3) measured less predicted [m]
    work: float  #: work of the load, as predicted, summed over the observations [J]; springs make it positive
    parameters: int  #: joints that were fitted
    unexplained: float  #: median residual of an observation over its median deflection

    @classmethod
    def fit(cls, block: RegressorBlock, rows: slice = _ALL, shift: int = 0) -> Springs:
        """Fit compliances of either sign, by sums of distances rather than of squares.

        So some mistakes move them little.

        Args:
            block: of the whole set.
            rows: which deflections are fitted; all are predicted.
            shift: by how many rows the loads and postures that they belong to lie after them.
        """
        deflection, count = block.measurements.deflection, len(block.A)
        chosen = np.arange(count)[rows]
        chosen = chosen[(chosen + shift >= 0) & (chosen + shift < count)]
        chosen = chosen[:: max(1, -(-len(chosen) // _SAMPLE))]
        A = block.A[chosen + shift].reshape(len(chosen), -1, block.A.shape[-1])
        compliance = _least_distances(A, deflection[chosen].reshape(len(chosen), -1))
        predicted = block.A @ compliance
        moved = median(norms(deflection))
        return cls(
            predicted=predicted,
            residual=deflection - predicted,
            work=float((block.torque**2).sum(axis=0) @ compliance),
            parameters=int(np.count_nonzero(compliance)),
            unexplained=median(norms(deflection - predicted)) / moved if moved else 0.0,
        )


def _least_distances(A: FloatArray, d: FloatArray) -> FloatArray:
    """Compliances (n,) that minimise the sum of the observations' distances ‖d_i − A_i c‖, by reweighting."""
    norms = np.sqrt((A**2).sum(axis=(0, 1)))
    visible = np.flatnonzero(norms > _NULL * norms.max())
    compliance = np.zeros(A.shape[-1])
    if not len(visible):
        return compliance
    scaled = A[..., visible] / norms[visible]
    gram, moment = scaled.transpose(0, 2, 1) @ scaled, np.einsum("kij,ki->kj", scaled, d)
    weight, held = np.ones(len(d)), _RIDGE / len(d) * np.eye(len(visible))
    for _ in range(_ROUNDS):
        G = np.einsum("k,kij->ij", weight, gram) / weight.sum()
        x = np.linalg.solve(G + held, weight @ moment / weight.sum())
        distance = np.linalg.norm(d - scaled @ x, axis=1)
        weight = 1.0 / np.maximum(distance, max(1e-3 * median(distance), 1e-12))
    compliance[visible] = x / norms[visible]
    return compliance


def norms(rows: FloatArray) -> FloatArray:
    """Return the lengths (N,) of all that belongs to each observation."""
    return np.asarray(np.linalg.norm(rows.reshape(len(rows), -1), axis=1))


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
    block = whole_block(view.robot, part)
    springs = Springs.fit(block)
    of_the_set = _mistake_of_the_set(view, rows, block, springs)
    if of_the_set is not None:
        yield of_the_set
        return
    # (M,) observations that are explained much better with the load reversed
    predicted, residual = norms(springs.predicted), norms(springs.residual)
    turned = norms(springs.residual + 2.0 * springs.predicted)
    against = np.asarray((turned < FLIPPED * residual) & (predicted > noise))
    for k in np.flatnonzero(against):
        yield view.finding(
            "deflection_against_force",
            f"under {np.linalg.norm(part.force[k]):.4g} N the targets moved opposite to the prediction from "
            f"the other observations, by {length_text(predicted[k])}; with the load reversed only "
            f"{length_text(turned[k])} remain",
            "change the sign of this force, or exchange unloaded and loaded",
            "do_not_use",
            row=int(rows[k]),
        )
    for coordinates in (1, 3):
        judged = (part.coordinates == coordinates) & ~against[:, None]
        yield from _outliers(view, rows, part, springs, judged)


def _mistake_of_the_set(
    view: View, rows: IndexArray, block: RegressorBlock, springs: Springs
) -> Finding | None:
    """Look for a mistake in all or many rows; positions that were read have told those in the angles."""
    if not view.measured.any():
        if springs.unexplained > WORTH_A_SEARCH and (mistake := _mistaken_angles(view, block, springs)):
            return mistake
        if shifted := _shifted_rows(view, rows, block, springs):
            return shifted
    part = block.measurements
    if springs.unexplained > UNEXPLAINED:
        typical = median(np.linalg.norm(part.deflection, axis=2)[part.present])
        return view.finding(
            "deflections_unexplained",
            f"joint compliances do not explain the deflections: of {length_text(typical)} (median), "
            f"{100.0 * springs.unexplained:.3g} % remain unexplained",
            "check the frame and signs of the forces, the joint map, and the order of angles and rows",
            "use",
        )
    if springs.work >= 0.0:
        return None
    moved = np.einsum("ntj,nj->n", part.deflection, part.force) < 0.0
    return view.finding(
        "force_sign_suspect",
        f"the work of the load on the joints is {springs.work:.3g} J, but must be positive; the "
        f"targets moved against the force in {int(moved.sum())} of {len(moved)} observations",
        "change the sign of every force (it is the force on the robot); or exchange unloaded and loaded",
        "do_not_use",
        Action.of("exchange_readings"),
    )


def _mistaken_angles(view: View, block: RegressorBlock, springs: Springs) -> Finding | None:
    """Look for a mistake in the angles whose correction leaves less than half of what is unexplained."""
    part, judged = block.measurements, []
    for hypothesis in angle_hypotheses(part.joints, np.arange(len(part)), view.robot.joint_names):
        corrected = replace(part[hypothesis.rows], joints=hypothesis.joints)
        judged.append((Springs.fit(whole_block(view.robot, corrected)).unexplained, hypothesis))
    left, best = min(judged, key=lambda pair: pair[0])
    if left >= BETTER * springs.unexplained or left > UNEXPLAINED:
        return None
    return view.finding(
        best.code,
        f"joint compliances leave {100.0 * springs.unexplained:.3g} % of the deflections "
        f"unexplained; with {best.figure}, {100.0 * left:.3g} %",
        best.remedy,
        "do_not_use",
    )


def _shifted_rows(view: View, rows: IndexArray, block: RegressorBlock, springs: Springs) -> Finding | None:
    """Look for rows whose deflections fit a neighbour better by far: the longest run of them.

    With too many such rows, the springs are those of the half that is surely alike.
    """
    fits, deflection = [springs], block.measurements.deflection
    if springs.unexplained > UNEXPLAINED:
        half = len(block.A) // 2
        fits = [Springs.fit(block, slice(None, half))]
        fits += [Springs.fit(block, slice(half, None), shift) for shift in (-1, 1)]
    longest, neighbour = np.empty(0, np.intp), ""
    for fit in fits:
        own = norms(fit.residual)
        for by, name in ((-1, "before"), (1, "after")):
            better = norms(deflection - np.roll(fit.predicted, -by, axis=0)) < BETTER * own
            better[0 if by < 0 else -1] = False  # the neighbour of the end is not beside it
            marked = np.flatnonzero(better)
            run = max(np.split(marked, np.flatnonzero(np.diff(marked) > 1) + 1), key=len)
            if len(run) >= LEAST_ROWS and len(run) > len(longest):
                longest, neighbour = run, name
    if not len(longest):
        return None
    first, last = rows[longest[[0, -1]]].tolist()
    return view.finding(
        "observations_out_of_order",
        f"the deflections of {len(longest)} observations, observations[{first}] to [{last}], "
        f"match the load and posture of the row {neighbour}, not their own",
        f"shift the readings of these rows by one: each belongs to the angles of the row {neighbour}",
        "do_not_use",
        row=first,
    )


def _outliers(
    view: View, rows: IndexArray, part: Measurements, springs: Springs, judged: BoolArray
) -> Iterator[Finding]:
    """Find readings far beyond the others' residuals; a robust fit leaves them where they are.

    Those judged (M, T) are compared with each other, and have as many coordinates each.
    """
    norm, targets = np.linalg.norm(springs.residual, axis=2), part.targets
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
    beyond = judged & (norm > np.maximum(max(limit, SMALLEST_RESIDUAL), stated))
    beyond &= share > min(share_limit, UNEXPLAINED)
    for k in np.flatnonzero(beyond.any(axis=1)):
        t = int(np.where(judged[k], norm[k], 0.0).argmax())
        pair = exchanged_pair(part.deflection[k], springs.predicted[k], part.present[k])
        if pair is not None:
            yield view.finding(
                "targets_swapped",
                f"with the deflections of '{targets[pair[0]]}' and '{targets[pair[1]]}' exchanged, joint "
                "compliances explain them twice as well",
                "exchange their names in this observation",
                "do_not_use",
                row=int(rows[k]),
            )
            continue
        yield view.finding(
            "residual_outlier",
            f"the deflection of target '{targets[t]}' differs by {length_text(norm[k, t])} from "
            f"the fit to all observations; typical is {length_text(scale)}",
            "check this reading and its load; repeat it"
            + (", or identify with loss huber" if each == 3 else ""),
            row=int(rows[k]),
        )


def exchanged_pair(
    deflection: FloatArray, predicted: FloatArray, present: BoolArray
) -> tuple[int, int] | None:
    """Two targets whose deflections (T, 3) [m] fit better by far under each other's name."""
    read = np.flatnonzero(present)
    best, least = None, BETTER * float(np.linalg.norm(deflection[read] - predicted[read]))
    for a, b in combinations(read.tolist(), 2):
        order = np.arange(len(present))
        order[[a, b]] = b, a
        left = float(np.linalg.norm(deflection[order][read] - predicted[read]))
        if left < least:
            best, least = (a, b), left
    return best


def inspect_encoders(view: View) -> Iterator[Finding]:
    """Look for encoders that cannot be right: against the load's torque, or further than joints bend.

    A spring gives way to its torque, so ``τ_j δθ_j`` is work done on it, and not negative but by noise.

    Yields:
        At most one finding of each kind a joint.
    """
    names, encoders = view.robot.joint_names, view.measurements.encoders  # none of prismatic joints
    if encoders is None:
        return
    torque = np.concatenate([block.torque for block in regressor_blocks(view.robot, view.measurements)])
    work = encoders.deflection * np.sign(torque)
    against = encoders.present & (-work > AGAINST_SIGMAS * np.sqrt(2.0) * encoders.sigma)
    size = np.abs(encoders.deflection)
    for j in np.flatnonzero(against.any(axis=0)):
        rows = np.flatnonzero(against[:, j])
        worst = int(rows[size[rows, j].argmax()])
        yield view.finding(
            "encoder_against_torque",
            f"the encoder of {names[j]} shows {1e6 * encoders.deflection[worst, j]:.3g} µrad, opposite to "
            f"the torque of {torque[worst, j]:.4g} N.m, in {len(rows)} of "
            f"{int(encoders.present[:, j].sum())} readings",
            "check the encoder's sign, which is that of the model's joint, not the controller's; that "
            "unloaded and loaded are not exchanged; and the signs of the force",
            row=worst if len(rows) == 1 else None,
        )
    for j in np.flatnonzero(size.max(axis=0) > LARGEST_ENCODER_DEFLECTION):
        worst = int(size[:, j].argmax())
        yield view.finding(
            "encoder_deflection_implausibly_large",
            f"the encoder of {names[j]} shows a deflection of {1e3 * size[worst, j]:.3g} mrad",
            "check `units.angle`, and that unloaded and loaded readings are of the same posture",
            row=worst,
        )
