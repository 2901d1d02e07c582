"""Readings of secondary encoders as they are posted, stored, and shown on a run."""

from __future__ import annotations

import io
import json

import httpx2
import numpy as np
import pytest
from pydantic import ValidationError
from support.encoders import with_encoders

from jointstiff.schemas.measurement import MeasurementSetDocument, Observation
from jointstiff.service.conversion.readings import ReadingArrays, content_hash
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.campaign import equilibrium
from jointstiff.simulator.document import experiment_of

ARM = default_arm()

PINNED = {
    "name": "pinned",
    "units": {"length": "mm", "angle": "deg", "force": "kgf"},
    "encoders": "motor",
    "noise": {"sigma": 0.02},
    "load_point": [0.0, 0.0, 120.0],
    "observations": [
        {
            "label": "c01",
            "joints": [0.5, -30.25],
            "force": [0.0, 0.0, -150.0],
            "readings": [
                {
                    "target": "P10",
                    "unloaded": [1562.125, 151.25, 1120.5],
                    "loaded": [1561.875, 151.25, 1119.0],
                }
            ],
        },
        {
            "label": "c02",
            "joints": [1.5, 20.0],
            "force": [0.0, 10.0, -150.0],
            "readings": [
                {"target": "P10", "unloaded": [1462.125, 251.25, 1020.5], "loaded": [1461.875, 251.5, 1019.0]}
            ],
        },
    ],
}
"""Its hashes must not change: stored sets are told apart by them."""


def arranged(document):
    message = MeasurementSetDocument.model_validate(document)
    return message, ReadingArrays.from_observations(message.observations)


def campaign(**options):
    return with_encoders(ARM, simulate_campaign(ARM, load="pull", seed=3, **options), noise=5e-6)


@pytest.fixture(scope="module")
def robot_id(service):
    body = campaign(configurations=1)["robot"]
    return httpx2.post(f"{service.url}/v1/robots", json=body, timeout=60.0).json()["id"]


def test_the_hash_of_a_set_stays():
    assert content_hash(*arranged(PINNED)) == (
        "099cbe7ab50a985980e88f33ec831fce3cfd577dd91f72182dd502cd15341434"
    )
    silent = {name: value for name, value in PINNED.items() if name != "noise"}
    assert content_hash(*arranged(silent)) == (
        "9d395bf02804e4e6d3b9fe9fc641d299597732c3d5d15429890a27c0cbb5e34c"
    )


def test_sets_without_encoders_store_none():
    _, readings = arranged(PINNED)
    with np.load(io.BytesIO(readings.pack())) as archive:
        assert not [name for name in archive.files if name.startswith("encoder")]
    assert ReadingArrays.unpack(readings.pack()).encoders is None


def test_hash_changes_with_every_number():
    document = campaign(configurations=3)["measurement_set"]
    hashes = {content_hash(*arranged(document))}

    def changed(edit):
        copy = json.loads(json.dumps(document))
        edit(copy)
        return content_hash(*arranged(copy))

    def readings(copy):
        return copy["observations"][1]["encoder_readings"]

    edits = (
        lambda c: readings(c)[2].update(loaded=readings(c)[2]["loaded"] + 1e-12),
        lambda c: readings(c)[2].update(unloaded=readings(c)[2]["unloaded"] + 1e-12),
        lambda c: readings(c).pop(),
        lambda c: [o.pop("encoder_readings") for o in c["observations"]],
        lambda c: c["noise"].update(encoder_sigma=6e-6),
    )
    hashes |= {changed(edit) for edit in edits}
    assert len(hashes) == 1 + len(edits)


def test_what_is_stored_comes_back_bit_for_bit():
    document = campaign(configurations=5)["measurement_set"]
    del document["observations"][1]["encoder_readings"]
    del document["observations"][3]["encoder_readings"][2:]
    _, readings = arranged(document)
    restored = ReadingArrays.unpack(readings.pack())
    assert restored.digest() == readings.digest()
    for sent, kept in zip(document["observations"], restored.observations(), strict=True):
        dumped = json.loads(kept.model_dump_json(exclude_none=True))
        assert dumped.get("encoder_readings") == sent.get("encoder_readings")


def test_over_the_api(client, robot_id):
    body = campaign()["measurement_set"] | {"robot_id": robot_id}
    stored = client.post("/v1/measurement-sets", json=body).json()
    assert stored["warnings"] == []
    assert stored["noise"]["encoder_sigma"] == 5e-6
    again = client.get(f"/v1/measurement-sets/{stored['id']}").json()
    for sent, kept in zip(body["observations"], again["observations"], strict=True):
        assert kept["encoder_readings"] == sent["encoder_readings"]
    result = client.post("/v1/runs", json={"measurement_set_id": stored["id"]}).json()["result"]
    assert len(result["encoder_residuals"]) == 19 * 6
    experiment = experiment_of(campaign())
    exact = equilibrium(ARM, experiment.joints, *experiment.wrenches)
    for residual in result["encoder_residuals"]:
        i, j = int(residual["observation"][1:]) - 1, int(residual["joint"][-1]) - 1
        assert residual["predicted"] == pytest.approx(exact[i, j], abs=2e-5)
        assert residual["residual"] == pytest.approx(residual["deflection"] - residual["predicted"])
        assert abs(residual["residual"]) < 5 * np.sqrt(2) * 5e-6
    assert result["goodness"]["degrees_of_freedom"] == pytest.approx(19 * (9 + 6) - 6)


def test_a_run_without_encoders_has_no_encoder_residuals(client, robot_id):
    body = simulate_campaign(ARM, load="pull", seed=3)["measurement_set"] | {"robot_id": robot_id}
    stored = client.post("/v1/measurement-sets", json=body).json()
    run = client.post("/v1/runs", json={"measurement_set_id": stored["id"]}).json()
    assert run["result"]["encoder_residuals"] == []
    assert stored["observations"][0]["encoder_readings"] is None


def test_encoders_make_uncertainties_smaller(client, robot_id):
    uncertainties = []
    for document in (campaign(), simulate_campaign(ARM, load="pull", seed=3)):
        body = document["measurement_set"] | {"robot_id": robot_id}
        set_id = client.post("/v1/measurement-sets", json=body).json()["id"]
        joints = client.post("/v1/runs", json={"measurement_set_id": set_id}).json()["result"]["joints"]
        uncertainties.append([joint["budget"]["readings"] for joint in joints])  # the load point's stays
    assert (np.array(uncertainties[0]) < 0.7 * np.array(uncertainties[1])).all()


def test_a_wrong_sign_is_a_warning(client, robot_id):
    body = campaign()["measurement_set"] | {"robot_id": robot_id}
    for observation in body["observations"]:
        reading = observation["encoder_readings"][3]
        reading["unloaded"], reading["loaded"] = -reading["unloaded"], -reading["loaded"]
    (warning,) = client.post("/v1/measurement-sets", json=body).json()["warnings"]
    assert warning["code"] == "encoder_against_torque"
    assert "joint_4" in warning["message"]


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"noise": None}, "noise"),
        ({"noise": {"sigma": 2e-5}}, "noise.encoder_sigma"),
        ({"encoders": "secondary"}, "observations[0].encoder_readings"),
    ],
)
def test_refusals_say_where_and_how_to_mend_it(client, robot_id, change, where):
    body = campaign()["measurement_set"] | {"robot_id": robot_id} | change
    answer = client.post("/v1/measurement-sets", json=body)
    assert answer.status_code == 422
    assert answer.json()["where"] == where
    assert answer.json()["remedy"]


@pytest.mark.parametrize(
    "readings",
    [
        [],
        [{"joint": "joint_1", "unloaded": 0.0}],
        [{"joint": "joint_1", "unloaded": 0.0, "loaded": "0.1"}],
        [{"joint": f"joint_{j}", "unloaded": 0.0, "loaded": 0.0} for j in range(100)],
    ],
)
def test_readings_of_another_form_are_refused(readings):
    observation = PINNED["observations"][0] | {"encoder_readings": readings}
    with pytest.raises(ValidationError):
        Observation.model_validate(observation)
