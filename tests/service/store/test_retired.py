"""Jobs of kinds that this version does not have: read as they were stored, archived and restored."""

import json
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import httpx2
import pytest
from support import kept
from support.api import DELETE, RESTORE, file_at, job_at

from jointstiff.service.archive.restoring import restore_archive
from jointstiff.service.archive.writing import write_archive
from jointstiff.service.jobs import Part, Parts, make_record
from jointstiff.service.kinds.correction.files import decompress_file
from jointstiff.service.kinds.retired import RETIRED
from jointstiff.service.store.store import Store
from jointstiff.service.workers.worker import carry_out

*EARLIER, NEWEST = kept.kept_numbers()
retired_kinds = pytest.mark.parametrize("kind", RETIRED.values(), ids=lambda kind: kind.name)


@pytest.fixture(params=["sqlite", "postgresql"])
def empty(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[], str]:
    """Call it for the URL of an empty database; all of one kind."""
    if request.param == "postgresql":
        return request.getfixturevalue("new_postgresql_database")
    numbers = count()
    return lambda: f"sqlite:///{tmp_path / f'jointstiff_{next(numbers)}.db'}"


@pytest.fixture(params=[NEWEST, *(pytest.param(number, marks=pytest.mark.slow) for number in EARLIER)])
def number(request: pytest.FixtureRequest) -> str:
    """A layout; by night each one."""
    return str(request.param)


@pytest.fixture
def url(empty: Callable[[], str], number: str) -> str:
    """A kept database."""
    url = empty()
    kept.restore(number, url)
    return url


@pytest.fixture
def store(url: str) -> Iterator[Store]:
    """The store of the kept database, upgraded, with its documents rewritten."""
    with Store.open(url, upgrade=lambda _: None) as opened:
        opened.old_documents.rewrite(600.0)
        yield opened


@pytest.fixture
def client(store: Store) -> Iterator[httpx2.Client]:
    with kept.client_of(store) as made:
        yield made


def summary_of(client: httpx2.Client, kind: str) -> dict[str, Any]:
    """Return the summary of the only job of a kind in the listing of all jobs."""
    listed = client.get("/v1/jobs?limit=100")
    assert listed.status_code == 200, listed.text
    (summary,) = [item for item in listed.json()["items"] if item["kind"] == kind]
    assert [summary] == client.get("/v1/jobs", params={"kind": kind}).json()["items"]
    return summary


@retired_kinds
def test_it_is_listed_shown_deleted_and_brought_back(client: httpx2.Client, number: str, kind: Any) -> None:
    summary = summary_of(client, kind.name)
    stored = json.loads(kept.read_kept(number, "answers.json"))[f"/v1/jobs/{summary['id']}"]
    answer = client.get(job_at(summary))
    assert answer.status_code == 200
    assert list(kept.list_changes(stored, answer.json())) == []
    of_fleet = "two sets" if number == "0018" else "one set"
    assert (summary["state"], summary["name"]) == (
        "succeeded",
        of_fleet if kind.name == "fleet" else "corner.src",
    )
    assert summary["verdict"] == (stored["result"].get("assessment") or {}).get("verdict")
    assert client.patch(job_at(summary), json=DELETE).status_code == 200
    assert client.get(job_at(summary)).json()["type"].endswith(":deleted")
    assert client.patch(job_at(summary), json=RESTORE).json() == answer.json()
    if summary["robot_id"] is not None:
        client.patch(f"/v1/robots/{summary['robot_id']}", json={"name": "press line"})
        assert summary_of(client, kind.name)["robot_name"] == "press line"


@retired_kinds
def test_its_stored_files_are_delivered(client: httpx2.Client, store: Store, kind: Any) -> None:
    summary = summary_of(client, kind.name)
    stored = Parts(store).jobs[kind.name].current(summary["id"]).files
    assert len(stored) == {"fleet": 0, "program": 2, "process": 3}[kind.name]
    for file in stored:
        delivered = client.get(file_at(summary, file.name))
        assert (delivered.status_code, delivered.content) == (200, decompress_file(file))
        assert len(delivered.content) == file.bytes
    missing = client.get(file_at(summary, "report.pdf"))
    assert missing.status_code == 404
    if not stored:
        assert missing.json()["detail"] == "the job has no files"
        return
    assert "corner.src" in missing.json()["remedy"]
    program = client.get(file_at(summary, "program"))
    assert b"; Jointstiff run " in program.content
    assert program.content == client.get(file_at(summary, "program?file=corner.src")).content


@retired_kinds
def test_its_archive_is_restored(
    client: httpx2.Client, url: str, empty: Callable[[], str], tmp_path: Path, kind: Any
) -> None:
    summary = summary_of(client, kind.name)
    assert write_archive(url, tmp_path / "all.zip").damaged == []
    other_url = empty()
    assert restore_archive(tmp_path / "all.zip", other_url).refused == 0
    with Store.open(other_url) as other, kept.client_of(other) as client_of_other:
        assert summary_of(client_of_other, kind.name) == summary
        shown = client_of_other.get(job_at(summary)).json()
        assert shown == client.get(job_at(summary)).json()


@retired_kinds
def test_one_that_has_not_ended_fails_in_words(store: Store, kind: Any) -> None:
    """A queue that an earlier version filled may have a part of such a job."""
    parts = Parts(store)
    jobs = parts.jobs[kind.name]
    (entry,) = jobs.records.page(limit=1).records
    record = jobs.records.get(entry.id)
    job = jobs.current(entry.id)
    waiting = job.model_copy(update={"id": "waits", "state": "queued", "result": None})
    jobs.records.add(make_record(kind, waiting, record.robot_id))
    carry_out(store, parts.jobs_of, Part("waits", 0, 0), queue=None)  # type: ignore[arg-type]
    ended = jobs.current("waits")
    assert ended.state == "failed"
    assert ended.error is not None
    assert ended.error.detail == "this version does not do work of this kind"
    assert ended.error.remedy == "use the version of Jointstiff that stored the job"
