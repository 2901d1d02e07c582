"""HEAD, OPTIONS and Allow on every address, as RFC 9110 describes them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import anyio
from anyio.lowlevel import checkpoint
from starlette.datastructures import MutableHeaders
from starlette.responses import Response
from starlette.routing import BaseRoute, Match, Mount
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_METHODS: Final = ("DELETE", "GET", "PATCH", "POST", "PUT")
_METHOD_NOT_ALLOWED: Final = 405


class Methods:
    """Middleware: HEAD answers as GET without content, OPTIONS and 405 name the methods of the address."""

    def __init__(self, app: ASGIApp, routes: Iterable[BaseRoute]) -> None:
        """Wrap an application.

        Args:
            app: the application.
            routes: its routes.
        """
        self._app = app
        self._routes = routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
        elif scope["method"] == "OPTIONS" and (allow := self._allow(scope)):
            await Response(status_code=204, headers={"Allow": allow})(scope, receive, send)
        elif scope["method"] == "HEAD":
            await self._head(scope, receive, send)
        else:
            await self._app(scope, receive, self._with_allow(scope, send))

    async def _head(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer as GET does up to the headers; cancel the rest, which may be a stream without end."""
        with anyio.CancelScope() as rest:

            async def only_headers(message: Message) -> None:
                await send(message)
                await send({"type": "http.response.body"})
                rest.cancel()
                await checkpoint()

            await self._app({**scope, "method": "GET"}, receive, self._with_allow(scope, only_headers))

    def _with_allow(self, scope: Scope, send: Send) -> Send:
        asked = dict(scope)  # before a mount changes it

        async def sent(message: Message) -> None:
            if message.get("status") == _METHOD_NOT_ALLOWED:
                MutableHeaders(scope=message)["Allow"] = self._allow(asked)
            await send(message)

        return sent

    def _allow(self, scope: Scope) -> str:
        """Return the methods of an address; empty if there is nothing at it."""
        methods = {method for method in _METHODS if scope["path"] == "*" or self._takes(scope, method)}
        if "GET" in methods:
            methods.add("HEAD")
        return ", ".join(sorted(methods | {"OPTIONS"})) if methods else ""

    def _takes(self, scope: Scope, method: str) -> bool:
        return any(
            route.matches({**scope, "method": method})[0] is Match.FULL
            for route in self._routes
            if method == "GET" or not isinstance(route, Mount)  # which has files, to be read
        )
