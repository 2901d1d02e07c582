"""Errors with a remedy, printed in the words of the command line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import typer

from jointstiff.service.cli.fields import name_options_in_text
from jointstiff.service.cli.options import print_failure

if TYPE_CHECKING:
    from jointstiff.schemas.finding import Problem


_ARGUMENT_IN_TEXT: Final = re.compile(r"`(\w+)`")
_NONE: Final[Mapping[str, str]] = MappingProxyType({})


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
