"""Forms of statements: what a language understands beside moves and frames, as a table to read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

from jointstiff.service.programs.reader import ALL, Statement, used_in
from jointstiff.service.programs.scanner import Cursor, Misread, Used

_DEPTHS: Final = {"open": 1, "close": -1, "closeall": ALL}


class Forms:
    """Forms by their first word.

    A line of the table is an effect (`plain`; `open`, `turn` or `close` a branch or a loop; `jump`; the name
    of an act) and the elements of the statement, blanks between: `e` an expression, `e*` some with commas,
    `v` a variable that gets another value, `w` a word, `n` a number, `c` a routine that is called, with its
    arguments, `a` arguments of an instruction, `?X` what may be left out, `X|Y` one of two; all else stands
    for itself. An act is given the alternatives and the numbers' places that were taken.
    """

    def __init__(self, table: str, *, whole: bool = True, **acts: Callable[..., object]) -> None:
        """Read a table; `whole` if nothing but a semicolon may follow a statement."""
        self._whole, self._acts = whole, acts
        self._forms: dict[str, list[tuple[str, tuple[str, ...]]]] = {}
        for line in table.strip().splitlines():
            effect, firsts, *rest = line.split()
            for first in firsts.split("|"):
                self._forms.setdefault(first, []).append((effect, (firsts, *rest)))

    def __contains__(self, word: str) -> bool:
        """Tell whether a statement begins with a word."""
        return word in self._forms

    def take(self, c: Cursor) -> Statement:
        """Take the statement that begins here."""
        begin, fault = (
            c.place,
            Misread("the statement is unknown: it may move the robot, targets or frames"),
        )
        for effect, elements in self._forms.get(c.peek().text, ()):
            c.attempt(begin)
            try:
                return self._taken(c, effect, elements)
            except Misread as other:
                fault = max(fault, other, key=lambda each: each.offset)
        raise fault

    def _taken(self, c: Cursor, effect: str, elements: tuple[str, ...]) -> Statement:
        used, changed, taken = Used(), set[str](), list[str | int]()
        for element, following in zip(elements, (*elements[1:], ""), strict=True):
            token, following = c.peek(), following.removeprefix("?")
            text = token.text.upper() if c.lexicon.folded else token.text
            if element == "v":
                changed.add(c.name())
            elif element in _PARTS:
                _PARTS[element](c, used, (*following.split("|"), ";") if following else (";",))
            elif text in element.removeprefix("?").split("|"):
                c.take()
            elif not element.startswith("?"):
                raise c.misread()
            taken += [token.ordinal] if element == "n" else [text] if "|" in element else []
        if self._whole and not c.ended and not c.at(";"):
            raise c.misread()
        return replace(
            used_in(used, *changed, act=_acting(self._acts.get(effect), taken)),
            depth=_DEPTHS.get(effect, 0),
            turns=effect == "turn",
            jumps=effect == "jump",
        )


def _acting(act: Callable[..., object] | None, taken: list[str | int]) -> Callable[..., object] | None:
    return act and (lambda script, place: act(script, place, *taken))


def _list(c: Cursor, used: Used, stops: tuple[str, ...]) -> None:
    while not c.ended and not c.at(*stops):
        c.expression(",", *stops, used=used)
        if not c.accept(","):
            break


def _call(c: Cursor, used: Used, _: object) -> None:
    used.calls.add(c.name())
    if c.at("("):
        c.arguments(used)


def instruction_arguments(c: Cursor, used: Used) -> None:
    r"""Take arguments without brackets: expressions, and optional ones behind a backslash (`\Num:=n`)."""
    while not c.ended and not c.at(";"):
        if c.accept("\\"):
            c.name()
            if c.accept(":="):
                c.expression(",", "\\", ";", used=used)
        elif not c.accept(","):
            c.expression(",", "\\", ";", used=used)
            if not c.ended and not c.at(",", "\\", ";"):
                raise c.misread()


_PARTS: Final[Mapping[str, Callable[[Cursor, Used, tuple[str, ...]], object]]] = {
    "e": lambda c, used, stops: c.expression(*stops, used=used),
    "e*": _list,
    "c": _call,
    "a": lambda c, used, _: instruction_arguments(c, used),
    "w": lambda c, _, __: c.name(),
    "n": lambda c, _, __: c.number(),
}
