"""Large request bodies are processed by a child process of limited memory and time.

A parser blocks all other threads of its process, and its result takes many times the memory of the body.
The child builds the same application as the service, which has checked the key of the requester before. The
two processes exchange JSON and bytes only, never code or pickles. The service starts the child as
`python -P -m jointstiff.service.limited DESCRIPTOR`, with the file descriptor of the pipe between them.
"""

from __future__ import annotations

import gc
import json
import os
import resource
import subprocess
import sys
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

import anyio
from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from fastapi import FastAPI, HTTPException, Request, Response
from pydantic import TypeAdapter
from starlette.types import Message, Scope

from jointstiff.service.api.middleware import KNOWN_ID
from jointstiff.service.app import create_app
from jointstiff.service.importing.grid import PACKED_SIGNATURES
from jointstiff.service.process import (
    FORMAT_VARIABLE,
    REQUEST_ID,
    LogFormat,
    build_own_command,
    set_log_format,
)
from jointstiff.service.security.access import REQUESTER, Requester, get_requester
from jointstiff.service.security.admission import AccessPolicy
from jointstiff.service.store.store import Store
from jointstiff.service.workers.engine import Queue

LIMITED_BYTES: Final = 256 * 1024
"""Size above which the child processes a body [bytes]; it processes workbooks and arrays of any size."""
LIMITED_SECONDS: Final = 60.0
"""Time, and also processor time, that the child may take for one body [s]."""
LIMITED_MEMORY: Final = 512 * 1024 * 1024
"""Memory that the child may take for one body [bytes]."""
_PATHS: Final = frozenset(
    f"/v1/{name}"
    for name in ("robots", "kinematics", "measurement-sets", "campaigns", "imports", "plans", "deflections")
)
"""Paths of the API whose large request bodies are handled in the child process."""
_ALWAYS_IN_CHILD: Final = frozenset({"/v1/geometries", "/v1/programs"})
"""Paths of the API whose request bodies of any size are handled in the child process.

Programs are texts of any origin; the time of a geometry grows with the cube of the number of positions.
"""
START_SECONDS: Final = 60.0
"""Time that a body waits for the child to start [s]."""


@dataclass
class Forwarded:
    """A request that is passed on to the child; the body is sent separately."""

    method: str
    path: str
    query: str
    headers: list[tuple[str, str]]
    request_id: str | None  # identifier of the request in the log
    requester: Requester

    def build_scope(self) -> Scope:
        """Return the ASGI scope of the request, with its requester and its id."""
        return {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "scheme": "http",
            "method": self.method,
            "path": self.path,
            "root_path": "",
            "query_string": self.query.encode(),
            "headers": [(name.encode("latin-1"), value.encode("latin-1")) for name, value in self.headers],
            "client": None,
            REQUESTER: self.requester,
            KNOWN_ID: self.request_id,
        }


FORWARDED: Final = TypeAdapter(Forwarded)


def belongs_to_child(path: str, content: bytes) -> bool:
    """Return whether the child must answer a request, given the path and the body of the request."""
    return path in _ALWAYS_IN_CHILD or (
        path in _PATHS
        and (len(content) > LIMITED_BYTES or any(first in content for first in PACKED_SIGNATURES))
    )


class LimitedChild:
    """A child process that answers one request at a time; it is started when its first request comes."""

    def __init__(
        self,
        database: str,
        quota: int | None = None,
        memory: int = LIMITED_MEMORY,
        seconds: float = LIMITED_SECONDS,
    ) -> None:
        """Prepare a child that answers from a database; its process starts with the first request.

        Args:
            database: URL of the database.
            quota: greatest size of the database [bytes]; None for no limit.
            memory: memory for one body, in addition to the memory of the idle process [bytes].
            seconds: time for one body [s].
        """
        self._settings_message = json.dumps([database, quota, memory, seconds]).encode()
        self._memory, self._seconds = memory, seconds
        self._one_request = CapacityLimiter(1)  # lets the child answer one request at a time
        self._connection: Connection[bytes, bytes] | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._is_ready = False  # True once the child has sent `ready`

    async def answer(self, request: Request) -> Response | None:
        """Let the child answer a request; return None if this process is to answer the request.

        Raises:
            HTTPException: the body took too much memory or time (413), or the child does not start (503).
        """
        content = await request.body()
        if not belongs_to_child(request.url.path, content):
            return None
        forwarded = Forwarded(
            request.method,
            request.url.path,
            request.url.query,
            [(name.decode("latin-1"), value.decode("latin-1")) for name, value in request.headers.raw],
            REQUEST_ID.get(),
            get_requester(request),
        )
        head, body = await run_sync(self._send_and_receive, forwarded, content, limiter=self._one_request)
        status, headers = json.loads(head)
        response = Response(body, status)
        response.raw_headers = [(name.encode("latin-1"), value.encode("latin-1")) for name, value in headers]
        return response

    def close(self) -> None:
        """Kill the child, even while it works on a body."""
        if self._connection is not None:
            self._connection.close()
        if self._process is not None:  # kills it even if nothing could be sent
            self._process.kill()
            self._process.wait()
        self._connection = self._process = None
        self._is_ready = False

    def _send_and_receive(self, forwarded: Forwarded, content: bytes) -> tuple[bytes, bytes]:
        """Send a request and its body `content` to the child, and wait for the answer.

        Return (status and headers as JSON, body) of the answer.

        Raises:
            HTTPException: the body took too much memory or time (413), or the child does not start (503).
        """
        connection = self._ready_connection()
        try:
            connection.send_bytes(FORWARDED.dump_json(forwarded))
            connection.send_bytes(content)
            if not connection.poll(self._seconds):
                raise TimeoutError
            return connection.recv_bytes(), connection.recv_bytes()
        except (OSError, EOFError):  # the child was too slow, or its limits ended it
            self.close()
            raise HTTPException(
                413,
                f"processing the body takes more than {self._seconds:.0f} s or {self._memory >> 20} MiB; "
                "split the body into several requests",
            ) from None

    def _ready_connection(self) -> Connection[bytes, bytes]:
        """Return the connection to the child when the child is ready; start the child if it does not run.

        Raises:
            HTTPException: the child does not start, or is still starting (503).
        """
        try:
            if self._connection is None or self._process is None or self._process.poll() is not None:
                self.close()
                self._connection = self._start_child()
            if not self._is_ready:
                if not self._connection.poll(START_SECONDS):
                    raise HTTPException(
                        503, "the process for large bodies is still starting; send the request again later"
                    )
                self._connection.recv_bytes()
                self._is_ready = True
        except (OSError, EOFError):
            self.close()
            raise HTTPException(
                503, "the process for large bodies does not start; send the request again later"
            ) from None
        return self._connection

    def _start_child(self) -> Connection[bytes, bytes]:
        """Start the child; return the parent's end of the pipe to the child, which sends `ready` later."""
        connection, child_end = Pipe()
        with child_end:
            self._process = subprocess.Popen(  # noqa: S603 - no part of the command comes from outside
                build_own_command("jointstiff.service.limited", str(child_end.fileno())),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=[child_end.fileno()],
                process_group=0,  # so that Ctrl-C at the terminal ends the service, not the child
            )
        connection.send_bytes(self._settings_message)
        return connection


_NO_THREAD: Final = "can't start new thread"  # Python's message if a new thread finds no memory for its stack


def run_child(descriptor: int) -> None:
    """Answer requests that come through the pipe with a file descriptor, until the service closes the pipe.

    Raises:
        StoreError: the database cannot be used.
    """
    connection: Connection[bytes, bytes] = Connection(descriptor)
    database, quota, memory, seconds = json.loads(connection.recv_bytes())
    with ExitStack() as stack, suppress(EOFError, BrokenPipeError):
        store = stack.enter_context(Store.open(database, quota))
        queue = stack.enter_context(closing(Queue(store, database)))
        app = create_app(store, queue.enqueue, AccessPolicy(hosts=None))
        app.state.is_closing = lambda: True  # no request waits here for workers: the service itself does
        with suppress(OSError):  # without /proc there is no limit of memory
            # The sixth number of this file is the size of data and stack: the memory of the idle process.
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
            memory_limit = pages * resource.getpagesize() + memory
            resource.setrlimit(resource.RLIMIT_DATA, (memory_limit, memory_limit))
        gc.freeze()  # garbage collections need not examine the libraries, which are never freed
        connection.send_bytes(b"ready")
        while True:
            forwarded = FORWARDED.validate_json(connection.recv_bytes())
            content = connection.recv_bytes()
            _limit_time(seconds)
            head, body = anyio.run(_get_answer_of_app, app, forwarded, content)
            headers = [(name.decode("latin-1"), value.decode("latin-1")) for name, value in head["headers"]]
            connection.send_bytes(json.dumps([head["status"], headers]).encode())
            connection.send_bytes(body)


async def _get_answer_of_app(app: FastAPI, forwarded: Forwarded, content: bytes) -> tuple[Message, bytes]:
    """Pass a request to the application; return (ASGI message with status and headers, body)."""
    body_message = iter([{"type": "http.request", "body": content, "more_body": False}])
    sent: list[Message] = []

    async def receive() -> Message:
        """Return the body of the request in the first call, later that the client has disconnected."""
        return next(body_message, {"type": "http.disconnect"})

    async def send(message: Message) -> None:
        """Keep a message of the application's answer."""
        sent.append(message)

    try:
        await app(forwarded.build_scope(), receive, send)
    except Exception as error:
        if isinstance(error, MemoryError) or str(error) == _NO_THREAD or not sent:
            raise  # ends this process, so that the service answers 413; other errors were answered already
    return sent[0], b"".join(message.get("body", b"") for message in sent[1:])


def _limit_time(seconds: float) -> None:
    """Limit the processor time of this process to `seconds` from now [s]; the system kills it afterwards."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    time_limit = int(usage.ru_utime + usage.ru_stime + seconds) + 1  # processor time since the process began
    _, hard_limit = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (time_limit, hard_limit))


if __name__ == "__main__":
    set_log_format(LogFormat(os.environ.get(FORMAT_VARIABLE, LogFormat.TEXT)))
    run_child(int(sys.argv[1]))
