"""Reasons in the readings: mistakes that their checks found, and one that would explain them better."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from jointstiff.solver.finding import Finding, FindingCode
from jointstiff.solver.fitting import Settings
from jointstiff.solver.inference.alternatives import BetterAlternative, better_alternative, places_on_flange
from jointstiff.solver.inference.reason import Action, Place, Reason
from jointstiff.solver.readings import Measurements
from jointstiff.solver.robot import Robot

SAME_PLACE: Final = 2e-3
"""Distance of a load point from a target [m] that robots' models cannot tell from none."""
FEW: Final = 0.1
"""Share of suspicious readings that the Huber loss, or leaving them out, copes with."""
_PLACES: Final = 60


def alternative_reasons(robot: Robot, measurements: Measurements) -> Iterator[Reason]:
    """Report the mistake that would explain the readings far better."""
    better = better_alternative(robot, measurements)
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
    if alternative.kind == "joint_map":
        what = f"with another joint map, of {', '.join(names)}"
        return what, "check signs and coupling of the joint map in the controller's manual", action
    if alternative.kind == "sign_reversed":
        return f"with the sign of {names[0]} reversed", "check the joint map's signs", action
    driver, driven = alternative.joints
    sign = "added to" if alternative.matrix[driven, driver] > 0 else "taken from"
    what = f"with the controller's angle of {names[0]} {sign} that of {names[1]}"
    return what, "check whether the controller couples these joints; correct the joint map", action


def load_reasons(robot: Robot, measurements: Measurements) -> Iterator[Reason]:
    """Report a load at one of several targets, where a reflector sits; one target may be the tool's point."""
    count = min(len(measurements), _PLACES)
    part = measurements[np.linspace(0, len(measurements) - 1, count).astype(np.intp)]
    if part.present.shape[1] < 2 or not part.force.any():
        return
    apart = np.linalg.norm(places_on_flange(robot, part) - part.load_point[:, None], axis=2)
    apart = np.where(part.present.any(axis=0), apart, np.inf).max(axis=0)
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


def finding_reasons(
    measurements: Measurements, settings: Settings, findings: Sequence[Finding]
) -> Iterator[Reason]:
    """Turn the findings of the integrity checks into reasons, one for each kind."""
    yield from _gross_errors(findings)
    yield from _suspicious(measurements, settings, findings)


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
        first, few = same[0], len(_observations(same)) < FEW * len(measurements)
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
