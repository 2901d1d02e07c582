"""Answers: documents and their descriptions, and every error as problem details of our own making."""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Annotated, Any, Final, cast

from fastapi import Depends, FastAPI, Request, Response
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError
from fastapi.responses import StreamingResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from jointstiff.schemas.finding import Problem
from jointstiff.service.jobs import Parts
from jointstiff.service.problems import StoreError, http_problem, invalid_request, problem_of
from jointstiff.service.process import REQUEST_ID
from jointstiff.solver.errors import JointstiffError

ANSWER_HEADERS: Final = MappingProxyType(
    {
        "Cache-Control": "no-store",
        "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
    }
)
"""Headers of an answer that says nothing else: no cache keeps it, no page of another site embeds it, and no
browser takes it for a program."""
REQUEST_ID_HEADER: Final = "X-Request-Id"
_TAG: Final = re.compile(r'"[^"]*"')
"""A tag in `If-None-Match`, weak or not (RFC 9110, section 13.1.2)."""
_REMEDIES: Final = {
    404: "see /openapi.json for the existing addresses",
    405: "see /openapi.json for the parameters of this address",
    409: "check its `state` and its `error`",
    413: "send less in one request",
}

RETRY_SECONDS: Final = {429: 10, 503: 5}
"""When a refused request may be sent again, by status."""
_UNAUTHORISED: Final = 401
NOT_MODIFIED: Final[dict[int | str, dict[str, Any]]] = {
    304: {"description": "The document is that of the `ETag` in `If-None-Match`."}
}

_ADDRESS: Final = {"Location": {"description": "Address of the resource.", "schema": {"type": "string"}}}
LOCATION: Final[dict[int | str, dict[str, Any]]] = {201: {"description": "Stored.", "headers": _ADDRESS}}

_logger = logging.getLogger(__name__)


def _parts_of_app(request: Request) -> Parts:
    return cast("Parts", request.app.state.parts)


PartsOf = Annotated[Parts, Depends(_parts_of_app)]


def json_response(text: str, status: int = 200) -> Response:
    """Return a stored document as it is, without parsing it again."""
    return Response(text, status, media_type="application/json")


def unchanging(
    request: Request,
    body: str | bytes | Iterator[str],
    media_type: str = "application/json",
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Return a document that rarely or never changes: a client that has it gets 304 in its place.

    A large table is sent as it is written, and has no tag.
    """
    given = dict(headers or {})
    if not isinstance(body, str | bytes):
        return StreamingResponse(body, media_type=media_type, headers=given)
    content = body.encode() if isinstance(body, str) else body
    given["ETag"] = tag = f'W/"{hashlib.sha256(content).hexdigest()[:32]}"'
    known = request.headers.get("if-none-match", "")
    if known.strip() == "*" or tag.removeprefix("W/") in _TAG.findall(known):
        return Response(status_code=304, headers=given)
    return Response(content, media_type=media_type, headers=given)


def created(collection: str, identifier: str, text: str, status: int = 201) -> Response:
    """Return a resource with its address."""
    response = json_response(text, status)
    response.headers["Location"] = f"/v1/{collection}/{identifier}"
    return response


def accepted(message: type[BaseModel]) -> dict[int | str, dict[str, Any]]:
    """Describe the answers to a post that may take longer, for OpenAPI."""
    later = "Stored but not finished: poll its address, or follow its events at /v1/jobs."
    return LOCATION | {202: {"description": later, "headers": _ADDRESS, "model": message}}


def install_error_handlers(app: FastAPI) -> None:
    """Give the application its error handler, which needs no thread."""
    for kind in (
        JointstiffError,
        StoreError,
        RequestValidationError,
        HTTPException,
        ClientDisconnect,
        Exception,
    ):
        app.add_exception_handler(kind, _answer_failure)


def answer_problem(problem: Problem, headers: dict[str, str] | None = None) -> Response:
    """Return an answer that is a problem document.

    It has all headers itself: the answer to an unexpected error passes no middleware.
    """
    identifier = REQUEST_ID.get()
    given = dict(headers or {})
    if problem.status in RETRY_SECONDS:
        given["Retry-After"] = str(RETRY_SECONDS[problem.status])
    if problem.status == _UNAUTHORISED:
        given["WWW-Authenticate"] = 'Bearer realm="jointstiff"'
    if identifier is not None:
        given[REQUEST_ID_HEADER] = identifier
    return Response(
        problem.model_copy(update={"request_id": identifier}).model_dump_json(),
        problem.status,
        media_type="application/problem+json",
        headers={**ANSWER_HEADERS, **given},
    )


def answer_error(error: JointstiffError | StoreError) -> Response:
    """Return the answer to one of the project's errors."""
    problem = problem_of(error)
    if problem.status >= 500:
        _logger.error("%s: %s", type(error).__name__, error)
    return answer_problem(problem)


def _parameters(request: Request) -> list[str]:
    """Return the names of the query parameters of the route of a request.

    The route knows them; to build the OpenAPI description for them would take seconds on the event loop.
    """
    dependant: Dependant | None = getattr(request.scope.get("route"), "dependant", None)
    return [] if dependant is None else list(query_names(dependant))


def query_names(dependant: Dependant) -> Iterator[str]:
    """Yield the names of the query parameters of a route and of what it depends on."""
    for parameter in dependant.query_params:
        declared = parameter.field_info.annotation
        if isinstance(declared, type) and issubclass(declared, BaseModel):
            yield from (field.alias or name for name, field in declared.model_fields.items())
        else:
            yield parameter.alias
    for part in dependant.dependencies:
        yield from query_names(part)


async def _answer_failure(request: Request, error: Exception) -> Response:
    match error:
        case JointstiffError() | StoreError():
            return answer_error(error)
        case RequestValidationError():
            return answer_problem(invalid_request(error.errors(), _parameters(request)))
        case HTTPException():
            reason, *remedy = str(error.detail).split("; ", 1)
            todo = remedy[0] if remedy else _REMEDIES.get(error.status_code)
            headers = dict(error.headers) if error.headers else None
            return answer_problem(http_problem(error.status_code, reason, todo), headers)
        case ClientDisconnect():
            return answer_problem(http_problem(400, "the client disconnected before its body was complete"))
    _logger.error("unexpected failure", exc_info=error)
    return answer_problem(http_problem(500, "an unexpected internal error", "please report it; see the log"))
