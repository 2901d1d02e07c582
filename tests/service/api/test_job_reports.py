"""Reports of comparisons, pairs, plans, maps and programs over HTTP, and their tables."""

from __future__ import annotations

import csv
import io
import json

import anyio
import httpx2
import pypdf
import pytest
from support.api import file_at, posted
from support.kinds import posted_job

from jointstiff.service.app import create_app
from jointstiff.service.kinds.registry import KINDS
from jointstiff.simulator import default_arm, simulate_campaign

HOSTILE = '[bold red]=1+1 #read("/etc/passwd") <script>'


@pytest.fixture(scope="module")
def jobs(local):
    """The address of a job of each kind, on a robot whose first joint has a hostile name."""

    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    model = campaign["robot"]["model"]
    escaped = HOSTILE.replace("<", "&lt;").replace('"', "&quot;")
    urdf = model["urdf"].replace('name="joint_1"', f'name="{escaped}"')
    hostile = {"robot": campaign["robot"] | {"model": model | {"urdf": urdf}}}
    other = simulate_campaign(default_arm(), load="pull", configurations=12, seed=2)
    run, again = (posted(local, each | hostile) for each in (campaign, other))
    made = {
        kind: posted_job(local, kind, run, again["id"]) for kind in ("comparison", "plan", "map", "program")
    }
    return {"run": f"/v1/runs/{run['id']}"} | {
        kind: answer.headers["location"] for kind, answer in made.items()
    }


@pytest.mark.parametrize("kind", [kind.name for kind in KINDS if kind.reported])
def test_each_kind_has_a_report(local, jobs, kind):
    answer = local.get(file_at(jobs[kind], "report.pdf"))
    assert answer.status_code == 200, answer.text
    reader = pypdf.PdfReader(io.BytesIO(answer.content))
    text = " ".join(" ".join(page.extract_text().split()) for page in reader.pages)
    job = local.get(jobs[kind]).json()
    assert job["provenance"]["input_hash"] in text
    assert f"End of report {job['id']}" in text
    assert "not a test of static compliance after ISO 9283" in text
    assert "DRAFT" not in text
    assert json.loads(reader.attachments[f"{kind}.json"][0]) == job
    assert answer.content == local.get(file_at(jobs[kind], "report.pdf")).content
    page = local.get(file_at(jobs[kind], "report.html")).text
    assert "<table>" in page
    assert "<script" not in page


@pytest.mark.parametrize("kind", ["run", "comparison", "plan", "map", "program"])
def test_each_kind_has_its_tables_as_json(local, jobs, kind):
    answer = local.get(file_at(jobs[kind], "tables.json?unit=kNm/deg")).json()
    assert answer["assessment"] == local.get(jobs[kind]).json()["result"].get("assessment")
    tables = answer["tables"]
    assert tables
    for table in tables:
        assert table["rows"]
        assert all(len(row) == len(table["head"]) for row in table["rows"])
        assert set(table["texts"]) <= set(range(len(table["head"])))
    if kind in {"run", "comparison"}:
        assert "kN·m/°" in tables[0]["title"] + tables[0]["caption"]
    assert local.get(file_at(jobs[kind], "tables.json?unit=furlong")).status_code == 422
    assert local.get(file_at(jobs[kind][:-3] + "xyz", "tables.json")).status_code == 404


def test_tables_wait_for_their_turn_and_leave_other_requests_theirs(memory, jobs):
    """As files do: tables of many rows take seconds."""
    app = create_app(memory)
    turns = app.state.large_bodies

    async def ask():
        transport = httpx2.ASGITransport(app)
        async with httpx2.AsyncClient(transport=transport, base_url="http://localhost:8000") as client:
            for borrower in range(int(turns.total_tokens)):
                await turns.acquire_on_behalf_of(borrower)
            with anyio.move_on_after(2.0) as patience:
                await client.get(file_at(jobs["program"], "tables.json"))
            assert patience.cancelled_caught
            assert (await client.get(jobs["program"])).status_code == 200
            turns.release_on_behalf_of(0)
            assert (await client.get(file_at(jobs["program"], "tables.json"))).status_code == 200

    anyio.run(ask)


@pytest.mark.parametrize("kind", ["comparison", "plan"])
def test_hostile_names_of_joints_are_text(local, jobs, kind):
    page = local.get(file_at(jobs[kind], "report.html")).text
    assert "[bold red]=1+1 #read(&quot;/etc/passwd&quot;) &lt;script&gt;" in page


def test_two_sides_are_tables_and_pictures(local, jobs):
    def rows(name):
        return list(csv.DictReader(io.StringIO(local.get(file_at(jobs["comparison"], name)).text)))

    joints = local.get(jobs["comparison"]).json()["result"]["joints"]
    for row, joint in zip(rows("ratios.csv"), joints, strict=True):
        assert row["joint"] == joint["name"]
        assert float(row["ratio of stiffnesses, second to first [1]"]) == joint["ratio"]
    assert len(rows("configurations.csv")) == 2 * 12
    assert local.get(file_at(jobs["comparison"], "report.html")).text.count("<svg") == 3
