"""Reasons in the readings: mistakes that their checks found, and one that would explain them better."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Action, Finding, FindingCode, Verdict
from jointstiff.solver.evidence.alternatives import BetterAlternative, places_on_flange
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.evidence.prediction import Prediction
from jointstiff.solver.evidence.screening import Screening
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.readings.measurements import NOISE_SIGMAS, Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.text import length_text

SAME_PLACE: Final = 2e-3
"""Distance between load point and target [m] below which they count as the same."""
OUTLYING: Final = 6.0
"""Residual over the median, beyond which a model of more than joints does not explain an observation."""
FEW: Final = 0.1
"""Largest share of suspicious readings that the Huber loss, or omitting them, can handle."""
MOST_LEFT_OUT: Final = 0.3
"""Largest share of the observations that an action leaves out: beyond it something else is wrong."""
HARMFUL: Final = 0.05
"""Relative change of a compliance above which a proved mistake in the load forbids its use."""
COVERED: Final = 2.0
"""Standard uncertainties by the load point that the intervals hold of one that is elsewhere."""
_PLACES: Final = 60


def alternative_reason(robot: Robot, measurements: Measurements, better: BetterAlternative) -> Finding:
    """Report the mistake that would explain the readings far better."""
    what, remedy, action = _undone(robot, measurements, better)
    return Finding(
        code="alternative_explains_better",
        weight="do_not_use",
        message=(
            f"{what}, the joints explain {100 * better.compensation:.3g} % of the mean deflection instead of "
            f"{100 * better.compensation_as_given:.3g} %; the sum of squared residuals falls to "
            f"{100 * better.ratio:.2g} %"
        ),
        remedy=remedy,
        action=action,
    )


def load_mistake_reasons(screening: Screening, estimate: Estimate) -> Iterator[Finding]:
    """Report a load point elsewhere or a constant force beside the load.

    It forbids the numbers where it is proved, and a compliance would change by more than `HARMFUL` and by
    more than the intervals hold of a load point elsewhere: a load point stated to 1 mm that is 10 mm off
    contradicts the statement, while the intervals of an assumed one hold 10 mm.
    """
    mistake = screening.mistake
    if mistake is None:
        return
    action: Action | None
    x, y, z = mistake.correction
    if mistake.kind == "load_point":
        moved = f"({1e3 * x:.3g}, {1e3 * y:.3g}, {1e3 * z:.3g}) mm"
        what = f"with every load point moved by {moved} in the flange frame"
        remedy = "measure the load point; if it is there, correct it"
        action = Action.of("correct_load_point", correction=(float(x), float(y), float(z)))
    else:
        what = f"with a constant force of ({x:.3g}, {y:.3g}, {z:.3g}) N (axes of R0) added to every load"
        remedy = "check for a weight that hangs on the flange only while loaded, and for the load cell's zero"
        action = Action.of("correct_force", correction=(float(x), float(y), float(z)))
        if mistake.movement_as_well:
            what += ", or with tracker or base moved between the unloaded and the loaded readings"
            remedy = (
                "read a posture again without the load: if it is elsewhere, tracker or base moved; if not, "
                f"{remedy}"
            )
            action = None
    known = estimate.estimated & (estimate.compliance > 0.0) & (mistake.compliance > 0.0)
    change = np.abs(mistake.compliance[known] / estimate.compliance[known] - 1.0)
    harmful = change > HARMFUL
    if mistake.kind == "load_point" and estimate.common is not None:
        # What the intervals hold of a load point elsewhere does no harm.
        sources = [estimate.common.of("assumed_load_point"), estimate.common.of("load_point")]
        held = np.linalg.norm(np.hstack(sources)[known], axis=1)
        harmful &= change * estimate.compliance[known] > COVERED * held
    beside = "" if mistake.proved else ", but links may bend beside it"
    yield Finding(
        code="alternative_explains_better",
        weight="do_not_use" if mistake.proved and harmful.any() else "use_with_care",
        message=(
            f"{what}, the joints explain the readings better than chance allows (F test, "
            f"p = {mistake.p_value:.1g}){beside}; a compliance changes by "
            f"{100 * change.max(initial=0.0):.2g} %"
        ),
        remedy=remedy,
        action=action,
    )


def _undone(robot: Robot, measurements: Measurements, better: BetterAlternative) -> tuple[str, str, Action]:
    """Describe an alternative: what is changed, what to check, what to do at a click."""
    alternative = better.alternative
    names = tuple(robot.joint_names[j] for j in alternative.joints)
    if alternative.kind == "columns_exchanged":
        both = f"the columns of {names[0]} and {names[1]}"
        remedy = f"check {both}; if they are exchanged, exchange them back"
        return f"with {both} exchanged", remedy, Action.of("exchange_columns", joints=names)
    if alternative.kind == "load_and_target_exchanged":
        t = alternative.target or 0
        action = Action.of("exchange_load_and_target", target=measurements.targets[t])
        what = f"with the load applied at target {t + 1}"
        remedy = "check the load point and the target's position in the flange frame; if they are exchanged, "
        return what, remedy + "exchange them back", action
    matrix = robot.joint_map.matrix @ alternative.matrix
    offset = robot.joint_map.matrix @ alternative.offset + robot.joint_map.offset
    if alternative.kind == "zero_offset":  # whole turns bring the angles within the limits
        off = robot.limits.mean(axis=1) - np.median(measurements.joints, axis=0) @ matrix.T - offset
        offset = offset + 2.0 * np.pi * np.round(np.where(np.isfinite(off), off, 0.0) / (2.0 * np.pi))
    action = Action.of(
        "apply_joint_map",
        joints=names,
        joint_map=tuple(map(tuple, matrix.tolist())),
        offset=tuple(offset.tolist()),
    )
    if alternative.kind == "zero_offset":
        turn = f"{np.degrees(alternative.offset[alternative.joints[0]]):+.0f}°"
        what = f"with the zero of {names[0]} offset by {turn}"
        return (
            what,
            f"check where the controller's zero of {names[0]} is; correct the joint map's offset",
            action,
        )
    if alternative.kind == "joint_map":
        what = f"with another joint map for {', '.join(names)}"
        return what, "check signs and coupling of the joint map against the controller's manual", action
    if alternative.kind == "sign_reversed":
        return f"with the sign of {names[0]} reversed", "check the joint map's signs", action
    driver, driven = alternative.joints
    sign = "added to" if alternative.matrix[driven, driver] > 0 else "taken from"
    what = f"with the controller's angle of {names[0]} {sign} that of {names[1]}"
    remedy = "check in the manual whether the controller couples these joints, and correct the joint map"
    return what, remedy, action


def load_reasons(robot: Robot, measurements: Measurements) -> Iterator[Finding]:
    """Report a load at one of several targets, where a reflector sits; one target may be the tool's point."""
    part = measurements.evenly(_PLACES)
    if part.present.shape[1] < 2 or not part.force.any():
        return
    apart = np.linalg.norm(places_on_flange(robot, part) - part.load_point[:, None], axis=2)
    apart = np.where((part.coordinates == 3).any(axis=0), apart, np.inf).max(axis=0)
    t = int(apart.argmin())
    if apart[t] <= SAME_PLACE:
        yield Finding(
            code="load_at_target",
            weight="use_with_care",
            message=f"the load point coincides with target {t + 1}, a reflector",
            remedy="check the load point in the flange frame",
            action=Action.of("exchange_load_and_target", target=measurements.targets[t]),
        )


_LENGTHS: Final[frozenset[FindingCode]] = frozenset(
    {"length_unit_suspect", "deflection_implausibly_large", "deflection_implausibly_small"}
)


def finding_reasons(
    measurements: Measurements, settings: Settings, prediction: Prediction, findings: Sequence[Finding]
) -> Iterator[Finding]:
    """Turn the findings of the integrity checks into reasons, one for each kind."""
    yield from _gross_errors(measurements, findings)
    others = [finding for finding in findings if finding.code != "residual_outlier"]
    yield from _suspicious(measurements, others)
    outliers = [finding for finding in findings if finding.code == "residual_outlier"]
    yield from _outlying(measurements, settings, prediction, outliers)


def noise_reasons(measurements: Measurements) -> Iterator[Finding]:
    """Report deflections none of which exceeds the stated noise."""
    if measurements.sigma is None:
        return
    noise = np.sqrt(2.0) * measurements.sigma
    greatest = float(np.linalg.norm(measurements.deflection, axis=2).max())
    if greatest <= NOISE_SIGMAS * noise:
        yield Finding(
            code="deflections_below_noise",
            weight="use_with_care",
            message=(
                f"no target moved by more than {length_text(greatest)}, and the noise of a deflection is "
                f"{length_text(noise)}: these readings give only lower limits of the stiffnesses"
            ),
            remedy=(
                "increase the load; check that the loaded readings were taken with the load applied, and "
                "check the stated noise"
            ),
        )


def _gross_errors(measurements: Measurements, findings: Sequence[Finding]) -> Iterator[Finding]:
    """Report errors, those of the whole set first; a wrong unit, or most of a set, is not to be left out."""
    labels = measurements.labels
    kinds = sorted(_by_code(findings, "do_not_use"), key=lambda same: same[0].observation is not None)
    for same in kinds:
        first, observations = same[0], _observations(measurements, same)
        if first.code == "target_moved" and first.observation is not None:
            row = labels.index(first.observation)
            # A target that stays elsewhere is two targets.
            observations = min(labels[row:], labels[:row], key=len)
        some = first.code not in _LENGTHS and 0 < len(observations) <= MOST_LEFT_OUT * len(labels)
        yield Finding(
            code="length_unit_suspect" if first.code in _LENGTHS else "gross_error",
            weight="do_not_use",
            where=first.where,
            observation=first.observation,
            message=_with_count(same),
            remedy=first.remedy,
            action=Action.of("leave_out_readings", observations) if some else first.action,
        )


def _suspicious(measurements: Measurements, findings: Sequence[Finding]) -> Iterator[Finding]:
    """Report what the integrity checks want to be checked."""
    for same in _by_code(findings, "use_with_care"):
        first, observations = same[0], _observations(measurements, same)
        yield Finding(
            code="suspicious_readings",
            weight="use_with_care",
            where=first.where,
            observation=first.observation,
            message=_with_count(same),
            remedy=first.remedy,
            action=Action.of("show_posture", observations) if observations else None,
        )


def _outlying(
    measurements: Measurements, settings: Settings, prediction: Prediction, outliers: Sequence[Finding]
) -> Iterator[Finding]:
    """Report observations that springs fitted to all do not explain.

    A few are wrong readings, and the Huber loss copes with them; many are a model that lacks something, such
    as links that bend. What a model of more than joints explains is no outlier.
    """
    norm = np.linalg.norm(prediction.residual, axis=2).max(axis=1)
    if prediction.contributions is None:
        typical = float(np.median(norm))
        beyond = {measurements.labels[i] for i in np.flatnonzero(norm > OUTLYING * typical)}
        outliers = [f for f in outliers if f.observation is None or f.observation in beyond]
    observations = _observations(measurements, outliers)
    if not observations:
        return
    count = int((norm >= norm[[measurements.labels.index(label) for label in observations]].min()).sum())
    if count < FEW * len(measurements):
        if settings.loss != "huber":
            yield Finding(
                code="suspicious_readings",
                weight="use_with_care",
                where=outliers[0].where,
                observation=outliers[0].observation,
                message=_with_count(outliers),
                remedy=outliers[0].remedy,
                action=Action.of(
                    "use_huber" if measurements.direction is None else "show_posture", observations
                ),
            )
        return
    yield Finding(
        code="deflection_unexplained",
        weight="use_with_care",
        message=(
            f"{count} of {len(measurements)} observations disagree with the joint springs that fit the "
            "others: too many for single wrong readings, so something besides the joints bends, or angles "
            "or loads are wrong"
        ),
        remedy="check these postures; if their readings are right, try elasticity joints_and_links",
        action=Action.of("show_posture", observations),
    )


def _by_code(findings: Sequence[Finding], weight: Verdict) -> Iterator[list[Finding]]:
    """Group the findings of a weight by their code, in the order of their first."""
    groups: dict[FindingCode, list[Finding]] = {}
    for finding in findings:
        if finding.weight == weight:
            groups.setdefault(finding.code, []).append(finding)
    yield from groups.values()


def _observations(measurements: Measurements, same: Sequence[Finding]) -> tuple[str, ...]:
    """Return the labels of the findings' observations, in the order of the set."""
    named = {finding.observation for finding in same}
    return tuple(label for label in measurements.labels if label in named)


def _with_count(same: Sequence[Finding]) -> str:
    others = len(same) - 1
    return same[0].message + (f" (and {others} more of this kind)" if others else "")
