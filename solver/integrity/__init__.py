"""Plausibility checks of a measurement set: the usual mistakes of a long day.

Each finding has a weight, a message with a figure, and a remedy. No mistake is corrected silently.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from jointstiff.schemas.finding import Finding, FindingCode
from jointstiff.solver.arrays import BoolArray
from jointstiff.solver.integrity.against_model import (
    inspect_drift,
    inspect_encoders,
    inspect_places,
    inspect_response,
    inspect_rigidity,
)
from jointstiff.solver.integrity.by_places import find_mistakes
from jointstiff.solver.integrity.exchanged import exchange_proved_targets
from jointstiff.solver.integrity.misplaced_loads import (
    find_load_points_in_base,
    find_other_columns,
)
from jointstiff.solver.integrity.one_state import leave_out_copied_states, leave_out_zeros
from jointstiff.solver.integrity.rounded_angles import inspect_rounded_angles
from jointstiff.solver.integrity.values import (
    InstrumentFrame,
    View,
    inspect_angles,
    inspect_duplicates,
    inspect_equal_targets,
    inspect_rare_targets,
    inspect_repeats,
    inspect_stated_noise,
    inspect_values,
)
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import KnownRobot, Robot
from jointstiff.solver.text import describe_others

MAX_FINDINGS_PER_CODE: Final = 10
"""Greatest number of findings of one kind; the last one states the number of further findings."""
_NO_RESPONSE: Final[frozenset[FindingCode]] = frozenset(
    {"angle_unit_suspect", "length_unit_suspect", "deflection_implausibly_large", "sigma_suspect"}
)
"""Mistakes after which deflections cannot be compared with those of springs under the load."""
_UNIT: Final[frozenset[FindingCode]] = frozenset({"length_unit_suspect"})
_JOINTS: Final[frozenset[FindingCode]] = frozenset(
    {
        "angle_unit_suspect",
        "another_robot_fits",
        "joint_sign_suspect",
        "joints_counted_otherwise",
        "joints_swapped",
    }
)
_FOLLOWS: Final[Mapping[FindingCode, frozenset[FindingCode]]] = {
    "length_unit_suspect": _UNIT,
    "deflection_implausibly_large": _UNIT,
    "deflection_implausibly_small": _UNIT,
    "sigma_suspect": _UNIT,
    "joint_outside_limits": _JOINTS | _UNIT,
}
"""Code of a finding about numbers alone → mistakes of the whole set that cause it."""


def inspect_measurements(
    robot: Robot,
    measurements: Measurements,
    *,
    degrees: bool,
    others: Iterable[KnownRobot] = (),
    flange_fields: Sequence[str] = (),
    header_units: Collection[str] = (),
    frame: InstrumentFrame | None = None,
    length_unit: Literal["m", "mm"] = "mm",
) -> list[Finding]:
    """Return findings on the usual mistakes of a day of measurements.

    A mistake in the whole set makes further checks useless: if no posture explains the positions, drift is
    not checked; if angles are wrong, the deflections under load are not checked.

    Args:
        robot: n joints.
        measurements: N observations of T targets.
        degrees: whether the angles were posted in degrees.
        others: robots that may have been measured instead. Their models are built and tried only if, with the
            model of `robot`, targets are far from their usual places and no mistake in the readings explains
            the distance.
        flange_fields: fields that a remedy names if lengths in the flange frame seem to have another unit.
        header_units: quantities, such as length, whose units the headers of files state.
        frame: frame in which positions were read; None if they were given in R0.
        length_unit: unit of the lengths as posted, for remedies.

    Returns:
        The findings, at most `MAX_FINDINGS_PER_CODE` of each kind.
    """
    given = View(robot, measurements, degrees, flange_fields, header_units, frame, length_unit)
    missed, read = leave_out_zeros(given)
    if not read.measurements.present.any():
        return missed
    copied, posted = leave_out_copied_states(read)
    findings = [*missed, *copied, *inspect_values(posted), *inspect_equal_targets(posted)]
    mistakes = find_mistakes(posted, others)
    if mistakes:
        findings = _leave_out_effects(findings, mistakes)
        return _limit_kinds(
            [*findings, *mistakes, *inspect_encoders(posted), *inspect_rounded_angles(posted)]
        )
    # The other checks use the readings as they are after the exchange, or these checks would name all rows.
    exchange, view = exchange_proved_targets(posted)
    findings += exchange
    suspects, good_rows = _inspect_rows(view)
    exchanged = {finding.where for finding in suspects if finding.code == "targets_swapped"}
    # Exchanged names of targets explain a large deflection: only the exchange is reported.
    findings = [f for f in findings if f.code != "deflection_implausibly_large" or f.where not in exchanged]
    mistaken_codes = {finding.code for finding in [*findings, *suspects]}
    can_compare_deflections = not _NO_RESPONSE & mistaken_codes
    findings += [*suspects, *inspect_repeats(view)]
    if good_rows.any():
        findings += [*inspect_rigidity(view, good_rows), *inspect_drift(view, good_rows)]
        misplaced = find_other_columns(view) or find_load_points_in_base(view)
        if misplaced:
            findings.append(misplaced)
        elif can_compare_deflections:
            findings += inspect_response(view, good_rows)
        findings = _leave_out_exchanged_rows(findings)
    findings += [*inspect_encoders(view), *inspect_rounded_angles(view)]
    return _limit_kinds(findings)


def inspect_unloaded(
    robot: Robot,
    measurements: Measurements,
    *,
    degrees: bool,
    others: Iterable[KnownRobot] = (),
    header_units: Collection[str] = (),
    frame: InstrumentFrame | None = None,
    length_unit: Literal["m", "mm"] = "mm",
) -> list[Finding]:
    """Return findings on the positions without load of a set in which some were not read under load.

    Such a set is identified by the robot's own weight, which moves targets by millimetres: units, joints,
    rows, names, frame and robot are checked as with loads. Deflections are not.

    Args:
        robot: n joints.
        measurements: N observations of T targets.
        degrees: whether the angles were posted in degrees.
        others: robots that may have been measured instead.
        header_units: quantities, such as length, whose units the headers of files state.
        frame: frame in which positions were read; None if they were given in R0.
        length_unit: unit of the lengths as posted, for remedies.
    """
    unloaded_only = measurements.unloaded_only
    was_read = measurements.present if unloaded_only is None else measurements.present | unloaded_only
    read = replace(measurements, present=was_read)
    given = View(robot, read, degrees, header_units=header_units, frame=frame, length_unit=length_unit)
    findings, view = leave_out_zeros(given)
    if not view.measurements.present.any():
        return findings
    for check in (
        inspect_angles,
        inspect_rare_targets,
        inspect_stated_noise,
        inspect_duplicates,
        inspect_equal_targets,
    ):
        findings += check(view)
    mistakes = find_mistakes(view, others)
    suspects, good_rows = (mistakes, np.zeros(0, dtype=np.bool_)) if mistakes else _inspect_rows(view)
    findings = [*_leave_out_effects(findings, suspects), *suspects]
    if good_rows.any():
        findings += inspect_rigidity(view, good_rows)
    return _limit_kinds(findings)


def _inspect_rows(view: View) -> tuple[list[Finding], BoolArray]:
    """Return findings on the places of targets in single rows, and a mask (N,) of rows to be checked."""
    suspects, good_rows = inspect_places(view)
    return (suspects if good_rows.any() else _suspect_robot(suspects)), good_rows


def _leave_out_exchanged_rows(findings: list[Finding]) -> list[Finding]:
    """Return findings without those on angles of rows whose unloaded and loaded readings are exchanged.

    The unloaded readings of such a row were read under load, so that no angle explains their places.
    """
    exchanged = {each.where for each in findings if each.code == "deflection_against_force"}
    kept = []
    for finding in findings:
        is_small = finding.code == "target_off_model" and finding.weight == "use_with_care"
        if finding.where is None or not is_small or finding.where not in exchanged:
            kept.append(finding)
    return kept


def _suspect_robot(findings: list[Finding]) -> list[Finding]:
    """State first in the first finding about an observation that no single mistake explains the places.

    Findings about the whole set, such as on one target, have a cause and stay. The findings on the other
    observations stay, too: live campaigns leave out their observations.
    """
    of_rows = [each for each in findings if each.code == "target_off_model" and each.where is not None]
    if not of_rows:
        return findings
    first = of_rows[0]
    message = (
        "another robot may have been measured, zeros of joints may be off, or the robot's description has "
        "several mistakes: no single change of units, signs, or order of the angles, of the frame or of one "
        f"length of the model was found that explains the set; {first.message}"
    )
    remedy = f"check which robot was measured; {first.remedy}"
    changed = first.model_copy(update={"message": message, "remedy": remedy})
    return [changed, *[finding for finding in findings if finding is not first]]


def _leave_out_effects(findings: Iterable[Finding], mistakes: Iterable[Finding]) -> list[Finding]:
    """Return findings about numbers alone without those that a mistake of the whole set causes."""
    causes = {finding.code for finding in mistakes if finding.where is None}
    large: frozenset[FindingCode] = frozenset({"deflection_implausibly_large"} if causes else ())
    kept = [finding for finding in findings if not _FOLLOWS.get(finding.code, frozenset()) & causes]
    return [finding for finding in kept if finding.code not in large]


def _limit_kinds(findings: Iterable[Finding]) -> list[Finding]:
    """Return at most `MAX_FINDINGS_PER_CODE` findings of each kind; the last one names the others."""
    findings_by_code: dict[FindingCode, list[Finding]] = {}
    for finding in findings:
        findings_by_code.setdefault(finding.code, []).append(finding)
    shown: list[Finding] = []
    for same_code in findings_by_code.values():
        shown += same_code[:MAX_FINDINGS_PER_CODE]
        further = [finding.observation for finding in same_code[MAX_FINDINGS_PER_CODE:]]
        if further:
            message = shown[-1].message + describe_others(further)
            shown[-1] = shown[-1].model_copy(update={"message": message})
    return shown
