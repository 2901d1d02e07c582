"""Logs that write lists of numbers in brackets, such as `1: {10.5, -20.3, …}`, read as a table."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from jointstiff.service.importing.grammar import find_known_unit, is_force
from jointstiff.service.importing.texts.key_values import KeyedRecords
from jointstiff.service.importing.texts.number_lists import (
    COORDINATES,
    LEAST_NUMBERS,
    NUMBER,
    name_number,
    split_numbers,
)

_LEAST_LINES: Final = 3
_LEAST_PART: Final = 0.6
"""Fraction of the lines of a text that have lists."""
_MAX_LINE: Final = 2000
_BRACKETS_OF_LISTS: Final = re.compile(r"[\[{(][^][(){}\n]{5,600}[\]})]")
_LIST: Final = re.compile(r"\{([^][(){}]{5,600})\}|\[([^][(){}]{5,600})\]|\(([^][(){}]{5,600})\)")
"""A list in brackets without other brackets in it."""
_UNIT_BEHIND: Final = re.compile(r"[ \t]{0,3}([^\W\d]{1,4}|°)(?![\w.])")
"""A word behind a list that may be its unit."""
_BRACKET: Final = re.compile(r"[][{}]")
_INDEX: Final = re.compile(r"\[\s{0,3}(\w{1,20})(?:\s{0,3}[^][\w][^][]{0,40})?\]")
"""An index of an array, as in `P[1]` or `P[1:"name"]`."""
_SEPARATORS: Final = re.compile(r"[\s:=;,|()]+")
_CELL_SEPARATORS: Final = re.compile(r"[\s;|]+")
_MOST_LINES: Final = 40
"""Lines of a row, at most."""
_COMMENT_MARKS: Final = ("#", "//", "%")


class _Line(NamedTuple):
    """A line with lists of numbers."""

    number: int
    words: tuple[tuple[str, ...], ...]  # words before each list
    lists: tuple[tuple[str, ...], ...]  # texts of the numbers
    units: tuple[str, ...]  # behind each list; empty without one
    last_words: tuple[str, ...]  # words behind the last list

    @property
    def form(self) -> tuple[tuple[int, int, str], ...]:
        """Number of words before each list, and of its numbers, and their unit."""
        parts = zip(self.words, self.lists, self.units, strict=True)
        return tuple((len(words), len(numbers), unit) for words, numbers, unit in parts)


def read_listed_rows(text: str) -> KeyedRecords | None:
    """Return a row for each line with lists of numbers in brackets; None of other texts.

    Lines of the same form are a row each; lines whose forms recur are a row together. Words that are equal in
    all rows are the headers of the list behind them, and other words are names of the rows.
    """
    if not _BRACKETS_OF_LISTS.search(text):
        return None
    lines = [
        (number, line.strip())
        for number, line in enumerate(re.split(r"\r\n|\n|\r", text), 1)
        if line.strip() and not line.lstrip().startswith(_COMMENT_MARKS)
    ]
    listed = [found for number, line in lines if (found := _read_line(number, line)) is not None]
    if len(listed) < max(_LEAST_LINES, _LEAST_PART * len(lines)):
        return None
    used = {line.number for line in listed}
    remarks = [(number, line) for number, line in lines if number not in used]
    if any(_may_have_list(line) for _, line in remarks):
        return None
    constant = _find_constant_force(listed)
    joined = _join_lines([line for line in listed if line is not constant])
    if not joined:
        return None
    columns = list(_list_columns(joined))
    if constant is not None:
        own = _list_columns([constant] * len(joined))
        columns += [(header, cells) for header, cells in own if header != "name"]
    headers = tuple(header for header, _ in columns)
    rows = zip(*(cells for _, cells in columns), strict=True)
    numbered = tuple((line.number, row) for line, row in zip(joined, rows, strict=True))
    return KeyedRecords(headers, numbered, tuple(remarks))


def _find_constant_force(lines: Sequence[_Line]) -> _Line | None:
    """Return the only line with nothing but a force, which then holds for all rows; None without one."""
    found = [line for line in lines if len(line.lists) == 1 and is_force(" ".join(line.words[0]))]
    is_vector = len(found) == 1 and len(found[0].lists[0]) == COORDINATES
    return found[0] if is_vector else None


def _read_line(number: int, line: str) -> _Line | None:
    """Return the lists of a line and the words before them; None of a line of another form."""
    words, lists, units, end = list[tuple[str, ...]](), list[tuple[str, ...]](), list[str](), 0
    if len(line) > _MAX_LINE:
        return None
    for found in _LIST.finditer(line):
        numbers = split_numbers(next(content for content in found.groups() if content is not None))
        if numbers is None:
            continue
        words.append(_split_words(line[end : found.start()]))
        lists.append(numbers)
        unit = _UNIT_BEHIND.match(line, found.end())
        is_unit = unit is not None and find_known_unit(unit[1]) is not None
        units.append(unit[1] if unit is not None and is_unit else "")
        end = unit.end() if unit is not None and is_unit else found.end()
    if not lists:
        return None
    last_words = _split_words(line[end:].partition("//")[0])
    is_nested = any(_BRACKET.search(word) for own in (*words, last_words) for word in own)
    other_cells = _CELL_SEPARATORS.split(_LIST.sub(" ", line))
    has_other_numbers = sum(NUMBER.fullmatch(cell) is not None for cell in other_cells) >= LEAST_NUMBERS
    is_understood = not is_nested and not has_other_numbers
    if not is_understood:
        return None
    return _Line(number, tuple(words), tuple(lists), tuple(units), last_words)


def _split_words(text: str) -> tuple[str, ...]:
    """Return the words of a text; an index belongs to its array: `P[1]` is `P1`."""
    words = _SEPARATORS.split(_INDEX.sub(r"\1", text))
    return tuple(word for word in words if _BRACKET.search(word) or any(map(str.isalnum, word)))


def _join_lines(lines: Sequence[_Line]) -> list[_Line]:
    """Return a line for each row: as many lines as recur with the same forms; none if forms do not recur."""
    forms = [line.form for line in lines]
    for count in range(1, min(_MOST_LINES, len(lines) // _LEAST_LINES) + 1):
        does_recur = len(lines) % count == 0 and forms[count:] == forms[:-count]
        if does_recur:
            parts = [lines[first : first + count] for first in range(0, len(lines), count)]
            return [_join_parts(part) for part in parts]
    return []


def _join_parts(lines: Sequence[_Line]) -> _Line:
    """Return the lines of a row as one line; words behind the last list of a line are those of the last."""
    words = tuple(own for line in lines for own in line.words)
    lists = tuple(own for line in lines for own in line.lists)
    units = tuple(own for line in lines for own in line.units)
    return _Line(lines[0].number, words, lists, units, lines[-1].last_words)


def _may_have_list(line: str) -> bool:
    """Return whether a line that was not understood may have a list, which must not be left out."""
    lists = (found[0] for found in _LIST.finditer(line))
    return _BRACKET.search(line) is not None or any(
        len(re.findall(r"\d+", each)) >= LEAST_NUMBERS for each in lists
    )


def _list_columns(lines: Sequence[_Line]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield header and cells of each column: the name of the rows, and the numbers of each list."""
    headers, names = list[str](), [list[str]() for _ in lines]
    groups = [[line.words[number] for line in lines] for number in range(len(lines[0].words))]
    last_words = [line.last_words for line in lines]
    are_remarks = len(set(map(len, last_words))) > 1
    for of_lines in groups if are_remarks else [*groups, last_words]:
        common = list[str]()
        for words in zip(*of_lines, strict=True):
            if len(set(words)) == 1:
                common.append(words[0])
                continue
            for name, word in zip(names, words, strict=True):
                name.append(word)
        headers.append(" ".join(common))
    if names[0]:
        yield "name", tuple("_".join(name) for name in names)
    for number, header in enumerate(headers[: len(groups)]):
        of_lists = zip(*(line.lists[number] for line in lines), strict=True)
        unit = lines[0].units[number]
        ending = f" [{unit}]" if unit else ""
        for column, cells in enumerate(of_lists):
            own_header = name_number(header, column, len(lines[0].lists[number]))
            yield f"{own_header}{ending}" if own_header else "", tuple(cells)
