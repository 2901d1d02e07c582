"""Admission of requests: by host and origin, and by the size and structure of headers and bodies."""

from __future__ import annotations

import asyncio
import ipaddress
import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from fastapi import HTTPException
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from jointstiff.schemas.access import Access
from jointstiff.schemas.finding import Problem
from jointstiff.service.conversion.parsing import MAX_SET_BYTES, USE_ARRAYS
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.problems import http_problem
from jointstiff.service.process import trim_memory

LOOPBACK_NAMES: Final = frozenset({"localhost", "127.0.0.1", "[::1]"})
SAFE: Final = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that change nothing."""
_OWN_PAGES: Final = frozenset({"same-origin", "none"})
"""Values of Sec-Fetch-Site (W3C Fetch Metadata) of the service's own page and of typed addresses."""
MAX_HEADER_BYTES: Final = 32 * 1024
"""Greatest size of the header of a request [bytes]. The proxy accepts 16 kB, and adds lines."""
_LINE_BYTES: Final = len(": \r\n")
"""Size of a line of a header in addition to its name and its value [bytes]."""
_HOST: Final = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[^\s:/@\[\]]+)(?::[0-9]{1,5})?")


@dataclass(frozen=True)
class AccessPolicy:
    """Rules for the callers and host names that the service accepts."""

    # `loopback`: programs of this machine; `keys`: holders of a key; `none`: everyone who reaches the address
    access: Access = "loopback"
    # names, without port, that the Host header of a request may have; None: any name
    hosts: frozenset[str] | None = LOOPBACK_NAMES

    @classmethod
    def from_address(
        cls, address: str, allowed: tuple[str, ...], *, access_control: bool, require_key: bool = False
    ) -> AccessPolicy:
        """Return the access policy of a service that listens on an address.

        Args:
            address: address on which the service listens.
            allowed: additional host names of the service; `*` for any name.
            access_control: True if the service itself controls access, False if a proxy does.
            require_key: True if a key is required on a loopback address, too.

        Raises:
            ValueError: a key is required without access control, or no host name is allowed.
        """
        stated_names = frozenset(name.strip().removesuffix(".").lower() for name in allowed)
        own_names = LOOPBACK_NAMES | {_format_host(address)}
        if require_key and not access_control:
            raise ValueError("the service cannot both require keys and leave access control to a proxy")
        if is_loopback(address):
            return cls("keys" if require_key else "loopback", own_names | stated_names)
        if access_control:
            # Without `allowed`, all host names are accepted: an attacker's page whose name points here (DNS
            # rebinding) has neither the cookie nor the key.
            return cls("keys", own_names | stated_names if stated_names - {"*"} else None)
        if not stated_names:
            raise ValueError("other machines can reach this address, but no host name is allowed")
        return cls("none", None if "*" in stated_names else LOOPBACK_NAMES | stated_names)


def is_loopback(address: str) -> bool:
    """Return whether only programs of this machine reach an address."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address.removesuffix(".").lower() == "localhost"


def find_refusal(policy: AccessPolicy, scope: Scope) -> Problem | None:
    """Check header, host and origin of a request; return the problem if it is refused, None if accepted.

    A request to an unknown host name (421) may come from a page of an attacker who lets this name point to
    this machine (DNS rebinding). A change requested by another site's page (403) is recognised from the
    headers `Origin` and `Sec-Fetch-Site`, which browsers send and programs do not.
    """
    lines_bytes = sum(len(name) + len(value) + _LINE_BYTES for name, value in scope["headers"])
    if len(scope["path"]) + len(scope["query_string"]) + lines_bytes > MAX_HEADER_BYTES:
        return http_problem(
            431,
            f"the header exceeds {MAX_HEADER_BYTES // 1024} KiB",
            "send fewer or shorter headers and cookies",
        )
    headers = Headers(scope=scope)
    hosts = headers.getlist("host")
    match = _HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
    allowed_names = policy.hosts
    if match is None or (
        allowed_names is not None and match[1].removesuffix(".").lower() not in allowed_names
    ):
        return http_problem(
            421,
            "the request names a host that is not this service",
            "start the service with --allowed-host and this name",
        )
    if scope["method"] not in SAFE and not _is_own_page(headers, hosts[0], scope["scheme"]):
        return http_problem(
            403, "a page of another site requested a change", "use the service's own page, or a program"
        )
    return None


def _is_own_page(headers: Headers, host: str, scheme: str) -> bool:
    """Return whether a request comes from a page of the service itself, or from a program.

    The page has the scheme of the request: a page of plain HTTP may have been changed on its way. If a proxy
    with TLS does not state the scheme, the request seems to have come by HTTP: a page of HTTPS is accepted.
    """
    if headers.get("sec-fetch-site", "none") not in _OWN_PAGES:
        return False
    # Pages of other sites cannot set this header. The first of several proxies is the nearest to the browser.
    stated_scheme = headers.get("x-forwarded-proto", "").partition(",")[0].strip()
    schemes = {stated_scheme} if stated_scheme else {scheme, "https"}
    own_origins = {f"{each}://{host}".lower() for each in schemes}
    return all(origin.lower() in own_origins for origin in headers.getlist("origin"))


def _format_host(address: str) -> str:
    """Return an address in the form of the Host header: in lower case, IPv6 in brackets."""
    return f"[{address.lower()}]" if ":" in address else address.lower()


SMALL_BYTES: Final = 64 * 1024
"""Largest body [bytes] for a path that is not in `MAX_BYTES`; it is parsed in about a millisecond."""
MAX_ROBOT_BYTES: Final = 4 * 1024 * 1024
MAX_DEFLECTION_BYTES: Final = 2 * 1024 * 1024
MAX_BYTES: Final[Mapping[str, int]] = MappingProxyType(
    {
        "/v1/robots": MAX_ROBOT_BYTES,
        "/v1/kinematics": MAX_ROBOT_BYTES,
        "/v1/measurement-sets": MAX_SET_BYTES,
        "/v1/campaigns": MAX_SET_BYTES,
        "/v1/deflections": MAX_DEFLECTION_BYTES,
        "/v1/imports": MAX_SET_BYTES,
    }
    | {f"/v1/{kind.collection}": kind.max_bytes for kind in KINDS}
)
"""Path → largest body [bytes], for paths that accept more than `SMALL_BYTES`."""
LARGE_BODIES: Final = 2
"""Maximum number of imports, predictions and maps worked on at the same time."""
PARSERS: Final = 1
"""Maximum number of bodies above `SMALL_BYTES` parsed at the same time: a parser lets no other thread run."""

SPLIT_BODY: Final = "split the body into several requests"
"""What to do with a body that is too large."""
MAX_STRUCTURE: Final[Mapping[bytes, int]] = MappingProxyType(
    {b"{": 60_000, b"[": 400_000, b":": 300_000, b",": 1_000_000}
)
"""Character → how often it may occur in a body: the limits of objects, lists, members and values.

A parser needs up to 1 kB for an empty object of 2 bytes: 8 MiB of empty objects would take gigabytes before
the first fault is found.
"""
MAX_KEYS: Final = 4_000
"""Greatest number of different keys in a body: each unknown key is a fault, which needs 1 kB of memory."""
_STRING: Final = re.compile(rb'"((?:[^"\\]++|\\.)*+)(?:"\s*+(:?))?', re.DOTALL)
"""A JSON string, whether it ends or not, and the colon that makes it a key. Linear in time."""


MAX_BODIES: Final = 64_000_000
"""Greatest size of all bodies in flight [bytes]: of requests that have begun and are not answered yet."""
MAX_LARGE_BODIES: Final = 40_000_000
"""Greatest size of all large bodies in flight [bytes]; the rest of `MAX_BODIES` is left for other bodies."""
_TRIM_SECONDS: Final = 1.0
"""Time after the last body at which free memory is given back [s]: the body itself is free by then."""
LARGE_BYTES: Final = 2_000_000
"""Size above which a body is large [bytes]."""


class BodyBudget:
    """Budget of the bytes of all bodies in flight."""

    def __init__(self, most: int = MAX_BODIES, most_large: int = MAX_LARGE_BODIES) -> None:
        """Prepare a budget.

        Args:
            most: greatest size of all bodies together [bytes].
            most_large: greatest size of all bodies above `LARGE_BYTES` together [bytes].
        """
        self._most, self._most_large = most, most_large
        self._all = self._large = 0  # bytes in flight
        self._has_been_large = False  # whether more than `LARGE_BYTES` were in flight since the last trim

    def change(self, before: int, now: int) -> None:
        """Count a body with `now` in place of `before` bytes, as declared or received; 0 for no body.

        Raises:
            HTTPException: the budget has not enough bytes left (503).
        """
        all_bytes = self._all - before + now
        large_bytes = self._large - _large_part(before) + _large_part(now)
        is_beyond = all_bytes > self._most or large_bytes > self._most_large
        if now > before and is_beyond:
            raise HTTPException(
                503,
                f"no room is left for this body: the service accepts {self._most // 1_000_000} MB of bodies "
                f"at a time, {self._most_large // 1_000_000} MB of them in bodies above "
                f"{LARGE_BYTES // 1_000_000} MB; send the request again later",
            )
        self._all, self._large = all_bytes, large_bytes
        self._has_been_large |= all_bytes > LARGE_BYTES

    def take_trim(self) -> bool:
        """Return whether free memory should be given back to the system now: once after each large load.

        This is the case when more than `LARGE_BYTES` were in flight since the last time, and none are now.
        """
        nothing_in_flight = self._all == 0
        if not self._has_been_large or not nothing_in_flight:
            return False
        self._has_been_large = False
        return True


def _large_part(size: int) -> int:
    """Return the size of a body if the body is large, else 0 [bytes]."""
    return size if size > LARGE_BYTES else 0


class BodyLimits:
    """Middleware that refuses a body larger than the limit of its path (413), or beyond the budget (503)."""

    def __init__(self, app: ASGIApp, budget: BodyBudget | None = None) -> None:
        self._app = app
        self._budget = BodyBudget() if budget is None else budget

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request; refuse its body when the declared or the received length exceeds a limit."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        limit = MAX_BYTES.get(scope["path"], SMALL_BYTES)
        content_length = Headers(scope=scope).get("content-length", "0")
        declared_bytes = int(content_length) if content_length.isdecimal() else 0
        received_bytes = 0
        counted_bytes = 0  # in the budget

        def count() -> None:
            """Count the body in the budget; raise an error (413, 503) if the body is too large."""
            nonlocal counted_bytes
            size = max(declared_bytes, received_bytes)
            if size > limit:
                raise _make_size_error(limit, scope["path"])
            self._budget.change(counted_bytes, size)
            counted_bytes = size

        async def receive_counted() -> Message:
            """Receive the next message; raise the error 413 or 503 if the body has become too large."""
            nonlocal received_bytes
            count()
            message = await receive()
            received_bytes += len(message.get("body", b""))
            count()
            return message

        try:
            await self._app(scope, receive_counted, send)
        finally:
            self._budget.change(counted_bytes, 0)
            if self._budget.take_trim():
                asyncio.get_running_loop().call_later(_TRIM_SECONDS, trim_memory)


def refuse_structure(content: bytes, remedy: str = SPLIT_BODY) -> None:
    """Refuse a JSON text for which a parser would need too much memory.

    `remedy` says what to do with a text that has too many parts.

    Raises:
        HTTPException: the text has too many objects, lists, members, values or different keys (413).
    """
    for character, greatest_count in MAX_STRUCTURE.items():
        if content.count(character) > greatest_count:
            raise HTTPException(
                413,
                f"the body has more than {greatest_count} '{character.decode()}'; {remedy}",
            )
    if content.count(b":") <= MAX_KEYS:
        return
    # A body with fewer colons cannot have too many keys, so that this slow count is seldom needed.
    keys = set()
    for string in _STRING.finditer(content):
        if string[2]:  # a colon follows, so that the string is a key
            keys.add(string[1])
            if len(keys) > MAX_KEYS:
                raise HTTPException(
                    413, f"the body has more than {MAX_KEYS} different keys; check the names of the fields"
                )


_REMEDIES_OF_SIZE: Final[Mapping[str, str]] = MappingProxyType(
    {"/v1/campaigns": USE_ARRAYS, "/v1/measurement-sets": USE_ARRAYS}
)
"""Path → what to do with a body that is too large and cannot be split."""


def _make_size_error(limit: int, path: str) -> HTTPException:
    """Return the error (413) that refuses a body larger than a limit in bytes at a path."""
    remedy = _REMEDIES_OF_SIZE.get(path, SPLIT_BODY)
    return HTTPException(413, f"the body exceeds {limit // 1024} KiB; {remedy}")
