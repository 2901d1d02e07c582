"""A table as it stands in a file: rows of cells, not yet understood."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePath
from typing import Final, Literal

from jointstiff.schemas.importing import Delimiter, TableFormat
from jointstiff.service.importing.errors import ImportFileError, Place, shown
from jointstiff.service.importing.limits import MAX_CELL_LENGTH, MAX_CELLS, MAX_COLUMNS, MAX_ROWS

COMMENT_MARKS: Final = ("#", "//", "%")

CellKind = Literal["text", "number", "date", "percentage", "truth value", "error", "formula"]


@dataclass(frozen=True, slots=True)
class Row:
    """One row."""

    line: int  # line of a text file or row of a sheet, from 1
    cells: tuple[str, ...]  # without blanks at the ends
    # what each cell of a sheet is; None in a text file, where all is text
    kinds: tuple[CellKind, ...] | None = None


@dataclass(frozen=True, slots=True)
class Grid:
    """All rows of a file."""

    file: str  # its name
    format: TableFormat  # what kind of file it is
    rows: tuple[Row, ...]  # those that are neither empty nor comments; all of the same length in a text file
    comments: tuple[Row, ...]  # rows that begin with a mark of comments, without it
    remarks: tuple[tuple[int, str], ...]  # the same as lines and texts
    encoding: str | None = None  # encoding of a text file
    delimiter: Delimiter | None = None  # delimiter of a text file
    sheet: str | None = None  # sheet of an Excel file
    assumptions: tuple[str, ...] = ()  # in words
    ended: bool = True  # whether its last line has an end

    @property
    def stem(self) -> str:
        """Return the name of the file without what follows its last full stop."""
        return PurePath(self.file).stem

    def place(self, row: Row, column: int | None = None) -> Place:
        """Return the place of a row, or of its cell with this index."""
        return Place(self.file, row.line, None if column is None else column + 1)


def check_size(file: str, rows: list[Row]) -> None:
    """Refuse a table that is empty or beyond the limits.

    Raises:
        ImportFileError: it is.
    """
    if not rows:
        raise ImportFileError(Place(file), "the file has no row of data", "check that it is the right file")
    if len(rows) > MAX_ROWS:
        at = Place(file, rows[MAX_ROWS].line)
        raise ImportFileError(at, f"the file has more than {MAX_ROWS} rows", "split the file")
    cells = 0
    for row in rows:
        cells += len(row.cells)
        if len(row.cells) > MAX_COLUMNS or cells > MAX_CELLS:
            raise too_many_cells(file, row)
        for column, cell in enumerate(row.cells, start=1):
            if len(cell) > MAX_CELL_LENGTH:
                raise ImportFileError(
                    Place(file, row.line, column),
                    f"a cell has more than {MAX_CELL_LENGTH} characters: {shown(cell)}",
                    "check for a missing quotation mark or delimiter",
                )


def too_many_cells(file: str, row: Row) -> ImportFileError:
    """Return the refusal of a table that goes beyond its columns or cells in a row."""
    reason = f"the file has more than {MAX_COLUMNS} columns or {MAX_CELLS} cells"
    return ImportFileError(
        Place(file, row.line), reason, "remove columns that are not needed, or split the file"
    )
