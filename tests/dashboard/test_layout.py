"""Every view at seven widths: titles, controls and tap targets fit; type comes in few sizes and weights."""

from __future__ import annotations

from support.browsing import VIEWS

WIDTHS = (360, 390, 650, 820, 960, 1280, 1440)  # px
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


def test_every_view_fits_seven_widths_with_few_sizes_of_type(visit, stored):
    visited = visit("desktop")  # a mouse: the smallest targets
    page = visited.page
    faults: dict[str, list[str]] = {}
    pairs: dict[int, set[str]] = {width: set() for width in WIDTHS}
    for view in VIEWS:
        page.set_viewport_size({"width": 1440, "height": 1000})
        visited.go(view.format(**vars(stored)))
        visited.settle()
        page.evaluate("document.querySelectorAll('details:not(.display)').forEach((e) => { e.open = true; })")
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 1000})
            if found := page.evaluate(FAULTS):
                faults[f"{view} at {width} px"] = found
            pairs[width] |= set(page.evaluate(PAIRS))
    assert faults == {}
    for seen in pairs.values():
        assert len(seen) <= MOST_PAIRS, sorted(seen)
        assert len({pair.split()[0] for pair in seen}) <= MOST_SIZES
        assert len({pair.split()[1] for pair in seen}) <= MOST_WEIGHTS
