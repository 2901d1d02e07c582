"""Reading of archives, which may be damaged or hostile: every size is limited before anything is stored."""

from __future__ import annotations

import hashlib
import io
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError
from pydantic_core import from_json

from jointstiff.service.archive import form
from jointstiff.service.archive.form import FileEntry, Manifest
from jointstiff.service.problems import StoreError
from jointstiff.service.store.layouts import LAYOUT, number_of

_END_RECORD: Final = struct.Struct("<4s8xLL2x")  # end of the directory of a zip file without a comment
_PIECE: Final = 1024 * 1024  # bytes that are read at a time


class ArchiveError(StoreError):
    """A file that is no archive, or an archive that is damaged."""


class Archive:
    """An archive whose manifest, sizes and hashes have been checked."""

    def __init__(self, file: zipfile.ZipFile, manifest: Manifest) -> None:
        self.manifest = manifest
        self._file = file

    def lines(self, table: str) -> Iterator[dict[str, Any]]:
        """Yield the lines of the file of a table, if the archive has one.

        Raises:
            ArchiveError: a line is no JSON object.
        """
        name = form.file_of(table)
        if name not in self.manifest.files:
            return
        with self._file.open(name) as source, io.BufferedReader(source, _PIECE) as reader:  # type: ignore[type-var]
            number = 0
            while line := reader.readline(form.MOST_LINE_BYTES + 1):
                number += 1
                yield _parse_line(name, number, line)


@contextmanager
def read_archive(path: Path) -> Iterator[Archive]:
    """Yield an archive after all its files were read once and compared with its manifest.

    Raises:
        ArchiveError: the file is no archive, is damaged, or exceeds a limit.
        OSError: the file cannot be read.
    """
    _refuse_large_directory(path)
    try:
        with zipfile.ZipFile(path) as file:
            manifest = _read_manifest(file)
            for entry in file.infolist():
                _refuse_unknown_entry(entry, manifest)
            for name, described in manifest.files.items():
                _compare(file, name, described)
            yield Archive(file, manifest)
    except (zipfile.BadZipFile, zlib.error, RuntimeError, EOFError) as error:  # RuntimeError: encrypted
        raise _refuse(f"{path} is damaged ({error})") from error


def _refuse(reason: str) -> ArchiveError:
    """Return the error for a file that is no archive."""
    return ArchiveError(reason, "give a file that `jointstiff archive` wrote, copied completely")


def _refuse_large_directory(path: Path) -> None:
    """Refuse a file whose directory zipfile would read into memory, though an archive has few entries."""
    with path.open("rb") as file:
        size = file.seek(0, io.SEEK_END)
        file.seek(max(0, size - _END_RECORD.size))
        end = file.read()
    if len(end) < _END_RECORD.size or not end.startswith(b"PK\x05\x06"):
        raise _refuse(f"{path} is no archive")
    directory_bytes = _END_RECORD.unpack(end)[1]
    if directory_bytes > form.MOST_DIRECTORY_BYTES:
        raise _refuse(f"{path} is not an archive, because it has too many files")


def _read_manifest(file: zipfile.ZipFile) -> Manifest:
    """Return the manifest of an archive."""
    names = file.namelist()
    if form.MANIFEST not in names or len(names) > form.MOST_FILES or len(set(names)) < len(names):
        raise _refuse(
            f"the file contains no {form.MANIFEST}, or it contains more than {form.MOST_FILES} files"
        )
    with file.open(form.MANIFEST) as source:
        content = source.read(form.MOST_DIRECTORY_BYTES + 1)
    if len(content) > form.MOST_DIRECTORY_BYTES:
        raise _refuse(f"{form.MANIFEST} has more than {form.MOST_DIRECTORY_BYTES} bytes")
    try:
        manifest = Manifest.model_validate_json(content)
    except ValidationError as error:
        raise _refuse(f"{form.MANIFEST} is not that of an archive") from error
    _refuse_other_form(manifest)
    return manifest


def _refuse_other_form(manifest: Manifest) -> None:
    """Refuse an archive of a later version, and one with more lines or bytes than any database."""
    layout = manifest.layout
    if manifest.format != form.FORMAT or not layout[:4].isdecimal():
        raise _refuse(f"{form.MANIFEST} is not that of an archive")
    is_later = manifest.format_version > form.FORMAT_VERSION or number_of(layout) > number_of(LAYOUT)
    if is_later:
        raise ArchiveError(
            f"the archive has layout {layout} and format {manifest.format_version}, but this version "
            f"restores at most layout {LAYOUT} and format {form.FORMAT_VERSION}",
            "restore the archive with the version of Jointstiff that wrote it, or a newer one",
        )
    lines = sum(entry.lines for entry in manifest.files.values())
    size = sum(entry.bytes for entry in manifest.files.values())
    if lines > form.MOST_LINES or size > form.MOST_BYTES:
        raise _refuse(
            f"the archive has {lines} lines of {size} bytes in all, which is more than any database has"
        )


def _refuse_unknown_entry(entry: zipfile.ZipInfo, manifest: Manifest) -> None:
    """Refuse a file that the manifest does not name, or that expands more than JSON of readings does."""
    if entry.filename == form.MANIFEST:
        return
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise _refuse(f"{entry.filename[:100]!r} is compressed otherwise than by deflate")
    if entry.filename not in manifest.files:
        raise _refuse(f"{form.MANIFEST} does not name the file {entry.filename[:100]!r}")
    size = manifest.files[entry.filename].bytes
    if size > form.SMALL_BYTES and size > form.MOST_RATIO * entry.compress_size:
        raise _refuse(f"{entry.filename} expands to more than {form.MOST_RATIO} times its size")


def _compare(file: zipfile.ZipFile, name: str, described: FileEntry) -> None:
    """Read a file, and refuse it if its bytes, lines or hash are not those of the manifest."""
    if name not in file.namelist():
        raise _refuse(f"the file {name[:100]!r} of {form.MANIFEST} is missing")
    digest, lines, size = hashlib.sha256(), 0, 0
    with file.open(name) as source:
        while piece := source.read(_PIECE):
            size += len(piece)
            if size > described.bytes:
                raise _refuse(f"{name} is larger than {form.MANIFEST} states")
            lines += piece.count(b"\n")
            digest.update(piece)
    found = FileEntry(lines=lines, bytes=size, sha256=digest.hexdigest())
    if found != described:
        raise _refuse(f"{name} is not the file that {form.MANIFEST} describes")


def _parse_line(name: str, number: int, line: bytes) -> dict[str, Any]:
    """Return the values of a line."""
    if len(line) > form.MOST_LINE_BYTES:
        raise _refuse(f"line {number} of {name} is longer than {form.MOST_LINE_BYTES // 1024**2} MiB")
    try:
        values = from_json(line, allow_inf_nan=False)
    except ValueError as error:
        raise _refuse(f"line {number} of {name} is no JSON") from error
    if not isinstance(values, dict):
        raise _refuse(f"line {number} of {name} is not a JSON object")
    return values
