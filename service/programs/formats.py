"""The formats of programs: the reader of a file, limits that hold for all, the mark of a correction."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from datetime import date
from pathlib import PurePath
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from jointstiff.service.programs import fanuc, krl, rapid, table, ur
from jointstiff.service.programs.errors import Fault, ProgramError, shown
from jointstiff.service.programs.notation import Notation
from jointstiff.service.programs.program import Program, Source
from jointstiff.service.programs.reader import Reader

MAX_PROGRAM_BYTES: Final = 32 * 1024 * 1024
"""All files of a program together."""
MAX_LINES: Final = 2_000_000
MAX_LINE: Final = 4096
"""Characters of a line."""
MARK: Final = "Jointstiff run "
"""Text by which a mark is known: a comment that keeps a compensated program from a second correction."""


class _Format(NamedTuple):
    read: Callable[[Reader], None]
    suffixes: str
    pose: Notation | None  # in which its users write frames; None for that of the program
    comment: str = "#"
    head: str = ""  # pattern of the beginning of the line behind which the mark stands; else it is the first


FORMATS: Final[Mapping[str, _Format]] = MappingProxyType(
    {
        "csv": _Format(table.read_table, ".csv", None),
        "krl": _Format(
            krl.read_krl, ".src .dat", krl.POSE, ";", r"[ \t]*+(?i:(?:GLOBAL[ \t]++)?DEF(?:FCT)?\b)"
        ),
        "fanuc": _Format(fanuc.read_fanuc, ".ls", fanuc.POSE, "    :  !", "/MN"),
        "rapid": _Format(rapid.read_rapid, ".mod .prg .modx", rapid.POSE, "!", r"[ \t]*+(?i:MODULE\b)"),
        "ur": _Format(ur.read_ur, ".script .urscript", ur.POSE),
    }
)


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
        _refuse("program", None, "no file was sent", "send a program")
    suffix = PurePath(files[0][0].lower()).suffix
    chosen = name or next((each for each, known in FORMATS.items() if suffix in known.suffixes.split()), "")
    if chosen not in FORMATS:
        reason = "the file's name does not show the format"
        _refuse(files[0][0], None, reason, f"give `format`: one of {', '.join(FORMATS)}")
    if len(files) > (3 if chosen == "krl" else 1):
        remedy = "send one program; with KUKA's .src its .dat and $config.dat"
        _refuse(files[-1][0], None, "one file too many", remedy)
    if sum(len(content) for _, content in files) > MAX_PROGRAM_BYTES:
        _refuse(files[0][0], None, f"more than {MAX_PROGRAM_BYTES // 2**20} MiB", "split the program")
    ordered = sorted(files, key=lambda file: file[0].lower().endswith(".dat"))  # moves are of the first file
    sources = tuple(_source(name, content) for name, content in ordered)
    reader = Reader(chosen, sources, frozenset(name.upper() for name in leave_alone))
    FORMATS[chosen].read(reader)
    return reader.program()


def _source(name: str, content: bytes) -> Source:
    if b"\0" in content:
        reason = "the file is not text in one byte a character"
        _refuse(name, None, reason, "save it as plain text, not as UTF-16 or binary")
    if content.count(b"\n") + content.count(b"\r") > MAX_LINES:
        _refuse(name, None, f"more than {MAX_LINES:,} lines", "split the program")
    source = Source.of(name, content)
    if (place := source.text.find(MARK)) >= 0:
        reason = (
            "the program states that it was corrected already: a second correction would add to the first"
        )
        _refuse(
            name,
            source.line(place),
            reason,
            "send the original program; remove this line if it is wrong",
        )
    for i in np.flatnonzero(source.ends - source.starts > MAX_LINE).tolist():
        if len(source.text[source.starts[i] : source.ends[i]].rstrip("\r\n")) > MAX_LINE:
            reason = f"a line of more than {MAX_LINE} characters"
            _refuse(name, i + 1, reason, "break it into several lines")
    return source


def _refuse(file: str, line: int | None, reason: str, remedy: str) -> None:
    raise ProgramError((Fault(file if file.isprintable() else shown(file), line, reason, remedy),), 1)


def frame_notation(program: Program) -> Notation:
    """Return the notation in which users of a format write frames; KUKA's where a program writes no pose."""
    written = (notation for notation in program.targets.notations if notation.has_pose)
    return FORMATS[program.format].pose or next(written, krl.POSE)


def marked(kind: str, content: bytes, run_id: str, verdict: str, day: date) -> bytes:
    """Return a compensated program with its mark; FANUC's is three remarks of 32 characters at most."""
    known, end = FORMATS[kind], "\r\n" if b"\r\n" in content else "\n"
    words = f"corrected {day.isoformat()}", f"verdict: {verdict.replace('_', ' ')}"
    if kind == "fanuc":
        lines = [f"{known.comment}{each} ;" for each in (f"{MARK}{run_id[:8]}", *words)]
    else:
        lines = [f"{known.comment} {MARK}{run_id} {', '.join(words)}"]
    mark = "".join(line + end for line in lines).encode("ascii", "replace")
    line = rf"^{known.head}[^\r\n]*+(?:\r\n|\n|\r)".encode()
    head = re.search(line, content, re.MULTILINE) if known.head else None
    place = head.end() if head else 0
    return content[:place] + mark + content[place:]
