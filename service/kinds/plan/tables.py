"""A plan for people: what it promises, then the readings in their order; and the same as CSV."""

from __future__ import annotations

from math import degrees
from typing import Final

from jointstiff.schemas.plan import Plan, PlannedReading, PlanResult
from jointstiff.service.tables.table import Column, Line, Sheet, Table, number, numbers
from jointstiff.service.tables.view import Report, View

_CRITERIA = {
    "relative_a": "relative uncertainty of the joints",
    "work_area": "predictions in the work area",
    "worst_place": "predictions at the worst place",
    "d": "volume of the uncertainty ellipsoid",
    "e": "worst combination of joints",
}


def report(_job: Plan, result: PlanResult, _view: View) -> Report:
    """Return the promise first, then the list."""
    struck = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in result.struck_out.items())
    lines = [
        f"certified: at least {100 * result.efficiency:.1f} % of the best list's information "
        f"({_CRITERIA[result.criterion]})",
        f"random plans: {100 * result.random_efficiency:.0f} % of this one's; one at a time: "
        f"{100 * result.one_at_a_time_efficiency:.0f} %",
        f"{result.feasible} of {result.considered} readings were feasible"
        + (f"; struck out: {struck}" if struck else ""),
    ]
    if result.elastic_links:
        lines.append("elastic links are taken for a nuisance, as joints alone do not explain the deflection")
    if result.deflection_uncertainty is not None and result.worst_deflection_uncertainty is not None:
        lines.append(
            f"predicted deflection in the work area: ± {1e6 * result.deflection_uncertainty:.2g} µm rms, "
            f"± {1e6 * result.worst_deflection_uncertainty:.2g} µm at the worst place"
        )
    return Report([_joints(result), _readings(result), *map(Line, lines)])


def _joints(result: PlanResult) -> Table:
    joints, nano = result.joints, number(".3g", 1e9)
    return Table(
        [
            Column("joint", [joint.name for joint in joints], text=True),
            Column("plan", [joint.standard_uncertainty for joint in joints], nano),
            Column("relative", [joint.relative for joint in joints], lambda share: f"{100 * share:.2g} %"),
            Column("now", [joint.before for joint in joints], nano),
            Column("random plan", [joint.random for joint in joints], nano),
            Column("one at a time", [joint.one_at_a_time for joint in joints], nano),
        ],
        title="Promised standard uncertainty of each compliance, 10⁻⁹ rad/(N·m)",
        caption="by the noise of the readings alone",
    )


def _readings(result: PlanResult) -> Table:
    readings = result.readings
    angles = [[*map(degrees, each.joints)] for each in readings]
    return Table(
        [
            Column("reading", [each.label for each in readings], text=True),
            Column("controller's angles", angles, numbers(".0f"), "°"),
            Column("force", readings, _force, "N"),
        ],
        title="Readings, in order",
        caption="v…: held out, to judge the model",
    )


def _force(reading: PlannedReading) -> str:
    anchor = "" if reading.anchor is None else f"  to anchor {reading.anchor}"
    return "  ".join(f"{part:.0f}" for part in reading.force) + anchor


def readings_sheet(plan: Plan) -> Sheet:
    """Return the list: label, angles in degrees, force in newtons, anchor, held out."""
    readings = [] if plan.result is None else plan.result.readings
    names = [f"joint_{j + 1} [deg]" for j in range(len(readings[0].joints) if readings else 0)]
    return Sheet.of_rows(
        {
            "label": each.label,
            **{name: round(degrees(angle), 3) for name, angle in zip(names, each.joints, strict=True)},
            **{f"F{axis} [N]": round(part, 1) for axis, part in zip("xyz", each.force, strict=True)},
            "anchor": each.anchor,
            "validation": int(each.validation),
        }
        for each in readings
    )


SHEETS: Final = {"readings": readings_sheet}
