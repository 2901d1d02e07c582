"""Joint positions in the text of a robot program, read as a table with a row for each position.

These are RAPID (`jointtarget`, `MoveAbsJ`, also in a log), KRL (`E6AXIS`, `AXIS`) and FANUC's LS
(`J1= … deg`). The angles are in degrees, as the makers define them. Axes beyond the sixth are left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

_AXES: Final = 6
_LEAST_POSITIONS: Final = 3
_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RAPID: Final = re.compile(
    r"(?:\bjointtarget\s+(?P<name>\w{1,64})\s*:=|\bMoveAbsJ)\s*\[\s*\[(?P<angles>[^\]]{1,400})\]",
    re.IGNORECASE,
)
_LOGGED: Final = re.compile(
    r"(?P<name>)\[\s*\[(?P<angles>[^\[\]]{1,400})\]\s*,\s*\[(?:\s*9E\+?0?9\s*,?){6}\]\s*\]", re.IGNORECASE
)
"""A `jointtarget` without its name: six angles, and six external axes that are not used."""
_KRL: Final = re.compile(
    r"(?:\b(?:E6)?AXIS\s{1,9}(?P<name>\w{1,64})\s{0,9}=\s{0,9})?\{(?:\s*E6AXIS\s*:)?\s*(?P<angles>A1\s[^{}]{1,400})\}",
    re.IGNORECASE,
)
_LS: Final = re.compile(
    r"^[ \t]*P\[(?P<name>\d{1,5})[^\]]{0,80}\]\s{0,9}\{(?P<angles>[^{}]{1,2000})\}", re.MULTILINE
)
_FIELD: Final = re.compile(r"(?<!\S)([^\W\d]\w{0,31}) ?= ?([^\s=,;{}\[\]]{1,32})(?!\S)")
"""A name and its value in a line of a log."""
_MOST_BEFORE: Final = 200
"""Characters before a position that may have fields."""
_KRL_AXIS: Final = re.compile(rf"\bA([1-6])\s+({_NUMBER})", re.IGNORECASE)
_LS_AXIS: Final = re.compile(rf"\bJ([1-6])\s*=\s*({_NUMBER})\s*deg", re.IGNORECASE)


@dataclass(frozen=True)
class JointPosition:
    """Angles of the six axes as they are written in a program."""

    line: int  #: line of the program, from 1
    angles: tuple[str, ...]  #: [deg]
    name: str  #: as the program declares the position; empty without a name
    fields: tuple[tuple[str, str], ...] = ()  #: names and values before the position, such as `LAST=1`


def read_joint_positions(text: str) -> list[JointPosition]:
    """Return the joint positions of a robot program in their order; none of a text that is no program."""
    for read in (_read_rapid, _read_krl, _read_ls, _read_logged):
        positions = list(read(text))
        if len(positions) >= _LEAST_POSITIONS:
            return positions
    return []


def name_angles(line: str) -> str | None:
    """Return a line with a joint position of KRL or RAPID as `A1[deg] 10.5 A2[deg] -20 …`, or None."""
    for read in (_read_krl, _read_rapid, _read_logged):
        position = next(read(line), None)
        if position is not None:
            return " ".join(f"A{axis}[deg] {angle}" for axis, angle in enumerate(position.angles, 1))
    return None


def _read_rapid(text: str) -> Iterator[JointPosition]:
    """Yield the positions of `jointtarget` and of `MoveAbsJ` with numbers."""
    return _read_brackets(text, _RAPID)


def _read_logged(text: str) -> Iterator[JointPosition]:
    """Yield the positions that a program of RAPID wrote into a log, behind a time or a name."""
    return _read_brackets(text, _LOGGED)


def _read_brackets(text: str, block: re.Pattern[str]) -> Iterator[JointPosition]:
    """Yield the positions in blocks of six numbers with commas between them."""
    for line, found in _find_blocks(text, block):
        angles = tuple(each.strip() for each in found["angles"].split(","))
        if len(angles) == _AXES and all(re.fullmatch(_NUMBER, each) for each in angles):
            yield JointPosition(line, angles, found["name"] or "", _list_fields(found))


def _read_krl(text: str) -> Iterator[JointPosition]:
    """Yield the aggregates with A1 to A6."""
    return _read_named_axes(text, _KRL, _KRL_AXIS)


def _read_ls(text: str) -> Iterator[JointPosition]:
    """Yield the positions with J1 to J6 in degrees."""
    return _read_named_axes(text, _LS, _LS_AXIS)


def _read_named_axes(text: str, block: re.Pattern[str], axis: re.Pattern[str]) -> Iterator[JointPosition]:
    """Yield the positions in blocks that name all axes."""
    for line, found in _find_blocks(text, block):
        angles = dict(axis.findall(found["angles"]))
        if len(angles) == _AXES:
            in_order = tuple(angles[str(number + 1)] for number in range(_AXES))
            yield JointPosition(line, in_order, found["name"] or "", _list_fields(found))


def _list_fields(found: re.Match[str]) -> tuple[tuple[str, str], ...]:
    """Return the names and values in the line of a block before the block."""
    before = found.string[max(found.start() - _MOST_BEFORE, 0) : found.start()]
    return tuple(_FIELD.findall(before.rpartition("\n")[2]))


def _find_blocks(text: str, block: re.Pattern[str]) -> Iterator[tuple[int, re.Match[str]]]:
    """Yield the line of each block, and its name and angles."""
    line, end = 1, 0
    for found in block.finditer(text):
        line += text.count("\n", end, found.start())
        end = found.start()
        yield line, found
