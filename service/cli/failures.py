"""Errors with a remedy, printed in the words of the command line."""

from __future__ import annotations

import re
from ast import literal_eval
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import typer

from jointstiff.service.cli.fields import name_options_in_text
from jointstiff.service.cli.options import UnknownWordError, describe_missing_file, print_failure

if TYPE_CHECKING:
    from jointstiff.schemas.finding import Problem


_ARGUMENT_IN_TEXT: Final = re.compile(r"`(\w+)`")
_EXTRA_ARGUMENTS: Final = re.compile(r"Got unexpected extra arguments?(?:\(s\))? \((.*)\)", re.DOTALL)
"""Message of Typer about more arguments than the command has, with these arguments."""
_MORE_FILES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "identify": "Give one campaign: `jointstiff compare` takes two",
        "compare": "Give one or two campaigns",
        "robots": "Write the name of the arm in quotes: jointstiff robots 'KUKA KR'",
    }
)
"""Command → what to do with more files than the command has."""
_OPTIONS_OF_VALUES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "archive": "--database",
        "identify": "--leave-out",
        "map": "--options",
        "plan": "--readings",
        "predict": "--output",
        "post": "--server",
        "serve": "--port",
        "status": "--database",
        "worker": "--database",
    }
)
"""Command → option whose value is given without its name."""
_SHORT_OPTIONS: Final[Mapping[str, str]] = MappingProxyType({"-h": "--help", "-v": "--version"})
"""Short options of other programs → ours."""
_FOLDER: Final = re.compile(r"file ('.*'|\".*\") is a directory\.", re.DOTALL)
"""Message of Typer about a folder in place of a file; it has the name as Python writes a text."""
_NONE: Final[Mapping[str, str]] = MappingProxyType({})


def name_meant_command(error: Any, words: Sequence[str], commands: Sequence[str]) -> None:  # noqa: ANN401
    """Name the command that is meant in Typer's message about an unknown command.

    Args:
        error: error of Typer; others are left as they are.
        words: words of the command line; the first is no command.
        commands: names of the commands.
    """
    if not isinstance(getattr(error, "message", None), str) or not words or words[0] in commands:
        return
    unknown = f"No such command {words[0]!r}"
    if words[0] in {"help", "version"}:
        error.message = f"{unknown}. Did you mean 'jointstiff --{words[0]}'?"
    elif Path(words[0]).is_file():
        error.message = f"{unknown}: it is a file. Give the command first: jointstiff identify {words[0]}"


def reword_usage_error(
    error: Any,  # noqa: ANN401 - Typer's Click is private
    command: str | None,
    list_flags: Callable[[], Mapping[str, Mapping[str, str]]],
) -> None:
    """Give an error of Typer a message that says what to do; leave other errors as they are.

    Args:
        error: error of Typer.
        command: name of the command that was called.
        list_flags: function that returns command → option → form of its value, of all commands.
    """
    if isinstance(error, typer.BadParameter):
        _name_wrong_value(error)
    is_unknown_option = hasattr(error, "possibilities") and hasattr(error, "option_name")
    if is_unknown_option:
        error.possibilities = None  # options with a few letters in common, of any meaning
        if error.option_name in _SHORT_OPTIONS:
            error.possibilities = [_SHORT_OPTIONS[error.option_name]]
        elif command is None:
            error.message += (
                ". Give the options of a command after its name: jointstiff COMMAND FILE --OPTION"
            )
        elif not _name_meant_field(error, command):
            _name_meant_option(error, command, list_flags())
    elif command is not None and (extra := _EXTRA_ARGUMENTS.match(str(getattr(error, "message", "")))):
        error.message += f". {_advise_extra_argument(error.ctx.params, command, extra[1].split())}"


_TABLES: Final = frozenset((".csv", ".tsv", ".txt", ".xlsx", ".mat", ".npz", ".h5", ".parquet"))
"""Endings of files that `jointstiff import` reads."""


def _advise_extra_argument(given: Mapping[str, object], command: str, extra: Sequence[str]) -> str:
    """Return what to do with arguments that a command does not have.

    Args:
        given: arguments and options of the command, by name.
        command: name of the command.
        extra: further words of the command line.
    """
    word = extra[0]
    files = [str(value) for value in given.values() if isinstance(value, Path)] + [*extra]
    table = next((file for file in files if Path(file).suffix.lower() in _TABLES), None)
    if command == "identify" and table is not None:
        return (
            f"{table} is a table: `jointstiff import {table} --robot ROBOT --output CAMPAIGN.json` reads it"
        )
    if command == "identify" and given.get("as_json") and not Path(word).exists():
        return f"--json prints the result; --save {word} writes it"
    if Path(word).exists() and command in _MORE_FILES:
        return _MORE_FILES[command]
    if command in _OPTIONS_OF_VALUES:
        listed = ",".join(extra)
        return (
            f"Give a value after the name of its option, and a list with commas, such as "
            f"{_OPTIONS_OF_VALUES[command]} {listed}"
        )
    return _MORE_FILES.get(command, f"`jointstiff {command} --help` lists arguments and options")


def _name_wrong_value(error: typer.BadParameter) -> None:
    """Name the value in the message about a value that Typer could not convert, in the project's words."""
    from pydantic import ValidationError

    from jointstiff.service.problems import reword_fault

    if folder := _FOLDER.fullmatch(error.message):
        error.message = describe_missing_file(Path(literal_eval(folder[1]))) or error.message
    explanation = getattr(error.param, "help", None)
    if isinstance(error, UnknownWordError) and explanation:
        error.message += f" {explanation}"
    cause = error.__cause__
    if isinstance(cause, ValidationError) and error.param is not None:
        fault = cause.errors()[0]
        words = reword_fault(fault)
        error.message = words if fault["type"] == "value_error" else f"'{fault['input']}' {words}"


_MAX_COMMANDS: Final = 3
"""Number of commands with an option that an error names."""


def _name_meant_option(
    error: Any,  # noqa: ANN401 - Typer's Click is private
    command: str,
    flags: Mapping[str, Mapping[str, str]],
) -> None:
    """Name an option of the command with a similar name, or the commands with this option.

    Without either, name the list of the command's options. What is stated for an import is in the campaign
    afterwards, so that no later command has an option for it.
    """
    from jointstiff.service.problems import find_similar_name

    flag = error.option_name
    stated = flag.lstrip("-")
    if command == "predict" and stated in {"force", "forces"}:
        error.message += ". State forces in the columns Fx [N], Fy [N] and Fz [N] of the table POSTURES"
        return
    if stated in _REPORTS:
        error.message += f". `{_REPORTS[stated]}` writes such a file"
        return
    own = flags.get(command, {})
    if flag in own:  # an abbreviation, or a value that is refused elsewhere
        return
    words = {name.lstrip("-").replace("-", "_"): name for name in own}
    similar = find_similar_name(stated, words)
    having = [name for name, known in flags.items() if flag in known]
    if similar is not None:
        error.possibilities = [words[similar]]
        return
    if not having:
        error.message += f". `{error.ctx.command_path} --help` lists the options"
        return
    if "import" in having and flag in _STATED_IN_CAMPAIGN:
        value = " ".join(filter(None, [flag, flags["import"][flag]]))
        error.message += (
            f". The campaign states it: import the readings again, `jointstiff import READINGS {value}`, or "
            f"change `{_STATED_IN_CAMPAIGN[flag]}` in the campaign's file"
        )
        return
    shown = ", ".join(f"`jointstiff {name}`" for name in having[:_MAX_COMMANDS])
    more = f" and {len(having) - _MAX_COMMANDS} more commands" if len(having) > _MAX_COMMANDS else ""
    error.message += f". {flag} is an option of {shown}{more}"


_REPORTS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "html": "jointstiff report FILE -o report.html",
        "pdf": "jointstiff report FILE -o report.pdf",
        "csv": "jointstiff export FILE -o model.csv",
        "xlsx": "jointstiff export FILE -o model.xlsx",
    }
)
"""Name of an option that no command has → command that writes such a file."""
_STATED_IN_CAMPAIGN: Final[Mapping[str, str]] = MappingProxyType(
    {
        "--robot": "robot",
        "--encoders": "measurement_set.encoders",
        "--load-point": "measurement_set.load_point",
        "--load-point-target": "measurement_set.load_point_target",
        "--flange-target": "measurement_set.flange_targets",
        "--sigma": "measurement_set.noise.sigma",
        "--ground": "measurement_set.noise.grounds",
    }
)
"""Option of `import` → where the campaign states its value."""


_EXAMPLES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "area": '{"area": [[1.2, -0.6, 0.4], [2.0, 0.6, 0.8]]} in m',
        "grid": '{"grid": [3, 3, 1]}',
    }
)
"""Field that has no option → its form in a file."""


def _name_meant_field(error: Any, command: str | None) -> bool:  # noqa: ANN401 - Typer's Click is private
    """Name what is meant in the message about an unknown option, if the command's request has such a field.

    The message names the option of the field; a field without an option is stated in a file of options. The
    answer is whether the request has such a field.
    """
    from jointstiff.service.cli.fields import field_options, option_flag
    from jointstiff.service.kinds.rooms import ROOMS, import_kind

    kind_name = next((name for name, room in ROOMS.items() if room.command == command), None)
    if kind_name is None:
        return False
    message_class = import_kind(kind_name).options
    name = error.option_name.lstrip("-").replace("-", "_")
    if name not in message_class.model_fields:
        return False
    if name in dict(field_options(message_class)):
        error.possibilities = [option_flag(message_class, name)]
    else:
        error.possibilities = None
        example = f", such as {_EXAMPLES[name]}" if name in _EXAMPLES else ""
        error.message += f". State `{name}` in a JSON file{example}, and give the file by --options"
    return True


def print_known_error(error: Exception, option_names: Mapping[str, str]) -> typer.Exit | None:
    """Print an error that has a remedy; return the exit to raise (status 2).

    None, and nothing is printed, for an unexpected error, which has no remedy.

    Args:
        error: the error of a command.
        option_names: options of the command by the name of the argument of Python, such as `robot`.
    """
    from jointstiff.service.problems import (
        ContentError,
        MissingFolderError,
        ProblemError,
        ServiceError,
        is_content,
        problem_from_error,
    )

    if isinstance(error, OSError) and isinstance(error.filename, str) and is_content(error.filename):
        return print_problem(ContentError(error.filename).problem)
    if isinstance(error, OSError) and error.filename is not None and not isinstance(error, ProblemError):
        missing = isinstance(error, FileNotFoundError) and not Path(error.filename).parent.is_dir()
        if missing:
            return print_problem(MissingFolderError(Path(error.filename)).problem)
        return print_failure(f"cannot write {error.filename}: {error.strerror}", "choose another path")
    if isinstance(error, ImportError):
        from jointstiff.service.problems import explain_missing_library

        error = explain_missing_library("this command", error)
    if not type(error).__module__.startswith("jointstiff."):
        return None
    from jointstiff.solver.errors import RequestError

    if isinstance(error, ProblemError):
        return print_problem(error.problem, option_names)
    if isinstance(error, RequestError):
        return print_problem(problem_from_error(error), option_names)
    return print_failure(error.reason, error.remedy) if isinstance(error, ServiceError) else None


def print_problem(problem: Problem, option_names: Mapping[str, str] = _NONE) -> typer.Exit:
    """Print the problem details of a request; return the exit to raise (status 2).

    In the remedy, arguments of Python in backquotes become options of the command.
    """
    from jointstiff.schemas.finding import AcceptingOptions
    from jointstiff.service.tables.terminal import console, problem_text

    remedy = problem.remedy and name_options_in_text(AcceptingOptions, problem.remedy)
    remedy = remedy and _ARGUMENT_IN_TEXT.sub(lambda match: option_names.get(match[1], match[0]), remedy)
    console(stderr=True).print(problem_text(problem.model_copy(update={"remedy": remedy})))
    return typer.Exit(2)
