"""A run: the identification of joint stiffnesses from one measurement set, and what people read of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from jointstiff.schemas.comparison import ComparisonResult
from jointstiff.schemas.finding import ROOT_MISTAKES
from jointstiff.schemas.joints import JOINT_UNITS, JointKind
from jointstiff.schemas.model import (
    ElasticCompliance,
    ElementShare,
    LinksResult,
    PrincipalCompliance,
    ScoredModel,
)
from jointstiff.schemas.options import ElasticModel, RunOptions
from jointstiff.schemas.run import (
    Advice,
    BudgetComponent,
    Goodness,
    Identifiability,
    JointResult,
    ModelChoice,
    ResampledJoint,
    ResamplingResult,
    Run,
    RunRequest,
    RunResult,
    WeightResult,
)
from jointstiff.service.kinds.kind import File, Kind
from jointstiff.service.tables.estimate import (
    NORMAL_95,
    ShownEstimate,
    estimate_columns,
    half_width,
    show_estimate,
)
from jointstiff.service.tables.report import METHOD_NAMES, VERDICTS, Report, View, joint_reason_lines
from jointstiff.service.tables.stiffness import StiffnessUnit
from jointstiff.service.tables.table import (
    NO_NUMBER,
    Chart,
    Column,
    Line,
    NumberParts,
    Part,
    Sheet,
    Table,
    as_line,
    format_percent,
    format_rounded,
    number_formatter,
)
from jointstiff.solver.text import figure, length_text, posture_text

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs

_VERDICT_CELLS: Final = {
    "uncertain": Line("uncertain", "care"),
    "at_bound": Line("at bound", "care"),
    "not_observable": Line("not observable", "dim"),
    "use_with_care": Line("use with care", "care"),
    "do_not_use": Line("do not use", "bad"),
}
"""Cell in the column of verdicts, by status of the joint or, for an identified joint, by verdict."""
ASSUMPTIONS: Final = {"assumed_load_point": "load point ± 10 mm", "assumed_force_scale": "force ± 1 %"}
"""Source of uncertainty → what is assumed about it, in a few words."""
_GRADES: Final = {0.05: "well determined", 0.2: "determined"}
"""Words for a good joint, by the greatest half width of the interval relative to the stiffness."""


def _make_report(run: Run, result: RunResult, view: View) -> Report:
    """Return the report of a run: joints, own weight, choice of model, and advice.

    `view.details` adds the evidence. If the readings have a mistake that spoils every number, the report is
    the table of joints alone, because the rest would mislead.
    """
    joints_table = _joints_table(run, result, view.unit)
    has_root_mistake = not ROOT_MISTAKES.isdisjoint(each.code for each in result.assessment.reasons)
    if has_root_mistake and not view.details:
        return Report([joints_table])
    parts: list[Part] = [joints_table]
    parts += joint_reason_lines((joint.name, joint.reason) for joint in result.joints)
    if result.gearboxes:
        parts += [Line(""), parts_table(result, run.request.confidence, view.unit)]
    further: list[Part] = [_fit_summary(result)]
    if result.weight is not None:
        further += _weight_lines(result.weight)
    if result.choice is not None:
        # Links that bend are a part of the result; a choice of joints alone is a remark.
        place = further if result.links is None else parts
        place += _choice_lines(result.choice, result.links, details=view.details)
    advice = list(_advice_lines(run, result, details=view.details))
    return Report(parts, _list_evidence(run, result, view), advice, further, _list_assumptions(result))


def _list_evidence(run: Run, result: RunResult, view: View) -> list[Part]:
    """Return the parts that show why the result is as it is: details if requested, and the resampling."""
    evidence: list[Part] = []
    if view.details:
        evidence += detail_lines(result)
    if view.details and result.choice is not None:
        evidence += _choice_evidence(result.choice, result.links)
    if result.resampling is not None:
        evidence += [Line(""), resampling_table(run, result.resampling, view.unit)]
    return evidence


def _choice_lines(choice: ModelChoice, links: LinksResult | None, *, details: bool) -> list[Part]:
    """Return a line on the chosen elastic model.

    Return no line if the user chose the model, or if the details have a table of the model.
    """
    if links is not None:
        return [] if details else [links_line(links, choice)]
    return [] if choice.source == "given" else [Line(f"  {choice.message}", "dim")]


def _choice_evidence(choice: ModelChoice, links: LinksResult | None) -> list[Part]:
    """Return tables on the elastic model for the details: its links, or the models that were compared."""
    if links is not None:
        return [Line(""), *links_report(links, choice)]
    return [Line(""), choice_table(choice)] if choice.models else []


def _list_assumptions(result: RunResult) -> list[str]:
    """Return in a few words what the intervals assume because the user has not stated it."""
    components = () if result.budget is None else result.budget.components
    sources = {each.source for each in components}
    return [words for source, words in ASSUMPTIONS.items() if source in sources]


def _joints_table(run: Run, result: RunResult, unit: StiffnessUnit) -> Table:
    """Return the table of joints: stiffness with its interval, weight of a prior, verdict."""
    request, joints = run.request, result.joints
    estimates = [unit.show_joint(joint) for joint in joints]
    columns = [
        Column("joint", [joint.name for joint in joints], text=True),
        *estimate_columns("stiffness", estimates, request.confidence),
    ]
    if request.priors:
        prior_cells = [_format_prior(joint, has_prior=joint.name in request.priors) for joint in joints]
        columns.append(Column("prior/data", prior_cells))
    columns.append(Column("verdict", joints, _verdict_cell, text=True))
    title = f"Joint stiffness, {_describe_method(request)}"
    return Table(columns, title=title, caption=f"stiffness and its interval in {unit.label_of(joints)}")


def _describe_method(request: RunRequest) -> str:
    """Return method and constraint in words, such as "partial pose, covariance weights, unconstrained"."""
    constraint = "compliance ≥ 0" if request.positive else "unconstrained"
    if request.weight is not None:
        return f"by the robot's own weight, {constraint}"
    return f"{METHOD_NAMES[request.method]}, {request.weighting} weights, {constraint}"


def parts_table(result: RunResult | ComparisonResult, confidence: float, unit: StiffnessUnit) -> Table:
    """Return the table of gearboxes and of structure behind their encoders, whose compliances add up."""
    gearboxes = [unit.show_joint(joint) for joint in result.gearboxes]
    structures = [unit.show_joint(joint) for joint in result.structures]
    return Table(
        [
            Column("joint", [joint.name for joint in result.gearboxes], text=True),
            *estimate_columns("gearbox", gearboxes, confidence),
            *estimate_columns("structure", structures, confidence),
        ],
        title="Gearbox and structure apart, stiffness",
        caption=f"in {unit.label_of(result.gearboxes)}; in front of the encoder and behind it: compliances "
        "add up",
    )


def before_after_table(before: RunResult, after: RunResult, unit: StiffnessUnit) -> Table:
    """Return a table that compares two runs: verdict, explained deflection, residual and stiffnesses.

    `before` and `after` are results with the same joints, such as before and after readings were left out.
    """
    joint_names = [joint.name for joint in before.joints]
    columns = [
        Column("", ["verdict", "explained", "rms residual", *joint_names], text=True),
        Column("before", _list_compared_cells(before, joint_names, unit), as_line),
        Column("after", _list_compared_cells(after, joint_names, unit), as_line),
    ]
    caption = f"stiffness (interval) in {unit.label_of(before.joints)}"
    return Table(columns, title="Before and after", caption=caption)


def _list_compared_cells(result: RunResult, joint_names: Sequence[str], unit: StiffnessUnit) -> list[Line]:
    """Return the cells of a result: verdict, explained deflection, residual, and each of the named joints."""
    cells = {joint.name: unit.show_joint(joint).cell for joint in result.joints}
    return [
        Line(VERDICTS[result.assessment.verdict]),
        Line(format_percent(result.compensation)),
        Line(length_text(result.rms_residual)),
        *(cells[name] for name in joint_names),
    ]


def _weight_lines(weight: WeightResult) -> Iterator[Line]:
    """Yield lines on intervals widened by uncertain masses, and on the residual with and without sag.

    Sag is the deflection of the arm under its own weight.
    """
    shares = [f"{each.joint} {100 * each.masses:.0f} %" for each in weight.joints if each.masses is not None]
    if shares:
        yield Line(f"  fraction of each interval's width due to uncertain masses: {', '.join(shares)}")
    rms_without_sag, rms_with_sag = weight.rms_without_sag, weight.rms_residual
    yield Line(
        f"  without sag, the best geometry leaves {length_text(rms_without_sag)} rms of a coordinate; "
        f"with sag, {length_text(rms_with_sag)}"
        + (
            "; the sag of the arm under the own weight is too small to improve the fit much"
            if rms_with_sag > 0.9 * rms_without_sag
            else ""
        )
    )


def _verdict_cell(joint: JointResult) -> Line:
    """Return a joint's cell in the column of verdicts: how well it is determined, or why not to use it."""
    if joint.status != "identified" or joint.verdict != "use":
        return _VERDICT_CELLS[joint.verdict if joint.status == "identified" else joint.status]
    low, high = joint.stiffness_interval or (None, None)
    if low is None or high is None or not joint.stiffness:
        return Line("no interval", "care")
    relative_half_width = (high - low) / 2 / joint.stiffness
    grades = [grade for limit, grade in _GRADES.items() if relative_half_width <= limit]  # best first
    return Line(grades[0] if grades else "roughly known", "good")


def _format_prior(joint: JointResult, *, has_prior: bool) -> str:
    """Format the ratio of the information on a joint from the prior to that from the readings.

    Without readings of the joint, the cell says "prior only"; without a prior, it is a dash.
    """
    if joint.prior_to_data is not None:
        return f"{joint.prior_to_data:.2g}"
    return "prior only" if has_prior and joint.status != "not_observable" else "—"


def _fit_summary(result: RunResult) -> Line:
    """Return a line with the explained share of the deflection, the residual, and sigma."""
    compensation = result.compensation
    explained_text = (
        "" if compensation is None else f"explains {100 * compensation:.1f} % of the mean deflection, "
    )
    sigma_text = (
        ""
        if result.sigma is None
        else f", sigma of a reading {length_text(result.sigma)} ({result.goodness.sigma_source})"
    )
    return Line(
        f"  {explained_text}residual {length_text(result.rms_residual)} rms (3-D){sigma_text}"
        f"{_repeatability_text(result.goodness)}"
    )


def _repeatability_text(goodness: Goodness) -> str:
    """Return the end of a sentence with the repeatability at the targets; "" if there is none."""
    if goodness.repeatability is None or goodness.repeatability_at_targets is None:
        return ""
    source = "stated" if goodness.repeatability_source == "given" else "estimated"
    return (
        f", repeatability {length_text(goodness.repeatability_at_targets)} at the targets "
        f"({figure(1e6 * goodness.repeatability, '.2g')} µrad a joint, {source})"
    )


def _advice_lines(run: Run, result: RunResult, *, details: bool) -> Iterator[str]:
    """Yield advice on what to measure next: one reading for each joint, or with `details` all readings."""
    advised_joints = set()
    joints = {joint.name: joint for joint in result.joints}
    for advice in result.identifiability.advice:
        if details:
            yield f"{advice.joint}: {advice.message}"
        elif advice.joint not in advised_joints:
            advised_joints.add(advice.joint)
            gain = _predicted_gain_text(run, advice, joints[advice.joint])
            reading = _describe_advised_reading(advice, [joint.kind for joint in result.joints])
            yield f"{advice.joint}: {reading}{gain}"


def _describe_advised_reading(advice: Advice, kinds: Sequence[JointKind]) -> str:
    """Describe an advised reading in words: force, direction and posture."""
    force_size = sqrt(sum(component**2 for component in advice.force))
    # + 0.0 turns −0 into 0
    direction = ", ".join(f"{component / force_size + 0.0:.2f}" for component in advice.force)
    posture = advice.observation or f"{posture_text(advice.joints, kinds)} if free of collisions"
    return f"{figure(force_size)} N along ({direction}) in posture {posture}"


def _predicted_gain_text(run: Run, advice: Advice, joint: JointResult) -> str:
    """Describe how an advised reading would narrow a joint's interval; "" if this is not predicted.

    The prediction is valid only for the partial pose with covariance weights and without priors.
    """
    request = run.request
    if request.method != "partial_pose" or request.weighting != "covariance" or request.priors:
        return ""
    ratio, interval = advice.uncertainty_ratio, joint.compliance_interval
    if ratio is None or interval is None or not joint.compliance:
        narrowed = half_width(advice.standard_uncertainty, 1e6)
        unit = JOINT_UNITS[joint.kind].micro_compliance
        return "" if narrowed is None else f": the interval becomes {narrowed} {unit}"
    percent = 100 * (interval[1] - interval[0]) / 2 / abs(joint.compliance)
    return f": the interval ± {percent:.2g} % becomes ± {ratio * percent:.2g} %"


_SIGMA_TESTS = {
    "consistent": "consistent with sigma",
    "residuals_too_large": "residuals larger than sigma predicts",
    "residuals_too_small": "residuals smaller than sigma predicts",
}


def detail_lines(result: RunResult) -> list[Line]:
    """Return lines for `--details`: suspicious readings, fit, sources of uncertainty, observability."""
    suspicious = [Line(f"  {line}", "care") for line in _suspicious_lines(result)]
    causes = format_tested_causes(result)
    others = (
        *_goodness_lines(result),
        *_budget_lines(result),
        *_complementary_stiffness_lines(result),
        *([f"causes tested with the joints, p-value: {causes}"] if causes else []),
        *_list_identifiability_lines(result.identifiability),
    )
    return [*suspicious, *(Line(f"  {line}", "dim") for line in others)]


def format_tested_causes(result: RunResult) -> str:
    """Format the systematic causes that were fitted with the joints, with p-values; "" if there are none.

    A cause may act only since an observation, `first`, such as a step of the tracker.
    """
    texts = []
    for cause in result.causes:
        since = f" since {cause.first}" if cause.first else ""
        texts.append(f"{cause.name.replace('_', ' ')}{since} {cause.p_value:.1g}")
    return ", ".join(texts)


def _goodness_lines(result: RunResult) -> Iterator[str]:
    """Yield a line with χ² per degree of freedom, if the user gave sigma; else nothing."""
    goodness = result.goodness
    if goodness.sigma_source == "given" and goodness.degrees_of_freedom > 0:
        ratio = goodness.chi_square / goodness.degrees_of_freedom
        verdict = f": {_SIGMA_TESTS[goodness.test]}" if goodness.test else ""
        yield (
            f"χ²/dof {ratio:.2f}{verdict} (1 if model and sigma are right; "
            f"{goodness.degrees_of_freedom:.4g} degrees of freedom)"
        )


_UNCERTAINTY_SOURCES = {
    "readings": "readings",
    "force_scale": "scale of the force",
    "force_direction": "direction of the force",
    "rope_zero": "zero of the load cell",
    "load_point": "load point",
    "assumed_load_point": "load point, 10 mm assumed",
    "assumed_force_scale": "scale of the force, 1 % assumed",
    "fitted_causes": "causes fitted with the joints",
    "target_places": "places of the targets",
    "drift": "drift over the campaign",
    "axes": "axes of the robot's model",
    "model_error": "model error",
    "complementary_stiffness": "neglected K_c",
}


def _budget_lines(result: RunResult) -> Iterator[str]:
    """Yield a line for each source of uncertainty: least and greatest half-width in % of a compliance."""
    budget = result.budget
    if budget is None:
        return
    compliances = [joint.compliance for joint in result.joints if joint.name in budget.joints]
    for component in budget.components:
        percentages = list[float]()
        for contribution, compliance in zip(component.contributions, compliances, strict=True):
            if compliance:
                percentages.append(100 * budget.coverage_factor * contribution / abs(compliance))
        if percentages:
            yield _describe_uncertainty(component, percentages)


def _describe_uncertainty(component: BudgetComponent, percentages: Sequence[float]) -> str:
    """Return a line on a source of uncertainty, with the range of its half-widths in % of a compliance.

    If the least and the greatest percentage have the same text, one number is shown.
    """
    least, greatest = f"{min(percentages):.2g}", f"{max(percentages):.2g}"
    range_text = least if least == greatest else f"{least} to {greatest}"
    excluded = "" if component.included else ", not in the intervals"
    source = _UNCERTAINTY_SOURCES.get(component.source, component.source)
    return (
        f"uncertainty from {source} (type {component.evaluation}{excluded}): ± {range_text} % of a compliance"
    )


def _complementary_stiffness_lines(result: RunResult) -> Iterator[str]:
    """Yield a line on the complementary stiffness K_c: how the load's torques change as the arm deflects."""
    k_c = result.complementary_stiffness
    if k_c is None:
        return
    shift_text = (
        "" if k_c.largest_shift is None else f" by at most {k_c.largest_shift:.2g} std. uncertainties"
    )
    treatment = (
        f"included ({k_c.iterations} refit{'s' if k_c.iterations > 1 else ''}); it changes"
        if k_c.included
        else "neglected; including it changes"
    )
    yield (
        f"complementary stiffness {treatment} a compliance{shift_text} (K_c/k at most "
        f"{k_c.largest_ratio:.2g})"
    )


def _suspicious_lines(result: RunResult) -> Iterator[str]:
    """Yield lines on the readings to which the Huber loss gives less weight, worst first."""
    threshold, count = result.huber_threshold, result.suspicious_count
    if threshold is None:
        return
    yield f"Huber loss, threshold {threshold:g} sigma: {count} suspicious reading{'' if count == 1 else 's'}"
    for reading in result.suspicious:
        yield (
            f"{reading.observation}, {reading.target}: residual of {reading.residual_norm:.3g} sigma, "
            f"weight {reading.weight:.2g}"
        )
    hidden = count - len(result.suspicious)
    if hidden > 0:
        yield f"and {hidden} more"


def _list_identifiability_lines(identifiability: Identifiability) -> Iterator[str]:
    """Yield observability indices, the condition number, and the joints that are determined worst."""
    if identifiability.observability is not None and identifiability.condition_number is not None:
        indices = ", ".join(
            f"{name.upper()} {value:.2g}" for name, value in identifiability.observability.items()
        )
        yield f"observability {indices}; condition number {identifiability.condition_number:.3g}"
    yield from identifiability.weakest


_MODEL_NAMES = {
    "joints": "joints",
    "joints_and_base": "joints and base",
    "coupled_joints": "coupled joints",
    "diagonal_links": "diagonal links",
    "joints_and_links": "joints and links",
    "links_and_base": "joints, links and base",
}
_NO_COMPLIANCE: Final = 1e-9
"""Share of the greatest principal compliance, below which a compliance is rounding error, shown as 0."""
_CHOICE_SOURCES = {"given": "given", "cross_validation": "by cross-validation"}


def links_report(links: LinksResult, choice: ModelChoice) -> list[Part]:
    """Return tables and lines on elastic links: shares, compliances, compared models, certificate."""
    parts: list[Part] = [_elements_table(links)]
    if links.links:
        parts.append(_links_table(links, choice.elasticity))
    if links.base is not None:
        parts.append(_base_table(links.base))
    if choice.models:
        parts.append(choice_table(choice))
    return parts + [Line(f"  {line}", "dim") for line in _describe_fit_of_links(links, choice)]


def _describe_fit_of_links(links: LinksResult, choice: ModelChoice) -> Iterator[str]:
    """Yield lines on the fit of elastic links: its model, freedom, and proof of the optimum.

    The gap is the distance to the proven optimum. With squared loss it is of all fitted readings together,
    otherwise of the mean length of a residual.
    """
    yield (
        f"{_MODEL_NAMES[choice.elasticity]} ({_CHOICE_SOURCES[choice.source]}), loss {choice.loss} "
        f"({_CHOICE_SOURCES[links.loss_source]}), penalty {links.penalty:.3g} "
        f"({_CHOICE_SOURCES[links.penalty_source]})"
    )
    yield f"the readings determine {links.effective_freedom:.1f} of {links.parameters} parameters"
    per_target = "" if choice.loss == "squared" else " per target"
    yield (
        f"the fit is proven to be the best, to within {links.certificate.gap:.1e} sigma{per_target}; no "
        "compliance matrix has a negative eigenvalue"
    )


def _find_explained_by_model(choice: ModelChoice) -> dict[ElasticModel, float]:
    """Return the fraction of the deflection of held-out postures that each compared model explains."""
    # A model was compared with several losses: take its best loss, but for the model of this run the loss of
    # this run.
    loss_of_model = {**choice.losses, choice.elasticity: choice.loss}
    return {each.model: each.compensation for each in choice.models if each.loss == loss_of_model[each.model]}


def links_line(links: LinksResult, choice: ModelChoice) -> Line:
    """Return a line on the deflection that a model with elastic links explains.

    If models were compared, the line has the fractions of the deflection of held-out postures that this model
    and joints alone explain; otherwise it has the fraction of the squared deflection of all readings.
    """
    model, explained_by_model = choice.elasticity, _find_explained_by_model(choice)
    if choice.simplest is None or not {"joints", model} <= set(explained_by_model):
        return Line(
            f"  {_MODEL_NAMES[model]}: {format_percent(1.0 - links.unexplained)} of the squared deflection"
        )
    simplest = f"; simplest good model: {_MODEL_NAMES[choice.simplest]}"
    return Line(
        f"  {_MODEL_NAMES[model]} with loss {choice.loss} explain "
        f"{format_percent(explained_by_model[model])} of "
        f"held-out postures, joints alone {format_percent(explained_by_model['joints'])}"
        f"{'' if choice.simplest == model else simplest}"
    )


def _elements_table(links: LinksResult) -> Table:
    """Return a table of the share of each elastic element (joint, link, base) in the squared deflection.

    A row has the share over all observations, and its least and greatest value in one observation. The last
    row is what no element explains.
    """
    elements = links.elements
    names = [_name_element(element) for element in elements]
    shares = [element.share for element in elements]
    least = [min(element.by_observation) for element in elements]
    greatest = [max(element.by_observation) for element in elements]
    columns = [
        Column("element", [*names, "unexplained"], text=True),
        Column("overall", [*shares, links.unexplained], format_percent),
        Column("least", [*least, None], format_percent),
        Column("greatest", [*greatest, None], format_percent),
    ]
    caption = (
        "overall fractions sum to 100 %; fractions of squared lengths differ from the explained "
        "fraction of the mean deflection"
    )
    return Table(columns, title="Fraction of the squared deflection", caption=caption)


def _name_element(element: ElementShare) -> str:
    """Return the name of an elastic element: "joint_2", "link behind joint_2" or "base"."""
    if element.kind == "link":
        return f"link behind {element.joint}"
    return element.joint or element.kind


def _links_table(links: LinksResult, model: ElasticModel) -> Table:
    """Return a table of each elastic link's principal compliances and effective number of parameters."""
    translations = [_principal_compliances(each, "translation") for each in links.links]
    rotations = [_principal_compliances(each, "rotation") for each in links.links]
    freedoms = [f"{each.effective_freedom:.1f} of {each.parameters}" for each in links.links]
    columns = [
        Column("behind", [link.joint for link in links.links], text=True),
        Column("translation", translations, as_line),
        Column("rotation", rotations, as_line),
        Column("freedom", freedoms),
    ]
    return Table(
        columns,
        title=f"Links, {_MODEL_NAMES[model]}",
        caption="principal compliances, translation in µm/kN and rotation in µrad/(kN·m); freedom: number "
        "of parameters that the readings determine",
    )


class _ShownMotion(NamedTuple):
    """Names and units in which the compliances of a translation or a rotation are shown."""

    name: str
    compliance_unit: str  # of the compliance times 10⁹
    stiffness_unit: str
    stiffness_factor: float  # from SI units to `stiffness_unit`


_TRANSLATION: Final = _ShownMotion("translation", "µm/kN", "N/µm", 1e-6)
_ROTATION: Final = _ShownMotion("rotation", "µrad/(kN·m)", "N·m/rad", 1.0)


@dataclass(frozen=True)
class _BaseRow:
    """A row of the table of the base, for one principal direction."""

    motion: str
    direction: str
    compliance: Line
    stiffness: Line

    @classmethod
    def from_principal(
        cls, motion: _ShownMotion, principal: PrincipalCompliance, greatest: float
    ) -> _BaseRow:
        """Return the row of a principal compliance.

        A compliance that is negligible relative to the greatest one of its motion is shown as rigid.
        """
        direction = ", ".join(f"{component:.2f}" for component in principal.direction)
        if principal.value <= _NO_COMPLIANCE * greatest:
            return cls(motion.name, direction, _bare_cell(["0"], motion.compliance_unit), Line("rigid"))
        compliance = _bare_cell([f"{1e9 * principal.value:.3g}"], motion.compliance_unit)
        stiffness = figure(motion.stiffness_factor / principal.value, ".3g")
        return cls(motion.name, direction, compliance, _bare_cell([stiffness], motion.stiffness_unit))


def _base_table(base: ElasticCompliance) -> Table:
    """Return a table of the base: direction, compliance and stiffness for each principal direction."""
    rows = list[_BaseRow]()
    for motion, compliances in ((_TRANSLATION, base.translation), (_ROTATION, base.rotation)):
        greatest = compliances[0].value if compliances else 0.0
        rows += [_BaseRow.from_principal(motion, each, greatest) for each in compliances]
    columns = [
        Column("base", [row.motion for row in rows], as_line, text=True),
        Column("direction in R0", [row.direction for row in rows], as_line, text=True),
        Column("compliance", [row.compliance for row in rows], as_line, text=True),
        Column("stiffness", [row.stiffness for row in rows], as_line, text=True),
    ]
    caption = (
        "principal compliances about the origin of R0; the readings determine "
        f"{base.effective_freedom:.1f} of {base.parameters} parameters"
    )
    return Table(columns, title="Base below joint 1", caption=caption)


def _bare_cell(values: Sequence[str], unit: str = "") -> Line:
    """Return a cell of numbers that have no intervals, with their unit; a missing number is a dash."""
    numbers = tuple(NumberParts(value, unit=unit) for value in values if value != NO_NUMBER)
    return Line(f"{', '.join(values)} {unit}".rstrip(), numbers=numbers)


def _principal_compliances(link: ElasticCompliance, motion: str) -> Line:
    """Format the principal compliances of a link: translation [µm/kN] or rotation [µrad/(kN·m)].

    `motion` is "translation" or "rotation".
    """
    values = link.translation if motion == "translation" else link.rotation
    rounding_error = _NO_COMPLIANCE * values[0].value  # values are sorted, greatest first
    return _bare_cell([f"{1e9 * each.value if each.value > rounding_error else 0.0:.3g}" for each in values])


def choice_table(choice: ModelChoice) -> Table:
    """Return a table of the elastic models and losses with their scores in cross-validation."""
    models = choice.models
    return Table(
        [
            Column("model", [_MODEL_NAMES[each.model] for each in models], text=True),
            Column("loss", [each.loss for each in models], text=True),
            *estimate_columns("compensation", [_show_compensation(each) for each in models], 0.95, "%"),
            Column("penalty", [each.penalty for each in models], number_formatter(".2g")),
            Column("", [_model_remarks(each, choice) for each in models], text=True),
        ],
        title="Compensation of held-out configurations",
        caption="mean over the folds of the cross-validation; the last column marks the best model, and the "
        "simplest model within one standard error, each with its best loss",
    )


def _show_compensation(model: ScoredModel) -> ShownEstimate:
    """Format the compensation of a compared model in %, with its 95 % interval."""
    half = NORMAL_95 * model.standard_error
    return show_estimate(model.compensation, (model.compensation - half, model.compensation + half), 100.0)


def _model_remarks(scored: ScoredModel, choice: ModelChoice) -> str:
    """Return the remarks on a model and loss, such as "this run" or "best"; "" if it has none."""
    is_chosen = (scored.model, scored.loss) == (choice.elasticity, choice.loss)
    remarks = ["this run"] if is_chosen else []
    # `simplest` and `best` name models, each with its best loss.
    if scored.loss == choice.losses.get(scored.model):
        remarks += ["simplest within one standard error"] if scored.model == choice.simplest else []
        remarks += ["best"] if scored.model == choice.best else []
    return ", ".join(remarks)


def resampling_table(run: Run, resampling: ResamplingResult, unit: StiffnessUnit) -> Table:
    """Return a table of the fits of resampled configurations: a row for each joint, then the compensation.

    The compensation is the share of the mean deflection that a fit explains, over all configurations; it has
    no row if it is not known.
    """
    rows = [_make_resampled_row(joint, unit) for joint in resampling.joints]
    rows += _list_compensation_rows(resampling)
    columns = [
        Column("joint", [row.name for row in rows], text=True),
        Column("mean", [row.mean for row in rows], as_line),
        Column("deviation", [row.deviation for row in rows], as_line),
        Column("negative", [row.negative for row in rows], as_line),
        Column("rigid", [row.rigid for row in rows], as_line),
        Column("undetermined", [row.undetermined for row in rows], as_line),
    ]
    options = run.request.resampling
    sample_text = f"{options.size} configurations drawn at random" if options else ""
    caption = (
        f"stiffness in {unit.label_of(resampling.joints)}: mean and standard deviation over the "
        "resampled fits; compensation: fraction of the deflection explained in all configurations"
    )
    return Table(columns, title=f"{resampling.repetitions} fits of {sample_text}", caption=caption)


@dataclass(frozen=True)
class _ResampledRow:
    """A row of the table of resampled fits: statistics of a joint over the fits, or of the compensation."""

    name: str
    mean: str | Line
    deviation: str | Line
    negative: str  # fraction of the fits in which the stiffness is negative
    rigid: str  # fraction of the fits in which the stiffness is infinite
    undetermined: str  # fraction of the fits that do not determine the stiffness


def _make_resampled_row(joint: ResampledJoint, unit: StiffnessUnit) -> _ResampledRow:
    """Return the row of a joint in the table of resampled fits."""
    mean, deviation = compute_mean_and_deviation(joint, unit)
    return _ResampledRow(
        name=joint.name,
        mean=_bare_cell([_rounded_or_dash(mean, deviation)]),
        deviation=_bare_cell([_rounded_or_dash(deviation, deviation)]),
        negative=_share_text(joint.share_negative),
        rigid=_share_text(joint.share_infinite),
        undetermined=_share_text(joint.share_undetermined),
    )


def _list_compensation_rows(resampling: ResamplingResult) -> list[_ResampledRow]:
    """Return the row of the compensation; no row if the compensation is not known."""
    mean, deviation = resampling.compensation_mean, resampling.compensation_deviation
    if mean is None or deviation is None:
        return []
    row = _ResampledRow(
        "compensation", format_percent(mean), format_percent(deviation), NO_NUMBER, NO_NUMBER, NO_NUMBER
    )
    return [row]


def _share_text(share: float) -> str:
    """Format the share of fits in which something holds, in per cent."""
    return f"{100 * share:.3g} %"


def _rounded_or_dash(value: float | None, uncertainty: float | None) -> str:
    """Format a value with the digits that its uncertainty justifies; return a dash if the value is None."""
    return NO_NUMBER if value is None else format_rounded(value, uncertainty)


def compute_mean_and_deviation(
    joint: ResampledJoint, unit: StiffnessUnit
) -> tuple[float | None, float | None]:
    """Return mean and standard deviation over all resampled fits of a joint's stiffness.

    The numbers are in `unit`. Both are None if a fit does not
    determine the joint.
    """
    moments = (joint.stiffness_mean, joint.stiffness_deviation)
    factor = unit.for_kind(joint.kind).factor
    mean, deviation = (None if value is None else factor * value for value in moments)
    return mean, deviation


def make_charts(result: RunResult) -> list[Chart]:
    """Return charts of stiffnesses, contributions of the joints, measured deflection and residual."""
    charts = [
        *_draw_stiffnesses(result.joints, "revolute", "10⁶ N·m/rad"),
        *_draw_stiffnesses(result.joints, "prismatic", "N/µm"),
    ]
    if result.contributions:
        shares = {"contribution": [each.share for each in result.contributions]}
        names = [each.joint for each in result.contributions]
        title = "Contribution to the deflection"
        charts.append(Chart(title, names, shares, 1e2, "%", "joints", quantity="contribution"))
    # Residuals are a hundredth of the deflections: each of them has its own axis.
    measured = result.mean_lengths("deflection")
    residuals = result.mean_lengths("residual")
    series = {"measured": [*measured.values()]}
    residual_series = {"left over": [*residuals.values()]}
    return [
        *charts,
        Chart("Measured deflection", [*measured], series, 1e3, "mm", quantity="deflection"),
        Chart("Left over by the model", [*residuals], residual_series, 1e6, "µm", quantity="residual"),
    ]


def _draw_stiffnesses(joints: Sequence[JointResult], kind: JointKind, unit: str) -> list[Chart]:
    """Return the chart of the stiffness of all joints of a kind; none if no such joint has a stiffness.

    `unit` is the unit shown, which is 10⁶ times the SI unit.
    """
    of_kind = [joint for joint in joints if joint.kind == kind]
    if all(joint.stiffness is None for joint in of_kind):
        return []
    chart = Chart(
        "Stiffness with its interval",
        names=[joint.name for joint in of_kind],
        series={"stiffness": [joint.stiffness for joint in of_kind]},
        factor=1e-6,
        unit=unit,
        axis="joints",
        intervals={"stiffness": [joint.stiffness_interval for joint in of_kind]},
        logarithmic=True,
        quantity="stiffness",
    )
    return [chart]


def joints_sheet(run: Run) -> Sheet:
    """Return the file `joints.csv`: a row for each joint; empty if the run has no result."""
    joints = run.result.joints if run.result else []
    return Sheet.with_joint_kinds(Sheet.from_messages(joints, _JOINTS), [joint.kind for joint in joints])


def residuals_sheet(run: Run) -> Sheet:
    """Return the file `residuals.csv`: a row for each observation and target; empty if no result."""
    return Sheet.from_messages(run.result.residuals if run.result else [], _RESIDUALS)


_JOINTS: Final = {
    "joint": "name",
    "status": "status",
    "verdict": "verdict",
    "stiffness": "stiffness",
    "stiffness {low high}": "stiffness_interval",
    "compliance": "compliance",
    "standard uncertainty": "standard_uncertainty",
    "compliance {low high}": "compliance_interval",
    "reason": "reason",
}
_RESIDUALS: Final = {
    "observation": "observation",
    "target": "target",
    "deflection {x y z}": "deflection",
    "residual {x y z}": "residual",
}
_EXAMPLES: Final[dict[str, Any]] = {
    "default": {"measurement_set_id": "ID_OF_A_STORED_SET"},
    "decoupled, bounded": {
        "measurement_set_id": "ID_OF_A_STORED_SET",
        "method": "decoupled_partial_pose",
        "weighting": "covariance",
        "stiffness_bounds": {"joint_2": [1e6, None]},
    },
}


def _prepare_work(inputs: Inputs, request: RunRequest) -> Work:
    """Return the work of a run, which is computed later; numerical modules are imported here."""
    from jointstiff.service.kinds.run.work import prepare_identification

    return prepare_identification(inputs, request)


RUN: Final = Kind[Run, RunRequest](
    message=Run,
    request=RunRequest,
    options=RunOptions,
    prepare_work=_prepare_work,
    make_report=_make_report,
    sources=("measurement_set",),
    title="Joint stiffness",
    stepped=True,
    has_report=False,
    examples=_EXAMPLES,
    make_charts=make_charts,
    files=(
        File(
            name="joints.csv",
            description="one row per joint, with intervals and verdict",
            sheet=joints_sheet,
            made_of="result",
        ),
        File(
            name="residuals.csv",
            description="deflection and residual of each target and observation",
            sheet=residuals_sheet,
            made_of="result",
        ),
    ),
    description="""Identify the joint stiffnesses, and store the result with its provenance.

A method that the readings cannot support is refused, and nothing is stored. Any other failure is a stored
run in state `failed` with its `error`.""",
)
