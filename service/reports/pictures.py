"""Pictures of a run as SVG: intervals, deflection without and with the model, and the arm."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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


def draw_intervals(joints: Sequence[JointResult], confidence: float) -> Picture | None:
    """Draw the stiffness of each joint with its interval on a logarithmic axis.

    Return None if no joint has a positive stiffness.
    """
    drawn_joints = [joint for joint in joints if joint.stiffness is not None and joint.stiffness > 0.0]
    values = [joint.stiffness or 0.0 for joint in drawn_joints]
    for joint in drawn_joints:
        values += [end for end in joint.stiffness_interval or () if end is not None and end > 0.0]
    if not values:
        return None
    # Exponents of ten at the ends of the axis, which covers one decade at least.
    lowest_decade, highest_decade = floor(log10(min(values))), ceil(log10(max(values)))
    highest_decade = max(highest_decade, lowest_decade + 1)
    height = _ROW_HEIGHT * (len(joints) + 1) + 22
    drawing = Drawing(_WIDTH, height, "Stiffness of each joint with its interval")

    def x_of(value: float) -> float:
        """Return the x coordinate of a stiffness on the logarithmic axis."""
        value_on_axis = min(max(value, 10.0**lowest_decade), 10.0**highest_decade)
        decades_from_left = log10(value_on_axis) - lowest_decade
        fraction = decades_from_left / (highest_decade - lowest_decade)
        return _NAMES_WIDTH + fraction * (_WIDTH - _NAMES_WIDTH - 20)

    bottom = height - 24
    for decade in range(lowest_decade, highest_decade + 1):
        x = x_of(10.0**decade)
        number = 10.0 ** (decade - 6)  # in 10⁶ N·m/rad
        drawing.line(x, 4, x, bottom)
        drawing.text(x, bottom + 10, f"{number:g}", anchor="middle")
    drawing.text(_WIDTH - 20, bottom + 21, "stiffness [10⁶ N·m/rad]", anchor="end")
    for row, joint in enumerate(joints):
        y = _ROW_HEIGHT * (row + 0.9)
        drawing.text(0, y + 3, _shorten(joint.name))
        if joint not in drawn_joints or joint.stiffness is None:
            drawing.text(_NAMES_WIDTH + 4, y + 3, "no number: see the table")
            continue
        lower_end, upper_end = joint.stiffness_interval or (joint.stiffness, joint.stiffness)
        left = x_of(lower_end)
        right = _WIDTH - 20 if upper_end is None else x_of(upper_end)
        ticks = [left] if upper_end is None else [left, right]  # no right tick: no upper limit
        drawing.line(left, y, right, y, MARK, 2.2)
        for tick in ticks:
            drawing.line(tick, y - 5, tick, y + 5, MARK, 0.8)
        drawing.dot(x_of(joint.stiffness), y, 1.5)
    return Picture(
        str(drawing),
        f"Stiffness of each joint (dot) with its {100 * confidence:g} % interval (bar between ticks; without "
        "a right tick: no upper limit). Logarithmic axis.",
        0.8,
    )


def draw_bars(chart: Chart) -> Picture:
    """Draw a chart as groups of bars, one bar for each series, of at most the first 60 groups.

    The heights of the bars are the absolute values of the numbers.
    """
    group_count = min(len(chart.names), _MOST_GROUPS)
    series = dict[str, list[float]]()
    for name, numbers in chart.series.items():
        series[name] = [chart.factor * (number or 0.0) for number in list(numbers)[:group_count]]
    drawing = Drawing(_WIDTH, _BARS_HEIGHT, chart.title)
    sizes = [abs(value) for values in series.values() for value in values]
    axis_end = _choose_axis_end(max(sizes, default=0.0) or 1.0)
    scale = (_AXIS_Y - _TOP_MARGIN) / axis_end
    for fraction in (0.0, 0.5, 1.0):
        y = _AXIS_Y - fraction * (_AXIS_Y - _TOP_MARGIN)
        drawing.line(_AXIS_X, y, _WIDTH - _RIGHT_MARGIN, y)
        drawing.text(_AXIS_X - 4, y + 3, f"{fraction * axis_end:g}", anchor="end")
    drawing.text(0, 8, chart.unit)
    axis_label = f"{chart.axis} 1 to {group_count} of {len(chart.names)}"
    drawing.text(_WIDTH - _RIGHT_MARGIN, _AXIS_Y + 12, axis_label, anchor="end")
    width = _WIDTH - _AXIS_X - _RIGHT_MARGIN
    group_width = width / max(group_count, 1)
    bar_width = _BARS_SHARE * group_width / max(len(series), 1)
    gap = (1 - _BARS_SHARE) / 2  # on either side of a group, in widths of a group
    for index, (name, values) in enumerate(series.items()):
        colour = _SERIES_COLOURS[index % len(_SERIES_COLOURS)]
        for group, value in enumerate(values):
            height = scale * abs(value)
            x = _AXIS_X + group_width * (group + gap) + bar_width * index
            drawing.bar(x, _AXIS_Y - height, bar_width, height, colour)
        x = _AXIS_X + width * index / len(series)
        drawing.bar(x, _LEGEND_Y, 7, 7, colour)
        drawing.text(x + 10, _LEGEND_Y + 7, _shorten(name))
    return Picture(str(drawing), f"{chart.title}.", _BARS_PAGE_WIDTH)


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


def draw_arm(robot: Robot, joints: Sequence[float]) -> Picture | None:
    """Draw the arm in a posture, seen obliquely; return None for an arm without extent.

    `joints` are joint values of the controller [rad or m].
    """
    posture = to_postures(robot, [list(joints)])[0]
    points = np.array([[0.0, 0.0, 0.0], *posture.joint_origins, posture.flange_origin])
    reach = float(np.ptp(points, axis=0).max())
    if not reach > 0.0:
        return None
    axes = np.vstack([np.zeros(3), 0.25 * reach * np.eye(3)])  # origin and ends of the axes of R0
    arm, base_axes = _project(points), _project(axes)
    all_points = np.vstack([arm, base_axes])
    lower_corner, extent = all_points.min(axis=0), np.ptp(all_points, axis=0)
    scale = min(200.0 / extent[0], 170.0 / extent[1])  # the picture fills 200 × 170 points at most
    drawing = Drawing(260, 200, "The arm in the posture of the first observation")

    def to_drawing(point: FloatArray) -> tuple[float, float]:
        """Return the coordinates in the drawing of a projected point (2,)."""
        x, y = (point - lower_corner) * scale
        return 20 + float(x), 185 - float(y)

    for end, name in zip(base_axes[1:], "xyz", strict=True):
        drawing.line(*to_drawing(base_axes[0]), *to_drawing(end), MARK, 0.8)
        drawing.text(*to_drawing(end), name)
    drawing.path([to_drawing(point) for point in arm], INK, 2.4)
    labels: list[tuple[float, float, str]] = []  # (x, y, text); joints that nearly coincide share a label
    for number, point in enumerate(arm[1:-1], 1):
        drawing.dot(*to_drawing(point))
        x, y = to_drawing(point)
        label_nearby = next(
            (i for i, each in enumerate(labels) if hypot(x - each[0], y - each[1]) < _LABEL_DISTANCE), None
        )
        if label_nearby is None:
            labels.append((x, y, str(number)))
        else:
            label_x, label_y, text = labels[label_nearby]
            labels[label_nearby] = (label_x, label_y, f"{text}, {number}")
    for x, y, text in labels:
        drawing.text(x + 4, y - 3, text, 7.0)
    return Picture(
        str(drawing),
        "The item in the posture of the first observation: joints numbered from the base, flange at the end, "
        "axes of the base frame R0.",
        0.4,
    )


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
