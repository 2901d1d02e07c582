"""Options of `jointstiff import`: their values, and their names in messages that name fields of the API."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import typer

if TYPE_CHECKING:
    from jointstiff.schemas.problem import Problem

_OPTIONS: Final = {
    "units": "--units",
    "columns": "--column",
    "by_order": "--by-order",
    "force": "--force",
    "point_name": "--point-name",
    "file_name": "--file-name",
    "state_words": "--state-word",
    "delimiter": "--delimiter",
    "decimal_mark": "--decimal-mark",
    "header": "--header",
    "ignore": "--ignore",
    "sheet": "--sheet",
    "allow_missing": "--allow-missing",
    "encoders": "--encoders",
    "load_point": "--load-point",
    "flange_targets": "--flange-target",
    "noise": "--sigma",
}
_XYZ: Final = 3
_PATH: Final = re.compile(rf"^({'|'.join(_OPTIONS)})\b\.?")
_FIELD: Final = re.compile(rf"`({'|'.join(_OPTIONS)})`")


def options_for_fields(text: str) -> str:
    """Return a message with the options in place of the fields."""
    return _FIELD.sub(lambda found: f"`{_OPTIONS[found[1]]}`", text)


def in_options(problem: Problem) -> Problem:
    """Return a problem that names the options in place of the fields."""
    where, detail = problem.where, problem.detail
    if where is not None and problem.type.endswith("invalid-request"):  # elsewhere it names a file
        option = _PATH.sub(lambda found: f"{_OPTIONS[found[1]]} ", where).rstrip()
        where, detail = option, detail.replace(where, option)
    remedy = None if problem.remedy is None else options_for_fields(problem.remedy)
    items = [
        item.model_copy(
            update={
                "reason": options_for_fields(item.reason),
                "remedy": None if item.remedy is None else options_for_fields(item.remedy),
            }
        )
        for item in problem.errors
    ]
    changes = {"where": where, "detail": options_for_fields(detail), "remedy": remedy, "errors": items}
    return problem.model_copy(update=changes)


def pairs_of(texts: Sequence[str] | None, option: str) -> dict[str, str]:
    """Return `KEY=VALUE` texts as a dictionary.

    Raises:
        typer.BadParameter: one has no `=`.
    """
    found = {}
    for text in texts or ():
        key, equals, value = text.rpartition("=")
        if not equals:
            raise typer.BadParameter(f"'{text}' has no '='", param_hint=option)
        found[key.strip()] = value.strip()
    return found


def vector_of(text: str, option: str) -> list[float]:
    """Return `X,Y,Z` as three numbers.

    Raises:
        typer.BadParameter: it is no such text.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != _XYZ:
        raise typer.BadParameter(f"'{text}' must be three numbers, such as 0,0,120.5", param_hint=option)
    return numbers
