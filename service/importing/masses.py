"""A table of masses: the bodies that the joints of a robot carry, for stiffness by its own weight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from pydantic import ValidationError

from jointstiff.schemas.imports import (
    MAX_PREVIEW_ROWS,
    ColumnMeaning,
    DecimalMark,
    FilePreview,
    ImportOptions,
)
from jointstiff.schemas.robot import Body
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grammar import MASSES, folded, split_unit
from jointstiff.service.importing.grid import Grid, Row, decide_mark, read_number

_NEEDED: Final = ("name", "joint", "mass", "x", "y", "z")
_CENTRE: Final = ("x", "y", "z")
_UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "mass": {"kg": 1.0},
    "bound": {"%": 0.01, "kg": 1.0},
    **{kind: {"m": 1.0, "mm": 1e-3} for kind in (*_CENTRE, "radius")},
}
"""Units of each column of numbers, and their factors; of bounds in kg next to the mass."""


def is_masses(grid: Grid) -> bool:
    """Return whether the first row of a table has columns for a mass and for the joint that carries it."""
    kinds = [MASSES.get(folded(split_unit(cell)[0])) for cell in grid.rows[0].cells]
    return "mass" in kinds and "joint" in kinds


def read_masses(grid: Grid, options: ImportOptions, faults: Faults) -> tuple[list[Body], FilePreview]:
    """Return the bodies of a table of masses, and the file as it was read.

    Raises:
        ImportFileError: a header is not understood, lacks its unit, or is missing.
    """
    header, *rows = grid.rows
    columns: dict[str, int] = {}
    units: dict[str, str] = {}
    for column, text in enumerate(header.cells):
        base, unit = split_unit(text)
        kind, place = MASSES.get(folded(base)), grid.place(header, column)
        if kind is None or kind in columns:
            reason = f"the header {shown(text)} of a table of masses is not known, or there twice"
            remedy = "use `body`, `joint`, `mass [kg]`, `± [%]`, `centre x [mm]`, y, z, `centre ± [mm]`"
            raise ImportFileError(place, reason, remedy)
        if kind in _UNITS and unit not in _UNITS[kind]:
            reason = f"the unit of {shown(text)} is not one of {', '.join(_UNITS[kind])}"
            raise ImportFileError(place, reason, f"write it as in `{base} [{next(iter(_UNITS[kind]))}]`")
        columns[kind] = column
        units[kind] = unit or ""
    absent = [kind for kind in _NEEDED if kind not in columns]
    if absent or not rows:
        reason = f"the table of masses has no {'row' if not absent else 'column ' + ', '.join(absent)}"
        raise ImportFileError(Place(grid.file, header.line), reason, "add it")
    whole = []
    for row in rows:
        if len(row.cells) == len(columns):
            whole.append(row)
        else:
            reason = f"the row has {len(row.cells)} cells, but the header {len(columns)}"
            faults.report(grid.place(row), reason, "give every row the same number of cells")
    numbers = [columns[kind] for kind in columns if kind in _UNITS]
    mark, assumed = decide_mark(grid, whole, numbers, options.decimal_mark)
    bodies = []
    for row in whole:
        with faults.collected(grid.place(row)):
            bodies.append(_body(grid, row, columns, units, mark))
    meanings = [
        ColumnMeaning(column=column + 1, header=header.cells[column], meaning=kind, unit=units[kind] or None)
        for kind, column in columns.items()
    ]
    update = {
        "decimal_mark": mark if grid.preview.format == "text" else None,
        "columns": meanings,
        "row_count": len(rows),
        "first_rows": [list(row.cells) for row in rows[:MAX_PREVIEW_ROWS]],
        "assumptions": [*grid.preview.assumptions, "read as masses", *([assumed] if assumed else [])],
        "header_lines": [header.line],
        "first_lines": [row.line for row in rows[:MAX_PREVIEW_ROWS]],
    }
    return bodies, grid.preview.model_copy(update=update)


def _body(
    grid: Grid, row: Row, columns: Mapping[str, int], units: Mapping[str, str], mark: DecimalMark
) -> Body:
    """Return the body of a row; its bounds are relative to its mass.

    Raises:
        ImportFileError: a cell is no number, or the numbers make no body.
    """
    value: dict[str, float] = {}
    for kind in [kind for kind in columns if kind in _UNITS]:
        try:
            value[kind] = read_number(row.cells[columns[kind]], mark) * _UNITS[kind][units[kind]]
        except ImportFileError as fault:
            raise fault.at(grid.place(row, columns[kind])) from None
    optional = {}
    if "bound" in value:
        per = value["mass"] or 1.0 if units["bound"] == "kg" else 1.0
        optional["mass_uncertainty"] = value["bound"] / per
    if "radius" in value:
        optional["centre_uncertainty"] = value["radius"]
    try:
        return Body(
            name=row.cells[columns["name"]],
            joint=row.cells[columns["joint"]],
            mass=value["mass"],
            centre=(value["x"], value["y"], value["z"]),
            **optional,
        )
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        reason = f"the row is no body: {'.'.join(map(str, first['loc']))}: {first['msg'].lower()}"
        raise ImportFileError(grid.place(row), reason, "correct its numbers") from error
