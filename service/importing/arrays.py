"""Files of arrays as tables: MATLAB's .mat files up to version 7.2, by scipy."""

from __future__ import annotations

import io
from typing import Any, Final

import numpy as np

from jointstiff.schemas.imports import FilePreview
from jointstiff.service.importing import grammar, grid
from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grid import Grid, Row

_MAX_UNPACKED_BYTES: Final = 64 * 1024 * 1024
"""Bytes of all arrays of a file together."""
_AXES: Final = "xyz"
_REMEDY: Final = "save vectors and matrices of numbers with one row per observation, or write a CSV file"


def read_matlab(file: str, content: bytes) -> Grid:
    """Return the variables of a .mat file as a table: each column vector or matrix as columns.

    The header of a column is the name of its variable; columns of a matrix get the number of the column, or
    x, y, z if the matrix has three columns. Names of variables that end with a unit, such as `q_deg`, state
    the unit.

    Raises:
        ImportFileError: the file is damaged or too large, or has no arrays with the same number of rows.
    """
    from scipy.io import loadmat, whosmat

    place = Place(file)
    variables: dict[str, Any] = {}
    stream: Any = io.BytesIO(content)  # scipy's types lack streams
    try:
        sizes = [int(np.prod(shape)) for _, shape, _ in whosmat(stream)]
        if 8 * sum(sizes) <= _MAX_UNPACKED_BYTES:
            variables = loadmat(stream, squeeze_me=False, mat_dtype=True)
    except Exception as error:  # scipy raises what its parts raise
        reason = f"the file is a damaged MATLAB file ({type(error).__name__})"
        raise ImportFileError(place, reason, "save the file again") from error
    columns: dict[str, list[str]] = {}
    skipped = list[str]()
    arrays = {name: np.asarray(each) for name, each in variables.items() if not name.startswith("__")}
    count = max((len(each) for each in arrays.values() if each.ndim == 2), default=0)
    for name, array in arrays.items():
        values = array.T if array.ndim == 2 and array.shape[0] == 1 != count == array.shape[1] else array
        cells = _list_cells(values, count)
        if cells is None:
            skipped.append(name)
        else:
            columns |= _name_columns(name, cells)
    if not columns or count < 1:
        size = f"{_MAX_UNPACKED_BYTES // 1024**2} MiB at most"
        raise ImportFileError(place, f"the file has no arrays of numbers with rows, of {size}", _REMEDY)
    if len(columns) > grid.MAX_COLUMNS or len(columns) * count > grid.MAX_CELLS or count > grid.MAX_ROWS:
        raise grid.too_large_error(file, 1)
    notes = [f"variables that are no tables were skipped: {quote(', '.join(skipped))}"] if skipped else []
    rows = [
        Row(1, tuple(columns)),
        *(Row(i, cells) for i, cells in enumerate(zip(*columns.values(), strict=True), 2)),
    ]
    return Grid(FilePreview(file=file, format="text", assumptions=notes), tuple(rows))


def _list_cells(array: np.ndarray, count: int) -> list[list[str]] | None:
    """Return the texts of the cells (columns, rows) of an array with `count` rows; None for other arrays."""
    if array.ndim != 2 or len(array) != count:
        return None
    if array.dtype.kind in "fiu":
        return [[f"{value:.17g}" for value in column] for column in array.T.astype(float).tolist()]
    if array.dtype.kind == "O" and array.shape[1] == 1:  # a cell array of texts
        texts = [np.asarray(each).ravel() for each in array[:, 0]]
        if all(each.dtype.kind == "U" and each.size == 1 for each in texts):
            return [[str(each[0]) for each in texts]]
    return [[str(each).strip() for each in array[:, 0]]] if array.dtype.kind == "U" else None


def _name_columns(name: str, cells: list[list[str]]) -> dict[str, list[str]]:
    """Return columns by their headers: a name alone, with x, y, z, or with numbers from 1, as joints have."""
    base, _, unit = name.rpartition("_")
    is_unit = unit in {"deg", "rad", "mm", "m", "N", "kN", "Nm"} and base
    stem, ending = (base, f" [{unit}]") if is_unit else (name, "")
    is_joint = grammar.is_joint(stem)
    if len(cells) == 1 and not is_joint:
        return {f"{stem}{ending}": cells[0]}
    is_vector = len(cells) == len(_AXES) and not is_joint
    numbers = _AXES if is_vector else [str(i) for i in range(1, len(cells) + 1)]
    gap = " " if is_vector else ""
    return {f"{stem}{gap}{number}{ending}": column for number, column in zip(numbers, cells, strict=True)}
