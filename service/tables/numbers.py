"""Numbers as text: as many digits as their uncertainty allows, shares in percent."""

from __future__ import annotations

from math import floor, isfinite, log10

NO_NUMBER = "—"
"""Shown where there is no number."""
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def figure(value: float, form: str = ".4g") -> str:
    """Format a number: in full up to a million, beyond by a power of ten, no negative zero."""
    text = format(value, form)
    if "e" in text and 1e-4 <= abs(value) < 1e6:
        text = f"{float(text):.10g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa} · 10{str(int(exponent)).translate(_RAISED)}"
    return text if text.strip("-0.") else text.lstrip("-")


def rounded(value: float | None, uncertainty: float | None = None, bare: str = ".4g") -> str:
    """Format a value to two digits of its uncertainty, both in one unit; by `bare` without one."""
    if value is None:
        return NO_NUMBER
    if not uncertainty or not isfinite(uncertainty):
        return figure(value, bare)
    decimals = min(1 - floor(log10(uncertainty)), 9)
    return figure(round(value, decimals), f".{max(decimals, 0)}f")


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
