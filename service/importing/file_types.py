"""Name the type of a file that is no table, by its first bytes, or by the parts of an archive."""

from __future__ import annotations

import io
import zipfile
from typing import Final

_SIGNATURES: Final = (
    (b"%PDF-", "a PDF document"),
    (b"\x89PNG\r\n", "a picture (PNG)"),
    (b"\xff\xd8\xff", "a picture (JPEG)"),
    (b"GIF8", "a picture (GIF)"),
    (b"BM", "a picture (BMP)"),
    (b"II*\0", "a picture (TIFF)"),
    (b"MM\0*", "a picture (TIFF)"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive"),
    (b"Rar!", "a RAR archive"),
    (b"\xd0\xcf\x11\xe0", "an old Office document (such as .xls), or an encrypted one"),
    (b"{\\rtf", "an RTF document"),
    (b"SQLite format 3", "an SQLite database"),
    (b"RIFF", "a picture (WebP), a sound or a film"),
    (b"%!PS", "a PostScript document"),
    (b"\x7fELF", "a program"),
    (b"MZ", "a program"),
    (b"BZh", "a bzip2 archive"),
    (b"\xfd7zXZ", "an xz archive"),
    (b"<!DOCTYPE html", "a web page (HTML)"),
    (b"<html", "a web page (HTML)"),
    (b"<?xml", "an XML document"),
    (b"<svg", "a picture (SVG)"),
)
_TEXT_LIKE: Final = frozenset((b"BM", b"MZ", b"RIFF", b"BZh"))
"""Signatures that a text may begin with, too."""
JSON: Final = "a JSON document"
WORKBOOK: Final = "an Excel workbook (.xlsx)"
_ZIP: Final = b"PK\x03\x04"
_PARTS: Final = (
    ("xl/workbook.bin", "a binary Excel workbook (.xlsb)"),
    ("word/document.xml", "a Word document"),
    ("ppt/presentation.xml", "a PowerPoint presentation"),
    ("content.xml", "an OpenDocument file (such as .ods)"),
)


def file_type(content: bytes) -> str | None:
    """Return what a file is if its first bytes tell; None for plain text and unknown types."""
    if content.startswith(_ZIP):
        return _archive_type(content)
    if content[4:8] == b"ftyp":
        return "a picture (HEIC) or a film"
    start = content[:256].lstrip(b"\xef\xbb\xbf \t\r\n")
    if start[:1] in (b"{", b"[") and content.rstrip()[-1:] in (b"}", b"]"):
        return JSON
    for signature, name in _SIGNATURES:
        if start.startswith(signature) and not (signature in _TEXT_LIKE and b"\0" not in content[:32]):
            return name
    return None


def _archive_type(content: bytes) -> str | None:
    """Return what an archive is; a damaged one counts as a workbook, whose reader says what is wrong."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names = {part.filename for part in archive.infolist()}
    except (zipfile.BadZipFile, OSError, ValueError, RuntimeError, LookupError, OverflowError):
        return WORKBOOK
    known = next((name for part, name in _PARTS if part in names), None)
    return known or (WORKBOOK if any("xl/" in name for name in names) else "a ZIP archive")
