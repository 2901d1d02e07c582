"""Result of logs of a motion: gearboxes within a factor of 1.5, or why there is no number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Final

import numpy as np
from scipy import stats
from scipy.constants import g

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.gearbox import GearboxResult, GearboxStiffness, LogEstimate
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.estimate import invert_compliance, stiffness_interval
from jointstiff.solver.gearboxes.log_fit import LogFit, fit_logs
from jointstiff.solver.gearboxes.motion import MotionCampaign, MovingBody
from jointstiff.solver.gearboxes.outcome import (
    GREATEST_TWIST,
    assess_gearboxes,
    report_against_payload,
    report_twist,
)
from jointstiff.solver.mechanics.postures import measure_reach
from jointstiff.solver.text import figure

GREATEST_FACTOR: Final = 1.5
"""Factor between a stiffness and an end of its interval, beyond which a log is no check."""
_CONTRADICTION: Final = 0.01
"""Probability, over the number of compared logs, below which logs of one gearbox differ as much."""
_LEAST_TORQUE: Final = 1.5
"""Twist by the range of the torque over lost motion, below which friction decides the answer of a log."""
_GREATEST_DELAY: Final = 0.02
"""Delay between two encoders [s] beyond which the log is misread."""
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
    def compared(self) -> dict[str, LogFit]:
        """Fits by label of the logs in which the torque, and not friction, decides the answer."""
        return {label: fit for label, fit in self.by_log.items() if self._has_torque(fit)}

    @cached_property
    def contradiction(self) -> float:
        """Probability with which compared logs of one gearbox differ as much; 1 without two of them."""
        fits = list(self.compared.values())
        if len(fits) < 2:
            return 1.0
        compliance = np.array([fit.compliance for fit in fits])
        weight = 1.0 / np.square([fit.uncertainty for fit in fits])
        mean = weight @ compliance / weight.sum()
        return float(stats.chi2.sf(weight @ np.square(compliance - mean), len(fits) - 1))

    @property
    def is_contradicted(self) -> bool:
        """True if the logs do not belong to one gearbox."""
        return self.contradiction < _CONTRADICTION / max(len(self.compared), 1)

    def _has_torque(self, fit: LogFit) -> bool:
        """Return whether the torque of some logs twists the gearbox by more than its lost motion allows."""
        lost_motion = abs(self.by_all.lost_motion)
        return fit.torque_range * self.by_all.compliance > _LEAST_TORQUE * lost_motion

    @property
    def has_number(self) -> bool:
        """True if the logs give a stiffness."""
        return self._explain() is None

    def _explain(self) -> str | None:
        """Return why there is no stiffness; None if there is one."""
        fit = self.by_all
        if self.is_contradicted:
            return f"the logs contradict each other (p = {figure(self.contradiction, '.1g')})"
        if abs(fit.delay) > _GREATEST_DELAY:
            return f"its link encoder seems to be {figure(1e3 * fit.delay, '.3g')} ms late"
        least, greatest = fit.interval
        is_narrow = greatest <= GREATEST_FACTOR * fit.compliance and fit.compliance <= GREATEST_FACTOR * least
        if is_narrow and self._has_torque(fit):
            return None
        torques = f"{fit.least_torque:.0f} … {fit.greatest_torque:.0f} N·m"
        return (
            f"its torque in these logs, {torques}, is too small against friction and errors of the encoders"
        )

    def describe(self) -> GearboxStiffness:
        """Return the row of the joint."""
        fit, reason = self.by_all, self._explain()
        least, greatest = fit.interval
        has_number = reason is None
        return GearboxStiffness(
            joint=self.name,
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

    def report(self) -> Iterator[Finding]:
        """Report a joint whose logs contradict each other, or whose twist cannot be true."""
        fit = self.by_all
        if self.is_contradicted:
            yield Finding(
                code="logs_contradict",
                weight="use_with_care",
                where=self.name,
                message=f"{self.name}: {', '.join(self.compared)} do not belong to one gearbox",
                remedy="check that payload, encoders and temperature were the same, or give the logs apart",
            )
        if fit.against_torque > _AGAINST:
            yield Finding(
                code="encoder_against_torque",
                weight="do_not_use",
                where=self.name,
                message=f"the gearbox of {self.name} twists against the torque",
                remedy="reverse the signs of the encoders' angles, or exchange `motor` and `link`",
            )


@dataclass(frozen=True, eq=False)
class _Unfitted:
    """Joint without a fit."""

    name: str
    reason: str
    range_of_twist: float  # [rad]
    least_torque: float  # as stated [N·m]
    greatest_torque: float  # as stated [N·m]

    def describe(self) -> GearboxStiffness:
        """Return the row of the joint, without numbers."""
        return GearboxStiffness(
            joint=self.name,
            stiffness=None,
            stiffness_interval=None,
            half_width=None,
            compliance=None,
            compliance_interval=None,
            reason=self.reason,
            least_torque=self.least_torque,
            greatest_torque=self.greatest_torque,
            offset=None,
            lost_motion=None,
            lost_motion_interval=None,
            noise=None,
            degrees_of_freedom=0,
            postures=0,
        )

    def report(self) -> Iterator[Finding]:
        """Report a twist that no gearbox survives."""
        if self.range_of_twist > GREATEST_TWIST:
            yield report_twist(
                self.name,
                self.range_of_twist,
                "check the unit of the encoders' angles, the sign of the link's, and whether the motor's are "
                "divided by the gear ratio",
            )


def identify_from_logs(campaign: MotionCampaign) -> GearboxResult:
    """Identify the gearboxes of a motion; each number is a check within a factor of 1.5."""
    outcomes = [_fit_joint(campaign, joint) for joint in campaign.joints]
    joints = [each for each in outcomes if isinstance(each, _Joint)]
    gearboxes = [each.describe() for each in outcomes]
    findings = [
        _report_check(campaign.payload),
        *(finding for each in outcomes for finding in each.report()),
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
    twist = max(float(np.ptp(log.smooth(log.motor[:, joint] - log.link[joint]))) for log in logs)
    torque = campaign.find_stated_torque(joint, numbers)
    unfitted = partial(
        _Unfitted,
        name,
        range_of_twist=twist,
        least_torque=float(torque.min()),
        greatest_torque=float(torque.max()),
    )
    if twist > GREATEST_TWIST:
        return unfitted(reason="its twist is more than any gearbox twists")
    if min(float(np.ptp(log.motor[:, joint])) for log in logs) < _LEAST_MOTION:
        return unfitted(reason="it rests in a log, so that nothing separates its errors")
    try:
        by_log = {}
        if len(numbers) > 1:
            by_log = {campaign.logs[number].label: fit_logs(campaign, joint, [number]) for number in numbers}
        return _Joint(name, fit_logs(campaign, joint, numbers), by_log)
    except SolverError:
        return unfitted(reason="its logs determine nothing: the program has no certain optimum")


def _report_check(payload: MovingBody) -> Finding:
    """Report what the numbers rest on."""
    return Finding(
        code="check_by_log",
        weight="use_with_care",
        message=f"the numbers hold if the payload is {figure(payload.mass)} kg ± "
        f"{figure(100.0 * payload.mass_tolerance, '.2g')} % and the arm has the stated masses: logs are a "
        "check within a factor of 1.5",
        remedy="measure a weight step, which needs no masses of the arm",
    )


def _report_implausible(campaign: MotionCampaign, joints: Sequence[_Joint]) -> Iterator[Finding]:
    """Report stiffnesses that are implausible for the payload of the robot."""
    robot = campaign.robot
    known = [joint for joint in joints if joint.has_number and joint.by_all.joint < _LEAST_JOINTS]
    if robot.n < _LEAST_JOINTS or not known:
        return
    torque = (robot.payload or 0.0) * g * measure_reach(robot)
    yield from report_against_payload(
        robot,
        {joint.by_all.joint: joint.by_all.compliance for joint in known},
        {joint.by_all.joint: torque for joint in known},
        "check the units of angles, lengths and masses",
    )
