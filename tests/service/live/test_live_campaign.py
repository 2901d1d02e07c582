"""Live campaigns: exact springs read posture by posture, mistakes named at the reading, priors."""

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import anyio
import numpy as np
import pytest
from fastapi.testclient import TestClient
from support.api import post
from support.live import ARM, EXACT, OPEN, SIGMA, declared, described, measured, observation, read

from jointstiff.schemas.options import StiffnessPrior
from jointstiff.service.api import live
from jointstiff.service.app import create_app
from jointstiff.service.live.campaign import LiveCampaign
from jointstiff.service.store.store import Store
from jointstiff.simulator import LOAD_POINT, robot_document
from jointstiff.solver.live.ahead import KnownCompliances
from jointstiff.solver.live.priors import compare_priors
from jointstiff.solver.live.progress import Progress


@pytest.fixture
def service(either_database_url: str) -> Iterator[TestClient]:
    with (
        Store.open(either_database_url) as store,
        TestClient(create_app(store), base_url="http://127.0.0.1") as client,
    ):
        yield client


def test_a_silent_stream_of_an_open_set_sends_comments(monkeypatch):
    """Else a proxy does not notice that its time is over, and loses the next event."""
    assert live.QUIET_SECONDS <= 15.0
    monkeypatch.setattr(live, "POLL_SECONDS", 0.001)
    monkeypatch.setattr(live, "QUIET_SECONDS", 0.0025)
    monkeypatch.setattr(live, "POLLS_PER_CHECK", 10**9)
    state = SimpleNamespace(revision=3, state="measuring", model_dump_json=lambda: "{}")
    application = SimpleNamespace(state=SimpleNamespace(gate=None, work=None, is_closing=lambda: False))
    sets = SimpleNamespace(revision=lambda _: 3)

    async def first(count: int) -> list[bytes]:
        stream = live._stream_states(SimpleNamespace(app=application), sets, "set", state)
        return [await anext(stream) for _ in range(count)]

    event, *silent = anyio.run(first, 4)
    assert event.startswith(b"event: state\n")
    assert silent == [b": ping\n\n"] * 3


def test_a_campaign_is_measured_until_its_goal_is_met_and_becomes_an_ordinary_set(service):
    address = declared(service)
    state = measured(service, address, 30)
    assert state["state"] == "reached"
    assert "assumed" not in state["message"]  # all errors are stated
    assert len(state["readings"]) <= 13
    assert state["share"] <= 1.0
    assert [each["ball_ratio"] is not None for each in state["readings"]][-1]
    assert state["readings"][-1]["ball_ratio"] <= 1.0
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
    assert "90 % of good readings" in stored["notes"]
    run = service.get(f"/v1/jobs/{closed['run_id']}").json()
    assert run["state"] == "succeeded"
    first = {name: stored["observations"][0][name] for name in ("joints", "force")}
    late = service.post(f"{address}/observations", json=read({**run, "label": "m99", **first}))
    assert (late.status_code, late.json()["type"]) == (409, "urn:jointstiff:problem:closed")


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


def test_a_reading_that_comes_while_the_set_closes_is_in_it(service, monkeypatch):
    """What was answered 201 is not lost."""
    address = declared(service)
    state, closing = measured(service, address, 5), LiveCampaign.fields_when_closed

    def late(self: LiveCampaign) -> dict[str, Any]:
        monkeypatch.undo()
        assert service.post(f"{address}/observations", json=read(state["next"])).status_code == 201
        return closing(self)  # of the record as it was loaded before

    monkeypatch.setattr(LiveCampaign, "fields_when_closed", late)
    closed = service.post(f"{address}/close").json()
    stored = service.get(address).json()
    assert len(closed["readings"]) == len(stored["observations"]) == 6
    assert "6 readings" in closed["message"]


def arm(*factors):
    """An arm whose stiffnesses are the usual ones times factors."""
    return replace(ARM, stiffnesses=ARM.stiffnesses * np.array(factors))


PRIORS = {
    f"joint_{j}": {"stiffness": k, "standard_uncertainty": 0.06 * k}
    for j, k in enumerate(ARM.stiffnesses, start=1)
}
"""What is known of arms of this kind: their stiffnesses, which differ by some percent."""


@pytest.fixture(scope="module")
def client():
    with (
        Store.open("sqlite://") as store,
        TestClient(create_app(store), base_url="http://127.0.0.1") as client,
    ):
        yield client


def posted(client, collection, body):
    return post(client, f"/v1/{collection}", body)["id"]


def measured_to_goal(client, own, priors, relative=0.15):
    """The last state of an arm that is measured live until its joints are known so well, and its run."""
    robot = posted(
        client, "robots", robot_document(own) | {"name": f"own {len(priors)} {own.stiffnesses[2]:.0f}"}
    )
    goal = {"kind": "joints", "relative": relative}
    options = OPEN | {"goal": goal, "load": {"kind": "any_direction", "force": 600.0}, "priors": priors}
    body = described(robot, options, noise=EXACT, load_point=list(LOAD_POINT))
    address = f"/v1/measurement-sets/{posted(client, 'measurement-sets', body)}"
    state = client.get(f"{address}/next").json()
    while state["state"] == "measuring":
        following = state["next"]
        reading = observation(own, following, sigma=SIGMA, seed=len(state["readings"]))
        state = client.post(f"{address}/observations", json=reading).json()
    closed = client.post(f"{address}/close").json()
    return state, client.get(f"/v1/jobs/{closed['run_id']}").json(), client.get(address).json()["notes"]


@pytest.mark.slow
def test_an_arm_like_its_priors_meets_a_goal_tighter_than_them_sooner(client):
    """A prior waits until the own readings know as much: a goal of ± 15 % is met before ± 12 % counts."""
    own = arm(1.02, 0.97, 1.03, 0.96, 1.01, 0.98)
    alone, plain, _ = measured_to_goal(client, own, {}, relative=0.1)
    state, run, notes = measured_to_goal(client, own, PRIORS, relative=0.1)
    assert alone["state"] == state["state"] == "reached"
    assert len(state["readings"]) < len(alone["readings"])
    counting = [joint["name"] for joint in state["joints"] if joint["prior"] == "counts"]
    assert counting == list(run["request"]["priors"])
    assert f"The prior knowledge is used for: {', '.join(counting)}" in notes
    assert plain["request"]["priors"] == {}
    for joint, stiffness in zip(state["joints"], own.stiffnesses, strict=True):
        low, high = joint["interval"]
        assert 0.98 * low <= stiffness <= 1.02 * high


def test_a_joint_that_deviates_is_found_and_not_pulled_to_its_prior(client):
    own = arm(1.0, 1.0, 0.6, 1.0, 1.0, 1.0)
    state, run, notes = measured_to_goal(client, own, PRIORS)
    joint = state["joints"][2]
    assert (joint["name"], joint["prior"]) == ("joint_3", "deviates")
    assert abs(joint["stiffness"] / own.stiffnesses[2] - 1.0) < 0.08
    assert "joint_3" not in run["request"]["priors"]
    assert "disagree with it, for: joint_3" in notes


@pytest.mark.parametrize(
    ("compliance", "uncertainty", "standing"),
    [(1.0, 0.3, "waits"), (1.1, 0.1, "counts"), (1.6, 0.1, "deviates"), (np.nan, 0.0, "waits")],
)
def test_a_prior_waits_until_the_own_readings_know_as_much(compliance, uncertainty, standing):
    u = 1e-7 * np.sqrt(4.0 / 3.0) * 4.303 / 1.96  # of the compliance 1e-6, as three other arms tell
    priors = {"joint_1": StiffnessPrior(stiffness=1e6, standard_uncertainty=1e12 * u)}
    known = KnownCompliances(np.array([1e-6 * compliance]), np.array([[(1e-6 * uncertainty) ** 2]]), 2.0)
    assert compare_priors(["joint_1"], known, priors) == {"joint_1": standing}


@pytest.mark.parametrize(
    ("awaits", "readings", "missing", "state"),
    [
        (True, 5, 1, {}),  # the goal is expected to be met with it
        (False, 4, 1, {}),
        (False, 5, 2, {}),
        (False, 5, 1, {"doubtful": ["m02"]}),
        (False, 10, 1, {"fewest_readings": 10}),
        (True, 5, 2, {"_uncertainty_suffices": True, "goal_is_met": True}),
        (True, 5, 1, {"_uncertainty_suffices": True, "goal_is_met": True, "is_checked": False}),
        (False, 5, 1, {"_uncertainty_suffices": True, "goal_is_met": True, "is_checked": True}),
        (False, 5, 1, {"_uncertainty_suffices": True}),  # a mistake is kept
    ],
)
def test_a_reading_is_held_out_when_the_goal_is_met_or_one_away(awaits, readings, missing, state):
    usual = {
        "fewest_readings": 5,
        "doubtful": [],
        "_uncertainty_suffices": False,
        "goal_is_met": False,
        "is_checked": False,
    }
    progress = SimpleNamespace(
        **usual | {"next": SimpleNamespace(missing=missing), "count": readings} | state
    )
    assert Progress.awaits_held_out.fget(progress) is awaits
