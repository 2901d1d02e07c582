"""Pictures of numbers: each stands where its axis has it, and a number that is missing has a place, too."""

from __future__ import annotations

import math
import re

import matplotlib as mpl
import numpy as np
import pytest

from jointstiff.schemas.run import JointResult
from jointstiff.service.kinds.map import area
from jointstiff.service.reports.pictures import bars, intervals
from jointstiff.service.reports.plots import figure_of
from jointstiff.service.tables.table import Area, Chart, Sheet


def joint(name, stiffness, interval):
    ends = None if interval is None else (1.0 / (interval[1] or math.inf), 1.0 / interval[0])
    return JointResult(
        name=name,
        status="identified" if stiffness else "not_observable",
        verdict="use",
        compliance=stiffness and 1.0 / stiffness,
        stiffness=stiffness,
        standard_uncertainty=1e-9 if stiffness else None,
        compliance_interval=ends,
        stiffness_interval=interval,
        reason=None if stiffness else "never twists",
    )


@pytest.mark.parametrize(
    "joints",
    [
        [joint("a", 2e5, (1.5e5, 3e5)), joint("b", 4e6, (3e6, 7e6))],
        [joint("a", 2e5, (1.5e3, None)), joint("b", None, None), joint("c", 4e7, (3e7, 9e8))],
        [joint("a", 1e6, (1e6, 1e6))],
    ],
)
def test_stiffnesses_stand_on_a_logarithmic_axis_that_holds_them_all(joints):
    drawing = str(intervals(joints, 0.95))
    texts = re.findall(r'<text [^>]*?x="([\d.]+)"[^>]*>([^<]*)</text>', drawing)
    decades = {float(text) * 1e6: float(x) for x, text in texts if re.fullmatch(r"[\d.e+-]+", text)}
    ends = [end for each in joints for end in (each.stiffness, *(each.stiffness_interval or ())) if end]
    assert min(decades) <= min(ends)
    assert max(decades) >= max(ends)
    (first, at_first), (last, at_last) = min(decades.items()), max(decades.items())
    dots = [float(x) for x in re.findall(r'<circle [^>]*?cx="([\d.]+)"', drawing)]
    expected = [
        at_first + math.log(each.stiffness / first) / math.log(last / first) * (at_last - at_first)
        for each in joints
        if each.stiffness
    ]
    assert dots == pytest.approx(expected, abs=0.1)
    assert all(at_first <= dot <= at_last for dot in dots)


def test_no_number_at_all_is_no_picture():
    assert intervals([joint("a", None, None)], 0.95) is None


def test_places_without_a_number_are_crosses_in_a_map():
    mpl.use("Agg")
    values = [1e-3, math.nan, 3e-3, math.nan, 5e-3]
    area = Area("deflection", range(5), [2.0] * 5, values, ("x", "y", "mm"), 1e3)
    axis = figure_of("map", (), (area,)).axes[0]
    dots, crosses = axis.collections
    assert dots.get_offsets()[:, 0].tolist() == [0.0, 2.0, 4.0]
    assert dots.get_array().tolist() == pytest.approx([1.0, 3.0, 5.0])
    assert crosses.get_offsets()[:, 0].tolist() == [1.0, 3.0]


def rectangles(drawing):
    """x, y, width and height of all bars."""
    tags = re.findall(r"<rect [^>]*>", drawing)
    names = ("x", "y", "width", "height")
    return np.array([[float(re.search(rf'\b{name}="([-\d.]+)"', tag)[1]) for name in names] for tag in tags])


@pytest.mark.parametrize("greatest", [0.7e-3, 1.0e-3, 3e-3, 8e-3])
def test_bars_have_the_heights_of_their_numbers_on_the_axis(greatest):
    """Two series side by side from left to right, a legend below that tells them apart."""
    series = {
        "measured": [greatest, 0.5 * greatest, 0.2 * greatest],
        "left": [0.1 * greatest, None, -0.3 * greatest],
    }
    drawing = str(bars(Chart("Bars", ["a", "b", "c"], series, 1e3, "mm")))
    texts = re.findall(r'<text [^>]*?x="([\d.]+)" y="([\d.]+)"[^>]*>([^<]*)</text>', drawing)
    ticks = sorted((float(text), float(y)) for x, y, text in texts if re.fullmatch(r"[\d.]+", text))
    (least, bottom), *_, (top, above) = ticks
    assert least == 0.0
    assert top >= 1e3 * greatest
    boxes = rectangles(drawing)
    boxes, legend = boxes[boxes[:, 1] < bottom], boxes[boxes[:, 1] > bottom]
    values = 1e3 * np.abs([value or 0.0 for each in series.values() for value in each])
    np.testing.assert_allclose(boxes[:, 3], values / top * (bottom - above), atol=4.0)
    shown = boxes[boxes[:, 3] > 0.0]
    np.testing.assert_allclose(shown[:, 1] + shown[:, 3], shown[0, 1] + shown[0, 3], atol=0.02)
    assert (np.diff(boxes[:3, 0]) > boxes[0, 2]).all()
    assert boxes[3, 0] == pytest.approx(boxes[0, 0] + boxes[0, 2], abs=0.02)
    assert boxes[:, 0].min() >= 40.0
    assert (boxes[:, 0] + boxes[:, 2]).max() <= 480.0
    assert len(legend) == 2
    assert legend[0, 0] < legend[1, 0] < 480.0


def test_bars_of_a_plot_stand_around_their_place_from_left_to_right():
    mpl.use("Agg")
    series = {"one": [1.0, 2.0], "two": [3.0, 4.0], "three": [5.0, 6.0]}
    axis = figure_of("bars", (Chart("t", ["a", "b"], series, 2.0, "mm"),)).axes[0]
    middles = [[bar.get_x() + bar.get_width() / 2 for bar in group] for group in axis.containers]
    assert [[bar.get_height() for bar in group] for group in axis.containers] == [[2, 4], [6, 8], [10, 12]]
    assert np.mean(middles, axis=0).tolist() == pytest.approx([0.0, 1.0])
    assert (np.diff(middles, axis=0) > 0.0).all()


@pytest.mark.parametrize(("sizes", "across"), [((3, 2, 2), "z"), ((3, 1, 2), "y"), ((1, 2, 2), "x")])
def test_the_slice_of_a_map_lies_across_its_thinnest_axis_where_most_bends(sizes, across):
    places = np.stack(np.meshgrid(*map(np.arange, sizes), indexing="ij"), axis=-1).reshape(-1, 3)
    bends = [2e-3, *[1e-3] * (len(places) - 2), None]
    columns = {f"{axis} [m]": places[:, k].tolist() for k, axis in enumerate("xyz")}
    drawn = area(Sheet(columns | {"deflection [m]": bends}))
    k = "xyz".index(across)
    assert drawn.title == f"Deflection at {across} = 0 mm"
    assert len(drawn.values) == (places[:, k] == 0).sum()
    assert max(drawn.values) == 2e-3
