"""The command `jointstiff plan`: which postures and loads to measure."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from jointstiff.service.cli.options import AsJson, LoadPoint


class CriterionChoice(StrEnum):
    """Criteria of method.md §10."""

    RELATIVE = "relative_a"
    WORK_AREA = "work_area"
    D = "d"
    E = "e"
    WORST = "worst_place"


class PlannedLoadChoice(StrEnum):
    """Loads that a plan may choose from; a cable needs anchors, in a file of options."""

    DEAD_WEIGHT = "dead_weight"
    ANY_DIRECTION = "any_direction"


def plan(
    source: Annotated[
        str,
        typer.Argument(
            metavar="ROBOT_OR_CAMPAIGN",
            help="File of a robot, or name of an arm of the catalogue, to begin; of a campaign, to go on "
            "with it.",
        ),
    ],
    *,
    options: Annotated[
        Path | None,
        typer.Option(
            exists=True, dir_okay=False, metavar="FILE", help="JSON, as POST /v1/plans takes it, without ids."
        ),
    ] = None,
    readings: Annotated[int | None, typer.Option(min=1, max=200, help="How many; 20 if absent.")] = None,
    criterion: Annotated[CriterionChoice | None, typer.Option(help="What to make least.")] = None,
    load: Annotated[PlannedLoadChoice | None, typer.Option(help="Needs --force.")] = None,
    force: Annotated[float | None, typer.Option(min=0.0, help="Size of the load, in newtons.")] = None,
    load_point: LoadPoint = None,
    campaign: Annotated[
        Path | None, typer.Option(dir_okay=False, metavar="FILE", help="Write a campaign to fill in there.")
    ] = None,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print the list for spreadsheets.")] = False,
    as_json: AsJson = False,
) -> None:
    """Plan which postures and loads to measure, with a certificate."""
    import json

    from jointstiff.schemas.plan import PlanOptions
    from jointstiff.service.cli.answers import refuse_existing, refused, write_text
    from jointstiff.service.kinds.plan import PLAN
    from jointstiff.service.kinds.plan.tables import readings_sheet
    from jointstiff.service.kinds.report import job_report
    from jointstiff.service.library import plans
    from jointstiff.service.library.campaigns import read_document
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.tables.files import csv_text
    from jointstiff.service.tables.terminal import console

    if (load is None) != (force is None):
        raise typer.BadParameter("go together", param_hint=["--load", "--force"])
    if campaign is not None:
        refuse_existing(campaign, overwrite=False)
    chosen = {
        "readings": readings,
        "criterion": None if criterion is None else criterion.value,
        "load": None if load is None else {"kind": load.value, "force": force},
        "load_point": load_point,
    }
    given = {name: value for name, value in chosen.items() if value is not None}
    try:
        planned = plans.read_planned(source)
        stated = PlanOptions() if options is None else read_document(options, PlanOptions)
        found = plans.plan(planned, plans.changed(stated, given))
    except CampaignError as error:
        raise refused(error.problem) from error
    if campaign is not None and found.result is not None:
        write_text(campaign, json.dumps(plans.campaign_to_fill_in(planned, found), indent=1))
    if as_json:
        typer.echo(found.model_dump_json(indent=2))
    elif as_csv and found.result is not None:
        typer.echo(csv_text(readings_sheet(found)), nl=False)
    else:
        console().print(job_report(PLAN, found))
    if found.state != "succeeded":
        raise typer.Exit(1)
