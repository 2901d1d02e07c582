"""Tables in text files: the delimiter and decimal mark that make most numbers, and words above the rows."""

from __future__ import annotations

import csv
import math
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from jointstiff.schemas.imports import MAX_COLUMNS, Cell
from jointstiff.service.imports.tables import (
    MAX_CELL_LENGTH,
    Column,
    NumberWithUnit,
    Table,
    TableError,
    build_table,
)

_BYTE_ORDER_MARKS: Final = (
    (b"\xef\xbb\xbf", "utf-8-sig"),
    (b"\xff\xfe", "utf-16"),
    (b"\xfe\xff", "utf-16"),
)
MAX_LINES: Final = 400_000
MAX_LINE_LENGTH: Final = MAX_COLUMNS * MAX_CELL_LENGTH
_NUMBER: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
_NUMBER_WITH_UNIT: Final = re.compile(r"([-+]?\d+(?:\.\d+)?)\s?(°|mm|cm|µm|m|in|deg|rad|k?N|kg)", re.ASCII)
_GROUPED: Final = {
    ".": re.compile(r"[-+]?\d{1,3}(?:,\d{3})+\.\d+", re.ASCII),
    ",": re.compile(r"[-+]?\d{1,3}(?:\.\d{3})+,\d+", re.ASCII),
}
"""Decimal mark → numbers with separators of thousands."""
_BEGINS_AS_NUMBER: Final = re.compile(r"[-+.]?\d", re.ASCII)
_LARGE: Final = re.compile(r"[-+]?\d{4,}[.,]?\d*", re.ASCII)
_EMPTY: Final = frozenset(("", "-", "nan", "n/a", "na", "none", "null"))
_COMMENT: Final = re.compile(r"\s*(?:#|//|%|!)+\s?")
_SAMPLED: Final = 200
"""Lines that decide on the delimiter."""
_MORE_BY_BLANKS: Final = 2.0
"""Factor by which blanks make more numbers than other delimiters: names such as `Target 1` have blanks."""
_LEAST_ROWS: Final = 3


class Dialect(NamedTuple):
    """Way in which a text writes cells and numbers."""

    delimiter: str  # empty for blanks
    mark: str  # decimal mark
    is_grouped: bool = False  # whether numbers above 1000 have separators of thousands


_DIALECTS: Final = (
    *(Dialect("\t", "."), Dialect(";", "."), Dialect(";", ","), Dialect("\t", ",")),
    *(
        Dialect("|", "."),
        Dialect("|", ","),
        Dialect(",", "."),
        Dialect(",", ","),
        Dialect("", "."),
        Dialect("", ","),
    ),
)
"""Delimiters and decimal marks, the usual ones first."""
PLAIN: Final = Dialect("", ".")


class EncodingError(TableError):
    """A text that is not in UTF-8, so that a person states its encoding."""


def decode(name: str, content: bytes, encoding: str | None = None) -> str:
    """Return a text by its byte order mark, else as UTF-8, else as stated.

    Raises:
        EncodingError: the text is in another encoding.
    """
    for mark, known in _BYTE_ORDER_MARKS:
        if content.startswith(mark):
            encoding = known
    try:
        text = content.decode(encoding or "utf-8")
    except (UnicodeDecodeError, LookupError):
        reason = f"the file is not encoded in {encoding or 'UTF-8'}"
        raise EncodingError(reason, where=name, remedy="state `encoding`, such as windows-1252") from None
    if "\0" in text:
        raise EncodingError("the file is no text", where=name, remedy="export the readings as a table")
    return text


def parse_cell(text: str, dialect: Dialect = PLAIN) -> Cell:
    """Return a cell as a number, a word or nothing."""
    text = " ".join(text.split())
    if text.lower() in _EMPTY:
        return None
    number = text.replace("\u2212", "-")
    if dialect.is_grouped and _GROUPED[dialect.mark].fullmatch(number):
        number = number.replace("." if dialect.mark == "," else ",", "")
    if dialect.mark == ",":
        number = "" if "." in number else number.replace(",", ".")
    if _NUMBER.fullmatch(number) and math.isfinite(float(number)):
        return float(number)
    match = _NUMBER_WITH_UNIT.fullmatch(number)
    return NumberWithUnit.of(float(match[1]), match[2], text) if match else text


def read_text(name: str, text: str) -> list[Table]:
    """Return the tables of a text.

    Raises:
        TableError: the text has too many lines.
    """
    lines = text.splitlines()
    if len(lines) > MAX_LINES:
        raise TableError(f"the file has more than {MAX_LINES:,} lines", where=name, remedy="split the file")
    if any(len(line) > MAX_LINE_LENGTH for line in lines):
        reason = f"a line has more than {MAX_LINE_LENGTH:,} characters"
        raise TableError(reason, where=name, remedy="remove texts that are no names")
    dialect = _choose_dialect([line for line in lines if line.strip()])
    return list(split_in_tables(name, [_split(line, dialect) for line in lines]))


def read_grid(name: str, lines: Sequence[Sequence[Cell]]) -> Iterator[Table]:
    """Yield the tables of a sheet, whose numbers may be written as texts, with one decimal mark."""
    texts = [cell for line in lines for cell in line if isinstance(cell, str)]
    with_point, with_comma = Dialect("", "."), Dialect("", ",")
    points = _count_numbers([parse_cell(text, with_point) for text in texts])
    commas = _count_numbers([parse_cell(text, with_comma) for text in texts])
    dialect = with_comma if commas > points else with_point
    rows = []
    for line in lines:
        cells = [parse_cell(cell, dialect) if isinstance(cell, str) else cell for cell in line]
        rows.append(trim(cells))
    return split_in_tables(name, rows)


def _choose_dialect(lines: Sequence[str]) -> Dialect:
    """Return the dialect that makes most numbers, and leaves fewest words that begin as numbers do."""

    def count(dialect: Dialect) -> int:
        """Return the number of numbers, less twice the number of words that begin as a number."""
        cells = [cell for line in lines[:_SAMPLED] for cell in _split(line, dialect)]
        numbers = _count_numbers(cells)
        words = [cell for cell in cells if isinstance(cell, str)]
        broken = sum(_BEGINS_AS_NUMBER.match(word) is not None for word in words)
        return numbers - 2 * broken

    candidates = [*_DIALECTS, *(each._replace(is_grouped=True) for each in _DIALECTS)]
    counts = {each: count(each) / (1 if each.delimiter else _MORE_BY_BLANKS) for each in candidates}
    best = max(candidates, key=lambda each: counts[each])
    if best.is_grouped and any(_LARGE.fullmatch(cell) for line in lines for cell in _cut(line, best)):
        return best._replace(is_grouped=False)  # only some numbers above 1000 have separators
    return best


def _cut(line: str, dialect: Dialect) -> list[str]:
    """Return the texts between the delimiters of a line, without the marks of a comment."""
    line = _COMMENT.sub("", line, count=1) if _COMMENT.match(line) else line
    if not dialect.delimiter:
        return line.split()
    if dialect.delimiter == "|":
        line = line.strip().strip("|")
    return next(csv.reader([line], delimiter=dialect.delimiter), [])


def _split(line: str, dialect: Dialect) -> tuple[Cell, ...]:
    """Return the cells of a line, without empty ones at its end; a comment with numbers is no row."""
    cells = trim([parse_cell(text, dialect) for text in _cut(line, dialect)])
    return () if _COMMENT.match(line) and _count_numbers(cells) else cells


def trim(cells: list[Cell]) -> tuple[Cell, ...]:
    """Return cells without empty ones at the end."""
    while cells and cells[-1] is None:
        cells.pop()
    return tuple(cells)


@dataclass
class _Run:
    """Rows with numbers that follow each other, with the lines of words above them."""

    words: list[tuple[Cell, ...]]
    rows: list[tuple[Cell, ...]]
    is_apart: bool  # whether words or blank lines are above

    @property
    def width(self) -> int:
        return max(map(len, self.rows))

    def accepts(self, cells: Sequence[Cell]) -> bool:
        """Return whether a row may continue the run: about as many cells and numbers, or a row with gaps."""
        if len(cells) == self.width and _count_numbers(cells) >= len("xyz"):
            pairs = zip(cells, self.rows[0], strict=False)
            if all(
                cell is None or isinstance(cell, float) == isinstance(first, float) for cell, first in pairs
            ):
                return True
        is_as_wide = abs(len(cells) - self.width) <= max(1, self.width // 4)
        return is_as_wide and 2 * _count_numbers(cells) >= _count_numbers(self.rows[0])

    @property
    def headers(self) -> list[str]:
        """Words of the lines above that have as many cells, joined by column; merged cells reach right."""
        rows = [row for row in self.words if len(row) > max(1, self.width // 2)][-3:]
        filled = [_fill_right(row, self.width, is_last=row is rows[-1]) for row in rows]
        return [" ".join(filter(None, parts)) for parts in zip(*filled, strict=True)]

    @property
    def title(self) -> str:
        """Words of the last line above that is no header."""
        titles = [row for row in self.words if len(row) <= max(1, self.width // 2)]
        return " ".join(str(cell) for cell in titles[-1] if cell is not None) if titles else ""

    def split_header(self) -> tuple[list[str], list[tuple[Cell, ...]]]:
        """Return headers and rows; first rows with words where the others have numbers are headers."""
        headers = self.headers or [""] * self.width
        rows = [row + (None,) * (self.width - len(row)) for row in self.rows]
        while len(rows) > _LEAST_ROWS:
            first, *others = rows
            numeric = [2 * _count_numbers(cells) > len(cells) for cells in zip(*others, strict=True)]
            strange = sum(isinstance(cell, str) for cell, each in zip(first, numeric, strict=True) if each)
            if strange < max(1, 0.3 * sum(numeric)):
                break
            words = [f"{cell:g}" if isinstance(cell, float) else cell or "" for cell in first]
            headers = [f"{above} {word}".strip() for above, word in zip(headers, words, strict=True)]
            rows = others
        return headers, rows


def _count_numbers(cells: Sequence[Cell]) -> int:
    return sum(isinstance(cell, float) for cell in cells)


def _fill_right(row: Sequence[Cell], width: int, *, is_last: bool) -> list[str]:
    """Return the words of a header; words above the last header reach to the next filled cell."""
    words, last = list[str](), ""
    for index in range(width):
        word = str(row[index]) if index < len(row) and row[index] is not None else ""
        if word or is_last:
            last = word
        words.append(last)
    return words


class _Part(NamedTuple):
    """Rows of a run below its headers."""

    title: str
    rows: list[tuple[Cell, ...]]


def split_in_tables(name: str, lines: Iterable[tuple[Cell, ...]]) -> Iterator[Table]:
    """Yield the tables of a grid of cells: runs of rows with numbers, and the words above them.

    Rows of words above a run are its headers. Runs of one width and header are one table, whose column
    `block` counts the runs, and whose column `title` has the line above each run. Few rows that are less than
    half as wide as the widest table are a remark.
    """
    runs = _find_runs(lines)
    least_width = max((run.width for run in runs), default=0) / 2
    forms: dict[tuple[int, int, tuple[str, ...]], list[_Part]] = defaultdict(list)
    for run in runs:
        headers, rows = run.split_header()
        forms[run.width, _count_numbers(rows[0]), tuple(headers)].append(_Part(run.title, rows))
    tables = []
    for (width, _, names), parts in forms.items():
        rows = [row for part in parts for row in part.rows]
        if len(rows) >= _LEAST_ROWS or width > least_width:
            tables.append((names, rows, parts))
    for number, (names, rows, parts) in enumerate(tables, 1):
        table = build_table(f"{name}#{number}" if len(tables) > 1 else name, names, rows)
        yield table.with_columns(list(_describe_parts(parts)))


def _describe_parts(parts: Sequence[_Part]) -> Iterator[Column]:
    """Yield a column with the titles of the parts, and one with their numbers, where these differ."""
    if len({part.title for part in parts}) > 1:
        yield Column("title", "title", tuple(part.title or None for part in parts for _ in part.rows))
    if len(parts) > 1:
        blocks = tuple(float(block) for block, part in enumerate(parts, 1) for _ in part.rows)
        yield Column("block", "block", blocks)


def _find_runs(lines: Iterable[tuple[Cell, ...]]) -> list[_Run]:
    """Return the runs of rows with numbers; a line of words ends a run.

    One or two short rows directly below a run have lost a part, and stay in the run.
    """
    runs: list[_Run] = []
    words: list[tuple[Cell, ...]] = []
    is_apart = True
    for cells in lines:
        if not _count_numbers(cells):
            words += [cells] if cells else []
            is_apart = True
        elif runs and not words and runs[-1].accepts(cells):
            runs[-1].rows.append(cells)
            is_apart = False
        else:
            runs.append(_Run(words, [cells], is_apart))
            words, is_apart = [], False
    joined: list[_Run] = []
    for run in runs:
        if not run.is_apart and len(run.rows) < _LEAST_ROWS and run.width < joined[-1].width:
            joined[-1].rows += run.rows
        else:
            joined.append(run)
    return joined
