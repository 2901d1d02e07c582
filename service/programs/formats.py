"""The formats of programs: which reader takes a file, and the limits that hold for all."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import PurePath
from types import MappingProxyType
from typing import Final

import numpy as np

from jointstiff.service.programs import fanuc, krl, rapid, ur
from jointstiff.service.programs.errors import Fault, ProgramError, shown
from jointstiff.service.programs.fanuc import read_fanuc
from jointstiff.service.programs.krl import read_krl
from jointstiff.service.programs.mark import mark_line
from jointstiff.service.programs.notation import Notation
from jointstiff.service.programs.program import Program, Source
from jointstiff.service.programs.rapid import read_rapid
from jointstiff.service.programs.reader import Reader
from jointstiff.service.programs.table import read_table
from jointstiff.service.programs.ur import read_ur

MAX_PROGRAM_BYTES: Final = 32 * 1024 * 1024
"""All files of a program together."""
MAX_LINES: Final = 2_000_000
MAX_LINE: Final = 4096
"""Characters of a line."""

FORMATS: Final[Mapping[str, Callable[[Reader], None]]] = MappingProxyType(
    {"csv": read_table, "krl": read_krl, "fanuc": read_fanuc, "rapid": read_rapid, "ur": read_ur}
)
_SUFFIXES: Final = {
    ".csv": "csv",
    ".src": "krl",
    ".dat": "krl",
    ".ls": "fanuc",
    ".mod": "rapid",
    ".prg": "rapid",
    ".modx": "rapid",
    ".script": "ur",
    ".urscript": "ur",
}


def read_program(
    files: Sequence[tuple[str, bytes]], name: str | None = None, leave_alone: Collection[str] = ()
) -> Program:
    """Read a program.

    Args:
        files: names and bytes: one file, or a .src with its .dat and $config.dat.
        name: name of the format, one of FORMATS; by the first file's name if None.
        leave_alone: names of routines that neither move the robot nor change its frames.

    Raises:
        ProgramError: any of it was not understood; then nothing of it is taken.
    """
    if not files:
        _refuse("program", None, "there is no file", "send a program")
    chosen = name or _SUFFIXES.get(PurePath(files[0][0].lower()).suffix)
    if chosen not in FORMATS:
        _refuse(
            files[0][0], None, "the format is not known by the file's name", f"state it: {', '.join(FORMATS)}"
        )
    if len(files) > (3 if chosen == "krl" else 1):
        remedy = "send one program; with KUKA's .src its .dat and $config.dat"
        _refuse(files[-1][0], None, "one file too many", remedy)
    if sum(len(content) for _, content in files) > MAX_PROGRAM_BYTES:
        _refuse(files[0][0], None, f"more than {MAX_PROGRAM_BYTES // 2**20} MiB", "split the program")
    ordered = sorted(files, key=lambda file: file[0].lower().endswith(".dat"))  # moves are of the first file
    sources = tuple(_source(name, content) for name, content in ordered)
    reader = Reader(str(chosen), sources, frozenset(name.upper() for name in leave_alone))
    FORMATS[str(chosen)](reader)
    return reader.program()


def _source(name: str, content: bytes) -> Source:
    if b"\0" in content:
        _refuse(
            name,
            None,
            "the file is not text in one byte a character",
            "save it as plain text, not as UTF-16 or binary",
        )
    if content.count(b"\n") + content.count(b"\r") > MAX_LINES:
        _refuse(name, None, f"more than {MAX_LINES:,} lines", "split the program")
    source = Source.of(name, content)
    if (line := mark_line(source.text)) is not None:
        reason = "the program says that it is corrected already: a second correction would add to the first"
        _refuse(name, line, reason, "send the program as it was before; remove the line if it is not true")
    for i in np.flatnonzero(source.ends - source.starts > MAX_LINE).tolist():
        if len(source.text[source.starts[i] : source.ends[i]].rstrip("\r\n")) > MAX_LINE:
            reason = f"a line of more than {MAX_LINE} characters"
            _refuse(name, i + 1, reason, "break it into several lines")
    return source


def _refuse(file: str, line: int | None, reason: str, remedy: str) -> None:
    raise ProgramError((Fault(file if file.isprintable() else shown(file), line, reason, remedy),), 1)


def frame_notation(program: Program) -> Notation:
    """Return the notation in which users of a format write frames; KUKA's where a program writes no pose."""
    of_format = {"krl": krl.POSE, "fanuc": fanuc.POSE, "rapid": rapid.POSE, "ur": ur.POSE}
    if program.format in of_format:
        return of_format[program.format]
    return next((notation for notation in program.targets.notations if notation.has_pose), krl.POSE)
