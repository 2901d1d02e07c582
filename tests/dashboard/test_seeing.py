"""Every view as eyes and fingers find it: light, dark, on paper, by axe-core; each night at nine widths."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import httpx2
import pytest
from playwright.sync_api import Page, expect
from support import everything
from support.browsing import VIEWS, file_of
from support.processes import Service, alone
from support.seeing import AXE, LOOK, MEDIA, OPENED, TARGET, Eyes, accessibility_faults

pytestmark = pytest.mark.timeout(900, func_only=True)
"""Building the database takes as long as it takes, and a width has some 220 looks."""
WIDTHS = (360, 390, 650, 820, 960, 1024, 1280, 1440, 1920)  # px
BY_DAY = {390: ("light",), 1280: ("dark",)}


@pytest.fixture(scope="module")
def database(bundle: Path, shared_folder: Path) -> tuple[Path, dict[str, str]]:
    """A database of everything, and the ids in it by name; all workers of xdist share it."""
    folder = shared_folder / "everything"
    names = folder / "names.json"
    with alone(shared_folder / "everything.lock"):
        if not names.is_file():
            folder.mkdir(exist_ok=True)
            url = f"sqlite:///{folder / 'jointstiff.db'}"
            service = Service(url, "--workers", "1")
            try:
                with httpx2.Client(base_url=service.url, timeout=None) as client:
                    made = everything.fill(client, url)
            finally:
                service.stop()
            names.write_text(json.dumps(made), encoding="utf-8")
    return folder / "jointstiff.db", json.loads(names.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def site(database, tmp_path_factory):
    """A service of our own with a copy of that database; without a worker, runs stay as they are."""
    copy = tmp_path_factory.mktemp("everything") / "jointstiff.db"
    for file in database[0].parent.glob("jointstiff.db*"):
        shutil.copy(file, copy.with_name(file.name))
    running = Service(f"sqlite:///{copy}", "--workers", "0")
    yield running
    running.stop()


@pytest.fixture
def stored(database):
    return database[1]


def test_faults_are_seen(visit):
    page = visit("desktop").page
    page.set_content(Path(__file__).with_name("seeing_faults.html").read_text(encoding="utf-8"))
    page.evaluate(LOOK)
    found = "\n".join(page.evaluate("[...seeing(false, 44), ...first(5, 100, 10, 10)]"))
    wanted = (
        *("overlap", 'no unit beside "3.25"', "is cut off", "a row of 9", "the first number stands at"),
        *('"do not use" is cut off by its box', "a heading of level 3 after one of level 1"),
        *(
            "the first stiffness stands at",
            '"12 N·m" is cut off by its drawing',
            '"7.5" is bold and must not',
        ),
        *('"-1726.4830" is cut off by its field "Unloaded x"', "words above the fold", "px high"),
        '"What a person reads before a choice" shares its width with the button "Read the files',
    )
    assert [fault for fault in wanted if fault not in found] == [], found
    assert '"0.17"' not in found.split("overlap")[-1]  # its head has the unit
    assert "with an ellipsis" not in found
    assert found.count("is cut off by its field") == 1
    assert found.count("shares its width with the button") == 1


MOST_PAIRS = 6  # of size and weight
MOST_SIZES, MOST_WEIGHTS = 5, 3


def choose_a_table(page: Page) -> None:
    """Choose a file of readings that many robots fit, which have long names."""
    head = ["label", *(f"J{j} [deg]" for j in range(1, 7)), *(f"P1 {axis} [mm]" for axis in "xyz")]
    rows = [[f"c{i}", *["10.5"] * 6, *["1250.125"] * 3] for i in range(3)]
    content = "\n".join(";".join(row) for row in [head, *rows])
    page.locator("input[type=file]").first.set_input_files(file_of("day 5.csv", content))
    page.get_by_role("heading", name="day 5.csv").wait_for()
    page.locator(".field", has_text="Robot").first.wait_for()


LOOKS: list[tuple[str, Callable[[Page], None] | None]] = [
    *((view, None) for view in VIEWS),
    ("#/ with a table", choose_a_table),
]
"""Views, and what a person does there first."""


@pytest.mark.parametrize(
    ("width", "media_of_width"),
    [
        *(pytest.param(*day, id=f"{day[0]} px by day") for day in BY_DAY.items()),
        *(
            pytest.param(width, tuple(MEDIA), id=f"{width} px each night", marks=pytest.mark.slow)
            for width in WIDTHS
        ),
    ],
)
def test_every_view_can_be_read_and_tapped_in_few_sizes_of_type(
    visit, stored, node_modules, width, media_of_width
):
    """By a finger on a phone, where axe-core looks, too; elsewhere by a mouse, with the smallest targets."""
    axe = AXE.read_text(encoding="utf-8") if width == 390 else None
    eyes = Eyes(visit("phone" if axe else "desktop"), width, media_of_width, axe)
    for view, act in LOOKS:
        eyes.look(view, view.split(" ")[0].format(**stored), act)
    assert not eyes.faults, "\n".join(f"{fault} at {', '.join(at)}" for fault, at in eyes.faults.items())
    assert len(eyes.pairs) <= MOST_PAIRS, sorted(eyes.pairs)
    assert len({pair.split()[0] for pair in eyes.pairs}) <= MOST_SIZES
    assert len({pair.split()[1] for pair in eyes.pairs}) <= MOST_WEIGHTS


@pytest.mark.slow
@pytest.mark.parametrize("half", [0, 1])
def test_every_view_is_accessible_on_a_tablet(visit, stored, node_modules, half):
    visited = visit("tablet")
    page = visited.page
    axe = AXE.read_text(encoding="utf-8")
    found: dict[str, list[str]] = {}
    for view in VIEWS[half::2]:
        visited.go(view.format(**stored))
        visited.settle()
        page.evaluate(OPENED)
        page.evaluate(axe)
        page.evaluate(LOOK)
        if faults := accessibility_faults(page, TARGET["tablet"]):
            found[view] = faults
    assert found == {}


def test_the_page_follows_the_switch_and_remembers_it(visit, stored):
    visited = visit("tablet", "light", view="#/runs")
    page = visited.page
    ground = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(ground)
    page.get_by_label("Display").click()
    page.get_by_role("radio", name="Dark").check()
    expect(page.locator("html")).to_have_attribute("data-theme", "dark")
    assert page.evaluate(ground) != light
    visited.go("#/runs")
    assert page.evaluate(ground) != light


def test_one_can_skip_to_the_content(visit, stored):
    visited = visit("desktop")
    visited.go("#/runs")
    visited.page.keyboard.press("Tab")
    skip = visited.page.get_by_role("link", name="Skip to content")
    assert skip.evaluate("e => e === document.activeElement")
    assert skip.bounding_box()["y"] >= 0
    visited.page.keyboard.press("Enter")
    assert visited.page.evaluate("document.activeElement.id") == "content"


def test_one_of_two_thousand_runs_is_found_by_its_name(visit, stored):
    visited = visit("phone", view="#/runs")
    page = visited.page
    expect(page.get_by_text(re.compile(r"^100 of 2[ ,\u202f]?0\d\d$"))).to_be_visible()
    page.get_by_label("Search", exact=True).fill("check 0012")
    expect(page.locator(".rows .item")).to_have_count(1)
    expect(page.locator(".rows .item")).to_contain_text("KR 240 cell 12")


def test_back_keeps_place_and_ticks(visit, stored):
    """From a long list to a run and back: the list is where it was, and what was ticked is ticked."""
    visited = visit("phone", view="#/runs")
    page = visited.page
    ticks = page.locator(".pick input")
    ticks.nth(2).check()
    ticks.nth(40).check()
    place = page.evaluate("scrollY")
    assert place > 1_000
    page.wait_for_timeout(500)  # the place is kept once a person has stopped to scroll
    page.locator(".rows a.main").nth(42).click()
    page.get_by_role("navigation", name="Parts of the result").wait_for()
    assert page.evaluate("scrollY") == 0
    page.go_back()
    expect(page.get_by_role("region", name="2 selected")).to_be_visible()
    page.wait_for_function("(place) => Math.abs(scrollY - place) < 2", arg=place)
    assert [ticks.nth(i).is_checked() for i in (2, 40, 41)] == [True, True, False]


@pytest.mark.parametrize("section", ["runs", "robots", "sets"])
def test_the_address_and_the_list_agree(visit, stored, section):
    """A search is in the address; another address of the list, or *Back*, is another search."""
    visited = visit("tablet", view=f"#/{section}")
    page = visited.page
    search, count = page.get_by_label("Search", exact=True), page.locator(".list > [role=status]")
    expect(count).to_have_text(re.compile(r"\d"))
    expect(count).to_be_visible()  # what stands below something busy is hidden
    everything_there = count.inner_text()
    search.fill("cell 12")
    page.wait_for_url(re.compile(rf"#/{section}\?q=cell\+12$"))
    expect(count).not_to_have_text(everything_there)
    expect(count).to_be_visible()
    found = count.inner_text()
    page.evaluate(f"location.hash = '#/{section}'")
    expect(search).to_have_value("")
    expect(count).to_have_text(everything_there)
    page.go_back()
    expect(search).to_have_value("cell 12")
    expect(count).to_have_text(found)


START_BUDGET, START_REQUESTS = 140_000, 12
"""Most bytes over the wire and requests of the start view with thousands of runs."""


def test_the_start_is_small_beside_two_thousand_runs(visit, stored):
    visited = visit("phone")
    sizes = visited.weigh()
    visited.page.goto(visited.url)
    visited.page.locator(".rows .badge").first.wait_for()
    visited.page.wait_for_load_state("networkidle")
    print(f"start {sum(sizes.values())} B in {len(sizes)} requests")  # noqa: T201
    assert 60_000 < sum(sizes.values()) <= START_BUDGET
    assert len(sizes) <= START_REQUESTS


def test_the_start_says_which_robot_got_worse_and_a_tap_since_when(visit, stored):
    """By the wall, among thousands of runs: the worst robot first, by how much; its trend is one tap away."""
    visited = visit("phone")
    page = visited.page
    page.goto(visited.url)
    wall = page.get_by_role("table", name="change since the first campaign")
    worst = wall.locator("tbody tr").first
    expect(worst).to_contain_text("10 Jul 2026")
    expect(worst.locator(".softer")).to_have_text(re.compile(r"^\u22121\d\.\d\s%$"))
    assert worst.locator("th a").get_attribute("href") == f"#/robots/{stored['worn']}"
    worst.locator(".softer a").click()
    expect(page.locator(".note.bad")).to_contain_text(re.compile("Changed.*joint_3"))
    answers = [url for url in visited.requests if "/v1/" in url]
    print(f"{len(answers)} requests of the API in one tap")  # noqa: T201
    assert len(answers) <= START_REQUESTS


def test_a_robots_page_begins_with_its_stiffness_today(visit, stored):
    visited = visit("phone", view=f"#/robots/{stored['worn']}")
    joints = visited.page.get_by_role("table", name="Stiffness today").get_by_role("row")
    expect(joints).to_have_count(1 + 6)
    expect(joints.nth(3)).to_contain_text(re.compile(r"joint_3.*….*since 10 Jan 2026"))
    assert joints.last.bounding_box()["y"] < 844  # on the first screen
