"""Sweeps: one joint turned alone while a tracker follows the targets on the flange; and the axes they show.

All targets of a sweep share one axis: they run on circles about it (the circle-point method). `fit_axis` is
`fit_poses` with that axis alone. How far each position has turned is, by default, estimated from the readings
(`angles="free"`), common to all targets: encoders and gears of a heavy robot are wrong by some 50 µrad, which
at 2 m is five times the noise of a tracker, and the classical circle-point method does not trust them either.
With perfect encoders `angles="controller"` would be the better estimate; `python -m benchmarks geometry`
prints by how much, and what it costs with real ones. A correction that is common to all positions is the same
as a turn of the targets: corrections are of mean zero.

A controller joint may turn two axes of the model, such as J2 of a FANUC arm, where ``q2 = θ2`` and ``q3 =
−(θ2 + θ3)``: turning θ2 turns axis 2, and axis 3 back by the same angle, so that the forearm moves without
rotating. All targets then run on circles of one and the same radius, the distance of axes 2 and 3, each about
a centre of its own. The circles show the direction of axis 2 and where it lies *from axis 3*; where axis 3
is, its own sweep shows. The fit is then that of the inner axis, with the outer one as its own sweep found it.
No axes need be parallel.

A sweep shows an axis where the joints before it have put it. Turning these back, one after the other,
about the axes already known, brings every axis to model angle zero (`identify_axes`).

Separate fits do not use that all sweeps show the same robot (`refine_axes`). Every sweep also shows where the
targets are on the flange, and where the axes nearer to the flange are. A common fit of all sweeps uses that.
No sweep needs to turn a single model joint, so coupled axes are an ordinary case. In return the common fit
trusts the controller's angles of the joints at rest, within a sweep and between sweeps. With free angles it
does not trust the angles of the joint that turns, not even their mean over a sweep: a gear error of 60 µrad
at rest would displace the axes nearer to the flange by 0.1 mm. The χ² of the common fit, compared with that
of the separate fits, shows whether one robot fits all sweeps.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import pinocchio as pin
from scipy import special
from scipy.linalg import helmert

from jointstiff.solver.arrays import BoolArray, FloatArray, cross
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.poses import (
    CHART,
    CHART_SIZE,
    Axis,
    IdentifiedAxes,
    LinearFit,
    Motion,
    PoseReadings,
    PoseState,
    TrackedReadings,
    differentiate_by_rigid_motion,
    fit_poses,
    refuse_wrong_units,
    transform_points,
)
from jointstiff.solver.mechanics.robot import JointMap

AngleUse = Literal["free", "controller"]

MIN_POSITIONS = 4
"""Least number of positions: a circle fits any three points, and only a fourth can contradict the fit."""

RESTING_RANGE = 1e-4
"""Largest range of a joint's angle [rad] with which the joint counts as resting: 0.2 mm at 2 m."""

SHORTEST_ARC = np.radians(5.0)
"""Least arc [rad]: below it a circle differs from its tangent by less than 0.1 % of its radius."""

SMALLEST_MOTION = 1e-3
"""Least displacement of the target that moves most [m]."""

SWEEPS_DISAGREE_P_VALUE = 1e-6
"""p-value of the common fit of all sweeps below which the sweeps count as contradictory."""

UNEVEN_GEARS_P_VALUE = 0.01
"""p-value of the controller's angles below which the gears count as uneven."""


@dataclass(frozen=True, eq=False)
class Sweep(TrackedReadings):
    """Readings of T targets in the N positions of one sweep of a joint. Arrays are made read-only.

    Raises:
        MeasurementError: shapes disagree, a number is not finite, fewer than `MIN_POSITIONS` positions, the
            joint did not move, or its targets did not.
    """

    name: str  #: name of the controller's joint that was turned, for messages
    joint: int  #: index of the joint, 0 to n - 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self) < MIN_POSITIONS:
            raise MeasurementError(
                f"the sweep has {len(self)} positions; at least {MIN_POSITIONS} are needed",
                where=self.where,
                remedy="record more positions; 10 to 20 over a wide arc are good practice",
            )
        arc = float(np.ptp(self.angles[:, self.joint]))
        if arc <= RESTING_RANGE:
            moving = np.flatnonzero(np.ptp(self.angles, axis=0) > RESTING_RANGE)
            others = ", ".join(f"joint {index + 1}" for index in moving)
            raise MeasurementError(
                f"the joint did not move: its angle changes by only {np.degrees(arc):.2g}°"
                + (f", while {others} turned" if others else ""),
                where=self.where,
                remedy="name the joint that was turned, or repeat the sweep",
            )
        if self.largest_motion < SMALLEST_MOTION:
            raise MeasurementError(
                f"the joint did not move: the controller shows {np.degrees(arc):.3g}°, but no target "
                f"moved by more than {self.largest_motion * 1e3:.3g} mm",
                where=self.where,
                remedy="check that readings and angles belong together, that the targets were tracked, and "
                "units.length",
            )

    @property
    def where(self) -> str:
        """Name of the sweep in messages."""
        return f"sweep of {self.name}"

    @property
    def largest_motion(self) -> float:
        """Diagonal [m] of the box around the readings of one target, for the target that moved most."""
        paths = [
            self.points[was_read, target] for target, was_read in enumerate(self.present.T) if was_read.any()
        ]
        return max((float(np.linalg.norm(np.ptp(path, axis=0))) for path in paths), default=0.0)


@dataclass(frozen=True, eq=False)
class SweepSet:
    """Sweeps of one robot with the same targets, read by one tracker that was not moved.

    Raises:
        MeasurementError: another number of joints, an arc too short, two sweeps of one joint, a sigma that is
            not positive, or a wrong unit of length.
    """

    sweeps: tuple[Sweep, ...]  #: sweeps in any order
    targets: tuple[str, ...]  #: names of the T targets
    joint_map: JointMap  #: from controller to model angles
    sigma: float | None = None  #: standard uncertainty of one coordinate of one reading [m]; None if unknown

    def __post_init__(self) -> None:
        refuse_wrong_units(self.sigma, max(sweep.largest_motion for sweep in self.sweeps))
        for sweep in self.sweeps:
            if sweep.angles.shape[1] != self.joint_map.n:
                raise MeasurementError(
                    f"the sweep has {sweep.angles.shape[1]} angles, but the robot {self.joint_map.n} joints",
                    where=sweep.where,
                    remedy="give the angles of all joints in every position, and a joint map of this robot",
                )
            arc = float(np.ptp(self.model_angles(sweep), axis=0).max())
            if arc < SHORTEST_ARC:
                raise MeasurementError(
                    f"the arc of {np.degrees(arc):.2g}° is too short to determine the axis",
                    where=sweep.where,
                    remedy=f"sweep at least {np.degrees(SHORTEST_ARC):.0f}°, better 90° or more",
                )
        # A sweep shows the axis of the first of the joints that turn.
        sweep_counts = Counter(min(self.find_turning_joints(sweep)) for sweep in self.sweeps)
        joint, count = sweep_counts.most_common(1)[0]
        if count > 1:
            raise MeasurementError(
                f"{count} sweeps turn model joint {joint + 1}",
                where="sweeps",
                remedy="give one sweep per joint; add the positions of a repeated sweep to the first sweep",
            )

    def model_angles(self, sweep: Sweep) -> FloatArray:
        """Return the model's joint angles (N, n) [rad] in the positions of a sweep."""
        return self.joint_map.model_angles(sweep.angles)

    def find_turning_joints(self, sweep: Sweep) -> tuple[int, ...]:
        """Return the indices of the model joints that turn in a sweep, usually a single joint.

        With coupled axes (J2/J3 of FANUC), one joint of the controller turns two joints of the model, and two
        joints of the controller turned against each other may turn a single joint of the model.
        """
        ranges = np.ptp(self.model_angles(sweep), axis=0)
        return tuple(int(index) for index in np.flatnonzero(ranges > RESTING_RANGE))

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Index (n,) of the sweep that shows the axis of each of the n model joints.

        A sweep that turns two coupled joints shows the axis of the first of them.

        Raises:
            MeasurementError: a joint has no sweep.
        """
        sweep_of = {min(self.find_turning_joints(sweep)): index for index, sweep in enumerate(self.sweeps)}
        missing = [joint + 1 for joint in range(self.joint_map.n) if joint not in sweep_of]
        if missing:
            raise MeasurementError(
                f"no sweep determines the axis of model joint {', '.join(map(str, missing))}",
                where="sweeps",
                remedy="turn each joint alone in a sweep of its own",
            )
        return tuple(sweep_of[joint] for joint in range(self.joint_map.n))

    @property
    def postures(self) -> FloatArray:
        """Mean angles (n, n) [rad] of the model joints (columns) in the sweep of each model joint (rows)."""
        return np.array([self.model_angles(self.sweeps[index]).mean(axis=0) for index in self.order])

    @property
    def present(self) -> BoolArray:
        """Mask (N, T) of the targets that were read, in the N positions of all sweeps in order."""
        return np.concatenate([sweep.present for sweep in self.sweeps])

    @cached_property
    def whitened(self) -> PoseReadings:
        """Readings of all sweeps in order; each position has its own correction of the turned joint."""
        slopes = [np.tile(self.joint_map.matrix[:, sweep.joint], (len(sweep), 1)) for sweep in self.sweeps]
        return PoseReadings(
            angles=np.concatenate([self.model_angles(sweep) for sweep in self.sweeps]),
            points=np.concatenate([sweep.points_or_zero for sweep in self.sweeps]),
            weight=np.concatenate([sweep.weight for sweep in self.sweeps]),
            slopes=np.concatenate(slopes),
            basis=None,
        )


@dataclass(frozen=True, eq=False)
class AxisFit:
    """Axis fitted to one sweep of N positions and T targets, with its uncertainty and residuals."""

    sweep: Sweep  #: fitted sweep
    #: if this sweep turns two coupled joints: fit of the axis nearer to the flange (the outer axis) to the
    #: sweep that turns only its joint; None if this sweep turns one joint
    outer_fit: AxisFit | None
    #: axis in the tracker's frame, the inner axis if two joints turn; its point is next to the readings' mean
    axis: Axis
    #: (T, 3) targets in the tracker's frame [m], with the turning joint at model angle zero; if two joints
    #: turn, with the outer joint at zero and the inner joint as in the outer axis's sweep
    target_points: FloatArray
    #: (N,) angle of the turning joint from the readings minus the controller's angle, of mean zero [rad]
    angle_deviation: FloatArray
    angle_scale: float  #: slope of the angles from the readings over the controller's; 1 where both agree
    arc: float  #: angle that the readings cover [rad]
    #: (4 + 3 T, 3 N T) derivative of the axis's chart and the targets with respect to the whitened readings,
    #: in units of sigma
    influence: FloatArray
    #: (4, 4) derivative of the axis's chart with respect to the outer axis's chart; zero without outer axis
    dependence: FloatArray
    axis_covariance: FloatArray  #: (4, 4) covariance of the axis's chart, the outer axis's included
    residuals: FloatArray  #: (N, T, 3) reading minus prediction, tracker's frame [m]; zero where absent
    sigma: float  #: standard uncertainty of a coordinate [m], stated or from the residuals
    dof: int  #: degrees of freedom, the number of readings' coordinates less that of the unknowns
    linear: LinearFit  #: the linearised fit at the minimum, rows in the order of the readings (N, T, 3)

    @property
    def variance_factor(self) -> float:
        """χ²/dof: 1 on average if the stated sigma is right; exactly 1 where sigma was not stated."""
        return self.linear.rss / (self.dof * self.sigma**2)

    def compute_residual_rms(self) -> tuple[list[float | None], list[float | None]]:
        """Return the root mean squares of the radial and of the axial residuals of each target [m].

        The lists (T,) have None for a target without readings. If two axes turn, no radius is known: the
        first list then has the residuals in both directions perpendicular to the axis.
        """
        # In the axis's frame, the third coordinate is along the axis.
        residuals = self.residuals @ self.axis.frame
        arms = (self.sweep.points - self.residuals - self.axis.point) @ self.axis.frame
        radial: list[float | None] = []
        axial: list[float | None] = []
        two_axes_turn = self.outer_fit is not None
        for target in range(residuals.shape[1]):
            rows = self.sweep.present[:, target]
            if not rows.any():
                radial.append(None)
                axial.append(None)
                continue
            perpendicular, axial_part = residuals[rows, target, :2], residuals[rows, target, 2]
            if not two_axes_turn:  # project the residuals on the radius
                radius = arms[rows, target, :2]
                lengths = np.linalg.norm(radius, axis=1)
                perpendicular = np.sum(radius * perpendicular, axis=1) / np.maximum(lengths, 1e-300)
            radial.append(float(np.sqrt(np.mean(perpendicular**2))))
            axial.append(float(np.sqrt(np.mean(axial_part**2))))
        return radial, axial


def fit_axis(
    sweep: Sweep,
    turned_angles: FloatArray,
    *,
    sigma: float | None = None,
    angles: AngleUse = "free",
    outer_fit: AxisFit | None = None,
    slopes: FloatArray | None = None,
) -> AxisFit:
    """Fit the axis of a sweep in which one model joint turns, or the inner axis if two joints turn.

    Args:
        sweep: the readings.
        turned_angles: (N,) model angle of the turning joint, from the controller [rad]. If two joints turn,
            (N, 2): angle of the inner joint (nearer to the base) minus its angle in the outer axis's sweep,
            then angle of the outer joint (nearer to the flange).
        sigma: standard uncertainty of a coordinate [m]; None computes sigma from the residuals.
        angles: `free` estimates each position's angle from the readings, common to all targets;
            `controller` takes the controller's angles.
        outer_fit: if two joints turn, fit of the outer axis to the sweep that turns only its joint. Joints
            before the outer axis are at the same angles in both sweeps, but for the inner joint, whose
            angle was subtracted.
        slopes: (2,) derivative of the two model angles with respect to the controller's joint angle.

    Returns:
        The fit of all readings; suspect readings are not removed.

    Raises:
        MeasurementError: the readings do not determine an axis, or the fit does not converge.
    """
    controller_angles = turned_angles if outer_fit is None else sweep.angles[:, sweep.joint]
    model_angles = turned_angles.reshape(len(sweep), -1)
    # Corrections of the angles have mean zero: a common rotation is the same as a turn of the targets.
    correction_basis = helmert(len(sweep)).T if angles == "free" else np.zeros((len(sweep), 0))
    angle_slopes = np.broadcast_to(np.ones(1) if slopes is None else slopes, model_angles.shape)
    readings = PoseReadings(model_angles, sweep.points_or_zero, sweep.weight, angle_slopes, correction_basis)
    start = _estimate_start(sweep, readings, outer_fit)
    state, linear = fit_poses(readings, start, where=sweep.where, fitted_axes=1)
    dof = 3 * int(sweep.present.sum()) - linear.rank
    if dof < 1:
        raise MeasurementError(
            f"{int(sweep.present.sum())} readings are too few to check the fitted axis",
            where=sweep.where,
            remedy="record more positions or more targets",
        )
    if not linear.determines(slice(0, CHART_SIZE)):
        axis_name = "axis"
        remedy = "read a target that is farther from the axis, over a wider arc"
        if outer_fit is not None:
            axis_name = "inner one of the two axes that turn"
            remedy = "sweep a wider arc with more positions; two axes that coincide cannot be distinguished"
        raise MeasurementError(
            f"the readings do not determine the {axis_name}", where=sweep.where, remedy=remedy
        )
    sigma_of_fit = float(np.sqrt(linear.rss / dof)) if sigma is None else sigma
    motion = state.motion(readings)
    influence = linear.pseudo_inverse[: CHART_SIZE + state.targets.size]
    dependence = np.zeros((CHART_SIZE, CHART_SIZE))
    covariance = sigma_of_fit**2 * linear.covariance[:CHART_SIZE, :CHART_SIZE]
    if outer_fit is not None:
        outer_columns = readings.weight @ motion.jacobian()[..., CHART_SIZE : 2 * CHART_SIZE]
        dependence = -influence[:CHART_SIZE] @ outer_columns.reshape(-1, CHART_SIZE)
        covariance = covariance + dependence @ outer_fit.axis_covariance @ dependence.T
    centred = controller_angles - controller_angles.mean()
    return AxisFit(
        sweep=sweep,
        outer_fit=outer_fit,
        axis=state.axes[0],
        target_points=state.targets,
        angle_deviation=state.corrections,
        angle_scale=float(1.0 + centred @ state.corrections / (centred @ centred)),
        arc=float(np.ptp(controller_angles + state.corrections)),
        influence=influence,
        dependence=dependence,
        axis_covariance=covariance,
        residuals=np.where(sweep.present[..., None], readings.points - motion.points, 0.0),
        sigma=sigma_of_fit,
        dof=dof,
        linear=linear,
    )


def _estimate_start(sweep: Sweep, readings: PoseReadings, outer_fit: AxisFit | None) -> PoseState:
    """Return start values of axis and targets from a linear fit of circles.

    Target t moves on ``p_kt ≈ A_t + B_t cos θ_k + C_t sin θ_k`` at angles θ_k, linear in the unknown vectors
    A, B and C. ``B_t × C_t`` points along the axis; its length, the squared radius, weights the targets. The
    centres A_t lie on the axis; only if an outer axis turns back by the same angle, all centres are displaced
    from the axis by one vector.

    Raises:
        MeasurementError: no target was read often enough, or none shows a plane in which it turns.
    """
    turned_angles = readings.angles[:, 0]
    columns = np.column_stack([np.ones(len(sweep)), np.cos(turned_angles), np.sin(turned_angles)])
    normal_sum, centres, weights = np.zeros(3), [], []
    # Of the target that was read most often: number of readings, and its radius as a vector
    most_readings = 0
    radius_of_most_read = np.zeros(3)
    for target in np.flatnonzero(sweep.present.sum(axis=0) >= columns.shape[1]):
        rows = sweep.present[:, target]
        centre, cosine_vector, sine_vector = np.linalg.lstsq(
            columns[rows], sweep.points[rows, target], rcond=None
        )[0]
        normal_sum += cross(cosine_vector, sine_vector)
        centres.append(centre)
        weights.append(float(np.linalg.norm(cross(cosine_vector, sine_vector))))
        if rows.sum() > most_readings:
            most_readings, radius_of_most_read = rows.sum(), cosine_vector
    if not np.linalg.norm(normal_sum) > 0.0:
        raise MeasurementError(
            "no target moved on a circle",
            where=sweep.where,
            remedy="read at least one target in three or more positions, at a distance from the axis",
        )
    axis = Axis.through(np.average(centres, axis=0, weights=np.array(weights) + 1e-12), normal_sum)
    axes: tuple[Axis, ...] = (axis.represent_near(sweep.points[sweep.present].mean(axis=0)),)
    if outer_fit is not None:
        inner, (inner_slope, outer_slope) = axes[0], readings.slopes[0]
        # If the outer joint turns back by about the same angle, the outer axis itself moves on the circle,
        # and the inner axis is one radius away from the outer axis.
        if abs(inner_slope + outer_slope) < 0.5 * abs(inner_slope):
            inner = Axis.through(outer_fit.axis.point - radius_of_most_read, inner.direction)
        axes = (inner, outer_fit.axis)
    in_flange = Motion(axes, np.zeros((1, 3)), readings.angles).postures.to_flange(readings.points)
    present = sweep.present[..., None]
    targets = np.where(present, in_flange, 0.0).sum(axis=0) / np.maximum(present.sum(axis=0), 1)
    return PoseState(axes, targets, np.zeros(len(sweep)))


@dataclass(frozen=True, eq=False)
class SweptAxes(IdentifiedAxes):
    """Axes identified from sweeps, with a separate fit of each sweep."""

    sweeps: SweepSet  #: all sweeps; the columns of `influence` are in the order of their readings
    fits: tuple[AxisFit, ...]  #: separate fits, in the order of the sweeps
    residual: FloatArray  #: (3 N T,) whitened residuals of all readings [m]; zero where absent


def _fit_inner_axis(
    sweeps: SweepSet, sweep: Sweep, joint: int, outer_fit: AxisFit, *, angles: AngleUse
) -> AxisFit:
    """Fit a sweep that turns a joint and, by a coupling, a further joint, whose axis was fitted before.

    Args:
        sweeps: all sweeps.
        sweep: sweep that is fitted.
        joint: index of the inner joint, whose axis is fitted.
        outer_fit: fit of the further joint's axis.
        angles: use of the controller's angles.

    Raises:
        MeasurementError: the sweep turns joints that are not coupled, or cannot be fitted.
    """
    turning_joints = list(sweeps.find_turning_joints(sweep))
    model_angles = sweeps.model_angles(sweep)
    outer_posture = sweeps.model_angles(outer_fit.sweep).mean(axis=0)
    _refuse_joints_not_coupled(sweeps, sweep, outer_fit, model_angles.mean(axis=0) - outer_posture)
    return fit_axis(
        sweep,
        # The inner joint's angle is relative to its angle in the outer axis's sweep.
        model_angles[:, turning_joints] - [outer_posture[joint], 0.0],
        sigma=sweeps.sigma,
        angles=angles,
        outer_fit=outer_fit,
        slopes=sweeps.joint_map.matrix[turning_joints, sweep.joint],
    )


def identify_axes(sweeps: SweepSet, *, angles: AngleUse = "free") -> SweptAxes:
    """Fit each sweep separately, and transform the fitted axes to model angle zero.

    Args:
        sweeps: a sweep for each joint.
        angles: `free` estimates each position's angle of the turned joint from the readings; `controller`
            uses the controller's angles.

    Raises:
        MeasurementError: a joint has no sweep, a sweep turns joints that are not coupled, or a sweep cannot
            be fitted.
    """
    sweep_of_joint = sweeps.order
    first_columns = np.cumsum([0, *(sweep.points.size for sweep in sweeps.sweeps)])
    fits: dict[int, AxisFit] = {}
    # For each sweep, derivative of the axis's chart and the targets with respect to all whitened readings
    influences: dict[int, FloatArray] = {}
    # Last joint first: a sweep that turns two coupled joints needs the fit of the outer axis.
    for joint, sweep_index in reversed(list(enumerate(sweep_of_joint))):
        sweep = sweeps.sweeps[sweep_index]
        turning_joints = list(sweeps.find_turning_joints(sweep))
        columns = slice(first_columns[sweep_index], first_columns[sweep_index + 1])
        outer_sweep = sweep_of_joint[turning_joints[-1]]
        if len(turning_joints) == 1:
            model_angles = sweeps.model_angles(sweep)[:, joint]
            fit = fit_axis(sweep, model_angles, sigma=sweeps.sigma, angles=angles)
        else:
            fit = _fit_inner_axis(sweeps, sweep, joint, fits[outer_sweep], angles=angles)
        influence_of_fit = np.zeros((len(fit.influence), first_columns[-1]))
        influence_of_fit[:, columns] = fit.influence
        if len(turning_joints) > 1:
            influence_of_fit[:CHART_SIZE] += fit.dependence @ influences[outer_sweep][:CHART_SIZE]
        fits[sweep_index], influences[sweep_index] = fit, influence_of_fit
    fits_of_sweeps = tuple(fits[sweep_index] for sweep_index in range(len(fits)))
    rss = sum(fit.linear.rss for fit in fits_of_sweeps)
    dof = sum(fit.dof for fit in fits_of_sweeps)
    sigma = float(np.sqrt(rss / dof)) if sweeps.sigma is None else sweeps.sigma
    axes_at_sweeps = [fits[sweep_index].axis for sweep_index in sweep_of_joint]
    points = fits[sweep_of_joint[-1]].target_points
    axes, targets = _move_axes_to_zero(axes_at_sweeps, points, sweeps.postures)
    # Derivative of axes and targets in the postures of the sweeps; below, at model angle zero
    influence_at_sweep = np.vstack(
        [
            *(influences[sweep_index][:CHART_SIZE] for sweep_index in sweep_of_joint),
            influences[sweep_of_joint[-1]][CHART_SIZE:],
        ]
    )
    geometry_derivative, _ = _differentiate_swept_axes(axes, axes_at_sweeps, points, sweeps.postures)
    influence = np.asarray(np.linalg.solve(geometry_derivative, influence_at_sweep), dtype=np.float64)
    return SweptAxes(
        axes=axes,
        targets=targets,
        names=sweeps.targets,
        covariance=sigma**2 * influence @ influence.T,
        influence=influence,
        sigma=sigma,
        rss=rss,
        dof=dof,
        sweeps=sweeps,
        fits=fits_of_sweeps,
        residual=np.concatenate([fit.linear.residual for fit in fits_of_sweeps]),
    )


def _refuse_joints_not_coupled(
    sweeps: SweepSet, sweep: Sweep, outer_fit: AxisFit, angle_differences: FloatArray
) -> None:
    """Refuse a sweep that turns several model joints, unless a single controller joint turns two of them.

    The two model joints are the inner joint, nearer to the base, and the outer joint, nearer to the flange.
    `outer_fit` is the axis of the outer joint from its own sweep. `angle_differences` (n,) [rad] are the
    joint angles of `sweep` minus the joint angles of the outer joint's sweep.

    Raises:
        MeasurementError: the sweep turns more than one controller joint, or joints that cannot be separated.
    """
    turning_joints = sweeps.find_turning_joints(sweep)
    joints_text = " and ".join(str(joint + 1) for joint in turning_joints)
    inner_joint, outer_joint = turning_joints[:2]
    coupled_model_joints = np.flatnonzero(sweeps.joint_map.matrix[:, sweep.joint])
    moved_controller_joints = np.flatnonzero(np.ptp(sweep.angles, axis=0) > RESTING_RANGE)
    if list(moved_controller_joints) != [sweep.joint] or len(coupled_model_joints) > 2:
        raise MeasurementError(
            f"model joints {joints_text} turn in one sweep",
            where=sweep.where,
            remedy="turn one controller joint at a time; if the joint map couples more than two joints, "
            "move the other joints so that one axis turns; check the order of the rows",
        )
    if outer_fit.outer_fit is not None:  # the outer joint's own sweep turned two joints, too
        raise MeasurementError(
            f"model joint {outer_joint + 1} turns in this sweep, too, but the own sweep of this joint also "
            "turns two joints",
            where=sweep.where,
            remedy="turn the last of the coupled joints alone in a sweep of its own",
        )
    # The joints before the outer joint carry its axis: all of them but the inner joint must have had the same
    # angles in both sweeps.
    carrying_joints = [joint for joint in range(outer_joint) if joint != inner_joint]
    if carrying_joints and np.abs(angle_differences[carrying_joints]).max() > RESTING_RANGE:
        raise MeasurementError(
            f"this sweep moves the joints {joints_text} of the model, but the {outer_fit.sweep.where} "
            "was recorded in another configuration",
            where=sweep.where,
            remedy="start both sweeps from the same configuration of the other joints",
        )


def _move_axes_to_zero(
    axes_at_sweeps: Sequence[Axis], points: FloatArray, postures: FloatArray
) -> tuple[tuple[Axis, ...], FloatArray]:
    """Transform axes and targets from their sweeps to model angle zero.

    Return the n axes and the targets (T, 3) [m]. `axes_at_sweeps` has each axis as its own sweep shows it,
    `points` (T, 3) [m] the targets in the last joint's sweep, `postures` (n, n) [rad] the joint angles in
    each sweep.
    """
    axes = [axes_at_sweeps[0]]
    to_zero = pin.SE3.Identity()  # motion of an axis when the joints before it go to zero
    for axis, posture in zip(axes_at_sweeps[1:], postures[1:], strict=True):
        to_zero = Motion(axes, points, posture[None, : len(axes)]).postures.flange_placement(0).inverse()
        axes.append(axis.transform(to_zero))
    return tuple(axes), transform_points(to_zero, points)


def _differentiate_swept_axes(
    axes: Sequence[Axis], axes_at_sweeps: Sequence[Axis], points: FloatArray, postures: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Differentiate the axes as the sweeps show them, and the targets of the last joint's sweep.

    Args:
        axes: n axes at model angle zero.
        axes_at_sweeps: n axes, each in the posture of its own sweep.
        points: (T, 3) targets in the last joint's sweep [m].
        postures: (n, n) angles of the joints in each sweep [rad].

    Returns:
        The derivative (4 n + 3 T, 4 n + 3 T) with respect to charts of axes and targets at angle zero, and
        the derivative (4 n + 3 T, n, n) with respect to the joint angles in each sweep.
    """
    n, chart_count = len(axes), CHART_SIZE * len(axes)
    arm = Motion(axes, points, np.tril(postures, -1)).postures
    geometry_derivative = np.zeros((chart_count + points.size,) * 2)
    angle_derivative = np.zeros((chart_count + points.size, n, n))
    for joint, axis in enumerate(axes_at_sweeps):
        rows = slice(CHART_SIZE * joint, CHART_SIZE * (joint + 1))
        # (4, 6) maps a small motion to the chart of this axis
        motion_to_chart = axis.place.inverse().action[CHART]
        motions = np.concatenate(
            [arm.axis_motions[joint, :joint], arm.placement_motions[joint, joint : joint + 1]]
        )[..., CHART]
        geometry_derivative[rows, : rows.stop] = (
            (motion_to_chart @ motions).transpose(1, 0, 2).reshape(CHART_SIZE, -1)
        )
        angle_derivative[rows, joint, :joint] = motion_to_chart @ arm.jacobian[joint, :, :joint]
    motion_derivative = differentiate_by_rigid_motion(points).reshape(-1, 6)
    geometry_derivative[chart_count:, :chart_count] = (
        (motion_derivative @ arm.axis_motions[-1][..., CHART]).transpose(1, 0, 2).reshape(-1, chart_count)
    )
    geometry_derivative[chart_count:, chart_count:] = np.kron(np.eye(len(points)), arm.flange_rotation[-1])
    angle_derivative[chart_count:, -1, :-1] = motion_derivative @ arm.jacobian[-1, :, :-1]
    return geometry_derivative, angle_derivative


def refine_axes(identified: SweptAxes, *, angles: AngleUse = "free") -> SweptAxes:
    """Fit all sweeps together, starting from the axes of the separate fits.

    Args:
        identified: result of `identify_axes`, whose `fits` are returned unchanged.
        angles: `free` estimates each position's angle of the turned joint from the readings; `controller`
            uses the controller's angles.

    Returns:
        Axes and targets with their smaller covariance; `rss` and `dof` are those of the common fit.

    Raises:
        MeasurementError: the sweeps together leave an axis undetermined.
    """
    sweeps, readings = identified.sweeps, identified.sweeps.whitened
    position_count = len(readings.angles)
    if angles == "controller":
        readings = replace(readings, basis=np.zeros((position_count, 0)))
    start = PoseState(identified.axes, identified.targets, np.zeros(position_count))
    state, linear = fit_poses(readings, start, where="sweeps")
    # Number of unknowns of axes and targets
    geometry_unknowns = CHART_SIZE * identified.n + identified.targets.size
    dof = 3 * int(sweeps.present.sum()) - linear.rank
    if dof < 1 or not linear.determines(slice(0, geometry_unknowns)):
        raise MeasurementError(
            "the sweeps do not determine all axes and targets",
            where="sweeps",
            remedy="record more positions, and read every target in the last joint's sweep",
        )
    sigma = float(np.sqrt(linear.rss / dof)) if sweeps.sigma is None else sweeps.sigma
    return replace(
        identified,
        axes=state.axes,
        targets=state.targets,
        covariance=sigma**2 * linear.covariance[:geometry_unknowns, :geometry_unknowns],
        influence=linear.pseudo_inverse[:geometry_unknowns],
        sigma=sigma,
        rss=linear.rss,
        dof=dof,
        residual=linear.residual,
    )


def compute_restriction_p_value(free: SweptAxes, restricted: SweptAxes) -> float:
    """Return the p-value of an F-test of a restricted fit against a fit with more unknowns, `free`.

    The p-value is the probability that noise alone makes the residuals of the restricted fit so much larger.
    If the p-value is not small, the readings justify the restriction, such as the controller's angles.
    """
    restrictions = restricted.dof - free.dof
    if restrictions < 1:
        return 1.0
    increase = max(restricted.rss - free.rss, 0.0) / restrictions
    return float(special.fdtrc(restrictions, free.dof, increase / (free.rss / free.dof)))


def propagate_resting_angle_errors(swept: SweptAxes) -> tuple[FloatArray, list[int]]:
    """Compute how gear errors of resting joints displace the identified axes and targets.

    The sweep of a joint shows the standard deviation of the joint's gear error. Where the joint rests in
    other sweeps, the readings do not show its error: an independent error of this size is assumed for each
    angle at which the joint rests.

    Args:
        swept: axes fitted one by one with free angles.

    Returns:
        Displacements (4 n + 3 T, G) of charts and targets for one standard deviation of each of G errors; and
        the index (G,) of the controller joint of each error, in order from the last joint to the first.
    """
    sweeps, n = swept.sweeps, swept.n
    fits_of_joints = [swept.fits[index] for index in sweeps.order]
    axes_at_sweeps = [fit.axis for fit in fits_of_joints]
    points = fits_of_joints[-1].target_points
    geometry_derivative, angle_derivative = _differentiate_swept_axes(
        swept.axes, axes_at_sweeps, points, sweeps.postures
    )
    # Derivative of charts and targets at angle zero with respect to the joint angles in each sweep
    posture_derivative = -np.asarray(
        np.linalg.solve(geometry_derivative, angle_derivative.reshape(len(angle_derivative), n * n)),
        dtype=np.float64,
    )
    displacements, joint_of_error = [np.zeros((len(posture_derivative), 0))], []
    for fit in sorted(swept.fits, key=lambda fit: -fit.sweep.joint):
        joint = fit.sweep.joint
        # `gear_error` is the standard deviation [rad] of the joint from the controller's angles, without the
        # noise of the readings. The corrections are the last unknowns of the fit, in an orthonormal basis.
        deviation = fit.angle_deviation
        correction_rows = fit.linear.inverse[-(len(deviation) - 1) :]
        noise = fit.sigma**2 * float(np.sum(correction_rows**2))
        gear_error = float(np.sqrt(max(float(deviation @ deviation) - noise, 0.0) / (len(deviation) - 1)))
        # Group the sweeps of other joints by the angle at which this controller's joint rests
        angles = np.array([other.sweep.angles[:, joint].mean() for other in fits_of_joints])
        is_resting = np.array([other.sweep.joint != joint for other in fits_of_joints])
        ascending = np.sort(angles[is_resting])
        group_starts = ascending[np.flatnonzero(np.diff(ascending, prepend=-np.inf) > RESTING_RANGE)]
        group_of_sweep = np.searchsorted(group_starts, angles, side="right")
        for group in range(len(group_starts)):
            is_in_group = is_resting & (group_of_sweep == group + 1)
            # (n, n) change of the model angles in each sweep, per change of this controller joint's angle
            angle_changes = np.where(is_in_group[:, None], sweeps.joint_map.matrix[:, joint], 0.0)
            displacements.append(gear_error * posture_derivative @ angle_changes.reshape(-1, 1))
            joint_of_error.append(joint)
    return np.hstack(displacements), joint_of_error
