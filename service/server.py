"""The service as a process: one store, one application, one listening socket."""

from __future__ import annotations

import os
import signal
import socket
import sys
from pathlib import Path

import uvicorn
from sqlalchemy import make_url

from service.app import create_app
from service.store import Store
from service.terminal import console
from service.versions import JOINTSTIFF_VERSION

__all__ = ["ServerError", "run_server"]


class ServerError(Exception):
    """The service cannot start."""

    def __init__(self, reason: str, remedy: str) -> None:
        super().__init__(reason)
        self.reason = reason
        self.remedy = remedy


def run_server(host: str, port: int, database: str) -> None:
    """Serve until interrupted.

    Args:
        host: address to listen on.
        port: TCP port, 0 for a free one.
        database: URL of the store.

    Raises:
        StoreError: the database cannot be used.
        ServerError: the address cannot be listened on.
    """
    # Until uvicorn handles it; as the first process of a container we would not hear it otherwise.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with Store.open(database) as store, _listen(host, port) as listener:
        address = f"http://{host}:{listener.getsockname()[1]}"
        console().print(
            f"Jointstiff {JOINTSTIFF_VERSION} at {address}, API description at {address}/openapi.json\n"
            f"database {_shown(database)}",
            markup=False,
            soft_wrap=True,
        )
        config = uvicorn.Config(create_app(store), log_level="warning", access_log=False, server_header=False)
        uvicorn.Server(config).run(sockets=[listener])


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
