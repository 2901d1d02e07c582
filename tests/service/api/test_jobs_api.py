"""What jobs of all kinds share over HTTP: events, files and tags of documents that do not change."""

from __future__ import annotations

import pytest
from support.api import DELETE, file_at, job_at, posted

from jointstiff.simulator import default_arm, simulate_campaign

CAMPAIGN = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)

FIVE_JOINTS = CAMPAIGN["measurement_set"]["observations"][0] | {"joints": [0.0] * 5}


@pytest.fixture(scope="module")
def run(local):
    return posted(local, CAMPAIGN)


class TestCampaigns:
    def test_parts_that_were_deleted_are_stored_anew(self, local):
        named = CAMPAIGN | {"measurement_set": CAMPAIGN["measurement_set"] | {"name": "to be deleted"}}
        first = local.request("POST", "/v1/campaigns", json=named).json()
        before = first["request"]["measurement_set_id"]
        for address in (job_at(first), f"/v1/measurement-sets/{before}"):
            assert local.request("PATCH", address, json=DELETE).status_code == 200
        again = local.request("POST", "/v1/campaigns", json=named).json()
        assert again["request"]["measurement_set_id"] != before
        assert again["result"] == first["result"]

    @pytest.mark.parametrize(
        ("change", "where"),
        [
            ({"robot": CAMPAIGN["robot"] | {"name": ""}}, "robot.name"),
            (
                {
                    "robot": CAMPAIGN["robot"]
                    | {"model": {"format": "urdf", "urdf": "<robot/>", "base": "a", "flange": "b"}}
                },
                "robot",
            ),
            (
                {"measurement_set": CAMPAIGN["measurement_set"] | {"observations": [FIVE_JOINTS]}},
                "measurement_set.observations[0]",
            ),
            ({"run": {"stiffness_bounds": {"joint_9": [1.0, None]}}}, "run.stiffness_bounds"),
            ({"runs": {}}, "runs"),
        ],
    )
    def test_refused_with_the_place_in_the_file(self, local, change, where):
        answer = local.request("POST", "/v1/campaigns", json=CAMPAIGN | change)
        assert answer.status_code == 422, answer.text
        assert answer.json()["where"].startswith(where), answer.json()


@pytest.mark.parametrize(
    "name", ["", "nothing", "model.step", "report.docx", "issued-1.pdf", "issued-0.pdf", "../x", "%00"]
)
def test_unknown_files_name_those_there_are(local, run, name):
    answer = local.get(file_at(run, name))
    assert answer.status_code == 404
    if name in {"nothing", "model.step", "report.docx", "issued-0.pdf"}:
        assert all(word in answer.json()["remedy"] for word in ("tables.json", "report.pdf", "model.urdf"))


def test_who_has_a_document_is_told_so(local, run):
    readings = run["request"]["measurement_set_id"]
    robot = local.get(f"/v1/measurement-sets/{readings}").json()["robot_id"]
    addresses = [f"/v1/runs/{run['id']}", f"/v1/measurement-sets/{readings}", f"/v1/robots/{robot}"]
    addresses += [file_at(run, name) for name in ("tables.json", "model.csv", "report.html")]
    for address in addresses:
        first = local.get(address)
        tag = first.headers["etag"]
        for known in (tag, tag.removeprefix("W/"), f'"other", {tag}', "*"):
            answer = local.get(address, headers={"If-None-Match": known})
            assert (answer.status_code, answer.content) == (304, b""), address
            assert answer.headers["etag"] == tag
        assert local.get(address, headers={"If-None-Match": '"other"'}).content == first.content
    local.request("PATCH", f"/v1/robots/{robot}", json={"name": "another name"})
    known = local.get(addresses[2]).headers["etag"]
    local.request("PATCH", f"/v1/robots/{robot}", json={"name": "yet another"})
    assert local.get(addresses[2], headers={"If-None-Match": known}).status_code == 200


def test_reports_are_files_that_browsers_show(local, run):
    run_id = run["id"]
    for name, kind in (("pdf", "application/pdf"), ("html", "text/html; charset=utf-8")):
        answer = local.get(file_at(run, f"report.{name}"))
        assert answer.status_code == 200, answer.text
        assert answer.headers["content-type"] == kind
        assert answer.headers["content-disposition"] == f'inline; filename="report-{run_id}-0.{name}"'
        assert answer.content == local.get(file_at(run, f"report.{name}")).content
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; img-src data:; frame-ancestors 'none'; style-src 'sha256-")
