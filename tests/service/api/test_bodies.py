"""Bodies that mean harm, URDFs and forms among them: refused in few bytes; what forms import."""

import asyncio
import gzip
import json
import socket
import time
import tracemalloc

import httpx2
import pytest
from fastapi import HTTPException, Request
from fastapi.exceptions import RequestValidationError
from hypothesis import given
from hypothesis import strategies as st
from starlette.datastructures import UploadFile
from support.api import EITHER_DATABASE, post
from support.examples import examples
from support.hostile_urdfs import HOSTILE
from support.importing_samples import CAMPAIGN
from support.workbooks import table_of

from jointstiff.schemas.finding import Problem
from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.imports import ImportAnswer
from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.service.api.bodies import MAX_FILES, read_form, understood
from jointstiff.service.problems import MAX_PROBLEM_BYTES
from jointstiff.service.security.admission import SMALL_BYTES, refuse_structure
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import RequestError

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
    return client.post(path, content=content, headers={"Content-Type": "application/json"} | headers)


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


NOT_JSON = {"lone surrogate"}  # refused before it is a URDF


@pytest.mark.parametrize("name", sorted(HOSTILE.keys() - NOT_JSON))
def test_hostile_documents(client, name):
    text, where, _reason = HOSTILE[name]
    model = {"format": "urdf", "urdf": text, "base": "a", "flange": "b"}
    answer = send(client, "/v1/robots", json.dumps({"name": "r", "model": model}))
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


OPTIONS = {"encoders": "motor", "load_point": [0.0, 0.0, 120.0]}
FORM = {"Content-Type": "multipart/form-data; boundary=XyZ"}
HEAD = b'--XyZ\r\nContent-Disposition: form-data; name="files"; filename="a.csv"\r\n\r\n'


def send_form(client, *files, **options):
    fields = [("files", file) for file in files]
    return client.post("/v1/imports", files=[*fields, ("options", (None, json.dumps(options)))])


def answered(client, *files, **options):
    answer = send_form(client, *files, **options)
    assert answer.status_code == 200, answer.text
    return ImportAnswer.model_validate_json(answer.content)


def refused(answer, *statuses):
    assert answer.status_code in statuses, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert len(answer.content) <= MAX_PROBLEM_BYTES
    problem = Problem.model_validate_json(answer.content)
    assert problem.status == answer.status_code
    return problem


class TestAnswers:
    def test_nothing_is_stored(self, client):
        before = client.get("/v1/measurement-sets").json()
        answered(client, ("a.csv", CAMPAIGN.encode()), **OPTIONS)
        assert client.get("/v1/measurement-sets").json() == before

    def test_mistakes_are_found_before_anything_is_stored(self, client):
        campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)
        robot = client.post("/v1/robots", json=campaign["robot"]).json()["id"]
        sent = campaign["measurement_set"]
        options = {"encoders": "motor", "load_point": sent["load_point"], "robot_id": robot}
        table = table_of(campaign)
        swapped = table.replace(b"unloaded", b"UN").replace(b"loaded", b"unloaded").replace(b"UN", b"loaded")
        assert answered(client, ("a.csv", table), **options).findings == []
        found = answered(client, ("a.csv", swapped), **options)
        assert "force_sign_suspect" in {finding.code for finding in found.findings}
        posted = found.measurement_set.model_dump(mode="json", exclude_none=True) | {"robot_id": robot}
        stored = client.post("/v1/measurement-sets", json=posted).json()
        assert stored["warnings"] == [finding.model_dump(mode="json") for finding in found.findings]
        fewer = b"\n".join(
            b";".join(line.split(b";")[:6] + line.split(b";")[7:]) for line in table.split(b"\n")
        )
        problem = refused(send_form(client, ("a.csv", fewer), **options), 422)
        assert "do not fit the robot" in problem.detail
        assert refused(send_form(client, ("a.csv", table), **options | {"robot_id": "none"}), 404)

    def test_fields(self, client):
        def post(*form):
            return client.post("/v1/imports", files=list(form))

        file = ("files", ("a.csv", b"1"))
        assert refused(post(("options", (None, b"{}"))), 422).where == "files"
        assert "'other'" in refused(post(file, ("other", (None, b"1"))), 422).detail
        assert refused(post(file, *[("options", (None, b"{}"))] * 2), 422).where == "options"
        assert refused(post(("files", (None, b"1"))), 422).where == "files"
        assert refused(post(("files", ("a" * 201, b"1"))), 422).where == "files"
        assert refused(post(file, file), 422).detail == "two files have this name"
        refused(post(file, ("options", (None, b" " * 70_000))), 413)


FORMS = {
    "empty": b"",
    "another boundary": HEAD.replace(b"XyZ", b"abc") + b"1\r\n--abc--\r\n",
    "no end": HEAD + CAMPAIGN.encode(),
    "cut short": (HEAD + CAMPAIGN.encode() + b"\r\n--XyZ--")[:-3],
    "thousands of parts": (HEAD + b"\r\n") * 20_000 + b"--XyZ--",
    "boundaries only": b"--XyZ\r\n" * 500_000 + b"--XyZ--",
    "almost boundaries": HEAD + b"\r\n--Xy" * 1_000_000 + b"\r\n--XyZ--",
    "a megabyte of headers": HEAD[:-2] + b"X-A: b\r\n" * 150_000 + b"\r\n1\r\n--XyZ--",
    "one long header": HEAD.replace(b"a.csv", b"a" * 1_000_000) + b"1\r\n--XyZ--",
    "backslashes": HEAD.replace(b"a.csv", b"\\" * 3_999) + b"1\r\n--XyZ--",
    "headers in latin-1": HEAD.replace(b"a.csv", b"\xe9.csv") + b"1\r\n--XyZ--",
    "nul in a name": HEAD.replace(b"a.csv", b"a\x00.csv") + b"1\r\n--XyZ--",
    "markup in a name": HEAD.replace(b"a.csv", b"<script>\x07") + b"1\r\n--XyZ--",
    "base64": HEAD[:-2] + b"Content-Transfer-Encoding: base64\r\n\r\nMTsy\r\n--XyZ--",
    "another charset": HEAD[:-2] + b"Content-Type: text/csv; charset=utf-7\r\n\r\n+AGE-\r\n--XyZ--",
    "a form in a form": HEAD + HEAD.replace(b"XyZ", b"abc") + b"1\r\n--abc--\r\n--XyZ--",
    "gzip": gzip.compress(HEAD + b"1\r\n--XyZ--"),
}


class TestHostileForms:
    @pytest.mark.parametrize("name", FORMS)
    def test_refused(self, client, name):
        answer = client.post("/v1/imports", content=FORMS[name], headers=FORM)
        refused(answer, 413, 422)
        assert "\x07" not in answer.text
        assert client.get("/health").is_success

    def test_too_large(self, client):
        problem = refused(send_form(client, ("a.csv", b"1;2\n" * (2 << 20))), 413)
        assert "8192 KiB" in problem.detail

    def test_a_body_without_end_is_cut_off(self, service):
        """Chunked, so that no length is declared; the answer comes although the body never ends."""
        host, port = service.url.removeprefix("http://").split(":")
        chunk = b"x" * 65_536
        with socket.create_connection((host, int(port)), timeout=20) as connection:
            connection.sendall(
                b"POST /v1/imports HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n"
                b"Content-Type: multipart/form-data; boundary=XyZ\r\n\r\n"
            )
            connection.sendall(b"%x\r\n%s\r\n" % (len(HEAD), HEAD))
            for _ in range((8 << 20) // len(chunk) + 1):
                connection.sendall(b"%x\r\n%s\r\n" % (len(chunk), chunk))
            assert connection.recv(64).startswith(b"HTTP/1.1 413 ")


TYPE = "multipart/form-data; boundary=XyZ"
PART = b'--XyZ\r\nContent-Disposition: form-data; name="files"; filename="a.csv"\r\n\r\n1;2\r\n'
END = b"--XyZ--\r\n"


def read(content_type, body):
    """Names, file names and contents of a form that arrives in chunks of a few bytes."""
    chunks = [body[i : i + 1000] for i in range(0, len(body), 1000)]

    async def receive():
        chunk = chunks.pop(0) if chunks else b""
        return {"type": "http.request", "body": chunk, "more_body": bool(chunks)}

    async def fields():
        headers = [(b"content-type", content_type.encode("latin-1", "replace"))]
        form = await read_form(Request({"type": "http", "headers": headers}, receive))
        fields = [
            (name, value.filename, await value.read())
            if isinstance(value, UploadFile)
            else (name, None, value)
            for name, value in form.multi_items()
        ]
        await form.close()
        return fields

    return asyncio.run(fields())


names = st.text(
    st.characters(codec="utf-8", exclude_categories=["C"], exclude_characters='/\\"'), min_size=1, max_size=40
)


@given(st.lists(st.tuples(names, st.binary(max_size=3000)), max_size=5))
@examples(150)
def test_what_an_http_library_writes_comes_back(files):
    fields = [("files", file) for file in files] + [("options", (None, b"{}"))]
    request = httpx2.Request("POST", "http://x/", files=fields)
    sent = [*(("files", name, content) for name, content in files), ("options", None, "{}")]
    assert read(request.headers["content-type"], request.read()) == sent


@given(st.binary(max_size=400), st.integers(0, 200), st.integers(0, 200))
@examples(300)
def test_damaged_forms_are_read_or_refused(noise, start, length):
    whole = PART + PART + END
    damaged = whole[:start] + noise + whole[start + length :]
    try:
        fields = read(TYPE, damaged)
    except (RequestError, HTTPException):
        return
    assert all(name in {"files", "options"} for name, _, _ in fields)


@given(st.text(max_size=60))
@examples(200)
def test_any_content_type(text):
    for content_type in (text, f"multipart/form-data;{text}", f"multipart/form-data; boundary={text}"):
        try:
            read(content_type, PART + END)
        except (RequestError, HTTPException):
            continue


def test_options_may_come_as_a_file():
    options = PART.replace(b'"files"', b'"options"')
    assert read(TYPE, options + END) == [("options", None, "1;2")]
    with pytest.raises(RequestError, match="UTF-8"):
        read(TYPE, options.replace(b"1;2", b"\xff") + END)


@pytest.mark.parametrize("boundary", ["x" * 257, None])
def test_boundaries(boundary):
    content_type = "multipart/form-data" + ("" if boundary is None else f"; boundary={boundary}")
    with pytest.raises(RequestError, match=r"boundary|Invalid"):
        read(content_type, PART + END)


def test_limits():
    assert len(read(TYPE, PART * MAX_FILES + END)) == MAX_FILES
    text = PART.replace(b'"files"; filename="a.csv"', b'"options"')
    for body in (PART * 50_000, text * 20, text.replace(b"1;2", b" " * (SMALL_BYTES + 1))):
        with pytest.raises(HTTPException) as caught:
            read(TYPE, body + END)
        assert caught.value.status_code == 413
