"""The page's views of imports, maps, plans, robots, trends and verdicts in a browser."""

import json
import re

from playwright.sync_api import expect
from support.api import file_at
from support.browsing import ROOT, file_of
from support.programs import START, path, tool_poses

from jointstiff.simulator.programs import program_text
from robotprograms.formats import read_program


def two_files():
    """Return a file of joints and a file of points, with labels in common."""
    head, *rows = (ROOT / "examples" / "readings.csv").read_text(encoding="utf-8").splitlines()
    cells = [row.split(";") for row in (head, *rows)]
    joints = "\n".join(";".join(row[:7]) for row in cells)
    points = "\n".join(";".join([row[0], *row[7:]]) for row in cells)
    return [file_of("joints.csv", joints), file_of("rows.csv", points)]


def test_a_saved_mapping_reads_the_next_files(visit, stored):
    """What was answered for joints and positions in two files is not asked again."""
    visited = visit("phone", view=f"#/?robot={stored.robot}")
    page = visited.page
    page.locator("input[type=file]").first.set_input_files(two_files())
    page.get_by_label("Load point, x, y, z").fill("-60, 20, 180")
    page.get_by_role("button", name="Next").click()
    page.get_by_role("button", name="motor encoders").click()
    expect(page.get_by_role("button", name="Identify")).to_be_enabled()
    with page.expect_download() as download:
        page.get_by_role("button", name="Save mapping").click()
    mapping = download.value.path().read_text(encoding="utf-8")
    assert json.loads(mapping)["load_point"] == [-60, 20, 180]
    visited.go("#/runs")
    visited.go(f"#/?robot={stored.robot}")
    again = [*two_files(), file_of(download.value.suggested_filename, mapping)]
    page.locator("input[type=file]").first.set_input_files(again)
    expect(page.get_by_text("passed all integrity checks")).to_be_visible()
    expect(page.locator(".ask")).to_have_count(0)
    expect(page.get_by_role("button", name="Identify")).to_be_enabled()


def test_an_outage_in_an_import_loses_nothing(visit, stored):
    page = visit("tablet", view=f"#/?robot={stored.robot}").page
    page.locator("input[type=file]").first.set_input_files(two_files())
    page.get_by_label("Load point, x, y, z").fill("-60, 20, 180")
    page.route("**/v1/imports", lambda route: route.abort())
    page.get_by_role("button", name="Next").click()
    expect(page.get_by_role("alert")).to_contain_text("The service is not available")
    expect(page.get_by_role("columnheader", name="joints")).to_be_visible()
    expect(page.get_by_role("button", name="Identify")).to_be_disabled()
    page.unroute("**/v1/imports")  # the page tries again by itself
    page.get_by_role("button", name="motor encoders").click()
    expect(page.get_by_text("passed all integrity checks")).to_be_visible()
    expect(page.get_by_role("button", name="Identify")).to_be_enabled()


def test_from_a_run_to_the_corrected_file(visit, stored, api):
    visited = visit("tablet", view=f"#/runs/{stored.run}/correct")
    page = visited.page
    content = program_text("krl", tool_poses(path(6)), 4)
    page.locator("input[type=file]").set_input_files(file_of("pocket.src", content))
    page.get_by_label("Accuracy option of the controller").select_option("off")
    make = page.get_by_role("button", name="Correct", exact=True)
    expect(make).to_be_disabled()  # nobody has said which force acts
    page.get_by_label("Process force on the tool").fill("0, 0, -500")
    make.click()
    expect(page.get_by_role("alert")).to_contain_text("TOOL_DATA[1]")
    page.get_by_label("Tool frame, if the program states only its name").fill("10, -20, 215.5, 0, 0, 0")
    page.get_by_label("Base frame, if the program states only its name").fill("0 0 0 0 0 0")
    degrees = " ".join(f"{angle * 57.29577951:.3f}" for angle in START)
    page.get_by_label("Controller's joints near the first target").fill(degrees)
    make.click()
    expect(page).to_have_url(re.compile("#/corrections/"))
    expect(page.get_by_text("6 of 6")).to_be_visible()
    page.locator("canvas[data-ready=true]").wait_for()
    page.get_by_role("radio", name="After").check()
    page.get_by_label("Point of the path").fill("3")
    expect(page.get_by_text("Point 4, line 10")).to_be_visible()
    expect(page.get_by_role("table", name="Worst points").locator("tbody tr")).to_have_count(6)
    with page.expect_download() as download:
        page.get_by_role("link", name="Download pocket.src").click()
    assert download.value.suggested_filename == "pocket-corrected.src"
    corrected = download.value.path().read_bytes()
    lines = corrected.splitlines(keepends=True)
    unmarked = b"".join(line for line in lines if b"Jointstiff run " not in line)
    assert unmarked not in (content.encode(), corrected)
    assert len(read_program([("pocket.src", unmarked)]).targets) == 6
    made = page.url.rsplit("/", 1)[1]
    assert api.get(file_at(made, "program")).content == corrected
    visited.go(f"#/runs/{stored.run}/correct")
    listed = page.locator("section", has_text="Corrections of this robot")
    expect(listed.get_by_role("link", name="pocket.src").first).to_have_attribute("href", re.compile(made))


def test_a_campaign_goes_on(visit, stored):
    """Plan from a set: what is left empty is the campaign's, and the file to fill in has its readings."""
    page = visit("phone", view=f"#/sets/{stored.set}").page
    page.locator("summary", has_text="More").click()
    page.get_by_role("link", name="Plan next readings").click()
    page.get_by_label("Number of readings").fill("4")
    page.get_by_label("joint_1").uncheck()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("Certified: the list gives at least")).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("button", name="Campaign to fill in").click()
    observations = json.loads(download.value.path().read_text())["observations"]
    assert len(observations) == 12 + 4
    assert observations[0]["readings"][0]["loaded"] is not None
    assert observations[-1]["readings"][0]["loaded"] is None
