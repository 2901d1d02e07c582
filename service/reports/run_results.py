"""Sections of a run's report: results, uncertainty budget, assessment."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from jointstiff.schemas.measurement.measurement_set import MeasurementSetDocument
from jointstiff.schemas.run.budget import Budget
from jointstiff.schemas.run.joints import JointResult
from jointstiff.schemas.run.run import RunResult
from jointstiff.service.conversion.units import ANGLE
from jointstiff.service.exporting.model import ExportedModel, why_no_stiffness
from jointstiff.service.reports import statements
from jointstiff.service.reports.document import Section
from jointstiff.service.reports.pictures import arm, before_and_after, intervals
from jointstiff.service.reports.wording import percent
from jointstiff.service.tables.numbers import NO_NUMBER, figure, rounded
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.service.tables.table import text_table
from jointstiff.service.tables.verdict import VERDICTS, support

_UNIT = UNITS["MNm/rad"]
_MICRO = 1e6
_USUAL = 0.95
"""Coverage probability of k = 2, nearly."""
_MOST_WARNINGS = 12
_MISSING = {
    "model_error": "there is no bound of the model error",
    "lack_of_fit": "the assessment names a lack of fit: U does not include the bending of links",
}


def results(model: ExportedModel, readings: MeasurementSetDocument) -> Section:
    """Return stiffness, uncertainty and interval of each joint, with pictures."""
    result, confidence = model.result, model.run.request.confidence
    factor = (
        ""
        if result.budget is None
        else f", k = {figure(_factor(result.budget))}{', partial' * bool(result.budget.missing)}"
    )
    table = text_table(
        [
            "joint",
            f"stiffness [{_UNIT.label}]",
            f"standard uncertainty [{_UNIT.label}]",
            f"expanded uncertainty [{_UNIT.label}]{factor}",
            f"{100 * confidence:g} % interval [{_UNIT.label}]",
            "verdict",
        ],
        [_joint_row(joint, result.budget) for joint in result.joints],
        texts=[0, 5],
    )
    missing = [
        f"{joint.name}: no number: {why_no_stiffness(joint)}."
        for joint in result.joints
        if joint.stiffness is None
    ]
    first = readings.observations[0].joints
    factor_to_rad = ANGLE[readings.units.angle]
    pictures = [
        intervals(result.joints, confidence),
        before_and_after(result),
        arm(model.robot, [factor_to_rad * angle for angle in first]),
    ]
    return Section(
        statements.RESULTS,
        tables=[table],
        notes=missing,
        facts=[
            ("Share of the mean deflection that the model explains", percent(result.compensation)),
            ("Root mean square of the residuals' lengths", f"{rounded(_MICRO * result.rms_residual)} µm"),
            (
                "Standard uncertainty of a coordinate of a reading",
                NO_NUMBER
                if result.sigma is None
                else f"{rounded(_MICRO * result.sigma)} µm ({result.goodness.sigma_source})",
            ),
        ],
        pictures=[picture for picture in pictures if picture is not None],
    )


def _joint_row(joint: JointResult, budget: Budget | None) -> list[str]:
    value, uncertainty, interval = _UNIT.cells(joint)
    expanded = NO_NUMBER
    if budget is not None and joint.name in budget.joints and joint.stiffness is not None:
        of_compliance = _combined(budget)[budget.joints.index(joint.name)]
        combined = _UNIT.factor * of_compliance * joint.stiffness**2
        uncertainty, expanded = (rounded(size, size) for size in (combined, _factor(budget) * combined))
    verdict = VERDICTS[joint.verdict] if joint.status == "identified" else joint.status.replace("_", " ")
    return [joint.name, value, uncertainty, expanded, interval, verdict]


def _combined(budget: Budget) -> list[float]:
    """Return the standard uncertainty of each compliance by all sources that the budget names."""
    return [each / budget.coverage_factor for each in budget.expanded_with_model_error]


def _factor(budget: Budget) -> float:
    """Return the coverage factor: 2 where a normal distribution has about 95 %, as EA-4/02 states it."""
    if budget.probability == _USUAL and budget.coverage_factor <= 2.0:
        return 2.0
    return budget.coverage_factor


def uncertainty(model: ExportedModel) -> Section:
    """Return the budget of the compliances, in the words of the GUM."""
    budget, weight = model.result.budget, model.result.weight
    if weight is not None:
        shares = [(each.joint, each.readings, each.masses) for each in weight.joints]
        cells = [
            [name, *(NO_NUMBER if part is None else f"{100 * part:.0f} %" for part in parts)]
            for name, *parts in shares
        ]
        return Section(
            statements.UNCERTAINTY,
            paragraphs=["Shares of each interval's width, by the readings and by the bounds of the masses."],
            tables=[text_table(["joint", "readings", "uncertain masses"], cells, texts=[0])],
        )
    if budget is None:
        return Section(
            statements.UNCERTAINTY,
            paragraphs=[
                "The run has no budget: it was made without one, or links or a coupling of "
                "joints bend. The intervals in the results include what is known."
            ],
        )
    sizes = {joint.name: abs(joint.compliance or 0.0) for joint in model.result.joints}

    def row(source: str, kind: str, values: list[float]) -> list[str]:
        pairs = zip(budget.joints, values, strict=True)
        shares = [100.0 * u / sizes[name] if sizes[name] else None for name, u in pairs]
        return [source, kind, *(NO_NUMBER if each is None else rounded(each, each) for each in shares)]

    head = ["source", "type", *budget.joints]
    rows = [
        row(
            f"{each.source.replace('_', ' ')}{'' if each.included else ' (not included)'}",
            each.evaluation,
            each.contributions,
        )
        for each in budget.components
    ]
    factor, combined = _factor(budget), _combined(budget)
    rows += [
        row("combined, sources in the intervals", "", budget.standard_uncertainty),
        row("combined, all sources", "", combined),
        row(f"expanded, all sources, k = {figure(factor)}", "", [factor * each for each in combined]),
    ]
    missing = "".join(f"It is partial: {_MISSING[each]}. " for each in budget.missing)
    caption = "Contributions to the standard uncertainty of each compliance [% of it]"
    return Section(
        statements.UNCERTAINTY,
        tables=[text_table(head, rows, caption)],
        paragraphs=[
            "The reported expanded uncertainty U is stated as the standard uncertainty of measurement, by "
            f"all sources of this budget, multiplied by the coverage factor k = {figure(factor)}, which "
            f"corresponds to a coverage probability of approximately {percent(budget.probability)} "
            "(JCGM 100:2008, EA-4/02). The relative uncertainty of a stiffness is that of its compliance. "
            f"{missing}{_correlation(budget)}",
            "The interval of a joint differs from y ± U: it has all stiffnesses that the likelihood of the "
            "readings does not exclude, can be asymmetric, and omits the sources that are not included "
            "above.",
        ],
    )


def _correlation(budget: Budget) -> str:
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


def assessment(result: RunResult, alarms: Sequence[str]) -> Section:
    """Return the verdict with its reasons, the alarms of the robot, and the warnings."""
    reasons = result.assessment.reasons
    known = {each.message for each in reasons}
    further = [each for each in result.warnings if each.message not in known]
    lines = [f"{each.message} ({VERDICTS[each.weight]}; {each.remedy})" for each in (*reasons, *further)]
    more = len(lines) - _MOST_WARNINGS
    return Section(
        statements.ASSESSMENT,
        facts=[
            ("Verdict on the result", VERDICTS[result.assessment.verdict]),
            *([("The robot is in alarm", "\n".join(alarms))] if alarms else []),
        ],
        notes=[
            *(lines[:_MOST_WARNINGS] or [f"{support(result.assessment).capitalize()}."]),
            *([f"And {more} more, in run.json."] if more > 0 else []),
            *result.assessment.notes,
        ],
    )
