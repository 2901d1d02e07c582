"""A run for people: the verdict, the joints, what to do; with details all that the fit says."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees, sqrt
from typing import Final

from jointstiff.schemas.run import Advice, Identifiability, JointResult, Run, RunResult, WeightResult
from jointstiff.service.kinds.run.links_table import links_line, links_report, selection_table
from jointstiff.service.kinds.run.resampling_table import resampling_table
from jointstiff.service.tables.report import VERDICTS, Report, View, joint_reason_lines
from jointstiff.service.tables.stiffness import StiffnessUnit
from jointstiff.service.tables.table import Column, Line, Part, Table, figure
from jointstiff.service.tables.terminal import METHOD_NAMES

_WORDS: Final = {
    "uncertain": Line("uncertain", "care"),
    "at_bound": Line("at bound", "care"),
    "not_observable": Line("not observable", "dim"),
    "use_with_care": Line("use with care", "care"),
    "do_not_use": Line("do not use", "bad"),
}
"""Words for the status of a joint, or for the verdict on an identified one."""
_GRADES: Final = {0.05: "well determined", 0.2: "determined"}


def report(job: Run, result: RunResult, view: View) -> Report:
    """Return the joints and what the fit is worth; with details all that the fit says."""
    parts: list[Part] = [
        _joints_table(job, result, view.unit),
        *joint_reason_lines((joint.name, joint.reason) for joint in result.joints),
        _summary(result),
    ]
    if result.weight is not None:
        parts += _weight_lines(result.weight)
    evidence: list[Part] = [*detail_lines(result)] if view.details else []
    if result.links is not None and view.details:
        evidence += [Line(""), *links_report(result.links, result.selection)]
    elif result.links is not None:
        parts.append(links_line(result.links, result.selection))
    elif result.choice is not None and result.choice.source != "given":
        parts.append(Line(f"  {result.choice.message}", "dim"))
    if result.links is None and result.selection is not None and view.details:
        evidence += [Line(""), selection_table(result.selection)]
    if result.resampling is not None:
        evidence += [Line(""), resampling_table(job, result.resampling, view.unit)]
    return Report(parts, evidence, list(_advised(job, result, details=view.details)))


def _joints_table(run: Run, result: RunResult, unit: StiffnessUnit) -> Table:
    request, joints = run.request, result.joints
    constraint = "compliance ≥ 0" if request.positive else "unconstrained"
    way = f"{METHOD_NAMES[request.method]}, {request.weighting} weights"
    if request.weight is not None:
        way = "by the robot's own weight"
    cells = [unit.cells(joint) for joint in joints]
    prior = [_prior_cell(joint, known=joint.name in request.priors) for joint in joints]
    return Table(
        [
            Column("joint", [joint.name for joint in joints], text=True),
            Column(unit.quantity, [value for value, _, _ in cells]),
            Column("std. uncertainty", [uncertainty for _, uncertainty, _ in cells]),
            Column(f"{100 * request.confidence:g} % interval", [interval for _, _, interval in cells]),
            *([Column("prior/data", prior)] if request.priors else []),
            Column("verdict", joints, _verdict_cell, text=True),
        ],
        title=f"Joint {unit.quantity}, {way}, {constraint}",
        caption=f"{unit.quantity}, its standard uncertainty and interval in {unit.label}",
    )


def before_and_after(before: RunResult, after: RunResult, unit: StiffnessUnit) -> Table:
    """Return two runs side by side: verdict, what they explain, and each joint with its uncertainty."""

    def column(result: RunResult) -> list[str]:
        share = result.compensation
        cells = {joint.name: unit.cells(joint) for joint in result.joints}
        return [
            VERDICTS[result.assessment.verdict],
            "—" if share is None else f"{100 * share:.1f} %",
            f"{1e6 * result.rms_residual:.3g} µm",
            *(f"{cells[joint.name][0]} ± {cells[joint.name][1]}" for joint in before.joints),
        ]

    names = ["verdict", "explained", "rms residual", *(joint.name for joint in before.joints)]
    return Table(
        [
            Column("", names, text=True),
            Column("before", column(before)),
            Column("after", column(after)),
        ],
        title="Before and after",
        caption=f"{unit.quantity} with its standard uncertainty in {unit.label}",
    )


def _weight_lines(weight: WeightResult) -> Iterator[Line]:
    """Yield what each joint's interval is due to, and what the sag explains."""
    shares = [f"{each.joint} {100 * each.masses:.0f} %" for each in weight.joints if each.masses is not None]
    if shares:
        yield Line(f"  uncertain masses make up of each interval: {', '.join(shares)}")
    before, after = 1e6 * weight.rms_without_sag, 1e6 * weight.rms_residual
    yield Line(
        f"  the best geometry of an arm that does not bend leaves {figure(before)} µm rms of a coordinate, "
        f"with sag it leaves {figure(after)} µm"
        + (": the arm bends too little under its own weight to gain much" if after > 0.9 * before else "")
    )


def _verdict_cell(joint: JointResult) -> Line:
    """Return the status or the verdict; of a joint to use, the grade of its interval as on the page."""
    if joint.status != "identified" or joint.verdict != "use":
        return _WORDS[joint.verdict if joint.status == "identified" else joint.status]
    low, high = joint.stiffness_interval or (None, None)
    if low is None or high is None or not joint.stiffness:
        return Line("no interval", "care")
    narrow = [limit for limit in _GRADES if (high - low) / 2 / joint.stiffness <= limit]
    return Line(_GRADES[narrow[0]] if narrow else "roughly known", "good")


def _prior_cell(joint: JointResult, *, known: bool) -> str:
    """Format the information of the prior over that of the readings."""
    if joint.prior_to_data is not None:
        return f"{joint.prior_to_data:.2g}"
    return "prior only" if known and joint.status != "not_observable" else "—"


def _summary(result: RunResult) -> Line:
    """Return what the fit is worth, in one line."""
    share = result.compensation
    explained = "" if share is None else f"explains {100 * share:.1f} % of the mean deflection, "
    sigma = (
        ""
        if result.sigma is None
        else f", sigma of a reading {figure(1e6 * result.sigma)} µm ({result.goodness.sigma_source})"
    )
    return Line(f"  {explained}residual {figure(1e6 * result.rms_residual)} µm rms (3-D){sigma}")


def _advised(run: Run, result: RunResult, *, details: bool) -> Iterator[str]:
    """Yield the next measurement of each joint that needs one, with details every one."""
    advised = set()
    joints = {joint.name: joint for joint in result.joints}
    for advice in result.identifiability.advice:
        if details:
            yield f"{advice.joint}: {advice.message}"
        elif advice.joint not in advised:
            advised.add(advice.joint)
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


_SIGMA = {
    "consistent": "consistent with sigma",
    "residuals_too_large": "residuals larger than sigma predicts",
    "residuals_too_small": "residuals smaller than sigma predicts",
}


def detail_lines(result: RunResult) -> list[Line]:
    """Return the lines that `--details` adds below the table of joints."""
    lines = [Line(f"  {line}", "care") for line in _suspicious(result)]
    others = (
        *_goodness(result),
        *_budget(result),
        *_complementary_stiffness(result),
        *_identifiability(result.identifiability),
    )
    return [*lines, *(Line(f"  {line}", "dim") for line in others)]


def _goodness(result: RunResult) -> Iterator[str]:
    goodness = result.goodness
    if goodness.sigma_source == "given" and goodness.degrees_of_freedom > 0:
        ratio = goodness.chi_square / goodness.degrees_of_freedom
        verdict = f": {_SIGMA[goodness.test.verdict]}" if goodness.test else ""
        yield (
            f"χ²/dof {ratio:.2f}{verdict} (1 if model and sigma are right; "
            f"{goodness.degrees_of_freedom:.4g} degrees of freedom)"
        )


_SOURCES = {
    "readings": "readings",
    "force_scale": "scale of the force",
    "force_direction": "direction of the force",
    "load_point": "load point",
    "assumed_load_point": "load point, 10 mm assumed",
    "target_places": "places of the targets",
    "axes": "axes of the robot's model",
    "model_error": "model error",
    "complementary_stiffness": "neglected K_c",
}


def _budget(result: RunResult) -> Iterator[str]:
    """Yield what the joints' uncertainties consist of, relative to the compliance."""
    budget = result.budget
    if budget is None:
        return
    sizes = [joint.compliance for joint in result.joints if joint.name in budget.joints]
    for part in budget.components:
        shares = [100 * u / abs(c) for u, c in zip(part.contributions, sizes, strict=True) if c]
        if shares:
            ends = sorted({f"{min(shares):.2g}", f"{max(shares):.2g}"}, key=float)
            beside = "" if part.included else ", not in the intervals"
            source = _SOURCES.get(part.source, part.source)
            yield (
                f"uncertainty from {source} (type {part.evaluation}{beside}): "
                f"{' to '.join(ends)} % of a compliance"
            )


def _complementary_stiffness(result: RunResult) -> Iterator[str]:
    """Yield whether it matters that the load follows the deflection."""
    size = result.complementary_stiffness
    if size is None:
        return
    shift = "" if size.largest_shift is None else f" by at most {size.largest_shift:.2g} std. uncertainties"
    verb = (
        f"included ({size.iterations} refit{'s' if size.iterations > 1 else ''}); it changes"
        if size.included
        else "neglected; including it changes"
    )
    yield f"complementary stiffness {verb} a compliance{shift} (K_c/k at most {size.largest_ratio:.2g})"


def _suspicious(result: RunResult) -> Iterator[str]:
    """Yield the readings that the robust loss mistrusts, worst first."""
    robust = result.robust
    if robust is None:
        return
    yield (
        f"Huber loss, threshold {robust.threshold:g} sigma: {robust.suspicious_count} suspicious "
        f"reading{'' if robust.suspicious_count == 1 else 's'}"
    )
    for reading in robust.suspicious:
        yield (
            f"{reading.observation}, {reading.target}: residual of {reading.residual_norm:.3g} sigma, "
            f"weight {reading.weight:.2g}"
        )
    hidden = robust.suspicious_count - len(robust.suspicious)
    if hidden > 0:
        yield f"and {hidden} more"


def _identifiability(found: Identifiability) -> Iterator[str]:
    """Yield the observability of the joints."""
    if found.observability is not None and found.condition_number is not None:
        indices = ", ".join(f"{name.upper()} {value:.2g}" for name, value in found.observability)
        yield f"observability {indices}; condition number {found.condition_number:.3g}"
    yield from found.weakest
