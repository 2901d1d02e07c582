"""Limits of request bodies: bytes counted as they arrive, structure before a parser spends memory."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from fastapi import HTTPException
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from jointstiff.service.conversion.parsing import MAX_SET_BYTES
from jointstiff.service.kinds.registry import KINDS

SMALL_BYTES: Final = 64 * 1024
"""Largest body of an address without a limit of its own; parsed at once, in about a millisecond."""
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
"""Largest body of each address that takes more than `SMALL_BYTES`."""
LARGE_BODIES: Final = 2
"""Maximum number of imports, predictions and maps worked on at the same time."""
PARSERS: Final = 1
"""Maximum number of bodies above `SMALL_BYTES` parsed at the same time: a parser lets no other thread run."""

MAX_STRUCTURE: Final[Mapping[bytes, int]] = MappingProxyType(
    {b"{": 60_000, b"[": 400_000, b":": 300_000, b",": 1_000_000}
)
"""Objects, lists, members and values in a body. A parser spends up to 1 kB on an empty object of two bytes:
8 MiB of them would take gigabytes before the first fault is found."""
MAX_KEYS: Final = 4_000
"""Different keys in a body. Each unknown key is a fault, and validation spends 1 kB on a fault."""
_STRING: Final = re.compile(rb'"((?:[^"\\]++|\\.)*+)(?:"\s*+(:?))?', re.DOTALL)
"""A JSON string, whether it ends or not, and the colon that makes it a key. Linear in time."""


class BodyLimits:
    """Middleware that refuses a body beyond the limit of its address (413), its length declared or not."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, with its body counted."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        limit = MAX_BYTES.get(scope["path"], SMALL_BYTES)
        declared = Headers(scope=scope).get("content-length", "0")
        expected, received = int(declared) if declared.isdecimal() else 0, 0

        async def counted() -> Message:
            nonlocal received
            if max(expected, received) > limit:
                raise _too_large(limit)
            message = await receive()
            received += len(message.get("body", b""))
            if received > limit:
                raise _too_large(limit)
            return message

        await self._app(scope, counted, send)


def refuse_structure(content: bytes) -> None:
    """Refuse a JSON text that a parser would need too much memory for.

    Raises:
        HTTPException: it has too many objects, lists, members, values or different keys (413).
    """
    for mark, most in MAX_STRUCTURE.items():
        if content.count(mark) > most:
            raise HTTPException(
                413, f"the body has more than {most} '{mark.decode()}'; split it into several requests"
            )
    if content.count(b":") <= MAX_KEYS:
        return
    keys = set()
    for string in _STRING.finditer(content):
        if string[2]:
            keys.add(string[1])
            if len(keys) > MAX_KEYS:
                raise HTTPException(
                    413, f"the body has more than {MAX_KEYS} different keys; check the names of the fields"
                )


def _too_large(limit: int) -> HTTPException:
    return HTTPException(413, f"the body exceeds {limit // 1024} KiB; split it into several requests")
