"""Wrong keys slow down: a few are forgiven, then each has to wait; the memory for it is bounded."""

from __future__ import annotations

import ipaddress
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Final

FORGIVEN: Final = 10
"""Wrong keys from an address that are answered at once."""
FORGET_SECONDS: Final = 6.0
"""After so long one wrong key is forgotten."""
ADDRESSES: Final = 1_024
"""Addresses remembered; the one that was heard least recently is forgotten first."""


class Throttle:
    """Count of the wrong keys of each address. It belongs to one event loop."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Count by a clock [s]."""
        self._clock = clock
        self._wrong: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def refuses(self, address: str) -> bool:
        """Return whether an address sent too many wrong keys of late."""
        return self._count(_network(address)) > FORGIVEN

    def wrong(self, address: str) -> None:
        """Count a wrong key; no more than what is forgotten in two minutes."""
        network = _network(address)
        count = min(self._count(network) + 1.0, 2.0 * FORGIVEN)
        self._wrong[network] = (count, self._clock())
        self._wrong.move_to_end(network)
        if len(self._wrong) > ADDRESSES:
            self._wrong.popitem(last=False)

    def _count(self, network: str) -> float:
        count, at = self._wrong.get(network, (0.0, 0.0))
        return max(0.0, count - (self._clock() - at) / FORGET_SECONDS)


def _network(address: str) -> str:
    """Return an IPv4 address, or the network of an IPv6 address, of which one machine has 2^64."""
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address[:64]
    return address if parsed.version == 4 else str(ipaddress.ip_network((parsed, 64), strict=False))
