"""Admission of requests: by host and origin, and by the size and structure of their bodies."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final
from urllib.parse import urlsplit

from fastapi import HTTPException
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from jointstiff.schemas.access import Access
from jointstiff.schemas.finding import Problem
from jointstiff.service.conversion.parsing import MAX_SET_BYTES
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.problems import http_problem

LOOPBACK_NAMES: Final = frozenset({"localhost", "127.0.0.1", "[::1]"})
SAFE: Final = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that change nothing."""
_OWN_PAGES: Final = frozenset({"same-origin", "none"})
"""Values of Sec-Fetch-Site (W3C Fetch Metadata) of the service's own page and of typed addresses."""
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
    """Check the host and the origin of a request; return the problem if it is refused, None if accepted.

    A request to an unknown host name (421) may come from a page of an attacker who lets this name point to
    this machine (DNS rebinding). A change requested by another site's page (403) is recognised from the
    headers `Origin` and `Sec-Fetch-Site`, which browsers send and programs do not.
    """
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
    if scope["method"] not in SAFE and not _is_own_page(headers, hosts[0]):
        return http_problem(
            403, "a page of another site requested a change", "use the service's own page, or a program"
        )
    return None


def _is_own_page(headers: Headers, host: str) -> bool:
    """Return whether a request comes from a page of the service itself, or from a program."""
    if headers.get("sec-fetch-site", "none") not in _OWN_PAGES:
        return False
    origins = headers.getlist("origin")
    try:
        return all(urlsplit(origin).netloc.lower() == host.lower() for origin in origins)
    except ValueError:
        return False


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


class BodyLimits:
    """Middleware that refuses a body larger than the limit of its path (413)."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request; refuse its body when the declared or the received length exceeds the limit."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        limit = MAX_BYTES.get(scope["path"], SMALL_BYTES)
        content_length = Headers(scope=scope).get("content-length", "0")
        declared_bytes = int(content_length) if content_length.isdecimal() else 0
        received_bytes = 0

        async def receive_counted() -> Message:
            """Receive the next message; raise the error 413 if the body has become too large."""
            nonlocal received_bytes
            if max(declared_bytes, received_bytes) > limit:
                raise _make_size_error(limit)
            message = await receive()
            received_bytes += len(message.get("body", b""))
            if received_bytes > limit:
                raise _make_size_error(limit)
            return message

        await self._app(scope, receive_counted, send)


def refuse_structure(content: bytes) -> None:
    """Refuse a JSON text for which a parser would need too much memory.

    Raises:
        HTTPException: the text has too many objects, lists, members, values or different keys (413).
    """
    for character, greatest_count in MAX_STRUCTURE.items():
        if content.count(character) > greatest_count:
            raise HTTPException(
                413,
                f"the body has more than {greatest_count} '{character.decode()}'; split the body into "
                "several requests",
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


def _make_size_error(limit: int) -> HTTPException:
    """Return the error (413) that refuses a body larger than a limit in bytes."""
    return HTTPException(413, f"the body exceeds {limit // 1024} KiB; split the body into several requests")
