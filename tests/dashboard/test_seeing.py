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
    "/report",
    "}/map",
    "/program",
    "/predict",
    "/new",
    "plans?robot={robot}",
    "?set={set}",
    "of-this-name",
    "compare/methods",
    "compare/pairs",
    "#/geometries",
)
"""Views that ask, or hand out files: they have no number of their own to show first."""
LONG = "an arm of the third cell beside the paint shop, refitted in the spring"
DRAWN = """async () => {
  const drawings = () => [...document.querySelectorAll("svg[width]")];
  const widths = () => drawings().map((svg) => svg.getAttribute("width")).join();
  for (let [before, same] = ["", 0]; same < 3; ) {
    await new Promise((done) => requestAnimationFrame(done));
    same = widths() === before ? same + 1 : 0;
    before = widths();
  }
}"""
"""Wait until charts have the width of their place for some frames."""


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


WRONG = """
<main><table>
<thead><tr><th>Stiffness</th>
<th style="overflow: hidden; max-width: 20px; white-space: nowrap">Standard uncertainty [mm]</th></tr></thead>
<tbody><tr style="height: 90px"><td>3.25</td><td>0.17</td></tr></tbody></table>
<p style="position: relative; top: -60px; margin: 0">words over a number</p></main>
"""


def test_faults_are_seen(visit):
    page = visit("desktop").page
    page.set_content(WRONG)
    page.evaluate(LOOK)
    found = "\n".join(page.evaluate("seeing(false, 44, 10)"))
    for fault in (
        "overlap",
        'no unit beside "3.25"',
        "is cut off",
        "a row of 9",
        "the first number stands at",
    ):
        assert fault in found, found
    assert '"0.17"' not in found.split("overlap")[-1]  # its head has the unit


MOST_PAIRS = 6  # of size and weight
MOST_SIZES, MOST_WEIGHTS = 5, 3
FAULTS = """() => {
  const faults = [];
  const wide = document.documentElement.scrollWidth;
  if (wide > innerWidth) faults.push(`the view is ${wide} px wide`);
  const title = document.querySelector("h1");
  const room = title.getBoundingClientRect();
  const lines = room.height / parseFloat(getComputedStyle(title).lineHeight);
  if (lines > 3.1) faults.push(`the title has ${lines.toFixed(1)} lines`);
  if (room.width < Math.min(300, innerWidth - 60)) faults.push(`the title is ${room.width} px wide`);
  const scrolls = (element) => {
    for (let box = element.parentElement; box; box = box.parentElement) {
      if (["auto", "scroll"].includes(getComputedStyle(box).overflowX) && box !== document.body) return true;
    }
    return false;
  };
  const inLabel = "label.option, label.toggle, label.pick";
  const all = `a, button, select, summary, textarea, input, ${inLabel}`;
  for (const control of document.querySelectorAll(all)) {
    if (!control.checkVisibility() || control.closest(".skip, .hidden")) continue;
    if (control instanceof HTMLInputElement && control.closest(inLabel)) continue;
    const {width, height, left, right} = control.getBoundingClientRect();
    const name = control.outerHTML.slice(0, 120);
    if (width < 39.5 || height < 39.5) faults.push(`${width} x ${height} px to tap: ${name}`);
    const beyond = left < -0.5 || right > innerWidth + 0.5;
    if (beyond && !scrolls(control)) faults.push(`beyond the screen: ${name}`);
    const {scrollWidth, clientWidth, scrollHeight, clientHeight} = control;
    const cut = scrollWidth > clientWidth + 1 || scrollHeight > clientHeight + 1;
    const holds = ".button, .tabs a, .sections a, summary, label.option, label.toggle";
    if (cut && control.matches(holds)) faults.push(`cut off: ${name}`);
  }
  for (const words of document.querySelectorAll("p, dd, h2, h3, td, .legend li, .angles span")) {
    const apart = words.closest(".scroll, .hidden, .scene-labels");
    if (apart || !words.checkVisibility() || words.getBoundingClientRect().right <= innerWidth + 1) continue;
    faults.push(`words beyond the screen: ${words.outerHTML.slice(0, 120)}`);
  }
  return faults;
}"""
PAIRS = """() => {
  const pairs = new Set();
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (!walker.currentNode.textContent.trim() || !element.checkVisibility()) continue;
    const {fontSize, fontWeight} = getComputedStyle(element);
    pairs.add(`${fontSize} ${fontWeight}`);
  }
  return [...pairs].sort();
}"""


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
                page.evaluate(DRAWN)
                seen = page.evaluate("(limits) => seeing(...limits)", limits(view, width, media))
                for fault in seen + (page.evaluate(FAULTS) if media == "light" else []):
                    faults.setdefault(f"{view}: {fault}", []).append(f"{width} {media}")
            pairs[width] |= set(page.evaluate(PAIRS))
    assert not faults, "\n".join(f"{fault} at {at}" for fault, at in faults.items())
    for found in pairs.values():
        assert len(found) <= MOST_PAIRS, sorted(found)
        assert len({pair.split()[0] for pair in found}) <= MOST_SIZES
        assert len({pair.split()[1] for pair in found}) <= MOST_WEIGHTS


CHECK = """async (rules) => {
  const found = await axe.run(document, {resultTypes: ["violations"], ...rules});
  return found.violations.filter((v) => ["serious", "critical"].includes(v.impact)).map((v) =>
    v.id + ": " + v.nodes.slice(0, 3).map((n) => n.html + " " + n.failureSummary).join("\\n"));
}"""
COLOURS = {"runOnly": {"type": "rule", "values": ["color-contrast", "link-in-text-block"]}}
"""All that differs between the themes."""
SMALL = """() => [...document.querySelectorAll("a, button, select, summary, input:not(.hidden)")]
  .filter((e) => e.offsetParent !== null && !e.closest(".skip, label.option, label.toggle"))
  .filter((e) => !(e instanceof HTMLInputElement && ["checkbox", "radio"].includes(e.type)))
  .map((e) => [e, e.getBoundingClientRect()])
  .filter(([e, box]) => box.height < 44 - 0.5 || box.width < 44 - 0.5)
  .map(([e, box]) => `${e.outerHTML.slice(0, 120)} ${box.width} x ${box.height}`)"""


def faults_of(page):
    """What axe-core finds in light, and of the colours in dark; small targets."""
    page.emulate_media(color_scheme="light")
    faults = page.evaluate(CHECK, {})
    page.emulate_media(color_scheme="dark")
    faults += [f"dark: {fault}" for fault in page.evaluate(CHECK, COLOURS)]
    return faults + page.evaluate(SMALL)


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
        faults = faults_of(page)
        if faults:
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
