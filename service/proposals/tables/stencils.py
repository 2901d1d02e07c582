"""Stencils of files that are no tables: rows with the same words and as many numbers, read as tables.

Whatever the file, its numbers stand in places that repeat. Rows that follow each other in one shape are a
run, which is a table. Rows that recur with others between them are the parts of a record, such as a block of
lines, a sheet or an object for each posture. The robot then decides what the tables mean.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, NamedTuple

from pydantic_core import from_json

from jointstiff.schemas.imports import FilePreview, ImportOptions
from jointstiff.service.importing import grid, limits
from jointstiff.service.importing.errors import ImportFileError, quote
from jointstiff.service.importing.formats.elements import list_leaves, read_elements
from jointstiff.service.importing.grammar import find_any_unit, is_statistic, split_unit
from jointstiff.service.importing.grid import (
    COORDINATES,
    LEAST_NUMBERS,
    CellKind,
    Grid,
    Remark,
    Row,
    file_type,
    looks_like_a_number,
)
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.importing.source_grids import read_grids, read_sheets
from jointstiff.service.importing.texts.encoding import decode
from jointstiff.service.importing.texts.time_stamps import split_time_stamp

LEAST_POSTURES: Final = 8
"""Rows of a stencil, at least: fewer postures may fit by chance."""
_LEAST_PART: Final = 0.7
"""Least part of the records that have a number."""
_MOST_HEADER_ROWS: Final = 3
_MOST_DEPTH: Final = 12
_MOST_CHARACTERS: Final = 2000
"""Characters of a line that are read."""
_MOST_LISTED: Final = 4
_MOST_LABEL: Final = 40
"""Characters of a label, or of the description of a table."""
_LABEL: Final = "label"
_MARKS: Final = ":;,-/\\<>#*"
_DIGITS: Final = re.compile(r"\d+")
_POINT: Final = re.compile(r"(?<![\d.,])\d{1,20}\.\d{1,20}(?![\d.])")
_COMMA: Final = re.compile(r"(?<![\d.,])\d{1,20},\d{1,20}(?![\d,])")
_TOKEN: Final = re.compile(
    r"(?<![\w.,])(?P<number>[-+\u2212]?(?:\d{1,20}(?:[.,]\d{1,20})?|[.,]\d{1,20})(?:[eE][-+]?\d{1,3})?)"
    r"(?:[ ]?(?P<unit>°|º|mm|deg|rad|kg|kN|daN|N|m)(?!\w)|(?![\w°º]|[.:/,-]\d))"
    r"|(?P<word>[^\s;,=()\[\]{}|<>\"']{1,256})"
)
_LINE_END: Final = re.compile(r"\r\n|\n|\r")


class _Cell(NamedTuple):
    """Number or word of a row."""

    text: str
    column: int  # of the sheet, or place in the line
    is_number: bool = False
    unit: str = ""  # behind the number
    is_value: bool = False  # whether it is a text of a document, and no word of its keys
    is_time: bool = False  # whether it is of a time stamp at the start of a line, and no word


@dataclass(frozen=True)
class _Line:
    """A line of a text, a row of a sheet, or a leaf of a document."""

    section: str  # name of the sheet; empty without sheets
    line: int
    cells: tuple[_Cell, ...]
    text: str  # as it is written

    @property
    def numbers(self) -> list[_Cell]:
        """Cells with numbers."""
        return [cell for cell in self.cells if cell.is_number]

    @property
    def words(self) -> list[str]:
        """Texts of the other cells."""
        return [cell.text for cell in self.cells if not cell.is_number]

    @property
    def values(self) -> list[_Cell]:
        """Cells that a record has: numbers, and texts of a document."""
        return [cell for cell in self.cells if cell.is_number or cell.is_value]

    @property
    def context(self) -> tuple[str, ...]:
        """Words that lines below have in common with a line without numbers; a time is none."""
        return tuple(cell.text for cell in self.cells if not cell.is_number and not cell.is_time)

    def list_words_before(self, cell: _Cell) -> list[str]:
        """Return the words between a cell and the number, or the time stamp, before it."""
        words = list[str]()
        for other in self.cells:
            if other.column >= cell.column:
                break
            words = [] if other.is_number or other.is_time else [*words, other.text]
        return words


_Place = tuple[tuple[object, ...], int, int]
"""Place in a record: stencil, occurrence of the stencil, and index of the cell."""


def read_stencils(
    file: SourceFile, options: ImportOptions, *, are_turned: bool = False, may_lack_lines: bool = False
) -> list[Grid]:
    """Return the tables of a file whose rows have repeated places; the ordinary tables without such places.

    With `are_turned`, the columns of a table with names before its numbers are the postures. With
    `may_lack_lines`, or if readings may be missing, a posture may lack lines that the others have.

    Raises:
        ImportFileError: the file cannot be read.
    """
    kind = file_type(file.content, file.name)
    if kind in grid.WORKBOOKS:
        lines = list(_list_rows(file, options))
    elif kind == grid.JSON:
        lines = list(_list_leaves(file))
    elif kind is None or kind == grid.XML:
        lines = _list_elements(file) or list(_list_lines(file))
    else:
        return read_grids(file, options, every_length=True)
    is_sheet = kind in grid.WORKBOOKS
    allow_missing = options.allow_missing or may_lack_lines
    found = _Stencils(file.name, lines, is_sheet=is_sheet, allow_missing=allow_missing)
    return found.build_grids(are_turned=are_turned) or read_grids(file, options, every_length=True)


# ---- lines of all kinds of files


def _list_rows(file: SourceFile, options: ImportOptions) -> Iterator[_Line]:
    """Yield the rows of all sheets of a workbook.

    Raises:
        ImportFileError: the workbook cannot be read.
    """
    for sheet in read_sheets(file, options.sheet):
        for row in sheet.rows:
            kinds = row.kinds or ("text",) * len(row.cells)
            cells = tuple(
                _Cell(cell, column, looks_like_a_number(cell) and kinds[column] != "date")
                for column, cell in enumerate(row.cells)
                if cell
            )
            yield _Line(sheet.preview.sheet or "", row.line, cells, " ".join(filter(None, row.cells)))


def _list_leaves(file: SourceFile) -> Iterator[_Line]:
    """Yield the lists of numbers, and the single values, of a document of JSON, with their keys as words.

    Raises:
        ImportFileError: the file is not plain text.
    """
    text, _ = decode(file.name, file.content)
    try:
        document = from_json(text)
    except ValueError:
        return
    leaves = list(_walk(document, (), 0))
    common = _count_common_keys([path for path, values in leaves if len(values) == COORDINATES])
    for number, (path, values) in enumerate(leaves, 1):
        path = path[common:] if len(values) == COORDINATES else path
        cells = [_Cell(word[: limits.MAX_CELL_LENGTH], column) for column, word in enumerate(path)]
        for column, value in enumerate(values, len(cells)):
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            shown = repr(value) if is_number else str(value)[: limits.MAX_CELL_LENGTH]
            cells.append(_Cell(shown, column, is_number, is_value=not is_number))
        yield _Line("", number, tuple(cells), " ".join(cell.text for cell in cells))


def _count_common_keys(paths: Sequence[tuple[str, ...]]) -> int:
    """Return how many first keys all paths have alike, without the last key of any path."""
    most = min(map(len, paths), default=1) - 1
    return next((count for count in range(most) if len({path[count] for path in paths}) > 1), max(most, 0))


def _walk(value: Any, path: tuple[str, ...], depth: int) -> Iterator[tuple[tuple[str, ...], list[Any]]]:  # noqa: ANN401 - any document
    """Yield the keys and the values of each leaf of a document: a list of numbers, or a single value."""
    if depth > _MOST_DEPTH:
        return
    if isinstance(value, dict):
        for key, each in value.items():
            yield from _walk(each, (*path, str(key)), depth + 1)
    elif isinstance(value, list) and not any(isinstance(each, dict | list) for each in value):
        yield path, value
    elif isinstance(value, list):
        for each in value:
            yield from _walk(each, path, depth + 1)
    else:
        yield path, [value]


def _list_elements(file: SourceFile) -> list[_Line]:
    """Return the leaves of a document of XML with points, with their names as words.

    None of another file, or of a document with more numbers in an element than a table has columns.
    """
    try:
        leaves = list_leaves(read_elements(file.name, file.content))
    except ImportFileError:
        return []
    longest = max((len(leaf.values) for leaf in leaves), default=0)
    if longest > limits.MAX_COLUMNS or not any(leaf.is_point for leaf in leaves):
        return []
    lines = []
    for leaf in leaves:
        words = [*leaf.tags, *leaf.names]
        cells = [_Cell(word, column) for column, word in enumerate(words)]
        for column, value in enumerate(leaf.values, len(cells)):
            cells.append(_Cell(value, column, leaf.are_numbers, is_value=not leaf.are_numbers))
        lines.append(_Line("", leaf.line, tuple(cells), " ".join(cell.text for cell in cells)))
    return lines


def _list_lines(file: SourceFile) -> Iterator[_Line]:
    """Yield the lines of a text as numbers and words.

    Raises:
        ImportFileError: the file is not plain text.
    """
    text, _ = decode(file.name, file.content)
    has_points = len(_POINT.findall(text)) >= len(_COMMA.findall(text))
    for number, line in enumerate(_LINE_END.split(text), 1):
        stamp, shown = split_time_stamp(line[:_MOST_CHARACTERS])
        shown = shown.replace(",", " , ") if has_points else shown
        times = [_Cell(text, column, is_time=True) for column, text in enumerate(stamp.split())]
        cells = [
            _Cell(
                (match["number"] or match["word"]).replace("\u2212", "-"),
                column,
                match["number"] is not None,
                match["unit"] or "",
            )
            for column, match in enumerate(_TOKEN.finditer(shown), len(times))
        ]
        if times or cells:
            yield _Line("", number, (*times, *cells), line[:_MOST_CHARACTERS].strip())


# ---- runs and records


class _Stencils:
    """Lines of a file by their stencils."""

    def __init__(self, file: str, lines: Sequence[_Line], *, is_sheet: bool, allow_missing: bool) -> None:
        self._file, self._lines, self._is_sheet = file, lines, is_sheet
        self._allow_missing = allow_missing  # whether a record may lack a line
        self._literals = _list_literals(lines)
        self._read: set[int] = set()  # indices of the lines that are read

    def build_grids(self, *, are_turned: bool) -> list[Grid]:
        """Return the tables of runs and records; none next to a damaged row of a run."""
        least = COORDINATES * 2 if are_turned else LEAST_POSTURES
        runs = [run for run in self._list_runs() if len(run) >= least]
        recurring = Counter(self._find_shape(self._lines[run.start]) for run in runs)
        runs = [run for run in runs if recurring[self._find_shape(self._lines[run.start])] < LEAST_POSTURES]
        if any(map(self._is_beside_damaged_row, runs)):
            return []
        tables = []
        for run in runs:
            table = self._turn(run) if are_turned else self._read_run(run)
            if table is not None:
                tables.append(table)
                self._read.update(run)
        records = None if are_turned else self._read_records(set().union(*runs) if runs else set())
        tables += [] if records is None else [records]
        return self._finish(tables)

    def _is_beside_damaged_row(self, run: range) -> bool:
        """Return whether a line next to a run is like its rows, but lacks numbers or has more of them."""
        usual = len(self._lines[run.start].numbers)
        neighbours = [self._lines[k] for k in (run.start - 1, run.stop) if 0 <= k < len(self._lines)]
        return any(
            line.section == self._lines[run.start].section
            and len(line.numbers) >= max(LEAST_NUMBERS, usual // 2 + 1)
            and not is_statistic(line.cells[0].text)
            for line in neighbours
        )

    def _find_shape(self, line: _Line) -> tuple[object, ...]:
        """Return the columns of the numbers of a line, and its count of cells unless it is of a sheet."""
        columns = tuple(cell.column for cell in line.numbers)
        return columns if self._is_sheet else (len(line.cells), *columns)

    def _list_runs(self) -> Iterator[range]:
        """Yield the indices of lines that follow each other in one shape, as rows of a table do."""
        start = 0
        for number in range(1, len(self._lines) + 1):
            if number == len(self._lines) or not self._continues(self._lines[start], self._lines[number]):
                if len(self._lines[start].numbers) >= LEAST_NUMBERS:
                    yield range(start, number)
                start = number

    def _continues(self, first: _Line, line: _Line) -> bool:
        """Return whether a line has most numbers of the first one, and no others."""
        own = {cell.column for cell in line.numbers}
        columns = {cell.column for cell in first.numbers}
        is_alike = self._is_sheet or len(first.cells) == len(line.cells)
        return is_alike and line.section == first.section and own <= columns and 2 * len(own) > len(columns)

    def _read_run(self, run: range) -> _Table:
        """Return the table of a run: the words that differ and the numbers, below their words."""
        lines = [self._lines[number] for number in run]
        title, headers = self._find_headers(run)
        columns = sorted({cell.column for line in lines for cell in line.cells})
        cells = [{cell.column: cell for cell in line.cells} for line in lines]
        numbers = {cell.column for line in lines[:1] for cell in line.numbers}
        own, words, kept = dict[int, str](), list[str](), list[int]()
        for column in columns:
            texts = {text for row in cells for text in _list_texts(row, [column])}
            if column not in numbers and len(texts) == 1:
                words.append(texts.pop())
                continue
            own[column] = _strip_marks(words)
            words = []
            kept.append(column)
        units = {cell.column: cell.unit for cell in lines[0].cells}
        named = [_add_unit(headers.get(column) or own[column], units.get(column, "")) for column in kept]
        rows = [(line.line, _list_texts(row, kept)) for line, row in zip(lines, cells, strict=True)]
        return _Table(title, _number_alike(named), rows)

    def _find_headers(self, run: range) -> tuple[str, dict[int, str]]:
        """Return the title above a run, and column → words of the lines without numbers above it."""
        first = self._lines[run.start]
        columns = [cell.column for cell in first.cells]
        headers: dict[int, str] = {}
        title = ""
        has_group_of_all = False
        for number in range(run.start - 1, max(run.start - 2 - _MOST_HEADER_ROWS, -1), -1):
            line = self._lines[number]
            if line.section != first.section or line.numbers:
                break
            is_apart = self._is_sheet and bool(headers) and line.line < self._lines[number + 1].line - 1
            is_of_all = self._is_sheet and bool(headers) and _is_group_of_all(line, columns)
            if len(line.cells) > 1 and (is_apart or (is_of_all and has_group_of_all)):
                break
            if self._is_sheet and len(line.cells) > 1:
                headers = _add_group(headers, line, columns)
                has_group_of_all = has_group_of_all or is_of_all
            elif len(line.cells) == len(columns) and not headers and not self._is_sheet:
                headers = dict(zip(columns, line.words, strict=True))
            else:
                title = title or line.text
                if self._is_sheet or headers:
                    break
        names = [first.section, title] if title or not first.section else [first.section]
        return " ".join(filter(None, names)), headers

    def _turn(self, run: range) -> _Table | None:
        """Return the table of a run whose columns are postures; None of short rows or rows without names."""
        lines = [self._lines[number] for number in run]
        columns = [cell.column for cell in lines[0].numbers]
        if len(columns) < LEAST_POSTURES or not all(line.words for line in lines):
            return None
        by_column = [{cell.column: cell.text for cell in line.cells} for line in lines]
        headers = []
        for line in lines:
            *names, last = [cell.text for cell in line.cells if cell.column < columns[0]] or line.words
            is_unit = bool(names) and find_any_unit(last.strip("[]()")) is not None
            headers.append(
                _add_unit(" ".join(names), last.strip("[]()")) if is_unit else " ".join((*names, last))
            )
        above = self._lines[run.start - 1] if run.start else None
        labels = {} if above is None else {cell.column: cell.text for cell in above.cells}
        names = [labels.get(column, "") for column in columns]
        are_names = all(names) and len(set(names)) == len(names)
        labels_of_rows = names if are_names else [str(number) for number in range(1, len(columns) + 1)]
        rows = []
        for label, column in zip(labels_of_rows, columns, strict=True):
            texts = [row.get(column, "") for row in by_column]
            rows.append((lines[0].line, [label, *texts]))
        return _Table(lines[0].section, [_LABEL, *_number_alike(headers)], rows)

    def _read_records(self, used: set[int]) -> _Table | None:
        """Return the table of records, of sheets or of lines that recur; None without records.

        None, too, if a record lacks a line that others have, unless readings may be missing.
        """
        rest = [number for number in range(len(self._lines)) if number not in used]
        records = self._split_into_records(rest)
        if len(records) < LEAST_POSTURES:
            return None
        placed = [self._place(record) for record in records]
        usual = _find_usual_repeats(placed)
        kept = [number for number, each in enumerate(placed) if not _has_other_repeats(each, usual)]
        values = [placed[number] for number in kept]
        counts = Counter(place for each in values for place in each)
        places = [place for place, count in counts.items() if count >= _LEAST_PART * len(kept)]
        places = [place for place in places if not self._is_idle(place, values)]
        moving = [place for place in places if _differs(place, values)]
        are_complete = len(kept) == len(placed) and all(place in each for each in values for place in places)
        if not are_complete and not self._allow_missing:
            return None
        is_possible = len(kept) >= LEAST_POSTURES and len(moving) >= 2 * COORDINATES
        if not is_possible or len(places) >= limits.MAX_COLUMNS:
            return None
        places = self._order(places, values)
        headers = _number_alike([self._name(place, values) for place in places])
        labels = self._label([self._lines[records[number][0]] for number in kept])
        rows = []
        for number, label, each in zip(kept, labels, values, strict=True):
            texts = [each[place].cell.text if place in each else "" for place in places]
            rows.append((self._lines[records[number][0]].line, [label, *texts]))
        for number, each in zip(kept, values, strict=True):
            self._read.update(each[place].number for place in places if place in each)
            self._read.update(records[number][:1])
        return _Table("", [_LABEL, *headers], rows, len(placed) - len(kept))

    def _is_idle(self, place: _Place, records: Sequence[dict[_Place, _Value]]) -> bool:
        """Return whether a place has one number without a word before it, such as the number of an axis."""
        cell, line, *_ = next(each[place] for each in records if place in each)
        return not line.list_words_before(cell) and not _differs(place, records)

    def _split_into_records(self, rest: Sequence[int]) -> list[list[int]]:
        """Return the lines of each record: a sheet, or those from one stencil to its next occurrence."""
        sections: dict[str, list[int]] = defaultdict(list)
        for number in rest:
            sections[self._lines[number].section].append(number)
        if len(sections) >= LEAST_POSTURES:
            return list(sections.values())
        stencils = {
            number: self._find_stencil(self._lines[number]) for number in rest if self._lines[number].values
        }
        counts = Counter(stencils.values())
        anchor = next((each for each in stencils.values() if counts[each] >= LEAST_POSTURES), None)
        starts = [k for k, number in enumerate(rest) if anchor is not None and stencils.get(number) == anchor]
        return [list(rest[start:end]) for start, end in pairwise([*starts, len(rest)])]

    def _find_stencil(self, line: _Line) -> tuple[object, ...]:
        """Return the words of a line without the digits that differ, and its places of numbers."""
        words = tuple(map(self._write_without_digits, line.cells))
        columns = tuple(cell.column for cell in line.numbers) if self._is_sheet else ()
        return (words, columns)

    def _write_without_digits(self, cell: _Cell) -> str:
        """Return the word of a cell without digits that tell postures apart; an empty text for a value."""
        if cell.is_number or cell.is_value or cell.is_time:
            return ""
        return cell.text if cell.text in self._literals else _DIGITS.sub("#", cell.text)

    def _place(self, record: Sequence[int]) -> dict[_Place, _Value]:
        """Return place → value of a record; in a text, a line without a number is the context of the next."""
        counts: Counter[tuple[object, ...]] = Counter()
        values = {}
        context: tuple[str, ...] = ()
        for number in record:
            line = self._lines[number]
            if not line.values:
                context = () if self._is_sheet else line.context
                continue
            stencil = (context, *self._find_stencil(line))
            for index, cell in enumerate(line.cells):
                if cell in line.values:
                    values[stencil, counts[stencil], index] = _Value(cell, line, number, context)
            counts[stencil] += 1
        return values

    def _order(self, places: Sequence[_Place], records: Sequence[dict[_Place, _Value]]) -> list[_Place]:
        """Return places with those of a vector next to each other, across a row or down a column."""
        if not self._is_sheet:
            return list(places)
        first = next((each for each in records if all(place in each for place in places)), records[0])
        by_row: dict[int, list[_Place]] = defaultdict(list)
        for place in places:
            if place in first:
                by_row[first[place].line.line].append(place)
        down, across = list[_Place](), list[_Place]()
        for row in by_row.values():
            for group in _split_at_gaps(row, first):
                (across if len(group) >= COORDINATES else down).extend(group)
        down.sort(key=lambda place: first[place].cell.column)
        return [*down, *across]

    def _name(self, place: _Place, records: Sequence[dict[_Place, _Value]]) -> str:
        """Return the words of a place: those before it in its line, and those above it in a sheet."""
        cell, line, number, context = next(each[place] for each in records if place in each)
        if self._is_sheet:
            before = line.list_words_before(_find_first_of_group(line, cell))
            return _join_words([*before, *self._find_above(number, cell.column, line.section)])
        values = line.values
        own = line.list_words_before(cell)
        title = line.list_words_before(values[0])
        if len(values) == 1:
            words = title
        elif all(line.list_words_before(each) for each in values):
            words = [*title[:-1], *(title[-1:] if cell == values[0] else own)]
        elif len(values) == COORDINATES:
            words = [*title, "xyz"[values.index(cell)]]
        else:
            words = [*title, str(values.index(cell) + 1)]
        words = [*context, *words]
        return _add_unit(_strip_marks(words), cell.unit)

    def _find_above(self, number: int, column: int, section: str) -> list[str]:
        """Return the nearest text above a cell of a sheet, with the group in the row above this text.

        Of a group whose row below has each text once, only the unit counts.
        """
        for row in range(number - 1, -1, -1):
            line = self._lines[row]
            if line.section != section:
                break
            text = next(
                (cell.text for cell in line.cells if cell.column == column and not cell.is_number), ""
            )
            if not text:
                continue
            above = self._lines[row - 1] if row else line
            is_next = above.section == section and above.line == line.line - 1 and not above.numbers
            left = [cell for cell in above.cells if cell.column <= column] if is_next else []
            if not left or left[-1].column == min(cell.column for cell in above.cells):
                return [text]
            group = left[-1].text
            unit = split_unit(group)[1]
            is_needed = line.words.count(text) > 1
            return [group, text] if is_needed else [_add_unit(text, unit or "")]
        return []

    def _label(self, lines: Sequence[_Line]) -> list[str]:
        """Return the names of records: their sheets, or their first lines with one number; else numbers."""
        labels = [_find_label(line) for line in lines]
        if len({line.section for line in lines}) == len(lines):
            labels = [line.section for line in lines]
        are_names = all(labels) and len(set(labels)) == len(labels)
        return labels if are_names else [str(number) for number in range(1, len(lines) + 1)]

    def _finish(self, tables: Sequence[_Table]) -> list[Grid]:
        """Return the tables as grids with notes on what was read; lines that were not are comments."""
        left = [line for number, line in enumerate(self._lines) if number not in self._read]
        comments = tuple(
            Remark(line.line, line.text) for line in left if line.section == self._lines[0].section
        )
        names = Counter(table.title for table in tables)
        grids = []
        for number, table in enumerate(tables, 1):
            title = table.title
            if not title or names[title] > 1:
                title = f"{title} table {number}".strip()
            notes = [f"{len(table.rows)} repeated rows of {quote(table.describe())} were read as a table"]
            if table.left:
                notes.append(f"records with other rows were left out: {table.left}")
            numbers_left = [line for line in left if line.numbers]
            if number == 1 and numbers_left:
                notes.append(f"lines with numbers that were not read: {_quote_first(numbers_left)}")
            preview = FilePreview(
                file=self._file,
                format="xlsx" if self._is_sheet else "text",
                sheet=title[:100] if len(tables) > 1 else None,
                assumptions=notes,
            )
            header = _write_row(table.rows[0][0], table.headers, is_sheet=self._is_sheet)
            rows = [_write_row(line, cells, is_sheet=self._is_sheet) for line, cells in table.rows]
            grids.append(
                Grid(
                    preview,
                    (header, *rows),
                    comments if number == 1 else (),
                    is_one_of_several=len(tables) > 1,
                )
            )
        return grids


def _quote_first(lines: Sequence[_Line]) -> str:
    """Return the first words of some lines, and how many more lines there are."""
    listed = ", ".join(quote(line.text[:_MOST_LABEL]) for line in lines[:_MOST_LISTED])
    others = len(lines) - _MOST_LISTED
    return f"{listed} and {others} more" if others > 0 else listed


class _Value(NamedTuple):
    """Number of a record, its line, and the index of the line."""

    cell: _Cell
    line: _Line
    number: int
    context: tuple[str, ...]  # words of the line without a number above it, in its record


@dataclass(frozen=True)
class _Table:
    """Rows of a run or of records."""

    title: str
    headers: Sequence[str]
    rows: Sequence[tuple[int, Sequence[str]]]
    left: int = 0  # records that are left out

    def describe(self) -> str:
        """Return the title, or the first words, of a table."""
        words = " ".join(filter(None, self.headers)).removeprefix(_LABEL)
        return self.title or words[:_MOST_LABEL] or self.rows[0][1][0]


def _find_label(line: _Line) -> str:
    """Return the name of a record by its first line: a short line with one value, or this value if a text."""
    text = line.values[0].text if line.values and line.values[0].is_value else split_time_stamp(line.text)[1]
    return text if len(line.values) == 1 and len(text) <= _MOST_LABEL else ""


def _list_texts(row: dict[int, _Cell], columns: Sequence[int]) -> list[str]:
    """Return the texts of a row in some columns; empty texts where the row has no cell."""
    return [row[column].text if column in row else "" for column in columns]


def _write_row(line: int, cells: Sequence[str], *, is_sheet: bool) -> Row:
    """Return a row of a table."""
    kinds: list[CellKind] = ["number" if looks_like_a_number(cell) else "text" for cell in cells]
    return Row(line, tuple(cells), tuple(kinds) if is_sheet else None)


def _find_first_of_group(line: _Line, cell: _Cell) -> _Cell:
    """Return the first of the numbers of a row of a sheet that are next to a number without a gap."""
    first = cell
    for other in reversed(line.numbers):
        first = other if other.column == first.column - 1 else first
    return first


def _list_literals(lines: Iterable[_Line]) -> set[str]:
    """Return the words whose digits tell places apart, such as `SMR1`, and not postures, such as `P01`.

    Each occurs in several postures, and more often than there are such words.
    """
    counts = Counter(word for line in lines for word in line.words)
    words_of_form: dict[str, list[str]] = defaultdict(list)
    for word in counts:
        words_of_form[_DIGITS.sub("#", word)].append(word)
    return {
        word
        for words in words_of_form.values()
        for word in words
        if counts[word] >= LEAST_POSTURES // 2 and counts[word] > len(words)
    }


def _find_usual_repeats(records: Sequence[dict[_Place, _Value]]) -> dict[tuple[object, ...], int]:
    """Return stencil → how often most records have it, of stencils that occur several times in a record."""
    counts: dict[tuple[object, ...], Counter[int]] = defaultdict(Counter)
    for record in records:
        for stencil, count in Counter(stencil for stencil, _ in {place[:2] for place in record}).items():
            counts[stencil][count] += 1
    return {stencil: each.most_common(1)[0][0] for stencil, each in counts.items() if max(each) > 1}


def _has_other_repeats(record: dict[_Place, _Value], usual: dict[tuple[object, ...], int]) -> bool:
    """Return whether a record has a stencil more or less often than most: which one lacks is not known."""
    own = Counter(stencil for stencil, _ in {place[:2] for place in record})
    return any(own[stencil] != count for stencil, count in usual.items())


def _differs(place: _Place, records: Sequence[dict[_Place, _Value]]) -> bool:
    """Return whether a place has different values."""
    return len({each[place].cell.text for each in records if place in each}) > 1


def _split_at_gaps(row: Sequence[_Place], first: dict[_Place, _Value]) -> Iterator[list[_Place]]:
    """Yield the places of a row of a sheet that are next to each other."""
    group: list[_Place] = []
    for place in row:
        if group and first[place].cell.column != first[group[-1]].cell.column + 1:
            yield group
            group = []
        group.append(place)
    yield group


def _is_group_of_all(line: _Line, columns: Sequence[int]) -> bool:
    """Return whether a row has one text that groups all columns, or all but the first, of a table."""
    starts = [cell.column for cell in line.cells if cell.column > columns[0]]
    return len(columns) > 1 and starts == [columns[1]]


def _add_group(headers: dict[int, str], line: _Line, columns: Sequence[int]) -> dict[int, str]:
    """Return headers with the texts of a row above: of its own column, or of the nearest one on the left."""
    own = {cell.column: cell.text for cell in line.cells}
    if not headers:
        return own
    first = min(own)
    group, grouped = "", {}
    for column in sorted({*columns, *own}):
        group = own.get(column, group if column > first else "")
        grouped[column] = _join_words([group, headers.get(column, "")])
    return grouped


def _strip_marks(words: Iterable[str]) -> str:
    """Return words as one text without colons and the like at their ends."""
    return " ".join(filter(None, (word.strip(_MARKS) for word in words)))


def _join_words(words: Iterable[str]) -> str:
    """Return words as one header, whose unit is at its end."""
    unit: str | None = None
    names = []
    for word in filter(None, words):
        name, own = split_unit(word)
        unit = own or unit
        names.append(name)
    return _add_unit(" ".join(names), unit or "")


def _add_unit(header: str, unit: str) -> str:
    """Return a header with a unit."""
    return f"{header} [{unit}]".strip() if unit else header


def _number_alike(headers: Sequence[str]) -> list[str]:
    """Return headers with numbers behind those that are equal."""
    counts, seen = Counter(headers), Counter[str]()
    numbered = []
    for header in headers:
        seen[header] += 1
        name, unit = split_unit(header)
        is_repeated = counts[header] > 1 and bool(header)
        numbered.append(_add_unit(f"{name} {seen[header]}", unit or "") if is_repeated else header)
    return [each[: limits.MAX_CELL_LENGTH] for each in numbered]
