"""Tables of documents, such as texts in LaTeX and web pages, as grids like the sheets of a workbook."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

from jointstiff.schemas.imports import FilePreview
from jointstiff.service.importing import limits
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grammar import collapse_blanks
from jointstiff.service.importing.grid import (
    LEAST_NUMBERS,
    Grid,
    Remark,
    Row,
    count_numbers,
    too_large_error,
    write_ascii_minus,
)
from jointstiff.service.importing.sheets import refuse_unknown_sheets, split_sheets

_MAX_CHARACTERS: Final = 2_000_000
"""Characters of a document."""
_MAX_MARKS: Final = 200_000
"""Signs of a document that begin a tag, a command, a cell or a line."""
_MAX_TABLE_CELLS: Final = 500_000
"""Cells of all tables of a document, with those that merged cells cover."""
_MAX_TABLES: Final = 1_000
_MOST_NAME: Final = 40
"""Characters of the name of a table."""


class Cell(NamedTuple):
    """Cell of a table, perhaps merged of several."""

    text: str
    columns: int = 1
    rows: int = 1


@dataclass
class Table:
    """Table of a document; a merged cell has its text in the first of the cells that it covers."""

    title: str = ""
    rows: list[Row] = field(default_factory=list)  # those with a text
    covered: dict[int, int] = field(default_factory=dict)  # column → rows below that a merged cell covers


class Document:
    """Tables of a document, and the texts around the tables."""

    def __init__(self, file: str, text: str, marks: Collection[str]) -> None:
        """Begin to read a document, in whose text some signs begin a tag, a command or a cell.

        Raises:
            ImportFileError: the text is too long, or has too many of these signs.
        """
        self.file = file
        self.tables: list[Table] = []
        self.remarks: list[Remark] = []
        self._cell_count = 0
        if len(text) > _MAX_CHARACTERS or sum(map(text.count, marks)) > _MAX_MARKS:
            raise self._build_size_error(f"more than {_MAX_CHARACTERS} characters or {_MAX_MARKS} marks")

    def _build_size_error(self, size: str) -> ImportFileError:
        """Return the error that the document is too large; `size` says in words what it has."""
        return ImportFileError(Place(self.file), f"the document has {size}", "export the readings as CSV")

    def add_remark(self, line: int, text: str) -> None:
        """Add a text that is in no table, if it is not blank."""
        text = collapse_blanks(text)
        if text:
            self.remarks.append(Remark(line, text))

    def add_row(self, table: Table, line: int, cells: Sequence[Cell]) -> None:
        """Add a row to a table, unless all its cells are empty.

        Raises:
            ImportFileError: a cell is too long, or there are too many cells.
        """
        texts = list[str]()
        covered = dict[int, int]()
        for cell in cells:
            self._pass_covered(table, covered, texts)
            first, end = len(texts), len(texts) + cell.columns
            if end > limits.MAX_COLUMNS:
                raise too_large_error(self.file, line)
            text = write_ascii_minus(collapse_blanks(cell.text))
            if len(text) > limits.MAX_CELL_LENGTH:
                reason = f"a cell has more than {limits.MAX_CELL_LENGTH} characters: {quote(text)}"
                raise ImportFileError(Place(self.file, line, first + 1), reason, "shorten the text")
            texts += [text, *(cell.columns - 1) * ("",)]
            if cell.rows > 1:
                covered |= dict.fromkeys(range(first, end), cell.rows - 1)
        self._pass_covered(table, covered, texts)
        table.covered = covered
        self._cell_count += len(texts)
        if self._cell_count > _MAX_TABLE_CELLS:
            raise too_large_error(self.file, line)
        if any(texts):
            table.rows.append(Row(line, tuple(texts)))

    def _pass_covered(self, table: Table, covered: dict[int, int], texts: list[str]) -> None:
        """Add an empty cell for each next column that a merged cell of a row above covers."""
        while (rows := table.covered.get(len(texts), 0)) > 0:
            covered[len(texts)] = rows - 1
            texts.append("")

    def build_grids(self, encoding: str, stated: str | None) -> list[Grid]:
        """Return the tables as grids; none of a document without a row of numbers in a table.

        Args:
            encoding: encoding of the text.
            stated: names of tables, with semicolons between; None for all.

        Raises:
            ImportFileError: there are too many tables, or none has a stated name.
        """
        filled = [table for table in self.tables if table.rows]
        if len(filled) > _MAX_TABLES:
            raise self._build_size_error(f"more than {_MAX_TABLES} tables")
        if not any(count_numbers(row) >= LEAST_NUMBERS for table in filled for row in table.rows):
            return []
        names = _name_tables(filled)
        preview = FilePreview(
            file=self.file, format="text", encoding=encoding, assumptions=self._list_notes()
        )
        grids = {
            name: Grid(preview.model_copy(update={"sheet": name}), tuple(table.rows), tuple(self.remarks))
            for name, table in zip(names, filled, strict=True)
        }
        refuse_unknown_sheets(self.file, stated, grids, "the document has no table")
        chosen = [grids[name] for name in split_sheets(stated) if name is not None]
        first, *others = chosen or grids.values()
        # The texts around the tables are remarks of the file as a whole.
        return [first, *(replace(each, comments=()) for each in others)]

    def _list_notes(self) -> list[str]:
        """Return the note that texts around the tables have numbers, as rows of data have; else no note."""
        rows = [remark for remark in self.remarks if _looks_like_a_row(remark)]
        if not rows:
            return []
        count = f"{len(rows)} line{'s' * (len(rows) > 1)}"
        return [
            f"{count} outside the tables have numbers, and were not read; the first: {quote(rows[0].text)}"
        ]


def _looks_like_a_row(remark: Remark) -> bool:
    """Return whether a text is numbers for the most part, three at least."""
    cells = tuple(remark.text.split(" "))
    number_count = count_numbers(Row(remark.line, cells))
    return number_count >= LEAST_NUMBERS and 2 * number_count > len(cells)


def _name_tables(tables: Sequence[Table]) -> list[str]:
    """Return a name for each table: its title, unless another table has the title too, or its number."""
    names = list[str]()
    for number, table in enumerate(tables, 1):
        # The option with names of tables separates them by semicolons.
        title = collapse_blanks(table.title).replace(";", ",")[:_MOST_NAME].strip()
        names.append(title if title and title not in names else f"table {number} {title}".strip())
    return names
