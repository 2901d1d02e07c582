"""Resolve the frame of a measurement set when the set is stored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from jointstiff.schemas.fields import Vector3
from jointstiff.schemas.finding import Finding, FindingCode
from jointstiff.schemas.geometry import Geometry, GeometryRequest, GeometryResult
from jointstiff.schemas.measurement import Frame, MeasurementSetRequest, ResolvedFrame
from jointstiff.schemas.robot import Robot
from jointstiff.service.conversion.prepared import stated_transform, to_base_targets, to_resolved
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.resources.stored_jobs import succeeded_geometry
from jointstiff.service.store.store import Store
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.charts import RigidTransform
from jointstiff.solver.geometry.findings import drift_findings
from jointstiff.solver.geometry.frames import BaseDrift

FRAME_CODES: Final[frozenset[FindingCode]] = frozenset({"base_drifted", "base_target_moved"})
"""Kinds of warnings about a frame, whatever the observations."""


def resolve_frame(store: Store, request: MeasurementSetRequest) -> tuple[ResolvedFrame | None, list[Finding]]:
    """The transform from tracker to R0 that a set's frame stands for, and what was noticed.

    Returns:
        None if the set is in R0; and warnings about a drift that is removed.

    Raises:
        MeasurementError: the rotation is none, or base targets cannot be compared.
        RequestError: there is no such geometry, or it has none to compare with.
    """
    frame = request.frame
    if frame is None:
        return None, []
    length = LENGTH[request.units.length]
    if frame.geometry_id is None:
        return to_resolved(stated_transform(frame, length)), []
    geometry, result = succeeded_geometry(store, frame.geometry_id, "frame.geometry_id")
    stated = result.base_frame.transform_tracker_to_base
    transform = RigidTransform(np.array(stated.rotation), np.array(stated.translation))
    warnings: list[Finding] = []
    if frame.base_targets is not None:
        drift, warnings = _drift(geometry.request, result, request, frame.base_targets)
        transform = transform.after(drift.transform_after_to_before)
    return to_resolved(transform, _flange_targets(store, frame, request.robot_id, geometry, result)), warnings


def _drift(
    geometry: GeometryRequest,
    result: GeometryResult,
    request: MeasurementSetRequest,
    after: Mapping[str, Vector3],
) -> tuple[BaseDrift, list[Finding]]:
    """Return what moved between the geometry and the set."""
    factor = LENGTH[request.units.length] / LENGTH[geometry.units.length]
    later = {name: _scaled(place, factor) for name, place in after.items()}
    read = to_base_targets(geometry, result.goodness.sigma, later)
    if read is None:
        raise MeasurementError(
            "the geometry has no base targets to compare with",
            where="frame.base_targets",
            remedy="omit them, or give `base_targets.before` with the geometry",
        )
    drift = read.drift(result.goodness.sigma, _middle(request, read.after.mean(axis=0)))
    warnings = [
        finding.model_copy(
            update={
                "weight": "use",
                "remedy": "the drift is corrected in this set; let the tracker warm up, and mount it more "
                "rigidly",
            }
        )
        if finding.code == "base_drifted"
        else finding
        for finding in drift_findings(drift)
    ]
    return drift, warnings


def _middle(request: MeasurementSetRequest, instead: FloatArray) -> FloatArray:
    """Return the middle of the unloaded positions [m]; if all readings are deflections, another point."""
    places = [r.unloaded for o in request.observations for r in o.readings if r.unloaded is not None]
    if not places:
        return instead
    return np.asarray(LENGTH[request.units.length] * np.mean(places, axis=0))


def _flange_targets(
    store: Store, frame: Frame, robot_id: str, geometry: Geometry, result: GeometryResult
) -> dict[str, Vector3]:
    """The geometry's targets [m], if they are in the flange frame of the set's robot; else none."""
    robot = Robot.model_validate_json(store.robots.get(robot_id).document)
    of_nominal = result.flange == "nominal" and geometry.request.robot_id == robot_id
    if robot.geometry_id != frame.geometry_id and not of_nominal:
        return {}
    return {target.name: target.position for target in result.targets}


def _scaled(place: Vector3, factor: float) -> Vector3:
    x, y, z = place
    return factor * x, factor * y, factor * z
