"""Maps and programs on the page: made from a run, looked at, downloaded."""

import re

from playwright.sync_api import expect
from support.api import file_at
from support.browsing import file_of
from support.programs import START, path, tool_poses

from jointstiff.service.programs.formats import read_program
from jointstiff.simulator.programs import program_text


def test_from_a_run_to_the_numbers_of_a_place(visit, stored, api):
    page = visit("tablet", view=f"#/runs/{stored.run}/map").page
    expect(page.get_by_label("Process force on the robot [N]")).not_to_have_value("")
    page.get_by_label("Places along x, y, z").fill("5, 15, 2")
    page.get_by_role("button", name="Make the map").click()
    expect(page).to_have_url(re.compile("#/maps/"))
    made = page.url.rsplit("/", 1)[1]
    counts = api.get(f"/v1/maps/{made}").json()["result"]["counts"]
    expect(page.get_by_text(f"{counts['reached']} of 150 places reached")).to_be_visible()
    assert counts["reached"] > 0


def test_a_map_is_downloaded_and_a_place_tapped_and_compared_with_another_run(visit, stored, api):
    page = visit("tablet", view=f"#/maps/{stored.map}").page
    for extension in ("csv", "npz"):
        with page.expect_download() as download:
            page.get_by_role("link", name=extension, exact=False).click()
        assert download.value.suggested_filename == f"map-{stored.map}.{extension}"
    worst = api.get(f"/v1/maps/{stored.map}").json()["result"]["worst"]
    slices = page.get_by_role("img", name="Slice at z")
    expect(slices).to_have_count(1)
    shown = page.locator(".slices dd").first
    expect(shown).to_have_text(re.compile(f"^{worst['deflection'] * 1e6:.4g}"[:4]))
    before = shown.text_content()
    box = slices.bounding_box()
    slices.tap(position={"x": 60, "y": box["height"] / 2})
    expect(shown).not_to_have_text(before)
    slices.press("ArrowRight")
    page.locator("canvas[data-ready=true]").wait_for()
    chosen = page.get_by_label("Beside it").locator("option").nth(1).get_attribute("value")
    page.get_by_label("Beside it").select_option(chosen)
    expect(slices).to_have_count(2)
    page.get_by_role("radio", name="Compliance along the force").check(force=True)
    expect(page.locator(".ramp-legend")).to_contain_text("µm/N")


def dropped(page, content):
    """Drop a program, and state what the controller does."""
    page.locator("input[type=file]").set_input_files(file_of("pocket.src", content))
    expect(page.get_by_text("pocket.src").first).to_be_visible()
    make = page.get_by_role("button", name="Compensate")
    expect(make).to_be_disabled()  # until the controller's option is stated
    page.get_by_label("Accuracy option of the controller").select_option("off")
    return make


def fill_in_frames(page):
    """State tool, base and the joints near the first target."""
    page.get_by_label("Tool, if the program only names it").fill("10, -20, 215.5, 0, 0, 0")
    page.get_by_label("Base, if the program only names it").fill("0 0 0 0 0 0")
    degrees = " ".join(f"{angle * 57.29577951:.3f}" for angle in START)
    page.get_by_label("Controller's joints near the first target").fill(degrees)


def test_from_a_run_to_the_corrected_file(visit, stored, api):
    visited = visit("tablet", view=f"#/runs/{stored.run}/program")
    page = visited.page
    content = program_text("krl", tool_poses(path(6)), 4)
    make = dropped(page, content)
    make.click()
    expect(page.get_by_role("alert")).to_contain_text("TOOL_DATA[1]")
    fill_in_frames(page)
    make.click()
    expect(page).to_have_url(re.compile("#/programs/"))
    expect(page.get_by_text("6 of 6")).to_be_visible()
    page.locator("canvas[data-ready=true]").wait_for()
    page.get_by_role("radio", name="After").check(force=True)
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
    visited.go(f"#/runs/{stored.run}/program")
    listed = page.locator("section", has_text="Compensated programs of this robot")
    expect(listed.get_by_role("link", name="pocket.src").first).to_have_attribute("href", re.compile(made))


def test_moves_that_are_not_certain_are_left_after_a_confirmation(visit, stored):
    page = visit("tablet", view=f"#/runs/{stored.run}/program").page
    head, _, tail = program_text("krl", tool_poses(path(6)), 4).rpartition("END")
    make = dropped(page, f"{head}LIN_REL {{X 5}}\nEND{tail}")
    fill_in_frames(page)
    leave = page.get_by_label("Leave the moves that are not certain as they are")
    expect(leave).to_have_count(0)
    make.click()
    expect(page.get_by_role("alert")).to_contain_text("relative move")
    leave.check()
    make.click()
    expect(page).to_have_url(re.compile("#/programs/"))
    expect(page.get_by_text("1 of 7")).to_be_visible()
