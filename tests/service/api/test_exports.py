"""Exports over HTTP: a file of each format, and refusals."""

from __future__ import annotations

import pytest
from support.in_process import Client

from jointstiff.service.exporting.formats import FORMATS
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture(scope="module")
def client():
    with Store.open("sqlite://") as store:
        yield Client(store)


@pytest.fixture(scope="module")
def run_id(client):
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    robot = client.request("POST", "/v1/robots", json=campaign["robot"]).json()["id"]
    readings = campaign["measurement_set"] | {"robot_id": robot}
    measured = client.request("POST", "/v1/measurement-sets", json=readings).json()["id"]
    return client.request("POST", "/v1/runs", json={"measurement_set_id": measured}).json()["id"]


def test_each_format_is_a_file(client, run_id):
    for name, found in FORMATS.items():
        answer = client.get(f"/v1/runs/{run_id}/model.{name}")
        assert answer.status_code == 200, answer.text
        assert answer.headers["content-type"].startswith(found.media_type)
        assert answer.headers["content-disposition"] == f'attachment; filename="model-{run_id}.{name}"'
        assert run_id.encode() in answer.content or name == "xlsx"


def test_other_formats_and_runs_are_refused(client, run_id):
    assert client.get(f"/v1/runs/{run_id}/model.step").status_code == 422
    assert client.get("/v1/runs/none/model.csv").status_code == 404


def test_reports_are_files_that_browsers_show(client, run_id):
    for name, kind in (("pdf", "application/pdf"), ("html", "text/html; charset=utf-8")):
        answer = client.get(f"/v1/runs/{run_id}/report.{name}")
        assert answer.status_code == 200, answer.text
        assert answer.headers["content-type"] == kind
        assert answer.headers["content-disposition"] == f'inline; filename="report-{run_id}-0.{name}"'
        assert answer.content == client.get(f"/v1/runs/{run_id}/report.{name}").content
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; img-src data:; frame-ancestors 'none'; style-src 'sha256-")
    assert client.get(f"/v1/runs/{run_id}/report.docx").status_code == 422
