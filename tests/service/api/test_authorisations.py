"""Authorisations of reports: under a named key, of what it stated, never changed."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime

import anyio
import httpx2
import pytest
from support.records import RUN, job_record

from jointstiff.schemas.report import Laboratory
from jointstiff.service.access.key_text import mint
from jointstiff.service.api.posture import Posture
from jointstiff.service.app import create_app
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.store.records import AuthorisationRecord
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign

POSTURE = Posture.of("127.0.0.1", (), access_control=True, require_key=True)
KEYS = {role: mint(f"{role} Smith", role, datetime.now(UTC), None) for role in ("operator", "admin")}
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
    robot = ask("POST", "/v1/robots", json=campaign["robot"]).json()["id"]
    readings = campaign["measurement_set"] | {"robot_id": robot}
    measured = ask("POST", "/v1/measurement-sets", json=readings).json()["id"]
    request = {"measurement_set_id": measured}
    return measured, [ask("POST", "/v1/runs", json=request).json()["id"] for _ in range(2)]


def page(ask, run, **options):
    return ask("GET", f"/v1/runs/{run}/report.html", **options).text


def test_only_admins_authorise_and_only_for_a_laboratory(ask, runs):
    path = f"/v1/runs/{runs[1][0]}/authorisations"
    assert ask("POST", path, json={}).status_code == 403
    refused = ask("POST", path, "admin", LaboratorySettings(), json={})
    assert refused.status_code == 409
    assert "--laboratory" in refused.json()["detail"]
    assert ask("GET", path).json() == {"items": []}


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
    assert ">draft<" in page(ask, first, settings=LaboratorySettings(Laboratory(name="Another Lab")))

    for other, reason in ((first, "does not supersede itself"), ("none", "there is no run")):
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

    ask("PATCH", f"/v1/measurement-sets/{measured}", json={"operator": "Somebody else"})
    assert "It was changed since." in page(ask, second)
    assert ">draft<" in page(ask, second)
    assert len(ask("GET", f"/v1/runs/{first}/authorisations").json()["items"]) == 1


def test_there_is_no_way_to_change_one(store, ask, runs):
    path = f"/v1/runs/{runs[1][0]}/authorisations"
    assert {ask(method, path, "admin").status_code for method in ("DELETE", "PUT", "PATCH")} == {405}
    assert {n for n in dir(store.authorisations) if not n.startswith("_")} == {"add", "of", "page"}


def test_the_same_at_the_same_time_is_one(database_url):
    run = job_record(robot_id=None, measurement_set_id=None)
    same = AuthorisationRecord(run.id, None, datetime.now(UTC), "0123456789", "admin Smith", "hash", None)
    again = replace(same, note="again")
    with Store.open(database_url) as store, ThreadPoolExecutor(8) as threads:
        store.jobs(RUN).add(run)
        assert list(threads.map(store.authorisations.add, [same] * 8)) == [same] * 8
        assert store.authorisations.of(run_id=run.id) == [same]
        assert store.authorisations.add(again) == again
        assert store.authorisations.of(run_id=run.id) == [same, again]


def test_an_authorised_run_is_not_deleted(ask, runs):
    measured, _ = runs
    run = ask("POST", "/v1/runs", json={"measurement_set_id": measured}).json()["id"]
    assert ask("POST", f"/v1/runs/{run}/authorisations", "admin", json={}).status_code == 201
    refused = ask("DELETE", f"/v1/runs/{run}")
    assert refused.status_code == 409
    assert refused.json()["type"].endswith("authorised")
    assert ask("GET", f"/v1/runs/{run}").status_code == 200
