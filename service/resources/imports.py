"""Import files of readings: return a preview and a measurement set or poses. Nothing is stored."""

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
from jointstiff.service.importing.grammar import Kind, Quantity, joint_number, split_along_target
from jointstiff.service.importing.reading import SourceFile, Understood, understand_files
from jointstiff.service.importing.rows import ObservationRecord
from jointstiff.service.problems import FilesError, reword_fault
from jointstiff.solver.errors import MeasurementError

if TYPE_CHECKING:
    from jointstiff.solver.mechanics.robot import KnownRobot, Robot

_LENGTHS: Final = frozenset(
    ("sigma", "station", "constant", "load_point", "target_places", "drift", "position")
)
"""Fields of the request, and of its `noise`, that hold lengths."""


class ImportRefusedError(FilesError):
    """Files that were not understood, so that nothing is imported."""

    def __init__(self, faults: Sequence[ImportFileError]) -> None:
        first = faults[0]
        self.faults = tuple(faults)  # the faults that were found, in the order of the files
        items = [(_place_text(fault.place), fault.reason, fault.remedy) for fault in self.faults]
        super().__init__(first.reason, remedy=first.remedy, where=_place_text(first.place), items=items)


def _place_text(place: Place) -> str:
    """Return a place as `file:line:column`, without unknown parts; `files` if nothing is known."""
    return ":".join(str(part) for part in place if part is not None) or "files"


def import_files(
    files: Sequence[SourceFile],
    request: ImportRequest,
    robot: Robot | None = None,
    other_robots: Iterable[KnownRobot] | None = None,
) -> ImportAnswer:
    """Read files of readings; return a preview, and a measurement set if nothing is missing.

    Args:
        files: text files or workbooks, in any order.
        request: options, and statements that the files do not contain.
        robot: robot that was measured; if given, the set is inspected for mistakes.
        other_robots: robots that may have been measured instead; None takes the arms of the catalogue.

    Raises:
        ImportRefusedError: something in the files is not understood, contradictory or ambiguous, and the
            request does not have `show_faults`.
    """
    understood = understand_files(files, request, () if robot is None else robot.joint_names)
    faults, first_file = list(understood.faults), files[0].name if files else ""
    bodies: list[Body] = []
    try:
        bodies = _name_joints_of_bodies(understood.bodies, robot)
    except ImportFileError as fault:
        faults.append(fault)
    if understood.weight_step is not None:
        return ImportAnswer(
            **dict(understood.preview),
            missing=[],
            leave_out=[],
            measurement_set=None,
            weight_step=understood.weight_step,
        )
    # Readings without any load serve to identify by the robot's own weight, if the masses are known.
    is_by_own_weight = bool(bodies or (robot and robot.bodies)) and _is_unloaded(understood, request)
    unusual: list[str] = []
    if not faults and not request.accept_unusual:
        unusual = _describe_unusual_values(understood, request)[:MAX_PREVIEW_ROWS]
    missing = (
        {} if faults else _list_missing_fields(understood, request, unusual, own_weight=is_by_own_weight)
    )
    document, findings, template, geometry = None, None, None, None
    if not faults and not missing:
        try:
            document = _build_measurement_set(understood, request, first_file, own_weight=is_by_own_weight)
            findings = None if robot is None else _inspect_set(document, robot, other_robots)
            template = _build_template(understood, request)
        except ImportFileError as fault:
            document = None
            faults.append(fault)
    # A geometry needs only unloaded poses: forces, load point and encoders may be missing.
    lacks_for_geometry = {"joints", "accept_unusual"} & missing.keys()
    if not faults and understood.preview.states == ["unloaded"] and not lacks_for_geometry:
        geometry = _build_geometry_request(understood, request, first_file)
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
        unusual=unusual,
        bodies=bodies,
        leave_out=[observation.label for observation in understood.observations if observation.held_out],
        measurement_set=document,
        findings=findings,
        template=template,
        geometry=geometry,
    )


def _is_unloaded(understood: Understood, request: ImportRequest) -> bool:
    """Return whether all positions were read without load, and no force is stated in files or request."""
    forces = (observation.vector("force") or () for observation in understood.observations)
    return understood.preview.states == ["unloaded"] and request.force is None and not any(map(any, forces))


def _name_joints_of_bodies(bodies: Sequence[Body], robot: Robot | None) -> list[Body]:
    """Return the bodies, with names of joints in place of numbers of joints such as `2`, `J2` or `axis 2`.

    The names are those of the robot; without a robot, joint 2 gets the name `joint_2`.

    Raises:
        ImportFileError: the robot has no such joint.
    """
    bodies_with_names = []
    for body in bodies:
        number = joint_number(body.joint)  # None if the text is no joint number
        joint = body.joint
        if robot is None:
            joint = f"joint_{number}" if number else joint
        elif joint not in robot.joint_names:
            if number is None or number > len(robot.joint_names):
                names = ", ".join(robot.joint_names)
                reason = f"the robot has no joint '{joint}', which carries '{body.name}'"
                raise ImportFileError(NOWHERE, reason, f"use one of {names}")
            joint = robot.joint_names[number - 1]
        bodies_with_names.append(body.model_copy(update={"joint": joint}))
    return bodies_with_names


def _list_missing_fields(
    understood: Understood, request: ImportRequest, unusual: Sequence[str], *, own_weight: bool
) -> dict[MissingField, str]:
    """Return field → description for people, for the fields that a measurement set still needs.

    `unusual` has the values that a person must confirm. With `own_weight` the robot's own weight is the load:
    no force and no loaded positions are needed then.
    """
    first_observation, states = understood.observations[0], understood.preview.states
    confirmation = f"a confirmation (`accept_unusual`) that these values are correct: {'; '.join(unusual)}"
    force_is_stated = request.force is not None
    force_unit = None if request.units is None else request.units.force
    joints = "joint angles of each observation: columns `J1 [deg]`, `J2 [deg]`, … (lengths as `J3 [mm]`)"
    forces = "the force of each observation: columns `Fx [N]`, `Fy [N]`, `Fz [N]`, or one `force`"
    readings = "readings: columns such as `P10 unloaded x [mm]`, or lists of points"
    places = "the targets' positions in the flange frame (`flange_targets`), for deflections"
    lacks_places = not set(understood.places.values()) <= set(request.flange_targets)
    loaded = "the positions under load"
    if first_observation.vector("joint") is not None:
        loaded += ", or the robot's masses (`bodies`, or a table of masses), for its own weight"
    has_point = (
        first_observation.vector("load point") is not None
        or request.load_point is not None
        or request.load_point_target is not None
    )
    has_force = first_observation.vector("force") is not None or force_is_stated
    encoders = "the encoders that close the position loop (`encoders`): motor or secondary"
    lacks_force_unit = force_is_stated and "force" not in understood.units and force_unit is None
    # (True if the field is missing, name of the field, description)
    needed_fields: list[tuple[bool, MissingField, str]] = [
        (first_observation.vector("joint") is None, "joints", joints),
        (not has_force and not own_weight, "force", forces),
        (not states, "readings", readings),
        (states == ["unloaded"] and not own_weight, "loaded", loaded),
        (states == ["loaded"], "unloaded", "the positions without load"),
        (lacks_places, "flange_targets", places),
        (
            not has_point and not own_weight,
            "load_point",
            "the load point (`load_point`), in the flange frame, or the target at the hook "
            "(`load_point_target`)",
        ),
        (bool(unusual), "accept_unusual", confirmation),
        (lacks_force_unit, "units.force", "the unit of `force` (`units`): N, kN, kgf or lbf"),
        (request.encoders is None, "encoders", encoders),
    ]
    return {field: text for is_missing, field, text in needed_fields if is_missing}


def _describe_unusual_values(understood: Understood, request: ImportRequest) -> list[str]:
    """Describe in sentences the values that a person must confirm.

    These are numbers far from all others of their column, and a load point far from the flange.
    """
    unit_of_request, unit_of_files = _length_units(understood, request)
    points_in_files = [
        point for observation in understood.observations if (point := observation.vector("load point"))
    ]
    distances = [
        hypot(*_convert_lengths(point, unit_of_files, "m", "load_point")) for point in points_in_files
    ]
    if request.load_point is not None:
        distances.append(hypot(*_convert_lengths(request.load_point, unit_of_request, "m", "load_point")))
    greatest = max(distances, default=0.0)  # [m]
    far_point = (
        [f"the load point is {greatest:g} m from the flange (up to {FAR_POINT:g} m is plausible)"]
        if greatest > FAR_POINT
        else []
    )
    return [*far_point, *understood.unusual]


def _inspect_set(
    document: MeasurementSetDocument, robot: Robot, other_robots: Iterable[KnownRobot] | None
) -> list[Finding]:
    """Check a set against its robot and return the findings.

    If a length in the flange frame seems to have a wrong unit, the remedy names the fields that hold such
    lengths.

    Args:
        document: measurement set.
        robot: robot of the set.
        other_robots: robots that may have been measured by mistake; None takes the arms of the catalogue.

    Raises:
        ImportFileError: the readings cannot be those of the robot.
    """
    from jointstiff.service.conversion.prepared import check_set
    from jointstiff.service.resources.known_robots import catalogue_robots

    try:
        known_robots = catalogue_robots() if other_robots is None else other_robots
        flange_fields = [name for name in ("load_point", "flange_targets") if getattr(document, name)]
        return check_set(document, robot, None, [], known_robots, flange_fields=flange_fields).warnings
    except MeasurementError as error:
        where = f" ({error.where})" if error.where else ""
        reason = f"the readings do not fit the robot{where}: {error.reason}"
        raise ImportFileError(NOWHERE, reason, error.remedy or "check robot and readings") from error


# ---- lengths of the request, in the files' unit


def _length_units(understood: Understood, request: ImportRequest) -> tuple[str, str]:
    """Return (unit of length of the request, unit of length of the files).

    A request without `length_unit` has the unit of the files.
    """
    unit_of_files = understood.units.get("length", "mm")
    return request.length_unit or unit_of_files, unit_of_files


def _convert_lengths(value: Any, old_unit: str, new_unit: str, name: str = "") -> Any:  # noqa: ANN401 - JSON
    """Convert the lengths in a part of the request from one unit to the other, m or mm.

    Args:
        value: the part: a number, or nested lists and dictionaries.
        old_unit: unit of the lengths in `value`.
        new_unit: unit of the lengths in the returned part.
        name: field that holds the part; numbers of fields that are not in `_LENGTHS` are not converted, nor
            are texts.
    """
    if isinstance(value, dict):
        return {key: _convert_lengths(item, old_unit, new_unit, key) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return tuple(_convert_lengths(item, old_unit, new_unit, name) for item in value)
    is_length = name in _LENGTHS and isinstance(value, int | float)
    if old_unit == new_unit or not is_length:
        return value
    return value / 1e3 if new_unit == "m" else value * 1e3


# ---- results made from the files


def _choose_name(request: ImportRequest, first_file: str) -> str:
    """Return the name of the set: from the request, else the name of the first file without its ending."""
    stem = "".join(character for character in PurePath(first_file).stem if character.isprintable())
    return request.name or stem.strip()[:MAX_NAME_LENGTH].strip() or "readings"


def _build_measurement_set(
    understood: Understood, request: ImportRequest, first_file: str, *, own_weight: bool
) -> MeasurementSetDocument:
    """Return the measurement set of the files; with `own_weight` its forces are zero.

    `first_file` is the name of the first file, which names the set if the request does not.

    Raises:
        ImportFileError: files and request state the same thing twice, or the set exceeds a limit.
    """
    noise, places = request.noise, understood.places
    noise_is_stated = noise is not None and (noise.sigma is not None or noise.instrument)
    # A gauge measures along one axis: its target names place and axis, so that it differs from its place.
    has_gauges = any(target != place for target, place in places.items())
    if understood.preview.uncertainty and noise_is_stated and not has_gauges:
        reason = "the files give the uncertainty of each reading, and `noise` states another uncertainty"
        remedy = "omit `noise`, or skip the columns of U(95) with `ignore`"
        raise ImportFileError(NOWHERE, reason, remedy, "noise")
    if request.force is not None and "force" in understood.units:
        reason = "the files have forces, and `force` states another force"
        raise ImportFileError(NOWHERE, reason, "omit `force`", "force")
    force = (0.0, 0.0, 0.0) if own_weight else request.force
    # The set is in the unit of the files: the lengths of the request are converted.
    old_unit, new_unit = _length_units(understood, request)
    lengths = _convert_lengths(
        request.model_dump(include={"noise", "load_point"}, exclude_unset=True), old_unit, new_unit
    )
    # Target → key of its place in `flange_targets`: its own name, or that of the place of a gauge.
    place_of_target = {**{name: name for name in request.flange_targets}, **places}
    try:
        return MeasurementSetDocument.model_validate(
            {
                "name": _choose_name(request, first_file),
                "units": {
                    "force": (request.units and request.units.force) or ("N" if own_weight else None),
                    **understood.units,
                },
                "encoders": request.encoders,
                "joint_kinds": understood.preview.joint_kinds,
                "noise": lengths.get("noise") or None,
                "flange_targets": {
                    target: _convert_lengths(request.flange_targets[place], old_unit, new_unit, "load_point")
                    for target, place in place_of_target.items()
                },
                "load_point": lengths.get("load_point"),
                "load_point_target": request.load_point_target,
                "measured_at": understood.times_and_roundings.measured_at,
                "observations": [_build_observation(record, force) for record in understood.observations],
            }
        )
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
        path = ".".join(map(str, fault["loc"]))
        reason = f"the readings do not make a valid measurement set: {path} {reword_fault(fault)}"
        raise ImportFileError(NOWHERE, reason, "check the limits of measurement sets") from error


def _build_observation(record: ObservationRecord, force: Vector3 | None) -> Observation:
    """Return an observation from the values gathered in the files; `force` is used if they have no force."""

    def vector(kind: Kind) -> Vector3 | None:
        """Return the vector of a kind, such as `moment`; None if the files have none."""
        return cast("Vector3 | None", record.vector(kind))

    return Observation(
        label=record.label,
        joints=list(record.vector("joint") or ()),
        force=cast(Vector3, vector("force") or force),
        moment=vector("moment"),
        load_point=vector("load point"),
        readings=[_build_reading(record, target) for target in record.points],
    )


def _build_reading(record: ObservationRecord, target: str) -> Reading:
    """Return the reading of a target in an observation.

    Uncertainties of single coordinates become covariances. Uncertainties of whole points become one sigma for
    all positions of the reading, their root mean square.
    """
    gauge = record.values.get(Quantity("along", target, "deflection"))
    if gauge is not None:
        gauge_axis = split_along_target(target)[1]
        direction = tuple(float(axis == gauge_axis) for axis in range(3))
        displacement = None if gauge.vector is None else gauge.vector[0]
        reading = {"target": target, "displacement": displacement, "direction": direction}
        return Reading.model_validate(reading)
    points = {state: point for state, point in record.points[target].items() if point.vector is not None}
    fields: dict[str, object] = {state: point.vector for state, point in points.items()}
    sigmas = {state: point.sigma for state, point in points.items() if point.sigma is not None}
    if sigmas and all(point.by_point for point in points.values()):
        fields["sigma"] = sqrt(sum(sigma[0] ** 2 for sigma in sigmas.values()) / len(sigmas))
    elif sigmas:
        for state, sigma in sigmas.items():
            if state == "unloaded_after":  # as uncertain as the first position without load
                continue
            covariance = [
                [sigma[row] ** 2 if row == column else 0.0 for column in range(3)] for row in range(3)
            ]
            fields[f"{state}_covariance"] = covariance
    return Reading.model_validate({"target": target, **fields})


def _build_geometry_request(
    understood: Understood, request: ImportRequest, first_file: str
) -> GeometryRequest | None:
    """Return a request to identify a geometry from the unloaded poses of the files.

    None if there are more readings or targets than a geometry accepts.
    """
    unit_of_request, unit_of_files = _length_units(understood, request)
    readings = [
        states["unloaded"]
        for observation in understood.observations
        for states in observation.points.values()
    ]
    if len(readings) > MAX_GEOMETRY_READINGS or len(understood.preview.targets) > MAX_GEOMETRY_TARGETS:
        return None
    sigma = None
    if request.noise is not None:
        sigma = _convert_lengths(request.noise.sigma, unit_of_request, unit_of_files, "sigma")
    squares = [value**2 for point in readings for value in point.sigma or ()]
    if sigma is None and squares:
        sigma = sqrt(sum(squares) / len(squares))  # a geometry has one sigma for all readings
    poses = []
    for observation in understood.observations:
        positions = {target: states["unloaded"].vector for target, states in observation.points.items()}
        read_targets = {target: position for target, position in positions.items() if position}
        if read_targets:
            poses.append({"joints": list(observation.vector("joint") or ()), "targets": read_targets})
    return GeometryRequest.model_validate(
        {
            "name": _choose_name(request, first_file),
            "units": {"length": unit_of_files, "angle": understood.units.get("angle")},
            "noise": None if sigma is None else {"sigma": sigma},
            "poses": poses,
        }
    )


def _build_template(understood: Understood, request: ImportRequest) -> ImportRequest | None:
    """Return import options that accept files with the same columns and refuse other files.

    None if the files have more columns, or longer headers, than options can hold.
    """
    files: list[FilePreview] = understood.preview.files
    text_files = [file for file in files if file.format == "text"]
    delimiters = {file.delimiter for file in text_files}
    decimal_marks = {file.decimal_mark for file in text_files}
    columns = [column for file in files for column in file.columns]
    has_inches = any(column.unit == "in" for column in columns)
    stated_units = {} if request.units is None else request.units.model_dump(exclude_none=True)
    layouts = {tuple(column.header for column in file.columns): None for file in files}
    changes = {
        "units": {**stated_units, **understood.units, **({"length": "in"} if has_inches else {})},
        "columns": {
            column.header: column.meaning + (f" [{column.unit}]" if column.unit else "")
            for column in columns
            if column.header
        },
        "layouts": [list(layout) for layout in layouts],
        "ignore": [],
        # Files that differ are detected anew.
        "delimiter": delimiters.pop() if len(delimiters) == 1 else None,
        "decimal_mark": decimal_marks.pop() if len(decimal_marks) == 1 else None,
        "length_unit": _length_units(understood, request)[0],
        "name": None,
        "robot_id": None,
        "show_faults": False,
        "accept_unusual": False,  # the values of another file must be confirmed again
    }
    try:
        return ImportRequest.model_validate(request.model_dump() | changes)
    except ValidationError:
        return None
