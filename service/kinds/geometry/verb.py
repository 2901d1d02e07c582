"""The verb of geometries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from jointstiff.schemas.fields import Message
from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.service.kinds.geometry.kind import GEOMETRY
from jointstiff.service.kinds.verb import (
    Backend,
    JobMonitor,
    Request,
    carry_out_verb,
    describe_verb,
    merge_readings,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.geometry import (
        Geometry,
        GeometryNoise,
        GeometryUnits,
        JointSweep,
        TrackedPosition,
    )
    from jointstiff.schemas.robot import JointMap, RobotDocument
    from jointstiff.service.conversion.units import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, File, OnProgress, Vector


class GeometryFields(TypedDict, total=False):
    """Options of `geometry`."""

    name: str
    units: AnyUnits | GeometryUnits
    robot_id: str | None
    robot: File | RobotDocument | Mapping[str, Any]
    joint_map: JointMap | Mapping[str, Any] | None
    noise: GeometryNoise | Mapping[str, Any] | None
    sweeps: Sequence[JointSweep | Mapping[str, Any]] | None
    poses: Sequence[TrackedPosition | Mapping[str, Any]] | None
    fit: Literal["one_by_one", "together"]
    angles: Literal["free", "controller"]
    base: Literal["nominal", "axes"] | None
    base_height: float
    flange: Literal["nominal", "axes", "targets"] | None
    flange_targets: Sequence[str] | None
    base_targets_before: Mapping[str, Vector] | None
    base_targets_after: Mapping[str, Vector] | None


def geometry(
    backend: Backend,
    readings: File | Mapping[str, Any] | Message | None = None,
    /,
    options: GeometryRequest | None = None,
    *,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[GeometryFields],
) -> Geometry:
    """Identify the geometry of a robot from sweeps or poses.

    Args:
        readings: a file, a document, or the message of the request.
    """

    def make_request(_: Backend) -> Request:
        """Return the readings with the options."""
        return Request(merge_readings(GeometryRequest, readings, options, fields))

    return carry_out_verb(backend, GEOMETRY, JobMonitor(on_progress, cancel, executor), make_request)


describe_verb(geometry, GEOMETRY)
