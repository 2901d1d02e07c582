"""Runs that take the robot's own weight for the load, from campaign to result."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from support.api import post, posted

import jointstiff
from jointstiff.schemas.measurement import Reading
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Campaign, RunRequest
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.kinds.identification import identification
from jointstiff.service.problems import CampaignError
from jointstiff.service.resources.inputs import FromFile
from jointstiff.simulator import TARGETS, default_arm, random_configurations, simulate_campaign
from jointstiff.simulator.own_weight import default_bodies, sag, unloaded_campaign
from jointstiff.solver.errors import RequestError

ARM = default_arm()
POINTS = np.array(list(TARGETS.values()))
POINT = [-0.06, 0.02, 0.18]


@pytest.fixture(scope="module")
def document():
    return unloaded_campaign(ARM, configurations=30, seed=1)


def identified(document, **options):
    campaign = Campaign.model_validate(document)
    inputs = FromFile()
    set_id = inputs.add_set(campaign.measurement_set, prepare_robot(campaign.robot))
    request = RunRequest(measurement_set_id=set_id, **{**campaign.run.model_dump(), **options})
    return identification(inputs, request).conclude(())


@pytest.fixture(scope="module")
def result(document):
    return identified(document)


def still(run_id, joints):
    """A request for the sag of postures (N, 6) [rad] under no load."""
    return {
        "run_id": run_id,
        "units": {"length": "m", "angle": "rad", "force": "N"},
        "load_point": POINT,
        "absolute": True,
        "cases": [{"joints": each, "force": [0.0, 0.0, 0.0]} for each in joints.tolist()],
    }


def true_sag(bodies, joints):
    """How far POINT sags in each posture, by springs that balance the weight exactly [m]."""
    places = np.tile(POINT, (len(joints), 1))
    there, here = (ARM.posture(q).point_to_base(places) for q in (joints + sag(ARM, bodies, joints), joints))
    return there - here


def intervals(result):
    return np.array([joint.compliance_interval for joint in result.joints[1:]])


def test_a_set_without_loads_gives_the_joints_that_carry_weight(result):
    assert result.assessment.verdict == "use"
    assert result.joints[0].status == "not_observable"
    found = intervals(result)
    assert ((found[:, 0] <= ARM.compliances[1:]) & (ARM.compliances[1:] <= found[:, 1])).all()
    assert result.certificate.complementarity <= 1e-8
    shares = result.weight.joints
    assert shares[0].masses is None
    assert all(each.masses + each.readings == pytest.approx(1.0) for each in shares[1:])
    assert shares[1].masses > shares[3].masses
    assert result.weight.rms_residual < 4e-5 < 2e-4 < result.weight.rms_without_sag
    assert len(result.residuals) == 90
    assert result.compensation > 0.9


def test_predictions_maps_and_programs_hold_the_sag_if_asked(client, document):
    run_id = posted(client, document, weight={})["id"]
    q = random_configurations(ARM, 5, seed=8)
    asked = still(run_id, q)
    found = client.post("/v1/deflections", json=asked).json()
    assert any("sag" in remark for remark in found["remarks"])
    truth = true_sag(default_bodies(), q)
    moved = np.array([case["displacement"] for case in found["cases"]])
    assert np.linalg.norm(moved - truth, axis=1).max() < 0.05 * np.linalg.norm(truth, axis=1).max()
    area = {"area": [[1.4, 0.0, 1.0], [1.8, 0.0, 1.4]], "grid": [3, 1, 3], "place": POINT}
    unloaded = {"run_id": run_id, "force": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, 1.0], **area}
    assert client.post("/v1/maps", json=unloaded).status_code == 422
    mapped = client.post("/v1/maps", json={**unloaded, "absolute": True}).json()["result"]
    assert mapped["worst"]["deflection"] > 1e-3
    low, high = mapped["worst"]["readings_only"]
    assert low < mapped["worst"]["deflection"] < high
    mass = {"joint": "joint_2", "mass": 10.0, "centre": [0.0, 0.0, 0.1]}
    assert client.post("/v1/deflections", json={**asked, "masses": [mass]}).status_code == 422
    set_id = client.get(f"/v1/runs/{run_id}").json()["request"]["measurement_set_id"]
    robot_id = client.get(f"/v1/measurement-sets/{set_id}").json()["robot_id"]
    assert "own weight" in client.get(f"/v1/robots/{robot_id}/trend").json()["left_out"][0]["reason"]
    loaded = posted(client, simulate_campaign(ARM), method="partial_pose")["id"]
    refused = client.post("/v1/deflections", json={**asked, "run_id": loaded})
    assert refused.status_code == 422
    assert "own weight" in refused.text


def test_sag_of_joints_without_a_number_counts(client):
    masses = default_bodies().masses * [0.4, 1.7, 0.5, 1.6, 0.4, 1.7]
    vague = unloaded_campaign(ARM, replace(default_bodies(), masses=masses), configurations=20, seed=1)
    for body, mass in zip(vague["robot"]["bodies"], default_bodies().masses.tolist(), strict=True):
        body |= {"mass": mass, "mass_uncertainty": 0.9, "centre_uncertainty": 0.2}
    run_id = posted(client, vague, weight={})["id"]
    found = client.get(f"/v1/runs/{run_id}").json()["result"]["joints"]
    assert {joint["status"] for joint in found[2:]} == {"not_observable"}
    q = random_configurations(ARM, 20, seed=91)
    predicted = post(client, "/v1/deflections", still(run_id, q), 200)["cases"]
    moved = np.array([case["displacement"] for case in predicted])
    interval = np.array([case["readings_only"]["displacement"] for case in predicted])
    truth = true_sag(replace(default_bodies(), masses=masses), q)
    off = np.linalg.norm(moved - truth, axis=1)
    assert np.median(off) < 0.2 * np.median(np.linalg.norm(truth, axis=1))
    assert ((interval[..., 0] <= truth) & (truth <= interval[..., 1])).mean() > 0.9


def test_plans_tell_joints_apart_from_geometry_and_masses(client, document):
    known = copy.deepcopy(document)
    for body in known["robot"]["bodies"]:
        body["mass_uncertainty"] = 0.0
    del known["measurement_set"]["observations"][25:]
    run = posted(client, known, weight={})
    asked = {"measurement_set_id": run["request"]["measurement_set_id"], "readings": 5, "validation": 0.0}
    plan = post(client, "/v1/plans", {**asked, "candidates": 600})["result"]
    assert plan["left_out"] == ["joint_1"]
    assert plan["random_efficiency"] < 0.9
    assert all(reading["force"] == [0.0, 0.0, 0.0] for reading in plan["readings"])
    before = [joint["before"] for joint in plan["joints"]]
    found = [joint["standard_uncertainty"] for joint in run["result"]["joints"][1:]]
    np.testing.assert_allclose(before, found, rtol=0.15)
    promised = [joint["standard_uncertainty"] for joint in plan["joints"]]
    readings = np.array([reading["joints"] for reading in plan["readings"]])
    more = copy.deepcopy(known)
    draws = np.random.default_rng(6)
    places = ARM.posture(readings + sag(ARM, default_bodies(), readings)).targets_to_base(POINTS)
    places += 3e-5 * draws.standard_normal(places.shape)
    for number, (joints, read) in enumerate(zip(readings.tolist(), places.tolist(), strict=True)):
        targets = [{"target": name, "unloaded": place} for name, place in zip(TARGETS, read, strict=True)]
        more["measurement_set"]["observations"].append(
            {"label": f"p{number}", "joints": joints, "force": [0.0, 0.0, 0.0], "readings": targets}
        )
    after = [joint.standard_uncertainty for joint in identified(more).joints[1:]]
    np.testing.assert_allclose(promised, after, rtol=0.15)


@pytest.mark.parametrize(
    ("other", "said"),
    [({}, "no stiffness of a joint"), ({"work_area": [[1.0, 0.0, 1.0], [2.0, 1.0, 2.0]]}, "no work area")],
)
def test_plans_for_own_weight_need_stiffness_and_no_load(client, document, other, said):
    robot = client.post("/v1/robots", json=document["robot"]).json()
    asked = {"robot_id": robot["id"], "load": {"kind": "own_weight"}, "targets": {"a": [0.1, 0.0, 0.1]}}
    guess = {"stiffness": {"joint_2": 3e6}} if other else {}
    refused = client.post("/v1/plans", json={**asked, **guess, **other})
    assert refused.status_code == 422
    assert said in refused.text


def test_a_run_that_determines_no_joint_is_not_to_be_used(document):
    vague = copy.deepcopy(document)
    for body in vague["robot"]["bodies"]:
        body["mass_uncertainty"] = 0.9999
    result = identified(vague)
    assert {joint.status for joint in result.joints} == {"not_observable"}
    assert result.assessment.verdict == "do_not_use"
    assert [reason.code for reason in result.assessment.reasons] == ["no_joint_identified"]
    assert result.model is None


def test_a_noise_that_the_residuals_refuted_caps_the_verdict(document):
    refuted = copy.deepcopy(document)
    refuted["measurement_set"]["noise"] = {"sigma": 1e-6, "refuted": True}
    assessment = identified(refuted).assessment
    assert assessment.verdict == "use_with_care"
    assert "that they refuted" in assessment.reasons[0].message


def test_plans_count_the_readings_that_were_taken_only(client, document):
    some = copy.deepcopy(document)
    for body in some["robot"]["bodies"]:
        body["mass_uncertainty"] = 0.0
    for observation in some["measurement_set"]["observations"][8:]:
        del observation["readings"][1:]
    run = posted(client, some, weight={})
    set_id = run["request"]["measurement_set_id"]
    asked = {"measurement_set_id": set_id, "readings": 2, "validation": 0.0, "candidates": 50}
    plan = client.post("/v1/plans", json=asked).json()["result"]
    found = [joint["standard_uncertainty"] for joint in run["result"]["joints"][1:]]
    np.testing.assert_allclose([joint["before"] for joint in plan["joints"]], found, rtol=0.15)


def test_plans_take_the_gravity_of_the_cell_and_refuse_balancers(client, document):
    robot = client.post("/v1/robots", json=document["robot"]).json()
    wall = {"kind": "own_weight", "gravity": [9.80665, 0.0, 0.0]}
    asked = {"robot_id": robot["id"], "targets": {"a": [0.1, 0.0, 0.1], "b": [0.0, 0.1, 0.1]}}
    guess = {"stiffness": dict.fromkeys(ARM.joint_names, 1e6), "readings": 12, "candidates": 40}
    answer = post(client, "/v1/plans", {**asked, **guess, "load": wall})
    assert "joint_1" not in answer["result"]["left_out"]
    refused = client.post("/v1/plans", json={**asked, **guess, "load": {**wall, "estimate_gravity": True}})
    assert refused.status_code == 422
    assert "no balancers" in refused.text


def test_units_and_frames_change_nothing(document, result):
    other = copy.deepcopy(document)
    measured = other["measurement_set"]
    measured["units"] = {"length": "mm", "angle": "deg", "force": "kN"}
    measured["noise"]["sigma"] *= 1e3
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([1.0, -2.0, 0.5])
    measured["frame"] = {"rotation": turn.tolist(), "translation": (1e3 * shift).tolist()}
    for observation in measured["observations"]:
        observation["joints"] = np.degrees(observation["joints"]).tolist()
        for reading in observation["readings"]:
            place = turn.T @ (np.array(reading["unloaded"]) - shift)
            reading["unloaded"] = (1e3 * place).tolist()
    np.testing.assert_allclose(intervals(identified(other)), intervals(result), rtol=1e-4)


def test_deflections_beside_loaded_positions_leave_these_as_positions():
    both = unloaded_campaign(ARM, configurations=30, seed=1, payload=100.0)
    alone = identified(both)
    measured, points = both["measurement_set"], dict(zip(TARGETS, POINTS.tolist(), strict=True))
    measured["flange_targets"] = points
    first = measured["observations"][0]
    read = first["readings"][0]
    moved = np.subtract(read.pop("loaded"), read.pop("unloaded"))
    measured["observations"].append(
        {**first, "label": "gauge", "readings": [{**read, "deflection": moved.tolist()}]}
    )
    first["readings"] = first["readings"][1:]
    found = identified(both)
    assert found.goodness.chi_square < 1.1 * alone.goodness.chi_square
    assert found.assessment.verdict == "use"


def test_other_work_refuses_a_set_without_loads(document):
    with pytest.raises(RequestError, match="show no deflection"):
        identified(document, weight=None)
    with pytest.raises(CampaignError, match="show no deflection"):
        jointstiff.compare(document)


def test_inertials_of_a_urdf_are_bodies(document):
    stated = copy.deepcopy(document)
    bodies = stated["robot"].pop("bodies")
    urdf = stated["robot"]["model"]["urdf"]
    for number, body in enumerate(bodies, start=1):
        centre = " ".join(map(repr, body["centre"]))
        inertial = f'<inertial><origin xyz="{centre}"/><mass value="{body["mass"]}"/></inertial>'
        urdf = urdf.replace(f'<link name="link_{number}"/>', f'<link name="link_{number}">{inertial}</link>')
    stated["robot"]["model"]["urdf"] = urdf
    prepared = prepare_robot(Campaign.model_validate(stated).robot)
    assert [body.mass for body in prepared.document.bodies] == [body["mass"] for body in bodies]
    assert [body.mass_uncertainty for body in prepared.document.bodies] == [0.2] * 6
    np.testing.assert_allclose([b.centre for b in prepared.robot.bodies], [b["centre"] for b in bodies])
    plain = prepare_robot(Campaign.model_validate(document).robot)
    assert prepared.content_hash == plain.content_hash


@pytest.mark.parametrize(
    ("message", "document", "said"),
    [
        (RunOptions, {"weight": {}, "method": "complete_pose"}, "does not go with"),
        (RunOptions, {"weight": {}, "loss": "huber"}, "does not go with"),
        (RunOptions, {"weight": {}, "elasticity": "joints_and_links"}, "does not go with"),
        (RunOptions, {"weight": {}, "positive": False}, "does not go with"),
        (RunOptions, {"weight": {"gravity": [0.0, 0.0, 0.0]}}, "gravity must be"),
        (RunOptions, {"weight": {"gravity": [0.0, 0.0, -9806.65]}}, "gravity must be"),
        (Reading, {"target": "P10", "loaded": [0.0, 0.0, 0.0]}, "`unloaded` alone"),
    ],
)
def test_what_own_weight_does_not_know_is_refused(message, document, said):
    with pytest.raises(ValueError, match=said):
        message.model_validate(document)
