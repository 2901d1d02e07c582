"""The mapping of a meaning that a robot found, with the doubts that numbers cannot settle."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from jointstiff.schemas.imports import (
    FORCE_UNITS,
    ColumnUnit,
    Doubt,
    Mapping,
    Placement,
    Role,
    RoleName,
    RowPoint,
    State,
    TableMapping,
)
from jointstiff.service.imports.layout import Layout, Source
from jointstiff.service.imports.loads import (
    Columns,
    Displaced,
    ForceEvidence,
    compare_names,
    compare_zeros,
    pair_readings,
)
from jointstiff.service.imports.mapping import find_roles, list_columns, name_columns, name_tables
from jointstiff.service.imports.structure import Pivot
from jointstiff.service.imports.tables import Column, Table
from jointstiff.service.imports.template import read_unit
from jointstiff.solver.meaning.proposal import Proposal, TargetReading
from jointstiff.solver.mechanics.robot import KnownRobot

_LOAD: Final = re.compile(r"(\d+(?:\.\d+)?)\s*(N|daN|kN|kgf|lbf|kg)?(?![^\W_])")
"""Size of a load in a word, with a unit."""
_STATES: Final[tuple[State, ...]] = ("unloaded", "loaded", "unloaded_after")
_LARGEST_SLIDE: Final = 20.0
"""Position of a prismatic joint from which the position is in mm, as `solver.meaning` reads it."""
_BY_ROW: Final = len(_STATES)
"""State of readings whose row says the load."""
_NUMBERS: Final[tuple[RoleName, ...]] = ("joints", "position", "displacement", "value", "force", "mass")


@dataclass(frozen=True, eq=False)
class Finding:
    """Meaning that a robot found with one grouping of the rows."""

    known: KnownRobot  #: robot that was measured
    proposal: Proposal
    layout: Layout
    fitting: frozenset[tuple[str, int]]  #: columns of all positions that fit, also of nominal ones

    @property
    def share(self) -> float:
        """Fraction of the positions that fit."""
        return self.proposal.fitting / max(self.proposal.count, 1)

    @property
    def sentence(self) -> str:
        """Sentence of the robot about the positions."""
        own = self.proposal
        rival = 1e3 * own.next_residual
        others = f"next meaning: {rival:.2g} mm" if np.isfinite(rival) else "no other meaning fits"
        frame = "" if own.is_in_base_frame else " in a frame of the instrument"
        fit = f"{own.fitting} of {own.count} positions fit{frame} to {1e3 * own.residual:.2g} mm"
        return f"{self.known.name}: {fit} ({others})"

    def find_source_columns(self, pivot: int) -> set[str]:
        """Return the columns of a table that are joints or positions, also nominal ones."""
        joints = self.proposal.joints
        used = self.layout.find_sources(joints)
        used += [self.layout.sources[table][column] for table, column in self.fitting]
        return {source.column for source in used if source.pivot == pivot}


def write_mapping(found: Finding, stated: Mapping) -> Mapping:
    """Write the mapping of a meaning, with doubts for what a person must confirm."""
    evidence = ForceEvidence.of(found.proposal, found.layout, found.known.robot, stated, found.fitting)
    writer = _Writer(found, evidence)
    loads = writer.find_row_loads()
    force = None if loads else evidence.find_force()
    if not loads and force is None and stated.force is None:
        mass = writer.find_mass()
        loads = [mass] if mass is not None else []
        if loads:
            writer.evidence = replace(evidence, stated=np.array([0.0, 0.0, -1.0]))
    force, writer.displaced = writer.evidence.find_displacements(force)
    states_are_in_rows = bool(loads) and (loads[0].states_rows or not any(pair_readings(found.proposal)))
    writer.order_states(force, is_mass=bool(loads), are_in_rows=states_are_in_rows)
    parts = [writer.write_table(number, force) for number in range(len(found.layout.pivots))]
    for load in loads:
        roles = [
            each
            for each in parts[load.pivot].roles
            if not set(list_columns(each)) & set(list_columns(load.role))
        ]
        parts[load.pivot] = parts[load.pivot].model_copy(update={"roles": [*roles, load.role]})
    if any(role.words for part in parts for role in find_roles(part, "load", "mass")):
        writer.doubts = [doubt for doubt in writer.doubts if doubt.about != "states"]
    writer.add_doubts(parts)
    parts = [each for part in parts for each in _split_files(part)]
    frame = None
    if not found.proposal.is_in_base_frame:
        x, y, z = (1e3 * found.proposal.frame.origin).tolist()
        frame = Placement(rotation=found.proposal.frame.rotation.tolist(), origin=(x, y, z))
    kept = [part for part in parts if find_roles(part, *_NUMBERS)]
    return stated.model_copy(
        update={
            "tables": name_tables(kept, sum(len(part.table) for part in parts)),
            "frame": frame,
            "doubts": writer.doubts,
        }
    )


@dataclass(frozen=True)
class _Load:
    """Column of loads that is found next to the readings."""

    pivot: int
    role: Role
    states_rows: bool  #: whether the load of a row says the state of its positions


@dataclass
class _Writer:
    """Roles of the columns of a meaning."""

    found: Finding
    evidence: ForceEvidence
    readings: list[TargetReading] = field(default_factory=list)
    displaced: list[Displaced] = field(default_factory=list)
    doubts: list[Doubt] = field(default_factory=list)

    def order_states(self, force: Columns | None, *, is_mass: bool, are_in_rows: bool) -> None:
        """Find which readings are under load; `are_in_rows`: the load of a row says its state."""
        votes = {
            compare_names(self._name(first), self._name(second))
            for first, second in pair_readings(self.found.proposal)
        }
        vote = votes.pop() if len(votes) == 1 else 0
        ordered = self.evidence.order_states(force, vote, is_mass=is_mass)
        self.readings = ordered.readings
        if are_in_rows:
            self.readings = [replace(each, state=_BY_ROW) for each in ordered.readings]
        elif ordered.question:
            proposal = replace(self.found.proposal, readings=tuple(ordered.readings))
            first, second = next(pair_readings(proposal))
            text = ordered.question.format(self._describe(first), self._describe(second))
            self.doubts.append(Doubt(about="states", text=text))
        if self.found.proposal.doubt:
            self.doubts.append(
                Doubt(about="axes", text=f"{self.found.proposal.doubt}: is the mapping right?")
            )

    def _name(self, reading: TargetReading) -> str:
        """Return the words of a reading: those of its rows, and of its headers."""
        sources = self.found.layout.find_sources(reading.points)
        pivot = self.found.layout.find_pivot(reading)
        headers = [pivot.structure.table.column(source.column).header for source in sources]
        return " ".join([*pivot.combos[sources[0].combo], *dict.fromkeys(headers)])

    def _describe(self, reading: TargetReading) -> str:
        """Return columns and words of a reading for a question."""
        columns = name_columns([source.column for source in self.found.layout.find_sources(reading.points)])
        row = f"row {reading.index + 1} of a posture" if reading.points.groups.count > 1 else ""
        words = ", ".join(filter(None, (self._name(reading)[:60].strip(), row)))
        return f"{columns} ({words})" if words else columns

    def _list_free(self, number: int) -> list[int]:
        """Return the numbers of the columns of a table that are neither joints nor positions."""
        used = self.found.find_source_columns(number)
        columns = self.found.layout.pivots[number].columns
        return [i for i, name in enumerate(columns) if name not in used]

    def find_row_loads(self) -> list[_Load]:
        """Return the columns of forces or loads that are zero in one state of each target only."""
        pairs = list(pair_readings(self.found.proposal))
        if not pairs or not all(self._are_other_rows(*pair) for pair in pairs):
            return []
        number = self.found.layout.find_sources(pairs[0][0].points)[0].pivot
        pivot = self.found.layout.pivots[number]
        free = self._list_free(number)
        runs = [free[i : i + width] for width in (3, 1) for i in range(len(free) - width + 1)]
        for run in (run for run in runs if run[-1] - run[0] == len(run) - 1):
            columns = [pivot.columns[i] for i in run]
            unit = _find_force_unit(pivot, columns[0])
            sizes = np.unique(np.abs(pivot.numbers[:, :, run[0]]))
            is_zero_in_one = all(
                compare_zeros(*(self.found.layout.read_neighbours(each, run) for each in pair))
                for pair in pairs
            )
            if is_zero_in_one and (unit or len(run) > 1 or len(sizes) > 2):
                name: RoleName = "force" if len(run) > 1 else "mass" if unit == "kg" else "load"
                role = Role(columns=name_columns(columns), role=name, unit=unit)
                return [_Load(number, role, states_rows=True)]
        return []

    def _are_other_rows(self, first: TargetReading, second: TargetReading) -> bool:
        """Return whether two readings are the same columns of a table in other rows."""
        own, other = (self.found.layout.find_sources(each.points)[0] for each in (first, second))
        is_other_row = (own.combo, first.index) != (other.combo, second.index)
        return own.pivot == other.pivot and own.column == other.column and is_other_row

    def find_mass(self) -> _Load | None:
        """Return the column in kg whose weights explain the deflections, or that is next to single states."""
        are_single = not any(True for _ in pair_readings(self.found.proposal))
        for number, pivot in enumerate(self.found.layout.pivots):
            for i in self._list_free(number):
                name = pivot.columns[i]
                numbers = pivot.numbers[:, :, i]
                if _find_force_unit(pivot, name) != "kg" or not (numbers > 0.0).any():
                    continue
                if are_single or self.evidence.hangs(np.nanmax(numbers, axis=1)):
                    role = Role(columns=name, role="mass", unit="kg")
                    return _Load(number, role, states_rows=False)
        return None

    def write_table(self, number: int, force: Columns | None) -> TableMapping:
        """Write the roles of one table, or of the tables that were stacked."""
        pivot = self.found.layout.pivots[number]
        structure = pivot.structure
        own = [each for each in self.readings if self._sources(each)[0].pivot == number]
        roles: list[Role] = []
        if structure.label is not None:
            roles.append(Role(columns=structure.label, role="label"))
        roles += self._write_joints(number)
        if force is not None:
            sources = [self.found.layout.sources[force.table][column] for column in force.columns]
            if sources[0].pivot == number:
                columns = [source.column for source in sources]
                unit = _find_force_unit(pivot, columns[0])
                roles.append(Role(columns=name_columns(columns), role="force", unit=unit))
        roles += self._write_keys(pivot, own)
        roles += self._write_positions(pivot, own)
        targets_of: dict[tuple[str, ColumnUnit], list[int]] = {}
        for each in self.displaced:
            sources = [
                self.found.layout.sources[each.columns.table][column] for column in each.columns.columns
            ]
            if sources[0].pivot == number:
                names = name_columns([source.column for source in sources])
                targets_of.setdefault((names, each.unit), []).append(each.target)
        for (names, unit), targets in targets_of.items():
            target = f"T{targets[0]}" if len(targets) == 1 else None
            roles.append(Role(columns=names, role="displacement", target=target, unit=unit))
        groups = [each.points.groups for each in own if each.points.groups.count > 1]
        cycle = []
        if groups:
            by_index = {each.index: each for each in own}
            cycle = [
                _write_point(by_index[i]) if i in by_index else RowPoint(state="ignore")
                for i in range(groups[0].count)
            ]
        return TableMapping(
            table=list(dict.fromkeys(_list_table_names(pivot))),
            roles=roles,
            order=groups[0].order if groups else "rows",
            cycle=cycle,
            split=structure.splits,
        )

    def _sources(self, reading: TargetReading) -> list[Source]:
        return self.found.layout.find_sources(reading.points)

    def _write_joints(self, number: int) -> Iterator[Role]:
        """Yield the roles of the joints; joints that slide have a role of their own, with their unit."""
        joints = self.found.proposal.joints
        sources = self.found.layout.find_sources(joints)
        if sources[0].pivot != number:
            return
        numbers = self.found.layout.get(joints.table).numbers[:, list(joints.columns)]
        sizes = np.nanmax(np.abs(numbers), axis=0)
        units: list[ColumnUnit] = []
        for slides, size in zip(self.found.known.robot.prismatic, sizes, strict=True):
            units.append(("mm" if size > _LARGEST_SLIDE else "m") if slides else joints.unit)
        start = 0
        for end in range(1, len(units) + 1):
            if end == len(units) or units[end] != units[start]:
                yield Role(
                    columns=name_columns([source.column for source in sources[start:end]]),
                    role="joints",
                    unit=units[start],
                    counting=None if joints.counting.is_own else joints.counting.name,
                )
                start = end

    def _write_positions(self, pivot: Pivot, own: Sequence[TargetReading]) -> Iterator[Role]:
        """Yield a role for each position, with the target and the state that all its rows have.

        In a table with a row for each coordinate, a column has the positions, and another one the axes.
        """
        axis = pivot.structure.axis
        if axis and own:
            place = pivot.structure.keys.index(axis)
            words = [pivot.combos[source.combo][place] for source in self._sources(own[0])]
            yield Role(columns=axis, role="axis", words=dict(zip(words, "xyz", strict=True)))
        points_of: dict[str, list[RowPoint]] = {}
        for reading in own:
            names = [source.column for source in self._sources(reading)]
            columns = names[0] if axis else name_columns(names)
            points_of.setdefault(columns, []).append(_write_point(reading))
        for columns, points in points_of.items():
            targets, states = {point.target for point in points}, {point.state for point in points}
            state = points[0].state if len(states) == 1 else None
            yield Role(
                columns=columns,
                role="value" if axis else "position",
                target=points[0].target if len(targets) == 1 else None,
                state=None if state == "ignore" else state,
                unit=self.found.proposal.unit,
            )

    def _write_keys(self, pivot: Pivot, own: Sequence[TargetReading]) -> Iterator[Role]:
        """Yield the roles of columns whose words tell targets and states of rows apart."""
        point_of = {source.combo: _write_point(each) for each in own for source in self._sources(each)}
        for place, key in enumerate(pivot.structure.keys):
            if key == pivot.structure.axis:
                continue
            points: dict[str, list[RowPoint]] = {}
            for combo, words in enumerate(pivot.combos):
                of_word = points.setdefault(words[place], [])
                if combo in point_of and point_of[combo] not in of_word:
                    of_word.append(point_of[combo])
            header = pivot.structure.table.column(key).header
            yield _write_key(key, points, header) if own else Role(columns=key, role="ignore")

    def add_doubts(self, parts: Sequence[TableMapping]) -> None:
        """Add a doubt for tables, columns and rows that no role reads."""
        unread: list[str] = []
        for pivot, part in zip(self.found.layout.pivots, parts, strict=True):
            table = pivot.structure.table
            if find_roles(part, *_NUMBERS):
                unread += _list_unread(table, part)
            else:
                unread.append(table.name)
            for role in part.roles:
                words = [word for word, meaning in role.words.items() if meaning == "ignore"]
                if words:
                    unread.append(f"rows with {', '.join(words)} in column {role.columns}")
        if unread:
            text = f"not read: {'; '.join(unread)[:1_000]}: is this right?"
            self.doubts.append(Doubt(about="columns", text=text))


def _list_unread(table: Table, part: TableMapping) -> Iterator[str]:
    """Yield neighbouring columns without a role: numbers, and words that several rows have."""
    read = {name for role in part.roles for name in list_columns(role)}
    unread: list[Column] = []
    for column in table.columns:
        count = len(set(column.words))
        may_mean = bool(column.numbers.any()) if column.is_numeric else 1 < count < table.row_count
        is_unread = column.is_own and may_mean and not any(_is_part(name, column.id) for name in read)
        if is_unread:
            unread.append(column)
        if unread and (not is_unread or column is table.columns[-1]):
            yield f"{name_columns([each.id for each in unread])} ({unread[0].header or 'no header'})"
            unread = []


def _is_part(name: str, column: str) -> bool:
    """Return whether a role names a column, or a part of its words."""
    return name.split(".")[0] == column


def _split_files(part: TableMapping) -> Iterator[TableMapping]:
    """Yield a part for each file whose name alone tells target and state, so that each has its own roles."""
    key = next((role for role in part.roles if role.columns == "file"), None)
    if key is None or key.role not in ("state", "target", "point"):
        yield part
        return
    for table in part.table:
        meaning = key.words.get(table, table)
        target, _, last = meaning.rpartition(" ")
        is_state = last in _STATES
        point = RowPoint.model_validate(
            {"target": (target if is_state else meaning) or None, "state": last if is_state else None}
        )
        roles = [_add_point(role, point) for role in part.roles if role is not key]
        if meaning != "ignore":
            yield part.model_copy(update={"table": [table], "roles": roles})


def _add_point(role: Role, point: RowPoint) -> Role:
    """Return a role of positions with the target and the state of a file."""
    if role.role not in ("position", "value"):
        return role
    return role.model_copy(update={"target": role.target or point.target, "state": role.state or point.state})


def _list_table_names(pivot: Pivot) -> list[str]:
    """Return the names of the tables that were stacked."""
    table = pivot.structure.table
    files = [column for column in table.columns if column.id == "file"]
    return files[0].words if files else [table.name]


def _find_force_unit(pivot: Pivot, column: str) -> ColumnUnit | None:
    """Return the unit of force or mass that a header has in brackets; None for another unit, or none."""
    unit = read_unit(pivot.structure.table.column(column).header)
    return unit if unit in FORCE_UNITS else None


def _write_key(key: str, points_of: dict[str, list[RowPoint]], header: str) -> Role:
    """Return the role of a column of words, by what the rows of each word are."""
    states = {word: {point.state for point in points} for word, points in points_of.items()}
    targets = {word: {point.target for point in points} for word, points in points_of.items()}
    differ_in_state = _differ(list(states.values()))
    differ_in_target = _differ(list(targets.values()))
    if differ_in_target and differ_in_state:
        words = {word: f"{p[0].target} {p[0].state}" if p else "ignore" for word, p in points_of.items()}
        return Role(columns=key, role="point", words=words)
    loads = {word: _LOAD.search(word) for word in points_of}
    sizes = {word: float(match[1]) if match else 0.0 for word, match in loads.items()}
    units = {match[2] for match in loads.values() if match and match[2]} or {read_unit(header)}
    unit = units.pop() if len(units) == 1 else None
    is_stated = unit in FORCE_UNITS and "" not in sizes
    if differ_in_state and (len(set(sizes.values()) - {0.0}) > 1 or is_stated):
        name: RoleName = "mass" if unit == "kg" else "load"
        known = {word: f"{size:g}" for word, size in sizes.items()}
        return Role.model_validate({"columns": key, "role": name, "unit": unit, "words": known})
    if differ_in_state:
        words = {word: (p[0].state or "ignore") if p else "ignore" for word, p in points_of.items()}
        return Role(columns=key, role="state", words=words)
    if differ_in_target or not all(points_of.values()):
        words = {word: "ignore" for word, p in points_of.items() if not p}
        return Role(columns=key, role="target", words=words)
    return Role(columns=key, role="ignore")


def _differ(meanings: Sequence[Set[str | None]]) -> bool:
    """Return whether each word has one meaning at most, and the words have several."""
    return all(len(each) <= 1 for each in meanings) and len(set[str | None]().union(*meanings)) > 1


def _write_point(reading: TargetReading) -> RowPoint:
    state = _STATES[reading.state] if 0 <= reading.state < len(_STATES) else None
    return RowPoint(target=f"T{reading.target}", state=state)
