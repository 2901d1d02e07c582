"""Type and titles on every view: few sizes and weights, and no title squeezed by the buttons beside it."""

from __future__ import annotations

from support.browsing import VIEWS

WIDTHS = (390, 650, 700, 768, 820, 900, 960, 1440)
MOST_PAIRS = 6
LEAST_TITLE = 300  # px
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


def test_titles_keep_their_width(visit, stored):
    visited = visit("tablet upright")
    page = visited.page
    squeezed = []
    for view in VIEWS:
        visited.go(view.format(**vars(stored)))
        visited.settle()
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 1000})
            room = page.locator("h1").bounding_box()["width"]
            if room < LEAST_TITLE:
                squeezed.append(f"{view} at {width} px: {room}")
    assert squeezed == []


def test_type_has_a_small_scale(visit, stored):
    visited = visit("desktop")
    pairs: set[str] = set()
    for view in VIEWS:
        visited.go(view.format(**vars(stored)))
        visited.settle()
        visited.page.evaluate("document.querySelectorAll('details').forEach((e) => { e.open = true; })")
        pairs |= set(visited.page.evaluate(PAIRS))
    assert len(pairs) <= MOST_PAIRS, sorted(pairs)
