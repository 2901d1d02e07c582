"""The API as a client sees it: its description and contract, refusals, kinematics, and the page."""

import asyncio
import math
import re
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from uuid import uuid4

import httpx2
import pyarrow
import pytest
from fastapi import FastAPI
from hypothesis import HealthCheck, Phase
from support.api import CANCEL, EITHER_DATABASE, job_at, post
from support.examples import examples, is_full

from jointstiff.service.api.page import install_page
from jointstiff.simulator import default_arm, simulate_campaign


def test_health_counts_the_workers(client_of_workers):
    health = client_of_workers.get("/health").json()
    assert health["status"] == "ok"
    assert health["database"] in {"sqlite", "postgresql"}
    assert health["workers"] in {0, 1}
    deadline = time.monotonic() + 60  # the service's own is heard of when it has read its libraries
    while client_of_workers.get("/health").json()["workers"] == 0:
        assert time.monotonic() < deadline
        time.sleep(0.1)


TWO_LINKS = {
    "name": "two links",
    "model": {
        "format": "dh",
        "convention": "standard",
        "rows": [
            {"a": 1.0, "alpha": 0.0, "d": 0.5, "theta": 0.0},
            {"a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0},
        ],
    },
}


def test_two_links_stand_where_trigonometry_puts_them(client):
    first, second = 0.3, 0.4
    (posture,) = client.post("/v1/kinematics", json={"robot": TWO_LINKS, "joints": [[first, second]]}).json()
    elbow = (math.cos(first), math.sin(first), 0.5)
    tip = (elbow[0] + 0.5 * math.cos(first + second), elbow[1] + 0.5 * math.sin(first + second), 0.5)
    # An axis is a line: the origin of joint 1 may lie anywhere along it.
    assert posture["joint_origins"][0][:2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert posture["joint_origins"][1][:2] == pytest.approx(elbow[:2], abs=1e-12)
    assert posture["joint_axes"] == [[0, 0, 1], [0, 0, 1]]
    assert posture["flange_origin"] == pytest.approx(tip, abs=1e-12)
    heading = (math.cos(first + second), math.sin(first + second), 0.0)
    assert posture["flange_axes"][0] == pytest.approx(heading, abs=1e-12)


def test_head_of_a_stream_ends(client):
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=5)
    resampling = {"size": 5, "repetitions": 100_000, "seed": 1}
    asked = campaign | {"run": {"resampling": resampling}}
    address = client.post("/v1/campaigns?wait=0", json=asked).headers["location"]
    head = client.head(f"{job_at(address)}/events")
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-type"].startswith("text/event-stream")
    assert client.get("/health").status_code == 200
    assert client.patch(job_at(address), json=CANCEL).status_code == 200


PARTS = 24
"""Each part takes every 24th operation; its cases are made when it runs."""
STRIDE = 5
"""By day every fifth case at the bounds of fields is sent, of thousands; each night all of them."""


@pytest.mark.process
@pytest.mark.parametrize(
    ("part", "service"),
    [
        pytest.param(part, database, marks=pytest.mark.slow if database == "postgresql" else ())
        for database in ("postgresql", "sqlite")
        for part in range(PARTS)
    ],
    indirect=["service"],
)
def test_the_service_keeps_its_contract(part, service, openapi):
    import requests
    import schemathesis
    from schemathesis.checks import not_a_server_error
    from schemathesis.generation.meta import TestPhase
    from schemathesis.pytest.lazy import get_all_tests
    from schemathesis.specs.openapi import checks

    promised = [
        not_a_server_error,
        checks.status_code_conformance,
        checks.content_type_conformance,
        checks.response_schema_conformance,
    ]

    session = requests.Session()
    session.trust_env = False  # a look at all variables for each case

    bounds, stride = count(), 1 if is_full() else STRIDE

    @examples(60, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck))
    def keeps(case):
        if case.meta.phase.name is TestPhase.COVERAGE and next(bounds) % stride:
            return
        case.call_and_validate(base_url=service.url, session=session, checks=promised, timeout=60)

    schema = schemathesis.openapi.from_dict(openapi)
    labels = [each.ok().label for each in schema.get_all_operations()][part::PARTS]
    for each in get_all_tests(
        schema=schema.include(name=labels), test_func=keeps, settings=None, given_kwargs={}
    ):
        each.ok()[1]()
    session.close()


def test_page_has_a_strict_policy_and_no_inline_code(client):
    answer = client.get("/")
    assert answer.status_code == 200, answer.text
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy
    assert not re.search(r"<script(?![^>]*\bsrc=)|<style|\bstyle=|\bon\w+=", answer.text)
    assert not re.search(r"(src|href)=\"(https?:)?//", answer.text)


def test_files_of_the_page_are_served_for_ever_and_are_not_sniffed(client):
    page = client.get("/").text
    files = re.findall(r"(?:src|href)=\"\./(assets/[^\"]+)\"", page)
    assert files
    for file in files:
        answer = client.get(f"/{file}")
        assert answer.status_code == 200
        assert "immutable" in answer.headers["cache-control"]
        assert answer.headers["x-content-type-options"] == "nosniff"


def test_a_page_and_documentation_that_were_not_built_say_so(tmp_path):
    app = FastAPI()
    install_page(app, tmp_path, tmp_path / "docs")

    async def ask(path):
        async with httpx2.AsyncClient(transport=httpx2.ASGITransport(app), base_url="http://page") as client:
            return await client.get(path)

    with ThreadPoolExecutor(1) as own_loop:  # the browser's tests leave one running in this thread
        page, docs = (own_loop.submit(lambda p=p: asyncio.run(ask(p))).result() for p in ("/", "/docs/"))
    assert page.status_code == 503
    assert "scripts/setup" in page.text
    assert docs.status_code == 404
    assert "scripts/docs" in docs.text
    assert 'href="../openapi.json"' in docs.text


def test_what_is_built_while_the_service_runs_is_served(tmp_path):
    app = FastAPI()
    install_page(app, tmp_path, tmp_path / "docs")
    pages = ("/docs/", "/docs/reference/http.html", "/assets/page.js")

    async def ask():
        async with httpx2.AsyncClient(transport=httpx2.ASGITransport(app), base_url="http://page") as client:
            return [await client.get(path) for path in pages]

    with ThreadPoolExecutor(1) as own_loop:
        before = own_loop.submit(lambda: asyncio.run(ask())).result()
        (tmp_path / "docs" / "reference").mkdir(parents=True)
        (tmp_path / "assets").mkdir()
        for path in ("docs/index.html", "docs/reference/http.html", "assets/page.js"):
            (tmp_path / path).write_text("built")
        after = own_loop.submit(lambda: asyncio.run(ask())).result()
    assert [answer.status_code for answer in before] == [404, 404, 404]
    assert all("scripts/docs" in answer.text for answer in before[:2])
    assert 'href="../../openapi.json"' in before[1].text
    assert [(answer.status_code, answer.text) for answer in after] == [(200, "built")] * 3


@pytest.mark.parametrize(
    ("accepted", "coding"),
    [("gzip, deflate", "gzip"), ("gzip, deflate, br, zstd", "br"), ("zstd", None), ("", None)],
)
def test_files_of_the_page_are_sent_in_the_smallest_form_that_a_browser_accepts(client, accepted, coding):
    file = re.findall(r"src=\"\./(assets/[^\"]+)\"", client.get("/").text)[0]
    with client.stream("GET", f"/{file}", headers={"Accept-Encoding": accepted}) as answer:
        assert answer.headers.get("content-encoding") == coding
        assert "javascript" in answer.headers["content-type"]
        assert answer.headers["vary"] == "Accept-Encoding"
        sent = b"".join(answer.iter_raw())
    plain = client.get(f"/{file}", headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers
    if coding is None:
        assert sent == plain.content
    else:
        codec = {"br": "brotli"}.get(coding, coding)
        assert pyarrow.decompress(sent, len(plain.content), codec, asbytes=True) == plain.content
        assert len(sent) < len(plain.content) / 2


@EITHER_DATABASE
@pytest.mark.parametrize("collection", ["robots", "measurement-sets"])
def test_the_same_key_gives_one_resource(client, collection):
    campaign, key = (
        simulate_campaign(default_arm(), configurations=8, seed=11),
        {"Idempotency-Key": uuid4().hex},
    )
    body = campaign["robot"]
    if collection == "measurement-sets":
        body = campaign["measurement_set"] | {"robot_id": post(client, "/v1/robots", body)["id"]}
    first = post(client, f"/v1/{collection}", body, **key)
    assert post(client, f"/v1/{collection}", body, **key) == first
    problem = post(client, f"/v1/{collection}", body | {"name": "x"}, 422, **key)
    assert problem["type"].endswith("idempotency-conflict")
