"""`jointstiff import`: files of readings shown as they were understood, then written as a campaign."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from jointstiff.service.cli.answers import refused
from jointstiff.service.cli.import_options import in_options, options_for_fields
from jointstiff.service.cli.options import AsJson, EncoderChoice, NamedRobot

if TYPE_CHECKING:
    from jointstiff.schemas.imports import ImportAnswer, ImportRequest
    from jointstiff.schemas.measurement import MeasurementSetDocument
    from jointstiff.schemas.robot import RobotDocument
    from jointstiff.service.importing import SourceFile

_XYZ: Final = 3

Files = Annotated[
    list[Path],
    typer.Argument(
        exists=True,
        dir_okay=False,
        readable=True,
        metavar="FILES...",
        help="Files of tables or point lists: text or Excel.",
    ),
]
UnitsText = Annotated[
    str | None,
    typer.Option(
        metavar="length=mm,angle=deg,force=N",
        help="Units of columns whose header has none; add moment=N.m if there are moments.",
    ),
]
StateWords = Annotated[
    list[str] | None,
    typer.Option(
        "--state-word", metavar="WORD=STATE", help="Extra word for a state, such as 150kg=loaded. Repeatable."
    ),
]
FlangeTargets = Annotated[
    list[str] | None,
    typer.Option(
        "--flange-target",
        metavar="TARGET=X,Y,Z",
        help="Target's position in the flange frame, for deflections. Repeatable.",
    ),
]
Ignored = Annotated[
    list[str] | None,
    typer.Option("--ignore", metavar="HEADER", help="Header of a column to ignore. Repeatable."),
]


def import_readings(
    files: Files,
    *,
    units: UnitsText = None,
    point_name: Annotated[
        str | None,
        typer.Option(metavar="TEMPLATE", help="Template of point names, such as '{label}_{target}_{state}'."),
    ] = None,
    file_name: Annotated[
        str | None,
        typer.Option(
            metavar="TEMPLATE", help="Template of file names, such as '{target}_{state}', without .txt."
        ),
    ] = None,
    state_words: StateWords = None,
    delimiter: Annotated[
        str | None, typer.Option(metavar="NAME", help="Cell delimiter: comma, semicolon, tab or whitespace.")
    ] = None,
    decimal_mark: Annotated[
        str | None, typer.Option(metavar="NAME", help="Decimal mark: point or comma.")
    ] = None,
    header: Annotated[
        str | None,
        typer.Option(metavar="'A;B;C'", help="Header for files without one, cells separated by semicolons."),
    ] = None,
    ignore: Ignored = None,
    sheet: Annotated[str | None, typer.Option(help="Sheet of an Excel file.")] = None,
    allow_missing: Annotated[
        bool, typer.Option("--allow-missing", help="Skip incomplete readings, and list them.")
    ] = False,
    encoders: Annotated[
        EncoderChoice | None, typer.Option(help="Encoders that close the position loop: motor or secondary.")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Name of the measurement set; default: name of the first file.")
    ] = None,
    sigma: Annotated[
        float | None, typer.Option(help="Standard uncertainty of a coordinate, in the files' unit of length.")
    ] = None,
    load_point: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Load point in the flange frame, in the files' unit of length."),
    ] = None,
    flange_targets: FlangeTargets = None,
    robot: NamedRobot = None,
    output: Annotated[
        Path | None,
        typer.Option(
            dir_okay=False,
            metavar="FILE",
            help="File to write: a campaign, or without --robot a measurement set.",
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")] = False,
    as_json: AsJson = False,
) -> None:
    """Read files of tracker software and tables; show what was understood, then write a campaign.

    Nothing is written without --output, nor while something is missing.
    """
    from jointstiff.service.library import CampaignError, read_robot
    from jointstiff.service.render import console, import_report

    chosen = {
        "units": None if units is None else _pairs([part for part in units.split(",") if part], "--units"),
        "point_name": point_name,
        "file_name": file_name,
        "state_words": _pairs(state_words, "--state-word"),
        "delimiter": delimiter,
        "decimal_mark": decimal_mark,
        "header": None if header is None else [cell.strip() for cell in header.split(";")],
        "ignore": ignore,
        "sheet": sheet,
        "allow_missing": allow_missing,
        "encoders": encoders,
        "name": name,
        "noise": None if sigma is None else {"sigma": sigma},
        "load_point": None if load_point is None else _vector(load_point, "--load-point"),
        "flange_targets": {
            target: _vector(text, "--flange-target")
            for target, text in _pairs(flange_targets, "--flange-target").items()
        },
    }
    try:
        owner = None if robot is None else read_robot(robot)
        answer = _understood(files, {field: value for field, value in chosen.items() if value is not None})
    except CampaignError as error:
        raise refused(error.problem) from error
    if as_json:
        typer.echo(answer.model_dump_json(indent=2))
    else:
        console().print(import_report(answer))
    if output is not None:
        _write(output, answer, owner, overwrite=overwrite)


def _understood(files: Sequence[Path], chosen: dict[str, object]) -> "ImportAnswer":
    """Return what the files say.

    Raises:
        CampaignError: what was chosen contradicts itself, or a file was not understood.
    """
    from jointstiff.service.library import CampaignError
    from jointstiff.service.problems import FilesError, problem_of
    from jointstiff.service.resources import import_files

    try:
        answer = import_files(_read(files), _request(chosen))
    except FilesError as error:
        raise CampaignError(in_options(problem_of(error))) from error
    return answer.model_copy(update={"missing": [options_for_fields(text) for text in answer.missing]})


def _request(chosen: dict[str, object]) -> "ImportRequest":
    from pydantic import ValidationError

    from jointstiff.schemas.imports import ImportRequest
    from jointstiff.service.library import CampaignError
    from jointstiff.service.problems import invalid_request

    try:
        return ImportRequest.model_validate(chosen)
    except ValidationError as error:
        faults = error.errors(include_url=False, include_context=False, include_input=False)
        raise CampaignError(in_options(invalid_request(faults))) from None


def _read(files: Sequence[Path]) -> "list[SourceFile]":
    """The files, no more of them than an import takes."""
    from jointstiff.service.importing import MAX_FILE_BYTES, SourceFile

    sources, left = [], MAX_FILE_BYTES
    for path in files:
        with path.open("rb") as file:
            content = file.read(left + 1)
        left = max(0, left - len(content))
        sources.append(SourceFile(path.name, content))
    return sources


def _write(path: Path, answer: "ImportAnswer", robot: "RobotDocument | None", *, overwrite: bool) -> None:
    from jointstiff.service.problems import http_problem
    from jointstiff.service.render import console

    if answer.measurement_set is None:
        missing = "; ".join(answer.missing)
        raise refused(http_problem(422, f"nothing was written, because this is missing: {missing}", "add it"))
    if path.exists() and not overwrite:
        raise refused(http_problem(409, f"{path} exists", "choose another name, or --overwrite"))
    try:
        path.write_text(_document(answer.measurement_set, robot) + "\n", encoding="utf-8")
    except OSError as error:
        raise refused(
            http_problem(422, f"cannot write {path}: {error.strerror}", "choose another path")
        ) from error
    what, command = (
        ("a measurement set", "add a robot with --robot")
        if robot is None
        else ("a campaign", f"jointstiff identify {path}")
    )
    console(stderr=True).print(f"wrote {path}, {what}; now: {command}", markup=False, soft_wrap=True)


def _document(readings: "MeasurementSetDocument", robot: "RobotDocument | None") -> str:
    import json

    found = readings.model_dump(mode="json", exclude_none=True)
    if robot is not None:
        found = {"robot": robot.model_dump(mode="json", exclude_unset=True), "measurement_set": found}
    return json.dumps(found, indent=1, ensure_ascii=False)


def _pairs(texts: Sequence[str] | None, option: str) -> dict[str, str]:
    found = {}
    for text in texts or ():
        key, equals, value = text.rpartition("=")
        if not equals:
            raise typer.BadParameter(f"'{text}' has no '='", param_hint=option)
        found[key.strip()] = value.strip()
    return found


def _vector(text: str, option: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != _XYZ:
        raise typer.BadParameter(f"'{text}' must be three numbers, such as 0,0,120.5", param_hint=option)
    return numbers
