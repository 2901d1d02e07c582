"""Answers to a client, which may come from anyone: a resource, or an error with its problem."""

from __future__ import annotations

import json
from typing import Any, TypeVar

import httpx2
from pydantic import BaseModel, ValidationError

from jointstiff.schemas.problem import Problem
from jointstiff.service.library.errors import RefusedError
from jointstiff.service.problems.table import http_problem

Resource = TypeVar("Resource", bound=BaseModel)


def resource_in(response: httpx2.Response, kind: type[Resource]) -> Resource:
    """Return the resource that an answer holds.

    Raises:
        RefusedError: it holds none.
    """
    try:
        return kind.model_validate(_printable(json.loads(response.content)))
    except (ValidationError, ValueError, RecursionError) as error:
        raise alien(f"which is not a {kind.__name__}") from error


def problem_in(response: httpx2.Response) -> Problem:
    """Return the problem that an answer holds, or the problem that it holds none."""
    try:
        return resource_in(response, Problem)
    except RefusedError:
        return alien(f"status {response.status_code}").problem


def alien(what: str) -> RefusedError:
    """Build the error that an answer is not the service's."""
    reason = f"the answer is not from Jointstiff, {what}"
    return RefusedError(
        http_problem(502, reason, "check the address, and that client and service have the same version")
    )


def silence(address: object, error: Exception) -> Problem:
    """Build the problem that nobody answers at an address."""
    return http_problem(
        503,
        f"no answer from {address}: {error}",
        "start it with `jointstiff serve`, or give the address of a running service with --server",
    )


def no_address(text: str) -> Problem:
    """Build the problem that a text is no address of a service."""
    remedy = "write the address with http:// before it, such as http://127.0.0.1:8000"
    return http_problem(422, f"'{text}' is not the address of a service", remedy)


def _printable(value: Any) -> Any:  # noqa: ANN401 - any JSON
    """Return JSON without characters that would steer a terminal."""
    if isinstance(value, str):
        return "".join(c if c.isprintable() else "\ufffd" for c in value)
    if isinstance(value, list):
        return [_printable(item) for item in value]
    if isinstance(value, dict):
        return {_printable(name): _printable(item) for name, item in value.items()}
    return value
