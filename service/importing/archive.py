"""The parts of an Excel file: an archive from strangers, unpacked within limits, and XML without entities.

An own reader instead of a library's: openpyxl 3.1 in its read-only mode silently drops a row whose number
repeats, lets one cell replace another, and ends where a wrong `<dimension>` says. Here such files are refused
or read in full. The tests read what openpyxl writes, and compare with what it reads.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from typing import Final
from xml.parsers import expat

from jointstiff.service.importing.errors import ImportFileError, Place, shown
from jointstiff.service.importing.limits import MAX_UNPACKED_BYTES, MAX_XML_TAGS

__all__ = ["Archive", "parse_part"]

MAX_PARTS: Final = 1_000
MAX_DEPTH: Final = 32

_NAME_SPACES: Final = frozenset(
    {
        "http://schemas.openxmlformats.org/spreadsheetml/2006/main",
        "http://purl.oclc.org/ooxml/spreadsheetml/main",
        "http://schemas.openxmlformats.org/package/2006/relationships",
    }
)

_REMEDY: Final = "open it in Excel and save it again as .xlsx, or save the sheet as CSV"
_ZIP_FAULTS: Final = (
    zipfile.BadZipFile, zlib.error, struct.error, OSError, EOFError, ValueError, RuntimeError, LookupError,
    OverflowError,
)  # fmt: skip
"""What `zipfile` raises on damaged archives; NotImplementedError, of odd ones, is a RuntimeError."""


class Archive:
    """An Excel file that was opened: named parts, none larger than the limits."""

    def __init__(self, file: str, content: bytes) -> None:
        """Open it.

        Raises:
            ImportFileError: damaged, encrypted, or too large when unpacked.
        """
        self._file = file
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(content))
        except _ZIP_FAULTS as error:
            raise self._damaged(error) from None
        parts = self._zip.infolist()
        self._parts = {part.filename: part for part in parts}
        if len(parts) > MAX_PARTS or len(self._parts) != len(parts):
            raise self.refusal(f"more than {MAX_PARTS} parts, or two of one name")
        if sum(part.file_size for part in parts) > MAX_UNPACKED_BYTES:
            raise self.refusal(f"more than {MAX_UNPACKED_BYTES // 1024**2} MiB when unpacked")
        if any(part.flag_bits & 1 for part in parts):
            raise self.refusal("it is encrypted")

    def refusal(self, reason: str, line: int | None = None, column: int | None = None) -> ImportFileError:
        """The error that this file cannot be read."""
        return ImportFileError(Place(self._file, line, column), reason, _REMEDY)

    def _damaged(self, error: BaseException) -> ImportFileError:
        return self.refusal(f"not an Excel file (.xlsx), or damaged ({type(error).__name__})")

    def read(self, name: str) -> bytes:
        """The content of a part; its checksum is verified.

        Raises:
            ImportFileError: there is no such part, or it is damaged.
        """
        part = self._parts.get(name)
        if part is None:
            raise self.refusal(f"not an Excel workbook: there is no part {shown(name)}")
        if part.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise self.refusal(f"part {shown(name)} is compressed in an unusual way")
        try:
            return self._zip.read(part)  # at most the size that the archive states
        except _ZIP_FAULTS as error:
            raise self._damaged(error) from None


def parse_part(
    archive: Archive,
    name: str,
    start: Callable[[str, Mapping[str, str]], None],
    end: Callable[[str], None] | None = None,
    text: Callable[[str], None] | None = None,
) -> None:
    """Send the elements of a part to handlers, by their names; those of unknown name spaces have none.

    Attributes are named with their name space before a blank, if they have one.

    Raises:
        ImportFileError: not well-formed, beyond the limits, or with a document type, which could define
            entities.
    """
    content = archive.read(name)
    if content.count(b"<") > MAX_XML_TAGS:
        raise archive.refusal(f"more than {MAX_XML_TAGS} tags in part {shown(name)}")
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.buffer_text = True
    depth = 0
    names: dict[str, str] = {}

    def on_start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise archive.refusal(f"more than {MAX_DEPTH} levels of elements in part {shown(name)}")
        start(names[tag] if tag in names else names.setdefault(tag, _local(tag)), attributes)

    def on_end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        if end is not None:
            end(names[tag])

    parser.StartElementHandler = on_start
    parser.EndElementHandler = on_end
    parser.CharacterDataHandler = text
    parser.StartDoctypeDeclHandler = _no_doctype(archive, name)
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:  # LookupError: an unknown encoding
        raise archive.refusal(f"part {shown(name)} is not well-formed ({error})") from None


def _no_doctype(archive: Archive, name: str) -> Callable[..., None]:
    def handler(*_declaration: object) -> None:
        raise archive.refusal(f"a document type in part {shown(name)}, which could define entities")

    return handler


def _local(tag: str) -> str:
    space, _, name = tag.rpartition(" ")
    return name if space in _NAME_SPACES else ""
