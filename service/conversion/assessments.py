"""Assessments: from the numerical core's reasons to messages, with labels and names of targets."""

from __future__ import annotations

from collections.abc import Sequence

from jointstiff.schemas import assessment as messages
from jointstiff.schemas.run.joints import JointResult, OneSidedBounds, UncertaintyBudget
from jointstiff.service.conversion.message import message, messages_of
from jointstiff.solver.geometry.finding import GeometryFinding
from jointstiff.solver.inference.assessment import Assessment
from jointstiff.solver.inference.reason import Action, Place, Usability
from jointstiff.solver.inference.verdict import JointCompliance
from jointstiff.solver.readings.measurements import Measurements


def to_assessment(
    assessment: Assessment, joints: Sequence[JointCompliance], measurements: Measurements
) -> messages.Assessment:
    """Return verdict and reasons of an identification, and how many of its joints have a number."""
    return messages.Assessment(
        verdict=assessment.verdict,
        joints_identified=sum(joint.status == "identified" for joint in joints),
        joint_count=len(joints),
        notes=list(assessment.notes),
        reasons=[
            message(
                messages.Reason,
                reason,
                where=_where(reason.where, measurements),
                action=None if reason.action is None else _action(reason.action, measurements),
            )
            for reason in assessment.reasons
        ],
    )


def to_joints(
    joints: Sequence[JointCompliance],
    verdicts: Sequence[Usability],
    budgets: Sequence[UncertaintyBudget | None],
) -> list[JointResult]:
    """Return the joints, each with its verdict and its budget."""
    known = [joint.one_sided for joint in joints if joint.one_sided is not None]
    bounds = iter(messages_of(OneSidedBounds, known))
    one_sided = [None if joint.one_sided is None else next(bounds) for joint in joints]
    return messages_of(JointResult, joints, verdict=verdicts, budget=budgets, one_sided=one_sided)


def to_geometry_assessment(findings: Sequence[GeometryFinding]) -> messages.Assessment:
    """Return verdict and reasons of a geometry, by its findings that are no notes."""
    reasons = [
        messages.Reason(
            code="gross_error" if finding.severity == "error" else "suspicious_readings",
            weight="do_not_use" if finding.severity == "error" else "use_with_care",
            where=finding.where,
            message=finding.message,
            remedy=finding.remedy,
            action=None,
        )
        for finding in findings
        if finding.severity != "note"
    ]
    return combined([messages.Assessment(verdict=each.weight, reasons=[each]) for each in reasons])


def combined(assessments: Sequence[messages.Assessment]) -> messages.Assessment:
    """Return the worst verdict with all reasons, most severe first; of the same kind and place, the first."""
    reasons: dict[tuple[str, str | None], messages.Reason] = {}
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


_ORDER: tuple[messages.Verdict, ...] = ("use", "use_with_care", "do_not_use")


def _where(place: Place | None, measurements: Measurements) -> str | None:
    if place is None:
        return None
    if place.observation is None:
        return place.joint
    return measurements.place(place.observation)


def _action(action: Action, measurements: Measurements) -> messages.Action:
    return message(
        messages.Action,
        action,
        observations=[measurements.labels[i] for i in action.observations],
        target=None if action.target is None else measurements.targets[action.target],
    )
