"""Columns of files that a proposal does not read."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from jointstiff.schemas.imports import State
from jointstiff.service.importing.errors import quote
from jointstiff.service.importing.grammar import (
    Dimension,
    Meaning,
    collapse_blanks,
    find_answer,
    find_state,
    find_state_in_name,
    find_unit_of_weight,
    find_unknown_unit,
    is_load_header,
    list_units,
    read_states,
)
from jointstiff.service.importing.grid import COORDINATES, looks_like_a_number
from jointstiff.service.importing.loads import find_load, find_state_of_load
from jointstiff.service.proposals.names.labels import omit_repeat_numbers
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.kinds import KEPT_KINDS
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.table import find_moving_columns

_NAMES: Final = frozenset(("name", "collection", "group", "target", "state", "time", "ignored"))
"""Kinds of columns that tell of rows, or of nothing that a campaign has."""
_MOST_NAMED: Final = 8
"""Most columns that a sentence names."""


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
    is_load = _names_masses(table, column)
    return is_empty or is_named or is_label or is_load or column in table.ignored


def _names_masses(table: NumberTable, column: int) -> bool:
    """Return whether a column has the masses that hang in the rows, in the unit of its header."""
    has_unit = find_unit_of_weight(table.headers[column]) is not None
    return has_unit and any(name.mass is not None for name in table.turn)


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
        listed = ", ".join(each.table.name_column(column) for column in unread[:_MOST_NAMED])
        prefix = f"{each.table.name} " if len(tables) > 1 else ""
        if unread:
            yield f"not read: {prefix}{listed}" + (f" and {others} more" if others > 0 else "")
            are_left = True
    if are_left:
        headers = [each.table.headers[column] for each in left for column in each.columns]
        yield from _note_unknown_units(headers)


def find_named_kind(
    table: NumberTable, column: int, state_words: Mapping[str, State]
) -> Literal["state", "target", "mass"] | None:
    """Return what the cells of a column name, of the states, targets or masses of all rows; else None.

    `state_words` are the caller's words for states.
    """
    if _names_masses(table, column):
        return "mass"
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


def leave_positions(left: Sequence[ColumnsLeft], named: Sequence[NamedReading]) -> bool:
    """Return whether columns that are left may be positions: a whole file, or without a second state."""
    is_file_left = any(each.is_whole for each in left)
    return is_file_left or len({each.state for each in named}) == 1


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
    return numbers if len(numbers) >= COORDINATES else []


def _is_other(meaning: Meaning | None) -> bool:
    """Return whether a header says that a column has nothing of a campaign, such as a temperature."""
    return meaning is not None and meaning.kind == "ignored"
