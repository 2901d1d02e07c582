"""Middleware of every answer: who is let in, methods as in RFC 9110, security headers, a line in the log."""

from __future__ import annotations

import logging
import secrets
import time
from collections.abc import Iterable
from typing import Final

import anyio
from anyio.lowlevel import checkpoint
from starlette.datastructures import MutableHeaders
from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES
from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.routing import BaseRoute, Match, Mount
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from jointstiff.service.api.answers import ANSWER_HEADERS, REQUEST_ID_HEADER, answer_error, answer_problem
from jointstiff.service.api.health import Metrics
from jointstiff.service.problems import StoreError, http_problem
from jointstiff.service.process import ACCESS_LOGGER, REQUEST_ID
from jointstiff.service.security.access import REQUESTER, Audit, Gate, Requester, address_of, public_paths
from jointstiff.service.security.admission import SAFE, Posture, is_loopback, refusal
from jointstiff.service.security.keys import without_keys

_LIFE: Final = "/live"
"""Address that probes of containers ask, whether there is a key or not."""
_NO_KEY: Final = (
    "no key opens this service yet, so it answers its own machine only",
    "create one with `jointstiff keys create NAME --role ROLE` where the service runs (`docker exec` in a "
    "container); or publish its port on its machine alone (`--publish 127.0.0.1:8000:8000`) and start it "
    "with `serve --host 0.0.0.0 --no-access-control --allowed-host localhost`",
)
_METHODS: Final = ("DELETE", "GET", "PATCH", "POST", "PUT")
_METHOD_NOT_ALLOWED: Final = 405


class Guard:
    """Middleware: host and origin, then the requester and the audit. A refused request gets no further."""

    def __init__(
        self, app: ASGIApp, posture: Posture, gate: Gate, audit: Audit, routes: Iterable[BaseRoute]
    ) -> None:
        """Wrap an application.

        Raises:
            UndeclaredRoleError: a route has no role.
        """
        self._app = app
        self._posture, self._gate, self._audit = posture, gate, audit
        self._paths, self._mounts = public_paths(routes)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on with its requester, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
        elif problem := refusal(self._posture, scope):
            await answer_problem(problem)(scope, receive, send)
        elif REQUESTER in scope:  # the service that forwards it has found out
            await self._app(scope, receive, send)
        else:
            requester = scope[REQUESTER] = Requester(None, self._gate.is_open, address_of(scope))
            await self._admit(requester, scope, receive, send)

    async def _admit(self, requester: Requester, scope: Scope, receive: Receive, send: Send) -> None:
        if requester.is_open:
            await self._app(scope, receive, send)
        elif scope["path"] != _LIFE and not is_loopback(requester.address) and await self._gate.awaits_key():
            await answer_problem(http_problem(403, *_NO_KEY))(scope, receive, send)
        elif scope["path"].startswith(self._mounts):
            await self._app(scope, receive, send)
        elif scope["method"] in SAFE:
            await self._authorise_and_forward(requester, scope, receive, send)
        else:
            await self._audit.follow(
                requester,
                scope,
                send,
                lambda sent: self._authorise_and_forward(requester, scope, receive, sent),
            )

    async def _authorise_and_forward(
        self, requester: Requester, scope: Scope, receive: Receive, send: Send
    ) -> None:
        """Forward a request whose key has the role `viewer`; public paths need none.

        A public path of the API still reads the key, for the audit.
        """
        is_public = scope["path"] in self._paths
        try:
            if not is_public or scope["path"].startswith("/v1/"):
                requester.key = await self._gate.caller(HTTPConnection(scope), requester.address)
            if not is_public:
                requester.require("viewer")
        except StoreError as error:
            await answer_error(error)(scope, receive, send)
        else:
            await self._app(scope, receive, send)


class Methods:
    """Middleware: HEAD answers as GET without content, OPTIONS and 405 name the methods of the address."""

    def __init__(self, app: ASGIApp, routes: Iterable[BaseRoute]) -> None:
        """Wrap an application."""
        self._app = app
        self._routes = routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
        elif scope["method"] == "OPTIONS" and (allow := self._allowed_methods(scope)):
            await Response(status_code=204, headers={"Allow": allow})(scope, receive, send)
        elif scope["method"] == "HEAD":
            await self._answer_head(scope, receive, send)
        else:
            await self._app(scope, receive, self._with_allow(scope, send))

    async def _answer_head(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer as GET does up to the headers; cancel the rest, which may be a stream without end."""
        with anyio.CancelScope() as rest:

            async def only_headers(message: Message) -> None:
                await send(message)
                await send({"type": "http.response.body"})
                rest.cancel()
                await checkpoint()

            await self._app({**scope, "method": "GET"}, receive, self._with_allow(scope, only_headers))

    def _with_allow(self, scope: Scope, send: Send) -> Send:
        request_scope = dict(scope)  # before a mount changes it

        async def sent(message: Message) -> None:
            if message.get("status") == _METHOD_NOT_ALLOWED:
                MutableHeaders(scope=message)["Allow"] = self._allowed_methods(request_scope)
            await send(message)

        return sent

    def _allowed_methods(self, scope: Scope) -> str:
        """Return the methods of an address; empty if there is nothing at it."""
        methods = {
            method for method in _METHODS if scope["path"] == "*" or self._accepts_method(scope, method)
        }
        if "GET" in methods:
            methods.add("HEAD")
        return ", ".join(sorted(methods | {"OPTIONS"})) if methods else ""

    def _accepts_method(self, scope: Scope, method: str) -> bool:
        return any(
            route.matches({**scope, "method": method})[0] is Match.FULL
            for route in self._routes
            if method == "GET" or not isinstance(route, Mount)  # which has files, to be read
        )


COMPRESSED_BYTES: Final = 1024
"""Smaller answers are sent as they are."""
PACKED: Final = (
    *DEFAULT_EXCLUDED_CONTENT_TYPES,  # streams of events, pictures
    "application/octet-stream",
    "application/pdf",
    "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
)
"""Types of answers that are sent as they are, whatever their size."""


KNOWN_ID: Final = "jointstiff.request_id"
"""Identifier in the scope of a request that another process forwards, which counts and logs it."""
_COUNTED: Final = frozenset({"DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT"})

_logger = logging.getLogger(ACCESS_LOGGER)


class Observed:
    """Middleware around all others: names each request, counts it, and logs it as JSON if so configured.

    It gives each answer the headers that it lacks.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        """Wrap an application."""
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
                headers = MutableHeaders(scope=message)
                for name, value in {**ANSWER_HEADERS, REQUEST_ID_HEADER: identifier}.items():
                    headers.setdefault(name, value)
            await send(message)
            status = message.get("status", status)  # now, as the connection may have refused it

        try:
            await self._app(scope, receive, sent)
        finally:
            seconds = time.monotonic() - began
            method = scope["method"] if scope["method"] in _COUNTED else "other"
            route = getattr(scope.get("route"), "path", "other")
            self._metrics.count(method, route, status, seconds)
            if _logger.isEnabledFor(logging.INFO):
                path = without_keys(scope["path"])  # where one was put by mistake
                line = {"method": method, "path": path, "status": status, "seconds": round(seconds, 4)}
                _logger.info("%s %s %d", method, path, status, extra=line)
