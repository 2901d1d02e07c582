"""Every error leaves as problem details, and none of them as a page of someone else's making."""

from __future__ import annotations

import logging
from typing import Final

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from jointstiff.schemas.problem import Problem
from jointstiff.service.api.middleware import ANSWER_HEADERS, REQUEST_ID_HEADER
from jointstiff.service.logs import REQUEST_ID
from jointstiff.service.problems.errors import StoreError
from jointstiff.service.problems.table import http_problem, invalid_request, problem_of
from jointstiff.solver.errors import JointstiffError

_REMEDIES: Final = {
    404: "see /openapi.json for the existing addresses",
    405: "see /openapi.json for the parameters of this address",
    409: "check its `state` and its `error`",
    413: "send less in one request",
}

RETRY_SECONDS: Final = {429: 10, 503: 5}
"""When a refused request may be sent again, by status."""
_UNAUTHORISED: Final = 401

_logger = logging.getLogger(__name__)


def install_error_handlers(app: FastAPI) -> None:
    """Give the application its error handlers."""
    app.add_exception_handler(JointstiffError, _refused)
    app.add_exception_handler(StoreError, _refused)
    app.add_exception_handler(RequestValidationError, _malformed)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(ClientDisconnect, _left)
    app.add_exception_handler(Exception, _unexpected)


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


async def _refused(_: Request, error: Exception) -> Response:
    if not isinstance(error, JointstiffError | StoreError):
        raise error
    return answer_error(error)


async def _malformed(_: Request, error: Exception) -> Response:
    if not isinstance(error, RequestValidationError):
        raise error
    return answer_problem(invalid_request(error.errors()))


async def _http(_: Request, error: Exception) -> Response:
    if not isinstance(error, HTTPException):
        raise error
    headers = dict(error.headers) if error.headers else None
    reason, *remedy = str(error.detail).split("; ", 1)
    todo = remedy[0] if remedy else _REMEDIES.get(error.status_code)
    problem = http_problem(error.status_code, reason, todo)
    return answer_problem(problem, headers)


async def _left(_: Request, __: Exception) -> Response:
    return answer_problem(http_problem(400, "the client disconnected before its body was complete"))


async def _unexpected(_: Request, error: Exception) -> Response:
    _logger.error("unexpected failure", exc_info=error)
    return answer_problem(http_problem(500, "an unexpected internal error", "please report it; see the log"))
