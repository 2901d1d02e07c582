"""Sheets as files (CSV, npz, xlsx, JSON, Parquet; no cell is a formula) and as data frames."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from math import isfinite, nan
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from jointstiff.service.problems import naming_missing_extra
from jointstiff.service.tables.table import Sheet, Value

if TYPE_CHECKING:
    import numpy as np


_FORMULA_STARTS: Final = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20", "\t", "\r")
"""First characters of texts that a spreadsheet takes for formulas; some languages have full-width ones."""
_MAX_COLUMN_WIDTH: Final = 40
_ROWS_PER_BLOCK: Final = 4096
"""Number of rows that are formatted at a time."""
_SINGLE_DIGITS: Final = 7
"""Digits of a number in single precision."""


_SEPARATORS: Final = r";\t\n\r\v\f\x1c-\x1e\x85\u2028\u2029"
_FORMULA_AFTER_SEPARATOR: Final = re.compile(
    rf"(?<=[{_SEPARATORS}])(?=(?:[^\S{_SEPARATORS}]|[\"'])*[{re.escape(''.join(_FORMULA_STARTS))}])"
)
"""Position before a formula that follows a character at which some spreadsheets separate cells or rows.

A spreadsheet of another language may separate cells at semicolons or tabs, even within quotation marks.
"""


def escape_formula(value: Value) -> Value:
    """Return a cell with an apostrophe before each text that a spreadsheet would run as a formula."""
    if not isinstance(value, str):
        return value
    text = _FORMULA_AFTER_SEPARATOR.sub("'", value)
    return f"'{text}" if text.startswith(_FORMULA_STARTS) else text


def csv_text(sheet: Sheet) -> str:
    """Return a sheet as CSV (RFC 4180); a missing number is an empty cell."""
    return "".join(csv_parts(sheet))


def csv_parts(sheet: Sheet) -> Iterator[str]:
    """Yield a sheet as CSV in parts, so that a large sheet needs little memory."""
    columns = list(sheet.columns.values())
    row_count = len(columns[0]) if columns else 0
    yield csv_rows([[escape_formula(header) for header in sheet.columns]])
    for begin in range(0, row_count, _ROWS_PER_BLOCK):
        block = slice(begin, begin + _ROWS_PER_BLOCK)
        cells = [_format_csv_cells(column[block], sheet.digits) for column in columns]
        yield csv_rows(zip(*cells, strict=True))


def csv_rows(rows: Iterable[Sequence[Value]]) -> str:
    """Return rows of cells as CSV."""
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return text.getvalue()


def split_table_rows(text: str) -> tuple[list[list[str]], bool]:
    """Split the text of a table; return its rows of cells, and whether commas separate the cells.

    Cells are separated by semicolons or tabs if the first line has one, else by commas.

    Raises:
        csv.Error: the text is not a valid CSV table.
    """
    rows, has_comma_separators = iterate_table_rows(text)
    return list(rows), has_comma_separators


def iterate_table_rows(text: str) -> tuple[Iterator[list[str]], bool]:
    """Return an iterator of the rows of cells as `split_table_rows`, which needs little memory.

    The iterator raises a csv.Error where the text is not a valid CSV table.
    """
    first_line = text.partition("\n")[0]
    delimiter = next((sign for sign in ";\t" if sign in first_line), ",")
    rows = csv.reader(io.StringIO(text.removeprefix("\ufeff")), delimiter=delimiter)
    stripped_rows = ([cell.strip() for cell in row] for row in rows)
    return stripped_rows, delimiter == ","


def npz_bytes(sheet: Sheet) -> bytes:
    """Return a sheet as an npz file: `headers`, `table` of numbers (rows, columns), and each text column."""
    import numpy as np

    headers = [header for header in sheet.columns if header not in sheet.texts]
    columns = [np.asarray(sheet.columns[header], dtype=float) for header in headers]
    texts = {header: np.array(sheet.columns[header]) for header in sheet.texts}
    content = io.BytesIO()
    np.savez_compressed(
        content,
        allow_pickle=False,
        headers=np.array(headers),
        table=np.stack(columns, axis=1),
        **texts,
    )
    return content.getvalue()


def xlsx_bytes(sheets: Mapping[str, Sheet]) -> bytes:
    """Return an Excel workbook of sheets by name; numbers have 16 digits.

    Raises:
        MissingExtraError: openpyxl is not installed.
    """
    with naming_missing_extra("an Excel workbook"):
        from openpyxl import Workbook
        from openpyxl.styles import Font
        from openpyxl.utils import get_column_letter

    workbook = Workbook(write_only=False)
    workbook.remove(workbook.worksheets[0])
    for name, sheet in sheets.items():
        worksheet: Any = workbook.create_sheet(name)
        worksheet.append([escape_formula(header) for header in sheet.columns])
        for row in zip(*sheet.columns.values(), strict=True):
            worksheet.append([escape_formula(cell) for cell in row])
        for number, cell in enumerate(worksheet[1], 1):
            cell.font = Font(bold=True)
            width = min(len(str(cell.value)) + 2, _MAX_COLUMN_WIDTH)
            worksheet.column_dimensions[get_column_letter(number)].width = width
        worksheet.freeze_panes = "B2"
    content = io.BytesIO()
    workbook.save(content)
    return content.getvalue()


def parquet_bytes(sheet: Sheet) -> bytes:
    """Return a sheet as a Parquet file, with units in its headers.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """
    with naming_missing_extra("a Parquet file"):
        import pyarrow
        from pyarrow import parquet

    content = io.BytesIO()
    parquet.write_table(pyarrow.table(dict(sheet.columns)), content)
    return content.getvalue()


def split_header(header: str) -> tuple[str, str]:
    """Return name and unit of a header such as `force x [N]`; the unit is empty if the header has none."""
    name, bracket, unit = header.rpartition(" [")
    return (name, unit.removesuffix("]")) if bracket else (header, "")


def _format_csv_cells(column: Any, digits: str) -> Sequence[Value]:  # noqa: ANN401 - a sequence or an array
    """Return the cells of a column, numbers formatted by `digits`; NaN and infinity become empty cells."""
    values = _to_list(column)
    first_value = next((value for value in values if value is not None), None)
    if not digits or not isinstance(first_value, float):
        return [escape_formula(value) for value in values]
    numbers = [nan if value is None else value for value in values]
    # A single call formats the whole column, which is fast.
    form_of_column = "\n".join([f"%{digits}"] * len(numbers))
    cells = (form_of_column % tuple(numbers)).split("\n")
    return [cell if isfinite(number) else None for cell, number in zip(cells, numbers, strict=True)]


def _to_list(column: Any) -> list[Any]:  # noqa: ANN401 - a sequence or an array
    """Return the values of a column as a list of built-in Python types."""
    array: np.ndarray[Any, Any] = column
    if isinstance(column, list | tuple):
        return list(column)
    values: list[Any] = array.tolist()
    is_single_precision = array.dtype.itemsize == 4 and array.dtype.kind == "f"
    if is_single_precision:  # without the digits that the conversion to double precision would add
        return [float(f"{value:.{_SINGLE_DIGITS}g}") for value in values]
    return values


def json_text(sheet: Sheet) -> str:
    """Return a sheet as JSON: a list `columns`, each with `name`, `unit` and `values`; null for no number."""
    columns = list[dict[str, Any]]()
    for header, column in sheet.columns.items():
        name, unit = split_header(header)
        values = [_null_without_number(value) for value in _to_list(column)]
        columns.append({"name": name, "unit": unit, "values": values})
    return json.dumps({"columns": columns})


def _null_without_number(value: Value) -> Value:
    """Return a value for JSON, which knows neither NaN nor infinity: None for these."""
    return None if isinstance(value, float) and not isfinite(value) else value


WRITERS: Final[Mapping[str, Callable[[Sheet], str | bytes]]] = MappingProxyType(
    {"csv": csv_text, "npz": npz_bytes, "json": json_text, "parquet": parquet_bytes}
)
"""Suffix of a file's name → function that writes one sheet in this format."""


def write_sheet(sheet: Sheet, suffix: str) -> bytes:
    """Return a sheet as a file in the format that the suffix states: csv, npz, json or parquet.

    Raises:
        MissingExtraError: the library for Parquet is not installed.
    """
    content = WRITERS[suffix](sheet)
    return content.encode() if isinstance(content, str) else content


def make_latex(sheet: Sheet, caption: str = "") -> str:
    """Return a sheet as a LaTeX table, by pandas; texts are escaped.

    Raises:
        MissingExtraError: pandas is not installed.
    """
    with naming_missing_extra("to_latex"):
        import pandas
    text: str = pandas.DataFrame(dict(sheet.columns)).to_latex(
        index=False, escape=True, caption=caption.replace("_", r"\_").replace("%", r"\%") or None
    )
    return text


def make_data_frame(sheet: Sheet) -> Any:  # noqa: ANN401 - of pandas or polars, whichever is installed
    """Return a sheet as a data frame of pandas, or else of polars.

    In pandas the first column becomes the index if it has texts that are all different.

    Raises:
        MissingExtraError: neither pandas nor polars is installed.
    """
    columns = {header: list(values) for header, values in sheet.columns.items()}
    try:
        import pandas
    except ImportError:
        with naming_missing_extra("to_frame"):
            import polars
        return polars.DataFrame(columns, strict=False)
    first_header = next(iter(columns), None)
    first_column = columns[first_header] if first_header is not None else []
    are_texts = all(isinstance(value, str) for value in first_column)
    has_names = bool(first_column) and are_texts and len(set(first_column)) == len(first_column)
    frame = pandas.DataFrame(columns)
    return frame.set_index(first_header) if has_names else frame
