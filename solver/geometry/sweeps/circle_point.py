"""Circle points: the axis about which a sweep turns, by maximum likelihood, with its covariance.

All targets of a sweep share one axis (`circle_point_model`). How far each position has turned is, by
default, estimated from the readings (`angles="free"`), common to all targets: encoders and gears of a
heavy robot are wrong by some 50 µrad, which at 2 m is five times the noise of a tracker, and the
classical circle-point method does not trust them either. With perfect encoders `angles="controller"`
would be the better estimate; `python -m benchmarks geometry` prints by how much, and
what it costs with real ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.gauss_newton import LinearFit, minimise
from jointstiff.solver.geometry.sweeps.axis import CHART_SIZE, Axis
from jointstiff.solver.geometry.sweeps.circle_point_model import SweepState, WhitenedSweep, start
from jointstiff.solver.geometry.sweeps.sweep import Sweep
from jointstiff.solver.regression.pose import skew

AngleUse = Literal["free", "controller"]


@dataclass(frozen=True)
class TargetFit:
    """One target of a sweep."""

    radius: float  #: distance from the axis [m]
    offset: float  #: along the axis, from the axis's stated point [m]
    radial_rms: float  #: root mean square residual towards the axis [m]; NaN without a reading
    axial_rms: float  #: the same along the axis [m]
    readings: int  #: how many


@dataclass(frozen=True, eq=False)
class AxisFit:
    """The axis of one sweep and the evidence for it."""

    sweep: Sweep  #: what was fitted
    #: axis, targets in its frame, angles. The axis's point is the foot of the readings' mean.
    state: SweepState
    covariance: FloatArray  #: (4 + 3 T, 4 + 3 T) of the axis's chart and the targets in its frame, by `sigma`
    controller: FloatArray  #: (K,) angle of the turning model joint as the controller shows it [rad]
    residuals: FloatArray  #: (K, T, 3) reading minus prediction, in the axis's frame [m]; zero where absent
    sigma: float  #: standard uncertainty of a coordinate [m]: the stated one, else from the residuals
    sigma_stated: bool  #: whether it was stated
    rss: float  #: sum of squares of the residuals, whitened in units of sigma² [m²]
    dof: int  #: degrees of freedom, the number of readings' coordinates less that of the unknowns
    targets: tuple[TargetFit, ...]  #: evidence by target
    linear: LinearFit  #: the linearised fit at the minimum, rows in the order of the readings (K, T, 3)

    @property
    def influence(self) -> FloatArray:
        """Derivative (4 + 3 T, 3 K T) of chart and targets by the whitened readings, in units of sigma.

        What is computed from several fits, or twice from one, gets its covariance through it.
        """
        return np.asarray(self.linear.inverse[: len(self.covariance)] @ self.linear.left.T)

    @property
    def axis(self) -> Axis:
        """The axis in the tracker's frame."""
        return self.state.axis

    @property
    def axis_covariance(self) -> FloatArray:
        """Covariance (4, 4) of the axis's chart."""
        return self.covariance[:CHART_SIZE, :CHART_SIZE]

    @property
    def arc(self) -> float:
        """Angle that the readings cover [rad]."""
        return float(np.ptp(self.state.angles))

    @property
    def variance_factor(self) -> float:
        """χ²/dof: 1 on average if the stated sigma is right; exactly 1 where sigma was not stated."""
        return self.rss / (self.dof * self.sigma**2)

    @property
    def angle_deviation(self) -> FloatArray:
        """Angle from the readings less that of the controller (K,) [rad], of mean zero."""
        return self.state.angles - self.controller

    @property
    def angle_scale(self) -> float:
        """Slope of the angles from the readings over the controller's; 1 where both agree."""
        centred = self.controller - self.controller.mean()
        return float(1.0 + centred @ self.angle_deviation / (centred @ centred))

    def target_points(self) -> FloatArray:
        """Targets (T, 3) in the tracker's frame with the turning joint at model angle zero [m]."""
        return np.asarray(self.axis.point + self.state.targets @ self.axis.frame.T)

    def target_influence(self) -> FloatArray:
        """Derivative (3 T, 3 K T) of `target_points` by the whitened readings, in units of sigma."""
        U, local = self.axis.frame, self.state.targets
        by_chart = np.concatenate([np.broadcast_to(np.eye(3), (len(local), 3, 3)), -skew(local)], axis=-1)
        by_axis = (U @ by_chart)[..., [0, 1, 3, 4]].reshape(-1, CHART_SIZE)
        by_target = np.kron(np.eye(len(local)), U)
        return np.asarray(by_axis @ self.influence[:CHART_SIZE] + by_target @ self.influence[CHART_SIZE:])


def fit_axis(
    sweep: Sweep, controller: FloatArray, *, sigma: float | None = None, angles: AngleUse = "free"
) -> AxisFit:
    """Fit the axis of a sweep in which one model joint turns.

    Args:
        sweep: the readings.
        controller: (K,) angle of that joint in the model, by the controller [rad].
        sigma: standard uncertainty of a coordinate [m]; from the residuals if None.
        angles: `free` estimates each position's angle from the readings, common to all targets;
            `controller` takes the controller's.

    Returns:
        The fit. Suspect readings are named in it and not removed.

    Raises:
        MeasurementError: the readings do not determine an axis, or the fit does not converge.
    """
    data = WhitenedSweep.of(sweep, controller, free_angles=angles == "free")
    kept = CHART_SIZE + 3 * sweep.targets

    def stepped(state: SweepState, step: FloatArray) -> SweepState:
        return state.stepped(step[:kept], data.basis @ step[kept:])

    state, linear = minimise(
        start(sweep, controller), data.residual, data.jacobian, stepped, where=sweep.where
    )
    dof = 3 * int(sweep.present.sum()) - linear.rank
    _refuse_undetermined(linear, dof, sweep)
    rss = float(linear.residual @ linear.residual)
    used = float(np.sqrt(rss / dof)) if sigma is None else sigma
    residuals = np.where(sweep.present[..., None], (sweep.points - state.points()) @ state.axis.frame, 0.0)
    return AxisFit(
        sweep=sweep,
        state=state,
        covariance=used**2 * linear.covariance[:kept, :kept],
        controller=controller,
        residuals=residuals,
        sigma=used,
        sigma_stated=sigma is not None,
        rss=rss,
        dof=dof,
        targets=_target_fits(state, residuals, sweep),
        linear=linear,
    )


def _refuse_undetermined(linear: LinearFit, dof: int, sweep: Sweep) -> None:
    if dof < 1:
        raise MeasurementError(
            f"{int(sweep.present.sum())} readings leave no redundancy to check the axis",
            where=sweep.where,
            remedy="record more positions or more targets",
        )
    if not linear.determines(slice(0, CHART_SIZE)):
        raise MeasurementError(
            "the readings do not determine the axis",
            where=sweep.where,
            remedy="read a target that is farther from the axis, over a wider arc",
        )


def _target_fits(state: SweepState, residuals: FloatArray, sweep: Sweep) -> tuple[TargetFit, ...]:
    arms = state.arms[..., :2]
    radius = np.linalg.norm(state.targets[:, :2], axis=1)
    outward = arms / np.maximum(radius, 1e-300)[None, :, None]
    radial = np.einsum("ktj,ktj->kt", outward, residuals[..., :2])
    fits = []
    for t in range(sweep.targets):
        rows = sweep.present[:, t]
        rms = [float(np.sqrt(np.mean(part[rows, t] ** 2))) if rows.any() else float("nan")
               for part in (radial, residuals[..., 2])]  # fmt: skip
        fits.append(TargetFit(float(radius[t]), float(state.targets[t, 2]), rms[0], rms[1], int(rows.sum())))
    return tuple(fits)
