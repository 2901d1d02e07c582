"""The 3D view: what a frame costs in script, and that nothing is drawn when nothing happens."""

import pytest
from playwright.sync_api import expect

FRAMES = "performance.getEntriesByName('jointstiff.frame').map((m) => m.duration)"


def test_nothing_is_drawn_while_nothing_happens(visit, stored):
    visited = visit("tablet")
    visited.go(f"#/runs/{stored.run}/robot")
    visited.page.locator("canvas[data-ready=true]").wait_for()
    visited.settle()
    visited.page.wait_for_timeout(300)
    visited.page.evaluate("performance.clearMeasures()")
    visited.page.wait_for_timeout(300)
    assert visited.page.evaluate(FRAMES) == []


def test_a_device_without_3d_graphics_gets_drawings(visit, stored):
    visited = visit("phone")
    visited.page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    visited.go(f"#/runs/{stored.run}/robot")
    expect(visited.page.get_by_text("This device does not support 3D graphics")).to_be_visible()
    assert visited.page.locator("svg.posture").count() == 1
    visited.faults.clear()  # three says so on the console


@pytest.mark.slow
def test_changes_of_3d_views_leave_nothing_behind(visit, stored):
    """Heap, nodes and listeners after 50 changes to and from 3D are at most 1.2 times the first."""
    visited = visit("tablet")
    page = visited.page
    measured = page.context.new_cdp_session(page)
    measured.send("Performance.enable")
    lost: list[str] = []
    page.on("console", lambda m: lost.append(m.text) if "WebGL contexts" in m.text else None)

    def change(times: int) -> dict[str, float]:
        for _ in range(times):
            for part in ("robot", "deflection"):
                page.evaluate(f"location.hash = '#/runs/{stored.run}/{part}'")
                page.locator("canvas[data-ready=true]" if part == "robot" else "svg.chart").first.wait_for()
        page.wait_for_timeout(500)
        for _ in range(2):
            measured.send("HeapProfiler.collectGarbage")
        metrics = {each["name"]: each["value"] for each in measured.send("Performance.getMetrics")["metrics"]}
        return {name: metrics[name] for name in ("JSHeapUsedSize", "Nodes", "JSEventListeners")}

    visited.go(f"#/runs/{stored.run}/deflection")
    first, last = change(5), change(25)
    print(first, last)  # noqa: T201
    assert lost == []
    assert {name: last[name] / first[name] for name in first if last[name] > 1.2 * first[name]} == {}
