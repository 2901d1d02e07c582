"""The child process that answers large bodies for a service, one at a time, within limits of memory and time.

Run it as `python -m jointstiff.service.limited DESCRIPTOR`, of the pipe to the service.
"""

from __future__ import annotations

import gc
import json
import os
import resource
import sys
from contextlib import ExitStack, closing, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

import anyio
from fastapi import FastAPI
from starlette.types import Message

from jointstiff.service.api.limited import FORWARDED, Forwarded
from jointstiff.service.app import create_app
from jointstiff.service.logs import FORMAT_VARIABLE, LogFormat, set_log_format
from jointstiff.service.security.origin import Posture
from jointstiff.service.store.store import Store
from jointstiff.service.workers.engine import JobQueue

_NO_THREAD: Final = "can't start new thread"  # Python's words for a thread that has no memory for its stack


def run_child(descriptor: int) -> None:
    """Answer what comes through a pipe, until the service ends or closes it.

    Raises:
        StoreError: the database cannot be used.
    """
    connection: Connection[bytes, bytes] = Connection(descriptor)
    database, quota, memory, seconds = json.loads(connection.recv_bytes())
    with ExitStack() as stack, suppress(EOFError, BrokenPipeError):
        store = stack.enter_context(Store.open(database, quota))
        queue = stack.enter_context(closing(JobQueue(store, database)))
        app = create_app(store, queue.enqueue, Posture(hosts=None))
        app.state.is_closing = lambda: True  # the service itself waits for workers
        with suppress(OSError):  # where the system does not tell how much that is
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
            most = pages * resource.getpagesize() + memory
            resource.setrlimit(resource.RLIMIT_DATA, (most, most))
        gc.freeze()  # libraries stay to the end
        connection.send_bytes(b"ready")
        while True:
            forwarded, content = FORWARDED.validate_json(connection.recv_bytes()), connection.recv_bytes()
            _limit_time(seconds)
            start, body = anyio.run(_answered, app, forwarded, content)
            headers = [(name.decode("latin-1"), value.decode("latin-1")) for name, value in start["headers"]]
            connection.send_bytes(json.dumps([start["status"], headers]).encode())
            connection.send_bytes(body)


async def _answered(app: FastAPI, forwarded: Forwarded, content: bytes) -> tuple[Message, bytes]:
    """Return the application's answer: how it starts, and its body."""
    received = iter([{"type": "http.request", "body": content, "more_body": False}])
    sent: list[Message] = []

    async def receive() -> Message:
        return next(received, {"type": "http.disconnect"})

    async def send(message: Message) -> None:
        sent.append(message)

    try:
        await app(forwarded.scope(), receive, send)
    except Exception as error:
        if isinstance(error, MemoryError) or str(error) == _NO_THREAD or not sent:
            raise  # this process ends, and the service says why; all else is logged, and its answer sent
    return sent[0], b"".join(message.get("body", b"") for message in sent[1:])


def _limit_time(seconds: float) -> None:
    """Limit the processor time from now on: a service that is killed leaves no child that goes on."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    most = int(used.ru_utime + used.ru_stime + seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (most, resource.getrlimit(resource.RLIMIT_CPU)[1]))


if __name__ == "__main__":
    set_log_format(LogFormat(os.environ.get(FORMAT_VARIABLE, LogFormat.TEXT)))
    run_child(int(sys.argv[1]))
