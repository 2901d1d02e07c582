"""Run of an identification by the robot's own weight, from positions without load (method.md §14)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from jointstiff.schemas import run as runs
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.options import OwnWeight, RunOptions
from jointstiff.schemas.run import Identifiability, RunResult, WeightResult, WeightShare
from jointstiff.solver.arrays import BoolArray, IndexArray
from jointstiff.solver.errors import JointstiffError, MeasurementError, RequestError
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import greatest_violations
from jointstiff.solver.fit.stages import Likelihood, sigma_test
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.messages import build_messages, point
from jointstiff.solver.outcome.result import Numbers, build_run_result
from jointstiff.solver.outcome.rules import (
    derive_assessment,
    report_implausible_joints,
    report_refuted_noise,
    report_solver,
    summarise_noticed,
)
from jointstiff.solver.predict.answers import build_stored_model
from jointstiff.solver.predict.models import JointModel

if TYPE_CHECKING:
    from jointstiff.solver.fit.weight_rows import Balancer, StatedLoads, WeightReadings
    from jointstiff.solver.geometry.poses import Poses
    from jointstiff.solver.own_weight.estimate import WeightEstimate

_NO_MODEL_ERROR: Final = RequestError(
    "the stiffnesses come from the robot's own weight, not from postures under load",
    remedy="measure deflections under a load",
)

AnyOptions = TypeVar("AnyOptions", bound=RunOptions)


def choose_own_weight_if_unloaded(
    robot: Robot, measurements: Measurements, options: AnyOptions
) -> AnyOptions:
    """Return the options, set to identification from own weight if the readings have no other load.

    The options are returned unchanged if the readings have a load, the robot has no masses, or the options
    exclude identification from own weight.
    """
    if not (measurements.is_unloaded and robot.bodies):
        return options
    stated_options = options.model_dump(mode="json", exclude_unset=True)
    try:
        return type(options).model_validate_json(json.dumps({"weight": {}} | stated_options))
    except ValueError:  # a stated option excludes identification from own weight
        return options


def identify_by_weight(
    robot: Robot, measurements: Measurements, options: RunOptions, noticed: Sequence[Finding] = ()
) -> RunResult:
    """Identify joint stiffnesses from positions of a robot that sags under its own weight.

    Args:
        robot: n joints, with bodies.
        measurements: N observations.
        options: options of the run; default options of own weight are used if none are stated.
        noticed: findings of the integrity checks of these measurements.

    Raises:
        RequestError: the robot has no bodies, or the set has no positions.
        JointstiffError: the readings do not determine any compliance, or the fit fails.
    """
    weight_options = options.weight or OwnWeight()
    readings, observation = _collect_positions(robot, measurements, weight_options)
    noticed = _leave_out_settled(noticed, weight_options)
    mistakes = summarise_noticed(noticed, "do_not_use")
    try:
        estimate = _estimate(options, readings)
    except JointstiffError as error:
        if not mistakes:
            raise
        # The fit fails because of the mistake: its own error would name another cause.
        cause = mistakes[0]
        raise MeasurementError(cause.message, remedy=cause.remedy, where=cause.where) from error
    findings = mistakes or [
        *summarise_noticed(noticed, "use_with_care"),
        *estimate.reasons,
        *estimate.remarks,
        *report_implausible_joints(estimate.joints),
        *report_refuted_noise(measurements, estimate.sigma),
        *report_solver([estimate.certificate]),
    ]
    assessment = derive_assessment(estimate.joints, findings)
    numbers = _list_numbers(robot, measurements, readings, observation, estimate)
    warnings = (*noticed, *assessment.remarks)
    return build_run_result(numbers, assessment, warnings, {"weight": _build_weight_result(estimate)})


def _leave_out_settled(noticed: Sequence[Finding], weight: OwnWeight) -> list[Finding]:
    """Return the findings of the integrity checks without those that an option of the run settles.

    With `estimate_gravity`, the positions may be in any right-handed frame that is fixed to the base, because
    the fit finds the direction of gravity in this frame.
    """
    if not weight.estimate_gravity:
        return list(noticed)
    return [finding for finding in noticed if finding.code != "frame_mistaken"]


def _estimate(options: RunOptions, readings: WeightReadings) -> WeightEstimate:
    """Fit joint stiffnesses, geometry and masses to positions that were collected from measurements."""
    from jointstiff.solver.own_weight.estimate import identify_weight

    weight = options.weight or OwnWeight()
    return identify_weight(
        readings,
        confidence=options.confidence,
        free_gravity=weight.estimate_gravity,
        free_base=not weight.rigid_base,
    )


def _collect_deflections(measurements: Measurements) -> Measurements | None:
    """Return deflections of targets in the flange frame, which have no absolute position, or None."""
    in_flange = measurements.present & measurements.in_flange
    if not in_flange.any():
        return None
    deflection = np.where(in_flange[..., None], measurements.deflection, 0.0)
    return replace(measurements, present=in_flange, deflection=deflection)


def _list_numbers(
    robot: Robot,
    measurements: Measurements,
    readings: WeightReadings,
    observation: IndexArray,
    estimate: WeightEstimate,
) -> Numbers:
    """Return the numbers of a fit by own weight.

    Args:
        robot: n joints.
        measurements: N observations.
        readings: positions that were fitted.
        observation: (rows,) index of the observation from which each row of the readings comes.
        estimate: the fit.
    """
    row, target = np.nonzero(readings.poses.present)
    displacement = estimate.displacement[row, target]
    residual = estimate.residual[row, target]
    residual_length, measured_length = (
        np.linalg.norm(vectors, axis=1) for vectors in (residual, displacement + residual)
    )
    model = None
    if any(joint.compliance is not None for joint in estimate.joints):
        model = build_stored_model(_build_model(robot, estimate), _NO_MODEL_ERROR)
    return Numbers(
        joints=estimate.joints,
        compensation=float(1.0 - residual_length.mean() / measured_length.mean()),
        rms_residual=float(np.sqrt(np.square(residual_length).mean())),
        sigma=estimate.sigma,
        goodness=_build_goodness(estimate, sigma_is_stated=readings.poses.sigma is not None),
        identifiability=Identifiability(
            parameters=len(estimate.joints),
            rank=len(estimate.fit.reduced.observed_joints),
            condition_number=None,
            combinations=[],
            stages=[],
        ),
        certificate=greatest_violations([estimate.certificate]),
        complementary_stiffness=runs.ComplementaryStiffness(
            included=True,
            iterations=estimate.fit.steps,
            largest_ratio=estimate.largest_stiffness_ratio,
            largest_shift=None,
        ),
        residuals=build_messages(
            runs.Residual,
            observation=np.array(measurements.labels)[observation[row]],
            target=np.array(measurements.targets)[target],
            deflection=displacement + residual,
            predicted=displacement,
            residual=residual,
        ),
        model=model,
    )


def _build_goodness(estimate: WeightEstimate, *, sigma_is_stated: bool) -> runs.Goodness:
    """Return the message on χ²; the test of χ² needs a stated sigma."""
    test = sigma_test(estimate.chi_square, estimate.degrees_of_freedom) if sigma_is_stated else None
    return runs.Goodness(
        chi_square=estimate.chi_square,
        degrees_of_freedom=estimate.degrees_of_freedom,
        sigma_source="given" if sigma_is_stated else "residuals",
        p_value=None if test is None else test.p_value,
        test=None if test is None else test.result,
    )


def _collect_positions(
    robot: Robot, measurements: Measurements, weight: OwnWeight
) -> tuple[WeightReadings, IndexArray]:
    """Collect all absolute positions: first those without a load, then those under a load.

    Deflections of targets without an absolute position are in the readings, too.

    Returns:
        The readings; and (rows,) the index of the observation from which each row of the readings comes.

    Raises:
        RequestError: the robot has no masses, or the set has no positions.
    """
    from jointstiff.solver.fit.weight_rows import Burden, WeightReadings

    if not robot.bodies:
        raise RequestError(
            "the robot has no masses, so the own weight is unknown",
            where="weight",
            remedy="give `bodies` of the robot, or a URDF with inertials",
        )
    # A deflection with an absolute position has a position without load and a position under load.
    loaded = measurements.present & ~measurements.in_flange
    unloaded = loaded if measurements.unloaded_only is None else loaded | measurements.unloaded_only
    if not unloaded.any():
        raise RequestError(
            "the set has deflections only, but own weight is identified from positions",
            where="weight",
            remedy="give positions, `unloaded` alone or with `loaded`, or omit `weight`",
        )
    without_load, with_load = (np.flatnonzero(mask.any(axis=1)) for mask in (unloaded, loaded))
    observation = np.concatenate([without_load, with_load])
    poses = _build_poses(robot, measurements, unloaded, loaded)
    load_factor = np.repeat([0.0, 1.0], [len(without_load), len(with_load)])[:, None]
    return (
        WeightReadings(
            robot,
            poses,
            Burden(robot.bodies, _build_balancers(robot, weight), np.array(weight.gravity)),
            carried=np.ones((len(observation), len(robot.bodies))),
            force=load_factor * measurements.force[observation],
            moment=load_factor * measurements.moment[observation],
            load_point=measurements.load_point[observation],
            loaded=_collect_deflections(measurements),
            stated=_collect_stated_loads(robot, measurements, len(observation)),
        ),
        observation,
    )


def _collect_stated_loads(robot: Robot, measurements: Measurements, count: int) -> StatedLoads | None:
    """Return what is stated of the loads of positions under load; None if nothing is.

    Args:
        robot: n joints.
        measurements: N observations.
        count: number of observations of positions, without and under load.
    """
    from jointstiff.solver.fit.weight_rows import StatedLoads, list_errors_of_loads

    terms = list_errors_of_loads(measurements)
    under_load = np.flatnonzero((measurements.present & ~measurements.in_flange).any(axis=1))
    if not (terms and len(under_load)):
        return None
    rows = Rows(robot, measurements[under_load])
    unloaded = count - len(under_load)
    return StatedLoads(rows, terms, unloaded)


def _build_poses(robot: Robot, measurements: Measurements, unloaded: BoolArray, loaded: BoolArray) -> Poses:
    """Return absolute positions as poses: first the positions without a load, then those under a load.

    Args:
        robot: robot that was measured.
        measurements: N observations.
        unloaded: (N, T) mask of the positions without a load.
        loaded: (N, T) mask of the positions under a load.
    """
    from jointstiff.solver.geometry.poses import Poses

    without_load, with_load = (np.flatnonzero(mask.any(axis=1)) for mask in (unloaded, loaded))
    observation = np.concatenate([without_load, with_load])
    # The covariance is that of a deflection, the difference of two positions: a position has half of it.
    covariance = 0.5 * measurements.covariance
    if covariance.ndim > 2:
        covariance = np.broadcast_to(covariance, (*measurements.present.shape, 3, 3))[observation]
    loaded_position = measurements.position + measurements.deflection
    return Poses(
        angles=measurements.joints[observation],
        points=np.concatenate([measurements.position[without_load], loaded_position[with_load]]),
        present=np.concatenate([unloaded[without_load], loaded[with_load]]),
        targets=measurements.targets,
        joint_map=robot.joint_map,
        sigma=measurements.sigma,
        covariance=covariance,
    )


def _build_balancers(robot: Robot, weight: OwnWeight) -> tuple[Balancer, ...]:
    """Return the balancers of an option for own weight, with joints as indices.

    Raises:
        RequestError: the robot has no joint that a balancer names.
    """
    from jointstiff.solver.fit.weight_rows import Balancer

    return tuple(
        Balancer(
            robot.joint_index(balancer.joint, f"weight.balancers[{number}].joint"),
            balancer.on_base,
            balancer.on_link,
            balancer.rate,
            balancer.pull,
        )
        for number, balancer in enumerate(weight.balancers)
    )


def _build_model(robot: Robot, estimate: WeightEstimate) -> JointModel:
    """Build the joint model that predicts deflections under loads from an estimate by own weight.

    Errors of masses correlate the n joints to an unknown degree. The variances are therefore multiplied by n:
    by the Cauchy-Schwarz inequality ``(Σ |A_j| u_j)² ≤ n Σ A_j² u_j²``, this covers any correlation.
    """
    identified_joints = np.array(
        [j for j, joint in enumerate(estimate.joints) if joint.compliance is not None], dtype=np.intp
    )
    compliance = estimate.fit.compliance  # includes joints without a published compliance: they sag, too
    variance = np.array([(joint.standard_uncertainty or 0.0) ** 2 for joint in estimate.joints])
    likelihood = Likelihood(
        identified_joints,
        compliance[identified_joints],
        len(identified_joints) * np.diag(variance[identified_joints]),
    )
    return JointModel(
        robot,
        compliance,
        likelihood,
        Constraints(Bounds.positive(robot.n), ()),
        estimate.weight,
        degrees_of_freedom=estimate.degrees_of_freedom if estimate.sigma_of_residuals else None,
    )


def _build_weight_result(estimate: WeightEstimate) -> WeightResult:
    """Build the part of the result about own weight: torque, sag, causes of uncertainty, and gravity."""
    torque, sag = estimate.fit.rows.torques.known, np.abs(estimate.fit.sag).max(axis=0)
    shares = build_messages(
        WeightShare,
        joint=[joint.name for joint in estimate.joints],
        torque=np.column_stack([torque.min(axis=0), torque.max(axis=0)]),
        largest_sag=np.where([joint.compliance is not None for joint in estimate.joints], sag, np.nan),
        readings=estimate.shares,
        masses=1.0 - estimate.shares,
    )
    return WeightResult(
        joints=shares,
        gravity=point(estimate.fit.gravity),
        rms_without_sag=estimate.rms_without_sag,
        rms_residual=estimate.rms_residual,
        steps=estimate.fit.steps,
    )
