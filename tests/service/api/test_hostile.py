"""Bodies that mean harm, URDFs among them: refused by status and in few bytes, and the service stays up."""

import json
import socket
import time
import tracemalloc

import pytest
from fastapi import HTTPException
from fastapi.exceptions import RequestValidationError
from support.api import EITHER_DATABASE, post
from support.hostile_urdfs import HOSTILE

from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.service.api.bodies import understood
from jointstiff.service.problems import MAX_PROBLEM_BYTES
from jointstiff.service.security.admission import refuse_structure

JSON = {"Content-Type": "application/json"}
PATHS = ["/v1/robots", "/v1/measurement-sets", "/v1/runs"]

BODIES = {
    "empty": b"",
    "not json": b"{'a': 1}",
    "null": b"null",
    "number": b"1",
    "nested lists": b"[" * 100_000,
    "nested objects": b'{"a":' * 50_000,
    "balanced nesting": b"[" * 5_000 + b"]" * 5_000,
    "long integer": b"1" * 60_000,
    "long exponent": b"1e" + b"9" * 1_000,
    "not a number": b'{"name": NaN}',
    "invalid utf-8": b'{"name": "\xff\xfe"}',
    "lone surrogate": b'{"name": "\\ud800"}',
    "nul": b'{"name": "\\u0000"}',
    "byte order mark": b"\xef\xbb\xbf{}",
    "long key": b'{"' + b"k" * 60_000 + b'": 1}',
    "markup in key": b'{"<script>alert(1)</script>\\u0007": 1}',
    "many wrong members": b"{" + b",".join(b'"k%d":0' % i for i in range(5_000)) + b"}",
    "wide characters": ("{" + ",".join(f'"{i}{"漢" * 280}":0' for i in range(40)) + "}").encode(),
    "many wrong items": b'{"observations": [' + b"0," * 20_000 + b"0]}",
    "wrong items of a row": b'{"model": {"format": "dh", "rows": [' + b"{}," * 10_000 + b"{}]}}",
}


def send(client, path, content, **headers):
    return client.post(path, content=content, headers=JSON | headers)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("name", BODIES)
def test_bodies(client, path, name):
    answer = send(client, path, BODIES[name])
    assert 400 <= answer.status_code < 500
    assert answer.headers["content-type"] == "application/problem+json"
    assert len(answer.content) <= MAX_PROBLEM_BYTES
    problem = answer.json()
    assert problem["status"] == answer.status_code
    assert problem["detail"]
    assert "\x07" not in answer.text


@pytest.mark.parametrize(
    ("path", "limit"), [("/v1/robots", 4 << 20), ("/v1/measurement-sets", 8 << 20), ("/v1/runs", 64 << 10)]
)
def test_too_large(client, path, limit):
    answer = send(client, path, b'{"name": "' + b"a" * limit + b'"}')
    assert answer.status_code == 413
    assert "KiB" in answer.json()["detail"]
    assert answer.json()["remedy"] == "split it into several requests"


@pytest.mark.parametrize("filler", [b"{},", b"0,", b'"a":0,'])
def test_small_parts_without_end(client, filler):
    """A few bytes each in the body, a thousand times that in a parser: refused before it starts."""
    count = (7 << 20) // len(filler)
    body = b'{"observations": [' + filler * count + b"0]}"
    started = time.monotonic()
    assert send(client, "/v1/measurement-sets", body).status_code == 413
    assert client.get("/health").is_success
    assert time.monotonic() - started < 30  # a hang, not a benchmark


def members(count, start=0):
    return b"{" + b",".join(b'"k%d":0' % i for i in range(start, start + count)) + b"}"


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (members(299_000), MeasurementSetRequest),
        pytest.param(
            b'{"observations":[' + b",".join([members(3_900)] * 74) + b"]}",
            MeasurementSetRequest,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            b'{"poses":[' + b",".join([members(3_900)] * 74) + b"]}", GeometryRequest, marks=pytest.mark.slow
        ),
        pytest.param(
            b'{"sweeps":[' + b",".join([members(3_900)] * 74) + b"]}", GeometryRequest, marks=pytest.mark.slow
        ),
        (b'{"' + b'\\"' * 1_000_000 + b":" * 5_000, MeasurementSetRequest),
        (b'{"":"' + b'\\":' * 250_000, MeasurementSetRequest),
    ],
    ids=["keys", "observations", "poses", "sweeps", "string without end", "escaped quotes"],
)
def test_unknown_keys_cost_little_memory_and_time(body, message):
    """A fault costs a validator 1 kB: hundreds of thousands of unknown keys would take 300 MB."""
    tracemalloc.start()
    started = time.monotonic()
    try:
        with pytest.raises((HTTPException, RequestValidationError)):
            understood(message, body)
        assert tracemalloc.get_traced_memory()[1] < 64 << 20
    finally:
        tracemalloc.stop()
    assert time.monotonic() - started < 10


def test_keys_of_strings_are_no_keys():
    """Text that looks like keys, in values of strings, counts for nothing."""
    refuse_structure(b'{"name": "' + b"\\".join(b'\\"k%d\\": ' % i for i in range(10_000)) + b'"}')
    refuse_structure(json.dumps({"text": ["a", {"b": [f'"k{i}": "' for i in range(10_000)]}]}).encode())
    with pytest.raises(HTTPException, match="4000 different keys"):
        refuse_structure(json.dumps({"a": {f'k"{i}': "" for i in range(4_000)}}, indent=2).encode())


@pytest.mark.parametrize("path", ["/v1/runs", "/v1/robots", "/v1/imports"])
def test_a_body_that_is_declared_too_large_is_not_read(service, path):
    host, port = service.url.removeprefix("http://").split(":")
    kind = "multipart/form-data; boundary=x" if path.endswith("imports") else "application/json"
    with socket.create_connection((host, int(port)), timeout=20) as connection:
        connection.sendall(
            f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {kind}\r\n"
            "Content-Length: 999999999\r\n\r\n".encode()
        )
        assert connection.recv(64).startswith(b"HTTP/1.1 413 ")


@pytest.mark.parametrize("media_type", ["text/plain", "application/xml", "multipart/form-data", ""])
def test_only_json(client, media_type):
    answer = client.post("/v1/runs", content=b"{}", headers={"Content-Type": media_type})
    assert answer.status_code == 415
    assert "application/json" in answer.json()["detail"]


@pytest.mark.parametrize("key", ["x" * 256, ""])
def test_bad_idempotency_keys(client, key):
    assert send(client, "/v1/runs", b"{}", **{"Idempotency-Key": key}).status_code == 422


@pytest.mark.parametrize(
    "identifier", ["%00", "..%2f..%2fetc", "a" * 2_000, "%F0%9F%92%A9", "'; DROP TABLE run"]
)
@pytest.mark.parametrize("path", PATHS)
@EITHER_DATABASE
def test_identifiers(client, path, identifier):
    answer = client.get(f"{path}/{identifier}")
    assert answer.status_code in {404, 422}
    assert len(answer.content) <= MAX_PROBLEM_BYTES


@EITHER_DATABASE
def test_numbers_at_the_edge_of_what_is_allowed(client):
    """Every field within its limits, and none sensible: refused or failed, never a crash."""
    robot = {
        "name": "edge",
        "model": {
            "format": "dh",
            "convention": "standard",
            "rows": [{"a": 1e-300, "alpha": 0.0, "d": 100.0, "theta": 6.0}] * 32,
        },
    }
    created = post(client, "/v1/robots", robot)
    for force, sigma, shift in [
        (1e12, 1e-9, 1e12),
        (1e-300, 1e3, 1e-300),
        (-1e12, 1e-9, 0.0),
        (1e-160, 1e-9, 1e-3),
    ]:
        document = {
            "robot_id": created["id"],
            "name": "edge",
            "units": {"length": "m", "angle": "rad", "force": "kN"},
            "encoders": "motor",
            "noise": {"sigma": sigma},
            "load_point": [1e12, -1e12, 1e12],
            "observations": [
                {
                    "label": str(i),
                    "joints": [1e12 / (i + 1)] * 32,
                    "force": [force, -force, force],
                    "moment": [force, force, force],
                    "readings": [
                        {"target": t, "unloaded": [k * 1e12, i, k], "loaded": [k * 1e12, i + shift, k]}
                        for k, t in enumerate(("P10", "P11", "P12"))
                    ],
                }
                for i in range(3)
            ],
        }
        stored = client.post("/v1/measurement-sets", json=document)
        assert stored.status_code in {201, 422}, stored.text
        if stored.status_code == 422:
            continue
        for method in ("complete_pose", "partial_pose", "decoupled_partial_pose"):
            run = client.post("/v1/runs", json={"measurement_set_id": stored.json()["id"], "method": method})
            assert run.status_code in {201, 422}, run.text
            document = json.loads(run.text, parse_constant=pytest.fail)
            assert "unexpectedly" not in run.text, document


def posted_urdf(client, text):
    model = {"format": "urdf", "urdf": text, "base": "a", "flange": "b"}
    return send(client, "/v1/robots", json.dumps({"name": "r", "model": model}))


NOT_JSON = {"lone surrogate"}  # refused before it is a URDF


@pytest.mark.parametrize("name", sorted(HOSTILE.keys() - NOT_JSON))
def test_hostile_documents(client, name):
    text, where, _reason = HOSTILE[name]
    answer = posted_urdf(client, text)
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


@pytest.mark.parametrize("length", [10, 100, 300, 900])
def test_a_body_with_many_faults_has_as_many_named_as_fit(client, length):
    """Twenty, or as many as the limit allows; one more would not fit."""
    fields = {f"{number:02d}" + "é" * length: 1 for number in range(30)}
    answer = send(client, "/v1/robots", json.dumps(fields).encode())
    problem = answer.json()
    assert len(answer.content) <= MAX_PROBLEM_BYTES
    size = max(len(json.dumps(each, ensure_ascii=False).encode()) for each in problem["errors"])
    assert len(problem["errors"]) == 20 or len(answer.content) + 2 * size > MAX_PROBLEM_BYTES
