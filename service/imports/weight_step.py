"""A table of a weight step: a row for the angles of two encoders of a joint, without or with the load.

Headers are `label`, `J1 [deg]` …, `joint`, `state`, `approach` (optional), `motor [deg]` and `link [deg]`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from jointstiff.schemas.gearbox import StepReadings
from jointstiff.service.conversion.units import ANGLE
from jointstiff.service.imports.tables import Column, Table, TableError
from jointstiff.service.imports.template import read_unit

_WORDS: Final = ("label", "joint", "state")
_HEADERS: Final = (
    "label, J1 [deg] …, joint, state (unloaded or loaded), approach (plus or minus), motor [deg], link [deg]"
)
_MOVED: Final = 5e-3
"""Greatest difference of a joint between rows of one posture [rad or m]."""
_APPROACHES: Final = {"plus": "+", "minus": "-"}
"""Words of a plan's list: a spreadsheet takes a cell that begins with a sign for a formula."""


def is_weight_step(table: Table) -> bool:
    """Return whether the headers of a table name a column of motor angles and one of link angles."""
    names = {_get_name(column.header) for column in table.columns}
    return {"motor", "link"} <= names


def _get_name(header: str) -> str:
    """Return a header without its unit."""
    return header.partition("[")[0].partition("(")[0].strip().lower()


def read_weight_step(table: Table, joints: Sequence[str] = ()) -> StepReadings:
    """Return the readings of a weight step.

    Args:
        table: table with the documented headers.
        joints: names of the robot's joints, so that the table may number them; without them, any names.

    Raises:
        TableError: a column is missing, a cell is not understood, or rows contradict each other.
    """
    columns = {_get_name(column.header): column for column in table.columns}
    numbered = [f"j{number}" for number in range(1, len(columns) + 1) if f"j{number}" in columns]
    missing = [name for name in (*_WORDS, "j1", "motor", "link") if name not in columns]
    if missing:
        raise _build_error(table, f"the weight step has no column {', '.join(missing)}")
    angle, length = _find_units(table, [*numbered, "motor", "link"], columns)
    postures: dict[str, dict[str, Any]] = {}
    readings: dict[tuple[str, str, str], dict[str, Any]] = {}
    words = columns["approach"].words if "approach" in columns else [""] * table.row_count
    approaches = [_APPROACHES.get(word, word) for word in words]
    positions = table.numbers([columns[name].id for name in numbered])
    angles_of_encoders = table.numbers([columns["motor"].id, columns["link"].id])
    for row in range(table.row_count):
        label, joint, state = (columns[name].words[row] for name in _WORDS)
        if not np.isfinite([*positions[row], *angles_of_encoders[row]]).all():
            raise _build_error(table, f"row {row + 1} has a cell that is no number")
        posture = postures.setdefault(label, {"label": label, "joints": positions[row].tolist()})
        if np.abs(positions[row] - posture["joints"]).max() > _MOVED / ANGLE[angle]:
            raise _build_error(table, f"the joints of {label} differ between its rows")
        key = label, _name_joint(table, joint, joints), approaches[row]
        reading = readings.setdefault(key, {"joint": key[1], "approach": approaches[row] or None})
        if state in reading or state not in ("unloaded", "loaded"):
            reason = f"row {row + 1} has the state {state!r}, which is unknown or repeated"
            raise _build_error(table, reason)
        motor, link = angles_of_encoders[row].tolist()
        reading[state] = {"motor": motor, "link": link}
    for (label, _, _), reading in readings.items():
        postures[label].setdefault("encoder_readings", []).append(reading)
    document = {"units": {"length": length, "angle": angle}, "observations": list(postures.values())}
    try:
        return StepReadings.model_validate(document)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        place = ".".join(map(str, fault["loc"]))
        raise _build_error(table, f"{place}: {fault['msg']}") from None


def _find_units(table: Table, names: Sequence[str], columns: Mapping[str, Column]) -> tuple[str, str]:
    """Return the unit of all angles, and that of all lengths.

    Raises:
        TableError: a column has no unit, or units differ.
    """
    units = {read_unit(columns[name].header) for name in names}
    angles = [unit for unit in units if unit in ANGLE]
    lengths = [unit for unit in units if unit in ("m", "mm")]
    if len(angles) != 1 or len(lengths) > 1 or len(units) > len(angles) + len(lengths):
        raise _build_error(table, "angles need one unit, deg or rad, and lengths one unit, m or mm")
    return str(angles[0]), str(lengths[0]) if lengths else "mm"


def _name_joint(table: Table, text: str, joints: Sequence[str]) -> str:
    """Return the name of a joint by its name or number.

    Raises:
        TableError: the robot has no such joint.
    """
    if not joints or text in joints:
        return text
    number = text.upper().removeprefix("J")
    if not number.isdecimal() or not 1 <= int(number) <= len(joints):
        raise _build_error(table, f"the robot has no joint {text!r}")
    return joints[int(number) - 1]


def _build_error(table: Table, reason: str) -> TableError:
    return TableError(reason, where=table.name, remedy=f"use the headers {_HEADERS}")
