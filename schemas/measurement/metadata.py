"""Metadata of a measurement set: what people note about it; no part of the readings, and may change."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from pydantic import AfterValidator, AwareDatetime, BeforeValidator, Field

from jointstiff.schemas.fields import Message, Name

MAX_NOTES_LENGTH = 2_000
_FIRST_YEAR, _LAST_YEAR = 1980, 2200


def _refuse_number(value: object) -> object:
    """Refuse seconds since 1970, which could as well be milliseconds or a date written as a number."""
    if isinstance(value, int | float) or (isinstance(value, str) and value.strip().lstrip("+-").isdecimal()):
        raise ValueError("must be a date and a time with its zone, such as 2026-11-20T14:30:00+01:00")
    return value


def _in_utc(value: datetime) -> datetime:
    if not _FIRST_YEAR <= value.year <= _LAST_YEAR:
        raise ValueError(f"must lie between {_FIRST_YEAR} and {_LAST_YEAR}")
    return value.astimezone(UTC)


def _lines(text: str) -> str:
    if text != text.strip() or not all(line.isprintable() for line in text.split("\n")):
        raise ValueError("must be printable lines without leading or trailing blanks")
    return text


Moment = Annotated[AwareDatetime, BeforeValidator(_refuse_number), AfterValidator(_in_utc)]
"""A time that was stated with its zone; kept in UTC."""

Notes = Annotated[str, Field(min_length=1, max_length=MAX_NOTES_LENGTH), AfterValidator(_lines)]
"""Plain text of several lines."""


class SetMetadata(Message):
    """Metadata of a measurement set; all of it is optional."""

    measured_at: Moment | None = Field(
        default=None,
        description="Time of the measurement, ISO 8601 with its zone; kept in UTC.",
        examples=["2026-11-20T14:30:00+01:00"],
    )
    operator: Name | None = Field(default=None, description="Person or team that measured.")
    instrument: Name | None = Field(
        default=None,
        description="Instrument, for people; its uncertainty is in `noise`.",
        examples=["Leica AT960, 750123"],
    )
    serial_number: Name | None = Field(default=None, description="Serial number of the robot.")
    item_condition: Name | None = Field(
        default=None,
        description="Condition of the robot when it was measured.",
        examples=["as found, 12,000 h of operation"],
    )
    conditions: Name | None = Field(
        default=None,
        description="Conditions of the measurement.",
        examples=["21 °C, warmed up for 30 min"],
    )
    notes: Notes | None = Field(
        default=None, description=f"Anything else, at most {MAX_NOTES_LENGTH} characters in lines."
    )


class SetChange(SetMetadata):
    """Changes of a measurement set beside its readings. Omitted fields remain unchanged."""

    name: Name | None = Field(default=None, description="New name; null or absent: unchanged.")
    archived: bool | None = Field(
        default=None, description="True to archive the set: listings omit it; null or absent: unchanged."
    )
