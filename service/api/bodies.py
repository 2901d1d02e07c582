"""Request bodies: capped while they are read, parsed strictly, described in OpenAPI."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, Final, TypeVar

from fastapi import Header, HTTPException, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ValidationError
from starlette.requests import ClientDisconnect

from service.records import IdempotencyKey

__all__ = [
    "MAX_ROBOT_BYTES",
    "MAX_RUN_BYTES",
    "MAX_SET_BYTES",
    "Body",
    "describe_body",
    "read_body",
]

MAX_ROBOT_BYTES: Final = 4 * 1024 * 1024
MAX_SET_BYTES: Final = 8 * 1024 * 1024
MAX_RUN_BYTES: Final = 64 * 1024
MAX_KEY_LENGTH: Final = 255
LARGE_BYTES: Final = 256 * 1024
"""A body above this size is parsed while at most one other is: it may take half a gigabyte meanwhile."""
_large_bodies = threading.BoundedSemaphore(2)
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
class Body:
    """A body that was read, and the idempotency key that came with it."""

    content: bytes
    key: IdempotencyKey | None

    def parse(self, message: type[Parsed]) -> Parsed:
        """Validate the content; its depth is limited to 200 by the parser.

        Raises:
            RequestValidationError: if it is not such a message.
            HTTPException: if it has too many parts (413).
        """
        for mark, most in MAX_STRUCTURE.items():
            if self.content.count(mark) > most:
                raise HTTPException(
                    413, f"the body has more than {most} '{mark.decode()}'; send less at once"
                )
        if len(self.content) <= LARGE_BYTES:
            return self._validated(message)
        with _large_bodies:
            return self._validated(message)

    def _validated(self, message: type[Parsed]) -> Parsed:
        try:
            return message.model_validate_json(self.content, strict=True)
        except ValidationError as error:
            faults = error.errors(include_url=False, include_context=False, include_input=False)
            raise RequestValidationError(faults) from None


def read_body(limit: int) -> Callable[..., Awaitable[Body]]:
    """A dependency that reads a JSON body of at most `limit` bytes."""

    async def dependency(request: Request, idempotency_key: IdempotencyHeader = None) -> Body:
        media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
        if media_type != "application/json":
            raise HTTPException(415, "send JSON, with the header Content-Type: application/json")
        content = bytearray()
        try:
            async for chunk in request.stream():
                content += chunk
                if len(content) > limit:
                    raise HTTPException(413, f"the body exceeds {limit // 1024} KiB; send less at once")
        except ClientDisconnect:
            raise HTTPException(400, "the client left before its body was complete") from None
        key = None
        if idempotency_key is not None:
            key = IdempotencyKey(idempotency_key, hashlib.sha256(content).hexdigest())
        return Body(bytes(content), key)

    return dependency


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
