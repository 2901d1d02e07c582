"""Targets in a table (CSV): a header names the columns and their units, each row is a target."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from jointstiff.service.programs.errors import shown
from jointstiff.service.programs.notation import DEGREE, MM, Notation, Orientation
from jointstiff.service.programs.numerals import Numerals
from jointstiff.service.programs.program import FrameName, Literal, Motion
from jointstiff.service.programs.reader import Place, Reader, runs
from jointstiff.service.programs.scanner import NUMBER
from jointstiff.solver.arrays import IndexArray

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


def read_table(reader: Reader) -> None:
    """Read a table of targets."""
    source = reader.sources[0]
    numerals = Numerals.of(source.text, NUMBER)
    parts, first = numerals.shapes(source.starts, source.ends)
    known: dict[str, int] = {}
    of_line = np.fromiter((known.setdefault(shape, len(known)) for shape in parts), dtype=np.intp)
    shapes = list(known)
    says = [bool(shape.strip()) and not shape.lstrip().startswith("#") for shape in shapes]
    rows = np.flatnonzero(np.array(says)[of_line])
    if not len(rows):
        return
    header = source.text[source.starts[rows[0]] : source.ends[rows[0]]]
    delimiter = max(";\t,", key=header.count)
    columns = _columns(reader, int(rows[0]) + 1, header, delimiter)
    if columns is None:
        return
    notation, places, width = columns
    _refuse_changes(reader, rows, header, delimiter)
    frames = FrameName("base", np.eye(4)) if notation.is_joints else FrameName("part"), FrameName("tool")
    motion = Motion.JOINT if notation.is_joints else Motion.LINEAR
    reader.numerals = [numerals]
    literals: dict[str, Literal | None] = {}
    of_row = rows[1:]
    for begin, end in runs(of_line[of_row]):
        shape = shapes[of_line[of_row[begin]]]
        for k, i in enumerate(of_row[begin:end].tolist(), begin):
            if literals.get(shape) is None:
                text = source.text[source.starts[i] : source.ends[i]]
                numbers = _numbers(reader, i + 1, text, shape, delimiter, places, width)
                literals[shape] = None if numbers is None else Literal(notation, numbers)
            if (literal := literals[shape]) is not None:
                place = Place(0, i + 1, int(source.starts[i]), int(first[i]), numerals)
                reader.move(i + 1, motion, (reader.target("", place, literal, frames, i + 1),))
                same = of_row[k:end]
                if reader.repeat(same + 1, first[same]):
                    break


def _refuse_changes(reader: Reader, rows: IndexArray, header: str, delimiter: str) -> None:
    """Refuse rows whose tool, base or external axes are others than in the first one."""
    source, first = reader.sources[0], None
    held = [k for k, cell in enumerate(header.split(delimiter)) if _HELD.match(cell)]
    for i in rows[1:].tolist() if held else ():
        cells = source.text[source.starts[i] : source.ends[i]].split(delimiter)
        stated = [cells[k].strip() for k in held if k < len(cells)]
        first = stated if first is None else first
        if stated != first:
            reader.refuse(i + 1, "tool, base or an external axis changes", "send a table for each of them")


def _columns(
    reader: Reader, line: int, header: str, delimiter: str
) -> tuple[Notation, list[int], int] | None:
    """Return the notation, the columns of its numbers in order, and the number of columns."""
    cells = [cell.strip().strip('"').strip().removeprefix("\xef\xbb\xbf") for cell in header.split(delimiter)]
    named = [_HEADER.fullmatch(cell) for cell in cells]
    names = {m[1].lower(): i for i, m in enumerate(named) if m}
    units = {m[1].lower(): (m[2] or "").lower() for m in named if m}
    if len(names) < sum(map(bool, named)):
        reader.refuse(line, "two columns have the same name", _REMEDY)
        return None
    kinds = [each for each in _KINDS if names.keys() >= set(each.split())]
    if len({_KINDS[each][0] is Orientation.JOINTS for each in kinds}) > 1:
        reader.refuse(line, "the table has both poses and joint angles", "omit one of them")
        return None
    for kind in kinds[:1]:
        notation = _notation(*_KINDS[kind], [units[name] for name in kind.split()])
        if notation is not None:
            return notation, [names[name] for name in kind.split()], len(cells)
        reason = "the columns of the targets have no units, different ones, or those of another quantity"
        reader.refuse(line, reason, _REMEDY)
        return None
    reader.refuse(line, f"the header {shown(header)} does not name the coordinates of the targets", _REMEDY)
    return None


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
    reader: Reader, line: int, text: str, shape: str, delimiter: str, places: list[int], width: int
) -> tuple[int, ...] | None:
    """Return which of a row's numbers stand in the columns of the targets; None where the row is refused."""
    cells, numbers = shape.split(delimiter), []
    if len(cells) != width:
        reason = f"{len(cells)} columns instead of {width}"
        reader.refuse(line, reason, "give every row as many columns as the header")
        return None
    for place in places:
        if cells[place].strip().strip('"').strip() != "\0":
            cell = text.split(delimiter)[place]
            remedy = "write numbers with decimal points" if "," in cell else "write a number"
            reader.refuse(line, f"{shown(cell)} in column {place + 1} is no number", remedy)
            return None
        numbers.append(delimiter.join(cells[:place]).count("\0"))
    return tuple(numbers)
