"""An application in this process: asked without a socket, or served by a thread."""

import asyncio
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import anyio
import httpx2
import uvicorn
from fastapi import FastAPI

from jointstiff.service.app import create_app
from jointstiff.service.security.admission import AccessPolicy
from jointstiff.service.store.store import Store


@cache
def description() -> dict[str, Any]:
    """The description of the API; no test may change it."""
    with Store.open("sqlite://") as store:
        return create_app(store).openapi()


def composed(store: Store, posture: AccessPolicy | None = None) -> FastAPI:
    """Compose an application that takes its description from the first one: it costs a second."""
    app = create_app(store, policy=posture)
    app.openapi = description
    return app


class Client:
    """A client of an application of our own, in process."""

    def __init__(
        self,
        store: Store,
        posture: AccessPolicy | None = None,
        host: str = "localhost:8000",
        address: str = "127.0.0.1",
    ) -> None:
        self._app = composed(store, posture)
        self._url = f"http://{host}"
        self._client = (address, 50_000)

    def request(self, method: str, path: str, **options: Any) -> httpx2.Response:
        async def send() -> httpx2.Response:
            transport = httpx2.ASGITransport(self._app, client=self._client)
            async with httpx2.AsyncClient(transport=transport, base_url=self._url) as client:
                answer = await client.request(method, path, **options)
            if others := asyncio.all_tasks() - {asyncio.current_task()}:  # what it writes in the background
                await asyncio.wait(others, timeout=5.0)
            return answer

        return anyio.run(send)

    def get(self, path: str, **options: Any) -> httpx2.Response:
        return self.request("GET", path, **options)


@contextmanager
def listening() -> Iterator[socket.socket]:
    """A socket that listens on a free port, as that of `serve` does."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        yield listener


@contextmanager
def served(store: Store, posture: AccessPolicy | None = None) -> Iterator[str]:
    """Serve a store from a thread of this process; yield the address."""
    with listening() as listener:
        config = uvicorn.Config(composed(store, posture), log_level="critical", http="h11", ws="none")
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            server.should_exit = True
            thread.join()
