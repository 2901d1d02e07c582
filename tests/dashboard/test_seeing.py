"""Every view as eyes see it: at seven widths, in light, in dark, on paper; `seeing.js` has the faults."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.browsing import VIEWS

LOOK = Path(__file__).with_name("seeing.js").read_text(encoding="utf-8")
WIDTHS = (360, 390, 650, 820, 1024, 1280, 1440)  # px
MEDIA = {"light": ("screen", "light"), "dark": ("screen", "dark"), "print": ("print", "light")}
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


def test_every_view_can_be_read(visit, stored, long_names):
    visited = visit("desktop")
    page = visited.page
    faults: dict[str, list[str]] = {}
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
                page.emulate_media(media=medium, color_scheme=scheme)
                page.evaluate(DRAWN)
                for fault in page.evaluate("(limits) => seeing(...limits)", limits(view, width, media)):
                    faults.setdefault(f"{view}: {fault}", []).append(f"{width} {media}")
    assert not faults, "\n".join(f"{fault} at {at}" for fault, at in faults.items())


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
