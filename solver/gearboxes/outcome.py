"""Result of a weight step: gearboxes, findings and verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from scipy import special

from jointstiff.schemas.finding import QUESTIONS, Assessment, Finding, combine_assessments
from jointstiff.schemas.gearbox import GearboxResult, GearboxStiffness, StepResidual
from jointstiff.solver.arrays import FloatArray, wrap
from jointstiff.solver.errors import NotObservableError
from jointstiff.solver.fit.estimate import invert_compliance, stiffness_interval
from jointstiff.solver.fit.stages import student_quantile
from jointstiff.solver.gearboxes.identification import LEAST_FREEDOM, GearboxFit, fit_gearboxes
from jointstiff.solver.gearboxes.step import JointStep, WeightStep
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.messages import build_messages, finite_or_none
from jointstiff.solver.text import figure

GOOD_HALF_WIDTH: Final = 0.05
"""Relative half-width of an interval up to which a gearbox is certain."""
_GREATEST_HALF_WIDTH: Final = 0.5
"""Relative half-width of an interval from which no stiffness is stated."""
_GOOD_FREEDOM: Final = 4
"""Degrees of freedom from which the noise of a step is known well enough."""
_AGAINST: Final = 2.0
"""Standard uncertainties by which a compliance is negative if a sign is wrong."""
_GREATEST_OFFSET: Final = 200e-6
"""Change of the twist [rad] that no torque explains, beyond which an encoder was referenced anew."""
GREATEST_TWIST: Final = 20e-3
"""Twist [rad] that no gearbox survives."""
_POSTURE: Final = 5e-3
"""Difference [rad] of a motor's angle from the stated posture, beyond which the posture is another one."""
_LEAST_GEAR_RATIO: Final = 3.0
"""Least gear ratio of a robot's joint."""
_LEAST_READINGS: Final = 4
"""Least number of readings of a motor that shows a gear ratio."""
_LEAST_SPREAD: Final = 0.01
"""Least standard deviation [rad] of the stated angles of a joint that shows a gear ratio."""
_PROPORTIONAL: Final = 0.01
"""Greatest deviation of motor angles from a multiple of the stated angles, relative to their spread."""
_FALSE_ALARM: Final = 0.01
"""Probability that a test names something in a step without a mistake."""
_TYPICAL_RATIO: Final = 500.0
"""Stiffness over the greatest torque of the payload [1/rad]: 330 and 430 of joints 2 and 3 of a measured
FANUC R-2000iC, 500 to 700 of strain-wave gears in cobots by their makers' figures."""
_FACTOR: Final = 5.0
"""Factor on the typical ratio within which a stiffness is plausible: a weight in N for a mass is 9.8."""
_TWICE: Final = 2.0
"""Load over payload from which the load is implausible."""
_SHOWN: Final = 5
"""Greatest number of labels in a message."""


def identify_gearboxes(step: WeightStep) -> GearboxResult:
    """Identify the gearboxes of a weight step; suspicious readings are findings.

    Raises:
        NotObservableError: no joint has enough postures, or the load twists none of them differently.
        SolverError: an optimum or an end of an interval could not be certified.
    """
    names = step.robot.joint_names
    joints = [step.select(joint) for joint in np.unique(step.readings.joint).tolist()]
    reasons = {each.joint: _explain_undetermined(each) for each in joints}
    determined = [each for each in joints if reasons[each.joint] is None]
    if not determined:
        raise NotObservableError(
            "; ".join(f"{names[joint]}: {reason}" for joint, reason in reasons.items()),
            where="observations",
            remedy="read both encoders in more postures, in which the load's lever about the joint differs: "
            "12 postures, half of them with the arm stretched out, half with the load near the axis",
        )
    fits = {fit.steps.joint: fit for fit in fit_gearboxes(step, determined)}
    gearboxes = [_describe_gearbox(step, each, fits.get(each.joint), reasons[each.joint]) for each in joints]
    undivided = list(_report_undivided_angles(step))
    findings = [
        *_report_load(step),
        *(undivided or _report_postures(step)),
    ]
    if not undivided:  # such angles are not those of the joints, so that no other check applies
        findings += _report_approaches(step, joints)
        for fit in fits.values():
            findings += _report_fit(step, fit)
        findings += [*_report_implausible(step, fits), *_report_uncertain(gearboxes)]
    identified = sum(gearbox.stiffness is not None for gearbox in gearboxes)
    if identified == 0:
        findings.append(
            Finding(
                code="no_joint_identified",
                weight="do_not_use",
                message="no gearbox has an interval with an upper end",
                remedy="use a heavier load, or postures in which its lever about the joint differs more",
            )
        )
    return GearboxResult(
        assessment=assess_gearboxes(findings, gearboxes),
        joint_kinds={},
        gearboxes=gearboxes,
        not_observed=[name for j, name in enumerate(names) if j not in reasons],
        mass_uncertainty=step.load.mass_uncertainty,
        point_uncertainty=step.load.point_uncertainty,
        residuals=[row for each in joints for row in _list_residuals(step, each, fits.get(each.joint))],
        findings=findings,
    )


def assess_gearboxes(findings: Sequence[Finding], gearboxes: Sequence[GearboxStiffness]) -> Assessment:
    """Return the verdict on gearboxes: the worst of the findings."""
    reasons = [finding for finding in findings if not finding.is_remark]
    assessment = combine_assessments([Assessment(verdict=each.weight, reasons=[each]) for each in reasons])
    return assessment.model_copy(
        update={
            "questions": [finding for finding in findings if finding.code in QUESTIONS],
            "joints_identified": sum(gearbox.stiffness is not None for gearbox in gearboxes),
            "joint_count": len(gearboxes),
        }
    )


def _explain_undetermined(steps: JointStep) -> str | None:
    """Return why the steps of a joint cannot determine its gearbox; None if they can."""
    if steps.degrees_of_freedom < LEAST_FREEDOM:
        needed = steps.columns.shape[1] + LEAST_FREEDOM
        return f"it was read in {len(steps.step)} postures, and at least {needed} are needed"
    if not steps.has_varied_torque:
        return "the load's torque about it is the same in all postures"
    return None


def _describe_gearbox(
    step: WeightStep, steps: JointStep, fit: GearboxFit | None, reason: str | None
) -> GearboxStiffness:
    """Return the row of one joint."""
    lost = _estimate_mean(step.lost_motion(steps.joint))
    interval = None if fit is None else stiffness_interval(fit.interval)
    stiffness = None if fit is None else invert_compliance(fit.compliance)
    half_width = None
    if fit is not None and interval is not None and interval[1] is not None and fit.compliance > 0.0:
        half_width = 0.5 * (fit.interval[1] - fit.interval[0]) / fit.compliance
    if fit is not None and (half_width is None or half_width > _GREATEST_HALF_WIDTH):
        reason = "its twist is not greater than the noise of the readings"
        if interval is not None:
            reason += f"; the gearbox has at least {figure(interval[0], '.3g')} N·m/rad"
        stiffness, half_width = None, None
    return GearboxStiffness(
        joint=step.robot.joint_names[steps.joint],
        stiffness=stiffness,
        stiffness_interval=interval,
        half_width=half_width,
        compliance=None if fit is None else fit.compliance,
        compliance_interval=None if fit is None else fit.interval,
        reason=reason,
        least_torque=float(steps.torques[0].min()),
        greatest_torque=float(steps.torques[0].max()),
        offset=None if fit is None else finite_or_none(fit.offset),
        lost_motion=None if lost is None else lost[0],
        lost_motion_interval=None if lost is None else (lost[0] - lost[1], lost[0] + lost[1]),
        noise=None if fit is None else fit.noise,
        degrees_of_freedom=max(steps.degrees_of_freedom, 0),
        postures=len(steps.step),
    )


def _estimate_mean(values: FloatArray, probability: float = 0.975) -> tuple[float, float] | None:
    """Return the mean of values, and half of its interval by Student's distribution; None for one value."""
    if len(values) < 2:
        return None
    half = student_quantile(probability, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return float(values.mean()), float(half)


def _list_residuals(step: WeightStep, steps: JointStep, fit: GearboxFit | None) -> list[StepResidual]:
    """Return the steps of one joint with their residuals."""
    count = len(steps.step)
    return build_messages(
        StepResidual,
        label=[step.labels[posture] for posture in steps.postures],
        joint=[step.robot.joint_names[steps.joint]] * count,
        torque=steps.torques[0],
        step=steps.step,
        residual=[None] * count if fit is None else fit.residuals,
    )


def _report_load(step: WeightStep) -> Iterator[Finding]:
    """Report a mass that was not weighed, and a mass far beyond the payload."""
    load = step.load
    if not load.is_weighed:
        yield Finding(
            code="mass_assumed",
            weight="use_with_care",
            where="load.mass_uncertainty",
            message="the uncertainty of the mass is not stated: "
            f"{figure(load.mass_uncertainty, '.2g')} kg is assumed, and each stiffness is as wrong as "
            "the mass",
            remedy="weigh the load, and state `mass_uncertainty`",
        )
    yield from report_overload(load.mass, step.robot, "load.mass")


def report_overload(mass: float, robot: Robot, where: str) -> Iterator[Finding]:
    """Report a mass [kg] far beyond the payload of a robot; `where` is the field of the mass."""
    payload = robot.payload
    if payload is not None and mass > _TWICE * payload:
        yield Finding(
            code="stiffness_against_payload",
            weight="do_not_use",
            where=where,
            message=f"the load has {figure(mass)} kg, but the robot's payload is {figure(payload)} kg",
            remedy="state the mass in kg, not the weight in N or the mass in lb",
        )


def _report_undivided_angles(step: WeightStep) -> Iterator[Finding]:
    """Report motor angles that are multiples of the stated angles: their gear ratio is not divided out."""
    read = step.readings
    q = step.robot.joint_map.model_angles(step.joints)
    for joint in np.unique(read.joint).tolist():
        rows = np.flatnonzero(read.joint == joint)
        motor, stated = read.motor[rows, 0], q[read.posture[rows], joint]
        deviation = stated - stated.mean()
        if len(rows) < _LEAST_READINGS or deviation.std() < _LEAST_SPREAD:
            continue
        ratio = float(deviation @ motor) / float(deviation @ deviation)
        remaining = motor - motor.mean() - ratio * deviation
        if abs(ratio) < _LEAST_GEAR_RATIO or remaining.std() > _PROPORTIONAL * motor.std():
            continue
        name = step.robot.joint_names[joint]
        yield Finding(
            code="posture_against_encoders",
            weight="do_not_use",
            where=name,
            message=f"the motor angles of {name} are {figure(abs(ratio), '.4g')} times the stated angles",
            remedy=f"divide the motor angles of {name} by its gear ratio; if the ratio is near 57.3, give "
            "all angles in the unit that `units.angle` states",
        )


def _report_postures(step: WeightStep) -> Iterator[Finding]:
    """Report postures in which a motor's angle is not that of the stated posture.

    A motor's zero does not matter: its median difference from the postures is left out.
    """
    read = step.readings
    q = step.robot.joint_map.model_angles(step.joints)
    for joint in np.unique(read.joint).tolist():
        rows = np.flatnonzero(read.joint == joint)
        differences = wrap(read.motor[rows, 0] - q[read.posture[rows], joint])
        off = np.abs(wrap(differences - np.median(differences)))
        moved = np.abs(wrap(read.motor[rows, 1] - read.motor[rows, 0]))  # by the twist, if the link is held
        off = np.where(moved > GREATEST_TWIST, np.maximum(off, moved), off)
        wrong = rows[off > _POSTURE]
        if not wrong.size:
            continue
        labels = list(dict.fromkeys(step.labels[posture] for posture in read.posture[wrong]))
        name = step.robot.joint_names[joint]
        farthest = float(np.degrees(off.max()))
        shown = ", ".join(labels[:_SHOWN]) + (", …" if len(labels) > _SHOWN else "")
        yield Finding(
            code="posture_against_encoders",
            weight="do_not_use",
            where=name,
            observation=labels[0] if len(labels) == 1 else None,
            message=f"the motor of {name} is up to {figure(farthest, '.3g')}° from the "
            f"stated posture in {shown}",
            remedy="correct the postures, or the sign and unit of the encoders' angles: they are those of "
            "the model's joints, after the joint map",
        )


def _report_approaches(step: WeightStep, joints: Sequence[JointStep]) -> Iterator[Finding]:
    """Report joints that were not read from both sides, or whose sides read the same."""
    alike, unknown = [], []
    for each in joints:
        lost = _estimate_mean(step.lost_motion(each.joint), 1.0 - 0.5 * _FALSE_ALARM)
        name = step.robot.joint_names[each.joint]
        if lost is None or np.abs(each.imbalance).max() > 0.0:
            unknown.append(name)
        elif lost[0] <= lost[1]:
            alike.append(name)
        of_joint = step.readings.joint == each.joint
        if name not in unknown and not step.readings.approach[of_joint].all():
            unknown.append(name)
    if unknown:
        yield Finding(
            code="approach_unknown",
            weight="use_with_care",
            message=f"{', '.join(unknown)}: not every posture was read from both sides, so lost motion may "
            "be in the steps",
            remedy="approach each posture from the positive and from the negative side, in both states, and "
            "state `approach`",
        )
    if alike:
        yield Finding(
            code="approaches_alike",
            weight="use_with_care",
            message=f"{', '.join(alike)}: readings from both sides do not show the lost motion of a "
            "gearbox, in which the motor leads",
            remedy="check that each posture was approached from both sides, by some degrees, and that '+' "
            "and '-' are not exchanged",
        )


def _report_fit(step: WeightStep, fit: GearboxFit) -> Iterator[Finding]:
    """Report what the fit of one joint shows: signs, offsets, single steps, too few postures."""
    steps, name = fit.steps, step.robot.joint_names[fit.steps.joint]
    greatest = float(np.abs(steps.step).max())
    if greatest > GREATEST_TWIST:
        yield report_twist(
            name, greatest, "check the unit of the encoders' angles, and the sign of the link's"
        )
    is_against = fit.free_compliance + _AGAINST * fit.uncertainty < 0.0
    if is_against and _has_reversed_lost_motion(step, fit.steps.joint):
        yield Finding(
            code="encoder_against_torque",
            weight="do_not_use",
            where=name,
            message=f"motor and link angles of {name} seem to be exchanged: its gearbox twists against the "
            "load, and in its lost motion the link leads the motor",
            remedy=f"exchange `motor` and `link` in the readings of {name}: `motor` is the motor's angle "
            "divided by the gear ratio, `link` the angle of the encoder behind the gearbox",
        )
    elif is_against:
        yield Finding(
            code="encoder_against_torque",
            weight="do_not_use",
            where=name,
            message=f"the gearbox of {name} twists against the load",
            remedy="exchange `unloaded` and `loaded`, or reverse the signs of the encoders' angles: they are "
            "those of the model's joints, after the joint map",
        )
    elif abs(fit.offset) > _GREATEST_OFFSET:
        yield Finding(
            code="encoder_referenced_anew",
            weight="do_not_use",
            where=name,
            message=f"the twist of {name} changed by {figure(1e6 * fit.offset, '.3g')} µrad between the "
            "states, without a torque",
            remedy="read both states again, and do not reference or switch off the encoders between them",
        )
    limit = float(
        special.stdtrit(max(steps.degrees_of_freedom - 1, 1), 1.0 - 0.5 * _FALSE_ALARM / len(steps.step))
    )
    for row in np.flatnonzero(np.abs(fit.deleted) > limit).tolist():
        label = step.labels[steps.postures[row]]
        yield Finding(
            code="step_off_the_others",
            weight="use_with_care",
            where=name,
            observation=label,
            message=f"the step of {name} in {label} is {figure(1e6 * fit.residuals[row], '.3g')} µrad off "
            f"the others, which scatter by {figure(1e6 * fit.noise, '.2g')} µrad",
            remedy=f"check whether the load hung in {label}, and its posture; read it again or omit it",
        )
    if min(steps.degrees_of_freedom, steps.distinct_torques - 1) < _GOOD_FREEDOM:
        yield Finding(
            code="few_postures",
            weight="use_with_care",
            where=name,
            message=f"{name} was read in {len(steps.step)} postures with {steps.distinct_torques} torques of "
            "the load, which leave too few to judge the noise",
            remedy="read at least 6 postures with different torques; 12 are good practice",
        )


def _has_reversed_lost_motion(step: WeightStep, joint: int) -> bool:
    """Return whether the lost motion of a joint has the sign of a link that leads its motor."""
    lost = _estimate_mean(step.lost_motion(joint), 1.0 - 0.5 * _FALSE_ALARM)
    return lost is not None and lost[0] < -lost[1]


def report_twist(name: str, twist: float, remedy: str) -> Finding:
    """Return the finding on a twist [rad] that no gearbox survives."""
    return Finding(
        code="encoder_deflection_implausibly_large",
        weight="do_not_use",
        where=name,
        message=f"the twist of {name} changes by up to {figure(1e3 * twist, '.3g')} mrad, more than "
        "any gearbox twists",
        remedy=remedy,
    )


def _report_implausible(step: WeightStep, fits: dict[int, GearboxFit]) -> Iterator[Finding]:
    """Report stiffnesses that are implausible for the payload, as by a weight in place of a mass."""
    payload = step.robot.payload
    torques_by_payload = {
        joint: float(np.abs(fit.steps.torques[0]).max()) * (payload or 0.0) / step.load.mass
        for joint, fit in fits.items()
    }
    yield from report_against_payload(
        step.robot,
        {joint: fit.compliance for joint, fit in fits.items()},
        torques_by_payload,
        "check that `load.mass` is in kg, not in N, and the units of angles and lengths",
    )


def report_against_payload(
    robot: Robot, compliances: Mapping[int, float], torques: Mapping[int, float], remedy: str
) -> Iterator[Finding]:
    """Report gearboxes that are far softer or stiffer than those of other arms of the same payload.

    Args:
        robot: robot with the joints.
        compliances: joint → compliance [rad/(N·m)]; zero if it may be rigid.
        torques: joint → greatest torque of the robot's payload about it [N·m].
        remedy: what to check.
    """
    if robot.payload is None:
        yield Finding(
            code="payload_not_stated",
            weight="use",
            message="the robot states no payload, so that nothing checks the units",
            remedy="state `payload` of the robot [kg]",
        )
        return
    compared = [joint for joint, compliance in compliances.items() if compliance > 0.0]
    if not compared:
        return
    ratios = [1.0 / (compliances[joint] * torques[joint]) for joint in compared]
    factor = float(np.exp(np.mean(np.log(ratios)))) / _TYPICAL_RATIO
    if not 1.0 / _FACTOR < factor < _FACTOR:
        names = ", ".join(robot.joint_names[joint] for joint in compared)
        yield Finding(
            code="stiffness_against_payload",
            weight="do_not_use",
            message=f"the gearboxes of {names} are {figure(factor, '.2g')} times as stiff as those of a "
            "common arm, by its payload",
            remedy=remedy,
        )


def _report_uncertain(gearboxes: Sequence[GearboxStiffness]) -> Iterator[Finding]:
    """Report gearboxes whose interval is wide or has no upper end."""
    wide = [
        gearbox.joint
        for gearbox in gearboxes
        if gearbox.half_width is None or gearbox.half_width > GOOD_HALF_WIDTH
    ]
    if wide:
        yield Finding(
            code="gearbox_uncertain",
            weight="use_with_care",
            message=f"the interval of {', '.join(wide)} is wider than ± {figure(100 * GOOD_HALF_WIDTH)} %, "
            "or has no upper end",
            remedy="use a heavier load, or postures at the extremes of the load's torque about the joint",
        )
