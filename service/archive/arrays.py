"""Readings of a measurement set in an archive: each array with its type, its shape and its values."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

MOST_ARRAYS: Final = 40
MOST_BYTES: Final = 256 * 1024 * 1024
"""Greatest size of an array [bytes]."""
_MOST_AXES: Final = 5
_TYPE: Final = re.compile(r"<f8|\|b1|<U\d{1,3}|<i8")


def describe_arrays(content: bytes) -> dict[str, dict[str, Any]]:
    """Return the arrays of an npz file by name, as an archive has them.

    Raises:
        ValueError: the file is damaged, or has pickled objects.
    """
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    return {
        name: {"type": array.dtype.str, "shape": list(array.shape), "values": array.ravel().tolist()}
        for name, array in arrays.items()
    }


def pack_arrays(described: Mapping[str, Any]) -> bytes:
    """Return arrays of an archive as an npz file.

    Raises:
        ValueError: the description has no such arrays.
    """
    if not isinstance(described, dict) or len(described) > MOST_ARRAYS:
        raise ValueError(f"`arrays` must be an object of at most {MOST_ARRAYS} arrays")
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **{name: _build_array(entry) for name, entry in described.items()})
    return buffer.getvalue()


def _build_array(described: Any) -> np.ndarray[Any, Any]:  # noqa: ANN401 - of a file from others
    """Return an array of an archive."""
    is_whole = isinstance(described, dict) and described.keys() == {"type", "shape", "values"}
    if not is_whole:
        raise ValueError("an array must have `type`, `shape` and `values`")
    kind, shape, values = described["type"], described["shape"], described["values"]
    if not isinstance(kind, str) or _TYPE.fullmatch(kind) is None:
        raise ValueError("the type of an array must be <f8, <i8, |b1 or <U with a length")
    has_shape = isinstance(shape, list) and all(isinstance(n, int) and n >= 0 for n in shape)
    if not has_shape or len(shape) > _MOST_AXES or math.prod(shape) != len(values):
        raise ValueError("an array must have as many values as its shape states")
    if np.dtype(kind).itemsize * len(values) > MOST_BYTES:
        raise ValueError(f"an array must have at most {MOST_BYTES // 1024**2} MiB")
    return np.array(values, dtype=kind).reshape(shape)
