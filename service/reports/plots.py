"""Charts and areas of results, drawn by matplotlib (`pip install "jointstiff[plot]"`)."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from textwrap import fill
from typing import TYPE_CHECKING, Any

from jointstiff.service.problems import explain_missing_library
from jointstiff.service.tables.table import Area, Chart

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_NAMES = 40
"""Greatest number of places with names below the axis; with more places the axis shows numbers."""
_TITLE_WIDTH = 90
"""Greatest number of characters in a line of the title."""


def draw_figure(title: str, charts: Sequence[Chart], areas: Sequence[Area] = ()) -> Figure:
    """Draw areas and charts, one below the other, and return the figure of matplotlib.

    Raises:
        MissingExtraError: matplotlib is not installed.
        ValueError: there is nothing to draw.
    """
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise explain_missing_library("plot", error) from None

    count = len(charts) + len(areas)
    if not count:
        raise ValueError("the result has no numbers to draw: print it")
    figure: Figure
    figure, grid = plt.subplots(count, 1, figsize=(8.0, 3.2 * count), layout="constrained", squeeze=False)
    figure.suptitle(fill(title, _TITLE_WIDTH), fontsize="medium")
    axes = list(grid[:, 0])
    for axis, area in zip(axes, areas, strict=False):
        _draw_area(figure, axis, area)
    for axis, chart in zip(axes[len(areas) :], charts, strict=True):
        _draw_chart(axis, chart)
    return figure


def _draw_chart(axis: Axes, chart: Chart) -> None:
    """Draw a chart as bars side by side, or as dots on a logarithmic axis, with its intervals if any."""
    count, series = len(chart.names), chart.series
    places, bar_width = range(count), 0.8 / max(len(series), 1)
    for number, (name, values) in enumerate(series.items()):
        # The bars of a place are centred at the place.
        positions = [place + (number - (len(series) - 1) / 2) * bar_width for place in places]
        heights = [nan if value is None else chart.factor * value for value in values]
        intervals = chart.intervals.get(name)
        error_bars = None if intervals is None else _error_bar_lengths(heights, intervals, chart.factor)
        if chart.logarithmic:
            axis.errorbar(positions, heights, yerr=error_bars, fmt="o", capsize=3, label=name)
        else:
            axis.bar(positions, heights, bar_width, yerr=error_bars, capsize=3, label=name)
    if chart.logarithmic:
        axis.set_yscale("log")
    if count <= _MOST_NAMES:
        axis.set_xticks(list(places), chart.names, rotation=90 if count > 8 else 0, fontsize="small")
    axis.set_xlabel(chart.axis)
    axis.set_ylabel(chart.unit)
    axis.set_title(chart.title, fontsize="medium")
    if len(series) > 1:
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small")  # at the side of the bars


def _error_bar_lengths(
    heights: Sequence[float], intervals: Sequence[Any], factor: float
) -> list[list[float]]:
    """Return (lengths of error bars below, above) the heights; zero where an interval has no limit.

    `factor` converts the limits of the intervals to the unit of the heights.
    """
    # Bars that are not drawn have the height NaN; only NaN differs from itself.
    below, above = [], []
    for height, interval in zip(heights, intervals, strict=True):
        low, high = interval or (None, None)
        below.append(0.0 if low is None or height != height else max(height - factor * low, 0.0))
        above.append(0.0 if high is None or height != height else max(factor * high - height, 0.0))
    return [below, above]


def _draw_area(figure: Figure, axis: Axes, area: Area) -> None:
    """Draw an area seen from above: a square for each place, coloured by value; a cross where it is NaN."""
    values = [area.factor * value for value in area.values]
    known = [i for i, value in enumerate(values) if value == value]  # NaN is not equal to NaN
    unknown = [i for i, value in enumerate(values) if value != value]
    dots = axis.scatter(
        [area.x[i] for i in known], [area.y[i] for i in known], c=[values[i] for i in known], marker="s"
    )
    axis.scatter([area.x[i] for i in unknown], [area.y[i] for i in unknown], c="0.7", marker="x")
    figure.colorbar(dots, ax=axis, label=area.names[2])
    axis.set_xlabel(area.names[0])
    axis.set_ylabel(area.names[1])
    axis.set_title(area.title, fontsize="medium")
    axis.set_aspect("equal")
