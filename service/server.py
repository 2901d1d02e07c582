"""The service as a process: one store, one application, one listening socket."""

from __future__ import annotations

import asyncio
import gc
import hashlib
import os
import resource
import signal
import socket
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast

import uvicorn
from fastapi import FastAPI
from sqlalchemy import make_url
from starlette.types import ASGIApp
from uvicorn.config import LOGGING_CONFIG

from jointstiff.service.api.connections import Deadlines, TimedConnection
from jointstiff.service.app import create_app
from jointstiff.service.limited import LimitedChildren, Template
from jointstiff.service.problems import ServiceError, StoreError
from jointstiff.service.process import LogFormat, give_memory_back, jointstiff_version, set_log_format
from jointstiff.service.reports.laboratory import LaboratorySettings, read_laboratory
from jointstiff.service.security.admission import MAX_HEADER_BYTES, AccessPolicy, is_loopback
from jointstiff.service.security.keys import Keyring
from jointstiff.service.settings import Settings
from jointstiff.service.store.database import refuse_in_memory
from jointstiff.service.store.store import Store
from jointstiff.service.tables.terminal import console
from jointstiff.service.workers.engine import Queue
from jointstiff.service.workers.supervisor import Supervisor

_SHUTDOWN_SECONDS: Final = 5
"""Time for unfinished requests when the service is stopped [s]; clients that follow a run connect again."""
_GARBAGE_THRESHOLDS: Final = (10_000, 20, 50)
"""Thresholds of `gc.set_threshold`: collections are rare, as no request is answered while one runs."""
_THREAD_SWITCH_SECONDS: Final = 0.0005
"""Time that a thread computes before Python switches to a waiting thread [s].

It is short because the thread that answers requests waits for each computing thread several times in a
request.
"""
_KEEP_ALIVE_SECONDS: Final = 75
"""Time that a connection stays open between two requests [s].

A proxy must close its connections earlier, such as after the 30 s in docker/Caddyfile; else the proxy may
send a request on a connection that the service closes at the same moment, and the request is lost.
"""
_MOST_DESCRIPTORS: Final = 65_536
"""Greatest number of open files and connections, if the system allows it; the usual default is 1,024."""
_BACKLOG: Final = 128
"""Number of connections that the kernel keeps until they are accepted.

When no file descriptor is free, asyncio tries this number of times a second to accept a connection, and
writes each failure to the log.
"""
_PROXY: Final = (
    "note: put Caddy in front (docker/Caddyfile): it encrypts, and ends connections that are slow or do not "
    "read their answers"
)
_NO_ACCESS_CONTROL: Final = (
    "warning: no access control: everyone who reaches this address can read, post and delete, unless a "
    "proxy prevents it"
)


PROXIES_VARIABLE: Final = "FORWARDED_ALLOW_IPS"
"""Environment variable with the addresses of proxies that are trusted to state the address of a client.

uvicorn reads the variable.
"""


class ServerError(ServiceError):
    """The service cannot start."""


def run_server(settings: Settings, on_listening: Callable[[str], object] | None = None) -> None:
    """Run the service until the process is interrupted.

    When the socket listens, `on_listening` is called in another thread with the URL of the service.

    Raises:
        StoreError: the database cannot be used.
        ServerError: the service cannot listen on the address.
        KeysFileError, SettingsError: a file of keys, or of the laboratory's settings, cannot be used.
    """
    set_log_format(settings.log_format)
    give_memory_back()
    _raise_limit_of_open_files()
    policy = _choose_access_policy(settings)
    laboratory = LaboratorySettings() if settings.laboratory is None else read_laboratory(settings.laboratory)
    # The first process of a container ignores SIGTERM by default; later uvicorn handles the signal.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with ExitStack() as stack:
        listeners = _open_listeners(settings, stack)
        parts = _start_parts(settings, policy, _port_of(listeners[0]), stack)
        address = f"http://{settings.host}:{_port_of(listeners[0])}"
        _announce(settings, policy, address)
        app = create_app(parts.store, parts.queue.enqueue, policy, parts.keyring, laboratory)
        _connect_app(app, settings, parts, stack)
        server = uvicorn.Server(_configure_server(app, settings, listeners))
        app.state.is_closing = lambda: server.should_exit
        app.state.metrics.gauges = lambda: _gauge_values(app, server)
        _tune_interpreter()
        if on_listening is not None:  # the socket listens already; requests wait for the server
            threading.Thread(target=on_listening, args=(address,), daemon=True).start()
        server.run(sockets=listeners)


@dataclass(frozen=True)
class _Parts:
    """Parts of the process that the application uses, all open until the process ends."""

    store: Store
    keyring: Keyring  # keys of callers
    queue: Queue  # in which long jobs wait for workers
    supervisor: Supervisor  # starts the workers, and starts a worker that ended again


def _quota_in_bytes(settings: Settings) -> int | None:
    """Return the greatest size of the database in bytes, which the settings state in megabytes."""
    return settings.quota and settings.quota * 1_000_000


def _port_of(listener: socket.socket) -> int:
    """Return the port on which a socket listens."""
    port: int = listener.getsockname()[1]
    return port


def _open_listeners(settings: Settings, stack: ExitStack) -> list[socket.socket]:
    """Return the sockets that listen on the address of the service, and on that of the metrics, if any.

    The stack closes the sockets.

    Raises:
        ServerError: an address cannot be used.
    """
    listeners = [stack.enter_context(listen(settings.host, settings.port, "--port or --host"))]
    if settings.metrics_port is not None:
        options = "--metrics-port or --metrics-host"
        metrics_listener = listen(settings.metrics_host, settings.metrics_port, options)
        listeners.append(stack.enter_context(metrics_listener))
    return listeners


def _start_parts(settings: Settings, policy: AccessPolicy, port: int, stack: ExitStack) -> _Parts:
    """Open the database, the keys and the queue, and start the workers; the stack closes and ends them.

    Names of workers contain a hash of the database: messages distinguish workers of several stores.

    Raises:
        StoreError: the database cannot be used.
        KeysFileError, ServerError: the keys cannot be used, or there is none.
    """
    database = settings.database
    refuse_in_memory(database)
    on_upgrade = None if settings.no_upgrade else _say
    store = stack.enter_context(Store.open(database, _quota_in_bytes(settings), on_upgrade))
    keyring = _open_keyring(store, policy, settings)
    queue = stack.enter_context(closing(Queue(store, database)))
    store_hash = hashlib.sha256(_url_without_password(database).encode()).hexdigest()[:8]
    prefix = f"{socket.gethostname()}-{port}-{store_hash}"
    remove_heartbeat = make_heartbeat_remover(store)
    supervisor = stack.enter_context(Supervisor(database, settings.workers, prefix, remove_heartbeat))
    return _Parts(store, keyring, queue, supervisor)


def _announce(settings: Settings, policy: AccessPolicy, address: str) -> None:
    """Print address, database and number of workers, and a warning if everyone may use the service."""
    workers = settings.workers
    console().print(
        f"Jointstiff {jointstiff_version()} at {address}, API description at {address}/openapi.json\n"
        f"database {_url_without_password(settings.database)}, {workers} worker{'s' if workers != 1 else ''}",
        markup=False,
        soft_wrap=True,
    )
    if not is_loopback(settings.host):
        _say(_PROXY)
    if policy.access == "none":
        _say(_NO_ACCESS_CONTROL)


def _connect_app(app: FastAPI, settings: Settings, parts: _Parts, stack: ExitStack) -> None:
    """Give the application what only a server has: other processes, and the state of workers."""
    template = stack.enter_context(closing(Template()))
    limited = LimitedChildren(template, settings.database, _quota_in_bytes(settings))
    children = stack.enter_context(closing(limited))
    children.prepare_later()
    app.state.answer_elsewhere = children.answer
    app.state.failing_workers = lambda: parts.supervisor.failing
    app.state.solver.start()


def _configure_server(app: FastAPI, settings: Settings, listeners: Sequence[socket.socket]) -> uvicorn.Config:
    """Return the configuration of uvicorn; a second listener answers requests for metrics alone."""
    served_app: ASGIApp = app
    if len(listeners) > 1:
        served_app = app.state.metrics.serve_on_port(app, _port_of(listeners[1]))
    return configure_uvicorn(served_app, settings.log_format)


def _tune_interpreter() -> None:
    """Let threads switch fast, and let garbage collections be rare and omit the imported libraries."""
    sys.setswitchinterval(_THREAD_SWITCH_SECONDS)
    gc.set_threshold(*_GARBAGE_THRESHOLDS)
    gc.freeze()


def _say(sentence: str) -> None:
    """Print a sentence about the start."""
    console(stderr=True).print(sentence, markup=False, soft_wrap=True)


def _raise_limit_of_open_files() -> None:
    """Raise the limit of open files and connections of this process as far as the system allows."""
    _, hard_limit = resource.getrlimit(resource.RLIMIT_NOFILE)
    is_unlimited = hard_limit == resource.RLIM_INFINITY
    limit = _MOST_DESCRIPTORS if is_unlimited else min(hard_limit, _MOST_DESCRIPTORS)
    resource.setrlimit(resource.RLIMIT_NOFILE, (limit, hard_limit))


def configure_uvicorn(app: ASGIApp, log_format: LogFormat = LogFormat.TEXT) -> uvicorn.Config:
    """Return the configuration of uvicorn for an application whose requests arrive in their time."""
    return uvicorn.Config(
        Deadlines(app),
        log_level="warning",
        log_config=None if log_format is LogFormat.JSON else LOGGING_CONFIG,
        access_log=False,
        server_header=False,
        http=cast("type[asyncio.Protocol]", TimedConnection),
        h11_max_incomplete_event_size=MAX_HEADER_BYTES,
        ws="none",
        backlog=_BACKLOG,
        # By default uvicorn would trust the headers of all programs of this machine.
        proxy_headers=bool(os.environ.get(PROXIES_VARIABLE)),
        timeout_keep_alive=_KEEP_ALIVE_SECONDS,
        timeout_graceful_shutdown=_SHUTDOWN_SECONDS,
    )


def _gauge_values(app: FastAPI, server: uvicorn.Server) -> dict[str, float]:
    """Return name → value of the metrics that are gauges; those of the store are from its last check."""
    last_check = app.state.watch.last_check
    state: dict[str, float] = {
        "database_up": last_check is not None and last_check.error is None,
        "failing_workers": app.state.failing_workers(),
        "connections": len(server.server_state.connections),
    }
    if state["database_up"]:
        state |= {"workers": last_check.workers, "stored_bytes": last_check.stored_bytes}
        state |= app.state.watch.gauges()
        with suppress(StoreError):
            state["unfinished_jobs"] = sum(
                len(jobs.records.open_jobs()) for jobs in app.state.parts.jobs.values()
            )
    if app.state.watch.quota_bytes is not None:
        state["quota_bytes"] = app.state.watch.quota_bytes
    return state


def make_heartbeat_remover(store: Store) -> Callable[[str], None]:
    """Return a function that removes the heartbeat of a worker that ended, given its name.

    The function does nothing if the database does not answer: a silent worker soon counts as dead anyway.
    """

    def remove_heartbeat(worker: str) -> None:
        """Remove the heartbeat of a worker, given its name."""
        with suppress(StoreError):
            store.heartbeats.forget(worker)

    return remove_heartbeat


def _url_without_password(database: str) -> str:
    """Return the URL of a database without its password, and with the absolute path of an SQLite file."""
    url = make_url(database)
    if url.get_backend_name() == "sqlite" and url.database:
        url = url.set(database=str(Path(url.database).absolute()))
    return url.difference_update_query(["password", "sslpassword"]).render_as_string(hide_password=True)


def _choose_access_policy(settings: Settings) -> AccessPolicy:
    """Return the access policy that the settings state: rules for the callers that the service answers.

    Raises:
        ServerError: other machines could reach the service without keys, and no option allows it.
    """
    try:
        return AccessPolicy.from_address(
            settings.host,
            tuple(settings.allowed_host or ()),
            access_control=not settings.no_access_control,
            require_key=settings.require_key or settings.keys_file is not None,
        )
    except ValueError as error:
        raise ServerError(
            f"the service will not listen on {settings.host}: {error}",
            "require keys (create one with `jointstiff keys create`), or put an authenticating proxy in "
            "front and add --no-access-control and --allowed-host NAME, the name in its addresses ('*' for "
            "any)",
        ) from error


def _open_keyring(store: Store, policy: AccessPolicy, settings: Settings) -> Keyring:
    """Return the keys that the service accepts, from the store and from the file that the settings name.

    Raises:
        KeysFileError: the file of keys cannot be used.
        ServerError: the service requires keys, and no key is valid.
    """
    keyring = Keyring(store, settings.keys_file)
    if policy.access != "keys":
        return keyring
    keyring.open_file()
    keyring.read_keys()
    if not (settings.await_key or keyring.has_keys()):
        raise ServerError(
            "the service will not start: it requires keys, but no key is valid",
            'create a key: jointstiff keys create "tablet hall 3" --role operator --database '
            f"{_url_without_password(settings.database)} (or --keys-file FILE); or listen on 127.0.0.1 "
            "without --require-key; or put an authenticating proxy in front and add "
            "--no-access-control and --allowed-host NAME",
        )
    return keyring


def listen(host: str, port: int, options: str) -> socket.socket:
    """Return a socket that listens on an address; the message of an error names the options that set it.

    Raises:
        ServerError: the address cannot be used.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        listener = socket.create_server((host, port), family=family, backlog=_BACKLOG)
    except OSError as error:
        raise ServerError(
            f"the service cannot listen on {host}:{port}: "
            f"{os.strerror(error.errno) if error.errno else error}",
            f"give another value of {options}, or stop the program that uses this port",
        ) from error
    # asyncio sets this option only for sockets with an explicit protocol; without it answers wait for 40 ms.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener
