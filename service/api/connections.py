"""Bounds on connections: none stays open by saying nothing, and neither bodies nor answers fill the memory.

Without them a client that sends half a request, or does not read its answer, is kept for ever: uvicorn only
ends those that are silent between two requests.
"""

from __future__ import annotations

import asyncio
import resource
from collections.abc import Iterable, Mapping
from heapq import nsmallest
from operator import itemgetter
from typing import Any, ClassVar, Final, cast

import h11
from fastapi import HTTPException
from starlette.datastructures import Headers
from starlette.types import Message, Receive, Scope, Send
from uvicorn import Config
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle
from uvicorn.server import ServerState

from jointstiff.service.api.answers import ANSWER_HEADERS, RETRY_SECONDS, answer_problem
from jointstiff.service.problems import http_problem
from jointstiff.service.security.admission import SMALL_BYTES

SPARE_DESCRIPTORS: Final = 256
"""Left to databases, files, and what is accepted before room is made."""
MOST_CONNECTIONS: Final = 8_192
ACCEPTED_AT_ONCE: Final = 32
"""Connections that the event loop accepts in one turn. It takes four turns until room is made for them, in
which they need spare descriptors."""
QUEUED_CONNECTIONS: Final = 1_024
"""Connections that the kernel keeps until they are accepted."""
_TOO_MANY_BODIES: Final = "too many request bodies are being received or processed"


def connection_limit() -> int:
    """Return the number of connections that the descriptors of this process allow."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return MOST_CONNECTIONS
    return min(max(soft - SPARE_DESCRIPTORS, soft // 2), MOST_CONNECTIONS)


class BoundedProtocol(H11Protocol):
    """A connection that has to go on: header, body and answer each have their time."""

    # for a whole header, from the connection or the end of the answer before
    HEADER_SECONDS: ClassVar[float] = 10.0
    BODY_SECONDS: ClassVar[float] = 30.0  # for a body, and `BODY_RATE` bytes a second beyond it
    BODY_RATE: ClassVar[float] = 64 * 1024
    WRITE_SECONDS: ClassVar[float] = 20.0  # without a byte of the answer taken
    ANSWER_RATE: ClassVar[float] = 4 * 1024  # bytes a second of an answer, on average over `WRITE_SECONDS`
    LOOK_SECONDS: ClassVar[float] = 1.0  # between two looks at the clock; a header that came may wait as long
    BODY_BYTES: ClassVar[int] = 64 * 1024 * 1024  # bytes of all bodies that are received or worked on
    TURNS: ClassVar[int] = 2  # bodies not declared to be small that are received or worked on at once
    TURN_SECONDS: ClassVar[float] = 30.0  # that a body waits for its turn
    ANSWER_BYTES: ClassVar[int] = 64 * 1024 * 1024  # of all answers of more than `PIECE_BYTES` under way
    PIECE_BYTES: ClassVar[int] = 64 * 1024  # bytes of an answer that wait for the client at a time
    # open at once; the one that was silent or lags for longest makes room for a new one
    CONNECTIONS: ClassVar[int] = connection_limit()

    @classmethod
    def held_bytes(cls) -> int:
        """Return the bytes of all bodies that are received or worked on."""
        return cls._held

    _held: ClassVar[int] = 0
    """Bytes of all bodies: the application keeps each until it ends, even if the client has left."""
    _answering: ClassVar[int] = 0
    """Bytes of all large answers that are being sent."""
    _turns: ClassVar[dict[RequestResponseCycle, BoundedProtocol]] = {}
    """Requests whose body has a turn."""
    _waiting: ClassVar[dict[RequestResponseCycle, tuple[BoundedProtocol, asyncio.Event]]] = {}
    """Requests whose body waits for a turn, and what tells that it has come."""
    _slow: ClassVar[list[tuple[float, BoundedProtocol]]] = []
    """Connections that make room next, the last one first, and since when they lagged as they were found."""

    _phase: tuple[Any, Any] = (None, None)
    _since: float = 0.0
    _received: int = 0
    _latest: int = 0
    _handed: int = 0  # bytes of answers given to the transport
    _taken: int = 0  # bytes that the client had taken when it was seen last
    _written_at: float = 0.0
    _window: tuple[float, int] = (0.0, 0)  # time and bytes taken when the rate was judged last

    def __init__(
        self,
        config: Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self._application: Any = self.app
        self.app = self._answer
        self._bodies: dict[RequestResponseCycle, int] = {}

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a header; make room first if there are too many."""
        super().connection_made(transport)
        self._since = self._written_at = self.loop.time()
        self._window = (self._since, 0)
        self._phase = (self.conn.their_state, None)
        if len(self.connections) > self.CONNECTIONS:
            self._make_room()
        self.loop.call_later(self.LOOK_SECONDS, self._look)

    def _make_room(self) -> None:
        """Close the connection that lags for longest; this one if none does.

        A look at all of them finds the next ones, too, as long as they do not go on: their order stays.
        """
        slow = self._slow
        while slow and slow[-1][1].lags_since() > slow[-1][0]:
            slow.pop()
        if not slow:
            others = (cast("BoundedProtocol", one) for one in self.connections if one is not self)
            slow += _slowest(others, float("inf"), ACCEPTED_AT_ONCE)
        (slow.pop()[1] if slow else self).transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Let go of what was received: a reference to itself would keep it until garbage is collected."""
        super().connection_lost(exc)
        self.app = self._application
        self._slow[:] = (each for each in self._slow if each[1] is not self)
        if self.cycle in self._waiting:
            _, came = self._waiting.pop(self.cycle)
            came.set()

    @property
    def awaits_header(self) -> bool:
        """Return whether no request is under way."""
        return self.conn.their_state is h11.IDLE

    def lags_since(self) -> float:
        """Return the time since which the client keeps us waiting; infinity if we keep it waiting.

        A header may be in the system's buffers while the service is busy, so it has `LOOK_SECONDS` more.
        """
        if self.awaits_header:
            return self._since + self.LOOK_SECONDS
        if self.conn.their_state is h11.SEND_BODY:
            due = self._since + self._received / self.BODY_RATE
            return float("inf") if self.flow.read_paused else due
        return self._written_at if self._left(self.loop.time()) else float("inf")

    def data_received(self, data: bytes) -> None:
        """Take what came, unless all bodies together are too large."""
        self._latest = len(data)
        self._received += self._latest
        super().data_received(data)
        if (
            self.cycle
            and self.cycle.body
            and self._held > self.BODY_BYTES
            and not self.transport.is_closing()
        ):
            if not self.cycle.response_started:
                retry = {"Retry-After": str(RETRY_SECONDS[503])}
                self.transport.write(_whole_answer(503, _TOO_MANY_BODIES, "send it again later", retry))
            self.cycle.disconnected = True
            self.cycle.message_event.set()
            self.transport.close()

    def handle_events(self) -> None:
        """Follow the request; count its body. A new phase has its own time."""
        before, taken = self.cycle, len(self.cycle.body) if self.cycle else 0
        super().handle_events()
        if self.cycle is not before:
            self._received, taken = self._latest, 0  # the header may have brought some of it
            if {b"content-length", b"transfer-encoding"} <= {name for name, _ in self.headers}:
                self.cycle.keep_alive = False  # it may hide a request (RFC 9112, section 6.1)
        if self.cycle and (arrived := len(self.cycle.body) - taken):
            self._bodies[self.cycle] = self._bodies.get(self.cycle, 0) + arrived
            type(self)._held += arrived
        phase = (self.conn.their_state, self.cycle)
        if phase != self._phase:
            self._phase, self._since = phase, self.loop.time()

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request to the application, which holds its body until it ends, and send the answer."""
        cycle, length, is_refused = self.cycle, 0, False

        async def sent(message: Message) -> None:
            """Send a large answer piece by piece as the client takes it, unless too many are under way."""
            nonlocal length, is_refused
            if is_refused:
                return
            if message["type"] == "http.response.start":
                self._end_turn(cycle)  # the client may take its time to read
                declared = int(Headers(raw=message["headers"]).get("content-length", "0"))
                length = declared if declared > self.PIECE_BYTES else 0
                is_refused = self._answering + length > self.ANSWER_BYTES
                length *= not is_refused
                type(self)._answering += length
            if is_refused:
                message["status"] = 503  # for who counts the answers
                reason = "too many large answers are being sent"
                await answer_problem(http_problem(503, reason, "try again later"))(scope, receive, send)
                return
            body = message.get("body", b"")
            for begin in range(0, len(body) - self.PIECE_BYTES, self.PIECE_BYTES):
                piece = body[begin : begin + self.PIECE_BYTES]
                self._handed += len(piece)
                await send({"type": message["type"], "body": piece, "more_body": True})
            rest = body[max(0, len(body) - 1) // self.PIECE_BYTES * self.PIECE_BYTES :]
            self._handed += len(rest)
            await send({**message, "body": rest} if body else message)

        try:
            await self._application(scope, self._in_turn(scope, receive), sent)
        finally:
            self._end_turn(cycle)
            type(self)._answering -= length
            type(self)._held -= self._bodies.pop(cycle, 0)
            cycle.body.clear()

    def _in_turn(self, scope: Scope, receive: Receive) -> Receive:
        """Let a body not declared to be small be received in its turn, which one that proves small ends."""
        cycle, headers, size = self.cycle, Headers(scope=scope), 0
        waits = "transfer-encoding" in headers or int(headers.get("content-length", "0")) > SMALL_BYTES

        async def received() -> Message:
            nonlocal waits, size
            if waits:
                waits = False
                await self._take_turn(cycle)
            message = await receive()
            size += len(message.get("body", b""))
            if not message.get("more_body", False) and size <= SMALL_BYTES:
                self._end_turn(cycle)
            return message

        return received

    async def _take_turn(self, cycle: RequestResponseCycle) -> None:
        """Wait for a turn; return without one if the client has left.

        Raises:
            HTTPException: none came in time (503).
        """
        came = asyncio.Event()
        self._waiting[cycle] = self, came
        self._pass_turns()
        try:
            async with asyncio.timeout(self.TURN_SECONDS):
                await came.wait()
        except TimeoutError:
            raise HTTPException(503, _TOO_MANY_BODIES) from None
        finally:
            self._waiting.pop(cycle, None)

    def _end_turn(self, cycle: RequestResponseCycle) -> None:
        if self._turns.pop(cycle, None):
            self._pass_turns()

    @classmethod
    def _pass_turns(cls) -> None:
        """Give free turns to those who lag least; if more wait than leave, close who lags most."""
        now = asyncio.get_running_loop().time()
        while cls._waiting and len(cls._turns) < cls.TURNS:
            cycle = max(cls._waiting, key=lambda one: min(cls._waiting[one][0].lags_since(), now))
            cls._turns[cycle], came = cls._waiting.pop(cycle)
            came.set()
        leaving = sum(holder.transport.is_closing() for holder in cls._turns.values())
        if len(cls._waiting) > leaving:
            for _, slowest in _slowest(cls._turns.values(), now - cls.LOOK_SECONDS):
                slowest.transport.abort()

    def _look(self) -> None:
        """Close the connection if its time is over, else look again later."""
        if self.transport.is_closing() and not self.transport.get_write_buffer_size():
            return
        if self.cycle in self._waiting:
            self._pass_turns()
        now = self.loop.time()
        left = self._left(now)
        began, before = self._window
        is_slow = left > 0 and self._taken - before < self.ANSWER_RATE * (now - began)
        if not left or now - began >= self.WRITE_SECONDS:
            self._window = (now, self._taken)
        if self.flow.read_paused:  # it is our turn
            self._since += self.LOOK_SECONDS
        remaining = min(self._allowed() - (now - self._since), self.WRITE_SECONDS - (now - self._written_at))
        if remaining <= 0.0 or (is_slow and now - began >= self.WRITE_SECONDS):
            self.transport.abort()
        else:
            self.loop.call_later(min(self.LOOK_SECONDS, remaining), self._look)

    def _left(self, now: float) -> int:
        """Return the bytes of the answer that the client has not taken; keep when it took some."""
        left = self.transport.get_write_buffer_size()
        taken = self._handed - left
        if not left or taken > self._taken:
            self._written_at = now
        self._taken = taken
        return left

    def _allowed(self) -> float:
        """Return how long the present phase may take [s]."""
        if self.awaits_header:
            return self.HEADER_SECONDS
        if self.conn.their_state is h11.SEND_BODY:
            return self.BODY_SECONDS + self._received / self.BODY_RATE
        return float("inf")

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP request, and close."""
        if self.conn.our_state in {h11.IDLE, h11.SEND_RESPONSE}:  # else an answer is under way
            self.transport.write(_whole_answer(400, msg, "send a request of HTTP/1.1", {}))
        self.transport.close()


def _slowest(
    connections: Iterable[BoundedProtocol], before: float, most: int = 1
) -> list[tuple[float, BoundedProtocol]]:
    """Return connections that lag since a time before this, and since when; the longest one last."""
    slow = ((one.lags_since(), one) for one in connections if not one.transport.is_closing())
    return nsmallest(most, (each for each in slow if each[0] < before), key=itemgetter(0))[::-1]


def _whole_answer(status: int, reason: str, remedy: str, headers: Mapping[str, str]) -> bytes:
    """Return an answer that no application gave, as bytes."""
    problem = http_problem(status, reason, remedy)
    body = problem.model_dump_json().encode()
    always = {
        "Content-Type": "application/problem+json",
        "Content-Length": str(len(body)),
        "Connection": "close",
    }
    lines = "".join(f"{name}: {value}\r\n" for name, value in {**ANSWER_HEADERS, **always, **headers}.items())
    return f"HTTP/1.1 {status} {problem.title}\r\n{lines}\r\n".encode() + body
