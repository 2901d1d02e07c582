"""Cutter locations (APT-CLS): GOTO/ x, y, z, i, j, k of CAM systems, linear moves only."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Final

from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.notation import MM, Notation, Orientation
from jointstiff.service.programs.program import FrameName, Motion, Program, Source
from jointstiff.service.programs.reader import NUMBER, NUMBER_PATTERN, Reader, words

AXIS: Final = Notation(Orientation.TOOL_AXIS, angle=1, length_decimals=6, angle_decimals=9)
POSITION: Final = Notation(Orientation.NONE, angle=1, length_decimals=6, angle_decimals=9)
_UPRIGHT: Final = (0.0, 0.0, 1.0)
_INCH: Final = 0.0254
_GOTO: Final = re.compile(rf"(GOTO|FROM)\s*/\s*({NUMBER}(?:\s*,\s*{NUMBER})*)\s*,?\s*$", re.IGNORECASE)
_WORD: Final = re.compile(r"([A-Z][\w-]*(?: PATH\b)?)\s*(?:/\s*(.*))?", re.IGNORECASE)
_ARCS: Final = words(
    """
    CIRCLE MOVARC ARCDAT HELIX TLON TLLFT TLRGT GOFWD GOBACK GOLFT GORGT GOUP GODOWN INDIRV INDIRP
    AUTOPS PSIS GODLTA GO THICK
    """
)
"""Moves that geometry or the place before says, in no numbers of their own."""
_STILL: Final = words(
    """
    PARTNO PPRINT MACHIN UNITS MULTAX LOADTL LOAD SELCTL TOOLNO SPINDL FEDRAT RAPID COOLNT CUTTER
    END FINI STOP OPSTOP DELAY INTOL OUTTOL TOLER AUXFUN PREFUN INSERT SEQNO OPNAME CUTCOM
    CYCLE TOOL MSYS ORIGIN MODE REMARK PAINT CLDATA REWIND DISPLY TPRINT HEAD SET CLEARP LEADER END-OF-PATH
    TLDATA PLABEL GOHOME SAFETY CLRSRF SAFPOS PIVOTZ SPINDLE ARCSLP LINTOL
    """
) | {"TOOL PATH"}
_MAX_STATEMENT: Final = 16_384
"""Characters of a statement; a longer one is cut, and refused as what it is then."""
_OFF: Final = {"CUTCOM", "CYCLE", "ARCSLP"}
_SHIFTS: Final = words("ROTATE ROTABL ROTHED TRANS COPY TRACUT TRAREF REFSYS INDEX")
"""Words after which the numbers of targets are those of another frame."""
_AXIS_WORD: Final = re.compile(
    rf"TLAXIS\s*/\s*({NUMBER})\s*,\s*({NUMBER})\s*,\s*({NUMBER})\s*$", re.IGNORECASE
)


def read_apt(sources: tuple[Source, ...], allowed: Collection[str]) -> Program:
    """Read a file of cutter locations.

    Raises:
        ProgramError: part of it is not understood.
    """
    reader = Reader("apt", sources, allowed)
    frames = (FrameName("part"), FrameName("cutter"))
    unit, axis = MM, _UPRIGHT
    for line, start, text in _statements(sources[0]):
        body = text.strip()
        if goto := _GOTO.match(body):
            offset = start + len(text) - len(text.lstrip())
            numbers = [
                (offset + m.start(), offset + m.end())
                for m in NUMBER_PATTERN.finditer(body, goto.start(2), goto.end(2))
            ]
            axis = _goto(reader, line, numbers, unit, frames, axis)
            continue
        word = _WORD.match(body)
        name = word[1].upper() if word else ""
        rest = ((word[2] if word else "") or "").strip().upper()
        if name == "UNITS":
            unit = _unit(reader, line, rest)
        elif name == "TLAXIS":
            axis = _axis(reader, line, body) or axis
        elif name not in _STILL or name in _OFF or name in {"MODE", "ORIGIN"}:
            _word(reader, line, name, rest, body)
    return reader.program()


def _word(reader: Reader, line: int, name: str, rest: str, body: str) -> None:
    """Refuse a word that moves the tool or its targets, or that is not known."""
    fault: tuple[str, str] | None = None
    if name in _SHIFTS or (name == "MODE" and "INCR" in rest) or (name == "ORIGIN" and _shifted(rest)):
        reason = f"{shown(body)} moves the targets that follow"
        fault = reason, "let the CAM system write absolute coordinates in one frame"
    elif name in _OFF and rest.partition(",")[0].strip() not in {"OFF", ""}:
        reason = f"{name}/{shown(rest)}: the controller would move the targets"
        fault = reason, "let the CAM system compute it"
    elif name in {"GOTO", "FROM"}:
        fault = f"the target {shown(body)} is not in numbers", "give x, y, z or x, y, z, i, j, k"
    elif name in _ARCS:
        reason = f"{name}: an arc, or a move whose end is not written"
        fault = reason, "let the CAM system write linear moves (GOTO) only"
    elif name not in _STILL and name not in reader.allowed:
        remedy = f"let the CAM system write linear moves only, or name it in `leave_alone`: [{shown(name)}]"
        fault = f"the word {shown(body)} is not known", remedy
    if fault:
        reader.refuse(line, *fault)


def _axis(reader: Reader, line: int, body: str) -> tuple[float, float, float] | None:
    """Return the tool's axis that TLAXIS sets."""
    stated = _AXIS_WORD.match(body)
    axis = (float(stated[1]), float(stated[2]), float(stated[3])) if stated else (0.0, 0.0, 0.0)
    if any(axis):
        return axis
    reader.refuse(
        line, f"{shown(body)} sets no axis in numbers", "write TLAXIS/i, j, k, or i, j, k in each GOTO"
    )
    return None


def _shifted(rest: str) -> bool:
    return any(float(number) != 0.0 for number in NUMBER_PATTERN.findall(rest))


def _unit(reader: Reader, line: int, name: str) -> float:
    units = {"MM": MM, "INCHES": _INCH, "INCH": _INCH, "IN": _INCH}
    if name not in units:
        reader.refuse(line, f"the unit {shown(name)} is not known", "write UNITS/MM or UNITS/INCHES")
    return units.get(name, MM)


def _goto(
    reader: Reader,
    line: int,
    numbers: list[tuple[int, int]],
    unit: float,
    frames: tuple[FrameName, FrameName],
    axis: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Read a target; return the tool's axis, which a target without one keeps."""
    if len(numbers) not in {3, 6}:
        reader.refuse(line, f"GOTO with {len(numbers)} numbers", "give x, y, z or x, y, z, i, j, k")
        return axis
    notation = AXIS if len(numbers) == 6 else POSITION
    if unit != MM or (notation is POSITION and axis != _UPRIGHT):
        notation = replace(notation, length=unit, axis=axis if notation is POSITION else _UPRIGHT)
    target = reader.target("", (0, line), notation, numbers, frames)
    reader.move(line, Motion.LINEAR, (target,))
    if target is None or len(numbers) == 3:
        return axis
    text = reader.sources[0].text
    i, j, k = (float(text[start:end]) for start, end in numbers[3:])
    return i, j, k


def _statements(source: Source) -> Iterator[tuple[int, int, str]]:
    """Yield statements without comments; a line that ends in `$` goes on, its `$` and line end as blanks."""
    held: tuple[int, int, str] | None = None
    for line, start, text in source.lines():
        cut = text.find("$$")
        body = text if cut < 0 else text[:cut]
        if held is not None:
            first, begin, before = held
            body = before + " " * (start - begin - len(before)) + body
        else:
            first, begin = line, start
        held = None
        if body.rstrip().endswith("$") and len(body) < _MAX_STATEMENT:
            held = (first, begin, body.rstrip()[:-1] + " ")
        elif body.strip():
            yield first, begin, body
    if held is not None:
        yield held
