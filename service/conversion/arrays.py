"""Conversion of arrays to campaigns, and of DH rows, URDFs and Pinocchio models to robot documents."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.measurement import Units
from jointstiff.service.conversion.robots import refuse_far_point
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT
from jointstiff.service.conversion.urdf_links import find_base, find_flange
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.urdf import (
    check_root,
    parse_xml,
    refuse_unknown_link,
    write_urdf,
)
from jointstiff.solver.text import length_text

FAR_POSITION: Final = 100.0
"""Distance of a target from the origin beyond which the unit of positions is in doubt [m]."""
_LEAST_ROWS_OF_AXES: Final = 3
"""Least number of observations that show whether targets keep their distances."""
_RIGID: Final = 0.02
"""Greatest plausible change of a distance between two targets [m]."""
_MUCH_LESS: Final = 0.02
"""Ratio of two changes of distances that shows which axes are right."""
LARGE_DEFLECTION: Final = 1.0
"""Deflection beyond which the unit of positions is in doubt [m]."""
_JOINT_ROWS: Final = "a row of finite numbers for each observation, (N, n)"
_WRONG_KINDS: Final = {
    "b": ("truth values", "give numbers"),
    "c": (
        "complex numbers",
        "give the real part, such as `np.real(values)`, if the other part means nothing",
    ),
    "half": ("numbers of half precision, of three digits", "give the numbers in single or double precision"),
    "M": ("times", "give numbers"),
    "m": ("durations", "give numbers"),
}
"""Kind of an array, as numpy names kinds → what its values are, and what to give instead."""
_SIZES: Final = {"length": LENGTH, "angle": ANGLE, "force": FORCE, "moment": MOMENT}
_SPELLINGS: Final = {
    "N·m": "N.m",
    "Nm": "N.m",
    "N·mm": "N.mm",
    "Nmm": "N.mm",
    "kN·m": "kN.m",
    "kNm": "kN.m",
    "°": "deg",
}


def parse_units(text: Units | Mapping[str, str] | str) -> dict[str, str]:
    """Parse a text such as `mm, deg, N` or `m, rad, kN, kN.m`; return the unit of each quantity by name.

    `Units` or a mapping are returned as a dictionary, without a check.

    Raises:
        MeasurementError: a unit is not known, a quantity has two units, or its unit is missing.
    """
    if isinstance(text, Units):
        return text.model_dump(exclude_none=True)
    if isinstance(text, Mapping):
        return dict(text)
    units: dict[str, str] = {}
    for word in re.split(r"[,;\s]+", text.strip()):
        name = _SPELLINGS.get(word, word)
        quantity = _find_quantity(name)
        if quantity is None or quantity in units:
            raise _build_unit_error(word, quantity)
        units[quantity] = name
    for quantity in ("length", "angle", "force"):
        if quantity not in units:
            raise MeasurementError(
                f"the unit of {quantity} is missing",
                where="units",
                remedy="write the units as in 'mm, deg, N'",
            )
    return units


def _find_quantity(unit: str) -> str | None:
    """Return the quantity of a unit, such as `length` for `mm`; None for an unknown unit."""
    return next((quantity for quantity, sizes in _SIZES.items() if unit in sizes), None)


def _build_unit_error(word: str, quantity: str | None) -> MeasurementError:
    """Return the error that a word is a second unit of a quantity, or no unit if `quantity` is None."""
    known = "; ".join(f"{name} {', '.join(sizes)}" for name, sizes in _SIZES.items())
    fault = f"a second unit of {quantity}" if quantity else "not a known unit"
    remedy = f"use one unit for each quantity: {known}"
    return MeasurementError(f"'{word}' is {fault}", where="units", remedy=remedy)


@dataclass(frozen=True, eq=False)
class ArrayReadings:
    """Readings of N observations of T targets, in whatever form of arrays a Python program holds them.

    Arrays, lists, and columns of pandas or polars without names are accepted. A target was not
    read in an observation if all of its coordinates are NaN or None there. An observation without any reading
    was not read, and is omitted.
    """

    joints: Any  # (N, n) positions of the joints as the controller shows them
    forces: Any  # (N, 3) or (3,), axes of R0; None without a load
    moments: Any  # (N, 3) or (3,), about the load point; None without moments
    load_point: Any  # (3,) or (N, 3), flange frame; None without a load
    unloaded: Any  # positions (N, T, 3), (N, 3 T), (N, 3), or (N, 3) by the target's name
    loaded: Any  # positions under load, in the same shape
    unloaded_after: Any  # positions after the load was removed, in the same shape; None if not read again
    deflections: Any  # loaded minus unloaded positions, in the same shape; with directions (N, T)
    directions: Any  # (3,), (T, 3) or (N, T, 3), axes of R0
    targets: Any  # names of the T targets, or their places in the flange frame by name
    labels: Any  # (N,) labels of the observations; c01, c02, … if absent

    def document(self, units: Mapping[str, str]) -> dict[str, Any]:
        """Return the readings as the fields of a measurement-set document, in the units of the arrays.

        `units` has the unit of each quantity by name.

        Raises:
            MeasurementError: shapes do not fit, a value is not a number, or a length is implausible.
        """
        joints = self._read_joints()
        count, length = len(joints), LENGTH[units["length"]]
        points = self._read_load_points(count, length)
        flange_places = self._read_flange_places(length)
        names, readings = self._arrange_readings(count, length)
        rows = [i for i in range(count) if readings[i]]
        self._refuse_no_rows(rows)
        vectors = self._arrange_vectors(joints, points, rows)
        labels = self._list_labels(count)
        document: dict[str, Any] = {"units": dict(units)}
        if flange_places:
            document["flange_targets"] = {name: flange_places[name] for name in names}
        if points is not None and (points == points[0]).all():
            document["load_point"] = points[0].tolist()
        elif points is not None:
            vectors["load_point"] = points
        document["observations"] = [
            {"label": labels[i], **_select_row(vectors, i), "readings": readings[i]} for i in rows
        ]
        return document

    def _arrange_vectors(
        self, joints: FloatArray, points: FloatArray | None, rows: Sequence[int]
    ) -> dict[str, FloatArray]:
        """Return field of an observation → (N, …) numbers: joints, force, and moment if moments are given.

        Args:
            joints: (N, n) joint values.
            points: (N, 3) load points; None if not given.
            rows: observations with readings, whose numbers must be finite.

        Raises:
            MeasurementError: a number of these observations is missing, or a shape is wrong.
        """
        _refuse_missing_numbers("joints", joints, rows)
        if points is not None:
            _refuse_missing_numbers("load_point", points, rows)
        count = len(joints)
        moments = None if self.moments is None else to_vectors(self.moments, count, "moments", rows)
        vectors = {"joints": joints, "force": self._read_forces(count, rows)}
        if moments is not None:
            vectors["moment"] = moments
        return vectors

    def _read_joints(self) -> FloatArray:
        """Return the joint values (N, n) as the controller shows them; NaN where they are missing.

        Raises:
            MeasurementError: the array has another shape, or is transposed.
        """
        joints = to_number_array(self.joints, "joints")
        if joints.ndim != 2 or not joints.size:
            raise _make_shape_error("joints", joints, _JOINT_ROWS)
        self._refuse_transposed_joints(joints)
        return joints

    def _refuse_no_rows(self, rows: Sequence[int]) -> None:
        """Raise a `MeasurementError` if no observation has a reading; `rows` are those that have one."""
        if not rows:
            raise MeasurementError(
                "all readings are NaN",
                where="deflections" if self.unloaded is None else "unloaded",
                remedy="give the readings; NaN means that a target was not read",
            )

    def _read_load_points(self, count: int, length: float) -> FloatArray | None:
        """Return the load point of each observation (N, 3), in the units of the arrays; None if not given.

        `count` is the number of observations N, `length` the unit of lengths in m.

        Raises:
            MeasurementError: the shape is wrong, or a point is too far from the flange.
        """
        if self.load_point is None:
            return None
        points = to_vectors(self.load_point, count, "load_point", [])
        for point in points:
            refuse_far_point(point.tolist(), "load_point", length=length)
        return points

    def _read_forces(self, count: int, rows: Sequence[int]) -> FloatArray:
        """Return the force of each observation (N, 3); zero if only moments are given.

        `count` is the number of observations N; `rows` are those with readings, whose forces are finite.

        Raises:
            MeasurementError: the shape is wrong, or readings under load have neither force nor moment.
        """
        if self.forces is not None:
            return to_vectors(self.forces, count, "forces", rows)
        is_loaded = self.loaded is not None or self.deflections is not None
        if is_loaded and self.moments is None:
            raise MeasurementError(
                "the readings under load have no force and no moment",
                where="forces",
                remedy="give `forces`, the forces on the robot in the axes of R0, or `moments`",
            )
        return np.zeros((count, 3))

    def _list_labels(self, count: int) -> list[str]:
        """Return the labels of `count` observations: those that are given, else c01, c02 and so on.

        Raises:
            MeasurementError: the number of labels is wrong.
        """
        if self.labels is None:
            return [f"c{i:02}" for i in range(1, count + 1)]
        labels = [str(label) for label in self.labels]
        if len(labels) != count:
            raise MeasurementError(
                f"there are {len(labels)} labels, but {count} observations",
                where="labels",
                remedy="give one label for each observation",
            )
        return labels

    def _refuse_transposed_joints(self, joints: FloatArray) -> None:
        """Refuse joints whose columns, not rows, are as many as an axis of the readings has elements."""
        read = self.deflections if self.unloaded is None else self.unloaded
        arrays = list(read.values()) if isinstance(read, Mapping) else [read]
        lengths = set[int]()
        for array in arrays:
            if isinstance(array, np.ndarray):
                lengths.update(array.shape)
            elif isinstance(array, list):
                lengths.add(len(array))
        rows, columns = joints.shape
        if columns in lengths and rows not in lengths:
            raise MeasurementError(
                f"`joints` has {rows} rows, but {columns} observations were read",
                where="joints",
                remedy="give a row for each observation, as in `joints.T`",
            )

    def _read_flange_places(self, length: float) -> dict[str, list[float]]:
        """Return the targets' positions in the flange frame by name; empty if `targets` has only names.

        `length` is the unit of lengths in m, for the check that no target is too far from the flange.
        """
        if not isinstance(self.targets, Mapping):
            return {}
        places = {
            str(name): to_number_array(place, "targets").tolist() for name, place in self.targets.items()
        }
        for name, place in places.items():
            refuse_far_point(place, f"targets['{name}']", length=length)
        return places

    def _arrange_readings(self, count: int, length: float) -> tuple[list[str], list[list[dict[str, Any]]]]:
        """Return the names of the targets, and for each observation a list of its readings as documents.

        `count` is the number of observations, `length` the unit of lengths in m.
        """
        components = 3 if self.directions is None else 1  # along a direction, a reading is one number
        fields = self._collect_reading_fields()
        names = self._get_target_names(next(iter(fields.values()))) or []
        values: dict[str, FloatArray] = {}
        for name, value in fields.items():
            values[name], names = _arrange_by_target(value, name, count, names, components)
            _refuse_implausible_lengths(values[name], name, length)
            _refuse_exchanged_axes(values[name], name, length)
        self._refuse_other_targets(fields, names)
        directions = None
        if self.directions is not None:
            directions = self._broadcast_directions(count, len(names))
        readings = list[list[dict[str, Any]]]()
        for i in range(count):
            own = [_make_reading(target, values, directions, (i, t)) for t, target in enumerate(names)]
            readings.append([reading for reading in own if reading is not None])
        return names, readings

    def _collect_reading_fields(self) -> dict[str, Any]:
        """Return field → array of the readings that are given.

        Raises:
            MeasurementError: these fields together cannot be used as readings.
        """
        fields: dict[str, Any] = {}
        for name in ("unloaded", "loaded", "unloaded_after", "deflections"):
            if getattr(self, name) is not None:
                fields[name] = getattr(self, name)
        allowed_fields = [{"unloaded", "loaded"}, {"unloaded", "loaded", "unloaded_after"}, {"deflections"}]
        if self.forces is None:
            allowed_fields.append({"unloaded"})
        if set(fields) not in allowed_fields:
            given = " and ".join(f"`{name}`" for name in fields)
            reason = f"{given} alone cannot be used as readings" if given else "no readings are given"
            remedy = (
                "give `unloaded` and `loaded`, or `deflections`; give `unloaded` alone only to identify "
                "by the own weight"
            )
            raise MeasurementError(reason, where="unloaded", remedy=remedy)
        return fields

    def _refuse_other_targets(self, fields: Mapping[str, Any], names: Sequence[str]) -> None:
        """Refuse a target that only some of the fields have, unless the caller states the targets.

        Raises:
            MeasurementError: a field has a target that is not among `names`.
        """
        if self.targets is not None:
            return
        for name, value in fields.items():
            others = [each for each in value if str(each) not in names] if isinstance(value, Mapping) else []
            if others:
                raise MeasurementError(
                    f"target '{others[0]}' has readings only in `{name}`",
                    where=name,
                    remedy="give the same targets in all readings, or state those to use in `targets`",
                )

    def _broadcast_directions(self, observation_count: int, target_count: int) -> FloatArray:
        """Return the directions (N, T, 3) of the readings; `directions` may leave out the first axes.

        Raises:
            MeasurementError: the shape of `directions` is wrong.
        """
        stated = to_number_array(self.directions, "directions")
        try:
            return np.broadcast_to(stated, (observation_count, target_count, 3))
        except ValueError:
            shapes = f"(3,), (T, 3) or (N, T, 3) for {target_count} targets"
            raise _make_shape_error("directions", stated, shapes) from None

    def _get_target_names(self, value: object) -> list[str]:
        """Return the names of the targets, else the keys of the readings `value`; empty without names."""
        if self.targets is not None:
            return [str(name) for name in self.targets]
        return [str(name) for name in value] if isinstance(value, Mapping) else []


def _select_row(vectors: Mapping[str, FloatArray], i: int) -> dict[str, list[float]]:
    """Return field → numbers of the observation i, from field → numbers (N, …) of all observations."""
    return {field: numbers[i].tolist() for field, numbers in vectors.items()}


def _make_reading(
    target: str, values: Mapping[str, FloatArray], directions: FloatArray | None, cell: tuple[int, int]
) -> dict[str, Any] | None:
    """Return a reading as a document; None if the target was not read.

    Args:
        target: name of the target.
        values: field of `ArrayReadings` → (N, T, 3) readings, or (N, T, 1) if they are along directions.
        directions: (N, T, 3) directions of the readings; None for vectors.
        cell: index of the observation, and index of the target.
    """
    is_vector = directions is None
    reading: dict[str, Any] = {"target": target}
    for name, value in values.items():
        components = value[cell]
        if np.isfinite(components[0]):
            # The document names one deflection `deflection`, or `displacement` if it is one number.
            one_deflection = "deflection" if is_vector else "displacement"
            field = one_deflection if name == "deflections" else name
            reading[field] = components.tolist() if is_vector else components[0].item()
        elif name != "unloaded_after":  # only the reading after unloading may be missing
            return None
    if directions is not None:
        reading["direction"] = directions[cell].tolist()
    return reading


def _arrange_by_target(
    value: Any,  # noqa: ANN401 - anything numpy understands
    name: str,
    count: int,
    names: list[str],
    components: int,
) -> tuple[FloatArray, list[str]]:
    """Arrange one field of readings as an array; return the array and the names of the T targets.

    Args:
        value: readings as a program gave them.
        name: field of `ArrayReadings`, for messages.
        count: number of observations N.
        names: names of the targets; if empty, the keys of the readings are used, else T1, T2, …
        components: numbers of one reading: 3 for a vector, 1 along a direction.

    Returns:
        (N, T, components) readings, NaN where a target was not read; T names.
    """
    if isinstance(value, Mapping):
        array = _stack_targets(value, name, names)
    else:
        array = to_number_array(value, name)
        has_flat_rows = array.ndim in (1, 2) and array.size > 0
        if has_flat_rows and array[0].size % components == 0:
            array = array.reshape(len(array), -1, components)
    are_named = bool(names)
    names = names or [f"T{t}" for t in range(1, array.shape[1] + 1 if array.ndim > 1 else 2)]
    if array.shape != (count, len(names), components):
        target_count = len(names) if are_named else None
        other_order = _exchange_axes(name, array, (count, target_count, components))
        if other_order is not None and isinstance(value, Mapping):
            of_each = f"{{target: array.T for target, array in {name}.items()}}"
            other_order = other_order._replace(call=of_each)
        other_order = other_order or _split_rows(name, array, count, target_count, components)
        wanted = f"{components} numbers for each of {count} observations and {len(names)} targets"
        raise _make_shape_error(name, array, wanted, other_order)
    _refuse_partly_read(array, name, names)
    return array, names


def _stack_targets(value: Mapping[Any, Any], name: str, names: Sequence[str]) -> FloatArray:
    """Return readings that are given by target, each (N, components), as an array (N, T, components).

    Args:
        value: target → its readings in N observations.
        name: field of `ArrayReadings`, for messages.
        names: names of the targets; if empty, all keys of `value`.

    Raises:
        MeasurementError: a target has no readings.
    """
    targets = names or list(value)
    for target in targets:
        if target not in value:
            raise MeasurementError(
                f"target '{target}' has no readings",
                where=name,
                remedy=f"use one of {', '.join(map(str, value))}",
            )
    columns = [to_number_array(value[target], f"{name}['{target}']") for target in targets]
    return np.stack([column.reshape(len(column), -1) for column in columns], axis=1)


def _refuse_partly_read(readings: FloatArray, name: str, targets: Sequence[str]) -> None:
    """Raise a `MeasurementError` if a reading has some of its coordinates, and NaN for others.

    `readings` are (N, T, components) numbers of the field `name`.
    """
    finite = np.isfinite(readings)
    partly_read = np.argwhere(finite.any(axis=2) & ~finite.all(axis=2))
    if len(partly_read):
        i, t = partly_read[0].tolist()
        raise MeasurementError(
            f"the reading of target '{targets[t]}' lacks a coordinate",
            where=f"{name}[{i}]",
            remedy="give all three coordinates, or three NaN if the target was not read",
        )


def _refuse_implausible_lengths(values: FloatArray, name: str, length: float) -> None:
    """Refuse positions or deflections that are too long for an arm, because their unit must be wrong.

    Args:
        values: (N, T, components) positions or deflections.
        name: field of `ArrayReadings`; values of `deflections` have a smaller limit than positions.
        length: unit of lengths in m.

    Raises:
        MeasurementError: a length exceeds its limit.
    """
    are_deflections = name == "deflections"
    size = length * np.linalg.norm(np.nan_to_num(values), axis=-1)
    most = LARGE_DEFLECTION if are_deflections else FAR_POSITION
    if size.max(initial=0.0) > most:
        i = int(np.unravel_index(np.argmax(size), size.shape)[0])
        quantity = "deflection" if are_deflections else "position"
        raise MeasurementError(
            f"a {quantity} of {size.max():.4g} m is too long for an arm; up to {most:g} m is plausible",
            where=f"{name}[{i}]",
            remedy="check the unit of length in `units`: positions, deflections, load point and sigma are in "
            "this unit; a campaign file may have greater lengths",
        )


def _refuse_exchanged_axes(positions: FloatArray, name: str, length: float) -> None:
    """Refuse positions (N, 3, 3) whose axes of targets and of coordinates are exchanged.

    Targets keep their distances from each other: so do the positions as given, or those with these axes
    exchanged.

    Args:
        positions: position of each target in each observation, in `length` metres.
        name: name of the argument.
        length: unit of lengths [m].

    Raises:
        MeasurementError: only the positions with exchanged axes keep their distances.
    """
    if name == "deflections" or positions.shape[1:] != (3, 3):
        return
    complete = length * positions[np.isfinite(positions).all(axis=(1, 2))]
    if len(complete) < _LEAST_ROWS_OF_AXES:
        return
    change = _measure_change_of_distances(complete)
    change_when_exchanged = _measure_change_of_distances(complete.transpose(0, 2, 1))
    if change > _RIGID and change_when_exchanged < _MUCH_LESS * change:
        raise MeasurementError(
            f"the axes of `{name}` seem to be exchanged: the distances between targets change by "
            f"{length_text(change)}; with coordinates and targets exchanged, by "
            f"{length_text(change_when_exchanged)}",
            where=name,
            remedy=f"give positions of the shape (N, T, 3), coordinates last: {name}.transpose(0, 2, 1)",
        )


def _measure_change_of_distances(positions: FloatArray) -> float:
    """Return the greatest standard deviation of a distance between two of three targets, (N, 3, 3) [m]."""
    distances = np.linalg.norm(positions - positions[:, [1, 2, 0]], axis=2)
    return float(distances.std(axis=0).max())


def to_vectors(
    value: Any,  # noqa: ANN401 - anything numpy understands
    count: int,
    name: str,
    rows: Sequence[int] | None = None,
) -> FloatArray:
    """Return numbers (count, 3) from an array (count, 3), or from one row (3,), which is repeated.

    The numbers of `rows` are finite; by default those of all rows.

    Raises:
        MeasurementError: the array has another shape, or numbers that are not finite; it is called `name`.
    """
    array = to_number_array(value, name)
    if array.shape in {(6,), (count, 6)} and name in {"forces", "moments"}:
        first, last = f"{name}[:3]", f"{name}[3:]"
        if array.ndim == 2:
            first, last = f"numpy.array({name})[:, :3]", f"numpy.array({name})[:, 3:]"
        raise MeasurementError(
            f"`{name}` has the shape {array.shape}: six numbers, a force and a moment?",
            where=name,
            remedy="give the force as `forces` and the moment about the load point as `moments`: "
            f"forces={first}, moments={last} if the force is first, as in a wrench of ROS and in most load "
            f"cells; forces={last}, moments={first} if the moment is first, as in spatial vectors",
        )
    has_rows = array.shape == (count, 3)
    used = array[rows] if has_rows and rows is not None else array
    if has_rows:
        _refuse_missing_numbers(name, array, range(count) if rows is None else rows)
    if not (has_rows or array.shape == (3,)) or not np.isfinite(used).all():
        raise _make_shape_error(
            name,
            array,
            f"finite numbers of shape (3,) or ({count}, 3)",
            _exchange_axes(name, array, (count, 3)),
        )
    return np.broadcast_to(array, (count, 3))


_READINGS: Final = frozenset({"unloaded", "loaded", "unloaded_after", "deflections"})
"""Arrays in which a number may be missing, because a target was not read."""
_NAN_WHERE_NOT_READ: Final = "write NaN where a target was not read"
_ROWS: Final = (list, tuple, np.ndarray)
_LONGEST_SHOWN: Final = 40
"""Most characters of a value that a message shows."""
_MOST_NAMED: Final = 5
"""Most observations that a message names."""
_NUMBERS: Final = "give an array, or lists of equal lengths"


def to_number_array(value: Any, name: str) -> FloatArray:  # noqa: ANN401 - anything numpy understands
    """Convert an array, lists or columns without names to an array; `name` is for messages.

    Raises:
        MeasurementError: the value has elements that are not numbers, or infinite.
    """
    remedy = f"{_NUMBERS}; {_NAN_WHERE_NOT_READ}" if _may_lack_numbers(name) else _NUMBERS
    if _may_lack_numbers(name):
        value = _fill_missing_readings(value)
    numbers = read_numbers(value, name, remedy)
    if np.isinf(numbers).any():
        raise MeasurementError(
            f"`{name}` has infinite values{_locate_infinite(numbers, name)}",
            where=name,
            remedy=_NAN_WHERE_NOT_READ if _may_lack_numbers(name) else "give finite numbers",
        )
    return numbers


def _locate_infinite(numbers: FloatArray, name: str) -> str:
    """Return the end of a sentence that says where the first infinite value is, counted from 1."""
    if numbers.ndim == 0:
        return ""
    first = (np.argwhere(np.isinf(numbers))[0] + 1).tolist()
    if name == "joints" and numbers.ndim == 2:
        observation, joint = first
        return f"; the first is that of joint_{joint} in observation {observation} (row {observation})"
    dimensions = {1: ("element",), 2: ("row", "column")}.get(numbers.ndim, ("row", "target", "component"))
    places = ", ".join(f"{word} {number}" for word, number in zip(dimensions, first, strict=False))
    return f"; the first is in {places}"


def _may_lack_numbers(name: str) -> bool:
    """Return whether an argument, such as `loaded` or its part `loaded['P1']`, may have missing numbers."""
    return name.partition("[")[0] in _READINGS


def read_numbers(value: Any, name: str, remedy: str) -> FloatArray:  # noqa: ANN401 - anything numpy understands
    """Convert the same, with infinite numbers; `name` and `remedy` are for messages.

    Raises:
        MeasurementError: the value has elements that are not numbers, or names of columns or rows.
    """
    _refuse_names(value, name)
    try:
        if isinstance(value, list | tuple) and value and all(hasattr(each, "to_numpy") for each in value):
            return np.stack([_to_numbers(column, name) for column in value], axis=1)
        return _to_numbers(value, name)
    except (TypeError, ValueError) as error:
        _refuse_decimal_comma(str(error), name)
        _refuse_unit_in_text(str(error), name)
        _refuse_rows_of_several_lengths(value, name)
        raise MeasurementError(
            f"`{name}` is not an array of numbers: {error}", where=name, remedy=remedy
        ) from None


def _refuse_names(value: Any, name: str) -> None:  # noqa: ANN401 - anything numpy understands
    """Refuse columns or rows with names, whose order may be another one than the order of an array.

    Numbers in their order, which libraries give columns and rows by default, are no names.

    Raises:
        MeasurementError: states how to use columns with names.
    """
    is_list = isinstance(value, list | tuple)
    parts = [each for each in value if hasattr(each, "to_numpy")] if is_list else [value]
    for part in parts:
        has_names = isinstance(part, Mapping) or getattr(getattr(part, "dtype", None), "names", None)
        for attribute in ("column_names", "columns", "index"):  # of Arrow, pandas and polars
            names = list(getattr(part, attribute, ())) if hasattr(part, "to_numpy") else []
            if any(name not in (place, f"column_{place}") for place, name in enumerate(names)):
                has_names = True
        if has_names:
            raise MeasurementError(
                f"`{name}` has columns or rows with names, which may be in any order",
                where=name,
                remedy="give an array without names in the documented order, such as `frame.to_numpy()`; or "
                "read one frame with all columns by `jointstiff.read(frame, robot=…)`",
            )


_DECIMAL_COMMA: Final = re.compile(
    r"could not convert string to float: '\s*([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)\s*'"
)
"""Message of numpy about a text that is a number with a decimal comma."""


_THOUSANDS: Final = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""Number whose comma may separate thousands."""


def _refuse_unit_in_text(reason: str, name: str) -> None:
    """Raise the error about a number with its unit behind it, such as `10 deg`; `reason` is that of NumPy."""
    if found := re.search(r"'([-+\d.eE]{1,30}) ?([^\W\d]{1,10}|[°µ]\w{0,10})'$", reason):
        raise MeasurementError(
            f"`{name}` has texts such as '{found[1]} {found[2]}', not numbers",
            where=name,
            remedy="give numbers without units, and state the units once, such as units='mm, deg, N'",
        )


def _fill_missing_readings(value: Any) -> Any:  # noqa: ANN401 - anything numpy understands
    """Return lists in which None or NaN in place of a list becomes as many NaN as its neighbours have.

    Lists whose other rows differ in shape are returned unchanged; a later check refuses them.
    """
    if not isinstance(value, list | tuple) or not any(isinstance(row, _ROWS) for row in value):
        return value
    rows = [_fill_missing_readings(row) for row in value]
    try:
        shapes = [np.shape(row) for row in rows]
    except ValueError:
        return value
    shape = max(shapes, key=len)
    return [
        np.full(shape, np.nan) if own != shape and own == shape[: len(own)] and _is_missing(row) else row
        for row, own in zip(rows, shapes, strict=True)
    ]


def _is_missing(value: Any) -> bool:  # noqa: ANN401 - anything numpy understands
    """Return whether a value, or each value of a list, is None or NaN."""
    values = np.asarray(value, dtype=object).ravel()
    return all(isinstance(each, float) and np.isnan(each) for each in map(_replace_missing, values))


def _refuse_rows_of_several_lengths(value: object, name: str) -> None:
    """Raise the error about a list whose rows have different lengths; it names the first such row."""
    if not isinstance(value, list | tuple) or not any(isinstance(row, list | tuple) for row in value):
        return
    length = next(len(row) for row in value if isinstance(row, list | tuple))
    remedy = "give every row the same number of values"
    if _may_lack_numbers(name):
        remedy += "; NaN means that a target was not read"
    for number, row in enumerate(value):
        if not isinstance(row, list | tuple):
            reason = f"`{name}[{number}]` is {str(row)[:_LONGEST_SHOWN]}, not a list of {length} values"
            raise MeasurementError(reason, where=name, remedy=remedy)
        if len(row) != length:
            raise MeasurementError(
                f"`{name}` has rows of different lengths: {length} in the first, {len(row)} in row "
                f"{number + 1}",
                where=name,
                remedy=remedy,
            )
        _refuse_rows_of_several_lengths(row, f"{name}[{number}]")


def _refuse_decimal_comma(fault: str, name: str) -> None:
    """Raise a `MeasurementError` if the text that numpy could not convert has a decimal comma."""
    found = _DECIMAL_COMMA.fullmatch(fault)
    if found is None:
        return
    whole, decimals = found.groups()
    if _THOUSANDS.fullmatch(f"{whole},{decimals}"):
        raise MeasurementError(
            f"`{name}` has texts with a comma, such as '{whole},{decimals}': a decimal comma, or thousands?",
            where=name,
            remedy="read the table with pandas.read_csv(…, decimal=',') or pandas.read_csv(…, thousands=',')",
        )
    raise MeasurementError(
        f"`{name}` has texts with a decimal comma, such as '{whole},{decimals}'",
        where=name,
        remedy=f"write {whole or '0'}.{decimals}: replace the comma of each text, text.replace(',', '.'), or "
        "read the table with pandas.read_csv(…, decimal=',')",
    )


def _to_numbers(value: Any, name: str) -> FloatArray:  # noqa: ANN401 - anything numpy understands
    """Return an array, a data frame or a column as numbers; missing values and masked ones are NaN.

    Raises:
        MeasurementError: the values are of a type that is no number, or have too few digits.
        TypeError: a value is no number.
        ValueError: a text is no number, or lists have different lengths.
    """
    source = value.to_numpy() if hasattr(value, "to_numpy") else value
    array = np.asarray(source)
    if array.dtype.kind == "O":
        objects = [_replace_missing(each) for each in array.ravel()]
        array = np.array(objects, dtype=object).reshape(array.shape)
    kind = _find_kind(array)
    if kind in _WRONG_KINDS:
        fault, remedy = _WRONG_KINDS[kind]
        raise MeasurementError(f"`{name}` has {fault}", where=name, remedy=remedy)
    if kind == "U":  # as objects, so that a message shows a text as Python does
        array = array.astype(object)
    numbers = np.array(array, dtype=np.float64)
    if isinstance(source, np.ma.MaskedArray):
        numbers[np.ma.getmaskarray(source)] = np.nan
    return numbers


def _find_kind(array: npt.NDArray[Any]) -> str:
    """Return the kind of an array's values as numpy names it, such as `f`; `half` for half precision."""
    if array.dtype == np.float16:
        return "half"
    return _find_kind_of_objects(array) if array.dtype.kind == "O" else array.dtype.kind


def _find_kind_of_objects(array: Any) -> str:  # noqa: ANN401 - an array of objects
    """Return the kind of the first object that is no number, as numpy names kinds; `O` for numbers."""
    for each in array.ravel():
        kind = np.asarray(each).dtype.kind
        if kind in _WRONG_KINDS:
            return kind
    return "O"


def _replace_missing(value: Any) -> Any:  # noqa: ANN401 - an object of an array
    """Return NaN for None and for the missing value of pandas; any other object unchanged."""
    return np.nan if value is None or type(value).__name__ == "NAType" else value


def _refuse_missing_numbers(name: str, array: FloatArray, rows: Iterable[int]) -> None:
    """Raise a `MeasurementError` if a row (N, …) among `rows` has numbers that are not finite."""
    lacking = [row + 1 for row in rows if not np.isfinite(array[row]).all()]
    if not lacking:
        return
    numbers = ", ".join(map(str, lacking[:_MOST_NAMED]))
    more = f" and {len(lacking) - _MOST_NAMED} more" if len(lacking) > _MOST_NAMED else ""
    noun = "observation" if len(lacking) == 1 else "observations"
    if len(lacking) == len(array) > 1:
        raise _describe_empty_columns(name, array)
    raise MeasurementError(
        f"`{name}` lacks numbers in {noun} {numbers}{more} (counted from 1)",
        where=name,
        remedy="give these numbers, or leave out such rows of all arrays: "
        f"array[np.isfinite({name}).all(axis=1)]",
    )


def _describe_empty_columns(name: str, array: FloatArray) -> MeasurementError:
    """Return the error that no row (N, …) of an array is complete: columns of texts were read as numbers."""
    columns = array.reshape(len(array), -1)
    empty = np.flatnonzero(~np.isfinite(columns).any(axis=0)) + 1
    if not len(empty):
        return MeasurementError(
            f"`{name}` lacks numbers in each observation", where=name, remedy="give these numbers"
        )
    noun = "column" if len(empty) == 1 else "columns"
    numbers_alone = (
        f"give the columns of numbers alone, such as table[:, 1:{columns.shape[1] + 1}] if the first "
        "column of the table has labels"
    )
    if name == "forces":
        numbers_alone = (
            "a force needs all three components: give 0 along an axis without force, as Fx and Fy of a "
            f"hanging weight, such as numpy.nan_to_num(forces); or {numbers_alone}"
        )
    return MeasurementError(
        f"`{name}` has no number in {noun} {', '.join(map(str, empty[:_MOST_NAMED]))} (counted from 1), as "
        "`numpy.genfromtxt` reads a column of texts, such as labels",
        where=name,
        remedy=numbers_alone,
    )


class _OtherOrder(NamedTuple):
    """Other order of an array's numbers that has the wanted shape."""

    fault: str  # what is in another order, in words
    call: str  # call of numpy that arranges the numbers


def _exchange_axes(name: str, array: FloatArray, wanted: Sequence[int | None]) -> _OtherOrder | None:
    """Return the exchange of axes of an array to the wanted shape; None if no exchange does.

    In `wanted`, None is an axis of any length.
    """
    if array.ndim != len(wanted):  # an array of ten axes has millions of orders
        return None
    for order in permutations(range(array.ndim)):
        shape = tuple(array.shape[axis] for axis in order)
        fits = all(length in (None, given) for given, length in zip(shape, wanted, strict=True))
        if fits and list(order) != sorted(order):
            call = f"{name}.T" if array.ndim == 2 else f"{name}.transpose{order}"
            return _OtherOrder("axes seem to be exchanged", call)
    return None


def _split_rows(
    name: str, array: FloatArray, count: int, targets: int | None, components: int
) -> _OtherOrder | None:
    """Return the split of rows of single readings into N observations; None if they do not fit."""
    per_observation = array.size // (max(count, 1) * components)
    is_whole = per_observation > 1 and array.size == count * per_observation * components
    if not is_whole or len(array) != count * per_observation or targets not in (None, per_observation):
        return None
    return _OtherOrder(
        "rows seem to be single readings, target after target",
        f"{name}.reshape({count}, {per_observation}, {components})",
    )


def _make_shape_error(
    name: str, array: FloatArray, wanted: str, other_order: _OtherOrder | None = None
) -> MeasurementError:
    """Return the error that a field has another shape than the wanted one, or values that are not finite.

    `other_order` is an order of the array's numbers that has the wanted shape; None if there is none.
    """
    if other_order is not None:
        return MeasurementError(
            f"`{name}` has the shape {array.shape}: its {other_order.fault}",
            where=name,
            remedy=f"give {other_order.call}",
        )
    fault = "" if np.isfinite(array).all() else ", and some of its values are not numbers"
    return MeasurementError(
        f"`{name}` has the shape {array.shape}{fault}", where=name, remedy=f"give {wanted}"
    )


# ---- robots


def convert_urdf(text: str, base: str | None, flange: str | None) -> dict[str, Any]:
    """Convert the text of a URDF to the model of a robot document.

    Without `base`, the root link is the base; without `flange`, the only tip link is the flange.

    Raises:
        RobotError: the text is not a URDF, a link does not exist, several may be the base or the flange, or
            the only tip belongs to a gripper.
    """
    document = parse_xml(text)
    check_root(document)
    for link, role in ((base, "base"), (flange, "flange")):
        if link is not None:
            names = [each.attributes.get("name", "") for each in document.find_children("link")]
            refuse_unknown_link(names, link, role)
    root = find_base(document) if base is None else base
    tip = find_flange(document) if flange is None else flange
    return {"format": "urdf", "urdf": text, "base": root, "flange": tip}


def convert_pinocchio_model(model: Any, flange: str | None) -> tuple[dict[str, Any], list[dict[str, Any]]]:  # noqa: ANN401
    """Convert a Pinocchio model; return the model of a robot document, and documents of bodies with masses.

    Args:
        model: model whose joints form one chain, with one degree of freedom each.
        flange: name of the frame that is the flange; default: the only tip behind the last joint.

    Raises:
        RobotError: the model branches, a joint is of another kind, or the flange is not behind all joints.
    """
    chain = Robot(model, flange=flange).chain
    bodies = [
        {
            "name": f"body of {model.names[i]}",
            "joint": model.names[i],
            "mass": model.inertias[i].mass,
            "centre": model.inertias[i].lever.tolist(),
        }
        for i in range(1, model.njoints)
        if model.inertias[i].mass > 0.0
    ]
    urdf = write_urdf(chain)
    return {"format": "urdf", "urdf": urdf, "base": chain.base, "flange": chain.flange}, bodies
