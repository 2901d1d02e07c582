"""Answers of the API in a line, and what is stored."""

import re
from typing import Any

TITLES = {
    "invalid-request": {
        "The request does not match the API's schema",
        "The request cannot be carried out",
    },
    "invalid-measurement-set": {"The measurement set cannot be used"},
    "invalid-robot": {"The robot's description cannot be used"},
    "invalid-file": {"The files were not understood", "Moves cannot be corrected"},
    "unsupported-method": {"The readings cannot support this method"},
    "not-found": {"The resource does not exist", "Not Found"},
    "deleted": {"The resource was deleted"},
    "method-not-allowed": {"Method Not Allowed"},
    "invalid-cursor": {"Invalid pagination cursor"},
    "idempotency-conflict": {"The idempotency key was used with another body"},
    "unsupported-media-type": {"Unsupported Media Type"},
    "request-entity-too-large": {"Request Entity Too Large"},
    "content-too-large": {"Content Too Large"},
    "no-valid-key": {"A valid key is needed"},
    "role": {"The role does not allow this"},
}
"""The titles that people read, by the kind of problem that programs read."""


def counts(client: Any) -> list[int]:
    """Return how many robots, measurement sets and jobs are stored."""
    return [client.get(f"/v1/{name}").json()["total"] for name in ("robots", "measurement-sets", "jobs")]


def outcome_of(answer: Any) -> str:
    """Return status and verdict of a success; of a refusal status, kind, place, reason and remedy."""
    body = answer.json()
    if answer.status_code < 400:
        assessment = (body.get("result") or body).get("assessment")
        return " ".join([str(answer.status_code), *([assessment["verdict"]] if assessment else [])])
    assert answer.headers["content-type"] == "application/problem+json"
    assert body["status"] == answer.status_code
    kind = body["type"].removeprefix("urn:jointstiff:problem:")
    assert body["title"] in TITLES[kind]
    reason = body["detail"]
    if (faults := body["errors"]) and re.match(r"\d+ faults?; first: ", reason):
        count, first = reason.partition(";")[0], faults[0]
        assert count == ("1 fault" if len(faults) == 1 else count)
        assert reason == f"{count}; first: {first['where']}: {first['reason']}"
        assert body["where"] == first["where"]
        assert first["remedy"] in {None, body["remedy"]}
        reason = first["reason"] if count == "1 fault" else f"{count}: {first['reason']}"
    return f"{answer.status_code} {kind} | {body['where'] or '-'} | {reason} | {body['remedy'] or '-'}"
