"""Delimited text: its encoding, lines, comments, quotation marks and the delimiter."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.importing import Delimiter
from jointstiff.service.importing.errors import ImportFileError, Place, shown
from jointstiff.service.importing.grid import COMMENT_MARKS, Grid, Row, check_size, too_many_cells
from jointstiff.service.importing.limits import MAX_CELLS, MAX_LINE_LENGTH, MAX_ROWS
from jointstiff.service.importing.numbers import looks_like_a_number

_CHARACTERS: Final[Mapping[Delimiter, str]] = MappingProxyType(
    {"comma": ",", "semicolon": ";", "tab": "\t", "whitespace": " "}
)
_LINE_END: Final = re.compile(r"\r\n|\n|\r")
_NUMBERS_IN_A_CELL: Final = re.compile(r"\d\s+[-+.\d]")
_COMMA_NOT_IN_A_NUMBER: Final = re.compile(r"(?<!\d),|,(?!\d)")
_LATIN1: Final = "the file is not valid UTF-8 and was read as Latin-1: check names with accents"
_LAST: Final = 10
"""Lines at the end of a file that tell its delimiter."""
_MOST_ABOVE: Final = 20
"""Lines above the header."""

_BYTE_ORDERS: Final = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_UTF8_SEQUENCE: Final = re.compile(
    rb"[\xc2-\xdf][\x80-\xbf]|[\xe0-\xef][\x80-\xbf]{2}|[\xf0-\xf4][\x80-\xbf]{3}"
)
_CONTROL: Final = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ufeff\ufffe\uffff]")
_REMEDY: Final = "save the file as text in UTF-8"

Line = tuple[int, str]


def read_text(file: str, content: bytes, delimiter: Delimiter | None) -> Grid:
    """Split a text into cells.

    Args:
        file: its name, for messages.
        content: its bytes.
        delimiter: found out if None.

    Raises:
        ImportFileError: not text, not a table, or a table in more than one way.
    """
    text, encoding = _decode(file, content)
    lines, comments = _sorted_lines(text)
    if len(lines) > MAX_ROWS:
        raise ImportFileError(
            Place(file, lines[MAX_ROWS][0]), f"the file has more than {MAX_ROWS} rows", "split the file"
        )
    if not lines:
        check_size(file, [])
    assumptions = [_LATIN1] if encoding == "latin-1" else []
    if delimiter is None:
        delimiter = _found(file, lines)
    rows = [row for row in _rows(file, lines, delimiter) if any(row.cells)]
    check_size(file, rows)
    remarks = _comment_rows(file, comments, delimiter)
    assumptions += _notes_on_comments(comments, remarks, len(rows[-1].cells))
    return Grid(
        file,
        "text",
        tuple(rows),
        tuple(remarks),
        tuple(comments),
        encoding=encoding,
        delimiter=delimiter,
        assumptions=tuple(assumptions),
        ended=text.rstrip(" \t").endswith(("\n", "\r")) or comments[-1:] > lines[-1:],
    )


def _sorted_lines(text: str) -> tuple[list[Line], list[Line]]:
    """Lines of data, and comments without their marks; empty lines are neither."""
    lines: list[Line] = []
    comments: list[Line] = []
    for number, line in enumerate(_LINE_END.split(text), start=1):
        content = line.strip(" \t")
        mark = next((mark for mark in COMMENT_MARKS if content.startswith(mark)), None)
        if mark is not None:
            comments.append((number, content.removeprefix(mark).strip()))
        elif content:
            lines.append((number, line))
    return lines, comments


def _found(file: str, lines: Sequence[Line]) -> Delimiter:
    """The delimiter: a tab or a semicolon if most of the last lines have one; else comma or whitespace."""
    last = [text.strip(" ") for _, text in lines[-_LAST:]]
    marks: tuple[Delimiter, Delimiter] = ("tab", "semicolon")
    for mark in marks:
        if 2 * sum(_CHARACTERS[mark] in text for text in last) > len(last):
            return mark
    if 2 * sum("," in text for text in last) <= len(last) and "," not in lines[0][1]:
        return "whitespace"
    rows = _attempt(file, lines, "comma")
    cells = (cell for row in rows[1:] or rows for cell in row.cells)
    comma = bool(rows) and not any(map(_NUMBERS_IN_A_CELL.search, cells))
    rows = _attempt(file, lines, "whitespace")
    cells = (cell for row in rows for cell in row.cells)
    whitespace = bool(rows) and not any(map(_COMMA_NOT_IN_A_NUMBER.search, cells))
    if comma and whitespace:
        raise ImportFileError(
            Place(file, lines[0][0]),
            "the comma may be the delimiter or, between cells separated by blanks, the decimal mark",
            "give `delimiter`, or use semicolons as delimiter",
            "delimiter",
        )
    return "whitespace" if whitespace else "comma"


def _attempt(file: str, lines: Sequence[Line], delimiter: Delimiter) -> list[Row]:
    """All rows from a header on if they have the same length of at least two, else none; titles go before."""
    try:
        rows = list(_rows(file, lines, delimiter))
    except ImportFileError:
        return []
    width = len(rows[-1].cells)
    first = next((index for index, row in enumerate(rows) if len(row.cells) == width), 0)
    body = rows[first:]
    alike = first <= _MOST_ABOVE and all(len(row.cells) == width for row in body)
    return body if alike and width > 1 else []


def _rows(file: str, lines: Sequence[Line], delimiter: Delimiter) -> Iterator[Row]:
    """Yield rows as long as a table may have as many cells; empty rows have none."""
    cells = 0
    for line in lines:
        row = _row(file, line, delimiter)
        cells += len(row.cells) if any(row.cells) else 0
        if cells > MAX_CELLS:
            raise too_many_cells(file, row)
        yield row


def _row(file: str, line: Line, delimiter: Delimiter) -> Row:
    number, text = line
    if len(text) > MAX_LINE_LENGTH:
        raise ImportFileError(
            Place(file, number),
            f"a line has more than {MAX_LINE_LENGTH} characters",
            "check the line endings",
        )
    if delimiter == "whitespace":
        text = text.replace("\t", " ").strip(" ")
    try:
        cells = next(csv.reader([text], delimiter=_CHARACTERS[delimiter], skipinitialspace=True, strict=True))
    except (csv.Error, StopIteration):
        raise ImportFileError(
            Place(file, number),
            "quotation marks do not enclose a whole cell",
            'enclose a cell as in "Point 1", on one line, or remove the marks',
        ) from None
    stripped = tuple(cell.strip(" \t") for cell in cells)
    for column, cell in enumerate(stripped, start=1):
        if '"' in cell:
            raise ImportFileError(
                Place(file, number, column),
                f"a quotation mark occurs within a cell, {shown(cell)}",
                "remove it",
            )
    return Row(number, stripped)


def _notes_on_comments(comments: Sequence[Line], rows: Sequence[Row], width: int) -> list[str]:
    if not comments:
        return []
    count = f"{len(comments)} line{'s' * (len(comments) > 1)}"
    notes = [f"comments were skipped ({count}); the first: {shown(comments[0][1])}"]
    alike = sum(len(row.cells) == width > 1 and looks_like_a_number(row.cells[-1]) for row in rows)
    if alike:
        notes.append(f"{alike} of the comments look like rows of data; they were not read")
    return notes


def _comment_rows(file: str, comments: Sequence[Line], delimiter: Delimiter) -> list[Row]:
    """Comments as rows, as far as they are: one of them may be the header."""
    rows, cells = [], 0
    for line in comments:
        try:
            row = _row("", line, delimiter)
        except ImportFileError:
            row = Row(line[0], (line[1],))
        cells += len(row.cells)
        if cells > MAX_CELLS:
            raise too_many_cells(file, row)
        rows.append(row)
    return rows


def _decode(file: str, content: bytes) -> tuple[str, str]:
    """Return the text of a file, and its encoding.

    UTF-8 and UTF-16 by their byte order marks; without one UTF-16 if every other byte is zero, UTF-8 if it
    is valid; else Latin-1, unless part of it is UTF-8: then it is damaged.
    """
    mark, encoding = next((entry for entry in _BYTE_ORDERS if content.startswith(entry[0])), (b"", ""))
    if not encoding and b"\0" in content[:4]:
        encoding = "utf-16-be" if content[:1] == b"\0" else "utf-16-le"
    try:
        text = content[len(mark) :].decode(encoding or "utf-8")
    except UnicodeDecodeError as error:
        if encoding or _UTF8_SEQUENCE.search(content):
            line = None if encoding else 1 + content.count(b"\n", 0, error.start)
            what = (
                f"not {f'valid {encoding.upper()}' if encoding else 'UTF-8'} from byte {error.start + 1} on"
            )
            reason = f"the text is damaged: {what}, though it begins like it"
            raise ImportFileError(Place(file, line), reason, _REMEDY) from None
        text, encoding = content.decode("latin-1"), "latin-1"
    if control := _CONTROL.search(text):
        reason = f"the file contains the control character {control.group()!a}, so it is not plain text"
        raise ImportFileError(Place(file, 1 + text.count("\n", 0, control.start())), reason, _REMEDY)
    return text, encoding or "utf-8"
