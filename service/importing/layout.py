"""A table whose columns are understood: its header, what titles and comments say of it, its rows of data."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from statistics import fmean, pstdev, stdev
from typing import Final, NamedTuple

from jointstiff.schemas.imports import (
    ColumnMeaning,
    DecimalMark,
    FilePreview,
    ImportOptions,
)
from jointstiff.service.importing import grammar
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, quote
from jointstiff.service.importing.grammar import Kind, Vocabulary, collapse_blanks, name_unit
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
from jointstiff.service.importing.merged_rows import fill_down
from jointstiff.service.importing.unit_remarks import find_unit_of_forces
from jointstiff.service.tables.labels import fold_word

_LEAST_ROWS, _MOST_ROWS = 4, 10_000
"""Rows of a table whose last rows may be statistics by their numbers alone."""
_LEAST_COLUMNS: Final = 3
"""Columns with different numbers that show that a row has statistics."""
_LEAST_HEADERS: Final = 3
"""Texts of a header that show that a row repeats it."""
_REMARK: Final = re.compile(r"(?=.*[^\W\d])(?:.*\S\s+\S|[^\W\d]\w*:)")
"""Text of a remark: two words at least, or a word with a colon."""
_FORMATS_OF_ARRAYS: Final = frozenset(("mat", "npz", "hdf5"))
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
    vocabulary.add_names_of_table(heading.texts)
    remarks = sorted([*grid.comments, *_read_titles_above(grid, heading)])
    stated = _read_remarks(grid.file, remarks)
    if not _have_length_unit(heading.texts, vocabulary, options):
        stated = stated._replace(axes_unit=stated.axes_unit or _find_length_unit(remarks))
    grid, notes_on_rows = _drop_rows_without_readings(grid, heading)
    heading, rows = _fit_rows_to_heading(grid, heading, faults)
    headers = ["" if heading.columns_are_assumed else text for text in heading.texts]
    if options.layouts:
        _check_template(options, headers, heading.place(), faults)
    column_reader = ColumnReader(heading, rows, vocabulary, options, faults)
    columns = column_reader.understand(
        stated.units,
        state_in_name=_has_state_in_name(grid, options),
        are_arrays=grid.preview.format in _FORMATS_OF_ARRAYS,
    )
    _check_units(grid.file, remarks, columns, faults)
    unsure_number = _check_end_of_file(grid, rows, faults)
    rows, note_on_cells = fill_down(rows, headers, columns.meanings)
    notes_on_rows += [note_on_cells] if note_on_cells else []
    notes = [*grid.preview.assumptions, *heading.notes, *notes_on_rows, *columns.notes]
    kept = _drop_deleted_rows(grid, rows, columns, faults, numbered=columns.are_rows_numbered)
    notes += _describe_rows_and_units(options, columns, stated, deleted_count=len(rows) - len(kept))
    numbers = _decide_number_format(grid, kept, columns, options, faults)
    notes += numbers.notes
    described = _describe_columns(headers, columns)
    return Layout(
        grid=grid,
        preview=grid.preview_table(list(heading.lines), kept, described, numbers.decimal_mark, notes),
        columns=columns,
        rows=kept,
        decimal_mark=numbers.decimal_mark,
        are_thousands_separated=numbers.are_thousands_separated,
        frame=stated.frame,
        unsure_number=unsure_number,
    )


def _have_length_unit(headers: Sequence[str], words: Vocabulary, options: ImportOptions) -> bool:
    """Return whether a header of a length, or the option `units`, states the unit of lengths."""
    if options.units is not None and options.units.length is not None:
        return True
    meanings = [words.find(header) for header in headers if header]
    return any(each is not None and each.dimension == "length" and each.unit for each in meanings)


def _has_state_in_name(grid: Grid, options: ImportOptions) -> bool:
    """Return whether the name of the file or of the sheet has a word for a state, such as `loaded`."""
    names = (grid.stem, grid.own_sheet)
    return any(grammar.contains_state_word(name, options.state_words) for name in names)


def _describe_rows_and_units(
    options: ImportOptions, columns: Columns, stated: _StatedFrame, deleted_count: int
) -> list[str]:
    """Return notes on how rows and positions were read: numbers of rows, omitted rows, frame and units.

    Args:
        options: options of the import.
        columns: columns of the table.
        stated: what titles and comments of the file state about positions and forces.
        deleted_count: number of rows that a column marks as deleted.
    """
    notes = []
    if columns.are_rows_numbered:
        reason = "as `by_order` requires" if options.by_order else "as no array names them"
        notes.append(f"rows were numbered, the first as observation 1, {reason}")
    if deleted_count:
        notes.append(f"rows marked as deleted were omitted: {deleted_count}")
    if stated.frame is not None:
        notes.append(f"positions are in the frame {quote(stated.frame)}, as the file states")
    if stated.axes_unit is not None:
        notes.append(f"positions are in {name_unit(stated.axes_unit)}, as the file states")
    has_forces = any(quantity.kind == "force" for quantity in columns.quantities)
    if stated.force_unit is not None and has_forces:
        notes.append(f"forces are in {stated.force_unit}, as the file states")
    if columns.units.get("length") == "in":
        notes.append("lengths in inches, also those in the options, were converted to mm")
    if columns.units.get("force") == "daN":
        notes.append("forces in daN were converted to N")
    return notes


class _NumberFormat(NamedTuple):
    """Notation of the numbers of a table."""

    decimal_mark: DecimalMark | None  # None if it is not clear, which was reported as a fault
    are_thousands_separated: bool  # whether texts may be numbers such as `1.299,99`
    notes: list[str]  # why this mark was chosen; empty if no other is possible


def _decide_number_format(
    grid: Grid, rows: Sequence[Row], columns: Columns, options: ImportOptions, faults: Faults
) -> _NumberFormat:
    """Return how the numbers of a table's rows are written; report a decimal mark that is not clear."""
    indices = [index for indices in columns.quantities.values() for index in indices]
    are_thousands_separated = grid.preview.format != "text" or has_separated_thousands(rows, indices)
    with faults.collect():
        mark, note = decide_decimal_mark(
            grid, rows, indices, options.decimal_mark, are_thousands_separated=are_thousands_separated
        )
        return _NumberFormat(mark, are_thousands_separated, [note] if note else [])
    # `collect` has kept an error that ended the block.
    return _NumberFormat(None, are_thousands_separated, [])


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

_AXES: Final = re.compile(
    r"(?:AXES\s*=\s*|\bCOORDINATES?\s+(?:SYSTEM|TYPE)\s*[=:]\s*"
    r"(?=(?:CARTESIAN|RECTANGULAR|CYLINDRICAL|SPHERICAL|POLAR)\b))(\w+)",
    re.IGNORECASE,
)
"""Kind of the coordinates; a coordinate system with another name is a frame."""
_AXES_UNIT: Final = re.compile(
    r"\bX\W+Y\W+Z\s*(?:\(\s*([^\W\d]+)\s*\)|in\s+([^\W\d]+))"
    r"|\bX\s*\(\s*([^\W\d]+)\s*\)\W+Y\s*\(\s*\3\s*\)\W+Z\s*\(\s*\3\s*\)",
    re.IGNORECASE,
)
"""The unit behind the names of the axes, in one of three groups, or behind each of them."""
_FRAME: Final = re.compile(
    r"(?:\b(?:FRAME|(?:COORDINATE|REFERENCE)\s+SYSTEM|(?:KOORDINATEN|BEZUGS)SYSTEM|REP[ÈE]RE|R[ÉE]F[ÉE]RENTIEL)\s*[=:]"
    r"|\b(?:COORDINATE|WORKING|REFERENCE|ACTIVE)\s+FRAME\b)\s*[=:]*\s*(\S+(?:[ \t]\S+)*)",
    re.IGNORECASE,
)
"""The name of a frame ends at a gap of blanks, as behind it another statement may follow."""
_UNITS: Final = re.compile(
    r"(?:UNITÉ|UNIT|EINHEIT)(?:S|EN)?\b(?P<equals>[^=:]{0,30}[=:]+)?\s*(?P<units>\S.*)", re.IGNORECASE
)
_UNITS_OF_FILE: Final = re.compile(
    r"(?:^|[\t;,|]|\s\s)\s?(?:UNITÉ|UNIT|EINHEIT)(?:S|EN)?\s?[=:]", re.IGNORECASE
)
"""Begin of a statement on all units: not those of a quantity, such as `Deflection units:`."""
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


class _StatedFrame(NamedTuple):
    """Statements of titles and comments about positions and forces; None for what they do not state."""

    axes_unit: str | None  # unit of x, y and z
    force_unit: str | None  # unit of forces
    frame: str | None  # name of the frame

    @property
    def units(self) -> dict[Kind, str]:
        """Units of positions and forces, as far as they are stated."""
        units: dict[Kind, str | None] = {"position": self.axes_unit, "force": self.force_unit}
        return {kind: unit for kind, unit in units.items() if unit is not None}


def _read_remarks(file: str, remarks: Sequence[Remark]) -> _StatedFrame:
    """Return units of x, y, z and of forces, and the positions' frame, from a file's titles and comments.

    Examples are `AXES = CARTESIAN: X, Y, Z (mm)`, `… Coordinate Frame 'A::R0'` and `Frame: A`.

    Raises:
        ImportFileError: coordinates are not Cartesian, the unit is unknown, or two frames are named.
    """
    axes_unit = frame = None
    for remark in remarks:
        place = Place(file, remark.line)
        unit_of_remark = _read_axes_unit(remark.text, place)
        axes_unit = axes_unit or unit_of_remark
        name = _read_frame(remark.text)
        if name is not None and frame not in (None, name):
            reason = f"the frame of the positions is {quote(name)} here, but {quote(frame or '')} above"
            raise ImportFileError(place, reason, "export one frame per file")
        frame = frame if name is None else name
    return _StatedFrame(axes_unit, find_unit_of_forces(remarks), frame)


def _read_axes_unit(text: str, place: Place) -> str | None:
    """Return the unit of x, y and z in a remark such as `X, Y, Z (mm)`; None if it states no unit.

    Raises:
        ImportFileError: coordinates are not Cartesian, or the unit is unknown.
    """
    axes, match = _AXES.search(text), _AXES_UNIT.search(text)
    if axes and axes[1].upper() not in ("CARTESIAN", "RECTANGULAR", "X"):
        reason = f"the file has {quote(axes[1].lower())} coordinates"
        raise ImportFileError(place, reason, "export Cartesian coordinates x, y, z")
    word = match[int(match.lastindex or 0)] if match else ""
    known = grammar.find_known_unit(word) or grammar.find_known_unit(word.casefold())
    if known is not None and known[0] == "length":
        return known[1]
    is_in_sentence = not axes and not grammar.find_any_unit(word)  # such as `X, Y, Z in meters above`
    if word and not is_in_sentence:
        raise ImportFileError(
            place, f"the unit {quote(word)} of x, y, z is not known", "export in mm, m or inches"
        )
    return None


def _find_length_unit(remarks: Sequence[Remark]) -> str | None:
    """Return the only unit of length of remarks on all units, such as `Units: mm, deg`; None without one."""
    units = set[str]()
    for remark in remarks:
        of_file = _UNITS_OF_FILE.search(remark.text)
        words = [] if of_file is None else _list_stated_units(remark.text[of_file.start() :]).units
        known = map(grammar.find_known_unit, words)
        units |= {each[1] for each in known if each is not None and each[0] == "length"}
    return units.pop() if len(units) == 1 else None


def _read_frame(text: str) -> str | None:
    """Return the name of the frame in a remark such as `Frame: 'A'`; None if it names no frame."""
    match = None if _AXES.search(text) else _FRAME.search(text)
    return None if match is None else collapse_blanks(match[1].rstrip(", \t")).strip("'\"")


def _check_units(file: str, remarks: Sequence[Remark], columns: Columns, faults: Faults) -> None:
    """Report a fault if a title or comment, such as `Units: inches`, names another unit than the columns."""
    for remark in remarks:
        place = Place(file, remark.line)
        listed = _list_units(remark.text)
        if listed.unknown is not None:
            faults.report(
                place, f"the unit {quote(listed.unknown)} is not known", "correct or remove the remark"
            )
        for word in listed.units:
            dimension, unit = grammar.find_any_unit(word) or (None, "")
            column_unit = columns.units.get(dimension) if dimension else None
            if column_unit and unit != column_unit:
                reason = f"{quote(word)} is given here, but {dimension}s are in {name_unit(column_unit)}"
                remedy = "correct the unit, or remove the remark"
                faults.report(place, reason, remedy, f"units.{dimension}")


class _ListedUnits(NamedTuple):
    """Units that a title or comment names."""

    units: list[str]  # words that may be units
    unknown: str | None = None  # word that is in the place of a unit, but is none


def _list_units(text: str) -> _ListedUnits:
    """Return the units in a title or comment such as `Units: mm, deg` or `lengths in inches`."""
    stated = _list_stated_units(text)
    in_brackets = ["".join(groups) for groups in _UNIT.findall(text)]
    return _ListedUnits([*stated.units, *in_brackets], stated.unknown)


def _list_stated_units(text: str) -> _ListedUnits:
    """Return the units behind the word `units` in a title or comment, such as `Units: mm, deg`."""
    match = _UNITS.search(text)
    if match is None:
        return _ListedUnits([])
    words = re.findall(r"[^\s,;:()\[\]]+", match["units"])
    # The word `in` means inches only if it is alone; in a sentence it is a preposition.
    units = [word for word in words if grammar.find_any_unit(word) and (word != "in" or len(words) == 1)]
    is_sentence = not match["equals"] and len(units) < len(words)
    if is_sentence:
        return _ListedUnits([])
    is_unknown = len(words) == 1 and not units and words[0].isalpha()
    return _ListedUnits(units, words[0] if is_unknown else None)


# ---- the rows of data


def _fit_rows_to_heading(grid: Grid, heading: Heading, faults: Faults) -> tuple[Heading, tuple[Row, ...]]:
    """Return the heading, and the rows of data that have as many cells as the heading has columns.

    Columns at the end are left out if their headers and all of their cells are empty. Rows of another length
    are reported as faults.
    """
    heading, rows = _drop_empty_columns(grid, heading)
    fitted = []
    for row in rows:
        if len(row.cells) == len(heading.texts):
            fitted.append(row)
        else:
            _report_row_length(grid, heading, row, faults)
    return heading, tuple(fitted)


def _report_row_length(grid: Grid, heading: Heading, row: Row, faults: Faults) -> None:
    """Report a row that has more or fewer cells than the heading has columns."""
    count, width = len(row.cells), len(heading.texts)
    line = heading.lines[-1] if heading.lines else grid.rows[0].line
    header_has = f"line {line} has" if heading.lines or heading.columns_are_assumed else "the header"
    others_fit = all(len(each.cells) == width for each in grid.rows[heading.start : -1])
    is_last = row is grid.rows[-1] and not grid.has_final_line_break
    if is_last and count < width and others_fit:
        words = f"the row has {count} cells, but {header_has} {width}"
        reason = f"the file ends in the middle of line {row.line}: {words}"
        remedy = "export or copy the file again, or remove this line"
        faults.report(grid.place(row, count - 1), reason, remedy)
        return
    delimiter_words = f" (delimiter: {grid.preview.delimiter})" if grid.preview.delimiter else ""
    reason = f"the row has {count} cells, but {header_has} {width}{delimiter_words}"
    remedy = (
        "give every row the same number of cells; check for a missing or doubled delimiter, a decimal "
        "comma in a comma-separated file, or a blank in a name without quotation marks"
    )
    faults.report(grid.place(row, min(count, width)), reason, remedy)


def _drop_empty_columns(grid: Grid, heading: Heading) -> tuple[Heading, tuple[Row, ...]]:
    """Return the heading and the rows of data, without the columns at the end that are empty in all of them.

    Nothing is left out if the rows have different lengths.
    """
    rows, texts = grid.rows[heading.start :], heading.texts
    lengths = {len(row.cells) for row in rows}
    if len(lengths) != 1:
        return heading, rows
    row_length = lengths.pop()
    filled = [_count_filled(texts), *(_count_filled(row.cells) for row in rows)]
    width = max(1, *filled)
    if width > min(row_length, len(texts)):
        return heading, rows
    notes = heading.notes
    if row_length > width and grid.preview.format == "text":
        notes = (*notes, "every row ends with a delimiter; the empty last column was ignored")
    return replace(heading, texts=texts[:width], notes=notes), tuple(_cut_row(row, width) for row in rows)


def _count_filled(cells: Sequence[str]) -> int:
    """Return the number of cells up to the last that is not empty."""
    return max((place for place, cell in enumerate(cells, 1) if cell), default=0)


def _drop_rows_without_readings(grid: Grid, heading: Heading) -> tuple[Grid, list[str]]:
    """Return the table without its rows of statistics and of remarks below the header, and notes on them.

    A row of statistics begins with a word such as `mean`, or has the means of the rows above it; a row of a
    remark has only one text, of several words. A row that may be an observation is kept.
    """
    _refuse_second_header(grid, heading)
    omitted: dict[str, list[str]] = {"statistics": [], "remarks": []}  # kind of rows → text of each
    kept = list(grid.rows[: heading.start])
    means = _find_rows_of_means(grid.rows[heading.start :])
    extremes = cache(lambda: _find_extremes(grid, heading))  # found once, when a row needs them
    for row in grid.rows[heading.start :]:
        filled = [cell for cell in row.cells if cell]
        if row.line in means:
            omitted["statistics"].append(row.cells[0])
        elif filled and _is_named_statistic(row, filled[0], extremes):
            omitted["statistics"].append(filled[0])
        elif len(filled) == 1 and len(heading.texts) > 2 and _is_remark(grid, row, filled[0], heading):
            omitted["remarks"].append(filled[0])
        else:
            kept.append(row)
    notes = [
        f"rows of {kind} were omitted: {len(texts)}, the first {quote(texts[0])}"
        for kind, texts in omitted.items()
        if texts
    ]
    if not notes or len(kept) == heading.start:
        return grid, []
    return replace(grid, rows=tuple(kept)), notes


def _refuse_second_header(grid: Grid, heading: Heading) -> None:
    """Refuse a table in which the header occurs again, as if two files had been joined.

    Raises:
        ImportFileError: a row below the header has the texts of the header.
    """
    headers = sorted(filter(None, heading.texts))
    if len(headers) < _LEAST_HEADERS or heading.is_guess:
        return
    for row in grid.rows[heading.start :]:
        if sorted(filter(None, row.cells)) != headers:
            continue
        remedy = "save the rows from this line on as a second table, and import each table by itself"
        if row.cells[: len(heading.texts)] == heading.texts[: len(row.cells)]:
            remedy = f"delete this line, or {remedy}"
        reason = "the header occurs again: two tables seem to be joined in one file"
        raise ImportFileError(grid.place(row), reason, remedy)


def _is_named_statistic(
    row: Row, first_text: str, find_extremes: Callable[[], list[_Extremes | None]]
) -> bool:
    """Return whether a row begins with the name of a statistic, such as `mean`.

    A row that begins with a name such as `max`, which may also be the label of an observation, must have the
    greatest or least number of each column.

    Args:
        row: row of the table.
        first_text: its first text.
        find_extremes: function that finds the extremes of each column, if they are needed.
    """
    if not grammar.is_statistic(first_text) or looks_like_a_number(first_text):
        return False
    return not grammar.is_extreme(first_text) or _has_extremes(row, find_extremes())


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
        if _end_with_statistics(numbers, count):
            return {row.line for row in rows[-count:]}
    return set()


def _end_with_statistics(columns: Sequence[Sequence[str]], count: int) -> bool:
    """Return whether each of the last `count` rows has a statistic of the rows above it, in every column.

    The statistic is the mean or one of both standard deviations. Columns whose numbers are equal show nothing
    and are not compared; the others must be three at least. `columns` are texts of numbers.
    """
    varying = [column for column in columns if len(set(map(float, column[:-count]))) > 1]
    if len(varying) < _LEAST_COLUMNS:
        return False
    above = [[float(text) for text in column[:-count]] for column in varying]
    statistics = [[compute(numbers) for numbers in above] for compute in (fmean, stdev, pstdev)]
    for place in range(-count, 0):
        texts = [column[place] for column in varying]
        if not any(_are_equal(texts, values) for values in statistics):
            return False
    return True


class _Extremes(NamedTuple):
    """Least and greatest number of a column."""

    least: float
    greatest: float


def _find_extremes(grid: Grid, heading: Heading) -> list[_Extremes | None]:
    """Return the least and the greatest number of each column; None for a column that has other cells.

    Rows of statistics, and rows with a single text, do not count.
    """
    rows = [
        row.cells
        for row in grid.rows[heading.start :]
        if sum(map(bool, row.cells)) > 1 and not grammar.is_statistic(row.cells[0])
    ]
    width = min(map(len, rows), default=0)
    extremes = list[_Extremes | None]()
    for k in range(width):
        texts = [cells[k].replace(",", ".") for cells in rows]
        are_numbers = all(map(is_plain_number, texts))
        numbers = [float(text) for text in texts] if are_numbers else []
        extremes.append(_Extremes(min(numbers), max(numbers)) if numbers else None)
    return extremes


def _has_extremes(row: Row, extremes: Sequence[_Extremes | None]) -> bool:
    """Return whether each number of a row is the least, or each is the greatest, of its column's numbers."""
    texts, known = list[str](), list[_Extremes]()
    for cell, column in zip(row.cells, extremes, strict=False):
        text = cell.replace(",", ".")
        if column is not None and is_plain_number(text):
            texts.append(text)
            known.append(column)
    has_least = _are_equal(texts, [column.least for column in known])
    has_greatest = _are_equal(texts, [column.greatest for column in known])
    return bool(texts) and (has_least or has_greatest)


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
    end = _EndOfFile(rows)
    place = grid.place(rows[-1], len(rows[-1].cells) - 1)
    if end.has_fewer_decimals or end.is_beginning or end.lacks_decimals:
        reason = f"its last line has no line break, and {quote(end.last)} is shorter than the cells above"
        remedy = "export or copy the file again; if the file is complete, end its last line with a line break"
        faults.report(place, f"the file is cut off: {reason}", remedy)
    # A number that is not shorter than all others may lack digits nevertheless: the user has to confirm it.
    if not end.is_number or end.is_complete:
        return None
    return f"the last number {end.last} ({place}), whose line has no line break"


class _EndOfFile:
    """Last cell of a table, compared with the cells above it in the last column."""

    def __init__(self, rows: Sequence[Row]) -> None:
        """Compare the last cells of two or more rows of data."""
        *self.above, self.last = (row.cells[-1] for row in rows)
        self.is_number = looks_like_a_number(self.last)
        self._decimals_above = [len(_get_decimals(cell)) for cell in self.above]  # counts
        self._decimals = len(_get_decimals(self.last))
        all_decimals = [_get_decimals(cell) for row in rows for cell in row.cells]
        self._writes_trailing_zeros = any(each.endswith("0") and len(each) > 1 for each in all_decimals)
        self._is_shorter = len(self.last.lstrip("+-")) < min(len(cell.lstrip("+-")) for cell in self.above)

    @property
    def has_fewer_decimals(self) -> bool:
        """Return whether the last cell is a number with fewer decimals than all others.

        In a file without trailing zeros, a number may have one decimal fewer than the others.
        """
        usual = min(self._decimals_above)
        least = usual if self._writes_trailing_zeros else usual - 1
        return self.is_number and self._decimals < least

    @property
    def is_beginning(self) -> bool:
        """Return whether a cell above begins with the last cell, such as `loaded` with `loa`, and goes on."""
        others = [cell for cell in self.above if cell != self.last]
        may_be_cut_off = self.is_number or self._is_shorter
        return may_be_cut_off and any(cell.startswith(self.last) for cell in others)

    @property
    def lacks_decimals(self) -> bool:
        """Return whether the last cell is short and without decimals, such as 22 below 836.13 and 63.6."""
        have_decimals = min(self._decimals_above) > 0
        return self.is_number and self._is_shorter and have_decimals and self._decimals == 0

    @property
    def is_complete(self) -> bool:
        """Return whether the last number is whole: it occurs above, or has as many decimals as any other."""
        has_usual_decimals = 0 < self._decimals == max(self._decimals_above)
        return self.last in self.above or has_usual_decimals or self._decimals >= _MANY_DECIMALS


def _get_decimals(cell: str) -> str:
    """Return the digits behind the decimal mark of a number, a point or comma; empty without a mark."""
    return cell.replace(",", ".").partition(".")[2]


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
    kept = tuple(row for row in rows if not _is_deleted(grid, row, index, faults))
    if not kept:
        faults.report(Place(grid.file), "all rows are marked as deleted", "export the rows that are needed")
    if numbered and len(kept) < len(rows):
        reason = "rows are marked as deleted, so the numbers of the other rows are uncertain"
        remedy = "give every row a label, or delete these rows from all files"
        faults.report(Place(grid.file), reason, remedy, "by_order")
    return kept


def _is_deleted(grid: Grid, row: Row, index: int, faults: Faults) -> bool:
    """Return whether a row is marked as deleted in the column `index`, or has an unknown mark, a fault."""
    is_deleted = grammar.MARKS.get(fold_word(row.cells[index]))
    if is_deleted is None:
        reason = f"{quote(row.cells[index])} does not show whether the row is deleted"
        remedy = "use 0 or 1, or skip the column with `ignore`"
        faults.report(grid.place(row, index), reason, remedy)
        return True
    return is_deleted
