"""Figures of sentences that people read."""

import re

_METRES = {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9}


def length_in(message: str) -> float:
    """The first length in a sentence [m]."""
    number, unit = re.search(r"([\d.]+) (nm|µm|mm|m)\b", message).groups()
    return float(number) * _METRES[unit]
