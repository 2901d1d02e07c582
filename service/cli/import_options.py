"""Name the options of `jointstiff import` in messages that name the fields of the API."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from jointstiff.schemas.problem import Problem

_OPTIONS: Final = {
    "units": "--units",
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
    return problem.model_copy(update={"where": where, "detail": options_for_fields(detail), "remedy": remedy})
