"""Problem details for every error (RFC 9457)."""

from __future__ import annotations

from pydantic import Field

from jointstiff.schemas.fields import Message


class ProblemItem(Message):
    """One fault in a request."""

    where: str = Field(description="Path of the field.", examples=["observations[3].force"])
    reason: str = Field(description="Description of the fault.")
    remedy: str | None = Field(default=None, description="Recommended correction.")


class Problem(Message):
    """Problem details: the fault, its place and its remedy."""

    type: str = Field(
        description="Identifies the kind of problem.",
        examples=["urn:jointstiff:problem:invalid-request"],
    )
    title: str = Field(description="Title of the kind of problem.")
    status: int = Field(description="HTTP status code.")
    detail: str = Field(description="Description of this problem in one sentence.")
    where: str | None = Field(default=None, description="Path of the field, if there is one.")
    remedy: str | None = Field(default=None, description="Recommended correction.")
    request_id: str | None = Field(
        default=None, description="Identifier of the request, as in `X-Request-Id` and in the service's log."
    )
    errors: list[ProblemItem] = Field(default_factory=list, description="First twenty faults.")
