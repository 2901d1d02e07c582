"""Many posts at once: none lost, none twice, and nearly as many a second as of one client."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPConnection
from typing import Final

import httpx2

from benchmarks.report import Figure, Section
from benchmarks.services import Service, post_campaign

__all__ = ["posts_at_once", "queue_full"]

_JSON: Final = {"Content-Type": "application/json"}
_QUEUED: Final = 1_000
"""Long runs that may wait."""


def posts_at_once(kind: str, database: str, count: int) -> Section:
    """Post quick runs by 16 clients, and by one in a loop."""
    with Service(database, 0) as service, httpx2.Client(base_url=service.url, timeout=120) as client:
        body = json.dumps({"measurement_set_id": post_campaign(client, 19)}).encode()
        before = _listed(client)
        alone = min(
            _posted(service.port, body, [f"alone{i}-{n}" for n in range(count // 10)])[1] for i in range(2)
        )
        began = time.monotonic()
        keys = [f"k{n}" for n in range(count)]
        with ThreadPoolExecutor(16) as pool:
            shares = [keys[i::16] for i in range(16)]
            answers = [
                pair
                for pairs, _ in pool.map(lambda some: _posted(service.port, body, some), shares)
                for pair in pairs
            ]
        seconds = time.monotonic() - began
        created = [identifier for status, identifier in answers if status == 201]
        stored = _listed(client) - before
    lost, twice = len(set(created) - stored), len(created) - len(set(created))
    rate, loop = count / seconds, (count // 10) / alone
    return Section(
        title=f"{kind}: {count:,} posts of runs by 16 clients",
        columns=("rate", "one client in a loop", "created", "other answers"),
        rows=((f"{rate:.0f}/s", f"{loop:.0f}/s", f"{len(created)}", f"{count - len(created)}"),),
        figures=(
            Figure(f"{kind}, posts at once: rate / that of one client", rate / loop, "at least", 0.8, "×"),
            Figure.none(f"{kind}, posts at once: acknowledged and not stored", lost),
            Figure.none(f"{kind}, posts at once: acknowledged twice", twice),
        ),
    )


def queue_full(databases: Mapping[str, str], count: int) -> Section:
    """Post long runs that nobody carries out, more than may wait."""
    found = {}
    for kind, database in databases.items():
        with Service(database, 0) as service, httpx2.Client(base_url=service.url, timeout=120) as client:
            body = {"measurement_set_id": post_campaign(client, 19), "resampling": {"size": 10}}
            posts = (client.post("/v1/runs?wait=0", json=body) for _ in range(count + 20))
            found[kind] = Counter((post.status_code, "Retry-After" in post.headers) for post in posts)
    expected = {(202, False): min(count + 20, _QUEUED), (429, True): max(0, count + 20 - _QUEUED)}
    return Section(
        title=f"{count + 20:,} posts of long runs, of which {_QUEUED:,} may wait",
        columns=("database", "202", "429"),
        rows=tuple((kind, f"{c[202, False]}", f"{c[429, True]}") for kind, c in found.items()),
        figures=tuple(
            Figure.none(f"{kind}: answers that are not 202, then 429", int(c != expected))
            for kind, c in found.items()
        ),
    )


def _posted(port: int, body: bytes, keys: Sequence[str]) -> tuple[list[tuple[int, str]], float]:
    connection, found, began = HTTPConnection("localhost", port, timeout=120), [], time.monotonic()
    for key in keys:
        connection.request("POST", "/v1/runs", body, _JSON | {"Idempotency-Key": key})
        answer = connection.getresponse()
        found.append((answer.status, str(json.loads(answer.read()).get("id"))))
    connection.close()
    return found, time.monotonic() - began


def _listed(client: httpx2.Client) -> set[str]:
    found, cursor = set(), None
    while True:
        page = client.get("/v1/jobs", params={"limit": 100} | ({"cursor": cursor} if cursor else {})).json()
        found |= {item["id"] for item in page["items"]}
        cursor = page["next"]
        if cursor is None:
            return found
