"""Forms: whatever an HTTP library writes comes back; what is no form, or not complete, is refused."""

from __future__ import annotations

import asyncio

import httpx2
import pytest
from fastapi import HTTPException, Request
from hypothesis import given
from hypothesis import strategies as st
from starlette.datastructures import UploadFile
from support.examples import examples

from jointstiff.service.api.bodies import MAX_FILES, read_form
from jointstiff.service.security.admission import SMALL_BYTES
from jointstiff.solver.errors import RequestError

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


@pytest.mark.parametrize(
    "body",
    [
        b"",
        PART,
        PART + PART[:-20],
        (PART + END)[:-5],
        PART.replace(b"\r\n", b"\n") + END,
        b"--XyZ\r\n\r\n1;2\r\n" + END,
        PART.replace(b'name="files"', b'name=""') + END,
        PART.replace(b'name="files"; ', b"") + END,
        PART.replace(b"\r\n\r\n", b"\r\nContent-Transfer-Encoding: base64\r\n\r\n") + END,
        PART.replace(b"\r\n\r\n", b"\r\n folded\r\n\r\n") + END,
        PART.replace(b"\r\n\r\n", b"\r\nX: " + b"y" * 5_000 + b"\r\n\r\n") + END,
        PART.replace(b'"files"', b'"other"') + END,
        PART.replace(b'"files"', b'"options"') * 2 + END,
    ],
)
def test_refused(body):
    with pytest.raises(RequestError) as caught:
        read(TYPE, body)
    assert caught.value.remedy


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
