"""The report of a run, from the run, its readings' metadata and the laboratory's settings."""

from __future__ import annotations

import hashlib
import json
from base64 import b64decode, b64encode
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from itertools import combinations
from statistics import fmean
from typing import Any, Final

import numpy as np

from jointstiff.schemas.measurement import MeasurementSetDocument, Noise, SetMetadata
from jointstiff.schemas.report import Laboratory, Party
from jointstiff.schemas.run import Budget, JointResult, RunRequest, RunResult
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH
from jointstiff.service.exporting.model import ExportedModel, joints_csv, why_no_stiffness
from jointstiff.service.reports.document import (
    NOT_STATED,
    Attachment,
    Document,
    Section,
    State,
    moment,
    percent,
)
from jointstiff.service.reports.laboratory import LaboratorySettings, Logo
from jointstiff.service.reports.pictures import arm, before_and_after, intervals
from jointstiff.service.tables.report import METHOD_NAMES, VERDICTS, requested, support
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.service.tables.table import NO_NUMBER, figure, rounded, text_table

NOT_ISO_9283: Final = (
    "The results are derived from the identified stiffness of the joints. They are not a test of static "
    "compliance after ISO 9283:1998, clause 10, and do not replace one."
)
STATEMENTS: Final = (
    "The results relate only to the item that is identified here, in the state and under the conditions of "
    "the measurement.",
    NOT_ISO_9283,
    "This report may be reproduced only in full, except with the laboratory's approval.",
    "No statement of conformity with a specification is made. The verdicts are opinions by the rules of the "
    "software, which are published with it; they say whether a number may be used, not whether the item is "
    "good.",
    "Sampling: none. All observations of the measurement set were used, except those named under deviations.",
    "Results from external providers: none, except the readings if the laboratory did not take them; the "
    "operator is named above.",
)

IDENTIFICATION: Final = "Identification"
REQUESTED: Final = "What was asked for"
RESULTS: Final = "Results"
UNCERTAINTY: Final = "Uncertainty budget"
METHOD: Final = "Method and deviations from it"
ADJUSTMENT: Final = "Before and after adjustment"
TRACEABILITY: Final = "Conditions and traceability"
ASSESSMENT: Final = "Assessment and warnings"
STATED: Final = "Statements"
ORIGIN: Final = "Origin of the numbers"
ITEMS_HEADING: Final = "Items of ISO/IEC 17025:2017 and their places in this report"

ITEMS: Final = (
    ("7.8.2.1 a", "title", "above"),
    ("7.8.2.1 b", "name and address of the laboratory", "letterhead"),
    ("7.8.2.1 c", "location of the activities", IDENTIFICATION),
    ("7.8.2.1 d", "unique identification on each page, end mark", "head and foot of each page, end"),
    ("7.8.2.1 e", "customer", IDENTIFICATION),
    ("7.8.2.1 f", "method", METHOD),
    ("7.8.2.1 g", "item: description, identification, condition", IDENTIFICATION),
    ("7.8.2.1 h", "date of receipt", IDENTIFICATION),
    ("7.8.2.1 i", "dates of the activities", IDENTIFICATION),
    ("7.8.2.1 j", "date of issue", IDENTIFICATION),
    ("7.8.2.1 k", "sampling", STATED),
    ("7.8.2.1 l", "results relate only to the item", STATED),
    ("7.8.2.1 m", "results with units", RESULTS),
    ("7.8.2.1 n", "additions to, deviations and exclusions from the method", METHOD),
    ("7.8.2.1 o", "who authorised the report", IDENTIFICATION),
    ("7.8.2.1 p", "results from external providers", STATED),
    ("7.8.4.1 a", "measurement uncertainty", f"{RESULTS}, {UNCERTAINTY}"),
    ("7.8.4.1 b", "conditions that influence the results", TRACEABILITY),
    ("7.8.4.1 c", "metrological traceability", TRACEABILITY),
    ("7.8.4.1 d", "results before and after adjustment or repair", ADJUSTMENT),
    ("7.8.4.1 e", "statement of conformity", f"{STATED}: none"),
    ("7.8.4.1 f", "opinions and interpretations", ASSESSMENT),
)
"""Item, what it asks for, and the section that answers it."""


MAX_ATTACHED_BYTES: Final = 2_500_000
"""JSON of a run that is attached whole; it takes a quarter of that in the PDF."""
TITLE: Final = "Report on joint stiffness"
_BY_OBSERVATION: Final = ("residuals", "contributions", "encoder_residuals")


@dataclass(frozen=True, eq=False)
class RunSubject:
    """A run to report on."""

    model: ExportedModel  # the run with its robot
    readings: MeasurementSetDocument  # the measurement set; of its observations only the postures are drawn
    settings: LaboratorySettings  # settings of the laboratory
    received_on: date | None = None  # when the item was received
    alarms: Sequence[str] = ()  # alarms of the robot, that nobody has acknowledged

    def run_json(self) -> bytes:
        """Return the run as it is attached: a large one without what it says of each observation."""
        run = self.model.run
        whole = run.model_dump_json().encode()
        if len(whole) <= MAX_ATTACHED_BYTES or run.result is None:
            return whole
        less = run.result.model_copy(update={name: [] for name in _BY_OBSERVATION})
        return run.model_copy(update={"result": less}).model_dump_json().encode()

    def stated(self) -> dict[str, Any]:
        """Return what a report states beside the run, which never changes."""
        laboratory, logo = self.settings.laboratory, self.settings.logo
        fields = set(SetMetadata.model_fields)
        return {
            "run": [self.model.run.id, self.model.run.provenance.input_hash],
            "robot": self.model.name,
            "set": self.readings.name,
            "metadata": self.readings.model_dump(mode="json", include=fields, exclude_none=True),
            "laboratory": None
            if laboratory is None
            else laboratory.model_dump(mode="json", exclude_defaults=True),
            "logo": None if logo is None else [logo.kind, b64encode(logo.content).decode()],
            "received_on": None if self.received_on is None else self.received_on.isoformat(),
            "alarms": list(self.alarms),
        }

    def content_hash(self) -> str:
        """Return the SHA-256 of what a report states."""
        return hashlib.sha256(json.dumps(self.stated(), sort_keys=True).encode()).hexdigest()

    def as_stated(self, stated: Mapping[str, Any]) -> RunSubject:
        """Return the run as an authorised report stated it, whatever was changed since."""
        noted = SetMetadata.model_validate(stated["metadata"])
        changes = {name: getattr(noted, name) for name in SetMetadata.model_fields}
        laboratory, logo = stated["laboratory"], stated["logo"]
        received_on = stated["received_on"]
        return RunSubject(
            replace(self.model, name=stated["robot"]),
            self.readings.model_copy(update={**changes, "name": stated["set"]}),
            LaboratorySettings(
                None if laboratory is None else Laboratory.model_validate(laboratory),
                None if logo is None else Logo(b64decode(logo[1]), logo[0]),
            ),
            None if received_on is None else date.fromisoformat(received_on),
            stated["alarms"],
        )


def run_document(subject: RunSubject, state: State) -> Document:
    """Return the report of a run. The same run, metadata, settings and state give the same document."""
    run = subject.model.run
    return Document(
        title=TITLE,
        number=f"{run.id}-{state.number}",
        state=state,
        letterhead=subject.settings.letterhead(),
        dated=state.issued_at or run.provenance.ended_at or run.provenance.created_at,
        sections=[
            _identification(subject, state),
            results(subject.model, subject.readings),
            uncertainty(subject.model),
            method(subject.model, subject.settings.laboratory),
            Section(REQUESTED, facts=requested(run.request)),
            adjustment(subject.model),
            traceability(subject.readings, subject.settings.laboratory),
            assessment(subject.model.result, subject.alarms),
            Section(STATED, paragraphs=list(STATEMENTS)),
            _origin(subject),
            Section(
                ITEMS_HEADING,
                tables=[
                    text_table(
                        ["item", "asks for", "stands in"],
                        [list(item) for item in ITEMS],
                        texts=[0, 1, 2],
                    )
                ],
            ),
        ],
        attachments=[
            Attachment(
                "run.json",
                "application/json",
                "The run; a large one without its residuals",
                subject.run_json(),
            ),
            Attachment("joints.csv", "text/csv", "The joints as a table", joints_csv(subject.model)),
        ],
    )


def _identification(subject: RunSubject, state: State) -> Section:
    readings, run, laboratory = subject.readings, subject.model.run, subject.settings.laboratory
    place = None
    if laboratory is not None:
        place = laboratory.place or ", ".join(laboratory.address)
    robot = subject.model.robot
    return Section(
        IDENTIFICATION,
        facts=[
            ("Report", f"{run.id}-{state.number}"),
            ("State", f"{state.kind}: {state.line}"),
            ("Customer", _party(None if laboratory is None else laboratory.customer)),
            ("Location of the measurement", place or NOT_STATED),
            (
                "Item",
                f"Industrial robot {subject.model.name}, {robot.n} joints: {', '.join(robot.joint_names)}",
            ),
            ("Serial number", readings.serial_number or NOT_STATED),
            ("Condition of the item", readings.item_condition or NOT_STATED),
            (
                "Date of receipt",
                NOT_STATED if subject.received_on is None else subject.received_on.isoformat(),
            ),
            ("Measured", moment(readings.measured_at)),
            ("Computed", moment(run.provenance.ended_at)),
            ("Date of issue", moment(state.issued_at) if state.issued_at else "not issued: draft"),
            ("Measurement set", readings.name),
            ("Operator", readings.operator or NOT_STATED),
            ("Authorised by", state.by or "nobody"),
            *([("Notes on the measurement", readings.notes)] if readings.notes else []),
        ],
    )


def _party(party: Party | None) -> str:
    if party is None:
        return NOT_STATED
    return ", ".join([party.name, *party.address, *([party.contact] if party.contact else [])])


def _origin(subject: RunSubject) -> Section:
    provenance = subject.model.run.provenance
    versions = ", ".join(f"{name} {version}" for name, version in sorted(provenance.versions.items()))
    geometry = subject.model.geometry_id
    return Section(
        ORIGIN,
        facts=[
            ("Run", subject.model.run.id),
            ("SHA-256 of the input", provenance.input_hash),
            ("SHA-256 of what is stated", subject.content_hash()),
            ("Versions", versions),
            ("Geometry", "as described" if geometry is None else f"as identified, geometry {geometry}"),
            (
                "Attached",
                "run.json (the run; a large one without its residuals), joints.csv (the joints as a table)",
            ),
        ],
    )


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
        RESULTS,
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
            UNCERTAINTY,
            paragraphs=["Shares of each interval's width, by the readings and by the bounds of the masses."],
            tables=[text_table(["joint", "readings", "uncertain masses"], cells, texts=[0])],
        )
    if budget is None:
        return Section(
            UNCERTAINTY,
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
        UNCERTAINTY,
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
        ASSESSMENT,
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


_TARGETS_NAMED: Final = 8


def method(model: ExportedModel, laboratory: Laboratory | None) -> Section:
    """Return the method, and what was done otherwise than by default."""
    request, version = model.run.request, model.run.provenance.versions.get("jointstiff", "")
    constraint = "compliances not negative" if request.positive else "without constraints"
    stated = None if laboratory is None else laboratory.method
    way = (
        "Identification of joint compliances from readings of targets before and under load, "
        f"{METHOD_NAMES[request.method]}, {request.weighting.replace('_', ' ')} weights, {constraint}"
    )
    masses = []
    if request.weight is not None:
        way = (
            "Identification of joint compliances, geometry and sag under the own weight from laser-tracker "
            f"positions of targets and masses within bounds, {constraint}"
        )
        bodies = [
            f"{body.name} {body.mass:g} kg ({body.least:.4g} to {body.most:.4g})"
            for body in model.robot.bodies
        ]
        masses = [("Masses with their bounds", "; ".join(bodies))]
    return Section(
        METHOD,
        facts=[
            (
                "Method",
                f"{way}; jointstiff {version}, as its documentation states (docs/method.md).",
            ),
            *masses,
            ("Procedure of the laboratory", stated or NOT_STATED),
        ],
        notes=[f"Deviation: {line}" for line in _deviations(request)] or ["Deviations: none."],
    )


def _deviations(request: RunRequest) -> Iterator[str]:
    """Yield options that differ from the defaults, in words."""
    chains = "; ".join(" ≥ ".join(chain) for chain in request.stiffness_order)
    sentences = (
        (request.leave_out, f"observations left out: {', '.join(request.leave_out)}."),
        (not request.positive, "negative compliances were allowed."),
        (request.loss not in {"automatic", "squared"}, f"loss {request.loss}: large residuals count less."),
        (request.priors, f"prior knowledge of {', '.join(request.priors)} was used."),
        (request.stiffness_bounds, f"stiffness of {', '.join(request.stiffness_bounds)} was bounded."),
        (request.stiffness_order, f"an order of stiffness was required: {chains}."),
        (
            request.elasticity not in {"automatic", "joints"},
            f"elastic elements: {request.elasticity.replace('_', ' ')}.",
        ),
        (request.complementary_stiffness == "neglected", "the complementary stiffness is neglected."),
    )
    yield from (text for differs, text in sentences if differs)


def adjustment(model: ExportedModel) -> Section:
    """Return deflections as found, and as the model would leave them."""
    residuals = model.result.residuals
    facts = []
    if residuals:
        before = 1e3 * fmean(float(np.linalg.norm(each.deflection)) for each in residuals)
        after = 1e3 * fmean(float(np.linalg.norm(each.residual)) for each in residuals)
        facts = [
            ("Mean deflection, before: as measured", f"{rounded(before)} mm"),
            ("Mean deflection, after compensation by the model, computed", f"{rounded(after)} mm"),
            ("Share that the model compensates", percent(model.result.compensation)),
        ]
    return Section(
        ADJUSTMENT,
        facts=facts,
        paragraphs=[
            "No adjustment or repair between the readings is stated: all results are as found. The second "
            "number is computed from the same readings and is no measurement."
        ],
    )


def traceability(readings: MeasurementSetDocument, laboratory: Laboratory | None) -> Section:
    """Return conditions, instrument and what its uncertainty rests on."""
    conditions = readings.conditions or (None if laboratory is None else laboratory.conditions)
    chain = None if laboratory is None else laboratory.traceability
    return Section(
        TRACEABILITY,
        facts=[
            ("Conditions", conditions or NOT_STATED),
            ("Instrument", readings.instrument or NOT_STATED),
            ("Metrological traceability", chain or NOT_STATED),
            ("Uncertainty of readings and load", " ".join(_noise(readings))),
            ("Position loop closed by", f"{readings.encoders} encoders"),
            ("Observations", f"{len(readings.observations)}"),
            ("Force on the robot", _force(readings)),
            ("Load point in the flange frame", _load_point(readings)),
            ("Targets read", _targets(readings)),
        ],
    )


def _force(readings: MeasurementSetDocument) -> str:
    """Return the least and the greatest magnitude of the force over the observations."""
    newtons = FORCE[readings.units.force]
    sizes = [newtons * float(np.linalg.norm(each.force)) for each in readings.observations]
    least, greatest = rounded(min(sizes)), rounded(max(sizes))
    size = f"{greatest} N" if least == greatest else f"{least} N to {greatest} N"
    moments = any(each.moment is not None and any(each.moment) for each in readings.observations)
    return f"{size}, and moments" if moments else size


def _load_point(readings: MeasurementSetDocument) -> str:
    if readings.load_point is None or any(each.load_point is not None for each in readings.observations):
        return "stated with each observation"
    millimetres = 1e3 * LENGTH[readings.units.length]
    return f"({', '.join(f'{figure(millimetres * value)}' for value in readings.load_point)}) mm"


def _targets(readings: MeasurementSetDocument) -> str:
    names = list(dict.fromkeys(each.target for one in readings.observations for each in one.readings))
    shown = ", ".join(names[:_TARGETS_NAMED])
    return f"{len(names)}: {shown}{', …' if len(names) > _TARGETS_NAMED else ''}"


def _noise(readings: MeasurementSetDocument) -> Iterator[str]:
    noise, length = readings.noise, LENGTH[readings.units.length]
    if noise is not None and noise.refuted:
        yield "estimated from the residuals, which refuted the noise as stated."
    elif noise is None or (noise.sigma is None and noise.instrument is None):
        by_reading = any(
            reading.sigma is not None or reading.loaded_covariance is not None
            for observation in readings.observations
            for reading in observation.readings
        )
        yield "stated with each reading." if by_reading else "estimated from the residuals."
    if noise is not None:
        if noise.sigma is not None:
            refuted = "Stated and refuted: " if noise.refuted else ""
            yield f"{refuted}σ = {rounded(1e6 * length * noise.sigma)} µm of a coordinate of a reading."
        if noise.instrument is not None and not noise.refuted:
            yield "from the data sheet of the instrument."
        yield from _common(noise, 1e3 * length)
    if noise is None or noise.force is None:
        yield "Force: no uncertainty stated, counted as exact."


def _common(noise: Noise, millimetres: float) -> Iterator[str]:
    """Yield what all observations share, with lengths in mm for those of the set."""
    if noise.force is not None:
        yield f"Force: relative {noise.force.scale:g}, direction {rounded(1e3 * noise.force.direction)} mrad."
    for name, value in (("Load point", noise.load_point), ("Places of the targets", noise.target_places)):
        if value is not None:
            yield f"{name}: {rounded(millimetres * value)} mm a coordinate."
    if noise.axes is not None:
        yield (
            f"Axes of the robot's model: {rounded(millimetres * noise.axes.position)} mm across, "
            f"{rounded(1e3 * noise.axes.direction)} mrad."
        )
