"""Lengths and limits in words."""

from __future__ import annotations

from math import floor, log10


def length_text(length: float) -> str:
    """A length [m] for people, in the unit that suits it."""
    for factor, unit in ((1.0, "m"), (1e3, "mm"), (1e6, "µm")):
        if abs(length) * factor >= 1.0:
            return f"{length * factor:.3g} {unit}"
    return f"{length * 1e9:.3g} nm"


def rounded_down(limit: float) -> float:
    """Round a lower limit down to three digits."""
    step = 10.0 ** (floor(log10(limit)) - 2)
    return floor(limit / step) * step
