"""The verb of geometries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from jointstiff.schemas.fields import Message
from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.service.kinds.geometry.kind import GEOMETRY
from jointstiff.service.kinds.verb import Backend, JobMonitor, describe_fields, merge_readings

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
    from jointstiff.service.conversion.arguments import AnyUnits
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
        backend: `Here` or a `Client`, which has this function as a method and does the work.
        readings: a file, a document, or the message of the request.
        options: a `GeometryRequest`; keyword arguments replace options of the same name.
        on_progress: called with the progress of a job that takes steps; default: a bar in a terminal or a
            notebook, if it takes more than 2 s.
        cancel: called between steps, such as `threading.Event().is_set`; if true, the job ends as
            `cancelled`.
        executor: carries out the steps, such as a `concurrent.futures.ProcessPoolExecutor()` or a Dask
            client's `get_executor()`; all numbers are the same to the last bit. A `Client` refuses an
            executor.
        fields: fields of `GeometryRequest`.

    Returns:
        The Geometry, with its result in SI units. If the computation fails, its state is `failed`.

    Raises:
        CampaignError: a source or an option cannot be used; the error's `problem` has reason and remedy.
        RefusedError: the service refuses the request.
        OSError: a file cannot be read.
    """
    with JobMonitor(on_progress, cancel, executor) as monitor:
        backend = backend.start_call(monitor)
        request = merge_readings(GeometryRequest, readings, options, fields)
        return backend.carry_out_request(GEOMETRY, request, {}, monitor)


describe_fields(geometry, GeometryRequest)
