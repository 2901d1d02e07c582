"""Kinematic geometry of a robot from circle-point sweeps or poses."""

from __future__ import annotations

from jointstiff.solver.geometry.finding import GeometryFinding
from jointstiff.solver.geometry.frames import (
    BaseDrift,
    CentreEstimate,
    RigidTransform,
    WristCentre,
    find_drift,
)
from jointstiff.solver.geometry.model import CalibratedAxes, DhTable, LinkParameter, Poses
from jointstiff.solver.geometry.survey import BaseTargets, Conventions, Survey, survey_poses, survey_sweeps
from jointstiff.solver.geometry.sweeps import (
    Axis,
    AxisFit,
    CoupledFit,
    Geometry,
    IdentifiedAxes,
    Sweep,
    SweepSet,
)

__all__ = [
    "Axis",
    "AxisFit",
    "BaseDrift",
    "BaseTargets",
    "CalibratedAxes",
    "CentreEstimate",
    "Conventions",
    "CoupledFit",
    "DhTable",
    "Geometry",
    "GeometryFinding",
    "IdentifiedAxes",
    "LinkParameter",
    "Poses",
    "RigidTransform",
    "Survey",
    "Sweep",
    "SweepSet",
    "WristCentre",
    "find_drift",
    "survey_poses",
    "survey_sweeps",
]
