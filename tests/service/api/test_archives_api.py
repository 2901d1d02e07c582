"""Archive and restore over HTTP: who may, what is reported, and that nothing is lost between two services."""

import io
import json
import zipfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import httpx2
import pytest
from support import kept
from support.in_process import Client
from support.keyed import bearer, opened
from support.processes import LONGEST_SECONDS, Service

from jointstiff.service.archive import form
from jointstiff.service.archive.restoring import restore_archive
from jointstiff.service.archive.writing import write_archive
from jointstiff.service.security.admission import MAX_ARCHIVE_BYTES, AccessPolicy
from jointstiff.service.store.store import Store

pytestmark = pytest.mark.process
UPLOAD = {"Content-Type": "application/zip"}
KEPT = "0018"


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of a database with one of everything."""
    folder = tmp_path_factory.mktemp("full")
    old, url = f"sqlite:///{folder / 'old.db'}", f"sqlite:///{folder / 'store.db'}"
    kept.restore(KEPT, old)
    with Store.open(old, upgrade=lambda _: None) as store:
        store.old_documents.rewrite(600.0)
    write_archive(old, folder / "all.zip", "hashes")
    restore_archive(folder / "all.zip", url)  # its documents have all fields of today
    return url


@pytest.fixture(scope="module")
def saved(full: str) -> bytes:
    """An archive that a service wrote."""
    return download(full)


@pytest.fixture
def empty_service(tmp_path: Path) -> Iterator[httpx2.Client]:
    with serving(tmp_path) as client:
        yield client


@pytest.fixture(scope="module")
def refusing_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx2.Client]:
    """A service with an empty database, for uploads that store nothing."""
    with serving(tmp_path_factory.mktemp("refusing")) as client:
        yield client


@contextmanager
def serving(folder: Path) -> Iterator[httpx2.Client]:
    service = Service(f"sqlite:///{folder / 'store.db'}", "--workers", "0")
    try:
        with httpx2.Client(base_url=service.url, timeout=None) as client:
            yield client
    finally:
        service.stop()


def download(url: str) -> bytes:
    """The archive of a database, from a service of its own."""
    service = Service(url, "--workers", "0")
    try:
        answer = httpx2.get(f"{service.url}/v1/archive", timeout=None)
    finally:
        service.stop()
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/zip"
    assert answer.headers["content-disposition"].startswith('attachment; filename="jointstiff-')
    return answer.content


def restore(client: httpx2.Client, content: bytes, *, dry_run: bool = False) -> dict[str, Any]:
    """The last report about a restore."""
    query = {"dry_run": "true"} if dry_run else {}
    answer = client.post("/v1/restores", content=content, params=query, headers=UPLOAD)
    assert answer.status_code == 200, answer.text
    *_, last = answer.text.splitlines()
    report: dict[str, Any] = json.loads(last)
    assert report["done"], report
    return report


def manifest_of(content: bytes) -> dict[str, Any]:
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        manifest: dict[str, Any] = json.loads(file.read(form.MANIFEST))
    return manifest


def counts(report: dict[str, Any], column: str) -> dict[str, int]:
    return {name: table[column] for name, table in report["tables"].items()}


def test_archive_restored_and_archived_again_has_an_equal_manifest(empty_service, saved):
    report = restore(empty_service, saved)
    again = empty_service.get("/v1/archive").content
    files = manifest_of(saved)["files"]
    assert manifest_of(again)["files"] | {"audit.jsonl": files["audit.jsonl"]} == files
    assert counts(report, "added") == counts(report, "lines")
    assert sum(counts(report, "lines").values()) > 20


def test_a_dry_run_reports_what_a_restore_adds_and_adds_nothing(empty_service, saved):
    planned = restore(empty_service, saved, dry_run=True)
    assert empty_service.get("/v1/robots").json()["items"] == []
    done = restore(empty_service, saved)
    assert counts(planned, "added") == counts(done, "added")
    again = restore(empty_service, saved)
    assert set(counts(again, "added").values()) == {0}
    assert counts(again, "present") == counts(done, "added")


def test_an_upload_adds_no_key_and_no_audit(empty_service, full, tmp_path):
    """The holder of a key that was revoked, or was never of this service, stays outside."""
    path = tmp_path / "with hashes.zip"
    write_archive(full, path, "hashes")
    report = restore(empty_service, path.read_bytes())
    assert report["left_out"].keys() == {"access_keys", "audit"}
    assert report["left_out"]["access_keys"] > 0
    archived = empty_service.get("/v1/archive").content
    assert "access_keys.jsonl" not in manifest_of(archived)["files"]
    with Store.open(f"sqlite:///{tmp_path / 'store.db'}") as store:
        assert store.keys.all() == []


def test_an_archive_of_a_service_has_no_keys(saved):
    assert "access_keys.jsonl" not in manifest_of(saved)["files"]


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda _: b"no archive", "no archive"),
        (lambda content: content[:-100], "no archive"),
        (lambda content: content.replace(b"PK\x03\x04", b"PK\x03\x05"), "damaged"),
        (lambda _: b"", "no archive"),
    ],
    ids=["another file", "a cut file", "damaged heads", "nothing"],
)
def test_an_upload_that_is_no_archive_is_refused_and_stores_nothing(refusing_service, saved, damage, words):
    answer = refusing_service.post("/v1/restores", content=damage(saved), headers=UPLOAD)
    assert answer.status_code == 422, answer.text
    assert words in answer.json()["detail"]
    assert "/" not in answer.json()["detail"], "the message names a path of the service"
    assert refusing_service.get("/v1/robots").json()["items"] == []


def test_an_upload_beyond_the_limit_is_refused(refusing_service):
    host, port = refusing_service.base_url.host, refusing_service.base_url.port
    with closing(HTTPConnection(host, port, timeout=LONGEST_SECONDS)) as connection:
        connection.putrequest("POST", "/v1/restores")
        for name, value in (UPLOAD | {"Content-Length": str(MAX_ARCHIVE_BYTES + 1)}).items():
            connection.putheader(name, value)
        connection.endheaders()
        assert connection.getresponse().status == 413


def test_an_upload_needs_its_media_type(refusing_service, saved):
    assert refusing_service.post("/v1/restores", content=saved).status_code == 415


@pytest.mark.parametrize(("method", "path"), [("GET", "/v1/archive"), ("POST", "/v1/restores")])
def test_only_admins_archive_and_restore(method, path):
    with Store.open("sqlite://") as store:
        client = opened(store)
        found = {
            role: client.request(method, path, content=b"", headers=UPLOAD | bearer(role)).status_code
            for role in (None, "viewer", "operator", "admin")
        }
    assert found == {None: 401, "viewer": 403, "operator": 403, "admin": 404}  # 404: a database in memory


@pytest.mark.parametrize(("method", "path"), [("GET", "/v1/archive"), ("POST", "/v1/restores")])
def test_nobody_archives_where_a_proxy_controls_access(method, path):
    with Store.open("sqlite://") as store:
        policy = AccessPolicy("none")
        answer = Client(store, policy).request(method, path, content=b"", headers=UPLOAD)
    assert answer.status_code == 403
    assert "jointstiff archive" in answer.json()["remedy"]
