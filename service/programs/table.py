"""Targets in a table (CSV): a header names the columns and their units, each row is a target."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.service.programs.columns import Cause, Given
from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.interpreter import Machine
from jointstiff.service.programs.language import NUMBER, Language, Move
from jointstiff.service.programs.notation import DEGREE, MM, Notation, Orientation
from jointstiff.service.programs.program import FrameName, Literal, Motion, Source

_KINDS: Final = {
    "x y z a b c": (Orientation.EULER_ZYX, "lllaaa"),
    "x y z w p r": (Orientation.FIXED_XYZ, "lllaaa"),
    "x y z qw qx qy qz": (Orientation.QUATERNION, "lll1111"),
    "x y z rx ry rz": (Orientation.ROTATION_VECTOR, "lllaaa"),
    "x y z i j k": (Orientation.TOOL_AXIS, "lll111"),
    "j1 j2 j3 j4 j5 j6": (Orientation.JOINTS, "aaaaaa"),
    "a1 a2 a3 a4 a5 a6": (Orientation.JOINTS, "aaaaaa"),
    "q1 q2 q3 q4 q5 q6": (Orientation.JOINTS, "aaaaaa"),
    "x y z": (Orientation.NONE, "lll"),
}
"""What columns mean, and whether each is a length, an angle or a ratio."""
_HEADER: Final = re.compile(
    r"([a-z]++\d?)\s*+(?:[\[(_]?\s*+(mm|m|degree|deg|rad|\xb0)\s*+[\])]?)?", re.IGNORECASE
)
_LENGTHS: Final = {"mm": MM, "m": 1.0}
_ANGLES: Final = {"deg": DEGREE, "degree": DEGREE, "\xb0": DEGREE, "rad": 1.0}
_HELD: Final = re.compile(r"\W*+(?:u?tool|tcp|u?frame|base|wobj|uf|ut|(?:e|ext)_?\d)\b", re.IGNORECASE)
"""Names of columns that say which frames a target is in, or where external axes stand."""
_REMEDY: Final = (
    "name columns x, y, z and a, b, c (or w, p, r; qw ... qz; rx, ry, rz; i, j, k), "
    "or j1 ... j6, with units as in `x [mm]`"
)


def read_table(machine: Machine, sources: tuple[Source, ...]) -> None:
    """Read a table of targets."""
    source, numerals = sources[0], machine.numerals[0]
    shapes, first = numerals.shapes(source.starts, source.ends)
    known: dict[str, int] = {}
    of_line = np.fromiter((known.setdefault(shape, len(known)) for shape in shapes), dtype=np.intp)
    texts = list(known)
    says = [bool(shape.strip()) and not shape.lstrip().startswith("#") for shape in texts]
    rows = np.flatnonzero(np.array(says)[of_line])
    if not len(rows):
        return
    header = source.text[source.starts[rows[0]] : source.ends[rows[0]]]
    delimiter = max(";\t,", key=header.count)
    notation, places, width = _columns(machine, int(rows[0]) + 1, header, delimiter)
    frames = FrameName("base", np.eye(4)) if notation.is_joints else FrameName("part"), FrameName("tool")
    motion = Motion.JOINT if notation.is_joints else Motion.LINEAR
    held = [k for k, cell in enumerate(header.split(delimiter)) if _HELD.match(cell)]
    stands: list[str] | None = None
    of_row, begin = rows[1:], 0
    while begin < len(of_row):
        i, shape = int(of_row[begin]), texts[of_line[of_row[begin]]]
        text = source.text[source.starts[i] : source.ends[i]]
        numbers, cause = _numbers(i + 1, text, shape, delimiter, places, width)
        cells = text.split(delimiter)
        stated = [cells[k].strip() for k in held if k < len(cells)]
        stands = stated if stands is None else stands
        if stated != stands:
            reason = "tool, base or an external axis changes"
            cause = Cause(i + 1, reason, "send a table for each of them")
        end = begin + 1
        while not held and cause is None and end < len(of_row) and of_line[of_row[end]] == of_line[i]:
            end += 1
        own, literal = of_row[begin:end], Literal(notation, numbers)
        if cause is None:
            machine.columns.block(motion, own + 1, first[own], literal, frames)
        else:
            given = [Given("", 0, i + 1, int(first[i]), literal)]
            machine.columns.move(Move(motion, ("",)), i + 1, given, [frames], cause)
        begin = end


def _columns(machine: Machine, line: int, header: str, delimiter: str) -> tuple[Notation, list[int], int]:
    """Return the notation, the columns of its numbers in order, and the number of columns."""
    cells = [cell.strip().strip('"').strip().removeprefix("\xef\xbb\xbf") for cell in header.split(delimiter)]
    named = [_HEADER.fullmatch(cell) for cell in cells]
    names = {m[1].lower(): i for i, m in enumerate(named) if m}
    units = {m[1].lower(): (m[2] or "").lower() for m in named if m}
    if len(names) < sum(map(bool, named)):
        machine.refuse(line, "two columns have the same name", _REMEDY)
    kinds = [each for each in _KINDS if names.keys() >= set(each.split())]
    if len({_KINDS[each][0] is Orientation.JOINTS for each in kinds}) > 1:
        machine.refuse(line, "the table has both poses and joint angles", "omit one of them")
    if not kinds:
        reason = f"the header {shown(header)} does not name the coordinates of the targets"
        machine.refuse(line, reason, _REMEDY)
    notation = _notation(*_KINDS[kinds[0]], [units[name] for name in kinds[0].split()])
    if notation is None:
        reason = "the columns of the targets have no units, different ones, or those of another quantity"
        machine.refuse(line, reason, _REMEDY)
    return notation, [names[name] for name in kinds[0].split()], len(cells)


def _notation(orientation: Orientation, quantities: str, units: list[str]) -> Notation | None:
    """Return the notation of columns with units; None if these are not those of the quantities."""
    pairs = list(zip(quantities, units, strict=True))
    lengths, angles, plain = ({unit for quantity, unit in pairs if quantity == each} for each in "la1")
    if not (lengths <= _LENGTHS.keys() and angles <= _ANGLES.keys() and plain <= {""}):
        return None
    if len(lengths) > 1 or len(angles) > 1:
        return None
    length, angle = _LENGTHS[[*lengths, "mm"][0]], _ANGLES[[*angles, "rad"][0]]
    return Notation(orientation, length, angle, 6 if lengths == {"mm"} else 9, 9)


def _numbers(
    line: int, text: str, shape: str, delimiter: str, places: list[int], width: int
) -> tuple[tuple[int, ...], Cause | None]:
    """Return which of a row's numbers stand in the columns of the targets, and why the row is left."""
    cells, numbers = shape.split(delimiter), []
    if len(cells) != width:
        reason = f"{len(cells)} columns instead of {width}"
        return (), Cause(line, reason, "give every row as many columns as the header")
    for place in places:
        if cells[place].strip().strip('"').strip() != "\0":
            cell = text.split(delimiter)[place]
            remedy = "write numbers with decimal points" if "," in cell else "write a number"
            return (), Cause(line, f"{shown(cell)} in column {place + 1} is no number", remedy)
        numbers.append(delimiter.join(cells[:place]).count("\0"))
    return tuple(numbers), None


LANGUAGE: Final = Language(comment=r"(?!)", suffixes=".csv", read=read_table)
DECIMAL_COMMAS: Final = replace(LANGUAGE, number=NUMBER.replace(r"\.", ",").replace("-.", "-,"))
