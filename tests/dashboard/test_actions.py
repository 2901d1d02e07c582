"""What an assessment advises is one button away: it does that and nothing else, and shows what came of it."""

import math
import re
from copy import deepcopy

import pytest
from playwright.sync_api import expect
from support.api import post
from support.browsing import campaign

from jointstiff.simulator.campaign import TARGETS


@pytest.fixture(scope="module")
def readings():
    """A clean set under pulls, with the places of its targets on the flange."""
    document = campaign(load="pull", configurations=19, seed=8)["measurement_set"]
    return {**document, "flange_targets": {name: list(place) for name, place in TARGETS.items()}}


def zeroed_elsewhere(document):
    for observation in document["observations"]:
        observation["joints"][2] += math.pi / 2


def moved(document):
    """All targets of an observation, as by another load."""
    for reading in document["observations"][4]["readings"]:
        reading["loaded"][0] += 8e-4


def bumped(document):
    """One target of an observation."""
    document["observations"][4]["readings"][0]["loaded"][0] += 8e-4


def heavy(document):
    """Nothing is wrong, but K_c matters."""
    document |= campaign(load="dead_weight", configurations=19, force=4000.0, seed=8)["measurement_set"]


CASES = {
    "Repeat with Huber loss": (moved, {"loss": "huber"}),
    "Omit c05 and repeat": (bumped, {"leave_out": ["c05"]}),
    "Include K_c": (heavy, {"complementary_stiffness": "included"}),
    "Use the suggested joint map": (zeroed_elsewhere, {}),
}


@pytest.fixture(scope="module")
def runs(api, stored, readings):
    """A run of each case, by its button, without K_c."""

    def run(change):
        document = deepcopy(readings)
        change(document)
        document |= {"name": change.__name__, "robot_id": stored.robot}
        made = post(api, "/v1/measurement-sets", document)["id"]
        asked = {"measurement_set_id": made, "complementary_stiffness": "neglected"}
        return post(api, "/v1/runs", asked)

    return {button: run(change) for button, (change, _) in CASES.items()}


@pytest.mark.parametrize("button", list(CASES))
def test_a_button_does_what_the_reason_advises(visit, api, runs, button):
    before, options = runs[button], CASES[button][1]
    page = visit("desktop", view=f"#/runs/{before['id']}").page
    page.get_by_role("region", name="Assessment").get_by_role("button", name=button).first.click()
    beside = page.get_by_role("region", name="Before and after")
    expect(beside).to_be_visible()
    expect(beside.get_by_role("row").filter(has_text="Verdict")).to_contain_text(re.compile("Use"))
    after = api.get(f"/v1/runs/{page.url.rsplit('/', 1)[1]}").json()
    request = after["request"]
    assert request["variant_of"] == before["id"]
    assert request | {"variant_of": None, "measurement_set_id": ""} == before["request"] | options | {
        "measurement_set_id": ""
    }
    done = {reason["code"] for reason in before["result"]["assessment"]["reasons"]} - {
        reason["code"] for reason in after["result"]["assessment"]["reasons"]
    }
    assert done, "the reason that was acted on is gone"
    beside.get_by_role("link", name="Before").click()
    expect(page.get_by_role("button", name=button).first).to_be_visible()


def test_a_reason_shows_its_posture_in_3d_and_leads_back(visit, runs):
    run = runs["Repeat with Huber loss"]["id"]
    page = visit("desktop", view=f"#/runs/{run}").page
    page.get_by_role("region", name="Assessment").get_by_role("link", name="Show c05 in 3D").first.click()
    page.locator("canvas[data-ready=true]").wait_for()
    expect(page.get_by_text("5 of 19")).to_be_visible()
    page.locator(".back").click()
    expect(page.get_by_role("table", name="Joint stiffness")).to_be_visible()
