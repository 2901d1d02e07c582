"""The cost of a key's check, and of the audit, on the POST of a run."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from datetime import UTC, datetime
from functools import partial
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import httpx2

from benchmarks.campaigns import small_campaign
from benchmarks.report import Figure, Section, times_table
from benchmarks.services import Service
from benchmarks.timing import interleaved
from jointstiff.service.security.keys import mint
from jointstiff.service.store.store import Store

__all__ = ["run"]

OPEN, KEYED = "POST /v1/runs, no key demanded", "POST /v1/runs, key checked, audit written"
OPEN_GET, KEYED_GET = "GET /v1, no key demanded", "GET /v1, key checked"


def run(*, quick: bool) -> list[Section]:
    """Post the same run to a service that demands no key and to one that does."""
    with ExitStack() as stack:
        candidates: dict[str, Callable[[], object]] = {}
        for post, get, options in ((OPEN, OPEN_GET, ()), (KEYED, KEYED_GET, ("--require-key",))):
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="jointstiff-benchmark-"))
            database = f"sqlite:///{Path(folder) / 'jointstiff.db'}"
            headers = {"Authorization": f"Bearer {_key(database)}"}
            service = stack.enter_context(Service(database, 1, options=options))
            body = _prepare(service.url, headers)
            connection = HTTPConnection(urlsplit(service.url).netloc, timeout=60.0)
            stack.callback(connection.close)
            headers["Content-Type"] = "application/json"
            candidates[post] = partial(_send, connection, "POST", "/v1/runs", body, headers)
            candidates[get] = partial(_send, connection, "GET", "/v1", None, headers)
        times = interleaved(candidates, rounds=3 if quick else 300, warm_up=10)
    check = (times.median(KEYED_GET) - times.median(OPEN_GET)) / times.median(OPEN)
    columns, rows = times_table(times, OPEN)
    return [
        Section(
            title="POST of a run with a key, 19 configurations × 3 targets, SQLite",
            columns=columns,
            rows=rows,
            figures=(
                Figure("check of a key / POST of a run", 100.0 * check, "at most", 3.0, "%"),
                Figure("POST with key and audit / without", times.ratio(KEYED, OPEN), "at most", 1.5, "×"),
            ),
            notes=(
                "the check is the difference of the GETs, which compute nothing",
                "an entry of the audit is one more transaction, synced before the answer",
            ),
            data={"seconds": times.seconds},
        )
    ]


def _key(database: str) -> str:
    text, record = mint("benchmark", "operator", datetime.now(UTC), None)
    with Store.open(database) as store:
        store.keys.add(record)
    return text


def _prepare(address: str, headers: dict[str, str]) -> bytes:
    """Post robot and readings; return the body of the runs to come."""
    campaign = small_campaign().document
    with httpx2.Client(base_url=address, headers=headers, timeout=60.0) as client:
        robot = client.post("/v1/robots", json=campaign["robot"]).raise_for_status().json()["id"]
        readings = campaign["measurement_set"] | {"robot_id": robot}
        stored = client.post("/v1/measurement-sets", json=readings).raise_for_status().json()["id"]
    return f'{{"measurement_set_id": "{stored}", "method": "partial_pose"}}'.encode()


def _send(
    connection: HTTPConnection, method: str, path: str, body: bytes | None, headers: dict[str, str]
) -> bytes:
    connection.request(method, path, body, headers)
    response = connection.getresponse()
    answer = response.read()
    if response.status not in {200, 201}:
        raise RuntimeError(f"{method} {path} answered {response.status}: {answer[:500]!r}")
    return answer
