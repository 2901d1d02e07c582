"""Files of numbers as tables: CSV and Parquet, one row a line, a header for each column."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.service.problems import naming_missing_extra
from jointstiff.service.tables.files import split_table_rows
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError

LABEL: Final = "label"
"""Name of the column whose cells are texts."""
_PARQUET_START: Final = b"PAR1"
_LONGEST_QUOTE: Final = 40
"""Characters of a file's text in an error message."""


@dataclass(frozen=True, eq=False)
class NumberTable:
    """A table of N rows of numbers, with or without a text for each row."""

    columns: dict[str, FloatArray]  # columns (N,) by header, as the file writes it
    labels: list[str] | None  # (N,) cells of the column `label`; None without such a column


def read_number_table(content: bytes) -> NumberTable:
    """Read a CSV or Parquet file of numbers; a column `label` may have texts.

    Cells of CSV are separated by commas, semicolons or tabs; with semicolons or tabs a number may have a
    decimal comma. Empty lines are left out.

    Raises:
        RequestError: the file has no rows, a header is missing or repeated, or a cell is not a number; the
            error names line and header.
        MissingExtraError: the library for Parquet is not installed.
    """
    if content.startswith(_PARQUET_START):
        return _read_parquet(content)
    return _read_csv(content.decode("utf-8-sig", errors="replace"))


def _read_csv(text: str) -> NumberTable:
    """Read a CSV table.

    Raises:
        RequestError: the table is not understood.
    """
    try:
        rows, has_comma_separators = split_table_rows(text)
    except csv.Error:
        raise RequestError(
            "the file is not a readable CSV table", where="line 1", remedy="write a header and a row a line"
        ) from None
    lines = [(line, row) for line, row in enumerate(rows[1:], 2) if any(row)]
    if not lines:
        raise RequestError("the table has no rows", where="line 1", remedy="give a header, then a row a line")
    headers = rows[0]
    refuse_bad_headers(headers)
    labels = list[str]()
    numbers = np.empty((len(lines), len(headers)))
    for i, (line, row) in enumerate(lines):
        if len(row) != len(headers):
            raise RequestError(
                f"the row has {len(row)} cells, and the header has {len(headers)}",
                where=f"line {line}",
                remedy="give a cell for each header",
            )
        for column, (header, cell) in enumerate(zip(headers, row, strict=True)):
            if is_label(header):
                labels.append(cell)
            else:
                number = cell if has_comma_separators else cell.replace(",", ".")
                numbers[i, column] = _parse_number(number, line, header)
    columns = dict(zip(headers, numbers.T, strict=True))
    return NumberTable(
        {header: column for header, column in columns.items() if not is_label(header)}, labels or None
    )


def _parse_number(cell: str, line: int, header: str) -> float:
    """Return the number in a cell.

    Raises:
        RequestError: the cell is not a number.
    """
    try:
        return float(cell)
    except ValueError:
        raise RequestError(
            f"the cell {cell[:_LONGEST_QUOTE]!r} of the column '{header[:_LONGEST_QUOTE]}' is not a number",
            where=f"line {line}",
            remedy="write a number, or leave the row out",
        ) from None


def _read_parquet(content: bytes) -> NumberTable:
    """Read a Parquet file.

    Raises:
        MissingExtraError: pyarrow is not installed.
        RequestError: the file is not understood.
    """
    with naming_missing_extra("a Parquet file"):
        from pyarrow import ArrowInvalid, parquet

    try:
        table = parquet.read_table(io.BytesIO(content))
    except (ArrowInvalid, OSError):
        raise RequestError(
            "the file is no readable Parquet table", where="line 1", remedy="write the file again"
        ) from None
    refuse_bad_headers(table.column_names)
    if not table.num_rows:
        raise RequestError("the table has no rows", where="line 1", remedy="give a row a pose")
    columns, labels = dict[str, FloatArray](), None
    for header, column in zip(table.column_names, table.columns, strict=True):
        if is_label(header):
            labels = ["" if cell is None else str(cell) for cell in column.to_pylist()]
            continue
        try:
            columns[header] = column.to_numpy().astype(np.float64)
        except (TypeError, ValueError):
            raise RequestError(
                f"the column '{header[:_LONGEST_QUOTE]}' has cells that are not numbers",
                where="line 1",
                remedy="write columns of numbers; only the column `label` has texts",
            ) from None
    return NumberTable(columns, labels)


def is_label(header: str) -> bool:
    """Return whether a header names the column of texts."""
    return header.strip().lower() == LABEL


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
