"""Report of an import for people, and its questions at a terminal: one for each thing that is missing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import typer

from jointstiff.service.cli.options import vector_of

if TYPE_CHECKING:
    from jointstiff.schemas.importing import FilePreview
    from jointstiff.schemas.imports import ImportAnswer
    from jointstiff.service.tables.table import Line, Part

Options = dict[str, Any]
"""Fields of the request of an import."""
_LONGEST: Final = 24
_LINES_SHOWN: Final = 8
_STATES: Final = ("unloaded", "loaded", "deflection")
_CHOICES: Final[Mapping[str, tuple[str, tuple[str, ...], str | None]]] = {
    "units.length": ("Unit of lengths", ("m", "mm", "in"), "mm"),
    "units.angle": ("Unit of angles", ("rad", "deg"), "deg"),
    "units.force": ("Unit of forces", ("N", "kN", "kgf"), "N"),
    "units.moment": ("Unit of moments", ("N.m", "N.mm", "kN.m", "kgf.m"), "N.m"),
    "delimiter": ("Delimiter between cells", ("comma", "semicolon", "tab", "whitespace"), None),
    "decimal_mark": ("Decimal mark", ("point", "comma"), None),
    "encoders": ("Encoders that close the position loop", ("motor", "secondary"), "motor"),
}
"""Text, answers and default; without a default where a wrong one would read other numbers."""


def may_ask() -> bool:
    """Return whether a person is there to answer."""
    return sys.stdin.isatty()


def ask(answer: ImportAnswer, asked: set[str]) -> Options:
    """Ask for what is missing in an answer.

    Args:
        answer: with faults and missing fields.
        asked: options that were asked for before, which are not asked again; extended.

    Returns:
        The options of the API that were answered; empty if nothing remains to be asked.
    """
    given: Options = {}
    faults = [fault.option for fault in answer.faults if fault.option is not None]
    for option in dict.fromkeys([*faults, *answer.missing_fields]):
        for name, question in _questions(option, answer):
            if name not in asked:
                asked.add(name)
                value = question()
                key, _, inner = name.partition(".")
                if inner:
                    given.setdefault(key, {})[inner] = value
                else:
                    given[key] = value
    return given


def ask_robot() -> str | None:
    """Ask for the robot: its file, or the name of an arm of the catalogue."""
    text: str = typer.prompt(
        "Measured robot, for the integrity checks: file or arm", default="none", err=True
    )
    return None if text == "none" else text


def _questions(option: str, answer: ImportAnswer) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield name and question of each option that settles something."""
    preview = answer.preview
    if option in _QUESTIONS:
        yield option, _QUESTIONS[option]
    elif option == "flange_targets":
        for target in preview.targets:
            text = f"{target} in the flange frame, X,Y,Z in mm"
            yield f"flange_targets.{target}", partial(_vector, text, None)
    elif option == "state_words":
        yield from _states(next(fault.words for fault in answer.faults if fault.option == option))
    elif option == "accept_unusual":
        doubtful = answer.missing[answer.missing_fields.index("accept_unusual")].partition("right: ")[2]
        yield option, partial(typer.confirm, f"Is this right: {doubtful}?", default=False, err=True)
    elif option == "columns":
        columns = (column for file in preview.files for column in file.columns)
        for header in dict.fromkeys(column.header for column in columns if column.meaning == "unknown"):
            text = f"Meaning of column {header!r}, such as J1 [deg]"
            yield f"columns.{header}", partial(typer.prompt, text, default="ignore", err=True)


def _choice(text: str, choices: tuple[str, ...], default: str | None) -> str:
    def checked(value: str) -> str:
        if value not in choices:
            raise typer.BadParameter(f"answer {', '.join(choices)}")
        return value

    answer: str = typer.prompt(
        f"{text} ({', '.join(choices)})", default=default, value_proc=checked, err=True
    )
    return answer


def _states(words: Sequence[str]) -> Iterator[tuple[str, Callable[[], object]]]:
    """Ask which of two words is without load, or what one word stands for."""
    if len(words) > 1:

        def both() -> dict[str, str]:
            unloaded = _choice("Word for readings without load", tuple(words), words[0])
            return {word: "unloaded" if word == unloaded else "loaded" for word in words}

        yield "state_words", both
    for word in words if len(words) == 1 else ():
        yield f"state_words.{word}", partial(_choice, f"State that {word!r} stands for", _STATES, None)


def _vector(text: str, default: str | None) -> tuple[float, ...]:
    answer: tuple[float, ...] = typer.prompt(text, default=default, value_proc=vector_of, err=True)
    return answer


_QUESTIONS: Final[Mapping[str, Callable[[], object]]] = {
    **{option: partial(_choice, *question) for option, question in _CHOICES.items()},
    "load_point": partial(
        _vector, "Load point in the flange frame, X,Y,Z in mm (at the flange: 0,0,0)", None
    ),
    "force": partial(_vector, "Force on the robot in R0, X,Y,Z", None),
    "by_order": partial(typer.confirm, "Match rows without names by their order?", default=False, err=True),
    "allow_missing": partial(typer.confirm, "Skip incomplete readings?", default=False, err=True),
    "sheet": partial(typer.prompt, "Sheet", err=True),
    "point_name": partial(
        typer.prompt, "Template of point names, such as {label}_{target}_{state}", err=True
    ),
}


def has_errors(answer: ImportAnswer) -> bool:
    """Return whether the inspection of the readings finds errors."""
    return any(finding.weight == "do_not_use" for finding in answer.findings or ())


def import_report(answer: ImportAnswer) -> list[Part]:
    """Return each file with its columns, then all of them together, then what is missing."""
    from jointstiff.service.tables.table import Line, text_table

    preview = answer.preview
    parts: list[Part] = []
    for file in preview.files:
        rows = [
            [
                str(column.column),
                _short(column.header),
                _short(column.meaning) + (" ?" if column.guessed else ""),
                column.unit or "",
                "; ".join(
                    _short(row[column.column - 1]) for row in file.first_rows[:2] if column.column <= len(row)
                ),
            ]
            for column in file.columns
        ]
        head = ["", "header", "read as", "unit", "first values"]
        parts += [Line(f"{file.file}: {_dialect(file)}", "title"), text_table(head, rows, texts=[1, 2, 3, 4])]
        parts += _lines(file.assumptions, "assumed: ")
    joints = "no joint angles" if preview.joint_count is None else f"{preview.joint_count} joints"
    targets, states = ", ".join(preview.targets) or "none", ", ".join(preview.states) or "none"
    more = ", …" if preview.observation_count > len(preview.first_labels) else ""
    counted = (
        f"  {preview.observation_count} observations ({', '.join(preview.first_labels)}{more}), {joints}, "
        f"{preview.reading_count} complete readings; targets: {targets}; states: {states}"
    )
    parts += [Line(counted), *_lines(preview.assumptions, "assumed: ")]
    if answer.poses is not None:
        parts.append(Line(f"  complete: {len(answer.poses.poses)} unloaded poses for a geometry", "good"))
    if answer.missing:
        parts += _lines(answer.missing, "missing: ", "care")
    elif not has_errors(answer):
        parts.append(Line("  complete: a measurement set", "good"))
    return [*parts, *_findings(answer)]


def _findings(answer: ImportAnswer) -> Iterator[Line]:
    """Yield the integrity findings, if a robot is known."""
    from jointstiff.service.tables.report import VERDICTS
    from jointstiff.service.tables.table import Line

    if answer.findings == []:
        yield Line("  integrity: nothing suspicious", "good")
    for finding in answer.findings or ():
        place = f"{finding.observation}: " if finding.observation else ""
        remedy = f"; {finding.remedy}" if finding.remedy else ""
        style: Any = "bad" if finding.weight == "do_not_use" else "care"
        yield Line(f"  {VERDICTS[finding.weight]}: {place}{finding.message}{remedy}", style)


def _dialect(file: FilePreview) -> str:
    """Describe the file's format."""
    rows = f"{file.row_count} row{'s' if file.row_count != 1 else ''}"
    if file.format == "xlsx":
        return f"Excel, sheet {file.sheet!r}, {rows}"
    return f"{file.encoding}, {file.delimiter} between cells, decimal {file.decimal_mark}, {rows}"


def _lines(texts: list[str], lead: str, style: Any = "dim") -> Iterator[Line]:  # noqa: ANN401 - a style
    from jointstiff.service.tables.table import Line

    for text in texts[:_LINES_SHOWN]:
        yield Line(f"  {lead}{text}", style)
    if len(texts) > _LINES_SHOWN:
        yield Line(f"  {lead}{len(texts) - _LINES_SHOWN} more (--json shows all)", style)


def _short(text: str) -> str:
    printable = "".join(character if character.isprintable() else "\ufffd" for character in text)
    return printable if len(printable) <= _LONGEST else printable[: _LONGEST - 1] + "…"
