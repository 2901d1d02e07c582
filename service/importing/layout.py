"""The header of a table, wherever it stands, its columns, and the rows of data below it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.importing import DecimalMark, ImportOptions
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
from jointstiff.service.importing.numbers import decide_mark, looks_like_a_number
from jointstiff.service.importing.remarks import check_units, read_remarks
from jointstiff.service.importing.words import MARKS, any_unit

_MAX_TITLES: Final = 20
"""Rows above a header."""
_MAX_ROWS: Final = 3
"""Rows of a header: groups, axes, units."""
_DATA: Final = 3
"""Numbers in a row of data: no table has fewer."""
_FINE: Final = 6
"""Decimals of a number to which another one adds nothing that matters."""
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
_ORDER: Final = re.compile(r"(?<![^\W_])(?:[xyz]|[^\W\d_]{2,})(?![^\W_])", re.IGNORECASE)
"""Names of axes, and words, in their order."""
_GAPS: Final = (r"\s*[;,\t]\s*", r"\s{2,}", r"\s+(?![\[(])")
"""What may stand between the headers in a comment."""
_LONG_BLANK: Final = re.compile(r"\s{3,}")
"""Blanks of which two say as much; a gap would be looked for from each of them on."""


@dataclass(frozen=True)
class Layout:
    """A table whose columns are understood."""

    grid: Grid  # the file
    headers: tuple[str, ...]  # as they stand in the file; empty texts where there is no header
    lines: tuple[int, ...]  # lines of the file that make the header
    columns: Columns  # what they mean
    rows: tuple[Row, ...]  # rows of data, as long as the header
    mark: DecimalMark | None  # None if it is not clear
    frame: str | None = None  # frame of positions, as a comment of the file names it
    assumptions: tuple[str, ...] = ()  # in words
    doubt: str | None = None  # value to be confirmed, in words


@dataclass(frozen=True)
class _Heading:
    """A header as it stands in the file."""

    cells: tuple[HeaderCell, ...]  # one a column
    lines: tuple[int, ...]  # lines of the file that make it
    start: int  # index of the first row of data
    notes: tuple[str, ...] = ()  # in words
    stated: bool = False  # whether the caller states it
    assumed: bool = False  # whether the file has none


def lay_out(grid: Grid, options: ImportOptions, faults: Faults) -> Layout:
    """Find and understand the header: the caller's, one in the first rows, or one in a comment.

    A table without any is a list of points: `name x y z`, with `group` or `collection group` before it.

    Raises:
        ImportFileError: there is none and it is no such list.
    """
    heading = _find_heading(grid, options, faults)
    titles = grid.rows[: heading.start - len(heading.lines)] if heading.start else ()
    remarks, unit, frame = read_remarks(grid, titles)
    rows, cells, notes = _fitted(grid, heading, faults)
    headers = tuple("" if heading.assumed else cell.text for cell in cells)
    if options.layouts:
        _check_template(options, headers, Place(grid.file, *heading.lines[-1:]), faults)
    in_name = names_a_state(grid.stem, options.state_words)
    columns = understand(cells, rows, options, unit, faults, state_in_name=in_name)
    check_units(grid.file, remarks, columns, faults)
    doubt = _check_end(grid, rows, faults)
    rows, deleted = _not_deleted(grid, rows, columns, faults)
    if deleted and options.by_order and "name" not in columns.texts:
        reason = "rows are marked as deleted, so that the rows of this file are not those of the others"
        faults.report(
            Place(grid.file), reason, "give every row a label, or delete them from all files", "by_order"
        )
    notes += (*columns.notes, *deleted)
    if frame is not None:
        notes += (f"positions are in the frame {shown(frame)}, as the file states",)
    if unit is not None:
        notes += (f"positions are in {spoken(unit)}, as the file states",)
    if columns.units.get("length") == "in":
        notes += ("lengths in inches were converted to mm; so are numbers in options",)
    if "name" not in columns.texts and options.by_order:
        notes += ("rows were matched to observations by their order, as `by_order` requires",)
    mark, numbers = None, [column for indices in columns.quantities.values() for column in indices]
    with faults.collected():
        mark, assumed = decide_mark(grid, rows, numbers, options.decimal_mark)
        notes += (assumed,) if assumed else ()
    notes = (*grid.assumptions, *heading.notes, *notes)
    return Layout(grid, headers, heading.lines, columns, rows, mark, frame, notes, doubt)


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
    width = _width(grid)
    comments = zip(grid.comments, grid.remarks, strict=True)
    above = [(comment, *remark) for comment, remark in comments if remark[0] < grid.rows[0].line]
    for comment, line, text in reversed(above):
        short = _LONG_BLANK.sub(lambda blank: "\t\t" if "\t" in blank[0] else "  ", text)
        for texts in (comment.cells, *(tuple(re.split(gap, short)) for gap in _GAPS)):
            if len(texts) == width and grammar.known(texts) == width:
                note = f"the comment in line {line} was used as the header"
                return _Heading(_cells(grid, line, texts, guessed=True), (line,), 0, (note,))
        _check_no_header(Place(grid.file, line), text, comment, width, last=line == above[-1][1])
    assumed = _headerless(grid, width, by_order=options.by_order)
    note = f"no header found; assumed columns: {', '.join(assumed)}"
    return _Heading(_cells(grid, None, assumed, guessed=True), (), 0, (note,), assumed=True)


def _width(grid: Grid) -> int:
    """Return the number of columns that have cells."""
    width = len(grid.rows[0].cells)
    while width > 1 and not any(any(row.cells[width - 1 :]) for row in grid.rows):
        width -= 1
    return width


def _check_no_header(place: Place, text: str, comment: Row, width: int, *, last: bool) -> None:
    """Refuse a comment that is a header, but not understood: no other is put in its place.

    Raises:
        ImportFileError: it names x, y and z in another order, or something behind them, or it stands right
            above the data (`last`) and has as many cells, or no more words.
    """
    order = [word.casefold() for word in _ORDER.findall(text)]
    axes = "".join(word for word in order if len(word) == 1)
    behind = order[order.index(axes[-1]) + 1 :] if axes else []
    words = re.findall(r"[^\W\d_]+", text)
    named = _DATA <= len(words) <= width and not any(map(str.isdigit, text))
    alike = last and axes != "xyz" and (named or len(comment.cells) == width)
    if (len(set(axes)) > 1 and (axes != "xyz" or any(map(is_key, behind)))) or alike:
        raise ImportFileError(
            place,
            f"the comment {shown(text)} looks like a header, but is not understood as that of the "
            f"{width} columns",
            "correct or remove it, or give `header`",
            "header",
        )


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
    notes = [f"rows above the header were read as titles: {start}"] if start else []
    if count > 1:
        notes.append(f"the header was combined from rows {', '.join(map(str, lines))}")
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
        if all(cell in _NONE or any_unit(cell.strip("[]() ")) for cell in padded if cell):
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


def _with_unit(name: str, unit: str) -> str:
    unit = unit.strip("[]() ")
    if not unit or unit in _NONE or split_unit(name)[1] == unit:
        return name
    return f"{name} [{unit}]"


def _headerless(grid: Grid, width: int, *, by_order: bool) -> tuple[str, ...]:
    """The columns of a list of points."""
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
    texts = [collapsed(text) for text in headers]
    known = [[collapsed(text) for text in one] for one in options.layouts]
    if texts in known:
        return
    nearest = max(known, key=lambda one: len(set(one) & set(texts)))
    absent = [text for text in nearest if text not in texts]
    extra = [text for text in texts if text not in nearest]
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


def _check_end(grid: Grid, rows: Sequence[Row], faults: Faults) -> str | None:
    """Refuse a file whose last line has no end and whose last cell is shorter than its column.

    Returns:
        A number that may be cut off as well, in words: it is neither rounded nor that of another row.
    """
    if grid.ended or len(rows) < 2:
        return None
    *others, last = (row.cells[-1] for row in rows)
    decimals = [[cell.replace(",", ".").partition(".")[2] for cell in row.cells] for row in rows]
    keeps_zeros = any(part.endswith("0") and len(part) > 1 for row in decimals for part in row)
    *lengths, length = (len(row[-1]) for row in decimals)
    number, place = looks_like_a_number(last), grid.place(rows[-1], len(rows[-1].cells) - 1)
    shorter = number and length < min(lengths) - (not keeps_zeros)
    narrower = len(last.lstrip("+-")) < min(len(cell.lstrip("+-")) for cell in others)
    begun = any(cell.startswith(last) and (number or narrower) for cell in others if cell != last)
    whole = number and narrower and length == 0 < min(lengths)  # 22 below 836.13 and 63.6
    if shorter or begun or whole:
        faults.report(
            place,
            f"the file is cut off: its last line has no end, and {shown(last)} is shorter than its column",
            "export or copy the file again; if it is complete, end its last line",
        )
    whole = last in others or 0 < length == max(lengths) or length >= _FINE
    return f"the last number {last} ({place}), whose line has no end" if number and not whole else None


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
            reason = f"{shown(row.cells[index])} does not show whether the row is deleted"
            remedy = "use 0 or 1, or skip the column with `ignore`"
            faults.report(grid.place(row, index), reason, remedy)
        elif not marked:
            kept.append(row)
    count = len(rows) - len(kept)
    if not kept:
        faults.report(Place(grid.file), "all rows are marked as deleted", "check the file")
    return tuple(kept), (f"rows marked as deleted were left out: {count}",) if count else ()
