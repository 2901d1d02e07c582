"""The header of a table, wherever it stands, its columns, and the rows of data below it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.importing import ImportOptions
from jointstiff.service.importing.columns import Columns, HeaderCell, spoken, understand
from jointstiff.service.importing.errors import Fault, Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grid import CellKind, Grid, Row
from jointstiff.service.importing.header import (
    POINTS,
    Meaning,
    collapsed,
    folded,
    is_joint,
    is_key,
    meaning_of,
    names_a_state,
    split_unit,
    state_named,
)  # fmt: skip
from jointstiff.service.importing.numbers import looks_like_a_number
from jointstiff.service.importing.words import FOREIGN, MARKS, unit_named

_MAX_TITLES: Final = 20
"""Rows above a header."""
_MAX_ROWS: Final = 3
"""Rows of a header: groups, axes, units."""
_DATA: Final = 3
"""Numbers in a row of data: no table has fewer."""
_NONE: Final = frozenset("-–/")
"""Cells of a row of units for columns without one."""
_HEADERLESS: Final = MappingProxyType(
    {
        4: ("name", "x", "y", "z"),
        5: ("group", "point", "x", "y", "z"),
        6: ("collection", "group", "point", "x", "y", "z"),
    }
)
_TRAILING: Final = "every row ends with a delimiter; the empty last column was ignored"
_LENGTH: Final = re.compile(r"(?<![\d\w.,])(?<!\d )(mm|inch|inches)(?!\w)", re.IGNORECASE)
"""A unit that is not of a number, as the diameter of a reflector would be."""
_AXES: Final = re.compile(r"AXES\s*=\s*(\w+)", re.IGNORECASE)
_AXES_UNIT: Final = re.compile(r"\bX\W+Y\W+Z\s*(?:\(\s*|in\s+)([^\W\d]+)\s*\)?\s*", re.IGNORECASE)
_FRAME: Final = re.compile(r"(?:\bFRAME\s*=|\bCOORDINATE\s+FRAME\b)\s*(\S.*)", re.IGNORECASE)


@dataclass(frozen=True)
class Layout:
    """A table whose columns are understood."""

    headers: tuple[str, ...]  # as they stand in the file; empty texts where there is no header
    lines: tuple[int, ...]  # of the file that make the header
    columns: Columns  # what they mean
    rows: tuple[Row, ...]  # of data, as long as the header
    frame: str | None = None  # of positions, as a comment of the file names it
    assumptions: tuple[str, ...] = ()  # in words


@dataclass(frozen=True)
class _Heading:
    """A header as it stands in the file."""

    cells: tuple[HeaderCell, ...]  # one a column
    lines: tuple[int, ...]  # of the file that make it
    start: int  # index of the first row of data
    notes: tuple[str, ...] = ()  # in words
    stated: bool = False  # whether the caller states it
    assumed: bool = False  # whether the file has none


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
    unit, frame = _said_in_comments(grid)
    heading = _find_heading(grid, options, faults)
    rows, cells, notes = _fitted(grid, heading, faults)
    cells = tuple(
        replace(cell, unused=not cell.text and not any(row.cells[column] for row in rows))
        for column, cell in enumerate(cells)
    )
    headers = tuple("" if heading.assumed else cell.text for cell in cells)
    if options.layouts:
        _check_template(options, headers, Place(grid.file, *heading.lines[-1:]), faults)
    in_name = names_a_state(grid.file, options.state_words)
    columns = understand(cells, options, unit, faults, state_in_name=in_name)
    _check_remarks(grid, heading, columns, faults)
    _check_end(grid, rows, faults)
    rows, deleted = _not_deleted(grid, rows, columns, faults)
    if deleted and options.by_order and "name" not in columns.texts:
        reason = "rows are marked as deleted, so that the rows of this file are not those of the others"
        faults.report(
            Place(grid.file), reason, "give every row a label, or delete them from all files", "by_order"
        )
    notes += (*columns.notes, *deleted)
    if frame is not None:
        notes += (f"positions are in the frame {shown(frame)}, as the file says",)
    if unit is not None:
        notes += (f"positions are in {spoken(unit)}, as the file says",)
    if columns.units.get("length") == "in":
        notes += ("lengths in inches were converted to mm; so are numbers in options",)
    return Layout(headers, heading.lines, columns, rows, frame, (*heading.notes, *notes))


# ---- comments and titles


def _said_in_comments(grid: Grid) -> tuple[str | None, str | None]:
    """Return unit and frame of the positions: `AXES = CARTESIAN: X, Y, Z (mm)`, `… Coordinate Frame 'A::R0'`.

    Raises:
        ImportFileError: other coordinates than x, y, z; an unknown unit; two that differ.
    """
    said: dict[str, str] = {}
    for line, text in grid.remarks:
        found: dict[str, str] = {}
        if (axes := _AXES.search(text)) and axes[1].upper() != "CARTESIAN":
            raise ImportFileError(
                Place(grid.file, line),
                f"the file has {shown(axes[1].lower())} coordinates",
                "export Cartesian coordinates x, y, z",
            )
        if unit := _AXES_UNIT.search(text):
            named = unit_named(unit[1].casefold())
            if named is None or named[0] != "length":
                raise ImportFileError(
                    Place(grid.file, line),
                    f"the unit {shown(unit[1])} of x, y, z is not known",
                    "export in mm, m or inches",
                )
            found["unit"] = named[1]
        if frame := _FRAME.search(text):
            found["frame"] = collapsed(frame[1].rstrip(", \t")).strip("'\"")
        for kind, value in found.items():
            if said.setdefault(kind, value) != value:
                raise ImportFileError(
                    Place(grid.file, line),
                    f"the {kind} of the positions is {shown(spoken(value))}, but {shown(spoken(said[kind]))} "
                    "in an earlier comment",
                    "export one frame and one unit per file",
                )
    return said.get("unit"), said.get("frame")


def _check_remarks(grid: Grid, heading: _Heading, columns: Columns, faults: Faults) -> None:
    """Refuse lengths in another unit than a title or a comment names, such as `Units: inches`."""
    unit = columns.units.get("length")
    titles = grid.rows[: heading.start - len(heading.lines)] if heading.start else ()
    for line, text in (*((row.line, " ".join(row.cells)) for row in titles), *grid.remarks):
        for word in _LENGTH.findall(text):
            named = "mm" if word.lower() == "mm" else "in"
            if unit is not None and named != unit:
                reason = f"{shown(word)} stands here, but lengths are in {spoken(unit)}"
                remedy = "correct the unit, or remove the remark"
                faults.report(Place(grid.file, line), reason, remedy, "units.length")


# ---- the header


def _find_heading(grid: Grid, options: ImportOptions, faults: Faults) -> _Heading:
    """Return the caller's header, that in the first rows, in the last comment before the data, or none.

    Raises:
        ImportFileError: there is a header, but no data; or none, and no list of points.
    """
    if options.header is not None:
        return _Heading(_cells(grid, None, options.header, guessed=False), (), 0, stated=True)
    grammar = _Grammar(options)
    if _numbers(grid.rows[0]) < _DATA:
        return _in_rows(grid, grammar, faults)
    for comment in reversed(grid.comments):
        fits = comment.line < grid.rows[0].line and len(comment.cells) == len(grid.rows[0].cells)
        if fits and grammar.known(comment.cells) == len(comment.cells):
            note = f"the comment in line {comment.line} was used as the header"
            cells = _cells(grid, comment.line, comment.cells, guessed=True)
            return _Heading(cells, (comment.line,), 0, (note,))
    assumed = _headerless(grid, by_order=options.by_order)
    note = f"no header found; assumed columns: {', '.join(assumed)}"
    return _Heading(_cells(grid, None, assumed, guessed=True), (), 0, (note,), assumed=True)


def _in_rows(grid: Grid, grammar: _Grammar, faults: Faults) -> _Heading:
    start, count, merged = _best_rows(grid, grammar)
    if start + count == len(grid.rows):
        at = grid.place(grid.rows[start])
        raise ImportFileError(at, "the file has a header but no row of data", "check the file")
    lines = tuple(row.line for row in grid.rows[start : start + count])
    for row in grid.rows[:start]:
        if _numbers(row) > 1 or sum(map(bool, row.cells)) > max(2, len(merged) // 2):
            faults.report(
                grid.place(row),
                f"the row is above the header in line {lines[0]}, but looks like data",
                "move it below the header, or remove it",
            )
    notes = [f"rows above the header were taken for titles: {start}"] if start else []
    if count > 1:
        notes.append(f"the header was put together of rows {', '.join(map(str, lines))}")
    cells = _cells(grid, lines[-1], merged, guessed=count > 1)
    return _Heading(cells, lines, start + count, tuple(notes))


def _cells(grid: Grid, line: int | None, texts: Iterable[str], *, guessed: bool) -> tuple[HeaderCell, ...]:
    return tuple(
        HeaderCell(text, Place(grid.file, line, column), guessed)
        for column, text in enumerate(texts, start=1)
    )


def _numbers(row: Row) -> int:
    return sum(map(looks_like_a_number, row.cells))


def _best_rows(grid: Grid, grammar: _Grammar) -> tuple[int, int, list[str]]:
    """Return the first rows that are understood in full as a header, else those understood best."""
    rows = grid.rows[: _MAX_TITLES + _MAX_ROWS + 1]
    best, most = (0, 1, list(rows[0].cells)), 0
    for start in range(min(_MAX_TITLES + 1, len(rows))):
        if start and _numbers(rows[start - 1]) >= _DATA:
            break
        for count in range(min(_MAX_ROWS, len(rows) - start), 0, -1):
            texts = grammar.merged([row.cells for row in rows[start : start + count]])
            known = 0 if texts is None else grammar.known(texts)
            if texts is not None and known > most:
                best, most = (start, count, texts), known
                if known == sum(map(bool, texts)) and start + count < len(grid.rows):
                    return best
    return best


class _Grammar:
    """The grammar of headers with the words of the caller."""

    def __init__(self, options: ImportOptions) -> None:
        self._words = options.state_words
        self._stated = {collapsed(text) for text in (*options.columns, *options.ignore)}

    def meaning(self, text: str) -> Meaning | None:
        """Return what a header means; None if it is not understood."""
        if collapsed(text) in self._stated or folded(split_unit(text)[0]) == "q0":
            return Meaning("ignored")
        try:
            return meaning_of(text, self._words)
        except Fault:
            return None

    def known(self, texts: Sequence[str]) -> int:
        """Return how many cells are understood; none if no two of them are quantities or keys of a table."""
        meanings = [self.meaning(text) for text in texts if text]
        found = [meaning for meaning in meanings if meaning is not None]
        bare = [meaning.part for meaning in found if meaning.axis is not None]
        return 0 if len(set(bare)) < len(bare) or len(found) < 2 else len(found)

    def merged(self, rows: Sequence[tuple[str, ...]]) -> list[str] | None:
        """Return the rows of a header as one; None if one of them is no part of a header."""
        *above, lower = rows
        if not above:
            return list(lower)
        upper = self.merged(above)
        if upper is None or sum(map(bool, lower)) < 2 or self._title(rows[0]):
            return None
        width = max(len(upper), len(lower))
        upper += [""] * (width - len(upper))
        padded = [*lower, *[""] * (width - len(lower))]
        if all(_is_unit(cell) for cell in padded if cell):
            return [_with_unit(name, unit) for name, unit in zip(upper, padded, strict=True)]
        return self._grouped(upper, padded)

    def _title(self, row: tuple[str, ...]) -> bool:
        """Return whether a row has one text only, at its begin, that is no known word."""
        if sum(map(bool, row)) > 1 or not row[0]:
            return False
        words = split_unit(row[0])[0].replace("_", " ").split()
        known = any(state_named(word, self._words) or is_joint(word) for word in words)
        as_group = self.meaning(f"{row[0]} x")
        return not known and as_group is not None and as_group.target is not None

    def _grouped(self, upper: Sequence[str], lower: Sequence[str]) -> list[str] | None:
        """Put words below groups, which hold to the right as far as cells below them are filled."""
        texts, group = [], ""
        for above, below in zip(upper, lower, strict=True):
            group = above or (group if below else "")
            if looks_like_a_number(below) and not (below.isdigit() and is_joint(group)):
                return None
            texts.append(self._under(group, below, own=bool(above)))
            if not below:
                group = ""
        return texts

    def _under(self, group: str, below: str, *, own: bool) -> str:
        """`P10 loaded [mm]` and `x` as `P10 loaded x [mm]`; a key below is not of the group beside it."""
        if not group or not below:
            return group if own else below
        name, unit = split_unit(group)
        joined = f"{group} {below}"
        if unit is not None and split_unit(below)[1] in (None, unit):
            joined = _with_unit(f"{name} {below}", unit)
        if own or self.meaning(joined) is not None:
            return joined
        alone = self.meaning(below)
        return joined if alone is None or (alone.kind in POINTS and alone.target is None) else below


def _is_unit(cell: str) -> bool:
    text = cell.strip("[]() ")
    return cell in _NONE or unit_named(text) is not None or text in FOREIGN


def _with_unit(name: str, unit: str) -> str:
    unit = unit.strip("[]() ")
    if not unit or unit in _NONE or split_unit(name)[1] == unit:
        return name
    return f"{name} [{unit}]"


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
    faults.report(
        place,
        f"the file does not fit the template; {reason}",
        "import it without the template, or correct it",
    )


# ---- the rows of data


def _fitted(
    grid: Grid, heading: _Heading, faults: Faults
) -> tuple[tuple[Row, ...], tuple[HeaderCell, ...], tuple[str, ...]]:
    """Rows and header of one length; what is empty at the end of all of them is left out."""
    rows, cells = grid.rows[heading.start :], heading.cells
    width = len(cells)
    if grid.format == "text" and len({len(row.cells) for row in rows}) == 1:
        longest = len(rows[0].cells)
        while width > 1 and not cells[width - 1].text and not any(any(r.cells[width - 1 :]) for r in rows):
            width -= 1
        if longest >= width and not any(any(row.cells[width:]) for row in rows):
            if longest > width:
                rows = tuple(Row(row.line, row.cells[:width]) for row in rows)
            return rows, cells[:width], (_TRAILING,) if longest > width else ()
    fitted = []
    for row in rows:
        count = len(row.cells)
        if any(row.cells[len(cells) :]) or (count != len(cells) and row.kinds is None):
            faults.add(_misfit(grid, row, len(cells), heading))
        elif row.kinds is None or count == len(cells):
            fitted.append(row)
        else:  # rows of a sheet end with their last cell
            more: tuple[CellKind, ...] = tuple("text" for _ in range(len(cells) - count))
            texts = (*row.cells[: len(cells)], *("",) * len(more))
            fitted.append(Row(row.line, texts, (*row.kinds[: len(cells)], *more)))
    return tuple(fitted), cells, ()


def _misfit(grid: Grid, row: Row, width: int, heading: _Heading) -> ImportFileError:
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


def _check_end(grid: Grid, rows: Sequence[Row], faults: Faults) -> None:
    """Refuse a file whose last line has no end and whose last cell is shorter than its column."""
    if grid.ended or len(rows) < 2:
        return
    *others, last = (row.cells[-1] for row in rows)
    decimals = [[cell.replace(",", ".").partition(".")[2] for cell in row.cells] for row in rows]
    keeps_zeros = any(part.endswith("0") and len(part) > 1 for row in decimals for part in row)
    *lengths, length = (len(row[-1]) for row in decimals)
    shorter = looks_like_a_number(last) and length < min(lengths) - (not keeps_zeros)
    narrower = len(last.lstrip("+-")) < min(len(cell.lstrip("+-")) for cell in others)
    begun = any(cell.startswith(last) for cell in others)
    whole = looks_like_a_number(last) and length == 0 < min(lengths)  # 22 below 836.13 and 63.6
    if shorter or (narrower and (begun or whole)):
        faults.report(
            grid.place(rows[-1], len(rows[-1].cells) - 1),
            f"the file is cut off: its last line has no end, and {shown(last)} is shorter than its column",
            "export or copy the file again; if it is complete, end its last line",
        )


def _not_deleted(
    grid: Grid, rows: tuple[Row, ...], columns: Columns, faults: Faults
) -> tuple[tuple[Row, ...], tuple[str, ...]]:
    """Return the rows that no cell below `deleted` marks, and how many are left out."""
    index = columns.texts.get("deleted")
    if index is None:
        return rows, ()
    kept = []
    for row in rows:
        marked = MARKS.get(folded(row.cells[index]))
        if marked is None:
            reason = f"{shown(row.cells[index])} does not say whether the row is deleted"
            remedy = "use 0 or 1, or skip the column with `ignore`"
            faults.report(grid.place(row, index), reason, remedy)
        elif not marked:
            kept.append(row)
    count = len(rows) - len(kept)
    if not kept:
        faults.report(Place(grid.file), "all rows are marked as deleted", "check the file")
    return tuple(kept), (f"rows marked as deleted were left out: {count}",) if count else ()
