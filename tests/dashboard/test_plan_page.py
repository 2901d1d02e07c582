"""A campaign planned on the page, its postures, and the file to fill in."""

import json
import re

from playwright.sync_api import expect
from support.api import post

from jointstiff.simulator import LOAD_POINT, TARGETS


def test_from_a_robot_to_postures(visit, api, stored):
    """Fill in the form, plan, and look at a posture; *Measure* takes the plan along."""
    page = visit("tablet", view=f"#/robots/{stored.robot}").page
    page.get_by_role("link", name="Plan a campaign").click()
    in_mm = "\n".join(f"{name} {' '.join(f'{1e3 * x:g}' for x in place)}" for name, place in TARGETS.items())
    page.get_by_label("Targets:").fill("P1 one two")
    expect(page.get_by_text("is not understood")).to_be_visible()
    page.get_by_label("Targets:").fill(in_mm)
    page.get_by_label("Load", exact=True).select_option(label="Force in any direction")
    page.get_by_label("Force [N]").fill("1500")
    page.get_by_label("Load point").fill(" ".join(f"{1e3 * x:g}" for x in LOAD_POINT))
    page.get_by_label("Number of readings").fill("10")
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("Certified: at least")).to_be_visible()
    plan = api.get(f"/v1/plans/{page.url.rsplit('/', 1)[1]}").json()
    labels = [each["label"] for each in plan["result"]["readings"]]

    expect(page.get_by_role("heading", name=f"Posture {labels[0]}")).to_be_visible()
    page.locator("canvas[data-ready=true]").wait_for()
    page.get_by_role("button", name=f"Show {labels[4]}").click()
    expect(page.get_by_role("heading", name=f"Posture {labels[4]}")).to_be_visible()
    page.get_by_role("link", name="Measure live", exact=True).click()
    expect(page.get_by_text("Robot, targets, loads and surroundings are those of the plan.")).to_be_visible()


def test_a_campaign_goes_on(visit, stored):
    """Plan from a set: what is left empty is the campaign's, and the file to fill in has its readings."""
    page = visit("phone", view=f"#/sets/{stored.set}").page
    page.locator("summary", has_text="More").click()
    page.get_by_role("link", name="Plan next readings").click()
    page.get_by_label("Number of readings").fill("4")
    page.get_by_label("joint_1").uncheck()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("Certified: at least")).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("button", name="Campaign to fill in").click()
    observations = json.loads(download.value.path().read_text())["observations"]
    assert len(observations) == 12 + 4
    assert observations[0]["readings"][0]["loaded"] is not None
    assert observations[-1]["readings"][0]["loaded"] is None


def test_a_plan_after_a_run_omits_what_the_run_omits(visit, api, stored):
    run = post(api, "/v1/runs", {"measurement_set_id": stored.set, "leave_out": ["c03"]})["id"]
    page = visit("tablet", view=f"#/plans?set={stored.set}&run={run}").page
    expect(page.get_by_text("As in the run so far: without c03.")).to_be_visible()
    page.get_by_label("Number of readings").fill("4")
    page.get_by_label("joint_1").uncheck()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("Certified: at least")).to_be_visible()
    plan = api.get(f"/v1/plans/{page.url.rsplit('/', 1)[1]}").json()
    assert plan["request"]["leave_out"] == ["c03"]


def test_a_weight_plans_what_it_twists_and_a_refusal_says_what_to_change(visit, stored):
    page = visit("tablet", view="#/plans").page
    expect(page.get_by_role("button", name="Plan", exact=True)).to_be_disabled()
    page.get_by_label("Robot or measurement set").select_option(f"robot:{stored.robot}")
    expect(page.get_by_label("Force [N]")).to_have_value("1500")  # as in the robot's newest campaign
    expect(page.get_by_label("Load point:")).to_have_value("-60, 20, 180")
    expect(page.get_by_label("Targets:")).to_have_value(re.compile(r"^P10,? 14[67]"))  # as read
    page.get_by_label("Load", exact=True).select_option(label="Dead weight")  # others in a newer campaign
    page.get_by_label("Load point:").fill("")
    page.get_by_label("Targets:").fill("P1 100 0 50")
    page.get_by_label("Force [N]").fill("900")
    page.get_by_label("joint_2").uncheck()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("twists joint_1").first).to_be_visible()
    page.get_by_label("joint_2").check()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("twists joint_1, joint_6").first).to_be_visible()
