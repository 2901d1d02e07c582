"""Every view as eyes and fingers find it, at eight widths: light, dark, on paper, and by axe-core."""

from pathlib import Path

import pytest
from playwright.sync_api import expect
from support.browsing import DASHBOARD, VIEWS

LOOK = Path(__file__).with_name("seeing.js").read_text(encoding="utf-8")
WIDTHS = (360, 390, 650, 820, 960, 1024, 1280, 1440)  # px
MEDIA = {"print": ("print", "light"), "dark": ("screen", "dark"), "light": ("screen", "light")}
BY_DAY = {"print": (650, 820, 1024), "dark": (WIDTHS[0], WIDTHS[-1]), "light": WIDTHS}
"""Widths by medium: paper is upright or lies across, and the dark changes colours only."""
PHONE, PAPER, DESK = 400, 650, 1000
"""A phone is at most this wide, paper and a desk at least [px]."""
ROW = {"phone": 72, "desk": 44}
"""Most that a row of a list or a table is high [px]."""
FIRST = 400
"""A phone shows the first number of a result within this height [px]."""
ASKING = (
    *("/report", "}/map", "/program", "/process", "/predict", "/new", "plans?robot={robot}", "?set={set}"),
    *("of-this-name", "compare/methods", "compare/pairs", "#/geometries", "#/fleets"),
)
"""Views that ask, or hand out files: they have no number of their own to show first."""
LONG = "an arm of the third cell beside the paint shop, refitted in the spring"


@pytest.fixture
def long_names(api, stored):
    """Give the robot and its sets names that are longer than their place."""
    assert len(LONG) >= 69
    places = [
        f"/v1/robots/{stored.robot}",
        *(f"/v1/measurement-sets/{s}" for s in (stored.set, stored.other_set)),
    ]
    before = {place: api.get(place).json()["name"] for place in places}
    for place in places:
        assert api.patch(place, json={"name": LONG}).status_code == 200
    yield
    for place, name in before.items():
        assert api.patch(place, json={"name": name}).status_code == 200


def limits(view: str, width: int, media: str) -> list[float | bool]:
    """Return whether it is paper, and the most height of a row and above the first number; 0 for no limit."""
    if media == "print":
        return [width >= PAPER, 0, 0]
    row = ROW["phone"] if width <= PHONE else ROW["desk"] if width >= DESK else 0
    shows = view != "#/" and not view.endswith(ASKING)
    return [False, row, FIRST if width <= PHONE and shows else 0]


def test_faults_are_seen(visit):
    page = visit("desktop").page
    page.set_content(Path(__file__).with_name("seeing_faults.html").read_text(encoding="utf-8"))
    page.evaluate(LOOK)
    found = "\n".join(page.evaluate("seeing(false, 44, 10)"))
    wanted = ("overlap", 'no unit beside "3.25"', "is cut off", "a row of 9", "the first number stands at")
    assert [fault for fault in wanted if fault not in found] == [], found
    assert '"0.17"' not in found.split("overlap")[-1]  # its head has the unit


MOST_PAIRS = 6  # of size and weight
MOST_SIZES, MOST_WEIGHTS = 5, 3


@pytest.mark.parametrize(
    "looked_at",
    [
        pytest.param(BY_DAY, id="by day"),
        pytest.param(dict.fromkeys(MEDIA, WIDTHS), id="each night", marks=pytest.mark.slow),
    ],
)
def test_every_view_can_be_read_and_tapped_in_few_sizes_of_type(visit, stored, long_names, looked_at):
    visited = visit("desktop")  # a mouse: the smallest targets
    page = visited.page
    faults: dict[str, list[str]] = {}
    pairs: dict[int, set[str]] = {width: set() for width in WIDTHS}
    for view in VIEWS:
        page.emulate_media(media="screen", color_scheme="light")
        page.set_viewport_size({"width": 1440, "height": 1000})
        visited.go(view.format(**vars(stored)))
        visited.settle()
        page.evaluate("document.querySelectorAll('details:not(.display)').forEach((e) => { e.open = true; })")
        page.evaluate(LOOK)
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 1000})
            for media, (medium, scheme) in MEDIA.items():
                if width not in looked_at[media]:
                    continue
                page.emulate_media(media=medium, color_scheme=scheme)
                page.evaluate("drawn()")
                seen = page.evaluate("(limits) => seeing(...limits)", limits(view, width, media))
                for fault in seen + (page.evaluate("ill()") if media == "light" else []):
                    faults.setdefault(f"{view}: {fault}", []).append(f"{width} {media}")
            pairs[width] |= set(page.evaluate("pairs()"))
    assert not faults, "\n".join(f"{fault} at {at}" for fault, at in faults.items())
    for found in pairs.values():
        assert len(found) <= MOST_PAIRS, sorted(found)
        assert len({pair.split()[0] for pair in found}) <= MOST_SIZES
        assert len({pair.split()[1] for pair in found}) <= MOST_WEIGHTS


COLOURS = {"runOnly": {"type": "rule", "values": ["color-contrast", "link-in-text-block"]}}
"""All that differs between the themes."""


def faults_of(page):
    """What axe-core finds in light, and of the colours in dark; small targets."""
    page.emulate_media(color_scheme="light")
    faults = page.evaluate("check({})")
    page.emulate_media(color_scheme="dark")
    faults += [f"dark: {fault}" for fault in page.evaluate("(rules) => check(rules)", COLOURS)]
    return faults + page.evaluate("small()")


def test_every_view_is_accessible(visit, stored, node_modules):
    visited = visit("tablet")
    page = visited.page
    axe = (DASHBOARD / "node_modules" / "axe-core" / "axe.min.js").read_text(encoding="utf-8")
    found: dict[str, list[str]] = {}
    for view in VIEWS:
        visited.go(view.format(**vars(stored)))
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
    page.get_by_role("radio", name="Dark").check(force=True)
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
