"""Report of a benchmark: a table for people, numbers for programs, required figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from rich.console import Console
from rich.table import Table

from benchmarks.timing import Times

__all__ = ["Figure", "Part", "Section", "print_figures", "print_section", "seconds_text", "times_table"]


@dataclass(frozen=True)
class Part:
    """A part of a study that takes long: the k-th of n."""

    number: int = 1
    count: int = 1

    def of(self, total: int) -> range:
        """Return the cases of this part, of a total that all parts share out."""
        return range(total * (self.number - 1) // self.count, total * self.number // self.count)


@dataclass(frozen=True)
class Figure:
    """A number that is asked for beside the one that was measured."""

    what: str  # is measured, against what
    measured: float
    relation: Literal["at least", "at most"]
    required: float
    unit: str = ""  # of both numbers

    @classmethod
    def none(cls, what: str, count: int) -> Figure:
        """Count what should not be."""
        return cls(what, count, "at most", 0)

    @property
    def met(self) -> bool:
        """Return True if the figure lies in its range."""
        if self.relation == "at least":
            return self.measured >= self.required
        return self.measured <= self.required


@dataclass(frozen=True)
class Section:
    """The outcome of one benchmark."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    figures: tuple[Figure, ...] = ()
    notes: tuple[str, ...] = ()  # that a reader needs to judge the numbers
    data: dict[str, Any] = field(default_factory=dict)  # numbers behind the cells


def times_table(
    times: Times, ours: str, extra: Sequence[tuple[str, dict[str, str]]] = ()
) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Columns and rows of a comparison; a ratio above 1 means slower than ours.

    Args:
        times: of all candidates.
        ours: which candidate they are compared with.
        extra: further columns, each with its cells by candidate.

    Returns:
        Columns and rows.
    """
    columns = ("candidate", "time / ours", "middle half", "median", *(title for title, _ in extra))
    rows = []
    for name in times.seconds:
        spread = times.spread(name, ours)
        middle = "" if spread is None else f"{spread[0]:.2f} … {spread[1]:.2f}"
        cells = [cells.get(name, "") for _, cells in extra]
        ratio = f"{times.ratio(name, ours):.2f}"
        rows.append((name, ratio, middle, seconds_text(times.median(name)), *cells))
    return columns, tuple(rows)


def seconds_text(seconds: float) -> str:
    """A time in a unit that suits it."""
    return f"{seconds:.2f} s" if seconds >= 1.0 else f"{1e3 * seconds:.2f} ms"


def print_section(console: Console, section: Section) -> None:
    """Print table and notes."""
    table = Table(title=section.title, title_justify="left", title_style="bold")
    for number, column in enumerate(section.columns):
        table.add_column(column, justify="right" if number else "left")
    for row in section.rows:
        table.add_row(*row)
    console.print(table)
    for note in section.notes:
        console.print(f"  {note}", style="dim", highlight=False)
    console.print()


def print_figures(console: Console, figures: Sequence[Figure], *, judged: bool) -> None:
    """Print the figures that were asked for beside the measured ones.

    Args:
        console: where to.
        figures: of all sections.
        judged: False for sizes that the figures are not about.
    """
    table = Table(title="Figures", title_justify="left", title_style="bold")
    for number, column in enumerate(("what", "required", "measured", "")):
        table.add_column(column, justify="right" if number in {1, 2} else "left")
    for figure in figures:
        sign = "≥" if figure.relation == "at least" else "≤"
        verdict = ("[green]met[/]" if figure.met else "[red]NOT met[/]") if judged else "not judged"
        required, measured = f"{figure.required:g}{figure.unit}", f"{figure.measured:.3g}{figure.unit}"
        table.add_row(figure.what, f"{sign} {required}", measured, verdict)
    console.print(table)
