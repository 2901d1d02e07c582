"""A process on the page: its form, the path in 3D, the chart along it and the map of places."""

import re

import pytest
from playwright.sync_api import expect
from support.api import post, posted
from support.browsing import campaign, file_of
from support.programs import START, path, tool_poses

from jointstiff.simulator.programs import program_text

PROGRAM = program_text("krl", tool_poses(path(6)), 4)
MIDDLE = [1588.0, 379.0, 1431.0]
"""Near the middle of the path [mm]."""


@pytest.fixture(scope="module")
def run(api):
    """A run whose readings determine all joints."""
    return posted(api, campaign(load="pull", configurations=20, seed=7))["id"]


def fill_form(page):
    """Send the program, its frames, a force along R0 and a spindle across the last axis."""
    page.locator("input[type=file]").first.set_input_files(file_of("pocket.src", PROGRAM))
    page.get_by_label("Accuracy option of the controller").select_option("off")
    page.get_by_label("Tool frame, if the program states only its name").fill("10, -20, 215.5, 0, 0, 0")
    page.get_by_label("Base frame, if the program states only its name").fill("0 0 0 0 0 0")
    degrees = " ".join(f"{angle * 57.29577951:.3f}" for angle in START)
    page.get_by_label("Controller's joints near the first target").fill(degrees)
    page.get_by_label("Process force on the tool").fill("300, 400, -1400")
    page.get_by_label("Axes of the force").select_option("robot")
    page.get_by_label("Direction from spindle to tip").fill("0.7, 0, 0.7")
    page.locator("summary", has_text="Advanced").click()
    page.get_by_label("Greatest turn of the tool along the path").fill("3")


def test_from_a_run_to_a_turned_and_placed_program(visit, run, api):
    page = visit("desktop", view=f"#/runs/{run}/process").page
    make = page.get_by_role("button", name="Find the least deflection")
    expect(make).to_be_disabled()
    fill_form(page)
    page.get_by_label("Place the workpiece, too").check()
    low, high = ([each + step for each in MIDDLE] for step in (-60.0, 60.0))
    page.get_by_label("Box for the middle of the path").fill(
        "\n".join(", ".join(map(str, each)) for each in (low, high))
    )
    page.get_by_label("Places along x, y, z").fill("3, 3, 2")
    page.get_by_label("Turns of the workpiece about z").fill("2")
    make.click()
    expect(page).to_have_url(re.compile("#/processes/"))
    expect(page.get_by_text("6 targets, 6 moves")).to_be_visible(timeout=60_000)
    job = api.get(f"/v1/jobs/{page.url.rsplit('/', 1)[1]}").json()
    assert job["request"]["turn"] == "free"
    assert job["request"]["place"] == [low, high]
    page.locator("canvas[data-ready=true]").wait_for()
    page.get_by_role("radio", name="As chosen").check()
    page.get_by_label("Point of the path").fill("3")
    expect(page.get_by_text("Point 4, line 10")).to_be_visible()
    chart = page.get_by_role("img", name="Deflection along the path")
    assert len(chart.locator("path.line").all()) == 3
    chart.locator("rect.hit").click(position={"x": 2, "y": 40})
    expect(page.get_by_text("Point 1, line 7")).to_be_visible()
    places = page.locator("section").filter(
        has=page.get_by_role("heading", name="Places of the workpiece", exact=True)
    )
    expect(places.get_by_text(re.compile("^100.%$"))).to_be_visible()
    places.locator("svg.slice").click(position={"x": 70, "y": 20})
    position = places.locator("dd, td").filter(has_text=f"{low[0]:.0f}, {high[1]:.0f}")
    expect(position.first).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("link", name="Download pocket.src").click()
    assert b"LIN" in download.value.path().read_bytes()
    assert download.value.suggested_filename == f"pocket-turned-{job['id'][:8]}.src"
    table = page.get_by_role("table").filter(has_text="left after correction")
    for width in (360, 390):  # on a phone, all intervals are there
        page.set_viewport_size({"width": width, "height": 844})
        assert table.evaluate("(table) => table.parentElement.scrollWidth") <= width - 48


def test_a_cut_and_limits_of_the_turn_are_what_is_posted(visit, run, api):
    page = visit("phone", view=f"#/runs/{run}/process").page
    fill_form(page)
    page.get_by_role("radio", name="that of a cut").check()
    page.get_by_label("Material").select_option("aluminium")
    for label, value in {
        "Diameter of the tool [mm]": "16",
        "Number of teeth": "3",
        "Speed of the spindle [1/s]": "200",
        "Feed [mm/s]": "60",
        "Depth along the spindle [mm]": "4",
        "Width across the feed [mm]": "16",
    }.items():
        page.get_by_role("textbox", name=label).fill(value)
    page.get_by_role("radio", name="Within limits").check()
    page.get_by_label("Least and greatest turn").fill("-30, 40")
    page.get_by_role("button", name="Find the least deflection").click()
    expect(page).to_have_url(re.compile("#/processes/"))
    request = api.get(f"/v1/jobs/{page.url.rsplit('/', 1)[1]}").json()["request"]
    assert request["turn"] == [-30.0, 40.0]
    assert request["load"] is request["place"] is None
    assert (request["cut"]["diameter"], request["cut"]["feed"]) == (0.016, 0.06)


def test_a_table_of_loads_is_sent_with_the_program(visit, run, api):
    page = visit("desktop", view=f"#/runs/{run}/process").page
    fill_form(page)
    page.get_by_role("radio", name="in a table").check()
    rows = "".join(f"{point},300,400,-1400\n" for point in range(1, 7))
    page.locator("input[type=file]").last.set_input_files(
        file_of("loads.csv", f"point,Fx [N],Fy [N],Fz [N]\n{rows}")
    )
    page.get_by_role("button", name="Find the least deflection").click()
    expect(page).to_have_url(re.compile("#/processes/"))
    request = api.get(f"/v1/jobs/{page.url.rsplit('/', 1)[1]}").json()["request"]
    assert request["loads"] == "loads.csv"
    assert [each["name"] for each in request["files"]] == ["pocket.src", "loads.csv"]


def test_an_arm_that_nobody_measured_is_answered_by_its_prior(visit, run, api):
    arm = {"format": "catalogue", "arm": "KUKA KR 210 R2700 extra"}
    robot = post(api, "/v1/robots", {"name": "before the tracker", "model": arm, "payload": 210.0})["id"]
    page = visit("tablet", view=f"#/robots/{robot}").page
    page.get_by_role("link", name="Turn and place").click()
    expect(page.get_by_text("within a factor of two").first).to_be_visible()
    rows = "".join(f"1900,{y},900,0,30,180\n" for y in (-150, -50, 50, 150))
    table = f"x [mm],y [mm],z [mm],a [deg],b [deg],c [deg]\n{rows}"
    page.locator("input[type=file]").first.set_input_files(file_of("trim.csv", table))
    page.get_by_label("Accuracy option of the controller").select_option("off")
    page.get_by_label("Tool frame, if the program states only its name").fill("100, 0, 300, 0, 90, 0")
    page.get_by_label("Base frame, if the program states only its name").fill("0 0 0 0 0 0")
    page.get_by_label("Process force on the tool").fill("-100, -150, -50")
    page.locator("summary", has_text="Advanced").click()
    page.get_by_label("Branch of the arm").select_option("free")
    page.get_by_role("button", name="Find the least deflection").click()
    expect(page).to_have_url(re.compile("#/processes/"))
    expect(page.get_by_text("4 targets, 4 moves")).to_be_visible(timeout=60_000)
    expect(page.get_by_text("Arm that was not measured")).to_be_visible()
    request = api.get(f"/v1/jobs/{page.url.rsplit('/', 1)[1]}").json()["request"]
    assert (request["robot_id"], request["run_id"], request["axes"]) == (robot, None, "feed")
