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

_ORIENTATIONS: Final = {
    ("a", "b", "c"): Orientation.EULER_ZYX,
    ("w", "p", "r"): Orientation.FIXED_XYZ,
    ("qw", "qx", "qy", "qz"): Orientation.QUATERNION,
    ("rx", "ry", "rz"): Orientation.ROTATION_VECTOR,
    ("i", "j", "k"): Orientation.TOOL_AXIS,
}
_JOINTS: Final = (
    tuple(f"j{i}" for i in range(1, 7)),
    tuple(f"a{i}" for i in range(1, 7)),
    tuple(f"q{i}" for i in range(1, 7)),
)
_HEADER: Final = re.compile(
    r"([a-z]++\d?)\s*+(?:[\[(_]?\s*+(mm|m|degree|deg|rad|\xb0)\s*+[\])]?)?", re.IGNORECASE
)
_UNITS: Final = {"mm": MM, "m": 1.0, "deg": DEGREE, "degree": DEGREE, "\xb0": DEGREE, "rad": 1.0}
_LENGTHS: Final = {"mm", "m"}
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
    shapes, first = numerals.shapes(source.starts, source.ends)
    rows = [i for i, shape in enumerate(shapes) if shape.strip() and not shape.lstrip().startswith("#")]
    if not rows:
        return
    header = source.text[source.starts[rows[0]] : source.ends[rows[0]]]
    delimiter = max(";\t,", key=header.count)
    columns = _columns(reader, rows[0] + 1, header, delimiter)
    if columns is None:
        return
    notation, places, width = columns
    _refuse_changes(reader, rows, delimiter)
    frames = FrameName("base", np.eye(4)) if notation.is_joints else FrameName("part"), FrameName("tool")
    motion = Motion.JOINT if notation.is_joints else Motion.LINEAR
    reader.numerals = [numerals]
    literals: dict[str, Literal | None] = {}
    of_row = np.array(rows[1:], dtype=np.intp)
    number = {shape: k for k, shape in enumerate(shapes)}
    for begin, end in runs(np.array([number[shapes[i]] for i in rows[1:]], dtype=np.intp)):
        shape = shapes[of_row[begin]]
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


def _refuse_changes(reader: Reader, rows: list[int], delimiter: str) -> None:
    """Refuse rows whose tool, base or external axes are others than in the first one."""
    source = reader.sources[0]
    cells = [source.text[source.starts[i] : source.ends[i]].split(delimiter) for i in rows[:1]]
    held = [k for k, cell in enumerate(cells[0]) if _HELD.match(cell)]
    cells = [source.text[source.starts[i] : source.ends[i]].split(delimiter) for i in rows[1:] if held]
    stated = [[cell.strip() for k in held for cell in row[k : k + 1]] for row in cells]
    for i, each in zip(rows[1:], stated, strict=False):
        if each != stated[0]:
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
    kinds = [(fields, notation) for fields, notation in _notations() if all(f in names for f in fields)]
    if len({notation.is_joints for _, notation in kinds}) > 1:
        reader.refuse(line, "the columns are poses and joint angles, which would disagree", "leave one out")
        return None
    for fields, notation in kinds[:1]:
        given = [[units[f] for f in part if units[f]] for part in (fields[:3], fields[3:])]
        scaled = _scaled(notation, given)
        if scaled is not None:
            return scaled, [names[f] for f in fields], len(cells)
        reason = "the columns of the targets have no units, different ones, or those of another quantity"
        reader.refuse(line, reason, _REMEDY)
        return None
    reader.refuse(line, f"the header {shown(header)} does not say where the targets are", _REMEDY)
    return None


def _notations() -> list[tuple[tuple[str, ...], Notation]]:
    poses = [
        (("x", "y", "z", *names), Notation(kind, length_decimals=6, angle_decimals=9))
        for names, kind in _ORIENTATIONS.items()
    ]
    joints = [(names, Notation(Orientation.JOINTS, length_decimals=9, angle_decimals=9)) for names in _JOINTS]
    return [*poses, *joints, (("x", "y", "z"), Notation(Orientation.NONE, length_decimals=6))]


def _scaled(notation: Notation, given: list[list[str]]) -> Notation | None:
    lengths, angles = given
    joints = notation.orientation is Orientation.JOINTS
    if joints:
        lengths, angles = [], lengths + angles
    plain = notation.orientation in {Orientation.QUATERNION, Orientation.TOOL_AXIS, Orientation.NONE}
    counts = (0, 6) if joints else (3, 0 if plain else 3)
    if (len(lengths), len(angles)) != counts or len(set(lengths)) > 1 or len(set(angles)) > 1:
        return None
    if not set(lengths) <= _LENGTHS or set(angles) & _LENGTHS:
        return None
    length = _UNITS[lengths[0]] if lengths else MM
    angle = _UNITS[angles[0]] if angles else 1.0
    digits = 9 if length == 1 else notation.length_decimals
    return Notation(notation.orientation, length, angle, digits, notation.angle_decimals)


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
