"""Which robot the page begins with: that of the address, else the one that was stored last, if it fits."""

import pytest
from playwright.sync_api import Page, expect
from support.api import post
from support.browsing import file_of

from jointstiff.simulator import default_arm
from jointstiff.simulator.document import robot_document

CHOSEN = """(id) => [...document.querySelectorAll("main select, main input[type=radio]:checked")]
  .some((field) => field.value === id)"""
"""Whether a robot is chosen in a list or by a card."""

SOON = 30_000  # ms


@pytest.fixture
def robots(api, stored):
    """Two robots that a file of six axes fits."""
    document = robot_document(default_arm())
    return [post(api, "/v1/robots", document | {"name": name})["id"] for name in ("arm A", "arm B")]


def choose_a_table(page: Page) -> None:
    head = ["label", *(f"J{j} [deg]" for j in range(1, 7)), *(f"P1 {axis} [mm]" for axis in "xyz")]
    rows = [[f"c{i}", *["10.5"] * 6, *["1250.125"] * 3] for i in range(3)]
    content = "\n".join(";".join(row) for row in [head, *rows])
    page.locator("input[type=file]").first.set_input_files(file_of("day 6.csv", content))
    page.get_by_role("heading", name="day 6.csv").wait_for()


def test_another_robot_in_the_address_is_chosen_while_files_are_open(visit, robots):
    visited = visit("desktop", view=f"#/?robot={robots[0]}")
    page = visited.page
    choose_a_table(page)
    page.wait_for_function(CHOSEN, arg=robots[0], timeout=SOON)
    page.evaluate(f"location.hash = '#/?robot={robots[1]}'")
    page.wait_for_function(CHOSEN, arg=robots[1], timeout=SOON)


def test_the_robot_in_the_address_comes_before_that_of_a_campaign(visit, robots):
    visited = visit("desktop", view=f"#/?robot={robots[1]}")
    page = visited.page
    page.get_by_role("button", name="Try an example").click()
    expect(page.get_by_role("combobox", name="Robot")).to_have_value(robots[1])


@pytest.mark.parametrize("address", ["#/", "#/measure"])
def test_the_robot_stored_last_is_chosen_where_nobody_chose_one(visit, robots, address):
    visited = visit("desktop", view="#/robots/new")
    page = visited.page
    page.get_by_label("Name", exact=True).fill("the new one")
    page.get_by_role("radio").filter(visible=True).nth(3).check(force=True)
    page.get_by_role("button", name="Save robot").click(timeout=SOON)
    page.wait_for_url(lambda url: "#/robots/" in url and not url.endswith("/new"))
    stored_last = page.url.rpartition("/")[2]
    page.evaluate(f"location.hash = '{address}'")
    if address == "#/":
        choose_a_table(page)
        page.wait_for_function(CHOSEN, arg=stored_last, timeout=SOON)
    else:
        expect(page.get_by_role("combobox", name="Robot")).to_have_value(stored_last)
