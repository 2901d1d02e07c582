"""Questions of `jointstiff import` at a terminal: one for each thing that is missing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

import typer

from jointstiff.service.cli.import_options import Options
from jointstiff.service.cli.options import vector_of

if TYPE_CHECKING:
    from jointstiff.schemas.imports import ImportAnswer

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
