"""A table whose columns are understood: its header, what titles and comments say of it, its rows of data."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from statistics import fmean, pstdev, stdev
from typing import Final

from jointstiff.schemas.imports import (
    ColumnMeaning,
    DecimalMark,
    FilePreview,
    ImportOptions,
)
from jointstiff.service.importing import grammar
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, quote
from jointstiff.service.importing.grammar import Vocabulary, collapse_blanks, name_unit
from jointstiff.service.importing.grid import (
    Grid,
    Remark,
    Row,
    decide_decimal_mark,
    has_separated_thousands,
    is_plain_number,
    looks_like_a_number,
)
from jointstiff.service.importing.header import ColumnReader, Columns, Heading, find_heading
from jointstiff.service.tables.labels import fold_word

_LEAST_ROWS, _MOST_ROWS = 4, 10_000
"""Rows of a table whose last rows may be statistics by their numbers alone."""
_LEAST_COLUMNS: Final = 3
"""Columns with different numbers that show that a row has statistics."""
_REMARK: Final = re.compile(r"(?=.*[^\W\d])(?:.*\S\s+\S|[^\W\d]\w*:)")
"""Text of a remark: two words at least, or a word with a colon."""
_MANY_DECIMALS: Final = 6
"""Number of decimals after which a further, missing decimal does not matter."""


@dataclass(frozen=True)
class Layout:
    """Table with the meaning of its columns, its rows of data, and remarks on it."""

    grid: Grid  # the file
    preview: FilePreview  # how the file was read
    columns: Columns  # meanings of the columns
    rows: tuple[Row, ...]  # rows of data, as long as the header
    decimal_mark: DecimalMark | None  # None if the mark is not clear, which has been reported as a fault
    are_thousands_separated: bool = False  # whether texts may be numbers such as `1.299,99`
    frame: str | None = None  # frame of positions, as a comment of the file names it
    unsure_number: str | None = None  # words for a number that may lack digits, for the user to confirm


def understand_table(
    grid: Grid, options: ImportOptions, faults: Faults, joints: Sequence[str] = ()
) -> Layout:
    """Find the header of a table and understand its columns; return the table with its rows of data.

    Faults that do not stop the reading are added to `faults`. `joints` are the names of the robot's joints.

    Raises:
        ImportFileError: the header cannot be found, or a title or comment contradicts the table.
    """
    vocabulary = Vocabulary(options, joints)
    heading = find_heading(grid, vocabulary, options)
    remarks = sorted([*grid.comments, *_read_titles_above(grid, heading)])
    axes_unit, frame = _read_remarks(grid.file, remarks)
    grid, notes_on_rows = _drop_rows_without_readings(grid, heading)
    heading, rows = _fit_rows_to_heading(grid, heading, faults)
    headers = ["" if heading.columns_are_assumed else text for text in heading.texts]
    if options.layouts:
        _check_template(options, headers, heading.place(), faults)
    names = (grid.stem, grid.sheet_of(options.sheet) or "")
    name_has_state = any(grammar.contains_state_word(name, options.state_words) for name in names)
    column_reader = ColumnReader(heading, rows, vocabulary, options, faults)
    columns = column_reader.understand(axes_unit, state_in_name=name_has_state)
    _check_units(grid.file, remarks, columns, faults)
    unsure_number = _check_end_of_file(grid, rows, faults)
    notes = [*grid.preview.assumptions, *heading.notes, *notes_on_rows, *columns.notes]
    rows_are_numbered = options.by_order and "name" not in columns.texts
    if rows_are_numbered:
        notes.append("rows were numbered, the first as observation 1, as `by_order` requires")
    kept = _drop_deleted_rows(grid, rows, columns, faults, numbered=rows_are_numbered)
    if len(kept) < len(rows):
        notes.append(f"rows marked as deleted were omitted: {len(rows) - len(kept)}")
    rows = kept
    if frame is not None:
        notes.append(f"positions are in the frame {quote(frame)}, as the file states")
    if axes_unit is not None:
        notes.append(f"positions are in {name_unit(axes_unit)}, as the file states")
    if columns.units.get("length") == "in":
        notes.append("lengths in inches, also those in the options, were converted to mm")
    number_columns = [column for indices in columns.quantities.values() for column in indices]
    decimal_mark = None  # remains if the decimal mark is not clear
    are_thousands_separated = grid.preview.format != "text" or has_separated_thousands(rows, number_columns)
    with faults.collect():
        decimal_mark, note_on_mark = decide_decimal_mark(
            grid,
            rows,
            number_columns,
            options.decimal_mark,
            are_thousands_separated=are_thousands_separated,
        )
        notes += [note_on_mark] if note_on_mark else []
    described = _describe_columns(headers, columns)
    return Layout(
        grid,
        grid.preview_table(list(heading.lines), rows, described, decimal_mark, notes),
        columns,
        rows,
        decimal_mark,
        are_thousands_separated,
        frame,
        unsure_number,
    )


def _describe_columns(headers: Sequence[str], columns: Columns) -> list[ColumnMeaning]:
    """Return a description of each column for the preview, with header, meaning and unit."""
    return [
        ColumnMeaning(
            column=column,
            header=header,
            meaning=str(meaning),
            unit=meaning.unit,
            guessed=meaning.guessed and meaning.kind != "ignored",
        )
        for column, (header, meaning) in enumerate(zip(headers, columns.meanings, strict=True), start=1)
    ]


def _check_template(options: ImportOptions, headers: Sequence[str], place: Place, faults: Faults) -> None:
    """Report a fault if the headers are not those of any file of the import template.

    The fault lists how they differ from the template file that has most of these headers.
    """
    texts = [collapse_blanks(text) for text in headers]
    known = [[collapse_blanks(text) for text in layout] for layout in options.layouts]
    if texts in known:
        return
    nearest = max(known, key=lambda layout: len(set(layout) & set(texts)))
    differences = {
        "missing": [text for text in nearest if text not in texts],
        "not in the template": [text for text in texts if text not in nearest],
    }
    listed = [f"{what}: {quote(', '.join(found))}" for what, found in differences.items() if found]
    reason = "; ".join(listed) or "the columns have another order or number"
    remedy = "import the file without the template (`layouts`), or correct the file"
    faults.report(place, f"the file does not fit the template; {reason}", remedy)


# ---- unit and frame that titles and comments state

_AXES: Final = re.compile(r"AXES\s*=\s*(\w+)", re.IGNORECASE)
_AXES_UNIT: Final = re.compile(
    r"\bX\W+Y\W+Z\s*(?:\(\s*([^\W\d]+)\s*\)|in\s+([^\W\d]+))"
    r"|\bX\s*\(\s*([^\W\d]+)\s*\)\W+Y\s*\(\s*\3\s*\)\W+Z\s*\(\s*\3\s*\)",
    re.IGNORECASE,
)
"""The unit behind the names of the axes, in one of three groups, or behind each of them."""
_FRAME: Final = re.compile(
    r"(?:\b(?:FRAME|(?:COORDINATE|REFERENCE)\s+SYSTEM|(?:KOORDINATEN|BEZUGS)SYSTEM|REP[ÈE]RE|R[ÉE]F[ÉE]RENTIEL)\s*[=:]"
    r"|\b(?:COORDINATE|WORKING|REFERENCE|ACTIVE)\s+FRAME\b)\s*[=:]*\s*(\S.*)",
    re.IGNORECASE,
)
_UNITS: Final = re.compile(
    r"(?:UNITÉ|UNIT|EINHEIT)(?:S|EN)?\b(?P<equals>[^=:]{0,30}[=:]+)?\s*(?P<units>\S.*)", re.IGNORECASE
)
_UNIT: Final = re.compile(
    r"[\[(]\s*([^\W\d]+)\s*[\])]|\b(?:in|en)\s+([^\W\d]+)|(?<![\d\w.,])(?<!\d )(mm|inch|inches)(?!\w)",
    re.IGNORECASE,
)
"""A word in brackets, behind `in`, or a unit that is not of a number, as a reflector's diameter would be."""


def _read_titles_above(grid: Grid, heading: Heading) -> list[Remark]:
    """Return the rows above the header as remarks; a row `Frame;A::R0` gives the text `Frame: A::R0`."""
    titles = []
    for row in grid.rows[: max(0, heading.start - len(heading.lines))]:
        first, *others = [cell for cell in row.cells if cell]
        titles.append(Remark(row.line, f"{first}: {' '.join(others)}" if others else first))
    return titles


def _read_remarks(file: str, remarks: Sequence[Remark]) -> tuple[str | None, str | None]:
    """Return the unit of x, y and z, and the name of the positions' frame, from a file's titles and comments.

    Examples are `AXES = CARTESIAN: X, Y, Z (mm)`, `… Coordinate Frame 'A::R0'` and `Frame: A`. Unit or frame
    is None if no remark states it.

    Raises:
        ImportFileError: coordinates are not Cartesian, the unit is unknown, or two frames are named.
    """
    unit = frame = None
    for line, text in remarks:
        place, axes, match = Place(file, line), _AXES.search(text), _AXES_UNIT.search(text)
        if axes and axes[1].upper() not in ("CARTESIAN", "X"):
            reason = f"the file has {quote(axes[1].lower())} coordinates"
            raise ImportFileError(place, reason, "export Cartesian coordinates x, y, z")
        word = match[int(match.lastindex or 0)] if match else ""
        known = grammar.find_known_unit(word) or grammar.find_known_unit(word.casefold())
        if known is not None and known[0] == "length":
            unit = unit or known[1]
        elif word and (axes or grammar.find_any_unit(word)):  # any other word is part of a sentence
            reason = f"the unit {quote(word)} of x, y, z is not known"
            raise ImportFileError(place, reason, "export in mm, m or inches")
        if match := _FRAME.search(text):
            name = collapse_blanks(match[1].rstrip(", \t")).strip("'\"")
            if frame not in (None, name):
                reason = f"the frame of the positions is {quote(name)} here, but {quote(frame or '')} above"
                raise ImportFileError(place, reason, "export one frame per file")
            frame = name
    return unit, frame


def _check_units(file: str, remarks: Sequence[Remark], columns: Columns, faults: Faults) -> None:
    """Report a fault if a title or comment, such as `Units: inches`, names another unit than the columns."""
    for line, text in remarks:
        units_match = _UNITS.search(text)
        words = re.findall(r"[^\s,;:()\[\]]+", units_match["units"]) if units_match else []
        # The word `in` means inches only if it is alone; in a sentence it is a preposition.
        unit_words = [
            word for word in words if grammar.find_any_unit(word) and (word != "in" or len(words) == 1)
        ]
        if units_match and not units_match["equals"] and len(unit_words) < len(words):
            unit_words = []  # the words are a sentence, not a list of units
        elif len(words) == 1 and not unit_words and words[0].isalpha():
            reason = f"the unit {quote(words[0])} is not known"
            faults.report(Place(file, line), reason, "correct or remove the remark")
        for word in (*unit_words, *map("".join, _UNIT.findall(text))):
            dimension, unit = grammar.find_any_unit(word) or (None, "")
            column_unit = columns.units.get(dimension) if dimension else None
            if dimension and column_unit and unit != column_unit:
                reason = f"{quote(word)} is given here, but {dimension}s are in {name_unit(column_unit)}"
                remedy = "correct the unit, or remove the remark"
                faults.report(Place(file, line), reason, remedy, f"units.{dimension}")


# ---- the rows of data


def _fit_rows_to_heading(grid: Grid, heading: Heading, faults: Faults) -> tuple[Heading, tuple[Row, ...]]:
    """Return the heading, and the rows of data that have as many cells as the heading has columns.

    Columns at the end are left out if their headers and all of their cells are empty. Rows of another length
    are reported as faults.
    """
    rows, texts, notes = grid.rows[heading.start :], heading.texts, heading.notes
    lengths = {len(row.cells) for row in rows}
    if len(lengths) == 1:
        row_length = lengths.pop()
        width = max(row_length, len(texts))
        # Columns at the end that are empty in the header and in all rows are left out.
        while (
            width > 1 and not any(texts[width - 1 :]) and not any(any(row.cells[width - 1 :]) for row in rows)
        ):
            width -= 1
        if width <= min(row_length, len(texts)):
            texts = texts[:width]
            rows = tuple(_cut_row(row, width) for row in rows)
            if row_length > width and grid.preview.format == "text":
                notes = (*notes, "every row ends with a delimiter; the empty last column was ignored")
    fitted = []
    for row in rows:
        if len(row.cells) == len(texts):
            fitted.append(row)
            continue
        line = heading.lines[-1] if heading.lines else grid.rows[0].line
        header_has = f"line {line} has" if heading.lines or heading.columns_are_assumed else "the header"
        delimiter_words = f" (delimiter: {grid.preview.delimiter})" if grid.preview.delimiter else ""
        faults.report(
            grid.place(row, min(len(row.cells), len(texts))),
            f"the row has {len(row.cells)} cells, but {header_has} {len(texts)}{delimiter_words}",
            "give every row the same number of cells; check for a missing or doubled delimiter, a decimal "
            "comma in a comma-separated file, or a blank in a name without quotation marks",
        )
    return replace(heading, texts=texts, notes=notes), tuple(fitted)


def _drop_rows_without_readings(grid: Grid, heading: Heading) -> tuple[Grid, list[str]]:
    """Return the table without its rows of statistics and of remarks below the header, and notes on them.

    A row of statistics begins with a word such as `mean`, or has the means of the rows above it; a row of a
    remark has only one text, of several words. A row that may be an observation is kept.
    """
    statistics, remarks, kept = list[str](), list[str](), list(grid.rows[: heading.start])
    means = _find_rows_of_means(grid.rows[heading.start :])
    extremes = cache(lambda: _find_extremes(grid, heading))  # found once, when a row needs them
    for row in grid.rows[heading.start :]:
        filled = [cell for cell in row.cells if cell]
        if row.line in means:
            statistics.append(row.cells[0])
        elif (
            filled
            and grammar.is_statistic(filled[0])
            and not looks_like_a_number(filled[0])
            and (not grammar.is_extreme(filled[0]) or _has_extremes(row, extremes()))
        ):
            statistics.append(filled[0])
        elif len(filled) == 1 and len(heading.texts) > 2 and _is_remark(grid, row, filled[0], heading):
            remarks.append(filled[0])
        else:
            kept.append(row)
    notes = [
        f"rows of {what} were omitted: {len(found)}, the first {quote(found[0])}"
        for what, found in (("statistics", statistics), ("remarks", remarks))
        if found
    ]
    if not notes or len(kept) == heading.start:
        return grid, []
    return replace(grid, rows=tuple(kept)), notes


def _is_remark(grid: Grid, row: Row, text: str, heading: Heading) -> bool:
    """Return whether a row, whose only text this is, has a remark, or a line of dashes.

    A single word with digits may be the label of an observation, as may any word in a row of full length or
    at the end of a file that is cut off; a single word for a state may belong to the rows below.
    """
    if _REMARK.match(text) is not None:
        return True
    is_cut_off = row is grid.rows[-1] and not grid.has_final_line_break
    is_label = len(row.cells) >= len(heading.texts) or any(map(str.isdigit, text)) or is_cut_off
    return not is_label and grammar.find_state(text, {}) is None


def _find_rows_of_means(rows: Sequence[Row]) -> set[int]:
    """Return the lines of last rows that have means or standard deviations of all other rows, by any name.

    Such rows agree with a statistic in each column of numbers, within the digits that they show.
    """
    if not _LEAST_ROWS <= len(rows) <= _MOST_ROWS:
        return set()
    width = min(len(row.cells) for row in rows)
    columns = [[row.cells[k].replace(",", ".") for row in rows] for k in range(width)]
    numbers = [column for column in columns if all(map(is_plain_number, column))]
    for count in (2, 1):  # means and standard deviations, or means alone
        above = [list(map(float, column[:-count])) for column in numbers]
        varying = [k for k, values in enumerate(above) if len(set(values)) > 1]
        last = [[numbers[k][place] for k in varying] for place in range(-count, 0)]
        statistics = [[of(above[k]) for k in varying] for of in (fmean, stdev, pstdev)]
        if len(varying) >= _LEAST_COLUMNS and all(
            any(map(partial(_are_equal, row), statistics)) for row in last
        ):
            return {row.line for row in rows[-count:]}
    return set()


def _find_extremes(grid: Grid, heading: Heading) -> list[tuple[float, float] | None]:
    """Return the least and the greatest number of each column; None for a column that has other cells.

    Rows of statistics, and rows with a single text, do not count.
    """
    rows = [
        row.cells
        for row in grid.rows[heading.start :]
        if sum(map(bool, row.cells)) > 1 and not grammar.is_statistic(row.cells[0])
    ]
    width = min(map(len, rows), default=0)
    columns = ([cells[k].replace(",", ".") for cells in rows] for k in range(width))
    return [
        (min(map(float, column)), max(map(float, column))) if all(map(is_plain_number, column)) else None
        for column in columns
    ]


def _has_extremes(row: Row, extremes: Sequence[tuple[float, float] | None]) -> bool:
    """Return whether each number of a row is the least, or each is the greatest, of its column's numbers."""
    pairs = [
        (cell.replace(",", "."), both)
        for cell, both in zip(row.cells, extremes, strict=False)
        if both and is_plain_number(cell.replace(",", "."))
    ]
    texts = [text for text, _ in pairs]
    return bool(pairs) and any(_are_equal(texts, [both[k] for _, both in pairs]) for k in (0, 1))


def _are_equal(texts: Sequence[str], values: Sequence[float]) -> bool:
    """Return whether numbers are equal within the digits that their texts show."""
    return all(
        abs(float(text) - value) <= _half_digit(text) for text, value in zip(texts, values, strict=True)
    )


def _half_digit(text: str) -> float:
    """Return half a unit of the last digit of a number, with a margin for its rounding."""
    mantissa, _, exponent = text.lower().partition("e")
    return 0.51 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def _cut_row(row: Row, width: int) -> Row:
    """Return a row cut to its first `width` cells."""
    if len(row.cells) == width:
        return row
    return Row(row.line, row.cells[:width], None if row.kinds is None else row.kinds[:width])


def _check_end_of_file(grid: Grid, rows: Sequence[Row], faults: Faults) -> str | None:
    """Report a fault if the end of a file seems to be missing.

    A file seems incomplete if its last line has no line break and its last cell is shorter than those above.

    Returns:
        Words that name the last number, for the user to confirm, if digits may be missing; else None.
    """
    if grid.has_final_line_break or len(rows) < 2:
        return None
    *cells_above, last_cell = (row.cells[-1] for row in rows)
    decimals = [[cell.replace(",", ".").partition(".")[2] for cell in row.cells] for row in rows]
    writes_trailing_zeros = any(
        decimals_of_cell.endswith("0") and len(decimals_of_cell) > 1
        for row in decimals
        for decimals_of_cell in row
    )
    *decimal_counts, last_decimal_count = (len(row[-1]) for row in decimals)
    is_number = looks_like_a_number(last_cell)
    place = grid.place(rows[-1], len(rows[-1].cells) - 1)
    # Without trailing zeros a number may have one decimal fewer than the others.
    has_fewer_decimals = is_number and last_decimal_count < min(decimal_counts) - (not writes_trailing_zeros)
    has_fewer_characters = len(last_cell.lstrip("+-")) < min(len(cell.lstrip("+-")) for cell in cells_above)
    # such as `loa` below `loaded`
    is_beginning = any(
        cell.startswith(last_cell) and (is_number or has_fewer_characters)
        for cell in cells_above
        if cell != last_cell
    )
    # such as 22 below 836.13 and 63.6
    lacks_decimals = is_number and has_fewer_characters and last_decimal_count == 0 < min(decimal_counts)
    if has_fewer_decimals or is_beginning or lacks_decimals:
        reason = f"its last line has no line break, and {quote(last_cell)} is shorter than the cells above"
        remedy = "export or copy the file again; if the file is complete, end its last line with a line break"
        faults.report(place, f"the file is cut off: {reason}", remedy)
    # A number that is not shorter than all others may lack digits nevertheless: the user has to confirm it.
    is_complete = (
        last_cell in cells_above
        or 0 < last_decimal_count == max(decimal_counts)
        or last_decimal_count >= _MANY_DECIMALS
    )
    return (
        f"the last number {last_cell} ({place}), whose line has no line break"
        if is_number and not is_complete
        else None
    )


def _drop_deleted_rows(
    grid: Grid, rows: tuple[Row, ...], columns: Columns, faults: Faults, *, numbered: bool
) -> tuple[Row, ...]:
    """Return the rows that the column `deleted` does not mark as deleted; all rows if it is missing.

    If rows are `numbered` because they have no labels, a deleted row is a fault: the numbers of the rows
    behind it are not certain.
    """
    index = columns.texts.get("deleted")
    if index is None:
        return rows
    kept = []
    for row in rows:
        is_deleted = grammar.MARKS.get(fold_word(row.cells[index]))
        if is_deleted is None:
            reason = f"{quote(row.cells[index])} does not show whether the row is deleted"
            remedy = "use 0 or 1, or skip the column with `ignore`"
            faults.report(grid.place(row, index), reason, remedy)
        elif not is_deleted:
            kept.append(row)
    if not kept:
        faults.report(Place(grid.file), "all rows are marked as deleted", "export the rows that are needed")
    if numbered and len(kept) < len(rows):
        reason = "rows are marked as deleted, so the numbers of the other rows are uncertain"
        remedy = "give every row a label, or delete these rows from all files"
        faults.report(Place(grid.file), reason, remedy, "by_order")
    return tuple(kept)
