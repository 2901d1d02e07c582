"""The robot as it was measured: a kinematic chain, its links beside the nominal ones, and tables of it.

Lengths and angles between neighbouring axes are as Denavit and Hartenberg name them. For neighbours i and
i+1: distance a_i and twist alpha_i along and about their common perpendicular x_i; for each axis, offset d_i
and angle theta_i from x_{i-1} to x_i along and about z_i (Craig, Introduction to Robotics, ch. 3). The foot
of the perpendicular runs away as axes become parallel. Between axes that are meant to be parallel x_i
therefore starts where x_{i-1} ended (d_i = 0), and their small angle has a second component beta_i, about
z_i × x_i (Hayati 1983).

A DH table has four numbers for each joint, and that is enough for any axes. But between axes that are
nearly parallel its numbers run away: two axes 1 m apart at 10 µrad to each other may have their common
perpendicular 100 m off. Such pairs are therefore made exactly parallel first if their angle is below a
tolerance, and the table says by how much its flange is then off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pinocchio as pin

from jointstiff.schemas.geometry import IdentifiedDh, LinkComparison, NearlyParallel, Rigid
from jointstiff.schemas.robot import DhRow
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError, RobotError
from jointstiff.solver.geometry.frames import LEAST_SINE, BaseFrame, common_feet, perpendicular_frame
from jointstiff.solver.geometry.poses import (
    Axis,
    IdentifiedAxes,
    Motion,
    chain_axes,
    right_handed,
    transformed,
)
from jointstiff.solver.messages import message, rows
from jointstiff.solver.robot.model import ChainJoint, Convention, KinematicChain

PARALLEL_WITHIN = 1e-3
"""Angle of neighbouring axes [rad] below which a table takes them as parallel, if not told otherwise."""

_SHORT = 1e-3  # distance [m] below which a perpendicular's sense is not taken from it
_NO_DIRECTION = 1e-9
_POSTURES = 200


@dataclass(frozen=True, eq=False)
class FlangeConvention:
    """Convention that places the flange frame on the last link, which no axis determines.

    By the axes it stands in the perpendicular frame of the last axis and the one before, at model angle zero:
    with the default, of a spherical wrist, z is the last axis and the origin its centre.
    """

    #: indices of three targets that define it instead: origin at the first, x towards the second, y towards
    #: the third
    targets: tuple[int, int, int] | None = None
    #: how it stands in the perpendicular frame
    frame_from_flange: pin.SE3 = field(default_factory=pin.SE3.Identity)

    @classmethod
    def of_chain(cls, chain: KinematicChain) -> FlangeConvention:
        """Return the convention of a nominal model, from its last two axes.

        Raises:
            MeasurementError: there are fewer than two axes, or they are nearly parallel.
        """
        axes, flange = chain_axes(chain)
        return cls(None, perpendicular_frame(axes, "flange").inverse() * flange)

    def place(self, axes: Sequence[Axis], targets: FloatArray) -> pin.SE3:
        """Return the transform from the flange frame at angle zero to the frame of axes and targets.

        Raises:
            MeasurementError: the axes are nearly parallel, or the targets lie on a line.
        """
        if self.targets is None:
            return perpendicular_frame(axes, "flange") * self.frame_from_flange
        points = targets[list(self.targets)]
        x, side = points[1] - points[0], points[2] - points[0]
        normal = np.cross(x, side)
        if np.linalg.norm(normal) <= 1e-3 * float(x @ x):
            raise MeasurementError(
                "the three targets lie on a line and do not define a flange frame",
                where="targets",
                remedy="choose three targets that form a triangle",
            )
        return right_handed(x / np.linalg.norm(x), normal / np.linalg.norm(normal), points[0])


@dataclass(frozen=True, eq=False)
class IdentifiedModel:
    """An identified robot."""

    #: its kinematics in R0, for `Robot` with the joint map of the sweeps; at angle zero all link frames are
    #: parallel to R0, with their origins on the axes
    chain: KinematicChain
    targets_in_flange: FloatArray  #: (T, 3) [m]
    targets_covariance: FloatArray  #: (T, 3, 3) [m²]; NaN for targets that the readings do not determine


def identify_model(
    identified: IdentifiedAxes,
    base: BaseFrame,
    flange: FlangeConvention,
    *,
    nominal: KinematicChain | None = None,
    name: str = "identified",
) -> IdentifiedModel:
    """Turn axes into a kinematic chain.

    Args:
        identified: the axes at model angle zero.
        base: where R0 is.
        flange: where the flange frame is.
        nominal: gives names, limits, and where on the axes the link frames lie; not needed.
        name: of the robot.

    Raises:
        RobotError: the nominal model has another number of joints, or a name is unfit.
        MeasurementError: the flange cannot be placed.
    """

    def in_flange(moved: Sequence[Axis], points: FloatArray) -> FloatArray:
        return transformed(flange.place(moved, points).inverse(), points).ravel()

    T = base.transform_tracker_to_base
    axes = [axis.moved(T) for axis in identified.axes]
    if nominal is not None:  # the same lines, stated where the nominal model has its joints
        expected, _ = _nominal_axes(nominal, len(axes))
        pairs = zip(axes, expected, strict=True)
        axes = [axis.placed_near(other.point) for axis, other in pairs]
    placed = T * flange.place(identified.axes, identified.targets)
    # The chain of these axes, with the names and limits of the nominal model if there is one
    names = joint_names(nominal, len(axes))
    links = [f"link_{i + 1}" for i in range(len(axes))]
    limits: list[tuple[float, float] | None] = [None] * len(axes)
    base_link, end = "base", "flange"
    if nominal is not None:
        links = [joint.child for joint in nominal.moving]
        limits, base_link, end = [joint.limits for joint in nominal.moving], nominal.base, nominal.flange
        links[-1] = f"{end}_mount" if links[-1] == end else links[-1]
    joints, origin = [], np.zeros(3)
    for joint, link, limit, axis in zip(names, links, limits, axes, strict=True):
        step = axis.point - origin
        joints.append(ChainJoint(joint, "revolute", np.eye(3), step, axis.direction, limit, link))
        origin = axis.point
    z = np.array([0.0, 0.0, 1.0])
    step = placed.translation - origin
    joints.append(ChainJoint(f"{names[-1]}_flange", "fixed", placed.rotation, step, z, None, end))
    return IdentifiedModel(
        chain=KinematicChain(name, base_link, end, tuple(joints)),
        targets_in_flange=in_flange(identified.axes, identified.targets).reshape(-1, 3),
        targets_covariance=identified.covariances(identified.jacobian_of(in_flange)),
    )


def joint_names(nominal: KinematicChain | None, n: int) -> tuple[str, ...]:
    """Return the names of n joints, by their numbers where no nominal model names them."""
    return tuple(f"joint_{i + 1}" for i in range(n)) if nominal is None else nominal.joint_names


def _nominal_axes(nominal: KinematicChain, n: int) -> tuple[tuple[Axis, ...], pin.SE3]:
    """Return `chain_axes` of a nominal model of n joints; refuse another one."""
    axes, flange = chain_axes(nominal)
    if len(axes) != n:
        raise RobotError(
            f"the nominal model has {len(axes)} revolute joints, but the sweeps show {n} axes",
            where="nominal",
            remedy="give the nominal model of the robot that was measured",
        )
    return axes, flange


@dataclass(frozen=True, eq=False)
class LinkGeometry:
    """A serial chain of n axes in numbers."""

    a: FloatArray  #: (n - 1,) distances of neighbours along x [m], signed
    alpha: FloatArray  #: (n - 1,) twists about x [rad]
    beta: FloatArray  #: (n - 1,) the other angle of neighbours meant to be parallel [rad]; 0 for others
    d: FloatArray  #: (n,) offsets along the axes, the first from frame 0, the last to the flange's origin [m]
    theta: FloatArray  #: (n,) angles about the axes at model angle zero, likewise [rad]
    base: pin.SE3  #: from frame 0, whose z is axis 1, to the frame in which the axes are given
    tool: pin.SE3  #: from the flange frame to frame n, whose z is axis n
    #: (n - 1,) senses of the perpendiculars x beside z_i × z_{i+1}, or between parallel axes beside the
    #: direction from one to the other
    signs: tuple[float, ...]

    @property
    def numbers(self) -> FloatArray:
        """All of a, alpha, beta, d and theta (5 n - 3,)."""
        return np.concatenate([self.a, self.alpha, self.beta, self.d, self.theta])


def link_geometry(
    axes: Sequence[Axis],
    flange: pin.SE3,
    parallel: Sequence[bool],
    signs: Sequence[float] | None = None,
) -> LinkGeometry:
    """Measure a chain of axes.

    Args:
        axes: n at model angle zero, in R0.
        flange: from flange frame to R0 there.
        parallel: (n - 1,) which neighbours are meant to be parallel.
        signs: (n - 1,) as in the result; if None, perpendiculars point towards the next axis, or near the
            last perpendicular where the axes meet.
    """
    z = [axis.direction for axis in axes]
    x = [_across(np.eye(3)[0], z[0], np.eye(3)[1])]
    starts, ends, used = [], [axes[0].nearest(np.zeros(3))], []
    for i, (first, second) in enumerate(pairwise(axes)):
        if parallel[i]:
            start, end = ends[-1], second.nearest(ends[-1])
            along = (end - start) - z[i] * float((end - start) @ z[i])
        else:
            start, end = common_feet(first, second)
            along = np.cross(z[i], z[i + 1])
        length = float(np.linalg.norm(along))
        along = along / length if length > _NO_DIRECTION else x[-1]
        distance = float((end - start) @ along)
        sense = distance if abs(distance) > _SHORT else float(along @ x[-1])
        used.append((1.0 if sense >= 0.0 else -1.0) if signs is None else signs[i])
        x.append(used[-1] * along)
        starts.append(start)
        ends.append(end)
    # x_n and the origin of frame n on the last axis: as near to the flange frame as they can be
    x.append(_across(flange.rotation[:, 0], z[-1], flange.rotation[:, 1]))
    starts.append(axes[-1].nearest(flange.translation))
    frame_n = right_handed(x[-1], z[-1], starts[-1])
    tilts = [float(z[i + 1] @ x[i + 1]) for i in range(len(axes) - 1)]
    return LinkGeometry(
        a=np.array([(ends[i + 1] - starts[i]) @ x[i + 1] for i in range(len(axes) - 1)]),
        alpha=np.array([_angle(z[i], z[i + 1], x[i + 1]) for i in range(len(axes) - 1)]),
        beta=np.arcsin(np.clip(tilts, -1.0, 1.0)),
        d=np.array([(starts[i] - ends[i]) @ z[i] for i in range(len(axes))]),
        theta=np.array([_angle(x[i], x[i + 1], z[i]) for i in range(len(axes))]),
        base=right_handed(x[0], z[0], ends[0]),
        tool=frame_n.inverse() * flange,
        signs=tuple(used),
    )


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


def link_table(
    identified: IdentifiedAxes, base: BaseFrame, flange: FlangeConvention, nominal: KinematicChain
) -> list[LinkComparison]:
    """Links of the nominal model beside the identified ones; differences of angles are within ±π.

    Numbers that are conventions (where R0 is along and about axis 1, and the flange along and about the
    last axis) are left out: a nominal model gives them, no measurement.

    Raises:
        RobotError: the nominal model has another number of joints.
    """
    n = identified.n
    axes, nominal_flange = _nominal_axes(nominal, n)
    parallel = [
        bool(np.linalg.norm(np.cross(first.direction, second.direction)) < LEAST_SINE)
        for first, second in pairwise(axes)
    ]
    expected = link_geometry(axes, nominal_flange, parallel)

    def measured(moved: Sequence[Axis], points: FloatArray) -> FloatArray:
        T = base.place(moved)
        placed = T * flange.place(moved, points)
        return link_geometry([axis.moved(T) for axis in moved], placed, parallel, expected.signs).numbers

    def change(moved: Sequence[Axis], points: FloatArray) -> FloatArray:
        """Differences over ±π are angles at the seam: lengths never differ by that much between two steps."""
        gap = measured(moved, points) - values
        return np.where(np.abs(gap) > np.pi, gap - 2.0 * np.pi * np.sign(gap), gap)

    values = measured(identified.axes, identified.targets)
    spread = identified.standard_uncertainties(identified.jacobian_of(change))
    labels = [(q, i) for q in ("a", "alpha", "beta") for i in range(n - 1)]
    labels += [(q, i) for q in ("d", "theta") for i in range(n)]
    conventions = {(q, i) for q in ("d", "theta") for i in (0, n - 1)}
    conventions |= {("d" if pair else "beta", i) for i, pair in enumerate(parallel)}  # zero by definition
    gaps = values - expected.numbers
    return [
        LinkComparison(
            quantity=q,
            joint=nominal.joint_names[joint],
            unit="m" if q in {"a", "d"} else "rad",
            nominal=other,
            identified=value,
            difference=gap if q in {"a", "d"} else np.arctan2(np.sin(gap), np.cos(gap)),
            standard_uncertainty=u if np.isfinite(u) else None,
        )
        for (q, joint), value, other, gap, u in zip(
            labels, values, expected.numbers, gaps, spread, strict=True
        )
        if (q, joint) not in conventions
    ]


def dh_table(
    chain: KinematicChain, convention: Convention, *, parallel_within: float = PARALLEL_WITHIN
) -> IdentifiedDh:
    """Write a chain as a table: flange to R0 = base · T_1(q_1) … T_n(q_n) · tool.

    T_i are as in `jointstiff.solver.robot.model.dh_chain`; base is the identity if z of R0 is axis 1, tool if
    z of the flange is the last axis.

    Args:
        chain: any.
        convention: standard, or modified (Craig).
        parallel_within: neighbours at a smaller angle [rad] are made parallel; 0 for an exact table.
    """
    axes, flange = chain_axes(chain)
    used, pairs, made = [axes[0]], [], []
    for i, axis in enumerate(axes[1:]):
        before = used[-1].direction
        sine = float(np.linalg.norm(np.cross(before, axis.direction)))
        replaced = sine < parallel_within or sine == 0.0
        if sine < LEAST_SINE:
            angle = np.arcsin(sine)
            pairs.append(NearlyParallel(joint=chain.joint_names[i], angle=angle, made_parallel=replaced))
        made.append(replaced)
        sense = np.sign(before @ axis.direction)
        used.append(Axis.through(axis.point, sense * before) if replaced else axis)
    geometry = link_geometry(used, flange, made)
    # Modified tables have a and alpha of the perpendicular before an axis, standard ones of that behind it
    padding = (1, 0) if convention == "modified" else (0, 1)
    a, alpha = np.pad(geometry.a, padding), np.pad(geometry.alpha, padding)
    lower, upper = zip(*(joint.limits or (None, None) for joint in chain.moving), strict=True)
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSTURES, len(axes)))
    places = [Motion(each, flange.translation[None], angles).points for each in (axes, used)]
    return IdentifiedDh(
        convention=convention,
        rows=rows(DhRow, a=a, alpha=alpha, d=geometry.d, theta=geometry.theta, lower=lower, upper=upper),
        base=message(Rigid, geometry.base),
        tool=message(Rigid, geometry.tool),
        parallel=pairs,
        deviation=float(np.linalg.norm(places[0] - places[1], axis=-1).max()),
    )
