"""A plan of postures and loads to measure: the declaration of the kind, its report, and its table as CSV."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import product
from math import degrees, hypot
from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.schemas.plan import (
    Cable,
    DeadWeight,
    LoadPointGoal,
    Plan,
    PlannedJoint,
    PlannedReading,
    PlanOptions,
    PlanRequest,
    PlanResult,
)
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import Campaign
from jointstiff.service.kinds.kind import READINGS_BYTES, File, Kind
from jointstiff.service.tables.estimate import NORMAL_95, half_width, width_cell
from jointstiff.service.tables.report import Report, View
from jointstiff.service.tables.table import Chart, Column, Line, Sheet, Table, as_line, number_formatter
from jointstiff.solver.errors import RequestError
from jointstiff.solver.text import length_text

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs

_DOWN: Final = -0.9999
"""Component along z of R0 below which a unit vector counts as pointing down."""
_TIGHT: Final = 0.3
"""Certified efficiency below which the bound is probably loose, rather than the list of readings poor."""
_CRITERIA = {
    "relative_a": "relative uncertainty of the joints",
    "work_area": "predictions in the work area",
    "worst_place": "predictions at the worst place",
    "d": "volume of the uncertainty ellipsoid",
    "e": "worst combination of joints",
}


def _make_report(job: Plan, result: PlanResult, view: View) -> Report:
    """Return the report of a plan: predicted uncertainties, list of readings, quality of the plan."""
    lines = [
        _describe_efficiency(result),
        _describe_feasibility(result),
        *_describe_length(job, result),
        *_describe_predictions(result),
    ]
    if job.request.measurement_set_id is not None:
        lines.append(
            "the list has only the new readings, but the predicted uncertainties also use the readings "
            "of the campaign so far: identify old and new readings together"
        )
    readings = _readings_table(job, result, has_tick_boxes=view.details)
    return Report([_joints_table(job, result), readings, *map(Line, lines)])


def _describe_length(job: Plan, result: PlanResult) -> Iterator[str]:
    """Yield lines on the number of readings: how many meet the goal, and after which a person can stop."""
    if result.goal_share is not None:
        goal_text = _describe_goal(job, result.goal_share)
        yield f"{len(result.readings)} readings, the fewest possible, meet the goal: {goal_text}"
    block_count = max((each.block for each in result.readings), default=1)
    if block_count > 1:
        yield f"the list has {block_count} blocks: you can stop after any block, and still have a good plan"


def _describe_predictions(result: PlanResult) -> Iterator[str]:
    """Yield lines on predictions after the plan: whether links bend, and how certain a deflection is."""
    if result.elastic_links:
        yield "the plan allows for elastic links, because joints alone do not explain the deflection"
    if result.deflection_uncertainty is not None and result.worst_deflection_uncertainty is not None:
        yield (
            "95 % interval of a deflection in the work area: "
            f"± {length_text(NORMAL_95 * result.deflection_uncertainty)} rms, "
            f"± {length_text(NORMAL_95 * result.worst_deflection_uncertainty)} at the worst place"
        )


def _describe_efficiency(result: PlanResult) -> str:
    """Return a proved lower bound of the efficiency of the list, relative to the best possible list."""
    certificate = "certified:" if result.efficiency >= _TIGHT else "this certified bound is probably low:"
    return (
        f"{certificate} the list gives at least {100 * result.efficiency:.1f} % of the information of the "
        f"best possible list (criterion: {_CRITERIA[result.criterion]})"
    )


def _describe_feasibility(result: PlanResult) -> str:
    """Return how many readings the robot and the equipment allow, and why the others are not feasible."""
    reasons = [f"{name.replace('_', ' ')} {count}" for name, count in result.struck_out.items()]
    not_feasible = f"; not feasible: {', '.join(reasons)}" if reasons else ""
    return f"{result.feasible} of {result.considered} readings were feasible{not_feasible}"


def _describe_goal(job: Plan, share: float) -> str:
    """Return how the plan meets its goal; `share` is the uncertainty relative to that of the goal."""
    goal = job.request.goal
    if isinstance(goal, LoadPointGoal):
        return (
            f"a test finds an error of the load point of {length_text(share * goal.mistake)} in 80 % of cases"
        )
    return (
        f"the uncertainty from the noise of the readings is {share:.2f} times the "
        "uncertainty that the goal allows"
    )


def _joints_table(job: Plan, result: PlanResult) -> Table:
    """Return a table of each joint's interval: after the plan, and from the readings so far ("now").

    Cells are empty for joints that no load of the plan twists.
    """
    joints = result.joints
    empty = [None] * len(result.left_out)  # cells of joints that no load of the plan twists
    names = [*(joint.name for joint in joints), *result.left_out]
    planned = [_uncertainty_cell(joint, joint.standard_uncertainty) for joint in joints]
    columns = [Column("joint", names, text=True), Column("plan", [*planned, *empty], as_line)]
    if any(joint.before is not None for joint in joints):
        now = [_uncertainty_cell(joint, joint.before) for joint in joints]
        columns.append(Column("now", [*now, *empty], as_line))
    title = "Predicted 95 % interval of each stiffness"
    caption = _describe_sources_of_uncertainty(job, result)
    if all(joint.relative is None for joint in joints):
        title = "Predicted 95 % interval of each compliance"
        caption += "; 1 nrad/(N·m) is 0.1 % of a stiffness of 10⁶ N·m/rad"
    return Table(columns, title=title, caption=caption)


def _describe_sources_of_uncertainty(job: Plan, result: PlanResult) -> str:
    """Return what the predicted uncertainties come from: it depends on the load of the plan."""
    if job.request.weight_step is not None:
        return "from the noise of the steps and the errors of the load"
    has_force = any(any(each.force) for each in result.readings)
    if has_force:
        return "from the noise of the readings alone; model error is not included"
    return "from the noise of the readings, the bounds of the masses and the geometry"


def _compute_relative_uncertainty(joint: PlannedJoint, uncertainty: float | None) -> float | None:
    """Return the relative uncertainty of a joint's compliance, which is also that of its stiffness.

    `uncertainty` is the standard uncertainty of the compliance. Return None if `uncertainty` or the
    compliance is unknown.
    """
    if uncertainty is None or joint.relative is None:
        return None
    # `relative` belongs to `standard_uncertainty`: their ratio is 1 / compliance.
    return joint.relative * uncertainty / joint.standard_uncertainty


def _uncertainty_cell(joint: PlannedJoint, uncertainty: float | None) -> Line | None:
    """Format the half-width of a 95 % interval in % of the compliance, or in units of compliance if unknown.

    Return None if the uncertainty is unknown.
    """
    relative = _compute_relative_uncertainty(joint, uncertainty)
    if relative is not None:
        return width_cell(f"{half_width(relative, 100.0)} %", NORMAL_95 * relative)
    unit = "nm/N" if joint.kind == "prismatic" else "nrad/(N·m)"
    return None if uncertainty is None else width_cell(f"{half_width(uncertainty, 1e9)} {unit}")


def _readings_table(job: Plan, result: PlanResult, *, has_tick_boxes: bool) -> Table:
    """Return the table of the planned readings: label, posture, force, direction of force and of gauges.

    `has_tick_boxes` adds two columns of boxes to tick on paper: measured without load, and with load.
    """
    readings = result.readings
    is_step = job.request.weight_step is not None
    columns = [Column("reading", [each.label for each in readings], text=True)]
    if any(each.block > 1 for each in readings):
        columns.append(Column("block", [str(each.block) for each in readings], text=True))
    columns += _list_posture_columns(result)
    columns += _list_force_columns(job, readings)
    if is_step:
        columns.append(Column("approach", ["+ and -"] * len(readings), text=True))
    if has_tick_boxes:
        boxes = ["[   ]"] * len(readings)
        columns += [Column("unloaded", boxes, text=True), Column("loaded", boxes, text=True)]
    caption = _describe_readings(result, is_step=is_step)
    if isinstance(job.request.load, DeadWeight):
        caption += f". {_describe_weight(job.request.load)}"
    return Table(columns, title="Readings, in order", caption=caption, plain=True)


def _list_force_columns(job: Plan, readings: Sequence[PlannedReading]) -> list[Column]:
    """Return the columns of force [N] and its direction and, if gauges are used, of their direction."""
    forces = [hypot(*each.force) for each in readings]
    directions = [_force_direction_text(job, each) for each in readings]
    columns = [
        Column("force", forces, number_formatter(".0f"), "N"),
        Column("direction", directions, text=True),
    ]
    if any(each.direction is not None for each in readings):
        columns.append(Column("read along", [_gauge_direction_text(each) for each in readings], text=True))
    return columns


def _list_posture_columns(result: PlanResult) -> Iterator[Column]:
    """Yield a column for each joint, with its position in each reading in mm or degrees."""
    prismatic = _prismatic_joints(result)
    for j, name in enumerate(_joint_names(result)):
        positions = [each.joints[j] for each in result.readings]  # [m or rad]
        if j in prismatic:
            yield Column(name, [1e3 * each for each in positions], number_formatter(".1f"), "mm")
        else:
            yield Column(name, [degrees(each) for each in positions], number_formatter(".1f"), "°")


def _describe_readings(result: PlanResult, *, is_step: bool) -> str:
    """Return what to know when the readings are taken; `is_step` is true for readings of a weight step."""
    load_point = f"Load point in the flange frame: {_position_text(result.load_point)} mm"
    if is_step:
        return (
            "Read motor and link angle at rest, first in all postures without the load, then with it. "
            "Come to each posture twice: by turning the joints in the positive and in the negative sense. "
            f"{load_point}"
        )
    targets = ", ".join(result.targets)
    return f"Readings v1, v2, … validate the model, and are not fitted. Targets: {targets}. {load_point}"


def _describe_weight(load: DeadWeight) -> str:
    """Return a weight with its mass: kilograms that were typed as newtons show."""
    return f"A weight of {load.newtons:.4g} N is a mass of {load.kilograms:.3g} kg"


def _prismatic_joints(result: PlanResult) -> list[int]:
    """Return the indices of the prismatic joints."""
    return [j for j, kind in enumerate(result.joint_kinds.values()) if kind == "prismatic"]


def _joint_names(result: PlanResult) -> list[str]:
    """Return the names of all joints, or "axis 1" and so on if a stored plan does not name every joint."""
    if result.joint_kinds:
        return list(result.joint_kinds)
    names = [joint.name for joint in result.joints]
    count = len(result.readings[0].joints) if result.readings else 0
    return names if len(names) == count else [f"axis {j + 1}" for j in range(count)]


def _force_direction_text(job: Plan, reading: PlannedReading) -> str:
    """Describe the direction of a reading's force: to a cable's anchor, own weight, down, or a vector."""
    if reading.anchor is not None and isinstance(job.request.load, Cable):
        return (
            f"to anchor {reading.anchor + 1}, {_position_text(job.request.load.anchors[reading.anchor])} mm"
        )
    force_size = hypot(*reading.force)
    if not force_size:
        return "own weight"
    unit_vector = [component / force_size for component in reading.force]
    return "down" if unit_vector[2] < _DOWN else _format_unit_vector(unit_vector)


def _gauge_direction_text(reading: PlannedReading) -> str:
    """Return a gauge's direction as text that `import` reads: an axis of R0 such as "z", or components."""
    direction = reading.direction or (0.0, 0.0, 0.0)
    # −`_DOWN` is just below 1: such a component is along its axis.
    axis = next(
        (axis for axis, component in zip("xyz", direction, strict=True) if abs(component) > -_DOWN), None
    )
    return axis or _format_unit_vector(direction)


def _format_unit_vector(unit_vector: Sequence[float]) -> str:
    """Format the components of a unit vector, such as "x +0.50  y +0.00  z -0.87"."""
    return "  ".join(f"{axis} {component:+.2f}" for axis, component in zip("xyz", unit_vector, strict=True))


def _position_text(position: Sequence[float]) -> str:
    """Format the coordinates of a position [m] in mm, such as "-60, 20, 180"."""
    return ", ".join(f"{1e3 * coordinate:.0f}" for coordinate in position)


def readings_sheet(plan: Plan) -> Sheet:
    """Return the file `readings.csv`: the planned readings with empty columns for measured positions.

    When these columns are filled in, `jointstiff import` reads the file, and `jointstiff gearbox` that of a
    weight step.
    """
    result = plan.result
    if result is None:
        return Sheet({})
    if plan.request.weight_step is not None:
        return _step_sheet(result)
    has_gauges = any(each.direction is not None for each in result.readings)
    columns_to_fill_in = _list_columns_to_fill_in(result, has_gauges=has_gauges)
    rows = list[dict[str, Any]]()
    for each in result.readings:
        row = _make_planned_cells(each, result)
        if has_gauges:
            row["remark"] = f"read along {_gauge_direction_text(each)}"
        rows.append(row | dict.fromkeys(columns_to_fill_in))
    return Sheet.from_rows(rows)


def _make_planned_cells(reading: PlannedReading, result: PlanResult) -> dict[str, Any]:
    """Return header → what the plan states about a reading: label, joints, force and load point."""
    row: dict[str, Any] = {"label": reading.label}
    row |= _make_joint_cells("joint_", reading, _prismatic_joints(result))
    row |= {f"F{axis} [N]": round(part, 1) for axis, part in zip("xyz", reading.force, strict=True)}
    for axis, part in zip("xyz", result.load_point, strict=True):
        row[f"load point {axis} [mm]"] = round(1e3 * part, 3)
    row["anchor"] = None if reading.anchor is None else reading.anchor + 1
    return row


def _make_joint_cells(prefix: str, reading: PlannedReading, prismatic: Collection[int]) -> dict[str, float]:
    """Return the cells of a posture by their headers, such as `joint_1 [deg]` with the prefix `joint_`.

    `prismatic` has the indices of the prismatic joints, whose cells are in mm.
    """
    cells = dict[str, float]()
    for j, position in enumerate(reading.joints):
        if j in prismatic:
            cells[f"{prefix}{j + 1} [mm]"] = round(1e3 * position, 3)
        else:
            cells[f"{prefix}{j + 1} [deg]"] = round(degrees(position), 3)
    return cells


def _list_columns_to_fill_in(result: PlanResult, *, has_gauges: bool) -> list[str]:
    """Return the headers of the columns in which the user writes what tracker or gauges read.

    Only gauges along an axis of R0 have a column; any other direction is in the column `remark`.
    """
    if has_gauges:
        directions = {_gauge_direction_text(each) for each in result.readings}
        parts = [f"along {axis}" for axis in "xyz" if axis in directions]
    else:
        parts = [f"{state} {axis}" for state in ("unloaded", "loaded") for axis in "xyz"]
    return [f"{target} {part} [mm]" for target in result.targets for part in parts]


def _step_sheet(result: PlanResult) -> Sheet:
    """Return the table of a weight step to fill in: a row for each state, posture, approach and joint."""
    prismatic = _prismatic_joints(result)
    rows = []
    for state, each in product(("unloaded", "loaded"), result.readings):
        posture = _make_joint_cells("J", each, prismatic)
        # In words: a spreadsheet takes a cell that begins with a sign for a formula.
        for approach, joint in product(("plus", "minus"), result.joints):
            reading = {"joint": joint.name, "state": state, "approach": approach}
            rows.append({"label": each.label, **posture, **reading, "motor [deg]": None, "link [deg]": None})
    return Sheet.from_rows(rows)


def make_campaign_to_fill_in(source: RobotDocument | Campaign, plan: Plan) -> dict[str, Any]:
    """Return the JSON object of a campaign with the planned readings, whose positions are still null.

    `source` is the robot, or the campaign that the plan continues.

    Raises:
        RequestError: the plan is that of a weight step, which is read by encoders.
    """
    refuse_step_plan(plan)
    robot = source.robot if isinstance(source, Campaign) else source
    return {
        "robot": robot.model_dump(mode="json", exclude_none=True),
        "measurement_set": _make_set_to_fill_in(source, robot.name, plan),
        "run": {"method": "partial_pose"},
    }


def _make_set_to_fill_in(source: RobotDocument | Campaign, robot_name: str, plan: Plan) -> dict[str, Any]:
    """Return the JSON object of a measurement set with the planned readings, in m, rad and N."""
    result, options = plan.result, plan.request
    targets = {} if result is None else result.targets
    readings = [] if result is None else result.readings
    measurement_set: dict[str, Any] = {
        "name": f"planned for {robot_name}"[:200],
        "units": {"length": "m", "angle": "rad", "force": "N"},
        "encoders": source.measurement_set.encoders if isinstance(source, Campaign) else "motor",
    }
    if options.directions:
        measurement_set["flange_targets"] = targets
    noise = _describe_noise(source, options.sigma)
    if noise:
        measurement_set["noise"] = noise
    measurement_set["load_point"] = (0.0, 0.0, 0.0) if result is None else result.load_point
    measurement_set["observations"] = [_make_observation_to_fill_in(each, targets) for each in readings]
    return measurement_set


def _make_observation_to_fill_in(planned: PlannedReading, targets: Iterable[str]) -> dict[str, Any]:
    """Return the JSON object of an observation in which the numbers that are read are still null."""
    to_fill_in: dict[str, Any] = {"unloaded": None, "loaded": None}
    if planned.direction is not None:
        to_fill_in = {"displacement": None, "direction": planned.direction}
    return {
        "label": planned.label,
        "joints": planned.joints,
        "force": planned.force,
        "readings": [{"target": target, **to_fill_in} for target in targets],
    }


def refuse_step_plan(plan: Plan) -> None:
    """Refuse the plan of a weight step, where a campaign with targets is needed.

    Raises:
        RequestError: the plan is that of a weight step.
    """
    if plan.request.weight_step is not None:
        raise RequestError(
            "the plan is for a weight step, which is read by two encoders instead of targets",
            where="weight_step",
            remedy="fill in the plan's table (readings.csv), and identify the gearboxes with it",
        )


def _describe_noise(source: RobotDocument | Campaign, sigma: float | None) -> dict[str, Any]:
    """Return the noise of planned readings, in m and rad: as the request or the campaign states it.

    `sigma` is the standard deviation that the request states for a coordinate [m]; it replaces that of the
    campaign.
    """
    noise = _convert_noise(source.measurement_set) if isinstance(source, Campaign) else {}
    return noise if sigma is None else noise | {"sigma": sigma}


def _convert_noise(measured: MeasurementSetDocument) -> dict[str, Any]:
    """Return the noise that a measurement set states, in m and rad; empty if it states none.

    Of a set in other units, or in the frame of the tracker, only what is a length or an angle remains.
    """
    # A client knows this kind without numpy, which the units need.
    from jointstiff.service.conversion.units import ANGLE, LENGTH

    stated, units = measured.noise, measured.units
    if stated is None:
        return {}
    is_in_r0 = measured.frame is None
    if is_in_r0 and (units.length, units.angle, units.force) == ("m", "rad", "N"):
        return stated.model_dump(mode="json", exclude_none=True, exclude={"encoder_sigma", "refuted"})
    factors = dict.fromkeys(("sigma", "load_point", "target_places", "drift"), LENGTH[units.length])
    factors["repeatability"] = ANGLE[units.angle]
    noise = dict[str, Any]()
    for name, factor in factors.items():
        value = getattr(stated, name)
        if value is not None:
            noise[name] = factor * value
    return noise


def make_charts(result: PlanResult) -> list[Chart]:
    """Return a chart of the half-width of each joint's interval: after this plan, random plans, and now."""
    joints = result.joints
    # Without the compliance of every joint, uncertainties of compliances are drawn, not relative ones.
    all_known = all(joint.relative is not None for joint in joints)
    quantity, factor, unit = "compliance", 1e9, "± 10⁻⁹ rad/(N·m)"
    if all_known:
        quantity, factor, unit = "stiffness", 1e2, "± %"
    chart = Chart(
        f"Half-width of the 95 % interval of each {quantity}",
        [joint.name for joint in joints],
        _list_uncertainties(joints, are_relative=all_known),
        NORMAL_95 * factor,  # makes half-widths of 95 % intervals of the standard uncertainties
        unit,
        "joints",
        logarithmic=True,
        quantity="half-width",
    )
    return [chart]


def _list_uncertainties(
    joints: Sequence[PlannedJoint], *, are_relative: bool
) -> dict[str, list[float | None]]:
    """Return name of a series → standard uncertainty of each joint; a series without numbers is left out.

    The uncertainties are relative, or are those of compliances [rad/(N·m)].
    """
    uncertainties: dict[str, Sequence[float | None]] = {
        "this plan": [joint.standard_uncertainty for joint in joints],
        "random plans": [joint.random for joint in joints],
        "now": [joint.before for joint in joints],
    }
    known_series = dict[str, list[float | None]]()
    for name, of_compliances in uncertainties.items():
        values: list[float | None] = [*of_compliances]
        if are_relative:
            values = list(map(_compute_relative_uncertainty, joints, of_compliances))
        if any(value is not None for value in values):
            known_series[name] = values
    return known_series


_EXAMPLES: Final[dict[str, Any]] = {
    "begin a campaign": {
        "robot_id": "ID_OF_A_STORED_ROBOT",
        "readings": 15,
        "load": {"kind": "any_direction", "force": 1500.0},
        "targets": {"P10": [0.147, 0.055, 0.05], "P11": [-0.137, 0.087, 0.085], "P12": [-0.007, -0.14, 0.12]},
        "load_point": [-0.06, 0.02, 0.18],
        "surroundings": {"floor": 0.1},
    },
    "continue a campaign": {
        "measurement_set_id": "ID_OF_A_STORED_SET",
        "readings": 8,
        "criterion": "d",
        "load": {"kind": "any_direction", "force": 1500.0},
    },
}


def _prepare_work(inputs: Inputs, request: PlanRequest) -> Work:
    """Return the work of a plan, which is computed later; numerical modules are imported here."""
    from jointstiff.service.kinds.plan.work import prepare_plan

    return prepare_plan(inputs, request)


PLAN: Final = Kind[Plan, PlanRequest](
    message=Plan,
    request=PlanRequest,
    options=PlanOptions,
    prepare_work=_prepare_work,
    make_report=_make_report,
    sources=("robot_or_set",),
    make_charts=make_charts,
    title="Plan of a campaign",
    max_bytes=READINGS_BYTES,
    examples=_EXAMPLES,
    files=(
        File(
            name="readings.csv",
            description="the readings in their order",
            sheet=readings_sheet,
            made_of="result",
        ),
    ),
    description="""Plan which postures and loads to measure, to begin or continue a campaign.

The list has a certificate: its least fraction of the best list's information. The answer has the expected
uncertainty of each joint. An impossible plan is refused with a remedy.""",
)
