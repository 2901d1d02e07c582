"""A file as a grid of cells, not yet understood: its limits and type, delimited text, numbers in cells."""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import PurePath
from types import MappingProxyType
from typing import Final, Literal, NamedTuple

from jointstiff.schemas.fields import MAX_MAGNITUDE
from jointstiff.schemas.imports import MAX_PREVIEW_ROWS, ColumnMeaning, DecimalMark, Delimiter, FilePreview
from jointstiff.service.importing import limits
from jointstiff.service.importing.errors import NOWHERE, ImportFileError, Place, quote
from jointstiff.service.importing.grammar import lacks_number
from jointstiff.service.importing.texts.encoding import decode
from jointstiff.service.importing.texts.joint_positions import JointPosition, read_joint_positions
from jointstiff.service.importing.texts.joint_states import read_joint_states, read_rows_of_joint_states
from jointstiff.service.importing.texts.key_values import KeyedRecords, read_key_values
from jointstiff.service.importing.texts.listed_rows import read_listed_rows
from jointstiff.service.importing.texts.point_reports import PointReport, read_point_report

# ---- limits: files are hostile until parsed

MAX_FILE_BYTES: Final = 8 * 1024 * 1024
"""All files of an import together, as they are sent: as much as a measurement set that is posted."""
MAX_FILES: Final = 64
"""Files of an import: a table, and one for each of 16 targets in each state."""
MAX_LINES: Final = 400_000
"""Lines of all files together: rows, comments, empty lines. Each takes 200 bytes until it is understood."""
MAX_LINE_LENGTH: Final = limits.MAX_COLUMNS * limits.MAX_CELL_LENGTH
MAX_NUMBER_LENGTH: Final = 40

COMMENT_MARKS: Final = ("#", "//", "%")
_NUMBERING_HEADER: Final = re.compile(r"#[;,\t]\s*[^\W\d]")
"""Start of a header whose first column, `#`, has the numbers of the rows."""

CellKind = Literal[
    "text", "number", "date", "percentage", "truth value", "error", "formula", "complex number",
    "half-precision number",
]  # fmt: skip

EMPTY_CELL_KIND: Final[tuple[CellKind, ...]] = ("text",)
"""Kind of one empty cell."""


@dataclass(frozen=True, slots=True)
class Row:
    """One row."""

    line: int  # line of a text file or row of a sheet, from 1
    cells: tuple[str, ...]  # without blanks at the ends
    # what each cell of a sheet or of an array is; None in a text file, where all is text
    kinds: tuple[CellKind, ...] | None = None

    def resize(self, width: int) -> Row:
        """Return the row with so many cells: further cells are cut off, and empty cells are added."""
        missing = width - len(self.cells)
        kinds = None if self.kinds is None else (*self.kinds[:width], *missing * EMPTY_CELL_KIND)
        return Row(self.line, (*self.cells[:width], *missing * ("",)), kinds)


class Remark(NamedTuple):
    """A comment, or a title above the table."""

    line: int  # line of a text file or row of a sheet, from 1
    text: str  # without the mark of comments; a tab between the cells of a sheet


@dataclass(frozen=True, slots=True)
class Grid:
    """All rows of a file."""

    preview: FilePreview  # name and format of the file, and what was assumed in reading it
    rows: tuple[Row, ...]  # rows that are neither empty nor comments; all of one length in a sheet
    comments: tuple[Remark, ...] = ()  # rows that begin with a mark of comments
    has_final_line_break: bool = True  # False if the last line of a text may be cut off
    is_one_of_several: bool = False  # whether other sheets of the file were read, too

    @property
    def file(self) -> str:
        """Name of the file."""
        return self.preview.file

    @property
    def stem(self) -> str:
        """Name of the file without its extension."""
        return PurePath(self.file).stem

    @property
    def own_sheet(self) -> str:
        """Name of the sheet, if other sheets of the file were read, too; else empty."""
        return self.preview.sheet or "" if self.is_one_of_several else ""

    def place(self, row: Row, column: int | None = None) -> Place:
        """Return the place of a row, or of the row's cell in the column with this index (from 0)."""
        return Place(self.file, row.line, None if column is None else column + 1)

    def show_cells(self, row: Row) -> list[str]:
        """Return the cells of a row for people: as a text has them, numbers of a sheet with 15 digits."""
        is_text = self.preview.format == "text"
        return list(row.cells if is_text else map(_round_binary, row.cells))

    def preview_table(
        self,
        header_lines: Sequence[int],
        rows: Sequence[Row],
        columns: Sequence[ColumnMeaning],
        decimal_mark: DecimalMark | None,
        assumptions: Sequence[str],
    ) -> FilePreview:
        """Return the preview of the file as a table that was understood.

        Args:
            header_lines: lines of the header.
            rows: rows of data.
            columns: meaning of each column.
            decimal_mark: decimal mark of the numbers; None if the mark is not clear.
            assumptions: all that was assumed in reading the file.
        """
        first_rows = rows[:MAX_PREVIEW_ROWS]
        understood = {
            "decimal_mark": decimal_mark if self.preview.format == "text" else None,
            "columns": columns,
            "row_count": len(rows),
            "first_rows": [self.show_cells(row) for row in first_rows],
            "assumptions": assumptions,
            "header_lines": header_lines,
            "first_lines": [row.line for row in first_rows],
        }
        return self.preview.model_copy(update=understood)


_BINARY: Final = re.compile(r"[+-]?\d+\.\d{9,}(?:[eE][+-]?\d+)?")
"""Number with more digits than a person writes, such as 841.8997000000001."""


def _round_binary(cell: str) -> str:
    """Return a cell for people: a binary number as Excel shows it, with 15 digits; other cells unchanged."""
    return f"{float(cell):.15g}" if _BINARY.fullmatch(cell) else cell


def no_rows_error(file: str) -> ImportFileError:
    """Return the error that a file has no row of data."""
    return ImportFileError(Place(file), "the file has no row of data", "check that this is the right file")


def too_large_error(file: str, line: int) -> ImportFileError:
    """Return the error that a table has too many columns or cells; `line` is where the limit is exceeded."""
    reason = f"the file has more than {limits.MAX_COLUMNS} columns or {limits.MAX_CELLS} cells"
    return ImportFileError(Place(file, line), reason, "remove columns that are not needed, or split the file")


def is_comment(line: str) -> bool:
    """Return whether a line is a comment, and no header whose first column is `#`."""
    text = line.lstrip()
    return text.startswith(COMMENT_MARKS) and not _NUMBERING_HEADER.match(text)


def strip_comment_mark(text: str) -> str:
    """Return a comment without its mark."""
    return next(text.removeprefix(mark).strip() for mark in COMMENT_MARKS if text.startswith(mark))


# ---- types of files, by their first bytes or the parts of an archive

XML: Final = "an XML document"
_SIGNATURES: Final = (
    (b"%PDF-", "a PDF document"),
    (b"\x89PNG\r\n", "a picture (PNG)"),
    (b"\xff\xd8\xff", "a picture (JPEG)"),
    (b"GIF8", "a picture (GIF)"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive"),
    (b"Rar!", "a RAR archive"),
    (b"\xd0\xcf\x11\xe0", "an old Office document (such as .xls), or an encrypted one"),
    (b"{\\rtf", "an RTF document"),
    (b"<?xml", XML),
    (b"<svg", "a picture (SVG)"),
)
JSON: Final = "a JSON document"
CERTIFICATE: Final = "a digital calibration certificate (DCC)"
VAL3: Final = "data of a VAL3 program (.dtx)"
_VAL3_NAMESPACE: Final = b"robotics/VAL3/Data"
_CERTIFICATE_NAMESPACE: Final = b"https://ptb.de/dcc"
_FIRST_BYTES: Final = 4096
"""Bytes of a file of XML among which its root names the schema."""
WORKBOOK: Final = "an Excel workbook (.xlsx)"
SPREADSHEET: Final = "an OpenDocument spreadsheet (.ods)"
WORKBOOKS: Final = (WORKBOOK, SPREADSHEET)
WEB_PAGE: Final = "a web page (HTML)"
LATEX: Final = "a text in LaTeX"
WITH_SHEETS: Final = (*WORKBOOKS, WEB_PAGE, LATEX)
"""Types of files whose tables are read as sheets."""
_WEB_PAGE_START: Final = re.compile(
    rb"\s*(?P<xml><\?xml(?:(?!\?>).)*\?>\s*)?(?:<!--(?:(?!-->).)*-->\s*)*"
    rb"<(?:!doctype\s+html|html|(?(xml)(?!)|(?:head|meta|title|style|body|table|center|h1)))\b",
    re.IGNORECASE | re.DOTALL,
)
"""Beginning of a web page, which programs may save without its outer elements."""
_LATEX_TABLE: Final = re.compile(
    rb"^[ \t]*(?:[\\{][^\n%]*)?\\begin\{(?:tabular[*xy]?|longtable|tblr|longtblr)\}", re.MULTILINE
)
"""Beginning of a table of LaTeX, perhaps behind other commands."""
_ZIP: Final = b"PK\x03\x04"
_TYPES_BY_PART: Final = (
    ("xl/workbook.bin", "a binary Excel workbook (.xlsb)"),
    ("word/document.xml", "a Word document"),
    ("ppt/presentation.xml", "a PowerPoint presentation"),
    ("content.xml", SPREADSHEET),
)


ArrayFormat = Literal["mat", "npz", "hdf5", "parquet"]
_NPZ: Final = "an archive of NumPy (.npz)"
ARRAYS: Final[Mapping[str, ArrayFormat]] = MappingProxyType(
    {"a MATLAB file": "mat", _NPZ: "npz", "an HDF5 file": "hdf5", "a Parquet file": "parquet"}
)
"""Type of a file of arrays → format; MATLAB writes HDF5 since version 7.3."""
_SIGNATURES_OF_ARRAYS: Final = (
    (b"MATLAB 5.0 MAT-file", "a MATLAB file"),
    (b"MATLAB 7.3 MAT-file", "an HDF5 file"),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file"),
    (b"PAR1", "a Parquet file"),
)
PACKED_SIGNATURES: Final = (_ZIP, *(signature for signature, _ in _SIGNATURES_OF_ARRAYS))
"""First bytes of files whose content may be many times as large as the file."""


def file_type(content: bytes, name: str = "") -> str | None:
    """Return the type of a file in words, such as `a PDF document`; None for text and unknown types."""
    if content.startswith(_ZIP):
        return _archive_type(content)
    for signature, words in _SIGNATURES_OF_ARRAYS:
        if content.startswith(signature):
            return words
    if content[4:8] == b"ftyp":
        return "a picture (HEIC) or a film"
    return _text_type(content, name)


def _text_type(content: bytes, name: str) -> str | None:
    """Return the type of a text in words; None for text of no known type."""
    # White space, or a byte order mark of UTF-8 or UTF-16, may come before the first sign of the content.
    start = content[:256].lstrip(b"\xef\xbb\xbf \t\r\n")
    ends_with_bracket = content.rstrip()[-1:] in (b"}", b"]")
    is_val3 = _VAL3_NAMESPACE in content[:_FIRST_BYTES] or name.lower().endswith(".dtx")
    if start.startswith(b"<") and _CERTIFICATE_NAMESPACE in content[:_FIRST_BYTES]:
        return CERTIFICATE
    if start.startswith(b"<") and is_val3:
        return VAL3
    if start.lstrip(b"\xff\xfe\0")[:1] in (b"{", b"[") and (
        ends_with_bracket or name.lower().endswith(".json")
    ):
        return JSON
    known = next((words for signature, words in _SIGNATURES if start.startswith(signature)), None)
    return _document_type(content) or known if known in (None, XML) else known


def _document_type(content: bytes) -> str | None:
    """Return the type of a web page, or of a text in LaTeX with tables; None for other texts."""
    first = content[:_FIRST_BYTES].translate(None, b"\0").lstrip(b"\xef\xbb\xbf\xff\xfe")
    if _WEB_PAGE_START.match(first):
        return WEB_PAGE
    is_latex = b"\\begin{" in content and _LATEX_TABLE.search(content) is not None
    return LATEX if is_latex else None


def _archive_type(content: bytes) -> str | None:
    """Return the type of a ZIP archive in words, such as `a Word document`.

    A damaged archive is called a workbook, so that the reader of workbooks reports the damage.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names = {part.filename for part in archive.infolist()}
    except (zipfile.BadZipFile, OSError, ValueError, RuntimeError, LookupError, OverflowError):
        return WORKBOOK
    if names and all(name.endswith(".npy") for name in names):
        return _NPZ
    known = next((words for part, words in _TYPES_BY_PART if part in names), None)
    return known or (WORKBOOK if any("xl/" in name for name in names) else "a ZIP archive")


# ---- delimited text: its encoding, lines, comments, quotation marks and the delimiter

CHARACTERS: Final[Mapping[Delimiter, str]] = MappingProxyType(
    {"comma": ",", "semicolon": ";", "tab": "\t", "whitespace": " "}
)
_LINE_END: Final = re.compile(r"\r\n|\n|\r")
_CELLS: Final = {
    character: re.compile(rf'(?:{blanks}"([^"]*(?:""[^"]*)*)"{blanks}|([^{character}]*))({character}[ ]*|$)')
    for character, blanks in ((",", r"[ \t]*"), (";", r"[ \t]*"), ("\t", "[ ]*"), (" ", ""))
}
"""Delimiter → a cell: its text in quotation marks, or its text without marks around it; and the delimiter."""
_INCHES: Final = re.compile(r'(?<=[\d¼½¾])"')
"""The sign of inches behind a number."""
COORDINATES: Final = 3
"""Coordinates of a position."""
LEAST_NUMBERS: Final = COORDINATES
"""Numbers of a row of data, at least: a position."""
_NUMBERS_IN_A_CELL: Final = re.compile(r"\d\s+[-+.\d]")
_COMMA_NOT_IN_A_NUMBER: Final = re.compile(r"(?<!\d),|,(?!\d)")
_LINES_SHOWING_DELIMITER: Final = 10
"""Lines at the end of a file that tell its delimiter."""
_MAX_TITLE_LINES: Final = 20
"""Lines above the header."""
NumberedLine = tuple[int, str]
"""Number of a line, from 1, and its text."""


def read_text(
    file: str,
    content: bytes,
    delimiter: Delimiter | None,
    *,
    are_marks_literal: bool = False,
    is_table: bool = False,
) -> Grid:
    """Decode a text file and split it into cells; find the delimiter from the lines if `delimiter` is None.

    With `are_marks_literal`, quotation marks that enclose no cell are characters, as of `split_line`.

    A robot program with joint positions, a report of measured points, or records of named numbers are read as
    a table of these, unless the file is known to be one, with `is_table`: its cells may have such texts.

    Raises:
        ImportFileError: the file is not plain text, has no row, or its delimiter is ambiguous.
    """
    text, encoding = decode(file, content)
    if is_table:
        written = _read_table(file, text, encoding, delimiter, are_marks_literal=are_marks_literal)
        # The files that were sent may have another delimiter than the table that the import wrote.
        return replace(written, preview=written.preview.model_copy(update={"delimiter": None}))
    if positions := read_joint_positions(text):
        return _build_grid_of_positions(file, encoding, positions)
    if states := read_joint_states(text) or read_rows_of_joint_states(text):
        return _build_grid_of_records(file, encoding, states)
    if report := read_point_report(file, text):
        return _build_grid_of_points(file, encoding, text, report)
    if records := read_key_values(text):
        return _build_grid_of_records(file, encoding, records)
    return _read_table(file, text, encoding, delimiter, are_marks_literal=are_marks_literal)


def _read_table(
    file: str, text: str, encoding: str, delimiter: Delimiter | None, *, are_marks_literal: bool
) -> Grid:
    """Split the lines of a text into cells, and set comments aside."""
    lines: list[NumberedLine] = []
    comments: list[Remark] = []
    for number, line in enumerate(_LINE_END.split(text), start=1):
        stripped = line.strip(" \t")
        if is_comment(stripped):
            comments.append(Remark(number, strip_comment_mark(stripped)))
        elif stripped:
            lines.append((number, line))
    if delimiter is None and lines:
        delimiter = find_delimiter(file, lines, are_marks_literal=are_marks_literal)
    split = _split_lines(file, lines, delimiter or "comma", are_marks_literal=are_marks_literal)
    rows = [row for row in split if any(row.cells)]
    if not rows:
        raise no_rows_error(file)
    notes = _describe_comments(comments, delimiter, width=len(rows[-1].cells))
    preview = FilePreview(file=file, format="text", encoding=encoding, delimiter=delimiter, assumptions=notes)
    last_comment = comments[-1].line if comments else 0
    # A comment below the last row shows, like a line break, that this row is complete.
    is_complete = text.rstrip(" \t").endswith(("\n", "\r")) or last_comment > lines[-1][0]
    return Grid(preview, tuple(rows), tuple(comments), is_complete)


def _describe_comments(comments: Sequence[Remark], delimiter: Delimiter | None, width: int) -> list[str]:
    """Return notes on the comments that were skipped; no notes without comments.

    A comment with as many cells as the table has, `width`, and a number in the last cell may be a disabled
    row.
    """
    if not comments:
        return []
    count = f"{len(comments)} line{'s' * (len(comments) > 1)}"
    notes = [f"comments were skipped ({count}); the first: {quote(comments[0].text)}"]
    character = None if delimiter == "whitespace" else CHARACTERS[delimiter or "comma"]
    row_like_count = 0
    for comment in comments:
        cells = comment.text.split(character)
        if len(cells) == width > 1 and looks_like_a_number(cells[-1].strip()):
            row_like_count += 1
    if row_like_count:
        notes.append(f"{row_like_count} comments look like rows of data, and were not read")
    return notes


def _build_grid_of_positions(file: str, encoding: str, positions: Sequence[JointPosition]) -> Grid:
    """Return the joint positions of a robot program as a table with a header.

    The names of the positions are labels if each has a name of its own. Fields that all positions have, such
    as `LAST=1` in a log, are columns.
    """
    note = f"{len(positions)} joint positions of a robot program were read, in degrees and in their order"
    preview = FilePreview(file=file, format="text", encoding=encoding, assumptions=[note])
    angles = tuple(f"J{number + 1} [deg]" for number in range(len(positions[0].angles)))
    keys = tuple(key for key, _ in positions[0].fields)
    have_fields = all(tuple(key for key, _ in each.fields) == keys for each in positions)
    header = (*keys, *angles) if have_fields else angles
    cells = [each.angles for each in positions]
    if have_fields:
        cells = [(*(text for _, text in each.fields), *each.angles) for each in positions]
    names = {each.name for each in positions if each.name}
    if len(names) < len(positions):
        rows = (Row(each.line, own) for each, own in zip(positions, cells, strict=True))
        return Grid(preview, (Row(1, header), *rows))
    rows = (Row(each.line, (each.name, *own)) for each, own in zip(positions, cells, strict=True))
    return Grid(preview, (Row(1, ("label", *header)), *rows))


def _build_grid_of_points(file: str, encoding: str, text: str, report: PointReport) -> Grid:
    """Return the measured points of a report as a table with a header.

    Raises:
        ImportFileError: there are too many points, or a name is too long.
    """
    if len(report.points) > limits.MAX_ROWS:
        raise ImportFileError(
            Place(file), f"the file has more than {limits.MAX_ROWS} points", "split the file"
        )
    note = f"{len(report.points)} measured points of a report were read, in their order"
    preview = FilePreview(file=file, format="text", encoding=encoding, assumptions=[note])
    unit = f" [{report.unit}]" if report.unit else ""
    header = Row(1, ("name", *(f"{axis}{unit}" for axis in "xyz")))
    rows = tuple(
        Row(each.line, (each.name, *map(write_ascii_minus, each.coordinates))) for each in report.points
    )
    return Grid(preview, (header, *rows), has_final_line_break=text.endswith(("\n", "\r")))


def _build_grid_of_records(file: str, encoding: str, records: KeyedRecords) -> Grid:
    """Return records of named numbers as a table with a header.

    Raises:
        ImportFileError: a text is too long, or there are too many of them.
    """
    rows = [Row(line, tuple(map(write_ascii_minus, texts))) for line, texts in records.rows]
    if len(rows) > limits.MAX_ROWS or len(rows) * len(records.headers) > limits.MAX_CELLS:
        raise too_large_error(file, rows[-1].line)
    for row in rows:
        for cell in row.cells:
            if len(cell) > limits.MAX_CELL_LENGTH:
                reason = f"a text has more than {limits.MAX_CELL_LENGTH} characters: {quote(cell)}"
                raise ImportFileError(Place(file, row.line), reason, "shorten the text")
    note = f"{len(rows)} records of named numbers were read as rows"
    preview = FilePreview(file=file, format="text", encoding=encoding, assumptions=[note])
    remarks = tuple(Remark(line, text) for line, text in records.remarks)
    return Grid(preview, (Row(1, records.headers), *rows), remarks)


def read_lists(file: str, content: bytes) -> Grid | None:
    """Return the table of a log with lists of numbers in brackets; None of other texts.

    Raises:
        ImportFileError: the text is damaged, or has too many lists.
    """
    text, encoding = decode(file, content)
    lists = None if read_joint_positions(text) else read_listed_rows(text)
    return None if lists is None else _build_grid_of_records(file, encoding, lists)


_LEAST_CELLS: Final = 3
"""Cells of a line that shows that blanks separate numbers."""


def find_delimiter(file: str, lines: Sequence[NumberedLine], *, are_marks_literal: bool = False) -> Delimiter:
    """Find the delimiter: tab or semicolon if most of the last lines have one, else comma or whitespace.

    With `are_marks_literal`, quotation marks that enclose no cell are characters if the lines cannot be split
    otherwise.

    Raises:
        ImportFileError: the lines can be split by commas as well as by blanks.
    """
    last_lines = [text.strip(" ") for _, text in lines[-_LINES_SHOWING_DELIMITER:]]
    marks: tuple[Delimiter, Delimiter] = ("tab", "semicolon")
    for mark in marks:
        if _have_most(last_lines, CHARACTERS[mark]):
            return mark
    if not _have_most(last_lines, ",") and "," not in lines[0][1]:
        return "whitespace"
    possible = _list_delimiters(file, lines, are_marks_literal=False)
    if not possible and are_marks_literal:
        possible = _list_delimiters(file, lines, are_marks_literal=True)
    if len(possible) > 1:
        raise ImportFileError(
            Place(file, lines[0][0]),
            "the comma may be the delimiter, or the decimal mark of cells that blanks separate",
            "give `delimiter`, or use semicolons as delimiter",
            "delimiter",
        )
    if possible:
        return possible[0]
    return "whitespace" if _are_numbers_between_blanks(last_lines) else "comma"


def _are_numbers_between_blanks(lines: Sequence[str]) -> bool:
    """Return whether most lines are numbers between blanks, as in columns of a fixed width with empty cells.

    Numbers between commas have no blanks, or a comma before each blank.
    """
    of_numbers = [
        line
        for line in lines
        if len(cells := line.split()) >= _LEAST_CELLS and all(map(looks_like_a_number, cells))
    ]
    return 2 * len(of_numbers) > len(lines)


def _list_delimiters(file: str, lines: Sequence[NumberedLine], *, are_marks_literal: bool) -> list[Delimiter]:
    """Return which of commas and blanks split lines into rows; arguments as of `find_delimiter`."""
    possible = list[Delimiter]()
    if _can_be_split_by_blanks(file, lines, are_marks_literal=are_marks_literal):
        possible.append("whitespace")
    if _can_be_split_by_commas(file, lines, are_marks_literal=are_marks_literal):
        possible.append("comma")
    return possible


def _have_most(lines: Sequence[str], character: str) -> bool:
    """Return whether more than half of some lines have a character."""
    return 2 * sum(character in line for line in lines) > len(lines)


def _can_be_split_by_commas(file: str, lines: Sequence[NumberedLine], *, are_marks_literal: bool) -> bool:
    """Return whether commas split lines into rows of equal length, without a cell of several numbers.

    The first row may be a header, whose names may contain numbers and blanks.
    """
    rows = _split_into_equal_rows(file, lines, "comma", are_marks_literal=are_marks_literal)
    cells = (cell for row in rows[1:] or rows for cell in row)
    return bool(rows) and not any(_NUMBERS_IN_A_CELL.search(cell) for cell in cells)


def _can_be_split_by_blanks(file: str, lines: Sequence[NumberedLine], *, are_marks_literal: bool) -> bool:
    """Return whether blanks split lines into rows of equal length, with commas only inside of numbers."""
    rows = _split_into_equal_rows(file, lines, "whitespace", are_marks_literal=are_marks_literal)
    cells = (cell for row in rows for cell in row)
    return bool(rows) and not any(_COMMA_NOT_IN_A_NUMBER.search(cell) for cell in cells)


def _split_into_equal_rows(
    file: str, lines: Sequence[NumberedLine], delimiter: Delimiter, *, are_marks_literal: bool
) -> list[tuple[str, ...]]:
    """Split lines at a delimiter; return the rows of cells below the titles, or [] if their lengths differ.

    Each row must have two cells at least; up to 20 lines of titles may come before the rows.
    """
    try:
        split = _split_lines(file, lines, delimiter, are_marks_literal=are_marks_literal)
        rows = [row.cells for row in split]
    except ImportFileError:
        return []
    width = len(rows[-1])
    first_row = next((index for index, cells in enumerate(rows) if len(cells) == width), 0)
    have_equal_lengths = first_row <= _MAX_TITLE_LINES and all(
        len(cells) == width for cells in rows[first_row:]
    )
    return rows[first_row:] if have_equal_lengths and width > 1 else []


def _split_lines(
    file: str, lines: Iterable[NumberedLine], delimiter: Delimiter, *, are_marks_literal: bool
) -> Iterator[Row]:
    """Yield the row of cells of each line, in the order of the lines; arguments as of `split_line`.

    Raises:
        ImportFileError: there are too many rows, columns or cells, or a line cannot be split.
    """
    cell_count = 0
    for index, (number, text) in enumerate(lines):
        if index == limits.MAX_ROWS:
            reason = f"the file has more than {limits.MAX_ROWS} rows"
            raise ImportFileError(Place(file, number), reason, "split the file")
        row = split_line(file, number, text, delimiter, are_marks_literal=are_marks_literal)
        cell_count += len(row.cells) if any(row.cells) else 0
        if len(row.cells) > limits.MAX_COLUMNS or cell_count > limits.MAX_CELLS:
            raise too_large_error(file, number)
        yield row


def split_line(
    file: str, number: int, text: str, delimiter: Delimiter, *, are_marks_literal: bool = False
) -> Row:
    """Split one line into cells without blanks at their ends; cells may be in quotation marks.

    A mark behind a digit means inches, as in `1.5"`. With `are_marks_literal`, for a proposal, other marks
    that enclose no cell are characters, too, unless they leave open where a cell of a row of data ends.

    Raises:
        ImportFileError: the line or a cell is too long, or quotation marks are misplaced.
    """
    place = Place(file, number)
    if len(text) > MAX_LINE_LENGTH:
        reason = f"a line has more than {MAX_LINE_LENGTH} characters"
        raise ImportFileError(place, reason, "save the file with a line break after each row")
    if delimiter == "whitespace":
        text = text.replace("\t", " ").strip(" ")
    character = CHARACTERS[delimiter]
    cells = _split_quoted(text, character) if '"' in text else _split_plain(text, character)
    row = Row(number, tuple(write_ascii_minus(cell.text) for cell in cells))
    if '"' in text:
        is_title = count_numbers(row) < LEAST_NUMBERS
        for column, cell in enumerate(cells, start=1):
            if not are_marks_literal or not (is_title or cell.has_pairs):
                _refuse_marks(cell, place._replace(column=column))
    for column, text_of_cell in enumerate(row.cells, start=1):
        if len(text_of_cell) > limits.MAX_CELL_LENGTH:
            reason = f"a cell has more than {limits.MAX_CELL_LENGTH} characters: {quote(text_of_cell)}"
            remedy = "check for a missing quotation mark or delimiter"
            raise ImportFileError(place._replace(column=column), reason, remedy)
    return row


class _Cell(NamedTuple):
    """A cell of a line."""

    text: str  # without blanks at its ends
    is_enclosed: bool = False  # whether quotation marks enclosed the cell

    @property
    def has_pairs(self) -> bool:
        """Return whether no mark begins the cell without another mark that ends the quotation."""
        return not self.text.startswith('"') or self.text.count('"') % 2 == 0


def _split_plain(text: str, character: str) -> list[_Cell]:
    """Split a line without quotation marks; several blanks separate two cells like one blank."""
    cells = next(csv.reader([text], delimiter=character, skipinitialspace=True), [""])
    return [_Cell(cell.strip(" \t")) for cell in cells]


def _split_quoted(text: str, character: str) -> list[_Cell]:
    """Split a line at a character that is not in quotation marks around a whole cell."""
    cells = list[_Cell]()
    for found in _CELLS[character].finditer(text):
        enclosed, plain, mark = found.groups()
        if enclosed is None:
            cells.append(_Cell(plain.strip(" \t")))
        else:
            cells.append(_Cell(enclosed.replace('""', '"').strip(" \t"), is_enclosed=True))
        is_last = not mark
        if is_last:
            break
    return cells


def _refuse_marks(cell: _Cell, place: Place) -> None:
    """Refuse a cell in which quotation marks are misplaced.

    Raises:
        ImportFileError: marks begin the cell without enclosing it, or occur within it.
    """
    if cell.is_enclosed or '"' not in cell.text:
        return
    if cell.text.startswith('"'):
        remedy = 'enclose a cell as in "Point 1", on one line, or remove the marks'
        place = place._replace(column=None)
        raise ImportFileError(place, "quotation marks do not enclose a whole cell", remedy)
    if '"' in _INCHES.sub("", cell.text):
        reason = f"a quotation mark occurs within a cell, {quote(cell.text)}"
        raise ImportFileError(place, reason, "remove the quotation mark")


# ---- numbers as people and instruments write them, read strictly or not at all

_NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_THOUSANDS: Final = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:[.,][0-9]{3})+")
_WITH_THOUSANDS: Final = (
    r"[+-]?[1-9][0-9]{0,2}(?P<separator>[%s'\u2019 \xa0\u202f])[0-9]{3}(?:(?P=separator)[0-9]{3})*[%s][0-9]+"
)
"""A number with separators of thousands; it has decimals, so that the separators are certain."""
_OTHER_MINUS: Final = re.compile("[\u2212\u2012\u2013\ufe63\uff0d]")
"""Minus sign, figure dash, en dash, small and full-width hyphen-minus."""
_SEPARATED: Final = re.compile(
    r"[+-]?[1-9][0-9]{0,2}(?P<separator>[.,'\u2019 \xa0\u202f])[0-9]{3}(?:(?P=separator)[0-9]{3})*"
    r"(?!(?P=separator))(?P<mark>[.,])[0-9]+"
)
"""A number with separators of thousands and either decimal mark."""
_FOUR_DIGITS: Final = re.compile(r"[+-]?[0-9]{4}")
_POINT_ASSUMED: Final = (
    "the point was read as the decimal mark, although three digits follow it in every number: check "
    "that the point is not a thousands separator"
)


def write_ascii_minus(text: str) -> str:
    """Return a number with the minus of ASCII in place of signs such as `−` or `–`; other texts unchanged.

    Such signs come from word processors, from Matplotlib and from web pages.
    """
    if text.isascii():
        return text
    with_minus = _OTHER_MINUS.sub("-", text)
    return with_minus if looks_like_a_number(with_minus) else text


def looks_like_a_number(text: str) -> bool:
    """Return whether a text is a number with a decimal point or comma, perhaps with separated thousands."""
    return is_plain_number(text.replace(",", ".")) or _find_mark_by_thousands(text) is not None


def are_texts(texts: Iterable[str]) -> bool:
    """Return whether no cell is empty, or a number."""
    return all(text and not looks_like_a_number(text) for text in texts)


def is_plain_number(text: str) -> bool:
    """Return whether a text is a number with a decimal point, and without separators of thousands."""
    return _NUMBER.fullmatch(text) is not None


def _find_mark_by_thousands(text: str) -> DecimalMark | None:
    """Return the decimal mark that separated thousands show, as in `1.299,99`; None for other texts."""
    match = _SEPARATED.fullmatch(text)
    if match is None:
        return None
    return "point" if match["mark"] == "." else "comma"


def has_separated_thousands(rows: Iterable[Row], columns: Collection[int]) -> bool:
    """Return whether all numbers above 1000 have separators of thousands, and at least one shows decimals."""
    cells = [row.cells[column] for row, column in product(rows, columns)]
    is_separated = any(_SEPARATED.fullmatch(cell) for cell in cells)
    return is_separated and not any(_FOUR_DIGITS.match(cell) for cell in cells)


def count_numbers(row: Row) -> int:
    """Return how many cells of a row look like numbers."""
    return sum(map(looks_like_a_number, row.cells))


def decide_decimal_mark(
    grid: Grid,
    rows: Iterable[Row],
    columns: Collection[int],
    stated_mark: DecimalMark | None,
    *,
    are_thousands_separated: bool = False,
) -> tuple[DecimalMark, str | None]:
    """Return the decimal mark of a file, and a note for the user if the mark was assumed, else None.

    `1,234` alone may be 1.234 or 1234. It is read as 1.234 if another number of the file has a comma that
    cannot separate thousands, such as `12,5` or `0,125`. Numbers in sheets and arrays have a point.
    `are_thousands_separated` states that `1.299,99` is a number of the file.

    Raises:
        ImportFileError: the file has decimal points and decimal commas, or the mark is ambiguous.
    """
    if grid.preview.format != "text":
        return _decide_mark_of_texts(grid, rows, columns, stated_mark), None
    if stated_mark is not None:
        return stated_mark, None
    first_cells, sure_marks = _find_marks(
        grid, rows, columns, are_thousands_separated=are_thousands_separated
    )
    if len(first_cells) > 1:
        text, place = max(first_cells.values(), key=lambda cell: (cell[1].line or 0, cell[1].column or 0))
        reason = f"{quote(text)}: the file has decimal points and decimal commas"
        raise ImportFileError(place, reason, "use one decimal mark and no thousands separators")
    if "," in first_cells and "," not in sure_marks:
        text, place = first_cells[","]
        reason = "may have a decimal comma or a thousands separator; no other number in the file shows which"
        remedy = "give `decimal_mark`, or write a decimal point"
        raise ImportFileError(place, f"{quote(text)} {reason}", remedy, "decimal_mark")
    if "," in first_cells:
        return "comma", "the comma was used as the decimal mark"
    return "point", _POINT_ASSUMED if "." in first_cells and "." not in sure_marks else None


def _find_marks(
    grid: Grid, rows: Iterable[Row], columns: Collection[int], *, are_thousands_separated: bool
) -> tuple[dict[str, tuple[str, Place]], set[str]]:
    """Return text and place of the first cell with each mark; and the marks that separate no thousands."""
    first_cells: dict[str, tuple[str, Place]] = {}
    sure_marks: set[str] = set()
    for row, column in product(rows, columns):
        text = row.cells[column]
        if lacks_number(text) or not any(map(str.isdigit, text)):
            continue
        marks = [mark for mark in ",." if mark in text]
        mark_by_thousands = _find_mark_by_thousands(text) if are_thousands_separated else None
        if mark_by_thousands is not None:
            marks = ["." if mark_by_thousands == "point" else ","]
        for mark in marks:
            if mark not in first_cells:
                first_cells[mark] = text, grid.place(row, column)
            may_separate_thousands = mark_by_thousands is None and _THOUSANDS.fullmatch(text)
            sure_marks.update([] if may_separate_thousands else [mark])
    return first_cells, sure_marks


def find_mark_of_texts(grid: Grid, rows: Sequence[Row], columns: Collection[int]) -> DecimalMark | None:
    """Return the decimal mark of numbers that a sheet has as texts; None unless the texts show one mark.

    A cell of numbers with decimals, which has a point, leaves the mark open.
    """
    cells = [(row, column) for row, column in product(rows, columns) if row.kinds]
    are_texts = [row.kinds[column] == "text" for row, column in cells if row.kinds]
    has_decimals = any(
        not is_text and "." in row.cells[column]
        for is_text, (row, column) in zip(are_texts, cells, strict=True)
    )
    first_cells, sure_marks = _find_marks(grid, rows, columns, are_thousands_separated=False)
    if has_decimals or not any(are_texts) or set(first_cells) != sure_marks or len(sure_marks) != 1:
        return None
    return "comma" if "," in sure_marks else "point"


def _decide_mark_of_texts(
    grid: Grid, rows: Iterable[Row], columns: Collection[int], stated_mark: DecimalMark | None
) -> DecimalMark:
    """Return the decimal mark of numbers that a sheet or an array has as texts; the point if there are none.

    Raises:
        ImportFileError: there are numbers as texts, and their decimal mark is not stated.
    """
    texts = [
        (row, column)
        for row in rows
        for column in columns
        if row.kinds and row.kinds[column] == "text" and looks_like_a_number(row.cells[column])
    ]
    if texts and stated_mark is None:
        row, column = texts[0]
        reason = f"{len(texts)} cells have numbers as texts, the first {quote(row.cells[column])}"
        remedy = "give `decimal_mark`, or format the cells as numbers"
        raise ImportFileError(grid.place(row, column), reason, remedy, "decimal_mark")
    return stated_mark if texts and stated_mark else "point"


def remove_thousands_separators(text: str, mark: DecimalMark) -> str:
    """Return a number with this decimal mark without its separators of thousands; other texts unchanged."""
    other_mark, decimal_mark = (",", ".") if mark == "point" else (".", ",")
    match = re.fullmatch(_WITH_THOUSANDS % (other_mark, decimal_mark), text)
    return text.replace(match["separator"], "") if match else text


def read_number(text: str, mark: DecimalMark) -> float:
    """Return the number in the text of a cell: digits, with at most one decimal mark and an exponent.

    Raises:
        ImportFileError: the cell is empty, not a number with this decimal mark, or too large.
    """
    if not text:
        raise ImportFileError(NOWHERE, "the cell is empty, but needs a number", "fill in the cell")
    other_mark = "," if mark == "point" else "."
    with_point = text if mark == "point" else text.replace(",", ".")
    if other_mark in text or len(text) > MAX_NUMBER_LENGTH or not _NUMBER.fullmatch(with_point):
        reason = f"{quote(text)} is not a number with a decimal {mark}"
        remedy = "use digits with at most one decimal mark, no unit, no thousands separator, no NaN"
        raise ImportFileError(NOWHERE, reason, remedy)
    value = float(with_point)
    if not abs(value) <= MAX_MAGNITUDE:
        reason = f"{quote(text)} is outside ±{MAX_MAGNITUDE:g}"
        raise ImportFileError(NOWHERE, reason, "check the number and its unit")
    return value
