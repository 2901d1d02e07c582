"""Sheets as bytes to store: exact numbers, small when compressed, read by `unpack_sheet`.

The bytes are two arrays in NumPy's format `npy`: the text of a JSON object with the headers and the columns
of texts; and for each column of numbers the differences of the bits of neighbouring rows, first bytes of all
rows together, then second bytes and so on. Neighbouring rows differ little, so that many bytes are equal.
"""

from __future__ import annotations

import io
import json

import numpy as np

from jointstiff.service.tables.table import Sheet
from jointstiff.solver.errors import RequestError

_NUMBER_BYTES = 8


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
    bits = np.stack(numbers).view(np.uint64)
    differences = np.diff(bits, axis=1, prepend=np.uint64(0))
    planes = differences.view(np.uint8).reshape(*bits.shape, _NUMBER_BYTES).transpose(0, 2, 1)
    content = io.BytesIO()
    for array in (np.frombuffer(json.dumps(head).encode(), dtype=np.uint8), np.ascontiguousarray(planes)):
        np.save(content, array, allow_pickle=False)
    return content.getvalue()


def unpack_sheet(content: bytes) -> Sheet:
    """Return the sheet from bytes that `pack_sheet` wrote.

    Raises:
        RequestError: the bytes are no packed sheet.
    """
    stored = io.BytesIO(content)
    try:
        text, planes = (np.load(stored, allow_pickle=False) for _ in range(2))
        head = json.loads(text.tobytes())
        differences = np.ascontiguousarray(planes.transpose(0, 2, 1)).view(np.uint64)[:, :, 0]
        numbers = iter(np.cumsum(differences, axis=1, dtype=np.uint64).view(np.float64))
        texts = head["texts"]
        columns = {header: texts[header] if header in texts else next(numbers) for header in head["headers"]}
        return Sheet(columns, frozenset(texts), head["digits"])
    except (ValueError, KeyError, TypeError, EOFError, StopIteration) as error:
        raise RequestError(
            "the stored table is damaged", where="files", remedy="send the file again"
        ) from error
