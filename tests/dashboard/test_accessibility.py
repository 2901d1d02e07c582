"""Every view by axe-core, in light and dark: nothing serious, nothing critical; touch targets of 44 px."""

from playwright.sync_api import expect
from support.browsing import DASHBOARD, VIEWS

AXE = DASHBOARD / "node_modules" / "axe-core" / "axe.min.js"
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
    axe = AXE.read_text(encoding="utf-8")
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
