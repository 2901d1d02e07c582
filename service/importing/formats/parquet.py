"""Parquet files as tables: imported by the process that reads them alone."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from jointstiff.service.importing import limits
from jointstiff.service.importing.formats.columns import (
    Array,
    ByteCount,
    Tables,
    UnreadableError,
    check_name,
    clean_text,
    find_cell_kind,
    write_number,
)


def read_parquet(content: bytes) -> Tables:
    """Return the one table of a Parquet file."""
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
    source = pa.BufferReader(content)
    thrift_limits = {"thrift_string_size_limit": 8 * 1024**2, "thrift_container_size_limit": 100_000}
    schema = parquet.ParquetFile(source, **thrift_limits).schema_arrow
    texts = [field.name for field in schema if pa.types.is_string(field.type) or _is_text(field.type)]
    file = parquet.ParquetFile(source, read_dictionary=texts, arrow_extensions_enabled=False, **thrift_limits)
    meta = file.metadata
    is_wide = meta.num_columns > limits.MAX_COLUMNS or meta.num_rows > limits.MAX_ROWS
    if is_wide or meta.num_rows * meta.num_columns > limits.MAX_CELLS:
        raise MemoryError
    ByteCount().take(sum(meta.row_group(i).total_byte_size for i in range(meta.num_row_groups)))
    names = [check_name(field.name) for field in schema]
    if len(set(names)) < len(names):
        raise UnreadableError("two columns have the same name", "give each column a name of its own")
    return {"": lambda: [_read_column(file, name) for name in names]}


def _is_text(kind: pa.DataType) -> bool:
    """Return whether a type of Arrow is of texts, or of texts by numbers of a dictionary."""
    is_text = pa.types.is_large_string(kind) or pa.types.is_string(kind)
    return is_text or (pa.types.is_dictionary(kind) and _is_text(kind.value_type))


def _read_column(file: parquet.ParquetFile, name: str) -> Array:
    """Return a column of a Parquet file: numbers, texts, times, or lists of numbers of one length."""
    leaves = [path for path in (file.schema.column(i).path for i in range(len(file.schema)))
              if path == name or path.startswith(f"{name}.")]  # fmt: skip
    values = file.read(columns=leaves, use_threads=False).column(0).combine_chunks()
    kind = values.type
    if pa.types.is_dictionary(kind):
        texts = [clean_text(each) for each in values.dictionary.to_pylist()]
        cells = [None if i is None else texts[i] for i in values.indices.to_pylist()]
        return Array(name=name, unit=None, kind="text", columns=[cells])
    if _is_number(kind):
        cells = [write_number(each) for each in values.to_pylist()]
        return Array(
            name=name, unit=None, kind=find_cell_kind(np.dtype(kind.to_pandas_dtype())), columns=[cells]
        )
    if pa.types.is_decimal(kind):
        cells = [None if each is None else str(each) for each in values.to_pylist()]
        return Array(name=name, unit=None, kind="number", columns=[cells])
    if pa.types.is_temporal(kind) or _is_text(kind):
        cells = [None if each is None else clean_text(each) for each in values.to_pylist()]
        return Array(name=name, unit=None, kind="text", columns=[cells])
    columns = _list_columns_of_lists(values)
    elements = "text" if columns is None else find_cell_kind(np.dtype(kind.value_type.to_pandas_dtype()))
    return Array(name=name, unit=None, kind=elements, columns=columns)


def _is_number(kind: pa.DataType) -> bool:
    """Return whether a type of Arrow is of numbers or of truth values."""
    return bool(pa.types.is_boolean(kind) or pa.types.is_integer(kind) or pa.types.is_floating(kind))


def _list_columns_of_lists(values: pa.Array) -> list[list[str | None]] | None:
    """Return columns of cells of lists of numbers that have one length; None for other values."""
    kind = values.type
    is_list = pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    if not is_list or not _is_number(kind.value_type):
        return None
    if len(values.flatten()) > limits.MAX_CELLS:
        raise MemoryError
    rows = values.to_pylist()
    lengths = {len(row) for row in rows if row is not None}
    if len(lengths) != 1 or max(lengths) > limits.MAX_COLUMNS:
        return None
    (length,) = lengths
    return [[None if row is None else write_number(row[i]) for row in rows] for i in range(length)]
