"""The description of the API: 0.4 MB that are written once, by a thread that answers nobody else."""

from __future__ import annotations

import json
from functools import cache
from threading import Lock

from fastapi import FastAPI, Response

from jointstiff.service.api.access import VIEWER, AccessRoute


def install_description(app: FastAPI) -> None:
    """Answer at /openapi.json. FastAPI's own route writes it anew each time, and keeps all others waiting."""
    writing = Lock()  # of eight who ask at once one writes

    @cache
    def written() -> bytes:
        return json.dumps(app.openapi(), ensure_ascii=False, separators=(",", ":")).encode()

    def get_description() -> Response:
        with writing:
            return Response(written(), media_type="application/json")

    route = AccessRoute("/openapi.json", get_description, dependencies=[VIEWER], include_in_schema=False)
    app.router.routes.append(route)
