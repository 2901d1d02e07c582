"""The catalogue of nominal arms as tables for the terminal."""

from __future__ import annotations

from math import degrees
from typing import Final

from rich.console import Group
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.catalogue import Arm, Catalogue

_COLUMNS: Final = ("joint", "a [mm]", "alpha [°]", "d [mm]", "theta [°]", "limits [°]")
_REACH_OF: Final = {"wrist_centre": "of the wrist centre", "flange": "of the flange", "stated": "as stated"}


def arms_table(catalogue: Catalogue) -> Group:
    """Return the arms, and the presets of joint maps that they have."""
    table = Table("arm", r"reach \[mm]", "joint map", title="Nominal arms")
    table.columns[1].justify = "right"
    names = {preset.id: preset.name for preset in catalogue.joint_maps}
    for arm in catalogue.arms:
        table.add_row(
            Text(arm.name), f"{arm.reach * 1e3:g}", Text(names.get(arm.joint_map_preset or "", "—"))
        )
    return Group(table, Text('Take one by its name, such as --robot "KUKA KR 210 R2700".'))


def arm_report(arm: Arm) -> Group:
    """Return one arm: its table, joint map, reach and sources."""
    convention = f"Denavit-Hartenberg, {arm.model.convention}"
    table = Table(*map(escape, _COLUMNS), title=convention)
    for i, row in enumerate(arm.model.rows, 1):
        known = row.lower is not None and row.upper is not None
        limits = f"{_angle(row.lower)} to {_angle(row.upper)}" if known else "not known"
        numbers = (_length(row.a), _angle(row.alpha), _length(row.d), _angle(row.theta))
        table.add_row(str(i), *numbers, limits)
    lines = [
        f"R0: {arm.base}",
        f"reach: {arm.reach * 1e3:g} mm {_REACH_OF[arm.reach_of]}",
        *(f"joint map, row {i}: {_row(row)}" for i, row in enumerate(_matrix(arm), 1)),
        *(f"source: {source}" for source in arm.sources),
    ]
    return Group(Text(f"{arm.name} (nominal)", style="bold"), table, *map(Text, lines))


def _matrix(arm: Arm) -> list[list[float]]:
    return [] if arm.joint_map is None else arm.joint_map.matrix


def _row(row: list[float]) -> str:
    return " ".join(f"{value:g}" for value in row)


def _length(value: float) -> str:
    return f"{round(value * 1e3, 6):g}"


def _angle(value: float | None) -> str:
    return "" if value is None else f"{round(degrees(value), 6):g}"
