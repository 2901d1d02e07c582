"""A program on the page: dropped, corrected by a run, looked at, downloaded."""

from __future__ import annotations

import re

from playwright.sync_api import expect
from support.api import file_at
from support.programs import START, path, tool_poses

from jointstiff.service.programs.formats import read_program
from jointstiff.simulator.programs import program_text


def test_from_a_run_to_the_corrected_file(visit, stored, api):
    visited = visit("tablet")
    page = visited.page
    visited.go(f"#/runs/{stored.run}/program")
    content = program_text("krl", tool_poses(path(6)), 4).encode()
    file = {"name": "pocket.src", "mimeType": "text/plain", "buffer": content}
    page.locator("input[type=file]").set_input_files(file)
    expect(page.get_by_text("pocket.src")).to_be_visible()
    make = page.get_by_role("button", name="Compensate")
    expect(make).to_be_disabled()  # until the controller's option is stated
    page.get_by_label("Accuracy option of the controller").select_option("off")
    make.click()
    expect(page.get_by_role("alert")).to_contain_text("TOOL_DATA[1]")
    page.get_by_label("Tool, if the program only names it").fill("10, -20, 215.5, 0, 0, 0")
    page.get_by_label("Base, if the program only names it").fill("0 0 0 0 0 0")
    degrees = " ".join(f"{angle * 57.29577951:.3f}" for angle in START)
    page.get_by_label("Controller's joints near the first target").fill(degrees)
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
    assert unmarked not in (content, corrected)
    assert len(read_program([("pocket.src", unmarked)]).targets) == 6
    made = page.url.rsplit("/", 1)[1]
    assert api.get(file_at(made, "program")).content == corrected
    visited.go(f"#/runs/{stored.run}/program")
    listed = page.locator("section", has_text="Compensated programs of this robot")
    expect(listed.get_by_role("link", name="pocket.src").first).to_have_attribute("href", re.compile(made))


def test_moves_that_are_not_certain_are_left_after_a_confirmation(visit, stored):
    visited = visit("tablet")
    page = visited.page
    visited.go(f"#/runs/{stored.run}/program")
    head, _, tail = program_text("krl", tool_poses(path(6)), 4).rpartition("END")
    content = f"{head}LIN_REL {{X 5}}\nEND{tail}".encode()
    file = {"name": "pocket.src", "mimeType": "text/plain", "buffer": content}
    page.locator("input[type=file]").set_input_files(file)
    page.get_by_label("Accuracy option of the controller").select_option("off")
    page.get_by_label("Tool, if the program only names it").fill("10, -20, 215.5, 0, 0, 0")
    page.get_by_label("Base, if the program only names it").fill("0 0 0 0 0 0")
    degrees = " ".join(f"{angle * 57.29577951:.3f}" for angle in START)
    page.get_by_label("Controller's joints near the first target").fill(degrees)
    leave = page.get_by_label("Leave the moves that are not certain as they are")
    expect(leave).to_have_count(0)
    page.get_by_role("button", name="Compensate").click()
    expect(page.get_by_role("alert")).to_contain_text("relative move")
    leave.check()
    page.get_by_role("button", name="Compensate").click()
    expect(page).to_have_url(re.compile("#/programs/"))
    expect(page.get_by_text("1 of 7")).to_be_visible()
