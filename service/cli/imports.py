"""`jointstiff import`: files of readings shown as they were understood, then written as a campaign."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jointstiff.service.cli.answers import warn
from jointstiff.service.cli.import_documents import (
    joined,
    noted_in,
    read_template,
    with_notes,
    write_campaign,
    write_template,
)
from jointstiff.service.cli.import_options import (
    Options,
    in_options,
    options_for_fields,
    with_import_options,
    with_length_unit,
)
from jointstiff.service.cli.import_questions import ask, ask_robot, may_ask
from jointstiff.service.cli.options import AsJson, NamedRobot, file_argument, file_option

if TYPE_CHECKING:
    from jointstiff.schemas.imports import ImportAnswer, ImportRequest
    from jointstiff.schemas.robot import RobotDocument
    from jointstiff.service.importing.reading import SourceFile

Files = Annotated[list[Path], file_argument("FILES...", "Files of tables or point lists: text or Excel.")]


@with_import_options
def import_readings(
    files: Files,
    *,
    chosen: Options,
    robot: NamedRobot = None,
    about: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="Note about the set: measured_at, serial_number, item_condition, operator, instrument, "
            "conditions or notes. Repeatable.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            dir_okay=False,
            metavar="FILE",
            help="File to write: a campaign; without --robot a measurement set; poses for `geometry` if only "
            "unloaded positions were read.",
        ),
    ] = None,
    template: Annotated[
        Path | None,
        file_option("Template of an earlier import; files of another form are refused."),
    ] = None,
    save_template: Annotated[
        Path | None,
        typer.Option(dir_okay=False, metavar="FILE", help="Write the template of this import."),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")] = False,
    despite_errors: Annotated[
        bool, typer.Option("--despite-errors", help="Write readings although their inspection finds errors.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Import files of readings as a campaign.

    Nothing is written without --output or --save-template, nor while something is missing. At a terminal it
    asks for what is missing. If the inspection of the readings finds errors, they are written only with
    --despite-errors, and the exit status is 1 without it.
    """
    from jointstiff.service.cli.import_table import has_errors, import_report
    from jointstiff.service.tables.terminal import console

    noted = noted_in(about or [])
    known = {} if template is None else read_template(template)
    stated = joined(known, with_length_unit(chosen, known))
    asking = may_ask() and not as_json
    owner = None if robot is None else _robot_of(robot)
    answer = _understood(files, stated, owner, asking=asking)
    if asking and owner is None and answer.measurement_set is not None and (named := ask_robot()):
        owner = _robot_of(named)
        answer = _inspected(answer, owner)
    answer = with_notes(answer, noted)
    if as_json:
        typer.echo(answer.model_dump_json(indent=2))
    else:
        console().print(import_report(answer))
    if save_template is not None:
        write_template(save_template, answer, overwrite=overwrite)
    if has_errors(answer) and not despite_errors:
        if output is not None:
            warn(f"{output} was not written: correct the errors, or use --despite-errors")
        raise typer.Exit(1)
    if output is not None:
        write_campaign(output, answer, owner, overwrite=overwrite)


def _robot_of(text: str) -> "RobotDocument":
    from jointstiff.service.library.files import read_robot

    return read_robot(text)


def _understood(
    files: Sequence[Path], stated: Options, owner: "RobotDocument | None", *, asking: bool
) -> "ImportAnswer":
    """Return what the files say, with what a person answers if there is one."""
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.problems.errors import FilesError
    from jointstiff.service.problems.table import problem_of
    from jointstiff.service.resources.imports import import_files

    sources, asked = _read(files), set[str]()
    while asking:
        given = ask(import_files(sources, _request(stated | {"show_faults": True})), asked)
        if not given:
            break
        stated = joined(stated, with_length_unit(given, stated))
    try:
        answer = import_files(sources, _request(stated))
    except FilesError as error:
        raise CampaignError(in_options(problem_of(error))) from error
    answer = answer.model_copy(update={"missing": [options_for_fields(text) for text in answer.missing]})
    return answer if owner is None else _inspected(answer, owner)


def _inspected(answer: "ImportAnswer", owner: "RobotDocument") -> "ImportAnswer":
    """Return the answer with the integrity findings for a robot that was named later, in words of options."""
    from jointstiff.service.conversion.prepared import prepare_robot
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.problems.errors import FilesError
    from jointstiff.service.problems.table import problem_of
    from jointstiff.service.resources.imports import inspect_import

    try:
        answer = inspect_import(answer, prepare_robot(owner).robot)
    except FilesError as error:
        raise CampaignError(in_options(problem_of(error))) from error
    findings = [
        finding.model_copy(update={"remedy": options_for_fields(finding.remedy)})
        for finding in answer.findings or ()
    ]
    return answer.model_copy(update={"findings": findings})


def _request(chosen: Options) -> "ImportRequest":
    from pydantic import ValidationError

    from jointstiff.schemas.imports import ImportRequest
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.problems.table import invalid_request

    try:
        return ImportRequest.model_validate(chosen)
    except ValidationError as error:
        faults = error.errors(include_url=False, include_context=False, include_input=False)
        raise CampaignError(in_options(invalid_request(faults))) from None


def _read(files: Sequence[Path]) -> "list[SourceFile]":
    """The files, no more of them than an import takes."""
    from jointstiff.service.importing.grid import MAX_FILE_BYTES
    from jointstiff.service.importing.reading import SourceFile

    sources, left = [], MAX_FILE_BYTES
    for path in files:
        with path.open("rb") as file:
            content = file.read(left + 1)
        left = max(0, left - len(content))
        sources.append(SourceFile(path.name, content))
    return sources
