"""Estimates on the page: one form everywhere, and grey where a number must not be used."""

import re
from dataclasses import fields
from functools import partial

import pytest
from playwright.sync_api import expect
from support.api import made, post
from support.browsing import VIEWS, Stored, campaign

STANDARD_UNCERTAINTY = re.compile(r"(?:^|[\s(])u\s?(?:=|\d)|std\. uncertainty|\d\(\d\d\)|\bU,", re.MULTILINE)
"""Ways to write a standard uncertainty, or an expanded one by its letter."""


@pytest.fixture(scope="module")
def refuted(api, stored):
    """A run not to be used, whose joints all have a number: its readings refute the stated noise."""
    document = campaign(load="pull", configurations=19, seed=8)["measurement_set"]
    document["noise"] = {"sigma": 0.001 if document["units"]["length"] == "mm" else 1e-6}
    set_id = post(api, "/v1/measurement-sets", {**document, "robot_id": stored.robot})["id"]
    body = {"measurement_set_id": set_id, "elasticity": "joints"}
    run = made(api, partial(api.post, "/v1/runs?wait=60", json=body))
    joints = api.get(f"/v1/jobs/{run}").json()["result"]["joints"]
    assert {joint["verdict"] for joint in joints} == {"do_not_use"}
    return run


STORED = {field.name for field in fields(Stored)}
"""Names of what is stored for all tests of the page."""


@pytest.mark.parametrize("view", [view for view in VIEWS if set(re.findall(r"{(\w+)}", view)) <= STORED])
def test_no_view_shows_a_standard_uncertainty(visit, stored, view):
    visited = visit("desktop", view=view.format(**vars(stored)))
    visited.settle()
    assert not STANDARD_UNCERTAINTY.findall(visited.page.locator("main").inner_text())


@pytest.mark.parametrize("view", ["#/runs/{run}", "#/compare/runs?ids={run},{other}"])
def test_a_number_that_must_not_be_used_is_never_bold_and_has_its_interval(visit, stored, refuted, view):
    visited = visit("desktop", view=view.format(run=refuted, other=stored.run))
    unusable = visited.page.locator(".estimate.unusable").filter(has_text=re.compile(r"\d"))
    expect(unusable).to_have_count(6)
    weights = unusable.evaluate_all(
        """(numbers) => numbers.flatMap((number) => [number, ...number.querySelectorAll("*")])
          .map((each) => Number(getComputedStyle(each).fontWeight))"""
    )
    assert max(weights) <= 400
    with_intervals = unusable.evaluate_all(
        """(numbers) => numbers.map((number) => (number.closest(".with-range, [role=row]")).textContent)"""
    )
    assert all(re.search(r"\d\s…\s\d", each) for each in with_intervals)


@pytest.mark.parametrize(
    "view", ["#/runs/{run}", "#/compare/runs?ids={run},{other}", "#/compare/methods/{pair}"]
)
def test_no_stiffness_is_without_its_interval_or_limit(visit, stored, refuted, view):
    visited = visit("desktop", view=view.format(other=refuted, **vars(stored)))
    visited.page.locator(".estimate, td").first.wait_for()
    numbers = visited.page.locator(".estimate").evaluate_all(
        """(numbers) => numbers.map((number) => [number.textContent,
          (number.closest("[role=row], tr") ?? number.closest(".with-range")).textContent])"""
    )
    for number, row in numbers:
        assert number.startswith(("–", ">", "<")) or "…" in row or "no interval" in row, (number, row)


def test_a_programs_after_has_its_band_and_says_what_the_band_includes(visit, stored):
    page = visit("desktop", view=f"#/corrections/{stored.program}").page
    chart = page.locator("figure", has=page.get_by_role("heading", name="Distance from the target along"))
    expect(chart.locator("path.band.as-corrected")).to_have_attribute("d", re.compile("M.+Z"))
    expect(chart.locator(".legend")).to_contain_text(
        re.compile(r"After: 95\s% interval, (with model error|readings only: the model error is unknown)")
    )
    facts = page.locator("dl.facts")
    expect(facts).to_contain_text(re.compile(r"After the correction.*\(.*…"))
    assert not page.locator("dl.facts").get_by_text("0.0 mm", exact=True).count()
