"""The report of a run as a digital calibration certificate: XML after the DCC schema 3.3.0 of PTB.

Quantities are written as the D-SI schema defines them, in SI units. The schemas (LGPL) are not part of this
package; a test validates a certificate against the file that the variable `DCC_XSD` names.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, date, timedelta
from math import hypot, isfinite
from typing import Final, NamedTuple
from xml.etree import ElementTree

from jointstiff.schemas.deflection import CaseResult, DeflectionBudget
from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.schemas.report import Laboratory, Party
from jointstiff.schemas.run import JointResult
from jointstiff.service.reports import run as report
from jointstiff.service.reports.document import NOT_STATED, list_versions
from jointstiff.service.reports.exports import explain_missing_stiffness
from jointstiff.service.tables.report import VERDICTS
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.stages import student_quantile

Element = ElementTree.Element
VERSION: Final = "3.3.0"
NAMESPACES: Final = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
_SCHEMA: Final = "{http://www.w3.org/2001/XMLSchema-instance}schemaLocation"
_LANGUAGE: Final = "en"
"""Language of all texts that this program writes; texts of the user may be in any language."""
_BEHIND_UTC: Final = timedelta(hours=12)
"""Time by which the westernmost time zone is behind UTC."""
_UNITS: Final = {
    "revolute": r"\newton\metre\radian\tothe{-1}",
    "prismatic": r"\newton\metre\tothe{-1}",
    "compliance": r"\metre\newton\tothe{-1}",
}


def build_certificate(subject: report.RunSubject) -> bytes:
    """Return the digital calibration certificate of a run as XML.

    Raises:
        RequestError: a field that every certificate requires is missing.
    """
    laboratory = _require_laboratory(subject)
    period = _find_period(subject.readings, laboratory)
    for prefix, address in NAMESPACES.items():
        ElementTree.register_namespace(prefix, address)
    root = Element(_qualified_name("dcc:digitalCalibrationCertificate"), schemaVersion=VERSION)
    root.set(_SCHEMA, f"{NAMESPACES['dcc']} {NAMESPACES['dcc']}/v{VERSION}/dcc.xsd")
    administrative = _append(root, "dcc:administrativeData")
    _write_software(_append(administrative, "dcc:dccSoftware", "dcc:software"), subject)
    _write_core_data(_append(administrative, "dcc:coreData"), subject, laboratory, period)
    _write_item(_append(administrative, "dcc:items", "dcc:item"), subject)
    _write_contact(_append(administrative, "dcc:calibrationLaboratory", "dcc:contact"), laboratory)
    _write_signer(_append(administrative, "dcc:respPersons", "dcc:respPerson"), laboratory)
    _write_customer(_append(administrative, "dcc:customer"), laboratory.customer)
    _write_statements(_append(administrative, "dcc:statements"), subject, laboratory)
    _write_results(_append(root, "dcc:measurementResults", "dcc:measurementResult"), subject, laboratory)
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content


def _write_software(software: Element, subject: report.RunSubject) -> None:
    """Write name and version of the program that made the run."""
    _append_text(software, "dcc:name", "Jointstiff")
    versions = subject.model.run.provenance.versions
    _append(software, "dcc:release").text = versions.get("jointstiff", NOT_STATED)


def _write_signer(person: Element, laboratory: Laboratory) -> None:
    """Write the responsible person of the laboratory, who signs the certificate."""
    _append_text(_append(person, "dcc:person"), "dcc:name", str(laboratory.responsible), None)
    _append(person, "dcc:mainSigner").text = "true"


def _write_customer(customer: Element, party: Party | None) -> None:
    """Write name and address of the customer, or that they are not stated, as the schema requires both."""
    if party is not None:
        _write_contact(customer, party)
        return
    _append_text(customer, "dcc:name", NOT_STATED)
    _append_text(_append(customer, "dcc:location"), "dcc:further", NOT_STATED)


def _write_statements(statements: Element, subject: report.RunSubject, laboratory: Laboratory) -> None:
    """Write the verdict, the traceability of the readings, and the statements of every certificate."""
    verdict = VERDICTS[subject.model.result.assessment.verdict]
    # The laboratory may have written its statement in any language.
    language = None if laboratory.traceability else _LANGUAGE
    lines = [
        (f"Verdict on the result: {verdict}.", _LANGUAGE),
        (f"Metrological traceability: {laboratory.traceability or NOT_STATED}", language),
        *[(statement, _LANGUAGE) for statement in report.STATEMENTS],
    ]
    for line, language_of_line in lines:
        _append_text(_append(statements, "dcc:statement"), "dcc:declaration", line, language_of_line)


class _Period(NamedTuple):
    """First and last day of a measurement."""

    begin: date
    end: date


def _require_laboratory(subject: report.RunSubject) -> Laboratory:
    """Return the laboratory of a report, which states its country and the responsible person.

    Raises:
        RequestError: no laboratory, country or responsible person is stated.
    """
    laboratory = subject.settings.laboratory
    if laboratory is None or laboratory.country is None or laboratory.responsible is None:
        reason = "a certificate requires the country of the measurement and the responsible person"
        remedy = "give `country` and `responsible` in the settings of the laboratory"
        raise RequestError(reason, where="laboratory", remedy=remedy)
    return laboratory


def _find_period(readings: MeasurementSetDocument, laboratory: Laboratory) -> _Period:
    """Return the days of a measurement from its first moment, `measured_at`, and its last day, `ended_on`.

    `measured_at` is a time in UTC, but `ended_on` is a day of the local calendar, which west of Greenwich may
    be one day earlier: 02:00 UTC on 21 November is still 20 November there. So the period begins on the UTC
    day, but not after `ended_on`. Without `ended_on` the period is one day.

    Raises:
        RequestError: the time is missing, or the end comes before the beginning in every time zone.
    """
    if readings.measured_at is None:
        reason = "a certificate requires the time of the measurement"
        remedy = "give a time, such as 2026-11-20T14:30:00+01:00"
        raise RequestError(reason, where="measurement_set.measured_at", remedy=remedy)
    began = readings.measured_at.astimezone(UTC)
    end = laboratory.ended_on or began.date()
    earliest_local_day = (began - _BEHIND_UTC).date()
    if end < earliest_local_day:
        reason = f"the measurement ended on {end}, before it began on {began.date()} (UTC)"
        raise RequestError(reason, where="laboratory.ended_on", remedy="correct one of the two dates")
    return _Period(min(began.date(), end), end)


def _write_core_data(
    core: Element, subject: report.RunSubject, laboratory: Laboratory, period: _Period
) -> None:
    """Write country, languages, identifier, first and last day, and place of the calibration."""
    _append(core, "dcc:countryCodeISO3166_1").text = laboratory.country
    for code in dict.fromkeys([_LANGUAGE, *laboratory.languages]):
        _append(core, "dcc:usedLangCodeISO639_1").text = code
    _append(core, "dcc:mandatoryLangCodeISO639_1").text = _LANGUAGE
    _append(core, "dcc:uniqueIdentifier").text = subject.model.run.id
    _append(core, "dcc:beginPerformanceDate").text = period.begin.isoformat()
    _append(core, "dcc:endPerformanceDate").text = period.end.isoformat()
    _append(core, "dcc:performanceLocation").text = laboratory.kind_of_place


def _write_item(item: Element, subject: report.RunSubject) -> None:
    """Write the robot as the calibrated item, identified by its serial number.

    Without a serial number, the name of the measurement set identifies the robot.
    """
    readings, robot = subject.readings, subject.model.robot
    _append_text(item, "dcc:name", f"Industrial robot {subject.model.name}, {robot.n} joints")
    _append_text(_append(item, "dcc:manufacturer"), "dcc:name", NOT_STATED)
    identification = _append(item, "dcc:identifications", "dcc:identification")
    serial = readings.serial_number
    _append(identification, "dcc:issuer").text = "manufacturer" if serial else "calibrationLaboratory"
    _append(identification, "dcc:value").text = serial or readings.name
    _append_text(identification, "dcc:name", "Serial number" if serial else "Measurement set")


def _write_contact(contact: Element, party: Party) -> None:
    """Write name, address and contact of a laboratory or a customer."""
    _append_text(contact, "dcc:name", party.name, None)
    lines = [*party.address, *([party.contact] if party.contact else [])]
    language = None if lines else _LANGUAGE
    _append_text(_append(contact, "dcc:location"), "dcc:further", ", ".join(lines) or NOT_STATED, language)


def _write_results(result_set: Element, subject: report.RunSubject, laboratory: Laboratory) -> None:
    """Write method, conditions, the stiffness of each joint, and the predicted compliance of the flange."""
    model = subject.model
    _append_text(result_set, "dcc:name", report.TITLE)
    _write_method(_append(result_set, "dcc:usedMethods", "dcc:usedMethod"), subject, laboratory)
    software = _append(result_set, "dcc:usedSoftware", "dcc:software")
    _append_text(software, "dcc:name", "Jointstiff")
    _append(software, "dcc:release").text = list_versions(model.run)
    _write_instrument_and_conditions(result_set, subject.readings, laboratory)
    results = _append(result_set, "dcc:results")
    level = model.run.request.confidence
    for joint, u in zip(model.result.joints, report.list_expanded_uncertainties(model), strict=True):
        _write_joint(_append(results, "dcc:result"), joint, u, level)
    cases = [case for case in report.predict_flange_compliance(subject) if case.displacement is not None]
    if cases:
        _write_predictions(_append(results, "dcc:result"), subject, cases)


def _write_method(method: Element, subject: report.RunSubject, laboratory: Laboratory) -> None:
    """Write the method of the identification with its stated facts and notes."""
    _append_text(method, "dcc:name", "Identification of joint stiffness from readings of targets")
    section = report.build_method_section(subject.model, laboratory)
    stated_facts = [f"{label}: {text}" for label, text in section.facts if text != NOT_STATED]
    # The laboratory may have described its method in any language.
    language = None if laboratory.method else _LANGUAGE
    _append_text(method, "dcc:description", "; ".join([*stated_facts, *section.notes]), language)


def _write_instrument_and_conditions(
    result_set: Element, readings: MeasurementSetDocument, laboratory: Laboratory
) -> None:
    """Write the instrument and the conditions of the measurement, if they are stated."""
    if readings.instrument:
        equipment = _append(result_set, "dcc:measuringEquipments", "dcc:measuringEquipment")
        _append_text(equipment, "dcc:name", readings.instrument, None)
    conditions = readings.conditions or laboratory.conditions
    if conditions:
        influence = _append(result_set, "dcc:influenceConditions", "dcc:influenceCondition")
        _append_text(influence, "dcc:name", "Conditions of the measurement")
        _append_text(_append(influence, "dcc:data"), "dcc:text", conditions, None)


def _write_predictions(result: Element, subject: report.RunSubject, cases: Sequence[CaseResult]) -> None:
    """Write the predicted displacements of the flange per force along X, Y and Z, with their uncertainties.

    Each of `cases` has a displacement, under 100 N along one axis of R0.
    """
    _append_text(result, "dcc:name", report.PREDICTED)
    description = report.describe_prediction(subject)
    if any(case.budget is None for case in cases):
        description += " No uncertainty of these predictions is stated."
    _append_text(result, "dcc:description", description)
    data = _append(result, "dcc:data")
    level = subject.model.run.request.confidence
    for case in cases:
        _write_displacement(data, case)
        if case.budget is not None:
            _write_length_of_displacement(data, case, case.budget, level)


def _write_displacement(data: Element, case: CaseResult) -> None:
    """Write the components of a predicted displacement per force [m/N], along X, Y and Z of R0."""
    for axis, displacement in zip("XYZ", case.displacement or (), strict=True):
        name = f"Predicted displacement along {axis} per force along {case.label}"
        _write_quantity(data, name, displacement / report.PREDICTED_FORCE, "compliance")


def _write_length_of_displacement(
    data: Element, case: CaseResult, budget: DeflectionBudget, level: float
) -> None:
    """Write the length of a predicted displacement per force [m/N] with its expanded uncertainty."""
    name = f"Length of the predicted displacement per force along {case.label}"
    length = hypot(*case.displacement or ()) / report.PREDICTED_FORCE
    expanded = budget.expanded_with_model_error / report.PREDICTED_FORCE
    u = report.ExpandedUncertainty(expanded, budget.coverage_factor, level)
    _write_quantity(data, name, length, "compliance", u)


def _write_joint(
    result: Element, joint: JointResult, u: report.ExpandedUncertainty | None, level: float
) -> None:
    """Write the stiffness of a joint with its interval and uncertainty, or why it has no stiffness.

    `u` is the uncertainty of the stiffness from the budget. If it is None, the uncertainty comes from the
    interval, whose probability is `level`.
    """
    _append_text(result, "dcc:name", f"Stiffness of {joint.name}")
    if joint.stiffness is None:
        quantity = _append(result, "dcc:data", "dcc:quantity")
        _append_text(quantity, "dcc:noQuantity", f"No number: {explain_missing_stiffness(joint)}.")
        return
    if u is None:
        u = _uncertainty_from_interval(joint, level)
        origin = "by the farther end of the interval" if u else "not stated: the interval has no upper end"
        _append_text(result, "dcc:description", f"No uncertainty budget; expanded uncertainty {origin}.")
    data = _append(result, "dcc:data")
    _write_quantity(data, "Stiffness", joint.stiffness, joint.kind, u)
    for end, value in zip(("Lower", "Upper"), joint.stiffness_interval or (), strict=False):
        if value is not None:
            _write_quantity(data, f"{end} end of the {100 * level:g} % interval", value, joint.kind)


def _uncertainty_from_interval(joint: JointResult, level: float) -> report.ExpandedUncertainty | None:
    """Return the distance from a stiffness to the farther end of its interval, as an expanded uncertainty.

    `level` is the probability of the interval. Return None if the interval has no upper end.
    """
    ends = joint.stiffness_interval
    if joint.stiffness is None or ends is None or ends[1] is None:
        return None
    distance = max(joint.stiffness - ends[0], ends[1] - joint.stiffness)
    return report.ExpandedUncertainty(distance, student_quantile(0.5 + 0.5 * level, None), level)


def _write_quantity(
    data: Element, name: str, value: float, unit: str, u: report.ExpandedUncertainty | None = None
) -> None:
    """Write a named number in a unit of `_UNITS`, with its expanded uncertainty unless this is infinite."""
    quantity = _append(data, "dcc:quantity")
    _append_text(quantity, "dcc:name", name)
    real = _append(quantity, "si:real")
    _append(real, "si:value").text = repr(value)
    _append(real, "si:unit").text = _UNITS[unit]
    if u is not None and isfinite(u.value):
        uncertainty = _append(real, "si:measurementUncertaintyUnivariate", "si:expandedMU")
        _append(uncertainty, "si:valueExpandedMU").text = repr(u.value)
        _append(uncertainty, "si:coverageFactor").text = repr(u.coverage_factor)
        _append(uncertainty, "si:coverageProbability").text = repr(u.probability)


def _qualified_name(tag: str) -> str:
    """Return a tag such as `dcc:name` with the URL of its namespace in place of the prefix: `{URL}name`."""
    prefix, _, name = tag.partition(":")
    return f"{{{NAMESPACES[prefix]}}}{name}"


def _append(parent: Element, *tags: str) -> Element:
    """Append nested elements, each a child of the element before; return the innermost element."""
    for tag in tags:
        parent = ElementTree.SubElement(parent, _qualified_name(tag))
    return parent


def _append_text(parent: Element, tag: str, text: str, language: str | None = _LANGUAGE) -> None:
    """Append an element with a text; blanks replace control characters, which XML does not allow.

    Args:
        parent: element to append to.
        tag: tag of the new element.
        text: content of the new element.
        language: language of the text; None for text of the user, whose language is unknown.
    """
    content = _append(parent, tag, "dcc:content")
    if language is not None:
        content.set("lang", language)
    content.text = "".join(c if c.isprintable() else " " for c in text)
