"""The formats of programs: the reader of a file, limits that hold for all, the mark of a correction."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from datetime import date
from pathlib import PurePath
from types import MappingProxyType
from typing import Final

import numpy as np

from jointstiff.service.programs import fanuc, krl, rapid, table, ur
from jointstiff.service.programs.errors import Fault, ProgramError, ReadMove, shown
from jointstiff.service.programs.interpreter import Machine
from jointstiff.service.programs.language import Language
from jointstiff.service.programs.notation import Notation, has_decimal_commas
from jointstiff.service.programs.program import NUMBERS, ExternalAxes, Program, Source

MAX_PROGRAM_BYTES: Final = 32 * 1024 * 1024
"""All files of a program together."""
MAX_LINES: Final = 2_000_000
MAX_LINE: Final = 4096
"""Characters of a line."""
_NOT_READ: Final = {".nc", ".cnc", ".mpf", ".apt", ".cls", ".aptsource", ".gcode"}
MARK: Final = "Jointstiff run "
"""Text by which a mark is known: a comment that keeps a compensated program from a second correction."""


_MODULES: Final = {"csv": table, "krl": krl, "fanuc": fanuc, "rapid": rapid, "ur": ur}
FORMATS: Final[Mapping[str, Language]] = MappingProxyType(
    {name: module.LANGUAGE for name, module in _MODULES.items()}
)


def read_program(
    files: Sequence[tuple[str, bytes]],
    name: str | None = None,
    leave_alone: Collection[str] = (),
    *,
    leave_others: bool = False,
    external_axes: ExternalAxes = ExternalAxes.MAY_CARRY,
) -> Program:
    """Read a program.

    Args:
        files: names and bytes: one file, or a .src with its .dat and $config.dat.
        name: name of the format, one of FORMATS; by the first file's name if None.
        leave_alone: names of routines that neither move the robot nor change its frames.
        leave_others: whether moves that are not certain are left; else the program is refused for them.
        external_axes: what is known of external axes; moves that have them away from zero are left, unless
            they are joints of the robot or carry nothing.

    Raises:
        ProgramError: the text was not understood, or a move is not certain.
    """
    if not files:
        _refuse("program", None, "no file was sent", "send a program")
    suffix = PurePath(files[0][0].lower()).suffix
    chosen = name or next((each for each, known in FORMATS.items() if suffix in known.suffixes.split()), "")
    if suffix in _NOT_READ and name is None:
        remedy = "write it in the controller's own language, or as a table of targets (CSV)"
        _refuse(files[0][0], None, "programs of CNC, APT and CLS are not read", remedy)
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
    commas = chosen == "csv" and has_decimal_commas(sources[0].text)
    language = table.DECIMAL_COMMAS if commas else FORMATS[chosen]
    columns, used, causes = Machine(chosen, sources, language, leave_alone).interpreted()
    program = columns.program(used, causes, external_axes)
    if program.faults and not leave_others:
        raise ProgramError(program.faults, left=program.left)
    return program


def explained(
    files: Sequence[tuple[str, bytes]],
    name: str | None = None,
    leave_alone: Collection[str] = (),
    external_axes: ExternalAxes = ExternalAxes.MAY_CARRY,
) -> list[ReadMove]:
    """Return each move of a program by line: target, base and tool, and whether it can be corrected.

    Raises:
        ProgramError: the text of the program is not understood.
    """
    try:
        program = read_program(files, name, leave_alone, leave_others=True, external_axes=external_axes)
    except ProgramError as error:
        if not error.left:
            raise
        return list(error.left)
    targets, moves = program.targets, program.moves
    last = moves.visits[moves.ends - 1]
    kept = [
        ReadMove(each.line, each.target, "", "", each.text, "") for each in program.left_alone if each.target
    ]
    rows = [*program.left, *kept]
    for line, target in zip(moves.line.tolist(), last.tolist(), strict=True):
        numbers = targets.values[target, :NUMBERS]
        shown_numbers = ", ".join(f"{number:g}" for number in numbers[np.isfinite(numbers)].tolist())
        base, tool = (targets.frames[chosen[target]].name for chosen in (targets.base, targets.tool))
        rows.append(ReadMove(line, targets.names[target] or shown_numbers, base, tool, corrected=True))
    return sorted(rows, key=lambda each: each.line)


def _source(name: str, content: bytes) -> Source:
    if b"\0" in content:
        reason = "the file is not text in one byte a character"
        _refuse(name, None, reason, "save it as plain text, not as UTF-16 or binary")
    if content.count(b"\n") + content.count(b"\r") > MAX_LINES:
        _refuse(name, None, f"more than {MAX_LINES:,} lines", "split the program")
    source = Source.of(name, content)
    if (place := source.text.find(MARK)) >= 0:
        reason = "the program states that it was corrected already: a second correction would add to it"
        remedy = "send the original program; remove this line if it is wrong"
        _refuse(name, source.line(place), reason, remedy)
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


def marked(
    kind: str, content: bytes, run_id: str, verdict: str, day: date, moves: int = 0, left: int = 0
) -> bytes:
    """Return a compensated program with its mark; FANUC's is a few remarks of 32 characters at most.

    Args:
        kind: name of the format.
        content: the program.
        run_id: run whose model was used.
        verdict: of the compensated program.
        day: date of the correction.
        moves: moves of the program; they are named if some are left.
        left: those that are left.
    """
    known, end = FORMATS[kind], "\r\n" if b"\r\n" in content else "\n"
    words = [f"corrected {day.isoformat()}", f"verdict: {verdict.replace('_', ' ')}"]
    words += [f"{moves - left} of {moves} moves corrected, {left} left"] if left and kind != "fanuc" else []
    words += (
        [f"{moves - left} of {moves} corrected", f"{left} moves left"] if left and kind == "fanuc" else []
    )
    if kind == "fanuc":
        lines = [f"{known.remark}{each} ;" for each in (f"{MARK}{run_id[:8]}", *words)]
    else:
        lines = [f"{known.remark} {MARK}{run_id} {', '.join(words)}"]
    mark = "".join(line + end for line in lines).encode("ascii", "replace")
    line = rf"^{known.head}[^\r\n]*+(?:\r\n|\n|\r)".encode()
    head = re.search(line, content, re.MULTILINE) if known.head else None
    place = head.end() if head else 0
    return content[:place] + mark + content[place:]
