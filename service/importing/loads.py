"""Masses of loads in words, such as `50 kg` in a cell, in a header, in a title or in the name of a file."""

from __future__ import annotations

import re
from typing import Final

from jointstiff.schemas.imports import State

_LOAD: Final = re.compile(r"(?<![\d.,])(\d{1,5}(?:[.,]\d{1,3})?)[\s_]?kg(?![^\W\d_])", re.IGNORECASE)


def find_load(text: str) -> float | None:
    """Return the mass [kg] that a text states; None without a mass, or with several."""
    masses = _LOAD.findall(text)
    return float(masses[0].replace(",", ".")) if len(masses) == 1 else None


def remove_load(text: str) -> str:
    """Return a text without the mass that it states: `T1 50 kg` gives `T1`."""
    return " ".join(_LOAD.sub(" ", text).strip(" _-").split())


def find_state_of_load(mass: float) -> State:
    """Return the state of a target under a mass [kg]."""
    return "loaded" if mass > 0.0 else "unloaded"
