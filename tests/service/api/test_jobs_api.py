"""Jobs over HTTP: files, tables, tags of documents; runs that leave readings out; programs as forms."""

import copy
import json

import anyio
import httpx2
import numpy as np
import pytest
from support.api import file_at, post, posted
from support.kinds import posted_job
from support.programs import options, path, tool_poses

from jointstiff.schemas.program import Program
from jointstiff.service.app import create_app
from jointstiff.service.programs.formats import read_program
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text

CAMPAIGN = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)


@pytest.fixture(scope="module")
def run(local):
    return posted(local, CAMPAIGN)


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


@pytest.fixture(scope="module")
def comparison(local, run):
    """The address of a comparison of two sets."""
    again = posted(local, simulate_campaign(default_arm(), load="pull", configurations=12, seed=2))
    return posted_job(local, "comparison", run, again["id"]).headers["location"]


def test_tables_wait_for_their_turn_and_leave_other_requests_theirs(memory, comparison):
    """As files do: tables of many rows take seconds."""
    app = create_app(memory)
    turns = app.state.large_bodies

    async def ask():
        transport = httpx2.ASGITransport(app)
        async with httpx2.AsyncClient(transport=transport, base_url="http://localhost:8000") as client:
            for borrower in range(int(turns.total_tokens)):
                await turns.acquire_on_behalf_of(borrower)
            with anyio.move_on_after(2.0) as patience:
                await client.get(file_at(comparison, "tables.json"))
            assert patience.cancelled_caught
            assert (await client.get(comparison)).status_code == 200
            turns.release_on_behalf_of(0)
            assert (await client.get(file_at(comparison, "tables.json"))).status_code == 200

    anyio.run(ask)


def test_a_run_without_an_observation_is_that_of_a_set_without_it(local, run):
    """A target is bumped in the fifth observation."""
    measured = local.get(f"/v1/measurement-sets/{run['request']['measurement_set_id']}").json()
    observations = copy.deepcopy(CAMPAIGN["measurement_set"]["observations"])
    label = observations[4]["label"]
    observations[4]["readings"][0]["loaded"][0] += 2e-3
    body = CAMPAIGN["measurement_set"] | {"robot_id": measured["robot_id"]}
    bumped, shorter = (
        post(local, "/v1/measurement-sets", body | {"observations": each})["id"]
        for each in (observations, observations[:4] + observations[5:])
    )
    left = post(local, "/v1/runs", {"measurement_set_id": bumped, "leave_out": [label]})
    other = post(local, "/v1/runs", {"measurement_set_id": shorter})
    compliance = [[j["compliance"] or 0.0 for j in r["result"]["joints"]] for r in (left, other)]
    np.testing.assert_allclose(compliance[0], compliance[1], rtol=1e-12)
    assert left["provenance"]["input_hash"] == other["provenance"]["input_hash"]
    assert label not in {residual["observation"] for residual in left["result"]["residuals"]}
    assert label not in str(left["result"]["warnings"])


TEXT = program_text("krl", tool_poses(path(8)), 4)


@pytest.fixture(scope="module")
def run_id(run):
    return run["id"]


def send(local, run_id, text=TEXT, name="cell.src", headers=None, kind="krl", **changes):
    stated = options(kind, **changes) | {"run_id": run_id}
    return local.request(
        "POST",
        "/v1/programs",
        files=[("files", (name, text.encode("latin-1")))],
        data={"options": json.dumps(stated)},
        headers=headers,
    )


def test_a_program_is_corrected_and_handed_back(local, run_id):
    answer = send(local, run_id)
    assert answer.status_code == 201, answer.text
    assert len(answer.content) < 20_000
    program = Program.model_validate(answer.json())
    assert program.state == "succeeded"
    assert (program.result.points, program.result.corrected) == (8, 8)
    assert {file.content for file in [*program.result.files, *program.request.files]} == {None}
    address = answer.headers["location"]
    file = local.get(file_at(address, "program"))
    assert file.headers["content-disposition"] == "attachment; filename*=UTF-8''cell-corrected.src"
    assert len(read_program([("cell.src", file.content)]).targets) == 8
    assert local.get(file_at(address, "program"), params={"file": "cell.src"}).content == file.content
    assert local.get(file_at(address, "program"), params={"file": "cell.dat"}).status_code == 422
    table = local.get(file_at(address, "points.csv"))
    assert table.headers["content-type"].startswith("text/csv")
    assert len(table.text.splitlines()) == 9


@pytest.mark.parametrize("mark", [True, False])
def test_a_corrected_program_is_not_corrected_again(local, run_id, mark):
    answer = send(local, run_id, mark=mark)
    corrected = local.get(file_at(answer.json(), "program")).content.decode("latin-1")
    assert ("; Jointstiff run " in corrected) == mark
    again = send(local, run_id, corrected, mark=mark)
    assert again.status_code == 422
    assert "the original program" in json.dumps(again.json())
    assert send(local, run_id, mark=mark).status_code == 201  # the program itself may be corrected anew
