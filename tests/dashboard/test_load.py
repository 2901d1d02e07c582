"""What the page weighs, and whom it asks."""

from __future__ import annotations

import gzip

BUDGET = 250_000
"""Bytes, gzipped, of all that the first look at a result loads, the 3D view's code included."""


def test_first_load_of_a_result_is_small_and_asks_no_one_else(visit, stored):
    visited = visit("tablet")
    policy_breaches = []
    visited.page.on(
        "console", lambda m: policy_breaches.append(m.text) if "Content Security" in m.text else None
    )
    sizes: dict[str, int] = {}

    def weigh(response):
        if response.ok and response.url.startswith("http"):
            sizes[response.url] = len(gzip.compress(response.body(), 6))

    visited.page.on("response", weigh)
    visited.go(f"#/runs/{stored.run}")
    visited.page.get_by_role("table", name="Joint stiffness").wait_for()
    plain = sum(sizes.values())
    visited.page.get_by_role("link", name="3D view").click()
    visited.page.locator("canvas[data-ready=true]").wait_for()
    visited.page.wait_for_load_state("networkidle")
    total = sum(sizes.values())
    print(f"first load of the result {plain} B, with the 3D view {total} B gzipped")  # noqa: T201
    assert any("stage" in url for url in sizes)
    assert plain < total <= BUDGET
    assert policy_breaches == []


def test_the_policy_of_the_page_is_strict(api):
    policy = api.get("/").headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
