"""Import files of readings: return a preview and a measurement set or poses. Nothing is stored."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot, sqrt
from pathlib import PurePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar, cast

from pydantic import ValidationError

from jointstiff.schemas.fields import FAR_POINT, MAX_NAME_LENGTH, Vector3
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.geometry import MAX_GEOMETRY_READINGS, MAX_GEOMETRY_TARGETS, GeometryRequest
from jointstiff.schemas.imports import (
    MAX_PREVIEW_ROWS,
    ColumnMeaning,
    ImportAnswer,
    ImportFault,
    ImportRequest,
    MissingField,
    State,
)
from jointstiff.schemas.measurement import MeasurementSetDocument, Observation, Reading
from jointstiff.schemas.robot import Body
from jointstiff.service.importing.errors import NOWHERE, ImportFileError, Place
from jointstiff.service.importing.grammar import (
    CONVERTED_UNITS,
    Kind,
    Quantity,
    UnitOfReadings,
    find_known_unit,
    find_unit_of_readings,
    joint_number,
    split_along_target,
)
from jointstiff.service.importing.legends import find_legend
from jointstiff.service.importing.posture_files import join_posture_files
from jointstiff.service.importing.reading import Understood, understand_files
from jointstiff.service.importing.rows import ObservationRecord, Value
from jointstiff.service.importing.source_files import SourceFile, find_copy
from jointstiff.service.importing.stated_loads import describe_stated_loads, find_stated_loads
from jointstiff.service.problems import FilesError, reword_fault
from jointstiff.solver.errors import MeasurementError

if TYPE_CHECKING:
    from jointstiff.solver.mechanics.robot import KnownRobot, Robot

T = TypeVar("T")
_MAX_PLACES: Final = 3
"""Further places named for equal faults."""
_LENGTHS: Final = frozenset(
    ("sigma", "station", "constant", "load_point", "target_places", "drift", "position")
)
"""Fields of the request, and of its `noise`, that hold lengths."""


class ImportRefusedError(FilesError):
    """Files that were not understood, so that nothing is imported."""

    def __init__(self, faults: Sequence[ImportFileError]) -> None:
        self.faults = tuple(faults)  # the faults that were found, in the order of the files
        items = [_describe_equal_faults(equal) for equal in _group_equal_faults(self.faults)]
        where, reason, remedy = items[0]
        super().__init__(reason, remedy=remedy, where=where, items=items)


def _group_equal_faults(faults: Sequence[ImportFileError]) -> list[list[ImportFileError]]:
    """Return the faults with the same reason and remedy in one file as a group, in the order of the first."""
    groups = dict[tuple[str | None, str, str], list[ImportFileError]]()
    for fault in faults:
        groups.setdefault((fault.place.file, fault.reason, fault.remedy), []).append(fault)
    return list(groups.values())


def _describe_equal_faults(faults: Sequence[ImportFileError]) -> tuple[str, str, str]:
    """Return place, reason and remedy of equal faults of a file; the reason has the places of the others."""
    first, *others = faults
    reason = first.reason
    if others:
        shown = [_place_text(fault.place._replace(file=None)) for fault in others[:_MAX_PLACES]]
        reason += f"; the same at {', '.join(shown)}"
    if len(others) > _MAX_PLACES:
        reason += f" and in {len(others) - _MAX_PLACES} more places"
    return _place_text(first.place), reason, first.remedy


def _place_text(place: Place) -> str:
    """Return a place as `file:line:column`, without unknown parts; `files` if nothing is known."""
    return ":".join(str(part) for part in place if part is not None) or "files"


@dataclass(frozen=True)
class _StatedReadings:
    """Readings of files without faults, with what a request states about them."""

    understood: Understood  # readings of the files
    request: ImportRequest  # statements that the files do not contain
    first_file: str  # name of the first file
    by_own_weight: bool  # whether the robot's own weight is the load: no force, no loaded positions needed

    @property
    def name(self) -> str:
        """Name of the set: from the request, else the name of the first file without its ending."""
        stem = "".join(letter for letter in PurePath(self.first_file).stem if letter.isprintable())
        return self.request.name or stem.strip()[:MAX_NAME_LENGTH].strip() or "readings"

    @property
    def unit_of_files(self) -> str:
        """Unit of length of the files: m or mm."""
        return self.understood.units.get("length", "mm")

    @property
    def unit_of_request(self) -> str:
        """Unit of the lengths in the request: the unit of the files unless `length_unit` states another."""
        return self.request.length_unit or self.unit_of_files

    @property
    def header_units(self) -> Collection[str]:
        """Quantities, such as length, whose units the files state, and the request does not."""
        stated = {} if self.request.units is None else self.request.units.model_dump(exclude_none=True)
        return self.understood.units.keys() - stated.keys()

    @property
    def force(self) -> Vector3 | None:
        """Force of observations whose files have none, in the unit of the readings; None if not stated.

        If the robot's own weight is the load, all forces are zero.
        """
        stated = self.request.force
        if self.by_own_weight:
            return (0.0, 0.0, 0.0)
        if stated is None or self.stated_unit_of_force is None:
            return stated
        x, y, z = (self.stated_unit_of_force.factor * each for each in stated)
        return x, y, z

    @property
    def stated_unit_of_force(self) -> UnitOfReadings | None:
        """Unit of the readings by the unit of forces in the request; None if not stated."""
        unit = None if self.request.units is None else self.request.units.force
        return None if unit is None else find_unit_of_readings(unit)

    def first_has(self, kind: Kind) -> bool:
        """Return whether the first observation has numbers of a kind, such as `joint` or `load point`."""
        return self.understood.observations[0].vector(kind) is not None

    def convert_to_files(self, value: Any, field: str = "") -> Any:  # noqa: ANN401 - JSON
        """Return a part of the request with its lengths in the unit of the files; `field` is its name."""
        return _convert_lengths(value, self.unit_of_request, self.unit_of_files, field)


@dataclass(frozen=True)
class _Results:
    """Results of files without faults; all fields are empty if the files have faults."""

    unusual: list[str] = field(default_factory=list)  # values that a person must confirm, in sentences
    missing: dict[MissingField, str] = field(default_factory=dict)  # missing field → its description
    document: MeasurementSetDocument | None = None  # None if a field is missing
    findings: list[Finding] | None = None  # None without a robot or without a document
    template: ImportRequest | None = None  # options that accept further files of this form
    geometry: GeometryRequest | None = None  # unloaded poses for a geometry


class ForceHints(NamedTuple):
    """Evidence of a proposal for the force of files."""

    likely: str = ""  # end of a sentence on columns that may be the load
    turned: str = ""  # `stated` turned from axes of the positions into R0, as `0,800,0N`
    stated: tuple[float, float, float] | None = None  # force along which, turned, the targets clearly move


NO_HINTS: Final = ForceHints()


def describe_turned_force(turned: str) -> str:
    """Return what to state if a force was stated in axes of the positions; `turned` is in axes of R0."""
    return f"if `force` is in axes of the positions of the files, `force` in axes of R0 is {turned}"


def import_files(
    files: Sequence[SourceFile],
    request: ImportRequest,
    robot: Robot | None = None,
    other_robots: Iterable[KnownRobot] | None = None,
    originals: Sequence[SourceFile] = (),
    hints: ForceHints = NO_HINTS,
) -> ImportAnswer:
    """Read files of readings; return a preview, and a measurement set if nothing is missing.

    Args:
        files: text files or workbooks, in any order.
        request: options, and statements that the files do not contain.
        robot: robot that was measured; if given, the set is inspected for mistakes.
        other_robots: robots that may have been measured instead; None takes the arms of the catalogue.
        originals: files as they were sent, if `files` were written from these.
        hints: what a proposal shows of the force.

    Raises:
        ImportRefusedError: something in the files is not understood, contradictory or ambiguous, and the
            request does not have `show_faults`.
    """
    understood = _understand_with_legend(files, request, () if robot is None else robot.joint_names)
    if understood.weight_step is not None:
        return _answer_weight_step(understood)
    faults = list(understood.faults)
    bodies: list[Body] = []
    results = _Results()
    try:
        bodies = _name_joints_of_bodies(understood.bodies, robot)
        if not faults:
            by_own_weight = _is_loaded_by_own_weight(understood, request, bodies, robot)
            readings = _StatedReadings(understood, request, files[0].name, by_own_weight)
            results = _make_results(readings, robot, other_robots)
            if "force" in results.missing:
                results.missing["force"] += hints.likely or _describe_likely_force(originals or files)
    except ImportFileError as fault:
        faults.append(fault)
    if faults and not request.show_faults:
        raise ImportRefusedError(faults)
    answer = _build_answer(understood, faults, bodies, results)
    if answer.findings is None or not hints.turned or hints.stated != request.force:
        return answer
    findings = [_add_turned_force(finding, hints.turned) for finding in answer.findings]
    return answer.model_copy(update={"findings": findings})


def _add_turned_force(finding: Finding, turned: str) -> Finding:
    """Return a finding on the axes of forces, with the stated force in axes of R0; others are unchanged."""
    if finding.code != "frame_mistaken":
        return finding
    return finding.model_copy(update={"remedy": f"{describe_turned_force(turned)}; {finding.remedy}"})


def _understand_with_legend(
    files: Sequence[SourceFile], request: ImportRequest, joints: Sequence[str]
) -> Understood:
    """Read files, with the states that a legend in them gives the words in question.

    The legend counts only if nothing else is in question. `joints` are the names of the robot's joints.
    """
    understood = understand_files(files, request, joints)
    words = dict.fromkeys(word for fault in understood.faults for word in fault.words)
    if any(fault.option != "state_words" for fault in understood.faults) or not words:
        return understood
    legend = find_legend(files, tuple(words))
    if legend is None:
        return understood
    state_words = {**request.state_words, **legend.states}
    stated = understand_files(files, request.model_copy(update={"state_words": state_words}), joints)
    if stated.faults:
        return understood
    assumptions = [*stated.preview.assumptions, legend.note]
    return replace(stated, preview=stated.preview.model_copy(update={"assumptions": assumptions}))


def _describe_likely_force(files: Sequence[SourceFile]) -> str:
    """Return the end of a sentence on the loads that files state in words; empty without such loads."""
    sentence = describe_stated_loads(find_stated_loads(files))
    return f"; {sentence}" if sentence else ""


def lack_meaning(files: Sequence[SourceFile], request: ImportRequest, robot: Robot | None) -> bool:
    """Return whether headers of refused files leave columns unexplained, so that a robot may explain them.

    Where names explain all columns, the faults are those of cells or rows, which no meaning removes; nor does
    one explain why a file was sent twice. Files of one posture each are joined for the robot only.
    """
    if len(join_posture_files(files, request)) < len(files):
        return True
    if find_copy(files) is not None:
        return False
    joints = () if robot is None else robot.joint_names
    return not understand_files(files, request, joints).are_columns_named


def _answer_weight_step(understood: Understood) -> ImportAnswer:
    """Return the answer for a table of a weight step, which has readings of encoders and no positions."""
    return ImportAnswer(
        **dict(understood.preview),
        missing=[],
        leave_out=[],
        measurement_set=None,
        weight_step=understood.weight_step,
    )


def _build_answer(
    understood: Understood, faults: Sequence[ImportFileError], bodies: list[Body], results: _Results
) -> ImportAnswer:
    """Return the message for the preview of files, their faults, and the results made from them."""
    return ImportAnswer(
        **dict(understood.preview),
        faults=[_build_fault_message(fault) for fault in faults],
        missing_fields=list(results.missing),
        missing=list(results.missing.values()),
        unusual=results.unusual,
        bodies=bodies,
        leave_out=[observation.label for observation in understood.observations if observation.held_out],
        measurement_set=results.document,
        findings=results.findings,
        template=results.template,
        geometry=results.geometry,
    )


def _build_fault_message(fault: ImportFileError) -> ImportFault:
    """Return the message for a fault: file, line and column, reason, remedy, and the option that helps."""
    return ImportFault(
        **fault.place._asdict(),
        reason=fault.reason,
        remedy=fault.remedy,
        option=fault.option,
        words=list(fault.words),
    )


def _make_results(
    readings: _StatedReadings, robot: Robot | None, other_robots: Iterable[KnownRobot] | None
) -> _Results:
    """Return what the readings are good for: a measurement set, a geometry, or only a list of missing fields.

    Args:
        readings: readings of files without faults.
        robot: robot that was measured; if given, the set is inspected for mistakes.
        other_robots: robots that may have been measured instead; None takes the arms of the catalogue.

    Raises:
        ImportFileError: request and files contradict each other, or the readings do not fit the robot.
    """
    unusual: list[str] = []
    if not readings.request.accept_unusual:
        unusual = _describe_unusual_values(readings)[:MAX_PREVIEW_ROWS]
    results = _Results(unusual, _list_missing_fields(readings, unusual))
    if not results.missing:
        document = _build_measurement_set(readings)
        findings = None if robot is None else _inspect_set(document, readings, robot, other_robots)
        template = _build_template(readings)
        results = replace(results, document=document, findings=findings, template=template)
    if _has_geometry(readings, results.missing):
        results = replace(results, geometry=_build_geometry_request(readings))
    return results


def _has_geometry(readings: _StatedReadings, missing: Collection[MissingField]) -> bool:
    """Return whether the readings are unloaded poses, from which the geometry of a robot can be identified.

    A geometry needs only unloaded poses: forces, load point and encoders may be missing.
    """
    lacks_poses = "joints" in missing or "accept_unusual" in missing
    return readings.understood.preview.states == ["unloaded"] and not lacks_poses


def _is_loaded_by_own_weight(
    understood: Understood, request: ImportRequest, bodies: Sequence[Body], robot: Robot | None
) -> bool:
    """Return whether the robot's own weight is the only load of the readings.

    Readings without any load serve to identify by the robot's own weight, if the masses are known: from the
    files (`bodies`) or from the robot.
    """
    has_masses = bool(bodies) or (robot is not None and bool(robot.bodies))
    if not has_masses or understood.preview.states != ["unloaded"] or request.force is not None:
        return False
    forces = (observation.vector("force") or () for observation in understood.observations)
    return not any(any(force) for force in forces)


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


def _list_missing_fields(readings: _StatedReadings, unusual: Sequence[str]) -> dict[MissingField, str]:
    """Return field → description for people, for the fields that a measurement set still needs.

    `unusual` has the values that a person must confirm. Only the first observation is looked at, because
    earlier checks have refused files whose observations have different quantities.
    """
    request, states = readings.request, readings.understood.preview.states
    needs_load = not readings.by_own_weight
    is_missing: dict[MissingField, bool] = {
        "joints": not readings.first_has("joint"),
        "force": needs_load and not (readings.first_has("force") or request.force is not None),
        "readings": not states,
        "loaded": needs_load and states == ["unloaded"],
        "unloaded": states == ["loaded"],
        "flange_targets": not set(readings.understood.places.values()) <= set(request.flange_targets),
        "load_point": needs_load and not _has_load_point(readings),
        "accept_unusual": bool(unusual),
        "units.force": _lacks_unit_of_force(readings),
        "encoders": request.encoders is None,
    }
    missing_fields = [name for name in is_missing if is_missing[name]]
    return {name: _describe_missing_field(name, readings, unusual) for name in missing_fields}


def _has_load_point(readings: _StatedReadings) -> bool:
    """Return whether files or request state the load point, or the target whose readings show it."""
    request = readings.request
    is_stated = request.load_point is not None or request.load_point_target is not None
    return is_stated or readings.first_has("load point")


def _lacks_unit_of_force(readings: _StatedReadings) -> bool:
    """Return whether the request states a force whose unit neither the files nor the request give."""
    is_stated = readings.stated_unit_of_force is not None or "force" in readings.understood.units
    return readings.request.force is not None and not is_stated


_DESCRIPTIONS: Final[Mapping[MissingField, str]] = MappingProxyType(
    {
        "joints": (
            "joint angles of each observation: columns `J1 [deg]`, `J2 [deg]`, … (lengths as `J3 [mm]`)"
        ),
        "force": (
            "the force of each observation in axes of R0: columns `Fx [N]`, `Fy [N]`, `Fz [N]`, or one "
            "`force` (N, daN, kN, kgf, lbf)"
        ),
        "readings": "readings: columns such as `P10 unloaded x [mm]`, or lists of points",
        "loaded": "the positions under load",
        "unloaded": "the positions without load",
        "flange_targets": "the targets' positions in the flange frame (`flange_targets`), for deflections",
        "load_point": (
            "the load point (`load_point`), in the flange frame, or the target at the hook "
            "(`load_point_target`)"
        ),
        "accept_unusual": "a confirmation (`accept_unusual`) that these values are correct: ",
        "units.force": "the unit of `force` (`units`): N, daN, kN, kgf or lbf",
        "encoders": "the encoders that close the position loop (`encoders`): motor or secondary",
    }
)
"""Descriptions of missing fields; those of `loaded` and `accept_unusual` may continue."""


def _describe_missing_field(name: MissingField, readings: _StatedReadings, unusual: Sequence[str]) -> str:
    """Return the description of a missing field; `unusual` has the values that a person must confirm.

    Loaded positions are not needed if the masses of the robot are known: its own weight then is the load.
    """
    text = _DESCRIPTIONS[name]
    if name == "accept_unusual":
        return text + "; ".join(unusual)
    if name == "loaded" and readings.first_has("joint"):
        return f"{text}, or the robot's masses (`bodies`, or a table of masses), for its own weight"
    return text


def _describe_unusual_values(readings: _StatedReadings) -> list[str]:
    """Describe in sentences the values that a person must confirm.

    These are numbers far from all others of their column, and a load point far from the flange.
    """
    distance = _find_farthest_load_point(readings)
    if distance <= FAR_POINT:
        return [*readings.understood.unusual]
    far_point = f"the load point is {distance:g} m from the flange (up to {FAR_POINT:g} m is plausible)"
    return [far_point, *readings.understood.unusual]


def _find_farthest_load_point(readings: _StatedReadings) -> float:
    """Return the greatest distance of a load point from the flange [m]; 0 without load points."""
    points = [observation.vector("load point") for observation in readings.understood.observations]
    in_metres = [
        _convert_lengths(point, readings.unit_of_files, "m", "load_point") for point in points if point
    ]
    stated = readings.request.load_point
    if stated is not None:
        in_metres.append(_convert_lengths(stated, readings.unit_of_request, "m", "load_point"))
    return max((hypot(*point) for point in in_metres), default=0.0)


def _inspect_set(
    document: MeasurementSetDocument,
    readings: _StatedReadings,
    robot: Robot,
    other_robots: Iterable[KnownRobot] | None,
) -> list[Finding]:
    """Check a set against its robot and return the findings.

    If a length in the flange frame seems to have a wrong unit, the remedy names the fields that hold such
    lengths. For other wrong units the remedy names the headers, unless the request states the unit.

    Args:
        document: measurement set of the readings.
        readings: readings of the files.
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
        return check_set(
            document,
            robot,
            None,
            [],
            known_robots,
            flange_fields=flange_fields,
            header_units=readings.header_units,
        ).warnings
    except MeasurementError as error:
        where = f" ({error.where})" if error.where else ""
        reason = f"the readings do not fit the robot{where}: {error.reason}"
        raise ImportFileError(NOWHERE, reason, error.remedy or "check robot and readings") from error


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


def _build_measurement_set(readings: _StatedReadings) -> MeasurementSetDocument:
    """Return the measurement set of the files, in the units of the files.

    Raises:
        ImportFileError: files and request state the same thing twice, or the set exceeds a limit.
    """
    _refuse_two_uncertainties(readings)
    _refuse_two_forces(readings)
    try:
        return MeasurementSetDocument.model_validate(_list_set_fields(readings))
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
        path = ".".join(map(str, fault["loc"]))
        reason = f"the readings do not make a valid measurement set: {path} {reword_fault(fault)}"
        raise ImportFileError(NOWHERE, reason, "check the limits of measurement sets") from error


def _refuse_two_uncertainties(readings: _StatedReadings) -> None:
    """Refuse an uncertainty of readings that both files and request state, except in sets with gauges.

    With gauges, `noise` is the uncertainty of the gauges. A gauge measures along one axis: its target names
    place and axis (`P1 x`), so that it differs from its place (`P1`).

    Raises:
        ImportFileError: both state an uncertainty of the positions.
    """
    noise = readings.request.noise
    is_stated = noise is not None and (noise.sigma is not None or noise.instrument)
    if not is_stated or not readings.understood.preview.uncertainty:
        return
    has_gauges = any(target != place for target, place in readings.understood.places.items())
    if not has_gauges:
        reason = "the files give the uncertainty of each reading, and `noise` states another uncertainty"
        remedy = "omit `noise`, or skip the columns of U(95) with `ignore`"
        raise ImportFileError(NOWHERE, reason, remedy, "noise")


def _refuse_two_forces(readings: _StatedReadings) -> None:
    """Raise an `ImportFileError` if both files and request state the force."""
    if readings.request.force is not None and "force" in readings.understood.units:
        reason = "the files have forces, and `force` states another force"
        raise ImportFileError(NOWHERE, reason, "omit `force`", "force")


def _list_set_fields(readings: _StatedReadings) -> dict[str, object]:
    """Return field → value of the measurement set; lengths of the request get the unit of the files."""
    request, understood = readings.request, readings.understood
    stated = request.model_dump(include={"noise", "load_point"}, exclude_unset=True)
    lengths = readings.convert_to_files(stated)
    return {
        "name": readings.name,
        "units": _choose_units(readings),
        "encoders": request.encoders,
        "joint_kinds": understood.preview.joint_kinds,
        "noise": lengths.get("noise") or None,
        "flange_targets": _list_flange_targets(readings),
        "load_point": lengths.get("load_point"),
        "load_point_target": request.load_point_target,
        "measured_at": understood.times_and_roundings.measured_at,
        "observations": [_build_observation(each, readings.force) for each in understood.observations],
    }


def _choose_units(readings: _StatedReadings) -> dict[str, str | None]:
    """Return dimension → unit, such as `length` → `mm`; the unit of force is from the files or the request.

    If the robot's own weight is the load, all forces are zero, so that their unit does not matter: it is N.
    """
    stated = readings.stated_unit_of_force
    default = "N" if readings.by_own_weight else None
    return {"force": default if stated is None else stated.name, **readings.understood.units}


def _list_flange_targets(readings: _StatedReadings) -> dict[str, Vector3]:
    """Return target → position (3,) in the flange frame, in the unit of the files.

    The request states places. A target has the place of its own name; the target of a gauge, which measures
    along one axis, has the place at which the gauge was: `P1 x` → `P1`.
    """
    stated = readings.request.flange_targets
    place_of_target = {name: name for name in stated} | readings.understood.places
    return {
        target: readings.convert_to_files(stated[place], "load_point")
        for target, place in place_of_target.items()
    }


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
    """Return the reading of a target in an observation: of a gauge along one axis, or of positions."""
    gauge = record.values.get(Quantity("along", target, "deflection"))
    if gauge is not None:
        return _build_gauge_reading(target, gauge)
    states = record.points[target]
    points = {state: point for state, point in states.items() if point.vector is not None}
    vectors = {state: point.vector for state, point in points.items()}
    return Reading.model_validate({"target": target, **vectors, **_list_uncertainties(points)})


def _build_gauge_reading(target: str, gauge: Value) -> Reading:
    """Return the reading of a gauge, whose target names its axis: `P1 x` has the direction (1, 0, 0)."""
    gauge_axis = split_along_target(target)[1]
    direction = tuple(float(axis == gauge_axis) for axis in range(3))
    displacement = None if gauge.vector is None else gauge.vector[0]
    reading = {"target": target, "displacement": displacement, "direction": direction}
    return Reading.model_validate(reading)


def _list_uncertainties(points: Mapping[State, Value]) -> dict[str, object]:
    """Return field → value of the uncertainty of a reading; {} if its positions have none.

    Uncertainties of single coordinates become covariances. Uncertainties of whole points become one sigma for
    all positions of the reading, their root mean square. `points` has the position of each state.
    """
    sigmas = {state: point.sigma for state, point in points.items() if point.sigma is not None}
    if not sigmas:
        return {}
    if all(point.by_point for point in points.values()):
        squares = [sigma[0] ** 2 for sigma in sigmas.values()]
        return {"sigma": sqrt(sum(squares) / len(squares))}
    sigmas.pop("unloaded_after", None)  # as uncertain as the first position without load
    return {f"{state}_covariance": _build_covariance(sigma) for state, sigma in sigmas.items()}


def _build_covariance(sigma: Sequence[float]) -> list[list[float]]:
    """Return the covariance (3, 3) of a position whose coordinates have the uncertainties `sigma` (3,)."""
    covariance = [[0.0, 0.0, 0.0] for _ in range(3)]
    for axis in range(3):
        covariance[axis][axis] = sigma[axis] ** 2
    return covariance


def _build_geometry_request(readings: _StatedReadings) -> GeometryRequest | None:
    """Return a request to identify a geometry from the unloaded poses of the files.

    None if there are more readings or targets than a geometry accepts.
    """
    understood = readings.understood
    positions = [
        states["unloaded"]
        for observation in understood.observations
        for states in observation.points.values()
    ]
    has_many_targets = len(understood.preview.targets) > MAX_GEOMETRY_TARGETS
    if has_many_targets or len(positions) > MAX_GEOMETRY_READINGS:
        return None
    sigma = _choose_sigma(readings, positions)
    return GeometryRequest.model_validate(
        {
            "name": readings.name,
            "units": {"length": readings.unit_of_files, "angle": understood.units.get("angle")},
            "noise": None if sigma is None else {"sigma": sigma},
            "poses": _list_poses(understood.observations),
        }
    )


def _choose_sigma(readings: _StatedReadings, positions: Sequence[Value]) -> float | None:
    """Return the one sigma of all coordinates of a geometry, in the unit of the files; None if unknown.

    It is the sigma that the request states, else the root mean square of the positions' uncertainties.
    """
    noise = readings.request.noise
    stated: float | None = None if noise is None else readings.convert_to_files(noise.sigma, "sigma")
    if stated is not None:
        return stated
    squares = [value**2 for position in positions for value in position.sigma or ()]
    return sqrt(sum(squares) / len(squares)) if squares else None


def _list_poses(observations: Sequence[ObservationRecord]) -> list[dict[str, object]]:
    """Return the poses of a geometry: joint angles, and target → position, without targets not read."""
    poses: list[dict[str, object]] = []
    for observation in observations:
        positions = {target: states["unloaded"].vector for target, states in observation.points.items()}
        read_targets = {target: position for target, position in positions.items() if position}
        if read_targets:
            poses.append({"joints": list(observation.vector("joint") or ()), "targets": read_targets})
    return poses


def _build_template(readings: _StatedReadings) -> ImportRequest | None:
    """Return import options that accept files with the same columns and refuse other files.

    None if the files have more columns, or longer headers, than options can hold.
    """
    options = {
        **readings.request.model_dump(),
        **_list_table_options(readings),
        "length_unit": readings.unit_of_request,
        "ignore": [],
        "name": None,
        "robot_id": None,
        "show_faults": False,
        "accept_unusual": False,  # the values of another file must be confirmed again
    }
    try:
        return ImportRequest.model_validate(options)
    except ValidationError:
        return None


def _list_table_options(readings: _StatedReadings) -> dict[str, object]:
    """Return option → value for the options that say how the tables of the files were read."""
    files = readings.understood.preview.files
    columns = [column for file in files for column in file.columns]
    headers_of_files = [tuple(column.header for column in file.columns) for file in files]
    text_files = [file for file in files if file.format == "text"]
    return {
        "units": _list_units_of_columns(readings, columns),
        "columns": {column.header: _name_meaning(column) for column in columns if column.header},
        "layouts": [list(headers) for headers in dict.fromkeys(headers_of_files)],
        "delimiter": _find_common_value([file.delimiter for file in text_files]),
        "decimal_mark": _find_common_value([file.decimal_mark for file in text_files]),
    }


def _list_units_of_columns(readings: _StatedReadings, columns: Sequence[ColumnMeaning]) -> dict[str, str]:
    """Return dimension → unit of the numbers in the columns, as the request or the headers state them.

    Inches and daN were converted when the files were read, so only their columns still have these units.
    """
    units = readings.request.units
    stated: dict[str, str] = {} if units is None else units.model_dump(exclude_none=True)
    written: dict[str, str] = {}
    for column in columns:
        known = None if column.unit is None else find_known_unit(column.unit)
        if known is not None and column.unit in CONVERTED_UNITS:
            dimension, unit = known
            written[dimension] = unit
    return {**stated, **readings.understood.units, **written}


def _name_meaning(column: ColumnMeaning) -> str:
    """Return the meaning of a column with its unit, as in a header: `P1 unloaded x [mm]`."""
    return f"{column.meaning} [{column.unit}]" if column.unit else column.meaning


def _find_common_value(values: Iterable[T]) -> T | None:
    """Return the value that all files have; None if files differ, so that it is detected anew in each."""
    different = set(values)
    return different.pop() if len(different) == 1 else None
