"""Factors of units to SI units, and parsing of goals and loads in words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jointstiff.schemas.fields import parse_planned_load
from jointstiff.schemas.plan import parse_goal
from jointstiff.solver.errors import RequestError
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
