"""The uncertainty of the angles at which joints rest while others turn.

The readings show how far each joint is from the controller's angle while it turns: its gear's error. At
rest it is off by as much, and nothing shows it. Where joints rest at the same angles in all sweeps, that
only turns what model angle zero means; where they do not, it moves the axes against each other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry.sweeps.findings import uneven
from jointstiff.solver.geometry.sweeps.sweep import STILL
from jointstiff.solver.geometry.sweeps.swept_axes import SweptAxes, influence_of_postures


def resting_angles(swept: SweptAxes, probability: float, *, first: int = 0) -> FloatArray:
    """Return what gear errors at rest do to axes and targets: (4 n + 3 T, G), one column a standard one.

    Args:
        swept: axes fitted one by one with free angles.
        probability: that the controller's angles fit; if it is not small, gears are even and G is 0.
        first: joint of the controller from which on errors count. Columns go from the last joint inwards, so
            that those of fewer joints are the first of all.
    """
    columns = []
    if uneven(probability):
        matrix, by_posture = swept.sweeps.joint_map.matrix, influence_of_postures(swept)
        turned_from_last = sorted(swept.fits, key=lambda fit: -fit.sweep.joint)
        for fit in (fit for fit in turned_from_last if fit.sweep.joint >= first):
            joint = fit.sweep.joint
            # Standard deviation [rad] of a joint from the controller's angles, beyond the readings' noise
            deviation = fit.angle_deviation
            own = fit.linear.inverse[-(len(deviation) - 1) :]  # of the corrections, in an orthonormal basis
            noise = fit.sigma**2 * float(np.sum(own**2))
            size = float(np.sqrt(max(float(deviation @ deviation) - noise, 0.0) / (len(deviation) - 1)))
            # Masks (n,) of the sweeps, by model joint, in which a controller's joint rests at one angle
            order = [swept.sweeps.sweeps[index] for index in swept.order]
            angles = np.array([sweep.angles[:, joint].mean() for sweep in order])
            others = np.array([sweep.joint != joint for sweep in order])
            ascending = np.sort(angles[others])
            starts = ascending[np.flatnonzero(np.diff(ascending, prepend=-np.inf) > STILL)]
            number = np.searchsorted(starts, angles, side="right")
            for group in [others & (number == index + 1) for index in range(len(starts))]:
                turned = np.where(group[:, None], matrix[:, joint], 0.0)
                columns.append(size * by_posture @ turned.ravel())
    return np.array(columns).T if columns else np.zeros((len(swept.covariance), 0))


def widened(identified: SweptAxes, columns: FloatArray) -> SweptAxes:
    """Return the axes with an uncertainty that includes these columns, beside that of the readings."""
    return replace(
        identified,
        covariance=identified.covariance + columns @ columns.T,
        influence=np.hstack([identified.influence, columns / identified.sigma]),
    )
