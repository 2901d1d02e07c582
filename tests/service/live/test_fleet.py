"""Priors of a fleet: arms that agree are measured sooner, and one that deviates is not pulled to the mean."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from fastapi.testclient import TestClient
from support.api import post
from support.live import observation

from jointstiff.schemas.run import JointResult
from jointstiff.service.app import create_app
from jointstiff.service.kinds.trend import Trends
from jointstiff.service.live.fleet import priors_of, standings
from jointstiff.service.store.store import Store
from jointstiff.simulator import (
    LOAD_POINT,
    TARGETS,
    default_arm,
    robot_document,
    simulate_campaign,
)
from jointstiff.solver.errors import RequestError
from jointstiff.solver.live.ahead import Known

ARM, SIGMA = default_arm(), 2e-5
EXACT = {"sigma": SIGMA, "load_point": 1e-4, "force": {"scale": 1e-3}}
LIVE = {
    "name": "live",
    "units": {"length": "m", "angle": "rad", "force": "N"},
    "encoders": "motor",
    "noise": EXACT,
    "load_point": list(LOAD_POINT),
    "open": {
        "goal": {"kind": "joints", "relative": 0.1},
        "load": {"kind": "any_direction", "force": 600.0},
        "targets": {name: list(place) for name, place in TARGETS.items()},
    },
}


def arm(*factors):
    """An arm whose stiffnesses are the usual ones times factors."""
    return replace(ARM, stiffnesses=ARM.stiffnesses * np.array(factors))


@pytest.fixture(scope="module")
def service():
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


def measured(client, own, prior):
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


def test_an_arm_like_its_sisters_is_measured_sooner(service):
    own = arm(1.02, 0.97, 1.03, 0.96, 1.01, 0.98)
    alone, plain, _ = measured(service, own, None)
    state, run, notes = measured(service, own, "fleet")
    assert alone["state"] == state["state"] == "reached"
    assert len(state["readings"]) < len(alone["readings"])
    counting = [joint["name"] for joint in state["joints"] if joint["prior"] == "counts"]
    assert counting == list(run["request"]["priors"])
    assert f"Prior knowledge counts: {', '.join(counting)}" in notes
    assert plain["request"]["priors"] == {}
    for joint, stiffness in zip(state["joints"], own.stiffnesses, strict=True):
        low, high = joint["interval"]
        assert 0.98 * low <= stiffness <= 1.02 * high


def test_a_joint_that_deviates_is_found_and_not_pulled_to_the_mean(service):
    own = arm(1.0, 1.0, 0.6, 1.0, 1.0, 1.0)
    state, run, notes = measured(service, own, "fleet")
    joint = state["joints"][2]
    assert (joint["name"], joint["prior"]) == ("joint_3", "deviates")
    assert abs(joint["stiffness"] / own.stiffnesses[2] - 1.0) < 0.08
    assert "joint_3" not in run["request"]["priors"]
    assert "disagree with it: joint_3" in notes


def test_a_fleet_of_three_other_arms_at_least(service):
    model = {"format": "catalogue", "arm": "KUKA KR 210 R2700 extra"}
    lone = posted(service, "robots", {"name": "lone", "model": model})
    body = LIVE | {"robot_id": lone, "open": LIVE["open"] | {"prior": "fleet"}}
    assert post(service, "/v1/measurement-sets", body, 422)["where"] == "open.prior"


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
