"""From the fleet to an alarm that is acknowledged, and to the run of a point by keyboard."""

import re
from dataclasses import replace

import numpy as np
from playwright.sync_api import expect
from support.api import post

from jointstiff.simulator import default_arm, simulate_campaign

SOFTENED = np.array([1.0, 1.0, 0.85, 1.0, 1.0, 1.0])


def test_from_the_fleet_to_an_acknowledged_alarm(visit, api):
    arm = default_arm()
    soft = replace(arm, stiffnesses=arm.stiffnesses * SOFTENED)
    documents = [
        simulate_campaign(each, load="pull", configurations=10, seed=seed)
        for seed, each in enumerate([arm, arm, arm, soft])
    ]
    robot = post(api, "/v1/robots", documents[0]["robot"] | {"name": "worn robot"})["id"]
    for month, document in enumerate(documents, start=1):
        noted = {"robot_id": robot, "measured_at": f"2026-{month:02d}-10T08:00:00Z", "serial_number": "W-1"}
        stored = post(api, "/v1/measurement-sets", document["measurement_set"] | noted)
        post(api, "/v1/runs", {"measurement_set_id": stored["id"]})

    visited = visit("phone")
    page = visited.page
    last = api.get("/v1/runs").json()["items"][0]["id"]
    alarmed = ["", f"#/robots/{robot}", f"#/runs/{last}", f"#/runs/{last}/report"]
    words = re.compile(r"in alarm:.*joint_3 −1\d.* since 10 Apr 2026")
    for address in alarmed:
        visited.go(address)
        expect(page.locator(".alarms")).to_contain_text(words)
    for address in ("#/robots", "#/runs"):
        visited.go(address)
        expect(page.locator(".item .alarm").first).to_have_text("Alarm")
    visited.go("#/fleet")
    row = page.get_by_role("link", name="worn robot")
    expect(row).to_contain_text("Alarm")
    expect(row.locator(".badge")).to_have_text("Use")
    row.tap()
    alarm = page.get_by_role("region", name="Alarm of joint_3")
    expect(alarm).to_contain_text("softer than in its reference campaigns")
    expect(alarm).to_contain_text("since 2026-04-10")
    alarm.get_by_label("Finding or decision").fill("gearbox ordered")
    alarm.get_by_role("button", name="Acknowledge").tap()
    expect(alarm).to_contain_text("gearbox ordered")

    page.get_by_text("4 campaigns", exact=True).tap()
    expect(page.locator("details .badge")).to_have_text(["Use"] * 4)
    points = page.get_by_role("group", name="Stiffness of joint_3 over its campaigns").get_by_role("link")
    expect(points).to_have_count(4)
    points.last.focus()
    page.keyboard.press("Enter")
    expect(page).to_have_url(re.compile("#/runs/"))
    visited.go("#/fleet")
    expect(page.get_by_role("link", name="worn robot")).to_contain_text("Acknowledged")
    for address in alarmed:
        visited.go(address)
        expect(page.locator("h1")).to_be_visible()
        expect(page.locator(".alarms")).to_have_count(0)
