"""Deflections predicted by the model of a run; nothing is stored. Load cases come as messages or as CSV."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import hypot
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from jointstiff.schemas.deflection import MAX_CASES, CaseResult, DeflectionOptions, DeflectionResult, LoadCase
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.run import Run, RunResult
from jointstiff.service.conversion.robots import (
    joint_factors,
    joint_kinds_by_name,
    refuse_far_point,
    refuse_wrong_joint_count,
)
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT
from jointstiff.service.runs.verdicts import (
    PAST_NO_VERDICT,
    RunModel,
    assess_with_run,
    find_beyond_campaign,
    find_beyond_limits,
    find_far_points,
    find_implausible_deflection,
    find_missing_numbers,
    moment_factor,
)
from jointstiff.service.tables.estimate import (
    ShownEstimate,
    model_error_text,
    normal_quantile,
    show_cell,
    show_estimate,
    style_for,
)
from jointstiff.service.tables.files import csv_text, split_table_rows
from jointstiff.service.tables.labels import is_label
from jointstiff.service.tables.report import remedies, to_do_lines, verdict_lines, with_overall_verdict
from jointstiff.service.tables.table import (
    NO_NUMBER,
    Chart,
    Column,
    Line,
    Part,
    Sheet,
    Table,
)
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.answers import build_case_results
from jointstiff.solver.predict.models import EXTRAPOLATED

MAX_CASE_WORK: Final = 150_000
"""Greatest product of load cases and joints squared in a request: each case takes matrices of n × n."""
_VECTORS: Final[Mapping[str, tuple[str, Mapping[str, float], str]]] = {
    "force": ("F", FORCE, "force"),
    "moment": ("M", MOMENT, "moment"),
    "load_point": ("load point ", LENGTH, "length"),
    "place": ("place ", LENGTH, "length"),
    "direction": ("direction ", {"": 1.0, "1": 1.0}, ""),
}
"""Field → beginning of its headers, unit → factor to SI, and name of its unit in `units` of a request."""
_SI_UNITS: Final = {"length": "m", "angle": "rad", "force": "N", "moment": "N.m"}
_SHOWN_UNITS: Final = {
    "m": (1e3, "mm"),
    "rad": (1e3, "mrad"),
    "N/m": (1e-3, "N/mm"),
    "m/N": (1e3, "mm/N"),
    "1": (1.0, "1"),
}
_CSV_COLUMNS: Final = {
    "label": "label",
    "displacement {x y z}": "displacement",
    "rotation {x y z}": "rotation",
    "displacement {x y z} readings only {low high}": "readings_only",
    "displacement {x y z} with model error {low high}": "with_model_error.displacement",
    "model error radius": "with_model_error.radius",
    "stiffness lateral free": "compliance.along.lateral_free",
    "stiffness lateral blocked": "compliance.along.lateral_blocked",
    "stiffness rotation blocked": "compliance.along.rotation_blocked",
    "worst compliance": "compliance.worst.compliance",
    "worst direction {x y z}": "compliance.worst.direction",
    "remarks": "remarks",
}

AnyMessage = TypeVar("AnyMessage", bound=BaseModel)


class TableColumn(NamedTuple):
    """Column of a table of load cases: `Fy [kN]` has field "force", component 1 and factor 1000, to N."""

    field: str  # field of a load case
    component: int  # index in the field: 0 to 2 for x to z, or of a joint
    factor: float  # converts the column's numbers to the unit that the table is read in


def predict_by_run(robot: Robot, run: Run, request: DeflectionOptions) -> DeflectionResult:
    """Predict the deflection of the load cases of a request, with the model of a run.

    Raises:
        RequestError: the run has no model of joints, or the request does not fit the robot.
    """
    length = LENGTH[request.units.length]
    run_model = RunModel.from_run(robot, run, absolute=request.absolute, masses=request.masses, length=length)
    cases = convert_load_cases(request, robot)
    answers = _answer_cases(run_model, cases, request)
    reasons = _find_reasons(robot, answers, cases, run_model.result)
    return DeflectionResult(
        joint_kinds=joint_kinds_by_name(robot),
        assessment=assess_with_run("prediction", reasons, run_model.result.assessment),
        confidence=request.confidence,
        model_error_postures=run_model.postures,
        remarks=run_model.remarks(request.confidence),
        cases=answers,
    )


def _answer_cases(run_model: RunModel, cases: LoadCases, request: DeflectionOptions) -> list[CaseResult]:
    """Return the deflection of each load case, with its intervals and, if known, its model error."""
    deflections = run_model.model.deflect(cases)
    bound = None
    if run_model.error is not None:
        bound = run_model.error.bound(cases, deflections.leverage, request.confidence)
    directions = _choose_directions(request, cases)
    labels = [case.label or str(number) for number, case in enumerate(request.cases, 1)]
    budget = run_model.result.budget
    return build_case_results(deflections, bound, directions, request.confidence, labels, budget)


def _choose_directions(request: DeflectionOptions, cases: LoadCases) -> FloatArray:
    """Return the unit vector (N, 3) along which the stiffness of each load case is reported.

    The vector is along the direction that the case states, or else along its force; without either NaN.
    """
    stated = [case.direction or force for case, force in zip(request.cases, cases.force, strict=True)]
    vectors: FloatArray = np.array(stated, dtype=np.float64)
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    divisors = np.where(lengths > 0.0, lengths, 1.0)
    return np.where(lengths > 0.0, vectors / divisors, np.nan)


def _find_reasons(
    robot: Robot, answers: Sequence[CaseResult], cases: LoadCases, run: RunResult
) -> list[Finding]:
    """Return reasons to doubt a prediction, in addition to those in the assessment of its run."""
    lengths = [hypot(*answer.displacement) for answer in answers if answer.displacement is not None]
    bounds = [answer.with_model_error for answer in answers if answer.with_model_error is not None]
    extrapolated_count = sum(max(bound.load_ratio, bound.leverage_ratio) > EXTRAPOLATED for bound in bounds)
    points = [*cases.load_point.tolist(), *cases.place.tolist()]
    without_number = [answer for answer in answers if answer.displacement is None]
    first = ""
    if without_number:
        first = ": ".join([without_number[0].label, *without_number[0].remarks[:1]])
    return [
        *find_implausible_deflection(max(lengths, default=None), run, PAST_NO_VERDICT),
        *find_missing_numbers(len(without_number), len(answers), "cases", first=first),
        *find_far_points(points),
        *find_beyond_campaign(extrapolated_count, len(answers), "cases"),
        *find_beyond_limits(robot, cases.joints, [answer.label for answer in answers]),
    ]


def convert_load_cases(request: DeflectionOptions, robot: Robot) -> LoadCases:
    """Convert the load cases of a request to SI units.

    Raises:
        RequestError: the cases are too many for the joints, a case has not one position for each joint, a
            load point is missing, a point is farther than any tool reaches, or a moment has no unit.
    """
    _refuse_too_many_cases(len(request.cases), robot.n)
    units, length = request.units, LENGTH[request.units.length]
    refuse_far_point(request.load_point, "load_point", length=length)
    refuse_far_point(request.place, "place", length=length)
    cases = [_complete_case(request, index, robot) for index in range(len(request.cases))]
    moments = np.array([case.moment for case in cases], dtype=np.float64)
    joints = joint_factors(robot, units) * np.array([case.joints for case in cases], dtype=np.float64)
    _refuse_many_turns(robot, joints)
    return LoadCases(
        joints=joints,
        force=FORCE[units.force] * np.array([case.force for case in cases], dtype=np.float64),
        moment=moment_factor(units, moments) * moments,
        load_point=length * np.array([case.load_point for case in cases], dtype=np.float64),
        place=length * np.array([case.place for case in cases], dtype=np.float64),
    )


def _refuse_many_turns(robot: Robot, joints: FloatArray) -> None:
    """Refuse postures (N, n) with an angle beyond two turns, because it must be in degrees.

    Raises:
        RequestError: the greatest angle exceeds two turns.
    """
    angles = np.abs(np.where(robot.prismatic, 0.0, joints))
    if angles.max() <= _MOST_TURNS:
        return
    row, joint = divmod(int(angles.argmax()), robot.n)
    raise RequestError(
        f"the angle of {robot.joint_names[joint]} is {angles[row, joint]:.4g} rad, beyond two turns",
        where=f"cases[{row}].joints",
        remedy="state the unit of the angles, deg or rad, as `units.angle`, or correct the angle",
    )


def _refuse_too_many_cases(count: int, joints: int) -> None:
    """Refuse more load cases than the memory for a request allows: each takes matrices of joints × joints.

    Raises:
        RequestError: there are too many cases for the number of joints.
    """
    max_cases = MAX_CASE_WORK // joints**2
    if count > max_cases:
        raise RequestError(
            f"{count} cases for {joints} joints are too many: cases × joints² may be at "
            f"most {MAX_CASE_WORK:,}",
            where="cases",
            remedy=f"send at most {max_cases} cases in a request",
        )


def _complete_case(request: DeflectionOptions, index: int, robot: Robot) -> LoadCase:
    """Return a load case of a request, with all fields that it does not state itself, in the request's units.

    The load point is that of the request; the place, whose deflection is predicted, is that of the request or
    else the load point; the moment is zero.

    Raises:
        RequestError: the case has not one position for each joint, a point is too far from the flange, or
            neither the case nor the request states the load point.
    """
    case, where, length = request.cases[index], f"cases[{index}]", LENGTH[request.units.length]
    refuse_wrong_joint_count(robot, case.joints, f"{where}.joints")
    refuse_far_point(case.load_point, f"{where}.load_point", length=length)
    refuse_far_point(case.place, f"{where}.place", length=length)
    load_point = case.load_point or request.load_point
    if load_point is None:
        raise RequestError(
            "the load point is missing",
            where=f"{where}.load_point",
            remedy="give `load_point`, in the flange frame, for all cases together or for each case",
        )
    place = case.place or request.place or load_point
    moment = case.moment or (0.0, 0.0, 0.0)
    return case.model_copy(update={"load_point": load_point, "place": place, "moment": moment})


def read_load_cases(text: str, joints: Mapping[str, JointKind], **options: Any) -> DeflectionOptions:  # noqa: ANN401
    """Parse a table of load cases; return the cases and the other fields of a request, validated.

    Columns: `label`; a position for each joint, as `J1 [deg]` or by the joint's name (of a prismatic joint
    `J3 [mm]`); `Fx [N]`, `Fy [N]`, `Fz [N]`; optionally `Mx [N.m]` …, `load point x [mm]` …, `place x [mm]` …
    (both in the flange frame) and `direction x` …. Cells are separated by commas, semicolons or tabs; with
    semicolons or tabs a number may have a decimal comma.

    Args:
        text: the table.
        joints: kinds of the robot's n joints by name, in their order.
        options: other fields of the request, in the units that its field `units` states; by default SI.

    Raises:
        RequestError: a header, a cell or an option is not valid; the error names its line and column.
    """
    rows, has_comma_separators = split_table_rows(text)
    if not rows or not any(any(row) for row in rows[1:]):
        raise RequestError(
            "the table has no load cases", where="line 1", remedy="give a header and one row per case"
        )
    units = _complete_units(options.get("units", {}))
    columns = [_parse_header(header, joints, units) for header in rows[0]]
    _refuse_missing_columns(columns, len(joints))
    cases = [
        _read_case(row, columns, line, decimal_comma=not has_comma_separators)
        for line, row in enumerate(rows[1:], 2)
        if any(row)
    ]
    if len(cases) > MAX_CASES:
        raise RequestError(
            f"the table has {len(cases):,} load cases",
            where="cases",
            remedy=f"split the table into tables of at most {MAX_CASES:,} cases",
        )
    return _validate_message(DeflectionOptions, {**options, "units": units, "cases": cases})


def _complete_units(stated: object) -> Units:
    """Return stated units, or SI units where none is stated: {"length": "mm"} → mm, rad, N, N.m.

    Raises:
        RequestError: a unit is not known.
    """
    if isinstance(stated, Units):
        stated = stated.model_dump()
    if isinstance(stated, Mapping):
        stated = _SI_UNITS | {name: unit for name, unit in stated.items() if unit is not None}
    return _validate_message(Units, stated, "units")


def _validate_message(message_class: type[AnyMessage], fields: object, *path: str) -> AnyMessage:
    """Return a message of a class, built from fields.

    Raises:
        RequestError: a field is not valid; `path`, the path of the fields, precedes the path of the fault.
    """
    try:
        return message_class.model_validate(fields)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(map(str, (*path, *fault["loc"])))
        raise RequestError(str(fault["msg"]), where=place, remedy="correct the value") from None


_MOST_TURNS: Final = 4.0 * np.pi
"""Greatest angle of a joint [rad]: two turns."""
_OF_POSES: Final = frozenset(("x", "y", "z", "a", "b", "c", "rx", "ry", "rz", "q1", "q2", "q3", "q4"))
"""Names of columns, in small letters, of tables of poses."""
_POSES_ARE_CORRECTED: Final = (
    "; a table of poses is for `jointstiff correct`, in Python `run.correct`, over HTTP /v1/corrections"
)


def _parse_header(header: str, joints: Mapping[str, JointKind], units: Units) -> TableColumn:
    """Parse a header such as `J1 [deg]`; the factor of the column converts to the units of the request.

    Raises:
        RequestError: the name is unknown, or the unit is missing or does not belong to the field.
    """
    name = header.partition("[")[0].strip()
    if is_label(name):
        return TableColumn("label", 0, 1.0)
    joint = _find_joint(name, list(joints))
    if joint is not None:
        kind = list(joints.values())[joint]
        return TableColumn("joints", joint, _find_joint_factor(header, kind, units))
    column = parse_vector_header(header, _VECTORS)
    if column is None:
        raise RequestError(
            f"the header '{header}' is not known",
            where="line 1",
            remedy="use label, J1 [deg], Fx [N], Mx [N.m], load point x [mm], place x [mm], direction x, …"
            + (_POSES_ARE_CORRECTED if name.lower() in _OF_POSES else ""),
        )
    _, factors, quantity = _VECTORS[column.field]
    return column._replace(factor=column.factor / factors[getattr(units, quantity, "")])


def _find_joint(name: str, joint_names: Sequence[str]) -> int | None:
    """Return the index of the joint that a name means, its own or J1, J2, …; None for no joint."""
    if name in joint_names:
        return joint_names.index(name)
    match = re.fullmatch(r"J(\d+)", name)
    if match is None:
        return None
    number = int(match[1])
    return number - 1 if 1 <= number <= len(joint_names) else None


def _find_joint_factor(header: str, kind: JointKind, units: Units) -> float:
    """Return the factor from the unit in the header of a joint's column to the unit of the request."""
    if kind == "prismatic":
        return parse_unit_factor(header, LENGTH) / LENGTH[units.length]
    return parse_unit_factor(header, ANGLE) / ANGLE[units.angle]


def parse_vector_header(header: str, fields: Sequence[str] | Mapping[str, Any]) -> TableColumn | None:
    """Parse the header of a vector's component, such as `Fx [N]`; the column's factor converts to SI units.

    None if the name is no component of a vector in `fields`, which are keys of `_VECTORS`.

    Raises:
        RequestError: the unit is missing, or does not belong to the field.
    """
    name = header.partition("[")[0].strip().lower()
    for field in fields:
        prefix, factors, _ = _VECTORS[field]
        for component, axis in enumerate("xyz"):
            if name == f"{prefix}{axis}".lower():
                return TableColumn(field, component, parse_unit_factor(header, factors))
    return None


def parse_unit_factor(header: str, units: Mapping[str, float]) -> float:
    """Return the factor to SI units of the unit in a header such as `Fx [N]`.

    Args:
        header: name, with the unit in brackets behind it.
        units: unit that the header may have → factor to SI.

    Raises:
        RequestError: the header has no unit, or a unit that is not in `units`.
    """
    unit = header.partition("[")[2].strip().removesuffix("]").strip()
    if unit not in units:
        raise RequestError(
            f"the header '{header}' has {f'the unit {unit}' if unit else 'no unit'}",
            where="line 1",
            remedy=f"write one of {', '.join(f'[{name}]' for name in units if name)} behind the name",
        )
    return units[unit]


def _refuse_missing_columns(columns: Sequence[TableColumn], joints: int) -> None:
    """Refuse a table in which the column of a joint or of a vector's component is missing or repeated.

    Args:
        columns: columns of the table.
        joints: number of joints.
    """
    present = [(column.field, column.component) for column in columns]
    repeated = [each for each in present if present.count(each) > 1]
    missing = [each for each in _list_needed_columns(present, joints) if each not in present]
    if not repeated and not missing:
        return
    first_fault = repeated[0] if repeated else missing[0]
    fault = "occurs twice" if repeated else "is missing"
    raise RequestError(
        f"the column {_name_column(*first_fault)} {fault}",
        where="line 1",
        remedy="give one column for each joint and three for each vector",
    )


def _list_needed_columns(present: Sequence[tuple[str, int]], joints: int) -> list[tuple[str, int]]:
    """Return (field, component) of each column that a table needs, if it has the columns `present`.

    The joints and the force are needed; other vectors may be left out, but only with all three components.
    """
    needed = [("joints", joint) for joint in range(joints)]
    present_fields = {field for field, _ in present}
    for field in _VECTORS:
        if field == "force" or field in present_fields:
            needed += [(field, component) for component in range(3)]
    return needed


def _name_column(field: str, index: int) -> str:
    """Return the name of the column of a component: `J2` of a joint, `Fx` of the force, `label`."""
    if field == "joints":
        return f"J{index + 1}"
    if field in _VECTORS:
        return f"{_VECTORS[field][0]}{'xyz'[index]}"
    return field


def _read_case(
    row: Sequence[str], columns: Sequence[TableColumn], line: int, *, decimal_comma: bool
) -> dict[str, Any]:
    """Parse a row of the table; return field → value of a load case, vectors as lists in the request's units.

    Args:
        row: cells of the row.
        columns: columns of the table; their factors convert to the request's units.
        line: line of the row, for errors.
        decimal_comma: whether a comma is the decimal mark.

    Raises:
        RequestError: a cell is not a number, or the row has another number of cells than the header.
    """
    if len(row) != len(columns):
        raise RequestError(
            f"the row has {len(row)} cells, but the table has {len(columns)} headers",
            where=f"line {line}",
            remedy="give a cell for each header",
        )
    label: dict[str, Any] = {}
    components = dict[str, dict[int, float]]()  # field → component → number
    for number, (text, column) in enumerate(zip(row, columns, strict=True), 1):
        if column.field == "label":
            label = {"label": text or None}
            continue
        decimal = text.replace(",", ".") if decimal_comma else text
        value = column.factor * _parse_number(decimal, text, f"line {line}, column {number}")
        components.setdefault(column.field, {})[column.component] = value
    vectors = {field: [numbers[i] for i in sorted(numbers)] for field, numbers in components.items()}
    return label | vectors


def _parse_number(decimal: str, text: str, where: str) -> float:
    """Return the number in a cell, given with a decimal point, and as the user wrote it for the error.

    Raises:
        RequestError: the cell is not a number.
    """
    try:
        return float(decimal)
    except ValueError:
        raise RequestError(f"'{text[:40]}' is not a number", where=where, remedy="write a number") from None


def describe_predictions(result: DeflectionResult) -> list[Part]:
    """Lay out predictions for people: verdict, table with a row for each case (mm, N/mm), and remarks."""
    cases = result.cases
    extents = [_describe_model_error(case) for case in cases]
    is_same_extent = len(set(extents)) == 1
    columns = [Column("case", [case.label for case in cases], text=True), *_list_shown_numbers(result)]
    if not is_same_extent:
        columns.insert(-1, Column("model error", extents))  # before the stiffness
    source = f"model error {extents[0]}" if is_same_extent else "with the model error where it is known"
    caption = f"in brackets: {100 * result.confidence:g} % interval, {source}; stiffness along the force"
    table = Table(columns, title="Deflections in R0", caption=caption, plain=True)
    remarks = [Line(f"{case.label}: {'; '.join(case.remarks)}") for case in cases if case.remarks]
    to_do = to_do_lines(remedies(result.assessment), details=True)
    return [*verdict_lines(result.assessment, details=True), table, *remarks, *to_do]


def _list_shown_numbers(result: DeflectionResult) -> list[Column]:
    """Return the columns x, y, z [mm] and stiffness [N/mm] of predictions, in the style of the verdict."""
    columns = list[Column]()
    style = style_for(result.assessment.verdict)
    for i, axis in enumerate("xyz"):
        components = [replace(show_component(case, i), style=style) for case in result.cases]
        columns.append(Column(axis, components, show_cell, "mm"))
    stiffnesses = [replace(_show_stiffness(case, result.confidence), style=style) for case in result.cases]
    columns.append(Column("stiffness", stiffnesses, show_cell, "N/mm"))
    return columns


def _describe_model_error(case: CaseResult) -> str:
    """Return whether the interval of a case includes the model error; a dash for a case without numbers."""
    if case.displacement is None:
        return NO_NUMBER
    return model_error_text(case.with_model_error is not None)


def show_component(case: CaseResult, axis: int, scale: float = 1e3) -> ShownEstimate:
    """Format a component of the displacement with its interval, in mm or times another scale."""
    if case.displacement is None:
        return show_estimate(None, None)
    bounds = case.with_model_error.displacement if case.with_model_error else case.readings_only
    return show_estimate(
        case.displacement[axis],
        None if bounds is None else bounds[axis],
        scale,
        bare=".3g",
        least=1e-3 * hypot(*case.displacement),
    )


def _show_stiffness(case: CaseResult, confidence: float) -> ShownEstimate:
    """Format the stiffness along the force in N/mm, with its interval from the readings alone."""
    along = None if case.compliance is None else case.compliance.along
    if along is None or along.lateral_free is None:
        return show_estimate(None, None)
    if along.standard_uncertainty is None:
        return show_estimate(along.lateral_free, None, 1e-3, bare=".3g")
    factor = normal_quantile(confidence) if case.budget is None else case.budget.coverage_factor
    half = factor * along.standard_uncertainty
    least, greatest = along.compliance - half, along.compliance + half
    ends = (1.0 / greatest, 1.0 / least if least > 0.0 else None)
    return show_estimate(along.lateral_free, ends, 1e-3, bare=".3g")


def prediction_sheet(result: DeflectionResult) -> Sheet:
    """Return predictions as a sheet: a row for each load case, and a column with the overall verdict."""
    return with_overall_verdict(
        Sheet.from_messages(result.cases, _CSV_COLUMNS, _SHOWN_UNITS), result.assessment
    )


def prediction_charts(result: DeflectionResult) -> list[Chart]:
    """Return one chart in a list: the displacement of each load case along x, y and z, with its interval."""
    series = {
        axis: [case.displacement and case.displacement[i] for case in result.cases]
        for i, axis in enumerate("xyz")
    }
    intervals = {
        axis: [None if case.readings_only is None else case.readings_only[i] for case in result.cases]
        for i, axis in enumerate("xyz")
    }
    names = [case.label for case in result.cases]
    title = "Displacement, axes of R0"
    return [Chart(title, names, series, 1e3, "mm", "cases", intervals, quantity="displacement")]


def prediction_csv(result: DeflectionResult) -> str:
    """Return predictions as CSV; a missing number is an empty cell."""
    return csv_text(prediction_sheet(result))
