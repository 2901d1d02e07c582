"""Deadlines for the headers and bodies of requests, which uvicorn does not have.

`TimedConnection` passes everything on to uvicorn's protocol, and the middleware `Deadlines` tells it when a
request has arrived. Other limits of slow clients and of connections belong to a proxy (docker/Caddyfile).
"""

from __future__ import annotations

import asyncio
from contextvars import ContextVar
from time import monotonic
from typing import Any, Final

from fastapi import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

HEADER_SECONDS: Final = 10.0
"""Time in which a client sends a header, from the beginning of the connection or the first byte [s]."""
PAUSE_SECONDS: Final = 10.0
"""Longest pause of a client within a body [s]."""
BODY_SECONDS: Final = 180.0
"""Time in which a client sends a body, without the time in which the service does not read [s]."""

_CONNECTION: ContextVar[TimedConnection | None] = ContextVar("_CONNECTION", default=None)
"""Connection of the request that is answered; None for events that are no requests."""


class TimedConnection:
    """Connection that ends unless each header arrives in its time; uvicorn's protocol does all the rest."""

    def __init__(self, **arguments: Any) -> None:  # noqa: ANN401 - of uvicorn's protocol
        self._protocol = H11Protocol(**arguments)
        self.is_answered = False

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - of uvicorn's protocol
        """Return what uvicorn's protocol does at other events of the connection."""
        return getattr(self._protocol, name)

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Begin the connection, and await its first header."""
        self._protocol.connection_made(transport)
        self._await_header()

    def data_received(self, data: bytes) -> None:
        """Read bytes of the client; the first bytes after an answer begin the next header."""
        if self.is_answered:
            self._await_header()
        # The task that answers a request is made here, and inherits the variable.
        _CONNECTION.set(self)
        self._protocol.data_received(data)

    def _await_header(self) -> None:
        """End the connection after a while, unless a request begins before."""
        self.is_answered = False
        self.header_timer = self._protocol.loop.call_later(HEADER_SECONDS, self._protocol.transport.close)


class Deadlines:
    """Outermost part of an application: a body arrives in its time, else it is refused with 408."""

    def __init__(self, app: ASGIApp) -> None:
        """Wrap an application."""
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        connection = _CONNECTION.get()
        if connection is None:
            await self._app(scope, receive, send)
            return
        seconds_left = BODY_SECONDS
        is_whole = False

        async def receive_in_time() -> Message:
            """Receive the next part of the body; raise the error 408 if it does not come in its time."""
            nonlocal seconds_left, is_whole
            if is_whole:  # what follows is only the end of the connection
                return await receive()
            began = monotonic()
            try:
                async with asyncio.timeout(min(PAUSE_SECONDS, seconds_left)):
                    message = await receive()
            except TimeoutError:
                raise HTTPException(
                    408,
                    "the body came too slowly; send the request again over a faster connection",
                    {"Connection": "close"},
                ) from None
            seconds_left -= monotonic() - began
            is_whole = not message.get("more_body")
            return message

        connection.header_timer.cancel()
        try:
            await self._app(scope, receive_in_time, send)
        finally:
            connection.is_answered = True
