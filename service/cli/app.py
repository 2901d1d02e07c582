"""The command `jointstiff`, composed of its commands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer
import typer.core
from typer.main import get_command_from_info

from jointstiff.service.cli.answers import refusal_of
from jointstiff.service.cli.database import backup, doctor, restore
from jointstiff.service.cli.imports import import_readings
from jointstiff.service.cli.keys import keys
from jointstiff.service.cli.models import export, predict, report
from jointstiff.service.cli.robots import robots
from jointstiff.service.cli.services import demo, post, serve, worker
from jointstiff.service.cli.simulate import simulate
from jointstiff.service.cli.webhooks import webhooks
from jointstiff.service.kinds.rooms import ROOMS


class _Commands(typer.core.TyperGroup):
    """Commands; those of the kinds of work are made when they are called, as their messages take time."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401 - Typer's Click is private
        """Return name, command and arguments; build the command of a kind."""
        name = next((name for name, room in ROOMS.items() if args and room.command == args[0]), None)
        if name is not None:
            from jointstiff.service.cli.generated import command_of

            info = typer.models.CommandInfo(name=args[0], callback=command_of(name))
            self.commands[args[0]] = get_command_from_info(
                info, pretty_exceptions_short=False, rich_markup_mode=None
            )
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - Typer's Click is private
        """Carry a command out; an error that says how to mend it ends it with exit status 2."""
        try:
            return super().invoke(ctx)
        except Exception as error:
            refusal = refusal_of(error)
            if refusal is None:
                raise
            raise refusal from error


app = typer.Typer(
    cls=_Commands,
    name="jointstiff",
    help="Identify the joint stiffness of industrial robots from laser-tracker readings.\n\n"
    "Start with `jointstiff simulate campaign.json`, then `jointstiff identify campaign.json`.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # its libraries take longer to import than all else that help needs
    pretty_exceptions_enable=False,
)


def _placeholder(summary: str) -> Callable[[], None]:
    """Return a command that the list of commands shows in place of one that is built when it is called."""

    def command() -> None:
        raise NotImplementedError

    command.__doc__ = summary
    return command


app.command()(simulate)
for _room in ROOMS.values():
    app.command(_room.command)(_placeholder(_room.summary))
app.command("import")(import_readings)
for command in (
    robots,
    predict,
    export,
    report,
    serve,
    worker,
    post,
    demo,
    backup,
    restore,
    doctor,
):
    app.command()(command)
app.add_typer(keys, name="keys")
app.add_typer(webhooks, name="webhooks")


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
