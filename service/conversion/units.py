"""Units: factors to SI units, spellings, and the units of a call; goals and loads in words.

Every function of the Python library takes mm, deg, N and N·m, or the units of `units=`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jointstiff.schemas.fields import Message, parse_planned_load
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.plan import parse_goal
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.mechanics.measurements import FORCE_UNITS, Instrument

if TYPE_CHECKING:
    from jointstiff.schemas.measurement import Instrument as StatedInstrument

KGF: Final = FORCE_UNITS["kgf"]
"""Standard gravity: newtons in a kilogram-force, exactly."""
_LBF, _FOOT, _INCH = FORCE_UNITS["lbf"], 0.3048, 0.0254

LENGTH: Final[dict[str, float]] = {"m": 1.0, "mm": 1e-3}
ANGLE: Final[dict[str, float]] = {"rad": 1.0, "deg": np.pi / 180.0}
FORCE: Final[dict[str, float]] = {"N": 1.0, "kN": 1e3, "kgf": KGF, "lbf": _LBF, "kg": KGF}
MOMENT: Final[dict[str, float]] = {
    "N.m": 1.0,
    "N.mm": 1e-3,
    "kN.m": 1e3,
    "kgf.m": KGF,
    "lbf.m": _LBF,
    "lbf.ft": _FOOT * _LBF,
    "lbf.in": _INCH * _LBF,
}
COLUMN_UNITS: Final[dict[str, float]] = {
    **LENGTH, **ANGLE, **FORCE, **MOMENT, "cm": 1e-2, "in": _INCH, "µm": 1e-6, "daN": 10.0
}  # fmt: skip
"""Units of columns of files: factors to SI units; masses hang, so that kg is a weight in N."""


SIZES: Final = {"length": LENGTH, "angle": ANGLE, "force": FORCE, "moment": MOMENT}
"""Quantity → its units."""
_SPELLINGS: Final = {
    "N·m": "N.m",
    "Nm": "N.m",
    "N·mm": "N.mm",
    "Nmm": "N.mm",
    "kN·m": "kN.m",
    "kNm": "kN.m",
    "°": "deg",
}
AnyUnits = Units | Mapping[str, str] | str | None
"""Units of the numbers of a call, such as "mm, deg, N" or {"length": "m"}; None for mm, deg, N and N·m."""


def complete_units(stated: AnyUnits | Message) -> dict[str, str]:
    """Return the unit of each quantity by name; a quantity that a mapping does not name has the default unit.

    Moments whose unit is not stated are in the unit of force times m, as in a measurement set, if lengths are
    in m or the mapping states no other force than N; otherwise their unit is missing.

    Raises:
        MeasurementError: a unit is not known; or a text names a quantity twice, or not all quantities.
    """
    units = {"length": "mm", "angle": "deg", "force": "N"}
    if isinstance(stated, str):
        units = _parse_units(stated)
    elif stated is not None:
        # Readings of geometry have units of their own type, without forces.
        fields = stated.model_dump() if isinstance(stated, Message) else stated
        units |= {name: unit for name, unit in fields.items() if unit is not None}
    for quantity, unit in units.items():
        if unit not in SIZES.get(quantity, {}):
            raise _unknown_unit(f"'{unit}' is not a known unit of {quantity}")
    by_metre = f"{units['force']}.m".replace("kg.", "kgf.")
    is_partial = stated is None or isinstance(stated, Mapping)
    if units["length"] == "m" or (is_partial and units["force"] == "N"):
        units.setdefault("moment", by_metre)
    return units


def _parse_units(text: str) -> dict[str, str]:
    """Parse a text such as `mm, deg, N` or `m, rad, kN, kN.m`; return the unit of each quantity by name."""
    units: dict[str, str] = {}
    for word in re.split(r"[,;\s]+", text.strip()):
        name = _SPELLINGS.get(word, word)
        quantity = next((each for each, sizes in SIZES.items() if name in sizes), None)
        if quantity is None or quantity in units:
            raise _unknown_unit(
                f"'{word}' is {f'a second unit of {quantity}' if quantity else 'not a known unit'}"
            )
        units[quantity] = name
    for quantity in ("length", "angle", "force"):
        if quantity not in units:
            raise _unknown_unit(f"the unit of {quantity} is missing")
    return units


def _unknown_unit(reason: str) -> MeasurementError:
    """Return the error about the units of a call, with the known units."""
    known = "; ".join(f"{quantity} {', '.join(sizes)}" for quantity, sizes in SIZES.items())
    remedy = f"use one unit for each quantity, as in 'mm, deg, N': {known}"
    return MeasurementError(reason, where="units", remedy=remedy)


def to_instrument(sheet: StatedInstrument, length: float) -> Instrument:
    """Return a tracker's data sheet in SI units; `length` is the sheet's unit of length in m."""
    x, y, z = sheet.station
    return Instrument(
        station=(length * x, length * y, length * z),
        range_constant=length * sheet.range.constant,
        range_per_distance=sheet.range.per_distance,
        transverse_constant=length * sheet.transverse.constant,
        transverse_per_distance=sheet.transverse.per_distance,
    )


def parse_goal_text(text: str) -> dict[str, Any]:
    """Parse the goal of a plan, written in words; return the goal as a document.

    Raises:
        RequestError: the text is not a goal.
    """
    try:
        return parse_goal(text)
    except ValueError as error:
        reason, _, remedy = str(error).partition(": ")
        raise RequestError(reason, where="goal", remedy=remedy) from None


def parse_load_text(text: str) -> dict[str, Any]:
    """Parse the load of a plan or of a live measurement, written as KIND:NEWTONS; return it as a document.

    Raises:
        RequestError: the text is not a load.
    """
    try:
        return parse_planned_load(text)
    except ValueError as error:
        remedy = 'write the kind and the force in N, such as "any_direction:1500"'
        raise RequestError(str(error), where="load", remedy=remedy) from None
