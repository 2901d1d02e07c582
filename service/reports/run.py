"""The report of a run, made from the run, its measurement set and the laboratory's settings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import fmean
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.deflection import CaseResult, DeflectionOptions, LoadCase
from jointstiff.schemas.measurement import Grounds, MeasurementSetDocument, Noise
from jointstiff.schemas.report import Laboratory
from jointstiff.schemas.run import Budget, Goodness, JointResult, RunRequest, RunResult, WeightResult
from jointstiff.service.conversion.measurements import to_common_uncertainty
from jointstiff.service.conversion.robots import joint_factors
from jointstiff.service.conversion.units import FORCE, LENGTH
from jointstiff.service.kinds.run.kind import format_tested_causes
from jointstiff.service.reports.document import (
    ASSESSMENT,
    IDENTIFICATION,
    NOT_ISO_9283,
    NOT_STATED,
    ORIGIN,
    REQUESTED,
    RESULTS,
    STATED,
    Attachment,
    Document,
    Fact,
    Picture,
    Section,
    format_percent,
    format_time,
    list_versions,
)
from jointstiff.service.reports.exports import ExportedModel, explain_missing_stiffness, write_joints_csv
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.pictures import draw_arm, draw_deflections, draw_intervals
from jointstiff.service.runs.deflection import predict_by_run, show_component
from jointstiff.service.runs.verdicts import refuse_unaccepted
from jointstiff.service.tables.estimate import estimate_columns, model_error_text
from jointstiff.service.tables.report import (
    METHOD_NAMES,
    VERDICTS,
    describe_passed_checks,
    list_request_fields,
)
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.service.tables.table import NO_NUMBER, Column, Table, build_text_table, format_rounded
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.measurements import (
    ASSUMED_FORCE_SCALE,
    ASSUMED_LOAD_POINT,
    FORCE_BEYOND_PULLEY,
    CommonUncertainty,
)
from jointstiff.solver.text import figure, length_text

STATEMENTS: Final = (
    "The results relate only to the item that is identified here, in the state and under the conditions of "
    "the measurement.",
    NOT_ISO_9283,
    "This report may be reproduced only in full, except with the laboratory's approval.",
    "No statement of conformity with a specification is made. The verdicts are opinions by the rules of the "
    "software, which are published with it; the verdicts state whether a number may be used, not "
    "whether the item is good.",
    "Sampling: none. All observations of the measurement set were used, except those named under deviations.",
    "Results from external providers: none, except the readings if the laboratory did not take them; the "
    "operator is named above.",
)

UNCERTAINTY: Final = "Uncertainty budget"
PREDICTED: Final = "Predicted static compliance of the flange"
METHOD: Final = "Method and deviations from it"
ADJUSTMENT: Final = "Before and after adjustment"
TRACEABILITY: Final = "Conditions and traceability"

AT_THE_END: Final = "lines at the end, to fill in and to sign"

ITEMS: Final = (
    ("7.8.2.1 a", "title", "above"),
    ("7.8.2.1 b", "name and address of the laboratory", "letterhead"),
    ("7.8.2.1 c", "location of the activities", IDENTIFICATION),
    ("7.8.2.1 d", "unique identification on each page, end mark", "head and foot of each page, end"),
    ("7.8.2.1 e", "customer", IDENTIFICATION),
    ("7.8.2.1 f", "method", METHOD),
    ("7.8.2.1 g", "item: description, identification, condition", IDENTIFICATION),
    ("7.8.2.1 h", "date of receipt", AT_THE_END),
    ("7.8.2.1 i", "dates of the activities", IDENTIFICATION),
    ("7.8.2.1 j", "date of issue", AT_THE_END),
    ("7.8.2.1 k", "sampling", STATED),
    ("7.8.2.1 l", "results relate only to the item", STATED),
    ("7.8.2.1 m", "results with units", RESULTS),
    ("7.8.2.1 n", "additions to, deviations and exclusions from the method", METHOD),
    ("7.8.2.1 o", "who authorised the report", AT_THE_END),
    ("7.8.2.1 p", "results from external providers", STATED),
    ("7.8.4.1 a", "measurement uncertainty", f"{RESULTS}, {UNCERTAINTY}"),
    ("7.8.4.1 b", "conditions that influence the results", TRACEABILITY),
    ("7.8.4.1 c", "metrological traceability", TRACEABILITY),
    ("7.8.4.1 d", "results before and after adjustment or repair", ADJUSTMENT),
    ("7.8.4.1 e", "statement of conformity", f"{STATED}: none"),
    ("7.8.4.1 f", "opinions and interpretations", ASSESSMENT),
)
"""Clause of ISO/IEC 17025, what it requires, and the place in the report that has it."""


MAX_ATTACHED_BYTES: Final = 2_500_000
"""Greatest JSON of a run that is attached completely [bytes]; the PDF compresses it to a quarter."""
TITLE: Final = "Report on joint stiffness"
PREDICTED_FORCE: Final = 100.0
"""Force for the predicted compliance of the flange [N]; small enough for a linear deflection."""
_AXES: Final = ("X", "Y", "Z")
_LISTS_BY_OBSERVATION: Final = ("residuals", "contributions", "encoder_residuals")
_UNIT: Final = UNITS["MNm/rad"]
_USUAL_PROBABILITY: Final = 0.95
"""Coverage probability that nearly corresponds to the coverage factor k = 2."""
_MOST_WARNINGS: Final = 12
_TARGETS_NAMED: Final = 8
_NO_BUDGET: Final = (
    "The run has no uncertainty budget, because links or a coupling of joints bend, or because "
    "an older version made the run. The intervals in the results include the known sources."
)
_INTERVAL_IS_NO_BUDGET: Final = (
    "The interval of a joint in the results differs from y ± U: the interval contains all "
    "stiffnesses that the likelihood of the readings does not exclude, can be asymmetric, and "
    "omits the sources that are not included above."
)
_MISSING: Final = {
    "model_error": "the run has no bound of the model error",
    "lack_of_fit": "the assessment names a lack of fit: U does not include the bending of links",
}


@dataclass(frozen=True, eq=False)
class RunSubject:
    """Run, readings and settings from which a report is made."""

    model: ExportedModel  # run with its robot
    readings: MeasurementSetDocument  # the measurement set; of its observations only the postures are drawn
    settings: LaboratorySettings  # settings of the laboratory

    def run_json(self) -> bytes:
        """Return the JSON of the run to attach; for a large run without the lists of its observations."""
        run = self.model.run
        whole = run.model_dump_json().encode()
        if len(whole) <= MAX_ATTACHED_BYTES or run.result is None:
            return whole
        shorter = run.result.model_copy(update={name: [] for name in _LISTS_BY_OBSERVATION})
        return run.model_copy(update={"result": shorter}).model_dump_json().encode()


def build_run_report(subject: RunSubject) -> Document:
    """Build the report of a run; equal runs, measurement sets and settings give equal documents."""
    run = subject.model.run
    return Document(
        title=TITLE,
        number=run.id,
        letterhead=subject.settings.letterhead(),
        dated=run.provenance.ended_at or run.provenance.created_at,
        sections=_build_sections(subject),
        attachments=_build_attachments(subject),
    )


def _build_sections(subject: RunSubject) -> list[Section]:
    """Return the sections of the report of a run, in order."""
    model, laboratory = subject.model, subject.settings.laboratory
    items = build_text_table(["item", "requirement", "place in this report"], ITEMS, left_aligned=[0, 1, 2])
    return [
        build_results_section(model, subject.readings),
        build_assessment_section(model.result),
        _build_identification_section(subject),
        *_build_prediction_section(subject),
        build_uncertainty_section(model),
        build_method_section(model, laboratory),
        Section(REQUESTED, facts=list_request_fields(model.run.request)),
        _build_adjustment_section(model),
        _build_traceability_section(subject.readings, laboratory),
        Section(STATED, paragraphs=list(STATEMENTS)),
        _build_origin_section(subject),
        Section("Items of ISO/IEC 17025:2017 and their places in this report", tables=[items]),
    ]


def _build_attachments(subject: RunSubject) -> list[Attachment]:
    """Return the files within the report of a run: the run as JSON, and its joints as CSV."""
    about_run = "The run; a large one without its residuals"
    joints = write_joints_csv(subject.model)
    return [
        Attachment("run.json", "application/json", about_run, subject.run_json()),
        Attachment("joints.csv", "text/csv", "The joints as a table", joints),
    ]


def _build_identification_section(subject: RunSubject) -> Section:
    """Return the section that identifies report, customer, place, robot and measurement."""
    readings, run = subject.readings, subject.model.run
    laboratory = subject.settings.laboratory or Laboratory(name=NOT_STATED)
    location = laboratory.place or ", ".join(laboratory.address)
    facts = [
        ("Report", run.id),
        ("Customer", _describe_customer(laboratory)),
        ("Location of the measurement", location or NOT_STATED),
        ("Item", _describe_robot(subject.model)),
        ("Serial number", readings.serial_number or NOT_STATED),
        ("Condition of the item", readings.item_condition or NOT_STATED),
        ("Measured", format_time(readings.measured_at)),
        ("Computed", format_time(run.provenance.ended_at)),
        ("Measurement set", readings.name),
        ("Operator", readings.operator or NOT_STATED),
        ("Notes on the measurement", readings.notes or ""),
    ]
    return Section(IDENTIFICATION, facts=[(name, value) for name, value in facts if value])


def _describe_robot(model: ExportedModel) -> str:
    """Return the robot in words: its name, and the names of its joints."""
    joint_names = ", ".join(model.robot.joint_names)
    return f"Industrial robot {model.name}, {model.robot.n} joints: {joint_names}"


def _describe_customer(laboratory: Laboratory) -> str:
    """Return name, address and contact of the laboratory's customer in one line, where they are stated."""
    customer = laboratory.customer
    if customer is None:
        return NOT_STATED
    lines = [customer.name, *customer.address, customer.contact]
    return ", ".join(line for line in lines if line)


def _repeatability_facts(goodness: Goodness) -> list[tuple[str, str]]:
    """Return name and text of the repeatability of the joints; nothing if the readings show none."""
    at_joint, at_targets = goodness.repeatability, goodness.repeatability_at_targets
    if at_joint is None or at_targets is None:
        return []
    source = "stated" if goodness.repeatability_source == "given" else "estimated"
    text = f"{length_text(at_targets)} ({figure(1e6 * at_joint, '.2g')} µrad a joint, {source})"
    return [("Repeatability of the robot at the targets", text)]


def build_results_section(model: ExportedModel, readings: MeasurementSetDocument) -> Section:
    """Return the section with the stiffness of each joint and its interval, and with pictures."""
    confidence = model.run.request.confidence
    notes = list[str]()
    for joint in model.result.joints:
        if joint.stiffness is None:
            notes.append(f"{joint.name}: no number: {explain_missing_stiffness(joint)}.")
    return Section(
        RESULTS,
        tables=[_build_joint_table(model.result, confidence)],
        notes=notes,
        facts=_list_facts_of_fit(model.result),
        pictures=_draw_results(model, readings),
    )


def _draw_results(model: ExportedModel, readings: MeasurementSetDocument) -> list[Picture]:
    """Return the pictures of stiffnesses, of deflections, and of the arm in its first posture.

    A picture without numbers is left out.
    """
    first_posture = joint_factors(model.robot, readings.units) * readings.observations[0].joints
    pictures = [
        draw_intervals(model.result.joints, model.run.request.confidence),
        draw_deflections(model.result),
        draw_arm(model.robot, first_posture.tolist()),
    ]
    return [picture for picture in pictures if picture is not None]


def _build_joint_table(result: RunResult, confidence: float) -> Table:
    """Return the table of the joints with stiffness, interval and verdict."""
    estimates = [_UNIT.show_joint(joint) for joint in result.joints]
    name_column = Column("joint", [joint.name for joint in result.joints], text=True)
    stiffness_columns = estimate_columns("stiffness", estimates, confidence, _UNIT.label)
    verdict_column = Column("verdict", result.joints, _name_verdict, text=True)
    return Table([name_column, *stiffness_columns, verdict_column])


def _list_facts_of_fit(result: RunResult) -> list[tuple[str, str]]:
    """Return name and text of the numbers that show how well the model fits the readings."""
    sigma = NO_NUMBER
    if result.sigma is not None:
        sigma = f"{format_rounded(1e6 * result.sigma)} µm ({result.goodness.sigma_source})"
    explained = format_percent(result.compensation)
    return [
        ("Fraction of the mean deflection that the model explains", explained),
        ("Root mean square of the residuals' lengths", length_text(result.rms_residual)),
        ("Standard uncertainty of a coordinate of a reading", sigma),
        *_repeatability_facts(result.goodness),
    ]


def _name_verdict(joint: JointResult) -> str:
    """Return the verdict on a joint in words; of a joint that is not identified, its status."""
    return VERDICTS[joint.verdict] if joint.status == "identified" else joint.status.replace("_", " ")


class ExpandedUncertainty(NamedTuple):
    """Expanded uncertainty U = k · u of a number, as JCGM 100 (GUM) states it: "2.0 ± 0.3, k = 2, 95 %"."""

    value: float  # U, in the unit of the number
    coverage_factor: float  # k
    probability: float  # that the true value is within ± U


def list_expanded_uncertainties(model: ExportedModel) -> list[ExpandedUncertainty | None]:
    """Return the expanded uncertainty of the stiffness of each joint of a model.

    The uncertainty includes the model error; it is None for a joint without stiffness or without a budget.
    """
    budget = model.result.budget
    if budget is None:
        return [None for _ in model.result.joints]
    return [_expand_uncertainty(budget, joint) for joint in model.result.joints]


def _expand_uncertainty(budget: Budget, joint: JointResult) -> ExpandedUncertainty | None:
    """Return the expanded uncertainty of a joint's stiffness; None if it has none, or is not in the budget.

    The budget has u(c) of the compliance c. The stiffness is s = 1/c, so u(s) = s² · u(c), by the derivative.
    """
    if joint.name not in budget.joints or joint.stiffness is None:
        return None
    stored = budget.expanded_with_model_error[budget.joints.index(joint.name)]
    standard = stored / budget.coverage_factor  # u(c)
    factor = _coverage_factor(budget)
    return ExpandedUncertainty(factor * standard * joint.stiffness**2, factor, budget.probability)


def predict_flange_compliance(subject: RunSubject) -> list[CaseResult]:
    """Predict the displacement of the flange's centre by 100 N along each axis of R0, in the first posture.

    Returns:
        Results for X, Y and Z; an empty list if the run cannot predict, or has the verdict "do not use".
    """
    model = subject.model
    cases = _list_flange_loads(subject.readings)
    try:
        refuse_unaccepted(model.result.assessment, None, f"run '{model.run.id}'")
        request = DeflectionOptions(units=subject.readings.units, load_point=(0.0, 0.0, 0.0), cases=cases)
        return predict_by_run(model.robot, model.run, request).cases
    except RequestError:
        return []


def _list_flange_loads(readings: MeasurementSetDocument) -> list[LoadCase]:
    """Return a load of 100 N along X, along Y and along Z in the posture of the first observation."""
    size = PREDICTED_FORCE / FORCE[readings.units.force]  # in the set's unit of force
    joints = readings.observations[0].joints
    forces = size * np.eye(3)
    return [
        LoadCase(label=axis, joints=joints, force=force.tolist())
        for axis, force in zip(_AXES, forces, strict=True)
    ]


def _build_prediction_section(subject: RunSubject) -> Iterator[Section]:
    """Yield the section with the predicted static compliance of the flange; nothing without a prediction.

    The table of the section has the form of ISO 9283, clause 10.
    """
    cases = predict_flange_compliance(subject)
    if not cases:
        return
    displacements = [f"predicted displacement along {axis} [mm/N]" for axis in _AXES]
    head = ["force along", *displacements, "model error"]
    rows = [_make_prediction_row(case) for case in cases]
    remarks = dict.fromkeys(remark for case in cases for remark in case.remarks)
    yield Section(
        PREDICTED,
        paragraphs=[describe_prediction(subject)],
        tables=[build_text_table(head, rows, "in brackets: 95 % interval")],
        notes=list(remarks),
    )


def _make_prediction_row(case: CaseResult) -> list[str]:
    """Return the cells of a load: its axis, displacement along X, Y, Z [mm/N], and if its error is known."""
    millimetres_per_newton = 1e3 / PREDICTED_FORCE
    components = [show_component(case, axis, millimetres_per_newton) for axis in range(3)]
    known = NO_NUMBER
    if case.displacement is not None:
        known = model_error_text(case.with_model_error is not None) or NO_NUMBER
    return [case.label, *[component.cell.text for component in components], known]


def describe_prediction(subject: RunSubject) -> str:
    """Return a paragraph on the prediction of the compliance: the method, the point and the posture."""
    return (
        "Predicted from the identified stiffness, not measured: displacement of the flange's centre by a "
        f"force there, in the posture of observation {subject.readings.observations[0].label}, axes of R0. "
        "ISO 9283:1998, clause 10, has such a table of measured displacements."
    )


def _coverage_factor(budget: Budget) -> float:
    """Return the coverage factor of a budget: at 95 % at least 2, as EA-4/02 requires, instead of 1.96."""
    if budget.probability == _USUAL_PROBABILITY and budget.coverage_factor <= 2.0:
        return 2.0
    return budget.coverage_factor


def build_uncertainty_section(model: ExportedModel) -> Section:
    """Return the section with the uncertainty budget of the compliances, or why the run has no budget."""
    budget, weight = model.result.budget, model.result.weight
    if weight is not None:
        return _build_weight_uncertainty_section(weight)
    if budget is None:
        return Section(UNCERTAINTY, paragraphs=[_NO_BUDGET])
    rows = [*_make_budget_rows(budget, model.result), _make_expanded_row(model, budget)]
    caption = "Contributions to the standard uncertainty of each compliance [% of the compliance]"
    return Section(
        UNCERTAINTY,
        tables=[build_text_table(["source", "type", *budget.joints], rows, caption)],
        paragraphs=[_describe_budget(budget), _INTERVAL_IS_NO_BUDGET],
    )


def _describe_budget(budget: Budget) -> str:
    """Return the paragraph that states how U is expanded, what is missing, and the greatest correlation."""
    factor = figure(_coverage_factor(budget))
    missing = "".join(f"The budget is partial: {_MISSING[source]}. " for source in budget.missing)
    return (
        "The reported expanded uncertainty U is stated as the standard uncertainty of measurement, by "
        f"all sources of this budget, multiplied by the coverage factor k = {factor}, which "
        f"corresponds to a coverage probability of approximately {format_percent(budget.probability)} "
        "(JCGM 100:2008, EA-4/02). The relative uncertainty of a stiffness is that of its compliance. "
        f"{missing}{_describe_correlation(budget)}"
    )


def _build_weight_uncertainty_section(weight: WeightResult) -> Section:
    """Return the section on uncertainty of a run by own weight, which has no budget."""
    rows = [
        [joint.joint, _format_share(joint.readings), _format_share(joint.masses)] for joint in weight.joints
    ]
    return Section(
        UNCERTAINTY,
        paragraphs=[
            "Fractions of each interval's width: from the readings, and from the bounds of the masses."
        ],
        tables=[build_text_table(["joint", "readings", "uncertain masses"], rows, left_aligned=[0])],
    )


def _format_share(fraction: float | None) -> str:
    """Return a fraction in whole percent: 0.254 → "25 %"; a dash in place of a missing one."""
    return NO_NUMBER if fraction is None else f"{100 * fraction:.0f} %"


def _make_budget_rows(budget: Budget, result: RunResult) -> list[list[str]]:
    """Return the rows of the budget's table: each source, then the combined and expanded uncertainties.

    A row has source, type of evaluation (A: by statistics, B: otherwise), and a cell for each joint: an
    uncertainty in % of the joint's compliance.
    """
    compliances = {joint.name: abs(joint.compliance or 0.0) for joint in result.joints}
    sizes = [compliances[name] for name in budget.joints]
    rows = list[list[str]]()
    for component in budget.components:
        remark = "" if component.included else " (not included)"
        source = component.source.replace("_", " ") + remark
        rows.append([source, component.evaluation, *_format_fractions(component.contributions, sizes)])
    for source, uncertainties in _list_combined_uncertainties(budget).items():
        rows.append([source, "", *_format_fractions(uncertainties, sizes)])
    return rows


def _list_combined_uncertainties(budget: Budget) -> dict[str, Sequence[float]]:
    """Return text of the source → combined uncertainty of each joint's compliance.

    The stored expanded uncertainty is divided by its own factor, and expanded again by the printed factor,
    because the printed factor has fewer digits.
    """
    printed_factor = _coverage_factor(budget)
    combined = [expanded / budget.coverage_factor for expanded in budget.expanded_with_model_error]
    extent = "partial" if budget.missing else "all sources"
    return {
        "combined, only sources that the intervals include": budget.standard_uncertainty,
        "combined, all sources": combined,
        f"expanded, {extent}, k = {figure(printed_factor)}": [printed_factor * u for u in combined],
    }


def _format_fractions(numbers: Sequence[float], wholes: Sequence[float]) -> list[str]:
    """Return each number in percent of its whole; a dash where the whole is zero."""
    cells = list[str]()
    for number, whole in zip(numbers, wholes, strict=True):
        percent = 100.0 * number / whole if whole else None
        cells.append(NO_NUMBER if percent is None else format_rounded(percent, percent))
    return cells


def _make_expanded_row(model: ExportedModel, budget: Budget) -> list[str]:
    """Return the row with the expanded uncertainty of each stiffness in the budget, in the report's unit."""
    sizes = dict[str, float | None]()
    for joint, u in zip(model.result.joints, list_expanded_uncertainties(model), strict=True):
        sizes[joint.name] = None if u is None else _UNIT.factor * u.value
    cells = [format_rounded(sizes[name], sizes[name]) for name in budget.joints]
    return [f"expanded, of the stiffness [{_UNIT.label}]", "", *cells]


def _describe_correlation(budget: Budget) -> str:
    """Return a sentence with the greatest correlation between two joints; empty for a single joint."""
    pairs = [
        (budget.correlation[i][j], budget.joints[i], budget.joints[j])
        for i, j in combinations(range(len(budget.joints)), 2)
    ]
    if not pairs:
        return ""
    value, first, second = max(pairs, key=lambda pair: abs(pair[0]))
    return (
        f"Greatest correlation coefficient between two joints: {value:.2f} ({first} and {second}); all are "
        "in run.json."
    )


def build_method_section(model: ExportedModel, laboratory: Laboratory | None) -> Section:
    """Return the section with the method of the run and its deviations from the defaults."""
    request = model.run.request
    version = model.run.provenance.versions.get("jointstiff", "")
    method = f"{_describe_method(request)}; jointstiff {version}, as documented in docs/method.md."
    facts = [("Method", method)]
    if request.weight is not None:
        bodies = [f"{b.name} {b.mass:g} kg ({b.least:.4g} to {b.most:.4g})" for b in model.robot.bodies]
        facts.append(("Masses with their bounds", "; ".join(bodies)))
    tested_causes = format_tested_causes(model.result)
    if tested_causes:
        facts.append(("Causes tested, p-value", tested_causes))
    procedure = None if laboratory is None else laboratory.method
    facts.append(("Procedure of the laboratory", procedure or NOT_STATED))
    deviations = [f"Deviation: {text}" for text in _list_deviations(request)]
    return Section(METHOD, facts=facts, notes=deviations or ["Deviations: none."])


def _describe_method(request: RunRequest) -> str:
    """Return the method of a run, its weights and its constraint in words."""
    constraint = "compliances not negative" if request.positive else "without constraints"
    if request.weight is not None:
        return (
            "Identification of joint compliances, geometry and sag under the own weight from laser-tracker "
            f"positions of targets and masses within bounds, {constraint}"
        )
    weights = request.weighting.replace("_", " ")
    return (
        "Identification of joint compliances from readings of targets before and under load, "
        f"{METHOD_NAMES[request.method]}, {weights} weights, {constraint}"
    )


def _list_deviations(request: RunRequest) -> Iterator[str]:
    """Yield a sentence for each option of a run that differs from the default."""
    yield from _list_deviations_of_fit(request)
    if request.priors:
        yield f"prior knowledge of {', '.join(request.priors)} was used."
    if request.stiffness_bounds:
        yield f"stiffness of {', '.join(request.stiffness_bounds)} was bounded."
    if request.stiffness_order:
        chains = [" ≥ ".join(chain) for chain in request.stiffness_order]
        yield f"an order of stiffness was required: {'; '.join(chains)}."
    if request.elasticity not in {"automatic", "joints"}:
        yield f"elastic elements: {request.elasticity.replace('_', ' ')}."
    if request.complementary_stiffness == "neglected":
        yield "the complementary stiffness is neglected."


def _list_deviations_of_fit(request: RunRequest) -> Iterator[str]:
    """Yield a sentence for each option on readings, constraint, loss and causes that is not the default."""
    if request.leave_out:
        yield f"observations left out: {', '.join(request.leave_out)}."
    if not request.positive:
        yield "negative compliances were allowed."
    if request.loss not in {"automatic", "squared"}:
        yield f"loss {request.loss}: large residuals have less weight."
    if request.causes:
        causes = ", ".join(cause.name.replace("_", " ") for cause in request.causes)
        yield f"fitted with the joints, and taken out of the deflections: {causes}."


def _build_adjustment_section(model: ExportedModel) -> Section:
    """Return the section with the mean deflection, as measured and after compensation with the model."""
    return Section(
        ADJUSTMENT,
        facts=_list_mean_deflections(model.result),
        paragraphs=[
            "No adjustment or repair between the readings is stated: all results are as found. The mean "
            "deflection after compensation is computed from the same readings; it is not measured."
        ],
    )


def _list_mean_deflections(result: RunResult) -> list[tuple[str, str]]:
    """Return name and text of the mean deflection before and after compensation; nothing without readings."""
    if not result.residuals:
        return []
    measured_mm = 1e3 * fmean(float(np.linalg.norm(each.deflection)) for each in result.residuals)
    compensated_mm = 1e3 * fmean(float(np.linalg.norm(each.residual)) for each in result.residuals)
    after = "Mean deflection, after compensation by the model, computed"
    return [
        ("Mean deflection, before: as measured", f"{format_rounded(measured_mm)} mm"),
        (after, f"{format_rounded(compensated_mm)} mm"),
        ("Fraction that the model compensates", format_percent(result.compensation)),
    ]


def _build_traceability_section(readings: MeasurementSetDocument, laboratory: Laboratory | None) -> Section:
    """Return the section with conditions, instrument, traceability, loads and targets.

    Conditions of the readings replace the usual conditions of the laboratory.
    """
    known = laboratory or Laboratory(name=NOT_STATED)
    facts: list[Fact] = [
        ("Conditions", readings.conditions or known.conditions or NOT_STATED),
        ("Instrument", readings.instrument or NOT_STATED),
        ("Metrological traceability", known.traceability or NOT_STATED),
        ("Uncertainty of readings and load", " ".join(_describe_noise(readings))),
        ("Position loop closed by", f"{readings.encoders} encoders"),
        ("Observations", f"{len(readings.observations)}"),
        ("Force on the robot", describe_loads(readings)),
        ("Load point in the flange frame", describe_load_point(readings)),
        ("Targets read", _describe_targets(readings)),
    ]
    return Section(TRACEABILITY, facts=facts)


def describe_loads(readings: MeasurementSetDocument) -> str:
    """Return the least and the greatest force in words, such as "200 N to 1500 N, and moments"."""
    newtons = FORCE[readings.units.force]
    sizes = [newtons * float(np.linalg.norm(each.force)) for each in readings.observations]
    least, greatest = format_rounded(min(sizes)), format_rounded(max(sizes))
    forces = f"{greatest} N" if least == greatest else f"{least} N to {greatest} N"
    has_moments = any(any(each.moment or ()) for each in readings.observations)
    return f"{forces}, and moments" if has_moments else forces


def describe_load_point(readings: MeasurementSetDocument) -> str:
    """Return the point where the force acts, or how it was stated or read, in words."""
    if readings.load_point_target is not None:
        return f"read: target {readings.load_point_target} on the hook"
    has_own_points = any(each.load_point is not None for each in readings.observations)
    if not readings.load_point or has_own_points:
        return "stated with each observation"
    millimetres = 1e3 * LENGTH[readings.units.length]
    coordinates = [figure(millimetres * value) for value in readings.load_point]
    return f"({', '.join(coordinates)}) mm"


def _describe_targets(readings: MeasurementSetDocument) -> str:
    """Return number and names of the targets that were read, in the order of the readings."""
    read = [reading.target for each in readings.observations for reading in each.readings]
    targets = list(dict.fromkeys(read))
    shown = targets[:_TARGETS_NAMED]
    if len(targets) > _TARGETS_NAMED:
        shown.append("…")
    return f"{len(targets)}: {', '.join(shown)}"


def _describe_noise(readings: MeasurementSetDocument) -> Iterator[str]:
    """Yield sentences on the stated uncertainty of the readings, of the load, the targets and the axes."""
    noise, length = readings.noise, LENGTH[readings.units.length]
    yield from _describe_origin_of_noise(readings)
    if noise is not None:
        yield from _describe_stated_noise(noise, length)
        yield from _describe_shared_uncertainties(noise, 1e3 * length)
    has_load = any(any((*each.force, *(each.moment or ()))) for each in readings.observations)
    if has_load:
        yield from _describe_assumed_uncertainties(noise, length)


def _describe_origin_of_noise(readings: MeasurementSetDocument) -> Iterator[str]:
    """Yield where the uncertainty of readings comes from, unless one σ or an instrument for all is stated."""
    noise = readings.noise
    if noise is not None and noise.refuted:
        yield "estimated from the residuals, which refuted the noise as stated."
    elif noise is None or (noise.sigma is None and noise.instrument is None):
        own = _has_own_uncertainty(readings)
        yield "stated with each reading." if own else "estimated from the residuals."


def _has_own_uncertainty(readings: MeasurementSetDocument) -> bool:
    """Return whether a reading states its own uncertainty."""
    return any(
        reading.sigma is not None or reading.loaded_covariance is not None
        for observation in readings.observations
        for reading in observation.readings
    )


def _describe_stated_noise(noise: Noise, length: float) -> Iterator[str]:
    """Yield the stated σ, also if it is refuted, and the instrument; `length` is the unit of length in m."""
    if noise.sigma is not None:
        refuted = "Stated and refuted: " if noise.refuted else ""
        sigma = format_rounded(1e6 * length * noise.sigma)
        yield f"{refuted}σ = {sigma} µm of a coordinate of a reading."
    if noise.instrument is not None and not noise.refuted:
        yield "from the data sheet of the instrument."


def _describe_assumed_uncertainties(noise: Noise | None, length: float) -> Iterator[str]:
    """Yield sentences on uncertainties of the load that are assumed because they are not stated.

    `length` is the set's unit of length in m.
    """
    common = to_common_uncertainty(noise, length)
    if "force_scale" in common.assumed:
        yield f"Size of the force: no uncertainty is stated; ±{100 * ASSUMED_FORCE_SCALE:g} % is assumed."
    if noise is not None and noise.grounds is not None and noise.grounds.force is not None:
        yield from _describe_ground_of_force(noise.grounds, common)
    if "load_point" in common.assumed:
        missing = "no uncertainty" if common.doubtful_load_point is None else "no ground of its uncertainty"
        yield f"Load point: {missing} is stated; ±{1e3 * ASSUMED_LOAD_POINT:g} mm is assumed."
    elif noise is not None and noise.grounds is not None and noise.grounds.load_point is not None:
        millimetres = format_rounded(1e3 * common.load_point)
        yield f"Load point known by {noise.grounds.load_point}: {millimetres} mm a coordinate in the fit."


def _describe_ground_of_force(grounds: Grounds, common: CommonUncertainty) -> Iterator[str]:
    """Yield a sentence on what the force is known by, where the fit has its uncertainty by this ground.

    Args:
        grounds: grounds of the statements about the load.
        common: uncertainties in the fit.
    """
    percent = format_rounded(100 * common.scale)
    if grounds.force == "cell":
        yield f"Zero of the load cell: ±{format_rounded(common.rope_zero)} N along the rope in the fit."
    elif grounds.force == "pulley":
        less = format_rounded(100 * (1.0 - FORCE_BEYOND_PULLEY))
        yield f"Force beyond a pulley: the fit has {less} % less at the hook, ±{percent} %."
    elif grounds.force == "catalogue":
        yield f"Force known by catalogue: ±{percent} % in the fit."


def _describe_shared_uncertainties(noise: Noise, millimetres: float) -> Iterator[str]:
    """Yield sentences on stated uncertainties that all observations share: force, places, axes.

    `millimetres` is the number of mm in the set's unit of length.
    """
    if noise.force is not None:
        size = "" if noise.force.scale is None else f"relative {noise.force.scale:g}, "
        yield f"Force: {size}direction {format_rounded(1e3 * noise.force.direction)} mrad."
    for name, value in (("Load point", noise.load_point), ("Places of the targets", noise.target_places)):
        if value is not None:
            yield f"{name}: {format_rounded(millimetres * value)} mm a coordinate."
    if noise.drift is not None:
        micrometres = format_rounded(1e3 * millimetres * noise.drift)
        yield f"Drift: {micrometres} µm a coordinate from one observation to the next."
    if noise.axes is not None:
        yield (
            f"Axes of the robot's model: {format_rounded(millimetres * noise.axes.position)} mm across, "
            f"{format_rounded(1e3 * noise.axes.direction)} mrad."
        )


def build_assessment_section(result: RunResult) -> Section:
    """Return the section with the verdict on the run, its reasons, and the warnings."""
    reasons = result.assessment.reasons
    messages_of_reasons = {each.message for each in reasons}
    warnings = [each for each in result.warnings if each.message not in messages_of_reasons]
    lines = [f"{each.message} ({VERDICTS[each.weight]}; {each.remedy})" for each in (*reasons, *warnings)]
    notes = lines[:_MOST_WARNINGS]
    if not lines:
        notes.append(f"{describe_passed_checks(result.assessment).capitalize()}.")
    hidden = len(lines) - _MOST_WARNINGS
    if hidden > 0:
        notes.append(f"And {hidden} more, in run.json.")
    facts = [("Verdict on the result", VERDICTS[result.assessment.verdict])]
    return Section(ASSESSMENT, boxed=True, facts=facts, notes=[*notes, *result.assessment.notes])


def _build_origin_section(subject: RunSubject) -> Section:
    """Return the section with the origin of the numbers: run, input hash, versions, geometry, attachments."""
    run, geometry = subject.model.run, subject.model.geometry_id
    return Section(
        ORIGIN,
        facts=[
            ("Run", run.id),
            ("SHA-256 of the input", run.provenance.input_hash),
            ("Versions", list_versions(run)),
            ("Geometry", "as described" if geometry is None else f"as identified, geometry {geometry}"),
            (
                "Attached",
                "run.json (the run; a large one without its residuals), joints.csv (the joints as a table)",
            ),
        ],
    )
