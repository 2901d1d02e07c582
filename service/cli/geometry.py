"""The command `jointstiff geometry`: a robot's geometry from a file of readings, without a server."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jointstiff.service.cli.answers import refuse_existing, refused, write_text
from jointstiff.service.cli.options import AsJson, Details, NamedRobot

if TYPE_CHECKING:
    from jointstiff.schemas.geometry.message import GeometryRequest


class FitChoice(StrEnum):
    """Choices for the fit of the sweeps."""

    ONE_BY_ONE = "one_by_one"
    TOGETHER = "together"


class AnglesChoice(StrEnum):
    """Whose angles of the joint that is turned."""

    FREE = "free"
    CONTROLLER = "controller"


def geometry(
    file: Annotated[
        Path,
        typer.Argument(
            exists=True, dir_okay=False, readable=True, metavar="FILE", help="File of sweeps or poses."
        ),
    ],
    *,
    robot: NamedRobot = None,
    fit: Annotated[FitChoice | None, typer.Option(help="Fit of the sweeps; overrides the file.")] = None,
    angles: Annotated[
        AnglesChoice | None, typer.Option(help="Joint angles during sweeps; overrides the file.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(dir_okay=False, metavar="ROBOT.json", help="File to write the identified robot to."),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")] = False,
    details: Details = False,
    as_json: AsJson = False,
) -> None:
    """Find axes, base frame, wrist centre, targets and the identified robot from a tracker's readings.

    The file has each joint turned alone (`sweeps`), or unloaded `poses`, as POST /v1/geometries takes them.
    """
    from jointstiff.service.kinds.geometry import GEOMETRY
    from jointstiff.service.kinds.report import job_report
    from jointstiff.service.library import campaigns
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.tables.terminal import console

    if output is not None:
        refuse_existing(output, overwrite=overwrite)
    try:
        found = campaigns.find_geometry(_request(file, robot, {"fit": fit, "angles": angles}))
    except CampaignError as error:
        raise refused(error.problem) from error
    if output is not None and found.result is not None:
        import json

        identified = found.result.robot.model_dump(mode="json", exclude_none=True)
        write_text(output, json.dumps(identified, indent=1))
    if as_json:
        typer.echo(found.model_dump_json(indent=2))
    else:
        console().print(job_report(GEOMETRY, found, details=details))
    if found.state != "succeeded":
        raise typer.Exit(1)


def _request(file: Path, robot: str | None, chosen: dict[str, Any]) -> "GeometryRequest":
    """The readings, with the nominal model and the options of the command.

    Raises:
        CampaignError: a file, or all of it together, is not such a document.
    """
    from jointstiff.schemas.geometry.message import GeometryRequest
    from jointstiff.service.library.campaigns import read_document
    from jointstiff.service.library.robots import read_robot

    changes = {name: value.value for name, value in chosen.items() if value is not None}
    if robot is not None:
        changes |= {"robot": read_robot(robot).model_dump(mode="json"), "robot_id": None}
    return read_document(file, GeometryRequest, changes=changes)
