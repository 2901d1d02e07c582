"""Connections of uvicorn with our deadlines, shortened: late clients end, honest and patient ones do not."""

import asyncio
import socket
import threading
import time
from contextlib import ExitStack, contextmanager

import pytest
import uvicorn
from fastapi import HTTPException
from starlette.applications import Starlette
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route
from support.in_process import Client, listening
from support.processes import until

from jointstiff.service.api import connections
from jointstiff.service.security import admission
from jointstiff.service.security.admission import MAX_HEADER_BYTES, BodyBudget, BodyLimits
from jointstiff.service.server import configure_uvicorn

HEADER_SECONDS, PAUSE_SECONDS, BODY_SECONDS = 0.4, 0.4, 0.8
LONG = 2 * BODY_SECONDS
"""Time by which a slow client has been ended, and an honest one has not [s]."""
GET = b"GET /%s HTTP/1.1\r\nHost: localhost\r\n"
POST = b"POST /%s HTTP/1.1\r\nHost: localhost\r\nContent-Length: %d\r\n\r\n"
REFUSED = []


async def read(request):
    try:
        return Response(str(len(await request.body())))
    except HTTPException:
        REFUSED.append(request.url.path)
        raise


async def read_late(request):
    """Read a body after a while, in which nobody takes its bytes."""
    await asyncio.sleep(LONG)
    return await read(request)


async def refuse(_):
    """Answer without the body."""
    return Response("no", 401)


async def stream(_):
    async def events():
        while True:
            yield b"data: 1\n\n"
            await asyncio.sleep(PAUSE_SECONDS / 4)

    return StreamingResponse(events(), media_type="text/event-stream")


APP = Starlette(
    routes=[
        Route("/body", read, methods=["GET", "POST"]),
        Route("/late", read_late, methods=["POST"]),
        Route("/refused", refuse, methods=["POST"]),
        Route("/events", stream),
    ]
)


@contextmanager
def served(app):
    """Serve with short deadlines; yield the port and uvicorn's server."""
    with pytest.MonkeyPatch.context() as patch, listening() as listener:
        for name in ("HEADER_SECONDS", "PAUSE_SECONDS", "BODY_SECONDS"):
            patch.setattr(connections, name, globals()[name])
        server = uvicorn.Server(configure_uvicorn(app))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            yield listener.getsockname()[1], server
        finally:
            server.should_exit = True
            thread.join()


@pytest.fixture(scope="module")
def service():
    with served(APP) as port_and_server:
        yield port_and_server


@pytest.fixture
def connect(service):
    with ExitStack() as stack:

        def to(content=b"", port=service[0]):
            connection = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=30))
            connection.sendall(content)
            return connection

        yield to


def received(connection, until_has=None):
    """Return the bytes that come before the other side closes, or until they have a part."""
    content = b""
    while part := connection.recv(65536):
        content += part
        if until_has and until_has in content:
            break
    return content


def drip(connection):
    """Send a byte again and again until the other side closes; return what it sent."""
    connection.settimeout(PAUSE_SECONDS / 8)
    content, end = b"", time.monotonic() + 30
    while time.monotonic() < end:
        try:
            connection.send(b"x")
            part = connection.recv(65536)
        except TimeoutError:
            continue
        except OSError:
            return content
        if not part:
            return content
        content += part
    pytest.fail("still open after 30 s")


def test_a_silent_connection_is_closed_without_an_answer(connect):
    assert received(connect()) == b""


@pytest.mark.parametrize("first", [b"GE", GET % b"body"], ids=["half a line", "half a header"])
def test_half_a_header_ends_however_it_drips(first, connect):
    assert received(connect(first)) == b""
    assert drip(connect(first + b"X-Drip: ")) == b""


def test_half_a_second_header_ends_as_the_first_does(connect):
    connection = connect(GET % b"body" + b"\r\n")
    assert received(connection, b"\r\n\r\n0").startswith(b"HTTP/1.1 200")
    connection.sendall(GET % b"body")
    assert drip(connection) == b""


def test_a_connection_rests_between_two_requests(connect):
    connection = connect(GET % b"body" + b"\r\n")
    assert received(connection, b"\r\n\r\n0").startswith(b"HTTP/1.1 200")
    time.sleep(LONG)
    connection.sendall(GET % b"body" + b"\r\n")
    assert received(connection, b"\r\n\r\n0").startswith(b"HTTP/1.1 200")


@pytest.mark.parametrize("is_dripping", [False, True], ids=["silent", "dripping"])
def test_half_a_body_is_refused_and_its_connection_ends(is_dripping, connect):
    REFUSED.clear()
    connection = connect(POST % (b"body", 10_000) + b"x" * 100)
    assert (drip if is_dripping else received)(connection).startswith(b"HTTP/1.1 408")
    assert REFUSED == ["/body"]


def test_a_body_that_comes_slowly_enough_is_read(connect):
    parts = int(BODY_SECONDS / PAUSE_SECONDS) * 3
    connection = connect(POST % (b"body", 1000 * parts))
    for _ in range(parts):
        time.sleep(PAUSE_SECONDS / 4)
        connection.sendall(b"x" * 1000)
    assert received(connection, b"%d" % (1000 * parts)).startswith(b"HTTP/1.1 200")


def test_time_in_which_the_service_does_not_read_is_not_the_clients(connect):
    connection = connect()
    size = 60_000_000  # more than the system keeps, so that the client has to wait
    sender = threading.Thread(target=connection.sendall, args=[POST % (b"late", size) + b"x" * size])
    sender.start()
    assert received(connection, b"%d" % size).startswith(b"HTTP/1.1 200")
    sender.join()


def test_a_stream_of_events_stays_open(connect):
    connection, end = connect(GET % b"events" + b"\r\n"), time.monotonic() + LONG
    while time.monotonic() < end:
        assert connection.recv(65536)


def test_the_rest_of_a_body_that_was_refused_ends_too(connect):
    connection = connect(POST % (b"refused", 10_000) + b"x")
    assert received(connection, b"no").startswith(b"HTTP/1.1 401")
    drip(connection)


def test_nothing_is_kept_of_ended_connections(service, connect):
    for _ in range(20):
        connect(POST % (b"body", 1000))
    until(lambda: len(service[1].server_state.connections) == 0, 30.0)
    assert not service[1].server_state.tasks


@pytest.mark.parametrize(
    ("end", "status"), [(b"", b"400"), (b"\r\n\r\n", b"431")], ids=["unfinished", "finished"]
)
def test_a_header_beyond_its_size_is_refused_however_it_comes(end, status, store, connect):
    large = b"x" * (MAX_HEADER_BYTES + 1)
    with served(Client(store)._app) as (port, _):
        answer = received(connect(GET % b"live" + b"Connection: close\r\nX-Large: " + large + end, port))
    assert answer.startswith(b"HTTP/1.1 " + status)


def test_bytes_that_are_no_request_are_refused(connect):
    assert received(connect(b"\x16\x03\x01\x02\x00\r\n\r\n")).startswith(b"HTTP/1.1 400")


def test_bodies_in_flight_have_a_budget_with_a_rest_for_small_ones():
    budget = BodyBudget()
    large = 8_000_000
    for _ in range(5):
        budget.change(0, large)
    with pytest.raises(HTTPException, match="no room is left"):
        budget.change(0, large)
    for _ in range(20):
        budget.change(0, 1_000_000)
    budget.change(large, 0)
    budget.change(0, 2_500_000)
    with pytest.raises(HTTPException) as refused:
        budget.change(2_500_000, 45_000_000)
    assert refused.value.status_code == 503


@pytest.mark.parametrize("is_declared", [True, False], ids=["declared", "in chunks"])
def test_a_body_beyond_the_budget_is_refused_and_later_accepted(is_declared, store):
    budget = BodyBudget(100, 100)
    path = "/v1/runs"

    def post(size):
        """Post a body through the limits alone; return status or number of read bytes."""
        chunks = [b"x" * 10] * (size // 10)
        headers = [(b"content-length", b"%d" % size)] if is_declared else []
        scope = {"type": "http", "path": path, "headers": headers}
        messages = [{"type": "http.request", "body": chunk, "more_body": True} for chunk in chunks]
        messages.append({"type": "http.request", "body": b"", "more_body": False})
        read_bytes = 0

        async def receive():
            return messages.pop(0)

        async def app(_, receive, __):
            nonlocal read_bytes
            while (message := await receive())["more_body"]:
                read_bytes += len(message["body"])

        async def call():
            await BodyLimits(app, budget)(scope, receive, None)

        asyncio.run(call())
        return read_bytes

    for _ in range(2):
        with pytest.raises(HTTPException) as refused:
            post(110)
        assert refused.value.status_code == 503
        assert post(100) == 100


@pytest.mark.parametrize(
    ("origin", "scheme", "stated", "is_own"),
    [
        ("http://localhost:8000", "http", None, True),
        ("https://localhost:8000", "http", None, True),  # a proxy with TLS that does not say so
        ("http://localhost:8000", "https", None, False),
        ("https://localhost:8000", "https", None, True),
        ("http://localhost:8000", "http", "https", False),
        ("https://localhost:8000", "http", "https, http", True),
        ("https://localhost:8000", "http", "http", False),
        ("ftp://localhost:8000", "http", None, False),
        ("http://localhost", "http", None, False),
        ("null", "http", None, False),
    ],
)
def test_the_scheme_of_a_page_is_compared_with_that_of_the_request(origin, scheme, stated, is_own):
    headers = [(b"host", b"localhost:8000"), (b"origin", origin.encode())]
    if stated is not None:
        headers.append((b"x-forwarded-proto", stated.encode()))
    scope = {"method": "POST", "path": "/", "query_string": b"", "scheme": scheme, "headers": headers}
    refused = admission.find_refusal(admission.AccessPolicy(), scope | {"type": "http"})
    assert (refused is None) == is_own
