"""A plan for people: what it promises, then the readings in their order; and the same as CSV."""

from __future__ import annotations

import csv
import io
from math import degrees

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.plan import Plan, PlanResult
from jointstiff.service.tables.terminal import problem_text

_CRITERIA = {
    "relative_a": "relative uncertainty of the joints",
    "work_area": "predictions in the work area",
    "worst_place": "predictions at the worst place",
    "d": "volume of the uncertainty ellipsoid",
    "e": "worst combination of joints",
}


def plan_report(plan: Plan) -> RenderableType:
    """Promise first, then the list."""
    result = plan.result
    if result is None:
        return problem_text(plan.error) if plan.error else Text(f"the plan is {plan.state}")
    parts: list[RenderableType] = [_joints(result), _readings(result)]
    return Group(*parts, *(Text(line) for line in _lines(result)))


def plan_csv(result: PlanResult) -> str:
    """Return the list as CSV: label, angles in degrees, force in newtons, anchor, held out."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    count = len(result.readings[0].joints)
    names = [f"joint_{j + 1} [deg]" for j in range(count)]
    writer.writerow(["label", *names, "Fx [N]", "Fy [N]", "Fz [N]", "anchor", "validation"])
    for each in result.readings:
        angles = [f"{degrees(angle):.3f}" for angle in each.joints]
        anchor = "" if each.anchor is None else each.anchor
        writer.writerow(
            [each.label, *angles, *(f"{f:.1f}" for f in each.force), anchor, int(each.validation)]
        )
    return text.getvalue()


def _joints(result: PlanResult) -> Table:
    table = Table(
        title="Promised standard uncertainty of each compliance, 10⁻⁹ rad/(N·m)",
        title_justify="left",
        caption="by the noise of the readings alone",
    )
    table.add_column("joint")
    for heading in ("plan", "relative", "now", "random plan", "one at a time"):
        table.add_column(heading, justify="right")
    for joint in result.joints:
        table.add_row(
            Text(joint.name),
            _nano(joint.standard_uncertainty),
            "—" if joint.relative is None else f"{100 * joint.relative:.2g} %",
            *(_nano(value) for value in (joint.before, joint.random, joint.one_at_a_time)),
        )
    return table


def _readings(result: PlanResult) -> Table:
    table = Table(
        title="Readings, in order", title_justify="left", caption="v…: held out, to judge the model"
    )
    table.add_column("reading")
    table.add_column("controller's angles [°]", justify="right")
    table.add_column("force [N]", justify="right")
    for each in result.readings:
        angles = "  ".join(f"{degrees(angle):.0f}" for angle in each.joints)
        anchor = "" if each.anchor is None else f"  to anchor {each.anchor}"
        table.add_row(Text(each.label), angles, "  ".join(f"{f:.0f}" for f in each.force) + anchor)
    return table


def _lines(result: PlanResult) -> list[str]:
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
    return lines


def _nano(value: float | None) -> str:
    return "—" if value is None else f"{1e9 * value:.3g}"
