"""Matrices that a person pasted as MATLAB writes them, such as `Q = [10 20 30; 11 21 31];`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from jointstiff.service.importing.errors import ImportFileError, Place, quote
from jointstiff.service.importing.grammar import is_force
from jointstiff.service.importing.grid import MAX_NUMBER_LENGTH, Remark

_BRACKETS: Final = re.compile(r"\[([^\[\]]*)\]")
_NAME: Final = re.compile(r"([A-Za-z]\w{0,62})[ \t]*=[ \t]*$", re.ASCII)
_ASSIGNED: Final = re.compile(
    r"(?<![\w.])([A-Za-z]\w{0,62})(?:\([^()\n]{0,40}\))?[ \t]*=[ \t]*(?![=\[ \t])", re.ASCII
)
"""Assignment of something else than brackets to a name, or to a part of what has the name."""
_LONGEST_NAME: Final = 80
_COMMENT: Final = re.compile(r"%[^\n]*")
_CONTINUED: Final = re.compile(r"\.\.\.[ \t]*\r?\n")
_NUMBER: Final = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|NaN", re.ASCII)
_OPERATORS_BEFORE: Final = tuple("+-*/\\^.(&|~")
_OPERATORS_BEHIND: Final = tuple("+-*/\\^.(&|")
_LEAST_ROWS: Final = 3
_LEAST_COLUMNS: Final = 3


class Matrix(NamedTuple):
    """Matrix of a text."""

    name: str
    rows: list[list[float]]  # all of one length


def find_matrices(file: str, text: str) -> list[Matrix]:
    """Return the matrices of a text, of three rows and three columns at least, and the force of all rows.

    Cells are separated by blanks or commas, rows by semicolons or line ends. Brackets with other contents,
    such as a unit in a header, are no matrix. A matrix with `'` after its bracket is transposed. Of two
    matrices with one name the last counts, as in MATLAB.

    Args:
        file: name of the file, for messages.
        text: text of the file.

    Raises:
        ImportFileError: the text computes with a matrix, so that its numbers are not those that are written.
    """
    if "[" not in text:
        return []
    text = _CONTINUED.sub(" ", _COMMENT.sub("", _omit_commented_blocks(text)))
    found = dict[str, Matrix]()
    for match in _BRACKETS.finditer(text):
        before = text[max(match.start() - _LONGEST_NAME, 0) : match.start()].rstrip(" \t")
        behind = text[match.end() : match.end() + _LONGEST_NAME].lstrip(" \t")
        rows = _read_rows(match[1])
        stated_name = _NAME.search(before)
        is_force_of_all = stated_name is not None and is_force(stated_name[1]) and _is_vector(rows)
        if not (_is_matrix(rows) or is_force_of_all):
            continue
        name = stated_name[1] if stated_name else f"matrix {len(found) + 1}"
        if behind.startswith("'"):
            rows = [list(column) for column in zip(*rows, strict=True)]
            behind = behind[1:].lstrip(" \t")
        if before.endswith(_OPERATORS_BEFORE) or behind.startswith(_OPERATORS_BEHIND):
            raise _refuse_computed(file, name)
        found.pop(name, None)
        found[name] = Matrix(name, rows)
    for assigned in _ASSIGNED.finditer(text):
        if assigned[1] in found:
            raise _refuse_computed(file, assigned[1])
    return list(found.values()) if any(_is_matrix(each.rows) for each in found.values()) else []


def list_comments(text: str) -> list[Remark]:
    """Return the comments of a text, without their marks."""
    lines = enumerate(text.splitlines(), 1)
    found = ((number, _COMMENT.search(line)) for number, line in lines)
    comments = [(number, match[0].strip("% \t")) for number, match in found if match is not None]
    return [Remark(number, comment) for number, comment in comments if comment]


def _omit_commented_blocks(text: str) -> str:
    """Return a text without its blocks of comments: lines from `%{` to `%}`, each alone in its line."""
    return "\n".join(_generate_lines_without_blocks(text))


def _generate_lines_without_blocks(text: str) -> Iterator[str]:
    """Yield the lines of a text that stand in no block of comments; blocks may contain blocks."""
    depth = 0
    for line in text.split("\n"):
        mark = line.strip()
        if mark == "%{":
            depth += 1
        elif mark == "%}":
            depth = max(depth - 1, 0)
        elif depth == 0:
            yield line


def _refuse_computed(file: str, name: str) -> ImportFileError:
    """Return the error of a text that computes with a matrix."""
    return ImportFileError(
        Place(file),
        f"the text computes with matrix {quote(name)}, so its numbers are not those that are written",
        "carry out the computation, and give the matrix that it shows",
    )


def _read_rows(content: str) -> list[list[float]]:
    """Return the rows of numbers between two brackets; none if there are other texts."""
    rows = list[list[float]]()
    for line in re.split(r"[;\n]", content):
        cells = line.replace(",", " ").split()
        if not all(len(cell) <= MAX_NUMBER_LENGTH and _NUMBER.fullmatch(cell) for cell in cells):
            return []
        if cells:
            rows.append([float(cell) for cell in cells])
    return rows


def _is_matrix(rows: Sequence[Sequence[float]]) -> bool:
    """Return whether rows of numbers are a matrix of three rows and three columns at least."""
    widths = {len(row) for row in rows}
    return len(rows) >= _LEAST_ROWS and len(widths) == 1 and min(widths) >= _LEAST_COLUMNS


def _is_vector(rows: Sequence[Sequence[float]]) -> bool:
    """Return whether rows of numbers are three numbers in a row or in a column."""
    return [len(row) for row in rows] in ([_LEAST_COLUMNS], [1] * _LEAST_ROWS)
