"""Arrays of a Python program, to numbers and to the fields of a measurement set."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NoReturn

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError

READINGS: Final = {
    "unloaded": "unloaded",
    "loaded": "loaded",
    "unloaded_after": "unloaded_after",
    "deflections": "deflection",
}
"""Argument with readings, NaN where a target was not read → field of a reading."""
_LOADS: Final = {"forces": "force", "moments": "moment", "load_point": "load_point"}
"""Argument with a vector for each observation → field of an observation."""
_TOGETHER: Final = (
    {"unloaded", "loaded"},
    {"unloaded", "loaded", "unloaded_after"},
    {"deflections"},
    {"unloaded"},  # for runs by the own weight, which need no force
)
"""Arguments that can be used together as readings."""
_GIVE_NUMBERS: Final = "give an array of numbers, or lists of equal lengths"


def convert_arrays(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return readings as fields of a measurement set, in the units of the arrays.

    A target was not read in an observation if all of its coordinates are NaN or None there. An observation
    without any reading was not read, and is omitted.

    Args:
        arrays: `joints` (N, n); `forces`, `moments` and `load_point` (N, 3) or (3,); readings (N, T, 3),
            (N, 3 T), (N, 3), or (N, 3) by the target's name; with `directions` (3,), (T, 3) or (N, T, 3),
            readings of one number; `targets`, names of the targets or their places in the flange frame by
            name; `labels` (N,). None for an array that is not given.

    Raises:
        MeasurementError: an array has another shape, a value is not a number, or arrays are missing.
    """
    given = {name: value for name, value in arrays.items() if value is not None}
    joints = to_number_array(arrays["joints"], "joints")
    if joints.ndim != 2 or not joints.size:
        refuse_shape("joints", joints, "(N, n), a row for each observation")
    count = len(joints)
    _refuse_lone_arguments(given)
    names, values = _arrange_readings(given, count)
    read_once = [values[name] for name in READINGS if name in values and name != "unloaded_after"]
    was_read = np.all([np.isfinite(each).all(axis=2) for each in read_once], axis=0)  # (N, T)
    rows = np.flatnonzero(was_read.any(axis=1)).tolist()
    if not rows:
        remedy = "write NaN only where a target was not read"
        raise MeasurementError("all readings are NaN", where=next(iter(values)), remedy=remedy)

    refuse_missing_numbers("joints", joints, rows)
    loads = {name: to_vectors(given[name], count, name, rows) for name in _LOADS if name in given}
    vectors = {"joints": joints, "force": np.zeros((count, 3))}
    vectors |= {_LOADS[name]: numbers for name, numbers in loads.items()}
    fields: dict[str, Any] = {}
    points = vectors.get("load_point", joints)
    if points is not joints and (points == points[0]).all():
        fields["load_point"] = vectors.pop("load_point")[0].tolist()
    labels = [str(label) for label in given.get("labels", [f"c{i:02}" for i in range(1, count + 1)])]
    if len(labels) != count:
        refuse_shape("labels", np.array(labels), f"({count},)")
    observations = []
    for i in rows:
        readings = [
            _make_reading(name, {field: numbers[i, t] for field, numbers in values.items()})
            for t, name in enumerate(names)
            if was_read[i, t]
        ]
        numbers_of_row = {field: numbers[i].tolist() for field, numbers in vectors.items()}
        observations.append({"label": labels[i], **numbers_of_row, "readings": readings})
    fields["observations"] = observations
    if isinstance(given.get("targets"), Mapping):
        places = {str(name): to_number_array(place, "targets") for name, place in given["targets"].items()}
        fields["flange_targets"] = {name: places[name].tolist() for name in names}
    return fields


def _refuse_lone_arguments(given: Mapping[str, Any]) -> None:
    """Refuse readings that cannot be used together, or without their load.

    Raises:
        MeasurementError: names the arguments.
    """
    readings = {name for name in READINGS if name in given}
    is_loaded = readings != {"unloaded"}
    states_load = not {"forces", "moments"}.isdisjoint(given)
    if readings not in _TOGETHER or is_loaded != states_load:
        stated = [f"`{name}`" for name in (*READINGS, "forces", "moments") if name in given]
        raise MeasurementError(
            f"{' and '.join(stated) or 'no reading'} alone cannot be used as readings and their load",
            where="unloaded",
            remedy="give `unloaded` and `loaded`, or `deflections`, with `forces` or `moments`; give "
            "`unloaded` alone, without forces, only to identify by the own weight",
        )


def _arrange_readings(given: Mapping[str, Any], count: int) -> tuple[list[str], dict[str, FloatArray]]:
    """Return the names of the T targets, and argument → (N, T, 3), or lengths (N, T, 1) with directions.

    `given` are all arguments, `count` is the number of observations N.

    Raises:
        MeasurementError: a target is missing, a shape is wrong, or a reading lacks a coordinate.
    """
    components = 1 if "directions" in given else 3
    readings = {name: given[name] for name in READINGS if name in given}
    first = next(iter(readings.values()))
    names = [str(name) for name in given.get("targets", first if isinstance(first, Mapping) else ())]
    values = dict[str, FloatArray]()
    for name, value in readings.items():
        if isinstance(value, Mapping):
            array = _stack_targets(value, name, names, are_stated="targets" in given)
        else:
            array = to_number_array(value, name)
        is_flat = array.ndim in (1, 2) and array.size > 0
        if is_flat and array[0].size % components == 0:
            array = array.reshape(len(array), -1, components)
        names = names or [f"T{t}" for t in range(1, array.shape[1] + 1 if array.ndim > 1 else 2)]
        if array.shape != (count, len(names), components):
            refuse_shape(name, array, f"({count}, {len(names)}, {components}), observation by target")
        is_finite = np.isfinite(array)
        partly_read = np.argwhere(is_finite.any(axis=2) & ~is_finite.all(axis=2))
        if len(partly_read):
            i, t = partly_read[0].tolist()
            raise MeasurementError(
                f"the reading of target '{names[t]}' lacks a coordinate",
                where=f"{name}[{i}]",
                remedy="give all three coordinates, or three NaN if the target was not read",
            )
        values[name] = array
    if "directions" in given:
        directions, shape = to_number_array(given["directions"], "directions"), (count, len(names), 3)
        if directions.shape not in {shape, shape[1:], shape[2:]}:
            refuse_shape("directions", directions, f"(3,), {shape[1:]} or {shape}")
        values["directions"] = np.broadcast_to(directions, shape)
    return names, values


def _stack_targets(
    value: Mapping[Any, Any], name: str, names: Sequence[str], *, are_stated: bool
) -> FloatArray:
    """Return readings that are given by target, each (N, …), as an array (N, T, …).

    Args:
        value: target → its readings in N observations.
        name: argument of the readings, for messages.
        names: names of the targets.
        are_stated: whether the caller stated these names, so that readings of others are left out.

    Raises:
        MeasurementError: the readings are of other targets, or their shapes differ.
    """
    columns = {str(target): column for target, column in value.items()}
    others = set(names) - set(columns) if are_stated else set(names) ^ set(columns)
    if others:
        raise MeasurementError(
            f"`{name}` has readings of {', '.join(columns)}, but the targets are {', '.join(names)}",
            where=name,
            remedy="give the same targets in all readings, or state those to use in `targets`",
        )
    arrays = [to_number_array(columns[target], f"{name}['{target}']") for target in names]
    for array in arrays:
        if array.shape != arrays[0].shape or not array.ndim:
            refuse_shape(name, array, f"{arrays[0].shape} as of the first target")
    return np.stack(arrays, axis=1)


def _make_reading(target: str, values: Mapping[str, FloatArray]) -> dict[str, Any]:
    """Return a reading as a document, from argument → its numbers."""
    reading: dict[str, Any] = {"target": target}
    for name, numbers in values.items():
        if name == "directions":
            reading["direction"] = numbers.tolist()
        elif len(numbers) == 1:
            reading["displacement"] = numbers.item()
        elif np.isfinite(numbers).all():  # otherwise not read again after unloading
            reading[READINGS[name]] = numbers.tolist()
    return reading


def to_vectors(
    value: Any,  # noqa: ANN401 - anything numpy understands
    count: int,
    name: str,
    rows: Iterable[int] | None = None,
) -> FloatArray:
    """Return numbers (count, 3) from an array (count, 3), or from one row (3,), which is repeated.

    The numbers of `rows` are finite; by default those of all rows.

    Raises:
        MeasurementError: the array has another shape, or numbers that are not finite; it is called `name`.
    """
    array = to_number_array(value, name)
    if array.shape not in {(3,), (count, 3)}:
        refuse_shape(name, array, f"(3,) or ({count}, 3)")
    vectors = np.broadcast_to(array, (count, 3))
    refuse_missing_numbers(name, vectors, range(count) if rows is None else rows)
    return vectors


def refuse_shape(name: str, array: FloatArray, expected: str) -> NoReturn:
    """Raise the error that an argument has another shape than the expected one.

    Raises:
        MeasurementError: always.
    """
    raise MeasurementError(
        f"`{name}` has the shape {array.shape}, not {expected}",
        where=name,
        remedy=f"give `{name}` in the shape {expected}",
    )


def refuse_missing_numbers(name: str, array: FloatArray, rows: Iterable[int]) -> None:
    """Refuse an array (N, …) that lacks finite numbers in some rows.

    Raises:
        MeasurementError: names the first such row.
    """
    for row in rows:
        if not np.isfinite(array[row]).all():
            raise MeasurementError(
                f"`{name}` lacks numbers in row {row + 1}",
                where=f"{name}[{row}]",
                remedy="give these numbers, or leave out such rows of all arrays",
            )


def to_number_array(value: Any, name: str) -> FloatArray:  # noqa: ANN401 - anything numpy understands
    """Convert an array, lists or columns without names to an array; `name` is for messages.

    In readings, None or NaN in place of a list means that a target was not read.

    Raises:
        MeasurementError: the value has elements that are not numbers, or infinite.
    """
    if name.partition("[")[0] in READINGS:
        value = _fill_missing_readings(value)
    numbers = read_numbers(value, name)
    if np.isinf(numbers).any():
        place = np.argwhere(np.isinf(numbers))[0].tolist()
        reason = f"`{name}` has an infinite value at {place}"
        raise MeasurementError(reason, where=name, remedy="give finite numbers")
    return numbers


def read_numbers(value: Any, name: str) -> FloatArray:  # noqa: ANN401 - anything numpy understands
    """Convert the same, with infinite numbers; missing values and masked ones are NaN.

    Raises:
        MeasurementError: the value has elements that are not numbers, or names of columns or rows.
    """
    is_list = isinstance(value, list | tuple) and value and all(hasattr(each, "to_numpy") for each in value)
    for part in value if is_list else [value]:
        _refuse_names(part, name)
    if is_list:
        return np.stack([read_numbers(column, name) for column in value], axis=1)
    source = value.to_numpy() if hasattr(value, "to_numpy") else value
    try:
        array = np.asarray(source)
        if array.dtype.kind == "O":
            objects = [np.nan if type(each).__name__ == "NAType" else each for each in array.ravel()]
            array = np.array(objects, dtype=object).reshape(array.shape)
        if array.dtype.kind == "U":  # as objects, so that a message shows a text as Python does
            array = array.astype(object)
        casts_objects = array.dtype.kind == "O"
        numbers = array.astype(np.float64, casting="unsafe" if casts_objects else "same_kind")
    except (TypeError, ValueError) as error:
        reason = f"`{name}` is not an array of numbers: {error}"
        raise MeasurementError(reason, where=name, remedy=_GIVE_NUMBERS) from None
    if array.dtype in (np.bool_, np.float16):
        reason = f"`{name}` has values of the type {array.dtype}, not numbers in single or double precision"
        raise MeasurementError(reason, where=name, remedy=_GIVE_NUMBERS)
    if isinstance(source, np.ma.MaskedArray):
        numbers[np.ma.getmaskarray(source)] = np.nan
    return numbers


def _refuse_names(value: Any, name: str) -> None:  # noqa: ANN401 - anything numpy understands
    """Refuse columns or rows with names, whose order may be another one than the order of an array.

    Raises:
        MeasurementError: states how to use columns with names.
    """
    if list_names(value):
        raise MeasurementError(
            f"`{name}` has columns or rows with names, which may be in any order",
            where=name,
            remedy="give an array without names in the documented order, such as `frame.to_numpy()`; or "
            "read one frame with all columns by `jointstiff.read(frame, robot=…)`",
        )


def list_names(value: Any) -> list[str]:  # noqa: ANN401 - anything numpy understands
    """Return the names of columns or rows of a table of Arrow, pandas, polars or NumPy, or of a mapping.

    Numbers in their order, which libraries give columns and rows by default, are no names.
    """
    names = [
        value if isinstance(value, Mapping) else getattr(getattr(value, "dtype", None), "names", None) or ()
    ]
    if hasattr(value, "to_numpy"):
        names += [getattr(value, attribute, ()) for attribute in ("column_names", "columns", "index")]
    for each in map(list, names):
        if any(name not in (place, f"column_{place}") for place, name in enumerate(each)):
            return [str(name) for name in each]
    return []


def _fill_missing_readings(value: Any) -> Any:  # noqa: ANN401 - anything numpy understands
    """Return lists in which None or NaN in place of a list becomes as many NaN as its neighbours have.

    Lists whose other rows differ in shape are returned unchanged; numpy refuses them.
    """
    if not isinstance(value, list | tuple):
        return value
    rows = [_fill_missing_readings(row) for row in value]
    try:
        shapes = [np.shape(row) for row in rows]
    except ValueError:
        return value
    shape = max(shapes, key=len, default=())
    filled = []
    for row, own in zip(rows, shapes, strict=True):
        values = np.asarray(row, dtype=object).ravel()
        is_missing = all(each is None or (isinstance(each, float) and np.isnan(each)) for each in values)
        is_shorter = own != shape and own == shape[: len(own)]
        filled.append(np.full(shape, np.nan) if is_shorter and is_missing else row)
    return filled
