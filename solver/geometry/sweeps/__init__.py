"""Joint axes from sweeps of one joint at a time."""

from __future__ import annotations

from jointstiff.solver.geometry.sweeps.axis import CHART_SIZE, Axis
from jointstiff.solver.geometry.sweeps.circle_point import AngleUse, AxisFit
from jointstiff.solver.geometry.sweeps.coupled_sweep import CoupledFit
from jointstiff.solver.geometry.sweeps.evidence import SweepEvidence, sweep_evidence
from jointstiff.solver.geometry.sweeps.findings import (
    agreement_findings,
    angle_probability,
    disagree,
    geometry_findings,
)
from jointstiff.solver.geometry.sweeps.identified_axes import Geometry, IdentifiedAxes, posed
from jointstiff.solver.geometry.sweeps.pose_fit import PoseReadings, PoseState, fit_poses
from jointstiff.solver.geometry.sweeps.resting_angles import resting_angles, widened
from jointstiff.solver.geometry.sweeps.sweep import STILL, Sweep, SweepSet, refuse_other_unit
from jointstiff.solver.geometry.sweeps.swept_axes import SweptAxes, identify_axes, robust_sigma

__all__ = [
    "CHART_SIZE",
    "STILL",
    "AngleUse",
    "Axis",
    "AxisFit",
    "CoupledFit",
    "Geometry",
    "IdentifiedAxes",
    "PoseReadings",
    "PoseState",
    "Sweep",
    "SweepEvidence",
    "SweepSet",
    "SweptAxes",
    "agreement_findings",
    "angle_probability",
    "disagree",
    "fit_poses",
    "geometry_findings",
    "identify_axes",
    "posed",
    "refuse_other_unit",
    "resting_angles",
    "robust_sigma",
    "sweep_evidence",
    "widened",
]
