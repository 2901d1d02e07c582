"""Words and numbers of reports."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

from jointstiff.service.tables.numbers import NO_NUMBER, figure

NOT_STATED: Final = "not stated"


def moment(time: datetime | None) -> str:
    """Return a time for people, in UTC."""
    return NOT_STATED if time is None else f"{time.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def percent(share: float | None) -> str:
    """Return a share in percent."""
    return NO_NUMBER if share is None else f"{figure(100 * share, '.3g')} %"
