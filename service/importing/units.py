"""Units as they stand in headers."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal

Dimension = Literal["length", "angle", "force", "moment"]

UNITS: Final[Mapping[Dimension, Mapping[str, tuple[str, ...]]]] = MappingProxyType(
    {
        "length": {
            "m": ("m",),
            "mm": ("mm", "MM"),
            "in": ("in", "inch", "inches", "Inch", "Inches", "INCHES"),
        },
        "angle": {
            "rad": ("rad", "RAD"),
            "deg": ("deg", "DEG", "°", "degree", "degrees", "degré", "degrés"),
        },
        "force": {"N": ("N",), "kN": ("kN",), "kgf": ("kgf", "kp")},
        "moment": {
            "N.m": ("N.m", "Nm", "N·m", "N*m", "N m", "N-m"),
            "N.mm": ("N.mm", "Nmm", "N·mm", "N*mm", "N mm", "N-mm"),
            "kN.m": ("kN.m", "kNm", "kN·m", "kN*m", "kN m", "kN-m"),
            "kgf.m": ("kgf.m", "kgfm", "kgf·m", "kgf*m", "kgf m", "kpm", "kp·m"),
        },
    }
)
"""Canonical name and spellings, by dimension. Letters keep their case: mN is no MN, and nm no N·m."""

INCH: Final = 25.4
"""Millimetres, exactly: what is in inches is converted when it is read."""

_NAMED: Final = MappingProxyType(
    {
        spelling: (dimension, unit)
        for dimension, units in UNITS.items()
        for unit, spellings in units.items()
        for spelling in spellings
    }
)


def unit_named(text: str) -> tuple[Dimension, str] | None:
    """The dimension and canonical name of a unit, or None if it is none of ours."""
    return _NAMED.get(text.strip())


FOREIGN: Final = frozenset(
    ("kg", "g", "t", "lbf", "lb", "lbs", "daN", "MN", "mN", "kip", "ft", "feet", "cm", "dm", "km", "µm", "μm",
     "um", "mil", "thou", "grad", "gon", "Grad", "mrad", "arcsec", "arcmin", "rev", "turns", "inc", "lbf.ft",
     "ft.lbf", "N.cm", "Ncm", "mNm", "V", "mV", "%")
)  # fmt: skip
"""Units that we do not take: no column can be said to be in another."""
