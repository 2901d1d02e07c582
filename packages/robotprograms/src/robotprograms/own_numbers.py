"""Numbers that a move gets of its own, in place of the name of a target whose numbers have to stay.

The numbers of a name can have one correction only. Where moves need several, or where a calculation or
another program uses the numbers as well, the numbers are copied from the declaration to the move. Then each
move is corrected on its own, and the declaration stays as it is.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Final, NamedTuple

from robotprograms.errors import encode_text
from robotprograms.language import Language
from robotprograms.program import OwnNumbers, Source

_LONGEST: Final = 1000
"""Largest count of characters in which a name is looked for, and of numbers that are copied."""
_VARIABLE: Final = re.compile(r"(?<![\w.#'\"])[^\W\d]\w*\s*[,\]}]")
"""A value that is not a number: at another place, the same word may mean another variable."""
_DEPTH: Final = {"[": 1, "{": 1, "]": -1, "}": -1}
"""Brackets more that are open behind a character."""


class NamePlace(NamedTuple):
    """Place of a name in the text of a file."""

    begin: int  # first character
    end: int  # last character + 1


def find_name(language: Language, source: Source, line: int, name: str) -> NamePlace | None:
    """Find a name in the statement that begins on a line of a file.

    Return None if the place is not certain: the name occurs twice or not at all, or the line has several
    statements.
    """
    begin = int(source.starts[line - 1])
    statement = _find_statement(language, source.text[begin : begin + _LONGEST])
    if statement is None:
        return None
    places = [found.span() for found in _compile_name(language, name).finditer(statement)]
    if len(places) != 1:
        return None
    ((first, last),) = places
    return NamePlace(begin + first, begin + last)


def _compile_name(language: Language, name: str) -> re.Pattern[str]:
    """Return a pattern that finds a whole name; an element of an array may have blanks: `P [ 3 ]`."""
    array, bracket, index = name.partition("[")
    pattern = re.escape(name)
    is_element = bool(bracket)
    if is_element:
        pattern = rf"{re.escape(array)}\s*\[\s*{re.escape(index.removesuffix(']'))}\s*\]"
    flags = re.IGNORECASE if language.ignores_case else 0
    return re.compile(rf"(?<![\w$.]){pattern}(?!\w)", flags)


def _find_statement(language: Language, text: str) -> str | None:
    """Return the statement at the beginning of a text, with blanks in place of comments.

    Return None if the statement does not end in the text, or if further statements follow on its last line.
    """
    line_break = re.search(r"[\r\n]|\Z", text)
    end_of_line = line_break.start() if line_break else len(text)
    end = text.find(language.end_of_statement) if language.end_of_statement else end_of_line
    has_end = end >= 0
    if not has_end:
        return None
    text_behind_end = language.blank_comments(text[end:end_of_line])
    if end < end_of_line and text_behind_end.strip():
        return None
    return language.blank_comments(text[: max(end, end_of_line)])


def copy_numbers(language: Language, source: Source, first: int) -> str | None:
    """Return the text in brackets, on one line, of the target whose first number is at an index of a file.

    Return None if the text has comments or variables, or if its brackets do not close.
    """
    text_before = source.text[max(first - _LONGEST, 0) : first]
    opening = re.search(rf"{language.opening}\Z", text_before)
    if opening is None:
        return None
    begin = first - len(opening[0])
    target = _cut_behind_brackets(source.text[begin : begin + _LONGEST])
    if target is None:
        return None
    has_comment = language.blank_comments(target) != target
    if has_comment or _VARIABLE.search(target):
        return None
    has_line_break = re.search(r"[\r\n]", target) is not None
    return " ".join(target.split()) if has_line_break else target


def _cut_behind_brackets(text: str) -> str | None:
    """Return a text up to the bracket that closes the first one; None if that bracket does not close."""
    depth = 0  # of brackets within one another
    for index, character in enumerate(text):
        depth += _DEPTH.get(character, 0)
        if depth == 0 and character in "]}":
            return text[: index + 1]
    return None


def insert_numbers(source: Source, own: Iterable[OwnNumbers]) -> tuple[Source, tuple[OwnNumbers, ...]]:
    """Write numbers in place of names into a file.

    Args:
        source: the file.
        own: numbers of moves, each with the place of the name that they replace.

    Returns:
        The file with the numbers; the numbers with their own places in this file.
    """
    pieces, placed = list[str](), list[OwnNumbers]()
    end_of_last_name = 0  # in the old text
    length = 0  # of the new text so far
    for numbers in sorted(own, key=lambda each: each.start):
        text_before = source.text[end_of_last_name : numbers.start]
        start = length + len(text_before)
        end = start + len(numbers.numbers)
        pieces += [text_before, numbers.numbers]
        placed.append(replace(numbers, start=start, end=end))
        length, end_of_last_name = end, numbers.end
    text = "".join([*pieces, source.text[end_of_last_name:]])
    return Source.from_bytes(source.name, encode_text(text)), tuple(placed)
