"""Files as they were sent, within the limits of an import, and copies among them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import NamedTuple

from jointstiff.service.importing import grid
from jointstiff.service.importing.errors import NOWHERE, ImportFileError, Place, quote


@dataclass(frozen=True)
class SourceFile:
    """A file as it was sent."""

    name: str  # the name may contain target and state, also that of its folder
    content: bytes
    is_table: bool = False  # whether the import wrote it: no cell makes a program or a report of it


def read_sources(files: Iterable[str | PathLike[str]]) -> list[SourceFile]:
    """Read files into memory, with their folders in the names of files that have the same name.

    Of large files only so much is read that the import refuses them as too large.

    Raises:
        OSError: a file cannot be read.
    """
    paths, sources, bytes_left = list(map(Path, files)), list[SourceFile](), grid.MAX_FILE_BYTES
    counts = Counter(path.name for path in paths)
    for path in paths:
        with path.open("rb") as file:
            content = file.read(bytes_left + 1)  # one byte more than is allowed
        bytes_left = max(0, bytes_left - len(content))
        folder = f"{path.resolve().parent.name}_" if counts[path.name] > 1 else ""
        sources.append(SourceFile(f"{folder}{path.name}", content))
    return sources


def check_files(files: Sequence[SourceFile]) -> None:
    """Refuse too many or too large files, and two files with the same name or the same content.

    Raises:
        ImportFileError: a limit is exceeded, or a file occurs twice.
    """
    if not 0 < len(files) <= grid.MAX_FILES:
        raise ImportFileError(NOWHERE, f"{len(files)} files were sent", f"send 1 to {grid.MAX_FILES} files")
    names: set[str] = set()
    byte_count = line_count = 0  # of all files so far
    for file in files:
        if file.name in names:
            raise ImportFileError(Place(file.name), "two files have this name", "send each file once")
        names.add(file.name)
        byte_count += len(file.content)
        _refuse_many_bytes(byte_count, file.name)
        line_count += _count_lines(file.content)
        _refuse_many_lines(line_count, file.name)
    if (copy := find_copy(files)) is not None:
        reason = f"the file is equal to {quote(copy.original)}, byte by byte"
        remedy = "send one of the two; if the second should have other readings, export these again"
        raise ImportFileError(Place(copy.name), reason, remedy)


class CopiedFile(NamedTuple):
    """Names of two files with the same content."""

    name: str
    original: str  # the first of both


def find_copy(files: Sequence[SourceFile]) -> CopiedFile | None:
    """Return the first file that is equal to an earlier file, such as a second download; None without one."""
    name_of_content: dict[bytes, str] = {}
    for file in files:
        original = name_of_content.setdefault(file.content, file.name)
        if original != file.name:
            return CopiedFile(file.name, original)
    return None


def _refuse_many_bytes(count: int, file: str) -> None:
    """Raise an `ImportFileError` if the files up to the one with the name `file` have too many bytes."""
    if count > grid.MAX_FILE_BYTES:
        limit = f"the files exceed {grid.MAX_FILE_BYTES // 1024**2} MiB together"
        raise ImportFileError(Place(file), limit, "import fewer files at once")


def _refuse_many_lines(count: int, file: str) -> None:
    """Raise an `ImportFileError` if the files up to the one with the name `file` have too many lines."""
    if count > grid.MAX_LINES:
        limit = (
            f"the files have more than {grid.MAX_LINES} lines together, including empty lines and comments"
        )
        remedy = "remove empty lines and comments, or import fewer files at once"
        raise ImportFileError(Place(file), limit, remedy)


def _count_lines(content: bytes) -> int:
    """Return the number of line ends in UTF-8 or UTF-16; a workbook contains few of these bytes by chance.

    A carriage return and a line feed together end one line.
    """
    single_ends = content.count(b"\n") + content.count(b"\r")
    double_ends = content.count(b"\r\n") + content.count(b"\r\0\n")
    return single_ends - double_ends
