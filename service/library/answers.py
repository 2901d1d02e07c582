"""Answers of a service, parsed as messages."""

from __future__ import annotations

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, TypeVar

from pydantic import ValidationError

from jointstiff.schemas.fields import Message
from jointstiff.schemas.finding import Problem
from jointstiff.schemas.job import Job
from jointstiff.schemas.live import MeasurementSet
from jointstiff.schemas.robot import Robot
from jointstiff.service.history.raising import raise_document
from jointstiff.service.library.results import Prediction
from jointstiff.service.problems import RefusedError, http_problem

if TYPE_CHECKING:
    import httpx2

AnyMessage = TypeVar("AnyMessage", bound=Message)


def parse_resource(response: httpx2.Response, kind: type[AnyMessage]) -> AnyMessage:
    """Parse an answer as a message; replace unprintable characters, because any server may have sent them.

    Raises:
        RefusedError: the answer is not such a message.
    """
    try:
        document = _replace_unprintable(json.loads(response.content))
        return _validate_answer(document, kind)
    except (ValidationError, ValueError, RecursionError) as error:
        raise foreign_answer_error(f"the answer is not a {kind.__name__}") from error


def _validate_answer(document: Any, kind: type[AnyMessage]) -> AnyMessage:  # noqa: ANN401 - any JSON
    """Return an answer as a message; an answer of an older service is raised to today's shape."""
    try:
        return kind.model_validate(document)
    except ValidationError:
        name = _KINDS_OF_ANSWERS.get(kind) or (kind.kind_name() if issubclass(kind, Job) else None)
        if name is None or not isinstance(document, dict):
            raise
        return kind.model_validate(raise_document(name, document, None).document)


_KINDS_OF_ANSWERS: Final[Mapping[type[Message], str]] = MappingProxyType(
    {Robot: "robot", MeasurementSet: "measurement_set", Prediction: "prediction"}
)
"""Class of an answer that is no job → kind of its document."""


def parse_problem(response: httpx2.Response) -> Problem:
    """Return the problem document in an answer, or a problem that says the answer is not from Jointstiff."""
    try:
        return parse_resource(response, Problem)
    except RefusedError:
        return foreign_answer_error(f"the answer has the status {response.status_code}").problem


def foreign_answer_error(what: str) -> RefusedError:
    """Return the error for an answer that does not come from Jointstiff.

    `what` describes the answer.
    """
    reason = f"the answer is not from Jointstiff: {what}"
    return RefusedError(
        http_problem(502, reason, "check the address, and that client and service have the same version")
    )


def _replace_unprintable(value: Any) -> Any:  # noqa: ANN401 - any JSON
    """Return JSON data in which U+FFFD replaces unprintable characters, which could control a terminal."""
    if isinstance(value, str):
        return "".join(character if character.isprintable() else "\ufffd" for character in value)
    if isinstance(value, list):
        return [_replace_unprintable(item) for item in value]
    if isinstance(value, dict):
        return {_replace_unprintable(name): _replace_unprintable(item) for name, item in value.items()}
    return value
