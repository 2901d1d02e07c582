"""What jobs of every kind have in common over HTTP, on both databases."""

import io
import json
import re
import uuid

import httpx2
import pypdf
import pytest
from rich.console import Console
from support.api import BOTH_DATABASES, CANCEL, RESTORE, file_at, job_at, posted
from support.kinds import change_of, posted_job

from jointstiff.schemas.finding import Problem
from jointstiff.schemas.job import JobSummary
from jointstiff.schemas.query import JobQuery
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.reports.job import lay_out_job
from jointstiff.simulator import default_arm, simulate_campaign

CAMPAIGN = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
HOSTILE = '[bold red]=1+1 #read("/etc/passwd") <script>'
"""Name of the robot's first joint, which is text wherever it stands."""

pytestmark = BOTH_DATABASES
kinds = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)


@pytest.fixture(scope="module")
def runs(service):
    """Return two runs of one measurement set, of which all jobs are made."""
    model = CAMPAIGN["robot"]["model"]
    escaped = HOSTILE.replace("<", "&lt;").replace('"', "&quot;")
    urdf = model["urdf"].replace('name="joint_1"', f'name="{escaped}"')
    hostile = CAMPAIGN | {"robot": CAMPAIGN["robot"] | {"model": model | {"urdf": urdf}}}
    with httpx2.Client(base_url=service.url, timeout=60.0) as client:
        return [posted(client, hostile, positive=positive) for positive in (True, False)]


@pytest.fixture
def post(client, runs):
    """Post a job of a kind, always made of the same runs."""
    run, other = runs

    def post(kind, **more):
        return posted_job(client, kind.name, run, other["id"], **more)

    return post


@pytest.fixture(scope="module")
def made():
    """Jobs that tests only read, by their service and kind."""
    return {}


@pytest.fixture
def job(kind, service, made, post):
    """Return a job of a kind."""
    key = (service.url, kind.name)
    if key not in made:
        made[key] = post(kind).json()
    return made[key]


@kinds
def test_it_is_made_once_and_the_same_input_gives_the_same_numbers(client, post, runs, kind):
    run, other_run = runs
    change = change_of(kind, run, other_run["id"])
    key = {"Idempotency-Key": uuid.uuid4().hex}
    answer = post(kind, headers=key)
    assert answer.status_code == 201, answer.text
    job = kind.message.model_validate_json(answer.content)
    assert (job.state, job.error, job.progress) == ("succeeded", None, None)
    assert answer.headers["location"] == f"/v1/jobs/{job.id}"
    assert client.get(answer.headers["location"]).content == answer.content
    assert post(kind, headers=key).content == answer.content
    other = post(kind, headers=key, **change)
    assert (other.status_code, other.json()["type"][-20:]) == (422, "idempotency-conflict")
    again, changed = (kind.message.model_validate(post(kind, **more).json()) for more in ({}, change))
    assert (again.id != job.id, again.result) == (True, job.result)
    hashes = [each.provenance.input_hash for each in (job, again, changed)]
    assert hashes[0] == hashes[1] != hashes[2]
    assert job.provenance.created_at <= job.provenance.started_at <= job.provenance.ended_at


@kinds
def test_it_is_listed_by_each_of_its_filters(client, job, kind):
    def listed(**filters):
        answer = client.get("/v1/jobs", params={"kind": kind.name} | filters)
        assert answer.status_code == 200, answer.text
        return {item["id"]: item for item in answer.json()["items"]}

    item = listed()[job["id"]]
    assert item == JobSummary.model_validate(item).model_dump(mode="json")
    filters = JobQuery.model_fields.keys() & JobSummary.model_fields.keys()
    assert {"kind", "state", "verdict", "robot_id"} <= filters
    for name in filters:
        if item[name] is not None:
            assert job["id"] in listed(**{name: item[name]}), name
        if name.endswith("_id"):
            assert listed(**{name: "nobody"}) == {}, name
    assert job["id"] not in listed(state="failed")
    assert job["id"] not in listed(kind="plan" if kind.name == "run" else "run")
    assert client.get("/v1/jobs", params={"colour": "red"}).status_code == 422
    missing = Problem.model_validate(client.get("/v1/jobs/nobody").json())
    assert (missing.status, missing.type[-10:]) == (404, ":not-found")


@kinds
def test_it_has_an_end_files_and_a_place_in_the_terminal(client, job, kind):
    events = client.get(f"{job_at(job)}/events")
    assert events.headers["content-type"].startswith("text/event-stream")
    assert [line for line in events.text.splitlines() if line.startswith("event:")] == ["event: end"]
    cancelled = client.patch(job_at(job), json=CANCEL)
    assert (cancelled.status_code, cancelled.json()) == (200, job)
    for odd in ({"cancelled": False}, {"deleted": "x"}, {"state": "running"}):
        assert client.patch(job_at(job), json=odd).status_code == 422
    assert client.patch(f"{job_at(job)}x", json=CANCEL).status_code == 404
    assert client.get(f"{job_at(job)}x/events").status_code == 404
    for file in kind.files:
        answer = client.get(file_at(job, file.name))
        if answer.status_code == 404:
            assert f"has no rows for {file.name}" in answer.json()["detail"]
            assert file.name == "ratios.csv"  # of two sets only
            continue
        assert answer.status_code == 200, answer.text
        assert answer.headers["content-type"].startswith(file.media_type), file.name
        assert job["id"][:8] in answer.headers["content-disposition"] or file.name == "program", file.name
        assert answer.content
    console = Console(file=io.StringIO(), width=120)
    console.print(lay_out_job(kind, kind.message.model_validate(job)))
    assert len(console.file.getvalue().splitlines()) > 5


@kinds
def test_it_has_a_report_and_its_tables(client, job, kind):
    answer = client.get(file_at(job, "tables.json?unit=Nm/arcmin")).json()
    assert answer["assessment"] == job["result"].get("assessment")
    assert answer["tables"]
    for table in answer["tables"]:
        assert table["rows"]
        assert all(len(row) == len(table["head"]) for row in table["rows"])
        assert set(table["texts"]) <= set(range(len(table["head"])))
    if kind.name in {"run", "comparison"}:
        assert "N·m/arcmin" in answer["tables"][0]["title"] + answer["tables"][0]["caption"]
    assert client.get(file_at(job, "tables.json?unit=furlong")).status_code == 422
    assert client.get(file_at(f"{job['id'][:-3]}xyz", "tables.json")).status_code == 404
    if not kind.has_report:
        return
    report = client.get(file_at(job, "report.pdf"))
    assert report.status_code == 200, report.text
    reader = pypdf.PdfReader(io.BytesIO(report.content))
    text = " ".join(" ".join(page.extract_text().split()) for page in reader.pages)
    assert job["provenance"]["input_hash"] in text
    assert f"End of report {job['id']}" in text
    assert "not a test of static compliance after ISO 9283" in text
    assert json.loads(reader.attachments[f"{kind.name}.json"][0]) == job
    assert report.content == client.get(file_at(job, "report.pdf")).content
    page = client.get(file_at(job, "report.html")).text
    assert "<table>" in page
    assert "<script" not in page
    if kind.name in {"comparison", "plan"}:
        assert "[bold red]=1+1 #read(&quot;/etc/passwd&quot;) &lt;script&gt;" in page


STANDARD_UNCERTAINTY = re.compile(r"\bu(?:\b|\()|\bstd\b|^standard uncertainty|\d\(\d+\)")
"""A column of standard uncertainties, or a number with one in its last digits."""
STIFFNESS = re.compile(r"^(?:stiffness|compliance|found)(?: \[|$)|^(?:first|second|CP|PP|DPP|joint_\d)")
"""Column of identified stiffnesses."""


@kinds
def test_its_tables_have_intervals_and_no_standard_uncertainty(client, job, kind):
    tables = client.get(file_at(job, "tables.json?details=true")).json()["tables"]
    for table in tables:
        texts = [*table["head"], table["caption"], *(cell for row in table["rows"] for cell in row)]
        assert [text for text in texts if STANDARD_UNCERTAINTY.search(text)] == []
        if any("interval" in title for title in table["head"]):
            assert not any("±" in cell for row in table["rows"] for cell in row)
            continue
        for column, title in enumerate(table["head"]):
            if not STIFFNESS.search(title) or "joint" not in table["head"]:
                continue
            for cell in (row[column] for row in table["rows"]):
                assert "…" in cell or cell[:1] in ("—", ">", "<", "") or "no interval" in cell, (title, cell)


@kinds
def test_it_is_deleted_and_brought_back(client, post, kind):
    key = {"Idempotency-Key": uuid.uuid4().hex}
    created = post(kind, headers=key)
    address, job = created.headers["location"], created.json()
    for _ in range(2):
        answer = client.patch(address, json={"deleted": True})
        assert (answer.status_code, answer.json()) == (200, job)
    gone = Problem.model_validate(client.get(address).json())
    assert (gone.status, gone.type[-8:]) == (404, ":deleted")
    assert f"PATCH {job_at(address)}" in gone.remedy

    def listed(**query):
        answer = client.get("/v1/jobs", params={"kind": kind.name} | query)
        return [item["id"] for item in answer.json()["items"]]

    assert (job["id"] in listed(), job["id"] in listed(deleted=True)) == (False, True)
    names = [file.name for file in kind.files]
    for hidden in (
        f"{job_at(address)}/events",
        *(file_at(address, each) for each in ("tables.json", *names)),
    ):
        assert client.get(hidden).json()["type"].endswith(":deleted")
    repeated = post(kind, headers=key)
    assert (repeated.status_code, repeated.json()) == (201, job)
    for _ in range(2):
        restored = client.patch(job_at(address), json=RESTORE)
        assert (restored.status_code, restored.json()) == (200, job)
    assert client.get(address).json() == job
    assert (listed()[0] == job["id"], job["id"] in listed(deleted=True)) == (True, False)
