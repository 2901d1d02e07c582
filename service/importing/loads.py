"""Loads in words, such as `50 kg` or `300 lb` in a cell, header, title or name of a file, and their units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.imports import State
from jointstiff.service.importing.grammar import find_unit_of_readings

_LOAD: Final = re.compile(
    r"(?<![\d.,])(\d{1,5}(?:[.,]\d{1,3})?)[\s_]?(?:(kg)|lbs?)(?![^\W\d_])", re.IGNORECASE
)
_POUND: Final = 0.45359237
"""Mass of a pound [kg]."""
KILOGRAMS: Final[Mapping[str, float]] = MappingProxyType({"kgf": 1.0, "lbf": _POUND})
"""Unit of a weight → mass [kg] of this weight."""


def find_load(text: str) -> float | None:
    """Return the mass [kg] that a text states; None without a mass, or with several."""
    masses = _LOAD.findall(text)
    if len(masses) != 1:
        return None
    ((number, is_in_kg),) = masses
    return float(number.replace(",", ".")) * (1.0 if is_in_kg else _POUND)


def remove_load(text: str) -> str:
    """Return a text without the mass that it states: `T1 50 kg` gives `T1`."""
    return " ".join(_LOAD.sub(" ", text).strip(" _-").split())


def find_state_of_load(mass: float) -> State:
    """Return the state of a target under a mass [kg]."""
    return "loaded" if mass > 0.0 else "unloaded"


def find_newtons(unit: str) -> float:
    """Return the newtons in a unit of force that files and people state."""
    from jointstiff.service.conversion.units import FORCE  # imports numpy

    of_readings = find_unit_of_readings(unit)
    return of_readings.factor * FORCE[of_readings.name]
