"""Files of numbers as tables: CSV and Parquet, one row a line, a header for each column."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jointstiff.service.problems import TooManyRowsError, naming_missing_extra
from jointstiff.service.tables.files import iterate_table_rows
from jointstiff.service.tables.labels import find_label_header
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError

LABEL: Final = "label"
"""Name of the column whose cells are texts."""
MAX_LABEL: Final = 256
"""Characters of a label."""
_PARQUET_START: Final = b"PAR1"
_THRIFT_LIMITS: Final = {"thrift_string_size_limit": 8 * 1024**2, "thrift_container_size_limit": 100_000}
"""Limits of the description in a Parquet file, as pyarrow names them."""
_ROWS_PER_BLOCK: Final = 4096
_WITHOUT_UNIT: Final = re.compile(r"q[1-4]", re.IGNORECASE)
"""Headers of numbers without a unit: the components of a quaternion."""
_LONGEST_QUOTE: Final = 40
"""Characters of a file's text in an error message."""


@dataclass(frozen=True)
class TableLimits:
    """Greatest size of a table in a file that comes from elsewhere."""

    rows: int
    columns: int
    decoded_bytes: int = 128 * 1024**2  #: of all columns of a Parquet file, which may be compressed

    def refuse_rows(self, count: int) -> None:
        """Refuse a table of more rows.

        Raises:
            TooManyRowsError: names both numbers.
        """
        if count > self.rows:
            raise TooManyRowsError(
                f"the table has more than {self.rows:,} rows",
                where="files",
                remedy="send parts of the path, each with the joints of its first pose in `start`",
            )

    def refuse_columns(self, count: int) -> None:
        """Refuse a table of more columns.

        Raises:
            RequestError: names both numbers.
        """
        if count > self.columns:
            raise RequestError(
                f"the table has {count:,} columns, but may have only {self.columns}",
                where="files",
                remedy="leave out columns that are no poses, joints or loads",
            )


@dataclass(frozen=True, eq=False)
class NumberTable:
    """A table of N rows of numbers, with or without a text for each row."""

    columns: dict[str, FloatArray]  # columns (N,) by header, as the file writes it
    labels: list[str] | None  # (N,) cells of the column `label`; None without such a column


def read_number_table(content: bytes, limits: TableLimits | None = None) -> NumberTable:
    """Read a CSV or Parquet file of numbers; a column `label` may have texts.

    Other headers that name the rows, such as `Punkt`, mean `label`, too.
    Cells of CSV are separated by commas, semicolons or tabs; with semicolons or tabs a number may have a
    decimal comma. Empty lines are left out. `limits` of None allow any size: the file is the user's own.

    Raises:
        RequestError: the file has no rows, a header is missing or repeated, or a cell is not a number; the
            error names line and header.
        TooManyRowsError: the table has more rows than the limits allow.
        MissingExtraError: the library for Parquet is not installed.
    """
    if content.startswith(_PARQUET_START):
        return _read_parquet(content, limits)
    return _read_csv(content.decode("utf-8-sig", errors="replace"), limits)


def _read_csv(text: str, limits: TableLimits | None) -> NumberTable:
    """Read a CSV table.

    Raises:
        RequestError: the table is not understood.
        TooManyRowsError: the table has too many rows.
    """
    rows, has_comma_separators = iterate_table_rows(text)
    try:
        headers = next(rows, [])
        if limits is not None:
            limits.refuse_columns(len(headers))
        return _read_csv_rows(headers, rows, limits, has_comma_separators=has_comma_separators)
    except csv.Error:
        raise RequestError(
            "the file is not a readable CSV table", where="line 1", remedy="write a header and a row a line"
        ) from None


def _read_csv_rows(
    headers: Sequence[str],
    rows: Iterable[Sequence[str]],
    limits: TableLimits | None,
    *,
    has_comma_separators: bool,
) -> NumberTable:
    """Read the rows below the header of a CSV table.

    Raises:
        csv.Error: the text is not a valid CSV table.
        RequestError: a header or a cell is not understood, or there is no row.
        TooManyRowsError: the table has too many rows.
    """
    label_header = find_label_header(headers)
    names = [header for header in headers if header != label_header]
    labels, blocks, block = list[str](), list[FloatArray](), list[list[float]]()
    for line, row in _iterate_filled_rows(rows, limits):
        if not block and not blocks:
            refuse_bad_headers(headers)
        numbers = list[float]()
        for header, cell in _name_cells(headers, row, line):
            if header == label_header:
                labels.append(_check_label(cell, f"line {line}"))
                continue
            text = cell if has_comma_separators else cell.replace(",", ".")
            numbers.append(_parse_number(text, line, header))
        block.append(numbers)
        if len(block) == _ROWS_PER_BLOCK:
            blocks.append(np.array(block, dtype=np.float64))
            block.clear()
    if not block and not blocks:
        raise RequestError("the table has no rows", where="line 1", remedy="give a header, then a row a line")
    last_block = np.array(block, dtype=np.float64).reshape(-1, len(names))
    table = np.concatenate([*blocks, last_block])
    columns = np.ascontiguousarray(table.T)
    return NumberTable(dict(zip(names, columns, strict=True)), labels or None)


def _iterate_filled_rows(
    rows: Iterable[Sequence[str]], limits: TableLimits | None
) -> Iterator[tuple[int, Sequence[str]]]:
    """Yield number of line and cells of each row that is not empty.

    Raises:
        TooManyRowsError: the table has too many rows.
    """
    count = 0
    for line, row in enumerate(rows, 2):
        if any(row):
            count += 1
            if limits is not None:
                limits.refuse_rows(count)
            yield line, row


def _name_cells(headers: Sequence[str], row: Sequence[str], line: int) -> list[tuple[str, str]]:
    """Return header and cell of each column.

    Raises:
        RequestError: the row has more or fewer cells than the header.
    """
    if len(row) != len(headers):
        raise RequestError(
            f"the row has {len(row)} cells, but the header has {len(headers)}",
            where=f"line {line}",
            remedy="give a cell for each header",
        )
    return list(zip(headers, row, strict=True))


def _check_label(label: str, where: str) -> str:
    """Return a label.

    Raises:
        RequestError: the label is too long.
    """
    if len(label) > MAX_LABEL:
        raise RequestError(
            f"the label has {len(label):,} characters, but may have only {MAX_LABEL}",
            where=where,
            remedy="write shorter labels",
        )
    return label


def _parse_number(cell: str, line: int, header: str) -> float:
    """Return the number in a cell.

    Raises:
        RequestError: the cell is not a number.
    """
    try:
        return float(cell)
    except ValueError:
        remedy = "write a number, or leave the row out"
        if _WITHOUT_UNIT.fullmatch(header.strip()) is None and "[" not in header:
            remedy = f"if the column names the rows, call the column `label`; else {remedy}"
        raise RequestError(
            f"the cell {cell[:_LONGEST_QUOTE]!r} of the column '{header[:_LONGEST_QUOTE]}' is not a number",
            where=f"line {line}",
            remedy=remedy,
        ) from None


def _read_parquet(content: bytes, limits: TableLimits | None) -> NumberTable:
    """Read a Parquet file. Its description is checked before any column is decoded.

    Raises:
        MissingExtraError: pyarrow is not installed.
        RequestError: the file is not understood, or is larger than the limits allow.
        TooManyRowsError: the table has too many rows.
    """
    with naming_missing_extra("a Parquet file"):
        import pyarrow
        from pyarrow import parquet

    source = pyarrow.BufferReader(content)
    try:
        schema = parquet.ParquetFile(source, **_THRIFT_LIMITS).schema_arrow
        # Labels are decoded by a dictionary: a text that is repeated in all rows needs its memory once.
        label_header = find_label_header(schema.names)
        labels = [] if label_header is None else [label_header]
        file = parquet.ParquetFile(
            source, read_dictionary=labels, arrow_extensions_enabled=False, **_THRIFT_LIMITS
        )
        refuse_bad_headers(schema.names)
        if limits is not None:
            _refuse_large_parquet(file.metadata, limits)
        for each in schema:
            _refuse_other_column(each.name, each.type, names_rows=each.name == label_header)
        table = file.read(use_threads=False)
    except (pyarrow.ArrowException, OSError):
        raise RequestError(
            "the file is no readable Parquet table", where="line 1", remedy="write the file again"
        ) from None
    if not table.num_rows:
        raise RequestError("the table has no rows", where="line 1", remedy="give a row a pose")
    columns, texts = dict[str, FloatArray](), None
    for header, column in zip(table.column_names, table.columns, strict=True):
        if header == label_header:
            texts = [text for chunk in column.chunks for text in _read_labels(chunk)]
        else:
            columns[header] = column.to_numpy().astype(np.float64)
    return NumberTable(columns, texts)


def _read_labels(chunk: Any) -> list[str]:  # noqa: ANN401 - an array of pyarrow
    """Return the labels in a chunk of a column; a text that several rows have is kept once.

    Raises:
        RequestError: a label is too long.
    """
    if not hasattr(chunk, "dictionary"):
        return ["" if cell is None else str(cell) for cell in chunk.to_pylist()]
    texts = [_check_label(each.as_py() or "", f"column {LABEL}") for each in chunk.dictionary]
    return ["" if index is None else texts[index] for index in chunk.indices.to_pylist()]


def _refuse_large_parquet(description: Any, limits: TableLimits) -> None:  # noqa: ANN401 - of pyarrow
    """Refuse a Parquet file by its description, before it is decoded.

    Raises:
        TooManyRowsError: the table has too many rows.
        RequestError: the table has too many columns, or takes too much memory.
    """
    groups = [description.row_group(number) for number in range(description.num_row_groups)]
    limits.refuse_rows(max(description.num_rows, sum(each.num_rows for each in groups)))
    limits.refuse_columns(description.num_columns)
    size = sum(each.total_byte_size for each in groups)
    if size > limits.decoded_bytes:
        raise RequestError(
            f"the columns take {size / 2**20:,.0f} MiB, but may take only {limits.decoded_bytes // 2**20}",
            where="files",
            remedy="leave out columns that are no poses, joints or loads, and shorten the labels",
        )


def _refuse_other_column(
    header: str,
    kind: Any,  # noqa: ANN401 - a type of pyarrow
    *,
    names_rows: bool,
) -> None:
    """Refuse a column of a Parquet file that has no numbers, and labels that are no texts or numbers.

    Raises:
        RequestError: names the header.
    """
    from pyarrow import types

    is_number = types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind)
    is_text = types.is_string(kind) or types.is_large_string(kind) or types.is_null(kind)
    is_name = is_text or (types.is_dictionary(kind) and types.is_string(kind.value_type))
    if not (is_number or (names_rows and is_name)):
        raise RequestError(
            f"the column '{header[:_LONGEST_QUOTE]}' has cells that are not numbers",
            where="line 1",
            remedy="write columns of numbers; only the column `label` has texts",
        )


def refuse_bad_headers(headers: Sequence[str]) -> None:
    """Refuse a column without a header, and two columns whose names differ at most in their units.

    Raises:
        RequestError: names the header.
    """
    names = set[str]()
    for number, header in enumerate(headers, 1):
        name = header.partition("[")[0].strip().lower()
        if not name:
            raise RequestError(
                f"column {number} has no header", where="line 1", remedy="give each column a header"
            )
        if name in names:
            raise RequestError(
                f"the header '{header[:_LONGEST_QUOTE]}' occurs twice",
                where="line 1",
                remedy="give each column a header of its own",
            )
        names.add(name)
