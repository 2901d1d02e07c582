"""Table of readings with headers that the import understands, written from a robot's proposal."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.imports import State
from jointstiff.service.importing.grammar import Meaning, find_state_in_name
from jointstiff.service.importing.grid import remove_thousands_separators
from jointstiff.service.importing.numbers import NumberTable
from jointstiff.service.importing.reading import SourceFile
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.proposal import Proposal, TargetReading

_STATES: Final[tuple[State, ...]] = ("unloaded", "loaded", "unloaded_after")
"""States of a target in the order of its positions, if no name says more."""
_KEPT_KINDS: Final = frozenset(("force", "moment", "load point", "mass", "validation", "time"))
"""Kinds of columns of the table of joints that are kept."""
_DIGITS: Final = 9


@dataclass(frozen=True)
class NamedReading:
    """Positions of a proposal with the target and the state that they are imported as."""

    reading: TargetReading
    target: str
    state: State


def name_readings(
    proposal: Proposal, tables: Sequence[NumberTable], state_words: Mapping[str, State]
) -> list[NamedReading]:
    """Name targets and states: by the headers, by the names of files, else by the order of the columns.

    Names are used only if no two readings get the same target and state.
    """
    table_of_name = {table.name: table for table in tables}
    by_headers = list[NamedReading]()
    by_files = list[NamedReading]()
    by_order = list[NamedReading]()
    for reading in proposal.readings:
        table = table_of_name[reading.points.table]
        named = _name_by_header(reading, table, state_words)
        by_headers += [] if named is None else [named]
        state = _STATES[reading.state] if reading.state < len(_STATES) else "loaded"
        by_order.append(NamedReading(reading, f"T{reading.target}", state))
        state_of_file = _find_state(table, state_words)
        by_files.append(NamedReading(reading, f"T{reading.target}", state_of_file or state))
    if len(by_headers) == len(proposal.readings) and _are_distinct(by_headers):
        return by_headers
    return by_files if _are_distinct(by_files) else by_order


def _are_distinct(readings: Sequence[NamedReading]) -> bool:
    """Return whether no two readings have the same target and state."""
    return len({(each.target, each.state) for each in readings}) == len(readings)


def _name_by_header(
    reading: TargetReading, table: NumberTable, state_words: Mapping[str, State]
) -> NamedReading | None:
    """Return the target and state that the headers of three columns name; None if they do not."""
    meanings = [table.meanings[column] for column in reading.points.columns]
    if reading.points.groups.count > 1 or any(each is None for each in meanings):
        return None
    named = {(each.kind, each.quantity.target, each.quantity.state) for each in meanings if each}
    axes = [each.axis for each in meanings if each]
    if len(named) != 1 or axes != [0, 1, 2]:
        return None
    kind, target, state = named.pop()
    state = state or _find_state(table, state_words)
    if kind != "position" or state is None:
        return None
    return NamedReading(reading, target or "T1", state)


def _find_state(table: NumberTable, state_words: Mapping[str, State]) -> State | None:
    """Return the state that the name of a table's file has; None without one."""
    return find_state_in_name(table.stem, state_words)


def write_readings(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable]
) -> SourceFile:
    """Write a table with a row for each posture, with the columns that the import understands.

    Numbers are copied as they are written. Positions in another frame than R0 are turned into R0. Positions
    in cm, and joints that are counted otherwise, are converted.
    """
    by_name = {table.name: table for table in tables}
    joints = by_name[proposal.joints.table]
    columns = [_write_labels(proposal, joints), *_write_joints(proposal, joints)]
    columns += _keep_columns(proposal, joints)
    for each in named:
        columns += _write_positions(proposal, each, by_name[each.reading.points.table])
    text = io.StringIO()
    writer = csv.writer(text, delimiter=";", lineterminator="\n")
    writer.writerows(zip(*columns, strict=True))
    return SourceFile(tables[0].grid.file, text.getvalue().encode())


def _pick_rows(proposal: Proposal, table: NumberTable) -> list[int]:
    """Return the first row of each posture of the table of joints."""
    rows = np.arange(len(table.rows), dtype=np.float64)[:, None]
    return [int(each) for each in proposal.joints.groups.split(rows)[:, 0, 0]]


def _write_labels(proposal: Proposal, table: NumberTable) -> list[str]:
    """Return the column of labels: the file's names if they differ, else numbers."""
    rows = _pick_rows(proposal, table)
    column = table.find_column("name")
    if column is not None:
        labels = [table.rows[row].cells[column] for row in rows]
        if all(labels) and len(set(labels)) == len(labels):
            return ["label", *labels]
    return ["label", *(str(number) for number in range(1, len(rows) + 1))]


def _write_joints(proposal: Proposal, table: NumberTable) -> Iterator[list[str]]:
    """Yield a column for each joint, from base to flange, as the robot's maker counts."""
    joints, robot = proposal.joints, proposal.robots[0].robot
    rows = _pick_rows(proposal, table)
    numbers = table.table.numbers[np.ix_(rows, list(joints.columns))]
    slides = robot.prismatic & (np.percentile(np.abs(numbers), 90.0, axis=0) > 20.0)
    units = np.where(robot.prismatic, np.where(slides, "mm", "m"), joints.unit)
    if joints.counting.is_own:
        texts = [[_write_cell(table, row, column) for row in rows] for column in joints.columns]
    else:
        texts = _convert_joints(proposal, numbers)
    for number, (unit, cells) in enumerate(zip(units, texts, strict=True), 1):
        yield [f"J{number} [{unit}]", *cells]


def _convert_joints(proposal: Proposal, numbers: FloatArray) -> list[list[str]]:
    """Return the cells of joints (N, n) of revolute joints, converted to the maker's way of counting."""
    joints, robot = proposal.joints, proposal.robots[0].robot
    angles = np.radians(numbers) if joints.unit == "deg" else numbers
    model = angles @ joints.counting.matrix.T + joints.counting.offset
    counted = robot.joint_map.controller_angles(model)
    shown = np.degrees(counted) if joints.unit == "deg" else counted
    return [[repr(round(float(each), _DIGITS)) for each in column] for column in shown.T]


def _keep_columns(proposal: Proposal, table: NumberTable) -> Iterator[list[str]]:
    """Yield the columns of the table of joints that names explain and a campaign needs, such as forces."""
    rows = _pick_rows(proposal, table)
    for column, meaning in enumerate(table.meanings):
        if meaning is not None and meaning.kind in _KEPT_KINDS and not _is_used(proposal, table, column):
            yield [_head(table.headers[column], meaning), *(table.rows[row].cells[column] for row in rows)]


def _head(header: str, meaning: Meaning) -> str:
    """Return the header of a column that is kept, as the import understands it."""
    return f"{meaning} [{meaning.unit}]" if meaning.unit else header


def _is_used(proposal: Proposal, table: NumberTable, column: int) -> bool:
    """Return whether a column of the table of joints has joints or positions."""
    of_points = {
        used for each in proposal.readings if each.points.table == table.name for used in each.points.columns
    }
    return column in of_points or column in proposal.joints.columns


def _write_positions(proposal: Proposal, named: NamedReading, table: NumberTable) -> Iterator[list[str]]:
    """Yield the columns x, y and z of a target in a state."""
    reading = named.reading
    groups = reading.points.groups
    rows = groups.split(np.arange(len(table.rows), dtype=np.float64)[:, None])[:, reading.index, 0].astype(
        int
    )
    state = named.state.replace("_", " ")
    must_convert = proposal.unit == "cm" or not proposal.is_in_base_frame
    positions = table.table.numbers[rows][:, list(reading.points.columns)]
    in_mm = 1e3 * proposal.frame.to_base(positions)
    for axis, column in enumerate(reading.points.columns):
        if must_convert:
            unit = "mm"
            cells = ["" if np.isnan(each) else repr(round(float(each), _DIGITS)) for each in in_mm[:, axis]]
        else:
            unit = proposal.unit
            cells = [_write_cell(table, row, column) for row in rows]
        if not _is_complete(positions):
            cells = [cell if known else "" for cell, known in zip(cells, _find_known(positions), strict=True)]
        yield [f"{named.target} {state} {'xyz'[axis]} [{unit}]", *cells]


def _is_complete(positions: FloatArray) -> bool:
    """Return whether all positions (N, 3) have three numbers."""
    return bool(np.isfinite(positions).all())


def _find_known(positions: FloatArray) -> list[bool]:
    """Return which positions (N, 3) have three numbers."""
    known = np.isfinite(positions)
    return [bool(row.all()) for row in known]


def _write_cell(table: NumberTable, row: int, column: int) -> str:
    """Return the digits of a cell as written, with a decimal point alone; empty without a number."""
    text = remove_thousands_separators(table.rows[row].cells[column], table.mark)
    if np.isnan(table.table.numbers[row, column]):
        return ""
    return text.replace(",", ".") if table.mark == "comma" else text
