"""Evidence of one sweep that is fitted by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry.sweeps.circle_point import AxisFit
from jointstiff.solver.geometry.sweeps.coupled_sweep import CoupledFit
from jointstiff.solver.geometry.sweeps.swept_axes import SweptAxes


@dataclass(frozen=True)
class SweptTarget:
    """One target of a sweep; NaN for what it does not show."""

    name: str
    readings: int  #: how many
    radius: float  #: distance from the axis [m]; NaN in a sweep that turns two axes
    radial_rms: float  #: root mean square of the residuals towards the axis, across it where two turn [m]
    axial_rms: float  #: the same along the axis [m]


@dataclass(frozen=True)
class SweepEvidence:
    """One sweep, fitted by itself."""

    joint: str  #: of the controller, by name
    turned: tuple[str, ...]  #: names of the model's joints that turn
    positions: int  #: how many
    arc: float  #: angle that the readings cover [rad]
    targets: tuple[SweptTarget, ...]  #: evidence by target
    angle_scale: float  #: angle by the readings over that of the controller, dimensionless
    #: root mean square of their difference [rad]; None if the controller's are taken
    angle_deviation: float | None
    variance_factor: float  #: χ²/dof, 1 on average if sigma is right


def sweep_evidence(swept: SweptAxes, joints: Sequence[str]) -> tuple[SweepEvidence, ...]:
    """Return the evidence of each sweep.

    Args:
        swept: axes of the sweeps, fitted one by one.
        joints: names of the model's joints.
    """
    return tuple(
        SweepEvidence(
            joint=fit.sweep.name,
            turned=tuple(joints[index] for index in swept.sweeps.turning(fit.sweep)),
            positions=len(fit.sweep),
            arc=fit.arc,
            targets=tuple(_target(fit, t, name) for t, name in enumerate(swept.names)),
            angle_scale=fit.angle_scale,
            angle_deviation=_rms(fit.angle_deviation) if fit.angle_deviation.any() else None,
            variance_factor=fit.variance_factor,
        )
        for fit in swept.fits
    )


def _target(fit: AxisFit | CoupledFit, t: int, name: str) -> SweptTarget:
    present = fit.sweep.present[:, t]
    if isinstance(fit, AxisFit):
        found = fit.targets[t]
        radius = found.radius if present.any() else float("nan")
        return SweptTarget(name, int(present.sum()), radius, found.radial_rms, found.axial_rms)
    local = fit.residuals[present, t] @ fit.axis.frame
    return SweptTarget(name, int(present.sum()), float("nan"), _rms(local[:, :2]), _rms(local[:, 2]))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")
