"""Imports: files in, a preview and the measurement set or the poses that they make out. Nothing is stored."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import hypot, sqrt
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Final, cast

from pydantic import ValidationError

from jointstiff.schemas.fields import FAR_POINT, MAX_NAME_LENGTH, Vector3
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.geometry import MAX_GEOMETRY_READINGS, MAX_GEOMETRY_TARGETS, GeometryRequest
from jointstiff.schemas.imports import (
    MAX_PREVIEW_ROWS,
    FilePreview,
    ImportAnswer,
    ImportFault,
    ImportRequest,
    MissingField,
)
from jointstiff.schemas.measurement import MeasurementSetDocument, Observation, Reading
from jointstiff.schemas.robot import Body
from jointstiff.service.importing.errors import NOWHERE, ImportFileError, Place
from jointstiff.service.importing.grammar import Kind, Quantity, along_axis, joint_number
from jointstiff.service.importing.reading import SourceFile, Understood, understand_files
from jointstiff.service.importing.rows import Gathered
from jointstiff.service.problems import FilesError, reworded
from jointstiff.solver.errors import MeasurementError

if TYPE_CHECKING:
    from jointstiff.solver.integrity.other_robots import KnownRobot
    from jointstiff.solver.mechanics.robot import Robot

_LENGTHS: Final = frozenset(("sigma", "station", "constant", "load_point", "target_places", "position"))
"""Fields with lengths, in `noise` and of the request."""


class ImportRefusedError(FilesError):
    """Raise when files were not understood; nothing of them is taken then."""

    def __init__(self, faults: Sequence[ImportFileError]) -> None:
        first = faults[0]
        self.faults = tuple(faults)  # the first ones, in their order
        items = [(_place_text(fault.place), fault.reason, fault.remedy) for fault in self.faults]
        super().__init__(first.reason, remedy=first.remedy, where=_place_text(first.place), items=items)


def _place_text(place: Place) -> str:
    return ":".join(str(part) for part in place if part is not None) or "files"


def import_files(
    files: Sequence[SourceFile],
    request: ImportRequest,
    robot: Robot | None = None,
    others: Iterable[KnownRobot] | None = None,
) -> ImportAnswer:
    """Understand files of readings, and make a measurement set of them if nothing is missing.

    Args:
        files: text or Excel, in any order.
        request: what they do not say themselves.
        robot: that was measured: then the set is inspected.
        others: robots that may have been measured instead; the catalogue's arms if None.

    Raises:
        ImportRefusedError: something in them is not understood, contradictory or ambiguous, and the request
            does not ask to be shown it.
    """
    understood = understand_files(files, request)
    faults, first = list(understood.faults), files[0].name if files else ""
    bodies: list[Body] = []
    try:
        bodies = _with_robot_names(understood.bodies, robot)
    except ImportFileError as fault:
        faults.append(fault)
    unloaded = bool(bodies or (robot and robot.bodies)) and _is_unloaded(understood, request)
    missing = {} if faults else _missing_fields(understood, request, own_weight=unloaded)
    document, findings, template, geometry = None, None, None, None
    if not faults and not missing:
        try:
            document = _measurement_set(understood, request, first, own_weight=unloaded)
            findings = None if robot is None else _findings(document, robot, others)
            template = _template(understood, request)
        except ImportFileError as fault:
            document = None
            faults.append(fault)
    unusable = {"joints", "accept_unusual"} & missing.keys()
    if not faults and understood.preview.states == ["unloaded"] and not unusable:
        geometry = _geometry(understood, request, first)
    if faults and not request.show_faults:
        raise ImportRefusedError(faults)
    return ImportAnswer(
        **dict(understood.preview),
        faults=[
            ImportFault(
                **fault.place._asdict(),
                reason=fault.reason,
                remedy=fault.remedy,
                option=fault.option,
                words=list(fault.words),
            )
            for fault in faults
        ],
        missing_fields=list(missing),
        missing=list(missing.values()),
        bodies=bodies,
        leave_out=[one.label for one in understood.observations if one.held_out],
        measurement_set=document,
        findings=findings,
        template=template,
        geometry=geometry,
    )


def _is_unloaded(understood: Understood, request: ImportRequest) -> bool:
    """Return whether the files have unloaded positions only, and nobody states a load."""
    loads = (one.vector("force") or () for one in understood.observations)
    return understood.preview.states == ["unloaded"] and request.force is None and not any(map(any, loads))


def _with_robot_names(bodies: Sequence[Body], robot: Robot | None) -> list[Body]:
    """Return bodies with the robot's names of their joints, where a table numbers them: `2`, `J2`, `axis 2`.

    Raises:
        ImportFileError: the robot has no such joint.
    """
    named = []
    for body in bodies:
        number = joint_number(body.joint)
        joint = body.joint
        if robot is None:
            joint = f"joint_{number}" if number else joint
        elif joint not in robot.joint_names:
            if number is None or number > len(robot.joint_names):
                names = ", ".join(robot.joint_names)
                reason = f"the robot has no joint '{joint}', which carries '{body.name}'"
                raise ImportFileError(NOWHERE, reason, f"use one of {names}")
            joint = robot.joint_names[number - 1]
        named.append(body.model_copy(update={"joint": joint}))
    return named


def _missing_fields(
    understood: Understood, request: ImportRequest, *, own_weight: bool
) -> dict[MissingField, str]:
    """Return what a measurement set needs beyond files and request, by field and in words.

    One for the robot's own weight needs no load.
    """
    first, states = understood.observations[0], understood.preview.states
    unusual = [] if request.accept_unusual else _unusual(understood, request)
    right = f"a confirmation (`accept_unusual`) that this is right: {'; '.join(unusual[:MAX_PREVIEW_ROWS])}"
    stated, unit = request.force is not None, None if request.units is None else request.units.force
    joints = "joint angles of each observation: columns `J1 [deg]`, `J2 [deg]`, … (lengths as `J3 [mm]`)"
    forces = "the force of each observation: columns `Fx [N]`, `Fy [N]`, `Fz [N]`, or one `force`"
    readings = "readings: columns such as `P10 unloaded x [mm]`, or lists of points"
    places = "the targets' positions in the flange frame (`flange_targets`), for deflections"
    unplaced = not set(understood.places.values()) <= set(request.flange_targets)
    loaded = "the positions under load"
    if first.vector("joint") is not None:
        loaded += ", or the robot's masses (`bodies`, or a table of masses), for its own weight"
    no_point = not own_weight and first.vector("load point") is None and request.load_point is None
    encoders = "the encoders that close the position loop (`encoders`): motor or secondary"
    no_unit = stated and "force" not in understood.units and unit is None
    wanted: list[tuple[bool, MissingField, str]] = [
        (first.vector("joint") is None, "joints", joints),
        (first.vector("force") is None and not stated and not own_weight, "force", forces),
        (not states, "readings", readings),
        (states == ["unloaded"] and not own_weight, "loaded", loaded),
        (states == ["loaded"], "unloaded", "the positions without load"),
        (unplaced, "flange_targets", places),
        (no_point, "load_point", "the load point (`load_point`), in the flange frame"),
        (bool(unusual), "accept_unusual", right),
        (no_unit, "units.force", "the unit of `force` (`units`): N, kN or kgf"),
        (request.encoders is None, "encoders", encoders),
    ]
    return {field: text for lacks, field, text in wanted if lacks}


def _unusual(understood: Understood, request: ImportRequest) -> list[str]:
    """Return what is to be confirmed: values far from all others, load points that no tool reaches."""
    stated, unit = _length_units(understood, request)
    read = [point for one in understood.observations if (point := one.vector("load point"))]
    points = [hypot(*_convert_lengths(point, unit, "m", "load_point")) for point in read]
    if request.load_point is not None:
        points.append(hypot(*_convert_lengths(request.load_point, stated, "m", "load_point")))
    far = max(points, default=0.0)
    far_point = [f"the load point is {far:g} m from the flange"] if far > FAR_POINT else []
    return [*far_point, *understood.unusual]


def _findings(
    document: MeasurementSetDocument, robot: Robot, others: Iterable[KnownRobot] | None
) -> list[Finding]:
    """Inspect a set; lengths that the request states have another remedy than those of the files."""
    from jointstiff.service.conversion.prepared import check_set
    from jointstiff.service.resources.known_robots import catalogue_robots

    try:
        known = catalogue_robots() if others is None else others
        findings = check_set(document, robot, None, [], known).warnings
    except MeasurementError as error:
        where = f" ({error.where})" if error.where else ""
        reason = f"the readings do not fit the robot{where}: {error.reason}"
        raise ImportFileError(NOWHERE, reason, error.remedy or "check robot and readings") from error
    fields = [f"`{field}`" for field in ("load_point", "flange_targets") if getattr(document, field)]
    for index, finding in enumerate(findings):
        if fields and finding.code == "length_unit_suspect" and "the flange frame" in finding.message:
            remedy = f"check the unit of {' and '.join(fields)}"
            findings[index] = finding.model_copy(update={"remedy": remedy})
    return findings


# ---- lengths of the request, in the files' unit


def _length_units(understood: Understood, request: ImportRequest) -> tuple[str, str]:
    """Return the units of the lengths in the request, the files' own if it says none, and in the files."""
    of_files = understood.units.get("length", "mm")
    return request.length_unit or of_files, of_files


def _convert_lengths(value: Any, before: str, after: str, name: str = "") -> Any:  # noqa: ANN401 - any part of it
    """Return a part of the request with its lengths, in m or mm, in the other unit."""
    if isinstance(value, dict):
        return {key: _convert_lengths(part, before, after, key) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return tuple(_convert_lengths(part, before, after, name) for part in value)
    if before == after or name not in _LENGTHS or value is None:
        return value
    return value / 1e3 if after == "m" else value * 1e3


# ---- what is made of the files


def _name(request: ImportRequest, first: str) -> str:
    """Return the name of the set: as stated, else that of the first file as far as it can be one."""
    stem = "".join(character for character in PurePath(first).stem if character.isprintable())
    return request.name or stem.strip()[:MAX_NAME_LENGTH].strip() or "readings"


def _measurement_set(
    understood: Understood, request: ImportRequest, first: str, *, own_weight: bool
) -> MeasurementSetDocument:
    """Return the measurement set, if nothing is missing; one for own weight has no force.

    Raises:
        ImportFileError: files and request state the same thing, or a limit of sets is broken.
    """
    noise, places = request.noise, understood.places
    stated = noise is not None and (noise.sigma is not None or noise.instrument)
    gauged = any(name != place for name, place in places.items())
    if understood.preview.uncertainty and stated and not gauged:
        reason = "the files give the uncertainty of each reading, and `noise` gives another"
        remedy = "omit `noise`, or skip the columns of U(95) with `ignore`"
        raise ImportFileError(NOWHERE, reason, remedy, "noise")
    if request.force is not None and "force" in understood.units:
        reason = "the files have forces, and `force` gives another"
        raise ImportFileError(NOWHERE, reason, "omit `force`", "force")
    force = (0.0, 0.0, 0.0) if own_weight else request.force
    units = _length_units(understood, request)
    lengths = _convert_lengths(
        request.model_dump(include={"noise", "load_point"}, exclude_unset=True), *units
    )
    in_flange = {**{name: name for name in request.flange_targets}, **places}
    try:
        return MeasurementSetDocument.model_validate(
            {
                "name": _name(request, first),
                "units": {
                    "force": (request.units and request.units.force) or ("N" if own_weight else None),
                    **understood.units,
                },
                "encoders": request.encoders,
                "joint_kinds": understood.preview.joint_kinds,
                "noise": lengths.get("noise") or None,
                "flange_targets": {
                    name: _convert_lengths(request.flange_targets[place], *units, "load_point")
                    for name, place in in_flange.items()
                },
                "load_point": lengths.get("load_point"),
                "measured_at": understood.surroundings.measured_at,
                "observations": [_observation(one, force) for one in understood.observations],
            }
        )
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
        path = ".".join(map(str, fault["loc"]))
        reason = f"the readings do not make a valid measurement set: {path} {reworded(fault)}"
        raise ImportFileError(NOWHERE, reason, "check the limits of measurement sets") from error


def _observation(one: Gathered, force: Vector3 | None) -> Observation:
    def vector(kind: Kind) -> Vector3 | None:
        return cast("Vector3 | None", one.vector(kind))

    return Observation(
        label=one.label,
        joints=list(one.vector("joint") or ()),
        force=cast(Vector3, vector("force") or force),
        moment=vector("moment"),
        load_point=vector("load point"),
        readings=[_reading(one, target) for target in one.points],
    )


def _reading(one: Gathered, target: str) -> Reading:
    """A reading; uncertainties of coordinates are covariances, of points one sigma for both states."""
    gauge = one.values.get(Quantity("along", target, "deflection"))
    if gauge is not None:
        along = along_axis(target)[1]
        direction = tuple(float(axis == along) for axis in range(3))
        displacement = None if gauge.vector is None else gauge.vector[0]
        reading = {"target": target, "displacement": displacement, "direction": direction}
        return Reading.model_validate(reading)
    points = {state: point for state, point in one.points[target].items() if point.vector is not None}
    parts: dict[str, object] = {state: point.vector for state, point in points.items()}
    sigmas = {state: point.sigma for state, point in points.items() if point.sigma is not None}
    if sigmas and all(point.by_point for point in points.values()):
        parts["sigma"] = sqrt(sum(sigma[0] ** 2 for sigma in sigmas.values()) / len(sigmas))
    elif sigmas:
        for state, sigma in sigmas.items():
            rows = [[sigma[i] ** 2 if i == j else 0.0 for j in range(3)] for i in range(3)]
            parts[f"{state}_covariance"] = rows
    return Reading.model_validate({"target": target, **parts})


def _geometry(understood: Understood, request: ImportRequest, first: str) -> GeometryRequest | None:
    """Return the unloaded poses for a geometry; None beyond its limits."""
    units = _length_units(understood, request)
    readings = [states["unloaded"] for one in understood.observations for states in one.points.values()]
    if len(readings) > MAX_GEOMETRY_READINGS or len(understood.preview.targets) > MAX_GEOMETRY_TARGETS:
        return None
    sigma = None if request.noise is None else _convert_lengths(request.noise.sigma, *units, "sigma")
    squares = [value**2 for point in readings for value in point.sigma or ()]
    if sigma is None and squares:
        sigma = sqrt(sum(squares) / len(squares))
    poses = []
    for one in understood.observations:
        read = {target: states["unloaded"].vector for target, states in one.points.items()}
        targets = {target: vector for target, vector in read.items() if vector}
        if targets:
            poses.append({"joints": list(one.vector("joint") or ()), "targets": targets})
    return GeometryRequest.model_validate(
        {
            "name": _name(request, first),
            "units": {"length": units[1], "angle": understood.units.get("angle")},
            "noise": None if sigma is None else {"sigma": sigma},
            "poses": poses,
        }
    )


def _template(understood: Understood, request: ImportRequest) -> ImportRequest | None:
    """Return the options by which files of the same form are read again, and others are refused.

    Files with more columns, or longer headers of several rows, than options can hold have no template.
    """
    files: list[FilePreview] = understood.preview.files
    texts = [file for file in files if file.format == "text"]
    delimiters, marks = {file.delimiter for file in texts}, {file.decimal_mark for file in texts}
    columns = [column for file in files for column in file.columns]
    inches = any(column.unit == "in" for column in columns)
    known = {} if request.units is None else request.units.model_dump(exclude_none=True)
    layouts = {tuple(column.header for column in file.columns): None for file in files}
    changes = {
        "units": {**known, **understood.units, **({"length": "in"} if inches else {})},
        "columns": {
            column.header: column.meaning + (f" [{column.unit}]" if column.unit else "")
            for column in columns
            if column.header
        },
        "layouts": [list(layout) for layout in layouts],
        "ignore": [],
        "delimiter": delimiters.pop() if len(delimiters) == 1 else None,
        "decimal_mark": marks.pop() if len(marks) == 1 else None,
        "length_unit": _length_units(understood, request)[0],
        "name": None,
        "robot_id": None,
        "show_faults": False,
        "accept_unusual": False,  # what was confirmed are these values, not the next file's
    }
    try:
        return ImportRequest.model_validate(request.model_dump() | changes)
    except ValidationError:
        return None
