"""A table of masses: the bodies that the joints of a robot carry, for stiffness by its own weight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from pydantic import ValidationError

from jointstiff.schemas.imports import (
    ColumnMeaning,
    DecimalMark,
    FilePreview,
    ImportOptions,
)
from jointstiff.schemas.robot import Body
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, quote
from jointstiff.service.importing.grammar import MASSES, split_unit
from jointstiff.service.importing.grid import Grid, Row, decide_decimal_mark, read_number
from jointstiff.service.tables.labels import fold_word

_NEEDED_COLUMNS: Final = ("name", "joint", "mass", "x", "y", "z")
_CENTRE: Final = ("x", "y", "z")
_UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "mass": {"kg": 1.0},
    "bound": {"%": 0.01, "kg": 1.0},
    **{kind: {"m": 1.0, "mm": 1e-3} for kind in (*_CENTRE, "radius")},
}
"""Units of each column of numbers, and their factors to SI units; a bound in kg is divided by the mass."""


def is_mass_table(grid: Grid) -> bool:
    """Return whether the first row of a table names a column of masses and a column of joints."""
    kinds = [MASSES.get(fold_word(split_unit(cell)[0])) for cell in grid.rows[0].cells]
    return "mass" in kinds and "joint" in kinds


@dataclass(frozen=True)
class _Column:
    """Column of a table of masses."""

    index: int
    unit: str  # empty for a column without a unit


def read_mass_table(grid: Grid, options: ImportOptions, faults: Faults) -> tuple[list[Body], FilePreview]:
    """Return the bodies of a table of masses, and the preview of the file; add faults of rows to `faults`.

    Raises:
        ImportFileError: a header is not understood, has no known unit, or is missing.
    """
    header, *rows = grid.rows
    columns = _read_mass_header(grid, header, has_rows=bool(rows))
    complete = _select_complete_rows(grid, rows, len(columns), faults)
    number_columns = [column.index for kind, column in columns.items() if kind in _UNITS]
    mark, note_on_mark = decide_decimal_mark(grid, complete, number_columns, options.decimal_mark)
    bodies = []
    for row in complete:
        with faults.collect(grid.place(row)):
            bodies.append(_read_body(grid, row, columns, mark))
    meanings = [
        ColumnMeaning(
            column=column.index + 1,
            header=header.cells[column.index],
            meaning=kind,
            unit=column.unit or None,
        )
        for kind, column in columns.items()
    ]
    notes = [*grid.preview.assumptions, "read as masses", *([note_on_mark] if note_on_mark else [])]
    return bodies, grid.preview_table([header.line], rows, meanings, mark, notes)


def _select_complete_rows(grid: Grid, rows: Sequence[Row], width: int, faults: Faults) -> list[Row]:
    """Return the rows that have as many cells as the header, `width`; report the other rows."""
    complete = []
    for row in rows:
        if len(row.cells) == width:
            complete.append(row)
        else:
            reason = f"the row has {len(row.cells)} cells, but the header {width}"
            faults.report(grid.place(row), reason, "give every row the same number of cells")
    return complete


def _read_mass_header(grid: Grid, header: Row, *, has_rows: bool) -> dict[str, _Column]:
    """Return kind → column of a table of masses; `has_rows` is False if no row follows the header.

    Kinds are `name`, `joint`, `mass` and others, as `MASSES` names them.

    Raises:
        ImportFileError: a header is not understood, has no known unit, or is missing, or no row follows.
    """
    columns: dict[str, _Column] = {}
    for index, text in enumerate(header.cells):
        base, unit = split_unit(text)
        kind, place = MASSES.get(fold_word(base)), grid.place(header, index)
        if kind is None or kind in columns:
            reason = f"the header {quote(text)} of a table of masses is unknown, or occurs twice"
            remedy = "use `body`, `joint`, `mass [kg]`, `± [%]`, `centre x [mm]`, y, z, `centre ± [mm]`"
            raise ImportFileError(place, reason, remedy)
        if kind in _UNITS and unit not in _UNITS[kind]:
            reason = f"the unit of {quote(text)} is not one of {', '.join(_UNITS[kind])}"
            remedy = f"write the unit as in `{base} [{next(iter(_UNITS[kind]))}]`"
            raise ImportFileError(place, reason, remedy)
        columns[kind] = _Column(index, unit or "")
    absent = [kind for kind in _NEEDED_COLUMNS if kind not in columns]
    if absent or not has_rows:
        reason = f"the table of masses has no {'row' if not absent else 'column ' + ', '.join(absent)}"
        raise ImportFileError(Place(grid.file, header.line), reason, "add the missing row or column")
    return columns


def _read_body(grid: Grid, row: Row, columns: Mapping[str, _Column], mark: DecimalMark) -> Body:
    """Return the body of a row in SI units, with the uncertainty of its mass relative to the mass.

    Args:
        grid: the file.
        row: row of the table.
        columns: kind → column, such as `mass` or `x`.
        mark: decimal mark of the file.

    Raises:
        ImportFileError: a cell is not a number, or the numbers do not describe a body.
    """
    values = _read_values(grid, row, columns, mark)
    optional = {}
    if "bound" in values:
        # A bound in kg is divided by the mass; `or 1.0` avoids a division by zero for a mass of 0.
        divisor = values["mass"] or 1.0 if columns["bound"].unit == "kg" else 1.0
        optional["mass_uncertainty"] = values["bound"] / divisor
    if "radius" in values:
        optional["centre_uncertainty"] = values["radius"]
    try:
        return Body(
            name=row.cells[columns["name"].index],
            joint=row.cells[columns["joint"].index],
            mass=values["mass"],
            centre=(values["x"], values["y"], values["z"]),
            **optional,
        )
    except ValidationError as error:
        first_error = error.errors(include_url=False, include_context=False, include_input=False)[0]
        invalid = f"{'.'.join(map(str, first_error['loc']))}: {first_error['msg'].lower()}"
        reason = f"the row does not describe a body: {invalid}"
        raise ImportFileError(grid.place(row), reason, "correct the numbers of the row") from error


def _read_values(grid: Grid, row: Row, columns: Mapping[str, _Column], mark: DecimalMark) -> dict[str, float]:
    """Return kind → number of a row in SI units, for its columns of numbers; percentages are fractions.

    Raises:
        ImportFileError: a cell is not a number.
    """
    values = {}
    for kind, column in columns.items():
        if kind in _UNITS:
            try:
                number = read_number(row.cells[column.index], mark)
            except ImportFileError as fault:
                raise fault.add_place(grid.place(row, column.index)) from None
            values[kind] = number * _UNITS[kind][column.unit]
    return values
