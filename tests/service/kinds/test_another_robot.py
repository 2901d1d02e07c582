"""A campaign with the wrong robot: one action chooses the right one, of the catalogue or stored."""

from functools import cache

import pytest
from support.api import post
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js
from jointstiff.schemas.finding import AdvisedAction
from jointstiff.service.conversion.catalogue import catalogue
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.service.tables.report import remedies
from jointstiff.simulator import default_arm, simulate_campaign

MEASURED, CHOSEN = "Stäubli TX2-90", "KUKA KR 210 R2700 extra"
"""Arms of the catalogue; no other test stores the first one in the shared service."""


@cache
def campaign(measured=MEASURED, chosen=CHOSEN):
    robots = {known.name: known.robot for known in build_nominal_robots()}
    read = readings_on(robots[measured], seed=2, configurations=12, length=1e-4, angle=1e-4)
    return js.Campaign.from_arrays(
        chosen,
        read.joints,
        read.force,
        load_point=read.load_point[0],
        unloaded=read.position,
        loaded=read.position + read.deflection,
        units="m, rad, N",
        sigma=read.sigma,
    )


def codes(result):
    return [reason.code for reason in result.assessment.reasons]


def test_the_action_identifies_with_the_arm_that_was_measured():
    before = js.identify(campaign())
    assert codes(before.result) == ["another_robot_fits"]
    after = before.apply("choose_robot")
    assert after.campaign.robot.name == f"{MEASURED} (nominal)"
    assert after.campaign.measurement_set.name == f"readings from arrays ({MEASURED})"
    assert after.campaign.measurement_set.observations == campaign().measurement_set.observations
    assert codes(after.result) == codes(js.identify(campaign(chosen=MEASURED)).result)


@pytest.mark.parametrize(
    ("arm", "right", "wrong"),
    [(CHOSEN, "modified", "standard"), ("Universal Robots UR10e", "standard", "modified")],
)
def test_a_table_in_the_other_convention_is_named_and_its_remedy_works(arm, right, wrong):
    rows = next(each.model.rows for each in catalogue().arms if each.name == arm)
    measured = campaign(measured=arm, chosen=arm).model_dump(mode="json")

    def identify(convention):
        model = {
            "format": "dh",
            "convention": convention,
            "rows": [row.model_dump(mode="json") for row in rows],
        }
        return js.identify(measured | {"robot": measured["robot"] | {"model": model}}).result

    reason, *_ = identify(wrong).assessment.reasons
    assert reason.code == "another_robot_fits"
    assert reason.remedy.startswith(f"set `convention` of the Denavit-Hartenberg table to `{right}`")
    assert reason.action is None
    assert identify(right).assessment.verdict != "do_not_use"


def test_of_an_unknown_arm_no_joint_map_is_proposed_that_explains_little():
    measured = simulate_campaign(default_arm(), configurations=8, load="pull", seed=1)
    wrong = measured | {"robot": js.robot(CHOSEN).model_dump(mode="json")}
    first, *others = js.identify(wrong, elasticity="joints").result.assessment.reasons
    assert first.message.startswith("another robot may have been measured, zeros of joints may be off, ")
    assert first.remedy.startswith("check which robot was measured; ")
    assert "apply_joint_map" not in [each.action and each.action.kind for each in (first, *others)]
    assert js.identify(measured, elasticity="joints").result.assessment.verdict != "do_not_use"


def test_of_a_tie_the_terminal_offers_to_apply_the_first():
    result = js.identify(campaign("FANUC R-2000iC/165F")).result
    first, second = remedies(result.assessment, applies=True)
    assert first.endswith(
        "'FANUC R-2000iC/165F' was measured, choose this robot, or repeat the command with `--apply "
        "choose_robot`"
    )
    assert second.endswith("'FANUC R-2000iC/210F' was measured, choose this robot")


def test_only_its_own_action_names_a_robot():
    other = AdvisedAction.of("use_huber").model_dump()
    assert (other["robot"], other["robot_id"]) == (None, None)
    chosen = AdvisedAction.of("choose_robot", robot="R", robot_id="0" * 32)
    assert {name for name, value in chosen.model_dump().items() if value != other[name]} == {
        "kind",
        "robot",
        "robot_id",
    }
    assert AdvisedAction.model_validate_json(chosen.model_dump_json()) == chosen


def test_nothing_of_the_catalogue_is_built_before_it_is_needed(monkeypatch):
    monkeypatch.setattr("jointstiff.service.resources.known_robots.build_nominal_robots", pytest.fail)
    catalogue_robots()
    js.identify(campaign(chosen=MEASURED))


def in_service(client, robot_id, name):
    """Store the readings with a robot, identify, and return the run."""
    document = campaign().measurement_set.model_dump(mode="json", exclude_defaults=True)
    stored = post(client, "/v1/measurement-sets", {**document, "name": name, "robot_id": robot_id})
    run = post(client, "/v1/runs?wait=30", {"measurement_set_id": stored["id"]})
    return stored, run


def test_a_service_offers_stored_robots_before_the_catalogue(client):
    """One tap stores the readings with the robot that fits, and identifies them; twice gives the same run."""

    def stored_robot(name, arm):
        return post(client, "/v1/robots", {"name": name, "model": {"format": "catalogue", "arm": arm}})

    def robot_of(run):
        measured = client.get(f"/v1/measurement-sets/{run['request']['measurement_set_id']}").json()
        return measured["name"], client.get(f"/v1/robots/{measured['robot_id']}").json()

    wrong = stored_robot("wrong", CHOSEN)
    stored, run = in_service(client, wrong["id"], "Monday")
    assert "another_robot_fits" in [warning["code"] for warning in stored["warnings"]]
    (reason,) = run["result"]["assessment"]["reasons"]
    assert reason["action"]["robot"] == MEASURED
    assert reason["action"]["robot_id"] is None
    mended = post(client, f"/v1/runs/{run['id']}/apply?wait=30", reason["action"])
    name, robot = robot_of(mended)
    assert (name, robot["name"], robot["nominal_arm"]) == (f"Monday ({MEASURED})", MEASURED, MEASURED)
    assert mended["request"]["variant_of"] == run["id"]
    assert post(client, f"/v1/runs/{run['id']}/apply?wait=30", reason["action"])["id"] == mended["id"]

    client.patch(f"/v1/robots/{robot['id']}", json={"name": "cell 3"})
    _, run = in_service(client, wrong["id"], "Tuesday")
    (reason,) = run["result"]["assessment"]["reasons"]
    assert (reason["action"]["robot"], reason["action"]["robot_id"]) == ("cell 3", robot["id"])
    mended = post(client, f"/v1/runs/{run['id']}/apply?wait=30", reason["action"])
    assert robot_of(mended)[0] == "Tuesday (cell 3)"
    assert robot_of(mended)[1]["id"] == robot["id"]
