"""The verdict on a result, its reasons, and what to do about them: each thing said once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.assessment import Assessment
from jointstiff.schemas.finding import Finding, Verdict
from jointstiff.schemas.problem import Problem
from jointstiff.service.tables.table import Line, Sheet, Style

MOST_SHOWN: Final = 3
"""Maximum number of reasons, and of things to do, without `--details`."""
OVERALL: Final = "overall verdict"
"""Header of the column of a file that has the verdict on all of it."""
VERDICTS: Final[Mapping[Verdict, str]] = MappingProxyType(
    {"use": "use", "use_with_care": "use with care", "do_not_use": "do not use"}
)
"""Words of the verdicts."""
_HEAD_STYLES: Final[Mapping[Verdict, Style]] = MappingProxyType(
    {"use": "verdict_use", "use_with_care": "verdict_care", "do_not_use": "verdict_not"}
)
"""Styles of the first line of a report."""
_STYLES: Final[Mapping[str, Style]] = {"use_with_care": "care", "do_not_use": "bad"}
_UNEXPLAINED: Final = frozenset({"deflections_unexplained", "residual_outlier"})
_SAID_BETTER: Final[Mapping[str, frozenset[str]]] = MappingProxyType(
    {
        "deflection_unexplained": _UNEXPLAINED,
        "alternative_explains_better": _UNEXPLAINED | {"joint_sign_suspect", "joints_swapped"},
    }
)
"""Warnings that a reason says better."""


def judged(sheet: Sheet, assessment: Assessment | None) -> Sheet:
    """Return a sheet with the verdict on all of it in a column of its own; as it is without one."""
    if assessment is None or not sheet.columns:
        return sheet
    rows = len(next(iter(sheet.columns.values())))
    columns = {**sheet.columns, OVERALL: [assessment.verdict] * rows}
    return replace(sheet, columns=columns, texts=sheet.texts | {OVERALL})


def verdict_line(assessment: Assessment) -> Line:
    """Return the verdict in one line."""
    verdict, count = assessment.verdict, len(assessment.reasons)
    why = _counted(count, "reason") if count else support(assessment)
    return Line(f"{VERDICTS[verdict].capitalize()}: {why}", _HEAD_STYLES[verdict])


def support(assessment: Assessment) -> str:
    """Return what passed the checks of a result without reasons against it."""
    identified, count = assessment.joints_identified, assessment.joint_count
    if identified is None:
        return "the checks found no fault"
    return f"{'all' if identified == count else f'{identified} of'} {count} joints passed the checks"


def verdict_lines(assessment: Assessment, *, details: bool) -> list[Line]:
    """Return the verdict, its reasons, most severe first, and what was assumed."""
    reasons = assessment.reasons
    lines: list[Line] = [verdict_line(assessment)]
    for reason in reasons if details else reasons[:MOST_SHOWN]:
        place = f"{reason.where}: " if reason.where else ""
        lines.append(Line(f"  {place}{reason.message}", _STYLES[reason.weight]))
    hidden = len(reasons) - len(lines) + 1
    if hidden:
        lines.append(Line(f"  and {hidden} more (--details)", "dim"))
    return [*lines, *(Line(f"  {note}", "dim") for note in assessment.notes)]


def remedies(assessment: Assessment) -> list[str]:
    """Return what the reasons advise, most severe first, each once."""
    return list(dict.fromkeys(reason.remedy for reason in assessment.reasons))


def to_do_lines(things: Sequence[str], *, details: bool) -> list[Line]:
    """Return a numbered list of what to do, of the most important things without details."""
    shown = things if details else things[:MOST_SHOWN]
    lines: list[Line] = [Line(f"  {number}. {each}") for number, each in enumerate(shown, 1)]
    return [Line("To do", "title"), *lines] if lines else []


def warning_lines(assessment: Assessment, warnings: Sequence[Finding], *, details: bool) -> list[Line]:
    """Return the warnings that no reason repeats, or without details their number."""
    rest = _not_said(warnings, assessment.reasons)
    if not details:
        return [Line(f"  {_counted(len(rest), 'warning')} (--details)", "care")] if rest else []
    return [
        Line(
            f"warning: {f'{warning.where}: ' if warning.where else ''}{warning.message}; {warning.remedy}",
            "care",
        )
        for warning in rest
    ]


def joint_reason_lines(reasons: Iterable[tuple[str, str | None]]) -> list[Line]:
    """Return why joints have no number or a bound: joints of the same reason in one line."""
    names: dict[str, list[str]] = {}
    for name, reason in reasons:
        if reason:
            names.setdefault(reason, []).append(name)
    return [Line(f"  {', '.join(same)}: {reason}", "dim") for reason, same in names.items()]


def _not_said(warnings: Sequence[Finding], reasons: Sequence[Finding]) -> list[Finding]:
    """Leave out the kinds of warnings that a reason says or sums up, those of the whole set first."""
    codes: set[str] = {reason.code for reason in reasons} | {
        warning.code
        for warning in warnings
        if any(reason.message.startswith(warning.message) for reason in reasons)
    }
    codes = codes.union(*(_SAID_BETTER.get(code, ()) for code in codes))
    rest = [warning for warning in warnings if warning.code not in codes]
    return sorted(rest, key=lambda warning: warning.where is not None)


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def problem_line(problem: Problem) -> Line:
    """Return an error as text: what, where, and how to mend it."""
    if len(problem.errors) > 1 or any(item.reason not in problem.detail for item in problem.errors):
        lines = [
            f"{item.where}: {item.reason}" + (f"; {item.remedy}" if item.remedy else "")
            for item in problem.errors
        ]
        if problem.remedy and all(problem.remedy != item.remedy for item in problem.errors):
            lines.append(f"remedy: {problem.remedy}")
        return Line("\n".join([problem.title, *(f"  {line}" for line in lines)]), "bad")
    place = f"{problem.where}: " if problem.where else ""
    detail = problem.errors[0].reason if problem.errors else problem.detail
    remedy = f"\n  remedy: {problem.remedy}" if problem.remedy else ""
    return Line(f"{place}{detail}{remedy}", "bad")
