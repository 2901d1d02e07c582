"""States of a live campaign: what is next, what readings say so far, what is refused, and the end."""

import json
from math import radians

import numpy as np
import pytest
from fastapi.testclient import TestClient
from support.api import post
from support.live import ARM, EXACT, OPEN, declared, described, measured, read
from support.rows import rows_of

from jointstiff.service.app import create_app
from jointstiff.service.live.declaration import read_goal
from jointstiff.service.store.store import Store
from jointstiff.simulator import LOAD_POINT, robot_document, simulate_campaign
from jointstiff.solver.errors import RequestError

DOUBT = (
    "the reading is 3.76 mm away from the prediction by the other readings: the force has the opposite "
    "sign or unloaded and loaded readings are exchanged? Read the posture again before the load is taken "
    "off."
)
AGAINST = (
    "the other observations predict a motion of 3 mm under 1471 N, but "
    "the targets moved in the opposite direction; with the load reversed, only 66.8 µm remains unexplained"
)
CHECKED = "the held-out reading is as near to its prediction as 90 % of good readings"
AREA = {"work_area": [[0.8, -0.6, 0.4], [1.9, 0.6, 1.6]]}


@pytest.fixture(scope="module")
def client():
    with (
        Store.open("sqlite://") as store,
        TestClient(create_app(store), base_url="http://127.0.0.1") as client,
    ):
        yield client


def state_of(client, address):
    return client.get(f"{address}/next").json()


def turned_round(reading):
    """Exchange unloaded and loaded readings."""
    readings = [one | {"loaded": one["unloaded"], "unloaded": one["loaded"]} for one in reading["readings"]]
    return reading | {"readings": readings}


def test_before_the_first_reading_all_is_open_but_what_the_load_never_twists(client):
    state = state_of(client, declared(client))
    assert (state["revision"], state["state"], state["message"]) == (0, "measuring", "0 readings")
    assert state["goal"] == "every joint that the load can twist is known to ± 15 %"
    assert (state["share"], state["still_needed"], state["assessment"]) == (None, None, None)
    assert [each["reason"] for each in state["joints"]] == ["the load never twists this joint", *[None] * 5]
    following = state["next"]
    assert (following["label"], following["block"], following["held_out"]) == ("m01", 1, False)
    assert following["joints"][:3] == pytest.approx([0.20944, 0.92502, -0.41888], abs=1e-4)
    assert following["force"] == pytest.approx([0.0, 0.0, -1471.0], abs=0.1)
    assert (
        following["reason"] == "the reading most improves joint_2, the joint that is farthest from the goal"
    )


def test_a_load_in_any_direction_twists_every_joint(client):
    state = state_of(client, declared(client, load={"kind": "any_direction", "force": 900}))
    assert [each["reason"] for each in state["joints"]] == [None] * 6
    assert state["next"]["force"] == pytest.approx([-360.3, 434.56, 700.96], abs=0.1)
    assert np.linalg.norm(state["next"]["force"]) == pytest.approx(900.0, rel=1e-3)
    assert (
        state["next"]["reason"]
        == "the reading most improves joint_1, the joint that is farthest from the goal"
    )


def test_what_is_declared_is_filled_up_with_defaults(client):
    stored = client.get(declared(client)).json()
    assert (stored["content_hash"], stored["observations"]) == (None, [])
    options = stored["open"]
    assert options["load"] == {"kind": "dead_weight", "force": None, "mass": 150.0}
    assert options["load_point"] == pytest.approx(LOAD_POINT)
    assert (options["candidates"], options["seed"]) == (1000, 0)
    assert options["distinct_angle"] == pytest.approx(radians(10.0))
    assert stored["live"]["state"] == "measuring"


def test_one_reading_gives_numbers_that_are_used_with_care(client):
    state = measured(client, declared(client), 1)
    assert (state["message"], state["still_needed"]) == ("1 reading; about 5 more", 5)
    assert state["share"] == pytest.approx(3.68133, rel=1e-3)
    (reading,) = state["readings"]
    assert (reading["label"], reading["state"], reading["p_value"]) == ("m01", "counts", None)
    assert state["joints"][0]["stiffness"] is None
    second = state["joints"][1]
    assert second["stiffness"] == pytest.approx(3.0563e6, rel=1e-3)
    assert second["interval"] == pytest.approx([2.8573e6, 3.2843e6], rel=1e-3)
    assert second["relative"] == second["relative_with_assumed"] == pytest.approx(0.069297, rel=1e-3)
    assessment = state["assessment"]
    assert (assessment["verdict"], assessment["joints_identified"]) == ("use_with_care", 3)
    reason = next(each for each in assessment["reasons"] if each["code"] == "few_postures")
    assert reason["message"] == (
        "the set has 1 distinct posture, so the stiffnesses were not tested in other postures"
    )
    assert reason["remedy"] == "measure at least 3 postures that differ by 5° or more"
    assert assessment["notes"] == [
        "Forces up to 1471 N (150 kgf), deflections up to 4.62 mm. If N and kgf were confused, every "
        "stiffness would be wrong by a factor of 9.81, and no reading would show it.",
        "Each posture was read only once without load, so a deflection that remains after unloading is not "
        "detected. Read each posture again after unloading (`unloaded_after`).",
    ]
    assert (
        state["next"]["reason"]
        == "the reading most improves joint_4, the joint that is farthest from the goal"
    )


def test_a_mistake_at_the_second_reading_is_named_at_once_and_better_with_the_third(client):
    address = declared(client)
    measured(client, address, 1)
    state = measured(client, address, 1, turned_round)
    assert (state["share"], state["still_needed"]) == (None, None)
    doubtful = state["readings"][1]
    assert (doubtful["state"], doubtful["doubtful"], doubtful["p_value"]) == ("doubtful", True, 0.0)
    assert doubtful["distance"] == pytest.approx(0.0037614, rel=1e-3)
    assert doubtful["causes"] == [
        "the force has the opposite sign",
        "unloaded and loaded readings are exchanged",
    ]
    assert doubtful["message"] == DOUBT
    assert state["message"] == f"m02 is doubtful: {DOUBT}"
    assert state["assessment"]["verdict"] == "do_not_use"
    codes = [each["code"] for each in state["assessment"]["reasons"]]
    assert codes == ["residuals_exceed_sigma", "deflection_unexplained", "few_postures", "lack_of_fit"]
    first, second, *_ = state["assessment"]["reasons"]
    assert first["message"].startswith("the residuals are 43.7 times as large as the stated noise allows")
    assert first["action"]["kind"] == "omit_noise"
    assert second["message"].startswith("the joints explain only 45.8 % of the mean deflection")
    assert second["action"]["observations"] == ["m02"]

    state = measured(client, address, 1)
    assert [each["state"] for each in state["readings"]] == ["counts", "doubtful", "counts"]
    third = state["readings"][2]
    assert (third["message"], third["p_value"]) == (
        "the reading agrees with the other readings",
        pytest.approx(0.83108, rel=1e-3),
    )
    (reason,) = state["assessment"]["reasons"]
    assert (reason["code"], reason["weight"]) == ("deflection_against_force", "do_not_use")
    assert (reason["where"], reason["observation"]) == ("observations[1] 'm02'", "m02")
    assert (
        reason["remedy"] == "change the sign of this force, or exchange the unloaded and the loaded readings"
    )
    assert [each["code"] for each in state["warnings"]] == ["deflection_against_force"]


@pytest.fixture(scope="module")
def mistaken(client):
    """The address of an open set of 16 readings, the second with a mistake."""
    address = declared(client)
    measured(client, address, 1)
    measured(client, address, 1, turned_round)
    measured(client, address, 14)
    return address


def test_no_further_readings_reach_the_goal_beside_a_mistake(client, mistaken):
    state = state_of(client, mistaken)
    assert (state["state"], state["still_needed"]) == ("measuring", None)
    assert state["share"] == pytest.approx(0.46453, rel=1e-3)
    assert state["message"] == f"m02 is doubtful: {DOUBT}"
    assert [each["state"] for each in state["readings"]] == ["counts", "doubtful", *["counts"] * 14]
    (reason,) = state["assessment"]["reasons"]
    assert reason["message"] == AGAINST
    assert reason["action"]["kind"] == "leave_out_readings"
    assert reason["action"]["observations"] == ["m02"]
    assert state["joints"][2]["interval"] == pytest.approx([2.47583e6, 2.56027e6], rel=1e-3)
    assert state["next"]["label"] == "m17"


@pytest.mark.parametrize(
    ("change", "status", "where", "detail", "remedy"),
    [
        (
            {"label": "m01"},
            409,
            None,
            "the set already has a different observation with the label 'm01'",
            "another device may have sent that observation: send this observation with another label",
        ),
        (
            {"joints": [0.0]},
            422,
            "observations[16].joints",
            "observation 'm17' has 1 joint angles, but the first observation has 6",
            "give one angle for each joint of the robot in every observation",
        ),
    ],
)
def test_an_observation_that_does_not_fit_is_refused(client, mistaken, change, status, where, detail, remedy):
    following = {"label": "m17", "joints": [0.1] * 6, "force": [0.0, 0.0, -1471.0]}
    problem = post(client, f"{mistaken}/observations", read(following) | change, status)
    assert (problem["where"], problem["detail"], problem["remedy"]) == (where, detail, remedy)


def test_an_empty_observation_is_told_all_that_is_missing(client, mistaken):
    problem = post(client, f"{mistaken}/observations", {}, 422)
    assert problem["detail"] == "4 faults; first: label: required field is missing"
    assert [each["where"] for each in problem["errors"]] == ["label", "joints", "force", "readings"]
    assert {each["remedy"] for each in problem["errors"]} == {"add this field"}


def test_a_closed_set_is_an_ordinary_one_with_a_run_that_keeps_the_verdict(client):
    address = declared(client)
    measured(client, address, 1)
    measured(client, address, 1, turned_round)
    measured(client, address, 3)
    (listed,) = [
        each
        for each in client.get("/v1/measurement-sets", params={"open": "true"}).json()["items"]
        if each["id"] == address.rpartition("/")[2]
    ]
    assert (listed["open"], listed["observation_count"], listed["content_hash"]) == (True, 5, None)
    closed = post(client, f"{address}/close", {}, 200)
    assert (closed["state"], closed["message"]) == ("closed", "closed after 5 readings")
    assert (closed["revision"], closed["still_needed"], closed["next"]) == (6, 0, None)
    stored = client.get(address).json()
    assert (stored["open"], stored["live"], len(stored["content_hash"])) == (None, None, 64)
    assert stored["notes"].startswith(
        "Measured live. Declared goal: every joint that the load can twist is known to ± 15 %.\nMeasuring: "
        f"m02 is doubtful: {DOUBT}"
    )
    assert [each["label"] for each in stored["observations"]] == [f"m{i:02d}" for i in range(1, 6)]
    run = client.get(f"/v1/jobs/{closed['run_id']}").json()
    assert (run["state"], run["request"]["measurement_set_id"]) == ("succeeded", stored["id"])
    assert run["request"]["complementary_stiffness"] == "included"
    assessment = run["result"]["assessment"]
    assert assessment["verdict"] == "do_not_use"
    assert [each["code"] for each in assessment["reasons"]] == ["deflection_against_force"]
    assert state_of(client, address)["run_id"] == run["id"]


@pytest.mark.parametrize(("change", "refusal"), rows_of(__file__, "declarations.txt"))
def test_what_cannot_be_measured_is_refused_before_the_first_reading(client, change, refusal):
    robot = post(client, "/v1/robots", robot_document(ARM))["id"]
    body = described(robot, OPEN | json.loads(change))
    problem = post(client, "/v1/measurement-sets", body, 422)
    assert f"{problem['where']} | {problem['detail']} | {problem['remedy']}" == refusal


def test_a_load_point_among_the_options_is_that_of_the_set_in_its_unit(client):
    robot = post(client, "/v1/robots", robot_document(ARM))["id"]
    body = described(robot, OPEN | {"load_point": list(LOAD_POINT)})
    body["units"] = {"length": "mm", "angle": "rad", "force": "N"}
    address = f"/v1/measurement-sets/{post(client, '/v1/measurement-sets', body)['id']}"
    assert client.get(address).json()["load_point"] == pytest.approx([-60.0, 20.0, 180.0])
    sent = read(state_of(client, address)["next"])
    for one in sent["readings"]:
        one |= {state: [1e3 * part for part in one[state]] for state in ("unloaded", "loaded")}
    assert len(post(client, f"{address}/observations", sent)["readings"]) == 1


def test_a_plan_that_goes_on_lends_the_load_of_its_campaign(client):
    robot = post(client, "/v1/robots", robot_document(ARM))["id"]
    document = simulate_campaign(ARM, configurations=12, load="dead_weight", force=900.0, seed=2)
    earlier = post(client, "/v1/measurement-sets", document["measurement_set"] | {"robot_id": robot})["id"]
    wanted = {"measurement_set_id": earlier, "readings": 6, "joints": ["joint_2", "joint_3"]}
    plan = post(client, "/v1/plans?wait=10", wanted)["id"]
    options = {"goal": OPEN["goal"], "plan_id": plan}
    body = described(robot, options, noise=EXACT, load_point=list(LOAD_POINT))
    following = post(client, "/v1/measurement-sets", body)["live"]["next"]
    assert following["force"] == pytest.approx([0.0, 0.0, -900.0])


def test_a_goal_beyond_reach_is_said_with_the_joint_that_misses_it(client):
    address = declared(client, goal={"kind": "joints", "relative": 0.001}, candidates=100)
    state = measured(client, address, 10)
    assert (state["state"], state["still_needed"]) == ("cannot", None)
    assert state["message"] == (
        "the goal will not be met: joint_6 causes 0.0 % of the deflection, and will not be known "
        "accurately enough"
    )
    assert state["share"] == pytest.approx(80.734, rel=1e-3)


def test_a_goal_of_a_deflection_is_reached_by_its_uncertainty(client):
    address = declared(client, goal={"kind": "deflection", "uncertainty": 1.1e-5}, **AREA)
    state = measured(client, address, 2)
    assert (state["state"], state["message"]) == (
        "measuring",
        "2 readings; about 8 more; with 2942 N, if the arm may carry it, about 4 more would meet the goal",
    )
    assert (state["still_needed"], state["share"]) == (8, pytest.approx(3.70365, rel=1e-3))
    state = measured(client, address, 20)
    assert (state["state"], state["message"]) == ("reached", f"reached after 16 readings; {CHECKED}")
    assert state["share"] == pytest.approx(0.97587, rel=2e-3)
    assert state["deflection_uncertainty"] == pytest.approx(0.97587 * 1.1e-5, rel=2e-3)


def test_a_decision_is_reached_where_the_deflection_is_below_its_limit(client):
    state = measured(client, declared(client, goal={"kind": "decision", "limit": 0.004}, **AREA), 20)
    answer = "the greatest deflection in the work area is 3.11 mm ± 17.5 µm (95 %), below 4 mm"
    assert (state["state"], state["message"]) == ("reached", f"reached after 6 readings: {answer}; {CHECKED}")
    greatest, uncertainty = state["greatest_deflection"], state["deflection_uncertainty"]
    assert (greatest, uncertainty) == pytest.approx((3.10816e-3, 1.75079e-5), rel=1e-3)
    assert state["share"] == pytest.approx(uncertainty / (0.004 - greatest), rel=1e-3)


def test_the_reading_that_is_held_out_is_announced_and_counts_towards_the_goal(client):
    address = declared(client)
    state, announced = state_of(client, address), []
    while state["next"] is not None:
        needed, following = state["still_needed"], state["next"]
        state = measured(client, address, 1)
        was_held_out = state["readings"][-1]["ball_ratio"] is not None
        announced.append((needed, following["held_out"], was_held_out))
    usual = [(needed, False, False) for needed in (None, 5, 4, 3, 2)]
    assert announced == [*usual, (1, True, True)]
    assert (state["state"], state["still_needed"]) == ("reached", 0)
    assert state["message"] == f"reached after 6 readings; {CHECKED}"
    assert state["share"] == pytest.approx(0.67827, rel=1e-3)


@pytest.mark.parametrize(
    ("words", "goal"),
    [
        ("15 %", {"kind": "joints", "relative": 0.15}),
        ("± 6 µm", {"kind": "deflection", "uncertainty": 6e-6}),
        ("0.02mm", {"kind": "deflection", "uncertainty": 2e-5}),
        ("below 0.5 mm", {"kind": "decision", "limit": 5e-4}),
    ],
)
def test_a_goal_is_understood_in_words(words, goal):
    ((_, kind), (name, number)) = goal.items()
    found = read_goal(words)
    assert (found.kind, getattr(found, name)) == (kind, pytest.approx(number))


@pytest.mark.parametrize("words", ["", "15", "below 3 %", "six um", "0 mm", "-1 um"])
def test_other_words_are_no_goal(words):
    with pytest.raises(RequestError) as refused:
        read_goal(words)
    assert str(refused.value) == (
        f'goal: {words!r} is not a goal; write "15 %" for every joint, "6 um" for the deflection in the '
        'work area, or "below 0.5 mm" to decide whether this deflection stays below a limit'
    )
