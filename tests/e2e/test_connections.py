"""Slow, silent and hostile connections over real sockets: to the service, and to Caddy in front of it."""

import json
import resource
import select
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from datetime import UTC, datetime
from itertools import product
from pathlib import Path
from urllib.parse import urlsplit

import httpx2
import pytest
from support.processes import Service
from support.proxy import proxied

from jointstiff.service.api.examples import EXAMPLES
from jointstiff.service.security.keys import make_key
from jointstiff.service.store.store import Store

pytestmark = pytest.mark.process

HEADER_SECONDS, BODY_SECONDS, ANSWER_SECONDS, IDLE_SECONDS = 10, 180, 300, 60
"""Times of docker/Caddyfile."""
LATE_SECONDS = 10
"""Time that a loaded machine may add."""
GET = b"GET /live HTTP/1.1\r\nHost: localhost\r\n"
POST = b"POST /v1/%s HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
ROBOT = EXAMPLES["robots"]["modified DH"]
CAMPAIGN = EXAMPLES["campaigns"]["positions"]
CLIENTS, BODY_BYTES = 8, 300_000


@pytest.fixture(scope="module")
def behind(services, tmp_path_factory):
    """The address of Caddy in front of the service."""
    with proxied(tmp_path_factory.mktemp("caddy"), services("sqlite").url) as url:
        yield url


@pytest.fixture(params=["direct", "behind Caddy"])
def url(request, services):
    return services("sqlite").url if request.param == "direct" else request.getfixturevalue("behind")


@pytest.fixture
def connect():
    with ExitStack() as stack:

        def to(url: str, window: int | None = None) -> socket.socket:
            address = urlsplit(url)
            connection = stack.enter_context(socket.socket())
            connection.settimeout(60)
            if window is not None:  # the kernel keeps so many unread bytes of the answer, no more
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, window)
            connection.connect(("127.0.0.1", address.port))
            return connection

        yield to


def received(connection: socket.socket) -> bytes:
    """Return the bytes that come before the other side closes the connection; a timeout fails the test."""
    content = b""
    try:
        while part := connection.recv(65536):
            content += part
    except ConnectionResetError:
        pass
    return content


@pytest.mark.parametrize(
    ("path", "body"), [(b"robots", ROBOT), (b"campaigns", CAMPAIGN)], ids=["robots", "campaigns"]
)
def test_eight_clients_that_pause_five_seconds_in_a_body_of_300_kb_get_eight_answers(
    path, body, url, connect
):
    content = json.dumps(body).encode().ljust(BODY_BYTES)
    head = POST % path + b"Connection: close\r\nContent-Length: %d\r\n\r\n" % len(content)

    def post(connection: socket.socket) -> bytes:
        connection.sendall(head + content[: BODY_BYTES // 2])
        time.sleep(5)
        connection.sendall(content[BODY_BYTES // 2 :])
        return received(connection)

    with ThreadPoolExecutor(CLIENTS) as pool:
        answers = list(pool.map(post, [connect(url) for _ in range(CLIENTS)]))
    assert [answer[:12] for answer in answers] == [b"HTTP/1.1 201"] * CLIENTS


def test_a_role_is_required_before_the_body_is_sent(tmp_path, connect):
    """A client without a key, or with one of another role, gets its answer in the first bytes of a body."""
    database = f"sqlite:///{tmp_path / 'jointstiff.db'}"
    viewer = make_key("viewer", "viewer", datetime.now(UTC), None)
    with Store.open(database) as store:
        store.keys.add(viewer.record)
    service = Service(database, "--workers", "0", "--require-key")
    keys = {b"401": b"", b"403": b"Authorization: Bearer %s\r\n" % viewer.text.encode()}
    try:
        with proxied(tmp_path, service.url) as behind:
            for url, status in product((service.url, behind), keys):
                connection, sent = connect(url), 0
                connection.sendall(POST % b"robots" + keys[status] + b"Content-Length: 1000000\r\n\r\n")
                while not select.select([connection], [], [], 0.2)[0]:
                    connection.sendall(b" ")  # Caddy answers after it has read a byte
                    sent += 1
                    assert sent < 50
                assert connection.recv(12) == b"HTTP/1.1 " + status
    finally:
        service.stop()


def test_bytes_that_are_no_request_are_answered_400(url, connect):
    connection = connect(url)
    connection.sendall(b"nonsense\r\n\r\n")
    assert received(connection).startswith(b"HTTP/1.1 400")
    assert httpx2.get(f"{url}/live").status_code == 204


def test_a_header_beyond_its_limit_is_refused(url, connect):
    connection = connect(url)
    connection.sendall(GET + b"X-Large: " + b"x" * 40_000)
    assert received(connection)[:12] in (b"HTTP/1.1 400", b"HTTP/1.1 431")


def test_a_body_of_undeclared_length_is_refused_at_its_limit(url):
    chunks = iter([b" " * 65536] * 1000)  # 64 MB
    with httpx2.Client(timeout=60) as client:
        try:
            answer = client.post(
                f"{url}/v1/robots", content=chunks, headers={"Content-Type": "application/json"}
            )
        except httpx2.TransportError:  # it closed the connection while we were sending
            return
    assert answer.status_code == 413


@pytest.mark.parametrize(
    ("first", "drip"),
    [(b"", b""), (b"GET /li", b""), (GET, b""), (GET, b"X")],
    ids=["nothing", "half a line", "half a header", "a header that drips"],
)
def test_caddy_closes_a_connection_without_a_whole_header_after_ten_seconds(first, drip, behind, connect):
    connection, began = connect(behind), time.monotonic()
    connection.sendall(first)
    while not select.select([connection], [], [], 1.0)[0]:
        assert time.monotonic() - began < HEADER_SECONDS + LATE_SECONDS
        if drip:
            connection.sendall(drip)
    assert time.monotonic() - began > HEADER_SECONDS - 1
    assert received(connection)[:12] in (b"", b"HTTP/1.1 400", b"HTTP/1.1 408")


def descriptors(service: Service) -> int:
    return len(list(Path(f"/proc/{service.process.pid}/fd").iterdir()))


def test_silent_connections_to_caddy_do_not_reach_the_service(behind, services, connect):
    before = descriptors(services("sqlite"))
    silent = [connect(behind) for _ in range(200)]
    assert httpx2.get(f"{behind}/live").status_code == 204
    assert descriptors(services("sqlite")) < before + 20
    for connection in silent:
        connection.close()


def test_a_service_allows_itself_more_connections_than_its_shell(tmp_path, connect):
    """A shell's soft limit is 1,024; the service answers with more silent connections than that."""
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    limit = ("prlimit", f"--nofile=128:{hard}")
    service = Service(f"sqlite:///{tmp_path / 'jointstiff.db'}", "--workers", "0", prefix=limit)
    try:
        for _ in range(300):
            connect(service.url)
        assert httpx2.get(f"{service.url}/health").status_code == 200
    finally:
        service.stop()


def lasted(connection: socket.socket, sent: bytes) -> float:
    """Send bytes each second until the other side ends the connection; return the time until then [s]."""
    began = time.monotonic()
    connection.settimeout(1.0)
    while time.monotonic() - began < ANSWER_SECONDS + 60:
        try:
            connection.sendall(sent)
            if sent.startswith(b"GET"):  # never read an answer
                continue
            if not connection.recv(65536):
                break
        except TimeoutError:
            continue
        except OSError:
            break
        time.sleep(1.0)
    return time.monotonic() - began


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_caddy_ends_a_body_an_unread_answer_and_an_idle_connection_in_their_time(behind, connect):
    """A body that drips, answers that nobody reads, a connection without a second request."""
    body, answer, idle = connect(behind), connect(behind, window=4096), connect(behind)
    body.sendall(POST % b"robots" + b"Content-Length: 100000\r\n\r\n")
    idle.sendall(GET + b"\r\n")
    assert idle.recv(65536).startswith(b"HTTP/1.1 204")
    request = b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(lasted, (body, answer, idle), (b" ", request, b"")))
    for seconds, bound in zip(found, (BODY_SECONDS, ANSWER_SECONDS, IDLE_SECONDS), strict=True):
        assert bound - 2 < seconds < bound + LATE_SECONDS


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_caddy_closes_a_silent_follower_of_an_open_set_in_its_time(behind, connect):
    """By the second comment: the client comes back; a stream that stays open would lose an event."""
    robot = httpx2.post(f"{behind}/v1/robots", json=ROBOT).json()["id"]
    opened = EXAMPLES["measurement_sets"]["open, measured live"] | {"robot_id": robot}
    answer = httpx2.post(f"{behind}/v1/measurement-sets", json=opened)
    assert answer.status_code == 201, answer.text
    connection, began = connect(behind), time.monotonic()
    address = f"{answer.headers['Location']}/next?follow=true"
    connection.sendall(f"GET {address} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    content = received(connection)
    assert ANSWER_SECONDS - 2 < time.monotonic() - began < ANSWER_SECONDS + 2 * 15 + LATE_SECONDS
    assert content.count(b"event: state") == 1
    assert content.count(b": ping") >= 15


def test_caddy_refuses_a_body_that_no_request_may_have_in_size(behind):
    as_json = {"Content-Type": "application/json"}
    refused = httpx2.post(f"{behind}/v1/robots", content=bytes(18_000_000), headers=as_json, timeout=60)
    assert refused.status_code == 413
