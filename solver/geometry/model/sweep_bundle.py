"""All sweeps in one fit: what each sweep by itself does not use is that they show the same robot.

Every sweep also tells where the targets are on the flange and where the axes farther out are. One fit for
all uses that; it needs no sweep to be of one model joint alone, so coupled axes are an ordinary case.
In return it trusts the controller's angles of the joints at rest, within a sweep and from one to the
next. With free angles it does not trust those of the joint that turns, not even in the mean over a sweep:
a gear that is off by 60 µrad at rest would move the axes farther out by 0.1 mm. Its χ², beside that of the
sweeps one by one, says whether the robot agrees.
"""

from __future__ import annotations

import numpy as np

from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.sweeps.axis import CHART_SIZE
from jointstiff.solver.geometry.sweeps.circle_point import AngleUse
from jointstiff.solver.geometry.sweeps.pose_fit import PoseReadings, PoseState, fit_poses
from jointstiff.solver.geometry.sweeps.sweep import SweepSet
from jointstiff.solver.geometry.sweeps.swept_axes import SweptAxes, robust_sigma


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
    readings = _readings(sweeps, free=angles == "free")
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
    return SweptAxes(
        axes=state.axes,
        targets=state.targets,
        names=identified.names,
        covariance=sigma**2 * linear.covariance[:kept, :kept],
        influence=linear.pseudo_inverse[:kept],
        sigma=sigma,
        rss=rss,
        dof=dof,
        sweeps=sweeps,
        fits=identified.fits,
        robust_sigma=robust_sigma(sweeps, linear.residual, dof),
    )


def _readings(sweeps: SweepSet, *, free: bool) -> PoseReadings:
    parts = sweeps.sweeps
    points, weight = zip(*(sweep.whitened() for sweep in parts), strict=True)
    slopes = np.concatenate(
        [np.tile(sweeps.joint_map.matrix[:, sweep.joint], (len(sweep), 1)) for sweep in parts]
    )
    return PoseReadings(
        angles=np.concatenate([sweeps.model_angles(sweep) for sweep in parts]),
        points=np.concatenate(points),
        weight=np.concatenate(weight),
        slopes=slopes,
        basis=None if free else np.zeros((len(slopes), 0)),
    )
