"""Planted mistakes, undone by the action that their reason advises: the run is for use, and right."""

import math
from copy import deepcopy

import numpy as np
import pytest
from support.api import post, stored_set

import jointstiff
from jointstiff.simulator import TARGETS, default_arm, simulate_campaign

TRUTH = default_arm().compliances


@pytest.fixture(scope="module")
def clean():
    """Pulls of 1500 N in 19 postures, with the places of the targets."""
    document = simulate_campaign(default_arm(), load="pull", configurations=19, seed=8)
    places = {name: list(place) for name, place in TARGETS.items()}
    return document | {"measurement_set": document["measurement_set"] | {"flange_targets": places}}


def positions(measured, change):
    for observation in measured["observations"]:
        for reading in observation["readings"]:
            reading["unloaded"], reading["loaded"] = change(reading["unloaded"], reading["loaded"])


def millimetres_as_metres(measured):
    """All that a tracker's software writes; what people state is in metres, as the set says."""
    positions(measured, lambda *both: [[1e3 * part for part in place] for place in both])


def whole_set_in_millimetres(measured):
    """Load point, places and sigma, too."""
    millimetres_as_metres(measured)
    measured["load_point"] = [1e3 * part for part in measured["load_point"]]
    measured["noise"]["sigma"] *= 1e3
    measured["flange_targets"] = {
        name: [1e3 * part for part in place] for name, place in measured["flange_targets"].items()
    }


def degrees_as_radians(measured):
    for observation in measured["observations"]:
        observation["joints"] = [math.degrees(angle) for angle in observation["joints"]]


def kilonewtons_as_newtons(measured):
    for observation in measured["observations"]:
        observation["force"] = [1e-3 * part for part in observation["force"]]


def readings_exchanged(measured):
    positions(measured, lambda unloaded, loaded: (loaded, unloaded))


def columns_exchanged(measured):
    for observation in measured["observations"]:
        joints = observation["joints"]
        joints[1], joints[2] = joints[2], joints[1]


def zero_elsewhere(measured):
    for observation in measured["observations"]:
        observation["joints"][2] += math.pi / 2


def load_and_target_exchanged(measured):
    places, load = measured["flange_targets"], measured["load_point"]
    measured["load_point"], places["P11"] = places["P11"], load


def load_and_target_exchanged_by_observation(measured):
    """Each observation states the same load point itself."""
    load_and_target_exchanged(measured)
    load = measured.pop("load_point")
    for observation in measured["observations"]:
        observation["load_point"] = load


def half_a_turn_elsewhere(measured):
    """A whole turn more brings the angles within the limits."""
    for observation in measured["observations"]:
        observation["joints"][2] += math.pi


def load_point_elsewhere(measured):
    measured["load_point"] = np.add(measured["load_point"], (0.03, -0.02, 0.04)).tolist()


def load_point_far_elsewhere(measured):
    """By 141 mm: another joint map would explain something of it, too."""
    measured["load_point"] = np.add(measured["load_point"], (0.08, -0.06, 0.1)).tolist()


def load_point_at_the_flange(measured):
    """By 191 mm, to the axis of joint 6: as stated, no pull twists it."""
    measured["load_point"] = [0.0, 0.0, 0.0]


def load_point_stated_too_well(measured):
    """By 16 mm, which an assumed load point would hold, and one that is stated to 1 mm does not."""
    measured["load_point"] = np.add(measured["load_point"], (-0.007, -0.01, 0.01)).tolist()
    measured["noise"]["load_point"] = 0.001


def weight_forgotten(measured):
    """The robot also carried 300 N, which the forces leave out."""
    for observation in measured["observations"]:
        observation["force"][2] += 300.0


MISTAKES = {
    millimetres_as_metres: "convert_units",
    whole_set_in_millimetres: "convert_units",
    degrees_as_radians: "convert_units",
    kilonewtons_as_newtons: "convert_units",
    readings_exchanged: "exchange_readings",
    columns_exchanged: "exchange_columns",
    zero_elsewhere: "apply_joint_map",
    load_and_target_exchanged: "exchange_load_and_target",
    load_and_target_exchanged_by_observation: "exchange_load_and_target",
    half_a_turn_elsewhere: "apply_joint_map",
}


CAUSES = {
    load_point_elsewhere: "load_point",
    load_point_far_elsewhere: "load_point",
    load_point_at_the_flange: "load_point",
    load_point_stated_too_well: "load_point",
    weight_forgotten: "constant_force",
}


def planted(clean, mistake):
    document = deepcopy(clean)
    mistake(document["measurement_set"])
    return document


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.__name__)
def test_the_action_of_a_proved_mistake_leads_to_a_run_for_use(clean, mistake):
    action = MISTAKES[mistake]
    before = jointstiff.identify(planted(clean, mistake), complementary_stiffness="included")
    assert before.result.assessment.verdict != "use"
    after = before.apply(action)
    assert after.result.assessment.verdict == "use", after.result.assessment.reasons
    for joint, compliance in zip(after.result.joints, TRUTH, strict=True):
        assert abs(joint.compliance - compliance) < 5 * joint.budget.readings
    assert after.request.complementary_stiffness == "included"
    mended = after.campaign
    changed = mended.robot if action == "apply_joint_map" else mended.measurement_set
    assert changed.name.endswith(")")


@pytest.mark.parametrize("mistake", CAUSES, ids=lambda mistake: mistake.__name__)
def test_a_cause_is_fitted_beside_the_joints_and_the_numbers_stay(clean, mistake):
    """What was stated stays refuted: the run is for use with care, and its intervals hold the truth."""
    before = jointstiff.identify(planted(clean, mistake))
    if mistake in {load_point_far_elsewhere, load_point_at_the_flange}:  # judged no milder than nearer ones
        assert before.result.assessment.verdict == "do_not_use"
    after = before.apply("fit_causes")
    assert [cause.name for cause in after.request.causes] == [CAUSES[mistake]]
    assert after.campaign.measurement_set == before.campaign.measurement_set
    assert after.result.assessment.verdict == "use_with_care"
    (reason,) = after.result.assessment.reasons
    assert (reason.code, reason.action) == ("cause_fitted", None)
    for words in ("±", "mm" if CAUSES[mistake] == "load_point" else " N", "95 %"):
        assert words in reason.message
    for joint, compliance in zip(after.result.joints, TRUTH, strict=True):
        assert abs(joint.compliance - compliance) < 3 * joint.standard_uncertainty
    assert "fitted_causes" in {component.source for component in after.result.budget.components}
    assert before.result.causes[0].name == CAUSES[mistake]
    assert before.result.causes[0].p_value < 1e-6


def test_a_plan_goes_on_with_a_mended_campaign(clean):
    """What the run fitted beside the joints goes along: the plan knows that the campaign is mended."""
    before = jointstiff.identify(planted(clean, load_point_stated_too_well))
    with pytest.raises(jointstiff.CampaignError, match="do_not_use"):
        jointstiff.plan(before.campaign, readings=6, candidates=300)
    after = before.apply("fit_causes")
    plan = jointstiff.plan(after, readings=6, candidates=300)
    assert [cause.name for cause in plan.request.causes] == ["load_point"]
    assert [reason.code for reason in plan.result.assessment.reasons] == ["cause_fitted"]
    exact = jointstiff.plan(jointstiff.identify(clean), readings=6, candidates=300)
    for mended, known in zip(plan.result.joints, exact.result.joints, strict=True):
        assert mended.before >= 0.9 * known.before  # what was fitted leaves less for the joints


@pytest.mark.parametrize(("option", "value"), [("leave_out", ["c02"]), ("causes", [{"name": "play"}])])
def test_a_plan_without_readings_has_nothing_to_mend(option, value):
    load = {"kind": "any_direction", "force": 1e3}
    with pytest.raises(jointstiff.CampaignError) as caught:
        jointstiff.plan("KUKA KR 210 R2700", load=load, **{option: value})
    assert caught.value.problem.where.endswith(option)


@pytest.mark.parametrize("cause", [{"name": "ghost"}, {"name": "shift", "first": "none"}])
def test_a_cause_that_no_reading_shows_is_refused(clean, cause):
    with pytest.raises(jointstiff.CampaignError) as caught:
        jointstiff.identify(clean, causes=[cause])
    assert caught.value.problem.where == "run.causes"


def stated_for_the_set(measured):
    measured["noise"]["sigma"] = 6e-6


def stated_by_a_data_sheet(measured):
    error = {"constant": 6e-6, "per_distance": 0.0}
    measured["noise"] = {"instrument": {"station": [4.0, 0.0, 1.0], "range": error, "transverse": error}}


def stated_by_each_reading(measured):
    measured["noise"] = None
    covariance = (36e-12 * np.eye(3)).tolist()
    for number, observation in enumerate(measured["observations"]):
        for reading in observation["readings"]:
            if number % 2:
                reading["sigma"] = 6e-6
            else:
                reading["unloaded_covariance"] = reading["loaded_covariance"] = covariance


@pytest.mark.parametrize(
    "statement",
    [stated_for_the_set, stated_by_a_data_sheet, stated_by_each_reading],
    ids=lambda statement: statement.__name__,
)
def test_noise_that_the_residuals_refuted_stays_on_record(clean, statement):
    before = jointstiff.identify(planted(clean, statement))
    assert before.result.assessment.verdict == "do_not_use"
    after = before.apply("omit_noise")
    old, new = before.campaign.measurement_set, after.campaign.measurement_set
    assert new.noise.refuted
    assert new.observations == old.observations
    if old.noise is not None:
        assert new.noise.model_copy(update={"refuted": False}) == old.noise
    assert after.result.sigma == pytest.approx(2e-5, rel=0.2)
    assert after.result.assessment.verdict == "use_with_care"
    (reason,) = after.result.assessment.reasons
    ratio = after.result.sigma / 6e-6
    assert f"{ratio:.3g} times the 6 µm that were stated" in reason.message
    assert reason.action is None
    unstated = planted(clean, statement)
    unstated["measurement_set"]["noise"] = None
    for observation in unstated["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            for name in ("sigma", "unloaded_covariance", "loaded_covariance"):
                reading.pop(name, None)
    plain = jointstiff.identify(unstated)
    assert [(one.stiffness, one.stiffness_interval) for one in plain.result.joints] == [
        (one.stiffness, one.stiffness_interval) for one in after.result.joints
    ]


def test_a_movement_of_all_loaded_readings_is_no_force(clean):
    """The tracker stood 50 µm elsewhere for the loaded readings."""
    document = deepcopy(clean)
    positions(document["measurement_set"], lambda old, new: (old, np.add(new, (3e-5, 0.0, 4e-5)).tolist()))
    run = jointstiff.identify(document, elasticity="joints")
    (reason,) = (
        reason for reason in run.result.assessment.reasons if reason.code == "alternative_explains_better"
    )
    assert "what was read under load moved by" in reason.message
    assert "read a posture again without the load" in reason.remedy
    assert [cause.name for cause in run.apply("fit_causes").request.causes] == ["shift"]


def test_a_cause_is_named_once_and_goes_without_own_weight(clean):
    for options in ({"causes": [{"name": "shift"}] * 2}, {"causes": [{"name": "shift"}], "weight": {}}):
        with pytest.raises(jointstiff.CampaignError):
            jointstiff.identify(clean, **options)


def test_since_when_a_tracker_stood_elsewhere_is_said_by_any_label(clean):
    document = deepcopy(clean)
    for number, observation in enumerate(document["measurement_set"]["observations"]):
        observation["label"] = f"{{{number}}}"
        if number >= 9:
            for reading in observation["readings"]:
                reading["loaded"] = np.add(reading["loaded"], (6e-5, 0.0, 8e-5)).tolist()
    before = jointstiff.identify(document, elasticity="joints")
    after = before.apply("fit_causes")
    assert [(cause.name, cause.first) for cause in after.request.causes] == [("shift", "{9}")]
    for run in (before, after):
        assert "since observation '{9}'" in run.result.assessment.reasons[0].message


@pytest.mark.parametrize(
    "mistake", [degrees_as_radians, columns_exchanged, zero_elsewhere], ids=lambda mistake: mistake.__name__
)
def test_the_service_stores_and_identifies_the_mended_set(local, clean, mistake):
    """One that changes units, one that changes readings, one that changes the robot."""
    document = planted(clean, mistake)
    old = stored_set(local, document)
    stated = {"measurement_set_id": old["id"], "complementary_stiffness": "included"}
    run = post(local, "/v1/runs", stated)
    actions = [reason["action"] for reason in run["result"]["assessment"]["reasons"]]
    action = next(each for each in actions if each and each["kind"] == MISTAKES[mistake])
    after = post(local, f"/v1/runs/{run['id']}/apply", action)
    assert after["result"]["assessment"]["verdict"] == "use"
    assert after["request"]["variant_of"] == run["id"]
    new = local.get(f"/v1/measurement-sets/{after['request']['measurement_set_id']}").json()
    assert new["id"] != old["id"]
    assert local.get(f"/v1/measurement-sets/{old['id']}").json() == old
    assert (new["robot_id"] != old["robot_id"]) == (action["kind"] == "apply_joint_map")
    again = local.request("POST", f"/v1/runs/{run['id']}/apply", json=action)
    assert again.json()["id"] == after["id"]
