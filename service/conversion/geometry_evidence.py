"""What sweeps and poses say of themselves, as messages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointstiff.schemas.geometry import result as results
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.geometry import AxisFit, CalibratedAxes, CoupledFit, IdentifiedAxes, Survey

__all__ = ["to_goodness", "to_pose_evidence", "to_sweep_evidence"]


def to_sweep_evidence(survey: Survey, joints: Sequence[str]) -> list[results.SweepEvidence]:
    """Each sweep by itself; none for poses.

    Args:
        survey: of them.
        joints: names of the model's joints.
    """
    if survey.evidence is None:
        return []
    alone = survey.evidence.one_by_one
    return [
        results.SweepEvidence(
            joint=fit.sweep.name,
            turned=[joints[index] for index in alone.sweeps.turning(fit.sweep)],
            positions=len(fit.sweep),
            arc=fit.arc,
            targets=_swept_targets(fit, alone.names),
            angle_scale=fit.angle_scale,
            angle_deviation=_rms(fit.angle_deviation) if fit.angle_deviation.any() else None,
            variance_factor=fit.variance_factor,
        )
        for fit in alone.fits
    ]


def to_pose_evidence(identified: IdentifiedAxes) -> results.PoseEvidence | None:
    """What poses determine; None for sweeps."""
    if not isinstance(identified, CalibratedAxes):
        return None
    read = identified.residuals.any(axis=-1)
    return results.PoseEvidence(
        positions=len(identified.residuals),
        unknowns=len(identified.covariance),
        determined=identified.rank,
        only_together=[list(names) for names in identified.only_together],
        rms_residual=_rms(identified.residuals[read]) if read.any() else 0.0,
    )


def to_goodness(survey: Survey) -> results.GeometryGoodness:
    """How well one robot fits all readings."""
    identified, evidence = survey.identified, survey.evidence
    return results.GeometryGoodness(
        sigma=identified.sigma,
        sigma_source="stated" if survey.sigma_stated else "residuals",
        degrees_of_freedom=identified.dof,
        variance_factor=identified.variance_factor,
        agreement_probability=evidence.agreement_probability if evidence else None,
        controller_probability=evidence.controller_probability if evidence else None,
    )


def _swept_targets(fit: AxisFit | CoupledFit, names: Sequence[str]) -> list[results.SweptTarget]:
    present = fit.sweep.present
    if isinstance(fit, AxisFit):
        rows = [(target.radius, target.radial_rms, target.axial_rms) for target in fit.targets]
    else:
        local = fit.residuals @ fit.axis.frame
        rows = [
            (np.nan, _rms(local[present[:, t], t, :2]), _rms(local[present[:, t], t, 2]))
            for t in range(len(names))
        ]
    return [
        results.SweptTarget(
            name=name,
            readings=int(present[:, t].sum()),
            radius=_finite(rows[t][0]) if present[:, t].any() else None,
            radial_rms=_finite(rows[t][1]),
            axial_rms=_finite(rows[t][2]),
        )
        for t, name in enumerate(names)
    ]


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
