"""The axis about which a sweep turns, by maximum likelihood, with its covariance.

All targets of a sweep share one axis: they run on circles about it (the circle-point method). The fit is
`pose_fit` with that axis alone. How far each position has turned is, by default, estimated from the readings
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
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import helmert

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.gauss_newton import LinearFit
from jointstiff.solver.geometry.sweeps.axis import CHART_SIZE, Axis
from jointstiff.solver.geometry.sweeps.pose_fit import Motion, PoseReadings, PoseState, fit_poses
from jointstiff.solver.geometry.sweeps.sweep import Sweep

AngleUse = Literal["free", "controller"]


@dataclass(frozen=True)
class SweptTarget:
    """One target of a sweep; NaN for what it does not show."""

    name: str
    readings: int  #: how many
    radius: float  #: distance from the axis [m]; NaN in a sweep that turns two axes
    radial_rms: float  #: root mean square of the residuals towards the axis, across it where two turn [m]
    axial_rms: float  #: the same along the axis [m]


@dataclass(frozen=True, eq=False)
class AxisFit:
    """The axis of one sweep and the evidence for it."""

    sweep: Sweep  #: fitted sweep
    outer: AxisFit | None  #: where the sweep turns two axes, the fit of the outer one, from its own sweep
    axis: Axis  #: the (inner) axis in the tracker's frame; its point is the foot of the readings' mean
    #: (T, 3) in the tracker's frame with the turning joint at model angle zero; where two turn, with the
    #: outer one at zero and the inner one as in the outer one's sweep [m]
    target_points: FloatArray
    #: (K,) angle of the turning joint from the readings less that of the controller, of mean zero [rad]
    angle_deviation: FloatArray
    angle_scale: float  #: slope of the angles from the readings over the controller's; 1 where both agree
    arc: float  #: angle that the readings cover [rad]
    #: (4 + 3 T, 3 K T) derivative of chart and targets by the whitened readings, in units of sigma; what is
    #: computed from several fits, or twice from one, gets its covariance through it
    influence: FloatArray
    dependence: FloatArray  #: (4, 4) derivative of the axis's chart by the outer one's; zero without
    axis_covariance: FloatArray  #: (4, 4) of the axis's chart, by `sigma`, the outer axis's part included
    residuals: FloatArray  #: (K, T, 3) reading minus prediction, tracker's frame [m]; zero where absent
    sigma: float  #: standard uncertainty of a coordinate [m]: the stated one, else from the residuals
    sigma_stated: bool  #: whether it was stated
    rss: float  #: sum of squares of the residuals, whitened in units of sigma² [m²]
    dof: int  #: degrees of freedom, the number of readings' coordinates less that of the unknowns
    linear: LinearFit  #: the linearised fit at the minimum, rows in the order of the readings (K, T, 3)

    @property
    def variance_factor(self) -> float:
        """χ²/dof: 1 on average if the stated sigma is right; exactly 1 where sigma was not stated."""
        return self.rss / (self.dof * self.sigma**2)

    def targets(self, names: Sequence[str]) -> tuple[SweptTarget, ...]:
        """Return the evidence by target (T,), by these names."""
        residuals = self.residuals @ self.axis.frame
        arms = (self.sweep.points - self.residuals - self.axis.point) @ self.axis.frame
        targets = []
        for t, name in enumerate(names):
            rows = self.sweep.present[:, t]
            radius, across = float("nan"), residuals[rows, t, :2]
            if self.outer is None and rows.any():
                lengths = np.linalg.norm(arms[rows, t, :2], axis=1)
                across = np.sum(arms[rows, t, :2] * across, axis=1) / np.maximum(lengths, 1e-300)
                radius = float(lengths.mean())
            rms = [float(np.sqrt(np.mean(np.square(part)))) if rows.any() else float("nan")
                   for part in (across, residuals[rows, t, 2])]  # fmt: skip
            targets.append(SweptTarget(name, int(rows.sum()), radius, *rms))
        return tuple(targets)


def fit_axis(
    sweep: Sweep,
    turned: FloatArray,
    *,
    sigma: float | None = None,
    angles: AngleUse = "free",
    outer: AxisFit | None = None,
    slopes: FloatArray | None = None,
) -> AxisFit:
    """Fit the axis of a sweep in which one model joint turns, or the inner one where two turn.

    Args:
        sweep: the readings.
        turned: (K,) angle of that joint in the model, by the controller [rad]. Where two turn (K, 2): of the
            inner joint, less its angle in the outer axis's sweep, and of the outer joint.
        sigma: standard uncertainty of a coordinate [m]; from the residuals if None.
        angles: `free` estimates each position's angle from the readings, common to all targets;
            `controller` takes the controller's.
        outer: the outer axis where two turn, from a sweep of its own; joints before it stand there as here,
            and the inner one at the angle that was subtracted.
        slopes: (2,) of the model angles by that of the controller's joint, where two turn.

    Returns:
        The fit. Suspect readings are named in it and not removed.

    Raises:
        MeasurementError: the readings do not determine an axis, or the fit does not converge.
    """
    shown = turned if outer is None else sweep.angles[:, sweep.joint]
    model_angles = turned.reshape(len(sweep), -1)
    basis = helmert(len(sweep)).T if angles == "free" else np.zeros((len(sweep), 0))
    points, weight = sweep.whitened()
    by_correction = np.broadcast_to(np.ones(1) if slopes is None else slopes, model_angles.shape)
    readings = PoseReadings(model_angles, points, weight, by_correction, basis)
    state, linear = fit_poses(readings, _start(sweep, readings, outer), where=sweep.where, fitted=1)
    dof = 3 * int(sweep.present.sum()) - linear.rank
    if dof < 1:
        raise MeasurementError(
            f"{int(sweep.present.sum())} readings leave no redundancy to check the axis",
            where=sweep.where,
            remedy="record more positions or more targets",
        )
    if not linear.determines(slice(0, CHART_SIZE)):
        raise MeasurementError(
            "the readings do not determine the axis"
            if outer is None
            else "the readings do not determine the inner one of the two axes that turn",
            where=sweep.where,
            remedy="read a target that is farther from the axis, over a wider arc"
            if outer is None
            else "sweep a wider arc with more positions; two axes that coincide cannot be distinguished",
        )
    rss = float(linear.residual @ linear.residual)
    used = float(np.sqrt(rss / dof)) if sigma is None else sigma
    motion = Motion(state, readings)
    influence = linear.pseudo_inverse[: CHART_SIZE + 3 * sweep.targets]
    dependence = np.zeros((CHART_SIZE, CHART_SIZE))
    covariance = used**2 * linear.covariance[:CHART_SIZE, :CHART_SIZE]
    if outer is not None:
        by_outer = (weight @ motion.jacobian()[..., CHART_SIZE : 2 * CHART_SIZE]).reshape(points.size, -1)
        dependence = -influence[:CHART_SIZE] @ by_outer
        covariance = covariance + dependence @ outer.axis_covariance @ dependence.T
    centred = shown - shown.mean()
    return AxisFit(
        sweep=sweep,
        outer=outer,
        axis=state.axes[0],
        target_points=state.targets,
        angle_deviation=state.corrections,
        angle_scale=float(1.0 + centred @ state.corrections / (centred @ centred)),
        arc=float(np.ptp(shown + state.corrections)),
        influence=influence,
        dependence=dependence,
        axis_covariance=covariance,
        residuals=np.where(sweep.present[..., None], points - motion.stages[0], 0.0),
        sigma=used,
        sigma_stated=sigma is not None,
        rss=rss,
        dof=dof,
        linear=linear,
    )


def _start(sweep: Sweep, readings: PoseReadings, outer: AxisFit | None) -> PoseState:
    """Start values without iteration, from ``p_kt ≈ A_t + B_t cos θ_k + C_t sin θ_k``, linear in A, B, C.

    ``B_t × C_t`` points along the axis, by the square of the target's radius, so that targets count by what
    they know of it; the centres A_t lie on it, unless an outer axis turns back as far: then each is displaced
    by the same vector from it.

    Raises:
        MeasurementError: no target was read often enough, or none shows a plane in which it turns.
    """
    turned = readings.angles[:, 0]
    columns = np.column_stack([np.ones(len(sweep)), np.cos(turned), np.sin(turned)])
    normal, centres, radii, count, radius = np.zeros(3), [], [], 0, np.zeros(3)
    for t in np.flatnonzero(sweep.present.sum(axis=0) >= columns.shape[1]):
        rows = sweep.present[:, t]
        A, B, C = np.linalg.lstsq(columns[rows], sweep.points[rows, t], rcond=None)[0]
        normal += np.cross(B, C)
        centres.append(A)
        radii.append(float(np.linalg.norm(np.cross(B, C))))
        if rows.sum() > count:
            count, radius = rows.sum(), B
    if not np.linalg.norm(normal) > 0.0:
        raise MeasurementError(
            "no target moved on a circle",
            where=sweep.where,
            remedy="read at least one target in three or more positions, at a distance from the axis",
        )
    centre = np.average(centres, axis=0, weights=np.array(radii) + 1e-12)
    axes: tuple[Axis, ...] = (Axis.through(centre, normal).slid_to(sweep.points[sweep.present].mean(axis=0)),)
    if outer is not None:
        inner, (slope, back) = axes[0], readings.slopes[0]
        if abs(slope + back) < 0.5 * abs(slope):
            inner = Axis.through(outer.axis.point - radius, inner.direction)
        axes = (inner, outer.axis)
    local = readings.points
    for axis, angles in zip(axes, readings.angles.T, strict=True):
        local = axis.turned(axis.turns(-angles), local)
    present = sweep.present[..., None]
    targets = np.where(present, local, 0.0).sum(axis=0) / np.maximum(present.sum(axis=0), 1)
    return PoseState(axes, targets, np.zeros(len(sweep)))
