"""The command `jointstiff`, composed of its commands."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Final

import typer
import typer.core
from typer.main import get_command

from jointstiff.service.cli.archives import archive, restore
from jointstiff.service.cli.database import database
from jointstiff.service.cli.demo import demo, examples, rehearse, simulate
from jointstiff.service.cli.keys import keys
from jointstiff.service.cli.models import export, report, robots
from jointstiff.service.cli.services import post, serve, status, worker
from jointstiff.service.kinds.rooms import ROOMS

_LATE_COMMANDS = {room.command: room.summary for room in ROOMS.values()} | {
    "measure": "Measure live until a goal is reached.",
    "import": "Import files of readings as a campaign.",
    "predict": "Predict deflections in given postures under given loads.",
}
"""Help texts, by name, of the commands that are built only when called: importing messages takes time."""
_SETTINGS: Any = {
    "rich_markup_mode": None,  # its libraries take longer to import than all else that help needs
    "pretty_exceptions_enable": False,
}


def _build_late_command(name: str) -> Any:  # noqa: ANN401 - Typer's Click is private
    """Build a command of `_LATE_COMMANDS`, with one option for each field of its request."""
    # Only an application of Typer makes a Click command of a function: this one has a single command.
    app_of_command = typer.Typer(add_completion=False, **_SETTINGS)
    app_of_command.command(name)(_build_function(name))
    return get_command(app_of_command)


def _build_function(name: str) -> Callable[..., None]:
    """Return the function of a command of `_LATE_COMMANDS`; what builds it is imported only here."""
    if name == "import":
        from jointstiff.service.cli.imports import import_command

        return import_command
    if name == "measure":
        from jointstiff.service.cli.measure import build_measure_command

        return build_measure_command()
    from jointstiff.service.cli import kinds

    if name == "predict":
        return kinds.build_predict_command()
    kind_of_command = {room.command: kind for kind, room in ROOMS.items()}
    return kinds.build_command(kind_of_command[name])


class _Commands(typer.core.TyperGroup):
    """Group of all commands; it builds those in `_LATE_COMMANDS` when they are called."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401 - Typer's Click is private
        """Parse the words before the command; an unknown option is answered with where options belong."""
        try:
            return super().parse_args(ctx, args)
        except Exception as error:
            if not hasattr(error, "message"):  # `--help` and `--version` end by an exception, too
                raise
            from jointstiff.service.cli.failures import reword_usage_error

            reword_usage_error(error, None, self._list_flags)
            raise

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401 - Typer's Click is private
        """Return (name, command, remaining arguments); build a command of `_LATE_COMMANDS` first."""
        if args and args[0] in _LATE_COMMANDS:
            self.commands[args[0]] = _build_late_command(args[0])
        try:
            name, command, rest = super().resolve_command(ctx, args)
        except Exception as error:
            from jointstiff.service.cli.failures import name_meant_command

            name_meant_command(error, args, list(self.commands))
            raise
        if command is not None:
            _refuse_single_dashes(command, rest)
            _refuse_repeated_options(command, rest)
            _refuse_split_vectors(command, rest)
            _refuse_split_names(rest)
        return name, command, rest

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - Typer's Click is private
        """Run a command; if it raises an error with a remedy, print both and end with exit status 2."""
        try:
            return super().invoke(ctx)
        except Exception as error:
            from jointstiff.service.cli.failures import print_known_error, reword_usage_error

            reword_usage_error(error, ctx.invoked_subcommand, self._list_flags)
            exit_with_status = print_known_error(error, self._list_option_names(ctx))
            if exit_with_status is None:
                raise
            raise exit_with_status from error

    def _list_flags(self) -> dict[str, dict[str, str]]:
        """Return the options of each command, by command and option, with the form of their values."""
        flags = dict[str, dict[str, str]]()
        for name in self.commands:
            command: Any = _build_late_command(name) if name in _LATE_COMMANDS else self.commands[name]
            flags[name] = {
                flag: parameter.metavar or ""
                for parameter in command.params
                for flag in parameter.opts
                if flag.startswith("--")
            }
        return flags

    def _list_option_names(self, ctx: Any) -> dict[str, str]:  # noqa: ANN401 - Typer's Click is private
        """Return the options of the command that was run, such as `--robot`, in backquotes, by argument."""
        command = self.commands.get(ctx.invoked_subcommand)
        parameters = () if command is None else command.params
        return {
            parameter.name: f"`{parameter.opts[0]}`"
            for parameter in parameters
            if parameter.name and parameter.opts[0].startswith("--")
        }


def _refuse_repeated_options(command: Any, words: list[str]) -> None:  # noqa: ANN401 - Typer's Click is private
    """Refuse an option that has one value, but is given several times: the parser would take the last value.

    Raises:
        typer.BadParameter: there is such an option among the words of the command.
    """
    flags = [word.partition("=")[0] for word in words[: words.index("--") if "--" in words else None]]
    for parameter in command.params:
        has_one_value = not (getattr(parameter, "is_flag", True) or parameter.multiple)
        if has_one_value and sum(flags.count(flag) for flag in parameter.opts) > 1:
            reason = "is given several times, but has one value: give the option once"
            raise typer.BadParameter(reason, param_hint=parameter.opts[0])


def _refuse_single_dashes(command: Any, words: list[str]) -> None:  # noqa: ANN401 - Typer's Click is private
    """Refuse the name of a long option after one dash, which the parser takes as several short options.

    Raises:
        typer.BadParameter: there is such a word before `--`.
    """
    flags = {flag for parameter in getattr(command, "params", ()) for flag in parameter.opts}
    for word in words[: words.index("--") if "--" in words else None]:
        name = word.partition("=")[0]
        if not name.startswith("--") and f"-{name}" in flags and name not in flags:
            raise typer.BadParameter("is written with two dashes", param_hint=f"-{name}")


_NUMBERS: Final = re.compile(r"(?:(?!-)[^=,]+=)?[-+]?[.\d][-+.,\deE]*,?")
"""A word of numbers with commas between them, perhaps behind a name, such as `P1=0,0,120`.

An option such as `--load-point=0,0,120` is no such word."""


def _refuse_split_vectors(command: Any, words: list[str]) -> None:  # noqa: ANN401 - Typer's Click is private
    """Refuse the numbers of a vector in several words: the parser takes only the first word.

    Raises:
        typer.BadParameter: there is such a vector before `--`.
    """
    vectors = {
        flag
        for parameter in getattr(command, "params", ())
        for flag in parameter.opts
        if re.search(",|NUMBERS", parameter.metavar or "")
    }
    for start, flag in enumerate(words[: words.index("--") if "--" in words else None]):
        if flag not in vectors:
            continue
        numbers = list(takewhile(_NUMBERS.fullmatch, words[start + 1 :]))
        if len(numbers) > 1:
            text = ",".join(number.strip(",") for number in numbers)
            reason = f"the numbers are one text, with commas and without blanks: {flag} {text}"
            raise typer.BadParameter(reason, param_hint=flag)


def _refuse_split_names(words: list[str]) -> None:
    """Refuse the words of a file's name that has blanks, but was given without quotes.

    Raises:
        typer.BadParameter: consecutive words are the name of a file, but the first word is no file.
    """
    for start, first in enumerate(words):
        if first.startswith("-") or _exists(first):
            continue
        for end in range(start + 2, min(len(words), start + _MOST_WORDS) + 1):
            name = " ".join(words[start:end])
            if _exists(name):
                raise typer.BadParameter(f"a name with blanks needs quotes: {shlex.quote(name)}")


def _exists(word: str) -> bool:
    """Return whether a word names a file or a folder; a long text names none."""
    try:
        return Path(word).exists()
    except OSError:
        return False


_MOST_WORDS: Final = 8
"""Words of a name of a file, at most."""

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
app.command()(rehearse)
for _command, _summary in _LATE_COMMANDS.items():
    app.command(_command, help=_summary)(lambda: None)  # placeholder in the list of commands
for _function in (robots, export, report, serve, worker, status, post, demo, archive, restore):
    app.command()(_function)
app.add_typer(keys, name="keys")
app.add_typer(database, name="database")


def _print_version(value: bool) -> None:
    """Print the version and end the command if --version is given."""
    if value:
        from jointstiff.service.process import jointstiff_version

        typer.echo(f"jointstiff {jointstiff_version()}")
        raise typer.Exit


@app.callback()
def options(
    *,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and end."),
    ] = False,
) -> None:
    """Declare the options of `jointstiff` itself; Typer calls this function before each command."""
