"""A table whose header was found and understood, and its rows of data."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.importing import ImportOptions
from jointstiff.service.importing.column_units import HeaderCell
from jointstiff.service.importing.columns import Columns, collapsed, understand
from jointstiff.service.importing.comments import read_comments
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grid import CellKind, Grid, Row
from jointstiff.service.importing.header import is_key
from jointstiff.service.importing.heading import Heading, find_heading
from jointstiff.service.importing.numbers import looks_like_a_number

_HEADERLESS: Final = MappingProxyType(
    {
        4: ("name", "x", "y", "z"),
        5: ("group", "point", "x", "y", "z"),
        6: ("collection", "group", "point", "x", "y", "z"),
    }
)
_LENGTH: Final = re.compile(r"(?<![\d\w.,])(?<!\d )(mm|inch|inches)(?!\w)", re.IGNORECASE)
"""A unit that is not of a number, as the diameter of a reflector would be."""
_TRAILING: Final = "every row ends with a delimiter; the empty last column was ignored"


@dataclass(frozen=True)
class Layout:
    """A table whose columns are understood."""

    headers: tuple[str, ...]  # as they stand in the file; empty texts where there is no header
    lines: tuple[int, ...]  # of the file that make the header
    columns: Columns  # what they mean
    rows: tuple[Row, ...]  # of data, at least one, as long as the header
    frame: str | None = None  # of positions, as a comment of the file names it
    assumptions: tuple[str, ...] = ()  # in words


def lay_out(grid: Grid, options: ImportOptions, faults: Faults) -> Layout:
    """Find and understand the header: the caller's, one in the first rows, or one in a comment.

    A table without any is a list of points: `name x y z`, with `group` or `collection group` before it.

    Args:
        grid: the file.
        options: of the caller.
        faults: where to tell of rows and columns that are not understood.

    Raises:
        ImportFileError: there is none and it is no such list.
    """
    said = read_comments(grid)
    heading, headers = _heading(grid, options, faults)
    rows, cells, notes = _fitted(grid, heading, faults)
    cells = tuple(
        replace(cell, unused=not cell.text and not any(row.cells[column] for row in rows))
        for column, cell in enumerate(cells)
    )
    shown_headers = headers[: len(cells)]
    if options.layouts:
        _check_template(options, shown_headers, Place(grid.file, *heading.lines[-1:]), faults)
    columns = understand(cells, options, said.unit, faults)
    _check_remarks(grid, heading, columns, faults)
    if said.frame is not None:
        notes = (*notes, f"positions are in the frame {shown(said.frame)}, as the file says")
    if said.unit is not None:
        notes = (*notes, f"positions are in {'inches' if said.unit == 'in' else said.unit}, as the file says")
    if columns.units.get("length") == "in":
        notes = (*notes, "lengths in inches were converted to mm; so are numbers in options")
    return Layout(shown_headers, heading.lines, columns, rows, said.frame, (*heading.notes, *notes))


def _check_remarks(grid: Grid, heading: Heading, columns: Columns, faults: Faults) -> None:
    """Refuse lengths in another unit than a title or a comment names, such as `Units: inches`."""
    unit = columns.units.get("length")
    titles = grid.rows[: heading.start - len(heading.lines)] if heading.start else ()
    for row in (*titles, *grid.comments):
        for word in _LENGTH.findall(" ".join(row.cells)):
            named = "mm" if word.lower() == "mm" else "in"
            if unit is not None and named != unit:
                reason = f"{shown(word)} stands here, but lengths are in {unit}"
                remedy = "correct the unit, or remove the remark"
                faults.add(ImportFileError(grid.place(row), reason, remedy, "units.length"))


def _heading(grid: Grid, options: ImportOptions, faults: Faults) -> tuple[Heading, tuple[str, ...]]:
    """The header, and its texts as they are shown: none for a header that is only assumed."""
    if options.header is not None:
        cells = _cells(grid, options.header, guessed=False)
        return Heading(cells, (), 0, stated=True), tuple(options.header)
    found = find_heading(grid, options, faults)
    if found is not None:
        return found, tuple(cell.text for cell in found.cells)
    assumed = _headerless(grid, by_order=options.by_order)
    note = f"no header found; assumed columns: {', '.join(assumed)}"
    return Heading(_cells(grid, assumed, guessed=True), (), 0, (note,)), ("",) * len(assumed)


def _cells(grid: Grid, texts: Sequence[str], *, guessed: bool) -> tuple[HeaderCell, ...]:
    return tuple(
        HeaderCell(text, Place(grid.file, None, column), guessed)
        for column, text in enumerate(texts, start=1)
    )


def _fitted(
    grid: Grid, heading: Heading, faults: Faults
) -> tuple[tuple[Row, ...], tuple[HeaderCell, ...], tuple[str, ...]]:
    """Rows and header of one length; what is empty at the end of all of them is left out."""
    rows, cells = grid.rows[heading.start :], heading.cells
    longest = max(len(row.cells) for row in rows)
    if grid.format == "xlsx":
        return _of_one_length(grid, rows, cells, heading, faults), cells, ()
    width = len(cells)
    while width > 1 and not cells[width - 1].text and not any(any(row.cells[width - 1 :]) for row in rows):
        width -= 1
    alike = min(len(row.cells) for row in rows) == longest
    cut = alike and longest >= width and not any(any(row.cells[width:]) for row in rows)
    if not cut:
        return _of_one_length(grid, rows, cells, heading, faults), cells, ()
    shorter = tuple(Row(row.line, row.cells[:width]) for row in rows) if longest > width else rows
    return shorter, cells[:width], (_TRAILING,) if longest > width else ()


def _of_one_length(
    grid: Grid, rows: Sequence[Row], cells: Sequence[HeaderCell], heading: Heading, faults: Faults
) -> tuple[Row, ...]:
    """The rows as long as the header: those of a sheet end with their last cell, those of a text must fit."""
    width = len(cells)
    fitted = []
    for row in rows:
        count = len(row.cells)
        if any(row.cells[width:]) or (count != width and row.kinds is None):
            faults.add(_misfit(grid, row, width, heading))
        elif row.kinds is None or count == width:
            fitted.append(row)
        else:
            kind: CellKind = "text"
            kinds = (*row.kinds[:width], *(kind,) * (width - count))
            fitted.append(Row(row.line, (*row.cells[:width], *("",) * (width - count)), kinds))
    return tuple(fitted)


def _misfit(grid: Grid, row: Row, width: int, heading: Heading) -> ImportFileError:
    count = len(row.cells)
    if row.kinds is not None:
        return ImportFileError(
            grid.place(row, min(width, count - 1)),
            f"the row has {count} cells, but the header {width}",
            "give every column a header, and every row the same number of cells",
        )
    line = heading.lines[-1] if heading.lines else grid.rows[0].line
    than = "the header" if heading.stated else f"line {line} has"
    return ImportFileError(
        grid.place(row, min(count, width)),
        f"the row has {count} cells, but {than} {width} (delimiter: {grid.delimiter})",
        "give every row the same number of cells; check for a missing or doubled delimiter, a "
        "decimal comma in a comma-separated file, or a blank in a name without quotation marks",
    )


def _headerless(grid: Grid, *, by_order: bool) -> tuple[str, ...]:
    """The columns of a list of points.

    Raises:
        ImportFileError: it is none.
    """
    cells = grid.rows[0].cells
    width = len(cells)
    while width > 1 and not any(row.cells[width - 1] for row in grid.rows if len(row.cells) >= width):
        width -= 1
    headers = ("x", "y", "z") if by_order and width == 3 else _HEADERLESS.get(width)
    if headers is None:
        raise ImportFileError(
            grid.place(grid.rows[0]),
            f"the rows have {width} cells, and there is no header",
            "add a header such as `name x y z`, or give `header`",
            "header",
        )
    for row in grid.rows:
        for column, cell in enumerate(row.cells[: len(headers) - 3]):
            number = looks_like_a_number(cell) and (column > 0 or not cell.isdigit())
            if is_key(cell) or number:
                raise ImportFileError(
                    grid.place(row, column),
                    f"{shown(cell)} is where a point's name must be, because there is no header",
                    f"give rows of {' '.join(headers)}, add a header, or give `header`",
                    "header",
                )
    return headers


def _check_template(options: ImportOptions, headers: Sequence[str], place: Place, faults: Faults) -> None:
    """Refuse headers that no file had of which the template was made."""
    found = [collapsed(text) for text in headers]
    known = [[collapsed(text) for text in one] for one in options.layouts]
    if found in known:
        return
    nearest = max(known, key=lambda one: len(set(one) & set(found)))
    absent = [text for text in nearest if text not in found]
    extra = [text for text in found if text not in nearest]
    differences = [f"missing: {shown(', '.join(absent))}"] if absent else []
    differences += [f"not in the template: {shown(', '.join(extra))}"] if extra else []
    reason = "; ".join(differences) or "the same columns in another order or number"
    fault = ImportFileError(
        place,
        f"the file does not fit the template; {reason}",
        "import it without the template, or correct it",
    )
    faults.add(fault)
