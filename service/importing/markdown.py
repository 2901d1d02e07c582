"""Tables of Markdown, whose cells stand between upright lines, as lines with tabs between cells."""

from __future__ import annotations

import re
from typing import Final

_LINE_END: Final = re.compile(r"(\r\n|\n|\r)")
_RULE: Final = re.compile(r"\|[ \t:|+]*-[ \t:|+-]*")
"""Line between the header of a table and its rows, such as `|---|:-:|`."""
_BETWEEN_CELLS: Final = re.compile(r"(?<!\\)\|")
_COMMENT: Final = "# "


def write_tables_plainly(text: str) -> str:
    """Return a text whose tables of Markdown have tabs between cells, and whose other lines are comments.

    Lines keep their numbers. A text without the line below a header is returned unchanged.
    """
    parts = _LINE_END.split(text)  # lines at even indices, and what ends them
    lines = [line.strip() for line in parts[::2]]
    if not any(_RULE.fullmatch(line) and _is_row(lines[k - 1]) for k, line in enumerate(lines) if k):
        return text
    parts[::2] = map(_write_line, lines)
    return "".join(parts)


def _is_row(line: str) -> bool:
    """Return whether a line is a row of a table: it begins with an upright line and has another one."""
    return line.startswith("|") and len(_BETWEEN_CELLS.findall(line)) > 1


def _write_line(line: str) -> str:
    """Return a row with tabs between its cells, no text for the line below a header, else a comment."""
    if _RULE.fullmatch(line):
        return ""
    if _is_row(line):
        inner = line[1:].removesuffix("|").replace("\t", " ")
        cells = _BETWEEN_CELLS.split(inner)
        return "\t".join(cell.strip().replace("\\|", "|") for cell in cells)
    return f"{_COMMENT}{line.lstrip('# ')}" if line else ""
