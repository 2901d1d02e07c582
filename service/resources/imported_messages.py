"""Messages made of imported readings: a measurement set, or unloaded poses."""

from __future__ import annotations

from math import sqrt
from pathlib import PurePath
from typing import Any, Final, cast

from pydantic import ValidationError

from jointstiff.schemas.fields import MAX_NAME_LENGTH, Vector3
from jointstiff.schemas.geometry import MAX_GEOMETRY_READINGS, MAX_GEOMETRY_TARGETS
from jointstiff.schemas.imports import ImportRequest, UnloadedPoses
from jointstiff.schemas.measurement import MeasurementSetDocument, Observation, Reading
from jointstiff.service.importing.assembly import Gathered
from jointstiff.service.importing.errors import ImportFileError, Place
from jointstiff.service.importing.reading import Imported
from jointstiff.service.importing.words import Kind
from jointstiff.service.problems.wording import reworded

_LENGTHS: Final = frozenset(("sigma", "station", "constant", "load_point", "target_places", "position"))
"""Fields with lengths, in `noise` and of the request."""


def length_unit(imported: Imported, request: ImportRequest) -> str:
    """Return the unit of the lengths in the request: the files' own if it says none."""
    return request.length_unit or imported.units.get("length", "mm")


def converted(value: Any, before: str, after: str, name: str = "") -> Any:  # noqa: ANN401 - any part of it
    """Return a part of the request with its lengths, in m or mm, in the other unit."""
    if isinstance(value, dict):
        return {key: converted(part, before, after, key) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return tuple(converted(part, before, after, name) for part in value)
    if before == after or name not in _LENGTHS or value is None:
        return value
    return value / 1e3 if after == "m" else value * 1e3


def measurement_set_of(imported: Imported, request: ImportRequest, first: str) -> MeasurementSetDocument:
    """Return the measurement set, if nothing is missing.

    Raises:
        ImportFileError: files and request state the same thing, or a limit of sets is broken.
    """
    noise, with_forces = request.noise, "force" in imported.units
    stated = noise is not None and (noise.sigma is not None or noise.instrument)
    gauged = any(name != place for name, place in imported.assembly.places.items())
    if imported.assembly.uncertainty and stated and not gauged:
        raise ImportFileError(
            Place(),
            "the files give the uncertainty of each reading, and `noise` gives another",
            "omit `noise`, or skip the columns of U(95) with `ignore`",
            "noise",
        )
    if request.force is not None and with_forces:
        raise ImportFileError(
            Place(), "the files have forces, and `force` gives another", "omit `force`", "force"
        )
    units = length_unit(imported, request), imported.units.get("length", "mm")
    lengths = converted(request.model_dump(include={"noise", "load_point"}, exclude_unset=True), *units)
    places = request.flange_targets.items()
    force_unit = None if request.units is None else request.units.force
    try:
        return MeasurementSetDocument.model_validate(
            {
                "name": _name(request, first),
                "units": {"force": force_unit, **imported.units},
                "encoders": request.encoders,
                "noise": lengths.get("noise") or None,
                "flange_targets": {name: converted(place, *units, "load_point") for name, place in places}
                | {
                    name: converted(request.flange_targets[place], *units, "load_point")
                    for name, place in imported.assembly.places.items()
                },
                "load_point": lengths.get("load_point"),
                "measured_at": imported.surroundings.measured_at,
                "conditions": imported.surroundings.conditions,
                "observations": [_observation(one, request.force) for one in imported.assembly.observations],
            }
        )
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
        path = ".".join(map(str, fault["loc"]))
        raise ImportFileError(
            Place(),
            f"the readings do not make a valid measurement set: {path} {reworded(fault)}",
            "check the limits of measurement sets",
        ) from error


def poses_of(imported: Imported, request: ImportRequest, first: str) -> UnloadedPoses | None:
    """Return the unloaded poses for a geometry; None beyond its limits."""
    units = length_unit(imported, request), imported.units.get("length", "mm")
    observations = imported.assembly.observations
    points = [point for one in observations for states in one.points.values() for point in states.values()]
    sigma = None if request.noise is None else converted(request.noise.sigma, *units, "sigma")
    squares = [value**2 for point in points for value in point.sigma or ()]
    if sigma is None and squares:
        sigma = sqrt(sum(squares) / len(squares))
    if len(points) > MAX_GEOMETRY_READINGS or len(imported.assembly.targets) > MAX_GEOMETRY_TARGETS:
        return None
    read = [
        (
            one,
            {
                name: states["unloaded"].vector
                for name, states in one.points.items()
                if states["unloaded"].vector
            },
        )
        for one in observations
    ]
    return UnloadedPoses.model_validate(
        {
            "name": _name(request, first),
            "units": {"length": units[1], "angle": imported.units.get("angle")},
            "noise": None if sigma is None else {"sigma": sigma},
            "poses": [
                {"joints": list(one.values["joint"][0]), "targets": targets}
                for one, targets in read
                if targets
            ],
        }
    )


def _name(request: ImportRequest, first: str) -> str:
    """Return the name of the set: as stated, else that of the first file as far as it can be one."""
    stem = "".join(character for character in PurePath(first).stem if character.isprintable())
    return request.name or stem.strip()[:MAX_NAME_LENGTH].strip() or "readings"


def _observation(one: Gathered, force: Vector3 | None) -> Observation:
    def vector(kind: Kind) -> Vector3 | None:
        return cast(Vector3, one.values[kind][0]) if kind in one.values else None

    return Observation(
        label=one.label,
        joints=list(one.values["joint"][0]),
        force=cast(Vector3, vector("force") or force),
        moment=vector("moment"),
        load_point=vector("load point"),
        readings=[_reading(one, target) for target in one.points],
    )


def _reading(one: Gathered, target: str) -> Reading:
    """A reading; uncertainties of coordinates are covariances, of points one sigma for both states."""
    points = one.points[target]
    gauge = points.get("deflection")
    if gauge is not None and gauge.along is not None:
        direction = tuple(float(axis == gauge.along[1]) for axis in range(3))
        displacement = None if gauge.vector is None else gauge.vector[0]
        reading = {"target": target, "displacement": displacement, "direction": direction}
        return Reading.model_validate(reading)
    vectors = {
        state: cast(Vector3, point.vector) for state, point in points.items() if point.vector is not None
    }
    sigmas = {state: point.sigma for state, point in points.items() if point.sigma is not None}
    if not sigmas or all(point.by_point for point in points.values()):
        squares = [sigma[0] ** 2 for sigma in sigmas.values()]
        return Reading(target=target, sigma=sqrt(sum(squares) / len(squares)) if squares else None, **vectors)
    covariances = {
        f"{state}_covariance": [[sigma[i] ** 2 if i == j else 0.0 for j in range(3)] for i in range(3)]
        for state, sigma in sigmas.items()
    }
    return Reading.model_validate({"target": target, **vectors, **covariances})
