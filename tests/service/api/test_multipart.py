"""Forms taken apart: whatever an HTTP library writes comes back, all else is refused in its words."""

from __future__ import annotations

import httpx
import pytest
from fastapi import HTTPException
from hypothesis import given, settings
from hypothesis import strategies as st

from jointstiff.service.api.multipart import MAX_HEADER_BYTES, MAX_PARTS, Part, read_parts
from jointstiff.solver.errors import RequestError

TYPE = "multipart/form-data; boundary=XyZ"
PART = b'--XyZ\r\nContent-Disposition: form-data; name="files"; filename="a.csv"\r\n\r\n1;2\r\n'
END = b"--XyZ--\r\n"


def written(fields):
    """As httpx, which shares no code with ours, writes it."""
    request = httpx.Request("POST", "http://x/", files=fields)
    return request.headers["content-type"], request.read()


names = st.text(
    st.characters(codec="utf-8", exclude_categories=["C"], exclude_characters='/\\"'), min_size=1, max_size=40
)


@given(st.lists(st.tuples(names, st.binary(max_size=300)), max_size=5))
@settings(max_examples=150, deadline=None)
def test_what_an_http_library_writes_comes_back(files):
    content_type, body = written([("files", file) for file in files] + [("options", (None, b"{}"))])
    assert read_parts(content_type, body) == [
        *(Part("files", name, content) for name, content in files),
        Part("options", None, b"{}"),
    ]


@given(st.binary(max_size=400), st.integers(0, 200), st.integers(0, 200))
@settings(max_examples=300, deadline=None)
def test_damaged_forms_are_taken_apart_or_refused(noise, start, length):
    whole = PART + PART + END
    damaged = whole[:start] + noise + whole[start + length :]
    try:
        parts = read_parts(TYPE, damaged)
    except (RequestError, HTTPException):
        return
    assert all(isinstance(part, Part) and b"\r\n--XyZ" not in part.content for part in parts)


@given(st.text(max_size=60))
@settings(max_examples=200, deadline=None)
def test_any_content_type(text):
    for content_type in (text, f"multipart/form-data;{text}", f"multipart/form-data; boundary={text}"):
        try:
            read_parts(content_type, PART + END)
        except (RequestError, HTTPException):
            continue


@pytest.mark.parametrize(
    ("sent", "kept"),
    [
        ('"C:\\data\\day 1.csv"', "day 1.csv"),
        ('"../../etc/passwd"', "passwd"),
        ('"a\\"b;c.csv"', 'a"b;c.csv'),
        ('"a\\\\"', ""),
        ("plain.csv", "plain.csv"),
        ('""', ""),
    ],
)
def test_names_of_files(sent, kept):
    body = PART.replace(b'"a.csv"', sent.encode()) + END
    assert read_parts(TYPE, body) == [Part("files", kept, b"1;2")]


@pytest.mark.parametrize(
    "body",
    [
        PART + END,
        b"a preamble\r\n" + PART + END + b"an epilogue",
        (PART + END).replace(b"--XyZ\r\n", b"--XyZ \t\r\n"),
        (PART + END).replace(
            b"\r\n\r\n", b"\r\ncontent-type: text/csv\r\nContent-Transfer-Encoding: 8BIT\r\n\r\n"
        ),
        PART + b"--XyZ--",
    ],
)
def test_forms_that_are_right(body):
    assert read_parts(TYPE, body) == [Part("files", "a.csv", b"1;2")]


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b"", "does not end"),
        (PART, "does not end"),
        ((PART + END)[:-4], "does not end"),
        (PART.replace(b"\r\n", b"\n") + END, "alone on its line|does not end|headers"),
        (b"--XyZ\r\n\r\n1;2\r\n" + END, "headers"),
        (b"--XyZ" + PART + END, "alone on its line"),
        (PART + END + PART + END, "alone on its line"),
        (PART.replace(b"\r\n\r\n", b"\r\n") + END, "no headers"),
        (PART.replace(b"form-data", b"attachment") + END, "form-data; name"),
        (PART.replace(b'name="files"', b'name=""') + END, "form-data; name"),
        (PART.replace(b'"a.csv"', b'"a"b.csv"') + END, "parameters"),
        (PART.replace(b"a.csv", b"\xff\xfe.csv") + END, "not UTF-8"),
        (
            PART.replace(b"\r\n\r\n", b"\r\nContent-Transfer-Encoding: base64\r\n\r\n") + END,
            "transfer encoding",
        ),
        (PART.replace(b"\r\n\r\n", b"\r\n folded\r\n\r\n") + END, "header of a part is none"),
        (
            PART.replace(b"\r\n\r\n", b"\r\nX: " + b"y" * MAX_HEADER_BYTES + b"\r\n\r\n") + END,
            "more than 4096",
        ),
    ],
)
def test_refused(body, reason):
    with pytest.raises(RequestError, match=reason) as caught:
        read_parts(TYPE, body)
    assert caught.value.remedy


@pytest.mark.parametrize("boundary", ["", "x" * 71, '"é"', '"a\x01b"', None])
def test_boundaries(boundary):
    content_type = "multipart/form-data" + ("" if boundary is None else f"; boundary={boundary}")
    with pytest.raises(RequestError, match=r"boundary|parameters"):
        read_parts(content_type, PART + END)


def test_limits():
    assert len(read_parts(TYPE, PART * MAX_PARTS + END)) == MAX_PARTS
    for count in (MAX_PARTS + 1, 50_000):
        with pytest.raises(HTTPException) as caught:
            read_parts(TYPE, PART * count + END)
        assert caught.value.status_code == 413
    with pytest.raises(HTTPException) as caught:
        read_parts("application/json", b"{}")
    assert caught.value.status_code == 415
