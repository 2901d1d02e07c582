"""Acceptance of requests: only for the service's own names, and no changes by pages of other sites."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import Scope

from jointstiff.schemas.access import Access
from jointstiff.schemas.finding import Problem
from jointstiff.service.problems.table import http_problem

LOOPBACK_NAMES: Final = frozenset({"localhost", "127.0.0.1", "[::1]"})
SAFE: Final = frozenset({"GET", "HEAD", "OPTIONS"})
"""Methods that change nothing."""
_OWN_PAGES: Final = frozenset({"same-origin", "none"})
"""Values of Sec-Fetch-Site (W3C Fetch Metadata) of our own page, and of what a person entered."""
_HOST: Final = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[^\s:/@\[\]]+)(?::[0-9]{1,5})?")


@dataclass(frozen=True)
class Posture:
    """Names and callers that the service accepts."""

    # `loopback`: programs of this machine; `keys`: holders of a key; `none`: everyone who reaches the address
    access: Access = "loopback"
    # names in the Host header that are answered, without port; None answers all
    hosts: frozenset[str] | None = LOOPBACK_NAMES

    @classmethod
    def of(
        cls, address: str, allowed: tuple[str, ...], *, access_control: bool, require_key: bool = False
    ) -> Posture:
        """Return the posture of a service that listens on an address.

        Args:
            address: that it listens on.
            allowed: additional names of the service; `*` for any name.
            access_control: whether the service itself controls who is answered.
            require_key: demand a key on a loopback address, too.

        Raises:
            ValueError: the service would control nothing, or answer under no name.
        """
        named = frozenset(name.strip().removesuffix(".").lower() for name in allowed)
        names = LOOPBACK_NAMES | {_bracketed(address)}
        if require_key and not access_control:
            raise ValueError("the service cannot both require keys and leave access control to a proxy")
        if is_loopback(address):
            return cls("keys" if require_key else "loopback", names | named)
        if access_control:
            # A rebound name has neither the cookie nor the key: without names given, all are answered.
            return cls("keys", names | named if named - {"*"} else None)
        if not named:
            raise ValueError("other machines can reach this address, but the service has no name")
        return cls("none", None if "*" in named else LOOPBACK_NAMES | named)


def is_loopback(address: str) -> bool:
    """Return whether only programs of this machine reach an address."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address.removesuffix(".").lower() == "localhost"


def refusal(posture: Posture, scope: Scope) -> Problem | None:
    """Return why a request is not for this service (421), or asked for by another site's page (403); or None.

    A name that an attacker lets point to this machine (DNS rebinding) is not one of the service's; a page of
    another site sends its `Origin`, or says in `Sec-Fetch-Site` that it is another. Programs send neither.
    """
    headers = Headers(scope=scope)
    hosts = headers.getlist("host")
    parsed = _HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
    known = posture.hosts
    if parsed is None or (known is not None and parsed[1].removesuffix(".").lower() not in known):
        return http_problem(
            421,
            "the service does not have this name",
            "start the service with --allowed-host and this name",
        )
    if scope["method"] not in SAFE and not _is_own_page(headers, hosts[0]):
        return http_problem(
            403, "a page of another site requested a change", "use the service's own page, or a program"
        )
    return None


def _is_own_page(headers: Headers, host: str) -> bool:
    if headers.get("sec-fetch-site", "none") not in _OWN_PAGES:
        return False
    origins = headers.getlist("origin")
    try:
        return all(urlsplit(origin).netloc.lower() == host.lower() for origin in origins)
    except ValueError:
        return False


def _bracketed(address: str) -> str:
    return f"[{address.lower()}]" if ":" in address else address.lower()
