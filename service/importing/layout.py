"""The header of a table, wherever it stands, its columns, and the rows of data below it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.imports import (
    MAX_PREVIEW_ROWS,
    ColumnMeaning,
    DecimalMark,
    FilePreview,
    ImportOptions,
)
from jointstiff.service.importing import grammar
from jointstiff.service.importing.columns import Columns, HeaderCell, understand
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grammar import POINTS, Meaning, Quantity, collapsed, spoken
from jointstiff.service.importing.grid import (
    EMPTY,
    Grid,
    Row,
    count_numbers,
    decide_mark,
    looks_like_a_number,
)

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
    preview: FilePreview  # how it was read
    columns: Columns  # what they mean
    rows: tuple[Row, ...]  # rows of data, as long as the header
    mark: DecimalMark | None  # None if it is not clear
    frame: str | None = None  # frame of positions, as a comment of the file names it
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
    """
    heading = _find_heading(grid, options, faults)
    titles = grid.rows[: heading.start - len(heading.lines)] if heading.start else ()
    remarks, unit, frame = _read_remarks(grid, titles)
    rows, cells, fitting = _fitted(grid, heading, faults)
    headers = ["" if heading.assumed else cell.text for cell in cells]
    if options.layouts:
        _check_template(options, headers, Place(grid.file, *heading.lines[-1:]), faults)
    in_name = grammar.names_a_state(grid.stem, options.state_words)
    columns = understand(cells, rows, options, unit, faults, state_in_name=in_name)
    _check_units(grid.file, remarks, columns, faults)
    doubt = _check_end(grid, rows, faults)
    rows, deleted = _not_deleted(grid, rows, columns, faults)
    unnamed = options.by_order and "name" not in columns.texts
    if deleted and unnamed:
        reason = "rows are marked as deleted, so that the rows of this file are not those of the others"
        remedy = "give every row a label, or delete them from all files"
        faults.report(Place(grid.file), reason, remedy, "by_order")
    notes = [*grid.preview.assumptions, *heading.notes, *fitting, *columns.notes]
    if deleted:
        notes.append(f"rows marked as deleted were left out: {deleted}")
    if frame is not None:
        notes.append(f"positions are in the frame {shown(frame)}, as the file states")
    if unit is not None:
        notes.append(f"positions are in {spoken(unit)}, as the file states")
    if columns.units.get("length") == "in":
        notes.append("lengths in inches were converted to mm; so are numbers in options")
    if unnamed:
        notes.append("rows were matched to observations by their order, as `by_order` requires")
    mark, numbers = None, [column for indices in columns.quantities.values() for column in indices]
    with faults.collected():
        mark, assumed = decide_mark(grid, rows, numbers, options.decimal_mark)
        notes += [assumed] if assumed else []
    meanings = [
        ColumnMeaning(
            column=column,
            header=header,
            meaning=str(meaning),
            unit=meaning.unit,
            guessed=meaning.guessed and meaning.kind != "ignored",
        )
        for column, (header, meaning) in enumerate(zip(headers, columns.meanings, strict=True), start=1)
    ]
    preview = {
        "decimal_mark": mark if grid.preview.format == "text" else None,
        "columns": meanings,
        "row_count": len(rows),
        "first_rows": [list(row.cells) for row in rows[:MAX_PREVIEW_ROWS]],
        "assumptions": notes,
        "header_lines": list(heading.lines),
        "first_lines": [row.line for row in rows[:MAX_PREVIEW_ROWS]],
    }
    return Layout(grid, grid.preview.model_copy(update=preview), columns, rows, mark, frame, doubt)


# ---- the header


def _find_heading(grid: Grid, options: ImportOptions, faults: Faults) -> _Heading:
    """Return the caller's header, that in the first rows, in the last comment before the data, or none."""
    if options.header is not None:
        return _Heading(_cells(grid, None, options.header, guessed=False), (), 0, stated=True)
    headers, first = _Headers(options), grid.rows[0]
    if count_numbers(first) < _DATA:
        return _in_rows(grid, headers, faults)
    width = len(first.cells)  # of columns that have cells
    while width > 1 and not any(any(row.cells[width - 1 :]) for row in grid.rows):
        width -= 1
    above = [comment for comment in grid.comments if comment.line < first.line]
    for comment in reversed(above):
        line = comment.line
        short = _LONG_BLANK.sub(lambda blank: "\t\t" if "\t" in blank[0] else "  ", comment.text)
        for texts in (comment.cells, *(tuple(re.split(gap, short)) for gap in _GAPS)):
            if len(texts) == width and headers.known(texts) == width:
                note = f"the comment in line {line} was used as the header"
                return _Heading(_cells(grid, line, texts, guessed=True), (line,), 0, (note,))
        _check_no_header(grid.place(comment), comment, width, last=comment is above[-1])
    assumed = _headerless(grid, width, by_order=options.by_order)
    note = f"no header found; assumed columns: {', '.join(assumed)}"
    return _Heading(_cells(grid, None, assumed, guessed=True), (), 0, (note,), assumed=True)


def _cells(grid: Grid, line: int | None, texts: Iterable[str], *, guessed: bool) -> tuple[HeaderCell, ...]:
    places = ((text, Place(grid.file, line, column)) for column, text in enumerate(texts, start=1))
    return tuple(HeaderCell(text, place, guessed) for text, place in places)


def _check_no_header(place: Place, comment: Row, width: int, *, last: bool) -> None:
    """Refuse a comment that is a header, but not understood: no other is put in its place."""
    order = [word.casefold() for word in _ORDER.findall(comment.text)]
    axes = "".join(word for word in order if len(word) == 1)
    behind = order[order.index(axes[-1]) + 1 :] if axes else []
    words = re.findall(r"[^\W\d_]+", comment.text)
    named = _DATA <= len(words) <= width and not any(map(str.isdigit, comment.text))
    alike = last and axes != "xyz" and (named or len(comment.cells) == width)
    if (len(set(axes)) > 1 and (axes != "xyz" or any(map(grammar.is_key, behind)))) or alike:
        reason = (
            f"the comment {shown(comment.text)} looks like a header, but is not understood as that of the "
        )
        remedy = "correct or remove it, or give `header`"
        raise ImportFileError(place, f"{reason}{width} columns", remedy, "header")


def _in_rows(grid: Grid, headers: _Headers, faults: Faults) -> _Heading:
    start, count, merged = headers.best_rows(grid.rows)
    if start + count == len(grid.rows):
        at = grid.place(grid.rows[start])
        raise ImportFileError(at, "the file has a header but no row of data", "check the file")
    lines = tuple(row.line for row in grid.rows[start : start + count])
    for row in grid.rows[:start]:
        if count_numbers(row) > 1 or sum(map(bool, row.cells)) > max(2, len(merged) // 2):
            reason = f"the row is above the header in line {lines[0]}, but looks like data"
            faults.report(grid.place(row), reason, "move it below the header, or remove it")
    notes = [f"rows above the header were read as titles: {start}"] if start else []
    if count > 1:
        notes.append(f"the header was combined from rows {', '.join(map(str, lines))}")
    cells = _cells(grid, lines[-1], merged, guessed=count > 1)
    return _Heading(cells, lines, start + count, tuple(notes))


class _Headers:
    """The grammar of headers with the words of the caller."""

    def __init__(self, options: ImportOptions) -> None:
        self._words = options.state_words
        self._stated = {collapsed(text) for text in (*options.columns, *options.ignore)}

    def meaning(self, text: str) -> Meaning | None:
        """Return what a header means; None if it is not understood."""
        if collapsed(text) in self._stated or grammar.folded(grammar.split_unit(text)[0]) == "q0":
            return Meaning(Quantity("ignored"))
        try:
            return grammar.meaning_of(text, self._words)
        except ImportFileError:
            return None

    def known(self, texts: Sequence[str]) -> int:
        """Return how many cells are understood; none if no two of them are quantities or keys of a table."""
        found = [meaning for text in texts if text and (meaning := self.meaning(text))]
        parts = [(meaning.quantity, meaning.axis) for meaning in found if meaning.axis is not None]
        return 0 if len(set(parts)) < len(parts) or len(found) < 2 else len(found)

    def best_rows(self, all_rows: Sequence[Row]) -> tuple[int, int, list[str]]:
        """Return the first rows that are understood in full as a header, else those understood best."""
        rows = all_rows[: _MAX_TITLES + _MAX_ROWS + 1]
        best, most = (0, 1, list(rows[0].cells)), 0
        for start in range(min(_MAX_TITLES + 1, len(rows))):
            if start and count_numbers(rows[start - 1]) >= _DATA:
                break
            for count in range(min(_MAX_ROWS, len(rows) - start), 0, -1):
                texts = self._merged([row.cells for row in rows[start : start + count]])
                known = 0 if texts is None else self.known(texts)
                if texts is not None and known > most:
                    best, most = (start, count, texts), known
                    if known == sum(map(bool, texts)) and start + count < len(all_rows):
                        return best
        return best

    def _merged(self, rows: Sequence[tuple[str, ...]]) -> list[str] | None:
        """Return the rows of a header as one; None if one of them is no part of a header."""
        *above, lower = rows
        if not above:
            return list(lower)
        upper = self._merged(above)
        if upper is None or sum(map(bool, lower)) < 2 or self._title(rows[0]):
            return None
        width = max(len(upper), len(lower))
        upper += [""] * (width - len(upper))
        padded = [*lower, *[""] * (width - len(lower))]
        if all(cell in _NONE or grammar.any_unit(cell.strip("[]() ")) for cell in padded if cell):
            return [_with_unit(name, unit) for name, unit in zip(upper, padded, strict=True)]
        return self._grouped(upper, padded)

    def _title(self, row: tuple[str, ...]) -> bool:
        """Return whether a row has one text only, at its begin, that is no known word."""
        if sum(map(bool, row)) > 1 or not row[0]:
            return False
        words = grammar.split_unit(row[0])[0].replace("_", " ").split()
        known = any(grammar.state_named(word, self._words) or grammar.is_joint(word) for word in words)
        as_group = self.meaning(f"{row[0]} x")
        return not known and as_group is not None and as_group.quantity.target is not None

    def _grouped(self, upper: Sequence[str], lower: Sequence[str]) -> list[str] | None:
        """Put words below groups, which hold to the right as far as cells below them are filled."""
        texts, group = [], ""
        for above, below in zip(upper, lower, strict=True):
            group = above or (group if below else "")
            if looks_like_a_number(below) and not (below.isdigit() and grammar.is_joint(group)):
                return None
            texts.append(self._under(group, below, own=bool(above)))
            if not below:
                group = ""
        return texts

    def _under(self, group: str, below: str, *, own: bool) -> str:
        """`P10 loaded [mm]` and `x` as `P10 loaded x [mm]`; a key below is not of the group beside it."""
        if not group or not below:
            return group if own else below
        name, unit = grammar.split_unit(group)
        joined = f"{group} {below}"
        if unit is not None and grammar.split_unit(below)[1] in (None, unit):
            joined = _with_unit(f"{name} {below}", unit)
        if own or self.meaning(joined) is not None:
            return joined
        alone = self.meaning(below)
        free = alone is None or (alone.kind in POINTS and alone.quantity.target is None)
        return joined if free else below


def _with_unit(name: str, unit: str) -> str:
    unit = unit.strip("[]() ")
    if not unit or unit in _NONE or grammar.split_unit(name)[1] == unit:
        return name
    return f"{name} [{unit}]"


def _headerless(grid: Grid, width: int, *, by_order: bool) -> tuple[str, ...]:
    """The columns of a list of points."""
    headers = ("x", "y", "z") if by_order and width == 3 else _HEADERLESS.get(width)
    if headers is None:
        reason = f"the rows have {width} cells, and there is no header"
        remedy = "add a header such as `name x y z`, or give `header`"
        raise ImportFileError(grid.place(grid.rows[0]), reason, remedy, "header")
    for row in grid.rows:
        for column, cell in enumerate(row.cells[: len(headers) - 3]):
            number = looks_like_a_number(cell) and (column > 0 or not cell.isdigit())
            if grammar.is_key(cell) or number:
                reason = f"{shown(cell)} is where a point's name must be, because there is no header"
                remedy = f"give rows of {' '.join(headers)}, add a header, or give `header`"
                raise ImportFileError(grid.place(row, column), reason, remedy, "header")
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
    remedy = "import it without the template, or correct it"
    faults.report(place, f"the file does not fit the template; {reason}", remedy)


# ---- titles and comments: the unit and the frame that they say

_AXES: Final = re.compile(r"AXES\s*=\s*(\w+)", re.IGNORECASE)
_AXES_UNIT: Final = re.compile(r"\bX\W+Y\W+Z\s*(?:\(\s*([^\W\d]+)\s*\)|in\s+([^\W\d]+))", re.IGNORECASE)
_FRAME: Final = re.compile(
    r"(?:\b(?:FRAME|(?:COORDINATE|REFERENCE)\s+SYSTEM|(?:KOORDINATEN|BEZUGS)SYSTEM|REP[ÈE]RE|R[ÉE]F[ÉE]RENTIEL)\s*[=:]"
    r"|\b(?:COORDINATE|WORKING|REFERENCE|ACTIVE)\s+FRAME\b)\s*[=:]*\s*(\S.*)",
    re.IGNORECASE,
)
_UNITS: Final = re.compile(
    r"(?:UNITÉ|UNIT|EINHEIT)(?:S|EN)?\b(?P<end>[^=:]{0,30}[=:]+)?\s*(?P<units>\S.*)", re.IGNORECASE
)
_UNIT: Final = re.compile(
    r"[\[(]\s*([^\W\d]+)\s*[\])]|\b(?:in|en)\s+([^\W\d]+)|(?<![\d\w.,])(?<!\d )(mm|inch|inches)(?!\w)",
    re.IGNORECASE,
)
"""A word in brackets, behind `in`, or a unit that is not of a number, as a reflector's diameter would be."""

_Lines = list[tuple[int, str]]
"""Titles and comments: lines of the file, and their texts, in order."""


def _read_remarks(grid: Grid, titles: Sequence[Row]) -> tuple[_Lines, str | None, str | None]:
    """Return all remarks, the unit of x, y and z and the frame of positions that they say.

    As in `AXES = CARTESIAN: X, Y, Z (mm)`, `… Coordinate Frame 'A::R0'`, `Frame: A`.
    """
    lines = [(row.line, row.text) for row in grid.comments]
    for title in titles:  # `Frame;A::R0` as `Frame: A::R0`
        first, *others = [cell for cell in title.cells if cell]
        lines.append((title.line, f"{first}: {' '.join(others)}" if others else first))
    lines.sort()
    unit = frame = None
    for line, text in lines:
        place, axes, match = Place(grid.file, line), _AXES.search(text), _AXES_UNIT.search(text)
        if axes and axes[1].upper() != "CARTESIAN":
            reason = f"the file has {shown(axes[1].lower())} coordinates"
            raise ImportFileError(place, reason, "export Cartesian coordinates x, y, z")
        word = (match[1] or match[2]) if match else ""
        known = grammar.unit_named(word) or grammar.unit_named(word.casefold())
        if known is not None and known[0] == "length":
            unit = unit or known[1]
        elif word and (axes or grammar.any_unit(word)):  # else it is prose
            reason = f"the unit {shown(word)} of x, y, z is not known"
            raise ImportFileError(place, reason, "export in mm, m or inches")
        if match := _FRAME.search(text):
            name = collapsed(match[1].rstrip(", \t")).strip("'\"")
            if frame not in (None, name):
                reason = f"the frame of the positions is {shown(name)} here, but {shown(frame or '')} above"
                raise ImportFileError(place, reason, "export one frame per file")
            frame = name
    return lines, unit, frame


def _check_units(file: str, remarks: _Lines, columns: Columns, faults: Faults) -> None:
    """Refuse numbers in other units than a title or a comment names, such as `Units: inches` or `[m]`."""
    for line, text in remarks:
        match = _UNITS.search(text)
        words = re.findall(r"[^\s,;:()\[\]]+", match["units"]) if match else []
        known = [word for word in words if grammar.any_unit(word) and (word != "in" or len(words) == 1)]
        if match and not match["end"] and len(known) < len(words):
            known = []  # prose
        elif len(words) == 1 and not known and words[0].isalpha():
            reason = f"the unit {shown(words[0])} is not known"
            faults.report(Place(file, line), reason, "correct the remark, or remove it")
        for word in (*known, *map("".join, _UNIT.findall(text))):
            dimension, unit = grammar.any_unit(word) or (None, "")
            held = columns.units.get(dimension) if dimension else None
            if dimension and held and unit != held:
                reason = f"{shown(word)} is given here, but {dimension}s are in {spoken(held)}"
                remedy = "correct the unit, or remove the remark"
                faults.report(Place(file, line), reason, remedy, f"units.{dimension}")


# ---- the rows of data


def _fitted(
    grid: Grid, heading: _Heading, faults: Faults
) -> tuple[tuple[Row, ...], tuple[HeaderCell, ...], tuple[str, ...]]:
    """Rows and header of one length, and notes; what is empty at the end of all of them is left out."""
    rows, cells = grid.rows[heading.start :], heading.cells
    width = len(cells)
    if grid.preview.format == "text" and len({len(row.cells) for row in rows}) == 1:
        longest = len(rows[0].cells)
        while width > 1 and not cells[width - 1].text and not any(any(r.cells[width - 1 :]) for r in rows):
            width -= 1
        if longest == width:
            return rows, cells[:width], ()
        if longest > width and not any(any(row.cells[width:]) for row in rows):
            note = "every row ends with a delimiter; the empty last column was ignored"
            return tuple(Row(row.line, row.cells[:width]) for row in rows), cells[:width], (note,)
    fitted = []
    for row in rows:
        count = len(row.cells)
        if any(row.cells[len(cells) :]) or (count != len(cells) and row.kinds is None):
            faults.add(_misfit(grid, row, len(cells), heading))
        elif row.kinds is None or count == len(cells):
            fitted.append(row)
        else:  # rows of a sheet end with their last cell
            more = max(0, len(cells) - count)
            texts = (*row.cells[: len(cells)], *[""] * more)
            fitted.append(Row(row.line, texts, (*row.kinds[: len(cells)], *EMPTY * more)))
    return tuple(fitted), cells, ()


def _misfit(grid: Grid, row: Row, width: int, heading: _Heading) -> ImportFileError:
    count = len(row.cells)
    if row.kinds is not None:
        reason = f"the row has {count} cells, but the header {width}"
        remedy = "give every column a header, and every row the same number of cells"
        return ImportFileError(grid.place(row, min(width, count - 1)), reason, remedy)
    line = heading.lines[-1] if heading.lines else grid.rows[0].line
    than = "the header" if heading.stated else f"line {line} has"
    return ImportFileError(
        grid.place(row, min(count, width)),
        f"the row has {count} cells, but {than} {width} (delimiter: {grid.preview.delimiter})",
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
        reason = f"its last line has no end, and {shown(last)} is shorter than its column"
        remedy = "export or copy the file again; if it is complete, end its last line"
        faults.report(place, f"the file is cut off: {reason}", remedy)
    whole = last in others or 0 < length == max(lengths) or length >= _FINE
    return f"the last number {last} ({place}), whose line has no end" if number and not whole else None


def _not_deleted(
    grid: Grid, rows: tuple[Row, ...], columns: Columns, faults: Faults
) -> tuple[tuple[Row, ...], int]:
    """Return the rows that no cell below `deleted` marks, and how many are left out."""
    index = columns.texts.get("deleted")
    if index is None:
        return rows, 0
    kept = []
    for row in rows:
        marked = grammar.MARKS.get(grammar.folded(row.cells[index]))
        if marked is None:
            reason = f"{shown(row.cells[index])} does not show whether the row is deleted"
            remedy = "use 0 or 1, or skip the column with `ignore`"
            faults.report(grid.place(row, index), reason, remedy)
        elif not marked:
            kept.append(row)
    if not kept:
        faults.report(Place(grid.file), "all rows are marked as deleted", "check the file")
    return tuple(kept), len(rows) - len(kept)
