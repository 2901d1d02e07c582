"""Assessment of an identification: one verdict on whether its numbers may be used, with the reasons.

A reason says what is wrong, where, what to do, and what a program can do about it. No reason means "use":
noise alone raises one in less than one of a hundred sets.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Final, Literal

import numpy as np

from jointstiff.solver.finding import Finding, FindingCode
from jointstiff.solver.fitting import Settings
from jointstiff.solver.inference.alternatives import BetterAlternative, better_alternative, places_on_flange
from jointstiff.solver.inference.estimate import Estimate, JointCompliance
from jointstiff.solver.inference.plausibility import judge
from jointstiff.solver.inference.prediction import Prediction
from jointstiff.solver.readings import Measurements
from jointstiff.solver.robot import Robot

__all__ = ["Action", "ActionKind", "Assessment", "Place", "Reason", "ReasonCode", "Usability", "assess"]

Usability = Literal["use", "use_with_care", "do_not_use"]

ReasonCode = Literal[
    "no_joint_identified",
    "no_residual_freedom",
    "gross_error",
    "suspicious_readings",
    "length_unit_suspect",
    "residuals_exceed_sigma",
    "residuals_vanish",
    "deflection_unexplained",
    "alternative_explains_better",
    "load_at_target",
    "stiffness_implausible",
    "prior_dominates",
    "complementary_stiffness_matters",
]

ActionKind = Literal[
    "leave_out_readings",
    "use_huber",
    "include_complementary_stiffness",
    "omit_noise",
    "exchange_columns",
    "apply_joint_map",
    "exchange_load_and_target",
    "show_posture",
]

CARE_RATIO, UNUSABLE_RATIO = 1.5, 3.0
"""Residuals over what sigma allows, by which the uncertainties are too small."""
CARE_LEVEL: Final = 1e-3
"""Probability of larger residuals by chance: few readings exceed `CARE_RATIO` without a mistake."""
CARE_SHARE, UNUSABLE_SHARE = 0.7, 0.5
"""Compensation below which something besides the joints deflects; of real robots they explain 80 %."""
LEAST_SIGMA: Final = 1e-8
"""No tracker reads this well [m]: such residuals are those of computed readings."""
SAME_PLACE: Final = 2e-3
"""Distance of a load point from a target [m] that robots' models cannot tell from none."""
FEW: Final = 0.1
"""Share of suspicious readings that the Huber loss, or leaving them out, copes with."""
_LEAST_FREEDOM: Final = 0.5
_PLACES: Final = 60

_ORDER: Final[dict[Usability, int]] = {"use": 0, "use_with_care": 1, "do_not_use": 2}


@dataclass(frozen=True)
class Place:
    """What a reason is about: one observation or one joint.

    Attributes:
        observation: its index; None for a joint.
        joint: its name; None for an observation.
    """

    observation: int | None = None
    joint: str | None = None


@dataclass(frozen=True)
class Action:
    """What a program can do at a click.

    Attributes:
        kind: which action.
        observations: indices of the observations to leave out, or to show.
        joints: names of the joints whose columns are exchanged.
        joint_map: rows of the corrected joint map's matrix M, its offset unchanged; empty for other kinds.
        target: index of the target to be exchanged with the load point; None for other kinds.
    """

    kind: ActionKind
    observations: tuple[int, ...] = ()
    joints: tuple[str, ...] = ()
    joint_map: tuple[tuple[float, ...], ...] = ()
    target: int | None = None


@dataclass(frozen=True)
class Reason:
    """One reason not to use the numbers without further ado.

    Attributes:
        code: its kind.
        weight: the best verdict that a result with this reason can have.
        where: the observation or joint; None for the whole set.
        message: what is wrong, with figure and unit.
        remedy: what to do about it.
        action: what a program can do about it; None where only people can.
    """

    code: ReasonCode
    weight: Literal["use_with_care", "do_not_use"]
    where: Place | None
    message: str
    remedy: str
    action: Action | None = None


@dataclass(frozen=True)
class Assessment:
    """The verdict on a whole result and on each joint.

    Attributes:
        verdict: the least of what the reasons allow.
        reasons: most severe first; none where the verdict is "use".
        joints: verdict on each joint, never better than what the reasons about the set or this joint allow.
    """

    verdict: Usability
    reasons: tuple[Reason, ...]
    joints: tuple[Usability, ...]


def assess(
    robot: Robot,
    measurements: Measurements,
    settings: Settings,
    estimate: Estimate,
    prediction: Prediction,
    findings: Sequence[Finding] = (),
) -> Assessment:
    """Assess an identification.

    Args:
        robot: n joints.
        measurements: N observations.
        settings: how it was identified.
        estimate: of the joints.
        prediction: by that estimate, of the same measurements.
        findings: of the integrity checks of the same measurements.

    Returns:
        The verdict with its reasons.
    """
    better = None if _within_noise(estimate) else better_alternative(robot, measurements)
    found = chain(
        _identified(estimate),
        _freedom(estimate),
        _alternative(robot, better),
        _load_at_target(robot, measurements),
        _gross_errors(findings),
        _suspicious(measurements, settings, findings),
        _residuals(estimate),
        _unexplained(estimate, prediction),
        _from_judge(estimate, prediction),
    )
    reasons = tuple(sorted(found, key=lambda reason: -_ORDER[reason.weight]))
    return Assessment(
        verdict=_least(reason.weight for reason in reasons),
        reasons=reasons,
        joints=tuple(_joint(joint, reasons) for joint in estimate.joints),
    )


def _within_noise(estimate: Estimate) -> bool:
    """Tell whether the residuals leave nothing for another explanation."""
    test = estimate.sigma_test
    return test is not None and test.verdict != "residuals_too_large"


def _least(verdicts: Iterator[Usability]) -> Usability:
    return max(verdicts, key=_ORDER.__getitem__, default="use")


def _joint(joint: JointCompliance, reasons: tuple[Reason, ...]) -> Usability:
    """Return the verdict on a joint by its status, capped by the reasons that concern it."""
    own: Usability = "do_not_use"
    if joint.status == "identified":
        own = "use"
    elif joint.status in {"at_bound", "uncertain"}:
        own = "use_with_care"
    others = (r.weight for r in reasons if r.where is None or r.where.joint in {None, joint.name})
    return _least(iter([own, *others]))


def _identified(estimate: Estimate) -> Iterator[Reason]:
    if any(joint.status == "identified" for joint in estimate.joints):
        return
    causes = "; ".join(f"{joint.name}: {joint.reason}" for joint in estimate.joints[:3] if joint.reason)
    yield Reason(
        "no_joint_identified",
        "do_not_use",
        None,
        f"the readings identify no joint ({causes})",
        "add postures and loads that twist the joints, or constrain fewer of them",
    )


def _freedom(estimate: Estimate) -> Iterator[Reason]:
    if estimate.degrees_of_freedom < _LEAST_FREEDOM:
        unknown = estimate.sigma is None
        yield Reason(
            "no_residual_freedom",
            "do_not_use" if unknown else "use_with_care",
            None,
            "there are as many parameters as readings, so the fit is exact whatever was measured: "
            + ("no uncertainty is known" if unknown else "only the stated noise says how certain it is"),
            "add observations, at least twice as many as now",
        )
    elif estimate.sigma is not None and not estimate.sigma_given and estimate.sigma < LEAST_SIGMA:
        yield Reason(
            "residuals_vanish",
            "use_with_care",
            None,
            f"by the residuals a reading is certain to {estimate.sigma:.2g} m, and no tracker is: these "
            "readings are computed, not measured, and the uncertainties mean nothing",
            "state `noise` as the tracker's data sheet gives it",
        )


def _alternative(robot: Robot, better: BetterAlternative | None) -> Iterator[Reason]:
    if better is None:
        return
    what, remedy, action = _undone(robot, better)
    yield Reason(
        "alternative_explains_better",
        "do_not_use",
        None,
        f"{what}, the joints explain {100 * better.compensation:.3g} % of the mean deflection instead of "
        f"{100 * better.compensation_as_given:.3g} %; the sum of squared residuals falls to "
        f"{100 * better.ratio:.2g} %",
        remedy,
        action,
    )


def _undone(robot: Robot, better: BetterAlternative) -> tuple[str, str, Action]:
    """Describe an alternative: what is changed, what to check, what to do at a click."""
    alternative = better.alternative
    names = tuple(robot.joint_names[j] for j in alternative.joints)
    if alternative.kind == "columns_exchanged":
        both = f"the columns of {names[0]} and {names[1]}"
        return (
            f"with {both} exchanged",
            f"check {both}; exchange them",
            Action("exchange_columns", joints=names),
        )
    if alternative.kind == "load_and_target_exchanged":
        action = Action("exchange_load_and_target", target=alternative.target)
        what = f"with the load applied at target {(alternative.target or 0) + 1}"
        return what, "check the load point and the target's place in the flange frame; exchange them", action
    matrix = robot.joint_map.matrix @ alternative.matrix
    action = Action("apply_joint_map", joints=names, joint_map=tuple(map(tuple, matrix.tolist())))
    if alternative.kind == "sign_reversed":
        return f"with the sign of {names[0]} reversed", "check the joint map's signs", action
    sign = (
        "added to" if alternative.matrix[alternative.joints[1], alternative.joints[0]] > 0 else "taken from"
    )
    what = f"with the controller's angle of {names[0]} {sign} that of {names[1]}"
    return what, "check whether the controller couples these joints; correct the joint map", action


def _load_at_target(robot: Robot, measurements: Measurements) -> Iterator[Reason]:
    """Report a load at one of several targets, where a reflector sits; one target may be the tool's point."""
    count = min(len(measurements), _PLACES)
    part = measurements[np.linspace(0, len(measurements) - 1, count).astype(np.intp)]
    if part.present.shape[1] < 2 or not part.force.any():
        return
    apart = np.linalg.norm(places_on_flange(robot, part) - part.load_point[:, None], axis=2).max(axis=0)
    t = int(apart.argmin())
    if apart[t] <= SAME_PLACE:
        yield Reason(
            "load_at_target",
            "use_with_care",
            None,
            f"the load point is the place of target {t + 1}, where a reflector sits",
            "check the load point in the flange frame",
            Action("exchange_load_and_target", target=t),
        )


_LENGTHS: Final[frozenset[FindingCode]] = frozenset(
    {"length_unit_suspect", "deflection_implausibly_large", "deflection_implausibly_small"}
)
_HARMLESS: Final[frozenset[FindingCode]] = frozenset(
    {"zero_load", "deflection_below_noise", "target_name_suspect", "deflections_unexplained"}
)
"""Warnings that cost information but bias nothing, or that `deflection_unexplained` says better."""


def _gross_errors(findings: Sequence[Finding]) -> Iterator[Reason]:
    for same in _by_code(findings, "error"):
        first = same[0]
        yield Reason(
            "length_unit_suspect" if first.code in _LENGTHS else "gross_error",
            "do_not_use",
            _place(first),
            _with_count(same),
            first.remedy,
            None if first.observation is None else Action("leave_out_readings", _observations(same)),
        )


def _suspicious(
    measurements: Measurements, settings: Settings, findings: Sequence[Finding]
) -> Iterator[Reason]:
    """Report warnings of the integrity checks; the Huber loss copes with a few outliers."""
    for same in _by_code(findings, "warning"):
        first, few = same[0], len(_observations(same)) <= FEW * len(measurements)
        outliers = first.code == "residual_outlier"
        if first.code in _HARMLESS or (outliers and few and settings.loss == "huber"):
            continue
        yield Reason(
            "suspicious_readings",
            "use_with_care",
            _place(first),
            _with_count(same),
            first.remedy,
            _action_of(same, use_huber=outliers and few),
        )


def _action_of(same: Sequence[Finding], *, use_huber: bool) -> Action | None:
    observations = _observations(same)
    if not observations:
        return None
    return Action("use_huber" if use_huber else "show_posture", observations)


def _by_code(findings: Sequence[Finding], severity: str) -> Iterator[list[Finding]]:
    """Group the findings of a severity by their code, in the order of their first."""
    groups: dict[FindingCode, list[Finding]] = {}
    for finding in findings:
        if finding.severity == severity:
            groups.setdefault(finding.code, []).append(finding)
    yield from groups.values()


def _observations(same: Sequence[Finding]) -> tuple[int, ...]:
    return tuple(sorted({f.observation for f in same if f.observation is not None}))


def _place(finding: Finding) -> Place | None:
    return None if finding.observation is None else Place(observation=finding.observation)


def _with_count(same: Sequence[Finding]) -> str:
    others = len(same) - 1
    return same[0].message + (f" (and {others} more of this kind)" if others else "")


def _residuals(estimate: Estimate) -> Iterator[Reason]:
    """Compare the residuals with a stated sigma."""
    test = estimate.sigma_test
    if test is None or test.verdict != "residuals_too_large" or test.p_value > CARE_LEVEL:
        return
    ratio = float(np.sqrt(estimate.chi_square / estimate.degrees_of_freedom))
    if ratio > CARE_RATIO:
        yield Reason(
            "residuals_exceed_sigma",
            "use_with_care" if ratio <= UNUSABLE_RATIO else "do_not_use",
            None,
            f"the residuals are {ratio:.3g} times what the stated noise allows, so the uncertainties are too "
            "small by as much",
            "check frames, joint map, units and noise; if all are correct, something besides the joints "
            "deflects: omit `noise` so that sigma is estimated from the residuals",
            Action("omit_noise"),
        )


def _unexplained(estimate: Estimate, prediction: Prediction) -> Iterator[Reason]:
    """Report deflections that the joints do not explain and that are not the stated noise either."""
    share = prediction.compensation
    if share is None or share >= CARE_SHARE or _within_noise(estimate):
        return
    norm = np.linalg.norm(prediction.residual, axis=2).max(axis=1)
    yield Reason(
        "deflection_unexplained",
        "use_with_care" if share >= UNUSABLE_SHARE else "do_not_use",
        None,
        f"the joints explain {100 * share:.3g} % of the mean deflection; of industrial robots they explain "
        "about 80 %",
        "check the robot's model and joint map, the frame and signs of the forces, and the units",
        Action("show_posture", (int(norm.argmax()),)),
    )


def _from_judge(estimate: Estimate, prediction: Prediction) -> Iterator[Reason]:
    """Turn what the plausibility checks find of single joints and of K_c into reasons."""
    for finding in judge(estimate, prediction):
        where = None if finding.joint is None else Place(joint=finding.joint)
        if finding.code == "stiffness_implausible":
            yield Reason(finding.code, "do_not_use", where, finding.message, finding.remedy)
        elif finding.code == "prior_dominates":
            yield Reason(finding.code, "use_with_care", where, finding.message, finding.remedy)
        elif finding.code == "complementary_stiffness_matters":
            action = Action("include_complementary_stiffness")
            yield Reason(finding.code, "use_with_care", where, finding.message, finding.remedy, action)
