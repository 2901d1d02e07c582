"""Answers to a client, which may come from anyone: a resource, or an error with its problem."""

from __future__ import annotations

import json
from typing import Any, TypeVar

import httpx
from pydantic import BaseModel, ValidationError

from jointstiff.schemas.problem import Problem
from jointstiff.service.problems import http_problem

Resource = TypeVar("Resource", bound=BaseModel)


class RefusedError(Exception):
    """The service refused, or did not answer; carries the problem."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.problem = problem


class AwayError(RefusedError):
    """The service does not answer now, and may later."""


def resource_in(response: httpx.Response, kind: type[Resource]) -> Resource:
    """Return the resource that an answer holds.

    Raises:
        RefusedError: it holds none.
    """
    try:
        return kind.model_validate(_printable(json.loads(response.content)))
    except (ValidationError, ValueError, RecursionError) as error:
        raise alien(f"which is no {kind.__name__}") from error


def problem_in(response: httpx.Response) -> Problem:
    """Return the problem that an answer holds, or the problem that it holds none."""
    try:
        return resource_in(response, Problem)
    except RefusedError:
        return alien(f"status {response.status_code}").problem


def alien(what: str) -> RefusedError:
    """Build the error that an answer is not the service's."""
    reason = f"an answer that is not Jointstiff's, {what}"
    return RefusedError(http_problem(502, reason, "check the address, and that versions agree"))


def silence(address: object, error: Exception) -> Problem:
    """Build the problem that nobody answers at an address."""
    remedy = "start it: jointstiff serve"
    if not str(address).startswith(("http://", "https://")):
        remedy = "write the address with http:// before it"
    return http_problem(503, f"no answer from {address}: {error}", remedy)


def _printable(value: Any) -> Any:  # noqa: ANN401 - any JSON
    """Return JSON without characters that would steer a terminal."""
    if isinstance(value, str):
        return "".join(c if c.isprintable() else "\ufffd" for c in value)
    if isinstance(value, list):
        return [_printable(item) for item in value]
    if isinstance(value, dict):
        return {_printable(name): _printable(item) for name, item in value.items()}
    return value
