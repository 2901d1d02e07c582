"""Robots in Chromium: from the catalogue or from sweeps, renamed, archived and taken back; notes on a set."""

import re
from pathlib import Path

import httpx2
from playwright.sync_api import expect
from support.api import post
from support.browsing import campaign


def test_a_nominal_arm_is_found_named_archived_and_taken_back(visit):
    """Search the catalogue, save, look at table and map, rename, archive; note who measured, and find it."""
    visited = visit("tablet", view="#/robots/new")
    page = visited.page
    page.get_by_label("Search").fill("kr210")
    page.get_by_role("radio", name="KUKA KR 210 R2700 extra").check(force=True)
    expect(page.get_by_text("Nominal values of the maker")).to_be_visible()
    page.locator("canvas[data-ready=true]").wait_for()
    page.get_by_role("button", name="Edit as a table").click()
    expect(page.get_by_label("a of joint 3")).to_have_value("1150")
    expect(page.get_by_label("Preset")).to_have_value("kuka")
    page.get_by_role("radio", name="Catalogue").check(force=True)
    page.get_by_label("Name", exact=True).fill("press line arm")
    page.get_by_role("button", name="Save robot").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("press line arm")
    expect(page.get_by_role("table", name="Table")).to_contain_text("−140")
    expect(page.get_by_role("table", name="Model angles by controller angles")).to_contain_text("−1")

    page.once("dialog", lambda dialog: dialog.accept("press line, arm 2"))
    page.get_by_role("button", name="Rename").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("press line, arm 2")
    page.get_by_role("button", name="Archive").click()
    expect(page.get_by_role("button", name="Restore from the archive")).to_be_visible()
    robot = page.url.rpartition("/")[2]
    visited.go("#/robots")
    expect(page.get_by_text("press line, arm 2")).to_have_count(0)
    page.get_by_text("Archived", exact=True).click()
    page.get_by_role("link", name="press line, arm 2").click()
    page.get_by_role("button", name="Restore from the archive").click()
    expect(page.get_by_role("button", name="Archive", exact=True)).to_be_visible()

    with httpx2.Client(base_url=visited.url, timeout=60.0) as api:
        document = campaign(load="pull", seed=31)
        robot = post(api, "/v1/robots", document["robot"] | {"name": "noted arm"})["id"]
        readings = document["measurement_set"] | {"robot_id": robot, "name": "noted set"}
        stored = post(api, "/v1/measurement-sets", readings)["id"]
        visited.go(f"#/sets/{stored}")
        page.get_by_role("button", name="Add notes").click()
        page.get_by_label("Measured at").fill("2026-11-20T14:30")
        page.get_by_label("Serial number of the robot").fill("F-211034")
        page.get_by_label("Notes").fill("before\nthe repair")
        page.get_by_role("button", name="Save").click()
        expect(page.get_by_text("F-211034")).to_be_visible()
        noted = api.get(f"/v1/measurement-sets/{stored}").json()
    assert (noted["serial_number"], noted["notes"]) == ("F-211034", "before\nthe repair")
    assert noted["measured_at"] is not None
    visited.go("#/sets")
    page.get_by_label("Search").fill("noted 211034")
    expect(page.locator(".rows .item")).to_have_count(1)
    page.get_by_label("Measured from").fill("2026-11-22")
    expect(page.get_by_text("No match")).to_be_visible()


EXAMPLE = Path(__file__).parents[2] / "examples" / "sweeps.json"


def test_from_dropped_sweeps_to_a_robot(visit, api):
    visited = visit("tablet", view="#/")
    page = visited.page
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
