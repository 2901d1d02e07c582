"""Maps: from what is asked for to the numerical core, and back to summaries and tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.schemas import map as messages
from jointstiff.schemas.assessment import Assessment
from jointstiff.service.conversion.robots import joint_index, refuse_far_point, refuse_other_angles
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.messages import finite
from jointstiff.solver.predict.maps import STATUSES, DeflectionMap, MapTask, tool_rotations
from jointstiff.solver.robot.model import Robot

_SHARES: Final = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
_LEAST_LENGTH: Final = 1e-9
_EXTRAPOLATED: Final = 1.0 + 1e-6


def to_places(request: messages.MapOptions) -> FloatArray:
    """Return the places (P, 3) of the grid [m], z running fastest.

    Raises:
        RequestError: the box is inside out, or there are too many places or poses.
    """
    least, greatest = (np.array(corner) for corner in request.area)
    if (least > greatest).any():
        raise RequestError(
            "the first corner of the box exceeds the second",
            where="area",
            remedy="give the least corner first",
        )
    places = int(np.prod(request.grid))
    poses = places * len(request.directions) * request.turns
    for what, count, most in (
        ("places", places, messages.MAX_PLACES),
        ("places times directions times turns", poses, messages.MAX_POSES),
    ):
        if count > most:
            raise RequestError(
                f"{count:,} {what} exceed {most:,}",
                where="grid",
                remedy="use a coarser grid, fewer orientations, or several maps",
            )
    axes = [
        np.linspace(low, high, count) if count > 1 else np.array([0.5 * (low + high)])
        for low, high, count in zip(least, greatest, request.grid, strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def to_map_task(request: messages.MapOptions, robot: Robot) -> MapTask:
    """Return what to ask of each place.

    Raises:
        RequestError: a direction without length, no load, limits or angles of other joints than the robot's,
            or a point that no tool reaches.
    """
    refuse_far_point(request.place, "place")
    refuse_far_point(request.load_point, "load_point")
    force, moment = np.array(request.force), np.array(request.moment or (0.0, 0.0, 0.0))
    if not (force.any() or moment.any() or request.absolute):
        raise RequestError("the load is missing", where="force", remedy="give the force of the process in N")
    if request.direction is None and not force.any():
        raise RequestError(
            "the direction of the compliance is missing",
            where="direction",
            remedy="give `direction`, because there is no force",
        )
    rotation = tool_rotations(
        _unit(request.tool_axis, "tool_axis"),
        np.array([_unit(each, f"directions[{i}]") for i, each in enumerate(request.directions)]),
        request.turns,
    )
    direction = _unit(tuple(force) if request.direction is None else request.direction, "direction")
    turned = rotation if request.axes == "flange" else np.broadcast_to(np.eye(3), rotation.shape)
    return MapTask(
        rotation=rotation,
        force=turned @ force,
        moment=turned @ moment,
        direction=turned @ direction,
        place=np.array(request.place),
        load_point=np.array(request.place if request.load_point is None else request.load_point),
        limits=_limits(request, robot),
        near=_near(request, robot),
        confidence=request.confidence,
    )


def to_map_result(
    request: messages.MapOptions,
    task: MapTask,
    places: FloatArray,
    found: DeflectionMap,
    *,
    model_error_postures: int,
    assessment: Assessment,
    remarks: Sequence[str],
) -> messages.MapResult:
    """Return the summary of a map."""
    counts = {name: int((found.status == i).sum()) for i, name in enumerate(STATUSES)}
    reached, length = np.flatnonzero(found.reached), found.length
    ends: dict[str, messages.MapPlace | None] = {"worst": None, "stiffest": None}
    quantiles = []
    if len(reached):
        tool = task.rotation @ _unit(request.tool_axis, "tool_axis")
        for name, of in (("worst", np.argmax), ("stiffest", np.argmin)):
            ends[name] = _place(int(reached[of(length[reached])]), places, tool, found)
        values = np.quantile(length[reached], _SHARES)
        quantiles = [
            messages.MapQuantile(share=share, deflection=float(value))
            for share, value in zip(_SHARES, values, strict=True)
        ]
    return messages.MapResult(
        assessment=assessment,
        places=len(found),
        counts=messages.MapCounts(**counts),
        quantiles=quantiles,
        **ends,
        extrapolated=int((found.extrapolation[reached] > _EXTRAPOLATED).sum()),
        model_error_postures=model_error_postures,
        remarks=list(remarks),
    )


def _place(index: int, places: FloatArray, tool: FloatArray, found: DeflectionMap) -> messages.MapPlace:
    return messages.MapPlace(
        position=tuple(places[index].tolist()),
        joints=found.joints[index].tolist(),
        tool_direction=tuple(tool[found.orientation[index]].tolist()),
        displacement=tuple(found.displacement[index].tolist()),
        deflection=float(found.length[index]),
        readings_only=_pair(found.readings[index]),
        with_model_error=_pair(found.with_model_error[index]),
        compliance_along=finite(found.along[index]),
        compliance_across=finite(found.across[index]),
        extrapolation=finite(found.extrapolation[index]),
    )


def _limits(request: messages.MapOptions, robot: Robot) -> FloatArray:
    limits = np.tile([-np.inf, np.inf], (robot.n, 1))
    for name, (least, greatest) in request.limits.items():
        if least > greatest:
            raise RequestError(
                "the least angle exceeds the greatest",
                where=f"limits.{name}",
                remedy="give the least angle first",
            )
        limits[joint_index(robot, name, f"limits.{name}")] = least, greatest
    return limits


def _near(request: messages.MapOptions, robot: Robot) -> FloatArray | None:
    if request.near is None:
        return None
    refuse_other_angles(robot, request.near, "near")
    return np.array(request.near)


def _unit(vector: Sequence[float], where: str) -> FloatArray:
    array = np.array(vector, dtype=np.float64)
    length = float(np.linalg.norm(array))
    if length < _LEAST_LENGTH:
        raise RequestError(
            "the direction is the zero vector", where=where, remedy="give a vector that is not zero"
        )
    return np.asarray(array / length)


def _pair(ends: FloatArray) -> tuple[float, float] | None:
    return (float(ends[0]), float(ends[1])) if np.isfinite(ends).all() else None
