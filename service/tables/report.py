"""Reports of jobs for people: verdict, request, parts of the job's kind, and things to do."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from types import MappingProxyType
from typing import Final

from pydantic.fields import FieldInfo
from pydantic_core import to_jsonable_python

from jointstiff.schemas.fields import Message
from jointstiff.schemas.finding import UNKNOWN_JOINTS, ActionKind, Assessment, Finding, Problem, Verdict
from jointstiff.schemas.joints import GOAL, JointKind
from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS, StiffnessUnit
from jointstiff.service.tables.table import Line, Part, Sheet, Style, field_unit
from jointstiff.solver.text import figure


@dataclass(frozen=True)
class View:
    """Options by which a job is shown: extent, unit of stiffness, and whether actions can be applied."""

    details: bool = False  # whether to show the whole result
    unit: StiffnessUnit = UNITS[DEFAULT_UNIT]
    applies: bool = False  # whether the command that shows the job has the option `--apply`
    door: str = ""  # what shows the whole result, such as `--details`; empty if nothing does
    assumed: Sequence[str] = ()  # what was assumed about the readings before they were sent, in a few words


@dataclass(frozen=True)
class Report:
    """Parts of a result for people, in addition to its verdict, its warnings and the remedies of both."""

    parts: Sequence[Part]  # between verdict and warnings
    evidence: Sequence[Part] = ()  # below the warnings
    advice: Sequence[str] = ()  # things to do in addition to the remedies
    further: Sequence[Part] = ()  # below the parts; shown only with all details
    assumed: Sequence[str] = ()  # assumptions in a few words each, such as `force ± 1 %`


METHOD_NAMES: Final = {
    "complete_pose": "complete pose",
    "partial_pose": "partial pose",
    "decoupled_partial_pose": "decoupled partial pose",
}
MOST_SHOWN: Final = 3
"""Maximum number of reasons, and of things to do, without `--details`."""
OVERALL: Final = "overall verdict"
"""Header of a file's column that repeats the verdict on the whole result."""
VERDICTS: Final[Mapping[Verdict, str]] = MappingProxyType(
    {"use": "use", "use_with_care": "use with care", "do_not_use": "do not use"}
)
"""Verdict → words shown for it."""
_HEAD_STYLES: Final[Mapping[Verdict, Style]] = MappingProxyType(
    {"use": "verdict_use", "use_with_care": "verdict_care", "do_not_use": "verdict_not"}
)
"""Verdict → style of the first line of a report."""
_STYLES: Final[Mapping[str, Style]] = {"use_with_care": "care", "do_not_use": "bad"}
_UNEXPLAINED_CODES: Final = frozenset({"deflections_unexplained", "residual_outlier"})
_COVERED_WARNINGS: Final[Mapping[str, frozenset[str]]] = MappingProxyType(
    {
        "deflection_unexplained": _UNEXPLAINED_CODES,
        "alternative_explains_better": _UNEXPLAINED_CODES
        | {"joint_sign_suspect", "joints_swapped", "joints_counted_otherwise"},
    }
)
"""Code of a reason → codes of warnings that say the same as the reason, and are therefore not shown."""


def with_overall_verdict(sheet: Sheet, assessment: Assessment | None) -> Sheet:
    """Return a sheet with a column that repeats the overall verdict; unchanged without an assessment."""
    if assessment is None or not sheet.columns:
        return sheet
    rows = len(next(iter(sheet.columns.values())))
    columns = {**sheet.columns, OVERALL: [assessment.verdict] * rows}
    return replace(sheet, columns=columns, texts=sheet.texts | {OVERALL})


def verdict_line(assessment: Assessment) -> Line:
    """Return the verdict as a line, with the number of reasons or of joints that passed the checks."""
    if assessment.headline is not None:
        return Line(assessment.headline, _HEAD_STYLES[assessment.verdict])
    verdict, count = assessment.verdict, len(assessment.reasons)
    identified, joints = assessment.joints_identified, assessment.joint_count
    if not count and identified is not None and identified != joints:
        rest_words = "no number of the other joints passed the checks"
        return Line(f"Use {identified} of {joints} joints: {rest_words}", _HEAD_STYLES[verdict])
    explanation = format_count(count, "reason") if count else describe_passed_checks(assessment)
    if count and all(reason.code in UNKNOWN_JOINTS for reason in assessment.reasons):
        explanation = f"{identified} of {joints} joints are known within a factor of {GOAL:g}"
    return Line(f"{VERDICTS[verdict].capitalize()}: {explanation}", _HEAD_STYLES[verdict])


def describe_passed_checks(assessment: Assessment, owner: str = "") -> str:
    """Return in words how many joints passed the checks.

    `owner` says whose joints these are, such as ` of its run`.
    """
    identified, count = assessment.joints_identified, assessment.joint_count
    if identified is None:
        return "the checks found no fault"
    return f"{'all' if identified == count else f'{identified} of'} {count} joints{owner} passed the checks"


def verdict_lines(assessment: Assessment, *, details: bool) -> list[Line]:
    """Return lines with the verdict and its reasons; without `details` only with the worst reasons."""
    lines: list[Line] = [verdict_line(assessment)]
    for reason in assessment.reasons if details else assessment.reasons[:MOST_SHOWN]:
        place = f"{reason.where}: " if reason.where else ""
        lines.append(Line(f"  {place}{reason.message}", _STYLES[reason.weight]))
    lines += [Line(f"  Question: {question.message}") for question in assessment.questions]
    return lines


def note_lines(assessment: Assessment) -> list[Line]:
    """Return a line for each assumption, and for each check that the readings do not allow."""
    return [Line(f"  {note}", "dim") for note in assessment.notes]


def hint_lines(report: Report, assessment: Assessment, warnings: Sequence[Finding], door: str) -> list[Line]:
    """Return one line in place of the details: assumptions, counts of what is hidden, and the door to it.

    No line is returned if nothing is hidden.
    """
    facts = [f"assumed: {', '.join(report.assumed)}"] if report.assumed else []
    hidden_count = len(assessment.reasons) - MOST_SHOWN
    if hidden_count > 0:
        facts.append(format_count(hidden_count, "more reason"))
    other_warnings = _list_other_warnings(assessment, warnings)
    if other_warnings:
        facts.append(format_count(len(other_warnings), "warning"))
    is_hidden = bool(facts or assessment.notes or report.further)
    if is_hidden and door:
        facts = [*(facts or ["more"]), door]
    return [Line(f"  {'; '.join(facts)}", "care" if other_warnings else "dim")] if facts else []


def remedies(assessment: Assessment, *, applies: bool = False) -> list[str]:
    """Return the remedies of an assessment's reasons and the answers that it asks for, without repetitions.

    If `applies` is set, a remedy that a program can carry out names its option.
    """
    # `--apply KIND` applies the first action of a kind, so only the remedy of that action names the option.
    kinds_without_option = {"show_posture"}
    found = list[str]()
    for reason in (*assessment.reasons, *assessment.questions):
        remedy = reason.remedy
        kind = None if reason.action is None else reason.action.kind
        if applies and kind is not None and kind not in kinds_without_option:
            remedy += f", or repeat the command with `{_name_option(kind)}`"
            kinds_without_option.add(kind)
        found.append(remedy)
    return list(dict.fromkeys(found))


def _name_option(kind: ActionKind) -> str:
    """Return the option on the command line that carries out an action."""
    return "--payload KG" if kind == "state_payload" else f"--apply {kind}"


def to_do_lines(things: Sequence[str], *, details: bool) -> list[Line]:
    """Return a title and a numbered list of things to do; without `details` only the first `MOST_SHOWN`."""
    shown = things if details else things[:MOST_SHOWN]
    lines: list[Line] = [Line(f"  {number}. {thing}") for number, thing in enumerate(shown, 1)]
    return [Line("To do", "title"), *lines] if lines else []


def _list_other_warnings(assessment: Assessment, warnings: Sequence[Finding]) -> list[Finding]:
    """Return the warnings that the reasons do not mention."""
    covered_codes: set[str] = {reason.code for reason in assessment.reasons}
    covered_codes = covered_codes.union(*(_COVERED_WARNINGS.get(code, ()) for code in covered_codes))
    return [warning for warning in warnings if warning.code not in covered_codes]


def warning_lines(assessment: Assessment, warnings: Sequence[Finding]) -> list[Line]:
    """Return a line for each warning that the reasons do not mention."""
    other_warnings = _list_other_warnings(assessment, warnings)
    other_warnings.sort(key=lambda warning: warning.where is not None)  # those about the whole set come first
    lines = list[Line]()
    for warning in other_warnings:
        place = f"{warning.where}: " if warning.where else ""
        lines.append(Line(f"warning: {place}{warning.message}; {warning.remedy}", "care"))
    return lines


def joint_reason_lines(reasons: Iterable[tuple[str, str | None]]) -> list[Line]:
    """Return a line for each reason why a joint has no number or only a bound, with the joints it applies to.

    Args:
        reasons: name and reason of each joint; None as the reason for a joint with a number.
    """
    names: dict[str, list[str]] = {}
    for name, reason in reasons:
        if reason:
            names.setdefault(reason, []).append(name)
    return [Line(f"  {', '.join(joint_names)}: {reason}", "dim") for reason, joint_names in names.items()]


def format_count(count: int, noun: str) -> str:
    """Return a count with its noun, in the plural unless the count is 1: `2 reasons`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def problem_line(problem: Problem) -> Line:
    """Return an error as text, with the place, the reason and the remedy of each fault."""
    needs_lines = any(item.reason not in problem.detail for item in problem.errors)
    if len(problem.errors) > 1 or needs_lines:
        return Line("\n".join(_list_faults(problem)), "bad")
    place = f"{problem.where}: " if problem.where else ""
    detail = problem.errors[0].reason if problem.errors else problem.detail
    remedy = f"\n  remedy: {problem.remedy}" if problem.remedy else ""
    return Line(f"{place}{detail}{remedy}", "bad")


def _list_faults(problem: Problem) -> Iterator[str]:
    """Yield the title of a problem, then a line for each fault with its place and remedy."""
    yield problem.title
    for item in problem.errors:
        remedy = f"; {item.remedy}" if item.remedy else ""
        yield f"  {item.where}: {item.reason}{remedy}"
    remedies_of_faults = {item.remedy for item in problem.errors}
    if problem.remedy and problem.remedy not in remedies_of_faults:
        yield f"  remedy: {problem.remedy}"


_SHOWN_UNITS: Final[Mapping[str, tuple[float, str]]] = {
    "m": (1e3, "mm"),
    "rad": (180.0 / pi, "°"),
    "deg": (1.0, "°"),
    "1": (1.0, ""),
    "N.m": (1.0, "N·m"),
    "N.m/rad": (1e-6, "10⁶ N·m/rad"),
    "N/m": (1e-6, "N/µm"),
    "N.mm": (1.0, "N·mm"),
    "kN.m": (1.0, "kN·m"),
    "kgf.m": (1.0, "kgf·m"),
    "lbf.m": (1.0, "lbf·m"),
    "lbf.ft": (1.0, "lbf·ft"),
    "lbf.in": (1.0, "lbf·in"),
}
"""Unit of a number → factor to the unit in which people see the number, and name of that unit."""
_STATED_UNIT: Final = re.compile(r"\bin units\.(\w+)")
"""Words such as `in units.length` in the description of a field whose unit the request states."""
_MAX_CHARACTERS: Final = 300
"""Most characters of a value in a report; a longer value is replaced by its length and its hash."""
_MAX_LINES: Final = 20
NOT_STATED: Final = "not stated"


@dataclass(frozen=True)
class _RequestUnits:
    """Units that a request states, and the kinds of the joints to which its numbers belong."""

    stated: object  # field `units` of the request; None if the request has none
    # joint's name → kind, in the order of the robot; empty if all joints are revolute
    kinds: Mapping[str, JointKind]

    def unit_of_field(self, field: FieldInfo) -> _Unit:
        """Return the unit of a field: from its schema, or from the request if its description says so."""
        description = field.description or ""
        stated_units = [
            str(getattr(self.stated, name, None) or "") for name in _STATED_UNIT.findall(description)
        ]
        if stated_units:  # the first is of revolute joints; the last, of prismatic joints, may be equal
            return _Unit(stated_units[0], stated_units[-1])
        return _Unit(field_unit(field), field_unit(field, "unit_of_prismatic") or field_unit(field))

    def units_of_joints(self, values: Sequence[float], unit: _Unit) -> list[str] | None:
        """Return the unit of each value of a field that has one value for each joint; else None.

        None is also returned if all joints have the same unit.
        """
        have_joint_units = unit.prismatic != unit.revolute and len(values) == len(self.kinds)
        return [unit.for_kind(kind) for kind in self.kinds.values()] if have_joint_units else None


@dataclass(frozen=True)
class _Unit:
    """Unit of a number for revolute and for prismatic joints; both are equal for other numbers."""

    revolute: str
    prismatic: str

    def for_kind(self, kind: JointKind | None) -> str:
        """Return the unit of a number of a joint of this kind; None is treated as revolute."""
        return self.prismatic if kind == "prismatic" else self.revolute


def list_request_fields(
    request: Message, kinds: Mapping[str, JointKind] = MappingProxyType({})
) -> list[tuple[str, str]]:
    """Return (label, text) of each field of a request; a last entry names the fields without a value.

    Lengths are in mm, angles in degrees, stiffnesses in 10⁶ N·m/rad, or in N/µm for joints that `kinds` says
    are prismatic. For long values, such as readings and files, the text states the number of entries and the
    SHA-256 of their JSON.
    """
    entries = list(_list_fields(request, _RequestUnits(getattr(request, "units", None), kinds), ""))
    labels_without_value = [label for label, text in entries if not text]
    facts = [(label[:1].upper() + label[1:], text) for label, text in entries if text]
    if labels_without_value:
        facts.append(("Not stated", ", ".join(labels_without_value)))
    return facts


def _list_fields(message: Message, units: _RequestUnits, label_prefix: str) -> Iterator[tuple[str, str]]:
    """Yield label and text of each field of a message; the text is empty if the field has no value.

    Args:
        message: message whose fields are listed, those of inner messages included.
        units: units of the request.
        label_prefix: beginning of the labels: the label of the outer field.
    """
    for name, field in type(message).model_fields.items():
        label, value = f"{label_prefix}{name.replace('_', ' ')}", getattr(message, name)
        unit = units.unit_of_field(field)
        if isinstance(value, Message):
            yield from _list_fields(value, units, f"{label}: ")
        elif isinstance(value, Sequence) and value and isinstance(value[0], Message):
            lines = [_format_or_summarise(item, unit, units) for item in value]
            yield label, "\n".join(lines) if len(lines) <= _MAX_LINES else _summarise(value)
        elif value is None or value in ("", [], (), {}):
            yield label, ""
        else:
            yield label, _format_or_summarise(value, unit, units)


def _format_or_summarise(
    value: object, unit: _Unit, units: _RequestUnits, kind: JointKind | None = None
) -> str:
    """Return a value as text; a text that is too long is replaced by its length and hash."""
    text = _format_value(value, unit, units, kind)
    return text if len(text) <= _MAX_CHARACTERS else _summarise(value)


def _format_value(value: object, unit: _Unit, units: _RequestUnits, kind: JointKind | None = None) -> str:
    """Return a value of any type as text, numbers with their unit.

    Args:
        value: message, number, text, or list or dictionary of these.
        unit: unit of the numbers in the value.
        units: units of the request.
        kind: kind of the joint to which the value belongs; None if unknown.
    """
    if isinstance(value, Message):
        return _format_message(value, units, kind)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        factor, name = _find_shown_unit(unit.for_kind(kind))
        blank = "" if name in ("", "°") else " "
        return f"{_format_number(factor * value)}{blank}{name}"
    if isinstance(value, Mapping):
        texts = [
            f"{key} {_format_value(item, unit, units, units.kinds.get(key))}" for key, item in value.items()
        ]
        return "; ".join(texts)
    if isinstance(value, Sequence) and not isinstance(value, str):
        if value and all(map(_is_number, value)):
            return _format_numbers(value, unit, units, kind)
        return "; ".join(_format_value(item, unit, units, kind) for item in value)
    return str(value)


def _is_number(value: object) -> bool:
    """Return whether a value is a number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _format_message(message: Message, units: _RequestUnits, kind: JointKind | None) -> str:
    """Return the fields of a message that have a value, each with its name, as text."""
    texts = list[str]()
    for name, field in type(message).model_fields.items():
        value = getattr(message, name)
        if value is not None:
            text = _format_or_summarise(value, units.unit_of_field(field), units, kind)
            texts.append(f"{name.replace('_', ' ')} {text}")
    return ", ".join(texts)


def _find_shown_unit(unit: str) -> tuple[float, str]:
    """Return the factor to the unit in which people see a number, and the name of that unit."""
    return _SHOWN_UNITS.get(unit, (1.0, unit))


def _format_numbers(
    values: Sequence[float], unit: _Unit, units: _RequestUnits, kind: JointKind | None
) -> str:
    """Return a list of numbers in brackets, with their common unit behind, or each with its joint's unit."""
    joint_units = units.units_of_joints(values, unit)
    if joint_units:
        texts = [
            _format_value(value, _Unit(joint_unit, joint_unit), units)
            for value, joint_unit in zip(values, joint_units, strict=True)
        ]
        return f"({', '.join(texts)})"
    factor, name = _find_shown_unit(unit.for_kind(kind))
    numbers = [_format_number(factor * value) for value in values]
    return f"({', '.join(numbers)}) {name}".strip()


def _format_number(value: float) -> str:
    """Format a number of a request with all its digits."""
    return figure(value, ".10g")


def _summarise(value: object) -> str:
    """Return the length and the SHA-256 of a value that is too long to be shown."""
    if isinstance(value, str):
        return f"{len(value):,} characters, SHA-256 {hashlib.sha256(value.encode()).hexdigest()}"
    json_text = json.dumps(to_jsonable_python(value), separators=(",", ":"))
    count = len(value) if isinstance(value, Sequence | Mapping) else 1
    return f"{count} entries, SHA-256 {hashlib.sha256(json_text.encode()).hexdigest()}"
