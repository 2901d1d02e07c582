"""A plan: postures and loads to measure, and what people read of it; and the same as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, hypot
from typing import TYPE_CHECKING, Any, Final

from jointstiff.schemas.plan import (
    Cable,
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
from jointstiff.service.tables.report import Report, View
from jointstiff.service.tables.table import Chart, Column, Line, Sheet, Table, number
from jointstiff.solver.text import figure, length_text

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs

_DOWN: Final = -0.9999  # along z of R0: a weight
_TIGHT: Final = 0.3
"""Certified efficiency below which the bound, not the list, is poor as a rule: many parameters."""
_CRITERIA = {
    "relative_a": "relative uncertainty of the joints",
    "work_area": "predictions in the work area",
    "worst_place": "predictions at the worst place",
    "d": "volume of the uncertainty ellipsoid",
    "e": "worst combination of joints",
}


def report(job: Plan, result: PlanResult, view: View) -> Report:
    """Return the promise first, then the list."""
    struck = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in result.struck_out.items())
    tight = "certified:" if result.efficiency >= _TIGHT else "certified, but the bound is not tight:"
    lines = [
        f"{tight} at least {100 * result.efficiency:.1f} % of the best list's information "
        f"({_CRITERIA[result.criterion]})",
        f"{result.feasible} of {result.considered} readings were feasible"
        + (f"; struck out: {struck}" if struck else ""),
    ]
    if result.goal_share is not None:
        lines.append(
            f"{len(result.readings)} readings are the fewest whose list meets the goal: "
            f"{result.goal_share:.2f} of its uncertainty, by the noise of the readings"
        )
    blocks = max((each.block for each in result.readings), default=1)
    if blocks > 1:
        lines.append(f"{blocks} blocks, each a good plan by itself: whoever stops after one of them has one")
    if result.elastic_links:
        lines.append("the plan allows for elastic links, because joints alone do not explain the deflection")
    if result.deflection_uncertainty is not None and result.worst_deflection_uncertainty is not None:
        lines.append(
            f"predicted deflection in the work area: ± {length_text(result.deflection_uncertainty)} rms, "
            f"± {length_text(result.worst_deflection_uncertainty)} at the worst place"
        )
    if job.request.measurement_set_id is not None:
        lines.append(
            "the list has only the new readings, but the predicted uncertainties also use those of the "
            "campaign so far: identify both together, as in the campaign to fill in"
        )
    readings = _readings(job, result, boxes=view.details)
    return Report([_joints(result), readings, *map(Line, lines)])


def _joints(result: PlanResult) -> Table:
    joints, none = result.joints, [None] * len(result.left_out)
    columns = [
        Column("joint", [*(joint.name for joint in joints), *result.left_out], text=True),
        Column("plan", [*(_cell(joint, joint.standard_uncertainty) for joint in joints), *none]),
        Column("now", [*(_cell(joint, joint.before) for joint in joints), *none]),
    ]
    caption = "by the noise of the readings, the bounds of the masses and the geometry"
    if any(any(each.force) for each in result.readings):
        caption = "by the noise of the readings alone; model error comes on top"
    title = "Predicted standard uncertainty of each stiffness"
    if all(joint.relative is None for joint in joints):
        title = "Predicted standard uncertainty of each compliance"
        caption += "; 1 nrad/(N·m) is 0.1 % of a stiffness of 10⁶ N·m/rad"
    measured = any(joint.before is not None for joint in joints)
    return Table(columns if measured else columns[:2], title=title, caption=caption)


def _relative_uncertainty(joint: PlannedJoint, uncertainty: float | None) -> float | None:
    """Return an uncertainty relative to the compliance, which is that of the stiffness; None if unknown."""
    if uncertainty is None or joint.relative is None:
        return None
    return joint.relative * uncertainty / joint.standard_uncertainty


def _cell(joint: PlannedJoint, uncertainty: float | None) -> str | None:
    """Return a share of the compliance; the compliance's uncertainty itself where that is not known."""
    share = _relative_uncertainty(joint, uncertainty)
    if share is not None:
        return f"{figure(100 * share, '.2g')} %"
    unit = "nm/N" if joint.kind == "prismatic" else "nrad/(N·m)"
    return None if uncertainty is None else f"{figure(1e9 * uncertainty, '.3g')} {unit}"


def _readings(job: Plan, result: PlanResult, *, boxes: bool) -> Table:
    """Return a row for each posture; with boxes to tick on paper."""
    readings = result.readings
    gauged = any(each.direction is not None for each in readings)
    lengths, blocks = _prismatic_joints(result), max((each.block for each in readings), default=1)
    angles = [
        Column(name, [1e3 * each.joints[j] for each in readings], number(".1f"), "mm")
        if j in lengths
        else Column(name, [degrees(each.joints[j]) for each in readings], number(".1f"), "°")
        for j, name in enumerate(_axes(result))
    ]
    ticks = [Column(name, ["[   ]"] * len(readings), text=True) for name in ("unloaded", "loaded")]
    return Table(
        [
            Column("reading", [each.label for each in readings], text=True),
            *([Column("block", [str(each.block) for each in readings], text=True)] if blocks > 1 else []),
            *angles,
            Column("force", [hypot(*each.force) for each in readings], number(".0f"), "N"),
            Column("direction", [_direction(job, each) for each in readings], text=True),
            *(
                [Column("read along", [_gauge_direction(each) for each in readings], text=True)]
                if gauged
                else []
            ),
            *(ticks if boxes else []),
        ],
        title="Readings, in order",
        caption=f"v…: held out, to judge the model. Targets: {', '.join(result.targets)}. "
        f"Load point in the flange frame: {_millimetres(result.load_point)} mm",
        plain=True,
    )


def _prismatic_joints(result: PlanResult) -> list[int]:
    """Return the indices of the prismatic joints."""
    return [j for j, kind in enumerate(result.joint_kinds.values()) if kind == "prismatic"]


def _axes(result: PlanResult) -> list[str]:
    """Return the names of the axes; those that are not determined have their number."""
    if result.joint_kinds:
        return list(result.joint_kinds)
    known = [joint.name for joint in result.joints]
    count = len(result.readings[0].joints) if result.readings else 0
    return known if len(known) == count else [f"axis {j + 1}" for j in range(count)]


def _direction(job: Plan, reading: PlannedReading) -> str:
    """Return where a force pulls, in words where it has some."""
    if reading.anchor is not None and isinstance(job.request.load, Cable):
        return f"to anchor {reading.anchor + 1}, {_millimetres(job.request.load.anchors[reading.anchor])} mm"
    size = hypot(*reading.force)
    if not size:
        return "own weight"
    unit = [part / size for part in reading.force]
    return "down" if unit[2] < _DOWN else _components(unit)


def _gauge_direction(reading: PlannedReading) -> str:
    """Return the direction of a gauge: the axis of R0 where it is one, as `import` reads it."""
    direction = reading.direction or (0.0, 0.0, 0.0)
    axis = next((axis for axis, part in zip("xyz", direction, strict=True) if abs(part) > -_DOWN), None)
    return axis or _components(direction)


def _components(unit: Sequence[float]) -> str:
    return "  ".join(f"{axis} {part:+.2f}" for axis, part in zip("xyz", unit, strict=True))


def _millimetres(place: Sequence[float]) -> str:
    return ", ".join(f"{1e3 * part:.0f}" for part in place)


def readings_sheet(plan: Plan) -> Sheet:
    """Return the list with empty columns for what is read: filled in, `jointstiff import` takes it."""
    result = plan.result
    if result is None:
        return Sheet({})
    lengths = _prismatic_joints(result)
    names = [
        f"joint_{j + 1} [{'mm' if j in lengths else 'deg'}]" for j in range(len(result.readings[0].joints))
    ]
    places = [f"load point {axis} [mm]" for axis in "xyz"]
    along = {axis for each in result.readings if (axis := _gauge_direction(each)) in ("x", "y", "z")}
    gauged = any(each.direction is not None for each in result.readings)
    states = ("along",) if gauged else ("unloaded", "loaded")
    empty = [
        f"{target} {state} {axis} [mm]"
        for target in result.targets
        for state in states
        for axis in (sorted(along) if gauged else "xyz")
    ]
    return Sheet.of_rows(
        {
            "label": each.label,
            **{
                name: round(1e3 * value if j in lengths else degrees(value), 3)
                for j, (name, value) in enumerate(zip(names, each.joints, strict=True))
            },
            **{f"F{axis} [N]": round(part, 1) for axis, part in zip("xyz", each.force, strict=True)},
            **{name: round(1e3 * part, 3) for name, part in zip(places, result.load_point, strict=True)},
            "anchor": None if each.anchor is None else each.anchor + 1,
            "validation": int(each.held_out),
            **({"remark": f"read along {_gauge_direction(each)}"} if gauged else {}),
            **dict.fromkeys(empty),
        }
        for each in result.readings
    )


def campaign_to_fill_in(source: RobotDocument | Campaign, plan: Plan) -> dict[str, Any]:
    """Return a campaign file with the planned readings, whose positions are still null."""
    options, result = plan.request, plan.result
    robot = source.robot if isinstance(source, Campaign) else source
    encoders = source.measurement_set.encoders if isinstance(source, Campaign) else "motor"
    targets = {} if result is None else result.targets
    observations = [
        {
            "label": each.label,
            "joints": each.joints,
            "force": each.force,
            "readings": [
                {"target": target, "unloaded": None, "loaded": None}
                if each.direction is None
                else {"target": target, "displacement": None, "direction": each.direction}
                for target in targets
            ],
        }
        for each in ([] if result is None else result.readings)
    ]
    return {
        "robot": robot.model_dump(mode="json", exclude_none=True),
        "measurement_set": {
            "name": f"planned for {robot.name}"[:200],
            "units": {"length": "m", "angle": "rad", "force": "N"},
            "encoders": encoders,
            **({"flange_targets": targets} if options.directions else {}),
            **({} if options.sigma is None else {"noise": {"sigma": options.sigma}}),
            "load_point": (0.0, 0.0, 0.0) if result is None else result.load_point,
            "observations": observations,
        },
        "run": {"method": "partial_pose"},
    }


def charts(result: PlanResult) -> list[Chart]:
    """Return the predicted uncertainty of each joint, compared with that of today and of random plans."""
    joints, known = result.joints, all(joint.relative is not None for joint in result.joints)
    value = _relative_uncertainty if known else lambda _, uncertainty: uncertainty
    series = {
        "this plan": [value(joint, joint.standard_uncertainty) for joint in joints],
        "random plans": [value(joint, joint.random) for joint in joints],
        "now": [value(joint, joint.before) for joint in joints],
    }
    drawn = {name: values for name, values in series.items() if any(each is not None for each in values)}
    whose, factor, unit = ("stiffness", 1e2, "%") if known else ("compliance", 1e9, "10⁻⁹ rad/(N·m)")
    title, names = f"Standard uncertainty of each {whose}", [joint.name for joint in joints]
    return [Chart(title, names, drawn, factor, unit, "joints", logarithmic=True)]


_EXAMPLES: Final[dict[str, Any]] = {
    "begin a campaign": {
        "robot_id": "ID_OF_A_STORED_ROBOT",
        "readings": 15,
        "load": {"kind": "any_direction", "force": 1500.0},
        "targets": {"P10": [0.147, 0.055, 0.05], "P11": [-0.137, 0.087, 0.085], "P12": [-0.007, -0.14, 0.12]},
        "load_point": [-0.06, 0.02, 0.18],
        "surroundings": {"floor": 0.1},
    },
    "go on with a campaign": {
        "measurement_set_id": "ID_OF_A_STORED_SET",
        "readings": 8,
        "criterion": "d",
        "load": {"kind": "any_direction", "force": 1500.0},
    },
}


def compute(inputs: Inputs, request: PlanRequest) -> Work:
    """Return the work of a plan."""
    from jointstiff.service.kinds.plan.work import planning

    return planning(inputs, request)


PLAN: Final = Kind[Plan, PlanRequest](
    message=Plan,
    request=PlanRequest,
    options=PlanOptions,
    compute=compute,
    report=report,
    sources=("robot_or_set",),
    charts=charts,
    title="Plan of a campaign",
    max_bytes=READINGS_BYTES,
    examples=_EXAMPLES,
    files=(
        File(
            name="readings.csv",
            description="the readings of a plan in their order as a table for spreadsheets, units in the "
            "headers.",
            sheet=readings_sheet,
            made_of="result",
        ),
    ),
    description="""Plan which postures and loads to measure, to begin or continue a campaign.

The list has a certificate: its least share of the best list's information, proved by a sweep over all
candidates. The answer has the expected uncertainty of each joint, the efficiency of random and one-at-a-time
plans, and the number of infeasible readings by reason. An impossible plan is refused with a remedy, and
nothing is stored.""",
)
