"""Forces in another unit than the declared one, of a robot with a payload: each tap puts them right."""

from copy import deepcopy

import pytest
from support.api import post
from support.mistakes import clean_campaign
from support.shared_data import shared

import jointstiff as js
from jointstiff.service.tables.report import remedies

CODE = "stiffness_against_payload"
NEWTONS = {"N": 1.0, "kgf": 9.80665, "lbf": 4.4482216152605}
OPTIONS = {"complementary_stiffness": "included"}


def noted(unit, declared, payload=240.0):
    """Return the clean campaign with its forces noted in a unit, and another one declared."""
    return in_unit(clean_campaign(), unit, declared, payload)


def in_unit(document, unit, declared, payload):
    """Return a campaign, whose forces are in N, with numbers in a unit, and another one declared."""
    document = deepcopy(document)
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


def test_without_a_payload_nothing_shows():
    assert js.identify(noted("kgf", "N", payload=None), **OPTIONS).result.assessment.verdict == "use"


def test_the_terminal_offers_to_apply_the_first_unit():
    first, second = remedies(js.identify(noted("kgf", "N"), **OPTIONS).result.assessment, applies=True)
    assert first == (
        "check in which unit the forces were read; if in kgf, set `units.force` to kgf; omit a `payload` "
        "that is not known, or repeat the command with `--apply convert_units`"
    )
    assert second == (
        "check in which unit the forces were read; if in lbf, set `units.force` to lbf; omit a `payload` "
        "that is not known"
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


def test_an_arm_of_the_catalogue_has_its_payload_unless_another_one_is_stated(client):
    model = {"format": "catalogue", "arm": "KUKA KR 210 R2700 extra"}
    robots = [{"name": "cell", "model": model}, {"name": "cell", "model": model, "payload": 150.0}]
    stored = [client.get(f"/v1/robots/{post(client, '/v1/robots', each)['id']}").json() for each in robots]
    assert [each["payload"] for each in stored] == [210.0, 150.0]
    assert stored[0]["content_hash"] == stored[1]["content_hash"]
