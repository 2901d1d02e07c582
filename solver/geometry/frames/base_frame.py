"""The robot's base frame R0 in the tracker's frame, from axes 1 and 2.

Two axes fix R0 but for a convention, because neither shows how high the floor is nor which way the
maker's x points:

* *By a nominal model* (preferred): R0 stands to the perpendicular frame of the identified axes 1 and 2
  (below) as the model's R0 stands to that of its own axes, all at model angle zero. The nominal height
  of axis 2 above R0 is kept, for instance, and all else is measured.
* *By the axes alone*: z along axis 1, in the sense of its positive rotation; the origin on axis 1 at the foot
  of its common perpendicular with axis 2, less a height that is given; x along that perpendicular at
  model angle zero of joint 1, from axis 1 towards axis 2. If the two axes meet within their uncertainty, x
  is the product of the directions of axes 2 and 1 instead.

The *perpendicular frame* of a main axis and another one, both with a sense: z along the main axis; x along
the product of the other's direction with it, which is the direction of their common perpendicular; the
origin at the foot of that perpendicular on the main axis. It depends on the axes alone, also where they
meet (there x still is well defined, a vector from foot to foot is not).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.frames.rigid_transform import RigidTransform
from jointstiff.solver.geometry.sweeps.axis import Axis
from jointstiff.solver.geometry.sweeps.identified_axes import Geometry, IdentifiedAxes
from jointstiff.solver.robot.chain import KinematicChain

LEAST_SINE = 0.1
"""Sine of the angle between two axes below which the foot of their common perpendicular is unreliable."""


def common_feet(first: Axis, second: Axis) -> tuple[float, float]:
    """Return the feet of the common perpendicular of two axes: distances [m] from their points."""
    a, b = first.direction, second.direction
    between = second.point - first.point
    cosine = float(a @ b)
    sine2 = float(np.sum(np.cross(a, b) ** 2))
    along, back = float(between @ a), float(between @ b)
    return (along - back * cosine) / sine2, (along * cosine - back) / sine2


def perpendicular_frame(main: Axis, other: Axis) -> RigidTransform:
    """Return the transform from the perpendicular frame of two axes to the frame of the axes.

    Raises:
        MeasurementError: the axes are nearly parallel.
    """
    x = np.cross(other.direction, main.direction)
    sine = float(np.linalg.norm(x))
    if sine < LEAST_SINE:
        raise MeasurementError(
            "the two axes that should define the frame are nearly parallel "
            f"({np.degrees(np.arcsin(sine)):.2g}°)",
            where="sweeps",
            remedy="give the transform explicitly; parallel axes do not define a frame",
        )
    x = x / sine
    z = main.direction
    foot, _ = common_feet(main, other)
    return RigidTransform(np.column_stack([x, np.cross(z, x), z]), main.at(foot))


def chain_axes(chain: KinematicChain) -> tuple[tuple[Axis, ...], RigidTransform]:
    """Axes of a chain in R0 at angle zero, their points at the joints' origins, and flange to R0 there."""
    R, t = np.eye(3), np.zeros(3)
    axes = []
    for joint in chain.joints:
        t = t + R @ joint.translation
        R = R @ joint.rotation
        if joint.is_moving:
            axes.append(Axis.through(t, R @ joint.axis))
    return tuple(axes), RigidTransform(R, t)


_MEETING = 5.0  # standard uncertainties of the distance of axes 1 and 2 below which they meet


@dataclass(frozen=True, eq=False)
class BaseConvention:
    """Convention that places R0 relative to axes 1 and 2."""

    #: from the perpendicular frame of axes 1 and 2, at model angle zero, to R0
    base_from_perpendicular: RigidTransform

    @classmethod
    def of_chain(cls, chain: KinematicChain) -> BaseConvention:
        """The convention of a nominal model.

        Raises:
            MeasurementError: it has fewer than two axes, or its first two are nearly parallel.
        """
        axes, _ = chain_axes(chain)
        refuse_single_axis(axes, "base")
        return cls(perpendicular_frame(axes[0], axes[1]))

    @classmethod
    def of_axes(cls, identified: IdentifiedAxes, height: float = 0.0) -> BaseConvention:
        """The convention without a model.

        Args:
            identified: the axes; whether x must be reversed to point towards axis 2 depends on them.
            height: of the foot of the common perpendicular above R0 [m].

        Raises:
            MeasurementError: fewer than two axes.
        """
        refuse_single_axis(identified.axes, "base")
        offset = _offset(identified.axes, identified.targets)
        uncertainty = np.sqrt(identified.covariance_of(_offset)[0, 0])
        sign = -1.0 if offset[0] < -_MEETING * uncertainty else 1.0
        return cls(RigidTransform(np.diag([sign, sign, 1.0]), np.array([0.0, 0.0, height])))


@dataclass(frozen=True, eq=False)
class BaseFrame:
    """R0 and the tracker's frame."""

    transform_tracker_to_base: RigidTransform  #: with its covariance
    #: (6, 4 n + 3 T) derivative of its (δ, φ) by the identified axes, for what depends on both
    jacobian: FloatArray
    convention: BaseConvention  #: how R0 was put on the axes

    def place(self, axes: Sequence[Axis]) -> RigidTransform:
        """The transform from tracker to base by other axes at angle zero, by the same convention."""
        frame = perpendicular_frame(axes[0], axes[1])
        return self.convention.base_from_perpendicular.after(frame.inverse())


def find_base_frame(identified: IdentifiedAxes, convention: BaseConvention) -> BaseFrame:
    """Place R0 on the identified axes.

    Raises:
        MeasurementError: fewer than two axes, or nearly parallel ones.
    """
    refuse_single_axis(identified.axes, "base")
    draft = BaseFrame(RigidTransform.identity(), np.zeros((6, 0)), convention)
    transform = draft.place(identified.axes)

    def motion(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        return transform.chart(draft.place(axes))

    J = identified.jacobian_of(motion)
    covariance = J @ identified.covariance @ J.T
    return BaseFrame(RigidTransform(transform.rotation, transform.translation, covariance), J, convention)


def _offset(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
    """Signed distance (1,) [m] of axis 2 from axis 1 along x of their perpendicular frame."""
    first, second = common_feet(axes[0], axes[1])
    x = perpendicular_frame(axes[0], axes[1]).rotation[:, 0]
    return np.array([(axes[1].at(second) - axes[0].at(first)) @ x])


def refuse_single_axis(axes: Sequence[Axis], frame: Literal["base", "flange"]) -> None:
    """Refuse to place a frame by fewer than two axes.

    Raises:
        MeasurementError: there are fewer.
    """
    if len(axes) < 2:
        explicit = "give the transform from the tracker's frame to R0 explicitly"
        raise MeasurementError(
            f"a single axis does not define a {frame} frame",
            where="sweeps",
            remedy=explicit if frame == "base" else "define the flange by three targets",
        )


@dataclass(frozen=True, eq=False)
class AxisPlace:
    """An axis in one frame, at model angle zero."""

    point: FloatArray  #: (3,) a point on it [m]
    direction: FloatArray  #: (3,) unit vector, positive rotation by the right hand
    point_covariance: FloatArray  #: (3, 3) of where the axis passes at `point` [m²]; NaN where not determined
    direction_covariance: FloatArray  #: (3, 3) of the unit vector [rad²]; NaN where not determined


@dataclass(frozen=True, eq=False)
class PlacedAxis:
    """One axis of the model, by the name of its joint."""

    name: str
    tracker: AxisPlace  #: in the tracker's frame
    base: AxisPlace  #: in R0, the uncertainty of R0 included

    @property
    def position_uncertainty(self) -> float:
        """Greatest standard uncertainty at the point, tracker's frame [m]; NaN where not determined."""
        return _greatest(self.tracker.point_covariance)

    @property
    def direction_uncertainty(self) -> float:
        """Greatest standard uncertainty of the direction, tracker's frame [rad]; NaN likewise."""
        return _greatest(self.tracker.direction_covariance)


def place_axes(identified: IdentifiedAxes, base: BaseFrame, names: Sequence[str]) -> tuple[PlacedAxis, ...]:
    """Place the axes in both frames.

    Args:
        identified: n axes.
        base: where R0 is.
        names: (n,) of the joints.
    """
    T = base.transform_tracker_to_base
    here = identified.axes
    there = tuple(axis.moved(T.rotation, T.translation) for axis in here)

    def in_tracker(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        return _places(axes, here)

    def in_base(axes: Sequence[Axis], _: FloatArray) -> FloatArray:
        placed = base.place(axes)
        return _places([axis.moved(placed.rotation, placed.translation) for axis in axes], there)

    tracker, in_r0 = _determined(identified, in_tracker), _determined(identified, in_base)
    return tuple(
        PlacedAxis(name, _place(here[i], tracker[i]), _place(there[i], in_r0[i]))
        for i, name in enumerate(names)
    )


def _places(axes: Sequence[Axis], reference: Sequence[Axis]) -> FloatArray:
    """Return where each axis passes, nearest to the reference's point, and its direction: (6 n,)."""
    pairs = zip(axes, reference, strict=True)
    return np.ravel([[axis.at(axis.foot(other.point)), axis.direction] for axis, other in pairs])


def _determined(identified: IdentifiedAxes, geometry: Geometry) -> FloatArray:
    """Return covariances (n, 6, 6) by axis; NaN in the blocks that the readings do not determine."""
    J = identified.jacobian_of(geometry).reshape(identified.n, 6, -1)
    blocks: FloatArray = J @ identified.covariance @ J.transpose(0, 2, 1)
    hidden = np.isinf(identified.standard_uncertainties(J.reshape(6 * identified.n, -1)))
    lost = np.repeat(hidden.reshape(-1, 2, 3).any(axis=2), 3, axis=1)
    return np.where(lost[:, :, None] & lost[:, None, :], np.nan, blocks)


def _place(axis: Axis, covariance: FloatArray) -> AxisPlace:
    return AxisPlace(axis.point, axis.direction, covariance[:3, :3], covariance[3:, 3:])


def _greatest(covariance: FloatArray) -> float:
    if np.isnan(covariance).any():
        return float("nan")
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
