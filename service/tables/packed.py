"""Sheets as bytes to store: an `npz` archive with exact numbers, read by `unpack_sheet`.

The archive has the array `numbers` with a row for each column of numbers, and `head`, the text of a JSON
object with the headers and the columns of texts.
"""

from __future__ import annotations

import io
import json
import re
import zlib
from typing import Final
from zipfile import BadZipFile, ZipFile

import numpy as np
import numpy.typing as npt

from jointstiff.service.tables.table import Sheet
from jointstiff.solver.errors import RequestError

_BEGINNING: Final = re.compile(rb"PK\x03\x04.{26}head\.npy", re.DOTALL)
"""Header of an archive's first file, with its name."""
_MOST_BYTES: Final = 256 * 1024**2
"""Greatest size of an archive's arrays, which may be compressed: packed sheets may come from elsewhere."""
_DAMAGES: Final = (
    BadZipFile,
    zlib.error,
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    StopIteration,
    MemoryError,
    RecursionError,
    RuntimeError,  # the archive is encrypted, or compressed in an unknown way
)
"""Errors of an archive that is damaged, or that something else wrote."""


def is_packed(content: bytes) -> bool:
    """Return whether bytes are those of a packed sheet, and not those of a text or of another archive."""
    return _BEGINNING.match(content) is not None


def pack_sheet(sheet: Sheet) -> bytes:
    """Return a sheet as bytes; columns that are no texts have numbers, or NaN."""
    numbers = list[npt.NDArray[np.float64]]()
    for header, column in sheet.columns.items():
        if header not in sheet.texts:
            numbers.append(np.asarray(column, dtype=np.float64))
    texts = {header: list(sheet.columns[header]) for header in sorted(sheet.texts)}
    head = {"headers": list(sheet.columns), "texts": texts, "digits": sheet.digits}
    head_text = np.array(json.dumps(head))
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, head=head_text, numbers=np.stack(numbers))
    return content.getvalue()


def unpack_sheet(content: bytes) -> Sheet:
    """Return the sheet from bytes that `pack_sheet` wrote.

    Raises:
        RequestError: the bytes are no packed sheet.
    """
    try:
        with ZipFile(io.BytesIO(content)) as archive:
            size = sum(each.file_size for each in archive.infolist())
        if size > _MOST_BYTES:
            raise ValueError("the archive has too many bytes")
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            head, numbers = json.loads(str(stored["head"])), stored["numbers"]
        if numbers.ndim != 2 or numbers.dtype != np.float64:
            raise ValueError("the archive has no columns of numbers")
        headers, texts, columns_of_numbers = map(str, head["headers"]), head["texts"], iter(numbers)
        columns = {
            header: texts[header] if header in texts else next(columns_of_numbers) for header in headers
        }
        return Sheet(columns, frozenset(texts), head["digits"])
    except _DAMAGES as error:
        raise RequestError(
            "the stored table is damaged", where="files", remedy="send the file again"
        ) from error
