"""The command `jointstiff robots`: the catalogue of nominal arms."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jointstiff.service.cli.options import AsJson, Overwrite


def robots(
    name: Annotated[
        str | None, typer.Argument(metavar="ARM", help="Name of an arm, or a part of it; all if absent.")
    ] = None,
    *,
    output: Annotated[
        Path | None,
        typer.Option(dir_okay=False, metavar="ROBOT.json", help="File to write the robot ARM to."),
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """List nominal arms, by figures their makers or others published; a name serves as --robot."""
    from jointstiff.service.cli.answers import refuse_existing, refused, write_text
    from jointstiff.service.cli.arms_table import arm_report, arms_table
    from jointstiff.service.problems.table import problem_of
    from jointstiff.service.resources.nominal_arms import catalogue, find_arm, nominal_robot
    from jointstiff.service.tables.terminal import console
    from jointstiff.solver.errors import RequestError

    if output is not None and name is None:
        raise typer.BadParameter("needs the name of an arm", param_hint="--output")
    try:
        arm = None if name is None else find_arm(name, "ARM")
    except RequestError as error:
        raise refused(problem_of(error)) from error
    if as_json:
        typer.echo((arm or catalogue()).model_dump_json(indent=2))
    else:
        console().print(arms_table(catalogue()) if arm is None else arm_report(arm))
    if output is not None and arm is not None:
        refuse_existing(output, overwrite=overwrite)
        write_text(output, nominal_robot(arm).model_dump_json(indent=1, exclude_none=True))
