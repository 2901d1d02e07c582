"""Numbers as text: as many digits as their uncertainty allows, shares in percent."""

from __future__ import annotations

from math import floor, isfinite, log10

NO_NUMBER = "—"
"""Shown where there is no number."""


def rounded(value: float, uncertainty: float | None, bare: str = ".4g") -> str:
    """Format a value to two digits of its uncertainty, both in one unit; by `bare` without one."""
    if not uncertainty or not isfinite(uncertainty):
        return format(value, bare)
    decimals = min(1 - floor(log10(uncertainty)), 9)
    return f"{round(value, decimals):.{max(decimals, 0)}f}"


def concise(value: float, uncertainty: float | None, bare: str = ".4g") -> str:
    """Format a value with its standard uncertainty in units of the last digits (GUM, 7.2.2)."""
    text = rounded(value, uncertainty, bare)
    if not uncertainty or not isfinite(uncertainty):
        return text
    digits = rounded(uncertainty, uncertainty)
    return f"{text}({digits.lstrip('0.') if float(digits) < 1 else digits})"


def percent(share: float | None) -> str:
    """Format a share."""
    return NO_NUMBER if share is None else f"{100 * share:.1f} %"
