"""Commands of models: `robots`, the catalogue of nominal arms; `export` and `report` of an identified one."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from jointstiff.service.cli import options as cli
from jointstiff.service.settings import LaboratoryFile

if TYPE_CHECKING:
    from jointstiff.schemas.robot import Arm, Catalogue, DhRow
    from jointstiff.service.library.results import TabledRun
    from jointstiff.service.tables.table import Part, Table

_FORMATS: Final = (".csv", ".xlsx", ".mjcf")
_REPORTS: Final = (".pdf", ".html")


def export(
    file: cli.CampaignFile,
    *,
    output: Annotated[Path, cli.output_option("File to write the model to: .csv, .xlsx or .mjcf (MuJoCo).")],
    run: cli.RunFile = None,
    despite_verdict: Annotated[
        bool,
        typer.Option("--despite-verdict", help="Continue even if the verdict on the run is *do not use*."),
    ] = False,
    overwrite: cli.Overwrite = False,
) -> None:
    """Export a model as a table or for a simulator."""
    cli.check_ending(output, _FORMATS, reported=True)
    cli.refuse_existing(output, overwrite=overwrite, inputs=(file, run))
    read_or_identify_run(file, run).export(output, "do_not_use" if despite_verdict else None)
    typer.echo(f"{output}: {output.stat().st_size:,} bytes")


def report(
    file: Annotated[
        Path,
        cli.file_argument(
            "FILE",
            "File of a campaign, or output of --json for a comparison, plan, map or correction.",
        ),
    ],
    *,
    output: Annotated[
        Path,
        cli.output_option("File to write the report to: .pdf or .html."),
    ],
    run: cli.RunFile = None,
    laboratory: LaboratoryFile = None,
    overwrite: cli.Overwrite = False,
) -> None:
    """Write a report to sign on a campaign or a result."""
    from jointstiff.service.kinds.rooms import import_kind
    from jointstiff.service.library.results import PresentedJob, TabledRun
    from jointstiff.service.library.saved import load
    from jointstiff.service.problems import CampaignError, http_problem

    cli.check_ending(output, _REPORTS)
    cli.refuse_existing(output, overwrite=overwrite, inputs=(file, run, laboratory))
    job: Any = load(file)
    if not isinstance(job, PresentedJob) or isinstance(job, TabledRun):
        job = read_or_identify_run(file, run)
    elif not import_kind(job._job.kind).has_report or job._job.result is None:
        reason = f"{file} is a {job._job.kind} in state {job._job.state}, which has no report"
        raise CampaignError(http_problem(422, reason, "give a campaign, or a result that has a report"))
    job.report(output, laboratory)
    typer.echo(f"{output}: {output.stat().st_size:,} bytes")


def read_or_identify_run(file: Path, run: Path | None) -> TabledRun:
    """Return the run of a campaign: read from the file `run`, or identified now if `run` is None."""
    from jointstiff.service.library.here import Here, attach_campaign, use_saved
    from jointstiff.service.library.results import TabledRun
    from jointstiff.service.library.saved import load
    from jointstiff.service.problems import CampaignError, http_problem
    from jointstiff.service.resources.documents import read_campaign

    if run is None:
        saved = use_saved(file)
        return saved if isinstance(saved, TabledRun) else Here().identify(saved)
    loaded = load(run)
    if not isinstance(loaded, TabledRun):
        reason = f"{run} is not a run"
        raise CampaignError(http_problem(422, reason, "give a file that `identify --save` wrote"))
    return attach_campaign(loaded, read_campaign(file))


_REACH_POINTS: Final = {
    "wrist_centre": "of the wrist centre",
    "flange": "of the flange",
    "stated": "as stated",
}


def robots(
    name: Annotated[
        str | None,
        typer.Argument(metavar="ARM", help="Name of an arm, or a part of the name; default: all arms."),
    ] = None,
    *,
    output: Annotated[Path | None, cli.path_option("File to write the robot ARM to.", "ROBOT.json")] = None,
    overwrite: cli.Overwrite = False,
    as_json: cli.AsJson = False,
) -> None:
    """List the nominal arms of the catalogue."""
    from jointstiff.service.cli.failures import print_problem
    from jointstiff.service.conversion.catalogue import catalogue, find_arm, nominal_robot
    from jointstiff.service.problems import problem_from_error
    from jointstiff.service.tables.terminal import console, lay_out_parts
    from jointstiff.solver.errors import RequestError

    if output is not None and name is None:
        raise typer.BadParameter("needs the name of an arm: give the argument ARM", param_hint="--output")
    try:
        arm = None if name is None else find_arm(name, "ARM")
    except RequestError as error:
        raise print_problem(problem_from_error(error)) from error
    if as_json:
        typer.echo((arm or catalogue()).model_dump_json(indent=2))
    else:
        console().print(lay_out_parts(_make_arm_list(catalogue()) if arm is None else _describe_arm(arm)))
    if output is not None and arm is not None:
        cli.refuse_existing(output, overwrite=overwrite)
        cli.write_text(output, nominal_robot(arm).model_dump_json(indent=1, exclude_none=True))


def _make_arm_list(catalogue: Catalogue) -> list[Part]:
    """Return a table of the arms with reach and preset of the joint map, and a line on how to use an arm."""
    from jointstiff.service.tables.table import Column, Line, Table, number_formatter

    names = {preset.id: preset.name for preset in catalogue.joint_maps}
    table = Table(
        [
            Column("arm", [arm.name for arm in catalogue.arms], text=True),
            Column("reach", [arm.reach for arm in catalogue.arms], number_formatter("g", 1e3), "mm"),
            Column(
                "joint map", [names.get(arm.joint_map_preset or "", "—") for arm in catalogue.arms], text=True
            ),
        ],
        title="Nominal arms",
    )
    return [table, Line('Select an arm by its name, such as --robot "KUKA KR 210 R2700".')]


def _describe_arm(arm: Arm) -> list[Part]:
    """Return the description of an arm: title, Denavit-Hartenberg table, joint map, reach and sources."""
    from jointstiff.service.tables.table import Line

    lines = [f"R0: {arm.base}", f"reach: {arm.reach * 1e3:g} mm {_REACH_POINTS[arm.reach_of]}"]
    if arm.payload is not None:
        lines.append(f"payload: {arm.payload:g} kg")
    if arm.joint_map is not None:
        for number, row in enumerate(arm.joint_map.matrix, 1):
            factors = " ".join(f"{factor:g}" for factor in row)
            lines.append(f"joint map, row {number}: {factors}")
    lines += [f"source: {source}" for source in arm.sources]
    return [Line(f"{arm.name} (nominal)", "title"), _make_arm_table(arm), *map(Line, lines)]


def _make_arm_table(arm: Arm) -> Table:
    """Return the table of an arm's Denavit-Hartenberg parameters and limits, a row for each joint."""
    from jointstiff.service.tables import table

    rows = arm.model.rows
    columns = [
        table.Column("joint", [str(i + 1) for i in range(len(rows))], text=True),
        table.Column("a", [_format_length(row.a) for row in rows], unit="mm", text=True),
        table.Column("alpha", [_format_angle(row.alpha) for row in rows], unit="°", text=True),
        table.Column("d", [_format_length(row.d) for row in rows], unit="mm", text=True),
        table.Column("theta", [_format_angle(row.theta) for row in rows], unit="°", text=True),
        table.Column("limits", [_format_limits(row) for row in rows], unit="°", text=True),
    ]
    return table.Table(columns, title=f"Denavit-Hartenberg, {arm.model.convention}")


def _format_limits(row: DhRow) -> str:
    """Return the range of a joint's angle [°]: "-185 to 185"."""
    if row.lower is None or row.upper is None:
        return "not known"
    return f"{_format_angle(row.lower)} to {_format_angle(row.upper)}"


def _format_length(value: float) -> str:
    """Return a length [m] as text in mm."""
    return f"{round(value * 1e3, 6):g}"


def _format_angle(value: float) -> str:
    """Return an angle [rad] as text in degrees."""
    return f"{round(degrees(value), 6):g}"
