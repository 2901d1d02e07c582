"""Evidence of forces and deflections: the positions under load, and the columns that are forces.

Springs yield to the force: its work from the unloaded to the loaded position is positive. The sign of a
force is easily wrong, and a wrong sign exchanges the states in silence. So the work decides alone only as a
question. A second evidence confirms it, and none is a word of a language: a name that is the other one behind
a prefix (`loaded`, `unloaded`), a number 0 in one name, numbers next to the readings that are 0 in one state,
or a weight.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from operator import attrgetter
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.imports import ColumnUnit, Mapping
from jointstiff.service.conversion.units import COLUMN_UNITS
from jointstiff.service.imports.layout import Layout
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.proposal import Proposal, TargetReading, read_positions
from jointstiff.solver.meaning.springs import DeflectedTargets
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot

_EXPLAINED: Final = 0.5
"""Largest part of the squared deflections that springs in the joints leave under the right forces."""
_BETTER: Final = 0.8
"""Part of what a stated force leaves that the forces of a column leave at most."""
_ALIKE: Final = 0.8
"""Fraction of the targets on which the force does work of one sign, if the order of the states is clear."""
_AS_FIRST: Final = 0.3
"""Movement of a third state from the first, as a part of the deflection, below which the load was gone."""
_UNITS: Final[tuple[ColumnUnit, ...]] = ("mm", "µm", "m")
"""Units in which displacements are written, the usual one first."""
_SIZES: Final = (2e-5, 2e-2)
"""Sizes [m] of displacements under load."""
_MOST_VECTORS: Final = 24
"""Vectors that may be forces or displacements, at most: each two are compared."""
_NUMBER: Final = re.compile(r"(?<![^\W_])\d+(?:[.,]\d+)?")
_WORD: Final = re.compile(r"[^\W\d_]+")
_LEAST_STEM: Final = 3
"""Letters that a name has at least behind a prefix; two of a script without an alphabet."""
UNKNOWN_STATE: Final = -1
"""State of readings that are neither of the two states nor after the load was gone."""
UNDECIDED: Final = "are the positions without load in {0}, and those under load in {1}?"
_BY_WORK: Final = "by the work of the force alone, without load are {0}, under load {1}: is this right?"
_CONTRADICTED: Final = (
    "the force pulls against the deflections if {0} are without load and {1} under load: are these states "
    "right?"
)


class Columns(NamedTuple):
    """Columns of a wide table."""

    table: str
    columns: tuple[int, ...]


class Displaced(NamedTuple):
    """Displacements of a target under load."""

    columns: Columns
    unit: ColumnUnit
    target: int
    unexplained: float  # part of the squared displacements that springs leave


class Ordered(NamedTuple):
    """Readings with the unloaded state first."""

    readings: list[TargetReading]
    question: str  # with places for the names of both states; empty if the order is sure


@dataclass(frozen=True, eq=False)
class ForceEvidence:
    """Positions of all targets in R0, and the springs that may move them."""

    proposal: Proposal
    layout: Layout
    robot: Robot
    q: FloatArray  #: (N, n)
    load_point: FloatArray  #: (3,) on the flange [m]
    stated: FloatArray | None  #: force (3,) in R0 [N]
    fitting: frozenset[tuple[str, int]]  #: columns of all positions that fit, also of nominal ones

    @classmethod
    def of(
        cls,
        proposal: Proposal,
        layout: Layout,
        robot: Robot,
        stated: Mapping,
        fitting: frozenset[tuple[str, int]],
    ) -> ForceEvidence:
        """Read the joints, and what a person stated."""
        point = 1e-3 * np.array(stated.load_point or (0.0, 0.0, 0.0))
        force = np.array(stated.force) if stated.force is not None and any(stated.force) else None
        q = read_positions(layout.get(proposal.joints.table), proposal.joints, robot)
        return cls(proposal, layout, robot, q, point, force, fitting)

    def order_states(self, force: Columns | None, first_is_free: int, *, is_mass: bool) -> Ordered:
        """Return the readings with the unloaded state first, and the question if the order is not sure.

        Args:
            force: columns of the force, if the force is not stated.
            first_is_free: 1 if the file says that the first state is without load, −1 if the second is.
            is_mass: whether the force is the weight of a mass, which has one sign.
        """
        readings = list(self.proposal.readings)
        shifts = [shift for _, shift in self._pair_states()]
        if not shifts:
            return Ordered(readings, "")
        rows = self._read_force(force) if force is not None else self.stated
        question = ""
        if rows is None:
            sign = first_is_free or 1
            question = "" if first_is_free else UNDECIDED
        else:
            work = np.concatenate(
                [np.einsum("ni,ni->n", np.broadcast_to(rows, each.shape), each) for each in shifts]
            )
            forward = float(np.mean(work[np.isfinite(work)] > 0.0))
            sign = 1 if forward >= 0.5 else -1
            is_usual = is_mass or (sign == 1 and _is_weight(rows))
            if max(forward, 1.0 - forward) < _ALIKE:
                question = UNDECIDED
            elif first_is_free == -sign:
                sign, question = first_is_free, _CONTRADICTED
            elif not first_is_free and not is_usual:
                question = _BY_WORK
        exchanged = {0: 1, 1: 0} if sign < 0 else {}
        ordered = [replace(each, state=exchanged.get(each.state, each.state)) for each in readings]
        return Ordered([self._place_third(each, ordered) for each in ordered], question)

    def _place_third(self, reading: TargetReading, readings: Sequence[TargetReading]) -> TargetReading:
        """Return a reading of a third state as unloaded if it is near the first one, else as unknown."""
        if reading.state < 2:
            return reading
        first, second = (
            next(each for each in readings if each.target == reading.target and each.state == state)
            for state in (0, 1)
        )
        gap = np.nanmedian(np.linalg.norm(reading.positions - first.positions, axis=1))
        deflection = np.nanmedian(np.linalg.norm(second.positions - first.positions, axis=1))
        is_back = reading.state == 2 and gap < _AS_FIRST * deflection
        return reading if is_back else replace(reading, state=UNKNOWN_STATE)

    def find_force(self) -> Columns | None:
        """Return the columns of the force: the triple whose springs explain the deflections best.

        Its springs must explain the deflections clearly better than a stated force.
        """
        pairs = list(self._pair_states())
        if not pairs:
            return None
        least = _EXPLAINED
        if self.stated is not None:
            least = min(least, _BETTER * self._measure(self.stated, pairs))
        best = None
        for columns in self._list_vectors():
            left = self._measure(self._read_force(columns), pairs)
            if left < least:
                best, least = columns, left
        return best

    def find_displacements(self, force: Columns | None) -> tuple[Columns | None, list[Displaced]]:
        """Return the columns of the force and of displacements, if each target was read in one state only.

        Without a known force, each pair of vectors may be force and displacements.
        """
        if any(True for _ in self._pair_states()):
            return force, []
        known = self.stated if force is None else self._read_force(force)
        forces = [(force, known)] if known is not None else []
        if known is None:
            forces = [(each, self._read_force(each)) for each in islice(self._list_vectors(), _MOST_VECTORS)]
        best, least = (force, list[Displaced]()), _EXPLAINED
        for columns, rows in forces:
            displaced = self._match_displacements(rows, columns)
            left = min((each.unexplained for each in displaced), default=1.0)
            if rows is not None and left < least:
                best, least = (columns, displaced), left
        return best

    def _match_displacements(self, rows: FloatArray, force: Columns | None) -> list[Displaced]:
        """Return the columns of displacements that springs explain under forces, at most one a reading."""
        taken = set() if force is None else set(force.columns)
        options: list[Displaced] = []
        for columns in islice(self._list_vectors(only_once=False), _MOST_VECTORS):
            numbers = self._read_force(columns)
            unit = _find_unit(numbers)
            if unit is None or taken & set(columns.columns):
                continue
            shift = COLUMN_UNITS[unit] * numbers @ self.proposal.frame.rotation.T
            source = self.layout.sources[columns.table][columns.columns[0]]
            for reading in self.proposal.readings:
                own = self.layout.find_sources(reading.points)[0]
                if own.pivot != source.pivot or own.combo == source.combo:
                    left = self._measure(rows, [(reading.positions, shift)])
                    options.append(Displaced(columns, unit, reading.target, left))
        chosen: list[Displaced] = []
        for each in sorted(options, key=attrgetter("unexplained")):
            is_free = all(
                each.target != other.target and not set(each.columns.columns) & set(other.columns.columns)
                for other in chosen
            )
            if is_free and each.unexplained < _EXPLAINED:
                chosen.append(each)
        return chosen

    def hangs(self, sizes: FloatArray) -> bool:
        """Return whether sizes (N,) are weights: only a pull along −z explains the deflections by springs."""
        pairs = list(self._pair_states())
        if not pairs or len(sizes) != len(self.q):
            return False
        own = np.repeat(sizes[:, None], len(pairs), axis=1)
        return any(self._deflect(pairs, sign).are_down(own) for sign in (1.0, -1.0))

    def _list_vectors(self, *, only_once: bool = True) -> Iterator[Columns]:
        """Yield three columns that are neither joints nor positions; `only_once`: once for each posture."""
        joints = self.proposal.joints
        used = {(joints.table, column) for column in joints.columns} | self.fitting
        for table in self.layout.tables:
            sources = self.layout.sources[table.name]
            for first in range(table.size[1] - 2):
                columns = Columns(table.name, (first, first + 1, first + 2))
                rows = self._read_force(columns)
                is_free = not used & {(table.name, column) for column in columns.columns}
                is_once = all(sources[column].is_once for column in columns.columns)
                is_complete = len(rows) == len(self.q) and bool(np.isfinite(rows).all() and rows.any())
                if is_free and is_complete and (is_once or not only_once):
                    yield columns

    def _measure(self, forces: FloatArray, pairs: Sequence[tuple[FloatArray, FloatArray]]) -> float:
        """Return the part of the squared deflections that forces (3,) or (N, 3) of any sign leave."""
        rows = np.broadcast_to(forces, (len(self.q), 3))
        own = np.repeat(rows[:, None], len(pairs), axis=1)
        left = 1.0
        for sign in (1.0, -1.0):
            targets = self._deflect(pairs, sign)
            if targets.are_enough:
                left = min(left, targets.measure_unexplained(own))
        return left

    def _deflect(self, pairs: Sequence[tuple[FloatArray, FloatArray]], sign: float) -> DeflectedTargets:
        """Return the targets at their places (N, 3) with their deflections (N, 3), times a sign."""
        places = np.stack([place for place, _ in pairs], axis=1)
        deflections = sign * np.stack([deflection for _, deflection in pairs], axis=1)
        return DeflectedTargets.of(Postures(self.robot, self.q), self.load_point, places, deflections)

    def _pair_states(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield positions (N, 3) in the first state, and deflections to the second, of each target."""
        for first, second in pair_readings(self.proposal):
            yield first.positions, second.positions - first.positions

    def _read_force(self, columns: Columns) -> FloatArray:
        return np.asarray(self.layout.get(columns.table).numbers[:, list(columns.columns)])


def pair_readings(proposal: Proposal) -> Iterator[tuple[TargetReading, TargetReading]]:
    """Yield the readings of the first and the second state of each target."""
    for target in range(1, proposal.target_count + 1):
        by_state = {each.state: each for each in proposal.readings if each.target == target}
        if 0 in by_state and 1 in by_state:
            yield by_state[0], by_state[1]


def _is_weight(rows: FloatArray) -> bool:
    """Return whether forces hang: a sign that was written, and that gravity has."""
    return bool(
        (rows[..., 2] < 0.0).all() and np.abs(rows[..., :2]).max() <= 1e-2 * np.abs(rows[..., 2]).min()
    )


def _find_unit(numbers: FloatArray) -> ColumnUnit | None:
    """Return the unit in which displacements have a likely size; None if none has, or nothing moves."""
    size = float(np.percentile(np.abs(numbers), 90.0))
    for unit in _UNITS:
        if _SIZES[0] <= size * COLUMN_UNITS[unit] <= _SIZES[1]:
            return unit
    return None


def compare_names(first: str, second: str) -> int:
    """Return 1 if the first of two names is without load by its form, −1 if the second is, else 0.

    A name that differs from the other one in a number 0 is without load, and one that is the other one behind
    a prefix, such as `unloaded`.
    """
    by_number = _compare_numbers(first, second)
    if by_number:
        return by_number
    words, others = (set(_WORD.findall(name.lower())) for name in (first, second))
    own, other = words - others, others - words
    is_first = any(_is_prefixed(word, stem) for word in own for stem in other)
    is_second = any(_is_prefixed(word, stem) for word in other for stem in own)
    return int(is_first) - int(is_second)


def _compare_numbers(first: str, second: str) -> int:
    """Compare names that differ in one number: zero is without load."""
    numbers, others = (_NUMBER.findall(name) for name in (first, second))
    different = [pair for pair in zip(numbers, others, strict=False) if pair[0] != pair[1]]
    if len(numbers) != len(others) or len(different) != 1:
        return 0
    a, b = (float(text.replace(",", ".")) for text in different[0])
    return int(a == 0.0 < b) - int(b == 0.0 < a)


def _is_prefixed(word: str, stem: str) -> bool:
    least = _LEAST_STEM if stem.isascii() else 2
    return word != stem and word.endswith(stem) and len(stem) >= least


def compare_zeros(first: FloatArray, second: FloatArray) -> int:
    """Return 1 or −1 if numbers (N, m) next to the readings are zero in the first or second state only.

    Cells without a number are no zero; a vector is zero if all m numbers are.
    """
    is_first, is_second = (np.linalg.norm(numbers, axis=1) < 1e-9 for numbers in (first, second))
    return int(is_first.all() and not is_second.any()) - int(is_second.all() and not is_first.any())
