"""Laboratories: settings, and authorised reports, under a named key and never changed."""

import hashlib
import io
import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime

import anyio
import httpx2
import pypdf
import pytest
from support.api import file_at, job_at
from support.jobs import RUN, job_record
from support.terminal import terminal

from jointstiff.schemas.report import Laboratory
from jointstiff.service.app import create_app
from jointstiff.service.reports.laboratory import LaboratorySettings, SettingsError, read_laboratory
from jointstiff.service.reports.rendering import report_pdf
from jointstiff.service.security.admission import Posture
from jointstiff.service.security.keys import mint
from jointstiff.service.store.backups import back_up, restore
from jointstiff.service.store.collection import NumberTakenError
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import AuthorisationRecord
from jointstiff.simulator import default_arm, simulate_campaign

SVG = b'<svg xmlns="http://www.w3.org/2000/svg"><script>alert(1)</script></svg>'


def png(width, height, size=64):
    return b"\x89PNG\r\n\x1a\n" + b"\0\0\0\rIHDR" + struct.pack(">II", width, height) + bytes(size)


def jpeg(width, height):
    return b"\xff\xd8\xff\xe0\0\x04ab\xff\xc0\0\x11\x08" + struct.pack(">HH", height, width) + bytes(16)


def written(folder, logo=None, content=b"", text='name = "Lab"\n'):
    if logo is not None:
        text += f"logo = {logo!r}\n"
        if "/" not in logo and "\\" not in logo and logo not in {".", ".."}:
            (folder / logo).write_bytes(content)
    path = folder / "lab.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("logo", "content", "reason"),
    [
        ("../../etc/passwd", b"", "not the name of a file"),
        ("/etc/passwd", b"", "not the name of a file"),
        ("..\\secret.png", b"", "not the name of a file"),
        ("..", b"", "not the name of a file"),
        ("logo.svg", SVG, "neither PNG nor JPEG"),
        ("logo.png", SVG, "neither PNG nor JPEG"),
        ("logo.png", png(10, 10, 10_000_000), "exceeds 256 KiB"),
        ("logo.png", png(100_000, 100_000), "100000 × 100000 pixels"),
        ("logo.jpg", jpeg(3000, 10), "3000 × 10 pixels"),
        ("logo.png", png(0, 10), "0 × 10 pixels"),
        ("logo.png", png(10, 10), "cannot be shown"),
    ],
)
def test_other_logos_are_refused(tmp_path, logo, content, reason):
    with pytest.raises(SettingsError, match=reason):
        read_laboratory(written(tmp_path, logo, content))


def test_links_are_refused(tmp_path):
    path = written(tmp_path, "real.png", png(10, 10))
    (tmp_path / "logo.png").symlink_to(tmp_path / "real.png")
    path.write_text('name = "Lab"\nlogo = "logo.png"\n')
    with pytest.raises(SettingsError, match="is a link"):
        read_laboratory(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(SettingsError, match="cannot read"):
        read_laboratory(tmp_path / "lab.toml")


def test_the_service_does_not_start_with_settings_it_cannot_use(tmp_path):
    path = written(tmp_path, "logo.svg", SVG)
    shown = terminal("serve", "--port", "0", "--laboratory", str(path))
    assert shown.exit_code == 2
    assert "neither PNG nor JPEG" in shown.output
    assert "SVG is refused" in shown.output


POSTURE = Posture.of("127.0.0.1", (), access_control=True, require_key=True)
KEYS = {role: mint(f"{role} Smith", role, datetime.now(UTC), None) for role in ("operator", "admin")}
KEYS["deputy"] = mint("deputy Jones", "admin", datetime.now(UTC), None)
SETTINGS = LaboratorySettings(Laboratory(name="Metrology Lab"))


@pytest.fixture(scope="module")
def store():
    with Store.open("sqlite://") as opened:
        for minted in KEYS.values():
            opened.keys.add(minted.record)
        yield opened


@pytest.fixture(scope="module")
def ask(store):
    apps = {}

    def ask(method, path, role="operator", settings=SETTINGS, **options):
        name = settings.laboratory and settings.laboratory.name
        if name not in apps:
            apps[name] = create_app(store, posture=POSTURE, laboratory=settings)
        app = apps[name]

        async def send():
            transport = httpx2.ASGITransport(app)
            headers = {"Authorization": f"Bearer {KEYS[role].text}"}
            async with httpx2.AsyncClient(transport=transport, base_url="http://localhost:8000") as client:
                return await client.request(method, path, headers=headers, **options)

        return anyio.run(send)

    return ask


@pytest.fixture(scope="module")
def runs(ask):
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    first, second = (ask("POST", "/v1/campaigns", json=campaign).json() for _ in range(2))
    return first["request"]["measurement_set_id"], [first["id"], second["id"]]


@pytest.fixture
def run(ask, runs):
    """A run of the test's own, which nobody has authorised."""
    return ask("POST", "/v1/runs", json={"measurement_set_id": runs[0]}).json()["id"]


def page(ask, run, **options):
    return ask("GET", file_at(run, "report.html"), **options).text


def test_only_admins_authorise_and_only_for_a_laboratory(ask, run):
    path = f"/v1/runs/{run}/authorisations"
    assert ask("POST", path, json={}).status_code == 403
    refused = ask("POST", path, "admin", LaboratorySettings(), json={})
    assert refused.status_code == 409
    assert "--laboratory" in refused.json()["detail"]
    assert ask("GET", file_at(run, "authorisations.json")).json() == {"items": []}


def test_from_draft_to_superseded(ask, runs):
    measured, (first, second) = runs
    assert "draft" in page(ask, first)
    answer = ask("POST", f"/v1/runs/{first}/authorisations", "admin", json={"note": "checked by two"})
    assert answer.status_code == 201, answer.text
    assert answer.json()["key_name"] == "admin Smith"
    again = ask("POST", f"/v1/runs/{first}/authorisations", "admin", json={"note": "checked by two"})
    assert again.json() == answer.json()

    shown = page(ask, first)
    assert "Authorised by admin Smith" in shown
    assert "checked by two" in shown
    assert f"{first}-1" in shown
    assert ">draft<" not in shown
    assert page(ask, first, settings=LaboratorySettings(Laboratory(name="Another Lab"))) == shown

    for other, reason in ((first, "cannot supersede itself"), ("none", "there is no run")):
        refused = ask("POST", f"/v1/runs/{first}/authorisations", "admin", json={"supersedes": other})
        assert refused.status_code == 422
        assert reason in refused.text
    ask("POST", f"/v1/runs/{second}/authorisations", "admin", json={"supersedes": first})
    assert ">superseded<" in page(ask, first)
    refused = ask("POST", f"/v1/runs/{first}/authorisations", "admin", json={"supersedes": second})
    assert refused.status_code == 422
    assert "supersedes this one" in refused.text
    assert f"Superseded by the report of run {second}" in page(ask, first)
    assert ">authorised<" in page(ask, second)

    issued = page(ask, second)
    ask("PATCH", f"/v1/measurement-sets/{measured}", json={"operator": "Somebody else"})
    assert page(ask, second) == issued
    assert "Somebody else" not in page(ask, first)
    draft = page(ask, second, params={"draft": True})
    assert ">draft<" in draft
    assert "Somebody else" in draft
    assert len(ask("GET", file_at(first, "authorisations.json")).json()["items"]) == 1


def test_an_issued_report_stays_byte_for_byte(ask, runs, run, store, monkeypatch, tmp_path):
    """Settings, metadata, the software's version, backup and restore: the same PDF, whose hash is kept."""
    measured, _ = runs
    path = f"/v1/runs/{run}"
    body = {"customer": {"name": "Arms Inc.", "address": ["2 Side Street"]}, "received_on": "2026-11-20"}
    answer = ask("POST", f"{path}/authorisations", "admin", json=body)
    assert answer.status_code == 201, answer.text
    first = ask("GET", file_at(path, "report.pdf")).content
    assert answer.json()["pdf_sha256"] == hashlib.sha256(first).hexdigest()
    assert answer.json()["customer"]["name"] == "Arms Inc."
    text = " ".join("".join(one.extract_text() for one in pypdf.PdfReader(io.BytesIO(first)).pages).split())
    for words in ("Arms Inc., 2 Side Street", "Date of receipt 2026-11-20", "Authorised by admin Smith", run):
        assert words in text
    assert "DRAFT" not in text

    ask("PATCH", f"/v1/measurement-sets/{measured}", json={"operator": "A third person", "name": "renamed"})
    other = LaboratorySettings(Laboratory(name="Other Lab", traceability="next year's certificate"))
    monkeypatch.setattr("jointstiff.service.reports.run.TITLE", "Another layout")
    assert ask("GET", file_at(path, "report.pdf"), settings=other).content == first
    assert ask("GET", file_at(path, "issued-1.pdf"), settings=other).content == first
    assert ask("GET", file_at(path, "issued-2.pdf")).status_code == 404
    with Store.open(f"sqlite:///{tmp_path / 'a.db'}") as filed:
        filed.authorisations.add(store.authorisations.of(run_id=run)[0])
    back_up(f"sqlite:///{tmp_path / 'a.db'}", tmp_path / "backup")
    restore(f"sqlite:///{tmp_path / 'b.db'}", tmp_path / "backup")
    with Store.open(f"sqlite:///{tmp_path / 'b.db'}") as restored:
        assert restored.authorisations.of(run_id=run)[0].pdf == first

    second = ask("POST", f"{path}/authorisations", "admin", settings=other, json={}).json()
    assert second["number"] == 2
    assert second["customer"] is None
    shown = page(ask, run)
    assert "Other Lab" in shown
    assert "A third person" in shown
    assert f"It supersedes report {run}-1." in shown
    assert ask("GET", file_at(path, "issued-1.pdf")).content == first


@pytest.mark.parametrize(
    "body", [{"received_on": "yesterday"}, {"customer": {}}, {"customer": {"name": "\u0000"}}, {"number": 7}]
)
def test_what_cannot_be_stated_is_refused(ask, run, body):
    assert ask("POST", f"/v1/runs/{run}/authorisations", "admin", json=body).status_code == 422


def test_there_is_no_way_to_change_one(store, ask, run):
    path = f"/v1/runs/{run}/authorisations"
    assert {ask(method, path, "admin").status_code for method in ("DELETE", "PUT", "PATCH")} == {405}
    assert {n for n in dir(store.authorisations) if not n.startswith("_")} == {"add", "of", "page"}


def test_the_same_at_the_same_time_is_one(database_url):
    run = job_record(robot_id=None, measurement_set_id=None)
    now = datetime.now(UTC)
    key = ("0123456789", "admin Smith")
    same = AuthorisationRecord(run.id, None, now, *key, "hash", None, 1, "{}", "hash", b"pdf", b"page")
    again = replace(same, note="again", number=2)
    with Store.open(database_url) as store, ThreadPoolExecutor(8) as threads:
        store.jobs(RUN).add(run)
        assert list(threads.map(store.authorisations.add, [same] * 8)) == [same] * 8
        assert store.authorisations.of(run_id=run.id) == [same]
        assert store.authorisations.add(again) == again
        assert store.authorisations.of(run_id=run.id) == [same, again]
        with pytest.raises(NumberTakenError):
            store.authorisations.add(replace(same, key_id="9876543210", number=2))


def test_two_admins_at_the_same_instant_get_two_numbers(ask, run, monkeypatch):
    """Both have stated number 1 when the first of them is stored: the other states number 2."""
    both, made = threading.Barrier(2), []

    def meet(document):
        made.append(document.number)
        if len(made) <= 2:
            both.wait(60)
        return report_pdf(document)

    monkeypatch.setattr("jointstiff.service.api.runs.report_pdf", meet)
    with ThreadPoolExecutor(2) as threads:
        answers = list(
            threads.map(
                lambda who: ask("POST", f"/v1/runs/{run}/authorisations", who, json={}), ["admin", "deputy"]
            )
        )
    assert [answer.status_code for answer in answers] == [201, 201]
    assert sorted(made) == [f"{run}-1", f"{run}-1", f"{run}-2"]
    assert sorted(answer.json()["number"] for answer in answers) == [1, 2]
    for answer in answers:
        issued = ask("GET", file_at(run, f"issued-{answer.json()['number']}.pdf")).content
        text = " ".join(one.extract_text() for one in pypdf.PdfReader(io.BytesIO(issued)).pages)
        assert f"{run}-{answer.json()['number']}" in text
        assert f"Authorised by {answer.json()['key_name']}" in " ".join(text.split())


def test_an_authorised_run_is_not_deleted(ask, run):
    assert ask("POST", f"/v1/runs/{run}/authorisations", "admin", json={}).status_code == 201
    refused = ask("DELETE", job_at(run))
    assert refused.status_code == 409
    assert refused.json()["type"].endswith("authorised")
    assert ask("GET", f"/v1/runs/{run}").status_code == 200
