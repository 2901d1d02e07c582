"""A run over HTTP, posted, computed, stored and answered, beside one cvxpy solve in process."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from http.client import HTTPConnection
from itertools import count
from pathlib import Path

import httpx2

from benchmarks.campaigns import LARGE_NOISE, Campaign, default_settings, small_campaign
from benchmarks.performance.peers import cvxpy_clarabel, stacked_rows
from benchmarks.report import Figure, Section, times_table
from benchmarks.services import Service, ServiceError, post_document
from benchmarks.timing import Times, interleaved
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.rows import Rows

__all__ = ["run"]

POST = "POST /v1/runs, keep-alive (http.client)"
SLOW_CLIENT = "POST /v1/runs, keep-alive (httpx2)"
HEALTH = "GET /health (http.client)"
NAIVE = "rows → fresh cvxpy + Clarabel, in process"
_HEADERS = {"Content-Type": "application/json"}


def run(*, quick: bool) -> list[Section]:
    """Compare a run over HTTP with cvxpy alone. Each POST is a new run: there is no Idempotency-Key."""
    cases = {"no active bound": small_campaign(), "bounds active": _campaign_at_bounds()}
    return [_section(name, campaign, 3 if quick else 200) for name, campaign in cases.items()]


def _section(case: str, campaign: Campaign, rounds: int) -> Section:
    times = _times(campaign, rounds)
    size = len(times.results[POST])
    columns, rows = times_table(times, POST)
    what = f"POST of a run, 19 configurations, {case}: time / fresh cvxpy solve in process"
    return Section(
        title=f"POST of a run, 19 configurations × 3 targets, {case}: computed, stored in SQLite, answered",
        columns=columns,
        rows=rows,
        figures=(Figure(what, times.ratio(POST, NAIVE), "at most", 1.0, "×"),),
        notes=(
            f"the answer has {size / 1000:.0f} kB, with all residuals and the provenance",
            "a health check shows what any request costs; the database is a file, synced at each commit",
        ),
        data={"seconds": times.seconds, "answer_bytes": size},
    )


def _campaign_at_bounds() -> Campaign:
    """The first campaign, of noise that large, that has a compliance at zero."""
    for seed in count():
        campaign = small_campaign(sigma=LARGE_NOISE, seed=seed)
        estimate = identify(Rows(campaign.robot, campaign.measurements), default_settings(campaign.robot))
        if (estimate.compliance == 0.0).any():
            return campaign
    raise AssertionError("unreachable")


def _times(campaign: Campaign, rounds: int) -> Times:
    A, d = stacked_rows(campaign.robot, campaign.measurements)
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="jointstiff-benchmark-"))
        service = stack.enter_context(Service(f"sqlite:///{Path(folder) / 'jointstiff.db'}", 1))
        client = stack.enter_context(httpx2.Client(base_url=service.url))
        set_id = post_document(client, campaign.document)
        body = json.dumps({"measurement_set_id": set_id, "method": "partial_pose"}).encode()
        candidates: dict[str, Callable[[], object]] = {
            POST: partial(_post, _connection(stack, service.port), body),
            NAIVE: partial(cvxpy_clarabel, A, d),
            SLOW_CLIENT: partial(_httpx2_post, client, body),
            HEALTH: partial(_get, _connection(stack, service.port), "/health"),
        }
        return interleaved(candidates, rounds=rounds, warm_up=5)


def _connection(stack: ExitStack, port: int) -> HTTPConnection:
    connection = HTTPConnection("127.0.0.1", port, timeout=60.0)
    stack.callback(connection.close)
    return connection


def _post(connection: HTTPConnection, body: bytes) -> bytes:
    connection.request("POST", "/v1/runs", body, _HEADERS)
    response = connection.getresponse()
    answer = response.read()
    if response.status != 201:
        raise ServiceError(f"POST of a run answered {response.status}: {answer[:500]!r}")
    return answer


def _httpx2_post(client: httpx2.Client, body: bytes) -> bytes:
    return client.post("/v1/runs", content=body, headers=_HEADERS).raise_for_status().content


def _get(connection: HTTPConnection, path: str) -> bytes:
    connection.request("GET", path)
    return connection.getresponse().read()
