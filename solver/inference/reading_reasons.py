"""Reasons in the readings: mistakes that their checks found, and one that would explain them better."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from jointstiff.solver.finding import MM_AS_M, NOISE_SIGMAS, Finding, FindingCode, length_text
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.inference.alternatives import BetterAlternative, places_on_flange
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.inference.prediction import Prediction
from jointstiff.solver.inference.reason import Action, Place, Reason
from jointstiff.solver.inference.screening import Screening
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot

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
_KILO: Final = 1e3
"""Force [N] between those of kN taken for N and of N taken for kN."""
_PLACES: Final = 60


def alternative_reason(robot: Robot, measurements: Measurements, better: BetterAlternative) -> Reason:
    """Report the mistake that would explain the readings far better."""
    what, remedy, action = _undone(robot, measurements, better)
    return Reason(
        "alternative_explains_better",
        "do_not_use",
        None,
        f"{what}, the joints explain {100 * better.compensation:.3g} % of the mean deflection instead of "
        f"{100 * better.compensation_as_given:.3g} %; the sum of squared residuals falls to "
        f"{100 * better.ratio:.2g} %",
        remedy,
        action,
    )


def load_mistake_reasons(screening: Screening, estimate: Estimate) -> Iterator[Reason]:
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
        action = Action("correct_load_point", correction=(float(x), float(y), float(z)))
    else:
        what = f"with a constant force of ({x:.3g}, {y:.3g}, {z:.3g}) N (axes of R0) added to every load"
        remedy = "check for a weight that hangs on the flange only while loaded, and for the load cell's zero"
        action = Action("correct_force", correction=(float(x), float(y), float(z)))
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
    yield Reason(
        "alternative_explains_better",
        "do_not_use" if mistake.proved and harmful.any() else "use_with_care",
        None,
        f"{what}, the joints explain the readings better than chance allows (F test, "
        f"p = {mistake.p_value:.1g}){beside}; a compliance changes by {100 * change.max(initial=0.0):.2g} %",
        remedy,
        action,
    )


def _undone(robot: Robot, measurements: Measurements, better: BetterAlternative) -> tuple[str, str, Action]:
    """Describe an alternative: what is changed, what to check, what to do at a click."""
    alternative = better.alternative
    names = tuple(robot.joint_names[j] for j in alternative.joints)
    if alternative.kind == "columns_exchanged":
        both = f"the columns of {names[0]} and {names[1]}"
        remedy = f"check {both}; if they are exchanged, exchange them back"
        return f"with {both} exchanged", remedy, Action("exchange_columns", joints=names)
    if alternative.kind == "load_and_target_exchanged":
        action = Action("exchange_load_and_target", target=alternative.target)
        what = f"with the load applied at target {(alternative.target or 0) + 1}"
        remedy = "check the load point and the target's position in the flange frame; if they are exchanged, "
        return what, remedy + "exchange them back", action
    matrix = robot.joint_map.matrix @ alternative.matrix
    offset = robot.joint_map.matrix @ alternative.offset + robot.joint_map.offset
    if alternative.kind == "zero_offset":  # whole turns bring the angles within the limits
        off = robot.limits.mean(axis=1) - np.median(measurements.joints, axis=0) @ matrix.T - offset
        offset = offset + 2.0 * np.pi * np.round(np.where(np.isfinite(off), off, 0.0) / (2.0 * np.pi))
    action = Action(
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


def load_reasons(robot: Robot, measurements: Measurements) -> Iterator[Reason]:
    """Report a load at one of several targets, where a reflector sits; one target may be the tool's point."""
    part = measurements.evenly(_PLACES)
    if part.present.shape[1] < 2 or not part.force.any():
        return
    apart = np.linalg.norm(places_on_flange(robot, part) - part.load_point[:, None], axis=2)
    apart = np.where((part.coordinates == 3).any(axis=0), apart, np.inf).max(axis=0)
    t = int(apart.argmin())
    if apart[t] <= SAME_PLACE:
        yield Reason(
            "load_at_target",
            "use_with_care",
            None,
            f"the load point coincides with target {t + 1}, a reflector",
            "check the load point in the flange frame",
            Action("exchange_load_and_target", target=t),
        )


_LENGTHS: Final[frozenset[FindingCode]] = frozenset(
    {"length_unit_suspect", "deflection_implausibly_large", "deflection_implausibly_small"}
)
_HARMLESS: Final[frozenset[FindingCode]] = frozenset(
    {"zero_load", "deflection_below_noise", "target_name_suspect", "deflections_unexplained", "base_drifted"}
)
"""Warnings that cost information but cause no bias, or that `deflection_unexplained` states better."""


def finding_reasons(
    measurements: Measurements, settings: Settings, prediction: Prediction, findings: Sequence[Finding]
) -> Iterator[Reason]:
    """Turn the findings of the integrity checks into reasons, one for each kind."""
    yield from _gross_errors(measurements, findings)
    others = [finding for finding in findings if finding.code != "residual_outlier"]
    yield from _suspicious(others)
    outliers = [finding for finding in findings if finding.code == "residual_outlier"]
    yield from _outlying(measurements, settings, prediction, outliers)


def noise_reasons(measurements: Measurements) -> Iterator[Reason]:
    """Report deflections none of which exceeds the stated noise."""
    if measurements.sigma is None:
        return
    noise = np.sqrt(2.0) * measurements.sigma
    greatest = float(np.linalg.norm(measurements.deflection, axis=2).max())
    if greatest <= NOISE_SIGMAS * noise:
        yield Reason(
            "deflections_below_noise",
            "use_with_care",
            None,
            f"no target moved by more than {length_text(greatest)}, and the noise of a deflection is "
            f"{length_text(noise)}: these readings give only lower limits of the stiffnesses",
            "increase the load; check that the loaded readings were taken with the load applied, and check "
            "the stated noise",
        )


def _mended_by(measurements: Measurements, finding: Finding) -> Action | None:
    """Return the action that undoes a mistake in a unit or in the order of the readings."""
    if finding.code == "length_unit_suspect":
        return Action("convert_units", unit="mm" if finding.remedy == MM_AS_M else "m")
    if finding.code == "angle_unit_suspect":
        # Degrees taken for radians turn joints many times; radians taken for degrees hardly move them.
        turned = float(np.abs(measurements.joints).max())
        return Action("convert_units", unit="deg" if turned > 2.0 * np.pi else "rad")
    if finding.code == "force_sign_suspect":
        return Action("exchange_readings")
    if finding.code == "force_unit_suspect":
        typical = float(np.median(np.linalg.norm(measurements.force, axis=1)))
        return Action("convert_units", unit="kN" if typical < _KILO else "N")
    return None


def _gross_errors(measurements: Measurements, findings: Sequence[Finding]) -> Iterator[Reason]:
    """Report errors, those of the whole set first; a wrong unit, or most of a set, is not to be left out."""
    count = len(measurements)
    kinds = sorted(_by_code(findings, "error"), key=lambda same: same[0].observation is not None)
    for same in kinds:
        first, observations = same[0], _observations(same)
        if first.code == "target_moved" and first.observation is not None:
            before, after = range(first.observation), range(first.observation, count)
            # A target that stays elsewhere is two targets.
            observations = tuple(before if len(before) < len(after) else after)
        some = first.code not in _LENGTHS and 0 < len(observations) <= MOST_LEFT_OUT * count
        yield Reason(
            "length_unit_suspect" if first.code in _LENGTHS else "gross_error",
            "do_not_use",
            _place(first),
            _with_count(same),
            first.remedy,
            Action("leave_out_readings", observations) if some else _mended_by(measurements, first),
        )


def _suspicious(findings: Sequence[Finding]) -> Iterator[Reason]:
    """Report warnings of the integrity checks."""
    for same in _by_code(findings, "warning"):
        first, observations = same[0], _observations(same)
        if first.code not in _HARMLESS:
            action = Action("show_posture", observations) if observations else None
            yield Reason(
                "suspicious_readings",
                "use_with_care",
                _place(first),
                _with_count(same),
                first.remedy,
                action,
            )


def _outlying(
    measurements: Measurements, settings: Settings, prediction: Prediction, outliers: Sequence[Finding]
) -> Iterator[Reason]:
    """Report observations that springs fitted to all do not explain.

    A few are wrong readings, and the Huber loss copes with them; many are a model that lacks something, such
    as links that bend. What a model of more than joints explains is no outlier.
    """
    norm = np.linalg.norm(prediction.residual, axis=2).max(axis=1)
    if prediction.contributions is None:
        typical = float(np.median(norm))
        outliers = [f for f in outliers if f.observation is None or norm[f.observation] > OUTLYING * typical]
    observations = _observations(outliers)
    if not observations:
        return
    count = int((norm >= norm[list(observations)].min()).sum())
    if count < FEW * len(measurements):
        if settings.loss != "huber":
            yield Reason(
                "suspicious_readings",
                "use_with_care",
                _place(outliers[0]),
                _with_count(outliers),
                outliers[0].remedy,
                Action("use_huber" if measurements.direction is None else "show_posture", observations),
            )
        return
    yield Reason(
        "deflection_unexplained",
        "use_with_care",
        None,
        f"{count} of {len(measurements)} observations disagree with the joint springs that fit the others: "
        "too many for single wrong readings, so something besides the joints "
        "bends, or angles or loads are wrong",
        "check these postures; if their readings are right, try elasticity joints_and_links",
        Action("show_posture", observations),
    )


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
