"""Tables of Markdown, whose cells stand between upright lines, as lines with tabs between cells."""

from __future__ import annotations

import re
from typing import Final

from jointstiff.service.importing.errors import ImportFileError, Place

_LINE_END: Final = re.compile(r"(\r\n|\n|\r)")
_RULE: Final = re.compile(r"\|[ \t:|+]*-[ \t:|+-]*")
"""Line between the header of a table and its rows, such as `|---|:-:|`."""
_BETWEEN_CELLS: Final = re.compile(r"(?<!\\)\|")
_QUOTED: Final = "> \t"
_DIGIT: Final = re.compile(r"\d")
_COMMENT: Final = "# "


def write_tables_plainly(file: str, text: str) -> str:
    """Return a text whose tables of Markdown have tabs between cells, and whose other lines are comments.

    Lines keep their numbers. A text without the line below a header is returned unchanged. Rows may be
    quoted, and may lack upright lines at their ends.

    Raises:
        ImportFileError: a line behind a header has numbers between upright lines, but not as many cells as
            the header.
    """
    parts = _LINE_END.split(text)  # lines at even indices, and what ends them
    lines = [line.strip().lstrip(_QUOTED) for line in parts[::2]]
    rules = {k for k, line in enumerate(lines) if k and _RULE.fullmatch(line) and _is_row(lines[k - 1])}
    if not rules:
        return text
    width = 0
    for k, line in enumerate(lines):
        if k + 1 in rules:
            width = len(_split_cells(line))
        if _is_row(line) or (width > 1 and len(_split_cells(line)) == width):
            parts[2 * k] = "" if _RULE.fullmatch(line) else _write_row(line)
        elif width and _BETWEEN_CELLS.search(line) and _DIGIT.search(line):
            reason = f"the line has upright lines and numbers, but not the {width} cells of the table above"
            remedy = "write all cells of the row, or remove the upright lines from the text"
            raise ImportFileError(Place(file, k + 1), reason, remedy)
        else:
            parts[2 * k] = f"{_COMMENT}{line.lstrip('# ')}" if line else ""
    return "".join(parts)


def _is_row(line: str) -> bool:
    """Return whether a line is a row of a table: it begins with an upright line and has another one."""
    return line.startswith("|") and len(_BETWEEN_CELLS.findall(line)) > 1


def _split_cells(line: str) -> list[str]:
    """Return the cells of a row, with or without upright lines at its ends."""
    cells = _BETWEEN_CELLS.split(line.removeprefix("|"))
    return cells[:-1] if len(cells) > 1 and not cells[-1] else cells


def _write_row(line: str) -> str:
    """Return a row with tabs between its cells."""
    cells = _split_cells(line.replace("\t", " "))
    return "\t".join(cell.strip().replace("\\|", "|") for cell in cells)
