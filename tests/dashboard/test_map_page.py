"""A map on the page: made from a run, looked at in slices, with another run beside it."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect


def test_from_a_run_to_the_numbers_of_a_place(visit, stored, api):
    visited = visit("tablet")
    page = visited.page
    visited.go(f"#/runs/{stored.run}/map")
    expect(page.get_by_label("Process force on the robot [N]")).not_to_have_value("")
    page.get_by_label("Places along x, y, z").fill("5, 15, 2")
    page.get_by_role("button", name="Make the map").click()
    expect(page).to_have_url(re.compile("#/maps/"))
    made = page.url.rsplit("/", 1)[1]
    counts = api.get(f"/v1/maps/{made}").json()["result"]["counts"]
    expect(page.get_by_text(f"{counts['reached']} of 150 places reached")).to_be_visible()
    assert counts["reached"] > 0


def test_a_place_is_tapped_and_compared_with_another_run(visit, stored, api):
    visited = visit("tablet")
    page = visited.page
    visited.go(f"#/maps/{stored.map}")
    worst = api.get(f"/v1/maps/{stored.map}").json()["result"]["worst"]
    slices = page.get_by_role("img", name="Slice at z")
    expect(slices).to_have_count(1)
    shown = page.locator(".slices dd").first
    expect(shown).to_have_text(re.compile(f"^{worst['deflection'] * 1e6:.4g}"[:4]))
    before = shown.text_content()
    box = slices.bounding_box()
    slices.tap(position={"x": 60, "y": box["height"] / 2})
    expect(shown).not_to_have_text(before)
    slices.press("ArrowRight")
    page.locator("canvas[data-ready=true]").wait_for()
    chosen = page.get_by_label("Beside it").locator("option").nth(1).get_attribute("value")
    page.get_by_label("Beside it").select_option(chosen)
    expect(slices).to_have_count(2)
    page.get_by_role("radio", name="Compliance along the force").check(force=True)
    expect(page.locator(".ramp-legend")).to_contain_text("µm/N")


@pytest.mark.parametrize("extension", ["csv", "npz"])
def test_it_is_downloaded(visit, stored, extension):
    visited = visit("desktop")
    visited.go(f"#/maps/{stored.map}")
    with visited.page.expect_download() as download:
        visited.page.get_by_role("link", name=extension, exact=False).click()
    assert download.value.suggested_filename == f"map-{stored.map}.{extension}"
