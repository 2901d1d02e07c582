"""Loads in words, such as `50 kg` or `300 lb` in a cell, header, title or name of a file, and their units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from jointstiff.schemas.imports import State
from jointstiff.service.importing.grammar import find_known_unit, find_unit_of_readings

_LOAD: Final = re.compile(
    r"(?<![\d.,])(\d{1,5}(?:[.,]\d{1,3})?)[\s_]?(?:(kg)|lbs?)(?![^\W\d_])", re.IGNORECASE
)
_FORCE: Final = re.compile(r"(?<![\d.,])(?<![^\W_])(\d{1,6}(?:[.,]\d{1,3})?)[\s_]?([^\W\d_]{1,12})(?![^\W_])")
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


class SplitForce(NamedTuple):
    """Text with a force in a unit, such as `1320 N T1`, in its two parts."""

    newtons: float
    rest: str


def split_force(text: str) -> SplitForce | None:
    """Split the size of a force with its unit from a text; None without a force, or with several."""
    found = []
    for match in _FORCE.finditer(text):
        unit = find_known_unit(match[2])
        if unit is not None and unit[0] == "force":
            found.append((match, unit[1]))
    if len(found) != 1:
        return None
    ((force, name),) = found
    size = float(force[1].replace(",", "."))
    rest = f"{text[: force.start()]} {text[force.end() :]}".strip(" _-")
    return SplitForce(size * find_newtons(name), " ".join(rest.split()))


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
