"""Output on the terminal: console, tables, errors, and progress bar."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from textwrap import wrap
from typing import Any, Final

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar
from rich.table import Table as RichTable
from rich.text import Text

from jointstiff.schemas.finding import Problem
from jointstiff.schemas.job import Progress
from jointstiff.service.tables.report import problem_line
from jointstiff.service.tables.table import Chart, Line, Part, Table

_MIN_TERMINAL_WIDTH = 80
_MIN_TEXT_WIDTH: Final = 16
"""Least width of a column of text on a narrow terminal, in characters."""
_INDENT: Final = re.compile(r"^ *(?:\d+\. )?")
_STYLES: Final = {
    "": "",
    "title": "bold",
    "good": "green",
    "care": "yellow",
    "bad": "red",
    "dim": "dim",
    "verdict_use": "bold green",
    "verdict_care": "bold yellow",
    "verdict_not": "bold red",
}


def console(*, stderr: bool = False) -> Console:
    """Return a console at least 80 characters wide, which does not highlight numbers."""
    output = Console(stderr=stderr, highlight=False)
    # Numbers cut short by a narrow terminal mislead; wrapped lines do not.
    return Console(stderr=stderr, highlight=False, width=max(output.width, _MIN_TERMINAL_WIDTH))


@contextmanager
def progress_bar(*, shown: bool) -> Iterator[Callable[[Progress], None]]:
    """Show a progress bar on the standard error if `shown`; yield the function that takes each progress."""
    if not shown:
        yield lambda _: None
        return
    with new_bar() as bar:
        task = bar.add_task("starting", total=None)
        yield lambda progress: bar.update(
            task, description=progress.activity, total=progress.total, completed=progress.done
        )


def new_bar() -> ProgressBar:
    """Return a progress bar with the time left, on the standard error; it vanishes when it is stopped."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return ProgressBar(*columns, console=console(stderr=True), transient=True)


def problem_text(problem: Problem) -> Text:
    """Lay out an error for the terminal: place, reason and remedy of each fault."""
    return _style_line(problem_line(problem))


def lay_out_parts(parts: Sequence[Part]) -> RenderableType:
    """Lay out parts for the terminal, without charts; text is never interpreted as markup."""
    shown = (part for part in parts if not isinstance(part, Chart))
    return Group(*(_lay_out_line(part) if isinstance(part, Line) else _FittedTable(part) for part in shown))


def _lay_out_line(line: Line) -> RenderableType:
    """Lay out a text of one or more lines; where a line wraps, its indentation is repeated."""
    return Group(*(_lay_out_indented(Line(text, line.style)) for text in line.text.split("\n")))


def _lay_out_indented(line: Line) -> RenderableType:
    """Lay out a line in two columns, its indentation and its text, so that wrapped text stays indented."""
    indent = len(line.text) - len(_INDENT.sub("", line.text))
    if not indent:
        return _style_line(line)
    grid = RichTable.grid()
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    grid.add_row(*(_style_line(Line(text, line.style)) for text in (line.text[:indent], line.text[indent:])))
    return grid


@dataclass(frozen=True)
class _FittedTable:
    """A table in the first layout that fits the terminal.

    The layouts are: with lines between the cells; without lines; with folded headers and split into parts of
    some columns each. Texts are folded if necessary, numbers never, as a number in two pieces misleads.
    """

    table: Table

    def __rich_console__(self, _: Console, options: ConsoleOptions) -> Iterator[RichTable]:
        """Yield the table in one piece, or in parts with some of the columns each."""
        head, width = self.table.head(), options.max_width
        column_indices = range(len(head))
        cell_widths = self._find_cell_widths(len(head))
        text_columns = self.table.text_columns()

        def least_widths(headers: Sequence[str]) -> list[int]:
            """Return the least width of each column under these headers, in characters."""
            widths = list[int]()
            for index, header in enumerate(headers):
                greatest = _MIN_TEXT_WIDTH if index in text_columns else width - _MIN_TEXT_WIDTH - 1
                needed = max(cell_widths[index], _text_width(header))
                widths.append(min(greatest, needed))
            return widths

        # With lines a table needs three more characters for each column, and one; without lines, one blank
        # between two columns.
        width_of_cells = sum(least_widths(head))
        fits_with_lines = width_of_cells + 3 * len(head) + 1 <= width
        fits_without_lines = width_of_cells + len(head) - 1 <= width
        if fits_with_lines and not self.table.plain:
            yield self._build_table(head, column_indices, plain=False)
        elif fits_without_lines:
            yield self._build_table(head, column_indices, plain=True)
        else:
            folded_headers = [_fold_header(header, cell_widths[index]) for index, header in enumerate(head)]
            groups = _distribute_columns(least_widths(folded_headers), width)
            for indices in groups:
                yield self._build_table(
                    folded_headers,
                    indices,
                    plain=True,
                    has_title=indices is groups[0],
                    has_caption=indices is groups[-1],
                )

    def _find_cell_widths(self, column_count: int) -> list[int]:
        """Return the width of the widest cell of each column, headers not counted, in characters."""
        widths = [0] * column_count
        for row in self.table.rows():
            for index, cell in enumerate(row):
                widths[index] = max(widths[index], _text_width(cell.text))
        return widths

    def _build_table(
        self,
        head: Sequence[str],
        indices: Sequence[int],
        *,
        plain: bool,
        has_title: bool = True,
        has_caption: bool = True,
    ) -> RichTable:
        """Return a table of the columns with these indices, with title and caption if the flags say so."""
        table, text_columns = self.table, self.table.text_columns()
        layout_options: dict[str, Any] = {}
        if plain:
            layout_options = {"box": SIMPLE_HEAD, "padding": 0, "show_edge": False}
        title = Text(table.title) if table.title and has_title else None
        caption = Text(table.caption) if table.caption and has_caption else None
        rich_table: RichTable = RichTable(
            title=title, caption=caption, caption_justify="left", **layout_options
        )
        for index in indices:
            is_text = index in text_columns
            rich_table.add_column(
                Text(head[index]),
                justify="left" if is_text else "right",
                overflow="fold",
                max_width=None if table.upright else table.columns[index].widest,
                no_wrap=not is_text,
            )
        for row in table.rows():
            rich_table.add_row(*(_style_line(row[index]) for index in indices))
        return rich_table


def _style_line(line: Line) -> Text:
    """Return the text of a line in the terminal's style for it; the text is not interpreted as markup."""
    return Text(line.text, style=_STYLES[line.style])


def _text_width(text: str) -> int:
    """Return the width of the widest line of a text, in characters of the terminal."""
    return max(map(cell_len, text.split("\n")))


def _fold_header(header: str, width: int) -> str:
    """Fold a header between words to the width of its cells; the unit is put on a separate line."""
    name, bracket, unit = header.partition(" [")
    longest = max(map(cell_len, [*name.split(), bracket.strip() + unit]))
    lines = wrap(name, max(width, longest, 1), break_long_words=False)
    return "\n".join([*lines, f"[{unit}"] if bracket else lines)


def _distribute_columns(widths: Sequence[int], max_width: int) -> list[list[int]]:
    """Distribute columns to groups that fit a width; return the indices of the columns of each group.

    Each group begins with column 0, which names the rows.
    """
    groups = [[0]]
    for index in range(1, len(widths)):
        if sum(widths[column] + 1 for column in groups[-1]) + widths[index] > max_width:
            groups.append([0])
        groups[-1].append(index)
    return groups
