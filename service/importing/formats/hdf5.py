"""HDF5 files, also those of MATLAB 7.3, as tables: imported by the process that reads them alone."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from typing import Final

import h5py
import numpy as np

from jointstiff.service.importing import limits
from jointstiff.service.importing.formats.columns import (
    Array,
    ByteCount,
    NamedArray,
    Tables,
    UnreadableError,
    check_name,
    clean_text,
    tabulate,
)

_TEXTS_AT_ONCE: Final = 16
"""Texts of variable length that are read at once: each may be as long as the file."""
_MAX_TEXTS_OF_CELLS: Final = 10_000
"""Texts of a cell array of MATLAB: an array for each."""
_COMPLEX: Final = ("real", "imag")
"""Names of the two parts of complex numbers in files of MATLAB 7.3."""
_LEAST_BYTES: Final = {"i": 1, "u": 1, "f": 4}
"""Least size of numbers that attributes may scale, by their kind."""
_MAX_NUMBERS: Final = 64
"""Numbers of an attribute."""
_FILTERS: Final = frozenset((1, 2, 3))
"""Filters of chunks that are read: deflate (gzip), shuffle, fletcher32."""


def read_hdf5(content: bytes, *, every_length: bool = False) -> Tables:
    """Return a function for each table of an HDF5 file, by the table's name; the function reads the table.

    A group is a table if it has an array of one or two dimensions with more than one value. Each array of
    records is a table, too.
    """
    file = h5py.File(io.BytesIO(content), "r")
    groups: dict[str, list[h5py.Dataset]] = {}
    records: dict[str, h5py.Dataset] = {}
    for path, dataset in _walk(file):
        is_table = dataset.dtype.names and dataset.dtype.names != _COMPLEX
        if is_table and dataset.shape is not None:
            records[path] = dataset
        else:
            groups.setdefault(path.rpartition("/")[0], []).append(dataset)
    count = ByteCount()

    def read_group(datasets: list[h5py.Dataset]) -> list[Array]:
        arrays = (_read_dataset(each, count) for each in datasets)
        return tabulate(arrays, every_length=every_length)

    def read_records(dataset: h5py.Dataset) -> list[Array]:
        _check_storage(dataset, count)
        values = dataset[()]
        return tabulate(
            NamedArray(name, _keep_texts(np.asarray(values[name]))) for name in dataset.dtype.names
        )

    tables: dict[str, Callable[[], list[Array]]] = {}
    for path, datasets in groups.items():
        if any(each.shape and len(each.shape) <= 2 and each.size > 1 for each in datasets):
            tables[path or "/"] = lambda datasets=datasets: read_group(datasets)  # type: ignore[misc]
    for path, dataset in records.items():
        tables[path] = lambda dataset=dataset: read_records(dataset)  # type: ignore[misc]
    return tables


def _keep_texts(array: np.ndarray) -> np.ndarray | None:
    """Return an array unless it has other objects than texts."""
    is_text = array.dtype.kind != "O" or all(isinstance(each, str | bytes) for each in array.ravel())
    return array if is_text else None


def _walk(file: h5py.File) -> Iterator[tuple[str, h5py.Dataset]]:
    """Yield path and array of each array in a file; links to names and to other files are not followed.

    Raises:
        MemoryError: the file has too many objects.
        UnreadableError: the file has a frame of pandas, or a path that is longer than a cell may be.
    """
    remaining, count = [("", file)], 0
    seen = {h5py.h5o.get_info(file.id).addr}  # groups that were found: links may make circles
    while remaining:
        path, group = remaining.pop(0)
        if "pandas_type" in group.attrs:
            raise UnreadableError(
                "the file contains a frame of pandas, whose names and texts are pickled in HDF5",
                "write the frame as Parquet or CSV",
            )
        for name in group:
            count += 1
            if count > limits.MAX_OBJECTS:
                raise MemoryError
            is_hard = isinstance(group.get(name, getlink=True), h5py.HardLink)
            if not is_hard or name.startswith("#"):
                continue
            member = group[name]
            inner = check_name(f"{path}/{name}" if path else name)
            if isinstance(member, h5py.Dataset):
                yield inner, member
            elif isinstance(member, h5py.Group) and (place := h5py.h5o.get_info(member.id).addr) not in seen:
                seen.add(place)
                remaining.append((inner, member))


def _check_storage(dataset: h5py.Dataset, count: ByteCount) -> None:
    """Refuse an array that is stored elsewhere, is too large, or has a filter other than gzip's.

    Raises:
        MemoryError: the array is too large.
        UnreadableError: the array is stored in another file, or by another filter.
    """
    if dataset.is_virtual or dataset.external:
        raise UnreadableError(
            f"the array {_find_name(dataset)!r} is stored in other files", "copy the array into one file"
        )
    count.take(dataset.size * dataset.dtype.itemsize)
    if dataset.chunks:
        count.take(int(np.prod(dataset.chunks, dtype=object)) * dataset.dtype.itemsize)
    filters = dataset.id.get_create_plist()
    if any(filters.get_filter(i)[0] not in _FILTERS for i in range(filters.get_nfilters())):
        raise UnreadableError(
            f"the array {_find_name(dataset)!r} is packed by a filter other than gzip",
            "save the array with gzip, or without a filter",
        )


def _find_name(dataset: h5py.Dataset) -> str:
    """Return the path of an array; HDF5 searches the whole file for the name of one found by reference."""
    return str(dataset.name).lstrip("/")


def _read_dataset(dataset: h5py.Dataset, count: ByteCount) -> NamedArray:
    """Read an array of numbers or texts; its values are None if the array cannot be used.

    Arrays written by MATLAB are stored transposed. MATLAB stores a text as numbers of characters; such an
    array is not read as numbers.
    """
    name, matlab_class = dataset.name.rpartition("/")[2], _read_attribute(dataset, "MATLAB_class")
    if matlab_class and _read_number_attribute(dataset, "MATLAB_empty"):  # its values are the empty shape
        return NamedArray(name, None)
    unit = _read_attribute(dataset, "units") or _read_attribute(dataset, "unit")
    if dataset.shape is None or not 1 <= dataset.ndim <= 2 or dataset.size > limits.MAX_CELLS:
        return NamedArray(name, None)
    _check_storage(dataset, count)
    values: np.ndarray | None = None
    if matlab_class == "cell":
        values = _read_texts_of_cells(dataset)
    elif h5py.check_string_dtype(dataset.dtype) is not None and dataset.dtype.kind == "O":
        is_single_column = dataset.size == len(dataset)
        values = _read_long_texts(dataset) if is_single_column else None
    elif dataset.dtype.names == _COMPLEX:
        parts = dataset[()]
        values = parts["real"] + 1j * parts["imag"]
    elif dataset.dtype.kind in "iubfcS" and matlab_class != "char":
        values = _decode_numbers(dataset, dataset[()])
        values = values.astype(np.bool_) if matlab_class == "logical" else values
    if values is not None and matlab_class:
        values = values.T
    return NamedArray(name, values, unit)


def _decode_numbers(dataset: h5py.Dataset, stored: np.ndarray) -> np.ndarray:
    """Return the numbers that stored ones mean by the attributes of the CF conventions; NaN where missing.

    Missing are `_FillValue`, `missing_value`, the array's own fill value unless it is 0, and what is outside
    `valid_min`, `valid_max` or `valid_range`; other numbers are multiplied by `scale_factor`, and
    `add_offset` is added. Truth values, texts and numbers of half precision are returned unchanged.

    Raises:
        UnreadableError: an attribute has texts, or another count of numbers.
    """
    if stored.dtype.kind not in "iuf" or stored.dtype.itemsize < _LEAST_BYTES[stored.dtype.kind]:
        return stored
    missing = [*_read_numbers(dataset, "_FillValue"), *_read_numbers(dataset, "missing_value")]
    creation = dataset.id.get_create_plist()
    if creation.fill_value_defined() == h5py.h5d.FILL_VALUE_USER_DEFINED and dataset.fillvalue:
        missing.append(float(dataset.fillvalue))
    least = [*_read_numbers(dataset, "valid_min", 1), *_read_numbers(dataset, "valid_range", 2)[:1]]
    greatest = [*_read_numbers(dataset, "valid_max", 1), *_read_numbers(dataset, "valid_range", 2)[1:]]
    factor = _read_numbers(dataset, "scale_factor", 1)
    offset = _read_numbers(dataset, "add_offset", 1)
    if not (missing or least or greatest or factor or offset):
        return stored
    numbers = stored.astype(np.float64)
    is_missing = np.isin(numbers, missing)
    if stored.dtype.kind == "f":  # the mark may be written with more digits than the array has
        with np.errstate(over="ignore"):
            is_missing |= np.isin(stored, np.asarray(missing).astype(stored.dtype))
    for limit in least:
        is_missing |= numbers < limit
    for limit in greatest:
        is_missing |= numbers > limit
    numbers = numbers * (factor or [1.0])[0] + (offset or [0.0])[0]
    numbers[is_missing] = np.nan
    return numbers


def _read_numbers(dataset: h5py.Dataset, name: str, count: int | None = None) -> list[float]:
    """Return the numbers of an attribute; no numbers without the attribute.

    Raises:
        UnreadableError: the attribute has no numbers, or not `count` numbers.
    """
    if name not in dataset.attrs:
        return []
    attribute = dataset.attrs.get_id(name)
    size = 0 if attribute.shape is None else int(np.prod(attribute.shape, dtype=object))
    is_readable = attribute.dtype.kind in "iuf" and 1 <= size <= _MAX_NUMBERS
    if not is_readable or count not in (None, size):
        raise UnreadableError(
            f"the attribute {name!r} of the array {_find_name(dataset)!r} is not understood",
            f"write {count or 'the'} number{'s' if count != 1 else ''} into the attribute, or remove it",
        )
    return np.asarray(dataset.attrs[name], dtype=np.float64).ravel().tolist()


def _read_attribute(dataset: h5py.Dataset, name: str) -> str | None:
    """Return the text of an attribute; None without it, and if it is no text.

    Raises:
        UnreadableError: the text is longer than a cell may be.
    """
    if name not in dataset.attrs:
        return None
    attribute = dataset.attrs.get_id(name)
    if attribute.shape not in ((), (1,)) or h5py.check_string_dtype(attribute.dtype) is None:
        return None
    value = dataset.attrs[name]
    value = value[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return check_name(text.strip(" \0")) if isinstance(text, str) else None


def _read_long_texts(dataset: h5py.Dataset) -> np.ndarray:
    """Return texts of variable length, read some at once."""
    if len(dataset) > limits.MAX_ROWS:
        raise MemoryError
    texts: list[str] = []
    for start in range(0, len(dataset), _TEXTS_AT_ONCE):
        texts += map(clean_text, dataset[start : start + _TEXTS_AT_ONCE].ravel())
    return np.array(texts)


def _read_texts_of_cells(dataset: h5py.Dataset) -> np.ndarray | None:
    """Return the texts of a cell array of MATLAB, which refers to an array for each text."""
    if (
        h5py.check_ref_dtype(dataset.dtype) is None
        or min(dataset.shape) != 1
        or dataset.size > _MAX_TEXTS_OF_CELLS
    ):
        return None
    texts = []
    for reference in dataset[()].ravel():
        text = dataset.file[reference] if reference else None
        if not isinstance(text, h5py.Dataset) or _read_attribute(text, "MATLAB_class") != "char":
            return None
        if text.dtype.kind != "u" or text.size > limits.MAX_CELL_LENGTH or text.shape is None:
            return None
        _check_storage(text, ByteCount())
        is_empty = _read_number_attribute(text, "MATLAB_empty")
        texts.append("" if is_empty else clean_text("".join(map(chr, text[()].ravel().tolist()))))
    return np.array(texts).reshape(dataset.shape)


def _read_number_attribute(dataset: h5py.Dataset, name: str) -> int:
    """Return the number of an attribute; 0 without it."""
    is_scalar = name in dataset.attrs and dataset.attrs.get_id(name).shape == ()
    value = dataset.attrs[name] if is_scalar else 0
    return int(value) if isinstance(value, int | np.integer) else 0
