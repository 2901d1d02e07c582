"""Texts with each number, or list of numbers, behind its name, such as `X=123.4 Y=5.6`, read as a table."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from jointstiff.service.importing import limits
from jointstiff.service.importing.grammar import find_any_unit
from jointstiff.service.importing.texts.number_lists import name_number, split_numbers

_LEAST_RECORDS: Final = 3
_LEAST_NUMBERS: Final = 3
"""Names with numbers in each record."""
_LEAST_PART: Final = 0.6
"""Fraction of the lines that belong to records."""
_MAX_LINE: Final = 2000
_COMMENT_MARKS: Final = ("#", "//", "%")
_BEFORE_NAME: Final = re.compile(r"[,;|]\s*(?=[^\W\d][\w \[\]()°/.-]{0,40}\s{0,3}[=:])")
"""A separator before a name."""
_PAIR: Final = re.compile(r"(?<![\w.])([^\W\d][\w\[\]()°/.-]{0,40})\s{0,20}[=:]\s{0,20}([^\s=:]{1,80})")
"""A name, and the text behind `=` or `:`."""
_BARE_PAIR: Final = re.compile(
    r"(?<![\w.])([^\W\d]\w{0,15})[ \t]{1,8}([-+]?\d{1,9}(?:[.,]\d{1,12})?)(?![\w.])"
)
"""A name, and a number behind blanks."""
_LIST: Final = re.compile(r"(?:\{([^{}]{5,600})\}|\[([^][]{5,600})\]|\(([^()]{5,600})\))\s{0,3}(\S{0,20})")
"""A list in brackets, and a word behind it."""
_FIRST_NAME: Final = re.compile(r"^\s*(\w{1,40})\s?:")
_LEAST_BARE: Final = 6
"""Fewest names with numbers behind blanks."""
_NUMBER: Final = re.compile(r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?")


class _Pair(NamedTuple):
    """A name with its text."""

    line: int
    key: str
    value: str
    unit: str  # word behind the number; empty without one


@dataclass(frozen=True)
class KeyedRecords:
    """Records of a text that have the same names."""

    headers: tuple[str, ...]
    rows: tuple[tuple[int, tuple[str, ...]], ...]  # line of each record, and its texts
    remarks: tuple[tuple[int, str], ...]  # lines that belong to no record


def read_key_values(text: str) -> KeyedRecords | None:
    """Return the records of a text in which names occur equally often, in one order; None of other texts."""
    lines = [
        (number, line)
        for number, line in enumerate(re.split(r"\r\n|\n|\r", text), 1)
        if line.strip() and not line.lstrip().startswith(_COMMENT_MARKS)
    ]
    lines = _write_signs(lines)
    sign_counts = [line.count("=") + line.count(":") for _, line in lines]
    keyed_count = sum(count > 0 for count in sign_counts)
    if keyed_count < max(_LEAST_PART * len(lines), 1) or max(sign_counts) > limits.MAX_COLUMNS:
        return None
    if max(len(line) for _, line in lines) > _MAX_LINE:
        return None
    pairs = [pair for number, line in lines for pair in _read_line(number, line)]
    counts = Counter(pair.key for pair in pairs)
    most = max(Counter(counts.values()).items(), key=lambda item: item[0] * item[1], default=(0, 0))[0]
    keys = [key for key in counts if counts[key] == most]
    records = _split_records([pair for pair in pairs if counts[pair.key] == most], keys)
    used_lines = {pair.line for pair in pairs if counts[pair.key] == most}
    is_report = most >= _LEAST_RECORDS and len(used_lines) >= _LEAST_PART * len(lines)
    if not records or not is_report:
        return None
    numbers = [
        key for n, key in enumerate(keys) if all(_NUMBER.fullmatch(record[n].value) for record in records)
    ]
    if len(numbers) < _LEAST_NUMBERS:
        return None
    headers = tuple(_name_header(keys[n], {record[n].unit for record in records}) for n in range(len(keys)))
    rows = tuple((record[0].line, tuple(pair.value for pair in record)) for record in records)
    remarks = tuple((number, line.strip()) for number, line in lines if number not in used_lines)
    return KeyedRecords(headers, rows, remarks)


def _write_signs(lines: Sequence[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines such as `P1: J1 1.5 J2 2.5` with `=` between names and numbers; other lines unchanged.

    Lines are changed only if all have the same names, as many as a robot has axes.
    """
    found = [tuple(name for name, _ in _BARE_PAIR.findall(line)) for _, line in lines]
    names = found[0] if found else ()
    is_list = len(set(names)) == len(names) >= _LEAST_BARE and all(own == names for own in found)
    if not is_list or any("=" in line for _, line in lines):
        return list(lines)
    return [(n, _BARE_PAIR.sub(r"\1=\2", _FIRST_NAME.sub(r"\1 ", line))) for n, line in lines]


def _read_line(number: int, line: str) -> Iterator[_Pair]:
    """Yield the names of a line with their texts; words before the first name are the text of `name`."""
    spaced = _BEFORE_NAME.sub("  ", line.strip())
    matches = list(_PAIR.finditer(spaced))
    if not matches:
        return
    first = spaced[: matches[0].start()].strip(" ,;:|")
    if first and len(matches) > 1:
        yield _Pair(number, "name", first, "")
    ends = [match.start() for match in matches[1:]] + [len(spaced)]
    for match, end in zip(matches, ends, strict=True):
        listed = list(_read_list(number, match[1], spaced[match.start(2) : end].strip(" ,;|")))
        if listed:
            yield from listed
            continue
        behind = spaced[match.end() : end].strip(" ,;|")
        unit = behind if find_any_unit(behind) is not None else ""
        value = match[2].rstrip(",;")
        yield _Pair(number, match[1], f"{value} {behind}" if behind and not unit else value, unit)


def _read_list(number: int, name: str, text: str) -> Iterator[_Pair]:
    """Yield the numbers of a list in brackets with the name of the list and their places; else nothing."""
    found = _LIST.fullmatch(text)
    if found is None:
        return
    *contents, unit = found.groups()
    values = split_numbers(next(content for content in contents if content is not None))
    is_understood = values is not None and (not unit or find_any_unit(unit) is not None)
    if values is None or not is_understood:
        return
    for index, value in enumerate(values):
        yield _Pair(number, name_number(name, index, len(values)), value, unit)


def _split_records(pairs: list[_Pair], keys: list[str]) -> list[list[_Pair]]:
    """Return the pairs of each record, in the order of the keys; none if a record has another order."""
    width = len(keys)
    if not width or len(pairs) % width:
        return []
    records = [pairs[first : first + width] for first in range(0, len(pairs), width)]
    are_alike = all([pair.key for pair in record] == keys for record in records)
    return records if are_alike else []


def _name_header(key: str, units: set[str]) -> str:
    """Return the header of a name, with the unit behind its numbers."""
    unit = units.pop() if len(units) == 1 else ""
    return f"{key} [{unit}]" if unit else key
