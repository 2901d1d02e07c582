"""Request bodies: parsed strictly by the route, before FastAPI looks at them."""

from __future__ import annotations

import gc
import hashlib
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Annotated, Any, Final

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from fastapi import Depends, Header, HTTPException, Request, Response, params
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel
from starlette.datastructures import FormData

from jointstiff.service.api.access import AccessRoute
from jointstiff.service.api.forms import read_form
from jointstiff.service.api.limited import LimitedChild
from jointstiff.service.api.limits import SMALL_BYTES, refuse_structure
from jointstiff.service.conversion.parsing import MalformedError, parse
from jointstiff.service.store.records import IdempotencyKey

MAX_KEY_LENGTH: Final = 255

Handler = Callable[[Request], Coroutine[Any, Any, Response]]


class BodyRoute(AccessRoute):
    """Route that parses its body itself: FastAPI describes it, and finds it validated.

    FastAPI would parse on the event loop, list faults without end, and take any media type.
    """

    def get_route_handler(self) -> Handler:
        """Return FastAPI's handler behind our parser."""
        handle = super().get_route_handler()
        field = self.body_field
        if field is None:
            return handle
        if isinstance(field.field_info, params.Form):

            async def handle_form(request: Request) -> Response:
                _require(request, "multipart/form-data", "a form")
                if (answer := await _answered_elsewhere(request)) is not None:
                    return answer
                return await handle(_FormRequest(request, await read_form(request)))

            return handle_form
        message: type[BaseModel] = field.field_info.annotation  # type: ignore[assignment]

        async def handle_json(request: Request) -> Response:
            _require(request, "application/json", "JSON")
            parsed = _JsonRequest(request.scope, request.receive)
            if (answer := await _answered_elsewhere(parsed)) is not None:
                return answer
            await parsed.read(message)
            return await handle(parsed)

        return handle_json


class _JsonRequest(Request):
    """Request whose JSON body is a validated message, which FastAPI takes as it is."""

    _message: BaseModel

    async def read(self, message: type[BaseModel]) -> None:
        """Read and validate the body; large ones take turns in threads of their own.

        Raises:
            HTTPException: the body is too large (413).
            RequestValidationError: the body is not such a message.
        """
        content = await self.body()
        if len(content) <= SMALL_BYTES:
            self._message = understood(message, content)
        else:
            turns: CapacityLimiter = self.app.state.parsers
            self._message = await run_sync(understood, message, content, limiter=turns)

    async def json(self) -> BaseModel:
        """Return the message."""
        return self._message


class _FormRequest(Request):
    """Request whose form has been read."""

    def __init__(self, request: Request, form: FormData) -> None:
        super().__init__(request.scope, request.receive)
        self._form = form


async def _answered_elsewhere(request: Request) -> Response | None:
    """Return the answer of the child to a large body; None if it is ours to answer."""
    child: LimitedChild | None = request.app.state.limited_child
    return None if child is None else await child.answer(request)


def large_bodies(request: Request) -> CapacityLimiter:
    """Return the application's threads for large work that is not stored."""
    turns: CapacityLimiter = request.app.state.large_bodies
    return turns


KeyText = Annotated[
    str | None,
    Header(
        min_length=1,
        max_length=MAX_KEY_LENGTH,
        description="Any text of your choice, for safe retries: posting the same body again with the same "
        "key "
        "returns the resource that the first post created.",
    ),
]
"""Text of an idempotency key."""


def bound_key(key: str | None, body: bytes) -> IdempotencyKey | None:
    """Return an idempotency key, bound to the body that it came with."""
    return None if key is None else IdempotencyKey(key, hashlib.sha256(body).hexdigest())


async def _key(request: Request, idempotency_key: KeyText = None) -> IdempotencyKey | None:
    return None if idempotency_key is None else bound_key(idempotency_key, await request.body())


Key = Annotated[IdempotencyKey | None, Depends(_key)]
"""Idempotency key of a request, bound to the bytes of its body."""


def _require(request: Request, media_type: str, what: str) -> None:
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != media_type:
        raise HTTPException(415, f"send {what}, with the header Content-Type: {media_type}")


def understood(message: type[BaseModel], content: bytes) -> BaseModel:
    """Validate a JSON body; its depth is limited to 200 by the parser.

    Raises:
        HTTPException: the body has too large a structure (413).
        RequestValidationError: the body is not such a message.
    """
    refuse_structure(content)
    try:
        with without_collections():
            return parse(message, content)
    except MalformedError as error:
        raise RequestValidationError(error.faults) from None


@contextmanager
def without_collections() -> Iterator[None]:
    """Pause the garbage collector: a million new lists would be looked through again and again.

    That takes five times as long as the parser, and nobody else runs meanwhile. Of two that pause it at
    the same time, the first to end lets it run again.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
