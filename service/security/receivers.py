"""Receivers of webhooks: addresses that the service may post to, and the signatures of what it posts.

None is of its own network unless the settings allow it; messages are signed by Standard Webhooks.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import socket
from base64 import b64decode, b64encode
from collections.abc import Sequence
from ipaddress import IPv4Address, IPv6Address, ip_address, ip_network
from secrets import token_bytes
from typing import Final

from jointstiff.solver.errors import RequestError

ALLOWED_VARIABLE: Final = "JOINTSTIFF_WEBHOOK_ALLOW"
"""Names, addresses and networks of receivers that are not public, parted by commas."""
_NAT64: Final = ip_network("64:ff9b::/96")
_UNICAST: Final = ip_network("2000::/3")
"""All public addresses of IPv6; what else counts as global is of old ways to reach IPv4."""


def receiver_addresses(host: str, port: int | None) -> list[str]:
    """Return the addresses of a receiver, to connect to one of them and no other.

    A name is resolved once, and each of its addresses is checked: a name that leads elsewhere when it is
    resolved again leads nowhere.

    Raises:
        RequestError: it has no address, or one that is not public and that the settings do not allow.
    """
    allowed = [entry.strip().lower() for entry in os.environ.get(ALLOWED_VARIABLE, "").split(",")]
    try:
        infos = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise RequestError(
            f"'{host}' has no address", where="url", remedy="correct the name, or try again later"
        ) from error
    addresses = list(dict.fromkeys(str(entry[4][0]) for entry in infos))
    if host.lower() not in allowed:
        for address in addresses:
            if not _is_public(address) and not _is_among(address, allowed):
                raise RequestError(
                    f"'{host}' is {address}, which is this machine or not public",
                    where="url",
                    remedy=f"list it in the environment variable {ALLOWED_VARIABLE} of the service and its "
                    "workers",
                )
    return addresses


def _is_public(text: str) -> bool:
    """Return whether an address is public and none of this machine's own."""
    address = _embedded(ip_address(text.partition("%")[0]))
    if not address.is_global or address.is_multicast:
        return False
    if isinstance(address, IPv6Address) and address not in _UNICAST:
        return False
    family = socket.AF_INET if address.version == 4 else socket.AF_INET6
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((str(address), 0))
    except OSError:
        return True  # nobody else's address can be bound to
    return False


def _embedded(address: IPv4Address | IPv6Address) -> IPv4Address | IPv6Address:
    """Return the IPv4 address that an IPv6 address leads to, or itself."""
    if isinstance(address, IPv4Address):
        return address
    if address in _NAT64:
        return IPv4Address(int(address) & 0xFFFFFFFF)
    return address.ipv4_mapped or address.sixtofour or address


def _is_among(address: str, allowed: Sequence[str]) -> bool:
    parsed = ip_address(address.partition("%")[0])
    for entry in allowed:
        try:
            if parsed in ip_network(entry, strict=False):
                return True
        except ValueError:  # a name
            continue
    return False


_PREFIX: Final = "whsec_"


def new_secret() -> str:
    """Return the secret of a new webhook."""
    return _PREFIX + b64encode(token_bytes(32)).decode()


def signature(secret: str, message_id: str, timestamp: int, document: str) -> str:
    """Return the signature of a message, version 1."""
    key = b64decode(secret.removeprefix(_PREFIX))
    signed = f"{message_id}.{timestamp}.{document}".encode()
    return f"v1,{b64encode(hmac.digest(key, signed, hashlib.sha256)).decode()}"
