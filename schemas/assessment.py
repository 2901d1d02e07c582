"""The assessment of a result: one verdict on whether its numbers may be used, with reasons and remedies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.fields import Dimensionless, Message
from jointstiff.schemas.finding import Finding, Verdict
from jointstiff.schemas.terminal import Terminal


class Assessment(Message):
    """Assessment of a result: its verdict with the reasons."""

    verdict: Verdict = Field(description="Worst verdict of the reasons; `use` without reasons.")
    reasons: list[Finding] = Field(
        description="Findings that do not allow the verdict `use`, most severe first."
    )
    joints_identified: int | None = Field(
        default=None,
        description="Number of joints of status `identified`; the least of several fits; null for "
        "geometries.",
    )
    joint_count: int | None = Field(default=None, description="Number of joints; null for geometries.")
    notes: list[str] = Field(
        default_factory=list,
        description="Checks that these readings do not allow, and assumptions in their place.",
    )


class AcceptingOptions(Message):
    """Options of jobs that use the model of a run; a run with the verdict `do_not_use` is refused."""

    accept_verdict: Annotated[
        Literal["do_not_use"] | None, Terminal("--despite-verdict", flag="do_not_use")
    ] = Field(
        default=None,
        description="`do_not_use` accepts a run with this verdict, which is refused otherwise.",
    )


class VerdictSummary(Message):
    """Verdict of a result for listings; null while there is none."""

    verdict: Verdict | None = Field(
        default=None,
        description="Verdict of the result; the worst one of several fits.",
    )


class ResultSummary(VerdictSummary):
    """Summary of a result for listings; all null while there is none."""

    compensation: Dimensionless[float | None] = Field(
        default=None,
        description="Share of the mean deflection that the model predicts; the greatest of a comparison, "
        "the smaller of its two sides.",
    )
    joints_identified: int | None = Field(
        default=None,
        description="Number of joints of status `identified`; the largest of a comparison's runs, the "
        "smaller of its two sides; null for geometries.",
    )
    joint_count: int | None = Field(default=None, description="Number of joints; null for geometries.")
    warning_count: int | None = Field(
        default=None, description="Number of warnings; for geometries of findings except notes."
    )


def combined(assessments: Sequence[Assessment]) -> Assessment:
    """Return the worst verdict with all reasons, most severe first; of the same kind and place, the first."""
    reasons: dict[tuple[str, str | None], Finding] = {}
    for reason in (reason for assessment in assessments for reason in assessment.reasons):
        reasons.setdefault((reason.code, reason.where), reason)
    counts = [
        (each.joints_identified, each.joint_count)
        for each in assessments
        if each.joints_identified is not None
    ]
    identified, count = min(counts, default=(None, None))
    return Assessment(
        joints_identified=identified,
        joint_count=count,
        verdict=max((each.verdict for each in assessments), key=_ORDER.index, default="use"),
        reasons=sorted(reasons.values(), key=lambda reason: -_ORDER.index(reason.weight)),
        notes=list(dict.fromkeys(note for assessment in assessments for note in assessment.notes)),
    )


_ORDER: tuple[Verdict, ...] = ("use", "use_with_care", "do_not_use")
