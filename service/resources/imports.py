"""Imports: files in, a preview and the measurement set that they make out. Nothing is stored."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, sqrt
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Final

from pydantic import ValidationError

from jointstiff.schemas.geometry.message import MAX_GEOMETRY_READINGS, MAX_GEOMETRY_TARGETS
from jointstiff.schemas.importing import FilePreview, ImportFault
from jointstiff.schemas.imports import ImportAnswer, ImportRequest, ImportTemplate, UnloadedPoses
from jointstiff.schemas.measurement.measurement_set import MeasurementSetDocument, QualityWarning
from jointstiff.schemas.measurement.noise import Noise
from jointstiff.service.importing.errors import ImportFileError, Place
from jointstiff.service.importing.limits import FAR_LOAD_POINT
from jointstiff.service.importing.preview import Missing, missing_from
from jointstiff.service.importing.reading import Imported, SourceFile, understand_files
from jointstiff.service.problems.errors import FilesError
from jointstiff.service.problems.wording import reworded
from jointstiff.solver.errors import MeasurementError

_LENGTHS: Final = frozenset(("sigma", "station", "constant", "load_point", "target_places", "position"))
"""Fields with lengths, in `noise` and of the request."""

if TYPE_CHECKING:
    from jointstiff.solver.robot.model import Robot


class ImportRefusedError(FilesError):
    """Raise when files were not understood; nothing of them is taken then."""

    def __init__(self, faults: Sequence[ImportFileError]) -> None:
        first = faults[0]
        self.faults = tuple(faults)  # the first ones, in their order
        super().__init__(first.reason, remedy=first.remedy, where=_where(first.place))

    @property
    def items(self) -> tuple[tuple[str, str, str], ...]:
        """Place, reason and remedy of each fault."""
        return tuple((_where(fault.place), fault.reason, fault.remedy) for fault in self.faults)


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
    preview, imported = understood.preview, understood.imported
    faults = list(understood.faults)
    missing = [] if imported is None else _missing(imported, request)
    document, findings, template, poses = None, None, None, None
    if imported is not None and not missing:
        try:
            document = _document(imported, request, files[0].name)
            findings = None if robot is None else _findings(document, robot)
            template = template_of(request, preview.files, imported)
        except ImportFileError as fault:
            document = None
            faults.append(fault)
    elif imported is not None and imported.assembly.states == ("unloaded",):
        unready = {"joints", "accept_unusual"} & {item.field for item in missing}
        poses = None if unready else _poses(imported, request, files[0].name)
    if faults and not request.show_faults:
        raise ImportRefusedError(faults)
    return ImportAnswer(
        preview=preview,
        faults=[_fault(fault) for fault in faults],
        missing_fields=[item.field for item in missing],
        missing=[item.text for item in missing],
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


def _missing(imported: Imported, request: ImportRequest) -> list[Missing]:
    missing = missing_from(
        imported.assembly,
        request.flange_targets,
        load_point=request.load_point is not None,
        force=request.force is not None,
        unusual=[] if request.accept_unusual else _unusual(imported, request),
    )
    if request.force is not None and "force" not in imported.units and _force_unit(request) is None:
        missing.append(Missing("units.force", "the unit of `force` (`units`): N, kN or kgf"))
    if request.encoders is None:
        text = "the encoders that close the position loop (`encoders`): motor or secondary"
        missing.append(Missing("encoders", text))
    return missing


def _unusual(imported: Imported, request: ImportRequest) -> list[str]:
    """Return what is to be confirmed: values far from all others, load points that no tool reaches."""
    unit = imported.units.get("length", "mm")
    stated_unit = _length_unit(imported, request)
    points = [
        hypot(*_converted(one.values["load point"][0], unit, "m", "load_point"))
        for one in imported.assembly.observations
        if "load point" in one.values
    ]
    if request.load_point is not None:
        points.append(hypot(*_converted(request.load_point, stated_unit, "m", "load_point")))
    far = max(points, default=0.0)
    stated = [f"the load point is {far:g} m from the flange"] if far > FAR_LOAD_POINT else []
    return [*stated, *imported.assembly.unusual]


def _length_unit(imported: Imported, request: ImportRequest) -> str:
    """Return the unit of the lengths in the request: the files' own if it says none."""
    return request.length_unit or imported.units.get("length", "mm")


def _converted(value: Any, before: str, after: str, name: str = "") -> Any:  # noqa: ANN401 - any part of it
    """Return a part of the request with its lengths, in m or mm, in the other unit."""
    if isinstance(value, dict):
        return {key: _converted(part, before, after, key) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return tuple(_converted(part, before, after, name) for part in value)
    if before == after or name not in _LENGTHS or value is None:
        return value
    return value / 1e3 if after == "m" else value * 1e3


def _force_unit(request: ImportRequest) -> str | None:
    return None if request.units is None else request.units.force


def _document(imported: Imported, request: ImportRequest, first: str) -> MeasurementSetDocument:
    """The measurement set.

    Raises:
        ImportFileError: it would break a limit that the files do not have.
    """
    if request.encoders is None:
        raise ValueError("which encoders close the loop is not known")
    stated = request.noise is not None and request.noise.sigma is not None
    if imported.assembly.uncertainty and (stated or (request.noise is not None and request.noise.instrument)):
        raise ImportFileError(
            Place(),
            "the files state the uncertainty of each reading, and `noise` states another",
            "omit `noise`, or skip the columns of U(95) with `ignore`",
            "noise",
        )
    if request.force is not None and "force" in imported.assembly.observations[0].values:
        raise ImportFileError(
            Place(), "the files have forces, and `force` states another", "omit `force`", "force"
        )
    units = _length_unit(imported, request), imported.units.get("length", "mm")
    lengths = _converted(request.model_dump(include={"noise", "load_point"}, exclude_unset=True), *units)
    try:
        return imported.document(
            name=request.name or PurePath(first).stem.strip(),
            encoders=request.encoders,
            noise=Noise.model_validate(lengths["noise"]) if lengths.get("noise") else None,
            flange_targets={
                target: _converted(place, *units, "load_point")
                for target, place in request.flange_targets.items()
            },
            load_point=lengths.get("load_point"),
            force=request.force,
            force_unit=_force_unit(request),
        )
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False, include_input=False)[0]
        path = ".".join(map(str, fault["loc"]))
        raise ImportFileError(
            Place(),
            f"the readings do not make a valid measurement set: {path} {reworded(fault)}",
            "check the limits of measurement sets",
        ) from error


def _poses(imported: Imported, request: ImportRequest, first: str) -> UnloadedPoses | None:
    """Return the unloaded poses for a geometry; None beyond its limits."""
    units = _length_unit(imported, request), imported.units.get("length", "mm")
    observations = imported.assembly.observations
    points = [point for one in observations for states in one.points.values() for point in states.values()]
    sigma = None if request.noise is None else _converted(request.noise.sigma, *units, "sigma")
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
            "name": request.name or PurePath(first).stem.strip(),
            "units": {"length": units[1], "angle": imported.units.get("angle")},
            "noise": None if sigma is None else {"sigma": sigma},
            "poses": [
                {"joints": list(one.values["joint"][0]), "targets": targets}
                for one, targets in read
                if targets
            ],
        }
    )


def _findings(document: MeasurementSetDocument, robot: Robot) -> list[QualityWarning]:
    """Inspect a set.

    Raises:
        ImportFileError: it cannot be one of this robot.
    """
    from jointstiff.service.conversion.prepared import check_set

    try:
        return check_set(document, robot, None, []).warnings
    except MeasurementError as error:
        where = f" ({error.where})" if error.where else ""
        reason = f"the readings do not fit the robot{where}: {error.reason}"
        raise ImportFileError(Place(), reason, error.remedy or "check robot and readings") from error


def template_of(request: ImportRequest, files: Sequence[FilePreview], imported: Imported) -> ImportTemplate:
    """Return the options by which files of the same form are read again, and others are refused.

    Args:
        request: by which they were read now.
        files: as they were read.
        imported: their content.
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
    found = dict(imported.units) | ({"length": "in"} if inches else {})
    known = {} if request.units is None else request.units.model_dump(exclude_none=True)
    layouts = {tuple(column.header for column in file.columns): None for file in files}
    changes = {
        "units": known | found,
        "columns": columns,
        "layouts": [list(layout) for layout in layouts],
        "ignore": [],
        "delimiter": delimiters.pop() if len(delimiters) == 1 else None,
        "decimal_mark": marks.pop() if len(marks) == 1 else None,
        "length_unit": _length_unit(imported, request),
        "name": None,
        "robot_id": None,
        "show_faults": False,
        "accept_unusual": False,  # what was confirmed are these values, not the next file's
    }
    return ImportTemplate.model_validate(request.model_dump() | changes)


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
