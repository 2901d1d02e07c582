"""The command `jointstiff`, composed of its commands."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any

import typer
import typer.core
from typer.main import get_command

from jointstiff.service.cli.demo import demo, examples, simulate
from jointstiff.service.cli.keys import keys
from jointstiff.service.cli.models import export, report, robots
from jointstiff.service.cli.options import refusal_of
from jointstiff.service.cli.services import post, serve, worker
from jointstiff.service.kinds.rooms import ROOMS

_MADE = {room.command: room.summary for room in ROOMS.values()} | {
    "measure": "Measure live until a goal is reached.",
    "import": "Import files of readings as a campaign.",
    "predict": "Predict deflections in given postures under given loads.",
}
"""Commands that are made of messages when they are called, as messages take time, with their help."""
_SETTINGS: Any = {
    "rich_markup_mode": None,  # its libraries take longer to import than all else that help needs
    "pretty_exceptions_enable": False,
}


class _Commands(typer.core.TyperGroup):
    """The commands."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401 - Typer's Click is private
        """Return name, command and arguments; make the command if it is not yet."""
        if args and args[0] in _MADE:
            if args[0] == "import":
                from jointstiff.service.cli.imports import import_command as make
            elif args[0] == "measure":
                from jointstiff.service.cli.measure import measure_command as make
            elif args[0] == "predict":
                from jointstiff.service.cli.kinds import predict_command as make
            else:
                from jointstiff.service.cli.kinds import command_of

                kinds = {room.command: name for name, room in ROOMS.items()}
                make = partial(command_of, kinds[args[0]])
            alone = typer.Typer(add_completion=False, **_SETTINGS)
            alone.command(args[0])(make())
            self.commands[args[0]] = get_command(alone)
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
    add_completion=True,
    help="Identify the joint stiffness of industrial robots from laser-tracker readings.\n\n"
    "Start with `jointstiff simulate campaign.json`, then `jointstiff identify campaign.json`.",
    no_args_is_help=True,
    **_SETTINGS,
)


app.command()(simulate)
app.command()(examples)
for _command, _summary in _MADE.items():
    app.command(_command, help=_summary)(lambda: None)  # shown in the list in place of what is made later
for _written in (robots, export, report, serve, worker, post, demo):
    app.command()(_written)
app.add_typer(keys, name="keys")


def _version(value: bool) -> None:
    if value:
        from jointstiff.service.process import jointstiff_version

        typer.echo(f"jointstiff {jointstiff_version()}")
        raise typer.Exit


@app.callback()
def options(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and end.")
    ] = False,
) -> None:
    """Options of the command itself; Typer calls it before each command."""
