"""Loads of postures that stand in other tables than the joints, such as a table of forces alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grammar import Kind
from jointstiff.service.importing.loads import find_newtons
from jointstiff.service.proposals.tables.load_columns import find_states_of_loads
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.service.proposals.tables.row_name import RowName
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.meaning.proposal import Proposal

_WORDS_OF_KIND: Final[dict[Kind, str]] = {
    "force": "the force of each posture",
    "moment": "the moment of each posture",
    "load point": "the load point of each posture",
    "mass": "weights along −z of R0",
}
"""Kinds of columns that are the load of a posture, in words."""
_SAME_LOAD: Final = 1e-6
"""Largest difference of two loads that are the same, as a part of the largest."""


class GatheredLoads(NamedTuple):
    """Tables in which the table of joints has the loads of the other tables, too."""

    tables: Sequence[NumberTable]
    notes: list[str]


def gather_loads(proposal: Proposal, tables: Sequence[NumberTable], request: ImportRequest) -> GatheredLoads:
    """Return the tables with the loads of other tables in the table of joints, and notes on them.

    A table of readings has its loads in the rows of the postures. Rows of another table have the names of the
    postures, or their order if the request states so.

    Raises:
        ImportFileError: a posture has two different loads.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    with_loads, gathered, notes = joints, list[NumberTable](), list[str]()
    for table in tables:
        rows = None if table is joints else _list_rows(proposal, table, joints, request)
        if rows is None:
            gathered.append(table)
            continue
        copied = set[int]()
        for kind in _WORDS_OF_KIND:
            columns = _list_columns(table, kind)
            if not columns:
                continue
            loads = _read_loads(table, rows, columns, kind)
            headers = ", ".join(quote(table.headers[column]) for column in columns)
            copied.update(columns)
            if kind != "load point" and not np.nan_to_num(loads).any():
                continue  # a table of readings without load
            if with_loads.has_column_of(kind):
                _refuse_other_loads(proposal, with_loads, table, kind, loads)
            else:
                with_loads = _add_loads(proposal, with_loads, table, columns, loads)
                notes.append(f"{headers} of {table.name} as {_WORDS_OF_KIND[kind]}")
        gathered.append(replace(table, copied=frozenset(copied)))
    return GatheredLoads([with_loads if each.name == joints.name else each for each in gathered], notes)


def join_forces(
    proposal: Proposal, table: NumberTable, joints: NumberTable, request: ImportRequest, forces: FloatArray
) -> FloatArray | None:
    """Return the forces (N, 3) of the rows of joints from those (rows, 3) of a table; None without a join.

    Raises:
        ImportFileError: two rows of a posture have different forces.
    """
    if table.name == joints.name:
        return forces
    rows = _list_rows(proposal, table, joints, request)
    if rows is None:
        return None
    columns = range(len(table.headers), len(table.headers) + forces.shape[1])
    return _repeat_in_rows(proposal, _read_loads(table.add_forces(forces, None), rows, columns, "force"))


def _list_columns(table: NumberTable, kind: Kind) -> list[int]:
    """Return the columns of a kind of load; none of masses that the names of the rows state."""
    if kind == "mass" and any(name.mass is not None for name in table.turn):
        return []
    return [
        column
        for column, meaning in enumerate(table.meanings)
        if meaning is not None and meaning.kind == kind and column not in table.ignored
    ]


def _list_rows(
    proposal: Proposal, table: NumberTable, joints: NumberTable, request: ImportRequest
) -> IndexArray | None:
    """Return the rows (N, k) of each posture; None if nothing tells them."""
    numbers = np.arange(len(table.rows))
    postures = len(joints.rows) // proposal.joints.groups.count
    groups = next((own.points.groups for own in proposal.readings if own.points.table == table.name), None)
    if groups is not None:
        return groups.split(numbers[:, None].astype(np.float64))[:, :, 0].astype(np.intp)
    have_names = bool(table.labels) and table.labels == joints.labels and len(table.labels) == postures
    are_in_order = request.by_order and len(numbers) == postures * max(1, len(table.turn))
    is_told = (have_names or are_in_order) and len(numbers) % postures == 0
    return numbers.reshape(postures, -1) if is_told else None


def _read_loads(table: NumberTable, rows: IndexArray, columns: Sequence[int], kind: Kind) -> FloatArray:
    """Return the load (N, m) of each posture: that of its row under load; `rows` is (N, k).

    Without names of states, a load near zero gives way, as a row without load has one; but not a load point.

    Raises:
        ImportFileError: two rows of a posture have different loads.
    """
    numbers = table.table.numbers[:, list(columns)]
    sizes = np.linalg.norm(np.nan_to_num(numbers), axis=1)
    states = find_states_of_loads(sizes) or ["loaded" if size else "unloaded" for size in sizes]
    is_load = np.array([kind == "load point" or state == "loaded" for state in states])
    is_known = [bool(own.any()) for own in np.isfinite(numbers)]
    names = table.turn or (RowName(),)  # of the rows of a posture, in turn
    chosen = list[int]()
    for of_posture in rows:
        known = [row for row in of_posture if is_known[row]]
        filled = [row for row in known if is_load[row]]
        loaded = [row for row in known if names[row % len(names)].state == "loaded"]
        first = (loaded or filled or known or list(of_posture))[0]
        for row in filled:
            if not np.array_equal(numbers[row], numbers[first], equal_nan=True):
                raise ImportFileError(
                    table.grid.place(table.rows[row], columns[0]),
                    f"the {kind} differs from that of the same posture in line {table.rows[first].line}",
                    f"write one {kind} for each posture, and 0 without load",
                )
        chosen.append(first)
    return numbers[chosen]


def _add_loads(
    proposal: Proposal,
    joints: NumberTable,
    table: NumberTable,
    columns: Sequence[int],
    loads: FloatArray,
) -> NumberTable:
    """Return the table of joints with the loads (N, m) of columns of another table in all rows."""
    headers = [table.headers[column] for column in columns]
    meanings = [table.meanings[column] for column in columns]
    return joints.add_columns(headers, meanings, _repeat_in_rows(proposal, loads)).mark_copies(joints)


def _repeat_in_rows(proposal: Proposal, loads: FloatArray) -> FloatArray:
    """Return the loads (rows, m) of the rows of joints from those (N, m) of the postures."""
    groups = proposal.joints.groups
    is_in_blocks = groups.order == "in blocks"
    return np.tile(loads, (groups.count, 1)) if is_in_blocks else np.repeat(loads, groups.count, axis=0)


def _refuse_other_loads(
    proposal: Proposal, joints: NumberTable, table: NumberTable, kind: Kind, loads: FloatArray
) -> None:
    """Refuse loads (N, m) of a table that are not those of the table of joints.

    Raises:
        ImportFileError: there is a posture with two different loads.
    """
    groups = proposal.joints.groups
    numbers = groups.split(joints.table.numbers)[:, joints.find_loaded_row(groups)]
    own, other = (
        _arrange_axes(each, _list_columns(each, kind), values)
        for each, values in (
            (joints, numbers[:, _list_columns(joints, kind)]),
            (table, loads),
        )
    )
    limit = _SAME_LOAD * max(np.abs(own).max(initial=0.0), np.abs(other).max(initial=0.0))
    is_other = (np.abs(own - other) > limit).any(axis=1)
    if is_other.any():
        posture = int(np.argmax(is_other))
        label = joints.labels[posture] if joints.labels else str(posture + 1)
        raise ImportFileError(
            Place(joints.grid.file),
            f"the {kind} of posture {quote(label)} differs from that of {quote(table.name)}",
            f"correct the {kind}, or remove it from one of the two tables",
        )


def _arrange_axes(table: NumberTable, columns: Sequence[int], values: FloatArray) -> FloatArray:
    """Return loads (N, 3) along x, y and z of the columns (m) of a table, forces in newtons."""
    arranged = np.zeros((len(values), 3))
    for column, numbers in zip(columns, values.T, strict=True):
        meaning = table.meanings[column]
        axis = 0 if meaning is None or meaning.axis is None else meaning.axis
        unit = meaning.unit if meaning is not None and meaning.dimension == "force" else None
        factor = 1.0 if unit is None else find_newtons(unit)
        arranged[:, axis] = factor * np.nan_to_num(numbers)
    return arranged
