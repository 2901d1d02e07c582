"""The terminal that parts are printed on: console, tables, errors, and the bar of progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar
from rich.table import Table as RichTable
from rich.text import Text

from jointstiff.schemas.job import Progress
from jointstiff.schemas.problem import Problem
from jointstiff.service.tables.table import Line, Part, Table
from jointstiff.service.tables.verdict import problem_line

METHOD_NAMES: Final = {
    "complete_pose": "complete pose",
    "partial_pose": "partial pose",
    "decoupled_partial_pose": "decoupled partial pose",
}
_NARROWEST = 80
_FEW_COLUMNS: Final = 6  # of a table without lines; with more, units stand in a second line of the head
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
    """Return a console that does not colour numbers by itself."""
    output = Console(stderr=stderr, highlight=False)
    # Numbers that a narrow terminal cuts short mislead; wrapped lines do not.
    return Console(stderr=stderr, highlight=False, width=max(output.width, _NARROWEST))


@contextmanager
def progress_bar(*, shown: bool) -> Iterator[Callable[[Progress], None]]:
    """Show a bar on the standard error, with the time left; none where nothing takes long."""
    if not shown:
        yield lambda _: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with ProgressBar(*columns, console=console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda progress: bar.update(
            task, description=progress.activity, total=progress.total, completed=progress.done
        )


def problem_text(problem: Problem) -> Text:
    """Lay out an error for the terminal."""
    return _text(problem_line(problem))


def printed(parts: Sequence[Part]) -> RenderableType:
    """Lay out parts for the terminal; text is never taken for markup."""
    return Group(*(_text(part) if isinstance(part, Line) else _rich_table(part) for part in parts))


def _text(line: Line) -> Text:
    return Text(line.text, style=_STYLES[line.style])


def _rich_table(table: Table) -> RichTable:
    layout: dict[str, Any] = {"box": SIMPLE_HEAD, "padding": 0, "show_edge": False} if table.plain else {}
    rich: RichTable = RichTable(
        title=Text(table.title) if table.title else None,
        caption=Text(table.caption) if table.caption else None,
        caption_justify="left",
        **layout,
    )
    texts = table.text_columns()
    many = table.plain and len(table.columns) > _FEW_COLUMNS
    for place, header in enumerate(table.head()):
        widest = None if table.upright else table.columns[place].widest
        rich.add_column(
            Text(header.replace(" [", "\n[") if many else header),
            justify="left" if place in texts else "right",
            overflow="fold",
            max_width=widest,
            no_wrap=table.plain and place not in texts,  # names are folded before numbers
        )
    for row in table.rows():
        rich.add_row(*map(_text, row))
    return rich
