"""Arrays of a file as columns of text: for the process that reads them, with few modules of ours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Final, NamedTuple, NotRequired, TypedDict

import numpy as np

from jointstiff.service.importing import limits

_NUMBERS: Final = "iubfc"
"""Kinds of arrays, as numpy names them, whose elements are numbers or truth values."""
_LEAST_BYTES: Final = 4
"""Least size of a floating-point number: one of 2 bytes has three digits."""
_WHOLE: Final = 2.0**53
"""Numbers below are written without a point if they are whole, as labels are."""


_STACKED: Final = 3
"""Dimensions of a stack of points."""
_COORDINATES: Final = 3
_MOST_JOINTS: Final = 7
"""Rows of a wide matrix, at most: joints, or the coordinates of one or two targets."""


class Array(TypedDict):
    """An array of a file as columns of a table."""

    name: str
    unit: str | None  # stated by an attribute of the array
    kind: str  # `CellKind` of the cells
    columns: list[list[str | None]] | None  # cells, None for empty ones; None for what is no column
    scalar: NotRequired[str | None]  # the only element of an array; None of other arrays


Tables = Mapping[str, Callable[[], list[Array]]]
"""Tables of a file: name → function that reads the arrays of the table."""


class UnreadableError(Exception):
    """The file cannot be read as tables: reason and remedy."""


class NamedArray(NamedTuple):
    """An array of a file."""

    name: str
    values: np.ndarray | None  # None if the array is neither of numbers nor of texts
    unit: str | None = None


def tabulate(arrays: Iterable[NamedArray], *, every_length: bool = False) -> list[Array]:
    """Return arrays as columns of one table, with the number of rows that most columns have.

    A vector may stand as a row or as a column. Arrays with another number of rows have no columns, unless
    `every_length` is set: then all arrays have columns, stacks of points (n, T, 3) have those of T points,
    and the axis of postures becomes the first, such as that of (3, n, T) and of wide and low matrices.

    Raises:
        MemoryError: the table has too many rows; or more arrays have the same number of rows than a table may
            have columns, and further arrays are then not read.
        UnreadableError: a name or a unit is longer than a cell may be.
    """
    found = list[NamedArray]()
    votes: Counter[int] = Counter()
    for each in arrays:
        values = each.values
        if values is not None and np.iscomplexobj(values) and not np.imag(values).any():
            values = np.real(values)
        name, unit = check_name(each.name), check_name(each.unit or "") or None
        found.append(NamedArray(name, values, unit))
        _count_columns(votes, values)
    if every_length:
        postures = _count_postures(found)
        found = [each._replace(values=_lay_out_matrix(each.values, postures)) for each in found]
        votes = Counter()
        for each in found:
            _count_columns(votes, each.values)
    most_voted = max(votes, key=lambda rows: (votes[rows], rows), default=0)
    counts = list(votes) if every_length else [most_voted]
    if max(counts, default=0) > limits.MAX_ROWS:
        raise MemoryError
    return [
        Array(
            name=each.name,
            unit=each.unit,
            kind="text" if each.values is None else find_cell_kind(each.values.dtype),
            columns=None if each.values is None else _list_columns(each.values, counts),
            scalar=None if each.values is None else _read_scalar(each.values),
        )
        for each in found
    ]


def _count_columns(votes: Counter[int], array: np.ndarray | None) -> None:
    """Add the columns of an array to the count of columns with its number of rows.

    Raises:
        MemoryError: more columns have this number of rows than a table may have.
    """
    shape = None if array is None else _find_shape(array)
    if shape is None or shape[0] <= 1:
        return
    votes[shape[0]] += shape[1]
    if votes[shape[0]] > limits.MAX_COLUMNS:  # all votes are for arrays that can be columns
        raise MemoryError


def find_cell_kind(dtype: np.dtype) -> str:
    """Return the `CellKind` of the elements of an array; only a `number` is used as a number."""
    if dtype.kind == "f" and dtype.itemsize < _LEAST_BYTES:
        return "half-precision number"
    kinds = {"b": "truth value", "c": "complex number", "i": "number", "u": "number", "f": "number"}
    return kinds.get(dtype.kind, "text")


def _find_shape(array: np.ndarray) -> tuple[int, int] | None:
    """Return rows and columns of a vector or matrix; None for an array that cannot be columns of a table."""
    if array.ndim not in (1, 2) or array.size == 0:
        return None
    is_vector = array.ndim == 1 or min(array.shape) == 1
    rows, columns = (array.size, 1) if is_vector else array.shape
    is_text = array.dtype.kind in "SUO" and columns == 1
    is_of_numbers = array.dtype.kind in _NUMBERS and columns <= limits.MAX_COLUMNS
    return (rows, columns) if is_text or is_of_numbers else None


def _count_postures(arrays: Iterable[NamedArray]) -> int:
    """Return the length that most matrices and stacks have as their longest; 0 without any.

    Square matrices, such as stiffnesses, have no longest axis.
    """
    lengths: Counter[int] = Counter()
    for each in arrays:
        shape = () if each.values is None else each.values.shape
        longest = max(shape, default=0)
        has_axes = len(shape) in (2, _STACKED) and min(shape) > 1 and shape.count(longest) == 1
        if has_axes and longest > _COORDINATES:
            lengths[longest] += 1
    return max(lengths, key=lambda length: (lengths[length], length), default=0)


def _lay_out_matrix(array: np.ndarray | None, postures: int) -> np.ndarray | None:
    """Return a stack of points as (n, 3T), and a wide matrix turned.

    A stack is (n, T, 3) or (n, 3, T), or one of its axes has as many elements as there are postures. Of three
    points in three coordinates, points are those whose distances hardly change, as on one flange.
    A wide matrix has few rows, and many columns or one for each posture. Other arrays are returned unchanged.
    """
    if array is None:
        return None
    is_stack = array.ndim == _STACKED
    if is_stack and array.shape.count(postures) == 1:
        array = np.moveaxis(array, array.shape.index(postures), 0)
    if is_stack and _COORDINATES in array.shape[1:]:
        turned = array.swapaxes(1, 2)
        points = array if array.shape[2] == _COORDINATES else turned
        if array.shape[1] == array.shape[2] and _measure_distances(turned) < _measure_distances(array):
            points = turned
        return points.reshape(len(points), -1)
    is_low = array.ndim == 2 and 1 < array.shape[0] <= _MOST_JOINTS
    is_wide = is_low and array.shape[0] < array.shape[1]
    has_postures = is_wide and array.shape[1] == postures != array.shape[0]
    has_many_columns = is_wide and array.shape[1] > 2 * _MOST_JOINTS
    return array.T if has_postures or has_many_columns else array


def _measure_distances(points: np.ndarray) -> float:
    """Return how much the distances of three points (n, 3, 3) change; infinite without numbers."""
    if points.dtype.kind not in "iuf" or not np.isfinite(points).any():
        return np.inf
    points = points.astype(np.float64)
    distances = np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2)
    known = distances[np.isfinite(distances).all(axis=1)]
    return float(np.ptp(known, axis=0).max()) if len(known) else np.inf


def _list_columns(array: np.ndarray, counts: Collection[int]) -> list[list[str | None]] | None:
    """Return the cells of each column of a vector or matrix; None for other arrays.

    Arrays whose number of rows is not in `counts` have no columns, unless they are vectors of three numbers,
    which may be a force of all rows.

    NaN, the mark of a missing number in arrays, is an empty cell.
    """
    shape = _find_shape(array)
    is_vector = shape == (_COORDINATES, 1) and array.dtype.kind in _NUMBERS
    if shape is None or not (shape[0] in counts or is_vector):
        return None
    array = array.reshape(shape)
    if array.dtype.kind in _NUMBERS:
        columns = (array.astype(float) if array.dtype.kind == "f" else array).T.tolist()
        return [list(map(write_number, column)) for column in columns]
    return [[clean_text(each) for each in array[:, 0].tolist()]]


def _read_scalar(array: np.ndarray) -> str | None:
    """Return the text of the only element of an array; None of other arrays."""
    if array.size != 1 or array.dtype.kind not in f"{_NUMBERS}SU":
        return None
    (element,) = array.reshape(1).tolist()
    return clean_text(element) if array.dtype.kind in "SU" else write_number(element)


def check_name(name: str) -> str:
    """Return the name or unit of an array if it is short.

    Raises:
        UnreadableError: the text is longer than a cell may be.
    """
    if len(name) > limits.MAX_CELL_LENGTH:
        raise UnreadableError(
            f"a name or unit of an array has more than {limits.MAX_CELL_LENGTH} characters",
            "give the array a shorter name or unit",
        )
    return name


def clean_text(text: object) -> str:
    """Return a text of a cell without blanks at its ends.

    Raises:
        UnreadableError: the text is longer than a cell may be.
    """
    if isinstance(text, bytes):
        text = text.decode("utf-8", "replace")
    cleaned = str(text).strip(" \t\r\n\0")
    if len(cleaned) > limits.MAX_CELL_LENGTH:
        raise UnreadableError(
            f"a text has more than {limits.MAX_CELL_LENGTH} characters",
            "leave the text out, or shorten the text",
        )
    return cleaned


def write_number(number: complex | None) -> str | None:
    """Return the shortest text of a number, of a truth value 1 or 0; None for nothing and NaN."""
    if number is None or number != number:
        return None
    if isinstance(number, bool):
        return str(int(number))
    if isinstance(number, float) and number.is_integer() and abs(number) < _WHOLE:
        return str(int(number))
    return repr(number)


class ByteCount:
    """Count of the bytes that arrays need."""

    def __init__(self) -> None:
        self._left = limits.MAX_UNPACKED_BYTES

    def take(self, size: int) -> None:
        """Count the bytes of an array before it is read; raise `MemoryError` if there are too many."""
        self._left -= size
        if self._left < 0 or size < 0:
            raise MemoryError
