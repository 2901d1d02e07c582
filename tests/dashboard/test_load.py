"""What the page weighs, and whom it asks; its types, made from the service as it is now."""

import pytest
from support.browsing import DASHBOARD, run_npm

FIRST_BUDGET = 90_000
"""Bytes over the wire, bodies and headers, of all that the first look at a result loads."""
BUDGET = 245_000
"""The same with the 3D view."""


def test_first_load_of_a_result_is_small_and_asks_no_one_else(visit, stored):
    visited = visit("tablet")
    policy_breaches = []
    visited.page.on(
        "console", lambda m: policy_breaches.append(m.text) if "Content Security" in m.text else None
    )
    sizes: dict[str, int] = {}

    def weigh(request):
        if request.url.startswith("http"):
            size = request.sizes()
            sizes[request.url] = size["responseBodySize"] + size["responseHeadersSize"]

    visited.page.on("requestfinished", weigh)
    visited.go(f"#/runs/{stored.run}")
    visited.page.get_by_role("table", name="Joint stiffness").wait_for()
    visited.page.wait_for_load_state("networkidle")
    plain = sum(sizes.values())
    visited.page.get_by_role("link", name="3D view").click()
    visited.page.locator("canvas[data-ready=true]").wait_for()
    visited.page.wait_for_load_state("networkidle")
    for _ in range(100):  # its weight may be told after it is drawn
        if any("stage" in url for url in sizes):
            break
        visited.page.wait_for_timeout(50)
    total = sum(sizes.values())
    print(f"first load of the result {plain} B, with the 3D view {total} B")  # noqa: T201
    assert any("stage" in url for url in sizes)
    assert 60_000 < plain <= FIRST_BUDGET
    assert plain + 100_000 < total <= BUDGET
    assert policy_breaches == []


@pytest.mark.slow
def test_types_of_the_api_are_made_anew(node_modules):
    """`scripts/check` compiles them."""
    types = DASHBOARD / "src" / "api" / "schema.d.ts"
    types.write_text("export interface components { schemas: {} }", encoding="utf-8")  # of another service
    done = run_npm("run", "--silent", "precheck")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "MeasurementSet" in types.read_text(encoding="utf-8")
