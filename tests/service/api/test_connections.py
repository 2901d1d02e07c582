"""Connections that stop half-way: closed by themselves, while others are answered."""

import asyncio
import json
import logging
import resource
import select
import socket
import sqlite3
import threading
import time
from contextlib import ExitStack, closing, suppress
from datetime import UTC, datetime
from urllib.parse import urlsplit

import h11
import httpx2
import pytest
from fastapi import FastAPI
from support.in_process import served
from support.processes import until
from uvicorn import Config
from uvicorn.server import ServerState

from jointstiff.service.api.answers import ANSWER_HEADERS
from jointstiff.service.api.bodies import EXAMPLES
from jointstiff.service.api.connections import BoundedProtocol, connection_limit
from jointstiff.service.process import ACCESS_LOGGER
from jointstiff.service.security.admission import MAX_ROBOT_BYTES, Posture
from jointstiff.service.security.keys import mint
from jointstiff.service.server import UNREAD_BYTES, UNTAKEN_BYTES, listen
from jointstiff.service.store.store import Store

FOR_EVER = 1e9
HEADER = b"POST /v1/measurement-sets HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
BODY = HEADER + b"Content-Length: 1000000\r\n\r\n{"


class Patient(BoundedProtocol):
    """Bounds of which each test shortens one."""

    HEADER_SECONDS = FOR_EVER
    BODY_SECONDS = FOR_EVER
    BODY_RATE = FOR_EVER
    WRITE_SECONDS = FOR_EVER
    LOOK_SECONDS = 0.05


@pytest.fixture
def serve():
    with ExitStack() as stack:
        store = stack.enter_context(Store.open("sqlite://"))
        yield lambda **bounds: stack.enter_context(served(store, type("Bounded", (Patient,), bounds)))


@pytest.fixture
def connect():
    with ExitStack() as stack:

        def to(url: str, window: int | None = None) -> socket.socket:
            address = urlsplit(url)
            connection = stack.enter_context(socket.socket())
            connection.settimeout(60)
            if window is not None:  # of what is not read, the kernel keeps so much only
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, window)
            connection.connect((address.hostname, address.port))
            return connection

        yield to


def ended(connection: socket.socket) -> bytes:
    """Return what comes before the service closes the connection; a timeout fails the test."""
    received = b""
    try:
        while part := connection.recv(65536):
            received += part
    except ConnectionResetError:
        pass
    return received


@pytest.mark.parametrize(
    ("bound", "sent"),
    [
        ("HEADER_SECONDS", b""),
        ("HEADER_SECONDS", b"GET /heal"),
        ("HEADER_SECONDS", HEADER),
        ("BODY_SECONDS", BODY),
    ],
    ids=["nothing", "half a line", "half a header", "half a body"],
)
def test_each_part_of_a_request_has_its_time(bound, sent, serve, connect):
    url = serve(**{bound: 0.3})
    connection = connect(url)
    connection.sendall(sent)
    assert ended(connection) == b""
    assert httpx2.get(f"{url}/live").status_code == 204


def test_a_header_that_drips_has_its_time_after_an_answer_too(serve, connect):
    connection = connect(serve(HEADER_SECONDS=0.5))
    connection.sendall(b"GET /live HTTP/1.1\r\nHost: localhost\r\n\r\nGET /li")
    assert ended(connection).startswith(b"HTTP/1.1 204")


def test_a_request_with_two_lengths_is_the_last_of_its_connection(serve, connect):
    connection = connect(serve())
    twice = b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n"
    connection.sendall(
        b"POST /v1/nothing HTTP/1.1\r\nHost: localhost\r\n"
        + twice
        + b"0\r\n\r\nGET /live HTTP/1.1\r\nHost: localhost\r\n\r\n"
    )
    answers = ended(connection)
    assert answers.count(b"HTTP/1.1 ") == 1
    assert b" 204 " not in answers


LARGE = b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n"


def test_an_answer_that_is_not_read_is_given_up(serve, connect):
    """By the pause alone: no rate is asked for."""
    url = serve(WRITE_SECONDS=0.3, ANSWER_RATE=0.0)
    connection = connect(url, window=4096)
    with pytest.raises(ConnectionError):  # the service stops reading, then ends the connection
        connection.sendall(LARGE * 200_000)
    assert httpx2.get(f"{url}/live").status_code == 204


def test_an_answer_that_is_read_too_slowly_is_given_up(serve, connect):
    """By the rate alone: it never pauses."""
    url = serve(WRITE_SECONDS=1.0, ANSWER_RATE=1e9)
    size = len(httpx2.get(f"{url}/openapi.json", timeout=60).content)
    connection, received = connect(url, window=65536), 0
    connection.sendall(LARGE * 200)
    with suppress(ConnectionError):
        while part := connection.recv(65536):
            received += len(part)
            time.sleep(0.01)
    assert 65536 < received < 200 * size
    assert httpx2.get(f"{url}/live").status_code == 204


def test_large_answers_are_bounded_together(serve, connect, caplog):
    caplog.set_level(logging.INFO, ACCESS_LOGGER)
    size = len(httpx2.get(f"{serve()}/openapi.json", timeout=60).content)
    url = serve(ANSWER_BYTES=3 * size, PIECE_BYTES=4096)
    readers = [connect(url, window=4096) for _ in range(3)]
    for reader in readers:  # of answers that the kernel cannot take, one after the other
        reader.sendall(LARGE * 20)
        assert reader.recv(12) == b"HTTP/1.1 200"
    deadline = time.monotonic() + 60
    while (refused := httpx2.get(f"{url}/openapi.json", timeout=60)).status_code == 200:
        assert time.monotonic() < deadline
    assert refused.status_code == 503
    assert refused.json()["remedy"] == "try again later"
    assert int(refused.headers["Retry-After"]) > 0
    # the line follows the answer, and the metrics count what it says
    until(lambda: 503 in [getattr(record, "status", None) for record in caplog.records])
    assert httpx2.get(f"{url}/live").status_code == 204  # small ones are answered
    for reader in readers:
        reader.close()
    while httpx2.get(f"{url}/openapi.json").status_code == 503:  # until it is seen that they have left
        assert time.monotonic() < deadline


def test_the_oldest_silent_connection_makes_room(serve, connect):
    url = serve(CONNECTIONS=4)
    oldest = connect(url)
    connections = [connect(url) for _ in range(3)]
    assert httpx2.get(f"{url}/live").status_code == 204
    assert ended(oldest) == b""
    connections[-1].sendall(b"GET /live HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
    assert ended(connections[-1]).startswith(b"HTTP/1.1 204")


def test_who_goes_on_does_not_make_room_in_its_turn(serve, connect):
    url = serve(CONNECTIONS=3)
    first, second, third = (connect(url) for _ in range(3))
    connect(url)
    assert ended(first) == b""
    second.sendall(b"GET /live HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert second.recv(65536).startswith(b"HTTP/1.1 204")
    connect(url)
    assert ended(third) == b""
    second.sendall(b"GET /live HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
    assert ended(second).startswith(b"HTTP/1.1 204")


def test_unfinished_bodies_are_bounded_together(serve, connect):
    """Each stays below the 64 KiB at which the server stops to read, so that all of it counts."""
    url = serve(BODY_BYTES=200_000)
    connections = [connect(url) for _ in range(4)]
    for connection in connections[:3]:
        connection.sendall(BODY + b" " * 60_000)
        assert httpx2.get(f"{url}/live").status_code == 204
    connections[3].sendall(BODY + b" " * 60_000)
    answer = ended(connections[3])
    assert answer.startswith(b"HTTP/1.1 503")
    assert b"Retry-After: " in answer
    assert b"urn:jointstiff:problem:service-unavailable" in answer
    for name, value in ANSWER_HEADERS.items():
        assert f"\r\n{name}: {value}\r\n".encode() in answer
    for connection in connections[:3]:
        connection.close()
    robot = EXAMPLES["robots"]["modified DH"]
    while (
        httpx2.post(f"{url}/v1/robots", json=robot).status_code == 503
    ):  # until the others are seen to be gone
        pass


@pytest.mark.parametrize("leaves", [False, True], ids=["wait", "leave"])
def test_bodies_that_are_worked_on_count_until_they_are_done(leaves, tmp_path, connect):
    """Complete bodies of 90 kB wait for a locked database, their clients with them or not."""
    path = tmp_path / "jointstiff.db"
    body = json.dumps(EXAMPLES["robots"]["modified DH"]).encode().ljust(90_000)
    request = b"POST /v1/robots HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    request += b"Connection: close\r\nContent-Length: 90000\r\n\r\n" + body
    with (
        Store.open(f"sqlite:///{path}") as store,
        served(store, type("Bounded", (Patient,), {"BODY_BYTES": 300_000})) as url,
        closing(sqlite3.connect(path, isolation_level=None)) as other,
    ):
        other.execute("BEGIN IMMEDIATE")
        connections = [connect(url) for _ in range(6)]
        for number, connection in enumerate(connections):
            connection.sendall(request)
            if leaves and number < 3:
                connection.close()
        waiting = connections[3:] if leaves else connections
        refused, _, _ = select.select(waiting, [], [], 60)
        assert refused
        for connection in refused:
            assert ended(connection).startswith(b"HTTP/1.1 503")
        assert httpx2.get(f"{url}/live").status_code == 204
        other.execute("ROLLBACK")
        answers = [ended(connection) for connection in waiting if connection not in refused]
        assert not any(answer and answer[9:12] not in (b"201", b"503") for answer in answers)
        headers = {"Content-Type": "application/json"}
        while httpx2.post(f"{url}/v1/robots", content=body, headers=headers).status_code == 503:
            pass  # until the work for those who left has ended
        for _ in range(4):  # all is given back
            assert httpx2.post(f"{url}/v1/robots", content=body, headers=headers).status_code == 201


LARGE_ROBOT = {
    "content": json.dumps(EXAMPLES["robots"]["modified DH"]).encode().ljust(90_000),
    "headers": {"Content-Type": "application/json"},
    "timeout": 60,
}


def test_a_large_body_that_lags_gives_up_its_turn(serve, connect):
    url = serve(TURNS=1)
    lagging = connect(url)
    lagging.sendall(BODY)
    assert httpx2.post(f"{url}/v1/robots", **LARGE_ROBOT).status_code == 201
    assert ended(lagging) == b""


def test_large_bodies_wait_for_a_turn_and_others_do_not(serve, connect):
    url = serve(TURNS=1, BODY_RATE=1.0, TURN_SECONDS=0.3)
    holder = connect(url)
    holder.sendall(BODY + b" " * 90_000)
    assert httpx2.post(f"{url}/v1/robots", json=EXAMPLES["robots"]["modified DH"]).status_code == 201
    too_large = LARGE_ROBOT | {"content": b" " * (MAX_ROBOT_BYTES + 1)}
    assert httpx2.post(f"{url}/v1/robots", **too_large).status_code == 413
    for undeclared in (False, True):
        large = {"content": iter((LARGE_ROBOT["content"],))} if undeclared else {}
        waited = httpx2.post(f"{url}/v1/robots", **LARGE_ROBOT | large)
        assert waited.status_code == 503
        assert int(waited.headers["Retry-After"]) > 0
    assert not select.select([holder], [], [], 0)[0]
    holder.close()
    while httpx2.post(f"{url}/v1/robots", **LARGE_ROBOT).status_code == 503:  # until it is seen to be gone
        pass


def test_turns_go_to_who_waits_longest(serve, connect):
    """Who comes back after each answer does not starve who has waited, with more to send than is read."""
    url = serve(TURNS=1, LOOK_SECONDS=60.0)
    holder, first, second = connect(url), connect(url), connect(url)
    holder.sendall(BODY + b" " * 90_000)
    robot = LARGE_ROBOT["content"].ljust(MAX_ROBOT_BYTES)
    head = b"POST /v1/robots HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    patient = threading.Thread(
        target=first.sendall, args=(head + b"Content-Length: %d\r\n\r\n" % len(robot) + robot,)
    )
    patient.start()
    time.sleep(0.5)
    # All but a byte: with the turn it would keep the first one waiting for as long as nobody looks.
    second.sendall(head + b"Content-Length: 90000\r\n\r\n" + LARGE_ROBOT["content"][:-1])
    time.sleep(0.5)
    holder.close()
    answered, _, _ = select.select([first, second], [], [], 30.0)
    assert answered == [first]
    patient.join()


def test_the_role_is_asked_before_the_turn(connect):
    posture = Posture.of("127.0.0.1", (), access_control=True, require_key=True)
    operator, viewer = (mint(role, role, datetime.now(UTC), None) for role in ("operator", "viewer"))
    with Store.open("sqlite://") as store:
        for each in (operator, viewer):
            store.keys.add(each.record)
        with served(store, type("Bounded", (Patient,), {"TURNS": 1, "BODY_RATE": 1.0}), posture) as url:
            bearer = f"Authorization: Bearer {operator.text}\r\nContent-Length: 1000000\r\n\r\n".encode()
            holder = connect(url)
            holder.sendall(HEADER + bearer + b" " * 90_000)
            for key, status in ((None, 401), (viewer.text, 403)):
                headers = LARGE_ROBOT["headers"] | ({"Authorization": f"Bearer {key}"} if key else {})
                answer = httpx2.post(f"{url}/v1/robots", **LARGE_ROBOT | {"headers": headers})
                assert answer.status_code == status
            holder.close()


def test_a_body_that_proves_small_ends_its_turn(tmp_path, connect):
    """One of unknown length that waits for a locked database keeps no turn."""
    path = tmp_path / "jointstiff.db"
    with (
        Store.open(f"sqlite:///{path}") as store,
        served(store, type("Bounded", (Patient,), {"TURNS": 1, "TURN_SECONDS": 5.0})) as url,
        closing(sqlite3.connect(path, isolation_level=None)) as other,
    ):
        other.execute("BEGIN IMMEDIATE")
        robot, waiting = json.dumps(EXAMPLES["robots"]["modified DH"]).encode(), connect(url)
        head = b"POST /v1/robots HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        chunked = head + b"Transfer-Encoding: chunked\r\n\r\n"
        waiting.sendall(chunked + b"%x\r\n%s\r\n0\r\n\r\n" % (len(robot), robot))
        large = LARGE_ROBOT | {"content": b"?" * 90_000}
        assert httpx2.post(f"{url}/v1/robots", **large).status_code == 422
        assert not select.select([waiting], [], [], 0)[0]
        other.execute("ROLLBACK")
        assert waiting.recv(12) == b"HTTP/1.1 201"


def test_what_the_system_keeps_of_a_connection_is_bounded():
    """Of 64 unread bodies it would keep so much that it drops what others send."""
    with listen("127.0.0.1", 0, "--port") as listener, socket.create_connection(listener.getsockname()):
        accepted, _ = listener.accept()
        with accepted:
            sizes = (
                accepted.getsockopt(socket.SOL_SOCKET, which)
                for which in (socket.SO_RCVBUF, socket.SO_SNDBUF)
            )
            # Linux doubles them; sizes that it chooses itself grow to megabytes.
            assert tuple(sizes) == (2 * UNREAD_BYTES, 2 * UNTAKEN_BYTES)


def apart(**bounds) -> type[BoundedProtocol]:
    """Return a protocol that shares neither turns nor the order of who makes room with others."""
    return type("Apart", (BoundedProtocol,), {"_turns": {}, "_waiting": {}, "_slow": [], **bounds})


class Line:
    """A client's end of a connection, and the clock: a test winds it, and says what the client has taken."""

    def __init__(self, received: bytes, now: float = 100.0, state=None, protocol=BoundedProtocol) -> None:
        self.now, self.unsent, self.delay, self.is_gone = now, 0, 0.0, False
        self.time, self.is_closing = lambda: self.now, lambda: self.is_gone
        self.get_write_buffer_size, self.get_extra_info = lambda: self.unsent, lambda *_: None
        self.protocol = protocol(Config(FastAPI(), log_config=None), state or ServerState(), {}, self)
        self.protocol.connection_made(self)
        if received:
            self.protocol.conn.receive_data(received)
        while self.protocol.conn.next_event() not in (h11.NEED_DATA, h11.PAUSED):
            pass

    def call_later(self, delay, _look):
        self.delay = delay

    def abort(self):
        self.is_gone = True
        self.protocol.connections.discard(self.protocol)

    def ends(self, handed=lambda _: 0, taken=lambda _: 0):
        """Return the second in which the connection is given up; None if it lives for a minute and a half."""
        for second in range(1, 91):
            self.now = 100.0 + second
            self.protocol._handed = handed(second)
            self.unsent = max(0, handed(second) - taken(second))
            self.protocol._look()
            if self.is_gone:
                return second
            assert 0.0 < self.delay <= 1.0
        return None


ASKED = b"GET / HTTP/1.1\r\nHost: a\r\n\r\n"


@pytest.mark.parametrize(
    ("handed", "taken", "second"),
    [
        (lambda _: 0, lambda _: 0, None),  # the service computes
        (lambda _: 1_000_000, lambda _: 0, 20),
        (lambda _: 1_000_000, lambda s: 4_000 * s, 20),
        (lambda _: 1_000_000, lambda s: 5_000 * s, None),
        (lambda _: 1_000_000, lambda s: 500_000 * (s >= 19), 39),
        (lambda _: 1_000_000, lambda s: 500_000 + s, 40),  # the second twenty seconds are too slow
        (lambda s: 1_000_000 * (s >= 45), lambda s: 5_000 * max(0, s - 45), None),
        (lambda s: 1_000_000 * (s >= 45), lambda _: 0, 64),  # handed over after the look at 44 s
    ],
)
def test_an_answer_is_taken_at_4_kib_a_second_with_no_pause_of_20_s(handed, taken, second):
    assert Line(ASKED).ends(handed, taken) == second


def test_a_header_has_ten_seconds_and_a_body_thirty_and_one_for_each_64_kib():
    line = Line(b"")
    line.now += 9.75
    line.protocol._look()
    assert (line.delay, line.protocol.lags_since(), Line(b"").ends()) == (0.25, 101.0, 10)
    for received, second in ((0, 30), (10 * 65536, 40)):
        line = Line(BODY)
        line.protocol._received = received
        assert line.protocol.lags_since() == 70 + second
        assert line.ends() == second
    line = Line(BODY)
    line.protocol.flow.read_paused = True  # the service keeps it waiting
    assert line.protocol.lags_since() == float("inf")


@pytest.mark.parametrize(("goes_on", "order"), [(False, "header answer body"), (True, "header body answer")])
def test_who_lags_for_longest_makes_room(goes_on, order):
    """A header since 190 s, with a second more; an answer since 193 s; a body, by its rate since 195 s."""
    shared, closed = (ServerState(), apart(CONNECTIONS=4)), []
    began = {"body": (BODY, 180.0), "header": (b"", 190.0), "answer": (ASKED, 193.0), "none": (ASKED, 170.0)}
    lines = {name: Line(*each, *shared) for name, each in began.items()}
    lines["body"].protocol._received = 15 * 65536
    answer = lines["answer"]
    answer.unsent = answer.protocol._handed = 2
    for _ in range(3):
        assert not Line(b"", 200.0, *shared).is_gone
        closed += [name for name, line in lines.items() if line.is_gone and name not in closed]
        answer.unsent, answer.now = 1 if goes_on else 2, 199.0
    assert closed == order.split()
    working = ServerState(), apart(CONNECTIONS=4)
    for line in [Line(ASKED, 200.0, *working) for _ in range(4)]:
        assert Line(b"", 200.0, *working).is_gone  # nobody else keeps the service waiting
        assert not line.is_gone


@pytest.mark.parametrize("size", [0, 1, 65536, 65537, 131072, 131073])
def test_an_answer_goes_piece_by_piece_and_counts_while_it_is_under_way(size):
    """All large ones together have room for two pieces."""
    bounded, content, sent = apart(ANSWER_BYTES=131072), bytes(range(251)) * 523, []

    async def application(_scope, _receive, send):
        headers = [(b"content-length", b"%d" % size)]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        assert bounded._answering == (size if 65536 < size <= 131072 else 0)
        await send({"type": "http.response.body", "body": content[:size]})

    async def send(message):
        sent.append(message)

    protocol = Line(ASKED, protocol=bounded).protocol
    protocol._application, protocol.cycle = application, type("Cycle", (), {"body": bytearray()})()
    asyncio.run(protocol._answer({"type": "http", "headers": []}, None, send))
    assert (sent[0]["status"], bounded._answering) == (503 if size > 131072 else 200, 0)
    if size <= 131072:
        pieces = [each["body"] for each in sent[1:]]
        assert (b"".join(pieces), protocol._handed) == (content[:size], size)
        assert max(map(len, pieces)) <= 65536
        assert [each.get("more_body", False) for each in sent[1:]] == [True] * (len(pieces) - 1) + [False]


def test_the_bounds_are_as_documented():
    assert (BoundedProtocol.HEADER_SECONDS, BoundedProtocol.BODY_SECONDS) == (10, 30)
    assert (BoundedProtocol.TURNS, BoundedProtocol.TURN_SECONDS) == (2, 30)
    assert (BoundedProtocol.WRITE_SECONDS, BoundedProtocol.ANSWER_RATE) == (20, 4096)


@pytest.mark.parametrize(
    ("descriptors", "most"),
    [(256, 128), (512, 256), (1024, 768), (20_000, 8192), (resource.RLIM_INFINITY, 8192)],
)
def test_connections_leave_descriptors_to_files(descriptors, most, monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda _: (descriptors, -1))
    assert connection_limit() == most
