"""Tables of a database: a row for each load and for each posture, whose keys are in the rows of readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.service.importing.grammar import Kind, Meaning, Quantity, collapse_blanks
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray

_LOADS: Final[frozenset[Kind]] = frozenset(("force", "moment", "mass"))
"""Kinds of columns that are zero without load."""
_POSITIONS: Final[frozenset[Kind]] = frozenset(("joint", "position"))
_LEAST_JOINTS: Final = 3
"""Columns of joints, at least."""


class JoinedRelations(NamedTuple):
    """Tables in which rows of readings have the loads and joints that their keys name."""

    tables: Sequence[NumberTable]
    notes: list[str]


class _Relation(NamedTuple):
    """Table with a row for each value of a key, and the columns of the key."""

    table: NumberTable
    key: int  # column of the table
    key_of_readings: int  # column of the table of readings

    @property
    def numbers(self) -> list[int]:
        """Columns of numbers other than the key."""
        known = np.flatnonzero(np.isfinite(self.table.table.numbers).all(axis=0))
        return [int(column) for column in known if column != self.key]

    def names_postures(self, readings: NumberTable) -> bool:
        """Return whether the readings have joints, which are the same in the rows of each key."""
        joints = readings.table.numbers[:, list(readings.table.joints)]
        keys = np.array(readings.list_texts(self.key_of_readings))
        return joints.size > 0 and all(np.ptp(joints[keys == key], axis=0).max() == 0.0 for key in set(keys))

    def pick_rows(self, readings: NumberTable) -> list[int]:
        """Return the row of this table for each row of the readings."""
        row_of_key = {text: row for row, text in enumerate(self.table.list_texts(self.key))}
        return [row_of_key[text] for text in readings.list_texts(self.key_of_readings)]


def join_relations(tables: Sequence[NumberTable]) -> JoinedRelations:
    """Return the tables with a table of loads, and that of joints, joined to the only table that names both.

    One of the loads is zero. Tables stay as they are if more than one table names its loads by a key, or if
    the key is that of the postures.
    """
    with_loads = [table for table in tables if _has_loads(table)]
    found = [(readings, _find_relation(readings, with_loads)) for readings in tables]
    pairs = [(readings, loads) for readings, loads in found if loads is not None]
    if len(pairs) != 1:
        return JoinedRelations(tables, [])
    ((readings, loads),) = pairs
    if loads.names_postures(readings):
        return JoinedRelations(tables, [])
    others = [table for table in tables if table is not loads.table and table is not readings]
    joined = _add_columns(readings, loads)
    joined = replace(joined, ignored=joined.ignored | {loads.key_of_readings})
    used = [loads]
    if not readings.table.joints:
        with_joints = [table for table in others if _may_have_joints(table)]
        postures = _find_relation(readings, with_joints)
        if postures is None or postures.key_of_readings == loads.key_of_readings:
            return JoinedRelations(tables, [])
        joined = _name_key(_add_columns(joined, postures), postures.key_of_readings)
        used.append(postures)
    used_tables = {id(each.table) for each in used}
    left = [table for table in tables if id(table) not in used_tables]
    notes = [
        f"{each.table.name} joined to {readings.name} by {collapse_blanks(each.table.headers[each.key])!r}"
        for each in used
    ]
    return JoinedRelations([joined if table is readings else table for table in left], notes)


def _find_relation(readings: NumberTable, tables: Sequence[NumberTable]) -> _Relation | None:
    """Return the only table, with its only key, whose rows the rows of readings name; else None.

    Both tables have the header of the key. The values of the key differ in the table, which has all values of
    the readings, and readings repeat some.
    """
    column_of_header = {
        collapse_blanks(header).casefold(): column for column, header in enumerate(readings.headers) if header
    }
    found = []
    for table in tables:
        for key, header in enumerate(table.headers):
            own = column_of_header.get(collapse_blanks(header).casefold())
            if table is readings or own is None:
                continue
            keys, named = table.list_texts(key), readings.list_texts(own)
            is_key = len(set(keys)) == len(keys) > 1 and "" not in keys
            if is_key and set(named) <= set(keys) and len(set(named)) < len(named):
                found.append(_Relation(table, key, own))
    return found[0] if len(found) == 1 else None


def _may_have_joints(table: NumberTable) -> bool:
    """Return whether a table may have the joints of postures: three columns of numbers, but no position."""
    kinds = {meaning.kind for meaning in table.meanings if meaning is not None}
    known = np.isfinite(table.table.numbers).all(axis=0)
    return "position" not in kinds and int(known.sum()) > _LEAST_JOINTS


def _has_loads(table: NumberTable) -> bool:
    """Return whether a table has loads and no postures, and one of the loads, but not all, is zero."""
    kinds = {meaning.kind for meaning in table.meanings if meaning is not None}
    loads = _list_loads(table)
    is_zero = ~loads.any(axis=1)
    return kinds.isdisjoint(_POSITIONS) and bool(loads.size and is_zero.any() and not is_zero.all())


def _list_loads(table: NumberTable) -> FloatArray:
    """Return the numbers (rows, m) of the columns of loads."""
    columns = [
        column
        for column, meaning in enumerate(table.meanings)
        if meaning is not None and meaning.kind in _LOADS and column not in table.ignored
    ]
    return np.nan_to_num(table.table.numbers[:, columns])


def _add_columns(readings: NumberTable, relation: _Relation) -> NumberTable:
    """Return the table of readings with the numbers that the other table has for the keys of its rows."""
    table, columns = relation.table, relation.numbers
    headers = [table.headers[column] for column in columns]
    meanings = [table.meanings[column] for column in columns]
    numbers = table.table.numbers[relation.pick_rows(readings)][:, columns]
    joined = readings.add_columns(headers, meanings, numbers)
    added = {column: len(readings.headers) + place for place, column in enumerate(columns)}
    joints = tuple(added[column] for column in table.table.joints) or readings.table.joints
    others = readings.table.others | {added[column] for column in table.table.others if column in added}
    return replace(joined, table=replace(joined.table, joints=joints, others=others))


def _name_key(table: NumberTable, key: int) -> NumberTable:
    """Return the table in which the column of a key names the postures."""
    meanings = list(table.meanings)
    meanings[key] = Meaning(Quantity("name"))
    return replace(table, meanings=tuple(meanings))
