"""Words and numbers of reports."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

from jointstiff.service.tables.numbers import NO_NUMBER
from jointstiff.service.tables.numbers import rounded as to_digits

NOT_STATED: Final = "not stated"
VERDICTS: Final = {"use": "use", "use_with_care": "use with care", "do_not_use": "do not use"}


def moment(time: datetime | None) -> str:
    """Return a time for people, in UTC."""
    return NOT_STATED if time is None else f"{time.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def rounded(value: float | None, uncertainty: float | None = None) -> str:
    """Return a number to two digits of its uncertainty, or to three significant digits."""
    if value is None:
        return NO_NUMBER
    if uncertainty is None or not uncertainty > 0.0:
        plain = 1e-3 <= abs(value) < 1e6 or value == 0.0
        return f"{float(f'{value:.3g}'):g}" if plain else powers(value)
    return to_digits(value, uncertainty)


def powers(value: float) -> str:
    """Return a number by a power of ten, as prose has it."""
    mantissa, exponent = f"{value:.2e}".split("e")
    digits = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa} · 10{digits}"


def percent(share: float | None) -> str:
    """Return a share in percent."""
    return NO_NUMBER if share is None else f"{100 * share:.3g} %"
