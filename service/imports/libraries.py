"""Read a file by the library for its format, in a process of its own with limits of memory and time.

These libraries trust a file: few bytes unpack to gigabytes, and a damaged file can end the process.
`python -P -m jointstiff.service.imports.libraries ENDING` reads a file from its standard input and writes one
JSON document: the lines of sheets, or headers and rows of tables. Nothing is unpickled, and no other file is
opened.
"""

from __future__ import annotations

import io
import json
import math
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping
from datetime import date, time, timedelta
from typing import Any, Final

import numpy as np

from jointstiff.service.conversion.child import limit_this_process

_MAX_BYTES: Final = 64 * 2**20
"""Unpacked arrays of a file together."""
_MAX_OBJECTS: Final = 2_000
_LEAST_ROWS: Final = 3
_HDF5: Final = b"\x89HDF\r\n\x1a\n"
_FILTERS: Final = frozenset((1, 2, 3))
"""Filters of HDF5 that are read: deflate (gzip), shuffle, fletcher32; others load programs."""
_THRIFT_LIMITS: Final = {"thrift_string_size_limit": 8 * 2**20, "thrift_container_size_limit": 100_000}


def main(ending: str, content: bytes) -> dict[str, Any]:
    """Return the tables of a file; `missing` names a library that is not installed."""
    try:
        if ending in (".xlsx", ".xlsm", ".xls", ".xlsb", ".ods"):
            return {"tables": list(_read_workbook(content))}
        if ending == ".parquet":
            return {"tables": [_read_parquet(content)]}
        if ending == ".mat" and not content.startswith(_HDF5) and b"MATLAB 7.3" not in content[:128]:
            return {"tables": list(_tabulate(_read_matlab(content)))}
        if ending in (".npz", ".npy"):
            return {"tables": list(_tabulate(_read_numpy(content)))}
        return {"tables": list(_tabulate(_read_hdf5(content, is_matlab=ending == ".mat")))}
    except ModuleNotFoundError as error:
        return {"missing": error.name}


def _read_workbook(content: bytes) -> Iterator[dict[str, Any]]:
    """Yield the lines of each sheet of an Excel or OpenDocument file."""
    from python_calamine import CalamineWorkbook

    book = CalamineWorkbook.from_filelike(io.BytesIO(content))
    for name in book.sheet_names[:_MAX_OBJECTS]:
        lines = book.get_sheet_by_name(name).to_python(skip_empty_area=False)
        own = name if len(book.sheet_names) > 1 else ""
        yield {"name": own, "lines": [[_write_cell(cell) for cell in line] for line in lines]}


def _write_cell(cell: object) -> object:
    """Return a cell as JSON has it: a number, a text or nothing."""
    if isinstance(cell, bytes):
        return cell.decode("utf-8", "replace")
    if isinstance(cell, bool | np.bool_):
        return str(bool(cell)).lower()
    if isinstance(cell, int | float | np.integer | np.floating):
        return float(cell) if math.isfinite(cell) else None
    if isinstance(cell, date | time | timedelta | np.datetime64):
        return str(cell)
    return cell if isinstance(cell, str) and cell.strip() else None


def _read_numpy(content: bytes) -> dict[str, Any]:
    """Return the arrays of an .npz or .npy file."""
    loaded = np.load(io.BytesIO(content), allow_pickle=False)
    return dict(loaded) if hasattr(loaded, "files") else {"": loaded}


def _read_matlab(content: bytes) -> dict[str, Any]:
    """Return the variables of a .mat file, and the fields of its structs by `struct.field`."""
    from scipy.io import loadmat

    stream: Any = io.BytesIO(content)  # SciPy's types lack streams
    variables = loadmat(stream, simplify_cells=True)
    return dict(
        _list_variables({name: each for name, each in variables.items() if not name.startswith("__")})
    )


def _list_variables(variables: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield name and array of each variable, and of each field of a struct, or of an array of structs."""
    for name, value in variables.items():
        if isinstance(value, Mapping):
            yield from _list_variables(value, f"{path}{name}.")
        elif len(structs := [each for each in np.ravel(value) if isinstance(each, Mapping)]) > 1:
            fields = {field: np.stack([each[field] for each in structs]) for field in structs[0]}
            yield from _list_variables(fields, f"{path}{name}.")
        else:
            yield f"{path}{name}", value


def _read_hdf5(content: bytes, *, is_matlab: bool) -> dict[str, Any]:
    """Return the arrays of an HDF5 file; those of MATLAB 7.3 are stored transposed.

    Links to other files are not followed.

    Raises:
        ValueError: an array is stored in another file, or needs a filter that is a program.
        MemoryError: the arrays are too large.
    """
    import h5py

    arrays: dict[str, Any] = {}
    left = _MAX_BYTES
    with h5py.File(io.BytesIO(content), "r") as file:
        names: list[str] = []
        file.visit(names.append)
        for name in names[:_MAX_OBJECTS]:
            dataset = file[name]
            if not isinstance(dataset, h5py.Dataset) or dataset.shape is None or name.startswith("#"):
                continue
            creation = dataset.id.get_create_plist()
            filters = {creation.get_filter(i)[0] for i in range(creation.get_nfilters())}
            if dataset.is_virtual or dataset.external or filters - _FILTERS:
                raise ValueError(name)
            left -= dataset.size * dataset.dtype.itemsize + math.prod(dataset.chunks or (0,))
            if left < 0:
                raise MemoryError
            unit = dataset.attrs.get("units", "")
            header = f"{name} [{unit}]" if isinstance(unit, str) and unit else name
            array = np.asarray(dataset[()])
            arrays[header] = array.T if is_matlab else array
    return arrays


def _read_parquet(content: bytes) -> dict[str, Any]:
    """Return the table of a Parquet file; the numbers of a list become columns.

    Raises:
        MemoryError: the table is too large.
    """
    from pyarrow import BufferReader, parquet

    file = parquet.ParquetFile(BufferReader(content), **_THRIFT_LIMITS)
    unpacked = [file.metadata.row_group(i).total_byte_size for i in range(file.metadata.num_row_groups)]
    if sum(unpacked) > _MAX_BYTES or file.metadata.num_rows * file.metadata.num_columns > 2**20:
        raise MemoryError
    columns: dict[str, list[Any]] = {}
    for name, values in file.read(use_threads=False).to_pydict().items():
        if all(isinstance(value, list) for value in values):
            parts = zip(*values, strict=True)
            columns |= {f"{name} {number}": list(part) for number, part in enumerate(parts, 1)}
        else:
            columns[name] = values
    rows = zip(*columns.values(), strict=True)
    return {
        "name": "",
        "headers": list(columns),
        "rows": [[_write_cell(cell) for cell in row] for row in rows],
    }


def _list_fields(arrays: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield name and array of each variable, and of each field of an array of records."""
    for name, value in arrays.items():
        fields = getattr(getattr(value, "dtype", None), "names", None)
        if fields is None:
            yield name, value
        else:
            yield from ((field, value[field]) for field in fields)


def _tabulate(arrays: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield a table of the arrays of each length, side by side; further axes become columns.

    Raises:
        MemoryError: the arrays are too large.
    """
    arrays_of_length: dict[int, list[tuple[str, Any]]] = defaultdict(list)
    size = 0
    for name, value in _list_fields(arrays):
        array = np.squeeze(np.asarray(value))
        size += array.nbytes
        if size > _MAX_BYTES:
            raise MemoryError
        if array.ndim and len(array) >= _LEAST_ROWS and array.dtype.kind in "fiubSUO":
            arrays_of_length[len(array)].append((name, array.reshape(len(array), -1)))
    for length, named in arrays_of_length.items():
        headers, columns = [], []
        for name, array in named:
            _, width = array.shape
            headers += [name] if width == 1 else [f"{name} {number}" for number in range(1, width + 1)]
            columns += list(array.T)
        rows = [[_write_cell(cell) for cell in row] for row in zip(*columns, strict=True)]
        own = str(length) if len(arrays_of_length) > 1 else ""
        yield {"name": own, "headers": headers, "rows": rows}


if __name__ == "__main__":
    given = sys.stdin.buffer.read()
    limit_this_process()
    sys.stdout.write(json.dumps(main(sys.argv[1], given)))
