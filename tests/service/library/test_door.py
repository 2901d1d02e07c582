"""`import jointstiff` as in a notebook: light, and a run is a table."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

import jointstiff
from jointstiff.schemas.run import Campaign
from jointstiff.simulator import default_arm, simulate_campaign, truth

HEAVY = ("numpy", "pinocchio", "cvxpy", "pydantic", "httpx2", "rich", "sqlalchemy", "fastapi", "dbos")


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="pull", configurations=30, seed=3)


@pytest.mark.process
def test_the_package_by_itself_imports_nothing():
    program = f"import sys, jointstiff; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_its_names_are_there_and_no_others():
    for name in jointstiff.__all__:
        assert getattr(jointstiff, name).__name__ == name
    assert set(jointstiff.__all__) < set(dir(jointstiff))
    assert jointstiff.__version__.count(".") == 2
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = jointstiff.nothing


def test_a_file_a_document_and_a_campaign_are_the_same(document, tmp_path):
    path = tmp_path / "campaign.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    read = Campaign.model_validate_json(json.dumps(document))
    runs = [jointstiff.identify(each) for each in (document, read, path, str(path))]
    assert len({run.provenance.input_hash for run in runs}) == 1
    true = truth(default_arm(), document)["compliance"]
    for joint, compliance in zip(runs[0].result.joints, true, strict=True):
        assert abs(joint.compliance - compliance) < 4 * joint.standard_uncertainty


def test_options_take_the_place_of_the_campaigns(document):
    run = jointstiff.identify(document | {"run": {"positive": False}}, method="complete_pose")
    assert (run.request.method, run.request.positive) == ("complete_pose", False)


def test_a_run_shows_itself_as_a_table(document):
    document = json.loads(json.dumps(document))
    document["robot"]["name"] = "<script>alert(1)</script>"
    run = jointstiff.identify(document)
    shown = run._repr_html_()
    assert shown.startswith("<pre")
    assert all(joint.name in shown for joint in run.result.joints)
    assert "<script" not in shown


@pytest.mark.parametrize(
    ("campaign", "options", "where"),
    [
        ({}, {}, "robot"),
        ({"robot": {1, 2}}, {}, None),
        ("nowhere", {"method": "guess"}, "method"),
        ("nowhere", {"methods": "partial_pose"}, "methods"),
    ],
)
def test_what_cannot_be_used_is_refused_with_its_place(document, campaign, options, where):
    with pytest.raises(jointstiff.CampaignError) as refused:
        jointstiff.identify(document if campaign == "nowhere" else campaign, **options)
    assert refused.value.problem.where == where
    assert refused.value.problem.remedy


@pytest.mark.process
def test_a_client_identifies_and_prints_without_the_numerics(document, service, tmp_path):
    path = tmp_path / "campaign.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    program = f"""
import sys, jointstiff
with jointstiff.Client({service.url!r}) as client:
    run = client.identify({str(path)!r})
    print(run, file=sys.stderr)
    run.save({str(tmp_path / "joints.csv")!r})
print([name for name in ("numpy", "scipy", "pinocchio", "cvxpy") if name in sys.modules])
import matplotlib
matplotlib.use("Agg")
run.plot()
print([name for name in ("scipy", "pinocchio", "cvxpy") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n[]\n"
    assert "joint_6" in done.stderr
    assert (tmp_path / "joints.csv").read_text().count("\n") == 7
