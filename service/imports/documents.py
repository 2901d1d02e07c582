"""Readings as a measurement set, or as poses of a geometry, in mm, degrees or radians, and N."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import Any, Final, cast

import numpy as np
from pydantic import ValidationError

from jointstiff.schemas.fields import MAX_NAME_LENGTH
from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.imports import ImportRequest, Mapping
from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.service.conversion.units import ANGLE
from jointstiff.service.imports.gather import Key, Readings
from jointstiff.service.imports.tables import TableError
from jointstiff.service.problems import reword_fault
from jointstiff.solver.arrays import FloatArray

_STATES: Final = ("unloaded", "loaded", "unloaded_after")
_DIGITS: Final = 10
"""Decimals of numbers, so that a number is written as in the file after two conversions."""
_LEAST_SIGMA: Final = 5e-7
"""Standard uncertainty [m] in place of a stated 0."""


def name_set(request: ImportRequest, first_table: str) -> str:
    """Return the name of the set: from the request, else the name of the first file without its ending."""
    file = first_table.partition("#")[0]
    stem = "".join(letter for letter in PurePath(file).stem if letter.isprintable()).strip()
    return request.name or stem[:MAX_NAME_LENGTH].strip() or "readings"


def build_set(readings: Readings, mapping: Mapping, name: str) -> MeasurementSetDocument:
    """Return the measurement set of readings; if the arm's own weight is the load, forces are zero.

    Raises:
        TableError: the set exceeds a limit.
    """
    frame = None
    if mapping.frame is not None:
        frame = {"rotation": mapping.frame.rotation, "translation": mapping.frame.origin}
    fields = {
        "name": name,
        "units": {"length": "mm", "angle": _find_angle_unit(mapping), "force": "N", "moment": "N.m"},
        "encoders": mapping.encoders,
        "joint_kinds": ["prismatic" if slides else "revolute" for slides in readings.slides],
        "noise": mapping.noise,
        "frame": frame,
        "flange_targets": mapping.flange_targets,
        "load_point": mapping.load_point,
        "load_point_target": mapping.load_point_target,
        "observations": list(_list_observations(readings, mapping)),
    }
    try:
        return MeasurementSetDocument.model_validate(fields)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
        place = ".".join(map(str, fault["loc"]))
        reason = f"the readings make no measurement set: {place} {reword_fault(fault)}"
        raise TableError(reason, remedy="check the limits of measurement sets") from error


def _find_angle_unit(mapping: Mapping) -> str:
    """Return the unit of the joints in the files: degrees, unless all are in radians."""
    units = {role.unit for part in mapping.tables for role in part.roles if role.role == "joints"}
    return "rad" if "rad" in units else "deg"


def _list_observations(readings: Readings, mapping: Mapping) -> Iterator[dict[str, Any]]:
    """Yield an observation for each load of each posture that was read."""
    targets_of: dict[str, list[str]] = {}
    for key in readings.list_keys():
        targets = targets_of.setdefault(key.posture, [])
        if key.target not in targets:
            targets.append(key.target)
    for posture, targets in targets_of.items():
        loads = readings.list_loads(posture)
        for load in loads:
            force = readings.find_force(posture, load, mapping.force)
            yield {
                "label": posture if len(loads) == 1 else f"{posture} {load:.5g} N",
                "joints": _write_joints(readings, posture, mapping),
                "force": [0.0, 0.0, 0.0] if force is None else force.tolist(),
                "moment": _write(readings.moments.get(posture), 1.0),
                "readings": [
                    reading
                    for target in targets
                    for reading in _list_readings(readings, posture, target, load)
                ],
            }


def _write_joints(readings: Readings, posture: str, mapping: Mapping) -> list[float]:
    """Return the joints of a posture in mm and in the files' unit of angle."""
    factors = np.where(readings.slides, 1e-3, ANGLE[_find_angle_unit(mapping)])
    return cast("list[float]", np.round(readings.joints[posture] / factors, _DIGITS).tolist())


def _write(vector: FloatArray | None, unit: float = 1e-3) -> list[float] | None:
    """Return a vector in a unit, in mm by default."""
    return None if vector is None else cast("list[float]", np.round(vector / unit, _DIGITS).tolist())


def _list_readings(
    readings: Readings, posture: str, target: str, load: float | None
) -> Iterator[dict[str, Any]]:
    """Yield the reading of a target under a load, and one for each gauge."""
    loaded = Key(posture, target, "loaded", load)
    keys = {state: Key(posture, target, state, load if state == "loaded" else None) for state in _STATES}
    fields: dict[str, Any] = {state: _write(readings.positions.get(key)) for state, key in keys.items()}
    if loaded in readings.displacements and fields["unloaded"] is None:
        fields["deflection"] = _write(readings.displacements[loaded])
    elif loaded in readings.displacements:
        place = readings.positions[keys["unloaded"]]
        fields["loaded"] = _write(place + readings.displacements[loaded])
    if any(value is not None for value in fields.values()):
        sigmas = [readings.uncertainties[key] for key in keys.values() if key in readings.uncertainties]
        sigma = 1e3 * float(np.sqrt(np.mean(np.square(sigmas)))) if sigmas else None
        yield {"target": target, "sigma": sigma and max(sigma, 1e3 * _LEAST_SIGMA), **fields}
    for (key, axis), size in readings.gauges.items():
        if key == loaded:
            direction = [float(i == axis) for i in range(3)]
            yield {"target": f"{target} {'xyz'[axis]}", "displacement": 1e3 * size, "direction": direction}


def build_geometry(readings: Readings, mapping: Mapping, name: str) -> GeometryRequest | None:
    """Return a request to identify a geometry from unloaded poses; None if there are more than it accepts."""
    sigma = mapping.noise.sigma if mapping.noise is not None else None
    if sigma is None and readings.uncertainties:
        sigma = 1e3 * float(np.sqrt(np.mean(np.square(list(readings.uncertainties.values())))))
    poses = []
    for posture in readings.joints:
        targets: dict[str, list[float] | None] = {
            key.target: _write(position)
            for key, position in readings.positions.items()
            if key.posture == posture
        }
        if targets:
            poses.append({"joints": _write_joints(readings, posture, mapping), "targets": targets})
    try:
        return GeometryRequest.model_validate(
            {
                "name": name,
                "units": {"length": "mm", "angle": _find_angle_unit(mapping)},
                "noise": None if sigma is None else {"sigma": sigma},
                "poses": poses,
            }
        )
    except ValidationError:
        return None


def list_places(readings: Readings) -> Sequence[str]:
    """Return the targets whose places in the flange frame the readings need: those of displacements alone."""
    read = {(key.posture, key.target) for key in readings.positions}
    keys = [key for key in readings.displacements if (key.posture, key.target) not in read]
    keys += [key for key, _ in readings.gauges]
    return list(dict.fromkeys(key.target for key in keys))
