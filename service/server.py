"""The service as a process: one store, one application, one listening socket."""

from __future__ import annotations

import gc
import hashlib
import os
import signal
import socket
import sys
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Final

import uvicorn
from sqlalchemy import make_url

from jointstiff.service.app import create_app
from jointstiff.service.render import console
from jointstiff.service.store import Store
from jointstiff.service.versions import JOINTSTIFF_VERSION
from jointstiff.service.workers import Ledger, Supervisor

_GOODBYE_SECONDS: Final = 5
"""For requests under way when the service is told to end; those who follow a run come back."""


class ServerError(Exception):
    """The service cannot start."""

    def __init__(self, reason: str, remedy: str) -> None:
        super().__init__(reason)
        self.reason = reason
        self.remedy = remedy


def run_server(host: str, port: int, database: str, workers: int) -> None:
    """Serve until interrupted.

    Args:
        host: address to listen on.
        port: TCP port, 0 for a free one.
        database: URL of the store.
        workers: processes for long runs; with none, other machines' workers carry them out.

    Raises:
        StoreError: the database cannot be used.
        ServerError: the address cannot be listened on.
    """
    # Until uvicorn handles it; as the first process of a container we would not hear it otherwise.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with ExitStack() as stack:
        listener = stack.enter_context(_listen(host, port))
        store = stack.enter_context(Store.open(database))
        ledger = stack.enter_context(closing(Ledger(store, database)))
        port = listener.getsockname()[1]
        stack.enter_context(Supervisor(database, workers, f"{socket.gethostname()}-{port}-{_mark(database)}"))
        address = f"http://{host}:{port}"
        console().print(
            f"Jointstiff {JOINTSTIFF_VERSION} at {address}, API description at {address}/openapi.json\n"
            f"database {_shown(database)}, {workers} worker{'s' if workers != 1 else ''}",
            markup=False,
            soft_wrap=True,
        )
        app = create_app(store, ledger.enqueue)
        config = uvicorn.Config(
            app,
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=_GOODBYE_SECONDS,
        )
        gc.freeze()  # libraries stay to the end; no collection need look through them
        server = uvicorn.Server(config)
        app.state.is_closing = lambda: server.should_exit
        server.run(sockets=[listener])


def _mark(database: str) -> str:
    """Return what tells the workers of one store from those of another, the same at each start."""
    return hashlib.sha256(_shown(database).encode()).hexdigest()[:8]


def _shown(database: str) -> str:
    """The URL without its password, a file with its whole path."""
    url = make_url(database)
    if url.get_backend_name() == "sqlite" and url.database:
        url = url.set(database=str(Path(url.database).absolute()))
    return url.render_as_string(hide_password=True)


def _listen(host: str, port: int) -> socket.socket:
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        listener = socket.create_server((host, port), family=family, backlog=128)
    except OSError as error:
        raise ServerError(
            f"cannot listen on {host}:{port}: {os.strerror(error.errno) if error.errno else error}",
            "choose another --port or --host, or end the program that uses it",
        ) from error
    # asyncio sets it only on sockets of explicit protocol; without it answers wait 40 ms for an ACK.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener
