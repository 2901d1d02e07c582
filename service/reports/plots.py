"""Charts and areas of results for a column of a paper, by matplotlib (`pip install "jointstiff[plot]"`)."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from math import isnan, nan
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

import numpy as np

from jointstiff.service.problems import naming_missing_extra
from jointstiff.service.tables.table import Area, Chart
from jointstiff.solver.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    AnyAxes = Axes | Sequence[Axes] | np.ndarray[Any, Any]

COLUMN_WIDTH: Final = 88.0 / 25.4
"""Width of a column of a journal, the default width of a figure [inch]."""
_CHART_HEIGHT: Final = 1.9
_AREA_HEIGHT: Final = 2.9
_FONTS_OF_PAPER: Final = {"font.size": 7.0, "axes.linewidth": 0.6, "hatch.linewidth": 0.5}
_MOST_NAMES: Final = 40
"""Greatest number of places with names below the axis; with more places the axis shows numbers."""
_MOST_LEVEL_CHARACTERS: Final = 60
"""Characters of names, with the spaces between them, that fit below a panel; longer names are turned."""
_NARROW: Final = 5.0
"""Ratio of the ends of a logarithmic axis below which round numbers, not powers, are its ticks."""
_MOST_LEGEND_COLUMNS: Final = 5
_LEVELS: Final = 12  # of the contours of an area
_RESOLUTION: Final = 200  # of pictures in notebooks [dots per inch]
_COLOURS: Final = ("#1b3a5c", "#e08a2e", "#8fc1e3", "#5a8f5a", "#c9c9c9", "#a04545", "#8a5a8f", "#222222")
"""Colours of series; neighbours differ in lightness, so that they differ in grey, too."""
_HATCHES: Final = ("", "", "////", "....", "", "xxxx", "\\\\\\\\", "")
_MARKERS: Final = "os^Dv<>P"


@dataclass(frozen=True)
class PlotStyle:
    """Choices of the caller of `plot`."""

    axes: AnyAxes | None = None  # axes of the caller; None for a new figure
    title: str | None = None  # title above all panels; None for no title
    joints: Iterable[str] | None = None  # names of the joints to draw; None for all
    size: tuple[float, float] | None = None  # width and height of a new figure [inch]
    resolution: float | None = None  # of a new figure [dots per inch]; None for that of matplotlib


_DEFAULT: Final = PlotStyle()


def draw_figure(charts: Sequence[Chart], areas: Sequence[Area] = (), style: PlotStyle = _DEFAULT) -> Figure:
    """Draw areas and charts, one below the other, and return the figure of matplotlib.

    A new figure is as wide as a column of a paper (88 mm), belongs to no window, and is shown by notebooks.

    Raises:
        MissingExtraError: matplotlib is not installed.
        ValueError: there is nothing to draw, there are fewer axes than panels, or no joint has a given name.
    """
    with naming_missing_extra("plot"):
        import matplotlib as mpl
    charts = [_choose_joints(chart, style.joints) for chart in charts]
    if not charts and not areas:
        raise ValueError("the result has no numbers to draw: print the result")
    # Fonts of a paper, whatever the user's settings are; the axes of the user keep theirs.
    fonts = _FONTS_OF_PAPER if style.axes is None else {}
    with mpl.rc_context(fonts):
        axes = _make_axes(len(areas), len(charts), style)
        area_axes, chart_axes = axes[: len(areas)], axes[len(areas) :]
        for axis, area in zip(area_axes, areas, strict=True):
            _draw_area(axis, area)
        for axis, chart in zip(chart_axes, charts, strict=True):
            _draw_chart(axis, chart)
        if style.axes is None:
            _name_once(chart_axes, charts)
        return _title_figure(axes[0], style)


def _title_figure(first_axis: Axes, style: PlotStyle) -> Figure:
    """Return the figure of an axis, with the title of the style: above a new figure, else above the axis."""
    figure = cast("Figure", first_axis.get_figure(root=True))
    if style.title is None:
        return figure
    if style.axes is None:
        figure.suptitle(style.title, fontsize="medium")
    else:
        first_axis.set_title(style.title)
    return figure


def _choose_joints(chart: Chart, names: Iterable[str] | None) -> Chart:
    """Return a chart of joints with the joints of these names only; other charts are unchanged.

    Raises:
        ValueError: the chart has no joint of a name.
    """
    if names is None or chart.axis != "joints":
        return chart
    wanted = [names] if isinstance(names, str) else list(names)
    unknown = [name for name in wanted if name not in chart.names]
    if unknown:
        raise ValueError(f"there is no joint {', '.join(unknown)}: the joints are {', '.join(chart.names)}")
    kept = [list(chart.names).index(name) for name in wanted]
    return replace(
        chart,
        names=[chart.names[i] for i in kept],
        series={name: [values[i] for i in kept] for name, values in chart.series.items()},
        intervals={name: [ends[i] for i in kept] for name, ends in chart.intervals.items()},
    )


def _make_axes(area_count: int, chart_count: int, style: PlotStyle) -> list[Axes]:
    """Return an axis for each panel, areas first: those of the caller, or of a new figure."""
    if style.axes is not None:
        return _list_own_axes(style.axes, area_count + chart_count)
    heights = [_AREA_HEIGHT] * area_count + [_CHART_HEIGHT] * chart_count
    height = _AREA_HEIGHT * area_count + _CHART_HEIGHT * chart_count
    _require_resolution(style.resolution)
    figure = _figure_class()(
        figsize=style.size or (COLUMN_WIDTH, height), dpi=style.resolution, layout="constrained"
    )
    panels = figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights)  # (panels, 1)
    return list(panels[:, 0])


def _require_resolution(resolution: object) -> None:
    """Refuse a resolution that is no positive number.

    Raises:
        ValueError: names the argument `dpi` of the caller.
    """
    is_number = isinstance(resolution, int | float | np.number) and not isinstance(resolution, bool)
    if resolution is not None and not (is_number and 0.0 < float(cast("Any", resolution)) < np.inf):
        raise ValueError(f"`dpi` is {resolution!r}, but must be a number of dots per inch, such as 300")


def _list_own_axes(axes: AnyAxes, count: int) -> list[Axes]:
    """Return the axes of the caller, one axis or an array of any shape, as a list of `count` axes.

    Raises:
        ValueError: these are no axes of matplotlib, or not `count` axes.
    """
    given: list[Axes] = list(np.ravel(np.array(axes, dtype=object)))
    if not all(hasattr(each, "plot") for each in given):
        raise ValueError(
            f"`ax` is {axes!r}, but must be axes of matplotlib: leave it out, or give `ax` from "
            f"plt.subplots({count}); `joints=` chooses joints"
        )
    if len(given) != count:
        raise ValueError(f"the result has {count} panels: give {count} axes, not {len(given)}")
    return given


@cache
def _figure_class() -> type[Figure]:
    """Return a class of figures that notebooks show without pyplot."""
    from matplotlib.figure import Figure as PlainFigure

    class ResultFigure(PlainFigure):
        """Figure without a window, which notebooks show as a picture."""

        def _repr_png_(self) -> bytes:
            """Return the figure as PNG."""
            picture = io.BytesIO()
            self.savefig(picture, format="png", dpi=_RESOLUTION)
            return picture.getvalue()

    return ResultFigure


@dataclass(frozen=True)
class _Series:
    """A series of a chart, ready to draw; all lists have an entry for each place, such as a joint."""

    name: str
    number: int  # place of the series among those of the chart, from 0
    positions: Sequence[float]  # of its bars or dots on the horizontal axis
    heights: Sequence[float]  # in the unit of the chart; NaN where there is no number
    intervals: Sequence[Any] | None  # (lower, upper end) or None of each number; None without intervals
    factor: float  # converts an end of an interval to the unit of the heights
    bar_width: float

    @property
    def look(self) -> dict[str, Any]:
        """Label, colour and error bars, as `Axes.bar` and `Axes.errorbar` take them."""
        colour = _COLOURS[self.number % len(_COLOURS)]
        if self.intervals is None:
            return {"yerr": None, "label": self.name, "color": colour}
        lengths = _error_bar_lengths(self.heights, self.intervals, self.factor)
        return {"yerr": lengths, "label": self.name, "color": colour}


def _draw_chart(axis: Axes, chart: Chart) -> None:
    """Draw a chart with its intervals as groups of bars, or as dots on a logarithmic axis."""
    for series in _list_series(chart):
        if chart.logarithmic:
            _draw_dots(axis, series)
        else:
            _draw_bars(axis, series)
        _mark_open_ends(axis, series.positions, series.heights, series.intervals or ())
    if chart.logarithmic:
        _set_logarithmic(axis)
    _mark_missing(axis, chart)
    _name_places(axis, chart)
    axis.set_ylabel(f"{chart.quantity} [{chart.unit}]" if chart.quantity else chart.unit)
    axis.grid(axis="y", linewidth=0.3, color="0.85")
    axis.set_axisbelow(True)
    _write_title_and_legend(axis, chart)


def _list_series(chart: Chart) -> list[_Series]:
    """Return the series of a chart; the bars of all series at a place are centred at the place."""
    listed = list[_Series]()
    bar_width = 0.8 / max(len(chart.series), 1)
    middle = (len(chart.series) - 1) / 2
    for number, (name, values) in enumerate(chart.series.items()):
        positions = [place + (number - middle) * bar_width for place in range(len(chart.names))]
        heights = [nan if value is None else chart.factor * value for value in values]
        intervals = chart.intervals.get(name)
        listed.append(_Series(name, number, positions, heights, intervals, chart.factor, bar_width))
    return listed


def _draw_dots(axis: Axes, series: _Series) -> None:
    """Draw the numbers of a series as markers, and their intervals as bars with caps."""
    axis.errorbar(
        series.positions,
        series.heights,
        fmt=_MARKERS[series.number % len(_MARKERS)],
        markersize=2.2,
        elinewidth=0.8,
        capsize=4.0,
        capthick=0.8,
        **series.look,
    )


def _draw_bars(axis: Axes, series: _Series) -> None:
    """Draw the numbers of a series as bars, and their intervals as whiskers with a white outline."""
    bars = axis.bar(
        series.positions,
        series.heights,
        series.bar_width,
        capsize=1.5,
        error_kw={"elinewidth": 0.8, "capthick": 0.8, "ecolor": "0.2"},
        hatch=_HATCHES[series.number % len(_HATCHES)],
        edgecolor="0.2",
        linewidth=0.3,
        **series.look,
    )
    _outline_whiskers(bars)


def _set_logarithmic(axis: Axes) -> None:
    """Make the vertical axis logarithmic, with ticks at 1, 2 and 5, or at round numbers on a narrow axis."""
    from matplotlib.ticker import AutoLocator, LogLocator

    axis.set_yscale("log")
    low, high = axis.get_ylim()
    is_narrow = high < _NARROW * low
    axis.yaxis.set_major_locator(AutoLocator() if is_narrow else LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_formatter("")


def _name_places(axis: Axes, chart: Chart) -> None:
    """Write the names of the places, such as joints, below the axis, unless there are too many names."""
    count = len(chart.names)
    if count <= _MOST_NAMES:
        axis.set_xticks(list(range(count)), chart.names, rotation=90 if _is_turned(chart) else 0)
    axis.set_xlim(-0.6, count - 0.4)
    axis.set_xlabel(chart.axis)


def _write_title_and_legend(axis: Axes, chart: Chart) -> None:
    """Write the title above the axis, and, for several series, the legend between the axis and the title."""
    has_legend = len(chart.series) > 1
    axis.set_title(chart.title, fontsize="medium", pad=17.0 if has_legend else 5.0)
    if not has_legend:
        return
    axis.legend(
        loc="lower center",
        bbox_to_anchor=(0.5, 0.97),
        ncols=min(len(chart.series), _MOST_LEGEND_COLUMNS),
        fontsize="small",
        handlelength=1.2,
        columnspacing=1.0,
        frameon=False,
    )


def _is_turned(chart: Chart) -> bool:
    """Return whether the names of a chart's places are too long to be level."""
    return sum(len(name) + 2 for name in chart.names) > _MOST_LEVEL_CHARACTERS


def _name_once(axes: Sequence[Axes], charts: Sequence[Chart]) -> None:
    """Remove turned names of places that are below the next panel, too."""
    for axis, (chart, following) in zip(axes, pairwise(charts), strict=False):
        if _is_turned(chart) and (chart.axis, chart.names) == (following.axis, following.names):
            axis.tick_params(labelbottom=False)
            axis.set_xlabel("")


def _mark_open_ends(
    axis: Axes, positions: Sequence[float], heights: Sequence[float], intervals: Sequence[Any]
) -> None:
    """Draw an arrow upwards from each number whose interval has no upper end."""
    for position, height, interval in zip(positions, heights, intervals, strict=False):
        if interval is not None and interval[1] is None and not isnan(height):
            arrow = {"arrowstyle": "<-", "linewidth": 0.8}  # the head is at the end of the text
            axis.annotate("", (position, height), (0, 14), "data", "offset points", arrow)


def _outline_whiskers(bars: Any) -> None:  # noqa: ANN401 - a container of bars of matplotlib
    """Draw a white line around the whiskers of bars, so that they are seen on dark bars, in grey, too."""
    from matplotlib.patheffects import withStroke

    if bars.errorbar is not None:
        _, caps, lines = bars.errorbar.lines
        for each in (*caps, *lines):
            each.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def _mark_missing(axis: Axes, chart: Chart) -> None:
    """Write *no number* at places, such as joints, where no series has a number."""
    for place in range(len(chart.names)):
        if all(values[place] is None for values in chart.series.values()):
            where = axis.get_xaxis_transform()  # x in data, y as a fraction of the axis
            axis.text(
                place, 0.04, "no number", rotation=90, ha="center", va="bottom", transform=where, color="0.4"
            )


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


def _draw_area(axis: Axes, area: Area) -> None:
    """Draw an area seen from above, with a colour bar: an area of places [x, y] with a number for each."""
    axis.figure.colorbar(_draw_places(axis, area), ax=axis, label=area.names[2])
    axis.set_xlabel(area.names[0])
    axis.set_ylabel(area.names[1])
    axis.set_title(area.title, fontsize="medium")
    axis.set_aspect("equal")


def _draw_places(axis: Axes, area: Area) -> Any:  # noqa: ANN401 - of matplotlib, without types
    """Draw the places of an area, and return what the colour bar explains.

    A grid of two rows and columns at least is drawn as filled contours, other places as squares; places
    without a number as crosses.
    """
    x, y = np.array(area.x, dtype=float), np.array(area.y, dtype=float)
    values = area.factor * np.array(area.values, dtype=float)
    known = ~np.isnan(values)
    grid = _AreaGrid.from_places(x, y, values)
    if grid is not None and known.any():
        drawn = _draw_contours(axis, grid)
    else:
        drawn = axis.scatter(x[known], y[known], c=values[known], marker="s", cmap="viridis")
    if not known.all():
        axis.scatter(x[~known], y[~known], c="0.4", marker="x", s=10, linewidths=0.6)
    return drawn


class _AreaGrid(NamedTuple):
    """Values on a rectangular grid, NaN where there is no number."""

    columns: FloatArray  # (C,) x of each column, ascending
    rows: FloatArray  # (R,) y of each row, ascending
    values: FloatArray  # (R, C)

    @classmethod
    def from_places(cls, x: FloatArray, y: FloatArray, values: FloatArray) -> _AreaGrid | None:
        """Return the grid of places (N,); None unless they fill two rows and two columns at least."""
        columns, rows = np.unique(x), np.unique(y)
        has_two_each_way = min(len(columns), len(rows)) >= 2
        if not has_two_each_way or len(columns) * len(rows) != len(values):
            return None
        grid = np.full((len(rows), len(columns)), nan)
        grid[np.searchsorted(rows, y), np.searchsorted(columns, x)] = values
        return cls(columns, rows, grid)


def _draw_contours(axis: Axes, grid: _AreaGrid) -> Any:  # noqa: ANN401 - a set of contours of matplotlib
    """Draw filled contours with white lines between them, and return them for a colour bar."""
    shown = np.ma.masked_invalid(grid.values)
    filled = axis.contourf(grid.columns, grid.rows, shown, _LEVELS, cmap="viridis")
    axis.contour(grid.columns, grid.rows, shown, _LEVELS, colors="white", linewidths=0.3)
    return filled
