"""Tables for people: every estimate with its unit and interval, digits decided by the uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import floor, log10
from types import MappingProxyType
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.assessment import Assessment, Reason, Verdict
from jointstiff.schemas.job import Progress
from jointstiff.schemas.measurement import QualityWarning
from jointstiff.schemas.problem import Problem
from jointstiff.schemas.run import Identifiability, JointResult, ResamplingResult, Run, RunResult
from jointstiff.service.render.links_table import links_report

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
METHOD_NAMES = {
    "complete_pose": "complete pose",
    "partial_pose": "partial pose",
    "decoupled_partial_pose": "decoupled partial pose",
}
_SIGMA = {
    "consistent": "consistent with sigma",
    "residuals_too_large": "residuals larger than sigma predicts",
    "residuals_too_small": "residuals smaller than sigma predicts",
}
_HEADLINES: Final[Mapping[Verdict, tuple[str, str]]] = MappingProxyType(
    {
        "use": ("Use: nothing speaks against these numbers", "bold green"),
        "use_with_care": ("Use with care", "bold yellow"),
        "do_not_use": ("Do not use", "bold red"),
    }
)
"""First line of a report, and its style."""
_REASON_STYLES: Final = {"use_with_care": "yellow", "do_not_use": "red"}
_REASONS_SHOWN = 3
_UNEXPLAINED: Final = frozenset({"low_compensation", "deflections_unexplained", "residual_outlier"})
"""Warnings that `deflection_unexplained` says better."""
_MEGA = 1e-6
_WARNINGS_SHOWN = 8
_NARROWEST = 80


def run_report(run: Run) -> RenderableType:
    """Lay out the verdict with its reasons, further warnings, the joints, and what the fit is worth."""
    if run.result is None:
        return problem_text(run.error) if run.error else Text(f"the run is {run.state}")
    result = run.result
    parts = [*verdict_report(result.assessment, result.warnings), _joints_table(run, result)]
    parts += [Text(f"  {joint.name}: {joint.reason}", style="dim") for joint in result.joints if joint.reason]
    parts.append(_summary(result))
    parts += [Text(f"  {line}", style="dim") for line in _force_uncertainty(result)]
    parts += [Text(f"  {line}", style="dim") for line in _complementary_stiffness(result)]
    parts += [Text(f"  {line}", style="yellow") for line in _suspicious(result)]
    parts += [Text(f"  {line}", style="dim") for line in _identifiability(result.identifiability)]
    if result.links is not None:
        parts += [Text(), *links_report(result.links, result.selection)]
    if result.resampling is not None:
        parts += [Text(), _resampling_table(run, result.resampling)]
    return Group(*parts)


def _identifiability(found: Identifiability) -> list[str]:
    """Print the observability of the joints, and the advice."""
    lines = []
    if found.observability is not None and found.condition_number is not None:
        indices = ", ".join(f"{name.upper()} {value:.2g}" for name, value in found.observability)
        lines.append(f"observability {indices}; condition number {found.condition_number:.3g}")
    lines += found.weakest
    lines += [f"{advice.joint} next: {advice.message}" for advice in found.advice]
    return lines


def _complementary_stiffness(result: RunResult) -> list[str]:
    """Return whether it matters that the load follows the deflection."""
    size = result.complementary_stiffness
    if size is None:
        return []
    shift = "" if size.largest_shift is None else f" by at most {size.largest_shift:.2g} std. uncertainties"
    verb = (
        f"included ({size.iterations} fits); it changes"
        if size.included
        else "neglected; including it changes"
    )
    return [f"complementary stiffness {verb} a compliance{shift} (K_c/k at most {size.largest_ratio:.2g})"]


def _suspicious(result: RunResult) -> list[str]:
    """The readings that the robust loss mistrusts, worst first."""
    robust = result.robust
    if robust is None:
        return []
    lines = [
        f"Huber loss, threshold {robust.threshold:g} sigma: {robust.suspicious_count} suspicious "
        f"reading{'' if robust.suspicious_count == 1 else 's'}"
    ]
    lines += [
        f"{reading.observation}, {reading.target}: residual of {reading.residual_norm:.3g} sigma, "
        f"weight {reading.weight:.2g}"
        for reading in robust.suspicious[:_WARNINGS_SHOWN]
    ]
    hidden = robust.suspicious_count - _WARNINGS_SHOWN
    return [*lines, f"and {hidden} more (--json lists them)"] if hidden > 0 else lines


def verdict_line(assessment: Assessment) -> Text:
    """Return the verdict in one line."""
    headline, style = _HEADLINES[assessment.verdict]
    count = len(assessment.reasons)
    return Text(headline + (f": {count} reason{'' if count == 1 else 's'}" if count else ""), style=style)


def verdict_report(assessment: Assessment, warnings: Sequence[QualityWarning] = ()) -> list[RenderableType]:
    """Lay out the verdict, its reasons with their remedies, and the warnings that no reason repeats."""
    reasons = assessment.reasons
    lines: list[RenderableType] = [verdict_line(assessment)]
    for reason in reasons[:_REASONS_SHOWN]:
        place = f"{reason.where}: " if reason.where else ""
        lines.append(Text(f"  {place}{reason.message}; {reason.remedy}", style=_REASON_STYLES[reason.weight]))
    if len(reasons) > _REASONS_SHOWN:
        lines.append(Text(f"  and {len(reasons) - _REASONS_SHOWN} more (--json shows all)"))
    rest = [warning for warning in warnings if not _repeated(warning, reasons)]
    return [*lines, *(Text(line, style="yellow") for line in warning_lines(rest))]


def _repeated(warning: QualityWarning, reasons: Sequence[Reason]) -> bool:
    """Return whether a reason says what a warning says."""
    return any(
        reason.code == warning.code
        or reason.message.startswith(warning.message)
        or (reason.code == "deflection_unexplained" and warning.code in _UNEXPLAINED)
        for reason in reasons
    )


def warning_lines(warnings: Sequence[QualityWarning]) -> list[str]:
    """The warnings as lines: those of the fit first, as they concern all numbers."""
    ordered = sorted(warnings, key=lambda warning: warning.where is not None)
    lines = []
    for warning in ordered[:_WARNINGS_SHOWN]:
        place = f"{warning.where}: " if warning.where else ""
        lines.append(f"warning: {place}{warning.message}; {warning.remedy}")
    hidden = len(warnings) - _WARNINGS_SHOWN
    if hidden > 0:
        lines.append(f"warning: and {hidden} more (--json shows all)")
    return lines


def _joints_table(run: Run, result: RunResult) -> Table:
    request = run.request
    constraint = "compliance ≥ 0" if request.positive else "unconstrained"
    table = Table(
        title=f"Joint stiffness, {METHOD_NAMES[request.method]}, {request.weighting} weights, {constraint}",
        caption="stiffness, its standard uncertainty and interval in 10⁶ N·m/rad",
    )
    table.add_column("joint")
    table.add_column("stiffness", justify="right")
    table.add_column("std. uncertainty", justify="right")
    table.add_column(f"{100 * request.confidence:g} % interval", justify="right")
    if request.priors:
        table.add_column("prior/data", justify="right")
    table.add_column("verdict")
    for joint in result.joints:
        prior = [_prior_cell(joint, known=joint.name in request.priors)] if request.priors else []
        table.add_row(Text(joint.name), *_stiffness_cells(joint), *prior, _verdict_cell(joint))
    return table


def _force_uncertainty(result: RunResult) -> list[str]:
    """Return the share of the force in the joints' variances, where its uncertainty is stated."""
    shares = [
        (joint.budget.force_scale**2 + joint.budget.force_direction**2) / joint.standard_uncertainty**2
        for joint in result.joints
        if joint.budget is not None and joint.standard_uncertainty
    ]
    if not shares:
        return []
    return [
        f"uncertainty of the force: {100 * min(shares):.0f} to {100 * max(shares):.0f} % of the variances, "
        "common to all joints"
    ]


def _resampling_table(run: Run, resampling: ResamplingResult) -> Table:
    drawn = run.request.resampling
    size = f"{drawn.size} configurations drawn at random" if drawn else ""
    table = Table(
        title=f"{resampling.repetitions} fits of {size}",
        caption="stiffness in 10⁶ N·m/rad: mean and standard deviation of one fit; compensation on all",
    )
    for heading in ("joint", "mean", "deviation", "negative", "rigid", "undetermined"):
        table.add_column(heading, justify="left" if heading == "joint" else "right")
    for joint in resampling.joints:
        deviation = joint.stiffness_deviation
        mean = "—" if joint.stiffness_mean is None else _rounded(joint.stiffness_mean, deviation)
        shares = (joint.share_negative, joint.share_infinite, joint.share_undetermined)
        table.add_row(
            Text(joint.name),
            mean,
            "—" if deviation is None else _rounded(deviation, deviation),
            *(f"{100 * share:.3g} %" for share in shares),
        )
    compensation = resampling.compensation
    if compensation.mean is not None and compensation.deviation is not None:
        table.add_section()
        table.add_row(
            "compensation", f"{100 * compensation.mean:.1f} %", f"{100 * compensation.deviation:.1f} %"
        )
    return table


@contextmanager
def progress_bar(*, shown: bool) -> Iterator[Callable[[Progress], None]]:
    """A bar on the standard error, with the time left; none where nothing takes long."""
    if not shown:
        yield lambda _: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with ProgressBar(*columns, console=console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda progress: bar.update(
            task, description=progress.activity, total=progress.total, completed=progress.done
        )


def _stiffness_cells(joint: JointResult) -> tuple[str, str, str]:
    if joint.compliance is None:
        return "—", "—", "—"
    if joint.stiffness is None:
        return "rigid", "—", _open_interval(joint)
    uncertainty = _stiffness_uncertainty(joint)
    interval = "—"
    if joint.stiffness_interval is not None:
        low, high = joint.stiffness_interval
        if high is None:
            interval = _open_interval(joint)
        else:
            interval = f"{_rounded(low, uncertainty)} … {_rounded(high, uncertainty)}"
    shown = "—" if uncertainty is None else _rounded(uncertainty, uncertainty)
    return _rounded(joint.stiffness, uncertainty), shown, interval


def _open_interval(joint: JointResult) -> str:
    """Format an interval without an upper end: its one-sided bound, which is the higher one."""
    least = None if joint.one_sided is None else joint.one_sided.stiffness_at_least
    return "—" if least is None else f"> {_MEGA * least:.3g}"


def _verdict_cell(joint: JointResult) -> str:
    """Return the status, or the verdict on an identified joint."""
    return _VERDICTS[joint.verdict] if joint.status == "identified" else _STATUSES[joint.status]


def _prior_cell(joint: JointResult, *, known: bool) -> str:
    """Information of the prior over that of the readings."""
    if joint.prior_to_data is not None:
        return f"{joint.prior_to_data:.2g}"
    return "prior only" if known and joint.status != "not_observable" else "—"


def _stiffness_uncertainty(joint: JointResult) -> float | None:
    """Return the uncertainty of the stiffness, to first order: u(k) = u(c) k²."""
    if joint.standard_uncertainty is None or joint.stiffness is None:
        return None
    return joint.standard_uncertainty * joint.stiffness**2


def _rounded(value: float, uncertainty: float | None) -> str:
    """In 10⁶, to two digits of the uncertainty."""
    value *= _MEGA
    if not uncertainty:
        return f"{value:.4g}"
    decimals = max(0, 1 - floor(log10(uncertainty * _MEGA)))
    return f"{value:.{min(decimals, 9)}f}"


def _summary(result: RunResult) -> Text:
    goodness = result.goodness
    lines = []
    if result.compensation is not None:
        lines.append(f"compensation {100 * result.compensation:.1f} % of the mean deflection")
    lines.append(f"residual {1e6 * result.rms_residual:.1f} µm rms (3-D)")
    if result.sigma is not None:
        lines.append(f"sigma of a reading {1e6 * result.sigma:.1f} µm ({goodness.sigma_source})")
    if goodness.sigma_source == "given" and goodness.degrees_of_freedom > 0:
        ratio = goodness.chi_square / goodness.degrees_of_freedom
        verdict = f": {_SIGMA[goodness.test.verdict]}" if goodness.test else ""
        lines.append(f"χ²/dof {ratio:.2f}{verdict} (1 if model and sigma are right)")
    return Text("  " + ", ".join(lines))


def concise_stiffness(joint: JointResult) -> Text:
    """Value with its standard uncertainty in units of the last digits (GUM, 7.2.2)."""
    if joint.stiffness is None:
        return Text("—" if joint.compliance is None else "rigid", style="dim")
    uncertainty = _stiffness_uncertainty(joint)
    value = _rounded(joint.stiffness, uncertainty)
    if uncertainty:
        shown = _rounded(uncertainty, uncertainty)
        value += f"({shown.lstrip('0.') if float(shown) < 1 else shown})"
    return Text(value, style="red" if joint.stiffness < 0 else "")


def problem_text(problem: Problem) -> Text:
    """An error for people: what, where, and how to mend it."""
    if len(problem.errors) > 1:
        lines = [f"{item.where}: {item.reason}" for item in problem.errors]
        return Text("\n".join([problem.title, *(f"  {line}" for line in lines)]), style="red")
    place = f"{problem.where}: " if problem.where else ""
    detail = problem.errors[0].reason if problem.errors else problem.detail
    remedy = f"\n  remedy: {problem.remedy}" if problem.remedy else ""
    return Text(f"{place}{detail}{remedy}", style="red")


def console(*, stderr: bool = False) -> Console:
    """A console that does not colour numbers by itself."""
    found = Console(stderr=stderr, highlight=False)
    # Numbers that a narrow terminal cuts short mislead; wrapped lines do not.
    return Console(stderr=stderr, highlight=False, width=max(found.width, _NARROWEST))
