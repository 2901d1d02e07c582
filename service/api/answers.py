"""Answers: documents and their descriptions, and every error as a problem document of this service."""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Annotated, Any, Final, cast

from fastapi import Depends, FastAPI, Request, Response
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError
from fastapi.responses import StreamingResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import BaseRoute, Match, Mount
from starlette.types import Scope

from jointstiff.schemas.finding import Problem
from jointstiff.schemas.job import Job
from jointstiff.service.jobs import Parts
from jointstiff.service.problems import ServiceError, http_problem, problem_from_error, problem_from_faults
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
"""Default headers of answers: they forbid caches to keep the answer, other sites to embed it, and browsers to
run it as a program."""
REQUEST_ID_HEADER: Final = "X-Request-Id"
_TAG_PATTERN: Final = re.compile(r'"[^"]*"')
"""A tag in `If-None-Match`, weak or not (RFC 9110, section 13.1.2)."""
_REMEDIES: Final = {
    409: "check `state` and `error` of the resource",
    413: "send less data in one request",
}
_WAIT: Final = "wait: read GET /v1/jobs/{id} until `state` is `succeeded`"
_NEXT_STEPS: Final = {
    "queued": _WAIT,
    "running": _WAIT,
    "failed": "read `error` of GET /v1/jobs/{id}, mend its cause, and post the {kind} again",
    "cancelled": "post the {kind} again",
}
"""State of a job without a result → what to do."""

RETRY_SECONDS: Final = {429: 10, 503: 5}
"""Seconds after which a refused request may be sent again, by status."""
_UNAUTHORISED: Final = 401
NOT_MODIFIED: Final[dict[int | str, dict[str, Any]]] = {304: {"description": "Unchanged since that `ETag`."}}

_ADDRESS: Final = {"Location": {"description": "New address.", "schema": {"type": "string"}}}
LOCATION: Final[dict[int | str, dict[str, Any]]] = {201: {"description": "Stored.", "headers": _ADDRESS}}

_logger = logging.getLogger(__name__)


def _get_parts_of_app(request: Request) -> Parts:
    """Return the parts of the service, such as its store, from the application of a request."""
    return cast("Parts", request.app.state.parts)


InjectedParts = Annotated[Parts, Depends(_get_parts_of_app)]


def json_response(text: str, status: int = 200) -> Response:
    """Return an answer with the JSON text of a document, which is not parsed again."""
    return Response(text, status, media_type="application/json")


def answer_with_etag(
    request: Request,
    body: str | bytes | Iterator[str],
    media_type: str = "application/json",
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Return an answer with a document and its hash as `ETag`; 304 without content if the client has it.

    A large table, handed over as an iterator, is streamed without a tag.
    """
    all_headers = dict(headers or {})
    if not isinstance(body, str | bytes):
        return StreamingResponse(body, media_type=media_type, headers=all_headers)
    content = body.encode() if isinstance(body, str) else body
    all_headers["ETag"] = tag = f'W/"{hashlib.sha256(content).hexdigest()[:32]}"'
    client_tags = request.headers.get("if-none-match", "")
    if client_tags.strip() == "*" or tag.removeprefix("W/") in _TAG_PATTERN.findall(client_tags):
        return Response(status_code=304, headers=all_headers)
    return Response(content, media_type=media_type, headers=all_headers)


def answer_created(collection: str, identifier: str, text: str, status: int = 201) -> Response:
    """Return the answer to a post: the JSON text of the new resource, and its address in `Location`."""
    response = json_response(text, status)
    response.headers["Location"] = f"/v1/{collection}/{identifier}"
    return response


def make_missing_error(job: Job, missing: str) -> HTTPException:
    """Return the error (409) that a job does not have what it has after success, such as a `result`."""
    remedy = _NEXT_STEPS.get(job.state, _REMEDIES[409]).format(kind=job.kind, id=job.id)
    return HTTPException(409, f"the {job.kind} has no {missing}, because its state is {job.state}; {remedy}")


def describe_post_responses(message: type[BaseModel]) -> dict[int | str, dict[str, Any]]:
    """Return the OpenAPI responses, by status, for posting a job: 201 if it has finished, 202 if not yet.

    `message` is the class of the job in the answer.
    """
    answer = {"description": "Stored; at 202, poll it.", "headers": _ADDRESS}
    return {201: answer, 202: answer | {"model": message}}


def install_error_handlers(app: FastAPI) -> None:
    """Install the handler that answers every error with a problem document; it runs in the event loop."""
    for kind in (
        JointstiffError,
        ServiceError,
        RequestValidationError,
        HTTPException,
        ClientDisconnect,
        Exception,
    ):
        app.add_exception_handler(kind, _answer_failure)


def answer_problem(problem: Problem, headers: dict[str, str] | None = None) -> Response:
    """Return the HTTP answer with a problem document (RFC 9457), status and headers.

    All headers are set here, because the answer to an unexpected error passes no middleware.
    """
    identifier = REQUEST_ID.get()
    more_headers = dict(headers or {})
    if problem.status in RETRY_SECONDS:
        more_headers["Retry-After"] = str(RETRY_SECONDS[problem.status])
    if problem.status == _UNAUTHORISED:
        more_headers["WWW-Authenticate"] = 'Bearer realm="jointstiff"'
    if identifier is not None:
        more_headers[REQUEST_ID_HEADER] = identifier
    return Response(
        problem.model_copy(update={"request_id": identifier}).model_dump_json(),
        problem.status,
        media_type="application/problem+json",
        headers={**ANSWER_HEADERS, **more_headers},
    )


def answer_error(error: JointstiffError | ServiceError) -> Response:
    """Return the answer to an error of the project; errors of the service (5xx) are logged."""
    problem = problem_from_error(error)
    if problem.status >= 500:
        _logger.error("%s: %s", type(error).__name__, error)
    return answer_problem(problem)


def _list_query_parameters(request: Request) -> list[str]:
    """Return the names of the query parameters of the route of a request.

    They are read from the route: building the OpenAPI description would block the event loop for seconds.
    """
    dependant: Dependant | None = getattr(request.scope.get("route"), "dependant", None)
    return [] if dependant is None else list(query_names(dependant))


def query_names(dependant: Dependant) -> Iterator[str]:
    """Yield the names of the query parameters of a route, with those of the functions on which it depends."""
    for parameter in dependant.query_params:
        declared = parameter.field_info.annotation
        if isinstance(declared, type) and issubclass(declared, BaseModel):
            yield from (field.alias or name for name, field in declared.model_fields.items())
        else:
            yield parameter.alias
    for part in dependant.dependencies:
        yield from query_names(part)


_METHODS: Final = ("DELETE", "GET", "PATCH", "POST", "PUT")
"""Methods that routes may have; HEAD and OPTIONS are answered for all of them."""


def list_methods(routes: Iterable[BaseRoute], scope: Scope) -> list[str]:
    """Return the methods that are answered at the address of a request; none at an unknown address."""
    if scope["path"] == "*":
        return list(_METHODS)
    answered = set[str]()
    for route in routes:
        # Mounts are static files, for GET only.
        methods = ("GET",) if isinstance(route, Mount) else _METHODS
        for method in methods:
            match, _ = route.matches({**scope, "method": method})
            if match is Match.FULL:
                answered.add(method)
    return sorted(answered)


async def refuse_unknown_parameters(request: Request) -> None:
    """Refuse query parameters that would be ignored: those that the route does not know, and repeated ones.

    Raises:
        RequestValidationError: the address has such parameters; the fault names each.
    """
    known = _list_query_parameters(request)
    unknown = [name for name in dict.fromkeys(request.query_params) if name not in known]
    if unknown:
        raise RequestValidationError(
            [
                {"type": "extra_forbidden", "loc": ("query", name), "msg": "Extra inputs are not permitted"}
                for name in unknown
            ]
        )
    repeated = [name for name in known if len(request.query_params.getlist(name)) > 1]
    if repeated:
        raise RequestValidationError(
            [
                {
                    "type": "value_error",
                    "loc": ("query", name),
                    "msg": "the parameter is given more than once",
                }
                for name in repeated
            ]
        )


async def _answer_failure(request: Request, error: Exception) -> Response:
    """Return the answer to any error as a problem document; unexpected errors are logged and give 500."""
    match error:
        case JointstiffError() | ServiceError():
            return answer_error(error)
        case RequestValidationError():
            return answer_problem(problem_from_faults(error.errors(), _list_query_parameters(request)))
        case HTTPException(status_code=404) if "endpoint" not in request.scope:
            reason = f"there is no address {request.url.path}"
            return answer_problem(http_problem(404, reason, "GET /openapi.json describes all addresses"))
        case HTTPException(status_code=405):
            reason = f"there is no method {request.method} at the address {request.url.path}"
            methods = list_methods(request.app.routes, request.scope)
            return answer_problem(http_problem(405, reason, f"send {' or '.join(methods)}"))
        case HTTPException():
            # In the HTTPExceptions that this service raises, the detail has the form "REASON; REMEDY".
            reason, *own_remedy = str(error.detail).split("; ", 1)
            remedy = own_remedy[0] if own_remedy else _REMEDIES.get(error.status_code)
            headers = dict(error.headers) if error.headers else None
            return answer_problem(http_problem(error.status_code, reason, remedy), headers)
        case ClientDisconnect():
            return answer_problem(http_problem(400, "the client disconnected before its body was complete"))
    _logger.error("unexpected failure", exc_info=error)
    return answer_problem(
        http_problem(
            500, "an unexpected internal error", "report the error, with the lines of the log about the error"
        )
    )
