"""Live campaigns: exact springs read posture by posture, mistakes named at the reading, priors of a fleet."""

import copy
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from support.api import post
from support.live import observation

from jointstiff.schemas.run import JointResult
from jointstiff.service.app import create_app
from jointstiff.service.kinds.trend import Trends
from jointstiff.service.live import stored
from jointstiff.service.live.campaign import LiveCampaign
from jointstiff.service.live.fleet import priors_of, standings
from jointstiff.service.store.collection import KEEP_DELETED
from jointstiff.service.store.store import Store
from jointstiff.service.workers.worker import Recovery
from jointstiff.simulator import LOAD_POINT, TARGETS, default_arm, robot_document, simulate_campaign
from jointstiff.solver.errors import RequestError
from jointstiff.solver.live.ahead import Known

ARM, SIGMA = default_arm(), 2e-5
EXACT = {"sigma": SIGMA, "load_point": 1e-4, "force": {"scale": 1e-3}}  # next to exact
OPEN: dict[str, Any] = {
    "goal": {"kind": "joints", "relative": 0.15},
    "load": {"kind": "dead_weight", "mass": 150.0},
    "targets": {name: list(place) for name, place in TARGETS.items()},
}
PRIOR = {"stiffness": 1e6, "standard_uncertainty": 1e5}
Answer = dict[str, Any]


def read(following: Answer, seed: int = 0, **changes: object) -> Answer:
    """An observation of what is next, by springs that balance the load exactly, and noise."""
    number = int(following["label"].strip("m"))
    return observation(ARM, following, sigma=SIGMA, seed=1000 * seed + number) | changes


@pytest.fixture
def service(either_database_url: str) -> Iterator[TestClient]:
    with (
        Store.open(either_database_url) as store,
        TestClient(create_app(store), base_url="http://127.0.0.1") as client,
    ):
        yield client


def body_of(service: TestClient, options: Answer, length: str = "m", **more: object) -> Answer:
    """An open set of a new robot, as it is posted, which states neither noise nor load point."""
    robot = service.post("/v1/robots", json=robot_document(ARM)).json()["id"]
    units = {"length": length, "angle": "rad", "force": "N"}
    return {"robot_id": robot, "name": "live", "units": units, "encoders": "motor", "open": options} | more


def declared(service: TestClient, **changes: object) -> str:
    """The address of an open set."""
    body = body_of(service, OPEN | changes, noise=EXACT, load_point=list(LOAD_POINT))
    answer = service.post("/v1/measurement-sets", json=body)
    assert answer.status_code == 201, answer.text
    return str(answer.headers["Location"])


def measured(service: TestClient, address: str, readings: int, seed: int = 0) -> Answer:
    """The state after some readings."""
    state: Answer = service.get(f"{address}/next").json()
    for _ in range(readings):
        if state["next"] is None:
            break
        state = post(service, f"{address}/observations", read(state["next"], seed))
    return state


def test_a_campaign_is_measured_until_its_goal_is_met_and_becomes_an_ordinary_set(service):
    address = declared(service)
    state = measured(service, address, 30)
    assert state["state"] == "reached"
    assert "assumed" not in state["message"]  # all errors are stated
    assert len(state["readings"]) <= 13
    assert state["share"] <= 1.0
    assert [each["held_out"] is not None for each in state["readings"]][-1]
    assert state["readings"][-1]["held_out"]["inside"]
    for joint, stiffness in zip(state["joints"], ARM.stiffnesses, strict=True):
        if joint["name"] == "joint_1":  # a weight does not twist it
            assert joint["interval"] is None
        else:
            assert joint["relative"] <= 0.15
            assert abs(joint["stiffness"] / stiffness - 1.0) <= 2.0 * joint["relative"]
    closed = service.post(f"{address}/close").json()
    assert closed["state"] == "closed"
    assert service.post(f"{address}/close").json() == closed
    stored = service.get(address).json()
    assert len(stored["observations"]) == len(state["readings"])
    assert "± 15 %" in stored["notes"]
    assert "90 % ball" in stored["notes"]
    run = service.get(f"/v1/runs/{closed['run_id']}").json()
    assert run["state"] == "succeeded"
    first = {name: stored["observations"][0][name] for name in ("joints", "force")}
    late = service.post(f"{address}/observations", json=read({**run, "label": "m99", **first}))
    assert (late.status_code, late.json()["type"]) == (409, "urn:jointstiff:problem:closed")


def test_the_held_out_reading_is_announced_and_counts_towards_the_goal(service):
    """It may be the one with which the goal is met; never among the first five."""
    address = declared(service)
    state = service.get(f"{address}/next").json()
    while state["next"] is not None:
        following, needed = state["next"], state["still_needed"]
        assert following["held_out"] == (needed == 1)
        state = service.post(f"{address}/observations", json=read(following)).json()
        assert (state["readings"][-1]["held_out"] is not None) == following["held_out"]
    assert state["state"] == "reached"
    assert sum(each["held_out"] is not None for each in state["readings"][:5]) == 0


def test_an_observation_is_acknowledged_once_and_survives(database_url):
    """What was answered 201 is there in another service on the same database, once."""
    with (
        Store.open(database_url) as store,
        TestClient(create_app(store), base_url="http://127.0.0.1") as first,
    ):
        address = declared(first)
        state = first.get(f"{address}/next").json()
        body = read(state["next"])
        answers = [first.post(f"{address}/observations", json=body) for _ in range(2)]
        assert answers[0].json() == answers[1].json()
        other = first.post(f"{address}/observations", json=body | {"force": [0.0, 0.0, -1.0]})
        assert (other.status_code, other.json()["type"]) == (409, "urn:jointstiff:problem:label-taken")
        with TestClient(create_app(store), base_url="http://127.0.0.1") as second:
            again = second.get(f"{address}/next").json()
            assert again == answers[0].json()
            assert [each["label"] for each in again["readings"]] == ["m01"]


def exchanged(body: Answer) -> Answer:
    names = [reading["target"] for reading in body["readings"]]
    swapped = [names[1], names[0], *names[2:]]
    readings = [{**reading, "target": name} for reading, name in zip(body["readings"], swapped, strict=True)]
    return body | {"readings": readings}


MISTAKES: dict[str, tuple[Callable[[Answer, Answer], Answer], str]] = {
    "sign": (lambda body, _: body | {"force": [-part for part in body["force"]]}, "opposite sign"),
    "posture": (lambda body, first: body | {"joints": first["joints"]}, "those of 'm01'"),
    "targets": (lambda body, _: exchanged(body), "P10 and P11 are exchanged"),
    "force": (lambda body, _: body | {"force": [0.85 * part for part in body["force"]]}, "force is another"),
}


@pytest.mark.parametrize(
    "mistake",
    ["targets", *(pytest.param(name, marks=pytest.mark.slow) for name in ("sign", "posture", "force"))],
)
def test_a_mistake_is_named_at_the_reading_and_withdrawn(service, mistake):
    address = declared(service, goal={"kind": "joints", "relative": 0.02})
    first = service.get(f"{address}/next").json()["next"]
    state = measured(service, address, 5)
    assert not any(each["innovation"] and each["innovation"]["doubtful"] for each in state["readings"])
    plant, words = MISTAKES[mistake]
    label = state["next"]["label"]
    answer = service.post(f"{address}/observations", json=plant(read(state["next"]), read(first))).json()
    found = answer["readings"][-1]
    assert found["state"] == "doubtful"
    assert any(words in cause for cause in found["innovation"]["causes"]), found["innovation"]
    change = {"withdrawn": {label: "read again"}}
    assert service.patch(address, json=change).status_code == 200
    after = service.get(f"{address}/next").json()
    assert after["readings"][-1]["state"] == "withdrawn"
    assert after["joints"] == state["joints"]
    assert service.patch(address, json={"withdrawn": {"m77": "?"}}).status_code == 422


def test_a_goal_is_not_reached_by_readings_that_are_not_to_be_used(service):
    """A mistake among the first readings: named as soon as others tell; withdrawn, the campaign ends."""
    address = declared(service)
    first = service.get(f"{address}/next").json()["next"]
    service.post(f"{address}/observations", json=exchanged(read(first)))
    state = measured(service, address, 3)
    assert [each["state"] for each in state["readings"]] == ["doubtful", "counts", "counts", "counts"]
    assert "exchange the unloaded and loaded values" in state["readings"][0]["innovation"]["message"]
    assert "m01 is doubtful" in state["message"]
    service.patch(address, json={"kept": ["m01"]})
    state = measured(service, address, 1)
    assert "do not use these readings yet: m01" in state["message"]
    state = measured(service, address, 5)
    assert state["share"] <= 1.0
    assert state["assessment"]["verdict"] == "do_not_use"
    assert (state["state"], state["still_needed"], state["next"]["held_out"]) == ("cannot", None, False)
    assert "will not be met by these readings: m01" in state["message"]
    assert "exchange the unloaded and loaded values" in state["message"]
    service.patch(address, json={"withdrawn": {"m01": "targets exchanged"}})
    assert measured(service, address, 5)["state"] == "reached"


def test_a_second_mistake_of_a_kind_is_named_beside_one_that_is_kept(service):
    address = declared(service)
    for _ in range(2):
        following = service.get(f"{address}/next").json()["next"]
        post(service, f"{address}/observations", exchanged(read(following)))
    for _ in range(3):
        state = measured(service, address, 1)
        doubtful = [each["label"] for each in state["readings"] if each["state"] == "doubtful"]
        service.patch(address, json={"kept": doubtful})
    assert "m01" in doubtful
    assert measured(service, address, 1)["message"].startswith("m02 is doubtful: 'P11' and 'P10' are")


def test_a_posture_is_skipped_and_no_other_than_the_next_one(service):
    address = declared(service)
    state = measured(service, address, 1)
    assert state["message"].startswith("1 reading")
    assert "1 readings" not in state["message"]
    assert service.patch(address, json={"skipped": "m01"}).status_code == 422
    assert service.patch(address, json={"skipped": state["next"]["label"]}).status_code == 200
    after = service.get(f"{address}/next").json()["next"]
    assert after["label"] == state["next"]["label"]
    apart = np.abs(np.array(after["joints"]) - state["next"]["joints"]).max()
    assert apart >= np.radians(10.0) - 1e-9


def test_a_goal_beyond_reach_is_said_after_ten_readings_by_joint(service):
    address = declared(service, goal={"kind": "joints", "relative": 0.001}, candidates=100)
    state = measured(service, address, 10)
    assert state["state"] == "cannot"
    assert "joint_" in state["message"]


def test_a_deflection_in_a_work_area_is_a_goal_and_a_decision(service):
    area = {"work_area": [[0.8, -0.6, 0.4], [1.9, 0.6, 1.6]]}
    address = declared(service, goal={"kind": "deflection", "uncertainty": 1.2e-5}, **area)
    begun = measured(service, address, 2)
    state = measured(service, address, 20)
    assert state["state"] == "reached"
    assert abs(len(state["readings"]) - len(begun["readings"]) - begun["still_needed"]) <= 3
    assert state["deflection_uncertainty"] <= 1.2e-5
    decided = measured(service, declared(service, goal={"kind": "decision", "limit": 0.05}, **area), 20)
    assert decided["state"] == "reached"
    assert decided["greatest_deflection"] + decided["deflection_uncertainty"] < 0.05


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"load": None}, "load"),
        ({"plan_id": "none"}, "open.plan_id"),
        ({"priors": {"joint_9": PRIOR}}, "open.priors.joint_9"),
        ({"priors": {"joint_2": PRIOR}, "load": {"kind": "own_weight"}}, "open.priors"),
        ({}, "open.load_point"),
    ],
)
def test_what_cannot_be_measured_is_refused_before_the_first_reading(service, changes, where):
    answer = service.post("/v1/measurement-sets", json=body_of(service, OPEN | changes))
    assert (answer.status_code, answer.json()["where"]) == (422, where)
    assert service.get("/v1/measurement-sets", params={"open": True}).json()["items"] == []


def test_open_sets_are_listed_deleted_and_restored_and_no_run_takes_one(service):
    address = declared(service)
    measured(service, address, 2)
    (listed,) = service.get("/v1/measurement-sets", params={"open": True}).json()["items"]
    assert (listed["open"], listed["observation_count"]) == (True, 2)
    assert service.get("/v1/measurement-sets").json()["items"] == []
    assert service.post("/v1/runs", json={"measurement_set_id": listed["id"]}).status_code == 422
    assert len(service.get(address).json()["observations"]) == 2
    assert service.patch(address, json={"name": "other"}).status_code == 422
    assert service.patch(address, json={"deleted": True}).status_code == 200
    assert service.get(f"{address}/next").status_code == 404
    assert service.patch(address, json={"deleted": False}).status_code == 200
    assert len(service.get(f"{address}/next").json()["readings"]) == 2


def test_a_load_point_among_the_options_is_that_of_the_set_in_its_unit(service):
    body = body_of(service, OPEN | {"load_point": list(LOAD_POINT)}, "mm")
    address = service.post("/v1/measurement-sets", json=body).headers["Location"]
    assert service.get(address).json()["load_point"] == pytest.approx([1e3 * part for part in LOAD_POINT])
    sent = read(service.get(f"{address}/next").json()["next"])
    for reading in sent["readings"]:
        reading |= {state: [1e3 * part for part in reading[state]] for state in ("unloaded", "loaded")}
    assert service.post(f"{address}/observations", json=sent).status_code == 201


@pytest.mark.parametrize("closed", [True, False])
def test_a_robot_goes_after_its_set_and_comes_back_before_it(service, closed):
    """The record of a campaign is deleted, restored and purged with its set."""
    address = declared(service)
    measured(service, address, 6)
    runs = [f"/v1/jobs/{service.post(f'{address}/close').json()['run_id']}"] if closed else []
    robot = f"/v1/robots/{service.get(address).json()['robot_id']}"
    store = service.app.state.parts.store
    for at in (*runs, address, robot):
        assert service.patch(at, json={"deleted": True}).status_code == 200, at
    assert service.patch(address, json={"deleted": False}).status_code == 404  # its robot is deleted
    for at in (robot, address):
        assert service.patch(at, json={"deleted": False}).status_code == 200, at
    assert len(service.get(f"{address}/next").json()["readings"]) == 6
    for at in (address, robot):
        assert service.patch(at, json={"deleted": True}).status_code == 200, at
    later = datetime.now(UTC) + 2 * KEEP_DELETED
    Recovery(store, service.app.state.parts.jobs_of, "alive", now=lambda: later).look()
    assert service.patch(robot, json={"deleted": False}).status_code == 404
    assert store.live_entries.of(set_id=address.rpartition("/")[2]) == []


def test_followers_are_told_of_each_change(service):
    address = declared(service)
    service.post(f"{address}/observations", json=read(service.get(f"{address}/next").json()["next"]))
    service.post(f"{address}/close")
    with service.stream("GET", f"{address}/next", params={"follow": True}) as stream:
        lines = [line for line in stream.iter_lines() if line.startswith("data")]
    assert len(lines) == 1
    assert '"state":"closed"' in lines[0]


def test_a_plan_that_goes_on_lends_the_load_of_its_campaign(service):
    body = body_of(service, {"goal": OPEN["goal"]}, load_point=list(LOAD_POINT))
    campaign = simulate_campaign(ARM, configurations=12, load="dead_weight", force=900.0, seed=2)
    readings = {**campaign["measurement_set"], "robot_id": body["robot_id"]}
    stored = service.post("/v1/measurement-sets", json=readings).json()["id"]
    asked = {"measurement_set_id": stored, "readings": 6, "joints": ["joint_2", "joint_3"]}
    body["open"]["plan_id"] = service.post("/v1/plans?wait=10", json=asked).json()["id"]
    answer = post(service, "/v1/measurement-sets", body)
    assert answer["live"]["next"]["force"] == pytest.approx([0.0, 0.0, -900.0])


def test_a_tablet_gets_the_address_of_the_page_as_a_code(service):
    address = declared(service)
    answer = service.get(f"{address}/code.svg", params={"page": "http://cell3:8000/"})
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/svg+xml")
    other = service.get(f"{address}/code.svg", params={"page": "https://cell3/"})
    assert "<svg" in answer.text != other.text
    assert service.get(f"{address}/code.svg", params={"page": "javascript:alert(1)"}).status_code == 422
    nothing = service.get("/v1/measurement-sets/none/code.svg", params={"page": "http://cell3/"})
    assert nothing.status_code == 404


def test_the_next_label_is_one_that_nobody_has_sent(service):
    address = declared(service)
    following = service.get(f"{address}/next").json()["next"]
    state = service.post(f"{address}/observations", json=read(following) | {"label": "m02"}).json()
    assert state["next"]["label"] == "m03"


def test_a_reading_that_comes_while_the_set_closes_is_in_it(service, monkeypatch):
    """What was answered 201 is not lost."""
    address = declared(service)
    state, closing = measured(service, address, 5), LiveCampaign.closing

    def late(self: LiveCampaign) -> dict[str, Any]:
        monkeypatch.undo()
        assert service.post(f"{address}/observations", json=read(state["next"])).status_code == 201
        return closing(self)  # of the record as it was loaded before

    monkeypatch.setattr(LiveCampaign, "closing", late)
    closed = service.post(f"{address}/close").json()
    stored = service.get(address).json()
    assert len(closed["readings"]) == len(stored["observations"]) == 6
    assert "6 readings" in closed["message"]


def test_a_record_with_its_load_point_in_one_place_is_completed(either_database_url, monkeypatch):
    """An open set that was declared before both places were filled in."""
    monkeypatch.setattr(stored, "completed", lambda post, options: post.model_copy(update={"open": options}))
    with Store.open(either_database_url) as store:
        with TestClient(create_app(store), base_url="http://127.0.0.1") as first:
            body = body_of(first, OPEN | {"load_point": list(LOAD_POINT)}, "mm")
            address = first.post("/v1/measurement-sets", json=body).headers["Location"]
        monkeypatch.undo()
        with TestClient(create_app(store), base_url="http://127.0.0.1") as second:
            completed = second.get(address).json()
    assert completed["load_point"] == pytest.approx([1e3 * part for part in LOAD_POINT])


LIVE = {
    "name": "live",
    "units": {"length": "m", "angle": "rad", "force": "N"},
    "encoders": "motor",
    "noise": EXACT,
    "load_point": list(LOAD_POINT),
    "open": {
        "goal": {"kind": "joints", "relative": 0.15},
        "load": {"kind": "any_direction", "force": 600.0},
        "targets": OPEN["targets"],
    },
}


def arm(*factors):
    """An arm whose stiffnesses are the usual ones times factors."""
    return replace(ARM, stiffnesses=ARM.stiffnesses * np.array(factors))


@pytest.fixture(scope="module")
def fleet():
    """A service with four sisters, each measured and identified, whose joints differ by some percent."""
    random = np.random.default_rng(4)
    with (
        Store.open("sqlite://") as store,
        TestClient(create_app(store), base_url="http://127.0.0.1") as client,
    ):
        for number in range(4):
            sister = arm(*np.exp(0.05 * random.standard_normal(6)))
            campaign = simulate_campaign(sister, configurations=20, load="pull", sigma=5e-6, seed=number)
            robot = posted(client, "robots", campaign["robot"] | {"name": f"sister {number}"})
            body = campaign["measurement_set"] | {"robot_id": robot, "noise": EXACT | {"sigma": 5e-6}}
            posted(client, "runs", {"measurement_set_id": posted(client, "measurement-sets", body)})
        yield client


def posted(client, collection, body):
    return post(client, f"/v1/{collection}", body)["id"]


def measured_to_goal(client, own, prior):
    """The last state of an arm that is measured live, and its run."""
    robot = posted(client, "robots", robot_document(own) | {"name": f"own {prior} {own.stiffnesses[2]:.0f}"})
    body = LIVE | {"robot_id": robot, "open": LIVE["open"] | {"prior": prior}}
    address = f"/v1/measurement-sets/{posted(client, 'measurement-sets', body)}"
    state = client.get(f"{address}/next").json()
    while state["state"] == "measuring":
        following = state["next"]
        reading = observation(own, following, sigma=SIGMA, seed=len(state["readings"]))
        state = client.post(f"{address}/observations", json=reading).json()
    closed = client.post(f"{address}/close").json()
    return state, client.get(f"/v1/runs/{closed['run_id']}").json(), client.get(address).json()["notes"]


@pytest.mark.slow
def test_an_arm_like_its_sisters_is_measured_sooner(fleet):
    own = arm(1.02, 0.97, 1.03, 0.96, 1.01, 0.98)
    alone, plain, _ = measured_to_goal(fleet, own, None)
    state, run, notes = measured_to_goal(fleet, own, "fleet")
    assert alone["state"] == state["state"] == "reached"
    assert len(state["readings"]) < len(alone["readings"])
    counting = [joint["name"] for joint in state["joints"] if joint["prior"] == "counts"]
    assert counting == list(run["request"]["priors"])
    assert f"Prior knowledge counts: {', '.join(counting)}" in notes
    assert plain["request"]["priors"] == {}
    for joint, stiffness in zip(state["joints"], own.stiffnesses, strict=True):
        low, high = joint["interval"]
        assert 0.98 * low <= stiffness <= 1.02 * high


def test_a_joint_that_deviates_is_found_and_not_pulled_to_the_mean(fleet):
    own = arm(1.0, 1.0, 0.6, 1.0, 1.0, 1.0)
    state, run, notes = measured_to_goal(fleet, own, "fleet")
    joint = state["joints"][2]
    assert (joint["name"], joint["prior"]) == ("joint_3", "deviates")
    assert abs(joint["stiffness"] / own.stiffnesses[2] - 1.0) < 0.08
    assert "joint_3" not in run["request"]["priors"]
    assert "disagree with it: joint_3" in notes


def test_a_fleet_of_three_other_arms_at_least(fleet):
    model = {"format": "catalogue", "arm": "KUKA KR 210 R2700 extra"}
    lone = posted(fleet, "robots", {"name": "lone", "model": model})
    body = LIVE | {"robot_id": lone, "open": LIVE["open"] | {"prior": "fleet"}}
    assert post(fleet, "/v1/measurement-sets", body, 422)["where"] == "open.prior"


def test_only_independent_runs_of_other_arms_are_sisters():
    """No run with priors, none that is not to be used, and none that may be of the arm itself."""
    campaign = simulate_campaign(ARM, configurations=12, load="pull", sigma=5e-6, seed=1)
    random = np.random.default_rng(3)
    with (
        Store.open("sqlite://") as store,
        TestClient(create_app(store), base_url="http://127.0.0.1") as client,
    ):

        def run(robot, *, spoilt=False, number=None, **options):
            body = campaign["measurement_set"] | {"robot_id": robot, "noise": EXACT | {"sigma": 5e-6}}
            observations = copy.deepcopy(body["observations"])
            for reading in (each for one in observations for each in one["readings"]):
                error = 2e-3 * random.standard_normal(3) if spoilt else np.zeros(3)
                reading["loaded"] = (np.array(reading["loaded"]) + error).tolist()
            body |= {"observations": observations, "serial_number": number}
            made = posted(
                client, "runs", {"measurement_set_id": posted(client, "measurement-sets", body)} | options
            )
            return client.get(f"/v1/runs/{made}").json()["result"]

        own, second, third, fourth = (
            posted(client, "robots", campaign["robot"] | {"name": name})
            for name in ("own", "second", "third", "fourth")
        )
        stiffness = run(own)["joints"][1]["stiffness"]
        run(own, number="SN-1")
        prior = {"stiffness": 2 * stiffness, "standard_uncertainty": 1e-3 * stiffness}
        run(second, priors={"joint_2": prior})
        assert run(third, spoilt=True)["assessment"]["verdict"] == "do_not_use"
        run(fourth, number="SN-1")
        trends = Trends(store)
        assert trends.sisters(own, "SN-1", "motor") == []
        assert len(trends.sisters(own, "SN-2", "motor")) == 2
        (sister,) = trends.sisters(own, None, "motor")
        assert sister["joint_2"].stiffness == pytest.approx(stiffness)


def results(*compliances):
    return [
        {
            "joint_1": JointResult.model_construct(name="joint_1", compliance=compliance),
            "joint_2": JointResult.model_construct(name="joint_2", compliance=None),
        }
        for compliance in compliances
    ]


def test_a_prior_is_one_more_of_the_population():
    """By arithmetic: mean 1e-6, scatter 1e-7, times √(4/3) and Student's 4.303 over 1.96."""
    priors = priors_of(results(0.9e-6, 1.0e-6, 1.1e-6))
    assert list(priors) == ["joint_1"]
    assert priors["joint_1"].stiffness == pytest.approx(1e6)
    assert priors["joint_1"].standard_uncertainty == pytest.approx(
        1e5 * np.sqrt(4 / 3) * 4.3027 / 1.96, rel=1e-3
    )
    with pytest.raises(RequestError, match="fewer than 3"):
        priors_of(results(0.9e-6, 1.0e-6))


@pytest.mark.parametrize(
    ("compliance", "uncertainty", "standing"),
    [(1.0, 0.3, "waits"), (1.1, 0.1, "counts"), (1.6, 0.1, "deviates"), (np.nan, 0.0, "waits")],
)
def test_a_prior_waits_until_the_own_readings_know_as_much(compliance, uncertainty, standing):
    priors = priors_of(results(0.9e-6, 1.0e-6, 1.1e-6))
    known = Known(np.array([1e-6 * compliance]), np.array([[(1e-6 * uncertainty) ** 2]]), 2.0)
    assert standings(["joint_1"], known, priors) == {"joint_1": standing}
