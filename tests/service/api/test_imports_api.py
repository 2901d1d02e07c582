"""Imports over HTTP: a preview, a set that can be posted; forms, hostile ones and those of any library."""

import asyncio
import gzip
import json
import socket

import httpx2
import pytest
from fastapi import HTTPException, Request
from hypothesis import given
from hypothesis import strategies as st
from starlette.datastructures import UploadFile
from support.examples import examples
from support.importing_samples import CAMPAIGN
from support.workbooks import table_of

from jointstiff.schemas.finding import Problem
from jointstiff.schemas.imports import ImportAnswer
from jointstiff.service.api.bodies import MAX_FILES, read_form
from jointstiff.service.problems import MAX_PROBLEM_BYTES
from jointstiff.service.security.admission import SMALL_BYTES
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import RequestError

OPTIONS = {"encoders": "motor", "load_point": [0.0, 0.0, 120.0]}
FORM = {"Content-Type": "multipart/form-data; boundary=XyZ"}
HEAD = b'--XyZ\r\nContent-Disposition: form-data; name="files"; filename="a.csv"\r\n\r\n'


def send(client, *files, **options):
    fields = [("files", file) for file in files]
    return client.post("/v1/imports", files=[*fields, ("options", (None, json.dumps(options)))])


def answered(client, *files, **options):
    answer = send(client, *files, **options)
    assert answer.status_code == 200, answer.text
    return ImportAnswer.model_validate_json(answer.content)


def _posted(found, robot):
    return found.measurement_set.model_dump(mode="json", exclude_none=True) | {"robot_id": robot}


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
        stored = client.post("/v1/measurement-sets", json=_posted(found, robot)).json()
        assert stored["warnings"] == [finding.model_dump(mode="json") for finding in found.findings]
        fewer = b"\n".join(
            b";".join(line.split(b";")[:6] + line.split(b";")[7:]) for line in table.split(b"\n")
        )
        problem = refused(send(client, ("a.csv", fewer), **options), 422)
        assert "do not fit the robot" in problem.detail
        assert refused(send(client, ("a.csv", table), **options | {"robot_id": "none"}), 404)

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


HOSTILE = {
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
    @pytest.mark.parametrize("name", HOSTILE)
    def test_refused(self, client, name):
        answer = client.post("/v1/imports", content=HOSTILE[name], headers=FORM)
        refused(answer, 413, 422)
        assert "\x07" not in answer.text
        assert client.get("/health").is_success

    def test_too_large(self, client):
        problem = refused(send(client, ("a.csv", b"1;2\n" * (2 << 20))), 413)
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
