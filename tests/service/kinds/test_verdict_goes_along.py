"""The verdict of a run in all that is made from it; nothing acts on a robot by a run not to be used."""

from __future__ import annotations

import csv
import io
import json

import pytest
from rich.console import Console
from support.api import file_at, posted
from support.kinds import MAP, PLAN, TEXT, posted_job
from support.programs import options
from typer.testing import CliRunner

import jointstiff
from jointstiff.service.cli.app import app
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


@pytest.fixture(scope="module", params=[kind.name for kind in KINDS if kind.name != "geometry"])
def made(request, post):
    """Return each kind with a job of it that is made from the run."""
    kind = next(kind for kind in KINDS if kind.name == request.param)
    answer = post(kind.name, **(ACCEPTED if kind.name in REFUSED else {}))
    assert answer.status_code == 201, answer.text
    return kind, answer.json()


class TestEveryKind:
    def test_says_it_first_in_the_terminal(self, made):
        kind, job = made
        console = Console(file=io.StringIO(), width=120)
        console.print(job_report(kind, kind.message.model_validate(job)))
        first, *rest = console.file.getvalue().splitlines()
        assert first.startswith(HEADLINE)
        assert any("despite this verdict" in line for line in rest) == (kind.name in REFUSED)

    def test_has_it_in_its_report(self, made, local):
        _, job = made
        page = local.get(file_at(job, "report.html")).text
        assert "do not use" in page.lower()

    def test_has_it_in_its_tables(self, made, local):
        kind, job = made
        names = [file.name for file in kind.files if file.suffix == "csv"]
        names += ["model.csv?accept_verdict=do_not_use"] if kind.name == "run" else []
        assert names
        for name in names:
            text = local.get(file_at(job, name)).text
            rows = list(csv.DictReader(io.StringIO(text)))
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


def test_a_prediction_has_it(local, runs, tmp_path):
    case = {"joints": [0.1] * 6, "force": [0.0, 0.0, -500.0], "load_point": [0.0, 0.0, 0.2]}
    units = {"length": "m", "angle": "rad", "force": "N"}
    body = {"run_id": runs[0]["id"], "units": units, "cases": [case]}
    answer = local.request("POST", "/v1/deflections", json=body)
    assert answer.json()["assessment"]["verdict"] == "do_not_use"
    (tmp_path / "campaign.json").write_text(json.dumps(campaign()))
    heads = ",".join([*(f"J{j} [deg]" for j in range(1, 7)), *(f"F{axis} [N]" for axis in "xyz")])
    (tmp_path / "postures.csv").write_text(f"{heads}\n5,5,5,5,5,5,0,0,-500\n")
    command = ["predict", str(tmp_path / "campaign.json"), str(tmp_path / "postures.csv")]
    done = CliRunner().invoke(app, [*command, "--load-point", "0,0,200", "-o", str(tmp_path / "out.csv")])
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith(HEADLINE)
    (row,) = csv.DictReader(io.StringIO((tmp_path / "out.csv").read_text()))
    assert row["overall verdict"] == "do_not_use"


def test_the_terminal_wants_it_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "campaign.json").write_text(json.dumps(campaign()))
    (tmp_path / "path.src").write_text(TEXT, newline="")
    (tmp_path / "program.json").write_text(json.dumps(options("krl")))
    (tmp_path / "map.json").write_text(json.dumps(MAP))
    (tmp_path / "plan.json").write_text(json.dumps(PLAN))
    for command in (
        ["map", "campaign.json", "--options", "map.json"],
        ["compensate", "campaign.json", "path.src", "--options", "program.json", "-o", "out.src"],
        ["plan", "campaign.json", "--options", "plan.json"],
        ["export", "campaign.json", "-o", "model.mjcf"],
    ):
        refused = CliRunner().invoke(app, command)
        assert refused.exit_code == 2, refused.output
        assert "--despite-verdict" in refused.output
        assert not (tmp_path / command[-1]).exists() or command[-2] != "-o"
        done = CliRunner().invoke(app, [*command, "--despite-verdict"])
        assert done.exit_code == 0, done.output
        assert command[0] == "export" or done.stdout.startswith(HEADLINE)


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
