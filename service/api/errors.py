"""Every error leaves as problem details, and none of them as a page of someone else's making."""

from __future__ import annotations

import logging
from typing import Final

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from jointstiff.schemas.problem import Problem
from jointstiff.service.problems import http_problem, invalid_request, problem_of
from jointstiff.service.store import StoreError
from jointstiff.solver.errors import JointstiffError

_REMEDIES: Final = {
    404: "see /openapi.json for the addresses there are",
    405: "see /openapi.json for what this address takes",
    409: "see its `state` and its `error`",
}

_logger = logging.getLogger(__name__)


def install_error_handlers(app: FastAPI) -> None:
    """Give the application its error handlers."""
    app.add_exception_handler(JointstiffError, _refused)
    app.add_exception_handler(StoreError, _refused)
    app.add_exception_handler(RequestValidationError, _malformed)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(ClientDisconnect, _left)
    app.add_exception_handler(Exception, _unexpected)


def _answer(problem: Problem, headers: dict[str, str] | None = None) -> Response:
    return Response(
        problem.model_dump_json(),
        problem.status,
        media_type="application/problem+json",
        headers=headers,
    )


def _refused(_: Request, error: Exception) -> Response:
    if not isinstance(error, JointstiffError | StoreError):
        raise error
    problem = problem_of(error)
    if problem.status >= 500:
        _logger.error("%s: %s", type(error).__name__, error)
    return _answer(problem)


def _malformed(_: Request, error: Exception) -> Response:
    if not isinstance(error, RequestValidationError):
        raise error
    return _answer(invalid_request(error.errors()))


def _http(_: Request, error: Exception) -> Response:
    if not isinstance(error, HTTPException):
        raise error
    headers = dict(error.headers) if error.headers else None
    problem = http_problem(error.status_code, str(error.detail), _REMEDIES.get(error.status_code))
    return _answer(problem, headers)


def _left(_: Request, __: Exception) -> Response:
    return _answer(http_problem(400, "the client left before its body was complete"))


def _unexpected(_: Request, error: Exception) -> Response:
    _logger.error("unexpected failure", exc_info=error)
    return _answer(http_problem(500, "an unexpected failure", "report it; the log has the details"))
