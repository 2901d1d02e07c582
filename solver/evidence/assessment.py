"""Assessment of an identification: one verdict on whether its numbers may be used, with the reasons.

No reason means "use": noise alone raises one in less than one of a hundred sets.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Final

from jointstiff.schemas.finding import Finding, FindingCode, Verdict
from jointstiff.solver.evidence.alternatives import LARGEST_RATIO, BetterAlternative, better_alternative
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.evidence.fit_reasons import fit_reasons, within_noise
from jointstiff.solver.evidence.prediction import Prediction
from jointstiff.solver.evidence.reading_reasons import (
    alternative_reason,
    finding_reasons,
    load_mistake_reasons,
    load_reasons,
    noise_reasons,
)
from jointstiff.solver.evidence.screening import Screening, screen_estimate
from jointstiff.solver.evidence.verdict import JointCompliance
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.readings.measurements import ASSUMED_LOAD_POINT, Measurements
from jointstiff.solver.robot.model import Robot

_SAME_MISTAKES: Final[frozenset[FindingCode]] = frozenset({"joint_sign_suspect", "joints_swapped"})
"""Findings that the alternatives examine, too, and can undo."""
_ORDER: Final[dict[Verdict, int]] = {"use": 0, "use_with_care": 1, "do_not_use": 2}


@dataclass(frozen=True)
class Assessment:
    """The verdict on a whole result and on each joint."""

    verdict: Verdict  #: the least of what the reasons allow
    reasons: tuple[Finding, ...]  #: most severe first; none where the verdict is "use"
    #: verdict on each joint, never better than what the reasons about the set or this joint allow
    joints: tuple[Verdict, ...]
    notes: tuple[str, ...] = ()  #: checks that the readings do not allow, in words
    remarks: tuple[Finding, ...] = ()  #: of the weight "use", for information

    def supported(self, prediction: Prediction) -> Prediction:
        """Return what the readings support of a prediction.

        An exact fit explains all, whatever was measured; without a joint no contribution is a joint's.
        """
        codes = {reason.code for reason in self.reasons}
        if "no_residual_freedom" in codes:
            prediction = replace(prediction, compensation=None)
        if codes & {"no_residual_freedom", "no_joint_identified"}:
            prediction = replace(prediction, contributions=None)
        return prediction


def assess(
    robot: Robot,
    measurements: Measurements,
    settings: Settings,
    estimate: Estimate,
    prediction: Prediction,
    findings: Sequence[Finding] = (),
    screening: Screening | None = None,
) -> Assessment:
    """Assess an identification.

    Args:
        robot: n joints.
        measurements: N observations.
        settings: how it was identified.
        estimate: of the joints.
        prediction: of these measurements by the estimate.
        findings: of the integrity checks of these measurements.
        screening: of an identification of joints alone; None to make it here.
    """
    better = gross_mistake(robot, measurements, estimate)
    if better is not None:
        findings = [finding for finding in findings if finding.code not in _SAME_MISTAKES]
    # Behind a gross error tests of smaller ones say nothing.
    if any(finding.weight == "do_not_use" for finding in findings):
        screening = None
    elif screening is None and prediction.contributions is not None:
        screening = screen_estimate(robot, measurements, estimate)
    if better is not None:
        load = None if screening is None else screening.mistake
        if load is not None and load.proved and load.ratio < LARGEST_RATIO * better.ratio:
            better = None
        else:
            screening = None
    reasons = chain(
        () if better is None else [alternative_reason(robot, measurements, better)],
        () if screening is None else load_mistake_reasons(screening, estimate),
        load_reasons(robot, measurements),
        finding_reasons(measurements, settings, prediction, findings),
        noise_reasons(measurements),
        fit_reasons(measurements, estimate, prediction, screening, explained=better is not None),
    )
    return replace(assessed(estimate.joints, reasons), notes=tuple(_notes(measurements, estimate)))


def gross_mistake(robot: Robot, measurements: Measurements, estimate: Estimate) -> BetterAlternative | None:
    """Return the mistake that would explain the readings far better, where noise does not explain them."""
    return None if within_noise(estimate) else better_alternative(robot, measurements)


def assessed(joints: Sequence[JointCompliance], findings: Iterable[Finding]) -> Assessment:
    """Return the verdict on joints that findings allow, with the findings in their order."""
    ordered = tuple(sorted(findings, key=lambda finding: -_ORDER[finding.weight]))
    names = {joint.name for joint in joints}
    return Assessment(
        verdict=_least(finding.weight for finding in ordered),
        reasons=tuple(finding for finding in ordered if finding.weight != "use"),
        remarks=tuple(finding for finding in ordered if finding.weight == "use"),
        joints=tuple(
            _joint(joint, [f for f in ordered if f.where not in names - {joint.name}]) for joint in joints
        ),
    )


def _notes(measurements: Measurements, estimate: Estimate) -> Iterator[str]:
    if estimate.common is not None and estimate.common.of("assumed_load_point").any():
        yield (
            f"Load point: ±{1e3 * ASSUMED_LOAD_POINT:g} mm assumed. Measure where the force acts on the "
            "flange, and enter its uncertainty (on the page: Advanced, Position of the load point)."
        )
    if measurements.in_flange[measurements.present].all():
        yield (
            "The set has deflections and no positions, so the geometry of robot, frames and targets, and "
            "the joint angles, cannot be checked."
        )


def _least(verdicts: Iterable[Verdict]) -> Verdict:
    return max(verdicts, key=_ORDER.__getitem__, default="use")


def _joint(joint: JointCompliance, findings: Sequence[Finding]) -> Verdict:
    """Return the verdict on a joint by its status, capped by the findings that concern it."""
    verdict: Verdict = "do_not_use"
    if joint.status == "identified":
        verdict = "use"
    elif joint.status in {"at_bound", "uncertain"}:
        verdict = "use_with_care"
    return _least([verdict, *(finding.weight for finding in findings)])
