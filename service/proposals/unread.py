"""Reasons why a file was not read, for files that are no table of rows."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from contextlib import suppress
from typing import Final

from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grammar import Vocabulary
from jointstiff.service.importing.grid import Grid, file_type
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.importing.texts.encoding import decode

_DECIMAL: Final = re.compile(r"\d[.,]\d")
_READINGS: Final = 9
"""Decimal numbers of a file that may have readings, at least: the coordinates of three points."""
_NUMBER: Final = re.compile(r"(?<![\w.,])[-+]?\d+(?:[.,]\d+)?(?!\w)")
_BETWEEN_CELLS: Final = (";", ",", "\t")
_JOINTS: Final = range(3, 8)
"""Joints that the first column of a turned table names."""
_LEAVE_OUT: Final = "leave this file out, or export it as a table"
_EXPORT: Final = "export the numbers as a table with a row for each posture or point"


def advise_on_files_without_rows(files: Iterable[SourceFile], names: Collection[str]) -> str:
    """Return what to do about files that have no rows of numbers: one that has numbers is not left out."""
    unread = [file for file in files if file.name in names]
    return _EXPORT if not unread or any(map(_has_readings, unread)) else _LEAVE_OUT


def find_remarks(files: Iterable[SourceFile], names: Collection[str]) -> tuple[str, ...]:
    """Return which of some files without rows of numbers are remarks in words, such as a README."""
    return tuple(file.name for file in files if file.name in names and not _has_readings(file))


def _has_readings(file: SourceFile) -> bool:
    """Return whether a file may have readings: numbers, cells in columns, or contents that are no text."""
    if file_type(file.content, file.name) is not None:
        return True
    with suppress(ImportFileError):
        text, _ = decode(file.name, file.content)
        number_count = len(_NUMBER.findall(text))
        are_numbers_most = number_count >= _READINGS and 3 * number_count > len(text.split())
        has_decimals = len(_DECIMAL.findall(text)) >= _READINGS
        return has_decimals or are_numbers_most or _has_columns(text)
    return True


def _has_columns(text: str) -> bool:
    """Return whether each line of a text, of two at least, has as many cells as the others."""
    lines = [line for line in text.splitlines() if line.strip()]
    counts = [{line.count(mark) for line in lines} for mark in _BETWEEN_CELLS]
    return len(lines) > 1 and any(len(own) == 1 and 0 not in own for own in counts)


def describe_turned_table(grids: Iterable[Grid], words: Vocabulary) -> str:
    """Return a sentence on the first table whose first column names joints; empty without one."""
    for grid in grids:
        names = [row.cells[0] for row in grid.rows]
        words.add_names_of_table(names)
        meanings = [words.find(name) for name in names]
        joints = [each.axis for each in meanings if each is not None and each.kind == "joint"]
        if len(joints) in _JOINTS and len(set(joints)) == len(joints):
            return f"the first column of {grid.file} names joints, so that the table looks transposed"
    return ""
