"""Options of `jointstiff import`: each once, with its flag, its field and how it is read."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from jointstiff.service.cli.options import EncoderChoice, vector_of

if TYPE_CHECKING:
    from jointstiff.schemas.problem import Problem

Options = dict[str, Any]


def _pairs(texts: list[str]) -> dict[str, str]:
    """Return `KEY=VALUE` texts as a dictionary; a key may contain `=`."""
    pairs = {}
    for text in texts:
        key, equals, value = text.rpartition("=")
        if not equals:
            raise typer.BadParameter(f"'{text}' has no '='")
        pairs[key.strip()] = value.strip()
    return pairs


def _units(text: str) -> dict[str, str]:
    return _pairs([part for part in text.split(",") if part])


def _targets(texts: list[str]) -> dict[str, tuple[float, ...]]:
    return {target: vector_of(text) for target, text in _pairs(texts).items()}


def _cells(text: str) -> list[str]:
    return [cell.strip() for cell in text.split(";")]


@dataclass(frozen=True)
class ImportOption:
    """One option of the command."""

    flag: str  # as it is typed
    help: str  # for people
    metavar: str | None = None  # form of its value, with the unit
    type: object = str | None  # as Typer takes it
    read: Callable[[Any], object] = lambda value: value  # from what is typed to the field of the request


_TEXTS: Final = list[str] | None
OPTIONS: Final[Mapping[str, ImportOption]] = {
    "units": ImportOption(
        "--units",
        "Units of columns whose header has none; add moment=N.m if there are moments.",
        "length=mm,angle=deg,force=N",
        read=_units,
    ),
    "columns": ImportOption(
        "--column",
        "Meaning of a whole header, such as 'Winkel A=J1 [deg]' or 'shift=ignore'. Repeatable.",
        "HEADER=MEANING",
        _TEXTS,
        _pairs,
    ),
    "ignore": ImportOption("--ignore", "Header of a column to ignore. Repeatable.", "HEADER", _TEXTS),
    "point_name": ImportOption(
        "--point-name", "Template of point names, such as '{label}_{target}_{state}'.", "TEMPLATE"
    ),
    "file_name": ImportOption(
        "--file-name", "Template of file names, such as '{target}_{state}', without .txt.", "TEMPLATE"
    ),
    "state_words": ImportOption(
        "--state-word",
        "Extra word for a state, such as 150kg=loaded. Repeatable.",
        "WORD=STATE",
        _TEXTS,
        _pairs,
    ),
    "delimiter": ImportOption("--delimiter", "Cell delimiter: comma, semicolon, tab or whitespace.", "NAME"),
    "decimal_mark": ImportOption("--decimal-mark", "Decimal mark: point or comma.", "NAME"),
    "header": ImportOption(
        "--header", "Header for files without one, cells separated by semicolons.", "'A;B;C'", read=_cells
    ),
    "sheet": ImportOption("--sheet", "Sheet of an Excel file."),
    "by_order": ImportOption("--by-order", "Match rows of files without names by their order.", type=bool),
    "allow_missing": ImportOption("--allow-missing", "Skip incomplete readings, and list them.", type=bool),
    "accept_unusual": ImportOption(
        "--accept-unusual",
        "Accept values far from all others of their column, and a load point more than 5 m from the flange.",
        type=bool,
    ),
    "encoders": ImportOption(
        "--encoders",
        "Encoders that close the position loop: motor or secondary.",
        type=EncoderChoice | None,
    ),
    "name": ImportOption("--name", "Name of the measurement set; default: name of the first file."),
    "noise": ImportOption(
        "--sigma",
        "Standard uncertainty of a coordinate, in mm.",
        "MM",
        float | None,
        lambda sigma: {"sigma": sigma},
    ),
    "load_point": ImportOption(
        "--load-point",
        "Point where the force acts, in the flange frame, in mm.",
        "X,Y,Z[mm]",
        read=vector_of,
    ),
    "force": ImportOption(
        "--force",
        "Force in every observation, axes of R0, in the unit of --units force=…, if no column has it.",
        "X,Y,Z[force]",
        read=vector_of,
    ),
    "flange_targets": ImportOption(
        "--flange-target",
        "Target's position in the flange frame, in mm, for deflections. Repeatable.",
        "TARGET=X,Y,Z[mm]",
        _TEXTS,
        _targets,
    ),
}
LENGTHS: Final = frozenset(("noise", "load_point", "flange_targets"))
"""Fields that are typed in mm."""
_PATH: Final = re.compile(rf"^({'|'.join(OPTIONS)})\b\.?")
_FIELD: Final = re.compile(rf"`({'|'.join(OPTIONS)})`")


def with_import_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command an option for each field of the request; it is called with `chosen` in their place."""

    def called(**given: Any) -> None:  # noqa: ANN401 - what Typer found
        command(chosen=options_of({name: given.pop(name) for name in OPTIONS}), **given)

    signature = inspect.signature(command)
    parameters = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=False if option.type is bool else None,
            annotation=Annotated[
                option.type,
                typer.Option(option.flag, metavar=option.metavar, help=option.help),
            ],
        )
        for name, option in OPTIONS.items()
    ]
    others = [parameter for name, parameter in signature.parameters.items() if name != "chosen"]
    called.__signature__ = signature.replace(parameters=[others[0], *parameters, *others[1:]])  # type: ignore[attr-defined]
    called.__doc__ = command.__doc__
    called.__name__ = command.__name__
    return called


def options_of(given: Mapping[str, Any]) -> Options:
    """Return what was typed as fields of the request; what was not is left out.

    Raises:
        typer.BadParameter: a text is not of the form that its option needs.
    """
    stated: Options = {}
    for name, value in given.items():
        if value is None or value is False or value == []:
            continue
        try:
            stated[name] = OPTIONS[name].read(value)
        except typer.BadParameter as error:
            raise typer.BadParameter(error.message, param_hint=OPTIONS[name].flag) from None
    return stated


def with_length_unit(stated: Options, template: Options) -> Options:
    """Return options with their lengths, which are in mm, in the unit of a template's lengths."""
    unit = template.get("length_unit", "mm")
    if not LENGTHS & stated.keys():
        return stated
    if unit == "m":
        scaled = {name: _in_metres(value) for name, value in stated.items() if name in LENGTHS}
        return {**stated, **scaled, "length_unit": "m"}
    return {**stated, "length_unit": "mm"}


def _in_metres(value: Any) -> Any:  # noqa: ANN401 - numbers, in tuples or dictionaries
    if isinstance(value, dict):
        return {key: _in_metres(part) for key, part in value.items()}
    return tuple(map(_in_metres, value)) if isinstance(value, tuple | list) else value / 1e3


def options_for_fields(text: str) -> str:
    """Return a message with the options in place of the fields."""
    return _FIELD.sub(lambda match: f"`{OPTIONS[match[1]].flag}`", text)


def in_options(problem: Problem) -> Problem:
    """Return a problem that names the options in place of the fields."""
    where, detail = problem.where, problem.detail
    if where is not None and problem.type.endswith("invalid-request"):  # elsewhere it names a file
        option = _PATH.sub(lambda match: f"{OPTIONS[match[1]].flag} ", where).rstrip()
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
