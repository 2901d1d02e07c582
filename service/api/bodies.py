"""Request bodies: capped while they are read, parsed strictly, described in OpenAPI."""

from __future__ import annotations

import hashlib
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, Final, Generic, TypeVar

from fastapi import Header, HTTPException, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel
from starlette.requests import ClientDisconnect

from jointstiff.service.conversion import MalformedError, parse
from jointstiff.service.limits import MAX_SET_BYTES
from jointstiff.service.store import IdempotencyKey

__all__ = [
    "LARGE_BODIES",
    "MAX_ROBOT_BYTES",
    "MAX_RUN_BYTES",
    "MAX_SET_BYTES",
    "Body",
    "describe_body",
    "read_body",
    "read_content",
]

MAX_ROBOT_BYTES: Final = 4 * 1024 * 1024
MAX_RUN_BYTES: Final = 64 * 1024
MAX_KEY_LENGTH: Final = 255
SMALL_BYTES: Final = 64 * 1024
"""Up to this size a body is parsed at once: it takes a millisecond."""
LARGE_BODIES: Final = 2
"""Larger bodies that are parsed at a time; the worst we found takes 300 MB meanwhile."""
MAX_STRUCTURE: Final[Mapping[bytes, int]] = MappingProxyType({b"{": 60_000, b":": 300_000, b",": 1_000_000})
"""Objects, members and values in a body. A parser spends up to 1 kB on an empty object of two bytes: 8 MiB of
them would take gigabytes before the first fault is found."""

Parsed = TypeVar("Parsed", bound=BaseModel)

IdempotencyHeader = Annotated[
    str | None,
    Header(
        min_length=1,
        max_length=MAX_KEY_LENGTH,
        description="Any text of your choice. Posting the same body again with the same key answers "
        "with the resource that the first post created.",
    ),
]


@dataclass(frozen=True)
class Body(Generic[Parsed]):
    """A body that was read and understood, and the idempotency key that came with it."""

    message: Parsed
    key: IdempotencyKey | None


def read_body(message: type[Parsed], limit: int) -> Callable[..., Awaitable[Body[Parsed]]]:
    """A dependency that reads a JSON body of at most `limit` bytes.

    Large ones wait for their turn before they take one of the threads that do the service's work, so that
    many of them at once neither fill the memory nor keep others from being answered.
    """

    async def dependency(request: Request, idempotency_key: IdempotencyHeader = None) -> Body[Parsed]:
        media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
        if media_type != "application/json":
            raise HTTPException(415, "send JSON, with the header Content-Type: application/json")
        content = await read_content(request, limit)
        if len(content) <= SMALL_BYTES:
            parsed = _understood(content, message)
        else:
            async with request.app.state.large_bodies:
                parsed = await run_in_threadpool(_understood, content, message)
        key = None
        if idempotency_key is not None:
            key = IdempotencyKey(idempotency_key, hashlib.sha256(content).hexdigest())
        return Body(parsed, key)

    return dependency


async def read_content(request: Request, limit: int) -> bytes:
    """The body, cut off where it exceeds `limit` bytes, declared or not.

    Raises:
        HTTPException: it does (413), or the client left (400).
    """
    content = bytearray()
    try:
        async for chunk in request.stream():
            content += chunk
            if len(content) > limit:
                raise HTTPException(413, f"the body exceeds {limit // 1024} KiB; send less at once")
    except ClientDisconnect:
        raise HTTPException(400, "the client left before its body was complete") from None
    return bytes(content)


def _understood(content: bytes, message: type[Parsed]) -> Parsed:
    """Validate a body; its depth is limited to 200 by the parser.

    Raises:
        RequestValidationError: if it is not such a message.
        HTTPException: if it has too many parts (413).
    """
    for mark, most in MAX_STRUCTURE.items():
        if content.count(mark) > most:
            raise HTTPException(413, f"the body has more than {most} '{mark.decode()}'; send less at once")
    try:
        return parse(message, content)
    except MalformedError as error:
        raise RequestValidationError(error.faults) from None


def describe_body(message: type[BaseModel], examples: dict[str, Any]) -> dict[str, Any]:
    """The OpenAPI description of a body that is read by `read_body`."""
    return {
        "requestBody": {
            "required": True,
            "content": {
                "application/json": {
                    "schema": {"$ref": f"#/components/schemas/{message.__name__}"},
                    "examples": {name: {"value": value} for name, value in examples.items()},
                }
            },
        }
    }
