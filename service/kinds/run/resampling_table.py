"""The fits of a resampling for people: mean and deviation of each joint, and shares of odd outcomes."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from jointstiff.schemas.run.resampling import ResampledJoint, ResamplingResult
from jointstiff.schemas.run.run import Run
from jointstiff.service.tables.stiffness import StiffnessUnit, rounded


def resampling_table(run: Run, resampling: ResamplingResult, unit: StiffnessUnit) -> Table:
    """Return a row for each joint, then the compensation on all configurations."""
    drawn = run.request.resampling
    size = f"{drawn.size} configurations drawn at random" if drawn else ""
    table = Table(
        title=f"{resampling.repetitions} fits of {size}",
        caption=f"{unit.quantity} in {unit.label}: mean and standard deviation of one fit; "
        "compensation on all",
    )
    for heading in ("joint", "mean", "deviation", "negative", "rigid", "undetermined"):
        table.add_column(heading, justify="left" if heading == "joint" else "right")
    for joint in resampling.joints:
        mean, deviation = moments(joint, unit)
        shares = (joint.share_negative, joint.share_infinite, joint.share_undetermined)
        table.add_row(
            Text(joint.name),
            "—" if mean is None else rounded(mean, deviation),
            "—" if deviation is None else rounded(deviation, deviation),
            *(f"{100 * share:.3g} %" for share in shares),
        )
    compensation = resampling.compensation
    if compensation.mean is not None and compensation.deviation is not None:
        table.add_section()
        table.add_row(
            "compensation", f"{100 * compensation.mean:.1f} %", f"{100 * compensation.deviation:.1f} %"
        )
    return table


def moments(joint: ResampledJoint, unit: StiffnessUnit) -> tuple[float | None, float | None]:
    """Return mean and standard deviation of one fit, in the unit; None where some fits have none."""
    moments = (
        (joint.compliance_mean, joint.compliance_deviation)
        if unit.inverse
        else (joint.stiffness_mean, joint.stiffness_deviation)
    )
    mean, deviation = (None if value is None else unit.factor * value for value in moments)
    return mean, deviation
