"""Requests named and counted: an identifier in the answer, the problem document and the log."""

from __future__ import annotations

import logging
import secrets
import time
from typing import Final

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from jointstiff.service.access.key_text import without_keys
from jointstiff.service.api.metrics import Metrics
from jointstiff.service.logs import ACCESS_LOGGER, REQUEST_ID

REQUEST_ID_HEADER: Final = "X-Request-Id"
KNOWN_ID: Final = "jointstiff.request_id"
"""Identifier in the scope of a request that another process forwards, which counts and logs it."""
_METHODS: Final = frozenset({"DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT"})

_logger = logging.getLogger(ACCESS_LOGGER)


class Observed:
    """Middleware around all others: names each request, counts it, and logs it as JSON if asked to."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        """Wrap an application.

        Args:
            app: the application.
            metrics: that count its requests.
        """
        self._app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        if KNOWN_ID in scope:
            REQUEST_ID.set(scope[KNOWN_ID])
            await self._app(scope, receive, send)
            return
        identifier = secrets.token_hex(8)
        REQUEST_ID.set(identifier)  # of this request's task; an unexpected error is answered outside of us
        status, began = 500, time.monotonic()

        async def sent(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)[REQUEST_ID_HEADER] = identifier
            await send(message)

        try:
            await self._app(scope, receive, sent)
        finally:
            seconds = time.monotonic() - began
            method = scope["method"] if scope["method"] in _METHODS else "other"
            route = getattr(scope.get("route"), "path", "other")
            self._metrics.count(method, route, status, seconds)
            if _logger.isEnabledFor(logging.INFO):
                path = without_keys(scope["path"])  # where one was put by mistake
                line = {"method": method, "path": path, "status": status, "seconds": round(seconds, 4)}
                _logger.info("%s %s %d", method, path, status, extra=line)
