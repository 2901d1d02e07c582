"""Verdicts: of every kind of job, along with what is made of a run, and mended by the advised action."""

import copy
import csv
import io
import re
from copy import deepcopy

import numpy as np
import pytest
from rich.console import Console
from support.api import file_at, posted
from support.guide_files import ROOT
from support.kinds import MAP, posted_job
from support.mistakes import (
    CAUSES,
    MISTAKES,
    clean_campaign,
    columns_exchanged,
    load_point_at_the_flange,
    load_point_far_elsewhere,
    planted,
    positions,
)

import jointstiff
import jointstiff as js
from jointstiff.schemas.joints import GOAL
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.reports.exports import FORMATS
from jointstiff.service.reports.job import lay_out_job
from jointstiff.service.runs.verdicts import find_far_points
from jointstiff.service.tables.report import verdict_line
from jointstiff.simulator import default_arm, simulate_campaign

TRUTH = default_arm().compliances


@pytest.fixture(scope="module")
def clean():
    return clean_campaign()


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.__name__)
def test_the_action_of_a_proved_mistake_leads_to_a_run_for_use(clean, mistake):
    action = MISTAKES[mistake]
    before = jointstiff.identify(planted(clean, mistake), complementary_stiffness="included")
    assert before.result.assessment.verdict != "use"
    after = before.apply(action)
    assert after.result.assessment.verdict == "use", after.result.assessment.reasons
    for joint, compliance in zip(after.result.joints, TRUTH, strict=True):
        by_readings = after.result.budget.contributions_to(joint.name)["readings"]
        assert abs(joint.compliance - compliance) < 5 * by_readings
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
    assert reason.message.startswith("the stated standard uncertainty is 6 µm per coordinate of a reading")
    assert f", {ratio:.3g} times as much" in reason.message
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
    assert "of all readings under load by" in reason.message
    assert "read a posture again without the load" in reason.remedy
    assert [cause.name for cause in run.apply("fit_causes").request.causes] == ["shift"]


ACCEPTED = {"accept_verdict": "do_not_use"}
REFUSED = ("plan", "map", "correction")
"""Kinds that act on a robot, or guide a measurement."""


@pytest.fixture(scope="module")
def runs(local):
    """Return runs of two sets of pulls whose columns of joints 2 and 3 are exchanged."""
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    columns_exchanged(document["measurement_set"])
    again = copy.deepcopy(document)
    again["measurement_set"]["observations"][0]["readings"][0]["loaded"][0] += 1e-6
    return posted(local, document), posted(local, again)


@pytest.fixture(scope="module")
def post_job(local, runs):
    """Post a job of a kind that is made from the runs."""
    return lambda kind, **more: posted_job(local, kind, runs[0], runs[1]["id"], **more)


@pytest.mark.parametrize("kind", REFUSED)
def test_nothing_acts_on_a_robot_unasked(local, post_job, kind):
    listing = {"kind": kind}
    before = local.get("/v1/jobs", params=listing).json()["items"]
    answer = post_job(kind)
    assert answer.status_code == 422
    problem = answer.json()
    assert problem["type"] == "urn:jointstiff:problem:not-to-be-used"
    assert problem["where"] == ("measurement_set_id" if kind == "plan" else "run_id")
    assert "accept_verdict" in problem["remedy"]
    assert any("joint_2" in each["reason"] and each["remedy"] for each in problem["errors"])
    assert local.get("/v1/jobs", params=listing).json()["items"] == before
    assert post_job(kind, accept_verdict="use_with_care").status_code == 422


FIRST = {
    "run": "Do not use: 1 reason",
    "comparison": "Do not use this comparison: 2 reasons of its run",
    "plan": "Do not use this plan: 1 reason of its own, 1 reason of its run",
    "map": "Do not use this map: 1 reason of its run",
    "correction": "Do not use this program: 1 reason of its run",
}
TABLES = {
    "run": ["joints.csv", "residuals.csv", "model.csv?accept_verdict=do_not_use"],
    "comparison": ["table.csv", "ratios.csv", "configurations.csv"],
    "plan": ["readings.csv"],
    "map": ["map.csv"],
    "correction": ["rows.csv"],
}


@pytest.mark.parametrize("kind", FIRST)
def test_every_kind_says_first_that_its_run_is_not_to_be_used(kind, local, post_job):
    job = post_job(kind, **(ACCEPTED if kind in REFUSED else {})).json()
    (found,) = [each for each in KINDS if each.name == kind]
    shown = io.StringIO()
    Console(file=shown, width=120).print(lay_out_job(found, found.message.model_validate(job)))
    first, *rest = shown.getvalue().splitlines()
    assert first.strip() == FIRST[kind]
    accepted = [
        line
        for line in rest
        if "computed despite this verdict, because the request accepts the verdict" in line
    ]
    assert len(accepted) == (kind in REFUSED)
    assert "do not use" in local.get(file_at(job, "report.html")).text.lower()
    for name in TABLES[kind]:
        rows = csv.DictReader(local.get(file_at(job, name)).text.splitlines())
        assert {row["overall verdict"] for row in rows} == {"do_not_use"}, name


@pytest.mark.parametrize("name", FORMATS)
def test_nor_does_an_export(local, runs, name):
    address = file_at(runs[0], f"model.{name}")
    assert local.get(address).json()["type"] == "urn:jointstiff:problem:not-to-be-used"
    accepted = local.get(address, params=ACCEPTED)
    assert accepted.status_code == 200
    if name not in {"csv", "xlsx"}:
        assert "Verdict on the result: do not use." in accepted.text


def test_the_program_says_it_even_unmarked(local, post_job):
    program = post_job("correction", **ACCEPTED, mark=False).json()
    text = local.get(file_at(program, "program")).text
    (mark,) = [line for line in text.splitlines() if "Jointstiff run" in line]
    assert mark.endswith("verdict: do not use")


def test_with_care_is_not_refused():
    document = simulate_campaign(default_arm(), load="dead_weight", configurations=12, seed=1)
    run = jointstiff.identify(document, complementary_stiffness="neglected")
    assert run.result.assessment.verdict == "use_with_care"
    downward = MAP | {"force": [0.0, 0.0, -500.0]}  # which joint 1, without a number, does not feel
    assert jointstiff.map(run, units="m, deg, N", **downward).result.assessment.verdict == "use_with_care"


BY_WEIGHTS = simulate_campaign(default_arm(), configurations=19, seed=1)
POCKET = ROOT / "examples" / "pocket.src"
POSTURE = [[0, -20, 30, 0, 45, 0]]
POINT = (0, 0, 120)
AREA = {"area": [[1400, -200, 600], [1800, 200, 600]], "grid": (3, 3, 1), "place": (0, 0, 250)}
FAR = AREA | {"area": [[14e3, -2e3, 6e3], [18e3, 2e3, 6e3]]}
MILLING = {"accuracy_option": "off"}


@pytest.fixture(scope="module")
def run():
    return js.identify(simulate_campaign(default_arm(), load="pull", configurations=19, seed=1))


@pytest.fixture(scope="module")
def by_weights():
    run = js.identify(BY_WEIGHTS)
    assert run.joints["joint_1"].stiffness is None
    return run


KILONEWTONS = (0, 0, -500_000)
ABSURD = {
    "prediction, kN for N": lambda run, _: run.predict(POSTURE, KILONEWTONS, at=POINT),
    "prediction, µm for mm in the load point": lambda run, _: run.predict(
        POSTURE, (0, 0, -500), load_point=(0, 0, 120e3), place=POINT
    ),
    "prediction, µm for mm in the place": lambda run, _: run.predict(
        POSTURE, (0, 0, -500), load_point=POINT, place=(0, 0, 120e3)
    ),
    "prediction, a few metres": lambda run, _: run.predict(POSTURE, (0, 0, -500), at=(0, 0, 4000)),
    "prediction, joint without a number": lambda _, less: less.predict(POSTURE, (0, 500, 0), at=POINT),
    "map, kN for N": lambda run, _: js.map(run, force=KILONEWTONS, **AREA),
    "map, µm for mm": lambda run, _: js.map(run, force=(0, 0, -500), **AREA | {"place": (0, 0, 250e3)}),
    "map, no place reached": lambda run, _: js.map(run, force=(0, 0, -500), **FAR),
    "map, joint without a number": lambda _, less: js.map(less, force=(0, 500, 0), **AREA),
    "program, kN for N": lambda run, _: js.correct(run, POCKET, force=KILONEWTONS, **MILLING),
    "program, all capped": lambda run, _: js.correct(
        run, POCKET, force=(0, 0, -500), max_displacement=0.1, **MILLING
    ),
    "program, all capped, accepted": lambda run, _: js.correct(
        run, POCKET, force=(0, 0, -500), max_displacement=0.1, **MILLING, **ACCEPTED
    ),
    "program, nothing to correct": lambda run, _: js.correct(run, POCKET, force=(0, 0, 0), **MILLING),
    "plan, joint without a load": lambda *_: js.plan(BY_WEIGHTS, readings=4, candidates=100),
    "run, joint without a number": lambda _, less: less,
}


IMPLAUSIBLE, BEYOND, MISSING = "prediction_implausible", "beyond_campaign", "numbers_missing"
OWN = "of its own"
HEADS = {
    "prediction, kN for N": (f"Do not use this prediction: 2 reasons {OWN}", [IMPLAUSIBLE, BEYOND]),
    "prediction, a few metres": (
        f"Do not use this prediction: 3 reasons {OWN}",
        [IMPLAUSIBLE, "point_implausible", BEYOND],
    ),
    "prediction, joint without a number": (f"Do not use this prediction: 1 reason {OWN}", [MISSING]),
    "map, kN for N": (f"Do not use this map: 1 reason {OWN}", [MISSING]),
    "map, no place reached": (f"Do not use this map: 1 reason {OWN}", [MISSING]),
    "map, joint without a number": (f"Do not use this map: 1 reason {OWN}", [MISSING]),
    "program, all capped, accepted": (
        f"Do not use this program: 1 reason {OWN}",
        ["corrections_capped"],
    ),
    "program, nothing to correct": (
        f"Use this program with care: 1 reason {OWN}",
        ["nothing_corrected"],
    ),
    "plan, joint without a load": (f"Use this plan with care: 1 reason {OWN}", ["joint_left_out"]),
    "run, joint without a number": (
        "Use 5 of 6 joints: no number of the other joints passed the checks",
        [],
    ),
}


@pytest.mark.parametrize("name", HEADS)
def test_the_head_of_what_is_absurd_does_not_say_use(name, run, by_weights):
    made = ABSURD[name](run, by_weights)
    head, codes = HEADS[name]
    assert str(made).splitlines()[0] == head
    reasons = getattr(made, "result", made).assessment.reasons
    assert [reason.code for reason in reasons] == codes


PLAUSIBLE = "; up to 20 mm, and 20 times the campaign's, is plausible"


def test_the_reasons_of_what_is_absurd_name_its_size(run, by_weights):
    said = {
        name: [reason.message for reason in getattr(made, "result", made).assessment.reasons]
        for name in HEADS
        for made in [ABSURD[name](run, by_weights)]
    }
    assert said["prediction, kN for N"] == [
        f"the greatest deflection is 525.9 mm, 102 times the greatest of the campaign{PLAUSIBLE}",
        "1 of 1 cases have loads or postures beyond those of the campaign",
    ]
    assert said["prediction, a few metres"][:2] == [
        f"the greatest deflection is 26.51 mm, 5.14 times the greatest of the campaign{PLAUSIBLE}",
        "the load point or the place is 4 m from the flange; 2 mm to 1.5 m is plausible",
    ]
    assert said["prediction, joint without a number"] == [
        "none of the 1 cases has a number; the first without one is 1: the load or own weight twists "
        "joint_1, which the readings of the run do not determine: the prediction is not valid"
    ]
    assert said["map, no place reached"] == ["none of the 9 places have a number"]
    assert said["program, nothing to correct"] == [
        "nothing is corrected: no point is loaded, or each deflection is below its uncertainty"
    ]
    assert said["plan, joint without a load"] == ["no load of this plan twists joint_1"]


def test_a_load_that_hardly_bends_the_arm_may_be_in_kilonewtons(run):
    small = js.predict(run, POSTURE, forces=(0, 0, -0.5), at=POINT)
    (reason,) = small.assessment.reasons
    assert (reason.code, reason.weight) == ("prediction_implausible", "use_with_care")
    assert "this load is very small" in reason.message
    assert "may be kN that were read as N" in reason.remedy
    assert js.predict(run, POSTURE, forces=(0, 0, -50.0), at=POINT).assessment.verdict == "use"


def test_a_load_point_in_metres_is_named_although_the_place_is_in_millimetres(run):
    made = js.predict(run, POSTURE, forces=(0, 0, -500), at=(0, 0, 0.12), place=POINT)
    (reason,) = made.assessment.reasons
    assert "120 µm from the flange" in reason.message
    assert "may be m that were read as mm" in reason.remedy
    assert reason.remedy in " ".join(str(made).split())


def test_rounding_of_a_point_at_the_flange_is_no_distance(run):
    made = js.predict(run, POSTURE, forces=(0, 0, -500), at=(1e-11, 0, 0), place=POINT)
    assert made.assessment.verdict == "use"


NO_TOOL = "check the unit of the point; for a longer tool, put the flange of the robot's model on the tool"


@pytest.mark.parametrize(
    ("name", "where", "metres"),
    [
        ("prediction, µm for mm in the load point", "prediction.load_point", 120),
        ("prediction, µm for mm in the place", "prediction.place", 120),
        ("map, µm for mm", "map.place", 250),
    ],
)
def test_a_point_where_no_tool_reaches_is_refused(name, where, metres, run):
    with pytest.raises(js.CampaignError) as refused:
        ABSURD[name](run, None)
    problem = refused.value.problem
    assert (problem.where, problem.detail, problem.remedy) == (
        where,
        f"the point is {metres} m from the flange, where no tool reaches; up to 5 m is plausible",
        NO_TOOL,
    )


def test_a_program_for_kilonewtons_is_refused_with_all_its_reasons(run):
    with pytest.raises(js.CampaignError) as refused:
        ABSURD["program, kN for N"](run, None)
    problem = refused.value.problem
    assert (problem.type, problem.where) == ("urn:jointstiff:problem:not-to-be-used", "max_displacement")
    assert problem.detail == "the verdict on a program whose corrections exceed the limits is: do not use"
    assert [each.reason for each in problem.errors] == [
        f"the greatest deflection is 711.6 mm, 138 times the greatest of the campaign{PLAUSIBLE}",
        "4 of 4 points have loads or postures beyond those of the campaign",
        "the limits reduce the correction of 4 of 4 points",
    ]
    assert problem.errors[0].remedy == (
        "check the units of the load and of the points (N or kN, m or mm); if the numbers are right, "
        "state `accept_verdict` to use the result"
    )


def test_a_geometry_without_a_fault_is_for_use():
    made = js.geometry(ROOT / "examples" / "sweeps.json")
    assert str(made).splitlines()[0] == "Use: the checks found no fault"
    assert (made.result.assessment.verdict, made.result.assessment.reasons) == ("use", [])


def test_a_program_with_a_capped_point_needs_a_confirmation(run):
    with pytest.raises(js.CampaignError, match="do not use") as refused:
        ABSURD["program, all capped"](run, None)
    assert "limits reduce the correction of 4 of 4" in str(refused.value.problem.errors)
    program = ABSURD["program, all capped, accepted"](run, None)
    assert program.result.assessment.verdict == "do_not_use"
    assert "limits reduce the correction" in program.result.assessment.reasons[0].message


def test_the_greatest_deflection_and_the_farthest_point_decide(run):
    forces = [(0, 0, -1), KILONEWTONS, (0, 0, -2)]
    said = {each.code: each.message for each in run.predict(3 * POSTURE, forces, at=POINT).assessment.reasons}
    assert said["beyond_campaign"].startswith("1 of 3 cases")
    assert "times the greatest of the campaign" in said["prediction_implausible"]
    (reason,) = find_far_points([(0.0, 0.0, 0.12), (0.9, 1.2, 0.1), None])
    assert "1.5 m from the flange" in reason.message


def test_a_note_on_what_is_assumed_names_the_field_of_a_file_and_the_entry_of_the_page(clean):
    notes = " ".join(js.identify(clean).result.assessment.notes)
    named = re.findall(r"\(`noise\.([\w.]+)`; on the page: Advanced, ([^)]+)\)", notes)
    assert [field for field, _ in named] == ["grounds.load_point", "force.scale"]
    words = (ROOT / "dashboard" / "src" / "features" / "readings" / "words.ts").read_text(encoding="utf-8")
    assert all(f'"{entry}"' in words for _, entry in named)


@pytest.fixture(scope="module", params=range(4))
def poor(request):
    """Few postures and ten times the noise, with free compliances."""
    arm = default_arm()
    campaign = simulate_campaign(arm, load="pull", configurations=4, sigma=2e-4, seed=request.param)
    return js.identify(campaign, elasticity="joints", positive=False)


class TestPoorCampaigns:
    def test_use_needs_each_joint_that_carries_the_deflection(self, poor):
        joints = poor.result.joints
        poorly_known = {each.where for each in poor.reasons if each.code == "joint_poorly_known"}
        for joint in joints:
            if joint.name in poorly_known:
                lower, upper = joint.compliance_interval
                assert lower <= 0.0 or upper / lower > GOAL
                assert joint.verdict != "use"
        for contribution in poor.result.contributions:
            if contribution.share >= 0.05 and poor.verdict == "use":
                lower, upper = poor.joints[contribution.joint].compliance_interval
                assert 0.0 < upper <= GOAL * lower
        assert poor.result.assessment.joints_identified <= len(joints) - len(poorly_known)

    def test_a_negative_stiffness_is_never_used(self, poor):
        negative = [joint for joint in poor.result.joints if (joint.compliance or 0.0) < 0.0]
        assert {joint.verdict for joint in negative} <= {"do_not_use"}
        named = {each.where for each in poor.reasons if each.code == "stiffness_negative"}
        assert named == {joint.name for joint in negative}
        assert not negative or poor.verdict != "use"


def test_the_verdict_counts_the_joints_that_are_known():
    campaign = simulate_campaign(default_arm(), load="pull", configurations=7, sigma=2e-4, seed=3)
    run = js.identify(campaign, elasticity="joints")
    assert {each.code for each in run.reasons} == {"joint_poorly_known"}
    known = len(run.result.joints) - len(run.reasons)
    assert verdict_line(run.result.assessment).text == (
        f"Use with care: {known} of 6 joints are known within a factor of 1.5"
    )
