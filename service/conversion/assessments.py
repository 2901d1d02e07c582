"""Assessments of results, one by one and of several together."""

from __future__ import annotations

from collections.abc import Sequence

from jointstiff.schemas import assessment as messages
from jointstiff.schemas.finding import Finding, Verdict
from jointstiff.schemas.run import JointResult, OneSidedBounds, UncertaintyBudget
from jointstiff.solver.evidence.assessment import Assessment
from jointstiff.solver.evidence.estimate import JointCompliance
from jointstiff.solver.messages import messages_of


def to_assessment(assessment: Assessment, joints: Sequence[JointCompliance]) -> messages.Assessment:
    """Return verdict and reasons of an identification, and how many of its joints have a number."""
    return messages.Assessment(
        verdict=assessment.verdict,
        joints_identified=sum(joint.status == "identified" for joint in joints),
        joint_count=len(joints),
        reasons=list(assessment.reasons),
        notes=list(assessment.notes),
    )


def to_joints(
    joints: Sequence[JointCompliance],
    verdicts: Sequence[Verdict],
    budgets: Sequence[UncertaintyBudget | None],
) -> list[JointResult]:
    """Return the joints, each with its verdict and its budget."""
    known = [joint.one_sided for joint in joints if joint.one_sided is not None]
    bounds = iter(messages_of(OneSidedBounds, known))
    one_sided = [None if joint.one_sided is None else next(bounds) for joint in joints]
    return messages_of(JointResult, joints, verdict=verdicts, budget=budgets, one_sided=one_sided)


def to_geometry_assessment(findings: Sequence[Finding]) -> messages.Assessment:
    """Return verdict and reasons of a geometry, by its findings that are not for information alone."""
    reasons = [finding for finding in findings if finding.weight != "use"]
    return combined([messages.Assessment(verdict=each.weight, reasons=[each]) for each in reasons])


def combined(assessments: Sequence[messages.Assessment]) -> messages.Assessment:
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
    return messages.Assessment(
        joints_identified=identified,
        joint_count=count,
        verdict=max((each.verdict for each in assessments), key=_ORDER.index, default="use"),
        reasons=sorted(reasons.values(), key=lambda reason: -_ORDER.index(reason.weight)),
        notes=list(dict.fromkeys(note for assessment in assessments for note in assessment.notes)),
    )


_ORDER: tuple[Verdict, ...] = ("use", "use_with_care", "do_not_use")
