"""The robot as it was measured: a kinematic chain, its targets, and its links beside the nominal ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import MeasurementError, RobotError
from jointstiff.solver.geometry.frames.base_frame import (
    BaseFrame,
    chain_axes,
    perpendicular_frame,
    refuse_single_axis,
)
from jointstiff.solver.geometry.frames.rigid_transform import RigidTransform
from jointstiff.solver.geometry.model.link_parameters import link_geometry, near_parallel, perpendicular_signs
from jointstiff.solver.geometry.sweeps.axis import Axis
from jointstiff.solver.geometry.sweeps.identified_axes import IdentifiedAxes
from jointstiff.solver.robot.chain import ChainJoint, KinematicChain

LinkQuantity = Literal["a", "alpha", "beta", "d", "theta"]

_NAME = "identified"

_VAGUE = {"m": 10e-3, "rad": 10e-3}
"""Standard uncertainty [m, rad] beyond which a data sheet knows a parameter better."""


@dataclass(frozen=True, eq=False)
class FlangeConvention:
    """Convention that places the flange frame on the last link, which no axis determines."""

    #: `axes`: it stands in the perpendicular frame of the last axis and the one before (`base_frame`), at
    #: model angle zero; `targets`: in the frame of three targets, origin at the first, x towards the
    #: second, y towards the third
    by: Literal["axes", "targets"]
    frame_from_flange: RigidTransform  #: how it stands there
    targets: tuple[int, int, int] = (0, 1, 2)  #: indices of the three targets

    @classmethod
    def of_chain(cls, chain: KinematicChain) -> FlangeConvention:
        """Return the convention of a nominal model, from its last two axes.

        Raises:
            MeasurementError: there are fewer than two axes, or they are nearly parallel.
        """
        axes, flange = chain_axes(chain)
        refuse_single_axis(axes, "flange")
        return cls("axes", perpendicular_frame(axes[-1], axes[-2]).inverse().after(flange))

    @classmethod
    def of_axes(cls) -> FlangeConvention:
        """The perpendicular frame itself: of a spherical wrist, z is the last axis, the origin its centre."""
        return cls("axes", RigidTransform.identity())

    @classmethod
    def of_targets(cls, targets: tuple[int, int, int] = (0, 1, 2)) -> FlangeConvention:
        """The frame of three targets."""
        return cls("targets", RigidTransform.identity(), targets)

    def place(self, axes: Sequence[Axis], targets: FloatArray) -> RigidTransform:
        """Return the transform from the flange frame at angle zero to the frame of axes and targets.

        Raises:
            MeasurementError: the axes are nearly parallel, or the targets lie on a line.
        """
        if self.by == "axes":
            refuse_single_axis(axes, "flange")
            return perpendicular_frame(axes[-1], axes[-2]).after(self.frame_from_flange)
        points = targets[list(self.targets)]
        x, side = points[1] - points[0], points[2] - points[0]
        normal = np.cross(x, side)
        if np.linalg.norm(normal) <= 1e-3 * float(x @ x):
            raise MeasurementError(
                "the three targets lie on a line and do not define a flange frame",
                where="targets",
                remedy="choose three targets that form a triangle",
            )
        x, z = x / np.linalg.norm(x), normal / np.linalg.norm(normal)
        frame = RigidTransform(np.column_stack([x, np.cross(z, x), z]), points[0])
        return frame.after(self.frame_from_flange)


@dataclass(frozen=True)
class LinkParameter:
    """A length or an angle of the robot, nominal and identified."""

    quantity: LinkQuantity  #: see `link_parameters`
    joint: int  #: index of the axis, or of the first of the two neighbours
    nominal: float  #: [m] or [rad]
    identified: float  #: the same
    standard_uncertainty: float  #: of the identified one; infinite if the readings do not determine it
    unit: Literal["m", "rad"]  #: unit of all three

    @property
    def difference(self) -> float:
        """Identified less nominal; angles within ±π."""
        gap = self.identified - self.nominal
        return gap if self.unit == "m" else float(np.arctan2(np.sin(gap), np.cos(gap)))

    @property
    def is_vague(self) -> bool:
        """Return whether the readings say less than any data sheet; False where they say nothing."""
        return _VAGUE[self.unit] < self.standard_uncertainty < float("inf")

    @property
    def text(self) -> str:
        """The parameter with its uncertainty, such as "a of joint 5 (± 67 mm)"."""
        spread = self.standard_uncertainty
        shown = f"{1e3 * spread:.2g} mm" if self.unit == "m" else f"{np.degrees(spread):.2g}°"
        return f"{self.quantity} of joint {self.joint + 1} (± {shown})"


def link_findings(links: Sequence[LinkParameter]) -> tuple[Finding, ...]:
    """Report parameters that the readings leave vague."""
    vague = [link for link in links if link.is_vague]
    if not vague:
        return ()
    return (
        Finding(
            code="parameters_not_identified",
            weight="use_with_care",
            where="links",
            message="the readings hardly determine " + ", ".join(link.text for link in vague),
            remedy=(
                "read targets farther from the last axes, or turn these joints over more of their range; "
                "results at the same targets, over the same range, are not affected"
            ),
        ),
    )


@dataclass(frozen=True, eq=False)
class IdentifiedModel:
    """An identified robot."""

    #: its kinematics in R0, for `Robot` with the joint map of the sweeps; at angle zero all link frames are
    #: parallel to R0, with their origins on the axes
    chain: KinematicChain
    base: BaseFrame  #: placement of R0
    targets_in_flange: FloatArray  #: (T, 3) [m]
    targets_covariance: FloatArray  #: (3 T, 3 T) [m²]
    targets_determined: BoolArray  #: (T,) whether the readings determine the place of each target
    target_names: tuple[str, ...]  #: names of these targets


def identify_model(
    identified: IdentifiedAxes,
    base: BaseFrame,
    flange: FlangeConvention,
    *,
    nominal: KinematicChain | None = None,
    name: str = _NAME,
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
    T = base.transform_tracker_to_base
    axes = _slid(tuple(axis.moved(T.rotation, T.translation) for axis in identified.axes), nominal)
    placed = RigidTransform(T.rotation, T.translation).after(
        flange.place(identified.axes, identified.targets)
    )

    def in_flange(moved: Sequence[Axis], points: FloatArray) -> FloatArray:
        return flange.place(moved, points).inverse().apply(points).ravel()

    J = identified.jacobian_of(in_flange)
    known = np.isfinite(identified.standard_uncertainties(J)).reshape(-1, 3).all(axis=1)
    return IdentifiedModel(
        chain=_chain(axes, placed, nominal, name),
        base=base,
        targets_in_flange=in_flange(identified.axes, identified.targets).reshape(-1, 3),
        targets_covariance=J @ identified.covariance @ J.T,
        targets_determined=np.asarray(known),
        target_names=identified.names,
    )


def link_table(
    identified: IdentifiedAxes, base: BaseFrame, flange: FlangeConvention, nominal: KinematicChain
) -> tuple[LinkParameter, ...]:
    """Links of the nominal model beside the identified ones.

    Numbers that are conventions (where R0 is along and about axis 1, and the flange along and about the
    last axis) are left out: a nominal model gives them, no measurement.

    Raises:
        RobotError: the nominal model has another number of joints.
    """
    axes, nominal_flange = chain_axes(nominal)
    _refuse_other_count(axes, identified.n)
    parallel = near_parallel(axes)
    signs = perpendicular_signs(axes, parallel)

    def measured(moved: Sequence[Axis], points: FloatArray) -> FloatArray:
        T = base.place(moved)
        in_base = [axis.moved(T.rotation, T.translation) for axis in moved]
        placed = RigidTransform(T.rotation, T.translation).after(flange.place(moved, points))
        return _numbers(in_base, placed, parallel, signs)

    values = measured(identified.axes, identified.targets)
    J = identified.jacobian_of(lambda moved, points: _wrapped(measured(moved, points) - values))
    spread = identified.standard_uncertainties(J)
    expected = _numbers(axes, nominal_flange, parallel, signs)
    rows = []
    for (quantity, joint), value, other, uncertainty in zip(
        _labels(len(axes)), values, expected, spread, strict=True
    ):
        if _is_convention(quantity, joint, parallel):
            continue
        unit: Literal["m", "rad"] = "m" if quantity in ("a", "d") else "rad"
        rows.append(LinkParameter(quantity, joint, float(other), float(value), float(uncertainty), unit))
    return tuple(rows)


def _numbers(
    axes: Sequence[Axis], flange: RigidTransform, parallel: Sequence[bool], signs: Sequence[float]
) -> FloatArray:
    g = link_geometry(axes, flange, parallel, signs)
    return np.concatenate([g.a, g.alpha, g.beta, g.d, g.theta])


def _labels(n: int) -> list[tuple[LinkQuantity, int]]:
    between: list[tuple[LinkQuantity, int]] = [
        (quantity, i) for quantity in ("a", "alpha", "beta") for i in range(n - 1)
    ]
    return [*between, *(("d", i) for i in range(n)), *(("theta", i) for i in range(n))]


def _is_convention(quantity: LinkQuantity, joint: int, parallel: Sequence[bool]) -> bool:
    n = len(parallel) + 1
    if quantity == "beta":
        return not parallel[joint]
    if quantity == "d" and joint < n - 1 and parallel[joint]:
        return True  # zero by definition
    return quantity in ("d", "theta") and joint in (0, n - 1)


def _wrapped(gap: FloatArray) -> FloatArray:
    """Differences over ±π are angles at the seam; lengths never differ by that much between two steps."""
    return np.asarray(np.where(np.abs(gap) > np.pi, gap - 2.0 * np.pi * np.sign(gap), gap))


def _chain(
    axes: Sequence[Axis], flange: RigidTransform, nominal: KinematicChain | None, name: str
) -> KinematicChain:
    names = [f"joint_{i + 1}" for i in range(len(axes))]
    links = [f"link_{i + 1}" for i in range(len(axes))]
    limits: list[tuple[float, float] | None] = [None] * len(axes)
    base, end = "base", "flange"
    if nominal is not None:
        names, links = list(nominal.joint_names), [joint.child for joint in nominal.revolute]
        limits, base, end = [joint.limits for joint in nominal.revolute], nominal.base, nominal.flange
        links[-1] = f"{end}_mount" if links[-1] == end else links[-1]
    joints, origin = [], np.zeros(3)
    for joint, link, limit, axis in zip(names, links, limits, axes, strict=True):
        step = axis.point - origin
        joints.append(ChainJoint(joint, "revolute", np.eye(3), step, axis.direction, limit, link))
        origin = axis.point
    z = np.array([0.0, 0.0, 1.0])
    step = flange.translation - origin
    joints.append(ChainJoint(f"{names[-1]}_flange", "fixed", flange.rotation, step, z, None, end))
    return KinematicChain(name, base, end, tuple(joints))


def _slid(axes: tuple[Axis, ...], nominal: KinematicChain | None) -> tuple[Axis, ...]:
    """The same lines, stated where the nominal model has its joints."""
    if nominal is None:
        return axes
    expected, _ = chain_axes(nominal)
    _refuse_other_count(expected, len(axes))
    return tuple(axis.slid_to(other.point) for axis, other in zip(axes, expected, strict=True))


def _refuse_other_count(axes: Sequence[Axis], n: int) -> None:
    if len(axes) != n:
        raise RobotError(
            f"the nominal model has {len(axes)} revolute joints, but the sweeps show {n} axes",
            where="nominal",
            remedy="give the nominal model of the robot that was measured",
        )
