"""The verdict of a run on the pages and in the lists of what is made from it; the page asks first."""

import re

import pytest
from playwright.sync_api import expect
from support.api import posted
from support.browsing import campaign


@pytest.fixture(scope="module")
def unusable(api):
    """A run whose columns of two joints are exchanged, on a robot of its own."""
    document = campaign(load="pull", configurations=12, seed=8)
    for observation in document["measurement_set"]["observations"]:
        joints = observation["joints"]
        joints[1], joints[2] = joints[2], joints[1]
    return posted(api, document)["id"]


def test_the_page_asks_before_it_maps(visit, unusable):
    visited = visit("tablet")
    page, said = visited.page, []
    answers = iter([False, True])

    def answer(dialog):
        said.append(dialog.message)
        dialog.accept() if next(answers) else dialog.dismiss()

    page.on("dialog", answer)
    visited.go(f"#/runs/{unusable}/map")
    page.get_by_label("Places along x, y, z").fill("3, 3, 1")
    page.get_by_role("button", name="Make the map").click()
    expect(page.get_by_text("the verdict on run")).to_be_visible()
    page.get_by_role("button", name="Make the map").click()
    expect(page).to_have_url(re.compile("#/maps/"))
    assert len(said) == 2
    assert "joint_2" in said[0]
    assert "Continue anyway?" in said[0]
    expect(page.locator(".head .badge")).to_have_text("Do not use")
    expect(page.get_by_role("region", name="Assessment")).to_contain_text("joint_2")
    expect(page.get_by_text("Computed despite this verdict.")).to_be_visible()
    visited.go(f"#/runs/{unusable}/map")
    listed = page.locator(".list")
    expect(listed.locator(".badge.do_not_use")).to_have_count(1)
    listed.get_by_label("Verdict").select_option("use")
    expect(listed.locator(".item")).to_have_count(0)


def test_carried_verdicts_stand_on_their_pages(visit, stored, api):
    verdict = api.get(f"/v1/runs/{stored.run}").json()["result"]["assessment"]["verdict"]
    visited = visit("tablet")
    program = api.get("/v1/programs").json()["items"][0]["id"]
    judged = api.get(f"/v1/programs/{program}").json()["result"]["assessment"]
    for address in (
        f"#/maps/{stored.map}",
        f"#/plans/{stored.plan}",
        f"#/programs/{program}",
        f"#/compare/methods/{stored.pair}",
        f"#/compare/methods/{stored.comparison}",
    ):
        visited.go(address)
        expect(visited.page.locator(".head .badge")).to_have_count(1)
        if "pairs" not in address and "methods" not in address:
            own = judged["verdict"] if "programs" in address else verdict  # a program has reasons of its own
            expect(visited.page.locator(f".head .badge.{own}")).to_have_count(1)


def test_runs_are_filtered_by_verdict(visit, unusable):
    page = visit("desktop", view="#/runs").page
    page.get_by_label("Verdict").select_option("do_not_use")
    expect(page.locator(".badge.do_not_use").first).to_be_visible()
    expect(page.locator(".badge.use")).to_have_count(0)
    expect(page).to_have_url(re.compile("verdict=do_not_use"))
