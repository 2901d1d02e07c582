"""A weight step from its plan on the page to its result: postures, both angles, what is missing."""

import re

import numpy as np
import pytest
from playwright.sync_api import Page, expect
from support.api import post
from support.weight_steps import ARM_LOAD, PLACE, build_arm

from jointstiff.simulator.document import robot_document
from jointstiff.simulator.weight_step import SteppedArm

ARM = build_arm(is_cobot=False)
JOINTS = ("joint_2", "joint_3")
POSTURES = 5
SOON = 60_000  # ms


@pytest.fixture(scope="module")
def robot(api):
    """A robot for weight steps."""
    return post(api, "/v1/robots", robot_document(ARM) | {"name": "arm with two encoders"})["id"]


@pytest.fixture(scope="module")
def plan(api, robot):
    """A plan of a weight step of a few postures."""
    body = {
        "robot_id": robot,
        "weight_step": {"mass": ARM_LOAD, "mass_uncertainty": 0.1, "point_uncertainty": 0.002},
        "load_point": PLACE.tolist(),
        "joints": JOINTS,
        "readings": POSTURES,
        "candidates": 100,
    }
    made = api.post("/v1/plans?wait=60", json=body).json()
    assert made["state"] == "succeeded", made
    return made


def fill_posture(page: Page, posture: dict, *, loaded: bool, of_link: float = 1.0) -> None:
    """Type both angles of each joint from both sides, as springs have them; the link's times a factor."""
    stepped = SteppedArm(ARM, ARM_LOAD, PLACE, np.zeros(6))
    motor = np.array([posture["joints"]])
    link = stepped.link_angles(motor, loaded=loaded)
    for joint in JOINTS:
        index = ARM.joint_names.index(joint)
        for side in "+−":
            for encoder, angle in (("Motor", motor[0, index]), ("Link", of_link * link[0, index])):
                box = page.get_by_label(f"{joint} {side}, {encoder} [°]", exact=True)
                box.fill(f"{np.degrees(angle):.7f}")


def go_to(page: Page, posture: dict, state: str) -> None:
    """Choose a posture in a state."""
    page.get_by_role("button", name=re.compile(f"^{posture['label']}, {state}")).click()
    page.get_by_role("heading", name=f"Posture {posture['label']}", exact=True).wait_for()


def widest(page: Page) -> int:
    """Return by how many pixels the view is wider than the window."""
    return page.evaluate("document.documentElement.scrollWidth - innerWidth")


def test_a_weight_step_is_planned_on_the_page(visit, robot):
    page = visit("desktop", view="#/gearboxes").page
    page.get_by_role("link", name="Plan a weight step").click()
    page.get_by_label("Robot or measurement set", exact=True).select_option(f"robot:{robot}")
    page.get_by_label("Mass of the load [kg]", exact=True).fill("100")
    page.get_by_label("Standard uncertainty of the mass [kg]", exact=True).fill("0.1")
    go = page.get_by_role("button", name="Plan", exact=True)
    expect(go).to_be_disabled()
    page.get_by_label(re.compile("^Centre of mass of the load")).fill("0, 0, 150")
    expect(page.get_by_label(re.compile("^Targets"))).to_have_count(0)
    for joint in set(ARM.joint_names) - set(JOINTS):
        page.get_by_label(joint, exact=True).uncheck()
    go.click()
    page.get_by_role("link", name="Read the encoders").click(timeout=SOON)
    expect(page.get_by_role("button", name=re.compile("^p12, With the load"))).to_be_visible()
    expect(page.get_by_label("Mass of the load [kg]", exact=True)).to_have_value("100")


@pytest.mark.parametrize("size", ["phone", "desktop"])
def test_a_planned_weight_step_is_read_posture_after_posture(visit, api, plan, size):
    page = visit(size, view=f"#/gearboxes?plan={plan['id']}").page
    identify = page.get_by_role("button", name="Identify the gearboxes")
    postures = plan["result"]["readings"]
    first = postures[0]["label"]
    expect(page.get_by_text("Missing: joint_2 +, joint_3 +, joint_2 −, joint_3 −.")).to_be_visible()
    for state in ("Without the load", "With the load"):
        for index, posture in enumerate(postures):
            expect(page.get_by_role("heading", name=f"Posture {posture['label']}")).to_be_visible()
            fill_posture(page, posture, loaded=state == "With the load")
            assert widest(page) <= 0
            is_last = index == POSTURES - 1
            if state == "With the load":
                expect(identify).to_be_enabled(enabled=index >= 3)
            if not is_last or state == "Without the load":
                page.get_by_role("button", name=re.compile("^Next: ")).click()
        expect(page.get_by_text("Nothing doubtful so far")).to_be_visible()
        if state == "Without the load":
            page.reload()  # what was typed is kept
            expect(page.get_by_role("button", name=f"{first}, Without the load: read")).to_be_visible()
            expect(page.get_by_role("button", name=f"{first}, With the load: 0 of 4")).to_be_visible()
    identify.click()
    page.get_by_role("heading", name="Gearboxes, motor to link encoder").wait_for(timeout=SOON)
    made = api.get(f"/v1/jobs/{page.url.rpartition('/')[2]}").json()
    for gearbox in made["result"]["gearboxes"]:
        true = ARM.stiffnesses[ARM.joint_names.index(gearbox["joint"])]
        lower, upper = gearbox["stiffness_interval"]
        assert lower <= true <= upper


def test_an_angle_that_is_missing_or_no_number_is_marked(visit, plan):
    page = visit("tablet", view=f"#/gearboxes?plan={plan['id']}").page
    posture = plan["result"]["readings"][0]
    fill_posture(page, posture, loaded=False)
    expect(page.get_by_text("All angles of this posture are read.")).to_be_visible()
    box = page.get_by_label("joint_3 −, Link [°]", exact=True)
    box.fill("12..5")
    expect(box).to_have_attribute("aria-invalid", "true")
    expect(page.get_by_text("Missing: joint_3 −.")).to_be_visible()
    expect(page.get_by_role("button", name=f"{posture['label']}, Without the load: 3 of 4")).to_be_visible()


def test_what_is_doubtful_is_said_at_the_reading_and_nothing_is_stored(visit, api, plan):
    """A reversed sign shows in the second posture, exchanged states when the load hangs."""
    page = visit("phone", view=f"#/gearboxes?plan={plan['id']}").page
    stored_before = api.get("/v1/jobs?kind=gearbox").json()["items"]
    doubts = page.get_by_role("region", name="Doubtful so far")
    postures = plan["result"]["readings"]
    expect(doubts).to_have_count(0)
    fill_posture(page, postures[0], loaded=True)
    expect(doubts).to_contain_text("Nothing doubtful so far")
    go_to(page, postures[1], "Without the load")
    fill_posture(page, postures[1], loaded=True, of_link=-1.0)
    expect(doubts).to_contain_text("no gearbox twists as much")
    expect(doubts).to_contain_text("the sign of the angle")
    fill_posture(page, postures[1], loaded=True)
    expect(doubts).to_contain_text("Nothing doubtful so far")
    for state in ("Without the load", "With the load"):
        for posture in postures:
            go_to(page, posture, state)
            fill_posture(page, posture, loaded=state == "Without the load")
    for joint in JOINTS:
        expect(doubts).to_contain_text(f"{joint}: it twists against the load")
    expect(doubts).to_contain_text("the states or the signs")
    assert widest(page) <= 0
    assert api.get("/v1/jobs?kind=gearbox").json()["items"] == stored_before


def test_a_plan_of_targets_has_no_weight_step_to_read(visit, stored):
    page = visit("tablet", view=f"#/gearboxes?plan={stored.plan}").page
    expect(page.get_by_text("This plan has no postures of a weight step.")).to_be_visible()


def test_readings_on_this_device_are_found_again_until_they_are_discarded(visit, plan):
    visited = visit("phone", view="#/gearboxes")
    page = visited.page
    go_on = page.get_by_role("link", name="Go on reading the encoders of arm with two encoders")
    expect(go_on).to_have_count(0)
    visited.go(f"#/gearboxes?plan={plan['id']}")
    page.get_by_label("joint_2 +, Motor [°]", exact=True).fill("12.3456")
    visited.go("#/gearboxes")
    go_on.click()
    expect(page.get_by_label("joint_2 +, Motor [°]", exact=True)).to_have_value("12.3456")
    page.get_by_role("button", name="Discard the readings").click()
    page.get_by_role("dialog").get_by_role("button", name="Continue").click()
    expect(page.get_by_label("joint_2 +, Motor [°]", exact=True)).to_have_value("")
    visited.go("#/gearboxes")
    page.get_by_role("heading", name="Gearboxes").wait_for()
    expect(go_on).to_have_count(0)
