"""The identified axes in the tracker's frame and in R0, with their uncertainties there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry.frames.base_frame import BaseFrame
from jointstiff.solver.geometry.sweeps.axis import Axis
from jointstiff.solver.geometry.sweeps.identified_axes import Geometry, IdentifiedAxes


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
