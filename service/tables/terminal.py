"""The terminal that reports are printed on: console, errors, and the bar of progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar
from rich.text import Text

from jointstiff.schemas.job import Progress
from jointstiff.schemas.problem import Problem

METHOD_NAMES: Final = {
    "complete_pose": "complete pose",
    "partial_pose": "partial pose",
    "decoupled_partial_pose": "decoupled partial pose",
}
_NARROWEST = 80


def console(*, stderr: bool = False) -> Console:
    """Return a console that does not colour numbers by itself."""
    found = Console(stderr=stderr, highlight=False)
    # Numbers that a narrow terminal cuts short mislead; wrapped lines do not.
    return Console(stderr=stderr, highlight=False, width=max(found.width, _NARROWEST))


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
    """Lay out an error: what, where, and how to mend it."""
    if len(problem.errors) > 1:
        lines = [
            f"{item.where}: {item.reason}" + (f"; {item.remedy}" if item.remedy else "")
            for item in problem.errors
        ]
        return Text("\n".join([problem.title, *(f"  {line}" for line in lines)]), style="red")
    place = f"{problem.where}: " if problem.where else ""
    detail = problem.errors[0].reason if problem.errors else problem.detail
    remedy = f"\n  remedy: {problem.remedy}" if problem.remedy else ""
    return Text(f"{place}{detail}{remedy}", style="red")
