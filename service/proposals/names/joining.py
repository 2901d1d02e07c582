"""Tables of numbers whose rows are put in one order by their names: the rows of a posture in turn."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property

import numpy as np

from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grammar import (
    collapse_blanks,
    find_state,
    is_likely_unloaded,
    names_load_or_state,
)
from jointstiff.service.importing.grid import Row
from jointstiff.service.proposals.names.labels import find_number, list_words_behind, omit_zeros
from jointstiff.service.proposals.names.repeats import (
    are_repeats,
    find_telling_column,
    measure_distance,
)
from jointstiff.service.proposals.names.rows import find_different_words, find_unknown_states, name_rows
from jointstiff.service.proposals.names.targets import LEAST_BETWEEN_TARGETS, are_far_apart
from jointstiff.service.proposals.tables.lengths import MOST_REPEAT, find_units_of_coordinates
from jointstiff.service.proposals.tables.numbers import NumberTable, find_table
from jointstiff.service.proposals.tables.row_name import RowName
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.meaning.hypotheses import find_joint_noise, number_postures
from jointstiff.solver.meaning.table import JointColumns

_LARGEST_RADIANS = 6.6
"""Largest joint in radians; larger numbers are degrees."""
_LEAST_POSTURES = 3
_LOADS = frozenset(("force", "moment", "load point", "mass"))
"""Kinds of numbers that may be the same in all rows."""
_SEPARATORS = re.compile(r"[\W_]+")
_MOST_NAMED = 3
"""Most names in a message."""


@dataclass(frozen=True)
class JoinedTables:
    """Tables whose rows are in one order, as far as names tell, and notes for the user."""

    tables: tuple[NumberTable, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _NamedTable:
    """A table with the names of its rows."""

    table: NumberTable
    names: tuple[RowName, ...]
    was_averaged: bool = False  # whether rows with the same names became one row
    was_united: bool = False  # whether lines with the joints of a posture became one row

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Names of observations in order of appearance; none if rows have no names."""
        return tuple(dict.fromkeys(name.label for name in self.names if name.label is not None))

    @cached_property
    def keys(self) -> tuple[RowName, ...]:
        """Names of the rows of a posture, in order of appearance, without labels."""
        return tuple(dict.fromkeys(name._replace(label=None) for name in self.names))

    @property
    def has_positions(self) -> bool:
        """Return whether columns may be the coordinates of a point."""
        return len(find_units_of_coordinates(self.table)) >= len("xyz")

    @property
    def rows_of_label(self) -> dict[str | None, list[int]]:
        """Label → rows that have it, in order of appearance."""
        rows: dict[str | None, list[int]] = {}
        for row, name in enumerate(self.names):
            rows.setdefault(name.label, []).append(row)
        return rows

    @property
    def rows_of_name(self) -> dict[RowName, list[int]]:
        """Name → rows that have it, in order of appearance."""
        rows: dict[RowName, list[int]] = {}
        for row, name in enumerate(self.names):
            rows.setdefault(name, []).append(row)
        return rows


def join_tables(tables: Sequence[NumberTable], options: ImportOptions) -> JoinedTables:
    """Put the rows of all tables in the order of the observations of the table of joints, by their names.

    Rows of a posture follow each other. Rows without names keep their order.

    Raises:
        ImportFileError: an observation lacks a row that others have, or a row occurs twice.
    """
    first = _choose_first(tables, options)
    labels = () if first is None else _name(first, options).labels
    named = [_name(table, options, () if table is first else labels) for table in tables]
    named = [_unite_joints(each, options.joint_tolerance, named) for each in named]
    named = [_spell_as(each, labels) for each in named]
    joined = [each for each in named if _shares_labels(each, labels)]
    kept = _choose_labels(joined, labels)
    for each in named:
        _refuse_states_left_out(each, kept if each in joined else labels)
    arranged = []
    for each in named:
        own_labels = kept if each in joined else each.labels
        arranged.append(_arrange(each, own_labels, options))
    arranged = _arrange_alike(named, arranged)
    notes = _describe(joined, kept)
    if any(each.was_averaged for each in named):
        notes.append("the mean of repeated readings")
    if any(each.was_united for each in named):
        notes.append("the mean of the joints of a posture in several lines")
    return JoinedTables(tuple(arranged), tuple(notes))


def label_by_joints(
    tables: Sequence[NumberTable], joints: JointColumns, options: ImportOptions
) -> list[NumberTable] | None:
    """Return tables with the numbers of the postures, as the joints tell them, as the names of their rows.

    None unless the rows of all tables have the same names of states in the same order, but no names of
    postures, and most postures have all states.
    """
    names_of_table = [name_rows(table, options) for table in tables]
    states = [name.state for name in names_of_table[0]]
    are_alike = all([name.state for name in names] == states for names in names_of_table)
    if not are_alike or any(name.label is not None for names in names_of_table for name in names):
        return None
    table = find_table(tables, joints.table)
    postures = number_postures(table.table.numbers[:, list(joints.columns)])
    states_of_posture: dict[int, set[str | None]] = {}
    for posture, state in zip(postures.tolist(), states, strict=True):
        states_of_posture.setdefault(posture, set()).add(state)
    complete = [own for own in states_of_posture.values() if own == set(states)]
    have_states = None not in states and len(set(states)) > 1
    if not have_states or len(complete) < max(_LEAST_POSTURES, len(states_of_posture) / 2):
        return None
    stated = replace(table, table=replace(table.table, joints=joints.columns))
    labels = [str(posture + 1) for posture in postures]
    return [(stated if each is table else each).add_labels(labels) for each in tables]


def _name(table: NumberTable, options: ImportOptions, labels: Sequence[str] = ()) -> _NamedTable:
    """Return a table with the names of its rows."""
    names = _omit_repeat_numbers(table, name_rows(table, options, labels))
    named = _NamedTable(table, _name_after_unloading(names))
    is_mean_stated = options.mean_of_repeats or table.has_repeats
    if named.labels and len(named.keys) > 1 and (is_mean_stated or _has_clear_repeats(named)):
        named = _average_repeats(named)
    return _equal_joints(named, options.joint_tolerance)


def _unite_joints(named: _NamedTable, tolerance: float, named_tables: Sequence[_NamedTable]) -> _NamedTable:
    """Return a table of joints without positions with one row a posture, if several lines have its joints.

    A controller logs several lines a stop, without and under load. Joints are the mean, and the other numbers
    those under load. Joints that differ by more than noise, or by `tolerance` [deg], stay several rows, as do
    lines with the states of points that another of the tables has at each stop.
    """
    table, joints = named.table, list(named.table.table.joints)
    rows_of_label = named.rows_of_label
    is_possible = joints and len(named.labels) >= _LEAST_POSTURES and None not in rows_of_label
    if not is_possible or named.has_positions or min(map(len, rows_of_label.values())) < 2:
        return named
    have_states = all(name.state is not None for name in named.names)
    if have_states and any(
        len(_list_targets_of_stops(each, len(named.names))) > 1 for each in named_tables if each is not named
    ):
        return named
    numbers = table.table.numbers
    limit = max(_convert_tolerance(tolerance, numbers[:, joints]), find_joint_noise(numbers[:, joints]))
    chosen, means = list[int](), list[FloatArray]()
    for rows in rows_of_label.values():
        if not np.ptp(numbers[rows][:, joints], axis=0).max() <= limit:
            return named
        chosen.append(next((row for row in rows if named.names[row].state == "loaded"), rows[0]))
        means.append(numbers[rows][:, joints].mean(axis=0))
    first_rows = replace(
        table,
        rows=tuple(table.rows[row] for row in chosen),
        table=replace(table.table, numbers=numbers[chosen]),
    )
    united = first_rows.replace_numbers(dict(zip(joints, np.array(means).T, strict=True)))
    return _NamedTable(united, tuple(RowName(label) for label in rows_of_label), was_united=True)


def _convert_tolerance(tolerance: float, joints: FloatArray) -> float:
    """Return a difference [deg] in the unit of joints (N, n)."""
    is_in_degrees = np.nanmax(np.abs(joints)) > _LARGEST_RADIANS
    return tolerance if is_in_degrees else float(np.radians(tolerance))


def _omit_repeat_numbers(table: NumberTable, names: Sequence[RowName]) -> Sequence[RowName]:
    """Return names without targets that only count the repeats of a reading: `P3_loaded_2`.

    The rows that such targets tell apart are nearer to each other than any two targets.
    """
    without = _NamedTable(table, tuple(name._replace(target=None) for name in names))
    is_stated = table.find_column("target") is not None
    are_repeats_only = len(set(names)) == len(names) and not is_stated and _has_clear_repeats(without)
    return without.names if are_repeats_only else names


def _has_clear_repeats(named: _NamedTable) -> bool:
    """Return whether rows with the same names, all with a label and a state, are repeats by their numbers."""
    have_names = all(name.label is not None and name.state is not None for name in named.names)
    return have_names and are_repeats(named.table, list(named.rows_of_name.values()))


def _spell_as(named: _NamedTable, labels: Sequence[str]) -> _NamedTable:
    """Return a table with its labels spelt as in the table of joints, if only leading zeros differ.

    If no label is in both tables, labels with the same number are the same, if most are: `P07` and `pose 7`,
    but not `7` and `p70`. Labels stay as they are if two of a table differ by leading zeros, or words, only.
    """
    if set(named.labels) <= set(labels):
        return named
    by_zeros = _list_spellings(named, labels, omit_zeros)
    has_common = any(omit_zeros(label) in set(map(omit_zeros, labels)) for label in named.labels)
    by_numbers = _list_spellings(named, labels, find_number)
    are_most = 2 * len(by_numbers) > min(len(labels), len(named.labels))
    spellings = by_numbers if are_most and not has_common else by_zeros
    names = tuple(
        name if name.label is None else name._replace(label=spellings.get(name.label, name.label))
        for name in named.names
    )
    return replace(named, names=names)


def _list_spellings(named: _NamedTable, labels: Sequence[str], fold: Callable[[str], str]) -> dict[str, str]:
    """Return label of a table → label of the table of joints that `fold` makes equal.

    None are equal if two labels of a table are.
    """
    spelling = {fold(label): label for label in labels}
    own = {fold(label): label for label in named.labels}
    is_clear = len(spelling) == len(labels) and len(own) == len(named.labels)
    return {own[key]: spelling[key] for key in own.keys() & spelling.keys()} if is_clear else {}


def _choose_first(tables: Sequence[NumberTable], options: ImportOptions) -> NumberTable | None:
    """Return the table with names of rows whose observations give the order.

    This is the table of joints with most observations, or else that with most columns.
    """

    def rate(named: _NamedTable) -> tuple[int, int]:
        has_joints = named.table.find_column("joint") is not None
        return len(named.labels) if has_joints else 0, named.table.table.size[1]

    named = [each for each in (_name(table, options) for table in tables) if each.labels]
    return max(named, key=rate).table if named else None


def _shares_labels(named: _NamedTable, labels: Sequence[str]) -> bool:
    """Return whether rows of a table have names of the observations.

    Points of several states that are numbered throughout, such as 1 to 20 of 10 observations, do not: half of
    their numbers, or more, are no observation, and they are a multiple of the observations.
    """
    own = set(named.labels)
    common = own & set(labels)
    is_numbered_throughout = len(own) > len(labels) > 0 and len(own) % len(labels) == 0
    return bool(common) and not (is_numbered_throughout and 2 * len(common) <= len(own))


def _choose_labels(joined: Sequence[_NamedTable], labels: Sequence[str]) -> tuple[str, ...]:
    """Return the observations, in order, that all tables have, but for some that tables of readings lack.

    If a table has all joints, a table in which each row has its own name may lack an observation that is read
    in another table.

    Raises:
        ImportFileError: most observations of a table are not in another table.
    """
    sets = [set(each.labels) for each in joined]
    has_joints = any(each.table.table.joints and set(labels) <= set(each.labels) for each in joined)
    needed = [set(each.labels) for each in joined if not has_joints or len(set(each.names)) < len(each.names)]
    of_readings = set[str]().union(*(each.labels for each in joined if each.has_positions))
    kept = tuple(
        label
        for label in labels
        if all(label in own for own in needed) and (label in of_readings or not of_readings)
    )
    for each, own in zip(joined, sets, strict=True):
        for other in joined:
            lacking = [label for label in other.labels if label not in own]
            if 2 * len(lacking) > len(other.labels):
                raise _build_lacking_error(each.table, other.table, lacking)
    return kept


def _refuse_states_left_out(named: _NamedTable, kept: Sequence[str]) -> None:
    """Raise an `ImportFileError` if rows that are left out have names of observations and a word behind.

    Such a word may be a state: positions under load are never left out without a question.
    """
    words = list_words_behind([label for label in named.labels if label not in set(kept)], kept)
    if words:
        listed = " and ".join(map(quote, words))
        raise ImportFileError(
            Place(named.table.grid.file),
            f"points whose names end with {listed} would be left out: a state may have this name",
            f"state it by `state_words`, such as {quote(words[-1])} as `loaded`; or remove these points",
            "state_words",
            tuple(words),
        )


def _build_lacking_error(table: NumberTable, other: NumberTable, lacking: Sequence[str]) -> ImportFileError:
    """Return the error that a table lacks rows that another table has."""
    listed = _list_names(lacking)
    return ImportFileError(
        Place(table.grid.file),
        f"{listed} of {quote(other.name)} has no row here",
        "add the rows, or spell names alike in all files",
    )


def _list_names(names: Sequence[str]) -> str:
    """Return the first names of a list in words."""
    others = len(names) - _MOST_NAMED
    listed = ", ".join(map(quote, names[:_MOST_NAMED]))
    return f"{listed} and {others} more" if others > 0 else listed


def _describe(joined: Sequence[_NamedTable], kept: Sequence[str]) -> list[str]:
    """Return what a person should know of the order of rows."""
    notes = []
    files = {each.table.grid.file for each in joined}
    sources = "files" if len(files) == len(joined) else "tables"
    if len(joined) > 1:
        notes.append(f"rows of the {sources} joined by their names")
    kept_labels = set(kept)
    of_all = dict.fromkeys(label for each in joined for label in each.labels)
    left_out = [label for label in of_all if label not in kept_labels]
    if joined and left_out:
        notes.append(f"left out, as not all {sources} have them: {_list_names(left_out)}")
    return notes


def _arrange(named: _NamedTable, labels: Sequence[str], options: ImportOptions) -> NumberTable:
    """Return a table with the rows of a posture in turn, in the order of the labels.

    Raises:
        ImportFileError: an observation lacks a row that others have, or a row occurs twice.
    """
    if labels and len(set(named.names)) < len(named.names):
        _refuse_unknown_states(named, options)
    if labels:
        named = _add_missing_rows(named, labels)
    order = _order_by_labels(named, labels) if labels else _order_by_keys(named)
    if order is None:
        return named.table
    table = named.table
    rows = tuple(table.rows[row] for row in order)
    solver_table = replace(table.table, numbers=table.table.numbers[order])
    turn = named.keys if len(named.keys) > 1 else ()
    return replace(table, rows=rows, table=solver_table, turn=turn, labels=tuple(labels))


def _arrange_alike(named: Sequence[_NamedTable], arranged: Sequence[NumberTable]) -> list[NumberTable]:
    """Return the tables, those without names in the order of the only table with as many rows and states.

    Rows in blocks keep their order, as do tables whose own names tell the rows of a posture apart. Several
    rows of a stop of a log, one of each target, follow the row of the stop.
    """
    ordered = list(arranged)
    for number, each in enumerate(named):
        own_rows = each.table.rows
        models = [
            (other, table, targets)
            for other, table in zip(named, arranged, strict=True)
            if other is not each
            and table.turn
            and set(map(id, table.rows)) == set(map(id, other.table.rows))
            and (targets := _list_targets_of_stops(each, len(table.rows)))
        ]
        has_names = len(each.keys) > 1 or 1 < len(each.labels) < len(own_rows)
        if has_names or len(models) != 1:
            continue
        ((other, table, targets),) = models
        position = {id(row): place for place, row in enumerate(other.table.rows)}
        stops = [position[id(row)] for row in table.rows]
        count, size = len(table.turn), len(targets)
        are_in_blocks = sorted(stops[::count]) == list(range(len(stops) // count)) and count < len(stops)
        if size == 1 and are_in_blocks:
            continue
        order = [size * stop + place for stop in stops for place in range(size)]
        turn = tuple(
            name if target is None else name._replace(target=target)
            for name in table.turn
            for target in targets
        )
        solver_table = replace(each.table.table, numbers=each.table.table.numbers[order])
        rows = tuple(own_rows[row] for row in order)
        ordered[number] = replace(each.table, rows=rows, table=solver_table, turn=turn)
    return ordered


def _list_targets_of_stops(named: _NamedTable, count: int) -> list[str | None]:
    """Return the target of each row of a stop, of a table with as many rows for each of `count` stops.

    One row of each stop has no target. Several rows of a stop have a number that no other stop has, and one
    word each that recurs in all stops, such as `M1` and `M2` of `M1_007` and `M2_007`; [] of other names.
    """
    if len(named.names) == count:
        return [None]
    if any(name.state is not None for name in named.names):
        return []
    size, rest = divmod(len(named.names), count)
    labels = [name.label for name in named.names if name.label is not None]
    if size < 2 or rest or len(labels) < len(named.names):
        return []
    words = [frozenset(_SEPARATORS.split(label)) for label in labels]
    of_stops = [frozenset.intersection(*words[row : row + size]) for row in range(0, len(words), size)]
    of_all = frozenset.intersection(*words)
    are_numbered = all(any(map(str.isdecimal, own - of_all)) for own in of_stops)
    targets = [list(frozenset.intersection(*words[place::size]) - of_all) for place in range(size)]
    are_named = all(len(own) == 1 for own in targets) and len({own[0] for own in targets if own}) == size
    is_clear = are_numbered and len(set(of_stops)) == count and are_named
    return [own[0] for own in targets] if is_clear else []


def _name_after_unloading(names: Sequence[RowName]) -> tuple[RowName, ...]:
    """Return names in which a second row without load, with one under load between both, is after unloading.

    Rows under load that come first are followed by repeats of the row without load.
    """
    was_loaded_since: dict[tuple[str | None, str | None], bool] = {}  # since the first row without load
    named = []
    for name in names:
        posture = name.label, name.target
        if name.state == "loaded" and posture in was_loaded_since:
            was_loaded_since[posture] = True
        is_without_load = name.state == "unloaded" and name.label is not None
        is_after = is_without_load and was_loaded_since.get(posture, False)
        if is_without_load:
            was_loaded_since.setdefault(posture, False)
        named.append(name._replace(state="unloaded_after") if is_after else name)
    return tuple(named)


def _average_repeats(named: _NamedTable) -> _NamedTable:
    """Return a table in which rows with the same names are one row, with the means of their numbers.

    Raises:
        ImportFileError: a repeated position is far from the mean, or a column tells states or loads.
    """
    rows_of_name = named.rows_of_name
    if len(rows_of_name) == len(named.names):
        return named
    table, numbers = named.table, named.table.table.numbers
    groups = list(rows_of_name.values())
    telling = find_telling_column(table, groups)
    if telling is not None and names_load_or_state(table.headers[telling]):
        raise _build_telling_error(named, next(group for group in groups if len(group) > 1), telling)
    sizes_of_units = find_units_of_coordinates(table)
    for group in groups:
        _refuse_states_as_repeats(table, group)
        _refuse_far_repeats(table, group, sizes_of_units)
    means = np.array([numbers[group].mean(axis=0) for group in groups])
    first_rows = replace(
        table,
        rows=tuple(table.rows[group[0]] for group in groups),
        table=replace(table.table, numbers=means),
    )
    moved = [
        column
        for column in range(means.shape[1])
        if np.isfinite(means[:, column]).all()
        and not np.array_equal(means[:, column], table.table.numbers[[group[0] for group in groups], column])
    ]
    averaged = first_rows.replace_numbers({column: means[:, column] for column in moved})
    return _NamedTable(averaged, tuple(rows_of_name), was_averaged=True)


def _refuse_far_repeats(table: NumberTable, rows: Sequence[int], sizes_of_units: Mapping[int, float]) -> None:
    """Raise an `ImportFileError` if a repeated coordinate is far from the mean of all repeats.

    Args:
        table: numbers of a file.
        rows: indices of the repeats.
        sizes_of_units: size of the unit [m] of each column of coordinates.
    """
    for column, size in sizes_of_units.items():
        farthest = measure_distance(table, rows, column, size)
        if farthest > MOST_REPEAT:
            raise ImportFileError(
                table.grid.place(table.rows[rows[0]], column),
                f"repeated readings are {1e3 * farthest:.2g} mm from their mean",
                "remove the wrong reading; the mean is used of readings within 0.1 mm",
            )


def _equal_joints(named: _NamedTable, tolerance: float) -> _NamedTable:
    """Return a table in which the joints of a posture are those of its row without load, if they agree.

    `tolerance` is the greatest difference [deg] of a joint.
    """
    table = named.table
    joints = list(table.table.joints)
    rows_of_label: dict[str, list[int]] = {}
    for row, name in enumerate(named.names):
        if name.label is not None:
            rows_of_label.setdefault(name.label, []).append(row)
    if not joints or len(rows_of_label) in (0, len(named.names)):
        return named
    numbers = table.table.numbers[:, joints].copy()
    limit = _convert_tolerance(tolerance, numbers)
    for rows in rows_of_label.values():
        first = next((row for row in rows if named.names[row].state == "unloaded"), rows[0])
        if np.abs(numbers[rows] - numbers[first]).max() <= limit:
            numbers[rows] = numbers[first]
    if np.array_equal(numbers, table.table.numbers[:, joints]):
        return named
    equal = table.replace_numbers({column: numbers[:, number] for number, column in enumerate(joints)})
    return replace(named, table=equal)


def _order_by_labels(named: _NamedTable, labels: Sequence[str]) -> list[int] | None:
    """Return the rows in the order of their labels, and of what they tell of a posture.

    None for rows that nothing tells apart, several of a posture: they keep their order.

    Raises:
        ImportFileError: an observation lacks a row that others have, or a row occurs twice.
    """
    row_of_name: dict[RowName, int] = {}
    for row, name in enumerate(named.names):
        if name in row_of_name and len(named.keys) > 1:
            raise _build_repeat_error(named, row, name)
        row_of_name.setdefault(name, row)
    if len(row_of_name) < len(named.names):
        return _order_repeated(named, labels)
    names = [key._replace(label=label) for label in labels for key in named.keys]
    gaps = [name for name in names if name not in row_of_name]
    if gaps:
        raise _build_gap_error(named, gaps, len(labels))
    return [row_of_name[name] for name in names]


def _add_missing_rows(named: _NamedTable, labels: Sequence[str]) -> _NamedTable:
    """Return a table with a row for each reading that less than half of the observations lack.

    Such a row is that of another reading of the observation, without the numbers in which readings in one
    state differ. An observation without any row gets rows without readings. Names that occur twice, or that
    most observations lack, are left to the errors about them.
    """
    known = set(named.names)
    if len(known) < len(named.names):
        return named
    gaps = [key._replace(label=label) for label in labels for key in named.keys]
    gaps = [gap for gap in gaps if gap not in known]
    own_labels = set(named.labels)
    gaps_of_key = Counter(gap._replace(label=None) for gap in gaps if gap.label in own_labels)
    is_possible = all(2 * count < len(labels) for count in gaps_of_key.values())
    if not gaps or not is_possible:
        return named
    table = named.table
    rows, numbers = list(table.rows), [table.table.numbers]
    for gap in gaps:
        row, own = _copy_row(named, gap) if gap.label in own_labels else _build_row(named, gap)
        rows.append(row)
        numbers.append(own[np.newaxis])
    solver_table = replace(table.table, numbers=np.vstack(numbers))
    filled = replace(table, rows=tuple(rows), table=solver_table)
    return replace(named, table=filled, names=(*named.names, *gaps))


def _copy_row(named: _NamedTable, gap: RowName) -> tuple[Row, FloatArray]:
    """Return a row, and its numbers (m,), of another reading of an observation, without what differs."""
    table = named.table
    of_label = [row for row, name in enumerate(named.names) if name.label == gap.label]
    like = next((row for row in of_label if named.names[row].state == gap.state), of_label[0])
    differs = _find_different_columns(named, gap)
    cells = tuple("" if differs[column] else cell for column, cell in enumerate(table.rows[like].cells))
    return replace(table.rows[like], cells=cells), np.where(differs, np.nan, table.table.numbers[like])


def _build_row(named: _NamedTable, gap: RowName) -> tuple[Row, FloatArray]:
    """Return a row, and its numbers (m,), of an observation without any row: its name, and no reading.

    Texts and loads that all such rows have alike are those of this row.
    """
    table = named.table
    like = [row for row, name in enumerate(named.names) if name._replace(label=gap.label) == gap]
    names, numbers = [named.names[row].label for row in like], table.table.numbers[like]
    cells, kept = list[str](), list[bool]()
    for column, meaning in enumerate(table.meanings):
        texts = [table.rows[row].cells[column] for row in like]
        is_load = meaning is not None and meaning.kind in _LOADS
        are_alike = len(set(texts)) == 1 < len(texts)
        kept.append(are_alike and (is_load or bool(np.isnan(numbers[:, column]).all())))
        cells.append((gap.label or "") if texts == names else texts[0] if kept[-1] else "")
    return replace(table.rows[like[0]], cells=tuple(cells)), np.where(kept, numbers[0], np.nan)


def _find_different_columns(named: _NamedTable, gap: RowName) -> BoolArray:
    """Return for each column (m,) whether its numbers differ between a reading and others of its state.

    The observations with all readings show the columns.
    """
    numbers = named.table.table.numbers
    differs = np.zeros(numbers.shape[1], dtype=np.bool_)
    rows_of_label: dict[str | None, list[int]] = {}
    for row, name in enumerate(named.names):
        if name.state == gap.state:
            rows_of_label.setdefault(name.label, []).append(row)
    groups = [rows for rows in rows_of_label.values() if len(rows) > 1]
    for rows in groups:
        differs |= np.ptp(np.nan_to_num(numbers[rows]), axis=0) > 0.0
    if not groups:  # one reading in each state: all states of an observation show the columns
        return _find_columns_of_states(named)
    return differs


def _find_columns_of_states(named: _NamedTable) -> BoolArray:
    """Return for each column (m,) whether its numbers differ between the rows of an observation."""
    numbers = named.table.table.numbers
    differs = np.zeros(numbers.shape[1], dtype=np.bool_)
    for label in named.labels:
        rows = [row for row, name in enumerate(named.names) if name.label == label]
        differs |= np.ptp(np.nan_to_num(numbers[rows]), axis=0) > 0.0
    return differs


def _order_repeated(named: _NamedTable, labels: Sequence[str]) -> list[int] | None:
    """Return rows that nothing but their order tells apart, in the order of their labels.

    None if observations have different numbers of rows.
    """
    rows_of_label: dict[str | None, list[int]] = {}
    for row, name in enumerate(named.names):
        rows_of_label.setdefault(name.label, []).append(row)
    counts = {len(rows_of_label.get(label, ())) for label in labels}
    if len(counts) != 1:
        return None
    return [row for label in labels for row in rows_of_label[label]]


def _order_by_keys(named: _NamedTable) -> list[int] | None:
    """Return the rows of each posture in turn, if each row of a posture occurs as often as the others.

    The first rows of each kind are the first posture. None if nothing tells the rows of a posture apart.
    """
    rows_of_key: dict[RowName, list[int]] = {key: [] for key in named.keys}
    for row, name in enumerate(named.names):
        rows_of_key[name._replace(label=None)].append(row)
    counts = {len(rows) for rows in rows_of_key.values()}
    if len(rows_of_key) < 2 or len(counts) != 1:
        return None
    return [row for rows in zip(*rows_of_key.values(), strict=True) for row in rows]


def _refuse_unknown_states(named: _NamedTable, options: ImportOptions) -> None:
    """Raise an `ImportFileError` if two words of a column may be the states of rows with the same names.

    The remedy names the word first that more likely means without load.
    """
    words = find_unknown_states(named.table, options)
    if not words:
        return
    listed = " and ".join(map(quote, words))
    likely = tuple(sorted(words, key=_rate_as_unloaded, reverse=True))
    unloaded, loaded = map(quote, likely)
    raise ImportFileError(
        Place(named.table.grid.file),
        f"{listed} may be words for states",
        "state `force`, along which the targets move under load, or both words by `state_words`, such as "
        f"{unloaded} as `unloaded` and {loaded} as `loaded`",
        "state_words",
        likely,
    )


def _refuse_states_as_repeats(table: NumberTable, rows: Sequence[int]) -> None:
    """Raise an `ImportFileError` if the names of repeats differ by a word that may be a state.

    Repeats may differ by numbers and times, and by cells below headers that are known.
    """
    for column in range(len(table.headers)):
        words = find_different_words(table, column, rows)
        if words:
            raise _build_words_error(table, rows[1], column, words)


def _build_words_error(table: NumberTable, row: int, column: int, words: tuple[str, ...]) -> ImportFileError:
    """Return the error that words of rows with the same names may be states."""
    listed = " and ".join(map(quote, words))
    unloaded = max(reversed(words), key=_rate_as_unloaded)
    return ImportFileError(
        table.grid.place(table.rows[row], column),
        f"rows with the same names differ by {listed}, which may be words for states",
        "state `force`, along which the targets move under load, or the words by `state_words`, such as "
        f"{quote(unloaded)} as `unloaded`; or leave out the rows of one word",
        "state_words",
        (unloaded, *(word for word in words if word != unloaded)),
    )


def _rate_as_unloaded(word: str) -> int:
    """Return how likely a word means without load: the greatest number is that of a word that says so."""
    rating_of_state: dict[State | None, int] = {"unloaded": 2, "loaded": -1}
    return rating_of_state.get(find_state(word, {}), int(is_likely_unloaded(word)))


def _build_repeat_error(named: _NamedTable, row: int, name: RowName) -> ImportFileError:
    """Return the error that a row of a posture occurs twice."""
    table = named.table
    rows = [number for number, other in enumerate(named.names) if other == name]
    for column in range(len(table.headers)):
        words = find_different_words(table, column, rows)
        if words:
            return _build_words_error(table, row, column, words)
    if are_far_apart(table, [rows], LEAST_BETWEEN_TARGETS):
        return ImportFileError(
            table.grid.place(table.rows[row]),
            f"{quote(name.label or '')} has several rows{_describe_key(name)} in different places",
            "name the target of each row in a column with the header `target`, or state this column in "
            "`columns`, such as NAME=target",
            "columns",
        )
    telling = find_telling_column(table, list(named.rows_of_name.values()))
    if telling is not None:
        return _build_telling_error(named, rows, telling)
    return ImportFileError(
        table.grid.place(table.rows[row]),
        f"{quote(name.label or '')} has this row twice{_describe_key(name)}",
        "remove or rename one of the two rows, or use `mean_of_repeats` for repeated readings",
        "mean_of_repeats",
    )


def _build_telling_error(named: _NamedTable, rows: Sequence[int], column: int) -> ImportFileError:
    """Return the error that rows with the same names differ by a column that may be a state or a load."""
    table, name = named.table, named.names[rows[0]]
    first, second = (table.rows[row].cells[column] for row in rows[:2])
    header = collapse_blanks(table.headers[column]) or f"column {column + 1}"
    return ImportFileError(
        table.grid.place(table.rows[rows[1]], column),
        f"{quote(name.label or '')} has this row twice{_describe_key(name)}, with {quote(first)} and "
        f"{quote(second)} of {quote(header)}, which may be states or loads",
        f"state this column by `columns`, such as {header}=state, and its values by `state_words`, such as "
        f"{first}=unloaded and {second}=loaded; or leave out the rows of other values",
        "columns",
    )


def _build_gap_error(named: _NamedTable, gaps: Sequence[RowName], count: int) -> ImportFileError:
    """Return the error that postures lack rows that others have, or have a row that most postures lack.

    Args:
        named: table with the names of its rows.
        gaps: names of the rows that are missing.
        count: number of the postures.
    """
    gaps_of_key = Counter(gap._replace(label=None) for gap in gaps)
    rare, lacking = gaps_of_key.most_common(1)[0]
    if 2 * lacking > count:
        return _build_rare_error(
            named, rare, [gap for gap in gaps if 2 * gaps_of_key[gap._replace(label=None)] < count]
        )
    gap = gaps[0]
    return ImportFileError(
        Place(named.table.grid.file),
        f"{quote(gap.label or '')} has no row{_describe_key(gap)}, but other observations have one",
        "add the row, or remove the other rows of this observation",
    )


def _build_rare_error(named: _NamedTable, rare: RowName, usual_gaps: Sequence[RowName]) -> ImportFileError:
    """Return the error that few postures have a row, whose target may be misspelt.

    Args:
        named: table with the names of its rows.
        rare: names of the row, without a label.
        usual_gaps: names of the missing rows that most postures have.
    """
    table = named.table
    rows = [row for row, name in enumerate(named.names) if name._replace(label=None) == rare]
    row, name = rows[0], named.names[rows[0]]
    having = _list_names([named.names[each].label or "" for each in rows])
    reason = f"only {having} {'has' if len(rows) == 1 else 'have'} a row{_describe_key(rare)}"
    remedy = "correct the name of this row, leave the row out, or add such a row to all observations"
    meant = [gap.target for gap in usual_gaps if gap.target and gap._replace(target=rare.target) == name]
    if rare.target and meant:
        target = get_close_matches(rare.target, meant, n=1, cutoff=0.0)[0]
        gap = name._replace(target=target)
        reason += (
            f", and {quote(name.label or '')} has no row{_describe_key(gap)}, which most observations have"
        )
        cell = next((cell for cell in table.rows[row].cells if rare.target in cell), rare.target)
        renamed = cell.replace(rare.target, target)
        remedy = (
            f"if {quote(target)} was read, rename {quote(cell)} to {quote(renamed)}; else leave this row "
            "out, and add the row that is missing"
        )
    return ImportFileError(table.grid.place(table.rows[row]), reason, remedy)


def _describe_key(name: RowName) -> str:
    """Return what tells the rows of a posture apart, in words."""
    mass = None if name.mass is None else f"{name.mass:g} kg"
    words = [word for word in (name.target, name.state, mass) if word]
    return f" of {' '.join(words)}".replace("_", " ") if words else ""
