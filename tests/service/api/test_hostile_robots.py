"""URDFs that mean harm, posted as robots: refused with their place, in the process of the service."""

from __future__ import annotations

import json

import pytest
from support.hostile_urdfs import HOSTILE, LARGE

from jointstiff.service.problems import MAX_PROBLEM_BYTES


def post(client, text):
    model = {"format": "urdf", "urdf": text, "base": "a", "flange": "b"}
    body = json.dumps({"name": "r", "model": model})
    return client.post("/v1/robots", content=body, headers={"Content-Type": "application/json"})


NOT_JSON = {"lone surrogate"}  # refused before it is a URDF


@pytest.mark.parametrize("name", sorted(HOSTILE.keys() - NOT_JSON))
def test_hostile_documents(client, name):
    text, where, _reason = HOSTILE[name]
    answer = post(client, text)
    if len(answer.request.content) > 4 << 20:
        assert answer.status_code == 413
        return
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert len(answer.content) <= MAX_PROBLEM_BYTES
    problem = answer.json()
    assert problem["where"] in {"model.urdf", f"model.urdf: {where}"}
    assert problem["detail"]
    assert problem["remedy"]


@pytest.mark.parametrize("name", LARGE)
def test_large_documents(client, name):
    answer = post(client, LARGE[name])
    assert answer.status_code in {413, 422}
    assert answer.json()["detail"]
    assert client.get("/health").is_success
