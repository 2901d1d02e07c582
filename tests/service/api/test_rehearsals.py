"""Rehearsals over HTTP: the file `rehearsal.json` of runs and plans is what `js.rehearse` returns."""

import pytest
from support.api import file_at, post, posted
from support.documents import own_weight

import jointstiff as js
from jointstiff.schemas.plan import Plan
from jointstiff.schemas.rehearsal import RehearsalResult
from jointstiff.service.api import rehearsal as of_service
from jointstiff.service.kinds.geometry.kind import GEOMETRY
from jointstiff.simulator import TARGETS, default_arm, simulate_campaign

POSTURES = 12
PLACES = {name: list(place) for name, place in TARGETS.items()}
LOAD = {"kind": "any_direction", "force": 1500.0}


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="pull", configurations=POSTURES, seed=3)


@pytest.fixture(scope="module")
def run(local, document):
    return posted(local, document)


def rehearsed(local, job, **query):
    answer = local.get(file_at(job, "rehearsal.json"), params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()


def numbers(rehearsal):
    """What a rehearsal found, without the ids of its run."""
    return RehearsalResult.model_validate(rehearsal).model_dump(exclude={"assessment"})


def test_the_rehearsal_of_a_run_is_that_of_python(local, run, document):
    shown = rehearsed(local, run, seed=4)
    here = js.rehearse(js.identify(document), seed=4)
    assert numbers(shown["rehearsal"]) == here.model_dump(exclude={"assessment"})
    words = " ".join(here.summary().split())
    assert [line for line in shown["lines"] if line not in words] == []
    assert shown["lines"][0] == "This campaign determines 6 of 6 joints (12 postures, noise 20 µm)"
    (table,) = shown["tables"]
    assert table["head"] == ["joint", "planted", "found", "95 % interval"]
    assert [row[0] for row in table["rows"]] == [f"joint_{i}" for i in range(1, 7)]


def test_another_seed_is_another_rehearsal(local, run):
    first, second = (rehearsed(local, run, seed=seed)["rehearsal"]["joints"][0] for seed in (1, 2))
    assert first["planted"] == second["planted"]
    assert first["found"] != second["found"]


def test_the_table_has_the_unit_of_the_query(local, run):
    joint = rehearsed(local, run)["rehearsal"]["joints"][0]
    (table,) = rehearsed(local, run, unit="urad/Nm")["tables"]
    assert table["caption"].startswith("compliances in µrad/(N·m)")
    assert float(table["rows"][0][2]) == pytest.approx(1e6 / joint["found"], rel=1e-3)
    low, high = (float(end) for end in table["rows"][0][3].split(" … "))
    assert low < float(table["rows"][0][2]) < high


def test_a_plan_for_a_robot_is_rehearsed_with_plausible_stiffnesses(local, document):
    robot = post(local, "/v1/robots", document["robot"])
    options = {"readings": 8, "candidates": 200, "load": LOAD, "targets": PLACES, "sigma": 3e-5}
    plan = post(local, "/v1/plans", options | {"robot_id": robot["id"]})
    shown = rehearsed(local, plan)["rehearsal"]
    assert shown["planted_by"] == "plausible values for an arm of this size"
    assert (shown["postures"], shown["sigma"], shown["remarks"]) == (8, 3e-5, [])
    here = js.rehearse(Plan.model_validate(plan), robot=document["robot"])
    assert [joint.found for joint in here.joints] == [joint["found"] for joint in shown["joints"]]


@pytest.mark.parametrize("frame", [None, "base", "tracker"])
@pytest.mark.parametrize("units", [None, {"length": "mm", "angle": "deg", "force": "N"}])
def test_a_plan_that_goes_on_is_rehearsed_with_the_postures_so_far(local, frame, units):
    """Weights cannot twist the first joint: the plan's pulls in any direction do, in any unit and frame."""
    options = {"units": units} if units else {}
    weights = simulate_campaign(default_arm(), load="dead_weight", configurations=POSTURES, seed=3, **options)
    readings = weights["measurement_set"]
    if frame is not None:
        turn_into_tracker(readings, frame)
    before = posted(local, weights)
    assert rehearsed(local, before)["rehearsal"]["determined"] == 5
    set_id = before["request"]["measurement_set_id"]
    options = {"readings": 6, "candidates": 200, "load": LOAD, "measurement_set_id": set_id}
    shown = rehearsed(local, post(local, "/v1/plans", options))["rehearsal"]
    assert (shown["postures"], shown["determined"]) == (POSTURES + 6, 6)
    assert shown["planted_by"] == "the run of these readings, and plausible values"
    for joint, found in zip(shown["joints"], before["result"]["joints"], strict=True):
        assert abs(joint["found"] / joint["planted"] - 1) < 4 * joint["half_width"]
        if found["stiffness"] is not None:
            assert joint["planted"] == pytest.approx(found["stiffness"], rel=1e-6)


def turn_into_tracker(readings, forces):
    """Write readings in a tracker's frame that is turned and moved, and forces if `forces` is tracker."""
    away = [3.0, 1.0, 0.5]
    readings["frame"] = {
        "rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
        "translation": away,
        "forces": forces,
    }

    def turned(vector):
        x, y, z = vector
        return [y, -x, z]

    for observation in readings["observations"]:
        if forces == "tracker":
            observation["force"] = turned(observation["force"])
        for reading in observation["readings"]:
            for name in ("unloaded", "loaded"):
                reading[name] = turned(a - b for a, b in zip(reading[name], away, strict=True))


def test_what_cannot_be_rehearsed_is_refused_with_a_remedy(local, run, monkeypatch):
    geometry = post(local, "/v1/geometries", GEOMETRY.examples["two joints"])
    assert local.get(file_at(geometry, "rehearsal.json")).status_code == 404
    assert local.get(file_at(run, "rehearsal.json"), params={"seed": -1}).status_code == 422
    monkeypatch.setattr(of_service, "MOST_OBSERVATIONS", POSTURES - 1)
    refused = local.get(file_at(run, "rehearsal.json"))
    assert refused.status_code == 422
    assert refused.json()["remedy"] == "rehearse the campaign with `jointstiff rehearse`"


@pytest.mark.parametrize("limit", ["MOST_OBSERVATIONS", "MOST_READINGS"])
def test_a_large_plan_that_goes_on_is_refused_before_its_readings_are_identified(
    local, run, monkeypatch, limit
):
    set_id = run["request"]["measurement_set_id"]
    options = {"readings": 6, "candidates": 200, "load": LOAD, "measurement_set_id": set_id}
    plan = post(local, "/v1/plans", options)
    monkeypatch.setattr(
        of_service, "prepare_identification", lambda *_: pytest.fail("the readings so far were identified")
    )
    monkeypatch.setattr(of_service, limit, POSTURES + 5)  # the set with the plan has one posture more
    refused = local.get(file_at(plan, "rehearsal.json"))
    assert refused.status_code == 422
    assert "is not rehearsed by the service" in refused.json()["detail"]


def test_a_run_that_compares_models_of_elastic_links_is_refused(local, document):
    run = posted(local, document, elasticity="joints_and_links", loss="squared")
    refused = local.get(file_at(run, "rehearsal.json"))
    assert refused.status_code == 422
    assert "models of elastic links" in refused.json()["detail"]


def test_own_weight_is_refused(local):
    run = posted(local, own_weight(30, 1), weight={})
    options = {"readings": 8, "candidates": 40, "load": {"kind": "own_weight"}, "stiffness": {"joint_2": 3e6}}
    robot = post(local, "/v1/robots", own_weight(30, 1)["robot"])["id"]
    plan = post(local, "/v1/plans", options | {"robot_id": robot, "targets": PLACES, "sigma": 3e-5})
    for job in (run, plan):
        refused = local.get(file_at(job, "rehearsal.json"))
        assert refused.status_code == 422
        assert refused.json()["remedy"] == "rehearse a campaign with loads"
