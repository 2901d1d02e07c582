"""Verdicts on too few readings, on a sigma that is overstated, and on two sides that do not compare."""

import numpy as np
import pytest
from support.api import post, posted
from support.changes import changed
from support.kinds import posted_job
from support.mistakes import columns_exchanged, planted

import jointstiff as js
from jointstiff.simulator import TARGETS, default_arm, simulate_campaign

INCLUDED = {"complementary_stiffness": "included"}
SET = "measurement_set"
ROWS = f"{SET}.observations"


@pytest.fixture(scope="module")
def deflected():
    """Pulls in 24 postures whose readings are deflections."""
    document = simulate_campaign(default_arm(), load="pull", configurations=24, seed=3)
    document[SET]["flange_targets"] = {name: list(map(float, place)) for name, place in TARGETS.items()}
    for observation in document[SET]["observations"]:
        for reading in observation["readings"]:
            reading["deflection"] = np.subtract(reading.pop("loaded"), reading.pop("unloaded")).tolist()
    return document


def reasons_of(result):
    return [(reason.code, reason.message) for reason in result.assessment.reasons]


def test_one_reading_identifies_no_joint(deflected):
    row = deflected[SET]["observations"][0]
    document = changed(deflected, ROWS, [row | {"readings": row["readings"][:1]}])
    result = js.identify(document, **INCLUDED).result
    assert result.assessment.verdict == "do_not_use"
    exact = "there are as many parameters as readings, so the fit reproduces any readings exactly"
    assert reasons_of(result) == [
        ("no_joint_identified", "the readings identify no joint: 6 not observable"),
        (
            "target_name_suspect",
            "`flange_targets` states the places of 'P11', 'P12', but no observation reads these; the targets "
            "that were read are P10",
        ),
        ("no_residual_freedom", f"{exact}: the uncertainty comes from the stated noise only"),
        (
            "few_postures",
            "the set has 1 distinct posture, so the stiffnesses were not tested in other postures",
        ),
    ]
    assert {joint.status for joint in result.joints} == {"not_observable"}
    assert {joint.stiffness for joint in result.joints} == {None}
    assert (result.compensation, result.contributions, result.goodness.degrees_of_freedom) == (None, [], 0.0)


def test_one_posture_without_noise_has_no_uncertainty(deflected):
    document = changed(changed(deflected, ROWS, deflected[SET]["observations"][:1]), f"{SET}.noise", None)
    result = js.identify(document, **INCLUDED).result
    assert result.assessment.verdict == "do_not_use"
    (freedom, unknown), (few, _) = reasons_of(result)
    assert (freedom, few) == ("no_residual_freedom", "few_postures")
    assert unknown.endswith("so the fit reproduces any readings exactly: the uncertainty is unknown")
    statuses = {joint.status for joint in result.joints}
    assert statuses == {"at_bound", "identified", "not_observable", "uncertain"}
    assert result.goodness.degrees_of_freedom == pytest.approx(3.0)


def test_a_sigma_that_is_overstated_is_said_and_does_no_harm(deflected):
    result = js.identify(changed(deflected, f"{SET}.noise.sigma", 3e-5), **INCLUDED).result
    assert (result.assessment.verdict, result.assessment.reasons) == ("use", [])
    (warning,) = result.warnings
    assert (warning.code, warning.weight) == ("sigma_overstated", "use")
    assert warning.message == (
        "the residuals are only 0.633 times as large as sigma predicts (chi-square test, p < 0.001), "
        "so the uncertainties are too large"
    )
    assert result.compensation == pytest.approx(0.983880, abs=1e-5)
    assert len(result.contributions) == 6
    assert result.goodness.degrees_of_freedom == 210.0


def test_methods_that_need_a_pose_say_that_targets_are_missing(deflected):
    rows = [each | {"readings": each["readings"][:1]} for each in deflected[SET]["observations"]]
    methods = [{"method": "complete_pose"}, {"method": "decoupled_partial_pose"}]
    made = js.compare(changed(deflected, ROWS, rows), methods=methods)
    assert made.result.assessment.verdict == "do_not_use"
    assert reasons_of(made.result) == [
        ("no_joint_identified", "all compared methods failed, so no joint stiffness is known")
    ]
    assert [entry.assessment for entry in made.result.entries] == [None] * 4
    assert made.result.summary.joints_identified == 0
    head, *rest = str(made).splitlines()
    assert head == "Do not use this comparison: 1 reason of its run"
    assert (
        "no complete pose, decoupled partial pose: the pose of the flange needs 3 targets, but "
        "observations[0] 'c01' has 1 (24 of 24 observations have too few)"
    ) in " ".join(" ".join(rest).split())


def test_a_side_with_exchanged_columns_makes_a_comparison_not_for_use(deflected):
    wrong = planted(deflected, columns_exchanged)
    pair = js.compare(deflected, wrong, methods=[], run=INCLUDED)
    result = pair.result
    assert result.assessment.verdict == "do_not_use"
    assert str(pair).splitlines()[0] == (
        "Do not use this comparison: 1 reason of its own, 2 reasons of its run"
    )
    assert [(reason.code, reason.where) for reason in result.assessment.reasons] == [
        ("joints_swapped", "second"),
        ("no_common_configuration", None),
        ("joint_outside_limits", "second.observations[3] 'c04'"),
    ]
    said = [message for _, message in reasons_of(result)]
    assert said[0] == (
        "joint compliances leave 21.4 % of the deflections unexplained, and with the angles of joint_2 and "
        "joint_3 exchanged 1.67 %"
    )
    assert said[2] == (
        "the model angle of joint_2 is -1.045 rad, outside its limits [-0.6981, 1.222] rad "
        "(and 4 more of this kind: 'c13', 'c14', 'c15', 'c18')"
    )
    assert [(warning.code, warning.weight) for warning in result.warnings] == [
        *[("joint_outside_limits", "use_with_care")] * 5,
        ("joints_swapped", "do_not_use"),
        ("configurations_differ", "use"),
    ]
    assert [{joint.verdict for joint in entry.joints} for entry in result.entries] == [
        {"use"},
        {"do_not_use"},
    ]
    found = [*(entry.compensation for entry in result.entries), result.summary.compensation]
    assert found == pytest.approx([0.983882, 0.761406, 0.761406], abs=1e-5)


def test_newtons_that_are_read_as_kilograms_are_seen_beside_the_other_side(deflected):
    in_kgf = changed(deflected, f"{SET}.units.force", "kgf")
    result = js.compare(deflected, in_kgf, methods=[]).result
    assert result.assessment.verdict == "do_not_use"
    beside_the_other, against_the_payload = reasons_of(result)
    assert beside_the_other == (
        "force_unit_suspect",
        "in the same postures, the forces of the second campaign are 9.81 times those of the first, but the "
        "deflections 1 times: probably N were read as kgf in the second campaign, or kgf as N in the first",
    )
    assert against_the_payload[0] == "stiffness_against_payload"


@pytest.fixture(scope="module")
def bad(local):
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    columns_exchanged(document[SET])
    return posted(local, document)


@pytest.mark.parametrize(
    ("kind", "detail"),
    [
        ("plan", "the verdict on the campaign so far is: do not use"),
        ("map", "the verdict on run '{run}' is: do not use"),
        ("correction", "the verdict on run '{run}' is: do not use"),
    ],
)
def test_what_acts_on_a_robot_is_refused_with_the_reasons_of_the_run(kind, detail, local, bad):
    problem = posted_job(local, kind, bad).json()
    assert problem["title"] == "The result must not be used"
    assert problem["detail"] == detail.replace("{run}", bad["id"])
    assert problem["remedy"] == (
        "follow the remedies of the reasons and identify again; to continue anyway, give `accept_verdict: "
        "do_not_use`"
    )
    (error,) = problem["errors"]
    assert error["where"] == "all readings"
    assert "with the angles of joint_2 and joint_3 exchanged, in 12 of 12" in error["reason"]
    assert error["remedy"].startswith("exchange the columns of joint_2 and joint_3 in every observation")


def test_a_prediction_a_trend_and_a_plan_have_the_verdict_of_the_run(local, bad):
    case = {"joints": [0.1] * 6, "force": [0, 0, -500], "load_point": [0, 0, 0.2]}
    units = {"length": "m", "angle": "rad", "force": "N"}
    asked = {"run_id": bad["id"], "units": units, "cases": [case]}
    assert post(local, "/v1/deflections", asked, 200)["assessment"]["verdict"] == "do_not_use"
    used = posted(local, simulate_campaign(default_arm(), load="pull", configurations=12, seed=1))
    of_set = local.get(f"/v1/measurement-sets/{used['request']['measurement_set_id']}").json()
    shown = local.get(f"/v1/robots/{of_set['robot_id']}/trend").json()["campaigns"]
    assert [each["assessment"] for each in shown if each["run_id"] == used["id"]] == [
        used["result"]["assessment"]
    ]
    few = posted(local, simulate_campaign(default_arm(), load="pull", configurations=2, seed=1))
    plan = posted_job(local, "plan", few)
    assert plan.status_code == 201
    assert plan.json()["result"]["assessment"]["headline"] == "Use this plan with care: 3 reasons of its run"
