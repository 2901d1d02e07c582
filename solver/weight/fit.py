"""Geometry, compliances and weights in one fit: Gauss-Newton outside, the convex program inside.

Columns of geometry are projected out by an orthogonal factorisation, what is left is compressed to as many
rows as columns, and the convex program of `convex.weighed` is solved for c and the products η = c (π − π⁰).
Each step moves the geometry, and the sag with the new products, until no prediction moves any more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.conic import Block, Cones, Weighed, solve_weighed
from jointstiff.solver.errors import MeasurementError, NotObservableError
from jointstiff.solver.geometry.charts import LinearFit
from jointstiff.solver.geometry.poses import PoseReadings, PoseState
from jointstiff.solver.weight.bodies import Burden, WeightReadings
from jointstiff.solver.weight.regressor import Frames, Rows, across, rows_at

Differences = Callable[[FloatArray], FloatArray]
"""Whitened rows (k, n + 1) of deflections by known loads, at compliances (n,): regressor and readings."""

MOST_STEPS: Final = 15
_CONVERGED: Final = 1e-3
"""Movement of the predictions, relative to the residuals, that ends the steps."""
_EXACT: Final = 1e-7
"""The same, relative to all that the convex program is to explain: exact readings leave no residuals."""
LARGEST_SAG: Final = 0.1
"""Sag of a joint [rad] at its greatest compliance: what sags more is no robot."""
_CONSTANT: Final = 5e-3
"""Variation of a joint's torque over the postures, relative to the torque by a weight across its axis, below
which it counts as constant: gravity's direction and that of a vertical axis are not known so well."""


@dataclass(frozen=True, eq=False)
class Reduced:
    """The convex problem of one step: ``‖A x − b‖² + outside``, x in the cones."""

    A: FloatArray  #: (p, p) compressed, columns in the blocks' units
    b: FloatArray  #: (p,)
    outside: float  #: squares of the residuals that no x explains
    cones: Cones  #: blocks of the joints seen
    unit: FloatArray  #: (n_seen,) unit of the blocks' c [rad/(N·m)]
    seen: IndexArray  #: (n_seen,) joints whose torque varies
    freedom: int  #: number of coordinates of positions less the geometry that they determine


@dataclass(frozen=True, eq=False)
class WeightFit:
    """The optimum of geometry, compliances and weights."""

    state: PoseState  #: geometry, in the frame of the positions
    gravity: FloatArray  #: (3,) in the same frame [m/s²]
    sag: FloatArray  #: (N, n) θ [rad]
    compliance: FloatArray  #: (n,) [rad/(N·m)]; zero where unseen
    rows: Rows  #: rows of the last step
    reduced: Reduced  #: the problem of the last step
    optimum: Weighed  #: its solution
    steps: int  #: number of steps of Gauss and Newton


def fit_weight(
    readings: WeightReadings,
    whitened: PoseReadings,
    frames: Frames,
    state: PoseState,
    *,
    free_gravity: bool = False,
    differences: Differences,
) -> WeightFit:
    """Fit geometry, compliances and weights.

    Args:
        readings: N observations.
        whitened: the same positions with their weights.
        frames: of the nominal robot.
        state: geometry to start from, as without sag.
        free_gravity: whether gravity's direction is estimated, too.
        differences: deflections by known loads that join in, whitened in the same unit; none have no rows.

    Raises:
        NotObservableError: no joint's torque varies.
        MeasurementError: no convergence.
        SolverError: a convex program is not certified.
    """
    burden = readings.burden
    gravity, sag = burden.gravity, np.zeros(whitened.angles.shape)
    c: FloatArray = np.zeros(whitened.angles.shape[1])
    weight = np.linalg.norm(whitened.weight)
    for step in range(1, MOST_STEPS + 1):
        tilted = replace(readings, burden=replace(burden, gravity=gravity))
        rows = rows_at(tilted, whitened, frames, state, sag, c)
        nuisance = np.column_stack([rows.geometry, rows.gravity]) if free_gravity else rows.geometry
        linear = LinearFit.of(rows.residual, nuisance)
        reduced, columns = reduce(rows, linear, burden, differences(c))
        optimum = solve_weighed(reduced.A, reduced.b, reduced.cones)
        move = linear.inverse @ (linear.left.T @ (rows.residual - columns @ optimum.x))
        before, sag = sag, _sag(rows, reduced, burden, optimum.x)
        state = state.displaced(move[: rows.geometry.shape[1]])
        if free_gravity:
            turned = gravity + np.linalg.norm(gravity) * across(gravity) @ move[-2:]
            gravity = turned * np.linalg.norm(gravity) / np.linalg.norm(turned)
        c[reduced.seen] = reduced.unit * optimum.x[reduced.cones.first]
        moved = np.linalg.norm(nuisance @ move) + weight * np.abs(sag - before).max()
        small = _CONVERGED * np.sqrt(optimum.loss + reduced.outside) + _EXACT * np.linalg.norm(reduced.b)
        if moved <= small:
            return WeightFit(state, gravity, sag, c, rows, reduced, optimum, step)
    raise MeasurementError(
        f"geometry and own weight did not settle in {MOST_STEPS} steps",
        where="observations",
        remedy="check masses, centres of mass, gravity's direction, and the unit and sign of the angles",
    )


def reduce(rows: Rows, linear: LinearFit, burden: Burden, others: FloatArray) -> tuple[Reduced, FloatArray]:
    """Project out the geometry, and compress.

    Args:
        rows: m readings.
        linear: the columns of the geometry, factorised.
        burden: bodies and springs.
        others: (k, n + 1) rows in which no geometry shows: of the compliances, and their readings.

    Returns:
        The convex problem, and the columns (m, p) of its x in `rows`, geometry still in them.

    Raises:
        NotObservableError: no joint's torque varies.
    """
    torque = rows.torques.known
    varies: BoolArray = np.greater(np.ptp(torque, axis=0), _CONSTANT * rows.across)
    seen = np.flatnonzero(varies | others[:, :-1].any(axis=0))
    if not len(seen):
        raise NotObservableError(
            "no joint's weight torque varies over the postures",
            where="observations",
            remedy="read postures in which the arm is stretched out and folded, wrist up and down",
        )
    columns, below, blocks, units = [], [], [], []
    for j in seen.tolist():
        own = rows.joints[:, j] if varies[j] else np.zeros(len(rows.joints))
        left = own - linear.left @ (linear.left.T @ own)
        units.append(1.0 / float(np.hypot(np.linalg.norm(left), np.linalg.norm(others[:, j]))))
        block, scaled = Block(0), np.zeros((len(own), 0))
        if varies[j]:
            block, scaled = joint_unknowns(rows, j, burden, rows.products[:, j])
        columns.append(units[-1] * np.column_stack([own, scaled]))
        below.append(np.pad(units[-1] * others[:, j, None], ((0, 0), (0, block.size - 1))))
        blocks.append(block)
    all_columns = np.concatenate(columns, axis=1)
    both = np.column_stack([all_columns, rows.residual])
    both = both - linear.left @ (linear.left.T @ both)
    stacked = np.vstack([both, np.column_stack([*below, others[:, -1:]])])
    R = np.asarray(np.linalg.qr(stacked, mode="r"), dtype=np.float64)
    p, unit = all_columns.shape[1], np.array(units)
    scale = np.where(varies, np.abs(torque).max(axis=0), rows.across)[seen]
    reduced = Reduced(
        A=R[:p, :p],
        b=R[:p, p],
        outside=float(R[p, p] ** 2) if len(R) > p else 0.0,
        cones=Cones(tuple(blocks), LARGEST_SAG / scale / unit),
        unit=unit,
        seen=seen,
        freedom=int(rows.geometry.any(axis=1).sum()) - linear.rank,
    )
    return reduced, all_columns


def joint_unknowns(rows: Rows, j: int, burden: Burden, products: FloatArray) -> tuple[Block, FloatArray]:
    """Return the unknowns that twist joint j, and their columns of (m, K)."""
    acts: BoolArray = np.asarray(rows.torques.unit[:, j].any(axis=0))
    balls = [(first, own, ratio) for first, own, ratio in burden.unknown[1] if acts[first : first + 3].any()]
    moments = [first + i for first, _, _ in burden.unknown[1] for i in range(3)]
    boxes = [k for k in np.flatnonzero(acts).tolist() if k not in moments]
    columns = boxes + [first + i for first, _, _ in balls for i in range(3)]
    places = tuple((boxes.index(own), ratio) if own in boxes else (-1, 0.0) for _, own, ratio in balls)
    return Block(len(boxes), places), products[:, columns]


def _sag(rows: Rows, reduced: Reduced, burden: Burden, x: FloatArray) -> FloatArray:
    """(N, n) sag [rad] by the torques of the last posture and the new products."""
    sag = np.zeros(rows.torques.known.shape)
    for j, unit, start, block in zip(
        reduced.seen.tolist(),
        reduced.unit.tolist(),
        reduced.cones.first.tolist(),
        reduced.cones.blocks,
        strict=True,
    ):
        part = x[start + 1 : start + block.size]
        own = joint_unknowns(rows, j, burden, rows.torques.unit[:, j])[1] @ part if len(part) else 0.0
        sag[:, j] = unit * (rows.torques.known[:, j] * x[start] + own)
    return sag
