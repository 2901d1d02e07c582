"""Every view by axe-core, in light and dark: nothing serious, nothing critical; touch targets of 44 px."""

from __future__ import annotations

import pytest
from browsing import DASHBOARD, VIEWS

AXE = DASHBOARD / "node_modules" / "axe-core" / "axe.min.js"
CHECK = """async () => {
  const found = await axe.run(document, {resultTypes: ["violations"]});
  return found.violations.filter((v) => ["serious", "critical"].includes(v.impact)).map((v) =>
    v.id + ": " + v.nodes.slice(0, 3).map((n) => n.html + " " + n.failureSummary).join("\\n"));
}"""
SMALL = """() => [...document.querySelectorAll("a, button, select, summary, input:not(.hidden)")]
  .filter((e) => e.offsetParent !== null && !e.closest(".skip, label.option, label.toggle"))
  .filter((e) => !(e instanceof HTMLInputElement && ["checkbox", "radio"].includes(e.type)))
  .map((e) => [e, e.getBoundingClientRect()])
  .filter(([e, box]) => box.height < 44 - 0.5 || box.width < 44 - 0.5)
  .map(([e, box]) => `${e.outerHTML.slice(0, 120)} ${box.width} x ${box.height}`)"""


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_every_view_is_accessible(visit, stored, theme, node_modules):
    visited = visit("tablet", theme)
    page = visited.page
    axe = AXE.read_text(encoding="utf-8")
    found: dict[str, list[str]] = {}
    for view in VIEWS:
        visited.go(view.format(**vars(stored)))
        page.wait_for_load_state("networkidle")
        for closed in page.locator("details:not([open]) > summary:visible").all():
            closed.click()
        page.evaluate(axe)
        violations = page.evaluate(CHECK)
        small = page.evaluate(SMALL)
        if violations or small:
            found[view] = violations + small
    assert found == {}


def test_the_page_follows_the_switch_and_remembers_it(visit, stored):
    visited = visit("tablet", "light")
    visited.go("#/runs")
    page = visited.page
    ground = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(ground)
    page.get_by_label("Display").click()
    page.get_by_role("radio", name="Dark").check(force=True)
    assert page.evaluate(ground) != light
    visited.go("#/runs")
    assert page.evaluate(ground) != light


@pytest.mark.parametrize("size", ["phone", "tablet", "desktop"])
def test_no_view_is_wider_than_the_screen(visit, stored, size):
    visited = visit(size)
    for view in VIEWS:
        visited.go(view.format(**vars(stored)))
        visited.page.wait_for_load_state("networkidle")
        width = visited.page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        assert width[0] <= width[1], view


def test_one_can_skip_to_the_content(visit, stored):
    visited = visit("desktop")
    visited.go("#/runs")
    visited.page.keyboard.press("Tab")
    skip = visited.page.get_by_role("link", name="Skip to content")
    assert skip.evaluate("e => e === document.activeElement")
    assert skip.bounding_box()["y"] >= 0
    visited.page.keyboard.press("Enter")
    assert visited.page.evaluate("document.activeElement.id") == "content"
