"""Postures that an arm takes several times: the readings of some visits may be under load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.numbers import NumberTable, find_table
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.meaning.hypotheses import number_postures
from jointstiff.solver.meaning.proposal import Proposal, TargetReading
from jointstiff.solver.meaning.table import RowGroups

_LEAST_REPEATED: Final = 3
"""Postures that occur twice, at least: an arm returns to one posture to check the instrument."""
_LEAST_PART: Final = 0.5
"""Least part of the postures that occur twice."""
_REPEATABLE: Final = 5e-5
"""Distance [m] of two readings of a posture up to which they are repeats: noise, and the arm's return."""


def bring_visits_together(
    proposal: Proposal, tables: Sequence[NumberTable], request: ImportRequest
) -> tuple[NumberTable, ...] | None:
    """Return the tables with the rows of all visits to a posture in turn, in the order of the rows.

    None unless each visit was read as a posture in one state, the joints repeat each posture equally often,
    and the readings of a posture differ by more than noise. A request may state one state of all rows.
    """
    joints = find_table(tables, proposal.joints.table)
    postures = _number_postures(proposal, joints)
    counts = np.bincount(postures)
    visits = int(counts[0])
    are_states_known = request.state is not None or any(each.state > 0 for each in proposal.readings)
    if visits < 2 or len(counts) < _LEAST_REPEATED or (counts != visits).any() or are_states_known:
        return None
    if not _measure_distance(proposal.readings[0], postures) > _REPEATABLE:
        return None
    order = np.argsort(postures, kind="stable")
    if np.array_equal(order, np.arange(len(order))):
        return None  # the solver has seen rows in turn
    groups_of_table = {each.points.table: each.points.groups for each in proposal.readings}
    groups_of_table[joints.name] = proposal.joints.groups
    if any(table.name not in groups_of_table for table in tables):
        return None
    rows_of_table = {name: _list_rows(groups, order) for name, groups in groups_of_table.items()}
    return tuple(_reorder(each, rows_of_table[each.name], visits) for each in tables)


def separate_visits(proposal: Proposal, tables: Sequence[NumberTable]) -> list[NumberTable] | None:
    """Return the tables with each row of the joints as a posture, if each row has the states in its columns.

    The rows of a posture are then repeats, and differ less than the columns of a target do. None of other
    rows, as of those whose names state a target or a load.
    """
    joints = find_table(tables, proposal.joints.table)
    is_named = len({name.key for name in joints.turn}) > 1
    if proposal.joints.groups.count == 1 or is_named or not _are_states_in_columns(proposal):
        return None
    separate = replace(joints, table=replace(joints.table, is_grouped=False))
    return [separate if table is joints else table for table in tables]


def _are_states_in_columns(proposal: Proposal) -> bool:
    """Return whether each row of joints has several positions of a target, farther apart than its rows."""
    positions_of: dict[int, dict[tuple[str | int, ...], list[FloatArray]]] = {}
    for each in proposal.readings:
        if each.points.groups != proposal.joints.groups:
            return False
        of_columns = positions_of.setdefault(each.target, {})
        of_columns.setdefault((each.points.table, *each.points.columns), []).append(each.positions)
    for of_columns in positions_of.values():
        counts = {len(rows) for rows in of_columns.values()}
        if len(of_columns) < 2 or counts != {proposal.joints.groups.count}:
            return False
        positions = np.array(list(of_columns.values()))  # (columns, rows of a posture, N, 3)
        of_rows, of_states = (
            np.nanmedian(np.linalg.norm(np.ptp(positions, axis=axis), axis=-1)) for axis in (1, 0)
        )
        if of_rows >= of_states:
            return False
    return True


def _measure_distance(reading: TargetReading, postures: IndexArray) -> float:
    """Return the median distance [m] of the positions of repeated postures; NaN without such postures."""
    repeated = [rows for rows in _split_rows(postures) if len(rows) > 1]
    apart = [float(np.linalg.norm(np.ptp(reading.positions[rows], axis=0))) for rows in repeated]
    return float(np.nanmedian(apart)) if apart else float("nan")


def _split_rows(postures: IndexArray) -> list[IndexArray]:
    """Return the rows of each posture, in the order of the rows."""
    ends = np.cumsum(np.bincount(postures))[:-1]
    return np.split(np.argsort(postures, kind="stable"), ends)


def _number_postures(proposal: Proposal, joints: NumberTable) -> IndexArray:
    """Return the number of the posture (N,) of each group of rows of a table of joints."""
    first_rows = _list_first_rows(proposal, joints)
    return number_postures(joints.table.numbers[first_rows][:, list(proposal.joints.columns)])


def _list_first_rows(proposal: Proposal, joints: NumberTable) -> IndexArray:
    """Return the first row (N,) of each group of rows of a table of joints."""
    indices = np.arange(len(joints.rows), dtype=np.float64)[:, np.newaxis]
    return proposal.joints.groups.split(indices)[:, 0, 0].astype(np.intp)


def _list_rows(groups: RowGroups, order: IndexArray) -> IndexArray:
    """Return the rows of a table whose groups of rows come in another order."""
    rows = np.arange(groups.count * len(order), dtype=np.float64)[:, np.newaxis]
    return groups.split(rows)[order].reshape(-1).astype(np.intp)


def _reorder(table: NumberTable, rows: IndexArray, visits: int) -> NumberTable:
    """Return a table with its rows in another order, in which a posture has the rows of several visits."""
    solver_table = replace(table.table, numbers=table.table.numbers[rows])
    reordered = tuple(table.rows[row] for row in rows)
    return replace(table, rows=reordered, table=solver_table, turn=visits * table.turn, labels=())


def refuse_repeated_postures(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> None:
    """Refuse positions in one state if postures occur twice, with readings that differ by more than noise.

    Raises:
        ImportFileError: there are such postures, and the request states no state.
    """
    joints = find_table(tables, proposal.joints.table)
    states = {each.state for each in named}
    if request.state is not None or states != {"unloaded"}:
        return
    first_rows = _list_first_rows(proposal, joints)
    postures = _number_postures(proposal, joints)
    rows_of_postures = _split_rows(postures)
    repeated = [rows for rows in rows_of_postures if len(rows) > 1]
    count = len(rows_of_postures)
    if len(repeated) < max(_LEAST_REPEATED, _LEAST_PART * count):
        return
    distance = _measure_distance(named[0].reading, postures)
    if not distance > _REPEATABLE:
        return
    first, second = (joints.rows[first_rows[row]] for row in repeated[0][:2])
    raise ImportFileError(
        joints.grid.place(second),
        f"row {second.line} has the joints of row {first.line}, as in {len(repeated)} of {count} postures, "
        f"with positions {1e3 * distance:.2g} mm apart, so that some may be under load",
        'add a column with the header "state" and the word unloaded or loaded in each row; if no row is '
        "under load, give `state`",
        "state",
    )
