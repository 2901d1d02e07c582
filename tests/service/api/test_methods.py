"""Methods beside those of the API's description: HEAD, OPTIONS, and Allow where a method is refused."""

from __future__ import annotations

import re

import httpx2
import pytest
from support.api import CANCEL, job_at

from jointstiff.simulator import default_arm, simulate_campaign

PAGES = ("/", "/v1", "/openapi.json", "/favicon.svg", "/assets/nothing")


@pytest.fixture(scope="session")
def addresses(openapi) -> dict[str, set[str]]:
    """The methods of each address, as described; those of the page beside them."""
    described = {
        re.sub(r"\{\w+\}", "nothing", path): {name.upper() for name in methods}
        for path, methods in openapi["paths"].items()
    }
    taken = described | {path: {"GET"} for path in PAGES}
    return {path: taken[path] | {"OPTIONS", *(["HEAD"] if "GET" in taken[path] else [])} for path in taken}


def allowed(answer: httpx2.Response) -> set[str]:
    return set(answer.headers["allow"].split(", "))


def test_options(client, addresses):
    for address, methods in addresses.items():
        answer = client.options(address)
        assert (answer.status_code, answer.content) == (204, b""), address
        assert allowed(answer) == methods, address


def test_head_is_get_without_content(client, addresses):
    for address, methods in addresses.items():
        head = client.head(address)
        assert head.content == b"", address
        if "GET" not in methods:
            assert head.status_code == 405, address
            assert allowed(head) == methods, address
            continue
        get = client.get(address)
        assert head.status_code == get.status_code, address
        assert lasting(head, address) == lasting(get, address), address


def lasting(answer: httpx2.Response, address: str) -> dict[str, str]:
    """Return the headers that two requests share; /health may have another length a moment later."""
    passing = {"date", "x-request-id"} | ({"content-length"} if address == "/health" else set())
    return {name: value for name, value in answer.headers.items() if name not in passing}


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
