"""Arrays of a file as columns of text: for the process that reads them, so without other modules of ours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple, TypedDict

import numpy as np

MAX_UNPACKED_BYTES: Final = 64 * 1024 * 1024
"""Bytes of all arrays of a file together."""
MAX_OBJECTS: Final = 10_000
"""Groups and arrays of a file."""
MAX_CELLS: Final = 1_000_000
MAX_ROWS: Final = 320_000
MAX_COLUMNS: Final = 256
MAX_TEXT: Final = 256
"""Characters of a cell."""
_WHOLE: Final = 2.0**53
"""Numbers below are written without a point if they are whole, as labels are."""


class Array(TypedDict):
    """An array of a file as columns of a table."""

    name: str
    unit: str | None  # stated by an attribute of the array
    numbers: bool  # whether the cells are numbers
    columns: list[list[str | None]] | None  # cells, None for empty ones; None for what is no column


Tables = Mapping[str, Callable[[], list[Array]]]
"""Tables of a file: name → function that reads the arrays of the table."""


class UnreadableError(Exception):
    """The file cannot be read as tables: reason and remedy."""


class NamedArray(NamedTuple):
    """An array of a file."""

    name: str
    values: np.ndarray | None  # None if the array is neither of numbers nor of texts
    unit: str | None = None


def tabulate(arrays: Iterable[NamedArray]) -> list[Array]:
    """Return arrays as columns of one table, with the number of rows that most columns have.

    A vector may stand as a row or as a column. Arrays with another number of rows have no columns.
    """
    found = list(arrays)
    votes: Counter[int] = Counter()
    for each in found:
        shape = () if each.values is None else each.values.shape
        if len(shape) in (1, 2) and max(shape) > 1:
            is_vector = min(shape) == 1 or len(shape) == 1
            votes[max(shape) if is_vector else shape[0]] += 1 if is_vector else shape[1]
    count = max(votes, key=lambda rows: (votes[rows], rows), default=0)
    return [
        Array(
            name=each.name,
            unit=each.unit,
            numbers=each.values is not None and each.values.dtype.kind in "iubf",
            columns=None if each.values is None else _list_columns(each.values, count),
        )
        for each in found
    ]


def _list_columns(array: np.ndarray, count: int) -> list[list[str | None]] | None:
    """Return the cells of each column of a vector or matrix with `count` rows; None for other arrays.

    NaN, the mark of a missing number in arrays, is an empty cell.
    """
    if array.ndim == 1 or (array.ndim == 2 and array.shape == (1, count)):
        array = array.reshape(-1, 1)
    if array.ndim != 2 or len(array) != count or array.shape[1] > MAX_COLUMNS or count > MAX_ROWS:
        return None
    if array.dtype.kind in "iubf":
        columns = (array.astype(float) if array.dtype.kind == "f" else array).T.tolist()
        return [list(map(write_number, column)) for column in columns]
    if array.dtype.kind in "SUO" and array.shape[1] == 1:
        return [[clean_text(each) for each in array[:, 0].tolist()]]
    return None


def clean_text(text: object) -> str:
    """Return a text of a cell without blanks at its ends.

    Raises:
        UnreadableError: the text is longer than a cell may be.
    """
    if isinstance(text, bytes):
        text = text.decode("utf-8", "replace")
    cleaned = str(text).strip(" \t\r\n\0")
    if len(cleaned) > MAX_TEXT:
        raise UnreadableError(f"a text has more than {MAX_TEXT} characters", "leave it out, or cut it")
    return cleaned


def write_number(number: float | None) -> str | None:
    """Return the shortest text of a number, of a truth value 1 or 0; None for nothing and NaN."""
    if number is None or number != number:
        return None
    is_whole = isinstance(number, float) and number.is_integer() and abs(number) < _WHOLE
    return str(int(number)) if isinstance(number, bool) or is_whole else repr(number)


class ByteCount:
    """Count of the bytes that arrays need."""

    def __init__(self) -> None:
        self._left = MAX_UNPACKED_BYTES

    def take(self, size: int) -> None:
        """Count the bytes of an array before it is read; raise `MemoryError` if there are too many."""
        self._left -= size
        if self._left < 0 or size < 0:
            raise MemoryError
