"""The parts of an Excel file: an archive from strangers, unpacked and parsed within limits.

An own reader instead of a library's. Where cells repeat or are out of order, openpyxl 3.1 and python-calamine
0.9 drop rows silently; calamine also reads `2&#46;5` as 2, does not distinguish 50 % from 0.5, and aborts the
process on a single cell far from the others. Here such files are refused or read in full.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Iterator
from itertools import product
from types import MappingProxyType
from typing import IO, Final
from xml.etree.ElementTree import Element, ParseError, XMLParser, iterparse

from jointstiff.service.importing.errors import ImportFileError, Place, shown
from jointstiff.service.importing.limits import MAX_UNPACKED_BYTES, MAX_XML_TAGS

MAX_PARTS: Final = 1_000
MAX_RATIO: Final = 100
"""Size of a part over its size when packed; that of sheets is around 10."""
MAX_PLAIN_BYTES: Final = 1024 * 1024
"""Size of a part below which its ratio does not matter."""
MAX_DEPTH: Final = 32
MAX_MARKUP_BYTES: Final = 256 * 1024
"""Between two tags, or within one: no cell of Excel is longer."""
MAX_CHILDREN: Final = 100_000
"""Elements within one that is read as a whole: a row, a text, all formats."""

_SPACES: Final = (
    "http://schemas.openxmlformats.org/spreadsheetml/2006/main",
    "http://purl.oclc.org/ooxml/spreadsheetml/main",
    "http://schemas.openxmlformats.org/package/2006/relationships",
)
_TAGS: Final = (
    "Relationship sheet si numFmts numFmt cellXfs xf col row c f v is t r rPr rPh phoneticPr extLst"
)
NAMES: Final = MappingProxyType({f"{{{space}}}{tag}": tag for space, tag in product(_SPACES, _TAGS.split())})
"""Tags with their name spaces, and the names by which this package knows them; all others are unknown."""

_REMEDY: Final = "open it in Excel and save it again as .xlsx, or save the sheet as CSV"
_ZIP_FAULTS: Final = (
    zipfile.BadZipFile, zlib.error, struct.error, OSError, EOFError, ValueError, RuntimeError, LookupError,
    OverflowError,
)  # fmt: skip
"""What `zipfile` raises on damaged archives; NotImplementedError, of odd ones, is a RuntimeError."""


class Archive:
    """An Excel file that was opened: named parts, within limits that hold for all of them together."""

    def __init__(self, file: str, content: bytes) -> None:
        """Open it.

        Raises:
            ImportFileError: damaged, encrypted, or too large when unpacked.
        """
        self._file = file
        self._tags = 0
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
        if any(part.file_size > MAX_PLAIN_BYTES + MAX_RATIO * part.compress_size for part in parts):
            raise self.refusal(f"a part that is more than {MAX_RATIO} times as large when unpacked")
        if any(part.flag_bits & 1 for part in parts):
            raise self.refusal("it is encrypted")

    def refusal(self, reason: str, line: int | None = None, column: int | None = None) -> ImportFileError:
        """Build the error that this file cannot be read."""
        return ImportFileError(Place(self._file, line, column), reason, _REMEDY)

    def elements(self, name: str, *wanted: str) -> Iterator[Element]:
        """Yield elements of a part in their order, each with all that it contains; the rest is not kept.

        Args:
            name: of the part.
            wanted: names of the elements; none of them may contain another.

        Raises:
            ImportFileError: no such part, damaged, not well-formed, beyond the limits, or with a document
                type, which could define entities.
        """
        part = self._parts.get(name)
        if part is None:
            raise self.refusal(f"not an Excel workbook: there is no part {shown(name)}")
        if part.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise self.refusal(f"part {shown(name)} uses an unsupported compression")
        try:
            with self._zip.open(part) as stream:  # which ends at the size that the archive states
                yield from self._parsed(_Guard(self, name, stream), name, wanted)
        except ParseError as error:
            raise self.refusal(f"part {shown(name)} is not well-formed ({error})") from None
        except _ZIP_FAULTS as error:
            raise self._damaged(error) from None

    def count(self, name: str, tags: int) -> None:
        """Count tags of a part.

        Raises:
            ImportFileError: there are too many in all parts that were read.
        """
        self._tags += tags
        if self._tags > MAX_XML_TAGS:
            raise self.refusal(f"more than {MAX_XML_TAGS} tags in part {shown(name)} and those before it")

    def _parsed(self, stream: _Guard, name: str, wanted: tuple[str, ...]) -> Iterator[Element]:
        tags = {tag for tag, known in NAMES.items() if known in wanted}
        path: list[Element] = []
        outermost, children = 0, 0  # depth of the wanted element that is open, and what it contains
        parser = XMLParser(encoding="utf-8")  # noqa: S314 - the guard refuses document types; whatever it claims
        events = iterparse(stream, ("start", "end"), parser)  # noqa: S314
        for event, element in events:
            if event == "start":
                path.append(element)
                children += 1
                if len(path) > MAX_DEPTH or (outermost and children > MAX_CHILDREN):
                    limits = f"{MAX_DEPTH} levels of elements, or {MAX_CHILDREN} in one,"
                    raise self.refusal(f"more than {limits} in part {shown(name)}")
                if element.tag in tags:
                    if outermost:
                        raise self.refusal(f"the workbook is damaged: element {shown(element.tag)} is nested")
                    outermost, children = len(path), 0
                continue
            if len(path) == outermost:
                yield element
                outermost = 0
            path.pop()
            if path and not outermost:
                del path[-1][:]

    def _damaged(self, error: BaseException) -> ImportFileError:
        return self.refusal(f"not an Excel file (.xlsx), or damaged ({type(error).__name__})")


class _Guard:
    """A stream of XML that ends where it breaks a limit."""

    def __init__(self, archive: Archive, name: str, stream: IO[bytes]) -> None:
        self._archive, self._name, self._stream = archive, name, stream
        self._last = b""
        self._run = 0

    def read(self, size: int = -1, /) -> bytes:
        data = self._stream.read(size)
        self._archive.count(self._name, data.count(b"<"))
        if b"<!DOCTYPE" in self._last + data:
            reason = f"a document type in part {shown(self._name)}, which could define entities"
            raise self._archive.refusal(reason)
        self._last = data[-8:]
        self._run = 0 if b"<" in data else self._run + len(data)
        if self._run > MAX_MARKUP_BYTES:
            raise self._archive.refusal(f"a text of more than {MAX_MARKUP_BYTES} bytes")
        return data
