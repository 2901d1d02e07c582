"""The robot's base frame R0 in the tracker's frame, from axes 1 and 2.

Two axes fix R0 but for a convention, because neither shows how high the floor is nor which way the
maker's x points:

* *By a nominal model* (preferred): R0 stands to the perpendicular frame of the identified axes 1 and 2
  (`axis_frame`) as the model's R0 stands to that of its own axes, all at model angle zero. The nominal height
  of axis 2 above R0 is kept, for instance, and all else is measured.
* *By the axes alone*: z along axis 1, in the sense of its positive rotation; the origin on axis 1 at the foot
  of its common perpendicular with axis 2, less a height that is given; x along that perpendicular at
  model angle zero of joint 1, from axis 1 towards axis 2. If the two axes meet within their uncertainty, x
  is the product of the directions of axes 2 and 1 instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.frames.axis_frame import chain_axes, common_feet, perpendicular_frame
from jointstiff.solver.geometry.frames.rigid_transform import RigidTransform
from jointstiff.solver.geometry.sweeps.axis import Axis
from jointstiff.solver.geometry.sweeps.identified_axes import IdentifiedAxes
from jointstiff.solver.robot.chain import KinematicChain

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
        _refuse_fewer_than_two(axes)
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
        _refuse_fewer_than_two(identified.axes)
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
    _refuse_fewer_than_two(identified.axes)
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


def _refuse_fewer_than_two(axes: Sequence[Axis]) -> None:
    if len(axes) < 2:
        raise MeasurementError(
            "a single axis does not define a base frame",
            where="sweeps",
            remedy="give the transform from the tracker's frame to R0 explicitly",
        )
