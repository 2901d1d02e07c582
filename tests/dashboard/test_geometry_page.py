"""Sweeps on the page: dropped where readings are, identified beside the nominal model, saved as a robot."""

from __future__ import annotations

import re
from pathlib import Path

from playwright.sync_api import expect

EXAMPLE = Path(__file__).parents[2] / "examples" / "sweeps.json"


def test_from_dropped_sweeps_to_a_robot(visit, api):
    visited = visit("tablet")
    page = visited.page
    visited.go("#/")
    page.locator("input[type=file]").first.set_input_files(EXAMPLE)
    expect(page).to_have_url(re.compile("#/geometries$"))
    expect(page.get_by_role("table", name="Sweeps").locator("tbody tr")).to_have_count(6)
    page.get_by_role("button", name="Identify the geometry").click()
    expect(page).to_have_url(re.compile("#/geometries/"))
    page.locator("canvas[data-ready=true]").wait_for()
    lengths = page.get_by_role("table", name="Links, nominal and identified")
    expect(lengths.get_by_role("row", name="a joint_2 1120.000")).to_be_visible()
    axes = page.get_by_role("table", name="Axes at model angle zero, in R0")
    expect(axes.locator("tbody tr")).to_have_count(6)
    made = page.url.rsplit("/", 1)[1]
    page.get_by_label("Name of the robot").fill("cell 3, measured")
    page.get_by_role("button", name="Save as a robot").click()
    expect(page).to_have_url(re.compile("#/robots/"))
    robot = api.get(f"/v1/robots/{page.url.rsplit('/', 1)[1]}").json()
    assert (robot["name"], robot["geometry_id"]) == ("cell 3, measured", made)
    visited.go("#/geometries")
    expect(page.get_by_role("link", name=re.compile("cell 3"))).to_be_visible()
