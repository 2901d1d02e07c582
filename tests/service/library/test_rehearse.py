"""Rehearsals: simulated readings against springs that share no code with them, and what a rehearsal shows."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.command_lines import refused, typed

import jointstiff as js
from jointstiff.schemas.run import Campaign
from jointstiff.service.library.robots import prepare_once
from jointstiff.service.live.rehearsal import _Simulation
from jointstiff.simulator import default_arm, simulate_campaign

TRUE = np.array(default_arm().stiffnesses)
NAMES = list(default_arm().joint_names)
EQUIPMENT = {
    "targets": {"P10": [147, 55, 50], "P11": [-137, 87, 85], "P12": [-7, -140, 120]},
    "load_point": [-60, 20, 180],
    "candidates": 200,
}
STATED = dict(zip(NAMES, TRUE.tolist(), strict=True))


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="pull", configurations=12, seed=3)


class NoNoise:
    def standard_normal(self, shape):
        return np.zeros(shape)


def readings_without_noise(document):
    campaign = Campaign.model_validate(document)
    robot = prepare_once(campaign.robot).robot
    return _Simulation(campaign.measurement_set, robot, TRUE, None, NoNoise(), []).measure()


@pytest.mark.parametrize("load", ["pull", "dead_weight"])
@pytest.mark.parametrize("units", [None, {"length": "mm", "angle": "deg", "force": "N"}])
def test_readings_are_those_of_the_exact_springs(load, units):
    options = {} if units is None else {"units": units}
    exact = simulate_campaign(default_arm(), load=load, configurations=6, seed=2, sigma=0.0, **options)
    length = {"mm": 1e-3, "m": 1.0}[exact["measurement_set"]["units"]["length"]]
    simulated = readings_without_noise(exact)
    for one, other in zip(simulated.observations, exact["measurement_set"]["observations"], strict=True):
        for reading, true in zip(one.readings, other["readings"], strict=True):
            for name in ("unloaded", "loaded"):
                apart = length * (np.array(getattr(reading, name)) - np.array(true[name]))
                assert np.abs(apart).max() < 2e-9, (one.label, name)


def test_kinds_frames_and_directions_of_the_readings_are_kept(document):
    """The same readings as positions of a tracker that is turned, as deflections, and along a direction."""
    positions = readings_without_noise(document)
    targets = {"P10": [0.147, 0.055, 0.05]}
    turned = json.loads(json.dumps(document))
    rotation, translation = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [3.0, 1.0, 0.5]
    turned["measurement_set"]["frame"] = {"rotation": rotation, "translation": translation}
    turned["measurement_set"]["units"] = {"length": "m", "angle": "rad", "force": "N"}
    lengths = {"mm": 1e-3, "m": 1.0}[document["measurement_set"]["units"]["length"]]
    assert lengths == 1.0
    turned["measurement_set"]["flange_targets"] = targets
    for observation in turned["measurement_set"]["observations"]:
        observation["readings"] = [
            {"target": "P10", "unloaded": [0, 0, 0], "loaded": [0, 0, 0]},
            {"target": "P10", "deflection": [0, 0, 0]},
            {"target": "P10", "displacement": 0.0, "direction": [0, 0, 2.0]},
        ][:1]
    seen = readings_without_noise(turned)
    plain = json.loads(json.dumps(turned))
    del plain["measurement_set"]["frame"]
    in_base = readings_without_noise(plain)
    for one, other in zip(seen.observations, in_base.observations, strict=True):
        for name in ("unloaded", "loaded"):
            back = np.array(rotation) @ getattr(one.readings[0], name) + translation
            assert back == pytest.approx(np.array(getattr(other.readings[0], name)), abs=1e-12)
    for reading in (
        {"target": "P10", "deflection": [0, 0, 0]},
        {"target": "P10", "displacement": 0.0, "direction": [0, 0, 2.0]},
    ):
        for observation in plain["measurement_set"]["observations"]:
            observation["readings"] = [reading]
        for one, other in zip(readings_without_noise(plain).observations, in_base.observations, strict=True):
            moved = np.subtract(other.readings[0].loaded, other.readings[0].unloaded)
            read = one.readings[0]
            if read.deflection is None:
                assert read.displacement == pytest.approx(moved[2], abs=1e-14)
            else:
                assert read.deflection == pytest.approx(moved, abs=1e-14)
    assert len(positions.observations) == 12


def test_what_was_planted_is_found(document):
    rehearsal = js.rehearse(document, stiffness=STATED)
    assert [joint.planted for joint in rehearsal.joints] == TRUE.tolist()
    assert rehearsal.planted_by == "the caller"
    assert rehearsal.determined == 6
    for joint in rehearsal.joints:
        assert abs(joint.found / joint.planted - 1) < 3 * joint.half_width


def test_intervals_contain_the_planted_stiffness_as_often_as_they_promise(document):
    contained = [
        joint.contained
        for seed in range(1, 21)
        for joint in js.rehearse(document, stiffness=STATED, seed=seed).joints
    ]
    assert len(contained) == 120
    assert 0.90 <= np.mean(contained) <= 1.0  # 95 %: 120 draws are within 90 % but once in 50 times


def test_another_seed_draws_other_noise_and_the_same_seed_the_same(document):
    first, again, other = (js.rehearse(document, stiffness=STATED, seed=seed) for seed in (5, 5, 6))
    assert first == again
    assert first.joints[0].found != other.joints[0].found


def test_a_joint_that_no_load_twists_is_named():
    document = simulate_campaign(default_arm(), load="dead_weight", configurations=12, seed=3)
    rehearsal = js.rehearse(document)
    assert repr(rehearsal) == (
        "<Rehearsal: This campaign determines 5 of 6 joints (12 postures, noise 20 µm)>"
    )
    assert (
        "these joints have no stiffness or no upper limit: joint_1; add loads that twist these joints"
        in rehearsal.summary()
    )
    assert rehearsal.joints[0].found is None


def test_a_campaign_with_empty_readings_and_a_plan_are_rehearsed(document, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("campaign.json").write_text(json.dumps(document))
    typed("plan campaign.json --readings 6 --candidates 200 --campaign planned.json --save plan.json")
    rehearsal = js.rehearse("planned.json", seed=3)
    assert rehearsal.postures == 6
    assert rehearsal.planted_by == "plausible values for an arm of this size"
    assert (
        "the places of P10, P11, P12 on the flange are not stated: usual places are assumed"
        in rehearsal.remarks
    )
    begun = js.plan(document["robot"], load={"kind": "any_direction", "force": 1500}, readings=6, **EQUIPMENT)
    of_plan = js.rehearse(begun, robot=document["robot"], seed=3)
    assert (of_plan.postures, of_plan.remarks) == (
        6,
        ["no noise of the readings is stated: 20 µm is assumed"],
    )
    with pytest.raises(Exception, match="the plan has no robot"):
        js.rehearse(begun)


def test_a_plan_is_rehearsed_with_the_campaign_that_it_continues(document, tmp_path, monkeypatch):
    """Object, saved file and terminal: twelve postures and six more, and stiffnesses of the twelve."""
    monkeypatch.chdir(tmp_path)
    planned = js.plan(document, readings=6, candidates=200)
    rehearsal = js.rehearse(planned, seed=3)
    assert (rehearsal.postures, rehearsal.planted_by) == (18, "the run of these readings")
    assert [joint.planted for joint in rehearsal.joints] == pytest.approx(
        [joint.stiffness for joint in js.identify(document).result.joints]
    )
    alone = js.rehearse(document, seed=3)
    for more, less in zip(rehearsal.joints, alone.joints, strict=True):
        assert more.half_width < less.half_width
    planned.save("plan.json")
    assert js.rehearse("plan.json", seed=3) == rehearsal
    assert "(18 postures, noise 20 µm)" in typed("rehearse plan.json --seed 3")
    # A plan as the API writes it names the campaign by an id only.
    Path("answer.json").write_text(planned._message.model_dump_json())
    assert js.rehearse("answer.json", robot=document, seed=3) == rehearsal
    with pytest.raises(Exception, match="the plan does not contain the campaign that the plan continues"):
        js.rehearse("answer.json", robot=document["robot"])


def test_the_command_shows_and_saves_a_rehearsal(document, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("campaign.json").write_text(json.dumps(document))
    shown = typed("rehearse campaign.json --stiffness joint_2=3e6 --seed 4 --save rehearsal.json")
    assert shown.startswith("This campaign determines 6 of 6 joints (12 postures, noise 20 µm)")
    assert "│ joint_2 │ 3 │" in shown
    loaded = js.load("rehearsal.json")
    assert loaded == js.rehearse(document, stiffness={"joint_2": 3e6}, seed=4)
    assert refused("rehearse campaign.json --stiffness joint_9=3e6")
    assert "must be like joint_2=3e6" in refused("rehearse campaign.json --stiffness joint_2")


def test_a_run_by_own_weight_is_not_rehearsed(document):
    weighed = document | {"run": {"weight": {}}}
    with pytest.raises(Exception, match="a run by the robot's own weight cannot be rehearsed"):
        js.rehearse(weighed)


def test_a_campaign_without_a_load_is_refused_by_what_is_missing(document):
    unloaded = json.loads(json.dumps(document))
    for observation in unloaded["measurement_set"]["observations"]:
        observation["force"] = [0, 0, 0]
        for reading in observation["readings"]:
            reading["loaded"] = None
    with pytest.raises(Exception, match="no observation has a force or a moment"):
        js.rehearse(unloaded)


@pytest.mark.parametrize("value", [3.1, 3.1e12, -1.0])
def test_a_planted_stiffness_of_no_joint_is_refused_with_its_unit(document, value):
    with pytest.raises(js.CampaignError) as refused:
        js.rehearse(document, stiffness={"joint_2": value})
    problem = refused.value.problem
    assert problem.where == "stiffness.joint_2"
    assert "1000 N·m/rad to 1 · 10⁹ N·m/rad is plausible" in problem.detail
    assert "3.1 · 10⁶ N·m/rad in a table is 3.1e6" in problem.remedy
