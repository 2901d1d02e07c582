"""A run for people: the verdict, the joints, what to do; with details all that the fit says."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees, sqrt

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.run.identifiability import Advice
from jointstiff.schemas.run.joints import JointResult
from jointstiff.schemas.run.run import Run, RunResult
from jointstiff.service.kinds.run.details import detail_lines
from jointstiff.service.kinds.run.links_table import links_line, links_report, selection_table
from jointstiff.service.kinds.run.resampling_table import resampling_table
from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS, StiffnessUnit
from jointstiff.service.tables.terminal import METHOD_NAMES, problem_text
from jointstiff.service.tables.verdict import (
    joint_reason_lines,
    remedies,
    to_do_lines,
    verdict_lines,
    warning_lines,
)

_STATUSES = {
    "uncertain": "[yellow]uncertain[/]",
    "at_bound": "[yellow]at bound[/]",
    "not_observable": "[dim]not observable[/]",
}
_VERDICTS = {
    "use": "[green]identified[/]",
    "use_with_care": "[yellow]use with care[/]",
    "do_not_use": "[red]do not use[/]",
}
"""Words for an identified joint."""


def run_report(run: Run, *, details: bool = False, unit: str = DEFAULT_UNIT) -> RenderableType:
    """Lay out the verdict with its reasons, the joints, and at most three things to do.

    Args:
        run: with its result, or its error.
        details: whether to add everything else that the result says.
        unit: name of a unit of `UNITS`.
    """
    if run.result is None:
        return problem_text(run.error) if run.error else Text(f"the run is {run.state}")
    result, shown = run.result, UNITS[unit]
    parts = [
        *verdict_lines(result.assessment, details=details),
        _joints_table(run, result, shown),
        *joint_reason_lines((joint.name, joint.reason) for joint in result.joints),
        _summary(result),
    ]
    if result.links is not None and not details:
        parts.append(links_line(result.links, result.selection))
    parts += warning_lines(result.assessment, result.warnings, details=details)
    if details:
        parts += detail_lines(result)
    if result.links is not None and details:
        parts += [Text(), *links_report(result.links, result.selection)]
    elif result.selection is not None and details:
        parts += [Text(), selection_table(result.selection)]
    if result.resampling is not None:
        parts += [Text(), resampling_table(run, result.resampling, shown)]
    things = [*remedies(result.assessment), *_advised(run, result, details=details)]
    return Group(*parts, *to_do_lines(things, details=details))


def _joints_table(run: Run, result: RunResult, unit: StiffnessUnit) -> Table:
    request = run.request
    constraint = "compliance ≥ 0" if request.positive else "unconstrained"
    table = Table(
        title=f"Joint {unit.quantity}, {METHOD_NAMES[request.method]}, {request.weighting} weights, "
        f"{constraint}",
        caption=f"{unit.quantity}, its standard uncertainty and interval in {unit.label}",
    )
    table.add_column("joint")
    table.add_column(unit.quantity, justify="right")
    table.add_column("std. uncertainty", justify="right")
    table.add_column(f"{100 * request.confidence:g} % interval", justify="right")
    if request.priors:
        table.add_column("prior/data", justify="right")
    table.add_column("verdict")
    for joint in result.joints:
        prior = [_prior_cell(joint, known=joint.name in request.priors)] if request.priors else []
        table.add_row(Text(joint.name), *unit.cells(joint), *prior, _verdict_cell(joint))
    return table


def _verdict_cell(joint: JointResult) -> str:
    """Return the status, or the verdict on an identified joint."""
    return _VERDICTS[joint.verdict] if joint.status == "identified" else _STATUSES[joint.status]


def _prior_cell(joint: JointResult, *, known: bool) -> str:
    """Format the information of the prior over that of the readings."""
    if joint.prior_to_data is not None:
        return f"{joint.prior_to_data:.2g}"
    return "prior only" if known and joint.status != "not_observable" else "—"


def _summary(result: RunResult) -> Text:
    """Return what the fit is worth, in one line."""
    explained = (
        ""
        if result.compensation is None
        else f"explains {100 * result.compensation:.1f} % of the mean deflection, "
    )
    sigma = (
        ""
        if result.sigma is None
        else f", sigma of a reading {1e6 * result.sigma:.3g} µm ({result.goodness.sigma_source})"
    )
    return Text(f"  {explained}residual {1e6 * result.rms_residual:.3g} µm rms (3-D){sigma}")


def _advised(run: Run, result: RunResult, *, details: bool) -> Iterator[str]:
    """Yield the next measurement of each joint that needs one, with details every one."""
    said = set()
    joints = {joint.name: joint for joint in result.joints}
    for advice in result.identifiability.advice:
        if details:
            yield f"{advice.joint}: {advice.message}"
        elif advice.joint not in said:
            said.add(advice.joint)
            yield f"{advice.joint}: {_reading(advice)}{_gain(run, advice, joints[advice.joint])}"


def _reading(advice: Advice) -> str:
    """Return load and posture of a reading."""
    size = sqrt(sum(part**2 for part in advice.force))
    along = ", ".join(f"{part / size + 0.0:.2f}" for part in advice.force)
    angles = ", ".join(f"{degrees(angle):.0f}" for angle in advice.joints)
    posture = f"({angles})° if free of collisions" if advice.observation is None else advice.observation
    return f"{size:.4g} N along ({along}) in posture {posture}"


def _gain(run: Run, advice: Advice, joint: JointResult) -> str:
    """Return what a reading promises, which is known for the partial pose weighted by covariance."""
    request = run.request
    u, ratio = joint.standard_uncertainty, advice.uncertainty_ratio
    if request.method != "partial_pose" or request.weighting != "covariance" or request.priors:
        return ""
    if ratio is None or u is None or not joint.compliance:
        after = advice.standard_uncertainty
        return "" if after is None else f": u(c) becomes {1e6 * after:.2g} µrad/(N·m)"
    before = 100 * u / abs(joint.compliance)
    return f": u {before:.2g} % → {ratio * before:.2g} %"
