"""Readings by a mapping: joints, forces and positions of each posture, in rad, N and metres.

Nothing is guessed, and nothing is left out in silence: a word where a number belongs, a vector with a gap
or a posture with two different readings is a fault.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from collections.abc import Mapping as AnyMapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Final, cast, get_args

import numpy as np

from jointstiff.schemas.imports import (
    LENGTH_UNITS,
    Mapping,
    PointState,
    Role,
    RoleName,
    RowPoint,
    State,
    TableMapping,
)
from jointstiff.service.imports.mapping import find_roles, get_factor, list_columns, read_table
from jointstiff.service.imports.tables import Table, TableError, as_word
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.hypotheses import list_countings, number_postures
from jointstiff.solver.mechanics.robot import Robot

_VECTORS: Final = frozenset(("position", "displacement", "force", "moment"))
_AXES: Final = {"x": 0, "y": 1, "z": 2, "1": 0, "2": 1, "3": 2}
_LARGEST_SPREAD: Final = 1e-4
"""Distance [m] of a repeated reading from the mean, at most: five times a tracker's noise."""
_SAME_JOINTS: Final = 3e-4
"""Difference of joints [rad or m] of rows of one posture, at most: rounding to 0.01° and noise."""
_COVERAGE: Final = 1.96
"""Factor from the standard uncertainty of a coordinate to U95; a U95 of a point is of three coordinates."""


@dataclass(frozen=True)
class Key:
    """Posture, target, state and load of a position."""

    posture: str
    target: str
    state: State | None
    load: float | None = None  #: size of the force [N]; None for the only force of a posture

    def __str__(self) -> str:
        """Return the names, as messages have them."""
        return " ".join(filter(None, (self.posture, self.target, self.state)))


@dataclass
class Readings:
    """All that a mapping reads from the tables."""

    joints: dict[str, FloatArray] = field(default_factory=dict)  #: posture → controller's joints [rad or m]
    slides: tuple[bool, ...] = ()  #: which joints are lengths, by their units
    forces: dict[tuple[str, float | None], FloatArray] = field(
        default_factory=dict
    )  #: posture, load → [N] in R0
    moments: dict[str, FloatArray] = field(default_factory=dict)  #: posture → moment [N m] in R0
    positions: dict[Key, FloatArray] = field(default_factory=dict)  #: in the frame of the file [m]
    displacements: dict[Key, FloatArray] = field(default_factory=dict)  #: under load [m]
    gauges: dict[tuple[Key, int], float] = field(default_factory=dict)  #: key, axis of R0 → displacement [m]
    uncertainties: dict[Key, FloatArray] = field(default_factory=dict)  #: standard uncertainty [m]

    @property
    def targets(self) -> list[str]:
        """Names of the targets, in the order of their readings."""
        return list(dict.fromkeys(key.target for key in self.positions))

    def list_keys(self) -> list[Key]:
        """Return the keys of all readings."""
        return [*self.positions, *self.displacements, *(key for key, _ in self.gauges)]

    def list_loads(self, posture: str) -> list[float | None]:
        """Return the loads of a posture; each load makes an observation."""
        loaded = [key.load for key in self.list_keys() if key.posture == posture and key.state == "loaded"]
        return list(dict.fromkeys(loaded)) or [None]

    def find_position(self, posture: str, target: str, state: State, load: float | None) -> FloatArray | None:
        """Return a position (3,), or None if the target was not read; unloaded states have no load."""
        return self.positions.get(Key(posture, target, state, load if state == "loaded" else None))

    def find_force(
        self, posture: str, load: float | None, stated: Sequence[float] | None
    ) -> FloatArray | None:
        """Return the force (3,) [N] of a posture under a load; None if it is not known.

        A load is along the stated force, or else its force has the direction of another load of the posture.
        """
        own = self.forces.get((posture, load), self.forces.get((posture, None)))
        if own is not None:
            return own
        if stated is None:
            return None
        direction = np.array(stated)
        return direction if load is None else load * direction / max(float(np.linalg.norm(direction)), 1e-9)


def gather(tables: Sequence[Table], mapping: Mapping, robot: Robot | None) -> Readings:
    """Read what a mapping states from tables.

    Args:
        tables: tables of files.
        mapping: meaning of the columns.
        robot: measured robot; None if only the readings are wanted.

    Raises:
        TableError: the mapping does not fit the tables, such as a posture twice with other readings.
    """
    parts = [_Part(read_table(tables, part), part) for part in mapping.tables]
    have_labels = all(find_roles(part.mapping, "label") for part in parts)
    readings = Readings()
    repeats: dict[Key, list[FloatArray]] = defaultdict(list)
    for part in parts:
        names = part.names if have_labels else part.number_names()
        part.add_joints(readings, names, robot)
        part.add_forces(readings, names)
        part.add_displacements(readings, names)
        for role in find_roles(part.mapping, "uncertainty"):
            for _, key, vector in part.list_vectors(role, names):
                sigma = vector / _COVERAGE if len(vector) > 1 else vector / (_COVERAGE * np.sqrt(3.0))
                readings.uncertainties[key] = np.broadcast_to(sigma, 3)
        for key, vector in part.list_positions(names):
            repeats[key].append(vector)
    for key, vectors in repeats.items():
        own = key
        if key.state == "unloaded_after" and replace(key, state="unloaded") not in repeats:
            own = replace(key, state="unloaded")  # the rows are in another order than the readings
        readings.positions[own] = _average(key, vectors)
    _refuse_strangers(readings)
    return readings


def _average(key: Key, vectors: Sequence[FloatArray]) -> FloatArray:
    """Return the mean (3,) of repeated readings of a position.

    Raises:
        TableError: the readings differ by more than repeats do.
    """
    mean = np.mean(vectors, axis=0)
    if np.linalg.norm(np.array(vectors) - mean, axis=1).max() > _LARGEST_SPREAD:
        reason = f"{key} occurs twice, with positions that differ by more than 0.1 mm"
        raise TableError(reason, remedy="give each row its own label, or remove the role `label`")
    return np.asarray(mean)


def _refuse_strangers(readings: Readings) -> None:
    """Refuse positions of postures without joints.

    Raises:
        TableError: names the first of these postures.
    """
    keys = readings.list_keys()
    strangers = sorted({key.posture for key in keys} - readings.joints.keys())
    if strangers:
        shown = ", ".join(strangers[:3])
        remedy = "look at the columns `label` and `joints` of all tables"
        raise TableError(f"{len(strangers)} postures have no joints: {shown}", remedy=remedy)


def _keep(kept: dict[str, FloatArray], posture: str, vector: FloatArray, what: str, largest: float) -> None:
    """Keep the vector of a posture, which must be the same in all rows of the posture.

    Raises:
        TableError: a posture has two vectors.
    """
    earlier = kept.setdefault(posture, vector)
    if np.abs(earlier - vector).max() > largest:
        raise TableError(f"posture {posture} has two different {what}", remedy="look at the column `label`")


@dataclass
class _Part:
    """One table, or several of one form, with their part of a mapping."""

    table: Table
    mapping: TableMapping

    def read(self, role: Role) -> FloatArray:
        """Return the numbers (N, m) of a role in SI units; NaN in rows without any of them.

        Raises:
            TableError: a cell is no number, or a vector has a gap.
        """
        columns = [self.table.column(name) for name in list_columns(role)]
        if role.role in _VECTORS and role.axis is None and len(columns) != len("xyz"):
            reason = f"the role {role.role} has {len(columns)} columns ({role.columns})"
            remedy = "give x, y and z, or state the `axis` of a single column"
            raise TableError(reason, where=self.table.name, remedy=remedy)
        for column in columns:
            for row, cell in enumerate(column.cells, 1):
                if isinstance(cell, str):
                    reason = f"column {column.id} has {cell[:40]!r} in row {row}, where a number belongs"
                    raise TableError(reason, where=self.table.name, remedy="correct the cell, or clear it")
        numbers = self.table.numbers([column.id for column in columns])
        gaps = np.isnan(numbers)
        partial = np.flatnonzero(gaps.any(axis=1) & ~gaps.all(axis=1))
        if len(partial):
            reason = f"columns {role.columns} have an empty cell in row {partial[0] + 1}"
            raise TableError(reason, where=self.table.name, remedy="fill in the cell, or clear the others")
        return get_factor(role) * numbers

    @cached_property
    def names(self) -> list[str]:
        """Posture of each row: its label, or a number."""
        labels = find_roles(self.mapping, "label")
        if labels:
            columns = [self.table.column(name).words for name in list_columns(labels[0])]
            return ["/".join(parts) for parts in zip(*columns, strict=True)]
        return [str(number + 1) for number in self._number_rows()]

    def number_names(self) -> list[str]:
        """Return the posture of each row as a number in the order of appearance."""
        number_of = {name: str(number) for number, name in enumerate(dict.fromkeys(self.names), 1)}
        return [number_of[name] for name in self.names]

    def _number_rows(self) -> list[int]:
        """Return the posture of each row without labels: by its joints, or by its place among the rows."""
        mapping, count = self.mapping, self.table.row_count
        if mapping.posture == "joints":
            joints = [name for role in find_roles(mapping, "joints") for name in list_columns(role)]
            return [int(number) for number in number_postures(self.table.numbers(joints))]
        if mapping.cycle and count % len(mapping.cycle):
            reason = f"{count} rows are no multiple of the {len(mapping.cycle)} rows of a posture"
            raise TableError(reason, where=self.table.name, remedy="look at the rows of the table")
        if mapping.order == "in turn":
            return [row // len(mapping.cycle) for row in range(count)]
        if mapping.order == "in blocks":
            return [row % (count // len(mapping.cycle)) for row in range(count)]
        return self._count_words()

    def _count_words(self) -> list[int]:
        """Return how often the words of each row, which name its target and state, occurred above."""
        roles = find_roles(self.mapping, "target", "state", "point", "load", "axis", "ignore")
        roles += [role for role in find_roles(self.mapping, "mass") if role.words]
        named = [self.table.column(list_columns(role)[0]).words for role in roles]
        seen: dict[tuple[str, ...], int] = defaultdict(int)
        numbers = []
        for words in list(zip(*named, strict=True)) or [()] * self.table.row_count:
            numbers.append(seen[words])
            seen[words] += 1
        return numbers

    def add_joints(self, readings: Readings, names: Sequence[str], robot: Robot | None) -> None:
        """Keep the joints of each posture, as the robot's maker counts them.

        Raises:
            TableError: a posture has two different joints, or the robot has another number of joints.
        """
        roles = find_roles(self.mapping, "joints")
        if not roles:
            return
        joints = np.hstack([self.read(role) for role in roles])
        slides = tuple(role.unit in LENGTH_UNITS for role in roles for _ in list_columns(role))
        if robot is not None and slides != tuple(robot.prismatic.tolist()):
            kinds = ["mm" if slides else "deg" for slides in robot.prismatic]
            reason = f"the joints of the robot are in {', '.join(kinds)}"
            raise TableError(
                reason, where=self.table.name, remedy="correct the roles `joints` and their units"
            )
        if robot is not None and roles[0].counting:
            joints = _count_as_maker(joints, roles[0].counting, robot)
        readings.slides = slides
        for posture, vector in zip(names, joints, strict=True):
            if np.isfinite(vector).all():
                _keep(readings.joints, posture, vector, "joints", _SAME_JOINTS)

    def add_forces(self, readings: Readings, names: Sequence[str]) -> None:
        """Keep the force and the moment of each posture, and of each load of a posture.

        Raises:
            TableError: a posture has two different forces under one load.
        """
        for posture, vector, point in zip(names, self._forces, self._points, strict=True):
            if vector is None or (self._is_state_by_force and not vector.any()):
                continue
            earlier = readings.forces.setdefault((posture, point.load), vector)
            if np.abs(earlier - vector).max() > 1e-6 * max(1.0, float(np.abs(vector).max())):
                remedy = "look at the column `label`, and at the states of the rows"
                raise TableError(f"posture {posture} has two different forces", remedy=remedy)
        for role in find_roles(self.mapping, "moment"):
            for posture, vector in zip(names, self.read(role), strict=True):
                if np.isfinite(vector).all():
                    _keep(readings.moments, posture, vector, "moments", 1e-6)

    def list_vectors(
        self, role: Role, names: Sequence[str], state: State | None = None
    ) -> Iterator[tuple[int, Key, FloatArray]]:
        """Yield row, key and vector of a role, without rows that are empty or to be ignored.

        `state` is the state of vectors that have none by their role or row.
        """
        for row, (vector, point) in enumerate(zip(self.read(role), self._points, strict=True)):
            if point.state != "ignore" and np.isfinite(vector).all():
                own: State | None = role.state or point.state or state
                load = (role.load or point.load) if own == "loaded" else None
                yield row, Key(names[row], role.target or point.target, own, load), vector

    def add_displacements(self, readings: Readings, names: Sequence[str]) -> None:
        """Keep displacements under load: vectors, and those that a gauge reads along an axis."""
        for role in find_roles(self.mapping, "displacement"):
            for _, key, vector in self.list_vectors(role, names, "loaded"):
                if role.axis:
                    readings.gauges[key, _AXES[role.axis]] = float(vector[0])
                else:
                    readings.displacements[key] = vector

    def list_positions(self, names: Sequence[str]) -> Iterator[tuple[Key, FloatArray]]:
        """Yield the positions; unloaded ones in rows below loaded ones were read after the load was gone."""
        loaded: set[tuple[str, str]] = set()
        for role in find_roles(self.mapping, "position"):
            for _, key, vector in self.list_vectors(role, names):
                if key.state == "loaded":
                    loaded.add((key.posture, key.target))
                is_after = self._is_state_by_force and (key.posture, key.target) in loaded
                own = replace(key, state="unloaded_after") if is_after and key.state == "unloaded" else key
                yield own, vector
        yield from self._list_coordinates(names)

    def _list_coordinates(self, names: Sequence[str]) -> Iterator[tuple[Key, FloatArray]]:
        """Yield the positions of a table with a row for each coordinate.

        Raises:
            TableError: a position lacks a coordinate.
        """
        found: dict[Key, dict[int, float]] = defaultdict(dict)
        for axes, values in product(find_roles(self.mapping, "axis"), find_roles(self.mapping, "value")):
            words = self.table.column(list_columns(axes)[0]).words
            for row, key, (number,) in self.list_vectors(values, names):
                axis = _AXES.get(axes.words.get(words[row], words[row]).lower())
                if axis is not None:
                    found[key][axis] = float(number)
        for key, by_axis in found.items():
            if len(by_axis) < 3:
                remedy = "look at the columns `axis` and `value`"
                raise TableError(f"{key} lacks a coordinate", where=self.table.name, remedy=remedy)
            yield key, np.array([by_axis[axis] for axis in range(3)])

    @cached_property
    def _is_state_by_force(self) -> bool:
        """Return whether the force of a row says the state of its positions: zero is without load."""
        positions = find_roles(self.mapping, "position", "value")
        has_words = bool(find_roles(self.mapping, "state", "point")) or any(
            row.state for row in self.mapping.cycle
        )
        return not has_words and any(role.state is None for role in positions)

    @cached_property
    def _forces(self) -> list[FloatArray | None]:
        """Force (3,) [N] of each row by columns of forces or masses; None without one."""
        for role in find_roles(self.mapping, "force"):
            numbers = self.read(role)
            if role.axis:
                numbers = numbers * np.eye(3)[_AXES[role.axis]]
            return [row if np.isfinite(row).all() else None for row in numbers]
        for role in find_roles(self.mapping, "mass"):
            weights = [self._read_size(role, row) for row in range(self.table.row_count)]
            return [None if weight is None else np.array([0.0, 0.0, -weight]) for weight in weights]
        return [None] * self.table.row_count

    def _read_size(self, role: Role, row: int) -> float | None:
        """Return the size of a load [N] by the cell or the word of a row; None for an empty cell.

        Raises:
            TableError: a word has no number.
        """
        word = self._read_word(role, row)
        if not word:
            return None
        try:
            return abs(float(role.words.get(word, word))) * get_factor(role)
        except ValueError:
            reason = f"the load {word!r} in column {role.columns} has no size"
            raise TableError(reason, where=self.table.name, remedy="state its size in `words`") from None

    @cached_property
    def _points(self) -> list[_RowPoint]:
        """Target, state and load of each row."""
        sizes = {f"{np.linalg.norm(row):.3g}" for row in self._forces if row is not None} - {"0"}
        return [self._read_point(row, has_loads=len(sizes) > 1) for row in range(self.table.row_count)]

    def _read_point(self, row: int, *, has_loads: bool) -> _RowPoint:
        """Return what a row says by its words, by its place in the cycle, and by its force.

        `has_loads` tells whether the table has forces of several sizes.
        """
        cycle = self.mapping.cycle
        stated = cycle[self._find_place_in_cycle(row)] if cycle else RowPoint()
        point = _RowPoint(stated.target or "T1", stated.state)
        for role in self.mapping.roles:
            word = self._read_word(role, row) if role.role in ("target", "state", "point", "load") else ""
            if role.role in ("target", "state", "point"):
                point.read(role.role, role.words.get(word, word))
            elif role.role == "load" and (size := self._read_size(role, row)) is not None:
                point.state, point.load = ("loaded", size) if size else ("unloaded", None)
        force = self._forces[row]
        if force is not None and self._is_state_by_force and point.state is None:
            size = float(np.linalg.norm(force))
            point.state = "loaded" if size else "unloaded"
            point.load = size if size and has_loads else None
        return point

    def _find_place_in_cycle(self, row: int) -> int:
        count = len(self.mapping.cycle)
        return row % count if self.mapping.order == "in turn" else row * count // self.table.row_count

    def _read_word(self, role: Role, row: int) -> str:
        return as_word(self.table.column(list_columns(role)[0]).cells[row])


@dataclass
class _RowPoint:
    """Target, state and load of the positions of a row."""

    target: str
    state: PointState | None
    load: float | None = None  #: size of the force [N]

    def read(self, kind: RoleName, meaning: str) -> None:
        """Take over target and state from the meaning of a word, such as `T1 loaded`, `T1` or `ignore`.

        Raises:
            TableError: a word of a column `state` or `point` has no meaning.
        """
        name, _, last = meaning.rpartition(" ")
        if last in get_args(PointState):
            self.state = cast("PointState", last)
            self.target = name or self.target
        elif kind == "target":
            self.target = meaning or self.target
        else:
            remedy = "state its meaning in `words`: unloaded, loaded or ignore"
            raise TableError(f"the word {meaning[:40]!r} is no state", where=kind, remedy=remedy)


def _count_as_maker(joints: FloatArray, counting: str, robot: Robot) -> FloatArray:
    """Return joints (N, n) [rad or m] as the robot's maker counts them.

    Raises:
        TableError: there is no such way of counting.
    """
    ways: AnyMapping[str, tuple[FloatArray, FloatArray]] = {
        each.name: (each.matrix, each.offset) for each in list_countings(robot)
    }
    if counting not in ways:
        raise TableError(f"joints are not counted {counting!r}", remedy=f"use one of {', '.join(ways)}")
    matrix, offset = ways[counting]
    model = joints @ matrix.T + offset
    own = robot.joint_map
    return np.asarray((model - own.offset) @ np.linalg.inv(own.matrix).T)
