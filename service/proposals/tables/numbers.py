"""Numbers of files whose columns have no known meaning yet, for the robot to find their meaning."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain
from pathlib import PurePath
from typing import Final

import numpy as np

from jointstiff.schemas.imports import DecimalMark, ImportOptions
from jointstiff.service.importing.errors import ImportFileError, quote
from jointstiff.service.importing.formats.blocks import write_postures
from jointstiff.service.importing.grammar import (
    Kind,
    Meaning,
    Quantity,
    Vocabulary,
    collapse_blanks,
    find_force_at_end,
    find_opposites,
    find_unit_of_size,
    is_planned,
    is_repeat_header,
    is_statistic,
    lacks_number,
    parse_polar,
)
from jointstiff.service.importing.grid import (
    LEAST_NUMBERS,
    Grid,
    Remark,
    Row,
    are_texts,
    count_numbers,
    decide_decimal_mark,
    find_mark_of_texts,
    has_separated_thousands,
    looks_like_a_number,
    read_number,
    remove_thousands_separators,
)
from jointstiff.service.importing.header import find_heading, find_names_in_comment
from jointstiff.service.importing.masses import is_mass_table
from jointstiff.service.importing.merged_rows import fill_down
from jointstiff.service.importing.posture_files import join_posture_files
from jointstiff.service.importing.source_files import SourceFile, check_files
from jointstiff.service.importing.source_grids import read_grids
from jointstiff.service.importing.transposed import turn_table
from jointstiff.service.importing.unit_remarks import find_unit_of_forces
from jointstiff.service.proposals.tables.row_name import RowName
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.table import RowGroups, Table

_MOST_LISTED: Final = 4
"""Rows that a note lists."""
_IMPOSSIBLE_ANGLE: Final = re.compile(r"[-+]?[1-9]\d{1,2},\d{3}")
"""A number that, without its comma, is above 10 000: no joint turns so far in degrees."""
_DIRECTION: Final = re.compile(r"[-+−–][XYZ]", re.IGNORECASE)
"""A direction along an axis, with its sign."""
_DIGITS: Final = 9
"""Digits behind the decimal mark of computed numbers."""
_NAMING_KINDS: Final = frozenset(("name", "collection", "group", "target", "state"))
"""Kinds of columns whose texts name the rows."""
_OTHER_KINDS: Final = frozenset(("force", "moment", "load point", "mass", "along", "uncertainty"))
"""Kinds of columns that are neither joints nor positions."""


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Table of a file, with the meanings that its headers have by their names."""

    grid: Grid
    headers: tuple[str, ...]  # empty texts without a header
    meanings: tuple[Meaning | None, ...]  # None for a header without a known meaning
    rows: tuple[Row, ...]  # rows of data
    mark: DecimalMark
    table: Table  # the numbers
    stated: frozenset[int] = frozenset()  # columns whose meaning the caller states
    ignored: frozenset[int] = frozenset()  # columns that the caller ignores
    turn: tuple[RowName, ...] = ()  # names of the rows of a posture, which follow each other; () if unknown
    labels: tuple[str, ...] = ()  # names of the postures, in the order of the rows; () without names
    copied: frozenset[int] = frozenset()  # columns of loads that the table of joints has, too
    copies: frozenset[int] = frozenset()  # columns of loads of other tables, in the table of joints

    @property
    def name(self) -> str:
        """Name of the table among all tables: the file's, with the sheet's if the file has several."""
        return self.table.name

    @property
    def stem(self) -> str:
        """Name of the file without its extension."""
        return PurePath(self.grid.file).stem

    @property
    def title(self) -> str:
        """Name of the file without its extension, and of the sheet, which may say state and load."""
        return f"{self.stem} {self.grid.preview.sheet or ''}".strip()

    @property
    def remarks(self) -> list[Remark]:
        """Comments of the file, the title of the table, and its rows above the rows of data."""
        return _list_remarks(self.grid, self.rows[0].line)

    @cached_property
    def label_column(self) -> int | None:
        """Column of the names of the postures: of these and no other, else the first; None without names."""
        if not self.labels:
            return None
        labels = set(self.labels)
        columns = range(len(self.headers))
        return next((c for c in columns if {row.cells[c] for row in self.rows} == labels), 0)

    @property
    def has_repeats(self) -> bool:
        """Return whether a header says that a column counts the repeated readings of a point."""
        return any(map(is_repeat_header, self.headers))

    def name_column(self, column: int) -> str:
        """Return the header of a column, or its number without a header."""
        return collapse_blanks(self.headers[column]) or f"column {column + 1}"

    def list_texts(self, column: int) -> list[str]:
        """Return the cells of a column."""
        return [row.cells[column] for row in self.rows]

    def has_words(self, column: int) -> bool:
        """Return whether all cells of a column are texts other than numbers."""
        return are_texts(self.list_texts(column))

    def has_flags(self, column: int) -> bool:
        """Return whether the numbers of a column are 0, 1 and −1 only: a flag or a sign, and no size."""
        numbers = self.table.numbers[:, column]
        return bool(np.isin(numbers[np.isfinite(numbers)], (-1.0, 0.0, 1.0)).all())

    def is_unknown(self, column: int) -> bool:
        """Return whether a column has no known meaning, and is not ignored."""
        return self.meanings[column] is None and column not in self.ignored

    def may_name(self, column: int) -> bool:
        """Return whether a column has no known meaning, or one of names, and is not ignored."""
        meaning = self.meanings[column]
        return column not in self.ignored and (meaning is None or meaning.kind in _NAMING_KINDS)

    def replace_numbers(self, numbers_of_column: Mapping[int, FloatArray]) -> NumberTable:
        """Return the table with other numbers (N,) in some columns."""
        numbers = self.table.numbers.copy()
        for column, values in numbers_of_column.items():
            numbers[:, column] = values
        rows = []
        for row, values in zip(self.rows, numbers, strict=True):
            cells = list(row.cells)
            for column in numbers_of_column:
                cells[column] = _write_number(float(values[column]), self.mark)
            rows.append(replace(row, cells=tuple(cells)))
        return replace(self, rows=tuple(rows), table=replace(self.table, numbers=numbers))

    def find_force_columns(self) -> dict[int, int]:
        """Return axis of R0 → column of the force along this axis, of the columns that headers name."""
        return self.find_columns_of("force")

    def find_columns_of(self, kind: Kind) -> dict[int, int]:
        """Return axis → column of a vector of a kind, such as `force`, in the order of the axes."""
        found = {
            meaning.axis: column
            for column, meaning in enumerate(self.meanings)
            if meaning is not None and meaning.kind == kind and meaning.axis is not None
        }
        return dict(sorted(found.items()))

    def turn_vectors(self, kinds: Sequence[Kind], rotation: FloatArray) -> NumberTable:
        """Return the table with the vectors of some kinds turned by a rotation (3, 3)."""
        turned = self
        for kind in kinds:
            columns = list(self.find_columns_of(kind).values())
            if len(columns) == len(rotation):
                vectors = self.table.numbers[:, columns] @ rotation.T
                turned = turned.replace_numbers(dict(zip(columns, vectors.T, strict=True)))
        return turned

    @property
    def force_is_along_one_axis(self) -> bool:
        """Force along one axis only, by the headers: then it has no other part."""
        return len(self.find_force_columns()) == 1 and not self.has_column_of("mass")

    def find_size_of_force(self) -> int | None:
        """Return the column of the size of a force, such as `Kraft [kN]`; None unless it is the only one.

        A table whose headers name a force along an axis, or a mass, has no such column; flags are no sizes.
        """
        kinds = {meaning.kind for meaning in self.meanings if meaning is not None}
        sizes = [
            column
            for column, header in enumerate(self.headers)
            if self.is_unknown(column) and find_unit_of_size(header) and not self.has_flags(column)
        ]
        return sizes[0] if len(sizes) == 1 and kinds.isdisjoint(("force", "mass")) else None

    def find_size_along_directions(self) -> int | None:
        """Return the only column of numbers, without a known header, that ends with a unit of force."""
        columns = [
            column
            for column, header in enumerate(self.headers)
            if self.is_unknown(column)
            and not self.has_flags(column)
            and find_force_at_end(header) is not None
            and np.isfinite(self.table.numbers[:, column]).all()
        ]
        return columns[0] if len(columns) == 1 else None

    def find_directions(self) -> int | None:
        """Return the only column whose cells are directions such as `+X` or `-Z`; None without one."""
        columns = [
            column
            for column in range(len(self.headers))
            if column not in self.ignored
            and all(_DIRECTION.fullmatch(row.cells[column].strip()) for row in self.rows)
        ]
        return columns[0] if len(columns) == 1 else None

    def read_forces_along(self, directions: int, size: int) -> FloatArray:
        """Return the forces (N, 3) of a column of sizes along the axes that a column of directions names."""
        forces = np.zeros((len(self.rows), 3))
        for number, row in enumerate(self.rows):
            direction = row.cells[directions].strip().casefold()
            sign = 1.0 if direction.startswith("+") else -1.0
            forces[number, "xyz".index(direction[-1])] = sign * self.table.numbers[number, size]
        return forces

    def add_forces(self, forces: FloatArray, unit: str | None, replaced: Collection[int] = ()) -> NumberTable:
        """Return the table with columns of forces (N, 3), in place of other columns."""
        meanings = [Meaning(Quantity("force"), axis, unit) for axis in range(3)]
        headers = [f"{meaning} [{unit}]" if unit else f"{meaning}" for meaning in meanings]
        added = self.add_columns(headers, meanings, forces)
        table = replace(added.table, others=added.table.others.union(replaced))
        return replace(added, table=table, ignored=self.ignored.union(replaced))

    def mark_copies(self, original: NumberTable) -> NumberTable:
        """Return the table whose columns that an original lacks are loads of another table."""
        return replace(self, copies=self.copies.union(range(len(original.headers), len(self.headers))))

    def add_columns(
        self, headers: Sequence[str], meanings: Sequence[Meaning | None], numbers: FloatArray
    ) -> NumberTable:
        """Return the table with further columns of numbers (N, m), which are neither joints nor positions."""
        rows = tuple(
            replace(row, cells=(*row.cells, *(_write_number(float(each), self.mark) for each in added)))
            for row, added in zip(self.rows, numbers, strict=True)
        )
        width = len(self.headers)
        table = replace(
            self.table,
            numbers=np.hstack([self.table.numbers, numbers]),
            others=self.table.others.union(range(width, width + len(headers))),
        )
        return replace(
            self,
            headers=(*self.headers, *headers),
            meanings=(*self.meanings, *meanings),
            rows=rows,
            table=table,
        )

    def add_labels(self, labels: Sequence[str]) -> NumberTable:
        """Return the table with a column of names of the postures."""
        rows = tuple(
            replace(row, cells=(*row.cells, label)) for row, label in zip(self.rows, labels, strict=True)
        )
        without_numbers = np.full((len(rows), 1), np.nan)
        table = replace(
            self.table,
            numbers=np.hstack([self.table.numbers, without_numbers]),
            others=self.table.others | {len(self.headers)},
        )
        headers, meanings = (*self.headers, "posture"), (*self.meanings, Meaning(Quantity("name")))
        return replace(self, headers=headers, meanings=meanings, rows=rows, table=table)

    def name_size_along_z(self, column: int) -> NumberTable:
        """Return the table in which a column of sizes of a force, of any sign, is the force along −z."""
        unit = find_unit_of_size(self.headers[column])
        meanings = list(self.meanings)
        meanings[column] = Meaning(Quantity("force"), 2, unit)
        table = self.replace_numbers({column: -np.abs(self.table.numbers[:, column])})
        others = self.table.others | {column}
        return replace(table, meanings=tuple(meanings), table=replace(table.table, others=others))

    def name_forces(self, columns: Sequence[int]) -> NumberTable:
        """Return the table in which three columns without a header are the force along x, y and z."""
        meanings = list(self.meanings)
        for axis, column in enumerate(columns):
            meanings[column] = Meaning(Quantity("force"), axis)
        others = self.table.others | set(columns)
        return replace(self, meanings=tuple(meanings), table=replace(self.table, others=others))

    def scale(self, columns: Collection[int], factor: float, unit: str) -> NumberTable:
        """Return the table with the numbers of some columns multiplied by a factor, and in another unit."""
        meanings = [
            replace(meaning, unit=unit) if meaning is not None and column in columns else meaning
            for column, meaning in enumerate(self.meanings)
        ]
        scaled = {column: factor * self.table.numbers[:, column] for column in columns}
        return replace(self.replace_numbers(scaled), meanings=tuple(meanings))

    def find_loaded_row(self, groups: RowGroups) -> int:
        """Return the first row of a posture that is under load by its name; 0 if names do not say."""
        are_named = groups.order == "in turn" and groups.count == len(self.turn)
        loaded = (row for row, name in enumerate(self.turn) if name.state == "loaded")
        return next(loaded, 0) if are_named else 0

    def find_column(self, kind: str) -> int | None:
        """Return the first column of a kind, such as `name`; None without one."""
        columns = (c for c, meaning in enumerate(self.meanings) if meaning and meaning.kind == kind)
        return next(columns, None)

    def has_column_of(self, kind: Kind) -> bool:
        """Return whether a header names a column of a kind, such as `force`."""
        return self.find_column(kind) is not None


def find_table(tables: Sequence[NumberTable], name: str) -> NumberTable:
    """Return the table that has a name."""
    return next(table for table in tables if table.name == name)


@dataclass(frozen=True)
class NumberFiles:
    """Tables of numbers of files, and the files that have none."""

    tables: tuple[NumberTable, ...]
    masses: tuple[SourceFile, ...]  # files with the masses of the robot's bodies
    without: tuple[str, ...]  # names of files without a row of numbers
    notes: tuple[str, ...] = ()  # rows of numbers that are not read
    sources: tuple[SourceFile, ...] = ()  # all files, as they were sent


GridReader = Callable[[SourceFile, ImportOptions], Sequence[Grid]]
"""Reader of a file as tables of cells."""


def read_tables(file: SourceFile, options: ImportOptions) -> list[Grid]:
    """Return the tables of a file as `read_grids` reads them for a proposal.

    Raises:
        ImportFileError: the file is no table.
    """
    return read_grids(file, options, every_length=True)


def read_number_tables(
    files: Sequence[SourceFile],
    options: ImportOptions,
    joints: Sequence[str],
    read: GridReader = read_tables,
) -> NumberFiles:
    """Read the tables of numbers of all files.

    `joints` are the names of the robot's joints, which columns may have; `read` reads a file as tables.

    Raises:
        ImportFileError: a file is no table, its numbers are ambiguous, or two files have one name.
    """
    check_files(files)
    tables, masses, without, notes = list[NumberTable](), list[SourceFile](), list[str](), list[str]()
    for file in _join_postures(files, options):
        words = Vocabulary(options, joints)
        grids = [turn_table(grid, words) for grid in read(file, options)]
        with_numbers = [grid for grid in grids if not is_mass_table(grid) and any(map(_is_data, grid.rows))]
        for grid in with_numbers:
            sheet = grid.preview.sheet if len(grids) > 1 else None
            name = f"{grid.file}, {sheet}" if sheet else grid.file
            tables.append(_read_table(grid, name, options, joints))
            notes += [*_note_rows_left(tables[-1]), *_note_decimal_commas(tables[-1], options)]
        if any(map(is_mass_table, grids)):
            masses.append(file)
        elif not with_numbers:
            without.append(file.name)
    return NumberFiles(tuple(tables), tuple(masses), tuple(without), tuple(notes), tuple(files))


def _join_postures(files: Sequence[SourceFile], options: ImportOptions) -> Sequence[SourceFile]:
    """Return the files; files of one posture each are one file, with a block or rows for each posture."""
    joined = write_postures([(file.name, file.content) for file in files])
    return join_posture_files(files, options) if joined is None else [SourceFile(*joined)]


def _read_table(grid: Grid, name: str, options: ImportOptions, joints: Sequence[str]) -> NumberTable:
    """Read the rows of data of a table, at least one, and the header above these rows.

    Raises:
        ImportFileError: the decimal mark of the table is ambiguous, or a row lacks cells.
    """
    words = Vocabulary(options, joints)
    start = _find_start(grid, words, options)
    data = [index for index, row in enumerate(grid.rows) if index >= start and _is_data(row)]
    rows = _fit_rows(grid, data)
    width = len(rows[0].cells)
    headers = _complete_headers(_find_headers(grid, words, options, data[0], width), grid, data[0])
    words.add_names_of_table(headers)
    remarks = _list_remarks(grid, rows[0].line)
    meanings, note_on_forces = _add_unit_of_forces(_find_meanings(headers, words), remarks)
    rows, note = fill_down(rows, headers, meanings)
    notes = [*grid.preview.assumptions, *filter(None, (note, note_on_forces))]
    grid = replace(grid, preview=grid.preview.model_copy(update={"assumptions": notes}))
    columns = [c for c in range(width) if any(looks_like_a_number(row.cells[c]) for row in rows)]
    is_separated = grid.preview.format != "text" or has_separated_thousands(rows, columns)
    joint_columns = _list_joint_columns(meanings)
    stated_mark = options.decimal_mark
    if stated_mark is None and _shows_decimal_commas(rows, columns, joint_columns):
        stated_mark = "comma"
    if stated_mark is None and grid.preview.format != "text":
        stated_mark = find_mark_of_texts(grid, rows, columns)
    mark, _ = decide_decimal_mark(grid, rows, columns, stated_mark, are_thousands_separated=is_separated)
    read = partial(_read_cell, mark=mark, are_thousands_separated=is_separated)
    numbers = np.array([[read(cell) for cell in row.cells] for row in rows])
    ignored = frozenset(column for column, header in enumerate(headers) if words.is_ignored(header))
    stated = frozenset(column for column, header in enumerate(headers) if words.is_stated(header)) - ignored
    named_joints = _list_joint_columns(meanings)
    known_joints = named_joints if len(named_joints) == len(joints) else ()
    planned = {column for column, header in enumerate(headers) if is_planned(header, options.state_words)}
    others = _find_other_columns(meanings) | ignored | (planned - stated)
    points = _list_named_points(meanings)
    measured = frozenset(_list_measured_columns(meanings))
    table = Table(name, numbers, known_joints, others, points, measured)
    return NumberTable(grid, headers, meanings, rows, mark, table, stated, ignored)


def _list_remarks(grid: Grid, first: int) -> list[Remark]:
    """Return the comments of a table, its title, and its rows above the row of data in the line `first`."""
    above = [Remark(row.line, "\t".join(row.cells)) for row in grid.rows if row.line < first]
    return sorted([*grid.comments, Remark(0, grid.own_sheet), *above])


def _add_unit_of_forces(
    meanings: tuple[Meaning | None, ...], remarks: Sequence[Remark]
) -> tuple[tuple[Meaning | None, ...], str]:
    """Return meanings whose forces without any unit have that of remarks, and a note on the unit."""
    forces = [meaning for meaning in meanings if meaning is not None and meaning.kind == "force"]
    unit = find_unit_of_forces(remarks)
    if not forces or unit is None or any(meaning.unit for meaning in forces):
        return meanings, ""
    with_unit = tuple(
        replace(meaning, unit=unit) if meaning is not None and meaning.kind == "force" else meaning
        for meaning in meanings
    )
    return with_unit, f"forces are in {unit}, as the file states"


def _list_measured_columns(meanings: Sequence[Meaning | None]) -> Iterator[int]:
    """Yield the columns of positions with names of a state, such as `T1 sem x` next to `T1 com x`."""
    quantities = {column: meaning.quantity for column, meaning in enumerate(meanings) if meaning is not None}
    words_of_column = {
        column: (quantity.target or "").replace("_", " ").split()
        for column, quantity in quantities.items()
        if quantity.kind == "position"
    }
    states = find_opposites(set(chain.from_iterable(words_of_column.values())))
    for column, words in words_of_column.items():
        if quantities[column].state is not None or not states.keys().isdisjoint(words):
            yield column


def _shows_decimal_commas(rows: Sequence[Row], columns: Sequence[int], joints: Sequence[int]) -> bool:
    """Return whether joints show that commas are decimal: `44,707` as thousands is no possible angle.

    A file with a point in any number is not decided.
    """
    if any("." in row.cells[column] for row in rows for column in columns):
        return False
    cells = [row.cells[column] for row in rows for column in joints]
    return any(_IMPOSSIBLE_ANGLE.fullmatch(cell) for cell in cells)


def _list_named_points(meanings: Sequence[Meaning | None]) -> tuple[tuple[int, int, int], ...]:
    """Return the columns of x, y and z of each target and state that headers or the caller name.

    Several columns with one name, such as three columns `X` below one target, are read in their order.
    """
    columns_of_quantity: dict[Quantity, tuple[list[int], list[int], list[int]]] = {}
    for column, meaning in enumerate(meanings):
        if meaning is not None and meaning.kind == "position" and meaning.axis is not None:
            columns_of_quantity.setdefault(meaning.quantity, ([], [], []))[meaning.axis].append(column)
    return tuple(
        triple
        for x, y, z in columns_of_quantity.values()
        if len(x) == len(y) == len(z)
        for triple in zip(x, y, z, strict=True)
    )


def _list_joint_columns(meanings: Sequence[Meaning | None]) -> tuple[int, ...]:
    """Return the columns whose headers name joints, in the order of the joints."""
    column_of_joint: dict[int, int] = {}
    for column, meaning in enumerate(meanings):
        if meaning is not None and meaning.kind == "joint" and meaning.axis is not None:
            column_of_joint[meaning.axis] = column
    return tuple(column_of_joint[joint] for joint in sorted(column_of_joint))


def _find_other_columns(meanings: Sequence[Meaning | None]) -> frozenset[int]:
    """Return the columns whose headers name something else than joints or positions, such as forces."""
    return frozenset(
        column
        for column, meaning in enumerate(meanings)
        if meaning is not None and meaning.kind in _OTHER_KINDS
    )


def _is_data(row: Row) -> bool:
    """Return whether a row has enough numbers to be a row of data, and no word such as `mean` before them."""
    first_filled = next((cell for cell in row.cells if cell), "")
    count = count_numbers(row)
    if count and any(_DIRECTION.fullmatch(cell.strip()) for cell in row.cells):
        count += LEAST_NUMBERS  # a direction is a unit vector of three numbers
    return count >= LEAST_NUMBERS and not is_statistic(first_filled)


def _fit_rows(grid: Grid, data: Sequence[int]) -> tuple[Row, ...]:
    """Return the rows of data with as many cells as most of them have; `data` are their indices.

    Texts behind the last column, such as remarks, are cut off; a row without such texts is filled up. Rows
    above the table, and rows that are apart below the table, are no rows of the table if their numbers are in
    other columns, or if they are sentences.

    Raises:
        ImportFileError: a row of the table has more or fewer numbers than the others.
    """
    width = Counter(len(grid.rows[index].cells) for index in data).most_common(1)[0][0]
    full = [index for index in data if len(grid.rows[index].cells) == width]
    columns = {
        c for index in full for c, cell in enumerate(grid.rows[index].cells) if looks_like_a_number(cell)
    }
    rows, end = list[Row](), full[0]
    for index in data:
        row = grid.rows[index]
        lacking = columns.intersection(range(len(row.cells), width))
        is_other = bool(lacking) or any(map(looks_like_a_number, row.cells[width:]))
        is_outside = index < full[0] or (index > full[-1] and _is_apart(grid, end, index))
        if is_outside and (is_other or _is_sentence(row, columns)):
            continue
        if is_other:
            reason = f"the row has {len(row.cells)} cells, but the other rows of the table have {width}"
            remedy = "give all rows the same number of cells, or remove this row"
            raise ImportFileError(grid.place(row), reason, remedy)
        rows.append(row.resize(width))
        end = index
    return tuple(rows)


def _is_sentence(row: Row, columns: Collection[int]) -> bool:
    """Return whether a row has more words than numbers in columns of numbers, such as a line of text."""
    cells = [row.cells[column] for column in columns if not lacks_number(row.cells[column])]
    return sum(map(looks_like_a_number, cells)) < len(cells) / 2


def _is_apart(grid: Grid, end: int, index: int) -> bool:
    """Return whether a row is not next to the row at the index `end` of a table above."""
    return index > end + 1 or grid.rows[index].line > grid.rows[end].line + 1


def _note_rows_left(table: NumberTable) -> list[str]:
    """Return a note on the rows of numbers that are not rows of the table."""
    lines = {row.line for row in table.rows}
    left = [row for row in table.grid.rows if row.line not in lines and _is_data(row)]
    if not left:
        return []
    quoted = ", ".join(f"{row.line} ({quote(row.cells[0])})" for row in left[:_MOST_LISTED])
    more = f" and {len(left) - _MOST_LISTED} more" if len(left) > _MOST_LISTED else ""
    return [f"{table.name}: rows of numbers outside the table were not read: {quoted}{more}"]


def _note_decimal_commas(table: NumberTable, options: ImportOptions) -> list[str]:
    """Return the note that the texts of a sheet were read with decimal commas, if nobody states the mark."""
    is_assumed = table.grid.preview.format != "text" and options.decimal_mark is None
    return [f"{table.name}: texts read with a decimal comma"] if is_assumed and table.mark == "comma" else []


def _find_start(grid: Grid, words: Vocabulary, options: ImportOptions) -> int:
    """Return the index of the row below the header; 0 without a known header.

    A header is known as a whole, or names joints or coordinates. The last row of a header may have numbers,
    such as those of joints.
    """
    with suppress(ImportFileError):
        heading = find_heading(grid, words, options)
        texts = [text for text in heading.texts if text]
        is_known = bool(texts) and words.count_known(texts) == len(texts)
        has_data = any(map(_is_data, grid.rows[heading.start :]))
        if heading.lines and is_known and has_data:
            return heading.start
    last = max(index for index, row in enumerate(grid.rows) if _is_data(row))
    named = (index for index, row in enumerate(grid.rows[:last]) if _names_columns(row, words))
    return next(named, -1) + 1


def _names_columns(row: Row, words: Vocabulary) -> bool:
    """Return whether a row of texts names three or more joints or coordinates."""
    if count_numbers(row) > 0 or sum(map(bool, row.cells)) < LEAST_NUMBERS:
        return False
    meanings = [words.find(cell) for cell in row.cells if cell]
    named = {(each.quantity, each.axis) for each in meanings if each is not None and each.axis is not None}
    return len(named) >= LEAST_NUMBERS


def _find_headers(
    grid: Grid, words: Vocabulary, options: ImportOptions, first: int, width: int
) -> tuple[str, ...]:
    """Return the header above the first row of data, or the one that the caller states.

    A header of several rows is combined, if that gives a header for each column. Without a header, the texts
    are empty.
    """
    with suppress(ImportFileError):
        heading = find_heading(grid, words, options)
        is_above_data = _are_without_numbers(grid, heading.start, first) or not heading.lines
        if is_above_data and not heading.columns_are_assumed and len(heading.texts) == width:
            return heading.texts
    if options.header is not None and len(options.header) == width:
        return tuple(options.header)
    if (names := find_names_in_comment(grid, words, grid.rows[first].line, width)) is not None:
        return names
    above = grid.rows[first - 1].cells if first > 0 else ()
    behind = " ".join(filter(None, above[width:]))
    is_remark = behind.startswith("(") and behind.endswith(")")
    if len(above) >= width and (is_remark or all(_is_ignored(text, words) for text in above[width:])):
        return above[:width]
    return ("",) * width


def _are_without_numbers(grid: Grid, start: int, first: int) -> bool:
    """Return whether rows from `start` have names, but no cells where the first row of data has numbers."""
    numbers = [column for column, cell in enumerate(grid.rows[first].cells) if looks_like_a_number(cell)]
    between = [row.resize(len(grid.rows[first].cells)) for row in grid.rows[start:first]]
    return start <= first and not any(row.cells[column] for row in between for column in numbers)


def _complete_headers(headers: tuple[str, ...], grid: Grid, first: int) -> tuple[str, ...]:
    """Return headers with the texts that only the header of a lower block has, such as those of its forces.

    The lower header has the texts of the upper one, which is above the first row of data.
    """
    upper = grid.rows[first - 1].cells if first > 0 else ()
    filled = {column: text for column, text in enumerate(upper) if text}
    if len(upper) != len(headers) or len(filled) < LEAST_NUMBERS:
        return headers
    for row in grid.rows[first:]:
        is_header = len(row.cells) == len(headers) and all(row.cells[c] == filled[c] for c in filled)
        if is_header:
            return tuple(own or text for own, text in zip(headers, row.cells, strict=True))
    return headers


def _is_ignored(header: str, words: Vocabulary) -> bool:
    """Return whether a header names a column that may be missing below it, such as comments; or is empty."""
    meaning = words.find(header) if header else None
    return not header or (meaning is not None and meaning.kind == "ignored")


def _find_meanings(headers: Sequence[str], words: Vocabulary) -> tuple[Meaning | None, ...]:
    """Return the meanings of headers: as the caller states them, or by their names; None if unknown.

    Raises:
        ImportFileError: a stated meaning is not understood.
    """
    return tuple(_find_meaning(header, words) for header in headers)


def _find_meaning(header: str, words: Vocabulary) -> Meaning | None:
    """Return the meaning of a header; None for an empty or unknown header.

    Raises:
        ImportFileError: a stated meaning is not understood.
    """
    if not header:
        return None
    if not words.is_stated(header):
        return words.find(header)
    return parse_polar(words.stated[collapse_blanks(header)]) or words.meaning(header, guessed=False)


def _write_number(number: float, mark: DecimalMark) -> str:
    """Return the text of a number with a decimal mark; empty for NaN."""
    text = "" if math.isnan(number) else repr(round(number, _DIGITS))
    return text.replace(".", ",") if mark == "comma" else text


def _read_cell(cell: str, mark: DecimalMark, *, are_thousands_separated: bool) -> float:
    """Return the number of a cell; NaN for a cell without a number."""
    text = remove_thousands_separators(cell, mark) if are_thousands_separated else cell
    try:
        return read_number(text, mark)
    except ImportFileError:
        return math.nan
