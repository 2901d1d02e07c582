"""Plots for a column of a paper: width, panels, axes of the caller, and what stands where no number is."""

import io
import subprocess
import sys
from itertools import pairwise

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

import jointstiff as js
from jointstiff.service.reports.plots import draw_figure
from jointstiff.service.tables.table import Area, Chart
from jointstiff.simulator import default_arm, simulate_campaign

mpl.use("Agg")
PANELS = {
    "Stiffness with its interval": ("joints", "stiffness [10⁶ N·m/rad]"),
    "Contribution to the deflection": ("joints", "contribution [%]"),
    "Measured deflection": ("configurations", "deflection [mm]"),
    "Left over by the model": ("configurations", "residual [µm]"),
}


@pytest.fixture(scope="module")
def run():
    return js.identify(simulate_campaign(default_arm(), load="dead_weight", configurations=8, seed=3))


def test_a_figure_is_a_column_wide_and_has_a_panel_for_each_quantity_and_no_verdict(run):
    figure = run.plot()
    assert figure.get_figwidth() * 25.4 == pytest.approx(88.0)
    assert {axes.get_title(): (axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes} == PANELS
    assert figure.get_suptitle() == ""
    heights = [[bar.get_height() for bar in axes.patches] for axes in figure.axes[2:]]
    for drawn, lengths, factor in zip(
        heights,
        (run.result.mean_lengths("deflection"), run.result.mean_lengths("residual")),
        (1e3, 1e6),
        strict=True,
    ):
        assert drawn == pytest.approx([factor * length for length in lengths.values()])


@pytest.mark.process
def test_a_figure_needs_no_pyplot_and_is_shown_by_notebooks(run):
    assert run.plot()._repr_png_().startswith(b"\x89PNG")
    program = (
        "import sys; from jointstiff.service.reports.plots import draw_figure; "
        "from jointstiff.service.tables.table import Chart; "
        "draw_figure([Chart('t', ['a'], {'s': [1.0]}, 1.0, 'mm')]); print('matplotlib.pyplot' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_the_caller_chooses_axes_title_joints_and_size(run):
    figure = run.plot(title="Cell 3", joints=["joint_3", "joint_2"], figsize=(7.0, 6.0))
    assert (figure.get_suptitle(), figure.get_size_inches().tolist()) == ("Cell 3", [7.0, 6.0])
    for axes in figure.axes[:2]:
        assert [label.get_text() for label in axes.get_xticklabels()] == ["joint_3", "joint_2"]
    assert len(figure.axes[2].patches) == 8
    own = Figure()
    axes = own.subplots(2, 2)
    assert run.plot(axes) is own
    assert [each.get_title() for each in axes.flat] == list(PANELS)
    with pytest.raises(ValueError, match="the result has 4 panels: give 4 axes, not 1"):
        run.plot(Figure().subplots())
    with pytest.raises(ValueError, match="there is no joint joint_9: the joints are joint_1, joint_2"):
        run.plot(joints=["joint_9"])


def test_a_joint_without_a_number_is_marked_and_whiskers_end_at_the_interval(run):
    axes = run.plot().axes[0]
    assert [text.get_text() for text in axes.texts] == ["no number"]
    assert axes.texts[0].get_position()[0] == 0  # joint_1
    (segments,) = (each.get_segments() for each in axes.collections)
    for segment, joint in zip(segments[1:], list(run.joints.values())[1:], strict=True):
        assert segment[:, 1] * 1e6 == pytest.approx(joint.stiffness_interval)
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels
    assert not [label for label in labels if "10^" in label]


def test_an_interval_without_an_upper_end_is_an_arrow():
    chart = Chart(
        "t", ["a", "b"], {"s": [1.0, 2.0]}, 1.0, "m", "joints", {"s": [(0.5, None), (1.0, 3.0)]}, True
    )
    axes = draw_figure([chart]).axes[0]
    assert [each.xy for each in axes.texts] == [(0.0, 1.0)]


def test_a_grid_is_drawn_as_filled_contours_with_a_colour_bar():
    x, y = (each.ravel() for each in np.meshgrid(np.arange(5.0), np.arange(4.0)))
    values = np.where(x > 3, np.nan, x + y)
    figure = draw_figure([], [Area("deflection", x, y, values, ("x [m]", "y [m]", "d [mm]"), 1e3)])
    axes, bar = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel(), bar.get_ylabel()) == ("x [m]", "y [m]", "d [mm]")
    filled, lines, crosses = axes.collections
    assert filled.filled
    assert not lines.filled
    assert crosses.get_offsets()[:, 0].tolist() == [4.0] * 4
    assert (filled.levels[0], filled.levels[-1]) == (0.0, 6000.0)


def test_the_methods_of_a_comparison_are_apart_from_the_measured_deflection(run):
    comparison = js.compare(run)
    first, second = comparison.plot().axes
    assert [each.get_title() for each in (first, second)] == [
        "Measured deflection",
        "Left over after compensation",
    ]
    methods = [text.get_text() for text in second.get_legend().get_texts()]
    assert methods == ["CP/L", "CP", "PP", "DPP"]
    greys = [mpl.colors.rgb_to_hsv(group[0].get_facecolor()[:3])[2] for group in second.containers]
    hatches = [group[0].get_hatch() for group in second.containers]
    assert len({(round(grey, 1), hatch) for grey, hatch in zip(greys, hatches, strict=True)}) == 4


DATES = ["2026-01-05", "2026-02-04", "2026-03-06", "2026-04-05", "2026-05-05", "2026-06-04"]


def date_chart(title, values):
    """Return a chart of a trend: one number and its interval for each date."""
    ends = [(0.8 * value, 1.2 * value) for value in values]
    return Chart(title, DATES, {"k": values}, 1.0, "N·m/rad", "campaigns", {"k": ends}, logarithmic=True)


def test_names_of_places_do_not_overlap_and_occur_below_the_last_of_equal_panels():
    figure = draw_figure([date_chart("joint_1", [3.1] * 6), date_chart("joint_2", [0.1] * 6)])
    figure.savefig(io.BytesIO(), format="png")
    first, last = ([label for label in axes.get_xticklabels() if label.get_visible()] for axes in figure.axes)
    assert (len(first), len(last)) == (0, 6)
    boxes = [label.get_window_extent() for label in last]
    assert all(box.x1 < following.x0 for box, following in pairwise(boxes))


@pytest.mark.parametrize("value", [0.013, 0.1, 3.1, 470.0])
def test_a_narrow_logarithmic_axis_has_at_least_two_numbers(value):
    (axes,) = draw_figure([date_chart("joint_1", [value] * 6)]).axes
    low, high = axes.get_ylim()
    assert sum(low <= tick <= high for tick in axes.get_yticks()) >= 2
