"""Header of a table: in one row or up to three, after titles, or in a comment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from jointstiff.schemas.importing import ImportOptions
from jointstiff.service.importing.column_units import HeaderCell
from jointstiff.service.importing.columns import collapsed
from jointstiff.service.importing.errors import Fault, Faults, ImportFileError
from jointstiff.service.importing.grid import Grid, Row
from jointstiff.service.importing.header import Meaning, is_joint, meaning_of, split_unit, state_named
from jointstiff.service.importing.numbers import looks_like_a_number
from jointstiff.service.importing.units import FOREIGN, unit_named

MAX_TITLES: Final = 20
"""Rows above a header."""
_MAX_ROWS: Final = 3
"""Rows of a header: groups, axes, units."""
_DATA: Final = 3
"""Numbers in a row of data: no table has fewer."""
_NONE: Final = frozenset("-–/")
"""Cells of a row of units for columns without one."""


@dataclass(frozen=True)
class Heading:
    """A header as it stands in the file."""

    cells: tuple[HeaderCell, ...]  # one a column
    lines: tuple[int, ...]  # of the file that make it
    start: int  # index of the first row of data
    notes: tuple[str, ...] = ()  # in words
    stated: bool = False  # whether the caller states it


def find_heading(grid: Grid, options: ImportOptions, faults: Faults) -> Heading | None:
    """Find the header in the first rows, else in the last comment before the data.

    Args:
        grid: the file.
        options: words and meanings of the caller.
        faults: where to tell of rows above the header that are no titles.

    Returns:
        The header; if none is understood in full, the one that is understood best; None if the first row is
        of numbers and no comment is a header.

    Raises:
        ImportFileError: there is a header, but no data.
    """
    reader = _Reader(options)
    if _numbers(grid.rows[0]) < _DATA:
        return _in_rows(grid, reader, faults)
    return _in_comments(grid, reader)


def _numbers(row: Row) -> int:
    return sum(map(looks_like_a_number, row.cells))


def _in_rows(grid: Grid, reader: _Reader, faults: Faults) -> Heading:
    rows = grid.rows[: MAX_TITLES + _MAX_ROWS + 1]
    best: tuple[int, int, list[str]] | None = None
    most = 0
    for start in range(min(MAX_TITLES + 1, len(rows))):
        if start and _numbers(rows[start - 1]) >= _DATA:
            break
        for count in range(min(_MAX_ROWS, len(rows) - start), 0, -1):
            texts = reader.merged([row.cells for row in rows[start : start + count]])
            known = 0 if texts is None else reader.known(texts)
            if texts is not None and known > most:
                best, most = (start, count, texts), known
                if known == sum(map(bool, texts)) and start + count < len(grid.rows):
                    return _heading(grid, start, count, texts, faults)
    start, count, texts = best or (0, 1, list(rows[0].cells))
    if start + count == len(grid.rows):
        at = grid.place(rows[start])
        raise ImportFileError(at, "the file has a header but no row of data", "check the file")
    return _heading(grid, start, count, texts, faults)


def _heading(grid: Grid, start: int, count: int, texts: list[str], faults: Faults) -> Heading:
    rows = grid.rows[start : start + count]
    for row in grid.rows[:start]:
        filled = sum(map(bool, row.cells))
        if _numbers(row) > 1 or filled > max(2, len(texts) // 2):
            fault = ImportFileError(
                grid.place(row),
                f"the row is above the header in line {rows[0].line}, but looks like data",
                "move it below the header, or remove it",
            )
            faults.add(fault)
    notes = []
    if start:
        notes.append(f"rows above the header were taken for titles: {start}")
    if count > 1:
        notes.append(f"the header was put together of rows {', '.join(str(row.line) for row in rows)}")
    cells = tuple(
        HeaderCell(text, grid.place(rows[-1], column), guessed=count > 1) for column, text in enumerate(texts)
    )
    return Heading(cells, tuple(row.line for row in rows), start + count, tuple(notes))


def _in_comments(grid: Grid, reader: _Reader) -> Heading | None:
    """The last comment before the data that is a header in every cell."""
    first = grid.rows[0]
    for comment in reversed(grid.comments):
        fits = comment.line < first.line and len(comment.cells) == len(first.cells)
        if fits and reader.known(comment.cells) == len(comment.cells):
            cells = tuple(
                HeaderCell(text, grid.place(comment, column), guessed=True)
                for column, text in enumerate(comment.cells)
            )
            note = f"the comment in line {comment.line} was used as the header"
            return Heading(cells, (comment.line,), 0, (note,))
    return None


class _Reader:
    """The grammar of headers with the words of the caller."""

    def __init__(self, options: ImportOptions) -> None:
        self._words = options.state_words
        self._stated = {collapsed(text) for text in (*options.columns, *options.ignore)}

    def meaning(self, text: str) -> Meaning | None:
        """Return what a header means; None if it is not understood."""
        if collapsed(text) in self._stated:
            return Meaning("ignored")
        try:
            return meaning_of(text, self._words)
        except Fault:
            return None

    def known(self, texts: Sequence[str]) -> int:
        """Return how many cells are understood; none if no two of them are quantities or keys of a table."""
        meanings = [self.meaning(text) for text in texts if text]
        found = [meaning for meaning in meanings if meaning is not None]
        bare = [(m.kind, m.axis, m.target, m.state) for m in found if m.axis is not None]
        return 0 if len(set(bare)) < len(bare) or len(found) < 2 else len(found)

    def merged(self, rows: Sequence[tuple[str, ...]]) -> list[str] | None:
        """Return the rows of a header as one; None if one of them is no part of a header."""
        *above, lower = rows
        if not above:
            return None if any(map(looks_like_a_number, lower)) else list(lower)
        upper = self.merged(above)
        if upper is None or sum(map(bool, lower)) < 2 or self._title(rows[0]):
            return None
        width = max(len(upper), len(lower))
        upper += [""] * (width - len(upper))
        padded = [*lower, *[""] * (width - len(lower))]
        if all(_is_unit(cell) for cell in padded if cell):
            return [_with_unit(name, unit) for name, unit in zip(upper, padded, strict=True)]
        return self._grouped(upper, padded)

    def _title(self, row: tuple[str, ...]) -> bool:
        """Return whether a row has one text only, at its begin, that is no known word."""
        if sum(map(bool, row)) > 1 or not row[0]:
            return False
        words = split_unit(row[0])[0].replace("_", " ").split()
        known = any(state_named(word, self._words) or is_joint(word) for word in words)
        as_group = self.meaning(f"{row[0]} x")
        return not known and as_group is not None and as_group.target is not None

    def _grouped(self, upper: Sequence[str], lower: Sequence[str]) -> list[str] | None:
        """Put words below groups, which hold to the right as far as cells below them are filled."""
        texts, group = [], ""
        for above, below in zip(upper, lower, strict=True):
            group = above or (group if below else "")
            if looks_like_a_number(below) and not (below.isdigit() and is_joint(group)):
                return None
            texts.append(self._under(group, below, own=bool(above)))
            if not below:
                group = ""
        return texts

    def _under(self, group: str, below: str, *, own: bool) -> str:
        if not group or not below:
            return group if own else below
        joined = _joined(group, below)
        if own or self.meaning(joined) is not None:
            return joined
        alone = self.meaning(below)
        bare = alone is None or (alone.kind in ("position", "uncertainty") and alone.target is None)
        return joined if bare else below


def _joined(group: str, below: str) -> str:
    """`P10 loaded [mm]` and `x` as `P10 loaded x [mm]`."""
    name, unit = split_unit(group)
    if unit is None:
        return f"{group} {below}"
    return (
        f"{group} {below}"
        if split_unit(below)[1] not in (None, unit)
        else _with_unit(f"{name} {below}", unit)
    )


def _is_unit(cell: str) -> bool:
    text = cell.strip("[]() ")
    return cell in _NONE or unit_named(text) is not None or text in FOREIGN


def _with_unit(name: str, unit: str) -> str:
    unit = unit.strip("[]() ")
    if not unit or unit in _NONE or split_unit(name)[1] == unit:
        return name
    return f"{name} [{unit}]"
