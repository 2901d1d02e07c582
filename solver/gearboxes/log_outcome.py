"""Result of logs of a motion: gearboxes within a factor of 1.5, or why there is no number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy import stats
from scipy.constants import g

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.gearbox import GearboxResult, GearboxStiffness, LogEstimate
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.estimate import invert_compliance, stiffness_interval
from jointstiff.solver.gearboxes.log_fit import LogFit, fit_logs
from jointstiff.solver.gearboxes.motion import MotionCampaign
from jointstiff.solver.gearboxes.outcome import assess_gearboxes, report_against_payload
from jointstiff.solver.mechanics.postures import measure_reach
from jointstiff.solver.text import figure

GREATEST_FACTOR: Final = 1.5
"""Factor between a stiffness and an end of its interval, beyond which a log is no check."""
_CONTRADICTION: Final = 0.01
"""Probability below which logs that belong to one gearbox differ as much."""
_LEAST_TORQUE: Final = 3.0
"""Twist by the range of the torque over lost motion, below which friction decides the answer."""
_GREATEST_DELAY: Final = 0.02
"""Delay between two encoders [s] beyond which the log is misread."""
_GREATEST_TWIST: Final = 20e-3
"""Twist [rad] that no gearbox survives."""
_LEAST_MOTION: Final = 0.02
"""Range of a joint's angle [rad] below which it rests."""
_AGAINST: Final = 3.0
"""Standard uncertainties by which a twist is against the torque if a sign is wrong."""
_LEAST_JOINTS: Final = 3
"""Joints of an arm that has a reach."""


@dataclass(frozen=True, eq=False)
class _Joint:
    """Fits of one joint: by all logs, and by each log alone."""

    name: str
    by_all: LogFit
    by_log: dict[str, LogFit]  # label → fit; empty for a single log

    @cached_property
    def contradiction(self) -> float:
        """Probability with which logs of one gearbox differ as much; 1 for a single log."""
        fits = list(self.by_log.values())
        if not fits:
            return 1.0
        compliance = np.array([fit.compliance for fit in fits])
        weight = 1.0 / np.square([fit.uncertainty for fit in fits])
        mean = weight @ compliance / weight.sum()
        return float(stats.chi2.sf(weight @ np.square(compliance - mean), len(fits) - 1))

    @cached_property
    def outsiders(self) -> list[str]:
        """Labels of logs whose own interval excludes the compliance by all logs."""
        own = self.by_all.compliance
        return [label for label, fit in self.by_log.items() if not fit.interval[0] <= own <= fit.interval[1]]

    @property
    def is_contradicted(self) -> bool:
        """True if the logs do not belong to one gearbox."""
        return self.contradiction < _CONTRADICTION or bool(self.outsiders)

    def explain(self) -> str | None:
        """Return why there is no stiffness; None if there is one."""
        fit = self.by_all
        if self.is_contradicted:
            return f"the logs contradict each other (p = {figure(self.contradiction, '.1g')})"
        if abs(fit.delay) > _GREATEST_DELAY:
            return f"its link encoder seems to be {figure(1e3 * fit.delay, '.3g')} ms late"
        least, greatest = fit.interval
        is_narrow = greatest <= GREATEST_FACTOR * fit.compliance and fit.compliance <= GREATEST_FACTOR * least
        has_torque = fit.torque_range * fit.compliance > _LEAST_TORQUE * abs(fit.lost_motion)
        if is_narrow and has_torque:
            return None
        torques = f"{fit.least_torque:.0f} … {fit.greatest_torque:.0f} N·m"
        return (
            f"its torque in these logs, {torques}, is too small against friction and errors of the encoders"
        )


@dataclass(frozen=True, eq=False)
class _Unfitted:
    """Joint without a fit."""

    name: str
    reason: str
    range_of_twist: float  # [rad]


def identify_from_logs(campaign: MotionCampaign) -> GearboxResult:
    """Identify the gearboxes of a motion; each number is a check within a factor of 1.5."""
    outcomes = [_fit_joint(campaign, joint) for joint in campaign.joints]
    joints = [each for each in outcomes if isinstance(each, _Joint)]
    gearboxes = [
        _describe_gearbox(each) if isinstance(each, _Joint) else _describe_unfitted(each) for each in outcomes
    ]
    findings = [
        _report_check(campaign),
        *(
            finding
            for each in outcomes
            for finding in (_report_joint(each) if isinstance(each, _Joint) else _report_twist(each))
        ),
        *_report_implausible(campaign, joints),
    ]
    if all(gearbox.stiffness is None for gearbox in gearboxes):
        findings.append(
            Finding(
                code="no_joint_identified",
                weight="do_not_use",
                message="the logs determine no gearbox within a factor of 1.5",
                remedy="log motions of some 20° at 10 to 20°/s in which the joints carry different torques; "
                "or measure a weight step",
            )
        )
    names = campaign.robot.joint_names
    return GearboxResult(
        assessment=assess_gearboxes(findings, gearboxes),
        joint_kinds={},
        gearboxes=gearboxes,
        not_observed=[name for joint, name in enumerate(names) if joint not in campaign.joints],
        mass_uncertainty=None,
        point_uncertainty=None,
        residuals=[],
        by_log=[
            LogEstimate(
                label=label,
                joint=joint.name,
                stiffness=invert_compliance(fit.compliance),
                stiffness_interval=stiffness_interval(fit.interval),
            )
            for joint in joints
            for label, fit in joint.by_log.items()
        ],
        findings=findings,
    )


def _fit_joint(campaign: MotionCampaign, joint: int) -> _Joint | _Unfitted:
    """Return the fits of one joint, or why there is none."""
    name = campaign.robot.joint_names[joint]
    numbers = [number for number, log in enumerate(campaign.logs) if joint in log.link]
    logs = [campaign.logs[number] for number in numbers]
    ranges = [float(np.ptp(log.smooth(log.motor[:, joint] - log.link[joint]))) for log in logs]
    if max(ranges) > _GREATEST_TWIST:
        return _Unfitted(name, "its twist is more than any gearbox twists", max(ranges))
    if min(float(np.ptp(log.motor[:, joint])) for log in logs) < _LEAST_MOTION:
        return _Unfitted(name, "it rests in a log, so that nothing separates its errors", max(ranges))
    try:
        by_log = {}
        if len(numbers) > 1:
            by_log = {campaign.logs[number].label: fit_logs(campaign, joint, [number]) for number in numbers}
        return _Joint(name, fit_logs(campaign, joint, numbers), by_log)
    except SolverError:
        return _Unfitted(name, "its logs determine nothing: the program has no certain optimum", max(ranges))


def _describe_unfitted(joint: _Unfitted) -> GearboxStiffness:
    """Return the row of a joint without a fit."""
    return GearboxStiffness(
        joint=joint.name,
        stiffness=None,
        stiffness_interval=None,
        half_width=None,
        compliance=None,
        compliance_interval=None,
        reason=joint.reason,
        least_torque=0.0,
        greatest_torque=0.0,
        offset=None,
        lost_motion=None,
        lost_motion_interval=None,
        noise=None,
        degrees_of_freedom=0,
        postures=0,
    )


def _report_twist(joint: _Unfitted) -> Iterator[Finding]:
    """Report a twist that no gearbox survives."""
    if joint.range_of_twist > _GREATEST_TWIST:
        yield Finding(
            code="encoder_deflection_implausibly_large",
            weight="do_not_use",
            where=joint.name,
            message=f"the twist of {joint.name} changes by up to {figure(1e3 * joint.range_of_twist, '.3g')} "
            "mrad, more than any gearbox twists",
            remedy="check the unit of the encoders' angles, the sign of the link's, and whether the motor's "
            "are divided by the gear ratio",
        )


def _describe_gearbox(joint: _Joint) -> GearboxStiffness:
    """Return the row of one joint."""
    fit, reason = joint.by_all, joint.explain()
    least, greatest = fit.interval
    has_number = reason is None
    return GearboxStiffness(
        joint=joint.name,
        stiffness=invert_compliance(fit.compliance) if has_number else None,
        stiffness_interval=stiffness_interval(fit.interval) if has_number else None,
        half_width=0.5 * (greatest - least) / fit.compliance if has_number else None,
        compliance=fit.compliance if has_number else None,
        compliance_interval=fit.interval if has_number else None,
        reason=reason,
        least_torque=fit.least_torque,
        greatest_torque=fit.greatest_torque,
        offset=None,
        lost_motion=fit.lost_motion,
        lost_motion_interval=None,
        noise=fit.noise,
        degrees_of_freedom=int(fit.independent),
        postures=0,
        delay=fit.delay,
    )


def _report_check(campaign: MotionCampaign) -> Finding:
    """Report what the numbers rest on."""
    payload = campaign.bodies[-1]
    return Finding(
        code="check_by_log",
        weight="use_with_care",
        message=f"the numbers hold if the payload is {figure(payload.mass)} kg ± "
        f"{figure(100.0 * payload.mass_tolerance, '.2g')} % and the arm has the stated masses: logs are a "
        "check within a factor of 1.5",
        remedy="measure a weight step, which needs no masses of the arm",
    )


def _report_joint(joint: _Joint) -> Iterator[Finding]:
    """Report a joint whose logs contradict each other, or whose twist cannot be true."""
    fit = joint.by_all
    if joint.is_contradicted:
        labels = joint.outsiders or list(joint.by_log)
        yield Finding(
            code="logs_contradict",
            weight="use_with_care",
            where=joint.name,
            message=f"{joint.name}: {', '.join(labels)} and the other logs do not belong to one gearbox",
            remedy="check that payload, encoders and temperature were the same, or give the logs apart",
        )
    if fit.against_torque > _AGAINST:
        yield Finding(
            code="encoder_against_torque",
            weight="do_not_use",
            where=joint.name,
            message=f"the gearbox of {joint.name} twists against the torque",
            remedy="reverse the signs of the encoders' angles, or exchange `motor` and `link`",
        )


def _report_implausible(campaign: MotionCampaign, joints: Sequence[_Joint]) -> Iterator[Finding]:
    """Report stiffnesses that are implausible for the payload of the robot."""
    robot = campaign.robot
    known = [joint for joint in joints if joint.explain() is None and joint.by_all.joint < _LEAST_JOINTS]
    if robot.n < _LEAST_JOINTS or not known:
        return
    torque = (robot.payload or 0.0) * g * measure_reach(robot)
    yield from report_against_payload(
        robot,
        {joint.by_all.joint: joint.by_all.compliance for joint in known},
        {joint.by_all.joint: torque for joint in known},
        "check the units of angles, lengths and masses",
    )
