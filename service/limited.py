"""Large request bodies are processed by child processes of limited memory and time.

A parser blocks all other threads of its process, and its result takes many times the memory of the body.
A child builds the same application as the service, which has checked the key of the requester before. The
two processes exchange JSON and bytes only, never code or pickles. The children are forked from a template,
which the service starts as `python -P -m jointstiff.service.limited DESCRIPTOR`, with the file descriptor of
a socket: each message on the socket brings the end of a pipe for a further child.
"""

from __future__ import annotations

import asyncio
import gc
import json
import os
import resource
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock, Timer
from typing import Final
from weakref import WeakValueDictionary

import anyio
from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from fastapi import FastAPI, HTTPException, Request, Response
from pydantic import TypeAdapter
from starlette.types import Message, Scope

from jointstiff.service.api.middleware import KNOWN_ID
from jointstiff.service.app import create_app
from jointstiff.service.process import (
    FORMAT_VARIABLE,
    REQUEST_ID,
    LogFormat,
    build_own_command,
    set_log_format,
)
from jointstiff.service.security.access import REQUESTER, Requester, get_requester
from jointstiff.service.security.admission import AccessPolicy, is_loopback
from jointstiff.service.store.store import Store
from jointstiff.service.workers.engine import Queue

LIMITED_BYTES: Final = 256 * 1024
"""Size above which the child processes a body [bytes]."""
LIMITED_SECONDS: Final = 60.0
"""Time, and also processor time, that the child may take for one body [s]."""
LIMITED_MEMORY: Final = 512 * 1024 * 1024
"""Memory that the child may take for one body [bytes]."""
_PATHS: Final = frozenset(
    f"/v1/{name}"
    for name in (
        "robots",
        "kinematics",
        "measurement-sets",
        "campaigns",
        "plans",
        "deflections",
        "corrections",
    )
)
"""Paths of the API whose large request bodies are handled in the child process."""
_ALWAYS_IN_CHILD: Final = "/v1/geometries"
"""Path of the API whose request bodies of any size are handled in the child process.

The time of a geometry grows with the cube of the number of positions.
"""
_LEFT_AFTER_SECONDS: Final = 0.5
"""Interval of the check whether a client has left [s]."""
CHILDREN: Final = 2
"""Number of children: while a hostile body occupies one child, the other answers other bodies."""
PREPARED_AFTER_SECONDS: Final = 15.0
"""Time after its start at which a service starts the children [s]: the start of the service comes first."""
START_SECONDS: Final = 60.0
"""Time that a body waits for a child to start [s]."""


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


def belongs_to_child(path: str, content: bytes, media_type: str) -> bool:
    """Return whether the child must answer a request, given path, body and media type of the request.

    Forms always belong to it: their programs and tables are of any origin, and the robot searches the meaning
    of a table.
    """
    is_form = media_type.strip().lower().startswith("multipart/")
    return is_form or path == _ALWAYS_IN_CHILD or (path in _PATHS and len(content) > LIMITED_BYTES)


class Template:
    """The process from which children are forked: it has imported the program, and does nothing else."""

    def __init__(self) -> None:
        """Prepare the process, which starts with the first child."""
        self._process: subprocess.Popen[bytes] | None = None

    def fork(self, descriptor: int) -> None:
        """Fork a child that reads from the pipe with a file descriptor; start the process if need be."""
        if self._process is None or self._process.poll() is not None:
            self._start()
        with suppress(OSError):  # the process has just ended: nobody answers at the other end of the pipe
            socket.send_fds(self._control, [b"c"], [descriptor])

    def close(self) -> None:
        """Kill the process and all children, even while they work on bodies."""
        if self._process is None:
            return
        self._control.close()
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._process = None

    def _start(self) -> None:
        """Start the process."""
        self._control, other_end = socket.socketpair()
        with other_end:
            self._process = subprocess.Popen(  # noqa: S603 - no part of the command comes from outside
                build_own_command("jointstiff.service.limited", str(other_end.fileno())),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=[other_end.fileno()],
                process_group=0,  # Ctrl-C at the terminal ends the service alone; `close` ends the group
            )


class LimitedChildren:
    """Child processes that answer one request each at a time.

    A template has imported the program, so that a child is ready within a moment: a child that a hostile body
    has ended is soon replaced, and other bodies have another child meanwhile.
    """

    def __init__(
        self,
        template: Template,
        database: str,
        quota: int | None = None,
        memory: int = LIMITED_MEMORY,
        seconds: float = LIMITED_SECONDS,
    ) -> None:
        """Prepare children that answer from a database; their processes start with `prepare`, or when needed.

        Args:
            template: process from which the children are forked; the caller closes it.
            database: URL of the database.
            quota: greatest size of the database [bytes]; None for no limit.
            memory: memory for one body, in addition to the memory of the idle process [bytes].
            seconds: time for one body [s].
        """
        self._template = template
        self._settings_message = json.dumps([database, quota, memory, seconds]).encode()
        self._memory, self._seconds = memory, seconds
        self._slots = CapacityLimiter(CHILDREN)  # lets each child answer one request at a time
        self._turns: WeakValueDictionary[str, anyio.Lock] = WeakValueDictionary()  # by sender
        self._changing = Lock()  # of the attributes below, which several threads change
        self._idle: list[_Child] = []
        self._busy = 0  # number of children that answer a request
        self._is_closed = False

    def prepare(self) -> None:
        """Start the children that do not run yet, without waiting until they are ready."""
        with self._changing:
            while not self._is_closed and len(self._idle) + self._busy < CHILDREN:
                self._idle.append(self._fork_child())

    def prepare_later(self, seconds: float = PREPARED_AFTER_SECONDS) -> None:
        """Start the children after a time [s], in another thread."""
        timer = Timer(seconds, self.prepare)
        timer.daemon = True
        timer.start()

    async def answer(self, request: Request) -> Response | None:
        """Let a child answer a request; return None if this process is to answer the request.

        Raises:
            HTTPException: the body took too much memory or time (413), or the child does not start (503).
        """
        content = await request.body()
        if not belongs_to_child(request.url.path, content, request.headers.get("content-type", "")):
            return None
        forwarded = Forwarded(
            request.method,
            request.url.path,
            request.url.query,
            [(name.decode("latin-1"), value.decode("latin-1")) for name, value in request.headers.raw],
            REQUEST_ID.get(),
            get_requester(request),
        )
        call = _Call(forwarded, content)
        watch = asyncio.create_task(_end_when_client_leaves(request, call))
        try:
            async with self._get_turn(forwarded.requester):
                head, body = await run_sync(self._send_and_receive, call, limiter=self._slots)
        finally:
            watch.cancel()
        status, headers = json.loads(head)
        response = Response(body, status)
        response.raw_headers = [(name.encode("latin-1"), value.encode("latin-1")) for name, value in headers]
        return response

    def close(self) -> None:
        """End the idle children; busy children end with the template."""
        with self._changing:
            self._is_closed = True
            for child in self._idle:
                child.connection.close()
            self._idle.clear()

    def _get_turn(self, requester: Requester) -> anyio.Lock:
        """Return a lock that lets a sender have one child, so that other senders have the other one.

        A sender is a key, or else an address; several people may use programs of this machine without a key.
        """
        if requester.key is not None:
            sender = requester.key.id
        elif is_loopback(requester.address):
            return anyio.Lock()
        else:
            sender = requester.address
        return self._turns.setdefault(sender, anyio.Lock())

    def _send_and_receive(self, call: _Call) -> tuple[bytes, bytes]:
        """Send a request and its body to a child, and wait for the answer.

        Return (status and headers as JSON, body) of the answer.

        Raises:
            HTTPException: the body took too much memory or time (413), or the child does not start (503).
        """
        child = self._take_ready_child()
        call.child = child
        if call.has_left:
            child.kill()
        try:
            answer = child.ask(call.forwarded, call.content, self._seconds)
        except (OSError, EOFError):  # the child was too slow, or its limits ended it
            child.connection.close()
            with self._changing:
                self._busy -= 1
            self.prepare()
            raise HTTPException(
                413,
                f"processing the body takes more than {self._seconds:.0f} s or {self._memory >> 20} MiB; "
                "split the body into several requests",
            ) from None
        finally:
            call.child = None
        with self._changing:
            self._busy -= 1
            self._idle.append(child)
        return answer

    def _take_ready_child(self) -> _Child:
        """Take an idle child, or fork one; wait until it is ready.

        Raises:
            HTTPException: the child does not start, or is still starting (503).
        """
        with self._changing:
            living = [child for child in self._idle if not child.has_ended()]
            child = living.pop() if living else self._fork_child()
            self._idle = living
        try:
            is_ready = child.is_ready(START_SECONDS)
        except (OSError, EOFError):
            child.connection.close()
            raise HTTPException(
                503, "the process for large bodies does not start; send the request again later"
            ) from None
        with self._changing:
            if is_ready:
                self._busy += 1
            else:
                self._idle.insert(0, child)  # it goes on starting
        if not is_ready:
            raise HTTPException(
                503, "the process for large bodies is still starting; send the request again later"
            )
        return child

    def _fork_child(self) -> _Child:
        """Fork a child from the template; the child is ready later."""
        connection, child_end = Pipe()
        with child_end:
            self._template.fork(child_end.fileno())
        connection.send_bytes(self._settings_message)
        return _Child(connection)


@dataclass
class _Call:
    """A request that a child answers."""

    forwarded: Forwarded
    content: bytes
    child: _Child | None = None  #: child that answers
    has_left: bool = False  #: whether the client has closed the connection


async def _end_when_client_leaves(request: Request, call: _Call) -> None:
    """End the child that answers a request when the client closes the connection."""
    while not await request.is_disconnected():
        await anyio.sleep(_LEFT_AFTER_SECONDS)
    call.has_left = True
    if call.child is not None:
        call.child.kill()


class _Child:
    """A child process, at the other end of a connection."""

    def __init__(self, connection: Connection[bytes, bytes]) -> None:
        self.connection = connection
        self._process: int | None = None  # its id, which the child sends when it is ready

    def is_ready(self, seconds: float) -> bool:
        """Return whether the child is ready; wait for that at most `seconds` [s].

        Raises:
            EOFError: the child has ended.
        """
        if self._process is None:
            if not self.connection.poll(seconds):
                return False
            self._process = int(self.connection.recv_bytes())
        return True

    def has_ended(self) -> bool:
        """Return whether an idle child has ended: a living one sends nothing once it is ready."""
        return self._process is not None and self.connection.poll()

    def kill(self) -> None:
        """End the process."""
        if self._process is not None:
            _kill(self._process)

    def ask(self, forwarded: Forwarded, content: bytes, seconds: float) -> tuple[bytes, bytes]:
        """Send a request with its body; return (status and headers as JSON, body) of the answer.

        After `seconds` the child is killed, even if it does not take the request.

        Raises:
            OSError, EOFError: the child has ended.
        """
        if self._process is None:
            raise EOFError  # it has never been ready
        end = Timer(seconds, _kill, [self._process])
        end.daemon = True
        end.start()
        try:
            self.connection.send_bytes(FORWARDED.dump_json(forwarded))
            self.connection.send_bytes(content)
            return self.connection.recv_bytes(), self.connection.recv_bytes()
        finally:
            end.cancel()


def _kill(process: int) -> None:
    """Kill a process, given its id, if it still runs."""
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)


_NO_THREAD: Final = "can't start new thread"  # Python's message if a new thread finds no memory for its stack


def run_template(descriptor: int) -> None:
    """Fork a child for each pipe that comes through a socket, until the service closes the socket.

    This process has one thread and no connection to a database, so that its copies are sound.

    Args:
        descriptor: file descriptor of the socket.

    Raises:
        StoreError: the database of a child cannot be used.
    """
    control = socket.socket(fileno=descriptor)
    with Store.open("sqlite://") as store:
        create_app(store)  # makes what all applications share
    gc.freeze()  # garbage collections need not examine the libraries, which are never freed
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the system forgets children that have ended
    while True:
        _, descriptors, _, _ = socket.recv_fds(control, 1, 1)
        if not descriptors:
            return
        if os.fork() == 0:
            control.close()
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            run_child(descriptors[0])
            return
        os.close(descriptors[0])


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
        connection.send_bytes(str(os.getpid()).encode())
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
    run_template(int(sys.argv[1]))
