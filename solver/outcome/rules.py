"""Assessment of an identification: one verdict on whether its numbers may be used, with the reasons.

Reasons lie in the readings (mistakes that their checks found, and one that would explain them better), or in
the fit (joints that are not identified, not certain, not explained or not plausible). No reason means "use":
noise alone raises one in less than one of a hundred sets.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.finding import (
    QUESTIONS,
    ROOT_MISTAKES,
    ActionKind,
    AdvisedAction,
    Finding,
    NamedCause,
    Verdict,
)
from jointstiff.schemas.joints import GOAL, JOINT_UNITS, JointKind
from jointstiff.schemas.options import MAX_CAUSES
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.causes import Screening
from jointstiff.solver.evidence.doubt import PointDoubt
from jointstiff.solver.evidence.joints import JointsAlone, residuals_within_noise
from jointstiff.solver.evidence.payload import inspect_force_unit
from jointstiff.solver.evidence.pure_error import PureError, compute_pure_error
from jointstiff.solver.evidence.selection import Cause
from jointstiff.solver.evidence.structure import Apart
from jointstiff.solver.evidence.unloading import Unloading, compare_unloaded_positions
from jointstiff.solver.fit.estimate import (
    CARRIES,
    CommonErrors,
    ComplementaryStiffness,
    Estimate,
    JointCompliance,
    JointPrior,
    Prediction,
)
from jointstiff.solver.fit.identify import describe
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.problem import Certificate
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.triangle import solve_nonnegative
from jointstiff.solver.mechanics.block import (
    STANDARD_GRAVITY,
    Term,
    fitted_errors,
    targets_in_flange,
    unloaded_postures,
)
from jointstiff.solver.mechanics.measurements import (
    ASSUMED_FORCE_SCALE,
    ASSUMED_LOAD_POINT,
    NOISE_SIGMAS,
    Measurements,
)
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import (
    PAST_CARE,
    PAST_DO_NOT_USE,
    describe_others,
    figure,
    length_text,
    stiffness_text,
    unknowns_text,
)

SAME_PLACE: Final = 2e-3
"""Distance between load point and target [m] below which they count as the same."""
OUTLYING: Final = 6.0
"""Ratio of a residual to the median residual above which a model of joints and links does not explain an
observation."""
FEW: Final = 0.1
"""Largest share of suspicious observations that the Huber loss, or leaving them out, can handle."""
MOST_LEFT_OUT: Final = 0.3
"""Largest share of the observations that a proposed action leaves out: if more are bad, something else is
wrong."""
HARMFUL: Final = 0.05
"""Relative change of a compliance above which a proved mistake in the load forbids its use."""
COVERED: Final = 2.0
"""Number of standard uncertainties by the load point within which a change is covered by the intervals."""
CARE_RATIO_OF_LINKS, UNUSABLE_RATIO = 1.5, 3.0
"""Ratios of the residuals to sigma: above the first a model with links, whose penalty enlarges the residuals,
gets a warning; above the second any result is unusable."""
CARE_LEVEL: Final = 1e-3
"""p-value of the residuals below which a warning is given: noise alone causes that in one of two thousand
campaigns."""
WORTH_A_WARNING: Final = 0.1
"""Relative error of sigma up to which no warning is given: it changes no conclusion, though large sets show
it."""
_NOISY: Final = 1.5
"""Noise of an encoder, relative to the stated noise, from which a note names it."""
CARE_SHARE, UNUSABLE_SHARE = 0.7, 0.5
"""Compensation below which more than the joints deflects: with a warning, and with an unusable result; the
joints of real robots explain 80 %."""
LARGEST_SIGMA: Final = 1e-4
"""Sigma from the residuals [m] above any laser tracker's: readings of a robot have 10 to 40 µm. Three targets
show the tracker's noise itself (`pure_error`)."""
LEAST_SIGMA: Final = 1e-8
"""Residuals [m] below which the readings are computed, not measured."""
PLAUSIBLE_STIFFNESS: Final = (1e3, 1e9)
"""Range of joint stiffness of industrial robots [N·m/rad, N/m], with a margin of three decades."""
CONTRADICTED_PRIOR: Final = 5.0
"""Least difference of a prior from the readings, in its standard uncertainties, that is reported."""
NARROW_PRIOR: Final = 1e-3
"""Relative standard uncertainty below which a prior that contradicts the readings is taken for a mistake."""
MISTAKEN_PRIOR: Final = 10.0
"""Least ratio of a contradicted prior and the readings that must not be used: a unit, or a digit too many."""
LARGEST_SHIFT: Final = 0.5
"""Bias, in standard uncertainties, at which a 95 % interval contains the true value in only 92 % of cases."""
_PLACES: Final = 60
_LEAST_FREEDOM: Final = 0.5
_LEAST_POSTURES: Final = 3
_DISTINCT: Final = float(np.radians(5.0))
"""Difference of a joint's angle [rad] from which on two postures count as distinct."""
_CODES_OF_LENGTH_UNITS: Final = ("deflection_implausibly_large", "deflection_implausibly_small")
_ORDER: Final[dict[Verdict, int]] = {"use": 0, "use_with_care": 1, "do_not_use": 2}
_BY_STATUS: Final[dict[str, Verdict]] = {
    "identified": "use",
    "uncertain": "use_with_care",
    "at_bound": "use_with_care",
    "not_observable": "do_not_use",
}
_NOT_LINEAR: Final = frozenset({"play", "curved_springs"})
"""Causes that readings at one size of the load may not distinguish."""
_LARGEST_CAUSES: Final = {"m": 10.0, "rad": 0.02, "m/m": 0.01}
"""Largest plausible size of a cause by its unit: of a load point elsewhere, of play, of the arm's growth."""
_LARGEST_BY_LOAD: Final = 3.0
"""Largest plausible size of a forgotten force, relative to the largest force."""
_LEAST_IN_BASE: Final = 1.0
"""Distance [m] from the flange beyond which a stated load point may be a place in R0."""
_NEAR_HOOK: Final = 0.2
"""Distance [m] of a stated load point from the hook in R0 up to which it seems to be this place."""
_READ_HALF: Final = (
    "not linear: read two postures again at half the load; play stays the same, a hardening spring "
    "deflects by more than half"
)
_FIT_CAUSES_FIRST: Final = (
    "first fit the named causes with the joints; the remaining residuals then show the noise"
)
_CHECK_NOISE: Final = (
    "check frames, joint map, units and noise; if all are correct, something besides the joints deflects: "
    "omit `noise` so that sigma is estimated from the residuals"
)


_ASSUMED_SCALE_OF_FORCES: Final = (
    f"The forces are assumed to be known to ±{100 * ASSUMED_FORCE_SCALE:g} %. Enter the "
    "uncertainty of the load cell or of the weight (`noise.force.scale`; on the page: Advanced, "
    "Scale of the force)."
)
_NO_SECOND_READING: Final = (
    "Each posture was read only once without load, so a deflection that remains after unloading is "
    "not detected. Read each posture again after unloading (`unloaded_after`)."
)
_NO_POSITIONS: Final = (
    "The set has deflections but no positions, so the joint angles and the geometry of robot, "
    "frames and targets cannot be checked."
)
"""Sentences on what was assumed, and on what the readings do not show."""


@dataclass(frozen=True)
class Assessment:
    """Verdict on a whole result and on each joint, with the reasons."""

    verdict: Verdict  #: verdict on the whole result: the weight of the most severe reason
    reasons: tuple[Finding, ...]  #: most severe first; none where the verdict is "use"
    #: verdict on each joint, never better than the weight of a reason on the whole set or on this joint
    joints: tuple[Verdict, ...]
    notes: tuple[str, ...] = ()  #: sentences on assumptions, and on checks that the readings do not allow
    remarks: tuple[Finding, ...] = ()  #: findings of the weight "use", which do not change the verdict
    questions: tuple[Finding, ...] = ()  #: what a person knows and the readings do not show

    def drop_meaningless_numbers(self, prediction: Prediction) -> Prediction:
        """Return a prediction without the numbers that mean nothing after this assessment.

        After an exact fit or a mistake in the data, the compensation and the contributions of the joints are
        removed; if no joint is identified, only the contributions are.
        """
        codes = {reason.code for reason in self.reasons}
        if codes & (ROOT_MISTAKES | {"no_residual_freedom"}):
            return replace(prediction, compensation=None, contributions=None)
        if "no_joint_identified" in codes:
            return replace(prediction, contributions=None)
        return prediction


def assess(
    joints: JointsAlone,
    estimate: Estimate,
    prediction: Prediction,
    screening: Screening | None,
    doubt: PointDoubt | None = None,
) -> Assessment:
    """Assess an identification: collect all reasons against its numbers, and derive the verdicts.

    Args:
        joints: identification by joints alone, with measurements and findings of their integrity checks.
        estimate: estimate to be assessed, of joints alone or of a model with links or base.
        prediction: prediction of the same measurements by the estimate.
        screening: tests for other causes of the deflections, with the cross-validation if models were
            compared; None without tests.
        doubt: doubt about the stated load point; None where more than the joints may bend.
    """
    unloading = compare_unloaded_positions(joints.rows, joints.estimate.compliance)
    notes = [*_list_notes(joints.measurements, estimate, unloading), *_list_notes_on_encoders(joints)]
    if joints.refuted:
        notes.append(f"The stiffnesses are identified without the refuted {_name_postures(joints.refuted)}.")
    root_mistakes = _report_root_mistakes(joints.noticed)
    if root_mistakes:  # after such a mistake no other check means anything
        reasons = [*root_mistakes, *report_solver(estimate.certificates)]
        return replace(derive_assessment(estimate.joints, reasons), notes=tuple(notes))
    explanation = _choose_explanation(joints, screening)
    reasons = list(_list_reasons(joints, estimate, prediction, explanation, unloading))
    reasons += _report_negative(estimate.joints)
    if all(reason.weight != "do_not_use" for reason in reasons):  # else no interval means anything
        reasons += _report_poorly_known(estimate)
    if doubt is not None and explanation.finds_nothing:  # else the doubt may have the same reason
        notes.append(doubt.describe())
    return replace(derive_assessment(estimate.joints, reasons), notes=tuple(notes))


def _report_root_mistakes(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings of mistakes that spoil all readings, one for each code."""
    root_findings = [finding for finding in findings if finding.code in ROOT_MISTAKES]
    return summarise_noticed(root_findings, "do_not_use")


def summarise_noticed(findings: Sequence[Finding], weight: Verdict) -> list[Finding]:
    """Return the findings of a weight, one for each code, with the number of others of its kind.

    If several robots fit the readings, all of these findings are returned, so that the user can choose one.
    """
    reasons: list[Finding] = []
    for group in _group_by_code(findings, weight):
        if group[0].code == "another_robot_fits":
            reasons += group
        else:
            reasons.append(_summarise_findings(group, group[0].action))
    return reasons


@dataclass(frozen=True, eq=False)
class _Explanation:
    """Explanation of the readings that is better than the joints with the data as given."""

    noticed: Sequence[Finding]  # findings of the integrity checks
    has_gross_error: bool  # whether one of these findings forbids the use of the data
    screening: Screening | None  # tests of smaller effects; None after a gross error or a mistake
    causes: Sequence[Cause]  # causes that move the targets in addition to the joints
    wrong: tuple[str, ...]  # labels of single postures whose readings are wrong

    @property
    def finds_nothing(self) -> bool:
        """True if the readings were tested, and neither a mistake in the data nor a cause was found."""
        return self.screening is not None and not self.causes


def _choose_explanation(joints: JointsAlone, screening: Screening | None) -> _Explanation:
    """Return the mistakes in the data that the checks found, or else the causes of the residuals."""
    noticed: Sequence[Finding] = joints.noticed
    has_gross_error = any(finding.weight == "do_not_use" for finding in noticed)
    # With a gross error in the data, tests of smaller effects mean nothing.
    if screening is None or has_gross_error:
        return _Explanation(noticed, has_gross_error, None, (), ())
    wrong = _list_unreported_postures(screening, noticed)
    return _Explanation(noticed, has_gross_error, screening, screening.causes, wrong)


def _list_unreported_postures(screening: Screening, noticed: Sequence[Finding]) -> tuple[str, ...]:
    """Return the labels of postures with wrong readings, except those that another finding names.

    If causes were found, all are returned, because the causes were fitted without these postures.
    """
    if screening.causes:
        return screening.wrong
    named = {finding.observation for finding in noticed}
    return tuple(label for label in screening.wrong if label not in named)


def _list_reasons(
    joints: JointsAlone,
    estimate: Estimate,
    prediction: Prediction,
    explanation: _Explanation,
    unloading: Unloading | None,
) -> Iterator[Finding]:
    """Yield all findings on the readings and on the fit.

    Args:
        joints: identification by joints alone.
        estimate: estimate to be assessed.
        prediction: prediction of the same measurements by the estimate.
        explanation: what explains the readings better than the joints with the data as given.
        unloading: positions after the load was removed; None if none was read.
    """
    yield from _report_explanation(joints, explanation)
    yield from find_reading_problems(
        joints.robot,
        joints.measurements,
        joints.settings,
        prediction,
        explanation.noticed,
        labels=joints.labels,
        wrong=explanation.wrong,
        cause_found=bool(explanation.causes),
    )
    if unloading is not None and unloading.remains:
        yield report_remaining_deflection(unloading)
    yield from _report_encoders_against_targets(joints)
    yield from find_fit_problems(
        _AssessedFit.of(joints, estimate, prediction),
        explanation.screening,
        explained=explanation.has_gross_error,
        cause_found=bool(explanation.causes),
    )


def _report_explanation(joints: JointsAlone, explanation: _Explanation) -> Iterator[Finding]:
    """Yield findings on what explains the readings better than the joints with the data as given.

    The unit of forces is checked by the stiffnesses, unless a mistake in the data changes the stiffnesses.
    """
    measurements = joints.measurements
    if explanation.causes:
        fitted_count = sum(bool(term.words) for term in fitted_errors(measurements).terms)
        most = MAX_CAUSES - fitted_count
        # The causes were fitted with the scatter that tests count, so that the joints alone are, too.
        tested = describe(joints.identified.tested)
        yield report_causes(
            explanation.causes, tested, explanation.wrong, most=most, loads=(joints.robot, measurements)
        )
    yield from report_fitted_causes(measurements)
    if not explanation.has_gross_error:
        # The arms with which the stiffnesses are compared were fitted by joints alone.
        yield from inspect_force_unit(joints.robot, measurements, joints.estimate.joints)


def _describe_assumed_point(stated: float | None) -> str:
    """Return the sentence on a load point without a ground; `stated` is a smaller stated uncertainty [m]."""
    stated_text = "" if stated is None else f", as nothing states how it is known to ±{length_text(stated)}"
    return (
        f"The load point is assumed to be known to ±{1e3 * ASSUMED_LOAD_POINT:g} mm{stated_text}. State how "
        "you know it: by tracker ±1 mm, from a drawing ±3 mm, by hand ±10 mm (`noise.grounds.load_point`; on "
        "the page: Advanced, How the load point is known)."
    )


def _list_notes(measurements: Measurements, estimate: Estimate, unloading: Unloading | None) -> Iterator[str]:
    """Yield sentences on assumptions, and on checks that the readings do not allow."""
    largest_force = float(np.linalg.norm(measurements.force, axis=1).max())
    if largest_force > 0.0:
        yield _describe_load_and_deflection(measurements, largest_force)
    yield from _describe_assumptions(measurements, estimate)
    # A target in the flange frame has deflections, but no unloaded position.
    has_no_positions = bool(measurements.in_flange[measurements.present].all())
    if unloading is not None:
        yield describe_unloading(unloading)
    elif not has_no_positions:
        yield _NO_SECOND_READING
    if has_no_positions:
        yield _NO_POSITIONS


def _describe_assumptions(measurements: Measurements, estimate: Estimate) -> Iterator[str]:
    """Yield a sentence for each uncertainty of the loads that was assumed, because none was stated.

    An assumption is named only if the error changes a compliance of the estimate.
    """
    common = estimate.common  # effects of errors that all readings share, such as of the load point
    if common is None:
        return
    if common.responses_to("assumed_load_point").any():
        yield _describe_assumed_point(measurements.common_uncertainty.doubtful_load_point)
    if common.responses_to("assumed_force_scale").any():
        yield _ASSUMED_SCALE_OF_FORCES


def _describe_load_and_deflection(measurements: Measurements, largest_force: float) -> str:
    """Return a sentence by which a user may notice that forces have another unit than declared."""
    largest_deflection = float(np.linalg.norm(measurements.deflection, axis=2).max())
    newtons_of_kgf = float(np.linalg.norm(STANDARD_GRAVITY))
    return (
        f"Forces up to {figure(largest_force)} N ({figure(largest_force / newtons_of_kgf, '.3g')} kgf), "
        f"deflections up to {length_text(largest_deflection)}. If N and kgf were confused, every stiffness "
        f"would be wrong by a factor of {newtons_of_kgf:.3g}, and no reading would show it."
    )


def _list_notes_on_encoders(joints: JointsAlone) -> Iterator[str]:
    """Yield sentences on noise that the encoders do not state, and on structure that they do not see."""
    if joints.apart is None:
        return
    yield from _describe_noisy_encoders(joints, joints.apart)
    if joints.apart.shows_structure:
        yield (
            "The targets show other deflections than the encoders (chi-square test, "
            f"p = {joints.apart.p_value:.1g}): structure behind the encoders bends, too. The joints are "
            "identified from the targets alone; `gearboxes` and `structures` are the two parts of their "
            "compliances."
        )


def _describe_noisy_encoders(joints: JointsAlone, apart: Apart) -> Iterator[str]:
    """Yield a sentence on encoders that scatter more than stated, such as `joint_2 12 µrad`."""
    encoders = joints.measured.encoders
    stated_noise = 0.0 if encoders is None else encoders.sigma  # [rad]
    noise_texts = []
    for joint, noise in zip(apart.joints.tolist(), apart.noise.tolist(), strict=True):
        if noise > _NOISY * stated_noise:
            noise_texts.append(f"{joints.robot.joint_names[joint]} {1e6 * noise:.2g} µrad")
    if noise_texts:
        yield (
            f"The encoders scatter more than the {1e6 * stated_noise:.2g} µrad that are stated, such as by "
            f"play in the gears: {', '.join(noise_texts)}. The intervals account for this."
        )


def _report_encoders_against_targets(joints: JointsAlone) -> Iterator[Finding]:
    """Yield a finding for each joint whose encoder shows more deflection than the targets.

    The encoder sees the gearbox alone, and the targets see gearbox and structure, so that the structure would
    need a negative compliance: its part of the gearbox's compliance is how much more the encoder shows.
    """
    apart = joints.apart
    if apart is None:
        return
    compared_joints = apart.joints.tolist()
    for joint in apart.against.tolist():
        gearbox, structure = apart.free_compliance[:, compared_joints.index(joint)].tolist()
        excess_percent = -100.0 * structure / gearbox
        yield _report_excessive_encoder(joints.robot.joint_names[joint], excess_percent)


def _report_excessive_encoder(name: str, excess_percent: float) -> Finding:
    """Return the finding that a joint's encoder shows more deflection than the targets."""
    return Finding(
        code="encoder_deflection_implausibly_large",
        weight="use_with_care",
        message=f"the encoder of {name} shows {excess_percent:.2g} % more deflection "
        "than the targets, which nothing behind the encoder explains",
        remedy="check that the encoder's angles are those of the model's joint, in `units.angle`, and "
        "the unit of the targets' lengths",
        where=name,
    )


def describe_unloading(unloading: Unloading) -> str:
    """Return a sentence on the positions after the load was removed."""
    count = unloading.postures
    plural = "s" if count > 1 else ""
    text = (
        f"After unloading, the targets return to within {length_text(unloading.distance)} (root mean square, "
        f"{count} posture{plural} read again after unloading)"
    )
    if unloading.share is None or unloading.standard_uncertainty is None:
        return f"{text}."
    share = f"{100.0 * unloading.share:.2g} %"
    uncertainty = f"{100.0 * unloading.standard_uncertainty:.2g} %"
    return f"{text}; {share} of the deflection remains (u = {uncertainty})."


def report_remaining_deflection(unloading: Unloading) -> Finding:
    """Return the finding that a part of the deflections remains after the load was removed."""
    share, u = unloading.share or 0.0, unloading.standard_uncertainty or 0.0
    return Finding(
        code="deflection_remains",
        weight="use_with_care",
        message=f"{100.0 * share:.2g} % of the deflection remains after unloading (u = {100.0 * u:.2g} %): "
        "the stiffnesses refer to the mean of the unloaded positions before and after the load; with only "
        f"one of these positions the stiffnesses would differ by {50.0 * abs(share):.2g} %",
        remedy="load and unload the arm once before the first reading; check that tool, hook and base are "
        "tight",
    )


def derive_assessment(joints: Sequence[JointCompliance], findings: Iterable[Finding]) -> Assessment:
    """Return the assessment that follows from findings and from the status of each joint.

    The verdict is the weight of the most severe finding; reasons and remarks are in order of severity.
    """
    ordered = tuple(sorted(findings, key=lambda finding: -_ORDER[finding.weight]))
    joint_names = {joint.name for joint in joints}
    verdicts = [_judge_joint(joint, joint_names, ordered) for joint in joints]
    return Assessment(
        verdict=ordered[0].weight if ordered else "use",
        reasons=tuple(finding for finding in ordered if not finding.is_remark),
        remarks=tuple(finding for finding in ordered if finding.is_remark and finding.code not in QUESTIONS),
        questions=tuple(finding for finding in ordered if finding.code in QUESTIONS),
        joints=tuple(verdicts),
    )


def is_negative(joint: JointCompliance) -> bool:
    """Return whether a joint has a negative compliance, which no spring has."""
    return joint.compliance is not None and joint.compliance < 0.0


def _judge_joint(joint: JointCompliance, joint_names: Set[str], findings: Sequence[Finding]) -> Verdict:
    """Return the verdict on a joint: the most severe of its status, and of findings that concern it.

    A finding concerns the joint unless its place `where` is another joint; a finding without a place concerns
    the whole set.
    """
    if is_negative(joint):
        return "do_not_use"
    other_joints = joint_names - {joint.name}
    weights = [finding.weight for finding in findings if finding.where not in other_joints]
    verdict_by_status = _BY_STATUS[joint.status]
    return max([verdict_by_status, *weights], key=lambda verdict: _ORDER[verdict])


def report_causes(
    causes: Sequence[Cause],
    estimate: Estimate,
    wrong: Sequence[str] = (),
    *,
    most: int = MAX_CAUSES,
    loads: tuple[Robot, Measurements] | None = None,
) -> Finding:
    """Return the finding that joints and causes explain the readings better than joints alone.

    The weight of the finding is "do_not_use" if the causes make links unnecessary and change a compliance by
    more than `HARMFUL`, unless the intervals cover the change.

    Args:
        causes: causes that were found, step by step.
        estimate: estimate by joints alone.
        wrong: labels of single postures whose readings are wrong, which were left out.
        most: largest number of causes that a run may fit in addition to those that it fits already.
        loads: robot and measurements, by which the sizes of causes are judged; None if all are plausible.
    """
    selected = _SelectedCauses.group(causes)
    change = _measure_changes(causes, estimate)
    is_mistake = selected.make_links_unnecessary and change.is_harmful
    weight: Verdict = "do_not_use" if is_mistake else "use_with_care"
    change_text = f"compliances change by up to {100 * change.largest:.2g} %"
    remedies: list[str] = []
    if loads is not None:
        robot, measurements = loads
        selected = selected.leave_out_implausible(measurements)
        if selected.has_empty_step:  # in this step no cause has a plausible size
            return _report_unknown_cause(causes, weight, change_text)
        point_in_base = _describe_point_in_base(robot, measurements, selected)
        if point_in_base:
            change_text += point_in_base
            remedies.append("give the load point in the flange frame, not its place in R0")
    remedies += selected.list_remedies(wrong)
    causes_to_fit = selected.choose_to_fit(most)
    return Finding(
        code="alternative_explains_better",
        weight=weight,
        message=f"{selected.describe(wrong)}; {change_text}",
        remedy="; ".join(dict.fromkeys(remedies)),  # each remedy once
        action=AdvisedAction.of("fit_causes", wrong, causes=causes_to_fit) if causes_to_fit else None,
    )


def _report_unknown_cause(causes: Sequence[Cause], weight: Verdict, change_text: str) -> Finding:
    """Return the finding that an error explains the readings, but no error of a plausible size does."""
    p_value = max(cause.p_value for cause in causes)
    return Finding(
        code="alternative_explains_better",
        weight=weight,
        message="the loads as given do not explain the readings: with another error of the loads, the joints "
        f"would explain them significantly better (F test, p = {p_value:.1g}), but no error of a plausible "
        f"size does; {change_text}",
        remedy="check axes, signs and units of the forces, the point about which moments are given, and the "
        "load point",
    )


def _describe_point_in_base(robot: Robot, measurements: Measurements, selected: _SelectedCauses) -> str:
    """Return the end of a sentence on a load point that was stated in R0; empty if no cause shows this.

    With the fitted error, the hook of an observation is in R0 where the load point was stated.
    """
    points = measurements.load_point
    is_stated_once = np.ptp(points, axis=0).max() <= SAME_PLACE
    is_far = float(np.linalg.norm(points[0])) > _LEAST_IN_BASE
    errors = [
        cause.unknowns for step in selected.steps for cause in step if cause.suspect.name == "load_point"
    ]
    if not errors or not is_stated_once or not is_far:
        return ""
    on_flange = np.broadcast_to(points[0] + errors[0], (len(measurements), 1, 3))
    in_base = unloaded_postures(robot, measurements).to_base(on_flange)[:, 0]
    distances = np.linalg.norm(in_base - points[0], axis=1)
    nearest = int(distances.argmin())
    if distances[nearest] > _NEAR_HOOK:
        return ""
    return (
        "; the stated load point seems to be a place in R0, that of the hook in "
        f"'{measurements.labels[nearest]}', but must be in the flange frame, there about "
        f"{unknowns_text('m', on_flange[0, 0].tolist())}"
    )


@dataclass(frozen=True, eq=False)
class _SelectedCauses:
    """Causes that were found step by step.

    Causes of one step explain the readings equally well, such as a load point elsewhere *or* a moment that
    was forgotten; causes of several steps explain the readings together.
    """

    steps: Sequence[Sequence[Cause]]  # the best cause of a step comes first

    @classmethod
    def group(cls, causes: Sequence[Cause]) -> _SelectedCauses:
        """Group causes by their step, whose order they have already."""
        return cls([list(step) for _, step in groupby(causes, key=lambda cause: cause.step)])

    def leave_out_implausible(self, measurements: Measurements) -> _SelectedCauses:
        """Return the causes of a plausible size; a step that has none of them is empty.

        A force is plausible up to a multiple of the largest stated force, and in any size if none is stated.
        """
        largest_force = float(np.linalg.norm(measurements.force, axis=1).max())
        limits = _LARGEST_CAUSES | {"N": _LARGEST_BY_LOAD * largest_force or np.inf}
        steps = []
        for step in self.steps:
            plausible = []
            for cause in step:
                limit = limits.get(cause.suspect.term.unit, np.inf)
                if np.linalg.norm(cause.unknowns) <= limit:
                    plausible.append(cause)
            steps.append(plausible)
        return _SelectedCauses(steps)

    @property
    def has_empty_step(self) -> bool:
        """True if a step has no cause, so that the causes of all other steps do not explain the readings."""
        return not all(self.steps)

    @property
    def make_links_unnecessary(self) -> bool:
        """True if nothing is left for links to explain when all causes are fitted."""
        return all(cause.makes_links_unnecessary for cause in self.steps[-1])

    @property
    def are_not_linear(self) -> bool:
        """True if play and curved springs explain the readings equally well."""
        return any({cause.suspect.name for cause in step} == _NOT_LINEAR for step in self.steps)

    def choose_to_fit(self, most: int) -> list[NamedCause]:
        """Return the causes that a run should fit, at most `most`: the best of each step, then the others.

        A cause has its name and the label of the first observation that it affects.
        """
        best_of_steps = [step[0] for step in self.steps]
        ties = [cause for step in self.steps for cause in step[1:]]
        chosen = [*best_of_steps, *ties][:most]
        return [NamedCause(name=cause.suspect.name, first=cause.suspect.first) for cause in chosen]

    def list_remedies(self, wrong: Sequence[str]) -> list[str]:
        """Return a remedy for each cause, and one for the postures whose readings are wrong.

        Only readings at a smaller load distinguish play from curved springs, so that these two have a remedy
        in common.
        """
        causes = [cause for step in self.steps for cause in step]
        remedies = []
        if self.are_not_linear:
            remedies.append(_READ_HALF)
            causes = [cause for cause in causes if cause.suspect.name not in _NOT_LINEAR]
        remedies += [cause.suspect.term.remedy for cause in causes]
        if wrong:
            remedies.append(f"repeat the readings of {_name_postures(wrong)}")
        return remedies

    def describe(self, wrong: Sequence[str]) -> str:
        """Return what the causes explain, in words; `wrong` are the postures that were left out."""
        nature = "the joints are not linear: " if self.are_not_linear else ""
        left_out = f"without {_name_postures(wrong)}, and " if wrong else ""
        causes_text = ", and with ".join(_describe_tie(step) for step in self.steps)
        p_value = max(cause.p_value for step in self.steps for cause in step)
        links_text = "" if self.make_links_unnecessary else ", but links may bend as well"
        return (
            f"{nature}{left_out}with {causes_text}, the joints explain the readings significantly better "
            f"(F test, p = {p_value:.1g}){links_text}"
        )


class _Change(NamedTuple):
    """Change of compliances by causes that are fitted with the joints."""

    largest: float  # relative to the compliance
    is_harmful: bool  # whether a change is larger than an engineer would accept


def _measure_changes(causes: Sequence[Cause], estimate: Estimate) -> _Change:
    """Return by how much the causes change the compliances, and whether a change does harm.

    A change does harm if it exceeds `HARMFUL`. If the load point is the only cause, it must also exceed
    `COVERED` times the uncertainty by the load point, which the intervals contain already.
    """
    load_point_alone = all(cause.suspect.name == "load_point" for cause in causes)
    covered = np.zeros(len(estimate.compliance))  # (n,) largest change that is harmless [rad/(N·m)]
    if load_point_alone and estimate.common is not None:
        covered = COVERED * _compute_uncertainty_by_load_point(estimate.common)
    largest, is_harmful = 0.0, False
    for cause in causes:
        is_known = estimate.estimated & (estimate.compliance > 0.0) & (cause.compliance > 0.0)
        compliance = estimate.compliance[is_known]
        change = np.abs(cause.compliance[is_known] / compliance - 1.0)
        harmful = (change > HARMFUL) & (change * compliance > covered[is_known])
        largest = max(largest, float(change.max(initial=0.0)))
        is_harmful |= bool(harmful.any())
    return _Change(largest, is_harmful)


def _compute_uncertainty_by_load_point(common: CommonErrors) -> FloatArray:
    """Return the standard uncertainty (n,) of each compliance by that of the load point [rad/(N·m)].

    Responses (n, 3) are the changes of the compliances by one standard uncertainty along each axis.
    """
    by_assumption = common.responses_to("assumed_load_point")
    by_statement = common.responses_to("load_point")
    return np.asarray(np.linalg.norm(np.hstack([by_assumption, by_statement]), axis=1))


def _name_postures(labels: Sequence[str]) -> str:
    """Return the labels of postures as a list in words."""
    return ", ".join(f"'{label}'" for label in labels)


def _describe_tie(causes: Sequence[Cause]) -> str:
    """Return causes that explain the readings equally well, with their sizes, in words."""
    texts = []
    for cause in causes:
        term = cause.suspect.term
        texts.append(term.words.format(unknowns_text(term.unit, cause.unknowns.tolist())))
    return ", or with ".join(texts)


def _report_wrong_postures(
    measurements: Measurements, settings: Settings, wrong: Sequence[str]
) -> Iterator[Finding]:
    """Yield a finding on single postures whose readings disagree with all others.

    The Huber loss already gives such readings a small weight; dial gauges do not support this loss.
    """
    if not wrong or settings.loss == "huber":
        return
    is_dial_gauge = measurements.direction is not None
    yield Finding(
        code="residual_outlier",
        weight="use_with_care",
        observation=wrong[0],
        message=f"the readings of {_name_postures(wrong)} disagree with the joint stiffnesses that fit "
        "all other readings (F test)",
        remedy="check these readings and their loads; repeat the readings, or identify with loss huber",
        action=AdvisedAction.of("show_posture" if is_dial_gauge else "use_huber", wrong),
    )


def report_fitted_causes(measurements: Measurements) -> Iterator[Finding]:
    """Yield a finding for each cause that was fitted with the joints: the cause's stated value is wrong.

    Some terms are no causes: they only widen the uncertainty of another term. They have no words.
    """
    fitted = fitted_errors(measurements)
    uncertainties = np.linalg.norm(fitted.root, axis=1)  # standard uncertainties of the unknowns of all terms
    start = 0
    for term, values in zip(fitted.terms, fitted.unknowns, strict=True):
        uncertainty = uncertainties[start : start + len(values)]
        start += len(values)
        if term.words:
            yield _report_fitted_cause(term, values, uncertainty)


def _report_fitted_cause(term: Term, values: FloatArray, uncertainty: FloatArray) -> Finding:
    """Return the finding on a cause that was fitted, such as a load point elsewhere by (3, 0, −2) mm.

    Args:
        term: how the cause moves the targets, with words in which `{}` is its size.
        values: (k,) fitted unknowns in the unit of the term.
        uncertainty: (k,) their standard uncertainties; two of them are half a 95 % interval.
    """
    value_text = unknowns_text(term.unit, values.tolist())
    half_width_text = unknowns_text(term.unit, (2.0 * uncertainty).tolist())
    cause_text = term.words.format(f"{value_text} ± {half_width_text}")
    return Finding(
        code="cause_fitted",
        weight="use_with_care",
        message=f"{cause_text} (95 %) was fitted with the joints; the intervals include the "
        "uncertainty of this cause, and the readings contradict the stated value",
        remedy=term.remedy,
    )


def find_reading_problems(
    robot: Robot,
    measurements: Measurements,
    settings: Settings,
    prediction: Prediction,
    findings: Sequence[Finding],
    *,
    labels: tuple[str, ...],
    wrong: Sequence[str] = (),
    cause_found: bool = False,
) -> Iterator[Finding]:
    """Yield findings on problems of the readings.

    Findings of the integrity checks are merged into one for each kind, and findings on the whole set come
    first.

    Args:
        robot: n joints.
        measurements: N observations.
        settings: settings of the fit.
        prediction: prediction of these measurements.
        findings: findings of the integrity checks.
        labels: labels of all observations, with those that were refuted and left out.
        wrong: labels of single postures whose readings disagree with all others.
        cause_found: whether a cause explains the readings, and the finding about it names these postures.
    """
    yield from _report_load_at_target(robot, measurements)
    outliers = [finding for finding in findings if finding.code == "residual_outlier"]
    others = [finding for finding in findings if finding.code != "residual_outlier"]
    yield from _merge_mistakes(others, labels)
    yield from _merge_doubts(others, labels)
    if cause_found:  # a robust loss is no mend for a cause that moves many postures
        unnamed = [finding for finding in outliers if finding.observation not in wrong]
        yield from _report_outlying(measurements, settings, prediction, unnamed, mend="show_posture")
    elif outliers:
        yield from _report_outlying(measurements, settings, prediction, outliers)
    else:
        yield from _report_wrong_postures(measurements, settings, wrong)
    yield from _report_small_deflections(measurements)


def _merge_mistakes(findings: Sequence[Finding], labels: tuple[str, ...]) -> Iterator[Finding]:
    """Yield one finding for each kind of mistake that forbids the use, those on the whole set first.

    `labels` are the labels of all observations; an action may leave out some observations.
    """
    mistakes = _group_by_code(findings, "do_not_use")
    mistakes.sort(key=lambda group: group[0].observation is not None)
    for group in mistakes:
        yield _summarise_findings(group, _advise_leaving_out(group, labels))


def _merge_doubts(findings: Sequence[Finding], labels: tuple[str, ...]) -> Iterator[Finding]:
    """Yield one finding for each kind of doubt about the readings, with the action to show its postures.

    `labels` are the labels of all observations.
    """
    for group in _group_by_code(findings, "use_with_care"):
        observations = _list_observations(labels, group)
        action = AdvisedAction.of("show_posture", observations) if observations else None
        yield _summarise_findings(group, action)


def _advise_leaving_out(group: Sequence[Finding], labels: tuple[str, ...]) -> AdvisedAction | None:
    """Return the action to leave out the observations that findings of one code name, if these are few.

    Otherwise return the action of the first finding. `labels` are the labels of all observations.
    """
    first, observations = group[0], _list_observations(labels, group)
    if first.code == "target_moved" and first.observation is not None:
        row = labels.index(first.observation)
        # The target moved between two observations and stayed there: leave out those before or those after,
        # whichever are fewer.
        observations = min(labels[row:], labels[:row], key=len)
    is_unit_mistake = first.code in _CODES_OF_LENGTH_UNITS  # all observations have this mistake
    are_few = 0 < len(observations) <= MOST_LEFT_OUT * len(labels)
    if are_few and not is_unit_mistake:
        return AdvisedAction.of("leave_out_readings", observations)
    return first.action


def _report_small_deflections(measurements: Measurements) -> Iterator[Finding]:
    """Yield a finding if no deflection is larger than its noise."""
    if measurements.sigma is None:
        return
    noise = np.sqrt(2.0) * measurements.sigma  # a deflection is a difference of two readings
    greatest = float(np.linalg.norm(measurements.deflection, axis=2).max())
    if greatest <= NOISE_SIGMAS * noise:
        yield Finding(
            code="deflections_below_noise",
            weight="use_with_care",
            message=f"no target moved by more than {length_text(greatest)}, and the noise of a deflection is "
            f"{length_text(noise)}: these readings give only lower limits of the stiffnesses",
            remedy="increase the load; check that the loaded readings were taken with the load applied, and "
            "check the stated noise",
        )


def _report_load_at_target(robot: Robot, measurements: Measurements) -> Iterator[Finding]:
    """Yield a finding if the load point coincides with one of several targets, where a reflector sits.

    A single target may well be at the tool's point, so it is not reported.
    """
    part = measurements.select_evenly(_PLACES)
    target_count = part.present.shape[1]
    if target_count < 2 or not part.force.any():
        return
    distances = _measure_distances_to_load(robot, part)
    nearest = int(distances.argmin())
    if distances[nearest] <= SAME_PLACE:
        yield Finding(
            code="load_at_target",
            weight="use_with_care",
            message=f"the load point coincides with target {nearest + 1}, where a reflector is mounted",
            remedy="check the load point in the flange frame",
            action=AdvisedAction.of("exchange_load_and_target", target=measurements.targets[nearest]),
        )


def _measure_distances_to_load(robot: Robot, measurements: Measurements) -> FloatArray:
    """Return the largest distance (T,) of each target from the load point over all observations [m].

    The distance is inf for a target of unknown place: one without an observation of all three coordinates.
    """
    # Places (N, T, 3) of the targets in the flange frame [m].
    places = np.where(
        measurements.in_flange[..., None], measurements.position, targets_in_flange(robot, measurements)
    )
    distances = np.linalg.norm(places - measurements.load_point[:, None], axis=2)  # (N, T)
    is_known = (measurements.coordinates == 3).any(axis=0)
    return np.where(is_known, distances.max(axis=0), np.inf)


def _report_outlying(
    measurements: Measurements,
    settings: Settings,
    prediction: Prediction,
    outliers: Sequence[Finding],
    mend: ActionKind = "use_huber",
) -> Iterator[Finding]:
    """Yield a finding on observations that joint springs fitted to all observations do not explain.

    A few such observations are wrong readings, for which the Huber loss is proposed; many mean that the model
    lacks something, such as links that bend. Outliers that links or fitted causes explain are not reported.
    """
    residuals = np.linalg.norm(prediction.residual, axis=2).max(axis=1)  # (N,) largest of each observation
    more_than_joints_fitted = prediction.contributions is None or bool(fitted_errors(measurements).terms)
    if more_than_joints_fitted:
        outliers = _keep_outlying(outliers, measurements.labels, residuals)
    observations = _list_observations(measurements.labels, outliers)
    if not observations:
        return
    count = _count_as_large(residuals, [measurements.labels.index(label) for label in observations])
    if count >= FEW * len(measurements):
        yield _report_many_outliers(count, len(measurements), observations)
    elif settings.loss != "huber":
        # Dial gauges, which read in one direction only, do not support the Huber loss.
        is_dial_gauge = measurements.direction is not None
        action = AdvisedAction.of("show_posture" if is_dial_gauge else mend, observations)
        yield _summarise_findings(outliers, action)


def _keep_outlying(
    outliers: Sequence[Finding], labels: Sequence[str], residuals: FloatArray
) -> list[Finding]:
    """Return the findings on outliers that the present model leaves unexplained, too.

    An observation is outlying if its residual is above `OUTLYING` times the median residual.

    Args:
        outliers: findings on outliers of joints alone; one without an observation concerns the whole set.
        labels: labels of the N observations.
        residuals: (N,) largest residual of each observation by the present model [m].
    """
    still_outlying = np.flatnonzero(residuals > OUTLYING * np.median(residuals))
    outlying_labels = {labels[i] for i in still_outlying.tolist()}
    return [each for each in outliers if each.observation is None or each.observation in outlying_labels]


def _count_as_large(residuals: FloatArray, rows: Sequence[int]) -> int:
    """Return the number of residuals (N,) that are at least as large as the least of those in some rows."""
    return int((residuals >= residuals[rows].min()).sum())


def _report_many_outliers(count: int, total: int, observations: Sequence[str]) -> Finding:
    """Return the finding that so many observations disagree that they cannot be single wrong readings.

    Args:
        count: number of observations that disagree.
        total: number of all observations.
        observations: labels of the observations that the user should look at.
    """
    return Finding(
        code="deflection_unexplained",
        weight="use_with_care",
        message=f"{count} of {total} observations disagree with the joint stiffnesses that "
        "fit the other observations. These are too many for single wrong readings: something besides "
        "the joints bends, or angles or loads are wrong",
        remedy="check these postures; if the readings are right, try elasticity joints_and_links",
        action=AdvisedAction.of("show_posture", observations),
    )


def _group_by_code(findings: Sequence[Finding], weight: Verdict) -> list[list[Finding]]:
    """Return the findings of one weight in groups of the same code, in the order in which codes appear."""
    of_weight = [finding for finding in findings if finding.weight == weight]
    codes = dict.fromkeys(finding.code for finding in of_weight)
    return [[finding for finding in of_weight if finding.code == code] for code in codes]


def _list_observations(labels: Sequence[str], group: Sequence[Finding]) -> tuple[str, ...]:
    """Return the labels of the observations that the findings name, in the order of the set."""
    named = {finding.observation for finding in group}
    return tuple(label for label in labels if label in named)


def _summarise_findings(group: Sequence[Finding], action: AdvisedAction | None) -> Finding:
    """Return a group's first finding with an action, and the observations of the others in the message."""
    first, others = group[0], group[1:]
    message = first.message + describe_others([finding.observation for finding in others])
    return first.model_copy(update={"message": message, "action": action})


@dataclass(frozen=True, eq=False)
class _AssessedFit:
    """Fit that is assessed, with the readings from which it was made."""

    measurements: Measurements  # N observations
    estimate: Estimate  # from these measurements
    prediction: Prediction  # of these measurements by the estimate
    pure_error: PureError | None  # noise of the readings whatever the model; None if they do not show it

    @classmethod
    def of(cls, joints: JointsAlone, estimate: Estimate, prediction: Prediction) -> _AssessedFit:
        """Gather an estimate from the readings of an identification, with the noise that the targets show."""
        return cls(
            joints.measurements, estimate, prediction, measure_pure_error(joints.rows, estimate, prediction)
        )

    @property
    def only_joints_bend(self) -> bool:
        """True if the model has neither links nor a base that bend."""
        return self.prediction.contributions is not None

    @property
    def sigma_was_stated(self) -> bool:
        """True if the user stated the noise, even if the readings refuted it."""
        return self.estimate.sigma_given or self.measurements.refuted_sigma is not None


def find_fit_problems(
    fit: _AssessedFit, screening: Screening | None, *, explained: bool, cause_found: bool
) -> Iterator[Finding]:
    """Yield findings on problems of an estimate and its prediction.

    A finding of the weight `use` does not change the verdict.

    Args:
        fit: estimate and prediction, with the readings.
        screening: tests for other causes of the deflections; None without tests.
        explained: whether another finding already explains large residuals, which are then not reported.
        cause_found: whether a cause explains the readings; large residuals are then no sign of large noise.
    """
    implausible = list(report_implausible_results(fit.estimate))
    mistaken_priors = [finding for finding in implausible if _is_mistaken_prior(finding)]
    yield from mistaken_priors
    yield from _report_unidentified(fit.estimate)
    yield from _report_freedom(fit)
    yield from _report_few_postures(fit.measurements)
    if not explained and not mistaken_priors:  # a mistaken prior leaves large residuals
        yield from _report_residuals(fit, cause_found=cause_found)
        yield from _report_unexplained_motion(fit, screening)
        yield from _report_unexplained(fit)
        yield from _report_dropped_statements(fit)
    yield from (finding for finding in implausible if finding not in mistaken_priors)
    yield from report_solver(fit.estimate.certificates)
    yield from _report_links(fit.prediction, screening)


def _report_unexplained_motion(fit: _AssessedFit, screening: Screening | None) -> Iterator[Finding]:
    """Yield a finding if the model leaves more of the flange's motion than the readings' noise.

    Other findings report causes that move the flange, links or a base that bend, and residuals beyond a
    stated noise.
    """
    if fit.pure_error is None or not fit.pure_error.shows_motion:
        return
    has_causes = screening is not None and bool(screening.causes)
    links_or_base_bend = fit.prediction.bending is not None
    is_reported_elsewhere = has_causes or links_or_base_bend or fit.sigma_was_stated
    if not is_reported_elsewhere:
        yield report_unexplained_motion(fit.pure_error)


def _report_unidentified(estimate: Estimate) -> Iterator[Finding]:
    """Yield a finding if no joint is identified, with the likely reason."""
    statuses = [joint.status for joint in estimate.joints]
    all_seem_rigid = set(statuses) - {"not_observable"} == {"at_bound"}
    if not all_seem_rigid:
        yield from report_no_identified_joint(statuses, "add postures and loads that twist the joints")
    elif _fits_with_opposite_sign(estimate):
        remedy = "exchange unloaded and loaded readings, or change the sign of every force"
        action = AdvisedAction.of("exchange_readings")
        yield from report_no_identified_joint(statuses, remedy, action)
    else:
        remedy = (
            "choose another robot, or check the joint map and the frame of the forces: the joints of "
            "the chosen robot would move the targets in another way"
        )
        yield from report_no_identified_joint(statuses, remedy)


def _report_negative(joints: Sequence[JointCompliance]) -> Iterator[Finding]:
    """Yield a finding for each joint with a negative compliance, which a fit without bounds may find."""
    for joint in filter(is_negative, joints):
        yield Finding(
            code="stiffness_negative",
            weight="use_with_care",
            where=joint.name,
            message=f"the stiffness of {joint.name} is negative, which is not physical",
            remedy="identify with compliances that are not negative, or measure postures that load the joint",
        )


def _report_poorly_known(estimate: Estimate) -> Iterator[Finding]:
    """Yield a finding for each joint that may carry the deflection and is not known within the goal."""
    for joint, share in zip(estimate.joints, estimate.greatest_shares.tolist(), strict=True):
        if joint.compliance_interval is None or is_negative(joint):
            continue
        lower, upper = joint.compliance_interval
        if share < CARRIES or upper <= GOAL * lower:
            continue
        # Rounded up, so that the factor is shown greater than the goal
        factor = figure(math.ceil(100.0 * upper / lower) / 100.0, ".3g") if lower > 0.0 else None
        known = "from one side only" if factor is None else f"to a factor of {factor}"
        yield Finding(
            code="joint_poorly_known",
            weight="use_with_care",
            where=joint.name,
            message=f"the stiffness is known {known}, and the joint may carry "
            f"{100.0 * min(share, 1.0):.0f} % of the deflection; the goal is a factor of {GOAL:g} "
            "between the ends of its interval",
            remedy=f"measure more postures and loads that twist {joint.name}; a plan proposes them",
        )


def _fits_with_opposite_sign(estimate: Estimate) -> bool:
    """Return whether the joints explain most of the deflections once every deflection is negated.

    Then unloaded and loaded readings are exchanged, or all forces have the wrong sign.
    """
    deflections = estimate.compressed.all_readings.rhs
    _, residual_of_negated = solve_nonnegative(estimate.regressor, -deflections)
    return bool(residual_of_negated < (1.0 - UNUSABLE_SHARE) * np.linalg.norm(deflections))


def _report_few_postures(measurements: Measurements) -> Iterator[Finding]:
    """Yield a finding if the set has fewer distinct postures than `_LEAST_POSTURES`."""
    count = _count_distinct_postures(measurements.joints, most=_LEAST_POSTURES)
    if count < _LEAST_POSTURES:
        yield Finding(
            code="few_postures",
            weight="use_with_care",
            message=f"the set has {count} distinct posture{'s' if count > 1 else ''}, so the "
            "stiffnesses were not tested in other postures",
            remedy=f"measure at least {_LEAST_POSTURES} postures that differ by {np.degrees(_DISTINCT):.0f}° "
            "or more",
        )


def _count_distinct_postures(joints: FloatArray, *, most: int) -> int:
    """Return the number of postures (N, n) that all differ by `_DISTINCT` in a joint, at most `most`.

    The count ends at `most`, because a set may have thousands of postures.
    """
    distinct_postures: list[FloatArray] = []
    for posture in joints:
        if all(np.abs(posture - other).max() >= _DISTINCT for other in distinct_postures):
            distinct_postures.append(posture)
        if len(distinct_postures) >= most:
            break
    return len(distinct_postures)


def _report_dropped_statements(fit: _AssessedFit) -> Iterator[Finding]:
    """Yield a finding if stated errors could not be fitted together with the joints.

    Fits of links and base have the stated errors of their own, so that those of the joints do not count.
    """
    estimate = fit.estimate
    links_or_base_bend = fit.prediction.bending is not None
    if links_or_base_bend or not estimate.estimated.any():
        return
    if estimate.statements_dropped is not None:
        yield Finding(
            code="statement_dropped",
            weight="use_with_care",
            message="what is stated of load and places could not be fitted together with the joints: "
            f"{estimate.statements_dropped}",
            remedy="check the stated load point and the units of force and length",
        )


def report_solver(certificates: Sequence[Certificate]) -> Iterator[Finding]:
    """Yield a finding if the solver Clarabel, run on the same problems, misses a certified optimum."""
    for certificate in certificates:
        witness = certificate.witness  # comparison of Clarabel's answer with the certified one
        if witness is None or witness.agrees:
            continue
        difference = "gave no answer"
        if np.isfinite(witness.distance):
            difference = f"differs by {witness.distance:.1g} of the readings, more than {witness.limit:.0e}"
        yield Finding(
            code="solver_disagrees",
            weight="use",
            message=f"Clarabel's own answer {difference}; the numbers stand, as the certificate proves them",
            remedy="reinstall the package clarabel, and report this problem with the data",
        )
        return  # one finding is enough


def report_no_identified_joint(
    statuses: Sequence[str], remedy: str, action: AdvisedAction | None = None
) -> Iterator[Finding]:
    """Yield a finding if no joint has the status `identified`.

    Args:
        statuses: status of each joint.
        remedy: remedy of the finding.
        action: proposed action of the finding.
    """
    if "identified" in statuses:
        return
    counts = Counter(status.replace("_", " ") for status in statuses)
    counts_text = ", ".join(f"{count} {status}" for status, count in counts.items())
    yield Finding(
        code="no_joint_identified",
        weight="do_not_use",
        message=f"the readings identify no joint: {counts_text}",
        remedy=remedy,
        action=action,
    )


def measure_pure_error(rows: Rows, estimate: Estimate, prediction: Prediction) -> PureError | None:
    """Return the noise of the readings whatever the model; None if the readings do not show it."""
    measurements = rows.measurements
    reading_count = float(measurements.coordinates.sum())
    if measurements.encoders is not None:
        reading_count += float(measurements.encoders.present.sum())
    fitted_unknowns = reading_count - estimate.degrees_of_freedom
    return compute_pure_error(rows, prediction.residual, fitted_unknowns)


def report_unexplained_motion(pure_error: PureError) -> Finding:
    """Return the finding that the model leaves more of the flange's motion than the readings' noise."""
    return Finding(
        code="sigma_implausible",
        weight="use_with_care",
        message="targets of the same posture show that the tracker reads to within "
        f"{length_text(pure_error.sigma)}, but the model does not explain {length_text(pure_error.left)} "
        f"of the flange's motion (F test, p = {pure_error.p_value:.1g}). This unexplained motion is "
        "counted as noise",
        remedy="check loads, angles and geometry, and read one posture again without the load; if the robot "
        "returns to a posture less exactly, state `noise.repeatability`",
    )


def _report_freedom(fit: _AssessedFit) -> Iterator[Finding]:
    """Yield a finding if the fit has no degrees of freedom, or residuals too small or large for a tracker."""
    estimate = fit.estimate
    if _count_freedom(fit) < _LEAST_FREEDOM:
        yield _report_exact_fit(estimate)
    elif estimate.sigma is not None and not estimate.sigma_given:  # sigma comes from the residuals
        noise_is_shown = fit.pure_error is not None  # other findings compare the residuals with that noise
        if estimate.sigma < LEAST_SIGMA:
            yield _report_vanishing_residuals(estimate.sigma)
        elif estimate.sigma > LARGEST_SIGMA and not noise_is_shown:
            yield _report_implausible_sigma(estimate.sigma)


def _count_freedom(fit: _AssessedFit) -> float:
    """Return the degrees of freedom of a fit, in which targets of one posture are not counted too often.

    A rigid flange moves by six coordinates at most, however many targets it has: four targets on a flange are
    12 numbers, but determine no more than six unknowns.
    """
    measurements, estimate = fit.measurements, fit.estimate
    coordinates = int(np.minimum(measurements.coordinates.sum(axis=1), 6).sum())
    if measurements.encoders is not None:
        coordinates += int(measurements.encoders.present.sum())
    return min(estimate.degrees_of_freedom, coordinates - estimate.rank)


def _report_exact_fit(estimate: Estimate) -> Finding:
    """Return the finding that the fit has as many parameters as readings."""
    weight: Verdict = "do_not_use"
    consequence = "the uncertainty is unknown"
    if estimate.sigma_given:
        weight = "use_with_care"
        consequence = "the uncertainty comes from the stated noise only"
    return Finding(
        code="no_residual_freedom",
        weight=weight,
        message="there are as many parameters as readings, so the fit reproduces any readings exactly: "
        f"{consequence}",
        remedy="measure at least twice as many observations",
    )


def _report_vanishing_residuals(sigma: float) -> Finding:
    """Return the finding that residuals of the size sigma [m] are too small for readings of a tracker."""
    return Finding(
        code="residuals_vanish",
        weight="use_with_care",
        message=f"the residuals give a standard uncertainty of {length_text(sigma)} per reading, but "
        f"for a tracker at least {length_text(LEAST_SIGMA)} is plausible: these readings are computed, "
        "not measured, so the uncertainties are meaningless",
        remedy=f"state `noise` from the tracker's data sheet; {PAST_CARE}",
    )


def _report_implausible_sigma(sigma: float) -> Finding:
    """Return the finding that residuals of the size sigma [m] are too large for readings of a tracker."""
    return Finding(
        code="sigma_implausible",
        weight="use_with_care",
        message=f"the residuals give a standard uncertainty of {length_text(sigma)} per coordinate of a "
        f"reading, but laser trackers have 10 to 40 µm, and at most {length_text(LARGEST_SIGMA)} is "
        "plausible: most of this value comes from deflections that the model does not explain",
        remedy="state `noise` from the instrument's data sheet; check geometry, angles and loads, and "
        f"whether links bend; {PAST_CARE}",
    )


def report_refuted_noise(measurements: Measurements, sigma: float | None) -> Iterator[Finding]:
    """Yield a finding if the stated noise was refuted and sigma [m] comes from the residuals instead.

    Such a sigma counts deflections that the model does not explain as noise.
    """
    refuted = measurements.refuted_sigma
    if refuted is not None and sigma is not None:
        yield Finding(
            code="residuals_exceed_sigma",
            weight="use_with_care",
            message=f"the stated standard uncertainty is {length_text(refuted)} per coordinate of a reading, "
            f"but the residuals give {length_text(sigma)}, {figure(sigma / refuted, '.3g')} times as "
            "much: deflections that the model does not explain are counted as noise",
            remedy=_CHECK_NOISE,
        )


def _report_residuals(fit: _AssessedFit, *, cause_found: bool) -> Iterator[Finding]:
    """Yield a finding if the residuals are larger or smaller than the stated sigma predicts.

    `cause_found` tells whether a cause explains the readings: then the stated noise may well be right.
    """
    estimate, test = fit.estimate, fit.estimate.sigma_test
    yield from report_refuted_noise(fit.measurements, estimate.sigma)
    freedom = max(estimate.degrees_of_freedom, _LEAST_FREEDOM)
    ratio = float(np.sqrt(estimate.chi_square / freedom))  # size of the residuals relative to sigma
    if test is None or test.result == "consistent" or abs(ratio - 1.0) < WORTH_A_WARNING:
        return
    if test.result == "residuals_too_small":
        yield _report_overstated_sigma(ratio, test.p_value)
    else:
        weight = _weigh_large_residuals(ratio, test.p_value, only_joints_bend=fit.only_joints_bend)
        yield _report_understated_sigma(ratio, weight, fit.pure_error, cause_found=cause_found)


def _report_overstated_sigma(ratio: float, p_value: float) -> Finding:
    """Return the finding that the residuals are only `ratio` times as large as the stated sigma predicts."""
    chance = "p < 0.001" if p_value < 0.001 else f"p = {p_value:.1g}"
    return Finding(
        code="sigma_overstated",
        weight="use",
        message=f"the residuals are only {figure(ratio, '.3g')} times as large as sigma predicts "
        f"(chi-square test, {chance}), so the uncertainties are too large",
        remedy="check `noise` and `units.length`; omit `noise` so that sigma is estimated from the residuals",
    )


def _weigh_large_residuals(ratio: float, p_value: float, *, only_joints_bend: bool) -> Verdict:
    """Return how much residuals count that are `ratio` times as large as the stated sigma predicts.

    Residuals by chance do not count, nor do slightly larger ones of a model with links, whose penalty
    enlarges them.
    """
    may_be_chance = p_value > CARE_LEVEL
    may_be_penalty = not only_joints_bend and ratio <= CARE_RATIO_OF_LINKS
    if may_be_chance or may_be_penalty:
        return "use"
    return "use_with_care" if ratio <= UNUSABLE_RATIO else "do_not_use"


def _report_understated_sigma(
    ratio: float, weight: Verdict, pure_error: PureError | None, *, cause_found: bool
) -> Finding:
    """Return the finding that the residuals are `ratio` times as large as the stated sigma predicts.

    Args:
        ratio: size of the residuals relative to sigma.
        weight: weight of the finding.
        pure_error: noise of the readings whatever the model; None if the readings do not show it.
        cause_found: whether a cause explains the readings, which is then to be fitted first.
    """
    agreement = ""
    if pure_error is not None and pure_error.shows_motion:
        agreement = (
            f". Targets of one posture agree to within {length_text(pure_error.sigma)}, so the flange "
            "moves differently from the model"
        )
    return Finding(
        code="residuals_exceed_sigma",
        weight=weight,
        message=f"the residuals are {figure(ratio, '.3g')} times as large as the stated noise allows, so "
        "the uncertainties are too small; how much too small depends on the deflections that the "
        f"model does not explain{agreement}",
        remedy=_FIT_CAUSES_FIRST if cause_found else _CHECK_NOISE,
        action=None if cause_found else AdvisedAction.of("omit_noise"),
    )


def _report_unexplained(fit: _AssessedFit) -> Iterator[Finding]:
    """Yield a finding if the joints explain too small a share of the deflections.

    If the stated noise explains the residuals, the finding has the weight `use`.
    """
    share, is_noise = fit.prediction.compensation, residuals_within_noise(fit.estimate)
    least_share = UNUSABLE_SHARE if is_noise else CARE_SHARE
    if share is None or share >= least_share:
        return
    weight: Verdict = "use_with_care" if share >= UNUSABLE_SHARE else "do_not_use"
    yield Finding(
        code="deflection_unexplained",
        weight="use" if is_noise else weight,  # noise is no fault of the model
        message=f"the joints explain only {100 * share:.3g} % of the mean deflection; the joints of "
        "industrial robots usually explain about 80 %",
        remedy="check the robot's model, the joint map, the frame and signs of the forces, and the units",
        action=AdvisedAction.of("show_posture", [_find_worst_posture(fit)]),
    )


def _find_worst_posture(fit: _AssessedFit) -> str:
    """Return the label of the observation with the largest residual of a target."""
    residuals = np.linalg.norm(fit.prediction.residual, axis=2).max(axis=1)  # (N,) of each observation
    return fit.measurements.labels[int(residuals.argmax())]


def _is_mistaken_prior(finding: Finding) -> bool:
    """Return whether a finding says that a prior must not be used."""
    return finding.code == "prior_dominates" and finding.weight == "do_not_use"


def report_implausible_results(estimate: Estimate) -> Iterator[Finding]:
    """Yield findings on priors, on implausible stiffnesses, and on a neglected K_c that matters.

    A joint whose prior is mistaken has no other finding.
    """
    contradicted = list(_report_contradicted_priors(estimate))
    mistaken = {finding.where for finding in contradicted if _is_mistaken_prior(finding)}
    joints = [joint for joint in estimate.joints if joint.name not in mistaken]
    for joint in joints:
        if joint.prior_to_data is not None and joint.prior_to_data > 1.0:
            yield _report_dominant_prior(joint.name, joint.prior_to_data)
    yield from contradicted
    yield from report_implausible_joints(joints)
    if estimate.complementary_stiffness is not None:
        yield from _report_complementary_stiffness(estimate.complementary_stiffness)


def _report_dominant_prior(name: str, ratio: float) -> Finding:
    """Return the finding that the prior of a joint has `ratio` times the information of the readings."""
    description = f"carries {figure(ratio, '.3g')} times as much information as the readings"
    if np.isinf(ratio):
        description = "alone separates this joint from other joints"
    return Finding(
        code="prior_dominates",
        weight="use_with_care",
        message=f"the prior of {name} {description}: the estimate mainly repeats the data sheet",
        remedy="add loads and postures with more torque about the joint's axis, or omit the prior "
        "to see the result of the readings alone",
        where=name,
    )


def _report_contradicted_priors(estimate: Estimate) -> Iterator[Finding]:
    """Yield a finding for each prior that the readings alone contradict.

    With r the ratio of the prior's information to that of the readings, and s₀ the prior's standard
    uncertainty, the noise of the readings alone has the variance ``r s₀²``. In the fit with the prior this
    variance, and the response to errors that all observations share, are smaller by the factor ``1 + r``.
    """
    if estimate.covariance is None:
        return
    for joint, variance in zip(estimate.joints, np.diagonal(estimate.covariance), strict=True):
        prior, ratio = joint.prior, joint.prior_to_data
        if prior is None or ratio is None:
            continue
        noise = ratio * prior.standard_uncertainty**2
        shared = max(float(variance) - noise / (1.0 + ratio), 0.0) * (1.0 + ratio) ** 2
        deviation = _measure_deviation(prior, float(np.sqrt(noise + shared)))
        if deviation > CONTRADICTED_PRIOR:
            yield _report_contradicted_prior(joint, prior, deviation)


def _measure_deviation(prior: JointPrior, uncertainty: float) -> float:
    """Return the difference of a prior and the readings, in standard uncertainties of the difference.

    The prior is normal in the stiffness, as it was stated: 3 ± 1 N·m/rad excludes any stiff joint, although
    the compliance 0.33 ± 0.11 rad/(N·m) does not. A difference of stiffnesses times ``c c₀`` is one of the
    compliances c by the readings and c₀ by the prior, so that the uncertainty of the prior is ``s₀ c / c₀``.

    Args:
        prior: prior of the joint, and its compliance by the readings alone.
        uncertainty: standard uncertainty of the compliance by the readings alone [rad/(N·m)].
    """
    scale = prior.by_readings / prior.mean if prior.by_readings > 0.0 else 1.0
    uncertainty_of_difference = float(np.hypot(uncertainty, scale * prior.standard_uncertainty))
    return abs(prior.by_readings - prior.mean) / uncertainty_of_difference


def _is_too_narrow(prior: JointPrior) -> bool:
    """Return whether a prior states an uncertainty with which nobody knows the stiffness of a joint."""
    return prior.standard_uncertainty < NARROW_PRIOR * prior.mean


def _is_in_another_unit(prior: JointPrior) -> bool:
    """Return whether a prior that contradicts the readings differs from them by a factor of another unit."""
    return prior.by_readings > 0.0 and abs(np.log(prior.by_readings / prior.mean)) > np.log(MISTAKEN_PRIOR)


def _report_contradicted_prior(joint: JointCompliance, prior: JointPrior, deviation: float) -> Finding:
    """Return the finding that the prior of a joint contradicts the readings.

    Args:
        joint: result of the joint.
        prior: prior of the joint, and its compliance by the readings alone.
        deviation: their difference in its standard uncertainties.
    """
    unit = JOINT_UNITS[joint.kind].stiffness.replace(".", "·")
    stated = ""
    remedy = f"check the prior, and that its numbers are in {unit}; or omit the prior"
    if _is_too_narrow(prior) and not _is_in_another_unit(prior):
        relative = prior.standard_uncertainty / prior.mean
        stated = f" ± {figure(relative / prior.mean, '.3g')} {unit} ({figure(100.0 * relative, '.2g')} %)"
        tenth = figure(0.1 / prior.mean, ".3g")
        remedy = f"state the uncertainty in {unit}, such as {tenth} {unit} for 10 %; or omit the prior"
    by_prior = stiffness_text(1.0 / prior.mean, joint.kind)
    by_readings = "no stiffness above zero"
    if prior.by_readings > 0.0:
        by_readings = stiffness_text(1.0 / prior.by_readings, joint.kind)
    return Finding(
        code="prior_dominates",
        weight="do_not_use" if _is_in_another_unit(prior) or _is_too_narrow(prior) else "use_with_care",
        message=f"the prior of {joint.name}, {by_prior}{stated}, contradicts the readings, which alone give "
        f"{by_readings}: they differ by {figure(deviation, '.3g')} standard uncertainties of the difference",
        remedy=remedy,
        where=joint.name,
    )


def report_implausible_joints(joints: Sequence[JointCompliance]) -> Iterator[Finding]:
    """Yield a finding for each identified stiffness outside the range of industrial robots."""
    least, greatest = PLAUSIBLE_STIFFNESS
    identified = []
    for joint in joints:
        if joint.status == "identified" and joint.compliance is not None:
            stiffness = 1.0 / joint.compliance if joint.compliance else np.inf
            identified.append(_IdentifiedStiffness(joint.name, joint.kind, stiffness))
    implausible = [each for each in identified if not least <= abs(each.stiffness) <= greatest]
    all_are_implausible = len(implausible) == len(identified)
    for joint_stiffness in implausible:
        yield _report_implausible_stiffness(joint_stiffness, all_are_implausible=all_are_implausible)


class _IdentifiedStiffness(NamedTuple):
    """Stiffness of a joint that the readings identify."""

    name: str
    kind: JointKind
    stiffness: float  # [N·m/rad or N/m]


def _report_implausible_stiffness(joint: _IdentifiedStiffness, *, all_are_implausible: bool) -> Finding:
    """Return the finding that a stiffness is outside the range of industrial robots.

    `all_are_implausible` tells whether the stiffnesses of all identified joints are.
    """
    remedy = _advise_on_stiffness(joint, all_are_implausible=all_are_implausible)
    least, greatest = (stiffness_text(limit, joint.kind) for limit in PLAUSIBLE_STIFFNESS)
    return Finding(
        code="stiffness_implausible",
        weight="do_not_use",
        message=f"the stiffness of {joint.name} is {stiffness_text(joint.stiffness, joint.kind)}; for joints "
        f"of industrial robots, {least} to {greatest} is plausible",
        remedy=f"{remedy}; {PAST_DO_NOT_USE}",
        where=joint.name,
    )


def _advise_on_stiffness(joint: _IdentifiedStiffness, *, all_are_implausible: bool) -> str:
    """Return what to check for an implausible stiffness.

    A wrong unit scales all joints, and a wrong column or joint map changes single joints.
    """
    if joint.stiffness < 0.0:
        return (
            "set `positive` to true; check the joint map, the order of the angles, and the signs of the "
            "forces"
        )
    if all_are_implausible:
        return "check the units of force, length and moment: all joints are out of range"
    return (
        f"check the angles and the joint map of {joint.name} and its neighbours; the stiffnesses of the "
        "other joints are plausible"
    )


def _report_complementary_stiffness(size: ComplementaryStiffness) -> Iterator[Finding]:
    """Yield a finding if K_c was neglected although its effect is large, or although it was requested.

    K_c is how much the torques of a load change per turn of each joint, because the load's levers change.
    """
    if size.obstacle is not None:
        yield _report_neglected_stiffness(size.obstacle)
    elif not size.included and size.largest_shift is not None and size.largest_shift > LARGEST_SHIFT:
        yield Finding(
            code="complementary_stiffness_matters",
            weight="use_with_care",
            message="neglecting the complementary stiffness K_c biases a compliance by "
            f"{size.largest_shift:.2g} standard uncertainties",
            remedy="set complementary_stiffness: included",
            action=AdvisedAction.of("include_complementary_stiffness"),
        )


def _report_neglected_stiffness(obstacle: str) -> Finding:
    """Return the finding that a fit with the complementary stiffness K_c failed, so that K_c is neglected."""
    return Finding(
        code="complementary_stiffness_matters",
        weight="use_with_care",
        message=f"the complementary stiffness K_c had to be neglected: {obstacle}",
        remedy="check the units of force and length",
    )


def _report_links(prediction: Prediction, screening: Screening | None) -> Iterator[Finding]:
    """Yield a finding if links or base bend (method.md §7), or if joints alone do not fit the readings."""
    introduction = ""
    if screening is not None and screening.gain is not None:
        introduction = f"{_describe_evidence_of_bending(screening)}. "
    match prediction.bending:
        case "links_or_base":
            yield _report_links_or_base(prediction, introduction)
        case "base":
            yield _report_base(introduction)
        case "links":
            yield _report_bending_links(introduction)
        case None:
            if screening is not None and screening.lack_of_fit:
                yield _report_lack_of_fit(screening)


def _report_links_or_base(prediction: Prediction, introduction: str) -> Finding:
    """Return the finding that links or the base bend, and that the readings do not tell which of the two.

    The intervals contain the values of both models, unless one of the two has no certified solution.
    `introduction` is a sentence on the evidence.
    """
    intervals = "the intervals of the stiffnesses contain the values of both models"
    if not prediction.joined:
        used = prediction.predicted_by
        other = "links" if used == "base" else "base"
        intervals = (
            f"the intervals of the stiffnesses are computed from the model with {used} only, because the "
            f"model with {other} has no certified solution"
        )
    return Finding(
        code="links_or_base",
        weight="use_with_care",
        message=f"{introduction}Links or the base bend: the readings do not distinguish a model with "
        f"links from a model with a base. Predictions use the model with {prediction.predicted_by}; "
        f"{intervals}",
        remedy="turn joint 1 between the readings, or put a target on the base plate",
    )


def _report_base(introduction: str) -> Finding:
    """Return the finding that the base bends; `introduction` is a sentence on the evidence."""
    return Finding(
        code="base_bends",
        weight="use_with_care",
        message=f"{introduction}The base below the first joint bends under the load. Readings cannot "
        "distinguish a rotation of the base about the first axis from a rotation of joint 1; the "
        "stiffnesses of the other joints do not include the base",
        remedy="tighten and stiffen the base, or use the stiffnesses of joints and base together; a "
        "target on the base plate shows directly how the base moves",
    )


def _report_bending_links(introduction: str) -> Finding:
    """Return the finding that links bend with the joints; `introduction` is a sentence on the evidence."""
    return Finding(
        code="links_bend_with_joints",
        weight="use_with_care",
        message=f"{introduction}Each joint's stiffness includes some bending of its link; the bias "
        "exceeds the stated uncertainty. Predicted deflections are not affected",
        remedy="use the model to predict deflections; do not quote the stiffness of a single joint, as "
        "readings under load cannot separate a joint from its link",
    )


def _report_lack_of_fit(screening: Screening) -> Finding:
    """Return the finding that joints alone do not fit the readings.

    The remedy, to let the readings choose a model, is an action if no models were compared yet, and if the
    options of the run allow the comparison.
    """
    can_compare_models = screening.gain is None and screening.comparable
    return Finding(
        code="lack_of_fit",
        weight="use_with_care",
        message=_describe_evidence_of_bending(screening),
        remedy="set elasticity to automatic: the readings then choose the model; otherwise use these "
        "stiffnesses only for postures and loads like the measured ones, because the stiffnesses "
        "include the bending of links",
        action=AdvisedAction.of("choose_model") if can_compare_models else None,
    )


def _describe_evidence_of_bending(screening: Screening) -> str:
    """Return a text on the test of links, and on the errors of held-out postures if models were compared."""
    test = f"something besides the joints bends (F test, p = {screening.links_p_value:.1g})"
    gain = screening.gain
    if gain is None:
        return test
    return (
        f"{test}. The model with {gain.model.replace('_', ' ')} predicts held-out postures to "
        f"{length_text(gain.error)}, the model with joints alone to {length_text(gain.error_of_joints)}"
    )
