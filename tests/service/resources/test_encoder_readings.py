"""Sets with readings of encoders: a wrong sign is warned of, what they need is asked for."""

import copy

import pytest
from fastapi.testclient import TestClient
from support.api import post
from support.readings import with_encoders

from jointstiff.service.app import create_app
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign

ARM = default_arm()
BOTH = "give both `noise.sigma` and `noise.encoder_sigma`, which weight angles against lengths"


@pytest.fixture(scope="module")
def client():
    with (
        Store.open("sqlite://") as store,
        TestClient(create_app(store), base_url="http://127.0.0.1") as client,
    ):
        yield client


@pytest.fixture(scope="module")
def encoded(client):
    document = with_encoders(ARM, simulate_campaign(ARM, load="pull", seed=3), noise=5e-6)
    robot = post(client, "/v1/robots", document["robot"])["id"]
    return document["measurement_set"] | {"robot_id": robot}


def test_an_encoder_against_its_torque_is_warned_of(client, encoded):
    turned = copy.deepcopy(encoded)
    for one in turned["observations"]:
        fourth = one["encoder_readings"][3]
        fourth |= {state: -fourth[state] for state in ("unloaded", "loaded")}
    (warning,) = post(client, "/v1/measurement-sets", turned)["warnings"]
    assert (warning["code"], warning["weight"]) == ("encoder_against_torque", "use_with_care")
    assert warning["message"] == (
        "the encoder of joint_4 shows -989 µrad, opposite to the torque of 441.7 N.m, in 18 of 19 readings"
    )
    assert warning["remedy"] == (
        "check that the encoder has the sign of the model's joint, not of the "
        "controller's; check the signs of the force; check that unloaded and "
        "loaded readings are not exchanged"
    )
    assert post(client, "/v1/measurement-sets", encoded)["warnings"] == []


@pytest.mark.parametrize(
    ("change", "where", "detail", "remedy"),
    [
        (
            {"noise": None},
            "noise",
            "there are encoder readings, but the uncertainty of these readings is not stated",
            BOTH,
        ),
        (
            {"noise": {"sigma": 2e-5}},
            "noise.encoder_sigma",
            "there are encoder readings, but the uncertainty of these readings is not stated",
            BOTH,
        ),
        (
            {"encoders": "secondary"},
            "observations[0].encoder_readings",
            "observation 'c01': the position loop closes on the secondary encoders, so these encoders show "
            "no deflection",
            "omit `encoder_readings`, or measure with the loop closed on the motors' encoders",
        ),
    ],
)
def test_encoder_readings_need_their_uncertainty_and_motors_that_hold(
    client, encoded, change, where, detail, remedy
):
    problem = post(client, "/v1/measurement-sets", encoded | change, 422)
    assert (problem["where"], problem["detail"], problem["remedy"]) == (where, detail, remedy)
