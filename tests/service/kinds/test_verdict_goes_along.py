"""The verdict of a run in all that is made from it: nothing acts on a robot by it, nothing absurd is used."""

import csv
import io

import pytest
from rich.console import Console
from support.api import file_at, posted
from support.guide_files import ROOT
from support.kinds import MAP, posted_job

import jointstiff
import jointstiff as js
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.reports.exports import FORMATS
from jointstiff.service.reports.job import job_report
from jointstiff.simulator import default_arm, simulate_campaign

ACCEPTED = {"accept_verdict": "do_not_use"}
REFUSED = ("plan", "map", "program")
"""Kinds that act on a robot, or guide a measurement."""
HEADLINE = "Do not use"


def campaign():
    """Return pulls whose columns of joints 2 and 3 are exchanged."""
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    for observation in document["measurement_set"]["observations"]:
        joints = observation["joints"]
        joints[1], joints[2] = joints[2], joints[1]
    return document


@pytest.fixture(scope="module")
def runs(local):
    """Return runs of two measurement sets of the campaign."""
    document = campaign()
    again = document | {"measurement_set": document["measurement_set"] | {"name": "again"}}
    return posted(local, document), posted(local, again)


@pytest.fixture(scope="module")
def post(local, runs):
    """Post a job of a kind that is made from the runs."""
    return lambda kind, **more: posted_job(local, kind, runs[0], runs[1]["id"], **more)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, id=kind.name, marks=pytest.mark.slow if kind.name == "plan" else ())
        for kind in KINDS
        if kind.name != "geometry"
    ],
)
def test_every_kind_says_it_first_in_the_terminal_in_its_report_and_in_its_tables(kind, local, post):
    answer = post(kind.name, **(ACCEPTED if kind.name in REFUSED else {}))
    assert answer.status_code == 201, answer.text
    job = answer.json()
    console = Console(file=io.StringIO(), width=120)
    console.print(job_report(kind, kind.message.model_validate(job)))
    first, *rest = console.file.getvalue().splitlines()
    assert first.startswith(HEADLINE)
    assert any("despite this verdict" in line for line in rest) == (kind.name in REFUSED)
    assert "do not use" in local.get(file_at(job, "report.html")).text.lower()
    names = [file.name for file in kind.files if file.suffix == "csv"]
    names += ["model.csv?accept_verdict=do_not_use"] if kind.name == "run" else []
    assert names
    for name in names:
        rows = list(csv.DictReader(io.StringIO(local.get(file_at(job, name)).text)))
        assert {row["overall verdict"] for row in rows} == {"do_not_use"}


@pytest.mark.parametrize("kind", REFUSED)
def test_nothing_acts_on_a_robot_unasked(local, post, kind):
    collection = next(each.collection for each in KINDS if each.name == kind)
    before = local.get(f"/v1/{collection}").json()["items"]
    answer = post(kind)
    assert answer.status_code == 422
    problem = answer.json()
    assert problem["type"] == "urn:jointstiff:problem:not-to-be-used"
    assert problem["where"] == ("measurement_set_id" if kind == "plan" else "run_id")
    assert "accept_verdict" in problem["remedy"]
    assert any("joint_2" in each["reason"] and each["remedy"] for each in problem["errors"])
    assert local.get(f"/v1/{collection}").json()["items"] == before
    assert post(kind, accept_verdict="use_with_care").status_code == 422


@pytest.mark.parametrize("name", FORMATS)
def test_nor_does_an_export(local, runs, name):
    address = file_at(runs[0], f"model.{name}")
    assert local.get(address).json()["type"] == "urn:jointstiff:problem:not-to-be-used"
    accepted = local.get(address, params=ACCEPTED)
    assert accepted.status_code == 200
    if name not in {"csv", "xlsx"}:
        assert "Verdict on the result: do not use." in accepted.text


def test_the_program_says_it_even_unmarked(local, post):
    program = post("program", **ACCEPTED, mark=False).json()
    text = local.get(file_at(program, "program")).text
    (mark,) = [line for line in text.splitlines() if "Jointstiff run" in line]
    assert mark.endswith("verdict: do not use")


def test_a_prediction_has_it(local, runs):
    case = {"joints": [0.1] * 6, "force": [0.0, 0.0, -500.0], "load_point": [0.0, 0.0, 0.2]}
    units = {"length": "m", "angle": "rad", "force": "N"}
    body = {"run_id": runs[0]["id"], "units": units, "cases": [case]}
    answer = local.request("POST", "/v1/deflections", json=body)
    assert answer.json()["assessment"]["verdict"] == "do_not_use"


def test_with_care_is_not_refused():
    document = simulate_campaign(default_arm(), load="dead_weight", configurations=12, seed=1)
    run = jointstiff.identify(document, complementary_stiffness="neglected")
    assert run.result.assessment.verdict == "use_with_care"
    downward = MAP | {"force": [0.0, 0.0, -500.0]}  # which joint 1, without a number, does not feel
    assert jointstiff.map(run, **downward).result.assessment.verdict == "use_with_care"


def test_a_trend_has_it(local):
    run = posted(local, simulate_campaign(default_arm(), load="pull", configurations=12, seed=1))
    robot = local.get(f"/v1/measurement-sets/{run['request']['measurement_set_id']}").json()["robot_id"]
    (entering,) = local.get(f"/v1/robots/{robot}/trend").json()["campaigns"]
    assert entering["assessment"] == run["result"]["assessment"]


def test_a_plan_goes_on_from_too_few_readings(local):
    run = posted(local, simulate_campaign(default_arm(), load="pull", configurations=2, seed=1))
    answer = posted_job(local, "plan", run)
    assert answer.status_code == 201, answer.text
    assert answer.json()["result"]["assessment"]["verdict"] != "use"


DOCUMENT = simulate_campaign(default_arm(), load="pull", configurations=19, seed=1)
WEIGHTS = simulate_campaign(default_arm(), configurations=19, seed=1)
POCKET = ROOT / "examples" / "pocket.src"
POSTURE = [[0, -20, 30, 0, 45, 0]]
POINT = (0, 0, 0.12)
AREA = {"area": [[1.4, -0.2, 0.6], [1.8, 0.2, 0.6]], "grid": (3, 3, 1), "place": (0, 0, 0.25)}
FAR = AREA | {"area": [[14.0, -2.0, 6.0], [18.0, 2.0, 6.0]]}
MILLING = {"accuracy_option": "off"}


@pytest.fixture(scope="module")
def run():
    return js.identify(DOCUMENT)


@pytest.fixture(scope="module")
def by_weights():
    run = js.identify(WEIGHTS)
    assert run.joints["joint_1"].stiffness is None
    return run


KILONEWTONS = (0, 0, -500_000)
ABSURD = {
    "prediction, kN for N": lambda run, _: run.predict(POSTURE, KILONEWTONS, at=POINT),
    "prediction, mm for m in the load point": lambda run, _: run.predict(
        POSTURE, (0, 0, -500), load_point=(0, 0, 120), place=POINT
    ),
    "prediction, mm for m in the place": lambda run, _: run.predict(
        POSTURE, (0, 0, -500), load_point=POINT, place=(0, 0, 120)
    ),
    "prediction, a few metres": lambda run, _: run.predict(POSTURE, (0, 0, -500), at=(0, 0, 4.0)),
    "prediction, joint without a number": lambda _, less: less.predict(POSTURE, (0, 500, 0), at=POINT),
    "map, kN for N": lambda run, _: js.map(run, force=KILONEWTONS, **AREA),
    "map, mm for m": lambda run, _: js.map(run, force=(0, 0, -500), **AREA | {"place": (0, 0, 250)}),
    "map, no place reached": lambda run, _: js.map(run, force=(0, 0, -500), **FAR),
    "map, joint without a number": lambda _, less: js.map(less, force=(0, 500, 0), **AREA),
    "program, kN for N": lambda run, _: js.compensate(run, POCKET, force=KILONEWTONS, **MILLING),
    "program, all capped": lambda run, _: js.compensate(
        run, POCKET, force=(0, 0, -500), limits={"displacement": 1e-4}, **MILLING
    ),
    "program, all capped, accepted": lambda run, _: js.compensate(
        run, POCKET, force=(0, 0, -500), limits={"displacement": 1e-4}, **MILLING, **ACCEPTED
    ),
    "program, nothing to correct": lambda run, _: js.compensate(run, POCKET, force=(0, 0, 0), **MILLING),
    "plan, joint without a load": lambda *_: js.plan(WEIGHTS, readings=4, candidates=100),
    "run, joint without a number": lambda _, less: less,
}


@pytest.mark.parametrize("name", ABSURD)
def test_no_head_says_use(name, run, by_weights):
    try:
        result = ABSURD[name](run, by_weights)
    except js.CampaignError as refused:
        assert refused.problem.remedy  # noqa: PT017 - one of two outcomes
        return
    head = str(result).splitlines()[0]
    if name.startswith("run"):
        assert head.startswith("Use 5 of 6 joints: the others have no number")
        return
    assert head.startswith(("Do not use this", "Use this")), head
    assert "Do not use" in head or "with care" in head, head


def test_a_program_with_a_capped_point_needs_a_confirmation(run):
    with pytest.raises(js.CampaignError, match="do not use") as refused:
        ABSURD["program, all capped"](run, None)
    assert "limits reduce the corrections of 4 of 4" in str(refused.value.problem.errors)
    program = ABSURD["program, all capped, accepted"](run, None)
    assert program.result.assessment.verdict == "do_not_use"
    assert "limits reduce the corrections" in program.result.assessment.reasons[0].message
