"""Table of readings with headers that the import understands, written from a robot's proposal."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.service.importing.formats.yaml_rows import is_named_yaml
from jointstiff.service.importing.grammar import Kind, Meaning
from jointstiff.service.importing.grid import COMMENT_MARKS, remove_thousands_separators
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.proposals.names.naming import NamedReading, Uncertainty
from jointstiff.service.proposals.tables.deflections import Deflection
from jointstiff.service.proposals.tables.kinds import KEPT_KINDS
from jointstiff.service.proposals.tables.numbers import NumberTable, find_table
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.table import METRES, AngleUnit

_DIGITS: Final = 9
_MARKS: Final = "".join({*"".join(COMMENT_MARKS), " "})
"""Signs at the beginning of a comment."""
_WITH_COMMA: Final = re.compile(r"[-+]?[0-9]*,[0-9]*(?:[eE][-+]?[0-9]+)?")
"""Number with a decimal comma."""


@dataclass(frozen=True)
class _LoadCase:
    """Readings of all postures under one load, which are a row of the written table for each posture."""

    readings: Sequence[NamedReading]
    mass: float | None  # of the load [kg]; None if no name states it
    load: str  # in words; empty if no name states it
    row: int  # row of each posture of the table of joints that has the force
    is_only_one: bool  # whether no other load was read

    @property
    def suffix(self) -> str:
        """Words behind the label of an observation; empty if there is one load only."""
        return "" if self.is_only_one or not self.load else f" {self.load}"


def write_readings(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], *, with_masses: bool
) -> SourceFile:
    """Write a table with a row for each posture and load, with the columns that the import understands.

    Numbers are copied as they are written. Positions in another frame than R0 are turned into R0. Positions
    in cm, and joints that are counted otherwise, are converted. With `with_masses`, loads that names state
    are the masses that hang at the load point.
    """
    cases = [
        {head: cells for head, *cells in _write_case(proposal, case, tables, with_masses=with_masses)}
        for case in _list_cases(proposal, named, tables)
    ]
    headers = list(dict.fromkeys(head for columns in cases for head in columns))
    text = io.StringIO()
    writer = csv.writer(text, delimiter=";", lineterminator="\n")
    writer.writerow(headers)
    for columns in cases:
        empty = [""] * len(columns["label"])  # for a target that was not read under this load
        writer.writerows(zip(*(columns.get(head, empty) for head in headers), strict=True))
    return SourceFile(_name_table(tables[0]), text.getvalue().encode(), is_table=True)


def write_deflections(
    joints: NumberTable, unit: AngleUnit | None, deflections: Sequence[Deflection]
) -> SourceFile:
    """Write a table with joints that headers name, and displacements under load without positions.

    The unit of the joints is None if it is not known.
    """
    count = len(deflections[0].shifts)
    rows = list(range(0, len(joints.rows), len(joints.rows) // count))
    columns = [["label", *(joints.labels or map(str, range(1, count + 1)))]]
    for number, column in enumerate(joints.table.joints, 1):
        header = f"J{number}" if unit is None else f"J{number} [{unit}]"
        columns.append([header, *(_write_cell(joints, row, column) for row in rows)])
    columns += _keep_named(joints, rows, KEPT_KINDS)
    for each in deflections:
        for axis, numbers in zip("xyz", each.shifts.T, strict=True):
            cells = ["" if np.isnan(number) else repr(round(float(number), _DIGITS)) for number in numbers]
            columns.append([f"{each.target} deflection {axis} [mm]", *cells])
    text = io.StringIO()
    csv.writer(text, delimiter=";", lineterminator="\n").writerows(zip(*columns, strict=True))
    return SourceFile(_name_table(joints), text.getvalue().encode(), is_table=True)


def _name_table(table: NumberTable) -> str:
    """Return the name of the written table: that of the file, unless this is the name of YAML."""
    name = table.grid.file
    return f"{table.stem}.csv" if is_named_yaml(name) else name


def list_masses(named: Sequence[NamedReading]) -> list[float | None]:
    """Return the different loads [kg] of the readings under load; None for a load that no name states."""
    return list(dict.fromkeys(each.mass for each in named if each.state == "loaded"))


def _list_cases(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable]
) -> Iterator[_LoadCase]:
    """Yield the readings of each load, with those without load; one case without any load."""
    joints = find_table(tables, proposal.joints.table)
    usual_row = joints.find_loaded_row(proposal.joints.groups)
    loads = list(dict.fromkeys(each.load for each in named if each.state == "loaded")) or [""]
    for load in loads:
        readings = [each for each in named if each.state != "loaded" or each.load == load]
        loaded = [each for each in readings if each.state == "loaded"]
        mass = loaded[0].mass if loaded else None
        own_rows = [
            each.reading.index for each in loaded if each.reading.points.table == proposal.joints.table
        ]
        yield _LoadCase(readings, mass, load, own_rows[0] if own_rows else usual_row, len(loads) == 1)


def _write_case(
    proposal: Proposal, case: _LoadCase, tables: Sequence[NumberTable], *, with_masses: bool
) -> list[list[str]]:
    """Return the columns of the readings under one load."""
    joints = find_table(tables, proposal.joints.table)
    head, *labels = _write_labels(proposal, joints)
    columns = [[head, *(f"{label}{case.suffix}" for label in labels)], *_write_joints(proposal, joints)]
    if with_masses and case.mass is not None:
        columns.append(["mass [kg]", *(f"{case.mass:g}" for _ in labels)])
    columns += _keep_columns(proposal, joints, case.row, with_masses=with_masses)
    for each in case.readings:
        table = find_table(tables, each.reading.points.table)
        columns += _write_positions(proposal, each, table)
        if each.uncertainty is not None:
            columns += _write_uncertainty(proposal, each, each.uncertainty, table)
    return columns


def _pick_rows(proposal: Proposal, table: NumberTable, row: int = 0) -> list[int]:
    """Return a row of each posture of the table of joints."""
    rows = np.arange(len(table.rows), dtype=np.float64)[:, None]
    return [int(each) for each in proposal.joints.groups.split(rows)[:, row, 0]]


def _write_labels(proposal: Proposal, table: NumberTable) -> list[str]:
    """Return the column of labels: the file's names if they differ, else numbers.

    A name is written without a mark such as `##` before it, which would make a comment of its row.
    """
    rows = _pick_rows(proposal, table)
    column = table.find_column("name")
    names = list(table.labels)
    if len(names) != len(rows) and column is not None:
        names = [table.rows[row].cells[column] for row in rows]
    labels = [name.lstrip(_MARKS) for name in names]
    if len(labels) == len(rows) and all(labels) and len(set(labels)) == len(labels):
        return ["label", *labels]
    return ["label", *(str(number) for number in range(1, len(rows) + 1))]


def _write_joints(proposal: Proposal, table: NumberTable) -> Iterator[list[str]]:
    """Yield a column for each joint, from base to flange, as the robot's maker counts.

    Numbers are copied as they are written, unless the rows of a posture differ: then their mean is written.
    """
    joints, robot = proposal.joints, proposal.robots[0].robot
    rows = _pick_rows(proposal, table)
    numbers = joints.groups.split(table.table.numbers[:, list(joints.columns)]).mean(axis=1)
    slides = robot.prismatic & (np.percentile(np.abs(numbers), 90.0, axis=0) > 20.0)
    units = np.where(robot.prismatic, np.where(slides, "mm", "m"), joints.unit)
    if joints.counting.is_own and _measure_spread(proposal, table) > 0.0:
        texts = [[repr(round(float(each), _DIGITS)) for each in column] for column in numbers.T]
    elif joints.counting.is_own:
        texts = [[_write_cell(table, row, column) for row in rows] for column in joints.columns]
    else:
        texts = _convert_joints(proposal, numbers)
    for number, (unit, cells) in enumerate(zip(units, texts, strict=True), 1):
        yield [f"J{number} [{unit}]", *cells]


def note_mean_of_joints(proposal: Proposal, table: NumberTable) -> list[str]:
    """Return the note that the mean of the joints of a posture is read, if those of its rows differ."""
    spread = _measure_spread(proposal, table)
    if spread == 0.0:
        return []
    unit = "°" if proposal.joints.unit == "deg" else " rad"
    return [f"the joints of the rows of a posture differ by up to {spread:.1g}{unit}: their mean was taken"]


def _measure_spread(proposal: Proposal, table: NumberTable) -> float:
    """Return the greatest difference of a joint of the rows of a posture, in the unit of the joints."""
    joints = proposal.joints.groups.split(table.table.numbers[:, list(proposal.joints.columns)])
    return float(np.ptp(joints, axis=1).max())


def _convert_joints(proposal: Proposal, numbers: FloatArray) -> list[list[str]]:
    """Return the cells of joints (N, n) of revolute joints, converted to the maker's way of counting."""
    joints, robot = proposal.joints, proposal.robots[0].robot
    angles = np.radians(numbers) if joints.unit == "deg" else numbers
    model = angles @ joints.counting.matrix.T + joints.counting.offset
    counted = robot.joint_map.controller_angles(model)
    shown = np.degrees(counted) if joints.unit == "deg" else counted
    return [[repr(round(float(each), _DIGITS)) for each in column] for column in shown.T]


def _keep_columns(
    proposal: Proposal, table: NumberTable, row: int, *, with_masses: bool
) -> Iterator[list[str]]:
    """Yield the columns of the table of joints that names explain and a campaign needs, such as forces.

    Args:
        proposal: meaning of the columns.
        table: table of joints.
        row: row of each posture that has the force.
        with_masses: whether the masses of loads have a column of their own.
    """
    kinds = KEPT_KINDS - ({"mass"} if with_masses else set())
    used = {column for column in range(len(table.headers)) if _is_used(proposal, table, column)}
    yield from _keep_named(table, _pick_rows(proposal, table, row), kinds, used)


def _keep_named(
    table: NumberTable, rows: Sequence[int], kinds: Collection[Kind], used: Collection[int] = ()
) -> Iterator[list[str]]:
    """Yield the columns of some kinds that headers name, but not those that are `used` otherwise.

    Forces along one axis only are 0 along the others. Moments of 0 without a unit are left out.
    """
    used = {*used, *_list_empty_moments(table)}
    for column, meaning in enumerate(table.meanings):
        if meaning is not None and meaning.kind in kinds and column not in used:
            cells = (table.rows[row].cells[column] for row in rows)
            yield [_head(table.headers[column], meaning), *(_write_point(cell, table) for cell in cells)]
    if table.force_is_along_one_axis:
        ((axis, column),) = table.find_force_columns().items()
        unit = "" if (meaning := table.meanings[column]) is None else meaning.unit
        for other in {0, 1, 2} - {axis}:
            header = f"force {'xyz'[other]} [{unit}]" if unit else f"force {'xyz'[other]}"
            yield [header, *("0" for _ in rows)]


def _list_empty_moments(table: NumberTable) -> list[int]:
    """Return the columns of moments if all of these are 0 and have no unit: the unit then says nothing."""
    moments = [
        column for column, each in enumerate(table.meanings) if each is not None and each.kind == "moment"
    ]
    has_unit = any(each is not None and each.kind == "moment" and each.unit for each in table.meanings)
    return [] if has_unit or table.table.numbers[:, moments].any() else moments


def _head(header: str, meaning: Meaning) -> str:
    """Return the header of a column that is kept, as the import understands it."""
    if meaning.unit:
        return f"{meaning} [{meaning.unit}]"
    return header if header and not meaning.guessed else str(meaning)


def _is_used(proposal: Proposal, table: NumberTable, column: int) -> bool:
    """Return whether a column of the table of joints has joints or positions."""
    of_points = {
        used for each in proposal.readings if each.points.table == table.name for used in each.points.columns
    }
    return column in of_points or column in proposal.joints.columns


def _write_positions(proposal: Proposal, named: NamedReading, table: NumberTable) -> Iterator[list[str]]:
    """Yield the columns x, y and z of a target in a state."""
    reading = named.reading
    rows = _list_rows(named, table)
    state = named.state.replace("_", " ")
    must_convert = _must_convert(proposal)
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


def _list_rows(named: NamedReading, table: NumberTable) -> list[int]:
    """Return the row of a reading in each posture."""
    numbers = np.arange(len(table.rows), dtype=np.float64)[:, None]
    of_postures = named.reading.points.groups.split(numbers)[:, named.reading.index, 0]
    return [int(row) for row in of_postures]


def _must_convert(proposal: Proposal) -> bool:
    """Return whether positions are turned into R0, or in cm, so that they are written in mm."""
    return proposal.unit == "cm" or not proposal.is_in_base_frame


def _write_uncertainty(
    proposal: Proposal, named: NamedReading, uncertainty: Uncertainty, table: NumberTable
) -> Iterator[list[str]]:
    """Yield the columns of expanded uncertainties of a target in a state; of a point, if axes are turned."""
    must_convert = _must_convert(proposal)
    unit = "mm" if must_convert else proposal.unit
    rows = _list_rows(named, table)
    values = uncertainty.metres / METRES[unit] * table.table.numbers[rows][:, list(uncertainty.columns)]
    known = _find_known(table.table.numbers[rows][:, list(named.reading.points.columns)])
    if must_convert:
        values = np.linalg.norm(values, axis=1, keepdims=True)
    axes = "xyz" if values.shape[1] == len("xyz") else " "
    name = f"{named.target} {named.state.replace('_', ' ')} U95"
    for axis, numbers in zip(axes, values.T, strict=True):
        cells = (repr(round(float(number), _DIGITS)) for number in numbers)
        texts = (cell if is_known else "" for cell, is_known in zip(cells, known, strict=True))
        yield [f"{name} {axis}".strip() + f" [{unit}]", *texts]


def _is_complete(positions: FloatArray) -> bool:
    """Return whether all positions (N, 3) have three numbers."""
    return bool(np.isfinite(positions).all())


def _find_known(positions: FloatArray) -> list[bool]:
    """Return which positions (N, 3) have three numbers."""
    known = np.isfinite(positions)
    return [bool(row.all()) for row in known]


def _write_cell(table: NumberTable, row: int, column: int) -> str:
    """Return the digits of a cell as written, with a decimal point alone; empty without a number."""
    if np.isnan(table.table.numbers[row, column]):
        return ""
    return _write_point(table.rows[row].cells[column], table)


def _write_point(text: str, table: NumberTable) -> str:
    """Return a number as written, with a decimal point alone; other texts unchanged."""
    digits = remove_thousands_separators(text, table.mark)
    is_number_with_comma = table.mark == "comma" and _WITH_COMMA.fullmatch(digits)
    return digits.replace(",", ".") if is_number_with_comma else digits
