"""Columns of files that a proposal does not read, or that it reads otherwise than the caller states."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np

from jointstiff.schemas.imports import ImportRequest, State
from jointstiff.service.importing.errors import NOWHERE, ImportFileError, Place, quote
from jointstiff.service.importing.grammar import (
    Dimension,
    Meaning,
    collapse_blanks,
    find_answer,
    find_force_at_end,
    find_state,
    find_state_in_name,
    find_unit_of_force,
    find_unit_of_weight,
    find_unknown_unit,
    fits_header,
    is_hung,
    is_in_kg,
    is_load_header,
    list_units,
    looks_like_a_force,
    read_states,
    split_unit,
)
from jointstiff.service.importing.grid import ARRAYS, looks_like_a_number
from jointstiff.service.importing.loads import find_load, find_state_of_load
from jointstiff.service.proposals.names.labels import omit_repeat_numbers
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.posture_loads import LOADS
from jointstiff.service.proposals.rewriting import KEPT_KINDS
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.table import find_moving_columns

_NAMES: Final = frozenset(("name", "collection", "group", "target", "state", "time", "ignored"))
"""Kinds of columns that tell of rows, or of nothing that a campaign has."""
_MOST_NAMED: Final = 8
"""Most columns that a sentence names."""
_COORDINATES: Final = 3
"""Coordinates of a position."""
_SAME_JOINT: Final = np.radians(0.01)
"""Largest difference of a joint [rad] between two logs of the same postures."""
_UNIT_VECTOR: Final = 0.01
"""Largest difference of the size of a unit vector from 1."""
_SAME_SIZE: Final = 0.01
"""Largest difference of the sizes of forces, as a part of their mean."""
_ONE_SIZE: Final = 0.05
"""Largest difference of the readings of one force by a load cell, as a part of their median."""
_LEAST_FORCE: Final = 2.0
"""Least size of a force; a direction has the size 1."""
_LEAST_PART_OF_LOAD: Final = 0.3
"""Least size of a force under load, as a part of the greatest."""
_LARGER: Final = 3.0
"""Ratio of the sizes under load and without load up to which a column is noise."""
_DIFFERENT: Final = 0.5
"""Difference of the rows of a posture, as a part of the sizes without load, from which a column is noise."""


@dataclass(frozen=True)
class ColumnsLeft:
    """Columns of a table that a proposal does not read."""

    table: NumberTable
    columns: tuple[int, ...]
    is_whole: bool  # whether no column of the table is read


def list_columns_left(
    proposal: Proposal, tables: Sequence[NumberTable], named: Sequence[NamedReading] = ()
) -> list[ColumnsLeft]:
    """Return the columns of each table that a proposal does not read, and the caller does not ignore.

    The uncertainties of `named` readings are read.
    """
    found = []
    for table in tables:
        own = [each for each in named if each.reading.points.table == table.name and each.uncertainty]
        uncertain = {column for each in own if each.uncertainty for column in each.uncertainty.columns}
        found.append(list_other_columns(table, _list_columns_read(proposal, table) | uncertain))
    return found


def list_other_columns(table: NumberTable, read: Collection[int]) -> ColumnsLeft:
    """Return the columns of a table that are not read, and that the caller does not ignore."""
    columns = [column for column in range(len(table.headers)) if column not in read]
    left = [column for column in columns if not _is_explained(table, column)]
    return ColumnsLeft(table, tuple(left), is_whole=not read)


def _list_columns_read(proposal: Proposal, table: NumberTable) -> set[int]:
    """Return the columns of a table that are joints, positions or loads of a proposal."""
    read = {
        column
        for reading in proposal.readings
        if reading.points.table == table.name
        for column in reading.points.columns
    }
    return read | table.copied | set(proposal.joints.columns if table.name == proposal.joints.table else ())


def _is_explained(table: NumberTable, column: int) -> bool:
    """Return whether a column is empty, names rows or their loads, is kept, or is ignored by the caller."""
    is_empty = not any(row.cells[column] for row in table.rows)
    meaning = table.meanings[column]
    is_label = column == table.label_column
    is_named = meaning is not None and meaning.kind in KEPT_KINDS | (_NAMES - {"ignored"})
    is_load = is_in_kg(table.headers[column]) and any(name.mass is not None for name in table.turn)
    return is_empty or is_named or is_label or is_load or column in table.ignored


def name_columns_left(
    left: Sequence[ColumnsLeft], tables: Sequence[NumberTable], state_words: Mapping[str, State]
) -> Iterator[str]:
    """Yield notes that name the columns of each table that a proposal does not read; nothing if all are read.

    A column whose words are the states or targets of its rows was read; `state_words` are the caller's words.
    """
    are_left = False
    for each in left:
        unread = [column for column in each.columns if not find_named_kind(each.table, column, state_words)]
        others = len(unread) - _MOST_NAMED
        listed = ", ".join(_name_column(each.table, column) for column in unread[:_MOST_NAMED])
        prefix = f"{each.table.name} " if len(tables) > 1 else ""
        if unread:
            yield f"not read: {prefix}{listed}" + (f" and {others} more" if others > 0 else "")
            are_left = True
    if are_left:
        headers = [each.table.headers[column] for each in left for column in each.columns]
        yield from _note_unknown_units(headers)


def find_named_kind(
    table: NumberTable, column: int, state_words: Mapping[str, State]
) -> Literal["state", "target"] | None:
    """Return what the words of a column name if they are the states or the targets of all rows; else None.

    `state_words` are the caller's words for states.
    """
    texts = [row.cells[column].strip() for row in table.rows]
    word_of_text = omit_repeat_numbers(texts)
    state_of_word = read_states(set(word_of_text.values()), state_words)
    count = len(table.turn)
    are_words = is_load_header(table.headers[column]) or not any(map(looks_like_a_number, texts))
    if count < 2 or len(texts) % count or not are_words:
        return None
    names = [*table.turn] * (len(texts) // count)
    states = [name.state and name.state.removesuffix("_after") for name in names]
    read = [state_of_word.get(word_of_text[text]) or _read_state(text, state_words) for text in texts]
    if len(set(states)) > 1 and [state and state.removesuffix("_after") for state in read] == states:
        return "state"
    targets = [name.target for name in names]
    return "target" if len(set(targets)) > 1 and texts == targets else None


def _read_state(text: str, state_words: Mapping[str, State]) -> State | None:
    """Return the state that a cell means by its word, its words, or the mass in it; else None."""
    state = find_state(text, state_words) or find_state_in_name(text, state_words)
    mass = find_load(text)
    if state is not None or mass is None:
        return state or find_answer(text)
    return find_state_of_load(mass)


def _note_unknown_units(headers: Iterable[str]) -> Iterator[str]:
    """Yield a note on each unit of a load that is not known, with the headers that state the unit."""
    headers_of_unit = dict[tuple[Dimension, str], list[str]]()
    for header in headers:
        unknown = find_unknown_unit(header)
        if unknown is not None:
            headers_of_unit.setdefault(unknown, []).append(collapse_blanks(header))
    for (dimension, unit), own in headers_of_unit.items():
        *first, last = list_units(dimension)
        state_force = "state `force` and " if dimension == "force" else ""
        yield (
            f"{quote(unit)} of {', '.join(own[:_MOST_NAMED])} is no known unit of {dimension}: convert the "
            f"numbers to {', '.join(first)} or {last}, or {state_force}leave the columns out with `ignore`"
        )


def _name_column(table: NumberTable, column: int) -> str:
    """Return the header of a column, or its number without a header."""
    return collapse_blanks(table.headers[column]) or f"column {column + 1}"


def leave_positions(left: Sequence[ColumnsLeft], named: Sequence[NamedReading]) -> bool:
    """Return whether columns that are left may be positions: a whole file, or without a second state."""
    is_file_left = any(each.is_whole for each in left)
    return is_file_left or len({each.state for each in named}) == 1


def confirms_joints(table: NumberTable, proposal: Proposal, joints: NumberTable) -> bool:
    """Return whether a table has the columns of the table of joints, and the same joints in the same rows.

    Such a table is a log of the joints in another state. Joints are the same within `_SAME_JOINT`; other
    numbers do not change, or only increase, as times do.
    """
    if table is joints or table.headers != joints.headers or len(table.rows) != len(joints.rows):
        return False
    numbers, columns = table.table.numbers, list(proposal.joints.columns)
    limit = _SAME_JOINT if proposal.joints.unit == "rad" else np.degrees(_SAME_JOINT)
    are_same = bool((np.abs(numbers[:, columns] - joints.table.numbers[:, columns]) <= limit).all())
    is_moving = find_moving_columns(numbers)
    others = [column for column in range(numbers.shape[1]) if is_moving[column] and column not in columns]
    return are_same and bool((np.diff(numbers[:, others], axis=0) >= 0.0).all())


def refuse_columns_left(
    left: Sequence[ColumnsLeft],
    proposal: Proposal,
    named: Sequence[NamedReading],
    tables: Sequence[NumberTable],
) -> None:
    """Refuse a proposal that leaves out a file, or columns that may be the positions under load.

    Raises:
        ImportFileError: nothing of a file is read; or all positions are in one state, and three columns of
            numbers are left.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    postures = len(joints.rows) // proposal.joints.groups.count
    for each in left:
        is_other = confirms_joints(each.table, proposal, joints) or _is_square_matrix(each.table, postures)
        if each.is_whole and not is_other:
            raise _build_file_error(each.table, joints, postures)
    if len({each.state for each in named}) > 1:
        return
    for each in left:
        columns = list_unexplained_numbers(each)
        if columns:
            listed = ", ".join(_name_column(each.table, column) for column in columns)
            state = named[0].state.replace("_", " ")
            reason = f"{listed} of {quote(each.table.name)} are not read, and all positions are {state}"
            remedy = "correct these columns or name them in `header`, or leave them out with `ignore`"
            raise ImportFileError(Place(each.table.grid.file), reason, remedy)


def refuse_force_beside_columns(
    left: Sequence[ColumnsLeft], request: ImportRequest, joints: NumberTable
) -> None:
    """Refuse one stated force if columns that are not read are forces by their words.

    The size of a force in the table of joints has been compared with the stated force.

    Raises:
        ImportFileError: the request states a force, and there are such columns.
    """
    for each in left if request.force is not None else ():
        table = each.table
        columns = [column for column in each.columns if may_be_force(table, column)]
        if table is joints:
            columns = [column for column in columns if column != table.find_size_of_force()]
        else:
            columns += sorted(set(table.find_force_columns().values()) - table.copied)
        if columns:
            listed = ", ".join(_name_column(table, column) for column in columns)
            reason = f"`force` is stated, but columns that are not read look like forces: {listed}"
            remedy = "say what these columns are by `columns`, or leave them out with `ignore`"
            raise ImportFileError(Place(table.grid.file), reason, remedy, "force")


def may_be_force(table: NumberTable, column: int) -> bool:
    """Return whether a column without a known meaning has a word for a force, and numbers other than flags.

    Numbers that are noise in all states are no force.
    """
    is_named = table.meanings[column] is None and looks_like_a_force(table.headers[column])
    return is_named and not table.has_flags(column) and not _shows_no_load(table, column)


def _shows_no_load(table: NumberTable, column: int) -> bool:
    """Return whether a column has as large numbers in rows without load as under load, but not the same ones.

    Such numbers are noise. Rows without names of states show nothing.
    """
    states = [name.state for name in table.turn]
    if not {"unloaded", "loaded"} <= set(states):
        return False
    of_rows = table.table.numbers[:, column].reshape(-1, len(states))
    loaded, unloaded = (of_rows[:, states.index(state)] for state in ("loaded", "unloaded"))
    without_load, under_load = (float(np.sqrt(np.nanmean(each**2))) for each in (unloaded, loaded))
    difference = float(np.sqrt(np.nanmean((loaded - unloaded) ** 2)))
    return under_load <= _LARGER * without_load and difference >= _DIFFERENT * without_load


def find_bare_vector(left: ColumnsLeft) -> tuple[int, int, int] | None:
    """Return the three columns that are left, without headers and adjacent, if they are a vector; else None.

    A direction has the size 1, and is no force. Rows without load may have no numbers.
    """
    table = left.table
    if len(left.columns) != _COORDINATES or any(table.headers[column] for column in left.columns):
        return None
    first, second, third = left.columns
    numbers = _list_filled(table, left.columns)
    sizes = np.linalg.norm(numbers, axis=1)
    is_force = len(sizes) > 0 and bool(np.isfinite(sizes).all()) and sizes.mean() > _LEAST_FORCE
    is_vector = third - first == _COORDINATES - 1 and any(find_moving_columns(numbers))
    return (first, second, third) if is_force and is_vector else None


class SizesAlongVectors(NamedTuple):
    """Columns of a table with the sizes of forces and the unit vectors of their directions."""

    table: NumberTable
    size: int
    vector: tuple[int, int, int]

    @property
    def forces(self) -> FloatArray:
        """Forces (rows, 3) in the unit of the sizes; zero in rows without numbers."""
        numbers = np.nan_to_num(self.table.table.numbers)
        vectors = numbers[:, list(self.vector)]
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        return numbers[:, [self.size]] * vectors / np.where(lengths > 0.0, lengths, 1.0)

    @property
    def have_one_direction(self) -> bool:
        """Return whether the unit vectors of all forces are the same."""
        forces = self.forces[self.forces.any(axis=1)]
        directions = forces / np.linalg.norm(forces, axis=1, keepdims=True)
        return bool(np.ptp(directions, axis=0).max(initial=0.0) <= _UNIT_VECTOR)

    @property
    def words(self) -> str:
        """Headers of the unit vectors, or the numbers of their columns."""
        return ", ".join(_name_column(self.table, column) for column in self.vector)


def find_sizes_along_vectors(left: ColumnsLeft) -> SizesAlongVectors | None:
    """Return the only column of sizes of a force with the only three columns of a unit vector; else None.

    The header of the sizes has a word for a force. Three adjacent columns have the size 1 in all rows that
    have a force.
    """
    table = left.table
    sizes = [column for column in left.columns if may_be_force(table, column)]
    if len(sizes) != 1:
        return None
    numbers = np.nan_to_num(table.table.numbers)
    is_force = numbers[:, sizes[0]] > 0.0
    others = set(left.columns).difference(sizes)
    found = [
        SizesAlongVectors(table, sizes[0], (first, first + 1, first + 2))
        for first in sorted(others)
        if {first + 1, first + 2} <= others and _are_units(numbers[is_force, first : first + _COORDINATES])
    ]
    has_force = bool((numbers[:, sizes[0]] >= 0.0).all() and is_force.any())
    return found[0] if len(found) == 1 and has_force else None


def _are_units(vectors: FloatArray) -> bool:
    """Return whether vectors (rows, 3) have the size 1."""
    return bool(np.abs(np.linalg.norm(vectors, axis=1) - 1.0).max(initial=0.0) <= _UNIT_VECTOR)


def _list_filled(table: NumberTable, columns: Sequence[int]) -> FloatArray:
    """Return the numbers (N, m) of some columns in the rows that have any."""
    numbers = table.table.numbers[:, list(columns)]
    return numbers[np.isfinite(numbers).any(axis=1)]


def find_constant_force(left: ColumnsLeft) -> tuple[int, int, int] | None:
    """Return three columns without headers whose numbers are a force of constant size; None without them."""
    columns = find_bare_vector(left)
    if columns is None:
        return None
    sizes = np.linalg.norm(_list_filled(left.table, columns), axis=1)
    return columns if np.ptp(sizes) <= _SAME_SIZE * sizes.mean() else None


def describe_likely_force(left: Sequence[ColumnsLeft]) -> str:
    """Return the end of a sentence on columns that may be the load, with what to state; empty without any.

    A column in a unit of mass, or of a load without a unit, with one number is a likely mass; flags without a
    unit of mass are none. The last three numbers without a header are a likely force.
    """
    sentences = [
        _describe_weight(header, mass)
        for each in left
        for column in each.columns
        if (mass := _find_mass(each.table, column)) is not None and (header := each.table.headers[column])
    ]
    for each in left:
        along = find_sizes_along_vectors(each)
        if along is not None and not along.have_one_direction:
            sentences.append(_describe_vectors(along))
            continue
        for column in each.columns:
            unit = find_unit_of_force(each.table.headers[column])
            sizes = _list_sizes(each.table, column)
            if unit is not None and sizes.size:
                sentences.append(_describe_sizes(each.table.headers[column], sizes, unit))
    for each in left:
        if len(each.columns) == _COORDINATES and not any(each.table.headers[c] for c in each.columns):
            first, _, third = each.columns
            sentences.append(
                f"columns {first + 1}–{third + 1} of {quote(each.table.name)} are not read and may be "
                "the force: if so, name all columns by `header`, these as `Fx[N]`, `Fy[N]` and `Fz[N]`"
            )
    return "".join(f"; {sentence}" for sentence in sentences)


def _describe_weight(header: str, mass: float) -> str:
    """Return what to state if a mass hangs, in the unit of its header; in kg and lb without a unit."""
    unit = find_unit_of_weight(header)
    if unit is not None:
        size = f"{mass:g} {unit.removesuffix('f')}"
        return f"{quote(header)} has {size}: if this load hangs, `force` is 0,0,-{mass:g}{unit}"
    forces = f"0,0,-{mass:g}kgf for kg, or 0,0,-{mass:g}lbf for lb"
    return f"{quote(header)} has {mass:g} without a unit: if this load hangs, `force` is {forces}"


def _find_mass(table: NumberTable, column: int) -> float | None:
    """Return the one mass of a column, apart from rows with 0; else None.

    The column has a unit of mass, or a word for a load that hangs and no unit; then 1 may be a state.
    """
    header, numbers = table.headers[column], table.table.numbers[:, column]
    masses = set(numbers[np.isfinite(numbers) & (numbers != 0.0)].tolist())
    is_bare = is_hung(header) and split_unit(header)[1] is None and not table.has_flags(column)
    may_be_mass = find_unit_of_weight(header) is not None or is_bare
    return masses.pop() if may_be_mass and len(masses) == 1 and min(masses) > 0.0 else None


def _describe_sizes(header: str, sizes: FloatArray, unit: str) -> str:
    """Return what to state of the sizes (N,) of a force under load: one force, or that of each posture."""
    size = float(np.median(sizes))
    if np.ptp(sizes) <= _ONE_SIZE * size:
        found = f"{quote(header)} has {size:.4g} {unit} under load"
        return f"{found}: if this force pulls down, `force` is 0,0,-{size:.4g}{unit}"
    return (
        f"{quote(header)} has {sizes.min():.4g} to {sizes.max():.4g} {unit} under load, which differ by "
        f"posture: {_write_columns(unit)}"
    )


def _describe_vectors(along: SizesAlongVectors) -> str:
    """Return what to state of sizes along unit vectors that do not explain the deflections."""
    header = along.table.headers[along.size]
    found = f"{quote(header)} along {along.words} does not explain the deflections"
    return f"{found}: {_write_columns(find_force_at_end(header) or 'N')}"


def _write_columns(unit: str) -> str:
    """Return the request for columns of the force of each posture."""
    return f"write the force of each posture in columns `Fx [{unit}]`, `Fy [{unit}]` and `Fz [{unit}]`"


def _list_sizes(table: NumberTable, column: int) -> FloatArray:
    """Return the sizes (N,) of a force under load; none if rows have both signs, flags, or no force."""
    numbers = table.table.numbers[:, column]
    known = numbers[np.isfinite(numbers)]
    greatest = np.abs(known).max(initial=0.0)
    under_load = known[np.abs(known) >= max(_LEAST_PART_OF_LOAD * greatest, np.finfo(float).tiny)]
    has_one_sign = bool((under_load > 0.0).all() or (under_load < 0.0).all())
    is_force = has_one_sign and not table.has_flags(column) and not _shows_no_load(table, column)
    return np.abs(under_load) if is_force else np.array([])


def refuse_single_rows(proposal: Proposal, tables: Sequence[NumberTable]) -> None:
    """Refuse a proposal that reads as postures the rows that names make states or targets of one posture.

    Raises:
        ImportFileError: a table has such rows.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    single = {each.points.table for each in proposal.readings if each.points.groups.count == 1}
    of_states = [
        table for table in tables if table.name in single and len({row.state for row in table.turn}) > 1
    ]
    count = len(joints.turn) or max((len(table.turn) for table in of_states), default=0)
    if count > 1 and (of_states or proposal.joints.groups.count != count):
        reason = f"the {count} rows of a posture have different joints, so that each was read as a posture"
        remedy = (
            "write the joints of a posture alike in its rows; joints that headers name may differ by "
            "`joint_tolerance`"
        )
        raise ImportFileError(Place(joints.grid.file), reason, remedy)


def _is_square_matrix(table: NumberTable, postures: int) -> bool:
    """Return whether the arrays of a file with these rows are square, as a stiffness or a covariance is.

    Rows of postures, columns of positions, and arrays of three rows, which may be points, are no such matrix.
    """
    count, width = table.table.numbers.shape
    has_positions = any(each is not None and each.kind in ("position", "joint") for each in table.meanings)
    is_array = table.grid.preview.format in ARRAYS.values()
    is_square = count > _COORDINATES and width % count == 0 and bool(np.isfinite(table.table.numbers).all())
    return is_array and is_square and not has_positions and count % postures > 0


def _build_file_error(table: NumberTable, joints: NumberTable, postures: int) -> ImportFileError:
    """Return the error that nothing of a file is read."""
    place, name = Place(table.grid.file), quote(table.name)
    leave_out = "name the sheets to be read in `sheet`" if table.grid.own_sheet else "leave the file out"
    if len(table.rows) % postures:
        reason = f"{name} is not read: it has {len(table.rows)} rows for {postures} postures"
        remedy = f"give each posture a row in every file, or {leave_out}"
        return ImportFileError(place, reason, remedy)
    if any(meaning is not None and meaning.kind in LOADS for meaning in table.meanings):
        reason = f"{name} is not read: no names of postures join its loads to those of {quote(joints.name)}"
        remedy = (
            "name the rows of both alike in a first column `label`; or, if the rows of all files are in one "
            f"order, state `by_order`; or {leave_out}"
        )
        return ImportFileError(place, reason, remedy, "by_order")
    reason = f"{name} is not read: its numbers are no positions in the postures of {quote(joints.name)}"
    remedy = (
        "put the rows of all files in one order, or name them alike in a first column `label`; or "
        f"{leave_out}"
    )
    return ImportFileError(place, reason, remedy)


def list_unexplained_numbers(left: ColumnsLeft) -> list[int]:
    """Return the columns of numbers that differ and that no header explains, if there are three at least.

    A header explains columns of forces, of uncertainties and of other quantities.
    """
    table = left.table
    is_moving = find_moving_columns(table.table.numbers)
    numbers = [
        column
        for column in left.columns
        if is_moving[column] and column not in table.table.others and not _is_other(table.meanings[column])
    ]
    return numbers if len(numbers) >= _COORDINATES else []


def _is_other(meaning: Meaning | None) -> bool:
    """Return whether a header says that a column has nothing of a campaign, such as a temperature."""
    return meaning is not None and meaning.kind == "ignored"


# ---- what the caller states


def refuse_unknown_headers(tables: Sequence[NumberTable], request: ImportRequest) -> None:
    """Refuse a statement about a header that no file has.

    Raises:
        ImportFileError: `columns` or `ignore` names such a header, or `header` has another number of columns.
    """
    widths = {len(table.headers) for table in tables}
    if request.header is not None and len(request.header) not in widths:
        found = " or ".join(map(str, sorted(widths)))
        reason = f"`header` names {len(request.header)} columns, but the rows have {found} cells"
        are_blanks_between = any(table.grid.preview.delimiter == "whitespace" for table in tables)
        remedy = "name each column in `header`" + (
            ", without blanks in a name, such as `Fx[N]`: blanks separate the cells of the file"
            if are_blanks_between
            else ""
        )
        raise ImportFileError(NOWHERE, reason, remedy, "header")
    headers = {collapse_blanks(header) for table in tables for header in table.headers}
    for header in request.columns:
        if collapse_blanks(header) not in headers:
            raise _build_header_error("columns", header)
    for pattern in request.ignore:
        if not any(fits_header(pattern, header) for header in headers):
            raise _build_header_error("ignore", pattern)


def _build_header_error(option: str, header: str) -> ImportFileError:
    """Return the error that an option names a header that no file has."""
    reason = f"`{option}` names the header {quote(header)}, but no file has this header"
    return ImportFileError(NOWHERE, reason, f"write the header in `{option}` exactly as in the file", option)


def find_contradiction(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable]
) -> str:
    """Return which column a proposal reads otherwise than the caller states; empty if it reads none so."""
    for table in tables:
        uses = describe_uses(proposal, named, table)
        for column in sorted(table.stated):
            meaning = table.meanings[column]
            stated = "" if meaning is None else _describe_meaning(meaning, uses.get(column))
            if stated and uses.get(column) != stated:
                header = quote(table.headers[column])
                used = uses.get(column, "not read")
                return f"`columns` states that {header} is {stated}, but by the robot it is {used}"
    return ""


def describe_uses(proposal: Proposal, named: Sequence[NamedReading], table: NumberTable) -> Mapping[int, str]:
    """Return column → its meaning by a proposal, of the columns of a table that it reads."""
    uses: dict[int, str] = {}
    if table.name == proposal.joints.table:
        for number, column in enumerate(proposal.joints.columns, 1):
            uses[column] = f"J{number} [{proposal.joints.unit}]"
    own = [each for each in named if each.reading.points.table == table.name]
    for each in own:
        columns = each.reading.points.columns
        words = {other.words for other in own if other.reading.points.columns == columns}
        targets = {other.target for other in own if other.reading.points.columns == columns}
        state = each.state.replace("_", " ")
        common = f"{each.target} {state}" if len(words) == 1 else " and ".join(sorted(targets))
        for axis, column in zip("xyz", columns, strict=True):
            uses[column] = f"{common} {axis} [{proposal.unit}]"
        for column in each.uncertainty.columns if each.uncertainty else ():
            uses[column] = "U95"
    return uses


def _describe_meaning(meaning: Meaning, use: str | None) -> str:
    """Return a stated joint or position in the words of `describe_uses`; empty for other meanings.

    What is not stated, such as the unit or the state, is as in the use of the column.
    """
    if meaning.axis is None or meaning.kind not in ("joint", "position"):
        return ""
    used_words, _, used_unit = (use or "").rpartition(" ")
    unit = f"[{meaning.unit}]" if meaning.unit else used_unit
    if meaning.kind == "joint":
        return f"J{meaning.axis + 1} {unit}".strip()
    used_target, _, _ = used_words.rpartition(" ")
    target, state = meaning.quantity.target, meaning.quantity.state
    words = [target, state and state.replace("_", " ")]
    if target is None or state is None:
        words = [used_target]
    return " ".join([*(word for word in words if word), "xyz"[meaning.axis], unit])
