"""Numbers that a move gets of its own, in place of the name of a target whose numbers have to stay.

The numbers of a name can have one correction only. Where moves need several, or where a calculation or
another program uses the numbers as well, the numbers are copied from the declaration to the move. Then each
move is corrected on its own, and the declaration stays as it is.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from itertools import accumulate
from typing import Final

from robotprograms.errors import encode_text
from robotprograms.language import Language
from robotprograms.program import OwnNumbers, Source

_LONGEST: Final = 1000
"""Largest count of characters in which a name is looked for, and of numbers that are copied."""
_VARIABLE: Final = re.compile(r"(?<![\w.#'\"])[^\W\d]\w*\s*[,\]}]")
"""A value that is not a number: at another place, the same word may mean another variable."""
_DEPTH: Final = {"[": 1, "{": 1, "]": -1, "}": -1}


def find_name(language: Language, source: Source, line: int, name: str) -> tuple[int, int] | None:
    """Return the span of a name in the statement that begins on a line; None if the place is not certain."""
    first = int(source.starts[line - 1])
    text = source.text[first : first + _LONGEST]
    line_break = re.search(r"[\r\n]|\Z", text)
    end = line_break.start() if line_break else len(text)
    last = text.find(language.end_of_statement) if language.end_of_statement else end
    has_more = last < end and language.blank_comments(text[last:end]).strip()  # further statements
    if last < 0 or has_more:
        return None
    text = language.blank_comments(text[: max(last, end)])
    array, bracket, index = name.partition("[")
    words = rf"{re.escape(array)}\s*\[\s*{re.escape(index[:-1])}\s*\]" if bracket else re.escape(name)
    pattern = re.compile(rf"(?<![\w$.]){words}(?!\w)", re.IGNORECASE if language.ignores_case else 0)
    places = [match.span() for match in pattern.finditer(text)]
    return (first + places[0][0], first + places[0][1]) if len(places) == 1 else None


def copy_numbers(language: Language, source: Source, first: int) -> str | None:
    """Return the text in brackets of a target whose first number is at an index.

    Return None if the text has comments or variables.
    """
    before = re.search(rf"{language.opening}\Z", source.text[max(first - _LONGEST, 0) : first])
    if before is None:
        return None
    begin = first - len(before[0])
    text = source.text[begin : begin + _LONGEST]
    depths = accumulate(_DEPTH.get(character, 0) for character in text)
    end = next((i + 1 for i, depth in enumerate(depths) if depth == 0 and text[i] in "]}"), None)
    if end is None or _VARIABLE.search(text[:end]) or language.blank_comments(text[:end]) != text[:end]:
        return None
    return " ".join(text[:end].split()) if re.search(r"[\r\n]", text[:end]) else text[:end]


def insert_numbers(source: Source, own: Iterable[OwnNumbers]) -> tuple[Source, tuple[OwnNumbers, ...]]:
    """Return a file with numbers in place of names, and the numbers with their places in this file."""
    pieces, placed, last, length = list[str](), list[OwnNumbers](), 0, 0
    for each in sorted(own, key=lambda each: each.start):
        pieces += [source.text[last : each.start], each.numbers]
        length += len(pieces[-2])
        placed.append(replace(each, start=length, end=length + len(each.numbers)))
        length, last = length + len(each.numbers), each.end
    text = "".join([*pieces, source.text[last:]])
    return Source.from_bytes(source.name, encode_text(text)), tuple(placed)
