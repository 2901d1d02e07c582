"""Pictures of numbers: each stands where its axis has it, and a number that is missing has a place, too."""

from __future__ import annotations

import math
import re

import matplotlib as mpl
import pytest

from jointstiff.schemas.run import JointResult
from jointstiff.service.reports.pictures import intervals
from jointstiff.service.reports.plots import figure_of
from jointstiff.service.tables.table import Area


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
