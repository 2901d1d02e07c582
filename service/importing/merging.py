"""Merging of the records of all tables into one observation for each label."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import dist, sqrt
from statistics import fmean
from typing import Final, NamedTuple

from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.measurement import MAX_OBSERVATIONS
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, quote
from jointstiff.service.importing.grammar import POINTS, Quantity
from jointstiff.service.importing.joint_comparison import JointComparison, JointDifference
from jointstiff.service.importing.rows import ObservationRecord, Value

_USE_FEWER: Final = (
    "leave out rows, such as repeated readings of a posture, or identify all rows in Python from arrays, "
    "with `jointstiff.solver.identify` (docs/python.md): the runs of its parts do not replace one run"
)
"""What to do with too many observations."""
_MAX_REPEAT: Final = 1e-4
"""Greatest distance [m] of a repeated reading from the mean of all readings of the point."""


class Merging:
    """Merging of the records of each label into one observation."""

    def __init__(
        self,
        options: ImportOptions,
        units: Mapping[str, str],
        joint_kinds: Sequence[JointKind],
        faults: Faults,
        notes: list[str],
    ) -> None:
        """Prepare to merge records; `units` has the units by dimension, assumptions are added to `notes`."""
        self._options, self._faults, self._notes = options, faults, notes
        self._joints = JointComparison.from_units(options.joint_tolerance, units, joint_kinds)
        self._metre = 1.0 if units.get("length") == "m" else 1e3  # one metre in the unit of positions
        self._joint_difference = 0.0  # greatest difference between two files, relative to the tolerance
        # difference beyond the tolerance that is the greatest, with its fault
        self._worst_joints: tuple[float, ImportFileError] | None = None
        self._repeats: dict[tuple[str, Quantity], list[Value]] = {}  # readings of points that are repeated
        # file and sheet of each value that a later record added; those that are repeated in another one
        self._tables: dict[tuple[str, Quantity], str] = {}
        self._in_two_tables: set[tuple[str, Quantity]] = set()

    def merge_by_label(self, records: Iterable[ObservationRecord]) -> list[ObservationRecord]:
        """Return one observation for each label; contradictory values are faults.

        Raises:
            ImportFileError: there are too many observations.
        """
        observations: dict[str, ObservationRecord] = {}
        first_places: dict[tuple[str, str], Place] = {}  # of each label in each file and sheet
        for record in records:
            first_place = first_places.setdefault((record.table, record.label), record.place)
            observation = observations.setdefault(record.label, record)
            is_repeated = record.whole and first_place is not record.place
            if is_repeated and not self._options.mean_of_repeats:
                _report_duplicate(f"the label {quote(record.label)}", record.place, first_place, self._faults)
            elif observation is not record:
                self._merge_record(observation, record)
            if len(observations) > MAX_OBSERVATIONS:
                reason = f"there are more than {MAX_OBSERVATIONS} observations"
                raise ImportFileError(record.place, reason, _USE_FEWER)
        self._conclude_joints()
        self._conclude_repeats(observations)
        return list(observations.values())

    def _merge_record(self, observation: ObservationRecord, record: ObservationRecord) -> None:
        """Add the values of a record to the observation with the same label; report values that differ.

        A force of zero in rows without load gives way to the force of rows under load. Of joints that differ
        within the tolerance, those of the record with unloaded positions are kept.
        """
        observation.held_out |= record.held_out
        has_no_load, had_no_load = _is_without_load(record), _is_without_load(observation)
        has_unloaded_only = _list_states_of_record(record) == {"unloaded"}
        for quantity, value in record.values.items():
            first_value = observation.values.setdefault(quantity, value)
            are_joints = quantity.kind == "joint" and first_value.vector and value.vector
            if quantity.kind in POINTS:
                self._note_repeat(observation, record, quantity, first_value)
            elif first_value.vector == value.vector or (has_no_load and _is_no_load(quantity, value)):
                continue
            elif had_no_load and _is_no_load(quantity, first_value):
                observation.values[quantity] = value
            elif not are_joints:
                self._report_difference(record, quantity, first_value)
            elif self._are_equal_joints(record.label, first_value, value) and has_unloaded_only:
                observation.values[quantity] = value

    def _report_difference(self, record: ObservationRecord, quantity: Quantity, first: Value) -> None:
        """Report that a quantity of a record, such as the force, differs from `first` of the same label."""
        reason = f"the {quantity.kind} of {quote(record.label)} differs from the value at {first.place}"
        remedy = "give each observation a unique label, or correct one of the two values"
        self._faults.report(record.place, reason, remedy)

    def _note_repeat(
        self, observation: ObservationRecord, record: ObservationRecord, quantity: Quantity, first: Value
    ) -> None:
        """Note that a record repeats a reading of its observation, and whether in the same table.

        `first` is the observation's reading: the record's own, if there was none before.
        """
        value, key = record.values[quantity], (record.label, quantity)
        first_table = self._tables.setdefault(key, record.table if first is value else observation.table)
        if first is not value:
            self._repeats.setdefault(key, [first]).append(value)
            self._in_two_tables |= {key} if record.table != first_table else set()

    def _are_equal_joints(self, label: str, first: Value, second: Value) -> bool:
        """Return whether joints of two files agree within the tolerance; keep the worst disagreement."""
        if not (first.vector and second.vector) or len(first.vector) != len(second.vector):
            return False
        difference = self._joints.find_greatest(first.vector, second.vector)
        if difference.relative <= 1.0 + 1e-9:
            self._joint_difference = max(self._joint_difference, difference.relative)
            return True
        if self._worst_joints is None or difference.relative > self._worst_joints[0]:
            fault = self._build_joint_fault(label, first, second, difference)
            self._worst_joints = difference.relative, fault
        return False

    def _build_joint_fault(
        self, label: str, first: Value, second: Value, difference: JointDifference
    ) -> ImportFileError:
        """Return the fault that joints of an observation, `first` and `second`, differ between two files."""
        joint = difference.joint
        found = self._joints.describe(joint, difference.absolute)
        plausible = self._joints.describe(joint, self._joints.tolerances[joint])
        reason = (
            f"the joint angles of {quote(label)} differ by {found} from those at {first.place}, at joint "
            f"{joint + 1}; up to {plausible} is plausible"
        )
        remedy = (
            "give each observation a unique label, correct one of the two rows, or raise "
            "`joint_tolerance` (in ° or mm)"
        )
        return ImportFileError(second.place, reason, remedy, "joint_tolerance")

    def _conclude_joints(self) -> None:
        """Report the joints that differ most between files, or note the greatest difference."""
        if self._worst_joints is not None:
            self._faults.add(self._worst_joints[1])
        elif self._joint_difference:
            greatest = self._joint_difference * self._options.joint_tolerance
            self._notes.append(
                f"joints of the same observation differ between files by up to {greatest:.2g} (deg or "
                "mm): the joints of the unloaded readings were used"
            )

    def _conclude_repeats(self, observations: Mapping[str, ObservationRecord]) -> None:
        """Replace repeated readings by their means if the options allow this; else report them as faults."""
        spread = _Spread()
        for (label, quantity), values in self._repeats.items():
            fault = self._find_repeat_fault(label, quantity, values)
            if fault is not None:
                self._faults.add(fault)
                continue
            mean = _average_readings(values)
            spread.add(mean)
            observations[label].values[quantity] = replace(values[0], vector=mean.vector)
        if spread.degrees_of_freedom:
            deviation = f"{1e6 / self._metre * spread.deviation:.3g} µm"
            greatest = f"{1e6 / self._metre * spread.greatest_distance:.3g} µm"
            self._notes.append(
                f"the mean of repeated readings was used for {len(self._repeats)} points; by their spread, "
                f"one reading has a standard deviation of {deviation} in each coordinate; the greatest "
                f"distance from a mean is {greatest}"
            )

    def _find_repeat_fault(
        self, label: str, quantity: Quantity, values: Sequence[Value]
    ) -> ImportFileError | None:
        """Return why the readings of a point have no mean; None if their mean can be used.

        Readings in two tables may be of two loads, and readings that are far from their mean of two points.
        """
        what, place = f"{quantity.target} {quantity.state} of {quote(label)}", values[1].place
        is_in_two_tables = (label, quantity) in self._in_two_tables
        if not is_in_two_tables and not (
            self._options.mean_of_repeats and all(value.vector for value in values)
        ):
            reason = f"{what} occurs twice, first at {values[0].place}"
            remedy = (
                "rename or remove one of the two readings, or use `mean_of_repeats` for repeated readings"
            )
            return ImportFileError(place, reason, remedy, "mean_of_repeats")
        if is_in_two_tables:
            reason = f"{what} occurs in two files or sheets, first at {values[0].place}"
            remedy = "rename or remove one of the two readings, or put repeated readings into one table"
            return ImportFileError(place, reason, remedy)
        distance = sqrt(max(_average_readings(values).squares))
        if distance > _MAX_REPEAT * self._metre:
            reason = (
                f"readings of {what} are up to {1e3 * distance / self._metre:.3g} mm from their mean; for "
                f"repeated readings, at most {1e3 * _MAX_REPEAT:g} mm is plausible"
            )
            remedy = "correct the names of the readings, or give one mean of readings that scatter more"
            return ImportFileError(place, reason, remedy)
        return None


class _Mean(NamedTuple):
    """Mean of K readings of a point."""

    vector: tuple[float, ...]  # coordinates
    squares: list[float]  # (K,) squared distance of each reading from the mean


def _average_readings(values: Sequence[Value]) -> _Mean:
    """Return the mean of K readings of a point; all of them have their coordinates."""
    vectors = [value.vector for value in values if value.vector]
    mean = tuple(fmean(coordinates) for coordinates in zip(*vectors, strict=True))
    return _Mean(mean, [dist(vector, mean) ** 2 for vector in vectors])


@dataclass
class _Spread:
    """Spread of repeated readings about their means, over all points; lengths in the unit of positions."""

    squares: float = 0.0  # sum of the squared distances from the means
    greatest_square: float = 0.0  # greatest of these squared distances
    degrees_of_freedom: int = 0

    def add(self, mean: _Mean) -> None:
        """Add the readings of a point; K readings of 3 coordinates have 3 (K - 1) degrees of freedom."""
        self.squares += sum(mean.squares)
        self.greatest_square = max(self.greatest_square, *mean.squares)
        self.degrees_of_freedom += len(mean.vector) * (len(mean.squares) - 1)

    @property
    def deviation(self) -> float:
        """Standard deviation of a coordinate of one reading."""
        return sqrt(self.squares / self.degrees_of_freedom)

    @property
    def greatest_distance(self) -> float:
        """Greatest distance of a reading from the mean of its point."""
        return sqrt(self.greatest_square)


def _list_states_of_record(record: ObservationRecord) -> set[State]:
    """Return the states, such as `unloaded`, in which a record has positions."""
    return {quantity.state for quantity in record.values if quantity.state}


def _is_without_load(record: ObservationRecord) -> bool:
    """Return whether a record has positions, and all were read without load."""
    states = _list_states_of_record(record)
    return bool(states) and states <= {"unloaded", "unloaded_after"}


def _is_no_load(quantity: Quantity, value: Value) -> bool:
    """Return whether a value is a force, a mass or a moment of zero, as tables have it in unloaded rows."""
    return quantity.kind in ("force", "mass", "moment") and bool(value.vector) and not any(value.vector or ())


def _report_duplicate(what: str, place: Place, first_place: Place, faults: Faults) -> None:
    """Report that something occurs at a place, and occurred before at `first_place`.

    `what` is its name in words.
    """
    faults.report(
        place, f"{what} occurs twice, first at {first_place}", "rename or remove one of the two rows"
    )
