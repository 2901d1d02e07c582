"""Sheets as bytes to store: an `npz` archive with exact numbers, read by `unpack_sheet`.

The archive has the array `numbers` with a row for each column of numbers, and `head`, the text of a JSON
object with the headers and the columns of texts.
"""

from __future__ import annotations

import io
import json
from zipfile import BadZipFile

import numpy as np

from jointstiff.service.tables.table import Sheet
from jointstiff.solver.errors import RequestError


def pack_sheet(sheet: Sheet) -> bytes:
    """Return a sheet as bytes; columns that are no texts have numbers, or NaN."""
    numbers = [
        np.asarray(column, dtype=np.float64)
        for header, column in sheet.columns.items()
        if header not in sheet.texts
    ]
    head = {
        "headers": list(sheet.columns),
        "texts": {header: list(sheet.columns[header]) for header in sorted(sheet.texts)},
        "digits": sheet.digits,
    }
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, head=np.array(json.dumps(head)), numbers=np.stack(numbers))
    return content.getvalue()


def unpack_sheet(content: bytes) -> Sheet:
    """Return the sheet from bytes that `pack_sheet` wrote.

    Raises:
        RequestError: the bytes are no packed sheet.
    """
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            head, numbers = json.loads(str(stored["head"])), iter(stored["numbers"])
        texts = head["texts"]
        columns = {header: texts[header] if header in texts else next(numbers) for header in head["headers"]}
        return Sheet(columns, frozenset(texts), head["digits"])
    except (BadZipFile, ValueError, KeyError, TypeError, EOFError, StopIteration) as error:
        raise RequestError(
            "the stored table is damaged", where="files", remedy="send the file again"
        ) from error
