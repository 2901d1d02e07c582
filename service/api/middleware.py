"""Middleware of every answer: access control, methods as in RFC 9110, security headers, and the log."""

from __future__ import annotations

import logging
import re
import secrets
import time
from collections.abc import Iterable
from typing import Final

import anyio
from anyio.lowlevel import checkpoint
from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES
from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.routing import BaseRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from jointstiff.service.api.answers import (
    ANSWER_HEADERS,
    REQUEST_ID_HEADER,
    answer_error,
    answer_problem,
    list_methods,
)
from jointstiff.service.api.health import Metrics
from jointstiff.service.problems import StoreError, http_problem
from jointstiff.service.process import ACCESS_LOGGER, REQUEST_ID
from jointstiff.service.security.access import (
    REQUESTER,
    Audit,
    Gate,
    Requester,
    find_public_paths,
    get_client_address,
)
from jointstiff.service.security.admission import SAFE, AccessPolicy, find_refusal, is_loopback
from jointstiff.service.security.keys import hide_secrets

_LIVENESS_PATH: Final = "/live"
"""Path for liveness probes of containers, which the service answers even before a key exists."""
_NO_KEY_YET: Final = (
    "this service has no key yet, so the service answers only requests from its own machine",
    (
        "create a key with `jointstiff keys create NAME --role ROLE` where the service runs (`docker exec` "
        "in a container); or publish the port of the service on its machine alone (`--publish "
        "127.0.0.1:8000:8000`) and start the service with `serve --host 0.0.0.0 --no-access-control "
        "--allowed-host localhost`"
    ),
)
_METHOD_NOT_ALLOWED: Final = 405
_UNRECORDED: Final = re.compile(r"/v1/bridges/[0-9a-f]{32}/points")
"""Path of posts that the audit leaves out: positions of a tracker, several a second, which change nothing.

The audit records the reading that a person makes of the positions.
"""


class Guard:
    """Middleware that checks host, origin and key of a request, refuses or forwards it, and audits it."""

    def __init__(
        self, app: ASGIApp, policy: AccessPolicy, gate: Gate, audit: Audit, routes: Iterable[BaseRoute]
    ) -> None:
        """Wrap an application.

        Raises:
            UndeclaredRoleError: a route has no role.
        """
        self._app = app
        self._policy, self._gate, self._audit = policy, gate, audit
        self._public_paths, self._public_mounts = find_public_paths(routes)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request, with its requester in the scope, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
        elif problem := find_refusal(self._policy, scope):
            await answer_problem(problem)(scope, receive, send)
        elif REQUESTER in scope:  # another process of the service has identified the requester
            await self._app(scope, receive, send)
        else:
            requester = scope[REQUESTER] = Requester(None, self._gate.is_open, get_client_address(scope))
            await self._admit(requester, scope, receive, send)

    async def _admit(self, requester: Requester, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request, or refuse it because of its key; audit requests that may change something.

        Without access control, every request is forwarded; static files need no key.
        """
        if requester.is_open:
            await self._app(scope, receive, send)
        elif (
            scope["path"] != _LIVENESS_PATH
            and not is_loopback(requester.address)
            and await self._gate.awaits_first_key()
        ):
            await answer_problem(http_problem(403, *_NO_KEY_YET))(scope, receive, send)
        elif scope["path"].startswith(self._public_mounts):
            await self._app(scope, receive, send)
        elif scope["method"] in SAFE or _UNRECORDED.fullmatch(scope["path"]):
            await self._authorise_and_forward(requester, scope, receive, send)
        else:
            await self._audit.answer_and_record(
                requester,
                scope,
                send,
                lambda sent: self._authorise_and_forward(requester, scope, receive, sent),
            )

    async def _authorise_and_forward(
        self, requester: Requester, scope: Scope, receive: Receive, send: Send
    ) -> None:
        """Forward a request whose key has at least the role `viewer`; public paths need no key.

        On a public path of the API, the key is read nevertheless, because the audit records the key.
        """
        is_public = scope["path"] in self._public_paths
        try:
            if not is_public or scope["path"].startswith("/v1/"):
                requester.key = await self._gate.find_key(HTTPConnection(scope), requester.address)
            if not is_public:
                requester.require_role("viewer")
        except StoreError as error:
            await answer_error(error)(scope, receive, send)
        else:
            await self._app(scope, receive, send)


_NO_VERSIONS: Final = (
    "the request is for one version of a resource (If-Match), but the service compares no versions",
    "leave out the header If-Match",
)


class Methods:
    """Middleware that answers HEAD as GET without content, and OPTIONS and 405 with the allowed methods."""

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
        elif scope["method"] not in SAFE and Headers(scope=scope).get("if-match", "*").strip() != "*":
            await answer_problem(http_problem(412, *_NO_VERSIONS))(scope, receive, send)
        elif scope["method"] == "HEAD":
            await self._answer_head(scope, receive, send)
        else:
            await self._app(scope, receive, self._add_allow_header(scope, send))

    async def _answer_head(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer HEAD with the headers of GET, then cancel GET, because its body may be an endless stream."""
        with anyio.CancelScope() as get_handler:

            async def send_only_headers(message: Message) -> None:
                """Send the headers and an empty body, then cancel the handler of GET."""
                await send(message)
                await send({"type": "http.response.body"})
                get_handler.cancel()
                await checkpoint()

            await self._app(
                {**scope, "method": "GET"}, receive, self._add_allow_header(scope, send_only_headers)
            )

    def _add_allow_header(self, scope: Scope, send: Send) -> Send:
        """Return a `send` that adds the header `Allow` to answers with status 405."""
        request_scope = dict(scope)  # a copy, as a mount changes the scope

        async def send_with_allow(message: Message) -> None:
            """Send a message; with status 405, add the header `Allow` before."""
            if message.get("status") == _METHOD_NOT_ALLOWED:
                MutableHeaders(scope=message)["Allow"] = self._allowed_methods(request_scope)
            await send(message)

        return send_with_allow

    def _allowed_methods(self, scope: Scope) -> str:
        """Return the methods of a request's address as text for `Allow`; empty for an unknown address."""
        methods = set(list_methods(self._routes, scope))
        if "GET" in methods:
            methods.add("HEAD")
        return ", ".join(sorted(methods | {"OPTIONS"})) if methods else ""


COMPRESSED_BYTES: Final = 1024
"""Size from which answers are compressed."""
UNCOMPRESSED_TYPES: Final = (
    *DEFAULT_EXCLUDED_CONTENT_TYPES,  # streams of events, pictures
    "application/octet-stream",
    "application/pdf",
    "application/x-ndjson",  # reports, each sent at once
    "application/zip",
    "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
)
"""Media types of answers that are not compressed, whatever their size."""


KNOWN_ID: Final = "jointstiff.request_id"
"""Key of the scope that holds the id of a request which another process of the service forwarded.

The other process counts and logs the request, so this process does not.
"""
_COUNTED_METHODS: Final = frozenset({"DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT"})

_logger = logging.getLogger(ACCESS_LOGGER)


class Observed:
    """Outermost middleware: gives each request an id, counts the request, and logs it if so configured.

    The middleware also adds the standard headers that an answer does not have.
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
        if KNOWN_ID in scope:  # another process of the service counts and logs this request
            REQUEST_ID.set(scope[KNOWN_ID])
            await self._app(scope, receive, send)
            return
        identifier = secrets.token_hex(8)
        # The id is set for the task of this request, also for answers to errors outside this middleware.
        REQUEST_ID.set(identifier)
        status, started_at = 500, time.monotonic()

        async def send_and_record_status(message: Message) -> None:
            """Add missing standard headers, send the message, and note the status of the answer."""
            nonlocal status
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in {**ANSWER_HEADERS, REQUEST_ID_HEADER: identifier}.items():
                    headers.setdefault(name, value)
            await send(message)
            # The status is noted only after `send`, which fails if the connection is closed.
            status = message.get("status", status)

        try:
            await self._app(scope, receive, send_and_record_status)
        finally:
            seconds = time.monotonic() - started_at
            method = scope["method"] if scope["method"] in _COUNTED_METHODS else "other"
            route = getattr(scope.get("route"), "path", "other")
            self._metrics.count(method, route, status, seconds)
            if _logger.isEnabledFor(logging.INFO):
                # A client may have put a key into the address by mistake.
                path = hide_secrets(scope["path"])
                log_fields = {"method": method, "path": path, "status": status, "seconds": round(seconds, 4)}
                _logger.info("%s %s %d", method, path, status, extra=log_fields)
