"""The command `jointstiff`, composed of its commands."""

from __future__ import annotations

from typing import Annotated

import typer

from jointstiff.service.cli.compensate import compensate
from jointstiff.service.cli.database import backup, doctor, restore
from jointstiff.service.cli.export import export
from jointstiff.service.cli.geometry import geometry
from jointstiff.service.cli.identify import compare, identify, pair
from jointstiff.service.cli.imports import import_readings
from jointstiff.service.cli.keys import keys
from jointstiff.service.cli.maps import map_area
from jointstiff.service.cli.plan import plan
from jointstiff.service.cli.predict import predict
from jointstiff.service.cli.report import report
from jointstiff.service.cli.robots import robots
from jointstiff.service.cli.services import demo, post, serve, worker
from jointstiff.service.cli.simulate import simulate
from jointstiff.service.cli.watch import watch

app = typer.Typer(
    name="jointstiff",
    help="Identify the joint stiffness of industrial robots from laser-tracker readings.\n\n"
    "Start with `jointstiff simulate campaign.json`, then `jointstiff identify campaign.json`.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # its libraries take longer to import than all else that help needs
    pretty_exceptions_enable=False,
)

app.command()(simulate)
app.command("import")(import_readings)
app.command("map")(map_area)
for command in (
    geometry,
    robots,
    plan,
    identify,
    compare,
    pair,
    predict,
    compensate,
    export,
    report,
    serve,
    worker,
    post,
    watch,
    demo,
    backup,
    restore,
    doctor,
):
    app.command()(command)
app.add_typer(keys, name="keys")


def _version(value: bool) -> None:
    if value:
        from jointstiff.service.versions import JOINTSTIFF_VERSION

        typer.echo(f"jointstiff {JOINTSTIFF_VERSION}")
        raise typer.Exit


@app.callback()
def options(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and end.")
    ] = False,
) -> None:
    """Options of the command itself; Typer calls it before each command."""
