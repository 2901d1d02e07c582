"""Files of requests and results as they are stored: compressed, in base64, with size and digest."""

from __future__ import annotations

import base64
import hashlib
import re
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from jointstiff.schemas.correction import ProgramFile
from jointstiff.solver.errors import RequestError

CONTENT: Final = re.compile(r'"content":"[A-Za-z0-9+/=]*"')
"""Pattern of a file's content in a job's JSON; texts of users cannot match: their quotes are escaped."""
_MAX_UNPACKED: Final = 256 * 1024 * 1024
"""Greatest size of a file after decompression, which protects the memory."""


def compress_file(name: str, content: bytes) -> ProgramFile:
    """Return a file to store: compressed content in base64, with size and SHA-256 digest of the content."""
    text = base64.b64encode(zlib.compress(content, 1)).decode("ascii")
    digest = hashlib.sha256(content).hexdigest()
    return ProgramFile(name=name, bytes=len(content), content=text, sha256=digest)


def decompress_file(file: ProgramFile) -> bytes:
    """Return the decompressed content of a stored file, at most `_MAX_UNPACKED` bytes of it.

    A small file that would unpack to a huge one is cut off there, and cannot fill the memory.

    Raises:
        RequestError: the file has no content.
    """
    if file.content is None:
        raise RequestError("the file has no content", where="files", remedy="send the file itself")
    compressed = base64.b64decode(file.content)
    return zlib.decompressobj().decompress(compressed, _MAX_UNPACKED)


def choose_program_paths(path: Path, names: Iterable[str]) -> dict[str, Path]:
    """Choose the path to write for each file of a program; the result has the paths by the files' names.

    If `path` is a folder, the files keep their names there. Else a single file gets this path; each of
    several files gets the path with its own ending, and with its name, too, if an earlier file has the same
    ending.
    """
    file_names = {name: Path(name).name for name in names}  # without folders
    if path.is_dir():
        return {name: path / file_name for name, file_name in file_names.items()}
    if len(file_names) == 1:
        return dict.fromkeys(file_names, path)
    paths = dict[str, Path]()
    for name, file_name in file_names.items():
        with_own_ending = path.with_suffix(Path(file_name).suffix)
        is_taken = with_own_ending in paths.values()
        paths[name] = path.with_name(f"{path.stem}_{file_name}") if is_taken else with_own_ending
    return paths
