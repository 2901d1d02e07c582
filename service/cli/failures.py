"""Errors with a remedy, printed in the words of the command line."""

from __future__ import annotations

import re
from ast import literal_eval
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import typer

from jointstiff.service.cli.fields import name_options_in_text
from jointstiff.service.cli.options import describe_missing_file, print_failure

if TYPE_CHECKING:
    from jointstiff.schemas.finding import Problem


_ARGUMENT_IN_TEXT: Final = re.compile(r"`(\w+)`")
_FOLDER: Final = re.compile(r"file ('.*'|\".*\") is a directory\.", re.DOTALL)
"""Message of Typer about a folder in place of a file; it has the name as Python writes a text."""
_NONE: Final[Mapping[str, str]] = MappingProxyType({})


def reword_usage_error(error: Any, command: str | None) -> None:  # noqa: ANN401 - Typer's Click is private
    """Give an error of Typer a message that says what to do; leave other errors as they are.

    `command` is the name of the command that was called.
    """
    if isinstance(error, typer.BadParameter):
        _name_wrong_value(error)
    is_unknown_option = hasattr(error, "possibilities") and hasattr(error, "option_name")
    if is_unknown_option:
        _name_meant_field(error, command)


def _name_wrong_value(error: typer.BadParameter) -> None:
    """Name the value in the message about a value that Typer could not convert, in the project's words."""
    from pydantic import ValidationError

    from jointstiff.service.problems import reword_fault

    if folder := _FOLDER.fullmatch(error.message):
        error.message = describe_missing_file(Path(literal_eval(folder[1]))) or error.message
    cause = error.__cause__
    if isinstance(cause, ValidationError) and error.param is not None:
        fault = cause.errors()[0]
        words = reword_fault(fault)
        error.message = words if fault["type"] == "value_error" else f"'{fault['input']}' {words}"


def _name_meant_field(error: Any, command: str | None) -> None:  # noqa: ANN401 - Typer's Click is private
    """Name what is meant in the message about an unknown option, if the command's request has such a field.

    The message names the option of the field; a field without an option is stated in a file of options.
    """
    from jointstiff.service.cli.fields import field_options, option_flag
    from jointstiff.service.kinds.rooms import ROOMS, import_kind
    from jointstiff.service.problems import NAMES_ELSEWHERE

    kind_name = next((name for name, room in ROOMS.items() if room.command == command), None)
    if kind_name is None:
        return
    message_class = import_kind(kind_name).options
    stated = error.option_name.lstrip("-").replace("-", "_")
    name = NAMES_ELSEWHERE.get(stated, stated)
    if name not in message_class.model_fields:
        return
    if name in dict(field_options(message_class)):
        error.possibilities = [option_flag(message_class, name)]
    else:
        error.possibilities = None
        error.message += f". State `{name}` in a JSON file, and give the file by --options"


def print_known_error(error: Exception, option_names: Mapping[str, str]) -> typer.Exit | None:
    """Print an error that has a remedy; return the exit to raise (status 2).

    None, and nothing is printed, for an unexpected error, which has no remedy.

    Args:
        error: the error of a command.
        option_names: options of the command by the name of the argument of Python, such as `robot`.
    """
    from jointstiff.service.problems import ProblemError, ServiceError, problem_from_error

    if isinstance(error, OSError) and error.filename is not None and not isinstance(error, ProblemError):
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
