"""Tables as data frames of pandas, or of polars where pandas is not installed."""

from __future__ import annotations

from typing import Any

from jointstiff.service.tables.table import Sheet


def frame_of(sheet: Sheet) -> Any:  # noqa: ANN401 - of pandas or polars, whichever is installed
    """Return a table as a data frame; the first column is the index of pandas if it names the rows.

    Raises:
        ImportError: neither is installed.
    """
    columns = {header: list(values) for header, values in sheet.columns.items()}
    try:
        import pandas
    except ImportError:
        return _polars(columns)
    first = next(iter(columns), None)
    names = columns[first] if first is not None else []
    named = bool(names) and all(isinstance(name, str) for name in names) and len(set(names)) == len(names)
    frame = pandas.DataFrame(columns)
    return frame.set_index(first) if named else frame


def _polars(columns: dict[str, list[Any]]) -> Any:  # noqa: ANN401 - of polars
    try:
        import polars
    except ImportError:
        raise ImportError('to_frame needs pandas or polars: pip install "jointstiff[frames]"') from None
    return polars.DataFrame(columns, strict=False)
