"""Forces in another unit than the declared one, of a robot with a payload: each tap puts them right."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from support.api import post
from support.mistakes import clean_campaign
from support.shared_data import shared

import jointstiff as js
from jointstiff.service.tables.report import remedies
from jointstiff.simulator import default_arm, simulate_campaign

CODE = "stiffness_against_payload"
NEWTONS = {"N": 1.0, "kgf": 9.80665, "lbf": 4.4482216152605}
OPTIONS = {"complementary_stiffness": "included"}


def noted(unit, declared, payload=240.0):
    """Return the clean campaign with its forces noted in a unit, and another one declared."""
    return in_unit(clean_campaign(), unit, declared, payload)


def in_unit(document, unit, declared, payload):
    """Return a campaign, whose forces are in N, with numbers in a unit, and another one declared."""
    document = deepcopy(document)
    document["robot"].pop("payload", None)
    if payload is not None:
        document["robot"]["payload"] = payload
    measured = document["measurement_set"]
    for observation in measured["observations"]:
        observation["force"] = [part / NEWTONS[unit] for part in observation["force"]]
    measured["units"]["force"] = declared
    return document


@pytest.fixture(scope="module")
def clean():
    return js.identify(noted("N", "N"), **OPTIONS).result


def assert_same_numbers(result, wanted):
    for joint, other in zip(result.joints, wanted.joints, strict=True):
        assert joint.compliance == pytest.approx(other.compliance, rel=1e-9)
        assert joint.compliance_interval == pytest.approx(other.compliance_interval, rel=1e-6)


def test_a_clean_run_of_a_robot_with_a_payload_is_used(clean):
    assert (clean.assessment.verdict, clean.assessment.reasons) == ("use", [])


@pytest.mark.parametrize(("unit", "declared"), [("N", "kgf"), ("N", "lbf"), ("kgf", "N"), ("lbf", "N")])
def test_the_first_tap_has_the_numbers_of_the_right_unit(unit, declared, clean):
    before = js.identify(noted(unit, declared), **OPTIONS)
    assessment = before.result.assessment
    assert assessment.verdict == "use_with_care"
    assert {reason.code for reason in assessment.reasons} == {CODE}
    after = before.apply("convert_units")
    assert after.campaign.measurement_set.units.force == unit
    assert after.campaign.measurement_set.name.endswith(f"(in {unit})")
    assert (after.result.assessment.verdict, after.result.assessment.reasons) == ("use", [])
    assert_same_numbers(after.result, clean)


@pytest.mark.parametrize(("unit", "declared", "taps"), [
    ("N", "N", []), ("N", "kgf", ["N"]), ("kgf", "N", ["kgf", "lbf"]), ("lbf", "N", ["lbf", "kgf"])
])  # fmt: skip
def test_a_confused_unit_is_found_on_a_real_arm(unit, declared, taps):
    document = shared("fanuc_r2000ic/campaign")
    result = js.identify(in_unit(document, unit, declared, 240.0), elasticity="joints").result
    offered = [each.action.unit for each in result.assessment.reasons if each.code == CODE]
    assert offered == taps


@pytest.mark.parametrize(
    ("unit", "declared"), [("N", "N"), ("kgf", "N"), ("lbf", "N"), ("N", "kgf"), ("N", "lbf")]
)
def test_a_robot_without_a_payload_is_one_question_and_no_verdict(unit, declared, clean):
    before = js.identify(noted(unit, declared, payload=None), **OPTIONS)
    assert (before.verdict, before.reasons) == ("use", [])
    (question,) = before.result.assessment.questions
    assert (question.code, question.weight) == ("payload_not_stated", "use")
    assert question.code not in {warning.code for warning in before.result.warnings}
    assert "Question: the robot states no payload" in str(before)
    after = before.apply("state_payload", payload=240.0)
    assert after.campaign.robot.payload == 240.0
    assert after.result.assessment.questions == []
    codes = {reason.code for reason in after.result.assessment.reasons}
    assert codes == (set() if unit == declared else {CODE})


@pytest.mark.parametrize("unit", ["kgf", "lbf"])
@pytest.mark.parametrize("seed", range(10))
def test_no_bare_urdf_in_kgf_or_lbf_is_use_without_the_question_or_after_its_answer(unit, seed):
    """The arms' springs are up to a third softer or stiffer than those of the default arm of 240 kg."""
    draw = np.random.default_rng(seed)
    arm = default_arm()
    springs = arm.stiffnesses * np.exp(0.3 * draw.uniform(-1.0, 1.0, 6))
    document = simulate_campaign(
        replace(arm, stiffnesses=springs, payload=None), load="pull", configurations=12, seed=seed
    )
    assert document["robot"].keys() == {"name", "model"}
    before = js.identify(in_unit(document, unit, "N", None), **OPTIONS)
    assert "payload_not_stated" in {question.code for question in before.result.assessment.questions}
    after = before.apply("state_payload", payload=240.0)
    assert CODE in {reason.code for reason in after.result.assessment.reasons}


@pytest.mark.parametrize(("action", "payload", "reason"), [
    ("state_payload", None, "no payload is stated"),
    ("state_payload", 0.0, "a payload of 0 kg is not plausible"),
    ("state_payload", float("nan"), "a payload of nan kg is not plausible"),
    ("convert_units", 240.0, "does not recommend 'convert_units'"),
])  # fmt: skip
def test_a_payload_that_is_none_is_refused(action, payload, reason):
    run = js.identify(noted("N", "N", payload=None), **OPTIONS)
    with pytest.raises(js.CampaignError, match=reason):
        run.apply(action, payload=payload)


def test_a_payload_belongs_to_no_other_action():
    run = js.identify(noted("kgf", "N"), **OPTIONS)
    with pytest.raises(js.CampaignError, match="needs no payload"):
        run.apply("convert_units", payload=240.0)


def test_a_robot_in_python_may_be_made_with_its_payload():
    urdf = clean_campaign()["robot"]["model"]["urdf"]
    assert js.robot(urdf).payload is None
    assert js.robot(urdf, payload=240.0).payload == 240.0


def test_the_terminal_offers_to_apply_the_first_unit():
    first, second = remedies(js.identify(noted("lbf", "N"), **OPTIONS).result.assessment, applies=True)
    assert first == (
        "check in which unit the forces were read; if the numbers are right, use the result with care; if "
        "in lbf, set `units.force` to lbf, or repeat the command with `--apply convert_units`"
    )
    assert second == (
        "check in which unit the forces were read; if the numbers are right, use the result with care; if "
        "in kgf, set `units.force` to kgf"
    )


def test_the_terminal_offers_the_option_for_the_payload():
    (remedy,) = remedies(js.identify(noted("N", "N", None), **OPTIONS).result.assessment, applies=True)
    assert remedy == (
        "state `payload`, the largest payload of the robot by its maker, in kg, or repeat the command with "
        "`--payload KG`"
    )


def test_a_service_offers_each_unit_and_keeps_the_payload(client, clean):
    document = noted("lbf", "N")
    robot = post(client, "/v1/robots", document["robot"] | {"name": "with a payload"})
    assert client.get(f"/v1/robots/{robot['id']}").json()["payload"] == 240.0
    stored = post(client, "/v1/measurement-sets", document["measurement_set"] | {"robot_id": robot["id"]})
    run = post(client, "/v1/runs?wait=30", {"measurement_set_id": stored["id"], **OPTIONS})
    reasons = run["result"]["assessment"]["reasons"]
    assert [reason["action"]["unit"] for reason in reasons] == ["lbf", "kgf"]
    for reason, factor in zip(reasons, (1.0, NEWTONS["lbf"] / NEWTONS["kgf"]), strict=True):
        mended = post(client, f"/v1/runs/{run['id']}/apply?wait=30", reason["action"])
        assert mended["result"]["assessment"]["verdict"] == "use"
        for joint, wanted in zip(mended["result"]["joints"], clean.joints, strict=True):
            assert joint["compliance"] == pytest.approx(factor * wanted.compliance, rel=1e-6)


def test_a_service_keeps_the_payload_with_the_robot_for_every_later_run(client):
    document = noted("N", "N", payload=None)
    robot = post(client, "/v1/robots", document["robot"] | {"name": "bare"})
    stored = post(client, "/v1/measurement-sets", document["measurement_set"] | {"robot_id": robot["id"]})
    request = {"measurement_set_id": stored["id"], **OPTIONS}
    run = post(client, "/v1/runs?wait=30", request)
    (question,) = run["result"]["assessment"]["questions"]
    answer = question["action"] | {"payload": 240.0}
    mended = post(client, f"/v1/runs/{run['id']}/apply?wait=30", answer)
    assert (mended["result"]["assessment"]["verdict"], mended["request"]["variant_of"]) == ("use", run["id"])
    assert post(client, f"/v1/runs/{run['id']}/apply?wait=30", answer)["id"] == mended["id"]
    kept = client.get(f"/v1/robots/{robot['id']}").json()
    assert (kept["payload"], kept["name"], kept["content_hash"]) == (240.0, "bare", robot["content_hash"])
    later = post(client, "/v1/runs?wait=30", request)["result"]["assessment"]
    assert (later["verdict"], later["questions"]) == ("use", [])
    light = client.patch(f"/v1/robots/{robot['id']}", json={"payload": 6.0}).json()
    assert light["payload"] == 6.0
    again = post(client, "/v1/runs?wait=30", request)["result"]["assessment"]
    assert {reason["code"] for reason in again["reasons"]} == {CODE}


@pytest.mark.parametrize("changes", [{"payload": None}, {"kind": "use_huber", "payload": 240.0}])
def test_a_service_refuses_an_answer_without_its_number_or_to_another_question(client, changes):
    document = noted("N", "N", payload=None)
    robot = post(client, "/v1/robots", document["robot"])
    stored = post(client, "/v1/measurement-sets", document["measurement_set"] | {"robot_id": robot["id"]})
    run = post(client, "/v1/runs?wait=30", {"measurement_set_id": stored["id"], **OPTIONS})
    (question,) = run["result"]["assessment"]["questions"]
    refused = client.post(f"/v1/runs/{run['id']}/apply", json=question["action"] | changes)
    assert (refused.status_code, refused.json()["where"]) in {(422, "payload"), (422, "kind")}
    assert client.get(f"/v1/robots/{robot['id']}").json()["payload"] is None


def test_an_arm_of_the_catalogue_has_its_payload_unless_another_one_is_stated(client):
    model = {"format": "catalogue", "arm": "KUKA KR 210 R2700 extra"}
    robots = [{"name": "cell", "model": model}, {"name": "cell", "model": model, "payload": 150.0}]
    stored = [client.get(f"/v1/robots/{post(client, '/v1/robots', each)['id']}").json() for each in robots]
    assert [each["payload"] for each in stored] == [210.0, 150.0]
    assert stored[0]["content_hash"] == stored[1]["content_hash"]
