"""Tables for people: every estimate with its unit and interval, digits decided by the uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import floor, log10

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar
from rich.table import Table
from rich.text import Text

from schemas.problem import Problem
from schemas.resampling import ResamplingResult
from schemas.run import JointResult, Run, RunResult

__all__ = ["ComparisonRow", "comparison_table", "console", "problem_text", "progress_bar", "run_report"]

_VERDICTS = {
    "identified": "[green]identified[/]",
    "at_bound": "[yellow]at bound[/]",
    "not_observable": "[dim]not observable[/]",
}
_METHODS = {
    "complete_pose": "complete pose",
    "partial_pose": "partial pose",
    "decoupled_partial_pose": "decoupled partial pose",
}
_SHORT = {"complete_pose": "CP", "partial_pose": "PP", "decoupled_partial_pose": "DPP"}
_MEGA = 1e-6
_WARNINGS_SHOWN = 8
_NARROWEST = 80


@dataclass(frozen=True)
class ComparisonRow:
    """One method on one set: a run, or why it was refused."""

    method: str
    positive: bool
    outcome: Run | Problem


def run_report(run: Run) -> RenderableType:
    """Warnings first, then the joints, then what the fit is worth."""
    if run.result is None:
        return problem_text(run.error) if run.error else Text(f"the run is {run.state}")
    result = run.result
    parts: list[RenderableType] = [
        *(Text(line, style="yellow") for line in _warnings(result)),
        _joints_table(run, result),
    ]
    parts += [Text(f"  {joint.name}: {joint.reason}", style="dim") for joint in result.joints if joint.reason]
    parts.append(_summary(result))
    if result.resampling is not None:
        parts += [Text(), _resampling_table(run, result.resampling)]
    return Group(*parts)


def _warnings(result: RunResult) -> list[str]:
    """The warnings as lines: those of the fit first, as they concern all numbers."""
    ordered = sorted(result.warnings, key=lambda warning: warning.where is not None)
    lines = []
    for warning in ordered[:_WARNINGS_SHOWN]:
        place = f"{warning.where}: " if warning.where else ""
        lines.append(f"warning: {place}{warning.message}; {warning.remedy}")
    hidden = len(result.warnings) - _WARNINGS_SHOWN
    if hidden > 0:
        lines.append(f"warning: and {hidden} more (--json shows all)")
    return lines


def _joints_table(run: Run, result: RunResult) -> Table:
    request = run.request
    constraint = "compliance ≥ 0" if request.positive else "unconstrained"
    table = Table(
        title=f"Joint stiffness, {_METHODS[request.method]}, {request.weighting} weights, {constraint}",
        caption="stiffness, its standard uncertainty and interval in 10⁶ N·m/rad",
    )
    table.add_column("joint")
    table.add_column("stiffness", justify="right")
    table.add_column("std. uncertainty", justify="right")
    table.add_column(f"{100 * request.confidence:g} % interval", justify="right")
    table.add_column("verdict")
    for joint in result.joints:
        table.add_row(Text(joint.name), *_stiffness_cells(joint), _VERDICTS[joint.status])
    return table


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
def progress_bar(total: int | None) -> Iterator[Callable[[int], None]]:
    """A bar on the standard error, with the time left; none where nothing takes long."""
    if total is None:
        yield lambda _: None
        return
    columns = (TextColumn("resampling"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with ProgressBar(*columns, console=console(stderr=True), transient=True) as bar:
        task = bar.add_task("resampling", total=total)
        yield lambda done: bar.update(task, completed=done)


def _stiffness_cells(joint: JointResult) -> tuple[str, str, str]:
    if joint.compliance is None:
        return "—", "—", "—"
    if joint.stiffness is None:
        return "rigid", "—", "—"
    uncertainty = _stiffness_uncertainty(joint)
    interval = "—"
    if joint.stiffness_interval is not None:
        low, high = joint.stiffness_interval
        upper = "∞" if high is None else _rounded(high, uncertainty)
        interval = f"{_rounded(low, uncertainty)} … {upper}"
    shown = "—" if uncertainty is None else _rounded(uncertainty, uncertainty)
    return _rounded(joint.stiffness, uncertainty), shown, interval


def _stiffness_uncertainty(joint: JointResult) -> float | None:
    """Of the stiffness, to first order: u(k) = u(c) k²."""
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
        lines.append(f"χ²/dof {ratio:.2f} (1 where model and sigma are right)")
    return Text("  " + ", ".join(lines))


def comparison_table(rows: Sequence[ComparisonRow]) -> RenderableType:
    """The methods side by side, unconstrained and constrained, as in the paper's Table II."""
    results = [_result(row) for row in rows]
    first = next((result for result in results if result is not None), None)
    table = Table(
        title="Stiffness in 10⁶ N·m/rad by each method, compliance free or ≥ 0",
        box=SIMPLE_HEAD,
        padding=0,
        show_edge=False,
    )
    table.add_column("", no_wrap=True)
    for row in rows:
        header = f"{_SHORT[row.method]} {'≥ 0' if row.positive else 'free'}"
        table.add_column(header, justify="right", no_wrap=True)
    for j, joint in enumerate(first.joints if first else []):
        table.add_row(Text(joint.name), *(_concise(r.joints[j]) if r else Text("") for r in results))
    table.add_section()
    table.add_row("explained", *(_percent(result) for result in results))
    table.add_row("rms [µm]", *(f"{1e6 * r.rms_residual:.0f}" if r else "" for r in results))
    return Group(*_shared_warnings(results), table, _legend(rows), *_refusals(rows))


def _legend(rows: Sequence[ComparisonRow]) -> Text:
    lengths = [result.characteristic_length for row in rows if (result := _result(row))]
    length = next((f" of {length:.3g} m" for length in lengths if length), "")
    return Text(
        "3.188(17): 3.188 with standard uncertainty 0.017; rigid: compliance 0\n"
        f"CP: complete pose, translations divided by a length{length}; with\n"
        "    covariance weights it would equal PP. PP: partial pose. DPP: decoupled.\n"
        "explained: share of the mean deflection; rms: of the residual vectors",
        style="dim",
    )


def _shared_warnings(results: Sequence[RunResult | None]) -> list[Text]:
    """The warnings of all runs, each once."""
    lines = dict.fromkeys(line for result in results if result for line in _warnings(result))
    return [Text(line, style="yellow") for line in lines]


def _refusals(rows: Sequence[ComparisonRow]) -> list[Text]:
    """Why a method has no column of numbers, once a method."""
    reasons = {}
    for row in rows:
        problem = row.outcome.error if isinstance(row.outcome, Run) else row.outcome
        if problem is not None:
            reasons[row.method] = f"{_SHORT[row.method]} ({_METHODS[row.method]}): {problem.detail}"
    return [Text(reason, style="yellow") for reason in reasons.values()]


def _result(row: ComparisonRow) -> RunResult | None:
    return row.outcome.result if isinstance(row.outcome, Run) else None


def _percent(result: RunResult | None) -> str:
    if result is None or result.compensation is None:
        return "—"
    return f"{100 * result.compensation:.1f} %"


def _concise(joint: JointResult) -> Text:
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
