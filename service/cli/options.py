"""Arguments and options that commands share, with their help; and how they refuse."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, get_args, get_type_hints

import typer

if TYPE_CHECKING:
    pass


def parse_vector(text: str, unit: str = "") -> tuple[float, ...]:
    """Parse the text `X,Y,Z` into three numbers; `unit` is their unit in the error, if it is known.

    Raises:
        typer.BadParameter: the text is not three numbers with commas between them.
    """
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        unit_words = f" in {unit}" if unit else ""
        raise typer.BadParameter(f"'{text}' must be three numbers{unit_words}, such as 0,0,120.5") from None
    return x, y, z


def parse_point(text: str) -> tuple[float, ...]:
    """Parse the text `X,Y,Z` in mm into a point in m; raise the errors of `parse_vector`."""
    return tuple(1e-3 * number for number in parse_vector(text, "mm"))


def file_argument(metavar: str, text: str) -> Any:  # noqa: ANN401 - Typer's
    """Return a Typer argument whose value is the path of an existing file to read, or several paths."""
    return typer.Argument(dir_okay=False, callback=_refuse_missing_files, metavar=metavar, help=text)


def file_option(text: str) -> Any:  # noqa: ANN401 - Typer's
    """Return a Typer option whose value is the path of an existing file to read."""
    return typer.Option(dir_okay=False, callback=_refuse_missing_files, metavar="FILE", help=text)


def _refuse_missing_files(value: Any) -> Any:  # noqa: ANN401 - of an argument: a path, several, or None
    """Return the value of an argument for files; the error about a missing file names a similar one.

    Raises:
        typer.BadParameter: a path is no file that can be read. Typer has refused folders before.
    """
    for path in value if isinstance(value, list | tuple) else [value]:
        if isinstance(path, Path) and (fault := describe_missing_file(path)):
            raise typer.BadParameter(fault)
    return value


def describe_missing_file(path: Path) -> str | None:
    """Return why a path is no file to read, and which file may be meant; None for a file."""
    from jointstiff.service.problems import (
        GIVE_NAME,
        describe_content,
        find_similar_file,
        is_content,
        list_files,
    )

    if is_content(str(path)):
        return f"{describe_content(str(path))}; {GIVE_NAME}"
    if path.is_dir():
        return f"'{path}' is a folder; give a file in it{list_files(path)}"
    if not path.exists():
        from jointstiff.service.resources.documents import explain_arm

        if str(path) == "-":
            return "'-' is no file; give /dev/stdin to read the standard input"
        if arm := explain_arm(str(path)):
            return f"{arm.detail}; {arm.remedy}"
        similar = find_similar_file(path)
        remedy = f"give {similar}" if similar else "give the name of a file that exists"
        return f"file '{path}' does not exist; {remedy}"
    return None if os.access(path, os.R_OK) else f"file '{path}' is not readable; change its permissions"


def output_option(text: str, metavar: str = "FILE") -> Any:  # noqa: ANN401 - Typer's
    """Return the Typer option `--output`, which names the main file to write."""
    return typer.Option("--output", "-o", metavar=metavar, help=text)


REPORTS: Final = (".pdf", ".html")
"""Endings of reports."""


def check_ending(
    path: Path,
    endings: Iterable[str],
    *,
    option: str = "--output",
    reported: bool = False,
    saved: bool = False,
) -> None:
    """Check that the name of a file to write has one of the endings, such as `.json`.

    Args:
        path: file to write.
        endings: allowed endings.
        option: option that names the file.
        reported: whether the error about a `.pdf` or `.html` file refers to `jointstiff report`, which writes
            such files.
        saved: whether the error about a `.json` file refers to `--save`, which writes such a file.

    Raises:
        typer.BadParameter: the file has another ending.
    """
    allowed = list(dict.fromkeys(endings))
    if path.suffix.lower() in allowed:
        return
    list_of_endings = " or ".join(filter(None, [", ".join(allowed[:-1]), allowed[-1]]))
    hint = ""
    if reported and path.suffix.lower() in REPORTS:
        hint = "; `jointstiff report` writes reports"
    if saved and path.suffix.lower() == ".json":
        hint = f"; `--save {path.name}` writes the whole result"
    raise typer.BadParameter(f"'{path.name}' must end in {list_of_endings}{hint}", param_hint=option)


def path_option(text: str, metavar: str = "FILE") -> Any:  # noqa: ANN401 - Typer's
    """Return a Typer option whose value is the path of a further file to write, other than `--output`."""
    return typer.Option(dir_okay=False, metavar=metavar, help=text)


def write_text(path: Path, text: str) -> None:
    """Write a text, and a line break after it, to a UTF-8 file."""
    path.write_text(f"{text}\n", encoding="utf-8")


def write_json(path: Path, document: object) -> None:
    """Write a document to a JSON file with indented lines, which people can read."""
    write_text(path, _to_json(document))


def has_content(path: Path, document: object) -> bool:
    """Return whether a file is what `write_json` would write."""
    return path.is_file() and path.read_bytes() == f"{_to_json(document)}\n".encode()


def _to_json(document: object) -> str:
    """Return a document as JSON with indented lines."""
    import json

    return json.dumps(document, indent=1, ensure_ascii=False)


CampaignFile = Annotated[
    Path,
    file_argument("FILE", "Campaign file: robot, measurement set and run options in one JSON document."),
]
RunFile = Annotated[
    Path | None,
    file_option(
        "File of the campaign's run, as `identify --json` prints the run; default: identify the campaign now."
    ),
]
NamedRobot = Annotated[
    str | None,
    typer.Option(
        metavar="ROBOT",
        help='File of a robot or campaign, or name of an arm in the catalogue, such as "KUKA KR 210 R2700". '
        "`jointstiff robots` lists the arms.",
    ),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace existing files.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
Details = Annotated[bool, typer.Option("--details", help="Print all reasons, warnings, advice and evidence.")]
ServerAddress = Annotated[
    str, typer.Option(envvar="JOINTSTIFF_SERVER", metavar="ADDRESS", help="Address of a running service.")
]


Units = Literal["MNm/rad", "Nm/arcmin"]


class UnknownWordError(typer.BadParameter):
    """Error of a text that is none of the words of an option, which the option's help explains."""

    def __init__(self, text: str, words: Iterable[str]) -> None:
        """Name the text and the words."""
        super().__init__(f"{text!r} is not one of {', '.join(map(repr, words))}.")


def _parse_unit(text: str) -> str:
    """Return the unit of stiffness that a text names, in any mixture of upper and lower case.

    Raises:
        typer.BadParameter: the text names no unit of stiffness.
    """
    words: tuple[str, ...] = get_args(Units)
    unit = next((word for word in words if word.lower() == text.lower()), None)
    if unit is None:
        raise UnknownWordError(text, words)
    return unit


Unit = Annotated[
    Units,
    typer.Option(
        parser=_parse_unit,
        metavar=f"<{'|'.join(get_args(Units))}>",
        autocompletion=lambda: list(get_args(Units)),
        help="Unit of stiffness in the tables: 10⁶ N·m/rad or N·m/arcmin.",
    ),
]


Parameters = Mapping[str, tuple[Any, Any]]
"""Annotation and default of the parameters of a command, by name; `...` for no default."""


def set_signature(command: Callable[..., None], parameters: Parameters) -> None:
    """Set the keyword parameters of a function, from which Typer makes the options of its command."""
    command.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                annotation=annotation,
                default=inspect.Parameter.empty if default is ... else default,
            )
            for name, (annotation, default) in parameters.items()
        ]
    )


def options_from_settings(settings: type) -> Parameters:
    """Return name → (annotation, default) of the parameters of a command, one for each dataclass field."""
    hints = get_type_hints(settings, include_extras=True)
    return {field.name: (hints[field.name], field.default) for field in fields(settings)}


def print_failure(reason: str, remedy: str) -> typer.Exit:
    """Print the reason of a failure and the remedy; return the exit to raise (status 2)."""
    from jointstiff.service.tables.terminal import console

    console(stderr=True).print(f"{reason}\n  remedy: {remedy}", style="red", markup=False, soft_wrap=True)
    return typer.Exit(2)


def warn(message: str) -> None:
    """Print a message in yellow to the standard error; the command continues."""
    from jointstiff.service.tables.terminal import console

    console(stderr=True).print(message, style="yellow", markup=False, soft_wrap=True)


WRITTEN: Final = frozenset({"output", "save", "save_mapping", "report", "paper", "campaign"})
"""Names of the options that name a file to write."""


def list_inputs(values: Mapping[str, object]) -> list[object]:
    """Return the values of a command's arguments and options that may name a file to read."""
    inputs = list[object]()
    for name, value in values.items():
        if name not in WRITTEN:
            inputs += value if isinstance(value, list | tuple) else [value]
    return inputs


def refuse_existing(path: Path, *, overwrite: bool, inputs: Iterable[object] = ()) -> None:
    """Refuse to replace an input, and an existing file unless the option --overwrite was given.

    Args:
        path: file to write.
        overwrite: whether the option --overwrite was given.
        inputs: values of the command; texts and paths among them may name files that the command reads.

    Raises:
        typer.Exit: the file exists.
    """
    if not path.exists():
        return
    if any(_is_same_file(path, value) for value in inputs):
        raise print_failure(
            f"{path} is an input of this command; its content would be lost",
            "choose another name or another folder for the file to write",
        )
    if not overwrite:
        raise print_failure(f"{path} exists", "choose another name, or use --overwrite")


def _is_same_file(path: Path, value: object) -> bool:
    """Return whether a value of a command names a certain regular file, perhaps by another path."""
    if not isinstance(value, str | Path):
        return False
    try:
        return path.is_file() and path.samefile(value)
    except (OSError, ValueError):  # a text that names no file
        return False
