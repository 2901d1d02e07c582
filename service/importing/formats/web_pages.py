"""Tables of web pages (HTML), with the texts around them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html.parser import HTMLParser
from typing import Final

from jointstiff.service.importing import limits
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.formats.documents import Cell, Document, Table
from jointstiff.service.importing.grid import Grid
from jointstiff.service.importing.texts.encoding import decode

_MAX_DEPTH: Final = 32
"""Tables within tables."""
_LINES: Final = frozenset(
    ("address", "article", "aside", "blockquote", "body", "br", "center", "dd", "div", "dl", "dt", "fieldset",
     "figcaption", "figure", "footer", "form", "h1", "h2", "h3", "h4", "h5", "h6", "head", "header", "hr",
     "html", "li", "main", "nav", "ol", "option", "p", "pre", "section", "select", "table", "textarea",
     "title", "ul")
)  # fmt: skip
"""Elements that end a line; any other element is within a line, or within a word."""
_HIDDEN: Final = frozenset(("script", "style", "template", "del", "s", "strike"))
"""Elements whose text is not shown, or is struck out."""
_STRUCTURE: Final = frozenset(("table", "thead", "tbody", "tfoot", "tr", "td", "th", "caption"))
_HEADINGS: Final = frozenset(("h1", "h2", "h3", "h4", "h5", "h6"))
_CELLS: Final = frozenset(("td", "th"))
_NUMBER: Final = re.compile(r"\s*(\d{1,7})")
_Attributes = Sequence[tuple[str, str | None]]


def read_web_page(file: str, content: bytes, stated: str | None) -> list[Grid]:
    """Return the tables of a web page as grids; none without a row of numbers.

    Args:
        file: name of the file, for messages.
        content: bytes of the file.
        stated: names of tables, which are their captions or the headings above, with semicolons between; None
            for all.

    Raises:
        ImportFileError: the text is damaged or beyond a limit, or has no table of a name.
    """
    text, encoding = decode(file, content)
    page = _PageReader(file, text)
    page.read(text)
    return page.document.build_grids(encoding, stated)


class _OpenTable:
    """Table whose end was not read yet."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self.cells: list[Cell] | None = None  # of the open row; None between rows
        self.line = 0  # of the open row
        self.cell: Cell | None = None  # the open cell, without its text; None between cells
        self.pieces = list[str]()  # of the text of the open cell, or of the caption
        self.is_in_caption = False
        self.is_frame = False  # whether a cell has a table: then the cells are no readings


class _PageReader(HTMLParser):
    """Parser of a page that keeps rows, cells and texts around tables."""

    def __init__(self, file: str, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.document = Document(file, text, ("<",))
        self._open = list[_OpenTable]()  # tables that are open, each in a cell of the one before
        self._hidden_tag = ""  # the element that is open and not shown
        self._hidden_count = 0  # elements of this tag that are open
        self._pieces = list[str]()  # of the line outside tables
        self._line = 0  # of its first text
        self._heading = ""  # last heading outside tables

    def read(self, text: str) -> None:
        """Read the whole page.

        Raises:
            ImportFileError: the page is cut off, has a text between cells, or exceeds a limit.
        """
        # `close` would read an element that is cut off as a text, in a time that grows with its square.
        self.feed(text)
        if self.rawdata.strip() or self._open or self._hidden_tag:
            raise self._build_error("the page is cut off within an element")
        self._end_line()

    def handle_starttag(self, tag: str, attrs: _Attributes) -> None:
        """Begin an element."""
        if self._hidden_tag or tag in _HIDDEN:
            self._begin_hidden(tag)
        elif tag == "table":
            self._begin_table()
        elif tag in _STRUCTURE:
            self._begin_part(self._find_table(tag), tag, dict(attrs))
        elif tag in _LINES:
            self._end_line()

    def handle_startendtag(self, tag: str, attrs: _Attributes) -> None:
        """Read an element such as `<br/>`; an empty cell may be `<td/>`."""
        if self._hidden_tag or tag in _HIDDEN:
            return
        self.handle_starttag(tag, attrs)
        self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        """End an element; its parts that are open end, too."""
        if self._hidden_tag:
            self._hidden_count -= tag == self._hidden_tag
            self._hidden_tag = self._hidden_tag if self._hidden_count else ""
        elif tag in _STRUCTURE:
            self._end_part(self._find_table(tag), tag)
        elif tag in _HEADINGS and not self._open:
            self._heading = "".join(self._pieces)
            self._end_line()
        elif tag in _LINES:
            self._end_line()

    def handle_data(self, data: str) -> None:
        """Read a text: of a cell, of a caption, or outside tables.

        Raises:
            ImportFileError: the text is between the cells of a table.
        """
        if self._hidden_tag:
            return
        if not self._open:
            self._line = self._line if self._pieces else self.getpos()[0]
            self._pieces.append(data)
            return
        inner = self._open[-1]
        if inner.is_in_caption or inner.cell is not None:
            inner.pieces.append(data)
        elif data.strip():
            raise self._build_error(f"the text {quote(data.strip())} is between the cells of a table")

    def _build_error(self, reason: str) -> ImportFileError:
        """Return the error that the page cannot be read, at the current line."""
        place = Place(self.document.file, self.getpos()[0])
        return ImportFileError(place, reason, "save the page again, or export the readings as CSV")

    def _begin_hidden(self, tag: str) -> None:
        """Begin an element that is not shown, or an element in it."""
        self._hidden_tag = self._hidden_tag or tag
        self._hidden_count += tag == self._hidden_tag

    def _end_line(self) -> None:
        """End a line outside tables; in a cell, add a blank."""
        if self._open:
            self._open[-1].pieces.append(" ")
        else:
            self.document.add_remark(self._line, "".join(self._pieces))
            self._pieces = []

    # ---- tables

    def _begin_table(self) -> None:
        """Begin a table; the cells of the table around it are a frame of the page."""
        if len(self._open) == _MAX_DEPTH:
            raise self._build_error(f"more than {_MAX_DEPTH} tables are within each other")
        if self._open:
            self._open[-1].is_frame = True
        else:
            self._end_line()
        table = Table(self._heading)
        self._heading = ""
        self.document.tables.append(table)
        self._open.append(_OpenTable(table))

    def _find_table(self, tag: str) -> _OpenTable:
        """Return the innermost open table, to which an element with a tag belongs.

        Raises:
            ImportFileError: no table is open: rows behind the end of a table would be lost.
        """
        if not self._open:
            raise self._build_error(f"the element {quote(tag)} is in no table")
        return self._open[-1]

    def _begin_part(self, inner: _OpenTable, tag: str, attributes: dict[str, str | None]) -> None:
        """Begin a row, a cell or the caption of a table; a part that is open ends."""
        self._end_cell(inner)
        if tag == "caption":
            inner.is_in_caption = True
        elif tag in _CELLS:
            if inner.cells is None:
                inner.cells, inner.line = [], self.getpos()[0]
            columns = _read_span(attributes.get("colspan"))
            rows = _read_span(attributes.get("rowspan"))
            if columns > limits.MAX_COLUMNS:
                raise self._build_error(f"a cell covers more than {limits.MAX_COLUMNS} columns")
            inner.cell = Cell("", columns, rows)
        else:
            self._end_row(inner)
        if tag == "tr":
            inner.cells, inner.line = [], self.getpos()[0]

    def _end_part(self, inner: _OpenTable, tag: str) -> None:
        """End a row, a cell, the caption, or the table itself."""
        self._end_cell(inner)
        if tag not in (*_CELLS, "caption"):
            self._end_row(inner)
        if tag == "table":
            self._open.pop()

    def _end_cell(self, inner: _OpenTable) -> None:
        """End the open cell, or the caption, of a table."""
        if inner.is_in_caption:
            inner.table.title = "".join(inner.pieces)
            self.document.add_remark(self.getpos()[0], inner.table.title)
            inner.is_in_caption = False
        if inner.cell is not None and inner.cells is not None:
            inner.cells.append(inner.cell._replace(text="".join(inner.pieces)))
        inner.cell = None
        inner.pieces.clear()

    def _end_row(self, inner: _OpenTable) -> None:
        """End the open row of a table; the cells of a frame are texts around tables."""
        cells = inner.cells or []
        if inner.is_frame:
            for cell in cells:
                self.document.add_remark(inner.line, cell.text)
        elif cells:
            self.document.add_row(inner.table, inner.line, cells)
        inner.cells = None


def _read_span(text: str | None) -> int:
    """Return how many columns or rows a cell covers; 1 without a number."""
    found = _NUMBER.match(text or "")
    return max(1, int(found[1])) if found else 1
