"""Bodies that mean harm, URDFs and forms among them: refused in few bytes; what forms import."""

import asyncio
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
from support.api import EITHER_DATABASE
from support.examples import examples

from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.service.api.bodies import parse_body, read_form
from jointstiff.service.problems import MAX_PROBLEM_BYTES
from jointstiff.solver.errors import RequestError

PATHS = ["/v1/robots", "/v1/measurement-sets", "/v1/runs"]


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
        with pytest.raises((HTTPException, RequestValidationError, RequestError)):
            parse_body(message, body)
        assert tracemalloc.get_traced_memory()[1] < 64 << 20
    finally:
        tracemalloc.stop()
    assert time.monotonic() - started < 10


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


@pytest.mark.parametrize(
    "identifier", ["%00", "..%2f..%2fetc", "a" * 2_000, "%F0%9F%92%A9", "'; DROP TABLE run"]
)
@pytest.mark.parametrize("path", PATHS)
@EITHER_DATABASE
def test_identifiers(client, path, identifier):
    answer = client.get(f"{path}/{identifier}")
    assert answer.status_code in {404, 422}
    assert len(answer.content) <= MAX_PROBLEM_BYTES


HEAD = b'--XyZ\r\nContent-Disposition: form-data; name="files"; filename="a.csv"\r\n\r\n'


class TestHostileForms:
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
