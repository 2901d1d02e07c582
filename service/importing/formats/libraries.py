"""Read files of arrays by their libraries, in a process of its own with limits: scipy, numpy, h5py, pyarrow.

These libraries trust a file: few bytes unpack to gigabytes, and a damaged file can end the process.
`python -P -m jointstiff.service.importing.formats.libraries FORMAT OPTIONS` reads a file from its standard
input and writes one JSON document. Nothing is unpickled, and no other file is opened.
"""

from __future__ import annotations

import io
import json
import os
import sys
import warnings
import zipfile
from collections.abc import Mapping
from typing import IO, Any, Final

import numpy as np

from jointstiff.service.importing import limits
from jointstiff.service.importing.child import limit_this_process
from jointstiff.service.importing.formats.columns import (
    ByteCount,
    NamedArray,
    Tables,
    UnreadableError,
    clean_text,
    tabulate,
)

_MAX_NAMES: Final = 64
"""Names of tables from which one has to be chosen."""
_SHOWN: Final = 60
"""Characters of a name in a message."""
_MAX_DEPTH: Final = 3
"""Structs in structs of MATLAB."""


def main(kind: str, wanted: list[str] | None, *, every_length: bool) -> dict[str, Any]:
    """Return tables of the file in the standard input by name; `tables` has the names if one must be chosen.

    Args:
        kind: `mat`, `npz`, `hdf5` or `parquet`.
        wanted: names of the tables to return; None for the only one.
        every_length: whether arrays with another number of rows than most columns are returned, too.
    """
    content = sys.stdin.buffer.read()
    try:
        limit_this_process()
        tables = _read_tables(kind, content, every_length=every_length)
        names = list(tables) if wanted is None else wanted
        missing = [name for name in names if name not in tables]
        if missing or (wanted is None and len(names) != 1):
            return {"tables": list(tables)[:_MAX_NAMES], "missing": missing}
        found = {name: tables[name]() for name in names}
        columns = (each for arrays in found.values() for array in arrays for each in array["columns"] or ())
        ByteCount().take(sum(len(cell or "") for column in columns for cell in column))
    except UnreadableError as error:
        return {"reason": error.args[0], "remedy": error.args[1]}
    except MemoryError:
        return {"large": True}
    return {"arrays": found}


def _read_tables(kind: str, content: bytes, *, every_length: bool) -> Tables:
    """Return the tables of a file by the library of its format."""
    if kind == "hdf5":
        from jointstiff.service.importing.formats.hdf5 import read_hdf5

        return read_hdf5(content, every_length=every_length)
    if kind == "parquet":
        os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # which reserves no memory in advance
        from jointstiff.service.importing.formats.parquet import read_parquet

        return read_parquet(content)
    if kind == "npz":
        return _read_npz(content, every_length=every_length)
    return _read_matlab(content, every_length=every_length)


def _read_npz(content: bytes, *, every_length: bool) -> Tables:
    """Return the one table of an archive of NumPy, of its arrays; pickled objects are never read.

    Raises:
        MemoryError: the arrays are too large, or too many.
        UnreadableError: an array has objects of Python.
    """
    archive = zipfile.ZipFile(io.BytesIO(content))
    members = archive.infolist()
    if len(members) > limits.MAX_OBJECTS:
        raise MemoryError
    count = ByteCount()
    arrays = []
    for member in members:
        with archive.open(member) as stream:
            arrays.append(_read_npy(member.filename.removesuffix(".npy"), stream, count))
    return {"": lambda: tabulate(arrays, every_length=every_length)}


def _read_npy(name: str, stream: IO[bytes], count: ByteCount) -> NamedArray:
    """Return an array of NumPy, whose header states its size before it is read; errors as of `_read_npz`."""
    version = np.lib.format.read_magic(stream)
    is_first = version == (1, 0)
    read_header = np.lib.format.read_array_header_1_0 if is_first else np.lib.format.read_array_header_2_0
    shape, is_by_columns, dtype = read_header(stream)
    if dtype.hasobject:
        reason = f"the array {name[:_SHOWN]!r} has pickled objects of Python, which may be harmful"
        raise UnreadableError(reason, "save arrays of numbers or of texts")
    size = int(np.prod(shape, dtype=object)) * dtype.itemsize
    count.take(size)
    values = np.frombuffer(stream.read(size), dtype).reshape(shape, order="F" if is_by_columns else "C")
    return NamedArray(name, None if dtype.names else values)


def _read_matlab(content: bytes, *, every_length: bool) -> Tables:
    """Return the one table of a .mat file, of its variables."""
    from scipy.io import loadmat, whosmat

    stream: Any = io.BytesIO(content)  # scipy's types lack streams
    ByteCount().take(8 * sum(int(np.prod(shape)) for _, shape, _ in whosmat(stream)))
    with warnings.catch_warnings(record=True) as lost_parts:
        warnings.simplefilter("always", np.exceptions.ComplexWarning)
        # With its type in MATLAB, a truth value is known as one, but a complex number loses a part.
        fields = _list_fields(loadmat(stream, squeeze_me=False, mat_dtype=True))
    if lost_parts:
        stored = _list_fields(loadmat(stream, squeeze_me=False, mat_dtype=False))
        fields = [
            whole if whole.values is not None and np.iscomplexobj(whole.values) else typed
            for typed, whole in zip(fields, stored, strict=True)
        ]
    return {"": lambda: tabulate(fields, every_length=every_length)}


def _list_fields(variables: Mapping[str, Any]) -> list[NamedArray]:
    """Return the variables of a .mat file, and the fields of its structs, as arrays with their names."""
    return [
        NamedArray(field, None if array is None else _join_cell_array(array))
        for name, each in variables.items()
        if not name.startswith("__")
        for field, array in _split_struct(name, np.asarray(each))
    ]


def _split_struct(name: str, array: np.ndarray, depth: int = 0) -> list[tuple[str, np.ndarray | None]]:
    """Return the fields of a MATLAB struct as arrays with their names; any other array as it is.

    Fields of a struct in a struct have both names. A struct with several elements gives a row for each; a
    field whose elements have different sizes is None, and is named among what is no table.
    """
    if array.dtype.names is None or depth > _MAX_DEPTH:
        return [(name, array)]
    fields = list[tuple[str, np.ndarray | None]]()
    for field in array.dtype.names:
        full_name = field if depth == 0 else f"{name} {field}"
        values = [np.asarray(each[field]) for each in array.ravel()]
        if len(values) == 1:
            fields += _split_struct(full_name, values[0], depth + 1)
        else:
            is_table = len({value.size for value in values}) == 1
            fields.append((full_name, np.stack([value.ravel() for value in values]) if is_table else None))
    return fields


def _join_cell_array(array: np.ndarray) -> np.ndarray | None:
    """Return a MATLAB cell array whose cells are texts as an array of texts; other arrays as they are.

    SciPy reads a cell array as an array of objects: an array for the content of each cell. None
    is returned for a cell array with a cell that is not one text.
    """
    is_cell_array = array.dtype.kind == "O"
    if not is_cell_array:
        return array
    cells = [np.asarray(cell).ravel() for cell in array.ravel()]
    are_texts = all(cell.dtype.kind == "U" and cell.size == 1 for cell in cells)
    if not are_texts:
        return None
    return np.array([clean_text(cell[0]) for cell in cells]).reshape(array.shape)


if __name__ == "__main__":
    arguments = json.loads(sys.argv[2])
    answer = main(sys.argv[1], arguments["tables"], every_length=arguments["every_length"])
    sys.stdout.write(json.dumps(answer))
