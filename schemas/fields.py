"""The frozen base of all messages, and the types of their fields with their units."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from functools import lru_cache
from hashlib import sha256
from typing import Annotated, Any, Generic, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter

FAR_POINT = 5.0
"""Distance of a point on the tool from the flange beyond which its unit is in doubt [m]."""

MAX_NAME_LENGTH = 200
MAX_MAGNITUDE = 1e12
"""Largest magnitude of a number; no quantity reaches it in a supported unit, and its square is finite."""


class Message(BaseModel):
    """Base of all messages: immutable, unknown fields refused, NaN and infinity refused."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, json_schema_serialization_defaults_required=True
    )


def content_key(text: str) -> str:
    """Return the idempotency key by which a service stores this JSON once, by whatever address it comes."""
    return f"content {sha256(text.encode()).hexdigest()}"


def _printable(text: str) -> str:
    if not text.isprintable() or text != text.strip():
        raise ValueError("must be printable text without leading or trailing blanks")
    return text


Name = Annotated[str, Field(min_length=1, max_length=MAX_NAME_LENGTH), AfterValidator(_printable)]
"""Text that people read: printable, because databases and pages differ on what else they take."""

Identifier = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_-]+$")]
"""The identifier of a stored resource."""

Quantity = Annotated[float, Field(strict=True, ge=-MAX_MAGNITUDE, le=MAX_MAGNITUDE)]
"""A finite number, not a text of digits, whose square is finite too."""

Vector3 = tuple[Quantity, Quantity, Quantity]
"""Three components along x, y and z."""

Point = tuple[float, float, float]
"""Three components of a result."""

Square3 = tuple[Point, Point, Point]
"""A matrix of a result, row by row."""

Value = TypeVar("Value")

Metres = Annotated[Value, Field(json_schema_extra={"unit": "m"})]
Kilograms = Annotated[Value, Field(json_schema_extra={"unit": "kg"})]
Radians = Annotated[Value, Field(json_schema_extra={"unit": "rad"})]
Newtons = Annotated[Value, Field(json_schema_extra={"unit": "N"})]
Compliance = Annotated[Value, Field(json_schema_extra={"unit": "rad/(N.m)"})]
Stiffness = Annotated[Value, Field(json_schema_extra={"unit": "N.m/rad"})]
TranslationalCompliance = Annotated[Value, Field(json_schema_extra={"unit": "m/N"})]
TranslationPerMoment = Annotated[Value, Field(json_schema_extra={"unit": "m/(N.m)"})]
RotationPerForce = Annotated[Value, Field(json_schema_extra={"unit": "rad/N"})]
LinearStiffness = Annotated[Value, Field(json_schema_extra={"unit": "N/m"})]
Torque = Annotated[Value, Field(json_schema_extra={"unit": "N.m"})]
SquareCompliance = Annotated[Value, Field(json_schema_extra={"unit": "rad2/(N.m)2"})]
SquareMetres = Annotated[Value, Field(json_schema_extra={"unit": "m2"})]
SquareRadians = Annotated[Value, Field(json_schema_extra={"unit": "rad2"})]
MixedSquares = Annotated[Value, Field(json_schema_extra={"unit": "m2, m.rad, rad2"})]
Dimensionless = Annotated[Value, Field(json_schema_extra={"unit": "1"})]
StatedUnit = Annotated[Value, Field(json_schema_extra={"unit": "see `unit`"})]
"""A value of any shape in this unit, which stands in the JSON schema: `Metres[float | None]`."""

Timestamp = Annotated[datetime, Field(description="Time in UTC, ISO 8601.")]

Item = TypeVar("Item", bound=Message)


class Page(Message, Generic[Item]):
    """One page of a listing, newest first."""

    items: list[Item] = Field(description="The resources on this page, newest first.")
    next: str | None = Field(description="Value of `cursor` for the following page; null on the last page.")


def validated(kind: type[Item], documents: Sequence[dict[str, Any]]) -> list[Item]:
    """Return many messages of one class: one call for all is five times faster than one for each."""
    return _list_of(kind).validate_python(documents, from_attributes=True)


@lru_cache(maxsize=64)
def _list_of(kind: type[Item]) -> TypeAdapter[list[Item]]:
    return TypeAdapter(list[kind])  # type: ignore[valid-type]
