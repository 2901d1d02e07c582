"""Matrices that a person pasted as MATLAB writes them, such as `Q = [10 20 30; 11 21 31];`."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

_BRACKETS: Final = re.compile(r"\[([^\[\]]*)\]")
_NAME: Final = re.compile(r"([A-Za-z]\w{0,62})[ \t]*=[ \t]*$", re.ASCII)
_LONGEST_NAME: Final = 80
_COMMENT: Final = re.compile(r"%[^\n]*")
_CONTINUED: Final = re.compile(r"\.\.\.[ \t]*\r?\n")
_NUMBER: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|NaN", re.ASCII)
_LEAST_ROWS: Final = 3
_LEAST_COLUMNS: Final = 3


class Matrix(NamedTuple):
    """Matrix of a text."""

    name: str
    rows: list[list[float]]  # all of one length


def find_matrices(text: str) -> list[Matrix]:
    """Return the matrices of a text, of three rows and three columns at least.

    Cells are separated by blanks or commas, rows by semicolons or line ends. Brackets with other contents,
    such as a unit in a header, are no matrix.
    """
    if "[" not in text:
        return []
    text = _CONTINUED.sub(" ", _COMMENT.sub("", text))
    found = list[Matrix]()
    for match in _BRACKETS.finditer(text):
        before = text[max(match.start() - _LONGEST_NAME, 0) : match.start()]
        name = _NAME.search(before)
        rows = _read_rows(match[1])
        if rows:
            found.append(Matrix(name[1] if name else f"matrix {len(found) + 1}", rows))
    return found


def _read_rows(content: str) -> list[list[float]]:
    """Return the rows of numbers between two brackets; none if this is no matrix."""
    rows = list[list[float]]()
    for line in re.split(r"[;\n]", content):
        cells = line.replace(",", " ").split()
        if not all(_NUMBER.fullmatch(cell) for cell in cells):
            return []
        if cells:
            rows.append([float(cell) for cell in cells])
    widths = {len(row) for row in rows}
    is_matrix = len(rows) >= _LEAST_ROWS and len(widths) == 1 and min(widths) >= _LEAST_COLUMNS
    return rows if is_matrix else []
