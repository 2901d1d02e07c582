"""Imports: files in, a preview and the measurement set that they make out. Nothing is stored."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot
from typing import TYPE_CHECKING, NamedTuple

from pydantic import ValidationError

from jointstiff.schemas.fields import FAR_POINT
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.importing import MAX_PREVIEW_ROWS, FilePreview, ImportFault, MissingField
from jointstiff.schemas.imports import ImportAnswer, ImportRequest, ImportTemplate
from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.service.importing.errors import ImportFileError, Place
from jointstiff.service.importing.reading import Imported, SourceFile, understand_files
from jointstiff.service.problems.errors import FilesError
from jointstiff.service.resources.imported_messages import (
    converted,
    length_unit,
    measurement_set_of,
    poses_of,
)
from jointstiff.service.resources.imported_preview import preview_of
from jointstiff.solver.errors import MeasurementError

if TYPE_CHECKING:
    from jointstiff.solver.robot.model import Robot


class ImportRefusedError(FilesError):
    """Raise when files were not understood; nothing of them is taken then."""

    def __init__(self, faults: Sequence[ImportFileError]) -> None:
        first = faults[0]
        self.faults = tuple(faults)  # the first ones, in their order
        items = [(_where(fault.place), fault.reason, fault.remedy) for fault in self.faults]
        super().__init__(first.reason, remedy=first.remedy, where=_where(first.place), items=items)


def import_files(
    files: Sequence[SourceFile], request: ImportRequest, robot: Robot | None = None
) -> ImportAnswer:
    """Understand files of readings, and make a measurement set of them if nothing is missing.

    Args:
        files: text or Excel, in any order.
        request: what they do not say themselves.
        robot: that was measured: then the set is inspected.

    Raises:
        ImportRefusedError: something in them is not understood, contradictory or ambiguous, and the request
            does not ask to be shown it.
    """
    understood = understand_files(files, request)
    preview, imported = preview_of(understood), understood.imported
    faults = list(understood.faults)
    missing = [] if imported is None else _missing(imported, request)
    document, findings, template, poses = None, None, None, None
    if imported is not None and not missing:
        try:
            document = measurement_set_of(imported, request, files[0].name)
            findings = None if robot is None else _findings(document, robot)
            template = template_of(request, preview.files, imported)
        except ImportFileError as fault:
            document = None
            faults.append(fault)
    elif imported is not None and imported.assembly.states == ("unloaded",):
        unready = {"joints", "accept_unusual"} & {item.field for item in missing}
        poses = None if unready else poses_of(imported, request, files[0].name)
    if faults and not request.show_faults:
        raise ImportRefusedError(faults)
    return ImportAnswer(
        preview=preview,
        faults=[_fault(fault) for fault in faults],
        missing_fields=[item.field for item in missing],
        missing=[item.text for item in missing],
        leave_out=[] if imported is None else imported.assembly.held_out,
        measurement_set=document,
        findings=findings,
        template=template,
        poses=poses,
    )


def inspect_import(answer: ImportAnswer, robot: Robot) -> ImportAnswer:
    """Return an answer with the integrity findings of its measurement set, if it has one.

    Raises:
        ImportRefusedError: the readings cannot be of this robot.
    """
    if answer.measurement_set is None:
        return answer
    try:
        return answer.model_copy(update={"findings": _findings(answer.measurement_set, robot)})
    except ImportFileError as fault:
        raise ImportRefusedError([fault]) from fault


class Missing(NamedTuple):
    """Something that a measurement set needs beyond what was read."""

    field: MissingField  # for programs
    text: str  # for people


def _missing(imported: Imported, request: ImportRequest) -> list[Missing]:
    """Return what a measurement set needs beyond files and request."""
    assembly, values = imported.assembly, imported.assembly.observations[0].values
    states = set(assembly.states)
    unusual = [] if request.accept_unusual else _unusual(imported, request)
    right = f"a confirmation (`accept_unusual`) that this is right: {'; '.join(unusual[:MAX_PREVIEW_ROWS])}"
    stated, unit = request.force is not None, None if request.units is None else request.units.force
    joints = "joint angles of each observation: columns `J1 [deg]`, `J2 [deg]`, …"
    forces = "the force of each observation: columns `Fx [N]`, `Fy [N]`, `Fz [N]`, or one `force`"
    readings = "readings: columns such as `P10 unloaded x [mm]`, or lists of points"
    places = "the targets' positions in the flange frame (`flange_targets`), for deflections"
    unplaced = not set(assembly.places.values()) <= set(request.flange_targets)
    no_point = "load point" not in values and request.load_point is None
    encoders = "the encoders that close the position loop (`encoders`): motor or secondary"
    no_unit = stated and "force" not in imported.units and unit is None
    wanted: list[tuple[bool, MissingField, str]] = [
        ("joint" not in values, "joints", joints),
        ("force" not in values and not stated, "force", forces),
        (not states, "readings", readings),
        (states == {"unloaded"}, "loaded", "the positions under load"),
        (states == {"loaded"}, "unloaded", "the positions without load"),
        (unplaced, "flange_targets", places),
        (no_point, "load_point", "the load point (`load_point`), in the flange frame"),
        (bool(unusual), "accept_unusual", right),
        (no_unit, "units.force", "the unit of `force` (`units`): N, kN or kgf"),
        (request.encoders is None, "encoders", encoders),
    ]
    return [Missing(field, text) for lacks, field, text in wanted if lacks]


def _unusual(imported: Imported, request: ImportRequest) -> list[str]:
    """Return what is to be confirmed: values far from all others, load points that no tool reaches."""
    unit = imported.units.get("length", "mm")
    stated_unit = length_unit(imported, request)
    points = [
        hypot(*converted(one.values["load point"][0], unit, "m", "load_point"))
        for one in imported.assembly.observations
        if "load point" in one.values
    ]
    if request.load_point is not None:
        points.append(hypot(*converted(request.load_point, stated_unit, "m", "load_point")))
    far = max(points, default=0.0)
    stated = [f"the load point is {far:g} m from the flange"] if far > FAR_POINT else []
    return [*stated, *imported.assembly.unusual]


def _findings(document: MeasurementSetDocument, robot: Robot) -> list[Finding]:
    """Inspect a set; lengths that the request states have another remedy than those of the files."""
    from jointstiff.service.conversion.prepared import check_set

    try:
        findings = check_set(document, robot, None, []).warnings
    except MeasurementError as error:
        where = f" ({error.where})" if error.where else ""
        reason = f"the readings do not fit the robot{where}: {error.reason}"
        raise ImportFileError(Place(), reason, error.remedy or "check robot and readings") from error
    fields = [f"`{field}`" for field in ("load_point", "flange_targets") if getattr(document, field)]
    for index, finding in enumerate(findings):
        if fields and finding.code == "length_unit_suspect" and "the flange frame" in finding.message:
            small = (
                "; the numbers seem to be in m, but are read as mm"
                if finding.action and finding.action.unit == "m"
                else ""
            )
            remedy = f"check the unit of {' and '.join(fields)}{small}"
            findings[index] = finding.model_copy(update={"remedy": remedy})
    return findings


def template_of(
    request: ImportRequest, files: Sequence[FilePreview], imported: Imported
) -> ImportTemplate | None:
    """Return the options by which files of the same form are read again, and others are refused.

    Files with more columns, or longer headers of several rows, than options can hold have no template.
    """
    texts = [file for file in files if file.format == "text"]
    delimiters, marks = {file.delimiter for file in texts}, {file.decimal_mark for file in texts}
    columns = {
        column.header: column.meaning + (f" [{column.unit}]" if column.unit else "")
        for file in files
        for column in file.columns
        if column.header
    }
    inches = any(column.unit == "in" for file in files for column in file.columns)
    units = dict(imported.units) | ({"length": "in"} if inches else {})
    known = {} if request.units is None else request.units.model_dump(exclude_none=True)
    layouts = {tuple(column.header for column in file.columns): None for file in files}
    changes = {
        "units": known | units,
        "columns": columns,
        "layouts": [list(layout) for layout in layouts],
        "ignore": [],
        "delimiter": delimiters.pop() if len(delimiters) == 1 else None,
        "decimal_mark": marks.pop() if len(marks) == 1 else None,
        "length_unit": length_unit(imported, request),
        "name": None,
        "robot_id": None,
        "show_faults": False,
        "accept_unusual": False,  # what was confirmed are these values, not the next file's
    }
    try:
        return ImportTemplate.model_validate(request.model_dump() | changes)
    except ValidationError:
        return None


def _fault(fault: ImportFileError) -> ImportFault:
    place = fault.place
    return ImportFault(
        file=place.file,
        line=place.line,
        column=place.column,
        reason=fault.reason,
        remedy=fault.remedy,
        option=fault.option,
        words=list(fault.words),
    )


def _where(place: Place) -> str:
    parts = [part for part in (place.file, place.line, place.column) if part is not None]
    return ":".join(map(str, parts)) or "files"
