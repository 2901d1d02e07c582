"""Connections of clients: no silent or slow client keeps its connection for ever.

uvicorn itself ends connections that are idle between two requests. `LimitedConnection` extends uvicorn's
protocol by times for headers, bodies and unread answers, and by a number of connections for each address.
uvicorn has no such limits, and takes a class of protocol by its option `http`. The class that is extended is
not public: `pyproject.toml` caps uvicorn's minor version.
"""

from __future__ import annotations

import asyncio
import ipaddress
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from functools import partial
from typing import Any, Final, NamedTuple, cast

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from jointstiff.schemas.finding import Problem
from jointstiff.service.api.answers import answer_problem
from jointstiff.service.problems import http_problem
from jointstiff.service.security.access import get_network
from jointstiff.service.security.admission import MAX_HEADER_BYTES, is_loopback, make_header_problem

CONNECTIONS_PER_ADDRESS: Final = 50
"""Default of the greatest number of connections of one address (`serve --connections-per-address`)."""
_CHECKS_PER_SILENCE: Final = 10
"""Number of checks of each connection in the time of the longest silence."""
_LINGER_CHECKS: Final = 5
"""Number of checks for which a refused client may still send its body, and read its answer."""
_MOST_UNWANTED: Final = 256 * 1024
"""Bytes of a body that are read after its request was answered [bytes]; with more, the connection ends."""


@dataclass(frozen=True)
class ConnectionLimits:
    """Limits of the connections of a service."""

    silence: float = 10.0  # time for a whole header, and for a pause within a body [s]
    mean_after: float = 20.0  # time from which the mean speed of a body is limited [s]
    least_speed: float = 50_000.0  # mean speed of a body [bytes/s]
    unread: float = 60.0  # time for which a client may leave an answer unread [s]
    per_address: int = CONNECTIONS_PER_ADDRESS  # connections of one address


class Connections:
    """All connections of a service, which are checked at regular times. They belong to one event loop."""

    def __init__(self, limits: ConnectionLimits, is_counted: Callable[[str], bool]) -> None:
        """Prepare the limits of connections.

        Args:
            limits: limits of all connections.
            is_counted: function that returns whether the connections of an address are counted.
        """
        self.limits = limits
        self._is_counted = is_counted
        self._open: set[LimitedConnection] = set()
        self._of_address: dict[str, list[LimitedConnection]] = defaultdict(list)  # oldest connection first
        self._pause = limits.silence / _CHECKS_PER_SILENCE  # time between two checks [s]
        self._next_check: asyncio.TimerHandle | None = None

    def make_protocol(self) -> type[asyncio.Protocol]:
        """Return what uvicorn calls for the protocol of a new connection."""
        return cast("type[asyncio.Protocol]", partial(LimitedConnection, self))

    def add(self, connection: LimitedConnection, address: str) -> bool:
        """Add a new connection; return whether its address may have one more connection.

        An address that has all its connections loses the oldest idle one.
        """
        self._open.add(connection)
        if self._next_check is None:
            self._next_check = connection.loop.call_later(self._pause, self._check)
        if not self._is_counted(address):
            return True
        others = self._of_address[get_network(address)]
        others.append(connection)
        if len(others) <= self.limits.per_address:
            return True
        idle = [other for other in others if other is not connection and other.is_idle()]
        if not idle:
            return False
        others.remove(idle[0])
        idle[0].shutdown()
        return True

    def remove(self, connection: LimitedConnection, address: str) -> None:
        """Remove a connection that has ended."""
        self._open.discard(connection)
        network = get_network(address)
        others = self._of_address.get(network, [])
        if connection in others:
            others.remove(connection)
        if not others:
            self._of_address.pop(network, None)

    def _check(self) -> None:
        """Check all connections, and again after a pause while there are any."""
        for connection in list(self._open):
            connection.check(self._pause)
        self._next_check = None
        if self._open:
            loop = next(iter(self._open)).loop
            self._next_check = loop.call_later(self._pause, self._check)


def count_by_address(proxies: str | None) -> Callable[[str], bool]:
    """Return the function that tells whether the connections of an address are counted.

    Addresses of this machine and of trusted proxies are not counted: several clients may share one.

    Args:
        proxies: addresses and networks of trusted proxies, separated by commas; `*` for all; None for none.
    """
    names = [name.strip() for name in (proxies or "").split(",")]
    networks = []
    for name in names:
        try:
            networks.append(ipaddress.ip_network(name, strict=False))
        except ValueError:
            continue  # the name of a socket, or `*`

    def is_counted(address: str) -> bool:
        """Return whether the connections of an address are counted."""
        if "*" in names or is_loopback(address):
            return False
        try:
            parsed = ipaddress.ip_address(address)
        except ValueError:
            return False  # no address of the network, such as that of a Unix socket
        return not any(parsed in network for network in networks)

    return is_counted


class _Awaited(Enum):
    """Part of a request that a connection awaits."""

    NOTHING = auto()  # the service works on an answer, or the client may rest between two requests
    HEADER = auto()  # the rest of a header
    BODY = auto()  # the rest of a body


class _Stage(NamedTuple):
    """Stage of a connection: what is awaited, and for which request."""

    awaited: _Awaited
    request: RequestResponseCycle | None


class LimitedConnection(H11Protocol):
    """uvicorn's protocol of a connection, with times for headers, bodies and unread answers."""

    def __init__(self, connections: Connections, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - uvicorn's
        super().__init__(*args, **kwargs)
        self._connections = connections
        self._address = ""
        self._stage: _Stage | None = None  # at the last check
        self._waited = 0.0  # time of the stage in which the client could send [s]
        self._silent = 0.0  # time since the last byte of the client [s]
        self._received = 0  # bytes of the stage
        self._unread = 0.0  # time since the client read a byte of its answer [s]
        self._unsent = 0  # bytes of answers that the client has not read yet
        self._unwanted = 0  # bytes of a body whose request was answered before
        self._lingers_for: int | None = None  # checks until a refused connection is cut; None if not refused

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin a connection; refuse it if its address has too many."""
        super().connection_made(transport)
        self._address = self.client[0] if self.client else ""
        if not self._connections.add(self, self._address):
            self._refuse(
                http_problem(
                    503,
                    f"your address has {self._connections.limits.per_address} connections, all in use",
                    "close some of them; for a proxy, name its address in FORWARDED_ALLOW_IPS; "
                    "`serve --connections-per-address NUMBER` allows more",
                )
            )

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection that has ended."""
        self._connections.remove(self, self._address)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read bytes of the client; throw those away that follow a refused request."""
        if self._lingers_for is not None:
            return
        self._silent = 0.0
        self._received += len(data)
        super().data_received(data)
        is_unwanted = self.conn.our_state is h11.DONE and self.conn.their_state is h11.SEND_BODY
        self._unwanted = self._unwanted + len(data) if is_unwanted else 0
        if self._unwanted > _MOST_UNWANTED:
            self._end_after_answer()

    def is_idle(self) -> bool:
        """Return whether the client may lose this connection: it has sent nothing of its next request."""
        has_sent_nothing = self.cycle is None and not self.conn.trailing_data[0]
        return has_sent_nothing or self._rests()

    def _rests(self) -> bool:
        """Return whether the client rests between two requests; uvicorn ends the rest after its time."""
        return self.timeout_keep_alive_task is not None and not self.conn.trailing_data[0]

    def check(self, seconds: float) -> None:
        """End the connection if its client is too slow; `seconds` is the time since the last check [s]."""
        if self._lingers_for is not None:
            self._lingers_for -= 1
            if self._lingers_for < 0:
                self.transport.abort()
        elif not self._is_read(seconds):
            self.transport.abort()
        else:
            self._check_sender(seconds)

    def _is_read(self, seconds: float) -> bool:
        """Return whether the client still reads its answers, `seconds` after the last check."""
        unsent = self.transport.get_write_buffer_size()
        reads = unsent == 0 or unsent < self._unsent
        self._unread = 0.0 if reads else self._unread + seconds
        self._unsent = unsent
        return self._unread < self._connections.limits.unread

    def _check_sender(self, seconds: float) -> None:
        """Refuse a header or a body that comes too slowly, `seconds` after the last check."""
        stage = self._find_stage()
        if stage != self._stage:
            self._stage = stage
            self._waited, self._silent, self._received = 0.0, 0.0, 0
            return
        if stage.awaited is _Awaited.NOTHING or not self._may_send():
            return
        self._waited += seconds
        self._silent += seconds
        limits = self._connections.limits
        if stage.awaited is _Awaited.HEADER:
            if self._waited >= limits.silence:
                self._end_header()
            return
        is_below_mean = self._received < limits.least_speed * self._waited
        if self._silent >= limits.silence or (self._waited >= limits.mean_after and is_below_mean):
            self._refuse(
                http_problem(
                    408,
                    f"the body came too slowly: nothing for {limits.silence:g} s, or less than "
                    f"{limits.least_speed / 1e3:g} kB/s in {limits.mean_after:g} s",
                    "send the request again over a faster connection, or less data in one request",
                )
            )

    def _find_stage(self) -> _Stage:
        """Return what the connection awaits of its client at present."""
        request = self.cycle
        if request is None or request.response_complete:
            return _Stage(_Awaited.NOTHING if self._rests() else _Awaited.HEADER, request)
        return _Stage(_Awaited.BODY if request.more_body else _Awaited.NOTHING, request)

    def _may_send(self) -> bool:
        """Return whether the client can send: the service reads, and no client waits for `100 Continue`."""
        awaits_continue = self.cycle is not None and self.cycle.waiting_for_100_continue
        return not (self.flow.read_paused or awaits_continue)

    def _end_header(self) -> None:
        """Refuse a header that has begun; close a connection on which no byte of a request has come."""
        has_begun = bool(self.conn.trailing_data[0])
        if not has_begun:
            self.transport.close()
            return
        seconds = self._connections.limits.silence
        detail = f"the header of the request was not complete within {seconds:g} s"
        self._refuse(http_problem(408, detail, "send the whole header at once"))

    def send_400_response(self, msg: str) -> None:  # noqa: ARG002 - uvicorn's words are the same for all causes
        """Refuse bytes that are no request, or a header that is too large."""
        if len(self.conn.trailing_data[0]) > MAX_HEADER_BYTES:
            self._refuse(make_header_problem())
        else:
            self._refuse(
                http_problem(400, "the bytes are not a request of HTTP/1.1", "send HTTP/1.1, without TLS")
            )

    def _refuse(self, problem: Problem) -> None:
        """Answer with a problem, and end the connection as soon as the client has read the answer."""
        if self.cycle is not None and not self.cycle.response_complete:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        if self.conn.our_state not in (h11.IDLE, h11.SEND_RESPONSE):  # an answer has begun
            self._lingers_for = 0
            self.transport.abort()
            return
        answer = answer_problem(problem)
        headers = [*answer.raw_headers, (b"connection", b"close")]
        reason = problem.title.encode()
        head = h11.Response(status_code=problem.status, headers=headers, reason=reason)
        for event in (head, h11.Data(data=bytes(answer.body)), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self._end_after_answer()

    def _end_after_answer(self) -> None:
        """End the connection when the client has read its answer; throw away what the client still sends.

        If bytes of the client were unread at the end, the system would throw the answer away.
        """
        self._lingers_for = _LINGER_CHECKS
        self.flow.resume_reading()
        self.transport.write_eof()
