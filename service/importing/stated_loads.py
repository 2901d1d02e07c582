"""Loads that files state once in words, not in columns: a likely answer to the question for the force."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Final, NamedTuple

from jointstiff.service.importing.arrays import read_arrays
from jointstiff.service.importing.encoding import decode
from jointstiff.service.importing.errors import ImportFileError, quote
from jointstiff.service.importing.excel import read_workbook
from jointstiff.service.importing.grid import (
    ARRAYS,
    JSON,
    WORKBOOK,
    ArrayFormat,
    file_type,
    looks_like_a_number,
)
from jointstiff.service.importing.reading import SourceFile

_LOAD: Final = re.compile(
    r"(?<![\w.,])(?P<size>\d{1,5}(?:[.,]\d{1,3})?)[ _]?(?P<unit>kg|kgf|kN|N|lbf)(?![^\W_]|/)"
    r"(?P<direction>(?: in| along)?(?: direction)? ?(?P<sign>[-+−–]?)(?P<axis>[XYZxyz])(?![^\W_]))?"
)
"""A mass or a force, perhaps with its direction, such as `60 N in -Z`."""
_LOAD_IN_NAME: Final = re.compile(
    r"(?<![\d.,])(?P<size>\d{1,5}(?:[.,]\d{1,3})?)[ _]?(?P<unit>kg|kN)(?![^\W\d_])"
)
"""A mass or a force in the name of a file, such as `load100kg`."""
_FIELD: Final = re.compile(
    r"[\s_(\[](?P<unit>kg|kgf|kN|N|lbf)[)\]]?[\"']? ?[:=\t;]\s?"
    r"(?P<size>\d{1,5}(?:[.,]\d{1,3})?)\s{0,9}[,;]?$"
)
"""A field at the end of a line, such as `payload_kg: 8.0`."""
_FIELDS: Final = re.compile(r"[,{}]")
"""What separates the fields of JSON."""
_CELLS: Final = re.compile(r"[\t;|,\"]|[.!?:] ")
"""What ends a cell or a sentence."""
_MARKS: Final = "#%!/*;'-> "
"""Marks of comments, before words."""
_MOST_CHARACTERS: Final = 400
"""Characters of a line that are searched: a line of words is short."""
_MOST_BEFORE: Final = 60
_MOST_WORDS: Final = 4
"""Words before a number that are quoted."""
_MOST_LOADS: Final = 3
"""Different loads of files that state the load in words; more are a column."""


class StatedLoad(NamedTuple):
    """Load that a file states in words."""

    file: str
    place: str  # in words, such as `line 2`
    text: str  # as the file writes the load, with words before it
    force: str  # `0,0,-150 kgf` in axes of R0 if the load hangs; empty for a direction without a sign
    hangs: bool  # whether the text states no direction, so that the load may hang


def find_stated_loads(files: Sequence[SourceFile]) -> list[StatedLoad]:
    """Return the different loads that files state in words; none if there are many, as in a column."""
    loads: dict[tuple[float, str], StatedLoad] = {}
    for file in files:
        for place, text in _yield_texts(file):
            pattern = _LOAD if place else _LOAD_IN_NAME
            found = pattern.search(text, 0, _MOST_CHARACTERS) or _FIELD.search(text, 0, _MOST_CHARACTERS)
            if found is not None and float(found["size"].replace(",", ".")) > 0.0:
                load = _read_load(file.name, place, text, found)
                loads.setdefault((float(found["size"].replace(",", ".")), found["unit"]), load)
            if len(loads) > _MOST_LOADS:
                return []
    return list(loads.values())


def describe_stated_loads(loads: Sequence[StatedLoad]) -> str:
    """Return a sentence on the loads that files state in words, with the likely force; empty without one."""
    listed = ", ".join(
        f'{quote(load.file)} says "{load.text}"' + (f" in {load.place}" if load.place else " in its name")
        for load in loads
    )
    if len(loads) != 1 or not loads[0].force:
        return listed
    condition = "this load hangs" if loads[0].hangs else "this force acts on the robot in axes of R0"
    return f"{listed}: if {condition}, `force` is {loads[0].force}"


def _yield_texts(file: SourceFile) -> Iterator[tuple[str, str]]:
    """Yield place and text of the name of a file, and of what the file says."""
    yield "", file.name.rpartition(".")[0]
    with suppress(ImportFileError):
        kind = file_type(file.content, file.name)
        if kind == WORKBOOK:
            yield from _yield_rows(file)
        elif kind is not None and kind in ARRAYS:
            yield from _yield_scalars(file, ARRAYS[kind])
        elif kind in (None, JSON):
            for number, line in enumerate(decode(file.name, file.content)[0].splitlines(), 1):
                fields = _FIELDS.split(line) if kind == JSON else [line]
                yield from ((f"line {number}", text) for text in fields)


def _yield_rows(file: SourceFile) -> Iterator[tuple[str, str]]:
    """Yield place and text of the names, rows and comments of all sheets of a workbook."""
    for sheet in read_workbook(file.name, file.content, None):
        yield "the name of a sheet", sheet.preview.sheet or ""
        rows = [(row.line, "\t".join(filter(None, row.cells))) for row in sheet.rows]
        rows += [(comment.line, comment.text) for comment in sheet.comments]
        for number, text in rows:
            yield f"row {number} of the sheet {quote(sheet.preview.sheet or '')}", text


def _yield_scalars(file: SourceFile, kind: ArrayFormat) -> Iterator[tuple[str, str]]:
    """Yield place and text of the single numbers and texts of a file of arrays."""
    for grid in read_arrays(file.name, file.content, kind, [None]):
        for scalar in grid.comments:
            yield "its arrays", scalar.text


def _read_load(file: str, place: str, text: str, found: re.Match[str]) -> StatedLoad:
    """Return the load that a text states, with the words before the load in its cell or sentence."""
    cells = _CELLS.split(text[max(0, found.start() - _MOST_BEFORE) : found.start()])
    is_cell_before = not cells[-1].strip() and not looks_like_a_number(cells[-2:][0].strip())
    before = " ".join(cells[-2:]) if is_cell_before else cells[-1]  # words before a number name it
    count = _MOST_WORDS + len(found[0].split())
    words = " ".join((before + found[0]).split()[-count:]).lstrip(_MARKS)
    groups = found.groupdict()
    axis, sign = groups.get("axis"), groups.get("sign")
    parts = ["0", "0", "0"]
    parts["xyz".index((axis or "z").casefold())] = ("" if sign == "+" else "-") + found["size"].replace(
        ",", "."
    )
    unit = "kgf" if found["unit"] == "kg" else found["unit"]
    force = "" if axis and not sign else f"{','.join(parts)} {unit}"
    return StatedLoad(file, place, words, force, hangs=not axis)
