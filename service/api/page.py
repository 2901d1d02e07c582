"""The page: static files that are built with the package, served under a strict content security policy."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from fastapi import FastAPI
from fastapi.responses import FileResponse, PlainTextResponse, Response
from fastapi.staticfiles import StaticFiles

__all__ = ["install_page"]

BUNDLE: Final = Path(__file__).parents[1] / "static"

SECURITY_HEADERS: Final = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""No inline code, no other host, no frame around the page."""

_NOT_BUILT = "The page is not built: install the package again (scripts/setup). The API is at /v1.\n"


class _Assets(StaticFiles):
    """Files with a hash in their names, which never change."""

    def file_response(self, *args: object, **kwargs: object) -> Response:
        response = super().file_response(*args, **kwargs)  # type: ignore[arg-type]
        response.headers.update(SECURITY_HEADERS | {"Cache-Control": "public, max-age=31536000, immutable"})
        return response


def install_page(app: FastAPI, bundle: Path = BUNDLE) -> None:
    """Serve the page at / and its files at /assets; unknown paths stay the API's to answer."""

    def page() -> Response:
        if not (bundle / "index.html").is_file():
            return PlainTextResponse(_NOT_BUILT, 503)
        return FileResponse(bundle / "index.html", headers=SECURITY_HEADERS | {"Cache-Control": "no-cache"})

    def icon() -> Response:
        return FileResponse(bundle / "favicon.svg", headers=SECURITY_HEADERS)

    app.add_api_route("/", page, include_in_schema=False)
    app.add_api_route("/favicon.svg", icon, include_in_schema=False)
    if (bundle / "assets").is_dir():
        app.mount("/assets", _Assets(directory=bundle / "assets"), name="assets")
