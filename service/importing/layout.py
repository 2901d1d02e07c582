"""Position of a table's header and of its first row of data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.importing import ImportOptions
from jointstiff.service.importing.columns import Columns, understand
from jointstiff.service.importing.errors import Fault, ImportFileError, Place, shown
from jointstiff.service.importing.grid import CellKind, Grid, Row
from jointstiff.service.importing.header import is_key, meaning_of
from jointstiff.service.importing.numbers import looks_like_a_number

_HEADERLESS: Final = MappingProxyType(
    {
        4: ("name", "x", "y", "z"),
        5: ("group", "point", "x", "y", "z"),
        6: ("collection", "group", "point", "x", "y", "z"),
    }
)


@dataclass(frozen=True)
class Layout:
    """A table whose columns are understood.

    Attributes:
        headers: as they stand in the file; empty texts where there is no header.
        columns: what they mean.
        rows: of data, at least one, as long as the header.
        assumptions: in words.
    """

    headers: tuple[str, ...]
    columns: Columns
    rows: tuple[Row, ...]
    assumptions: tuple[str, ...] = ()


def lay_out(grid: Grid, options: ImportOptions) -> Layout:
    """Find and understand the header: the caller's, the first row, or the last comment before the data.

    A table without any is a list of points: `name x y z`, with `group` or `collection group` before it.

    Raises:
        ImportFileError: there is none and it is no such list, or it is not understood.
    """
    first = grid.rows[0]
    if options.header is not None:
        return _with(grid, options, tuple(options.header), Place(grid.file), grid.rows)
    if not any(looks_like_a_number(cell) for cell in first.cells):
        if len(grid.rows) == 1:
            raise ImportFileError(
                grid.place(first), "the file has a header but no row of data", "check the file"
            )
        return _with(grid, options, first.cells, grid.place(first), grid.rows[1:])
    if comment := _header_in_comments(grid, options):
        note = f"the comment in line {comment.line} was used as the header"
        return _with(grid, options, comment.cells, grid.place(comment), grid.rows, note)
    return _headerless(grid, options)


def _with(
    grid: Grid,
    options: ImportOptions,
    headers: tuple[str, ...],
    place: Place,
    rows: Sequence[Row],
    note: str | None = None,
) -> Layout:
    data = tuple(_fitted(grid, row, len(headers)) for row in rows)
    unused = frozenset(
        column
        for column, header in enumerate(headers)
        if not header and not any(row.cells[column] for row in data)
    )
    return Layout(headers, understand(headers, options, place, unused), data, (note,) if note else ())


def _fitted(grid: Grid, row: Row, width: int) -> Row:
    """A row as long as the header: rows of a sheet end with their last cell."""
    count = len(row.cells)
    if any(row.cells[width:]) or (count != width and row.kinds is None):
        raise ImportFileError(
            grid.place(row, min(width, count - 1)),
            f"the row has {count} cells, but the header {width}",
            "give every column a header, and every row the same number of cells",
        )
    if row.kinds is None or count == width:
        return row
    kind: CellKind = "text"
    kinds = (*row.kinds[:width], *(kind,) * (width - count))
    return Row(row.line, (*row.cells[:width], *("",) * (width - count)), kinds)


def _header_in_comments(grid: Grid, options: ImportOptions) -> Row | None:
    """The last comment before the data that is a header in every cell."""
    first = grid.rows[0]
    for comment in reversed(grid.comments):
        if comment.line < first.line and len(comment.cells) == len(first.cells):
            try:
                for cell in comment.cells:
                    meaning_of(cell, options.state_words)
            except Fault:
                continue
            return comment
    return None


def _headerless(grid: Grid, options: ImportOptions) -> Layout:
    width = len(grid.rows[0].cells)
    headers = _HEADERLESS.get(width)
    if headers is None:
        raise ImportFileError(
            grid.place(grid.rows[0]),
            f"the rows have {width} cells, and there is no header",
            "add a header such as `name x y z`, or give `header`",
        )
    for row in grid.rows:
        for column, cell in enumerate(row.cells[:-3]):
            number = looks_like_a_number(cell) and (column > 0 or not cell.isdigit())
            if is_key(cell) or number:
                raise ImportFileError(
                    grid.place(row, column),
                    f"{shown(cell)} is where a point's name must be, because there is no header",
                    f"give rows of {' '.join(headers)}, add a header, or give `header`",
                )
    note = f"no header found; assumed columns: {', '.join(headers)}"
    laid = _with(grid, options, headers, Place(grid.file), grid.rows, note)
    return Layout(("",) * width, laid.columns, laid.rows, laid.assumptions)
