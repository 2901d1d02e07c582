"""Problem details for every error (RFC 9457)."""

from __future__ import annotations

from pydantic import Field

from jointstiff.schemas.fields import Message


class ProblemItem(Message):
    """One fault in a request."""

    where: str = Field(description="Path of the field.", examples=["observations[3].force"])
    reason: str = Field(description="What is wrong with it.")
    remedy: str | None = Field(default=None, description="How to mend it.")


class Problem(Message):
    """What went wrong, where, and how to mend it."""

    type: str = Field(
        description="Identifies the kind of problem.",
        examples=["urn:jointstiff:problem:invalid-request"],
    )
    title: str = Field(description="The kind of problem in words.")
    status: int = Field(description="HTTP status code.")
    detail: str = Field(description="This problem in a sentence.")
    where: str | None = Field(default=None, description="Path of the field, if there is one.")
    remedy: str | None = Field(default=None, description="How to mend it.")
    errors: list[ProblemItem] = Field(default_factory=list, description="The faults found, the first twenty.")
