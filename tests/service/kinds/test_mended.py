"""What a campaign with one mistake is told, what its action changes, and which numbers it leads to."""

from copy import deepcopy

import numpy as np
import pytest
from support import mistakes
from support.api import post, posted
from support.mistakes import clean_campaign, planted, positions

import jointstiff as js
from jointstiff.schemas.finding import AdvisedAction, Assessment, Finding
from jointstiff.service.runs.mending import find_advised_action
from jointstiff.service.tables.report import remedies
from jointstiff.solver.errors import RequestError

INCLUDED = {"complementary_stiffness": "included"}
NAME = "pull, 19 configurations, motor encoders"
DO_NOT_USE, WITH_CARE = "do_not_use", "use_with_care"


@pytest.fixture(scope="module")
def clean():
    return js.identify(clean_campaign(), **INCLUDED)


MENDED = {
    "millimetres_as_metres": ({"length_unit_suspect": "convert_units"}, "in mm"),
    "whole_set_in_millimetres": ({"length_unit_suspect": "convert_units"}, "in mm"),
    "degrees_as_radians": ({"angle_unit_suspect": "convert_units"}, "in deg"),
    "kilonewtons_as_newtons": ({"force_unit_suspect": "convert_units"}, "in kN"),
    "readings_exchanged": (
        {"force_sign_suspect": "exchange_readings", "no_joint_identified": "exchange_readings"},
        "exchange readings",
    ),
    "columns_exchanged": ({"joints_swapped": "exchange_columns"}, "exchange columns"),
    "zero_elsewhere": ({"joints_counted_otherwise": "apply_joint_map"}, ""),
    "half_a_turn_elsewhere": (
        {"joints_counted_otherwise": "apply_joint_map", "no_joint_identified": None},
        "",
    ),
    "load_and_target_exchanged": (
        {
            "alternative_explains_better": "fit_causes",
            "residuals_exceed_sigma": None,
            "load_at_target": "exchange_load_and_target",
        },
        "exchange load and target",
    ),
}
MENDED["load_and_target_exchanged_by_observation"] = MENDED["load_and_target_exchanged"]


@pytest.mark.parametrize("name", MENDED)
def test_a_mistake_is_not_to_be_used_and_mended_has_the_numbers_of_a_run_without_it(name, clean):
    codes, ending = MENDED[name]
    mistake = getattr(mistakes, name)
    before = js.identify(planted(clean_campaign(), mistake), **INCLUDED)
    assessment = before.result.assessment
    assert assessment.verdict == DO_NOT_USE
    assert {each.code: each.action and each.action.kind for each in assessment.reasons} == codes
    after = before.apply(mistakes.MISTAKES[mistake])
    assert (after.result.assessment.verdict, after.result.assessment.reasons) == ("use", [])
    for joint, wanted in zip(after.result.joints, clean.result.joints, strict=True):
        assert joint.compliance == pytest.approx(wanted.compliance, rel=1e-9)
        assert joint.standard_uncertainty == pytest.approx(wanted.standard_uncertainty, rel=1e-9)
    robot, measured = after.campaign.robot.name, after.campaign.measurement_set.name
    assert measured == (f"{NAME} ({ending})" if ending else NAME)
    assert robot == ("simulated 6R" if ending else "simulated 6R (joint map corrected)")


FITTED = {
    "load_point_elsewhere": (
        "load_point",
        "every load point moved by (-28.8, 19.7, -38.9) mm",
        "every load point moved by (-28.8, 19.6, -37.5) mm ± (5.62, 3.99, 20.7) mm in the flange frame",
        "(F test, p = 2e-26); compliances change by up to 4.5 %",
        "",  # the assumed 10 mm let the load point move to where it acts
    ),
    "load_point_far_elsewhere": (
        "load_point",
        "every load point moved by (-78.8, 59.7, -98.8) mm",
        "every load point moved by (-78.8, 59.6, -97.5) mm ± (5.62, 3.99, 20.7) mm in the flange frame",
        "(F test, p = 8e-42); compliances change by up to 52 %",
        "2.75",
    ),
    "load_point_at_the_flange": (
        "load_point",
        "every load point moved by (-58.8, 19.7, 181) mm",
        "every load point moved by (-58.8, 19.6, 183) mm ± (5.61, 3.99, 20.7) mm in the flange frame",
        "(F test, p = 9e-25); compliances change by up to 20 %",
        "2.73",
    ),
    "load_point_stated_too_well": (
        "load_point",
        "every load point moved by (8.25, 9.67, -8.85) mm",
        "every load point moved by (8.25, 9.57, -7.46) mm ± (5.61, 3.99, 20.7) mm in the flange frame",
        "(F test, p = 5e-07); compliances change by up to 7.9 %",
        "",  # the load point moves far enough within its 1 mm to leave hardly more than noise
    ),
    "weight_forgotten": (
        "hook_weight",
        "a weight of (299) N",
        "a weight of (299) N ± (4.61) N that hangs with every load",
        "(F test, p = 4e-152); compliances change by up to 41 %",
        "11.9",
    ),
}


@pytest.mark.parametrize("name", FITTED)
def test_a_cause_is_named_with_its_size_and_fitted_it_stays_refuted(name):
    cause, moved, fitted, change, ratio = FITTED[name]
    before = js.identify(planted(clean_campaign(), getattr(mistakes, name)))
    absorbed = name == "load_point_elsewhere"  # compliances change by less than their uncertainties
    assert before.result.assessment.verdict == (WITH_CARE if absorbed else DO_NOT_USE)
    better, *exceeded = before.result.assessment.reasons
    assert better.code == "alternative_explains_better"
    assert [each.code for each in exceeded] == ["residuals_exceed_sigma"] * bool(ratio)
    assert better.message.startswith(f"with {moved}")
    assert "the joints explain the readings significantly better" in better.message
    assert change in better.message
    assert better.remedy == (
        "measure the load point on the flange"
        if cause == "load_point"
        else "weigh hook and slings, and add them to the loads"
    )
    for each in exceeded:
        assert each.message.startswith(f"the residuals are {ratio} times as large as the stated noise allows")
    after = before.apply("fit_causes")
    assert after.result.assessment.verdict == WITH_CARE
    (reason,) = after.result.assessment.reasons
    assert reason.message == (
        f"{fitted} (95 %) was fitted with the joints; the intervals include the uncertainty of this cause, "
        "and the readings contradict the stated value"
    )
    assert [part.source for part in after.result.budget.components] == [
        "readings",
        "assumed_force_scale",
        *(["assumed_load_point"] if cause == "hook_weight" else []),
        "fitted_causes",
        "model_error",
    ]
    errors = [
        abs(joint.compliance - truth) / joint.standard_uncertainty
        for joint, truth in zip(after.result.joints, js.simulator.default_arm().compliances, strict=True)
    ]
    assert max(errors) == pytest.approx(1.49 if cause == "hook_weight" else 1.12, abs=0.01)


def test_a_load_point_stated_too_well_without_a_ground_is_doubted_and_the_fit_contains_the_truth():
    """The readings that refute the tracker's point agree with a point that is known in an unknown way."""
    document = planted(clean_campaign(), mistakes.load_point_stated_too_well)
    del document["measurement_set"]["noise"]["grounds"]
    result = js.identify(document).result
    assert (result.assessment.verdict, result.assessment.reasons) == ("use", [])
    (doubt,) = [note for note in result.assessment.notes if "raise a doubt" in note]
    assert doubt.startswith("The readings raise a doubt that the load point is known to ±1 mm (p = ")
    assert doubt.endswith("Measure the load point on the hook with the tracker, and state so.")
    for joint, truth in zip(result.joints, js.simulator.default_arm().compliances, strict=True):
        low, high = joint.compliance_interval
        assert low <= truth <= high


def moved_since(first):
    """Loaded readings that are elsewhere from an observation on: the tracker moved."""

    def mistake(measured):
        for i, observation in enumerate(measured["observations"]):
            observation["label"] = f"{{{i}}}"
        later = {"observations": measured["observations"][first:]}
        positions(later, lambda old, new: (old, np.add(new, (6e-5, 0.0, 8e-5)).tolist()))

    return mistake


def test_since_when_a_tracker_stood_elsewhere_is_said_by_any_label():
    before = js.identify(planted(clean_campaign(), moved_since(9)), elasticity="joints")
    assert before.result.assessment.reasons[0].message == (
        "with a shift of all readings under load by (57.6, -1.81, 78) µm since observation '{9}', the "
        "joints explain the readings significantly better (F test, p = 6e-30); compliances change by up to "
        "4.3 %"
    )
    after = before.apply("fit_causes")
    (cause,) = after.request.causes
    assert (cause.name, cause.first) == ("shift", "{9}")
    assert after.result.assessment.reasons[0].message.startswith(
        "a shift of all readings under load by (58.8, -1.68, 76.9) µm ± (12.3, 13.2, 12.5) µm "
        "since observation '{9}' (95 %) was fitted with the joints"
    )


def test_a_movement_of_all_loaded_readings_is_fitted_to_a_hundredth_of_a_millimetre():
    document = deepcopy(clean_campaign())
    positions(document["measurement_set"], lambda old, new: (old, np.add(new, (3e-5, 0.0, 4e-5)).tolist()))
    before = js.identify(document, elasticity="joints")
    assert before.result.assessment.verdict == WITH_CARE
    after = before.apply("fit_causes")
    assert after.result.assessment.verdict == WITH_CARE
    assert after.result.assessment.reasons[0].message.startswith(
        "a shift of all readings under load by (25.9, 1.55, 39.1) µm ± (9.04, 9.22, 9.31) µm (95 %)"
    )


def test_a_plan_on_a_refuted_load_point_is_refused_and_fitted_it_is_planned_with_the_cause():
    before = js.identify(planted(clean_campaign(), mistakes.load_point_stated_too_well))
    few = {"readings": 6, "candidates": 300}
    with pytest.raises(js.CampaignError) as refused:
        js.plan(before.campaign, **few)
    problem = refused.value.problem
    assert (problem.type, problem.where) == ("urn:jointstiff:problem:not-to-be-used", "measurement_set")
    assert problem.detail == "the verdict on the campaign so far is: do not use"
    assert problem.errors[0].where == "all readings"
    assert problem.errors[0].remedy == "measure the load point on the flange"
    plan, exact = (js.plan(run, **few) for run in (before.apply("fit_causes"), js.identify(clean_campaign())))
    assert [cause.name for cause in plan.request.causes] == ["load_point"]
    assert [reason.code for reason in plan.result.assessment.reasons] == ["cause_fitted"]
    for joint, other in zip(plan.result.joints, exact.result.joints, strict=True):
        assert joint.before >= 0.9 * other.before


CAUSES_GIVEN = (
    "give one of: constant_force, curved_springs, growth, growth_over_time, hook_weight, load_point, "
    "load_zero, play, rope_zero, shift, tool, turn"
)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"causes": [{"name": "ghost"}]},
            (
                "run.causes",
                "`causes` names the error 'ghost', but the readings cannot show this error",
                CAUSES_GIVEN,
            ),
        ),
        (
            {"causes": [{"name": "shift", "first": "none"}]},
            (
                "run.causes",
                "`causes` names the error 'shift' since observation 'none', but the readings "
                "cannot show this error",
                CAUSES_GIVEN,
            ),
        ),
    ],
)
def test_a_cause_that_the_readings_cannot_show_is_refused(options, said):
    with pytest.raises(js.CampaignError) as refused:
        js.identify(clean_campaign(), **options)
    problem = refused.value.problem
    assert (problem.where, problem.detail, problem.remedy) == said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"leave_out": ["c02"]},
            (
                "plan.leave_out",
                "a plan that begins a campaign has no observations to leave out",
                "omit `leave_out`, or continue a measured campaign",
            ),
        ),
        (
            {"causes": [{"name": "play"}]},
            (
                "plan.causes",
                "`causes` can be fitted only to a campaign under loads, but this plan continues no such "
                "campaign",
                "omit `causes`, or continue a campaign that was measured under loads",
            ),
        ),
    ],
)
def test_a_plan_that_begins_has_no_readings_to_leave_out_or_to_fit_causes_to(options, said):
    with pytest.raises(js.CampaignError) as refused:
        js.plan("KUKA KR 210 R2700", load={"kind": "any_direction", "force": 1e3}, **options)
    problem = refused.value.problem
    assert (problem.where, problem.detail, problem.remedy) == said


@pytest.mark.parametrize(
    "name", ["degrees_as_radians", "columns_exchanged", "zero_elsewhere"], ids=["units", "readings", "robot"]
)
def test_the_service_stores_the_mended_set_once_and_keeps_what_was_sent(name, local):
    mistake = getattr(mistakes, name)
    wrong = posted(local, planted(clean_campaign(), mistake), **INCLUDED)
    address = f"/v1/measurement-sets/{wrong['request']['measurement_set_id']}"
    old = local.get(address)
    action = next(each["action"] for each in wrong["result"]["assessment"]["reasons"] if each["action"])
    assert action["kind"] == mistakes.MISTAKES[mistake]
    after, again = (post(local, f"/v1/runs/{wrong['id']}/apply", action) for _ in range(2))
    assert again["id"] == after["id"]
    assert after["request"]["variant_of"] == wrong["id"]
    assert after["result"]["assessment"]["verdict"] == "use"
    new = local.get(f"/v1/measurement-sets/{after['request']['measurement_set_id']}").json()
    assert new["id"] != old.json()["id"]
    assert (new["robot_id"] != old.json()["robot_id"]) == (name == "zero_elsewhere")
    assert local.get(address).content == old.content


def weight_forgotten_and_target_bumped(measured):
    """Forget a weight in each posture, and bump all targets of one posture under the load."""
    mistakes.weight_forgotten(measured)
    for reading in measured["observations"][6]["readings"]:
        reading["loaded"] = [place + 5e-4 for place in reading["loaded"]]


def test_two_mistakes_are_mended_by_one_action(local):
    """In process the posture leaves the set; a stored set stays, and the run leaves the posture out."""
    document = planted(clean_campaign(), weight_forgotten_and_target_bumped)
    before = js.identify(document)
    reason = before.result.assessment.reasons[0]
    assert reason.message.startswith("without 'c07', and with a weight of (")
    assert reason.action.observations == ["c07"]
    after = before.apply("fit_causes")
    assert len(after.campaign.measurement_set.observations) == 18
    assert [each.name for each in after.request.causes] == ["hook_weight"]
    assert [each.code for each in after.result.assessment.reasons] == ["cause_fitted"]
    wrong = posted(local, document)
    mended = post(local, f"/v1/runs/{wrong['id']}/apply", reason.action.model_dump(mode="json"))
    assert mended["request"]["leave_out"] == ["c07"]
    assert [each["name"] for each in mended["request"]["causes"]] == ["hook_weight"]
    assert mended["request"]["measurement_set_id"] == wrong["request"]["measurement_set_id"]
    for one, other in zip(after.result.joints, mended["result"]["joints"], strict=True):
        assert one.compliance == pytest.approx(other["compliance"], rel=1e-6)


def test_an_action_that_shows_a_posture_is_refused_as_what_it_is():
    reason = Finding(
        code="deflection_unexplained",
        weight=WITH_CARE,
        message="m",
        remedy="measure again",
        action=AdvisedAction.of("show_posture", ["c05"]),
    )
    assessment = Assessment(verdict=WITH_CARE, reasons=[reason])
    with pytest.raises(RequestError, match="names readings to look at, and changes no campaign; no reason"):
        find_advised_action(assessment, "show_posture")
    assert remedies(assessment, applies=True) == ["measure again"], "no option is offered"
