"""Lengths and angles between neighbouring axes, as Denavit and Hartenberg name them.

For neighbours i and i+1: distance a_i and twist alpha_i along and about their common perpendicular x_i; for
each axis, offset d_i and angle theta_i from x_{i-1} to x_i along and about z_i (Craig, Introduction to
Robotics, ch. 3). The foot of the perpendicular runs away as axes become parallel. Between axes that are
meant to be parallel x_i therefore starts where x_{i-1} ended (d_i = 0), and their small angle has a
second component beta_i, about z_i × x_i (Hayati 1983).

Denavit-Hartenberg tables of identified axes, standard and modified, and how far they can be trusted.

A DH table has four numbers for each joint, and that is enough for any axes. But between axes that are
nearly parallel its numbers run away: two axes 1 m apart at 10 µrad to each other may have their common
perpendicular 100 m off. Such pairs are therefore made exactly parallel first if their angle is below a
tolerance, and the table says by how much its flange is then off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry.frames.base_frame import LEAST_SINE, chain_axes, common_feet
from jointstiff.solver.geometry.frames.rigid_transform import RigidTransform
from jointstiff.solver.geometry.sweeps.axis import Axis
from jointstiff.solver.robot.chain import KinematicChain
from jointstiff.solver.robot.dh import Convention, DhRow

_SHORT = 1e-3  # distance [m] below which a perpendicular's sense is not taken from it
_NO_DIRECTION = 1e-9


@dataclass(frozen=True, eq=False)
class LinkGeometry:
    """A serial chain of n axes in numbers."""

    a: FloatArray  #: (n - 1,) distances of neighbours along x [m], signed
    alpha: FloatArray  #: (n - 1,) twists about x [rad]
    beta: FloatArray  #: (n - 1,) the other angle of neighbours meant to be parallel [rad]; 0 for others
    d: FloatArray  #: (n,) offsets along the axes, the first from frame 0, the last to the flange's origin [m]
    theta: FloatArray  #: (n,) angles about the axes at model angle zero, likewise [rad]
    base: RigidTransform  #: from frame 0, whose z is axis 1, to the frame in which the axes are given
    tool: RigidTransform  #: from the flange frame to frame n, whose z is axis n


def near_parallel(axes: Sequence[Axis]) -> tuple[bool, ...]:
    """Return which neighbours (n - 1) are nominally parallel."""
    return tuple(
        bool(np.linalg.norm(np.cross(first.direction, second.direction)) < LEAST_SINE)
        for first, second in pairwise(axes)
    )


def perpendicular_signs(axes: Sequence[Axis], parallel: Sequence[bool]) -> tuple[float, ...]:
    """Senses (n - 1) of the perpendiculars: towards the next axis, or near the last one's if they meet."""
    signs: list[float] = []
    plain = [1.0] * (len(axes) - 1)
    frames = _perpendiculars(axes, plain, parallel)
    before = frames.x[0]
    for x, a in zip(frames.x[1:-1], frames.lengths, strict=True):
        sign = np.sign(a) if abs(a) > _SHORT else np.sign(x @ before)
        signs.append(float(sign) or 1.0)
        before = signs[-1] * x
    return tuple(signs)


def link_geometry(
    axes: Sequence[Axis], flange: RigidTransform, parallel: Sequence[bool], signs: Sequence[float]
) -> LinkGeometry:
    """Measure a chain of axes.

    Args:
        axes: n at model angle zero, in R0.
        flange: from flange frame to R0 there.
        parallel: which neighbours are meant to be parallel.
        signs: sense of each perpendicular beside z_i × z_{i+1}, or between parallel axes beside the
            direction from one to the other.
    """
    perpendiculars = _perpendiculars(axes, signs, parallel)
    z = [axis.direction for axis in axes]
    # x_n and the origin of frame n on the last axis: as near to the flange frame as they can be
    last_x = _across(flange.rotation[:, 0], z[-1], flange.rotation[:, 1])
    last_foot = axes[-1].at(axes[-1].foot(flange.translation))
    x, starts = [*perpendiculars.x[:-1], last_x], [*perpendiculars.starts, last_foot]
    angles = [_angle(z[i], z[i + 1], x[i + 1]) for i in range(len(axes) - 1)]
    tilts = [float(z[i + 1] @ x[i + 1]) for i in range(len(axes) - 1)]
    frame_n = RigidTransform(np.column_stack([last_x, np.cross(z[-1], last_x), z[-1]]), last_foot)
    frame_0 = RigidTransform(np.column_stack([x[0], np.cross(z[0], x[0]), z[0]]), perpendiculars.ends[0])
    return LinkGeometry(
        a=np.array(perpendiculars.lengths),
        alpha=np.array(angles),
        beta=np.arcsin(np.clip(tilts, -1.0, 1.0)),
        d=np.array([(starts[i] - perpendiculars.ends[i]) @ z[i] for i in range(len(axes))]),
        theta=np.array([_angle(x[i], x[i + 1], z[i]) for i in range(len(axes))]),
        base=frame_0,
        tool=frame_n.inverse().after(RigidTransform(flange.rotation, flange.translation)),
    )


@dataclass(frozen=True, eq=False)
class _Perpendiculars:
    x: list[FloatArray]  # x_0 … x_n-1, then a place for x_n
    starts: list[FloatArray]  # foot of perpendicular i on axis i, i = 1 … n-1
    ends: list[FloatArray]  # origin of frame 0, then foot of perpendicular i on axis i+1
    lengths: list[float]


def _perpendiculars(
    axes: Sequence[Axis], signs: Sequence[float], parallel: Sequence[bool]
) -> _Perpendiculars:
    x = [_across(np.eye(3)[0], axes[0].direction, np.eye(3)[1])]
    ends, starts, lengths = [axes[0].at(axes[0].foot(np.zeros(3)))], [], []
    for i, (first, second) in enumerate(pairwise(axes)):
        if parallel[i]:
            start = ends[-1]
            end = second.at(second.foot(start))
            gap = (end - start) - first.direction * float((end - start) @ first.direction)
            along = gap / np.linalg.norm(gap) if np.linalg.norm(gap) > _NO_DIRECTION else x[-1]
        else:
            here, there = common_feet(first, second)
            start, end = first.at(here), second.at(there)
            along = np.cross(first.direction, second.direction)
            along = along / np.linalg.norm(along)
        x.append(signs[i] * along)
        starts.append(start)
        ends.append(end)
        lengths.append(float((end - start) @ x[-1]))
    return _Perpendiculars([*x, x[-1]], starts, ends, lengths)


def _across(vector: FloatArray, normal: FloatArray, instead: FloatArray) -> FloatArray:
    """Unit vector of the part normal to another; of a second vector where the first is nearly along it."""
    part = vector - normal * float(vector @ normal)
    if np.linalg.norm(part) < 0.5:
        part = instead - normal * float(instead @ normal)
    return np.asarray(part / np.linalg.norm(part))


def _angle(first: FloatArray, second: FloatArray, about: FloatArray) -> float:
    """Angle [rad] from one vector to another about a unit vector."""
    return float(
        np.arctan2(np.cross(first, second) @ about, first @ second - (first @ about) * (second @ about))
    )


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

    convention: Convention  #: convention of the rows
    rows: tuple[DhRow, ...]  #: n
    base: RigidTransform  #: from frame 0 to R0; the identity if z of R0 is axis 1
    tool: RigidTransform  #: from the flange frame to frame n; the identity if z of the flange is axis n
    parallel: tuple[ParallelPair, ...]  #: neighbours that are nearly parallel
    #: greatest distance of the table's flange origin from the chain's, over random postures [m]; rounding
    #: only, unless axes were made parallel
    deviation: float

    def findings(self) -> tuple[Finding, ...]:
        """Neighbours between which the numbers run away."""
        return tuple(
            Finding(
                code="axes_nearly_parallel",
                weight="use",
                where=f"dh.{self.convention}",
                message=(
                    f"axes {pair.joint + 1} and {pair.joint + 2} are {1e3 * pair.angle:.3g} mrad from "
                    "parallel: too much to neglect, and too little to determine a, d and theta separately"
                ),
                remedy="use the URDF, which does not need these parameters",
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
    made = {pair.joint for pair in pairs if pair.made_parallel}
    parallel = tuple(i in made for i in range(len(axes) - 1))
    signs = perpendicular_signs(used, parallel)
    geometry = link_geometry(used, flange, parallel, signs)
    limits = [joint.limits or (None, None) for joint in chain.revolute]
    if convention == "modified":
        a, alpha = np.append(0.0, geometry.a), np.append(0.0, geometry.alpha)
    else:
        a, alpha = np.append(geometry.a, 0.0), np.append(geometry.alpha, 0.0)
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSTURES, len(axes)))
    places = [_carried(each, angles, flange.translation) for each in (axes, used)]
    return DhTable(
        convention=convention,
        rows=tuple(
            DhRow(float(a[i]), float(alpha[i]), float(geometry.d[i]), float(geometry.theta[i]), *limits[i])
            for i in range(len(a))
        ),
        base=geometry.base,
        tool=geometry.tool,
        parallel=pairs,
        deviation=float(np.linalg.norm(places[0] - places[1], axis=1).max()),
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


def _carried(axes: Sequence[Axis], angles: FloatArray, point: FloatArray) -> FloatArray:
    """Places (K, 3) [m] of a point (3,) that the last axis carries, in postures (K, n) [rad]."""
    places = np.broadcast_to(point, (len(angles), 1, 3))
    for axis, angle in zip(reversed(axes), angles.T[::-1], strict=True):
        places = axis.turned(axis.turns(angle), places)
    return places[:, 0]
