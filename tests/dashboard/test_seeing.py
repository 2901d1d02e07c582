"""Every view as eyes and fingers find it, at eight widths: light, dark, on paper, and by axe-core."""

import json
import re
import shutil
from pathlib import Path

import httpx2
import pytest
from playwright.sync_api import expect
from support import everything
from support.browsing import DASHBOARD, VIEWS
from support.processes import Service, alone

pytestmark = pytest.mark.timeout(900, func_only=True)
"""Building the database takes as long as it takes, and a width has some 220 looks."""
LOOK = Path(__file__).with_name("seeing.js").read_text(encoding="utf-8")
WIDTHS = (360, 390, 650, 820, 960, 1024, 1280, 1440)  # px
MEDIA = {"print": ("print", "light"), "dark": ("screen", "dark"), "light": ("screen", "light")}
BY_DAY = {390: ("dark", "light"), 820: ("print",), 1280: ("light",)}
PHONE, PAPER, DESK = 400, 650, 1000
"""A phone is at most this wide, paper and a desk at least [px]."""
ROW = {"phone": 72, "desk": 44}
"""Most that a row of a list or a table is high [px]."""
FIRST, FIRST_STIFFNESS = 400, 420
"""A phone shows the first number of a result, and the first stiffness of a run, within this height [px]."""
MOST_SHIFT = 0.1
"""Most that what is shown already moves while a view is loaded, as browsers measure layout shift."""
SHIFTS = """
window.shifted = 0;
new PerformanceObserver((list) => {
  for (const entry of list.getEntries()) if (!entry.hadRecentInput) window.shifted += entry.value;
}).observe({ type: "layout-shift", buffered: true });
"""
ASKING = (
    *("/report", "}/map", "/program", "/process", "/predict", "/new", "plans?robot={robot}", "?set={set}"),
    *("of-this-name", "compare/methods", "compare/pairs", "#/geometries", "#/fleets"),
    *("{cancelled}", "{deleted}", "{empty_map}", "{live_fresh}"),
)
"""Views that ask, hand out files, or have nothing to show: they have no number of their own to show first."""
IS_RUN = re.compile(r"#/runs/\{\w+\}$")


@pytest.fixture(scope="module")
def database(bundle: Path, shared_folder: Path) -> tuple[Path, dict[str, str]]:
    """A database of everything, and the ids in it by name; all workers of xdist share it."""
    folder = shared_folder / "everything"
    names = folder / "names.json"
    with alone(shared_folder / "everything.lock"):
        if not names.is_file():
            folder.mkdir(exist_ok=True)
            url = f"sqlite:///{folder / 'jointstiff.db'}"
            service = Service(url)
            try:
                with httpx2.Client(base_url=service.url, timeout=None) as client:
                    made = everything.fill(client, url)
            finally:
                service.stop()
            names.write_text(json.dumps(made), encoding="utf-8")
    return folder / "jointstiff.db", json.loads(names.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def site(database, tmp_path_factory):
    """A service of our own with a copy of that database."""
    copy = tmp_path_factory.mktemp("everything") / "jointstiff.db"
    for file in database[0].parent.glob("jointstiff.db*"):
        shutil.copy(file, copy.with_name(file.name))
    running = Service(f"sqlite:///{copy}")
    yield running
    running.stop()


@pytest.fixture
def stored(database):
    return database[1]


def limits_of_first(view: str, width: int) -> list[int]:
    """Return the most above the first number and above the first stiffness [px]; 0 for no limit."""
    if width > PHONE or view == "#/" or view.endswith(ASKING):
        return [0, 0]
    return [0, FIRST_STIFFNESS] if IS_RUN.match(view) else [FIRST, 0]


def limits(width: int, media: str) -> list[float | bool]:
    """Return whether it is paper, and the most height of a row [px]; 0 for no limit."""
    row = ROW["phone"] if width <= PHONE else ROW["desk"] if width >= DESK else 0
    return [media == "print" and width >= PAPER, 0 if media == "print" else row]


def test_faults_are_seen(visit):
    page = visit("desktop").page
    page.set_content(Path(__file__).with_name("seeing_faults.html").read_text(encoding="utf-8"))
    page.evaluate(LOOK)
    found = "\n".join(page.evaluate("[...seeing(false, 44), ...first(10, 10)]"))
    wanted = (
        *("overlap", 'no unit beside "3.25"', "is cut off", "a row of 9", "the first number stands at"),
        *('"do not use" is cut off by its box', "a heading of level 3 after one of level 1"),
        *("the first stiffness stands at", '"12 N·m" is cut off by its drawing'),
    )
    assert [fault for fault in wanted if fault not in found] == [], found
    assert '"0.17"' not in found.split("overlap")[-1]  # its head has the unit
    assert "with an ellipsis" not in found


OPENED = "document.querySelectorAll('details:not(.display)').forEach((e) => { e.open = true; })"
MOST_PAIRS = 6  # of size and weight
MOST_SIZES, MOST_WEIGHTS = 5, 3


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
def test_every_view_can_be_read_and_tapped_in_few_sizes_of_type(visit, stored, width, media_of_width):
    visited = visit("desktop")  # a mouse: the smallest targets
    page = visited.page
    page.add_init_script(SHIFTS)
    page.set_viewport_size({"width": width, "height": 844 if width <= PHONE else 1000})
    faults: dict[str, list[str]] = {}
    pairs: set[str] = set()
    for view in VIEWS:
        page.emulate_media(media="screen", color_scheme="light")
        visited.go(view.format(**stored))
        visited.settle()
        page.evaluate(LOOK)
        page.evaluate("drawn()")
        if (shift := page.evaluate("window.shifted")) > MOST_SHIFT:
            faults[f"{view}: what is shown moves by {shift:.2f}"] = ["loading"]
        for fault in page.evaluate("(limits) => first(...limits)", limits_of_first(view, width)):
            faults[f"{view}: {fault}"] = ["loading"]
        for media in media_of_width:
            medium, scheme = MEDIA[media]
            page.emulate_media(media=medium, color_scheme=scheme)
            page.evaluate(OPENED)
            page.evaluate("drawn()")
            seen = page.evaluate("(limits) => seeing(...limits)", limits(width, media))
            for fault in seen + (page.evaluate("ill()") if media == "light" else []):
                faults.setdefault(f"{view}: {fault}", []).append(media)
        page.emulate_media(media="screen", color_scheme="light")
        pairs |= set(page.evaluate("pairs()"))
    assert not faults, "\n".join(f"{fault} at {', '.join(at)}" for fault, at in faults.items())
    assert len(pairs) <= MOST_PAIRS, sorted(pairs)
    assert len({pair.split()[0] for pair in pairs}) <= MOST_SIZES
    assert len({pair.split()[1] for pair in pairs}) <= MOST_WEIGHTS


COLOURS = {"runOnly": {"type": "rule", "values": ["color-contrast", "link-in-text-block"]}}
"""All that differs between the themes."""


def faults_of(page):
    """What axe-core finds in light, and of the colours in dark; small targets."""
    page.emulate_media(color_scheme="light")
    faults = page.evaluate("check({})")
    page.emulate_media(color_scheme="dark")
    faults += [f"dark: {fault}" for fault in page.evaluate("(rules) => check(rules)", COLOURS)]
    return faults + page.evaluate("small()")


@pytest.mark.parametrize("half", [0, 1])
def test_every_view_is_accessible(visit, stored, node_modules, half):
    visited = visit("tablet")
    page = visited.page
    axe = (DASHBOARD / "node_modules" / "axe-core" / "axe.min.js").read_text(encoding="utf-8")
    found: dict[str, list[str]] = {}
    for view in VIEWS[half::2]:
        visited.go(view.format(**stored))
        visited.settle()
        page.evaluate("document.querySelectorAll('details').forEach((e) => { e.open = true; })")
        page.evaluate(axe)
        page.evaluate(LOOK)
        if faults := faults_of(page):
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
    page.get_by_label("Search").fill("check 0012")
    expect(page.locator(".rows .item")).to_have_count(1)
    expect(page.locator(".rows .item")).to_contain_text("KR 240 cell 12")


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
