"""Measuring live from Python and the terminal: an exact simulated arm, sources that fail, goals in words."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace

import numpy as np
import pytest
from support.live import positions
from typer.testing import CliRunner

import jointstiff
from jointstiff.schemas.plan import DecisionGoal, DeflectionGoal, JointsGoal
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.app import create_app
from jointstiff.service.cli.app import app
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.live.declaration import goal_of
from jointstiff.service.live.sources import Setting, Simulated, Stand
from jointstiff.simulator import (
    LOAD_POINT,
    TARGETS,
    default_arm,
    robot_document,
    simulate_campaign,
)
from jointstiff.solver.errors import RequestError

ARM = default_arm()
LOAD = {"load": "dead_weight:1500", "targets": TARGETS, "load_point": LOAD_POINT, "sigma": 2e-5}


@pytest.fixture(scope="module")
def campaign():
    return simulate_campaign(ARM, configurations=8, load="dead_weight", seed=1)


def setting(sigma=2e-5):
    robot = prepare_robot(RobotDocument.model_validate(robot_document(ARM))).robot
    return Setting(robot, {name: tuple(place) for name, place in TARGETS.items()}, tuple(LOAD_POINT), sigma)


@pytest.mark.parametrize("loaded", [False, True])
def test_a_simulated_arm_balances_its_load_exactly(loaded):
    """Its readings are those of springs that share no code with it, within noise that is next to none."""
    source, joints, force = Simulated("3"), (0.3, 0.2, -0.4, 0.5, 0.8, -1.0), (300.0, -400.0, -1500.0)

    async def read():
        await source.open(setting(sigma=1e-12))
        await source.stand(Stand("m01", joints, force, loaded))
        return [(await source.point(name))[0] for name in TARGETS]

    points = np.array(asyncio.run(read()))
    arm = replace(ARM, stiffnesses=source.stiffness)
    expected = positions(arm, joints, force, sigma=0.0)["loaded" if loaded else "unloaded"]
    assert np.abs(points - expected).max() < 1e-9
    assert ((source.stiffness > 1e4) & (source.stiffness < 3e7)).all()


@pytest.mark.parametrize(
    ("words", "goal"),
    [
        ("15 %", JointsGoal(kind="joints", relative=0.15)),
        ("± 6 µm", DeflectionGoal(kind="deflection", uncertainty=6e-6)),
        ("0.02mm", DeflectionGoal(kind="deflection", uncertainty=2e-5)),
        ("below 0.5 mm", DecisionGoal(kind="decision", limit=5e-4)),
    ],
)
def test_goals_are_words(words, goal):
    assert goal_of(words).model_dump() == pytest.approx(goal.model_dump())


@pytest.mark.parametrize("words", ["", "15", "below 3 %", "six um", "0 mm", "-1 um"])
def test_other_words_are_no_goals(words):
    with pytest.raises(RequestError, match="no goal"):
        goal_of(words)


@pytest.mark.parametrize("goal", ["15 %", "40 um", "below 5 mm"])
def test_a_campaign_is_measured_by_its_source_until_its_goal_is_reached(campaign, goal):
    with jointstiff.measure(campaign, goal=goal, source="simulated:1") as live:
        state = live.run_source()
        assert state.state == "reached"
        assert 5 <= live.count <= 20
        assert live.state.readings[-1].held_out.inside
        for joint, stiffness in zip(state.joints, live.source.stiffness, strict=True):
            if joint.relative is not None:
                assert abs(joint.stiffness / stiffness - 1.0) <= 2.0 * joint.relative_with_assumed
        run = live.close()
    assert run.state == "succeeded"
    assert len(live.campaign.measurement_set.observations) == live.count
    assert "Measured live" in live.campaign.measurement_set.notes


def test_a_robot_of_the_catalogue_needs_load_and_targets():
    with pytest.raises(jointstiff.CampaignError, match="targets"):
        jointstiff.measure("KUKA KR 210 R2700 extra", goal="15 %")
    with jointstiff.measure("KUKA KR 210 R2700 extra", "15 %", "simulated:2", **LOAD) as live:
        assert live.run_source(most=3).state == "measuring"
        assert live.count == 3


def test_the_same_over_a_service(campaign, database_url):
    """The same calls, numbers and record; the closed set is an ordinary one of the service."""
    from fastapi.testclient import TestClient

    from jointstiff.service.store.store import Store

    with (
        Store.open(database_url) as store,
        TestClient(create_app(store), base_url="http://127.0.0.1") as service,
    ):
        client = jointstiff.Client("http://127.0.0.1", transport=service._transport)
        with (
            jointstiff.measure(campaign, goal="15 %", source="simulated:1") as here,
            client.measure(campaign, goal="15 %", source="simulated:1") as there,
        ):
            assert here.run_source().readings == there.run_source().readings
            assert there.close().result.joints == here.close().result.joints


def test_the_command_prints_one_document(campaign, tmp_path):
    path, saved = tmp_path / "campaign.json", tmp_path / "closed.json"
    path.write_text(json.dumps(campaign))
    arguments = [str(path), "--goal", "15 %", "--source", "simulated:1", "--json", "--save", str(saved)]
    result = CliRunner().invoke(app, ["measure", *arguments])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["state"] == "reached"
    assert document["share"] <= 1.0
    assert document["readings"] == len(document["record"])
    assert document["result"]["joints"]
    assert "share of the goal" in result.stderr
    widest = max(joint["relative_with_assumed"] or 0.0 for joint in document["joints"])
    with_them = f"without the assumed errors of load point and force (with them ± {100 * widest:.0f} %)"
    assert widest > 0.15
    assert f"\nreached after {document['readings']} readings, {with_them}" in result.stderr
    notes = json.loads(saved.read_text())["measurement_set"]["notes"]
    assert f"\nReached after {document['readings']} readings, {with_them}" in notes
    assert "every joint that the load can twist is known to ± 15 %" in notes
    again = CliRunner().invoke(app, ["identify", str(saved), "--json"])
    assert json.loads(again.stdout)["result"]["joints"] == document["result"]["joints"]
