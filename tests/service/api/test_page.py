"""The page as the service answers with it: security headers, no inline code, files that never change."""

import asyncio
import re
import zlib
from concurrent.futures import ThreadPoolExecutor

import httpx2
from fastapi import FastAPI

from jointstiff.service.api.page import install_page


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


def test_files_of_the_page_are_packed_for_browsers_that_take_it(client):
    file = re.findall(r"src=\"\./(assets/[^\"]+)\"", client.get("/").text)[0]
    with client.stream("GET", f"/{file}", headers={"Accept-Encoding": "gzip"}) as answer:
        assert answer.headers["content-encoding"] == "gzip"
        assert "javascript" in answer.headers["content-type"]
        assert answer.headers["vary"] == "Accept-Encoding"
        packed = b"".join(answer.iter_raw())
    plain = client.get(f"/{file}", headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers
    assert zlib.decompress(packed, 31) == plain.content
    assert len(packed) < len(plain.content) / 2
