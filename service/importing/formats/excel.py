"""Excel workbooks as grids: archives from strangers, unpacked and parsed within limits.

An own reader instead of a library's. Where cells repeat or are out of order, openpyxl 3.1 and python-calamine
0.9 drop rows silently; calamine also reads `2&#46;5` as 2, does not distinguish 50 % from 0.5, and aborts the
process on a single cell far from the others. Here such files are refused or read in full.
"""

from __future__ import annotations

import io
import posixpath
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from itertools import product
from types import MappingProxyType
from typing import IO, Final, Protocol
from xml.etree.ElementTree import Element, ParseError, XMLParser, iterparse

from jointstiff.schemas.imports import FilePreview
from jointstiff.service.importing import grid, limits
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grid import EMPTY_CELL_KIND, CellKind, Grid, Remark, Row, write_ascii_minus
from jointstiff.service.importing.sheets import build_sheet_error, refuse_unknown_sheets, split_sheets

MAX_SHEET_CELLS: Final = 500_000
"""Cells of all sheets that are read, which take longer to read than those of a text."""
MAX_XML_TAGS: Final = 2_500_000
"""Tags in the parts of an Excel file that are read: four for each number, six for each text, and rows."""
_MAX_PARTS: Final = 1_000
_MAX_RATIO: Final = 100
"""Greatest ratio of the size of a part to its packed size; the ratio of sheets is around 10."""
_MAX_PLAIN_BYTES: Final = 1024 * 1024
"""Size of a part [bytes] below which the ratio of its sizes is not checked."""
_MAX_DEPTH: Final = 32
_MAX_MARKUP_BYTES: Final = 256 * 1024
"""Largest number of bytes within a tag or between two tags; no cell of Excel is longer."""
_MAX_CHILDREN: Final = 100_000
"""Largest number of elements in an element that is read as a whole, such as a row or a text."""
_LAST_ROW: Final = 1_048_576
"""Excel's last row."""

_NAMESPACES: Final = (
    "http://schemas.openxmlformats.org/spreadsheetml/2006/main",
    "http://purl.oclc.org/ooxml/spreadsheetml/main",
    "http://schemas.openxmlformats.org/package/2006/relationships",
)
_TAGS: Final = (
    "Relationship sheet si numFmts numFmt cellXfs xf col row c f v is t r rPr rPh phoneticPr extLst"
)
_LOCAL_NAMES: Final = MappingProxyType(
    {f"{{{space}}}{tag}": tag for space, tag in product(_NAMESPACES, _TAGS.split())}
)
"""Tags with their name spaces, and the names by which this module knows them; all others are unknown."""
_ALLOWED_CHILDREN: Final = MappingProxyType(
    {
        "row": {"c", "extLst"},
        "is": {"t", "r", "rPh", "phoneticPr"},
        "si": {"t", "r", "rPh", "phoneticPr"},
        "r": {"rPr", "t"},
    }
)
"""Elements in an element; any other could hold a value that would be lost."""
_KIND_OF_TYPE: Final[Mapping[str, CellKind]] = MappingProxyType(
    {"s": "text", "str": "text", "inlineStr": "text", "b": "truth value", "e": "error", "d": "date"}
)
_ZIP_FAULTS: Final = (
    zipfile.BadZipFile, zlib.error, struct.error, OSError, EOFError, ValueError, RuntimeError, LookupError,
    OverflowError,
)  # fmt: skip
"""What `zipfile` raises on damaged archives; NotImplementedError, of odd ones, is a RuntimeError."""

_ADDRESS: Final = re.compile(r"([A-Z]{1,3})([1-9][0-9]{0,6})")
_ROW_NUMBER: Final = re.compile(r"[1-9][0-9]{0,6}")
_DATES: Final = frozenset((*range(14, 23), *range(27, 37), *range(45, 48), *range(50, 59)))
_PERCENTAGES: Final = frozenset((9, 10))
_LITERAL_TEXT: Final = re.compile(r'"[^"]*"|\\.|_.|\*.|\[[^\]]*\]')
_LEAST_HEADERS: Final = 4
"""Fewest cells of a row that begins with the cell `#` and is no comment."""


def read_workbook(file: str, content: bytes, stated: str | None) -> list[Grid]:
    """Return sheets of a workbook as grids; a cell with a formula has the value that Excel stored.

    Args:
        file: name of the file, for messages.
        content: bytes of the file.
        stated: names of sheets, with semicolons between; if None, all sheets that are not empty.

    Raises:
        ImportFileError: the workbook cannot be read, or has no sheet of a name.
    """
    archive = Archive(file, content, "an Excel file (.xlsx)")
    sheet_parts, text_part, style_part = _find_parts(archive)
    elements = () if text_part is None else archive.elements(text_part, "si")
    max_length = limits.MAX_CELL_LENGTH + 1  # one character more than allowed is enough to refuse a text
    texts = [_join_text(archive, text)[:max_length] for text in elements]
    kinds = _find_number_kinds(archive, style_part)
    sheets = {name: _Sheet(archive, part, texts, kinds) for name, part in sheet_parts.items()}
    return build_grids(file, sheets, stated)


class Sheet(Protocol):
    """Sheet of a workbook, which is read row by row."""

    @property
    def notes(self) -> list[str]:
        """Notes for the user on the rows that were read last."""

    def rows(self) -> Iterator[Row]:
        """Yield the rows that are not empty, each up to its last cell with a text."""


def build_grids(file: str, sheets: Mapping[str, Sheet], stated: str | None) -> list[Grid]:
    """Return sheets as grids; arguments as of `read_workbook`.

    Raises:
        ImportFileError: a sheet cannot be read, or there is no sheet of a name.
    """
    refuse_unknown_sheets(file, stated, sheets, "the workbook has no sheet")
    names = [name for name in split_sheets(stated) if name is not None]
    if not names:
        names = [name for name, sheet in sheets.items() if next(sheet.rows(), None)] or list(sheets)[:1]
    try:
        return [_build_grid(file, name, sheets[name]) for name in names]
    except ImportFileError as fault:
        is_choice_open = stated is None and len(names) > 1
        raise (build_sheet_error(file, names) if is_choice_open else fault) from fault


def _build_grid(file: str, name: str, sheet: Sheet) -> Grid:
    """Return a sheet with the name `name` as a grid of rows of equal length, with comments set aside.

    Raises:
        ImportFileError: the sheet has no rows, or too many cells.
    """
    rows: list[Row] = []
    comments: list[Remark] = []
    for row in sheet.rows():
        filled = [cell for cell in row.cells if cell]
        is_header = filled[0] == "#" and len(filled) >= _LEAST_HEADERS  # the header of a column of numbers
        if filled[0].startswith(grid.COMMENT_MARKS) and not is_header:
            comments.append(Remark(row.line, grid.strip_comment_mark("\t".join(filled))))
        else:
            rows.append(row)
    if not rows:
        raise grid.no_rows_error(file)
    width = max(len(row.cells) for row in rows)
    if width * len(rows) > limits.MAX_CELLS:
        raise grid.too_large_error(file, rows[0].line)
    notes = sheet.notes
    if comments:
        count = f"{len(comments)} row{'s' * (len(comments) > 1)}"
        notes.append(f"comments were skipped ({count}), the first in row {comments[0].line}")
    preview = FilePreview(file=file, format="xlsx", sheet=name, assumptions=notes)
    return Grid(preview, tuple(row.resize(width) for row in rows), tuple(comments))


def _find_parts(archive: Archive) -> tuple[dict[str, str], str | None, str | None]:
    """Find the parts of a workbook's archive.

    Returns:
        Parts of the sheets by the sheets' names; part with the texts that cells share, or None; part with the
        formats of cells, or None.

    Raises:
        ImportFileError: two sheets have the same name, or the workbook has no sheet.
    """
    parts_by_id: dict[str, dict[str, str]] = {"worksheet": {}, "sharedStrings": {}, "styles": {}}
    for relation in archive.elements("xl/_rels/workbook.xml.rels", "Relationship"):
        kind = relation.get("Type", "").rpartition("/")[2]
        if kind in parts_by_id:
            path = posixpath.join("/xl", relation.get("Target", ""))
            parts_by_id[kind][relation.get("Id", "")] = posixpath.normpath(path).lstrip("/")
    part_by_name: dict[str, str] = {}
    for sheet in archive.elements("xl/workbook.xml", "sheet"):
        identifier = next((value for key, value in sheet.items() if key.endswith("}id")), "")
        part = parts_by_id["worksheet"].get(identifier)
        name = sheet.get("name", "")
        # `setdefault` returns the part of an earlier sheet if the name is already taken.
        if part is not None and part_by_name.setdefault(name, part) is not part:
            raise archive.build_error(f"two sheets have the name {quote(name)}")
    if not part_by_name or any(len(parts_by_id[kind]) > 1 for kind in ("sharedStrings", "styles")):
        raise archive.build_error(
            "the workbook has no sheet, or more than one part with shared texts or with styles"
        )
    texts, styles = (next(iter(parts_by_id[kind].values()), None) for kind in ("sharedStrings", "styles"))
    return part_by_name, texts, styles


def _find_number_kinds(archive: Archive, part: str | None) -> dict[str, CellKind]:
    """Return the kind of the numbers in cells of each format: number, date or percentage, by format index.

    Excel stores dates as numbers of days, and 50 % as 0.5; only the format of a cell tells them apart.
    """
    code_by_number: dict[str, str] = {}
    format_numbers: list[str] = []
    for element in () if part is None else archive.elements(part, "numFmts", "cellXfs"):
        for child in element:
            name, number = _LOCAL_NAMES.get(child.tag), child.get("numFmtId", "0")
            if name == "numFmt":
                code_by_number[number] = child.get("formatCode", "")
            elif name == "xf":
                format_numbers.append(number)
    return {
        str(index): _find_number_kind(number, code_by_number.get(number))
        for index, number in enumerate(format_numbers)
    }


def _find_number_kind(number: str, code: str | None) -> CellKind:
    """Return the kind of the numbers in cells of a format: number, date or percentage.

    Args:
        number: number of the format, as Excel stores it.
        code: code such as `0.00 %`; None for a format that is built into Excel.
    """
    if code is None:
        format_number = int(number) if number.isascii() and number.isdigit() and len(number) < 5 else 0
        return (
            "date" if format_number in _DATES else "percentage" if format_number in _PERCENTAGES else "number"
        )
    code_without_literals = _LITERAL_TEXT.sub("", code).lower().replace("general", "").replace("standard", "")
    if set("dmyhs") & set(code_without_literals):
        return "date"
    return "percentage" if "%" in code_without_literals else "number"


# ---- the cells of one sheet


def _iterate_children(archive: Archive, element: Element) -> Iterator[tuple[str, Element]]:
    """Yield name and element of each child of an element; refuse a child that the element may not have.

    Raises:
        ImportFileError: an unknown child could hold a value that would be lost.
    """
    allowed = _ALLOWED_CHILDREN.get(_LOCAL_NAMES.get(element.tag, ""), set())
    for child in element:
        name = _LOCAL_NAMES.get(child.tag)
        if name not in allowed:
            tag = child.tag.rpartition("}")[2]
            raise archive.build_error(
                f"element {quote(element.tag)} contains {quote(tag)}, which is not allowed"
            )
        yield name, child


def _join_text(archive: Archive, element: Element) -> str:
    """Return a text joined from its pieces in different fonts, without the pieces that show pronunciation."""
    pieces = []
    for name, child in _iterate_children(archive, element):
        if name == "r":
            pieces.append(_join_text(archive, child))
        elif name == "t":
            pieces.append(_read_plain_text(archive, child))
    return "".join(pieces)


def _read_plain_text(archive: Archive, element: Element) -> str:
    """Return the text of an element without children."""
    if len(element):
        next(_iterate_children(archive, element))  # This raises the error, because no child is allowed here.
    return element.text or ""


class _Sheet:
    """One sheet, which is read row by row; rows or cells that are out of order are refused.

    Each call of `rows` reads from the beginning; `notes` are those of the last call.
    """

    def __init__(
        self, archive: Archive, part: str, texts: Sequence[str], kinds: Mapping[str, CellKind]
    ) -> None:
        """Prepare to read the sheet in `part`, with the shared texts and the kinds of number formats."""
        self._archive, self._part, self._texts, self._kinds = archive, part, texts, kinds
        self._line = self._column = self._count = self._hidden = self._formulas = 0

    @property
    def notes(self) -> list[str]:
        """Notes for the user on the rows that were read: hidden ones, and formulas."""
        notes = []
        if self._hidden:
            notes.append(f"{self._hidden} rows or columns are hidden in the sheet, and were read as well")
        if self._formulas:
            notes.append(f"the stored values of formulas were used ({self._formulas} cells)")
        return notes

    def rows(self) -> Iterator[Row]:
        """Yield the rows that are not empty, each up to its last cell with a text."""
        self._archive.cells -= self._count
        self._line = self._column = self._count = self._hidden = self._formulas = 0
        filled_count = 0
        for element in self._archive.elements(self._part, "row", "col"):
            self._hidden += element.get("hidden") in ("1", "true")
            row = self._read_row(element) if _LOCAL_NAMES[element.tag] == "row" else None
            if row is not None:
                filled_count += 1
                if filled_count > limits.MAX_ROWS:
                    raise self._workbook_error(f"the sheet has more than {limits.MAX_ROWS} rows")
                yield row

    def _read_row(self, element: Element) -> Row | None:
        """Return the row that an XML element holds; None if all cells of the row are empty."""
        number = element.get("r", str(self._line + 1))
        if not _ROW_NUMBER.fullmatch(number) or not self._line < int(number) <= _LAST_ROW:
            raise self._workbook_error(
                f"row {quote(number)} is out of order in the sheet: it follows row {self._line}"
            )
        self._line, self._column = int(number), 0
        cells: list[str] = []
        kinds: list[CellKind] = []
        for name, cell in _iterate_children(self._archive, element):
            if name == "c":
                self._advance_to(cell.get("r"))
                text, kind = self._read_cell(cell)
                if text:
                    gap = self._column - 1 - len(cells)
                    cells += [*[""] * gap, write_ascii_minus(text)]
                    kinds += [*EMPTY_CELL_KIND * gap, kind]
        return Row(self._line, tuple(cells), tuple(kinds)) if cells else None

    def _advance_to(self, address: str | None) -> None:
        """Advance to the column of an address such as `B7`; without an address, to the next column."""
        column = self._column + 1
        if address is not None:
            match = _ADDRESS.fullmatch(address)
            letters = match[1] if match else ""
            # Letters of a column are digits to the base 26, with A = 1.
            stated_column = reduce(lambda number, letter: 26 * number + ord(letter) - 64, letters, 0)
            if match is None or int(match[2]) != self._line or stated_column < column:
                raise self._workbook_error(f"cell {quote(address)} is out of order in the sheet")
            column = stated_column
        self._count += column - self._column
        self._archive.cells += column - self._column
        self._column = column
        if column > limits.MAX_COLUMNS or self._archive.cells > MAX_SHEET_CELLS:
            reason = (
                f"a sheet has more than {limits.MAX_COLUMNS} columns, or the sheets {MAX_SHEET_CELLS} cells"
            )
            raise self._workbook_error(reason)

    def _read_cell(self, cell: Element) -> tuple[str, CellKind]:
        """Return the text and the kind of a cell; the kind is `formula` if no value is stored with it."""
        children = {_LOCAL_NAMES.get(child.tag): child for child in cell}
        type_, style = cell.get("t", "n"), cell.get("s", "0")
        if type_ != "n" and type_ not in _KIND_OF_TYPE:
            raise self._workbook_error(f"a cell has the unknown type {quote(type_)}")
        # A workbook without formats has numbers only, no dates and no percentages.
        kind = _KIND_OF_TYPE.get(type_) or (self._kinds.get(style) if self._kinds else "number")
        if kind is None:
            raise self._workbook_error(f"a cell has the unknown format {quote(style)}")
        holder = "is" if type_ == "inlineStr" else "v"
        if len(children) != len(cell) or not children.keys() <= {holder, "f", "extLst"}:
            tags = ", ".join(child.tag.rpartition("}")[2] for child in cell)
            raise self._workbook_error(
                f"a cell of type {quote(type_)} contains {quote(tags)}, which is not allowed"
            )
        value = self._read_value(children[holder], type_) if holder in children else ""
        if "f" in children:
            if not value and type_ != "str":
                return "= …", "formula"  # of this kind no number and no name is read
            self._formulas += 1
        return value, kind

    def _read_value(self, holder: Element, type_: str) -> str:
        """Return the text of a cell from the element that holds it; type `s` refers to a shared text."""
        value = (_join_text if type_ == "inlineStr" else _read_plain_text)(self._archive, holder)
        if type_ == "s" and value:
            is_index = value.isascii() and value.isdigit() and len(value) < 8
            if not is_index or int(value) >= len(self._texts):
                raise self._workbook_error(
                    f"a cell refers to the shared text {quote(value)}, which the workbook does not contain"
                )
            value = self._texts[int(value)]
        if len(value) > limits.MAX_CELL_LENGTH:
            raise self._workbook_error(f"a cell has more than {limits.MAX_CELL_LENGTH} characters")
        return value.strip()

    def _workbook_error(self, reason: str) -> ImportFileError:
        """Return the error that the workbook cannot be read, at the current row and column."""
        return self._archive.build_error(reason, self._line or None, self._column or None)


# ---- the parts of the archive


class Archive:
    """Archive of a workbook: named parts, read within limits that hold for all parts together.

    Attributes:
        cells: number of cells that were read in all sheets.
    """

    def __init__(self, file: str, content: bytes, form: str, program: str = "Excel") -> None:
        """Open an archive; refuse a file that is damaged, encrypted or too large when it is unpacked.

        Args:
            file: name of the file, for messages.
            content: bytes of the file.
            form: what the file should be, in words.
            program: program that can save the file again.

        Raises:
            ImportFileError: the archive is refused.
        """
        self._file, self._form, self._program = file, form, program
        self._tags = self.cells = 0
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(content))
        except _ZIP_FAULTS as error:
            raise self._damaged_error(error) from None
        parts = self._zip.infolist()
        self._parts = {part.filename: part for part in parts}
        if len(parts) > _MAX_PARTS or len(self._parts) != len(parts):
            raise self.build_error(
                f"the file has more than {_MAX_PARTS} parts, or two parts with the same name"
            )
        if sum(part.file_size for part in parts) > limits.MAX_UNPACKED_BYTES:
            raise self.build_error(
                f"the file has more than {limits.MAX_UNPACKED_BYTES // 1024**2} MiB when it is unpacked"
            )
        if any(part.file_size > _MAX_PLAIN_BYTES + _MAX_RATIO * part.compress_size for part in parts):
            raise self.build_error(
                f"a part of the file is more than {_MAX_RATIO} times as large when it is unpacked"
            )
        if any(part.flag_bits & 1 for part in parts):
            raise self.build_error("the file is encrypted")

    def build_error(self, reason: str, line: int | None = None, column: int | None = None) -> ImportFileError:
        """Return the error that this file cannot be read, for a reason and at a cell."""
        remedy = f"open the file in {self._program} and save it again as .xlsx, or save the sheet as CSV"
        return ImportFileError(Place(self._file, line, column), reason, remedy)

    def _damaged_error(self, error: BaseException) -> ImportFileError:
        """Return the error that the file is no archive, or is damaged; `error` is what `zipfile` raised."""
        return self.build_error(f"the file is not {self._form}, or is damaged ({type(error).__name__})")

    def read(self, name: str) -> bytes:
        """Return the bytes of a part.

        Raises:
            ImportFileError: the part is missing, damaged or beyond a limit.
        """
        try:
            with self._open(name) as stream:
                return stream.read()
        except _ZIP_FAULTS as error:
            raise self._damaged_error(error) from None

    def _open(self, name: str) -> IO[bytes]:
        """Return the stream of a part, which `zipfile` ends at the size that was checked.

        Raises:
            ImportFileError: the part is missing, or is compressed in another way.
        """
        part = self._parts.get(name)
        if part is None:
            raise self.build_error(f"the file is not {self._form}: it has no part {quote(name)}")
        if part.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise self.build_error(f"part {quote(name)} uses an unsupported compression")
        return self._zip.open(part)

    def elements(self, name: str, *wanted: str) -> Iterator[Element]:
        """Yield the wanted elements of a part in their order, each with its children.

        Args:
            name: name of the part.
            wanted: names of the elements; none of them may contain another.

        Raises:
            ImportFileError: the part is missing, damaged or beyond a limit.
        """
        try:
            with self._open(name) as stream:
                yield from self._parse_elements(_LimitedStream(self, name, stream), name, wanted)
        except ParseError as error:
            raise self.build_error(f"part {quote(name)} is not well-formed ({error})") from None
        except _ZIP_FAULTS as error:
            raise self._damaged_error(error) from None

    def count_tags(self, name: str, tags: int) -> None:
        """Add to the count of tags of all parts; refuse the file beyond `MAX_XML_TAGS`."""
        self._tags += tags
        if self._tags > MAX_XML_TAGS:
            raise self.build_error(f"the file has more than {MAX_XML_TAGS} XML tags up to part {quote(name)}")

    def _parse_elements(
        self, stream: _LimitedStream, name: str, wanted: tuple[str, ...]
    ) -> Iterator[Element]:
        """Yield the wanted elements of a stream of XML; other elements are dropped to save memory."""
        tags = {tag for tag, known in _LOCAL_NAMES.items() if known in wanted}
        path: list[Element] = []
        wanted_depth, child_count = 0, 0  # depth of the open wanted element (0: none), and its elements
        parser = XMLParser(encoding="utf-8")  # noqa: S314 - the guard refuses document types; whatever it claims
        events = iterparse(stream, ("start", "end"), parser)  # noqa: S314
        for event, element in events:
            if event == "start":
                path.append(element)
                child_count += 1
                if len(path) > _MAX_DEPTH or (wanted_depth and child_count > _MAX_CHILDREN):
                    limits = f"{_MAX_DEPTH} levels of XML elements, or {_MAX_CHILDREN} in one of them"
                    raise self.build_error(f"part {quote(name)} has more than {limits}")
                if element.tag in tags:
                    if wanted_depth:
                        raise self.build_error(
                            f"the workbook is damaged: element {quote(element.tag)} lies within another "
                            "such element"
                        )
                    wanted_depth, child_count = len(path), 0
                continue
            if len(path) == wanted_depth:
                yield element
                wanted_depth = 0
            path.pop()
            if path and not wanted_depth:
                del path[-1][:]  # children that were yielded or are not wanted


class _LimitedStream:
    """Stream of XML that raises an error where it exceeds a limit or declares a document type."""

    def __init__(self, archive: Archive, name: str, stream: IO[bytes]) -> None:
        self._archive, self._name, self._stream = archive, name, stream
        self._last_bytes = b""
        self._bytes_since_tag = 0

    def read(self, size: int = -1, /) -> bytes:
        """Return the next bytes of the stream.

        Raises:
            ImportFileError: the bytes declare a document type, or exceed a limit of tags or of text.
        """
        data = self._stream.read(size)
        self._archive.count_tags(self._name, data.count(b"<"))
        # The declaration may be divided between the bytes read before and these.
        if b"<!DOCTYPE" in self._last_bytes + data:
            reason = f"part {quote(self._name)} declares an XML document type, which is not allowed"
            raise self._archive.build_error(reason)
        self._last_bytes = data[-8:]
        self._bytes_since_tag = 0 if b"<" in data else self._bytes_since_tag + len(data)
        if self._bytes_since_tag > _MAX_MARKUP_BYTES:
            raise self._archive.build_error(f"a text in the file has more than {_MAX_MARKUP_BYTES} bytes")
        return data
