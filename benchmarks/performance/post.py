"""A run over HTTP, posted, computed, stored and answered, beside one cvxpy solve in process."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from http.client import HTTPConnection
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx2

from benchmarks.campaigns import LARGE_NOISE, Campaign, default_settings, small_campaign
from benchmarks.performance.peers import cvxpy_clarabel, stacked_rows
from benchmarks.report import Figure, Section, times_table
from benchmarks.timing import Times, interleaved
from jointstiff.solver.estimation.identify import identify

__all__ = ["run"]

POST = "POST /v1/runs, keep-alive (http.client)"
SLOW_CLIENT = "POST /v1/runs, keep-alive (httpx2)"
HEALTH = "GET /health (http.client)"
NAIVE = "rows → fresh cvxpy + Clarabel, in process"
_HEADERS = {"Content-Type": "application/json"}


class ServerError(Exception):
    """The service did not start, or did not answer as it should."""


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
        estimate = identify(campaign.robot, campaign.measurements, default_settings(campaign.robot))
        if (estimate.compliance == 0.0).any():
            return campaign
    raise AssertionError("unreachable")


def _times(campaign: Campaign, rounds: int) -> Times:
    A, d = stacked_rows(campaign.robot, campaign.measurements)
    with ExitStack() as stack:
        address = stack.enter_context(_service())
        body = _prepare(address, campaign)
        candidates: dict[str, Callable[[], object]] = {
            POST: partial(_post, _connection(stack, address), "/v1/runs", body),
            NAIVE: partial(cvxpy_clarabel, A, d),
            SLOW_CLIENT: partial(_httpx2_post, stack.enter_context(httpx2.Client(base_url=address)), body),
            HEALTH: partial(_get, _connection(stack, address), "/health"),
        }
        return interleaved(candidates, rounds=rounds, warm_up=5)


@contextmanager
def _service() -> Iterator[str]:
    """A server process of our own on a new database; yields its address."""
    with tempfile.TemporaryDirectory(prefix="jointstiff-benchmark-") as folder:
        database = f"sqlite:///{Path(folder) / 'jointstiff.db'}"
        command = [sys.executable, "-m", "jointstiff", "serve", "--port", "0", "--database", database]
        environment = os.environ | {"PYTHONUNBUFFERED": "1"}
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
            try:
                yield _address(process)
            finally:
                process.terminate()


def _address(process: subprocess.Popen[str]) -> str:
    line = process.stdout.readline() if process.stdout is not None else ""
    found = re.search(r"http://[\w.]+:\d+", line)
    if found is None:
        raise ServerError(f"the service did not say its address: {line!r}")
    return found.group()


def _connection(stack: ExitStack, address: str) -> HTTPConnection:
    connection = HTTPConnection(urlsplit(address).netloc, timeout=60.0)
    stack.callback(connection.close)
    return connection


def _prepare(address: str, campaign: Campaign) -> bytes:
    """Post robot and readings; the body of the runs to come."""
    with ExitStack() as stack:
        connection = _connection(stack, address)
        robot = _posted(connection, "/v1/robots", campaign.document["robot"])
        readings = campaign.document["measurement_set"] | {"robot_id": robot["id"]}
        stored = _posted(connection, "/v1/measurement-sets", readings)
    return json.dumps({"measurement_set_id": stored["id"], "method": "partial_pose"}).encode()


def _posted(connection: HTTPConnection, path: str, document: dict[str, Any]) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(_post(connection, path, json.dumps(document).encode()))
    return answer


def _post(connection: HTTPConnection, path: str, body: bytes) -> bytes:
    connection.request("POST", path, body, _HEADERS)
    response = connection.getresponse()
    answer = response.read()
    if response.status != 201:
        raise ServerError(f"POST {path} answered {response.status}: {answer[:500]!r}")
    return answer


def _httpx2_post(client: httpx2.Client, body: bytes) -> bytes:
    return client.post("/v1/runs", content=body, headers=_HEADERS).raise_for_status().content


def _get(connection: HTTPConnection, path: str) -> bytes:
    connection.request("GET", path)
    return connection.getresponse().read()
