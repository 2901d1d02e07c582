"""The fits of a resampling for people: mean and deviation of each joint, and shares of odd outcomes."""

from __future__ import annotations

from jointstiff.schemas.run import ResampledJoint, ResamplingResult, Run
from jointstiff.service.tables.stiffness import StiffnessUnit
from jointstiff.service.tables.table import NO_NUMBER, Column, Table, percent, rounded


def resampling_table(run: Run, resampling: ResamplingResult, unit: StiffnessUnit) -> Table:
    """Return a row for each joint, then the compensation on all configurations."""
    drawn = run.request.resampling
    size = f"{drawn.size} configurations drawn at random" if drawn else ""
    moments_of = [moments(joint, unit) for joint in resampling.joints]
    joints, compensation = resampling.joints, resampling.compensation
    names: list[str] = [joint.name for joint in joints]
    if compensation.mean is not None and compensation.deviation is not None:
        names.append("compensation")

    def column(name: str, values: list[str], last: float | None) -> Column:
        whole = [] if len(names) == len(values) else [percent(last)]
        return Column(name, [*values, *whole])

    return Table(
        [
            Column("joint", names, text=True),
            column("mean", [_rounded(mean, u) for mean, u in moments_of], compensation.mean),
            column("deviation", [_rounded(u, u) for _, u in moments_of], compensation.deviation),
            column("negative", [f"{100 * joint.share_negative:.3g} %" for joint in joints], None),
            column("rigid", [f"{100 * joint.share_infinite:.3g} %" for joint in joints], None),
            column("undetermined", [f"{100 * joint.share_undetermined:.3g} %" for joint in joints], None),
        ],
        title=f"{resampling.repetitions} fits of {size}",
        caption=f"{unit.quantity} in {unit.label}: mean and standard deviation of one fit; "
        "compensation on all",
    )


def _rounded(value: float | None, uncertainty: float | None) -> str:
    return NO_NUMBER if value is None else rounded(value, uncertainty)


def moments(joint: ResampledJoint, unit: StiffnessUnit) -> tuple[float | None, float | None]:
    """Return mean and standard deviation of one fit, in the unit; None where some fits have none."""
    moments = (
        (joint.compliance_mean, joint.compliance_deviation)
        if unit.inverse
        else (joint.stiffness_mean, joint.stiffness_deviation)
    )
    mean, deviation = (None if value is None else unit.factor * value for value in moments)
    return mean, deviation
