"""Tables of load cases and of predictions: CSV with units in the headers."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError

from jointstiff.schemas.deflection import MAX_CASES, CaseResult, DeflectionOptions, DeflectionResult
from jointstiff.schemas.measurement import Units
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT
from jointstiff.service.tables.files import csv_text
from jointstiff.service.tables.report import judged, verdict_lines
from jointstiff.service.tables.table import NO_NUMBER, Column, Line, Part, Sheet, Table, Value, number
from jointstiff.solver.errors import RequestError

_HEADER: Final = re.compile(r"(.*?)\s*(?:\[\s*(.*?)\s*\])?\s*")
_VECTORS: Final = {
    "force": ("F", FORCE, "force"),
    "moment": ("M", MOMENT, "moment"),
    "load_point": ("load point ", LENGTH, "length"),
    "place": ("place ", LENGTH, "length"),
    "direction": ("direction ", {"": 1.0, "1": 1.0}, ""),
}
_SI: Final = {"length": "m", "angle": "rad", "force": "N", "moment": "N.m"}

AnyMessage = TypeVar("AnyMessage", bound=BaseModel)
_Column = tuple[str, int, float]
"""Field of a case, place in it, and factor to the units of the message."""


def read_load_cases(text: str, joint_names: Sequence[str], **options: Any) -> DeflectionOptions:  # noqa: ANN401
    """Understand a table of load cases.

    Columns: `label`; an angle for each joint, as `J1 [deg]` or by the joint's name; `Fx [N]`, `Fy [N]`,
    `Fz [N]`; and, where they are wanted, `Mx [N.m]` …, `load point x [mm]` …, `place x [mm]` … (both in the
    flange frame) and `direction x` …. Cells are parted by commas, semicolons or tabs; between semicolons and
    tabs a decimal comma may stand.

    Args:
        text: of the table.
        joint_names: of the n joints.
        options: other fields of the message, in their `units`; SI where these name none.

    Raises:
        RequestError: a header or a cell that cannot be understood, by its line and column, or an option.
    """
    delimiter = next((sign for sign in ";\t" if sign in text.partition("\n")[0]), ",")
    rows = list(csv.reader(io.StringIO(text.removeprefix("\ufeff")), delimiter=delimiter))
    rows = [[cell.strip() for cell in row] for row in rows]
    if not rows or not any(any(row) for row in rows[1:]):
        raise RequestError(
            "the table has no load cases", where="line 1", remedy="give a header and one row per case"
        )
    units = _units(options.get("units", {}))
    columns = [_column(header, joint_names, units) for header in rows[0]]
    _refuse_missing(columns, len(joint_names))
    cases = [_case(row, columns, i, delimiter) for i, row in enumerate(rows[1:], 2) if any(row)]
    if len(cases) > MAX_CASES:
        raise RequestError(
            f"{len(cases):,} cases", where="cases", remedy=f"split them: at most {MAX_CASES:,}"
        )
    return _validated(DeflectionOptions, {**options, "units": units, "cases": cases})


def _units(stated: Units | Mapping[str, Any] | None) -> Units:
    """Return units that a request states, completed by SI."""
    if isinstance(stated, Units):
        stated = stated.model_dump()
    if isinstance(stated, Mapping):
        stated = _SI | {name: unit for name, unit in stated.items() if unit is not None}
    return _validated(Units, stated, "units")


def _validated(message: type[AnyMessage], fields: object, *where: str) -> AnyMessage:
    try:
        return message.model_validate(fields)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(map(str, (*where, *fault["loc"])))
        raise RequestError(str(fault["msg"]), where=place, remedy="correct it") from None


def _column(header: str, joint_names: Sequence[str], units: Units) -> _Column:
    match = _HEADER.fullmatch(header)
    name, unit = (match[1] or "", match[2] or "") if match else (header, "")
    if name.lower() == "label":
        return "label", 0, 1.0
    joint = re.fullmatch(r"J(\d+)", name)
    if name in joint_names or (joint and 1 <= int(joint[1]) <= len(joint_names)):
        place = joint_names.index(name) if name in joint_names else int(joint[1]) - 1 if joint else 0
        return "joints", place, _factor(header, unit, ANGLE) / ANGLE[units.angle]
    for field, (prefix, sizes, quantity) in _VECTORS.items():
        for k, axis in enumerate("xyz"):
            if name.lower() == f"{prefix}{axis}".lower():
                return field, k, _factor(header, unit, sizes) / sizes[getattr(units, quantity, "")]
    raise RequestError(
        f"the header '{header}' is not known",
        where="line 1",
        remedy="use label, J1 [deg], Fx [N], Mx [N.m], load point x [mm], place x [mm], direction x, …",
    )


def _factor(header: str, unit: str, units: dict[str, float]) -> float:
    if unit not in units:
        raise RequestError(
            f"the header '{header}' has {f'the unit {unit}' if unit else 'no unit'}",
            where="line 1",
            remedy=f"write one of {', '.join(f'[{name}]' for name in units if name)} behind the name",
        )
    return units[unit]


def _refuse_missing(columns: list[_Column], joints: int) -> None:
    places = [(field, k) for field, k, _ in columns]
    twice = next((place for place in places if places.count(place) > 1), None)
    needed = [("joints", k) for k in range(joints)]
    needed += [
        (f, k) for f in _VECTORS if f == "force" or any(f == field for field, _ in places) for k in range(3)
    ]
    missing = next((place for place in needed if place not in places), None)
    if twice or missing:
        field, k = twice or missing or ("", 0)
        name = (
            f"J{k + 1}"
            if field == "joints"
            else f"{_VECTORS[field][0]}{'xyz'[k]}"
            if field in _VECTORS
            else field
        )
        raise RequestError(
            f"the column {name} {'occurs twice' if twice else 'is missing'}",
            where="line 1",
            remedy="give one column for each joint and three for each vector",
        )


def _case(row: list[str], columns: list[_Column], line: int, delimiter: str) -> dict[str, Any]:
    if len(row) != len(columns):
        raise RequestError(
            f"{len(row)} cells under {len(columns)} headers",
            where=f"line {line}",
            remedy="give a cell for each header",
        )
    case: dict[str, Any] = {}
    for place, (text, (field, k, factor)) in enumerate(zip(row, columns, strict=True), 1):
        if field == "label":
            case["label"] = text or None
            continue
        try:
            value = factor * float(text if delimiter == "," else text.replace(",", "."))
        except ValueError:
            raise RequestError(
                f"'{text[:40]}' is not a number", where=f"line {line}, column {place}", remedy="correct it"
            ) from None
        case.setdefault(field, {})[k] = value
    return {
        field: [values[k] for k in sorted(values)] if isinstance(values, dict) else values
        for field, values in case.items()
    }


def prediction_parts(result: DeflectionResult) -> list[Part]:
    """Return predictions for people: the verdict, a row for each case in mm and N/mm, then the remarks."""
    percent, cases = f"{100 * result.confidence:g} %", result.cases
    along = [None if case.compliance is None else case.compliance.along for case in cases]
    stiffness = [each and each.lateral_free for each in along]
    table = Table(
        [
            Column("case", [case.label for case in cases], text=True),
            *(
                Column(f"{axis} ± U", [_component(case, i) for case in cases], unit="mm")
                for i, axis in enumerate("xyz")
            ),
            Column(
                "model error",
                [case.with_model_error and case.with_model_error.radius for case in cases],
                number(".3f", 1e3),
                "mm",
            ),
            Column("stiffness", stiffness, number(".0f", 1e-3), "N/mm"),
        ],
        title="Deflections in R0, with U from the readings only",
        caption=f"U and model error at {percent}; stiffness along the force, free to move sideways",
        plain=True,
    )
    lines = verdict_lines(result.assessment, details=False)
    return [
        *lines,
        table,
        *(Line(f"{case.label}: {'; '.join(case.remarks)}") for case in cases if case.remarks),
    ]


def _component(case: CaseResult, axis: int) -> str:
    """Return a component of the displacement with the half width of its interval, in mm."""
    if case.displacement is None:
        return NO_NUMBER
    low, high = (None, None) if case.readings_only is None else case.readings_only.displacement[axis]
    half = "" if low is None or high is None else f" ± {500 * (high - low):.3f}"
    return f"{1e3 * case.displacement[axis]:.3f}{half}"


def prediction_csv(result: DeflectionResult) -> str:
    """Return predictions as a table for spreadsheets, one row a case; what has no number is an empty cell."""
    return csv_text(judged(Sheet.of_rows(_prediction_row(case) for case in result.cases), result.assessment))


def _prediction_row(case: CaseResult) -> dict[str, Value]:
    row: dict[str, Value] = {"label": case.label}
    _add(row, "displacement {} [mm]", case.displacement, 1e3)
    _add(row, "rotation {} [mrad]", case.rotation, 1e3)
    for name, bounds in (("readings only", case.readings_only), ("with model error", case.with_model_error)):
        for k, end in enumerate(("low", "high")):
            values = None if bounds is None else [pair[k] for pair in bounds.displacement]
            _add(row, f"displacement {{}} {name} {end} [mm]", values, 1e3)
    bound, compliance = case.with_model_error, case.compliance
    row["model error radius [mm]"] = None if bound is None else 1e3 * bound.radius
    along = None if compliance is None else compliance.along
    for name in ("lateral_free", "lateral_blocked", "rotation_blocked"):
        stiffness = None if along is None else getattr(along, name)
        row[f"stiffness {name.replace('_', ' ')} [N/mm]"] = None if stiffness is None else 1e-3 * stiffness
    worst = None if compliance is None else compliance.worst
    row["worst compliance [mm/N]"] = None if worst is None else 1e3 * worst.compliance
    _add(row, "worst direction {}", None if worst is None else worst.direction, 1.0)
    row["remarks"] = "; ".join(case.remarks) or None
    return row


def _add(row: dict[str, Value], header: str, values: Sequence[float] | None, factor: float) -> None:
    for k, axis in enumerate("xyz"):
        row[header.format(axis)] = None if values is None else factor * values[k]
