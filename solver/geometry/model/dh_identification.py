"""Denavit-Hartenberg tables of identified axes, standard and modified, and how far they can be trusted.

A DH table has four numbers for each joint, and that is enough for any axes. But between axes that are
nearly parallel its numbers run away: two axes 1 m apart at 10 µrad to each other may have their common
perpendicular 100 m off. Such pairs are therefore made exactly parallel first if their angle is below a
tolerance, and the table says by how much its flange is then off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry.finding import GeometryFinding
from jointstiff.solver.geometry.frames.axis_frame import LEAST_SINE, chain_axes
from jointstiff.solver.geometry.frames.rigid_transform import RigidTransform
from jointstiff.solver.geometry.model.link_parameters import LinkGeometry, link_geometry, perpendicular_signs
from jointstiff.solver.geometry.sweeps.axis import Axis
from jointstiff.solver.robot.chain import KinematicChain
from jointstiff.solver.robot.dh import Convention, DhRow

PARALLEL_WITHIN = 1e-3
"""Angle of neighbouring axes [rad] below which a table takes them as parallel, if not told otherwise."""

RUNAWAY_BELOW = 1e-2
"""Angle of neighbouring axes [rad] below which their common perpendicular is beyond any robot's size."""

_POSTURES = 200


@dataclass(frozen=True)
class ParallelPair:
    """Neighbouring axes that are nearly parallel."""

    joint: int  #: index of the first
    angle: float  #: between them [rad]
    #: whether the table takes them as parallel; if not, its a, d and theta there are ill-conditioned
    made_parallel: bool


@dataclass(frozen=True, eq=False)
class DhTable:
    """A table and what it leaves over.

    flange to R0 = base · T_1(q_1) … T_n(q_n) · tool, T_i as in `jointstiff.solver.robot.dh.dh_chain`.
    """

    convention: Convention  #: of the rows
    rows: tuple[DhRow, ...]  #: n
    base: RigidTransform  #: from frame 0 to R0; the identity if z of R0 is axis 1
    tool: RigidTransform  #: from the flange frame to frame n; the identity if z of the flange is axis n
    parallel: tuple[ParallelPair, ...]  #: neighbours that are nearly parallel
    #: greatest distance of the table's flange origin from the chain's, over random postures [m]; rounding
    #: only, unless axes were made parallel
    deviation: float

    def findings(self) -> tuple[GeometryFinding, ...]:
        """Neighbours between which the numbers run away."""
        return tuple(
            GeometryFinding(
                "axes_nearly_parallel",
                f"dh.{self.convention}",
                pair.angle,
                "rad",
                f"axes {pair.joint + 1} and {pair.joint + 2} are {1e3 * pair.angle:.3g} mrad from "
                "parallel: too much to neglect, and too little to determine a, d and theta separately",
                "use the URDF, which does not need these parameters",
            )
            for pair in self.parallel
            if not pair.made_parallel and pair.angle < RUNAWAY_BELOW
        )


def dh_table(
    chain: KinematicChain, convention: Convention, *, parallel_within: float = PARALLEL_WITHIN
) -> DhTable:
    """Write a chain as a table.

    Args:
        chain: any.
        convention: standard, or modified (Craig).
        parallel_within: neighbours at a smaller angle [rad] are made parallel; 0 for an exact table.
    """
    axes, flange = chain_axes(chain)
    used, pairs = _made_parallel(axes, parallel_within)
    parallel = _exactly_parallel(pairs, len(axes))
    signs = perpendicular_signs(used, parallel)
    geometry = link_geometry(used, flange, parallel, signs)
    limits = [joint.limits or (None, None) for joint in chain.revolute]
    return DhTable(
        convention=convention,
        rows=_rows(geometry, convention, limits),
        base=geometry.base,
        tool=geometry.tool,
        parallel=pairs,
        deviation=_deviation(axes, used, flange.translation),
    )


def _made_parallel(axes: Sequence[Axis], within: float) -> tuple[tuple[Axis, ...], tuple[ParallelPair, ...]]:
    used, pairs = [axes[0]], []
    for i, axis in enumerate(axes[1:]):
        before = used[-1].direction
        sine = float(np.linalg.norm(np.cross(before, axis.direction)))
        replaced = sine < within or sine == 0.0
        if sine < LEAST_SINE:
            pairs.append(ParallelPair(i, float(np.arcsin(sine)), replaced))
        sense = np.sign(before @ axis.direction)
        used.append(Axis.through(axis.point, sense * before) if replaced else axis)
    return tuple(used), tuple(pairs)


def _exactly_parallel(pairs: Sequence[ParallelPair], n: int) -> tuple[bool, ...]:
    made = {pair.joint for pair in pairs if pair.made_parallel}
    return tuple(i in made for i in range(n - 1))


def _rows(
    geometry: LinkGeometry,
    convention: Convention,
    limits: Sequence[tuple[float, float] | tuple[None, None]],
) -> tuple[DhRow, ...]:
    if convention == "modified":
        a, alpha = np.append(0.0, geometry.a), np.append(0.0, geometry.alpha)
    else:
        a, alpha = np.append(geometry.a, 0.0), np.append(geometry.alpha, 0.0)
    return tuple(
        DhRow(float(a[i]), float(alpha[i]), float(geometry.d[i]), float(geometry.theta[i]), *limits[i])
        for i in range(len(a))
    )


def _deviation(axes: Sequence[Axis], used: Sequence[Axis], flange: FloatArray) -> float:
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSTURES, len(axes)))
    places = [_carried(each, angles, flange) for each in (axes, used)]
    return float(np.linalg.norm(places[0] - places[1], axis=1).max())


def _carried(axes: Sequence[Axis], angles: FloatArray, point: FloatArray) -> FloatArray:
    """Places (K, 3) [m] of a point (3,) that the last axis carries, in postures (K, n) [rad]."""
    places = np.broadcast_to(point, (len(angles), 1, 3))
    for axis, angle in zip(reversed(axes), angles.T[::-1], strict=True):
        places = axis.turned(axis.turns(angle), places)
    return places[:, 0]
