"""The command `compensate`: a program whose loaded tool is where it says."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jointstiff.service.cli.answers import failed, refuse_existing, refused
from jointstiff.service.cli.options import (
    AsJson,
    CampaignFile,
    LoadPoint,
    Overwrite,
    RunFile,
    Vector,
    vector_of,
)

if TYPE_CHECKING:
    from jointstiff.schemas.program import Program


class AccuracyChoice(StrEnum):
    """State of the controller's own accuracy option."""

    OFF = "off"
    SAME = "same_as_measured"
    LOAD = "compensates_load"


class AxesChoice(StrEnum):
    """Axes of forces and moments."""

    ROBOT = "robot"
    TOOL = "tool"
    BASE = "base"


def compensate(
    file: CampaignFile,
    program: Annotated[
        list[Path],
        typer.Argument(
            exists=True,
            dir_okay=False,
            metavar="PROGRAM",
            help="A program; a .src with its .dat as two files.",
        ),
    ],
    *,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="FILE", help="Write it there; a .dat beside it, by that name."
        ),
    ],
    accuracy_option: Annotated[
        AccuracyChoice, typer.Option(help="The controller's own accuracy option while the program runs.")
    ],
    force: Annotated[
        Vector | None, typer.Option(parser=vector_of, metavar="X,Y,Z[N]", help="Force on the tool, in N.")
    ] = None,
    moment: Annotated[
        Vector | None,
        typer.Option(
            parser=vector_of, metavar="X,Y,Z[N.m]", help="Moment on the tool about the load point, in N.m."
        ),
    ] = None,
    axes: Annotated[AxesChoice | None, typer.Option(help="Axes of both; robot if absent.")] = None,
    loads: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            dir_okay=False,
            metavar="FILE",
            help="CSV of the load at each point, in place of --force.",
        ),
    ] = None,
    load_point: LoadPoint = None,
    tool: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]NUMBERS", help="Tool that the program only names, in its notation. Repeatable."
        ),
    ] = None,
    base: Annotated[
        list[str] | None, typer.Option(metavar="[NAME=]NUMBERS", help="Base, likewise. Repeatable.")
    ] = None,
    start: Annotated[
        str | None, typer.Option(metavar="NUMBERS", help="Controller's angles near the first target [deg].")
    ] = None,
    ramp: Annotated[float, typer.Option(min=0.0, help="Length over which corrections set in [m].")] = 0.0,
    leave_alone: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Routine that moves nothing. Repeatable.")
    ] = None,
    mark: Annotated[
        bool, typer.Option(help="Write run, verdict and date into the program, as a comment.")
    ] = True,
    options: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            dir_okay=False,
            metavar="FILE",
            help="JSON, as POST /v1/programs takes it, without run_id.",
        ),
    ] = None,
    run: RunFile = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write all points there, as CSV.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Correct a program by a campaign's model, so that the loaded tool is where it says."""
    from jointstiff.schemas.run.run import Run
    from jointstiff.service.kinds.program import PROGRAM
    from jointstiff.service.kinds.program.work import unpacked, without_contents
    from jointstiff.service.kinds.report import job_report
    from jointstiff.service.library import programs
    from jointstiff.service.library.campaigns import read_campaign, read_document
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.tables.terminal import console, progress_bar

    several = len(program) > 1
    outputs = {each.name: output.with_suffix(each.suffix) if several else output for each in program}
    for path in [*outputs.values(), *([report] if report else [])]:
        refuse_existing(path, overwrite=overwrite)
    given: dict[str, Any] = {
        "accuracy_option": accuracy_option.value,
        "load": None if force is None else {"force": force, **({"moment": moment} if moment else {})},
        "axes": None if axes is None else axes.value,
        "loads": None if loads is None else loads.name,
        "load_point": load_point,
        "tools": _frames(tool, "--tool"),
        "bases": _frames(base, "--base"),
        "start": None if start is None else _numbers(start, "--start"),
        "limits": {"ramp": ramp} if ramp else None,
        "leave_alone": leave_alone,
        **({} if mark else {"mark": False}),
    }
    files = [*program, *([loads] if loads else [])]
    try:
        campaign = read_campaign(file)
        stated = {name: value for name, value in given.items() if value or name == "mark"}
        asked = programs.stated_options(options, stated)
        measured = None if run is None else read_document(run, Run)
        with progress_bar(shown=True) as show:
            found = programs.compensate(campaign, files, asked, measured, show)
    except CampaignError as error:
        raise refused(error.problem) from error
    if found.result is not None:
        for each in found.result.files:
            _write(outputs[each.name], unpacked(each))
        if report is not None:
            _write(report, unpacked(found.result.table))
    if as_json:
        typer.echo(without_contents(found.model_dump_json()))
    else:
        console().print(job_report(PROGRAM, found))
    _end(found)


def _end(found: Program) -> None:
    if found.state != "succeeded":
        raise typer.Exit(1)


def _write(path: Path, content: bytes) -> None:
    try:
        path.write_bytes(content)
    except OSError as error:
        raise failed(f"cannot write {path}: {error.strerror}", "choose another path") from error


def _frames(texts: Sequence[str] | None, option: str) -> list[dict[str, Any]]:
    frames = []
    for text in texts or ():
        name, _, numbers = text.rpartition("=")
        frames.append({"name": name or None, "values": _numbers(numbers, option)})
    return frames


def _numbers(text: str, option: str) -> list[float]:
    try:
        return [float(number) for number in text.replace(",", " ").split()]
    except ValueError as error:
        raise typer.BadParameter(
            f"'{text}' must be numbers, such as 0,0,215.5,0,0,0", param_hint=option
        ) from error
