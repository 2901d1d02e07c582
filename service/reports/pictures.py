"""Pictures of a run as SVG: intervals, deflection without and with the model, and the arm."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, hypot, log10
from xml.etree import ElementTree

import numpy as np

from jointstiff.schemas.run import JointResult, RunResult
from jointstiff.service.conversion.robots import to_postures
from jointstiff.service.reports.document import Picture
from jointstiff.service.tables.table import Chart
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.robot import Robot

INK, PALE, LINE, MARK = "#222222", "#b9c6d3", "#8a8a8a", "#1f5f8b"
_FONT = "Libertinus Serif, Georgia, serif"


class Drawing:
    """A drawing as SVG; coordinates in points, y points down."""

    def __init__(self, width: float, height: float, title: str) -> None:
        """Begin an empty drawing of a size [points]; the title is for screen readers."""
        box = f"0 0 {width:g} {height:g}"
        attributes = {"xmlns": "http://www.w3.org/2000/svg", "viewBox": box, "role": "img"}
        self._root = ElementTree.Element("svg", attributes)
        ElementTree.SubElement(self._root, "title").text = title

    def line(
        self,
        x1: float,
        y1: float,
        x2: float,
        y2: float,
        colour: str = LINE,
        width: float = 0.6,
    ) -> None:
        """Draw a straight line between two points."""
        self._add("line", x1=x1, y1=y1, x2=x2, y2=y2, stroke=colour, stroke_width=width)

    def path(self, points: Iterable[tuple[float, float]], colour: str = INK, width: float = 2.0) -> None:
        """Draw a polyline through points."""
        places = " ".join(f"{x:.2f},{y:.2f}" for x, y in points)
        self._add(
            "polyline", points=places, fill="none", stroke=colour, stroke_width=width, stroke_linejoin="round"
        )

    def bar(self, x: float, y: float, width: float, height: float, colour: str = PALE) -> None:
        """Draw a filled rectangle; (x, y) is its upper left corner."""
        self._add("rect", x=x, y=y, width=max(width, 0.0), height=max(height, 0.0), fill=colour)

    def dot(self, x: float, y: float, radius: float = 2.4, colour: str = MARK) -> None:
        """Draw a filled circle."""
        self._add("circle", cx=x, cy=y, r=radius, fill=colour)

    def text(self, x: float, y: float, text: str, size: float = 8.0, anchor: str = "start") -> None:
        """Write a line of text at a point."""
        element = self._add("text", x=x, y=y, fill=INK, font_size=size, font_family=_FONT, text_anchor=anchor)
        element.text = text

    def __str__(self) -> str:
        return ElementTree.tostring(self._root, encoding="unicode")

    def _add(self, tag: str, **attributes: float | str) -> ElementTree.Element:
        """Append an SVG element; an underscore in the name of an attribute becomes a hyphen."""
        written = {
            name.replace("_", "-"): value if isinstance(value, str) else f"{value:.2f}"
            for name, value in attributes.items()
        }
        return ElementTree.SubElement(self._root, tag, written)


_WIDTH = 480.0
# Lengths in points.
_AXIS_Y, _AXIS_X = 128.0, 40.0  # y of the horizontal axis and x of the vertical axis of bar charts
_ROW_HEIGHT = 17.0
_NAMES_WIDTH = 90.0  # of the column of joint names
_MOST_GROUPS = 60  # groups of bars in a bar chart
_BARS_HEIGHT, _LEGEND_Y = 166.0, 154.0  # height of a bar chart, and top of its legend [points]
_TOP_MARGIN, _RIGHT_MARGIN = 12, 6  # margins of the area of the bars [points]
_BARS_SHARE = 0.8  # part of a group's width that its bars fill
_BARS_PAGE_WIDTH = 0.8  # share of the text's width
_SERIES_COLOURS = (PALE, MARK, "#d08a2e", "#5a8f5a", "#8a5a8f", "#a04545", "#4a4a4a", "#c9b458")
_LABEL_DISTANCE = 12.0
"""Least distance of two joints in the picture with separate labels; nearer joints share one [points]."""


@dataclass(frozen=True)
class _DecadeAxis:
    """Horizontal logarithmic axis of whole decades; coordinates in points."""

    lowest: int  # exponent of ten at the left end
    highest: int  # exponent of ten at the right end
    left: float = _NAMES_WIDTH
    right: float = _WIDTH - 20

    @classmethod
    def around(cls, values: Sequence[float]) -> _DecadeAxis:
        """Return the shortest axis that covers all values, one decade at least: 30, 200 → 10¹ to 10³."""
        lowest = floor(log10(min(values)))
        highest = ceil(log10(max(values)))
        return cls(lowest, max(highest, lowest + 1))

    def find_x(self, value: float) -> float:
        """Return the x coordinate of a value; values beyond an end of the axis are at that end."""
        value_on_axis = min(max(value, 10.0**self.lowest), 10.0**self.highest)
        decades_from_left = log10(value_on_axis) - self.lowest
        fraction = decades_from_left / (self.highest - self.lowest)
        return self.left + fraction * (self.right - self.left)


def draw_intervals(joints: Sequence[JointResult], confidence: float) -> Picture | None:
    """Draw the stiffness of each joint with its interval on a logarithmic axis, one row for each joint.

    Return None if no joint has a positive stiffness.
    """
    values = _list_drawn_stiffnesses(joints)
    if not values:
        return None
    axis = _DecadeAxis.around(values)
    height = _ROW_HEIGHT * (len(joints) + 1) + 22
    drawing = Drawing(_WIDTH, height, "Stiffness of each joint with its interval")
    _draw_decades(drawing, axis, bottom=height - 24)
    for row, joint in enumerate(joints):
        _draw_interval(drawing, axis, joint, y=_ROW_HEIGHT * (row + 0.9))
    return Picture(
        str(drawing),
        f"Stiffness of each joint (dot) with its {100 * confidence:g} % interval (bar between ticks; without "
        "a right tick: no upper limit). Logarithmic axis.",
        0.8,
    )


def _list_drawn_stiffnesses(joints: Sequence[JointResult]) -> list[float]:
    """Return the positive stiffnesses of joints and the positive ends of their intervals [N·m/rad]."""
    values = list[float]()
    for joint in joints:
        if joint.stiffness is None or joint.stiffness <= 0.0:
            continue
        values.append(joint.stiffness)
        values += [end for end in joint.stiffness_interval or () if end is not None and end > 0.0]
    return values


def _draw_decades(drawing: Drawing, axis: _DecadeAxis, bottom: float) -> None:
    """Draw a vertical line with its number at each power of ten, and the unit below: 10⁶ N·m/rad."""
    for decade in range(axis.lowest, axis.highest + 1):
        x = axis.find_x(10.0**decade)
        number = 10.0 ** (decade - 6)
        drawing.line(x, 4, x, bottom)
        drawing.text(x, bottom + 10, f"{number:g}", anchor="middle")
    drawing.text(axis.right, bottom + 21, "stiffness [10⁶ N·m/rad]", anchor="end")


def _draw_interval(drawing: Drawing, axis: _DecadeAxis, joint: JointResult, y: float) -> None:
    """Draw the row of a joint: name, dot at its stiffness, bar over its interval with a tick at each end.

    A bar without an upper limit reaches the right end of the axis and has no tick there.
    """
    drawing.text(0, y + 3, _shorten(joint.name))
    if joint.stiffness is None or joint.stiffness <= 0.0:
        drawing.text(_NAMES_WIDTH + 4, y + 3, "no number: see the table")
        return
    lower_end, upper_end = joint.stiffness_interval or (joint.stiffness, joint.stiffness)
    left = axis.find_x(lower_end)
    right = axis.right if upper_end is None else axis.find_x(upper_end)
    drawing.line(left, y, right, y, MARK, 2.2)
    drawing.line(left, y - 5, left, y + 5, MARK, 0.8)
    if upper_end is not None:
        drawing.line(right, y - 5, right, y + 5, MARK, 0.8)
    drawing.dot(axis.find_x(joint.stiffness), y, 1.5)


@dataclass(frozen=True)
class _BarGrid:
    """Places of grouped bars: one group for each place of a chart, one bar in it for each series [points]."""

    groups: int
    series: int
    width: float = _WIDTH - _AXIS_X - _RIGHT_MARGIN  # of all groups

    @property
    def bar_width(self) -> float:
        """Width of a bar; all bars of a group fill `_BARS_SHARE` of its width."""
        return _BARS_SHARE * self._group_width / max(self.series, 1)

    @property
    def _group_width(self) -> float:
        return self.width / max(self.groups, 1)

    def find_left(self, group: int, series: int) -> float:
        """Return the x coordinate of the left edge of a bar."""
        gap = (1 - _BARS_SHARE) / 2  # on either side of a group, in widths of a group
        return _AXIS_X + self._group_width * (group + gap) + self.bar_width * series


def draw_bars(chart: Chart) -> Picture:
    """Draw a chart as groups of bars, one bar for each series, of at most the first 60 groups.

    The heights of the bars are the absolute values of the numbers.
    """
    group_count = min(len(chart.names), _MOST_GROUPS)
    series = _scale_first_numbers(chart, group_count)
    axis_end = _choose_axis_end(_find_greatest_size(series.values()))
    drawing = Drawing(_WIDTH, _BARS_HEIGHT, chart.title)
    _draw_value_axis(drawing, axis_end)
    drawing.text(0, 8, chart.unit)
    axis_label = f"{chart.axis} 1 to {group_count} of {len(chart.names)}"
    drawing.text(_WIDTH - _RIGHT_MARGIN, _AXIS_Y + 12, axis_label, anchor="end")
    grid = _BarGrid(group_count, len(series))
    points_per_unit = (_AXIS_Y - _TOP_MARGIN) / axis_end
    for index, (name, values) in enumerate(series.items()):
        heights = [points_per_unit * abs(value) for value in values]
        _draw_series(drawing, grid, index, heights)
        _draw_legend_entry(drawing, grid, index, name)
    return Picture(str(drawing), f"{chart.title}.", _BARS_PAGE_WIDTH)


def _scale_first_numbers(chart: Chart, count: int) -> dict[str, list[float]]:
    """Return series → its first `count` numbers in the unit of the chart; a missing number is 0."""
    series = dict[str, list[float]]()
    for name, numbers in chart.series.items():
        series[name] = [chart.factor * (number or 0.0) for number in list(numbers)[:count]]
    return series


def _find_greatest_size(series: Iterable[Sequence[float]]) -> float:
    """Return the greatest absolute value of all series, or 1 if there is none but zero."""
    sizes = [abs(value) for values in series for value in values]
    return max(sizes, default=0.0) or 1.0


def _draw_value_axis(drawing: Drawing, axis_end: float) -> None:
    """Draw horizontal lines with their numbers at zero, at half and at the whole of `axis_end`."""
    for fraction in (0.0, 0.5, 1.0):
        y = _AXIS_Y - fraction * (_AXIS_Y - _TOP_MARGIN)
        drawing.line(_AXIS_X, y, _WIDTH - _RIGHT_MARGIN, y)
        drawing.text(_AXIS_X - 4, y + 3, f"{fraction * axis_end:g}", anchor="end")


def _draw_series(drawing: Drawing, grid: _BarGrid, index: int, heights: Sequence[float]) -> None:
    """Draw the bars of a series, one in each group, up from the axis; `heights` are in points."""
    for group, height in enumerate(heights):
        x = grid.find_left(group, index)
        drawing.bar(x, _AXIS_Y - height, grid.bar_width, height, _choose_colour(index))


def _draw_legend_entry(drawing: Drawing, grid: _BarGrid, index: int, name: str) -> None:
    """Draw a square in the colour of a series with its name; all entries share the width of the groups."""
    x = _AXIS_X + grid.width * index / grid.series
    drawing.bar(x, _LEGEND_Y, 7, 7, _choose_colour(index))
    drawing.text(x + 10, _LEGEND_Y + 7, _shorten(name))


def _choose_colour(index: int) -> str:
    """Return the colour of a series; colours repeat after the last one."""
    return _SERIES_COLOURS[index % len(_SERIES_COLOURS)]


def _choose_axis_end(greatest: float) -> float:
    """Return the number at the end of an axis: 1, 2, 5 or 10 times a power of ten, not below `greatest`."""
    power_of_ten = 10.0 ** floor(log10(greatest))
    for factor in (1.0, 2.0, 5.0):
        end = factor * power_of_ten
        if end >= greatest * (1 - 1e-9):  # allows for rounding
            return end
    return 10.0 * power_of_ten


def draw_deflections(result: RunResult) -> Picture | None:
    """Draw the mean lengths of deflection and residual for each observation; None without deflections."""
    measured, residual = result.mean_lengths("deflection"), result.mean_lengths("residual")
    if not any(measured.values()):
        return None
    series = {"measured": [*measured.values()], "residual": [*residual.values()]}
    return draw_bars(
        Chart(
            "Deflection before and after compensation, mean length over the targets",
            [*measured],
            series,
            1e3,
            "mm",
        )
    )


@dataclass(frozen=True)
class _Frame:
    """Scale and place of projected points (2,), right and up [m], in a drawing [points], y down."""

    lower_corner: FloatArray  # (2,) least coordinates of all points
    scale: float  # points for a metre

    @classmethod
    def around(cls, points: FloatArray) -> _Frame:
        """Return the frame in which points (N, 2) fill 200 × 170 points at most."""
        extent = np.ptp(points, axis=0)
        return cls(points.min(axis=0), min(200.0 / extent[0], 170.0 / extent[1]))

    def place(self, point: FloatArray) -> tuple[float, float]:
        """Return the coordinates of a projected point in the drawing."""
        x, y = (point - self.lower_corner) * self.scale
        return 20 + float(x), 185 - float(y)


@dataclass(frozen=True)
class _Label:
    """Text next to a point of a drawing."""

    x: float
    y: float
    text: str

    def is_near(self, x: float, y: float) -> bool:
        """Return whether a point is so near that its text would cover this one."""
        return hypot(x - self.x, y - self.y) < _LABEL_DISTANCE


def draw_arm(robot: Robot, joints: Sequence[float]) -> Picture | None:
    """Draw the arm in a posture, seen obliquely; return None for an arm without extent.

    `joints` are joint values of the controller [rad or m].
    """
    posture = to_postures(robot, [list(joints)])[0]
    points = np.array([[0.0, 0.0, 0.0], *posture.joint_origins, posture.flange_origin])
    reach = float(np.ptp(points, axis=0).max())
    if not reach > 0.0:
        return None
    arm = _project(points)  # base, joints, flange
    axis_ends = _project(np.vstack([np.zeros(3), 0.25 * reach * np.eye(3)]))  # origin, then x, y, z of R0
    frame = _Frame.around(np.vstack([arm, axis_ends]))
    drawing = Drawing(260, 200, "The arm in the posture of the first observation")
    _draw_base_axes(drawing, [frame.place(point) for point in axis_ends])
    places = [frame.place(point) for point in arm]
    drawing.path(places, INK, 2.4)
    _draw_numbered_joints(drawing, places[1:-1])
    return Picture(
        str(drawing),
        "The item in the posture of the first observation: joints numbered from the base, flange at the end, "
        "axes of the base frame R0.",
        0.4,
    )


def _draw_base_axes(drawing: Drawing, places: Sequence[tuple[float, float]]) -> None:
    """Draw the axes x, y and z with their names, from the origin `places[0]` to the ends in `places[1:]`."""
    origin, *ends = places
    for end, name in zip(ends, "xyz", strict=True):
        drawing.line(*origin, *end, MARK, 0.8)
        drawing.text(*end, name)


def _draw_numbered_joints(drawing: Drawing, places: Sequence[tuple[float, float]]) -> None:
    """Draw a dot at each joint, and its number; joints that nearly coincide share a label: "4, 6"."""
    labels = list[_Label]()
    for number, place in enumerate(places, 1):
        drawing.dot(*place)
        labels = _add_number(labels, number, *place)
    for label in labels:
        drawing.text(label.x + 4, label.y - 3, label.text, 7.0)


def _add_number(labels: Sequence[_Label], number: int, x: float, y: float) -> list[_Label]:
    """Return labels with the number of a joint at (x, y) added, to a label that is near or as a new one."""
    extended = list(labels)
    for index, label in enumerate(labels):
        if label.is_near(x, y):
            extended[index] = replace(label, text=f"{label.text}, {number}")
            return extended
    return [*extended, _Label(x, y, str(number))]


def _project(points: FloatArray) -> FloatArray:
    """Project points (N, 3) on a plane seen from direction (1, -1.6, 0.8); return (N, 2): right and up."""
    towards = np.array([1.0, -1.6, 0.8]) / np.linalg.norm([1.0, -1.6, 0.8])
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    projected: FloatArray = points @ np.stack([right, np.cross(towards, right)], axis=1)
    return projected


def _shorten(name: str) -> str:
    """Cut a name to 18 characters."""
    return name if len(name) <= 18 else f"{name[:17]}…"
