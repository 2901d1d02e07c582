"""Pictures of reports: ends of intervals are marked, numbers of joints do not overlap."""

from __future__ import annotations

import json
import math
import re

import pytest

import jointstiff
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.reports.pictures import arm, intervals
from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture(scope="module")
def campaign():
    return Campaign.model_validate_json(json.dumps(simulate_campaign(default_arm(), load="pull", seed=4)))


def test_both_ends_of_each_interval_have_a_tick(campaign):
    run = jointstiff.identify(campaign)
    svg = intervals(run.result.joints, 0.95).svg
    lines = [dict(re.findall(r'(\S+)="([^"]*)"', line)) for line in re.findall(r"<line [^>]*>", svg)]
    bars = [line for line in lines if line["stroke-width"] == "2.20"]
    ticks = [line for line in lines if line["stroke-width"] == "0.80" and line["x1"] == line["x2"]]
    closed = [joint for joint in run.result.joints if joint.stiffness_interval[1] is not None]
    assert len(bars) == len(run.result.joints)
    assert len(ticks) == len(bars) + len(closed)
    for bar in bars:
        own = [tick for tick in ticks if float(tick["y1"]) < float(bar["y1"]) < float(tick["y2"])]
        assert bar["x1"] in {tick["x1"] for tick in own}


def test_numbers_of_joints_do_not_overlap(campaign):
    robot = prepare_robot(campaign.robot).robot
    for posture in ([0.0] * 6, [0.3, -0.4, 0.5, 0.1, 0.2, 0.0]):
        texts = re.findall(r'<text x="([\d.]+)" y="([\d.]+)"[^>]*>([\d, ]+)</text>', arm(robot, posture).svg)
        places = [(float(x), float(y)) for x, y, _ in texts]
        assert sorted(int(part) for *_, text in texts for part in text.split(",")) == [1, 2, 3, 4, 5, 6]
        apart = [math.dist(a, b) for i, a in enumerate(places) for b in places[:i]]
        assert min(apart) >= 12.0
