"""The 3D view: what a frame costs in script, and that nothing is drawn when nothing happens."""

from __future__ import annotations

import statistics

import pytest
from playwright.sync_api import expect
from support.browsing import campaign, post

FRAMES = "performance.getEntriesByName('jointstiff.frame').map((m) => m.duration)"
MOST_MS = 8.0


@pytest.fixture(scope="module")
def large_run(api, stored):
    """200 configurations, 3 targets."""
    document = campaign(configurations=200, load="pull", seed=9)["measurement_set"]
    set_id = post(api, "/v1/measurement-sets", {**document, "robot_id": stored.robot})["id"]
    return post(api, "/v1/runs", {"measurement_set_id": set_id})["id"]


def test_a_frame_of_200_configurations_takes_little_script(visit, large_run):
    visited = visit("tablet")
    visited.go(f"#/runs/{large_run}/robot")
    page = visited.page
    canvas = page.locator("canvas[data-ready=true]")
    canvas.wait_for()
    expect(page.get_by_text("1 of 200")).to_be_visible()
    page.get_by_label("Deflections of all configurations").check()
    page.evaluate("performance.clearMeasures()")
    canvas.focus()
    for i in range(40):  # turn the view, then step through configurations
        page.keyboard.press("ArrowRight" if i % 2 else "PageDown")
    frames = page.evaluate(FRAMES)
    expect(page.get_by_text("21 of 200")).to_be_visible()
    print(f"{len(frames)} frames, median {statistics.median(frames):.2f} ms of script")  # noqa: T201
    assert len(frames) >= 10
    assert statistics.median(frames) <= MOST_MS


def test_nothing_is_drawn_while_nothing_happens(visit, stored):
    visited = visit("tablet")
    visited.go(f"#/runs/{stored.run}/robot")
    visited.page.locator("canvas[data-ready=true]").wait_for()
    visited.settle()
    visited.page.wait_for_timeout(300)
    visited.page.evaluate("performance.clearMeasures()")
    visited.page.wait_for_timeout(300)
    assert visited.page.evaluate(FRAMES) == []


def test_a_device_without_3d_graphics_gets_drawings(visit, stored):
    visited = visit("phone")
    visited.page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    visited.go(f"#/runs/{stored.run}/robot")
    expect(visited.page.get_by_text("This device does not support 3D graphics")).to_be_visible()
    assert visited.page.locator("svg.sketch").count() == 2
    visited.faults.clear()  # three says so on the console
