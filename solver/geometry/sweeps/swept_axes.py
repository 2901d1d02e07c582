"""The axes of a robot from its sweeps.

A sweep shows an axis where the joints before it have put it. Turning these back, one after the other,
about the axes already known, brings every axis to model angle zero (`identify_axes`).

What each sweep by itself does not use is that they show the same robot (`refine_axes`). Every sweep also
tells where the targets are on the flange and where the axes farther out are. One fit for all uses that; it
needs no sweep to be of one model joint alone, so coupled axes are an ordinary case. In return it trusts the
controller's angles of the joints at rest, within a sweep and from one to the next. With free angles it does
not trust those of the joint that turns, not even in the mean over a sweep: a gear that is off by 60 µrad at
rest would move the axes farther out by 0.1 mm. Its χ², beside that of the sweeps one by one, says whether the
robot agrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.sweeps.axis import CHART_SIZE, Axis, rotation_about
from jointstiff.solver.geometry.sweeps.circle_point import AngleUse, AxisFit, SweptTarget, fit_axis
from jointstiff.solver.geometry.sweeps.identified_axes import IdentifiedAxes, derivative
from jointstiff.solver.geometry.sweeps.pose_fit import PoseReadings, PoseState, fit_poses
from jointstiff.solver.geometry.sweeps.sweep import STILL, Sweep, SweepSet

_STEP = 1e-6  # of the difference quotients [rad]


@dataclass(frozen=True)
class SweepEvidence:
    """One sweep, fitted by itself."""

    joint: str  #: joint of the controller, by name
    turned: tuple[str, ...]  #: names of the model's joints that turn
    positions: int  #: how many
    arc: float  #: angle that the readings cover [rad]
    targets: tuple[SweptTarget, ...]  #: evidence by target
    angle_scale: float  #: angle by the readings over that of the controller, dimensionless
    #: root mean square of their difference [rad]; None if the controller's are taken
    angle_deviation: float | None
    variance_factor: float  #: χ²/dof, 1 on average if sigma is right


@dataclass(frozen=True, eq=False)
class SweptAxes(IdentifiedAxes):
    """Axes identified from sweeps, one by one."""

    sweeps: SweepSet  #: the set; the whitened readings of `influence` are in its order
    fits: tuple[AxisFit, ...]  #: the fit of each sweep, in its order
    #: standard uncertainty of a coordinate from the median of the residuals [m], to which a few sweeps that
    #: do not fit add little
    robust_sigma: float

    @property
    def order(self) -> tuple[int, ...]:
        """Index of the sweep that tells the axis of each model joint (n,)."""
        return tuple(_sweep_of_joint(self.sweeps))

    def evidence(self, joints: Sequence[str]) -> tuple[SweepEvidence, ...]:
        """Return the evidence of each sweep by itself, with these names of the model's joints."""
        return tuple(
            SweepEvidence(
                joint=fit.sweep.name,
                turned=tuple(joints[index] for index in self.sweeps.turning(fit.sweep)),
                positions=len(fit.sweep),
                arc=fit.arc,
                targets=fit.targets(self.names),
                angle_scale=fit.angle_scale,
                angle_deviation=float(np.sqrt(np.mean(fit.angle_deviation**2)))
                if fit.angle_deviation.any()
                else None,
                variance_factor=fit.variance_factor,
            )
            for fit in self.fits
        )


def identify_axes(sweeps: SweepSet, *, angles: AngleUse = "free") -> SweptAxes:
    """Fit all sweeps and bring their axes to model angle zero.

    Args:
        sweeps: one for each joint.
        angles: see `circle_point.fit_axis`.

    Raises:
        MeasurementError: a joint without a sweep, a sweep that turns what it should not, or one that
            cannot be fitted.
    """
    order = _sweep_of_joint(sweeps)
    fits = _fit_all(sweeps, order, angles)
    rss, dof = sum(fit.rss for fit in fits), sum(fit.dof for fit in fits)
    sigma = float(np.sqrt(rss / dof)) if sweeps.sigma is None else sweeps.sigma
    at_sweep, points, postures = _as_swept(sweeps, fits, order)
    axes, targets = _to_zero(at_sweep, points, postures)

    def charts(moved: Sequence[Axis], at: FloatArray) -> FloatArray:
        return _charts(axes, *_to_zero(moved, at, postures))

    influence = derivative(at_sweep, points, charts) @ _stacked_influence(fits, order)
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
        fits=fits,
        robust_sigma=robust_sigma(sweeps, np.concatenate([fit.linear.residual for fit in fits]), dof),
    )


def influence_of_postures(swept: SweptAxes) -> FloatArray:
    """Return the derivative (4 n + 3 T, n · n) of axes and targets by the model angles in each joint's sweep.

    Columns go by joint of the sweep, then by the angle that changes. For axes fitted one by one.
    """
    at_sweep, points, postures = _as_swept(swept.sweeps, swept.fits, swept.order)

    def moved(step: FloatArray) -> FloatArray:
        return _charts(swept.axes, *_to_zero(at_sweep, points, postures + step.reshape(postures.shape)))

    steps = _STEP * np.eye(postures.size)
    return np.stack([(moved(step) - moved(-step)) / (2.0 * _STEP) for step in steps], axis=1)


def _as_swept(
    sweeps: SweepSet, fits: Sequence[AxisFit], order: Sequence[int]
) -> tuple[list[Axis], FloatArray, FloatArray]:
    """Each axis and the targets (T, 3) as in their sweeps, and the mean model angles (n, n) [rad] there."""
    postures = np.array([sweeps.model_angles(sweeps.sweeps[index]).mean(axis=0) for index in order])
    return [fits[index].axis for index in order], fits[order[-1]].target_points, postures


def _charts(axes: Sequence[Axis], moved: Sequence[Axis], targets: FloatArray) -> FloatArray:
    """Charts of moved axes about others, then the targets' coordinates (4 n + 3 T,)."""
    charts = [axis.chart(other) for axis, other in zip(axes, moved, strict=True)]
    return np.concatenate([*charts, targets.ravel()])


def robust_sigma(sweeps: SweepSet, residual: FloatArray, dof: int) -> float:
    """Return the standard uncertainty of a coordinate [m] by the median of the absolute residuals.

    Args:
        sweeps: the set.
        residual: whitened residuals of its readings in its order [m]; absent ones are ignored.
        dof: degrees of freedom of the residuals.
    """
    present = np.concatenate([sweep.present.ravel() for sweep in sweeps.sweeps])
    residuals = residual.reshape(-1, 3)[present]
    return float(np.median(np.abs(residuals)) / special.ndtri(0.75) * np.sqrt(residuals.size / dof))


def _sweep_of_joint(sweeps: SweepSet) -> list[int]:
    """Index of the sweep that tells the axis of each model joint: of coupled ones, the first."""
    sweep_of = {min(sweeps.turning(sweep)): index for index, sweep in enumerate(sweeps.sweeps)}
    missing = [joint + 1 for joint in range(sweeps.joint_map.n) if joint not in sweep_of]
    if missing:
        raise MeasurementError(
            f"no sweep determines the axis of model joint {', '.join(map(str, missing))}",
            where="sweeps",
            remedy="turn each joint alone in a sweep of its own",
        )
    return [sweep_of[joint] for joint in range(sweeps.joint_map.n)]


def _fit_all(sweeps: SweepSet, order: Sequence[int], angles: AngleUse) -> tuple[AxisFit, ...]:
    fits: dict[int, AxisFit] = {}
    for index in reversed(order):  # a coupled sweep needs the axis farther out
        sweep = sweeps.sweeps[index]
        turning, turned = list(sweeps.turning(sweep)), sweeps.model_angles(sweep)
        if len(turning) == 1:
            fits[index] = fit_axis(sweep, turned[:, turning[0]], sigma=sweeps.sigma, angles=angles)
            continue
        outer = fits[order[turning[-1]]]
        there = sweeps.model_angles(outer.sweep).mean(axis=0)
        _refuse_unless_coupled(sweeps, sweep, outer, turned.mean(axis=0) - there)
        fits[index] = fit_axis(
            sweep,
            turned[:, turning] - [there[turning[0]], 0.0],
            sigma=sweeps.sigma,
            angles=angles,
            outer=outer,
            slopes=sweeps.joint_map.matrix[turning, sweep.joint],
        )
    return tuple(fits[index] for index in range(len(sweeps.sweeps)))


def _refuse_unless_coupled(sweeps: SweepSet, sweep: Sweep, outer: AxisFit, apart: FloatArray) -> None:
    """Refuse a sweep that turns several joints, but for one by a single controller joint that turns two.

    Joints before the outer one carry its axis: but for the inner one they must stand as in its sweep. They
    are `apart` (n,) [rad].
    """
    turning = sweeps.turning(sweep)
    joints = " and ".join(str(joint + 1) for joint in turning)
    coupled = np.flatnonzero(sweeps.joint_map.matrix[:, sweep.joint])
    moved = np.flatnonzero(np.ptp(sweep.angles, axis=0) > STILL)
    if list(moved) != [sweep.joint] or len(coupled) > 2:
        raise MeasurementError(
            f"model joints {joints} turn in one sweep",
            where=sweep.where,
            remedy="turn one controller joint at a time; if the joint map couples more than two joints, "
            "command the others so that one axis turns; check the order of the rows",
        )
    if outer.outer is not None:
        raise MeasurementError(
            f"model joint {turning[1] + 1} turns as well, and its own sweep is a coupled one, too",
            where=sweep.where,
            remedy="turn the last of the coupled joints alone in a sweep of its own",
        )
    before = [joint for joint in range(turning[1]) if joint != turning[0]]
    if before and np.abs(apart[before]).max() > STILL:
        raise MeasurementError(
            f"this sweep turns model joints {joints}, and it was taken in another configuration than the "
            f"{outer.sweep.where}",
            where=sweep.where,
            remedy="start both sweeps from the same configuration of the other joints",
        )


def _to_zero(
    at_sweep: Sequence[Axis], points: FloatArray, postures: FloatArray
) -> tuple[tuple[Axis, ...], FloatArray]:
    """Axes at zero from each in its sweep's posture (n, n), and the targets from the last sweep's."""
    axes: list[Axis] = []
    for joint, axis in enumerate(at_sweep):
        back = axis
        for earlier in range(joint):
            back = back.carried(axes[earlier], -float(postures[joint, earlier]))
        axes.append(back)
    for earlier in range(len(axes) - 1):
        R, t = rotation_about(axes[earlier], -float(postures[-1, earlier]))
        points = points @ R.T + t
    return tuple(axes), points


def _stacked_influence(fits: Sequence[AxisFit], order: Sequence[int]) -> FloatArray:
    """Derivative of all axes in their sweeps and the last one's targets by all readings."""
    starts = np.cumsum([0, *(fit.influence.shape[1] for fit in fits)])

    def spread(index: int, rows: slice) -> FloatArray:
        """Influence of all readings on one fit: its own, and on its axis through the outer one."""
        fit = fits[index]
        own = fit.influence[rows]
        out = np.zeros((len(own), starts[-1]))
        out[:, starts[index] : starts[index + 1]] = own
        if fit.outer is not None and rows == axis:
            out += fit.dependence @ spread(next(i for i in order if fits[i] is fit.outer), axis)
        return out

    axis, targets = slice(0, CHART_SIZE), slice(CHART_SIZE, None)
    return np.vstack([*(spread(index, axis) for index in order), spread(order[-1], targets)])


def refine_axes(identified: SweptAxes, *, angles: AngleUse = "free") -> SweptAxes:
    """Fit all sweeps together, starting from their axes one by one.

    Args:
        identified: from `identify_axes`; its `fits` are kept as they are.
        angles: `free` estimates for each position by how much the joint that was turned differs from the
            controller's angle; `controller` takes the controller's.

    Returns:
        Axes and targets with their smaller covariance; `rss` and `dof` are of this fit.

    Raises:
        MeasurementError: the sweeps together leave an axis undetermined.
    """
    sweeps = identified.sweeps
    parts = sweeps.sweeps
    points, weight = zip(*(sweep.whitened() for sweep in parts), strict=True)
    slopes = np.concatenate(
        [np.tile(sweeps.joint_map.matrix[:, sweep.joint], (len(sweep), 1)) for sweep in parts]
    )
    readings = PoseReadings(
        angles=np.concatenate([sweeps.model_angles(sweep) for sweep in parts]),
        points=np.concatenate(points),
        weight=np.concatenate(weight),
        slopes=slopes,
        basis=None if angles == "free" else np.zeros((len(slopes), 0)),
    )
    first = PoseState(identified.axes, identified.targets, np.zeros(len(readings.angles)))
    state, linear = fit_poses(readings, first, where="sweeps")
    kept = CHART_SIZE * identified.n + identified.targets.size
    dof = 3 * sum(int(sweep.present.sum()) for sweep in sweeps.sweeps) - linear.unknowns
    if dof < 1 or not linear.determines(slice(0, kept)):
        raise MeasurementError(
            "the sweeps do not determine all axes and targets",
            where="sweeps",
            remedy="record more positions, and read every target in the last joint's sweep",
        )
    rss = float(linear.residual @ linear.residual)
    sigma = float(np.sqrt(rss / dof)) if sweeps.sigma is None else sweeps.sigma
    return replace(
        identified,
        axes=state.axes,
        targets=state.targets,
        covariance=sigma**2 * linear.covariance[:kept, :kept],
        influence=linear.pseudo_inverse[:kept],
        sigma=sigma,
        rss=rss,
        dof=dof,
        robust_sigma=robust_sigma(sweeps, linear.residual, dof),
    )
