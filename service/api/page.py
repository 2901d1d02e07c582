"""The page and the documentation: static files, served under a strict content security policy."""

from __future__ import annotations

import json
from collections.abc import Callable
from mimetypes import guess_type
from pathlib import Path
from typing import Final

from anyio import Lock
from anyio.to_thread import run_sync
from fastapi import FastAPI, HTTPException
from fastapi.responses import FileResponse, HTMLResponse, PlainTextResponse, RedirectResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.datastructures import Headers
from starlette.types import Scope

from jointstiff.service.security.access import PUBLIC, VIEWER, AccessRoute

BUNDLE: Final = Path(__file__).parents[1] / "static"
DOCS: Final = Path(__file__).parents[1] / "static-docs"

SECURITY_HEADERS: Final = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""Headers of the page: they forbid inline code, other hosts, and frames around the page."""

_POLICY: Final = "Content-Security-Policy"
DOCS_HEADERS: Final = SECURITY_HEADERS | {
    _POLICY: SECURITY_HEADERS[_POLICY].replace("form-action 'none'", "form-action 'self'"),
    "Cache-Control": "no-cache",
}
"""Headers of the documentation: those of the page, but forms are allowed, to search the documentation."""

PACKED: Final = {"br": ".br", "gzip": ".gz"}
"""Endings of the packed forms of a file by their content codings, the smallest form first."""

_MISSING_PAGE = "The dashboard is not built: install the package again (scripts/setup). The API is at /v1.\n"
_MISSING_DOCS = """<!doctype html>
<html lang="en"><meta name="viewport" content="width=device-width"><title>Documentation · Jointstiff</title>
<h1>The documentation is not built</h1>
<p>The packages of releases contain the documentation; this package does not. Read it on
<a href="https://github.com/jointstiff/jointstiff/tree/main/docs">GitHub</a>; in a checkout
<code>scripts/docs</code> builds it; the service then shows it at once.
The API is described at <a href="{root}openapi.json">openapi.json</a>.
<a href="{root}">Back to the page</a></p>
</html>
"""


def _make_missing_docs_page(root: str) -> str:
    """Return the HTML page that explains how to build the documentation; `root` is the relative path to /."""
    return _MISSING_DOCS.format(root=root)


class _Files(StaticFiles):
    """Static files of a folder that may be built, or built again, while it is served."""

    def __init__(self, folder: Path) -> None:
        super().__init__(directory=folder, check_dir=False)

    async def check_config(self) -> None:
        """Do nothing: Starlette would require the folder here, but it may be built later."""


class _Assets(_Files):
    """Static files with a hash in their names, which never change, each with its packed forms."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Return a file in the smallest form that the browser accepts; only over TLS is this form Brotli."""
        accepted = Headers(scope=scope).get("accept-encoding", "").replace(" ", "").split(",")
        try:
            codings = [
                coding
                for coding, ending in PACKED.items()
                if coding in accepted and (await run_sync(self.lookup_path, path + ending))[1] is not None
            ]
        except (OSError, ValueError):  # the operating system does not accept this file name
            raise HTTPException(404) from None
        coding = codings[0] if codings else None
        response = await super().get_response(path + PACKED[coding] if coding else path, scope)
        if coding:
            response.headers["Content-Encoding"] = coding
            response.headers["Content-Type"] = guess_type(path)[0] or "application/octet-stream"
            response.headers["Vary"] = "Accept-Encoding"
        # The long Content-Security-Policy is for the page alone; these files get the short default policy.
        response.headers["Cache-Control"] = "public, max-age=31536000, immutable"
        return response


class _Docs(_Files):
    """Static files of the documentation, which a new installation may replace."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Return a file; if the documentation is not built, return a page that explains how to build it."""
        if (await run_sync(self.lookup_path, "index.html"))[1] is None:
            depth = path.count("/")
            return HTMLResponse(_make_missing_docs_page(f"../{'../' * depth}"), 404, headers=SECURITY_HEADERS)
        return await super().get_response(path, scope)

    def file_response(self, *args: object, **kwargs: object) -> Response:
        """Return the answer with a file, with the headers of the documentation."""
        response = super().file_response(*args, **kwargs)  # type: ignore[arg-type]
        response.headers.update(DOCS_HEADERS)
        return response


def install_page(app: FastAPI, bundle: Path = BUNDLE, docs: Path = DOCS) -> None:
    """Serve the page at / and the documentation at /docs/; the API answers all other paths."""

    def send_page() -> Response:
        if not (bundle / "index.html").is_file():
            return PlainTextResponse(_MISSING_PAGE, 503)
        return FileResponse(bundle / "index.html", headers=SECURITY_HEADERS | {"Cache-Control": "no-cache"})

    def send_icon() -> Response:
        return FileResponse(bundle / "favicon.svg", headers=SECURITY_HEADERS)

    def send_notices() -> Response:
        return FileResponse(bundle / "notices.txt", headers=SECURITY_HEADERS)

    def send_worker() -> Response:
        return FileResponse(bundle / "worker.js", headers=SECURITY_HEADERS | {"Cache-Control": "no-cache"})

    _add_public_route(app, "/", send_page)
    _add_public_route(app, "/worker.js", send_worker)
    _add_public_route(app, "/notices.txt", send_notices)
    _add_public_route(app, "/favicon.svg", send_icon)
    app.mount("/assets", _Assets(bundle / "assets"), name="assets")
    _install_docs(app, docs)


def _add_public_route(app: FastAPI, path: str, endpoint: Callable[[], Response]) -> None:
    """Add a route that needs no key: users sign in on the page, so the page itself must be public."""
    route = AccessRoute(path, endpoint, dependencies=[PUBLIC], include_in_schema=False)
    app.router.routes.append(route)


def _install_docs(app: FastAPI, docs: Path) -> None:
    """Serve the documentation in the folder `docs` at /docs/, and redirect /docs there."""

    def redirect_to_docs() -> Response:
        return RedirectResponse("docs/")  # a relative address, as the Host header may be forged

    def send_docs_index() -> Response:
        if not (docs / "index.html").is_file():
            return HTMLResponse(_make_missing_docs_page("../"), 404, headers=SECURITY_HEADERS)
        return FileResponse(docs / "index.html", headers=DOCS_HEADERS)

    _add_public_route(app, "/docs", redirect_to_docs)
    _add_public_route(app, "/docs/", send_docs_index)
    app.mount("/docs", _Docs(docs), name="docs")


def install_description(app: FastAPI) -> None:
    """Serve the OpenAPI description at /openapi.json; a thread writes it at the first request only.

    FastAPI's own route would write the description for each request, and block all other requests meanwhile.
    """
    write_lock = Lock()  # if several requests come at once, the first one writes and the others wait
    description = b""

    def write_description() -> bytes:
        return json.dumps(app.openapi(), ensure_ascii=False, separators=(",", ":")).encode()

    async def get_description() -> Response:
        """Return the description as JSON; the first request waits until it is written."""
        nonlocal description
        async with write_lock:
            description = description or await run_sync(write_description)
        return Response(description, media_type="application/json")

    route = AccessRoute("/openapi.json", get_description, dependencies=[VIEWER], include_in_schema=False)
    app.router.routes.append(route)
